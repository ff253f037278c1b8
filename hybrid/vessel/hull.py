"""Forces of the water on the hull (paper, eq. 3-4), with the added-mass Coriolis terms in them.

Coefficients and structure of the published R/V Gunnerus manoeuvring model; there are no linear terms, so
near standstill the damping is quadratic only. Everything here is relative to the water, SI and radians.
"""

from __future__ import annotations

from analysis.compiling import Record, compiled


@compiled
def hull_force(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Hull force and moment X [N], Y [N], N [N m] at the speeds ``u, v`` [m/s] and yaw rate ``r`` [rad/s]."""
    au, av, ar = abs(u), abs(v), abs(r)
    uu, vv, rr, uv, ur, rv = u * u, v * v, r * r, u * v, u * r, r * v
    X = (
        -p.Yvd * rv
        - p.Yrd * rr
        + p.Xuu * u * au
        + p.Xvv * vv
        + p.Xrr * rr
        + p.Xrv * rv
        + p.Xuvv * u * vv
        + p.Xrvu * rv * u
        + p.Xurr * u * rr
        + p.Xu_absv * u * av
    )
    Y = (
        p.Xud * ur
        + p.Yuv * uv
        + p.Yur * ur
        + p.Yuur * uu * r
        + p.Yuuv * uu * v
        + p.Yvvv * vv * v
        + p.Yrrr * rr * r
        + p.Yrrv * rr * v
        + p.Yvvr * vv * r
        + p.Y_absr_v * ar * v
        + p.Y_absv_v * av * v
        + p.Y_absr_r * ar * r
        + p.Y_absv_r * av * r
    )
    N = (
        (p.Yvd - p.Xud) * uv
        + p.Yrd * ur
        + p.Nuv * uv
        + p.Nur * ur
        + p.Nuur * uu * r
        + p.Nuuv * uu * v
        + p.Nvvv * vv * v
        + p.Nrrr * rr * r
        + p.Nrrv * rr * v
        + p.Nvvr * vv * r
        + p.N_absr_v * ar * v
        + p.N_absv_v * av * v
        + p.N_absr_r * ar * r
        + p.N_absv_r * av * r
    )
    return X, Y, N
