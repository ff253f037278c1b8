"""The recursions of :mod:`.kalman`, compiled: explicit loops, which numba turns into machine code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from acquisition.core.arrays import Bools, Floats, Ints


@njit(cache=True)  # type: ignore[untyped-decorator]
def advance(mean: Floats, covariance: Floats, sizes: Ints, forward: Floats, added: Floats) -> None:
    """Move a state [n] and its covariance [n, n] on in place; ``forward`` and ``added`` [blocks, m, m]."""
    half = np.empty(forward.shape[1:])
    first = 0
    for a in range(sizes.size):
        for i in range(sizes[a]):
            half[0, i] = mean[first + i]
        for i in range(sizes[a]):
            mean[first + i] = 0.0
            for m in range(sizes[a]):
                mean[first + i] += forward[a, i, m] * half[0, m]
        second = 0
        for b in range(a + 1):
            for i in range(sizes[a]):
                for j in range(sizes[b]):
                    half[i, j] = 0.0
                    for m in range(sizes[a]):
                        half[i, j] += forward[a, i, m] * covariance[first + m, second + j]
            for i in range(sizes[a]):
                for j in range(sizes[b]):
                    total = added[a, i, j] if a == b else 0.0
                    for m in range(sizes[b]):
                        total += half[i, m] * forward[b, j, m]
                    covariance[first + i, second + j] = total
                    if a != b:
                        covariance[second + j, first + i] = total
            second += sizes[b]
        first += sizes[a]


@njit(cache=True)  # type: ignore[untyped-decorator]
def seen(mean: Floats, covariance: Floats, row: Floats, value: float, turn: float, shadow: Floats) -> Any:
    """Innovation and the state's share of its variance; ``shadow`` [n] becomes P h'."""
    n = mean.size
    innovation, variance = value, 0.0
    shadow[:] = 0.0
    for j in range(n):
        if row[j] != 0.0:
            innovation -= row[j] * mean[j]
            for i in range(n):
                shadow[i] += covariance[j, i] * row[j]
    for i in range(n):
        variance += row[i] * shadow[i]
    if turn > 0.0:
        innovation -= turn * np.round(innovation / turn)
    return innovation, variance


@njit(cache=True)  # type: ignore[untyped-decorator]
def set_free(covariance: Floats, row: Floats, jumps: Bools, innovation: float) -> None:
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def correct(mean: Floats, covariance: Floats, shadow: Floats, innovation: float, spread2: float) -> None:
    n = mean.size
    for i in range(n):
        gain = shadow[i] / spread2
        mean[i] += gain * innovation
        for j in range(n):
            covariance[i, j] -= gain * shadow[j]


@njit(cache=True)  # type: ignore[untyped-decorator]
def release(
    now_s: float, value: Floats, row: Floats, noise: Floats, turn: Floats, jumps: Bools, mean: Floats,
    covariance: Floats, shadow: Floats, since_s: Floats, refusals: Ints, limit: float, patience_s: float,
    patience: int,
) -> None:  # fmt: skip
    """Set free in place what a channel that has been refused for long sees."""
    for c in range(value.size):
        if refusals[c] >= patience and now_s - since_s[c] >= patience_s and np.isfinite(value[c]):
            innovation, variance = seen(mean, covariance, row[c], value[c], turn[c], shadow)
            if innovation**2 > limit * (variance + noise[c]):
                set_free(covariance, row[c], jumps[c], innovation)


@njit(cache=True)  # type: ignore[untyped-decorator]
def receive(
    now_s: float, value: Floats, row: Floats, noise: Floats, turn: Floats, mean: Floats, covariance: Floats,
    shadow: Floats, since_s: Floats, refusals: Ints, limit: float, innovations: Floats, spreads2: Floats,
) -> None:  # fmt: skip
    """Take in a step's values channel by channel; innovations and their variances are NaN where there is none."""
    for c in range(value.size):
        innovations[c] = spreads2[c] = np.nan
        if not np.isfinite(value[c]):
            continue
        innovation, variance = seen(mean, covariance, row[c], value[c], turn[c], shadow)
        variance += noise[c]
        innovations[c], spreads2[c] = innovation, variance
        if innovation**2 > limit * variance:
            if refusals[c] == 0:
                since_s[c] = now_s
            refusals[c] += 1
            continue
        refusals[c] = 0
        correct(mean, covariance, shadow, innovation, variance)


@njit(cache=True)  # type: ignore[untyped-decorator]
def forward_pass(
    time: Floats, value: Floats, row: Floats, noise: Floats, turn: Floats, jumps: Bools,
    mean: Floats, covariance: Floats, sizes: Ints, forward: Floats, added: Floats,
    limit: float, patience_s: float, patience: int,
) -> Any:  # fmt: skip
    """The filter over all steps; returns the fields of :class:`.kalman.Filtered` in their order."""
    steps, channels = value.shape
    n = mean.size
    prior_means, means = np.empty((steps, n)), np.empty((steps, n))
    priors, covariances = np.empty((steps, n, n)), np.empty((steps, n, n))
    innovations, spreads2 = np.empty((steps, channels)), np.empty((steps, channels))
    since_s, refusals = np.zeros(channels), np.zeros(channels, dtype=np.int64)
    state, spread, shadow = mean.copy(), covariance.copy(), np.empty(n)
    for k in range(steps):
        if k > 0:
            advance(state, spread, sizes, forward[k], added[k])
        release(time[k], value[k], row[k], noise[k], turn, jumps, state, spread, shadow, since_s, refusals,
                limit, patience_s, patience)  # fmt: skip
        prior_means[k], priors[k] = state, spread
        receive(time[k], value[k], row[k], noise[k], turn, state, spread, shadow, since_s, refusals, limit,
                innovations[k], spreads2[k])  # fmt: skip
        means[k], covariances[k] = state, spread
    refused = innovations**2 > limit * spreads2
    spreads = np.sqrt(spreads2)
    return prior_means, priors, means, covariances, innovations, spreads, refused


@njit(cache=True)  # type: ignore[untyped-decorator]
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def innovations_of(
    time: Floats, value: Floats, row: Floats, noise: Floats, turn: Floats, jumps: Bools,
    mean: Floats, covariance: Floats, sizes: Ints, forward: Floats, added: Floats,
    limit: float, patience_s: float, patience: int, begins: Bools,
) -> Any:  # fmt: skip
    """The innovations and their variances alone, twice [steps, channels]; NaN where there is no value.

    ``begins`` [steps] tells where a stretch begins, with ``mean`` [steps, n] and ``covariance`` [n, n].
    """
    steps, channels = value.shape
    innovations, spreads2 = np.empty((steps, channels)), np.empty((steps, channels))
    since_s, refusals = np.zeros(channels), np.zeros(channels, dtype=np.int64)
    state, spread, shadow = mean[0].copy(), covariance.copy(), np.empty(mean.shape[1])
    for k in range(steps):
        if begins[k]:
            state[:], spread[:], refusals[:] = mean[k], covariance, 0
        else:
            advance(state, spread, sizes, forward[k], added[k])
        release(time[k], value[k], row[k], noise[k], turn, jumps, state, spread, shadow, since_s, refusals,
                limit, patience_s, patience)  # fmt: skip
        receive(time[k], value[k], row[k], noise[k], turn, state, spread, shadow, since_s, refusals, limit,
                innovations[k], spreads2[k])  # fmt: skip
    return innovations, spreads2
