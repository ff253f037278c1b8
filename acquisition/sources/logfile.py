"""NMEA 0183 sentences from a text file, as fast as they are taken.

A log that was kept with TAG blocks keeps its own time: its lines count as received when the block says. In a log
without any, lines count as received when they are read. Lines that begin with ``#`` are a person's.
"""

from __future__ import annotations

from dataclasses import replace
from typing import BinaryIO

from acquisition.decoders.clock import is_possible
from acquisition.decoders.tag_block import split_tag
from acquisition.errors import SourceError
from acquisition.frames import Frame
from acquisition.sections import FileSource
from acquisition.sources.lines import LineAssembler

_BLOCK_BYTES = 8192


class LogFile:
    """One file, read once; it ends, which the pipeline understands."""

    waits = True

    def __init__(self, config: FileSource) -> None:
        self.name = config.name
        self._config = config
        self._file: BinaryIO | None = None
        self._lines = LineAssembler(config.name)
        self._time = LogTime()

    def open(self) -> None:
        try:
            self._file = self._config.path.open("rb")
        except OSError as error:
            raise SourceError(
                f"file {self._config.path} cannot be opened",
                where=f"source {self.name!r}",
                why=str(error.strerror),
                fix="correct `path`",
            ) from error

    def read(self, timeout_s: float) -> list[Frame] | None:
        if self._file is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            block = self._file.read(_BLOCK_BYTES)
        except OSError as error:
            raise SourceError("file failed", where=f"source {self.name!r}", why=str(error.strerror)) from error
        frames = self._lines.push(block) if block else self._lines.end()
        if not block and not frames:
            return None
        return self._time.stamped([frame for frame in frames if not frame.payload.startswith(b"#")])

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


class LogTime:
    """The time that a log's TAG blocks tell, which never goes back.

    A line without one has the time of the line before it; what precedes the first has the first.
    """

    def __init__(self) -> None:
        self._now_ns: int | None = None

    def stamped(self, frames: list[Frame]) -> list[Frame]:
        """The frames with the log's time for every time they have; unchanged as long as the log tells none."""
        told_ns = [_told_ns(frame) for frame in frames]
        if self._now_ns is None:
            self._now_ns = next((each for each in told_ns if each is not None), None)
        return [self._stamped(frame, each) for frame, each in zip(frames, told_ns, strict=True)]

    def _stamped(self, frame: Frame, told_ns: int | None) -> Frame:
        if self._now_ns is None:
            return frame
        self._now_ns = max(self._now_ns, told_ns or 0)
        return replace(frame, received_ns=self._now_ns, monotonic_ns=self._now_ns, stamped_ns=self._now_ns)


def _told_ns(frame: Frame) -> int | None:
    told_ns = split_tag(frame.payload).time_ns
    return told_ns if told_ns is not None and is_possible(told_ns) else None
