"""The hull as a polynomial of u, v, r (paper, eq. 3-4), with the added-mass Coriolis terms beside it.

Structure of the published R/V Gunnerus manoeuvring model; there are no linear terms, so near standstill the damping
is quadratic only. Everything here is relative to the water, SI and radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel.hulls.kind import HullEntry, HullModel, coefficient_names, stated_coefficients


@dataclass(frozen=True, slots=True, kw_only=True)
class Polynomial(HullEntry):
    """A hull as a polynomial of u, v, r by Fossen's names; ``absr``, ``absv`` stand for \\|r\\| and \\|v\\|.

    With ``units = "primed"`` they are without dimension: forces by rho/2 L d U^2, moments by L times that, speeds
    by U, yaw rates by U / L. Those of third order then hold at the speed ``reference_speed_mps``.
    """

    model: Literal["polynomial"]
    Xuu: Number
    Xvv: Number
    Xrr: Number
    Xrv: Number
    Xuvv: Number
    Xrvu: Number
    Xurr: Number
    Xu_absv: Number
    Yuv: Number
    Yur: Number
    Yuur: Number
    Yuuv: Number
    Yvvv: Number
    Yrrr: Number
    Yrrv: Number
    Yvvr: Number
    Y_absr_v: Number
    Y_absv_v: Number
    Y_absr_r: Number
    Y_absv_r: Number
    Nuv: Number
    Nur: Number
    Nuur: Number
    Nuuv: Number
    Nvvv: Number
    Nrrr: Number
    Nrrv: Number
    Nvvr: Number
    N_absr_v: Number
    N_absv_v: Number
    N_absr_r: Number
    N_absv_r: Number

    units: Literal["si", "primed"] = "si"
    reference_speed_mps: Number = 1.0


NUMBERS = coefficient_names(Polynomial)
(
    XUU, XVV, XRR, XRV, XUVV, XRVU, XURR, XU_ABSV, YUV, YUR, YUUR, YUUV, YVVV, YRRR, YRRV, YVVR, Y_ABSR_V,
    Y_ABSV_V, Y_ABSR_R, Y_ABSV_R, NUV, NUR, NUUR, NUUV, NVVV, NRRR, NRRV, NVVR, N_ABSR_V, N_ABSV_V, N_ABSR_R,
    N_ABSV_R,
) = range(len(NUMBERS))  # fmt: skip


@compiled
def force(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the speeds ``u, v`` [m/s] and yaw rate ``r`` [rad/s]."""
    h = p.hull
    au, av, ar = abs(u), abs(v), abs(r)
    uu, vv, rr, uv, ur, rv = u * u, v * v, r * r, u * v, u * r, r * v
    X = (
        -p.Yvd * rv - p.Yrd * rr + h[XUU] * u * au + h[XVV] * vv + h[XRR] * rr + h[XRV] * rv
        + h[XUVV] * u * vv + h[XRVU] * rv * u + h[XURR] * u * rr + h[XU_ABSV] * u * av
    )  # fmt: skip
    Y = (
        p.Xud * ur + h[YUV] * uv + h[YUR] * ur + h[YUUR] * uu * r + h[YUUV] * uu * v
        + h[YVVV] * vv * v + h[YRRR] * rr * r + h[YRRV] * rr * v + h[YVVR] * vv * r
        + h[Y_ABSR_V] * ar * v + h[Y_ABSV_V] * av * v + h[Y_ABSR_R] * ar * r + h[Y_ABSV_R] * av * r
    )  # fmt: skip
    N = (
        (p.Yvd - p.Xud) * uv + p.Yrd * ur + h[NUV] * uv + h[NUR] * ur + h[NUUR] * uu * r
        + h[NUUV] * uu * v + h[NVVV] * vv * v + h[NRRR] * rr * r + h[NRRV] * rr * v
        + h[NVVR] * vv * r + h[N_ABSR_V] * ar * v + h[N_ABSV_V] * av * v + h[N_ABSR_R] * ar * r
        + h[N_ABSV_R] * av * r
    )  # fmt: skip
    return X, Y, N


def in_si(entry: Polynomial, water_density_kgpm3: float, length_m: float, draught_m: float) -> tuple[float, ...]:
    """The coefficients in SI, whichever the entry states."""
    values = stated_coefficients(entry, water_density_kgpm3, length_m, draught_m)
    if entry.units == "si":
        return values
    q = 0.5 * water_density_kgpm3 * length_m * draught_m

    def unit(name: str) -> float:
        factors = name[1:].replace("abs", "").replace("_", "")
        levers = name.startswith("N") + factors.count("r")
        return float(q * length_m**levers * entry.reference_speed_mps ** (2 - len(factors)))

    return tuple(value * unit(name) for value, name in zip(values, NUMBERS, strict=True))


POLYNOMIAL = HullModel(
    entry=Polynomial,
    numbers=NUMBERS,
    force=force, in_si=in_si, linear=("Yuv", "Yur", "Nuv", "Nur"), resistance=("Xuu",),
    cross_flow_drag=("Y_absv_v", "N_absv_v"), drift_force=("Yuv", "Yuuv", "Yvvv"),
    drift_moment=("Nuv", "Nuuv", "Nvvv"), turning_force=("Yur", "Yuur", "Yrrr", "Y_absr_r"),
    turning_drag=("Xrr", "Xurr", "Xrv", "Xrvu"), yaw_damping=("Nur", "Nuur", "Nrrr", "N_absr_r"),
    keeps_sign=("Xuu",), munk=True,
)  # fmt: skip
