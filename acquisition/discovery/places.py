"""Where can be listened: CAN interfaces, serial lines, ports of UDP and TCP, log files, by the words of a user."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from seatrial.acquisition.config.toml_file import parse_toml, read_text
from seatrial.acquisition.core.errors import ConfigurationError, InputError

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
