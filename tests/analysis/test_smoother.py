"""The smoothed motion: as good as it says, at any rate, through outliers and gaps, on the circle."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import to_earth
from seatrial.acquisition.core.ship import angle_difference
from seatrial.analysis.estimation.smoother import SmoothedMotion, smooth
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from tests.analysis.smoothing_errors import coverage, nees, with_accelerations
from tests.benchmarks import wave_trials
from tests.conftest import nightly

FINE_HZ = 40.0
CASES = [
    ("gunnerus_short", "calm", "zigzag_20_20", 5.0, 1.0),
    ("gunnerus_long", "moderate", "voyage", 5.0, 1.0),
]
WIDE_CASES = [
    (vessel, sea, manoeuvre, rate_hz, noise)
    for vessel, sea, manoeuvre in (
        ("gunnerus_short", "calm", "voyage"),
        ("gunnerus_short", "gentle", "turning_circle_20"),
        ("gunnerus_long", "gentle", "programme"),
        ("gunnerus_long", "moderate", "voyage"),
    )
    for rate_hz, noise in ((5.0, 0.5), (5.0, 3.0), (20.0, 1.0))
]


@cache
def trial(vessel: str, sea: str, manoeuvre: str, rate_hz: float, noise: float, seed: int = 3) -> pd.DataFrame:
    """Simulated at 40 Hz and thinned: the simulator's wave speeds are differences over its own step."""
    fine = simulate_trial(vessel, sea, manoeuvre, 400.0, FINE_HZ, seed, noise=SimulationNoise().scaled(noise))[0]
    return fine.iloc[:: round(FINE_HZ / rate_hz)]


@cache
def result(vessel: str, sea: str, manoeuvre: str, rate_hz: float, noise: float, seed: int = 3) -> SmoothedMotion:
    return smooth(trial(vessel, sea, manoeuvre, rate_hz, noise, seed))


def truth(vessel: str, sea: str, manoeuvre: str, rate_hz: float, seed: int = 3) -> pd.DataFrame:
    """What perfect sensors would have measured."""
    return with_accelerations(trial(vessel, sea, manoeuvre, FINE_HZ, 0.0, seed)).reindex(
        trial(vessel, sea, manoeuvre, rate_hz, 0.0, seed).index
    )


def check(case: tuple[str, str, str, float, float], low: float, high: float) -> None:
    found, perfect = result(*case), truth(*case[:4])
    shares = coverage(found, perfect, margin_s=5.0)
    motion = [shares[name] for name in found.states.columns[:6]]
    assert min(motion) > low
    assert np.mean(motion) == pytest.approx(0.95, abs=0.025)
    assert max(motion) < high
    assert np.nanmean(nees(found, perfect)) == pytest.approx(6.0, rel=0.25)


@pytest.mark.parametrize("case", [CASES[1], *nightly((CASES[0],))])
def test_the_bands_hold_what_perfect_sensors_would_have_measured(case: tuple[str, str, str, float, float]) -> None:
    """400 rows of errors that follow each other: a share of 0.95 scatters by some 0.02."""
    check(case, 0.90, 0.995)


@pytest.mark.slow
@pytest.mark.parametrize("case", WIDE_CASES)
def test_the_bands_hold_in_every_sea_and_at_every_noise(case: tuple[str, str, str, float, float]) -> None:
    check(case, 0.87, 0.999)


@pytest.mark.parametrize("case", CASES)
def test_the_noise_is_found_that_was_put_in(case: tuple[str, str, str, float, float]) -> None:
    levels, put_in = result(*case).noise, SimulationNoise()
    assert levels.position_m == pytest.approx(put_in.position_m, rel=0.1)
    assert levels.speed_mps == pytest.approx(put_in.speed_mps, rel=0.15)
    assert np.rad2deg(levels.heading_rad) == pytest.approx(put_in.heading_deg, rel=0.15)
    assert np.rad2deg(levels.yaw_rate_radps) == pytest.approx(put_in.yaw_rate_dps, rel=0.2)


@pytest.mark.parametrize("sea", ["moderate", *nightly("calm")])
def test_a_boat_that_weaves_makes_no_waves(sea: str) -> None:
    """Over ground the velocity of a catamaran of 2 m that turns to and fro swings as in waves, by 0.4 m/s at 0.7
    rad/s; along and across the boat it does not."""
    table, _ = simulate_trial("otter_2m", sea, "voyage", 300.0, 2.0, 3)
    noise = smooth(table).noise
    along = table[["surge_mps", "sway_mps"]].to_numpy()
    assert noise.wave_speed**2 * (1.0 + noise.wave_across**2) < 1.5 * np.var(along, axis=0).sum()


def zigzags_between_straight_legs(seed: int) -> pd.DataFrame:
    """A track as dead reckoning gives it, without noise: straight for 1,100 s, then zigzags of 8 to 16 s a side."""
    generator, step_s, rows = np.random.default_rng(seed), 0.1, 15_000
    helm, first, side = np.zeros(rows), 11_250, 1.0
    while first < rows:
        last = first + round(generator.uniform(8.0, 16.0) / step_s)
        helm[first:last], first, side = side * generator.uniform(5.0, 10.0), last, -side
    rate, sway = np.zeros((2, rows))
    for row in range(1, rows):  # Nomoto's first order, and a drift outwards that follows the turn
        rate[row] = rate[row - 1] + step_s * (0.2 * helm[row] - rate[row - 1]) / 2.5
        sway[row] = sway[row - 1] + step_s * (-0.25 * rate[row] - sway[row - 1]) / 2.0
    surge, heading = 5.4 - 0.1 * np.abs(rate), np.deg2rad(np.cumsum(rate) * step_s)
    north, east = np.cumsum(to_earth(surge, sway, heading), axis=1) * step_s
    index = pd.date_range("2026-06-01", periods=rows, freq="100ms", tz="UTC", name="time")
    columns = {"north_m": north, "east_m": east, "heading_deg": np.rad2deg(heading) % 360.0,
               "surge_mps": surge, "sway_mps": sway, "yaw_rate_dps": rate}  # fmt: skip
    return pd.DataFrame(columns, index=index).iloc[::5]


@pytest.mark.parametrize("seed", [1, *nightly(2)])
def test_zigzags_between_straight_legs_are_no_waves(seed: int) -> None:
    """Waves swing all the time. The sway of R/V Gunnerus' zigzags of 2022 was taken for waves of 0.13 m/s, and
    predictions started with as much less."""
    assert smooth(zigzags_between_straight_legs(seed), 1.0).noise.wave_speed == 0.0


@pytest.mark.parametrize("seed", [2, *nightly(0)])
def test_a_ship_that_keeps_station_in_a_calm_makes_no_waves(seed: int) -> None:
    """She wanders within half a minute and more; beyond the longest waves of the sea nothing is waves."""
    generator = np.random.default_rng((seed, 7))
    board = wave_trials.drawn_board(
        generator, float(np.exp(generator.uniform(np.log(25.0), np.log(120.0)))), filtered=False
    )
    pose = wave_trials.keeping_station(generator, 10_000, board.length_m)
    calm = wave_trials.drawn_waves(generator, 0.01, 6.0)
    assert smooth(wave_trials.recorded(generator, board, pose, (calm,), 2.0), 1.0).noise.wave_speed == 0.0


def test_waves_are_found_where_there_are_waves() -> None:
    calm, moderate = (result(*case) for case in CASES)
    assert calm.noise.wave_speed == calm.noise.yaw_wave_speed == 0.0
    pd.testing.assert_frame_equal(calm.slow, calm.states)
    assert 2 * np.pi / moderate.noise.wave_frequency_radps == pytest.approx(5.0, abs=1.0)
    swing = moderate.states["surge_mps"] - moderate.slow["surge_mps"]
    assert moderate.slow["surge_mps"].diff().std() < 0.3 * swing.diff().std()


def test_innovations_are_as_large_as_the_filter_expects() -> None:
    for case in CASES:
        for channel in result(*case).consistency.values():
            assert channel.nis == pytest.approx(1.0, abs=0.15)
            assert channel.inside_95 == pytest.approx(0.95, abs=0.025)
            assert channel.low < 1.0 < channel.high


def test_the_smoother_beats_the_samples() -> None:
    case = CASES[1]
    found, perfect, raw = result(*case), truth(*case[:4]), trial(*case)
    for name in ("north_m", "surge_mps", "sway_mps", "yaw_rate_dps"):
        at = found.states.index
        error = (found.states[name] - perfect[name].reindex(at)).std()
        assert error < 0.75 * (raw[name].reindex(at) - perfect[name].reindex(at)).std()


def test_outliers_are_flagged_and_change_nothing_else() -> None:
    clean = trial(*CASES[1])
    spoilt, rows = clean.copy(), [500, 501, 1203, 1500]
    spoilt.iloc[rows[:2], clean.columns.get_loc("north_m")] += 30.0
    spoilt.iloc[rows[2], clean.columns.get_loc("heading_deg")] = 180.0
    spoilt.iloc[rows[3], clean.columns.get_loc("surge_mps")] -= 3.0
    levels = result(*CASES[1]).noise
    plain, found = smooth(clean, levels=levels), smooth(spoilt, levels=levels)
    flagged = found.rejected & ~plain.rejected
    assert np.flatnonzero(flagged["north_m"]).tolist() == rows[:2]
    assert np.flatnonzero(flagged["heading_deg"]).tolist() == [rows[2]]
    assert np.flatnonzero(flagged["surge_mps"]).tolist() == [rows[3]]
    assert found.rejected.index.equals(spoilt.index)
    deviation = plain.standard_deviations()
    for name in ("north_m", "east_m", "surge_mps"):
        assert np.abs((found.states[name] - plain.states[name]) / deviation[name]).max() < 3.0


def test_channels_at_their_own_rates_and_times() -> None:
    """Position at 1 Hz between the seconds, heading at 5 Hz, speeds at 2.5 Hz, no yaw rate."""
    case = CASES[1]
    table, levels = trial(*case), result(*case).noise
    sparse = table.drop(columns="yaw_rate_dps")
    position, speed = np.arange(len(table)) % 5 != 2, np.arange(len(table)) % 2 != 1
    sparse.loc[position, ["north_m", "east_m"]] = np.nan
    sparse.loc[speed, ["surge_mps", "sway_mps"]] = np.nan
    found = smooth(sparse.sample(frac=1.0, random_state=1), levels=levels)
    shares = coverage(found, truth(*case[:4]), margin_s=5.0)
    assert min(shares[name] for name in found.states.columns[:6]) > 0.9
    assert (found.standard_deviations()["north_m"] > result(*case).standard_deviations()["north_m"]).mean() > 0.95


def test_a_variance_that_rounding_has_eaten_is_not_known() -> None:
    """As before the first position of a model that is tracked to half a millimetre."""
    found = result(*CASES[0])
    covariance = found.covariance.copy()
    covariance[0, 0, 0] = -5e-4
    deviation = replace(found, covariance=covariance).standard_deviations()
    assert np.flatnonzero(deviation["north_m"].isna()).tolist() == [0]
    assert deviation.drop(columns="north_m").equals(found.standard_deviations().drop(columns="north_m"))


def test_in_a_gap_there_is_nothing_or_what_the_covariance_says() -> None:
    case = CASES[0]
    table, levels = trial(*case), result(*case).noise
    seconds = (table.index - table.index[0]).total_seconds()
    holed = table[(seconds <= 200.0) | (seconds >= 215.0)]
    found, kept = smooth(holed, levels=levels), smooth(holed, levels=levels, longest_gap_s=60.0)
    inside = (found.states.index > table.index[0] + pd.Timedelta(seconds=200.5)) & (
        found.states.index < table.index[0] + pd.Timedelta(seconds=214.5)
    )
    assert found.states[inside].isna().to_numpy().all()
    assert found.states[~inside].notna().to_numpy().all()
    assert np.isnan(found.covariance[inside]).all()
    deviation = kept.standard_deviations()["north_m"]
    assert deviation[inside].max() > 20 * deviation[~inside].median()
    error = kept.states["north_m"] - truth(*case[:4])["north_m"].reindex(kept.states.index)
    assert (np.abs(error[inside]) < 4 * deviation[inside]).all()


def test_any_rate_gives_the_same_motion() -> None:
    case = CASES[0]
    fast = smooth(trial(*case), 4.0, levels=result(*case).noise)
    common = fast.states.reindex(result(*case).states.index)
    pd.testing.assert_frame_equal(common, result(*case).states, check_freq=False, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("turn_deg", [90.0, 181.0, 359.0])
@pytest.mark.parametrize("case", CASES)
def test_north_is_where_one_likes(turn_deg: float, case: tuple[str, str, str, float, float]) -> None:
    """The same voyage on a compass turned by some angle is the same, turned with its waves: 359 to 1 is no jump."""
    table, turned = trial(*case), trial(*case).copy()
    angle = np.deg2rad(turn_deg)
    turned["heading_deg"] = (table["heading_deg"] + turn_deg) % 360.0
    turned["north_m"] = np.cos(angle) * table["north_m"] - np.sin(angle) * table["east_m"]
    turned["east_m"] = np.sin(angle) * table["north_m"] + np.cos(angle) * table["east_m"]
    noise = result(*case).noise
    levels = replace(noise, wave_direction_rad=noise.wave_direction_rad + angle)
    found, plain = smooth(turned, levels=levels).states, result(*case).states
    assert np.abs(angle_difference(found["heading_deg"] - turn_deg, plain["heading_deg"])).max() < 1e-4
    assert ((found["heading_deg"] >= 0) & (found["heading_deg"] < 360)).all()
    for name in ("surge_mps", "sway_mps", "yaw_rate_dps", "surge_mps2"):
        assert np.abs(found[name] - plain[name]).max() < 1e-3


def test_both_engines_and_all_blocks_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    case = CASES[0]
    table = trial(*case).iloc[:600]
    levels = result(*case).noise
    whole = smooth(table, levels=levels, engine="compiled")
    slow = smooth(table, levels=levels, engine="filterpy")
    assert slow.states.to_numpy() == pytest.approx(whole.states.to_numpy(), rel=1e-6, abs=1e-6)
    monkeypatch.setattr("seatrial.analysis.estimation.smoother._BLOCK_STEPS", 200)
    monkeypatch.setattr("seatrial.analysis.estimation.smoother._OVERLAP_STEPS", 150)
    parts = smooth(table, levels=levels, engine="compiled")
    assert parts.states.to_numpy() == pytest.approx(whole.states.to_numpy(), rel=1e-3, abs=2e-3)
    assert parts.states.notna().to_numpy().all()


def test_position_and_heading_are_needed() -> None:
    table = trial(*CASES[0])
    with pytest.raises(InputError, match="heading_deg"):
        smooth(table.drop(columns="heading_deg"))
    with pytest.raises(InputError, match="north_m"):
        smooth(table.drop(columns=["north_m"]))
    with pytest.raises(InputError, match="not possible"):
        smooth(table, 0.0, levels=result(*CASES[0]).noise)


def test_what_is_in_doubt_is_remarked_on_and_nothing_else() -> None:
    """Good data get no remark; levels that are wrong or at their bounds get one for each channel concerned."""
    case = CASES[0]
    assert result(*case).remarks == ()
    levels = result(*case).noise
    bold = smooth(trial(*case), levels=replace(levels, position_m=0.3 * levels.position_m))
    assert all(
        any(line.startswith(f"{name}: bands too narrow") for line in bold.remarks) for name in ("north_m", "east_m")
    )
    least = smooth(trial(*case), levels=replace(levels, speed_mps=1e-4)).remarks
    assert sum("the noise level speed_mps could not be determined" in line for line in least) == 2
    assert len({line.split(":")[0] for line in least}) == len(least)
