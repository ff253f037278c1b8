"""The end of a recording by a signal. Nothing heavy is imported here, so that it is ready first."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_active: list[threading.Event] = []


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
