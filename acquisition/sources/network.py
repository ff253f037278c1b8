"""Bytes over IP, and NMEA 0183 lines in them: UDP datagrams that are sent to us, TCP connections that we make."""

from __future__ import annotations

import ipaddress
import socket
import struct
import sys
from contextlib import suppress

from acquisition.config.sections import MavlinkSource, MavlinkTcpSource, TcpSource, UdpSource
from acquisition.core.errors import SourceError
from acquisition.core.frames import Frame
from acquisition.sources.lines import LineAssembler

_DATAGRAM_BYTES = 65_535
_MOST_DATAGRAMS = 100
_SO_RXQ_OVFL = 40  # Linux tells with each datagram how many it has dropped so far; Python has no name for it
_BUFFER_BYTES = 4 * 1024 * 1024
_CONNECT_TIMEOUT_S = 3.0


def bind_udp(config: UdpSource | MavlinkSource) -> socket.socket:
    """A UDP socket bound to the section's address, with as large a buffer as the system allows.

    A multicast group, such as those of IEC 61162-450, is joined, and other programs may listen to it too.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        with suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        shared = is_multicast(config.address)
        if shared:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((config.address, config.port))  # to a group's own address: nothing else comes
        if shared:
            _join(opened, config.address)
    except OSError as error:
        opened.close()
        unresolved = isinstance(error, socket.gaierror)
        raise SourceError(
            f"UDP {config.address}:{config.port} cannot be listened on",
            where=f"source {config.name!r}",
            why=str(error.strerror),
            fix="correct `address`"
            if unresolved
            else "end the program that uses it, or correct `address` and `port`",
        ) from error
    return opened


def is_multicast(address: str) -> bool:
    """Whether it is the address of an IPv4 group.

    >>> is_multicast("239.192.0.1"), is_multicast("127.0.0.1"), is_multicast("localhost")
    (True, False, False)
    """
    try:
        return ipaddress.IPv4Address(address).is_multicast
    except ValueError:
        return False


def _join(opened: socket.socket, address: str) -> None:
    """Join a group on every interface, as the one with the instruments need not be the one that is routed to.

    Raises :class:`OSError` if not one of them can join.
    """
    failure: OSError | None = None
    joined = 0
    for index, _ in socket.if_nameindex():
        membership = struct.pack("4s4si", socket.inet_aton(address), socket.inet_aton("0.0.0.0"), index)
        try:
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            joined += 1
        except OSError as error:  # one that knows no multicast, or is down
            failure = error
    if failure is not None and not joined:
        raise failure


class DatagramSource:
    """A UDP port that others send to; what a datagram holds is for the heirs to say.

    ``lost`` counts the datagrams that the system had no room for.
    """

    def __init__(self, config: UdpSource | MavlinkSource) -> None:
        self.name = config.name
        self.lost = 0
        self._config = config
        self._socket: socket.socket | None = None
        self._dropped = 0  # by this socket, as the system counts

    def open(self) -> None:
        self._socket, self._dropped = bind_udp(self._config), 0

    def receive(self, timeout_s: float) -> list[bytes]:
        """The datagrams that are there, waiting for the first; none after the timeout.

        Raises :class:`SourceError`.
        """
        if self._socket is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        datagrams: list[bytes] = []
        try:
            self._socket.settimeout(timeout_s)
            while len(datagrams) < _MOST_DATAGRAMS:
                data, more, *_ = self._socket.recvmsg(_DATAGRAM_BYTES, 64)
                datagrams.append(data)
                self._count(more)
                self._socket.settimeout(0.0)
        except (TimeoutError, BlockingIOError):
            pass
        except OSError as error:
            raise SourceError("network failed", where=f"source {self.name!r}", why=str(error.strerror)) from error
        return datagrams

    def _count(self, more: list[tuple[int, int, bytes]]) -> None:
        for level, kind, data in more:
            if (level, kind) == (socket.SOL_SOCKET, _SO_RXQ_OVFL):
                dropped = int.from_bytes(data[:4], sys.byteorder)
                self.lost += (dropped - self._dropped) % 2**32
                self._dropped = dropped

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class UdpLines(DatagramSource):
    """Datagrams of one or more sentences each."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        for datagram in self.receive(timeout_s):
            lines = LineAssembler(self.name)  # a datagram never continues the one before it
            frames += lines.push(datagram) + lines.end()
        return frames


class TcpStream:
    """One connection to a server; what its bytes are is for the heirs to say."""

    lost = 0

    def __init__(self, config: TcpSource | MavlinkTcpSource) -> None:
        self.name = config.name
        self._config = config
        self._socket: socket.socket | None = None

    def open(self) -> None:
        address = (self._config.address, self._config.port)
        try:
            self._socket = socket.create_connection(address, timeout=_CONNECT_TIMEOUT_S)
        except OSError as error:
            unresolved = isinstance(error, socket.gaierror)
            raise SourceError(
                f"TCP {address[0]}:{address[1]} does not answer",
                where=f"source {self.name!r}",
                why=str(error.strerror) if unresolved else str(error),
                fix="correct `address`" if unresolved else "start the gateway, or correct `address` and `port`",
            ) from error

    def receive(self, timeout_s: float) -> bytes:
        """What has come, or nothing after the timeout. Raises :class:`SourceError`."""
        if self._socket is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            self._socket.settimeout(timeout_s)
            received = self._socket.recv(_DATAGRAM_BYTES)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise SourceError("connection failed", where=f"source {self.name!r}", why=str(error)) from error
        if not received:
            raise SourceError("the other end closed the connection", where=f"source {self.name!r}")
        return received

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class TcpLines(TcpStream):
    """One connection to a multiplexer or gateway."""

    def __init__(self, config: TcpSource) -> None:
        super().__init__(config)
        self._lines = LineAssembler(config.name)

    def open(self) -> None:
        super().open()
        self._lines.cut()

    def read(self, timeout_s: float) -> list[Frame] | None:
        received = self.receive(timeout_s)
        return self._lines.push(received) if received else []
