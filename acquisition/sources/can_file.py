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
from typing import BinaryIO, Protocol

import can

from acquisition.errors import SourceError
from acquisition.frames import Frame, FrameFlag, now_ns
from acquisition.sections import CanFileSource
from acquisition.sources.can_text import LineReader, Logged

_MOST_FRAMES_AT_ONCE = 300
_HEAD_BYTES = 16_384
_LONGEST_LINE = 4_096
_HIGHEST_IDENTIFIER = 0x1FFFFFFF
_LIBRARY_LOGGERS = tuple(logging.getLogger(f"can.io.{kind}") for kind in ("asc", "blf", "trc"))
_EARLIEST_UTC_NS = 1_000_000_000 * 10**9


class _Log(Protocol):
    """One kind of log: its frames, and how much of it was none."""

    @property
    def unreadable(self) -> int: ...

    def __iter__(self) -> Iterator[Logged]: ...


class CanFile:
    """One log, read once; ``unreadable`` counts lines, or remains of a broken log, that held no frame."""

    lost = 0

    def __init__(self, config: CanFileSource) -> None:
        self.name = config.name
        self._path = config.path
        self._file: BinaryIO | None = None
        self._log: _Log | None = None
        self._frames: Iterator[Logged] = iter(())
        self._opened_ns = self._last_ns = 0

    @property
    def unreadable(self) -> int:
        return 0 if self._log is None else self._log.unreadable

    def open(self) -> None:
        try:
            self._file = self._path.open("rb")
            self._log = _log(self._file, self._path)
        except (OSError, ValueError) as error:
            self.close()
            raise SourceError(
                f"file {self._path} cannot be opened",
                where=f"source {self.name!r}",
                why=(error.strerror if isinstance(error, OSError) else None) or str(error),
                fix="correct `path`",
            ) from error
        self._frames = iter(self._log)
        self._opened_ns, self._last_ns = now_ns()[0], 0

    def read(self, timeout_s: float) -> list[Frame] | None:
        if self._file is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            frames = [self._frame(logged) for logged in islice(self._frames, _MOST_FRAMES_AT_ONCE)]
        except OSError as error:
            raise SourceError("file failed", where=f"source {self.name!r}", why=str(error.strerror)) from error
        return frames or None

    def close(self) -> None:
        self._frames = iter(())
        if self._file is not None:
            self._file.close()
            self._file = None

    def _frame(self, logged: Logged) -> Frame:
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


def _log(file: BinaryIO, path: Path) -> _Log:
    """The log in an open file, by its first bytes. Raises :class:`ValueError` for what is none."""
    head = file.read(_HEAD_BYTES)
    file.seek(0)
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines()]
    times_ns = _readable_times(lines)
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


def _readable_times(lines: list[str]) -> list[int | None]:
    reader = LineReader()
    return [logged.time_ns for line in lines for logged in reader.frames(line)]


def _are_differences(times_ns: list[int | None]) -> bool:
    """Whether times are since the frame before (candump -td): times since the log began would not fall."""
    given = [each for each in times_ns if each is not None]
    return any(later < former < _EARLIEST_UTC_NS for former, later in pairwise(given))


class _TextLog:
    """Lines; one that is too long to be a frame is read in pieces, which are none either."""

    def __init__(self, file: BinaryIO, differences: bool) -> None:
        self._file = file
        self._differences = differences
        self._reader = LineReader()

    @property
    def unreadable(self) -> int:
        return self._reader.unreadable

    def __iter__(self) -> Iterator[Logged]:
        since_start_ns = 0
        while line := self._file.readline(_LONGEST_LINE):
            for logged in self._reader.frames(line.decode("utf-8", "replace").strip()):
                if self._differences and logged.time_ns is not None:
                    since_start_ns += logged.time_ns
                    yield logged._replace(time_ns=since_start_ns)
                else:
                    yield logged


class _LibraryLog(logging.Filter):
    """A log by one of python-can's readers; what it trips over ends the log.

    What a reader passes over it tells its logger only: that is counted, and not printed.
    """

    def __init__(self, make_reader: Callable[[], Iterable[can.Message]], size_bytes: int = 0) -> None:
        super().__init__()
        self.unreadable = 0
        try:
            self._reader = make_reader()
        except Exception as error:  # the library promises no set of errors for a broken log
            raise ValueError(f"its beginning is broken: {error}") from error
        if getattr(self._reader, "file_size", 0) > size_bytes:  # BLF: how long it once was
            self.unreadable = 1

    def filter(self, record: logging.LogRecord) -> bool:
        self.unreadable += 1
        return False

    def __iter__(self) -> Iterator[Logged]:
        for logger in _LIBRARY_LOGGERS:
            logger.addFilter(self)
        try:
            for message in self._reader:
                if message.arbitration_id <= _HIGHEST_IDENTIFIER:
                    yield _logged(message)
                else:
                    self.unreadable += 1
        except OSError:
            raise
        except Exception:
            self.unreadable += 1
        finally:
            for logger in _LIBRARY_LOGGERS:
                logger.removeFilter(self)


def _logged(message: can.Message) -> Logged:
    flags = FrameFlag.NONE if message.is_extended_id else FrameFlag.STANDARD_ID
    if message.is_remote_frame:
        flags |= FrameFlag.REMOTE
    if message.is_error_frame:
        flags |= FrameFlag.ERROR
    time_ns = round(message.timestamp * 1e6) * 1000  # no finer than the microsecond that a float of today holds
    return Logged(time_ns, message.arbitration_id, bytes(message.data), flags)
