"""NMEA 2000: CAN frames to samples. Which messages are plausible is decided here; what a group means is in
:mod:`~seatrial.acquisition.protocols.parameter_groups`.

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
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from seatrial.acquisition.config.declarations import GroupField
from seatrial.acquisition.config.sources import Clock, Device
from seatrial.acquisition.core.ship import DEFAULT, Actuators, Channel
from seatrial.acquisition.core.trial import Fix, Frame, FrameFlag, Group, Quality, safe_label
from seatrial.acquisition.protocols import NO_SATELLITES, Decoder, Notices
from seatrial.acquisition.protocols.clock import SourceClock
from seatrial.acquisition.protocols.parameter_groups import (
    ADDRESS_CLAIM,
    FIELDS,
    FRAME_BYTES,
    GNSS_POSITION,
    POSITION,
    READERS,
    SHORT_FRAMES,
    SHORTEST_BYTES,
    SYSTEM_TIME,
    TIME_AND_DATE,
    DeclaredGroups,
    GroupReading,
    Message,
    Value,
    group_time,
    machinery_readers,
)

_CLOCKS = (SYSTEM_TIME, TIME_AND_DATE, GNSS_POSITION)
"""The groups with the time, best first: a position's time is that of the fix, which arrives with a delay."""
_NO_ADDRESS = 254  # claimed by a device that found none free
_MOST_NAMES = 512  # a bus has 252 addresses; more NAMEs than this are noise that looks like claims
_LONGEST_GAP_NS = 750_000_000  # parts with a longer gap belong to two messages
_MOST_BEGUN_SINCE = 4  # a message of which parts are missing after so many others will never be complete
_FIRST_PART_BYTES, _PART_BYTES = 6, 7
LONGEST_BYTES = _FIRST_PART_BYTES + 31 * _PART_BYTES
INCOMPLETE = "incomplete fast packet"


def parameter_group(identifier: int) -> tuple[int, int]:
    """The parameter group number and the source address in a 29-bit identifier.

    >>> parameter_group(0x09F11223)
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
        stamps: Clock = "receiver",
        devices: tuple[Device, ...] = (),
        actuators: Actuators = DEFAULT,
        reduction_ratios: Mapping[str, float] | None = None,
        *,
        shares_bus: bool = False,
        declared: Sequence[tuple[Channel, GroupField]] = (),
    ) -> None:
        """Raises :class:`ConfigurationError` for an unknown declared field."""
        super().__init__()
        self._stamps, self._configured = stamps, devices
        self._buses = {"": self._new_bus("")}
        self._shares_bus = shares_bus  # with a DBC file's frames, whose 11-bit identifiers are no fault
        self._readers = READERS | machinery_readers(actuators, reduction_ratios or {})
        self._declared = DeclaredGroups(declared)
        self._shortest = self._declared.shortest | SHORTEST_BYTES

    @property
    def clock(self) -> SourceClock:
        """The clock of the bus that has no name."""
        return self._buses[""].clock

    def bus(self, frame: Frame) -> Bus:
        """The bus that a frame is from."""
        bus = self._buses.get(frame.sender)
        if bus is None:
            bus = self._buses[frame.sender] = self._new_bus(frame.sender)
            names = [name for name in self._buses if name]
            if len(names) > 1:
                text = f"there are several buses, {', '.join(names)}: devices of each are sources of their own"
                self.notices.append(("info", f"{text}, like {bus.devices.label(frame.identifier & 0xFF)}"))
        return bus

    def _new_bus(self, name: str) -> Bus:
        clock = SourceClock(self._stamps, f"nmea2000 {SYSTEM_TIME}", self.notices)
        clock.muted = bool(name) and self.clock.muted
        return Bus(BusDevices(self._configured, self.notices, name), clock, self.refused)

    def decode(self, frame: Frame) -> list[Group]:
        bus = self.bus(frame)
        parsed = self._message(frame, bus)
        if parsed is None:
            return []
        group, address, message = parsed
        device = bus.devices.label(address)
        read = self._readers.get(group)
        reading = GroupReading([]) if read is None else read(message)  # none: only declared channels are in it
        source_ns = None
        if group in _CLOCKS:
            source_ns = group_time(message)
            _announce(bus, source_ns, frame, group, device, reading.quality)
        sensor, quality = f"{frame.origin}/{device}", reading.quality
        if reading.fix is not None:
            self.fixes[sensor] = Fix(reading.fix, reading.height_m)
        elif group == POSITION and self.fixes.get(sensor, Fix()).kind in NO_SATELLITES:
            quality = Quality.SUSPECT  # the last position, repeated
        source, groups = f"{sensor}:{group}", []
        if reading.instance is None or self._is_first_instance(bus, device, group, reading.instance):
            meaning = f" {reading.meaning}" if reading.meaning else ""
            values = self._admitted(bus, device, reading.values)
            if group in self._declared:
                values = [pair for pair in values if pair[0] not in self._declared.channels_in(group)]
            groups = bus.clock.group(frame, source + meaning, values, source_ns, quality)
        if group in self._declared:
            declared = self._admitted(bus, device, self._declared.read(group, address, message))
            groups += bus.clock.group(frame, source, declared, source_ns)
        return groups

    def message(self, frame: Frame) -> tuple[int, int, Message] | None:
        """The message that this frame completes, with its group and the sender's address.

        None where the frame is refused, of no group that we decode, or not the last one of its message.
        """
        return self._message(frame, self.bus(frame))

    def _message(self, frame: Frame, bus: Bus) -> tuple[int, int, Message] | None:
        group, address = parameter_group(frame.identifier)
        if not self._passes_guards(frame, group):
            return None
        if group == ADDRESS_CLAIM:
            if bus.devices.claim(address, frame.payload):
                bus.fast.forget(address)
            return None
        payload: bytes | None = frame.payload
        if group in self._shortest and not frame.flags & FrameFlag.WHOLE:
            payload = bus.fast.push(address, group, frame.payload, frame.monotonic_ns, self._shortest[group])
        return None if payload is None else (group, address, Message(FIELDS.get(group, {}), payload))

    def _passes_guards(self, frame: Frame, group: int) -> bool:
        kind = frame.flags and frame.flags & ~FrameFlag.LATE
        if kind and kind != FrameFlag.WHOLE:
            if kind != FrameFlag.STANDARD_ID or not self._shares_bus:
                self.refused["remote, error or 11-bit frame"] += 1
            return False
        if group not in self._readers and group not in self._declared and group != ADDRESS_CLAIM:
            if not self._shares_bus:  # else it may be a frame of the DBC file's
                self.note_unknown(str(group))
            return False
        if kind and group in self._shortest:
            if not self._shortest[group] <= len(frame.payload) <= LONGEST_BYTES:
                self.refused["impossible length"] += 1
                return False
            return True
        if len(frame.payload) not in (FRAME_BYTES, SHORT_FRAMES.get(group)):
            self.refused["frame of other than 8 bytes"] += 1
            return False
        return True

    def _admitted(self, bus: Bus, device: str, candidates: Iterable[tuple[str, Value]]) -> list[tuple[str, float]]:
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

    def _is_first_instance(self, bus: Bus, device: str, group: int, instance: int) -> bool:
        """Whether the device has sent no lower number of the same thing, of a second rudder for example."""
        first = min(instance, bus.first_instance.get((device, group), instance))
        bus.first_instance[device, group] = first
        if instance > first:
            self.refused["another instance"] += 1
        return instance == first


def _announce(bus: Bus, source_ns: int | None, frame: Frame, group: int, device: str, quality: Quality) -> None:
    """One device is the bus's clock until it falls silent: two clocks would make time jump back and forth."""
    if source_ns is None or quality is not Quality.NOT_EVALUATED:
        return
    if bus.timekeeper is not None and bus.clock.at(frame) is not None:
        keeper, keeper_group = bus.timekeeper
        if device != keeper or _CLOCKS.index(group) > _CLOCKS.index(keeper_group):
            return
    bus.timekeeper = device, group
    bus.clock.name = f"nmea2000 {group}"
    bus.clock.announce(source_ns, frame)


_LEADS_TO = {
    "latitude_deg": {"north_m", "east_m", "longitude_deg"},
    "longitude_deg": {"north_m", "east_m", "latitude_deg"},
    "heading_magnetic_deg": {"heading_deg"},
    "magnetic_variation_deg": {"heading_deg", "wind_direction_deg", "surge_mps", "sway_mps"},
    "course_over_ground_deg": {"surge_mps", "sway_mps"},
    "course_magnetic_deg": {"surge_mps", "sway_mps"},
    "speed_over_ground_mps": {"surge_mps", "sway_mps"},
    "wind_direction_magnetic_deg": {"wind_direction_deg"},
    "wind_angle_apparent_deg": {"apparent_wind_angle_deg", "wind_direction_deg", "wind_speed_mps"},
    "wind_speed_apparent_mps": {"apparent_wind_speed_mps", "wind_direction_deg", "wind_speed_mps"},
    "wind_angle_theoretical_deg": {"wind_direction_deg", "wind_speed_mps"},
    "wind_speed_theoretical_mps": {"wind_direction_deg", "wind_speed_mps"},
    "wind_angle_water_deg": {"wind_direction_deg", "wind_speed_mps"},
    "wind_speed_water_mps": {"wind_direction_deg", "wind_speed_mps"},
}
"""The channels that are derived from a quantity, besides the one of its name."""


class BusDevices:
    """The devices of one bus, as configured and as observed; ``bus`` distinguishes the buses of one log."""

    def __init__(self, configured: tuple[Device, ...], notices: Notices, bus: str = "") -> None:
        self.at_bus = f"@{safe_label(bus)}" if bus else ""
        labels = [(device.name + self.at_bus, device) for device in configured]
        self._by_iso_name = {device.iso_name: label for label, device in labels if device.iso_name is not None}
        self._by_address = {device.address: label for label, device in labels if device.address is not None}
        self._provides = {
            label: {
                *device.channels,
                *(name for name, derived in _LEADS_TO.items() if derived & {*device.channels}),
            }
            for label, device in labels
            if device.channels is not None
        }
        self._notices = notices
        self._name_at: dict[int, str] = {}
        self._label_of: dict[str, str] = {}
        self._label_at: dict[int, str] = {}

    def label(self, address: int) -> str:
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

    def claim(self, address: int, payload: bytes) -> bool:
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
        return self._take(address, name, former_address)

    def _take(self, address: int, name: str, former_address: int | None) -> bool:
        former_name, former_label = self._name_at.get(address), self._label_at.get(address)
        label = self._label_of.get(name) or self._new_label(address, name)
        self._name_at[address], self._label_of[name], self._label_at[address] = name, label, label
        if former_address is not None:
            self._notices.append(("warning", f"device {label} moved from address {former_address} to {address}"))
        if former_name is not None:
            text = f"address {address} was taken over from device {former_label} by device {label} (NAME {name})"
            self._notices.append(("warning", text))
        return former_label not in (None, label) or former_name is not None

    def _new_label(self, address: int, name: str) -> str:
        """The label of a NAME that is new on the bus."""
        label = self._by_iso_name.get(name) or self._default_label(address)
        return name + self.at_bus if label in self._label_of.values() else label

    def _default_label(self, address: int) -> str:
        return self._by_address.get(address, f"{address}{self.at_bus}")


@dataclass(slots=True)
class _Partial:
    """The parts of one message by their places; ``length`` [bytes] is known from the first part on."""

    begun: int
    last_ns: int
    last_place: int = -1
    length: int = LONGEST_BYTES
    parts: dict[int, bytes] = field(default_factory=dict)

    @property
    def places(self) -> int:
        """How many parts the message has, at most."""
        return 1 + -(-max(0, self.length - _FIRST_PART_BYTES) // _PART_BYTES)


@dataclass(slots=True)
class _Stream:
    """The messages of one group from one address. ``closed`` is the last number that was completed or refused."""

    begun: int = 0
    closed: int | None = None
    partials: dict[int, _Partial] = field(default_factory=dict)


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
        partial = stream.partials.get(number)
        if partial is not None and place == partial.last_place and partial.parts[place] == data:
            return None  # the same part twice in a row, as when its acknowledgement was disturbed
        if partial is not None and not _continues(partial, place, part[1], monotonic_ns):
            self._drop(stream, number)
            partial = None
        if partial is None:
            if place and number == stream.closed:  # a part of a message that is complete already
                return None
            partial = self._begin(stream, number, monotonic_ns)
        if place == 0:
            if not max(1, shortest) <= part[1] <= LONGEST_BYTES:
                self._refused["impossible length"] += 1
                _close(stream, number)
                return None
            partial.length = part[1]
        partial.parts[place], partial.last_place, partial.last_ns = data, place, monotonic_ns
        if len(partial.parts) < partial.places:
            return None
        _close(stream, number)
        return b"".join(partial.parts[index] for index in range(partial.places))[: partial.length]

    def forget(self, address: int) -> None:
        """A new device has this address: what the former one began will not be continued."""
        for key in [key for key in self._streams if key[0] == address]:
            self._refused[INCOMPLETE] += len(self._streams.pop(key).partials)

    def _begin(self, stream: _Stream, number: int, monotonic_ns: int) -> _Partial:
        stream.begun += 1
        for earlier, partial in list(stream.partials.items()):
            if stream.begun - partial.begun >= _MOST_BEGUN_SINCE:
                self._drop(stream, earlier)
        stream.closed = None if stream.closed == number else stream.closed
        stream.partials[number] = partial = _Partial(stream.begun, monotonic_ns)
        return partial

    def _drop(self, stream: _Stream, number: int) -> None:
        self._refused[INCOMPLETE] += 1
        del stream.partials[number]


def _continues(partial: _Partial, place: int, length: int, monotonic_ns: int) -> bool:
    """Whether a part can belong to a message of which others have come; ``length`` is that in a first part."""
    if monotonic_ns - partial.last_ns > _LONGEST_GAP_NS or place in partial.parts:
        return False
    if place:
        return place < partial.places
    message = _Partial(0, 0, length=length)
    return max(partial.parts) < message.places and len(partial.parts) < message.places - 1


def _close(stream: _Stream, number: int) -> None:
    stream.partials.pop(number, None)
    stream.closed = number
