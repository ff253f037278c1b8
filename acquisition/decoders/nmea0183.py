"""NMEA 0183: sentences to samples, by ``pynmeagps`` behind a checksum that is not optional.

TRD (thruster response) is parsed here: the library takes its real numbers for integers and refuses them.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter, deque
from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Any

from pynmeagps import VALCKSUM, NMEAReader
from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEAStreamError, NMEATypeError

from acquisition.decoders import Notices
from acquisition.decoders.clock import SourceClock, nearest_day, utc_ns
from acquisition.frames import Frame, Group
from acquisition.sections import Clock, Thrusters
from acquisition.units import KNOT_MPS

Values = list[tuple[str, float]]
_LIBRARY_ERRORS = (NMEAParseError, NMEAMessageError, NMEATypeError, NMEAStreamError, ValueError, TypeError)


def checksum(body: bytes) -> int:
    """The exclusive or of the bytes between ``$`` and ``*``.

    >>> f"{checksum(b'RCTRD,3,-17.8,R,,V,'):02X}"
    '59'
    """
    return reduce(xor, body, 0)


def split_sentence(line: bytes) -> tuple[str, list[str]] | None:
    """The tag without its dollar sign and the fields of a sound sentence; None for anything else."""
    if len(line) < 8 or line[:1] not in b"$!" or line[-3:-2] != b"*":
        return None
    body = line[1:-3]
    try:
        if int(line[-2:], 16) != checksum(body):
            return None
        tag, *fields = body.decode("ascii").split(",")
    except ValueError:
        return None
    return tag, fields


def _present(*pairs: tuple[str, Any]) -> Values:
    """The fields that hold a number; the library leaves empty ones as empty text."""
    return [(name, float(value)) for name, value in pairs if isinstance(value, int | float)]


def _position(message: Any) -> Values:
    if getattr(message, "quality", 1) == 0 or getattr(message, "status", "A") != "A":
        return []
    both = _present(("latitude_deg", message.lat), ("longitude_deg", message.lon))
    return both if len(both) == 2 else []


def _ground_speed(message: Any) -> Values:
    if message.groundspdstatus != "A":
        return []
    speeds = _present(("surge_mps", message.longgroundspd), ("sway_mps", message.transgroundspd))
    return [(name, knots * KNOT_MPS) for name, knots in speeds]


def _rate_of_turn(message: Any) -> Values:
    if message.valid != "A":
        return []
    return [(name, deg_per_min / 60.0) for name, deg_per_min in _present(("yaw_rate_dps", message.rot))]


def _wind(message: Any) -> Values:
    direction = _present(("wind_direction_deg", message.dirT))
    speed = _present(("wind_speed_mps", message.speedM))
    if not speed:
        speed = [(name, knots * KNOT_MPS) for name, knots in _present(("wind_speed_mps", message.speedN))]
    return direction + speed


_READERS: dict[str, Callable[[Any], Values]] = {
    "GGA": _position,
    "GLL": _position,
    "RMC": _position,
    "HDT": lambda message: _present(("heading_deg", message.headingT)),
    "THS": lambda message: _present(("heading_deg", message.headt)) if message.mi == "A" else [],
    "ROT": _rate_of_turn,
    "VBW": _ground_speed,
    "MWD": _wind,
}


class Nmea0183Decoder:
    """One line; the date comes from ZDA or RMC, as position sentences tell only the time of day."""

    def __init__(self, thrusters: Thrusters | None = None, stamps: Clock = "receiver") -> None:
        self.refused: Counter[str] = Counter()
        self.notices: Notices = deque()
        self.clock = SourceClock(stamps, "nmea0183 ZDA or RMC")
        numbers = thrusters or Thrusters()
        self._thruster = {numbers.port: "port", numbers.starboard: "starboard", numbers.tunnel: "tunnel"}

    def decode(self, frame: Frame) -> list[Group]:
        sentence = split_sentence(frame.payload)
        if sentence is None:
            self.refused["no sound checksum"] += 1
            return []
        tag, fields = sentence
        source, kind = f"{frame.origin}/{tag[:-3]}:{tag[-3:]}", tag[-3:]
        if kind == "TRD":
            return self.clock.group(frame, source, self._thruster_response(fields))
        if kind not in _READERS and kind != "ZDA":
            return []
        message = self._parsed(frame)
        if message is None:
            return []
        try:
            told_ns = self._told_time(message, kind, frame)
            values = _READERS[kind](message) if kind in _READERS else []
        except AttributeError:  # the library leaves out the fields that a short sentence has not
            self.refused["too few fields"] += 1
            return []
        return self.clock.group(frame, source, values, told_ns)

    def _parsed(self, frame: Frame) -> Any:
        try:
            return NMEAReader.parse(frame.payload + b"\r\n", validate=VALCKSUM)
        except _LIBRARY_ERRORS:
            self.refused["undecodable"] += 1
            return None

    def _told_time(self, message: Any, kind: str, frame: Frame) -> int | None:
        """When the sentence says its values were true; ZDA and RMC also set the line's clock."""
        time = getattr(message, "time", None)
        if not isinstance(time, dt.time):
            return None
        seconds_of_day = time.hour * 3600 + time.minute * 60 + time.second + time.microsecond / 1e6
        date = _date_of(message, kind)
        if date is not None:
            told_ns = utc_ns(date, seconds_of_day)
            self.clock.announce(told_ns, frame)
            return told_ns
        now_ns = self.clock.at(frame)
        return None if now_ns is None else nearest_day(seconds_of_day, now_ns)

    def _thruster_response(self, fields: list[str]) -> Values:
        """TRD: number, rpm, mode, pitch, mode, azimuth; the azimuth is the direction of the thrust."""
        try:
            name = self._thruster[int(fields[0])]
            values = [(f"{name}_rpm", float(fields[1]))] if fields[2] == "R" and fields[1] else []
            if name != "tunnel" and fields[5]:
                values.append((f"{name}_angle_deg", float(fields[5])))
        except (KeyError, IndexError, ValueError):
            self.refused["thruster not understood"] += 1
            return []
        return values


def _date_of(message: Any, kind: str) -> dt.date | None:
    if kind == "RMC":
        return message.date if isinstance(message.date, dt.date) else None
    if kind == "ZDA":
        try:
            return dt.date(int(message.year), int(message.month), int(message.day))
        except (ValueError, TypeError):
            return None
    return None
