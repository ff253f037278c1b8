"""How far an observer follows what is measured: Kalman gains of one axis, from ratios of noise levels."""

from __future__ import annotations

import numpy as np
from numba import njit

from acquisition.core.arrays import Floats

_DIFFUSE = 10.0
WAVE_DAMPING = 0.1


@njit(cache=True)
def wave_step(wave_radps: float) -> Floats:
    """How displacement and speed in waves go on in a second [2, 2]: a lightly damped oscillator, solved exactly."""
    fading = np.exp(-WAVE_DAMPING * wave_radps)
    damped = wave_radps * np.sqrt(1.0 - WAVE_DAMPING**2)
    cosine, sine = np.cos(damped), np.sin(damped) / damped
    lead = WAVE_DAMPING * wave_radps * sine
    step: Floats = fading * np.array([[cosine + lead, sine], [-(wave_radps**2) * sine, cosine - lead]])
    return step


@njit(cache=True)
def kalman_gains(
    speed_walk: float,
    force_walk: float,
    position_noise: float,
    kept_force: float,
    steps: int,
    wave_walk: float = 0.0,
    wave_radps: float = 1.0,
) -> Floats:
    """The gains [steps, 5, 2] of position, speed, force, and of displacement and speed in waves, on the errors of
    the measured position and speed, step by step.

    One axis, a second a step: position changes by the speed, the speed by a force (per mass) that wanders; what is
    measured swings in waves beside. All variances are in units of the measured speed's, [m/s]^2 (or [rad/s]^2):
    ``speed_walk``, ``force_walk`` and ``wave_walk`` by which speed, force and speed in waves wander in a second,
    ``position_noise`` of the measured position; ``kept_force`` is the share of the force that is left a second
    later. Kalman, A new approach to linear filtering (1960); Fossen, Handbook of marine craft hydrodynamics and
    motion control (2011), section 11.3, for the waves.
    """
    step = np.zeros((5, 5))
    step[:3, :3] = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept_force]])
    step[3:, 3:] = wave_step(wave_radps)
    seen = np.array([[1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0]])
    walk = np.diag(np.array([0.0, speed_walk, force_walk, 0.0, wave_walk]))
    noise = np.diag(np.array([position_noise, 1.0]))
    swing = wave_walk / (4.0 * WAVE_DAMPING * wave_radps)
    covariance = np.diag(np.array([position_noise, 1.0, _DIFFUSE * force_walk, swing / wave_radps**2, swing]))
    gains = np.empty((steps, 5, 2))
    for number in range(steps):
        covariance = step @ covariance @ step.T + walk
        across = covariance @ seen.T
        gains[number] = across @ np.linalg.inv(seen @ across + noise)
        covariance = covariance - gains[number] @ across.T
        covariance = 0.5 * (covariance + covariance.T)  # rounding would grow over thousands of steps
    return gains
