"""Positions and headings with jittering time stamps, reconstructed from speeds and yaw rate.

A complementary filter for each: fast motion from the integrated velocity or yaw rate, slow motion from the
recorded positions or headings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Bools, Floats, integrate, to_earth
from seatrial.acquisition.core.ship import unwrap, wrap_360
from seatrial.analysis.quality.motion.jitter import (
    HeadingErrors,
    discontinuities,
    integrated_yaw_rate_at,
    is_certain,
    jitter_of,
)
from seatrial.analysis.quality.motion.kinematics import Kinematics, fit_kinematics
from seatrial.analysis.quality.samples import samples_of
from seatrial.analysis.tables.table import seconds_of, utc_index

POSITIONS = ("north_m", "east_m")
_NEEDED = (*POSITIONS, "heading_deg", "surge_mps", "sway_mps")
_POSITION_TIES_S = (60.0, 120.0, 300.0, 600.0)
_SLOW = 0.01
"""A tie may move the path by one per cent of the ship's speed, hardly more than speeds are uncertain by."""
_LEAP = 6.0


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """The columns that were rebuilt, [rows] each, and over how many seconds they are tied to the recorded ones;
    infinite for a median."""

    columns: dict[str, Floats]
    tie_s: float


def reconstruct_positions(table: pd.DataFrame) -> Reconstruction | None:
    """Positions from the integrated velocity, tied to the recorded ones; None where a channel is lacking.

    What lies between path and positions is passed through a running median over 60 s, which leaps do not move,
    and a running mean. Where the two part for good (a clock that was set, a hole that was interpolated) each
    side is tied by itself. Stamps whose errors add up make positions leave the path by leap after leap: such a
    tie would put that way into the ship's motion again. Where path and positions agree between the leaps, it is
    made longer until it moves the path by less than 1 % of the speed, at last a constant.
    """
    if any(samples_of(table, name).rows.size < 2 for name in _NEEDED):
        return None
    way_m = dead_reckoning(table)
    both = np.flatnonzero(table[list(POSITIONS)].notna().all(axis=1))
    times, way_m = utc_index(table)[both], way_m[both]
    recorded_m = table[list(POSITIONS)].to_numpy(dtype=float)[both]
    off_m = recorded_m - way_m
    side = _sides(off_m)
    tie_s = _POSITION_TIES_S[0]
    tied_m = slow_difference(off_m, side, times, tie_s)
    if _agrees_between_leaps(way_m, off_m):
        for tie_s in (*_POSITION_TIES_S, np.inf):
            tied_m = slow_difference(off_m, side, times, tie_s)
            if _path_correction(tied_m, way_m, side) < _SLOW:
                break
    columns = {}
    for number, name in enumerate(POSITIONS):
        columns[name] = table[name].to_numpy(dtype=float, copy=True)
        columns[name][both] = way_m[:, number] + tied_m[:, number]
    return Reconstruction(columns, tie_s)


def dead_reckoning(table: pd.DataFrame) -> Floats:
    """The path north and east since the start by dead reckoning, from speeds over ground and heading: [rows, 2]."""
    since_s = seconds_of(table)
    surge, sway, heading = (samples_of(table, name) for name in ("surge_mps", "sway_mps", "heading_deg"))
    ahead, aside = (np.interp(since_s, samples.time_s, samples.value) for samples in (surge, sway))
    psi = np.deg2rad(np.interp(since_s, heading.time_s, unwrap(heading.value)))
    return np.column_stack([integrate(speed, since_s) for speed in to_earth(ahead, aside, psi)])


def _sides(off_m: Floats) -> NDArray[np.intp]:
    """The number of the stretch each position belongs to, between steps far beyond what jitter makes here: [n]."""
    step_m = np.hypot(*np.diff(off_m, axis=0).T)
    leap = step_m > _LEAP * np.quantile(step_m, 0.995) if step_m.size else np.zeros(0, np.bool_)
    return np.concatenate([[0], np.cumsum(leap)])


def slow_difference(deviation: Floats, side: NDArray[np.intp], times: pd.DatetimeIndex, tie_s: float) -> Floats:
    """Running median and mean over ``tie_s`` of the difference of recorded and integrated [n, m], for each ``side``
    by itself; the median of a side where ``tie_s`` is infinite."""
    parts = []
    for part in np.split(np.arange(side.size), np.flatnonzero(np.diff(side)) + 1):
        piece = pd.DataFrame(deviation[part], index=times[part])
        if np.isfinite(tie_s):
            typical = piece.rolling(pd.Timedelta(seconds=tie_s), center=True).median()
            parts.append(typical.rolling(pd.Timedelta(seconds=tie_s), center=True).mean().to_numpy())
        else:
            parts.append(np.broadcast_to(np.median(deviation[part], axis=0), (part.size, deviation.shape[1])))
    return np.concatenate(parts)


def _agrees_between_leaps(way_m: Floats, off_m: Floats) -> bool:
    """Whether the usual step of the positions is that of the path, along and across it.

    It is not where the heading has an offset or the speeds a scale; then the positions are the better guide.
    """
    way, deviation = (np.diff(path_m[:, 0] + 1j * path_m[:, 1]) for path_m in (way_m, off_m))
    moving = np.abs(way) > 0.2 * np.median(np.abs(way))
    if not moving.any():
        return False
    share = deviation[moving] / way[moving]
    return bool(np.hypot(np.median(share.real), np.median(share.imag)) < _SLOW)


def _path_correction(tied_m: Floats, way_m: Floats, side: NDArray[np.intp]) -> float:
    """How far the tie moves the path, as a share of the way: root mean square of steps within the sides."""
    within = np.diff(side) == 0
    moved, way = (np.sum(np.diff(path_m, axis=0)[within] ** 2) for path_m in (tied_m, way_m))
    return float(np.sqrt(moved / max(way, 1e-12)))


_HEADING_TIES_S = (15.0, 30.0, 60.0)
"""Short against what the yaw rate needs to part from the heading by its bias and a scale that changes, long against
most errors of stamps; how long these last the recording tells."""
_WORTH = 2.0


def reconstruct_heading(table: pd.DataFrame) -> Reconstruction | None:
    """Headings with the shape of the integrated yaw rate, taken with factor, bias and delay as they fit the table.

    What lies between the two is passed through a running median, which short errors of stamps do not move, and a
    running mean; where they part for good (a splice, a hole in the yaw rate) each side is tied by itself. The tie
    is made longer until what it lets through no longer scatters with the yaw rate. None where channels are lacking
    or the yaw rate would bring more noise than it mends: headings leave it in turns hardly more than without.
    """
    try:
        fit = fit_kinematics(table)
    except (DataShortageError, InputError):
        return None
    heading = samples_of(table, "heading_deg")
    turned, rate = integrated_yaw_rate_at(fit, heading.time_s)
    deviation = np.deg2rad(unwrap(heading.value - np.rad2deg(turned)))
    side = np.concatenate([[0], np.cumsum(discontinuities(deviation, rate) | _unknown(fit, heading.time_s))])
    times = utc_index(table)[heading.rows]
    for tie_s in _HEADING_TIES_S:
        slow = slow_difference(deviation[:, np.newaxis], side, times, tie_s)[:, 0]
        slow_errors = HeadingErrors(heading.time_s, slow, turned, rate, 0.0)
        if not is_certain(jitter_of(slow_errors)):
            break
    if not _exceeds_scatter(deviation - slow, rate):
        return None
    column = table["heading_deg"].to_numpy(dtype=float, copy=True)
    column[heading.rows] = wrap_360(np.rad2deg(turned + slow))
    return Reconstruction({"heading_deg": column}, tie_s)


def _unknown(fit: Kinematics, heading_time_s: Floats) -> Bools:
    """Between which headings nothing was recorded of the yaw rate for too long: [n - 1]."""
    unknown = np.zeros(max(heading_time_s.size - 1, 0), np.bool_)
    for begin, end in fit.motion.yaw_rate.gaps():
        unknown |= (heading_time_s[1:] > begin) & (heading_time_s[:-1] < end)
    return unknown


def _exceeds_scatter(mended: Floats, rate: Floats) -> bool:
    """Whether the change in turns exceeds the scatter of compass and yaw rate without turning."""
    turning, mended2 = rate**2, mended**2
    still = mended2[turning <= np.median(turning)].mean()
    return bool((turning * mended2).sum() > _WORTH * still * turning.sum())
