"""The path that heading and speeds describe, how it depends on what may be wrong, and positions without jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.quality.motion.series import Group, Motion, rotate, spline

Model = Callable[[Floats], tuple[Floats, Floats]]
"""Levels [points, m] on the grid (2 of position or 1 of heading) for p parameters, and their slopes [points, p, m].

The third parameter, the delay of the measured level, moves no model: its slope is what reading it later costs.
"""

_JUMP = 6.0
_RATE_WIDTH_S = 1.0
_MEAN_WIDTH_S = 5.0
_LEAST_JUMP = 0.05
_MOST_JUMPS = 0.6
_NORMAL_QUARTER = 0.3186  # a quarter of normal deviations is smaller: a scale that half of the steps cannot spoil
_ROUNDS = 12
_STIFFNESS = np.array([1.0, 1.0, 0.01, 0.01, 1e-4, 1e-4])


def path_model(motion: Motion, grid_s: Floats) -> Model:
    """The path by heading and speeds as a model of the positions; the speeds' stamps are the time."""
    heading_at, body = spline(motion.heading), spline(motion.speed)(grid_s)
    first, last = motion.heading.time_s[[0, -1]]
    width = max(_RATE_WIDTH_S, motion.heading.interval_s)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, offset, _, heading_late_s, forward, starboard = values
        times = np.clip(grid_s + heading_late_s, first + width, last - width)
        true = heading_at(times)[:, 0] - offset
        turning = (heading_at(times + width) - heading_at(times - width)) / (2.0 * width)
        moving = rotate(true, body)
        travelled = integral(grid_s, moving)
        ahead, aside = np.column_stack([np.cos(true), np.sin(true)]), np.column_stack([-np.sin(true), np.cos(true)])
        arm = forward * ahead + starboard * aside
        swung = turning * _quarter_turn(arm)
        bent = integral(grid_s, turning * factor * _quarter_turn(moving))
        by_offset = -factor * _quarter_turn(travelled) - _quarter_turn(arm)
        slopes = (travelled, by_offset, -factor * moving - swung, bent + swung, ahead, aside)
        return factor * travelled + arm, np.stack(slopes, axis=1)

    return model


def turn_model(motion: Motion, grid_s: Floats) -> Model:
    """The heading by the integrated yaw rate, whose stamps are the time; factor, bias and delay of the heading.

    The slope by the factor is the smoothed heading: unlike the integrated yaw rate it shares no noise with what
    is left, which would make the factor too small (an instrumental variable).
    """
    from scipy.ndimage import uniform_filter1d

    rate = spline(motion.yaw_rate)(grid_s)
    turned, elapsed = integral(grid_s, rate), (grid_s - grid_s[0])[:, np.newaxis]
    size = 2 * int(0.5 * _MEAN_WIDTH_S / motion.step_s) + 1
    smooth = uniform_filter1d(spline(motion.heading)(grid_s), size, axis=0)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, bias, _ = values
        slopes = (smooth / factor, elapsed, -factor * rate - bias)
        return factor * turned + bias * elapsed, np.stack(slopes, axis=1)

    return model


def remove_jumps(level: Group, model: Model, grid_s: Floats, values: Floats) -> Group:
    """Remove jumps of positions or headings, as they come from jittering stamps and clocks that are set.

    A step from one sample to the next is a jump where it differs from the model's by far more than the usual
    step does, and by a good part of the distance; the model's step takes its place. Where there are such steps at
    ``values`` [p], a robust regression on steps stands many of them where one on levels does not; it starts from
    ``values`` and from the most frequent ratio of measured to model's steps, and the tighter fit counts. Returns
    ``level`` itself where nothing, or nearly everything, jumps.
    """
    steps = _steps(level, model, grid_s, values)
    if not _jumps(steps).any():
        return level
    starts = (values, _most_frequent(steps, values))
    fits = [_robust_fit(level, model, grid_s, start) for start in starts]
    steps = min((_steps(level, model, grid_s, fit) for fit in fits), key=lambda each: float(_scale(each)[0]))
    jumps = _jumps(steps)
    if not jumps.any() or jumps.mean() > _MOST_JUMPS:
        return level
    around = jumps | np.append(jumps[1:], False) | np.append(False, jumps[:-1])
    removed = np.where(around[:, np.newaxis], _to_sample_frame(steps.angle, steps.error), 0.0)
    shift = np.vstack([np.zeros(removed.shape[1]), np.cumsum(removed, axis=0)])
    return Group(level.time_s, level.levels - shift, level.interval_s)


@dataclass(frozen=True, slots=True)
class _Steps:
    """From each sample to the next: ``error`` [n, m], of positions along and across the model's step, the
    model's ``slopes`` [n, p, m], how far it goes and, for positions, in which direction [n]."""

    error: Floats
    slopes: Floats
    distance: Floats
    angle: Floats


def _robust_fit(level: Group, model: Model, grid_s: Floats, values: Floats) -> Floats:
    """Robust regression on steps: redescending weights (Cauchy's, squared) with a tolerance that narrows."""
    for number in range(_ROUNDS):
        steps = _steps(level, model, grid_s, values)
        scale = _scale(steps)
        tolerance = scale * max(2.0, 6.0 * 0.7**number)
        weights = 1.0 / (1.0 + (steps.error / tolerance) ** 2) ** 2 / scale**2
        flat = (steps.slopes * weights[:, np.newaxis]).transpose(1, 0, 2).reshape(values.size, -1)
        matrix = flat @ steps.slopes.transpose(0, 2, 1).reshape(-1, values.size) + np.diag(
            _STIFFNESS[: values.size]
        )
        values = values + np.clip(np.linalg.solve(matrix, flat @ steps.error.ravel()), -4.0, 4.0)
    return values


def _most_frequent(steps: _Steps, values: Floats) -> Floats:
    """``values`` with factor and angle moved to where the quarter of the faster steps that agree best lies."""
    faster = steps.distance >= max(float(np.median(steps.distance)), 1e-6)
    ratios = np.sort(steps.error[faster] / steps.distance[faster, np.newaxis], axis=0)
    quarter = max(1, len(ratios) // 4)
    tightest = np.argmin(ratios[quarter:] - ratios[:-quarter], axis=0)
    middle = ratios[tightest + quarter // 2, np.arange(ratios.shape[1])]
    moved = np.zeros_like(values)
    moved[0], moved[1] = values[0] * (1.0 + middle[0]), values[1]
    if middle.size == 2:
        moved[1] -= middle[1]
    return moved


def _scale(steps: _Steps) -> Floats:
    return np.asarray(np.quantile(np.abs(steps.error), 0.25, axis=0) / _NORMAL_QUARTER + 1e-9)


def _jumps(steps: _Steps) -> NDArray[np.bool_]:
    limit = np.maximum(_JUMP * _scale(steps), _LEAST_JUMP * steps.distance[:, np.newaxis])
    return np.asarray((np.abs(steps.error) > limit).any(axis=1))


def _steps(level: Group, model: Model, grid_s: Floats, values: Floats) -> _Steps:
    wanted, slopes = model(values)
    both = np.concatenate([wanted[:, np.newaxis], slopes], axis=1)
    at = interpolate(level.time_s - values[2], grid_s, both.reshape(grid_s.size, -1))
    moves = np.diff(at.reshape(-1, *both.shape[1:]), axis=0)
    measured = np.diff(level.levels, axis=0)
    if measured.shape[1] == 1:
        forward = np.where(moves[:, 0, 0] < 0.0, -1.0, 1.0)
        error, moves = (measured - moves[:, 0]) * forward[:, np.newaxis], moves * forward[:, np.newaxis, np.newaxis]
        return _Steps(error, moves[:, 1:], np.abs(moves[:, 0, 0]), np.where(forward < 0.0, np.pi, 0.0))
    angle = np.arctan2(moves[:, 0, 1], moves[:, 0, 0])
    body = np.stack([rotate(-angle, moves[:, each]) for each in range(moves.shape[1])], axis=1)
    return _Steps(rotate(-angle, measured) - body[:, 0], body[:, 1:], np.hypot(*moves[:, 0].T), angle)


def _to_sample_frame(angle: Floats, errors: Floats) -> Floats:
    """Errors [n, m] back in the frame of the samples."""
    return rotate(angle, errors) if errors.shape[1] == 2 else errors * np.cos(angle)[:, np.newaxis]


def interpolate(time_s: Floats, grid_s: Floats, columns: Floats) -> Floats:
    """Columns [points, m] on the even grid, linearly at other times."""
    place = np.clip((time_s - grid_s[0]) / (grid_s[1] - grid_s[0]), 0.0, grid_s.size - 1.000001)
    before = place.astype(np.int64)
    share = (place - before)[:, np.newaxis]
    return np.asarray(columns[before] * (1.0 - share) + columns[before + 1] * share)


def integral(grid_s: Floats, rates: Floats) -> Floats:
    """Rates [points, ...] integrated from the first point, by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(grid_s, rates).antiderivative()(grid_s))


def _quarter_turn(vectors: Floats) -> Floats:
    """Vectors [n, 2] north and east turned by +90 deg: the change by a turn of one radian."""
    return np.column_stack([-vectors[:, 1], vectors[:, 0]])
