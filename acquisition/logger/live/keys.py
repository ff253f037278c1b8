"""Event marks by key press while the live table is shown."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from acquisition.logger.marks import Mark

_POLL_S = 0.2
COUNTED_KEYS = (" ", "m")


@contextmanager
def mark_on_keys(mark: Mark, texts: Mapping[str, str]) -> Iterator[None]:
    """Hear keys on standard input, if that is a terminal: those of ``texts`` set that mark, m a number."""
    if not sys.stdin.isatty():
        yield
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    stopping = threading.Event()
    listener = threading.Thread(
        target=_listen, args=(descriptor, mark, dict(texts), stopping), name="keys", daemon=True
    )
    tty.setcbreak(descriptor)  # Ctrl-C still ends the recording
    listener.start()
    try:
        yield
    finally:
        stopping.set()
        listener.join()
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _listen(descriptor: int, mark: Mark, texts: dict[str, str], stopping: threading.Event) -> None:
    count = 0
    while not stopping.is_set():
        readable, _, _ = select.select([descriptor], [], [], _POLL_S)
        if not readable:
            continue
        try:
            typed = os.read(descriptor, 16).decode("utf-8", "ignore")
        except OSError:  # the terminal is gone; its signal ends the recording
            return
        for key in typed:
            if key in texts:
                mark(texts[key], time.monotonic_ns())
            elif key in COUNTED_KEYS:
                count += 1
                mark(f"mark {count}", time.monotonic_ns())
