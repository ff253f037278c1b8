"""One line of text to one logged CAN frame: candump's three forms and canboat's lines.

Times are as the line gives them, in ns since 1970 or since the log began; a line without a time has none.
"""

from __future__ import annotations

import datetime as dt
import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

from acquisition.core.frames import NANO, FrameFlag

_MOST_BYTES = 64
_FAST_BYTES = 223  # the most that a message in several frames of NMEA 2000 can hold
_ERROR_BIT = 0x20000000  # candump marks error frames by a bit above the 29 of the identifier


class LogEntry(NamedTuple):
    """One frame of a log."""

    time_ns: int | None
    identifier: int
    payload: bytes
    flags: FrameFlag


_CANDUMP_LOG = re.compile(
    r"\((?P<time>[\d.]+)\)\s+\S+\s+(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:#(?P<fd>[0-9A-Fa-f]))?"
    r"(?P<data>(?:[0-9A-Fa-f]{2}\.?)*|R[0-9A-Fa-f]?)(?:_[0-9A-Fa-f])?(?:\s+[RT])?\s*"
)
_CANDUMP_CONSOLE = re.compile(
    r"(?:\((?P<time>[\d.]+|\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+)\)\s+)?\S+\s+(?:[RT]X [B-] [E-]\s+)?"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(?P<length>\d{1,2})\]"
    r"(?:\s+(?P<remote>remote request)|(?P<data>(?:\s+[0-9A-Fa-f]{2})*))(?:\s+ERRORFRAME|\s+'.*')?\s*"
)
_CANDUMP_OLD = re.compile(
    r"<0x(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})>\s+\[(?P<length>\d{1,2})\](?P<data>(?:\s+[0-9A-Fa-f]{2})*)\s*"
)
_CANBOAT = re.compile(
    r"(?P<time>\d{4}-\d\d-\d\d[-T ]\d\d:\d\d:\d\d(?:\.\d+)?)Z?,(?P<priority>[0-7]),(?P<group>\d{1,6}),"
    r"(?P<source>\d{1,3}),(?P<destination>\d{1,3}),(?P<length>\d{1,3})(?P<data>(?:,[0-9A-Fa-f]{2})*),?\s*"
)
_NO_FRAME = re.compile(r"\s*(?:[#;].*|interface = .*)?")


class LineReader:
    """Lines to frames; ``unreadable`` counts those that are neither a frame nor a comment."""

    def __init__(self) -> None:
        self.unreadable = 0
        self._numbers: Counter[tuple[int, int]] = Counter()
        self._forms: list[tuple[re.Pattern[str], Callable[[re.Match[str]], list[LogEntry] | None]]] = [
            (_CANDUMP_LOG, _candump_log),
            (_CANBOAT, self._canboat),
            (_CANDUMP_CONSOLE, _candump_console),
            (_CANDUMP_OLD, _candump_console),
        ]

    def frames(self, line: str) -> list[LogEntry]:
        """The frames of a line: one, or several where the line is a message that was put together."""
        for place, (pattern, read) in enumerate(self._forms):
            if match := pattern.fullmatch(line):
                if place:  # the next line is most likely of the same form
                    self._forms.insert(0, self._forms.pop(place))
                if (frames := read(match)) is not None:
                    return frames
                break
        if not _NO_FRAME.fullmatch(line):
            self.unreadable += 1
        return []

    def _canboat(self, match: re.Match[str]) -> list[LogEntry] | None:
        group, source, destination = (int(match[name]) for name in ("group", "source", "destination"))
        data = bytes.fromhex(match["data"].replace(",", ""))
        addressed = (group >> 8) & 0xFF < 240
        if group > 0x3FFFF or max(source, destination) > 255 or len(data) != int(match["length"]):
            return None  # groups beyond 18 bits are a gateway's own and were on no bus
        if len(data) > _FAST_BYTES or (addressed and group & 0xFF):
            return None
        identifier = int(match["priority"]) << 26 | group << 8 | source | (destination << 8 if addressed else 0)
        time_ns = _utc_ns(match["time"], dt.UTC)
        if time_ns is None:
            return None
        return [LogEntry(time_ns, identifier, part, FrameFlag.NONE) for part in self._parts(source, group, data)]

    def _parts(self, source: int, group: int, data: bytes) -> Iterator[bytes]:
        """A message that was put together as the frames that it came in; they get a number of our own."""
        if len(data) <= 8:
            yield data
            return
        number = self._numbers[source, group] % 8 << 5
        self._numbers[source, group] += 1
        yield bytes((number, len(data))) + data[:6]
        for place, start in enumerate(range(6, len(data), 7), start=1):
            yield (bytes((number | place,)) + data[start : start + 7]).ljust(8, b"\xff")


def _candump_log(match: re.Match[str]) -> list[LogEntry] | None:
    remote = match["data"].startswith("R")
    data = b"" if remote else bytes.fromhex(match["data"].replace(".", ""))
    return _logged(match["time"], match["id"], data, remote)


def _candump_console(match: re.Match[str]) -> list[LogEntry] | None:
    found = match.groupdict()
    remote = found.get("remote") is not None
    data = bytes.fromhex(found["data"] or "")
    if not remote and len(data) != int(found["length"]):
        return None
    return _logged(found.get("time"), found["id"], data, remote)


def _logged(time: str | None, identifier: str, data: bytes, remote: bool) -> list[LogEntry] | None:
    time_ns = None if time is None else _time_ns(time)
    if len(data) > _MOST_BYTES or (time is not None and time_ns is None):
        return None
    number = int(identifier, 16)
    flags = FrameFlag.REMOTE if remote else FrameFlag.NONE
    if len(identifier) == 3:
        flags |= FrameFlag.STANDARD_ID
    if number & _ERROR_BIT:
        flags |= FrameFlag.ERROR
    return [LogEntry(time_ns, number & 0x1FFFFFFF, data, flags)]


def _time_ns(text: str) -> int | None:
    """Seconds, or a date and time of this machine's zone, which is what candump prints; None for anything else."""
    if "-" in text:
        return _utc_ns(text, None)
    seconds, _, fraction = text.partition(".")
    if not seconds.isdigit() or (fraction and not fraction.isdigit()) or len(seconds) > 10:
        return None
    return int(seconds) * NANO + int(fraction[:9].ljust(9, "0"))


def _utc_ns(text: str, zone: dt.tzinfo | None) -> int | None:
    """A date and a time in a zone, this machine's if none, as ns since 1970."""
    date, clock, fraction = text[:10], text[11:19], text[20:]
    try:
        whole = dt.datetime.fromisoformat(f"{date}T{clock}")
    except ValueError:
        return None
    seconds = round((whole.replace(tzinfo=zone) if zone else whole.astimezone()).timestamp())
    return seconds * NANO + int(fraction[:9].ljust(9, "0"))
