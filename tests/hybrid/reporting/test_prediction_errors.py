"""Errors along and across the track, their quantiles, and whether regions hold what they say: against hand and
chance."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.prediction.window_sets import PAST_S, PredictionWindows
from seatrial.hybrid.report.prediction_errors import (
    COLUMNS,
    consecutive_windows,
    error_components,
    predicted_motion,
    region_calibration,
    speeds_of_tracks,
)


def horizons_of(
    track: np.ndarray, leg: list[str] | None = None, starts_s: list[int] | None = None
) -> PredictionWindows:
    """Windows of nothing but measured tracks [N, H+1, 3], one every horizon."""
    count = len(track)
    begin = np.array(starts_s or [each * (track.shape[1] - 1) for each in range(count)])
    start_ns = pd.Timestamp("2026-01-01", tz="UTC").value + begin * NANO
    legs = np.array(leg or ["a"] * count)
    start = np.concatenate([track[:, 0], np.zeros((count, 3))], axis=1)
    wind, control, trial = np.zeros((count, 2)), np.zeros((count, 5)), np.array(["trial"] * count)
    past = np.zeros((count, PAST_S + 1, 13))
    return PredictionWindows(start, track, wind, control, trial, legs, start_ns, past)


def straight(heading_rad: float, speed_mps: float = 3.0, seconds: int = 10) -> np.ndarray:
    time = np.arange(seconds + 1.0)
    way = speed_mps * time
    return np.stack([way * np.cos(heading_rad), way * np.sin(heading_rad), np.full_like(time, heading_rad)], -1)[
        None
    ]


@given(st.floats(-np.pi, np.pi), st.floats(-5, 5), st.floats(-5, 5))
def test_an_offset_is_along_and_across_whatever_the_heading(heading: float, ahead: float, aside: float) -> None:
    measured = straight(heading)
    predicted = measured.copy()
    predicted[..., 0] += ahead * np.cos(heading) - aside * np.sin(heading)
    predicted[..., 1] += ahead * np.sin(heading) + aside * np.cos(heading)
    errors = error_components(predicted, horizons_of(measured))
    np.testing.assert_allclose(errors.along, ahead, atol=1e-9)
    np.testing.assert_allclose(errors.across, aside, atol=1e-9)
    np.testing.assert_allclose(errors.distance, np.hypot(ahead, aside), atol=1e-9)
    np.testing.assert_allclose(errors.speed, 0.0, atol=1e-9)


def test_headings_are_off_the_short_way_round() -> None:
    measured = straight(np.deg2rad(179.0))
    predicted = measured.copy()
    predicted[..., 2] = np.deg2rad(-179.0)
    np.testing.assert_allclose(error_components(predicted, horizons_of(measured)).heading, 2.0)


def test_quantiles_are_of_sizes() -> None:
    measured = np.repeat(straight(0.0), 10, axis=0)
    predicted = measured.copy()
    predicted[..., 1] += np.linspace(-1.0, 0.8, 10)[:, None]
    errors = error_components(predicted, horizons_of(measured))
    np.testing.assert_allclose(errors.by_second("across", 0.5), np.median(np.abs(np.linspace(-1.0, 0.8, 10))))
    np.testing.assert_allclose(errors.by_second("across", 0.9), 0.82)


def test_a_turning_circle_has_the_speeds_it_was_made_of() -> None:
    """Surge 4, sway -0.5 m/s and 2 deg/s in closed form; differences over 2 s see them to their third order."""
    rate, surge, sway, time = np.deg2rad(2.0), 4.0, -0.5, np.arange(31.0)
    turn = rate * time
    north = (surge * np.sin(turn) - sway * (1 - np.cos(turn))) / rate
    east = (sway * np.sin(turn) + surge * (1 - np.cos(turn))) / rate
    speeds = speeds_of_tracks(np.stack([north, east, turn], -1)[None])[0, 1:-1]
    np.testing.assert_allclose(speeds, np.broadcast_to([surge, sway, rate, np.hypot(surge, sway)], speeds.shape),
                               rtol=2e-3, atol=2e-3)  # fmt: skip


@given(st.lists(st.integers(0, 200), min_size=1, max_size=40, unique=True))
def test_windows_one_after_another_never_overlap_and_none_more_would_fit(starts: list[int]) -> None:
    track = np.zeros((len(starts), 16, 3))
    horizons = horizons_of(track, starts_s=sorted(starts))
    chosen = consecutive_windows(horizons)
    begins = np.array(sorted(starts))
    assert (np.diff(begins[chosen]) >= 15).all()
    for each in set(range(len(starts))) - set(chosen.tolist()):
        assert (np.abs(begins[chosen] - begins[each]) < 15).any()


def test_predicted_motion_is_in_the_units_of_the_channels() -> None:
    measured = np.concatenate([straight(np.deg2rad(-90.0)), straight(np.deg2rad(45.0))])
    table = predicted_motion(horizons_of(measured), measured, np.array([0, 1]))
    assert list(table.columns) == [*COLUMNS, "window"]
    assert table["heading_deg"].iloc[0] == pytest.approx(270.0)
    np.testing.assert_allclose(table["surge_mps"], 3.0)
    np.testing.assert_allclose(table["sway_mps"], 0.0, atol=1e-9)
    assert len(table) == 22


def test_regions_of_the_right_size_hold_95_percent_and_their_transform_is_even() -> None:
    """Normal errors and the circle that holds 95 % of them: PICP at 95 %, PIT even, and twice as wide twice as
    much."""
    random = np.random.default_rng(3)
    measured = np.repeat(straight(0.3), 4000, axis=0)
    predicted = measured.copy()
    predicted[:, 1:, :2] += random.normal(size=(4000, 10, 2))
    region_m = np.full((4000, 10, 2), np.sqrt(-2.0 * np.log(0.05)))
    legs = [str(number // 20) for number in range(4000)]
    found = region_calibration(predicted, region_m, horizons_of(measured, legs))
    assert found.picp == pytest.approx(0.95, abs=0.015)
    assert ((found.low < 0.95) & (found.high > 0.95)).sum() >= 8
    counts, _ = np.histogram(found.pit, bins=10, range=(0.0, 1.0))
    assert counts / counts.sum() == pytest.approx(0.1, abs=0.006)
    wide = region_calibration(predicted, 2.0 * region_m, horizons_of(measured, legs))
    assert wide.pinaw == pytest.approx(2.0 * found.pinaw)
    way_m = 3.0 * np.arange(1, 11)  # straight ahead with 3 m/s
    assert found.pinaw == pytest.approx(2.0 * region_m[0, :, 0] / way_m)


def test_of_a_ship_that_lies_still_and_of_one_leg_no_share_is_told() -> None:
    """No way covered: no width over it. One leg: no interval."""
    still = np.zeros((5, 11, 3))
    found = region_calibration(still, np.ones((5, 10, 2)), horizons_of(still))
    assert np.isnan(found.pinaw).all()
    assert found.legs == 1
    assert np.isnan(found.low).all()
    assert np.isnan(found.high).all()


def test_the_last_second_of_the_speed_is_as_noisy_as_the_others() -> None:
    """A perfect prediction of noisy positions: no second stands out."""
    random = np.random.default_rng(1)
    measured = np.repeat(straight(0.4), 2000, axis=0)
    noisy = measured + np.array([0.5, 0.5, 0.0]) * random.normal(size=measured.shape)
    speed = error_components(measured, horizons_of(noisy)).speed
    spread = speed.std(axis=0)
    assert spread.max() < 1.15 * spread.min()


def test_legs_and_not_windows_are_what_is_independent() -> None:
    """Two legs, one inside and one outside: nothing is known of the share, however many windows they have."""
    measured = np.repeat(straight(0.0), 200, axis=0)
    predicted = measured.copy()
    predicted[:, 1:, 0] += np.repeat([0.5, 2.0], 100)[:, None]
    legs = ["a"] * 100 + ["b"] * 100
    found = region_calibration(predicted, np.ones((200, 10, 2)), horizons_of(measured, legs))
    assert found.picp == pytest.approx(0.5)
    assert (found.low[0], found.high[0]) == (0.0, 1.0)
