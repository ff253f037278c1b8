"""What the columns of a table say of each other: factors and signs by which speeds, rates and angles fit the track.

Increments of position and heading are compared with integrals of speeds and rates between the same instants, so
that noise and delays matter little. Nothing here decides; :mod:`acquisition.tables.channel_columns` does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Bools, Floats

_STEP_S = 5.0  # long against a receiver's noise and delay, short against a turn
_STEP_ROWS = 2.0
_FEWEST = 8
_OUTLYING = 6.0
_MOST = 5000
_WIND_STEPS = 6  # half a minute: a ship turns meanwhile, the wind keeps


@dataclass(frozen=True, slots=True)
class Fit:
    """The factor that takes one series to another, their correlation, and how many increments they have."""

    factor: float
    correlation: float
    count: int

    @property
    def is_clear(self) -> bool:
        """Whether it says anything."""
        return self.count >= _FEWEST and abs(self.correlation) > 0.7


def grid_of(seconds: Floats) -> Floats:
    """Instants [s] between which increments are compared: 5 s apart, or two rows of a slower table."""
    there = seconds[np.isfinite(seconds)]
    if there.size < _FEWEST:
        return np.empty(0)
    usual = float(np.median(np.diff(np.unique(there)))) if np.unique(there).size > 1 else _STEP_S
    step = max(_STEP_S, _STEP_ROWS * usual, float(np.ptp(there)) / _MOST)
    return np.arange(there.min(), there.max() + 1e-9, step)


def increments(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """By how much a series grows between the instants of the grid."""
    there = _usable(seconds, values)
    return (
        np.diff(np.interp(grid, seconds[there], values[there]))
        if there.sum() > 1
        else np.full(grid.size - 1, np.nan)
    )


def integrals(seconds: Floats, rates: Floats, grid: Floats) -> Floats:
    """What a rate adds up to between the instants of the grid, by trapezoids."""
    there = _usable(seconds, rates)
    t, r = seconds[there], rates[there]
    if t.size < 2:
        return np.full(grid.size - 1, np.nan)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (r[1:] + r[:-1]) * np.diff(t))])
    return np.diff(np.interp(grid, t, total))


def means(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """The mean of a series between the instants of the grid."""
    return integrals(seconds, values, grid) / np.diff(grid) if grid.size > 1 else np.empty(0)


def fit(measured: Floats, told: Floats) -> Fit:
    """The factor k of least squares in ``measured = k told``, of the increments that are no outliers.

    Outliers are further than six median residuals from the line of the median ratio: jumps and angles that were
    interpolated through north.
    """
    there = np.isfinite(measured) & np.isfinite(told)
    x, y = told[there], measured[there]
    large = np.abs(x) > np.median(np.abs(x)) if x.size else np.zeros(0, np.bool_)
    if large.any():
        residuals = np.abs(y - float(np.median(y[large] / x[large])) * x)
        kept = residuals <= _OUTLYING * np.median(residuals) + 1e-12 * np.max(np.abs(y))
        x, y = x[kept], y[kept]
    power = float(np.sqrt(np.sum(x * x) * np.sum(y * y)))
    if x.size < _FEWEST or power == 0.0:
        return Fit(np.nan, 0.0, x.size)
    return Fit(float(np.sum(x * y) / np.sum(x * x)), float(np.sum(x * y)) / power, x.size)


def agreement(north: Floats, east: Floats, direction_deg: Floats) -> float:
    """How far displacements [n] point where angles say, weighed by length: 1 along them, 0 anyhow, -1 against."""
    length = np.hypot(north, east)
    along = north * np.cos(np.deg2rad(direction_deg)) + east * np.sin(np.deg2rad(direction_deg))
    there = np.isfinite(along)
    total = float(length[there].sum())
    return float(along[there].sum()) / total if there.sum() >= _FEWEST and total > 0.0 else 0.0


def restlessness(seconds: Floats, vector: np.ndarray, grid: Floats) -> float:
    """The mean square by which a complex series changes over six intervals of the grid, half a minute."""
    parts = [means(seconds, part, grid) for part in (np.real(vector), np.imag(vector))]
    whole = parts[0] + 1j * parts[1]
    steps = whole[_WIND_STEPS:] - whole[:-_WIND_STEPS]
    steps = steps[np.isfinite(steps)]
    return float(np.mean(np.abs(steps) ** 2)) if steps.size >= _FEWEST else np.nan


def _usable(seconds: Floats, values: Floats) -> Bools:
    there = np.isfinite(seconds) & np.isfinite(values)
    latest = np.maximum.accumulate(np.where(there, seconds, -np.inf))
    forward = np.concatenate([[True], latest[1:] > latest[:-1]])
    return np.asarray(there & forward)
