"""MAVLink datagrams over UDP; what is in them is the decoder's matter."""

from __future__ import annotations

from acquisition.frames import Frame, now_ns
from acquisition.sources.network import DatagramSource


class MavlinkLink(DatagramSource):
    """One UDP port that an autopilot or a router sends to."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        datagram = self.receive(timeout_s)
        if not datagram:
            return []
        received_ns, monotonic_ns = now_ns()
        return [Frame(self.name, "mavlink", datagram, received_ns, monotonic_ns)]
