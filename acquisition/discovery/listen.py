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
from typing import Any
from urllib.parse import parse_qsl

import cantools
import orjson
from cantools.database.can import Message as DbcMessage
from pydantic import TypeAdapter

from seatrial.acquisition.config.sources import AnySource, TopicValue
from seatrial.acquisition.core import errors, quantities, ship
from seatrial.acquisition.core.files import parse_toml, read_text
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.protocols import can_frames, clock, mavlink, mqtt, nmea0183, nmea2000
from seatrial.acquisition.sources import log_formats, make_source
from seatrial.acquisition.sources.lines import LineAssembler

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
    progress: errors.Progress = lambda fraction: None,
) -> list[Capture]:
    """Listen at all places for ``duration_s`` [s], or until ``stop`` is set; logs are read."""
    stop, until_monotonic_s = stop or threading.Event(), time.monotonic() + duration_s
    results: dict[str, Capture] = {}
    open_places = [place for place in places if place.type != "file"]
    threads = [
        threading.Thread(target=_listen_at, args=(place, until_monotonic_s, stop, results), daemon=True)
        for place in open_places
    ]
    for thread in threads:
        thread.start()
    results |= {place.name: capture_log(place) for place in places if place.type == "file"}
    while any(thread.is_alive() for thread in threads):
        progress(min(1.0, 1.0 - (until_monotonic_s - time.monotonic()) / max(duration_s, 1e-9)))
        time.sleep(_POLL_S)
    return [results[place.name] for place in places]


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
        count = sum(1 for _ in islice(_receive_frames(place), _HEAD_FRAMES))
        expected = path.stat().st_size // _BYTES_A_FRAME
        capture = Capture(place, lambda: _receive_frames(place), count, expected)
    except errors.SourceError as error:
        return Capture(place, problem=_fault_and_reason(error))
    except OSError as error:
        return Capture(place, problem=f"cannot be read: {error.strerror}")
    return _select_mavlink_system(capture) if place.type == "mavlink_file" else capture


def _listen_at(
    place: ListeningPlace, until_monotonic_s: float, stop: threading.Event, results: dict[str, Capture]
) -> None:
    """Put the capture of one place into ``results``, in a thread; raises nothing.

    A serial line's baud rate is detected unless it is given.
    """

    def read_at_rate(baud_rate: int) -> bytes:
        rated_place = replace(place, type="mavlink_serial", settings={**place.settings, "baud_rate": baud_rate})
        probe_until_monotonic_s = min(time.monotonic() + BAUD_PROBE_S, until_monotonic_s)
        return b"".join(frame.payload for frame in _receive_frames(rated_place, probe_until_monotonic_s, stop))

    try:
        rated_place = place
        if place.type == "serial" and "baud_rate" not in place.settings:
            rated_place = replace(place, settings={**place.settings, "baud_rate": find_baud_rate(read_at_rate)})
        raw = replace(rated_place, type=_RAW_TYPES.get(rated_place.type, rated_place.type))
        frames, fault, size = list[Frame](), "", 0
        try:
            for frame in islice(_receive_frames(raw, until_monotonic_s, stop), _MOST_FRAMES):
                frames.append(frame)
                size += len(frame.payload)
                if size > _MOST_BYTES:
                    break
        except errors.SeatrialError as error:
            fault = _fault_and_reason(error)
        capture = interpret_frames(rated_place, frames)
        capture.problem = capture.problem if frames or not fault else fault
        capture.remarks += [f"{fault}; what came before is here"] if frames and fault else []
    except errors.SeatrialError as error:
        capture = Capture(place, problem=_fault_and_reason(error))
    except Exception as error:  # drivers raise anything
        capture = Capture(
            place, problem=f"its driver failed: {errors.system_reason(error) or type(error).__name__}"
        )
    results[place.name] = capture


def _fault_and_reason(error: errors.SeatrialError) -> str:
    """An error's fault and reason: its place is shown beside them, its remedy below."""
    return f"{error.what}: {error.why}" if error.why else error.what


def _receive_frames(
    place: ListeningPlace, until_monotonic_s: float = inf, stop: threading.Event | None = None
) -> Iterator[Frame]:
    """The frames of a place, until the end of a log, a time [s] or ``stop``."""
    section = {"name": place.name, "type": place.type, "channels": (), **place.settings}
    source = make_source(TypeAdapter[AnySource](AnySource).validate_python(section))
    source.open()
    try:
        while time.monotonic() < until_monotonic_s and not (stop and stop.is_set()):
            block = source.read(_POLL_S)
            if block is None:
                return
            yield from block
    finally:
        source.close()


def find_baud_rate(read_at: Callable[[int], bytes]) -> int:
    """The first rate at which the bytes of ``read_at`` hold valid messages; the first of all if no bytes come.

    Raises :class:`SourceError` if bytes come that are valid at no rate.
    """
    has_bytes = False
    for baud_rate in BAUD_RATES:
        received = read_at(baud_rate)
        has_bytes = has_bytes or bool(received)
        if max(_count_valid_bytes([received])):
            return baud_rate
    if has_bytes:
        fix = "give the rate as /dev/ttyUSB0@RATE; check the polarity of the line"
        raise errors.SourceError(
            f"bytes come, but make no sense at {', '.join(map(str, sorted(BAUD_RATES)))} baud", fix=fix
        )
    return BAUD_RATES[0]


def interpret_frames(place: ListeningPlace, received: Sequence[Frame]) -> Capture:
    """The capture of what came at a place, decoded as what it is. Unknown bytes are a problem."""
    is_datagram = place.type == "udp"
    if not received:
        return Capture(place, problem="nothing comes")
    if place.type == "mqtt":
        place = replace(place, settings={**place.settings, "topics": _sentence_topics(received)})
    if place.type in ("can", "mqtt"):
        return Capture(place, lambda: iter(received), len(received))
    lines, packets = _count_valid_bytes([frame.payload for frame in received], is_datagram=is_datagram)
    if not lines and not packets:
        beginning = received[0].payload[:24]
        return Capture(place, problem=f"bytes come that are nothing known; they begin with {beginning!r}")
    if packets > lines:
        link = replace(place, type=_RAW_TYPES[place.type])
        return _select_mavlink_system(Capture(link, lambda: iter(received), len(received)))
    assembler = LineAssembler(place.name)
    frames = [line for frame in received for line in _split_lines(assembler, frame, is_datagram=is_datagram)]
    if any(frame.protocol == "can" for frame in frames):
        form = detect_gateway_format((b"\n" if is_datagram else b"").join(frame.payload for frame in received))
        place = replace(place, settings={**place.settings, **({"form": form} if form else {})})
    return Capture(place, lambda: iter(frames), len(frames))


def _sentence_topics(received: Iterable[Frame]) -> list[str]:
    """The MQTT topics of sentences, or the common beginning of many; all, if a configuration cannot name one."""
    topics = set()
    for frame in received:
        topic, _, text = frame.payload.partition(b"\0")
        if _contains_sentence(text.decode("latin-1")):
            topics.add(topic.decode("utf-8", "replace"))
    is_valid = (
        topic and topic.isprintable() and topic == topic.strip() and not set("+#") & set(topic) for topic in topics
    )
    if not topics or not all(is_valid):
        return ["#"]
    if len(topics) <= _MOST_TOPICS:
        return sorted(topics)
    first, last = (topic.split("/") for topic in (min(topics), max(topics)))
    common = [part for part, counterpart in zip(first[:-1], last[:-1], strict=False) if part == counterpart]
    return ["/".join([*common, "#"])]


def _contains_sentence(text: str) -> bool:
    return any(clock.SENTENCE_WITH_PREFIX.fullmatch(line.strip()) for line in text.splitlines())


def _split_lines(assembler: LineAssembler, frame: Frame, *, is_datagram: bool) -> list[Frame]:
    """The lines in a frame's bytes; those of a datagram end with a line."""
    times = frame.received_ns, frame.monotonic_ns
    return assembler.push(frame.payload, times) + (assembler.end(times) if is_datagram else [])


def _count_valid_bytes(chunks: Sequence[bytes], *, is_datagram: bool = False) -> tuple[int, int]:
    """How many bytes are of valid lines or gateways' messages, and how many of MAVLink packets."""
    assembler, cutter, lines, packets = LineAssembler(""), mavlink.PacketCutter(complete=False), 0, 0
    for chunk in chunks:
        frames = _split_lines(assembler, Frame("", "nmea0183", chunk, 0, 0), is_datagram=is_datagram)
        valid = [
            frame.payload for frame in frames if frame.protocol == "can" or nmea0183.has_sentence(frame.payload)
        ]
        lines += sum(map(len, valid))
        packets += sum(
            len(packet)
            for packet in cutter.push(chunk)
            if not isinstance(packet, mavlink.Fault)
            and mavlink.parse_header(packet).message_id in mavlink.CRC_EXTRA
        )
    return lines, packets


def detect_gateway_format(received: bytes) -> str:
    """The form in which a gateway sends NMEA 2000, by its lines; empty if none fits."""
    any_form = log_formats.LineReader()
    readers = {name: log_formats.LineReader(name) for name in log_formats.LINE_FORMS}
    fits: Counter[str] = Counter()
    for message in log_formats.StreamCutter().push(received + b"\n"):
        if log_formats.is_message(message):
            fits["actisense"] += 1
        elif _is_can_entry(any_form.entry(message)):
            fits.update(name for name, reader in readers.items() if _is_can_entry(reader.entry(message)))
        if fits.total() > _ENOUGH_LINES:
            break
    return fits.most_common(1)[0][0] if fits else ""


def _is_can_entry(entry: log_formats.LogEntry | None) -> bool:
    return entry is not None and entry.protocol == "can"


def _select_mavlink_system(capture: Capture) -> Capture:
    """A MAVLink link with the system of the ship: the one with most messages that are read."""
    cutter, systems = mavlink.PacketCutter(complete=capture.place.type == "mavlink_file"), Counter[int]()
    for frame in islice(capture.frames(), _HEAD_FRAMES):
        headers = [
            mavlink.parse_header(packet)
            for packet in cutter.push(frame.payload)
            if not isinstance(packet, mavlink.Fault)
        ]
        systems.update(
            header.system_id
            for header in headers
            if header.message_id in mavlink.MESSAGE_NAMES and 0 < header.system_id < 256
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
_PLACE_KEYS = {
    "can": ("interface", "channel", "options", "dbc"),
    "serial": ("device", "baud_rate", "dbc"),
    "udp": ("address", "port", "dbc"),
    "tcp": ("address", "port", "dbc"),
    "file": ("path", "dbc"),
    "mqtt": ("address", "port", "tls", "ca_file", "client_id", "user", "password_file", "password_variable"),
}
"""What a place keeps of a source's section, by the kind of transport."""
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

    Raises :class:`InputError` for what is no place, for a serial line that is named twice, perhaps by a link, as
    only one can read it, and for logs together with live places, whose times differ;
    :class:`ConfigurationError` for an invalid configuration.
    """
    places = _make_names_unique(place for text in inputs for place in _places_of_text(text))
    serial_places: dict[str, ListeningPlace] = {}
    for place in places:
        if place.type == "serial":
            first = serial_places.setdefault(os.path.realpath(place.settings["device"]), place)
            if first is not place:
                where, fix = f"{first.text}, {place.text}", "name it once"
                raise errors.InputError("are the same serial line", where=where, fix=fix)
    logs = [place.text for place in places if place.type == "file"]
    if logs and len(logs) < len(places):
        fix = "discover the logs and what is live one after the other"
        raise errors.InputError("is a log, but other places are live", where=", ".join(logs), fix=fix)
    return places


def _places_of_text(text: str) -> list[ListeningPlace]:
    kind, _, target = text.partition(":")
    path = Path(text)
    if kind in ("udp", "tcp") and target:
        return [_make_port_place(kind, target, text)]
    if kind == "mqtt" and target:
        address, _, port = target.partition(":")
        return [_make_port_place("mqtt", f"{address}:{port or 1883}", text)]
    if kind == "can" and target.count(":") >= 1:
        interface, _, channel = target.partition(":")
        return [_parse_can_place(interface, channel, text)]
    if _CAN_NAME.fullmatch(text) and not path.exists():
        return [_parse_can_place("socketcan", text, text)]
    try:
        is_device = Path(_split_device_and_baud_rate(text)[0]).is_char_device()  # or a link to one
    except (OSError, ValueError):
        is_device = False
    if kind == "serial" or _SERIAL_NAME.fullmatch(text) or is_device:
        return [_make_serial_place(target if kind == "serial" else text, text)]
    if path.suffix == ".toml" and path.is_file():
        return _places_of_configuration(path)
    if path.is_file():
        absolute = path.absolute()
        return [ListeningPlace(path.stem, "file", {"path": str(absolute)}, text, folder=absolute.parent)]
    if path.is_symlink():
        why = f"it is a link to {path.readlink()}, and nothing is there"
        raise errors.InputError(
            "is not an input", where=text, why=why, fix="connect the device, or correct the link"
        )
    why = "" if not os.path.lexists(path) else f"it is {'a folder' if path.is_dir() else 'a pipe or socket'}"
    raise errors.InputError("is not an input", where=text, why=why, fix=f"name {INPUT_FORMS}")


def _parse_can_place(interface: str, channel: str, text: str) -> ListeningPlace:
    """``udp_multicast:239.74.163.2?port=43113``: the interface's settings follow the question mark."""
    channel, _, query = channel.partition("?")
    options: dict[str, Any] = dict(parse_qsl(query))
    for key, value in options.items():
        for kind in (float, int):
            with suppress(ValueError):
                options[key] = kind(value)
    settings = {"interface": interface, "channel": channel, **({"options": options} if options else {})}
    return ListeningPlace(channel if channel[:1].isalpha() else "can", "can", settings, text)


def _split_device_and_baud_rate(text: str) -> tuple[str, str]:
    """The path of a serial line, and the baud rate behind it; a path may contain an @, too."""
    parts = None if os.path.lexists(text) else _RATE.fullmatch(text)
    return (text, "") if parts is None else (parts["device"], parts["rate"])


def _make_serial_place(text: str, user_text: str) -> ListeningPlace:
    device, baud_rate = _split_device_and_baud_rate(text)
    if baud_rate and (not baud_rate.isdigit() or not int(baud_rate)):
        raise errors.InputError(
            f"{baud_rate!r} is not a baud rate", where=user_text, fix="write it as /dev/ttyUSB0@38400"
        )
    if os.path.lexists(device):
        device = str(Path(device).absolute())  # a link is kept: it outlasts the number of its device
    settings = {"device": device, **({"baud_rate": int(baud_rate)} if baud_rate else {})}
    name = Path(device).name
    return ListeningPlace(f"serial_{name}" if name.isdigit() else name, "serial", settings, user_text)


def _make_port_place(kind: str, target: str, text: str) -> ListeningPlace:
    address, _, port = target.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 65_536:
        raise errors.InputError(f"{port!r} is not a port", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    if kind != "udp" and not address:
        raise errors.InputError("has no address to connect to", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    settings = {"address": address or "0.0.0.0", "port": int(port), **({"topics": ["#"]} if kind == "mqtt" else {})}
    return ListeningPlace(f"{kind}_{port}", kind, settings, text)


def _places_of_configuration(path: Path) -> list[ListeningPlace]:
    """The places of a configuration's sources, with their names, without what they expect there."""
    sections = parse_toml(read_text(path), path).get("source", [])
    if not isinstance(sections, list) or not sections:
        raise errors.ConfigurationError("has no source", where=str(path), fix="add a [[source]] section")
    folder, places = path.absolute().parent, []
    for section in sections:
        kind = str(section.get("type", "")) if isinstance(section, dict) else ""
        kind = _LINK_TYPES.get(kind, "file" if kind.endswith("file") else kind)
        if kind not in _PLACE_KEYS:
            continue
        settings = {key: section[key] for key in _PLACE_KEYS[kind] if key in section}
        files = ("path", "dbc", "ca_file", "password_file")
        settings |= {key: str(folder / str(settings[key])) for key in files if key in settings}
        settings |= {"topics": ["#"]} if kind == "mqtt" else {}
        if kind in ("udp", "tcp"):
            settings = {"address": "127.0.0.1"} | settings
        name = str(section.get("name", kind))
        places.append(ListeningPlace(name, kind, settings, f"{path.name}: {name}", folder=folder))
    return places


def usual_places() -> list[ListeningPlace]:
    """The usual places of instruments on this computer: its CAN interfaces, serial lines and the usual ports."""
    import can
    from serial.tools.list_ports import comports

    logging.getLogger("can").setLevel(logging.ERROR)  # without warnings of drivers that are not installed
    configs: list[dict[str, Any]] = []
    for interface in _USUAL_CAN:
        with suppress(Exception):  # drivers raise anything
            configs += can.detect_available_configs(interface)
    buses = [(config["interface"], str(config["channel"])) for config in configs]
    places = [_parse_can_place(interface, channel, f"can:{interface}:{channel}") for interface, channel in buses]
    for port in comports():
        if port.hwid != "n/a":  # a link by the adapter's identity outlasts the device's number
            place = _make_serial_place(port.device, port.device)
            target = os.path.realpath(place.settings["device"])
            links = (link for link in sorted(_BY_IDENTITY.glob("*")) if os.path.realpath(link) == target)
            places.append(replace(place, settings={"device": str(next(links, place.settings["device"]))}))
    places += [_make_port_place("udp", f"{address}:{port}", f"udp:{port}") for address, port in _USUAL_UDP]
    places += [_make_port_place("udp", f"{address}:{port}", f"udp:{address}:{port}") for address, port in _GROUPS]
    places += [
        _make_port_place("tcp", f"{address}:{port}", f"tcp:{address}:{port}") for address, port in _USUAL_TCP
    ]
    places.append(_make_port_place("mqtt", "127.0.0.1:1883", "mqtt:127.0.0.1"))
    return _make_names_unique(replace(place, expected=False) for place in places)


def _make_names_unique(places: Iterable[ListeningPlace]) -> list[ListeningPlace]:
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


def latest_signal_readings(
    source: str, frames: Iterable[Frame], messages: DbcMessages, channels: Mapping[tuple[str, str], str]
) -> list[LatestReading]:
    """The latest value of each signal on a source, with the name of the state or the reason why it has no value.

    ``channels`` are those mapped, by message and signal.
    """
    latest: dict[str, tuple[DbcMessage, deque[Frame]]] = {}
    for frame in frames:
        if (message := messages.message_of_frame(frame)) is not None:
            latest.setdefault(message.name, (message, deque(maxlen=_LATEST)))[1].append(frame)
    readings = []
    for message, recent in latest.values():
        raw: dict[str, float] = {}
        for frame in recent:
            raw |= can_frames.raw_signal_values(message, frame.payload) or {}
        for signal in message.signals:
            if signal.name in raw:
                number = raw[signal.name]
                missing = can_frames.why_signal_is_missing(number, signal, by_rule=message.is_extended_frame)
                value = None if missing else float(signal.raw_to_scaled(number, False))
                if value is None or not isfinite(value):
                    value, note = None, missing or nmea2000.NOT_AVAILABLE
                else:
                    note = str((signal.choices or {}).get(int(number), ""))
                unit = quantities.canonical_unit(str(signal.unit or ""))
                entry = {"message": message.name, "signal": signal.name, "unit": unit}
                channel = channels.get((message.name, signal.name), "")
                readings.append(LatestReading(source, entry, value, note, channel))
    return readings


def latest_topic_readings(source: str, frames: Iterable[Frame]) -> list[LatestReading]:
    """The latest value of each topic, or of each field of a JSON object, without topics of sentences.

    A message that is neither a number nor a JSON object is given as text, shortened.
    """
    latest: dict[str, tuple[str, str]] = {}
    for frame in frames:
        topic, text = mqtt.split_topic_and_message(frame.payload)
        is_new = topic not in latest
        if _contains_sentence(text[:_LONGEST_MESSAGE]) or (is_new and len(latest) >= _MOST_LATEST_TOPICS):
            continue
        is_retained = bool(frame.flags & FrameFlag.RETAINED)
        latest[topic] = text, "retained by the broker, of unknown age" if is_retained else ""
    readings = []
    for topic, (text, note) in sorted(latest.items()):
        _, body = mqtt.split_leading_time(text[:_LONGEST_MESSAGE])
        fields: list[tuple[str, float | str]] = [("", _shorten_text(body))]
        unit = ""
        if len(text) > _LONGEST_MESSAGE:
            fields = [("", f"{len(text):,} bytes")]
        elif body.startswith("{"):
            with suppress(orjson.JSONDecodeError):
                fields = list(islice(_json_leaves(orjson.loads(body)), _MOST_FIELDS))
        else:
            message = mqtt.read_topic_value(text, TopicValue(topic="any", unit=""))
            number = _finite_number(message.text)
            if number is not None:
                fields, unit = [("", number)], message.unit if quantities.is_unit(message.unit) else ""
        for path, value in fields:
            entry = {"topic": topic, **({"field": path} if path else {}), "unit": unit}
            readings.append(LatestReading(source, entry, value, note))
    return readings


def _finite_number(value: Any) -> float | None:
    """A finite number, or the text of one, as a float; None for other values."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    number = float(value) if not isinstance(value, str) or _NUMBER_TEXT.fullmatch(value) else float("nan")
    return number if isfinite(number) else None


def replace_control_characters(text: str) -> str:
    """A text with a question mark for what cannot be printed."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _shorten_text(text: str) -> str:
    printable = replace_control_characters(text.strip())
    return printable if len(printable) <= _LONGEST_TEXT else f"{printable[:_LONGEST_TEXT]}..."


def _json_leaves(content: Mapping[str, Any], path: str = "", level: int = 0) -> Iterator[tuple[str, float | str]]:
    """The values in nested objects, by their paths."""
    for key, value in content.items():
        inner_path = f"{path}.{key}" if path else key
        if isinstance(value, dict) and level < _MOST_LEVELS:
            yield from _json_leaves(value, inner_path, level + 1)
        else:
            number = _finite_number(value)
            yield inner_path, _shorten_text(str(value)) if number is None else number


_NO_FEEDBACK = re.compile(r"(?i)order|command|cmd|demand|setpoint|request|reference|limit|max|min")
_ABBREVIATIONS = {"starboard": ("stbd", "stb"), "tunnel": ("bow",), "propeller": ("prop",)}
_ENOUGH_MESSAGES = 2


class DbcMessages:
    """The messages of a DBC file by identifier, those of 29 bits also by parameter group."""

    def __init__(self, database: cantools.db.Database) -> None:
        self.count = len(database.messages)
        self._by_identifier = {
            (message.is_extended_frame, message.frame_id): message for message in database.messages
        }
        self._by_group = {
            can_frames.message_key(message): message for message in database.messages if message.is_extended_frame
        }

    def message_of_frame(self, frame: Frame) -> DbcMessage | None:
        """The message of a frame, if the frame has all of its bytes."""
        if frame.protocol != "can" or frame.flags & (FrameFlag.REMOTE | FrameFlag.ERROR):
            return None
        is_extended = not frame.flags & FrameFlag.STANDARD_ID
        message = self._by_identifier.get((is_extended, frame.identifier))
        if message is None and is_extended:
            message = self._by_group.get((True, nmea2000.split_can_identifier(frame.identifier)[0]))
        return message if message is not None and len(frame.payload) >= message.length else None

    def count_known_frames(self, frames: Iterable[Frame]) -> int:
        """How many of the messages are among ``frames``."""
        return len({message.name for frame in frames if (message := self.message_of_frame(frame)) is not None})


def choose_dbc(
    stated: Path | None, folders: Iterable[Path | None], frames: Sequence[Frame]
) -> tuple[Path | None, str]:
    """The DBC file of the bus of ``frames``, and a remark on the choice.

    The one ``stated``, one in a folder, or one of Seatrial's. One in a folder fits if two of its messages come, or
    all of fewer; of several the one with most. Raises :class:`ConfigurationError` for an invalid ``stated`` file.
    """
    if stated is not None:
        messages = DbcMessages(can_frames.load_dbc(stated))
        count = messages.count_known_frames(frames)
        return stated if count else None, _describe_coverage(stated, count, messages)
    remarks: list[str] = []
    for folder in dict.fromkeys(directory.absolute() for directory in folders if directory is not None):
        counts: dict[Path, int] = {}
        for path in sorted(folder.glob("*.dbc")):
            try:
                messages = DbcMessages(can_frames.load_dbc(path))
            except errors.ConfigurationError as error:
                remarks.append(f"{path.name} {error.what}: {error.why}")
                continue
            count = messages.count_known_frames(frames)
            if count >= min(_ENOUGH_MESSAGES, messages.count) > 0:
                counts[path] = count
            if count:
                remarks.append(_describe_coverage(path, count, messages))
        candidates = [path for path, count in counts.items() if count == max(counts.values())]
        if len(candidates) == 1:
            return candidates[0], "; ".join(remarks)
        if candidates:
            remarks.append("they fit alike: name one with --dbc")
        elif remarks:
            remarks.append("if one is of this bus, name it with --dbc")
    vessel_path = None if remarks else find_vessel_dbc(frames)
    return vessel_path, "; ".join(remarks) if vessel_path is None else f"{vessel_path.name} of Seatrial fits"


def _describe_coverage(path: Path, count: int, messages: DbcMessages) -> str:
    return f"{path.name}: {count or 'none'} of its {messages.count} messages come{'s' * (count < 2)}"


def find_vessel_dbc(frames: Iterable[Frame]) -> Path | None:
    """The DBC file of Seatrial's vessels that describes the bus, if there is one.

    At least two of its messages come with the same identifiers, and none of its groups with others: proprietary
    groups mean something else on another ship.
    """
    received = {
        frame.identifier for frame in frames if frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE
    }
    for path in sorted(ship.VESSELS.glob("*.dbc")):
        messages = can_frames.load_dbc(path).messages
        identifiers = {message.frame_id for message in messages}
        groups = {can_frames.message_key(message)[1] for message in messages}
        foreign = {
            identifier
            for identifier in received - identifiers
            if nmea2000.split_can_identifier(identifier)[0] in groups
        }
        if len(identifiers & received) >= _ENOUGH_MESSAGES and not foreign:
            return path
    return None


def match_signals(path: Path, actuators: ship.Actuators) -> dict[str, dict[str, str]]:
    """The signals of the control channels: by channel message, signal and unit, as in ``[source.signals]``.

    A channel's is the only one with the name of the actuator and a unit of the channel's quantity. Raises
    :class:`ConfigurationError`.
    """
    database = can_frames.load_dbc(path)
    controls = [(channel, actuator.name) for actuator in actuators for channel in actuator.channels]
    controls += [] if ship.rudder_names(actuators) else [(ship.BY_NAME[ship.RUDDER], "rudder")]
    signals = [(message, signal) for message in database.messages for signal in message.signals]
    matches = {}
    for channel, actuator_name in controls:
        words = [(word, *_ABBREVIATIONS.get(word, ())) for word in actuator_name.split("_")]
        candidates = []
        for message, signal in signals:
            name = f"{message.name} {signal.name}"
            letters = re.sub(r"[^a-z]", "", name.lower())
            is_named = all(any(spelling in letters for spelling in spellings) for spellings in words)
            if is_named and not _NO_FEEDBACK.search(name):
                with suppress(errors.ConfigurationError):  # for a unit of another quantity
                    quantities.unit_scale(channel.unit, str(signal.unit))
                    unit = quantities.canonical_unit(str(signal.unit))
                    candidates.append({"message": message.name, "signal": signal.name, "unit": unit})
        if len(candidates) == 1:
            matches[channel.name] = candidates[0]
    return matches
