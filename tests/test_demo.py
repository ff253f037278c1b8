"""The main job from end to end, as `make demo` runs it."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pytest

from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import SimulatedClock, clock

__all__ = ["clock"]  # a fixture


@pytest.mark.parametrize(
    ("held", "longest_s"), [([2, 2, 2, 5, 5, 6, 9], 0.5), ([2, 6, 6], 5.5)], ids=["late", "lost"]
)
def test_the_recorder_is_ended_when_it_has_all_that_was_played_or_nothing_more_comes(
    held: list[int], longest_s: float, clock: SimulatedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recorder on a busy machine is behind: a fixed pause cut off the end of the voyage."""
    from seatrial.hybrid import workflows

    left, asked = iter(held), list[int]()

    def count(folder: Path, names: object) -> int:
        asked.append(next(left, held[-1]))
        return asked[-1]

    monkeypatch.setattr(workflows, "time", clock)
    monkeypatch.setattr(workflows, "_count_recorded_values", count)
    began_s = clock.now_s
    workflows._wait_for_all(Path(), {"heading_deg": 5, "north_m": 4})
    assert asked[: len(held)] == held
    assert clock.now_s - began_s == pytest.approx(0.5 * held.index(max(held)) + longest_s)


def test_what_runs_meanwhile_needs_no_rights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is not root may make a process idle, but never take it out of that class again."""
    from seatrial.hybrid import workflows

    classes, allowed = list[int](), os.sched_getaffinity(0)

    def schedule(process: int, policy: int, parameters: object) -> None:
        classes.append(policy)
        if policy != os.SCHED_IDLE:
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    failed = pytest.raises(SeatrialError, match=r"_has_values failed.*TypeError")
    with failed, workflows.run_in_processes(partial(workflows._has_values, None, "north_m")):
        pass
    assert classes == [os.SCHED_IDLE]
    assert os.sched_getaffinity(0) == allowed


@pytest.mark.slow
def test_the_demo_loses_nothing_and_beats_the_reference(tmp_path: Path) -> None:
    """Every played value is recorded, and the calibrator is better than its reference on the unseen voyage."""
    from seatrial.hybrid.workflows import run_demonstration

    said: list[str] = []
    done = run_demonstration(tmp_path, seed=7, say=said.append)
    assert done.played.counts.keys() >= set(NAMES)
    assert sum(done.lost.values()) == 0
    assert read_recording(done.recording).closed
    assert done.validation.reduction is not None
    assert done.validation.reduction > 0.3
    assert "hull_lengthening" in [effect.name for effect in done.diagnosis.effects]
    assert done.diagnosis.gap.closed > 0.9
    page = done.report.read_text()
    assert page.count("data:image/png;base64,") >= 8
    assert "ocean current" in page
    assert 'href="diagnosis/report.html"' in page
    assert (done.report.parent / "diagnosis" / "report.html").is_file()
    assert "http://" not in page
    assert "https://" not in page
