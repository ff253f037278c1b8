"""The tutorial, typed word by word in an empty folder: every command works and prints what the page shows."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest

from tests.pages import ROOT, Block, page

pytestmark = [pytest.mark.pages]

_BLOCKS = page("tutorial.md").blocks
_STEPS = [each for each in _BLOCKS if each.language == "sh"]
_SHOWN = {
    one.line: other.text for one, other in pairwise(_BLOCKS) if one.language == "sh" and other.language == "text"
}
_NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?")
_NEAR, _LEAST = 0.25, 2.0  # figures differ a little from machine to machine

MAKES = {
    "1": ["ship/voyage.mcap", "ship/voyage.truth.json"],
    "3": ["trial.mcap", "record.log"],
    "6": ["trial.parquet", "windows.parquet", "windows.starts.parquet"],
    "7": ["manoeuvres/manoeuvres.html", "manoeuvres/manoeuvres.json"],
    "8": ["calibrator/calibrator.json"],
    "10": ["report.html", "report.pdf", "indices.json", "figures", "diagnosis/report.pdf"],
    "9": ["diagnosis/report.html", "diagnosis/diagnosis.json", "diagnosis/vessel.toml"],
}
"""What each step leaves in the folder, by its number."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The empty folder that the reader works in."""
    return tmp_path_factory.mktemp("tutorial")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The reader's shell: `seatrial` is this repository's."""
    commands = tmp_path_factory.mktemp("bin")
    for name, call in (("seatrial", f"{ROOT / 'seatrial.py'} "), ("python", "")):
        script = commands / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {call}"$@"\n', encoding="utf-8")
        script.chmod(0o755)
    path = f"{commands}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}


def typed(text: str, folder: Path, environment: dict[str, str]) -> str:
    """Run a block as a shell does; what it prints."""
    shell = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", text], cwd=folder, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    try:
        printed, said = shell.communicate()
    finally:
        with suppress(ProcessLookupError):  # what a failed block leaves in the background holds the ports
            os.killpg(shell.pid, signal.SIGKILL)
    assert shell.returncode == 0, said or printed
    return printed + said


@pytest.mark.parametrize("step", _STEPS, ids=lambda step: step.heading)
def test_a_step(step: Block, folder: Path, environment: dict[str, str]) -> None:
    """Exit code 0, the files are there, and the lines that the page shows are printed."""
    printed = typed(step.text, folder, environment)
    for line in _SHOWN.get(step.line, "").splitlines():
        assert line == "..." or appears(line, printed), f"not printed: {line}\n{printed}"
    for name in MAKES.get(step.heading.split(".")[0], []):
        assert (folder / name).exists(), name


def test_the_fouled_hull_and_the_current_are_named(folder: Path) -> None:
    """What step 9 says in words: both causes and no other, the hidden factor in its interval, the gap closed."""
    found = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    hidden = json.loads((folder / "ship" / "voyage.truth.json").read_text())["hidden"]
    named = {each["name"]: each["parameters"] for each in found["effects"]}
    assert found["verdict"] == "named"
    assert set(named) == {"hull_fouling", "ocean_current"}
    factor = named["hull_fouling"]["resistance_factor"]
    assert factor["low"] <= hidden["hull_fouling"]["resistance_factor"] <= factor["high"]
    assert abs(named["ocean_current"]["speed_mps"]["value"] - 0.2) < 0.02
    assert found["gap"]["closed"] > 0.9


def run(name: str, folder: Path, environment: dict[str, str]) -> str:
    """What the Python of a page prints beside the tutorial's recording."""
    code = "\n".join(each.text for each in page(name).blocks if each.language == "python")
    (folder / "block.py").write_text(code, encoding="utf-8")
    return typed("python block.py", folder, environment)


def test_the_same_in_python(folder: Path, environment: dict[str, str]) -> None:
    assert "gunnerus_short 1200 s" in run("tutorial.md", folder, environment)


def test_a_recording_is_read_without_seatrial(folder: Path, environment: dict[str, str]) -> None:
    """By the Python of the file format's page: the first heading, with the time that its source tells."""
    time_s, heading_deg, unit = run("file_format.md", folder, environment).split()
    assert (float(time_s), unit) == (1780300800.0, "deg")
    assert 0.0 <= float(heading_deg) < 360.0


def test_a_recording_is_decoded_anew_with_its_own_configuration(folder: Path, environment: dict[str, str]) -> None:
    """Taken out as the page on recovery says, given back to `redecode`: the same samples."""
    run("howto/recover.md", folder, environment)
    configuration = (folder / "configuration.toml").read_text(encoding="utf-8")
    assert configuration == (folder / "bridge.toml").read_text(encoding="utf-8")
    typed("seatrial redecode trial.mcap -o anew.mcap --config configuration.toml", folder, environment)
    counts = [
        {name: each["count"] for name, each in json.loads(text)["channels"].items()}
        for text in (typed(f"seatrial info {name}.mcap --json", folder, environment) for name in ("trial", "anew"))
    ]
    assert counts[0] == counts[1]


@pytest.mark.parametrize("command", [
    "info trial.mcap", "check trial.mcap", "windows trial.mcap -o w.parquet --no-starts", "effects",
    "smooth trial.mcap -o s.parquet", "manoeuvres trial.mcap --length 28.9", "predict trial.mcap --at +60",
    "validate trial.mcap --calibrator calibrator", "diagnose",
])  # fmt: skip
def test_every_key_is_described(command: str, folder: Path, environment: dict[str, str]) -> None:
    """The page of products names all keys of a command's JSON."""
    name = command.split()[0]
    if name == "diagnose":
        text = (folder / "diagnosis" / "diagnosis.json").read_text()
    else:
        text = typed(f"seatrial {command} --json 2>/dev/null", folder, environment)
    section = page("reference/products.md").text.partition(f"### {name}\n")[2].partition("\n### ")[0]
    described = set(re.findall(r"`(\w+)`", section))
    assert set(keys_of(json.loads(text))) <= described


_BY_NAME = {"channels", "raw", "trial", "dropped", "noise", "rejected", "consistency", "methods", "settings",
            "indices", "estimate", "cell", "parameters", "current", "provenance"}  # fmt: skip
"""Keys whose values are by channel, topic, reason, method or parameter, or described elsewhere."""


def keys_of(value: object) -> Iterator[str]:
    """All keys of a JSON object but those that are names of channels, methods and the like."""
    if isinstance(value, list):
        for each in value:
            yield from keys_of(each)
    elif isinstance(value, dict):
        for key, each in value.items():
            yield key
            inner = list(each.values()) if key in _BY_NAME and isinstance(each, dict) else each
            yield from keys_of(inner) if key not in ("provenance", "current") else ()


def test_lines_are_compared_by_words_and_near_numbers() -> None:
    printed = "kept:   92 of 237\nwindows; mean 0.755 m\n"
    assert appears("92 of 240 windows", printed)
    assert not appears("92 of 400 windows", printed)
    assert not appears("92 of 237 legs", printed)


def appears(line: str, printed: str) -> bool:
    """Whether the words of a line follow each other in what was printed; numbers need only be near."""
    wanted, words = line.split(), printed.split()
    return any(
        all(_same(one, other) for one, other in zip(wanted, words[start:], strict=False))
        for start in range(len(words) - len(wanted) + 1)
    )


def _same(wanted: str, word: str) -> bool:
    wanted, word = wanted.rstrip(",;."), word.rstrip(",;.")
    if _NUMBER.sub("#", wanted) != _NUMBER.sub("#", word):
        return False
    pairs = zip(_NUMBER.findall(wanted), _NUMBER.findall(word), strict=True)
    return all(_near(one.replace(",", ""), other.replace(",", "")) for one, other in pairs)


def _near(one: str, other: str) -> bool:
    """Within a quarter, or a few of the last digit that is told."""
    last_digit = 10.0 ** -len(one.partition(".")[2])
    return abs(float(one) - float(other)) <= max(_NEAR * abs(float(one)), _LEAST * last_digit)
