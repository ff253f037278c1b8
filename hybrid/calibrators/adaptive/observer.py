"""The model run along what was measured before the start, and on from there: compiled.

Second by second the model predicts where the ship is and how fast; the measurement update then corrects position,
speed and the bias force, the force per mass that the model lacks in surge, sway and yaw (gains.py). At second 0 the
model goes on from there by itself, that force decaying slowly. Nothing that was measured after second 0 is used.
Where a measurement is too far off to be the ship's motion, as at a splice, the observer begins anew.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, pi, sin

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.compiling import FAST, Record, compiled
from hybrid.vessel.actuators import CONTROL, CONTROLS_OF, IS_ANGLE, KIND
from hybrid.vessel.dynamics import Control, State, advance, inverse_mass, lag_over, scratch_for
from hybrid.vessel.plant import PHYSICS_STAMP, ForceFunction

LEAP_M, LEAP_RAD, LEAP_MPS, LEAP_RADPS = 8.0, 0.5, 1.5, 0.15
TURN_RADPS, TURNS = 0.02, 4
"""The gains are there for four yaw rates that far apart, the first of them none."""
WIND_DIRECTION, WIND_SPEED, FIRST_CONTROL = 6, 7, 8
"""Where they stand in a row of channels, after the state."""
Force = tuple[float, float, float]
Swing = tuple[float, float, float, float, float, float]
"""Displacement in waves ahead, aside [m] and in heading [rad], and their rates."""


@compiled
def fill_mean_control(p: Record, result: Control, before: Control, after: Control) -> None:
    """Fill ``result``: the mean of two controls; angles the shorter way round."""
    for i in range(len(p.actuators)):
        kind, first = int(p.actuators[i, KIND]), int(p.actuators[i, CONTROL])
        for column in range(first, first + CONTROLS_OF[kind]):
            if IS_ANGLE[kind, column - first]:
                back = before[column] - after[column]
                back -= 2.0 * pi * round(back / (2.0 * pi))
                result[column] = after[column] + 0.5 * back
            else:
                result[column] = 0.5 * (before[column] + after[column])


@compiled
def add_bias_force(p: Record, own: Force, bias: Force) -> None:
    """Give the plant its own constant force and, per mass and with the added mass, the bias force."""
    surge, sway, yaw = bias
    p.constant_X_n = own[0] + (p.mass_kg - p.Xud) * surge
    p.constant_Y_n = own[1] + (p.mass_kg - p.Yvd) * sway - p.Yrd * yaw
    p.constant_N_nm = own[2] - p.Yrd * sway + (p.yaw_inertia_kgm2 - p.Nrd) * yaw


@compiled
def measurement_update(
    state: State, bias: Force, swing: Swing, measured: Floats, gain: Floats
) -> tuple[bool, State, Force, Swing]:
    """Whether the measurement can be the ship's; and state, bias force and swing in waves after it."""
    north, east, psi, u, v, r = state
    surge, sway, yaw = bias
    cosine, sine = cos(psi), sin(psi)
    off_north, off_east = measured[0] - north, measured[1] - east
    ahead = off_north * cosine + off_east * sine - swing[0]
    aside = off_east * cosine - off_north * sine - swing[1]
    turned = measured[2] - psi - swing[2]
    du, dv, dr = measured[3] - u - swing[3], measured[4] - v - swing[4], measured[5] - r - swing[5]
    possible = (
        hypot(ahead, aside) < LEAP_M
        and abs(turned) < LEAP_RAD
        and hypot(du, dv) < LEAP_MPS
        and abs(dr) < LEAP_RADPS
    )
    x = gain[0, 0, 0] * ahead + gain[0, 0, 1] * du
    y = gain[1, 0, 0] * aside + gain[1, 0, 1] * dv
    return (
        possible,
        (
            north + x * cosine - y * sine,
            east + x * sine + y * cosine,
            psi + gain[2, 0, 0] * turned + gain[2, 0, 1] * dr,
            u + gain[0, 1, 0] * ahead + gain[0, 1, 1] * du,
            v + gain[1, 1, 0] * aside + gain[1, 1, 1] * dv,
            r + gain[2, 1, 0] * turned + gain[2, 1, 1] * dr,
        ),
        (
            surge + gain[0, 2, 0] * ahead + gain[0, 2, 1] * du,
            sway + gain[1, 2, 0] * aside + gain[1, 2, 1] * dv,
            yaw + gain[2, 2, 0] * turned + gain[2, 2, 1] * dr,
        ),
        (
            swing[0] + gain[0, 3, 0] * ahead + gain[0, 3, 1] * du,
            swing[1] + gain[1, 3, 0] * aside + gain[1, 3, 1] * dv,
            swing[2] + gain[2, 3, 0] * turned + gain[2, 3, 1] * dr,
            swing[3] + gain[0, 4, 0] * ahead + gain[0, 4, 1] * du,
            swing[4] + gain[1, 4, 0] * aside + gain[1, 4, 1] * dv,
            swing[5] + gain[2, 4, 0] * turned + gain[2, 4, 1] * dr,
        ),
    )


@compiled
def advance_swing(swing: Swing, step: Floats) -> Swing:
    """The swing in waves a second later."""
    return (
        step[0, 0] * swing[0] + step[0, 1] * swing[3],
        step[0, 0] * swing[1] + step[0, 1] * swing[4],
        step[0, 0] * swing[2] + step[0, 1] * swing[5],
        step[1, 0] * swing[0] + step[1, 1] * swing[3],
        step[1, 0] * swing[1] + step[1, 1] * swing[4],
        step[1, 0] * swing[2] + step[1, 1] * swing[5],
    )


@compiled
def store(state: State, swing: Swing, states: Floats, waves: Floats) -> None:
    """Write a state [6], and the swing as north, east and heading [3]."""
    cosine, sine = cos(state[2]), sin(state[2])
    for j in range(6):
        states[j] = state[j]
    waves[0] = swing[0] * cosine - swing[1] * sine
    waves[1] = swing[0] * sine + swing[1] * cosine
    waves[2] = swing[2]


@compiled
def decay(bias: Force, kept: Floats) -> Force:
    """The bias force a second later."""
    return bias[0] * kept[0], bias[1] * kept[1], bias[2] * kept[2]


def _make_observer(stamp: int) -> Callable[..., None]:
    @njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
    def observe_and_predict(
        plants: NDArray[np.void],
        past: Floats,
        known_s: NDArray[np.int64],
        gains: Floats,
        kept: Floats,
        wave: Floats,
        control: Floats,
        wind: Floats,
        extra: ForceFunction | None,
        parameters: Floats,
        states: Floats,
        waves: Floats,
    ) -> None:
        """Fill ``states`` [N, H+1, 6], and ``waves`` [N, H+1, 3] beside them.

        From ``past`` [N, P+1, channels], newest first, of which ``known_s`` [N] seconds are whole; ``control``
        [N, H, controls]
        and ``wind`` [N, H, 2] act from second 0. ``plants`` [N] are changed.
        """
        for i in prange(states.shape[0]):
            p = plants[i]
            mass, lag = inverse_mass(p), lag_over(p, 1.0)
            own = (p.constant_X_n, p.constant_Y_n, p.constant_N_nm)
            bias = (0.0, 0.0, 0.0)
            swing = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            second, since = known_s[i], 0
            row = past[i, second]
            state = (row[0], row[1], row[2], row[3], row[4], row[5])
            acting = row[FIRST_CONTROL:].copy()
            order, scratch = acting.copy(), scratch_for(p, acting)
            while second > 0 and stamp != 0:
                now = past[i, second - 1]
                fill_mean_control(p, order, past[i, second, FIRST_CONTROL:], now[FIRST_CONTROL:])
                add_bias_force(p, own, bias)
                air = (now[WIND_DIRECTION], now[WIND_SPEED])
                state = advance(p, mass, lag, order, acting, scratch, air, 0.0, 1.0, 1, state, extra, parameters[0])
                bias = decay(bias, kept)
                swing = advance_swing(swing, wave)
                turn = min(int(abs(now[5]) / TURN_RADPS + 0.5), TURNS - 1)
                gain = gains[turn, min(since, gains.shape[1] - 1)]
                possible, state, bias, swing = measurement_update(state, bias, swing, now, gain)
                since += 1
                if not possible:
                    state = (now[0], now[1], now[2], now[3], now[4], now[5])
                    bias = (0.0, 0.0, 0.0)
                    swing = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                    since = 0
                second -= 1
            store(state, swing, states[i, 0], waves[i, 0])
            for k in range(control.shape[1]):
                add_bias_force(p, own, bias)
                air = (wind[i, k, 0], wind[i, k, 1])
                state = advance(
                    p, mass, lag, control[i, k], acting, scratch, air, 0.0, 1.0, 1, state, extra, parameters[0]
                )
                bias = decay(bias, kept)
                swing = advance_swing(swing, wave)
                store(state, swing, states[i, k + 1], waves[i, k + 1])

    return observe_and_predict  # type: ignore[no-any-return]


observe_and_predict = _make_observer(PHYSICS_STAMP)
