"""The clock of a source, as it announces it, the three times of a sample, and which source of a line a value is of.

Lines of text state their time beside a sentence, in front of a value, in a field of a log: UTC as a date and time
or as seconds since 1970, a time of day, or seconds since a beginning.

Two receivers of one talker on one line are distinguished by two positions of one moment. Sentences such as HDT
have neither time nor position: two compasses of one talker are seen only in values that alternate between two
levels (:mod:`seatrial.analysis.quality.channel_checks` finds the same in recordings). Until that is certain the
values pass as those of one source; two that agree, as rates of turn about zero do, are never separated. Where two
have met and diverge again, the times at which they are due tell which is which.
"""

from __future__ import annotations

import datetime as dt
import re
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from math import cos, hypot, radians

from seatrial.acquisition.config.sources import Clock
from seatrial.acquisition.core.times import DAY_NS, Order, Stamp, find_stamp, time_of_day_ns
from seatrial.acquisition.core.trial import NANO, Frame, FrameFlag, Group, Quality, Sample
from seatrial.acquisition.protocols import Notices

_LONGEST_EXTRAPOLATION_NS = 5_000_000_000
_SET_NS = 2_000_000_000  # times in whole seconds, and lines that lag, differ by a second from one to the next
_STEP_INTERVAL_NS, _DRIFT_INTERVAL_NS = 1_000_000_000, 10_000_000_000
"""Least between two reports of a clock: of a step, and of a drift, as while a gateway sends what it has stored."""
_MOST_SUSPECT = 100  # sources: any talker names one
_FAR_S = 2.0
_EPOCH = dt.date(1970, 1, 1)
# A receiver without the time reports 1980, one whose weeks rolled over 20 years ago; times after 2262 do not fit
# into 64 bits of nanoseconds and would make the whole recording unreadable.
_POSSIBLE_NS = range(
    (dt.date(2010, 1, 1) - _EPOCH).days * 86_400 * 10**9, (dt.date(2100, 1, 1) - _EPOCH).days * 86_400 * 10**9
)
_GPS_EPOCH_NS = (dt.date(1980, 1, 6) - _EPOCH).days * DAY_NS
_GPS_ROUND_NS = 1024 * 7 * DAY_NS  # the week number of GPS' L1 signal has ten bits


def utc_ns_of_date(date: dt.date, seconds_of_day: float) -> int:
    """A date and the seconds since its midnight as ns since 1970.

    >>> utc_ns_of_date(dt.date(1970, 1, 2), 0.5)
    86400500000000
    """
    return (date - _EPOCH).days * DAY_NS + round(seconds_of_day * 1e6) * 1000


def is_possible_time(time_ns: int) -> bool:
    """Whether a time that a source states can be true at all."""
    return time_ns in _POSSIBLE_NS


def correct_week_rollover(time_ns: int, latest_ns: int) -> int | None:
    """The time of a receiver whose count of weeks, to 1,024, has begun again; None where that explains nothing.

    ``latest_ns`` is a moment that it cannot be later than by more than a day.

    >>> latest_ns = utc_ns_of_date(dt.date(2027, 1, 1), 0)
    >>> corrected_ns = correct_week_rollover(utc_ns_of_date(dt.date(2006, 10, 1), 5.0), latest_ns)
    >>> corrected_ns == utc_ns_of_date(dt.date(2026, 5, 17), 5.0)
    True
    """
    since_round_ns = (time_ns - _GPS_EPOCH_NS) % _GPS_ROUND_NS
    corrected_ns = time_ns + _GPS_ROUND_NS
    if since_round_ns < DAY_NS or not is_possible_time(corrected_ns) or corrected_ns > latest_ns + DAY_NS:
        return None  # in the first day of a round: a receiver that does not have the time yet
    return corrected_ns


def nearest_utc_ns_of_day_time(seconds_of_day: float, now_ns: int) -> int:
    """The time of day, on the day that brings it closest to ``now_ns``: before and after midnight they differ.

    >>> nearest_ns = nearest_utc_ns_of_day_time(86_399.9, utc_ns_of_date(dt.date(2027, 1, 1), 0.1))
    >>> nearest_ns == utc_ns_of_date(dt.date(2026, 12, 31), 86_399.9)
    True
    """
    day = _EPOCH + dt.timedelta(days=now_ns // DAY_NS)
    candidates = (utc_ns_of_date(day + dt.timedelta(days=shift), seconds_of_day) for shift in (-1, 0, 1))
    return min(candidates, key=lambda time_ns: abs(time_ns - now_ns))


class SourceClock:
    """The UTC time that a source announces now and then, continued by our monotonic clock.

    With ``stamps`` "source" it decides the measured time of the source's samples; with "receiver" the source's time
    is only kept beside the time of reception. A clock that is far from ours, or that is set, is reported in
    ``notices``, unless it is ``muted``: ours may be no clock to compare with.
    """

    def __init__(self, stamps: Clock, name: str, notices: Notices | None = None) -> None:
        self.stamps = stamps
        self.name = name
        self.muted = False
        self._notices: Notices = deque() if notices is None else notices
        self._announced: tuple[int, int] | None = None
        self._offset_ns: int | None = None  # its UTC less our monotonic clock, when it was last reported
        self._last_offset_ns = self._reported_ns = 0  # the same of the last announcement; when it was reported
        self._suspect = set[str]()  # sources whose values are not measured

    def announce(self, source_ns: int, frame: Frame) -> None:
        """The source states that it is ``source_ns`` UTC."""
        if not is_possible_time(source_ns):
            return
        self._announced = (source_ns, frame.monotonic_ns)
        if self.muted:
            return
        offset_ns, previous_ns = source_ns - frame.monotonic_ns, self._offset_ns
        is_step = abs(offset_ns - self._last_offset_ns) >= _SET_NS
        self._last_offset_ns = offset_ns
        if previous_ns is None:  # the first time
            ahead_s = (source_ns - frame.received_ns) / 1e9
            level = "warning" if abs(ahead_s) > _FAR_S else "info"
            effect = "it stamps this source" if self.stamps == "source" else "ours stamps this source"
            text = f"clock {self.name} is {ahead_s:+.3f} s from ours; {effect}"
        else:
            interval_ns = _STEP_INTERVAL_NS if is_step else _DRIFT_INTERVAL_NS
            step_ns = offset_ns - previous_ns
            if abs(step_ns) < _SET_NS or frame.monotonic_ns - self._reported_ns < interval_ns:
                return
            level, text = "warning", f"clock {self.name} was set by {step_ns / 1e9:+.3f} s"
        self._offset_ns, self._reported_ns = offset_ns, frame.monotonic_ns
        self._notices.append((level, text))

    def forget_announcement(self) -> None:
        """The source's announcement no longer holds: it has restarted."""
        self._announced = None

    def utc_ns_at_frame(self, frame: Frame) -> int | None:
        """The source's UTC time when ``frame`` was received; None without an announcement within the last 5 s."""
        if self._announced is None:
            return None
        source_ns, monotonic_ns = self._announced
        elapsed_ns = frame.monotonic_ns - monotonic_ns
        return source_ns + elapsed_ns if 0 <= elapsed_ns <= _LONGEST_EXTRAPOLATION_NS else None

    def group_values(
        self,
        frame: Frame,
        source: str,
        values: Iterable[tuple[str, float]],
        source_ns: int | None = None,
        quality: Quality = Quality.NOT_EVALUATED,
    ) -> list[Group]:
        """One message's values as a group with their three times; no group where there is no value.

        ``source_ns`` is when it was measured, as the message states. A value whose stamp may be delayed is suspect;
        one that comes as suspect is reported, once for each source.
        """
        if quality is Quality.SUSPECT and source not in self._suspect and len(self._suspect) < _MOST_SUSPECT:
            self._suspect.add(source)
            text = "its source marks it as estimated, entered by hand or simulated; it is recorded as suspect"
            self._notices.append(("warning", f"{source.partition('/')[2]}: {text}"))
        if source_ns is None or not is_possible_time(source_ns):
            source_ns = self.utc_ns_at_frame(frame)
        measured_ns, clock = frame.received_ns if frame.stamped_ns is None else frame.stamped_ns, "receiver"
        if self.stamps == "source" and source_ns is not None:
            measured_ns, clock = source_ns, self.name
        elif frame.flags and frame.flags & FrameFlag.LATE:
            quality = max(quality, Quality.SUSPECT)
        times = (frame.received_ns, frame.monotonic_ns, measured_ns, source_ns, clock)
        group = [Sample(quantity, value, source, *times, quality) for quantity, value in values]
        return [group] if group else []


_pattern = partial(re.compile, flags=re.ASCII)  # what is no ASCII is no space and no digit
ZONE = r"(?P<zone>Z|UTC|[+-]\d\d(?::?\d\d)?)?Z?"
"""What names a zone in a pattern."""
SENTENCE_WITH_PREFIX = _pattern(r"(?P<before>[^$!\\]{0,200})(?P<inner>(?:[$!][A-Za-z0-9]{3,},|\\[a-z]{1,3}:).*)")
"""A sentence, or its TAG block, with the text before it."""
_UNIX = _pattern(r"(?<![\d.])(\d{10}\.\d{1,9}|\d{19}|\d{16}|\d{13}|\d{10})(?![\d.])")
_CLOCK = _pattern(r"(?<!\d)(\d\d:\d\d:\d\d)(?:[.,](\d{1,9}))?")
_DATE_LIKE = _pattern(r"\d{1,4}[^\d\s:,;][A-Za-z\d]{1,9}\D\d{1,4}|\d{8}|[A-Za-z]{3} +\d{1,2}\b")
_MOST_STAMPS = 20_000
_SECONDS = _pattern(r"[\[(]?\s*(\d{1,9})\.(\d{1,9})(?![\d.])")


def zoned_time_ns(
    date: str, clock: str, fraction: str | None, zone: str | None, default_zone: dt.tzinfo | None
) -> int | None:
    """A date, a time and a zone as ns since 1970; ``default_zone`` without one, None is this machine's.

    >>> zoned_time_ns("1970-01-01", "02:00:01", "25", "+02:00", None)
    1250000000
    """
    try:
        moment = dt.datetime.fromisoformat(f"{date}T{clock}")
        if zone and zone not in ("Z", "UTC"):
            sign, hours, minutes = -1 if zone[0] == "-" else 1, int(zone[1:3]), int(zone[3:].strip(":") or 0)
            default_zone = dt.timezone(sign * dt.timedelta(hours=hours, minutes=minutes))
        elif zone:
            default_zone = dt.UTC
        seconds = round((moment.replace(tzinfo=default_zone) if default_zone else moment.astimezone()).timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return seconds * NANO + int((fraction or "")[:9].ljust(9, "0"))


class StatedTimes:
    """The times that are beside a log's sentences; ``order`` is that of its dates, ``year`` of dates without one.

    Until the order is known, dates that may mean two days are collected in ``stamps``, the first of them.
    """

    def __init__(self, order: Order | None = None, year: int | None = None) -> None:
        self.order, self.year = order, year
        self.stamps: list[Stamp] = []
        self.last: Stamp | None = None
        self.unread_date = ""  # the first text with a time of day whose date was not understood
        self.unknown_zone = ""
        self.remark = ""  # what a log's header means for its times
        self.is_of_this_zone = False  # a date without a zone is this machine's local time

    def read_time_prefix(self, text: str) -> tuple[int | None, int] | None:
        """The time in the text beside a sentence, and the period of its clock [ns]; None where there is none.

        A date and a time, UTC unless it has a zone; seconds to nanoseconds since 1970; a time of day; seconds since
        the log began. An impossible time is None itself.

        >>> read = StatedTimes().read_time_prefix
        >>> read("NAV 2013/11/20 05:00:04.5 GPS ") == read("1384923604.5 ") == (1384923604500000000, 0)
        True
        """
        self.last = stamp = find_stamp(text)
        if stamp is not None:
            if len(self.stamps) < _MOST_STAMPS:
                self.stamps.append(stamp)
            self.unknown_zone = self.unknown_zone or stamp.zone
            if not stamp.has_year and self.year is None:
                return None, 0
            try:
                return possible_time_or_none(
                    stamp.utc_ns(self.date_order_of(stamp), None if stamp.has_year else self.year)
                ), 0
            except ValueError:  # the 29th of February of a year that has none
                return None, 0
        if match := _UNIX.search(text):
            digits, _, fraction = match[1].partition(".")
            return possible_time_or_none(int((digits + fraction).ljust(19, "0"))), 0
        if match := _CLOCK.search(text):
            if not self.unread_date and _DATE_LIKE.search(text):
                self.unread_date = text.strip()
            return time_of_day_ns(match[1], match[2]), DAY_NS
        if match := _SECONDS.match(text):
            return int(match[1]) * NANO + int(match[2].ljust(9, "0")), 0
        return None

    def date_order_of(self, stamp: Stamp) -> Order:
        """The order of a date's numbers: the log's, where that is possible."""
        return self.order if self.order in stamp.orders and self.order is not None else stamp.orders[-1]


def parse_utc_ns(text: str) -> int | None:
    """The UTC that a text states [ns since 1970]; None where it states none, an impossible one, or may mean two.

    >>> parse_utc_ns("2023-11-03T09:41:02.769765Z ")
    1699004462769765000
    """
    times = StatedTimes()
    reading = times.read_time_prefix(text)
    if reading is None or reading[1] or (times.last is not None and len(times.last.orders) > 1):
        return None
    return possible_time_or_none(reading[0])


def possible_time_or_none(time_ns: int | None) -> int | None:
    """A time that can be true at all; None for an impossible one."""
    return time_ns if time_ns is not None and is_possible_time(time_ns) else None


_DEGREE_M = 111_195.0  # of a meridian
_LEAST_DISTANCE_M, _INITIAL_DISTANCE_M = 10.0, 25.0
"""Two positions of one moment with a larger distance are of two receivers: one repeats itself, or states whole
seconds only, in which a ship whose speed is not known yet may go the longer way."""
_SECONDS_OF_WAY = 1.5  # in a stated second, with an error of the speed
_ONE_MOMENT_NS = 900_000_000
"""What comes later than this after a position of the same stated time is of another moment: that clock is frozen,
as fixes come once a second and more often."""
_MOST_RECEIVERS, _MOST_TALKERS = 4, 100  # noise must not name unbounded numbers of receivers


@dataclass(slots=True)
class _Receiver:
    """One receiver's last position [deg] and moment, as stated [s of the day] and on arrival [ns, monotonic], the
    kinds of sentences that reported it, and how far from it another one of the same moment may be."""

    position: tuple[float, float]
    moment_s: float
    arrival_ns: int
    kinds: set[str] = field(default_factory=set)
    reach_m: float = _INITIAL_DISTANCE_M

    def distance_m(self, position: tuple[float, float]) -> float:
        (latitude, longitude), (north, east) = self.position, position
        shift_deg = (east - longitude + 180.0) % 360.0 - 180.0
        return _DEGREE_M * hypot(north - latitude, shift_deg * cos(radians(latitude)))

    def update_position(self, kind: str, moment_s: float, arrival_ns: int, position: tuple[float, float]) -> None:
        since_s = moment_s - self.moment_s
        if since_s or arrival_ns - self.arrival_ns > _ONE_MOMENT_NS:
            self.kinds.clear()
            way_m = _SECONDS_OF_WAY * (self.distance_m(position) / since_s) if since_s > 0 else _INITIAL_DISTANCE_M
            self.reach_m = max(_LEAST_DISTANCE_M, way_m)
            self.arrival_ns = arrival_ns
        self.kinds.add(kind)
        self.position, self.moment_s = position, moment_s


class Receivers:
    """The receivers of one line, by sensor as :func:`~seatrial.acquisition.core.trial.line_and_device` names it."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._receivers: dict[str, list[_Receiver]] = {}
        self._last: dict[str, int] = {}

    def receiver_number(
        self, sensor: str, kind: str, moment_s: float, arrival_ns: int, position: tuple[float, float]
    ) -> int:
        """Which receiver reports a position [deg] of a moment [s of the day]: 1 for the first of a sensor.

        ``arrival_ns`` is when the sentence came, on the monotonic clock.
        One sentence of a kind is expected of each receiver at each moment; a further one, if it is too far from all
        last positions, is another receiver's.
        """
        if sensor not in self._receivers:
            if len(self._receivers) >= _MOST_TALKERS:
                return 1
            self._receivers[sensor] = [_Receiver(position, moment_s, arrival_ns)]
        receivers = self._receivers[sensor]
        waiting = [  # for such a sentence of this moment
            receiver
            for receiver in receivers
            if receiver.moment_s != moment_s
            or kind not in receiver.kinds
            or arrival_ns - receiver.arrival_ns > _ONE_MOMENT_NS
        ]
        receiver = _nearest_receiver(waiting or receivers, position)
        if len(waiting) < len(receivers) and receiver.distance_m(position) > receiver.reach_m:
            receiver = _nearest_receiver(receivers, position)
            distance_m = receiver.distance_m(position)
            if distance_m > receiver.reach_m and len(receivers) < _MOST_RECEIVERS:
                receiver = _Receiver(position, moment_s, arrival_ns)
                receivers.append(receiver)
                talker = sensor.partition("/")[2]
                text = (
                    f"two receivers with the talker {talker} on one line: a second position of the same moment is"
                    f" {distance_m:,.0f} m from the first; its values are kept apart, as receiver{len(receivers)}"
                )
                self._notices.append(("warning", text))
        receiver.update_position(kind, moment_s, arrival_ns, position)
        self._last[sensor] = receivers.index(receiver) + 1
        return self._last[sensor]

    def last_receiver_number(self, sensor: str) -> int:
        """The receiver whose position was the last one: what belongs to a fix and has no position follows it."""
        return self._last.get(sensor, 1)


def _nearest_receiver(receivers: list[_Receiver], position: tuple[float, float]) -> _Receiver:
    return min(receivers, key=lambda receiver: receiver.distance_m(position))


_LEAST_LEVEL_DISTANCE = {"deg": 5.0, "dps": 1.0, "mps": 1.0, "rpm": 20.0, "percent": 20.0, "m": 1.0}
"""Of two levels, by the unit at the end of a quantity's name: ten steps of a coarse instrument."""
_FEWEST, _MOST, _STRIDE = 17, 65, 8  # values that are tested, and how many come from one test to the next
_FEWEST_TURNS = 8
_INTERMEDIATE = (0.25, 0.75)  # of the distance: steps of such a size belong to neither kind
_TURN_SPREAD = 0.12  # how much turns may differ from their median, as a fraction of it; of waves it is 0.3
_RETURNS = 0.5  # of the turns are adjacent to another; none of a rudder that stays over for three samples
_HALF_TURN_DEG = 150.0  # the way between levels of this distance is to either side, by their noise
_SILENT_NS = 3 * NANO  # a source that is silent for longer has no last value
_MOST_SERIES = 200  # noise must not name unbounded numbers of series


@dataclass(slots=True)
class _Source:
    """A source's last value, its arrival, and the time between its last two [ns]; 0 where that is not known."""

    value: float
    arrival_ns: int
    interval_ns: int = 0


@dataclass(slots=True)
class _Series:
    values: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST))
    count: int = 0
    sources: list[_Source] = field(default_factory=list)


class InterleavedSources:
    """The sources of one line, by the name of what they report."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._series: dict[str, _Series] = {}

    def source_number(self, label: str, quantity: str, value: float, arrival_ns: int) -> int:
        """Which source reports a value of a quantity: 1 for the first, and as long as there is only one.

        ``label`` is that of the sentence, ``arrival_ns`` its arrival on the monotonic clock.
        """
        unit = quantity.rpartition("_")[2]
        series = self._series.get(key := f"{label} {quantity}")
        if series is None:
            if unit not in _LEAST_LEVEL_DISTANCE or len(self._series) >= _MOST_SERIES:
                return 1
            series = self._series[key] = _Series()
        if series.sources:
            return _assign_source(series.sources, value, arrival_ns, unit)
        series.values.append(value)
        series.count += 1
        if series.count >= _FEWEST and (series.count - _FEWEST) % _STRIDE == 0:
            values, least = [*series.values], _LEAST_LEVEL_DISTANCE[unit]
            parts = (values[-_FEWEST:], values)  # a turn of the ship invalidates the longer one
            levels = next(
                filter(None, (alternating_levels(part, least, circular=unit == "deg") for part in parts)), None
            )
            if levels is not None:
                series.sources = [_Source(level, arrival_ns) for level in levels]
                first, second = levels
                text = (
                    f"{label.partition('/')[2]} alternates between {first:.4g} and {second:.4g} in {quantity}:"
                    " two sources under one talker; the second's values are kept apart from here on, as source2"
                )
                self._notices.append(("warning", text))
                return _assign_source(series.sources, value, arrival_ns, unit)
        return 1


def alternating_levels(values: Sequence[float], least: float, *, circular: bool) -> tuple[float, float] | None:
    """The last values of two alternating sources, that of the first value first; None where there is one source.

    ``least`` is the least distance of the two; ``circular`` values are angles in degrees.
    """
    steps = [_value_or_angle_difference(later, former, circular) for former, later in pairwise(values)]
    largest = sorted(map(abs, steps))[-_FEWEST_TURNS:]
    distance = largest[_FEWEST_TURNS // 2]
    places = [place for place, step in enumerate(steps) if abs(step) > _INTERMEDIATE[1] * distance]
    turns = [steps[place] for place in places]
    intermediate = sum(abs(step) > _INTERMEDIATE[0] * distance for step in steps) - len(turns)
    adjacent = sum(place + 1 in places or place - 1 in places for place in places)
    in_turn = all(former * later < 0.0 for former, later in pairwise(turns))
    if (
        distance < least
        or len(turns) < _FEWEST_TURNS
        or intermediate
        or max(abs(abs(turn) - distance) for turn in turns) > _TURN_SPREAD * distance
        or adjacent < _RETURNS * len(turns)
        or not (in_turn or (circular and distance > _HALF_TURN_DEG))
    ):
        return None
    last = [0.0, 0.0]
    side = 0
    for place, value in enumerate(values):
        side = (side + (place - 1 in places)) % 2
        last[side] = value
    return last[0], last[1]


def _assign_source(sources: list[_Source], value: float, arrival_ns: int, unit: str) -> int:
    """The source with the last value nearest to a value; where the two values have met, the one that is due."""
    present = [source for source in sources if arrival_ns - source.arrival_ns <= _SILENT_NS] or sources
    circular = unit == "deg"
    have_met = (
        abs(_value_or_angle_difference(sources[0].value, sources[1].value, circular))
        < 0.5 * _LEAST_LEVEL_DISTANCE[unit]
    )

    def distance(source: _Source) -> float:
        if not have_met:
            return abs(_value_or_angle_difference(value, source.value, circular))
        # in intervals, before or after it is due
        return abs((arrival_ns - source.arrival_ns) / source.interval_ns - 1.0) if source.interval_ns else 0.0

    source = min(present, key=distance)
    source.value, source.arrival_ns, source.interval_ns = value, arrival_ns, arrival_ns - source.arrival_ns
    return sources.index(source) + 1


def _value_or_angle_difference(later: float, former: float, circular: bool) -> float:
    return (later - former + 180.0) % 360.0 - 180.0 if circular else later - former
