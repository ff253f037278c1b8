"""The nuisance basis: errors of model, sensors and environment that are no effect of the catalogue.

Three kinds of columns accompany the effects in the design matrix, each with a standard deviation:

- The model's tolerance. No reference model is exact: against the sensors' noise alone, every trial would show a
  missing effect. So the model is allowed an error of a given share of the force range and of unknown shape: a
  Gaussian process over speeds and thruster settings, by random Fourier features (Rahimi and Recht 2007).
- Errors that every sensor and drive has: the catalogue's own ``tolerance``, the wind that an anemometer reports
  in still air, and settings that are recorded only now and then.
- Families of smooth forces over heading, position, time and azimuth, and of varying effects. They name nothing:
  they show whether anything remains beside the named effects, along which axis, and what it depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.ship import KINDS as CHANNEL_KINDS
from seatrial.analysis.compiling import FAST, Record
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, Signature, by_stage, next_states
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.vessel.actuators import KINDS, angle_columns
from seatrial.hybrid.vessel.dynamics import actuators_force, hold, scratch_for
from seatrial.hybrid.vessel.effect import growth
from seatrial.hybrid.vessel.plant import PHYSICS_STAMP, Plant, pack
from seatrial.hybrid.vessel.sensors import SURGE, SWAY, YAW_RATE

AXES = ("surge", "sway", "yaw")

TOLERATED_SHARE = {"heading": 0.1, "place": 0.1, "time": 0.1, "azimuth": 1.0}
"""The error allowed in each family, as a share of the tolerance. The model's own error depends on speeds and
thrusters; the others are small, but no sea is uniform."""

OPERATION = "operating point"
"""The dependence of the tolerance's forces: speeds and thruster settings."""

INTERACTIONS = ("speed", "drift", "turning", "thrust", "side thrust")
"""The quantities that a named effect may vary with if the truth is a related effect."""

_HARMONICS, _TIMES = 4, 6
_PLACES = {1.5: 8, 5.0: 16}
"""Number of waves over the position, and by how many radians they turn over the size of the area: banks are
narrow."""

_EDGES = (0.25, 0.5, 0.75)  # of the largest azimuth that is used
_FAINT = 0.1  # of the largest singular value: fainter shapes are differences of nearly equal ones
_STAYS = 0.01  # of its usual range: with less variation nothing can be learned
_SEED = 20260902
_BEFORE_S = 3
_DRIFTS = ("ocean_current", "wave_drift")
"""Effects that come and go and so move the ship: they may vary with the motion of some seconds ago, as a smoothed
one knows the forces of the next seconds. Of seven trials with slow drift of the waves, the mean drift seemed to
vary with the speed sideways in four, and with that of 3 s ago in none."""

_VARYING = {"ocean_current": ("place", "time"), "heading_bias": ("heading", "time"), "yaw_rate_bias": ("time",)}
"""Effects that, when they vary, are no longer in the catalogue: a sheared current, a thrust that fades."""


@dataclass(frozen=True, slots=True)
class NuisanceBasis:
    """Force features [T, M], the quantity that each depends on, and the signatures of varying effects."""

    features: Floats
    depends: tuple[str, ...]
    varying: tuple[Signature, ...]


def nuisance_basis(
    log: Log, origin: Floats, effects: Sequence[Signature], interactions: Sequence[str] = ()
) -> NuisanceBasis:
    """The families for a log. They contain no constants, which are effects of the catalogue.

    Effects in ``interactions`` may also vary with each of :data:`INTERACTIONS`, as a related effect outside the
    catalogue would: a resistance, say, for one that is proportional to the thrust.
    """
    bases = {
        "heading": _even(_harmonics(origin[:, 2], _HARMONICS)),
        "place": _even(_places(origin[:, :2])),
        "time": _even(_times(log.time_s)),
        "azimuth": _even(_hinges(log)),
    }
    forces = np.hstack(list(bases.values()))
    depends = tuple(name for name, basis in bases.items() for _ in range(basis.shape[1]))
    before = np.maximum(np.arange(len(log)) - _BEFORE_S, log.edges[log.block])
    now, earlier = (
        ({}, {}) if not interactions else (_interactions(log, states) for states in (origin, origin[before]))
    )
    shapes = {**bases, "heading": _even(_harmonics(origin[:, 2], 2))}

    def shapes_of(effect: str) -> dict[str, Floats]:
        forms = earlier if effect.split(",")[0] in _DRIFTS else now
        return {name: shapes[name] for name in _variations(effect)} | (forms if effect in interactions else {})

    varying = [
        Signature(f"{signature.effect}*{name}", number, signature.D * shape[:, None], signature.E * shape[:, None])
        for signature in effects
        for name, family in shapes_of(signature.effect).items()
        for number, shape in enumerate(family.T)
    ]
    return NuisanceBasis(forces, depends, tuple(varying))


def _variations(effect: str) -> tuple[str, ...]:
    """The quantities that an effect may vary with (:data:`_VARYING`); thrusts may fade one by one."""
    of_one = effect.startswith("thrust_loss_") and not effect.endswith(("_both", "_all"))
    return ("time",) if of_one else _VARYING.get(effect, ())


def _even(shapes: Floats) -> Floats:
    """An orthogonal basis of the same span, of unit mean square over the log [T, at most M].

    So the sum of squared coefficients is the mean square of their combination.
    """
    if not shapes.shape[1]:
        return shapes
    vectors, size, _ = np.linalg.svd(shapes, full_matrices=False)
    kept = size > _FAINT * max(float(size[0]), 1e-9)
    return np.asarray(vectors[:, kept] * np.sqrt(len(shapes)))


def _harmonics(angle_rad: Floats, number: int) -> Floats:
    """Cosines and sines of multiples of an angle [T, 2 number], of unit mean square."""
    order = np.arange(1, number + 1)
    phase = angle_rad[:, None] * order
    return np.asarray(np.sqrt(2.0) * np.hstack([np.cos(phase), np.sin(phase)]))


def _times(time_s: Ints) -> Floats:
    """Half waves over the whole time span [T, 6]."""
    share = (time_s - time_s[0]) / max(float(time_s[-1] - time_s[0]), 1.0)
    return np.asarray(np.sqrt(2.0) * np.cos(np.pi * share[:, None] * np.arange(1, _TIMES + 1)))


def _places(position_m: Floats) -> Floats:
    """Smooth functions of position [T, 24]: long and short waves over the area."""
    offset = position_m - position_m.mean(axis=0)
    extent = max(float(np.sqrt((offset**2).sum(axis=1).mean())), 1.0)
    generator = np.random.default_rng(_SEED)
    shapes = []
    for pace, number in _PLACES.items():
        wave = generator.standard_normal((2, number)) * pace
        phase = generator.uniform(0.0, 2.0 * np.pi, number)
        shapes.append(np.sqrt(2.0) * np.cos(offset / extent @ wave + phase))
    together = np.hstack(shapes)
    return np.asarray(together - together.mean(axis=0))


def _interactions(log: Log, origin: Floats) -> dict[str, Floats]:
    """Each of :data:`INTERACTIONS` [T, 1], centred, of unit mean square; those that hardly vary are left out."""
    surge, sway, yaw_rate, *pushes = operating_point(log, origin).T
    ahead, aside = np.zeros(len(log)), np.zeros(len(log))
    for turns in thrusts(log).values():
        parts = [pushes.pop(0) for _ in turns]
        if len(parts) == 2:  # turnable actuators push in surge and sway; the others are left out
            ahead, aside = ahead + parts[0], aside + parts[1]
    quantities = (surge, np.abs(sway), np.abs(yaw_rate), ahead, np.abs(aside))
    return {
        name: ((values - values.mean()) / values.std())[:, None]
        for name, values in zip(INTERACTIONS, quantities, strict=True)
        if values.std() > _STAYS
    }


def _hinges(log: Log) -> Floats:
    """Hinge functions of the steering angles beyond certain angles to either side [T, 6]; [T, 0] without any.

    Angles are signed as for a stern azimuth thruster, positive to port; a rudder's sign is reversed.
    """
    angles = angle_columns(log.actuators)
    if not angles:
        return np.zeros((len(log), 0))
    to_port = [
        -CHANNEL_KINDS[actuator.kind].turns for actuator in log.actuators if any(KINDS[actuator.kind].angles)
    ]
    angle = (log.controls[:, :, angles] * to_port).mean(axis=(1, 2))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    largest = float(np.quantile(np.abs(angle), 0.99))
    corners = [(side, share * largest) for side in (1.0, -1.0) for share in _EDGES]
    return np.column_stack([np.maximum(side * angle - corner, 0.0) for side, corner in corners])


FEATURES = 200
"""Features for each force: with 40 the tolerance is too poor a family, and every second trial shows a false
effect."""

FEW = 50
"""Enough for estimating the noise, and for models whose error is far beyond the tolerance."""

_FEATURES_SEED = 20260901
_LEAST_SHARE = 0.3


def force_range(log: Log, plant: Plant, origin: Floats) -> Floats:
    """The actuators' force range in a trial [3] (N, N, N m): the 99th percentile.

    For sway and yaw at least a share of what the surge thrust would make there: a trial of straight runs does
    not prove a model exact in sway.
    """
    forces = _actuator_forces(pack(plant)[0], origin, log.controls.mean(axis=1))
    surge, sway, yaw = np.quantile(np.abs(forces), 0.99, axis=0)
    lever = max(abs(plant.number(f"{actuator.name}_x_m")) for actuator in plant.layout)
    sway = max(sway, _LEAST_SHARE * surge)
    return np.array([surge, sway, max(yaw, _LEAST_SHARE * surge * lever)])


def features(log: Log, origin: Floats, number: int = FEATURES) -> Floats:
    """Random Fourier features [T, number] of unit mean square, over speeds and thruster settings."""
    inputs = operating_point(log, origin)
    generator = np.random.default_rng(_FEATURES_SEED)
    frequency = generator.standard_normal((inputs.shape[1], number))
    phase = generator.uniform(0.0, 2.0 * np.pi, number)
    return np.asarray(np.sqrt(2.0) * np.cos(inputs @ frequency + phase))


def thrusts(log: Log) -> dict[str, tuple[Floats, ...]]:
    """Each actuator's thrust [T] by name, as square-law magnitude: surge, and sway if it can be turned."""
    by_name, first, mean = dict[str, tuple[Floats, ...]](), 0, log.controls.mean(axis=1).T
    for actuator in log.actuators:
        angles = KINDS[actuator.kind].angles
        push = mean[first] * np.abs(mean[first])
        angle = mean[first + angles.index(True)] if any(angles) else None
        by_name[actuator.name] = (push,) if angle is None else (push * np.cos(angle), push * np.sin(angle))
        first += len(angles)
    return by_name


def operating_point(log: Log, origin: Floats) -> Floats:
    """The quantities that a model error may depend on, each over its usual range: [T, quantities].

    Surge, sway, yaw rate; for each actuator its square-law thrust, in surge and sway if it can be turned.
    """
    pushes = [part for parts in thrusts(log).values() for part in parts]
    columns = np.column_stack([origin[:, SURGE : YAW_RATE + 1], *pushes])
    scale = np.maximum(np.quantile(np.abs(columns), 0.95, axis=0), 1e-9)
    return np.asarray(columns / scale)


def _make(stamp: int) -> Callable[[Record, Floats, Floats], Floats]:
    @njit(cache=True, fastmath=FAST, error_model="numpy")
    def actuator_forces(p: Record, states: Floats, controls: Floats) -> Floats:
        """X [N], Y [N], N [N m] of all actuators in still water at each state and control: [T, 3]."""
        forces = np.full((len(states), 3), 0.0 * stamp)
        work = scratch_for(p, controls[0]).work
        for k in range(len(states)):
            hold(p, controls[k], work, 0.0, 0.0)
            u, v, r = states[k, SURGE], states[k, SWAY], states[k, YAW_RATE]
            forces[k, 0], forces[k, 1], forces[k, 2] = actuators_force(p, work, u, v, r)
        return forces

    return actuator_forces  # type: ignore[no-any-return]


_actuator_forces = _make(PHYSICS_STAMP)


_WIND_MPS = 0.3


def tolerances(log: Log, catalogue: Catalogue, signatures: Sequence[Signature]) -> Floats:
    """The tolerated standard deviation of each signature's free coordinate [P], 0 for none."""
    result = []
    for signature in signatures:
        effect = catalogue[signature.effect]
        size = effect.parameters[signature.coordinate % len(effect.parameters)].tolerance
        of_setting = effect.family == "clock" and effect.kind == "actuator"
        if of_setting and log.input_hold == "line":  # it may have changed at any time between two records
            size = max(size, 0.5 * log.setting_step_s)
        result.append(size if effect.chart == "linear" else 0.0)
    return np.array(result)


def wind_error_mps(model: ModelWithEffects) -> float:
    """The error [m/s] of an anemometer in each direction: its noise has a mean, and the ship disturbs the air."""
    return _WIND_MPS * growth("m/s", model.scale)


def wind_errors(log: Log, model: ModelWithEffects, origin: Floats) -> list[Signature]:
    """Signatures of 1 m/s more wind from the north, the east, ahead and starboard, by recording."""
    none, step_mps = np.zeros_like(origin), wind_error_mps(model)
    north, east = log.wind[:, 1] * np.cos(log.wind[:, 0]), log.wind[:, 1] * np.sin(log.wind[:, 0])
    cosine, sine = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    unit, nil = np.ones(len(log)), np.zeros(len(log))
    ways = ((unit, nil), (nil, unit), (cosine, sine), (-sine, cosine))
    result = []
    for number, (to_north, to_east) in enumerate(ways):
        ends = []
        for side in (step_mps, -step_mps):
            n, e = north + side * to_north, east + side * to_east
            air = np.column_stack([np.arctan2(e, n), np.hypot(n, e)])
            ends.append(by_stage(replace(log, wind=air), model, next_states, origin))
        result.append(Signature("wind_error", number, (ends[0] - ends[1]) / (2.0 * step_mps), none))
    recordings = np.unique(log.recording).tolist()
    if len(recordings) == 1:
        return result
    return [
        replace(signature, D=signature.D * (log.recording == recording)[:, None])
        for recording in recordings
        for signature in result
    ]
