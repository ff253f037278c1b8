"""Quantities: units, array types, and conversions between earth, ship and wind axes.

Conversions of single floats take angles in degrees, clockwise, and speeds in m/s; ``surge`` is along the bow,
``sway`` to starboard; a wind direction or angle is where the wind comes from. Inside the code everything else is SI
with angles in radians; channels are in the units that their names end in (``_m _deg _mps _dps _rpm _percent``). A
conversion of units is one affine step, ``house = scale * value + offset``, to the house's unit of that quantity.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic_core import core_schema

from seatrial.acquisition.core import errors

if TYPE_CHECKING:
    import pandas as pd

NAUTICAL_MILE_M = 1852.0
KNOT_MPS = NAUTICAL_MILE_M / 3600.0
GRAVITY_MPS2 = 9.80665
DEG_PER_RAD = 180.0 / pi
DIMENSIONLESS = "1"
"""The unit of counts, codes and ratios, whose names have no ending."""
DEGREES_AND_MINUTES = "ddmm"
"""The unit of angles given as degrees and minutes in one number."""
_SEMI_MAJOR_M = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)


def components_of_velocity(direction_deg: float, speed_mps: float) -> tuple[float, float]:
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
    ahead, starboard = components_of_velocity(
        angle_deg, speed_mps
    )  # where it comes from: the air moves the other way
    ahead, starboard = ahead - surge_mps, starboard - sway_mps
    speed = hypot(ahead, starboard)
    from_bow_deg = degrees(atan2(starboard, ahead)) if speed > 0.0 else angle_deg
    return (from_bow_deg + heading_deg) % 360.0, speed


def apparent_wind_of_water_wind(
    angle_deg: float, speed_mps: float, speed_through_water_mps: float
) -> tuple[float, float]:
    """Apparent wind angle and speed from a wind that an instrument has referred to the water.

    Instruments do so with heading and log speed, as if there were no leeway; this is the inverse.
    """
    ahead, starboard = components_of_velocity(angle_deg, speed_mps)
    ahead += speed_through_water_mps
    return degrees(atan2(starboard, ahead)) % 360.0, hypot(ahead, starboard)


class TangentPlane:
    """The tangent plane at ``latitude_deg``, ``longitude_deg``, at the height of the ellipsoid."""

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self.origin = latitude_deg, longitude_deg
        self._centre = _earth_centred_coordinates_m(latitude_deg, longitude_deg)
        latitude, longitude = radians(latitude_deg), radians(longitude_deg)
        self._sin = sin(latitude), sin(longitude)
        self._cos = cos(latitude), cos(longitude)

    def north_east_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east [m] of a point on the ellipsoid."""
        x, y, z = (
            point - centre
            for point, centre in zip(
                _earth_centred_coordinates_m(latitude_deg, longitude_deg), self._centre, strict=True
            )
        )
        (sin_latitude, sin_longitude), (cos_latitude, cos_longitude) = self._sin, self._cos
        outward = cos_longitude * x + sin_longitude * y
        return cos_latitude * z - sin_latitude * outward, cos_longitude * y - sin_longitude * x


def _earth_centred_coordinates_m(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """Earth-centred, earth-fixed coordinates [m] of a point at the height of the ellipsoid."""
    latitude, longitude = radians(latitude_deg), radians(longitude_deg)
    sine = sin(latitude)
    normal_m = _SEMI_MAJOR_M / sqrt(1.0 - _ECCENTRICITY2 * sine * sine)
    from_axis_m = normal_m * cos(latitude)
    return (from_axis_m * cos(longitude), from_axis_m * sin(longitude), normal_m * (1.0 - _ECCENTRICITY2) * sine)


def to_earth(forward: Floats | float, starboard: Floats | float, heading_rad: ArrayLike) -> tuple[Floats, Floats]:
    """Components forward and to starboard as components to north and east, all of one shape."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    return forward * cosine - starboard * sine, forward * sine + starboard * cosine


def rotate_earth_to_ship(
    north: Floats | float, east: Floats | float, heading_rad: ArrayLike
) -> tuple[Floats, Floats]:
    """Components to north and east as components forward and to starboard: the inverse of :func:`to_earth`."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    return north * cosine + east * sine, east * cosine - north * sine


def integrate(rate: AnyArray, time_s: Floats | float) -> AnyArray:
    """A rate [n, per s] integrated by the trapezoidal rule from its first sample, where the result is 0: [n].

    ``time_s`` are its times [n], or the step of an even grid [s].
    """
    steps_s = np.diff(time_s) if np.ndim(time_s) else time_s
    return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps_s))


def mean_wind_speed_and_direction(table: pd.DataFrame) -> tuple[float, float]:
    """The mean speed [m/s] of rows without gaps, and the direction [deg] that the mean wind vector comes from."""
    direction = np.deg2rad(table["wind_direction_deg"].to_numpy(dtype=float))
    speed = table["wind_speed_mps"].to_numpy(dtype=float)
    north, east = float(np.mean(speed * np.cos(direction))), float(np.mean(speed * np.sin(direction)))
    return float(np.mean(speed)), float(np.rad2deg(np.arctan2(east, north)) % 360.0)


def water_depth_m(values: Mapping[str, Any] | pd.DataFrame) -> NDArray[np.float64]:
    """The depth of the water from the values of channels [m], NaN where none is recorded: that below the transducer
    (DPT and DBT of NMEA 0183, 128267 of NMEA 2000) and from there up to the waterline, where that is known. A
    sounder that has lost the bottom reports 0.

    >>> float(water_depth_m({"depth_below_transducer_m": 30.0, "depth_offset_m": 4.0}))
    34.0
    """
    below, up = (values.get(name, np.nan) for name in ("depth_below_transducer_m", "depth_offset_m"))
    depth = values.get("water_depth_m", below + np.where(np.greater(up, 0.0), up, 0.0))
    return np.where(np.greater(depth, 0.0) & np.not_equal(below, 0.0), depth, np.nan)


class _AsLists:
    """Has pydantic write an array as nested lists in JSON, with elements of this type; null is NaN."""

    def __init__(self, dtype: type) -> None:
        self.dtype = dtype

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_plain_validator_function(
            lambda values: np.array(values, dtype=self.dtype),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist()),
        )


Floats: TypeAlias = Annotated[NDArray[np.float64], _AsLists(np.float64)]
Bools: TypeAlias = Annotated[NDArray[np.bool_], _AsLists(np.bool_)]
Ints: TypeAlias = Annotated[NDArray[np.int64], _AsLists(np.int64)]
Complexes: TypeAlias = NDArray[np.complex128]
Strings: TypeAlias = NDArray[np.str_]
AnyArray: TypeAlias = NDArray[Any]
Bytes: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Series:
    """The samples of one channel in order of reception: times [ns UTC], values and flags, all of shape [n].

    ``sources`` lists the distinct sources; ``source_index`` gives the one of each sample.
    """

    measured_ns: Ints
    received_ns: Ints
    value: Floats
    quality: Bytes
    sources: tuple[str, ...]
    source_index: NDArray[np.int32]

    def subset(self, rows: AnyArray) -> Series:
        """The samples at ``rows``, a mask [n] or indices."""
        return Series(
            self.measured_ns[rows],
            self.received_ns[rows],
            self.value[rows],
            self.quality[rows],
            self.sources,
            self.source_index[rows],
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Series]) -> Series:
        """The samples of one series after the other."""
        sources = tuple(dict.fromkeys(name for part in parts for name in part.sources))
        numbers = [np.array([sources.index(name) for name in part.sources], np.int32) for part in parts]
        index = [number[part.source_index] for number, part in zip(numbers, parts, strict=True)]

        def column(name: str) -> AnyArray:
            return np.concatenate([getattr(part, name) for part in parts])

        columns = column("measured_ns"), column("received_ns"), column("value"), column("quality")
        return cls(*columns, sources, np.concatenate(index))


class Linear(NamedTuple):
    """An affine conversion from one unit to another."""

    scale: float
    offset: float = 0.0

    def apply(self, value: float) -> float:
        """``scale * value + offset``."""
        return self.scale * value + self.offset

    def invert(self, value: float) -> float:
        """The inverse of :meth:`apply`."""
        return (value - self.offset) / self.scale


_SIZES: dict[str, dict[str, float]] = {
    "m": {
        "m": 1.0,
        "km": 1000.0,
        "cm": 0.01,
        "mm": 0.001,
        "ft": 0.3048,
        "dm": 0.1,
        "in": 0.0254,
        "nmi": NAUTICAL_MILE_M,
    },
    "deg": {"deg": 1.0, "rad": DEG_PER_RAD, "ddeg": 0.1, "cdeg": 0.01, "degE7": 1e-7},
    "m/s": {
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "knots": KNOT_MPS,
        "cm/s": 0.01,
        "mm/s": 0.001,
        "mph": 0.44704,
        "ft/s": 0.3048,
        "dm/s": 0.1,
        "m/min": 1.0 / 60.0,
        "km/min": 1000.0 / 60.0,
        "ft/min": 0.3048 / 60.0,
    },
    "deg/s": {
        "deg/s": 1.0,
        "deg/min": 1.0 / 60.0,
        "deg/h": 1.0 / 3600.0,
        "rad/s": DEG_PER_RAD,
        "mrad/s": DEG_PER_RAD / 1000.0,
        "rad/min": DEG_PER_RAD / 60.0,
    },
    "rpm": {"rpm": 1.0, "rps": 60.0, "Hz": 60.0, "rad/s": 30.0 / pi},
    "%": {"%": 1.0, "ratio": 100.0, "d%": 0.1, "c%": 0.01},
    "m/s2": {"m/s2": 1.0, "m/s/s": 1.0, "mG": 0.00980665},
    "degC": {"degC": 1.0, "K": 1.0, "cdegC": 0.01, "degF": 5.0 / 9.0},
    "Pa": {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5},
    "N": {"N": 1.0, "kN": 1e3},
    "Nm": {"Nm": 1.0, "kNm": 1e3},
    "kW": {"kW": 1.0, "W": 0.001, "MW": 1e3},
    "l/h": {"l/h": 1.0, "l/min": 60.0, "l/s": 3600.0, "m3/h": 1e3, "m3/s": 3.6e6, "cm^3/min": 0.06},
    "m3": {"m3": 1.0, "l": 0.001},
    "kg": {"kg": 1.0, "t": 1e3},
    "s": {"s": 1.0, "h": 3600.0, "ms": 1e-3, "us": 1e-6},
    "V": {"V": 1.0, "cV": 0.01, "mV": 0.001},
    "A": {"A": 1.0, "cA": 0.01, "mA": 0.001},
}
"""The size of each unit in the standard unit of its quantity. Units not listed have no other name."""
for _quantity in ("m/s", "deg/s"):  # fixed-point numbers of gateways: a log's 0.01 knots
    _SIZES[_quantity] |= {
        f"{_scale} {_unit}": float(_scale) * _size
        for _scale in ("0.1", "0.01", "0.001")
        for _unit, _size in tuple(_SIZES[_quantity].items())
    }

_ZEROS = {"K": -273.15, "degF": -160.0 / 9.0}
"""The zero of a unit in the standard unit, unless it is the same."""
_ALIASES = {
    "mps": "m/s",
    "dps": "deg/s",
    "kn": "knots",
    "knot": "knots",
    "kt": "knots",
    "degrees": "deg",
    "percent": "%",
    "C": "degC",
    "RPM": "rpm",
    "1/min": "rpm",
    "r/min": "rpm",
    "rev/min": "rpm",
    "\N{DEGREE SIGN}": "deg",
    "degree": "deg",
    "\N{DEGREE SIGN}/s": "deg/s",
    "\N{DEGREE SIGN}C": "degC",
    "L/h": "l/h",
}
_ENDINGS = {"%": "percent", "deg/s": "dps", DIMENSIONLESS: ""}


def canonical_unit(unit: str) -> str:
    """The name of a unit in this module."""
    return _ALIASES.get(unit, unit)


def is_unit(name: str) -> bool:
    """Whether a unit is known."""
    return any(canonical_unit(name) in sizes for sizes in _SIZES.values())


def name_ending_of_unit(unit: str) -> str:
    """The ending of the names of quantities in this unit; empty for counts, codes and ratios.

    >>> [name_ending_of_unit(unit) for unit in ("l/h", "deg/s", "kg/m3", "1")]
    ['_lph', '_dps', '_kgpm3', '']
    """
    ending = _ENDINGS.get(unit)
    if ending is None:
        ending = re.sub(r"[^a-z0-9]", "", unit.replace("/", "p").lower())
    return f"_{ending}" if ending else ""


def unit_conversion(to_unit: str, from_unit: str) -> Linear:
    """The conversion from ``from_unit`` to the unit ``to_unit``; any unit converts to itself.

    Raises :class:`ConfigurationError` if the unit is unknown or measures something else.

        >>> unit_conversion("degC", "K").apply(273.15)
        0.0
    """
    stated_unit, from_unit = from_unit, canonical_unit(from_unit)
    sizes = next((by_unit for by_unit in _SIZES.values() if to_unit in by_unit), {to_unit: 1.0})
    if from_unit not in sizes:
        raise errors.ConfigurationError(
            f"unit {stated_unit!r} does not measure a quantity in {to_unit}", fix=f"use one of {', '.join(sizes)}"
        )
    zero = _ZEROS.get(from_unit, 0.0) - _ZEROS.get(to_unit, 0.0)
    return Linear(sizes[from_unit] / sizes[to_unit], zero / sizes[to_unit])


def unit_scale(to_unit: str, from_unit: str) -> float:
    """The factor of :func:`unit_conversion`, for units with a common zero.

    >>> round(unit_scale("m/s", "knots"), 6)
    0.514444
    """
    return unit_conversion(to_unit, from_unit).scale


Angle = TypeVar("Angle", float, Floats)


def from_degrees_and_minutes(ddmm: Angle) -> Angle:
    """Degrees from ``dddmm.mmmm``.

    >>> float(from_degrees_and_minutes(-6230.0))
    -62.5
    """
    degrees = np.trunc(ddmm / 100.0)
    return degrees + (ddmm - 100.0 * degrees) / 60.0  # type: ignore[no-any-return]


def to_degrees_and_minutes(angle_deg: float) -> float:
    """``dddmm.mmmm`` of an angle in degrees: the inverse of :func:`from_degrees_and_minutes`."""
    degrees = np.trunc(angle_deg)
    return float(100.0 * degrees + 60.0 * (angle_deg - degrees))
