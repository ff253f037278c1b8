"""Resolves the times of a table's rows to UTC: text of any form, in one column or two, digits, serial days, counts.

What a map's ``[time]`` states becomes one index of UTC times, in the order in which the rows were written. Numbers
that lost leading zeros or separators are written out for :func:`seatrial.acquisition.core.times.find_stamp`. Local
times become UTC by zones, offsets and GPS time; at the end of summer time the order of the rows decides to which of
the two hours a row belongs.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass as plain_dataclass
from dataclasses import replace
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
from pydantic import AfterValidator, ConfigDict
from pydantic.dataclasses import dataclass

from seatrial.acquisition.core import times, trial
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Bools, Ints
from seatrial.acquisition.tables.table_files import RawTable, parse_numbers

_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)
_COARSE_S = 1e9  # seconds that a float holds to the microsecond
SERIAL_DAYS = {
    "excel": ("1899-12-30", 0.0),
    "matlab": ("1970-01-01", 719_529.0),
    "julian": ("1970-01-01", 2_440_587.5),
    "mjd": ("1970-01-01", 40_587.0),
}
"""The day that serial days count from, and its number: Excel's 1900 system, MATLAB's ``datenum``, Julian days as of
SQLite's ``julianday``, modified Julian days."""
NS_IN = {"ns": 1, "us": 1_000, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9, "d": 86_400 * 10**9}
"""The nanoseconds in each unit of counted time."""
STORABLE = "1970-01-01", "2262-01-01"
"""The first day of a recording's times, and the first beyond: they are nanoseconds since 1970."""
PART_NS = {
    "hour": NS_IN["h"], "minute": NS_IN["min"], "second": NS_IN["s"],
    "millisecond": NS_IN["ms"], "microsecond": NS_IN["us"], "nanosecond": NS_IN["ns"],
}  # fmt: skip
"""The nanoseconds in each part of a time of day, which may be counted from midnight."""
FRACTIONS = ("millisecond", "microsecond", "nanosecond")
"""The parts that complete a time whose cells are whole seconds."""
Part = Literal[
    "year", "month", "day", "day_of_year", "hour", "minute", "second", "millisecond", "microsecond", "nanosecond"
]
_PARTS_OF_LIST = ("year", "month", "day", "hour", "minute", "second")
GPS_WEEK = "gps-week"
"""The format of times in weeks of GPS, counted since 6 January 1980, and times of the week."""
TEXT = "text"
"""The format of times that :func:`seatrial.acquisition.core.times.find_stamp` reads."""
_FRACTION = r"(:\d{2}|\d{6})[.,](\d+)"
ZONED = r"\d[T ]\d\d.*(?:[Zz]|[+-]\d\d(?::?\d\d)?)\s*$"
_ZONE_AT_END = r"\s*(?:[Zz]|[+-]\d\d(?::?\d\d)?)\s*$"
_NO_TIME = np.iinfo(np.int64).min
_LAST_NS = pd.Timestamp(STORABLE[1]).value
_FIRST_TIME = pd.Timestamp("1678-01-01")  # that nanoseconds before 1970 reach
_MICRO = 1_000_000
_WEEK_NS = 7 * times.DAY_NS
_GPS_EPOCH_NS = pd.Timestamp("1980-01-06").value
_MOST_WEEKS = 10_000  # the year 2171
_DIGITS = {"%H%M%S": 6, "%d%m%y": 6, "%y%m%d": 6, "%m%d%y": 6, "%Y%m%d": 8, "%d%m%Y": 8, "%Y%m%d%H%M%S": 14}
_NEWEST_FIRST = 0.9  # of the steps go back
_FEW_SETBACKS = 0.01  # of the rows: a clock that was set, or files put together
_MOST_OF_DAY_NS = times.DAY_NS - 3600 * trial.NANO
_FEWEST_ROWS, _ROWS_A_STAMP = 10, 1.5  # with fewer to a stamp, some of them come twice
_COARSEST_NS = 60 * trial.NANO  # stamps further apart are no cut-off times of a trial
_COUNTER, _LONGEST_TURN_NS = 2**32, 60 * trial.NANO
_SET_NS = pd.Timestamp("1990-01-01").value  # clocks that are not set start in 1970 or 1980


def _checked_instant(text: str) -> str:
    try:
        zoned = dt.datetime.fromisoformat(text).tzinfo is not None
    except ValueError as error:
        raise ValueError("is not an ISO 8601 time") from error
    if not zoned:
        raise ValueError("has no zone; add Z or an offset like +02:00")
    return text


_NAME_DIRECTIVES = {
    **dict.fromkeys(("%d", "%m", "%H", "%M", "%S", "%y"), r"\d{1,2}"),
    "%Y": r"\d{4}", "%j": r"\d{3}", "%b": "[A-Za-z]{3}", "%B": "[A-Za-z]+",
}  # fmt: skip
"""The forms of the directives of :meth:`datetime.strptime` that a file's name may hold."""


def _checked_name_form(text: str) -> str:
    unknown = set(re.findall("%.?", text)) - set(_NAME_DIRECTIVES)
    if text != TEXT and (unknown or "%" not in text):
        raise ValueError(f"is no time such as %Y-%m-%d_%H%M%S, nor {TEXT}; known are {' '.join(_NAME_DIRECTIVES)}")
    return text


def _checked_format(text: str) -> str:
    if text not in ("iso", "seconds", TEXT, GPS_WEEK, *SERIAL_DAYS) and "%" not in text:
        raise ValueError(
            "is none of iso, text, seconds, gps-week, excel, matlab, julian, mjd nor a form like %d.%m.%Y %H:%M"
        )
    return text


def add_zone_to_instant(instant: str) -> str:
    """A time with its zone, UTC if it names none. Raises :class:`ValueError` for another text."""
    stamp = pd.Timestamp(instant)
    return stamp.isoformat() + ("" if stamp.tz else "+00:00")


def checked_day(text: str) -> str:
    """A day as 2026-05-17; :class:`ValueError` for another text."""
    dt.datetime.strptime(text, "%Y-%m-%d")
    return text


@dataclass(frozen=True, config=_STRICT)
class TimeColumn:
    """The time column: ISO 8601 (``zone`` where the text has none), seconds, or another ``format``.

    Seconds, or counts of another ``unit``, start at ``start``, at the local time in ``zone`` that the file's name
    holds in the form ``in_name`` (of :meth:`datetime.strptime`, or "text"), which is that of the first row, or of
    the last if ``name_tells`` is "end", or at the time in the lines before the header (``in_head``); without these
    in 1970, and they are of GPS time or TAI if that is the ``zone``. For other formats ``start`` is the first row's
    time, if the clock that wrote them was wrong.

    ``format`` may be "text" for any usual date and time, with the numbers in ``order``, and of the ``year`` if they
    state none; "excel" or "matlab" for serial days; or a form of :meth:`datetime.strptime`, to which fractions of a
    second may be added. With "gps-week" the ``date`` is the column of the weeks of GPS and ``column`` that of the
    time of the week, in the ``unit``, in GPS time unless ``zone`` is another. The ``date`` may be in a separate
    column; with a time of day only, ``day`` is that of the first row. With ``zone_in_text`` "ignored" a zone in the
    text is. ``parts`` are the columns of the parts of a time by their names, or in a list those of year, month and
    day, then of hour, minute and second. The date is that of the ``date`` or the ``day`` if they name none, or
    1970; without a part of the day ``column`` is the time of day. A part counts from the next coarser
    one, or from midnight. Parts of a second alone complete the time in ``column``.
    """

    column: str
    format: Annotated[str, AfterValidator(_checked_format)] = "iso"
    zone: Annotated[str, AfterValidator(checked_zone)] | None = None
    start: Annotated[str, AfterValidator(_checked_instant)] | None = None
    in_name: Annotated[str, AfterValidator(_checked_name_form)] | None = None
    in_head: bool = False
    name_tells: Literal["start", "end"] = "start"
    unit: Literal["ns", "us", "ms", "s", "min", "h", "d"] = "s"
    date: str | None = None
    day: Annotated[str, AfterValidator(checked_day)] | None = None
    order: times.Order | None = None
    year: int | None = None
    zone_in_text: Literal["used", "ignored"] = "used"
    parts: Mapping[Part, str] | tuple[str, ...] = ()

    @property
    def column_by_part(self) -> dict[str, str]:
        """The columns of the parts of a time."""
        if isinstance(self.parts, Mapping):
            return {str(part): column for part, column in self.parts.items()}
        return dict(zip(_PARTS_OF_LIST, self.parts, strict=False))

    @property
    def is_of_parts(self) -> bool:
        """Whether the time is put together from parts, and not only completed by one."""
        return not set(self.column_by_part) <= {*FRACTIONS} or self.column in self.column_by_part.values()


@plain_dataclass(frozen=True, slots=True)
class TimedRows:
    """A table with the UTC times of its rows, NaT for none, in the order in which the rows were written."""

    raw: RawTable
    index: pd.DatetimeIndex
    remarks: tuple[str, ...] = ()


def resolve_times(raw: RawTable, time: TimeColumn, *, strict: bool = False) -> TimedRows:
    """The times of a table's rows. Raises :class:`InputError` for times without a zone, in the text or the map.

    Unreadable cells become NaT; with ``strict`` the first of them is an error.
    """
    if time.format == "seconds" and strict:
        parse_numbers(raw, time.column)
    remarks, counts = list(raw.remarks), raw.columns[time.column]
    if time.format == "seconds" and counts.dtype.kind in "iu":
        turns = _turns_of_counter(counts.to_numpy().astype(np.int64), NS_IN[time.unit])
        if turns.any():
            row = int(np.flatnonzero(turns)[0]) + 1
            remarks.append(f"the counter {time.column!r} began again after 2^32 in row {row}: it runs on")
            running = counts.astype(np.int64) + _COUNTER * turns
            raw = replace(raw, columns=raw.columns.assign(**{time.column: running}))
    local_ns, is_utc = _local_times(raw, time)
    if not time.is_of_parts:
        fraction_ns = _ns_of_parts(_numbers_of_parts(raw, time))
        local_ns = np.where((local_ns == _NO_TIME) | (fraction_ns == _NO_TIME), local_ns, local_ns + fraction_ns)
    steps = np.diff(local_ns[local_ns != _NO_TIME])
    if np.count_nonzero(steps < 0) > max(1, _NEWEST_FIRST * steps.size):
        raw = replace(raw, columns=raw.columns.iloc[::-1].reset_index(drop=True))
        local_ns, is_utc = local_ns[::-1], is_utc[::-1]
        remarks.append("the newest row came first: the rows are turned round")
    if time.day is not None or time.date is not None or time.is_of_parts:
        local_ns, remark = _run_on_past_midnight(local_ns, time)
        remarks += [remark] if remark else []

    time_ns = local_ns.copy()
    naive = ~is_utc & (local_ns != _NO_TIME)
    if naive.any():
        zone = time.zone or (GPS if time.format == GPS_WEEK else None)
        if zone is None:
            row = int(np.flatnonzero(naive)[0])
            what = f"row {row + 1} of column {time.column!r} has no zone: {raw.columns[time.column].iloc[row]}"
            fix = "write times like 2026-05-17T12:00:00Z, use --answer zone=UTC, or give"
            raise InputError(what, where=str(raw.path), fix=f'{fix} zone = "UTC" under [time] in a map')
        time_ns[naive], remark = local_times_to_utc(local_ns[naive], zone)
        remarks += [remark] if remark else []
    if time.format != "seconds" and time.start is not None and (valid := time_ns != _NO_TIME).any():
        time_ns[valid] += pd.Timestamp(time.start).as_unit("ns").value - time_ns[valid][0]

    time_ns, clock_remarks = _storable_times(time_ns, time)
    unread = np.flatnonzero(time_ns == _NO_TIME)
    if strict and unread.size:
        cell = raw.columns[time.column].iloc[unread[0]]
        form = "an ISO 8601 time" if time.format in ("iso", "seconds") else f"a time of the form {time.format}"
        what = "has no time" if pd.isna(cell) else f"holds {str(cell)!r}, which is not {form}"
        what, why = f"row {unread[0] + 1} of column {time.column!r} {what}", f"{unread.size} such rows"
        fix = "give every row a time like 2026-05-17T12:00:00Z, of the years 1970 to 2261"
        raise InputError(what, where=str(raw.path), why=why, fix=fix)
    count = np.count_nonzero(np.diff(time_ns[time_ns != _NO_TIME]) < 0)
    if count > max(3, _FEW_SETBACKS * time_ns.size):
        in_order = np.argsort(time_ns, kind="stable")
        raw = replace(raw, columns=raw.columns.iloc[in_order].reset_index(drop=True))
        time_ns = time_ns[in_order]
        remarks.append(f"the times of {time.column!r} go back in {count:,} rows: the rows are put in their order")
    time_ns, remark = _spread_repeated_stamps(time_ns, raw, time)
    remarks += [remark] if remark else []
    index = pd.DatetimeIndex(time_ns.view("datetime64[ns]"), tz="UTC", name="time")
    return TimedRows(raw, index, (*remarks, *clock_remarks))


def _run_on_past_midnight(local_ns: Ints, time: TimeColumn) -> tuple[Ints, str]:
    """Times of day [n] that run on to the next day where they fall, and a remark, or "".

    Beside a column of dates they fall by a day less a step where the date stands still, or changes later than the
    time of day, and rise by a day where it changes at last.
    """
    valid = local_ns != _NO_TIME
    steps = np.diff(local_ns[valid], prepend=local_ns[valid][:1])
    if time.day is not None:
        days = np.cumsum(steps < -times.DAY_NS // 2)
    else:
        falls = (steps < -_MOST_OF_DAY_NS) & (steps > -times.DAY_NS)
        rises = (np.abs(steps - times.DAY_NS) < _CLOSE_NS) & (np.cumsum(falls) > 0)
        days = np.cumsum(falls.astype(np.int64) - rises)
    local_ns = local_ns.copy()
    local_ns[valid] += days * times.DAY_NS
    if time.day is not None or not days.any():
        return local_ns, ""
    columns = time.column_by_part
    date = time.date or ", ".join(columns[part] for part in _DATE_PARTS if part in columns)
    return local_ns, (
        f"the date in {date!r} stands still while {time.column!r} passes midnight: {np.count_nonzero(days):,}"
        " rows are of the next day"
    )


def _spread_repeated_stamps(time_ns: Ints, raw: RawTable, time: TimeColumn) -> tuple[Ints, str]:
    """Times [n] whose rows have whole seconds or minutes in common, spread evenly until the next, and a remark.

    Not those of rows that complete or repeat each other. Raises :class:`InputError` if all rows have one time.
    """
    valid = np.flatnonzero(time_ns != _NO_TIME)
    starts = np.flatnonzero(np.diff(time_ns[valid], prepend=-1))
    if valid.size < _FEWEST_ROWS or starts.size > valid.size / _ROWS_A_STAMP:
        return time_ns, ""
    rows = raw.columns.iloc[valid]
    if starts.size == 1:
        what = f"has one time in all {valid.size:,} rows, {str(rows[time.column].iloc[0])!r} in {time.column!r}"
        fix = "write the times with all their digits, or name another column"
        raise InputError(what, where=str(raw.path), fix=fix)
    filled = rows.notna().sum()
    differ = (rows.ne(rows.shift()) & rows.notna()).any(axis=1)
    gaps = np.diff(time_ns[valid][starts])
    period, counts = int(np.median(gaps)), np.diff([*starts, valid.size])
    completes = np.median(filled[filled > 0]) < _ROWS_A_STAMP * starts.size
    if completes or differ.mean() < 1.0 / _ROWS_A_STAMP or (gaps < 0).any() or period > _COARSEST_NS:
        return time_ns, ""
    usual = int(np.median(counts))
    before, behind = np.insert(gaps, 0, _LAST_NS) > 1.5 * period, np.append(gaps, _LAST_NS) > 1.5 * period
    places = np.where(before | behind, np.maximum(counts, usual), counts)  # of a stamp, also of rows that lack
    step_ns = np.where(behind, period, np.append(gaps, period)) // places
    first = np.where(before & ~behind, places - counts, 0)
    offset_ns = (np.arange(valid.size) - np.repeat(starts - first, counts)) * np.repeat(step_ns, counts)
    is_rounded = time.format in SERIAL_DAYS
    time_ns = time_ns.copy()
    time_ns[valid] += offset_ns - (period // 2 if is_rounded else 0)
    how = "from half of it before" if is_rounded else "until the next, as if their ends were cut off"
    seconds = f"{period / trial.NANO:g} s"
    return time_ns, (
        f"the times of {time.column!r} go in steps of {seconds}, of about {usual} rows each: the rows are spread"
        f" evenly {how}"
    )


def standard_time_column(raw: RawTable, name: str = "time") -> TimeColumn:
    """The time column of a table in the contract's form: seconds since 1970, or ISO 8601."""
    form = "seconds" if pd.api.types.is_numeric_dtype(raw.columns[name]) else "iso"
    return TimeColumn(name, form, TAI if times.names_tai(raw.units.get(name, "")) else None)


def parse_times(raw: RawTable, name: str) -> pd.DatetimeIndex:
    """A column of ISO 8601 text with a zone, or of seconds since 1970, as UTC times; every row needs one."""
    return resolve_times(raw, standard_time_column(raw, name), strict=True).index


def _local_times(raw: RawTable, time: TimeColumn) -> tuple[Ints, Bools]:
    """The times [ns since 1970], and which are UTC; the others are on their zone's clock."""
    column = raw.columns[time.column]
    if time.is_of_parts:
        return _times_of_parts(raw, time)
    if time.format == "seconds":
        local_ns = _times_from_counts(raw, column, time)
        is_atomic = time.zone in times.ATOMIC_CLOCKS and time.in_name is None and not time.in_head
        return local_ns, np.full(local_ns.size, not is_atomic)
    if time.format in SERIAL_DAYS:
        since, number = SERIAL_DAYS[time.format]
        days = pd.to_numeric(column, errors="coerce") - number
        days = days.where(days.abs() < _LAST_NS / NS_IN["d"])  # a float of days is good to microseconds
        return _as_nanoseconds(pd.Timestamp(since) + pd.to_timedelta((days * 86_400e6).round(), unit="us"))
    if time.format == GPS_WEEK:  # rounded to the microsecond
        weeks, counts = (
            pd.to_numeric(raw.columns[name], errors="coerce").to_numpy(dtype=float)
            for name in (time.date, time.column)
        )
        micros = np.rint(counts * (NS_IN[time.unit] / 1000.0))
        valid = (weeks >= 0.0) & (weeks < _MOST_WEEKS) & (micros >= 0.0) & (micros <= _WEEK_NS / 1000)
        week_ns = np.where(valid, weeks, 0.0).astype(np.int64) * _WEEK_NS
        gps_ns = _GPS_EPOCH_NS + week_ns + np.where(valid, micros, 0.0).astype(np.int64) * 1000
        return np.where(valid, gps_ns, _NO_TIME), np.zeros(gps_ns.size, dtype=bool)
    if time.format == TEXT:
        return _times_of_stamps(raw, time, stamps_of_rows(raw, time.column, time.date, time.day))
    if time.format == "iso" and time.date is None and time.day is None:
        if isinstance(column.dtype, pd.DatetimeTZDtype):
            return _as_nanoseconds(column if time.zone_in_text == "used" else column.dt.tz_localize(None))
        return _parse_iso_times(column.astype("str"), time.zone_in_text == "used")
    return _parse_times_of_form(raw, time)


def _as_nanoseconds(times: pd.Series[Any]) -> tuple[Ints, Bools]:
    """Times as ns since 1970, and whether they are UTC. Times that nanoseconds cannot hold are none."""
    is_utc = isinstance(times.dtype, pd.DatetimeTZDtype)
    naive = times.dt.tz_convert("UTC").dt.tz_localize(None) if is_utc else times
    present = naive.dropna()
    if len(present) and (present < _FIRST_TIME).mean() > 0.5:  # a program's year 1: from the first day of 1970
        naive = naive.dt.as_unit("us") - (present.iloc[0].normalize() - pd.Timestamp(0).as_unit("us"))
    in_range = (naive >= _FIRST_TIME) & (naive < pd.Timestamp(STORABLE[1]))
    values = naive.where(in_range).dt.as_unit("ns").to_numpy()
    return values.astype("datetime64[ns]").view(np.int64), np.full(len(times), is_utc)


_DATE_PARTS = ("year", "month", "day_of_year", "day")
_COARSEST_FIRST = (*_DATE_PARTS, *PART_NS)


def _numbers_of_parts(raw: RawTable, time: TimeColumn) -> dict[str, pd.Series[Any]]:
    """The numbers of the parts of a time, the coarsest first.

    A fraction counts where no finer part stands beside it: that of a day beside an hour is the hour.
    """
    columns = time.column_by_part
    names = [part for part in _COARSEST_FIRST if part in columns]
    numbers = {part: pd.to_numeric(raw.columns[columns[part]], errors="coerce") for part in names}
    has_clock = time.column not in columns.values() and time.is_of_parts
    return {
        part: values if part == names[-1] and not has_clock else np.floor(values)
        for part, values in numbers.items()
    }


def _ns_of_parts(numbers: Mapping[str, pd.Series[Any]]) -> Ints:
    """The sum of parts of a day [ns]; fractions to the microsecond, as those of days and hours are good to."""
    total: Any = 0
    for part, values in numbers.items():
        if part in PART_NS:
            whole = np.floor(values.to_numpy(dtype=float))
            fraction = np.rint((values.to_numpy(dtype=float) - whole) * (PART_NS[part] / 1000.0)) * 1000.0
            valid = (whole >= 0.0) & (whole * float(PART_NS[part]) < float(_LAST_NS))
            ns = np.where(valid, whole, 0.0).astype(np.int64) * PART_NS[part]
            ns += np.where(valid, fraction, 0.0).astype(np.int64)
            total = np.where(valid & (np.asarray(total) != _NO_TIME), total + ns, _NO_TIME)
    return np.asarray(total, dtype=np.int64)


def _times_of_parts(raw: RawTable, time: TimeColumn) -> tuple[Ints, Bools]:
    """Times by the columns of their parts; parts of a day alone are UTC since 1970."""
    numbers = _numbers_of_parts(raw, time)
    if time.date is not None:
        days_ns, _ = _times_of_stamps(raw, time, stamps_of_rows(raw, None, time.date))
    elif numbers.keys() & {*_DATE_PARTS}:
        days_ns = _days_of_parts(numbers, time.year)
    else:
        days_ns = np.full(len(raw.columns), pd.Timestamp(time.day or 0).as_unit("ns").value)
    if time.column in time.column_by_part.values():
        clock_ns = _ns_of_parts(numbers)
    else:
        text = clock_times_as_text(raw.columns[time.column])
        clock_ns, _ = _as_nanoseconds(pd.Timestamp(0) + pd.to_timedelta(text, errors="coerce"))
    has_time = (days_ns != _NO_TIME) & (clock_ns != _NO_TIME)
    is_utc = time.date is None and time.day is None and not numbers.keys() & {*_DATE_PARTS}
    return np.where(has_time, days_ns + clock_ns, _NO_TIME), np.full(has_time.size, is_utc)


def _days_of_parts(numbers: Mapping[str, pd.Series[Any]], stated_year: int | None) -> Ints:
    """The days of rows [ns since 1970], with the fraction of a day or a year where that is the finest part.

    Years of two digits are of this century. The first of January is day 1 of the year.
    """
    rows = next(iter(numbers.values())).index
    year = numbers.get("year", pd.Series(float(stated_year or 1970), rows))
    year = year.where(year >= 100, year + 2000)
    day = numbers.get("day_of_year", numbers.get("day", pd.Series(1.0, rows)))
    first = pd.DataFrame({"year": np.floor(year), "month": numbers.get("month", 1), "day": 1}, index=rows)
    if "day_of_year" not in numbers:
        first["day"], day = np.floor(day), 1.0 + day % 1.0
    start = pd.to_datetime(first, errors="coerce")
    length = 365.0 + start.dt.is_leap_year
    beyond_d = (day - 1.0).where((day >= 1.0) & (day < length + 1.0)) + (year % 1.0) * length
    days_ns, _ = _as_nanoseconds(start + pd.to_timedelta((beyond_d * 86_400e6).round(), unit="us"))
    return days_ns


def _parse_iso_times(text: pd.Series[Any], use_zones: bool) -> tuple[Ints, Bools]:
    """ISO 8601 text, with zones in all rows, in some, or in none."""
    zoned = text.str.contains(ZONED, regex=True, na=False)
    if not use_zones:
        text, zoned = text.str.replace(_ZONE_AT_END, "", regex=True), zoned & False
    utc_ns, _ = _as_nanoseconds(pd.to_datetime(text.where(zoned), format="ISO8601", utc=True, errors="coerce"))
    local_ns, _ = _as_nanoseconds(pd.to_datetime(text.mask(zoned), format="ISO8601", utc=True, errors="coerce"))
    is_utc = zoned.to_numpy(dtype=bool)
    return np.where(is_utc, utc_ns, local_ns), is_utc


def _times_of_stamps(raw: RawTable, time: TimeColumn, stamps: Sequence[times.Stamp | None]) -> tuple[Ints, Bools]:
    """Times by the stamps of the rows; :class:`InputError` for ambiguous dates."""
    present = [stamp for stamp in stamps if stamp is not None]
    order = time.order
    if order is None:
        order, why = times.infer_date_order(distinct_dates(present))
        if present and not why:
            fix = 'say order = "day-first" or "month-first" under [time] in the map'
            what = f"dates like {present[0].text!r} may have the day or the month first"
            raise InputError(what, where=str(raw.path), fix=fix)
    uses_zones = time.zone_in_text == "used"
    local_ns, is_utc = np.full(len(stamps), _NO_TIME), np.zeros(len(stamps), dtype=bool)
    for row, stamp in enumerate(stamps):
        if stamp is not None and order in stamp.orders and (stamp.has_year or time.year is not None):
            is_utc[row] = uses_zones and stamp.offset_s is not None
            year = None if stamp.has_year else time.year
            try:
                local_ns[row] = stamp.utc_ns(order, year) if is_utc[row] else stamp.local_ns(order, year)
            except ValueError:  # the 29th of February in a common year
                continue
    return local_ns, is_utc


def _parse_times_of_form(raw: RawTable, time: TimeColumn) -> tuple[Ints, Bools]:
    """Text of a form of strptime, or ISO 8601 in two columns or of a time of day."""
    form = re.sub("[.,]%f", "", time.format)  # fractions are read separately
    if time.date is None:
        text = _as_text_of_form(raw.columns[time.column], form)
    else:
        date_form, _, time_form = form.partition(" ") if form != "iso" else ("iso", "", "iso")
        dates = _as_text_of_form(raw.columns[time.date], date_form).str.replace(MIDNIGHT, "", regex=True)
        text = dates + " " + _as_text_of_form(raw.columns[time.column], time_form)
    if time.day is not None:
        text, form = f"{time.day} " + text, form if form == "iso" else f"%Y-%m-%d {form}"
    if form == "iso":
        return _parse_iso_times(text, time.zone_in_text == "used")
    text = text.str.strip().str.replace(r"\s*(?:UTC|GMT|Z)$", "", regex=True)
    fraction = text.str.extract(_FRACTION, expand=True)[1]
    base = text.str.replace(_FRACTION, r"\1", regex=True) if fraction.notna().any() else text
    local_ns, is_utc = _as_nanoseconds(pd.to_datetime(base, format=form, errors="coerce", utc="%z" in form))
    part_ns = pd.to_numeric(fraction.str.ljust(9, "0").str[:9]).fillna(0.0).to_numpy(dtype=np.int64)
    return np.where(local_ns == _NO_TIME, _NO_TIME, local_ns + part_ns), is_utc


def _as_text_of_form(column: pd.Series[Any], form: str) -> pd.Series[Any]:
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return filled_cells_as_text(column)
    is_fraction_of_day = form not in _DIGITS and column.dropna().between(0.0, 1.0, inclusive="left").all()
    return clock_times_as_text(column) if is_fraction_of_day else zero_padded(column, _DIGITS.get(form, 1))


def _times_from_counts(raw: RawTable, column: pd.Series[Any], time: TimeColumn) -> Ints:
    """Counts since a start, or since 1970, as UTC; integers are not converted to floats.

    A float of today's seconds since 1970 is good to 0.2 microseconds, since 1904 to 0.5: it is rounded to one.
    """
    start = _start_in_name(raw, time) if time.in_name is not None else time.start
    if time.in_head:
        local = start_time_in_preamble(raw.preamble)
        if local is None:
            fix = "give `start` in the map's [time]"
            raise InputError("states no start in the lines before its header", where=str(raw.path), fix=fix)
        start = str(_local_to_utc(pd.Timestamp(local), time.zone))
    start_ns = 0 if start is None else pd.Timestamp(start).as_unit("ns").value
    numbers, unit_ns = pd.to_numeric(column, errors="coerce"), NS_IN[time.unit]
    values = numbers.to_numpy(dtype=float)
    valid = (values >= -start_ns / unit_ns) & (values < (_LAST_NS - start_ns) / unit_ns)
    if numbers.dtype.kind in "iu":
        elapsed_ns: Ints = np.where(valid, numbers.to_numpy().astype(np.int64), 0) * unit_ns
    else:
        values = np.where(valid, values, 0.0)
        is_coarse = time.unit == "s" and (start is None or np.max(values, initial=0.0) > _COARSE_S)
        integers, finest = np.floor(values), _MICRO if is_coarse else unit_ns
        part_ns = np.rint((values - integers) * finest).astype(np.int64) * (unit_ns // finest)
        elapsed_ns = integers.astype(np.int64) * unit_ns + part_ns
    return np.where(valid, start_ns + elapsed_ns, _NO_TIME)


def _turns_of_counter(counts: Ints, unit_ns: int) -> Ints:
    """How often a counter of 32 bits, such as a controller's of ms or us since it started, has begun again [n]."""
    if not counts.size or counts.min() < 0 or counts.max() >= _COUNTER:
        return np.zeros(counts.size, dtype=np.int64)
    steps = np.diff(counts, prepend=counts[:1])
    return np.cumsum(steps < min(_LONGEST_TURN_NS // unit_ns - _COUNTER, -_COUNTER // 2))


def _start_in_name(raw: RawTable, time: TimeColumn) -> str:
    """The instant at which counts start, by the time in the file's name."""
    form = time.in_name or ""
    parts = (_NAME_DIRECTIVES.get(part) or re.escape(part) for part in re.split("(%.)", form))
    match = re.search("".join(parts), raw.path.name)
    counts_s = pd.to_numeric(raw.columns[time.column], errors="coerce") * (NS_IN[time.unit] / trial.NANO)
    count_s = float(counts_s.max() if time.name_tells == "end" else counts_s.min())
    try:
        if form == TEXT:
            local = pd.Timestamp(start_time_in_file_name(raw.path.name) or "")
        else:
            local = pd.Timestamp(dt.datetime.strptime(match[0] if match else "", form))
        utc = _local_to_utc(local, time.zone)
        return str(utc - pd.Timedelta(0 if np.isnan(count_s) else round(1e6 * count_s), "us"))
    except (ValueError, OverflowError) as error:
        where, fix = str(raw.path), "rename the file, or give `start` in the map's [time]"
        raise InputError(f"holds no time like {form} in its name", where=where, why=str(error), fix=fix) from error


def _local_to_utc(local: pd.Timestamp, zone: str | None) -> pd.Timestamp:
    utc_ns, _ = local_times_to_utc(np.array([local.as_unit("ns").value]), zone or "UTC")
    return pd.Timestamp(int(utc_ns[0]), tz="UTC")


def _storable_times(time_ns: Ints, time: TimeColumn) -> tuple[Ints, list[str]]:
    """Times that a recording can hold, others as none, and remarks on a clock that was not set.

    If most are before 1970, as of programs without a clock that write the year 1, they are moved to its first day.
    The rows before a clock was set, if once, are moved in place.
    """
    valid, time_ns, remarks = time_ns != _NO_TIME, time_ns.copy(), list[str]()
    if np.count_nonzero(valid & (time_ns < 0)) > np.count_nonzero(valid) / 2:
        start_ns = time_ns[valid][0]
        time_ns[valid] += start_ns % times.DAY_NS - start_ns
        start = pd.Timestamp(int(start_ns)).isoformat()
        remarks.append(
            f"the times of {time.column!r} begin on {start}: moved to 1970, so that durations are kept;"
            " --answer start=2026-05-17T12:00:00Z is the first row's time"
        )
    time_ns = np.where(valid & (time_ns >= 0) & (time_ns < _LAST_NS), time_ns, _NO_TIME)
    rows = np.flatnonzero(time_ns != _NO_TIME)
    is_unset = time_ns[rows] < _SET_NS
    is_start_known = time.format == "seconds" and (
        time.start is not None or is_unset.all()
    )  # or remarked on elsewhere
    if remarks or is_start_known or not is_unset.any():
        return time_ns, remarks

    start = pd.Timestamp(int(time_ns[rows[0]])).isoformat()
    if is_unset.all():
        return time_ns, [
            f"the clock of {time.column!r} was not set, it begins on {start}: durations hold;"
            " --answer start=2026-05-17T12:00:00Z is the first row's time"
        ]
    count = int(np.count_nonzero(is_unset))
    if not is_unset[:count].all():
        return time_ns, [f"the clock of {time.column!r} goes to before 1990 and back, {count} rows are there"]
    step_ns = int(np.median(np.diff(time_ns[rows])))
    time_ns[rows[:count]] += time_ns[rows[count]] - step_ns - time_ns[rows[count - 1]]
    return time_ns, [
        f"the clock of {time.column!r} was set in row {rows[count] + 1}, it began on {start}: the rows before"
        " are moved so that they run on"
    ]


_SERIAL_DATES = 25_569, 73_050  # Excel's days of 1970 to 2099
_YEAR_DAYS = 1_970_001, 2_099_366
_TOO_LARGE = 1e15  # beyond the digits of a date, and those that a float holds exactly
MIDNIGHT = re.compile(r"[T ]00:00(:00(\.0+)?)?$")
_NAME_CLOCK = re.compile(r"(\d\d)[-_.:h](\d\d)[-_.:m](\d\d)(?=\D*$)")
_DATE_OR_TIME = re.compile(r"\W*(date|time)[\s:;,=]+((?:[^\t;,]|(?<=:\d\d),(?=\d+(?:\s|$)))+)", re.IGNORECASE)
_START = re.compile(r"start|begin|began|recorded|aufzeichnung|debut|inicio|inizio", re.IGNORECASE)


def distinct_dates(stamps: Sequence[times.Stamp]) -> list[times.Stamp]:
    """One stamp of each date, which decide the order of day and month as all of them do."""
    return list({stamp.numbers: stamp for stamp in reversed(stamps)}.values())[::-1]


def stamps_of_rows(
    raw: RawTable, column: str | None, date: str | None = None, day: str | None = None
) -> list[times.Stamp | None]:
    """The date and time of each row, by the columns, or the ``day`` and the time of day; without these midnight."""
    cells = raw.columns[column or date]
    if column is None:
        text = dates_with_separators(cells) + " 00:00:00"
    elif day is not None:
        text = f"{day} " + clock_times_as_text(cells)
    elif date is not None:
        text = dates_with_separators(raw.columns[date]) + " " + clock_times_as_text(cells)
    elif pd.api.types.is_numeric_dtype(cells.dtype):
        text = zero_padded(cells, 14)  # the digits of a date and time
    else:
        text = filled_cells_as_text(cells)
    return [stamp_of_cell(cell) if isinstance(cell, str) else None for cell in text.tolist()]


def stamp_of_cell(text: str) -> times.Stamp | None:
    """The date and time that a text states; None for a text with further numbers.

    >>> stamp_of_cell("Sun 17.05.2026 12.30").text, stamp_of_cell("2026-05-17 12:00:00 7")
    ('17.05.2026 12:30', None)
    """
    text = re.sub(r"(?<=[\dT] )(\d{1,2})\.(\d\d)$", r"\1:\2", text.strip())
    stamp = times.find_stamp(text)
    return stamp if stamp is not None and not re.search(r"\d", text.replace(stamp.text, "", 1)) else None


def dates_with_separators(column: pd.Series[Any]) -> pd.Series[Any]:
    """Dates as text; numbers, which lost their leading zeros, as the parts of six or eight digits, as the year and
    its day in seven, or as the serial days of a spreadsheet where five are no date.
    """
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return filled_cells_as_text(column).str.replace(MIDNIGHT, "", regex=True)
    has_months = (column // 100 % 100).between(1, 12).all()  # of numbers of five digits: days of one, months, years
    if column.between(*_SERIAL_DATES).all() and not has_months:
        return (pd.Timestamp(SERIAL_DAYS["excel"][0]) + pd.to_timedelta(column, unit="D")).dt.strftime("%Y-%m-%d")
    if column.between(*_YEAR_DAYS).all() and (column % 1000).between(1, 366).all():
        return zero_padded(column, 7).str.replace(r"^(\d{4})(\d{3})$", r"\1-\2", regex=True)
    if column.max() < _MICRO:
        return zero_padded(column, 6).str.replace(r"^(\d\d)(\d\d)(\d\d)$", r"\1-\2-\3", regex=True)
    text = zero_padded(column, 8)
    year_first = text.str[:2].isin(["19", "20"]) & (text.str[4:6] <= "12")
    parts = r"^(\d{4})(\d\d)(\d\d)$" if year_first[text.notna()].all() else r"^(\d\d)(\d\d)(\d{4})$"
    return text.str.replace(parts, r"\1-\2-\3", regex=True)


def clock_times_as_text(column: pd.Series[Any]) -> pd.Series[Any]:
    """Times of day as text; numbers as the parts of hhmmss, or as the fraction of a day, as in spreadsheets."""
    if not pd.api.types.is_numeric_dtype(column.dtype):
        return filled_cells_as_text(column).str.replace(r"^(\d{1,2})\.(\d\d)$", r"\1:\2", regex=True)
    if column.dropna().between(0.0, 1.0, inclusive="left").all():
        since = pd.Timestamp(0) + pd.to_timedelta((column * 86_400e6).round(), unit="us")
        return since.dt.strftime("%H:%M:%S.%f").where(column.notna())
    return zero_padded(column, 6).str.replace(r"^(\d\d)(\d\d)(\d\d)", r"\1:\2:\3", regex=True)


def filled_cells_as_text(column: pd.Series[Any]) -> pd.Series[Any]:
    """Filled cells as text."""
    return column.astype("str").where(column.notna())


def zero_padded(column: pd.Series[Any], digits: int) -> pd.Series[Any]:
    """Numbers as text with at least ``digits`` digits, and six decimals unless these are zero."""
    valid = ((column >= 0.0) & (column < _TOO_LARGE)).to_numpy()
    fraction, integer = np.modf(np.where(valid, column.to_numpy(dtype=float), 0.0))
    micros = np.rint(fraction * _MICRO).astype(np.int64)
    seconds = integer.astype(np.int64) + micros // _MICRO
    pairs = zip(seconds.tolist(), (micros % _MICRO).tolist(), strict=True)
    text = [f"{second:0{digits}d}" + (f".{micro:06d}" if micro else "") for second, micro in pairs]
    return pd.Series(text, index=column.index, dtype="str").where(valid)


def start_time_in_preamble(lines: Sequence[str]) -> str | None:
    """The date and time of the start in the lines before a header, ISO 8601; None for none or several.

    >>> start_time_in_preamble(["Start of log: 17.05.2026 12:00:00", "Exported 2026-06-01 08:00:00"])
    '2026-05-17T12:00:00'
    >>> start_time_in_preamble(["Date\t2026/05/17", "Time\t12:00:00.25"])
    '2026-05-17T12:00:00.250000'
    """
    pairs = {match[1].lower(): match[2] for match in map(_DATE_OR_TIME.match, lines) if match}
    stated = [*lines, f"start {pairs['date']} {pairs['time']}"] if len(pairs) > 1 else lines
    stamps = [
        (line, stamp)
        for line in stated
        if (stamp := times.find_stamp(line)) and len(stamp.orders) == 1 and stamp.has_year
    ]
    starts = [stamp for line, stamp in stamps if _START.search(line)] or [stamp for _, stamp in stamps]
    starts_ns = {stamp.local_ns(stamp.orders[0]) for stamp in starts}
    return pd.Timestamp(starts_ns.pop()).isoformat() if len(starts_ns) == 1 else None


def start_time_in_file_name(name: str) -> str | None:
    """The date and time in a file's name, ISO 8601; None for none, or an ambiguous one.

    >>> [start_time_in_file_name(name) for name in ("zz_31-Jul-2020_13_22_52.csv.gz", "run 20260517_120000.csv")]
    ['2020-07-31T13:22:52', '2026-05-17T12:00:00']
    """
    stamp = times.find_stamp(_NAME_CLOCK.sub(r" \1:\2:\3", name)) or times.find_stamp(name)
    if stamp is None or len(stamp.orders) > 1 or not stamp.has_year:
        return None
    return pd.Timestamp(stamp.local_ns(stamp.orders[0])).isoformat()


GPS, TAI = "GPS", "TAI"
"""The zones of clocks without leap seconds: GPS time is ahead of UTC by those since 1980, TAI by 19 s more."""
_CLOSE_NS = 300 * trial.NANO  # rows no further apart have no hour between them
_FALL_NS = 60 * trial.NANO  # rows out of order go back by less, a clock that is set back by more


def checked_zone(zone: str) -> str:
    """A zone's name or offset as written; :class:`ValueError` for another text.

    >>> checked_zone("UTC+02:00"), checked_zone("CEST"), checked_zone("Europe/Oslo")
    ('UTC+02:00', 'CEST', 'Europe/Oslo')
    """
    if zone in times.ATOMIC_CLOCKS or zone in times.zone_names() or times.zone_offset_s(zone) is not None:
        return zone
    why = "stands for several time zones" if times.is_ambiguous_zone(zone) else "is no time zone"
    raise ValueError(f"{why}; write UTC, an offset like +02:00, GPS, TAI, or a name like Europe/Oslo")


def local_times_to_utc(local_ns: Ints, zone: str) -> tuple[Ints, str]:
    """Local times [n, ns since 1970 on the zone's clock, in the order of their rows] as UTC, and a remark, or "".

    Times in the hour that spring skips, and in autumn's two hours without a step back, are of a clock that was not
    changed: all rows then have the offset of the time before. A single row in an hour that does not exist has the
    offset before it.
    """
    if zone in times.ATOMIC_CLOCKS:
        ahead_s_of_rows = np.array(
            [times.atomic_minus_utc_s(zone, instant_ns) for instant_ns in local_ns.tolist()], dtype=np.int64
        )
        remark = (
            f"times are of TAI, {ahead_s_of_rows[0]} s ahead of UTC, which are taken off" if zone == TAI else ""
        )
        return local_ns - trial.NANO * ahead_s_of_rows, remark
    ahead_s = times.zone_offset_s(zone)
    if ahead_s is not None and zone not in times.zone_names():
        return local_ns - ahead_s * trial.NANO, ""
    summer, winter = (_local_to_utc_ns(local_ns, zone, fold) for fold in (0, 1))
    if np.array_equal(summer, winter):
        return summer, ""
    skipped, doubled = winter < summer, winter > summer
    if np.count_nonzero(skipped) > 1:
        row = int(np.flatnonzero(skipped)[0])
        return _ignore_clock_change(local_ns, summer, row, f"the hour that {zone} leaves out", "forward")
    result = summer.copy()
    remark = ""
    rows = np.flatnonzero(doubled)
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else []
    for run in runs:
        start = _first_of_second_hour(local_ns, run)
        if start is None:
            return _ignore_clock_change(
                local_ns, summer, run[0], f"the hour that comes twice in {zone}, once", "back"
            )
        if start < 0:
            start = int(run[-1]) + 1
            winter_offset = _offset_text(local_ns, winter, run[0])
            day = pd.Timestamp(int(local_ns[run[0]])).date()
            remark = (
                f"{run.size} rows of {day} are in the hour that comes twice in {zone};"
                f" nothing states which: summer time is taken, --answer zone={winter_offset} is the other"
            )
        result[start : run[-1] + 1] = winter[start : run[-1] + 1]
    return result, remark


def _local_to_utc_ns(local_ns: Ints, zone: str, fold: int) -> Ints:
    """UTC by the first (0) or the second meaning of a local time, which differ where clocks are changed."""
    minute, part = np.divmod(local_ns, 60 * trial.NANO)  # Newfoundland changed its clocks at 00:01 until 2011
    minutes, inverse = np.unique(minute, return_inverse=True)
    info = ZoneInfo(zone)
    offsets = [
        (dt.datetime(1970, 1, 1) + dt.timedelta(minutes=count)).replace(tzinfo=info, fold=fold).utcoffset()
        for count in minutes.tolist()
    ]
    ahead_ns = np.array(
        [round((offset or dt.timedelta()).total_seconds()) * trial.NANO for offset in offsets], dtype=np.int64
    )
    return np.asarray(minute * 60 * trial.NANO + part - ahead_ns[inverse], dtype=np.int64)


def _first_of_second_hour(local_ns: Ints, run: Ints) -> int | None:
    """The first row of a run in the doubled hour that is of the second hour; one beyond its end if none is.

    None if the rows continue before and after it as if clocks were not changed, -1 if nothing decides.
    """
    falls = np.flatnonzero(np.diff(local_ns[run]) < -_FALL_NS)
    if falls.size:
        return int(run[falls[0] + 1])
    step_ns = int(np.median(np.abs(np.diff(local_ns)))) if local_ns.size > 1 else 0
    first, last = int(run[0]), int(run[-1])
    near_ns = max(3 * step_ns, _CLOSE_NS)
    joins_before = first > 0 and abs(int(local_ns[first] - local_ns[first - 1])) <= near_ns
    joins_after = last + 1 < local_ns.size and abs(int(local_ns[last + 1] - local_ns[last])) <= near_ns
    if joins_before and joins_after:
        return None
    return last + 1 if joins_before else first if joins_after else -1


def _ignore_clock_change(local_ns: Ints, utc_ns: Ints, row: int, hour: str, direction: str) -> tuple[Ints, str]:
    """All rows with the offset of one before the change, and a remark that the clock was not changed."""
    day, offset = pd.Timestamp(int(local_ns[row])).date(), _offset_text(local_ns, utc_ns, row)
    remark = (
        f"on {day} rows run on through {hour}: that clock was not put {direction};"
        f" all times are read as of zone {offset}, --answer zone=... names another"
    )
    return local_ns - (local_ns[row] - utc_ns[row]), remark


def _offset_text(local_ns: Ints, utc_ns: Ints, row: int) -> str:
    minutes = int(local_ns[row] - utc_ns[row]) // (60 * trial.NANO)
    return f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"
