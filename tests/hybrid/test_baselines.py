"""Baselines against numerical integration, against each other, and against the symmetries of the sea."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from seatrial.hybrid.prediction.baselines import constant_velocity, distances, score, simulate_reference
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.windows_by_hand import moved, random_windows, turned, windows_at

SECONDS = 30
speeds = st.floats(-8.0, 8.0)
turn_rates = st.one_of(st.floats(-0.5, 0.5), st.sampled_from([0.0, 1e-300, 1e-12, -1e-9, 1e-6]))


@settings(max_examples=60, deadline=None)
@given(heading=st.floats(-np.pi, np.pi), surge=speeds, sway=speeds, rate=turn_rates)
def test_constant_velocity_is_the_integral_of_the_turning_motion(
    heading: float, surge: float, sway: float, rate: float
) -> None:
    """Any motion, a yaw rate of nothing or next to nothing among them."""

    def velocity(time_s: float, position: np.ndarray) -> np.ndarray:
        return turned(np.array([surge, sway]), heading + rate * time_s)

    exact = solve_ivp(velocity, (0.0, SECONDS), [10.0, -20.0], rtol=1e-10, atol=1e-10,
                      t_eval=np.arange(SECONDS + 1.0))  # fmt: skip
    (track,) = constant_velocity(windows_at([10.0, -20.0, heading, surge, sway, rate], SECONDS))
    assert track[:, :2] == pytest.approx(exact.y.T, abs=1e-6)
    assert track[:, 2] == pytest.approx(heading + rate * np.arange(SECONDS + 1))


def test_a_whole_turn_ends_where_it_began() -> None:
    (track,) = constant_velocity(windows_at([3.0, 4.0, 1.0, 5.0, -1.0, 2 * np.pi / SECONDS], SECONDS))
    assert track[-1, :2] == pytest.approx([3.0, 4.0], abs=1e-9)
    radius = np.hypot(5.0, 1.0) * SECONDS / (2 * np.pi)
    assert np.ptp(track[:, 0]) == pytest.approx(2 * radius, rel=0.01)


def test_a_positive_yaw_rate_turns_to_starboard() -> None:
    """North-bound, bow turning to starboard: the ship ends up in the east."""
    (track,) = constant_velocity(windows_at([0.0, 0.0, 0.0, 5.0, 0.0, 0.01], SECONDS))
    assert track[-1, 1] > 10.0


@given(north=st.floats(-1e4, 1e4), east=st.floats(-1e4, 1e4), turn=st.floats(-7.0, 7.0))
def test_constant_velocity_goes_with_the_ship(north: float, east: float, turn: float) -> None:
    """Somewhere else, on another heading, it is the same track there."""
    windows = random_windows(5, 20)
    there = constant_velocity(moved(windows, north, east, turn))
    assert there[..., :2] == pytest.approx(
        turned(constant_velocity(windows)[..., :2], turn) + np.array([north, east]), abs=1e-6
    )


@settings(max_examples=20, deadline=None)
@given(turn=st.floats(-7.0, 7.0))
def test_the_reference_knows_no_compass(plant: Plant, turn: float) -> None:
    """Ship and wind turned together sail the same track, turned: there is no current in the plant."""
    windows = random_windows(6, 20, seed=3)
    here, there = simulate_reference(windows, plant), simulate_reference(moved(windows, 100.0, -50.0, turn), plant)
    assert there[..., :2] == pytest.approx(turned(here[..., :2], turn) + np.array([100.0, -50.0]), abs=1e-5)
    assert there[..., 2] == pytest.approx(here[..., 2] + turn, abs=1e-7)


def test_the_reference_is_the_simulator_with_everything_held(plant: Plant) -> None:
    windows = random_windows(7, SECONDS, seed=1)
    tracks = simulate_reference(windows, plant)
    assert tracks.shape == (7, SECONDS + 1, 3)
    for number in range(len(windows)):
        controls, wind = (np.tile(each[number], (SECONDS, 1)) for each in (windows.control, windows.wind))
        alone = simulate(plant, windows.start[number], controls, wind, 1.0)
        assert tracks[number] == pytest.approx(alone[:, :3], abs=1e-9)


def test_a_window_that_leaves_the_range_spoils_no_other(plant: Plant) -> None:
    """Thirty metres a second is no speed of this ship; her neighbours are as they would be without her."""
    windows = random_windows(4, 20, seed=2)
    start = windows.start.copy()
    start[1, 3] = 30.0
    tracks = simulate_reference(replace(windows, start=start), plant)
    assert np.isnan(tracks[1, -1]).all()
    others = [0, 2, 3]
    assert np.array_equal(tracks[others], simulate_reference(windows.subset(np.array(others)), plant))


def test_both_start_where_the_window_starts(plant: Plant) -> None:
    windows = random_windows(6, 15, seed=5)
    for tracks in (constant_velocity(windows), simulate_reference(windows, plant)):
        assert np.array_equal(tracks[:, 0], windows.start[:, :3])


def test_scores_of_a_known_error() -> None:
    """Three metres north and four east off at every second are five metres; a whole turn is no heading error."""
    windows = random_windows(8, 10)
    off = windows.track + np.array([3.0, -4.0, 2 * np.pi + np.deg2rad(2.0)])
    found = score(off, windows.track)
    assert (found.mean_distance_m, found.end_distance_m) == pytest.approx((5.0, 5.0))
    assert (found.mae_north_m, found.mae_east_m) == pytest.approx((3.0, 4.0))
    assert found.heading_error_deg == pytest.approx(2.0)
    assert found.by_second == pytest.approx((5.0,) * 10)


def test_the_start_is_no_prediction() -> None:
    """Second 0 is given, so that it neither helps nor harms a score."""
    windows = random_windows(8, 10)
    off = windows.track.copy()
    off[:, 0] += 100.0
    assert score(off, windows.track).mean_distance_m == 0.0
    assert distances(off, windows.track).shape == (8, 10)


@given(seed=st.integers(0, 100))
def test_the_mean_distance_is_the_mean_by_second(seed: int) -> None:
    windows, other = random_windows(9, 6, seed), random_windows(9, 6, seed + 1)
    found = score(other.track, windows.track)
    assert found.mean_distance_m == pytest.approx(np.mean(found.by_second))
    assert found.end_distance_m == pytest.approx(found.by_second[-1])
    assert max(found.mae_north_m, found.mae_east_m) <= found.mean_distance_m <= found.mae_north_m + found.mae_east_m
