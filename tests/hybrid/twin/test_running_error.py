"""The running error against what is worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import DEFAULT, wrap_180
from seatrial.hybrid.calibrators.predict import Prediction
from seatrial.hybrid.twin import (
    FILTER_REACH_S,
    RegionFactor,
    RunningError,
    Statistics,
    follows_plan,
    track_error,
    watch_summary,
)
from tests.hybrid.twin.steady_ship import HEADING_DEG, SPEED_MPS, START, steady_table

HORIZON_S = 10
NANO = 1_000_000_000
HEADING = np.deg2rad(HEADING_DEG)


def prediction(
    second: int, ahead_m: float = 0.0, starboard_m: float = 0.0, turn_deg: float = 0.0, band_m: float | None = None
) -> Prediction:
    """The steady ship's own track from a second on, off by so much more every second."""
    seconds = np.arange(HORIZON_S + 1.0)
    along = SPEED_MPS * (second + seconds) + ahead_m * seconds
    across = starboard_m * seconds
    track = np.column_stack([
        along * np.cos(HEADING) - across * np.sin(HEADING),
        along * np.sin(HEADING) + across * np.cos(HEADING),
        HEADING + np.deg2rad(turn_deg) * seconds,
    ])  # fmt: skip
    region_m = None if band_m is None else np.full((HORIZON_S + 1, 2), band_m)
    return Prediction(START + pd.Timedelta(seconds=second), "reference", track, region_m, None)


@pytest.fixture
def table() -> pd.DataFrame:
    return steady_table(120.0, 1.0)


def ns(second: float) -> int:
    return START.as_unit("ns").value + round(second * NANO)


def test_an_error_is_told_along_and_across_and_on_the_way(table: pd.DataFrame) -> None:
    """Off by 0.3 m ahead and 0.4 m to starboard a second: 0.5 m, 1.0 m .. 5.0 m."""
    errors = RunningError()
    errors.add(prediction(20, 0.3, 0.4, -2.0, band_m=2.6))
    (error,) = errors.evaluate(table, ns(60))
    assert error.start_ns == ns(20)
    assert not error.thrusters_moved
    assert error.end_distance_m == pytest.approx(5.0)
    assert error.mean_distance_m == pytest.approx(2.75)
    assert error.along_m == pytest.approx(3.0)
    assert error.across_m == pytest.approx(4.0)
    assert error.heading_deg == pytest.approx(11.0)
    assert error.inside_band == pytest.approx(0.5)
    assert error.as_dict()["start"] == START.timestamp() + 20


def test_a_heading_through_north_is_no_error() -> None:
    measured = prediction(0).track.copy()
    measured[:, 2] += 2.0 * np.pi
    assert track_error(prediction(0), measured, False).heading_deg == pytest.approx(0.0, abs=1e-9)


def test_a_prediction_is_judged_as_soon_as_its_end_is_settled_and_not_before(table: pd.DataFrame) -> None:
    errors = RunningError()
    for second in (20, 21, 22):
        errors.add(prediction(second, 0.1))
    assert errors.evaluate(table, ns(20 + HORIZON_S + FILTER_REACH_S) - 1) == []
    assert [each.start_ns for each in errors.evaluate(table, ns(21 + HORIZON_S + FILTER_REACH_S))] == [
        ns(20),
        ns(21),
    ]
    assert errors.mean().predictions == 2
    assert [each.start_ns for each in errors.evaluate(table, ns(100))] == [ns(22)]


@pytest.mark.parametrize(
    ("name", "value"), [("port_rpm", 150.0), ("starboard_angle_deg", 8.0), ("tunnel_rpm", 60.0)]
)
def test_a_thruster_that_moved_in_the_horizon_is_counted_and_left_out(
    table: pd.DataFrame, name: str, value: float
) -> None:
    """One that moves at second 50: the horizons that hold the step, and no others."""
    table.loc[table.index >= START + pd.Timedelta(seconds=50), name] = value
    errors = RunningError()
    for second in range(30, 60):
        errors.add(prediction(second, 0.1 if second < 40 or second >= 50 else 5.0))
    found = errors.evaluate(table, ns(100))
    moved = [each.start_ns for each in found if each.thrusters_moved]
    assert moved == [ns(second) for second in range(40, 50)]
    mean = errors.mean()
    assert (mean.predictions, mean.left_out) == (20, 10)
    assert mean.end_distance_m == pytest.approx(1.0)


def test_a_prediction_across_a_jump_of_the_receiver_is_not_judged(table: pd.DataFrame) -> None:
    """From second 50 on the positions are 20 m to the north: what lies across that is no error of a prediction."""
    table.loc[table.index >= START + pd.Timedelta(seconds=50), "north_m"] += 20.0
    errors, starts = RunningError(), (20, 45, 60)
    for second in starts:
        errors.add(prediction(second))
    found = errors.evaluate(table, ns(100))
    assert [each.start_ns for each in found] == [ns(20), ns(60)]
    assert errors.unmeasured == 1


def after_a_lag(orders: Floats, lag_s: float) -> Floats:
    """What a drive with such a lag makes of orders, one a second, that begins at the first."""
    done = orders.copy()
    for second in range(1, len(done)):
        done[second] = orders[second] + (done[second - 1] - orders[second]) * np.exp(-1.0 / lag_s)
    return done


@pytest.mark.parametrize(
    ("name", "before", "after", "other"),
    [("port_angle_deg", 170.0, -170.0, 160.0), ("port_rpm", 140.0, 60.0, 75.0), ("tunnel_rpm", 0.0, 300.0, 200.0)],
)
def test_what_was_done_is_what_was_planned(name: str, before: float, after: float, other: float) -> None:
    """A step on the tenth second: done by a drive with a lag of 1 s and noise; not done, done half, done late."""
    seconds = np.arange(60)
    noise = 0.2 * np.random.default_rng(1).standard_normal(60)
    step = before + np.where(seconds >= 30, wrap_180(after - before), 0.0)
    planned = step[20:50]

    def judge(values: Floats) -> bool:
        wrapped = wrap_180(values) if name.endswith("_deg") else values
        return follows_plan(name, np.asarray(wrapped + noise), 20, planned, DEFAULT)

    assert judge(after_a_lag(step, 1.0))
    assert judge(np.interp(seconds, [29, 32], [before, step[-1]]))
    assert not judge(np.full(60, before))
    assert not judge(before + (step - before) * (other - before) / wrap_180(after - before))
    assert not judge(np.roll(step, 8))
    assert not judge(np.full(60, step[-1]))


@pytest.mark.parametrize("name", ["port_angle_deg", "starboard_rpm"])
def test_a_plan_that_is_what_was_done_is_carried_out_however_restless(name: str) -> None:
    """Settings that wander all the time, pods all the way round; a plan of 15 s before is not."""
    values = np.cumsum(np.random.default_rng(2).normal(0.0, 12.0, 90))
    values = wrap_180(values) if name.endswith("_deg") else values
    step = np.diff(values)
    means = values[:-1] + 0.5 * (wrap_180(step) if name.endswith("_deg") else step)
    assert follows_plan(name, values, 30, means[30:60], DEFAULT)
    assert not follows_plan(name, values, 45, means[30:60], DEFAULT)


def test_a_prediction_with_a_plan_is_judged_where_it_was_done(table: pd.DataFrame) -> None:
    """The helm is put over at second 50: who knew is judged, who did not, or expected more, is not. The last second
    of a horizon, which the filter blurs, does not count.
    """
    table.loc[table.index >= START + pd.Timedelta(seconds=50), "port_angle_deg"] = 8.0
    errors = RunningError()
    for second in (40, 49):
        for degrees in (None, 8.0, 20.0):
            planned = {} if degrees is None else {
                "port_angle_deg": np.where(np.arange(HORIZON_S) + second >= 50, degrees, 0.0)
            }  # fmt: skip
            errors.add(replace(prediction(second), planned=planned))
    moved = [each.thrusters_moved for each in errors.evaluate(table, ns(100))]
    assert moved == [True, False, False, True, False, True]
    table["tunnel_rpm"] = np.where(np.arange(len(table)) > 45, 100.0, 0.0)
    errors.add(replace(prediction(41), planned={"port_angle_deg": np.where(np.arange(HORIZON_S) >= 9, 8.0, 0.0)}))
    assert errors.evaluate(table, ns(100))[0].thrusters_moved, "what is not planned is held"


def test_means_are_over_the_last_minutes(table: pd.DataFrame) -> None:
    errors = RunningError(over_s=30.0)
    for second in range(10, 71):
        errors.add(prediction(second, 1.0 if second < 41 else -0.1, 0.2, band_m=1.0 if second < 56 else 100.0))
    errors.evaluate(table, ns(110))
    mean = errors.mean()
    assert mean.predictions == 31  # those of the seconds 40 to 70
    assert mean.along_m == pytest.approx((10.0 - 30 * 1.0) / 31)
    assert mean.across_m == pytest.approx(2.0)
    inside = [0.0] + [0.4] * 15 + [1.0] * 15  # 0.22 m a second more
    assert mean.inside_band == pytest.approx(np.mean(inside))


@pytest.mark.parametrize("name", ["north_m", "heading_deg", "port_rpm"])
def test_what_was_not_measured_is_not_judged(table: pd.DataFrame, name: str) -> None:
    table.loc[START + pd.Timedelta(seconds=25), name] = np.nan
    errors = RunningError()
    errors.add(prediction(20))
    errors.add(prediction(30))
    assert [each.start_ns for each in errors.evaluate(table, ns(60))] == [ns(30)]
    assert errors.unmeasured == 1


def test_what_lies_before_the_table_or_in_another_recording_is_not_judged(table: pd.DataFrame) -> None:
    errors = RunningError()
    errors.add(prediction(-5))
    errors.add(prediction(70))
    assert errors.evaluate(table, ns(60)) == []
    assert errors.unmeasured == 1
    errors.clear()
    assert errors.evaluate(table, ns(119)) == []
    assert errors.unmeasured == 2


def test_nothing_judged_has_no_mean() -> None:
    mean = RunningError().mean()
    assert (mean.predictions, mean.left_out, mean.mean_distance_m, mean.inside_band) == (0, 0, None, None)


def test_a_summary_counts_all_and_means_what_was_held(table: pd.DataFrame) -> None:
    table.loc[table.index >= START + pd.Timedelta(seconds=50), "tunnel_rpm"] = 100.0
    errors, statistics = RunningError(over_s=5.0), Statistics(made=30, recorded=29)
    for second in range(30, 60):
        errors.add(prediction(second, 0.1, band_m=0.55))
    for error in errors.evaluate(table, ns(100)):
        statistics.errors = statistics.errors.with_error(error)
    statistics.latency_s.extend([0.1] * 90 + [0.5] * 10)
    summary = watch_summary(statistics, errors.unmeasured, RegionFactor(1.5))
    assert (summary.made, summary.recorded, summary.judged, summary.left_out) == (30, 29, 20, 10)
    assert summary.end_distance_m == pytest.approx(1.0)
    assert summary.inside_band == pytest.approx(0.5)
    assert (summary.latency_median_s, summary.latency_95_s, summary.latency_max_s) == pytest.approx((0.1, 0.5, 0.5))
    assert "20 judged, 10 left out" in str(summary)
    assert "0.55 m off on the way" in str(summary)
    assert "band 1.5 times as wide as the calibrator's" in str(summary)
    assert watch_summary(Statistics(), 0, RegionFactor()).mean_distance_m is None
