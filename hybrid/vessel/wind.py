"""Force of the wind on hull and superstructure: from a table over the angle (paper, eq. 5), or harmonics of it."""

from __future__ import annotations

from math import atan2, cos, pi, sin

from analysis.compiling import Record, compiled

TABLE_SIZE = 19
TABLE, HARMONICS = 0.0, 1.0
"""How a plant's ``wind_model`` says what CX, CY and CN hold."""
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
def harmonic_force(p: Record, q: float, u_rw: float, v_rw: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the dynamic pressure ``q`` [Pa], of Fujiwara's harmonics.

    The angle of attack is counted from the bow towards port, where the air then comes from. X of its multiples
    0, 1, 3 and 5, Y of 1, 3 and 5, N of 1, 2 and 3. Fujiwara, Ueno and Nimura, J Soc Nav Archit Jpn 183 (1998), 77.
    """
    angle = -atan2(v_rw, u_rw)
    X = p.CX[0] + p.CX[1] * cos(angle) + p.CX[2] * cos(3.0 * angle) + p.CX[3] * cos(5.0 * angle)
    Y = p.CY[0] * sin(angle) + p.CY[1] * sin(3.0 * angle) + p.CY[2] * sin(5.0 * angle)
    N = p.CN[0] * sin(angle) + p.CN[1] * sin(2.0 * angle) + p.CN[2] * sin(3.0 * angle)
    length_m = p.length_between_perpendiculars_m
    return q * p.frontal_area_m2 * X, q * p.lateral_area_m2 * Y, q * p.lateral_area_m2 * length_m * N


@compiled
def wind_force(p: Record, u_rw: float, v_rw: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the ship's velocity relative to the air, body axes [m/s].

    Coefficients in a table are linear between its points, every 10 degrees of the angle between the bow and the
    direction the wind comes from; otherwise CX, CY and CN begin with the amplitudes of harmonics of that angle.
    """
    q = 0.5 * p.air_density_kgpm3 * (u_rw * u_rw + v_rw * v_rw) * p.wind_load_factor
    if p.wind_model != TABLE:
        X, Y, N = harmonic_force(p, q, u_rw, v_rw)
        return X, Y, N
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
