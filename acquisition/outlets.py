"""Where the emulator's packets go: the far end of each kind of source."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from typing import Protocol

from acquisition.config import (
    AnySource,
    CanSource,
    FileSource,
    MavlinkSource,
    SerialSource,
    TcpSource,
    UdpSource,
)
from acquisition.encoders import Packet
from acquisition.errors import SourceError


class Outlet(Protocol):
    """One bus or line to send on."""

    def send(self, packets: list[Packet]) -> None:
        """Send the packets in order. Raises :class:`SourceError`."""

    def close(self) -> None:
        """Let go of it."""


def open_outlet(config: AnySource) -> Outlet:
    """Open the far end of a source. Raises :class:`SourceError`."""
    if isinstance(config, CanSource):
        return _CanOutlet(config)
    if isinstance(config, SerialSource):
        return _SerialOutlet(config)
    if isinstance(config, UdpSource | MavlinkSource):
        return _UdpOutlet(config)
    if isinstance(config, TcpSource):
        return _TcpOutlet(config)
    return _FileOutlet(config)


class _CanOutlet:
    def __init__(self, config: CanSource) -> None:
        import can

        from acquisition.sources.can_bus import open_bus

        self._make_message = can.Message
        self._bus = open_bus(config)

    def send(self, packets: list[Packet]) -> None:
        for packet in packets:
            self._bus.send(
                self._make_message(
                    arbitration_id=packet.identifier, data=packet.payload, is_extended_id=packet.extended
                )
            )

    def close(self) -> None:
        self._bus.shutdown()


class _SerialOutlet:
    def __init__(self, config: SerialSource) -> None:
        from acquisition.sources.serial_line import open_port

        self._port = open_port(config)
        self._port.timeout = None

    def send(self, packets: list[Packet]) -> None:
        self._port.write(b"".join(packet.payload for packet in packets))

    def close(self) -> None:
        self._port.flush()
        self._port.close()


class _UdpOutlet:
    def __init__(self, config: UdpSource | MavlinkSource) -> None:
        self._address = (config.address, config.port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, packets: list[Packet]) -> None:
        payload = b"".join(packet.payload for packet in packets)
        if payload:
            with suppress(ConnectionRefusedError):  # nobody listens yet, which is no fault of a datagram's
                self._socket.sendto(payload, self._address)

    def close(self) -> None:
        self._socket.close()


class _TcpOutlet:
    """The gateway's side: waits for the logger to connect, then serves that one connection."""

    _WAIT_S = 30.0

    def __init__(self, config: TcpSource) -> None:
        self._name = config.name
        try:
            self._server = socket.create_server((config.address, config.port))
        except OSError as error:
            where = f"source {config.name!r}"
            raise SourceError(
                f"TCP {config.address}:{config.port} cannot be served", where=where, why=str(error)
            ) from error
        self._server.settimeout(self._WAIT_S)
        self._client: socket.socket | None = None

    def send(self, packets: list[Packet]) -> None:
        try:
            if self._client is None:
                self._client, _ = self._server.accept()
            self._client.sendall(b"".join(packet.payload for packet in packets))
        except OSError as error:
            raise SourceError("no logger connected", where=f"source {self._name!r}", why=str(error)) from error

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
        self._server.close()


class _FileOutlet:
    def __init__(self, config: FileSource) -> None:
        self._file = config.path.open("wb")

    def send(self, packets: list[Packet]) -> None:
        self._file.write(b"".join(packet.payload for packet in packets))

    def close(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
