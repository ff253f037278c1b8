"""Listens at many places at once and detects what their bytes are: lines, gateways' frames, or MAVLink.

Places are CAN interfaces, serial lines, ports of UDP and TCP, brokers and log files, parsed from a user's words.
The latest values of a DBC file's signals and of MQTT topics are read, too, as a configuration has to map them: the
DBC file of a bus is chosen by its messages, the controls' signals by names and units.
"""

from __future__ import annotations

import logging
import os
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

import cantools
import orjson
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal
from pydantic import TypeAdapter

from seatrial.acquisition.config.sources import AnySource, TopicValue
from seatrial.acquisition.config.toml_file import parse_toml, read_text
from seatrial.acquisition.core.errors import (
    ConfigurationError,
    InputError,
    Progress,
    SeatrialError,
    SourceError,
    system_reason,
)
from seatrial.acquisition.core.quantities import canonical_unit, is_unit, scale_to
from seatrial.acquisition.core.ship import BY_NAME, RUDDER, VESSELS, Actuators, Channel, rudders
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.protocols.can_frames import frame_key, load_dbc, missing_by_name, missing_by_rule
from seatrial.acquisition.protocols.clock import SENTENCE_WITH_PREFIX
from seatrial.acquisition.protocols.mavlink import Fault, PacketCutter, has_known_message, header_of, is_read
from seatrial.acquisition.protocols.mqtt import read_message, split_time, topic_and_message
from seatrial.acquisition.protocols.nmea0183 import has_sentence
from seatrial.acquisition.protocols.nmea2000 import NOT_AVAILABLE, parameter_group
from seatrial.acquisition.sources import make_source
from seatrial.acquisition.sources.lines import LineAssembler
from seatrial.acquisition.sources.log_formats import LINE_FORMS, Cutter, LineReader, LogEntry, is_message

BAUD_RATES = (4_800, 38_400, 115_200, 9_600, 57_600, 230_400, 19_200, 460_800)
"""Baud rates of serial lines, the usual ones first: NMEA 0183, its fast form, gateways and autopilots."""
BAUD_PROBE_S = 1.6
"""How long a line is probed at each rate: instruments send once a second."""
_POLL_S = 0.1
_MOST_FRAMES = 500_000  # of one place, some 200 MB: a quarter of an hour of a busy bus
_MOST_BYTES = 100_000_000  # of one place; a flooded port has them in seconds
_RAW_TYPES = {"serial": "mavlink_serial", "udp": "mavlink", "tcp": "mavlink_tcp"}
"""The sources that read bytes as they come, by the kind of line."""
_BYTES_A_FRAME = 50  # in a log, roughly
_ENOUGH_LINES = 200
_MOST_TOPICS = 10
_HEAD_FRAMES = 5_000  # of a log, by which its kind is detected


@dataclass
class Capture:
    """What came at a place: the place with the settings that were detected, and its frames.

    ``problem`` is why nothing was received, or could be decoded; empty without one.
    """

    place: ListeningPlace
    frames: Callable[[], Iterator[Frame]] = lambda: iter(())
    count: int = 0
    expected: int = 0  # frames by the size of a log, for the progress
    problem: str = ""
    remarks: list[str] = field(default_factory=list)


def listen(
    places: Sequence[ListeningPlace],
    duration_s: float,
    stop: threading.Event | None = None,
    progress: Progress = lambda fraction: None,
) -> list[Capture]:
    """Listen at all places for ``duration_s`` [s], or until ``stop`` is set; logs are read."""
    stop, until_s = stop or threading.Event(), time.monotonic() + duration_s
    results: dict[str, Capture] = {}
    live_places = [place for place in places if place.type != "file"]
    threads = [
        threading.Thread(target=_listen_at, args=(place, until_s, stop, results), daemon=True)
        for place in live_places
    ]
    for thread in threads:
        thread.start()
    results |= {place.name: capture_log(place) for place in places if place.type == "file"}
    while any(thread.is_alive() for thread in threads):
        progress(min(1.0, 1.0 - (until_s - time.monotonic()) / max(duration_s, 1e-9)))
        time.sleep(_POLL_S)
    return [results[place.name] for place in places]


def place_section(place: ListeningPlace) -> AnySource:
    """The place as a section of a configuration."""
    section = {"name": place.name, "type": place.type, "channels": (), **place.settings}
    source: AnySource = TypeAdapter(AnySource).validate_python(section)
    return source


def capture_log(place: ListeningPlace) -> Capture:
    """A log file: its kind, and its frames, which are read again by each use."""
    path = Path(place.settings["path"])
    try:
        with path.open("rb") as file:
            head = file.read(16)
        if head[:1] == b"\0" and head[8:9] in (b"\xfd", b"\xfe"):
            place = replace(place, type="mavlink_file")
        elif head.startswith(b"SQLite format 3"):
            place = replace(place, type="mqtt_file")
        count = sum(1 for _ in islice(_receive(place), _HEAD_FRAMES))
        expected = path.stat().st_size // _BYTES_A_FRAME
        capture = Capture(place, lambda: _receive(place), count, expected)
    except SourceError as error:
        return Capture(place, problem=_error_text(error))
    except OSError as error:
        return Capture(place, problem=f"cannot be read: {error.strerror}")
    return _with_mavlink_system(capture)


def _listen_at(place: ListeningPlace, until_s: float, stop: threading.Event, results: dict[str, Capture]) -> None:
    """Put the capture of one place into ``results``, in a thread; raises nothing."""
    try:
        rated_place = _with_baud_rate(place, until_s, stop) if place.type == "serial" else place
        raw = replace(rated_place, type=_RAW_TYPES.get(rated_place.type, rated_place.type))
        frames, fault = list[Frame](), ""
        try:
            size = 0
            for frame in islice(_receive(raw, until_s, stop), _MOST_FRAMES):
                frames.append(frame)
                size += len(frame.payload)
                if size > _MOST_BYTES:
                    break
        except SeatrialError as error:
            fault = _error_text(error)
        capture = interpret(rated_place, frames)
        capture.problem = capture.problem if frames or not fault else fault
        capture.remarks += [f"{fault}; what came before is here"] if frames and fault else []
    except SeatrialError as error:
        capture = Capture(place, problem=_error_text(error))
    except Exception as error:  # drivers raise anything
        capture = Capture(place, problem=f"its driver failed: {system_reason(error) or type(error).__name__}")
    results[place.name] = capture


def _error_text(error: SeatrialError) -> str:
    """An error's fault and reason: its place is shown beside them, its remedy below."""
    return f"{error.what}: {error.why}" if error.why else error.what


def _receive(place: ListeningPlace, until_s: float = inf, stop: threading.Event | None = None) -> Iterator[Frame]:
    """The frames of a place, until the end of a log, a time [s] or ``stop``."""
    source = make_source(place_section(place))
    source.open()
    try:
        while time.monotonic() < until_s and not (stop and stop.is_set()):
            block = source.read(_POLL_S)
            if block is None:
                return
            yield from block
    finally:
        source.close()


def _with_baud_rate(place: ListeningPlace, until_s: float, stop: threading.Event) -> ListeningPlace:
    """A serial line with its baud rate, which is detected unless it is given."""
    if "baud_rate" in place.settings:
        return place

    def at(rate: int) -> ListeningPlace:
        return replace(place, settings={**place.settings, "baud_rate": rate})

    def read_at(rate: int) -> bytes:
        raw = replace(at(rate), type="mavlink_serial")
        probe_until_s = min(time.monotonic() + BAUD_PROBE_S, until_s)
        return b"".join(frame.payload for frame in _receive(raw, probe_until_s, stop))

    return at(find_baud_rate(read_at))


def find_baud_rate(read_at: Callable[[int], bytes], rates: Sequence[int] = BAUD_RATES) -> int:
    """The first rate at which the bytes of ``read_at`` hold valid messages; the first of all if no bytes come.

    Raises :class:`SourceError` if bytes come that are valid at no rate.
    """
    has_bytes = False
    for rate in rates:
        received = read_at(rate)
        has_bytes = has_bytes or bool(received)
        if max(_count_valid_bytes([received])):
            return rate
    if has_bytes:
        fix = "give the rate as /dev/ttyUSB0@RATE; check the polarity of the line"
        raise SourceError(f"bytes come, but make no sense at {', '.join(map(str, sorted(rates)))} baud", fix=fix)
    return rates[0]


def interpret(place: ListeningPlace, received: Sequence[Frame]) -> Capture:
    """The capture of what came at a place, decoded as what it is. Unknown bytes are a problem."""
    if place.type == "mqtt" and received:
        place = replace(place, settings={**place.settings, "topics": sentence_topics(received) or ["#"]})
    if place.type in ("can", "mqtt"):
        return Capture(place, lambda: iter(received), len(received), problem="" if received else _NOTHING_COMES)
    if not received:
        return Capture(place, problem=_NOTHING_COMES)
    lines, packets = _count_valid_bytes([frame.payload for frame in received], is_datagram=place.type == "udp")
    if not lines and not packets:
        beginning = received[0].payload[:24]
        return Capture(place, problem=f"bytes come that are nothing known; they begin with {beginning!r}")
    if packets > lines:
        link = replace(place, type=_RAW_TYPES[place.type])
        return _with_mavlink_system(Capture(link, lambda: iter(received), len(received)))
    assembler = LineAssembler(place.name)
    frames = [
        line for frame in received for line in _split_lines(assembler, frame, is_datagram=place.type == "udp")
    ]
    if any(frame.protocol == "can" for frame in frames):
        end = b"\n" if place.type == "udp" else b""
        form = gateway_form(end.join(frame.payload for frame in received))
        place = replace(place, settings={**place.settings, **({"form": form} if form else {})})
    return Capture(place, lambda: iter(frames), len(frames))


_NOTHING_COMES = "nothing comes"


def sentence_topics(received: Iterable[Frame]) -> list[str]:
    """The MQTT topics of sentences, or the common beginning of many; all, if a configuration cannot name one."""
    topics = set()
    for frame in received:
        topic, _, text = frame.payload.partition(b"\0")
        if _has_sentence(text.decode("latin-1")):
            topics.add(topic.decode("utf-8", "replace"))
    if not all(
        topic and topic.isprintable() and topic == topic.strip() and not set("+#") & set(topic) for topic in topics
    ):
        return ["#"]
    if len(topics) <= _MOST_TOPICS:
        return sorted(topics)
    first, last = (topic.split("/") for topic in (min(topics), max(topics)))
    common = [part for part, counterpart in zip(first[:-1], last[:-1], strict=False) if part == counterpart]
    return ["/".join([*common, "#"])]


def _has_sentence(text: str) -> bool:
    return any(SENTENCE_WITH_PREFIX.fullmatch(line.strip()) for line in text.splitlines())


def _split_lines(assembler: LineAssembler, frame: Frame, *, is_datagram: bool) -> list[Frame]:
    """The lines in a frame's bytes; those of a datagram end with a line."""
    times = frame.received_ns, frame.monotonic_ns
    return assembler.push(frame.payload, times) + (assembler.end(times) if is_datagram else [])


def _count_valid_bytes(chunks: Sequence[bytes], *, is_datagram: bool = False) -> tuple[int, int]:
    """How many bytes are of valid lines or gateways' messages, and how many of MAVLink packets."""
    assembler, cutter, lines, packets = LineAssembler(""), PacketCutter(complete=False), 0, 0
    for chunk in chunks:
        frames = _split_lines(assembler, Frame("", "nmea0183", chunk, 0, 0), is_datagram=is_datagram)
        valid = [frame.payload for frame in frames if frame.protocol == "can" or has_sentence(frame.payload)]
        lines += sum(map(len, valid))
        packets += sum(
            len(packet)
            for packet in cutter.push(chunk)
            if not isinstance(packet, Fault) and has_known_message(packet)
        )
    return lines, packets


def gateway_form(received: bytes) -> str:
    """The form in which a gateway sends NMEA 2000, by its lines; empty if none fits."""
    any_form = LineReader()
    readers = {name: LineReader(name) for name in LINE_FORMS}
    fits: Counter[str] = Counter()
    for message in Cutter().push(received + b"\n"):
        if is_message(message):
            fits["actisense"] += 1
        elif _is_frame(any_form.entry(message)):
            fits.update(name for name, reader in readers.items() if _is_frame(reader.entry(message)))
        if fits.total() > _ENOUGH_LINES:
            break
    return fits.most_common(1)[0][0] if fits else ""


def _is_frame(entry: LogEntry | None) -> bool:
    return entry is not None and entry.protocol == "can"


def _with_mavlink_system(capture: Capture) -> Capture:
    """A MAVLink link with the system of the ship: the one with most messages that are read."""
    if not capture.place.type.startswith("mavlink"):
        return capture
    cutter, systems = PacketCutter(complete=capture.place.type == "mavlink_file"), Counter[int]()
    for frame in islice(capture.frames(), _HEAD_FRAMES):
        headers = [header_of(packet) for packet in cutter.push(frame.payload) if not isinstance(packet, Fault)]
        systems.update(
            header.system_id for header in headers if is_read(header.message_id) and 0 < header.system_id < 256
        )
    if not systems:
        return replace(capture, problem="MAVLink comes, but none of the messages that are read")
    system, _ = systems.most_common(1)[0]
    if len(systems) > 1:
        other_systems = ", ".join(str(number) for number in sorted(systems) if number != system)
        capture.remarks.append(f"system {other_systems} speaks of itself, too; a source listens to one")
    return replace(capture, place=replace(capture.place, settings={**capture.place.settings, "system_id": system}))


_CAN_NAME = re.compile(r"(?:v|sl)?can\d+")
_SERIAL_NAME = re.compile(r"/dev/\S+|COM\d+")
_BY_IDENTITY = Path("/dev/serial/by-id")
_RATE = re.compile(r"(?P<device>.+)@(?P<rate>[^@/]*)")
_USUAL_CAN = ("socketcan", "pcan", "kvaser", "vector", "ixxat", "gs_usb")
_USUAL_UDP = (("0.0.0.0", 10110), ("0.0.0.0", 2000), ("0.0.0.0", 14550))
"""NMEA 0183's registered port, that of most Wi-Fi gateways to NMEA 2000, MAVLink's."""
_GROUPS = tuple((f"239.192.0.{number}", 60_000 + number) for number in range(1, 9))
"""The transmission groups of IEC 61162-450."""
_USUAL_TCP = (("127.0.0.1", 10110), ("127.0.0.1", 2000), ("127.0.0.1", 5760))
_LINK_TYPES = {"mavlink": "udp", "mavlink_tcp": "tcp", "mavlink_serial": "serial"}
INPUT_FORMS = (
    "a log file, a configuration (.toml) whose sources are listened to, can0 or can:INTERFACE:CHANNEL,"
    " /dev/ttyUSB0 or /dev/ttyUSB0@38400, any path of a serial line, udp:PORT or udp:ADDRESS:PORT,"
    " tcp:ADDRESS:PORT, mqtt:ADDRESS or mqtt:ADDRESS:PORT"
)


@dataclass(frozen=True)
class ListeningPlace:
    """One place to listen: the kind of transport and the settings of its section in a configuration.

    ``type`` is can, serial, udp, tcp, mqtt or file; ``text`` is its name for a user. It is ``expected`` if the user
    has named it. ``folder`` is that of the file which names it, or which it is.
    """

    name: str
    type: str
    settings: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    expected: bool = True
    folder: Path | None = None


def parse_places(inputs: Sequence[str]) -> list[ListeningPlace]:
    """The places that a user names, with unique names.

    Raises :class:`InputError` for what is no place, and for logs together with live places, whose times differ;
    :class:`ConfigurationError` for an invalid configuration.
    """
    places = _with_unique_names(place for text in inputs for place in _parse_place(text))
    _refuse_duplicate_lines(places)
    logs = [place.text for place in places if place.type == "file"]
    if logs and len(logs) < len(places):
        fix = "discover the logs and what is live one after the other"
        raise InputError("is a log, but other places are live", where=", ".join(logs), fix=fix)
    return places


def _refuse_duplicate_lines(places: Iterable[ListeningPlace]) -> None:
    """Raise :class:`InputError` for a serial line that is named twice, perhaps by a link: only one can read it."""
    lines: dict[str, ListeningPlace] = {}
    for place in places:
        if place.type == "serial":
            device = os.path.realpath(place.settings["device"])
            if device in lines:
                where, fix = f"{lines[device].text}, {place.text}", "name it once"
                raise InputError("are the same serial line", where=where, fix=fix)
            lines[device] = place


def _parse_place(text: str) -> list[ListeningPlace]:
    kind, _, target = text.partition(":")
    path = Path(text)
    if kind in ("udp", "tcp") and target:
        return [_port_place(kind, target, text)]
    if kind == "mqtt" and target:
        address, _, port = target.partition(":")
        return [_port_place("mqtt", f"{address}:{port or 1883}", text)]
    if kind == "can" and target.count(":") >= 1:
        interface, _, channel = target.partition(":")
        return [_can_place(interface, channel, text)]
    if _CAN_NAME.fullmatch(text) and not path.exists():
        return [_can_place("socketcan", text, text)]
    if kind == "serial" or _SERIAL_NAME.fullmatch(text) or _is_device(text):
        return [_serial_place(target if kind == "serial" else text, text)]
    if path.suffix == ".toml" and path.is_file():
        return _places_of_configuration(path)
    if path.is_file():
        return [
            ListeningPlace(path.stem, "file", {"path": str(path.absolute())}, text, folder=path.absolute().parent)
        ]
    if path.is_symlink():
        why = f"it is a link to {path.readlink()}, and nothing is there"
        raise InputError("is not an input", where=text, why=why, fix="connect the device, or correct the link")
    if os.path.lexists(path):
        kind = "a folder" if path.is_dir() else "a pipe or socket"
        raise InputError("is not an input", where=text, why=f"it is {kind}", fix=f"name {INPUT_FORMS}")
    raise InputError("is not an input", where=text, fix=f"name {INPUT_FORMS}")


def _can_place(interface: str, channel: str, text: str) -> ListeningPlace:
    """``udp_multicast:239.74.163.2?port=43113``: the interface's settings follow the question mark."""
    channel, _, query = channel.partition("?")
    options: dict[str, Any] = dict(parse_qsl(query))
    for key, value in options.items():
        for kind in (float, int):
            with suppress(ValueError):
                options[key] = kind(value)
    settings = {"interface": interface, "channel": channel, **({"options": options} if options else {})}
    return ListeningPlace(channel if channel[:1].isalpha() else "can", "can", settings, text)


def _device_and_rate(text: str) -> tuple[str, str]:
    """The path of a serial line, and the baud rate behind it; a path may contain an @, too."""
    parts = None if os.path.lexists(text) else _RATE.fullmatch(text)
    return (text, "") if parts is None else (parts["device"], parts["rate"])


def _is_device(text: str) -> bool:
    """Whether a path, or the target of a link, is a character device."""
    try:
        return Path(_device_and_rate(text)[0]).is_char_device()
    except (OSError, ValueError):
        return False


def _serial_place(text: str, user_text: str) -> ListeningPlace:
    device, rate = _device_and_rate(text)
    if rate and (not rate.isdigit() or not int(rate)):
        raise InputError(f"{rate!r} is not a baud rate", where=user_text, fix="write it as /dev/ttyUSB0@38400")
    if os.path.lexists(device):
        device = str(Path(device).absolute())  # a link is kept: it outlasts the number of its device
    settings = {"device": device, **({"baud_rate": int(rate)} if rate else {})}
    name = Path(device).name
    return ListeningPlace(f"serial_{name}" if name.isdigit() else name, "serial", settings, user_text)


def _port_place(kind: str, target: str, text: str) -> ListeningPlace:
    address, _, port = target.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 65_536:
        raise InputError(f"{port!r} is not a port", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    if kind != "udp" and not address:
        raise InputError("has no address to connect to", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    settings = {"address": address or "0.0.0.0", "port": int(port), **({"topics": ["#"]} if kind == "mqtt" else {})}
    return ListeningPlace(f"{kind}_{port}", kind, settings, text)


def _places_of_configuration(path: Path) -> list[ListeningPlace]:
    """The places of a configuration's sources, with their names, without what they expect there."""
    sections = parse_toml(read_text(path), path).get("source", [])
    if not isinstance(sections, list) or not sections:
        raise ConfigurationError("has no source", where=str(path), fix="add a [[source]] section")
    return [
        place for section in sections if isinstance(section, dict) and (place := _place_of_section(section, path))
    ]


def _place_of_section(section: dict[str, Any], path: Path) -> ListeningPlace | None:
    kind = str(section.get("type", ""))
    kind = _LINK_TYPES.get(kind, "file" if kind.endswith("file") else kind)
    keys = {
        "can": ("interface", "channel", "options", "dbc"),
        "serial": ("device", "baud_rate", "dbc"),
        "udp": ("address", "port", "dbc"),
        "tcp": ("address", "port", "dbc"),
        "file": ("path", "dbc"),
        "mqtt": ("address", "port", "tls", "ca_file", "client_id", "user", "password_file", "password_variable"),
    }.get(kind)
    if keys is None:
        return None
    settings = {key: section[key] for key in keys if key in section}
    files = ("path", "dbc", "ca_file", "password_file")
    settings |= {key: str(path.absolute().parent / str(settings[key])) for key in files if key in settings}
    settings |= {"topics": ["#"]} if kind == "mqtt" else {}
    if kind in ("udp", "tcp"):
        settings = {"address": "127.0.0.1"} | settings
    name = str(section.get("name", kind))
    return ListeningPlace(name, kind, settings, f"{path.name}: {name}", folder=path.absolute().parent)


def usual_places() -> list[ListeningPlace]:
    """The usual places of instruments on this computer: its CAN interfaces, serial lines and the usual ports."""
    from serial.tools.list_ports import comports

    places = _can_interfaces()
    for port in comports():
        if port.hwid != "n/a":  # a link by the adapter's identity outlasts the device's number
            place = _serial_place(port.device, port.device)
            target = os.path.realpath(place.settings["device"])
            links = (link for link in sorted(_BY_IDENTITY.glob("*")) if os.path.realpath(link) == target)
            places.append(replace(place, settings={"device": str(next(links, place.settings["device"]))}))
    places += [_port_place("udp", f"{address}:{port}", f"udp:{port}") for address, port in _USUAL_UDP]
    places += [_port_place("udp", f"{address}:{port}", f"udp:{address}:{port}") for address, port in _GROUPS]
    places += [_port_place("tcp", f"{address}:{port}", f"tcp:{address}:{port}") for address, port in _USUAL_TCP]
    places.append(_port_place("mqtt", "127.0.0.1:1883", "mqtt:127.0.0.1"))
    return _with_unique_names(replace(place, expected=False) for place in places)


def _can_interfaces() -> list[ListeningPlace]:
    import can

    logging.getLogger("can").setLevel(logging.ERROR)  # without warnings of drivers that are not installed
    configs = []
    for interface in _USUAL_CAN:
        with suppress(Exception):  # drivers raise anything
            configs += can.detect_available_configs(interface)
    return [
        _can_place(config["interface"], str(config["channel"]), f"can:{config['interface']}:{config['channel']}")
        for config in configs
    ]


def _with_unique_names(places: Iterable[ListeningPlace]) -> list[ListeningPlace]:
    """The places with unique names that can be part of a topic."""
    by_name: dict[str, ListeningPlace] = {}
    for place in places:
        base = re.sub(r"[^A-Za-z0-9_-]+", "_", place.name).strip("_") or place.type
        number = 1
        while (name := base if number == 1 else f"{base}_{number}") in by_name:
            number += 1
        by_name[name] = replace(place, name=name)
    return list(by_name.values())


_LATEST = 64  # frames of a message: each signal of a multiplexed one comes in some of them only
_MOST_LATEST_TOPICS, _MOST_FIELDS, _MOST_LEVELS = 1_000, 100, 8  # input from a network is unbounded
_LONGEST_TEXT, _LONGEST_MESSAGE = 40, 65_536
_NUMBER_TEXT = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True)
class LatestReading:
    """The latest value of a signal or topic.

    ``entry`` is its entry in a configuration, ``channel`` the one that it is mapped to, if any; ``value`` is None
    if it is not available, and ``note`` a remark on it, such as the name of a state.
    """

    source: str
    entry: dict[str, str]
    value: float | str | None
    note: str = ""
    channel: str = ""

    @property
    def text(self) -> str:
        """The value with its unit and note, for a user."""
        value = f"{self.value:.6g}" if isinstance(self.value, float) else self.value or ""
        text = f"{value} {self.entry['unit']}".strip() if value else ""
        return f"{text} ({self.note})" if text and self.note else text or self.note

    def as_json(self) -> dict[str, Any]:
        """The reading as an object of JSON."""
        optional = {key: text for key, text in (("note", self.note), ("channel", self.channel)) if text}
        return {"source": self.source, **self.entry, "value": self.value, **optional}


def signal_readings(
    source: str, frames: Iterable[Frame], messages: DbcMessages, channels: Mapping[tuple[str, str], str]
) -> list[LatestReading]:
    """The latest value of each signal on a source; ``channels`` are those mapped, by message and signal."""
    latest: dict[str, tuple[DbcMessage, deque[Frame]]] = {}
    for frame in frames:
        if (message := messages.message_of(frame)) is not None:
            latest.setdefault(message.name, (message, deque(maxlen=_LATEST)))[1].append(frame)
    readings = []
    for message, recent in latest.values():
        values: dict[str, tuple[float | None, str]] = {}
        for frame in recent:
            values |= _decode_signals(message, frame)
        for signal in message.signals:
            if signal.name in values:
                entry = {
                    "message": message.name,
                    "signal": signal.name,
                    "unit": canonical_unit(str(signal.unit or "")),
                }
                channel = channels.get((message.name, signal.name), "")
                readings.append(LatestReading(source, entry, *values[signal.name], channel))
    return readings


def _decode_signals(message: DbcMessage, frame: Frame) -> dict[str, tuple[float | None, str]]:
    """The values of the signals in a frame, with the name of the state or the reason why it has no value."""
    try:
        raw: dict[str, float] = message.decode(frame.payload[: message.length], decode_choices=False, scaling=False)
    except Exception:  # an unknown multiplexer value, and further faults by the library
        return {}
    return {
        signal.name: _scaled_value(raw[signal.name], signal, not frame.flags & FrameFlag.STANDARD_ID)
        for signal in message.signals
        if signal.name in raw
    }


def _scaled_value(raw: float, signal: DbcSignal, is_extended: bool) -> tuple[float | None, str]:
    missing = missing_by_name(raw, signal)
    if missing is None and (is_extended or signal.is_float):
        missing = missing_by_rule(raw, signal)
    value = float("nan") if missing else float(signal.raw_to_scaled(raw, False))
    if not isfinite(value):
        return None, missing or NOT_AVAILABLE
    return value, str((signal.choices or {}).get(int(raw), ""))


class _JsonField(NamedTuple):
    """A value in a message; ``path`` is its field in a JSON object."""

    path: str
    value: float | str
    unit: str = ""


def topic_readings(source: str, frames: Iterable[Frame]) -> list[LatestReading]:
    """The latest value of each topic, or of each field of a JSON object, without topics of sentences."""
    latest: dict[str, tuple[str, str]] = {}
    for frame in frames:
        topic, text = topic_and_message(frame.payload)
        is_retained = bool(frame.flags & FrameFlag.RETAINED)
        is_new = topic not in latest
        if _has_sentence(text[:_LONGEST_MESSAGE]) or (is_new and len(latest) >= _MOST_LATEST_TOPICS):
            continue
        latest[topic] = text, "retained by the broker, of unknown age" if is_retained else ""
    readings = []
    for topic, (text, note) in sorted(latest.items()):
        for path, value, unit in _fields_in(text):
            entry = {"topic": topic, **({"field": path} if path else {}), "unit": unit}
            readings.append(LatestReading(source, entry, value, note))
    return readings


def _fields_in(text: str) -> list[_JsonField]:
    """The values in a message; its text, shortened, if it is neither a number nor a JSON object."""
    if len(text) > _LONGEST_MESSAGE:
        return [_JsonField("", f"{len(text):,} bytes")]
    _, body = split_time(text)
    if body.startswith("{"):
        with suppress(orjson.JSONDecodeError):
            return list(islice(_json_leaves(orjson.loads(body)), _MOST_FIELDS))
        return [_JsonField("", _shortened(body))]
    message = read_message(text, TopicValue(topic="any", unit=""))
    unit = message.unit if is_unit(message.unit) else ""
    number = _finite_number(message.text)
    return [_JsonField("", _shortened(body)) if number is None else _JsonField("", number, unit)]


def _finite_number(value: Any) -> float | None:
    """A finite number, or the text of one, as a float; None for other values."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    number = float(value) if not isinstance(value, str) or _NUMBER_TEXT.fullmatch(value) else float("nan")
    return number if isfinite(number) else None


def _shortened(text: str) -> str:
    printable = "".join(letter if letter.isprintable() else "?" for letter in text.strip())
    return printable if len(printable) <= _LONGEST_TEXT else f"{printable[:_LONGEST_TEXT]}..."


def _json_leaves(content: Mapping[str, Any], path: str = "", level: int = 0) -> Iterator[_JsonField]:
    """The values in nested objects, by their paths."""
    for key, value in content.items():
        inner_path = f"{path}.{key}" if path else key
        if isinstance(value, dict) and level < _MOST_LEVELS:
            yield from _json_leaves(value, inner_path, level + 1)
        else:
            number = _finite_number(value)
            yield _JsonField(inner_path, _shortened(str(value)) if number is None else number)


_NO_FEEDBACK = re.compile(r"(?i)order|command|cmd|demand|setpoint|request|reference|limit|max|min")
_ABBREVIATIONS = {"starboard": ("stbd", "stb"), "tunnel": ("bow",), "propeller": ("prop",)}
_ENOUGH_MESSAGES = 2

SignalNames = dict[str, dict[str, str]]
"""By channel the message, signal and unit, as ``[source.signals]`` has them."""


class DbcMessages:
    """The messages of a DBC file by identifier, those of 29 bits also by parameter group."""

    def __init__(self, database: cantools.db.Database) -> None:
        self.count = len(database.messages)
        self._by_identifier = {
            (message.is_extended_frame, message.frame_id): message for message in database.messages
        }
        self._by_group = {frame_key(message): message for message in database.messages if message.is_extended_frame}

    def message_of(self, frame: Frame) -> DbcMessage | None:
        """The message of a frame, if the frame has all of its bytes."""
        if frame.protocol != "can" or frame.flags & (FrameFlag.REMOTE | FrameFlag.ERROR):
            return None
        is_extended = not frame.flags & FrameFlag.STANDARD_ID
        message = self._by_identifier.get((is_extended, frame.identifier))
        if message is None and is_extended:
            message = self._by_group.get((True, parameter_group(frame.identifier)[0]))
        return message if message is not None and len(frame.payload) >= message.length else None

    def count_in(self, frames: Iterable[Frame]) -> int:
        """How many of the messages are among ``frames``."""
        return len({message.name for frame in frames if (message := self.message_of(frame)) is not None})


class DbcChoice(NamedTuple):
    """The DBC file that describes a bus, if one does, and a remark on the choice for the user."""

    path: Path | None
    remark: str = ""


def choose_dbc(stated: Path | None, folders: Iterable[Path | None], frames: Sequence[Frame]) -> DbcChoice:
    """The DBC file of the bus of ``frames``: the one ``stated``, one in a folder, or one of Seatrial's.

    Raises :class:`ConfigurationError` for an invalid file that is stated.
    """
    if stated is not None:
        messages = DbcMessages(load_dbc(stated))
        count = messages.count_in(frames)
        return DbcChoice(stated if count else None, _describe_coverage(stated, count, messages))
    remarks: list[str] = []
    for folder in dict.fromkeys(directory.absolute() for directory in folders if directory is not None):
        if (path := _find_fitting_dbc(folder, frames, remarks)) is not None:
            return DbcChoice(path, "; ".join(remarks))
    path = None if remarks else vessel_dbc(frames)
    remarks += [] if path is None else [f"{path.name} of Seatrial fits"]
    return DbcChoice(path, "; ".join(remarks))


def _find_fitting_dbc(folder: Path, frames: Sequence[Frame], remarks: list[str]) -> Path | None:
    """The DBC file in a folder that fits frames: two of its messages come, or all of fewer; of several the one with
    most. Remarks on it, or on those not chosen, are appended to ``remarks``."""
    counts: dict[Path, int] = {}
    for path in sorted(folder.glob("*.dbc")):
        try:
            messages = DbcMessages(load_dbc(path))
        except ConfigurationError as error:
            remarks.append(f"{path.name} {error.what}: {error.why}")
            continue
        count = messages.count_in(frames)
        if count >= min(_ENOUGH_MESSAGES, messages.count) > 0:
            counts[path] = count
        if count:
            remarks.append(_describe_coverage(path, count, messages))
    candidates = [path for path, count in counts.items() if count == max(counts.values())]
    if len(candidates) > 1:
        remarks.append("they fit alike: name one with --dbc")
    elif remarks and not candidates:
        remarks.append("if one is of this bus, name it with --dbc")
    return candidates[0] if len(candidates) == 1 else None


def _describe_coverage(path: Path, count: int, messages: DbcMessages) -> str:
    return f"{path.name}: {count or 'none'} of its {messages.count} messages come{'s' * (count < 2)}"


def vessel_dbc(frames: Iterable[Frame]) -> Path | None:
    """The DBC file of Seatrial's vessels that describes the bus, if there is one.

    At least two of its messages come with the same identifiers, and none of its groups with others: proprietary
    groups mean something else on another ship.
    """
    received = {
        frame.identifier for frame in frames if frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE
    }
    for path in sorted(VESSELS.glob("*.dbc")):
        messages = load_dbc(path).messages
        identifiers = {message.frame_id for message in messages}
        groups = {frame_key(message)[1] for message in messages}
        foreign = {identifier for identifier in received - identifiers if parameter_group(identifier)[0] in groups}
        if len(identifiers & received) >= _ENOUGH_MESSAGES and not foreign:
            return path
    return None


def match_signals(path: Path, actuators: Actuators) -> SignalNames:
    """The signals of the control channels by names and units. Raises :class:`ConfigurationError`."""
    database = load_dbc(path)
    controls = [(channel, actuator.name) for actuator in actuators for channel in actuator.channels]
    controls += [] if rudders(actuators) else [(BY_NAME[RUDDER], "rudder")]
    matches = ((channel.name, _find_signal(channel, actuator, database)) for channel, actuator in controls)
    return {name: entry for name, entry in matches if entry is not None}


def _find_signal(channel: Channel, actuator: str, database: cantools.db.Database) -> dict[str, str] | None:
    """The only signal with the name of the actuator and a unit of the channel's quantity; None for several."""
    words = [(word, *_ABBREVIATIONS.get(word, ())) for word in actuator.split("_")]
    candidates = []
    for message in database.messages:
        for signal in message.signals:
            name = f"{message.name} {signal.name}"
            letters = re.sub(r"[^a-z]", "", name.lower())
            is_named = all(any(spelling in letters for spelling in spellings) for spellings in words)
            if not is_named or _NO_FEEDBACK.search(name):
                continue
            try:
                scale_to(channel.unit, str(signal.unit))
            except ConfigurationError:  # a unit of another quantity
                continue
            entry = {"message": message.name, "signal": signal.name, "unit": canonical_unit(str(signal.unit))}
            candidates.append(entry)
    return candidates[0] if len(candidates) == 1 else None
