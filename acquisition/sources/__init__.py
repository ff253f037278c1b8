"""Opens what frames come from: a class a transport, one dict of the class for each type of source.

A source yields frames with their times of reception and knows nothing of their content. Also here: what Linux
reports of a socket (time stamps, drops), who may send to it, packed logs read within a budget, and :data:`INPUTS`,
from which the documentation's page of inputs is made.

A source of a user's own is a class that reads any device and names channels:

    class Inclinometer:
        def __init__(self, device): ...        # the source's `options`; may be left out
        def read(self, timeout_s): ...         # {"roll_deg": 1.5, "pitch_deg": -0.2}, in the channels' units
        def close(self): ...                   # may be left out

``read`` waits no longer than that and returns what came: a dict of channels, in which ``time`` may say when it was
measured (UTC, s since 1970); a line of NMEA 0183; a list of those, empty where nothing came; None when nothing will
ever come again. The class is made when the source is opened: what it raises there, and in ``read``, counts as a
failed source, is recorded as an event and tried again, while other sources go on.
"""

from __future__ import annotations

import gzip
import io
import ipaddress
import os
import socket
import struct
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from seatrial.acquisition.config.sources import AnySource, OwnSource
from seatrial.acquisition.core import errors, named_code, process, trial

# Imported when first used: a trial without CAN needs no python-can.
_CLASSES = {
    "can": "seatrial.acquisition.sources.lines:CanBus",
    "can_file": "seatrial.acquisition.sources.log_file:LogFile",
    "serial": "seatrial.acquisition.sources.lines:SerialPort",
    "udp": "seatrial.acquisition.sources.lines:UdpPort",
    "tcp": "seatrial.acquisition.sources.lines:TcpConnection",
    "file": "seatrial.acquisition.sources.log_file:LogFile",
    "mavlink": "seatrial.acquisition.sources.lines:UdpPort",
    "mavlink_tcp": "seatrial.acquisition.sources.lines:TcpConnection",
    "mavlink_serial": "seatrial.acquisition.sources.lines:SerialPort",
    "mqtt": "seatrial.acquisition.sources.lines:MqttConnection",
    "mqtt_file": "seatrial.acquisition.sources.lines:MqttLog",
    "topic_file": "seatrial.acquisition.tables.topics:TopicFile",
    "own": "seatrial.acquisition.sources:OwnCode",
    "mavlink_file": "seatrial.acquisition.sources.log_file:TelemetryLog",
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
}
"""What a file looks like, by its first bytes."""
_IMPORTED = {
    b"#ROSBAG V": "a bag of ROS 1",
    b"ULog\x01\x12\x35": "a log of PX4 (ULog)",
    b"\xa3\x95\x80\x80": "a log of ArduPilot (DataFlash)",
    b"FMT, 128,": "a log of ArduPilot (DataFlash, as text)",
    b"MDF ": "an MDF measurement",
    b"UnFinMF ": "an MDF measurement",
    b"TDSm": "a measurement of LabVIEW (TDMS)",
    b"\x89HDF": "an HDF5 file",
}
"""Logs of several topics by their first bytes: what is in them is measured values, no frames of a bus or line."""
_OWN_BYTES = 200  # in which an MCAP file names its writer
_MOST_LETTERS = 60
_LINES_TOPIC = "own/lines"
_BLOCK_BYTES = 8192  # as readers ask for: of a packed log that is cut off no more is lost than its last block

_SO_RCVBUFFORCE, _SO_TIMESTAMPNS, _SO_MEMINFO = 33, 35, 55  # Python has no names for them
_DROPPED = 8  # the place of the count among the numbers of SO_MEMINFO
_MEMINFO_BYTES = 36
_OLDEST_NS = 60 * trial.NANO  # a frame that waited longer has been stamped by another clock, or ours has been set
_MOST_SENDERS = 100  # senders' addresses can be forged: there is no end to them

Network = ipaddress.IPv4Network | ipaddress.IPv6Network
_TIME = struct.Struct("@ll")
TIME_BYTES = socket.CMSG_SPACE(_TIME.size)
"""Room for a stamp in ``recvmsg``."""


def source_error(config: AnySource, what: str, why: str = "", fix: str = "") -> errors.SourceError:
    """An error of the source that a configuration section describes."""
    return errors.SourceError(what, where=f"source {config.name!r}", why=why, fix=fix)


class Source(ABC):
    """One transport, as the pipeline asks for it; subclasses define how it is opened and read.

    ``lost`` is how much the system had no room for, as far as it reports it, and ``loss`` says what that is.
    ``exact`` says whether all that was read last is stamped with when it came, by the system or a driver, not with
    when it was read. ``behind`` says whether more was waiting than was read. ``senders`` are those of a network's
    port. ``refused`` counts by reason what came and made no frame.
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
    def _receive(self, timeout_s: float) -> list[trial.Frame] | None:
        """As :meth:`read`, of an open transport."""

    def open(self) -> None:
        """Connect. Raises :class:`~seatrial.acquisition.core.errors.SourceError` if that cannot be done."""
        self._link = self._connect()

    def read(self, timeout_s: float) -> list[trial.Frame] | None:
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

    def failure(self, what: str, why: str = "", fix: str = "") -> errors.SourceError:
        return source_error(self._config, what, why, fix)


class LogReader(Source):
    """A log file, read once, as fast as it is taken; subclasses define what its bytes are."""

    def _read_beginning(self, file: BinaryIO) -> None:
        """Look at the beginning of an open file. Raises OSError or ValueError for what is no log."""
        return

    @abstractmethod
    def _next_frames(self, file: BinaryIO) -> list[trial.Frame] | None:
        """The next frames, perhaps none; None at the end of the file."""

    def _connect(self) -> BinaryIO:
        path: Path = self._config.path
        if path.is_dir():
            raise self._import_error("a folder, such as a bag of ROS 2")
        try:
            self._link = file = path.open("rb")
            self._read_beginning(file)
        except errors.SourceError:
            self.close()
            raise
        except (OSError, ValueError) as error:
            self.close()
            reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
            raise self.failure(f"file {path} cannot be opened", reason, "correct `path`") from error
        return file

    def _import_error(self, name: str) -> errors.SourceError:
        """A file that no source reads, but the import."""
        path: Path = self._config.path
        why = "it holds no frames of a bus or line"
        fix = (
            f'`seatrial import {path} -o {path.stem}.mcap` reads it; here, type = "topic_file" with [source.values]'
        )
        return self.failure(f"{path} is {name}", why, fix)

    def _receive(self, timeout_s: float) -> list[trial.Frame] | None:
        try:
            return self._next_frames(self._link)
        except OSError as error:
            raise self.failure("file failed", str(error.strerror)) from error


def name_of_imported_log(head: bytes) -> str:
    """What a log of several topics is, by its first bytes; empty for any other file.

    >>> name_of_imported_log(b"TDSm..."), name_of_imported_log(b"$HEHDT,12.5,T*2A")
    ('a measurement of LabVIEW (TDMS)', '')
    """
    if head.startswith(b"\x89MCAP") and trial.SOFTWARE.encode() not in head[:_OWN_BYTES]:
        return "an MCAP file of another program, such as a bag of ROS 2"
    if head.startswith(SQLITE) and b"serialization_format" in head:
        return "a bag of ROS 2"
    return next((name for magic, name in _IMPORTED.items() if head.startswith(magic)), "")


def describe_file_start(head: bytes) -> str:
    """A few words on a file by its first bytes.

    >>> describe_file_start(b"time,heading_deg\\n0.0,12.3\\n")
    'a table with the columns time, heading_deg: `seatrial import` reads tables'
    """
    if name := name_of_imported_log(head):
        return f"{name}: `seatrial import` makes a recording of it"
    for magic, name in _MAGIC.items():
        if head.startswith(magic):
            return name
    if head[:1] == b"\0" and head[8:9] in (b"\xfd", b"\xfe"):
        return 'a telemetry log of MAVLink: `type = "mavlink_file"` reads it'
    printable = sum(32 <= byte < 127 or byte in b"\t\r\n" or byte > 127 for byte in head)
    if printable < 0.9 * len(head):
        return f"binary, and begins with {head[:8].hex(' ')}"
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines() if line.strip()]
    beginning = next((line for line in lines if not line.startswith("#")), "")
    if beginning.startswith(("{", "[")):
        return "JSON, already decoded by another program: what came off the bus is needed"
    if "$" in beginning or "!" in beginning:
        fix = "" if "*" in beginning else ', which checksum = "optional" reads'
        return f"sentences without a sound checksum ({_shorten_text(beginning)}){fix}"
    names = [name.strip(' "') for name in beginning.replace(";", ",").replace("\t", ",").split(",")]
    if len(names) > 1 and all(name and not name[0].isdigit() for name in names):
        return f"a table with the columns {_shorten_text(', '.join(names))}: `seatrial import` reads tables"
    return f"text ({_shorten_text(beginning)})" if beginning else "text without a word in it"


def _shorten_text(text: str) -> str:
    shown = "".join(character if character.isprintable() else "?" for character in text)
    return shown if len(shown) <= _MOST_LETTERS else f"{shown[:_MOST_LETTERS]}..."


def make_source(config: AnySource) -> Source:
    """The source that a configuration section describes, not yet open."""
    source: Source = named_code.import_object(_CLASSES[config.type])(config)
    return source


class OwnCode(Source):
    """One object of a user's class. Raises :class:`ConfigurationError` for what is no such class."""

    def __init__(self, config: OwnSource) -> None:
        super().__init__(config)
        self._class: Any = named_code.load(config.code, "sources")
        self._file = named_code.defining_file(self._class)
        named_code.require_signature(self._class, config.code, "timeout_s", method="read")

    def _connect(self) -> Any:
        with named_code.report_user_code_errors(self._config.code, self._file):
            return self._class(**self._config.options)

    def _receive(self, timeout_s: float) -> list[trial.Frame] | None:
        with named_code.report_user_code_errors(f"{self._config.code}.read", self._file):
            received = self._link.read(timeout_s)
        if received is None:
            return None
        clocks, payloads = trial.wall_and_monotonic_ns(), []
        for reading in received if isinstance(received, list) else [received]:
            if isinstance(reading, str | bytes):
                line = reading.encode() if isinstance(reading, str) else reading
                payloads.append(f"{_LINES_TOPIC}\0".encode() + line)
                continue
            if not isinstance(reading, dict):
                what = f"read returned a {type(reading).__name__}"
                raise self.failure(what, fix="return a dict of channels, or a list")
            time = f",{reading['time']}" if reading.get("time") is not None else ""
            for name, value in reading.items():
                if name == "time":
                    continue
                if name not in self._config.values:
                    fix = "declare it as [[channel]], or rename it"
                    raise self.failure(f"tells {name!r}", "it is no channel", fix)
                payloads.append(f"own/{name}\0{value}{time}".encode())
        return [trial.Frame(self.name, "mqtt", payload, *clocks) for payload in payloads]

    def close(self) -> None:
        if self._link is not None and hasattr(self._link, "close"):
            with named_code.report_user_code_errors(f"{self._config.code}.close", self._file):
                self._link.close()
        self._link = None


def enlarge_receive_buffer(opened: socket.socket, size_bytes: int) -> None:
    """Ask for so large a receive buffer; without the right to exceed it the system's ``rmem_max`` holds."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size_bytes)
    except OSError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size_bytes)


def enable_arrival_stamps(opened: socket.socket) -> None:
    """Ask the system to stamp what comes, as far as it can."""
    with suppress(OSError):
        opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


def arrival_stamp_ns(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """The stamp in the ancillary data of ``recvmsg`` [ns since 1970]; None where there is none."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) >= _TIME.size:
            seconds, nanoseconds = _TIME.unpack_from(data)
            return int(seconds * trial.NANO + nanoseconds)
    return None


def dropped_by_system(opened: socket.socket) -> int:
    """How many datagrams or frames the system has had no room for, modulo 2^32; 0 where it does not report it."""
    try:
        meminfo = opened.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO_BYTES)
    except OSError:
        return 0
    return int(struct.unpack_from("@I", meminfo, 4 * _DROPPED)[0]) if len(meminfo) == _MEMINFO_BYTES else 0


def clocks_at_reception(stamp_ns: int | None) -> tuple[tuple[int, int], bool]:
    """The wall and the monotonic clock [ns] when something came, and whether by its stamp; if not, now."""
    wall_ns, monotonic_ns = trial.wall_and_monotonic_ns()
    waited_ns = -1 if stamp_ns is None else wall_ns - stamp_ns
    if stamp_ns is None or not 0 <= waited_ns < _OLDEST_NS:
        return (wall_ns, monotonic_ns), False
    return (stamp_ns, monotonic_ns - waited_ns), True


class Drops:
    """How many the system dropped of one socket since the last count."""

    def __init__(self, opened: socket.socket) -> None:
        self._socket, self._before = opened, dropped_by_system(opened)

    def count(self) -> int:
        """How many it dropped since the last call."""
        before, self._before = self._before, dropped_by_system(self._socket)
        return (self._before - before) % 2**32


class Senders:
    """The senders that a source has received from. ``allowed`` are their networks; none: anyone may send.

    ``refused`` counts what came from elsewhere, by reason; ``news`` names these senders once, and all but the first
    of those that may send, as (level, text), and is emptied by the reader.
    """

    def __init__(self, allowed: Sequence[Network]) -> None:
        self._allowed = tuple(allowed)
        self._senders: dict[str, bool] = {}
        self.refused: Counter[str] = Counter()
        self.news: deque[tuple[str, str]] = deque()

    def admits(self, sender: str) -> bool:
        """Whether something from this address (IPv4 or IPv6, without a port) may come in."""
        is_allowed = self._senders.get(sender)
        if is_allowed is None:
            address = ipaddress.ip_address(sender.partition("%")[0])
            is_allowed = not self._allowed or any(address in network for network in self._allowed)
            if len(self._senders) < _MOST_SENDERS:
                if not is_allowed:
                    self.news.append(("warning", f"{sender} sends and may not"))
                elif any(self._senders.values()):
                    self.news.append(("info", f"{sender} sends, too: its values are kept apart"))
                self._senders[sender] = is_allowed
        if not is_allowed:
            self.refused["sender that is not allowed"] += 1
        return is_allowed


class Input(NamedTuple):
    """A kind of input: what it is, who is a source of its own in it, and what its times are.

    ``live`` says whether it can come over a line as well as from a file.
    """

    what: str
    identity: str
    times: str
    live: bool = False


_ADDRESS = "the device's address, or its NAME once it has claimed one"
_BUS = "; of several buses in one log each"
_TALKER = (
    "the talker, with the source of a TAG block; satellite talkers (GP, GN, GL ...) are one receiver, two positions"
    " of one moment more than 10 m apart two; values that take turns between two levels are of two; at one port"
    " each address"
)
_COMPONENT = "the system, and every component but the autopilot; at one port each address"
_SINCE_GATEWAY = "since the gateway started; UTC where the bus or a sentence tells it near the log's beginning"
_OF_DAY = "time of day; the date is that of the bus or a sentence, else of the file's last change, which is said"

INPUTS: dict[str, Input] = {
    "nmea0183": Input(
        "sentences, TAG blocks, with anything that a logger wrote before them", _TALKER,
        "before the sentence: date and time (UTC or with a zone; the whole log decides whether the day or the month"
        " comes first), seconds to nanoseconds since 1970, or time of day; else of the TAG block", live=True,
    ),
    "candump": Input(
        "can-utils, with every option", f"{_ADDRESS}{_BUS} interface",
        "UTC; `-tA` this computer's zone; `-tz`, `-td` since the start or the previous frame", live=True,
    ),
    "savvycan": Input(
        "SavvyCAN's table of frames", f"{_ADDRESS}{_BUS} in the column Bus", "since 1970 or since the log began"
    ),
    "python_can": Input("python-can's table of frames", _ADDRESS, "since 1970 or since the log began"),
    "canboat": Input(
        "canboat's lines: time, priority, group, source, destination, bytes", _ADDRESS,
        "UTC or with a zone, to the nanosecond", live=True,
    ),
    "yacht_devices": Input("Yacht Devices RAW, Actisense's CAN ASCII", _ADDRESS, _OF_DAY, live=True),
    "n2k_ascii": Input("Actisense N2K ASCII", _ADDRESS, _OF_DAY, live=True),
    "actisense": Input("Actisense's binary messages 93, 95, D0", _ADDRESS, _SINCE_GATEWAY, live=True),
    "ikonvert": Input("Digital Yacht iKonvert, NavLink2", _ADDRESS, _SINCE_GATEWAY, live=True),
    "seasmart": Input(
        "`$PCDIN` (SeaSmart, Chetco and many since)", _ADDRESS,
        "since the gateway started, or 1/1024 s since 2010", live=True,
    ),
    "mxpgn": Input(
        "`$MXPGN` (ShipModul MiniPlex)", _ADDRESS, "none: of what came before, or of what the bus tells", live=True
    ),
    "opencpn": Input("voyage data recorder of OpenCPN, CSV of both kinds", _ADDRESS, "UTC"),
    "garmin": Input("chart plotters' CSV", _ADDRESS, "since it started, or UTC"),
    "ebl": Input("Actisense EBL", _ADDRESS, "UTC"),
    "ydvr": Input("Yacht Devices' recorders, .DAT", _ADDRESS, "in the minute; UTC where the bus tells it"),
    "yd_can": Input(
        "Yacht Devices' recorders, .CAN", _ADDRESS, "since the recorder started; UTC where the bus tells it"
    ),
    "pcap": Input(
        "tcpdump and Wireshark on SocketCAN, or on a network: lines and messages in datagrams of UDP and"
        " streams of TCP; the older form",
        f"{_ADDRESS}; captured on all interfaces, each; of a network each sender", "UTC",
    ),
    "pcapng": Input("the newer form", f"{_ADDRESS}{_BUS} interface", "UTC"),
    "asc": Input(
        "Vector's ASC", f"{_ADDRESS}{_BUS} channel",
        "since the date in its header (this computer's zone), since the line before (`timestamps relative`), or"
        " times of day, which is said",
    ),
    "blf": Input("Vector's BLF, by python-can", f"{_ADDRESS}{_BUS} channel", "UTC"),
    "mf4": Input("frames of a bus in ASAM MDF 4 (CANedge and others), by python-can and asammdf",
                 f"{_ADDRESS}{_BUS} channel", "UTC"),
    "trc": Input(
        "PEAK's TRC, by python-can", f"{_ADDRESS}{_BUS} channel",
        "since its start, by the line for that or by its comments",
    ),
    "mavlink": Input("MAVLink over a network or a serial line", _COMPONENT, "of reception", live=True),
    "mavlink_file": Input(
        "telemetry logs of ground stations (.tlog)", _COMPONENT,
        "UTC; of a clock that was not set the distances, and the date by SYSTEM_TIME, by the clock once it was set,"
        " or by the file's last change, which is said",
    ),
    "mqtt": Input("MQTT, values and sentences", "the topic", "of reception, or beside the value", live=True),
    "topic_file": Input(
        "logs of several topics: bags of ROS, MCAP of others, ULog, DataFlash, MDF, TDMS, HDF5 and so on",
        "the topic", "as [the import](../howto/import.md#logs-of-several-topics) has them",
    ),
    "mqtt_file": Input("R/V Gunnerus' SQLite log of MQTT messages", "the topic", "UTC, of the log"),
    "can": Input("a CAN bus of this computer, by python-can", _ADDRESS, "of the system's reception", live=True),
}  # fmt: skip
"""Every kind of input, by its ``form`` or by the ``type`` of its source."""


class BoundedLog(io.BufferedReader):
    """A log, unpacked if it is ``packed`` by gzip; reading raises :class:`InputError` beyond its budget."""

    def __init__(self, path: Path, *, packed: bool) -> None:
        self._bytes = _Bytes(path, packed)
        super().__init__(self._bytes, _BLOCK_BYTES)

    @property
    def meter(self) -> process.Meter:
        """What the reading has taken so far."""
        return self._bytes.meter


class _Bytes(io.RawIOBase):
    """The bytes of a log, counted since the last time that it was read from its beginning."""

    def __init__(self, path: Path, packed: bool) -> None:
        self._path, self._size_bytes, self._packed = path, path.stat().st_size, packed
        self._stream: Any = gzip.GzipFile(path) if packed else path.open("rb")
        self.meter = process.Meter(path, self._size_bytes)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int:
        data = self._stream.read1(len(buffer))  # what is there: more of a log that is cut off would raise
        self.meter.add(process.LOG_BYTES, len(data))
        buffer[: len(data)] = data
        return len(data)

    def seek(self, offset: int, origin: int = os.SEEK_SET, /) -> int:
        if origin == os.SEEK_END and self._packed:
            while self.read(_BLOCK_BYTES):
                pass
            return int(self._stream.tell())
        place = int(self._stream.seek(offset, origin))
        self.meter = process.Meter(self._path, self._size_bytes)
        return place

    def tell(self) -> int:
        return int(self._stream.tell())

    def close(self) -> None:
        self._stream.close()
        super().close()


class Lines(io.TextIOWrapper):
    """The lines of a log as text; one without an end raises ValueError, not the memory that it takes."""

    def __next__(self) -> str:  # type: ignore[override]  # as TextIOWrapper's is in truth
        line = self.readline(process.TEXT_BYTES.least)
        if not line:
            raise StopIteration
        if len(line) >= process.TEXT_BYTES.least and not line.endswith("\n"):
            raise ValueError(f"it has a line of more than {process.TEXT_BYTES.least:,} letters")
        return line
