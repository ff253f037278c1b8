"""The time that a line of text tells: beside a sentence, in front of a value, in a field of a log.

UTC as a date and time or as seconds since 1970, a time of day, or seconds since something began.
"""

from __future__ import annotations

import datetime as dt
import re
from functools import partial

from acquisition.core.frames import NANO
from acquisition.decoders.clock import DAY_NS, is_possible

_pattern = partial(re.compile, flags=re.ASCII)  # what is no ASCII is no space and no digit
ZONE = r"(?P<zone>Z|UTC|[+-]\d\d(?::?\d\d)?)?Z?"
"""What names a zone in a pattern."""
SENTENCE_BEHIND = _pattern(r"(?P<before>[^$!\\]{0,200})(?P<inner>(?:[$!][A-Za-z0-9]{3,},|\\[a-z]{1,3}:).*)")
"""A sentence, or its TAG block, with what stands before it."""
_TIMES = (
    _pattern(
        r"(?<!\d)(?P<year>\d{4})[-/](?P<month>\d\d)[-/](?P<day>\d\d)[-T ,_;\t]+(?P<clock>\d\d:\d\d:\d\d)"
        rf"(?:[.,](?P<fraction>\d{{1,9}}))?\s?{ZONE}"
    ),
    _pattern(  # the logs of American research vessels (SCS): the month comes first
        r"(?<!\d)(?P<month>\d\d)/(?P<day>\d\d)/(?P<year>\d{4})[ ,;\t]+(?P<clock>\d\d:\d\d:\d\d)"
        r"(?:\.(?P<fraction>\d{1,9}))?(?P<zone>Z)?"
    ),
    _pattern(
        r"(?<!\d)(?P<year>\d{4})(?P<month>\d\d)(?P<day>\d\d)T(?P<clock>\d{6})"
        rf"(?:\.(?P<fraction>\d{{1,9}}))?{ZONE}"
    ),
    _pattern(
        r"(?<!\d)(?P<year>\d{4})[:-](?P<yearday>\d{3})[:T](?P<clock>\d\d:\d\d:\d\d)(?:\.(?P<fraction>\d{1,9}))?"
        r"(?P<zone>Z)?"
    ),
)
_UNIX = _pattern(r"(?<![\d.])(\d{10}\.\d{1,9}|\d{19}|\d{16}|\d{13}|\d{10})(?![\d.])")
_CLOCK = _pattern(r"(?<!\d)(\d\d:\d\d:\d\d)(?:[.,](\d{1,9}))?")
_SECONDS = _pattern(r"[\[(]?\s*(\d{1,9})\.(\d{1,9})(?![\d.])")


def zoned_ns(date: str, clock: str, fraction: str | None, zone: str | None, usual: dt.tzinfo | None) -> int | None:
    """A date, a time and a zone as ns since 1970; ``usual`` where no zone is given, None is this machine's.

    >>> zoned_ns("1970-01-01", "02:00:01", "25", "+02:00", None)
    1250000000
    """
    try:
        whole = dt.datetime.fromisoformat(f"{date}T{clock}")
        if zone and zone not in ("Z", "UTC"):
            sign, hours, minutes = -1 if zone[0] == "-" else 1, int(zone[1:3]), int(zone[3:].strip(":") or 0)
            usual = dt.timezone(sign * dt.timedelta(hours=hours, minutes=minutes))
        elif zone:
            usual = dt.UTC
        seconds = round((whole.replace(tzinfo=usual) if usual else whole.astimezone()).timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return seconds * NANO + int((fraction or "")[:9].ljust(9, "0"))


def day_ns(clock: str, fraction: str | None) -> int | None:
    """A time of day, ``hh:mm:ss`` or ``hhmmss``, as ns since midnight; None where there is no such time.

    >>> day_ns("17:33:21", "107")
    63201107000000
    """
    digits = clock.replace(":", "")
    hours, minutes, seconds = int(digits[:2]), int(digits[2:4]), int(digits[4:])
    if hours > 23 or minutes > 59 or seconds > 59:
        return None
    return (3600 * hours + 60 * minutes + seconds) * NANO + int((fraction or "")[:9].ljust(9, "0"))


def told_time(text: str) -> tuple[int | None, int] | None:
    """The time in what stands before a sentence, and the turn of its clock [ns]; None where there is none.

    A date and a time, UTC unless it has a zone; seconds to nanoseconds since 1970; a time of day; seconds since
    the log began. A time that cannot be is None itself.

    >>> told_time("NAV 2013/11/20 05:00:04.5 GPS ") == told_time("1384923604.5 ") == (1384923604500000000, 0)
    True
    """
    for pattern in _TIMES:
        if found := pattern.search(text):
            return possible_ns(_date_time_ns(found.groupdict())), 0
    if found := _UNIX.search(text):
        digits, _, fraction = found[1].partition(".")
        return possible_ns(int((digits + fraction).ljust(19, "0"))), 0
    if found := _CLOCK.search(text):
        return day_ns(found[1], found[2]), DAY_NS
    if found := _SECONDS.match(text):
        return int(found[1]) * NANO + int(found[2].ljust(9, "0")), 0
    return None


def told_utc_ns(text: str) -> int | None:
    """The UTC that a text tells [ns since 1970]; None where it tells none, or one that cannot be.

    >>> told_utc_ns("2023-11-03T09:41:02.769765Z ")
    1699004462769765000
    """
    found = told_time(text)
    return None if found is None or found[1] else possible_ns(found[0])


def possible_ns(time_ns: int | None) -> int | None:
    """A time that can be true at all; None for another."""
    return time_ns if time_ns is not None and is_possible(time_ns) else None


def _date_time_ns(parts: dict[str, str]) -> int | None:
    year, month, day, clock = parts["year"], parts.get("month", "01"), parts.get("day", "01"), parts["clock"]
    if int(month) > 12:  # then it was the day
        month, day = day, month
    if ":" not in clock:
        clock = f"{clock[:2]}:{clock[2:4]}:{clock[4:]}"
    time_ns = zoned_ns(f"{year}-{month}-{day}", clock, parts["fraction"], parts["zone"], dt.UTC)
    return None if time_ns is None else time_ns + (int(parts.get("yearday", "1")) - 1) * DAY_NS
