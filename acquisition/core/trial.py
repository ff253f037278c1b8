"""A trial's description, and the two values that pass through acquisition: frames and samples.

The description has the ship, the place, the origin of the tangent plane, the crew's notes. A frame is bytes from a
wire, a sample one number; they are named tuples, since thousands are made every second.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import UTC, datetime, timedelta
from enum import IntEnum, IntFlag
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import Literal, NamedTuple

SOFTWARE = "seatrial"
"""What the version of all files that Seatrial writes begins with."""
Protocol = Literal["can", "nmea0183", "mavlink", "mqtt"]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NANO = 1_000_000_000
"""Nanoseconds in a second."""
HIGHEST_IDENTIFIER = 0x1FFFFFFF
"""Of a CAN frame: 29 bits."""
_NOT_IN_A_LABEL = re.compile(r"[^A-Za-z0-9._-]")
_MOST_READINGS, _CLOSE_NS = 3, 2000  # two readings of a clock take some 100 ns
_LONGEST_NAME = 32  # letters after the @ in a label; a TAG block's source has at most 15
SATELLITE_TALKERS = frozenset({"GN", "GP", "GL", "GA", "GB", "BD", "GI", "GQ", "QZ"})
"""The talkers of satellite receivers, by the satellites of a fix."""


@cache
def software_version() -> str:
    """The installed version of Seatrial, which is written into every output.

    Returns
    -------
    str
        The name and the version.

    Examples
    --------
    >>> import seatrial as st
    >>> st.version().split()[0]
    'seatrial'
    """
    try:
        return f"{SOFTWARE} {version(SOFTWARE)}"
    except PackageNotFoundError:
        return f"{SOFTWARE} (not installed)"


@dataclass(frozen=True, slots=True)
class Trial:
    """The run sheet of a recording. ``None`` and the empty string mean unknown.

    ``loading`` and ``sea_state`` are in the crew's words, ``trim_m`` is positive by the stern. The origin is
    that of the north-east-down tangent plane of ``north_m`` and ``east_m``. ``actuators`` lists the ship's as
    text (:func:`seatrial.acquisition.core.ship.actuators_as_text`), empty for the default list; ``channels`` are
    those declared in its configuration, as text (:func:`seatrial.acquisition.core.ship.declared_channels_as_json`),
    ``conditions`` those of its ``[conditions]``
    (:func:`seatrial.acquisition.config.run_sheet.conditions_in_trial`).
    ``context`` is what is known beforehand, ``[context]``, as JSON.
    ``antenna_forward_m`` and ``antenna_starboard_m`` are the place, from midship, of the point that the recorded
    positions are of; ``accuracy``, the standard errors of channels, and ``particulars``, the ship's, are JSON
    (:mod:`seatrial.acquisition.config.run_sheet`). The fields from ``summary`` on are those that data centres ask
    for, with their names in ACDD-1.3.
    """

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin_latitude_deg: float | None = None
    origin_longitude_deg: float | None = None
    water_depth_m: float | None = None
    draught_m: float | None = None
    crew_notes: str = ""
    trim_m: float | None = None
    loading: str = ""
    sea_state: str = ""
    actuators: str = ""
    channels: str = ""
    conditions: str = ""
    context: str = ""
    antenna_forward_m: float | None = None
    antenna_starboard_m: float | None = None
    accuracy: str = ""
    particulars: str = ""
    summary: str = ""
    keywords: str = ""
    creator_name: str = ""
    creator_email: str = ""
    institution: str = ""
    project: str = ""
    license: str = ""

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the origin [deg], if both are known."""
        if self.origin_latitude_deg is None or self.origin_longitude_deg is None:
            return None
        return self.origin_latitude_deg, self.origin_longitude_deg

    def as_metadata(self) -> dict[str, str]:
        """The MCAP metadata record ``trial``, without unknown fields."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        # bytes of a file name that are not UTF-8 are written as escapes: a recording could not hold them
        texts = {
            key: str(value).encode(errors="backslashreplace").decode()
            for key, value in values.items()
            if value not in (None, "")
        }
        if "name" in texts:
            texts["trial"] = texts.pop("name")
        return {**texts, "software_version": software_version()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Trial:
        """The inverse of :meth:`as_metadata`; unknown keys are ignored."""
        texts = dict(metadata)
        texts["name"] = texts.pop("trial", "")
        values: dict[str, str | float] = {}
        for field in fields(cls):
            if texts.get(field.name):
                numeric = "float" in str(field.type)
                values[field.name] = float(texts[field.name]) if numeric else texts[field.name]
        return cls(**values)  # type: ignore[arg-type]


class Quality(IntEnum):
    """The quality of a value, as QARTOD flags."""

    GOOD = 1
    NOT_EVALUATED = 2
    SUSPECT = 3
    BAD = 4
    MISSING = 9


class FrameFlag(IntFlag):
    """Properties of a frame besides its data."""

    NONE = 0
    STANDARD_ID = 1
    REMOTE = 2
    ERROR = 4
    WHOLE = 8
    """A message of NMEA 2000 that a gateway or a log has put together, if it took several frames."""
    LATE = 16
    """Stamped when the recorder could fetch it, after the recorder had been suspended: it came before."""
    RETAINED = 32
    """What an MQTT broker had kept of a topic, of unknown age."""


@cache
def can_flags(is_standard: bool, remote: bool = False, error: bool = False) -> FrameFlag:
    """The flags of a CAN frame: with an identifier of 11 bits, without data, of an error."""
    return FrameFlag(is_standard * FrameFlag.STANDARD_ID | remote * FrameFlag.REMOTE | error * FrameFlag.ERROR)


class Frame(NamedTuple):
    """Undecoded bytes as received from one wire, with the times of reception.

    ``payload`` is one CAN frame's data, or a whole message's (:attr:`FrameFlag.WHOLE`), one NMEA 0183 line
    without its line end, one MAVLink datagram, or one MQTT message after its topic and a zero byte.
    ``stamped_ns`` is the UTC time that a log file or a gateway gave the frame. ``sender`` is a network address; of
    a CAN frame of a log that has several buses it is the interface or channel.
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
    """One value of one quantity in its channel's unit, with its three times.

    ``measured_ns`` is the UTC time that the recording stamps the value with; ``source_ns`` is the time reported
    by the source (None if there is none), on the clock named by ``clock``.
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


def safe_source_label(name: str) -> str:
    """A name from the wire as it can stand in a label.

    >>> safe_source_label("can 0/1")
    'can_0_1'
    """
    return _NOT_IN_A_LABEL.sub("_", name[:_LONGEST_NAME])


def split_source_label(source: str) -> tuple[str, str, list[str]]:
    """A sample's source split into the line's name, the device on it, and the message with its remarks.

    >>> split_source_label("bus/35:130306 apparent derived")
    ('bus', '35', ['130306', 'apparent', 'derived'])
    """
    name, _, device_and_message = source.partition("/")
    device, _, words = device_and_message.partition(":")
    return name, device, words.split(" ")


@lru_cache(maxsize=4096)
def line_and_device(source: str) -> str:
    """Line and device of a sample's source; a satellite receiver is one device, whatever satellites it reports.

    >>> line_and_device("bridge/GP@GN01:GGA") == line_and_device("bridge/GN@GN01:RMC derived") == "bridge/GN@GN01"
    True
    """
    name, device, _ = split_source_label(source)
    talker, at, tag = device.partition("@")
    return f"{name}/{'GN' if talker in SATELLITE_TALKERS else talker}{at}{tag}"


class Fix(NamedTuple):
    """A satellite receiver's report of its fix; None where it reports nothing.

    ``kind`` is numbered as in GGA, 0 for none; ``height_m`` is above the WGS 84 ellipsoid, or above mean sea
    level if the receiver reports nothing else; ``sigma_m`` are standard deviations east, north and up.
    """

    kind: int | None = None
    height_m: float | None = None
    sigma_m: tuple[float, float, float] | None = None


Group = list[Sample]
"""The samples of one message: they share source and times, so that pairs stay together."""


def wall_and_monotonic_ns() -> tuple[int, int]:
    """The wall clock (UTC, since 1970) and the monotonic clock at this moment [ns].

    A busy system may suspend the process between the two readings. The wall clock is read between two readings of
    the other, at most three times, until these are close together: otherwise stamps of the system that are
    converted from one clock to the other would change their order.
    """
    readings = list[tuple[int, int, int]]()
    for _ in range(_MOST_READINGS):
        before_ns, wall_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after_ns - before_ns, wall_ns, (before_ns + after_ns) // 2))
        if after_ns - before_ns < _CLOSE_NS:
            break
    _, wall_ns, monotonic_ns = min(readings)
    return wall_ns, monotonic_ns


def iso_utc(time_ns: int) -> str:
    """A time in ns since 1970 as ISO 8601 with zone, to the microsecond."""
    return (EPOCH + timedelta(microseconds=time_ns // 1000)).isoformat()
