"""Resampling: constants and ramps are exact, angles turn the short way, nothing folds down from above."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.errors import DataShortageError, InputError
from analysis.resample import resample
from tests.analysis.conftest import START_S, table_at, turn_between

RATES = st.sampled_from([0.4, 1.0, 2.0, 5.0, 10.0, 25.0])
SEEDS = st.integers(0, 2**16)


def jittered(rate_hz: float, seed: int, duration_s: float = 30.0) -> np.ndarray:
    """Irregular times of a sensor at about ``rate_hz``, shuffled, some of them twice."""
    random = np.random.default_rng(seed)
    steps = np.arange(int(duration_s * rate_hz))
    times = (steps + random.uniform(-0.3, 0.3, steps.size)) / rate_hz
    times = np.concatenate([times, times[::7]])
    random.shuffle(times)
    return np.round(times, 6)


@given(rate=RATES, seed=SEEDS, value=st.floats(-500, 500))
@settings(max_examples=40, deadline=None)
def test_a_constant_stays_constant(rate: float, seed: int, value: float) -> None:
    times = jittered(rate, seed)
    found = resample(table_at(times, {"surge_mps": np.full(times.size, value)}), longest_gap_s=5.0)["surge_mps"]
    assert np.abs(found - value).max() <= 1e-9


@given(rate=RATES, seed=SEEDS, slope=st.floats(-20, 20), start=st.floats(-1e5, 1e5))
@settings(max_examples=40, deadline=None)
def test_a_ramp_is_exact_at_any_spacing(rate: float, seed: int, slope: float, start: float) -> None:
    times = jittered(rate, seed)
    found = resample(table_at(times, {"north_m": start + slope * times}), longest_gap_s=5.0)["north_m"]
    seconds = (found.index.as_unit("ns").asi8 - START_S * 10**9) / 1e9
    assert np.abs(found.to_numpy() - (start + slope * seconds)).max() <= 1e-7


@given(rate=RATES, seed=SEEDS, turn_deg=st.floats(-720, 720))
@settings(max_examples=40, deadline=None)
def test_on_the_circle_resampling_commutes_with_turning(rate: float, seed: int, turn_deg: float) -> None:
    times = jittered(rate, seed)
    heading = 20.0 * np.sin(0.3 * times) + 4.0 * times
    plain = resample(table_at(times, {"heading_deg": heading % 360}), longest_gap_s=5.0)["heading_deg"]
    turned = resample(table_at(times, {"heading_deg": (heading + turn_deg) % 360}), longest_gap_s=5.0)
    assert turn_between(turned["heading_deg"], plain + turn_deg) <= 1e-6


@pytest.mark.parametrize(
    ("name", "before", "after", "middle"),
    [("heading_deg", 359.0, 1.0, 0.0), ("heading_deg", 1.0, 358.0, 359.5), ("port_angle_deg", 179.0, -179.0, 180.0),
     ("starboard_angle_deg", -178.0, 179.0, -179.5), ("wind_direction_deg", 350.0, 20.0, 5.0),
     ("surge_mps", 359.0, 1.0, 180.0)],
)  # fmt: skip
def test_between_two_samples_angles_go_the_short_way(name: str, before: float, after: float, middle: float) -> None:
    found = resample(table_at([0.0, 2.0], {name: [before, after]}))[name]
    assert found.tolist() == pytest.approx([before, middle, after])


def test_ten_numbers_by_hand() -> None:
    table = table_at([0.5, 1.5, 2.5, 2.5, 9.5, 10.0], {"surge_mps": [1.0, 2.0, 3.0, 5.0, 0.0, 1.0]})
    found = resample(table, longest_gap_s=3.0)["surge_mps"]
    assert found.tolist() == pytest.approx([1.5, 3.0, *[np.nan] * 7, 1.0], nan_ok=True)
    assert found.index[0] == pd.Timestamp(START_S + 1, unit="s", tz="UTC")


def test_noise_above_half_the_rate_does_not_come_back() -> None:
    """A tone of 1.1 Hz would fold to 0.1 Hz at full height if every tenth sample were taken."""
    times = np.arange(0.0, 60.0, 0.1)
    found = resample(table_at(times, {"sway_mps": np.sin(2 * np.pi * 1.1 * times)}))["sway_mps"].iloc[2:-2]
    assert np.abs(found).max() < 0.06


def test_a_slow_motion_is_neither_delayed_nor_shrunk() -> None:
    times = np.arange(0.0, 120.0, 0.1)
    motion = np.sin(2 * np.pi * 0.05 * times)
    found = resample(table_at(times, {"sway_mps": motion}))["sway_mps"]
    assert np.abs(found.to_numpy() - motion[::10][: len(found)]).max() < 0.02


def test_filtered_headings_that_jitter_about_north_stay_there() -> None:
    times = np.arange(0.0, 30.0, 0.05)
    heading = np.random.default_rng(3).normal(0.0, 2.0, times.size) % 360
    found = resample(table_at(times, {"heading_deg": heading}))["heading_deg"]
    assert turn_between(found.iloc[1:-1], 0.0) < 2.5
    assert found.between(0, 360, inclusive="left").all()


def test_each_channel_keeps_to_its_own_rate_and_gaps() -> None:
    fast, slow = np.arange(0.0, 20.0, 0.1), np.arange(0.0, 20.0, 4.0)
    table = pd.concat([table_at(fast, {"surge_mps": 2.0 + 0 * fast}), table_at(slow, {"wind_speed_mps": slow})])
    table = table[(table.index.second % 20 < 3) | (table.index.second % 20 > 12) | table["surge_mps"].isna()]
    found = resample(table)
    assert found["wind_speed_mps"].iloc[:17].tolist() == pytest.approx(list(range(17)))
    assert found["surge_mps"].isna().sum() == 10


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 3.0, 10.0])
def test_the_grid_falls_on_whole_multiples_in_utc(rate_hz: float) -> None:
    found = resample(table_at([0.21, 7.77], {"north_m": [0.0, 1.0]}), rate_hz, longest_gap_s=60.0)
    steps = found.index.as_unit("ns").asi8.astype(object)
    step_ns = 10**9 / Fraction(rate_hz)
    past = [int(step) % step_ns for step in steps]
    assert all(min(each, step_ns - each) < 1 for each in past)
    assert np.ptp(np.diff(steps)) <= 1


def test_two_samples_at_one_time_count_as_their_mean_on_the_circle() -> None:
    found = resample(table_at([0, 0, 1], {"heading_deg": [350.0, 20.0, 5.0]}))["heading_deg"]
    assert found.tolist() == pytest.approx([5.0, 5.0])


def test_a_table_without_samples_or_zone_is_refused() -> None:
    with pytest.raises(DataShortageError, match="no sample"):
        resample(table_at([0, 1], {"north_m": [np.nan, np.nan]}))
    with pytest.raises(InputError, match="no zone"):
        resample(table_at([0], {"north_m": [1.0]}).tz_localize(None))
    with pytest.raises(InputError, match="rate"):
        resample(table_at([0], {"north_m": [1.0]}), 0.0)
