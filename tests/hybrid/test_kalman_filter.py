"""The model as a Kalman filter: its gains, and the start states that it knows."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, expm, solve_discrete_are

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import second_by_second
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import distances, simulate_reference
from seatrial.hybrid.prediction.dataset import dataset_of
from seatrial.hybrid.prediction.kalman_filter import (
    WAVE_DAMPING,
    filtered_starts,
    kalman_gains,
    pace_of_length,
    wave_transition,
)
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.windows_by_hand import moved, voyages, windows_at

power = st.floats(-3.0, 2.0)
DEVIATION = np.array([0.1, 0.1, 0.003, 0.05, 0.05, 0.002])
"""Of usual sensors: position [m], heading [rad], speeds [m/s], yaw rate [rad/s]."""


@settings(max_examples=30, deadline=None)
@given(speed=power, force=power, position=power, kept=st.floats(0.5, 1.0), wave=power, radps=st.floats(0.5, 2.0))
def test_in_the_long_run_gains_solve_the_riccati_equation(
    speed: float, force: float, position: float, kept: float, wave: float, radps: float
) -> None:
    """Kalman's recursion ends at the steady filter, which scipy finds another way."""
    still = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept]])
    swinging = expm(np.array([[0.0, 1.0], [-(radps**2), -2.0 * WAVE_DAMPING * radps]]))
    step, noise = block_diag(still, swinging), np.diag([10.0**position, 1.0])
    seeing = np.hstack([np.eye(2, 3), np.eye(2)])
    walk = np.diag([0.0, 10.0**speed, 10.0**force, 0.0, 10.0**wave])
    steady = solve_discrete_are(step.T, seeing.T, walk, noise)
    expected = steady @ seeing.T @ np.linalg.inv(seeing @ steady @ seeing.T + noise)
    found = kalman_gains(10.0**speed, 10.0**force, 10.0**position, kept, 1500, 10.0**wave, radps)[-1]
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_a_swing_in_waves_is_no_speed() -> None:
    """A ship that lies still in a swell of one period: the filter that knows of waves sees her lie still, and where
    the swell takes her next; the one that does not takes its crests for speed.
    """
    radps, seconds = 1.0, np.arange(60.0)
    measured = np.stack([np.sin(radps * seconds), radps * np.cos(radps * seconds)], axis=1)
    speeds, foretold = [], []
    for walk in (1.0, 0.0):
        gains = kalman_gains(1e-4, 1e-6, 1.0, 0.99, 60, walk, radps)
        step = block_diag(np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 0.99]]), wave_transition(radps))
        state = np.zeros(5)
        for gain, seen_now in zip(gains, measured, strict=True):
            state = step @ state
            state = state + gain @ (seen_now - state[:2] - state[3:])
        speeds.append(abs(state[1]))
        foretold.append(abs((step @ state)[3] - np.sin(radps * 60.0)))
    assert speeds[0] < 0.2 * speeds[1]
    assert foretold[0] < 0.3 < foretold[1]


def test_a_steady_speed_is_the_mean_of_its_measurements() -> None:
    """Where nothing wanders and positions are worth nothing, the k-th measurement has the weight 1 / k."""
    gains = kalman_gains(0.0, 0.0, 1e9, 1.0, 40)
    assert gains[:, 1, 1] == pytest.approx(1.0 / np.arange(2.0, 42.0), rel=1e-6)
    assert gains[:, 2] == pytest.approx(0.0)


@settings(max_examples=30, deadline=None)
@given(speed=power, force=power)
def test_an_exact_position_is_believed(speed: float, force: float) -> None:
    """Position follows what is measured without error all the way, whatever the speeds say."""
    gains = kalman_gains(10.0**speed, 10.0**force, 0.0, 0.99, 30)
    assert gains[:, 0, 0] == pytest.approx(1.0)
    assert gains[:, 0, 1] == pytest.approx(0.0, abs=1e-9)


def starts_off(plant: Plant, ship: Plant, noise: Floats, swing_mps: float = 0.0) -> tuple[Floats, Floats]:
    """The rms errors [6] of what is measured and of what is filtered at second 0, of 60 ships measured with noise
    [6], in waves that swing surge, sway and yaw rate at any phase."""
    windows = voyages(ship, 60, 1, 4)
    chance, past = np.random.default_rng(5), windows.past.copy()
    past[..., :6] += noise * chance.normal(size=past[..., :6].shape)
    phase = chance.uniform(0.0, 2.0 * np.pi, (len(past), 1)) - np.arange(past.shape[1])
    past[..., 3:6] += swing_mps * np.array([1.0, 1.0, 0.02]) * np.cos(phase)[..., None]
    found = filtered_starts(replace(windows, past=past, start=past[:, 0, :6].copy()), plant).start
    return tuple(np.sqrt(np.mean((each - windows.start) ** 2, axis=0)) for each in (past[:, 0, :6], found))


def test_a_ship_that_is_her_model_is_known_exactly(plant: Plant) -> None:
    """Measured without noise, and after a shift of her pods: to the step of the integration."""
    _, found = starts_off(plant, plant, 0.0 * DEVIATION)
    assert (found < 1e-3 * np.array([1.0, 1.0, 0.1, 1.0, 1.0, 0.1])).all()


def test_a_third_of_the_noise_and_more_is_taken_off(plant: Plant) -> None:
    """On a ship with a fifth less thrust than her model too, whose bias force the filter has to find."""
    ship = plant.replaced(thrust_nn=0.8 * plant.number("thrust_nn"))
    for each in (plant, ship):
        measured, found = starts_off(plant, each, DEVIATION)
        assert (found[3:] < 0.67 * measured[3:]).all()
        assert (found[:3] < 1.2 * measured[:3]).all()


def test_a_swing_in_waves_is_taken_off_the_start(plant: Plant) -> None:
    measured, found = starts_off(plant, plant, 0.2 * DEVIATION, 0.3)
    assert (found[3:] < 0.4 * measured[3:]).all()


def test_without_a_past_the_measured_state_stays(plant: Plant) -> None:
    windows = windows_at([[1.0, 2.0, 3.0, 4.0, 0.5, 0.01]], 5)
    assert np.array_equal(filtered_starts(windows, plant).start, windows.start)


def test_where_she_is_and_how_she_heads_does_not_matter(plant: Plant) -> None:
    windows = voyages(plant, 12, 5)
    windows = replace(windows, past=windows.past + 0.01)
    there = filtered_starts(moved(windows, 300.0, -200.0, 1.0), plant)
    again = moved(filtered_starts(windows, plant), 300.0, -200.0, 1.0)
    assert there.start == pytest.approx(again.start, abs=1e-6)


def test_a_ship_with_other_actuators_is_refused(plant: Plant) -> None:
    other = replace(windows_at([[0.0] * 6], 5), actuators=(Actuator("main", "rudder"),))
    with pytest.raises(InputError):
        filtered_starts(other, plant)


def test_a_small_fast_craft_is_followed(plant: Plant) -> None:
    """A craft of 2 m at 2 m/s, of whose model a step of a second would make infinity: known as well as measured."""
    table, _ = simulate_trial("otter_2m", "calm", "zigzag", 240.0, 2.0, 1)
    craft = vessel_plant(load_vessel("otter_2m"))
    tables = {"zigzag": second_by_second(partial(resample, table, 1.0))}
    windows = dataset_of(tables, 10, 5, any_commands=True, length_m=2.0).windows
    known = windows.past[:, 30, 0] == windows.past[:, 30, 0]
    found = filtered_starts(windows.subset(known), craft)
    assert np.abs(found.start - windows.start[known])[:, 3:].max() < 0.3
    assert distances(simulate_reference(found, craft), found.track).mean() < 1.0


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_the_yaw_rate_of_a_small_craft_follows_its_gyro_where_the_model_lacks_a_moment(share: float) -> None:
    """A share of the moment of a propeller ahead and one astern turns a craft of 2 m by degrees in a second."""
    table, _ = simulate_trial("otter_2m", "calm", "zigzag", 240.0, 5.0, 1)
    craft = vessel_plant(load_vessel("otter_2m"))
    tables = {"zigzag": second_by_second(partial(resample, table, 1.0))}
    windows = dataset_of(tables, 10, 5, any_commands=True, length_m=2.0).windows
    windows = windows.subset(np.isfinite(windows.past[:, 30, 0]))
    lacking = craft.replaced(constant_N_nm=share * 120.0 * 2.0 * 0.395)
    starts = filtered_starts(windows, lacking).start
    assert np.degrees(np.abs(starts - windows.start)[:, 5]).mean() < 1.2


def test_a_ship_of_the_usual_length_and_a_longer_one_have_the_usual_pace() -> None:
    assert pace_of_length(25.0) == pace_of_length(180.0) == 1.0
    assert pace_of_length(25.0 / 4.0) == pytest.approx(2.0)
