"""The current of a circle is taken off the runs of the same recording that have none of their own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.find import (
    Observation,
    RecordedRuns,
    current_at_time,
    find_manoeuvres,
    share_currents_of_trial,
)
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from tests.benchmarks.yard_ship import Sailed, YardShip
from tests.benchmarks.yard_trials import Recorder, record, sail

QUIET = Recorder(1.0, 0.1, 0.02, 0.01, 0.01, 0.05, (0.0, 0.0), orders=True)
SHIP = YardShip(120.0, current_mps=0.6, current_to_deg=50.0)
NOON = pd.Timestamp("2026-06-01T12:00:00Z")


def flow(ship: YardShip) -> tuple[float, float]:
    to = np.deg2rad(ship.current_to_deg)
    return float(ship.current_mps * np.cos(to)), float(ship.current_mps * np.sin(to))


@cache
def sailed(test: str) -> tuple[Sailed, float]:
    run, truth = sail(SHIP, test, 1.0)
    return run, truth.orders_s[0]


def reach_in_water_m(run: Sailed, order_s: float) -> float:
    """How far the ship went through the water from the order until she had stopped in it."""
    north, east = (
        place - each * run.time_s for place, each in zip((run.north_m, run.east_m), flow(SHIP), strict=True)
    )
    inside = (run.time_s >= order_s) & (run.ahead_mps > 0.0)
    return float(np.sum(np.hypot(np.diff(north[inside]), np.diff(east[inside]))))


def trial(*tests: str, apart_s: float) -> pd.DataFrame:
    """The tests in one recording, each so long after the beginning of the one before."""
    tables = [record(SHIP, sailed(test)[0], QUIET, seed) for seed, test in enumerate(tests)]
    moved = [
        table.set_axis(table.index + pd.Timedelta(number * apart_s, "s")) for number, table in enumerate(tables)
    ]
    joined = pd.concat(moved)
    joined.index.name = "time"
    joined.attrs = tables[0].attrs
    return joined


def stop_in(table: pd.DataFrame) -> Manoeuvre:
    (run,) = (run for run in find_manoeuvres(table, 120.0) if run.kind == "stopping")
    return run


def test_a_stop_is_that_in_the_water_by_the_current_of_a_circle() -> None:
    run = stop_in(trial("turning_circle", "stopping", apart_s=3600.0))
    truth = reach_in_water_m(*sailed("stopping"))
    removed, measured = run.indices["track_reach_m_current_removed"], run.indices["track_reach_m"]
    assert removed.low < truth < removed.high
    assert abs(removed.value - truth) < 0.3 * abs(measured.value - truth)
    assert removed.counted_from == "order"
    assert run.current is not None
    assert (run.current.north_mps, run.current.east_mps) == pytest.approx(flow(SHIP), abs=0.03)
    assert any("of other runs" in note for note in run.notes)


def test_the_interval_grows_with_the_time_between() -> None:
    widths = []
    for apart_s in (2400.0, 5400.0):
        index = stop_in(trial("turning_circle", "stopping", apart_s=apart_s)).indices[
            "track_reach_m_current_removed"
        ]
        widths.append(index.high - index.low)
    assert widths[0] < widths[1]


def test_without_a_circle_within_two_hours_nothing_is_removed() -> None:
    for table in (trial("stopping", apart_s=0.0), trial("turning_circle", "stopping", apart_s=3.5 * 3600.0)):
        run = stop_in(table)
        assert run.current is None
        assert "track_reach_m_current_removed" not in run.indices


def seen(direction_deg: float, along_mps: float, within_mps: float = 0.02, late_s: float = 0.0) -> Observation:
    angle = np.deg2rad(direction_deg)
    return Observation(
        NOON + pd.Timedelta(late_s, "s"), (float(np.cos(angle)), float(np.sin(angle))), along_mps, within_mps
    )


@given(
    north=st.floats(-1.0, 1.0), east=st.floats(-1.0, 1.0), first_deg=st.floats(0.0, 360.0),
    apart_deg=st.floats(35.0, 145.0),
)  # fmt: skip
def test_two_courses_across_give_the_current(north: float, east: float, first_deg: float, apart_deg: float) -> None:
    def along(direction_deg: float) -> float:
        angle = np.deg2rad(direction_deg)
        return float(north * np.cos(angle) + east * np.sin(angle))

    both = [seen(angle, along(angle)) for angle in (first_deg, first_deg + apart_deg)]
    current = current_at_time(NOON, both)
    assert current is not None
    assert (current.north_mps, current.east_mps) == pytest.approx((north, east), abs=1e-6)
    assert min(current.north_within_mps, current.east_within_mps) > 0.01


@pytest.mark.parametrize("observations", [
    [], [seen(0.0, 0.5)], [seen(0.0, 0.5), seen(180.0, -0.5)], [seen(0.0, 0.5), seen(20.0, 0.5)],
    [seen(0.0, 0.5), seen(90.0, 0.1, late_s=9000.0)], [seen(0.0, 0.5), seen(90.0, 0.1, float("nan"))],
])  # fmt: skip
def test_one_direction_late_or_unknown_gives_no_current(observations: list[Observation]) -> None:
    assert current_at_time(NOON, observations) is None


def test_what_was_observed_longer_ago_counts_less() -> None:
    fresh = [seen(angle, along) for angle, along in ((0.0, 0.5), (90.0, 0.0))]
    old = [replace_time(each, 6000.0, 0.3) for each in fresh]
    current = current_at_time(NOON, [*fresh, *old])
    assert current is not None
    assert current.north_mps > 0.45


def replace_time(observation: Observation, late_s: float, along_mps: float) -> Observation:
    return observation._replace(time=observation.time + pd.Timedelta(late_s, "s"), along_mps=along_mps)


def test_a_circle_of_less_than_its_own_current_is_corrected_as_well() -> None:
    short, _ = sailed("turning_circle")
    part = int(np.argmax(np.abs(short.heading_deg) > 400.0))

    def cut(values: Floats) -> Floats:
        return values[:part]

    brief = Sailed(*(cut(getattr(short, name)) for name in Sailed.__slots__))
    tables = [record(SHIP, short, QUIET, 1), record(SHIP, brief, QUIET, 2)]
    tables[1].index += pd.Timedelta(3600, "s")
    joined = pd.concat(tables)
    joined.attrs = tables[0].attrs
    whole, shorter = (run for run in find_manoeuvres(joined, 120.0) if run.kind == "turning_circle")
    assert (whole.current is None, shorter.current is None) == (False, False)
    for name in ("advance_m", "tactical_diameter_m"):
        one, other = (run.indices[f"{name}_current_removed"] for run in (whole, shorter))
        assert abs(one.value - other.value) < 0.5 * (one.high - one.low + other.high - other.low)
        assert abs(one.value - other.value) < abs(shorter.indices[name].value - one.value)
    assert replace(whole, notes=()) != replace(shorter, notes=())


def recorded_runs(table: pd.DataFrame) -> RecordedRuns:
    return RecordedRuns(table, find_manoeuvres(table, 120.0), Conditions(length_m=120.0))


def test_current_of_a_circle_counts_for_the_other_recordings_of_the_trial() -> None:
    """A yard records each run by itself: a stop half an hour after the circle loses the current, and is judged with
    it; what is judged once more stays as it is."""
    circle, stop = (record(SHIP, sailed(test)[0], QUIET, 0) for test in ("turning_circle", "stopping"))
    stop = stop.set_axis(stop.index + pd.Timedelta("30min"))
    recorded = [recorded_runs(table) for table in (circle, stop)]
    alone, together = recorded[1].runs, share_currents_of_trial(recorded)[1]
    assert [run for run in alone if run.current] == []
    (run,) = (run for run in together if run.kind == "stopping")
    index = run.indices["track_reach_m_current_removed"]
    assert index.low <= reach_in_water_m(*sailed("stopping")) <= index.high
    assert "the current is not known" not in index.missing
    again = share_currents_of_trial([recorded[0], recorded[1]._replace(runs=together)])
    assert again[1] == together


def test_current_of_yesterday_says_nothing_of_today() -> None:
    circle, stop = (record(SHIP, sailed(test)[0], QUIET, 0) for test in ("turning_circle", "stopping"))
    stop = stop.set_axis(stop.index + pd.Timedelta("1D"))
    recorded = [recorded_runs(table) for table in (circle, stop)]
    assert share_currents_of_trial(recorded)[1] == recorded[1].runs
