"""The hull of the standard MMG method: a polynomial of v' and r' times the square of the speed.

Yasukawa and Yoshimura, Introduction of MMG standard method for ship maneuvering predictions, J Mar Sci Technol 20
(2015), 37-52. Midship axes or any others on the centre line, relative to the water.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel.hulls.kind import HullEntry, HullModel, coefficient_names

ASTERN_SHARE = 0.3
"""The published resistance goes with the speed squared; below this share of it ahead, it fades and turns around."""

LARGEST_YAW_RATE = 2.0
"""The largest r' = r L / U at which the third-order terms divide by the speed; beyond, it spins on the spot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mmg(HullEntry):
    """A hull's derivatives without dimension: forces by rho/2 L d U^2, moments by L times that."""

    model: Literal["mmg"]
    R_0: Number
    X_vv: Number
    X_vr: Number
    X_rr: Number
    X_vvvv: Number
    Y_v: Number
    Y_r: Number
    Y_vvv: Number
    Y_vvr: Number
    Y_vrr: Number
    Y_rrr: Number
    N_v: Number
    N_r: Number
    N_vvv: Number
    N_vvr: Number
    N_vrr: Number
    N_rrr: Number


NUMBERS = coefficient_names(Mmg)
(
    R_0, X_VV, X_VR, X_RR, X_VVVV, Y_V, Y_R, Y_VVV, Y_VVR, Y_VRR, Y_RRR, N_V, N_R, N_VVV, N_VVR, N_VRR, N_RRR,
) = range(len(NUMBERS))  # fmt: skip


@compiled
def force(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the speeds ``u, v`` [m/s] and yaw rate ``r`` [rad/s]."""
    h = p.hull
    L = p.length_between_perpendiculars_m
    q = 0.5 * p.water_density_kgpm3 * L * p.draught_m
    U, w = hypot(u, v), r * L
    inverse_speed = 1.0 / max(U, abs(w) / LARGEST_YAW_RATE, 1e-9)
    vv, vw, ww = v * v, v * w, w * w
    resisted = U * min(max(u / ASTERN_SHARE, -U), U)
    X = (
        -h[R_0] * resisted
        + h[X_VV] * vv
        + h[X_VR] * vw
        + h[X_RR] * ww
        + h[X_VVVV] * vv * vv * inverse_speed * inverse_speed
    )
    Y = (h[Y_V] * v + h[Y_R] * w) * U + inverse_speed * (
        h[Y_VVV] * vv * v + h[Y_VVR] * vv * w + h[Y_VRR] * v * ww + h[Y_RRR] * ww * w
    )
    N = (h[N_V] * v + h[N_R] * w) * U + inverse_speed * (
        h[N_VVV] * vv * v + h[N_VVR] * vv * w + h[N_VRR] * v * ww + h[N_RRR] * ww * w
    )
    return q * X - p.Yvd * v * r - p.Yrd * r * r, q * Y + p.Xud * u * r, q * L * N


MMG = HullModel(
    entry=Mmg,
    numbers=NUMBERS,
    force=force, linear=("Y_v", "Y_r", "N_v", "N_r"), resistance=("R_0",), cross_flow_drag=("Y_vvv", "N_vvv"),
    drift_force=("Y_v",), drift_moment=("N_v",), turning_force=("Y_r", "Y_rrr"), turning_drag=("X_vr", "X_rr"),
    yaw_damping=("N_r", "N_rrr"), keeps_sign=("R_0",), primed=True,
)  # fmt: skip
