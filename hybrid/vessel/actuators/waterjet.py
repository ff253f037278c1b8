"""A jet, or an outboard's steered propeller, that is turned as a whole. Controls: shaft [rev/s] and angle [rad].

Thrust ``thrust_nn n|n| - thrust_nu |n| u`` along the nozzle, at angle 0 ahead; a positive angle turns the thrust to
starboard. The momentum of the jet less the drag of taking the water in: Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control, 2nd ed. (2021), section 9.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel import actuators, effect


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterjetEntry(actuators.ActuatorEntry):
    """A waterjet in a vessel file: place, thrust over shaft speed [N s^2] and inflow [N s^2/m], and its drive."""

    kind: Literal["waterjet"]
    thrust_nn: Number
    thrust_nu: Number
    limit_rpm: Number
    limit_deg: Number
    rate_limit_dps: Number
    shaft_lag_s: Number
    nozzle_lag_s: Number
    y_m: Number = 0.0


SLOTS = {"thrust_loss": 0.0, "angle_offset_rad": 0.0, "lag_s": 0.0, actuators.PLAY: 0.0}
NUMBERS = ("x_m", "y_m", "thrust_nn", "thrust_nu", *SLOTS)
X_M, Y_M, THRUST_NN, THRUST_NU, THRUST_LOSS, ANGLE_OFFSET_RAD, LAG_S, _ = actuators.columns_in_row(NUMBERS)
COSINE, SINE, SHAFT_RPS = range(3)


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """Where the nozzle points and how the shaft turns while ``control`` holds."""
    true_rad = control[first + 1] + row[ANGLE_OFFSET_RAD]
    work[COSINE], work[SINE], work[SHAFT_RPS] = cos(true_rad), sin(true_rad), control[first]


@compiled
def force(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of one jet; ``u`` [m/s] and ``r`` [rad/s] through the water."""
    row = p.actuators[i]
    n = work[i, SHAFT_RPS]
    inflow = u - row[Y_M] * r
    T = (1.0 - row[THRUST_LOSS]) * (row[THRUST_NN] * n * abs(n) - row[THRUST_NU] * abs(n) * inflow)
    X, Y = T * work[i, COSINE], T * work[i, SINE]
    return X, Y, row[X_M] * Y - row[Y_M] * X


def drives(entry: WaterjetEntry) -> tuple[actuators.Drive, actuators.Drive]:
    """How shaft [rev/s] and nozzle [rad] follow their orders."""
    return (
        actuators.Drive(entry.shaft_lag_s, limit=entry.limit_rpm / actuators.RPM_PER_RPS),
        actuators.Drive(entry.nozzle_lag_s, limit=radians(entry.limit_deg), rate=radians(entry.rate_limit_dps)),
    )


def effects(names: tuple[str, ...]) -> tuple[effect.Effect, ...]:
    """Lost thrust, offset angle, play and a lag of each jet and of all alike."""
    return (
        *actuators.single_and_joint_effects(
            "thrust_loss", names, actuators.add_loss, "thrust_loss",
            what="Lost thrust of the {names} jet: times (1 - fraction)",
            source="Wear and air drawn in as one share",
            parameter=actuators.FRACTION,
            joint_confused_with=("hull_fouling", "towed_load"),
        ),
        *actuators.angle_offset("nozzle", names, "nozzle points", 2.5),
        *actuators.backlash_effects(names, "nozzle", "jets"),
        *actuators.lag_effects(names, "jets", "shaft and nozzle"),
    )  # fmt: skip


DEFINITION = actuators.ActuatorModel(
    entry=WaterjetEntry,
    numbers=NUMBERS,
    labels=("rps", "angle"), units=(1.0 / actuators.RPM_PER_RPS, pi / 180.0), angles=(False, True), work=3,
    fill_work=fill_work, force=force, still=(0.05, 0.026), alike=(0.3, 0.0),
    drives=drives,
    effects=effects, slots=SLOTS, lag="lag_s", gear=("rate_limit_dps", "nozzle_lag_s"),
    adapted=("thrust_nn", "thrust_nu"), positive=("limit_rpm", "limit_deg", "rate_limit_dps"),
)  # fmt: skip
