"""The reference ship's equations once more, in plain Python and NumPy: an oracle and a yardstick of speed.

Written from the published equations with the numbers in place, independently of the package: matrices where
the package has scalars, one function for everything, no effects but a current.
"""

from __future__ import annotations

import numpy as np

from seatrial.acquisition.core.quantities import Floats

MASS, INERTIA = 410930.0, 2.1450896e7
XUD, YVD, YRD, NRD = -79320.5895, -408192.6004, 331671.6384, -12245783.9277
M = np.array([[MASS - XUD, 0.0, 0.0], [0.0, MASS - YVD, -YRD], [0.0, -YRD, INERTIA - NRD]])
PODS = ((-13.22, -2.7), (-13.22, 2.7))
CX = [-0.53, -0.59, -0.65, -0.59, -0.51, -0.47, -0.40, -0.29, -0.20, -0.18, -0.14, -0.05, 0.12, 0.37, 0.61]
CX += [0.82, 0.86, 0.72, 0.62]
CY = [
    0.0,
    0.22,
    0.40,
    0.66,
    0.83,
    0.90,
    0.88,
    0.87,
    0.86,
    0.85,
    0.83,
    0.82,
    0.81,
    0.73,
    0.58,
    0.46,
    0.26,
    0.09,
    0.0,
]
CN = [0.0, 0.05, 0.10, 0.135, 0.149, 0.148, 0.114, 0.093, 0.075, 0.04, 0.02, -0.013, -0.035, -0.041, -0.045]
CN += [-0.04, -0.029, -0.014, 0.0]
ANGLES = np.arange(0.0, 181.0, 10.0)


def hull(u: float, v: float, r: float) -> Floats:
    """Hull force with the rigid body's Coriolis terms."""
    a, b = abs(v), abs(r)
    x_basis = [u * abs(u), v * v, r * r, r * v, u * v * v, r * v * u, u * r * r, u * a]
    x = [-2100.0, 2880.5065, -29267.3371, -323707.1228, -2371.1792, 33926.4945, 83774.6548, 619.643]
    basis = [u * v, u * r, u * u * r, u * u * v, v**3, r**3, r * r * v, v * v * r, b * v, a * v, b * r, a * r]
    y = [-31000.2779, 277765.7816, 11112.4159, 777.3214, -11198.6727, 21117955.8908, -12912371.0982, 102679.0573]
    y += [485260.3423, -21640.6686, -1020386.1325, 321944.5769]
    n = [309051.5592, -2413124.664, -187538.9302, -14041.6851, -56669.589, -179720233.7453, -585678.1567]
    n += [-4278941.6707, 1626540.037, 116643.7578, -9397835.7612, -2258197.6812]
    X = np.dot(x, x_basis) - YVD * v * r - YRD * r * r + MASS * v * r
    Y = np.dot(y, basis) + XUD * u * r - MASS * u * r
    N = np.dot(n, basis) + (YVD - XUD) * u * v + YRD * u * r
    return np.array([X, Y, N])


def pod(place: tuple[float, float], n: float, angle: float, u: float, v: float, r: float) -> Floats:
    """One azimuth thruster."""
    x, y = place
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    along, across = turn @ np.array([u - y * r, v + x * r])
    D, scale = 1.9, 1025.0 * 1.9**2
    T = scale * (0.8218 * D**2 * n * abs(n) - 0.6414 * D * abs(n) * along + 0.0287 * along * abs(along))
    C = scale * (-0.9901 * D * abs(n) * across - 0.7595 * abs(along) * across + 0.3170 * abs(across) * across)
    fx, fy = turn.T @ np.array([T, C])
    return np.array([fx, fy, x * fy - y * fx])


def wind(psi: float, u: float, v: float, from_rad: float, speed: float) -> Floats:
    """The wind's force."""
    beta = from_rad + np.pi
    u_rw, v_rw = u - speed * np.cos(beta - psi), v - speed * np.sin(beta - psi)
    gamma = -np.arctan2(v_rw, u_rw)
    q = 1.23 * (u_rw**2 + v_rw**2) / 2.0
    x, y, n = (np.interp(np.rad2deg(abs(gamma)), ANGLES, table) for table in (CX, CY, CN))
    return np.array([q * 81.0 * x, q * 172.0 * np.sign(gamma) * y, q * 172.0 * 31.25 * np.sign(gamma) * n])


def derivative(state: Floats, control: Floats, air: Floats, current: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """The rate of change of (north, east, heading, u, v, r)."""
    _, _, psi, u, v, r = state
    R = np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])
    u_c, v_c, _ = R.T @ np.array([*current, 0.0])
    tau = hull(u - u_c, v - v_c, r) + wind(psi, u, v, air[0], air[1])
    tau = tau + pod(PODS[0], control[0], control[1], u - u_c, v - v_c, r)
    tau = tau + pod(PODS[1], control[2], control[3], u - u_c, v - v_c, r)
    n = control[4]
    side = 3.15982607e-4 * n**3 + 1.6094e-3 * n * abs(n) + 5.17642375 * n
    tau = tau + np.array([0.0, side, 13.08 * side])
    nu_dot = np.linalg.solve(M, tau) + np.array([v_c * r, -u_c * r, 0.0])
    return np.concatenate([R @ np.array([u, v, r]), nu_dot])


def simulate(
    start: Floats, controls: Floats, winds: Floats, dt: float, current: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Runge-Kutta of fourth order, one step a control: [K+1, 6]."""
    states = [np.asarray(start, dtype=float)]
    for control, air in zip(controls, winds, strict=True):
        x = states[-1]
        k1 = derivative(x, control, air, current)
        k2 = derivative(x + dt / 2 * k1, control, air, current)
        k3 = derivative(x + dt / 2 * k2, control, air, current)
        k4 = derivative(x + dt * k3, control, air, current)
        states.append(x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return np.array(states)
