"""The reference ship's equations as a bare compiled loop: numbers in place, no plant, no effects, no checks.

What the simulator is timed against. The same equations as ``tests/hybrid/gunnerus_by_hand.py``, in scalars.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin

import numpy as np
from numba import njit

from tests.hybrid import gunnerus_by_hand as by_hand

MASS, XUD, YVD, YRD = by_hand.MASS, by_hand.XUD, by_hand.YVD, by_hand.YRD
INVERSE = np.linalg.inv(by_hand.M)
CX, CY, CN = (np.array(table) for table in (by_hand.CX, by_hand.CY, by_hand.CN))
bare = njit(fastmath={"contract"}, error_model="numpy")


@bare
def hull(u, v, r):
    a, b = abs(v), abs(r)
    X = -2100.0 * u * abs(u) + 2880.5065 * v * v - 29267.3371 * r * r - 323707.1228 * r * v
    X += -2371.1792 * u * v * v + 33926.4945 * r * v * u + 83774.6548 * u * r * r + 619.643 * u * a
    Y = -31000.2779 * u * v + 277765.7816 * u * r + 11112.4159 * u * u * r + 777.3214 * u * u * v
    Y += -11198.6727 * v * v * v + 21117955.8908 * r * r * r - 12912371.0982 * r * r * v + 102679.0573 * v * v * r
    Y += 485260.3423 * b * v - 21640.6686 * a * v - 1020386.1325 * b * r + 321944.5769 * a * r
    N = 309051.5592 * u * v - 2413124.664 * u * r - 187538.9302 * u * u * r - 14041.6851 * u * u * v
    N += -56669.589 * v * v * v - 179720233.7453 * r * r * r - 585678.1567 * r * r * v - 4278941.6707 * v * v * r
    N += 1626540.037 * b * v + 116643.7578 * a * v - 9397835.7612 * b * r - 2258197.6812 * a * r
    X += -YVD * v * r - YRD * r * r + MASS * v * r
    return X, Y + XUD * u * r - MASS * u * r, N + (YVD - XUD) * u * v + YRD * u * r


@bare
def pod(y, n, cosine, sine, u, v, r):
    x, scale = -13.22, 1025.0 * 1.9**2
    at_u, at_v = u - y * r, v + x * r
    along, across = cosine * at_u + sine * at_v, cosine * at_v - sine * at_u
    T = scale * (0.8218 * 1.9**2 * n * abs(n) - 0.6414 * 1.9 * abs(n) * along + 0.0287 * along * abs(along))
    C = scale * (-0.9901 * 1.9 * abs(n) * across - 0.7595 * abs(along) * across + 0.3170 * abs(across) * across)
    fx, fy = cosine * T - sine * C, sine * T + cosine * C
    return fx, fy, x * fy - y * fx


@bare
def rate(x, c, turns, north_air, east_air):
    cosine, sine, u, v, r = cos(x[2]), sin(x[2]), x[3], x[4], x[5]
    X, Y, N = hull(u, v, r)
    pX, pY, pN = pod(-2.7, c[0], turns[0], turns[1], u, v, r)
    sX, sY, sN = pod(2.7, c[2], turns[2], turns[3], u, v, r)
    u_rw = u - north_air * cosine - east_air * sine
    v_rw = v - east_air * cosine + north_air * sine
    gamma = -atan2(v_rw, u_rw)
    q, place = 0.615 * (u_rw * u_rw + v_rw * v_rw), abs(gamma) * 18.0 / pi
    k = min(int(place), 17)
    f, side_of = place - k, (gamma > 0.0) - (gamma < 0.0)
    X += pX + sX + q * 81.0 * (CX[k] + f * (CX[k + 1] - CX[k]))
    side = 3.15982607e-4 * c[4] ** 3 + 1.6094e-3 * c[4] * abs(c[4]) + 5.17642375 * c[4]
    Y += pY + sY + q * 172.0 * side_of * (CY[k] + f * (CY[k + 1] - CY[k])) + side
    N += pN + sN + q * 172.0 * 31.25 * side_of * (CN[k] + f * (CN[k + 1] - CN[k])) + 13.08 * side
    return (
        u * cosine - v * sine, u * sine + v * cosine, r,
        INVERSE[0, 0] * X, INVERSE[1, 1] * Y + INVERSE[1, 2] * N, INVERSE[2, 1] * Y + INVERSE[2, 2] * N,
    )  # fmt: skip


@bare
def plus(x, k, h):
    return x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3], x[4] + h * k[4], x[5] + h * k[5]


@bare
def simulate(start, controls, winds, dt, states):
    """Fill ``states`` [K+1, 6], Runge-Kutta of fourth order, one step a control."""
    x = (start[0], start[1], start[2], start[3], start[4], start[5])
    states[0] = start
    for i in range(len(controls)):
        c = controls[i]
        turns = cos(c[1]), sin(c[1]), cos(c[3]), sin(c[3])
        north, east = -winds[i, 1] * cos(winds[i, 0]), -winds[i, 1] * sin(winds[i, 0])
        k1 = rate(x, c, turns, north, east)
        k2 = rate(plus(x, k1, dt / 2), c, turns, north, east)
        k3 = rate(plus(x, k2, dt / 2), c, turns, north, east)
        k4 = rate(plus(x, k3, dt), c, turns, north, east)
        x = plus(plus(plus(plus(x, k1, dt / 6), k2, dt / 3), k3, dt / 3), k4, dt / 6)
        for j in range(6):
            states[i + 1, j] = x[j]
