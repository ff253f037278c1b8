"""Checks of one channel: what they find in signals whose truth is known, and that sound signals pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Series
from seatrial.acquisition.core.ship import (
    BY_NAME,
    KINDS,
    Actuator,
    Channel,
    is_order_channel,
    order_channels,
    wrap_180,
    wrap_360,
)
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis import series
from seatrial.analysis.quality.channel_checks import (
    find_channel_faults,
    find_gaps,
    find_spikes,
)
from seatrial.analysis.series import find_stuck, flagged_stretches, runs_of_equal, series_from_values
from seatrial.analysis.tables.table import NANO, valid_values

HEADING, SURGE, RPM, NORTH = (BY_NAME[name] for name in ("heading_deg", "surge_mps", "port_rpm", "north_m"))
AZIMUTH = BY_NAME["port_angle_deg"]


def samples(values: ArrayLike, rate_hz: float = 2.0, at_s: ArrayLike | None = None) -> Series:
    values = np.asarray(values, dtype=float)
    since = np.arange(values.size) / rate_hz if at_s is None else np.asarray(at_s, dtype=float)
    return series_from_values(np.rint(since * NANO).astype(np.int64), values)


def noise(size: int, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).standard_normal(size)


def places(found: Bools) -> list[int]:
    return np.flatnonzero(found).tolist()


def test_gaps_are_judged_by_the_channels_own_rate() -> None:
    at_s = np.delete(np.arange(0.0, 300.0, 0.5), slice(100, 140))
    found = find_gaps(samples(np.zeros(at_s.size), at_s=at_s))
    assert [(each.start_ns / NANO, each.seconds) for each in found] == [(49.5, 20.5)]
    assert find_gaps(samples(np.zeros(300), rate_hz=0.05)) == []


def test_what_came_marked_as_suspect_is_no_good_value() -> None:
    """Dead reckoning, or a simulator, in a third of the samples."""
    north = samples(0.5 * np.arange(90) + 0.1 * noise(90))
    north = replace(north, quality=np.where(np.arange(90) < 30, Quality.SUSPECT, Quality.NOT_EVALUATED))
    faults = find_channel_faults(NORTH, north)
    (stretch,) = faults.stretches("marked_suspect")
    assert stretch.size == 30
    assert faults.quality(False, []).grade == "suspect"


def test_one_missing_sample_and_a_channel_that_reports_on_events_are_no_gaps() -> None:
    assert find_gaps(samples(np.zeros(99), at_s=np.delete(np.arange(100.0), 50))) == []
    events = np.cumsum(np.random.default_rng(1).uniform(0.2, 3.0, 400))
    assert find_gaps(samples(np.zeros(400), at_s=events)) == []


def test_a_late_start_and_an_early_end_are_gaps() -> None:
    found = find_gaps(samples(np.zeros(100)), -30 * NANO, 50 * NANO)
    assert [each.seconds for each in found] == [30.0]


@pytest.mark.parametrize(
    ("name", "value", "possible"),
    [("heading_deg", 360.0, False), ("heading_deg", 0.0, True), ("port_angle_deg", 180.0, True),
     ("port_angle_deg", -180.0, False), ("surge_mps", 30.0, True), ("surge_mps", 30.1, False),
     ("wind_speed_mps", -0.1, False), ("north_m", np.inf, False)],
)  # fmt: skip
def test_out_of_range_is_what_the_channel_does_not_hold(name: str, value: float, possible: bool) -> None:
    outside = find_channel_faults(BY_NAME[name], samples([value, np.nan])).masks["out_of_range"]
    assert outside.tolist() == [not possible, False]
    assert possible == BY_NAME[name].is_possible_value(value)


def test_repeated_times_and_steps_back_are_counted_in_the_order_of_receipt() -> None:
    given_s = [0.0, 1.0, 1.0, 2.0, 5.0, 3.0, 4.0, 6.0]
    faults = find_channel_faults(SURGE, samples(np.arange(8.0), at_s=given_s))
    assert places(faults.masks["duplicate"]) == [2]
    assert places(faults.masks["time_backwards"]) == [5, 6]
    assert [stretch.size for stretch in faults.listed["time_backwards"]] == [2.0]


@pytest.mark.parametrize("width", [1, 2, 3])
@pytest.mark.parametrize("around_deg", [0.0, 90.0])
def test_spikes_on_a_turning_heading_are_found_and_nothing_else(width: int, around_deg: float) -> None:
    turning = around_deg + 20.0 * np.sin(np.arange(600) / 40.0) + 0.1 * noise(600)
    turning[300 : 300 + width] += 25.0
    assert places(find_spikes(samples(wrap_360(turning)), HEADING)) == list(range(300, 300 + width))


def test_spikes_across_the_seam_of_an_azimuth() -> None:
    thrust_astern = 180.0 + 0.2 * noise(600)
    thrust_astern[200] -= 70.0
    assert places(find_spikes(samples(wrap_180(thrust_astern), rate_hz=10.0), AZIMUTH)) == [200]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), turn_deg=st.floats(0.0, 360.0))
def test_spikes_do_not_depend_on_where_the_circle_is_cut(seed: int, turn_deg: float) -> None:
    heading = 30.0 * np.sin(np.arange(200) / 30.0) + 0.1 * noise(200, seed)
    heading[[50, 120]] += 20.0
    found = [find_spikes(samples(wrap_360(heading + turn)), HEADING) for turn in (0.0, turn_deg)]
    assert places(found[0]) == places(found[1]) == [50, 120]


SOUND: dict[str, Callable[[Floats], Floats]] = {
    "waves at a slow rate": lambda t: 0.5 * np.sin(2.0 * np.pi * t / 3.1) + 0.02 * noise(t.size),
    "a step of an order": lambda t: np.where(t > 100.0, 3.0, 0.0) + 0.03 * noise(t.size),
    "a hard stop": lambda t: np.clip(5.0 - 0.5 * np.clip(t - 60.0, 0.0, None), 0.0, 5.0) + 0.03 * noise(t.size),
    "noise that grows": lambda t: (0.01 + 0.001 * t) * noise(t.size),
    "a held value": lambda t: np.full(t.size, 2.0),
}


@pytest.mark.parametrize("what", SOUND)
@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
def test_what_ships_and_seas_do_is_no_spike(what: str, rate_hz: float) -> None:
    values = SOUND[what](np.arange(0.0, 300.0, 1.0 / rate_hz))
    assert places(find_spikes(samples(values, rate_hz), SURGE)) == []


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("other", [-100.0, -60.0])
def test_two_spikes_to_either_side_are_both_found(rate_hz: float, other: float) -> None:
    """Only two of the size of waves may be one, at 1 Hz."""
    values = 0.1 * noise(400)
    values[[100, 102]] += [100.0, other]
    assert places(find_spikes(samples(values, rate_hz), SURGE)) == [100, 102]


def test_what_stands_alone_beside_a_gap_is_no_spike() -> None:
    at_s = np.concatenate([np.arange(300), 400 + np.arange(300)]) / 2.0
    values = 0.03 * noise(600)
    values[299] = 2.0
    assert places(find_spikes(samples(values, at_s=at_s), SURGE)) == []


def test_a_thruster_that_is_stirred_is_no_spike() -> None:
    rpm = 0.1 * noise(600)
    rpm[300:312] += [12, 60, 150, 60, 120, 190, 120, 70, 72, 40, 12, 1]
    assert places(find_spikes(samples(rpm, 1.0), RPM)) == []


def test_noise_that_goes_silent_is_stuck_from_the_first_repeat() -> None:
    speed = 4.0 + 0.03 * noise(600)
    speed[200:260] = speed[200]
    stuck = find_stuck(samples(speed), SURGE)
    assert places(stuck) == list(range(201, 260))
    (stretch,) = flagged_stretches(samples(speed).measured_ns, stuck)
    assert stretch.size == 59


def smoothed_speed(size: int = 2000) -> Floats:
    """A filtered speed, to the centimetre per second: no noise, and the same for some samples at times."""
    return np.round(4.0 + np.convolve(noise(size + 39), np.hanning(40) / 8.0, mode="valid"), 2)


def test_a_smoothed_speed_that_stays_by_far_the_longest_is_stuck() -> None:
    speed = smoothed_speed()
    assert places(find_stuck(samples(speed), SURGE)) == []
    speed[700:1000] = 9.0
    assert places(find_stuck(samples(speed), SURGE)) == list(range(701, 1000))


def test_a_ship_that_comes_to_a_steady_speed_is_not_stuck() -> None:
    """Without any noise, the last figures become the same one after the other; and then the engine is stopped."""
    at_s = np.arange(0.0, 2000.0)
    speed = 5.0 - 3.0 * np.exp(-at_s / 20.0)
    speed[1500:] = 5.0 * np.exp(-(at_s[1500:] - 1500.0) / 60.0)
    assert places(find_stuck(samples(speed), SURGE)) == []
    alongside = smoothed_speed()
    alongside[:900] = 0.02
    alongside[900:1300] = np.round(alongside[900:1300] * np.linspace(0.0, 1.0, 400), 2)
    assert places(find_stuck(samples(alongside), SURGE)) == []


@pytest.mark.parametrize(("rate_hz", "lag_s"), [(0.5, 5.0), (1.0, 5.0), (0.2, 10.0), (2.0, 20.0)])
def test_a_steady_leg_between_zigzags_is_not_stuck(rate_hz: float, lag_s: float) -> None:
    """In steps of a tenth of a knot a speed stays for an hour, and leaves by a step or two."""
    at_s = np.arange(0.0, 4500.0, 1.0 / rate_hz)
    steady = (at_s > 900.0) & (at_s < 3600.0)
    wanted = 5.0 - np.where(steady, 0.0, 0.6 * np.abs(np.sin(2.0 * np.pi * at_s / 120.0)))
    kept = np.exp(-1.0 / (rate_hz * lag_s))
    speed = lfilter([1.0 - kept], [1.0, -kept], wanted - 5.0) + 5.0 + 0.001 * noise(at_s.size)
    assert places(find_stuck(samples(np.round(speed / 0.05144) * 0.05144, rate_hz), SURGE)) == []


def test_the_runs_of_a_speed_are_looked_up_once_however_many_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """A speed at 2 Hz that is written at 20 has a run for each sample; a look at all for each took minutes."""
    calls = list[int]()

    def counted(new: Bools) -> tuple[Ints, Ints]:
        calls.append(new.size)
        return runs_of_equal(new)

    monkeypatch.setattr(series, "runs_of_equal", counted)
    assert places(find_stuck(samples(np.repeat(4.0 + 0.02 * noise(300), 10), 20.0), SURGE)) == []
    assert len(calls) == 1


def test_a_speed_that_never_changes_is_no_crash() -> None:
    assert places(find_stuck(samples(np.full(60, 5.0)), SURGE)) == []


def test_two_channels_that_hold_still_by_right_are_not_stuck() -> None:
    """A stopped shaft between two runs, and an order in whole degrees that is held for minutes at a time."""
    rpm = 120.0 + 0.3 * noise(900)
    rpm[300:600] = 0.0
    assert places(find_stuck(samples(rpm), RPM)) == []
    order = np.repeat(np.random.default_rng(2).integers(-20, 20, 12), 75).astype(float)
    assert places(find_stuck(samples(order), AZIMUTH)) == []


def test_a_still_ship_on_a_coarse_sensor_is_not_stuck_but_one_that_sails_is() -> None:
    """The position alone cannot tell; the speed over ground can."""
    at_s = np.arange(0.0, 600.0)
    north = np.round(np.where(at_s < 300.0, 0.001, 2.0) * 0.0 + np.clip(at_s - 300.0, 0.0, None) * 2.0, 1)
    lying = samples(north, 1.0).measured_ns, np.where(at_s < 300.0, 0.0, 2.0)
    assert places(find_stuck(samples(north, 1.0), NORTH, lying)) == []
    frozen = north.copy()
    frozen[400:430] = frozen[400]
    assert places(find_stuck(samples(frozen, 1.0), NORTH, lying)) == list(range(401, 430))


def test_a_heading_frozen_while_the_ship_turns_is_stuck_at_either_side_of_north() -> None:
    at_s = np.arange(0.0, 300.0, 0.5)
    heading = wrap_360(np.round(1.0 * at_s, 1))
    heading[100:160] = heading[100]
    turning = samples(heading).measured_ns, np.ones(at_s.size)
    assert places(find_stuck(samples(heading), HEADING, turning)) == list(range(101, 160))


@pytest.mark.parametrize(
    "check",
    [
        lambda s: find_spikes(s, SURGE),
        lambda s: find_stuck(s, SURGE),
        lambda s: find_channel_faults(SURGE, s).masks["duplicate"],
        find_gaps,
    ],
)
@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_next_to_nothing_is_no_trouble(check: Callable[[Series], Any], count: int) -> None:
    assert not np.any(check(samples(np.zeros(count))))


def test_values_that_a_decoder_doubted_are_no_samples(tmp_path: object) -> None:
    times = np.arange(3, dtype=np.int64)
    quality = np.array([1, 4, 3], dtype=np.uint8)
    series = Series(times, times, np.arange(3.0), quality, ("a",), np.zeros(3, np.int32))
    assert np.isnan(valid_values(series)).tolist() == [False, True, False]


@pytest.mark.parametrize("channel", [
    pytest.param(channel, id=f"{kind} {channel.name}")
    for kind in KINDS
    for actuator in [Actuator("main", kind)]
    for channel in (*actuator.channels, *actuator.orders)
])  # fmt: skip
def test_every_control_and_order_of_every_kind_of_actuator_is_checked(channel: Channel) -> None:
    values = 0.4 * channel.high + 0.3 * noise(600)
    sound = find_channel_faults(channel, samples(values)).quality(has_finding=False, jumps=[])
    assert (sound.grade, sound.spikes, sound.stuck) == ("good", 0, ())
    values[300] -= 0.3 * channel.high
    judged = not is_order_channel(
        channel.name
    )  # an order may stand still, be in whole degrees, and be given for a moment
    assert places(find_channel_faults(channel, samples(values)).masks["spike"]) == [300] * judged
    rounded = 5.0 * np.round(6.0 * np.sin(np.arange(600) / 30.0) + 0.1 * noise(600))
    assert [step.size for step in find_channel_faults(channel, samples(rounded)).listed["quantised"]] == [
        5.0
    ] * judged


def test_order_that_is_held_is_not_stuck() -> None:
    """A helmsman orders whole degrees, and then 35 deg for a quarter of an hour."""
    values = np.r_[np.round(3.0 * noise(1200)), np.full(900, 35.0)]
    order = next(iter(order_channels((Actuator("main", "rudder"),))))
    faults = find_channel_faults(order, samples(values)).quality(has_finding=False, jumps=[])
    assert (faults.grade, faults.stuck) == ("good", ())
