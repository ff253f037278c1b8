"""Channels to MAVLink datagrams: one datagram a moment, as an autopilot's router would bundle them."""

from __future__ import annotations

import os
from math import cos, pi, radians, sin
from typing import Any

from acquisition.angles import wrap_180
from acquisition.channels import BY_NAME
from acquisition.config import MavlinkSource
from acquisition.encoders import Moment, Packet
from acquisition.units import scale_to

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

_UNKNOWN_COURSE = 65535


class MavlinkEncoder:
    """Attitude, velocity, position, wind, rpm and named values of one system."""

    def __init__(self, config: MavlinkSource) -> None:
        self._link = dialect.MAVLink(None, srcSystem=config.system_id, srcComponent=1)
        self._announces = config.clock == "source"
        self._named = {
            channel: (entry.name.encode("ascii"), scale_to(BY_NAME[channel].unit, entry.unit))
            for channel, entry in config.named_values.items()
        }
        self._boot_ns: int | None = None

    def encode(self, moment: Moment) -> list[Packet]:
        if self._boot_ns is None:
            self._boot_ns = moment.time_ns
        boot_ms = round((moment.time_ns - self._boot_ns) / 1e6) % 2**32
        messages = self._motion(moment, boot_ms) + self._machinery(moment, boot_ms)
        if self._announces:
            messages.insert(0, self._link.system_time_encode(moment.time_ns // 1000, boot_ms))
        return [Packet(b"".join(each.pack(self._link) for each in messages))] if messages else []

    def _motion(self, moment: Moment, boot_ms: int) -> list[Any]:
        values, messages = moment.values, []
        heading_deg = values.get("heading_deg")
        if heading_deg is not None:
            yaw = radians(float(wrap_180(heading_deg)))
            rate = radians(values.get("yaw_rate_dps", 0.0))
            messages.append(self._link.attitude_encode(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, rate))
        velocity = (0.0, 0.0)
        if heading_deg is not None and "surge_mps" in values and "sway_mps" in values:
            velocity = _over_ground(values["surge_mps"], values["sway_mps"], radians(heading_deg))
            messages.append(self._link.local_position_ned_encode(boot_ms, 0.0, 0.0, 0.0, *velocity, 0.0))
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            fix = round(moment.latitude_deg * 1e7), round(moment.longitude_deg * 1e7)
            rounded = round(velocity[0] * 100), round(velocity[1] * 100)
            messages.append(
                self._link.global_position_int_encode(boot_ms, *fix, 0, 0, *rounded, 0, _UNKNOWN_COURSE)
            )
        return messages

    def _machinery(self, moment: Moment, boot_ms: int) -> list[Any]:
        values, messages = moment.values, []
        if "wind_direction_deg" in values and "wind_speed_mps" in values:
            direction_deg = float(wrap_180(values["wind_direction_deg"]))
            messages.append(self._link.wind_encode(direction_deg, values["wind_speed_mps"], 0.0))
        if "port_rpm" in values and "starboard_rpm" in values:
            messages.append(self._link.rpm_encode(values["port_rpm"], values["starboard_rpm"]))
        for channel, (name, scale) in self._named.items():
            if channel in values:
                messages.append(self._link.named_value_float_encode(boot_ms, name, values[channel] / scale))
        return messages


def _over_ground(surge_mps: float, sway_mps: float, heading_rad: float) -> tuple[float, float]:
    """Velocity to north and east [m/s] from the ship's axes."""
    c, s = cos(heading_rad % (2 * pi)), sin(heading_rad % (2 * pi))
    return surge_mps * c - sway_mps * s, surge_mps * s + sway_mps * c
