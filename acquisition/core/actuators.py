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
        return tuple(make(self.name) for make in KINDS[self.kind])

    @property
    def is_at_bow(self) -> bool:
        """Whether it is a tunnel thruster whose name does not say that it is aft."""
        return self.kind == "tunnel" and _end(self.name) == "bow"

    @property
    def orders(self) -> tuple[Channel, ...]:
        """The auxiliary channels of the orders to this actuator."""
        kind = {"deg": "azimuth", "rpm": "shaft" if len(KINDS[self.kind]) > 1 else f"{self.kind} thruster"}
        place = "" if self.name == self.kind else f"{self.name.replace('_', ' ')} "
        return tuple(
            Channel(name_of_order(each.name), each.unit, each.low, each.high, "auxiliary",
                    f"Order to the {place}{kind[each.unit]}", each.circular)
            for each in self.channels
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


KINDS: dict[str, tuple[Callable[[str], Channel], ...]] = {"azimuth": (_shaft, _azimuth), "tunnel": (_tunnel,)}
"""The control channels of an actuator of each kind, made from its name."""

_BY_RULE: dict[str, Callable[[str], Channel]] = {"_rpm": _shaft, "_angle_deg": _azimuth}
"""How the name of a control channel ends, and what it is where the actuator's kind is not known."""


def name_of_order(control: str) -> str:
    """The channel of the orders to a control channel: ``port_rpm`` is ordered as ``port_order_rpm``."""
    ending = next(each for each in _BY_RULE if control.endswith(each))
    return f"{control.removesuffix(ending)}{_ORDER}{ending}"


def channel_by_rule(name: str) -> Channel | None:
    """The control or order channel that a name stands for by its ending, of whatever ship; None for another."""
    for ending, make in _BY_RULE.items():
        stem = name.removesuffix(ending)
        if stem == name or not NAME_PATTERN.fullmatch(stem):
            continue
        if stem.endswith(_ORDER):
            of = make(stem.removesuffix(_ORDER))
            return Channel(name, of.unit, of.low, of.high, "auxiliary", f"Order: {of.meaning}", of.circular)
        return make(stem)
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
    return tuple(each.name for each in actuators if each.kind != "tunnel")


def thruster_numbers(actuators: Actuators) -> dict[str, int]:
    """The number of each actuator in TRD and TRC (IEC 61162-1), in order: odd at the bow, even at the stern."""
    stern, bow = count(2, 2), count(1, 2)
    return {each.name: next(bow if each.is_at_bow else stern) for each in actuators}


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


@lru_cache(maxsize=64)
def order_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The auxiliary channels of the orders to a ship's actuators."""
    return tuple(channel for each in actuators for channel in each.orders)


def actuators_in(names: Iterable[str]) -> Actuators:
    """The actuators whose control channels are among ``names``, by rule: one with an angle is an azimuth thruster.

    In the order in which they come; channels that a fixed meaning is known for are no control channels.
    """
    stems: dict[str, set[str]] = {}
    for name in names:
        channel = channel_by_rule(name)
        if channel is not None and channel.group == "command":
            ending = next(each for each in _BY_RULE if name.endswith(each))
            stems.setdefault(name.removesuffix(ending), set()).add(ending)
    return tuple(Actuator(stem, "azimuth" if "_angle_deg" in has else "tunnel") for stem, has in stems.items())


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


def load_actuators(vessel: str | Path) -> Actuators:
    """The names and kinds of the actuators in a vessel file, or in that of a name in :data:`VESSELS`.

    Raises :class:`ConfigurationError` for what is no vessel file and for a list that cannot be one ship's.
    """
    named = VESSELS / f"{vessel}.toml"
    path = named if named.is_file() else Path(vessel)
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
        base = {each.name: each for each in load_actuators(path.parent / tree["base"])} if tree.get("base") else {}
        own = {each["name"]: Actuator(each["name"], each.get("kind", "")) for each in tree.get("actuator", ())}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigurationError("is no vessel file", where=str(vessel), why=str(error)) from error
    return check_actuators((base | {name: each for name, each in own.items() if name not in base}).values())


DEFAULT: Actuators = load_actuators(DEFAULT_VESSEL)
"""The actuators of the vessel whose recordings do not say theirs: R/V Gunnerus', from her vessel file."""
