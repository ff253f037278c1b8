"""The Kalman filter and the Bryson-Frazier smoother, compiled: the one recursion behind every linear estimate here.

A block of T steps is the system

    x[k+1] = F x[k] + drive[k] + w,  cov w = Q,        z[k, c] = H[k, c] x[k] + e,  var e = R[k, c]

Channels are taken one after another, which for errors that are independent between them is the same as taking them
together, and lets each be judged by itself. The filter is linear, so that any number of columns go through it side
by side: column 0 is the data, the others what known causes would do to them (signatures). Missing samples of column
0 are NaN and passed over. Linearisation about a trajectory is the caller's: it gives F, H and what is left of the
data.

The smoother (Bryson and Frazier 1963; Bierman 1977) carries costate and information back from the end of the block.
Neither it nor the filter inverts a matrix. Matrices of the state have :data:`WIDTH` columns, zeros behind the
states': loops of a known length are compiled to vector instructions, and zeros of F and H are skipped, so that a
model of independent blocks costs no more than its blocks.

Its oracles are filterpy (in :mod:`.kalman`), a textbook filter and the batch least-squares solution, in the
tests.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.analysis.compiling import FAST, compiled, copy_row, source_stamp

WIDTH = 24
"""The number of columns of the state's matrices, and so of states at most."""


@compiled
def add_product(F: Floats, x: Floats, columns: int, result: Floats) -> None:
    """Add F x to ``result`` [n, columns or more], skipping zeros of F."""
    n = F.shape[0]
    for i in range(n):
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                for j in range(columns):
                    result[i, j] += f * x[k, j]


@compiled
def predict_covariance(F: Floats, Q: Floats, P: Floats, work: Floats) -> None:
    """``P`` becomes F P F' + Q, in place; ``work`` [n, WIDTH] is scratch. ``P`` is symmetric and stays so.

    Rounding alone would destroy the symmetry step by step, until it is no longer a covariance (Verhaegen and
    Van Dooren 1986), so it is symmetrised.
    """
    work[:] = 0.0
    add_product(F, P, WIDTH, work)
    transpose(work)
    for i in range(P.shape[0]):
        copy_row(P[i], Q[i])
    add_product(F, work, WIDTH, P)
    for i in range(P.shape[0]):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])


@compiled
def transpose(work: Floats) -> None:
    """The square part of a padded matrix [n, WIDTH] transposed in place."""
    for i in range(work.shape[0]):
        for j in range(i):
            work[i, j], work[j, i] = work[j, i], work[i, j]


@compiled
def add_inputs(drive: Floats, gain: Floats, features: Floats, moved: Floats) -> None:
    """Add a step's inputs to the means ``moved`` [n, C].

    ``drive`` [p, D] acts on the first p states in the first D columns; then come the columns in which each of the
    ``features`` [M] acts through each column of ``gain`` [p, q], q times M of them.
    """
    rows, plain = drive.shape
    count = features.size
    for i in range(rows):
        for j in range(plain):
            moved[i, j] += drive[i, j]
        for d in range(gain.shape[1]):
            for j in range(count):
                moved[i, plain + d * count + j] += gain[i, d] * features[j]


@compiled
def projected_variance(P: Floats, h: Floats, Ph: Floats) -> float:
    """Fill ``Ph`` [WIDTH] with P h and return h' P h; ``P`` is symmetric."""
    n, variance = P.shape[0], 0.0
    for j in range(WIDTH):
        Ph[j] = 0.0
    for i in range(n):
        if h[i] != 0.0:
            for j in range(WIDTH):
                Ph[j] += h[i] * P[i, j]
    for i in range(n):
        variance += h[i] * Ph[i]
    return variance


@compiled
def subtract_prediction(h: Floats, m: Floats, z: Floats) -> None:
    """Measurements ``z`` [C] become innovations z - h' m, in place."""
    for i in range(h.size):
        if h[i] != 0.0:
            for j in range(z.size):
                z[j] -= h[i] * m[i, j]


@compiled
def measurement_update(Ph: Floats, variance: float, z: Floats, m: Floats, P: Floats, gain: Floats) -> None:
    """Means [n, C] and covariance after a channel with innovations ``z`` [C]; fills its ``gain`` [n]."""
    for i in range(P.shape[0]):
        gain[i] = Ph[i] / variance
        if gain[i] != 0.0:
            for j in range(z.size):
                m[i, j] += gain[i] * z[j]
            for j in range(WIDTH):
                P[i, j] -= gain[i] * Ph[j]


@compiled
def release(
    z: Floats, H: Floats, R: Floats, turn: Floats, jumps: Bools, limit: float, refused_long: Bools,
    m: Floats, P: Floats, Ph: Floats,
) -> None:  # fmt: skip
    """Increase the variance of the quantity of a channel rejected for long by the square of its innovation."""
    n = P.shape[0]
    for c in range(R.size):
        if not refused_long[c] or np.isnan(z[c, 0]):
            continue
        variance, innovation, along = projected_variance(P, H[c], Ph) + R[c], z[c, 0], 0.0
        for i in range(n):
            innovation -= H[c, i] * m[i, 0]
            if jumps[c, i]:
                along += H[c, i] * H[c, i]
        innovation = on_circle(innovation, turn[c])
        if along <= 0.0 or innovation**2 <= limit * variance:
            continue
        scale = (innovation / along) ** 2
        for i in range(n):
            for j in range(n):
                if jumps[c, i] and jumps[c, j]:
                    P[i, j] += scale * H[c, i] * H[c, j]


@compiled
def on_circle(innovation: float, turn: float) -> float:
    """An innovation wrapped the shorter way round if its channel has a period ``turn``, else 0."""
    return float(innovation - turn * np.round(innovation / turn)) if turn > 0.0 else innovation


@compiled
def filter_pass(  # type: ignore[no-untyped-def]
    F, Q, interval, H, R, turn, gate, inputs, m, P, z, variance, filtered
) -> None:
    """One block forward: measurements ``z`` [T, c, C] become innovations, ``variance`` [T, c] theirs.

    ``F``, ``Q`` [intervals, n, WIDTH], of which ``interval[k]`` leads to step k; ``H`` [T, c, n]; ``R`` [T, c]; the
    state begins with means ``m`` [n, C] and covariance ``P`` [n, WIDTH], which are used up. ``gate`` is limit,
    patience [s] and count, times [T] and which states may jump [c, n]; an infinite limit is none. ``inputs`` are
    those of :func:`add_inputs` by step. ``filtered`` is room for gains [T, c, n], means [T, n] and covariances
    [T, n, n] after each step, of no length where they are not wanted.
    """
    limit, patience_s, patience, time_s, jumps = gate
    drive, gain, features = inputs
    gains, means, covariances = filtered
    T, channels, n = H.shape
    moved, work, Ph, kalman_gain = np.empty_like(m), np.zeros((n, WIDTH)), np.zeros(WIDTH), np.zeros(n)
    since_s, refusals = np.zeros(channels), np.zeros(channels, dtype=np.int64)
    long = np.zeros(channels, dtype=np.bool_)
    for k in range(T):
        if k > 0:
            moved[:] = 0.0
            add_product(F[interval[k]], m, m.shape[1], moved)
            if drive.shape[0] > 0:
                add_inputs(drive[k - 1], gain[k - 1], features[k - 1], moved)
            m, moved = moved, m
            predict_covariance(F[interval[k]], Q[interval[k]], P, work)
        if limit < np.inf:
            for c in range(channels):
                long[c] = refusals[c] >= patience and time_s[k] - since_s[c] >= patience_s
            release(z[k], H[k], R[k], turn, jumps, limit, long, m, P, Ph)
        for c in range(channels):
            zc, h = z[k, c], H[k, c]
            if np.isnan(zc[0]):
                continue
            spread = projected_variance(P, h, Ph) + R[k, c]
            variance[k, c] = spread
            subtract_prediction(h, m, zc)
            zc[0] = on_circle(zc[0], turn[c])
            if zc[0] ** 2 > limit * spread:
                if refusals[c] == 0:
                    since_s[c] = time_s[k]
                refusals[c] += 1
                continue
            refusals[c] = 0
            measurement_update(Ph, spread, zc, m, P, kalman_gain)
            if gains.shape[0] > 0:
                copy_row(gains[k, c], kalman_gain)
        if means.shape[0] > 0:
            copy_row(means[k], m[:, 0])
            for i in range(n):
                copy_row(covariances[k, i], P[i])


@compiled
def adjoint_predict(F: Floats, costate: Floats, information: Floats, moved: Floats, work: Floats) -> None:
    """A step back in time, in place: F' costate [n] and F' information F [n, WIDTH]."""
    n = costate.size
    for i in range(n):
        moved[i] = 0.0
        for j in range(WIDTH):
            work[i, j] = 0.0
    for k in range(n):
        for i in range(n):
            f = F[k, i]
            if f != 0.0:
                moved[i] += f * costate[k]
                for j in range(WIDTH):
                    work[i, j] += f * information[k, j]
    transpose(work)
    for i in range(n):
        costate[i] = moved[i]
        for j in range(WIDTH):
            information[i, j] = 0.0
    for k in range(n):
        for i in range(n):
            f = F[k, i]
            if f != 0.0:
                for j in range(WIDTH):
                    information[i, j] += f * work[k, j]


@compiled
def adjoint_update(
    h: Floats, gain: Floats, innovation: float, variance: float, costate: Floats, information: Floats,
    across: Floats,
) -> None:  # fmt: skip
    """Back over one channel's measurement, in place; ``across`` [n] is scratch."""
    n, along, inner = h.size, 0.0, 1.0 / variance
    for i in range(n):
        along += gain[i] * costate[i]
        across[i] = 0.0
        for j in range(n):
            across[i] += gain[j] * information[i, j]
    for i in range(n):
        inner += across[i] * gain[i]
    for i in range(n):
        costate[i] -= h[i] * (along + innovation / variance)
        for j in range(n):
            information[i, j] += h[i] * h[j] * inner - h[i] * across[j] - across[i] * h[j]


@compiled
def smoother_pass(  # type: ignore[no-untyped-def]
    F, interval, H, limit, z, variance, filtered, mean, mean_variance, costates, informations
) -> None:
    """One block back, over what :func:`filter_pass` left in ``z`` [T, c, 1], ``variance`` and ``filtered``.

    Fills ``mean`` [T, n or fewer] and ``mean_variance``, the variances of these states, and the costates [T, n] and
    informations [T, n, n] that hold before the measurements of each step; the last three where they have a length.
    The smoothed state between two steps is m - P F' costate, with the m and P predicted there, its covariance
    P - P F' information F P, with those of the later step and the F that leads to it.
    """
    gains, means, covariances = filtered
    T, channels, n = H.shape
    costate, information, moved = np.zeros(n), np.zeros((n, WIDTH)), np.zeros(n)
    work, across = np.zeros((n, WIDTH)), np.zeros(n)
    for k in range(T - 1, -1, -1):
        if k < T - 1:
            adjoint_predict(F[interval[k + 1]], costate, information, moved, work)
        P = covariances[k]
        for i in range(mean.shape[1]):
            mean[k, i] = means[k, i]
            for j in range(n):
                mean[k, i] -= P[i, j] * costate[j]
            if mean_variance.shape[0] > 0:
                mean_variance[k, i] = P[i, i]
                for j in range(n):
                    across[j] = 0.0
                    for b in range(n):
                        across[j] += information[j, b] * P[i, b]
                    mean_variance[k, i] -= P[i, j] * across[j]
        for c in range(channels - 1, -1, -1):
            if np.isnan(z[k, c, 0]) or z[k, c, 0] ** 2 > limit * variance[k, c]:
                continue
            adjoint_update(H[k, c], gains[k, c], z[k, c, 0], variance[k, c], costate, information, across)
        if costates.shape[0] > 0:
            copy_row(costates[k], costate)
            for i in range(n):
                copy_row(informations[k, i], information[i])


def _make_kernels(stamp: int) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Floats]]:
    kernel = njit(cache=True, fastmath=FAST, error_model="numpy")

    @kernel
    def run_filter(
        time_s: Floats, value: Floats, H: Floats, R: Floats, turn: Floats, jumps: Bools, F: Floats, Q: Floats,
        interval: Ints, edges: Ints, mean: Floats, covariance: Floats, limit: float, patience_s: float,
        patience: int, keep: bool,
    ) -> Any:  # fmt: skip
        """Filter stretches of measurements ``value`` [steps, c], which begin and end at ``edges`` [stretches + 1].

        Each begins with its ``mean`` [stretches, n] and with ``covariance`` [n, n]. Returns innovations and their
        variances [steps, c], NaN where nothing was measured; and gains, means and covariances after each step, or
        nothing of them.
        """
        steps, channels, n = H.shape
        z, variance = np.empty((steps, channels, 1)), np.full((steps, channels), np.nan)
        for k in range(steps):
            copy_row(z[k, :, 0], value[k])
        room = steps if keep else 0
        gains, means, covariances = np.zeros((room, channels, n)), np.empty((room, n)), np.empty((room, n, n))
        nothing = np.zeros((0, 0, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0))
        P, m = np.zeros((n, WIDTH)), np.empty((n, 1))
        for s in range(edges.size - 1 if stamp != 0 else 0):
            a, b = edges[s], edges[s + 1]
            copy_row(m[:, 0], mean[s])
            for i in range(n):
                copy_row(P[i, :n], covariance[i])
            filtered = gains[a:b], means[a:b], covariances[a:b]
            gate = limit, patience_s, patience, time_s[a:b], jumps
            filter_pass(
                F, Q, interval[a:b], H[a:b], R[a:b], turn, gate, nothing, m, P, z[a:b], variance[a:b], filtered
            )
        return z[:, :, 0].copy(), variance, gains, means, covariances

    @kernel
    def run_smoother(
        F: Floats, interval: Ints, H: Floats, limit: float, innovation: Floats, variance: Floats, gains: Floats,
        means: Floats, covariances: Floats,
    ) -> Any:  # fmt: skip
        """Smooth one stretch that :func:`run_filter` filtered: means [steps, n], costates, informations."""
        steps, n = means.shape
        z, mean, costates = np.empty((steps, gains.shape[1], 1)), np.empty((steps, n)), np.empty((steps, n))
        for k in range(steps):
            copy_row(z[k, :, 0], innovation[k])
        informations = np.empty((steps, n, n))
        filtered = gains, means, covariances
        if stamp != 0:
            smoother_pass(
                F, interval, H, limit, z, variance, filtered, mean, np.empty((0, 0)), costates, informations
            )
        return mean, costates, informations

    @kernel
    def gain_sequence(F: Floats, Q: Floats, H: Floats, R: Floats, P: Floats, steps: int) -> Floats:
        """The Kalman gains [steps, n, c] of a system that does not change, on all channels' innovations at once.

        ``F``, ``Q``, ``P`` [n, WIDTH], ``H`` [c, n], ``R`` [c]; a time step comes before each measurement. A
        channel taken after others sees innovations that these have changed already: their gains lose what it takes
        of them.
        """
        n, channels = F.shape[0], R.size
        gains, work, Ph = np.zeros((steps, n, channels)), np.zeros((n, WIDTH)), np.zeros(WIDTH)
        gain, m, z = np.zeros(n), np.zeros((n, channels)), np.zeros(channels)
        for k in range(steps if stamp != 0 else 0):
            predict_covariance(F, Q, P, work)
            m[:] = 0.0
            for c in range(channels):  # column c is the answer to an innovation of one in channel c alone
                variance = projected_variance(P, H[c], Ph) + R[c]
                z[:] = 0.0
                z[c] = 1.0
                subtract_prediction(H[c], m, z)
                measurement_update(Ph, variance, z, m, P, gain)
            for i in range(n):
                copy_row(gains[k, i], m[i])
        return gains

    return run_filter, run_smoother, gain_sequence


run_filter, run_smoother, gain_sequence = _make_kernels(source_stamp(Path(__file__)))
