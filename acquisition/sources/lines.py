"""Receives from lines and buses: serial, TCP and UDP (NMEA 0183, a gateway's NMEA 2000, MAVLink), and CAN.

CAN frames come from any interface that python-can knows; MQTT messages, a frame each with its topic, from a broker
or from an SQLite log of them.

The connection to a broker asks for quality of service 0 and a clean session. Between it and its subscriber TCP
loses nothing, and what waits while the recorder stands still is in a large receive buffer: with quality 1 a broker
holds back no more than some 1,000 messages and drops further ones. What is published while the connection is down
is lost either way, unless the broker keeps it for us: then the age of a message without a time would be unknown.
"""

from __future__ import annotations

import fcntl
import ipaddress
import logging
import os
import socket
import sqlite3
import ssl
import struct
import termios
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, BinaryIO

import can
from can.interfaces.udp_multicast.utils import unpack_message

from seatrial.acquisition import sources
from seatrial.acquisition.config import sources as sections
from seatrial.acquisition.core.errors import ConfigurationError, SourceError, system_reason
from seatrial.acquisition.core.files import read_secret
from seatrial.acquisition.core.process import TEXT_BYTES
from seatrial.acquisition.core.trial import HIGHEST_IDENTIFIER, Frame, FrameFlag, can_flags, wall_and_monotonic_ns
from seatrial.acquisition.protocols.clock import is_possible_time
from seatrial.acquisition.sources import log_formats

if TYPE_CHECKING:
    import serial
    from paho.mqtt.client import Client, MQTTMessage


_DATAGRAM_BYTES = 65_535
_MOST_DATAGRAMS = 100
_BUFFER_BYTES = 4 * 1024 * 1024
_CONNECT_TIMEOUT_S = 3.0

_MOST_FRAMES_AT_ONCE = 200
_UNREADABLE = "frame that cannot be read"
_UNPLUGGED, _DRIVER_FAULT = "it was unplugged, or another program reads it", "its driver reports a fault"
_MOST_UNREADABLE = 1_000  # in a row: then it is the driver that is broken, not what comes
_LONGEST_FRAME_BYTES = 64
_BUS_BUFFER_BYTES = 16 * 1024 * 1024  # ten seconds of a full bus, a frame takes some 800 bytes of it

_ICOUNT_BYTES, _OVERRUN = 80, (7, 10)  # struct serial_icounter_struct: overrun, buf_overrun

_GREETINGS = {
    "actisense": b"\x10\x02\xa1\x03\x11\x02\x00\x49\x10\x03",  # operating mode: pass on all that is received
    "ikonvert": b"$PDGY,N2NET_INIT,ALL\r\n",
}
"""What makes a gateway on a serial line pass on what it receives; sent only where its form is configured."""

StreamSource = (
    sections.SerialSource
    | sections.UdpSource
    | sections.TcpSource
    | sections.MavlinkSource
    | sections.MavlinkTcpSource
    | sections.MavlinkSerialSource
)


class LineAssembler:
    """Cuts a stream of bytes into frames, stamped when they were complete: sentences, and what gateways send.

    What stands before a sentence, a TAG block or a datagram's prefix, stays with it. A line that is of no form that
    is known is a frame of NMEA 0183, for the decoder to refuse and to count.
    """

    def __init__(self, origin: str, form: str = "") -> None:
        self._origin = origin
        self._reader = log_formats.LineReader(form)
        self._cutter = log_formats.StreamCutter()
        self.cut = self._cutter.cut

    def push(self, received: bytes, times: tuple[int, int] | None = None) -> list[Frame]:
        """The frames that ``received`` completes, at the ``times`` of both clocks, else now; no empty lines."""
        return self._frames(self._cutter.push(received), times)

    def end(self, times: tuple[int, int] | None = None) -> list[Frame]:
        """The last line, where the stream ended without a line end (a datagram, a file)."""
        return self._frames(self._cutter.end(), times)

    def _frames(self, pieces: list[bytes], times: tuple[int, int] | None) -> list[Frame]:
        clocks, frames = times or wall_and_monotonic_ns(), []
        for part in chain.from_iterable(map(log_formats.split_into_entries, pieces)):
            entry, binary = self._reader.entry(part), log_formats.is_message(part)
            if not binary and (entry is None or entry.protocol == "nmea0183"):
                entry = log_formats.LogEntry(None, part, protocol="nmea0183")  # raw input is what came
            if entry is not None:  # a binary message need not be from the bus
                of_can = entry.identifier, entry.flags
                frames.append(Frame(self._origin, entry.protocol, entry.payload, *clocks, *of_can))
        return frames


class _Stream(sources.Source):
    """One line or connection. MAVLink is cut into packets by its decoder."""

    def __init__(self, config: StreamSource) -> None:
        super().__init__(config)
        self._lines = None if isinstance(config, sections.MavlinkLinks) else LineAssembler(config.name, config.form)
        if not isinstance(config, sections.SerialSource | sections.MavlinkSerialSource):
            self.senders = sources.Senders(config.senders)

    @abstractmethod
    def _bytes(self, timeout_s: float) -> bytes:
        """What has come, or nothing after the timeout. Raises what the line raises."""

    def open(self) -> None:
        super().open()
        if self._lines is not None:
            self._lines.cut()

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        received = self._bytes(timeout_s)
        if not received:
            return []
        if self._lines is None:
            return [Frame(self.name, "mavlink", received, *wall_and_monotonic_ns())]
        return self._lines.push(received)


def overrun_count(descriptor: int) -> int:
    """How often a serial line had no room for a byte, in its chip or driver; 0 where it does not report it."""
    counts = bytearray(_ICOUNT_BYTES)
    try:
        fcntl.ioctl(descriptor, termios.TIOCGICOUNT, counts)
    except OSError:  # a pseudo-terminal, or a driver that does not count
        return 0
    numbers = struct.unpack(f"@{_ICOUNT_BYTES // 4}i", counts)
    return sum(numbers[place] for place in _OVERRUN)


def open_port(config: sections.SerialSource | sections.MavlinkSerialSource) -> serial.Serial:
    """Open the serial port of a configuration section, 8N1. Raises :class:`SourceError`."""
    import serial

    try:
        return serial.Serial(config.device, config.baud_rate, timeout=0, exclusive=True)
    except (ValueError, OSError) as error:  # pyserial's own errors are OSErrors
        reason = system_reason(error) or "its settings are not possible"
        fix = "connect it, stop the program that uses it, or correct `device`"
        raise sources.source_error(config, f"serial line {config.device} cannot be opened", reason, fix) from error


class SerialPort(_Stream):
    """One serial port: a line of NMEA 0183, a telemetry radio, or the autopilot's own port.

    ``lost`` counts overruns: the chip or the driver had no room for one byte or more.
    """

    _overruns = 0
    loss = "the serial line has overrun {:,} times: bytes were lost"

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames = super()._receive(timeout_s)
        now = overrun_count(self._link.fd)
        self.lost += max(now - self._overruns, 0)
        self._overruns = now
        return frames

    def _connect(self) -> serial.Serial:
        port = open_port(self._config)
        self._overruns = overrun_count(port.fd)
        if greeting := _GREETINGS.get(getattr(self._config, "form", "")):
            try:
                port.write(greeting)
            except OSError as error:
                port.close()
                raise self.failure("serial line failed", system_reason(error) or _UNPLUGGED) from error
        return port

    def _bytes(self, timeout_s: float) -> bytes:
        try:
            if self._link.timeout != timeout_s:  # setting it asks the system for the line's settings each time
                self._link.timeout = timeout_s
            data = bytes(self._link.read(1))
            return data + bytes(self._link.read(self._link.in_waiting)) if data else b""
        except (OSError, TypeError) as error:  # pyserial raises TypeError on unplug
            raise self.failure("serial line failed", system_reason(error) or _UNPLUGGED) from error


class TcpConnection(_Stream):
    """One connection to a server: a multiplexer, a gateway, a router, or a simulated autopilot."""

    senders: sources.Senders

    def _connect(self) -> socket.socket:
        address, port = self._config.address, self._config.port
        try:
            opened = socket.create_connection((address, port), timeout=_CONNECT_TIMEOUT_S)
        except OSError as error:
            unresolved = isinstance(error, socket.gaierror)
            reason = system_reason(error) or "no answer in time"
            fix = "correct `address`" if unresolved else "start the gateway, or correct `address` and `port`"
            raise self.failure(f"TCP {address}:{port} does not answer", reason, fix) from error
        self._peer = str(opened.getpeername()[0])
        if not self.senders.admits(self._peer):
            opened.close()
            raise self.failure(f"{self._peer} answers, which may not", fix="correct `address` or `senders`")
        return opened

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        return [frame._replace(sender=self._peer) for frame in super()._receive(timeout_s) or ()]

    def _bytes(self, timeout_s: float) -> bytes:
        try:
            self._link.settimeout(timeout_s)
            received = bytes(self._link.recv(_DATAGRAM_BYTES))
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise self.failure("connection failed", system_reason(error) or _UNPLUGGED) from error
        if not received:
            raise self.failure("the other end closed the connection")
        self.behind = len(received) == _DATAGRAM_BYTES
        return received


class UdpPort(_Stream):
    """A UDP port that others send to, a datagram one or more sentences, or some MAVLink.

    ``lost`` counts the datagrams that the system had no room for.
    """

    senders: sources.Senders

    def _connect(self) -> socket.socket:
        """A socket bound to the section's address, with as large a buffer as the system allows.

        A multicast group, such as those of IEC 61162-450, is joined, and other programs may listen to it too.
        """
        address, port = self._config.address, self._config.port
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sources.enlarge_receive_buffer(opened, _BUFFER_BYTES)
            sources.enable_arrival_stamps(opened)
            shared = False
            with suppress(ValueError):
                shared = ipaddress.IPv4Address(address).is_multicast
            if shared:
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            opened.bind((address, port))  # to a group's own address: nothing else comes
            if shared:
                _join_group(opened, address)
        except OSError as error:
            opened.close()
            fix = "stop the program that uses it, or correct `address` and `port`"
            fix = "correct `address`" if isinstance(error, socket.gaierror) else fix
            problem = f"UDP {address}:{port} cannot be listened on"
            raise self.failure(problem, str(error.strerror), fix) from error
        self._drops = sources.Drops(opened)
        return opened

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        self.exact = True
        try:
            self._link.settimeout(timeout_s)
            for _ in range(_MOST_DATAGRAMS):
                frames += self._frames(self._bytes(timeout_s))
                self._link.settimeout(0.0)
        except (TimeoutError, BlockingIOError):
            pass
        except OSError as error:
            raise self.failure("network failed", str(error.strerror)) from error
        self.behind = len(frames) >= _MOST_DATAGRAMS
        self.lost += self._drops.count()
        return frames

    def _bytes(self, timeout_s: float) -> bytes:
        data, ancillary, _, (self._sender, _) = self._link.recvmsg(_DATAGRAM_BYTES, sources.TIME_BYTES)
        self._times, stamped = sources.clocks_at_reception(sources.arrival_stamp_ns(ancillary))
        self.exact = self.exact and stamped
        return bytes(data) if self.senders.admits(self._sender) else b""

    def _frames(self, datagram: bytes) -> list[Frame]:
        """The frames of a datagram, which never continues the one before it."""
        if self._lines is None:
            return [Frame(self.name, "mavlink", datagram, *self._times, sender=self._sender)] if datagram else []
        frames = self._lines.push(datagram, self._times) + self._lines.end(self._times)
        return [frame._replace(sender=self._sender) for frame in frames]


def _join_group(opened: socket.socket, address: str) -> None:
    """Join a group on every interface, as the instruments' need not be the default route.

    Raises :class:`OSError` if not one of them can join.
    """
    interfaces, failures = socket.if_nameindex(), list[OSError]()
    for index, _ in interfaces:
        membership = struct.pack("4s4si", socket.inet_aton(address), socket.inet_aton("0.0.0.0"), index)
        try:
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        except OSError as error:  # one that knows no multicast, or is down
            failures.append(error)
    if failures and len(failures) == len(interfaces):
        raise failures[-1]


def open_bus(config: sections.CanSource) -> can.BusABC:
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
        if config.interface not in can.VALID_INTERFACES:
            interfaces = ", ".join(sorted(can.VALID_INTERFACES))
            reason = f"python-can knows no interface {config.interface!r}, only {interfaces}"
        elif isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError | AttributeError):
            reason = system_reason(error) or "its driver is not installed on this computer"
        elif isinstance(error, ValueError | TypeError):
            reason = system_reason(error) or "the interface does not take this channel with these options"
        else:
            reason = system_reason(error) or "its driver is not installed, or finds no such interface"
        problem = f"CAN bus {config.interface}:{config.channel} cannot be opened"
        fix = "connect the interface, or correct `interface`, `channel` and `options`"
        raise sources.source_error(config, problem, reason, fix) from error


def frame_flags(message: can.Message) -> FrameFlag:
    """What kind of frame python-can's message was."""
    return can_flags(not message.is_extended_id, message.is_remote_frame, message.is_error_frame)


class CanBus(sources.Source):
    """One bus; frames have the system's stamp where they come by a socket, else that of when they are read.

    ``lost`` counts the frames that the system had no room for, ``refused`` what came and was no frame: noise on the
    serial line of an adapter, an unrelated datagram. A bus that fails does so once what came before is passed on.
    """

    def __init__(self, config: sections.CanSource) -> None:
        super().__init__(config)
        self._unreadable = 0
        self._failed: Exception | None = None

    def _connect(self) -> can.BusABC:
        bus = open_bus(self._config)
        if self._config.interface == "udp_multicast":
            bus._multicast.recv = partial(self._receive_readable, bus._multicast.recv)
        self._unreadable, self._failed = 0, None
        self._socket = _socket_of_bus(bus)
        if self._socket is not None:
            sources.enlarge_receive_buffer(self._socket, _BUS_BUFFER_BYTES)
            self._drops = sources.Drops(self._socket)
        return bus

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        frames: list[Frame] = []
        self.exact = self._socket is not None
        if self._failed is not None:
            raise self.failure("CAN bus failed", system_reason(self._failed) or _DRIVER_FAULT) from self._failed
        try:
            while len(frames) < _MOST_FRAMES_AT_ONCE and (message := self._link.recv(0.0 if frames else timeout_s)):
                identifier = message.arbitration_id
                highest = HIGHEST_IDENTIFIER if message.is_extended_id else 0x7FF
                is_identifier = isinstance(identifier, int) and 0 <= identifier <= highest
                if is_identifier and len(message.data) <= _LONGEST_FRAME_BYTES:
                    frames.append(self._frame(message))
                else:  # some drivers do not check what they receive
                    self.refused[_UNREADABLE] += 1
        except Exception as error:
            if isinstance(error, can.CanError | OSError) and not isinstance(error.__cause__, ValueError):
                if not frames:
                    raise self.failure("CAN bus failed", system_reason(error) or _DRIVER_FAULT) from error
                self._failed = error
            else:  # python-can's drivers raise what they like where a line is no frame
                self._count_unreadable(error)
        else:
            self._unreadable = 0
        self.behind = len(frames) == _MOST_FRAMES_AT_ONCE
        if self._socket is not None:
            self.lost += self._drops.count()
        return frames

    def _count_unreadable(self, error: Exception) -> None:
        self.refused[_UNREADABLE] += 1
        self._unreadable += 1
        if isinstance(pending := getattr(self._link, "_buffer", None), bytearray):
            pending.clear()  # slcan keeps what is no text, and would fail on it for ever
        if self._unreadable > _MOST_UNREADABLE:
            raise self.failure("CAN bus failed", "nothing that comes is a frame") from error

    def _receive_readable(self, receive: Callable[[float | None], Any], timeout_s: float | None = None) -> Any:
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
        times, stamped = sources.clocks_at_reception(stamp_ns)
        self.exact = self.exact and stamped
        return Frame(self.name, "can", bytes(message.data), *times, message.arbitration_id, frame_flags(message))


def _socket_of_bus(bus: can.BusABC) -> socket.socket | None:
    """The socket behind a bus, by a handle of its own; None where it has none."""
    try:
        handle = os.dup(bus.fileno())
    except (NotImplementedError, OSError, ValueError, TypeError):
        return None
    try:
        return socket.socket(fileno=handle)
    except OSError:
        os.close(handle)
        return None


_KEEP_ALIVE_S = 10  # a broker that is cut off without a word is found out after one and a half of it
_TIMEOUT_S = 3.0  # to connect, and for the broker's answer
_POLL_S = 0.1
_MOST_AT_ONCE, _MOST_BYTES_AT_ONCE = 300, 1_000_000
_COMPUTED = "SELECT 1 FROM sqlite_master WHERE upper(name) = 'LOG' AND sql NOT LIKE 'CREATE TABLE%'"
_ROWS = "SELECT UNIX_TIME, TOPIC, MESSAGE FROM LOG ORDER BY ID"
_HEAD_BYTES = 4096
_NOT_ALLOWED = (134, 135)  # MQTT's reasons: bad user name or password, not authorized


def broker_error(config: sections.BrokerAccess, what: str, why: str = "", fix: str = "") -> SourceError:
    """An error of the connection to a broker, which is named; users and passwords are not."""
    address, port = config.endpoint
    where = f"{config.role} {config.name!r}"
    return SourceError(f"MQTT broker {address}:{port} {what}", where=where, why=why, fix=fix)


def connect_to_broker(config: sections.BrokerAccess, keep_alive_s: int = _KEEP_ALIVE_S) -> Client:
    """Connect to a broker, which has answered then. Raises :class:`SourceError`."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    client = Client(CallbackAPIVersion.VERSION2, config.client_id or None, clean_session=True)
    client.connect_timeout = _TIMEOUT_S
    client.on_socket_open = lambda client, _, opened: sources.enlarge_receive_buffer(opened, _BUFFER_BYTES)  # type: ignore[arg-type]
    if config.user:
        client.username_pw_set(config.user, _read_password(config))
    if config.encrypted:
        try:
            client.tls_set_context(ssl.create_default_context(cafile=config.ca_file))
        except OSError as error:
            reason = f"{config.ca_file}: {_connection_failure_reason(error)}"
            raise broker_error(config, "cannot be checked", reason, "correct `ca_file`") from error
    answers: list[Any] = []
    client.on_connect = lambda *arguments: answers.append(arguments[3])
    try:
        client.connect(*config.endpoint, keepalive=keep_alive_s)
    except (OSError, ValueError) as error:
        wrong = "`port`, `tls` and `ca_file`" if isinstance(error, ssl.SSLError) else "`address` and `port`"
        raise broker_error(
            config, "does not answer", _connection_failure_reason(error), f"start it, or correct {wrong}"
        ) from error
    answer = _await_broker_answer(config, client, answers)
    if answer.is_failure:
        fix = "correct `user` and its password" if answer.value in _NOT_ALLOWED else ""
        raise broker_error(config, "refuses the connection", str(answer), fix)
    return client


def _connection_failure_reason(error: Exception) -> str:
    """Why there is no connection, in words that do not depend on the library."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate cannot be trusted: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return "it is no certificate, or nothing there speaks TLS"
    return system_reason(error) or "no answer in time"


def _read_password(config: sections.BrokerAccess) -> str | None:
    try:
        return read_secret(config.password_variable, config.password_file)
    except ConfigurationError as error:
        fix = error.fix or "correct `password_file`"
        raise broker_error(config, "has no password", error.what, fix) from error


def _await_broker_answer(config: sections.BrokerAccess, client: Client, answers: list[Any]) -> Any:
    """What the broker answers. Raises :class:`SourceError` if it does not in time."""
    until_s = time.monotonic() + _TIMEOUT_S
    while not answers:
        try:
            receive_one_message(config, client, _POLL_S)
        except SourceError:  # a broker that says no hangs up
            if not answers:
                raise
        if time.monotonic() > until_s:
            raise broker_error(
                config, "does not answer", "something else may listen there", "correct `port` and `tls`"
            )
    return answers[0]


def receive_one_message(config: sections.BrokerAccess, client: Client, timeout_s: float) -> None:
    """Take what has come, at most one message, or wait for it. Raises :class:`SourceError` of a lost connection."""
    from paho.mqtt.client import error_string
    from paho.mqtt.enums import MQTTErrorCode

    try:
        code = client.loop(timeout_s)
    except Exception as error:  # what paho makes of packets that break the protocol
        raise broker_error(config, "is lost", system_reason(error) or "it breaks the protocol of MQTT") from error
    if code != MQTTErrorCode.MQTT_ERR_SUCCESS:
        raise broker_error(config, "is lost", error_string(code).rstrip("."))


class MqttConnection(sources.Source):
    """One connection to one broker; ``remark`` names what the broker did not let us subscribe to."""

    remark = ""

    def __init__(self, config: sections.MqttSource) -> None:
        super().__init__(config)
        self._frames: list[Frame] = []
        self._size = 0  # of these [bytes]
        self._lost: SourceError | None = None

    def _connect(self) -> Client:
        config: sections.MqttSource = self._config
        self._frames, self._size, self._lost = [], 0, None
        client = connect_to_broker(config)
        client.on_message = self._on_message
        answers: list[Any] = []
        client.on_subscribe = lambda *arguments: answers.append(arguments[3])
        client.subscribe([(topic, 0) for topic in config.subscriptions])
        codes = _await_broker_answer(config, client, answers)
        refused = [topic for topic, code in zip(config.subscriptions, codes, strict=False) if code.is_failure]
        if len(refused) == len(config.subscriptions):
            fix = "correct `topics`, or ask for the right to them"
            raise broker_error(config, f"refuses {', '.join(refused)}", fix=fix)
        self.remark = f"the broker refuses {', '.join(refused)}" if refused else ""
        return client

    def _on_message(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        flags = FrameFlag.RETAINED if message.retain else FrameFlag.NONE
        try:
            topic = message.topic.encode()
        except UnicodeDecodeError:  # some brokers pass on what is no text
            topic = message._topic
        payload = topic + b"\0" + bytes(message.payload)
        self._frames.append(Frame(self.name, "mqtt", payload, *wall_and_monotonic_ns(), flags=flags))
        self._size += len(payload)

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        before = -1
        try:
            while self._lost is None and before < len(self._frames) < _MOST_AT_ONCE and not self._is_full:
                before = len(self._frames)
                receive_one_message(self._config, self._link, 0.0 if before else timeout_s)
        except SourceError as error:  # told once what came before is passed on
            self._lost = error
        self.behind = len(self._frames) >= _MOST_AT_ONCE or self._is_full
        frames, self._frames, self._size = self._frames, [], 0
        if self._lost is not None and not frames:
            raise self._lost
        return frames

    @property
    def _is_full(self) -> bool:
        return self._size >= _MOST_BYTES_AT_ONCE

    def close(self) -> None:
        if self._link is not None:
            self._link.disconnect()
            self._link = None


class MqttLog(sources.LogReader):
    """An SQLite log, as mqtt-logger and the logging tools of R/V Gunnerus write it.

    Its table ``LOG`` has a row a message: ID, RUN_ID, UNIX_TIME (when it came), TOPIC, MESSAGE. ``unreadable``
    counts rows without a topic or a time, ``damage`` is what ended its reading.
    """

    def _read_beginning(self, file: BinaryIO) -> None:
        self.unreadable, self.damage = 0, ""
        self._monotonic_ns, self._topics = 0, dict[str, bool]()
        head = file.read(_HEAD_BYTES)
        if not head.startswith(sources.SQLITE):
            raise ValueError(f"it is not an SQLite database; it looks like {sources.describe_file_start(head)}")
        try:
            self._log = sqlite3.connect(f"{self._config.path.resolve().as_uri()}?mode=ro", uri=True)
            self._log.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, TEXT_BYTES.allowed_amount(0))
            self._log.execute("PRAGMA trusted_schema = OFF")
            if self._log.execute(_COMPUTED).fetchall():
                raise ValueError("it is not a log of MQTT messages: its LOG is computed, perhaps without end")
            self._rows = self._log.execute(_ROWS)
        except sqlite3.Error as error:
            raise ValueError(f"it is not a log of MQTT messages: {error}") from error

    def _next_frames(self, file: BinaryIO) -> list[Frame] | None:
        try:
            rows = self._rows.fetchmany(_MOST_AT_ONCE)
        except sqlite3.Error as error:
            self.damage = f"the log is damaged ({error}); reading ended there"
            return None
        return list(self._frames(rows)) if rows else None

    def _frames(self, rows: list[tuple[Any, Any, Any]]) -> Iterable[Frame]:
        for seconds, topic, message in rows:
            time_ns = round(seconds * 1e6) * 1000 if isinstance(seconds, int | float) else 0
            if not isinstance(topic, str) or not isinstance(message, str | bytes) or not is_possible_time(time_ns):
                self.unreadable += 1
                continue
            if topic not in self._topics:
                patterns = [*self._config.topics, *(entry.topic for entry in self._config.values.values())]
                is_subscribed = any(sections.topic_pattern_covers(pattern, topic) for pattern in patterns)
                self._topics[topic] = is_subscribed or not self._config.topics
            if self._topics[topic]:
                text = message.encode() if isinstance(message, str) else message
                self._monotonic_ns = max(self._monotonic_ns, time_ns)
                payload = topic.encode("utf-8", "replace") + b"\0" + text
                yield Frame(self.name, "mqtt", payload, time_ns, self._monotonic_ns, stamped_ns=time_ns)

    def close(self) -> None:
        if self._link is not None and hasattr(self, "_log"):
            self._log.close()
        super().close()
