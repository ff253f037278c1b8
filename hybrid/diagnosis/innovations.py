"""Prediction errors second after second, made independent and of unit variance; and the smoothed motion and forces.

A Kalman filter (:mod:`analysis.estimation.kalman_kernel`) over each block of the system in
:mod:`.disturbance_model`. It starts from a state about which nothing is known, so that every block has a free one.
Its innovations over their standard deviations are the whitened errors. The filter is linear: what an effect would
do to the errors is the filter's answer to the effect's signature, column by column, and a fit of effects to all the
data is an ordinary least-squares problem from there on.

The smoother goes back over each block. Its motion is where the equations are made linear anew; its force is a
picture of what the model lacks, for people.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import inf, sqrt
from pathlib import Path

import numpy as np
from numba import get_num_threads, njit
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.compiling import FAST, compiled, source_stamp
from analysis.estimation import kalman_kernel, process_models
from analysis.estimation.kalman_kernel import WIDTH, filter_pass, smoother_pass
from hybrid.diagnosis.disturbance_model import fill_block, states_of
from hybrid.diagnosis.linearise import Linear, Signature
from hybrid.diagnosis.noise import FORCE_UNITS, Noise

STAMP = source_stamp(
    *(Path(__file__).with_name(f"{name}.py") for name in ("disturbance_model", "innovations")),
    *(Path(module.__file__ or "") for module in (kalman_kernel, process_models)),
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
    variance = np.ones((len(linear.A), 6))
    arrays = _system(linear, noise), columns.drive, columns.seen, columns.features
    on_all_cores(lambda part: _whiten(*arrays, part, z, variance), edges)
    return z, variance


def smoothed_state(linear: Linear, data: Columns, noise: Noise, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """The ship's deviation from the motion made linear about [T, 6] and the slow force [T, 3], then its variances.

    Returns means [T, 9] and variances [T, 9]; forces in N, N and N m. ``data`` is one column.
    """
    mean, variance = np.zeros((len(linear.A), 9)), np.zeros((len(linear.A), 9))
    arrays = _system(linear, noise), data.drive, data.seen
    on_all_cores(lambda part: _smooth(*arrays, part, mean, variance), edges)
    unit = np.concatenate([np.ones(6), FORCE_UNITS])
    return mean * unit, variance * unit**2


def _system(linear: Linear, noise: Noise) -> tuple[Floats, ...]:
    """What the compiled loops know of the ship and of what disturbs her."""
    return linear.A, linear.B * FORCE_UNITS, linear.H, linear.origin, noise.as_array()


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
def _room(noise, edges):  # type: ignore[no-untyped-def]
    """Room for the system of the longest block, the variances of its samples, and which transition leads where."""
    n, longest = states_of(noise), 0
    for block in range(edges.size - 1):
        longest = max(longest, edges[block + 1] - edges[block])
    R = np.empty((longest, 6))
    R[:] = noise[:6] ** 2
    F, Q = np.zeros((longest, n, WIDTH)), np.zeros((longest, n, WIDTH))
    return F, Q, np.zeros((longest, 6, n)), R, np.zeros((n, WIDTH)), np.arange(longest) - 1


@compiled
def _no_gate():  # type: ignore[no-untyped-def]
    """The gate of a filter that refuses nothing."""
    return inf, 0.0, 0, np.zeros(0), np.zeros((0, 0), dtype=np.bool_)


def _make_whiten(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def whiten(system, drive, seen, features, edges, z, variance):  # type: ignore[no-untyped-def]
        A, B, H, origin, noise = system
        F, Q, rows, R, P, interval = _room(noise, edges)
        plain, none = drive.shape[2], np.zeros((0, 0, 0))
        kept, gain = (none, np.zeros((0, 0)), none), np.zeros((rows.shape[0], 6, 3))
        for block in range(edges.size - 1 if stamp != 0 else 0):
            a, b = edges[block], edges[block + 1]
            T = b - a
            fill_block(A[a:b], B[a:b], H[a:b], origin[a:b], noise, F, Q, rows, P)
            for k in range(T):  # a feature's force is what the data would show: it is taken off
                for i in range(6):
                    for d in range(3):
                        gain[k, i, d] = -B[a + k, i, d]
                    for j in range(plain):
                        z[a + k, i, j] = seen[a + k, i, j]
            inputs, m = (drive[a:b], gain, features[a:b]), np.zeros((rows.shape[2], z.shape[2]))
            filter_pass(
                F, Q, interval, rows[:T], R, np.zeros(6), _no_gate(), inputs, m, P, z[a:b], variance[a:b], kept
            )
            for k in range(a, b):
                for channel in range(6):
                    missing = np.isnan(seen[k, channel, 0])
                    factor = 1.0 / sqrt(variance[k, channel])
                    for j in range(z.shape[2]):
                        z[k, channel, j] = 0.0 if missing else factor * z[k, channel, j]

    return whiten  # type: ignore[no-any-return]


def _make_smooth(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def smooth(system, drive, seen, edges, mean, mean_variance):  # type: ignore[no-untyped-def]
        A, B, H, origin, noise = system
        F, Q, rows, R, P, interval = _room(noise, edges)
        n, none = P.shape[0], np.zeros((0, 0, 0))
        for block in range(edges.size - 1 if stamp != 0 else 0):
            a, b = edges[block], edges[block + 1]
            T = b - a
            fill_block(A[a:b], B[a:b], H[a:b], origin[a:b], noise, F, Q, rows, P)
            inputs, m = (drive[a:b], np.zeros((T, 6, 0)), np.zeros((T, 0))), np.zeros((n, 1))
            z, variance = seen[a:b].copy(), np.ones((T, 6))
            kept = np.zeros((T, 6, n)), np.zeros((T, n)), np.zeros((T, n, n))
            filter_pass(F, Q, interval, rows[:T], R, np.zeros(6), _no_gate(), inputs, m, P, z, variance, kept)
            smoother_pass(
                F, interval, rows[:T], inf, z, variance, kept, mean[a:b], mean_variance[a:b], np.zeros((0, 0)), none
            )

    return smooth  # type: ignore[no-any-return]


_whiten, _smooth = _make_whiten(STAMP), _make_smooth(STAMP)
