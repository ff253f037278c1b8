"""Jumps of positions and headings: taken out of what is fitted, and the positions' found and sized.

A level jumps as stamps jitter and clocks are set: from one sample to the next it steps by far more than the model.
Of positions a jump also stays: the error about the fitted path steps by far more than the medians of neighbouring
stretches differ by elsewhere, and at once, or nearly so. Where stamps are missing or crowd, the clock may have been
set, which is reported elsewhere; samples that repeat are stuck.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.series import (
    GROUPS,
    Group,
    Model,
    group_samples,
    interpolate,
    outliers,
    path_model,
    rotate,
)
from seatrial.analysis.quality.samples import runs_of_equal
from seatrial.analysis.tables.table import NANO, seconds_of, utc_index

if TYPE_CHECKING:
    from seatrial.analysis.quality.motion.kinematics import Kinematics

_JUMP = 6.0
_LEAST_JUMP = 0.05
_MOST_JUMPS = 0.6
_NORMAL_QUARTER = 0.3186  # a quarter of normal deviations is smaller: a scale that half of the steps cannot spoil
_MOST_STILL = 0.2  # less than the quarter of the steps that the scale is taken from
_ROUNDS = 12
_LEAST_FACTOR = 0.05
_STIFFNESS = np.array([1.0, 1.0, 0.01, 0.01, 1e-4, 1e-4, 1e-4, 1e-4])


def remove_jumps(level: Group, model: Model, grid_s: Floats, values: Floats) -> Group:
    """Remove jumps of positions or headings, as they come from jittering stamps and clocks that are set.

    A step from one sample to the next is a jump where it differs from the model's by far more than the usual
    step does, and by a good part of the distance; the model's step takes its place. Where there are such steps at
    ``values`` [p], a robust regression on steps stands many of them where one on levels does not; it starts from
    ``values`` and from the most frequent ratio of measured to model's steps, and the tighter fit counts. Returns
    ``level`` itself where nothing, or nearly everything, jumps, and where it often stands still: it is rounded so
    coarsely then that its steps are those of the rounding.
    """
    still = (np.abs(np.diff(level.levels, axis=0)) < 1e-9).all(axis=1)
    if still.mean() > _MOST_STILL:
        return level
    steps = _steps(level, model, grid_s, values)
    if not _jumps(steps).any():
        return level
    starts = (values, _most_frequent(steps, values))
    fits = [_robust_fit(level, model, grid_s, start) for start in starts]
    steps = min(
        (_steps(level, model, grid_s, fit) for fit in fits), key=lambda candidate: float(_scale(candidate)[0])
    )
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
    """``values`` with factor and angle moved to where the quarter of the faster steps that agree best lies.

    They are returned as they are if that quarter stands still, as a stuck sensor does: a factor of nearly zero has
    no slope.
    """
    faster = steps.distance >= max(float(np.median(steps.distance)), 1e-6)
    ratios = np.sort(steps.error[faster] / steps.distance[faster, np.newaxis], axis=0)
    quarter = max(1, len(ratios) // 4)
    tightest = np.argmin(ratios[quarter:] - ratios[:-quarter], axis=0)
    middle = ratios[tightest + quarter // 2, np.arange(ratios.shape[1])]
    moved = np.zeros_like(values)
    moved[0], moved[1] = values[0] * (1.0 + middle[0]), values[1]
    if abs(moved[0]) < _LEAST_FACTOR:
        return values
    if middle.size == 2:
        moved[1] -= middle[1]
    return moved


def _scale(steps: _Steps) -> Floats:
    return np.asarray(np.quantile(np.abs(steps.error), 0.25, axis=0) / _NORMAL_QUARTER + 1e-9)


def _jumps(steps: _Steps) -> Bools:
    limit = np.maximum(_JUMP * _scale(steps), _LEAST_JUMP * steps.distance[:, np.newaxis])
    return np.asarray((np.abs(steps.error) > limit).any(axis=1))


def _steps(level: Group, model: Model, grid_s: Floats, values: Floats) -> _Steps:
    expected, slopes = model(values)
    both = np.concatenate([expected[:, np.newaxis], slopes], axis=1)
    at = interpolate(level.time_s - values[2], grid_s, both.reshape(grid_s.size, -1))
    moves = np.diff(at.reshape(-1, *both.shape[1:]), axis=0)
    measured = np.diff(level.levels, axis=0)
    if measured.shape[1] == 1:
        forward = np.where(moves[:, 0, 0] < 0.0, -1.0, 1.0)
        error, moves = (measured - moves[:, 0]) * forward[:, np.newaxis], moves * forward[:, np.newaxis, np.newaxis]
        return _Steps(error, moves[:, 1:], np.abs(moves[:, 0, 0]), np.where(forward < 0.0, np.pi, 0.0))
    angle = np.arctan2(moves[:, 0, 1], moves[:, 0, 0])
    body = np.stack([rotate(-angle, moves[:, column]) for column in range(moves.shape[1])], axis=1)
    return _Steps(rotate(-angle, measured) - body[:, 0], body[:, 1:], np.hypot(*moves[:, 0].T), angle)


def _to_sample_frame(angle: Floats, errors: Floats) -> Floats:
    """Errors [n, m] back in the frame of the samples."""
    return rotate(angle, errors) if errors.shape[1] == 2 else errors * np.cos(angle)[:, np.newaxis]


@dataclass(frozen=True, slots=True)
class PositionErrors:
    """Of each raw position: when [s], by how much north and east [n, 2], the velocity of the ship [n, 2] and the
    position itself [n, 2]."""

    time_s: Floats
    error: Floats
    velocity: Floats
    raw: Floats


def position_errors(table: pd.DataFrame, fit: Kinematics) -> PositionErrors:
    """Errors of the raw positions about the fitted path, without outliers."""
    motion, parameters = fit.motion, fit.path_parameters
    grid_s = np.arange(motion.speed.time_s[0], motion.speed.time_s[-1], motion.step_s)
    path, slopes = path_model(motion, grid_s)(parameters)
    raw = group_samples(table, GROUPS["north_m"])
    times = raw.time_s - parameters[2]
    within = (times >= grid_s[0]) & (times <= grid_s[-1])
    at = interpolate(times[within], grid_s, np.hstack([path, -slopes[:, 2]]))
    error = raw.levels[within] - at[:, :2]
    sound = ~outliers(error)
    return PositionErrors(times[within][sound], error[sound], at[sound, 2:], raw.levels[within][sound])


_JUMP_STRETCH_S = 5.0
_FEWEST_IN_STRETCH = 4
_MOST = 20
_THIN_S = 0.5
_SIGMAS = 10.0
_USUAL = 3.0  # times what 95 % of the stretches differ by
_SMALLEST_M, _SMALLEST_S = 1.0, 1.0  # or what the ship makes in a second at her fastest, if that is less
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
    smallest_m = min(_SMALLEST_M, _SMALLEST_S * float(np.quantile(np.hypot(*errors.velocity.T), 0.98)))
    jumps = [
        (float(time_s[place] + fit.believed.parameters[2]), size)
        for place, size in _lasting_steps(error, width, interval_s, smallest_m)
        if _recorded_throughout(time_s, place, width, interval_s, fit)
    ]
    return _pair_returns(jumps, np.ptp(time_s))


def _lasting_steps(error: Floats, width: int, interval_s: float, smallest_m: float) -> list[tuple[int, Floats]]:
    """The first sample after each jump, and the jump's size north and east."""
    medians = np.median(sliding_window_view(error, width, axis=0), axis=-1)
    change = medians[width:] - medians[:-width]  # row r is about the step to sample r + width
    size = np.hypot(*change.T)
    limit = max(_SIGMAS * float(np.median(size)), _USUAL * float(np.quantile(size, 0.95)), smallest_m)
    places = np.arange(width, width + len(change))
    half = max(1, round(0.5 * _AT_ONCE_S / interval_s))
    after, before = np.minimum(places + half - 1, len(error) - 1), np.maximum(places - half, 0)
    toward = change / np.maximum(size, 1e-12)[:, np.newaxis]
    along = np.einsum("ij,ij->i", error[after] - error[before], toward)
    at_once = np.einsum("ij,ij->i", error[places] - error[places - 1], toward)
    rows = np.flatnonzero((size > limit) & (along > _AT_ONCE * size))
    groups = np.split(rows, np.flatnonzero(np.diff(rows) > width) + 1) if rows.size else []
    best = (int(group[np.argmax(at_once[group])]) for group in groups)
    return [(row + width, change[row]) for row in best]


def _recorded_throughout(time_s: Floats, place: int, width: int, interval_s: float, fit: Kinematics) -> bool:
    """Whether the motion about a step was recorded throughout and its stamps do not crowd."""
    first, last = max(place - width, 0), min(place + width, time_s.size - 1)
    if time_s[last] - time_s[first] < 0.8 * (last - first) * interval_s:
        return False
    return all(_recorded(group, *time_s[place - 1 : place + 1]) for group in (fit.motion.speed, fit.motion.heading))


def _recorded(samples: Group, begin: float, end: float) -> bool:
    first, last = np.searchsorted(samples.time_s, [begin, end], side="left")
    inside = samples.time_s[max(first - 1, 0) : last + 1]
    return bool(inside.size > 1 and np.diff(inside).max() < 1.8 * samples.interval_s)


def _pair_returns(jumps: list[tuple[float, Floats]], lasts_s: float) -> tuple[PositionJump, ...]:
    """Join a jump and the next one where that takes it back."""
    merged: list[PositionJump] = []
    remaining = deque(jumps)
    while remaining:
        time_s, size = remaining.popleft()
        until_s = np.nan
        if remaining:
            next_s, back = remaining[0]
            taken_back = np.hypot(*(size + back)) < _RETURNED * np.hypot(*size)
            if taken_back and next_s - time_s < _LONGEST_AWAY * lasts_s:
                until_s, _ = remaining.popleft()
        merged.append(PositionJump(time_s, float(size[0]), float(size[1]), until_s))
    return tuple(merged)


def _stuck(raw: Floats, interval_s: float) -> Bools:
    """Samples of which a coordinate has not changed for 3 s: they are stuck, and what follows is no jump."""
    stuck = np.zeros(len(raw), dtype=bool)
    for column in raw.T:
        _, lengths = runs_of_equal(np.diff(column) != 0.0)
        stuck |= np.repeat(lengths * interval_s > _STUCK_S, lengths)
    return stuck


def jump_finding(table: pd.DataFrame, jump: PositionJump) -> Finding:
    """A jump in words; it ends where the positions return."""
    index = utc_index(table)
    start = index.min() + pd.Timedelta(round(jump.time_s * NANO), "ns")
    returns, metres = bool(np.isfinite(jump.until_s)), float(np.hypot(jump.north_m, jump.east_m))
    end = index.min() + pd.Timedelta(round(jump.until_s * NANO), "ns") if returns else start
    text = (
        f"The positions jump by {metres:.1f} m ({jump.north_m:+.1f} m north, {jump.east_m:+.1f} m east)"
        f" at {start:%H:%M:%S}"
    )
    after = f" and return after {jump.until_s - jump.time_s:.1f} s" if returns else " and do not return"
    return Finding(
        "position_jump", "north_m", start, end, text + after,
        "Leave out what is displaced." if returns else "Take what lies before and after as two recordings.",
        {"metres": metres, "north_m": jump.north_m, "east_m": jump.east_m},
    )  # fmt: skip


def displaced(table: pd.DataFrame, jumps: tuple[PositionJump, ...]) -> Bools:
    """Which rows lie between a jump and its return."""
    time_s, mask = seconds_of(table), np.zeros(len(table), dtype=bool)
    for jump in jumps:
        mask |= (time_s >= jump.time_s - 1e-6) & (time_s < jump.until_s - 1e-6)
    return mask
