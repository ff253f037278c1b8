"""The diagnosis' equations of ships with a propeller and a rudder, of whatever size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.estimate_noise import _first_guess
from seatrial.hybrid.diagnosis.linearise import (
    ModelWithEffects,
    acting_settings,
    lags_of,
    linear_model,
    model_of,
    plays_of,
    signatures,
)
from seatrial.hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from seatrial.hybrid.effects import catalogue_of
from seatrial.hybrid.simulation.trial import SimulationNoise, usual_noise
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant
from tests.hybrid.diagnosis.log_by_hand import a_log
from tests.hybrid.froude import froude_scaled

ESSO = load_vessel("esso_osaka_3m")


def orders(seconds: int) -> Floats:
    """Shaft and rudder [4 seconds, 2], a little different in each quarter of a second."""
    t = np.arange(seconds * STEPS_PER_SECOND) / STEPS_PER_SECOND
    return np.column_stack([15.0 + 3.0 * np.sin(t / 9.0), 0.4 * np.sin(t / 4.0)])


def run_of(plant: Plant, root: float = 1.0, seconds: int = 60) -> Log:
    """A run of Esso Osaka, or of the same ship ``root`` squared times as large."""
    start = (0.0, 0.0, 0.4, 0.7 * root, 0.01 * root, 0.0)
    return a_log(plant, seconds, controls=orders(seconds) / [root, 1.0], start=start, wind_mps=1.0)


@pytest.mark.parametrize("scale", [1.0, 40.0])
def test_forces_move_the_ship_by_her_own_mass(scale: float) -> None:
    """What a newton does in a second, by differences, is what it does to her mass, less what the water takes."""
    plant = bare_plant(froude_scaled(ESSO, scale))
    B = linear_model(run_of(plant, scale**0.5), plant).B
    surge_kg, sway_kg = plant.mass_kg - plant.Xud, plant.mass_kg - plant.Yvd
    assert np.median(B[:, 3, 0]) * surge_kg == pytest.approx(1.0, abs=0.1)
    assert np.median(B[:, 4, 1]) * sway_kg == pytest.approx(0.9, abs=0.15)


def test_a_lag_of_every_actuator_is_a_lag_of_all() -> None:
    plant = bare_plant(ESSO)
    log = run_of(plant)
    own = plant.shifted(propeller_lag_s=0.8, rudder_response_lag_s=0.8)
    every = plant.shifted(thruster_lag_s=0.8)
    assert lags_of(own) == lags_of(every) == (0.8, 0.8)
    for one, other in zip(acting_settings(log, own), acting_settings(log, every), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_rudder_with_play_stands_off_by_half_of_it_on_the_side_it_came_from() -> None:
    """As recorded, with noise and without, and as the simulator moves it: the shaft is not touched."""
    plant = bare_plant(ESSO)
    own, half = catalogue_of(ESSO)["backlash_rudder"].apply(plant, {"width_deg": 4.0}), np.deg2rad(2.0)
    assert plays_of(own) == pytest.approx((0.0, 2.0 * half))
    helm = np.repeat([0.0, 0.3, 0.28, -0.2, -0.15], 48)  # the third turns back within the play
    steps = np.column_stack([np.full(240, 15.0), helm])
    log = run_of(own)
    off = acting_settings(replace(log, controls=steps.reshape(60, 4, 2)), own)[0].reshape(-1, 2) - steps
    expected = np.repeat([0.0, -half, 0.02 - half, half, -0.05 + half], 48)
    np.testing.assert_allclose(off[:, 1], expected, atol=1e-12)
    assert not off[:, 0].any()
    noisy = steps + np.random.default_rng(1).normal(size=(240, 1)) * [0.0, 0.004]
    off = (acting_settings(replace(log, controls=noisy.reshape(60, 4, 2)), own)[0].reshape(-1, 2) - noisy)[:, 1]
    assert np.abs(off - expected).mean() < 0.1 * half


def test_a_run_with_play_leaves_nothing_to_a_model_that_has_it() -> None:
    """The simulator drags its rudder along; the same play found from the record explains the whole motion."""
    plant = bare_plant(ESSO)
    own = catalogue_of(ESSO)["backlash_rudder"].apply(plant, {"width_deg": 6.0})
    helm = np.repeat([0.0, 0.2, 0.1, -0.3, 0.0], 48)
    log = a_log(own, 60, controls=np.column_stack([np.full(240, 15.0), helm]), start=(0.0, 0.0, 0.4, 0.7, 0.0, 0.0))
    left, right = (np.abs(linear_model(log, each).defect[1:-1]).max(axis=0) for each in (plant, own))
    assert right[5] < 1e-3 * left[5]


def test_what_acts_in_a_part_of_a_log_hangs_on_what_was_before() -> None:
    """A rudder that came from port before the part begins stands off there; a lag goes on from where it was."""
    plant = bare_plant(ESSO)
    own = plant.shifted(rudder_play_rad=0.1, propeller_lag_s=3.0)
    log = run_of(own)
    late = np.arange(len(log)) >= 30
    for whole, part in zip(acting_settings(log, own), acting_settings(log.subset(late), own), strict=True):
        np.testing.assert_array_equal(whole[late], part)
    twice = log.subset(late).subset(np.arange(30) % 2 == 0)
    np.testing.assert_array_equal(acting_settings(twice, own)[0], acting_settings(log, own)[0][30::2])


def test_an_actuator_that_lags_is_late_by_what_it_lags() -> None:
    """A shaft that speeds up at an even rate acts as it was its time constant ago; the rudder is not touched."""
    plant = bare_plant(ESSO)
    ramp = np.column_stack([10.0 + 0.1 * np.arange(240) / STEPS_PER_SECOND, np.zeros(240)])
    log = replace(run_of(plant), controls=ramp.reshape(60, STEPS_PER_SECOND, 2))
    _, acting = acting_settings(log, plant.shifted(propeller_lag_s=2.0))
    late_s = (log.controls[:, 0, 0] - acting[:, 0]) / 0.1
    np.testing.assert_allclose(late_s[20:], 2.0, atol=0.3)
    np.testing.assert_array_equal(acting[:, 1], log.controls[:, 0, 1])


def test_a_lag_is_seen_beyond_the_second_in_which_an_order_changes() -> None:
    """The signature of a rudder's lag moves the yaw rate as long as the lag lasts."""
    plant, catalogue = bare_plant(ESSO), catalogue_of(ESSO)
    log = run_of(plant)
    step = np.where(np.arange(60) < 20, -0.3, 0.3)
    controls = log.controls.copy()
    controls[:, :, 1] = step[:, None]
    model = ModelWithEffects(plant, catalogue, at={"lag_rudder": (2.0,)})
    (lag,) = signatures(replace(log, controls=controls), model, log.nominal, ["lag_rudder"])
    moved = np.abs(lag.D[:, 5])
    assert moved[21:23].min() > 0.1 * moved.max()
    assert moved[:19].max() < 1e-3 * moved.max()


def test_noise_goes_with_the_ship() -> None:
    """R/V Gunnerus' is what it was; that of a model is finer, and so are the gusts that a search begins with."""
    assert usual_noise(28.9) == SimulationNoise()
    model = usual_noise(3.0)
    assert model.position_m == pytest.approx(SimulationNoise().position_m / 8.0)
    assert model.heading_deg == SimulationNoise().heading_deg
    log, gunnerus = run_of(bare_plant(ESSO)), model_of(load_vessel("gunnerus_short"), {})
    assert _first_guess(log, gunnerus).gust == (300.0, 300.0, 3000.0)
    assert _first_guess(log, model_of(ESSO, {})).gust == (300.0 / 8.0**3, 300.0 / 8.0**3, 3000.0 / 8.0**4)
