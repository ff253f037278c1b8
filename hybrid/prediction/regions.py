"""95 % regions about predicted positions: ellipses along and across the predicted course.

Their size follows from errors on legs not used for training (split conformal prediction, Lei et al. 2018),
normalised by the relative uncertainty that a method assigns to each window. Errors of windows of one leg or
recording are correlated, so those of a new one exceed a quantile over all windows: regions are widened until
each group is covered when sized on the others. A region is given by its semi-axes, along and across, in metres,
as the last axis of an array.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, unlike_groups

COVERAGE = 0.95
_COUNTED = 0.9
"""Errors beyond this quantile are clipped when the shape of regions is estimated: a few bad windows determine
the size, not the shape."""
_MOST_PARTS = 20  # with more groups, several are held out at once
_CORNERS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


def conformal_region(predicted: Floats, windows: PredictionWindows, uncertainty: Floats | None = None) -> Floats:
    """The semi-axes [H, 2] of the region that holds 95 % of the measured positions, by second, in metres.

    ``predicted`` are tracks [N, H+1, 3] of the windows. With the relative ``uncertainty`` [N, H] of each
    prediction the region is that for an uncertainty of one. The quantile is that of split conformal prediction,
    the ceil((n + 1) 0.95)-th of n errors, so it does not shrink with few windows; no axis shrinks from one
    second to the next. Seconds not measured or not predicted (NaN) do not count.
    """
    along, across = errors_by_course(predicted, windows.track)
    if uncertainty is not None:
        along, across = along / uncertainty, across / uncertainty
    shape = _shape(along, across, len(np.unique(windows.trial)))
    relative = np.hypot(along / shape[:, 0], across / shape[:, 1])
    size = _widening(relative, unlike_groups(windows)) * _quantile(relative, COVERAGE)
    return np.maximum.accumulate(size[:, None] * shape, axis=0)


def relative_distances(predicted: Floats, measured: Floats, region_m: Floats) -> Floats:
    """Errors of tracks [N, H+1, 3] at seconds 1 to H [N, H], relative to their regions [N or 1, H, 2] in that
    direction: 1 on the border, more outside, 0 without error."""
    gap_m = np.stack(errors_by_course(predicted, measured), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(np.where(gap_m == 0.0, 0.0, gap_m / region_m), axis=-1))


def errors_by_course(predicted: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """Errors of tracks [N, H+1, 2 or 3] forward and to starboard [N, H] of the measured ones at seconds 1 to H,
    relative to the predicted course [m]."""
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
    """The radius of the circles that enclose regions [.., 2], in metres."""
    return np.asarray(region_m.max(axis=-1))


def bands(region_m: Floats | None) -> dict[str, Floats | None]:
    """A region [.., 2] by its names in files: the enclosing circle, along and across."""
    if region_m is None:
        return dict.fromkeys(("band_m", "band_along_m", "band_across_m"))
    return {"band_m": circle_about(region_m), "band_along_m": region_m[..., 0], "band_across_m": region_m[..., 1]}


def equal_area_radius(region_m: Floats) -> Floats:
    """The radius of the circles of equal area to regions [.., 2], in metres."""
    return np.asarray(np.sqrt(region_m.prod(axis=-1)))


def outlines(track: Floats, region_m: Floats) -> Floats:
    """Points [H, 24, 2], north and east, of the borders of the regions [H, 2] about a track [H+1, 3]."""
    course = courses(track)[:, None]
    along, across = region_m[:, :1] * np.cos(_CORNERS), region_m[:, 1:] * np.sin(_CORNERS)
    north = along * np.cos(course) - across * np.sin(course)
    east = along * np.sin(course) + across * np.cos(course)
    return np.asarray(track[1:, None, :2] + np.stack([north, east], axis=-1))


def _shape(along: Floats, across: Floats, recordings: int) -> Floats:
    """The semi-axes [H, 2] of regions of area pi, in the ratio of the errors [N, H] along and across.

    A few recordings may not be representative, since other sensors have other errors: the logarithm of the
    ratio is shrunk towards a circle as by one more recording, so that one recording counts half.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(_typical(along) / _typical(across))
    stretch = np.exp(0.5 * np.where(np.isfinite(log_ratio), log_ratio, 0.0) * recordings / (recordings + 1.0))
    return np.column_stack([stretch, 1.0 / stretch])


def _typical(errors: Floats) -> Floats:
    """The typical size of errors [N, H] by second, without the worst tenth [H]."""
    size = np.abs(errors)
    squares = np.minimum(size, _quantile(size, _COUNTED)) ** 2
    return np.asarray(np.sqrt(np.nansum(squares, axis=0) / np.isfinite(size).sum(axis=0)))


def _widening(relative: Floats, group: NDArray[np.str_]) -> float:
    """The factor, at least 1, by which regions sized on all windows' ``relative`` distances [N, H] must be
    widened to hold 95 % of each group [N] when sized on the others."""
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
