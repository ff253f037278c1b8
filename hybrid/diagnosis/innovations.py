"""Prediction errors of one second after another, made independent and of unit variance, compiled.

A Kalman filter (Kalman 1960) over each block of the system in :mod:`.disturbance_model`. It starts from a state
about which nothing is known, so that every block has a free one. Its innovations over their spread are the
whitened errors. The filter is linear: what an effect would do to the errors is the filter's answer to the effect's
signature, column by column, and a fit of effects to all the data is an ordinary least-squares problem from there
on. Missing samples are passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
from numba import get_num_threads, njit
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
from hybrid.diagnosis.linearise import Linear, Signature
from hybrid.diagnosis.noise import FORCE_UNITS, Noise
from hybrid.vessel.compiling import FAST, compiled, source_stamp

STAMP = source_stamp(
    *(Path(__file__).with_name(f"{name}.py") for name in ("disturbance_model", "innovations", "smoother"))
)


@dataclass(frozen=True, slots=True)
class Columns:
    """What the filter is asked for, column by column.

    ``drive`` [T, 6, C] enters the next state and ``seen`` [T, 6, C] the measurement; column 0 is the data. A force
    feature in ``features`` [T, M] makes three columns more, one a body axis, in that order of axes.
    """

    drive: Floats
    seen: Floats
    features: Floats

    @property
    def count(self) -> int:
        """How many columns come out."""
        return int(self.drive.shape[2] + 3 * self.features.shape[1])


def columns_of(linear: Linear, effects: Sequence[Signature], features: Floats | None = None) -> Columns:
    """The data and the signatures of effects and force features; an effect predicted is an effect taken off."""
    drive = np.stack([linear.defect, *(-each.D for each in effects)], axis=2)
    seen = np.stack([linear.observed, *(each.E for each in effects)], axis=2)
    none = np.zeros((len(linear.defect), 0))
    return Columns(drive, seen, none if features is None else features)


def whitened(linear: Linear, columns: Columns, noise: Noise, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Whitened columns [T, 6, C] and the variances of the innovations [T, 6], 1 where nothing was measured.

    ``edges`` [blocks + 1] are the rows at which blocks begin, and the end.
    """
    z = np.zeros((len(linear.A), 6, columns.count))
    spread = np.ones((len(linear.A), 6))
    arrays = (
        linear.A, linear.B * FORCE_UNITS, linear.H, linear.origin, columns.drive, columns.seen, columns.features,
        noise.as_array(),
    )  # fmt: skip

    on_all_cores(lambda part: _whiten(*arrays, part, z, spread), edges)
    return z, spread


def on_all_cores(work: Callable[[NDArray[np.int64]], None], edges: NDArray[np.int64]) -> None:
    """Call compiled ``work`` with the edges of a share of the blocks on each core: it leaves Python alone."""
    shares = np.array_split(np.arange(len(edges) - 1), min(get_num_threads(), len(edges) - 1))
    parts = [edges[share[0] : share[-1] + 2] for share in shares]
    if len(parts) == 1:
        work(parts[0])
        return
    with ThreadPoolExecutor(len(parts)) as pool:
        for done in pool.map(work, parts):
            assert done is None


@compiled
def _whiten_block(  # type: ignore[no-untyped-def]
    A, B, H, origin, drive, seen, features, noise, first, last, z, spread
):
    """The whitened columns of one block; see :func:`whitened` for what the arrays are."""
    plain, M = drive.shape[2], features.shape[1]
    C, n = plain + 3 * M, states_of(noise)
    P, F, Q, work = np.zeros((n, WIDTH)), np.zeros((n, WIDTH)), np.zeros((n, WIDTH)), np.zeros((n, WIDTH))
    m, moved = np.zeros((n, C)), np.zeros((n, C))
    h, Ph = np.zeros(n), np.zeros(WIDTH)
    beginning(noise, origin[first], FREE, P)
    for k in range(first, last):
        for channel in range(6):
            if np.isnan(seen[k, channel, 0]):
                continue
            sight(H[k], origin[k], noise, channel, h)
            variance = seen_through(P, h, Ph) + noise[channel] ** 2
            spread[k, channel] = variance
            out = z[k, channel]
            for j in range(plain):
                out[j] = seen[k, channel, j]
            for i in range(n):
                if h[i] != 0.0:
                    for j in range(C):
                        out[j] -= h[i] * m[i, j]
            for i in range(n):
                gain = Ph[i] / variance
                if gain != 0.0:
                    for j in range(C):
                        m[i, j] += gain * out[j]
                    for j in range(WIDTH):
                        P[i, j] -= gain * Ph[j]
            root = 1.0 / sqrt(variance)
            for j in range(C):
                out[j] *= root
        if k == last - 1:
            break
        transition(A[k], B[k], noise, origin[k], F, Q)
        _moved(F, m, B[k], drive[k], features[k], moved)
        m, moved = moved, m
        predicted(F, Q, P, work)


@compiled
def _moved(F, m, B, drive, features, moved):  # type: ignore[no-untyped-def]
    """The filter's means a second later: fills ``moved`` [n, C]."""
    n, plain, M = F.shape[0], drive.shape[1], features.size
    for i in range(n):
        for j in range(m.shape[1]):
            moved[i, j] = 0.0
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                for j in range(m.shape[1]):
                    moved[i, j] += f * m[k, j]
        if i < 6:
            for j in range(plain):
                moved[i, j] += drive[i, j]
            for d in range(3):
                for j in range(M):
                    moved[i, plain + d * M + j] -= B[i, d] * features[j]


def _make(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def whiten(A, B, H, origin, drive, seen, features, noise, edges, z, spread):  # type: ignore[no-untyped-def]
        for block in range(edges.size - 1 if stamp != 0 else 0):
            first, last = edges[block], edges[block + 1]
            _whiten_block(A, B, H, origin, drive, seen, features, noise, first, last, z, spread)

    return whiten  # type: ignore[no-any-return]


_whiten = _make(STAMP)
