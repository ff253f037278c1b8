"""North and east of an origin: the plane that touches the WGS 84 ellipsoid there.

The closed form, written out for one point at a time because a recorder asks for it with every fix: 1 us instead
of the 20 us of a call made for arrays. ``pymap3d`` is the oracle that it is tested against.
"""

from __future__ import annotations

from math import cos, radians, sin, sqrt

_SEMI_MAJOR_M = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)


class TangentPlane:
    """The plane at ``latitude_deg``, ``longitude_deg``, at the height of the ellipsoid."""

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
