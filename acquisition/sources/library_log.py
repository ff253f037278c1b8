"""CAN logs that python-can reads: BLF, ASC and TRC."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from io import TextIOWrapper
from typing import BinaryIO

import can

from acquisition.sources.can_bus import flags_of
from acquisition.sources.line_forms import HIGHEST_IDENTIFIER, Entry

_LIBRARY_LOGGERS = tuple(logging.getLogger(f"can.io.{kind}") for kind in ("asc", "blf", "trc"))


Make = Callable[[BinaryIO], Iterable[can.Message]]
_BLF: Make = can.BLFReader


class LibraryLog(logging.Filter):
    """A log by one of python-can's readers; what it trips over ends the log, and is its ``damage``.

    What a reader passes over it tells its logger only: that is counted, and not printed.
    """

    def __init__(self, make_reader: Make, file: BinaryIO) -> None:
        """Read the beginning. Raises :class:`ValueError` for a broken one."""
        super().__init__()
        self.close = file.close
        self.unreadable = 0
        self.damage = ""
        self._size_bytes = 0  # of BLF; 0 for text
        if make_reader is _BLF:
            self._size_bytes = file.seek(0, os.SEEK_END)
            file.seek(0)
        try:
            self._reader = make_reader(file)
        except Exception as error:  # the library promises no set of errors for a broken log
            file.close()
            raise ValueError(f"its beginning is broken: {error}") from error

    def filter(self, record: logging.LogRecord) -> bool:
        self.unreadable += 1
        return False

    def __iter__(self) -> Iterator[Entry]:
        cut = False
        for logger in _LIBRARY_LOGGERS:
            logger.addFilter(self)
        try:
            for message in self._reader:
                cut = not self._size_bytes and _is_cut(message)
                if message.arbitration_id <= HIGHEST_IDENTIFIER and not cut:
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


def _logged(message: can.Message) -> Entry:
    time_ns = round(message.timestamp * 1e6) * 1000  # no finer than the microsecond that a float of today holds
    return Entry(time_ns, bytes(message.data), message.arbitration_id, flags_of(message))


def library_form(head: bytes) -> Make | None:
    """What reads a log, by its first bytes; None for what python-can does not read."""
    first = next((line for line in head.decode("latin-1").lower().splitlines() if line.strip()), "").strip()
    if head.startswith(b"LOGG"):
        return _BLF
    if first.startswith(";"):
        return lambda file: can.TRCReader(_text(file))
    if first.startswith(("date ", "base ")):
        return lambda file: can.ASCReader(_text(file), relative_timestamp=False)
    return None


def _text(file: BinaryIO) -> TextIOWrapper:
    return TextIOWrapper(file, encoding="utf-8", errors="replace")
