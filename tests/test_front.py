"""Every command is the function of its name: the same options, documented in full."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

import seatrial as st
import seatrial.hybrid.commands  # registers all commands
from seatrial.acquisition.commands import COMMANDS, Command, recording_paths
from seatrial.acquisition.core.errors import InputError
from seatrial.analysis.tables.table import percent_of

NAMES = [f"{entry.group} {entry.name}".strip() for entry in COMMANDS]
UNITS = ("_s", "_m", "_hz", "_kw", "_min", "_percent", "_mps", "_m2", "_kgpm3", "_deg")


def parameters(entry: Command) -> dict[str, Any]:
    """The parameters that are options, with their metadata."""
    scope, options = entry.function.__globals__, {}
    for name, parameter in inspect.signature(entry.function).parameters.items():
        annotation = eval(parameter.annotation, scope)
        if extras := getattr(annotation, "__metadata__", ()):
            options[name] = extras[-1]
    return options


@pytest.mark.parametrize("entry", COMMANDS, ids=NAMES)
def test_command_is_a_function_of_the_package(entry: Command) -> None:
    assert getattr(st, entry.function.__name__) is entry.function
    word = entry.function.__name__.replace("_", "-")
    assert word in (entry.name, f"{entry.group}-{entry.name}", f"{entry.name}-{entry.group}", "import-table")


@pytest.mark.parametrize("entry", COMMANDS, ids=NAMES)
def test_options_have_the_names_of_the_parameters(entry: Command) -> None:
    """``horizon_s`` is ``--horizon``: the unit stands in the name of a parameter and in the help of an option."""
    for name, option in parameters(entry).items():
        declared = (option.default, *(option.param_decls or ()))  # typer takes the first for a default
        flags = [flag for flag in declared if isinstance(flag, str) and flag.startswith("--")]
        if isinstance(option, typer.models.ArgumentInfo) or not flags or name in ("output", "as_json"):
            continue
        stem = next((name.removesuffix(unit) for unit in UNITS if name.endswith(unit)), name)
        spelled = {flag.partition("/")[0].lstrip("-").replace("-", "_") for flag in flags}
        plural = {f"{word}s" for word in spelled}
        renamed = {"finders": "manoeuvre", "orders": "commands", "all_indices": "all", "method": "method"}
        assert {stem, renamed.get(stem, stem)} & (spelled | plural), (name, flags)


@pytest.mark.parametrize("name", st.__all__)
def test_every_function_documents_parameters_result_and_examples(name: str) -> None:
    function = getattr(st, name)
    text, signature = inspect.getdoc(function) or "", inspect.signature(function)
    assert ("\nReturns\n-------\n" in text) == (signature.return_annotation != "None")
    assert "\nExamples\n--------\n" in text
    described = {
        word.strip().lstrip("*")
        for line in text.split("\nParameters\n")[-1].splitlines()
        if line and not line.startswith((" ", "-"))
        for word in line.split(",")
    }
    assert set(signature.parameters) <= described


def test_reference_shows_every_function() -> None:
    page = (Path(__file__).parents[1] / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^.. autofunction:: seatrial\.(\w+)$", page, re.MULTILINE)) == sorted(st.__all__)


def test_a_table_may_stand_where_a_recording_is_asked_for(tmp_path: Any) -> None:
    table = st.simulate(tmp_path / "trial.mcap", duration_s=60.0, rate_hz=1.0)
    (path,) = recording_paths(table)
    again = st.read(path)
    pd.testing.assert_frame_equal(again[table.columns], table, check_freq=False, check_names=False)
    assert st.info(table)["channels"].keys() == st.info(tmp_path / "trial.mcap")["channels"].keys()


def test_version_is_that_of_the_distribution() -> None:
    assert f"seatrial {st.__version__}" == st.version()


@pytest.mark.parametrize(
    "words", ["check trial.mcap -o out", "manoeuvres trial.mcap -o out", "windows trial.mcap -o out.parquet"]
)
def test_json_has_stdout_for_itself_when_files_are_written(
    words: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    st.simulate(tmp_path / "trial.mcap", manoeuvre="turning_circle_30", duration_s=300.0, rate_hz=1.0)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(st.app, [*words.split(), "--json"], catch_exceptions=False)
    assert json.loads(done.stdout)


def test_part_of_the_time_is_taken_as_it_is_given() -> None:
    """A third of a recording is a third, not 33.3333 %."""
    third = 100.0 / 3.0
    assert percent_of((0.0, third)) == (0.0, third) == percent_of(f"0..{third!r}")
    for part in ((50.0, 50.0), (0.0, 101.0), "70..0"):
        with pytest.raises(InputError):
            percent_of(part)
