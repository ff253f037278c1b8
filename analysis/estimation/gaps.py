"""Where a smoothed motion would be a guess: inside long gaps of the samples."""

from __future__ import annotations

import numpy as np
import pandas as pd

from acquisition.core.arrays import Bools, Floats
from analysis.estimation.motion_model import HEADING, YAW_RATE, motion_values
from analysis.tables.resample import own_gap_s
from analysis.tables.time_index import NANO, times_ns

_GAP_S, _LONGEST_GAP_S, _GAP_INTERVALS = 3.0, 10.0, 2.5
_OTHERS = [2, 3, 4, 5]  # position and speeds


def in_gaps(table: pd.DataFrame, epoch_ns: int, grid_s: Floats, longest_gap_s: float | None) -> Bools:
    """Which grid points [rows] lie in a gap of the heading's channels or of the others, or outside them.

    A gap is longer than ``longest_gap_s``; without it, than 2.5 intervals, but at least 3 s and at most 10 s.
    """
    there = np.isfinite(motion_values(table))
    times_s = (times_ns(table) - epoch_ns) / NANO
    hidden = np.zeros(grid_s.size, dtype=bool)
    for channels in ([HEADING, YAW_RATE], _OTHERS):
        hidden |= _beyond(np.unique(times_s[there[:, channels].any(axis=1)]), grid_s, longest_gap_s)
    return hidden


def _beyond(samples_s: Floats, grid_s: Floats, longest_gap_s: float | None) -> Bools:
    interval_s = float(np.median(np.diff(samples_s))) if samples_s.size > 1 else 0.0
    limit_s = own_gap_s(interval_s * NANO) if longest_gap_s is None else longest_gap_s
    before = np.searchsorted(samples_s, grid_s + 1e-6, side="right") - 1
    after = np.minimum(before + 1, samples_s.size - 1)
    on_sample = np.abs(grid_s - samples_s[np.maximum(before, 0)]) <= 1e-6
    span = np.where((after > before) & (before >= 0), samples_s[after] - samples_s[np.maximum(before, 0)], np.inf)
    return np.asarray(~on_sample & (span > limit_s))
