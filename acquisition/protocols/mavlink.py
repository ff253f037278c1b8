"""MAVLink: packets to samples, by ``pymavlink``, of one system, with bad data counted; and channels to datagrams.

Left out on purpose: SERVO_OUTPUT_RAW is an order and no measurement; ESC_TELEMETRY_1_TO_4 has rpm without a sign,
and a reversed propeller would look like one ahead; VFR_HUD has whole degrees of what ATTITUDE has more precisely.

``pymavlink``'s parser trusts the length byte of a damaged packet, and loses the sound packets within that length.
Here a damaged packet is only skipped as a whole where nothing sound begins inside it. The encoder sends one
datagram a moment, as an autopilot's router would bundle them.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import atan2, hypot, isfinite, isnan, nan, radians
from typing import Any, NamedTuple

import pymap3d
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config import declarations, sources
from seatrial.acquisition.core import quantities, ship, trial
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.protocols import BAD_DATA, DeclaredReaders, Decoder, FurtherSenders, Moment, Packet, clock

Values = list[tuple[str, float]]
UNKNOWN_VELOCITY = 32_767
"""What our encoder sends in GLOBAL_POSITION_INT where it has no velocity; no vessel makes 328 m/s."""
_UNKNOWN = 65_535  # of speeds, courses and headings in 16 bits
_NO_RPM = -1.0  # what ArduPilot sends of a shaft without a sensor, or with one that fails
_FIX_IN_SPACE = 3
_FIX_OF_TYPE = {0: 0, 1: 0, 2: 0, 3: 1, 4: 2, 5: 5, 6: 4}  # by the numbers of GGA
_MICRO_NS = 1000
_MILLI_NS = 1_000_000
_OUT_OF_ORDER_MS = 1_000  # messages of several tasks, and datagrams, may overtake each other
_LATEST_FIX_MS = 60_000  # a receiver without a new fix repeats the time of its last
_QUIET_NS = 60 * 10**9
_WRAP_MS = 2**32  # time since boot begins again after 49.7 days
_NEAR_WRAP_MS = 60_000
_LARGEST_ANGLE_DEG = 360.01  # a full turn, and what rounding adds to it
_INTEGER_TYPE = re.compile(r"(u?)int(\d+)_t")
_MAGIC = re.compile(b"[\xfd\xfe]")
_VERSION_1 = 0xFE
_SIGNED = 1  # the only incompatibility flag that we know; a packet with another one cannot be understood
_SIGNATURE_BYTES = 13
_CHECKSUM_BYTES = 2
_HEADER_BYTES = {0xFD: 10, 0xFE: 6}
CRC_EXTRA = {number: message.crc_extra for number, message in dialect.mavlink_map.items()}
LONGEST_BYTES = 10 + 255 + _CHECKSUM_BYTES + _SIGNATURE_BYTES
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _scale_or_nan(value: int, unit: float) -> float:
    return nan if value == _UNKNOWN else value * unit


def _position_values(latitude: int, longitude: int) -> Values:
    """A position in 1e-7 degrees; what autopilots send before their first fix is not one."""
    has_fix = (latitude, longitude) != (0, 0)
    return [
        ("latitude_deg", latitude / 1e7 if has_fix else nan),
        ("longitude_deg", longitude / 1e7 if has_fix else nan),
    ]


def _global_position_values(message: Any) -> Values:
    has_velocity = UNKNOWN_VELOCITY not in (message.vx, message.vy)
    return [
        *_position_values(message.lat, message.lon),
        ("velocity_north_mps", message.vx / 100.0 if has_velocity else nan),
        ("velocity_east_mps", message.vy / 100.0 if has_velocity else nan),
        ("heading_deg", _scale_or_nan(message.hdg, 0.01)),
    ]


def _wind_values(message: Any) -> Values:
    """The vector points to where the wind blows; the direction is where it comes from. A calm has none."""
    speed_mps = hypot(message.wind_x, message.wind_y)
    if speed_mps == 0.0 or not isfinite(speed_mps):
        return [("wind_speed_mps", speed_mps)]
    from_deg = atan2(-message.wind_y, -message.wind_x) * quantities.DEG_PER_RAD % 360.0
    return [("wind_direction_deg", from_deg), ("wind_speed_mps", speed_mps)]


_READERS: dict[str, Callable[[Any], Values]] = {
    "ATTITUDE": lambda message: [
        ("heading_deg", message.yaw * quantities.DEG_PER_RAD),
        ("yaw_rate_dps", message.yawspeed * quantities.DEG_PER_RAD),
        ("roll_deg", message.roll * quantities.DEG_PER_RAD),
        ("pitch_deg", message.pitch * quantities.DEG_PER_RAD),
    ],
    "GLOBAL_POSITION_INT": _global_position_values,
    "GPS_RAW_INT": lambda message: [
        *_position_values(message.lat, message.lon),
        ("speed_over_ground_mps", _scale_or_nan(message.vel, 0.01)),
        ("course_over_ground_deg", _scale_or_nan(message.cog, 0.01)),
    ],
    # the position is relative to the autopilot's origin, and a separate group
    "LOCAL_POSITION_NED": lambda message: [("velocity_north_mps", message.vx), ("velocity_east_mps", message.vy)],
    "WIND": lambda message: [("wind_direction_deg", message.direction), ("wind_speed_mps", message.speed)],
    "WIND_COV": _wind_values,
}
_MESSAGES = (*_READERS, "RPM", "RAW_RPM", "NAMED_VALUE_FLOAT")
_CONTEXT = ("SYSTEM_TIME", "GPS_GLOBAL_ORIGIN")  # without samples, but needed for the others: always read
MESSAGE_NAMES = {getattr(dialect, f"MAVLINK_MSG_ID_{name}"): name for name in (*_MESSAGES, *_CONTEXT)}


class _MessageChannel(NamedTuple):
    """A channel that a message carries."""

    channel: ship.Channel
    origin: declarations.MavlinkField
    step: quantities.Linear
    unknown: int | None


class DeclaredMessages(DeclaredReaders[str, _MessageChannel]):
    """The declared channels in messages; ``names`` are the messages by number.

    Raises :class:`ConfigurationError` for a message or field that the dialect lacks, and units that do not fit.
    """

    def __init__(self, declared: Sequence[tuple[ship.Channel, declarations.MavlinkField]]) -> None:
        super().__init__()
        self.names: dict[int, str] = {}
        kinds = {message_class.msgname: message_class for message_class in dialect.mavlink_map.values()}
        for channel, origin in declared:
            with declarations.locate_errors_at_channel(channel):
                kind = _message_class_of_origin(origin, kinds)
                step = origin.conversion_to_channel(channel, kind.fieldunits_by_name.get(origin.field))
            self.names[kind.id] = origin.message
            # by MAVLink's convention the highest whole number means that the value is not known
            match = _INTEGER_TYPE.fullmatch(kind.fieldtypes[kind.fieldnames.index(origin.field)])
            unknown = None if match is None else 2 ** (int(match[2]) - (match[1] == "")) - 1
            message_channel = _MessageChannel(channel, origin, step, unknown)
            self.setdefault(origin.message, []).append(message_channel)

    def read(self, name: str, message: Any) -> list[tuple[str, float]]:
        """The channels in a message with their values, NaN for one that is not known."""
        values = []
        for channel, origin, step, unknown in self.get(name, ()):
            if all(getattr(message, field) == code for field, code in origin.where.items()):
                value = getattr(message, origin.field)
                value = value if origin.index is None else value[origin.index]
                values.append((channel.name, nan if value == unknown else step.apply(float(value))))
        return values


def _message_class_of_origin(origin: declarations.MavlinkField, kinds: Mapping[str, Any]) -> Any:
    """The dialect's message that a declaration names, if it has its fields and they are numbers."""
    kind = kinds.get(origin.message)
    if kind is None:
        matches = ", ".join(get_close_matches(origin.message, kinds, n=3)) or "ATTITUDE"
        raise ConfigurationError(f"MAVLink has no message {origin.message}", fix=f"write one such as {matches}")
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


class MavlinkDecoder(Decoder):
    """One link; ``time_boot_ms`` becomes UTC by the last SYSTEM_TIME."""

    def __init__(
        self,
        config: sources.MavlinkLinks,
        actuators: ship.Actuators = ship.DEFAULT,
        declared: declarations.Declarations = (),
    ) -> None:
        """Raises :class:`ConfigurationError` where ``messages`` names one that is not read, or a declared channel
        an unknown one."""
        super().__init__()
        self.clock = clock.SourceClock(config.clock, "mavlink SYSTEM_TIME", self.notices)
        self._system_id, self._component_id = config.system_id, config.component_id
        channels = ship.channels_with_declared(tuple(declaration.channel for declaration in declared))
        self._declared = DeclaredMessages(
            declarations.origins_of_kind(declared, config.channels, declarations.MavlinkField)
        )
        self._names = MESSAGE_NAMES | self._declared.names
        requested = _MESSAGES if config.messages is None else config.messages
        for name in requested:
            if name not in _MESSAGES + _CONTEXT:
                where, fix = f"source {config.name!r}", f"choose of {', '.join(_MESSAGES)}"
                why = "nothing in it is a channel"
                raise ConfigurationError(f"message {name!r} is not read", where=where, why=why, fix=fix)
        self._requested = frozenset((*requested, *_CONTEXT, *self._declared.names.values()))
        self._named_values = {
            entry.name: (channel, entry.conversion_to_channel(channels[channel]))
            for channel, entry in config.named_values.items()
        }
        self._shafts = tuple(f"{name}_rpm" for name in ship.shafts(actuators)[:2])
        self._angles = frozenset(name for name in ship.channel_names(actuators) if ship.BY_NAME[name].circular)
        self._boot_ns: dict[str, int] = {}  # by sender: each counts from its start
        self._last_boot_ms: dict[str, int] = {}
        self._quiet_until_ns = 0
        self._origins: dict[str, tuple[float, float]] = {}  # by sender: a companion may have its own
        self._cutter = PacketCutter(complete=isinstance(config, sources.MavlinkFileSource))
        self._link = dialect.MAVLink(None)
        self._senders = FurtherSenders()

    def decode(self, frame: trial.Frame) -> list[trial.Group]:
        groups = []
        for piece in self._cutter.push(frame.payload):
            if isinstance(piece, Fault):
                self.refused[piece.reason] += 1
                continue
            header = parse_header(piece)
            kind = self._names.get(header.message_id, "")
            if header.system_id != self._system_id:
                self.refused["another system"] += 1
            elif self._component_id not in (None, header.component_id):
                self.refused["another component"] += 1
            elif not kind:  # messages that are never read are no refusals
                self.count_unknown_message(message_name(header.message_id))
            elif kind not in self._requested:
                self.refused["message not wanted"] += 1
            else:
                groups += self._decode_message(kind, piece, frame)
        return groups

    def _decode_message(self, kind: str, packet: bytes, frame: trial.Frame) -> list[trial.Group]:
        """The values in a message without missing and impossible ones: NaN is MAVLink's "not known".

        The sender is the system, with the component where it is not the autopilot: a companion is another source;
        so is another system of the same number, at another address.
        """
        try:
            message = self._link.decode(bytearray(packet))
        except dialect.MAVError:
            self.refused["undecodable"] += 1
            return []
        component, address = message.get_srcComponent(), self._senders.label(frame.sender)
        sender = f"{self._system_id}"
        sender += "" if component == dialect.MAV_COMP_ID_AUTOPILOT1 else f".{component}"
        sender += f"@{address}" if address else ""
        source_ns, groups, readings = self._measured_time_ns(message, frame, sender), [], []
        if kind in _CONTEXT:
            self._set_clock_or_origin(kind, message, frame, sender)
        else:
            readings = self._read_values_by_source(kind, message, frame, sender)
        if kind in self._declared:
            readings = [(label, self._declared.values_not_declared(kind, values)) for label, values in readings]
            readings.append((kind, self._declared.read(kind, message)))
        for label, values in readings:
            possible = []
            for name, value in values:
                if isnan(value):
                    self.refused["not available"] += 1
                elif not isfinite(value) or (name in self._angles and abs(value) > _LARGEST_ANGLE_DEG):
                    self.refused["impossible value"] += 1
                else:
                    possible.append((name, value))
            groups += self.clock.group_values(frame, f"{frame.origin}/{sender}:{label}", possible, source_ns)
        return groups

    def _read_values_by_source(
        self, kind: str, message: Any, frame: trial.Frame, sender: str
    ) -> list[tuple[str, Values]]:
        """The values in a message, a list a group, each with the label of its source."""
        match kind:
            case "NAMED_VALUE_FLOAT":
                channel, step = self._named_values.get(message.name.rstrip("\0"), ("", quantities.Linear(1.0)))
                return [(kind, [(channel, step.apply(message.value))] if channel else [])]
            case "RPM":
                rpm = (nan if value == _NO_RPM else value for value in (message.rpm1, message.rpm2))
                return [(kind, list(zip(self._shafts, rpm, strict=False)))]
            case "RAW_RPM":  # its unit is rpm, although the field is called frequency
                return [(kind, [(name, message.frequency) for name in self._shafts[message.index :][:1]])]
            case "LOCAL_POSITION_NED":
                # height plays no part for a ship: it would shift a position 10 km from the origin by 1 cm
                origin, position = self._origins.get(sender, self._origins.get(self._autopilot(sender))), []
                if (
                    origin is not None
                    and ship.BY_NAME["north_m"].is_possible_value(message.x)
                    and ship.BY_NAME["east_m"].is_possible_value(message.y)
                ):
                    latitude_deg, longitude_deg, _ = pymap3d.ned2geodetic(message.x, message.y, 0.0, *origin, 0.0)
                    position = [("latitude_deg", float(latitude_deg)), ("longitude_deg", float(longitude_deg))]
                elif origin is not None:
                    self.refused["impossible value"] += 1
                return [(kind, _READERS[kind](message)), ("GPS_GLOBAL_ORIGIN", position)]
            case "GPS_RAW_INT":
                # what the receiver does not know is 0 in the fields that version 2 has added
                across_m, up_m = message.h_acc / 1e3, message.v_acc / 1e3
                sigma_m = (across_m, across_m, up_m) if across_m > 0.0 and up_m > 0.0 else None
                height_m = (message.alt_ellipsoid or message.alt) / 1e3
                fix = trial.Fix(_FIX_OF_TYPE.get(message.fix_type, 1), height_m, sigma_m)
                self.fixes[f"{frame.origin}/{sender}"] = fix
                if message.fix_type < _FIX_IN_SPACE:
                    self.refused["no fix"] += 1
                    return []
        return [(kind, _READERS[kind](message))] if kind in _READERS else []

    def _set_clock_or_origin(self, kind: str, message: Any, frame: trial.Frame, sender: str) -> None:
        """The clock, or the origin of local positions, by a message without samples."""
        if kind == "GPS_GLOBAL_ORIGIN":
            (latitude, latitude_deg), (longitude, longitude_deg) = _position_values(
                message.latitude, message.longitude
            )
            if ship.BY_NAME[latitude].is_possible_value(latitude_deg) and ship.BY_NAME[longitude].is_possible_value(
                longitude_deg
            ):
                self._origins[sender] = latitude_deg, longitude_deg
            else:
                self.refused["impossible value"] += 1
        elif message.time_unix_usec != 0:  # else the autopilot does not have the time yet
            utc_ns = message.time_unix_usec * _MICRO_NS
            self._boot_ns[sender] = utc_ns - message.time_boot_ms * _MILLI_NS
            if sender == self._autopilot(sender) or self._autopilot(sender) not in self._boot_ns:
                self.clock.announce(utc_ns, frame)

    def _autopilot(self, sender: str) -> str:
        """The autopilot of a sender's vehicle: the same system, at the same address."""
        _, at, address = sender.partition("@")
        return f"{self._system_id}{at}{address}"

    def _measured_time_ns(self, message: Any, frame: trial.Frame, sender: str) -> int | None:
        """When a message states that it was measured [ns UTC]: since boot, in ``time_usec`` perhaps since 1970.

        Time since boot that falls back: the autopilot has restarted, or 49.7 days are over. Two autopilots of one
        number would fall back again and again: the notices are limited in rate.
        """
        since_ns = None
        if hasattr(message, "time_boot_ms"):
            boot_ms, last_ms = int(message.time_boot_ms), self._last_boot_ms.get(sender, 0)
            since_ns = boot_ms * _MILLI_NS
            self._last_boot_ms[sender] = boot_ms
            if boot_ms < last_ms - _OUT_OF_ORDER_MS:
                if self._boot_ns.pop(sender, None) is not None:
                    self.clock.forget_announcement()
                if last_ms < _WRAP_MS - _NEAR_WRAP_MS:
                    self._origins.pop(sender, None)
                    if frame.monotonic_ns >= self._quiet_until_ns:
                        self._quiet_until_ns = frame.monotonic_ns + _QUIET_NS
                        text = f"the autopilot has restarted after {last_ms / 1e3:.0f} s"
                        self.notices.append(("warning", text))
        elif hasattr(message, "time_usec"):
            since_ns = int(message.time_usec) * _MICRO_NS or None  # 0: it does not state it
            if since_ns is not None and clock.is_possible_time(since_ns):
                return since_ns
            if since_ns is not None and since_ns // _MILLI_NS < self._last_boot_ms.get(sender, 0) - _LATEST_FIX_MS:
                return None  # it has restarted, and has not stated yet when
        boot_ns = self._boot_ns.get(sender)
        return None if since_ns is None or boot_ns is None else boot_ns + since_ns


@dataclass(frozen=True, slots=True)
class Header:
    """Who sent a packet, and the number of the message in it."""

    system_id: int
    component_id: int
    message_id: int


@dataclass(frozen=True, slots=True)
class Fault:
    """Bytes that are no usable packet, and why."""

    reason: str


def mavlink_crc(data: bytes) -> int:
    """CRC-16/MCRF4XX, by the standard library's CRC of the opposite bit order.

    >>> hex(mavlink_crc(b"123456789"))
    '0x6f91'
    """
    backwards = crc_hqx(data.translate(_REVERSED), 0xFFFF)
    return _REVERSED[backwards & 0xFF] << 8 | _REVERSED[backwards >> 8]


def parse_header(packet: bytes) -> Header:
    """The header of a whole packet of either version."""
    if packet[0] == _VERSION_1:
        return Header(packet[3], packet[4], packet[5])
    return Header(packet[5], packet[6], int.from_bytes(packet[7:10], "little"))


def message_name(number: int) -> str:
    """The name of a message, or its number where the dialect has none."""
    message = dialect.mavlink_map.get(number)
    return str(message.msgname) if message else str(number)


def packet_length(data: bytes, offset: int) -> int:
    """The number of bytes of the packet that begins at ``offset``; 0 where none can begin.

    Where its first three bytes have not all come, the length exceeds what there is.
    """
    header_bytes = _HEADER_BYTES.get(data[offset])
    if header_bytes is None:
        return 0
    if offset + 3 > len(data):
        return 3
    signature_bytes = 0
    if data[offset] != _VERSION_1:
        if data[offset + 2] & ~_SIGNED:
            return 0
        signature_bytes = _SIGNATURE_BYTES if data[offset + 2] & _SIGNED else 0
    return header_bytes + data[offset + 1] + _CHECKSUM_BYTES + signature_bytes


def has_valid_checksum(data: bytes, offset: int = 0) -> bool:
    """Whether a whole packet of a known message begins at ``offset``, with a right checksum.

    The checksum includes a number that belongs to the message, so that of an unknown message cannot be checked.
    """
    length = packet_length(data, offset)
    if length == 0 or offset + length > len(data):
        return False
    extra = CRC_EXTRA.get(parse_header(data[offset : offset + 10]).message_id)
    end = offset + _HEADER_BYTES[data[offset]] + data[offset + 1]
    if extra is None:
        return False
    return mavlink_crc(data[offset + 1 : end] + bytes((extra,))) == int.from_bytes(data[end : end + 2], "little")


def is_signed_packet(data: bytes, offset: int = 0) -> bool:
    """Whether the packet at ``offset`` ends in a signature, which no checksum covers. We do not verify it."""
    return data[offset] != _VERSION_1 and bool(data[offset + 2] & _SIGNED)


class PacketCutter:
    """Cuts a stream, in whatever pieces it comes, into packets and faults. At most two packets are kept waiting.

    With ``complete`` every piece ends where a packet ends, as in a log; otherwise a packet may go on in the next.
    """

    def __init__(self, *, complete: bool) -> None:
        self._complete = complete
        self._pending = b""

    def push(self, received: bytes) -> list[bytes | Fault]:
        """The packets and faults that are complete now, in their order."""
        damaged: list[bytes | Fault] = []
        if self._pending and received and has_valid_checksum(received):
            # The pending bytes are the end of a damaged packet; they must not delay what came now.
            damaged, _ = _cut_packets(self._pending, complete=True)
            self._pending = b""
        data = self._pending + received
        pieces, used_bytes = _cut_packets(data, complete=self._complete)
        self._pending = data[used_bytes:]
        return damaged + pieces


def _cut_packets(data: bytes, *, complete: bool) -> tuple[list[bytes | Fault], int]:
    """Packets and faults from the beginning of ``data``, and how many of its bytes they are made of.

    Unless it is ``complete``, an end on which bytes to come may decide is not cut.
    """
    starts = (match.start() for match in _MAGIC.finditer(data))
    sound = [*(start for start in starts if has_valid_checksum(data, start)), len(data)]
    pieces: list[bytes | Fault] = []
    at, skipped = 0, False
    while at < len(data):
        end = at + packet_length(data, at)
        following = sound[bisect_left(sound, at)]
        if following == at:
            piece: bytes | Fault | None = data[at:end]
            following = sound[bisect_left(sound, at + 1)]
            if is_signed_packet(data, at) and end - _SIGNATURE_BYTES <= following < end:
                end = following  # its signature was cut off
        elif at < end and not complete and _may_become_valid(data, at, end):
            break
        else:  # a length is credible if no sound packet begins before its end, and one may begin there
            is_credible = at < end <= following and (end == len(data) or data[end] in _HEADER_BYTES)
            unknown = is_credible and parse_header(data[at:end]).message_id not in CRC_EXTRA
            piece = Fault("unknown message" if unknown else BAD_DATA) if is_credible else None
        if piece is None:
            match = _MAGIC.search(data, at + 1)
            skipped, at = True, match.start() if match else len(data)
            continue
        pieces += [Fault(BAD_DATA), piece] if skipped else [piece]
        skipped, at = False, end
    return pieces + [Fault(BAD_DATA)] * skipped, at


def _may_become_valid(data: bytes, at: int, end: int) -> bool:
    """Whether bytes to come may show that a packet without a right checksum has another length than it states.

    What follows may begin no packet, or a packet that began inside may turn out to be sound.
    """
    if end >= len(data):
        return True
    inner = _MAGIC.finditer(data, max(at + 1, len(data) - LONGEST_BYTES), end)
    return any(match.start() + packet_length(data, match.start()) > len(data) for match in inner)


class MavlinkEncoder:
    """Attitude, velocity, position, wind, rpm and named values of one system."""

    def __init__(
        self, config: sources.MavlinkLinks, actuators: ship.Actuators, channels: Mapping[str, ship.Channel]
    ) -> None:
        self._link = dialect.MAVLink(None, srcSystem=config.system_id, srcComponent=1)
        self._announces = config.clock == "source"
        self._named_values = {
            channel: (entry.name.encode("ascii"), entry.conversion_to_channel(channels[channel]))
            for channel, entry in config.named_values.items()
        }
        self._shafts = tuple(f"{name}_rpm" for name in ship.shafts(actuators)[:2])
        self._boot_ns: int | None = None
        self._heading_deg: float | None = None

    def encode(self, moment: Moment) -> list[Packet]:
        if self._boot_ns is None:
            self._boot_ns = moment.time_ns
        boot_ms = round((moment.time_ns - self._boot_ns) / 1e6) % 2**32
        outgoing = [*self._motion_messages(moment, boot_ms), *self._machinery(moment, boot_ms)]
        carries = {channel for channels, _ in outgoing for channel in channels}
        messages = [message for _, message in outgoing]
        if self._announces:
            messages.insert(0, self._link.system_time_encode(moment.time_ns // 1000, boot_ms))
        payload = b"".join(message.pack(self._link) for message in messages)
        return [Packet(payload, carries=tuple(sorted(carries)))] if messages else []

    def _motion_messages(self, moment: Moment, boot_ms: int) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Attitude, velocity and position, with the channels that they carry; unknown values are not invented."""
        values = moment.values
        if attitude := moment.present("heading_deg", "yaw_rate_dps"):
            self._heading_deg = values.get("heading_deg", self._heading_deg)
            yaw = radians(float(ship.wrap_180(values.get("heading_deg", nan))))
            rate = radians(values.get("yaw_rate_dps", nan))
            yield attitude, self._link.attitude_encode(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, rate)
        speeds = moment.present("surge_mps", "sway_mps")
        rounded = [UNKNOWN_VELOCITY] * 2
        if self._heading_deg is not None and len(speeds) == 2:
            north, east = quantities.to_earth(values["surge_mps"], values["sway_mps"], radians(self._heading_deg))
            velocity = float(north), float(east)
            rounded = [round(100 * speed) for speed in velocity]
            yield speeds, self._link.local_position_ned_encode(boot_ms, 0.0, 0.0, 0.0, *velocity, 0.0)
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            fix = round(moment.latitude_deg * 1e7), round(moment.longitude_deg * 1e7)
            message = self._link.global_position_int_encode(boot_ms, *fix, 0, 0, *rounded, 0, _UNKNOWN)
            yield moment.channels_in_fix, message

    def _machinery(self, moment: Moment, boot_ms: int) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Wind, rpm and named values, each with the channels that it carries."""
        values = moment.values
        if wind := moment.present("wind_direction_deg", "wind_speed_mps"):
            direction_deg = float(ship.wrap_180(values.get("wind_direction_deg", nan)))
            yield wind, self._link.wind_encode(direction_deg, values.get("wind_speed_mps", nan), 0.0)
        if rpm := moment.present(*self._shafts):
            first, second, *_ = (*(values.get(name, nan) for name in self._shafts), nan, nan)
            yield rpm, self._link.rpm_encode(first, second)
        for channel, (name, step) in self._named_values.items():
            if channel in values:
                message = self._link.named_value_float_encode(boot_ms, name, step.invert(values[channel]))
                yield (channel,), message
