"""The tunnel thruster (paper, eq. 7): a side force that goes with the shaft alone. Control: shaft [rpm].

``cubic_n n^3 + quadratic_n n|n| + linear_n n``, positive to starboard; an effect makes it fade with speed ahead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel.actuators import FRACTION, ActuatorEntry, ActuatorModel, Drive, columns_in_row
from seatrial.hybrid.vessel.effect import Effect, Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class TunnelEntry(ActuatorEntry):
    """A tunnel thruster in a vessel file: place, side force as a polynomial of the shaft in rpm, and its drive."""

    kind: Literal["tunnel"]
    cubic_n: Number
    quadratic_n: Number
    linear_n: Number
    limit_rpm: Number
    shaft_lag_s: Number


SLOTS = {"speed_loss": 0.0}
NUMBERS = ("x_m", "cubic_n", "quadratic_n", "linear_n", *SLOTS)
X_M, CUBIC_N, QUADRATIC_N, LINEAR_N, SPEED_LOSS = columns_in_row(NUMBERS)
FORCE_N = 0
"""The working number: the side force while the control holds."""


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """The side force [N] while ``control`` holds."""
    n = control[first]
    work[FORCE_N] = row[CUBIC_N] * n * n * n + row[QUADRATIC_N] * n * abs(n) + row[LINEAR_N] * n


@compiled
def force(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m]; with its ``speed_loss`` [s2/m2] the jet bends away under way."""
    Y = work[i, FORCE_N] / (1.0 + p.actuators[i, SPEED_LOSS] * u * u)
    return 0.0, Y, p.actuators[i, X_M] * Y


def drives(entry: TunnelEntry) -> tuple[Drive]:
    """How the shaft [rpm] follows its order."""
    return (Drive(entry.shaft_lag_s, limit=entry.limit_rpm),)


def effects(names: tuple[str, ...]) -> tuple[Effect, ...]:
    """Lost side force of each thruster, and what it loses under way."""

    def speed_loss_effect(name: str) -> Effect:
        return Effect(
            f"speed_loss_{name}", family="propulsion", kind="actuator",
            what=f"Side force of the {name.replace('_', ' ')} thruster fades under way, by half at a speed",
            source="Brix, Manoeuvring Technical Manual (1993): side force of tunnel thrusters over speed ahead",
            parameters=(Parameter("half_speed_mps", "m/s", float("inf"), 0.2, float("inf"), 2.0, 6.0),),
            change=lambda plant, values: plant.shifted(**{f"{name}_speed_loss": values["half_speed_mps"] ** -2.0}),
            chart="inverse_square",
        )  # fmt: skip

    def loss(name: str) -> Effect:
        return Effect(
            f"{name}_thrust_loss" if name == "tunnel" else f"thrust_loss_{name}",
            family="propulsion", kind="actuator",
            what=f"Lost side force of the {name.replace('_', ' ')} thruster: times (1 - fraction)",
            source="Brix, Manoeuvring Technical Manual (1993): speed, grids and fouling as one share",
            parameters=(FRACTION,),
            change=lambda plant, values: plant.scaled(
                1.0 - values["fraction"], *(f"{name}_{number}" for number in ("cubic_n", "quadratic_n", "linear_n"))
            ),
        )  # fmt: skip

    return tuple(effect(name) for name in names for effect in (loss, speed_loss_effect))


DEFINITION = ActuatorModel(
    entry=TunnelEntry,
    numbers=NUMBERS,
    labels=("rpm",), units=(1.0,), angles=(False,), work=1,
    fill_work=fill_work, force=force, still=(10.0,), alike=(10.0,),
    drives=drives,
    effects=effects, slots=SLOTS, adapted=("cubic_n", "quadratic_n", "linear_n"), positive=("limit_rpm",),
)  # fmt: skip
