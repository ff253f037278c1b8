"""What is ordinary for a ship of some length: stated for one of 30 m, and going with the length by its unit.

At the same Froude number forces go with the third power of the length, moments with the fourth and speeds with the
root. Ordinary sizes are orders of magnitude, so that lengths count in powers of two.
"""

from __future__ import annotations

from math import log2

USUAL_LENGTH_M = 30.0
"""The length of a ship for which ordinary sizes are written down."""

_POWERS = {"N": 3.0, "N m": 4.0, "m": 1.0, "m2": 2.0, "m/s": 0.5, "1/s": -0.5}


def scale_of(length_m: float) -> float:
    """How many times as long a ship is as the usual one, in powers of two."""
    return float(2.0 ** round(log2(length_m / USUAL_LENGTH_M)))


def growth(unit: str, scale: float) -> float:
    """The factor of what is ordinary of a ``unit`` on a ship ``scale`` times as long as the usual one."""
    return float(scale ** _POWERS.get(unit, 0.0))
