"""Raw tables to the log: means against the samples themselves, at any rate, through north, gaps and outliers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson, quad

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import COMMAND, ENVIRONMENT, POSE, VELOCITY, wrap_360
from seatrial.analysis.estimation.motion_model import NoiseLevels
from seatrial.analysis.estimation.smoother import smooth
from seatrial.hybrid.diagnosis import log as log_module
from seatrial.hybrid.diagnosis.log import BLOCK_S, LEG_S, Log, _insert_ramp_corners, log_of
from seatrial.hybrid.vessel.sensors import states_as_table

START_S = 1_800_000_000
MOTION = (*POSE, *VELOCITY)
ERRORS = np.array([0.03, 0.03, 0.001, 0.02, 0.02, 0.0005])
FINE_S = 0.01


def motion_at(times_s: Floats, heading_rad: float = 6.2) -> Floats:
    """A ship that swings about a heading near north, speeds up and slows down: states [n, 6]."""
    fine = np.arange(0.0, times_s.max() + 2.0 * FINE_S, FINE_S)
    psi = heading_rad + 0.3 * np.sin(fine / 15.0) + 0.001 * fine
    u, v = 4.0 + 0.4 * np.sin(fine / 20.0), 0.15 * np.cos(fine / 12.0)
    north = cumulative_simpson(u * np.cos(psi) - v * np.sin(psi), dx=FINE_S, initial=0.0)
    east = cumulative_simpson(u * np.sin(psi) + v * np.cos(psi), dx=FINE_S, initial=0.0)
    states = np.column_stack([north, east, psi, u, v, 0.02 * np.cos(fine / 15.0) + 0.001])
    return np.column_stack([np.interp(times_s, fine, column) for column in states.T])


def controls_at(times_s: Floats) -> Floats:
    """Shafts that ramp, azimuths that swing, one of them through astern; a tunnel that steps on: [n, 5]."""
    port, starboard = 2.5 + 0.5 * np.sin(times_s / 25.0), 2.4 + 0.3 * np.cos(times_s / 18.0)
    tunnel = np.where(times_s > 70.0, 300.0, 0.0)
    return np.column_stack(
        [port, 0.3 * np.sin(times_s / 9.0), starboard, np.pi + 0.2 * np.sin(times_s / 11.0), tunnel]
    )


def a_table(times_s: Floats, start_s: int = START_S, errors: float = 1.0, seed: int = 1) -> pd.DataFrame:
    """That ship as recorded at these times after the start, wind 8 m/s from about north."""
    noise = errors * ERRORS * np.random.default_rng(seed).standard_normal((len(times_s), 6))
    wind = np.column_stack([0.1 * np.sin(times_s / 30.0), 8.0 + np.cos(times_s / 7.0)])
    stamps = start_s * 1_000_000_000 + np.round(times_s * 1e9).astype(np.int64)
    index = pd.DatetimeIndex(stamps.astype("datetime64[ns]"), name="time").tz_localize("UTC")
    return states_as_table(motion_at(times_s) + noise, controls_at(times_s), wind, index)


def every(rate_hz: float, duration_s: float = 200.0) -> Floats:
    """Times at a steady rate."""
    return np.arange(round(duration_s * rate_hz)) / rate_hz


def irregular(duration_s: float = 200.0) -> Floats:
    """Times with steps of any size about a quarter of a second, none of them round."""
    steps = np.random.default_rng(2).uniform(0.05, 0.45, round(4.0 * duration_s))
    times = np.cumsum(steps)
    return np.asarray(times[times < duration_s])


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """The smoother told the noise, which it would search for each time: that is tested where it is done."""
    known = NoiseLevels(0.03, 0.001, 0.02, 0.0005, jerk=0.01, yaw_jerk=0.001)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_module, "smooth", partial(smooth, levels=known, engine="compiled"))
        yield


SAMPLED = {"1 Hz": every(1.0), "2 Hz": every(2.0), "10 Hz": every(10.0), "irregular": irregular()}


@pytest.mark.parametrize("sampling", SAMPLED)
def test_measured_is_the_mean_of_the_samples_about_each_second(sampling: str) -> None:
    times_s = SAMPLED[sampling]
    table = a_table(times_s)
    log = log_of([table])
    assert len(log) > 190
    assert log.refused == 0
    values = table[list(MOTION)].to_numpy() * [1.0, 1.0, np.pi / 180.0, 1.0, 1.0, np.pi / 180.0]
    values[:, 2] = np.unwrap(values[:, 2])
    for row, second in enumerate(log.time_s - START_S):
        near = (times_s >= second - 0.5) & (times_s < second + 0.5)
        if not near.any():
            assert np.isnan(log.measured[row]).all()
            continue
        expected = values[near].mean(axis=0)
        off = log.measured[row] - expected
        off[2] -= 2.0 * np.pi * round(off[2] / (2.0 * np.pi))
        np.testing.assert_allclose(off, 0.0, atol=1e-6)


@pytest.mark.parametrize("sampling", SAMPLED)
def test_weights_say_when_the_samples_were(sampling: str) -> None:
    """Quarters of the true motion under the weights are its mean at the samples' times."""
    times_s = SAMPLED[sampling]
    log = log_of([a_table(times_s)])
    there = np.isfinite(log.measured)
    np.testing.assert_allclose(log.weight.sum(axis=2), there.astype(float), atol=1e-12)
    seconds = (log.time_s - START_S).astype(float)
    quarters = motion_at(np.maximum(seconds[:, None] + np.arange(-2, 3) / 4.0, 0.0).ravel()).reshape(-1, 5, 6)
    states, nearest = motion_at(times_s), np.floor(times_s + 0.5)
    for row in np.flatnonzero(there.all(axis=1) & (seconds > 1.0) & (seconds < 198.0)):
        mean = states[nearest == seconds[row]].mean(axis=0)
        np.testing.assert_allclose(np.einsum("cq,qc->c", log.weight[row], quarters[row]), mean, atol=1e-3)


@pytest.mark.parametrize("sampling", ["2 Hz", "10 Hz", "irregular"])
def test_the_nominal_motion_is_near_the_true_one(sampling: str) -> None:
    log = log_of([a_table(SAMPLED[sampling])])
    off = log.nominal - motion_at((log.time_s - START_S).astype(float))
    off[:, 2] -= 2.0 * np.pi * np.round(off[:, 2] / (2.0 * np.pi))
    assert (np.sqrt((off**2).mean(axis=0)) < ERRORS).all()
    assert np.abs(np.diff(log.nominal[:, 2])).max() < 0.1  # through north without a jump
    assert (np.diff(np.sign(np.sin(log.nominal[:, 2]))) != 0.0).any()


@pytest.mark.parametrize("sampling", ["2 Hz", "10 Hz", "irregular"])
def test_settings_are_means_over_quarters_of_a_second(sampling: str) -> None:
    log = log_of([a_table(SAMPLED[sampling])])
    second = np.flatnonzero(log.time_s - START_S == 40)[0]
    for quarter in range(4):
        begins = 40.0 + 0.25 * quarter
        for column in range(4):
            mean = quad(lambda t, c=column: controls_at(np.array([t]))[0, c], begins, begins + 0.25)[0] / 0.25
            off = log.controls[second, quarter, column] - mean
            off -= 2.0 * np.pi * round(off / (2.0 * np.pi)) if column in (1, 3) else 0.0
            assert abs(off) < 2e-3
    tunnel = log.controls[:, :, 4].ravel()
    times = np.repeat((log.time_s - START_S).astype(float), 4) + np.tile(np.arange(4) / 4.0, len(log))
    assert tunnel[times < 69.0] == pytest.approx(0.0, abs=1e-6)
    assert tunnel[times > 71.0] == pytest.approx(300.0, abs=1e-6)  # a step is no outlier


@pytest.mark.parametrize("seed", range(6))
def test_means_of_straight_pieces_are_exact(seed: int) -> None:
    """Settings recorded often are straight between; their means are those of the pieces' integral."""
    random = np.random.default_rng(seed)
    at_s, values = np.cumsum(random.uniform(0.05, 0.28, 160)), random.uniform(-1e3, 1e3, 160)
    table = a_table(every(2.0, 24.0))
    table[COMMAND[4]] = np.nan
    stamps = pd.DatetimeIndex(table.index[0] + pd.to_timedelta(np.round(at_s * 1e9).astype("int64"), unit="ns"))
    sparse = pd.DataFrame({COMMAND[4]: values}, index=stamps)
    table = pd.concat([table.drop(columns=COMMAND[4]), sparse]).sort_index()
    table.index.name = "time"
    log = log_of([table])
    times = np.repeat((log.time_s - START_S).astype(float), 4) + np.tile(np.arange(4) / 4.0, len(log))
    inside = (times >= at_s[0]) & (times < at_s[-1] - 0.25)
    fine = (np.arange(2000) + 0.5) / 2000.0 * 0.25
    expected = [np.interp(begins + fine, at_s, values).mean() for begins in times[inside]]
    size = np.abs(values).max() + 1.0
    np.testing.assert_allclose(log.controls[:, :, 4].ravel()[inside], expected, atol=1e-5 * size)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 0.99), st.floats(0.0, 0.99), st.floats(3.0, 12.0), st.floats(-40.0, 40.0))
def test_a_drive_that_moves_at_an_even_rate_is_seen_whole_once_a_second(
    begins: float, ends: float, rate: float, first: float
) -> None:
    """Wherever between two samples it begins and ends to move, the settings' means are the true ones."""
    move_s = 6.0 + ends
    corners_s = np.array([0.0, 20.0 + begins, 20.0 + begins + move_s, 60.0])
    angle = first + np.array([0.0, 0.0, rate * move_s, rate * move_s])
    times = np.arange(61.0)
    table = a_table(every(2.0, 60.0))
    sparse = pd.DataFrame(
        {COMMAND[1]: np.interp(times, corners_s, angle)}, index=table.index[0] + pd.to_timedelta(times, unit="s")
    )
    table = pd.concat([table.drop(columns=COMMAND[1]), sparse]).sort_index()
    table.index.name = "time"
    log = log_of([table])
    middles = np.repeat((log.time_s - START_S).astype(float), 4) + np.tile(0.25 * np.arange(4), len(log))
    fine = (np.arange(400) + 0.5) / 400.0 * 0.25
    expected = np.array([np.interp(each + fine, corners_s, angle).mean() for each in middles])
    np.testing.assert_allclose(np.rad2deg(log.controls[:, :, 1].ravel()), expected, atol=0.01)


def test_noise_of_a_setting_makes_no_corners() -> None:
    random = np.random.default_rng(5)
    times, noisy = np.arange(0.0, 400.0), random.standard_normal(400)
    assert len(_insert_ramp_corners(times, noisy)[0]) <= 404
    ramp = np.interp(times, [0.0, 100.4, 110.7, 400.0], [0.0, 0.0, 80.0, 80.0]) + 0.1 * noisy
    extra = np.setdiff1d(_insert_ramp_corners(times, ramp)[0], times)
    assert np.abs(np.subtract.outer([100.4, 110.7], extra)).min(axis=1) == pytest.approx(0.0, abs=0.1)


def test_outliers_are_refused_counted_and_leave_no_trace() -> None:
    """A log with outliers is the log without these samples."""
    holed, spoilt = a_table(every(10.0)), a_table(every(10.0))
    for number, row in enumerate(np.random.default_rng(3).choice(np.arange(30, 1950, 7), 40, replace=False)):
        name, jump = MOTION[number % 6], [50.0, -50.0, 30.0, 3.0, -3.0, 5.0][number % 6]
        spoilt.loc[spoilt.index[row], name] += jump
        holed.loc[holed.index[row], name] = np.nan
    spoilt["heading_deg"] = wrap_360(spoilt["heading_deg"].to_numpy())
    without, log = log_of([holed]), log_of([spoilt])
    assert without.refused == 0
    assert log.refused == 40
    np.testing.assert_allclose(log.measured, without.measured, atol=1e-6)
    np.testing.assert_allclose(log.weight, without.weight, atol=1e-12)


def test_hard_turns_are_no_outliers_of_a_path_without_noise() -> None:
    """Positions by dead reckoning follow every turn; nearly all of the time the ship sails straight ahead."""
    times_s = every(2.0, 600.0)
    turn_s = np.clip(times_s - 400.0, 0.0, 100.0)
    rate = np.deg2rad(8.0) * np.sin(turn_s / 8.0) * np.sin(np.pi * turn_s / 100.0) ** 2
    psi = np.cumsum(rate) * 0.5
    u = np.full_like(psi, 5.0)
    north, east = np.cumsum(u * np.cos(psi)) * 0.5, np.cumsum(u * np.sin(psi)) * 0.5
    noise = np.random.default_rng(5).normal(0.0, 1e-4, (2, len(times_s)))
    states = np.column_stack([north + noise[0], east + noise[1], psi, u, np.zeros_like(u), rate])
    index = a_table(times_s).index
    log = log_of([states_as_table(states, controls_at(times_s), np.tile([0.0, 5.0], (len(times_s), 1)), index)])
    assert np.isfinite(log.measured[:, :2]).mean() > 0.985


def test_a_small_craft_that_turns_within_samples_loses_none_and_bursts_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A yaw rate that is switched to and fro leads from one side to the other; a burst leaves both."""
    lively = NoiseLevels(0.03, 0.0017, 0.02, 0.0009, jerk=0.3, yaw_jerk=0.5)
    monkeypatch.setattr(log_module, "smooth", partial(smooth, levels=lively, engine="compiled"))
    times_s, noise = every(10.0), np.random.default_rng(8).standard_normal((6, 2000))
    switched = np.convolve(np.sign(np.sin(times_s / 2.0)), np.exp(-np.arange(12) / 2.5) / 3.0)[: times_s.size]
    rate = np.deg2rad(14.0) * switched
    psi, surge = np.cumsum(rate) * 0.1, np.full(times_s.size, 2.0)
    track = [np.cumsum(surge * along(psi)) * 0.1 for along in (np.cos, np.sin)]
    states = np.column_stack([*track, psi, surge, 0.0 * surge, rate]) + noise.T * ERRORS * [
        1.0,
        1.0,
        1.7,
        1.0,
        1.0,
        1.8,
    ]
    quick = a_table(times_s)
    sailed = states_as_table(states, controls_at(times_s), np.tile([0.0, 5.0], (times_s.size, 1)), quick.index)
    quick[list(MOTION)] = sailed[list(MOTION)]
    spoilt = quick.copy()
    bursts = np.concatenate([np.arange(row, row + 2) for row in range(40, 1900, 97)])
    spoilt.iloc[bursts, spoilt.columns.get_loc("yaw_rate_dps")] += 40.0
    of_motion = log_of([quick], length_m=2.0).refused
    assert of_motion <= 6  # of 12,000
    assert bursts.size <= log_of([spoilt], length_m=2.0).refused <= 1.3 * bursts.size + of_motion


@pytest.mark.parametrize(
    ("length_m", "steps"), [(28.9, 4), (13.0, 4), (11.0, 8), (4.0, 16), (0.5, 16), (np.inf, 4)]
)
def test_a_second_has_the_more_steps_the_sooner_a_ship_sails_her_length(length_m: float, steps: int) -> None:
    """At 4 m/s; the settings of a second have the same mean in any number of steps."""
    log = log_of([a_table(every(10.0))], length_m)
    assert log.steps_per_second == steps
    assert log.weight.shape[2] == steps + 1
    assert log.weight.sum(axis=2)[5:-5] == pytest.approx(1.0)
    coarse = log_of([a_table(every(10.0))])
    shafts = [0, 2, 4]
    np.testing.assert_allclose(
        log.controls.mean(axis=1)[:, shafts], coarse.controls.mean(axis=1)[:, shafts], rtol=1e-6, atol=1e-6
    )


def test_a_blip_of_a_thruster_is_not_believed_and_a_step_is() -> None:
    table, spoilt = a_table(every(10.0)), a_table(every(10.0))
    for number, row in enumerate(range(100, 1900, 60)):
        column = number % 5
        spoilt.iloc[row, spoilt.columns.get_loc(COMMAND[column])] += [150.0, 90.0, -120.0, 60.0, 400.0][column]
    clean, log = log_of([table]), log_of([spoilt])
    off = log.controls - clean.controls
    off[:, :, (1, 3)] -= 2.0 * np.pi * np.round(off[:, :, (1, 3)] / (2.0 * np.pi))
    assert np.abs(off).max(axis=(0, 1)) == pytest.approx(np.zeros(5), abs=0.02)


def assert_whole(log: Log) -> None:
    """Blocks are of consecutive seconds and legs of whole blocks, numbered from nought."""
    for number in range(int(log.block.max()) + 1):
        rows = np.flatnonzero(log.block == number)
        assert (np.diff(log.time_s[rows]) == 1).all()
        assert len(np.unique(log.leg[rows])) == 1
    assert (np.diff(log.block) >= 0).all()
    assert (np.diff(log.leg) >= 0).all()
    np.testing.assert_array_equal(log.block_edges, [*np.flatnonzero(np.diff(log.block, prepend=-1)), len(log)])


@pytest.mark.parametrize("missing_s", [40.0, 100.0])
def test_a_gap_splits_blocks_and_no_leg_crosses_a_long_one(missing_s: float) -> None:
    times_s, ends_s = every(10.0, 450.0), 150.0 + missing_s
    log = log_of([a_table(times_s[(times_s < 150.0) | (times_s > ends_s)])])
    assert_whole(log)
    seconds = log.time_s - START_S
    assert not ((seconds > 152) & (seconds < ends_s - 2.0)).any()
    assert (seconds < 152).sum() > 145
    assert (seconds > ends_s - 2.0).sum() > 448.0 - ends_s
    if missing_s > 60.0:
        assert not set(log.leg[seconds < 152]) & set(log.leg[seconds > ends_s - 2.0])


def test_blocks_and_legs_are_about_as_long_as_they_say() -> None:
    log = log_of([a_table(every(2.0, 900.0))])
    assert_whole(log)
    lengths = np.diff(log.block_edges)
    assert 0.75 * BLOCK_S < lengths.min() <= lengths.max() < 1.25 * BLOCK_S
    assert log.leg_count == pytest.approx(900.0 / LEG_S, abs=1)


def test_a_channel_that_falls_silent_is_missing_and_the_rest_is_there() -> None:
    table = a_table(every(10.0))
    silent = (every(10.0) >= 60.0) & (every(10.0) < 90.0)
    table.loc[table.index[silent], "surge_mps"] = np.nan
    log = log_of([table])
    rows = (log.time_s - START_S > 60) & (log.time_s - START_S < 89)
    assert np.isnan(log.measured[rows, 3]).all()
    assert not log.weight[rows, 3].any()
    others = [column for column in range(6) if column != 3]
    assert np.isfinite(log.measured[:, others]).all()
    assert np.isfinite(log.nominal).all()


def test_thrusters_that_fall_silent_end_a_block() -> None:
    table = a_table(every(10.0))
    silent = (every(10.0) >= 60.0) & (every(10.0) < 90.0)
    table.loc[table.index[silent], COMMAND[0]] = np.nan
    log = log_of([table])
    assert_whole(log)
    assert not ((log.time_s - START_S > 60) & (log.time_s - START_S < 88)).any()
    assert np.isfinite(log.controls).all()


def test_wind_is_averaged_as_a_vector_and_none_where_none_was_recorded() -> None:
    table = a_table(every(10.0))
    log = log_of([table])
    second = int(np.flatnonzero(log.time_s - START_S == 50)[0])
    direction, speed = 0.1 * np.sin(50.5 / 30.0), 8.0 + np.cos(50.5 / 7.0)
    assert log.wind[second] == pytest.approx([direction, speed], abs=2e-3)
    assert not log_of([table.drop(columns=list(ENVIRONMENT))]).wind.any()
    table[list(ENVIRONMENT)] = np.nan
    assert not log_of([table]).wind.any()


def test_no_precision_is_lost_so_long_after_1970() -> None:
    early, late = (log_of([a_table(irregular(), start_s)]) for start_s in (1000, START_S))
    assert np.array_equal(late.time_s - START_S, early.time_s - 1000)
    np.testing.assert_allclose(late.measured, early.measured, atol=1e-7)
    np.testing.assert_allclose(late.weight, early.weight, atol=1e-6)
    size = np.abs(early.controls).max(axis=(0, 1))
    np.testing.assert_allclose(late.controls / size, early.controls / size, atol=1e-6)
    np.testing.assert_allclose(late.wind, early.wind, atol=1e-5)


def test_trials_together_keep_apart() -> None:
    first, second = a_table(every(2.0, 200.0)), a_table(every(2.0, 100.0), START_S + 200)
    log = log_of([first, second])
    assert_whole(log)
    assert set(log.recording[log.time_s < START_S + 199]) == {0}
    assert set(log.recording[log.time_s > START_S + 201]) == {1}
    assert not set(log.leg[log.recording == 0]) & set(log.leg[log.recording == 1])


def test_a_subset_is_whole_blocks_numbered_anew() -> None:
    log = log_of([a_table(every(2.0, 600.0))])
    some = log.subset(np.isin(log.block, [1, 2, 5]))
    assert set(some.block) == {0, 1, 2}
    assert set(some.leg) == set(range(some.leg_count))
    np.testing.assert_array_equal(some.measured, log.measured[np.isin(log.block, [1, 2, 5])])


def test_how_often_settings_came_is_noted() -> None:
    table = a_table(every(10.0))
    table.loc[table.index[np.arange(len(table)) % 20 != 0], COMMAND[1]] = np.nan
    assert log_of([table]).setting_step_s == pytest.approx(2.0, abs=1e-6)


def test_what_cannot_be_a_log_is_said() -> None:
    with pytest.raises(DataShortageError, match="no stretch of"):
        log_of([a_table(every(10.0, 8.0))])
    with pytest.raises(InputError, match="heading_deg"):
        log_of([a_table(every(10.0)).drop(columns="heading_deg")])
    with pytest.raises(InputError, match=COMMAND[0]):
        log_of([a_table(every(10.0)).assign(**{COMMAND[0]: np.nan})])
