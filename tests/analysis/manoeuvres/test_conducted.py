"""Runs of a conducted programme: their marks are read as they were written, and valid ones alone count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as draw

from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.conducted import (
    BETWEEN_RUNS,
    ConductedRun,
    JudgedSpan,
    conducted_runs,
    exclude_uncounted,
)
from seatrial.analysis.manoeuvres.find import find_manoeuvres, pair_event_marks
from seatrial.analysis.manoeuvres.indices import Manoeuvre, index_from_value

START = pd.Timestamp("2026-06-01T08:00:00Z")
WORDS = draw.sampled_from(
    [
        "the helm was 26.1 deg, not 35 deg",
        "the wind was above force 5: force 8 in a minute's mean",
        "it went to port",
    ]
)
NAMES = draw.sampled_from(
    ["zigzag 10/10 to port", "turning circle 35 deg to starboard", "stopping with thrust astern"]
)


def at(minute: float) -> pd.Timestamp:
    return START + pd.Timedelta(minutes=minute)


def circle(minute: float, side: str = "port", helm_deg: float = 35.0, diameter_m: float = 600.0) -> Manoeuvre:
    settings = {"rudder_deg": helm_deg, "approach_mps": 7.0, "approach_heading_deg": 0.0}
    index = index_from_value("tactical_diameter_m", diameter_m, 5.0, 200.0, "turning_circle")
    return Manoeuvre("turning_circle", "turning circle 35 deg", at(minute), at(minute + 8.0), side, settings,
                     {"tactical_diameter_m": index})  # fmt: skip


def run_of(number: int, minute: float, outcome: str, *reasons: str) -> ConductedRun:
    """A circle of ten minutes that was ordered at a minute; with a part of the recording unless it was aborted."""
    judged = JudgedSpan("turning_circle", at(minute - 1.0), at(minute + 10.4)) if outcome != "aborted" else None
    return ConductedRun(number, "turning circle 35 deg to port", outcome, at(minute), at(minute + 10.0), judged,
                        reasons, marked=(at(minute), at(minute + 10.5)))  # fmt: skip


@given(
    outcomes=draw.lists(draw.sampled_from(["valid", "invalid", "aborted", "skipped"]), max_size=4),
    names=draw.lists(NAMES, min_size=4, max_size=4), reasons=draw.lists(WORDS, max_size=3, unique=True),
    notes=draw.lists(draw.sampled_from(["tug alongside", "start of rain", "over: at last"]), max_size=2),
    late_ms=draw.integers(0, 90_000),
)  # fmt: skip
def test_marks_are_read_as_they_were_written(
    outcomes: list[str], names: list[str], reasons: list[str], notes: list[str], late_ms: int
) -> None:
    """However late a recorder takes a mark, the times are those that it states."""
    runs, events, time_ns = list[ConductedRun](), list[tuple[int, str]](), START.value
    for number, (outcome, name) in enumerate(zip(outcomes, names, strict=False), 1):
        ordered = pd.Timestamp(time_ns, unit="ns", tz="UTC") if outcome != "skipped" else None
        over = ordered + pd.Timedelta(minutes=8, milliseconds=7) if ordered is not None else None
        judged = JudgedSpan("zigzag", ordered, over) if ordered is not None and outcome != "aborted" else None
        why = () if outcome in ("valid", "skipped") else tuple(reasons)
        run = ConductedRun(number, name, outcome, ordered, None if judged else over, judged, why, tuple(notes))
        texts = [f"run {number}: note: {note}" for note in notes]
        texts += [f"run {number}: {name} ordered, approach 5.00 m/s", f"run {number}: over"] if ordered else []
        events.append((time_ns + 1, "coffee"))
        for text in [*texts, run.mark()]:
            time_ns += (1 + late_ms) * 1_000_000
            events.append((time_ns, text))
        time_ns += 600_000_000_000
        runs.append(run)
    assert [replace(run, marked=None) for run in conducted_runs(reversed(events))] == runs
    assert pair_event_marks(events) == () or "start of rain" in notes


def test_marks_without_names_and_times_are_read_too() -> None:
    span = f"from {at(0.0).isoformat()} to {at(9.0).isoformat()}"
    (run,) = conducted_runs([(at(1.0).value, "run 2: zigzag 20/20 ordered, approach 5.4 m/s, wind 6.0 m/s from 76"),
                             (at(9.5).value, f"run 2: valid, judged as zigzag {span}")])  # fmt: skip
    assert (run.name, run.outcome, run.ordered) == ("zigzag 20/20", "valid", at(1.0))
    assert run.judged == JudgedSpan("zigzag", at(0.0), at(9.0))
    assert conducted_runs([(0, "zigzag start"), (1, "run 3 was long"), (2, "run 3: fast")]) == ()


@pytest.mark.parametrize("hours", [-1.0, 2.0, 490_000.0])
@pytest.mark.parametrize("outcome", ["valid", "aborted"])
def test_times_in_words_are_those_of_the_recording_where_its_clock_was_set_later(
    hours: float, outcome: str
) -> None:
    """The recording's times, and its marks', are then by the newer clock. Marks that the recorder took late are not
    such: they came together."""
    run = run_of(3, 20.0, outcome)
    assert run.ordered is not None
    assert run.over is not None
    texts = [f"run 3: {run.name} ordered, approach 5.00 m/s", "run 3: over", run.mark()]
    taken = [run.ordered + pd.Timedelta(seconds=4.0), run.over + pd.Timedelta(seconds=1.0), at(30.5)]
    set_by = pd.Timedelta(hours=hours)
    (read,) = conducted_runs([((time + set_by).value, text) for time, text in zip(taken, texts, strict=True)])
    assert read.ordered is not None
    assert abs(read.ordered - run.ordered - set_by).total_seconds() < 5.0
    assert (exclude_uncounted([circle(20.1 + 60.0 * hours)], (read,))[0].not_counted == "") == (outcome == "valid")
    late = [at(90.0), at(90.0) + pd.Timedelta(seconds=2.0), at(90.0) + pd.Timedelta(seconds=4.0)]
    (read,) = conducted_runs([(time.value, text) for time, text in zip(late, texts, strict=True)])
    assert read.ordered == run.ordered


def test_valid_runs_alone_count_and_others_say_why() -> None:
    """An aborted circle, an invalid one, a circle between two runs; what was sailed before and after counts."""
    runs = (
        run_of(1, 20.0, "aborted"),
        run_of(2, 40.0, "invalid", "it went to port", "the wind was of force 8, above 5"),
        run_of(3, 80.0, "valid"),
    )  # fmt: skip
    found = [circle(minute) for minute in (0.0, 20.1, 39.9, 60.0, 80.1, 85.0, 120.0)]
    assert [run.not_counted for run in exclude_uncounted(found, runs)] == [
        "", "run 1 was aborted", "run 2 was invalid: it went to port; the wind was of force 8, above 5",
        BETWEEN_RUNS, "", BETWEEN_RUNS, "",
    ]  # fmt: skip
    assert exclude_uncounted(exclude_uncounted(found, runs), ()) == found


def test_run_that_ended_in_another_recording_does_not_count_in_the_one_it_began_in() -> None:
    ordered = ConductedRun(4, "turning circle 35 deg to port", ordered=at(20.0), marked=(at(20.0), at(20.0)))
    (found,) = exclude_uncounted([circle(20.1)], (ordered,), (run_of(4, 20.0, "invalid", "it went to port"),))
    assert found.not_counted == "run 4 was invalid: it went to port"
    for unjudged in (ordered, replace(ordered, over=at(28.0))):
        assert exclude_uncounted([circle(20.1)], (unjudged,)) == [circle(20.1)]  # nobody called it invalid


def test_two_programmes_of_one_recording_leave_what_was_sailed_between_them() -> None:
    runs = (run_of(1, 20.0, "valid"), run_of(1, 80.0, "valid"))
    found = exclude_uncounted([circle(minute) for minute in (20.1, 50.0, 80.1)], runs)
    assert [run.not_counted for run in found] == ["", "", ""]


@pytest.mark.parametrize("diameter_m", [300.0, 900.0])
def test_what_does_not_count_changes_no_criterion(diameter_m: float) -> None:
    """Nor does its helm decide which circle is the turning test."""
    valid = [circle(0.0, "port", 30.0), circle(20.0, "starboard", 30.0)]
    invalid = replace(circle(40.0, "port", 45.0, diameter_m), not_counted="run 3 was invalid")
    results = [criteria.criterion_results(criteria.index_rows(runs)) for runs in (valid, [*valid, invalid])]
    assert results[0] == results[1]
    assert criteria.largest_helm_deg([*valid, invalid]) == 30.0
    assert Manoeuvre.from_json(invalid.as_json()) == invalid


def test_note_of_the_bridge_names_no_manoeuvre() -> None:
    """A start in a note of a run would begin a manoeuvre of the crew's."""
    time = pd.date_range(START, periods=600, freq="1s", name="time")
    turned = np.clip(np.arange(600.0) - 120.0, 0.0, 480.0) * 1.0
    heading = np.deg2rad(turned)
    table = pd.DataFrame(
        {"north_m": np.cumsum(5.0 * np.cos(heading)), "east_m": np.cumsum(5.0 * np.sin(heading)),
         "heading_deg": turned % 360.0, "rudder_angle_deg": np.where(turned > 0.0, 20.0, 0.0)}, time)  # fmt: skip
    events = [(at(1.0).value, "run 1: note: start turn by hand"), (at(9.0).value, "run 1: note: finished")]
    (noted,), (plain,) = find_manoeuvres(table, 50.0, events), find_manoeuvres(table, 50.0)
    assert noted == plain
