"""Effects of actuators of one kind: one for each of them, and one for a pair or for all together."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from seatrial.hybrid.vessel.actuators import PLAY
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


def lag(names: tuple[str, ...], together: str, part: str, number: str = "lag_s") -> tuple[Effect, ...]:
    """``lag_NAME`` for each actuator and ``lag_both_TOGETHER`` for a pair: what acts follows what is reported."""
    return single_and_joint_effects(
        "lag", names, shift, number,
        family="clock",
        what=f"The {{names}}'s {part} that acts follows the reported one with a first-order lag",
        source="First-order actuator model; feedback has none, orders have about a second",
        parameter=Parameter("time_constant_s", "s", 0.0, 0.0, 60.0, 1.0, 0.3, 0.03),
        confused_with=("command_delay", "thruster_lag"),
        kind_of_all=f"_{together}",
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


def backlash(names: tuple[str, ...], part: str, kind_of_all: str = "") -> tuple[Effect, ...]:
    """``backlash_NAME`` of each actuator and that of all: the true angle follows the reported one with play.

    The play operator: the end that turns stays where it is until the motor's side has gone through the play.
    """
    return single_and_joint_effects(
        "backlash", names, shift, PLAY,
        family="alignment",
        what=f"Play in the {{names}}'s gear: the {part} stays until the reported one has moved by the play's width",
        source="Play operator: Nordin and Gutman, Automatica 38 (2002), 1633-1649",
        parameter=Parameter("width_deg", "deg", 0.0, 0.0, 30.0, 3.0, 1.0, tolerance=0.2),
        kind_of_all=kind_of_all,
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
    kind_of_all: str = "",
) -> tuple[Effect, ...]:
    """``stem_NAME`` for each actuator, and ``stem_both`` for a pair, ``stem_all`` for more of one kind.

    ``change(plant, name, value)`` changes the ``number`` of the actuators concerned. They are confused with each
    other and with the effects in ``confused_with``; one alone with ``single_confused_with`` besides, all together
    with ``joint_confused_with``. ``kind_of_all`` ends the name of the effect on all, where another kind has an
    effect of the same stem.
    """
    joint_name = {1: "", 2: f"{stem}_both{kind_of_all}"}.get(len(names), f"{stem}_all{kind_of_all}")
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
        return Effect(
            name,
            family=family,
            kind="actuator",
            what=what.format(names=" and ".join(actuator.replace("_", " ") for actuator in group)),
            source=source,
            parameters=(parameter,),
            change=changed,
            confused_with=tuple(
                sorted({*(effect_name for effect_name, _ in groups), *confused_with, *specific} - {name})
            ),
        )

    return tuple(effect(name, group) for name, group in groups)
