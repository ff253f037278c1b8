"""Two serial ports joined by a cable that is not there: what the demo and the tests use for a serial line."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from types import TracebackType

_BLOCK_BYTES = 4096
_POLL_S = 0.1


class NullModem:
    """A context manager; what is written to ``emulator_device`` can be read from ``logger_device``."""

    def __enter__(self) -> NullModem:
        self._near, self._near_port = pty.openpty()
        self._far, self._far_port = pty.openpty()
        for port in (self._near_port, self._far_port):
            tty.setraw(port)
        self.emulator_device, self.logger_device = os.ttyname(self._near_port), os.ttyname(self._far_port)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="null modem", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        for descriptor in (self._near, self._near_port, self._far, self._far_port):
            os.close(descriptor)

    def _carry(self) -> None:
        while not self._stop.is_set():
            readable, _, _ = select.select([self._near], [], [], _POLL_S)
            if readable:
                pending = os.read(self._near, _BLOCK_BYTES)
                while pending and not self._stop.is_set():
                    _, writable, _ = select.select([], [self._far], [], _POLL_S)
                    if writable:
                        pending = pending[os.write(self._far, pending) :]
