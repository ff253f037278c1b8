"""What no effect of the catalogue says: forces and errors that depend on heading, place, time or azimuth.

Each family is a handful of columns that together can take any smooth shape. They name nothing: they say whether
something remains when the named effects have had their say, along which axis, and on what it depends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Floats, Ints
from hybrid.diagnosis.linearise import Signature
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.tolerance import operating_point

AXES = ("surge", "sway", "yaw")

GRANTED = {"heading": 0.1, "place": 0.1, "time": 0.1, "azimuth": 1.0}
"""What the model may be off by in each way, as a share of the tolerance: only what depends on speeds and thrusters
is the model's own; but no sea is quite even."""

OPERATION = "operating point"
"""What the forces depend on that the model's tolerance stands for: speeds and thruster settings."""

FORMS = ("speed", "drift", "turning", "thrust", "side thrust")
"""With what a named effect may change that is rather a relative of the one that it is named for."""

_HARMONICS, _TIMES = 4, 6
_PLACES = {1.5: 8, 5.0: 16}
"""So many waves over the place, by how many radians they turn over the area's size: banks are narrow."""

_EDGES = (0.25, 0.5, 0.75)  # of the largest azimuth that is used
_FAINT = 0.1  # of a basis's largest singular value: a shape that is so faint is the difference of two alike
_STAYS = 0.01  # of its usual range: what changes less says nothing of a change
_SEED = 20260902
_VARIED = {
    "ocean_current": ("place", "time"),
    "thrust_loss_port": ("time",),
    "thrust_loss_starboard": ("time",),
    "heading_bias": ("heading", "time"),
    "yaw_rate_bias": ("time",),
}
"""Effects of the catalogue that, varying, are none of it: a sheared current, a thrust that fades."""


@dataclass(frozen=True, slots=True)
class Beyond:
    """Force features [T, M], what each depends on, and the signatures of effects that vary."""

    features: Floats
    depends: tuple[str, ...]
    varied: tuple[Signature, ...]


def beyond(log: Log, origin: Floats, effects: Sequence[Signature], forms: Sequence[str] = ()) -> Beyond:
    """The families for a log. Constants are in none of them: they are effects of the catalogue.

    Effects in ``forms`` may also change with each of :data:`FORMS`, as a relative of theirs does that is in no
    catalogue: a resistance for one that goes with the thrust.
    """
    bases = {
        "heading": _even(_harmonics(origin[:, 2], _HARMONICS)),
        "place": _even(_places(origin[:, :2])),
        "time": _even(_times(log.time_s)),
        "azimuth": _even(_hinges(log)),
    }
    forces = np.hstack(list(bases.values()))
    depends = tuple(name for name, basis in bases.items() for _ in range(basis.shape[1]))
    asked = _forms(log, origin)
    shapes = {**bases, "heading": _even(_harmonics(origin[:, 2], 2)), **asked}
    varied = [
        Signature(f"{each.effect}*{name}", number, each.D * shape[:, None], each.E * shape[:, None])
        for each in effects
        for name in (*_VARIED.get(each.effect, ()), *(asked if each.effect in forms else ()))
        for number, shape in enumerate(shapes[name].T)
    ]
    return Beyond(forces, depends, tuple(varied))


def _even(shapes: Floats) -> Floats:
    """Shapes that span the same, orthogonal and of unit mean square over the log [T, at most M].

    So the squares of their coefficients add up to the mean square of what they make together.
    """
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


def _forms(log: Log, origin: Floats) -> dict[str, Floats]:
    """Each of :data:`FORMS` [T, 1], away from its mean, of unit mean square; without those that hardly change."""
    surge, sway, yaw_rate, port, port_side, starboard, starboard_side, _ = operating_point(log, origin).T
    every = (surge, np.abs(sway), np.abs(yaw_rate), port + starboard, np.abs(port_side + starboard_side))
    return {
        name: ((values - values.mean()) / values.std())[:, None]
        for name, values in zip(FORMS, every, strict=True)
        if values.std() > _STAYS
    }


def _hinges(log: Log) -> Floats:
    """How far the azimuths are beyond certain angles to either side [T, 6], zero below."""
    angle = log.controls[:, :, (1, 3)].mean(axis=(1, 2))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    largest = float(np.quantile(np.abs(angle), 0.99))
    return np.column_stack(
        [np.maximum(side * angle - share * largest, 0.0) for side in (1.0, -1.0) for share in _EDGES]
    )
