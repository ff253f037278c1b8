"""The documentation says what is: its links lead somewhere, its commands, paths, code and settings are real."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import typer.main

import seatrial
from seatrial.analysis.tables.export import KINDS
from tests.pages import DOCS, ROOT, Block, Page, block_of, page, pages

PAGES = pages()
_COMMAND = re.compile(r"(?<![-/])\bseatrial [a-z][^`\n|]+")
_PATH = re.compile(r"`((?:acquisition|analysis|hybrid|trials|tests|docs|notebooks)/[\w./*]+)`")
_REMOTE = ("http://", "https://", "mailto:")
EXTERNAL = {"https://mcap.dev", "https://jupytext.readthedocs.io", "https://weasyprint.org"}
"""Other sites that a page may link to: few, as nobody looks after them."""


def every(language: str) -> list[tuple[Page, Block]]:
    """The fenced blocks of one language on all pages."""
    return [(each, block) for each in PAGES for block in each.blocks if block.language == language]


def name(value: object) -> str | None:
    """How a page or a block is called in a test's name."""
    if isinstance(value, Block):
        return f"line {value.line}"
    return value.name if isinstance(value, Page) else None


# Links


@pytest.mark.parametrize("each", PAGES, ids=name)
def test_links_lead_somewhere(each: Page) -> None:
    """Files are there, and so are the headings that a link names; links to other sites are on the list."""
    for target in each.links:
        if target.startswith(_REMOTE):
            assert target.rstrip("/") in EXTERNAL, target
            continue
        path, _, anchor = target.partition("#")
        there = (each.path.parent / path).resolve() if path else each.path
        assert there.exists(), target
        if anchor:
            assert anchor in Page(there, there.read_text(encoding="utf-8")).anchors, target


def test_every_page_is_in_a_table_of_contents() -> None:
    """A page that none lists is found by nobody."""
    listed = {"index.md"}
    for each in PAGES:
        for block in each.blocks:
            if block.language == "toctree":
                lines = [line.strip() for line in block.text.splitlines() if line and not line.startswith(":")]
                entries = [re.sub(r".*<(.*)>", r"\1", line) for line in lines]
                listed |= {_below_docs(each.path.parent / f"{entry}.md") for entry in entries}
    assert {_below_docs(each.path) for each in PAGES if each.path.is_relative_to(DOCS)} == listed


def _below_docs(path: Path) -> str:
    return path.resolve().relative_to(DOCS.resolve()).as_posix()


@pytest.mark.parametrize("each", PAGES, ids=name)
def test_paths_of_the_repository_exist(each: Page) -> None:
    """Whole paths as they stand, names of single modules anywhere in the packages."""
    for path in _PATH.findall(each.prose):
        if path.startswith("docs/_build/"):
            continue  # made by `make docs`
        assert any(ROOT.glob(path)) if "*" in path else (ROOT / path).exists(), path
    for name_of_file in re.findall(r"`(\w+\.py)`", each.prose):
        assert name_of_file in modules(), name_of_file


@cache
def modules() -> set[str]:
    """The names of all Python files."""
    places = ("acquisition", "analysis", "hybrid", "notebooks", "tests", "trials")
    outputs = {"regimes.py"}  # what a diagnosis writes
    return {"seatrial.py", *outputs} | {path.name for place in places for path in (ROOT / place).rglob("*.py")}


# Commands


@cache
def commands() -> dict[str, Any]:
    """Every command, those of a group by both names."""
    found = dict(typer.main.get_command(seatrial.app).commands)  # type: ignore[attr-defined]
    for group, command in list(found.items()):
        for inner, each in getattr(command, "commands", {}).items():
            found[f"{group} {inner}"] = each
    return found


def command_lines(each: Page) -> Iterator[str]:
    """The lines that call `seatrial`: in blocks as they stand, in prose between backquotes."""
    for block in each.blocks:
        if block.language in ("", "sh"):
            text = block.text.replace("\\\n", " ")
            yield from (found.rstrip() for found in _COMMAND.findall(text))
    for code in re.findall(r"`([^`\n]+)`", each.prose):
        if code.startswith("seatrial "):
            yield code
    yield from (line.strip() for line in each.prose.splitlines() if line.startswith("    seatrial "))


def wrong_with(line: str) -> str:
    """What is wrong with a command line; empty if nothing is. Placeholders and `...` are passed over."""
    words = [word for word in shlex.split(line, comments=True)[1:] if word not in ("...", "|")]
    words = [word.strip("[]") for word in words if not re.search(r"[<>&;]", word)]
    if not words or words[0] in ("--help", "COMMAND"):
        return ""
    both = " ".join(words[:2])
    command = commands().get(both) or commands().get(words[0])
    if command is None:
        return f"no command {words[0]!r}"
    flags = {flag for each in command.params for flag in (*each.opts, *each.secondary_opts)} | {"--help"}
    unknown = [word for word in words if re.match(r"--?[a-z]", word) and word.partition("=")[0] not in flags]
    return f"no option {unknown}" if unknown else ""


@pytest.mark.parametrize("each", PAGES, ids=name)
def test_commands_and_options_exist(each: Page) -> None:
    for line in command_lines(each):
        assert not wrong_with(line), line


def test_a_wrong_command_line_would_be_seen() -> None:
    assert wrong_with("seatrial dianose trial.mcap") == "no command 'dianose'"
    assert wrong_with("seatrial diagnose trial.mcap --toleranze 2") == "no option ['--toleranze']"
    assert wrong_with("seatrial reproduce table3 --seed 2 -o DIR") == ""


def test_every_command_is_described() -> None:
    """The README's table names each, and so does the reference, which is made of them all."""
    readme = next(each for each in PAGES if each.name == "README.md").text
    reference = (DOCS / "reference" / "command_line.md").read_text(encoding="utf-8")
    alone = [each for each in commands() if " " not in each]
    assert not [each for each in alone if f"`seatrial {each}" not in readme and each != "demo"]
    assert not [each for each in alone if f"`{each}`" not in reference]


def test_every_form_of_a_table_is_described() -> None:
    products = (DOCS / "reference" / "products.md").read_text(encoding="utf-8")
    assert not [kind for kind in KINDS if f"T{kind}`" not in products]


# Code and settings


@pytest.mark.parametrize(("each", "block"), every("python"), ids=name)
def test_python_compiles(each: Page, block: Block) -> None:
    compile(block.text, f"{each.name}, line {block.line}", "exec")


@pytest.mark.parametrize(("each", "block"), every("python"), ids=name)
def test_what_python_imports_is_there(each: Page, block: Block) -> None:
    """Lines that import run as they stand."""
    exec("\n".join(line for line in block.text.splitlines() if re.match(r"from [\w.]+ import \w", line)), {})


@pytest.mark.parametrize(("each", "block"), every("toml"), ids=name)
def test_toml_can_be_read(each: Page, block: Block) -> None:
    assert tomllib.loads(block.text)


def test_the_channels_of_the_page_are_channels(tmp_path: Path) -> None:
    """Each block stands in a configuration, beside a source where it has none; each origin of the table is one."""
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.core.quantities import name_ending_of_unit
    from seatrial.acquisition.protocols import decoders_by_protocol

    chapter, source = page("howto/add_a_channel.md"), 'type = "file"\npath = "x.log"\nchannels = ["heading_deg"]'
    blocks = [each.text for each in chapter.blocks if each.language == "toml"]
    told = [block if "[[source]]" in block else f'{block}\n[[source]]\nname = "x"\n{source}' for block in blocks]
    origins = re.findall(r"`(\{ (?:sentence|transducer|group|message) .*? \})` \|", chapter.text)
    for origin, unit in zip(origins, ("m", "m", "deg", "l/h", "l/h", "V"), strict=True):
        kind = 'type = "mavlink"\nport = 14550' if "message" in origin else 'type = "file"\npath = "x.log"'
        channel = f'name = "x{name_ending_of_unit(unit)}"\nunit = "{unit}"\nrange = [0, 1]\nfrom = [{origin}]'
        told.append(
            f'[[channel]]\n{channel}\n[[source]]\nname = "x"\nchannels = ["x{name_ending_of_unit(unit)}"]\n{kind}'
        )
    for number, text in enumerate(told):
        path = tmp_path / f"{number}.toml"
        path.write_text(f'[trial]\nname = "t"\n{text}', encoding="utf-8")
        config = load_config(path)
        assert decoders_by_protocol(config.sources[0], config.actuators, config.declared)
    assert len(blocks) == 3


def test_the_vessel_of_the_page_can_be_loaded(tmp_path: Path) -> None:
    from seatrial.hybrid.vessel.files import load_vessel

    path = tmp_path / "gunnerus_loaded.toml"
    path.write_text(block_of("howto/add_a_vessel.md", "Change an existing vessel", "toml"), encoding="utf-8")
    vessel = load_vessel(path)
    assert vessel.name == "gunnerus_loaded"
    assert vessel.inertia.mass_kg == 440930.0


def test_the_drogue_of_the_page_is_the_file() -> None:
    code = (ROOT / "trials" / "effects" / "drogue.py").read_text(encoding="utf-8")
    assert block_of("effects.md", "Adding one of your own", "python").strip() == code.strip()


def test_the_sensors_of_the_page_are_sources(tmp_path: Path) -> None:
    """Each stands in a configuration of its own, beside the DBC file that it names."""
    from seatrial.acquisition.config.trial_file import load_config

    (tmp_path / "vessels").mkdir()
    dbc = "vessels/thrusters.dbc"
    (tmp_path / dbc).write_bytes((ROOT / "trials" / dbc).read_bytes())
    blocks = [each.text for each in page("howto/add_a_sensor.md").blocks if each.language == "toml"]
    for number, text in enumerate(blocks):
        path = tmp_path / f"{number}.toml"
        path.write_text(f'[trial]\nname = "t"\n\n{text}', encoding="utf-8")
        assert load_config(path).sources[0].channels
    assert len(blocks) == 3


def test_the_column_map_of_the_page_imports(tmp_path: Path) -> None:
    """A table with its columns becomes a recording, in the channels' units and with their signs."""
    from seatrial.acquisition.tables.import_table import import_table
    from seatrial.analysis.tables.table import read_table

    path, table = tmp_path / "map.toml", tmp_path / "table.csv"
    path.write_text(block_of("howto/import.md", "A column map", "toml"), encoding="utf-8")
    motion = ["Time", "Lat", "Lon", "HDG", "SOG fwd [kn]", "SOG stbd [kn]", "ROT"]
    columns = [*motion, "TWD", "TWS", "P rpm %", "P azi", "S rpm %", "S azi"]
    values = ["63.44", "10.4", "90", "10", "0", "30", "200", "5", "50", "20", "50", "-20"]
    rows = [",".join([f"2026-06-01T12:00:{second:02d}", *values]) for second in range(10)]
    table.write_text("\n".join([",".join(columns), *rows]), encoding="utf-8")
    import_table(table, tmp_path / "trial.mcap", path)
    read = read_table(tmp_path / "trial.mcap")
    assert read.index[0] == pd.Timestamp("2026-06-01T10:00:00Z")
    first = read.iloc[0]
    assert first["surge_mps"] == pytest.approx(5.144, abs=0.001)
    assert (first["yaw_rate_dps"], first["port_rpm"]) == (pytest.approx(0.5), pytest.approx(101.5))
    assert (first["port_angle_deg"], first["starboard_angle_deg"]) == (-20.0, 20.0)
    assert "tunnel_rpm" not in read
