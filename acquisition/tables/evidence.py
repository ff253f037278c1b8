"""What the columns of a table say of each other and of their units: factors and signs by which speeds, rates and
angles fit the track, the size of values, and codes for no value.

Increments of position and heading are compared with integrals of speeds and rates between the same instants, so
that noise and delays matter little. Nothing here asks or decides;
:mod:`seatrial.acquisition.tables.channel_columns` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.acquisition.core.arrays import Bools, Floats
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.units import from_degrees_and_minutes, scale_to

_STEP_S = 5.0  # long against a receiver's noise and delay, short against a turn
_STEP_ROWS = 2.0
_LONGEST_GAP_STEPS = 3.0  # a ship turns in longer ones
_FEWEST = 8
_OUTLYING = 6.0
_MOST = 5000
_WIND_STEPS = 6  # half a minute: a ship turns meanwhile, the wind keeps


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """The factor that takes one series to another, their correlation, and how many increments they have."""

    factor: float
    correlation: float
    count: int

    @property
    def is_clear(self) -> bool:
        """Whether it says anything."""
        return self.count >= _FEWEST and abs(self.correlation) > 0.7


def grid_of(seconds: Floats) -> Floats:
    """Instants [s] between which increments are compared: 5 s apart, or two rows of a slower table."""
    times = seconds[np.isfinite(seconds)]
    if times.size < _FEWEST:
        return np.empty(0)
    usual = float(np.median(np.diff(np.unique(times)))) if np.unique(times).size > 1 else _STEP_S
    step = max(_STEP_S, _STEP_ROWS * usual, float(np.ptp(times)) / _MOST)
    return np.arange(times.min(), times.max() + 1e-9, step)


def increments(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """By how much a series grows between the instants of the grid."""
    usable = _usable(seconds, values)
    if usable.sum() < 2:
        return np.full(grid.size - 1, np.nan)
    return np.diff(np.interp(grid, seconds[usable], values[usable]))


def integrals(seconds: Floats, rates: Floats, grid: Floats) -> Floats:
    """What a rate adds up to between the instants of the grid, by trapezoids."""
    usable = _usable(seconds, rates)
    t, r = seconds[usable], rates[usable]
    if t.size < 2:
        return np.full(grid.size - 1, np.nan)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (r[1:] + r[:-1]) * np.diff(t))])
    return np.diff(np.interp(grid, t, total))


def over_gaps(seconds: Floats, grid: Floats) -> Bools:
    """Which steps of the grid lie, with an end, where nothing was measured for longer than three steps."""
    times = np.sort(seconds[np.isfinite(seconds)])
    if times.size < 2 or grid.size < 2:
        return np.ones(max(grid.size - 1, 0), np.bool_)
    after = np.clip(np.searchsorted(times, grid), 1, times.size - 1)
    lost = times[after] - times[after - 1] > _LONGEST_GAP_STEPS * (grid[1] - grid[0])
    return np.asarray(lost[1:] | lost[:-1])


def means(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """The mean of a series between the instants of the grid."""
    return integrals(seconds, values, grid) / np.diff(grid) if grid.size > 1 else np.empty(0)


def fit(measured: Floats, reference: Floats) -> ScaleFit:
    """The factor k of least squares in ``measured = k reference``, of the increments that are no outliers.

    Outliers are further than six median residuals from the line of the median ratio: jumps and angles that were
    interpolated through north.
    """
    valid = np.isfinite(measured) & np.isfinite(reference)
    x, y = reference[valid], measured[valid]
    large = np.abs(x) > np.median(np.abs(x)) if x.size else np.zeros(0, np.bool_)
    if large.any():
        residuals = np.abs(y - float(np.median(y[large] / x[large])) * x)
        inliers = residuals <= _OUTLYING * np.median(residuals) + 1e-12 * np.max(np.abs(y))
        x, y = x[inliers], y[inliers]
    power = float(np.sqrt(np.sum(x * x) * np.sum(y * y)))
    if x.size < _FEWEST or power == 0.0:
        return ScaleFit(np.nan, 0.0, x.size)
    return ScaleFit(float(np.sum(x * y) / np.sum(x * x)), float(np.sum(x * y)) / power, x.size)


def agreement(north: Floats, east: Floats, direction_deg: Floats) -> float:
    """How far displacements [n] point where angles say, weighed by length: 1 along them, 0 anyhow, -1 against."""
    length = np.hypot(north, east)
    along = north * np.cos(np.deg2rad(direction_deg)) + east * np.sin(np.deg2rad(direction_deg))
    valid = np.isfinite(along)
    total = float(length[valid].sum())
    return float(along[valid].sum()) / total if valid.sum() >= _FEWEST and total > 0.0 else 0.0


def restlessness(seconds: Floats, vector: np.ndarray, grid: Floats) -> float:
    """The mean square by which a complex series changes over six intervals of the grid, half a minute."""
    parts = [means(seconds, part, grid) for part in (np.real(vector), np.imag(vector))]
    mean_vector = parts[0] + 1j * parts[1]
    steps = mean_vector[_WIND_STEPS:] - mean_vector[:-_WIND_STEPS]
    steps = steps[np.isfinite(steps)]
    return float(np.mean(np.abs(steps) ** 2)) if steps.size >= _FEWEST else np.nan


def _usable(seconds: Floats, values: Floats) -> Bools:
    valid = np.isfinite(seconds) & np.isfinite(values)
    latest = np.maximum.accumulate(np.where(valid, seconds, -np.inf))
    forward = np.concatenate([[True], latest[1:] > latest[:-1]])
    return np.asarray(valid & forward)


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


def rate_by_fit(regression: ScaleFit, rate: Rate) -> Told | None:
    """The unit whose size a fit's factor is near to; None for one between all of them, and for no clear fit."""
    if not regression.is_clear:
        return None
    deviations = {unit: abs(np.log(abs(regression.factor) / scale_to(rate.units[0], unit))) for unit in rate.units}
    best = min(deviations, key=deviations.__getitem__)
    return (
        (best, f"{rate.verb} {regression.factor:.3g} {rate.units[0]} for 1 of it")
        if deviations[best] < np.log(NEAR)
        else None
    )


def odd_factor(column: str, unit: str, regression: ScaleFit, rate: Rate) -> str:
    """What is odd about a rate in its unit by a fit, with the unit that would fit; empty where nothing is.

    The true factor lies between that of least squares and the inverse of its converse, 1 / correlation^2 times as
    large, whichever of the two series is noisy (Frisch, Statistical Confluence Analysis, 1934).
    """
    factor = abs(regression.factor) / scale_to(rate.units[0], unit)
    if not regression.is_clear or (factor < _ODD and factor / regression.correlation**2 > 1.0 / _ODD):
        return ""
    likely = rate_by_fit(regression, rate)
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
    seen = np.unique(values[np.isin(values, NO_VALUE)]).tolist()
    low, high = (-360.0, 360.0) if channel.circular else (channel.low, channel.high)
    outside = [code for code in sorted(seen) if not low <= code * factor <= high]
    remaining = values[np.isfinite(values) & ~np.isin(values, outside)]
    runs_on = channel.circular and remaining.size and np.max(np.abs(remaining)) * abs(factor) > 360.0
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
    valid = np.isfinite(latitude) | np.isfinite(longitude)
    return bool(valid.any() and np.mean(is_place(latitude, longitude)[valid]) > 0.5)
