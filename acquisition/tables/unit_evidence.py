"""What the values of a column say of its unit: by their size, by what the track and the heading do meanwhile, and
which of them are codes for no value. Nothing here asks or decides; :mod:`acquisition.tables.channel_columns` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.channel import Channel
from acquisition.core.units import from_degrees_and_minutes, scale_to
from acquisition.tables.motion_evidence import Fit

NO_VALUE = (
    -9999.0, -999.0, -99.0, -9999.9, -999.9, 999.0, 999.9, 999.99, 9999.0, 9999.9, 99999.0, 999999.0, 511.0, 102.3,
    91.0, 181.0, 32767.0, -32768.0, 65535.0, 1e10, -1e10, 1e20, 1e30, 1e35,
)  # fmt: skip
"""Numbers that loggers and AIS (ITU-R M.1371) write for no value, where the quantity cannot have them."""
NEAR = 1.35  # a fit this near to a unit is of it: knots and m/s are a factor 1.94 apart, km/h and knots 1.85
_ODD = 1.15  # a fit further off than this is said
_WHOLE_TURN = ("heading_deg", "course_over_ground_deg", "wind_direction_deg")
_MOST_RADIANS = 7.0
_FEWEST_RPM = 30.0  # what goes higher is not in turns a second

Told = tuple[str, str]
"""A unit, and why."""


@dataclass(frozen=True, slots=True)
class Rate:
    """The units that a rate may be in, the first of them ours, and what it is compared with."""

    units: tuple[str, ...]
    source: str
    verb: str


SPEED = Rate(("m/s", "knots", "km/h", "cm/s", "mm/s"), "the positions", "positions move")
TURNING = Rate(("deg/s", "deg/min", "rad/s"), "the heading", "the heading turns")


def rate_by_fit(found: Fit, rate: Rate) -> Told | None:
    """The unit whose size a fit's factor is near to; None for one between all of them, and for no clear fit."""
    if not found.is_clear:
        return None
    off = {unit: abs(np.log(abs(found.factor) / scale_to(rate.units[0], unit))) for unit in rate.units}
    best = min(off, key=off.__getitem__)
    return (
        (best, f"{rate.verb} {found.factor:.3g} {rate.units[0]} for 1 of it") if off[best] < np.log(NEAR) else None
    )


def odd_factor(column: str, unit: str, found: Fit, rate: Rate) -> str:
    """What is odd about a rate in its unit by a fit, with the unit that would fit; empty where nothing is."""
    factor = abs(found.factor) / scale_to(rate.units[0], unit)
    if not found.is_clear or 1.0 / _ODD < factor < _ODD:
        return ""
    likely = rate_by_fit(found, rate)
    guess = f": {likely[0]}?" if likely and likely[0] != unit else ""
    return f"{column!r} in {unit} is off from {rate.source} by a factor {factor:.3f}{guess}"


def angle_by_range(values: Floats, name: str, heading_unit: str) -> Told | None:
    """Degrees or radians of a channel's values, all finite, beside a heading in a unit; None where both can be."""
    largest, span = float(np.max(np.abs(values))), float(np.ptp(values))
    rules = (
        (largest > _MOST_RADIANS, "deg", f"up to {largest:.4g}"),
        (heading_unit == "rad" and largest <= 2.0 * np.pi + 0.01, "rad", "as the other angles"),
        (heading_unit == "deg", "deg", "as the other angles"),
        (name in _WHOLE_TURN and span > np.pi, "rad", f"within {values.min():.2f} to {values.max():.2f}"),
        (largest == 0.0, "deg", "all zero"),
    )
    return next(((unit, why) for holds, unit, why in rules if holds), None)


def turns_by_range(largest: float, words: frozenset[str]) -> Told | None:
    """The unit of a shaft's turns by the largest of them and the column's name; None where it may be two."""
    if "rpm" in words or largest == 0.0:
        return "rpm", "by its name" if largest else "all zero"
    return ("rpm", f"up to {largest:.4g}") if largest > _FEWEST_RPM else None


def without_codes(values: Floats, codes: tuple[float, ...] | list[float] = NO_VALUE) -> Floats:
    """The values, NaN for codes."""
    return np.where(np.isin(values, codes), np.nan, values)


def codes_of(values: Floats, factor: float, channel: Channel) -> list[float]:
    """The codes for no value among numbers that a factor takes to a channel: known ones that it cannot hold."""
    seen = set(np.unique(values[np.isfinite(values)]).tolist()) & set(NO_VALUE)
    low, high = (-360.0, 360.0) if channel.circular else (channel.low, channel.high)
    outside = [each for each in sorted(seen) if not low <= each * factor <= high]
    rest = values[np.isfinite(values) & ~np.isin(values, outside)]
    runs_on = channel.circular and rest.size and np.max(np.abs(rest)) * abs(factor) > 360.0
    return [] if runs_on else outside


def in_degrees(values: Floats, unit: str) -> Floats:
    """Latitudes or longitudes in degrees; NaN for what is none in degrees and minutes."""
    if unit == "ddmm":
        return np.where(np.abs(values) % 100.0 < 60.0, from_degrees_and_minutes(values), np.nan)
    return values * scale_to("deg", unit)


def is_place(latitude: Floats, longitude: Floats) -> Any:
    """Which rows [n] are a place on earth; latitude and longitude 0 are none."""
    return (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & ((latitude != 0.0) | (longitude != 0.0))


def are_places(latitude: Floats, longitude: Floats) -> bool:
    """Whether most rows that have either are a place on earth."""
    there = np.isfinite(latitude) | np.isfinite(longitude)
    return bool(there.any() and np.mean(is_place(latitude, longitude)[there]) > 0.5)
