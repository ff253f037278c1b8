"""The samples of channels as the checks see them, and what the checks share: runs, stretches, noise, steps.

Checks of one channel work on its samples in the order of receipt
(:class:`seatrial.acquisition.core.quantities.Series`), checks across channels on its samples in the rows of the
joined table (:class:`Samples`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Series
from seatrial.acquisition.core.ship import Channel, is_setting, unwrap
from seatrial.analysis.tables.table import NANO, seconds_of, times_ns

ASSUMED = "assumed"
"""The source of a channel that a column map gave a value to."""


@dataclass(frozen=True, slots=True, order=True)
class Stretch:
    """A part of a channel's time in which something is wrong, and its size (seconds, or what the check defines)."""

    start_ns: int
    end_ns: int
    size: float = 0.0

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / NANO


def series_of(measured_ns: Ints, value: Floats) -> Series:
    """Samples in the order of receipt of which nothing but times [ns] and values is known."""
    none = np.zeros(value.size, dtype=np.int32)
    return Series(measured_ns, measured_ns, value, none.astype(np.uint8), (), none)


def rows_of(table_ns: Ints, measured_ns: Ints) -> Ints:
    """The row of each sample in a sorted table that holds a repeated time in as many rows."""
    order = np.argsort(measured_ns, kind="stable")
    times = measured_ns[order]
    rows = np.empty(times.size, dtype=np.int64)
    rows[order] = np.searchsorted(table_ns, times) + np.arange(times.size) - np.searchsorted(times, times)
    return np.minimum(rows, table_ns.size - 1)


def judged_as(channel: Channel) -> tuple[str, str]:
    """Group and unit that a channel is judged by, recorded as an auxiliary one or not: a rudder and an order are
    commands, the wind on board is wind."""
    if is_setting(channel):
        return "command", channel.unit
    return ("environment" if channel.name.startswith("apparent_wind_") else channel.group), channel.unit


def is_assumed(table: pd.DataFrame, name: str) -> bool:
    """Whether a channel's values were assumed at an import and not measured."""
    return bool(table.attrs.get("sources", {}).get(name) == [ASSUMED])


def sort_by_time(samples: Series, channel: Channel) -> tuple[Ints, Ints, Floats]:
    """Which samples have a value, in the order of measured time: their places, times [ns], values.

    Angles come unwrapped, so that differences are turns.
    """
    order = np.argsort(samples.measured_ns, kind="stable")
    order = order[np.isfinite(samples.value[order])]
    values = samples.value[order]
    return order, samples.measured_ns[order], unwrap(values) if channel.circular else values


def interval_ns(times_ns: Ints) -> float:
    """The channel's own interval [ns]: the median of its steps in time, without those of no length."""
    steps = np.diff(np.sort(times_ns))
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 0.0


def white_noise(values: Floats) -> float:
    """Standard deviation of what differs from sample to sample, whatever the slow motion is.

    From third differences (weights 1, -3, 3, -1; their squares sum to 20) by the median of their size, so that
    outliers and short manoeuvres do not count.
    """
    if values.size < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 3))) / 0.6745 / np.sqrt(20.0))


def stretches_of(times: Ints, flagged: Bools) -> list[Stretch]:
    """Runs of flagged samples, measured at ``times`` [ns], as stretches, sized by their number of samples."""
    starts, ends = runs(flagged)
    pairs = ((sorted((int(times[a]), int(times[b - 1]))), b - a) for a, b in zip(starts, ends, strict=True))
    return [Stretch(first, last, float(count)) for (first, last), count in pairs]


@dataclass(frozen=True, slots=True)
class Samples:
    """The values that one channel has: their ``rows`` in the table, times [s] and values, all of shape [n]."""

    rows: Ints
    time_s: Floats
    value: Floats


def samples_of(table: pd.DataFrame, name: str) -> Samples:
    """The finite values of a channel at distinct times; of a repeated time the first. Empty if it is lacking."""
    if name not in table:
        return Samples(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    value = table[name].to_numpy(dtype=float)
    time_ns = times_ns(table)
    rows = np.flatnonzero(np.isfinite(value))
    rows = rows[np.concatenate([[True], np.diff(time_ns[rows]) > 0])] if rows.size else rows
    return Samples(rows, seconds_of(table)[rows], value[rows])


def runs(mask: Bools) -> tuple[Ints, Ints]:
    """First and one past the last index of every stretch of ``True``.

    >>> [ends.tolist() for ends in runs(np.array([True, False, True, True]))]
    [[0, 2], [1, 4]]
    """
    edges = np.diff(np.concatenate([[0], np.asarray(mask, np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def mask_of_runs(first: Ints, stop: Ints, count: int) -> Bools:
    """Whether each of ``count`` samples lies in one of the stretches: the inverse of :func:`runs`."""
    edges = np.zeros(count + 1, np.int64)
    np.add.at(edges, first, 1)
    np.add.at(edges, stop, -1)
    return np.cumsum(edges[:-1]) > 0


def robust_spread(values: Floats) -> float:
    """A standard deviation that outliers do not affect: 1.4826 median |x|."""
    return float(1.4826 * np.median(np.abs(values))) if values.size else 0.0


def runs_of_equal(changes: Bools) -> tuple[Ints, Ints]:
    """First samples and lengths of the runs of one value; ``changes`` [n - 1] says where the next sample differs.

    >>> [each.tolist() for each in runs_of_equal(np.array([False, True, False]))]
    [[0, 2], [2, 2]]
    """
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1])
    return starts, np.diff(np.append(starts, changes.size + 1))


def jackknife_error(estimates: Floats) -> Floats:
    """Standard errors [...] from estimates [n, ...] of which each leaves out one of n parts.

    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982.
    """
    count = len(estimates)
    return np.asarray(np.sqrt((count - 1) / count * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0)))


def ratios_without_each(numerators: NDArray[Any], denominators: NDArray[Any]) -> NDArray[Any]:
    """The ratio of the sums of n parts, each part left out in turn: [n], as a jackknife wants it."""
    remaining = np.maximum(denominators.sum() - denominators, 1e-12)
    return np.asarray((numerators.sum() - numerators) / remaining)
