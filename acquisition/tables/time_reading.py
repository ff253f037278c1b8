"""Which columns of a table tell the time, in which form, and what they do not tell: zone, day, start."""

from __future__ import annotations

import re
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.errors import InputError
from acquisition.tables.draft import Candidate, Draft
from acquisition.tables.time_columns import NS_IN, cells_as_text, parse_form

_EPOCHS = {"s": (3e8, 4e9), "ms": (3e11, 4e12), "us": (3e14, 4e15), "ns": (3e17, 4e18)}
"""How large counts since 1970 are, of the years 1979 to 2096."""
_SERIALS = {"excel": (2e4, 8e4), "matlab": (6.9e5, 7.7e5)}
_LONGEST_STEP_D = 0.02  # serial days of a log are less than half an hour apart; seconds are further
_CLOCK = (
    r"(?P<h>\d{1,2})(?P<c>[:.])(?P<m>\d{2})(?:[:.](?P<s>\d{2})(?P<f>[.,]\d+)?)?\s*(?P<p>[AaPp][Mm])?"
    r"\s*(?P<z>Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
)
_DATE = r"(?P<a>\d{1,4})(?P<s1>[-./ ])(?P<b>\d{1,2}|[A-Za-z]{3,9})(?P<s2>[-./ ])(?P<y>\d{1,4})"
_DATE_ONLY, _CLOCK_ONLY = re.compile(_DATE), re.compile(_CLOCK)
_BOTH = re.compile(rf"{_DATE}(?P<gap>[T ,;_]+| - ){_CLOCK}")
_COMPACT = re.compile(r"(?P<d>(19|20)\d{6})(?P<gap>[T_ -]?)(?P<t>\d{6})?([.,]\d+)?(?P<z>Z)?")
_MUCH = 10.0  # a month in the place of a day makes a day a month
_LONGEST_TRIAL_D = 15.0
_UTC_WORDS = frozenset({"utc", "gmt", "zulu", "z"})
_OFFSET = re.compile(r"(?:UTC|GMT)\s*(?P<sign>[+-])\s*(?P<h>\d{1,2})(?::?00)?(?![\d:])", re.IGNORECASE)
_LOCAL_WORDS = frozenset(["local", "lt", "localtime", "lokal", "lokalzeit", "ortszeit", "bordzeit", "locale"])
_NAME_FORMS = (
    "%Y-%m-%d_%H-%M-%S", "%Y-%m-%d_%H_%M_%S", "%Y-%m-%dT%H-%M-%S", "%Y-%m-%d_%H%M%S", "%Y%m%d_%H%M%S",
    "%Y%m%dT%H%M%S",
    "%Y%m%d-%H%M%S", "%d-%b-%Y_%H_%M_%S", "%d-%b-%Y_%H-%M-%S", "%Y-%m-%d-%H-%M-%S",
)  # fmt: skip
_PARTS = {"%Y": r"(?:19|20)\d\d", "%b": "[A-Za-z]{3}"}


def read_time(draft: Draft) -> tuple[str, ...]:
    """Put what tells the time into the map; the columns that do. Raises :class:`InputError` where none does."""
    kinds = {each.column: _kind_of(draft, each.column) for each in draft.of("time", "date")}

    def of(*wanted: str) -> list[Candidate]:
        return [each for each in draft.of("time", "date") if kinds[each.column] in wanted]

    if whole := of("both"):
        return _one_column(draft, whole[0].column)
    if counted := of("count"):
        return _count(draft, counted[0].column)
    for clock, date in product(of("clock", "number"), of("date", "number")):
        if date.column != clock.column and (found := _two_columns(draft, clock.column, date.column)):
            return found
    if clocks := of("clock"):
        return _time_of_day(draft, clocks[0].column)
    if numbers := of("number"):
        return _seconds(draft, numbers[0])
    why = f"it has {', '.join(map(repr, list(draft.raw.columns.columns)[:8]))}"
    fix = "rename it to `time`, or name it in a column map (--columns)"
    raise InputError("has no time column", where=str(draft.raw.path), why=why, fix=fix)


def _cells(draft: Draft, column: str) -> pd.Series[Any]:
    return draft.raw.columns[column].dropna()


def _kind_of(draft: Draft, column: str) -> str:
    """What the cells of a column look like: both day and time, a date, a clock, a count since 1970, a number."""
    cells = _cells(draft, column)
    if cells.empty:
        return ""
    if pd.api.types.is_datetime64_any_dtype(cells.dtype):
        return "both"
    if pd.api.types.is_numeric_dtype(cells.dtype):
        return "count" if _count_unit(cells) else "number"
    text = [str(each).strip() for each in cells.head(50)]
    for kind, pattern in (("both", _BOTH), ("date", _DATE_ONLY), ("clock", _CLOCK_ONLY)):
        if sum(bool(pattern.fullmatch(each)) for each in text) > 0.8 * len(text):
            return "date" if kind == "both" and _midnights(text) else kind
    compact = [_COMPACT.fullmatch(each) for each in text]
    if all(compact):
        return "both" if all(each and each["t"] for each in compact) else "date"
    return ""


def _midnights(text: list[str]) -> bool:
    """Whether all times are midnight: a spreadsheet's dates."""
    return len(text) > 1 and all(re.fullmatch(r"\S+[T ]00:00(:00)?", each) for each in text)


def _count_unit(cells: pd.Series[Any]) -> str:
    """What numbers count since 1970, or the system of their serial days; empty for other numbers."""
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
    middle = float(np.median(values))
    for unit, (low, high) in _EPOCHS.items():
        if low < middle < high:
            return unit
    step = float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 1.0
    for system, (low, high) in _SERIALS.items():
        if low < middle < high and step < _LONGEST_STEP_D and np.any(values % 1.0):
            return system
    if 1.9e13 < middle < 2.1e13:
        return "%Y%m%d%H%M%S"
    return ""


def _one_column(draft: Draft, column: str) -> tuple[str, ...]:
    cells = _cells(draft, column)
    if pd.api.types.is_datetime64_any_dtype(cells.dtype):
        zoned = isinstance(cells.dtype, pd.DatetimeTZDtype)
        return _put(draft, column, {"column": column, "format": "iso"}, zoned, "dates and times")
    form, zoned, why = _form_of(draft, cells.astype(str))
    return _put(draft, column, {"column": column, "format": form}, zoned, why)


def _count(draft: Draft, column: str) -> tuple[str, ...]:
    unit = _count_unit(_cells(draft, column))
    if unit in _SERIALS:
        return _put(draft, column, {"column": column, "format": unit}, False, f"serial days of {unit.capitalize()}")
    if unit.startswith("%"):
        return _put(draft, column, {"column": column, "format": unit}, False, "digits of date and time")
    entry = {"column": column, "format": "seconds"} | ({} if unit == "s" else {"unit": unit})
    return _put(draft, column, entry, True, f"{unit} since 1970, by their size")


def _two_columns(draft: Draft, clock: str, date: str) -> tuple[str, ...]:
    times, dates = _cells(draft, clock), _cells(draft, date)
    numbers = pd.api.types.is_numeric_dtype(times.dtype)
    if pd.api.types.is_numeric_dtype(dates.dtype):
        date_form, why = _digits_of_date(draft, dates)
    else:
        text = dates.astype(str).str.replace(r"[T ]00:00(:00)?$", "", regex=True)
        date_form, _, why = _form_of(draft, text)
    if numbers:
        values = times.to_numpy(dtype=float)
        share = bool(np.all((values >= 0.0) & (values < 1.0)))
        if not (share or np.all((values >= 0) & (values < 240_000) & (values // 100 % 100 < 60))):
            return ()
        time_form, zoned = "%H:%M:%S" if share else "%H%M%S", False
    else:
        time_form, zoned = _clock_form([str(each).strip() for each in times.head(200)])
    if not date_form:
        return ()
    form = "iso" if date_form == "iso" and time_form == "%H:%M:%S" else f"{_plain(date_form)} {time_form}"
    draft.note(date, "date", "", f"with the time in {clock!r}", why)
    return (date, *_put(draft, clock, {"column": clock, "date": date, "format": form}, zoned, "time of day"))


def _plain(date_form: str) -> str:
    return "%Y-%m-%d" if date_form == "iso" else date_form


def _digits_of_date(draft: Draft, dates: pd.Series[Any]) -> tuple[str, str]:
    """The form of dates that are numbers: 20260517, 17052026, or six digits in whatever order fits."""
    eight = cells_as_text(dates, "%Y%m%d")
    if dates.max() >= 1_000_000:
        form = "%Y%m%d" if eight.str[:2].isin(["19", "20"]).all() else "%d%m%Y"
        return (form, "digits") if parse_form(eight, form).notna().all() else ("", "")
    six = cells_as_text(dates, "%d%m%y")
    fitting = [form for form in ("%d%m%y", "%y%m%d", "%m%d%y") if parse_form(six, form).notna().all()]
    if not fitting:
        return "", ""
    names = {"%d%m%y": "ddmmyy", "%y%m%d": "yymmdd", "%m%d%y": "mmddyy"}
    if len(fitting) == 1:
        return fitting[0], f"only {names[fitting[0]]} fits"
    spans = sorted((_span(six, form, "", ""), form) for form in fitting)
    if 0.0 < spans[0][0] * _MUCH < spans[1][0] and spans[0][0] < _LONGEST_TRIAL_D:
        return spans[0][1], f"{names[spans[0][1]]}: else it would last {spans[1][0]:.0f} days"
    orders = [names[each] for each in fitting]
    answer = draft.ask("date_order", f"is the date {six.iloc[0]} {' or '.join(orders)}?", orders)
    return next((form for form, name in names.items() if name == answer), fitting[0]), "as answered"


def _time_of_day(draft: Draft, column: str) -> tuple[str, ...]:
    form, zoned = _clock_form([str(each).strip() for each in _cells(draft, column).head(200)])
    named = re.search(r"(?:19|20)\d\d-?[01]\d-?[0-3]\d", draft.raw.path.name)
    default = str(pd.Timestamp(named[0]).date()) if named else None
    day = draft.ask("day", f"column {column!r} tells the time of day only; of which day (2026-05-17)?", (), default)
    entry = {"column": column, "format": "iso" if form == "%H:%M:%S" else form, "day": day or "1970-01-01"}
    return _put(draft, column, entry, zoned, f"time of day, of {day}" if day else "time of day")


def _seconds(draft: Draft, candidate: Candidate) -> tuple[str, ...]:
    """Seconds, or what else is counted, since some start."""
    column, values = candidate.column, draft.numbers(candidate.column)
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    usual = float(np.median(steps)) if steps.size else 1.0
    unit, why = next((each for each in candidate.units if each in NS_IN), "s"), "as its head says"
    if not candidate.units:
        why = f"steps of {usual:g}"
        if usual >= 20.0:
            text = f"column {column!r} goes in steps of {usual:g}: which unit?"
            unit = draft.ask("time_unit", text, ("ms", "s", "us")) or "ms"
    entry: dict[str, Any] = {"column": column, "format": "seconds"} | ({} if unit == "s" else {"unit": unit})
    form = _form_in_name(draft.raw.path.name)
    if "start" in draft.answers:
        start = draft.ask("start", "") or ""
        entry["start"] = str(pd.Timestamp(start).isoformat()) + ("" if pd.Timestamp(start).tz else "+00:00")
        return _put(draft, column, entry, True, f"{unit} since {start}")
    if form:
        entry["in_name"] = form
        return _put(draft, column, entry, False, f"{unit}; the first row's time is that in the file's name", unit)
    text = f"column {column!r} counts {unit} from a start that is not told; when was it?"
    draft.ask("start", text, (), "1970-01-01T00:00:00Z")
    draft.warnings.append(
        f"{column!r} counts from an unknown start, taken for 1970; use --answer start=2026-05-17T12:00:00Z"
    )
    return _put(draft, column, entry, True, why)


def _form_in_name(name: str) -> str:
    for form in _NAME_FORMS:
        pattern = re.sub(r"%.", lambda found: _PARTS.get(found[0], r"\d\d"), form.replace("-", r"\-"))
        if re.search(rf"(?<!\d){pattern}(?!\d)", name):
            return form
    return ""


def _put(
    draft: Draft, column: str, entry: dict[str, Any], zoned: bool, why: str, unit: str = ""
) -> tuple[str, ...]:
    """Note the time column, and its zone where its text tells none."""
    if not zoned:
        entry["zone"], reason = _zone(draft, column, entry.get("date", ""))
        why = f"{why}; {reason}"
    draft.tree["time"] = entry
    draft.note(column, "time", unit or entry.get("unit", ""), why)
    return (column,)


def _zone(draft: Draft, column: str, date: str) -> tuple[str, str]:
    """The zone that an answer or the column's name tells, else UTC; and why."""
    name = f"{column} {draft.raw.units.get(column, '')}"
    words, offset = set(re.findall(r"[a-z]+", f"{name} {date}".lower())), _OFFSET.search(name)
    answered = "zone" in draft.answers
    if offset and int(offset["h"]) and not answered:
        # Etc/GMT-2 is two hours ahead of UTC (POSIX)
        return f"Etc/GMT{'-' if offset['sign'] == '+' else '+'}{int(offset['h'])}", f"{offset[0]} by its name"
    if words & _UTC_WORDS and not answered:
        return "UTC", "UTC by its name"
    text, default = f"column {column!r} names no zone; which is it (UTC, Europe/Oslo ...)?", "UTC"
    zone = draft.ask("zone", text, (), None if words & _LOCAL_WORDS else default) or default
    if answered:
        return zone, f"{zone} as answered"
    draft.warnings.append(f"{column!r} names no zone: UTC is assumed; --answer zone=Europe/Oslo names another")
    return zone, "UTC is assumed, no zone is told"


def _form_of(draft: Draft, cells: pd.Series[Any]) -> tuple[str, bool, str]:
    """The form of dates with or without a time, whether they have a zone, and why; "iso" where it is that."""
    text = cells.str.strip()
    some = [str(each) for each in pd.unique(text)[:2000]]
    found = [each for each in map(_BOTH.fullmatch, some) if each] or [
        each for each in map(_DATE_ONLY.fullmatch, some) if each
    ]
    if not found:
        compact = _COMPACT.fullmatch(some[0])
        if compact is None:
            return "", False, ""
        form = "%Y%m%d" + (compact["gap"] + "%H%M%S" if compact["t"] else "")
        return form, bool(compact["z"]), "digits"
    first = found[0].groupdict()
    clock, zoned = (
        _clock_form([each.group(0)[each.start("h") :] for each in found]) if first.get("h") else ("", False)
    )
    order, why = _order_of_date(draft, found, clock, first.get("gap") or " ", text)
    if order == "iso" and clock in ("", "%H:%M:%S", "%H:%M", "%H:%M:%S%z"):
        return "iso", zoned, why
    return _plain(order) + ((first.get("gap") or " ") + clock if clock else ""), zoned, why


def _order_of_date(
    draft: Draft, found: list[re.Match[str]], clock: str, gap: str, text: pd.Series[Any]
) -> tuple[str, str]:
    first = found[0]
    one, two = first["s1"], first["s2"]
    year = "%Y" if len(first["y"]) == 4 else "%y"
    if len(first["a"]) == 4:
        return ("iso", "ISO 8601") if one == "-" else (f"%Y{one}%m{two}%d", "year first")
    if first["b"].isalpha():
        return f"%d{one}{'%b' if len(first['b']) == 3 else '%B'}{two}{year}", "month by name"
    forms = {"day-first": f"%d{one}%m{two}{year}", "month-first": f"%m{one}%d{two}{year}"}
    if one == ".":
        return forms["day-first"], "day first, as dates with points are"
    high = [max(int(each[part]) for each in found) for part in "ab"]
    if max(high) > 12:
        return (forms["day-first"], "day first: there is a day beyond 12") if high[0] > 12 else (
            forms["month-first"], "month first: there is a day beyond 12")  # fmt: skip
    spans = {name: _span(text, form, clock, gap) for name, form in forms.items()}
    ordered = sorted(spans, key=spans.__getitem__)
    told = "date_order" in draft.answers
    if not told and spans[ordered[0]] * _MUCH < spans[ordered[1]] and spans[ordered[0]] < _LONGEST_TRIAL_D:
        return forms[ordered[0]], f"{ordered[0].replace('-', ' ')}: else it would last {spans[ordered[1]]:.0f} days"
    date = first.group(0)[: first.end("y")]
    both = [pd.to_datetime(date, format=form).strftime("%-d %B %Y") for form in forms.values()]
    answer = draft.ask("date_order", f"is {first.group(0)} the {' or the '.join(both)}?", list(forms))
    return forms[answer or "day-first"], "as answered" if answer else "not clear"


def _span(text: pd.Series[Any], form: str, clock: str, gap: str) -> float:
    """Days between the first and the last time if the dates are of this form."""
    times = parse_form(text, f"{form}{gap}{clock}" if clock else form).dropna()
    return float((times.max() - times.min()) / pd.Timedelta(days=1)) if len(times) else np.inf


def _clock_form(text: list[str]) -> tuple[str, bool]:
    """The form of times of day, and whether they have a zone."""
    found = [each for each in map(_CLOCK_ONLY.fullmatch, text) if each]
    if not found:
        return "%H:%M:%S", False
    first = found[0]
    sign = first["c"]
    form = f"%I{sign}%M" if first["p"] else f"%H{sign}%M"
    form += f"{sign}%S" if first["s"] else ""
    form += " %p" if first["p"] else ""
    offset = first["z"] is not None and first["z"][0] in "+-"
    return form + ("%z" if offset else ""), first["z"] is not None
