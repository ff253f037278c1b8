"""A stop counts from the order: the recorded one, the crew's mark, or the shaft with what that leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from seatrial.analysis.manoeuvres.criteria import FULL_ASTERN
from seatrial.analysis.manoeuvres.find import find_manoeuvres, find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.straight_runs import engine_orders
from seatrial.analysis.tables.table import NANO
from tests.analysis.rudder_ships import Orders, Ship, sail
from tests.benchmarks import yard_trials
from tests.benchmarks.yard_ship import Sailed, YardShip
from tests.benchmarks.yard_trials import START, Recorder, Truth, record

QUIET = Recorder(2.0, 0.02, 0.01, 0.005, 0.003, 0.02, (0.0, 0.0), orders=False)
DEAD_TIMES_S = (0.0, 6.0, 15.0)


@cache
def stopped(dead_s: float) -> tuple[YardShip, Sailed, Truth]:
    """A ship whose engine does nothing for so long after the order."""
    ship = YardShip(120.0, shaft_lag_s=10.0, engine_dead_s=dead_s)
    return (ship, *yard_trials.sail(ship, "stopping", 1.0))


def stop_of(
    dead_s: float, events: Sequence[tuple[float, str]] = (), *, orders: bool = False
) -> tuple[Manoeuvre, Truth]:
    """The stop that is found with these marks, their times in seconds after the order."""
    ship, sailed, truth = stopped(dead_s)
    table = record(ship, sailed, replace(QUIET, orders=orders), seed=1)
    marks = [(START.value + round((truth.orders_s[0] + late_s) * NANO), text) for late_s, text in events]
    (run,) = (run for run in find_manoeuvres(table, 120.0, marks) if run.kind == "stopping")
    return run, truth


def start_s(run: Manoeuvre) -> float:
    return (run.start - START).total_seconds()


@pytest.mark.parametrize("dead_s", DEAD_TIMES_S)
def test_a_recorded_order_counts_however_late_the_shaft_follows(dead_s: float) -> None:
    run, truth = stop_of(dead_s, orders=True)
    assert start_s(run) == pytest.approx(truth.orders_s[0], abs=0.3)
    reach = run.indices["track_reach_m"]
    assert reach.value == pytest.approx(truth.indices["track_reach_m"], abs=5.0)
    assert not any("order" in note for note in run.notes)


@pytest.mark.parametrize("text", ["full astern", "Crash stop", "stop engine", "STOP"])
def test_the_crews_mark_counts_where_no_order_was_recorded(text: str) -> None:
    run, truth = stop_of(15.0, [(0.0, text)])
    assert start_s(run) == pytest.approx(truth.orders_s[0], abs=0.1)
    reach = run.indices["track_reach_m"]
    assert reach.low < truth.indices["track_reach_m"] < reach.high
    assert any(f"mark '{text}'" in note for note in run.notes)


@pytest.mark.parametrize("text", ["crash stop end", "stopwatch", "zigzag stop", "full ahead"])
def test_other_marks_are_no_orders(text: str) -> None:
    run, truth = stop_of(6.0, [(0.0, text)])
    assert start_s(run) == pytest.approx(truth.orders_s[0] + 6.0, abs=1.5)
    assert any("order was not recorded" in note for note in run.notes)


def test_a_mark_long_before_or_after_the_shaft_moved_is_another_order() -> None:
    for late_s in (-120.0, 30.0):
        run, truth = stop_of(0.0, [(late_s, "full astern")])
        assert start_s(run) == pytest.approx(truth.orders_s[0], abs=1.5)


@pytest.mark.parametrize("dead_s", DEAD_TIMES_S[:2])
def test_the_shaft_alone_leaves_open_how_much_earlier_the_order_was(dead_s: float) -> None:
    run, truth = stop_of(dead_s)
    reach, longest = run.indices["track_reach_m"], truth.indices["track_reach_m"]
    assert reach.low < longest < reach.high
    lag_s = run.settings["order_lag_s"]
    assert lag_s >= 6.0
    assert reach.high - reach.value > reach.value - reach.low + 0.9 * lag_s * run.settings["approach_mps"]


@pytest.mark.parametrize("between_rpm", [0.0, 30.0])
def test_an_engine_that_stops_before_it_reverses_is_stopped_from_the_first_order(between_rpm: float) -> None:
    """Between the ship coasts, the shaft still or turned by the water; a ship at a new speed was ordered anew."""
    ship = Ship(speed_time_s=100.0)

    def orders(second_s: float) -> Orders:
        steps = (60.0, 120.0), (second_s, between_rpm), (np.inf, -60.0)
        return lambda time_s, *_: (0.0, next(rpm for end_s, rpm in steps if time_s < end_s))

    table = sail(ship, orders(100.0), 300.0)
    (run,) = (run for run in find_manoeuvres(table, 100.0) if run.kind == "stopping")
    assert run.name == FULL_ASTERN
    assert (run.start - table.index[0]).total_seconds() == pytest.approx(60.0, abs=0.5)
    assert any("pause" in note for note in run.notes)
    way_m = np.hypot(*np.diff(table.loc[run.start : run.end, ["north_m", "east_m"]].iloc[[0, -1]], axis=0)[0])
    assert run.indices["track_reach_m"].value == pytest.approx(way_m, abs=5.0)

    later = [run for run in find_manoeuvres(sail(ship, orders(400.0), 600.0), 100.0) if run.kind == "stopping"]
    assert all(run.start > table.index[0] + pd.Timedelta(seconds=300) or run.name != FULL_ASTERN for run in later)


def test_a_stop_that_the_recording_does_not_hold_to_its_end_is_left_out_for_that() -> None:
    table = sail(Ship(speed_time_s=100.0), lambda time_s, *_: (0.0, 120.0 if time_s < 60.0 else 0.0), 200.0)
    left_out = find_manoeuvres_and_left_out(table, 100.0)[1]
    (stop,) = (candidate for candidate in left_out if candidate.kind == "stopping")
    assert stop.why.endswith("when the recording ended")


def test_a_shaft_that_counts_astern_is_the_reason_why_there_is_no_stop() -> None:
    table = sail(Ship(speed_time_s=100.0), lambda time_s, *_: (0.0, 120.0 if time_s < 100.0 else -60.0), 400.0)
    runs, left_out = find_manoeuvres_and_left_out(table.assign(propeller_rpm=-table["propeller_rpm"]), 100.0)
    assert not any(run.kind == "stopping" for run in runs)
    assert "propeller_rpm counts astern" in left_out[0].why
    assert not any("astern" in candidate.why for candidate in find_manoeuvres_and_left_out(table, 100.0)[1])


def test_orders_that_come_after_the_shaft_show_nothing() -> None:
    ship, sailed, truth = stopped(0.0)
    late = np.append(np.full(400, sailed.rpm_order[0]), sailed.rpm_order)[: sailed.rpm_order.size]
    table = record(ship, replace(sailed, rpm_order=late), replace(QUIET, orders=True), seed=1)
    (run,) = (run for run in find_manoeuvres(table, 120.0) if run.kind == "stopping")
    assert start_s(run) == pytest.approx(truth.orders_s[0], abs=1.5)
    assert run.shortfalls == ("the recorded orders do not precede the shaft",)


def test_marks_of_a_recording_become_times_of_its_motion() -> None:
    from seatrial.analysis.manoeuvres.motion import motion_of

    ship, sailed, _ = stopped(0.0)
    motion = motion_of(record(ship, sailed, QUIET, seed=1))
    at = motion.origin_ns + 30 * NANO
    orders = engine_orders(motion, [(at, " full astern "), (at, "coffee")])
    assert orders == [(pytest.approx(30.0), "full astern")]
    assert pd.Timestamp(motion.origin_ns, tz="UTC") >= START
