"""The motion and the forces as the model with all its disturbances makes them out from the whole of each block.

The smoother of Bryson and Frazier (1963): the filter of :mod:`.whiten` forward, and its innovations' say backward.
Its motion is where the equations are made linear anew; its force is a picture of what the model lacks, for people.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hybrid.diagnosis.disturbed import FREE, beginning, predicted, seen_through, sight, states_of, transition
from hybrid.diagnosis.linearise import Linear
from hybrid.diagnosis.noise import FORCE_UNITS, Noise
from hybrid.diagnosis.whiten import STAMP, Columns, each_block
from hybrid.vessel.compiling import FAST, Floats, compiled


def reconstructed(linear: Linear, data: Columns, noise: Noise, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """The ship's deviation from the motion made linear about [T, 6] and the slow force [T, 3], then its variances.

    Returns means [T, 9] and variances [T, 9]; forces in N, N and N m. ``data`` is one column.
    """
    mean, variance = np.zeros((len(linear.A), 9)), np.zeros((len(linear.A), 9))
    arrays = (
        linear.A, linear.B * FORCE_UNITS, linear.H, linear.origin, np.ascontiguousarray(data.drive[:, :, 0]),
        np.ascontiguousarray(data.seen[:, :, 0]), noise.as_array(),
    )  # fmt: skip

    def block(first: int, last: int) -> None:
        _smooth(*arrays, first, last, mean, variance)

    each_block(block, edges)
    unit = np.concatenate([np.ones(6), FORCE_UNITS])
    return mean * unit, variance * unit**2


@compiled
def _smooth_block(A, B, H, origin, drive, seen, noise, first, last, mean, variance):  # type: ignore[no-untyped-def]
    """Forward and back over one block."""
    n, T = states_of(noise), last - first
    P, F, Q, work = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    m, h, Ph = np.zeros(n), np.zeros(n), np.zeros(n)
    before_m, before_P = np.zeros((T, n)), np.zeros((T, n, n))
    gains, error, spread = np.zeros((T, 6, n)), np.zeros((T, 6)), np.zeros((T, 6))
    beginning(noise, origin[first], FREE, P)
    for t in range(T):
        k = first + t
        before_m[t], before_P[t] = m, P
        for channel in range(6):
            if np.isnan(seen[k, channel]):
                continue
            sight(H[k], origin[k], channel, h)
            spread[t, channel] = seen_through(P, h, Ph) + noise[channel] ** 2
            error[t, channel] = seen[k, channel] - h @ m
            for i in range(n):
                gains[t, channel, i] = Ph[i] / spread[t, channel]
                m[i] += gains[t, channel, i] * error[t, channel]
            for i in range(n):
                for j in range(n):
                    P[i, j] -= gains[t, channel, i] * Ph[j]
        if t < T - 1:
            transition(A[k], B[k], noise, origin[k], F, Q)
            m = F @ m
            for i in range(6):
                m[i] += drive[k, i]
            predicted(F, Q, P, work)
    say, weight = np.zeros(n), np.zeros((n, n))
    for t in range(T - 1, -1, -1):
        k = first + t
        if t < T - 1:
            transition(A[k], B[k], noise, origin[k], F, Q)
            say = F.T @ say
            weight = F.T @ weight @ F
        for channel in range(5, -1, -1):
            if spread[t, channel] == 0.0:
                continue
            sight(H[k], origin[k], channel, h)
            gain = gains[t, channel]
            along = gain @ say
            across = gain @ weight
            inner = across @ gain
            for i in range(n):
                say[i] -= h[i] * (along + error[t, channel] / spread[t, channel])
            for i in range(n):
                for j in range(n):
                    weight[i, j] += (
                        -h[i] * across[j] - across[i] * h[j] + h[i] * h[j] * (inner + 1.0 / spread[t, channel])
                    )
        now = before_P[t]
        shift = now @ say
        for i in range(9):
            mean[k, i] = before_m[t, i] - shift[i]
            row = now[i] @ weight
            variance[k, i] = now[i, i] - row @ now[i]


def _make(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def smooth(A, B, H, origin, drive, seen, noise, first, last, mean, variance):  # type: ignore[no-untyped-def]
        if stamp != 0:
            _smooth_block(A, B, H, origin, drive, seen, noise, first, last, mean, variance)

    return smooth  # type: ignore[no-any-return]


_smooth = _make(STAMP)
