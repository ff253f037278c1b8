"""The ship under way, compiled: orders, drives with limits, and Heun's method on speeds through the water."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import source_stamp
from tests.benchmarks.other_ship.forces import (
    Body,
    Control,
    Three,
    drift_force,
    dying_force,
    heel_force,
    hull_force,
    outside_force,
    polynomial_error,
    thruster_force,
    wind_force,
)
from tests.benchmarks.other_ship.outside import Outside, sheared, through, tow
from tests.benchmarks.other_ship.programmes import STEER, TURN, ZIGZAG

State = tuple[float, float, float, float, float, float, float, float]
"""north, east [m], heading [rad], u, v through the water [m/s], r [rad/s], roll [rad], its rate [rad/s]."""

HELM_GAIN, HELM_DAMPING_S, HELM_LIMIT_RAD = 0.6, 4.0, 20.0 * pi / 180.0
STAMP = source_stamp(Path(__file__).parent)


class Drives(NamedTuple):
    """Rate limits and time constants of shafts [rev/s], azimuths [rad] and tunnel thruster [rpm]."""

    shaft_rate: float = 12.0 / 60.0
    shaft_lag_s: float = 1.2
    azimuth_rate: float = 12.0 * pi / 180.0
    azimuth_lag_s: float = 0.6
    tunnel_rate: float = 60.0
    tunnel_lag_s: float = 1.5


class Sea(NamedTuple):
    """The surroundings at one moment: uniform current, air [m/s, north and east], slow drift [N] and where to."""

    current_north: float
    current_east: float
    air_north: float
    air_east: float
    slow_n: float
    slow_to_rad: float


@njit(error_model="numpy")
def total_force(
    body: Body, o: Outside, sea: Sea, time_s: float, state: State, control: Control
) -> tuple[Three, float]:
    """All forces X, Y [N], N [N m] and the heeling moment [N m]."""
    north, east, psi, u, v, r, roll, roll_rate = state
    c, s = cos(psi), sin(psi)
    X_h, Y_h, N_h = hull_force(body.hull, u, v, r)
    X_t, Y_t, N_t = thruster_force(body, o, control, time_s, u, v, r)
    X_w, Y_w, N_w = wind_force(
        body,
        u + (sea.current_north - sea.air_north) * c + (sea.current_east - sea.air_east) * s,
        v + (sea.current_east - sea.air_east) * c - (sea.current_north - sea.air_north) * s,
    )
    X_d, Y_d, N_d = drift_force(body.drift[0], body.drift[1] - psi, body.length_m)
    X_s, Y_s, N_s = drift_force(sea.slow_n, sea.slow_to_rad - psi, body.length_m)
    X_o, Y_o, N_o = outside_force(o, north, east, psi)
    X_l, Y_l, N_l = dying_force(body, u, v, r)
    angle = 0.5 * (control[1] + control[3])
    X_e, Y_e, N_e = polynomial_error(body, u, v, r, angle) if body.error.any() else (0.0, 0.0, 0.0)
    X_r, Y_r, N_r = heel_force(body.heel, body.hull[0, 0] * u * abs(u), u, roll)
    X = X_h + X_t + X_w + X_d + X_s + X_o + X_e + X_r + X_l + body.steady[0] - tow(o, time_s)
    Y = Y_h + Y_t + Y_w + Y_d + Y_s + Y_o + Y_e + Y_r + Y_l + body.steady[1]
    N = N_h + N_t + N_w + N_d + N_s + N_o + N_e + N_r + N_l + body.steady[2]
    h = body.heel
    K = -h.hull_lever_m * (Y_h + body.mass_kg * u * r) - h.pod_lever_m * Y_t - h.wind_lever_m * Y_w
    return (X, Y, N), K - h.stiffness_nm * sin(roll) - h.damping_nms * roll_rate


@njit(error_model="numpy")
def slope(body: Body, o: Outside, sea: Sea, time_s: float, state: State, control: Control) -> State:
    """The time derivative of the state.

    Speeds are relative to the water at the ship's place. Where the current is not uniform that frame
    accelerates, and the ship's own mass feels it.
    """
    north, east, psi, u, v, r, _, roll_rate = state
    c, s = cos(psi), sin(psi)
    (shear, growth), tide = sheared(o, north, east), through(o, time_s)
    shear_c, shear_s = cos(o.shear_to_rad), sin(o.shear_to_rad)
    local = Sea(
        sea.current_north + shear * shear_c + tide * o.tide_north_mps,
        sea.current_east + shear * shear_s + tide * o.tide_east_mps,
        sea.air_north, sea.air_east, sea.slow_n, sea.slow_to_rad,
    )  # fmt: skip
    north_rate = u * c - v * s + local.current_north
    east_rate = u * s + v * c + local.current_east
    (X, Y, N), K = total_force(body, o, local, time_s, state, control)
    pull = body.mass_kg * growth * (east_rate * shear_c - north_rate * shear_s)
    X -= pull * (shear_c * c + shear_s * s)
    Y -= pull * (shear_s * c - shear_c * s)
    M = body.inverse_mass
    return (
        north_rate,
        east_rate,
        r,
        M[0, 0] * X,
        M[1, 1] * Y + M[1, 2] * N,
        M[2, 1] * Y + M[2, 2] * N,
        roll_rate,
        K / body.heel.inertia_kgm2,
    )


@njit(error_model="numpy")
def plus(state: State, rate: State, dt_s: float) -> State:
    """``state + dt rate``."""
    a, b, c, d, e, f, g, h = state
    A, B, C, D, E, F, G, H = rate
    return (
        a + dt_s * A, b + dt_s * B, c + dt_s * C, d + dt_s * D,
        e + dt_s * E, f + dt_s * F, g + dt_s * G, h + dt_s * H,
    )  # fmt: skip


@njit(error_model="numpy")
def limited(value: float, limit: float) -> float:
    """``value`` within ``limit`` either way."""
    return min(max(value, -limit), limit)


@njit(error_model="numpy")
def driven(d: Drives, now: Control, order: Control, dt_s: float) -> Control:
    """The drives a step later: towards the order with a lag, no faster than they can."""
    return (
        now[0] + dt_s * limited((order[0] - now[0]) / d.shaft_lag_s, d.shaft_rate),
        now[1] + dt_s * limited((order[1] - now[1]) / d.azimuth_lag_s, d.azimuth_rate),
        now[2] + dt_s * limited((order[2] - now[2]) / d.shaft_lag_s, d.shaft_rate),
        now[3] + dt_s * limited((order[3] - now[3]) / d.azimuth_lag_s, d.azimuth_rate),
        now[4] + dt_s * limited((order[4] - now[4]) / d.tunnel_lag_s, d.tunnel_rate),
    )


@njit(error_model="numpy")
def lagged(acting: Control, reported: Control, lag_s: float, dt_s: float) -> Control:
    """What acts after a step, a first-order lag behind what is reported over it."""
    k = 1.0 - exp(-dt_s / lag_s)
    a, b, c, d, e = acting
    A, B, C, D, E = reported
    return a + k * (A - a), b + k * (B - b), c + k * (C - c), d + k * (D - d), e + k * (E - e)


@njit(error_model="numpy")
def loose(now: float, by: float, slack: float) -> float:
    """Where in its slack a worn gear's end is once the motor has turned by so much: behind until it bears."""
    return limited(now - by, 0.5 * slack)


@njit(error_model="numpy")
def middle(now: Control, after: Control) -> Control:
    """The mean of two."""
    return (
        0.5 * (now[0] + after[0]), 0.5 * (now[1] + after[1]), 0.5 * (now[2] + after[2]),
        0.5 * (now[3] + after[3]), 0.5 * (now[4] + after[4]),
    )  # fmt: skip


@njit(error_model="numpy")
def nearest(angle_rad: float) -> float:
    """The same direction within half a turn of zero."""
    return float(angle_rad - 2.0 * pi * round(angle_rad / (2.0 * pi)))


@njit(error_model="numpy")
def told(order: Floats, base_rad: float, side: float, psi: float, r: float) -> Control:
    """What an order asks of the drives now; a positive azimuth turns the ship to port."""
    port, starboard = order[3], order[4]
    if order[0] == STEER:
        off = nearest(psi - base_rad - order[6])
        port = starboard = limited(HELM_GAIN * off + HELM_DAMPING_S * r, HELM_LIMIT_RAD)
    elif order[0] == ZIGZAG:
        port = starboard = -side * order[3]
    return order[1], port, order[2], starboard, order[5]


def _make_sail(stamp: int) -> Callable[..., int]:
    @njit(cache=True, error_model="numpy")
    def sail(
        body: Body,
        o: Outside,
        orders: Floats,
        drives: Drives,
        first_s: float,
        base_rad: float,
        start: Floats,
        current: Floats,
        air: Floats,
        slow: Floats,
        slow_to_rad: float,
        lag_s: float,
        play: Floats,
        limits: Floats,
        dt_s: float,
        states: Floats,
        controls: Floats,
        acting: Floats,
        ordered: Floats,
    ) -> int:
        """Fill ``states`` [K+1, 8]; feedback, what acts and what is ordered [K+1, 5]; the first bad step or -1.

        Until ``first_s`` the ship keeps the base course with the first order's shafts.
        """
        if stamp == 0:
            return -1
        state = (start[0], start[1], start[2], start[3], start[4], start[5], start[6], start[7])
        number, since_s, begun, side, switches = 0, 0.0, start[2], 1.0, 0.0
        drive = (orders[0, 1], 0.0, orders[0, 2], 0.0, 0.0)
        act = turned = drive
        slack = (0.0, 0.0)
        for k in range(air.shape[0]):
            for i in range(8):
                states[k, i] = state[i]
            for i in range(5):
                controls[k, i], acting[k, i] = drive[i], act[i]
            if abs(state[4]) > limits[2] or abs(state[5]) > limits[3]:
                return k
            if not limits[0] <= state[3] <= limits[1]:
                return k
            if k == air.shape[0] - 1:
                ordered[k] = ordered[k - 1]
                break
            psi, r = state[2], state[5]
            if k * dt_s < first_s:
                order = np.zeros(orders.shape[1])
                order[1], order[2] = orders[0, 1], orders[0, 2]
            else:
                order = orders[number]
                if order[0] == ZIGZAG and side * nearest(psi - base_rad - order[6]) >= order[7]:
                    side, switches = -side, switches + 1.0
                over = since_s >= order[9]
                over |= order[0] == TURN and abs(psi - begun) >= order[7]
                over |= order[0] == ZIGZAG and switches >= order[8]
                if over:
                    number = (number + 1) % orders.shape[0]
                    order, since_s, begun, side, switches = orders[number], 0.0, psi, 1.0, 0.0
                since_s += dt_s
            asked = told(order, base_rad, side, psi, r)
            for i in range(5):
                ordered[k, i] = asked[i]
            next_drive = driven(drives, drive, asked, dt_s)
            n_p, a_p, n_s, a_s, n_t = next_drive
            slack = loose(slack[0], a_p - drive[1], play[0]), loose(slack[1], a_s - drive[3], play[1])
            next_turned = (n_p, a_p + slack[0], n_s, a_s + slack[1], n_t)
            next_act = next_turned
            if lag_s > 0.0:
                next_act = lagged(act, middle(turned, next_turned), lag_s, dt_s)
            here = Sea(current[0], current[1], air[k, 0], air[k, 1], slow[k], slow_to_rad)
            there = Sea(current[0], current[1], air[k + 1, 0], air[k + 1, 1], slow[k + 1], slow_to_rad)
            first = slope(body, o, here, k * dt_s, state, act)
            second = slope(body, o, there, (k + 1) * dt_s, plus(state, first, dt_s), next_act)
            state = plus(plus(state, first, 0.5 * dt_s), second, 0.5 * dt_s)
            drive, turned, act = next_drive, next_turned, next_act
        return -1

    return sail  # type: ignore[no-any-return]


def _make_forces(stamp: int) -> Callable[..., None]:
    @njit(cache=True, error_model="numpy")
    def forces_along(body: Body, o: Outside, dt_s: float, states: Floats, acting: Floats, out: Any) -> None:
        """Fill ``out`` [rows, 6]: forces without air and slow drift, and the thrusters' share, along a run."""
        if stamp == 0:
            return
        still = Sea(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for k in range(states.shape[0]):
            x, c = states[k], acting[k]
            state = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7])
            control = (c[0], c[1], c[2], c[3], c[4])
            out[k, :3] = total_force(body, o, still, k * dt_s, state, control)[0]
            out[k, 3:] = thruster_force(body, o, control, k * dt_s, x[3], x[4], x[5])

    return forces_along  # type: ignore[no-any-return]


sail = _make_sail(STAMP)
forces_along = _make_forces(STAMP)
