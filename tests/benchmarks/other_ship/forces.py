"""Forces on the ship in four degrees of freedom, compiled: hull, pods, tunnel, wind, drift, heel.

The published Gunnerus model in other clothes: its hull terms, the added-mass and the rigid-body Coriolis terms
are one matrix of coefficients times one vector of monomials of u, v, r relative to the water.
"""

from __future__ import annotations

from math import atan2, cos, exp, pi, sin
from typing import NamedTuple

import numpy as np
from numba import njit

from seatrial.acquisition.core.quantities import Floats
from tests.benchmarks.other_ship.outside import Outside, bank_force, lift_left, thrust_left
from tests.benchmarks.other_ship.sheet import Sheet

Three = tuple[float, float, float]
Control = tuple[float, float, float, float, float]
"""Port shaft [rev/s] and angle [rad], starboard shaft and angle, tunnel [rpm]."""
GRAVITY_MPS2 = 9.81

MONOMIALS = (
    "uu", "vv", "rr", "rv", "uvv", "rvu", "urr", "u_absv", "ur", "uv", "uur", "uuv", "vvv", "rrr", "rrv", "vvr",
    "absr_v", "absv_v", "absr_r", "absv_r",
)  # fmt: skip
"""`uu` is u|u| here; the order is that of :func:`monomials`."""

POWERS = np.array(
    [
        (a, b, c, d)
        for a in range(4)
        for b in range(4)
        for c in range(4)
        for d in range(4)
        if 1 <= a + b + c + d <= 3
    ]
)
"""Exponents of u, v, r and azimuth angle in the polynomial model error."""


class Heel(NamedTuple):
    """Roll: inertia, stiffness, damping, levers of lateral forces, and what heel does to the other three."""

    inertia_kgm2: float
    stiffness_nm: float
    damping_nms: float
    hull_lever_m: float
    pod_lever_m: float
    wind_lever_m: float
    resistance: float
    side: float
    turning: float


class Body(NamedTuple):
    """Everything that pushes the ship, packed for the compiled loop."""

    hull: Floats  # [3, monomials]
    inverse_mass: Floats  # [3, 3]
    mass_kg: float
    pods: Floats  # port and starboard: x, y [m], offset [rad], share left, factors on the angle and astern
    curve: Floats  # thrust: n|n|, |n| u, u|u|; side: |n|, |u|, |v| (times v)
    tunnel: Floats  # x [m], cubic, quadratic, linear, speed ahead that halves the force [m/s]
    wind: Floats  # [3, 19] areas times coefficients, half the air's density in them
    length_m: float
    drift: Floats  # size [N], direction it goes to [rad]
    steady: Floats  # X, Y [N], N [N m]
    dying: Floats  # how surge, sway and yaw die out near rest: inertia a second
    heel: Heel
    error: Floats  # [3, len(POWERS)], all zero without a polynomial error
    error_scale: Floats  # of u, v, r, azimuth angle


def body_of(sheet: Sheet, heel_coupling: bool) -> Body:
    """The data sheet packed for the compiled loop."""
    numbers = sheet.numbers
    pods, tunnel, wind, size = (numbers[part] for part in ("pods", "tunnel", "wind", "dimensions"))
    density, D = numbers["water_density_kgpm3"], pods["diameter_m"]
    curve = [pods["thrust_nn"] * D * D, pods["thrust_nu"] * D, pods["thrust_uu"]]
    curve += [pods["side_nv"] * D, pods["side_uv"], pods["side_vv"]]
    places = [
        (
            pods[f"{side}_x_m"],
            pods[f"{side}_y_m"],
            sheet.pod_offset_rad[i],
            sheet.pod_share[i],
            sheet.azimuth_factor,
            sheet.pod_astern[i],
        )
        for i, side in enumerate(("port", "starboard"))
    ]
    air = 0.5 * wind["air_density_kgpm3"]
    lateral = air * wind["lateral_area_m2"]
    jet = [tunnel["x_m"], tunnel["cubic_n"], tunnel["quadratic_n"], tunnel["linear_n"]]
    areas = np.array([[air * wind["frontal_area_m2"]], [lateral], [lateral * size["length_overall_m"]]])
    inertia = _mass_matrix(sheet)
    return Body(
        hull_matrix(sheet),
        np.asarray(np.linalg.inv(inertia), dtype=np.float64),
        numbers["inertia"]["mass_kg"],
        np.array(places),
        density * D * D * np.array(curve),
        np.array([*jet, sheet.tunnel_half_speed_mps]),
        areas * np.array([wind["CX"], wind["CY"], wind["CN"]]),
        size["length_overall_m"],
        np.array(sheet.drift_n),
        np.array(sheet.steady_force),
        np.diag(inertia) * sheet.dies_out_ps,
        _heel(sheet, heel_coupling),
        np.zeros((3, len(POWERS))),
        np.ones(4),
    )


def hull_matrix(sheet: Sheet) -> Floats:
    """Coefficients [3, monomials] of X, Y and N with both kinds of Coriolis terms."""
    inertia, growth = sheet.numbers["inertia"], sheet.hull_growth
    m, Xud, Yvd, Yrd = (inertia[name] for name in ("mass_kg", "Xud", "Yvd", "Yrd"))
    matrix = np.zeros((3, len(MONOMIALS)))
    for row, section in enumerate(("surge", "sway", "yaw")):
        for name, value in sheet.numbers[section].items():
            matrix[row, MONOMIALS.index(name[1:].removeprefix("_"))] = value
    uv, ur, rv, rr = (MONOMIALS.index(name) for name in ("uv", "ur", "rv", "rr"))
    matrix[1, ur] += Xud
    matrix[2, uv] += Yvd - Xud
    matrix[2, ur] += Yrd
    for row, letter in ((1, "Y"), (2, "N")):  # shallow water makes whole derivatives grow
        for column, name in enumerate(MONOMIALS):
            key = letter + ("_" if "abs" in name else "") + name
            matrix[row, column] *= growth.get(key, 1.0)
    matrix[0, rv] += m - sheet.added_mass_growth[0] * Yvd
    matrix[0, rr] -= Yrd
    matrix[1, ur] -= m
    return matrix


def _mass_matrix(sheet: Sheet) -> Floats:
    inertia = sheet.numbers["inertia"]
    sway, yaw = sheet.added_mass_growth
    m, cross = inertia["mass_kg"], -inertia["Yrd"]
    return np.array(
        [
            [m - inertia["Xud"], 0.0, 0.0],
            [0.0, m - sway * inertia["Yvd"], cross],
            [0.0, cross, inertia["yaw_inertia_kgm2"] - yaw * inertia["Nrd"]],
        ]
    )


def _heel(sheet: Sheet, coupled: bool) -> Heel:
    """A stiff little ship: metacentric height 1.2 m, roll period some 7 s; heel acts on the rest weakly."""
    size, mass = sheet.numbers["dimensions"], sheet.numbers["inertia"]["mass_kg"]
    inertia = 1.2 * mass * (0.38 * size["beam_m"]) ** 2
    stiffness = mass * GRAVITY_MPS2 * 1.2
    plane = 0.5 * sheet.numbers["water_density_kgpm3"] * size["draught_m"] * size["length_between_perpendiculars_m"]
    on = float(coupled)
    return Heel(
        inertia,
        stiffness,
        2.0 * 0.08 * (inertia * stiffness) ** 0.5,
        0.7 * size["draught_m"],
        size["draught_m"],
        -size["draught_m"],
        resistance=on,
        side=on * 0.005 * plane,
        turning=-on * 0.002 * plane * size["length_between_perpendiculars_m"],
    )


@njit(error_model="numpy")
def hull_force(hull: Floats, u: float, v: float, r: float) -> Three:
    """X, Y [N] and N [N m] on the hull, Coriolis terms included."""
    au, av, ar = abs(u), abs(v), abs(r)
    terms = (
        u * au, v * v, r * r, r * v, u * v * v, r * v * u, u * r * r, u * av, u * r, u * v, u * u * r, u * u * v,
        v * v * v, r * r * r, r * r * v, v * v * r, ar * v, av * v, ar * r, av * r,
    )  # fmt: skip
    X = Y = N = 0.0
    for i in range(len(terms)):
        X += hull[0, i] * terms[i]
        Y += hull[1, i] * terms[i]
        N += hull[2, i] * terms[i]
    return X, Y, N


@njit(error_model="numpy")
def dying_force(body: Body, u: float, v: float, r: float) -> Three:
    """X, Y [N] and N [N m] in proportion to the motion; above a knot or so nothing is left of them."""
    share = exp(-5.0 * (u**2 + v**2))
    return -share * body.dying[0] * u, -share * body.dying[1] * v, -share * body.dying[2] * r


@njit(error_model="numpy")
def pod_force(
    body: Body, o: Outside, which: int, n: float, angle: float, time_s: float, u: float, v: float, r: float
) -> Three:
    """X, Y [N] and N [N m] of one pod at ``n`` rev/s and a reported angle [rad]."""
    x, y, offset, share, factor, astern = body.pods[which]
    true_angle = factor * angle + offset
    c = body.curve
    ahead, aside = cos(true_angle), sin(true_angle)
    inflow_x, inflow_y = u - y * r, v + x * r
    along = inflow_x * ahead + inflow_y * aside
    across = inflow_y * ahead - inflow_x * aside
    turning = (astern if n < 0 else 1.0) * (c[0] * n + c[1] * along) * abs(n)
    thrust = (turning + c[2] * along * abs(along)) * thrust_left(o, time_s)
    lift = across * (c[3] * abs(n) + c[4] * abs(along) + c[5] * abs(across)) * lift_left(o, true_angle)
    X = share * (thrust * ahead - lift * aside)
    Y = share * (thrust * aside + lift * ahead)
    return X, Y, x * Y - y * X


@njit(error_model="numpy")
def thruster_force(body: Body, o: Outside, control: Control, time_s: float, u: float, v: float, r: float) -> Three:
    """X, Y [N] and N [N m] of both pods and the tunnel thruster (rev/s, rad, rev/s, rad, rpm)."""
    Xp, Yp, Np = pod_force(body, o, 0, control[0], control[1], time_s, u, v, r)
    Xs, Ys, Ns = pod_force(body, o, 1, control[2], control[3], time_s, u, v, r)
    t, n = body.tunnel, control[4]
    side = ((t[1] * n + t[2] * (1.0 if n > 0 else -1.0)) * n + t[3]) * n
    side /= 1.0 + (u / t[4]) ** 2
    return Xp + Xs, Yp + Ys + side, Np + Ns + t[0] * side


@njit(error_model="numpy")
def wind_force(body: Body, u_rw: float, v_rw: float) -> Three:
    """X, Y [N] and N [N m] of the air at the ship's velocity through it [m/s]."""
    square = u_rw * u_rw + v_rw * v_rw
    gamma = -atan2(v_rw, u_rw)
    place = abs(gamma) / pi * 18.0
    low = min(int(place), 17)
    part = place - low
    side = np.sign(gamma)
    X = square * (body.wind[0, low] * (1.0 - part) + body.wind[0, low + 1] * part)
    Y = square * (body.wind[1, low] * (1.0 - part) + body.wind[1, low + 1] * part)
    N = square * (body.wind[2, low] * (1.0 - part) + body.wind[2, low + 1] * part)
    return X, side * Y, side * N


@njit(error_model="numpy")
def drift_force(force_n: float, relative_rad: float, length_m: float) -> Three:
    """Second-order wave force X, Y [N], N [N m]; the waves go ``relative_rad`` off the bow."""
    c, s = cos(relative_rad), sin(relative_rad)
    return 0.35 * force_n * c, force_n * s, 0.06 * length_m * force_n * 2.0 * s * c


@njit(error_model="numpy")
def polynomial_error(body: Body, u: float, v: float, r: float, angle: float) -> Three:
    """The model error as a smooth body force; its arguments stay within 1.2 of their scales."""
    scaled = (
        u / body.error_scale[0],
        v / body.error_scale[1],
        r / body.error_scale[2],
        angle / body.error_scale[3],
    )
    X = Y = N = 0.0
    for i in range(POWERS.shape[0]):
        term = 1.0
        for j in range(4):
            z = min(max(scaled[j], -1.2), 1.2)
            for _ in range(POWERS[i, j]):
                term *= z
        X += body.error[0, i] * term
        Y += body.error[1, i] * term
        N += body.error[2, i] * term
    return X, Y, N


@njit(error_model="numpy")
def heel_force(heel: Heel, resistance_n: float, u: float, roll: float) -> Three:
    """What heel does to the other three: more resistance, and the asymmetry of the heeled hull."""
    speed = u * abs(u)
    return heel.resistance * resistance_n * roll * roll, heel.side * speed * roll, heel.turning * speed * roll


@njit(error_model="numpy")
def outside_force(o: Outside, north: float, east: float, heading: float) -> Three:
    """Forces outside every catalogue that hang on place and heading."""
    Y, N = 0.0, 0.0
    if o.bank_n != 0.0:
        Y, N = bank_force(o, north, east, heading)
    return 0.0, Y, N + o.yaw_moment_nm * sin(4.0 * heading)
