"""NMEA 2000: CAN frames to samples. What is believable is decided here; what a group means, beside it.

Guards come first: remote, error and 11-bit frames, frames of other than 8 bytes, messages of which a part was
lost; what a gateway has put together passes by the last. Sources are named by device, group and, where a group has
several, the meaning: ``bus/35:130306 apparent``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from seatrial.acquisition.config.declarations import GroupField
from seatrial.acquisition.config.sections import Clock, Device
from seatrial.acquisition.core.actuators import DEFAULT, Actuators
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.frames import Fix, Frame, FrameFlag, Group, Quality
from seatrial.acquisition.decoders import NO_SATELLITES, Decoder
from seatrial.acquisition.decoders.bus_devices import BusDevices
from seatrial.acquisition.decoders.clock import SourceClock
from seatrial.acquisition.decoders.declared_groups import DeclaredGroups
from seatrial.acquisition.decoders.fast_packets import LONGEST_BYTES, FastPackets
from seatrial.acquisition.decoders.parameter_groups import (
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
    GroupReading,
    Message,
    Value,
    group_time,
    machinery_readers,
)

_CLOCKS = (SYSTEM_TIME, TIME_AND_DATE, GNSS_POSITION)
"""What tells the time, best first: a position's time is that of the fix, which is late by the time it comes."""


def parameter_group(identifier: int) -> tuple[int, int]:
    """The parameter group number and the source address in a 29-bit identifier.

    >>> parameter_group(0x09F11223)
    (127250, 35)
    """
    group = (identifier >> 8) & 0x3FFFF
    if (group >> 8) & 0xFF < 240:  # addressed to one device: the low byte is its address
        group &= 0x3FF00
    return group, identifier & 0xFF


def _nothing(_: Message) -> GroupReading:
    """Of a group that only declared channels are in."""
    return GroupReading([])


class Bus:
    """What is known of one bus: its devices and clock, and messages of which parts have come."""

    def __init__(self, devices: BusDevices, clock: SourceClock, refused: Counter[str]) -> None:
        self.devices, self.clock = devices, clock
        self.fast = FastPackets(refused)
        self.timekeeper: tuple[str, int] | None = None
        self.first_instance: dict[tuple[str, int], int] = {}


class Nmea2000Decoder(Decoder):
    """The buses of one source: one, or those that a log names.

    Two buses may each have a device of the same address: labels tell them apart, ``bus/4@can0:127250``.
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
        """Raises :class:`ConfigurationError` for a declared field that is not known."""
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
            named = [name for name in self._buses if name]
            if len(named) > 1:
                text = f"there are several buses, {', '.join(named)}: devices of each are sources of their own"
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
        reading = self._readers.get(group, _nothing)(message)
        told_ns = None
        if group in _CLOCKS:
            told_ns = group_time(message)
            _announce(bus, told_ns, frame, group, device, reading.quality)
        sensor, quality = f"{frame.origin}/{device}", reading.quality
        if reading.fix is not None:
            self.fixes[sensor] = Fix(reading.fix, reading.height_m)
        elif group == POSITION and self.fixes.get(sensor, Fix()).kind in NO_SATELLITES:
            quality = Quality.SUSPECT  # the last position, again and again
        source, groups = f"{sensor}:{group}", []
        if reading.instance is None or self._is_first_instance(bus, device, group, reading.instance):
            meaning = f" {reading.meaning}" if reading.meaning else ""
            values = self._admitted(bus, device, reading.values)
            if group in self._declared:
                values = [pair for pair in values if pair[0] not in self._declared.channels_in(group)]
            groups = bus.clock.group(frame, source + meaning, values, told_ns, quality)
        if group in self._declared:
            declared = self._admitted(bus, device, self._declared.read(group, address, message))
            groups += bus.clock.group(frame, source, declared, told_ns)
        return groups

    def message(self, frame: Frame) -> tuple[int, int, Message] | None:
        """The message that is whole with this frame, with its group and the sender's address.

        None where the frame is refused, of no group that we listen to, or not the last one of its message.
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
        """The values that are there and wanted; those that are missing are counted."""
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
        """Whether no lower number of the same thing, a second rudder's say, was heard from the device."""
        first = min(instance, bus.first_instance.get((device, group), instance))
        bus.first_instance[device, group] = first
        if instance > first:
            self.refused["another instance"] += 1
        return instance == first


def _announce(bus: Bus, told_ns: int | None, frame: Frame, group: int, device: str, quality: Quality) -> None:
    """One device is the bus's clock until it falls silent: two clocks would make time go to and fro."""
    if told_ns is None or quality is not Quality.NOT_EVALUATED:
        return
    if bus.timekeeper is not None and bus.clock.at(frame) is not None:
        keeper, kept_by = bus.timekeeper
        if device != keeper or _CLOCKS.index(group) > _CLOCKS.index(kept_by):
            return
    bus.timekeeper = device, group
    bus.clock.name = f"nmea2000 {group}"
    bus.clock.announce(told_ns, frame)
