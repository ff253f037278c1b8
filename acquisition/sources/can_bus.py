"""CAN frames from any interface that python-can knows."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Callable
from functools import partial
from typing import Any

import can
from can.interfaces.udp_multicast.utils import unpack_message

from seatrial.acquisition.config.sections import CanSource
from seatrial.acquisition.core.errors import system_reason
from seatrial.acquisition.core.frames import HIGHEST_IDENTIFIER, Frame, FrameFlag, can_flags
from seatrial.acquisition.sources import Source, source_error
from seatrial.acquisition.sources.sockets import Drops, enlarge, received_at

_MOST_FRAMES_AT_ONCE = 200
_UNREADABLE = "frame that cannot be read"
_MOST_UNREADABLE = 1_000  # in a row: then it is the driver that is broken, not what comes
_LONGEST_FRAME_BYTES = 64
_BUFFER_BYTES = 16 * 1024 * 1024  # ten seconds of a full bus, of whose frames each takes some 800 bytes of it


def open_bus(config: CanSource) -> can.BusABC:
    """Open the bus of a configuration section. Raises :class:`SourceError`."""
    logging.getLogger("can").setLevel(logging.ERROR)  # the errors raised say what is missing
    try:
        return can.Bus(
            interface=config.interface,
            channel=config.channel,
            receive_own_messages=False,
            **config.options,
        )
    except Exception as error:  # drivers raise what they like
        what = f"CAN bus {config.interface}:{config.channel} cannot be opened"
        fix = "connect the interface, or correct `interface`, `channel` and `options`"
        raise source_error(config, what, _reason(config.interface, error), fix) from error


def _reason(interface: str, error: Exception) -> str:
    """Why a bus cannot be opened, in words that do not depend on its driver."""
    if interface not in can.VALID_INTERFACES:
        return f"python-can knows no interface {interface!r}, only {', '.join(sorted(can.VALID_INTERFACES))}"
    if why := system_reason(error):
        return why
    if isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError | AttributeError):
        return "its driver is not installed on this computer"
    if isinstance(error, ValueError | TypeError):
        return "the interface does not take this channel with these options"
    return "its driver is not installed, or finds no such interface"


def flags_of(message: can.Message) -> FrameFlag:
    """What kind of frame python-can's message was."""
    return can_flags(not message.is_extended_id, message.is_remote_frame, message.is_error_frame)


class CanBus(Source):
    """One bus; frames have the system's stamp where they come by a socket, else that of when they are read.

    ``lost`` counts the frames that the system had no room for, ``refused`` what came and was no frame: noise on the
    serial line of an adapter, a stranger's datagram. A bus that fails does so once what came before is passed on.
    """

    def __init__(self, config: CanSource) -> None:
        super().__init__(config)
        self._unreadable = 0
        self._failed: Exception | None = None

    def _connect(self) -> can.BusABC:
        bus = open_bus(self._config)
        if self._config.interface == "udp_multicast":
            bus._multicast.recv = partial(self._readable, bus._multicast.recv)
        self._unreadable, self._failed = 0, None
        self._socket = _socket_of(bus)
        if self._socket is not None:
            enlarge(self._socket, _BUFFER_BYTES)
            self._drops = Drops(self._socket)
        return bus

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        self.exact = self._socket is not None
        if self._failed is not None:
            raise self.failure("CAN bus failed", _fault(self._failed)) from self._failed
        try:
            while len(frames) < _MOST_FRAMES_AT_ONCE and (message := self._link.recv(0.0 if frames else timeout_s)):
                if _is_frame(message):
                    frames.append(self._frame(message))
                else:
                    self.refused[_UNREADABLE] += 1
        except Exception as error:
            if isinstance(error, can.CanError | OSError) and not isinstance(error.__cause__, ValueError):
                if not frames:
                    raise self.failure("CAN bus failed", _fault(error)) from error
                self._failed = error
            else:  # python-can's drivers raise what they like where a line is no frame
                self._count_unreadable(error)
        else:
            self._unreadable = 0
        self.behind = len(frames) == _MOST_FRAMES_AT_ONCE
        if self._socket is not None:
            self.lost += self._drops.since()
        return frames

    def _count_unreadable(self, error: Exception) -> None:
        self.refused[_UNREADABLE] += 1
        self._unreadable += 1
        if isinstance(pending := getattr(self._link, "_buffer", None), bytearray):
            pending.clear()  # slcan keeps what is no text, and would fail on it for ever
        if self._unreadable > _MOST_UNREADABLE:
            raise self.failure("CAN bus failed", "nothing that comes is a frame") from error

    def _readable(self, receive: Callable[[float | None], Any], timeout_s: float | None = None) -> Any:
        """What python-can received by multicast; nothing where it would take a datagram for a fault of the bus."""
        received = receive(timeout_s)
        if received is None:
            return None
        try:
            unpack_message(received[0], check=True)
        except Exception:  # as the library says
            self.refused[_UNREADABLE] += 1
            return None
        return received

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


def _fault(error: Exception) -> str:
    return system_reason(error) or "its driver reports a fault"


def _is_frame(message: can.Message) -> bool:
    """Whether a message can have been on a bus: some drivers do not look at what they are told."""
    identifier, highest = message.arbitration_id, HIGHEST_IDENTIFIER if message.is_extended_id else 0x7FF
    return isinstance(identifier, int) and 0 <= identifier <= highest and len(message.data) <= _LONGEST_FRAME_BYTES


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
