"""The kinds of actuators, one file each, and the compiled loop's way from a row's kind to its equations.

The compiled core sees an actuator as one row of numbers: the code of its kind, the place of its first control, and
the kind's numbers in their order. What stays constant while the controls are held is worked out once a step into a
row of working numbers. To add a kind: its controls in :data:`seatrial.acquisition.core.ship.KINDS`, and a file of
its name here, like ``waterjet.py``, whose ``DEFINITION`` is an :class:`ActuatorModel`.

The effects of the actuators of one kind are one for each of them, and one for a pair or for all together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from math import nan, pi
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import StrictFloat as Number

from seatrial.acquisition.core import quantities, ship
from seatrial.analysis.compiling import compiled, dispatch_by_code
from seatrial.hybrid.vessel.effect import Effect, Parameter, Values, shift

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.plant import Plant

FRACTION = Parameter("fraction", "1", 0.0, -0.5, 1.0, 0.1, 0.03)
"""The share of a force that is lost."""

WAKE = Parameter("fraction", "1", 0.0, -0.5, 0.8, 0.1, 0.03)
"""The share by which the hull's wake slows the inflow more than the model has it."""


def add_loss(plant: Plant, number: str, fraction: float) -> Plant:
    """A share of the force lost; a loss on top of another takes its share of what is left."""
    return plant.replaced(**{number: 1.0 - (1.0 - plant.number(number)) * (1.0 - fraction)})


def effect_names(stem: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the effects of a stem on each actuator."""
    return tuple(f"{stem}_{name}" for name in names)


def lag_effects(names: tuple[str, ...], joint_word: str, part: str, number: str = "lag_s") -> tuple[Effect, ...]:
    """``lag_NAME`` for each actuator and ``lag_both_WORD`` for a pair: what acts follows what is reported."""
    return single_and_joint_effects(
        "lag", names, shift, number,
        family="clock",
        what=f"The {{names}}'s {part} that acts follows the reported one with a first-order lag",
        source="First-order actuator model; feedback has none, orders have about a second",
        parameter=Parameter("time_constant_s", "s", 0.0, 0.0, 60.0, 1.0, 0.3, 0.03),
        confused_with=("command_delay", "thruster_lag"),
        joint_word=joint_word,
    )  # fmt: skip


def angle_offset(part: str, names: tuple[str, ...], points: str, typical_deg: float) -> tuple[Effect, ...]:
    """``PART_offset_NAME`` of each actuator and that of all: the slot ``angle_offset_rad``."""
    return single_and_joint_effects(
        f"{part}_offset", names, shift, "angle_offset_rad",
        family="alignment",
        what=f"The {{names}} {points} elsewhere: true angle = reported + offset",
        source=f"Zero of the {part} feedback",
        parameter=Parameter("angle_deg", "deg", 0.0, -30.0, 30.0, typical_deg, 0.5, tolerance=0.1),
        confused_with=("sway_asymmetry", "yaw_asymmetry"),
    )  # fmt: skip


def backlash_effects(names: tuple[str, ...], part: str, joint_word: str = "") -> tuple[Effect, ...]:
    """``backlash_NAME`` of each actuator and that of all: the true angle follows the reported one with play.

    The play operator: the end that turns stays where it is until the motor's side has gone through the play.
    """
    return single_and_joint_effects(
        "backlash", names, shift, PLAY,
        family="alignment",
        what=f"Play in the {{names}}'s gear: the {part} stays until the reported one has moved by the play's width",
        source="Play operator: Nordin and Gutman, Automatica 38 (2002), 1633-1649",
        parameter=Parameter("width_deg", "deg", 0.0, 0.0, 30.0, 3.0, 1.0, tolerance=0.2),
        joint_word=joint_word,
    )  # fmt: skip


def astern_thrust(names: tuple[str, ...], what: str) -> tuple[Effect, ...]:
    """``astern_thrust_NAME`` and that of all: thrust while the shaft turns astern, the slot ``astern_factor``."""
    return single_and_joint_effects(
        "astern_thrust", names, lambda plant, number, factor: plant.scaled(factor, number), "astern_factor",
        what=f"Thrust of the {{names}} {what} while its shaft turns astern: times a factor",
        source="Scatter of four-quadrant propeller data; cf. van Lammeren et al., Trans. SNAME 77 (1969)",
        parameter=Parameter("factor", "1", 1.0, 0.0, 3.0, 1.2, 0.05),
    )  # fmt: skip


def single_and_joint_effects(
    stem: str,
    names: tuple[str, ...],
    change: Callable[[Plant, str, float], Plant],
    number: str,
    *,
    what: str,
    source: str,
    parameter: Parameter,
    family: str = "propulsion",
    confused_with: tuple[str, ...] = (),
    single_confused_with: tuple[str, ...] = (),
    joint_confused_with: tuple[str, ...] = (),
    joint_word: str = "",
) -> tuple[Effect, ...]:
    """``stem_NAME`` for each actuator, and ``stem_both`` for a pair, ``stem_all`` for more of one kind.

    ``change(plant, name, value)`` changes the ``number`` of the actuators concerned. They are confused with each
    other and with the effects in ``confused_with``; one alone with ``single_confused_with`` besides, all together
    with ``joint_confused_with``. ``joint_word``, as "rudders", ends the name of the effect on all, where another
    kind has an effect of the same stem.
    """
    joint_name = ""
    if len(names) > 1:
        joint_name = "_".join(filter(None, [stem, "both" if len(names) == 2 else "all", joint_word]))
    groups: list[tuple[str, tuple[str, ...]]] = [(f"{stem}_{name}", (name,)) for name in names]
    groups += [(joint_name, names)] if joint_name else []

    def effect(name: str, group: tuple[str, ...]) -> Effect:
        def changed(plant: Plant, values: Values) -> Plant:
            for actuator in group:
                plant = change(plant, f"{actuator}_{number}", values[parameter.name])
            return plant

        specific = (single_confused_with if len(group) == 1 else ()) + (
            joint_confused_with if group == names else ()
        )
        text = what.format(names=" and ".join(actuator.replace("_", " ") for actuator in group))
        return Effect(
            name,
            family=family,
            kind="actuator",
            what=re.sub(r"\b(\w+) \1\b", r"\1", text),  # a name that says its kind
            source=source,
            parameters=(parameter,),
            change=changed,
            confused_with=tuple(
                sorted({*(effect_name for effect_name, _ in groups), *confused_with, *specific} - {name})
            ),
        )

    return tuple(effect(name, group) for name, group in groups)


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


@compiled
def no_shaft(p: Any, i: int, work: quantities.Floats, u: float, v: float, r: float) -> tuple[float, float]:
    """The thrust and the power of an actuator without a shaft that meters read: not a number."""
    return nan, nan


@dataclass(frozen=True, slots=True)
class ActuatorModel:
    """A kind of actuator.

    ``entry`` is the class of its table in a vessel file. ``numbers`` are what a plant holds of it, in the order
    of its row: those of the entry and, with their neutral values, ``slots`` that effects set. ``shared`` are the
    numbers that a plant of several alike calls by their own name, without the actuator's. ``units`` turn the
    kind's channels into controls in SI, ``labels`` name these, ``angles`` tells which of them are angles,
    ``drives`` how they follow orders, ``still`` how much feedback of a held one moves and ``alike`` what is not
    another setting. ``keeps_sign`` are the shared numbers, ``adapted`` the own ones, that are learned of a ship.
    ``fill_work(p, row, control, first, work)`` and ``force(p, i, work, u, v, r) -> X, Y, N`` are compiled, ``row``
    and ``i`` an actuator's row and its number; ``work`` is how many working numbers they share, in ``force`` those
    of all actuators, [actuators, working numbers]; ``shaft``, of the same arguments as ``force``, is what meters on
    the shaft read, its thrust [N] and power [W]. ``effects(names)`` are the effects of a ship's actuators of this
    kind. ``numbers_of(entry)`` are numbers that follow from the entry; those named ``positive`` are above zero;
    ``lag`` is the slot of its own lag [s]; ``gear`` are the entry's numbers of the rate [deg/s] and the lag [s]
    with which its angle follows orders, of a kind that has one.
    """

    entry: type[ActuatorEntry]
    numbers: tuple[str, ...]
    labels: tuple[str, ...]
    units: tuple[float, ...]
    angles: tuple[bool, ...]
    work: int
    fill_work: Callable[..., None]
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
    gear: tuple[str, str] | None = None
    shaft: Callable[..., tuple[float, float]] = no_shaft


@compiled
def wrapped(angle_rad: float) -> float:
    """The same direction within half a turn of zero."""
    return float(angle_rad - 2.0 * pi * round(angle_rad / (2.0 * pi)))


def columns_in_row(numbers: tuple[str, ...]) -> range:
    """Where a kind's numbers stand in its row."""
    return range(FIRST_NUMBER, FIRST_NUMBER + len(numbers))


KINDS: dict[str, ActuatorModel] = {name: import_module(f"{__name__}.{name}").DEFINITION for name in ship.KINDS}
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


_OF_SEVERAL = re.compile(r"(.+_(?:both|all))(?:_.+)?")


def effects_by_kind(actuators: ship.Actuators) -> dict[str, tuple[Effect, ...]]:
    """The effects of a ship's actuators by their kind.

    An effect on several of a kind has the name of that kind at its end where another kind has one of its name.
    """
    result, names = dict[str, tuple[Effect, ...]](), set[str]()
    for kind, model in KINDS.items():
        of_kind = ship.names_of_kind(actuators, kind)
        effects = model.effects(of_kind) if of_kind else ()
        new_names = {
            effect.name: f"{match[1]}_{kind}s"
            for effect in effects
            if effect.name in names and (match := _OF_SEVERAL.fullmatch(effect.name))
        }
        if new_names:
            effects = tuple(
                replace(
                    effect,
                    name=new_names.get(effect.name, effect.name),
                    confused_with=tuple(new_names.get(rival, rival) for rival in effect.confused_with),
                )
                for effect in effects
            )
        result[kind] = effects
        names |= {effect.name for effect in effects}
    return result


def control_units(actuators: ship.Actuators) -> quantities.Floats:
    """What a ship's control channels are multiplied with to be controls in SI: [controls]."""
    return np.array([unit for actuator in actuators for unit in KINDS[actuator.kind].units])


def control_labels(actuators: ship.Actuators) -> tuple[str, ...]:
    """The names of a ship's controls in SI: ``port_rps``, ``port_angle``, ``tunnel_rpm``."""
    return tuple(f"{actuator.name}_{label}" for actuator in actuators for label in KINDS[actuator.kind].labels)


def angle_columns(actuators: ship.Actuators) -> list[int]:
    """Which of a ship's controls are angles."""
    angles = [angle for actuator in actuators for angle in KINDS[actuator.kind].angles]
    return [number for number, angle in enumerate(angles) if angle]


@compiled
def _kind_of_row(p, row, control, first, work):  # type: ignore[no-untyped-def]
    return row[KIND]


@compiled
def _kind_of_number(p, i, work, u, v, r):  # type: ignore[no-untyped-def]
    return p.actuators[i, KIND]


fill_actuator_work = dispatch_by_code([kind.fill_work for kind in KINDS.values()], _kind_of_row)
"""``fill_actuator_work(p, row, control, first, work)``: one actuator's working numbers while the control holds."""

actuator_force = dispatch_by_code([kind.force for kind in KINDS.values()], _kind_of_number)
"""``actuator_force(p, i, work, u, v, r)``: the force and moment X [N], Y [N], N [N m]."""

shaft_load = dispatch_by_code([kind.shaft for kind in KINDS.values()], _kind_of_number)
"""``shaft_load(p, i, work, u, v, r)``: the thrust [N] and power [W] of one actuator's shaft; NaN of one without."""
