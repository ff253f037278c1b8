"""The channels of a trial, as data: columns, topics, schema texts and range checks all derive from them.

Those of motion and wind are fixed. Those of the controls and their orders follow from the ship's list of
actuators and are defined nowhere else: an actuator's kind gives its controls (:data:`KINDS`), its name the names
of their channels; ``CHANNELS`` are the 13 of the default list, R/V Gunnerus', read from its vessel file. A user
may declare others, which are treated like them; their definition is stored in the recording, since it is nowhere
else. The last part is angles in degrees on the circle: its functions take floats or arrays, return the same
shape, and pass NaN through.

Frames and signs: north-east-down earth frame; body frame x forward, y to starboard; yaw positive to starboard;
azimuth angles positive when the thrust vector turns to starboard; wind direction is where the wind comes from.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from seatrial.acquisition.core import files
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, canonical_unit, name_ending_of_unit
from seatrial.acquisition.core.trial import Trial

VESSELS = Path(__file__).parents[2] / "trials" / "vessels"
"""The folder of the vessel files that come with Seatrial."""

DEFAULT_VESSEL = "gunnerus_short"
SHIPPED = frozenset(path.stem for path in VESSELS.glob("*.toml"))
"""The names of the vessel files that come with Seatrial."""
RUDDER = "rudder_angle_deg"
"""The auxiliary rudder channel of a ship whose list of actuators has no rudder."""

NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]*")
_ORDER = "_order"
_ENDINGS = ("_rpm", "_angle_deg", "_pitch_percent")
"""The endings of the names of control channels."""
_SIDEWAYS = ("tunnel", "thruster", "bow", "stern", "aft", "fore")
"""Parts of the names of thrusters that push sideways, used where the kind is not stated."""
_CHANNEL_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_UNIT = re.compile(r"[A-Za-z0-9%/^.*-]{1,20}")
_MOST_LETTERS = 60
_TURN_DEG = 360.0
_LEAST_STAY = 5
_SEAM_DEG = 170.0  # codes for no value, -1 to -99, are far from the seam of -180..180


Group = Literal["pose", "velocity", "environment", "command", "auxiliary", "declared"]


@dataclass(frozen=True, slots=True)
class Channel:
    """A quantity with its unit and the range of its possible values.

    ``low`` and ``high`` are inclusive, except for angles: their range is one turn, which includes the end that
    ``conventions`` gives (0 <= x < 360, or -180 < x <= 180). A ``state`` is a code or a count that keeps its
    value until the next one and is never interpolated.
    """

    name: str
    unit: str
    low: float
    high: float
    group: Group
    meaning: str
    circular: bool = False
    state: bool = False

    @property
    def topic(self) -> str:
        """The MCAP topic that carries this channel."""
        return f"/channel/{self.name}"

    def is_possible_value(self, value: float) -> bool:
        """Whether ``value`` [``unit``] is possible. NaN and infinities are not."""
        if not self.circular:
            return self.low <= value <= self.high
        if self.low < 0:
            return self.low < value <= self.high
        return self.low <= value < self.high

    def wrap_angle(self, value: float) -> float:
        """``value`` wrapped into this channel's turn; unchanged if the channel is no angle."""
        if not self.circular:
            return value
        if self.low < 0:
            return self.high - (self.high - value) % 360.0
        turned = value % 360.0
        return 0.0 if turned == 360.0 else turned  # -1e-20 % 360.0 is 360.0 in floating point


def angle_channel(name: str, group: Group, meaning: str) -> Channel:
    """A channel of an angle [deg] from 0 to 360."""
    return Channel(name, "deg", 0.0, 360.0, group, meaning, circular=True)


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
    def orders(self) -> tuple[Channel, ...]:
        """The auxiliary channels of the orders to this actuator."""
        order = f"Order to the {'' if self.name == self.kind else self.name.replace('_', ' ') + ' '}"
        return tuple(
            replace(channel, name=order_channel_name(channel.name), group="auxiliary", meaning=f"{order}{control}")
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
        meaning = self.meaning.format(name.replace("_", " ").capitalize(), end=_bow_or_stern(name))
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


def _bow_or_stern(name: str) -> str:
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


def drive_named(shaft: str, actuators: Actuators) -> Actuator | None:
    """The actuator that drives the ship and that a shaft's name means, None where none does or several may.

    It is the one of that name, else the one with that word in it, as ``port`` means ``port_propeller``; no name,
    ``main`` and a number mean a ship's only one.
    """
    drives = [actuator for actuator in actuators if actuator.drives]
    named = [actuator for actuator in drives if actuator.name == shaft]
    named = named or [actuator for actuator in drives if shaft in actuator.name.split("_")]
    if not named and (shaft in ("", "main") or shaft.isdigit()):
        named = drives
    return named[0] if len(named) == 1 else None


def order_channel_name(control: str) -> str:
    """The channel of the orders to a control channel: ``port_rpm`` is ordered as ``port_order_rpm``."""
    ending = next(suffix for suffix in _ENDINGS if control.endswith(suffix))
    return f"{control.removesuffix(ending)}{_ORDER}{ending}"


def is_order_channel(name: str) -> bool:
    """Whether a channel is the order to a control channel.

    >>> is_order_channel("rudder_order_angle_deg"), is_order_channel("rudder_angle_deg")
    (True, False)
    """
    return any(name.removesuffix(ending).endswith(_ORDER) for ending in _ENDINGS if name.endswith(ending))


def channel_from_name(name: str) -> Channel | None:
    """The control or order channel, of any ship, that a name denotes by its ending; None if it is no such name."""
    for ending in _ENDINGS:
        stem = name.removesuffix(ending)
        if stem == name or not NAME_PATTERN.fullmatch(stem):
            continue
        actuator = stem.removesuffix(_ORDER)
        angle = "rudder" if "rudder" in actuator else "azimuth"
        control = {"_rpm": "shaft", "_angle_deg": angle, "_pitch_percent": "pitch"}[ending]
        channel = CONTROLS[control].channel(actuator)
        if actuator == stem:
            return channel
        return replace(channel, name=name, group="auxiliary", meaning=f"Order: {channel.meaning}")
    return None


def check_actuators(actuators: Iterable[Actuator]) -> Actuators:
    """Check that ``actuators`` can be one ship's.

    Raises :class:`ConfigurationError` for an empty list, an unknown kind, a name that cannot be part of a
    channel's name, and a name used twice.
    """
    checked = tuple(actuators)
    if not checked:
        raise ConfigurationError("the ship has no actuator", fix="list at least one, each with name and kind")
    names = [actuator.name for actuator in checked]
    for actuator in checked:
        if actuator.kind not in KINDS:
            what = f"actuator {actuator.name}: no kind {actuator.kind!r}"
            raise ConfigurationError(what, fix=f"write one of {', '.join(KINDS)}")
        if not NAME_PATTERN.fullmatch(actuator.name) or actuator.name.endswith(_ORDER):
            fix = f"use small letters, digits and _, beginning with a letter and not ending in {_ORDER}"
            raise ConfigurationError(f"actuator name {actuator.name!r} cannot be part of a channel's name", fix=fix)
        if names.count(actuator.name) > 1:
            raise ConfigurationError(f"two actuators are called {actuator.name!r}", fix="give each its own name")
    return checked


def names_of_kind(actuators: Actuators, kind: str) -> tuple[str, ...]:
    """The names of the actuators of one kind."""
    return tuple(actuator.name for actuator in actuators if actuator.kind == kind)


def shafts(actuators: Actuators) -> tuple[str, ...]:
    """The names of the propulsors, which protocols number; of a pair the port one comes first."""
    return tuple(actuator.name for actuator in actuators if actuator.drives)


def rudder_names(actuators: Actuators) -> tuple[str, ...]:
    """The names of the rudders, which protocols number; of a pair the port one comes first."""
    return names_of_kind(actuators, "rudder")


def rudder_channels(actuators: Actuators) -> tuple[str, ...]:
    """The channels of the rudder angles: those of the listed rudders, or the auxiliary one if none is listed."""
    return tuple(f"{name}_angle_deg" for name in rudder_names(actuators)) or (RUDDER,)


def shafts_in_rpm_sentences(actuators: Actuators) -> Actuators:
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
    """The number of each thruster in TRD and TRC (IEC 61162-1), in order: odd at the bow, even at the stern.

    A tunnel thruster is at the bow unless its name places it aft.
    """
    stern, bow, numbers = count(2, 2), count(1, 2), {}
    for actuator in actuators:
        if actuator.kind in ("azimuth", "tunnel"):
            is_at_bow = actuator.kind == "tunnel" and _bow_or_stern(actuator.name) == "bow"
            numbers[actuator.name] = next(bow if is_at_bow else stern)
    return numbers


@lru_cache(maxsize=64)
def control_channels(actuators: Actuators) -> tuple[Channel, ...]:
    """The control channels of a ship, actuator by actuator."""
    return tuple(channel for actuator in actuators for channel in actuator.channels)


@lru_cache(maxsize=64)
def control_names(actuators: Actuators) -> tuple[str, ...]:
    """The names of a ship's control channels."""
    return tuple(channel.name for channel in control_channels(actuators))


def actuator_kind_of_channel(name: str, actuators: Actuators) -> str:
    """The kind of the actuator that a control channel belongs to. Raises :class:`KeyError` for none."""
    return {channel.name: actuator.kind for actuator in actuators for channel in actuator.channels}[name]


def control_kind_of_channel(name: str, actuators: Actuators) -> str:
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


def actuators_from_channel_names(names: Iterable[str]) -> Actuators:
    """The actuators whose control channels are among ``names``, with kinds inferred from channels and names.

    In order of appearance; channels with a fixed meaning are not control channels.
    """
    stems: dict[str, set[str]] = {}
    for name in names:
        channel = channel_from_name(name)
        if channel is not None and channel.group == "command":
            ending = next(suffix for suffix in _ENDINGS if name.endswith(suffix))
            stems.setdefault(name.removesuffix(ending), set()).add(ending)
    kinds = {}
    for stem, endings in stems.items():
        if "_angle_deg" in endings:
            kinds[stem] = "azimuth" if "_rpm" in endings else "rudder"
        elif "_pitch_percent" in endings:
            kinds[stem] = "controllable_propeller"
        else:
            kinds[stem] = "tunnel" if any(part in stem for part in _SIDEWAYS) else "propeller"
    return tuple(Actuator(stem, kind) for stem, kind in kinds.items())


def actuators_as_text(actuators: Actuators, *, omit_default: bool = True) -> str:
    """A list of actuators as text, as in a recording's metadata; the default list is usually left out, as ""."""
    if omit_default and actuators == DEFAULT:
        return ""
    return ", ".join(f"{actuator.name}:{actuator.kind}" for actuator in actuators)


@lru_cache(maxsize=64)
def parse_actuators(text: str) -> Actuators:
    """The inverse of :func:`actuators_as_text`. Raises :class:`ConfigurationError` for any other text."""
    if not text:
        return DEFAULT
    parts = [part.strip().partition(":") for part in text.split(",")]
    return check_actuators(Actuator(name, kind) for name, _, kind in parts)


_ENTRIES = tomllib.loads((VESSELS / f"{DEFAULT_VESSEL}.toml").read_text(encoding="utf-8"))["actuator"]
DEFAULT: Actuators = check_actuators(Actuator(entry["name"], entry["kind"]) for entry in _ENTRIES)
"""The actuators of recordings that do not state any: R/V Gunnerus', from its vessel file."""


MOTION_CHANNELS: tuple[Channel, ...] = (
    Channel("north_m", "m", -1e6, 1e6, "pose", "Position north of the trial's origin"),
    Channel("east_m", "m", -1e6, 1e6, "pose", "Position east of the trial's origin"),
    angle_channel("heading_deg", "pose", "Heading from true north, clockwise"),
    Channel("surge_mps", "m/s", -30, 30, "velocity", "Speed over ground along the bow"),
    Channel("sway_mps", "m/s", -30, 30, "velocity", "Speed over ground to starboard"),
    Channel("yaw_rate_dps", "deg/s", -60, 60, "velocity", "Rate of turn, positive to starboard"),
    angle_channel("wind_direction_deg", "environment", "Direction the wind comes from, from true north"),
    Channel("wind_speed_mps", "m/s", 0, 100, "environment", "Wind speed over ground"),
)
"""The channels of motion and wind, which every ship has."""

_AUXILIARY: tuple[Channel, ...] = (
    Channel("latitude_deg", "deg", -90, 90, "auxiliary", "Latitude, WGS 84"),
    Channel("longitude_deg", "deg", -180, 180, "auxiliary", "Longitude, WGS 84"),
    Channel("speed_through_water_mps", "m/s", -30, 30, "auxiliary", "Speed through the water along the bow"),
    Channel("roll_deg", "deg", -90, 90, "auxiliary", "Roll, positive to starboard"),
    Channel("pitch_deg", "deg", -90, 90, "auxiliary", "Pitch, positive bow up"),
    Channel("heave_m", "m", -100, 100, "auxiliary", "Heave, positive down"),
    Channel("speed_over_ground_mps", "m/s", 0, 30, "auxiliary", "Speed over ground along the course"),
    angle_channel("course_over_ground_deg", "auxiliary", "Course over ground from true north, clockwise"),
    angle_channel("heading_magnetic_deg", "auxiliary", "Heading from magnetic north, clockwise"),
    Channel("magnetic_variation_deg", "deg", -180, 180, "auxiliary", "Magnetic variation, positive to the east"),
    angle_channel("apparent_wind_angle_deg", "auxiliary", "Direction the wind on board comes from, from the bow"),
    Channel("apparent_wind_speed_mps", "m/s", 0, 100, "auxiliary", "Wind speed on board"),
    Channel(RUDDER, "deg", -90, 90, "auxiliary", "Rudder, positive turns the ship to starboard"),
)

CHANNELS: tuple[Channel, ...] = (*MOTION_CHANNELS, *control_channels(DEFAULT))
"""The 13 channels of the default list of actuators, in their contractual order."""

AUXILIARY: tuple[Channel, ...] = (*_AUXILIARY, *order_channels(DEFAULT))
"""Channels that may be recorded in addition to the 13; they never replace one of them."""


class ChannelsByName(dict[str, Channel]):
    """The channels of the default list by name; those of other ships' actuators are found by rule.

    ``in`` and iteration cover the default list only: what else a ship has follows from its list of actuators
    (:func:`channel_names`). Raises :class:`KeyError` for what is no channel of any ship.
    """

    def __missing__(self, name: str) -> Channel:
        channel = channel_from_name(name)
        if channel is None:
            raise KeyError(name)
        return channel


NAMES: tuple[str, ...] = tuple(channel.name for channel in CHANNELS)
BY_NAME = ChannelsByName({channel.name: channel for channel in (*CHANNELS, *AUXILIARY)})
POSE, VELOCITY, ENVIRONMENT, COMMAND = (
    tuple(channel.name for channel in CHANNELS if channel.group == group)
    for group in ("pose", "velocity", "environment", "command")
)
POSE_AND_VELOCITY: tuple[str, ...] = (*POSE, *VELOCITY)
MOTION: tuple[str, ...] = (*POSE_AND_VELOCITY, *ENVIRONMENT)
"""The channels that every ship has: position, motion, wind."""

_FIXED = frozenset(channel.name for channel in (*MOTION_CHANNELS, *_AUXILIARY))


CIRCULAR: frozenset[str] = frozenset(channel.name for channel in BY_NAME.values() if channel.circular)
"""The angles among the channels of the default list; for any ship use :func:`is_circular`."""


def is_held_setting(channel: Channel) -> bool:
    """Whether a channel is a setting: a control of any ship, an order to one, or the rudder."""
    if channel.group == "declared":
        return False
    return channel.name == RUDDER or (channel.name not in _FIXED and channel_from_name(channel.name) is not None)


def find_channel(name: str, channels: ChannelsByName = BY_NAME) -> Channel | None:
    """The channel of this name, of any ship; None for a column that is no channel."""
    return channels.get(name) or channel_from_name(name)


def channel_unit(name: str, channels: ChannelsByName = BY_NAME) -> str:
    """The unit of a channel of any ship; empty for a column that is no channel."""
    channel = find_channel(name, channels)
    return channel.unit if channel else ""


def is_circular(name: str) -> bool:
    """Whether a column is an angle that wraps; False for a column that is no channel."""
    channel = find_channel(name)
    return channel is not None and channel.circular


@lru_cache(maxsize=64)
def channels_with_declared(declared: Declared) -> ChannelsByName:
    """The channels by name, including those that a trial declares."""
    return ChannelsByName({**BY_NAME, **{channel.name: channel for channel in declared}}) if declared else BY_NAME


def declared_channels_of(source: Trial | Mapping[Any, Any]) -> Declared:
    """The channels that a trial declares: by the trial, or by the ``attrs`` of a table of it."""
    text = source.channels if isinstance(source, Trial) else (source.get("trial") or {}).get("channels")
    return parse_declared_channels(text or "")


def channels_by_name_of(source: Trial | Mapping[Any, Any]) -> ChannelsByName:
    """The channels by name, including those that a trial declares: by the trial, or by a table's ``attrs``."""
    return channels_with_declared(declared_channels_of(source))


def channels_of_trial(trial: Trial) -> dict[str, Channel]:
    """Every channel that a recording of a trial may have, by name, in order."""
    channels, declared = channels_by_name_of(trial), declared_channels_of(trial)
    return {name: channels[name] for name in channel_names(parse_actuators(trial.actuators), declared)}


def possible_channels_of_table(columns: Iterable[Any], attributes: Mapping[Any, Any]) -> dict[str, Channel]:
    """Every channel that a table may have, by name, in order: from its ``attrs``, else from its columns."""
    channels, declared = channels_by_name_of(attributes), declared_channels_of(attributes)
    return {name: channels[name] for name in channel_names(actuators_of_table(columns, attributes), declared)}


@lru_cache(maxsize=64)
def trial_channel_names(actuators: Actuators) -> tuple[str, ...]:
    """The channels of a trial of a ship with these actuators: motion, wind, controls."""
    return (*MOTION, *control_names(actuators))


def is_ship_known(vessel: str, actuators: str) -> bool:
    """Whether a trial states its ship's actuators: by a list, or by the name of one of Seatrial's vessels."""
    return bool(actuators) or vessel.removesuffix(".toml").rpartition("/")[2] in SHIPPED


def required_channel_names(
    actuators: Actuators, present: Collection[str], *, ship_is_known: bool
) -> tuple[str, ...]:
    """The channels that a trial of a ship with these actuators has to have.

    Of a ship that is not known no control can be missing: those ``present`` are all.
    """
    return (*MOTION, *(name for name in control_names(actuators) if ship_is_known or name in present))


@lru_cache(maxsize=64)
def channel_names(actuators: Actuators, declared: Declared = ()) -> tuple[str, ...]:
    """Every channel that a recording of a ship with these actuators may have, once each: those of the trial,
    auxiliary ones, orders, and ``declared`` ones.

    A ship with listed rudders has no auxiliary rudder.
    """
    orders = (channel.name for channel in order_channels(actuators))
    auxiliary = (channel.name for channel in _AUXILIARY if channel.name != RUDDER or not rudder_names(actuators))
    return (*trial_channel_names(actuators), *auxiliary, *orders, *(channel.name for channel in declared))


def actuators_of_table(columns: Iterable[Any], attributes: Mapping[Any, Any] | None = None) -> Actuators:
    """The actuators of a table: those that its ``attrs`` state, by a list or by the name of one of Seatrial's
    vessels, else by rule from its columns; none where no column is a control.

    Beside others that steer a rudder is an auxiliary channel.
    """
    trial = (attributes or {}).get("trial") or {}
    if is_ship_known(trial.get("vessel") or "", trial.get("actuators") or ""):
        return parse_actuators(trial.get("actuators") or "")
    fixed_names = (_FIXED - {RUDDER}) | {channel.name for channel in declared_channels_of(attributes or {})}
    inferred = actuators_from_channel_names(name for name in map(str, columns) if name not in fixed_names)
    thrusters = tuple(actuator for actuator in inferred if actuator.channels[0].name != RUDDER)
    steering = thrusters if any(actuator.angle for actuator in thrusters) else inferred
    return DEFAULT if set(steering) == set(DEFAULT) else steering


Declared = tuple[Channel, ...]
"""The channels that a trial declares."""


def declare(name: str, unit: str, low: float, high: float, meaning: str = "", state: bool = False) -> Channel:
    """A channel from a user's declaration; an angle whose range is one turn, from 0 or from -180, is circular.

    Parameters
    ----------
    name
        Small letters, digits and single ``_``, with the unit at its end, like ``fuel_rate_lph``.
    unit
        The unit, like "kW", "m3/h" or "kg/m3".
    low, high
        The values that are possible, in that unit; others are flagged bad.
    meaning
        What is measured; by default the name in words.
    state
        It is a state with steps, which is not interpolated.

    Returns
    -------
    Channel
        What :func:`seatrial.write` takes as ``declared``.

    Raises
    ------
    ConfigurationError
        For a name that cannot be part of a topic or does not end in its unit, an unreadable unit, and an empty
        range.

    Examples
    --------
    >>> import seatrial as st
    >>> fuel = st.declare("fuel_rate_lph", "l/h", 0.0, 500.0, "fuel of both engines")
    >>> table = st.read("trial.mcap").assign(fuel_rate_lph=80.0)
    >>> path = st.write(table, "fuel.mcap", declared=[fuel])
    >>> float(st.read(path)["fuel_rate_lph"].mean())
    80.0
    """
    unit = canonical_unit(unit)
    ending = name_ending_of_unit(unit)
    if not _UNIT.fullmatch(unit):
        what = f"unit {unit!r} of channel {name} is not known"
        raise ConfigurationError(what, fix="write it like kW, m3/h or kg/m3")
    if not _CHANNEL_NAME.fullmatch(name) or len(name) > _MOST_LETTERS:
        what = f"channel name {name!r} is not valid in a topic"
        why = f"it has other than small letters, digits and single _, or more than {_MOST_LETTERS} letters"
        raise ConfigurationError(what, why=why, fix="write it like fuel_rate_lph")
    if not name.endswith(ending):
        raise ConfigurationError(f"channel {name} is in {unit}", fix=f"let its name end in {ending}")
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ConfigurationError(f"range {low:g} to {high:g} of channel {name} holds nothing", fix="correct it")
    circular = unit == "deg" and high - low == _TURN_DEG and low in (0.0, -180.0) and not state
    return Channel(name, unit, low, high, "declared", meaning or name.replace("_", " "), circular, state)


def declared_channels_as_json(channels: Iterable[Channel]) -> str:
    """Declared channels as JSON for a recording's metadata; empty for none."""
    keys = "name", "unit", "low", "high", "meaning", "state"
    entries = [{key: getattr(channel, key) for key in keys} for channel in channels]
    return json.dumps(entries) if entries else ""


@lru_cache(maxsize=64)
def parse_declared_channels(text: str) -> Declared:
    """The inverse of :func:`declared_channels_as_json`; any other text declares none."""
    try:
        return tuple(declare(**entry) for entry in files.parse_json(text)) if text else ()
    except (ValueError, TypeError):
        return ()


def wrap_360(angle_deg: ArrayLike) -> Floats:
    """``angle_deg`` in 0 <= x < 360."""
    turned = np.mod(np.asarray(angle_deg, dtype=float), 360.0)
    return np.where(turned == 360.0, 0.0, turned)  # -1e-20 % 360.0 is 360.0 in floating point


def wrap_180(angle_deg: ArrayLike) -> Floats:
    """``angle_deg`` in -180 < x <= 180."""
    return 180.0 - np.mod(180.0 - np.asarray(angle_deg, dtype=float), 360.0)


def wrap_to_range(channel: Channel | None, values: ArrayLike) -> Floats:
    """Values of a channel wrapped to its range; unchanged if it is no angle or no channel."""
    if channel is None or not channel.circular:
        return np.asarray(values, dtype=float)
    return wrap_180(values) if channel.low < 0 else wrap_360(values)


def possible_mask(channel: Channel, values: Floats) -> Bools:
    """As :meth:`seatrial.acquisition.core.ship.Channel.is_possible_value`, for many values."""
    beyond_low = values > channel.low if channel.circular and channel.low < 0.0 else values >= channel.low
    below_high = values < channel.high if channel.circular and channel.low >= 0.0 else values <= channel.high
    return np.asarray(beyond_low & below_high)


def angle_mask(values: Floats) -> Bools:
    """A mask [n] of the angles [deg] of a series, in whatever turn, that are measurements, not codes for no value.

    They are where a part of the series, between steps of half a turn and more, has more than two values.
    """
    valid = np.flatnonzero(np.isfinite(values))
    steps = np.abs(np.diff(values[valid])) >= 180.0
    measured = np.zeros(values.size, np.bool_)
    for part in np.split(valid, np.flatnonzero(steps) + 1):
        measured[part] = np.unique(values[part]).size > 2
    return measured


def is_off_by_whole_turns(channel: Channel, values: Floats) -> bool:
    """Whether an angle's impossible values are those of the other convention, 0..360 for -180..180 or back, or are
    unwrapped angles.

    They are if all of them lie in that convention's turn and no possible one contradicts it, so that the two
    halves make one turn; at least three different values, or a code for no value would pass, but for headings a
    little beyond -180, where no code is. The closed end of the channel's turn, like a heading of 360, is always the
    same angle. An unwrapped series stays outside for a while; outliers and codes for no value are isolated.
    """
    values = values[np.isfinite(values)]
    impossible = ~possible_mask(channel, values)
    outside = values[impossible]
    if not channel.circular or not outside.size:
        return False
    closed_end = -180.0 if channel.low < 0.0 else 360.0
    halves = (-180.0, 0.0), (180.0, 360.0)
    (low, high), (other_low, other_high) = halves if channel.low < 0.0 else halves[::-1]
    contradicting = (values > low) & (values < high)
    in_other_turn = (outside >= other_low) & (outside < other_high)
    if (outside == closed_end).all():
        return True
    one_turn = bool((in_other_turn | (outside == closed_end)).all()) and not contradicting.any()
    beyond_south = channel.low >= 0.0 and bool((outside < -_SEAM_DEG).all())
    if one_turn and (np.unique(outside).size >= 3 or beyond_south):
        return True
    entries = int(np.sum(np.diff(impossible.astype(np.int8), prepend=0) == 1))
    return bool(angle_mask(values)[impossible].all()) and outside.size >= _LEAST_STAY * max(entries, 1)


def angle_difference(to_deg: ArrayLike, from_deg: ArrayLike) -> Floats:
    """The shortest rotation from one angle to another, -180 < x <= 180 [deg]."""
    return wrap_180(np.asarray(to_deg, dtype=float) - np.asarray(from_deg, dtype=float))


def unwrap(angle_deg: ArrayLike) -> Floats:
    """A series of angles without jumps of 360 deg; NaN stay NaN and do not break the series."""
    angles = np.array(angle_deg, dtype=float)
    valid = np.isfinite(angles)
    angles[valid] = np.unwrap(angles[valid], period=360.0)
    return angles


def full_circle_jumps(angle_deg: Floats) -> Ints:
    """The rows at which a plotted line would jump across the full circle.

    >>> full_circle_jumps(np.array([350.0, 359.0, 1.0, np.nan, 359.0]))
    array([2])
    """
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(np.abs(np.diff(angle_deg)) > 180.0) + 1


def circular_mean(angle_deg: ArrayLike, axis: int | None = None) -> Floats:
    """The direction of the mean unit vector, -180 < x <= 180 [deg], ignoring NaN."""
    radians = np.deg2rad(np.asarray(angle_deg, dtype=float))
    return wrap_180(np.rad2deg(np.arctan2(np.nanmean(np.sin(radians), axis), np.nanmean(np.cos(radians), axis))))
