"""The time that a line of text tells: beside a sentence, in front of a value, in a field of a log.

UTC as a date and time or as seconds since 1970, a time of day, or seconds since something began.
"""

from __future__ import annotations

import datetime as dt
import re
from functools import partial

from seatrial.acquisition.core.frames import NANO
from seatrial.acquisition.core.times import Order, Stamp, find_stamp
from seatrial.acquisition.decoders.clock import DAY_NS, is_possible

_pattern = partial(re.compile, flags=re.ASCII)  # what is no ASCII is no space and no digit
ZONE = r"(?P<zone>Z|UTC|[+-]\d\d(?::?\d\d)?)?Z?"
"""What names a zone in a pattern."""
SENTENCE_BEHIND = _pattern(r"(?P<before>[^$!\\]{0,200})(?P<inner>(?:[$!][A-Za-z0-9]{3,},|\\[a-z]{1,3}:).*)")
"""A sentence, or its TAG block, with what stands before it."""
_UNIX = _pattern(r"(?<![\d.])(\d{10}\.\d{1,9}|\d{19}|\d{16}|\d{13}|\d{10})(?![\d.])")
_CLOCK = _pattern(r"(?<!\d)(\d\d:\d\d:\d\d)(?:[.,](\d{1,9}))?")
_DATE_LIKE = _pattern(r"\d{1,4}[^\d\s:,;][A-Za-z\d]{1,9}\D\d{1,4}|\d{8}|[A-Za-z]{3} +\d{1,2}\b")
_MOST_STAMPS = 20_000
_SECONDS = _pattern(r"[\[(]?\s*(\d{1,9})\.(\d{1,9})(?![\d.])")


def zoned_ns(date: str, clock: str, fraction: str | None, zone: str | None, usual: dt.tzinfo | None) -> int | None:
    """A date, a time and a zone as ns since 1970; ``usual`` where no zone is given, None is this machine's.

    >>> zoned_ns("1970-01-01", "02:00:01", "25", "+02:00", None)
    1250000000
    """
    try:
        moment = dt.datetime.fromisoformat(f"{date}T{clock}")
        if zone and zone not in ("Z", "UTC"):
            sign, hours, minutes = -1 if zone[0] == "-" else 1, int(zone[1:3]), int(zone[3:].strip(":") or 0)
            usual = dt.timezone(sign * dt.timedelta(hours=hours, minutes=minutes))
        elif zone:
            usual = dt.UTC
        seconds = round((moment.replace(tzinfo=usual) if usual else moment.astimezone()).timestamp())
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


class StatedTimes:
    """The times that stand beside a log's sentences; ``order`` is that of its dates, ``year`` of dates without one.

    Until the order is known, dates that may mean two days are collected in ``stamps``, the first of them.
    """

    def __init__(self, order: Order | None = None, year: int | None = None) -> None:
        self.order, self.year = order, year
        self.stamps: list[Stamp] = []
        self.last: Stamp | None = None
        self.unread_date = ""  # the first text with a time of day whose date was not understood
        self.unknown_zone = ""
        self.remark = ""  # what a log's own header means for its times

    def read(self, text: str) -> tuple[int | None, int] | None:
        """The time in what stands beside a sentence, and the turn of its clock [ns]; None where there is none.

        A date and a time, UTC unless it has a zone; seconds to nanoseconds since 1970; a time of day; seconds since
        the log began. A time that cannot be is None itself.

        >>> read = StatedTimes().read
        >>> read("NAV 2013/11/20 05:00:04.5 GPS ") == read("1384923604.5 ") == (1384923604500000000, 0)
        True
        """
        self.last = stamp = find_stamp(text)
        if stamp is not None:
            if len(self.stamps) < _MOST_STAMPS:
                self.stamps.append(stamp)
            self.unknown_zone = self.unknown_zone or stamp.zone
            return self._of_stamp(stamp), 0
        if match := _UNIX.search(text):
            digits, _, fraction = match[1].partition(".")
            return possible_ns(int((digits + fraction).ljust(19, "0"))), 0
        if match := _CLOCK.search(text):
            if not self.unread_date and _DATE_LIKE.search(text):
                self.unread_date = text.strip()
            return day_ns(match[1], match[2]), DAY_NS
        if match := _SECONDS.match(text):
            return int(match[1]) * NANO + int(match[2].ljust(9, "0")), 0
        return None

    def order_of(self, stamp: Stamp) -> Order:
        """The order of a date's numbers: the log's, where it can have that."""
        return self.order if self.order in stamp.orders and self.order is not None else stamp.orders[-1]

    def _of_stamp(self, stamp: Stamp) -> int | None:
        order = self.order_of(stamp)
        if not stamp.has_year and self.year is None:
            return None
        try:
            return possible_ns(stamp.utc_ns(order, None if stamp.has_year else self.year))
        except ValueError:  # the 29th of February of a year that has none
            return None


def told_utc_ns(text: str) -> int | None:
    """The UTC that a text tells [ns since 1970]; None where it tells none, one that cannot be, or may mean two.

    >>> told_utc_ns("2023-11-03T09:41:02.769765Z ")
    1699004462769765000
    """
    times = StatedTimes()
    result = times.read(text)
    if result is None or result[1] or (times.last is not None and len(times.last.orders) > 1):
        return None
    return possible_ns(result[0])


def possible_ns(time_ns: int | None) -> int | None:
    """A time that can be true at all; None for another."""
    return time_ns if time_ns is not None and is_possible(time_ns) else None
