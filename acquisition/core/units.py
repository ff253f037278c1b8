"""Units at the edges: what a file may call them, and how they become the house's units.

Inside the code everything is SI with angles in radians; the channels themselves are in the units that their
names carry (``_m _deg _mps _dps _rpm _percent``). A conversion is one affine step,
``house = scale * value + offset``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from acquisition.core.errors import ConfigurationError

KNOT_MPS = 1852.0 / 3600.0
DEG_PER_RAD = 180.0 / pi


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit's name and its size in the house's unit of the same quantity."""

    name: str
    house: str
    scale: float


_UNITS: dict[str, Unit] = {
    unit.name: unit
    for unit in (
        Unit("m", "m", 1.0),
        Unit("km", "m", 1000.0),
        Unit("cm", "m", 0.01),
        Unit("ft", "m", 0.3048),
        Unit("nmi", "m", 1852.0),
        Unit("deg", "deg", 1.0),
        Unit("rad", "deg", DEG_PER_RAD),
        Unit("m/s", "m/s", 1.0),
        Unit("km/h", "m/s", 1.0 / 3.6),
        Unit("knots", "m/s", KNOT_MPS),
        Unit("cm/s", "m/s", 0.01),
        Unit("mm/s", "m/s", 0.001),
        Unit("deg/s", "deg/s", 1.0),
        Unit("deg/min", "deg/s", 1.0 / 60.0),
        Unit("rad/s", "deg/s", DEG_PER_RAD),
        Unit("rpm", "rpm", 1.0),
        Unit("rps", "rpm", 60.0),
        Unit("%", "%", 1.0),
    )
}
_ALIASES = {
    "mps": "m/s",
    "dps": "deg/s",
    "kn": "knots",
    "knot": "knots",
    "kt": "knots",
    "degrees": "deg",
    "percent": "%",
}


def scale_to(house: str, unit: str) -> float:
    """The factor that takes a value in ``unit`` to the house unit ``house``.

    Raises :class:`ConfigurationError` when the unit is unknown or measures something else.

    >>> round(scale_to("m/s", "knots"), 6)
    0.514444
    """
    found = _UNITS.get(_ALIASES.get(unit, unit))
    possible = [each.name for each in _UNITS.values() if each.house == house]
    if found is None or found.house != house:
        raise ConfigurationError(
            f"unit {unit!r} does not measure a quantity in {house}", fix=f"use one of {', '.join(possible)}"
        )
    return found.scale
