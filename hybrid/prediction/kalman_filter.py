"""A ship model as a Kalman filter: its gains, its observations, and its causal start states.

A prediction starts from what was known at that instant, without later data: the reference model runs over the half
minute before, corrected every second by the measurements, with a bias force for what it lacks and an oscillator
for the wave motion. From second 0 the model runs freely; the bias force, per mass in surge, sway and yaw, decays
slowly. Where a measurement is too far off to be the ship's motion, as at a splice, the filter is reinitialised.
Mean errors [m] of predictions over 15 s (reference, constant velocity) from such starts, compared with starts from
lines fitted to the last 10 s and from two-sided smoothing:

=========================  ===========  ===========  ===========
trial                      filter       lines        both sides
=========================  ===========  ===========  ===========
R/V Gunnerus 2019          0.49, 0.55   0.47, 0.58   0.46, 0.56
Esso Osaka, 13 trials      0.07, 0.13   0.08, 0.14   0.07, 0.14
simulated zigzag, calm     0.15, 1.82   0.48, 2.20   0.16, 1.71
the same in moderate seas  0.93, 2.07   1.19, 2.67   0.73, 1.45
=========================  ===========  ===========  ===========
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import cos, hypot, pi, sin, sqrt

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats, Ints, to_earth
from seatrial.analysis.compiling import FAST, Record, compiled, copy_row, threads_for
from seatrial.analysis.estimation import kalman_kernel, process_models
from seatrial.analysis.series import USUAL_LENGTH_M
from seatrial.hybrid.prediction import window_sets
from seatrial.hybrid.vessel import black_box, dynamics, sensors, step_lengths
from seatrial.hybrid.vessel.actuators import CONTROL, CONTROLS_OF, IS_ANGLE, KIND
from seatrial.hybrid.vessel.plant import PHYSICS_STAMP, ForceFunction, Plant, pack

LEAP_M, LEAP_RAD, LEAP_MPS, LEAP_RADPS = 8.0, 0.5, 1.5, 0.15
TURN_RADPS, TURNS = 0.02, 4
"""Gains are computed for four yaw rates this far apart, the first zero. Unlike the implausible yaw rate
``LEAP_RADPS``, which holds for a ship of the usual length, they do not grow with the pace of a shorter one
(:func:`pace_of_length`): on the runs of a 2 m craft that made starts worse."""
WIND_DIRECTION, WIND_SPEED, FIRST_CONTROL = 6, 7, 8
"""Their columns in a row of channels, after the state."""
OBSERVED_S = 30
"""The seconds before the start over which the filter runs [s]."""
AXES = ("surge", "sway", "yaw")
NOISE_LEVELS = tuple(f"{what}_{axis}" for axis in AXES for what in ("speed_walk", "force_walk", "position_noise"))
FORCE_DECAY = tuple(f"force_decay_{axis}" for axis in AXES)
JITTER, JITTER_S = "stamp_jitter", 0.1
"""Timing jitter of headings [s]: noise that grows with the yaw rate."""
WAVES = ("wave_period", *(f"wave_walk_{axis}" for axis in AXES))
FILTER_NUMBERS = (JITTER, *NOISE_LEVELS, *FORCE_DECAY, *WAVES)
"""The parameters of the gains, as deviations from the usual in units of their prior standard deviation."""
NEUTRAL = (0.0,) * len(FILTER_NUMBERS)
"""The filter before anything is learned."""
WAVE_DAMPING = 0.1
_DIFFUSE = 10.0
_WALKS = np.array([[-1.0, -2.5, 0.0], [-1.0, -2.5, 0.0], [-1.0, -2.5, 1.5]])  # powers of ten
_USUAL_POWER = 1.5
_FORCE_DECAY_S = 120.0
_WAVE_S, _USUAL_PERIOD, _SHORTEST_WAVE_S = 6.0, 0.3, 3.0  # a shorter wave has too few measurements a period
_WAVE_WALK = -1.0  # a power of ten
_RATE_NOISE_RADPS = 1e-3  # of a usual gyro, the unit of the yaw noise levels

Force = Floats
"""In surge, sway and yaw [3]."""
Gains = tuple[Floats, Floats, Floats]
"""Of a filter, as :func:`filter_gains` returns them."""
Swing = Floats
"""Wave displacement in surge, sway [m] and heading [rad], and its rate [2, 3]."""


@compiled
def pace_of_length(length_m: float) -> float:
    """How many times faster a short ship moves than one of :data:`.USUAL_LENGTH_M`, by Froude's law; 1 if longer.

    At equal Froude numbers time goes with the root of the length: yaw rates with its inverse, yaw accelerations
    with that squared, and surge and sway accelerations not at all.
    """
    return max(1.0, sqrt(USUAL_LENGTH_M / length_m))


@compiled
def fill_mean_control(
    p: Record, result: dynamics.Control, before: dynamics.Control, after: dynamics.Control
) -> None:
    """Fill ``result`` with the mean of two controls, angles the shorter way round."""
    for i in range(int(p.actuator_count)):
        kind, first = int(p.actuators[i, KIND]), int(p.actuators[i, CONTROL])
        for column in range(first, first + CONTROLS_OF[kind]):
            if IS_ANGLE[kind, column - first]:
                difference = before[column] - after[column]
                difference -= 2.0 * pi * round(difference / (2.0 * pi))
                result[column] = after[column] + 0.5 * difference
            else:
                result[column] = 0.5 * (before[column] + after[column])


@compiled
def add_bias_force(p: Record, plant_force: Force, bias: Force) -> None:
    """Set the plant's constant force to its own plus the bias force, per mass including added mass."""
    p.constant_X_n = plant_force[0] + (p.mass_kg - p.Xud) * bias[0]
    p.constant_Y_n = plant_force[1] + (p.mass_kg - p.Yvd) * bias[1] - p.Yrd * bias[2]
    p.constant_N_nm = plant_force[2] - p.Yrd * bias[1] + (p.yaw_inertia_kgm2 - p.Nrd) * bias[2]


@compiled
def innovation_correction(gain: Floats, position: float, speed: float) -> float:
    """The correction of one quantity from the innovations of position and speed, with its gain [2]."""
    return float(gain[0] * position + gain[1] * speed)


@compiled
def correct_by_measurement(
    state: dynamics.State, bias: Force, swing: Swing, measured: Floats, gain: Floats, pace: float
) -> tuple[bool, dynamics.State]:
    """Whether the measurement is one that the filter may follow, and the corrected state.

    Bias force and wave motion are corrected in place. After a leap the filter has lost the ship: it starts
    anew from the measurement, and what is corrected here is dropped.

    ``gain`` [3 axes, 5, 2] comes from :func:`~seatrial.hybrid.prediction.kalman_filter.kalman_gains`.
    """
    north, east, psi, u, v, r = state
    cosine, sine = cos(psi), sin(psi)
    north_error, east_error = measured[0] - north, measured[1] - east
    position = (
        north_error * cosine + east_error * sine - swing[0, 0],
        east_error * cosine - north_error * sine - swing[0, 1],
        measured[2] - psi - swing[0, 2],
    )
    speed = (measured[3] - u - swing[1, 0], measured[4] - v - swing[1, 1], measured[5] - r - swing[1, 2])
    possible = (
        hypot(position[0], position[1]) < LEAP_M
        and abs(position[2]) < LEAP_RAD
        and hypot(speed[0], speed[1]) < LEAP_MPS
        and abs(speed[2]) < LEAP_RADPS * pace
    )
    for axis in range(3):
        bias[axis] += innovation_correction(gain[axis, 2], position[axis], speed[axis])
        swing[0, axis] += innovation_correction(gain[axis, 3], position[axis], speed[axis])
        swing[1, axis] += innovation_correction(gain[axis, 4], position[axis], speed[axis])
    x, y = (
        innovation_correction(gain[0, 0], position[0], speed[0]),
        innovation_correction(gain[1, 0], position[1], speed[1]),
    )
    return possible, (
        north + x * cosine - y * sine,
        east + x * sine + y * cosine,
        psi + innovation_correction(gain[2, 0], position[2], speed[2]),
        u + innovation_correction(gain[0, 1], position[0], speed[0]),
        v + innovation_correction(gain[1, 1], position[1], speed[1]),
        r + innovation_correction(gain[2, 1], position[2], speed[2]),
    )


@compiled
def advance_disturbances(bias: Force, retained: Floats, swing: Swing, step: Floats) -> None:
    """Advance bias force and wave motion by a second: the former decays, the latter oscillates."""
    for axis in range(3):
        bias[axis] *= retained[axis]
        displaced, rate = swing[0, axis], swing[1, axis]
        swing[0, axis] = step[0, 0] * displaced + step[0, 1] * rate
        swing[1, axis] = step[1, 0] * displaced + step[1, 1] * rate


_steps_per_second = compiled(step_lengths.steps_per_second)


@compiled
def advance_model(
    p: Record, mass: dynamics.InverseMass, order: dynamics.Control, acting: dynamics.Control,
    scratch: dynamics.Scratch, air: tuple[float, float], state: dynamics.State, extra: ForceFunction | None,
    parameters: Floats,
) -> dynamics.State:  # fmt: skip
    """The model's state a second later, in :func:`.steps_per_second`."""
    steps = _steps_per_second(state[3], state[4], p.length_overall_m)
    lag = dynamics.lag_shares_over_step(p, 1.0 / steps)
    later: dynamics.State = dynamics.advance(
        p, mass, lag, order, acting, scratch, air, 0.0, 1.0, steps, state, extra, parameters
    )
    return later


@compiled
def store_state(state: dynamics.State, swing: Swing, states: Floats, waves: Floats) -> None:
    """Store a state [6], and the wave motion as north, east and heading [3]."""
    cosine, sine = cos(state[2]), sin(state[2])
    for j in range(6):
        states[j] = state[j]
    waves[0] = swing[0, 0] * cosine - swing[0, 1] * sine
    waves[1] = swing[0, 0] * sine + swing[0, 1] * cosine
    waves[2] = swing[0, 2]


def _make_observer(stamp: int) -> Callable[..., None]:
    @njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
    def observe_and_predict(
        plants: NDArray[np.void], past: Floats, complete_s: NDArray[np.int64], gains: Floats, decay: Floats,
        wave: Floats, control: Floats, wind: Floats, extra: ForceFunction | None, parameters: Floats,
        states: Floats, waves: Floats,
    ) -> None:  # fmt: skip
        """Fill ``states`` [M N, H+1, 6] and the wave motion ``waves`` [M N, H+1, 3] of M models.

        From ``past`` [N, P+1, channels], newest first, of which ``complete_s`` [N] seconds have no gap;
        ``control`` [N, H, controls] and ``wind`` [N, H, 2] act from second 0. ``gains``, ``decay`` and ``wave``
        have a first dimension of M. ``plants`` [M N] are changed.
        """
        for run in prange(states.shape[0]):
            model, i = run // past.shape[0], run % past.shape[0]
            p = plants[run]
            mass, pace = dynamics.inverse_mass(p), pace_of_length(p.length_overall_m)
            plant_force = np.array([p.constant_X_n, p.constant_Y_n, p.constant_N_nm])
            bias, swing = np.zeros(3), np.zeros((2, 3))
            seconds_before, updates = complete_s[i] if stamp != 0 else 0, 0
            row = past[i, seconds_before]
            state = (row[0], row[1], row[2], row[3], row[4], row[5])
            acting = row[FIRST_CONTROL:].copy()
            order, scratch = acting.copy(), dynamics.scratch_for(p, acting)
            for k in range(-seconds_before, control.shape[1]):  # in one loop, so that the model is compiled once
                measured = past[i, max(-k - 1, 0)]
                if k < 0:
                    fill_mean_control(p, order, past[i, -k, FIRST_CONTROL:], measured[FIRST_CONTROL:])
                    air = (measured[WIND_DIRECTION], measured[WIND_SPEED])
                else:
                    store_state(state, swing, states[run, k], waves[run, k])
                    copy_row(order, control[i, k])
                    air = (wind[i, k, 0], wind[i, k, 1])
                add_bias_force(p, plant_force, bias)
                state = advance_model(p, mass, order, acting, scratch, air, state, extra, parameters[0])
                advance_disturbances(bias, decay[model], swing, wave[model])
                if k >= 0:
                    continue
                turn = min(int(abs(measured[5]) / TURN_RADPS + 0.5), TURNS - 1)
                gain = gains[model, turn, min(updates, gains.shape[2] - 1)]
                possible, state = correct_by_measurement(state, bias, swing, measured, gain, pace)
                updates += 1
                if not possible:
                    state = (measured[0], measured[1], measured[2], measured[3], measured[4], measured[5])
                    bias[:] = 0.0
                    swing[:] = 0.0
                    updates = 0
            store_state(state, swing, states[run, control.shape[1]], waves[run, control.shape[1]])

    return observe_and_predict  # type: ignore[no-any-return]


observe_and_predict = _make_observer(PHYSICS_STAMP)


def wave_transition(wave_radps: float) -> Floats:
    """The transition of wave displacement and its rate over a second [2, 2]: a lightly damped oscillator."""
    return np.array(process_models.oscillator(1.0, wave_radps, WAVE_DAMPING)).reshape(2, 2)


@lru_cache(maxsize=256)  # most optimiser steps change none of an axis' numbers
def kalman_gains(
    speed_walk: float,
    force_walk: float,
    position_noise: float,
    kept_force: float,
    steps: int,
    wave_walk: float = 0.0,
    wave_radps: float = 1.0,
) -> Floats:
    """The gains [steps, 5, 2] of position, speed, force, wave displacement and its rate, for the innovations of
    position and speed, step by step.

    One axis, in steps of a second: position integrates speed, speed integrates a force (per mass) that follows
    a random walk; the measurements contain wave motion as well. All variances are in units of that of the
    measured speed, [m/s]^2 (or [rad/s]^2): ``speed_walk``, ``force_walk`` and ``wave_walk`` are the process
    noises of speed, force and wave rate over a second, ``position_noise`` that of the measured position;
    ``kept_force`` is the share of the force left after a second. Kalman, A new approach to linear filtering
    (1960); Fossen, Handbook of marine craft hydrodynamics and motion control (2011), section 11.3, for the
    waves.
    """
    F, Q, P = np.zeros((3, 5, kalman_kernel.WIDTH))
    F[:3, :3] = [[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept_force]]
    F[3:, 3:5] = wave_transition(wave_radps)
    H = np.array([[1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0]])
    swing = wave_walk / (4.0 * WAVE_DAMPING * wave_radps)
    diagonal = np.arange(5)
    Q[diagonal, diagonal] = [0.0, speed_walk, force_walk, 0.0, wave_walk]
    P[diagonal, diagonal] = [position_noise, 1.0, _DIFFUSE * force_walk, swing / wave_radps**2, swing]
    return np.asarray(kalman_kernel.gain_sequence(F, Q, H, np.array([position_noise, 1.0]), P, steps))


@lru_cache(maxsize=64)
def filter_gains(length_m: float, jitter: float, *numbers: float) -> Gains:
    """The gains [turns, steps, 3 axes, 5, 2] for a ship of a length overall, the share of the bias force left after
    a second [3], and the transition of wave motion [2, 2].

    ``jitter`` and ``numbers`` are those of :data:`FILTER_NUMBERS`; cached, since most optimiser steps do not
    change them. What a model lacks in a second is an acceleration, whose size goes with the pace of the ship
    (:func:`pace_of_length`), while the noise of the sensors does not: yaw rate and moment wander by more in a short
    ship, by the squares of pace^2, and of that over the root of its time, pace^2.5. Waves in yaw, which are of one
    steepness, by pace^3.
    """
    pace = pace_of_length(length_m)
    powers, decay_deviations, (period, *walks) = np.split(
        np.array(numbers), [len(NOISE_LEVELS), len(NOISE_LEVELS) + len(FORCE_DECAY)]
    )
    growth = np.array([[1.0, pace, 1.0], [1.0, pace, 1.0], [pace**4, pace**5, 1.0]])
    levels = growth * 10.0 ** np.clip(_WALKS + _USUAL_POWER * powers.reshape(3, 3), -6.0, 4.0)
    wave_walks = 10.0 ** np.clip(_WAVE_WALK + _USUAL_POWER * np.array(walks), -6.0, 4.0)
    wave_walks[2] *= pace**3
    period_s = max(_WAVE_S / pace, _SHORTEST_WAVE_S) * np.exp(np.clip(_USUAL_PERIOD * period, -0.9, 0.9))
    retained_force = process_models.decay(1.0, _FORCE_DECAY_S / pace * np.exp(decay_deviations))
    jitter_variance = (
        JITTER_S * np.exp(np.clip(jitter, -4.0, 4.0)) * TURN_RADPS * np.arange(TURNS) / _RATE_NOISE_RADPS
    ) ** 2
    wave_radps = float(2.0 * np.pi / period_s)
    noises = levels[:, 2:] + np.array([[0.0], [0.0], [1.0]]) * jitter_variance
    gains = [
        [kalman_gains(speed, force, noise, retained, OBSERVED_S, wave, wave_radps) for noise in axis_noises]
        for (speed, force, _), axis_noises, retained, wave in zip(
            levels, noises, retained_force, wave_walks, strict=True
        )
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(gains), 0, 2)), retained_force, wave_transition(wave_radps)


@dataclass(frozen=True, slots=True)
class Observations:
    """The observations of N windows.

    ``past`` [N, P+1, channels] in the order of
    :class:`~seatrial.hybrid.prediction.window_sets.PredictionWindows`, newest first, without gaps for
    ``complete_s`` [N] seconds; ``control`` [N, H, controls] and ``wind`` [N, H, 2] act from second 0.
    """

    past: Floats
    complete_s: NDArray[np.int64]
    control: Floats
    wind: Floats

    def __len__(self) -> int:
        return len(self.past)


def measured_past_of_windows(
    windows: window_sets.PredictionWindows, seconds: int
) -> tuple[Floats, NDArray[np.int64]]:
    """The last ``seconds`` of windows [N, seconds + 1, channels], newest first, with the start states at second
    0, and the number of them without a gap [N]."""
    initial = np.concatenate([windows.start, windows.wind, windows.control], axis=1)
    past = windows.past[:, : seconds + 1].copy()
    past[:, 0] = np.where(np.isfinite(past[:, 0]), past[:, 0], initial)
    return past, window_sets.seconds_without_gap(past).astype(np.int64)


def run_filter(
    packed: NDArray[np.void], plant: Plant, gains: Sequence[Gains], observations: Observations
) -> tuple[Floats, Floats]:
    """Run models along the observations of N windows, and freely from second 0.

    ``packed`` [M] are the models' parameters, ``plant`` has their extra forces, ``gains`` [M] come from
    :func:`filter_gains`. Returns the states [M, N, H+1, 6] without wave motion, and the wave motion as north, east
    [m] and heading [rad] [M, N, H+1, 3].
    """
    plants = np.repeat(packed, len(observations))
    extra, parameters = dynamics.combine_forces(plant)
    past, complete_s, control = observations.past, observations.complete_s, observations.control
    shape = len(plants), control.shape[1] + 1
    states, waves = np.empty((*shape, 6)), np.empty((*shape, 3))
    by_model = map(np.stack, zip(*gains, strict=True))
    with threads_for(len(plants) * (past.shape[1] + control.shape[1])):
        observe_and_predict(
            plants, past, complete_s, *by_model, control, observations.wind, extra, parameters, states, waves
        )
    first = len(packed), len(observations)
    return states.reshape(*first, *states.shape[1:]), waves.reshape(*first, *waves.shape[1:])


def filtered_starts(
    windows: window_sets.PredictionWindows, plant: black_box.MotionModel
) -> window_sets.PredictionWindows:
    """The windows with the start states of the reference model's Kalman filter at second 0.

    They exclude wave motion. Without earlier measurements the measured state is kept. Raises
    :class:`InputError` for windows of a ship with other actuators.
    """
    sensors.check_ship(windows.actuators, plant)
    past, complete_s = measured_past_of_windows(windows, OBSERVED_S)
    alone = Observations(past, complete_s, past[:, :0, window_sets.CONTROLS], past[:, :0, window_sets.WIND])
    gains = filter_gains(plant.length_overall_m, *NEUTRAL)
    if isinstance(plant, black_box.BlackBox):
        names = black_box.names_of_windows(windows.trial, windows.start_time)
        states = run_simulator_filter([plant], [gains], alone, names)[0][0, :, 0]
        return replace(windows, start=np.where(np.isfinite(states), states, past[:, 0, :6]))
    states, _ = run_filter(pack(plant), plant, [gains], alone)
    return replace(windows, start=states[0, :, 0])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def correct_runs(
    states: Floats, biases: Floats, swings: Floats, updates: NDArray[np.int64], measured: Floats, gains: Floats,
    pace: float,
) -> None:  # fmt: skip
    """Correct ``states`` [N, 6] by what was ``measured`` [N, channels], and with them the bias forces [N, 3] and
    the wave motion [N, 2, 3] after so many ``updates`` [N]."""
    for i in range(len(states)):
        state = (states[i, 0], states[i, 1], states[i, 2], states[i, 3], states[i, 4], states[i, 5])
        turn = min(int(abs(measured[i, 5]) / TURN_RADPS + 0.5), TURNS - 1)
        gain = gains[turn, min(updates[i], gains.shape[1] - 1)]
        possible, state = correct_by_measurement(state, biases[i], swings[i], measured[i], gain, pace)
        updates[i] += 1
        for column in range(6):
            states[i, column] = state[column] if possible else measured[i, column]
        if not possible:
            biases[i] = 0.0
            swings[i] = 0.0
            updates[i] = 0


def run_simulator_filter(
    models: Sequence[black_box.BlackBox],
    gains: Sequence[Gains],
    observations: Observations,
    names: black_box.RunNames | None = None,
) -> tuple[Floats, Floats]:
    """Run M models of one simulator along the observations of N windows, and freely from second 0, as
    :func:`run_filter` does plants: states [M, N, H+1, 6] and wave motion [M, N, H+1, 3], NaN where it failed.

    It predicts each second with the bias force per mass beside its own. One that cannot be set is no filter's
    model: ships then go on as they go in that second. Failed windows are logged by their ``names``, if given.
    """
    shape = len(models), len(observations), observations.control.shape[1] + 1
    states, waves = np.full((*shape, 6), np.nan), np.full((*shape, 3), np.nan)
    for seconds in np.unique(observations.complete_s):
        known = np.isfinite(observations.past[:, seconds, :FIRST_CONTROL]).all(axis=1)
        chosen = np.flatnonzero((observations.complete_s == seconds) & known)
        if not len(chosen):
            continue
        runs = _FilterRuns(models, gains, observations, chosen, int(seconds))
        if runs.steps == 0:
            states[:, chosen, 0], waves[:, chosen, 0] = observations.past[chosen, 0, :6], 0.0
            continue
        if models[0].run_in_s is not None:
            runs.run(np.arange(len(runs.window)), _step_at_constant_speeds, lambda *begun: None)
        else:
            black_box.run_all(
                models[0], len(runs.window),
                lambda numbers, remote, runs=runs: runs.run(numbers, remote.step, remote.start),  # type: ignore[misc]
                names and (lambda number, runs=runs: names(int(runs.window[number]))),  # type: ignore[misc]
                may_fail=names is None,
            )  # fmt: skip
        states[runs.model, runs.window], waves[runs.model, runs.window] = runs.states, runs.waves
    return states, waves


class _FilterRuns:
    """Runs of M models over those windows before which ``seconds`` have no gap, model by model.

    ``model`` and ``window`` [runs] say which; ``states`` [runs, H+1, 6] and ``waves`` [runs, H+1, 3] are filled.
    """

    def __init__(
        self, models: Sequence[black_box.BlackBox], gains: Sequence[Gains], observations: Observations,
        chosen: Ints, seconds: int,
    ) -> None:  # fmt: skip
        self.models, self.gains, self.seconds = models, gains, seconds
        self.model = np.repeat(np.arange(len(models)), len(chosen))
        self.window = np.tile(chosen, len(models))
        self.recorded = observations.past[chosen, seconds::-1]
        control = np.concatenate(
            [
                window_sets.mean_controls(self.recorded[..., window_sets.CONTROLS], models[0].layout),
                observations.control[chosen],
            ],
            axis=1,
        )
        wind = np.concatenate([self.recorded[:, 1:, window_sets.WIND], observations.wind[chosen]], axis=1)
        self.steps = control.shape[1]
        inputs = [black_box.inputs_inside(model, control, wind, 1.0) for model in models]
        self.control, self.wind = (np.concatenate(values) for values in zip(*inputs, strict=True))
        horizon_s = observations.control.shape[1]
        self.states, self.waves = (np.full((len(self.window), horizon_s + 1, width), np.nan) for width in (6, 3))

    def run(self, numbers: Ints, step: black_box.Step, begin: Callable[..., None]) -> None:
        """Run those of these ``numbers``, which ascend, with a simulator's ``step`` that was to ``begin``."""
        step = black_box.step_over_ground([self.models[model] for model in self.model[numbers]], step)
        recorded = self.recorded[numbers % len(self.recorded)]
        state, updates = recorded[:, 0, :6].copy(), np.zeros(len(numbers), dtype=np.int64)
        biases, swings = np.zeros((len(numbers), 3)), np.zeros((len(numbers), 2, 3))
        retained, wave = (np.stack([gain[part] for gain in self.gains])[self.model[numbers]] for part in (1, 2))
        begin(state, self.control[numbers, 0], self.wind[numbers, 0])
        for second in range(-self.seconds, self.states.shape[1]):
            if second >= 0:
                displaced = to_earth(swings[:, 0, 0], swings[:, 0, 1], state[:, sensors.HEADING])
                self.states[numbers, second] = state
                self.waves[numbers, second] = np.column_stack([*displaced, swings[:, 0, 2]])
            place = self.seconds + second
            if place == self.steps:
                break
            state = np.ascontiguousarray(
                step(state, self.control[numbers, place], self.wind[numbers, place], 1.0, biases)
            )
            biases, swings = biases * retained, wave @ swings
            if second < 0:
                measured = np.ascontiguousarray(recorded[:, place + 1])  # of one run it is: else compiled twice
                self._correct(numbers, state, biases, swings, updates, measured)

    def _correct(
        self, numbers: Ints, states: Floats, biases: Floats, swings: Floats, updates: NDArray[np.int64],
        measured: Floats,
    ) -> None:  # fmt: skip
        """Correct runs by what was ``measured``, each with the gains of its model."""
        bounds = np.searchsorted(self.model[numbers], np.arange(len(self.models) + 1))
        pace = pace_of_length(self.models[0].length_overall_m)
        for gain, begin, end in zip(self.gains, bounds, bounds[1:], strict=False):
            part = slice(begin, end)
            correct_runs(states[part], biases[part], swings[part], updates[part], measured[part], gain[0], pace)


def _step_at_constant_speeds(states: Floats, control: Floats, wind: Floats, dt_s: float, bias: Floats) -> Floats:
    """The states [N, 6] ``dt_s`` later at the speeds that the ``bias`` force per mass [N, 3] changes evenly."""
    mean = states.copy()
    mean[:, sensors.SURGE :] += 0.5 * dt_s * bias
    later = states.copy()
    later[:, : sensors.SURGE] += sensors.pose_change_along_arc(mean[:, None], np.array([dt_s]))[:, 0]
    later[:, sensors.SURGE :] += dt_s * bias
    return later
