"""Progress of long work where stderr is no terminal: plain lines far apart, and none for short work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import seatrial as st
from seatrial.acquisition.core import errors
from seatrial.acquisition.recording import writer
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.check import check_recording
from tests.conftest import Simulated

Printed = Callable[..., list[str]]


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Printed:
    """The lines on stderr of work that reports fractions at times [s]."""
    monkeypatch.setattr(errors, "PROGRESS_INTERVAL_S", 30.0)

    def run(*reports: tuple[float, float]) -> list[str]:
        clock = iter([0.0, *(time_s for time_s, _ in reports)])
        progress = errors.progress_lines("fitting", lambda: next(clock))
        for _, fraction in reports:
            progress(fraction)
        out, err = capsys.readouterr()
        assert out == ""
        return err.splitlines()

    return run


def test_short_work_prints_no_progress(printed: Printed) -> None:
    assert printed((1.0, 0.2), (10.0, 0.6), (29.0, 1.0)) == []


def test_lines_of_progress_are_half_a_minute_apart(printed: Printed) -> None:
    reports = [(float(second), second / 100.0) for second in range(101)]
    assert printed(*reports) == ["fitting: 30 %", "fitting: 60 %", "fitting: 90 %"]


def test_the_same_percentage_is_printed_once(printed: Printed) -> None:
    assert printed((40.0, 0.101), (80.0, 0.105), (120.0, 0.12)) == ["fitting: 10 %", "fitting: 12 %"]


def test_a_day_of_work_prints_a_hundred_lines(printed: Printed) -> None:
    reports = [(86.4 * number, number / 1000.0) for number in range(1001)]
    assert len(printed(*reports)) == 100


def test_lines_are_for_a_stream_that_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(errors, "PROGRESS_INTERVAL_S", 0.0)
    with errors.progress_bar("training") as progress:
        progress(0.5)
    assert capsys.readouterr().err == "training: 50 %\n"


def test_import_and_check_report_their_progress(
    simulated: Simulated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "_ROWS_TO_FLUSH", 100)
    recorded = simulated("gentle", 100, 1200.0)
    st.export(recorded, tmp_path / "trial.csv")
    imported, checked = list[float](), list[float]()
    import_table(tmp_path / "trial.csv", tmp_path / "trial.mcap", progress=imported.append)
    check_recording(read_recording(tmp_path / "trial.mcap"), progress=checked.append)
    for fractions in (imported, checked):
        assert len(fractions) >= 10
        assert fractions == sorted(fractions)
        assert 0.0 <= fractions[0] < fractions[-1] <= 1.0
