"""The two values that walk through acquisition: a frame (bytes off a wire) and a sample (one number).

Thousands are made a second, so they are tuples with names.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from enum import IntEnum, IntFlag
from functools import lru_cache
from typing import Literal, NamedTuple

Protocol = Literal["can", "nmea0183", "mavlink", "mqtt"]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NANO = 1_000_000_000
"""Nanoseconds in a second."""


class Quality(IntEnum):
    """What is known of a value, in the flags of QARTOD."""

    GOOD = 1
    NOT_EVALUATED = 2
    SUSPECT = 3
    BAD = 4
    MISSING = 9


class FrameFlag(IntFlag):
    """What a frame was, besides its data."""

    NONE = 0
    STANDARD_ID = 1
    REMOTE = 2
    ERROR = 4
    WHOLE = 8
    """A message of NMEA 2000 that a gateway or a log has put together, if it took several frames."""
    LATE = 16
    """Stamped when the recorder could fetch it, after it had stood still: it came before."""
    RETAINED = 32
    """What an MQTT broker had kept of a topic, of an age that nobody knows."""


class Frame(NamedTuple):
    """Bytes as they came off one wire, with the times of their reception; nothing is decoded yet.

    ``payload`` is one CAN frame's data, or a whole message's (:attr:`FrameFlag.WHOLE`), one NMEA 0183 line without
    its line end, one MAVLink datagram, or one MQTT message behind its topic and a zero byte.
    ``stamped_ns`` is the UTC time that a log file or a gateway gave the frame, if any. ``sender`` is whoever
    sent it over a network, by address.
    """

    origin: str
    protocol: Protocol
    payload: bytes
    received_ns: int
    monotonic_ns: int
    identifier: int = 0
    flags: FrameFlag = FrameFlag.NONE
    stamped_ns: int | None = None
    sender: str = ""


class Sample(NamedTuple):
    """One value of one quantity in the house's unit, with its three times.

    ``measured_ns`` is the UTC time that the recording stamps the value with; ``source_ns`` is what the
    source itself said (None if it said nothing), on the clock named by ``clock``.
    """

    quantity: str
    value: float
    source: str
    received_ns: int
    monotonic_ns: int
    measured_ns: int
    source_ns: int | None = None
    clock: str = "receiver"
    quality: Quality = Quality.NOT_EVALUATED


_SATELLITE_TALKERS = frozenset({"GN", "GP", "GL", "GA", "GB", "BD", "GI", "GQ", "QZ"})


def label_parts(source: str) -> tuple[str, str, list[str]]:
    """A sample's source as its line, the device on it, and the message with what is said of it.

    >>> label_parts("bus/35:130306 apparent derived")
    ('bus', '35', ['130306', 'apparent', 'derived'])
    """
    line, _, rest = source.partition("/")
    device, _, words = rest.partition(":")
    return line, device, words.split(" ")


@lru_cache(maxsize=4096)
def sensor_of(source: str) -> str:
    """Line and device of a sample's source: a satellite receiver is one, whichever satellites it names itself by.

    >>> sensor_of("bridge/GP@GN01:GGA") == sensor_of("bridge/GN@GN01:RMC derived") == "bridge/GN@GN01"
    True
    """
    line, device, _ = label_parts(source)
    talker, at, tag = device.partition("@")
    return f"{line}/{'GN' if talker in _SATELLITE_TALKERS else talker}{at}{tag}"


class Fix(NamedTuple):
    """What a satellite receiver says of its fix, as far as it says it.

    ``kind`` is by the numbers of GGA, 0 for none; ``height_m`` is above the ellipsoid of WGS 84, or above mean sea
    level where the receiver tells no other; ``sigma_m`` are standard deviations to the east, to the north, upwards.
    """

    kind: int | None = None
    height_m: float | None = None
    sigma_m: tuple[float, float, float] | None = None


Group = list[Sample]
"""The samples of one message: they share source and times, so that pairs stay pairs."""


def now_ns() -> tuple[int, int]:
    """The wall clock (UTC, since 1970) and the monotonic clock at this moment [ns]."""
    return time.time_ns(), time.monotonic_ns()


def iso(time_ns: int) -> str:
    """A time in ns since 1970 as ISO 8601 with zone, to the microsecond."""
    return (EPOCH + timedelta(microseconds=time_ns // 1000)).isoformat()
