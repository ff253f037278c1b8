"""Stamps of headings that jitter: the heading scatters about the integrated yaw rate in proportion to the rate.

A ship's inertia keeps her yaw rate smooth, and noise of compass and gyro is the same whether she turns or not. The
variance that grows with the square of the yaw rate is therefore that of the stamps. Each stretch of time counts for
itself, about its own straight line and, within what is known of such sensors, its own scale and delay; the interval
comes from leaving out one stretch after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.quality.kinematic_jitter import Jitter
from analysis.quality.kinematic_path import turn_model
from analysis.quality.kinematic_series import Bools, Floats
from analysis.quality.kinematics import Kinematics

SMALLEST_S = 0.1
"""Jitter below this is nothing to care about: a quarter of a degree in a hard turn."""
_SHORT_S = 30.0
_LONG_S = 120.0
_FEWEST_SAMPLES = 8
_FEWEST_STRETCHES = 5
_PRIOR = np.array([np.inf, np.inf, 0.05, 0.3])
"""How far the line, the scale and the delay [s] of one stretch may be from those of the whole recording."""
_LARGEST_STAMP_ERROR_S = 3.0
_LEAP = 10.0


@dataclass(frozen=True, slots=True)
class HeadingErrors:
    """Of each heading: when [s], by how much it differs from the integrated yaw rate [rad], how far she has turned
    by then [rad] and how fast she turns [rad/s], all of shape [n]; the step that headings are rounded to [rad]."""

    time_s: Floats
    error: Floats
    turned: Floats
    rate: Floats
    step: float


def heading_jitter(fit: Kinematics) -> Jitter:
    """The jitter of the headings about the turns that were fitted to them.

    As :func:`analysis.quality.kinematic_jitter.stamp_jitter` does for positions: short stretches say whether, and
    stretches of 60 and 120 s, in the limit of long ones, how much.
    """
    return jitter_of(heading_errors(fit))


def jitter_of(errors: HeadingErrors) -> Jitter:
    """The part of errors that grows with the yaw rate, as that of stamps."""
    short, half, long = (_sums(errors, seconds) for seconds in (_SHORT_S, 0.5 * _LONG_S, _LONG_S))
    if min(long.usable.sum(), short.usable.sum()) < _FEWEST_STRETCHES:
        return Jitter()
    halves = np.pad(half.squares, (0, 2 * long.count.size - half.count.size)).reshape(-1, 2).sum(axis=1)
    least = errors.step**2 / 12.0
    limit = _growth(long, 2.0 * long.squares - halves, least)
    growth = _growth(short, short.squares, least)
    surplus = growth.variance_s2 / max(growth.standard_error_s2, 1e-12)
    return Jitter(
        limit.variance_s2, limit.standard_error_s2, limit.telling, surplus, growth.telling, growth.ratio
    )  # fmt: skip


def heading_errors(fit: Kinematics) -> HeadingErrors:
    """By how much the cleaned headings differ from the yaw rate as it was fitted, and integrated."""
    heading = fit.motion.heading
    turned, rate = turned_at(fit, heading.time_s)
    error = heading.levels[:, 0] - turned
    steps = np.abs(np.diff(heading.levels[:, 0]))
    moved = steps[steps > 1e-7]
    return HeadingErrors(heading.time_s, error, turned, rate, float(moved.min()) if moved.size else 0.0)


def turned_at(fit: Kinematics, heading_time_s: Floats) -> tuple[Floats, Floats]:
    """What a heading with these stamps should read but for a constant [rad], and the yaw rate then [rad/s].

    From the recorded yaw rate with the factor, the bias and the delay between the two that were fitted.
    """
    from scipy.interpolate import CubicSpline

    rate, parameters = fit.motion.yaw_rate, fit.parameters[6:]
    grid_s = np.arange(rate.time_s[0], rate.time_s[-1], fit.motion.step_s)
    turned, slopes = turn_model(fit.motion, grid_s)(parameters)
    times = np.clip(heading_time_s - parameters[2], grid_s[0], grid_s[-1])
    both = CubicSpline(grid_s, np.column_stack([turned[:, 0], -slopes[:, 2, 0]]))(times)
    return both[:, 0], both[:, 1]


def leaps(error: Floats, rate: Floats) -> Bools:
    """Where headings part from the integrated yaw rate for good, as at a splice: [n - 1], steps that no stamp error
    of 3 s and no noise explains."""
    steps = np.abs(np.diff(error))
    turning = np.maximum(np.abs(rate[1:]), np.abs(rate[:-1]))
    noise = 1.4826 * float(np.median(steps)) if steps.size else 0.0
    return np.asarray(steps > _LARGEST_STAMP_ERROR_S * turning + _LEAP * noise)


@dataclass(frozen=True, slots=True)
class _Sums:
    """By stretch [k]: how many samples, the sums of squares of yaw rate and of what is left of the headings, and
    whether there are samples enough and no breaks."""

    count: Floats
    moved: Floats
    squares: Floats
    usable: Bools


def _sums(errors: HeadingErrors, seconds: float) -> _Sums:
    stretch = (errors.time_s // seconds).astype(np.int64)
    count = np.bincount(stretch).astype(float)
    broken = np.bincount(stretch[1:], leaps(errors.error, errors.rate), count.size) > 0
    usable = ~broken & (count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0]))))
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    columns = np.column_stack([np.ones(stretch.size), errors.time_s, errors.turned, errors.rate])
    noise2 = _line_noise2(errors)
    squares = np.zeros(count.size)
    for each in np.flatnonzero(usable):
        within = slice(ends[each], ends[each + 1])
        squares[each] = _left(columns[within], errors.error[within], noise2)
    return _Sums(count, np.bincount(stretch, errors.rate**2).astype(float), squares, usable)


def _line_noise2(errors: HeadingErrors) -> float:
    """The usual variance about straight lines from one sample to the second next [rad2]."""
    bends = errors.error[1:-1] - 0.5 * (errors.error[2:] + errors.error[:-2])
    return float(max((1.4826 * np.median(np.abs(bends))) ** 2 / 1.5, 1e-12))


def _left(columns: Floats, error: Floats, noise2: float) -> float:
    """The sum of squares about the line, scale and delay of a stretch, as large as if they were known."""
    columns = columns - np.concatenate([[0.0], columns[:, 1:].mean(axis=0)])
    normal = columns.T @ columns + np.diag(noise2 / _PRIOR**2)
    solution = np.linalg.solve(normal, columns.T)
    free = error.size - float(np.sum(columns * solution.T))
    left = error - columns @ (solution @ error)
    return float(left @ left * error.size / max(free, 1.0))


@dataclass(frozen=True, slots=True)
class _Growth:
    """The variance [s2] that goes with the square of the yaw rate, its standard error, how many stretches tell it,
    and how many times the variance without turning there is in turns."""

    variance_s2: float
    standard_error_s2: float
    telling: float
    ratio: float


def _growth(sums: _Sums, squares: Floats, least: float) -> _Growth:
    """A straight line through the mean squares against the mean squared yaw rates, by least squares.

    ``least`` is the variance of rounding: a steady heading that always reads the same seems to have none.
    """
    turning = (sums.moved / np.maximum(sums.count, 1.0))[sums.usable]
    squared = (squares / np.maximum(sums.count, 1.0))[sums.usable]
    every = np.ones(turning.size, np.bool_)
    slope, still = _line(turning, squared, least, every)
    without = np.array([_line(turning, squared, least, every & (np.arange(every.size) != each))[0]
                        for each in range(every.size)])  # fmt: skip
    error = np.sqrt((every.size - 1) / every.size * ((without - without.mean()) ** 2).sum())
    lever = (turning - turning.mean()) ** 2
    telling = lever.sum() ** 2 / max(float((lever**2).sum()), 1e-300)
    typical = float((turning**2).sum() / max(float(turning.sum()), 1e-300))
    return _Growth(slope, float(error), float(telling), 1.0 + slope * typical / max(still, 1e-300))


def _line(turning: Floats, squared: Floats, least: float, taken: NDArray[np.bool_]) -> tuple[float, float]:
    """Slope and value without turning, which is ``least`` at least."""
    x, y = turning[taken], squared[taken]
    off = x - x.mean()
    slope = float(off @ y / max(float(off @ off), 1e-300))
    still = float(y.mean() - slope * x.mean())
    if still < least:
        still = least
        slope = float(x @ (y - least) / max(float(x @ x), 1e-300))
    return slope, still
