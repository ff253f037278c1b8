"""NMEA 0183 sentences from a text file, as fast as they are taken.

A log that tells times keeps them: a line counts as received when the time before it says (seconds or milliseconds
since 1970, or ISO 8601 in UTC with its Z), or else its TAG block. In a log without any, lines count as received
when they are read. Lines that begin with ``#`` are a person's.
"""

from __future__ import annotations

import datetime as dt
import re
from typing import BinaryIO

from acquisition.config.sections import FileSource
from acquisition.core.frames import EPOCH, Frame
from acquisition.decoders.clock import is_possible
from acquisition.decoders.nmea0183 import split_tag, unix_ns
from acquisition.sources import LogReader
from acquisition.sources.streams import LineAssembler

_BLOCK_BYTES = 8192
_STAMP = re.compile(
    rb"(\d{13}|\d{10}(?:\.\d{1,9})?|\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?Z)[ \t,;]+(?=[$!\\])"
)


class LogFile(LogReader):
    """One file of sentences."""

    def __init__(self, config: FileSource) -> None:
        super().__init__(config)
        self._lines = LineAssembler(config.name)
        self._time = LogTime()

    def _next(self, file: BinaryIO) -> list[Frame] | None:
        block = file.read(_BLOCK_BYTES)
        frames = self._lines.push(block) if block else self._lines.end()
        if not block and not frames:
            return None
        return self._time.stamp([frame for frame in frames if not frame.payload.startswith(b"#")])


class LogTime:
    """The time that a log tells, which never goes back.

    A line without one has the time of the line before it; what precedes the first has the first.
    """

    def __init__(self) -> None:
        self._now_ns: int | None = None

    def stamp(self, frames: list[Frame]) -> list[Frame]:
        """The bare lines with the log's time for every time they have; their own as long as the log tells none."""
        told = [_told(frame.payload) for frame in frames]
        if self._now_ns is None:
            self._now_ns = next((time_ns for time_ns, _ in told if time_ns is not None), None)
        return [self._stamped(frame, *each) for frame, each in zip(frames, told, strict=True)]

    def _stamped(self, frame: Frame, told_ns: int | None, payload: bytes) -> Frame:
        if self._now_ns is None:
            return frame._replace(payload=payload)
        now_ns = self._now_ns = max(self._now_ns, told_ns or 0)
        return frame._replace(payload=payload, received_ns=now_ns, monotonic_ns=now_ns, stamped_ns=now_ns)


def _told(line: bytes) -> tuple[int | None, bytes]:
    """When a line was received (UTC, ns since 1970), as the log or else its TAG block tells, and the bare line."""
    found = _STAMP.match(line)
    payload = line[found.end() :] if found else line
    time_ns = _stamp_ns(found[1].decode("ascii")) if found else split_tag(line).time_ns
    return (time_ns if time_ns is not None and is_possible(time_ns) else None), payload


def _stamp_ns(text: str) -> int | None:
    if "T" not in text:
        return unix_ns(text)
    try:
        return (dt.datetime.fromisoformat(text) - EPOCH) // dt.timedelta(microseconds=1) * 1000
    except ValueError:
        return None
