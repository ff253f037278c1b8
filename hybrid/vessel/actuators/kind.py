"""What a kind of actuator is to the rest: its entry in a vessel file, its numbers, its controls, its equations.

The compiled core sees an actuator as one row of numbers: the code of its kind, the place of its first control,
and the kind's numbers in their order. What stays constant while the controls are held is worked out once a step
into a row of working numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import pi
from typing import Any

from pydantic import StrictFloat as Number

from seatrial.analysis.compiling import compiled
from seatrial.hybrid.vessel.effect import Effect

KIND, CONTROL, FIRST_NUMBER = range(3)
"""Where the kind's code, the first control's place and the first number stand in an actuator's row."""


RPM_PER_RPS = 60.0
PLAY = "play_rad"
"""The slot of the play [rad] between the angle that an actuator reports and its true one: its whole width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorEntry:
    """An ``[[actuator]]`` of a vessel file: its name, its kind, how far ahead of the body axes' origin it is."""

    name: str
    kind: str
    x_m: Number


@dataclass(frozen=True, slots=True)
class Drive:
    """How one control follows its order: a first-order lag [s], and limits of the order and of its rate [SI]."""

    lag_s: float
    limit: float = float("inf")
    rate: float = float("inf")


@dataclass(frozen=True, slots=True)
class ActuatorModel:
    """A kind of actuator.

    ``entry`` is the class of its table in a vessel file. ``numbers`` are what a plant holds of it, in the order
    of its row: those of the entry and, with their neutral values, ``slots`` that effects set. ``shared`` are the
    numbers that a plant of several alike calls by their own name, without the actuator's. ``units`` turn the
    kind's channels into controls in SI, ``labels`` name these, ``angles`` tells which of them are angles,
    ``drives`` how they follow orders, ``still`` how much feedback of a held one moves and ``alike`` what is not
    another setting. ``keeps_sign`` are the shared numbers, ``adapted`` the own ones, that are learned of a ship.
    ``hold(p, row, control, first, work)`` and ``force(p, i, work, u, v, r) -> X, Y, N`` are compiled, ``row`` and
    ``i`` an actuator's row and its number; ``work`` is how many working numbers they share, in ``force`` those of
    all actuators, [actuators, working numbers]. ``effects(names)`` are the effects of a ship's actuators of this
    kind. ``numbers_of(entry)`` are numbers that follow from the entry; those named ``positive`` are above zero;
    ``lag`` is the slot of its own lag [s].
    """

    entry: type[ActuatorEntry]
    numbers: tuple[str, ...]
    labels: tuple[str, ...]
    units: tuple[float, ...]
    angles: tuple[bool, ...]
    work: int
    hold: Callable[..., None]
    force: Callable[..., tuple[float, float, float]]
    still: tuple[float, ...]
    alike: tuple[float, ...]
    drives: Callable[[Any], tuple[Drive, ...]]
    effects: Callable[[tuple[str, ...]], tuple[Effect, ...]]
    slots: Mapping[str, float] = field(default_factory=dict)
    shared: frozenset[str] = frozenset()
    keeps_sign: tuple[str, ...] = ()
    adapted: tuple[str, ...] = ()
    numbers_of: Callable[[Any], dict[str, float]] = lambda entry: {}
    positive: tuple[str, ...] = ()
    lag: str = ""


@compiled
def wrapped(angle_rad: float) -> float:
    """The same direction within half a turn of zero."""
    return float(angle_rad - 2.0 * pi * round(angle_rad / (2.0 * pi)))


def columns(numbers: tuple[str, ...]) -> range:
    """Where a kind's numbers stand in its row."""
    return range(FIRST_NUMBER, FIRST_NUMBER + len(numbers))
