"""CAN frames from a log file, told apart by what is in it: candump's or canboat's text, BLF, ASC or TRC.

A log's time is UTC where it gives one; dates without a zone are this machine's local time in ASC and candump's
text (as their writers mean them) and UTC in canboat's and TRC. Times before 2001 are times since the log began:
such frames keep their distances, counted from the moment of opening, but bear no stamp. A log without any time
is received as fast as it is read.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from io import TextIOWrapper
from itertools import islice, pairwise
from pathlib import Path
from typing import BinaryIO

import can

from acquisition.config.sections import CanFileSource
from acquisition.core.frames import Frame, iso, now_ns
from acquisition.sources import LogReader
from acquisition.sources.can_bus import flags_of
from acquisition.sources.can_text import LineReader, LogEntry

_MOST_FRAMES_AT_ONCE = 300
_HEAD_BYTES = 16_384
_LONGEST_LINE = 4_096
_HIGHEST_IDENTIFIER = 0x1FFFFFFF
_LIBRARY_LOGGERS = tuple(logging.getLogger(f"can.io.{kind}") for kind in ("asc", "blf", "trc"))
_EARLIEST_UTC_NS = 1_000_000_000 * 10**9
_LATEST_NS = 2**63


class CanFile(LogReader):
    """One log; ``unreadable`` counts its lines (of BLF: objects) that held no frame."""

    def __init__(self, config: CanFileSource) -> None:
        super().__init__(config)
        self._log: _TextLog | _LibraryLog | None = None
        self._frames: Iterator[LogEntry] = iter(())
        self._opened_ns = self._last_ns = self._count = 0
        self._newest_ns: int | None = None  # as the log tells it
        self.timed = True  # whether the last frame had a time, of whatever kind

    @property
    def unreadable(self) -> int:
        return 0 if self._log is None else self._log.unreadable

    @property
    def damage(self) -> str:
        """What is broken in the log and where its reading ended; empty for a log that was read to its end."""
        if self._log is None or not self._log.damage:
            return ""
        where = f"reading ended after {self._count:,} frames"
        if self._newest_ns is not None:
            where += f", the last of {_told_time(self._newest_ns)}"
        return f"the log is damaged ({self._log.damage}); {where}"

    def _begin(self, file: BinaryIO) -> None:
        self._log = _log(file, self._config.path)
        self._frames = iter(self._log)
        self._opened_ns, self._last_ns, self._count, self._newest_ns = now_ns()[0], 0, 0, None

    def _next(self, file: BinaryIO) -> list[Frame] | None:
        return [self._frame(logged) for logged in islice(self._frames, _MOST_FRAMES_AT_ONCE)] or None

    def close(self) -> None:
        self._frames = iter(())
        super().close()

    def _frame(self, logged: LogEntry) -> Frame:
        self._count, self._newest_ns, self.timed = self._count + 1, logged.time_ns, logged.time_ns is not None
        stamped_ns, (received_ns, monotonic_ns) = None, now_ns()
        if logged.time_ns is not None and logged.time_ns >= _EARLIEST_UTC_NS:
            stamped_ns = received_ns = monotonic_ns = logged.time_ns
        elif logged.time_ns is not None:
            received_ns = monotonic_ns = self._opened_ns + logged.time_ns
        self._last_ns = max(self._last_ns, monotonic_ns)
        return Frame(
            self.name,
            "can",
            logged.payload,
            received_ns,
            self._last_ns,
            logged.identifier,
            logged.flags,
            stamped_ns,
        )


def _told_time(time_ns: int) -> str:
    """A log's time for a person: UTC, or since it began; broken ones can lie beyond all dates."""
    if time_ns < _EARLIEST_UTC_NS:
        return f"{time_ns / 1e9:.3f} s after its beginning"
    return iso(time_ns) if time_ns < _LATEST_NS else f"{time_ns / 1e9:.3f} s since 1970"


def _log(file: BinaryIO, path: Path) -> _TextLog | _LibraryLog:
    """The log in an open file, by its first bytes. Raises :class:`ValueError` for what is none."""
    head = file.read(_HEAD_BYTES)
    file.seek(0)
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines()]
    reader = LineReader()
    times_ns = [logged.time_ns for line in lines for logged in reader.frames(line)]
    if times_ns or not head:
        return _TextLog(file, differences=_are_differences(times_ns))
    first = next((line.lower() for line in lines if line), "")
    if head.startswith(b"LOGG"):
        return _LibraryLog(lambda: can.BLFReader(file), path.stat().st_size)
    if first.startswith(";"):
        return _LibraryLog(lambda: can.TRCReader(_text(file)))
    if first.startswith(("date ", "base ")):
        return _LibraryLog(lambda: can.ASCReader(_text(file), relative_timestamp=False))
    raise ValueError("it holds no frame of candump, canboat, BLF, ASC or TRC")


def _text(file: BinaryIO) -> TextIOWrapper:
    return TextIOWrapper(file, encoding="utf-8", errors="replace")


def _are_differences(times_ns: list[int | None]) -> bool:
    """Whether times are since the frame before (candump -td): times since the log began would not fall."""
    given = [each for each in times_ns if each is not None]
    return any(later < former < _EARLIEST_UTC_NS for former, later in pairwise(given))


class _TextLog:
    """Lines; one that is too long to be a frame is read in pieces, which are none either."""

    damage = ""  # whatever is broken in a text is broken lines

    def __init__(self, file: BinaryIO, differences: bool) -> None:
        self._file = file
        self._differences = differences
        self._reader = LineReader()

    @property
    def unreadable(self) -> int:
        return self._reader.unreadable

    def __iter__(self) -> Iterator[LogEntry]:
        since_start_ns = 0
        while line := self._file.readline(_LONGEST_LINE):
            for logged in self._reader.frames(line.decode("utf-8", "replace").strip()):
                if self._differences and logged.time_ns is not None:
                    since_start_ns += logged.time_ns
                    yield logged._replace(time_ns=since_start_ns)
                else:
                    yield logged


class _LibraryLog(logging.Filter):
    """A log by one of python-can's readers; what it trips over ends the log, and is its ``damage``.

    What a reader passes over it tells its logger only: that is counted, and not printed.
    """

    def __init__(self, make_reader: Callable[[], Iterable[can.Message]], size_bytes: int = 0) -> None:
        super().__init__()
        self.unreadable = 0
        self.damage = ""
        self._size_bytes = size_bytes  # of BLF; 0 for text
        try:
            self._reader = make_reader()
        except Exception as error:  # the library promises no set of errors for a broken log
            raise ValueError(f"its beginning is broken: {error}") from error

    def filter(self, record: logging.LogRecord) -> bool:
        self.unreadable += 1
        return False

    def __iter__(self) -> Iterator[LogEntry]:
        cut = False
        for logger in _LIBRARY_LOGGERS:
            logger.addFilter(self)
        try:
            for message in self._reader:
                cut = not self._size_bytes and _is_cut(message)
                if message.arbitration_id <= _HIGHEST_IDENTIFIER and not cut:
                    yield _logged(message)
                else:
                    self.unreadable += 1
            self.damage = self._cut() or ("its last line is cut off" if cut else "")
        except OSError:
            raise
        except Exception as error:
            self.damage = self._cut() or f"{type(error).__name__}: {error}".rstrip(": ")
        finally:
            for logger in _LIBRARY_LOGGERS:
                logger.removeFilter(self)

    def _cut(self) -> str:
        """What is missing at the end of a BLF log, as far as it can tell."""
        once_bytes = getattr(self._reader, "file_size", 0)
        if once_bytes > self._size_bytes:
            return f"it was {once_bytes:,} bytes long, {self._size_bytes:,} are left"
        if bytes(getattr(self._reader, "_tail", b"")).strip(b"\0"):
            return "its last object is cut off"
        return ""


def _is_cut(message: can.Message) -> bool:
    """Whether bytes are missing: the library fills nothing up where a line of ASC ends before its data."""
    whole = min(message.dlc, 64 if message.is_fd else 8)
    return not (message.is_remote_frame or message.is_error_frame) and len(message.data) < whole


def _logged(message: can.Message) -> LogEntry:
    time_ns = round(message.timestamp * 1e6) * 1000  # no finer than the microsecond that a float of today holds
    return LogEntry(time_ns, message.arbitration_id, bytes(message.data), flags_of(message))
