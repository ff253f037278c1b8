"""The motion and the forces as the model with all its disturbances makes them out from the whole of each block.

The smoother of Bryson and Frazier (1963): the filter of :mod:`.innovations` forward, and its innovations
backward. Its motion is where the equations are made linear anew; its force is a picture of what the
model lacks, for people.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from hybrid.diagnosis.disturbance_model import (
    FREE,
    WIDTH,
    beginning,
    predicted,
    seen_through,
    sight,
    states_of,
    transition,
)
from hybrid.diagnosis.innovations import STAMP, Columns, on_all_cores
from hybrid.diagnosis.linearise import Linear
from hybrid.diagnosis.noise import FORCE_UNITS, Noise
from hybrid.vessel.compiling import FAST, compiled


def reconstructed(linear: Linear, data: Columns, noise: Noise, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """The ship's deviation from the motion made linear about [T, 6] and the slow force [T, 3], then its variances.

    Returns means [T, 9] and variances [T, 9]; forces in N, N and N m. ``data`` is one column.
    """
    mean, variance = np.zeros((len(linear.A), 9)), np.zeros((len(linear.A), 9))
    arrays = (
        linear.A, linear.B * FORCE_UNITS, linear.H, linear.origin, np.ascontiguousarray(data.drive[:, :, 0]),
        np.ascontiguousarray(data.seen[:, :, 0]), noise.as_array(),
    )  # fmt: skip

    on_all_cores(lambda part: _smooth(*arrays, part, mean, variance), edges)
    unit = np.concatenate([np.ones(6), FORCE_UNITS])
    return mean * unit, variance * unit**2


@compiled
def _smooth_block(A, B, H, origin, drive, seen, noise, first, last, mean, variance):  # type: ignore[no-untyped-def]
    """Forward and back over one block."""
    n, T = states_of(noise), last - first
    F, Q, work = np.zeros((n, WIDTH)), np.zeros((n, WIDTH)), np.zeros((n, WIDTH))
    P, m, moved, h, Ph = np.zeros((n, WIDTH)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(WIDTH)
    before_m, before_P = np.zeros((T, n)), np.zeros((T, n, WIDTH))
    gains, error, spread = np.zeros((T, 6, n)), np.zeros((T, 6)), np.zeros((T, 6))
    beginning(noise, origin[first], FREE, P)
    for t in range(T):
        k = first + t
        before_m[t], before_P[t] = m, P
        for channel in range(6):
            if np.isnan(seen[k, channel]):
                continue
            sight(H[k], origin[k], noise, channel, h)
            spread[t, channel] = seen_through(P, h, Ph) + noise[channel] ** 2
            error[t, channel] = seen[k, channel] - _dot(h, m)
            for i in range(n):
                gains[t, channel, i] = Ph[i] / spread[t, channel]
                m[i] += gains[t, channel, i] * error[t, channel]
            for i in range(n):
                for j in range(WIDTH):
                    P[i, j] -= gains[t, channel, i] * Ph[j]
        if t < T - 1:
            transition(A[k], B[k], noise, origin[k], F, Q)
            for i in range(n):
                moved[i] = _dot(m, F[i])
            for i in range(n):
                m[i] = moved[i] + (drive[k, i] if i < 6 else 0.0)
            predicted(F, Q, P, work)
    say, weight, across = np.zeros(n), np.zeros((n, n)), np.zeros(n)
    for t in range(T - 1, -1, -1):
        k = first + t
        if t < T - 1:
            transition(A[k], B[k], noise, origin[k], F, Q)
            _carried_back(F, say, weight, moved, work)
        for channel in range(5, -1, -1):
            if spread[t, channel] == 0.0:
                continue
            sight(H[k], origin[k], noise, channel, h)
            gain = gains[t, channel]
            along = _dot(gain, say)
            for i in range(n):
                across[i] = _dot(gain, weight[i])
            inner = _dot(across, gain) + 1.0 / spread[t, channel]
            for i in range(n):
                say[i] -= h[i] * (along + error[t, channel] / spread[t, channel])
                for j in range(n):
                    weight[i, j] += h[i] * h[j] * inner - h[i] * across[j] - across[i] * h[j]
        now = before_P[t]
        for i in range(9):
            mean[k, i] = before_m[t, i] - _dot(say, now[i])
            for j in range(n):
                across[j] = _dot(weight[j], now[i])
            variance[k, i] = now[i, i] - _dot(across, now[i])


@compiled
def _carried_back(F, say, weight, moved, work):  # type: ignore[no-untyped-def]
    """What the future says, a second earlier: ``say`` becomes F' say and ``weight`` F' weight F, in place."""
    n = say.size
    for i in range(n):
        moved[i] = 0.0
        for j in range(n):
            work[i, j] = 0.0
    for k in range(n):
        for i in range(n):
            f = F[k, i]
            if f != 0.0:
                moved[i] += f * say[k]
                for j in range(n):
                    work[i, j] += f * weight[k, j]
    for i in range(n):
        say[i] = moved[i]
        for j in range(n):
            weight[i, j] = 0.0
        for k in range(n):
            for j in range(n):
                weight[i, j] += work[i, k] * F[k, j]


@compiled
def _dot(a, b):  # type: ignore[no-untyped-def]
    """The product of two vectors, as far as the first goes."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


def _make(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def smooth(A, B, H, origin, drive, seen, noise, edges, mean, variance):  # type: ignore[no-untyped-def]
        for block in range(edges.size - 1 if stamp != 0 else 0):
            first, last = edges[block], edges[block + 1]
            _smooth_block(A, B, H, origin, drive, seen, noise, first, last, mean, variance)

    return smooth  # type: ignore[no-any-return]


_smooth = _make(STAMP)
