"""Predicted tracks as motion: heading, surge, sway, yaw rate and speed at every second, to lay beside the
channels."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.angles import wrap_360
from acquisition.core.arrays import Floats
from analysis.tables.time_index import NANO, index_of
from hybrid.prediction.prediction_windows import PredictionWindows, in_ship_axes

COLUMNS = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps", "speed_mps")


def speeds_of(track: Floats) -> Floats:
    """Surge, sway [m/s], yaw rate [rad/s] and speed over ground [m/s] of tracks [N, H+1, 3]: [N, H+1, 4].

    Central differences over two seconds, one-sided ones at the ends.
    """
    slope = np.gradient(track, axis=1)
    north, east = slope[..., 0], slope[..., 1]
    surge, sway = in_ship_axes(north, east, track[..., 2])
    return np.stack([surge, sway, slope[..., 2], np.hypot(north, east)], axis=-1)


def one_after_another(horizons: PredictionWindows) -> NDArray[np.int64]:
    """Windows that follow each other without an overlap, as many as fit, in the order of time."""
    start_ns = horizons.start_time.as_unit("ns").asi8
    chosen, until_ns, trial = [], -1, ""
    for number in np.lexsort((start_ns, horizons.trial)):
        if horizons.trial[number] != trial:
            until_ns, trial = -1, horizons.trial[number]
        if start_ns[number] >= until_ns:
            chosen.append(int(number))
            until_ns = int(start_ns[number]) + horizons.horizon_s * NANO
    return np.array(chosen, dtype=np.int64)


def predicted_motion(horizons: PredictionWindows, tracks: Floats, chosen: NDArray[np.int64]) -> pd.DataFrame:
    """The motion that tracks [N, H+1, 3] predict in the ``chosen`` windows, a row a window and second.

    Columns :data:`COLUMNS` in the units of the channels and ``window``; the index is UTC.
    """
    some = tracks[chosen]
    speeds = speeds_of(some)
    seconds = np.arange(some.shape[1]) * NANO
    times = horizons.start_time.as_unit("ns").asi8[chosen][:, None] + seconds
    values = np.concatenate([some, speeds], axis=-1).reshape(-1, 7)
    values[:, 2] = wrap_360(np.rad2deg(values[:, 2]))
    values[:, 5] = np.rad2deg(values[:, 5])
    table = pd.DataFrame(values, index=index_of(times.ravel()), columns=list(COLUMNS))
    return table.assign(window=np.repeat(chosen, some.shape[1]))
