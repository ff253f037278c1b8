"""Decides which columns of a table state the time, in which form, and asks for what they lack: zone, day, start.

:mod:`seatrial.acquisition.core.times` reads a text as date and time; which columns it reads, and in which order of
day and month, is decided here by all their rows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import times
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Ints
from seatrial.acquisition.core.trial import NANO
from seatrial.acquisition.tables import table_files, time_columns
from seatrial.acquisition.tables.column_names import TIME_WORDS, split_into_words
from seatrial.acquisition.tables.evidence import ColumnCandidate, MappingDraft

_EPOCHS = {"s": (3e8, 3e9), "ms": (3e11, 4e12), "us": (3e14, 4e15), "ns": (3e17, 4e18)}
"""The range of counts since 1970, of the years 1979 to 2065, or 2096."""
_SINCE_1904, _SECONDS_SINCE_1904 = "s since 1904", (3e9, 4e9)
"""LabVIEW's time, and its seconds of the years 1999 to 2030."""
_NTP_START = "1900-01-01T00:00:00+00:00"
_DOTNET_TICKS = 6.3e17, 6.6e17  # 100 ns since the year 1, of 1997 to 2092; ns since 1970 of 1990
_TAI_START = "1958-01-01T00:00:00+00:00"
_EPOCH_START = "1970-01-01T00:00:00+00:00"
_LABVIEW_START = "1904-01-01T00:00:00+00:00"
_COARSE_STEP, _COARSE_FROM_S = 20.0, 9.5e8  # counts that go in such steps are no seconds of before the year 2000
_SERIALS = {
    "excel": ("serial days of Excel", 25_569.0, 51_544.0),
    "d": ("days since 1970", 9e3, 25_569.0),
    "mjd": ("modified Julian days", 51_544.0, 8e4),
    "matlab": ("serial days of Matlab", 6.9e5, 7.7e5),
    "julian": ("Julian days", 2.44e6, 2.49e6),
}
"""What serial days are called, and their range; 25,569 is 1970 in Excel's and 2040 in days since then, 51,544 is
2000 in modified Julian days, and 2041 in Excel's."""
_SHORTEST_STEP_D = 1e-3  # rows 86 s apart: what goes in larger steps may as well be seconds, at 1 kHz and less
_ROUNDED_FRACTION = 0.1  # of the distance of rows
_LONGEST_STEP_D = 0.02  # serial days of a log are less than half an hour apart; seconds have larger steps
_MOST_DATES = 31  # further numbers are no days of a log
_MOST_CELLS = 50  # by which a column's content is decided
_ROLLED_WEEKS = 1024  # ten bits (IS-GPS-200)
_GPS_EPOCH = pd.Timestamp("1980-01-06")
_MOST_NAMED = 3
_WEEK_S, _DAY_S = 604_800.0, 86_400.0
_MAJORITY = 0.8  # of them are of one kind
_FORWARD_FRACTION = 0.95  # of the steps of a time
_UTC_WORDS = frozenset({"utc", "gmt", "zulu", "z"})
_LOCAL_WORDS = frozenset(["local", "lt", "localtime", "lokal", "lokalzeit", "ortszeit", "bordzeit", "locale"])
_ZONE_HEAD = re.compile(
    r"(?:(?:utc|gmt|time|zeit|tids?)\s?)?(?:tz|zone|zona|timezone|zeitzone|tidssone|offset)|fuseau(?: horaire)?"
    r"|huso(?: horario)?|fuso(?: orario)?|tijdzone"
)
_GPS_WORDS = frozenset({"gpst", "gpstime"})
_OFFSET = re.compile(
    r"(?:UTC|GMT)\s*[+-]\s*\d{1,2}(?::?\d\d)?(?![\d:])|(?<![\w:])[+-]\d\d:?\d\d(?![\w:])", re.IGNORECASE
)


def find_time_columns(draft: MappingDraft) -> None:
    """Put the time into the map. Raises :class:`InputError` if no column states it."""
    columns = [candidate.column for candidate in draft.candidates_for("time", "date")]
    kinds = {column: _column_kind(draft, column) for column in columns}
    if not any(kinds.values()) and (column := _find_time_by_cells(draft)):
        columns, kinds = [column], {column: _column_kind(draft, column)}

    def of_kind(*names: str) -> list[str]:
        return [column for column in columns if kinds[column] in names]

    if complete := of_kind("both"):
        return _note_single_time_column(draft, complete[0])
    if _note_stated_count(draft):
        return None
    if counts := of_kind("count"):
        return _note_count_column(draft, counts[0])
    if _note_parts(draft, of_kind("clock")[:1], of_kind("date", "number")):
        return None
    for clock, date in product(of_kind("clock", "number"), of_kind("date", "number")):
        if date != clock and _are_dates(draft, date) and _counts_from_midnight(draft, clock):
            return _note_date_and_parts(draft, date, {"second": clock})
        if date != clock and _are_date_and_clock(draft, date, clock):
            _note_text_time_column(draft, {"column": clock, "date": date}, "time of day")
            return draft.note_interpretation(date, "date", "", f"with the time in {clock!r}")
    week, time_of_week = _gps_week_columns(draft, of_kind("number"))
    if week and time_of_week:
        return _note_gps_week_columns(draft, week.column, time_of_week)
    if clocks := of_kind("clock"):
        day = _ask_day(draft, f"column {clocks[0]!r} has the time of day only; of which day (2026-05-17)?")
        why = f"time of day, of {day}" if day else "time of day"
        return _note_text_time_column(draft, {"column": clocks[0], "day": day or "1970-01-01"}, why)
    if numbers := of_kind("number"):
        running = (column for column in numbers if np.ptp(draft.filled_cells(column)) > 0.0)
        return _note_seconds_column(draft, next(running, numbers[0]))
    if time_of_week:
        return _note_seconds_column(draft, time_of_week.column, _unit_of_week(draft, time_of_week))
    raise _no_time_error(draft, columns)


def _gps_week_columns(
    draft: MappingDraft, numbers: Sequence[str]
) -> tuple[ColumnCandidate | None, ColumnCandidate | None]:
    """The columns of the weeks of GPS and of the time of the week, which may be called a time only."""
    week, time_of_week = (next(iter(draft.candidates_for(name)), None) for name in ("gps_week", "time_of_week"))
    if week and not time_of_week and np.nanmedian(draft.numbers_or_nan(week.column)) >= _ROLLED_WEEKS:
        numeric = [candidate for candidate in draft.candidates_for("time") if candidate.column in numbers]
        within_week = (time for time in numeric if np.nanmax(draft.numbers_or_nan(time.column)) <= _WEEK_S)
        time_of_week = next(within_week, None)
    return week, time_of_week


_PART_WORDS = {
    part: frozenset(words.split())
    for part, words in {
        "year": "year years yr yyyy jahr annee ano jaar anno ar decimal",
        "month": "month mon monat maned mois mes maand mese",
        "day": "day tag dag jour dia giorno decimal",
        "day_of_year": "doy yday jday yearday julian ordinal day year number tag jahr jahres jour annee decimal",
        "hour": "hour hours hr hh stunde stunden heure hora uur ora",
        "minute": "minute minutes min minuten",
        "second": "second seconds sec secs ss sekunde sekunden sod s",
        "millisecond": "millisecond milliseconds millis milli ms msec msecs",
        "microsecond": "microsecond microseconds micros us usec usecs",
        "nanosecond": "nanosecond nanoseconds nanos ns nsec nsecs",
    }.items()
}
"""The words by which columns are called that state one part of a time."""
_FILLERS = _UTC_WORDS | {
    "gps",
    "time",
    "date",
    "of",
    "the",
    "since",
    "after",
    "past",
    "from",
    "midnight",
    "header",
    "stamp",
}
_FEWEST_NS = 1e6  # a column ns of smaller numbers counts satellites
_DATE_RANGES = {"year": (0, 2200), "month": (1, 12), "day": (1, 31), "day_of_year": (1, 366)}
_LETTERS_OF_PARTS: tuple[dict[str, str], ...] = (
    {"year": "Y", "month": "M", "day": "D", "hour": "h", "minute": "m", "second": "s"},
    {"year": "YYYY", "month": "MM", "day": "DD", "hour": "hh", "minute": "mm", "second": "ss"},
    {"year": "yyyy", "month": "MM", "day": "dd", "hour": "HH", "minute": "mm", "second": "ss"},
)
"""The columns of parts by their letters: a month and a minute differ by the capital."""


def _column_of_part(draft: MappingDraft, part: str, largest: float, others: Sequence[str]) -> str:
    """A column, not of ``others``, that is called after a part and whose numbers are below ``largest``; or ""."""
    low, _ = _DATE_RANGES.get(part, (0, 0))
    for column in draft.raw.names:
        words = set(split_into_words(column)) - _FILLERS
        if part == "day_of_year":
            is_called = words <= _PART_WORDS[part] and bool(words - _PART_WORDS["year"] - {"number"})
        else:
            rest = words - {"day", "tag", "dag"} if part in time_columns.PART_NS else words
            is_called = bool(rest) and rest <= _PART_WORDS[part] and words != {"decimal"}
        if column in others or not is_called:
            continue
        values = draft.numbers_or_nan(column)
        if column.lower() == "ns" and not np.any(values >= _FEWEST_NS):
            continue
        if np.isfinite(values).any() and low <= np.nanmin(values) and np.nanmax(values) < largest:
            return column
    return ""


def _columns_of_date(draft: MappingDraft) -> dict[str, str]:
    """The columns of year, month and day, of the day of the year with or without it, or of years with decimals."""
    columns: dict[str, str] = {}
    for part in ("year", "month", "day"):
        if column := _column_of_part(draft, part, _DATE_RANGES[part][1] + 1, [*columns.values()]):
            columns[part] = column
    if len(columns) == 3:
        return columns
    year = {part: column for part, column in columns.items() if part == "year"}
    if "month" not in columns and (column := _column_of_part(draft, "day_of_year", 367, [*year.values()])):
        has_name = {*split_into_words(column)} - _PART_WORDS["day"] - _FILLERS
        return year | {"day_of_year": column} if year or has_name else {}
    years = draft.numbers_or_nan(year["year"]) if year else np.zeros(1)
    return year if np.nanmean(years % 1.0 > 0.0) > _MAJORITY else {}


def _columns_of_clock(draft: MappingDraft, others: Sequence[str]) -> dict[str, str]:
    """The columns of hour, minute, second and its fraction, the first of which may count from midnight."""
    columns: dict[str, str] = {}
    coarser_ns = times.DAY_NS
    for part, unit_ns in time_columns.PART_NS.items():
        largest = coarser_ns / unit_ns + (part == "second")  # a leap second is the 60th
        if column := _column_of_part(draft, part, largest, [*others, *columns.values()]):
            columns[part] = column
            coarser_ns = unit_ns
        elif columns and part not in time_columns.FRACTIONS:
            break
    return columns


def _note_parts(draft: MappingDraft, clocks: list[str], dates: list[str]) -> bool:
    """Note columns of a date or its parts with the time of day or its parts; whether there are such."""
    letters = next((form for form in _LETTERS_OF_PARTS if {*form.values()} <= {*draft.raw.names}), None)
    parts = dict(letters) if letters else _columns_of_date(draft)
    if not letters and not clocks:
        parts |= _columns_of_clock(draft, [*parts.values()])
    has_clock = bool(clocks or parts.keys() & time_columns.PART_NS.keys())
    date = next((column for column in dates if column not in parts.values() and _are_dates(draft, column)), None)
    named_days = {*_DATE_RANGES} & parts.keys()
    if date is not None and not named_days and not clocks and has_clock:
        _note_date_and_parts(draft, date, parts)
        return True
    return bool(parts) and _note_numeric_parts(draft, parts, clocks, has_clock)


def _note_date_and_parts(draft: MappingDraft, date: str, parts: dict[str, str]) -> None:
    """Note a column of dates with the parts of the time of day."""
    entry = {"column": [*parts.values()][-1], "date": date, "parts": parts}
    _warn_of_count(draft, parts)
    _note_text_time_column(draft, entry, f"{' and '.join(parts)} of the day")
    draft.note_interpretation(date, "date", "", f"with the time of day in {', '.join(map(repr, parts.values()))}")


def _warn_of_count(draft: MappingDraft, parts: Mapping[str, str]) -> None:
    """Warn of a count beside a date that may as well be one since the log began: its name does not say which."""
    part = next((part for part in time_columns.PART_NS if part in parts), "hour")
    if part == "hour" or set(split_into_words(parts[part])) & _DAY_WORDS:
        return
    draft.warnings.append(
        f"{parts[part]!r} is read as {part}s since midnight; if it counts from the start of the log:"
        " --answer start=2026-05-17T12:00:00Z is the first row's time"
    )


def _counts_from_midnight(draft: MappingDraft, clock: str) -> bool:
    """Whether numbers are seconds since midnight, and not the digits of hhmmss; asked within one minute of both."""
    values = draft.numbers_or_nan(clock)
    values = values[np.isfinite(values)]
    if (
        not draft.is_numeric(clock)
        or not values.size
        or values.min() < 0.0
        or not 1.0 <= values.max() < _DAY_S + 1.0
    ):
        return False
    if np.any(values % 100.0 >= 61.0) or np.any(values // 100.0 % 100.0 >= 60.0):
        return True
    if np.ptp(values // 100.0) > 0.0 or "hhmmss" in split_into_words(clock):
        return False
    text = f"is {values[0]:g} in {clock!r} a time as hhmmss, or seconds since midnight?"
    return draft.ask("time_unit", text, ("hhmmss", "s")) == "s"


def _note_numeric_parts(draft: MappingDraft, parts: dict[str, str], clocks: list[str], has_clock: bool) -> bool:
    """Note a time that parts of a date and of a day make up; whether they do."""
    finest = draft.numbers_or_nan([*parts.values()][-1])
    if not has_clock and not np.nanmean(finest % 1.0 > 0.0) > _MAJORITY:
        return False
    *earlier, last = [*parts.values(), *clocks]
    entry: dict[str, Any] = {"column": last, "format": "iso", "parts": parts}
    why = "of its parts"
    if not {*_DATE_RANGES} & parts.keys():
        if not set(split_into_words(parts.get("second", parts.get("millisecond", "")))) & _DAY_WORDS:
            return False
        day = _ask_day(draft, f"column {last!r} counts from midnight; of which day (2026-05-17)?")
        entry |= {"format": time_columns.TEXT, "day": day or "1970-01-01"}
        why = f"since midnight, of {day}" if day else "since midnight"
    elif "year" not in parts:
        text = f"column {parts['day_of_year']!r} is the day of a year; which is it (2026)?"
        entry |= {"format": time_columns.TEXT, "year": int(draft.ask("year", text) or 1970)}
    else:
        _warn_of_count(draft, parts)
    _note_time_column(draft, entry, [], why)
    for column in earlier:
        draft.note_interpretation(column, "time", "", "a part of it")
    if "day_of_year" in parts and not has_clock:
        draft.warnings.append(f"{parts['day_of_year']!r} is read with the 1st of January as day 1, noon being 1.5")
    return True


_DAY_WORDS = frozenset({"midnight", "day", "sod"})


def _are_dates(draft: MappingDraft, column: str) -> bool:
    """Whether the cells of a column are dates without a time of day."""
    head = replace(draft.raw, columns=draft.raw.columns[[column]].dropna().head(_MOST_CELLS))
    if head.columns.empty or (draft.is_numeric(column) and np.any(draft.numbers_or_nan(column) % 1.0 > 0.0)):
        return False
    if draft.is_numeric(column) and head.columns[column].nunique() > _MOST_DATES:
        return False
    stamps = time_columns.stamps_of_rows(head, None, column)
    return sum(stamp is not None for stamp in stamps) > _MAJORITY * len(stamps)


def _ask_day(draft: MappingDraft, text: str) -> str | None:
    """The day of times of day; that in the file's name is the default."""
    date_in_name = re.search(r"(?:19|20)\d\d-?[01]\d-?[0-3]\d", draft.raw.path.name)
    return draft.ask("day", text, (), str(pd.Timestamp(date_in_name[0]).date()) if date_in_name else None)


def _completed_by_fraction(draft: MappingDraft, whole_seconds: str) -> dict[str, dict[str, str]]:
    """The entry of the column that holds the rest of whole seconds; empty for none."""
    for part in time_columns.FRACTIONS:
        if column := _column_of_part(draft, part, NANO / time_columns.PART_NS[part], [whole_seconds]):
            draft.note_interpretation(column, "time", "", f"the {part}s of {whole_seconds!r}")
            return {"parts": {part: column}}
    return {}


_STATED_COUNT = re.compile(
    r"(?:.*[\W_])?(?P<unit>[^\W\d_]+)[\s_]+(?:since|after|from)[\s_]+(?P<moment>[^\])}]*\d{4}[^\])}]*)",
    re.IGNORECASE,
)


def _note_stated_count(draft: MappingDraft) -> bool:
    """Note the column whose head, or unit, states what it counts and since when; whether there is one.

    Raises :class:`InputError` for a moment that is no plain date, or too early.
    """
    for column, text in (
        (name, text) for name in draft.raw.names for text in (name, draft.raw.units.get(name, ""))
    ):
        match = _STATED_COUNT.fullmatch(text.strip().rstrip("])}"))
        unit_ns = table_files.COUNTS_NS.get(match["unit"].lower()) if match else None
        if match is None or unit_ns is None or not draft.is_numeric(column):
            continue
        since = f"{match['unit']} since {match['moment'].replace('_', ' ').strip()}"
        start = table_files.times_since(np.zeros(1), since, draft.raw.path)
        unit = next(name for name, size_ns in time_columns.NS_IN.items() if size_ns == unit_ns)
        entry = {"column": column, "format": "seconds", "unit": unit}
        entry["start"] = "" if start is None else start[0].isoformat()
        if draft.answers.get("zone") in times.ATOMIC_CLOCKS:
            entry["zone"] = draft.ask("zone", "") or ""
        elif remark := table_files.gps_remark(column, since):
            draft.warnings.append(remark)
        _note_time_column(draft, entry, [], f"{since}, as its head says", zoned=True)
        return True
    return False


def _no_time_error(draft: MappingDraft, columns: list[str]) -> InputError:
    where, fix = str(draft.raw.path), "rename it to `time`, or name it in a column map (--columns)"
    for column in columns:
        for text in draft.filled_cells(column).head(1):
            fix = "write it as 2026-05-17T12:00:00.500Z, or give its `format` in a column map (--columns)"
            return InputError(
                f"column {column!r} holds {str(text)!r}, which is no known time", where=where, fix=fix
            )
    names = ", ".join(map(repr, list(draft.raw.columns.columns)[:8]))
    return InputError("has no time column", where=where, why=f"it has {names}", fix=fix)


def _column_kind(draft: MappingDraft, column: str) -> str:
    """What the cells of a column look like: "both" day and time, "date", "clock", "count" since 1970, "number"."""
    cells = draft.filled_cells(column)
    if cells.empty:
        return ""
    if pd.api.types.is_datetime64_any_dtype(cells.dtype):
        return "both"
    if pd.api.types.is_numeric_dtype(cells.dtype):
        unit, stated = _unit_of_count_column(cells), _header_time_units(draft, column)
        is_finer = unit in _EPOCHS and any(time_columns.NS_IN[other] < time_columns.NS_IN[unit] for other in stated)
        is_finer |= unit in _SERIALS and bool(stated) and "d" not in stated
        return "count" if unit and not is_finer else "number"  # ms for days are as large as s since 1970
    texts = [str(cell).strip() for cell in cells.head(_MOST_CELLS)]
    for kind, prefix, suffix in (("both", "", ""), ("date", "", " 00:00:00"), ("clock", "2000-01-01 ", "")):
        if sum(time_columns.stamp_of_cell(prefix + text + suffix) is not None for text in texts) > _MAJORITY * len(
            texts
        ):
            are_midnights = len(texts) > 1 and all(re.fullmatch(r"\S+[T ]00:00(:00)?", text) for text in texts)
            return "date" if kind == "both" and are_midnights else kind  # a spreadsheet's dates
    moments = pd.to_datetime(cells.head(_MOST_CELLS), format="ISO8601", errors="coerce", utc=True)
    return "both" if moments.notna().all() else ""


def _find_time_by_cells(draft: MappingDraft) -> str | None:
    """A column of dates and times, or of counts since 1970, under an unknown name; counts come first.

    Counts need a word for time in their name, as further numbers are as large, and to increase.
    """
    counts, dates = list[str](), list[str]()
    for column in draft.raw.names:
        kind = _column_kind(draft, column)
        if kind == "count" and TIME_WORDS & set(split_into_words(column)):
            steps = np.diff(draft.filled_cells(column).to_numpy(dtype=float))
            if steps.size == 0 or np.mean(steps > 0.0) > _FORWARD_FRACTION:
                counts.append(column)
        elif kind == "both":
            dates.append(column)
    return next(iter(counts + dates), None)


def _unit_of_count_column(cells: pd.Series[Any]) -> str:
    """The unit of counts since 1970, or the system of serial days; empty for other numbers."""
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
    median = float(np.median(values))
    step = float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 1.0
    for unit, (low, high) in (*_EPOCHS.items(), (_SINCE_1904, _SECONDS_SINCE_1904)):
        if unit == "s" and step >= _COARSE_STEP:
            low = _COARSE_FROM_S
        if (
            low < median < high and step * time_columns.NS_IN.get(unit, NANO) <= times.DAY_NS
        ):  # µs since a start are as large
            return unit
    for system, (_, low, high) in _SERIALS.items():
        if low < median < high and step < _LONGEST_STEP_D and np.any(values % 1.0):
            return system
    return time_columns.TEXT if 1.9e13 < median < 2.1e13 else ""


def _note_single_time_column(draft: MappingDraft, column: str) -> None:
    cells = draft.filled_cells(column)
    entry: dict[str, Any] = {"column": column, "format": "iso"}
    if pd.api.types.is_datetime64_any_dtype(cells.dtype):
        zoned = isinstance(cells.dtype, pd.DatetimeTZDtype)
        _note_time_column(draft, entry, [], "dates and times", zoned=zoned)
    elif (moments := pd.to_datetime(cells, format="ISO8601", errors="coerce", utc=True)).notna().mean() > _MAJORITY:
        zoned = bool(cells.astype("str").str.contains(time_columns.ZONED).all())
        if (moments.dropna() == moments.dropna().dt.floor("s")).all():
            entry |= _completed_by_fraction(draft, column)
        _note_time_column(draft, entry, [], "ISO 8601", zoned=zoned)
    else:
        _note_text_time_column(draft, {"column": column}, "")


def _note_count_column(draft: MappingDraft, column: str) -> None:
    unit = _unit_of_count_column(draft.filled_cells(column))
    if unit == time_columns.TEXT:
        return _note_text_time_column(draft, {"column": column}, "digits of date and time")
    if unit == "ns" and _DOTNET_TICKS[0] < float(np.nanmedian(draft.numbers_or_nan(column))) < _DOTNET_TICKS[1]:
        what = f"column {column!r} has the size of .NET's ticks, 100 ns since the year 1, which are not read"
        raise InputError(what, where=str(draft.raw.path), fix="write it as 2026-05-17T12:00:00.500Z")
    if unit in _SERIALS and _may_be_seconds(draft, column):
        step = float(np.nanmedian(np.abs(np.diff(draft.numbers_or_nan(column)))))
        text = f"column {column!r} goes in steps of {step:g}: does it count days ({_SERIALS[unit][0]}) or seconds?"
        if draft.ask("time_unit", text, ("d", "s")) != "d":
            return _note_seconds_column(draft, column, "s")
    entry: dict[str, Any] = {"column": column, "format": "seconds"} | ({} if unit == "s" else {"unit": unit})
    if unit in _SERIALS:
        _warn_of_rounded_days(draft, column)
        if unit == "d" or "1904" in split_into_words(column):
            start = _EPOCH_START if unit == "d" else _LABVIEW_START
            entry |= {"unit": "d", "start": start}
            return _note_time_column(draft, entry, [], f"days since {start[:4]}", zoned=True)
        return _note_time_column(draft, {"column": column, "format": unit}, [], _SERIALS[unit][0])
    why = f"{unit} since 1970, by their size"
    if unit == _SINCE_1904:
        is_ntp = "ntp" in split_into_words(column) or _are_later_than_file(
            draft, column, "s", pd.Timestamp(_LABVIEW_START).value
        )
        start, clock = (_NTP_START, "NTP") if is_ntp else (_LABVIEW_START, "LabVIEW")
        unit, why = "s", f"s since {start[:4]}, as {clock} counts, by their size"
        entry = {"column": column, "format": "seconds", "start": start}
    elif start := _start_of_gps_seconds(draft, column, unit):
        entry["start"], why = start, f"{unit} since 1980, as GPS counts, as answered"
    if "start" in draft.answers:
        start = time_columns.add_zone_to_instant(draft.ask("start", "") or "")
        elapsed = pd.Timedelta(int(draft.filled_cells(column).iloc[0]) * time_columns.NS_IN[unit], "ns")
        entry["start"] = (pd.Timestamp(start) - elapsed).isoformat()
        why = f"{unit}; the first row is of {start}, as answered"
    elif clock := _clock_of_counts(draft, column):
        entry["zone"], why = clock, f"{why}, of {clock}"
        if clock == time_columns.TAI and _are_later_than_file(draft, column, unit):
            entry["start"], why = (
                _TAI_START,
                f"{unit} since 1958, of TAI: since 1970 they would be of after the file",
            )
    if unit == "s" and not np.any(draft.numbers_or_nan(column) % 1.0 > 0.0):
        entry |= _completed_by_fraction(draft, column)
    return _note_time_column(draft, entry, [], why, zoned=True)


_SERIAL_WORDS = frozenset(
    ["excel", "matlab", "datenum", "mtime", "serial", "date", "datetime", "datum", "julian", "jd", "mjd", "days"]
)


def _may_be_seconds(draft: MappingDraft, column: str) -> bool:
    """Whether numbers of the size of serial days may be seconds at a high rate: neither head nor steps say days."""
    steps = np.abs(np.diff(draft.numbers_or_nan(column)))
    says_days = "d" in _header_time_units(draft, column) or set(split_into_words(column)) & _SERIAL_WORDS
    return not says_days and float(np.nanmedian(steps)) >= _SHORTEST_STEP_D


def _start_of_gps_seconds(draft: MappingDraft, column: str, unit: str) -> str:
    """What counts of a column that is called after GPS start at: 1980, less the leap seconds, if it is answered so.

    It is asked where both readings are possible: rows are not of after their file's last change. Empty for 1970.
    """
    words = set(split_into_words(column))
    if not words & (_GPS_WORDS | {"gps"}):
        return ""
    if _are_later_than_file(draft, column, unit, _GPS_EPOCH.value):
        return ""
    since_ns = int(np.nanmedian(draft.numbers_or_nan(column)) * time_columns.NS_IN[unit])
    gps_ns = _GPS_EPOCH.value + since_ns
    dates = [pd.Timestamp(ns).date() for ns in (since_ns, gps_ns)]
    text = (
        f"does {column!r} count from 1970, and its rows are of {dates[0]}, or from 1980 as GPS does, of {dates[1]}?"
    )
    if draft.ask("since", text, ("1970", "1980")) != "1980":
        return ""
    return f"{(_GPS_EPOCH - pd.Timedelta(times.gps_minus_utc_s(gps_ns), 's')).isoformat()}+00:00"


def _are_later_than_file(draft: MappingDraft, column: str, unit: str, start_ns: int = 0) -> bool:
    """Whether counts since a start [ns since 1970] would be of more than a day after their file's last change."""
    since_ns = np.nanmedian(draft.numbers_or_nan(column)) * time_columns.NS_IN[unit]
    return bool(start_ns + since_ns > draft.raw.path.stat().st_mtime_ns + times.DAY_NS)


def _clock_of_counts(draft: MappingDraft, column: str) -> str:
    """The clock without leap seconds that counts are of, as answered or by their name; empty for UTC."""
    clock = _zone_in_name(f"{column} {draft.raw.units.get(column, '')}")
    if draft.answers.get("zone") in (*times.ATOMIC_CLOCKS, "UTC"):
        clock = draft.ask("zone", "") or ""
    elif clock == time_columns.GPS:
        draft.warnings.append(
            f"{column!r} is taken for UTC; GPS time is ahead of it by the leap seconds, 18 s since 2017; if it is"
            " that: --answer zone=GPS"
        )
        return ""
    return clock if clock in times.ATOMIC_CLOCKS else ""


def _warn_of_rounded_days(draft: MappingDraft, column: str) -> None:
    """Warn of serial days with so few decimals that rows are further off than a tenth of their distance."""
    days = draft.numbers_or_nan(column)
    days = days[np.isfinite(days)]
    decimals = next(
        (count for count in range(7) if np.allclose(np.round(days, count), days, rtol=0.0, atol=1e-9)), 9
    )
    rounded_s, row_s = _DAY_S / 10**decimals, _DAY_S * float(np.ptp(days)) / max(days.size - 1, 1)
    if rounded_s > _ROUNDED_FRACTION * row_s:
        draft.warnings.append(
            f"{column!r} has {decimals} decimals of a day: times are off by up to {0.5 * rounded_s:.2g} s, rows are"
            f" {row_s:.2g} s apart; export them with more"
        )


def _are_date_and_clock(draft: MappingDraft, date: str, clock: str) -> bool:
    """Whether two columns form dates and times together."""
    head = draft.raw.columns[[date, clock]].dropna().head(_MOST_CELLS)
    numbers = [draft.numbers_or_nan(column) for column in (date, clock) if draft.is_numeric(column)]
    if head.empty or any(np.any(values < 0.0) for values in numbers):
        return False
    if draft.is_numeric(date) and head[date].nunique() > _MOST_DATES:
        return False
    stamps = time_columns.stamps_of_rows(replace(draft.raw, columns=head), clock, date)
    return sum(stamp is not None for stamp in stamps) > _MAJORITY * len(stamps)


_ORDER_OF_LETTERS: dict[times.Order, re.Pattern[str]] = {
    "day-first": re.compile(r"(?<![a-z])(dd|tt|gg|jj)\W?m{2,3}\W?[yja]{2,4}"),
    "month-first": re.compile(r"(?<![a-z])m{2,3}\W?dd\W?y{2,4}"),
    "year-first": re.compile(r"(?<![a-z])[yja]{2,4}\W?m{2,3}\W?(dd|tt|gg|jj)"),
}


def _note_text_time_column(draft: MappingDraft, entry: dict[str, Any], why: str) -> None:
    """Note a time column of text, with the order of its dates and their year: answered, by all dates, or asked."""
    column = entry["column"]
    clock = None if entry.get("parts") else column
    stamps = [
        stamp
        for stamp in time_columns.stamps_of_rows(draft.raw, clock, entry.get("date"), entry.get("day"))
        if stamp
    ]
    if not stamps:
        raise _no_time_error(draft, [column])
    dates = time_columns.distinct_dates(stamps)
    possible = [option for option in times.ORDERS if all(option in stamp.orders for stamp in dates)]
    head = str(entry.get("date", column)).lower()
    spelt = [option for option, letters in _ORDER_OF_LETTERS.items() if option in possible and letters.search(head)]
    order, reason = (spelt[0], "as its head says") if spelt else times.infer_date_order(dates)
    example = next((stamp for stamp in dates if len(stamp.orders) > 1), dates[0])
    days = {option: pd.Timestamp(example.local_ns(option)) for option in possible}
    readings = {option: f"{day.day} {day:%B %Y}" for option, day in days.items()}
    answer = draft.answers.get("date_order")
    if answer is not None and possible and answer not in possible:
        contradiction = next(stamp.text for stamp in dates if answer not in stamp.orders)
        raise ConfigurationError(f"answer date_order={answer} cannot be used", why=f"there is {contradiction!r}")
    if reason == times.YEAR_LAST and answer is None:
        alternative = next(option for option in possible if option != order)
        draft.warnings.append(
            f"{example.text!r} is taken for {readings[order]}, as {reason};"
            f" --answer date_order={alternative} for {readings[alternative]}"
        )
    if reason and answer is None:
        reason = "" if len(example.orders) == 1 else f"{order.replace('-', ' ')}: {reason}"
    else:
        text = f"is {example.text} the {' or the '.join(readings.values())}?"
        answer = draft.ask("date_order", text, possible)
        order = next((option for option in possible if option == answer), order)
        reason = "as answered" if answer else "not clear"
    entry |= {"format": time_columns.TEXT, "order": order}
    if not all(stamp.has_year for stamp in stamps):
        text = f"dates like {stamps[0].text!r} name no year; which is it (2026)?"
        entry["year"] = int(draft.ask("year", text) or 1970)
    _note_time_column(draft, entry, stamps, "; ".join(part for part in (why, reason) if part))


def _note_gps_week_columns(draft: MappingDraft, week: str, time_of_week: ColumnCandidate) -> None:
    """Read weeks of GPS and times of the week."""
    weeks = draft.numbers_or_nan(week)
    if np.nanmedian(weeks) < _ROLLED_WEEKS:
        draft.warnings.append(
            f"{week!r} is of before August 1999: receivers that count weeks to {_ROLLED_WEEKS - 1} mean one of"
            f" {_ROLLED_WEEKS} or {2 * _ROLLED_WEEKS} weeks later; --answer start=2026-05-17T12:00:00Z is the first"
            " row's time"
        )
    unit, column = _unit_of_week(draft, time_of_week), time_of_week.column
    entry = {"column": column, "date": week, "format": time_columns.GPS_WEEK} | (
        {} if unit == "s" else {"unit": unit}
    )
    draft.note_interpretation(week, "date", "", f"weeks of GPS, with the time of week in {column!r}")
    _note_time_column(draft, entry, [], "time of the week", unit)


def _unit_of_week(draft: MappingDraft, time_of_week: ColumnCandidate) -> str:
    """The unit of a time of the week by its header, its name (u-blox' iTOW, ArduPilot's GMS) or its size."""
    units = [unit for unit in time_of_week.units if unit in time_columns.NS_IN]
    words = time_of_week.words
    is_ms = {"i", "tow"} <= words or bool(words & {"itow", "gms", "ms", "milliseconds"})
    largest = float(np.nanmax(draft.numbers_or_nan(time_of_week.column), initial=0.0))
    return units[0] if units else "ms" if is_ms or largest > _WEEK_S else "s"


def _header_time_units(draft: MappingDraft, column: str) -> tuple[str, ...]:
    """The units of time that the header of a column states."""
    units = next((candidate.units for candidate in draft.candidates if candidate.column == column), ())
    return tuple(unit for unit in units if unit in time_columns.NS_IN)


def _note_seconds_column(draft: MappingDraft, column: str, stated_unit: str = "") -> None:
    """Read seconds, or counts of another unit, since a start."""
    values = draft.numbers_or_nan(column)
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    step = float(np.median(steps)) if steps.size else 1.0
    units = (stated_unit,) if stated_unit else _header_time_units(draft, column)
    unit, why = next(iter(units), "s"), "as its head says"
    if not units:
        why = f"steps of {step:g}"
        if step >= 20.0 or "time_unit" in draft.answers:
            text = f"column {column!r} goes in steps of {step:g}: which unit?"
            unit = draft.ask("time_unit", text, ("ms", "s", "us")) or "ms"
    entry: dict[str, Any] = {"column": column, "format": "seconds"} | ({} if unit == "s" else {"unit": unit})
    if "start" in draft.answers:
        start = draft.ask("start", "") or ""
        entry["start"] = time_columns.add_zone_to_instant(start)
        _note_time_column(draft, entry, [], f"{unit} since {start}", zoned=True)
    elif head := time_columns.start_time_in_preamble(draft.raw.preamble):
        entry["in_head"] = True
        _note_time_column(draft, entry, [], f"{unit} since the start in the lines before the header, {head}", unit)
    elif time_columns.start_time_in_file_name(draft.raw.path.name):
        entry["in_name"] = time_columns.TEXT
        _note_time_column(draft, entry, [], f"{unit}; the first row's time is that in the file's name", unit)
    else:
        text = f"column {column!r} counts {unit} from a start that is not stated; when was it?"
        draft.ask("start", text, (), "1970-01-01T00:00:00Z")
        draft.warnings.append(
            f"{column!r} counts from an unknown start, taken for 1970; use --answer start=2026-05-17T12:00:00Z"
        )
        _note_time_column(draft, entry, [], why, zoned=True)


def _note_time_column(
    draft: MappingDraft,
    entry: dict[str, Any],
    stamps: list[times.Stamp],
    why: str,
    unit: str = "",
    *,
    zoned: bool = False,
) -> None:
    """Note the time column, with its zone if its text names none, or an answer another."""
    column = entry["column"]
    if stamps and not entry.get("parts") and all(stamp.clock_ns % NANO == 0 for stamp in stamps):
        entry |= _completed_by_fraction(draft, column)
    zoned = zoned or bool(stamps and all(stamp.offset_s is not None for stamp in stamps))
    if zoned and "zone" in draft.answers and entry["format"] != "seconds":
        entry["zone"], entry["zone_in_text"] = draft.ask("zone", ""), "ignored"
        why = f"{why}; {entry['zone']} as answered, what the text names is ignored"
    elif zoned and times.names_tai(column) and entry["format"] != "seconds":
        draft.ask("zone", f"{column!r} is called after TAI and its times name a zone: which is it?", ("TAI", "UTC"))
    elif not zoned:
        ambiguous_zone = next((stamp.zone for stamp in stamps if stamp.zone), "")
        clock = time_columns.TAI if stamps and all(times.names_tai(stamp.text) for stamp in stamps) else ""
        entry["zone"], reason = _resolve_zone(draft, entry, ambiguous_zone, clock)
        why = "; ".join(part for part in (why, reason) if part)
    if "start" in draft.answers and entry["format"] != "seconds":
        entry["start"] = time_columns.add_zone_to_instant(draft.ask("start", "") or "")
        why = f"{why}; the first row is of {entry['start']}, as answered"
    draft.tree["time"] = entry
    draft.note_interpretation(column, "time", unit or entry.get("unit", ""), why)


def _resolve_zone(draft: MappingDraft, entry: Mapping[str, Any], ambiguous: str, clock: str) -> tuple[str, str]:
    """The zone that an answer or the columns' names state, else UTC; and why.

    ``ambiguous`` is an abbreviation of several zones in the cells, ``clock`` one without leap seconds, if there is
    one.
    """
    column = entry["column"]
    name = f"{column} {draft.raw.units.get(column, '')} {entry.get('date', '')} {clock}"
    stated = time_columns.GPS if entry["format"] == time_columns.GPS_WEEK else _zone_in_name(name)
    if "zone" not in draft.answers and not ambiguous and not times.is_ambiguous_zone(stated) and stated:
        if stated == time_columns.GPS:
            draft.warnings.append(
                f"{column!r} is taken for GPS time, which is ahead of UTC by the leap seconds, 18 s since 2017;"
                " if it is UTC: --answer zone=UTC"
            )
        return stated, f"{stated} by its name"
    zone_column, zones = _zone_column(draft) if not ambiguous and not stated else ("", ())
    if len(zones) == 1 and _is_zone(zones[0]) and "zone" not in draft.answers:
        draft.note_interpretation(zone_column, "zone of the time", "", "the same in all rows")
        return zones[0], f"{zones[0]} by column {zone_column!r}"
    ambiguous = ambiguous or stated or ", ".join(zones)
    text = f"column {column!r} names no zone; which is it (UTC, +02:00, Europe/Oslo ...)?"
    if zones:
        text = (
            f"column {zone_column!r} states the zone as {ambiguous}; which is that of the times (UTC, +02:00 ...)?"
        )
    elif ambiguous:
        text = f"column {column!r} names the zone {ambiguous}, which stands for several; which is it (-06:00 ...)?"
    zone = draft.ask("zone", text, (), None if ambiguous or set(split_into_words(name)) & _LOCAL_WORDS else "UTC")
    if "zone" in draft.answers:
        return zone or "UTC", f"{zone} as answered"
    if not ambiguous:
        draft.warnings.append(f"{column!r} names no zone: UTC is assumed; --answer zone=Europe/Oslo names another")
    return "UTC", "UTC is assumed, no zone is stated"


def ask_zone_of_changed_clock(draft: MappingDraft, time_ns: Ints) -> None:
    """Ask for the zone, where none is stated, if the times step by an hour, as local ones do when clocks change."""
    steps_ns = np.diff(time_ns)
    settled = [question for question in draft.questions if question.key != "zone"]
    near_ns = max(3.0 * float(np.median(np.abs(steps_ns))), 2.0 * NANO) if steps_ns.size else 0.0
    changes = np.flatnonzero(np.abs(np.abs(steps_ns) - 3600 * NANO) <= near_ns)
    if len(settled) == len(draft.questions) or not changes.size or near_ns > 600 * NANO:
        return
    draft.questions[:] = settled
    column, last = draft.tree["time"]["column"], pd.Timestamp(int(time_ns[changes[0]])).floor("s")
    text = (
        f"column {column!r} names no zone and steps by an hour behind {last}, as local times do when clocks are"
        " changed; which zone is it (Europe/Oslo, UTC ...)?"
    )
    draft.ask("zone", text)


def _zone_column(draft: MappingDraft) -> tuple[str, tuple[str, ...]]:
    """The column that states the zones of the times, and these; empty if there is none."""
    for column in draft.raw.names:
        if not _ZONE_HEAD.fullmatch(" ".join(split_into_words(column))):
            continue
        zones = tuple(draft.filled_cells(column).astype("str").str.strip().unique())
        if draft.is_numeric(column):  # of hours, of minutes, or of both
            zones = tuple(f"the number {zone}" for zone in zones)
        elif not all(map(_is_zone, zones)):
            continue
        if zones:
            return column, zones[:_MOST_NAMED]
    return "", ()


def _is_zone(text: str) -> bool:
    return text in times.zone_names() or times.zone_offset_s(text) is not None


def _zone_in_name(name: str) -> str:
    """The zone in a column's name: an offset, a name, an abbreviation, UTC, GPS time or TAI; empty for none."""
    words = set(re.findall(r"[a-z]+", name.lower()))
    if times.names_tai(name):
        return time_columns.TAI
    if match := _OFFSET.search(name):
        return re.sub(r"\s", "", match[0])
    for zone in re.findall(r"[A-Z]\w+/[\w/]+", name):
        if zone in times.zone_names():
            return str(zone)
    if words & _UTC_WORDS:
        return "UTC"
    for word in re.findall(r"(?<![A-Za-z])[A-Z]{3,4}(?![A-Za-z])", name):
        if times.zone_offset_s(word) is not None or times.is_ambiguous_zone(word):
            return str(word)
    is_gps = words & _GPS_WORDS or ("gps" in words and set(split_into_words(name)) <= TIME_WORDS | {"gps"})
    return time_columns.GPS if is_gps else ""
