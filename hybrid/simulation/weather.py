"""Random processes of wind and waves' slow force: exact discrete Ornstein-Uhlenbeck processes.

An Ornstein-Uhlenbeck process has the Dryden spectrum of a longitudinal gust, 2 s^2 T / pi / (1 + (T w)^2),
with T the length scale over the mean wind. Two of them in quadrature have an exponentially distributed
squared envelope, as waves in groups do, and the drift force follows the squared envelope.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from acquisition.core.arrays import Floats
from hybrid.simulation.sea_state import SeaState


def ornstein_uhlenbeck(generator: np.random.Generator, steps: int, dt_s: float, time_constant_s: float) -> Floats:
    """A stationary process of zero mean and unit variance with that correlation time: [steps]."""
    kept = np.exp(-dt_s / time_constant_s)
    shocks = generator.standard_normal(steps)
    shocks[1:] *= np.sqrt(1.0 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], shocks), dtype=np.float64)


def wind_series(generator: np.random.Generator, sea: SeaState, steps: int, dt_s: float) -> Floats:
    """Direction the wind comes from [rad] and its speed [m/s] with gusts along and across it: [steps, 2]."""
    if sea.wind_mps == 0.0:
        return np.tile([np.deg2rad(sea.direction_from_deg), 0.0], (steps, 1))
    correlation_s = sea.gust_length_m / sea.wind_mps
    along, across = (
        sea.gust_intensity * sea.wind_mps * ornstein_uhlenbeck(generator, steps, dt_s, correlation_s)
        for _ in range(2)
    )
    direction = np.deg2rad(sea.direction_from_deg) + np.arctan2(across, sea.wind_mps + along)
    return np.column_stack([direction, np.hypot(sea.wind_mps + along, across)])


def drift_series(generator: np.random.Generator, sea: SeaState, steps: int, dt_s: float) -> Floats:
    """The wave drift force over its mean, never negative and one on average: [steps]."""
    if sea.wave_height_m == 0.0:
        return np.ones(steps)
    cosine, sine = (ornstein_uhlenbeck(generator, steps, dt_s, sea.group_s) for _ in range(2))
    return np.asarray(0.5 * (cosine**2 + sine**2))
