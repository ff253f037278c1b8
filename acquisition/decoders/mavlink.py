"""MAVLink: packets to samples, by ``pymavlink``; one system, known messages, bad data counted.

Left out on purpose: SERVO_OUTPUT_RAW is an order and no measurement; ESC_TELEMETRY_1_TO_4 tells rpm without a sign,
and a reversed propeller would look like one ahead; VFR_HUD has whole degrees of what ATTITUDE tells better.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from math import atan2, hypot, isfinite, isnan, nan
from typing import Any, NamedTuple

import pymap3d

from seatrial.acquisition.config.declarations import Declarations, MavlinkField, carried_by, complaints_about
from seatrial.acquisition.config.sections import MavlinkFileSource, MavlinkLinks
from seatrial.acquisition.core.actuators import DEFAULT, Actuators, shafts
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.channels import BY_NAME, channel_names, with_declared
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.frames import Fix, Frame, Group
from seatrial.acquisition.core.units import DEG_PER_RAD, Linear
from seatrial.acquisition.decoders import DeclaredReaders, Decoder, FurtherSenders
from seatrial.acquisition.decoders.clock import SourceClock, is_possible
from seatrial.acquisition.decoders.mavlink_packets import Fault, Header, PacketCutter, header_of, message_name

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

Values = list[tuple[str, float]]
UNKNOWN_VELOCITY = 32_767
"""What our own encoder sends in GLOBAL_POSITION_INT where it knows no velocity; no vessel makes 328 m/s."""
_UNKNOWN = 65_535  # of speeds, courses and headings in 16 bits
_NO_RPM = -1.0  # what ArduPilot sends of a shaft without a sensor, or with one that fails
_FIX_IN_SPACE = 3
_FIX_OF_TYPE = {0: 0, 1: 0, 2: 0, 3: 1, 4: 2, 5: 5, 6: 4}  # by the numbers of GGA
_MICRO_NS = 1000
_MILLI_NS = 1_000_000
_OUT_OF_ORDER_MS = 1_000  # messages of several tasks, and datagrams, may overtake each other
_QUIET_NS = 60 * 10**9
_WRAP_MS = 2**32  # time since boot begins anew after 49.7 days
_NEAR_WRAP_MS = 60_000
_LARGEST_ANGLE_DEG = 360.01  # a whole turn, and what rounding adds to it


def _scaled(value: int, unit: float) -> float:
    return nan if value == _UNKNOWN else value * unit


def _fix(message: Any) -> Fix:
    """What GPS_RAW_INT says of the fix; what it does not know is 0 in the fields that version 2 has added."""
    across_m, up_m = message.h_acc / 1e3, message.v_acc / 1e3
    sigma_m = (across_m, across_m, up_m) if across_m > 0.0 and up_m > 0.0 else None
    height_m = (message.alt_ellipsoid or message.alt) / 1e3
    return Fix(_FIX_OF_TYPE.get(message.fix_type, 1), height_m, sigma_m)


def _position(latitude: int, longitude: int) -> Values:
    """A position in 1e-7 degrees; what autopilots send before their first fix is not one."""
    has_fix = (latitude, longitude) != (0, 0)
    return [
        ("latitude_deg", latitude / 1e7 if has_fix else nan),
        ("longitude_deg", longitude / 1e7 if has_fix else nan),
    ]


def _attitude(message: Any) -> Values:
    return [
        ("heading_deg", message.yaw * DEG_PER_RAD),
        ("yaw_rate_dps", message.yawspeed * DEG_PER_RAD),
        ("roll_deg", message.roll * DEG_PER_RAD),
        ("pitch_deg", message.pitch * DEG_PER_RAD),
    ]


def _global_position(message: Any) -> Values:
    has_velocity = UNKNOWN_VELOCITY not in (message.vx, message.vy)
    return [
        *_position(message.lat, message.lon),
        ("velocity_north_mps", message.vx / 100.0 if has_velocity else nan),
        ("velocity_east_mps", message.vy / 100.0 if has_velocity else nan),
        ("heading_deg", _scaled(message.hdg, 0.01)),
    ]


def _satellite_position(message: Any) -> Values:
    return [
        *_position(message.lat, message.lon),
        ("speed_over_ground_mps", _scaled(message.vel, 0.01)),
        ("course_over_ground_deg", _scaled(message.cog, 0.01)),
    ]


def _local_velocity(message: Any) -> Values:
    """Speeds only: the position is relative to the autopilot's own origin, and a group of its own."""
    return [("velocity_north_mps", message.vx), ("velocity_east_mps", message.vy)]


def _wind_vector(message: Any) -> Values:
    """The vector points to where the wind blows; the direction is where it comes from. A calm has none."""
    speed_mps = hypot(message.wind_x, message.wind_y)
    if speed_mps == 0.0 or not isfinite(speed_mps):
        return [("wind_speed_mps", speed_mps)]
    from_deg = atan2(-message.wind_y, -message.wind_x) * DEG_PER_RAD % 360.0
    return [("wind_direction_deg", from_deg), ("wind_speed_mps", speed_mps)]


_READERS: dict[str, Callable[[Any], Values]] = {
    "ATTITUDE": _attitude,
    "GLOBAL_POSITION_INT": _global_position,
    "GPS_RAW_INT": _satellite_position,
    "LOCAL_POSITION_NED": _local_velocity,
    "WIND": lambda message: [("wind_direction_deg", message.direction), ("wind_speed_mps", message.speed)],
    "WIND_COV": _wind_vector,
}
_WANTED = (*_READERS, "RPM", "RAW_RPM", "NAMED_VALUE_FLOAT")
_CONTEXT = ("SYSTEM_TIME", "GPS_GLOBAL_ORIGIN")  # they give no samples but make sense of the others: always read
_NAMES = {getattr(dialect, f"MAVLINK_MSG_ID_{name}"): name for name in (*_WANTED, *_CONTEXT)}


def is_read(message_id: int) -> bool:
    """Whether messages of this number are read."""
    return message_id in _NAMES


_INTEGER_TYPE = re.compile(r"(u?)int(\d+)_t")


class _MessageChannel(NamedTuple):
    """A channel that a message carries."""

    channel: Channel
    origin: MavlinkField
    step: Linear
    unknown: int | None

    def read(self, message: Any) -> list[tuple[str, float]]:
        if any(getattr(message, name) != code for name, code in self.origin.where.items()):
            return []
        value = getattr(message, self.origin.field)
        if self.origin.index is not None:
            value = value[self.origin.index]
        return [(self.channel.name, nan if value == self.unknown else self.step.apply(float(value)))]


class DeclaredMessages(DeclaredReaders[str, _MessageChannel]):
    """What messages say of declared channels; ``names`` are the messages by number.

    Raises :class:`ConfigurationError` for a message or field that the dialect has not, and units that do not fit.
    """

    def __init__(self, wanted: Sequence[tuple[Channel, MavlinkField]]) -> None:
        super().__init__()
        self.names: dict[int, str] = {}
        kinds = {message_class.msgname: message_class for message_class in dialect.mavlink_map.values()}
        for channel, origin in wanted:
            with complaints_about(channel):
                kind = _kind_of(origin, kinds)
                step = origin.step_to(channel, kind.fieldunits_by_name.get(origin.field))
            self.names[kind.id] = origin.message
            message_channel = _MessageChannel(channel, origin, step, _unknown(kind, origin.field))
            self.setdefault(origin.message, []).append(message_channel)

    def read(self, name: str, message: Any) -> list[tuple[str, float]]:
        """The channels in a message with their values, NaN for one that is not known."""
        return [value for message_channel in self.get(name, ()) for value in message_channel.read(message)]


def _kind_of(origin: MavlinkField, kinds: Mapping[str, Any]) -> Any:
    """The dialect's message that a declaration names, if it has its fields and they are numbers."""
    kind = kinds.get(origin.message)
    if kind is None:
        near = ", ".join(get_close_matches(origin.message, kinds, n=3)) or "ATTITUDE"
        raise ConfigurationError(f"MAVLink has no message {origin.message}", fix=f"write one such as {near}")
    for name in (origin.field, *origin.where):
        if name not in kind.fieldnames:
            fields = ", ".join(kind.fieldnames)
            raise ConfigurationError(f"{origin.message} has no field {name!r}", fix=f"write one of {fields}")
    length = kind.array_lengths[kind.ordered_fieldnames.index(origin.field)]
    fits = origin.index is None if length == 0 else origin.index is not None and origin.index < length
    if kind.fieldtypes[kind.fieldnames.index(origin.field)] == "char" or not fits:
        what = f"has {length} elements: give the `index` of one" if length else "is one value: leave out `index`"
        raise ConfigurationError(f"field {origin.field} of {origin.message} {what}")
    return kind


def _unknown(kind: Any, field: str) -> int | None:
    """What a field of whole numbers holds where the value is not known: by MAVLink's custom the highest."""
    match = _INTEGER_TYPE.fullmatch(kind.fieldtypes[kind.fieldnames.index(field)])
    return None if match is None else 2 ** (int(match[2]) - (match[1] == "")) - 1


class MavlinkDecoder(Decoder):
    """One link; ``time_boot_ms`` becomes UTC by the last SYSTEM_TIME."""

    def __init__(self, config: MavlinkLinks, actuators: Actuators = DEFAULT, declared: Declarations = ()) -> None:
        """Raises :class:`ConfigurationError` where ``messages`` names one that nobody reads, or a declared channel
        one that is not known."""
        super().__init__()
        self.clock = SourceClock(config.clock, "mavlink SYSTEM_TIME", self.notices)
        self._system_id, self._component_id = config.system_id, config.component_id
        channels = with_declared(tuple(declaration.channel for declaration in declared))
        self._declared = DeclaredMessages(carried_by(declared, config.channels, MavlinkField))
        self._names = _NAMES | self._declared.names
        self._wanted = frozenset((*_chosen(config), *_CONTEXT, *self._declared.names.values()))
        self._named = {
            entry.name: (channel, entry.step_to(channels[channel]))
            for channel, entry in config.named_values.items()
        }
        self._shafts = tuple(f"{name}_rpm" for name in shafts(actuators)[:2])
        self._angles = frozenset(name for name in channel_names(actuators) if BY_NAME[name].circular)
        self._boot_ns: dict[str, int] = {}  # by sender: each counts from its own start
        self._last_boot_ms: dict[str, int] = {}
        self._quiet_until_ns = 0
        self._origins: dict[str, tuple[float, float]] = {}  # by address
        self._cutter = PacketCutter(whole=isinstance(config, MavlinkFileSource))
        self._link = dialect.MAVLink(None)
        self._senders = FurtherSenders()

    def decode(self, frame: Frame) -> list[Group]:
        groups = []
        for piece in self._cutter.push(frame.payload):
            if isinstance(piece, Fault):
                self.refused[piece.reason] += 1
            elif kind := self._kind(header_of(piece)):
                groups += self._groups(kind, piece, frame)
        return groups

    def _kind(self, header: Header) -> str:
        """The name of a message that is for us, else nothing. Messages that nobody reads are no refusals."""
        kind, reason = self._names.get(header.message_id, ""), ""
        if header.system_id != self._system_id:
            reason = "another system"
        elif self._component_id not in (None, header.component_id):
            reason = "another component"
        elif kind and kind not in self._wanted:
            reason = "message not wanted"
        if reason:
            self.refused[reason] += 1
        elif not kind:
            self.note_unknown(message_name(header.message_id))
        return "" if reason else kind

    def _groups(self, kind: str, packet: bytes, frame: Frame) -> list[Group]:
        try:
            message = self._link.decode(bytearray(packet))
        except dialect.MAVError:
            self.refused["undecodable"] += 1
            return []
        self._notice_restart(message, frame)
        told_ns, groups, readings = self._measured_ns(message, frame), [], self._values(kind, message, frame)
        if ours := self._declared.channels_in(kind):
            readings = [(label, [pair for pair in values if pair[0] not in ours]) for label, values in readings]
            readings.append((kind, self._declared.read(kind, message)))
        for label, values in readings:
            source = f"{frame.origin}/{self._sender(message, frame)}:{label}"
            groups += self.clock.group(frame, source, self._possible(values), told_ns)
        return groups

    def _sender(self, message: Any, frame: Frame) -> str:
        """The system, with the component where it is not the autopilot: a companion is a source of its own; so is
        another system of the same number, at another address."""
        component = message.get_srcComponent()
        is_autopilot = component == dialect.MAV_COMP_ID_AUTOPILOT1
        further = self._senders.label(frame.sender)
        system = f"{self._system_id}" if is_autopilot else f"{self._system_id}.{component}"
        return f"{system}@{further}" if further else system

    def _values(self, kind: str, message: Any, frame: Frame) -> list[tuple[str, Values]]:
        """What a message says, a list a group, each with what its source is labelled with."""
        match kind:
            case "SYSTEM_TIME":
                self._set_clock(message, frame)
                return []
            case "GPS_GLOBAL_ORIGIN":
                self._set_origin(message, frame)
                return []
            case "NAMED_VALUE_FLOAT":
                return [(kind, self._named_value(message))]
            case "RPM":
                rpm = (nan if value == _NO_RPM else value for value in (message.rpm1, message.rpm2))
                return [(kind, list(zip(self._shafts, rpm, strict=False)))]
            case "RAW_RPM":  # its unit is rpm, whatever the field is called
                return [(kind, [(name, message.frequency) for name in self._shafts[message.index :][:1]])]
            case "LOCAL_POSITION_NED":
                return [
                    (kind, _local_velocity(message)),
                    ("GPS_GLOBAL_ORIGIN", self._local_position(message, frame)),
                ]
            case "GPS_RAW_INT":
                self.fixes[f"{frame.origin}/{self._sender(message, frame)}"] = _fix(message)
                if message.fix_type < _FIX_IN_SPACE:
                    self.refused["no fix"] += 1
                    return []
        return [(kind, _READERS[kind](message))] if kind in _READERS else []

    def _possible(self, values: Values) -> Values:
        """The values without those that are none: NaN is MAVLink's "not known"."""
        possible = []
        for name, value in values:
            if isnan(value):
                self.refused["not available"] += 1
            elif not isfinite(value) or (name in self._angles and abs(value) > _LARGEST_ANGLE_DEG):
                self.refused["impossible value"] += 1
            else:
                possible.append((name, value))
        return possible

    def _named_value(self, message: Any) -> Values:
        channel, step = self._named.get(message.name.rstrip("\0"), ("", Linear(1.0)))
        return [(channel, step.apply(message.value))] if channel else []

    def _local_position(self, message: Any, frame: Frame) -> Values:
        """Latitude and longitude, once the autopilot has told its origin; empty where they cannot be.

        Height plays no part for a ship: it would shift a position 10 km from the origin by 1 cm.
        """
        origin = self._origins.get(self._senders.label(frame.sender))
        if origin is None:
            return []
        if not (BY_NAME["north_m"].holds(message.x) and BY_NAME["east_m"].holds(message.y)):
            self.refused["impossible value"] += 1
            return []
        latitude_deg, longitude_deg, _ = pymap3d.ned2geodetic(message.x, message.y, 0.0, *origin, 0.0)
        return [("latitude_deg", float(latitude_deg)), ("longitude_deg", float(longitude_deg))]

    def _set_origin(self, message: Any, frame: Frame) -> None:
        (latitude, latitude_deg), (longitude, longitude_deg) = _position(message.latitude, message.longitude)
        if BY_NAME[latitude].holds(latitude_deg) and BY_NAME[longitude].holds(longitude_deg):
            self._origins[self._senders.label(frame.sender)] = latitude_deg, longitude_deg
        else:
            self.refused["impossible value"] += 1

    def _notice_restart(self, message: Any, frame: Frame) -> None:
        """Time since boot that falls back: the autopilot has restarted, or 49.7 days are over.

        Two autopilots of one number would fall back without end; people are told once in a while.
        """
        boot_ms, sender = getattr(message, "time_boot_ms", None), self._sender(message, frame)
        if boot_ms is None:
            return
        last_ms = self._last_boot_ms.get(sender, 0)
        self._last_boot_ms[sender] = int(boot_ms)
        if boot_ms >= last_ms - _OUT_OF_ORDER_MS:
            return
        if self._boot_ns.pop(sender, None) is not None:
            self.clock.forget()
        if last_ms < _WRAP_MS - _NEAR_WRAP_MS:
            self._origins.pop(self._senders.label(frame.sender), None)
            if frame.monotonic_ns < self._quiet_until_ns:
                return
            self._quiet_until_ns = frame.monotonic_ns + _QUIET_NS
            self.notices.append(("warning", f"the autopilot has restarted after {last_ms / 1e3:.0f} s"))

    def _set_clock(self, message: Any, frame: Frame) -> None:
        if message.time_unix_usec == 0:  # the autopilot does not know the time yet
            return
        told_ns = message.time_unix_usec * _MICRO_NS
        self._boot_ns[self._sender(message, frame)] = told_ns - message.time_boot_ms * _MILLI_NS
        self.clock.announce(told_ns, frame)

    def _measured_ns(self, message: Any, frame: Frame) -> int | None:
        """When a message says that it was measured [ns UTC]: since boot, in ``time_usec`` perhaps since 1970."""
        since_ns = None
        if hasattr(message, "time_boot_ms"):
            since_ns = int(message.time_boot_ms) * _MILLI_NS
        elif hasattr(message, "time_usec"):
            since_ns = int(message.time_usec) * _MICRO_NS or None  # 0: it does not say
            if since_ns is not None and is_possible(since_ns):
                return since_ns
        boot_ns = self._boot_ns.get(self._sender(message, frame))
        return None if since_ns is None or boot_ns is None else boot_ns + since_ns


def _chosen(config: MavlinkLinks) -> tuple[str, ...]:
    """The messages that the configuration asks for, by default all that are read."""
    chosen = _WANTED if config.messages is None else config.messages
    for name in chosen:
        if name not in _WANTED + _CONTEXT:
            raise ConfigurationError(
                f"message {name!r} is not read",
                where=f"source {config.name!r}",
                why="nothing in it is a channel",
                fix=f"choose of {', '.join(_WANTED)}",
            )
    return tuple(chosen)
