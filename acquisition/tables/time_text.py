"""Times as text in a table's cells, its name and the lines before its header, for the one reader of dates.

Numbers that lost their leading zeros or the signs between their parts are written out for it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.times import Stamp, find_stamp
from seatrial.acquisition.tables.table_files import RawTable

_MICRO = 1_000_000
_MOST_DIGITS = 1e15  # more than a number keeps exactly, and than a date has
MIDNIGHT = re.compile(r"[T ]00:00(:00(\.0+)?)?$")
_NAME_CLOCK = re.compile(r"(\d\d)[-_.:h](\d\d)[-_.:m](\d\d)(?=\D*$)")
_DATE_OR_TIME = re.compile(r"\W*(date|time)[\s:;,=]+((?:[^\t;,]|(?<=:\d\d),(?=\d+(?:\s|$)))+)", re.IGNORECASE)
_START = re.compile(r"start|begin|began|recorded|aufzeichnung|debut|inicio|inizio", re.IGNORECASE)


def distinct_dates(stamps: Sequence[Stamp]) -> list[Stamp]:
    """One stamp of each date, which decide about the order as all of them do."""
    return list({stamp.numbers: stamp for stamp in reversed(stamps)}.values())[::-1]


def stamps_in(raw: RawTable, column: str, date: str | None = None, day: str | None = None) -> list[Stamp | None]:
    """The date and time of each row; of the time of day alone with the ``day``."""
    text = as_clock(raw.columns[column]) if date is not None or day is not None else as_text(raw.columns[column])
    if day is not None:
        text = f"{day} " + text
    elif date is not None:
        text = as_date(raw.columns[date]) + " " + text
    return [whole_stamp(cell) if isinstance(cell, str) else None for cell in text.tolist()]


def whole_stamp(text: str) -> Stamp | None:
    """The date and time that a text is; None for one with other numbers beside.

    >>> whole_stamp("Sun 17.05.2026 12.30").text, whole_stamp("2026-05-17 12:00:00 7")
    ('17.05.2026 12:30', None)
    """
    text = re.sub(r"(?<=[\dT] )(\d{1,2})\.(\d\d)$", r"\1:\2", text.strip())
    stamp = find_stamp(text)
    return stamp if stamp is not None and not re.search(r"\d", text.replace(stamp.text, "", 1)) else None


def as_text(column: pd.Series[Any]) -> pd.Series[Any]:
    """Cells as text; numbers with the 14 digits of a date and time."""
    return with_digits(column, 14) if pd.api.types.is_numeric_dtype(column.dtype) else filled_text(column)


def as_date(column: pd.Series[Any]) -> pd.Series[Any]:
    """Dates as text; of numbers, that lost their leading zeros, the parts of six or eight digits apart."""
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return filled_text(column).str.replace(MIDNIGHT, "", regex=True)
    if column.max() < _MICRO:
        return with_digits(column, 6).str.replace(r"^(\d\d)(\d\d)(\d\d)$", r"\1-\2-\3", regex=True)
    text = with_digits(column, 8)
    year_first = text.str[:2].isin(["19", "20"]) & (text.str[4:6] <= "12")
    parts = r"^(\d{4})(\d\d)(\d\d)$" if year_first[text.notna()].all() else r"^(\d\d)(\d\d)(\d{4})$"
    return text.str.replace(parts, r"\1-\2-\3", regex=True)


def as_clock(column: pd.Series[Any]) -> pd.Series[Any]:
    """Times of day as text; of numbers the parts of hhmmss apart, or the share of a day that spreadsheets have."""
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return filled_text(column).str.replace(r"^(\d{1,2})\.(\d\d)$", r"\1:\2", regex=True)
    if column.dropna().between(0.0, 1.0, inclusive="left").all():
        since = pd.Timestamp(0) + pd.to_timedelta((column * 86_400e6).round(), unit="us")
        return since.dt.strftime("%H:%M:%S.%f").where(column.notna())
    return with_digits(column, 6).str.replace(r"^(\d\d)(\d\d)(\d\d)", r"\1:\2:\3", regex=True)


def filled_text(column: pd.Series[Any]) -> pd.Series[Any]:
    """Cells as text, but empty ones."""
    return column.astype("str").where(column.notna())


def with_digits(column: pd.Series[Any], digits: int) -> pd.Series[Any]:
    """Numbers with at least so many digits, their microseconds besides."""
    valid = ((column >= 0.0) & (column < _MOST_DIGITS)).to_numpy()
    numbers = np.where(valid, column.to_numpy(dtype=float), 0.0)
    whole_seconds = np.floor(numbers)
    micros = np.rint((numbers - whole_seconds) * _MICRO).astype(np.int64)
    seconds = whole_seconds.astype(np.int64) + micros // _MICRO
    pairs = zip(seconds.tolist(), (micros % _MICRO).tolist(), strict=True)
    text = [f"{second:0{digits}d}" + (f".{micro:06d}" if micro else "") for second, micro in pairs]
    return pd.Series(text, index=column.index, dtype="str").where(valid)


def time_in_head(lines: Sequence[str]) -> str | None:
    """The date and time of the start in the lines before a header, ISO 8601; None where none or several are stated.

    >>> time_in_head(["Start of log: 17.05.2026 12:00:00", "Exported 2026-06-01 08:00:00"])
    '2026-05-17T12:00:00'
    >>> time_in_head(["Date\t2026/05/17", "Time\t12:00:00.25"])
    '2026-05-17T12:00:00.250000'
    """
    pairs = {match[1].lower(): match[2] for match in map(_DATE_OR_TIME.match, lines) if match}
    stated = [*lines, f"start {pairs['date']} {pairs['time']}"] if len(pairs) > 1 else lines
    stamps = [
        (line, stamp)
        for line in stated
        if (stamp := find_stamp(line)) and len(stamp.orders) == 1 and stamp.has_year
    ]
    begins = [stamp for line, stamp in stamps if _START.search(line)] or [stamp for _, stamp in stamps]
    starts = {stamp.local_ns(stamp.orders[0]) for stamp in begins}
    return pd.Timestamp(starts.pop()).isoformat() if len(starts) == 1 else None


def time_in_name(name: str) -> str | None:
    """The date and time in a file's name, ISO 8601; None where there is none, or one that may be two.

    >>> time_in_name("zigzag_31-Jul-2020_13_22_52.csv.gz"), time_in_name("run 20260517_120000.csv")
    ('2020-07-31T13:22:52', '2026-05-17T12:00:00')
    """
    stamp = find_stamp(_NAME_CLOCK.sub(r" \1:\2:\3", name)) or find_stamp(name)
    if stamp is None or len(stamp.orders) > 1 or not stamp.has_year:
        return None
    return pd.Timestamp(stamp.local_ns(stamp.orders[0])).isoformat()
