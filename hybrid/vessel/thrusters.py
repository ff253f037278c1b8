"""Forces of the azimuth pods and of the tunnel thruster (paper, eq. 6-7). SI, radians, rev/s."""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

from hybrid.vessel.compiling import Record, compiled


class Pod(NamedTuple):
    """One azimuth pod as it acts in a step: place, direction of thrust, shaft speed, share of force left."""

    x_m: float
    y_m: float
    cosine: float
    sine: float
    shaft_rps: float
    effect: float


@compiled
def scaled_azimuth(p: Record, angle_rad: float) -> float:
    """The true azimuth before its offset: the plant's factor acts on the angle within half a turn of ahead."""
    if p.azimuth_scale == 1.0:
        return angle_rad
    turns = round(angle_rad / (2.0 * pi))
    return float(p.azimuth_scale * (angle_rad - 2.0 * pi * turns))


@compiled
def port_pod(p: Record, shaft_rps: float, angle_rad: float) -> Pod:
    """The port pod at a shaft speed and a reported azimuth angle."""
    true_rad = scaled_azimuth(p, angle_rad) + p.port_angle_offset_rad
    return Pod(p.port_x_m, p.port_y_m, cos(true_rad), sin(true_rad), shaft_rps, 1.0 - p.port_thrust_loss)


@compiled
def starboard_pod(p: Record, shaft_rps: float, angle_rad: float) -> Pod:
    """The starboard pod at a shaft speed and a reported azimuth angle."""
    true_rad = scaled_azimuth(p, angle_rad) + p.starboard_angle_offset_rad
    left = 1.0 - p.starboard_thrust_loss
    return Pod(p.starboard_x_m, p.starboard_y_m, cos(true_rad), sin(true_rad), shaft_rps, left)


@compiled
def pod_force(p: Record, pod: Pod, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of one pod; ``u, v`` [m/s], ``r`` [rad/s] relative to the water.

    Thrust along the pod and the side force across it are quadratic in shaft speed and inflow; the inflow is
    that of the hull's motion at the pod.
    """
    D, n = p.propeller_diameter_m, pod.shaft_rps
    u_p, v_p = u - pod.y_m * r, v + pod.x_m * r
    u_a = u_p * pod.cosine + v_p * pod.sine
    v_c = -u_p * pod.sine + v_p * pod.cosine
    pressure = p.water_density_kgpm3 * D * D * pod.effect
    T = pressure * (
        p.thrust_nn * D * D * n * abs(n) + p.thrust_nu * D * abs(n) * u_a + p.thrust_uu * u_a * abs(u_a)
    )
    C = pressure * v_c * (p.side_nv * D * abs(n) + p.side_uv * abs(u_a) + p.side_vv * abs(v_c))
    X = T * pod.cosine - C * pod.sine
    Y = T * pod.sine + C * pod.cosine
    return X, Y, pod.x_m * Y - pod.y_m * X


@compiled
def tunnel_force(p: Record, shaft_rpm: float) -> float:
    """Side force of the tunnel thruster [N], positive to starboard; no loss with speed is modelled."""
    n = shaft_rpm
    return float(p.tunnel_cubic_n * n * n * n + p.tunnel_quadratic_n * n * abs(n) + p.tunnel_linear_n * n)
