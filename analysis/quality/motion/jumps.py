"""Positions that jump: from one sample to the next the error about the fitted path steps, and stays there.

A jump stands far out of what the medians of neighbouring stretches differ by elsewhere, and happens at once, or
nearly so. Where stamps are missing or crowd, the clock may have been set, which is not said here; samples that
repeat are stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from analysis.quality.motion.jitter import position_errors
from analysis.quality.motion.kinematics import Kinematics
from analysis.quality.motion.series import Group

_STRETCH_S = 5.0
_FEWEST = 4
_MOST = 20
_THIN_S = 0.5
_SIGMAS = 10.0
_USUAL = 3.0  # times what 95 % of the stretches differ by
_SMALLEST_M = 1.0
_AT_ONCE = 0.7  # of a jump happens within the time below: filters and interpolation make a short ramp of it
_AT_ONCE_S = 2.5
_RETURNED = 0.3
_LONGEST_AWAY = 0.1  # of the recording
_STUCK_S = 3.0


@dataclass(frozen=True, slots=True)
class PositionJump:
    """When [s from the table's first row] positions jump, by how much north and east [m], and when they return,
    NaN if they do not."""

    time_s: float
    north_m: float
    east_m: float
    until_s: float

    @property
    def metres(self) -> float:
        return float(np.hypot(self.north_m, self.east_m))

    @property
    def returns(self) -> bool:
        return bool(np.isfinite(self.until_s))


def position_jumps(table: pd.DataFrame, fit: Kinematics) -> tuple[PositionJump, ...]:
    """The jumps of the positions in a table about the motion that was fitted to it."""
    errors = position_errors(table, fit)
    sound = ~_stuck(errors.raw, fit.motion.position.interval_s)
    time_s, error = errors.time_s[sound], errors.error[sound]
    thin = max(1, round(_THIN_S / fit.motion.position.interval_s)) if time_s.size else 1
    time_s, error = time_s[::thin], error[::thin]
    if time_s.size < 4 * _MOST:
        return ()
    interval_s = float(np.median(np.diff(time_s)))
    width = int(np.clip(_STRETCH_S / max(interval_s, 1e-3), _FEWEST, _MOST))
    places, sizes = _steps(error, width, interval_s)
    known = [place for place in places if _seen(time_s, place, width, interval_s, fit)]
    return _paired([(float(time_s[place] + fit.parameters[2]), sizes[place]) for place in known], np.ptp(time_s))


def _steps(error: Floats, width: int, interval_s: float) -> tuple[list[int], dict[int, Floats]]:
    """First samples after a jump, and its size."""
    medians = np.median(sliding_window_view(error, width, axis=0), axis=-1)
    apart = medians[width:] - medians[:-width]  # row r is about the step to sample r + width
    size = np.hypot(*apart.T)
    limit = max(_SIGMAS * float(np.median(size)), _USUAL * float(np.quantile(size, 0.95)), _SMALLEST_M)
    places = np.arange(width, width + len(apart))
    half = max(1, round(0.5 * _AT_ONCE_S / interval_s))
    after, before = np.minimum(places + half - 1, len(error) - 1), np.maximum(places - half, 0)
    toward = apart / np.maximum(size, 1e-12)[:, np.newaxis]
    along = np.einsum("ij,ij->i", error[after] - error[before], toward)
    at_once = np.einsum("ij,ij->i", error[places] - error[places - 1], toward)
    rows = np.flatnonzero((size > limit) & (along > _AT_ONCE * size))
    groups = np.split(rows, np.flatnonzero(np.diff(rows) > width) + 1) if rows.size else []
    best = [int(group[np.argmax(at_once[group])]) for group in groups]
    return [each + width for each in best], {each + width: apart[each] for each in best}


def _seen(time_s: Floats, place: int, width: int, interval_s: float, fit: Kinematics) -> bool:
    """Whether the motion about a step was recorded throughout and its stamps do not crowd."""
    begin, end = time_s[place - 1], time_s[place]
    around = time_s[min(place + width, time_s.size - 1)] - time_s[max(place - width, 0)]
    samples = min(place + width, time_s.size - 1) - max(place - width, 0)
    if around < 0.8 * samples * interval_s:
        return False
    return all(_recorded(each, begin, end) for each in (fit.motion.speed, fit.motion.heading))


def _recorded(samples: Group, begin: float, end: float) -> bool:
    first, last = np.searchsorted(samples.time_s, [begin, end], side="left")
    inside = samples.time_s[max(first - 1, 0) : last + 1]
    return bool(inside.size > 1 and np.diff(inside).max() < 1.8 * samples.interval_s)


def _paired(jumps: list[tuple[float, Floats]], lasts_s: float) -> tuple[PositionJump, ...]:
    """Jumps, and where the next takes one back, both as one."""
    found: list[PositionJump] = []
    skip = False
    for number, (time_s, size) in enumerate(jumps):
        if skip:
            skip = False
            continue
        until_s = np.nan
        if number + 1 < len(jumps):
            next_s, back = jumps[number + 1]
            skip = bool(np.hypot(*(size + back)) < _RETURNED * np.hypot(*size))
            skip = skip and next_s - time_s < _LONGEST_AWAY * lasts_s
            until_s = next_s if skip else np.nan
        found.append(PositionJump(time_s, float(size[0]), float(size[1]), float(until_s)))
    return tuple(found)


def _stuck(raw: Floats, interval_s: float) -> Bools:
    """Samples of which a coordinate has not changed for long: they do not jump, they stand."""
    stuck = np.zeros(len(raw), dtype=bool)
    for column in raw.T:
        new: NDArray[np.int64] = np.flatnonzero(np.append(True, np.diff(column) != 0.0))
        runs = np.diff(np.append(new, column.size))
        stuck |= np.repeat(runs * interval_s > _STUCK_S, runs)
    return stuck
