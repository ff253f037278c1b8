"""How long one recording can be, and the samples whose stamps lie outside it.

A clock that starts in 1970 until it hears a satellite, or a stamp with a wrong year, would make any regular grid
longer than memory holds. Such stamps are told from the others by the way between them, which no trial takes.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from acquisition.core.arrays import Ints
from acquisition.core.errors import InputError

LONGEST_DAYS = 31
"""Of one recording; whoever claims more had his clock set while he recorded."""

DAY_NS = 86_400 * 1_000_000_000


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


def refuse_endless(first_ns: int, last_ns: int, times: Iterable[Ints], where: str = "") -> None:
    """Raise :class:`InputError` where a span [ns] is longer than one recording can be, and name the stamps.

    ``times`` of all channels [ns] are only looked at to name them.
    """
    if _within_limit(first_ns, last_ns):
        return
    every = np.concatenate(list(times))
    first, last = main_stretch(every)
    stray = every[(every < first) | (every > last)]
    days = (last_ns - first_ns) / DAY_NS
    why = f"{stray.size:,} of {every.size:,} are stamped {stamped(stray)}" if stray.size else "its clock was set"
    raise InputError(
        f"its samples lie within {days:,.0f} days, more than the {LONGEST_DAYS} of one recording", where=where,
        why=why, fix="see `seatrial check`; `check --repair OUT.mcap` takes a few such samples out",
    )  # fmt: skip


def stamped(time_ns: Ints) -> str:
    """When samples are stamped, for people: one time, or from the first to the last."""
    first, last = (pd.Timestamp(int(each), tz="UTC") for each in (time_ns.min(), time_ns.max()))
    text = f"{first:%Y-%m-%d %H:%M:%S}"
    return text if first == last else f"{text} to {last:%Y-%m-%d %H:%M:%S}"


def _within_limit(first_ns: int, last_ns: int) -> bool:
    return last_ns - first_ns <= LONGEST_DAYS * DAY_NS
