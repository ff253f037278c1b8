"""Sensor faults found from contradictions between sensors, without a ship model.

Speeds over ground rotated by the heading must integrate to the track, and yaw rates to the heading, whatever
moves the ship. So the filter is run with process noise so large that the dynamics carry no information, and
only sensor effects are searched. Water, hull and thrusters cannot show here; nor can errors that all sensors
share, such as a common delay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.acceptance import Acceptance, acceptance_tests
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise, columns_of
from seatrial.hybrid.diagnosis.evidence import ColumnLayout, Evidence, NormalEquations, evidence_of, gram_matrices
from seatrial.hybrid.diagnosis.linearise import (
    DT_S,
    LinearModel,
    ModelWithEffects,
    Signature,
    by_stage,
    linear_model,
    sensor_readings,
    signatures,
    time_varying_signatures,
)
from seatrial.hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from seatrial.hybrid.diagnosis.nuisance_basis import tolerances
from seatrial.hybrid.diagnosis.select_effects import (
    CLOSE,
    Coordinates,
    fitted_coordinates,
    has_converged,
    rivals_of,
    search_effects,
)
from seatrial.hybrid.diagnosis.time_varying import TimeVaryingEffect, time_varying_among
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.vessel.sensors import HEADING

_UNKNOWN = np.array([3.0, 3.0, 0.3])  # m/s, m/s, rad/s: uninformative change of speed in a second
_SHARED = (10.0, 10.0, 10.0, 10.0)  # s, m, m, deg: undetectable error shared by all sensors
_DELAYS = {"position_delay": (0, 1), "heading_delay": (2,), "speed_delay": (3, 4, 5)}
_MAX_LINEARISATIONS = 6
_SETTLED = 0.5  # of a standard error


def find_contradictions(log: Log, model: ModelWithEffects, noise: DisturbanceNoise) -> Acceptance | None:
    """The sensor effects that explain the contradictions in ``log``, selected like others; None without any.

    ``model`` provides the catalogue, and its plant the motion within a second; its effects are left out.
    """
    sensors = motion_sensors(log, model)
    if not sensors:
        return None
    file_free = {name: free for name, free in model.given.items() if name in sensors}
    evidence, names = _select_sensor_effects(log, ModelWithEffects(model.base, sensors, given=file_free), noise)
    names = _commoner(evidence, names)
    tests = {name: acceptance_tests(evidence, names, name) for name in names}
    return Acceptance(names, tests, evidence) if names else None


def _commoner(evidence: Evidence, names: tuple[str, ...]) -> tuple[str, ...]:
    """Of two indistinguishable effects the first in the catalogue, the more common one; the other is its rival."""
    order = list(evidence.names)
    for name in names:
        less = rivals_of(evidence, names, name)
        for rival in order[: order.index(name)]:
            swapped = tuple(rival if effect == name else effect for effect in names)
            if less.get(rival, np.inf) < CLOSE and acceptance_tests(evidence, swapped, rival).accepted:
                names = swapped
                break
    return names


def motion_sensors(log: Log, model: ModelWithEffects) -> Catalogue:
    """The sensor effects on the reported motion, not those of the wind sensor."""
    sensors = [name for name, effect in model.catalogue.items() if effect.kind == "sensor"]
    plain = replace(model, at={})
    seen = {
        signature.effect
        for signature in signatures(log, plain, log.nominal, sensors)
        if np.abs(signature.E).max() > 0.0
    }
    return {name: model.catalogue[name] for name in sensors if name in seen}


def without_dynamics(noise: DisturbanceNoise, linear: LinearModel) -> DisturbanceNoise:
    """``noise`` with process noise so large that the speed of one second says nothing about the next."""
    answer = np.array([np.median(np.abs(linear.B[:, 3 + axis, axis])) for axis in range(3)])
    surge, sway, yaw = (float(level) for level in _UNKNOWN / np.maximum(answer, 1e-12))
    return replace(noise, gust=(surge, sway, yaw))


def _select_sensor_effects(
    log: Log, model: ModelWithEffects, noise: DisturbanceNoise
) -> tuple[Evidence, tuple[str, ...]]:
    """The effects that pass their tests, at the linearisation that explains the data best.

    Linearising about the result usually helps; but a long delay, made by interpolation between seconds, is no
    better than the first-order effect of a short one.
    """
    excluded: frozenset[str] = frozenset()
    at: Coordinates = {}
    best: tuple[float, Evidence, tuple[str, ...]] | None = None
    for _ in range(_MAX_LINEARISATIONS):
        evidence = evidence_of(_normal_equations(log, replace(model, at=at), noise))
        names = search_effects(evidence, excluded)
        failed = [test for test in (acceptance_tests(evidence, names, name) for name in names) if not test.accepted]
        if failed:
            excluded |= {max(failed, key=lambda test: test.p_value).name}
        else:
            score = evidence.log_odds(names) - 0.5 * float(evidence.inner[0, 0])
            if best is None or score > best[0]:
                best = score, evidence, names
            if has_converged(evidence, names, at, _SETTLED):
                break
        at = fitted_coordinates(evidence, search_effects(evidence, excluded))
    return best[1:] if best else (evidence, ())


def _normal_equations(log: Log, model: ModelWithEffects, noise: DisturbanceNoise) -> NormalEquations:
    """The regression on the sensor effects only; the tolerance of each sensor is a nuisance.

    The trajectory of the linearisation is kept: sensor errors do not change where the ship went, only what is
    reported of it. Errors shared by all sensors (one delay, another reference point or axis) are nuisances too:
    they show only where speeds change nonlinearly within a second.
    """
    plain = replace(model, at={}).plant()
    linear = linear_model(log, plain)
    seen = by_stage(log, model, sensor_readings, linear.origin) + _between(log, linear.origin)
    linear = replace(linear, observed=log.measured - seen)
    effects, shared = _signatures(log, model, linear.origin)
    tolerated = tolerances(log, model.catalogue, effects)
    scales = np.array([model.catalogue[signature.effect].free_scale[signature.coordinate] for signature in effects])
    layout = ColumnLayout(tuple(signature.effect for signature in effects), scales, tolerated, wind=len(shared))
    loose = without_dynamics(noise, linear)
    gram = gram_matrices(log, linear, columns_of(linear, [*effects, *shared]), loose)
    indices = np.flatnonzero(tolerated > 0.0)
    nuisance = np.concatenate([1 + indices, layout.first_wind + np.arange(len(shared))])
    return NormalEquations(
        log, model, 0.0, linear, tuple(effects), layout, np.zeros(3), loose, gram,
        nuisance, np.concatenate([tolerated[indices], _SHARED]),
    )  # fmt: skip


def _signatures(log: Log, model: ModelWithEffects, origin: Floats) -> tuple[list[Signature], list[Signature]]:
    """The signatures of sensor effects and of errors shared by all sensors, by kinematics where these suffice."""
    none, kinematic = np.zeros_like(origin), _by_kinematics(log, origin)
    effects = []
    steady = [name for name, effect in model.catalogue.items() if not isinstance(effect, TimeVaryingEffect)]
    for signature in signatures(log, model, origin, steady):
        readings = kinematic.get((signature.effect, signature.coordinate))
        effects.append(signature if readings is None else replace(signature, D=none, E=readings))
    effects += time_varying_signatures(log, time_varying_among(model.catalogue, model.catalogue), effects)
    shared = [
        ("all_late", np.sum([kinematic[name, 0] for name in _DELAYS], axis=0)),
        ("all_ahead", kinematic["position_antenna_offset", 0] + kinematic["speed_sensor_offset", 0]),
        ("all_to_starboard", kinematic["position_antenna_offset", 1] + kinematic["speed_sensor_offset", 1]),
        ("all_turned", kinematic["speed_sensor_rotation", 0] + np.deg2rad(1.0) * (np.arange(6) == HEADING)),
    ]
    return effects, [Signature(name, 0, none, shift) for name, shift in shared]


def _by_kinematics(log: Log, origin: Floats) -> dict[tuple[str, int], Floats]:
    """The change of the readings [T, 6] with a second of delay, a metre of lever arm and a degree of rotation."""
    late = (_between(log, origin, DT_S) - _between(log, origin, -DT_S)) / (2.0 * DT_S)
    psi, u, v, r = (origin + _between(log, origin)).T[HEADING:]
    nil, cosine, sine, degree = np.zeros_like(r), np.cos(psi), np.sin(psi), np.deg2rad(1.0)
    result = {(name, 0): np.where(np.isin(np.arange(6), indices), late, 0.0) for name, indices in _DELAYS.items()}
    for name, coordinate, columns in (
        ("position_antenna_offset", 0, (cosine, sine, nil, nil, nil, nil)),
        ("position_antenna_offset", 1, (-sine, cosine, nil, nil, nil, nil)),
        ("speed_sensor_offset", 0, (nil, nil, nil, nil, r, nil)),
        ("speed_sensor_offset", 1, (nil, nil, nil, -r, nil, nil)),
        ("speed_sensor_rotation", 0, (nil, nil, nil, degree * v, -degree * u, nil)),
    ):
        result[name, coordinate] = np.column_stack(columns)
    return result


def _between(log: Log, origin: Floats, late_s: float = 0.0) -> Floats:
    """The mean state ``late_s`` before the sampling times less that at the full second [T, 6], by kinematics.

    Speeds change linearly within a second; a ship model that lacks a force would bend them.
    """
    inside = np.diff(log.block) == 0
    gained = np.diff(origin[:, 3:], axis=0) * inside[:, None]
    ahead, behind = np.vstack([gained, np.zeros((1, 3))]), np.vstack([np.zeros((1, 3)), gained])
    first, last = np.append(True, ~inside), np.append(~inside, True)
    ahead[last], behind[first] = behind[last], ahead[first]
    around = np.empty((len(log), STEPS_PER_SECOND + 1, 6))
    for quarter in range(STEPS_PER_SECOND + 1):
        tau = quarter / STEPS_PER_SECOND - 0.5 - late_s
        change = behind if tau < 0.0 else ahead
        u, v, r = (origin[:, 3:] + 0.5 * tau * change).T  # the mean over that interval
        psi = origin[:, 2] + 0.5 * tau * (origin[:, 5] + 0.25 * tau * change[:, 2])
        around[:, quarter, 0] = tau * (u * np.cos(psi) - v * np.sin(psi))
        around[:, quarter, 1] = tau * (u * np.sin(psi) + v * np.cos(psi))
        around[:, quarter, 2] = tau * r
        around[:, quarter, 3:] = tau * change
    return np.asarray(np.einsum("tcq,tqc->tc", log.weight, around))
