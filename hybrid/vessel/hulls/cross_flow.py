"""A hull at low speed: linear lift and the drag of the flow across it, summed along the length.

Yoshimura, Nakao and Ishibashi, Unified mathematical model for ocean and harbour manoeuvring, MARSIM 2009; the form
that Osaka University's group uses for Esso Osaka (Miyauchi et al. 2022). Midship axes, relative to the water.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot, pi
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel.hulls.kind import HullEntry, HullModel, coefficient_names

EVEN_FLOW = 1e-3
"""Where the flow across differs by less than this share along the ship, the integral is its series."""

NO_FLOW = 1e-100
"""A speed [m/s] whose square is still a number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossFlow(HullEntry):
    """Coefficients without dimension: forces by rho/2 L d U^2, moments by L times that.

    ``X_0F`` and ``X_0A`` are the resistance ahead and astern (negative), ``C_D`` the drag of the flow across,
    ``C_rY`` and ``C_rN`` how much of the yaw rate counts in it for force and moment.
    """

    model: Literal["cross_flow"]
    X_0F: Number
    X_0A: Number
    X_vr: Number
    Y_v: Number
    Y_r: Number
    C_D: Number
    C_rY: Number
    N_v: Number
    N_r: Number
    C_rN: Number


NUMBERS = coefficient_names(CrossFlow)
X_0F, X_0A, X_VR, Y_V, Y_R, C_D, C_RY, N_V, N_R, C_RN = range(len(NUMBERS))


@compiled
def cross_flow_drag_integrals(v: float, w: float) -> tuple[float, float]:
    """The integrals of |v + w s| (v + w s) and of that times s, over s from -1/2 to 1/2."""
    if abs(w) <= EVEN_FLOW * abs(v) + NO_FLOW:
        return v * abs(v), abs(v) * w / 6.0
    fore, aft = v + 0.5 * w, v - 0.5 * w
    first = (abs(fore) ** 3 - abs(aft) ** 3) / 3.0
    second = (fore * abs(fore) ** 3 - aft * abs(aft) ** 3) / 4.0
    return first / w, (second - v * first) / (w * w)


@compiled
def force(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the speeds ``u, v`` [m/s] and yaw rate ``r`` [rad/s]."""
    h = p.hull
    L = p.length_between_perpendiculars_m
    q = 0.5 * p.water_density_kgpm3 * L * p.draught_m
    w = r * L
    resistance = h[X_0F] + (h[X_0A] - h[X_0F]) * abs(atan2(v, u)) / pi
    X = resistance * u * hypot(u, v) + h[X_VR] * v * w
    across_Y, _ = cross_flow_drag_integrals(v, h[C_RY] * w)
    _, across_N = cross_flow_drag_integrals(v, h[C_RN] * w)
    Y = h[Y_V] * v * abs(u) + h[Y_R] * w * u - h[C_D] * across_Y
    N = h[N_V] * v * u + h[N_R] * w * abs(u) - h[C_D] * across_N
    return q * X - p.Yvd * v * r - p.Yrd * r * r, q * Y + p.Xud * u * r, q * L * N


CROSS_FLOW = HullModel(
    entry=CrossFlow,
    numbers=NUMBERS,
    force=force, linear=("Y_v", "Y_r", "N_v", "N_r"), resistance=("X_0F", "X_0A"), cross_flow_drag=("C_D",),
    drift_force=("Y_v",), drift_moment=("N_v",), turning_force=("Y_r",), turning_drag=("X_vr",),
    yaw_damping=("N_r",), keeps_sign=("X_0F", "X_0A", "C_D", "C_rY", "C_rN"), primed=True,
)  # fmt: skip
