"""Ship and disturbances as one linear system, with its Kalman filter and smoother.

States: the ship's six deviations from the linearisation; a slow force in each body axis (Ornstein-Uhlenbeck);
the wave motion, three damped oscillators (north, east, yaw) with their rates, at the frequency of encounter,
the yaw one scaled by how far the waves come from the side; the slow drift of the waves, one force
(Ornstein-Uhlenbeck) along the direction in which they travel, with the shares of the mean drift in surge, sway
and yaw (Newman 1974, Int. Symp. Dynamics of Marine Vehicles); and the drift of each sensor
(Ornstein-Uhlenbeck). Wave motion, wave drift and sensor drift are left out where there are none.
:class:`DisturbanceNoise` holds all levels; the system is compiled for
:mod:`seatrial.analysis.estimation.kalman_kernel`.

The filter starts each block from an unknown state, so every block has a free start. Innovations divided by
their standard deviations are the whitened errors. The filter is linear, so the change of these errors with an
effect is the filter's response to the effect's signature, column by column, and fitting effects to all data
becomes an ordinary least-squares problem. The smoother runs backwards over each block: its trajectory is the
next linearisation, its force shows a person what the model lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from math import cos, inf, sin, sqrt
from pathlib import Path

import numpy as np
from numba import get_num_threads, njit
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats
from seatrial.analysis.compiling import FAST, compiled, source_stamp
from seatrial.analysis.estimation import kalman_kernel, process_models
from seatrial.analysis.estimation.kalman_kernel import WIDTH, filter_pass, smoother_pass
from seatrial.analysis.estimation.process_models import decay, oscillator
from seatrial.hybrid.diagnosis.linearise import Linearisation, LinearModel, Signature
from seatrial.hybrid.vessel import dynamics

FORCE_UNITS = np.array([1e3, 1e3, 1e4])
"""The filter uses kN and 10 kN m, which keeps its numbers of similar magnitude."""


@dataclass(frozen=True, slots=True)
class DisturbanceNoise:
    """Standard deviations, SI.

    The first five are of each sensor's mean over a second. ``gust`` is the force that changes from second to
    second, ``slow`` the one with time constant ``slow_s``: surge, sway [N] and yaw [N m]. ``waves`` is the wave
    motion north, east [m] (with ``wave_correlation``) and in yaw [rad], with the frequency in a fixed frame,
    the damping and the direction that the waves travel in; the ship meets them at the frequency of encounter
    and yaws when they come from the side. ``wave_drift_n`` is their slow drift in beam sea on a ship ``length_m``
    long, with a time constant of its own. ``drift`` is the slow error of position [m], heading [rad], surge,
    sway [m/s] and yaw rate [rad/s], with time constant ``drift_s``.
    """

    position_m: float = 0.03
    heading_rad: float = 0.001
    surge_mps: float = 0.02
    sway_mps: float = 0.02
    yaw_rate_radps: float = 0.0005
    gust: tuple[float, float, float] = (300.0, 300.0, 3000.0)
    slow: tuple[float, float, float] = (300.0, 300.0, 3000.0)
    slow_s: float = 20.0
    waves: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wave_correlation: float = 0.0
    wave_frequency_radps: float = 1.2
    wave_damping: float = 0.2
    wave_towards_rad: float = 0.0
    wave_drift_n: float = 0.0
    wave_drift_s: float = 20.0
    length_m: float = 0.0
    drift: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    drift_s: float = 10.0

    @property
    def has_waves(self) -> bool:
        """Whether there is wave motion."""
        return any(level > 0.0 for level in self.waves)

    @property
    def has_drift(self) -> bool:
        """Whether any sensor drifts."""
        return any(level > 0.0 for level in self.drift)

    def as_array(self) -> Floats:
        """For the filter: sensors 6, gusts 3, slow forces 3 and their time constant; of the waves correlation,
        3 levels, frequency, damping, direction; sensor drift 6 and its time constant; wave drift, its time
        constant and the arm of its yaw moment."""
        sensors = [self.position_m] * 2 + [self.heading_rad, self.surge_mps, self.sway_mps, self.yaw_rate_radps]
        gust, slow = (np.array(force) / FORCE_UNITS for force in (self.gust, self.slow))
        swing = [self.wave_frequency_radps, self.wave_damping, self.wave_towards_rad]
        drift = [self.drift[0], *self.drift, self.drift_s]
        arm = self.length_m * FORCE_UNITS[0] / FORCE_UNITS[2]
        push = [self.wave_drift_n / FORCE_UNITS[0], self.wave_drift_s, arm]
        return np.array(
            [*sensors, *gust, *slow, self.slow_s, self.wave_correlation, *self.waves, *swing, *drift, *push]
        )


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """The result of the second stage: a better linearisation, and the noise about it.

    ``linearisation`` follows the trajectory [T, 6] smoothed with model and disturbances; ``noise`` are the
    maximum-likelihood standard deviations (SI) of sensors, gusts, slow forces, waves and their drift.
    """

    linearisation: Linearisation
    noise: DisturbanceNoise


CALM, SWING, PUSH, DRIFT = 9, 6, 1, 6
"""The number of states without waves and drift, and how many wave motion, wave drift and sensor drift add."""

FREE = np.array([30.0, 30.0, 0.5, 3.0, 3.0, 0.3])
"""Standard deviations of a block's first state [m, m, rad, m/s, m/s, rad/s]: wide enough to be uninformative."""

_SLOWEST_RADPS = 0.3


_decay, _oscillator = compiled(decay), compiled(oscillator)


@compiled
def has_waves(noise: Floats) -> bool:
    """Whether there is wave motion."""
    return bool(noise[14] > 0.0 or noise[15] > 0.0 or noise[16] > 0.0)


@compiled
def has_drift(noise: Floats) -> bool:
    """Whether any sensor drifts."""
    return bool(noise[20:26].max() > 0.0)


@compiled
def has_wave_drift(noise: Floats) -> bool:
    """Whether there is slow drift of the waves."""
    return bool(noise[27] > 0.0)


@compiled
def states_of(noise: Floats) -> int:
    """The number of states."""
    count = CALM + (SWING if has_waves(noise) else 0) + (DRIFT if has_drift(noise) else 0)
    return count + (PUSH if has_wave_drift(noise) else 0)


@compiled
def wave_drift_state(noise: Floats) -> int:
    """Which state is the wave drift: the one after those of the wave motion."""
    return CALM + (SWING if has_waves(noise) else 0)


@compiled
def measurement_rows(H: Floats, origin: Floats, noise: Floats, rows: Floats) -> None:
    """Fill ``rows`` [6, n], the measurement matrix, with ``H`` [6, 6] and ``origin`` [6] of this second.

    Waves move the ship over ground, and their yaw rotates the axes along which speed is measured.
    """
    for channel in range(6):
        rows[channel, :] = 0.0
        for i in range(6):
            rows[channel, i] = H[channel, i]
        if has_drift(noise):
            rows[channel, rows.shape[1] - DRIFT + channel] = 1.0
    if not has_waves(noise):
        return
    c, s = cos(origin[2]), sin(origin[2])
    rows[0, 9] = rows[1, 11] = rows[2, 13] = rows[5, 14] = 1.0
    rows[3, 10], rows[3, 12], rows[3, 13] = c, s, origin[4]
    rows[4, 10], rows[4, 12], rows[4, 13] = -s, c, -origin[3]


@compiled
def initial_covariance(noise: Floats, origin: Floats, free: Floats, P: Floats) -> None:
    """Fill ``P`` [n, WIDTH], zero before, with the covariance at the start of a block."""
    for i in range(6):
        P[i, i] = free[i] ** 2
    for d in range(3):
        P[6 + d, 6 + d] = noise[9 + d] ** 2
    if has_wave_drift(noise):
        push = wave_drift_state(noise)
        P[push, push] = noise[27] ** 2
    if has_drift(noise):
        first = P.shape[0] - DRIFT
        for channel in range(6):
            P[first + channel, first + channel] = noise[20 + channel] ** 2
    if not has_waves(noise):
        return
    w = _encounter_frequency(noise, origin)
    for d in range(3):
        for e in range(3):
            common = _swing_covariance(noise, origin, d, e)
            P[9 + 2 * d, 9 + 2 * e], P[10 + 2 * d, 10 + 2 * e] = common, common * w * w


@compiled
def fill_transition(A: Floats, B: Floats, noise: Floats, origin: Floats, F: Floats, Q: Floats) -> None:
    """Fill ``F`` and ``Q`` [n, WIDTH]: transition and process noise over the next second."""
    for i in range(6):
        for j in range(6):
            F[i, j] = A[i, j]
            Q[i, j] = 0.0
            for d in range(3):
                Q[i, j] += B[i, d] * B[j, d] * noise[6 + d] ** 2
        for d in range(3):
            F[i, 6 + d] = B[i, d]
    kept = _decay(1.0, noise[12])
    for d in range(3):
        F[6 + d, 6 + d] = kept
        Q[6 + d, 6 + d] = (1.0 - kept * kept) * noise[9 + d] ** 2
    if has_wave_drift(noise):
        push, relative_rad, kept = wave_drift_state(noise), noise[19] - origin[2], _decay(1.0, noise[28])
        force = dynamics.wave_drift_at(1.0, noise[29], cos(relative_rad), sin(relative_rad))
        F[push, push], Q[push, push] = kept, (1.0 - kept * kept) * noise[27] ** 2
        for i in range(6):
            F[i, push] = B[i, 0] * force[0] + B[i, 1] * force[1] + B[i, 2] * force[2]
    if has_drift(noise):
        first, kept = F.shape[0] - DRIFT, _decay(1.0, noise[26])
        for channel in range(6):
            F[first + channel, first + channel] = kept
            Q[first + channel, first + channel] = (1.0 - kept * kept) * noise[20 + channel] ** 2
    if has_waves(noise):
        _fill_oscillator(noise, origin, F, Q)


@compiled
def _fill_oscillator(noise: Floats, origin: Floats, F: Floats, Q: Floats) -> None:
    """A stationary damped oscillator, discretised exactly over a second."""
    w = _encounter_frequency(noise, origin)
    a00, a01, a10, a11 = _oscillator(1.0, w, noise[18])
    q00 = 1.0 - a00 * a00 - a01 * a01 * w * w
    q11 = w * w - a10 * a10 - a11 * a11 * w * w
    q01 = -(a00 * a10 + a01 * a11 * w * w)
    for d in range(3):
        i = 9 + 2 * d
        F[i, i], F[i, i + 1], F[i + 1, i], F[i + 1, i + 1] = a00, a01, a10, a11
        for e in range(3):
            j = 9 + 2 * e
            common = _swing_covariance(noise, origin, d, e)
            Q[i, j], Q[i + 1, j + 1] = common * q00, common * q11
            Q[i, j + 1], Q[i + 1, j] = common * q01, common * q01


@compiled
def _encounter_frequency(noise: Floats, origin: Floats) -> float:
    """The frequency of encounter [rad/s] in deep water."""
    w, along = noise[17], noise[19] - origin[2]
    ahead = origin[3] * cos(along) + origin[4] * sin(along)
    return float(max(abs(w - w * w / GRAVITY_MPS2 * ahead), _SLOWEST_RADPS))


@compiled
def _swing_covariance(noise: Floats, origin: Floats, d: int, e: int) -> float:
    """Covariance of two directions of the wave motion: north and east correlate, yaw needs waves from the side."""
    common = noise[14 + d] * noise[14 + e]
    if d == 2 and e == 2:
        return float(common * (0.1 + 0.9 * sin(noise[19] - origin[2]) ** 2))
    if d != e:
        return float(common * noise[13]) if d + e == 1 else 0.0
    return float(common)


@compiled
def fill_block(A, B, H, origin, noise, F, Q, rows, P) -> None:  # type: ignore[no-untyped-def]
    """The system over the T seconds of a block, as :mod:`seatrial.analysis.estimation.kalman_kernel` takes it.

    Fills ``F``, ``Q`` [T or more, n, WIDTH], where number k leads from second k to the next, ``rows`` [T or
    more, 6, n] and the initial covariance ``P`` [n, WIDTH]. F and Q are zero before, or hold another block.
    """
    P[:] = 0.0
    initial_covariance(noise, origin[0], FREE, P)
    for k in range(A.shape[0]):
        measurement_rows(H[k], origin[k], noise, rows[k])
        fill_transition(A[k], B[k], noise, origin[k], F[k], Q[k])


_COMPILED_WITH = (kalman_kernel, process_models, dynamics)
STAMP = source_stamp(Path(__file__), *(Path(module.__file__ or "") for module in _COMPILED_WITH))


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns that the filter whitens.

    ``drive`` [T, 6, C] enters the next state and ``readings`` [T, 6, C] the measurement; column 0 is the data.
    Each force feature in ``features`` [T, M] adds three columns, one for each body axis, in that order of axes.
    """

    drive: Floats
    readings: Floats
    features: Floats

    @property
    def count(self) -> int:
        """The number of whitened columns."""
        return int(self.drive.shape[2] + 3 * self.features.shape[1])


def columns_of(linear: LinearModel, effects: Sequence[Signature], features: Floats | None = None) -> Columns:
    """The data, then the signatures of effects and force features, signed so that they remove an effect."""
    drive = np.stack([linear.defect, *(-signature.D for signature in effects)], axis=2)
    readings = np.stack([linear.observed, *(signature.E for signature in effects)], axis=2)
    no_features = np.zeros((len(linear.defect), 0))
    return Columns(drive, readings, no_features if features is None else features)


def whiten(
    linear: LinearModel, columns: Columns, noise: DisturbanceNoise, edges: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Whitened columns [T, 6, C] and variances of the innovations [T, 6], 1 where there was no measurement.

    ``edges`` [blocks + 1] are the first rows of the blocks, and the end.
    """
    z = np.zeros((len(linear.A), 6, columns.count))
    variance = np.ones((len(linear.A), 6))
    arrays = _kernel_arguments(linear, noise), columns.drive, columns.readings, columns.features
    on_all_cores(lambda part: _whiten(*arrays, part, z, variance), edges)
    return z, variance


def smooth_state(
    linear: LinearModel, data: Columns, noise: DisturbanceNoise, edges: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """The smoothed deviation from the linearisation [T, 6] and slow force [T, 3], with their variances.

    Returns means [T, 9] and variances [T, 9]; forces in N, N and N m. ``data`` is one column.
    """
    mean, variance = np.zeros((len(linear.A), 9)), np.zeros((len(linear.A), 9))
    arrays = _kernel_arguments(linear, noise), data.drive, data.readings
    on_all_cores(lambda part: _smooth(*arrays, part, mean, variance), edges)
    unit = np.concatenate([np.ones(6), FORCE_UNITS])
    return mean * unit, variance * unit**2


def _kernel_arguments(linear: LinearModel, noise: DisturbanceNoise) -> tuple[Floats, ...]:
    """The system as arguments of the compiled loops."""
    return linear.A, linear.B * FORCE_UNITS, linear.H, linear.origin, noise.as_array()


def on_all_cores(work: Callable[[NDArray[np.int64]], None], edges: NDArray[np.int64]) -> None:
    """Call compiled ``work``, which releases the GIL, with a share of the blocks on each core."""
    shares = np.array_split(np.arange(len(edges) - 1), min(get_num_threads(), len(edges) - 1))
    parts = [edges[share[0] : share[-1] + 2] for share in shares]
    if len(parts) == 1:
        work(parts[0])
        return
    for result in _pool_of_threads(len(parts)).map(work, parts):
        assert result is None


_pool_of_threads = cache(ThreadPoolExecutor)
"""Threads that are kept, by their number: started some 400 times a diagnosis, they cost a tenth of it on a busy
machine."""


@compiled
def _work_arrays_of_longest_block(noise, edges):  # type: ignore[no-untyped-def]
    """Work arrays for the longest block: system, sample variances, and the transition before each sample."""
    n, longest = states_of(noise), 0
    for block in range(edges.size - 1):
        longest = max(longest, edges[block + 1] - edges[block])
    R = np.empty((longest, 6))
    for k in range(longest):
        for channel in range(6):
            R[k, channel] = noise[channel] ** 2
    F, Q = np.zeros((longest, n, WIDTH)), np.zeros((longest, n, WIDTH))
    return F, Q, np.zeros((longest, 6, n)), R, np.zeros((n, WIDTH)), np.arange(longest) - 1


@compiled
def _no_gate():  # type: ignore[no-untyped-def]
    """An innovation gate that rejects nothing."""
    return inf, 0.0, 0, np.zeros(0), np.zeros((0, 0), dtype=np.bool_)


def _make_whiten(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def whiten(system, drive, readings, features, edges, z, variance):  # type: ignore[no-untyped-def]
        A, B, H, origin, noise = system
        F, Q, rows, R, P, interval = _work_arrays_of_longest_block(noise, edges)
        plain, empty = drive.shape[2], np.zeros((0, 0, 0))
        stored, gain = (empty, np.zeros((0, 0)), empty), np.zeros((rows.shape[0], 6, 3))
        for block in range(edges.size - 1 if stamp != 0 else 0):
            a, b = edges[block], edges[block + 1]
            T = b - a
            fill_block(A[a:b], B[a:b], H[a:b], origin[a:b], noise, F, Q, rows, P)
            for k in range(T):  # subtracted: a force predicted is a force removed from the data
                for i in range(6):
                    for d in range(3):
                        gain[k, i, d] = -B[a + k, i, d]
                    for j in range(plain):
                        z[a + k, i, j] = readings[a + k, i, j]
            inputs, m = (drive[a:b], gain, features[a:b]), np.zeros((rows.shape[2], z.shape[2]))
            filter_pass(
                F, Q, interval, rows[:T], R, np.zeros(6), _no_gate(), inputs, m, P, z[a:b], variance[a:b], stored
            )
            for k in range(a, b):
                for channel in range(6):
                    missing = np.isnan(readings[k, channel, 0])
                    factor = 1.0 / sqrt(variance[k, channel])
                    for j in range(z.shape[2]):
                        z[k, channel, j] = 0.0 if missing else factor * z[k, channel, j]

    return whiten  # type: ignore[no-any-return]


def _make_smooth(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def smooth(system, drive, readings, edges, mean, mean_variance):  # type: ignore[no-untyped-def]
        A, B, H, origin, noise = system
        F, Q, rows, R, P, interval = _work_arrays_of_longest_block(noise, edges)
        n, empty = P.shape[0], np.zeros((0, 0, 0))
        for block in range(edges.size - 1 if stamp != 0 else 0):
            a, b = edges[block], edges[block + 1]
            T = b - a
            fill_block(A[a:b], B[a:b], H[a:b], origin[a:b], noise, F, Q, rows, P)
            inputs, m = (drive[a:b], np.zeros((T, 6, 0)), np.zeros((T, 0))), np.zeros((n, 1))
            z, variance = readings[a:b].copy(), np.ones((T, 6))
            stored = np.zeros((T, 6, n)), np.zeros((T, n)), np.zeros((T, n, n))
            filter_pass(F, Q, interval, rows[:T], R, np.zeros(6), _no_gate(), inputs, m, P, z, variance, stored)
            smoother_pass(
                F,
                interval,
                rows[:T],
                inf,
                z,
                variance,
                stored,
                mean[a:b],
                mean_variance[a:b],
                np.zeros((0, 0)),
                empty,
            )

    return smooth  # type: ignore[no-any-return]


_whiten, _smooth = _make_whiten(STAMP), _make_smooth(STAMP)
