"""What a recorder without a person needs: log lines that a program can read, and a word to its supervisor."""

from __future__ import annotations

import json
import logging
import os
import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import Literal, TextIO

from seatrial.acquisition.core.process import started
from seatrial.acquisition.core.text import printable

LOG = logging.getLogger("seatrial")
_MOST_WAITING = 10_000
_LONGEST_JOIN_S = 2.0
LogFormat = Literal["text", "json"]


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC, ISO 8601), level, text, and what else the record carries."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "text": record.getMessage(),
            **getattr(record, "more", {}),
        }
        return json.dumps(line)  # in ASCII: also of what nothing encodes, and of what a terminal obeys


class _Text(logging.Formatter):
    """For a person: the text, with its level where that is more than information.

    Further lines of a text are indented, so that none passes for an entry of its own.
    """

    def format(self, record: logging.LogRecord) -> str:
        text = printable(record.getMessage()).replace("\n", "\n    ")
        return text if record.levelno <= logging.INFO else f"{record.levelname.lower()}: {text}"


class _Unhurried(logging.Handler):
    """Writes in a thread of its own: a terminal or a pipe that blocks must not hold up the recording."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(_MOST_WAITING)
        self._writer = threading.Thread(target=self._write, name="log", daemon=True)
        self._running = started(self._writer)

    def emit(self, record: logging.LogRecord) -> None:
        self._running = self._running or started(self._writer)
        with suppress(queue.Full):
            self._lines.put_nowait(self.format(record))

    def close(self) -> None:
        """Write what is left, if that can be done soon."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
        if self._running:
            self._writer.join(_LONGEST_JOIN_S)
        super().close()

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError, ValueError):
                self._stream.write(f"{line}\n")
                self._stream.flush()


@contextmanager
def log_to(stream: TextIO, form: LogFormat) -> Iterator[None]:
    """Send Seatrial's log to a stream, as text or as one JSON object a line."""
    handler = _Unhurried(stream)
    handler.setFormatter(JsonLines() if form == "json" else _Text())
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    LOG.propagate = False
    try:
        yield
    finally:
        LOG.removeHandler(handler)
        handler.close()


def notify(state: str) -> bool:
    """Tell systemd something (sd_notify): "READY=1", "WATCHDOG=1", "STATUS=..."; False where nobody listens."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(state.encode(), "\0" + address[1:] if address.startswith("@") else address)
        return True
    return False
