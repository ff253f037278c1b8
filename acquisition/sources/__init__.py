"""Where frames come from: a class a transport, one dict that says which class serves which type.

A source yields frames with their times of reception and knows nothing of what is in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from typing import BinaryIO, Protocol

from acquisition.config.sections import AnySource, CanFileSource, FileSource, MavlinkFileSource
from acquisition.core.errors import SourceError
from acquisition.core.frames import Frame

# Imported when first used: a trial without CAN needs no python-can.
_CLASSES = {
    "can": ("acquisition.sources.can_bus", "CanBus"),
    "can_file": ("acquisition.sources.can_file", "CanFile"),
    "serial": ("acquisition.sources.streams", "SerialPort"),
    "udp": ("acquisition.sources.streams", "UdpPort"),
    "tcp": ("acquisition.sources.streams", "TcpConnection"),
    "file": ("acquisition.sources.logfile", "LogFile"),
    "mavlink": ("acquisition.sources.streams", "UdpPort"),
    "mavlink_tcp": ("acquisition.sources.streams", "TcpConnection"),
    "mavlink_serial": ("acquisition.sources.streams", "SerialPort"),
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


class LogReader(ABC):
    """A log file, read once, as fast as it is taken; heirs say what its bytes are."""

    lost = 0

    def __init__(self, config: CanFileSource | FileSource | MavlinkFileSource) -> None:
        self.name, self._path = config.name, config.path
        self._file: BinaryIO | None = None

    def _begin(self, file: BinaryIO) -> None:
        """Look at the beginning of an open file. Raises OSError or ValueError for what is no log."""
        return

    @abstractmethod
    def _next(self, file: BinaryIO) -> list[Frame] | None:
        """The next frames, perhaps none; None at the end of the file."""

    def open(self) -> None:
        try:
            self._file = self._path.open("rb")
            self._begin(self._file)
        except (OSError, ValueError) as error:
            self.close()
            raise SourceError(
                f"file {self._path} cannot be opened",
                where=f"source {self.name!r}",
                why=(error.strerror if isinstance(error, OSError) else None) or str(error),
                fix="correct `path`",
            ) from error

    def read(self, timeout_s: float) -> list[Frame] | None:
        if self._file is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            return self._next(self._file)
        except OSError as error:
            raise SourceError("file failed", where=f"source {self.name!r}", why=str(error.strerror)) from error

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def make_source(config: AnySource) -> Source:
    """The source that a configuration section describes, not yet open."""
    module, name = _CLASSES[config.type]
    source: Source = getattr(import_module(module), name)(config)
    return source
