"""The model run along what was measured before the start, and on from there: compiled.

Second by second the model predicts where the ship is and how fast; the measurement update then corrects position,
speed and the bias force, the force per mass that the model lacks in surge, sway and yaw, with the gains of
:mod:`.kalman_filter`. At second 0 the model goes on from there by itself, that force decaying slowly. Nothing that
was measured after second 0 is used.
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
from hybrid.vessel.actuators import CONTROLS_OF, IS_ANGLE
from hybrid.vessel.actuators.kind import CONTROL, KIND
from hybrid.vessel.dynamics import (
    Control,
    InverseMass,
    Scratch,
    State,
    advance,
    inverse_mass,
    lag_over,
    scratch_for,
)
from hybrid.vessel.plant import PHYSICS_STAMP, ForceFunction

LEAP_M, LEAP_RAD, LEAP_MPS, LEAP_RADPS = 8.0, 0.5, 1.5, 0.15
TURN_RADPS, TURNS = 0.02, 4
"""The gains are there for four yaw rates that far apart, the first of them none."""
STEP_LENGTHS, MOST_STEPS = 1.0 / 3.0, 8
"""How far she may sail in one step of the integration, in her lengths: a craft of 2 m at 2 m/s needs 3 steps a
second; for ships and models at usual speeds one is as good as four, to 0.1 % of the errors."""
WIND_DIRECTION, WIND_SPEED, FIRST_CONTROL = 6, 7, 8
"""Where they stand in a row of channels, after the state."""
Force = Floats
"""In surge, sway and yaw [3]."""
Swing = Floats
"""Displacement in waves ahead, aside [m] and in heading [rad], and its rate [2, 3]."""


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
    p.constant_X_n = own[0] + (p.mass_kg - p.Xud) * bias[0]
    p.constant_Y_n = own[1] + (p.mass_kg - p.Yvd) * bias[1] - p.Yrd * bias[2]
    p.constant_N_nm = own[2] - p.Yrd * bias[1] + (p.yaw_inertia_kgm2 - p.Nrd) * bias[2]


@compiled
def weighed(gain: Floats, position: float, speed: float) -> float:
    """What an innovation of position and one of speed correct one quantity by, with its gain [2]."""
    return float(gain[0] * position + gain[1] * speed)


@compiled
def measurement_update(
    state: State, bias: Force, swing: Swing, measured: Floats, gain: Floats
) -> tuple[bool, State]:
    """Whether the measurement can be the ship's, and the state after it; bias force and swing are corrected.

    ``gain`` [3 axes, 5, 2] as of :func:`~hybrid.prediction.kalman_filter.kalman_gains`.
    """
    north, east, psi, u, v, r = state
    cosine, sine = cos(psi), sin(psi)
    off_north, off_east = measured[0] - north, measured[1] - east
    position = (
        off_north * cosine + off_east * sine - swing[0, 0],
        off_east * cosine - off_north * sine - swing[0, 1],
        measured[2] - psi - swing[0, 2],
    )
    speed = (measured[3] - u - swing[1, 0], measured[4] - v - swing[1, 1], measured[5] - r - swing[1, 2])
    possible = (
        hypot(position[0], position[1]) < LEAP_M
        and abs(position[2]) < LEAP_RAD
        and hypot(speed[0], speed[1]) < LEAP_MPS
        and abs(speed[2]) < LEAP_RADPS
    )
    for axis in range(3):
        bias[axis] += weighed(gain[axis, 2], position[axis], speed[axis])
        swing[0, axis] += weighed(gain[axis, 3], position[axis], speed[axis])
        swing[1, axis] += weighed(gain[axis, 4], position[axis], speed[axis])
    x, y = weighed(gain[0, 0], position[0], speed[0]), weighed(gain[1, 0], position[1], speed[1])
    return possible, (
        north + x * cosine - y * sine,
        east + x * sine + y * cosine,
        psi + weighed(gain[2, 0], position[2], speed[2]),
        u + weighed(gain[0, 1], position[0], speed[0]),
        v + weighed(gain[1, 1], position[1], speed[1]),
        r + weighed(gain[2, 1], position[2], speed[2]),
    )


@compiled
def pass_second(bias: Force, kept: Floats, swing: Swing, step: Floats) -> None:
    """Bias force and swing in waves a second later: the one decays, the other goes on."""
    for axis in range(3):
        bias[axis] *= kept[axis]
        displaced, rate = swing[0, axis], swing[1, axis]
        swing[0, axis] = step[0, 0] * displaced + step[0, 1] * rate
        swing[1, axis] = step[1, 0] * displaced + step[1, 1] * rate


@compiled
def pass_model(
    p: Record,
    mass: InverseMass,
    order: Control,
    acting: Control,
    scratch: Scratch,
    air: tuple[float, float],
    state: State,
    extra: ForceFunction | None,
    parameters: Floats,
) -> State:
    """The model's state a second later, in steps in which she sails :data:`STEP_LENGTHS` of her length at most."""
    lengths = hypot(state[3], state[4]) / p.length_overall_m
    steps = 1 + int(lengths / STEP_LENGTHS) if lengths < MOST_STEPS * STEP_LENGTHS else MOST_STEPS
    lag = lag_over(p, 1.0 / steps)
    later: State = advance(p, mass, lag, order, acting, scratch, air, 0.0, 1.0, steps, state, extra, parameters)
    return later


@compiled
def store(state: State, swing: Swing, states: Floats, waves: Floats) -> None:
    """Write a state [6], and the swing as north, east and heading [3]."""
    cosine, sine = cos(state[2]), sin(state[2])
    for j in range(6):
        states[j] = state[j]
    waves[0] = swing[0, 0] * cosine - swing[0, 1] * sine
    waves[1] = swing[0, 0] * sine + swing[0, 1] * cosine
    waves[2] = swing[0, 2]


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
            mass = inverse_mass(p)
            own = np.array([p.constant_X_n, p.constant_Y_n, p.constant_N_nm])
            bias, swing = np.zeros(3), np.zeros((2, 3))
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
                state = pass_model(p, mass, order, acting, scratch, air, state, extra, parameters[0])
                pass_second(bias, kept, swing, wave)
                turn = min(int(abs(now[5]) / TURN_RADPS + 0.5), TURNS - 1)
                gain = gains[turn, min(since, gains.shape[1] - 1)]
                possible, state = measurement_update(state, bias, swing, now, gain)
                since += 1
                if not possible:
                    state = (now[0], now[1], now[2], now[3], now[4], now[5])
                    bias[:] = 0.0
                    swing[:] = 0.0
                    since = 0
                second -= 1
            store(state, swing, states[i, 0], waves[i, 0])
            for k in range(control.shape[1]):
                add_bias_force(p, own, bias)
                air = (wind[i, k, 0], wind[i, k, 1])
                state = pass_model(p, mass, control[i, k], acting, scratch, air, state, extra, parameters[0])
                pass_second(bias, kept, swing, wave)
                store(state, swing, states[i, k + 1], waves[i, k + 1])

    return observe_and_predict  # type: ignore[no-any-return]


observe_and_predict = _make_observer(PHYSICS_STAMP)
