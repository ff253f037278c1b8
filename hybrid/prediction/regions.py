"""The 95 % regions about predicted positions: ellipses along and across the predicted course.

How large they are follows from errors on legs that took no part in the training (split conformal prediction, Lei et
al. 2018), normalised by the relative uncertainty that a method gives each window. Windows of one leg, or of one
recording, err alike, so that a new one errs more than a quantile over all windows says: the regions are widened
until each group is held by what was learned from the others. A region is given by its semi-axes, along and across,
in metres, as the last axis of an array.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.kinematics import to_ship
from hybrid.prediction.prediction_windows import PredictionWindows, unlike_groups

COVERAGE = 0.95
_COUNTED = 0.9
"""Errors beyond this quantile count as that large where it is asked whether regions are long or wide: a few bad
windows say how large a region must be, not what shape."""
_MOST_PARTS = 20  # with more groups than this, several are left out at once
_CORNERS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


def conformal_region(predicted: Floats, windows: PredictionWindows, uncertainty: Floats | None = None) -> Floats:
    """The semi-axes [H, 2] of the region that holds 95 % of the measured positions by second, in metres.

    ``predicted`` are tracks [N, H+1, 3] of the windows. With the relative ``uncertainty`` [N, H] of each prediction
    the region is that for an uncertainty of one. The quantile is that of split conformal prediction, the
    ceil((n + 1) 0.95)-th of n errors, so it does not shrink with few windows; no axis shrinks from one second to
    the next. Seconds that were not measured or not predicted (NaN) do not count.
    """
    along, across = errors_by_course(predicted, windows.track)
    if uncertainty is not None:
        along, across = along / uncertainty, across / uncertainty
    shape = _shape(along, across, len(np.unique(windows.trial)))
    relative = np.hypot(along / shape[:, 0], across / shape[:, 1])
    size = _widening(relative, unlike_groups(windows)) * _quantile(relative, COVERAGE)
    return np.maximum.accumulate(size[:, None] * shape, axis=0)


def relative_distances(predicted: Floats, measured: Floats, region_m: Floats) -> Floats:
    """How far off tracks [N, H+1, 3] are at seconds 1 to H [N, H], over how far their regions [N or 1, H, 2] reach
    in that direction: 1 on the border, more outside; 0 where they are not off at all.
    """
    gap_m = np.stack(errors_by_course(predicted, measured), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(np.where(gap_m == 0.0, 0.0, gap_m / region_m), axis=-1))


def errors_by_course(predicted: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """How far tracks [N, H+1, 2 or 3] are ahead and to starboard [N, H] of the measured ones at seconds 1 to H, by
    the predicted course [m].
    """
    gap = (predicted - measured)[:, 1:]
    along, across = to_ship(gap[..., 0], gap[..., 1], courses(predicted))
    return np.asarray(along), np.asarray(across)


def courses(tracks: Floats) -> Floats:
    """The course over ground of tracks [.., H+1, 2 or 3] at seconds 1 to H [.., H], from the second before
    [rad].
    """
    step = np.diff(tracks[..., :2], axis=-2)
    return np.asarray(np.arctan2(step[..., 1], step[..., 0]))


def circle_about(region_m: Floats) -> Floats:
    """The radius of the circles that hold regions [.., 2], in metres."""
    return np.asarray(region_m.max(axis=-1))


def bands(region_m: Floats | None) -> dict[str, Floats | None]:
    """A region [.., 2] by the names that files have for it: the circle that holds it, along and across."""
    if region_m is None:
        return dict.fromkeys(("band_m", "band_along_m", "band_across_m"))
    return {"band_m": circle_about(region_m), "band_along_m": region_m[..., 0], "band_across_m": region_m[..., 1]}


def equal_area_radius(region_m: Floats) -> Floats:
    """The radius of the circles as large as regions [.., 2], in metres."""
    return np.asarray(np.sqrt(region_m.prod(axis=-1)))


def outlines(track: Floats, region_m: Floats) -> Floats:
    """Points [H, 24, 2], north and east, of the borders of the regions [H, 2] about a track [H+1, 3]."""
    course = courses(track)[:, None]
    along, across = region_m[:, :1] * np.cos(_CORNERS), region_m[:, 1:] * np.sin(_CORNERS)
    north = along * np.cos(course) - across * np.sin(course)
    east = along * np.sin(course) + across * np.cos(course)
    return np.asarray(track[1:, None, :2] + np.stack([north, east], axis=-1))


def _shape(along: Floats, across: Floats, recordings: int) -> Floats:
    """The semi-axes [H, 2] of regions of the area pi: in the ratio of the errors [N, H] along and across.

    What is learned from a few recordings may not hold in another, where other sensors err: beside them counts one
    whose errors are as large along as across, so that one recording says half, in logarithms.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(_typical(along) / _typical(across))
    stretch = np.exp(0.5 * np.where(np.isfinite(log_ratio), log_ratio, 0.0) * recordings / (recordings + 1.0))
    return np.column_stack([stretch, 1.0 / stretch])


def _typical(errors: Floats) -> Floats:
    """The size of errors [N, H] by second, without what the worst tenth adds [H]."""
    size = np.abs(errors)
    squares = np.minimum(size, _quantile(size, _COUNTED)) ** 2
    return np.asarray(np.sqrt(np.nansum(squares, axis=0) / np.isfinite(size).sum(axis=0)))


def _widening(relative: Floats, group: NDArray[np.str_]) -> float:
    """How many times wider than by all windows' ``relative`` distances [N, H] regions are that hold 95 % of each
    group's [N] when sized on the other groups; at least once.
    """
    names = np.unique(group)
    if len(names) < 2:
        return 1.0
    beyond = []
    for left_out in np.array_split(names, min(len(names), _MOST_PARTS)):
        mine = np.isin(group, left_out)
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond.append((relative[mine] / _quantile(relative[~mine], COVERAGE)).ravel())
    needed = float(_quantile(np.concatenate(beyond)[:, None], COVERAGE)[0])
    return max(1.0, needed) if np.isfinite(needed) else 1.0


def _quantile(values: Floats, share: float) -> Floats:
    """The ceil((n + 1) share)-th of n values [N, H], or the largest, by second [H]; NaN does not count."""
    count = np.isfinite(values).sum(axis=0)
    rank = np.minimum(np.ceil((count + 1) * share), count).astype(np.int64) - 1
    return np.asarray(np.take_along_axis(np.sort(values, axis=0), rank[None], axis=0)[0])
