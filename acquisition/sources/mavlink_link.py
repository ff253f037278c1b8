"""MAVLink bytes as they come, from UDP, TCP and serial lines; what is in them is the decoder's matter."""

from __future__ import annotations

from acquisition.core.frames import Frame, now_ns
from acquisition.sources.network import DatagramSource, TcpStream
from acquisition.sources.serial_line import SerialPort


class MavlinkLink(DatagramSource):
    """One UDP port that an autopilot or a router sends to."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        return [frame for datagram in self.receive(timeout_s) for frame in _frames(self.name, datagram)]


class MavlinkTcp(TcpStream):
    """One connection to a router, or to a simulated autopilot."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        return _frames(self.name, self.receive(timeout_s))


class MavlinkSerial(SerialPort):
    """A telemetry radio or the autopilot's own port."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        return _frames(self.name, self.receive(timeout_s))


def _frames(name: str, received: bytes) -> list[Frame]:
    return [Frame(name, "mavlink", received, *now_ns())] if received else []
