"""Vector's ASC: a header with the date, then a line for each event on one of several channels.

What the stamps count from is told in three ways: the header's date, unless the header says that each counts from
the line before; or midnight, by programs that write times of day below a date of their own. Dates are this
machine's local time, as their writers mean them.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterator
from typing import BinaryIO

from seatrial.acquisition.core.frames import HIGHEST_IDENTIFIER, NANO, FrameFlag, can_flags
from seatrial.acquisition.core.times import Order, Stamp
from seatrial.acquisition.decoders.clock import DAY_NS
from seatrial.acquisition.sources.line_forms import LineReader, LogEntry

_LONGEST_LINE = 65_536
_MOST_BYTES = 64  # of a frame of CAN FD
_STAMPED = re.compile(r"(?P<seconds>-?\d{1,10})(?:\.(?P<fraction>\d{1,9}))?\s+(?P<rest>.*)")
_FRAME = re.compile(
    r"(?P<channel>\d{1,3})\s+(?P<id>[0-9A-Fa-f]{1,10})(?P<extended>x?)\s+(?:Rx|Tx|TxRq)\s+(?P<kind>[dr])"
    r"(?:\s+(?P<length>[0-9A-Fa-f]{1,2}))?(?P<data>(?:\s+[0-9A-Fa-f]{1,3})*)(?:\s+Length\s*=.*)?\s*",
    re.IGNORECASE,
)
_FD_FRAME = re.compile(
    r"CANFD\s+(?P<channel>\d{1,3})\s+(?:Rx|Tx|TxRq)\s+(?P<id>[0-9A-Fa-f]{1,10})(?P<extended>x?)(?:\s+[A-Za-z_]\w*)?"
    r"\s+[01]\s+[01]\s+[0-9A-Fa-f]{1,2}\s+(?P<length>\d{1,2})(?P<data>(?:\s+[0-9A-Fa-f]{1,3})*).*",
    re.IGNORECASE,
)
_ERROR = re.compile(r"(?:CANFD\s+)?(?P<channel>\d{1,3})\s+(?:(?:Rx|Tx)\s+)?ErrorFrame\b.*", re.IGNORECASE)
_EVENT = re.compile(
    r"(?:CAN\s+)?\d{1,3}\s+(?:Statistic|Status)\b.*|CAN\s+\d{1,3}\s+Status\b.*|Start of measurement.*"
    r"|log (?:trigger|direct) .*|(?:SV|SysVar|EnvVar|Comment|TriggerEvent|GPS-Event|GlobalMarker)\b.*",
    re.IGNORECASE,
)
_SECTION = re.compile(r"(?:end|begin)\s+trigger\s*block\b.*|(?:no )?internal events logged.*|//.*|", re.IGNORECASE)
_BEGINS = re.compile(rb"\s*(?:date\s+\S|base\s+(?:hex|dec)\b|//\s*version\b)", re.IGNORECASE)
_DAY_BEGAN_WITHIN_NS = 600 * NANO
"""A stamp that is the header's time of day, or up to ten minutes later, counts from midnight: as a time since the
header it would mean a pause of just so long."""
_EARLIEST_TIME_OF_DAY_NS = 3600 * NANO  # what is less is a time since the header, whatever that says


def begins_asc(head: bytes) -> bool:
    """Whether a file begins as ASC does."""
    return _BEGINS.match(head.removeprefix(b"\xef\xbb\xbf")) is not None


def read_asc(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The frames of a log. Raises :class:`ValueError` where its last line is cut off."""
    log = _Log(reader)
    while line := file.readline(_LONGEST_LINE):
        entry = log.entry(line.decode("utf-8", "replace").strip("\ufeff \t\r\n"))
        if entry is not None:
            yield entry
    if log.is_cut:
        raise ValueError("its last line is cut off")


class _Log:
    """What the header says, and the time of the line before."""

    def __init__(self, reader: LineReader) -> None:
        self._reader = reader
        self._base, self._relative, self._counts_from_midnight = 16, False, False
        self._began: Stamp | None = None
        self._last_ns: int | None = None
        self.is_cut = False  # whether the last line began as a frame does, but had too few bytes

    def entry(self, text: str) -> LogEntry | None:
        """The frame in a line, if there is one; a line of neither header, events nor frames is counted."""
        self.is_cut = False
        stamped = _STAMPED.fullmatch(text)
        if stamped is None:
            self._reader.unreadable += not self._header(text)
            return None
        time_ns = self._time_ns(stamped)
        entry = _entry(stamped["rest"], self._base)
        if entry is None:
            self.is_cut = _FRAME.match(stamped["rest"]) is not None
            self._reader.unreadable += _EVENT.fullmatch(stamped["rest"]) is None
            return None
        return entry._replace(time_ns=time_ns)

    def _header(self, text: str) -> bool:
        """Take up a line of the header, or of a trigger block; whether it is one."""
        words = text.lower().split()
        if words[:1] == ["base"]:
            self._base = 10 if words[1:2] == ["dec"] else 16
            self._relative = words[2:4] == ["timestamps", "relative"]
            return True
        if words[:1] == ["date"] or words[:2] in (["begin", "triggerblock"], ["begin", "trigger"]):
            self._reader.times.read(text)
            self._began = self._reader.times.last or self._began
            self._last_ns = None
            return True
        return _SECTION.fullmatch(text) is not None

    def _time_ns(self, stamped: re.Match[str]) -> int:
        """The line's time: UTC where the log has a date, else since its beginning."""
        fraction_ns = int((stamped["fraction"] or "").ljust(9, "0"))
        stated_ns = int(stamped["seconds"]) * NANO + (-fraction_ns if stamped["seconds"][0] == "-" else fraction_ns)
        is_first, before_ns = self._last_ns is None, self._last_ns or 0
        self._last_ns = stated_ns + before_ns if self._relative else stated_ns
        if self._began is None:
            return self._last_ns
        if is_first and not self._relative:
            self._counts_from_midnight = _is_time_of_day(stated_ns, self._began)
            if self._counts_from_midnight:
                self._reader.times.remark = "its stamps are times of day: they count from midnight of its date"
        began_ns = _utc_ns(self._began, self._reader.times.order_of(self._began))
        return self._last_ns + (began_ns - self._began.clock_ns if self._counts_from_midnight else began_ns)


def _is_time_of_day(stated_ns: int, began: Stamp) -> bool:
    since_ns = (stated_ns - began.clock_ns) % DAY_NS
    return stated_ns >= _EARLIEST_TIME_OF_DAY_NS and since_ns <= _DAY_BEGAN_WITHIN_NS


def _utc_ns(began: Stamp, order: Order) -> int:
    """A header's date as UTC: its zone is this machine's if it has none."""
    local_ns = began.local_ns(order)
    if began.offset_s is not None:
        return local_ns - began.offset_s * NANO
    seconds, fraction_ns = divmod(local_ns, NANO)
    here = dt.datetime.fromtimestamp(seconds, dt.UTC).replace(tzinfo=None).astimezone()
    return round(here.timestamp()) * NANO + fraction_ns


def _entry(text: str, base: int) -> LogEntry | None:
    """The frame in what follows a stamp, as yet without its time."""
    if match := _ERROR.fullmatch(text):
        return LogEntry(None, b"", 0, can_flags(standard=True, error=True), bus=f"channel{match['channel']}")
    match = _FRAME.fullmatch(text) or _FD_FRAME.fullmatch(text)
    if match is None:
        return None
    parts = match.groupdict()
    remote = (parts.get("kind") or "d").lower() == "r"
    try:
        identifier, data = int(parts["id"], base), b"" if remote else _bytes(parts, base)
    except ValueError:  # digits of another base, or bytes beyond 255
        return None
    extended = bool(parts["extended"])
    if data is None or identifier > (HIGHEST_IDENTIFIER if extended else 0x7FF):
        return None
    flags: FrameFlag = can_flags(not extended, remote)
    return LogEntry(None, data, identifier, flags, bus=f"channel{parts['channel']}")


def _bytes(parts: dict[str, str], base: int) -> bytes | None:
    """A frame's data, as many bytes as it says; None where some are missing."""
    length = int(parts["length"] or "0", 10 if "kind" not in parts else 16)
    if "kind" in parts:
        length = min(length, 8)  # codes beyond 8 mean 8 on classical CAN
    numbers = parts["data"].split()[:length]
    return bytes(int(number, base) for number in numbers) if len(numbers) == length <= _MOST_BYTES else None
