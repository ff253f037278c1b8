"""Conversions between earth, ship and wind axes, and a trial's tangent plane: functions of floats.

Angles in degrees, clockwise; speeds in m/s; ``surge`` along the bow, ``sway`` to starboard. A wind direction or
angle is where the wind comes from.
"""

from __future__ import annotations

from math import atan2, cos, degrees, hypot, radians, sin, sqrt

_SEMI_MAJOR_M = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)


def along(direction_deg: float, speed_mps: float) -> tuple[float, float]:
    """The components of a velocity towards ``direction_deg``: north and east, or forward and to starboard."""
    angle = radians(direction_deg)
    return speed_mps * cos(angle), speed_mps * sin(angle)


def velocity_at_reference(
    surge_mps: float, sway_mps: float, yaw_rate_dps: float, forward_m: float, starboard_m: float
) -> tuple[float, float]:
    """Surge and sway of the reference point from those measured at a place forward and to starboard of it.

    A point of a rigid ship moves with ``u - r y`` and ``v + r x`` (Fossen 2011, eq. 2.118 in the plane).
    """
    yaw_rate = radians(yaw_rate_dps)
    return surge_mps + yaw_rate * starboard_m, sway_mps - yaw_rate * forward_m


def wind_over_ground(
    angle_deg: float, speed_mps: float, surge_mps: float, sway_mps: float, heading_deg: float
) -> tuple[float, float]:
    """True direction and speed over ground of the wind felt on a moving ship.

    ``angle_deg`` is relative to the bow. With zero surge and sway this only converts an angle to a direction.

        >>> direction, speed = wind_over_ground(0.0, 10.0, 4.0, 0.0, 270.0)
        >>> round(direction, 9), round(speed, 9)
        (270.0, 6.0)
    """
    ahead, starboard = along(angle_deg, speed_mps)  # where it comes from: the air moves the other way
    ahead, starboard = ahead - surge_mps, starboard - sway_mps
    speed = hypot(ahead, starboard)
    from_bow_deg = degrees(atan2(starboard, ahead)) if speed > 0.0 else angle_deg
    return (from_bow_deg + heading_deg) % 360.0, speed


def apparent_wind(angle_deg: float, speed_mps: float, speed_through_water_mps: float) -> tuple[float, float]:
    """Apparent wind angle and speed from a wind that an instrument has referred to the water.

    Instruments do so with heading and log speed, as if there were no leeway; this is the inverse.
    """
    ahead, starboard = along(angle_deg, speed_mps)
    ahead += speed_through_water_mps
    return degrees(atan2(starboard, ahead)) % 360.0, hypot(ahead, starboard)


class TangentPlane:
    """The tangent plane at ``latitude_deg``, ``longitude_deg``, at the height of the ellipsoid."""

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self.origin = latitude_deg, longitude_deg
        self._centre = _earth_centred(latitude_deg, longitude_deg)
        latitude, longitude = radians(latitude_deg), radians(longitude_deg)
        self._sin = sin(latitude), sin(longitude)
        self._cos = cos(latitude), cos(longitude)

    def north_east_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east [m] of a point on the ellipsoid."""
        x, y, z = (
            here - there
            for here, there in zip(_earth_centred(latitude_deg, longitude_deg), self._centre, strict=True)
        )
        (sin_latitude, sin_longitude), (cos_latitude, cos_longitude) = self._sin, self._cos
        outward = cos_longitude * x + sin_longitude * y
        return cos_latitude * z - sin_latitude * outward, cos_longitude * y - sin_longitude * x


def _earth_centred(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """Earth-centred, earth-fixed coordinates [m] of a point at the height of the ellipsoid."""
    latitude, longitude = radians(latitude_deg), radians(longitude_deg)
    sine = sin(latitude)
    normal_m = _SEMI_MAJOR_M / sqrt(1.0 - _ECCENTRICITY2 * sine * sine)
    from_axis_m = normal_m * cos(latitude)
    return (
        from_axis_m * cos(longitude),
        from_axis_m * sin(longitude),
        normal_m * (1.0 - _ECCENTRICITY2) * sine,
    )
