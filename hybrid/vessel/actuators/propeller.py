"""A propeller of fixed pitch on a fixed shaft, and what one of controllable pitch shares. Control: shaft [rev/s].

Ahead, with the inflow ``u_a``: ``T = rho D^2 (k_0 P n^2 D^2 + k_1 n D u_a + k_2 u_a^2)``, which is rho n^2 D^4
K_T(J) with the polynomial of J = u_a / (n D), P the share of the full pitch; (1 - t) of it drives the ship.
Astern ``rho n^2 D^4 C``, C of J_s = u / (n D), and a side force. Wake and K_T after Yasukawa and Yoshimura, J Mar
Sci Technol 20 (2015), 37-52; four quadrants after Miyauchi et al. (2022), doi 10.1007/s00773-022-00889-3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, exp, hypot, nan, pi, sqrt
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel import actuators, effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Blades(actuators.ActuatorEntry):
    """Place, blades and what the hull does to them; of ``wake_x_m``, ``pitch_m`` and the forces see the module.

    The wake is ``(wake_0 + wake_1 |b| + wake_2 b^2) exp(-wake_decay b^2)`` with ``b`` the drift at ``wake_x_m``:
    drift angle (``drift_as_angle``) or its sine, less ``wake_x_m r / U``. Astern C is ``astern_0``, and
    ``astern_1 + astern_2 J_s`` from J_s = ``astern_3`` on. ``side`` and ``turn`` are the published A and B of the
    side force and its moment while the shaft or the ship goes astern.
    """

    diameter_m: Number
    k_0: Number
    k_1: Number
    k_2: Number
    thrust_deduction: Number
    wake_0: Number
    limit_rpm: Number
    shaft_lag_s: Number
    y_m: Number = 0.0
    wake_1: Number = 0.0
    wake_2: Number = 0.0
    wake_decay: Number = 0.0
    wake_x_m: Number = 0.0
    drift_as_angle: bool = True
    astern_0: Number = -0.25
    astern_1: Number = -0.25
    astern_2: Number = 0.0
    astern_3: Number = 0.0
    pitch_m: Number = 0.0
    side: tuple[Number, ...] = (0.0,) * 8
    turn: tuple[Number, ...] = (0.0,) * 8


@dataclass(frozen=True, slots=True, kw_only=True)
class PropellerEntry(Blades):
    """A propeller of fixed pitch in a vessel file."""

    kind: Literal["propeller"]


SIDE_TERMS = 8
SHARED = (
    "diameter_m", "k_0", "k_1", "k_2", "thrust_deduction", "wake_0", "wake_1", "wake_2", "wake_decay", "wake_x_m",
    "drift_as_angle", "astern_0", "astern_1", "astern_2", "astern_3", "pitch_m",
    *(f"side_{term}" for term in range(SIDE_TERMS)), *(f"turn_{term}" for term in range(SIDE_TERMS)),
)  # fmt: skip
SLOTS = {"thrust_loss": 0.0, "inflow_factor": 1.0, "astern_factor": 1.0, "lag_s": 0.0}
NUMBERS = ("x_m", "y_m", *SHARED, *SLOTS)
(
    X_M, Y_M, DIAMETER_M, K_0, K_1, K_2, THRUST_DEDUCTION, WAKE_0, WAKE_1, WAKE_2, WAKE_DECAY, WAKE_X_M,
    DRIFT_AS_ANGLE, ASTERN_0, ASTERN_1, ASTERN_2, ASTERN_3, PITCH_M, SIDE, *_,
    THRUST_LOSS, INFLOW_FACTOR, ASTERN_FACTOR, LAG_S,
) = actuators.columns_in_row(NUMBERS)  # fmt: skip
TURN = SIDE + SIDE_TERMS
SHAFT_RPS, PITCH = range(2)
"""The working numbers: the shaft's speed, the share of the full pitch."""

_LOW, _HIGH = -0.35, -0.06
"""The J_s between which the side force of a shaft turning astern changes over (Miyauchi et al. 2022)."""

_STANDS_RPS = 1e-6
"""A shaft that turns slower stands: it comes to rest along an exponential, and u / (n D) must stay a number."""


@compiled
def shaft_speed(n: float) -> float:
    """A shaft's speed [rev/s], zero where it stands."""
    return float(n if abs(n) > _STANDS_RPS else 0.0)


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """How a fixed propeller's shaft turns while ``control`` holds."""
    work[SHAFT_RPS], work[PITCH] = shaft_speed(control[first]), 1.0


@compiled
def inflow_drift(as_angle: float, x_m: float, u: float, v: float, r: float) -> float:
    """The drift angle of the flow at ``x_m``, or its sine, positive when it comes from the port side."""
    U = hypot(u, v)
    if U == 0.0:
        return 0.0
    sine = -v / U
    drift = asin(min(max(sine, -1.0), 1.0)) if as_angle != 0.0 else sine
    return float(drift - x_m * r / U)


@compiled
def inflow(row: Floats, u: float, v: float, r: float) -> float:
    """The speed [m/s] of the water into the propeller: that of the hull there, less the wake when going ahead."""
    u_p = u - row[Y_M] * r
    if u_p > 0.0:
        b = inflow_drift(row[DRIFT_AS_ANGLE], row[WAKE_X_M], u, v, r)
        wake = (row[WAKE_0] + row[WAKE_1] * abs(b) + row[WAKE_2] * b * b) * exp(-row[WAKE_DECAY] * b * b)
        u_p *= min(max(1.0 - wake, 0.0), 1.0)
    return float(u_p * row[INFLOW_FACTOR])


@compiled
def thrust(p: Record, row: Floats, work: Floats, u: float, v: float, r: float) -> float:
    """The propeller's own thrust [N], without what it takes from the hull; none of a shaft that stands."""
    n, D = work[SHAFT_RPS], row[DIAMETER_M]
    scale = p.water_density_kgpm3 * D * D * (1.0 - row[THRUST_LOSS])
    if n > 0.0:
        nD, u_a = n * D, inflow(row, u, v, r)
        return float(scale * (row[K_0] * work[PITCH] * nD * nD + row[K_1] * nD * u_a + row[K_2] * u_a * u_a))
    if n == 0.0:
        return 0.0
    J_s = (u - row[Y_M] * r) / (n * D)
    C = row[ASTERN_1] + row[ASTERN_2] * J_s if J_s >= row[ASTERN_3] else row[ASTERN_0]
    return float(scale * n * n * D * D * C * row[ASTERN_FACTOR])


_INDUCED, _BLADE_DRAG, _ROTATION = 1.084, 0.014, 0.64
"""What a screw takes, as 2 pi K_Q: so many times the ideal, beside it the drag of its blades and, by the square of
K_T, the turning of its wake.

Fitted to the Wageningen B-series (3 to 5 blades, area ratio 0.4 to 0.85, pitch ratio 0.6 to 1.3, K_T above 0.06):
5 % at standard deviation are left.
"""


@compiled
def screw_power(density_kgpm3: float, D: float, n: float, T: float, u_a: float) -> float:
    """The power [W] that a screw takes for its thrust ``T`` [N] ahead; not a number where it pushes or goes astern.

    Of the ideal screw, T (u_a + sqrt(u_a^2 + 8 T / (pi rho D^2))) / 2 by momentum theory (Carlton, Marine
    Propellers and Propulsion, ch. 8), and what blades lose.
    """
    if not (n > 0.0 and T > 0.0 and u_a >= 0.0):
        return nan
    turned = density_kgpm3 * n**3 * D**5
    J, K_T = u_a / (n * D), T * n * D / turned
    ideal = 0.5 * K_T * (J + sqrt(J * J + 8.0 / pi * K_T))
    return float(turned * (_INDUCED * ideal + _BLADE_DRAG + _ROTATION * K_T * K_T))


@compiled
def shaft_load(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float]:
    """The thrust [N] and power [W] of one propeller's shaft."""
    row, n = p.actuators[i], work[i, SHAFT_RPS]
    T = thrust(p, row, work[i], u, v, r)
    return float(T), screw_power(p.water_density_kgpm3, row[DIAMETER_M], n, T, inflow(row, u, v, r))


@compiled
def side_terms(row: Floats, first: int, n: float, u: float) -> float:
    """The side force, or its moment, without dimension: times the squared speed n P ahead and n D astern."""
    D, P = row[DIAMETER_M], row[PITCH_M]
    J_s = u / (n * D)
    if n > 0.0:
        return float(P * P * n * n * ((row[first + 5] * J_s + row[first + 6]) * J_s + row[first + 7]))
    if J_s < _LOW:
        share = row[first + 2] + row[first + 3] * J_s
    elif J_s > _HIGH:
        share = row[first + 4]
    else:
        share = row[first] + row[first + 1] * J_s
    return float(D * D * n * n * share)


@compiled
def force(p: Record, i: int, work: Floats, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of one propeller; ``u, v`` [m/s], ``r`` [rad/s] through the water."""
    row = p.actuators[i]
    n = work[i, SHAFT_RPS]
    X = thrust(p, row, work[i], u, v, r)
    if n > 0.0:
        X *= 1.0 - row[THRUST_DEDUCTION]
    Y, N = 0.0, -row[Y_M] * X
    if n < 0.0 or (n > 0.0 and u < 0.0):
        L = p.length_between_perpendiculars_m
        q = 0.5 * p.water_density_kgpm3 * L * p.draught_m
        Y += q * side_terms(row, SIDE, n, u)
        N += q * L * side_terms(row, TURN, n, u)
    return X, Y, N


def numbers_of(entry: Blades) -> dict[str, float]:
    """The entry's numbers that stand in tables."""
    tables = {"side": entry.side, "turn": entry.turn}
    return {f"{name}_{term}": value for name, values in tables.items() for term, value in enumerate(values)}


def drives(entry: Blades) -> tuple[actuators.Drive]:
    """How the shaft [rev/s] follows its order."""
    return (actuators.Drive(entry.shaft_lag_s, limit=entry.limit_rpm / actuators.RPM_PER_RPS),)


def effects(names: tuple[str, ...]) -> tuple[effect.Effect, ...]:
    """Lost thrust, another wake, another thrust astern, and a lag of each propeller and of all alike."""
    return (
        *actuators.single_and_joint_effects(
            "thrust_loss", names, actuators.add_loss, "thrust_loss",
            what="Lost thrust of the {names} propeller, and with it of its race: times (1 - fraction)",
            source="Wear, roughness and ventilation as one share; cf. Carlton, Marine Propellers and Propulsion",
            parameter=actuators.FRACTION,
            single_confused_with=("yaw_asymmetry",) if len(names) > 1 else (),
            joint_confused_with=("hull_fouling", "towed_load"),
        ),
        *actuators.single_and_joint_effects(
            "wake", names, lambda plant, number, share: plant.scaled(1.0 - share, number), "inflow_factor",
            what="More wake at the {names} propeller than the model has: inflow times (1 - fraction)",
            source="Carlton, Marine Propellers and Propulsion, ch. 5",
            parameter=actuators.WAKE,
            joint_confused_with=("hull_fouling", "towed_load", *actuators.effect_names("thrust_loss", names)),
        ),
        *actuators.single_and_joint_effects(
            "thrust_deduction", names, effect.shift, "thrust_deduction",
            what="Thrust of the {names} propeller ahead that the hull takes back: t plus an amount, the race stays",
            source="Carlton, Marine Propellers and Propulsion, ch. 5",
            parameter=effect.Parameter("amount", "1", 0.0, -0.5, 0.5, 0.1, 0.03),
            joint_confused_with=("hull_fouling", "towed_load", *actuators.effect_names("thrust_loss", names)),
        ),
        *actuators.astern_thrust(names, "propeller"),
        *actuators.lag_effects(names, "propellers", "shaft"),
    )  # fmt: skip


DEFINITION = actuators.ActuatorModel(
    entry=PropellerEntry,
    numbers=NUMBERS,
    labels=("rps",), units=(1.0 / actuators.RPM_PER_RPS,), angles=(False,), work=2,
    fill_work=fill_work, force=force, still=(0.05,), alike=(0.3,),
    drives=drives,
    effects=effects, slots=SLOTS, lag="lag_s", shared=frozenset(SHARED), keeps_sign=("k_0", "k_1", "astern_0"),
    adapted=("wake_0",), numbers_of=numbers_of, shaft=shaft_load, positive=("diameter_m", "limit_rpm"),
)  # fmt: skip
