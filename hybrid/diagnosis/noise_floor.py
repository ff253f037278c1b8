"""What noise alone leaves of a prediction: how far off a model that lacks nothing would be.

The uncertainty of the start, gusts and slow forces, carried along each window by the linear model, and the sensors'
noise and the waves in what it is compared with. It is the levels of noise that say so, no fit: the yardstick where
something unknown remains and no model is known that lacks nothing.
"""

from __future__ import annotations

import numpy as np

from acquisition.core.arrays import Floats, Ints
from analysis.estimation.process_models import decay
from hybrid.diagnosis.evidence import NormalEquations
from hybrid.diagnosis.innovations import Columns, smoothed_state
from hybrid.diagnosis.noise import FORCE_UNITS, Noise


def left_by_noise_m(equations: NormalEquations, starts: Ints, horizon_s: int) -> float:
    """The mean distance [m] over the seconds 1 to H of windows that begin at the rows ``starts``."""
    linear, noise = equations.linear, equations.noise
    data = Columns(linear.defect[:, :, None], linear.observed[:, :, None], np.zeros((len(linear.A), 0)))
    variance = smoothed_state(linear, data, noise, equations.log.edges)[1]
    P = np.zeros((len(starts), 9, 9))
    P[:, range(6), range(6)] = variance[starts, :6]
    P[:, range(6, 9), range(6, 9)] = _slow(noise)
    compared = noise.position_m**2 + noise.drift[0] ** 2 + np.square(noise.waves[:2])
    distances = []
    for second in range(horizon_s):
        P = _later(linear.A[starts + second], linear.B[starts + second] * FORCE_UNITS, noise, P)
        # the mean length of a Gaussian vector in the plane, its two variances taken as alike
        distances.append(np.sqrt(0.25 * np.pi * (P[:, 0, 0] + P[:, 1, 1] + compared.sum())))
    return float(np.mean(distances))


def _slow(noise: Noise) -> Floats:
    return np.asarray((np.array(noise.slow) / FORCE_UNITS) ** 2)


def _later(A: Floats, B: Floats, noise: Noise, P: Floats) -> Floats:
    """The covariances [N, 9, 9] of motion and slow force a second later."""
    kept = decay(1.0, noise.slow_s)
    F, Q = np.zeros_like(P), np.zeros_like(P)
    F[:, :6, :6], F[:, :6, 6:] = A, B
    F[:, range(6, 9), range(6, 9)] = kept
    gust = (np.array(noise.gust) / FORCE_UNITS) ** 2
    Q[:, :6, :6] = (B * gust) @ B.transpose(0, 2, 1)
    Q[:, range(6, 9), range(6, 9)] = (1.0 - kept**2) * _slow(noise)
    return np.asarray(F @ P @ F.transpose(0, 2, 1) + Q)
