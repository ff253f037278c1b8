"""The nuisance basis: what may be wrong with model, sensors and sea without being an effect of the catalogue.

Three kinds of columns stand beside the effects' own in the design matrix, each with a standard deviation.

- The model's tolerance. No reference model is exact: with the sensors' noise alone as the yardstick every trial
  would show a missing effect. So the model is granted an error of a stated share of the force range and of
  unknown shape: a Gaussian process over speeds and thruster settings, by random Fourier features (Rahimi and
  Recht 2007).
- Errors that every sensor and drive has anyway: the catalogue's own ``tolerance``, the wind that a vane reports
  in still air, and settings that are recorded now and then only.
- Families of smooth forces over heading, place, time and azimuth, and effects that vary. They name nothing:
  they say whether something remains when the named effects have had their say, along which axis, and on what it
  depends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from acquisition.core.actuators import KINDS as CHANNEL_KINDS
from acquisition.core.arrays import Floats, Ints
from analysis.compiling import FAST, Record
from hybrid.diagnosis.linearise import Model, Signature, by_stage, next_states
from hybrid.diagnosis.log import Log
from hybrid.effects import Catalogue
from hybrid.vessel.actuators import KINDS, angle_columns
from hybrid.vessel.dynamics import actuators_force, hold, scratch_for
from hybrid.vessel.effect import growth
from hybrid.vessel.plant import PHYSICS_STAMP, Plant, pack
from hybrid.vessel.sensors import SURGE, SWAY, YAW_RATE

AXES = ("surge", "sway", "yaw")

TOLERATED_SHARE = {"heading": 0.1, "place": 0.1, "time": 0.1, "azimuth": 1.0}
"""What the model may be off by in each way, as a share of the tolerance: only what depends on speeds and thrusters
is the model's own; but no sea is quite even."""

OPERATION = "operating point"
"""What the forces depend on that the model's tolerance stands for: speeds and thruster settings."""

INTERACTIONS = ("speed", "drift", "turning", "thrust", "side thrust")
"""With what a named effect may change that is rather a relative of the one that it is named for."""

_HARMONICS, _TIMES = 4, 6
_PLACES = {1.5: 8, 5.0: 16}
"""So many waves over the place, by how many radians they turn over the area's size: banks are narrow."""

_EDGES = (0.25, 0.5, 0.75)  # of the largest azimuth that is used
_FAINT = 0.1  # of a basis's largest singular value: a shape that is so faint is the difference of two alike
_STAYS = 0.01  # of its usual range: what changes less says nothing of a change
_SEED = 20260902
_VARYING = {"ocean_current": ("place", "time"), "heading_bias": ("heading", "time"), "yaw_rate_bias": ("time",)}
"""Effects of the catalogue that, varying, are none of it: a sheared current, a thrust that fades."""


@dataclass(frozen=True, slots=True)
class NuisanceBasis:
    """Force features [T, M], what each depends on, and the signatures of effects that vary."""

    features: Floats
    depends: tuple[str, ...]
    varying: tuple[Signature, ...]


def nuisance_basis(
    log: Log, origin: Floats, effects: Sequence[Signature], interactions: Sequence[str] = ()
) -> NuisanceBasis:
    """The families for a log. Constants are in none of them: they are effects of the catalogue.

    Effects in ``interactions`` may also change with each of :data:`INTERACTIONS`, as a relative of theirs does that
    is in no catalogue: a resistance for one that goes with the thrust.
    """
    bases = {
        "heading": _even(_harmonics(origin[:, 2], _HARMONICS)),
        "place": _even(_places(origin[:, :2])),
        "time": _even(_times(log.time_s)),
        "azimuth": _even(_hinges(log)),
    }
    forces = np.hstack(list(bases.values()))
    depends = tuple(name for name, basis in bases.items() for _ in range(basis.shape[1]))
    asked = _interactions(log, origin)
    shapes = {**bases, "heading": _even(_harmonics(origin[:, 2], 2)), **asked}
    varying = [
        Signature(f"{each.effect}*{name}", number, each.D * shape[:, None], each.E * shape[:, None])
        for each in effects
        for name in (*_variations(each.effect), *(asked if each.effect in interactions else ()))
        for number, shape in enumerate(shapes[name].T)
    ]
    return NuisanceBasis(forces, depends, tuple(varying))


def _variations(effect: str) -> tuple[str, ...]:
    """With what an effect may vary: see :data:`_VARYING`; a thrust that fades, of each actuator by itself."""
    of_one = effect.startswith("thrust_loss_") and not effect.endswith(("_both", "_all"))
    return ("time",) if of_one else _VARYING.get(effect, ())


def _even(shapes: Floats) -> Floats:
    """Shapes that span the same, orthogonal and of unit mean square over the log [T, at most M].

    So the squares of their coefficients add up to the mean square of what they make together.
    """
    if not shapes.shape[1]:
        return shapes
    left, size, _ = np.linalg.svd(shapes, full_matrices=False)
    kept = size > _FAINT * max(float(size[0]), 1e-9)
    return np.asarray(left[:, kept] * np.sqrt(len(shapes)))


def _harmonics(angle_rad: Floats, number: int) -> Floats:
    """Cosines and sines of multiples of an angle [T, 2 number], of unit mean square."""
    order = np.arange(1, number + 1)
    phase = angle_rad[:, None] * order
    return np.asarray(np.sqrt(2.0) * np.hstack([np.cos(phase), np.sin(phase)]))


def _times(time_s: Ints) -> Floats:
    """Half waves over the whole of the time [T, 6]."""
    share = (time_s - time_s[0]) / max(float(time_s[-1] - time_s[0]), 1.0)
    return np.asarray(np.sqrt(2.0) * np.cos(np.pi * share[:, None] * np.arange(1, _TIMES + 1)))


def _places(position_m: Floats) -> Floats:
    """Smooth functions of the place [T, 24], long and short waves over the area."""
    away = position_m - position_m.mean(axis=0)
    extent = max(float(np.sqrt((away**2).sum(axis=1).mean())), 1.0)
    generator = np.random.default_rng(_SEED)
    shapes = []
    for pace, number in _PLACES.items():
        wave = generator.standard_normal((2, number)) * pace
        phase = generator.uniform(0.0, 2.0 * np.pi, number)
        shapes.append(np.sqrt(2.0) * np.cos(away / extent @ wave + phase))
    together = np.hstack(shapes)
    return np.asarray(together - together.mean(axis=0))


def _interactions(log: Log, origin: Floats) -> dict[str, Floats]:
    """Each of :data:`INTERACTIONS` [T, 1], away from its mean, of unit mean square.

    Those that hardly change are left out.
    """
    surge, sway, yaw_rate, *pushes = operating_point(log, origin).T
    ahead, aside = np.zeros(len(log)), np.zeros(len(log))
    for turns in thrusts(log).values():
        parts = [pushes.pop(0) for _ in turns]
        if len(parts) == 2:  # what turns pushes along and across the ship; what does not is left out
            ahead, aside = ahead + parts[0], aside + parts[1]
    every = (surge, np.abs(sway), np.abs(yaw_rate), ahead, np.abs(aside))
    return {
        name: ((values - values.mean()) / values.std())[:, None]
        for name, values in zip(INTERACTIONS, every, strict=True)
        if values.std() > _STAYS
    }


def _hinges(log: Log) -> Floats:
    """How far what steers is beyond certain angles to either side [T, 6], zero below; [T, 0] without any.

    Angles count as a stern azimuth's, positive to port: a rudder's has the other sign.
    """
    angles = angle_columns(log.actuators)
    if not angles:
        return np.zeros((len(log), 0))
    to_port = [-CHANNEL_KINDS[each.kind].turns for each in log.actuators if any(KINDS[each.kind].angles)]
    angle = (log.controls[:, :, angles] * to_port).mean(axis=(1, 2))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    largest = float(np.quantile(np.abs(angle), 0.99))
    return np.column_stack(
        [np.maximum(side * angle - share * largest, 0.0) for side in (1.0, -1.0) for share in _EDGES]
    )


FEATURES = 200
"""So many a force: with 40 the tolerance is too poor a family, and every second trial shows a false effect."""

FEW = 50
"""So many are enough for the noise, and where a model is off by far more than it is granted."""

_FEATURES_SEED = 20260901
_LEAST_SHARE = 0.3


def force_range(log: Log, plant: Plant, origin: Floats) -> Floats:
    """The largest forces [3] (N, N, N m; 99 of 100 seconds are below) that the actuators exert in a trial.

    Sideways and in yaw at least a share of what they push ahead would make there: a trial of straight runs is
    no proof of a model that is exact across.
    """
    forces = _actuator_forces(pack(plant)[0], origin, log.controls.mean(axis=1))
    surge, sway, yaw = np.quantile(np.abs(forces), 0.99, axis=0)
    lever = max(abs(plant.number(f"{each.name}_x_m")) for each in plant.actuators)
    sway = max(sway, _LEAST_SHARE * surge)
    return np.array([surge, sway, max(yaw, _LEAST_SHARE * surge * lever)])


def features(log: Log, origin: Floats, number: int = FEATURES) -> Floats:
    """Random Fourier features [T, number] of unit mean square, of speeds and thruster settings."""
    inputs = operating_point(log, origin)
    generator = np.random.default_rng(_FEATURES_SEED)
    frequency = generator.standard_normal((inputs.shape[1], number))
    phase = generator.uniform(0.0, 2.0 * np.pi, number)
    return np.asarray(np.sqrt(2.0) * np.cos(inputs @ frequency + phase))


def thrusts(log: Log) -> dict[str, tuple[Floats, ...]]:
    """Each actuator's thrust by its name, by its square-law size [T]: ahead and aside where it turns."""
    found, first, mean = dict[str, tuple[Floats, ...]](), 0, log.controls.mean(axis=1).T
    for each in log.actuators:
        angles = KINDS[each.kind].angles
        push = mean[first] * np.abs(mean[first])
        angle = mean[first + angles.index(True)] if any(angles) else None
        found[each.name] = (push,) if angle is None else (push * np.cos(angle), push * np.sin(angle))
        first += len(angles)
    return found


def operating_point(log: Log, origin: Floats) -> Floats:
    """What a model error may depend on, each over its usual range: [T, quantities].

    Surge, sway, yaw rate; for each actuator the square-law size of its thrust, along and across where it turns.
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
    """The standard deviation of what is tolerated of each signature's free coordinate [P], 0 for none."""
    result = []
    for each in signatures:
        effect = catalogue[each.effect]
        size = effect.parameters[each.coordinate % len(effect.parameters)].tolerance
        of_setting = effect.family == "clock" and effect.kind == "actuator"
        if of_setting and log.input_hold == "line":  # it may have changed at any time between two records
            size = max(size, 0.5 * log.setting_step_s)
        result.append(size if effect.chart == "linear" else 0.0)
    return np.array(result)


def wind_error_mps(model: Model) -> float:
    """What an anemometer is off by in each direction: its noise has a mean, and the ship disturbs the air."""
    return _WIND_MPS * growth("m/s", model.scale)


def wind_errors(log: Log, model: Model, origin: Floats) -> list[Signature]:
    """Signatures of 1 m/s more wind from the north, the east, ahead and starboard, by recording."""
    none, step_mps = np.zeros_like(origin), wind_error_mps(model)
    north, east = log.wind[:, 1] * np.cos(log.wind[:, 0]), log.wind[:, 1] * np.sin(log.wind[:, 0])
    cosine, sine = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    one, nil = np.ones(len(log)), np.zeros(len(log))
    ways = ((one, nil), (nil, one), (cosine, sine), (-sine, cosine))
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
    return [replace(each, D=each.D * (log.recording == one)[:, None]) for one in recordings for each in result]
