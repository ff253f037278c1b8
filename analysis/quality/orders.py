"""Orders that were recorded when they changed, and then interpolated on straight lines between those events.

A lever that stands still says nothing; the value it was left at holds until the next event. Interpolated
linearly, the order creeps towards its next value for minutes, which no drive and no hand does. A measured value
never keeps to a straight line to the last digit, so the lines give themselves away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from acquisition.core.angles import unwrap
from acquisition.core.arrays import Bools, Floats, Ints
from acquisition.core.channels import BY_NAME, COMMAND
from acquisition.core.frames import Quality
from analysis.quality.findings import Checked, Finding, no_flags
from analysis.quality.runs import Samples, covered, mark, runs, samples_of
from analysis.tables.time_index import utc_index

CODE = "order_interpolated"
_FEWEST_STEPS = 3
_LONG_S = 5.0
_VERY_LONG_S = 30.0
_SLOWEST_DRIVE_PER_S = 5.0
"""Drives turn an azimuth by 5-20 deg/s and a shaft by 5 rpm/s and more: slower lines are none of theirs."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Ramps:
    """Exactly straight, sloping stretches of a series: samples ``first`` to ``last``, both on the line."""

    first: Ints
    last: Ints
    seconds: Floats
    slope_per_s: Floats

    def chosen(self, mask: Bools) -> Ramps:
        return Ramps(self.first[mask], self.last[mask], self.seconds[mask], self.slope_per_s[mask])


def orders(table: pd.DataFrame) -> Checked:
    """Find orders that were interpolated linearly between events (``order_interpolated``).

    One finding a command channel. ``estimate``: the ``share`` of time in ramps, ``longest_s``, and how many
    ``ramps``. The values within a ramp, its first excepted, are flagged suspect.
    """
    names = tuple(name for name in COMMAND if name in table)
    flags, index, findings = no_flags(table, names), utc_index(table), []
    for name in names:
        series = samples_of(table, name)
        ramps = order_ramps(name, series)
        inside = covered(ramps.first + 1, ramps.last, series.rows.size)
        mark(flags, name, series.rows, series.rows[inside], Quality.SUSPECT)
        if ramps.first.size:
            findings.append(_finding(name, index, series, ramps))
    return Checked(flags, tuple(findings))


def _finding(name: str, index: pd.DatetimeIndex, series: Samples, ramps: Ramps) -> Finding:
    share = float(ramps.seconds.sum() / (series.time_s[-1] - series.time_s[0]))
    longest_s = float(ramps.seconds.max())
    text = (
        f"{name} runs on exactly straight lines for {100 * share:.0f} % of the time, up to {longest_s:.0f} s long: "
        "an order that was recorded when it changed and then interpolated"
    )
    start, end = (index[series.rows[each]] for each in (ramps.first[0], ramps.last[-1]))
    estimate = {"share": share, "longest_s": longest_s, "ramps": float(ramps.first.size)}
    remedy = "Each order holds until the next event, and --repair makes it so"
    return Finding(CODE, name, start, end, text, remedy, estimate, certain=True)


def held_orders(table: pd.DataFrame, name: str) -> Floats:
    """A command channel whose interpolated ramps hold their first value until the last sample: [rows].

    An event says that the order has changed; that there was none until the next says that it stayed. So the
    value at the beginning of a ramp is the order until its end, and the line between was never ordered.
    """
    value = table[name].to_numpy(dtype=float, copy=True)
    series = samples_of(table, name)
    ramps = order_ramps(name, series)
    inside = np.flatnonzero(covered(ramps.first + 1, ramps.last, series.rows.size))
    begun = ramps.first[np.searchsorted(ramps.first, inside, side="left") - 1]
    value[series.rows[inside]] = series.value[begun]
    return value


def order_ramps(name: str, series: Samples) -> Ramps:
    """The ramps of a channel that gives itself away as interpolated; none of one that does not.

    It does by three slow lines of 5 s, or one of 30 s, that are not all equally steep: a drive that turns at
    its limit is. Then all its straight lines count, the short ones too.
    """
    value = unwrap(series.value) if BY_NAME[name].circular else series.value
    ramps = straight_ramps(series.time_s, value)
    telling = (np.abs(ramps.slope_per_s) < _SLOWEST_DRIVE_PER_S) & ~_common(ramps.slope_per_s)
    long_s = ramps.seconds[telling & (ramps.seconds >= _LONG_S)]
    found = long_s.size >= 3 or bool((long_s >= _VERY_LONG_S).any())
    return ramps.chosen(np.full(ramps.first.size, found))


def _common(slope_per_s: Floats) -> Bools:
    """Whether each slope is one that at least half of all (and three) share: the limit of a drive."""
    if not slope_per_s.size:
        return np.zeros(0, np.bool_)
    steepness = np.round(np.log(np.abs(slope_per_s)), 3)
    _, which, count = np.unique(steepness, return_inverse=True, return_counts=True)
    shared: Bools = count[which] >= max(3, slope_per_s.size / 2)
    return shared


def straight_ramps(time_s: Floats, value: Floats) -> Ramps:
    """Where ``value`` lies on sloping lines to rounding, over three equal steps or more.

    Rounding is that of floating point, or that of the decimals a file was written with where those are fine
    beside the values' range; on a coarse grid equal steps prove nothing.
    """
    empty = np.zeros(0, np.int64)
    if value.size <= _FEWEST_STEPS:
        return Ramps(empty, empty, np.zeros(0), np.zeros(0))
    before_s, after_s = np.diff(time_s)[:-1], np.diff(time_s)[1:]
    line = (value[:-2] * after_s + value[2:] * before_s) / (before_s + after_s)
    rounding = _rounding(value)
    slopes = np.abs(value[2:] - value[:-2]) > 8.0 * rounding
    first, stop = runs((np.abs(value[1:-1] - line) <= rounding) & slopes)
    last = stop + 1  # of a run of middles i..j in the inner samples, the line begins at i and ends at j + 2
    enough = last - first >= _FEWEST_STEPS
    first, last = first[enough], last[enough]
    seconds = time_s[last] - time_s[first]
    return Ramps(first, last, seconds, (value[last] - value[first]) / seconds)


def _rounding(value: Floats) -> float:
    """How far a value on a line may be off it: twice the file's last decimal, if that is fine, else 1e-9."""
    scale = float(np.abs(value).max()) or 1.0
    for decimals in range(3, 7):
        unit = 10.0**-decimals
        if unit < 1e-4 * np.ptp(value) and bool(np.all(np.abs(value - np.round(value, decimals)) < 1e-9 * scale)):
            return unit
    return _ROUNDING * scale
