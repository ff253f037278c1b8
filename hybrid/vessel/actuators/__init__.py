"""The kinds of actuators, one file each, and the compiled loop's way from a row's kind to its equations.

The compiled core sees an actuator as one row of numbers: the code of its kind, the place of its first control, and
the kind's numbers in their order. What stays constant while the controls are held is worked out once a step into a
row of working numbers. To add a kind: its controls in :data:`seatrial.acquisition.core.ship.KINDS`, and a file of
its name here, like ``waterjet.py``, whose ``DEFINITION`` is an :class:`ActuatorModel`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from math import pi
from typing import Any

import numpy as np
from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import KINDS as RECORDED_KINDS
from seatrial.acquisition.core.ship import Actuators
from seatrial.analysis.compiling import compiled, dispatch_by_code
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


KINDS: dict[str, ActuatorModel] = {name: import_module(f"{__name__}.{name}").DEFINITION for name in RECORDED_KINDS}
"""The kinds by name, each from the file of its name."""

CODES: dict[str, float] = {name: float(code) for code, name in enumerate(KINDS)}
ROW_SIZE = FIRST_NUMBER + max(len(kind.numbers) for kind in KINDS.values())
WORK_SIZE = max(kind.work for kind in KINDS.values())
_WIDEST = max(len(kind.units) for kind in KINDS.values())
CONTROLS_OF = np.array([len(kind.units) for kind in KINDS.values()])
"""How many controls an actuator of each kind has, by its code."""

LAG_COLUMN = np.array([
    FIRST_NUMBER + kind.numbers.index(kind.lag) if kind.lag else -1 for kind in KINDS.values()
])  # fmt: skip
"""Where in its row an actuator of each kind has a lag of its own; -1 for none."""

PLAY_COLUMN = np.array([
    FIRST_NUMBER + kind.numbers.index(PLAY) if PLAY in kind.numbers else -1 for kind in KINDS.values()
])  # fmt: skip
"""Where in its row an actuator of each kind has the play of its angle; -1 for none."""

IS_ANGLE = np.array([[*kind.angles, *[False] * (_WIDEST - len(kind.angles))] for kind in KINDS.values()])
"""Which controls of each kind are angles, [kinds, most controls]."""


def control_units(actuators: Actuators) -> Floats:
    """What a ship's control channels are multiplied with to be controls in SI: [controls]."""
    return np.array([unit for actuator in actuators for unit in KINDS[actuator.kind].units])


def control_labels(actuators: Actuators) -> tuple[str, ...]:
    """The names of a ship's controls in SI: ``port_rps``, ``port_angle``, ``tunnel_rpm``."""
    return tuple(f"{actuator.name}_{label}" for actuator in actuators for label in KINDS[actuator.kind].labels)


def angle_columns(actuators: Actuators) -> list[int]:
    """Which of a ship's controls are angles."""
    angles = [angle for actuator in actuators for angle in KINDS[actuator.kind].angles]
    return [number for number, angle in enumerate(angles) if angle]


@compiled
def _kind_of_row(p, row, control, first, work):  # type: ignore[no-untyped-def]
    return row[KIND]


@compiled
def _kind_of_number(p, i, work, u, v, r):  # type: ignore[no-untyped-def]
    return p.actuators[i, KIND]


hold_actuator = dispatch_by_code([kind.hold for kind in KINDS.values()], _kind_of_row)
"""``hold_actuator(p, row, control, first, work)``: the working numbers of one actuator while the control holds."""

actuator_force = dispatch_by_code([kind.force for kind in KINDS.values()], _kind_of_number)
"""``actuator_force(p, i, work, u, v, r)``: the force and moment X [N], Y [N], N [N m]."""
