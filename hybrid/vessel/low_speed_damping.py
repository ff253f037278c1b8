"""Linear damping near rest, which no hull model has: potential damping and laminar skin friction.

Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 6: stated by the time
constants at which surge, sway and yaw die out. Under way the terms by squares of the speed have it in them already;
so it fades as exp(-5 U^2), as in the author's MSS toolbox (forceSurgeDamping.m, alpha = 5).
"""

from __future__ import annotations

from math import exp

from analysis.compiling import Record, compiled

FADING_S2PM2 = 5.0


@compiled
def low_speed_damping(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the speeds through the water ``u, v`` [m/s] and yaw rate ``r``
    [rad/s].
    """
    if p.surge_damping_ps == 0.0 and p.sway_damping_ps == 0.0 and p.yaw_damping_ps == 0.0:
        return 0.0, 0.0, 0.0
    left = exp(-FADING_S2PM2 * (u * u + v * v))
    x_G = p.centre_of_gravity_m
    yaw_inertia = p.yaw_inertia_kgm2 + p.mass_kg * x_G * x_G - p.Nrd
    return (
        -left * p.surge_damping_ps * (p.mass_kg - p.Xud) * u,
        -left * p.sway_damping_ps * (p.mass_kg - p.Yvd) * v,
        -left * p.yaw_damping_ps * yaw_inertia * r,
    )
