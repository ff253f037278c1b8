"""The 13 channels of a trial, as data: everybody's vocabulary.

Columns, topics, schema texts, range checks and circular treatment all derive from ``CHANNELS``. Frames and
signs: north-east-down earth frame; body frame x forward, y to starboard; yaw positive to starboard; azimuth
angles positive when the thrust vector turns to starboard; wind direction is where the wind comes from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Group = Literal["pose", "velocity", "environment", "command", "auxiliary"]


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity with its unit and the range of values that are possible for it.

    ``low`` and ``high`` are inclusive, except on a circle: there the range is one turn, and it includes
    the end that ``conventions`` gives (0 <= x < 360, or -180 < x <= 180).
    """

    name: str
    unit: str
    low: float
    high: float
    group: Group
    meaning: str
    circular: bool = False

    @property
    def topic(self) -> str:
        """The MCAP topic that carries this channel."""
        return f"/channel/{self.name}"

    def holds(self, value: float) -> bool:
        """Whether ``value`` [``unit``] is possible. NaN and infinities are not."""
        if not self.circular:
            return self.low <= value <= self.high
        if self.low < 0:
            return self.low < value <= self.high
        return self.low <= value < self.high

    def wrapped(self, value: float) -> float:
        """``value`` brought into this channel's turn; unchanged where the channel is no angle."""
        if not self.circular:
            return value
        if self.low < 0:
            return self.high - (self.high - value) % 360.0
        turned = value % 360.0
        return 0.0 if turned == 360.0 else turned  # -1e-20 % 360.0 is 360.0 in floating point


def _circle(name: str, group: Group, meaning: str, low: float = 0.0) -> Channel:
    return Channel(name, "deg", low, low + 360.0, group, meaning, circular=True)


CHANNELS: tuple[Channel, ...] = (
    Channel("north_m", "m", -1e6, 1e6, "pose", "Position north of the trial's origin"),
    Channel("east_m", "m", -1e6, 1e6, "pose", "Position east of the trial's origin"),
    _circle("heading_deg", "pose", "Heading from true north, clockwise"),
    Channel("surge_mps", "m/s", -30, 30, "velocity", "Speed over ground along the bow"),
    Channel("sway_mps", "m/s", -30, 30, "velocity", "Speed over ground to starboard"),
    Channel("yaw_rate_dps", "deg/s", -60, 60, "velocity", "Rate of turn, positive to starboard"),
    _circle("wind_direction_deg", "environment", "Direction the wind comes from, from true north"),
    Channel("wind_speed_mps", "m/s", 0, 100, "environment", "Wind speed over ground"),
    Channel("port_rpm", "rpm", -3000, 3000, "command", "Port shaft, negative in reverse"),
    _circle("port_angle_deg", "command", "Port azimuth, positive turns the thrust to starboard", -180.0),
    Channel("starboard_rpm", "rpm", -3000, 3000, "command", "Starboard shaft, negative in reverse"),
    _circle("starboard_angle_deg", "command", "Starboard azimuth, positive turns the thrust to starboard", -180.0),
    Channel("tunnel_rpm", "rpm", -3000, 3000, "command", "Tunnel thruster, positive pushes the bow to starboard"),
)
"""The 13 channels in their contractual order."""

AUXILIARY: tuple[Channel, ...] = (
    Channel("latitude_deg", "deg", -90, 90, "auxiliary", "Latitude, WGS 84"),
    Channel("longitude_deg", "deg", -180, 180, "auxiliary", "Longitude, WGS 84"),
    Channel("speed_through_water_mps", "m/s", -30, 30, "auxiliary", "Speed through the water along the bow"),
    Channel("roll_deg", "deg", -90, 90, "auxiliary", "Roll, positive to starboard"),
    Channel("pitch_deg", "deg", -90, 90, "auxiliary", "Pitch, positive bow up"),
    Channel("heave_m", "m", -100, 100, "auxiliary", "Heave, positive down"),
    Channel("speed_over_ground_mps", "m/s", 0, 30, "auxiliary", "Speed over ground along the course"),
    _circle("course_over_ground_deg", "auxiliary", "Course over ground from true north, clockwise"),
    _circle("heading_magnetic_deg", "auxiliary", "Heading from magnetic north, clockwise"),
    Channel("magnetic_variation_deg", "deg", -180, 180, "auxiliary", "Magnetic variation, positive to the east"),
    _circle("apparent_wind_angle_deg", "auxiliary", "Direction the wind on board comes from, from the bow"),
    Channel("apparent_wind_speed_mps", "m/s", 0, 100, "auxiliary", "Wind speed on board"),
    Channel("rudder_angle_deg", "deg", -90, 90, "auxiliary", "Rudder, positive turns the ship to starboard"),
    Channel("port_order_rpm", "rpm", -3000, 3000, "auxiliary", "Order to the port shaft"),
    _circle("port_order_angle_deg", "auxiliary", "Order to the port azimuth", -180.0),
    Channel("starboard_order_rpm", "rpm", -3000, 3000, "auxiliary", "Order to the starboard shaft"),
    _circle("starboard_order_angle_deg", "auxiliary", "Order to the starboard azimuth", -180.0),
    Channel("tunnel_order_rpm", "rpm", -3000, 3000, "auxiliary", "Order to the tunnel thruster"),
)
"""Channels that may be recorded beside the 13; they never replace one of them."""

NAMES: tuple[str, ...] = tuple(channel.name for channel in CHANNELS)
BY_NAME: dict[str, Channel] = {channel.name: channel for channel in (*CHANNELS, *AUXILIARY)}
POSE, VELOCITY, ENVIRONMENT, COMMAND = (
    tuple(channel.name for channel in CHANNELS if channel.group == group)
    for group in ("pose", "velocity", "environment", "command")
)
CIRCULAR: frozenset[str] = frozenset(channel.name for channel in BY_NAME.values() if channel.circular)
