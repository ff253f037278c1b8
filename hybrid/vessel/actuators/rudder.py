"""A rudder, in the race of a propeller or alone. Control: its angle [rad], positive turns the ship to starboard.

Normal force ``F_N = rho/2 A U_R^2 slope sin(alpha)``; the hull adds a_H of it at x_H and takes t_R of its drag. In
the race ``u_R = eps sqrt(eta (u_P + kappa (sqrt(u_P^2 + 8 T / (pi rho D^2)) - u_P))^2 + (1 - eta) u_P^2)``: the
form of Yasukawa and Yoshimura, J Mar Sci Technol 20 (2015), 37-52, that holds at standstill too; with the shaft
astern Kitagawa's, as in Miyauchi et al. (2022), doi 10.1007/s00773-022-00889-3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, radians, sin, sqrt
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel import actuators, effect
from seatrial.hybrid.vessel.actuators.propeller import DIAMETER_M, SHAFT_RPS, inflow, inflow_drift, thrust


@dataclass(frozen=True, slots=True, kw_only=True)
class RudderEntry(actuators.ActuatorEntry):
    """A rudder in a vessel file; ``behind`` names the propeller in whose race it is, if in one.

    ``flow_straightening_plus`` holds where the stern at ``switch_x_m`` moves to starboard, ``_minus`` where it
    moves to port; ``l_R_m`` is the effective place of the cross flow, ``l_R' L`` of the MMG method.
    ``lift_slope`` is that of the normal force over sin(alpha); without it Fujii's 6.13 A / (A + 2.25) of the
    aspect ratio A.
    ``inflow_factor`` is 1 - w of a rudder that is behind no propeller.
    """

    kind: Literal["rudder"]
    area_m2: Number
    span_m: Number
    t_R: Number
    a_H: Number
    x_H_m: Number
    flow_straightening_minus: Number
    flow_straightening_plus: Number
    l_R_m: Number
    limit_deg: Number
    rate_limit_dps: Number
    lag_s: Number
    y_m: Number = 0.0
    behind: str = ""
    lift_slope: Number = 0.0
    eps: Number = 1.0
    kappa: Number = 0.5
    switch_x_m: Number | None = None
    inflow_factor: Number = 1.0
    drift_as_angle: bool = True
    astern_race: Number = 0.144
    astern_loss: Number = 0.176


SHARED = (
    "area_m2", "span_m", "t_R", "a_H", "x_H_m", "flow_straightening_minus", "flow_straightening_plus", "l_R_m",
    "lift_slope", "eps", "kappa", "switch_x_m", "inflow_factor", "drift_as_angle", "astern_race", "astern_loss",
)  # fmt: skip
SLOTS = {"angle_offset_rad": 0.0, "force_loss": 0.0, "response_lag_s": 0.0, actuators.PLAY: 0.0}
NUMBERS = ("x_m", "y_m", "behind", *SHARED, *SLOTS)
(
    X_M, Y_M, BEHIND, AREA_M2, SPAN_M, T_R, A_H, X_H_M, STRAIGHTENING_MINUS, STRAIGHTENING_PLUS, L_R_M,
    LIFT_SLOPE, EPS, KAPPA, SWITCH_X_M, INFLOW_FACTOR, DRIFT_AS_ANGLE, ASTERN_RACE, ASTERN_LOSS,
    ANGLE_OFFSET_RAD, FORCE_LOSS, RESPONSE_LAG_S, _,
) = actuators.columns_in_row(NUMBERS)  # fmt: skip
COSINE, SINE, ANGLE_RAD = range(3)
"""The working numbers: the true angle and its direction."""


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """Where the rudder stands while ``control`` holds."""
    true_rad = control[first] + row[ANGLE_OFFSET_RAD]
    work[COSINE], work[SINE], work[ANGLE_RAD] = cos(true_rad), sin(true_rad), true_rad


@compiled
def astern_inflow(row: Floats, u: float, u_P: float, eta: float, n: float, D: float, kt_n2: float) -> float:
    """The inflow [m/s] while the shaft turns astern, or drags; ``kt_n2`` is K_T n^2 of the thrust there is."""
    if u < 0.0:
        return float(u)
    outside = row[EPS] * u_P
    turning = 1.0 if n > 0.0 else -1.0
    inside = outside + turning * row[ASTERN_RACE] * D * sqrt(8.0 * abs(kt_n2) / pi)
    square = eta * inside * abs(inside) + (1.0 - eta) * outside * outside - row[ASTERN_LOSS] * u * u
    return float(sqrt(square) if square >= 0.0 else -sqrt(-square))


@compiled
def race_speed(p: Record, row: Floats, work: Floats, u: float, v: float, r: float) -> float:
    """The inflow [m/s] along the ship of a rudder behind a propeller."""
    behind = int(row[BEHIND])
    propeller = p.actuators[behind]
    D, n = propeller[DIAMETER_M], work[behind, SHAFT_RPS]
    u_P = inflow(propeller, u, v, r)
    kt_n2 = thrust(p, propeller, work[behind], u, v, r) / (p.water_density_kgpm3 * D**4)
    eta = min(D / row[SPAN_M], 1.0)
    if n < 0.0 or kt_n2 < 0.0:
        return float(astern_inflow(row, u, u_P, eta, n, D, kt_n2))
    inside = u_P + row[KAPPA] * (sqrt(u_P * u_P + 8.0 * kt_n2 * D * D / pi) - u_P)
    return float(row[EPS] * sqrt(eta * inside * inside + (1.0 - eta) * u_P * u_P))


@compiled
def force(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of one rudder; ``u, v`` [m/s], ``r`` [rad/s] through the water."""
    row = p.actuators[i]
    u_here = u - row[Y_M] * r
    u_R = race_speed(p, row, work, u, v, r) if row[BEHIND] >= 0.0 else row[INFLOW_FACTOR] * u_here
    cross_flow_mps = hypot(u, v) * inflow_drift(row[DRIFT_AS_ANGLE], row[L_R_M], u, v, r)
    if u == 0.0 == v:
        cross_flow_mps = -row[L_R_M] * r
    straightening = row[STRAIGHTENING_PLUS] if v + row[SWITCH_X_M] * r >= 0.0 else row[STRAIGHTENING_MINUS]
    v_R = straightening * cross_flow_mps
    alpha = work[i, ANGLE_RAD] - atan2(v_R, u_R)
    pressure = 0.5 * p.water_density_kgpm3 * row[AREA_M2] * (u_R * u_R + v_R * v_R)
    F_N = pressure * row[LIFT_SLOPE] * sin(alpha) * (1.0 - row[FORCE_LOSS])
    X = -(1.0 - row[T_R]) * F_N * work[i, SINE]
    across = F_N * work[i, COSINE]
    return X, -(1.0 + row[A_H]) * across, -(row[X_M] + row[A_H] * row[X_H_M]) * across - row[Y_M] * X


def normal_force_slope(aspect_ratio: float) -> float:
    """Slope of the normal force of a rudder alone, f_alpha (Fujii and Tsuda 1961)."""
    return 6.13 * aspect_ratio / (2.25 + aspect_ratio)


def numbers_of(entry: RudderEntry) -> dict[str, float]:
    """Defaults of what the entry does not state: Fujii's slope; the switch where the cross flow is."""
    return {
        "lift_slope": entry.lift_slope or normal_force_slope(entry.span_m**2 / entry.area_m2),
        "switch_x_m": entry.l_R_m if entry.switch_x_m is None else entry.switch_x_m,
    }


def drives(entry: RudderEntry) -> tuple[actuators.Drive]:
    """How the angle [rad] follows its order."""
    return (actuators.Drive(entry.lag_s, limit=radians(entry.limit_deg), rate=radians(entry.rate_limit_dps)),)


_STRAIGHT = "Yasukawa and Yoshimura, J Mar Sci Technol 20 (2015): 0.3 +- 0.1 and 0.4 +- 0.2 of their ships"


def effects(names: tuple[str, ...]) -> tuple[effect.Effect, ...]:
    """Offset, lost force, what the hull does to flow and force, lag and play of each rudder and of all alike."""
    return (
        *actuators.single_and_joint_effects(
            "rudder_loss", names, actuators.add_loss, "force_loss",
            what="Lost force of the {names}: normal force times (1 - fraction)",
            source="Fujii's slope scatters by a tenth; growth and damage come to it",
            parameter=actuators.FRACTION,
            confused_with=("hull_lengthening", "yaw_damping", *actuators.effect_names("rudder_interaction", names)),
        ),
        *actuators.single_and_joint_effects(
            "rudder_interaction", names, effect.shift, "a_H",
            what="The hull's share of the side force of the {names}: a_H plus an amount",
            source=_STRAIGHT,
            parameter=effect.Parameter("amount", "1", 0.0, -0.5, 1.0, 0.2, 0.05),
        ),
        *actuators.single_and_joint_effects(
            "flow_straightening", names,
            lambda plant, number, factor: plant.scaled(factor, f"{number}_plus", f"{number}_minus"),
            "flow_straightening",
            what="How much of the drift at the stern reaches the {names}: gamma_R times a factor, to both sides",
            source=_STRAIGHT,
            parameter=effect.Parameter("factor", "1", 1.0, 0.0, 4.0, 1.4, 0.1),
            confused_with=("drift_moment", "yaw_damping"),
        ),
        *actuators.angle_offset("rudder", names, "stands", 2.0),
        *actuators.backlash_effects(names, "angle", "rudders"),
        *actuators.lag_effects(names, "rudders", "angle", "response_lag_s"),
    )  # fmt: skip


DEFINITION = actuators.ActuatorModel(
    entry=RudderEntry,
    numbers=NUMBERS,
    labels=("angle",), units=(pi / 180.0,), angles=(True,), work=3,
    fill_work=fill_work, force=force, still=(0.026,), alike=(0.0,),
    drives=drives,
    effects=effects, slots=SLOTS, lag="response_lag_s", gear=("rate_limit_dps", "lag_s"), shared=frozenset(SHARED),
    keeps_sign=("lift_slope", "eps", "flow_straightening_minus", "flow_straightening_plus"), adapted=("a_H",),
    numbers_of=numbers_of, positive=("area_m2", "span_m", "limit_deg", "rate_limit_dps"),
)  # fmt: skip
