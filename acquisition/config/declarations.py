"""What files declare: channels and their origins (``[[channel]]``, ``[[pack]]``), and vessel files' actuators.

A pack is a file of channels, found in ``trials/packs`` by name or elsewhere by path. Declarations for each of
several equal devices, such as engines, have ``{each}`` in their names and may number them by ``{number}``.
Channels that a ship has anyway may be given further origins. A vessel file is found by name or path and merged
with its base; ``hybrid/vessel`` interprets the numbers in it, recording and importing need the actuators only.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass as plain_dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, PositiveInt, StringConstraints, Tag
from pydantic.dataclasses import dataclass

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import line_of_toml_key, parse_toml, read_text, validate_toml
from seatrial.acquisition.core.quantities import Linear, unit_conversion
from seatrial.acquisition.core.ship import SHIPPED, VESSELS, Actuator, Actuators, Channel, check_actuators, declare

PACKS = Path(__file__).parents[2] / "trials" / "packs"
"""The folder of the packs that come with Seatrial."""

GIVE_CONFIG = "give a configuration of yours with --config"
"""What to do where a recording's configuration names a file that is not attached."""

STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)
Finite = Annotated[float, Field(allow_inf_nan=False)]
PERCENT = "percent"
_TAG = re.compile(r"[A-OQ-Z][A-Z0-9]{2}|P[A-Z0-9]{2,}")


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Conversion:
    """A received number as a channel's value: ``scale * (number in the channel's unit) + offset``.

    ``unit`` is the number's; by default the origin's unit if the protocol defines one, else the channel's.
    With ``full_scale``, in the channel's unit, the number is a percentage of it.
    """

    unit: str | None = None
    scale: Finite = 1.0
    offset: Finite = 0.0
    full_scale: Finite | None = None

    def conversion_to_channel(self, channel: Channel, default_unit: str | None = None) -> Linear:
        """The conversion to the channel's unit, from ``default_unit`` if no unit is given.

        Raises :class:`ConfigurationError` if the units measure different quantities.
        """
        unit, per_percent = self.unit or default_unit, (self.full_scale or 0.0) / 100.0
        if self.full_scale is None:
            if unit == PERCENT and channel.unit != "%":
                raise ConfigurationError("percent needs full_scale, the value at 100 %")
            step = unit_conversion(channel.unit, unit) if unit else Linear(1.0)
        else:
            to_percent = unit_conversion("%", unit or PERCENT)
            step = Linear(to_percent.scale * per_percent, to_percent.offset * per_percent)
        return Linear(self.scale * step.scale, self.scale * step.offset + self.offset)


def _check_sentence_tag(sentence: str) -> str:
    if not _TAG.fullmatch(sentence):
        raise ValueError(
            "is not a sentence; write its three letters, like DPT, or the whole tag of a proprietary one, like PSXN"
        )
    return sentence


@dataclass(frozen=True, config=STRICT, kw_only=True)
class SentenceField(Conversion):
    """A field of an NMEA 0183 sentence, counted from 1 after the first comma, as in manuals.

    ``sentence`` is the formatter after the talker, or a proprietary sentence's whole tag (``PSXN``). ``when``
    gives required values of other fields, ``time`` the field with the time of day (hhmmss).
    """

    sentence: Annotated[str, AfterValidator(_check_sentence_tag)]
    field: PositiveInt
    when: dict[Annotated[str, StringConstraints(pattern=r"^[1-9]\d?$")], tuple[str, ...] | str] = Field(
        default_factory=dict
    )
    time: PositiveInt | None = None


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Transducer(Conversion):
    """A transducer in XDR sentences, by its name there; its unit is the one in the sentence."""

    transducer: str


@dataclass(frozen=True, config=STRICT, kw_only=True)
class GroupField(Conversion):
    """A field of a parameter group of NMEA 2000 or J1939, by its name in canboat's database or by its position.

    A position is ``"first bit:number of bits"``, with the ``step`` of a number and whether it is ``signed``.
    ``where`` gives required values of other fields (lookups and codes); ``address`` the required sender.
    """

    group: Annotated[int, Field(ge=0, le=0x3FFFF)]
    field: str
    where: dict[str, int] = Field(default_factory=dict)
    address: Annotated[int, Field(ge=0, le=253)] | None = None
    step: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    signed: bool = False


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MavlinkField(Conversion):
    """A field of a MAVLink message; ``index`` of an array element; ``where`` as in :class:`GroupField`."""

    message: Annotated[str, StringConstraints(pattern=r"^[A-Z][A-Z0-9_]*$")]
    field: str
    index: Annotated[int, Field(ge=0)] | None = None
    where: dict[str, int] = Field(default_factory=dict)


Origin = SentenceField | Transducer | GroupField | MavlinkField


_ORIGIN_KEYS = ("sentence", "transducer", "group", "message")
"""The keys of origins that only one kind of them has."""
_AnyOrigin = Annotated[
    Annotated[SentenceField, Tag("by sentence")]
    | Annotated[Transducer, Tag("by transducer")]
    | Annotated[GroupField, Tag("by group")]
    | Annotated[MavlinkField, Tag("by message")],
    Discriminator(
        lambda origin: next(
            (f"by {key}" for key in _ORIGIN_KEYS if isinstance(origin, dict) and key in origin), None
        ),
        custom_error_type="no_origin",
        custom_error_message="says none of sentence, transducer, group and message",
    ),
]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class ChannelSection:
    """A channel: its name, which ends in its unit, the unit, the range of possible values, its origins.

    A ``state`` is a code or a count that keeps its value until the next one. For a channel of the ship only the
    name and the origins are given.
    """

    name: str
    unit: str | None = None
    range: tuple[Finite, Finite] | None = None
    meaning: Annotated[str, StringConstraints(max_length=200)] = ""
    state: bool = False
    origins: tuple[_AnyOrigin, ...] = Field(default=(), alias="from")


@dataclass(frozen=True, config=STRICT, kw_only=True)
class PackSection:
    """A pack of channels used by a file: its name or path, and the names of the devices for ``each``."""

    name: str
    each: tuple[Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$")], ...] = Field(
        default=("main",), min_length=1
    )


@dataclass(frozen=True, config=STRICT)
class _Pack:
    channel: tuple[ChannelSection, ...] = ()


@plain_dataclass(frozen=True, slots=True)
class DeclaredChannel:
    """A channel and its origins; for a channel of the ship these are further ones."""

    channel: Channel
    origins: tuple[Origin, ...] = ()


Declarations = tuple[DeclaredChannel, ...]
"""The channels that a configuration declares or gives further origins."""


@plain_dataclass(frozen=True, slots=True)
class PackFile:
    """A pack as read: its name in the file that uses it, its path, its text, the names of its devices."""

    name: str
    path: Path
    text: str
    device_names: tuple[str, ...]


def read_packs(
    packs: Iterable[PackSection], folder: Path, carried: Mapping[str, str] | None, text: str, path: Path | str
) -> tuple[PackFile, ...]:
    """The packs' files, by names or by paths from ``folder``; for a recording's configuration the texts ``carried``
    by it, by name, and no other.

    ``text`` and ``path`` are of the file that names them. Raises :class:`ConfigurationError`.
    """
    files = []
    for number, pack in enumerate(packs):
        where = f"{path}, line {line_of_toml_key(text, ['pack', number, 'name'])}"
        if carried is not None:
            if pack.name not in carried:
                what = (
                    f"the recording has no attachment for the pack {pack.name!r}, and no other file is read for it"
                )
                raise ConfigurationError(what, where=where, fix=GIVE_CONFIG)
            files.append(PackFile(pack.name, Path(pack.name), carried[pack.name], pack.each))
            continue
        file = pack.name if pack.name.endswith(".toml") else f"{pack.name}.toml"
        pack_path = next((place for place in (folder / file, PACKS / file) if place.is_file()), None)
        if pack_path is None:
            pack_names = ", ".join(sorted(shipped.stem for shipped in PACKS.glob("*.toml")))
            fix = f"name a file, or one of {pack_names}"
            raise ConfigurationError(f"pack {pack.name!r} does not exist", where=where, fix=fix)
        try:
            files.append(PackFile(pack.name, pack_path, read_text(pack_path), pack.each))
        except ConfigurationError as error:
            raise error.at(where) from error
    return tuple(files)


def merge_declarations(
    sections: tuple[ChannelSection, ...],
    packs: tuple[PackFile, ...],
    ship_channels: Mapping[str, Channel],
    text: str,
    path: Path | str,
) -> Declarations:
    """The declarations of a file and its packs; the file's take precedence over a pack's.

    Raises :class:`ConfigurationError` naming the file and the line.
    """
    for name, count in Counter(section.name for section in sections).items():
        if count > 1:
            what, fix = f"channel {name} is declared twice", "list all its origins in one `from`"
            raise ConfigurationError(what, where=f"{path}, line {line_of_toml_key(text, ['channel'])}", fix=fix)
    candidates = [(section, path, text, number) for number, section in enumerate(sections)]
    for pack in packs:
        raw = parse_toml(pack.text, pack.path)
        for device_number, device in enumerate(pack.device_names):
            filled = validate_toml(
                _fill_in_device_placeholders(raw, device, device_number), pack.text, pack.path, _Pack
            ).channel
            candidates += [
                (section, pack.path, pack.text, number)
                for number, section in enumerate(filled)
                if device_number == 0 or "{each}" in raw["channel"][number]["name"]
            ]
    declarations: dict[str, DeclaredChannel] = {}
    for section, file, file_text, number in candidates:
        if section.name not in declarations:
            try:
                declarations[section.name] = _declared_channel(section, ship_channels)
            except ConfigurationError as error:
                raise error.at(
                    f"{file}, line {line_of_toml_key(file_text, ['channel', number, 'name'])}"
                ) from error
    return tuple(declarations.values())


def _fill_in_device_placeholders(node: Any, device: str, number: int) -> Any:
    """A declaration with the name and number of one device filled in."""
    if isinstance(node, dict):
        return {key: _fill_in_device_placeholders(value, device, number) for key, value in node.items()}
    if isinstance(node, list):
        return [_fill_in_device_placeholders(value, device, number) for value in node]
    if not isinstance(node, str):
        return node
    return number if node == "{number}" else node.replace("{each}", device).replace("{number}", str(number))


def _declared_channel(section: ChannelSection, ship_channels: Mapping[str, Channel]) -> DeclaredChannel:
    name = section.name
    if name in ship_channels:
        if section.unit is not None or section.range is not None or section.state or section.meaning:
            fix = "give only its name and `from`, or choose another name"
            raise ConfigurationError(f"{name} is already a channel of the ship", fix=fix)
        channel = ship_channels[name]
    elif section.unit is None or section.range is None:
        missing = "unit" if section.unit is None else "range"
        raise ConfigurationError(f"channel {name} has no {missing}", fix="add it")
    else:
        channel = declare(name, section.unit, *section.range, section.meaning, section.state)
    for origin in section.origins:
        if origin.unit is not None or origin.full_scale is not None:
            try:
                origin.conversion_to_channel(channel)
            except ConfigurationError as error:
                raise ConfigurationError(f"{name}: {error.what}", fix=error.fix) from error
    return DeclaredChannel(channel, section.origins)


@contextmanager
def locate_errors_at_channel(channel: Channel) -> Iterator[None]:
    """Add the channel to an error in its declaration."""
    try:
        yield
    except ConfigurationError as error:
        raise error.at(f"channel {channel.name}") from error


def origins_of_kind(declared: Declarations, channels: Iterable[str], kind: Any) -> list[tuple[Channel, Any]]:
    """The channels and origins of one kind, among those listed for a source."""
    names = frozenset(channels)
    return [
        (declaration.channel, origin)
        for declaration in declared
        if declaration.channel.name in names
        for origin in declaration.origins
        if isinstance(origin, kind)
    ]


Tree = dict[str, Any]
"""The tables of a vessel file."""


def vessel_names() -> list[str]:
    """The names of the vessels that come with Seatrial.

    Returns
    -------
    list of str
        What :func:`seatrial.load_vessel` takes, and every parameter ``vessel``.

    Examples
    --------
    >>> import seatrial as st
    >>> {"gunnerus_short", "otter_2m"} <= set(st.vessels())
    True
    """
    return sorted(SHIPPED)


def find_vessel(name_or_file: str | Path, folder: Path | None = None) -> Path:
    """The file of a vessel by its name in ``trials/vessels``, or by a path from ``folder`` (working directory).

    Raises :class:`ConfigurationError` for what is neither.
    """
    text = str(name_or_file)
    shipped = VESSELS / f"{text}.toml"
    if "/" not in text and shipped.is_file():
        return shipped
    path = (folder or Path.cwd()) / text
    if path.is_file():
        return path
    why = f"it is neither a file nor one of {', '.join(vessel_names())}"
    fix = "give one of these names, or the path of a vessel file"
    raise ConfigurationError(f"no vessel {text!r}", why=why, fix=fix)


def vessel_file_of_ship(ship: str, folder: Path) -> Path | None:
    """The vessel file of the ship named by a recording, a configuration or a column map in ``folder``.

    One that comes with Seatrial, else one in ``folder`` or the working directory: with that file name, or with
    ``name = "SHIP"``. None if there is none. Raises :class:`ConfigurationError` if several match.
    """
    ship = Path(ship).stem if ship.endswith(".toml") else ship
    for place in (VESSELS, folder, Path.cwd()) if ship else ():
        candidates = []
        for path in sorted(place.glob("*.toml")):
            try:
                tree = parse_toml(read_text(path), path)
                is_vessel, name = bool(tree.keys() & {"base", "dimensions"}), str(tree.get("name", ""))
            except ConfigurationError:  # which is reported when the file is loaded
                is_vessel, name = True, path.stem
            if is_vessel and ship in (path.stem, name):
                candidates.append(path)
        matches = [path for path in candidates if path.stem == ship] or candidates
        if len(matches) > 1:
            what = f"{' and '.join(path.name for path in matches)} are both of the ship {ship!r}"
            raise ConfigurationError(what, where=str(place), fix="choose one with --vessel, or rename one")
        if matches:
            return matches[0]
    return None


def name_of_vessel(vessel: str | Path) -> str:
    """The name of a vessel: its name in ``trials/vessels`` or the name in its file."""
    return str(read_vessel_with_bases(find_vessel(vessel))["name"])


def read_vessel_with_bases(path: Path, dependents: tuple[Path, ...] = ()) -> Tree:
    """The tables of a vessel file merged with its base, and so on with the base of that; actuators by name.

    A base is the name of a vessel that comes with Seatrial or a path, relative to the file that names it. A
    file without a name takes the file's name, not its base's. ``dependents`` are the files that build on it. Raises
    :class:`ConfigurationError` for an unreadable file, a missing base, and circular bases.
    """
    tree = parse_toml(read_text(path), path)
    entries = tree.get("actuator", [])
    sections = [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []
    if not all(isinstance(section.get("name", ""), str) for section in sections):
        fix = 'write name = "NAME" in each [[actuator]]'
        raise ConfigurationError("has an actuator whose name is no text", where=str(path), fix=fix)
    named, base = {"name": path.stem, **tree}, tree.get("base", "")
    if not base:
        return {key: value for key, value in named.items() if key != "base"}
    if not isinstance(base, str):
        raise ConfigurationError("base is not a name", where=str(path), fix='write base = "NAME or FILE"')
    base_path = find_vessel(base, path.parent)
    dependents = (*dependents, path.resolve())
    if base_path.resolve() in dependents:
        fix = "let it build on another vessel, or on none"
        raise ConfigurationError(f"base {base!r} leads back to a file that builds on it", where=str(path), fix=fix)
    return _merge_over_base(read_vessel_with_bases(base_path, dependents), named)


def load_actuators(vessel: str | Path) -> Actuators:
    """The names and kinds of a vessel's actuators, by its name or from its file.

    Raises :class:`ConfigurationError` for anything but a vessel file, and for a list that cannot be one ship's.
    """
    path = find_vessel(vessel)
    entries = read_vessel_with_bases(path).get("actuator", [])
    try:
        return check_actuators(Actuator(str(entry["name"]), str(entry["kind"])) for entry in entries)
    except (TypeError, KeyError) as error:
        fix = "write an [[actuator]] with name and kind for each"
        raise ConfigurationError("has actuators without name or kind", where=str(path), fix=fix) from error
    except ConfigurationError as error:
        raise error.at(path) from error


def length_of_ship(ship: str, folder: Path) -> float | None:
    """The length between perpendiculars [m] of the ship named by a file in ``folder``; None without a vessel file.

    A lengthening of the hull among the effects of the file is included.
    """
    file = vessel_file_of_ship(ship, folder)
    tree = {} if file is None else read_vessel_with_bases(file)
    length_m = _number_at(tree, "dimensions", "length_between_perpendiculars_m")
    added_m = _number_at(tree, "effects", "hull_lengthening", "length_m") or 0.0
    return None if length_m is None else length_m + added_m


def _number_at(tree: Tree, *keys: str) -> float | None:
    value: object = tree
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return float(value) if isinstance(value, int | float) else None


def actuators_of_ship(ship: str, folder: Path) -> Actuators:
    """The actuators of the ship named by a file in ``folder``, none if it has no vessel file."""
    file = vessel_file_of_ship(ship, folder)
    return () if file is None else load_actuators(file)


def _merge_over_base(base: Tree, overrides: Tree) -> Tree:
    """``base`` overridden by ``overrides``: tables of the same ``model`` key by key, actuators by name."""
    merged = dict(base)
    for key, value in overrides.items():
        base_value = base.get(key)
        if key == "actuator" and isinstance(base_value, list) and isinstance(value, list):
            by_name = {entry.get("name"): entry for entry in base_value if isinstance(entry, dict)}
            for entry in value:
                name = entry.get("name") if isinstance(entry, dict) else None
                by_name[name] = _merge_over_base(by_name[name], entry) if name in by_name else entry
            merged[key] = list(by_name.values())
        elif (
            isinstance(base_value, dict)
            and isinstance(value, dict)
            and value.get("model", base_value.get("model")) == base_value.get("model")
        ):
            merged[key] = _merge_over_base(base_value, value)
        else:
            merged[key] = value
    return merged
