"""A configuration that records all that has been heard, as text, with a comment wherever something is missing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

from seatrial.acquisition.config.configuration import TrialConfig, parse_config, possible_channels
from seatrial.acquisition.config.declarations import PACKS
from seatrial.acquisition.config.toml_file import parse_toml
from seatrial.acquisition.core.channels import channel_names
from seatrial.acquisition.core.frames import Frame, label_parts
from seatrial.acquisition.decoders.nmea2000 import parameter_group
from seatrial.acquisition.discovery.dbc_files import choose_dbc, match_signals
from seatrial.acquisition.discovery.listen import Heard
from seatrial.acquisition.discovery.readings import LatestReading
from seatrial.acquisition.logger.missing import RATED_FIX, VARIATION_FIX, by_reason, message_of, sources_of
from seatrial.acquisition.logger.survey import Survey

_WIDTH = 112
_HEAD_FRAMES = 20_000
_OF_ENGINES = frozenset({127488, 127493})  # groups of one frame whose first byte is the engine's instance
_ENGINE_OF_J1939 = 61444
_MOST_ENGINES = 8
_ENGINES = {1: ["main"], 2: ["port", "starboard"], 3: ["port", "centre", "starboard"]}


def everything(captures: Sequence[Heard], vessel: str, dbc: Path | None, path: Path) -> TrialConfig:
    """A configuration whose sources may provide every channel that their kind can carry, of all packs, too."""
    trial = f'[trial]\nname = "discovered"\n{_line("vessel", vessel) if vessel else ""}'
    trial += "".join(map(_pack, all_packs(captures)))
    sections = list(map(_settings, captures))
    bare = parse_config(trial + "".join(map(_section, sections)), path)
    for section, capture in zip(sections, captures, strict=True):
        _add_dbc(section, capture, dbc, path.parent, bare)
    ship = parse_config(trial + "".join(map(_section, sections)), path)
    order = channel_names(ship.actuators, tuple(declaration.channel for declaration in ship.declared))
    for section, source in zip(sections, ship.sources, strict=True):
        possible = possible_channels(source, ship.actuators, ship.declared)
        section["channels"] = sorted(possible, key=order.index)
    return parse_config(trial + "".join(map(_section, sections)), path)


def all_packs(captures: Sequence[Heard]) -> list[dict[str, Any]]:
    """The packs that come along, as sections; those of several like things with as many names as engines speak."""
    frames = (frame for capture in captures for frame in islice(capture.frames(), _HEAD_FRAMES))
    engines = {_engine_of(frame) for frame in frames if frame.protocol == "can" and frame.payload}
    count = 1 + max((engine for engine in engines if engine is not None and engine < _MOST_ENGINES), default=0)
    names = _ENGINES.get(count) or [f"number_{number + 1}" for number in range(count)]
    return [
        {"name": path.stem, **({"each": names} if "{each}" in path.read_text() else {})}
        for path in sorted(PACKS.glob("*.toml"))
    ]


def _engine_of(frame: Frame) -> int | None:
    """The number of the engine that a frame tells of, by its instance, on J1939 by its address."""
    group, address = parameter_group(frame.identifier)
    if group in _OF_ENGINES:
        return frame.payload[0]
    return address if group == _ENGINE_OF_J1939 else None


def used_packs(packs: Sequence[dict[str, Any]], survey: Survey) -> list[dict[str, Any]]:
    """Those of the packs by which something has come."""
    by_declaration = {
        declaration.channel.name
        for declaration in survey.config.declared
        if {message_of(origin) for origin in declaration.origins}
        & {label_parts(label)[2][0] for label in survey.quantities.get(declaration.channel.name, ())}
    }
    return [pack for pack in packs if by_declaration & set(_names_in(pack))]


def _names_in(pack: Mapping[str, Any]) -> Iterator[str]:
    path = PACKS / f"{pack['name']}.toml"
    for channel in parse_toml(path.read_text(), path)["channel"]:
        yield from (channel["name"].replace("{each}", instance) for instance in pack.get("each", [""]))


def _pack(pack: Mapping[str, Any]) -> str:
    return "[[pack]]\n" + "".join(_line(key, value) for key, value in pack.items())


def _settings(capture: Heard) -> dict[str, Any]:
    return {"name": capture.place.name, "type": capture.place.type, **capture.place.settings, "channels": []}


def _add_dbc(section: dict[str, Any], capture: Heard, dbc: Path | None, folder: Path, config: TrialConfig) -> None:
    """The vessel's own frames, by the DBC file that describes them."""
    named = section.pop("dbc", None) or dbc
    frames = [frame for frame in islice(capture.frames(), _HEAD_FRAMES) if frame.protocol == "can"]
    if section["type"] not in ("can", "file", "serial", "udp", "tcp") or not frames:
        return
    choice = choose_dbc(None if named is None else Path(named), [capture.place.folder, folder], frames)
    capture.remarks += [choice.remark] if choice.remark else []
    if choice.path is not None:
        section["dbc"] = str(choice.path.absolute())
        section["signals"] = match_signals(choice.path, config.actuators)


class Gaps(NamedTuple):
    """Why channels have not come: ``reasons`` of all that are decoded, ``missing`` those that the trial lacks."""

    reasons: Mapping[str, str]
    missing: Mapping[str, str]


def configuration_text(
    captures: Sequence[Heard],
    survey: Survey,
    gaps: Gaps,
    readings: Sequence[LatestReading],
    name: str,
    vessel: str = "",
) -> str:
    """The configuration of what was heard, as a person would write it."""
    reasons, missing = gaps
    parts = [
        _comment(
            "Written by `seatrial discover` from what came. `seatrial record THIS.toml --check` says whether it"
            " still does; `seatrial record THIS.toml -o recordings` records. Where several sources list a channel,"
            " the one further up is preferred, and the next takes over when it falls silent: change the order to"
            " your liking."
        ),
        f"\n[trial]\n{_line('name', name)}",
        _line("vessel", vessel)
        if vessel
        else _comment(
            'vessel = "NAME"   # a file of trials/vessels, or your own, which says what actuators there are'
        ),
    ]
    if any(VARIATION_FIX in reason for reason in missing.values()):
        parts.append(_comment("magnetic_variation_deg = 0.0   # east positive: give that of the place"))
    if missing:
        parts.append("\n" + _comment("Missing:"))
        parts += [_comment(f"{names}: {reason}", "#   ") for names, reason in by_reason(missing).items()]
    parts += [f"\n{_pack(pack)}" for pack in used_packs(all_packs(captures), survey)]
    parts += [_source_text(capture, survey, reasons, readings) for capture in captures]
    return "".join(parts)


def _source_text(
    capture: Heard, survey: Survey, reasons: Mapping[str, str], readings: Iterable[LatestReading]
) -> str:
    source = next(candidate for candidate in survey.config.sources if candidate.name == capture.place.name)
    provided = [*survey.provided(source.name), *_wanting_a_number(source.name, survey, reasons)]
    signals = getattr(source, "signals", {})
    section = {key: value for key, value in _settings(capture).items() if key != "dbc"} | {"channels": provided}
    if getattr(source, "dbc", None) is not None:
        section["dbc"] = str(source.dbc)  # type: ignore[union-attr]
        section["signals"] = {
            name: {"message": signal.message, "signal": signal.signal, "unit": signal.unit}
            for name, signal in signals.items()
            if name in provided
        }
    comments = "".join(map(_comment, capture.remarks))
    if "dbc" in section:
        comments += _comment("Check signs and values of the DBC file's signals alongside.")
    if not provided:
        comments += _comment("No channel comes of it; what comes is recorded undecoded all the same.")
    hints = [*_rated(provided, reasons), *_rivals(source.name, survey)]
    template = _template([reading for reading in readings if reading.source == source.name], section)
    return f"\n{comments}{_section(section, hints)}{template}"


def _wanting_a_number(source: str, survey: Survey, missing: Mapping[str, str]) -> list[str]:
    """The channels that will come of a source as soon as a person has filled in a number that is asked for."""
    asked = [name for name, reason in missing.items() if reason.endswith((VARIATION_FIX, RATED_FIX))]
    return [name for name in asked if source in sources_of(name, survey)]


def _rated(listed: Iterable[str], missing: Mapping[str, str]) -> Iterator[str]:
    """The setting that percent of thrusters wait for."""
    names = [name for name in listed if missing.get(name, "").endswith(RATED_FIX)]
    if names:
        yield _line("rated_rpm", {name.removesuffix("_rpm"): 0 for name in names}).rstrip() + "   # at 100 %"


def _template(readings: Sequence[LatestReading], section: Mapping[str, Any]) -> str:
    """The signals and topics that come, with their values, for a person to say which channel each carries."""
    unmapped = [entry for entry in readings if not entry.channel]
    if not unmapped:
        return ""
    kind, table = ("topic", "values") if "topic" in unmapped[0].entry else ("signal", "signals")
    text = _comment(
        f"Values that come: to record one, put its channel before the {kind} and its unit behind, remove the # and"
        " add the channel to the list above."
    )
    text += "" if section.get(table) else f"[source.{table}]\n"
    for reading in unmapped:
        line = f"{_line('channel', reading.entry).rstrip()}   # {reading.text}"
        text += f"# {_visible(line)}\n"
    return text


def _rivals(source: str, survey: Survey) -> Iterator[str]:
    """Where several devices on one bus tell the same: who they are, and how to put them in order."""
    rivals: dict[tuple[str, ...], list[str]] = {}
    for name in survey.provided(source):
        devices = {label_parts(label)[1] for label in survey.quantities[name] if label_parts(label)[0] == source}
        addresses = tuple(sorted((address for address in devices if address.isdigit()), key=int))
        if len(addresses) > 1:
            rivals.setdefault(addresses, []).append(name)
    for names in rivals.values():
        yield f"{', '.join(names)}: of several devices the first that comes keeps it; to put them in order:"
    ranked = sorted({address for addresses in rivals for address in addresses}, key=int)
    if ranked:
        listed = [{"name": f"device_{address}", **_identified(source, address, survey)} for address in ranked]
        yield _line("devices", listed).rstrip()


def _identified(source: str, address: str, survey: Survey) -> dict[str, Any]:
    device = survey.devices.get((source, address), {})
    return {"iso_name": device["iso_name"]} if "iso_name" in device else {"address": int(address)}


def _section(section: Mapping[str, Any], hints: Iterable[str] = ()) -> str:
    """A [[source]] section, hints as comments in it; its signals are a table of their own and come last."""
    plain = {key: value for key, value in section.items() if key != "signals"}
    text = "[[source]]\n" + "".join(_line(key, value) for key, value in plain.items())
    text += "".join(f"# {row}\n" for hint in hints for row in hint.splitlines())
    if signals := section.get("signals"):
        text += "[source.signals]\n" + "".join(_line(key, value) for key, value in signals.items())
    return text


def _line(key: str, value: Any) -> str:
    text = f"{key} = {_inline(value)}"
    if isinstance(value, list) and len(text) > _WIDTH:
        rows: list[str] = [" "]
        for item in map(_inline, value):
            if len(rows[-1]) + len(item) > _WIDTH:
                rows.append(" ")
            rows[-1] += f" {item},"
        text = "\n".join((f"{key} = [", *rows, "]"))
    return f"{text}\n"


def _inline(value: Any) -> str:
    """A value as TOML writes it; its strings and numbers are JSON's."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_inline(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


def _visible(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _comment(text: str, mark: str = "# ") -> str:
    """Text behind number signs, on as many lines as it takes; control characters are made visible."""
    rows = wrap(_visible(text), _WIDTH + 1 - len(mark), break_long_words=False, break_on_hyphens=False)
    return "".join(f"{mark}{row}\n" for row in rows)
