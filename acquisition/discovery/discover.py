"""Discovers what instruments send where, and writes a configuration that records it: ``seatrial discover``.

The result is a :class:`Discovery`, as tables for a terminal, as JSON, and as the text of a configuration with a
comment wherever something is missing.
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from operator import attrgetter
from pathlib import Path
from textwrap import wrap
from typing import Any

from rich.console import RenderableType

from seatrial.acquisition.config import declarations, trial_file
from seatrial.acquisition.config.sources import CanFrames, MqttLinks
from seatrial.acquisition.core import errors, files, result
from seatrial.acquisition.core.ship import MOTION, channel_names, channel_unit
from seatrial.acquisition.core.trial import Frame, split_source_label
from seatrial.acquisition.discovery import listen
from seatrial.acquisition.logger import survey as surveys
from seatrial.acquisition.protocols import can_frames, nmea2000

_PROGRESS_FRAMES = 5_000  # between reports of progress
_MOST_EVENTS = 12
_MOST_VALUES = 4  # of a message, in its row
_WIDTH = 112  # letters of a line
_HEAD_FRAMES = 20_000  # by which engines and DBC files are detected
_ENGINE_GROUPS = frozenset({127488, 127493})  # groups of one frame whose first byte is the engine's instance
_J1939_ENGINE_GROUP = 61444
_MOST_ENGINES = 8
_ENGINE_NAMES = {1: ["main"], 2: ["port", "starboard"], 3: ["port", "centre", "starboard"]}


@dataclass(frozen=True)
class Discovery:
    """What was received where, and a configuration that records it.

    ``configuration`` is empty, and ``survey`` None, if nothing was received; ``missing`` gives the reasons by
    channel. ``readings`` are the values of signals and topics that a configuration has to map.
    """

    captures: list[listen.Capture]
    survey: surveys.Survey | None = None
    missing: dict[str, str] = field(default_factory=dict)
    configuration: str = ""
    readings: list[listen.LatestReading] = field(default_factory=list)

    @property
    def channels(self) -> dict[str, list[str]]:
        """The channels that the configuration records, with their sources."""
        return {} if self.survey is None else self.survey.channels

    def as_json(self) -> dict[str, Any]:
        """The discovery as an object of JSON."""
        places = [
            {
                "place": capture.place.text or capture.place.name,
                "source": capture.place.name,
                "type": capture.place.type,
                **capture.place.settings,
                "frames": capture.count,
                **({"problem": capture.problem} if capture.problem else {}),
                **({"remarks": capture.remarks} if capture.remarks else {}),
            }
            for capture in self.captures
        ]
        content = {
            "places": places,
            "devices": [],
            "messages": [],
            "values": [reading.as_json() for reading in self.readings],
            "channels": {},
            "missing": self.missing,
            "events": [],
            "configuration": self.configuration,
        }
        return content if self.survey is None else content | _survey_json(self.survey)


def _survey_json(survey: surveys.Survey) -> dict[str, Any]:
    """Devices, messages and channels, sources in their order, devices by address."""
    span_s = max((survey.last_ns - survey.first_ns) / 1e9, 1e-9)

    def sort_key(kind: surveys.TrafficKind) -> tuple[Any, ...]:
        number = (0, int(kind.device)) if kind.device.isdigit() else (1, 0)
        return kind.source, number, kind.device, kind.name

    messages = []
    for kind in sorted(survey.kinds, key=sort_key):
        tally = survey.kinds[kind]
        messages.append(
            {
                "source": kind.source,
                "device": kind.device,
                "message": kind.name,
                "name": surveys.parameter_group_name(int(kind.name)) if kind.name.isdigit() else "",
                "count": tally.count,
                "rate_hz": tally.rate_hz,
                "values": tally.values,
                "refused": dict(tally.refused),
            }
        )
    channels = {}
    for name, sources in survey.channels.items():
        health = survey.health.channels[name]
        rate_hz = health.count / span_s
        channels[name] = {"count": health.count, "rate_hz": rate_hz, "value": health.value, "sources": sources}
    devices = [
        {"source": source, "address": int(address), **survey.devices[source, address]}
        for source, address in sorted(survey.devices, key=lambda device: (device[0], int(device[1])))
    ]
    return {"devices": devices, "messages": messages, "channels": channels, "events": survey.events}


def discover(
    places: Sequence[listen.ListeningPlace],
    duration_s: float = 20.0,
    name: str = "discovered",
    vessel: str = "",
    dbc: Path | None = None,
    folder: Path | None = None,
    stop: threading.Event | None = None,
    progress: errors.Progress = lambda fraction: None,
) -> Discovery:
    """Listen at all places for ``duration_s`` [s], and propose a configuration named ``name``.

    ``vessel`` is the ship's name or file, whose actuators the channels belong to; without it no control is missing.
    ``dbc`` describes the ship's CAN frames, else one next to the configuration that fits them; ``folder`` is that
    of the configuration. Raises :class:`ConfigurationError` for an invalid vessel or DBC file. Places that cannot
    be listened to are reported in the result, and are no error.
    """
    if dbc is not None:
        can_frames.load_dbc(dbc)
    folder = folder or Path()
    if (
        vessel and declarations.vessel_file_of_ship(vessel, folder) is None
    ):  # a configuration there would not find it
        fix = f"copy it to {folder.absolute()}"
        raise errors.ConfigurationError("lies elsewhere", where=str(declarations.find_vessel(vessel)), fix=fix)
    captures = listen.listen(places, duration_s, stop, errors.subtask_progress(progress, 0, 2))
    return interpret_captures(captures, name, vessel, dbc, folder, stop, errors.subtask_progress(progress, 1, 2))


def interpret_captures(
    captures: list[listen.Capture],
    name: str = "discovered",
    vessel: str = "",
    dbc: Path | None = None,
    folder: Path | None = None,
    stop: threading.Event | None = None,
    progress: errors.Progress = lambda fraction: None,
) -> Discovery:
    """The discovery by captures; arguments as those of :func:`discover`."""
    received = [capture for capture in captures if capture.count and not capture.problem]
    if not received:
        return Discovery(captures)
    config = configure_all_channels(received, vessel, dbc, (folder or Path()) / f"{name}.toml")
    if not any(capture.expected for capture in received):
        stop = None  # live captures are short: they are read to their end
    expected = sum(capture.expected or capture.count for capture in received)
    in_order = heapq.merge(*(capture.frames() for capture in received), key=attrgetter("received_ns"))
    survey = surveys.survey_frames(config, _report_progress(in_order, expected, stop, progress))
    for capture in received:
        capture.count = survey.health.sources[capture.place.name].frames
    reasons = missing = surveys.missing_channels(survey)
    sections = {section.name: section for section in survey.config.sources}
    readings: list[
        listen.LatestReading
    ] = []  # of the signals of each source's DBC file, and the topics of each broker
    for capture in received:
        source = sections[capture.place.name]
        if isinstance(source, MqttLinks):
            readings += listen.latest_topic_readings(source.name, capture.frames())
        elif isinstance(source, CanFrames) and source.dbc is not None:
            provided = survey.channels_provided_by(source.name)
            mapped = {
                (signal.message, signal.signal): name for name, signal in source.signals.items() if name in provided
            }
            readings += listen.latest_signal_readings(
                source.name, capture.frames(), listen.DbcMessages(can_frames.load_dbc(source.dbc)), mapped
            )
    if not survey.config.ship_is_known:  # then no control is missing, but what comes may be of one
        missing = {name: reason for name, reason in reasons.items() if name in MOTION}
        controls = {
            name: surveys.why_channel_is_not_provided(name, survey)
            for name in sorted(reasons.keys() - missing.keys())
        }
        for capture in received:
            source_name = capture.place.name
            remarks = [
                text
                for name, text in controls.items()
                if text and source_name in surveys.sources_of_channel(name, survey)
            ]
            capture.remarks += dict.fromkeys(remarks)
    text = configuration_as_toml(received, survey, reasons, missing, readings, name, vessel)
    return Discovery(captures, survey, missing, text, readings)


def _report_progress(
    frames: Iterator[Frame], expected: int, stop: threading.Event | None, progress: errors.Progress
) -> Iterator[Frame]:
    """The frames, with reports of progress, until their end or ``stop``."""
    for number, frame in enumerate(frames):
        if number % _PROGRESS_FRAMES == 0:
            progress(min(number / max(expected, 1), 1.0))
            if number and stop is not None and stop.is_set():
                return
        yield frame


def discovery_tables(discovery: Discovery) -> Iterator[RenderableType]:
    """Tables of places, devices, messages, channels and missing channels, without empty ones."""
    content = discovery.as_json()
    keys = ("manufacturer", "model", "function", "iso_name")
    places = []
    for place in content["places"]:
        rate = f"{place['baud_rate']} baud" if "baud_rate" in place else ""
        remarks = filter(None, (rate, place.get("form"), place.get("problem"), *place.get("remarks", [])))
        places.append((place["place"], place["source"], f"{place['frames']:,}", "; ".join(remarks)))
    devices = [
        (device["source"], str(device["address"]), *(str(device.get(key, "")) for key in keys))
        for device in content["devices"]
    ]
    messages = []
    for message in content["messages"]:
        latest = [f"{name} {value:.6g}" for name, value in list(message["values"].items())[:_MOST_VALUES]]
        messages.append(
            (message["source"], message["device"], f"{message['message']} {message['name']}".strip(),
             f"{message['rate_hz']:.2f}" if message["rate_hz"] else f"{message['count']} x",
             ", ".join(latest) + (" ..." if len(message["values"]) > _MOST_VALUES else ""),
             ", ".join(f"{reason} {count:,}" for reason, count in message["refused"].items()))
        )  # fmt: skip
    values = [
        (reading.source, reading.entry.get("message") or reading.entry["topic"],
         reading.entry.get("signal") or reading.entry.get("field", ""), reading.text, reading.channel)
        for reading in discovery.readings
    ]  # fmt: skip
    channels = [
        (name, f"{channel['value']:.6g}", channel_unit(name), f"{channel['rate_hz']:.2f}",
         ", ".join(channel["sources"]))
        for name, channel in content["channels"].items()
    ]  # fmt: skip
    for titles, rows in (
        (("listened at", "source", "frames", ""), places),
        (("device on", "address", *keys[:-1], "NAME"), devices),
        (("message of", "device", "message", "rate Hz", "latest", "refused"), messages),
        (("values of", "message or topic", "signal or field", "value", "channel"), values),
        (("channel", "value", "unit", "rate Hz", "sources"), channels),
        (("event",), [(event,) for event in content["events"][:_MOST_EVENTS]]),
        (("missing", "why"), list(surveys.reason_by_channels(discovery.missing).items())),
    ):
        if rows:
            words = [number for number, title in enumerate(titles) if title not in ("frames", "rate Hz", "value")]
            yield result.terminal_table(None, titles, rows, left_aligned=words, padding=(0, 1, 0, 0))


def describe_silence(discovery: Discovery) -> str:
    """An error message on places without any message: where, why, and what to do."""
    places: dict[str, list[str]] = {}
    for capture in discovery.captures:
        places.setdefault(capture.problem, []).append(capture.place.text or capture.place.name)
    where = "; ".join(f"{', '.join(names)}: {problem}" for problem, names in places.items())
    types = {capture.place.type for capture in discovery.captures}
    if not any(capture.place.expected for capture in discovery.captures):
        lines = {"can": "CAN interface", "serial": "serial line"}.items()
        where += "".join(f"; this computer shows no {words}" for type_, words in lines if type_ not in types)
    advice = "switch the instruments on, check cables and firewall, listen longer with --duration, or "
    advice = advice if types - {"file"} else ""
    return f"nothing was found ({where or 'there is nowhere to listen'}); {advice}name {listen.INPUT_FORMS}"


def configure_all_channels(
    captures: Sequence[listen.Capture], vessel: str, dbc: Path | None, path: Path
) -> trial_file.TrialConfig:
    """A configuration whose sources provide all channels that they can carry, including those of all packs, and the
    vessel's CAN frames by the DBC file that describes them."""
    trial = f'[trial]\nname = "discovered"\n{_toml_line("vessel", vessel) if vessel else ""}'
    trial += "".join(map(_pack_as_toml, pack_sections(captures)))
    sections = list(map(_source_section, captures))
    config = trial_file.parse_config(trial + "".join(map(_section_as_toml, sections)), path)
    for section, capture in zip(sections, captures, strict=True):
        stated = section.pop("dbc", None) or dbc
        frames = [frame for frame in islice(capture.frames(), _HEAD_FRAMES) if frame.protocol == "can"]
        if section["type"] in ("can", "file", "serial", "udp", "tcp") and frames:
            folders = [capture.place.folder, path.parent]
            dbc_path, remark = listen.choose_dbc(None if stated is None else Path(stated), folders, frames)
            capture.remarks += [remark] if remark else []
            if dbc_path is not None:
                section["dbc"] = str(dbc_path.absolute())
                section["signals"] = listen.match_signals(dbc_path, config.actuators)
    ship = trial_file.parse_config(trial + "".join(map(_section_as_toml, sections)), path)
    order = channel_names(ship.actuators, tuple(declaration.channel for declaration in ship.declared))
    for section, source in zip(sections, ship.sources, strict=True):
        possible = trial_file.possible_channels_of_source(source, ship.actuators, ship.declared)
        section["channels"] = sorted(possible, key=order.index)
    return trial_file.parse_config(trial + "".join(map(_section_as_toml, sections)), path)


def pack_sections(captures: Sequence[listen.Capture]) -> list[dict[str, Any]]:
    """Seatrial's packs as sections of a configuration; those of several engines with a name for each engine."""
    frames = (frame for capture in captures for frame in islice(capture.frames(), _HEAD_FRAMES))
    engines = {0}
    for frame in frames:
        if frame.protocol == "can" and frame.payload:
            group, address = nmea2000.split_can_identifier(frame.identifier)
            if group in _ENGINE_GROUPS:
                engines.add(frame.payload[0])
            elif group == _J1939_ENGINE_GROUP:
                engines.add(address)
    count = 1 + max(engine for engine in engines if engine < _MOST_ENGINES)
    names = _ENGINE_NAMES.get(count) or [f"number_{number + 1}" for number in range(count)]
    return [
        {"name": path.stem, **({"each": names} if "{each}" in path.read_text() else {})}
        for path in sorted(declarations.PACKS.glob("*.toml"))
    ]


def _pack_as_toml(pack: Mapping[str, Any]) -> str:
    return "[[pack]]\n" + "".join(_toml_line(key, value) for key, value in pack.items())


def _source_section(capture: listen.Capture) -> dict[str, Any]:
    return {"name": capture.place.name, "type": capture.place.type, **capture.place.settings, "channels": []}


def configuration_as_toml(
    captures: Sequence[listen.Capture],
    survey: surveys.Survey,
    reasons: Mapping[str, str],
    missing: Mapping[str, str],
    readings: Sequence[listen.LatestReading],
    name: str,
    vessel: str = "",
) -> str:
    """The configuration of what was received, as a user would write it.

    ``reasons`` are why channels were not received, ``missing`` those of channels that the trial lacks.
    """
    text = _comment_lines(
        "Written by `seatrial discover` from what came. `seatrial record THIS.toml --check` says whether it"
        " still does; `seatrial record THIS.toml -o recordings` records. Where several sources list a channel,"
        " the one further up is preferred, and the next takes over when it falls silent: change the order to"
        " your liking."
    )
    text += f"\n[trial]\n{_toml_line('name', name)}"
    hint = 'vessel = "NAME"   # a file of trials/vessels, or your own, which says what actuators there are'
    text += _toml_line("vessel", vessel) if vessel else _comment_lines(hint)
    if any(surveys.VARIATION_FIX in reason for reason in missing.values()):
        text += _comment_lines("magnetic_variation_deg = 0.0   # east positive: give that of the place")
    if missing:
        text += "\n" + _comment_lines("Missing:")
        text += "".join(
            _comment_lines(f"{names}: {reason}", "#   ")
            for names, reason in surveys.reason_by_channels(missing).items()
        )
    received = {  # by their declaration
        declaration.channel.name
        for declaration in survey.config.declared
        if {surveys.message_name_of_origin(origin) for origin in declaration.origins}
        & {split_source_label(label)[2][0] for label in survey.quantities.get(declaration.channel.name, ())}
    }
    for pack in pack_sections(captures):
        path = declarations.PACKS / f"{pack['name']}.toml"
        templates = [channel["name"] for channel in files.parse_toml(path.read_text(), path)["channel"]]
        instances = pack.get("each", [""])
        if received & {template.replace("{each}", name) for template in templates for name in instances}:
            text += f"\n{_pack_as_toml(pack)}"
    return text + "".join(_source_as_toml(capture, survey, reasons, readings) for capture in captures)


def _source_as_toml(
    capture: listen.Capture,
    survey: surveys.Survey,
    reasons: Mapping[str, str],
    readings: Iterable[listen.LatestReading],
) -> str:
    """A source with what comes of it, and the signals and topics that come for the user to map them to channels."""
    source = next(candidate for candidate in survey.config.sources if candidate.name == capture.place.name)
    awaiting_number = [
        name for name, reason in reasons.items() if reason.endswith((surveys.VARIATION_FIX, surveys.RATED_FIX))
    ]
    provided = survey.channels_provided_by(source.name)
    provided = [
        *provided,
        *(name for name in awaiting_number if source.name in surveys.sources_of_channel(name, survey)),
    ]
    section = {key: value for key, value in _source_section(capture).items() if key != "dbc"} | {
        "channels": provided
    }
    comments = "".join(map(_comment_lines, capture.remarks))
    if isinstance(source, CanFrames) and source.dbc is not None:
        section["dbc"] = str(source.dbc)
        section["signals"] = {
            name: {"message": signal.message, "signal": signal.signal, "unit": signal.unit}
            for name, signal in source.signals.items()
            if name in provided
        }
        comments += _comment_lines("Check signs and values of the DBC file's signals alongside.")
    if not provided:
        comments += _comment_lines("No channel comes of it; what comes is recorded undecoded all the same.")
    hints = list(_hints_to_rank_devices(source.name, survey))
    if rated := [name for name in provided if reasons.get(name, "").endswith(surveys.RATED_FIX)]:
        setting = _toml_line("rated_rpm", {name.removesuffix("_rpm"): 0 for name in rated}).rstrip()
        hints.insert(0, f"{setting}   # at 100 %")
    text = f"\n{comments}{_section_as_toml(section, hints)}"
    unmapped = [reading for reading in readings if reading.source == source.name and not reading.channel]
    if unmapped:
        kind, table = ("topic", "values") if "topic" in unmapped[0].entry else ("signal", "signals")
        text += _comment_lines(
            f"Values that come: to record one, put its channel before the {kind} and its unit behind, remove the #"
            " and add the channel to the list above."
        )
        text += "" if section.get(table) else f"[source.{table}]\n"
    for reading in unmapped:
        line = f"{_toml_line('channel', reading.entry).rstrip()}   # {reading.text}"
        text += f"# {listen.replace_control_characters(line)}\n"
    return text


def _hints_to_rank_devices(source: str, survey: surveys.Survey) -> Iterator[str]:
    """Hints on several devices of a bus that send the same channels, and how to rank them."""
    rivals: dict[tuple[str, ...], list[str]] = {}
    for name in survey.channels_provided_by(source):
        devices = {
            split_source_label(label)[1]
            for label in survey.quantities[name]
            if split_source_label(label)[0] == source
        }
        addresses = tuple(sorted((address for address in devices if address.isdigit()), key=int))
        if len(addresses) > 1:
            rivals.setdefault(addresses, []).append(name)
    for names in rivals.values():
        yield f"{', '.join(names)}: of several devices the first that comes keeps it; to put them in order:"
    ranking: list[dict[str, Any]] = []
    for address in sorted({address for addresses in rivals for address in addresses}, key=int):
        iso_name = survey.devices.get((source, address), {}).get("iso_name")
        identity = {"address": int(address)} if iso_name is None else {"iso_name": iso_name}
        ranking.append({"name": f"device_{address}", **identity})
    if ranking:
        yield _toml_line("devices", ranking).rstrip()


def _section_as_toml(section: Mapping[str, Any], hints: Iterable[str] = ()) -> str:
    """A [[source]] section with hints as comments; its signals are a separate table and come last."""
    text = "[[source]]\n" + "".join(_toml_line(key, value) for key, value in section.items() if key != "signals")
    text += "".join(f"# {row}\n" for hint in hints for row in hint.splitlines())
    if signals := section.get("signals"):
        text += "[source.signals]\n" + "".join(_toml_line(key, value) for key, value in signals.items())
    return text


def _toml_line(key: str, value: Any) -> str:
    text = f"{key} = {files.toml_value(value)}"
    if isinstance(value, list) and len(text) > _WIDTH:
        rows: list[str] = [" "]
        for item in map(files.toml_value, value):
            if len(rows[-1]) + len(item) > _WIDTH:
                rows.append(" ")
            rows[-1] += f" {item},"
        text = "\n".join((f"{key} = [", *rows, "]"))
    return f"{text}\n"


def _comment_lines(text: str, prefix: str = "# ") -> str:
    """Text as a comment of as many lines as it takes; control characters are replaced."""
    rows = wrap(
        listen.replace_control_characters(text),
        _WIDTH + 1 - len(prefix),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "".join(f"{prefix}{row}\n" for row in rows)
