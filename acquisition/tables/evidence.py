"""What the columns of a table say of each other and of their units: factors and signs by which speeds, rates and
angles fit the track, the size of values, and codes for no value.

Increments of position and heading are compared with integrals of speeds and rates between the same instants, so
that noise and delays matter little. Nothing here asks or decides;
:mod:`seatrial.acquisition.tables.channel_columns` does.

What is known of a table while its columns are taken for channels, and how a column is taken, turned or asked
about. Without it each reader of columns would have to be told by the ones before it.

A proposal while it is made, and when it is done: what each column was taken for and why, what is still asked.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import (
    Bools,
    Complexes,
    Floats,
    conversion_to,
    from_degrees_and_minutes,
    scale_to,
)
from seatrial.acquisition.core.ship import BY_NAME, Channel, unwrap, wrap_360
from seatrial.acquisition.tables.column_names import (
    BY_CHANNEL,
    ORDER,
    Match,
    Quantity,
    headed,
    matches,
    units_called,
    words_of,
)
from seatrial.acquisition.tables.table_files import RawTable
from seatrial.acquisition.tables.time_columns import known_day, known_zone

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


POSITION = ("north_m", "east_m")
GROUND = ("course_over_ground_deg", "speed_over_ground_mps")
UNKNOWN = ScaleFit(np.nan, 0.0, 0)


@dataclass(slots=True)
class Known:
    """What is known of a table so far: the seconds of its rows [n], the instants between which increments are
    compared, the channels of the map, their values [n] in our units, the units that speeds have for sure, where on
    earth the track begins [deg], and whether the heading's sense and the axes of the positions are sure."""

    draft: Draft
    t: Floats
    grid: Floats
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    series: dict[str, Floats] = field(default_factory=dict)
    speed_units: set[str] = field(default_factory=set)
    origin: tuple[float, float] | None = None
    heading_is_sure: bool = False
    positions_are_sure: bool = False

    @property
    def heading_is_asked(self) -> bool:
        """Whether the heading's sense is a question, so that no sign can be judged by it."""
        return any(question.key == "heading" and question.default is None for question in self.draft.questions)


def best(draft: Draft, name: str) -> ColumnCandidate | None:
    """The likeliest column for a quantity; the others are said to be left."""
    candidates = draft.of(name)
    for candidate in candidates[1:]:
        draft.note(candidate.column, "-", "", f"not used: {candidates[0].column!r} is taken for it")
    return candidates[0] if candidates else None


def take(context: Known, name: str, candidate: ColumnCandidate, unit: str, *why: str, **more: Any) -> None:
    """Let a column be a channel."""
    channel, column, draft = BY_NAME[name], candidate.column, context.draft
    entry: dict[str, Any] = {"column": column, "unit": unit}
    factor = more["full_scale"] / 100.0 if more else scale_to(channel.unit, unit)
    values = draft.numbers(column)
    if missing := codes_of(values, factor, channel):
        entry["missing"] = missing
        why = (*why, f"{', '.join(f'{code:g}' for code in missing)} stands for no value")
        values = without_codes(values, missing)
    context.channels[name] = entry | more
    context.series[name] = values * factor
    draft.note(column, name, unit, *why)
    if np.isnan(values).all():
        draft.warnings.append(f"column {column!r}, taken for {name}, holds no value at all")


def take_best(context: Known, name: str, unit_of: Callable[[Known, ColumnCandidate, str], Told | None]) -> None:
    """Let the likeliest column for a channel be it, in the unit that is found."""
    candidate = best(context.draft, name)
    if candidate is not None and (unit_guess := unit_of(context, candidate, name)):
        take(context, name, candidate, *unit_guess)


def turn_round(context: Known, name: str, why: str) -> None:
    """Change the sign of a channel that was taken."""
    column = count_otherwise(context, name, -1.0, 0.0, f"sign turned: {why}")
    context.draft.warnings.append(f"the sign of {column!r} is turned round: {why}")


def count_otherwise(context: Known, name: str, scale: float, offset: float, why: str) -> str:
    """Let a channel that was taken be ``scale`` times what it was, plus ``offset``; the column's name."""
    entry, readings = context.channels[name], context.draft.readings
    entry["scale"] = scale * entry.get("scale", 1.0)
    if shifted := scale * entry.get("offset", 0.0) + offset:
        entry["offset"] = shifted
    values = scale * context.series[name] + offset
    context.series[name] = wrap_360(values) if name == "heading_deg" else values
    place = next(i for i, reading in enumerate(readings) if reading.taken_for == name)
    readings[place] = replace(readings[place], reasons=(*readings[place].reasons, why))
    return readings[place].column


def asked(draft: Draft, key: str, text: str, options: tuple[str, ...]) -> Told | None:
    """The unit that a person says, the first one until then; None for a column that is to be left out."""
    answer = draft.ask(key, text, options)
    return None if answer == SKIP else (answer or options[0], "as answered")


def changes_of(context: Known, *names: str) -> list[Floats]:
    """How much channels change from one moment of the grid to the next; empty where that cannot be told."""
    if context.grid.size < 3 or not set(names) <= set(context.series):
        return []
    turning = {"heading_deg": unwrap(context.series["heading_deg"])} if "heading_deg" in names else {}
    return [increments(context.t, (context.series | turning)[name], context.grid) for name in names]


def moves_of(context: Known) -> Complexes | None:
    """The ship's moves between the moments of the grid, north + i east, by position or by course and speed."""
    if measured := changes_of(context, *POSITION):
        gap = over_gaps(context.t[np.isfinite(context.series["north_m"])], context.grid)
        return np.where(gap, np.nan, measured[0] + 1j * measured[1])
    if context.grid.size < 3 or not set(GROUND) <= set(context.series):
        return None
    course, speed = (context.series[name] for name in GROUND)
    return travelled(context, np.asarray(speed * np.exp(1j * np.deg2rad(course))))


def travelled(context: Known, velocity: Complexes) -> Complexes:
    """What a velocity [n] adds up to from one moment of the grid to the next."""
    north, east = (integrals(context.t, part, context.grid) for part in (np.real(velocity), np.imag(velocity)))
    return np.asarray(north + 1j * east)


def mean_angle(context: Known, angle_deg: Floats) -> Floats:
    """The mean of an angle [n, deg], not wrapped, between the moments of the grid."""
    return means(context.t, unwrap(angle_deg), context.grid)


def rate_unit(context: Known, candidate: ColumnCandidate, regression: ScaleFit, kind: Rate) -> Told | None:
    """A rate's unit as the head says, else as the fit does; an oddness between the two is said."""
    if not candidate.headed:
        return rate_by_fit(regression, kind)
    if remark := odd_factor(candidate.column, candidate.units[0], regression, kind):
        context.draft.warnings.append(remark)
    return candidate.headed


SKIP = "skip"
"""The answer that leaves a column out."""


@dataclass(frozen=True, slots=True)
class ColumnReading:
    """What a column was taken for: a channel or a word for it, in which unit, and why."""

    column: str
    taken_for: str
    unit: str = ""
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Question:
    """What the table does not tell: the key of the answer, the text, what may be answered, and what is taken if
    nobody does; without a ``default`` it has to be answered."""

    key: str
    text: str
    options: tuple[str, ...] = ()
    default: str | None = None

    def __str__(self) -> str:
        return f"{self.text} (--answer {self.key}={'|'.join(self.options) or 'VALUE'})"


@dataclass(frozen=True, slots=True)
class ColumnCandidate:
    """A column that may hold a quantity, how much of its name says so, the units that it is headed with, if any."""

    column: str
    quantity: Quantity
    cover: float
    units: tuple[str, ...]
    words: frozenset[str]

    @property
    def headed(self) -> tuple[str, str] | None:
        """The unit in its head, and that it is from there."""
        return (self.units[0], "head says so") if self.units else None


@dataclass(slots=True)
class Draft:
    """The table and what has been found out of it so far; ``tree`` is the map as TOML would have it."""

    raw: RawTable
    answers: Mapping[str, str]
    tree: dict[str, Any] = field(default_factory=dict)
    readings: list[ColumnReading] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    candidates: list[ColumnCandidate] = field(default_factory=list)
    used: set[str] = field(default_factory=set)

    def ask(self, key: str, text: str, options: Sequence[str] = (), default: str | None = None) -> str | None:
        """The answer to a question, which is noted as long as there is none; the default, if any, meanwhile."""
        answer = self.answers.get(key)
        if answer is not None:
            check_answer(key, answer, options)
            self.used.add(key)
            return answer
        self.questions.append(Question(key, text, (*options,), default))
        return default

    def numbers(self, column: str) -> Floats:
        """A column's numbers, NaN for what is none."""
        return np.asarray(pd.to_numeric(self.raw.columns[column], errors="coerce").to_numpy(dtype=float))

    def of(self, *names: str) -> list[ColumnCandidate]:
        """The candidates for quantities, the plainest and fullest first; columns without a value come last."""
        candidates = [candidate for candidate in self.candidates if candidate.quantity.name in names]
        return sorted(
            candidates,
            key=lambda candidate: (
                self.is_empty(candidate.column),
                -candidate.cover,
                -self.count(candidate.column),
            ),
        )

    def count(self, column: str) -> int:
        """How many cells are filled."""
        return int(self.raw.columns[column].notna().sum())

    def is_empty(self, column: str) -> bool:
        """Whether a column has no value at all."""
        return self.count(column) == 0

    def note(self, column: str, taken_for: str, unit: str = "", *reasons: str) -> None:
        """Write down what a column was taken for."""
        self.readings.append(ColumnReading(column, taken_for, unit, tuple(reason for reason in reasons if reason)))


_CHECKS: dict[str, Callable[[str], object]] = {
    "zone": known_zone, "start": pd.Timestamp, "day": known_day, "full_scale": float, "year": int
}  # fmt: skip
"""What tells whether an answer that is no choice can be one: it raises :class:`ValueError`."""
KEYS = frozenset({*_CHECKS, "date_order", "o_is", "time_unit", "x_axis", "course", "heading", "rate_of_turn",
                  "wind", "unit.speed", "unit.wind"})  # fmt: skip
"""What may be answered, beside ``unit.COLUMN`` and ``full_scale.ACTUATOR``."""


def check_answer(key: str, answer: str, options: Sequence[str] = ()) -> None:
    """Raise :class:`ConfigurationError` for an answer that is none."""
    if options and answer not in (*options, SKIP):
        raise ConfigurationError(f"answer {key}={answer} is none of {', '.join(options)}")
    check = _CHECKS.get(key.partition(".")[0])
    if check is None or answer == SKIP:
        return
    try:
        check(answer)
    except ValueError as error:
        raise ConfigurationError(f"answer {key}={answer} cannot be used", why=str(error)) from error


def check_keys(answers: Mapping[str, str], columns: Sequence[str]) -> None:
    """Raise :class:`ConfigurationError` for an answer to what is never asked."""
    for key in answers:
        kind, _, name = key.partition(".")
        if key not in KEYS and kind != "full_scale" and not (kind == "unit" and name in columns):
            raise ConfigurationError(
                f"there is no question {key!r}", fix=f"answer one of {', '.join(sorted(KEYS))}, or unit.COLUMN"
            )


def candidates_of(raw: RawTable) -> list[ColumnCandidate]:
    """Each column with the first quantity that its name, or what the file says of it, means and its unit fits."""
    candidates = []
    for column in map(str, raw.columns.columns):
        head = headed(column)
        stated_units = units_called(raw.units.get(column, ""))
        if (exact := BY_CHANNEL.get(column)) is not None:
            candidates.append(
                ColumnCandidate(column, exact, 1.0, stated_units or head.units, frozenset(words_of(column)))
            )
            continue
        names = [(raw.meanings.get(column, ""), stated_units), (head.name, stated_units or head.units)]
        if column.endswith(head.text):  # what looked like a unit may be none
            names.append((column, stated_units))
        for name, units in names:
            fitting = [
                (match, usable)
                for match in matches(name)
                if (usable := tuple(unit for unit in units if measures(match.quantity, unit))) or not units
            ]
            if fitting:
                match, usable = _plain_n(fitting, raw) if name == "n" else fitting[0]
                if match.quantity.name in BY_CHANNEL and ORDER & set(words_of(name)):
                    break  # what is wanted of the motion is not the motion
                candidates.append(
                    ColumnCandidate(column, match.quantity, match.cover, usable, frozenset(words_of(name)))
                )
                break
    return candidates


def with_answers(draft: Draft) -> list[ColumnCandidate]:
    """The candidates, their units as answered; those to skip are left out. Raises :class:`ConfigurationError`."""
    candidates = []
    for candidate in candidates_of(draft.raw):
        answer = draft.answers.get(f"unit.{candidate.column}")
        draft.used.add(f"unit.{candidate.column}")
        if answer == SKIP:
            draft.note(candidate.column, "-", "", "left out, as answered")
            continue
        units = units_called(answer) or (answer,) if answer else candidate.units
        if answer and not measures(candidate.quantity, units[0]):
            raise ConfigurationError(f"unit {answer!r} does not fit what {candidate.column!r} is taken for")
        candidates.append(replace(candidate, units=units))
    return candidates


def _plain_n(fitting: list[tuple[Match, tuple[str, ...]]], raw: RawTable) -> tuple[Match, tuple[str, ...]]:
    """A small n is to the north beside an e, else turns of the shaft."""
    names = {str(column).lower() for column in raw.columns.columns}
    wanted = "north_m" if names & {"e", "east"} else "shaft"
    return next((pair for pair in fitting if pair[0].quantity.name == wanted), fitting[0])


def measures(quantity: Quantity, unit: str) -> bool:
    """Whether a column of a quantity may be in a unit."""
    if unit == "ddmm":
        return quantity.name in ("latitude", "longitude")
    if quantity.name in ("time", "date"):
        return unit in ("s", "ms", "us", "ns", "min", "h", "d")
    if quantity.name in ("shaft", "engine_rpm", "rudder", "value") and unit == "percent":
        return True
    try:
        conversion_to(quantity.unit or "1", unit)
    except ConfigurationError:
        return False
    return True


def as_toml(tree: Mapping[str, Any], comments: Mapping[str, str]) -> str:
    """A map's tables as TOML; ``comments`` by channel stand behind its line."""
    lines = [f"{key} = {_value(value)}" for key, value in tree.items() if not _is_table(value)]
    for key, value in tree.items():
        for table in value if isinstance(value, list) and _is_table(value) else [value]:
            if isinstance(table, dict):
                lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
                lines += [
                    f"{name} = {_value(entry)}{_comment(comments.get(name))}" for name, entry in table.items()
                ]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list | tuple) and bool(value) and isinstance(value[0], dict)
    )


def _comment(text: str | None) -> str:
    return f"  # {' '.join(text.split())}" if text else ""


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
