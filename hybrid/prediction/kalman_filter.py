"""The model of a ship as a Kalman filter: its gains, what it is given, and the start states that it knows.

The start of a prediction is what was known at its instant, by nothing that came after: the reference model runs
along the half minute before, corrected second by second by what was measured, with a bias force for what it lacks
and an oscillator for the motion in waves. Predictions of 15 s from such starts, reference and constant velocity, in
m, against those from lines through the last 10 s and from both sides of the start:

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

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.compiling import threads_for
from analysis.estimation.kalman_kernel import WIDTH, gain_sequence
from analysis.estimation.process_models import decay, oscillator
from hybrid.prediction.observer import TURN_RADPS, TURNS, observe_and_predict
from hybrid.prediction.prediction_windows import CONTROLS, WIND, PredictionWindows
from hybrid.vessel.channels import check_ship
from hybrid.vessel.plant import Plant, pack
from hybrid.vessel.simulate import combine_forces

_DIFFUSE = 10.0
WAVE_DAMPING = 0.1


def wave_step(wave_radps: float) -> Floats:
    """The transition of displacement and speed in waves over a second [2, 2]: a lightly damped oscillator."""
    return np.array(oscillator(1.0, wave_radps, WAVE_DAMPING)).reshape(2, 2)


def kalman_gains(
    speed_walk: float,
    force_walk: float,
    position_noise: float,
    kept_force: float,
    steps: int,
    wave_walk: float = 0.0,
    wave_radps: float = 1.0,
) -> Floats:
    """The gains [steps, 5, 2] of position, speed, force, and of displacement and speed in waves, on the innovations
    of position and speed, step by step.

    One axis, a second a step: position changes by the speed, the speed by a force (per mass) that wanders; the
    measurements swing in waves beside. All variances are in units of the measured speed's, [m/s]^2 (or [rad/s]^2):
    ``speed_walk``, ``force_walk`` and ``wave_walk`` by which speed, force and speed in waves wander in a second,
    ``position_noise`` of the measured position; ``kept_force`` is the share of the force that is left a second
    later. Kalman, A new approach to linear filtering (1960); Fossen, Handbook of marine craft hydrodynamics and
    motion control (2011), section 11.3, for the waves.
    """
    F, Q, P = np.zeros((3, 5, WIDTH))
    F[:3, :3] = [[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept_force]]
    F[3:, 3:5] = wave_step(wave_radps)
    H = np.array([[1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0]])
    swing = wave_walk / (4.0 * WAVE_DAMPING * wave_radps)
    each = np.arange(5)
    Q[each, each] = [0.0, speed_walk, force_walk, 0.0, wave_walk]
    P[each, each] = [position_noise, 1.0, _DIFFUSE * force_walk, swing / wave_radps**2, swing]
    return np.asarray(gain_sequence(F, Q, H, np.array([position_noise, 1.0]), P, steps))


AXES = ("surge", "sway", "yaw")
NOISE_LEVELS = tuple(f"{what}_{axis}" for axis in AXES for what in ("speed_walk", "force_walk", "position_noise"))
FORCE_DECAY = tuple(f"force_decay_{axis}" for axis in AXES)
JITTER, JITTER_S = "stamp_jitter", 0.1
"""By how much headings are stamped too early or too late, now and then: noise that grows with the yaw rate."""
WAVES = ("wave_period", *(f"wave_walk_{axis}" for axis in AXES))
FILTER_NUMBERS = (JITTER, *NOISE_LEVELS, *FORCE_DECAY, *WAVES)
"""What the gains follow from, as deviations from the usual in units of their prior standard deviation."""

_WALKS = np.array([[-1.0, -2.5, 0.0], [-1.0, -2.5, 0.0], [-1.0, -2.5, 1.5]])  # powers of ten
_USUAL_POWER = 1.5
_FORCE_DECAY_S = 120.0
_WAVE_S, _USUAL_PERIOD = 6.0, 0.3
_WAVE_WALK = -1.0  # a power of ten
OBSERVED_S = 30
"""How many seconds before the start the filter runs along [s]."""
_RATE_NOISE_RADPS = 1e-3  # of a usual gyro, in whose square the noise levels of yaw are


NEUTRAL = (0.0,) * len(FILTER_NUMBERS)
"""The filter as it is before anything is learned."""


@lru_cache(maxsize=64)
def filter_gains(jitter: float, *numbers: float) -> tuple[Floats, Floats, Floats]:
    """The gains [turns, steps, 3 axes, 5, 2], the share of the bias force left a second later [3], and the step of
    waves [2, 2].

    ``jitter`` and ``numbers`` are those of :data:`FILTER_NUMBERS`; remembered, as most steps do not change them.
    """
    powers, lasting, (period, *walks) = np.split(
        np.array(numbers), [len(NOISE_LEVELS), len(NOISE_LEVELS) + len(FORCE_DECAY)]
    )
    levels = 10.0 ** np.clip(_WALKS + _USUAL_POWER * powers.reshape(3, 3), -6.0, 4.0)
    wave_walks = 10.0 ** np.clip(_WAVE_WALK + _USUAL_POWER * np.array(walks), -6.0, 4.0)
    wave_radps = 2.0 * np.pi / (_WAVE_S * np.exp(np.clip(_USUAL_PERIOD * period, -0.9, 0.9)))
    kept = decay(1.0, _FORCE_DECAY_S * np.exp(lasting))
    stamped = (
        JITTER_S * np.exp(np.clip(jitter, -4.0, 4.0)) * TURN_RADPS * np.arange(TURNS) / _RATE_NOISE_RADPS
    ) ** 2
    noises = levels[:, 2:] + np.array([[0.0], [0.0], [1.0]]) * stamped
    gains = [
        [_axis_gains(speed, force, noise, left, wave, wave_radps) for noise in axis_noises]
        for (speed, force, _), axis_noises, left, wave in zip(levels, noises, kept, wave_walks, strict=True)
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(gains), 0, 2)), kept, wave_step(wave_radps)


@lru_cache(maxsize=256)
def _axis_gains(speed: float, force: float, noise: float, left: float, wave: float, wave_radps: float) -> Floats:
    """The gains of one axis; most steps change none of its numbers, and without turning three times the same."""
    return kalman_gains(speed, force, noise, left, OBSERVED_S, wave, wave_radps)


@dataclass(frozen=True, slots=True)
class Observations:
    """What the filter is given of N windows.

    ``past`` [N, P+1, channels] in the order of :class:`~hybrid.prediction.prediction_windows.PredictionWindows`,
    newest first, without gaps for ``known_s`` [N] seconds; ``control`` [N, H, controls] and ``wind`` [N, H, 2] that
    act from second 0.
    """

    past: Floats
    known_s: NDArray[np.int64]
    control: Floats
    wind: Floats

    def __len__(self) -> int:
        return len(self.past)


def measured_past(windows: PredictionWindows, seconds: int) -> tuple[Floats, NDArray[np.int64]]:
    """The last ``seconds`` of windows [N, seconds + 1, channels], newest first, with what they start from at second
    0, and for how many of them there is no gap [N].
    """
    now = np.concatenate([windows.start, windows.wind, windows.control], axis=1)
    past = windows.past[:, : seconds + 1].copy()
    past[:, 0] = np.where(np.isfinite(past[:, 0]), past[:, 0], now)
    whole = np.isfinite(past).all(axis=2)
    return past, (np.cumprod(whole, axis=1).sum(axis=1) - 1).clip(min=0).astype(np.int64)


def run_filter(
    packed: NDArray[np.void], plant: Plant, gains: tuple[Floats, Floats, Floats], observations: Observations
) -> tuple[Floats, Floats]:
    """Run a model along the observations of N windows, and on from second 0.

    ``packed`` [1] are the model's numbers, ``plant`` has its extra forces, ``gains`` are of :func:`filter_gains`.
    Returns the states [N, H+1, 6] without the motion in waves, and that motion as north, east [m] and heading [rad]
    [N, H+1, 3].
    """
    plants = np.repeat(packed, len(observations))
    extra, parameters = combine_forces(plant)
    past, known, control = observations.past, observations.known_s, observations.control
    shape = len(observations), control.shape[1] + 1
    states, waves = np.empty((*shape, 6)), np.empty((*shape, 3))
    with threads_for(len(observations) * (past.shape[1] + control.shape[1])):
        observe_and_predict(
            plants, past, known, *gains, control, observations.wind, extra, parameters, states, waves
        )
    return states, waves


def filtered_starts(windows: PredictionWindows, plant: Plant) -> PredictionWindows:
    """The windows with the start states that the reference model, as a Kalman filter, knows at second 0.

    They are without the motion in waves. Where nothing was measured before, the measured state stays. Raises
    :class:`InputError` for windows of a ship with other actuators.
    """
    check_ship(windows.actuators, plant)
    past, known_s = measured_past(windows, OBSERVED_S)
    alone = Observations(past, known_s, past[:, :0, CONTROLS], past[:, :0, WIND])
    states, _ = run_filter(pack(plant), plant, filter_gains(*NEUTRAL), alone)
    return replace(windows, start=states[:, 0])
