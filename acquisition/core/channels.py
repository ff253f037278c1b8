"""The channels of a trial, as data.

Columns, topics, schema texts, range checks and circular treatment all derive from the channels. Those of motion
and wind are fixed; those of the actuators follow from the ship's list (:mod:`seatrial.acquisition.core.actuators`):
``CHANNELS`` are the 13 of the default list, R/V Gunnerus'. Frames and signs: north-east-down earth frame; body
frame x forward, y to starboard; yaw positive to starboard; azimuth angles positive when the thrust vector turns
to starboard; wind direction is where the wind comes from.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import Any

from seatrial.acquisition.core.actuators import (
    DEFAULT,
    RUDDER,
    SHIPPED,
    Actuators,
    actuators_in,
    channel_by_rule,
    control_channels,
    control_names,
    from_text,
    order_channels,
    rudders,
)
from seatrial.acquisition.core.channel import Channel, circle
from seatrial.acquisition.core.declared import Declared, declared_from_text
from seatrial.acquisition.core.trial import Trial

MOTION_CHANNELS: tuple[Channel, ...] = (
    Channel("north_m", "m", -1e6, 1e6, "pose", "Position north of the trial's origin"),
    Channel("east_m", "m", -1e6, 1e6, "pose", "Position east of the trial's origin"),
    circle("heading_deg", "pose", "Heading from true north, clockwise"),
    Channel("surge_mps", "m/s", -30, 30, "velocity", "Speed over ground along the bow"),
    Channel("sway_mps", "m/s", -30, 30, "velocity", "Speed over ground to starboard"),
    Channel("yaw_rate_dps", "deg/s", -60, 60, "velocity", "Rate of turn, positive to starboard"),
    circle("wind_direction_deg", "environment", "Direction the wind comes from, from true north"),
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
    circle("course_over_ground_deg", "auxiliary", "Course over ground from true north, clockwise"),
    circle("heading_magnetic_deg", "auxiliary", "Heading from magnetic north, clockwise"),
    Channel("magnetic_variation_deg", "deg", -180, 180, "auxiliary", "Magnetic variation, positive to the east"),
    circle("apparent_wind_angle_deg", "auxiliary", "Direction the wind on board comes from, from the bow"),
    Channel("apparent_wind_speed_mps", "m/s", 0, 100, "auxiliary", "Wind speed on board"),
    Channel(RUDDER, "deg", -90, 90, "auxiliary", "Rudder, positive turns the ship to starboard"),
)

CHANNELS: tuple[Channel, ...] = (*MOTION_CHANNELS, *control_channels(DEFAULT))
"""The 13 channels of the default list of actuators, in their contractual order."""

AUXILIARY: tuple[Channel, ...] = (*_AUXILIARY, *order_channels(DEFAULT))
"""Channels that may be recorded in addition to the 13; they never replace one of them."""


class ChannelsByName(dict[str, Channel]):
    """The channels of the default list by name; those of other ships' actuators are found by rule.

    ``in`` and iteration cover the default list only: what else a ship has follows from her list of actuators
    (:func:`channel_names`). Raises :class:`KeyError` for what is no channel of any ship.
    """

    def __missing__(self, name: str) -> Channel:
        channel = channel_by_rule(name)
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


def is_setting(channel: Channel) -> bool:
    """Whether a channel is a setting: a control of any ship, an order to one, or the rudder."""
    if channel.group == "declared":
        return False
    return channel.name == RUDDER or (channel.name not in _FIXED and channel_by_rule(channel.name) is not None)


def find_channel(name: str, known: ChannelsByName = BY_NAME) -> Channel | None:
    """The channel of this name, of any ship; None for a column that is no channel."""
    return known.get(name) or channel_by_rule(name)


def channel_unit(name: str, known: ChannelsByName = BY_NAME) -> str:
    """The unit of a channel of any ship; empty for a column that is no channel."""
    channel = find_channel(name, known)
    return channel.unit if channel else ""


def is_circular(name: str) -> bool:
    """Whether a column is an angle that wraps; False for a column that is no channel."""
    channel = find_channel(name)
    return channel is not None and channel.circular


@lru_cache(maxsize=64)
def with_declared(declared: Declared) -> ChannelsByName:
    """The channels by name, including those that a trial declares."""
    return ChannelsByName({**BY_NAME, **{channel.name: channel for channel in declared}}) if declared else BY_NAME


def declared_in(attributes: Mapping[Any, Any]) -> Declared:
    """The channels that the trial of a table declares, from the ``attrs`` of the table."""
    return declared_from_text((attributes.get("trial") or {}).get("channels") or "")


def known_channels(attributes: Mapping[Any, Any]) -> ChannelsByName:
    """The channels by name, including those that the trial of a table declares, from its ``attrs``."""
    return with_declared(declared_in(attributes))


def channels_known_to(trial: Trial) -> ChannelsByName:
    """The channels by name, including those that a trial declares."""
    return with_declared(declared_from_text(trial.channels))


def channels_of_trial(trial: Trial) -> dict[str, Channel]:
    """Every channel that a recording of a trial may have, by name, in order."""
    channels, declared = channels_known_to(trial), declared_from_text(trial.channels)
    return {name: channels[name] for name in channel_names(from_text(trial.actuators), declared)}


def channels_of_table(columns: Iterable[Any], attributes: Mapping[Any, Any]) -> dict[str, Channel]:
    """Every channel that a table may have, by name, in order: from its ``attrs``, else from its columns."""
    channels, declared = known_channels(attributes), declared_in(attributes)
    return {name: channels[name] for name in channel_names(actuators_of(columns, attributes), declared)}


@lru_cache(maxsize=64)
def trial_names(actuators: Actuators) -> tuple[str, ...]:
    """The channels of a trial of a ship with these actuators: motion, wind, controls."""
    return (*MOTION, *control_names(actuators))


def is_ship_known(vessel: str, actuators: str) -> bool:
    """Whether a trial says which actuators its ship has: by a list, or by the name of one of Seatrial's vessels."""
    return bool(actuators) or vessel.removesuffix(".toml").rpartition("/")[2] in SHIPPED


def required_names(actuators: Actuators, present: Collection[str], *, known: bool) -> tuple[str, ...]:
    """The channels that a trial of a ship with these actuators has to have.

    Of a ship that is not ``known`` no control can be missing: those ``present`` are all.
    """
    return (*MOTION, *(name for name in control_names(actuators) if known or name in present))


@lru_cache(maxsize=64)
def channel_names(actuators: Actuators, declared: Declared = ()) -> tuple[str, ...]:
    """Every channel that a recording of a ship with these actuators may have, once each: those of the trial,
    auxiliary ones, orders, and ``declared`` ones.

    A ship with listed rudders has no auxiliary rudder.
    """
    orders = (channel.name for channel in order_channels(actuators))
    auxiliary = (channel.name for channel in _AUXILIARY if channel.name != RUDDER or not rudders(actuators))
    return (*trial_names(actuators), *auxiliary, *orders, *(channel.name for channel in declared))


def actuators_of(columns: Iterable[Any], attributes: Mapping[Any, Any] | None = None) -> Actuators:
    """The actuators of a table: from its ``attrs``, else by rule from its columns, else the default list.

    A table whose control columns all belong to the default list is one of that ship, even if some are missing;
    a rudder among them is then an auxiliary channel, unless nothing else steers.
    """
    text = ((attributes or {}).get("trial") or {}).get("actuators", "")
    if text:
        return from_text(text)
    fixed_names = (_FIXED - {RUDDER}) | {channel.name for channel in declared_in(attributes or {})}
    inferred = actuators_in(name for name in map(str, columns) if name not in fixed_names)
    driving = tuple(actuator for actuator in inferred if actuator.channels[0].name != RUDDER)
    steers = bool(driving) and len(driving) < len(inferred) and not any(actuator.angle for actuator in driving)
    is_default = {actuator.name for actuator in driving} <= {actuator.name for actuator in DEFAULT} and not steers
    return DEFAULT if is_default else inferred
