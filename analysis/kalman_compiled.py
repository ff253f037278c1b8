"""The recursions of :mod:`analysis.kalman`, compiled: explicit loops, which numba turns into machine code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@njit(cache=True)
def advance(mean: Floats, covariance: Floats, dt: float, density: Floats) -> None:
    """Move a state [n] and its covariance [n, n] on by ``dt`` in place: F = I + D, block by block."""
    n = mean.size
    for first in range(0, n, 3):
        mean[first] += dt * mean[first + 1] + 0.5 * dt * dt * mean[first + 2]
        mean[first + 1] += dt * mean[first + 2]
        for j in range(n):
            covariance[first, j] += dt * covariance[first + 1, j] + 0.5 * dt * dt * covariance[first + 2, j]
            covariance[first + 1, j] += dt * covariance[first + 2, j]
    for first in range(0, n, 3):
        for i in range(n):
            covariance[i, first] += dt * covariance[i, first + 1] + 0.5 * dt * dt * covariance[i, first + 2]
            covariance[i, first + 1] += dt * covariance[i, first + 2]
    for number in range(n // 3):
        first, factor = 3 * number, density[number]
        covariance[first, first] += factor * dt**5 / 20.0
        covariance[first, first + 1] += factor * dt**4 / 8.0
        covariance[first + 1, first] += factor * dt**4 / 8.0
        covariance[first, first + 2] += factor * dt**3 / 6.0
        covariance[first + 2, first] += factor * dt**3 / 6.0
        covariance[first + 1, first + 1] += factor * dt**3 / 3.0
        covariance[first + 1, first + 2] += factor * dt**2 / 2.0
        covariance[first + 2, first + 1] += factor * dt**2 / 2.0
        covariance[first + 2, first + 2] += factor * dt


@njit(cache=True)
def seen(mean: Floats, covariance: Floats, row: Floats, value: float, turn: float, shadow: Floats) -> Any:
    """Innovation and the state's share of its variance; ``shadow`` [n] becomes P h'."""
    n = mean.size
    innovation, variance = value, 0.0
    for i in range(n):
        innovation -= row[i] * mean[i]
        total = 0.0
        for j in range(n):
            total += covariance[i, j] * row[j]
        shadow[i] = total
    for i in range(n):
        variance += row[i] * shadow[i]
    if turn > 0.0:
        innovation -= turn * np.round(innovation / turn)
    return innovation, variance


@njit(cache=True)
def set_free(covariance: Floats, row: Floats, jumps: Flags, innovation: float) -> None:
    """Make room for a jump of the size of the innovation in the states that may jump."""
    n = row.size
    along = 0.0
    for i in range(n):
        if jumps[i]:
            along += row[i] * row[i]
    if along <= 0.0:
        return
    scale = (innovation / along) ** 2
    for i in range(n):
        for j in range(n):
            if jumps[i] and jumps[j]:
                covariance[i, j] += scale * row[i] * row[j]


@njit(cache=True)
def correct(mean: Floats, covariance: Floats, shadow: Floats, innovation: float, spread2: float) -> None:
    n = mean.size
    for i in range(n):
        mean[i] += shadow[i] * innovation / spread2
        for j in range(n):
            covariance[i, j] -= shadow[i] * shadow[j] / spread2


@njit(cache=True)
def forward_pass(
    time: Floats, value: Floats, row: Floats, noise: Floats, turn: Floats, jumps: Flags,
    mean: Floats, covariance: Floats, density: Floats, limit: float, patience_s: float, patience: int,
) -> Any:  # fmt: skip
    """The filter over all steps; returns the fields of :class:`analysis.kalman.Filtered` in their order."""
    steps, channels = value.shape
    n = mean.size
    prior_means, means = np.empty((steps, n)), np.empty((steps, n))
    priors, covariances = np.empty((steps, n, n)), np.empty((steps, n, n))
    innovations, spreads = np.full((steps, channels), np.nan), np.full((steps, channels), np.nan)
    refused = np.zeros((steps, channels), dtype=np.bool_)
    since, times_refused = np.zeros(channels), np.zeros(channels, dtype=np.int64)
    state, spread, shadow = mean.copy(), covariance.copy(), np.empty(n)
    for k in range(steps):
        if k > 0:
            advance(state, spread, time[k] - time[k - 1], density)
        for c in range(channels):
            if times_refused[c] >= patience and time[k] - since[c] >= patience_s and np.isfinite(value[k, c]):
                innovation, variance = seen(state, spread, row[k, c], value[k, c], turn[c], shadow)
                if innovation**2 > limit * (variance + noise[k, c]):
                    set_free(spread, row[k, c], jumps[c], innovation)
        prior_means[k], priors[k] = state, spread
        for c in range(channels):
            if not np.isfinite(value[k, c]):
                continue
            innovation, variance = seen(state, spread, row[k, c], value[k, c], turn[c], shadow)
            variance += noise[k, c]
            innovations[k, c], spreads[k, c] = innovation, np.sqrt(variance)
            if innovation**2 > limit * variance:
                refused[k, c] = True
                if times_refused[c] == 0:
                    since[c] = time[k]
                times_refused[c] += 1
                continue
            times_refused[c] = 0
            correct(state, spread, shadow, innovation, variance)
        means[k], covariances[k] = state, spread
    return prior_means, priors, means, covariances, innovations, spreads, refused


@njit(cache=True)
def backward_pass(means: Floats, covariances: Floats, prior_means: Floats, priors: Floats, gain: Floats) -> Any:
    """Smoothed means and covariances from the filtered ones and the smoother's gains [steps - 1, n, n]."""
    steps, n = means.shape
    smooth, spread = means.copy(), covariances.copy()
    half = np.empty((n, n))
    for k in range(steps - 2, -1, -1):
        for i in range(n):
            for j in range(n):
                smooth[k, i] += gain[k, i, j] * (smooth[k + 1, j] - prior_means[k + 1, j])
                total = 0.0
                for m in range(n):
                    total += gain[k, i, m] * (spread[k + 1, m, j] - priors[k + 1, m, j])
                half[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = 0.0
                for m in range(n):
                    total += half[i, m] * gain[k, j, m]
                spread[k, i, j] += total
                if i != j:
                    spread[k, j, i] = spread[k, i, j]
    return smooth, spread


@njit(cache=True)
def cost_of(
    time: Floats, value: Floats, row: Floats, noise: Floats, turn: Floats, jumps: Flags,
    mean: Floats, covariance: Floats, density: Floats, limit: float, patience_s: float, patience: int,
) -> Any:  # fmt: skip
    """Minus twice the logarithm of the innovations' likelihood, each one's square counted up to the limit."""
    result = forward_pass(
        time, value, row, noise, turn, jumps, mean, covariance, density, limit, patience_s, patience
    )
    innovations, spreads = result[4], result[5]
    total = 0.0
    for k in range(innovations.shape[0]):
        for c in range(innovations.shape[1]):
            if np.isfinite(spreads[k, c]):
                total += 2.0 * np.log(spreads[k, c]) + min((innovations[k, c] / spreads[k, c]) ** 2, limit)
    return total
