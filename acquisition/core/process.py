"""The process itself: the signals that end a recording, and standard streams that take nothing down with them.

Nothing heavy is imported here, so that it is ready first.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from acquisition.core.errors import StorageError

_STDOUT = 1
_NAMES = ("stdin", "stdout", "stderr")
_active: list[threading.Event] = []


def guard_standard_streams() -> None:
    """Replace missing streams by the null device, and outputs by ones that can be closed at the other end.

    Whoever reads only our first line has not made the work a failure, and what cannot be told on stderr must
    not end a recording. A stdout that is full is told, once: what was asked for has not arrived.
    """
    for name in _NAMES:
        stream = getattr(sys, name)
        if stream is None:  # the lowest free descriptor is the missing one: no recording will be opened as it
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115 - to the end
        elif name != "stdin" and stream is getattr(sys, f"__{name}__"):  # and not a test's
            setattr(sys, name, _guarded(stream))


def _guarded(stream: TextIO) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Output(stream.fileno())),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


class _Output(io.FileIO):
    """A descriptor to write to; after its first failure all that is written to it is forgotten."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._failed = False

    def write(self, data: Any, /) -> int:
        if self._failed:
            return len(data)
        try:
            return super().write(data) or 0
        except OSError as error:
            self._failed = True
            if self.fileno() == _STDOUT and not isinstance(error, BrokenPipeError):
                raise StorageError(
                    "cannot be written", where="standard output", why=error.strerror or "", fix="send it elsewhere"
                ) from error
            return len(data)


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that SIGINT, SIGTERM and the loss of the terminal set, so that all end a recording cleanly.

    Under ``nohup``, which ignores the loss of the terminal, the recording goes on. Within another of its kind
    the event is the same: a signal that came while the program was still being loaded is not forgotten.
    """
    if _active:
        yield _active[0]
        return
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    ends = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        ends.append(signal.SIGHUP)
    previous = {number: signal.signal(number, handle) for number in ends}
    _active.append(stop)
    try:
        yield stop
    finally:
        _active.clear()
        for number, handler in previous.items():
            signal.signal(number, handler)
