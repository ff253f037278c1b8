"""From what the drives' feedback shows to what acts: when it is stamped, and the play of a gear behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from acquisition.core.arrays import Floats


def acting_controls(controls: ArrayLike, delay_s: ArrayLike, dt_s: float, angles: Sequence[int]) -> Floats:
    """The controls that act while ``controls`` [..., K, controls] are recorded ``delay_s`` after they acted.

    ``delay_s`` is one number or one a run, [...]; with a negative one this is what such a record shows of
    controls that act. Linear between samples ``dt_s`` apart (which is the mean over a step of controls that
    are held), those that are ``angles`` [rad] along the shorter way round, held beyond the ends.
    No delay, no change.
    """
    recorded = np.asarray(controls, dtype=np.float64)
    delay = np.asarray(delay_s, dtype=np.float64)
    if not delay.any():
        return recorded
    last, width = recorded.shape[-2] - 1, recorded.shape[-1]
    recorded = np.broadcast_to(recorded, (*np.broadcast_shapes(recorded.shape[:-2], delay.shape), last + 1, width))
    times = np.clip(np.arange(last + 1) + delay[..., np.newaxis] / dt_s, 0.0, last)
    lower = np.broadcast_to(np.floor(times).astype(int), recorded.shape[:-1])[..., np.newaxis]
    part = times[..., np.newaxis] - lower
    left = np.take_along_axis(recorded, lower, axis=-2)
    step = np.take_along_axis(recorded, np.minimum(lower + 1, last), axis=-2) - left
    turn = step[..., angles]
    step[..., angles] = turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    return np.asarray(left + part * step)


@njit(cache=True)
def behind_play(motor: Floats, width: float) -> Floats:
    """Where the end of a gear with play stands when its motor's side has stood at ``motor`` [K], without jumps.

    The play operator: it stays unless the motor's side is more than half the ``width`` away, and then is dragged
    along at that distance. It begins in the middle of the play.
    """
    end = motor.copy()
    for k in range(1, len(motor)):
        end[k] = min(max(end[k - 1], motor[k] - 0.5 * width), motor[k] + 0.5 * width)
    return end
