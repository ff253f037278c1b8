"""Bytes to lines: what serial lines, TCP connections and datagrams of NMEA 0183 have in common."""

from __future__ import annotations

import re

from acquisition.core.frames import Frame, now_ns

_LONGEST_LINE_BYTES = 1024  # the standard allows 82, and a TAG block; a line without an end must not eat the memory
_LINE_END = re.compile(rb"[\r\n]")  # some devices send only one of the two


class LineAssembler:
    """Cuts a stream of bytes into lines, one frame a line, stamped when the line was complete.

    What stands before a sentence, a TAG block or a datagram's prefix, stays with it.
    """

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._pending = b""

    def push(self, received: bytes) -> list[Frame]:
        """The lines that ``received`` completes; empty lines are passed over."""
        received_ns, monotonic_ns = now_ns()
        *complete, self._pending = _LINE_END.split(self._pending + received)
        if len(self._pending) > _LONGEST_LINE_BYTES:
            complete.append(self._pending)
            self._pending = b""
        lines = (line.strip(b"\0 \t") for line in complete)
        return [Frame(self._origin, "nmea0183", line, received_ns, monotonic_ns) for line in lines if line]

    def cut(self) -> None:
        """The stream was cut and begins anew: a line that was under way stays as far as it came, by itself."""
        if self._pending:
            self._pending += b"\n"

    def end(self) -> list[Frame]:
        """The last line, where the stream ended without a line end (a datagram, a file)."""
        return self.push(b"\n") if self._pending else []
