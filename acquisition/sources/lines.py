"""Bytes to lines: what serial lines, TCP connections and datagrams of NMEA 0183 have in common."""

from __future__ import annotations

from acquisition.frames import Frame, now_ns

_LONGEST_LINE_BYTES = 1024  # the standard allows 82; a line without an end must not eat the memory


class LineAssembler:
    """Cuts a stream of bytes into lines, one frame a line, stamped when the line was complete."""

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._pending = b""

    def push(self, received: bytes) -> list[Frame]:
        """The lines that ``received`` completes; empty lines are passed over."""
        received_ns, monotonic_ns = now_ns()
        *complete, self._pending = (self._pending + received).split(b"\n")
        if len(self._pending) > _LONGEST_LINE_BYTES:
            complete.append(self._pending)
            self._pending = b""
        lines = (line.strip(b"\r\n\0 ") for line in complete)
        return [Frame(self._origin, "nmea0183", line, received_ns, monotonic_ns) for line in lines if line]

    def end(self) -> list[Frame]:
        """The last line, where the stream ended without a line end (a datagram, a file)."""
        return self.push(b"\n") if self._pending else []
