"""The parameter groups of NMEA 2000 that we decode: where their fields are, and one reader function a group.

Which of a ship's rudders and engines a message means is given by its instance: instances count from 0 in the
order of the ship's list, so that of a pair the port one is 0. No standard group has the speed of a shaft, nor a
propeller's pitch; those of engines and gearboxes stand for the speed where the reduction ratio is known.

Fields are named as in canboat's database and are in SI units and radians, positions in degrees. A field of a
number keeps its three highest raw values for "not available", "error" and nothing at all (reserved); lookups are
given as they are. Declared channels may be in any field of any group of NMEA 2000 and J1939: its place is in the
declaration or in canboat's database, as the ``nmea2000`` library carries it.
"""

from __future__ import annotations

import datetime as dt
import re
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import pi
from typing import Any, NamedTuple

from seatrial.acquisition.config.declarations import GroupField, errors_about_channel
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import DEG_PER_RAD, Linear
from seatrial.acquisition.core.ship import Actuators, Channel, name_of_order, rudder_channels, rudders, shafts
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.protocols import DeclaredReaders
from seatrial.acquisition.protocols.clock import utc_ns

ADDRESS_CLAIM = 60928
SYSTEM_TIME, TIME_AND_DATE, POSITION, GNSS_POSITION = 126992, 129033, 129025, 129029
RUDDER_GROUP, ENGINE_SPEED, GEARBOX = 127245, 127488, 127493
NOT_AVAILABLE, ERROR_VALUE = "not available", "error value"

Value = float | str
"""A number, or the reason why there is none."""
_DAY_S = 86_400
_FULL_TURN_RAD = 2 * pi + 1e-4  # rounded up to the wire's step
_NO_FIX, _NO_FIX_ERROR = 0, 14
_METHODS = range(1, 9)  # numbered as the fixes of GGA are
_SATELLITE_METHODS = range(1, 6)  # above them dead reckoning, manual input, simulator and what is not defined yet
_MEASURED_MODES = range(2)  # of 130577: autonomous and differential; above them estimated, simulated, manual
Values = list[tuple[str, Value]]
_NO_INSTANCE = 255
_NEUTRAL, _REVERSE = 1, 2
_BIT_RANGE = re.compile(r"(\d{1,4}):(\d{1,2})")
_MOST_BITS = 8 * 223
_NMEA2000_FROM = 0x1F000
_PROPRIETARY = (0xEF00, range(0xFF00, 0x10000))
_FAST = (0x1EF00, range(0x1FF00, 0x20000))
_NUMBERS = frozenset({"NUMBER", "DURATION", "TIME", "DATE"})
_CODES = frozenset({"LOOKUP", "INDIRECT_LOOKUP", "BITLOOKUP", "BINARY", "RESERVED"})


@dataclass(frozen=True, slots=True)
class Field:
    """One field: its first bit, its length in bits, and its step, which a lookup has not.

    The three highest values are none, of a ``j1939`` number all from 0xFB in its highest byte on (J1939-71).
    """

    start: int
    bits: int
    step: float | None = None
    signed: bool = False
    j1939: bool = False
    _ones: int = field(init=False, repr=False)
    _highest: int = field(init=False, repr=False)
    _reserved: int = field(init=False, repr=False)
    _absent: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        ones = (1 << self.bits) - 1
        highest = ones >> self.signed
        by_byte = self.j1939 and self.bits >= 8 and not self.signed
        limits = (0xFB << self.bits - 8, 0xFF << self.bits - 8) if by_byte else (highest - 2, highest)
        for name, value in zip(
            ("_ones", "_highest", "_reserved", "_absent"), (ones, highest, *limits), strict=True
        ):
            object.__setattr__(self, name, value)

    def read(self, raw: int) -> Value:
        """The field's value in a message that was read as one little-endian number."""
        value, highest = (raw >> self.start) & self._ones, self._highest
        if self.step is None:
            return value
        if self._reserved <= value <= highest:
            return NOT_AVAILABLE if value >= self._absent else ERROR_VALUE
        return (value if value <= highest else value - self._ones - 1) * self.step


class Message:
    """One whole message, ``raw`` as one little-endian number; a field is read when it is asked for."""

    __slots__ = ("_bits", "_fields", "raw")

    def __init__(self, fields: dict[str, Field], payload: bytes) -> None:
        self._fields = fields
        self.raw = int.from_bytes(payload, "little")
        self._bits = 8 * len(payload)

    def __getitem__(self, name: str) -> Value:
        return self.read(self._fields[name])

    def read(self, bit_field: Field) -> Value:
        """A field's value, or the reason why there is none."""
        return bit_field.read(self.raw) if bit_field.start + bit_field.bits <= self._bits else NOT_AVAILABLE

    def degrees(self, name: str) -> Value:
        """A field of radians in degrees."""
        value = self[name]
        return value if isinstance(value, str) else value * DEG_PER_RAD


_ANGLE_RAD, _SPEED_MPS, _FINE_SPEED_MPS, _TIME_S = 1e-4, 0.01, 0.001, 1e-4

FIELDS: dict[int, dict[str, Field]] = {
    SYSTEM_TIME: {"date": Field(16, 16, 1), "time": Field(32, 32, _TIME_S)},
    RUDDER_GROUP: {
        "instance": Field(0, 8, 1),
        "angleOrder": Field(16, 16, _ANGLE_RAD, signed=True),
        "position": Field(32, 16, _ANGLE_RAD, signed=True),
    },
    ENGINE_SPEED: {"instance": Field(0, 8), "speed": Field(8, 16, 0.25)},
    GEARBOX: {"instance": Field(0, 8), "transmissionGear": Field(8, 2)},
    127250: {
        "heading": Field(8, 16, _ANGLE_RAD),
        "deviation": Field(24, 16, _ANGLE_RAD, signed=True),
        "variation": Field(40, 16, _ANGLE_RAD, signed=True),
        "reference": Field(56, 2),
    },
    127251: {"rate": Field(8, 32, 3.125e-8, signed=True)},
    127257: {
        "pitch": Field(24, 16, _ANGLE_RAD, signed=True),
        "roll": Field(40, 16, _ANGLE_RAD, signed=True),
    },
    127258: {"variation": Field(32, 16, _ANGLE_RAD, signed=True)},
    128259: {"speedWaterReferenced": Field(8, 16, _SPEED_MPS)},
    POSITION: {"latitude": Field(0, 32, 1e-7, signed=True), "longitude": Field(32, 32, 1e-7, signed=True)},
    129026: {"cogReference": Field(8, 2), "cog": Field(16, 16, _ANGLE_RAD), "sog": Field(32, 16, _SPEED_MPS)},
    GNSS_POSITION: {
        "date": Field(8, 16, 1),
        "time": Field(24, 32, _TIME_S),
        "latitude": Field(56, 64, 1e-16, signed=True),
        "longitude": Field(120, 64, 1e-16, signed=True),
        "altitude": Field(184, 64, 1e-6, signed=True),
        "method": Field(252, 4),
    },
    TIME_AND_DATE: {"date": Field(0, 16, 1), "time": Field(16, 32, _TIME_S)},
    130306: {
        "windSpeed": Field(8, 16, _SPEED_MPS),
        "windAngle": Field(24, 16, _ANGLE_RAD),
        "reference": Field(40, 3),
    },
    130577: {
        "dataMode": Field(0, 4),
        "cogReference": Field(4, 2),
        "cog": Field(16, 16, _ANGLE_RAD),
        "sog": Field(32, 16, _SPEED_MPS),
    },
    130578: {
        "longitudinalSpeedWaterReferenced": Field(0, 16, _FINE_SPEED_MPS, signed=True),
        "longitudinalSpeedGroundReferenced": Field(32, 16, _FINE_SPEED_MPS, signed=True),
        "transverseSpeedGroundReferenced": Field(48, 16, _FINE_SPEED_MPS, signed=True),
    },
}
"""Those fields of each group that are read, by their names."""

SHORTEST_BYTES = {GNSS_POSITION: 43, 130577: 14, 130578: 8}
"""The groups that come in several frames, and the least length that each can have."""

FRAME_BYTES = 8
SHORT_FRAMES = {127258: 6}
"""Groups that some devices send without what is reserved at their end, and the length that they then have."""


class GroupReading(NamedTuple):
    """What a message reports.

    ``meaning`` distinguishes what one group may mean, ``instance`` is which of several equal things it is about,
    ``fix`` and ``height_m`` are a receiver's report of its fix, as in :class:`seatrial.acquisition.core.trial.Fix`.
    """

    values: Iterable[tuple[str, Value]]
    meaning: str = ""
    quality: Quality = Quality.NOT_EVALUATED
    instance: int | None = None
    fix: int | None = None
    height_m: float | None = None


def available(values: Values) -> Values:
    """Without the values that are missing, where a device need not give them."""
    return [(name, value) for name, value in values if not isinstance(value, str)]


def group_time(message: Message) -> int | None:
    """A message's date and time as ns since 1970; None if it does not state them."""
    days, seconds = message["date"], message["time"]
    if isinstance(days, str) or isinstance(seconds, str) or seconds >= _DAY_S + 1:  # a leap second is possible
        return None
    return utc_ns(dt.date(1970, 1, 1) + dt.timedelta(days=days), seconds)


def _heading(message: Message) -> GroupReading:
    reference, heading = message["reference"], message["heading"]
    variation = available([("magnetic_variation_deg", message.degrees("variation"))])
    if reference == 0:
        return GroupReading([("heading_deg", message.degrees("heading")), *variation])
    if reference != 1:
        return GroupReading([("heading_deg", "heading without a reference")])
    return GroupReading([("heading_magnetic_deg", _deviated_deg(heading, message["deviation"])), *variation])


def _deviated_deg(heading: Value, deviation: Value) -> Value:
    """A compass heading with its deviation, within a turn unless the heading itself is beyond one [deg]."""
    if isinstance(heading, str):
        return heading
    if isinstance(deviation, str) or heading > _FULL_TURN_RAD:
        return heading * DEG_PER_RAD
    if abs(deviation) > pi:
        return "impossible deviation"
    return (heading + deviation) * DEG_PER_RAD % 360.0


def _position(message: Message) -> GroupReading:
    """Both coordinates, or why there is none: one alone is of no use."""
    position: Values = [("latitude_deg", message["latitude"]), ("longitude_deg", message["longitude"])]
    return GroupReading([pair for pair in position if isinstance(pair[1], str)] or position)


def _gnss_position(message: Message) -> GroupReading:
    """A position without a fix repeats an old one or invents one."""
    method = message["method"]
    if method in (_NO_FIX, _NO_FIX_ERROR):
        return GroupReading([("latitude_deg", "no fix")], quality=Quality.MISSING, fix=0)
    quality = Quality.NOT_EVALUATED if method in _SATELLITE_METHODS else Quality.SUSPECT
    fix = int(method) if method in _METHODS else None
    altitude = message["altitude"]
    height_m = None if isinstance(altitude, str) else altitude
    return GroupReading(_position(message).values, quality=quality, fix=fix, height_m=height_m)


def _course_and_speed(message: Message) -> GroupReading:
    course = {0: "course_over_ground_deg", 1: "course_magnetic_deg"}.get(int(message["cogReference"]))
    value = message.degrees("cog")
    if course is None:
        course, value = "course_over_ground_deg", value if isinstance(value, str) else "course without a reference"
    return GroupReading([(course, value), ("speed_over_ground_mps", message["sog"])])


_WINDS = {
    0: ("wind_direction_deg", "wind_speed_mps", ""),
    1: ("wind_direction_magnetic_deg", "wind_speed_mps", "magnetic"),
    2: ("wind_angle_apparent_deg", "wind_speed_apparent_mps", "apparent"),
    3: ("wind_angle_theoretical_deg", "wind_speed_theoretical_mps", "theoretical"),
    4: ("wind_angle_water_deg", "wind_speed_water_mps", "water"),
}


def _wind(message: Message) -> GroupReading:
    channels = _WINDS.get(int(message["reference"]))
    if channels is None:
        return GroupReading([("wind_speed_mps", "wind without a reference")])
    angle, speed, meaning = channels
    return GroupReading([(angle, message.degrees("windAngle")), (speed, message["windSpeed"])], meaning)


Reader = Callable[[Message], GroupReading]
READERS: dict[int, Reader] = {
    SYSTEM_TIME: lambda message: GroupReading([]),
    127250: _heading,
    127251: lambda message: GroupReading([("yaw_rate_dps", message.degrees("rate"))]),
    # the yaw does not say which north it refers to
    127257: lambda message: GroupReading([(f"{name}_deg", message.degrees(name)) for name in ("roll", "pitch")]),
    127258: lambda message: GroupReading([("magnetic_variation_deg", message.degrees("variation"))]),
    128259: lambda message: GroupReading([("speed_through_water_mps", message["speedWaterReferenced"])]),
    POSITION: _position,
    129026: _course_and_speed,
    GNSS_POSITION: _gnss_position,
    TIME_AND_DATE: lambda message: GroupReading([]),
    130306: _wind,
    # course and speed only: heading, set and drift are computed by the device from other devices' data
    130577: lambda message: _course_and_speed(message)._replace(
        quality=Quality.NOT_EVALUATED if message["dataMode"] in _MEASURED_MODES else Quality.SUSPECT
    ),
    130578: lambda message: GroupReading(
        [
            ("surge_mps", message["longitudinalSpeedGroundReferenced"]),
            ("sway_mps", message["transverseSpeedGroundReferenced"]),
            *available([("speed_through_water_mps", message["longitudinalSpeedWaterReferenced"])]),
        ]
    ),
}
"""The groups that we decode on every ship; :func:`machinery_readers` adds those of its actuators."""


def _instance(message: Message) -> int:
    instance = message["instance"]
    return _NO_INSTANCE if isinstance(instance, str) else int(instance)


class _Rudders:
    """127245: position and order. A single rudder has the lowest instance that a device reports."""

    def __init__(self, actuators: Actuators) -> None:
        self._channels = rudder_channels(actuators)
        self._has_orders = bool(rudders(actuators))

    def read(self, message: Message) -> GroupReading:
        number = _instance(message)
        meaning = f"rudder {number}" if number else ""
        if len(self._channels) == 1:
            return GroupReading(self._values(self._channels[0], message), meaning, instance=number)
        if number >= len(self._channels):
            return GroupReading([("rudder", "another instance")], meaning)
        return GroupReading(self._values(self._channels[number], message), meaning)

    def _values(self, channel: str, message: Message) -> Values:
        position: Values = [(channel, message.degrees("position"))]
        order: Values = [(name_of_order(channel), message.degrees("angleOrder"))] if self._has_orders else []
        return [*available(position), *available(order)] or position


class _Engines:
    """127488 and 127493: an engine's speed, which has no sign, and whether its gearbox reverses the shaft."""

    def __init__(self, actuators: Actuators, reduction_ratios: Mapping[str, float]) -> None:
        self._ratios = {
            number: (f"{name}_rpm", reduction_ratios[name])
            for number, name in enumerate(shafts(actuators))
            if name in reduction_ratios
        }
        self._gears: dict[int, int] = {}

    def read_gear(self, message: Message) -> GroupReading:
        self._gears[_instance(message)] = int(message["transmissionGear"])
        return GroupReading([])

    def read_speed(self, message: Message) -> GroupReading:
        number, rpm = _instance(message), message["speed"]
        if number not in self._ratios:
            return GroupReading([("engine", "engine without a reduction ratio")])
        channel, ratio = self._ratios[number]
        gear = self._gears.get(number)
        if gear == _NEUTRAL:
            return GroupReading([(channel, "gearbox in neutral")])
        sign = -1.0 if gear == _REVERSE else 1.0
        return GroupReading([(channel, rpm if isinstance(rpm, str) else sign * rpm / ratio)], f"engine {number}")


def machinery_readers(actuators: Actuators, reduction_ratios: Mapping[str, float]) -> dict[int, Reader]:
    """The reader of each of these groups on a ship with these actuators; engines only where a ratio is known."""
    readers: dict[int, Reader] = {RUDDER_GROUP: _Rudders(actuators).read}
    if reduction_ratios:
        engines = _Engines(actuators, reduction_ratios)
        readers |= {ENGINE_SPEED: engines.read_speed, GEARBOX: engines.read_gear}
    return readers


class GroupFieldPlace(NamedTuple):
    """A field of a group: where it is, and its unit where canboat's database has one."""

    field: Field
    unit: str | None


class _GroupChannel(NamedTuple):
    """A channel that a group carries."""

    channel: Channel
    field: Field
    step: Linear
    where: tuple[tuple[Field, int], ...]
    address: int | None

    def read(self, address: int, message: Message) -> Value | None:
        """The value, or the reason why there is none; None where the message is about something else."""
        if self.address not in (None, address) or any(message.read(field) != code for field, code in self.where):
            return None
        value = message.read(self.field)
        return value if isinstance(value, str) else self.step.apply(value)


class DeclaredGroups(DeclaredReaders[int, _GroupChannel]):
    """The declared channels in groups, by their numbers.

    ``shortest`` are the groups among them that come in several frames, with the least length [bytes] that holds
    the declared fields. Raises :class:`ConfigurationError` for an unknown field and for units that do not fit.
    """

    def __init__(self, declared: Sequence[tuple[Channel, GroupField]]) -> None:
        super().__init__()
        self.shortest: dict[int, int] = {}
        for channel, origin in declared:
            with errors_about_channel(channel):
                field, unit = _field(origin.field, origin)
                fields = ((_field(name, origin).field, code) for name, code in origin.where.items())
                # a code has no values that mean "not available"
                where = tuple((Field(field.start, field.bits), code) for field, code in fields)
                group_channel = _GroupChannel(channel, field, origin.step_to(channel, unit), where, origin.address)
            self.setdefault(origin.group, []).append(group_channel)
            if _is_fast(origin.group) and origin.group not in SHORTEST_BYTES:
                last_bit = max(
                    field.start + field.bits
                    for field in (group_channel.field, *(condition for condition, _ in group_channel.where))
                )
                self.shortest[origin.group] = max(self.shortest.get(origin.group, 1), -(-last_bit // 8))

    def read(self, group: int, address: int, message: Message) -> list[tuple[str, Value]]:
        """The channels in a message, each with its value or the reason why there is none."""
        values: dict[str, Value] = {}
        for group_channel in self.get(group, ()):
            value = group_channel.read(address, message)
            if value is not None and isinstance(values.get(group_channel.channel.name, ""), str):
                values[group_channel.channel.name] = value
        return list(values.items())


def _field(name: str, origin: GroupField) -> GroupFieldPlace:
    """A field by its place or by its name. Raises :class:`ConfigurationError` for neither."""
    if place := _BIT_RANGE.fullmatch(name):
        start, bits = int(place[1]), int(place[2])
        if not 1 <= bits <= 64 or start + bits > _MOST_BITS:
            raise ConfigurationError(
                f"group {origin.group} has no bits {name}", fix="write first bit:number of bits"
            )
        # J1939's values for "no value" hold in all groups that are neither NMEA 2000's nor proprietary
        proprietary, proprietary_range = _PROPRIETARY
        is_proprietary = origin.group == proprietary or origin.group in proprietary_range
        j1939 = origin.group < _NMEA2000_FROM and not is_proprietary
        return GroupFieldPlace(Field(start, bits, origin.step, origin.signed, j1939), None)
    fields = canboat_fields(origin.group)
    if name not in fields:
        why = f"it has {', '.join(fields)}" if fields else "canboat's database does not tell of it, or of several"
        fix = 'name one of them, or write its place: field = "first bit:number of bits", with `step`'
        raise ConfigurationError(f"group {origin.group} has no field {name!r}", why=why, fix=fix)
    return fields[name]


LIBRARY = threading.Lock()
"""Held while the library's codec is used, of which a process has one: it raises when two threads meet in it."""


def group_variants(group: int) -> Sequence[Any]:
    """The variants of a group in canboat's database; none of a group that it lacks."""
    from nmea2000 import backend

    with LIBRARY:
        return list(backend.DATABASE.pgn_variants(group))


def decode_by_library(group: int, payload: bytes) -> Any:
    """A message as the library reads it, None of a group that canboat's database lacks."""
    from nmea2000 import backend

    with LIBRARY:
        return backend.decode(group, payload)


@cache
def canboat_fields(group: int) -> Mapping[str, GroupFieldPlace]:
    """The numbers and codes of a group by their names in canboat's database; none where it has several variants."""
    variants = group_variants(group)
    fields = {}
    for info in variants[0].fields if len(variants) == 1 else ():
        has_place = info.bit_offset is not None and info.bit_length is not None
        if has_place and not info.offset and info.field_type in _NUMBERS | _CODES:
            step = info.resolution if info.field_type in _NUMBERS else None
            signed = step is not None and _is_signed(group, info)
            fields[info.id] = GroupFieldPlace(Field(info.bit_offset, info.bit_length, step, signed), info.unit)
    return fields


def _is_signed(group: int, info: Any) -> bool:
    """Whether all ones are a value, one step below zero, and not the code for none: the library does not say."""
    ones = ((1 << info.bit_length) - 1) << info.bit_offset
    message = decode_by_library(group, ones.to_bytes(max(-(-ones.bit_length() // 8), 8), "little"))
    raw = {field.id: field.raw_value for field in message.fields}[info.id] if message else None
    return isinstance(raw, int | float) and raw < 0


@cache
def _is_fast(group: int) -> bool:
    """Whether a group comes in several frames: by its number where that decides, else by canboat's database."""
    if group == _FAST[0] or group in _FAST[1]:
        return True
    if group < _NMEA2000_FROM or group == _PROPRIETARY[0]:
        return False
    return any(variant.packet_type == "Fast" for variant in group_variants(group))
