"""The glossary has the abbreviations that help texts and pages say, and tells each term in a sentence or two."""

from __future__ import annotations

import re
from collections.abc import Iterator

import click
import pytest
import typer.main

import seatrial
from tests.pages import DOCS, ROOT

GLOSSARY = (DOCS / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in row.strip("|").split("|")] for row in re.findall(r"^\|.+\|$", GLOSSARY, re.MULTILINE)
]
TERMS = [term for first, *_ in ROWS if first not in ("term", "short", "---") for term in first.split(", ")]
COMMAND = typer.main.get_command(seatrial.app)
SHOWN = (ROOT / "analysis" / "report", ROOT / "hybrid" / "report")
_ABBREVIATION = re.compile(r"(?<![\w#.:=+,/-])[A-Z]{2,}(?![\w.:=+,/]*[=:/_]|\.\w|\w)")
_HIDDEN = re.compile(r"<style>.*?</style>|<script.*?</script>|{#.*?#}", re.DOTALL)
_CODE = re.compile(r"{[{%].*?[%}]}|<[^>]*>", re.DOTALL)


def helps(command: click.Command, path: str = "seatrial") -> Iterator[tuple[str, str]]:
    """Every help text with the command, or the option, that it is of."""
    yield path, command.help or ""
    yield from (
        (f"{path} {'/'.join(each.opts)}", str(getattr(each, "help", None) or "")) for each in command.params
    )
    for name, each in getattr(command, "commands", {}).items():
        yield from helps(each, f"{path} {name}")


def texts_of_reports() -> Iterator[tuple[str, str]]:
    """What templates say: the text outside of their code, and the strings in it."""
    for folder in SHOWN:
        for path in folder.rglob("*.html"):
            text = _HIDDEN.sub(" ", path.read_text(encoding="utf-8"))
            strings = [each for code in _CODE.findall(text) for each in re.findall(r'"([^"]* [^"]*)"', code)]
            yield path.name, " ".join([_CODE.sub(" ", text), *strings])


def parameters(command: click.Command) -> set[str]:
    """The names of all arguments and options, which stand in capitals for their values."""
    own = {str(each.name).upper() for each in command.params}
    return own.union(*(parameters(each) for each in getattr(command, "commands", {}).values()))


def test_every_abbreviation_that_a_user_reads_is_in_the_glossary() -> None:
    """Placeholders, like RECORDING or NAME=VALUE, are none; the latter are joined to something in their text."""
    every = [*helps(COMMAND), *texts_of_reports()]
    known = {*TERMS, *parameters(COMMAND)}
    unknown = {
        (word, place)
        for place, text in every
        for word in _ABBREVIATION.findall(text)
        if word not in known and not re.search(rf"{word}[=.:,_]\w|[=:+.,]{word}", text) and word.strip("IVX")
    }
    assert not unknown


def test_terms_stand_once_and_in_order() -> None:
    assert len(TERMS) == len(set(TERMS))
    for section in GLOSSARY.split("\n## ")[1:]:
        _, _, *rows = re.findall(r"^\|(.+?)\|", section, re.MULTILINE)
        assert rows == sorted(rows, key=str.lower)


@pytest.mark.parametrize(
    "row", [row for row in ROWS if len(row) == 3 and row[0] not in ("term", "---")], ids=lambda row: row[0]
)
def test_a_term_is_told_in_a_sentence_or_two(row: list[str]) -> None:
    assert row[1].endswith(".")
    assert len(row[1].split()) <= 45
