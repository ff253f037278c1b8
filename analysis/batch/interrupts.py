"""Ctrl-C and SIGTERM: the batch hears them, its worker processes do not."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker


class Terminated(KeyboardInterrupt):
    """The process was asked to end by SIGTERM, as systemd and a cluster's queue do."""


@contextmanager
def ended_by_terminate() -> Iterator[None]:
    """SIGTERM ends what is done here as Ctrl-C does, instead of the process where it stands."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough; what follows is the way out
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Threads and processes that begin here, and those that they begin, never hear Ctrl-C; it waits for us.

    A terminal interrupts the whole group of processes, and each worker would print where it was. The tracker of
    multiprocessing begins before: the thread that starts it hears Ctrl-C again afterwards.
    """
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
