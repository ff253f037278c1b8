"""MAVLink: datagrams to samples, by ``pymavlink``; one system, known messages, bad data counted."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable
from math import isnan
from typing import Any

from acquisition.channels import BY_NAME
from acquisition.decoders import Notices
from acquisition.decoders.clock import SourceClock
from acquisition.frames import Frame, Group
from acquisition.sections import MavlinkLinks
from acquisition.units import DEG_PER_RAD, scale_to

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

Values = list[tuple[str, float]]
UNKNOWN_VELOCITY = 32_767
"""What our own encoder sends in GLOBAL_POSITION_INT where it knows no velocity; no vessel makes 328 m/s."""
_MICRO_NS = 1000
_MILLI_NS = 1_000_000
_OUT_OF_ORDER_MS = 1_000  # messages of several tasks, and datagrams, may overtake each other


def _attitude(message: Any) -> Values:
    return [
        ("heading_deg", message.yaw * DEG_PER_RAD),
        ("yaw_rate_dps", message.yawspeed * DEG_PER_RAD),
        ("roll_deg", message.roll * DEG_PER_RAD),
        ("pitch_deg", message.pitch * DEG_PER_RAD),
    ]


def _global_position(message: Any) -> Values:
    velocity = [("velocity_north_mps", message.vx / 100.0), ("velocity_east_mps", message.vy / 100.0)]
    if UNKNOWN_VELOCITY in (message.vx, message.vy):
        velocity = []
    if message.lat == 0 and message.lon == 0:  # what autopilots send before their first fix
        return velocity
    return [("latitude_deg", message.lat / 1e7), ("longitude_deg", message.lon / 1e7), *velocity]


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

    def __init__(self, config: MavlinkLinks) -> None:
        self.refused: Counter[str] = Counter()
        self.notices: Notices = deque()
        self.clock = SourceClock(config.clock, "mavlink SYSTEM_TIME")
        self._system_id = config.system_id
        self._named = {
            entry.name: (channel, scale_to(BY_NAME[channel].unit, entry.unit))
            for channel, entry in config.named_values.items()
        }
        self._boot_ns: dict[int, int] = {}  # by component: each counts from its own start
        self._last_boot_ms: dict[int, int] = {}
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
        kind: str = message.get_type()
        if kind == "BAD_DATA":
            self.refused["bad data"] += 1
            return []
        if message.get_srcSystem() != self._system_id:
            self.refused["another system"] += 1
            return []
        self._notice_restart(message)
        if kind == "SYSTEM_TIME":
            self._set_clock(message, frame)
            return []
        values = self._named_value(message) if kind == "NAMED_VALUE_FLOAT" else []
        if kind in _READERS:
            values = _READERS[kind](message)
        known = [(name, value) for name, value in values if not isnan(value)]  # NaN is MAVLink's "not known"
        return self.clock.group(frame, f"{frame.origin}/{self._system_id}:{kind}", known, self._told(message))

    def _named_value(self, message: Any) -> Values:
        channel, scale = self._named.get(message.name.rstrip("\0"), ("", 1.0))
        return [(channel, message.value * scale)] if channel else []

    def _notice_restart(self, message: Any) -> None:
        """Time since boot that falls back: the autopilot has restarted, or 49.7 days are over."""
        boot_ms, component = getattr(message, "time_boot_ms", None), message.get_srcComponent()
        if boot_ms is None:
            return
        fell_back = boot_ms < self._last_boot_ms.get(component, 0) - _OUT_OF_ORDER_MS
        if fell_back and self._boot_ns.pop(component, None) is not None:
            self.clock.forget()
        self._last_boot_ms[component] = int(boot_ms)

    def _set_clock(self, message: Any, frame: Frame) -> None:
        if message.time_unix_usec == 0:  # the autopilot does not know the time yet
            return
        told_ns = message.time_unix_usec * _MICRO_NS
        self._boot_ns[message.get_srcComponent()] = told_ns - message.time_boot_ms * _MILLI_NS
        self.clock.announce(told_ns, frame)

    def _told(self, message: Any) -> int | None:
        boot_ms = getattr(message, "time_boot_ms", None)
        boot_ns = self._boot_ns.get(message.get_srcComponent())
        return None if boot_ms is None or boot_ns is None else boot_ns + int(boot_ms) * _MILLI_NS
