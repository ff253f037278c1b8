"""What every step expects of a table: a UTC index named ``time`` that counts in nanoseconds.

pandas counts in microseconds unless told otherwise; the arithmetic here is done on int64 nanoseconds.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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


def index_of(time_ns: NDArray[np.int64]) -> pd.DatetimeIndex:
    """Times [ns since 1970] as the index of a table."""
    return pd.DatetimeIndex(time_ns.astype("datetime64[ns]"), name="time").tz_localize("UTC")
