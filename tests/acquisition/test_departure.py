"""The check before departure: where the recording would go is examined, and nothing is written there."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.config.sources import AlarmSection, CopiesSection, RecordingSection
from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.logger import survey as departure
from seatrial.acquisition.logger.record import preflight_table
from seatrial.acquisition.logger.survey import PreflightReport, check_before_departure, check_recording_folder
from seatrial.acquisition.recording.writer import free_and_total_bytes
from tests.acquisition.conftest import config_text, free_port

DEFAULT = RecordingSection()
MORE_THAN_ANY_DISK_MB = 1e15


def config_of(folder: Path, reserve_mb: float) -> TrialConfig:
    text = config_text(f'type = "udp"\nport = {free_port()}\n', ("heading_deg",), clock="receiver")
    (folder / "trial.toml").write_text(f"{text}[recording]\nreserve_mb = {reserve_mb}\n")
    return load_config(folder / "trial.toml")


def a_file(folder: Path) -> Path:
    (folder / "file").touch()
    return folder / "file"


def below_a_file(folder: Path) -> Path:
    return a_file(folder) / "out"


def a_link_to_nothing(folder: Path) -> Path:
    (folder / "link").symlink_to(folder / "gone")
    return folder / "link"


@pytest.mark.parametrize("name", [".", "out", "out/of/folders"])
def test_a_folder_that_is_there_or_can_be_made_is_good(tmp_path: Path, name: str) -> None:
    free, problem = check_recording_folder(tmp_path / name, DEFAULT)
    assert (free, problem) == (pytest.approx(free_and_total_bytes(tmp_path)[0], rel=0.2), "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", [a_file, below_a_file, a_link_to_nothing])
def test_what_is_no_folder_and_cannot_be_one_is_a_problem(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    folder = make(tmp_path)
    free, problem = check_recording_folder(folder, DEFAULT)
    assert free is None
    assert problem.startswith(f"{folder}: {tmp_path}")
    assert problem.endswith("is no folder")


@pytest.mark.parametrize(("name", "end"), [(".", "written to"), ("out", "made: {} cannot be written to")])
def test_a_folder_that_may_not_be_written_to_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, end: str
) -> None:
    """As the system tells of a disk that is read-only; the tests may run as somebody who may write anywhere."""
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    free, problem = check_recording_folder(tmp_path / name, DEFAULT)
    assert (free, problem) == (None, f"{tmp_path / name} cannot be {end.format(tmp_path)}")


def test_a_disk_that_does_not_answer_is_a_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(folder: Path) -> tuple[int, int]:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(departure, "free_and_total_bytes", failing)
    assert check_recording_folder(tmp_path, DEFAULT)[1].endswith("cannot be asked for room: Input/output error")


def test_less_than_the_reserve_is_a_problem(tmp_path: Path) -> None:
    settings = replace(DEFAULT, reserve_mb=MORE_THAN_ANY_DISK_MB)
    free, problem = check_recording_folder(tmp_path, settings)
    assert free is not None
    assert "MB free, less than the reserve of 1000000000000000.0 MB" in problem


def test_the_reserve_holds_where_the_recording_goes_and_not_for_the_scratch(tmp_path: Path) -> None:
    """A check without a folder hears the sources, whatever the reserve; with one it names the folder's problem."""
    config = config_of(tmp_path, MORE_THAN_ANY_DISK_MB)
    assert check_before_departure(config, 0.1).disk_problem == ""
    found = check_before_departure(config, 0.1, tmp_path / "out")
    assert "less than the reserve" in found.disk_problem
    assert found.as_json()["disk_problem"] == found.disk_problem
    assert found.obstacles[-1] == found.disk_problem
    assert [path.name for path in tmp_path.iterdir()] == ["trial.toml"]


def test_a_problem_with_the_disk_alone_makes_a_check_not_ready() -> None:
    good = PreflightReport([], [], [], 10**9)
    bad = replace(good, free_bytes=None, disk_problem="/data: /data is no folder")
    assert (good.as_json()["ready"], bad.as_json()["ready"]) == (True, False)
    shown = [_shown(each) for each in (good, bad)]
    assert "1.0 GB free where the recording goes" in shown[0]
    assert "✗ /data: /data is no folder" in shown[1]


def _shown(found: PreflightReport) -> str:
    shown = io.StringIO()
    Console(width=100, file=shown).print(preflight_table(found))
    return shown.getvalue()


def test_the_command_says_so_and_leaves_by_exit_code_1(tmp_path: Path) -> None:
    config_of(tmp_path, 0.0)
    arguments = ["record", "--check", str(tmp_path / "trial.toml"), "--duration", "0.1", "--json"]
    result = CliRunner().invoke(app, [*arguments, "-o", str(a_file(tmp_path))])
    assert result.exit_code == 1
    found = json.loads(next(line for line in result.output.splitlines() if line.startswith("{")))
    assert found["disk_problem"].endswith("file is no folder")
    assert "file is no folder" in result.output.split("not ready: ")[1]


def test_copies_and_alarms_are_looked_at_too(tmp_path: Path) -> None:
    config = config_of(tmp_path, 0.0)
    away = replace(config, copies=CopiesSection(tmp_path / "away"))
    found = check_before_departure(away, 0.1, tmp_path)
    assert f"{tmp_path / 'away'} is not there to copy to" in found.obstacles
    wrong = replace(config, alarms=(AlarmSection(name="a", figure="heading", above=1.0),))
    with pytest.raises(ConfigurationError, match="unknown figure 'heading'"):
        check_before_departure(wrong, 0.1, tmp_path)
