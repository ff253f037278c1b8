"""MAVLink datagrams over UDP; what is in them is the decoder's matter."""

from __future__ import annotations

import socket

from acquisition.config import MavlinkSource
from acquisition.frames import Frame, now_ns
from acquisition.sources.network import bind_udp, receive_datagram


class MavlinkLink:
    """One UDP port that an autopilot or a router sends to."""

    waits = False

    def __init__(self, config: MavlinkSource) -> None:
        self.name = config.name
        self._config = config
        self._socket: socket.socket | None = None

    def open(self) -> None:
        self._socket = bind_udp(self._config)

    def read(self, timeout_s: float) -> list[Frame] | None:
        datagram = receive_datagram(self._socket, self.name, timeout_s)
        if not datagram:
            return []
        received_ns, monotonic_ns = now_ns()
        return [Frame(self.name, "mavlink", datagram, received_ns, monotonic_ns)]

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
