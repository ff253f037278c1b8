"""What no effect of the catalogue says: forces and errors that depend on heading, place, time or azimuth.

Each family is a handful of columns that together can take any smooth shape. They name nothing: they say whether
something remains when the named effects have had their say, along which axis, and on what it depends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hybrid.diagnosis.averages import Ints
from hybrid.diagnosis.linearise import Signature
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.tolerance import features
from hybrid.vessel.compiling import Floats

AXES = ("surge", "sway", "yaw")

GRANTED = {"heading": 0.1, "place": 0.1, "time": 0.1, "azimuth": 1.0}
"""What the model may be off by in each way, as a share of the tolerance: only what depends on speeds and thrusters
is the model's own; but no sea is quite even."""

OPERATION = "operating point"
"""What the form of a named effect may depend on: speeds and thruster settings."""

_HARMONICS, _TIMES, _PLACES, _OPERATIONS = 4, 6, 16, 8
_SLOW = 0.7  # how fast the form of a named effect may change over the range of speeds and settings
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

    Effects in ``forms`` may also vary with speeds and thruster settings, as a relative of theirs does that is in no
    catalogue.
    """
    bases = {
        "heading": _harmonics(origin[:, 2], _HARMONICS),
        "place": _places(origin[:, :2]),
        "time": _times(log.time_s),
        "azimuth": _hinges(log),
    }
    forces = np.hstack(list(bases.values()))
    depends = tuple(name for name, basis in bases.items() for _ in range(basis.shape[1]))
    shapes = {**bases, "heading": _harmonics(origin[:, 2], 2), OPERATION: _operations(log, origin)}
    varied = [
        Signature(f"{each.effect}*{name}", number, each.D * shape[:, None], each.E * shape[:, None])
        for each in effects
        for name in (*_VARIED.get(each.effect, ()), *([OPERATION] if each.effect in forms else []))
        for number, shape in enumerate(shapes[name].T)
    ]
    return Beyond(forces, depends, tuple(varied))


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
    """Smooth functions of the place [T, 16], their waves some of the area's size long."""
    away = position_m - position_m.mean(axis=0)
    extent = max(float(np.sqrt((away**2).sum(axis=1).mean())), 1.0)
    generator = np.random.default_rng(_SEED)
    wave = generator.standard_normal((2, _PLACES)) * 1.5
    phase = generator.uniform(0.0, 2.0 * np.pi, _PLACES)
    shapes = np.sqrt(2.0) * np.cos(away / extent @ wave + phase)
    return np.asarray(shapes - shapes.mean(axis=0))


def _operations(log: Log, origin: Floats) -> Floats:
    """Smooth functions of speeds and thruster settings [T, 8]: the tolerance's, but slow, and without a mean."""
    shapes = features(log, origin, _OPERATIONS, _SLOW)
    return np.asarray(shapes - shapes.mean(axis=0))


def _hinges(log: Log) -> Floats:
    """How far the azimuths are beyond certain angles to either side [T, 6], zero below; of unit mean square."""
    angle = log.controls[:, :, (1, 3)].mean(axis=(1, 2))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    shapes = []
    for side in (1.0, -1.0):
        for share in (0.5, 0.75, 0.9):
            edge = np.quantile(np.abs(angle), share)
            shape = np.maximum(side * angle - edge, 0.0)
            shapes.append(shape / max(float(np.sqrt((shape**2).mean())), 1e-9))
    return np.column_stack(shapes)
