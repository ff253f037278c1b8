"""The clock of a source: how far it is from ours, and what is told when it is set."""

from __future__ import annotations

from collections import deque

import pytest

from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.protocols import Notices
from seatrial.acquisition.protocols.clock import SourceClock

SECOND = 1_000_000_000
NOW = 1_790_000_000 * SECOND


def frame(at_s: float) -> Frame:
    return Frame("line", "nmea0183", b"", NOW + int(at_s * SECOND), int(at_s * SECOND))


def told(*announcements: tuple[float, float]) -> list[tuple[str, str]]:
    """What is told of announcements at times [s] of a clock that is so far ahead [s]."""
    notices: Notices = deque()
    clock = SourceClock("source", "GPS", notices)
    for at_s, ahead_s in announcements:
        clock.announce(NOW + int((at_s + ahead_s) * SECOND), frame(at_s))
    return list(notices)


@pytest.mark.parametrize(
    ("ahead_s", "level"), [(0.4, "info"), (-0.4, "info"), (3600.0, "warning"), (-86_400.0, "warning")]
)
def test_how_far_a_clock_is_from_ours_is_told_once(ahead_s: float, level: str) -> None:
    assert told((0, ahead_s), (1, ahead_s), (2, ahead_s)) == [
        (level, f"clock GPS is {ahead_s:+.3f} s from ours; it stamps this source")
    ]


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 5.0])
def test_a_clock_that_is_set_is_told_each_time_with_its_step(step_s: float) -> None:
    steps = told((0, 0.0), (1, step_s), (2, step_s), (3, 0.0))[1:]
    assert steps == [
        ("warning", f"clock GPS was set by {step_s:+.3f} s"),
        ("warning", f"clock GPS was set by {-step_s:+.3f} s"),
    ]


def test_whole_seconds_and_late_lines_are_no_steps() -> None:
    assert len(told(*((0.3 * number, -(0.3 * number % 1.0)) for number in range(50)))) == 1


def test_impossible_times_are_not_compared() -> None:
    assert told((0, -1e9), (1, 1e10)) == []
