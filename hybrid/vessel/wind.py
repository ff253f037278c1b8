"""Force of the wind on hull and superstructure (paper, eq. 5)."""

from __future__ import annotations

from math import atan2, cos, pi, sin

from analysis.compiling import Record, compiled

TABLE_SIZE = 19
_PER_STEP = (TABLE_SIZE - 1) / pi


@compiled
def wind_vector(p: Record, direction_rad: float, speed_mps: float) -> tuple[float, float]:
    """North and east component [m/s] of the air's motion, from the reported direction the wind comes FROM.

    This is the only door at which "from" becomes "to"; the vane's bias and its factor are taken out here.
    """
    true_rad = direction_rad - p.wind_direction_bias_rad
    speed = speed_mps / p.wind_speed_factor
    return -speed * cos(true_rad), -speed * sin(true_rad)


@compiled
def wind_force(p: Record, u_rw: float, v_rw: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the ship's velocity relative to the air, body axes [m/s].

    The coefficients are linear between the points of the tables, every 10 degrees of the angle between the
    bow and the direction the wind comes from.
    """
    q = 0.5 * p.air_density_kgpm3 * (u_rw * u_rw + v_rw * v_rw) * p.wind_load_factor
    position = abs(atan2(v_rw, u_rw)) * _PER_STEP
    low = min(int(position), TABLE_SIZE - 2) if position >= 0.0 else 0  # NaN compares false
    part = position - low
    CX = p.CX[low] + part * (p.CX[low + 1] - p.CX[low])
    CY = p.CY[low] + part * (p.CY[low + 1] - p.CY[low])
    CN = p.CN[low] + part * (p.CN[low + 1] - p.CN[low])
    side = 0.0
    if v_rw > 0.0:
        side = -1.0
    elif v_rw < 0.0:
        side = 1.0
    lateral = q * p.lateral_area_m2 * side
    return q * p.frontal_area_m2 * CX, lateral * CY, lateral * p.length_overall_m * CN
