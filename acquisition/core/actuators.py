"""A ship's actuators as a list of names and kinds, and the channels that follow from it.

The control channels of a recording, the channels of their orders, their units and ranges are defined nowhere
else: an actuator's kind gives its controls (:data:`KINDS`), its name the names of their channels. The default
list is R/V Gunnerus', read from her vessel file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from pathlib import Path

from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.errors import ConfigurationError

VESSELS = Path(__file__).parents[2] / "trials" / "vessels"
"""The folder of the vessel files that come with Seatrial."""

DEFAULT_VESSEL = "gunnerus_short"
SHIPPED = frozenset(path.stem for path in VESSELS.glob("*.toml"))
"""The names of the vessel files that come with Seatrial."""
RUDDER = "rudder_angle_deg"
"""The auxiliary rudder channel of a ship whose list of actuators has no rudder."""

NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]*")
_ORDER = "_order"


@dataclass(frozen=True, slots=True)
class Actuator:
    """An actuator: its name, which begins the names of its channels, and its kind, one of :data:`KINDS`."""

    name: str
    kind: str

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The control channels of this actuator."""
        return tuple(CONTROLS[control].channel(self.name) for control in KINDS[self.kind].controls)

    @property
    def noun(self) -> str:
        """The word for it: a thruster, a propeller, a rudder, a waterjet."""
        return KINDS[self.kind].noun

    @property
    def drives(self) -> bool:
        """Whether it is a propulsor."""
        return KINDS[self.kind].drives

    @property
    def angle(self) -> Channel | None:
        """The channel of its steering angle, None if it has none."""
        return next((channel for channel in self.channels if channel.unit == "deg"), None)

    @property
    def steers_by(self) -> str:
        """The control that is its steering angle: azimuth, rudder or nozzle; empty if it has none."""
        return next((control for control in KINDS[self.kind].controls if control in ANGLES), "")

    @property
    def is_at_bow(self) -> bool:
        """Whether it is a tunnel thruster whose name does not place it aft."""
        return self.kind == "tunnel" and _end(self.name) == "bow"

    @property
    def orders(self) -> tuple[Channel, ...]:
        """The auxiliary channels of the orders to this actuator."""
        order = f"Order to the {'' if self.name == self.kind else self.name.replace('_', ' ') + ' '}"
        return tuple(
            replace(channel, name=name_of_order(channel.name), group="auxiliary", meaning=f"{order}{control}")
            for control, channel in zip(KINDS[self.kind].controls, self.channels, strict=True)
        )


Actuators = tuple[Actuator, ...]
"""A ship's actuators, in the order of their control channels."""


@dataclass(frozen=True, slots=True)
class Control:
    """What a control of an actuator means to a recording: its channel's ending, unit, range from ``-high`` to
    ``high``, and meaning, in which ``{}`` is the actuator and ``{end}`` its end of the ship."""

    ending: str
    unit: str
    high: float
    meaning: str

    def channel(self, name: str) -> Channel:
        """The channel of this control of the actuator called ``name``."""
        meaning = self.meaning.format(name.replace("_", " ").capitalize(), end=_end(name))
        circular = self.high == 180.0
        return Channel(f"{name}{self.ending}", self.unit, -self.high, self.high, "command", meaning, circular)


CONTROLS: dict[str, Control] = {
    "shaft": Control("_rpm", "rpm", 3000, "{} shaft, negative in reverse"),
    "azimuth": Control("_angle_deg", "deg", 180.0, "{} azimuth, positive turns the thrust to starboard"),
    "tunnel thruster": Control("_rpm", "rpm", 3000, "{} thruster, positive pushes the {end} to starboard"),
    "rudder": Control("_angle_deg", "deg", 90.0, "{} angle, positive turns the ship to starboard"),
    "pitch": Control("_pitch_percent", "%", 150.0, "{} pitch, of the full one ahead, negative astern"),
    "nozzle": Control("_angle_deg", "deg", 90.0, "{} nozzle, positive turns the jet's thrust to starboard"),
}
"""The controls of actuators by name."""

ANGLES = ("azimuth", "rudder", "nozzle")
"""The controls that are steering angles."""


def _end(name: str) -> str:
    return "stern" if "stern" in name or "aft" in name else "bow"


@dataclass(frozen=True, slots=True)
class ActuatorKind:
    """What a kind of actuator means to a recording and to those who handle the ship.

    ``controls`` are the names of its controls in :data:`CONTROLS`, ``noun`` is the word for one of the kind. A kind
    that ``drives`` propels the ship. ``turns`` is the direction in which a positive angle of one at the stern
    turns the ship: 1 to starboard, -1 to port, 0 without an angle.
    """

    controls: tuple[str, ...]
    noun: str
    drives: bool = False
    turns: float = 0.0


KINDS: dict[str, ActuatorKind] = {
    "azimuth": ActuatorKind(("shaft", "azimuth"), "thruster", drives=True, turns=-1.0),
    "tunnel": ActuatorKind(("tunnel thruster",), "thruster"),
    "propeller": ActuatorKind(("shaft",), "propeller", drives=True),
    "controllable_propeller": ActuatorKind(("shaft", "pitch"), "propeller", drives=True),
    "rudder": ActuatorKind(("rudder",), "rudder", turns=1.0),
    "waterjet": ActuatorKind(("shaft", "nozzle"), "waterjet", drives=True, turns=-1.0),
}
"""The kinds of actuators; the force of each is in ``hybrid/vessel/actuators``, in a file of the kind's name."""

_ENDINGS = ("_rpm", "_angle_deg", "_pitch_percent")
"""The endings of the names of control channels."""

_ASIDE = ("tunnel", "thruster", "bow", "stern", "aft", "fore")
"""Parts of the names of thrusters that push sideways, used where the kind is not stated."""


def _by_rule(stem: str, ending: str) -> Channel:
    """The control channel of an actuator of unknown kind."""
    angle = "rudder" if "rudder" in stem else "azimuth"
    return CONTROLS[{"_rpm": "shaft", "_angle_deg": angle, "_pitch_percent": "pitch"}[ending]].channel(stem)


def _kind_by_rule(stem: str, endings: set[str]) -> str:
    if "_angle_deg" in endings:
        return "azimuth" if "_rpm" in endings else "rudder"
    if "_pitch_percent" in endings:
        return "controllable_propeller"
    return "tunnel" if any(part in stem for part in _ASIDE) else "propeller"


def name_of_order(control: str) -> str:
    """The channel of the orders to a control channel: ``port_rpm`` is ordered as ``port_order_rpm``."""
    ending = next(suffix for suffix in _ENDINGS if control.endswith(suffix))
    return f"{control.removesuffix(ending)}{_ORDER}{ending}"


def is_order(name: str) -> bool:
    """Whether a channel is the order to a control channel.

    >>> is_order("rudder_order_angle_deg"), is_order("rudder_angle_deg")
    (True, False)
    """
    return any(name.removesuffix(ending).endswith(_ORDER) for ending in _ENDINGS if name.endswith(ending))


def channel_by_rule(name: str) -> Channel | None:
    """The control or order channel, of any ship, that a name denotes by its ending; None if it is no such name."""
    for ending in _ENDINGS:
        stem = name.removesuffix(ending)
        if stem == name or not NAME_PATTERN.fullmatch(stem):
            continue
        if stem.endswith(_ORDER):
            of = _by_rule(stem.removesuffix(_ORDER), ending)
            return replace(of, name=name, group="auxiliary", meaning=f"Order: {of.meaning}")
        return _by_rule(stem, ending)
    return None


def check_actuators(actuators: Iterable[Actuator]) -> Actuators:
    """Check that ``actuators`` can be one ship's.

    Raises :class:`ConfigurationError` for an empty list, an unknown kind, a name that cannot be part of a
    channel's name, and a name used twice.
    """
    result = tuple(actuators)
    if not result:
        raise ConfigurationError("the ship has no actuator", fix="list at least one, each with name and kind")
    names = [actuator.name for actuator in result]
    for actuator in result:
        if actuator.kind not in KINDS:
            what = f"actuator {actuator.name}: no kind {actuator.kind!r}"
            raise ConfigurationError(what, fix=f"write one of {', '.join(KINDS)}")
        if not NAME_PATTERN.fullmatch(actuator.name) or actuator.name.endswith(_ORDER):
            fix = f"use small letters, digits and _, beginning with a letter and not ending in {_ORDER}"
            raise ConfigurationError(f"actuator name {actuator.name!r} cannot be part of a channel's name", fix=fix)
        if names.count(actuator.name) > 1:
            raise ConfigurationError(f"two actuators are called {actuator.name!r}", fix="give each its own name")
    return result


def names_of(actuators: Actuators, kind: str) -> tuple[str, ...]:
    """The names of the actuators of one kind."""
    return tuple(actuator.name for actuator in actuators if actuator.kind == kind)


def shafts(actuators: Actuators) -> tuple[str, ...]:
    """The names of the propulsors, which protocols number; of a pair the port one comes first."""
    return tuple(actuator.name for actuator in actuators if actuator.drives)


def rudders(actuators: Actuators) -> tuple[str, ...]:
    """The names of the rudders, which protocols number; of a pair the port one comes first."""
    return names_of(actuators, "rudder")


def rudder_channels(actuators: Actuators) -> tuple[str, ...]:
    """The channels of the rudder angles: those of the listed rudders, or the auxiliary one if none is listed."""
    return tuple(f"{name}_angle_deg" for name in rudders(actuators)) or (RUDDER,)


def numbered_shafts(actuators: Actuators) -> Actuators:
    """The propulsors reported by RPM and PRC (IEC 61162-1): those not in TRD, or all if TRD has all.

    From port to starboard; beyond three their numbers do not follow from the list.
    """
    thrusters = thruster_numbers(actuators)
    drives = tuple(actuator for actuator in actuators if actuator.drives)
    return tuple(drive for drive in drives if drive.name not in thrusters) or drives


def shaft_numbers(numbered: Actuators) -> dict[str, int]:
    """The number of each shaft in RPM and PRC: from the centre line odd to starboard, even to port, 0 on it."""
    numbers = {1: (0,), 2: (2, 1), 3: (2, 0, 1)}.get(len(numbered), ())
    return {shaft.name: number for shaft, number in zip(numbered, numbers, strict=False)}


def shaft_of_number(number: float | None, numbered: Actuators) -> Actuator | None:
    """The shaft with a number in RPM or PRC, None if the ship has no such shaft. A single shaft may be 0 or 1."""
    if number is None or number < 0 or number % 1 or not 1 <= len(numbered) <= 3:
        return None
    if number == 0 or len(numbered) == 1:
        return numbered[len(numbered) // 2] if len(numbered) % 2 and number <= 1 else None
    return numbered[-1] if number % 2 else numbered[0]


def thruster_numbers(actuators: Actuators) -> dict[str, int]:
    """The number of each thruster in TRD and TRC (IEC 61162-1), in order: odd at the bow, even at the stern."""
    stern, bow = count(2, 2), count(1, 2)
    thrusters = (actuator for actuator in actuators if actuator.kind in ("azimuth", "tunnel"))
    return {thruster.name: next(bow if thruster.is_at_bow else stern) for thruster in thrusters}


@lru_cache(maxsize=64)
def control_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The control channels of a ship, actuator by actuator."""
    return tuple(channel for actuator in actuators for channel in actuator.channels)


@lru_cache(maxsize=64)
def control_names(actuators: Actuators) -> tuple[str, ...]:
    """The names of a ship's control channels."""
    return tuple(channel.name for channel in control_channels(actuators))


def kind_of_control(name: str, actuators: Actuators) -> str:
    """The kind of the actuator that a control channel belongs to. Raises :class:`KeyError` for none."""
    return {channel.name: actuator.kind for actuator in actuators for channel in actuator.channels}[name]


def part_of_control(name: str, actuators: Actuators) -> str:
    """The name of a control channel's control: a shaft, an azimuth ... Raises :class:`KeyError` for none."""
    pairs = (
        pair
        for actuator in actuators
        for pair in zip(KINDS[actuator.kind].controls, actuator.channels, strict=True)
    )
    return {channel.name: control for control, channel in pairs}[name]


@lru_cache(maxsize=64)
def order_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The auxiliary channels of the orders to a ship's actuators."""
    return tuple(channel for actuator in actuators for channel in actuator.orders)


def actuators_in(names: Iterable[str]) -> Actuators:
    """The actuators whose control channels are among ``names``, with kinds inferred from channels and names.

    In order of appearance; channels with a fixed meaning are not control channels.
    """
    stems: dict[str, set[str]] = {}
    for name in names:
        channel = channel_by_rule(name)
        if channel is not None and channel.group == "command":
            ending = next(suffix for suffix in _ENDINGS if name.endswith(suffix))
            stems.setdefault(name.removesuffix(ending), set()).add(ending)
    return tuple(Actuator(stem, _kind_by_rule(stem, endings)) for stem, endings in stems.items())


def as_text(actuators: Actuators) -> str:
    """A list of actuators as text, as in a recording's metadata; empty for the default list."""
    return "" if actuators == DEFAULT else _listed(actuators)


def stated_text(actuators: Actuators, vessel: str) -> str:
    """As :func:`as_text` for a ship whose list is known; the default list is written out, too, unless ``vessel`` is
    the name of a ship that comes with Seatrial."""
    return as_text(actuators) or ("" if vessel in SHIPPED else _listed(actuators))


def _listed(actuators: Actuators) -> str:
    return ", ".join(f"{actuator.name}:{actuator.kind}" for actuator in actuators)


@lru_cache(maxsize=64)
def from_text(text: str) -> Actuators:
    """The inverse of :func:`as_text`. Raises :class:`ConfigurationError` for any other text."""
    if not text:
        return DEFAULT
    parts = [part.strip().partition(":") for part in text.split(",")]
    return check_actuators(Actuator(name, kind) for name, _, kind in parts)


_LISTED = tomllib.loads((VESSELS / f"{DEFAULT_VESSEL}.toml").read_text(encoding="utf-8"))["actuator"]
DEFAULT: Actuators = check_actuators(Actuator(entry["name"], entry["kind"]) for entry in _LISTED)
"""The actuators of recordings that do not state any: R/V Gunnerus', from her vessel file."""
