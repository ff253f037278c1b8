"""The process: signals that end a recording, and standard streams whose failure must not end one.

Nothing heavy is imported here, so that it is in place first.
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

from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.text import printable

_STDOUT = 1
_NAMES = ("stdin", "stdout", "stderr")
_active: list[threading.Event] = []


def guard_standard_streams() -> None:
    """Replace missing standard streams by the null device, and outputs by ones that tolerate a closed reader.

    A reader that only takes our first line (``head``) does not make the work a failure, and a message that
    cannot be printed must not end a recording. A failure to write to stdout, such as a full disk, is reported
    once, since requested output is lost.
    """
    for name in _NAMES:
        stream = getattr(sys, name)
        if stream is None:  # takes the lowest free descriptor, the missing one, so that no recording gets it
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115 - to the end
        elif name != "stdin" and stream is getattr(sys, f"__{name}__"):  # and not a test's
            setattr(sys, name, _guarded(stream))


def echo(line: object, *, err: bool = False) -> None:
    """Print a line of a command, in which control characters and the bytes of odd file names are escaped."""
    print(printable(str(line)), file=sys.stderr if err else sys.stdout, flush=True)


def _guarded(stream: TextIO) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Output(stream.fileno())),
        encoding=stream.encoding,
        errors="backslashreplace",  # a symbol that the terminal's encoding lacks is no reason to fail
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


class _Output(io.FileIO):
    """An output descriptor that discards everything after its first failure."""

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


def started(thread: threading.Thread) -> bool:
    """Start a thread; False where the system gives none now, which may be tried again."""
    try:
        thread.start()
    except RuntimeError:
        return False
    return True


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event set by SIGINT, SIGTERM and hangup, so that all of them end a recording cleanly.

    Under ``nohup``, which ignores hangups, the recording goes on. Nested uses share one event, so a signal that
    arrives while the program is loading is not lost.
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


class Termination(KeyboardInterrupt):
    """The process was asked to end by SIGTERM, as systemd and a cluster's queue do."""


@contextmanager
def interrupt_on_terminate() -> Iterator[None]:
    """SIGTERM ends what is done here as Ctrl-C does, instead of the process where it stands."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough; what follows is the way out
        raise Termination

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
