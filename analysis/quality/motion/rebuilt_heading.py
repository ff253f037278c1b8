"""Headings with jittering time stamps, rebuilt from the integrated yaw rate.

A complementary filter: the shape of a turn from the yaw rate, what is slow from the recorded headings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from acquisition.core.angles import unwrap, wrap_360
from acquisition.core.arrays import Bools, Floats
from acquisition.core.errors import DataShortageError, InputError
from analysis.quality.motion.heading_jitter import HeadingErrors, certain, jitter_of, leaps, turned_at
from analysis.quality.motion.kinematics import Kinematics, fit_kinematics
from analysis.quality.motion.rebuilt_path import tied
from analysis.quality.runs import samples_of
from analysis.tables.time_index import utc_index

_TIES_S = (15.0, 30.0, 60.0)
"""Short against what the yaw rate needs to part from the heading by its bias and a scale that changes, long against
most errors of stamps; how long these last the recording tells."""
_WORTH = 2.0


@dataclass(frozen=True, slots=True)
class RebuiltHeading:
    """The heading column [rows, deg], and over how many seconds it is tied to the recorded one."""

    heading_deg: Floats
    tie_s: float


def rebuilt_heading(table: pd.DataFrame) -> RebuiltHeading | None:
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
    turned, rate = turned_at(fit, heading.time_s)
    off = np.deg2rad(unwrap(heading.value - np.rad2deg(turned)))
    side = np.concatenate([[0], np.cumsum(leaps(off, rate) | _unknown(fit, heading.time_s))])
    times = utc_index(table)[heading.rows]
    for tie_s in _TIES_S:
        slow = tied(off[:, np.newaxis], side, times, tie_s)[:, 0]
        left = HeadingErrors(heading.time_s, slow, turned, rate, 0.0)
        if not certain(jitter_of(left)):
            break
    if not _worth_it(off - slow, rate):
        return None
    column = table["heading_deg"].to_numpy(dtype=float, copy=True)
    column[heading.rows] = wrap_360(np.rad2deg(turned + slow))
    return RebuiltHeading(column, tie_s)


def _unknown(fit: Kinematics, heading_time_s: Floats) -> Bools:
    """Between which headings nothing was recorded of the yaw rate for too long: [n - 1]."""
    unknown = np.zeros(max(heading_time_s.size - 1, 0), np.bool_)
    for begin, end in fit.motion.yaw_rate.gaps():
        unknown |= (heading_time_s[1:] > begin) & (heading_time_s[:-1] < end)
    return unknown


def _worth_it(mended: Floats, rate: Floats) -> bool:
    """Whether what would be mended in turns is beyond what compass and yaw rate scatter by without turning."""
    turning, mended2 = rate**2, mended**2
    still = mended2[turning <= np.median(turning)].mean()
    return bool((turning * mended2).sum() > _WORTH * still * turning.sum())
