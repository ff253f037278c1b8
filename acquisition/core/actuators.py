"""A ship's actuators as a list of names and kinds, and the channels that follow from it.

The control channels of a recording, their orders, units and ranges are written down nowhere else: an actuator's
kind says which quantities it has (:data:`KINDS`), its name what they are called. The list that holds where nothing
says another, R/V Gunnerus', is read from her vessel file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from pathlib import Path

from acquisition.core.channel import Channel, circle
from acquisition.core.errors import ConfigurationError

VESSELS = Path(__file__).parents[2] / "trials" / "vessels"
"""The folder of the vessel files that come with Seatrial."""

DEFAULT_VESSEL = "gunnerus_short"
RUDDER = "rudder_angle_deg"
"""The auxiliary channel of a ship that has a rudder beside what her list of actuators says."""

NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]*")
_HIGHEST_RPM = 3000
_ORDER = "_order"


@dataclass(frozen=True, slots=True)
class Actuator:
    """One actuator: its name, which its channels carry, and its kind, one of :data:`KINDS`."""

    name: str
    kind: str

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The control channels of this actuator."""
        return tuple(make(self.name) for make in KINDS[self.kind].channels)

    @property
    def drives(self) -> bool:
        """Whether it is there to drive the ship ahead."""
        return KINDS[self.kind].drives

    @property
    def angle(self) -> Channel | None:
        """The channel of the angle that it steers the ship with; None where it has none."""
        return next((each for each in self.channels if each.unit == "deg"), None)

    @property
    def is_at_bow(self) -> bool:
        """Whether it is a tunnel thruster whose name does not say that it is aft."""
        return self.kind == "tunnel" and _end(self.name) == "bow"

    @property
    def orders(self) -> tuple[Channel, ...]:
        """The auxiliary channels of the orders to this actuator."""
        place = "" if self.name == self.kind else f"{self.name.replace('_', ' ')} "
        parts = zip(KINDS[self.kind].parts, self.channels, strict=True)
        return tuple(
            Channel(name_of_order(each.name), each.unit, each.low, each.high, "auxiliary",
                    f"Order to the {place}{part}", each.circular)
            for part, each in parts
        )  # fmt: skip


Actuators = tuple[Actuator, ...]
"""A ship's actuators, in the order of their control channels."""


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _shaft(name: str) -> Channel:
    return Channel(
        f"{name}_rpm", "rpm", -_HIGHEST_RPM, _HIGHEST_RPM, "command", f"{_words(name)} shaft, negative in reverse"
    )


def _azimuth(name: str) -> Channel:
    meaning = f"{_words(name)} azimuth, positive turns the thrust to starboard"
    return circle(f"{name}_angle_deg", "command", meaning, -180.0)


def _end(name: str) -> str:
    return "stern" if "stern" in name or "aft" in name else "bow"


def _tunnel(name: str) -> Channel:
    meaning = f"{_words(name)} thruster, positive pushes the {_end(name)} to starboard"
    return Channel(f"{name}_rpm", "rpm", -_HIGHEST_RPM, _HIGHEST_RPM, "command", meaning)


def _rudder(name: str) -> Channel:
    meaning = f"{_words(name)} angle, positive turns the ship to starboard"
    return Channel(f"{name}_angle_deg", "deg", -90.0, 90.0, "command", meaning)


def _pitch(name: str) -> Channel:
    meaning = f"{_words(name)} pitch, of the full one ahead, negative astern"
    return Channel(f"{name}_pitch_percent", "%", -150.0, 150.0, "command", meaning)


def _nozzle(name: str) -> Channel:
    meaning = f"{_words(name)} nozzle, positive turns the jet's thrust to starboard"
    return Channel(f"{name}_angle_deg", "deg", -90.0, 90.0, "command", meaning)


@dataclass(frozen=True, slots=True)
class Kind:
    """What a kind of actuator is to a recording and to who handles the ship.

    ``channels`` make its control channels from its name, ``parts`` are what these are called in an order. One
    that ``drives`` is there to push the ship ahead. ``turns`` is how a positive angle of it, astern, turns the
    ship: 1 to starboard, -1 to port, 0 where it has no angle.
    """

    channels: tuple[Callable[[str], Channel], ...]
    parts: tuple[str, ...]
    drives: bool = False
    turns: float = 0.0


KINDS: dict[str, Kind] = {
    "azimuth": Kind((_shaft, _azimuth), ("shaft", "azimuth"), drives=True, turns=-1.0),
    "tunnel": Kind((_tunnel,), ("tunnel thruster",)),
    "propeller": Kind((_shaft,), ("shaft",), drives=True),
    "controllable_propeller": Kind((_shaft, _pitch), ("shaft", "pitch"), drives=True),
    "rudder": Kind((_rudder,), ("rudder",), turns=1.0),
    "waterjet": Kind((_shaft, _nozzle), ("shaft", "nozzle"), drives=True, turns=-1.0),
}
"""The kinds of actuators; what their forces are is in ``hybrid/vessel/actuators``."""

_ENDINGS = ("_rpm", "_angle_deg", "_pitch_percent")
"""How the names of control channels end."""

_ASIDE = ("tunnel", "thruster", "bow", "stern", "aft", "fore")
"""Parts of the names of thrusters that push sideways, where nothing tells the kind."""


def _by_rule(stem: str, ending: str) -> Channel:
    """What a control channel is where the actuator's kind is not known."""
    angle = _rudder if "rudder" in stem else _azimuth
    return {"_rpm": _shaft, "_angle_deg": angle, "_pitch_percent": _pitch}[ending](stem)


def _kind_by_rule(stem: str, endings: set[str]) -> str:
    """The kind of an actuator that is known by its channels only."""
    if "_angle_deg" in endings:
        return "azimuth" if "_rpm" in endings else "rudder"
    if "_pitch_percent" in endings:
        return "controllable_propeller"
    return "tunnel" if any(part in stem for part in _ASIDE) else "propeller"


def name_of_order(control: str) -> str:
    """The channel of the orders to a control channel: ``port_rpm`` is ordered as ``port_order_rpm``."""
    ending = next(each for each in _ENDINGS if control.endswith(each))
    return f"{control.removesuffix(ending)}{_ORDER}{ending}"


def channel_by_rule(name: str) -> Channel | None:
    """The control or order channel that a name stands for by its ending, of whatever ship; None for another."""
    for ending in _ENDINGS:
        stem = name.removesuffix(ending)
        if stem == name or not NAME_PATTERN.fullmatch(stem):
            continue
        if stem.endswith(_ORDER):
            of = _by_rule(stem.removesuffix(_ORDER), ending)
            return Channel(name, of.unit, of.low, of.high, "auxiliary", f"Order: {of.meaning}", of.circular)
        return _by_rule(stem, ending)
    return None


def check_actuators(actuators: Iterable[Actuator]) -> Actuators:
    """``actuators`` as a list that can be one ship's.

    Raises :class:`ConfigurationError` for no actuator at all, an unknown kind, a name that cannot be part of a
    channel's, and one that is there twice.
    """
    result = tuple(actuators)
    if not result:
        raise ConfigurationError("the ship has no actuator", fix="name one or more, each with name and kind")
    names = [each.name for each in result]
    for each in result:
        if each.kind not in KINDS:
            raise ConfigurationError(
                f"actuator {each.name}: no kind {each.kind!r}", fix=f"write one of {', '.join(KINDS)}"
            )
        if not NAME_PATTERN.fullmatch(each.name) or each.name.endswith(_ORDER):
            raise ConfigurationError(
                f"actuator name {each.name!r} cannot be part of a channel's name",
                fix=f"use small letters, digits and _, beginning with a letter and not ending in {_ORDER}",
            )
        if names.count(each.name) > 1:
            raise ConfigurationError(f"two actuators are called {each.name!r}", fix="give each its own name")
    return result


def names_of(actuators: Actuators, kind: str) -> tuple[str, ...]:
    """The names of the actuators of one kind."""
    return tuple(each.name for each in actuators if each.kind == kind)


def shafts(actuators: Actuators) -> tuple[str, ...]:
    """The names of the propulsors, which protocols know by a number; of a pair the port one is listed first."""
    return tuple(each.name for each in actuators if each.drives)


def rudders(actuators: Actuators) -> tuple[str, ...]:
    """The names of the rudders, which protocols know by a number; of a pair the port one is listed first."""
    return names_of(actuators, "rudder")


def rudder_channels(actuators: Actuators) -> tuple[str, ...]:
    """The channels of the rudder angles: those of the rudders, or the auxiliary one where none is listed."""
    return tuple(f"{name}_angle_deg" for name in rudders(actuators)) or (RUDDER,)


def numbered_shafts(actuators: Actuators) -> Actuators:
    """The propulsors that RPM and PRC (IEC 61162-1) tell of: those that TRD does not, or all where it tells of all.

    Listed from port to starboard; beyond three their numbers do not follow from the list.
    """
    thrusters = thruster_numbers(actuators)
    drives = tuple(each for each in actuators if each.drives)
    return tuple(each for each in drives if each.name not in thrusters) or drives


def shaft_numbers(numbered: Actuators) -> dict[str, int]:
    """The number of each shaft in RPM and PRC: from the centre line odd to starboard, even to port, 0 on it."""
    numbers = {1: (0,), 2: (2, 1), 3: (2, 0, 1)}.get(len(numbered), ())
    return {each.name: number for each, number in zip(numbered, numbers, strict=False)}


def shaft_of_number(number: float | None, numbered: Actuators) -> Actuator | None:
    """The shaft that a number in RPM or PRC means; None for no number of hers. A single one may be 0 or 1."""
    if number is None or number < 0 or number % 1 or not 1 <= len(numbered) <= 3:
        return None
    if number == 0 or len(numbered) == 1:
        return numbered[len(numbered) // 2] if len(numbered) % 2 and number <= 1 else None
    return numbered[-1] if number % 2 else numbered[0]


def thruster_numbers(actuators: Actuators) -> dict[str, int]:
    """The number of each thruster in TRD and TRC (IEC 61162-1), in order: odd at the bow, even at the stern."""
    stern, bow = count(2, 2), count(1, 2)
    thrusters = (each for each in actuators if each.kind in ("azimuth", "tunnel"))
    return {each.name: next(bow if each.is_at_bow else stern) for each in thrusters}


@lru_cache(maxsize=64)
def control_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The control channels of a ship, actuator by actuator."""
    return tuple(channel for each in actuators for channel in each.channels)


@lru_cache(maxsize=64)
def control_names(actuators: Actuators) -> tuple[str, ...]:
    """The names of a ship's control channels."""
    return tuple(channel.name for channel in control_channels(actuators))


def kind_of_control(name: str, actuators: Actuators) -> str:
    """The kind of the actuator that a control channel belongs to. Raises :class:`KeyError` for none."""
    return {channel.name: each.kind for each in actuators for channel in each.channels}[name]


def part_of_control(name: str, actuators: Actuators) -> str:
    """What a control channel is of its actuator: a shaft, an azimuth, a rudder ... as an order to it is called.

    Raises :class:`KeyError` for a channel that is no control of the ship.
    """
    parts = {each.name: zip(KINDS[each.kind].parts, each.channels, strict=True) for each in actuators}
    return {channel.name: part for pairs in parts.values() for part, channel in pairs}[name]


@lru_cache(maxsize=64)
def order_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The auxiliary channels of the orders to a ship's actuators."""
    return tuple(channel for each in actuators for channel in each.orders)


def actuators_in(names: Iterable[str]) -> Actuators:
    """The actuators whose control channels are among ``names``, of the kinds that their channels and names tell.

    In the order in which they come; channels that a fixed meaning is known for are no control channels.
    """
    stems: dict[str, set[str]] = {}
    for name in names:
        channel = channel_by_rule(name)
        if channel is not None and channel.group == "command":
            ending = next(each for each in _ENDINGS if name.endswith(each))
            stems.setdefault(name.removesuffix(ending), set()).add(ending)
    return tuple(Actuator(stem, _kind_by_rule(stem, endings)) for stem, endings in stems.items())


def as_text(actuators: Actuators) -> str:
    """A list of actuators as a recording's metadata says it; empty for the default list."""
    return "" if actuators == DEFAULT else ", ".join(f"{each.name}:{each.kind}" for each in actuators)


@lru_cache(maxsize=64)
def from_text(text: str) -> Actuators:
    """The inverse of :func:`as_text`. Raises :class:`ConfigurationError` for what is no list of actuators."""
    if not text:
        return DEFAULT
    parts = [part.strip().partition(":") for part in text.split(",")]
    return check_actuators(Actuator(name, kind) for name, _, kind in parts)


def _default() -> Actuators:
    tree = tomllib.loads((VESSELS / f"{DEFAULT_VESSEL}.toml").read_text(encoding="utf-8"))
    return check_actuators(Actuator(each["name"], each["kind"]) for each in tree["actuator"])


DEFAULT: Actuators = _default()
"""The actuators of the vessel whose recordings do not say theirs: R/V Gunnerus', from her vessel file."""
