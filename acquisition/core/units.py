"""Units: their names in files, and their conversion to the units of channels.

Inside the code everything is SI with angles in radians; channels are in the units that their names end in (``_m
_deg _mps _dps _rpm _percent``). A conversion is one affine step, ``house = scale * value + offset``.
"""

from __future__ import annotations

import re
from math import pi
from typing import NamedTuple, TypeVar

import numpy as np

from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.errors import ConfigurationError

KNOT_MPS = 1852.0 / 3600.0
DEG_PER_RAD = 180.0 / pi
DIMENSIONLESS = "1"
"""The unit of counts, codes and ratios, whose names have no ending."""
DEGREES_AND_MINUTES = "ddmm"
"""The unit of angles given as degrees and minutes in one number."""
Number = TypeVar("Number", float, Floats)


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
    "m": {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "dm": 0.1, "in": 0.0254, "nmi": 1852.0},
    "deg": {"deg": 1.0, "rad": DEG_PER_RAD, "ddeg": 0.1, "cdeg": 0.01, "degE7": 1e-7},
    "m/s": {"m/s": 1.0, "km/h": 1.0 / 3.6, "knots": KNOT_MPS, "cm/s": 0.01, "mm/s": 0.001},
    "deg/s": {"deg/s": 1.0, "deg/min": 1.0 / 60.0, "rad/s": DEG_PER_RAD, "mrad/s": DEG_PER_RAD / 1000.0},
    "rpm": {"rpm": 1.0, "rps": 60.0, "Hz": 60.0},
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


def canonical(unit: str) -> str:
    """The name of a unit in this module."""
    return _ALIASES.get(unit, unit)


def is_unit(name: str) -> bool:
    """Whether a unit is known."""
    return any(canonical(name) in sizes for sizes in _SIZES.values())


def ending_of(unit: str) -> str:
    """The ending of the names of quantities in this unit; empty for counts, codes and ratios.

    >>> ending_of("l/h"), ending_of("deg/s"), ending_of("kg/m3"), ending_of("1")
    ('_lph', '_dps', '_kgpm3', '')
    """
    plain = _ENDINGS.get(unit)
    if plain is None:
        plain = re.sub(r"[^a-z0-9]", "", unit.replace("/", "p").lower())
    return f"_{plain}" if plain else ""


def to_house(house: str, unit: str) -> Linear:
    """The conversion from ``unit`` to the unit ``house``; any unit converts to itself.

    Raises :class:`ConfigurationError` if the unit is unknown or measures something else.

        >>> to_house("degC", "K").apply(273.15)
        0.0
    """
    stated_unit, unit = unit, canonical(unit)
    sizes = next((by_unit for by_unit in _SIZES.values() if house in by_unit), {house: 1.0})
    if unit not in sizes:
        raise ConfigurationError(
            f"unit {stated_unit!r} does not measure a quantity in {house}", fix=f"use one of {', '.join(sizes)}"
        )
    zero = _ZEROS.get(unit, 0.0) - _ZEROS.get(house, 0.0)
    return Linear(sizes[unit] / sizes[house], zero / sizes[house])


def scale_to(house: str, unit: str) -> float:
    """The factor of :func:`to_house`, for units with a common zero.

    >>> round(scale_to("m/s", "knots"), 6)
    0.514444
    """
    return to_house(house, unit).scale


def from_degrees_and_minutes(ddmm: Number) -> Number:
    """Degrees from ``dddmm.mmmm``.

    >>> float(from_degrees_and_minutes(-6230.0))
    -62.5
    """
    degrees = np.trunc(ddmm / 100.0)
    return degrees + (ddmm - 100.0 * degrees) / 60.0  # type: ignore[no-any-return]


def as_degrees_and_minutes(angle_deg: float) -> float:
    """``dddmm.mmmm`` of an angle in degrees: the inverse of :func:`from_degrees_and_minutes`."""
    degrees = np.trunc(angle_deg)
    return float(100.0 * degrees + 60.0 * (angle_deg - degrees))
