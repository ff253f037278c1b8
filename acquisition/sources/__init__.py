"""Where frames come from: a class a transport, one dict that says which class serves which type.

A source yields frames with their times of reception and knows nothing of what is in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from pathlib import Path
from typing import Any, BinaryIO

from seatrial.acquisition.config.sections import AnySource
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.frames import Frame
from seatrial.acquisition.core.named_code import imported
from seatrial.acquisition.sources.sockets import Senders

# Imported when first used: a trial without CAN needs no python-can.
_CLASSES = {
    "can": "seatrial.acquisition.sources.can_bus:CanBus",
    "can_file": "seatrial.acquisition.sources.logfile:LogFile",
    "serial": "seatrial.acquisition.sources.streams:SerialPort",
    "udp": "seatrial.acquisition.sources.streams:UdpPort",
    "tcp": "seatrial.acquisition.sources.streams:TcpConnection",
    "file": "seatrial.acquisition.sources.logfile:LogFile",
    "mavlink": "seatrial.acquisition.sources.streams:UdpPort",
    "mavlink_tcp": "seatrial.acquisition.sources.streams:TcpConnection",
    "mavlink_serial": "seatrial.acquisition.sources.streams:SerialPort",
    "mqtt": "seatrial.acquisition.sources.mqtt:MqttConnection",
    "mqtt_file": "seatrial.acquisition.sources.mqtt:MqttLog",
    "own": "seatrial.acquisition.sources.own:OwnCode",
    "mavlink_file": "seatrial.acquisition.sources.telemetry_log:TelemetryLog",
}

SQLITE = b"SQLite format 3\0"
_MAGIC = {
    b"\x89MCAP": "a recording (`seatrial redecode` decodes one anew)",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"PK\x03\x04": "a ZIP archive: unpack it",
    b"%PDF": "a PDF document",
    b"PAR1": "a Parquet table: `seatrial import` reads it",
    b"MATLAB": "a .mat table: `seatrial import` reads it",
    SQLITE: 'an SQLite database: `type = "mqtt_file"` reads a log of MQTT messages',
    b"\xff\xfe": "text in UTF-16: save it as UTF-8",
    b"\xfe\xff": "text in UTF-16: save it as UTF-8",
    b"BZh": "packed by bzip2: unpack it",
    b"\xfd7zXZ": "packed by xz: unpack it",
    b"\x28\xb5\x2f\xfd": "packed by zstd: unpack it",
    b"MDF ": "an MDF measurement",
}
"""What a file looks like, by its first bytes."""
_MOST_LETTERS = 60


def source_error(config: AnySource, what: str, why: str = "", fix: str = "") -> SourceError:
    """An error of the source that a configuration section describes."""
    return SourceError(what, where=f"source {config.name!r}", why=why, fix=fix)


class Source(ABC):
    """One transport, as the pipeline asks for it; heirs say how it is opened and read.

    ``lost`` is how much the system had no room for, as far as it tells, and ``loss`` says what that is. ``exact``
    tells whether all that was read last is stamped with when it came, by the system or a driver, not with when it
    was read. ``behind`` tells whether more was waiting than was read. ``senders`` are those of a network's port.
    ``refused`` counts by reason what came and made no frame.
    """

    lost = 0
    loss = "the system had no room for {:,} frames"
    exact = False
    behind = False
    senders: Senders | None = None

    def __init__(self, config: AnySource) -> None:
        self.name = config.name
        self.refused: Counter[str] = Counter()
        self._config: Any = config
        self._link: Any = None

    @abstractmethod
    def _connect(self) -> Any:
        """Open the transport: what can be read and closed. Raises :class:`SourceError`."""

    @abstractmethod
    def _receive(self, timeout_s: float) -> list[Frame] | None:
        """As :meth:`read`, of an open transport."""

    def open(self) -> None:
        """Connect. Raises :class:`~seatrial.acquisition.core.errors.SourceError` if that cannot be done."""
        self._link = self._connect()

    def read(self, timeout_s: float) -> list[Frame] | None:
        """What came within the time, perhaps nothing; None when nothing will ever come again.

        Raises :class:`~seatrial.acquisition.core.errors.SourceError` when the transport has failed.
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


def looks_like(head: bytes) -> str:
    """A few words on a file by its first bytes.

    >>> looks_like(b"time,heading_deg\\n0.0,12.3\\n")
    'a table with the columns time, heading_deg: `seatrial import` reads tables'
    """
    for magic, name in _MAGIC.items():
        if head.startswith(magic):
            return name
    if head[:1] == b"\0" and head[8:9] in (b"\xfd", b"\xfe"):
        return 'a telemetry log of MAVLink: `type = "mavlink_file"` reads it'
    printable = sum(32 <= byte < 127 or byte in b"\t\r\n" or byte > 127 for byte in head)
    if printable < 0.9 * len(head):
        return f"binary, and begins with {head[:8].hex(' ')}"
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines() if line.strip()]
    first = next((line for line in lines if not line.startswith("#")), "")
    if first.startswith(("{", "[")):
        return "JSON, already decoded by another program: what came off the bus is needed"
    if "$" in first or "!" in first:
        fix = "" if "*" in first else ', which checksum = "optional" reads'
        return f"sentences without a sound checksum ({_shortened(first)}){fix}"
    names = [name.strip(' "') for name in first.replace(";", ",").replace("\t", ",").split(",")]
    if len(names) > 1 and all(name and not name[0].isdigit() for name in names):
        return f"a table with the columns {_shortened(', '.join(names))}: `seatrial import` reads tables"
    return f"text ({_shortened(first)})" if first else "text without a word in it"


def _shortened(text: str) -> str:
    shown = "".join(character if character.isprintable() else "?" for character in text)
    return shown if len(shown) <= _MOST_LETTERS else f"{shown[:_MOST_LETTERS]}..."


def make_source(config: AnySource) -> Source:
    """The source that a configuration section describes, not yet open."""
    source: Source = imported(_CLASSES[config.type])(config)
    return source
