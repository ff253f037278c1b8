"""Channels to MAVLink datagrams: one datagram a moment, as an autopilot's router would bundle them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from math import nan, radians
from typing import Any

from seatrial.acquisition.config.sections import MavlinkLinks
from seatrial.acquisition.core.actuators import Actuators, shafts
from seatrial.acquisition.core.angles import wrap_180
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.decoders.mavlink import UNKNOWN_VELOCITY
from seatrial.acquisition.encoders import Moment, Packet
from seatrial.analysis.kinematics import to_earth

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

_UNKNOWN_COURSE = 65535


class MavlinkEncoder:
    """Attitude, velocity, position, wind, rpm and named values of one system."""

    def __init__(self, config: MavlinkLinks, actuators: Actuators, channels: Mapping[str, Channel]) -> None:
        self._link = dialect.MAVLink(None, srcSystem=config.system_id, srcComponent=1)
        self._announces = config.clock == "source"
        self._named = {
            channel: (entry.name.encode("ascii"), entry.step_to(channels[channel]))
            for channel, entry in config.named_values.items()
        }
        self._shafts = tuple(f"{name}_rpm" for name in shafts(actuators)[:2])
        self._boot_ns: int | None = None
        self._heading_deg: float | None = None

    def encode(self, moment: Moment) -> list[Packet]:
        if self._boot_ns is None:
            self._boot_ns = moment.time_ns
        boot_ms = round((moment.time_ns - self._boot_ns) / 1e6) % 2**32
        carries, messages = self._motion(moment, boot_ms)
        for more, message in self._machinery(moment, boot_ms):
            carries.update(more)
            messages.append(message)
        if self._announces:
            messages.insert(0, self._link.system_time_encode(moment.time_ns // 1000, boot_ms))
        if not messages:
            return []
        return [
            Packet(b"".join(outgoing.pack(self._link) for outgoing in messages), carries=tuple(sorted(carries)))
        ]

    def _motion(self, moment: Moment, boot_ms: int) -> tuple[set[str], list[Any]]:
        """Attitude, velocity and position, and which channels they carry; what is not known is not made up."""
        values, messages = moment.values, []
        carries = set(moment.present("heading_deg", "yaw_rate_dps"))
        if carries:
            messages.append(self._attitude(values, boot_ms))
        velocity = None
        if self._heading_deg is not None and {"surge_mps", "sway_mps"} <= values.keys():
            north_east = to_earth(values["surge_mps"], values["sway_mps"], radians(self._heading_deg))
            velocity = float(north_east[0]), float(north_east[1])
            messages.append(self._link.local_position_ned_encode(boot_ms, 0.0, 0.0, 0.0, *velocity, 0.0))
            carries |= {"surge_mps", "sway_mps"}
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            fix = round(moment.latitude_deg * 1e7), round(moment.longitude_deg * 1e7)
            rounded = [UNKNOWN_VELOCITY] * 2 if velocity is None else [round(100 * speed) for speed in velocity]
            messages.append(
                self._link.global_position_int_encode(boot_ms, *fix, 0, 0, *rounded, 0, _UNKNOWN_COURSE)
            )
            carries.update(moment.fix_of)
        return carries, messages

    def _attitude(self, values: dict[str, float], boot_ms: int) -> Any:
        if "heading_deg" in values:
            self._heading_deg = values["heading_deg"]
        yaw = radians(float(wrap_180(values.get("heading_deg", nan))))
        return self._link.attitude_encode(
            boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, radians(values.get("yaw_rate_dps", nan))
        )

    def _machinery(self, moment: Moment, boot_ms: int) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Wind, rpm and named values, each with the channels that it carries."""
        values = moment.values
        if wind := moment.present("wind_direction_deg", "wind_speed_mps"):
            direction_deg = float(wrap_180(values.get("wind_direction_deg", nan)))
            yield wind, self._link.wind_encode(direction_deg, values.get("wind_speed_mps", nan), 0.0)
        if rpm := moment.present(*self._shafts):
            first, second, *_ = (*(values.get(name, nan) for name in self._shafts), nan, nan)
            yield rpm, self._link.rpm_encode(first, second)
        for channel, (name, step) in self._named.items():
            if channel in values:
                message = self._link.named_value_float_encode(boot_ms, name, step.invert(values[channel]))
                yield (channel,), message
