"""Where frames come from: one file a transport, one dict that says which file serves which type.

A source yields frames with their times of reception and knows nothing of what is in them.
"""

from __future__ import annotations

from importlib import import_module
from typing import Protocol

from acquisition.config.sections import AnySource
from acquisition.core.frames import Frame

# Imported when first used: a trial without CAN needs no python-can.
_CLASSES = {
    "can": ("acquisition.sources.can_bus", "CanBus"),
    "can_file": ("acquisition.sources.can_file", "CanFile"),
    "serial": ("acquisition.sources.serial_line", "SerialLine"),
    "udp": ("acquisition.sources.network", "UdpLines"),
    "tcp": ("acquisition.sources.network", "TcpLines"),
    "file": ("acquisition.sources.logfile", "LogFile"),
    "mavlink": ("acquisition.sources.mavlink_link", "MavlinkLink"),
    "mavlink_tcp": ("acquisition.sources.mavlink_link", "MavlinkTcp"),
    "mavlink_serial": ("acquisition.sources.mavlink_link", "MavlinkSerial"),
    "mavlink_file": ("acquisition.sources.telemetry_log", "TelemetryLog"),
}


class Source(Protocol):
    """What the pipeline asks of a transport."""

    name: str
    lost: int
    """How much the system had no room for, as far as it tells: datagrams, frames."""

    def open(self) -> None:
        """Connect. Raises :class:`~acquisition.core.errors.SourceError` if that cannot be done."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        """What came within the time, perhaps nothing; None when nothing will ever come again.

        Raises :class:`~acquisition.core.errors.SourceError` when the transport has failed.
        """

    def close(self) -> None:
        """Let go of the transport; harmless when it is not open."""


def make_source(config: AnySource) -> Source:
    """The source that a configuration section describes, not yet open."""
    module, name = _CLASSES[config.type]
    source: Source = getattr(import_module(module), name)(config)
    return source
