"""Times as text: what a text states of date, time of day and zone, and which order of day and month a log means.

A text such as 06/05/2026 does not state whether the day or the month comes first. Nothing is decided about a single
text: :func:`infer_date_order` decides by all of a log's, by times of another origin beside them, and by continuity.
"""

from __future__ import annotations

import datetime as dt
import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Literal
from zoneinfo import available_timezones

from seatrial.acquisition.core.trial import NANO

DAY_NS = 86_400 * NANO
Order = Literal["year-first", "day-first", "month-first"]
ORDERS: tuple[Order, ...] = ("year-first", "day-first", "month-first")
_EARLIEST_YEAR, _LATEST_YEAR = 1970, 2099  # two digits are of this century
_LONGEST_LOG_DAYS = 31.0  # a log that lasts longer by one order than by the other is not read so
_MUCH_LONGER = 10.0  # a month in the place of a day makes a day a month
_STATED_NS = 36 * 3600 * NANO  # the most that a local time and UTC differ

_MONTHS = {
    month: number
    for number, names in enumerate(
        ("jan gen ene", "feb fév fev", "mar mär mrz maa mrt", "apr avr abr", "may mai mag mei maj", "jun giu juin",
         "jul lug juil", "aug aoû ago", "sep set", "oct okt out ott", "nov", "dec dez des dic déc"), start=1,
    )
    for month in names.split()
}  # fmt: skip
"""Months by the first letters, three of most, of their names in western European languages."""
_ZONES_H = {
    "z": 0.0, "ut": 0.0, "utc": 0.0, "gmt": 0.0, "wet": 0.0, "west": 1.0, "cet": 1.0, "mez": 1.0, "cest": 2.0,
    "mesz": 2.0, "eet": 2.0, "eest": 3.0, "msk": 3.0, "est": -5.0, "edt": -4.0, "cdt": -5.0, "mst": -7.0,
    "mdt": -6.0, "pst": -8.0, "pdt": -7.0, "akst": -9.0, "akdt": -8.0, "hst": -10.0, "nst": -3.5, "ndt": -2.5,
    "brt": -3.0, "jst": 9.0, "kst": 9.0, "hkt": 8.0, "sgt": 8.0, "awst": 8.0, "aest": 10.0, "aedt": 11.0,
    "nzst": 12.0, "nzdt": 13.0,
}  # fmt: skip
"""Hours ahead of UTC of zones by their abbreviations."""
_FURTHEST_ZONE_H = 14  # the Line Islands
_SEVERAL_ZONES = frozenset({"cst", "ist", "bst", "ast", "sst", "gst", "amt", "ect", "wst"})

_LEAP_SECONDS = (
    "1981-07-01 1982-07-01 1983-07-01 1985-07-01 1988-01-01 1990-01-01 1991-01-01 1992-07-01 1993-07-01 1994-07-01 "
    "1996-01-01 1997-07-01 1999-01-01 2006-01-01 2009-01-01 2012-07-01 2015-07-01 2017-01-01"
)
_LEAP_SECONDS_NS = [
    (dt.date.fromisoformat(day) - dt.date(1970, 1, 1)).days * DAY_NS + number * NANO
    for number, day in enumerate(_LEAP_SECONDS.split(), start=1)
]
"""The GPS times from which it is a second more ahead of UTC: IERS, Bulletin C; the last was at the end of 2016."""

ATOMIC_CLOCKS = {"GPS": 0, "TAI": 19}
"""Clocks without leap seconds, by how far they are ahead of GPS time [s]."""
_TAI = re.compile(r"(?<![A-Za-z])TAI(?![A-Za-z])", re.IGNORECASE)

YEAR_LAST = "two digits behind slashes are usually the year"
"""Why an order is assumed that the log itself does not state."""
_SLASHED = re.compile(r"\d/\d\d?/\d\d(?!\d)")
_NAME = r"[A-Za-zäéû]{3,9}\.?"
_ZONE = r"(?:\s?(?P<zone>(?:UTC|GMT)?[+-]\d{1,2}(?::?\d\d)?|[A-Z]{3,4}(?![A-Za-z0-9$!])|UT|Z)(?![A-Za-z0-9]))?"
_IN_LETTERS = r"\s?[hH]\s?\d\d(?:\s?m(?:in|n)?\s?\d\d)?"  # 12h00, 12h00m05s, 12 h 00 min 05 s
_CLOCK = (
    r"(?P<clock>\d{1,2}(?::\d\d(?::\d\d)?|\.\d\d\.\d\d|" + _IN_LETTERS + r"))"
    r"(?:(?:(?<=[:.]\d\d[:.]\d\d)|(?<=[mn]\d\d)|(?<=[mn] \d\d))[.,:](?P<fraction>\d{1,9}))?(?!\d)"
    r"(?:\s?s(?:ec)?(?![a-z]))?(?:\s?(?P<half>[AaPp])\.?\s?[Mm]\.?)?" + _ZONE
)
_NO_HOUR = r"(?!:\d\d(?::\d\d)?(?![\d:]))"  # "17 May 12:00:00" has no year, "17-May-12:12:00:00" has one
_GAP = r"(?:[T ,_;\t:-]|at )+"
_YEAR_DAY = re.compile(r"(?<!\d)(?P<a>\d{4})[:-](?P<yearday>\d{3})[:T ]" + _CLOCK)
_COMPACT = re.compile(
    r"(?<!\d)(?P<a>(?:19|20)\d\d)(?P<b>\d\d)(?P<c>\d\d)[T _-]?(?P<clock>\d{6})(?!\d)(?:[.,](?P<fraction>\d{1,9}))?"
    + _ZONE
)
_COMPACT_DATE = re.compile(r"(?<!\d)(?P<a>(?:19|20)\d\d)(?P<b>\d\d)(?P<c>\d\d)" + _GAP + _CLOCK)
_NUMBERS = re.compile(
    r"(?<![\d.:])(?P<a>\d{4}|\d{1,2})(?P<sign>[-/. ])(?P<b>\d{1,2})(?P=sign)(?P<c>\d{4}|\d{1,2})(?![\d:])"
    + _GAP + _CLOCK
)  # fmt: skip
_NAMED = re.compile(
    rf"(?<!\d)(?P<a>\d{{1,2}})(?:\. |[-/. ])?(?P<name>{_NAME})[-/. ,]?(?P<c>\d{{4}}|\d{{2}}{_NO_HOUR})?"
    + _GAP
    + _CLOCK
)
_YEAR_NAMED = re.compile(rf"(?<!\d)(?P<c>\d{{4}})[-/. ](?P<name>{_NAME})[-/. ](?P<a>\d{{1,2}})" + _GAP + _CLOCK)
_NAME_FIRST = re.compile(
    rf"(?P<name>{_NAME})[ .]+(?P<a>\d{{1,2}}){_NO_HOUR}(?:,? (?P<c>\d{{4}}))?"
    + _GAP
    + _CLOCK
    + r"(?: (?P<year>\d{4})(?!\d))?"
)
_PATTERNS = (_YEAR_DAY, _COMPACT, _COMPACT_DATE, _NUMBERS, _NAMED, _YEAR_NAMED, _NAME_FIRST)


@dataclass(frozen=True, slots=True)
class Stamp:
    """A date and a time of day as a text states them; ``text`` is the place in it.

    ``numbers`` are those of the date in the order of the text, ``orders`` those in which they are a date. Without
    ``has_year`` the first number is no year but 0. ``offset_s`` is the zone's, None where the text names none, and
    ``zone`` its name where that stands for several.
    """

    text: str
    numbers: tuple[int, int, int]
    orders: tuple[Order, ...]
    clock_ns: int
    offset_s: int | None = None
    zone: str = ""
    has_year: bool = True

    def local_ns(self, order: Order, year: int | None = None) -> int:
        """The time as ns since 1970 in its zone. Raises :class:`ValueError` where there is no such date."""
        date = _date_or_none(self.numbers if year is None else (year, *self.numbers[1:]), order)
        if date is None:
            raise ValueError("no date of a log")
        return (date - dt.date(1970, 1, 1)).days * DAY_NS + self.clock_ns

    def utc_ns(self, order: Order, year: int | None = None) -> int:
        """The time as ns since 1970; without a zone it is UTC. Raises :class:`ValueError`."""
        return self.local_ns(order, year) - (self.offset_s or 0) * NANO


def find_stamp(text: str) -> Stamp | None:
    """The first date with a time of day in a text; None where there is none that is possible.

    >>> find_stamp("17-May-2026 02:00:01.25 PM CEST")
    Stamp(text='17-May-2026 02:00:01.25 PM CEST', numbers=(17, 5, 2026), orders=('day-first',), \
clock_ns=50401250000000, offset_s=7200, zone='', has_year=True)
    >>> find_stamp("06/05/2026 12:00:00").orders
    ('day-first', 'month-first')
    """
    for pattern in _PATTERNS:
        match = pattern.search(text)
        stamp = None if match is None else _stamp_of_match(match)
        if stamp is not None:
            return stamp
    return None


def _stamp_of_match(match: re.Match[str]) -> Stamp | None:
    parts = match.groupdict()
    clock_ns = time_of_day_ns(parts["clock"], parts.get("fraction"), parts.get("half"))
    dates = _date_numbers_and_orders(parts)
    if clock_ns is None or dates is None:
        return None
    numbers, candidates = dates
    has_year = bool(numbers[0] or candidates != ("year-first",))
    numbers_with_year = numbers if has_year else (2024, *numbers[1:])  # a leap year has every day
    orders = tuple(order for order in candidates if _date_or_none(numbers_with_year, order) is not None)
    if not orders:
        return None
    zone = (parts.get("zone") or "").strip()
    offset_s = zone_offset_s(zone)
    if not is_ambiguous_zone(zone):
        zone = ""  # a word that is no zone: GPS, NAV
    return Stamp(match[0].strip(), numbers, orders, clock_ns, offset_s, zone, has_year)


def _date_numbers_and_orders(parts: dict[str, str | None]) -> tuple[tuple[int, int, int], tuple[Order, ...]] | None:
    """The numbers of a date, and the orders that they can have."""
    if parts.get("yearday"):
        first = dt.date(int(parts["a"] or 0), 1, 1)
        date = first + dt.timedelta(days=int(parts["yearday"] or 1) - 1)
        return (date.year, date.month, date.day), ("year-first",)
    if parts.get("name"):
        name = (parts["name"] or "").lower()
        month = _MONTHS.get(name[:4]) or _MONTHS.get(name[:3])
        if month is None:
            return None
        year = parts.get("c") or parts.get("year")
        if not year:
            return (0, month, int(parts["a"] or 0)), ("year-first",)
        return (int(parts["a"] or 0), month, int(year)), ("day-first",)
    numbers = int(parts["a"] or 0), int(parts["b"] or 0), int(parts["c"] or 0)
    if len(parts["a"] or "") == 4:
        return numbers, ("year-first",)
    if len(parts["c"] or "") == 4:
        # dates with points have the day first wherever they are written so, with slashes the year last
        return numbers, ("day-first",) if parts.get("sign") == "." else ("day-first", "month-first")
    by_sign: dict[str, tuple[Order, ...]] = {".": ("day-first",)}
    return numbers, by_sign.get(parts.get("sign") or "", ORDERS)


def _date_or_none(numbers: Sequence[int], order: Order) -> dt.date | None:
    """The date of these numbers; None where there is none in the years of logs."""
    a, b, c = numbers
    year, month, day = {"year-first": (a, b, c), "day-first": (c, b, a), "month-first": (c, a, b)}[order]
    if year < 100:
        year += 2000
    if not _EARLIEST_YEAR <= year <= _LATEST_YEAR:
        return None
    with suppress(ValueError):
        return dt.date(year, month, day)
    return None


def time_of_day_ns(time_text: str, fraction: str | None, am_or_pm: str | None = None) -> int | None:
    """A time of day as ns since midnight; None where there is no such time.

    >>> time_of_day_ns("17:33:21", "107") == time_of_day_ns("05h33m21", "107", "p") == 63_201_107_000_000
    True
    """
    time_text = re.sub(r"\s?(?:\.|h|min|mn|m)\s?", ":", time_text.lower())
    if ":" not in time_text:
        time_text = f"{time_text[:2]}:{time_text[2:4]}:{time_text[4:]}"
    hours, minutes, seconds = (int(part) for part in f"{time_text}:0".split(":")[:3])
    if am_or_pm:
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + (12 if am_or_pm in "pP" else 0)
    if hours > 23 or minutes > 59 or seconds > 59:
        return None
    return (3600 * hours + 60 * minutes + seconds) * NANO + int((fraction or "")[:9].ljust(9, "0"))


def zone_offset_s(zone: str) -> int | None:
    """How far a zone is ahead of UTC [s]; None for no zone and for one that is not known.

    >>> [zone_offset_s(zone) for zone in ("UTC+02:00", "GMT-3", "-0330", "CEST", "CST")]
    [7200, -10800, -12600, 7200, None]
    """
    match = re.fullmatch(r"(?:UTC|GMT)?\s*([+-])\s*(\d{1,2})(?::?(\d\d))?", zone, re.IGNORECASE)
    if match and int(match[2]) <= _FURTHEST_ZONE_H:
        seconds = 3600 * int(match[2]) + 60 * int(match[3] or 0)
        return -seconds if match[1] == "-" else seconds
    hours = _ZONES_H.get(zone.lower())
    return None if hours is None else round(3600 * hours)


@cache
def zone_names() -> frozenset[str]:
    """The names of all time zones, such as Europe/Oslo; to look for them on the disk takes 30 ms."""
    return frozenset(available_timezones())


def is_ambiguous_zone(zone: str) -> bool:
    """Whether a zone's abbreviation stands for several zones, as CST for three."""
    return zone.lower() in _SEVERAL_ZONES


def gps_minus_utc_s(time_ns: int) -> int:
    """How far GPS time is ahead of UTC [s] at a GPS time [ns since 1970].

    >>> gps_minus_utc_s(int(dt.datetime(2026, 5, 17, tzinfo=dt.UTC).timestamp()) * NANO)
    18
    """
    return bisect_right(_LEAP_SECONDS_NS, time_ns)


def atomic_minus_utc_s(clock: str, time_ns: int) -> int:
    """How far one of :data:`ATOMIC_CLOCKS` is ahead of UTC [s] when it shows a time [ns since 1970].

    >>> atomic_minus_utc_s("TAI", int(dt.datetime(2026, 5, 17, tzinfo=dt.UTC).timestamp()) * NANO)
    37
    """
    return ATOMIC_CLOCKS[clock] + gps_minus_utc_s(time_ns - ATOMIC_CLOCKS[clock] * NANO)


def names_tai(text: str) -> bool:
    """Whether a text names TAI, the atomic time, and not UTC beside it.

    >>> names_tai("time_tai"), names_tai("UTC, with TAI-UTC 37 s"), names_tai("details")
    (True, False, False)
    """
    return _TAI.search(text) is not None and "UTC" not in text.upper()


def infer_date_order(stamps: Sequence[Stamp], stated: Iterable[tuple[Stamp, int]] = ()) -> tuple[Order, str]:
    """The order of the numbers in a log's dates, and why; the reason is empty where nothing decides.

    ``stated`` are stamps with a UTC [ns] of another origin, such as a receiver's sentence. What decides is, in this
    order: which is possible for all; which agrees with ``stated``; by which the log lasts at most a month, and a
    tenth of what it lasts by the other; with slashes, that two digits of a year stand last (:data:`YEAR_LAST`).
    The month comes first where nothing decides.
    """
    possible = [order for order in ORDERS if all(order in stamp.orders for stamp in stamps)]
    if len(possible) == 1:
        return possible[0], "no other order is possible"
    references, agreeing, spans = list(stated), list[Order](), list[tuple[float, Order]]()
    for order in possible:
        near = [
            abs(stamp.utc_ns(order) - utc_ns) < _STATED_NS for stamp, utc_ns in references if order in stamp.orders
        ]
        if references and sum(near) > len(references) / 2:
            agreeing.append(order)
        times = [stamp.local_ns(order) for stamp in stamps if stamp.has_year]
        spans.append(((max(times) - min(times)) / DAY_NS if times else 0.0, order))
    if len(agreeing) == 1:
        return agreeing[0], "as the date beside it"
    spans.sort()
    year_last = [order for order in possible if order != "year-first"]
    if len(spans) > 1 and spans[0][0] <= _LONGEST_LOG_DAYS and spans[0][0] * _MUCH_LONGER < spans[1][0]:
        return spans[0][1], f"else it would last {spans[1][0]:.0f} days"
    if len(year_last) == 1 and all(_SLASHED.search(stamp.text) for stamp in stamps):
        return year_last[0], YEAR_LAST
    return ("month-first" if "month-first" in possible or not possible else possible[0]), ""
