"""Kalman gains of the observer, axis by axis, from ratios of noise levels."""

from __future__ import annotations

import numpy as np

from acquisition.core.arrays import Floats
from analysis.estimation.kalman_kernel import WIDTH, gain_sequence
from analysis.estimation.process_models import oscillator

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
