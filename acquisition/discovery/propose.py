"""A configuration that records all that has been heard, as text, with a comment wherever something is missing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from acquisition.config.configuration import TrialConfig, parse_config, possible_channels
from acquisition.core.channels import channel_names
from acquisition.core.frames import label_parts
from acquisition.discovery.dbc_match import match_signals, own_dbc
from acquisition.discovery.listen import Heard
from acquisition.logger.missing import VARIATION_FIX, by_reason
from acquisition.logger.survey import Survey

_WIDTH = 112
_HEAD_FRAMES = 20_000


def everything(found: Sequence[Heard], vessel: str, dbc: Path | None, path: Path) -> TrialConfig:
    """A configuration whose sources may provide every channel that their kind can carry."""
    trial = f'[trial]\nname = "discovered"\n{_line("vessel", vessel) if vessel else ""}'
    sections = [_settings(each) for each in found]
    bare = parse_config(trial + "".join(map(_section, sections)), path)
    for section, each in zip(sections, found, strict=True):
        _add_dbc(section, each, dbc, bare)
    with_signals = parse_config(trial + "".join(map(_section, sections)), path)
    for section, source in zip(sections, with_signals.sources, strict=True):
        order = channel_names(with_signals.actuators)
        section["channels"] = sorted(possible_channels(source, with_signals.actuators), key=order.index)
    return parse_config(trial + "".join(map(_section, sections)), path)


def _settings(heard: Heard) -> dict[str, Any]:
    return {"name": heard.place.name, "type": heard.place.type, **heard.place.settings, "channels": []}


def _add_dbc(section: dict[str, Any], heard: Heard, dbc: Path | None, config: TrialConfig) -> None:
    """The vessel's own frames: by the file that was given, or by one that is the bus's beyond doubt."""
    if section["type"] in ("can", "file", "serial", "udp", "tcp"):
        given = section.get("dbc") or dbc or own_dbc(islice(heard.frames(), _HEAD_FRAMES))
        if given is not None and any(frame.protocol == "can" for frame in islice(heard.frames(), _HEAD_FRAMES)):
            section["dbc"] = str(Path(given).absolute())
            section["signals"] = match_signals(Path(given), config.actuators)
        else:
            section.pop("dbc", None)


def configuration_text(
    found: Sequence[Heard], survey: Survey, missing: Mapping[str, str], name: str, vessel: str = ""
) -> str:
    """The configuration of what was heard, as a person would write it."""
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
        else _comment('vessel = "NAME"   # a file of trials/vessels, or your own'),
    ]
    if any(VARIATION_FIX in reason for reason in missing.values()):
        parts.append(_comment("magnetic_variation_deg = 0.0   # east positive: give that of the place"))
    if missing:
        parts.append("\n" + _comment("Missing:"))
        parts += [_comment(f"{names}: {reason}", "#   ") for names, reason in by_reason(missing).items()]
    parts += [_source_text(each, survey) for each in found]
    return "".join(parts)


def _source_text(heard: Heard, survey: Survey) -> str:
    source = next(each for each in survey.config.sources if each.name == heard.place.name)
    provided = survey.provided(source.name)
    signals = getattr(source, "signals", {})
    section = {**_settings(heard), "channels": provided}
    if getattr(source, "dbc", None) is not None:
        section["dbc"] = str(source.dbc)  # type: ignore[union-attr]
        section["signals"] = {
            name: {"message": each.message, "signal": each.signal, "unit": each.unit}
            for name, each in signals.items()
            if name in provided
        }
    comments = "".join(_comment(each) for each in (*heard.remarks, *_rivals(source.name, survey)))
    if "dbc" in section:
        comments += _comment("The numbers of the DBC file fit what comes; check signs and values alongside.")
    if not provided:
        comments += _comment("No channel comes of it; what comes is recorded undecoded all the same.")
    return f"\n{comments}{_section(section)}"


def _rivals(source: str, survey: Survey) -> Iterable[str]:
    """Where several devices on one bus tell the same: who they are, and how to put them in order."""
    rivals: dict[tuple[str, ...], list[str]] = {}
    for name in survey.provided(source):
        devices = {label_parts(each)[1] for each in survey.quantities[name] if label_parts(each)[0] == source}
        addresses = tuple(sorted((each for each in devices if each.isdigit()), key=int))
        if len(addresses) > 1:
            rivals.setdefault(addresses, []).append(name)
    for addresses, names in rivals.items():
        yield f"{', '.join(names)}: of several devices the first that comes keeps it; to put them in order:"
        listed = (_inline({"name": f"device_{each}", **_identified(source, each, survey)}) for each in addresses)
        yield f"devices = [{', '.join(listed)}]"


def _identified(source: str, address: str, survey: Survey) -> dict[str, Any]:
    known = survey.devices.get((source, address), {})
    return {"iso_name": known["iso_name"]} if "iso_name" in known else {"address": int(address)}


def _section(section: Mapping[str, Any]) -> str:
    """A [[source]] section; its signals are a table of their own and come last."""
    plain = {key: value for key, value in section.items() if key != "signals"}
    text = "[[source]]\n" + "".join(_line(key, value) for key, value in plain.items())
    if signals := section.get("signals"):
        text += "[source.signals]\n" + "".join(_line(key, value) for key, value in signals.items())
    return text


def _line(key: str, value: Any) -> str:
    text = f"{key} = {_inline(value)}"
    if isinstance(value, list) and len(text) > _WIDTH:
        rows: list[str] = [" "]
        for each in map(_inline, value):
            if len(rows[-1]) + len(each) > _WIDTH:
                rows.append(" ")
            rows[-1] += f" {each},"
        text = "\n".join((f"{key} = [", *rows, "]"))
    return f"{text}\n"


def _inline(value: Any) -> str:
    """A value as TOML writes it; its strings and numbers are JSON's."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_inline(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


def _comment(text: str, mark: str = "# ") -> str:
    """Text behind number signs, on as many lines as it takes; control characters are made visible."""
    rows, plain = [""], "".join(each if each.isprintable() else "?" for each in text)
    for word in plain.split(" "):
        if rows[-1] and len(rows[-1]) + len(word) > _WIDTH - len(mark):
            rows.append("")
        rows[-1] += f" {word}" if rows[-1] else word
    return "".join(f"{mark}{row}\n" for row in rows)
