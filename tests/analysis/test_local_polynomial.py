"""Local polynomials: exact for slow motion, on the circle, with gaps and at the ends; one-sided, never ahead."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, angle_difference, wrap_360
from seatrial.analysis.series import (
    local_quadratic,
    smooth_motion,
    smoothing_half_width,
)
from tests.analysis.conftest import table_at, turn_between

SECONDS = np.arange(240.0)


def motion_table(seconds: np.ndarray = SECONDS, **columns: np.ndarray) -> pd.DataFrame:
    """A table of the motion channels, zero where nothing is given."""
    return table_at(seconds, {name: columns.get(name, np.zeros(seconds.size)) for name in POSE_AND_VELOCITY})


@settings(max_examples=40, deadline=None)
@given(
    constant=st.floats(-1e5, 1e5),
    slope=st.floats(-10.0, 10.0),
    curvature=st.floats(-0.1, 0.1),
    half_width=st.floats(3.0, 40.0),
)
def test_quadratics_come_out_exactly(constant: float, slope: float, curvature: float, half_width: float) -> None:
    """Position, speed and acceleration are kept, to the first and last sample."""
    values = constant + slope * SECONDS + curvature * SECONDS**2
    assert local_quadratic(values, half_width) == pytest.approx(values, rel=1e-9, abs=1e-6)


def test_quadratics_are_kept_across_gaps() -> None:
    """What is missing stays missing, and what is beside it is as exact as elsewhere."""
    values = 3.0 + 0.5 * SECONDS - 0.01 * SECONDS**2
    holed = values.copy()
    holed[[0, 50, 51, 52, 53, 54, 120, 239]] = np.nan
    holed[150:190] = np.nan
    smooth = local_quadratic(holed, 10.0)
    assert np.array_equal(np.isnan(smooth), np.isnan(holed))
    present = np.isfinite(holed)
    assert smooth[present] == pytest.approx(values[present], abs=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_too_few_samples_stay_as_they_are(count: int) -> None:
    """No polynomial through four samples is worth more than the samples."""
    values = np.array([5.0, -3.0, 8.0, 1.0])[:count]
    assert np.array_equal(local_quadratic(values, 10.0), values)
    alone = np.full(60, np.nan)
    alone[30] = 7.0
    assert local_quadratic(alone, 10.0)[30] == 7.0


def test_nothing_is_made_of_nothing() -> None:
    assert np.isnan(local_quadratic(np.full(50, np.nan), 10.0)).all()
    assert local_quadratic(np.empty(0), 10.0).size == 0


@pytest.mark.parametrize("period_s", [4.0, 5.0, 6.5, 8.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_waves_are_taken_down_by_ten(period_s: float, phase: float) -> None:
    """The sea's swing about a slow motion is a tenth or less, wherever the fit has both its sides."""
    wave = np.sin(2 * np.pi * SECONDS / period_s + phase)
    inner = slice(10, -10)
    left = local_quadratic(wave, 10.0)[inner]
    assert np.abs(left).max() < 0.1 * np.abs(wave[inner]).max()
    motion = 4.0 + 0.02 * SECONDS
    assert np.abs(local_quadratic(motion + 0.3 * wave, 10.0) - motion)[inner].max() < 0.03


def test_a_slow_turn_is_not_a_wave() -> None:
    """A swing of two minutes is the ship's own: 99 % of it stay."""
    swing = np.sin(2 * np.pi * SECONDS / 120.0)
    assert np.abs(local_quadratic(swing, 10.0) - swing)[10:-10].max() < 0.01


def test_the_width_is_in_seconds_at_any_rate() -> None:
    """Ten samples a second and one give the same motion."""
    fine = np.arange(0.0, 120.0, 0.1)

    def heave(seconds: np.ndarray) -> np.ndarray:
        return np.asarray(np.sin(2 * np.pi * seconds / 100.0) + 0.5 * np.sin(2 * np.pi * seconds / 7.0))

    slow = smooth_motion(motion_table(fine[::10], surge_mps=heave(fine[::10])))["surge_mps"].to_numpy()
    fast = smooth_motion(motion_table(fine, surge_mps=heave(fine)))["surge_mps"].to_numpy()[::10]
    assert np.abs(slow - fast)[10:-10].max() < 0.01


def test_a_heading_through_north_is_no_jump() -> None:
    """A steady turn through 359 to 1 stays what it is, and stays inside 0 to 360."""
    heading = wrap_360(350.0 + 0.25 * SECONDS)
    smooth = smooth_motion(motion_table(heading_deg=heading))["heading_deg"].to_numpy()
    assert turn_between(smooth, heading) < 1e-6
    assert ((smooth >= 0.0) & (smooth < 360.0)).all()


def test_a_swing_about_north_is_a_swing_about_north() -> None:
    """359, 1, 359, 1 averages to north, not to south."""
    heading = np.where(np.arange(240) % 2 == 0, 359.0, 1.0)
    smooth = smooth_motion(motion_table(heading_deg=heading))["heading_deg"].to_numpy()
    assert turn_between(smooth[10:-10], 0.0) < 0.1


@settings(max_examples=25, deadline=None)
@given(turn=st.floats(-720.0, 720.0), north=st.floats(-1e5, 1e5), seed=st.integers(0, 50))
def test_smoothing_goes_with_the_ship(turn: float, north: float, seed: int) -> None:
    """Elsewhere and on another heading the same motion comes out, there and on that heading."""
    random = np.random.default_rng(seed)
    heading, way = np.cumsum(random.normal(0.0, 2.0, 120)), np.cumsum(random.normal(4.0, 0.3, 120))
    seconds = np.arange(120.0)
    here = smooth_motion(motion_table(seconds, heading_deg=wrap_360(heading), north_m=way))
    there = smooth_motion(motion_table(seconds, heading_deg=wrap_360(heading + turn), north_m=way + north))
    assert there["north_m"].to_numpy() - north == pytest.approx(here["north_m"].to_numpy(), abs=1e-6)
    turned = angle_difference(there["heading_deg"].to_numpy(), here["heading_deg"].to_numpy())
    assert turn_between(turned, turn) < 1e-6


def test_a_rotated_track_is_smoothed_to_the_rotated_track() -> None:
    """Smoothing north and east one by one gives what smoothing along any other axes would."""
    random = np.random.default_rng(4)
    north, east = np.cumsum(random.normal(3.0, 0.5, (2, 240)), axis=1)
    sine, cosine = np.sin(0.7), np.cos(0.7)
    straight = smooth_motion(motion_table(north_m=north, east_m=east))
    turned = smooth_motion(motion_table(north_m=cosine * north - sine * east, east_m=sine * north + cosine * east))
    expected = cosine * straight["north_m"] - sine * straight["east_m"]
    assert turned["north_m"].to_numpy() == pytest.approx(expected.to_numpy(), abs=1e-9)


def test_smoothing_is_linear_and_the_same_in_mirrored_time() -> None:
    """A filter without a phase: backwards in time the result is the result backwards."""
    random = np.random.default_rng(5)
    first, second = random.normal(size=(2, 100))
    both = local_quadratic(2.0 * first - second, 10.0)
    assert both == pytest.approx(2.0 * local_quadratic(first, 10.0) - local_quadratic(second, 10.0))
    assert local_quadratic(first[::-1].copy(), 10.0) == pytest.approx(local_quadratic(first, 10.0)[::-1])


def test_only_motion_is_smoothed_and_the_table_is_left_alone() -> None:
    """Thrusters and wind are not given back; the table that was given is as it was."""
    table = motion_table(surge_mps=np.sin(SECONDS)).assign(port_rpm=100.0)
    before = table.copy()
    smooth = smooth_motion(table)
    assert list(smooth.columns) == list(POSE_AND_VELOCITY)
    assert smooth.index.equals(table.index)
    pd.testing.assert_frame_equal(table, before)


def test_on_a_model_the_fit_reaches_less_far_and_follows_her_turns() -> None:
    """A zigzag as a 3 m model does it: her yaw rate swings in 15 s."""
    swing = 3.0 * np.sin(2.0 * np.pi * SECONDS / 15.0)
    table = motion_table(yaw_rate_dps=swing)
    off = [
        np.abs(smooth_motion(table, smoothing_half_width(length_m))["yaw_rate_dps"] - swing)[20:-20].max()
        for length_m in (3.0, 30.0, 300.0)
    ]
    assert off[0] < 0.1 * off[1]
    assert off[1] == off[2]
