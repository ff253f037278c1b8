"""Resampling: constants and ramps are exact, angles turn the short way, nothing folds down from above."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import BY_NAME, is_held_setting
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables.resample import resample, resample_recording
from seatrial.analysis.tables.table import history_of, remove_delays, select, table_of
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


NANO = 10**9


def recording_of(seed: int) -> Recording:
    """Channels at rates of their own, jittered, unsorted, with repeats, bad values, gaps and angles at the seam."""
    random = np.random.default_rng(seed)
    series = {}
    for name in ("heading_deg", "surge_mps", "port_rpm", "port_angle_deg"):
        times = jittered(float(random.choice([0.7, 1.0, 2.0, 5.0])), int(random.integers(2**16)))
        times = times[(times < 8) | (times > random.uniform(8, 20))]
        value = random.normal(0.0, 5.0, times.size) + 180.0 * (name == "port_angle_deg")
        quality = np.where(random.random(times.size) < 0.05, 4, 2).astype(np.uint8)
        measured_ns = START_S * NANO + np.rint(times * NANO).astype(np.int64)
        value = value % 360.0 if name.endswith("_deg") else value
        source = np.zeros(times.size, np.int32)
        series[name] = Series(measured_ns, measured_ns, value, quality, ("test",), source)
    return Recording(Path("made.mcap"), Trial(), series, {}, [], 0, True, 0, 0)


@given(
    seed=SEEDS,
    rate_hz=st.sampled_from([0.5, 1.0, 3.0]),
    longest_gap_s=st.none() | st.floats(0.5, 20.0),
    delay_s=st.floats(-3.0, 3.0),
    part=st.sampled_from([(0.0, 100.0), (0.0, 37.0), (37.0, 100.0)]),
)
@settings(max_examples=40, deadline=None)
def test_without_the_joined_table_the_result_is_the_same_to_the_last_bit(
    seed: int, rate_hz: float, longest_gap_s: float | None, delay_s: float, part: tuple[float, float]
) -> None:
    recording, delays = recording_of(seed), {"heading_deg": delay_s}
    joined = resample(select(table_of(recording), part), rate_hz, longest_gap_s, delays)
    alone = resample_recording(recording, rate_hz, longest_gap_s, delays, part)
    pd.testing.assert_frame_equal(alone, joined, check_exact=True)
    assert alone.attrs == joined.attrs


@given(frequency=st.floats(0.5, 1.0), rate_hz=st.sampled_from([4.0, 10.0, 20.0]), phase=st.floats(0.0, 6.3))
@settings(max_examples=60, deadline=None)
@pytest.mark.parametrize("name", ["sway_mps", "heading_deg", "port_rpm"])
def test_what_is_above_half_the_output_rate_leaves_less_than_three_percent(
    name: str, frequency: float, rate_hz: float, phase: float
) -> None:
    """Anything that the grid of 1 Hz would fold down, in motion, on the circle and in settings."""
    times = np.arange(0.0, 40.0, 1.0 / rate_hz)
    wave = np.sin(2 * np.pi * frequency * times + phase)
    found = resample(table_at(times, {name: wave % 360 if name == "heading_deg" else wave}))[name].iloc[4:-4]
    assert turn_between(found, 0.0) < 0.03


@given(rate_hz=st.sampled_from([1.4, 2.0, 3.0]), phase=st.floats(0.0, 6.3))
@settings(max_examples=30, deadline=None)
def test_little_faster_than_the_grid_is_filtered_too(rate_hz: float, phase: float) -> None:
    """A motion between the two halves of the rates, which taking every second sample would fold down."""
    times = np.arange(0.0, 60.0, 1.0 / rate_hz)
    found = resample(table_at(times, {"roll_deg": np.sin(2 * np.pi * 0.52 * times + phase)}))["roll_deg"]
    assert np.abs(found.iloc[4:-4]).max() < 0.12


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_two_hertz_to_one_through_north_stays_on_the_way(seed: int) -> None:
    """A ship that swings about north: neither an average of 359 and 1 near 180, nor a turn too many."""
    random = np.random.default_rng(seed)
    times = np.arange(0.0, 120.0, 0.5)
    heading = 4.0 * np.sin(2 * np.pi * times / 40.0) + random.normal(0.0, 0.1, times.size)
    found = resample(table_at(times, {"heading_deg": heading % 360}))["heading_deg"]
    truth = 4.0 * np.sin(2 * np.pi * np.arange(len(found)) / 40.0)
    assert turn_between(found, truth) < 0.5


SETTINGS = sorted(name for name in BY_NAME if is_held_setting(BY_NAME[name]))


@pytest.mark.parametrize("name", SETTINGS)
def test_a_step_of_an_order_is_never_overshot(name: str) -> None:
    times = np.arange(0.0, 60.0, 0.1)
    found = resample(table_at(times, {name: np.where(times < 30.3, 20.0, 80.0)}))[name]
    assert found.between(20.0 - 1e-9, 80.0 + 1e-9).all()
    assert found.between(20.1, 79.9).sum() <= 4


@given(seed=SEEDS, gap_s=st.floats(3.2, 60.0))
@settings(max_examples=40, deadline=None)
def test_no_bridge_is_built_over_a_long_gap(seed: int, gap_s: float) -> None:
    times = np.sort(jittered(5.0, seed, 20.0))
    start = times[times.size // 2]
    times = np.where(times > start, times + gap_s, times)
    found = resample(table_at(times, {"surge_mps": np.ones(times.size)}))["surge_mps"]
    seconds = found.index.as_unit("ns").asi8 / NANO - START_S
    end = times[times > start].min()
    inside = (seconds > start) & (seconds < end)
    assert found[inside].isna().all()
    assert found[~inside].notna().all()


@given(
    rate_hz=st.sampled_from([0.7, 2.0, 10.0]),
    delay_s=st.floats(-5.0, 5.0),
    name=st.sampled_from(["north_m", "heading_deg", "port_rpm"]),
)
@settings(max_examples=40, deadline=None)
def test_a_delay_that_is_known_is_taken_off(rate_hz: float, delay_s: float, name: str) -> None:
    """Stamped too late by the delay and brought back: a ramp comes out where it was, to the rounding of a ns."""
    times = np.arange(0.0, 60.0, 1.0 / rate_hz)
    late = table_at(times + delay_s, {name: (0.7 * times) % 360})
    found = resample(late, delays={name: delay_s})
    seconds = found.index.as_unit("ns").asi8 / NANO - START_S
    assert turn_between(found[name], 0.7 * seconds) < 1e-4
    assert [step["step"] for step in history_of(found)] == ["remove_delays", "resample"]


def test_raw_samples_without_their_delay_are_joined_anew() -> None:
    table = table_at([0.0, 1.0, 2.0], {"north_m": [0.0, 1.0, 2.0], "surge_mps": [5.0, np.nan, 7.0]})
    found = remove_delays(table, {"north_m": 1.0})
    expected = {"north_m": [0.0, 1.0, 2.0, np.nan], "surge_mps": [np.nan, 5.0, np.nan, 7.0]}
    pd.testing.assert_frame_equal(found, table_at([-1.0, 0.0, 1.0, 2.0], expected))
    with pytest.raises(InputError, match="no such channel"):
        remove_delays(table, {"speed": 1.0})
    with pytest.raises(InputError, match="not possible"):
        resample(table, delays={"north_m": np.nan})


def test_the_history_says_what_was_done() -> None:
    first = resample(table_at([0, 1, 2], {"north_m": [0.0, 1.0, 2.0]}), 2.0, longest_gap_s=4.0)
    (step,) = history_of(first)
    assert step["step"] == "resample"
    assert step["options"] == {"rate_hz": 2.0, "longest_gap_s": 4.0}
    assert [each["step"] for each in history_of(resample(first))] == ["resample", "resample"]


@given(
    before=st.sampled_from([0.0, 0.05, 0.4]), after=st.floats(1.0, 40.0), rate=st.sampled_from([4.0, 10.0, 25.0]),
    place=st.floats(5.0, 25.0),
    name=st.sampled_from(["wind_speed_mps", "speed_over_ground_mps", "apparent_wind_speed_mps"]),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_a_gust_from_a_calm_makes_no_negative_speed(
    before: float, after: float, rate: float, place: float, name: str
) -> None:
    times = np.arange(0.0, 30.0, 1.0 / rate)
    limit = min(after, BY_NAME[name].high)
    values = np.where(times < place, before, limit)
    for samples in (values, values[::-1]):
        result = resample(table_at(times, {name: samples}))[name]
        assert result.min() >= 0.0
        assert result.max() <= BY_NAME[name].high
