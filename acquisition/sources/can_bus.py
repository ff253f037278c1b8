"""CAN frames from any interface that python-can knows."""

from __future__ import annotations

import os
import socket

import can

from acquisition.config.sections import CanSource
from acquisition.core.frames import Frame, FrameFlag, can_flags
from acquisition.sources import Source, source_error
from acquisition.sources.sockets import Drops, enlarge, received_at

_MOST_FRAMES_AT_ONCE = 200
_BUFFER_BYTES = 16 * 1024 * 1024  # ten seconds of a full bus, of whose frames each takes some 800 bytes of it


def open_bus(config: CanSource) -> can.BusABC:
    """Open the bus of a configuration section. Raises :class:`SourceError`."""
    try:
        return can.Bus(
            interface=config.interface,
            channel=config.channel,
            receive_own_messages=False,
            **config.options,
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError, AttributeError) as error:
        what = f"CAN bus {config.interface}:{config.channel} cannot be opened"
        fix = "connect the interface, or correct `interface`, `channel` and `options`"
        raise source_error(config, what, str(error), fix) from error


def flags_of(message: can.Message) -> FrameFlag:
    """What kind of frame python-can's message was."""
    return can_flags(not message.is_extended_id, message.is_remote_frame, message.is_error_frame)


class CanBus(Source):
    """One bus; frames have the system's stamp where they come by a socket, else that of when they are read.

    ``lost`` counts the frames that the system had no room for.
    """

    def _connect(self) -> can.BusABC:
        bus = open_bus(self._config)
        self._socket = _socket_of(bus)
        if self._socket is not None:
            enlarge(self._socket, _BUFFER_BYTES)
            self._drops = Drops(self._socket)
        return bus

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        self.exact = self._socket is not None
        try:
            message = self._link.recv(timeout_s)
            while message is not None:
                frames.append(self._frame(message))
                message = self._link.recv(0.0) if len(frames) < _MOST_FRAMES_AT_ONCE else None
        except (can.CanError, OSError) as error:
            raise self.failure("CAN bus failed", str(error)) from error
        self.behind = len(frames) == _MOST_FRAMES_AT_ONCE
        if self._socket is not None:
            self.lost += self._drops.since()
        return frames

    def close(self) -> None:
        if self._link is not None:
            self._link.shutdown()
            self._link = None
            if self._socket is not None:
                self._socket.close()

    def _frame(self, message: can.Message) -> Frame:
        stamp_ns = round(message.timestamp * 1e6) * 1000 if self._socket is not None else None
        times, stamped = received_at(stamp_ns)
        self.exact = self.exact and stamped
        return Frame(self.name, "can", bytes(message.data), *times, message.arbitration_id, flags_of(message))


def _socket_of(bus: can.BusABC) -> socket.socket | None:
    """The socket behind a bus, by a handle of its own; None for one behind which there is something else."""
    try:
        handle = os.dup(bus.fileno())
    except (NotImplementedError, OSError, ValueError, TypeError):
        return None
    try:
        return socket.socket(fileno=handle)
    except OSError:
        os.close(handle)
        return None
