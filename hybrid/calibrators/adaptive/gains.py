"""How far an observer follows what is measured: Kalman gains of one axis, from ratios of noise levels."""

from __future__ import annotations

import numpy as np
from numba import njit

from hybrid.vessel.compiling import Floats

_DIFFUSE = 10.0


@njit(cache=True)
def kalman_gains(
    speed_walk: float, force_walk: float, position_noise: float, kept_force: float, steps: int
) -> Floats:
    """The gains [steps, 3, 2] of position, speed and force on the errors of position and speed, step by step.

    One axis, a second a step: position changes by the speed, the speed by a force (per mass) that wanders. All
    variances are in units of the measured speed's, [m/s]^2 (or [rad/s]^2): ``speed_walk`` and ``force_walk`` by
    which speed and force wander in a second, ``position_noise`` of the measured position; ``kept_force`` is the
    share of the force that is left a second later. Kalman, A new approach to linear filtering (1960).
    """
    step = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept_force]])
    walk = np.diag(np.array([0.0, speed_walk, force_walk]))
    noise = np.diag(np.array([position_noise, 1.0]))
    covariance = np.diag(np.array([position_noise, 1.0, _DIFFUSE * force_walk]))
    gains = np.empty((steps, 3, 2))
    for number in range(steps):
        covariance = step @ covariance @ step.T + walk
        seen = np.ascontiguousarray(covariance[:, :2])
        gains[number] = seen @ np.linalg.inv(seen[:2] + noise)
        covariance = covariance - gains[number] @ covariance[:2]
    return gains
