"""Listening at many places at once, and what the bytes of each place are: lines, gateways' frames, or MAVLink.

Where can be listened: CAN interfaces, serial lines, ports of UDP and TCP, log files, by the words of a user.
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from math import inf
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from pydantic import TypeAdapter

from seatrial.acquisition.config.sources import AnySource
from seatrial.acquisition.config.toml_file import parse_toml, read_text
from seatrial.acquisition.core.errors import (
    ConfigurationError,
    InputError,
    Progress,
    SeatrialError,
    SourceError,
    system_reason,
)
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.protocols.clock import SENTENCE_BEHIND
from seatrial.acquisition.protocols.mavlink import Fault, PacketCutter, header_of, is_known
from seatrial.acquisition.protocols.nmea0183 import has_sentence
from seatrial.acquisition.sources import make_source
from seatrial.acquisition.sources.lines import LineAssembler
from seatrial.acquisition.sources.log_formats import LINE_FORMS, Cutter, LineReader, LogEntry, is_message

BAUD_RATES = (4_800, 38_400, 115_200, 9_600, 57_600, 230_400, 19_200, 460_800)
"""Of serial lines, the usual ones first: NMEA 0183, its fast form, gateways and autopilots."""
LOOK_S = 1.6
"""For so long a line is listened to at each rate: instruments speak once a second."""
_POLL_S = 0.1
_MOST_FRAMES = 500_000  # of one place, some 200 MB: a quarter of an hour of a busy bus
_MOST_BYTES = 100_000_000  # of one place, which a port that is flooded has in seconds
_RAW_TYPES = {"serial": "mavlink_serial", "udp": "mavlink", "tcp": "mavlink_tcp"}
"""The sources that give bytes as they come, for each kind of line."""
_BYTES_A_FRAME = 50  # in a log, roughly
_ENOUGH_LINES = 200
_MOST_TOPICS = 10
_HEAD_FRAMES = 5_000  # of a log, which show what it is


@dataclass
class Heard:
    """What came at a place: its settings as far as they were found out, and its frames.

    ``problem`` is why nothing could be heard there, or nothing be made of what came; empty where all is well.
    """

    place: ListeningPlace
    frames: Callable[[], Iterator[Frame]] = lambda: iter(())
    count: int = 0
    expected: int = 0  # frames, by the size of a log; for the progress only
    problem: str = ""
    remarks: list[str] = field(default_factory=list)


def listen(
    places: Sequence[ListeningPlace],
    duration_s: float,
    stop: threading.Event | None = None,
    progress: Progress = lambda share: None,
) -> list[Heard]:
    """Listen at all places for ``duration_s`` [s], or until ``stop`` is set; logs are looked into."""
    stop, until_s = stop or threading.Event(), time.monotonic() + duration_s
    results: dict[str, Heard] = {}
    live = [place for place in places if place.type != "file"]
    threads = [
        threading.Thread(target=_listen_at, args=(place, until_s, stop, results), daemon=True) for place in live
    ]
    for thread in threads:
        thread.start()
    results |= {place.name: look_into(place) for place in places if place.type == "file"}
    while any(thread.is_alive() for thread in threads):
        progress(min(1.0, 1.0 - (until_s - time.monotonic()) / max(duration_s, 1e-9)))
        time.sleep(_POLL_S)
    return [results[place.name] for place in places]


def section_of(place: ListeningPlace) -> AnySource:
    """The place as a section of a configuration."""
    section = {"name": place.name, "type": place.type, "channels": (), **place.settings}
    source: AnySource = TypeAdapter(AnySource).validate_python(section)
    return source


def look_into(place: ListeningPlace) -> Heard:
    """A log file: what it is, and its frames, read anew each time that they are asked for."""
    path = Path(place.settings["path"])
    try:
        with path.open("rb") as file:
            head = file.read(16)
        if head[:1] == b"\0" and head[8:9] in (b"\xfd", b"\xfe"):
            place = replace(place, type="mavlink_file")
        elif head.startswith(b"SQLite format 3"):
            place = replace(place, type="mqtt_file")
        count = sum(1 for _ in islice(_received(place), _HEAD_FRAMES))
        expected = path.stat().st_size // _BYTES_A_FRAME
        capture = Heard(place, lambda: _received(place), count, expected)
    except SourceError as error:
        return Heard(place, problem=_in_words(error))
    except OSError as error:
        return Heard(place, problem=f"cannot be read: {error.strerror}")
    return _with_system(capture)


def _listen_at(place: ListeningPlace, until_s: float, stop: threading.Event, results: dict[str, Heard]) -> None:
    """One thread's work: it raises nothing."""
    try:
        rated_place = _with_rate(place, until_s, stop) if place.type == "serial" else place
        raw = replace(rated_place, type=_RAW_TYPES.get(rated_place.type, rated_place.type))
        frames, fault = _until_failure(_bounded(_received(raw, until_s, stop)))
        capture = interpret(rated_place, frames)
        capture.problem = capture.problem if frames or not fault else fault
        capture.remarks += [f"{fault}; what came before is here"] if frames and fault else []
    except SeatrialError as error:
        capture = Heard(place, problem=_in_words(error))
    except Exception as error:  # drivers raise what they like
        capture = Heard(place, problem=f"its driver failed: {system_reason(error) or type(error).__name__}")
    results[place.name] = capture


def _until_failure(frames: Iterable[Frame]) -> tuple[list[Frame], str]:
    """The frames that came, and why no more did if the line failed."""
    received: list[Frame] = []
    try:
        received.extend(frames)
    except SeatrialError as error:
        return received, _in_words(error)
    return received, ""


def _in_words(error: SeatrialError) -> str:
    """An error's what and why: where it was stands beside it, and what to do below all."""
    return f"{error.what}: {error.why}" if error.why else error.what


def _received(place: ListeningPlace, until_s: float = inf, stop: threading.Event | None = None) -> Iterator[Frame]:
    """The frames of a place as a source gives them, until the end of a log, a time [s] or a word to stop."""
    source = make_source(section_of(place))
    source.open()
    try:
        while time.monotonic() < until_s and not (stop and stop.is_set()):
            block = source.read(_POLL_S)
            if block is None:
                return
            yield from block
    finally:
        source.close()


def _bounded(frames: Iterator[Frame]) -> Iterator[Frame]:
    """The first frames, as many as there is memory for."""
    size = 0
    for frame in islice(frames, _MOST_FRAMES):
        yield frame
        size += len(frame.payload)
        if size > _MOST_BYTES:
            return


def _with_rate(place: ListeningPlace, until_s: float, stop: threading.Event) -> ListeningPlace:
    """A serial line with its baud rate, found out where it is not given."""
    if "baud_rate" in place.settings:
        return place

    def at(rate: int) -> ListeningPlace:
        return replace(place, settings={**place.settings, "baud_rate": rate})

    def read_at(rate: int) -> bytes:
        raw = replace(at(rate), type="mavlink_serial")
        look_until_s = min(time.monotonic() + LOOK_S, until_s)
        return b"".join(frame.payload for frame in _received(raw, look_until_s, stop))

    return at(find_baud_rate(read_at))


def find_baud_rate(read_at: Callable[[int], bytes], rates: Sequence[int] = BAUD_RATES) -> int:
    """The rate at which what ``read_at`` gives makes the most sense; the first of all where none does.

    Raises :class:`SourceError` where bytes come that make sense at no rate.
    """
    came = False
    for rate in rates:
        received = read_at(rate)
        came = came or bool(received)
        if max(_soundness([received])):
            return rate
    if came:
        fix = "give the rate as /dev/ttyUSB0@RATE; check the polarity of the line"
        raise SourceError(f"bytes come, but make no sense at {', '.join(map(str, sorted(rates)))} baud", fix=fix)
    return rates[0]


def interpret(place: ListeningPlace, received: Sequence[Frame]) -> Heard:
    """What came at a place, as what it is. Bytes of a line that are nothing known are told as a problem."""
    if place.type == "mqtt" and received:
        place = replace(place, settings={**place.settings, "topics": topics_of_sentences(received) or ["#"]})
    if place.type in ("can", "mqtt"):
        return Heard(place, lambda: iter(received), len(received), problem="" if received else _SILENT)
    if not received:
        return Heard(place, problem=_SILENT)
    lines, packets = _soundness([frame.payload for frame in received], is_datagram=place.type == "udp")
    if not lines and not packets:
        beginning = received[0].payload[:24]
        return Heard(place, problem=f"bytes come that are nothing known; they begin with {beginning!r}")
    if packets > lines:
        link = replace(place, type=_RAW_TYPES[place.type])
        return _with_system(Heard(link, lambda: iter(received), len(received)))
    assembler = LineAssembler(place.name)
    frames = [line for frame in received for line in _lines_of(assembler, frame, is_datagram=place.type == "udp")]
    if any(frame.protocol == "can" for frame in frames):
        end = b"\n" if place.type == "udp" else b""
        form = form_of(end.join(frame.payload for frame in received))
        place = replace(place, settings={**place.settings, **({"form": form} if form else {})})
    return Heard(place, lambda: iter(frames), len(frames))


_SILENT = "nothing comes"


def topics_of_sentences(received: Iterable[Frame]) -> list[str]:
    """The MQTT topics on which sentences come, or what many begin with; all, where one cannot be written down."""
    topics = set()
    for frame in received:
        topic, _, text = frame.payload.partition(b"\0")
        if any(SENTENCE_BEHIND.fullmatch(line.strip()) for line in text.decode("latin-1").splitlines()):
            topics.add(topic.decode("utf-8", "replace"))
    if not all(
        name and name.isprintable() and name == name.strip() and not set("+#") & set(name) for name in topics
    ):
        return ["#"]  # what a configuration cannot name
    if len(topics) <= _MOST_TOPICS:
        return sorted(topics)
    first, last = (name.split("/") for name in (min(topics), max(topics)))
    common = [part for part, counterpart in zip(first[:-1], last[:-1], strict=False) if part == counterpart]
    return ["/".join([*common, "#"])]


def _lines_of(assembler: LineAssembler, frame: Frame, *, is_datagram: bool) -> list[Frame]:
    """The lines in some bytes; ``is_datagram`` says that they end where a line does."""
    times = frame.received_ns, frame.monotonic_ns
    return assembler.push(frame.payload, times) + (assembler.end(times) if is_datagram else [])


def _soundness(chunks: Sequence[bytes], *, is_datagram: bool = False) -> tuple[int, int]:
    """How many bytes of what came are of sound lines or gateways' messages, and how many of MAVLink's packets."""
    assembler, cutter, lines, packets = LineAssembler(""), PacketCutter(whole=False), 0, 0
    for chunk in chunks:
        frames = _lines_of(assembler, Frame("", "nmea0183", chunk, 0, 0), is_datagram=is_datagram)
        lines += sum(len(frame.payload) for frame in frames if _is_sound(frame))
        packets += sum(
            len(packet) for packet in cutter.push(chunk) if not isinstance(packet, Fault) and is_known(packet)
        )
    return lines, packets


def _is_sound(frame: Frame) -> bool:
    return frame.protocol == "can" or has_sentence(frame.payload)


def form_of(received: bytes) -> str:
    """The form in which a gateway sends NMEA 2000, by the lines that it has sent; empty where none fits."""
    any_form = LineReader()
    readers = {name: LineReader(name) for name in LINE_FORMS}
    fits: Counter[str] = Counter()
    for piece in Cutter().push(received + b"\n"):
        if is_message(piece):
            fits["actisense"] += 1
        elif _is_frame(any_form.entry(piece)):
            fits.update(name for name, reader in readers.items() if _is_frame(reader.entry(piece)))
        if fits.total() > _ENOUGH_LINES:
            break
    return fits.most_common(1)[0][0] if fits else ""


def _is_frame(entry: LogEntry | None) -> bool:
    return entry is not None and entry.protocol == "can"


def _with_system(capture: Heard) -> Heard:
    """A MAVLink link with the system that tells of the ship: the one most of whose messages are read."""
    if not capture.place.type.startswith("mavlink"):
        return capture
    from seatrial.acquisition.protocols.mavlink import is_read

    cutter, systems = PacketCutter(whole=capture.place.type == "mavlink_file"), Counter[int]()
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
KNOWN_FORMS = (
    "a log file, a configuration (.toml) whose sources are listened to, can0 or can:INTERFACE:CHANNEL,"
    " /dev/ttyUSB0 or /dev/ttyUSB0@38400, any path of a serial line, udp:PORT or udp:ADDRESS:PORT,"
    " tcp:ADDRESS:PORT, mqtt:ADDRESS or mqtt:ADDRESS:PORT"
)


@dataclass(frozen=True)
class ListeningPlace:
    """One place to listen: the kind of transport and the settings of its section in a configuration.

    ``type`` is can, serial, udp, tcp, mqtt or file; ``text`` is what people call it. ``expected`` says that a user
    has named it. ``folder`` is that of the file which names it, or which it is.
    """

    name: str
    type: str
    settings: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    expected: bool = True
    folder: Path | None = None


def parse_places(inputs: Sequence[str]) -> list[ListeningPlace]:
    """The places that a user names, each with a name of its own.

    Raises :class:`InputError` for what is no place, and for logs beside what is live, as their times are not of
    today; :class:`ConfigurationError` for a configuration at fault.
    """
    places = _with_own_names(place for text in inputs for place in _parse(text))
    _refuse_twice(places)
    logs = [place.text for place in places if place.type == "file"]
    if logs and len(logs) < len(places):
        fix = "discover the logs and what is live one after the other"
        raise InputError("is a log, but other places are live", where=", ".join(logs), fix=fix)
    return places


def _refuse_twice(places: Iterable[ListeningPlace]) -> None:
    """Raise :class:`InputError` for a serial line that is named twice, perhaps by a link: only one can read it."""
    lines: dict[str, ListeningPlace] = {}
    for place in places:
        if place.type == "serial":
            device = os.path.realpath(place.settings["device"])
            if device in lines:
                where, fix = f"{lines[device].text}, {place.text}", "name it once"
                raise InputError("are the same serial line", where=where, fix=fix)
            lines[device] = place


def _parse(text: str) -> list[ListeningPlace]:
    kind, _, target = text.partition(":")
    path = Path(text)
    if kind in ("udp", "tcp") and target:
        return [_port(kind, target, text)]
    if kind == "mqtt" and target:
        address, _, port = target.partition(":")
        return [_port("mqtt", f"{address}:{port or 1883}", text)]
    if kind == "can" and target.count(":") >= 1:
        interface, _, channel = target.partition(":")
        return [_can(interface, channel, text)]
    if _CAN_NAME.fullmatch(text) and not path.exists():
        return [_can("socketcan", text, text)]
    if kind == "serial" or _SERIAL_NAME.fullmatch(text) or _is_device(text):
        return [_serial(target if kind == "serial" else text, text)]
    if path.suffix == ".toml" and path.is_file():
        return _of_configuration(path)
    if path.is_file():
        return [
            ListeningPlace(path.stem, "file", {"path": str(path.absolute())}, text, folder=path.absolute().parent)
        ]
    if path.is_symlink():
        why = f"it is a link to {path.readlink()}, and nothing is there"
        raise InputError("is not an input", where=text, why=why, fix="connect the device, or correct the link")
    if os.path.lexists(path):
        kind = "a folder" if path.is_dir() else "a pipe or socket"
        raise InputError("is not an input", where=text, why=f"it is {kind}", fix=f"name {KNOWN_FORMS}")
    raise InputError("is not an input", where=text, fix=f"name {KNOWN_FORMS}")


def _can(interface: str, channel: str, text: str) -> ListeningPlace:
    """``udp_multicast:239.74.163.2?port=43113``: what follows the question mark are the interface's settings."""
    channel, _, query = channel.partition("?")
    options: dict[str, Any] = {key: _number(value) for key, value in parse_qsl(query)}
    settings = {"interface": interface, "channel": channel, **({"options": options} if options else {})}
    return ListeningPlace(channel if channel[:1].isalpha() else "can", "can", settings, text)


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _device_and_rate(text: str) -> tuple[str, str]:
    """The path of a serial line, and the baud rate behind it; a path may have an @ of its own."""
    parts = None if os.path.lexists(text) else _RATE.fullmatch(text)
    return (text, "") if parts is None else (parts["device"], parts["rate"])


def _is_device(text: str) -> bool:
    """Whether a path, or what it links to, is a character device, wherever it lies."""
    try:
        return Path(_device_and_rate(text)[0]).is_char_device()
    except (OSError, ValueError):
        return False


def _serial(text: str, user_text: str) -> ListeningPlace:
    device, rate = _device_and_rate(text)
    if rate and (not rate.isdigit() or not int(rate)):
        raise InputError(f"{rate!r} is not a baud rate", where=user_text, fix="write it as /dev/ttyUSB0@38400")
    if os.path.lexists(device):
        device = str(Path(device).absolute())  # a link is kept: it outlasts the number of its device
    settings = {"device": device, **({"baud_rate": int(rate)} if rate else {})}
    name = Path(device).name
    return ListeningPlace(f"serial_{name}" if name.isdigit() else name, "serial", settings, user_text)


def _port(kind: str, target: str, text: str) -> ListeningPlace:
    address, _, port = target.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 65_536:
        raise InputError(f"{port!r} is not a port", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    if kind != "udp" and not address:
        raise InputError("has no address to connect to", where=text, fix=f"write it as {kind}:ADDRESS:PORT")
    settings = {"address": address or "0.0.0.0", "port": int(port), **({"topics": ["#"]} if kind == "mqtt" else {})}
    return ListeningPlace(f"{kind}_{port}", kind, settings, text)


def _of_configuration(path: Path) -> list[ListeningPlace]:
    """Where the sources of a configuration listen, with their names; what they expect there is not asked."""
    sections = parse_toml(read_text(path), path).get("source", [])
    if not isinstance(sections, list) or not sections:
        raise ConfigurationError("has no source", where=str(path), fix="add a [[source]] section")
    return [place for section in sections if isinstance(section, dict) and (place := _of_section(section, path))]


def _of_section(section: dict[str, Any], path: Path) -> ListeningPlace | None:
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
    """Where instruments are mostly heard on this computer: its CAN interfaces, serial lines and the usual ports."""
    places = [*_can_interfaces(), *_serial_lines()]
    places += [_port("udp", f"{address}:{port}", f"udp:{port}") for address, port in _USUAL_UDP]
    places += [_port("udp", f"{address}:{port}", f"udp:{address}:{port}") for address, port in _GROUPS]
    places += [_port("tcp", f"{address}:{port}", f"tcp:{address}:{port}") for address, port in _USUAL_TCP]
    places.append(_port("mqtt", "127.0.0.1:1883", "mqtt:127.0.0.1"))
    return _with_own_names(replace(place, expected=False) for place in places)


def _can_interfaces() -> list[ListeningPlace]:
    import logging

    import can

    logging.getLogger("can").setLevel(logging.ERROR)  # drivers that are not installed are no news
    configs = []
    for interface in _USUAL_CAN:
        with suppress(Exception):  # drivers raise what they like
            configs += can.detect_available_configs(interface)
    return [
        _can(config["interface"], str(config["channel"]), f"can:{config['interface']}:{config['channel']}")
        for config in configs
    ]


def _serial_lines() -> list[ListeningPlace]:
    from serial.tools.list_ports import comports

    lines = [_serial(port.device, port.device) for port in comports() if port.hwid != "n/a"]
    return [replace(line, settings={"device": _lasting_path(line.settings["device"])}) for line in lines]


def _lasting_path(device: str) -> str:
    """The link to a serial line by its adapter's identity, which outlasts the device's number; else the device."""
    links = (path for path in sorted(_BY_IDENTITY.glob("*")) if os.path.realpath(path) == os.path.realpath(device))
    return str(next(links, device))


def _with_own_names(places: Iterable[ListeningPlace]) -> list[ListeningPlace]:
    """Names that can be part of a topic, none twice."""
    named: dict[str, ListeningPlace] = {}
    for place in places:
        base = re.sub(r"[^A-Za-z0-9_-]+", "_", place.name).strip("_") or place.type
        number = 1
        while (name := base if number == 1 else f"{base}_{number}") in named:
            number += 1
        named[name] = replace(place, name=name)
    return list(named.values())
