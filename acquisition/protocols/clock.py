"""The clock of a source, as it announces it, and the three times of a sample.

The time that a line of text tells: beside a sentence, in front of a value, in a field of a log.

UTC as a date and time or as seconds since 1970, a time of day, or seconds since something began.
"""

from __future__ import annotations

import datetime as dt
import re
from collections import deque
from collections.abc import Iterable
from functools import partial

from seatrial.acquisition.config.sources import Clock
from seatrial.acquisition.core.times import Order, Stamp, find_stamp
from seatrial.acquisition.core.trial import NANO, Frame, FrameFlag, Group, Quality, Sample
from seatrial.acquisition.protocols import Notices

_LONGEST_EXTRAPOLATION_NS = 5_000_000_000
_SET_NS = 2_000_000_000  # times in whole seconds, and lines that lag, differ by a second from one to the next
_APART_NS, _SETTLED_NS = 1_000_000_000, 10_000_000_000
"""Least between two reports of a clock: of a step, and of what has crept, as while a gateway sends what it kept."""
_FAR_S = 2.0
_EPOCH = dt.date(1970, 1, 1)
# A receiver that does not know the time yet tells 1980, one whose weeks rolled over tells 20 years ago; times
# after 2262 do not fit into 64 bits of nanoseconds and would make the whole recording unreadable.
_POSSIBLE_NS = range(
    (dt.date(2010, 1, 1) - _EPOCH).days * 86_400 * 10**9, (dt.date(2100, 1, 1) - _EPOCH).days * 86_400 * 10**9
)
DAY_NS = 86_400 * NANO
_GPS_EPOCH_NS = (dt.date(1980, 1, 6) - _EPOCH).days * DAY_NS
_GPS_ROUND_NS = 1024 * 7 * DAY_NS  # the week number of GPS' L1 signal has ten bits


def utc_ns(date: dt.date, seconds_of_day: float) -> int:
    """A date and the seconds since its midnight as ns since 1970.

    >>> utc_ns(dt.date(1970, 1, 2), 0.5)
    86400500000000
    """
    return (date - _EPOCH).days * DAY_NS + round(seconds_of_day * 1e6) * 1000


def is_possible(time_ns: int) -> bool:
    """Whether a time that a source tells can be true at all."""
    return time_ns in _POSSIBLE_NS


def rolled_over_ns(time_ns: int, latest_ns: int) -> int | None:
    """The time that a receiver means which counts weeks to 1,024 and has begun again; None where it means none.

    ``latest_ns`` is a moment that it cannot be later than by more than a day.

    >>> meant_ns = rolled_over_ns(utc_ns(dt.date(2006, 10, 1), 5.0), utc_ns(dt.date(2027, 1, 1), 0))
    >>> meant_ns == utc_ns(dt.date(2026, 5, 17), 5.0)
    True
    """
    since_round_ns = (time_ns - _GPS_EPOCH_NS) % _GPS_ROUND_NS
    meant_ns = time_ns + _GPS_ROUND_NS
    if since_round_ns < DAY_NS or not is_possible(meant_ns) or meant_ns > latest_ns + DAY_NS:
        return None  # in the first day of a round: a receiver that does not know the time yet
    return meant_ns


def nearest_day(seconds_of_day: float, now_ns: int) -> int:
    """The time of day, on the day that brings it closest to ``now_ns``: before and after midnight they differ.

    >>> nearest_day(86_399.9, utc_ns(dt.date(2027, 1, 1), 0.1)) == utc_ns(dt.date(2026, 12, 31), 86_399.9)
    True
    """
    day = _EPOCH + dt.timedelta(days=now_ns // DAY_NS)
    candidates = (utc_ns(day + dt.timedelta(days=shift), seconds_of_day) for shift in (-1, 0, 1))
    return min(candidates, key=lambda time_ns: abs(time_ns - now_ns))


class SourceClock:
    """The UTC time that a source announces now and then, carried on by our monotonic clock.

    With ``stamps`` "source" it decides the measured time of the source's samples; with "receiver" what the
    source says is only kept beside the time of reception. A clock that is far from ours, or that is set, is told
    in ``notices``, unless it is ``muted``: ours may be no clock to compare with.
    """

    def __init__(self, stamps: Clock, name: str, notices: Notices | None = None) -> None:
        self.stamps = stamps
        self.name = name
        self.muted = False
        self._notices: Notices = deque() if notices is None else notices
        self._announced: tuple[int, int] | None = None
        self._offset_ns: int | None = None  # its UTC less our monotonic clock, when it was last told
        self._last_offset_ns = self._told_ns = 0  # the same of the last announcement; when it was told

    def announce(self, source_ns: int, frame: Frame) -> None:
        """The source said that it is ``source_ns`` UTC."""
        if is_possible(source_ns):
            self._announced = (source_ns, frame.monotonic_ns)
            if not self.muted:
                self._compare(source_ns, frame)

    def _compare(self, source_ns: int, frame: Frame) -> None:
        """Tell at first how far the clock is from ours, and whenever it has been set since."""
        offset_ns, before_ns = source_ns - frame.monotonic_ns, self._offset_ns
        is_step = abs(offset_ns - self._last_offset_ns) >= _SET_NS
        self._last_offset_ns = offset_ns
        if before_ns is not None and abs(offset_ns - before_ns) < _SET_NS:
            return
        if before_ns is not None and frame.monotonic_ns - self._told_ns < (_APART_NS if is_step else _SETTLED_NS):
            return
        self._offset_ns, self._told_ns = offset_ns, frame.monotonic_ns
        if before_ns is not None:
            self._notices.append(
                ("warning", f"clock {self.name} was set by {(offset_ns - before_ns) / 1e9:+.3f} s")
            )
            return
        ahead_s = (source_ns - frame.received_ns) / 1e9
        level = "warning" if abs(ahead_s) > _FAR_S else "info"
        trusted = "it stamps this source" if self.stamps == "source" else "ours stamps this source"
        self._notices.append((level, f"clock {self.name} is {ahead_s:+.3f} s from ours; {trusted}"))

    def forget(self) -> None:
        """What the source said no longer holds: it has started anew."""
        self._announced = None

    def at(self, frame: Frame) -> int | None:
        """The source's UTC time when ``frame`` was received; None if it has not said it of late."""
        if self._announced is None:
            return None
        source_ns, monotonic_ns = self._announced
        elapsed_ns = frame.monotonic_ns - monotonic_ns
        return source_ns + elapsed_ns if 0 <= elapsed_ns <= _LONGEST_EXTRAPOLATION_NS else None

    def group(
        self,
        frame: Frame,
        source: str,
        values: Iterable[tuple[str, float]],
        source_ns: int | None = None,
        quality: Quality = Quality.NOT_EVALUATED,
    ) -> list[Group]:
        """One message's values as a group with their three times; no group where there is no value.

        ``source_ns`` is what the message itself said of when it was measured. A value whose stamp may be late is
        suspect.
        """
        told_ns = source_ns if source_ns is not None and is_possible(source_ns) else self.at(frame)
        measured_ns, clock = frame.received_ns if frame.stamped_ns is None else frame.stamped_ns, "receiver"
        if self.stamps == "source" and told_ns is not None:
            measured_ns, clock = told_ns, self.name
        elif frame.flags and frame.flags & FrameFlag.LATE:
            quality = max(quality, Quality.SUSPECT)
        times = (frame.received_ns, frame.monotonic_ns, measured_ns, told_ns, clock)
        group = [Sample(quantity, value, source, *times, quality) for quantity, value in values]
        return [group] if group else []


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
