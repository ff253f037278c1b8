"""Runs of samples: what the checks share to look at stretches instead of single values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from acquisition.core.arrays import Bools, Floats, Ints
from acquisition.core.frames import Quality
from analysis.tables.time_index import NANO, times_ns


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
    since_s = (time_ns[rows] - (time_ns[0] if time_ns.size else 0)) / NANO
    return Samples(rows, since_s, value[rows])


def runs(mask: Bools) -> tuple[Ints, Ints]:
    """First and one past the last index of every stretch of ``True``.

    >>> [ends.tolist() for ends in runs(np.array([True, False, True, True]))]
    [[0, 2], [1, 4]]
    """
    edges = np.diff(np.concatenate([[0], np.asarray(mask, np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def covered(first: Ints, stop: Ints, count: int) -> Bools:
    """Whether each of ``count`` samples lies in one of the stretches: the inverse of :func:`runs`."""
    edges = np.zeros(count + 1, np.int64)
    np.add.at(edges, first, 1)
    np.add.at(edges, stop, -1)
    return np.cumsum(edges[:-1]) > 0


def scatter(values: Floats) -> float:
    """The standard deviation of the bulk of ``values``, which outliers do not move: 1.4826 median |x|."""
    return float(1.4826 * np.median(np.abs(values))) if values.size else 0.0


def median_step_s(time_s: Floats) -> float:
    """The usual time between samples [s]; 0 for fewer than two."""
    return float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0


def integral(rate: Samples) -> Floats:
    """By the trapezoidal rule, from 0 at the first sample."""
    steps = 0.5 * (rate.value[1:] + rate.value[:-1]) * np.diff(rate.time_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def mark(flags: pd.DataFrame, name: str, judged: Ints, wrong: Ints, flag: Quality = Quality.BAD) -> None:
    """Write into a check's fresh ``flags``: the ``judged`` rows of a channel are good but for the ``wrong``."""
    column = flags[name].to_numpy(copy=True)
    column[judged] = Quality.GOOD
    column[wrong] = flag
    flags[name] = column
