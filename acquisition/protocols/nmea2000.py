"""NMEA 2000: CAN frames to samples. Which messages are plausible is decided here; what a group means is in
:mod:`~seatrial.acquisition.protocols.nmea2000`.

Guards come first: remote, error and 11-bit frames, frames of other than 8 bytes, messages of which a part was
lost; what a gateway has put together skips the last. Sources are named by device, group and, where a group has
several, the meaning: ``bus/35:130306 apparent``. Addresses are claimed, and change hands; a device's 64-bit NAME
stays. So a device keeps its first label: its name in the configuration, or its address at that time.

Messages that come in several frames ("fast packets") are put together completely or not at all. A frame's first
byte holds the number of its message (3 bits) and its place in it (5 bits); the first frame also has the length of
the message. Numbers repeat after eight messages, so a part that was lost must never be replaced by the same part
of a later message: that would make a plausible message that was never sent. Parts may come in any order, but not
delayed, not twice unless in a row, and the first never completes a message: where it comes last, the others
belong to a message whose first part was lost.

Of the parameter groups of NMEA 2000 that we decode, each has one reader function.

Which of a ship's rudders and engines a message means is given by its instance: instances count from 0 in the
order of the ship's list, so that of a pair the port one is 0. No standard group has the speed of a shaft, nor a
propeller's pitch; those of engines and gearboxes stand for the speed where the reduction ratio is known.

Where fields are is in canboat's database, as the ``nmea2000`` library carries it; they are named as there, and are
in SI units and radians, positions in degrees. A field of a number keeps its three highest raw values for "not
available", "error" and nothing at all (reserved); lookups are given as they are. Declared channels may be in any
field of any group of NMEA 2000 and J1939: its place is in the declaration or in the database.
"""

from __future__ import annotations

import datetime as dt
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import pi
from typing import Any, NamedTuple

from seatrial.acquisition.config import declarations, sources
from seatrial.acquisition.core import errors, quantities, ship
from seatrial.acquisition.core.trial import Fix, Frame, FrameFlag, Group, Quality, safe_source_label
from seatrial.acquisition.protocols import NO_SATELLITES, DeclaredReaders, Decoder, Notices
from seatrial.acquisition.protocols.clock import SourceClock, utc_ns_of_date

ADDRESS_CLAIM = 60928
SYSTEM_TIME, TIME_AND_DATE, POSITION, GNSS_POSITION = 126992, 129033, 129025, 129029
_MACHINERY = RUDDER_GROUP, ENGINE_SPEED, GEARBOX = 127245, 127488, 127493
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

    The three highest values are none, of a ``j1939`` number all from 0xFB in its highest byte on (J1939-71). The
    ``unit`` is that of canboat's database.
    """

    start: int
    bits: int
    step: float | None = None
    signed: bool = False
    j1939: bool = False
    unit: str | None = field(default=None, compare=False)
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

    def __init__(self, group: int, payload: bytes) -> None:
        self._fields = _readable_fields(group)
        self.raw = int.from_bytes(payload, "little")
        self._bits = 8 * len(payload)

    def __getitem__(self, name: str) -> Value:
        return self.read(self._fields[name])

    def read(self, bit_field: Field) -> Value:
        """A field's value, or the reason why there is none."""
        return bit_field.read(self.raw) if bit_field.start + bit_field.bits <= self._bits else NOT_AVAILABLE

    def field_in_degrees(self, name: str) -> Value:
        """A field of radians in degrees."""
        return in_degrees(self[name])

    def filled_field(self, name: str) -> Value:
        """A signed field that some devices fill with ones if they leave it out: no value, rather than minus a step.

        Only for what may be left out: of a quantity that is measured, minus one step is a value.
        """
        bits = self._fields[name]
        is_filled = (~self.raw >> bits.start) & ((1 << bits.bits) - 1) != 0
        return self[name] if is_filled else NOT_AVAILABLE


def in_degrees(value: Value) -> Value:
    """A value in radians in degrees, or the reason why there is none."""
    return value if isinstance(value, str) else value * quantities.DEG_PER_RAD


CARRIED = {
    127250: {"heading_deg": "heading"},  # by the true reference
    127251: {"yaw_rate_dps": "rate"},
    127257: {"roll_deg": "roll", "pitch_deg": "pitch"},  # the yaw does not say which north it refers to
    127258: {"magnetic_variation_deg": "variation"},
    128259: {"speed_through_water_mps": "speedWaterReferenced"},
    130306: {"wind_direction_deg": "windAngle", "wind_speed_mps": "windSpeed"},  # by the reference of true north
    130578: {
        "surge_mps": "longitudinalSpeedGroundReferenced",
        "sway_mps": "transverseSpeedGroundReferenced",
    },
}
"""The field of each channel in groups of motion and wind, for reading and for sending them."""

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


def drop_optional_missing(values: Values) -> Values:
    """Without the values that are missing, where a device need not give them."""
    return [(name, value) for name, value in values if not isinstance(value, str)]


def group_utc_ns(message: Message) -> int | None:
    """A message's date and time as ns since 1970; None if it does not state them."""
    days, seconds = message["date"], message["time"]
    if isinstance(days, str) or isinstance(seconds, str) or seconds >= _DAY_S + 1:  # a leap second is possible
        return None
    return utc_ns_of_date(dt.date(1970, 1, 1) + dt.timedelta(days=days), seconds)


def _read_listed_fields(group: int, message: Message) -> GroupReading:
    fields = CARRIED[group].items()
    return GroupReading(
        [
            (name, message.field_in_degrees(key) if name.endswith(("_deg", "_dps")) else message[key])
            for name, key in fields
        ]
    )


def _read_heading(message: Message) -> GroupReading:
    """A compass heading has its deviation applied, within a turn unless the heading itself is beyond one."""
    reference, heading, deviation = message["reference"], message["heading"], message.filled_field("deviation")
    variation = drop_optional_missing([("magnetic_variation_deg", in_degrees(message.filled_field("variation")))])
    if reference == 0:
        return GroupReading([("heading_deg", message.field_in_degrees("heading")), *variation])
    if reference != 1:
        return GroupReading([("heading_deg", "heading without a reference")])
    if isinstance(heading, str) or isinstance(deviation, str) or heading > _FULL_TURN_RAD:
        magnetic = message.field_in_degrees("heading")
    elif abs(deviation) > pi:
        magnetic = "impossible deviation"
    else:
        magnetic = (heading + deviation) * quantities.DEG_PER_RAD % 360.0
    return GroupReading([("heading_magnetic_deg", magnetic), *variation])


def _read_position(message: Message) -> GroupReading:
    """Both coordinates, or why there is none: one alone is of no use."""
    position: Values = [("latitude_deg", message["latitude"]), ("longitude_deg", message["longitude"])]
    return GroupReading([pair for pair in position if isinstance(pair[1], str)] or position)


def _read_gnss_position(message: Message) -> GroupReading:
    """A position without a fix repeats an old one or invents one."""
    method = message["method"]
    if method in (_NO_FIX, _NO_FIX_ERROR):
        return GroupReading([("latitude_deg", "no fix")], quality=Quality.MISSING, fix=0)
    quality = Quality.NOT_EVALUATED if method in _SATELLITE_METHODS else Quality.SUSPECT
    fix = int(method) if method in _METHODS else None
    altitude = message["altitude"]
    height_m = None if isinstance(altitude, str) else altitude
    return GroupReading(_read_position(message).values, quality=quality, fix=fix, height_m=height_m)


def _read_course_and_speed(message: Message) -> GroupReading:
    course = {0: "course_over_ground_deg", 1: "course_magnetic_deg"}.get(int(message["cogReference"]))
    value = message.field_in_degrees("cog")
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


def _read_wind(message: Message) -> GroupReading:
    channels = _WINDS.get(int(message["reference"]))
    if channels is None:
        return GroupReading([("wind_speed_mps", "wind without a reference")])
    angle, speed, meaning = channels
    return GroupReading([(angle, message.field_in_degrees("windAngle")), (speed, message["windSpeed"])], meaning)


Reader = Callable[[Message], GroupReading]
READERS: dict[int, Reader] = {
    SYSTEM_TIME: lambda message: GroupReading([]),
    127250: _read_heading,
    **{group: partial(_read_listed_fields, group) for group in (127251, 127257, 127258, 128259)},
    POSITION: _read_position,
    129026: _read_course_and_speed,
    GNSS_POSITION: _read_gnss_position,
    TIME_AND_DATE: lambda message: GroupReading([]),
    130306: _read_wind,
    # course and speed only: heading, set and drift are computed by the device from other devices' data
    130577: lambda message: _read_course_and_speed(message)._replace(
        quality=Quality.NOT_EVALUATED if message["dataMode"] in _MEASURED_MODES else Quality.SUSPECT
    ),
    130578: lambda message: GroupReading(
        [
            *_read_listed_fields(130578, message).values,
            *drop_optional_missing([("speed_through_water_mps", message["longitudinalSpeedWaterReferenced"])]),
        ]
    ),
}
"""The groups that we decode on every ship; :func:`machinery_readers` adds those of its actuators."""


def _device_instance(message: Message) -> int:
    instance = message["instance"]
    return _NO_INSTANCE if isinstance(instance, str) else int(instance)


def _read_rudder(message: Message, channels: tuple[str, ...], *, has_orders: bool) -> GroupReading:
    """127245: position and order. A single rudder has the lowest instance that a device reports."""
    number = _device_instance(message)
    meaning = f"rudder {number}" if number else ""
    is_single = len(channels) == 1
    if not is_single and number >= len(channels):
        return GroupReading([("rudder", "another instance")], meaning)
    channel = channels[0 if is_single else number]
    position: Values = [(channel, message.field_in_degrees("position"))]
    order: Values = (
        [(ship.order_channel_name(channel), message.field_in_degrees("angleOrder"))] if has_orders else []
    )
    values = [*drop_optional_missing(position), *drop_optional_missing(order)] or position
    return GroupReading(values, meaning, instance=number if is_single else None)


def _read_engine(
    message: Message, ratios: Mapping[int, tuple[str, float]], gears: Mapping[int, int]
) -> GroupReading:
    """127488: an engine's speed, which has no sign, as its shaft's; the channel and reduction ratio by instance."""
    number, rpm = _device_instance(message), message["speed"]
    if number not in ratios:
        return GroupReading([("engine", "engine without a reduction ratio")])
    channel, ratio = ratios[number]
    if gears.get(number) == _NEUTRAL:
        return GroupReading([(channel, "gearbox in neutral")])
    sign = -1.0 if gears.get(number) == _REVERSE else 1.0
    return GroupReading([(channel, rpm if isinstance(rpm, str) else sign * rpm / ratio)], f"engine {number}")


def machinery_readers(actuators: ship.Actuators, reduction_ratios: Mapping[str, float]) -> dict[int, Reader]:
    """The reader of each of these groups on a ship with these actuators; engines only where a ratio is known."""
    rudder = partial(
        _read_rudder, channels=ship.rudder_channels(actuators), has_orders=bool(ship.rudder_names(actuators))
    )
    ratios = {
        number: (f"{name}_rpm", reduction_ratios[name])
        for number, name in enumerate(ship.shafts(actuators))
        if name in reduction_ratios
    }
    gears: dict[int, int] = {}

    def read_gear(message: Message) -> GroupReading:
        """127493: whether an engine's gearbox reverses its shaft."""
        gears[_device_instance(message)] = int(message["transmissionGear"])
        return GroupReading([])

    engines: dict[int, Reader] = {
        ENGINE_SPEED: partial(_read_engine, ratios=ratios, gears=gears),
        GEARBOX: read_gear,
    }
    return {RUDDER_GROUP: rudder, **(engines if reduction_ratios else {})}


class _GroupChannel(NamedTuple):
    """A channel that a group carries."""

    channel: ship.Channel
    field: Field
    step: quantities.Linear
    where: tuple[tuple[Field, int], ...]
    address: int | None


class DeclaredGroups(DeclaredReaders[int, _GroupChannel]):
    """The declared channels in groups, by their numbers.

    ``shortest`` are the groups among them that come in several frames, with the least length [bytes] that holds
    the declared fields. Raises :class:`ConfigurationError` for an unknown field and for units that do not fit.
    """

    def __init__(self, declared: Sequence[tuple[ship.Channel, declarations.GroupField]]) -> None:
        super().__init__()
        self.shortest: dict[int, int] = {}
        for channel, origin in declared:
            with declarations.locate_errors_at_channel(channel):
                place = _field_of_origin(origin.field, origin)
                conditions = [(_field_of_origin(name, origin), code) for name, code in origin.where.items()]
                # a code has no values that mean "not available"
                where = tuple((Field(condition.start, condition.bits), code) for condition, code in conditions)
                step = origin.conversion_to_channel(channel, place.unit)
            self.setdefault(origin.group, []).append(_GroupChannel(channel, place, step, where, origin.address))
            if is_fast_packet_group(origin.group) and origin.group not in SHORTEST_BYTES:
                last_bit = max(
                    field.start + field.bits for field in (place, *(condition for condition, _ in where))
                )
                self.shortest[origin.group] = max(self.shortest.get(origin.group, 1), -(-last_bit // 8))

    def read(self, group: int, address: int, message: Message) -> list[tuple[str, Value]]:
        """The channels in a message, each with its value or the reason why there is none."""
        values: dict[str, Value] = {}
        for channel, place, step, where, required_address in self.get(group, ()):
            is_meant = required_address in (None, address) and all(message.read(key) == code for key, code in where)
            if is_meant and isinstance(values.get(channel.name, ""), str):
                value = message.read(place)
                values[channel.name] = value if isinstance(value, str) else step.apply(value)
        return list(values.items())


def _field_of_origin(name: str, origin: declarations.GroupField) -> Field:
    """A field by its place or by its name. Raises :class:`ConfigurationError` for neither."""
    if place := _BIT_RANGE.fullmatch(name):
        start, bits = int(place[1]), int(place[2])
        if not 1 <= bits <= 64 or start + bits > _MOST_BITS:
            raise errors.ConfigurationError(
                f"group {origin.group} has no bits {name}", fix="write first bit:number of bits"
            )
        # J1939's values for "no value" hold in all groups that are neither NMEA 2000's nor proprietary
        proprietary, proprietary_range = _PROPRIETARY
        is_proprietary = origin.group == proprietary or origin.group in proprietary_range
        j1939 = origin.group < _NMEA2000_FROM and not is_proprietary
        return Field(start, bits, origin.step, origin.signed, j1939)
    fields = canboat_fields(origin.group)
    if name not in fields:
        why = f"it has {', '.join(fields)}" if fields else "canboat's database does not tell of it, or of several"
        fix = 'name one of them, or write its place: field = "first bit:number of bits", with `step`'
        raise errors.ConfigurationError(f"group {origin.group} has no field {name!r}", why=why, fix=fix)
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
def canboat_fields(group: int) -> Mapping[str, Field]:
    """The numbers and codes of a group by their names in canboat's database; none where it has several variants."""
    variants = group_variants(group)
    fields = {}
    for info in variants[0].fields if len(variants) == 1 else ():
        has_place = info.bit_offset is not None and info.bit_length is not None
        if has_place and not info.offset and info.field_type in _NUMBERS | _CODES:
            step = info.resolution if info.field_type in _NUMBERS else None
            signed = False
            if step is not None:  # the library does not say whether all ones are a value, one step below zero
                ones = ((1 << info.bit_length) - 1) << info.bit_offset
                decoded = decode_by_library(group, ones.to_bytes(max(-(-ones.bit_length() // 8), 8), "little"))
                raw = {field.id: field.raw_value for field in decoded.fields}.get(info.id) if decoded else None
                signed = isinstance(raw, int | float) and raw < 0
            fields[info.id] = Field(info.bit_offset, info.bit_length, step, signed, unit=info.unit)
    return fields


@cache
def _readable_fields(group: int) -> dict[str, Field]:
    """The fields of a group by their names, where it has a reader; declared channels bring theirs."""
    fields = dict(canboat_fields(group)) if group in READERS or group in _MACHINERY else {}
    if group == ENGINE_SPEED:  # in rpm, and not in Hz
        fields["speed"] = replace(fields["speed"], step=0.25)
    return fields


@cache
def is_fast_packet_group(group: int) -> bool:
    """Whether a group comes in several frames: by its number where that decides, else by canboat's database."""
    is_by_number = group == _FAST[0] or group in _FAST[1]
    return is_by_number or any(variant.packet_type == "Fast" for variant in group_variants(group))


_CLOCKS = (SYSTEM_TIME, TIME_AND_DATE, GNSS_POSITION)
"""The groups with the time, best first: a position's time is that of the fix, which arrives with a delay."""
_NO_ADDRESS = 254  # claimed by a device that found none free
_MOST_NAMES = 512  # a bus has 252 addresses; more NAMEs than this are noise that looks like claims
_LONGEST_GAP_NS = 750_000_000  # parts with a longer gap belong to two messages
_MOST_BEGUN_SINCE = 4  # a message of which parts are missing after so many others will never be complete
_FIRST_PART_BYTES, _PART_BYTES = 6, 7
LONGEST_BYTES = _FIRST_PART_BYTES + 31 * _PART_BYTES
INCOMPLETE = "incomplete fast packet"


def split_can_identifier(identifier: int) -> tuple[int, int]:
    """The parameter group number and the source address in a 29-bit identifier.

    >>> split_can_identifier(0x09F11223)
    (127250, 35)
    """
    group = (identifier >> 8) & 0x3FFFF
    if (group >> 8) & 0xFF < 240:  # addressed to one device: the low byte is its address
        group &= 0x3FF00
    return group, identifier & 0xFF


class Bus:
    """The state of one bus: its devices and clock, and messages of which parts have come."""

    def __init__(self, devices: BusDevices, clock: SourceClock, refused: Counter[str]) -> None:
        self.devices, self.clock = devices, clock
        self.fast = FastPackets(refused)
        self.timekeeper: tuple[str, int] | None = None
        self.first_instance: dict[tuple[str, int], int] = {}


class Nmea2000Decoder(Decoder):
    """The buses of one source: one, or those that a log names.

    Two buses may each have a device of the same address: labels distinguish them, ``bus/4@can0:127250``.
    """

    def __init__(
        self,
        stamps: sources.Clock = "receiver",
        devices: tuple[sources.Device, ...] = (),
        actuators: ship.Actuators = ship.DEFAULT,
        reduction_ratios: Mapping[str, float] | None = None,
        *,
        shares_bus: bool = False,
        declared: Sequence[tuple[ship.Channel, declarations.GroupField]] = (),
    ) -> None:
        """Raises :class:`ConfigurationError` for an unknown declared field."""
        super().__init__()
        self._stamps, self._configured = stamps, devices
        self._buses = {"": self._new_bus("")}
        self._shares_bus = shares_bus  # with a DBC file's frames, whose 11-bit identifiers are no fault
        self._readers = READERS | machinery_readers(actuators, reduction_ratios or {})
        self._declared = DeclaredGroups(declared)
        self._shortest = self._declared.shortest | SHORTEST_BYTES
        for group in self._readers:  # a sixth of a second, which the first frame has not
            _readable_fields(group)

    @property
    def clock(self) -> SourceClock:
        """The clock of the bus that has no name."""
        return self._buses[""].clock

    def bus_of_frame(self, frame: Frame) -> Bus:
        """The bus that a frame is from."""
        bus = self._buses.get(frame.sender)
        if bus is None:
            bus = self._buses[frame.sender] = self._new_bus(frame.sender)
            names = [name for name in self._buses if name]
            if len(names) > 1:
                text = f"there are several buses, {', '.join(names)}: devices of each are sources of their own"
                self.notices.append(
                    ("info", f"{text}, like {bus.devices.label_of_address(frame.identifier & 0xFF)}")
                )
        return bus

    def _new_bus(self, name: str) -> Bus:
        clock = SourceClock(self._stamps, f"nmea2000 {SYSTEM_TIME}", self.notices)
        clock.muted = bool(name) and self.clock.muted
        return Bus(BusDevices(self._configured, self.notices, name), clock, self.refused)

    def decode(self, frame: Frame) -> list[Group]:
        bus = self.bus_of_frame(frame)
        parsed = self.complete_message(frame, bus)
        if parsed is None:
            return []
        group, address, message = parsed
        device = bus.devices.label_of_address(address)
        read = self._readers.get(group)
        reading = GroupReading([]) if read is None else read(message)  # none: only declared channels are in it
        source_ns = None
        if group in _CLOCKS:
            source_ns = group_utc_ns(message)
            _announce_bus_time(bus, source_ns, frame, group, device, reading.quality)
        sensor, quality = f"{frame.origin}/{device}", reading.quality
        if reading.fix is not None:
            self.fixes[sensor] = Fix(reading.fix, reading.height_m)
        elif group == POSITION and self.fixes.get(sensor, Fix()).kind in NO_SATELLITES:
            quality = Quality.SUSPECT  # the last position, repeated
        source, groups, instance = f"{sensor}:{group}", [], reading.instance
        if instance is not None:  # of the same thing, of a second rudder for example, only the lowest number counts
            lowest = min(instance, bus.first_instance.get((device, group), instance))
            bus.first_instance[device, group] = lowest
        if instance is not None and instance > lowest:
            self.refused["another instance"] += 1
        else:
            meaning = f" {reading.meaning}" if reading.meaning else ""
            values = self._declared.values_not_declared(group, self._accepted_values(bus, device, reading.values))
            groups = bus.clock.group_values(frame, source + meaning, values, source_ns, quality)
        if group in self._declared:
            declared = self._accepted_values(bus, device, self._declared.read(group, address, message))
            groups += bus.clock.group_values(frame, source, declared, source_ns)
        return groups

    def complete_message(self, frame: Frame, bus: Bus) -> tuple[int, int, Message] | None:
        """The message that this frame of a bus completes, with its group and the sender's address.

        None where the frame is refused, of no group that we decode, or not the last one of its message.
        """
        group, address = split_can_identifier(frame.identifier)
        kind = frame.flags and frame.flags & ~FrameFlag.LATE
        if kind and kind != FrameFlag.WHOLE:
            if kind != FrameFlag.STANDARD_ID or not self._shares_bus:
                self.refused["remote, error or 11-bit frame"] += 1
            return None
        if group not in self._readers and group not in self._declared and group != ADDRESS_CLAIM:
            if not self._shares_bus:  # else it may be a frame of the DBC file's
                self.count_unknown_message(str(group))
            return None
        payload: bytes | None = frame.payload
        shortest = self._shortest.get(group)
        if kind and shortest is not None:
            if not shortest <= len(frame.payload) <= LONGEST_BYTES:
                self.refused["impossible length"] += 1
                return None
        elif len(frame.payload) not in (FRAME_BYTES, SHORT_FRAMES.get(group)):
            self.refused["frame of other than 8 bytes"] += 1
            return None
        elif shortest is not None:
            payload = bus.fast.push(address, group, frame.payload, frame.monotonic_ns, shortest)
        elif group == ADDRESS_CLAIM:
            if bus.devices.claim_address(address, frame.payload):
                bus.fast.forget_sender(address)
            return None
        return None if payload is None else (group, address, Message(group, payload))

    def _accepted_values(
        self, bus: Bus, device: str, candidates: Iterable[tuple[str, Value]]
    ) -> list[tuple[str, float]]:
        """The values that exist and that the configuration allows; missing ones are counted."""
        values = []
        for quantity, value in candidates:
            if not bus.devices.may_provide(device, quantity):
                continue
            if isinstance(value, str):
                self.refused[value] += 1
            else:
                values.append((quantity, value))
        return values


def _announce_bus_time(
    bus: Bus, source_ns: int | None, frame: Frame, group: int, device: str, quality: Quality
) -> None:
    """One device is the bus's clock until it falls silent: two clocks would make time jump back and forth."""
    if source_ns is None or quality is not Quality.NOT_EVALUATED:
        return
    if bus.timekeeper is not None and bus.clock.utc_ns_at_frame(frame) is not None:
        keeper, keeper_group = bus.timekeeper
        if device != keeper or _CLOCKS.index(group) > _CLOCKS.index(keeper_group):
            return
    bus.timekeeper = device, group
    bus.clock.name = f"nmea2000 {group}"
    bus.clock.announce(source_ns, frame)


_DERIVATIONS: tuple[tuple[set[str], set[str]], ...] = (
    ({"latitude_deg", "longitude_deg"}, {"north_m", "east_m", "latitude_deg", "longitude_deg"}),
    (
        {"course_over_ground_deg", "course_magnetic_deg", "speed_over_ground_mps", "magnetic_variation_deg"},
        {"surge_mps", "sway_mps"},
    ),
    ({"heading_magnetic_deg", "magnetic_variation_deg"}, {"heading_deg"}),
    ({"wind_direction_magnetic_deg", "magnetic_variation_deg"}, {"wind_direction_deg"}),
    ({"wind_angle_apparent_deg"}, {"apparent_wind_angle_deg"}),
    ({"wind_speed_apparent_mps"}, {"apparent_wind_speed_mps"}),
    (
        {
            f"wind_{quantity}"
            for reference in ("apparent", "theoretical", "water")
            for quantity in (f"angle_{reference}_deg", f"speed_{reference}_mps")
        },
        {"wind_direction_deg", "wind_speed_mps"},
    ),
)
"""Quantities, and the channels that are derived from them, besides those of their names."""


class BusDevices:
    """The devices of one bus, as configured and as observed; ``bus`` distinguishes the buses of one log."""

    def __init__(self, configured: tuple[sources.Device, ...], notices: Notices, bus: str = "") -> None:
        self.at_bus = f"@{safe_source_label(bus)}" if bus else ""
        labels = [(device.name + self.at_bus, device) for device in configured]
        self._by_iso_name = {device.iso_name: label for label, device in labels if device.iso_name is not None}
        self._by_address = {device.address: label for label, device in labels if device.address is not None}
        self._provides = {
            label: {
                *device.channels,
                *(name for names, derived in _DERIVATIONS if derived & {*device.channels} for name in names),
            }
            for label, device in labels
            if device.channels is not None
        }
        self._notices = notices
        self._name_at: dict[int, str] = {}
        self._label_of: dict[str, str] = {}
        self._label_at: dict[int, str] = {}

    def label_of_address(self, address: int) -> str:
        """What the device that has this address now is called."""
        label = self._label_at.get(address)
        if label is None:
            label = self._default_label(address)
            if label in self._label_of.values():  # its device has moved away, and the address is unclaimed since
                label = f"{address}-unclaimed{self.at_bus}"
            self._label_at[address] = label
        return label

    def may_provide(self, label: str, quantity: str) -> bool:
        """Whether the configuration takes this quantity from this device."""
        provides = self._provides.get(label)
        return provides is None or quantity in provides

    def claim_address(self, address: int, payload: bytes) -> bool:
        """A device claims an address by its NAME, 8 bytes; returns whether the address changed hands."""
        name = f"{int.from_bytes(payload, 'little'):016x}"
        former_address = next(
            (held_address for held_address, holder in self._name_at.items() if holder == name), None
        )
        if former_address == address:
            return False
        if former_address is not None:
            del self._name_at[former_address]
            self._label_at.pop(former_address, None)
        if address == _NO_ADDRESS:
            if (label := self._label_of.pop(name, None)) is not None:
                text = f"device {label} (NAME {name}) found no free address and is silent"
                self._notices.append(("warning", text))
            return False
        if name not in self._label_of and name not in self._by_iso_name and len(self._label_of) >= _MOST_NAMES:
            return False
        former_name, former_label = self._name_at.get(address), self._label_at.get(address)
        label = self._label_of.get(name)
        if label is None:
            label = self._by_iso_name.get(name) or self._default_label(address)
            label = name + self.at_bus if label in self._label_of.values() else label
        self._name_at[address], self._label_of[name], self._label_at[address] = name, label, label
        if former_address is not None:
            self._notices.append(("warning", f"device {label} moved from address {former_address} to {address}"))
        if former_name is not None:
            text = f"address {address} was taken over from device {former_label} by device {label} (NAME {name})"
            self._notices.append(("warning", text))
        return former_label not in (None, label) or former_name is not None

    def _default_label(self, address: int) -> str:
        return self._by_address.get(address, f"{address}{self.at_bus}")


@dataclass(slots=True)
class _PartialMessage:
    """The parts of one message by their places; ``length`` [bytes] is known from the first part on."""

    begun: int
    last_ns: int
    last_place: int = -1
    length: int = LONGEST_BYTES
    parts: dict[int, bytes] = field(default_factory=dict)

    @property
    def most_parts(self) -> int:
        """How many parts the message has, at most."""
        return 1 + -(-max(0, self.length - _FIRST_PART_BYTES) // _PART_BYTES)

    def is_continued_by(self, place: int, length: int, monotonic_ns: int) -> bool:
        """Whether a part can belong to this message; ``length`` is that in a first part."""
        if monotonic_ns - self.last_ns > _LONGEST_GAP_NS or place in self.parts:
            return False
        if place:
            return place < self.most_parts
        places = _PartialMessage(0, 0, length=length).most_parts
        return max(self.parts) < places and len(self.parts) < places - 1


@dataclass(slots=True)
class _Stream:
    """The messages of one group from one address. ``closed`` is the last number that was completed or refused."""

    begun: int = 0
    closed: int | None = None
    partials: dict[int, _PartialMessage] = field(default_factory=dict)


class FastPackets:
    """Parts of messages by address and group; what is dropped is counted in ``refused``."""

    def __init__(self, refused: Counter[str]) -> None:
        self._refused = refused
        self._streams: dict[tuple[int, int], _Stream] = {}

    def push(self, address: int, group: int, part: bytes, monotonic_ns: int, shortest: int) -> bytes | None:
        """The complete message if this part of 8 bytes was the last one missing.

        ``shortest`` is the least length [bytes] that is possible for the group.
        """
        stream = self._streams.setdefault((address, group), _Stream())
        number, place = part[0] >> 5, part[0] & 0x1F
        data = part[1:] if place else part[2:]
        message = stream.partials.get(number)
        if message is not None:
            if place == message.last_place and message.parts[place] == data:
                return None  # the same part twice in a row, as when its acknowledgement was disturbed
            if not message.is_continued_by(place, part[1], monotonic_ns):
                self._refused[INCOMPLETE] += 1
                del stream.partials[number]
                message = None
        if message is None:
            if place and number == stream.closed:  # a part of a message that is complete already
                return None
            stream.begun += 1
            for earlier, partial in list(stream.partials.items()):
                if stream.begun - partial.begun >= _MOST_BEGUN_SINCE:
                    self._refused[INCOMPLETE] += 1
                    del stream.partials[earlier]
            stream.closed = None if stream.closed == number else stream.closed
            message = stream.partials[number] = _PartialMessage(stream.begun, monotonic_ns)
        if place == 0:
            message.length = part[1]
            if not max(1, shortest) <= part[1] <= LONGEST_BYTES:
                self._refused["impossible length"] += 1
                stream.closed = number
                del stream.partials[number]
                return None
        message.parts[place], message.last_place, message.last_ns = data, place, monotonic_ns
        if len(message.parts) < message.most_parts:
            return None
        stream.closed = number
        del stream.partials[number]
        return b"".join(message.parts[index] for index in range(message.most_parts))[: message.length]

    def forget_sender(self, address: int) -> None:
        """A new device has this address: what the former one began will not be continued."""
        for key in [key for key in self._streams if key[0] == address]:
            self._refused[INCOMPLETE] += len(self._streams.pop(key).partials)
