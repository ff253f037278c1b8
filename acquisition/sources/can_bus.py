"""CAN frames from any interface that python-can knows."""

from __future__ import annotations

import can

from acquisition.config.sections import CanSource
from acquisition.core.errors import SourceError
from acquisition.core.frames import Frame, FrameFlag, now_ns
from acquisition.sources import Source

_MOST_FRAMES_AT_ONCE = 200


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
        raise SourceError(
            f"CAN bus {config.interface}:{config.channel} cannot be opened",
            where=f"source {config.name!r}",
            why=str(error),
            fix="connect the interface, or correct `interface`, `channel` and `options`",
        ) from error


def flags_of(message: can.Message) -> FrameFlag:
    """What kind of frame python-can's message was."""
    flags = FrameFlag.NONE if message.is_extended_id else FrameFlag.STANDARD_ID
    if message.is_remote_frame:
        flags |= FrameFlag.REMOTE
    if message.is_error_frame:
        flags |= FrameFlag.ERROR
    return flags


class CanBus(Source):
    """One bus; frames are stamped when python-can hands them over."""

    def _connect(self) -> can.BusABC:
        return open_bus(self._config)

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        try:
            message = self._link.recv(timeout_s)
            while message is not None:
                frames.append(self._frame(message))
                message = self._link.recv(0.0) if len(frames) < _MOST_FRAMES_AT_ONCE else None
        except (can.CanError, OSError) as error:
            raise self.failure("CAN bus failed", str(error)) from error
        return frames

    def close(self) -> None:
        if self._link is not None:
            self._link.shutdown()
            self._link = None

    def _frame(self, message: can.Message) -> Frame:
        return Frame(self.name, "can", bytes(message.data), *now_ns(), message.arbitration_id, flags_of(message))
