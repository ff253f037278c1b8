"""Where the emulator's packets go: the far end of each kind of source, and a serial line without a cable."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
import tty
from contextlib import suppress
from types import TracebackType
from typing import Protocol

from acquisition.config.sections import (
    AnySource,
    CanSource,
    FileSource,
    MavlinkSource,
    SerialSource,
    TcpSource,
    UdpSource,
)
from acquisition.core.errors import SourceError, storage_error
from acquisition.encoders import Packet

_WRITE_TIMEOUT_S = 5.0
_BLOCK_BYTES = 4096
_POLL_S = 0.1


class Transmitter(Protocol):
    """One bus or line to send on."""

    def ready(self) -> None:
        """Wait until somebody can listen. Raises :class:`SourceError` when nobody comes."""

    def send(self, packets: list[Packet]) -> None:
        """Send the packets in order. Raises :class:`SourceError`."""

    def close(self) -> None:
        """Let go of it."""


def _cannot_send(name: str, error: Exception) -> SourceError:
    return SourceError(
        "cannot be sent on", where=f"source {name!r}", why=str(error), fix="check the line and who listens on it"
    )


def open_transmitter(config: AnySource) -> Transmitter:
    """Open the far end of a source. Raises :class:`SourceError`."""
    if isinstance(config, CanSource):
        return _CanTransmitter(config)
    if isinstance(config, SerialSource):
        return _SerialTransmitter(config)
    if isinstance(config, UdpSource | MavlinkSource):
        return _UdpTransmitter(config)
    if isinstance(config, TcpSource):
        return _TcpTransmitter(config)
    if isinstance(config, FileSource):
        return _FileTransmitter(config)
    raise SourceError(
        f"nothing can be played onto a {config.type} source",
        where=f"source {config.name!r}",
        fix="play onto can, serial, udp, tcp, file or mavlink",
    )


class _AlwaysReady:
    """A bus or line that can be sent on whether anybody listens or not."""

    def ready(self) -> None:
        return


class _CanTransmitter(_AlwaysReady):
    def __init__(self, config: CanSource) -> None:
        import can

        from acquisition.sources.can_bus import open_bus

        self._name = config.name
        self._make_message = can.Message
        self._errors = (can.CanError, OSError)
        self._bus = open_bus(config)

    def send(self, packets: list[Packet]) -> None:
        try:
            for packet in packets:
                self._bus.send(
                    self._make_message(
                        arbitration_id=packet.identifier, data=packet.payload, is_extended_id=packet.extended
                    )
                )
        except self._errors as error:
            raise _cannot_send(self._name, error) from error

    def close(self) -> None:
        with suppress(*self._errors):
            self._bus.shutdown()


class _SerialTransmitter(_AlwaysReady):
    def __init__(self, config: SerialSource) -> None:
        from acquisition.sources.streams import open_port

        self._name = config.name
        self._port = open_port(config)
        self._port.write_timeout = _WRITE_TIMEOUT_S

    def send(self, packets: list[Packet]) -> None:
        try:
            self._port.write(b"".join(packet.payload for packet in packets))
        except OSError as error:  # pyserial's errors are among them
            raise _cannot_send(self._name, error) from error

    def close(self) -> None:
        self._port.close()  # the system sends what it holds before it lets the line go


class _UdpTransmitter(_AlwaysReady):
    def __init__(self, config: UdpSource | MavlinkSource) -> None:
        self._name = config.name
        self._address = (config.address, config.port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, packets: list[Packet]) -> None:
        payload = b"".join(packet.payload for packet in packets)
        try:
            if payload:
                with suppress(ConnectionRefusedError):  # nobody listens yet, which is no fault of a datagram's
                    self._socket.sendto(payload, self._address)
        except OSError as error:
            raise _cannot_send(self._name, error) from error

    def close(self) -> None:
        self._socket.close()


class _TcpTransmitter:
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

    def ready(self) -> None:
        self._connected()

    def _connected(self) -> socket.socket:
        if self._client is None:
            try:
                self._client, _ = self._server.accept()
            except OSError as error:
                where = f"source {self._name!r}"
                raise SourceError("no logger connected", where=where, why=str(error), fix="start it") from error
        return self._client

    def send(self, packets: list[Packet]) -> None:
        client = self._connected()
        try:
            client.sendall(b"".join(packet.payload for packet in packets))
        except OSError as error:
            raise _cannot_send(self._name, error) from error

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
        self._server.close()


class _FileTransmitter(_AlwaysReady):
    def __init__(self, config: FileSource) -> None:
        try:
            self._file = config.path.open("wb")
        except OSError as error:
            raise storage_error(config.path, error) from error

    def send(self, packets: list[Packet]) -> None:
        self._file.write(b"".join(packet.payload for packet in packets))

    def close(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


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
