"""Positions whose time stamps jitter, and positions that jump.

Jitter: with wrong stamps a position errs along the track, in proportion to the ship's speed; noise of the
positions errs across as much as along. So the variance along less that across, over the square of the speed, is
the variance of the stamps. Each stretch of time counts for itself, about its own straight line; the interval
comes from a jackknife over stretches.

Jump: from one sample to the next the error about the fitted path steps, and stays there. A jump exceeds by far
what the medians of neighbouring stretches differ by elsewhere, and happens at once, or nearly so. Where stamps
are missing or crowd, the clock may have been set, which is reported elsewhere; samples that repeat are stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from analysis.quality.motion.kinematics import CHANCE, Kinematics, quantile
from analysis.quality.motion.path import interpolate, path_model
from analysis.quality.motion.series import GROUPS, Group, group_samples, outliers, rotate
from analysis.quality.samples import jackknife_error, runs_of_equal

_SHORT_S = 30.0
_LONG_S = 120.0
_FEWEST_SAMPLES = 8
_FEWEST_STRETCHES = 5
_BROKEN = 30.0
_LEAST_RATIO = 2.0
_LEFT_OVER = 0.06  # of the variance: what is beyond the limit taken


@dataclass(frozen=True, slots=True)
class Jitter:
    """Variance of the stamps [s2] with its standard error and the effective number of stretches.

    ``surplus`` is by how many of its standard errors the variance that jitter makes exceeds the one that it does
    not (of positions along and across the way, of headings with and without turning) in short stretches, whose
    many tell it best, and ``ratio`` the one over the other.
    """

    variance_s2: float = 0.0
    standard_error_s2: float = np.inf
    stretches: float = 0.0
    surplus: float = 0.0
    surplus_stretches: float = 0.0
    ratio: float = 0.0

    @property
    def seconds(self) -> float:
        return float(np.sqrt(max(self.variance_s2, 0.0)))

    def beyond(self, smallest_s: float, chance: float = CHANCE) -> bool:
        """Whether it is at least ``smallest_s`` and significant at ``chance``."""
        surely = self.surplus > quantile(1.0 - chance, self.surplus_stretches)
        return surely and self.seconds >= smallest_s and self.ratio >= _LEAST_RATIO

    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the standard deviation [s]."""
        error = np.hypot(self.standard_error_s2, _LEFT_OVER * self.variance_s2)
        half = quantile(0.975, self.stretches) * error
        low, high = np.sqrt(np.maximum([self.variance_s2 - half, self.variance_s2 + half], 0.0))
        return float(low), float(high)


@dataclass(frozen=True, slots=True)
class PositionErrors:
    """Of each raw position: when [s], by how much north and east [n, 2], the velocity of the ship [n, 2] and the
    position itself [n, 2]."""

    time_s: Floats
    error: Floats
    velocity: Floats
    raw: Floats


def stamp_jitter(table: pd.DataFrame, fit: Kinematics) -> Jitter:
    """The jitter of the positions in a table about the motion that was fitted to it.

    The line of a stretch takes some of a jitter that lasts for seconds away with it, by as much as the stretch is
    short: the size is what stretches of 60 and 120 s lead to in the limit of long ones.
    """
    errors = position_errors(table, fit)
    short, *halves = (_sums(errors, seconds) for seconds in (_SHORT_S, 0.5 * _LONG_S))
    long = _sums(errors, _LONG_S)
    usable, enough = _usable(long), _usable(short)
    if usable.sum() < _FEWEST_STRETCHES or not long[1][usable].sum() > 0.0:
        return Jitter()
    half = halves[0][2] - halves[0][3]
    half = np.pad(half, (0, 2 * len(usable) - len(half))).reshape(-1, 2).sum(axis=1)
    size = _of_stretches((2.0 * (long[2] - long[3]) - half)[usable], long[1][usable])
    variance, error, telling = _of_stretches((short[2] - short[3])[enough], short[1][enough])
    ratio = short[2][enough].sum() / max(float(short[3][enough].sum()), 1e-12)
    return Jitter(*size, variance / max(error, 1e-12), telling, float(ratio))


Sums = tuple[Floats, Floats, Floats, Floats]
"""For each stretch: samples, and sums of squares of speed, of errors along and of errors across the way."""


def _sums(errors: PositionErrors, seconds: float) -> Sums:
    stretch = (errors.time_s // seconds).astype(np.int64)
    left = np.column_stack([_about_lines(column, stretch) for column in errors.error.T])
    body = rotate(-np.arctan2(errors.velocity[:, 1], errors.velocity[:, 0]), left)
    speed2 = (errors.velocity**2).sum(axis=1)
    count, moved, along, across = (
        np.bincount(stretch, each).astype(float) for each in (np.ones(stretch.size), speed2, *(body**2).T)
    )
    return count, moved, along, across


def _usable(sums: Sums) -> NDArray[np.bool_]:
    """Stretches with samples enough and without breaks."""
    count, _, along, across = sums
    usable = count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0])))
    size = (along + across) / np.maximum(count, 1)
    return np.asarray(usable & (size <= _BROKEN * np.median(size[usable])) if usable.any() else usable)


def _of_stretches(excess_m2: Floats, moved_m2: Floats) -> tuple[float, float, float]:
    """The ratio of sums, its standard error by a jackknife, and the effective number of stretches."""
    total, base = excess_m2.sum(), moved_m2.sum()
    without = (total - excess_m2) / np.maximum(base - moved_m2, 1e-12)
    return float(total / base), float(jackknife_error(without)), float(base**2 / (moved_m2**2).sum())


def position_errors(table: pd.DataFrame, fit: Kinematics) -> PositionErrors:
    """Errors of the raw positions about the fitted path, without outliers."""
    motion, parameters = fit.motion, fit.parameters[:6]
    grid_s = np.arange(motion.speed.time_s[0], motion.speed.time_s[-1], motion.step_s)
    path, slopes = path_model(motion, grid_s)(parameters)
    raw = group_samples(table, GROUPS["north_m"])
    times = raw.time_s - parameters[2]
    within = (times >= grid_s[0]) & (times <= grid_s[-1])
    at = interpolate(times[within], grid_s, np.hstack([path, -slopes[:, 2]]))
    error = raw.levels[within] - at[:, :2]
    sound = ~outliers(error)
    return PositionErrors(times[within][sound], error[sound], at[sound, 2:], raw.levels[within][sound])


def _about_lines(values: Floats, stretch: NDArray[np.int64]) -> Floats:
    """Residuals about the straight line of each stretch, scaled for the two degrees of freedom that it takes."""
    place = np.arange(values.size, dtype=float)
    count = np.bincount(stretch)
    some = np.maximum(count, 1)
    place -= (np.bincount(stretch, place) / some)[stretch]
    values = values - (np.bincount(stretch, values) / some)[stretch]
    slope = np.bincount(stretch, place * values) / np.maximum(np.bincount(stretch, place**2), 1e-12)
    return np.asarray((values - slope[stretch] * place) * np.sqrt(some / np.maximum(count - 2, 1))[stretch])


_JUMP_STRETCH_S = 5.0
_FEWEST_IN_STRETCH = 4
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
    width = int(np.clip(_JUMP_STRETCH_S / max(interval_s, 1e-3), _FEWEST_IN_STRETCH, _MOST))
    places, sizes = _steps(error, width, interval_s)
    known = [place for place in places if _recorded_throughout(time_s, place, width, interval_s, fit)]
    return _pair_returns(
        [(float(time_s[place] + fit.parameters[2]), sizes[place]) for place in known], np.ptp(time_s)
    )


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


def _recorded_throughout(time_s: Floats, place: int, width: int, interval_s: float, fit: Kinematics) -> bool:
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


def _pair_returns(jumps: list[tuple[float, Floats]], lasts_s: float) -> tuple[PositionJump, ...]:
    """Join a jump and the next one where that takes it back."""
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
    """Samples of which a coordinate has not changed for 3 s: they are stuck, and what follows is no jump."""
    stuck = np.zeros(len(raw), dtype=bool)
    for column in raw.T:
        _, lengths = runs_of_equal(np.diff(column) != 0.0)
        stuck |= np.repeat(lengths * interval_s > _STUCK_S, lengths)
    return stuck
