"""Sensors that contradict each other are found without a ship model, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linear_model
from seatrial.hybrid.diagnosis.log import Log, log_of
from seatrial.hybrid.diagnosis.regression import evidence_of
from seatrial.hybrid.diagnosis.result import SensorContradiction
from seatrial.hybrid.diagnosis.verdict import (
    _normal_equations,
    find_contradictions,
    motion_sensors,
    without_dynamics,
)
from seatrial.hybrid.effects import CATALOGUE, apply_effects
from seatrial.hybrid.report.diagnosis import contradictions
from seatrial.hybrid.vessel.plant import Plant
from tests.benchmarks.other_ship.trial import make_trial
from tests.hybrid.diagnosis.noisy_log import QUIET, noisy_log


def consistency(log: Log, model: ModelWithEffects, noise: DisturbanceNoise) -> tuple[SensorContradiction, ...]:
    """What is said of the sensors, the surest first; nothing where they agree."""
    found = find_contradictions(log, model, noise)
    return contradictions(found) if found else ()


HIDDEN = {
    "heading_bias": {"angle_deg": 1.5},
    "speed_sensor_rotation": {"angle_deg": -2.0},
    "speed_scale": {"factor": 0.97},
    "sway_bias": {"speed_mps": 0.12},
    "yaw_rate_bias": {"rate_dps": 0.05},
    "position_delay": {"seconds": 0.5},
    "speed_delay": {"seconds": 0.4},
    "position_antenna_offset": {"forward_m": 3.0, "starboard_m": -1.0},
}
TWINS = {"heading_bias", "speed_sensor_rotation"}, {"position_antenna_offset", "speed_sensor_offset"}
"""Of these, only the difference can be seen without a ship model."""


@pytest.mark.parametrize("name", HIDDEN)
def test_a_sensors_error_is_found_and_sized(plant: Plant, name: str) -> None:
    """As itself, or as its twin with the twin said; at its size within its own error."""
    effect = CATALOGUE[name]
    found = consistency(noisy_log(effect.apply(plant, HIDDEN[name]), 1), ModelWithEffects(plant, CATALOGUE), QUIET)
    assert len(found) == 1
    (first,) = found
    assert name == first.effect or name in first.alike
    assert first.p_value < 1e-3
    assert name.replace("_", " ") in first.sentence
    if name == first.effect:
        off = np.array(first.free) - np.array(effect.free_coordinates(HIDDEN[name]))
        assert (
            np.abs(off)
            < 3.0 * np.array(first.standard_errors) + 0.02 * np.abs(effect.free_coordinates(HIDDEN[name]))
        ).all()
    for twins in TWINS:
        if first.effect in twins:
            assert twins - {first.effect} <= set(first.alike)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_twins_the_commoner_is_named(plant: Plant, seed: int) -> None:
    """An antenna off its place rather than a speed sensor off the other way; which it is nobody can see."""
    hidden = {"forward_m": 3.0, "starboard_m": -1.0}
    log = noisy_log(CATALOGUE["position_antenna_offset"].apply(plant, hidden), seed)
    (found,) = consistency(log, ModelWithEffects(plant, CATALOGUE), QUIET)
    assert found.effect == "position_antenna_offset"
    assert "speed_sensor_offset" in found.alike


@pytest.mark.parametrize(
    "hidden",
    [
        {},
        {"ocean_current": {"speed_mps": 0.4, "direction_deg": 40.0}},
        {"hull_lengthening": {"length_m": 2.0}, "thrust_loss_port": {"fraction": 0.2}},
    ],
)
def test_physics_does_not_move_it(plant: Plant, hidden: dict[str, dict[str, float]]) -> None:
    """Water, hull and thrusters move the ship; they set no sensor against another."""
    log = noisy_log(apply_effects(plant, hidden), 1)
    assert consistency(log, ModelWithEffects(plant, CATALOGUE), QUIET) == ()


def test_both_at_once(plant: Plant) -> None:
    """A sensor's error is sized the same whether or not there is a current."""
    hidden = {"ocean_current": {"speed_mps": 0.3, "direction_deg": 200.0}, "speed_scale": {"factor": 1.04}}
    (found,) = consistency(noisy_log(apply_effects(plant, hidden), 3), ModelWithEffects(plant, CATALOGUE), QUIET)
    assert found.effect == "speed_scale"
    assert found.free[0] == pytest.approx(0.04, abs=3.0 * found.standard_errors[0])


def test_what_the_vessels_file_says_already_is_no_contradiction(plant: Plant) -> None:
    """An error that the model holds is not found again; more of it is, and its sentence gives the whole."""
    given = {"speed_scale": (0.03,)}
    log = noisy_log(CATALOGUE["speed_scale"].apply(plant, {"factor": 1.03}), 4)
    assert consistency(log, ModelWithEffects(plant, CATALOGUE, file_effects=given), QUIET) == ()
    log = noisy_log(CATALOGUE["speed_scale"].apply(plant, {"factor": 1.06}), 4)
    (found,) = consistency(log, ModelWithEffects(plant, CATALOGUE, file_effects=given), QUIET)
    assert found.free[0] == pytest.approx(0.03, abs=3.0 * found.standard_errors[0])
    assert "1.06" in found.sentence


def test_only_sensors_of_the_motion_are_asked(plant: Plant) -> None:
    """Wind vanes and thrusters' feedback report nothing of the motion."""
    log = noisy_log(plant, 1, legs=1)
    sensors = motion_sensors(log, ModelWithEffects(plant, CATALOGUE))
    assert {"heading_bias", "position_delay", "yaw_rate_scale"} <= set(sensors)
    assert not {"wind_direction_bias", "wind_speed_scale", "command_delay", "ocean_current"} & set(sensors)
    without = {name: each for name, each in CATALOGUE.items() if each.kind != "sensor"}
    assert consistency(log, ModelWithEffects(plant, without), QUIET) == ()


def test_without_dynamics_a_speed_says_nothing_of_the_next(plant: Plant) -> None:
    """In a second any ship may gain metres a second."""
    log = noisy_log(plant, 1, legs=1)
    linear = linear_model(log, plant)
    loose = without_dynamics(QUIET, linear)
    gained = np.abs(linear.B[:, [3, 4, 5], [0, 1, 2]]) * loose.gust
    assert (gained > [1.0, 1.0, 0.1]).all()
    assert replace(loose, gust=QUIET.gust) == QUIET


def test_what_all_sensors_share_is_no_contradiction(plant: Plant) -> None:
    """Forces that are not even within a second do not pass for one delay of all, and that for three of each."""
    table, _ = make_trial(seed=6, sea="calm", programme="zigzags", duration_s=900.0)
    log = log_of([table])
    evidence = evidence_of(
        _normal_equations(
            log,
            ModelWithEffects(plant, motion_sensors(log, ModelWithEffects(plant, CATALOGUE))),
            DisturbanceNoise(),
        )
    )
    delays = ("position_delay", "heading_delay", "speed_delay")
    for name in delays:
        fit = evidence.fit([name])
        assert abs(fit.values[0]) < 1.5 * np.sqrt(fit.covariance[0, 0])
    common = evidence.fit(delays).covariance.sum() / len(delays) ** 2
    assert np.sqrt(common) > 1.0  # s: nobody knows by how much all are late


@pytest.mark.parametrize(
    "shared",
    [
        {name: {"seconds": 0.5} for name in ("position_delay", "heading_delay", "speed_delay")},
        {
            name: {"forward_m": 4.0, "starboard_m": 1.0}
            for name in ("position_antenna_offset", "speed_sensor_offset")
        },
        {name: {"angle_deg": 2.0} for name in ("heading_bias", "speed_sensor_rotation")},
    ],
)  # fmt: skip
def test_another_point_or_axis_of_the_ship_is_no_error(plant: Plant, shared: dict[str, dict[str, float]]) -> None:
    """Whoever moves the reference of all sensors moves no sensor against another."""
    log = noisy_log(apply_effects(plant, shared), 5)
    assert consistency(log, ModelWithEffects(plant, CATALOGUE), QUIET) == ()
