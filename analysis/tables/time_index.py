"""The times of a table: a UTC index named ``time`` in nanoseconds, and how long one recording can be.

pandas counts in microseconds unless asked otherwise; the arithmetic here is done on int64 nanoseconds. A clock that
starts in 1970 until it receives a satellite, or a stamp with a wrong year, would make any regular grid longer than
memory holds: such stamps are told from the others by the silence between them, which no trial contains.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Floats, Ints
from acquisition.core.errors import InputError

NANO = 1_000_000_000


def utc_index(table: pd.DataFrame) -> pd.DatetimeIndex:
    """The table's index in UTC and nanoseconds.

    Raises :class:`InputError` when the index is no time or has no zone.
    """
    index = table.index
    if not isinstance(index, pd.DatetimeIndex):
        raise InputError(f"the table is indexed by {index.dtype}, not by time", fix="give it a UTC DatetimeIndex")
    if index.tz is None:
        raise InputError("the table's times have no zone", fix="localise the index to UTC")
    return index.tz_convert("UTC").as_unit("ns").rename("time")


def times_ns(table: pd.DataFrame) -> NDArray[np.int64]:
    """The table's times [ns since 1970], in the order of its rows."""
    return utc_index(table).asi8


def seconds_of(table: pd.DataFrame) -> Floats:
    """The table's times [s] after its first row, in the order of its rows."""
    time_ns = times_ns(table)
    return np.asarray((time_ns - time_ns[:1]) / NANO)


def index_of(time_ns: NDArray[np.int64]) -> pd.DatetimeIndex:
    """Times [ns since 1970] as the index of a table."""
    return pd.DatetimeIndex(time_ns.astype("datetime64[ns]"), name="time").tz_localize("UTC")


LONGEST_DAYS = 31
"""Of one recording; whoever claims more had his clock set while he recorded."""

DAY_NS = 86_400 * NANO


def main_stretch(time_ns: Ints) -> tuple[int, int]:
    """The first and the last time [ns] of the recording proper: of the parts between silences of more than
    :data:`LONGEST_DAYS`, the one with the most samples.

    ``time_ns`` may be in any order, and holds one time at least.

    >>> main_stretch(np.array([0, 1, 2, 400 * DAY_NS]))
    (0, 2)
    """
    times = np.sort(time_ns)
    if _within_limit(int(times[0]), int(times[-1])):
        return int(times[0]), int(times[-1])
    parts = np.split(times, np.flatnonzero(np.diff(times) > LONGEST_DAYS * DAY_NS) + 1)
    longest = max(parts, key=len)
    return int(longest[0]), int(longest[-1])


def require_plausible_span(first_ns: int, last_ns: int, times: Iterable[Ints], where: str = "") -> None:
    """Raise :class:`InputError` where a span [ns] is longer than one recording can be, and name the stamps.

    ``times`` of all channels [ns] are only looked at to name them.
    """
    if _within_limit(first_ns, last_ns):
        return
    every = np.concatenate(list(times))
    first, last = main_stretch(every)
    stray = every[(every < first) | (every > last)]
    days = (last_ns - first_ns) / DAY_NS
    why = (
        f"{stray.size:,} of {every.size:,} are stamped {time_span_text(stray)}"
        if stray.size
        else "its clock was set"
    )
    raise InputError(
        f"its samples lie within {days:,.0f} days, more than the {LONGEST_DAYS} of one recording", where=where,
        why=why, fix="see `seatrial check`; `check --repair OUT.mcap` takes a few such samples out",
    )  # fmt: skip


def time_span_text(time_ns: Ints) -> str:
    """When samples are stamped, for people: one time, or from the first to the last."""
    first, last = (pd.Timestamp(int(each), tz="UTC") for each in (time_ns.min(), time_ns.max()))
    text = f"{first:%Y-%m-%d %H:%M:%S}"
    return text if first == last else f"{text} to {last:%Y-%m-%d %H:%M:%S}"


def _within_limit(first_ns: int, last_ns: int) -> bool:
    return last_ns - first_ns <= LONGEST_DAYS * DAY_NS
