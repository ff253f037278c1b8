"""Stamps of positions that jitter: the position errs along the way the ship goes, in proportion to her speed.

Noise of the positions errs across as much as along, so the variance along less that across, by the square of the
speed, is the variance of the stamps. Each stretch of time counts for itself, about its own straight line; the
interval comes from leaving out one stretch after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.quality.kinematic_path import interpolated, path_model
from analysis.quality.kinematic_series import GROUPS, Floats, isolated, rotated, samples_of
from analysis.quality.kinematics import Kinematics, quantile

_STRETCH_S = 30.0
_FEWEST_SAMPLES = 8
_FEWEST_STRETCHES = 5
_BROKEN = 30.0


@dataclass(frozen=True, slots=True)
class Jitter:
    """Variance of the stamps [s2] with its standard error, and how many times it makes along exceed across."""

    variance_s2: float
    standard_error_s2: float
    excess: float
    stretches: float

    @property
    def seconds(self) -> float:
        return float(np.sqrt(max(self.variance_s2, 0.0)))

    def interval(self, probability: float = 0.95) -> tuple[float, float]:
        """Of the standard deviation [s]."""
        half = quantile(0.5 + 0.5 * probability, self.stretches) * self.standard_error_s2
        low, high = np.sqrt(np.maximum([self.variance_s2 - half, self.variance_s2 + half], 0.0))
        return float(low), float(high)


def stamp_jitter(table: pd.DataFrame, fit: Kinematics) -> Jitter:
    """The jitter of the positions in a table about the motion that was fitted to it."""
    along, across, speed, stretch = _errors(table, fit)
    count = np.bincount(stretch)
    moved, ahead, aside = (np.bincount(stretch, each**2) for each in (speed, along, across))
    usable = count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0])))
    size = (ahead + aside) / np.maximum(count, 1)
    usable &= size <= _BROKEN * np.median(size[usable]) if usable.any() else usable
    if usable.sum() < _FEWEST_STRETCHES or not moved[usable].sum() > 0.0:
        return Jitter(0.0, np.inf, 0.0, 0.0)
    ratio = ahead[usable].sum() / max(float(aside[usable].sum()), 1e-12)
    return _of_stretches(
        np.asarray(ahead - aside, dtype=float)[usable], np.asarray(moved, dtype=float)[usable], ratio
    )


def _of_stretches(excess_m2: Floats, moved_m2: Floats, ratio: float) -> Jitter:
    count, total, base = excess_m2.size, excess_m2.sum(), moved_m2.sum()
    without = (total - excess_m2) / np.maximum(base - moved_m2, 1e-12)
    error = np.sqrt((count - 1) / count * ((without - without.mean()) ** 2).sum())
    telling = base**2 / (moved_m2**2).sum()
    return Jitter(float(total / base), float(error), float(ratio), float(telling))


def _errors(table: pd.DataFrame, fit: Kinematics) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Errors along and across the way [m], speed [m/s] and number of the stretch, of each raw position."""
    motion, values = fit.motion, fit.parameters[:6]
    grid_s = np.arange(motion.speed.time_s[0], motion.speed.time_s[-1], motion.step_s)
    path, slopes = path_model(motion, grid_s)(values)
    raw = samples_of(table, GROUPS["north_m"])
    within = (raw.time_s - values[2] >= grid_s[0]) & (raw.time_s - values[2] <= grid_s[-1])
    time_s = raw.time_s[within]
    at = interpolated(time_s - values[2], grid_s, np.hstack([path, -slopes[:, 2]]))
    error = raw.levels[within] - at[:, :2]
    sound = ~isolated(error)
    stretch = (time_s[sound] // _STRETCH_S).astype(np.int64)
    left = np.column_stack([_about_lines(column, stretch) for column in error[sound].T])
    body = rotated(-np.arctan2(at[sound, 3], at[sound, 2]), left)
    return body[:, 0], body[:, 1], np.hypot(at[sound, 2], at[sound, 3]), stretch


def _about_lines(values: Floats, stretch: NDArray[np.int64]) -> Floats:
    """What is left about the straight line of each stretch, as large as if the line were known."""
    place = np.arange(values.size, dtype=float)
    count = np.bincount(stretch)
    some = np.maximum(count, 1)
    place -= (np.bincount(stretch, place) / some)[stretch]
    values = values - (np.bincount(stretch, values) / some)[stretch]
    slope = np.bincount(stretch, place * values) / np.maximum(np.bincount(stretch, place**2), 1e-12)
    return np.asarray((values - slope[stretch] * place) * np.sqrt(some / np.maximum(count - 2, 1))[stretch])
