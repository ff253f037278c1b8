"""Where frames come from: a class a transport, one dict that says which class serves which type.

A source yields frames with their times of reception and knows nothing of what is in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, BinaryIO

from acquisition.config.sections import AnySource
from acquisition.core.errors import SourceError
from acquisition.core.frames import Frame
from acquisition.core.named_code import imported
from acquisition.sources.sockets import Senders

# Imported when first used: a trial without CAN needs no python-can.
_CLASSES = {
    "can": "acquisition.sources.can_bus:CanBus",
    "can_file": "acquisition.sources.logfile:LogFile",
    "serial": "acquisition.sources.streams:SerialPort",
    "udp": "acquisition.sources.streams:UdpPort",
    "tcp": "acquisition.sources.streams:TcpConnection",
    "file": "acquisition.sources.logfile:LogFile",
    "mavlink": "acquisition.sources.streams:UdpPort",
    "mavlink_tcp": "acquisition.sources.streams:TcpConnection",
    "mavlink_serial": "acquisition.sources.streams:SerialPort",
    "mqtt": "acquisition.sources.mqtt:MqttConnection",
    "mqtt_file": "acquisition.sources.mqtt:MqttLog",
    "own": "acquisition.sources.own:OwnCode",
    "mavlink_file": "acquisition.sources.telemetry_log:TelemetryLog",
}


def source_error(config: AnySource, what: str, why: str = "", fix: str = "") -> SourceError:
    """An error of the source that a configuration section describes."""
    return SourceError(what, where=f"source {config.name!r}", why=why, fix=fix)


class Source(ABC):
    """One transport, as the pipeline asks for it; heirs say how it is opened and read.

    ``lost`` is how much the system had no room for, as far as it tells, and ``loss`` says what that is. ``exact``
    tells whether all that was read last is stamped with when it came, by the system or a driver, not with when it
    was read. ``behind`` tells whether more was waiting than was read. ``senders`` are those of a network's port.
    """

    lost = 0
    loss = "the system had no room for {:,} frames"
    exact = False
    behind = False
    senders: Senders | None = None

    def __init__(self, config: AnySource) -> None:
        self.name = config.name
        self._config: Any = config
        self._link: Any = None

    @abstractmethod
    def _connect(self) -> Any:
        """Open the transport: what can be read and closed. Raises :class:`SourceError`."""

    @abstractmethod
    def _receive(self, timeout_s: float) -> list[Frame] | None:
        """As :meth:`read`, of an open transport."""

    def open(self) -> None:
        """Connect. Raises :class:`~acquisition.core.errors.SourceError` if that cannot be done."""
        self._link = self._connect()

    def read(self, timeout_s: float) -> list[Frame] | None:
        """What came within the time, perhaps nothing; None when nothing will ever come again.

        Raises :class:`~acquisition.core.errors.SourceError` when the transport has failed.
        """
        if self._link is None:
            raise self.failure("is not open")
        return self._receive(timeout_s)

    def close(self) -> None:
        """Let go of the transport; harmless when it is not open."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def failure(self, what: str, why: str = "", fix: str = "") -> SourceError:
        return source_error(self._config, what, why, fix)


class LogReader(Source):
    """A log file, read once, as fast as it is taken; heirs say what its bytes are."""

    def _begin(self, file: BinaryIO) -> None:
        """Look at the beginning of an open file. Raises OSError or ValueError for what is no log."""
        return

    @abstractmethod
    def _next(self, file: BinaryIO) -> list[Frame] | None:
        """The next frames, perhaps none; None at the end of the file."""

    def _connect(self) -> BinaryIO:
        path: Path = self._config.path
        try:
            self._link = file = path.open("rb")
            self._begin(file)
        except (OSError, ValueError) as error:
            self.close()
            why = (error.strerror if isinstance(error, OSError) else None) or str(error)
            raise self.failure(f"file {path} cannot be opened", why, "correct `path`") from error
        return file

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        try:
            return self._next(self._link)
        except OSError as error:
            raise self.failure("file failed", str(error.strerror)) from error


def make_source(config: AnySource) -> Source:
    """The source that a configuration section describes, not yet open."""
    source: Source = imported(_CLASSES[config.type])(config)
    return source
