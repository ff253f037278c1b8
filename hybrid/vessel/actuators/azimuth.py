"""The azimuth thruster (paper, eq. 6): a propeller that points anywhere. Controls: shaft [rev/s] and angle [rad].

Angle 0 pushes the ship ahead, a positive one turns the thrust to starboard. Thrust along the pod is
``rho D^2 (thrust_nn D^2 n|n| + thrust_nu D |n| u_a + thrust_uu u_a|u_a|)``, the force across it
``rho D^2 (side_nv D |n| v_c + side_uv |u_a| v_c + side_vv |v_c| v_c)``, u_a and v_c the inflow along and across it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, nan, pi, radians, sin
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel import actuators, effect
from seatrial.hybrid.vessel.actuators import propeller


@dataclass(frozen=True, slots=True, kw_only=True)
class AzimuthEntry(actuators.ActuatorEntry):
    """An azimuth thruster in a vessel file: place, propeller, force coefficients, and what its drive can do."""

    kind: Literal["azimuth"]
    y_m: Number
    propeller_diameter_m: Number
    thrust_nn: Number
    thrust_nu: Number
    thrust_uu: Number
    side_nv: Number
    side_uv: Number
    side_vv: Number
    limit_rpm: Number
    azimuth_rate_limit_dps: Number
    azimuth_lag_s: Number
    shaft_lag_s: Number


SHARED = (
    "propeller_diameter_m", "thrust_nn", "thrust_nu", "thrust_uu", "side_nv", "side_uv", "side_vv",
)  # fmt: skip
SLOTS = {"thrust_loss": 0.0, "angle_offset_rad": 0.0, "astern_factor": 1.0, actuators.PLAY: 0.0}
NUMBERS = ("x_m", "y_m", *SHARED, *SLOTS)
(
    X_M, Y_M, DIAMETER_M, THRUST_NN, THRUST_NU, THRUST_UU, SIDE_NV, SIDE_UV, SIDE_VV, THRUST_LOSS, ANGLE_OFFSET_RAD,
    ASTERN_FACTOR, _,
) = actuators.columns_in_row(NUMBERS)  # fmt: skip
COSINE, SINE, SHAFT_RPS, EFFECT = range(4)
"""The working numbers: the true direction of thrust, the shaft's speed, the share of force that is left."""


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """Where the pod points and how its shaft turns while ``control`` holds."""
    angle_rad = control[first + 1]
    if p.azimuth_scale != 1.0:  # it acts on the angle within half a turn of ahead
        angle_rad = p.azimuth_scale * actuators.wrapped(angle_rad)
    true_rad = angle_rad + row[ANGLE_OFFSET_RAD]
    work[COSINE], work[SINE] = cos(true_rad), sin(true_rad)
    work[SHAFT_RPS], work[EFFECT] = control[first], 1.0 - row[THRUST_LOSS]


@compiled
def inflow(row: Floats, held: Floats, u: float, v: float, r: float) -> tuple[float, float]:
    """The speed of the water along and across a pod [m/s], that of the hull's motion there."""
    u_p, v_p = u - row[Y_M] * r, v + row[X_M] * r
    return u_p * held[COSINE] + v_p * held[SINE], -u_p * held[SINE] + v_p * held[COSINE]


@compiled
def thrust(p: Record, row: Floats, held: Floats, u_a: float) -> float:
    """The thrust along a pod [N], quadratic in shaft speed and inflow."""
    D, n = row[DIAMETER_M], held[SHAFT_RPS]
    turned = row[THRUST_NN] * D * D * n * abs(n) + row[THRUST_NU] * D * abs(n) * u_a
    if n < 0.0:
        turned *= row[ASTERN_FACTOR]
    pressure = p.water_density_kgpm3 * D * D * held[EFFECT]
    return float(pressure * (turned + row[THRUST_UU] * u_a * abs(u_a)))


@compiled
def force(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of one pod; ``u, v`` [m/s], ``r`` [rad/s] relative to the water.

    The side force across the pod is quadratic in shaft speed and inflow, too.
    """
    row, held = p.actuators[i], work[i]
    D, n, x, y = row[DIAMETER_M], held[SHAFT_RPS], row[X_M], row[Y_M]
    u_a, v_c = inflow(row, held, u, v, r)
    T, pressure = thrust(p, row, held, u_a), p.water_density_kgpm3 * D * D * held[EFFECT]
    C = pressure * v_c * (row[SIDE_NV] * D * abs(n) + row[SIDE_UV] * abs(u_a) + row[SIDE_VV] * abs(v_c))
    X = T * held[COSINE] - C * held[SINE]
    Y = T * held[SINE] + C * held[COSINE]
    return X, Y, x * Y - y * X


@compiled
def shaft_load(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float]:
    """No thrust that a meter reads, which is on no pod's shaft, and the power [W]."""
    row, held = p.actuators[i], work[i]
    u_a, _ = inflow(row, held, u, v, r)
    T = thrust(p, row, held, u_a)
    return nan, propeller.screw_power(p.water_density_kgpm3, row[DIAMETER_M], held[SHAFT_RPS], T, u_a)


def drives(entry: AzimuthEntry) -> tuple[actuators.Drive, actuators.Drive]:
    """How shaft [rev/s] and angle [rad] follow their orders."""
    return (
        actuators.Drive(entry.shaft_lag_s, limit=entry.limit_rpm / actuators.RPM_PER_RPS),
        actuators.Drive(entry.azimuth_lag_s, rate=radians(entry.azimuth_rate_limit_dps)),
    )


def effects(names: tuple[str, ...]) -> tuple[effect.Effect, ...]:
    """Lost thrust, offset angle and play of each thruster and of all alike; inflow, side force and angle of all."""
    number = {1: "The azimuth turns more than it reports", 2: "Both azimuths turn more than they report"}
    subject = number.get(len(names), "All azimuths turn more than they report")
    return (
        *actuators.single_and_joint_effects(
            "thrust_loss", names, actuators.add_loss, "thrust_loss",
            what="Lost thrust: both force components of the {names} pod times (1 - fraction)",
            source="Wear, roughness and ventilation as one share; cf. Carlton, Marine Propellers and Propulsion",
            parameter=actuators.FRACTION,
            confused_with=("hull_lengthening", "pod_side_force"),
            single_confused_with=("yaw_asymmetry",),
            joint_confused_with=("hull_fouling", "towed_load", "wake_fraction"),
        ),
        *actuators.astern_thrust(names, "pod"),
        effect.Effect(
            "wake_fraction", family="propulsion", kind="physics",
            what="The hull's wake at the pods: axial inflow u_a times (1 - fraction), hence more thrust under way",
            source="Carlton, Marine Propellers and Propulsion, ch. 5",
            parameters=(actuators.WAKE,),
            change=lambda plant, values: plant.scaled(
                1.0 - values["fraction"], "thrust_nu", "side_uv"
            ).scaled((1.0 - values["fraction"]) ** 2, "thrust_uu"),
            confused_with=("hull_fouling", "towed_load"),
        ),
        effect.scaling(
            "pod_side_force", "propulsion", ("side_nv", "side_uv", "side_vv"), (1.2, 0.05),
            what="Side force of the pods in oblique flow: the three coefficients across the pod times a factor",
            source="Ribner, Propellers in yaw, NACA Report 820 (1945): a propeller resists like a fin",
        ),
        *actuators.angle_offset("azimuth", names, "azimuth points", 2.5),
        effect.Effect(
            "azimuth_scale", family="alignment", kind="actuator",
            what=f"{subject}: true angle = factor x reported, from ahead either way",
            source="Gain of the azimuth feedback",
            parameters=(effect.Parameter("factor", "1", 1.0, 0.5, 1.5, 1.05, 0.02, tolerance=0.002),),
            change=effect.multiplied("azimuth_scale"),
            confused_with=("hull_lengthening", "skeg", "trim", "yaw_damping"),
        ),
        *actuators.backlash_effects(names, "azimuth"),
    )  # fmt: skip


DEFINITION = actuators.ActuatorModel(
    entry=AzimuthEntry,
    numbers=NUMBERS,
    labels=("rps", "angle"), units=(1.0 / actuators.RPM_PER_RPS, pi / 180.0), angles=(False, True), work=4,
    fill_work=fill_work, force=force, shaft=shaft_load, still=(0.05, 0.026), alike=(0.3, 0.0),
    drives=drives,
    effects=effects, slots=SLOTS, gear=("azimuth_rate_limit_dps", "azimuth_lag_s"), shared=frozenset(SHARED),
    keeps_sign=("thrust_nn", "thrust_nu", "side_nv", "side_uv"), adapted=("x_m",),
    positive=("propeller_diameter_m", "limit_rpm", "azimuth_rate_limit_dps"),
)  # fmt: skip
