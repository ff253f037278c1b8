"""Times of foreign tables as UTC: day first or month first, in two columns, serial days, counts since 1970.

What a map's ``[time]`` says becomes a column of zoned times, or of seconds, which the rest of the import reads.
"""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime
from typing import Annotated, Any, Literal
from zoneinfo import available_timezones

import numpy as np
import pandas as pd
from pydantic import AfterValidator, ConfigDict
from pydantic.dataclasses import dataclass

from acquisition.core.arrays import Ints
from acquisition.core.errors import InputError
from acquisition.tables.table_files import STORABLE, RawTable, storable

_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)
SERIAL_DAYS = {"excel": ("1899-12-30", 0.0), "matlab": ("1970-01-01", 719_529.0)}
"""The day that serial days count from, and its number: Excel's 1900 system, MATLAB's ``datenum``."""
NS_IN = {"ns": 1, "us": 1_000, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9, "d": 86_400 * 10**9}
"""How many nanoseconds each unit of counted time has."""
_FRACTION = r"(:\d{2}|\d{6})[.,](\d+)"
_LAST_NS = pd.Timestamp(STORABLE[1]).value
_MOST_DIGITS = 1e15  # more than a number keeps exactly, and than a date has
_HALF_DAY = pd.Timedelta(hours=12)
_DIGITS = {"%H%M%S": 6, "%d%m%y": 6, "%y%m%d": 6, "%m%d%y": 6, "%Y%m%d": 8, "%d%m%Y": 8, "%Y%m%d%H%M%S": 14}


def known_zone(zone: str) -> str:
    """A zone's name; :class:`ValueError` for another text."""
    if zone not in available_timezones():
        raise ValueError("is no time zone; write UTC, or a name like Europe/Oslo")
    return zone


def _instant(text: str) -> str:
    try:
        zoned = datetime.fromisoformat(text).tzinfo is not None
    except ValueError as error:
        raise ValueError("is not an ISO 8601 time") from error
    if not zoned:
        raise ValueError("has no zone; add Z or an offset like +02:00")
    return text


IN_NAMES = {
    **dict.fromkeys(("%d", "%m", "%H", "%M", "%S", "%y"), r"\d{1,2}"),
    "%Y": r"\d{4}", "%j": r"\d{3}", "%b": "[A-Za-z]{3}", "%B": "[A-Za-z]+",
}  # fmt: skip
"""What the directives of :meth:`datetime.strptime` that a file's name may hold look like."""


def _in_name(text: str) -> str:
    unknown = set(re.findall("%.?", text)) - set(IN_NAMES)
    if unknown or "%" not in text:
        raise ValueError(f"is no time such as %Y-%m-%d_%H%M%S; known are {' '.join(IN_NAMES)}")
    return text


def _known_format(text: str) -> str:
    if text not in ("iso", "seconds", *SERIAL_DAYS) and "%" not in text:
        raise ValueError("is none of iso, seconds, excel, matlab, nor a form like %d.%m.%Y %H:%M:%S")
    return text


def known_day(text: str) -> str:
    """A day as 2026-05-17; :class:`ValueError` for another text."""
    datetime.strptime(text, "%Y-%m-%d")
    return text


@dataclass(frozen=True, config=_STRICT)
class TimeColumn:
    """The time column: ISO 8601 (``zone`` where the text has none), seconds, or another ``format``.

    Seconds, or what the ``unit`` says, count from ``start``, or from the local time in ``zone`` that the file's
    name holds in the form ``in_name`` (of :meth:`datetime.strptime`), which is that of the first row, or of the
    last where ``name_tells`` the "end". With none of them they are taken for counted since 1970.

    ``format`` may be "excel" or "matlab" for days by their serial number, or a form of :meth:`datetime.strptime`
    for other text; fractions of a second are read besides. The ``date`` may stand in a column of its own; where
    only the time of day is told, ``day`` is that of the first row.
    """

    column: str
    format: Annotated[str, AfterValidator(_known_format)] = "iso"
    zone: Annotated[str, AfterValidator(known_zone)] | None = None
    start: Annotated[str, AfterValidator(_instant)] | None = None
    in_name: Annotated[str, AfterValidator(_in_name)] | None = None
    name_tells: Literal["start", "end"] = "start"
    unit: Literal["ns", "us", "ms", "s", "min", "h", "d"] = "s"
    date: str | None = None
    day: Annotated[str, AfterValidator(known_day)] | None = None


def resolve_times(raw: RawTable, time: TimeColumn) -> tuple[RawTable, TimeColumn]:
    """The table with its times in one column that is ISO 8601 or seconds, and what then says so.

    Cells that cannot be read become NaT. Raises :class:`InputError` for a time without a zone and a map that gives
    none.
    """
    column = raw.columns[time.column]
    if time.format == "seconds":
        if time.unit == "s":
            return raw, time
        if time.start is None and time.in_name is None:
            return _with(raw, time, _counted(column, time.unit))
        seconds = pd.to_numeric(column, errors="coerce") * (NS_IN[time.unit] / NS_IN["s"])
        return replace(raw, columns=raw.columns.assign(**{time.column: seconds})), replace(time, unit="s")
    if time.format in SERIAL_DAYS:
        return _with(raw, time, _zoned(raw, _from_serial_days(column, time.format), time))
    if time.format == "iso" and time.date is None and time.day is None:
        return raw, time
    return _with(raw, time, _from_form(raw, time))


def _with(raw: RawTable, time: TimeColumn, times: pd.Series[Any]) -> tuple[RawTable, TimeColumn]:
    columns = raw.columns.assign(**{time.column: times})
    return replace(raw, columns=columns), TimeColumn(time.column, zone=time.zone)


def _counted(column: pd.Series[Any], unit: str) -> pd.Series[Any]:
    """Counts since 1970 as UTC, whole numbers without a detour over floats."""
    numbers = pd.to_numeric(column, errors="coerce")
    values = numbers.to_numpy(dtype=float)
    valid = (values >= 0.0) & (values < _LAST_NS / NS_IN[unit])
    if numbers.dtype.kind in "iu":
        ns: Ints = numbers.to_numpy().astype(np.int64) * NS_IN[unit]
    else:
        whole = np.floor(np.where(valid, values, 0.0))
        part = np.rint((np.where(valid, values, 0.0) - whole) * NS_IN[unit])
        ns = whole.astype(np.int64) * NS_IN[unit] + part.astype(np.int64)
    ns = np.where(valid, ns, np.iinfo(np.int64).min)  # NaT
    return pd.Series(pd.DatetimeIndex(ns.astype("datetime64[ns]"), tz="UTC"), index=column.index)


def _from_serial_days(column: pd.Series[Any], system: str) -> pd.Series[Any]:
    """Local times of serial days, rounded to the microseconds that a float of them is good for."""
    since, number = SERIAL_DAYS[system]
    days = pd.to_numeric(column, errors="coerce") - number
    days = days.where(days.abs() < _LAST_NS / NS_IN["d"])
    return pd.Timestamp(since) + pd.to_timedelta((days * 86_400e6).round(), unit="us")


def _zoned(raw: RawTable, local: pd.Series[Any], time: TimeColumn) -> pd.Series[Any]:
    if isinstance(local.dtype, pd.DatetimeTZDtype):
        return storable(local)
    if time.zone is None:
        fix = 'give zone = "UTC", or a name like "Europe/Oslo", under [time] in the map'
        raise InputError(f"times of column {time.column!r} have no zone", where=str(raw.path), fix=fix)
    naive = storable(local).dt
    zoned: pd.Series[Any] = naive.tz_localize(time.zone, ambiguous="NaT", nonexistent="NaT").dt.tz_convert("UTC")
    return zoned


def _from_form(raw: RawTable, time: TimeColumn) -> pd.Series[Any]:
    form = time.format
    if time.date is None:
        text = cells_as_text(raw.columns[time.column], form)
    else:
        date_form, _, time_form = form.partition(" ") if form != "iso" else ("iso", "", "iso")
        dates = cells_as_text(raw.columns[time.date], date_form).str.replace(r"[T ]00:00(:00)?$", "", regex=True)
        text = dates + " " + cells_as_text(raw.columns[time.column], time_form)
    if time.day is not None:
        text, form = f"{time.day} " + text, form if form == "iso" else f"%Y-%m-%d {form}"
    local = parse_form(text, form)
    if time.day is not None:
        local = local + pd.to_timedelta((local.ffill().diff() < -_HALF_DAY).cumsum(), unit="D")
    return _zoned(raw, local, time)


def cells_as_text(column: pd.Series[Any], form: str) -> pd.Series[Any]:
    """Cells as text; numbers, that lost their leading zeros, with as many digits as the form has."""
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return column.astype("str").where(column.notna())
    is_share_of_day = form not in _DIGITS and column.dropna().between(0.0, 1.0, inclusive="left").all()
    if is_share_of_day:  # as a spreadsheet has times
        since = pd.Timestamp(0) + pd.to_timedelta((column * 86_400e6).round(), unit="us")
        return since.dt.strftime("%H:%M:%S.%f").where(column.notna())
    digits = _DIGITS.get(form, 1)
    micros = (column.where(column.abs() < _MOST_DIGITS) * 1e6).round()
    text = [
        f"{int(each // 1_000_000):0{digits}d}" + (f".{int(each % 1_000_000):06d}" if each % 1_000_000 else "")
        for each in micros.fillna(0.0)
    ]
    return pd.Series(text, index=column.index).where(column.notna())


def parse_form(text: pd.Series[Any], form: str) -> pd.Series[Any]:
    """Local times, or UTC where the text has offsets; NaT for what is not of the form.

    Fractions of a second may follow the seconds after a point or a comma, in some rows or in all.
    """
    if form == "iso":
        return storable(pd.to_datetime(text, format="ISO8601", errors="coerce"))
    text = text.str.strip().str.replace(r"\s*(?:UTC|GMT|Z)$", "", regex=True)
    fraction = text.str.extract(_FRACTION, expand=True)[1]
    base = text.str.replace(_FRACTION, r"\1", regex=True) if fraction.notna().any() else text
    times = pd.to_datetime(base, format=form, errors="coerce", utc="%z" in form)
    nanoseconds = pd.to_numeric(fraction.str.ljust(9, "0").str[:9]).fillna(0.0)
    exact: pd.Series[Any] = storable(times) + pd.to_timedelta(nanoseconds, unit="ns")
    return exact
