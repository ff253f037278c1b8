"""The ship and what disturbs her as one linear system, second by second, compiled: for the Kalman kernel.

States: the ship's six deviations from the motion that the model is linear about; a slow force in each body axis, an
Ornstein-Uhlenbeck process; the swing in waves, three damped oscillators (north, east, yaw) with their speeds. They
swing at the frequency at which the ship meets the waves, and in yaw by how much these come from the side. Last come
slow errors of the sensors, an Ornstein-Uhlenbeck process each. Swing and slow errors are left out where there are
none.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from acquisition.core.arrays import Floats
from analysis.compiling import compiled
from analysis.estimation.process_models import decay, oscillator

CALM, SWING, DRIFT = 9, 6, 6
"""The number of states without waves and slow errors of sensors, and how many more each of these are."""

FREE = np.array([30.0, 30.0, 0.5, 3.0, 3.0, 0.3])
"""Standard deviations of a block's first state [m, m, rad, m/s, m/s, rad/s]: so wide that nothing is known."""

_SLOWEST_RADPS = 0.3
_GRAVITY_MPS2 = 9.81


left, oscillating = compiled(decay), compiled(oscillator)


@compiled
def has_waves(noise: Floats) -> bool:
    """Whether the ship swings."""
    return bool(noise[14] > 0.0 or noise[15] > 0.0 or noise[16] > 0.0)


@compiled
def has_drift(noise: Floats) -> bool:
    """Whether any sensor errs slowly."""
    return bool(noise[20:26].max() > 0.0)


@compiled
def states_of(noise: Floats) -> int:
    """How many states there are."""
    return CALM + (SWING if has_waves(noise) else 0) + (DRIFT if has_drift(noise) else 0)


@compiled
def measurement_rows(H: Floats, origin: Floats, noise: Floats, rows: Floats) -> None:
    """How each channel measures the states: fills ``rows`` [6, n]. ``H`` [6, 6] and ``origin`` [6] are of this
    second.

    The swing moves the ship over ground; a ship that swings in yaw measures her speed ahead along another axis.
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
    """The covariance at the start of a block: fills ``P`` [n, WIDTH], which is zero before."""
    for i in range(6):
        P[i, i] = free[i] ** 2
    for d in range(3):
        P[6 + d, 6 + d] = noise[9 + d] ** 2
    if has_drift(noise):
        first = P.shape[0] - DRIFT
        for channel in range(6):
            P[first + channel, first + channel] = noise[20 + channel] ** 2
    if not has_waves(noise):
        return
    w = _met_frequency(noise, origin)
    for d in range(3):
        for e in range(3):
            common = _swing_covariance(noise, origin, d, e)
            P[9 + 2 * d, 9 + 2 * e], P[10 + 2 * d, 10 + 2 * e] = common, common * w * w


@compiled
def transition(A: Floats, B: Floats, noise: Floats, origin: Floats, F: Floats, Q: Floats) -> None:
    """The system over a second from here: fills ``F`` and ``Q``, the process noise, both [n, WIDTH]."""
    for i in range(6):
        for j in range(6):
            F[i, j] = A[i, j]
            Q[i, j] = 0.0
            for d in range(3):
                Q[i, j] += B[i, d] * B[j, d] * noise[6 + d] ** 2
        for d in range(3):
            F[i, 6 + d] = B[i, d]
    kept = left(1.0, noise[12])
    for d in range(3):
        F[6 + d, 6 + d] = kept
        Q[6 + d, 6 + d] = (1.0 - kept * kept) * noise[9 + d] ** 2
    if has_drift(noise):
        first, kept = F.shape[0] - DRIFT, left(1.0, noise[26])
        for channel in range(6):
            F[first + channel, first + channel] = kept
            Q[first + channel, first + channel] = (1.0 - kept * kept) * noise[20 + channel] ** 2
    if has_waves(noise):
        _swing(noise, origin, F, Q)


@compiled
def _swing(noise: Floats, origin: Floats, F: Floats, Q: Floats) -> None:
    """A damped oscillator over a second, exactly, stationary."""
    w = _met_frequency(noise, origin)
    a00, a01, a10, a11 = oscillating(1.0, w, noise[18])
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
def _met_frequency(noise: Floats, origin: Floats) -> float:
    """The frequency [rad/s] at which the ship meets the waves, deep water."""
    w, along = noise[17], noise[19] - origin[2]
    ahead = origin[3] * cos(along) + origin[4] * sin(along)
    return float(max(abs(w - w * w / _GRAVITY_MPS2 * ahead), _SLOWEST_RADPS))


@compiled
def _swing_covariance(noise: Floats, origin: Floats, d: int, e: int) -> float:
    """Covariance of two directions of the swing: north and east go together, yaw needs waves from the side."""
    common = noise[14 + d] * noise[14 + e]
    if d == 2 and e == 2:
        return float(common * (0.1 + 0.9 * sin(noise[19] - origin[2]) ** 2))
    if d != e:
        return float(common * noise[13]) if d + e == 1 else 0.0
    return float(common)


@compiled
def fill_block(A, B, H, origin, noise, F, Q, rows, P) -> None:  # type: ignore[no-untyped-def]
    """The system over the T seconds of a block, as :mod:`analysis.estimation.kalman_kernel` takes it.

    Fills ``F``, ``Q`` [T or more, n, WIDTH], of which number k leads from second k to the next, ``rows`` [T or
    more, 6, n] and the initial covariance ``P`` [n, WIDTH]. F and Q are zero before, or of another block.
    """
    P[:] = 0.0
    initial_covariance(noise, origin[0], FREE, P)
    for k in range(A.shape[0]):
        measurement_rows(H[k], origin[k], noise, rows[k])
        transition(A[k], B[k], noise, origin[k], F[k], Q[k])
