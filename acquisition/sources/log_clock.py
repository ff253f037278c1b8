"""The times of a log's entries: UTC as far as the log, the bus or a sentence tells it, else since the log began."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from statistics import median_low

from seatrial.acquisition.core.frames import NANO, FrameFlag, iso, now_ns
from seatrial.acquisition.decoders.clock import DAY_NS, is_possible, rolled_over_ns, utc_ns
from seatrial.acquisition.decoders.nmea0183 import sentences_in, split_sentence, split_tag
from seatrial.acquisition.decoders.nmea2000 import parameter_group
from seatrial.acquisition.decoders.parameter_groups import (
    FIELDS,
    GNSS_POSITION,
    SYSTEM_TIME,
    TIME_AND_DATE,
    Message,
    group_time,
)
from seatrial.acquisition.decoders.sentences import Fields, SentenceReading, readers
from seatrial.acquisition.sources.line_forms import LogEntry

EARLIEST_UTC_NS = 1_000_000_000 * NANO
"""Times before are since the log began."""
_LATEST_NS = 4_102_444_800 * NANO  # 2100; what is later is broken
_SLACK_NS = NANO  # by so much a clock that comes round may go back without having come round
_MANY = 100  # entries at one and the same time: the gateway's clock stands still
_AGREED_NS = 2 * NANO  # the bus tells whole seconds, late
_TELL_TIME = {kind: read for kind, read in readers("ground").items() if kind in ("ZDA", "RMC")}


class LogClock:
    """The clock of one log, learned from its first entries; ``changed_ns`` is when the file was last changed.

    ``remark`` is what should be known of its times.
    """

    def __init__(self, head: Sequence[LogEntry], changed_ns: int) -> None:
        self.remark = ""
        self._now_ns: int | None = None
        self._differences = _are_differences([entry.time_ns for entry in head if not entry.turn_ns])
        self._epoch_ns = 0  # UTC when the log's running time was zero; 0 as long as nobody tells it
        self._begin()
        self._stands_still = len(head) > _MANY and len({entry.time_ns for entry in head}) == 1
        running = [(self._running_ns(entry), entry) for entry in head]
        timed = [(time_ns, entry) for time_ns, entry in running if time_ns is not None]
        self._teller = None if timed else _usual_teller(head)
        if self._teller is not None:
            self.remark = (
                "it has no times of its own; what the bus or a sentence tells is taken, mostly whole seconds"
            )
        self._learn(timed, changed_ns)
        rolled_over = next((entry for entry in head if _is_rolled_over(entry)), None)
        if rolled_over is not None:
            date = iso(told_utc_ns(rolled_over) or 0)[:10]
            self.remark = f"a receiver's weeks have rolled over: its date is 1,024 weeks back, {date} is taken"
        self._begin()
        next((entry for entry in head if self.time_ns(entry) is not None), None)  # what comes before has it, too
        self._begin()

    def _begin(self) -> None:
        self._turns: dict[int, tuple[int, int]] = {}
        self._since_start_ns = 0

    def time_ns(self, entry: LogEntry) -> int | None:
        """The entry's time, or that of the one before: UTC, or since the log began; None where there is none."""
        if self._teller is not None:
            told_ns = told_utc_ns(entry) if _teller(entry) == self._teller else None
            self._now_ns = self._now_ns if told_ns is None else told_ns
            return self._now_ns
        running_ns = self._running_ns(entry)
        if running_ns is not None:
            self._now_ns = running_ns + (self._epoch_ns if running_ns < EARLIEST_UTC_NS else 0)
        return self._now_ns

    def _running_ns(self, entry: LogEntry) -> int | None:
        """As the entry tells it, but that a clock which comes round runs on, and differences are added up."""
        time_ns, turn_ns = entry.time_ns, entry.turn_ns
        if time_ns is None or self._stands_still or not 0 <= time_ns < _LATEST_NS:
            return None
        if turn_ns:
            before_ns, running_ns = self._turns.get(turn_ns, (time_ns, self._since_start_ns or time_ns))
            running_ns += (time_ns - before_ns + _SLACK_NS) % turn_ns - _SLACK_NS
            self._turns[turn_ns] = time_ns, running_ns
            time_ns = max(running_ns, 0)
        elif time_ns >= EARLIEST_UTC_NS:
            return time_ns
        elif self._differences:
            time_ns += self._since_start_ns
        time_ns = min(time_ns, EARLIEST_UTC_NS - 1)
        self._since_start_ns = max(time_ns, self._since_start_ns)
        return time_ns

    def _learn(self, running: list[tuple[int, LogEntry]], changed_ns: int) -> None:
        """When the log began, by who tells UTC in its beginning or, of times of day, by the file's last change."""
        since = [(time_ns, entry) for time_ns, entry in running if time_ns < EARLIEST_UTC_NS]
        if not since:
            return
        teller = _usual_teller([entry for _, entry in since])
        starts_ns = [
            utc - time_ns
            for time_ns, entry in since
            if _teller(entry) == teller and (utc := told_utc_ns(entry)) is not None
        ]
        # a receiver that has just been switched on tells anything
        began_ns = median_low(starts_ns) if starts_ns else 0
        has_clock = any(entry.turn_ns == DAY_NS for _, entry in since)
        if began_ns and has_clock and abs(began_ns - (midnight := _whole_days(began_ns))) <= _AGREED_NS:
            began_ns = midnight
        elif began_ns and has_clock:
            off_s = (_whole_days(began_ns) - began_ns) / 1e9
            self.remark = f"its clock is {off_s:+.1f} s from that of the bus or a sentence, which is taken"
        elif has_clock:
            last_ns = max(time_ns for time_ns, _ in since)
            began_ns = (changed_ns - last_ns) // DAY_NS * DAY_NS
            self.remark = "it tells times of day but no date; that of the file's last change is taken"
        elif not began_ns:
            self.remark = "its times count from its beginning, and it has no date: the moment of reading is taken"
        self._epoch_ns = began_ns


def _teller(entry: LogEntry) -> tuple[int, bytes]:
    """Who says it: the identifier of a frame, the beginning of a sentence."""
    return entry.identifier, b"" if entry.protocol == "can" else split_tag(entry.payload).sentence[:6]


def _usual_teller(head: Sequence[LogEntry]) -> tuple[int, bytes] | None:
    """Who tells the UTC most often: two that did would make the time go to and fro."""
    tellers = Counter(_teller(entry) for entry in head if told_utc_ns(entry) is not None)
    return tellers.most_common(1)[0][0] if tellers else None


def _whole_days(time_ns: int) -> int:
    return (time_ns + DAY_NS // 2) // DAY_NS * DAY_NS


def told_utc_ns(entry: LogEntry) -> int | None:
    """The UTC that a message or a sentence tells [ns since 1970]; None for all others."""
    if entry.protocol == "nmea0183":
        stated = (_possible_ns(time_ns) for time_ns in map(_sentence_ns, sentences_in(entry.payload)))
        return next((utc for utc in stated if utc is not None), None)
    group = parameter_group(entry.identifier)[0]
    is_position = group == GNSS_POSITION and entry.flags == FrameFlag.WHOLE
    if not is_position and (group not in (SYSTEM_TIME, TIME_AND_DATE) or entry.flags & ~FrameFlag.WHOLE):
        return None
    stated_ns = group_time(Message(FIELDS[group], entry.payload))
    return stated_ns if stated_ns is not None and is_possible(stated_ns) else None


def _possible_ns(time_ns: int | None) -> int | None:
    """A time that can be true, or that a receiver means whose weeks have rolled over; None for others."""
    if time_ns is None or is_possible(time_ns):
        return time_ns
    return rolled_over_ns(time_ns, now_ns()[0])


def _is_rolled_over(entry: LogEntry) -> bool:
    stated = map(_sentence_ns, sentences_in(entry.payload)) if entry.protocol == "nmea0183" else ()
    return any(time_ns is not None and _possible_ns(time_ns) not in (None, time_ns) for time_ns in stated)


def _sentence_ns(line: bytes) -> int | None:
    """The date and time that a sentence states [ns since 1970]; None for all others."""
    tag, fields = split_sentence(split_tag(line).sentence) or ("", [])
    read = _TELL_TIME.get(tag[-3:])
    reading = SentenceReading() if read is None else read(Fields(fields))
    if reading.date is None or reading.seconds_of_day is None:
        return None
    return utc_ns(reading.date, reading.seconds_of_day)


def _are_differences(times_ns: list[int | None]) -> bool:
    """Whether times are since the frame before (candump -td): times since the log began would not fall."""
    stamps_ns = [time_ns for time_ns in times_ns if time_ns is not None]
    return any(later < former < EARLIEST_UTC_NS for former, later in pairwise(stamps_ns))
