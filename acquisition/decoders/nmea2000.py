"""NMEA 2000: CAN frames to samples, by the ``nmea2000`` library behind our guards.

The library decodes whatever it is given; what is believable is decided here, before it (remote, error and
11-bit frames, short single frames, fast packets whose parts are too far apart) and after it (the references
of heading and wind).
"""

from __future__ import annotations

import datetime as dt
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import can
from nmea2000 import NMEA2000Decoder
from nmea2000.input_formats import N2KFormat

from acquisition.decoders import Notices
from acquisition.decoders.clock import SourceClock, utc_ns
from acquisition.frames import Frame, FrameFlag, Group
from acquisition.sections import Clock
from acquisition.units import DEG_PER_RAD

# A sequence number comes round after eight messages; parts further apart than this belong to two messages.
_LONGEST_PART_GAP_NS = 750_000_000
_DAY_S = 86_400
_SYSTEM_TIME = 126992
_GNSS_POSITION = 129029

LIBRARY = threading.Lock()
"""To be held around every call of the library: its codec, one a process, raises when two threads meet in it."""

Fields = dict[str, Any]
Values = list[tuple[str, float | None]]


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else value * scale


def _position(fields: Fields) -> Values:
    if fields.get("method") == 0:  # 129029 without a fix repeats an old position or invents one
        return []
    return [("latitude_deg", fields["latitude"]), ("longitude_deg", fields["longitude"])]


def _heading(fields: Fields) -> Values:
    heading_deg = _scaled(fields["heading"], DEG_PER_RAD)
    if fields["reference"] == 0:
        return [("heading_deg", heading_deg)]
    if fields["reference"] == 1 and heading_deg is not None and fields["variation"] is not None:
        to_true_deg = (fields["variation"] + (fields["deviation"] or 0.0)) * DEG_PER_RAD
        return [("heading_deg", (heading_deg + to_true_deg) % 360.0)]
    return []


def _rate_of_turn(fields: Fields) -> Values:
    return [("yaw_rate_dps", _scaled(fields["rate"], DEG_PER_RAD))]


def _attitude(fields: Fields) -> Values:
    return [
        ("roll_deg", _scaled(fields["roll"], DEG_PER_RAD)),
        ("pitch_deg", _scaled(fields["pitch"], DEG_PER_RAD)),
    ]


def _speed(fields: Fields) -> Values:
    return [("speed_through_water_mps", fields["speedWaterReferenced"])]


def _speed_components(fields: Fields) -> Values:
    return [
        ("surge_mps", fields["longitudinalSpeedGroundReferenced"]),
        ("sway_mps", fields["transverseSpeedGroundReferenced"]),
    ]


def _wind(fields: Fields) -> Values:
    if fields["reference"] != 0:  # bow-relative and magnetic winds are no wind from true north
        return []
    return [
        ("wind_direction_deg", _scaled(fields["windAngle"], DEG_PER_RAD)),
        ("wind_speed_mps", fields["windSpeed"]),
    ]


_READERS: dict[int, Callable[[Fields], Values]] = {
    127250: _heading,
    127251: _rate_of_turn,
    127257: _attitude,
    128259: _speed,
    129025: _position,
    _GNSS_POSITION: _position,
    130306: _wind,
    130578: _speed_components,
}


def parameter_group(identifier: int) -> tuple[int, int]:
    """The parameter group number and the source address in a 29-bit identifier.

    >>> parameter_group(0x09F11223)
    (127250, 35)
    """
    group = (identifier >> 8) & 0x3FFFF
    if (group >> 8) & 0xFF < 240:  # addressed to one device: the low byte is its address
        group &= 0x3FF00
    return group, identifier & 0xFF


class Nmea2000Decoder:
    """One bus; partial fast packets are kept by device and parameter group."""

    def __init__(self, stamps: Clock = "receiver", *, shares_bus: bool = False) -> None:
        self.refused: Counter[str] = Counter()
        self.notices: Notices = deque()
        self._shares_bus = shares_bus  # with a DBC file's frames, whose 11-bit identifiers are no fault
        self.clock = SourceClock(stamps, "nmea2000 126992")
        self._timekeeper: int | None = None
        self._singles = NMEA2000Decoder(bound_format=N2KFormat.PYTHON_CAN)
        self._fast: dict[tuple[int, int], tuple[NMEA2000Decoder, int]] = {}

    def decode(self, frame: Frame) -> list[Group]:
        group, device = parameter_group(frame.identifier)
        if not self._passes_guards(frame, group):
            return []
        message = self._library_decode(frame, group, device)
        if message is None:
            return []
        fields = {each.id: each.raw_value for each in message.fields}
        if group == _SYSTEM_TIME:
            self._announce(fields, frame, device)
            return []
        told_ns = _told_time(fields) if group == _GNSS_POSITION else None
        found = _READERS[group](fields)
        values = [(name, value) for name, value in found if value is not None]
        self.refused["not available"] += len(found) - len(values)
        return self.clock.group(frame, f"{frame.origin}/{device}:{group}", values, told_ns)

    def _passes_guards(self, frame: Frame, group: int) -> bool:
        if frame.flags == FrameFlag.STANDARD_ID and self._shares_bus:
            return False
        if frame.flags:
            self.refused["remote, error or 11-bit frame"] += 1
            return False
        if group not in _READERS and group != _SYSTEM_TIME:
            return False
        if len(frame.payload) != 8:
            self.refused["short frame"] += 1
            return False
        return True

    def _library_decode(self, frame: Frame, group: int, device: int) -> Any:
        message = can.Message(arbitration_id=frame.identifier, data=frame.payload, is_extended_id=True)
        decoder = self._fast_decoder(frame, group, device) if _is_fast(group) else self._singles
        try:
            with LIBRARY:
                return decoder.decode(message)
        except Exception:  # the library promises no set of errors for bytes off a wire
            self.refused["undecodable"] += 1
            return None

    def _fast_decoder(self, frame: Frame, group: int, device: int) -> NMEA2000Decoder:
        """The decoder that holds this device's parts; a fresh one if the parts it holds are stale."""
        decoder, last_ns = self._fast.get((device, group), (None, 0))
        if decoder is None or frame.monotonic_ns - last_ns > _LONGEST_PART_GAP_NS:
            decoder = NMEA2000Decoder(bound_format=N2KFormat.PYTHON_CAN)
        self._fast[device, group] = (decoder, frame.monotonic_ns)
        return decoder

    def _announce(self, fields: Fields, frame: Frame, device: int) -> None:
        """One device is the bus's clock until it falls silent: two clocks would make time go to and fro."""
        told_ns = _told_time(fields)
        if told_ns is not None and (device == self._timekeeper or self.clock.at(frame) is None):
            self._timekeeper = device
            self.clock.announce(told_ns, frame)


def _is_fast(group: int) -> bool:
    return bool(NMEA2000Decoder.is_fast_pgn(group))


def _told_time(fields: Fields) -> int | None:
    """Date and time as ns since 1970; the library's raw time keeps the fractions."""
    days, seconds = fields.get("date"), fields.get("time")
    if days is None or seconds is None or not 0 <= seconds < _DAY_S + 1:  # a leap second is possible
        return None
    return utc_ns(dt.date(1970, 1, 1) + dt.timedelta(days=int(days)), float(seconds))
