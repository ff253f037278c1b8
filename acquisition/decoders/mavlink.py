"""MAVLink: datagrams to samples, by ``pymavlink``; one system, known messages, bad data counted."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from typing import Any

from acquisition.channels import BY_NAME
from acquisition.config import MavlinkSource
from acquisition.decoders.clock import SourceClock
from acquisition.frames import Frame, Group
from acquisition.units import DEG_PER_RAD, scale_to

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

Values = list[tuple[str, float]]
_MICRO_NS = 1000
_MILLI_NS = 1_000_000


def _attitude(message: Any) -> Values:
    return [
        ("heading_deg", message.yaw * DEG_PER_RAD),
        ("yaw_rate_dps", message.yawspeed * DEG_PER_RAD),
        ("roll_deg", message.roll * DEG_PER_RAD),
        ("pitch_deg", message.pitch * DEG_PER_RAD),
    ]


def _global_position(message: Any) -> Values:
    return [
        ("latitude_deg", message.lat / 1e7),
        ("longitude_deg", message.lon / 1e7),
        ("velocity_north_mps", message.vx / 100.0),
        ("velocity_east_mps", message.vy / 100.0),
    ]


def _local_velocity(message: Any) -> Values:
    """Speeds only: the position is relative to the autopilot's own origin, not to the trial's."""
    return [("velocity_north_mps", message.vx), ("velocity_east_mps", message.vy)]


_READERS: dict[str, Callable[[Any], Values]] = {
    "ATTITUDE": _attitude,
    "GLOBAL_POSITION_INT": _global_position,
    "LOCAL_POSITION_NED": _local_velocity,
    "RPM": lambda message: [("port_rpm", message.rpm1), ("starboard_rpm", message.rpm2)],
    "WIND": lambda message: [("wind_direction_deg", message.direction), ("wind_speed_mps", message.speed)],
}


class MavlinkDecoder:
    """One link; ``time_boot_ms`` becomes UTC by the last SYSTEM_TIME."""

    def __init__(self, config: MavlinkSource) -> None:
        self.refused: Counter[str] = Counter()
        self.clock = SourceClock(config.clock, "mavlink SYSTEM_TIME")
        self._system_id = config.system_id
        self._named = {
            entry.name: (channel, scale_to(BY_NAME[channel].unit, entry.unit))
            for channel, entry in config.named_values.items()
        }
        self._boot_ns: int | None = None
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True

    def decode(self, frame: Frame) -> list[Group]:
        try:
            messages = self._parser.parse_buffer(frame.payload) or []
        except dialect.MAVError:
            self.refused["undecodable"] += 1
            return []
        return [group for message in messages for group in self._group(message, frame)]

    def _group(self, message: Any, frame: Frame) -> list[Group]:
        kind = message.get_type()
        if kind == "BAD_DATA":
            self.refused["bad data"] += 1
            return []
        if message.get_srcSystem() != self._system_id:
            self.refused["another system"] += 1
            return []
        if kind == "SYSTEM_TIME":
            self._set_clock(message, frame)
            return []
        values = self._named_value(message) if kind == "NAMED_VALUE_FLOAT" else []
        if kind in _READERS:
            values = _READERS[kind](message)
        return self.clock.group(frame, f"{frame.origin}/{self._system_id}:{kind}", values, self._told(message))

    def _named_value(self, message: Any) -> Values:
        channel, scale = self._named.get(message.name.rstrip("\0"), ("", 1.0))
        return [(channel, message.value * scale)] if channel else []

    def _set_clock(self, message: Any, frame: Frame) -> None:
        if message.time_unix_usec == 0:  # the autopilot does not know the time yet
            return
        told_ns = message.time_unix_usec * _MICRO_NS
        self._boot_ns = told_ns - message.time_boot_ms * _MILLI_NS
        self.clock.announce(told_ns, frame)

    def _told(self, message: Any) -> int | None:
        boot_ms = getattr(message, "time_boot_ms", None)
        if boot_ms is None or self._boot_ns is None:
            return None
        return self._boot_ns + int(boot_ms) * _MILLI_NS
