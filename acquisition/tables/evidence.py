"""The evidence by which columns become channels: units, signs and codes by their numbers, and what is known so far.

Increments of position and heading are compared with integrals of speeds and rates between the same instants, so
that noise and delays matter little. :class:`MappingDraft` is the map while it is made, :class:`TableContext` the
channels assigned so far; :mod:`seatrial.acquisition.tables.channel_columns` decides what becomes which.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.files import toml_value
from seatrial.acquisition.core.quantities import Bools, Complexes, Floats, integrate, unit_conversion, unit_scale
from seatrial.acquisition.tables import column_map, column_names, table_files, time_columns

_STEP_S = 5.0  # long against a receiver's noise and delay, short against a turn
_STEP_ROWS = 2.0
_LONGEST_GAP_STEPS = 3.0  # a ship turns in longer ones
MIN_INCREMENTS = 8
_OUTLIER_FACTOR = 6.0
_MAX_STEPS = 5000


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """The factor from one series to another, their correlation, and the number of increments."""

    factor: float
    correlation: float
    count: int

    @property
    def is_clear(self) -> bool:
        """Whether there are enough correlated increments to rely on the factor."""
        return self.count >= MIN_INCREMENTS and abs(self.correlation) > 0.7


def comparison_grid(seconds: Floats) -> Floats:
    """Instants [s] between which increments are compared: 5 s apart, or two rows of a slower table."""
    times = seconds[np.isfinite(seconds)]
    if times.size < MIN_INCREMENTS:
        return np.empty(0)
    row_step = float(np.median(np.diff(np.unique(times)))) if np.unique(times).size > 1 else _STEP_S
    step = max(_STEP_S, _STEP_ROWS * row_step, float(np.ptp(times)) / _MAX_STEPS)
    return np.arange(times.min(), times.max() + 1e-9, step)


def increments_on_grid(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """The change of a series between the instants of the grid."""
    usable = _forward_in_time_mask(seconds, values)
    if usable.sum() < 2:
        return np.full(grid.size - 1, np.nan)
    return np.diff(np.interp(grid, seconds[usable], values[usable]))


def integrals_on_grid(seconds: Floats, rates: Floats, grid: Floats) -> Floats:
    """The integral of a rate between the instants of the grid, by trapezoids."""
    usable = _forward_in_time_mask(seconds, rates)
    if usable.sum() < 2:
        return np.full(grid.size - 1, np.nan)
    return np.diff(np.interp(grid, seconds[usable], integrate(rates[usable], seconds[usable])))


def gap_mask_of_grid(seconds: Floats, grid: Floats) -> Bools:
    """Which steps of the grid begin or end in a gap of the measurements longer than three steps."""
    times = np.sort(seconds[np.isfinite(seconds)])
    if times.size < 2 or grid.size < 2:
        return np.ones(max(grid.size - 1, 0), np.bool_)
    next_index = np.clip(np.searchsorted(times, grid), 1, times.size - 1)
    in_gap = times[next_index] - times[next_index - 1] > _LONGEST_GAP_STEPS * (grid[1] - grid[0])
    return np.asarray(in_gap[1:] | in_gap[:-1])


def interval_means_on_grid(seconds: Floats, values: Floats, grid: Floats) -> Floats:
    """The mean of a series between the instants of the grid."""
    return integrals_on_grid(seconds, values, grid) / np.diff(grid) if grid.size > 1 else np.empty(0)


def fit_scale(measured: Floats, reference: Floats) -> ScaleFit:
    """The least-squares factor k in ``measured = k reference``, without outliers.

    Outliers are further than six median residuals from the line of the median ratio: jumps and angles that were
    interpolated through north.
    """
    valid = np.isfinite(measured) & np.isfinite(reference)
    x, y = reference[valid], measured[valid]
    large = np.abs(x) > np.median(np.abs(x)) if x.size else np.zeros(0, np.bool_)
    if large.any():
        residuals = np.abs(y - float(np.median(y[large] / x[large])) * x)
        inliers = residuals <= _OUTLIER_FACTOR * np.median(residuals) + 1e-12 * np.max(np.abs(y))
        x, y = x[inliers], y[inliers]
    power = float(np.sqrt(np.sum(x * x) * np.sum(y * y)))
    if x.size < MIN_INCREMENTS or power == 0.0:
        return ScaleFit(np.nan, 0.0, x.size)
    return ScaleFit(float(np.sum(x * y) / np.sum(x * x)), float(np.sum(x * y)) / power, x.size)


def direction_agreement(north: Floats, east: Floats, direction_deg: Floats) -> float:
    """How well displacements [n] point along angles, weighted by length: 1 along, 0 anyhow, -1 against."""
    length = np.hypot(north, east)
    projections = north * np.cos(np.deg2rad(direction_deg)) + east * np.sin(np.deg2rad(direction_deg))
    valid = np.isfinite(projections)
    total = float(length[valid].sum())
    return float(projections[valid].sum()) / total if valid.sum() >= MIN_INCREMENTS and total > 0.0 else 0.0


def _forward_in_time_mask(seconds: Floats, values: Floats) -> Bools:
    valid = np.isfinite(seconds) & np.isfinite(values)
    latest = np.maximum.accumulate(np.where(valid, seconds, -np.inf))
    forward = np.concatenate([[True], latest[1:] > latest[:-1]])
    return np.asarray(valid & forward)


_NINES = (
    -99.0,
    *(float(f"{sign}{'9' * digits}.{decimals or 0}")
      for sign in ("", "-") for digits in range(3, 8) for decimals in ("", "9", "99", "999")),
)  # fmt: skip
MISSING_CODES = (
    *_NINES, 511.0, 102.3, 91.0, 181.0, 32767.0, -32767.0, -32768.0, 65535.0, 1e10, -1e10, 1e20, 1e30, 1e35,
)  # fmt: skip
"""Numbers that loggers and AIS (ITU-R M.1371) write for no value, where the quantity cannot have them."""
_BELOW_ZERO = (-1.0, *(code for code in MISSING_CODES if code < 0.0))
"""Codes among numbers that are never below zero otherwise."""
_FAR_RANGES = 2.0  # times the range of all other values
# A fit within this factor of a unit is in it: knots and m/s are a factor 1.94 apart, km/h and knots 1.85.
_UNIT_TOLERANCE = 1.35
_FACTOR_TOLERANCE = 1.15  # a fit further off than this is said
_RARE_TOLERANCES = {"mph": 1.03}  # 1.15 of a knot

UnitGuess = tuple[str, str]
"""A unit, and why."""


@dataclass(frozen=True, slots=True)
class RateUnits:
    """The units that a rate may have, ours first, and what it is compared with."""

    units: tuple[str, ...]
    source: str
    verb: str


SPEED = RateUnits(("m/s", "knots", "km/h", "mph", "cm/s", "mm/s"), "the positions", "positions move")
TURNING = RateUnits(("deg/s", "deg/min", "rad/s"), "the heading", "the heading turns")


def rate_unit_by_fit(regression: ScaleFit, rate: RateUnits) -> UnitGuess | None:
    """The unit nearest to a fit's factor; None if none is near, or the fit is not clear."""
    if not regression.is_clear:
        return None
    deviations = {
        unit: abs(np.log(abs(regression.factor) / unit_scale(rate.units[0], unit))) for unit in rate.units
    }
    near = [
        unit
        for unit, deviation in deviations.items()
        if deviation < np.log(_RARE_TOLERANCES.get(unit, _UNIT_TOLERANCE))
    ]
    if not near:
        return None
    nearest = min(near, key=deviations.__getitem__)
    return nearest, f"{rate.verb} {regression.factor:.3g} {rate.units[0]} for 1 of it"


def replace_codes_by_nan(values: Floats, codes: tuple[float, ...] | list[float] = MISSING_CODES) -> Floats:
    """The values, NaN for codes that stand for no value."""
    return np.where(np.isin(values, codes), np.nan, values)


def valid_position_mask(latitude: Floats, longitude: Floats) -> Any:
    """Which rows [n] are a position on earth; a code for no fix in both is none."""
    is_fix = ~column_map.no_fix_mask(latitude, longitude)
    return (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & is_fix


POSITION_CHANNELS = ("north_m", "east_m")
NO_FIT = ScaleFit(np.nan, 0.0, 0)


@dataclass(slots=True)
class TableContext:
    """What is known of a table so far: the time of its rows [n, s], the instants between which increments are
    compared, the map's channels, their values [n] in our units, the units that are certain for speeds, where the
    track begins [deg], and whether the heading's sense and the axes of the positions are certain."""

    draft: MappingDraft
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
        """Whether the heading's sense is an open question, so that no sign can be judged by it."""
        return any(question.key == "heading" and question.default is None for question in self.draft.questions)


def best_candidate(draft: MappingDraft, name: str) -> ColumnCandidate | None:
    """The likeliest column for a quantity; the others are noted as not used."""
    candidates = draft.candidates_for(name)
    for candidate in candidates[1:]:
        draft.note_interpretation(candidate.column, "-", "", f"not used: {candidates[0].column!r} is taken for it")
    return candidates[0] if candidates else None


def codes_far_from_values(values: Floats) -> list[float]:
    """The codes of nines in a column that stand so far from all its other values that they can be none of them."""
    plain = values[np.isfinite(values) & ~np.isin(values, MISSING_CODES)]
    if 2 * plain.size < values.size:
        return []
    distance = max(_FAR_RANGES * float(np.ptp(plain)), float(np.max(np.abs(plain))))
    codes = np.unique(values[np.isin(values, _NINES)])
    return [float(code) for code in codes if np.min(np.abs(plain - code)) > distance]


def _codes_below_zero(values: Floats, channel: ship.Channel) -> list[float]:
    """The code that is the only number below zero in a column of headings, or of what never comes near zero."""
    codes, plain = np.unique(values[values < 0.0]).tolist(), values[values >= 0.0]
    is_far = plain.size > 0 and (channel.circular or float(np.min(plain)) >= 1.0)
    return codes if len(codes) == 1 and codes[0] in _BELOW_ZERO and is_far else []


def assign_column(
    context: TableContext, name: str, candidate: ColumnCandidate, unit: str, *why: str, **entries: Any
) -> None:
    """Assign a column to a channel, in a unit; ``entries`` are further ones of the map.

    Of the usual codes for no value those are taken for it that the channel cannot hold.
    """
    channel, column, draft = ship.BY_NAME[name], candidate.column, context.draft
    entry: dict[str, Any] = {"column": column, "unit": unit}
    factor = entries["full_scale"] / 100.0 if entries else unit_scale(channel.unit, unit)
    values = draft.numbers_or_nan(column)
    low, high = (-360.0, 360.0) if channel.circular else (channel.low, channel.high)
    codes = np.unique(values[np.isin(values, MISSING_CODES)]).tolist()
    missing = [code for code in sorted(codes) if not low <= code * factor <= high]
    far = _codes_below_zero(values, channel) + ([] if channel.circular else codes_far_from_values(values))
    if far := sorted({*far} - {*missing}):
        count, text = np.count_nonzero(np.isin(values, far)), ", ".join(f"{code:g}" for code in far)
        if column not in ship.CIRCULAR:  # under a standard name it is flagged as no angle
            draft.warnings.append(
                f"{column!r} is {text} in {count:,} rows, far from all its other values: it is taken for no value"
                " there"
            )
        missing = sorted({*missing, *far})
    valid = values[np.isfinite(values) & ~np.isin(values, missing)]
    is_unwrapped = channel.circular and valid.size and np.max(np.abs(valid)) * abs(factor) > 360.0
    if missing and not is_unwrapped:
        entry["missing"] = missing
        why = (*why, f"{', '.join(f'{code:g}' for code in missing)} stands for no value")
        values = replace_codes_by_nan(values, missing)
    context.channels[name] = entry | entries
    context.series[name] = values * factor
    draft.note_interpretation(column, name, unit, *why)
    if np.isnan(values).all():
        draft.warnings.append(f"column {column!r}, taken for {name}, holds no value at all")


def assign_best_column(
    context: TableContext, name: str, unit_of: Callable[[TableContext, ColumnCandidate, str], UnitGuess | None]
) -> None:
    """Assign the likeliest column to a channel, unless ``unit_of`` determines no unit."""
    candidate = best_candidate(context.draft, name)
    if candidate is not None and (unit_guess := unit_of(context, candidate, name)):
        assign_column(context, name, candidate, *unit_guess)


POSITIVE_TO_PORT = "its head says that it is positive to port"


def invert_sign_of_assigned_channel(context: TableContext, name: str, why: str) -> None:
    """Change the sign of an assigned channel."""
    column = rescale_assigned_channel(context, name, -1.0, 0.0, f"sign turned: {why}")
    context.draft.warnings.append(f"the sign of {column!r} is turned round: {why}")


def rescale_assigned_channel(context: TableContext, name: str, scale: float, offset: float, why: str) -> str:
    """Multiply an assigned channel by ``scale`` and add ``offset``; returns the column's name."""
    entry, readings = context.channels[name], context.draft.readings
    entry["scale"] = scale * entry.get("scale", 1.0)
    if shifted := scale * entry.get("offset", 0.0) + offset:
        entry["offset"] = shifted
    values = scale * context.series[name] + offset
    context.series[name] = ship.wrap_360(values) if name == "heading_deg" else values
    index = next(i for i, reading in enumerate(readings) if reading.taken_for == name)
    readings[index] = replace(readings[index], reasons=(*readings[index].reasons, why))
    return readings[index].column


def ask_unit(draft: MappingDraft, key: str, text: str, options: tuple[str, ...]) -> UnitGuess | None:
    """The unit that the user answers, until then the first; None for a column that is to be left out."""
    answer = draft.ask(key, text, options)
    return None if answer == SKIP else (answer or options[0], "as answered")


def channel_increments(context: TableContext, *names: str) -> list[Floats]:
    """The changes of channels between the instants of the grid; empty if one of them is missing."""
    if context.grid.size < 3 or not set(names) <= set(context.series):
        return []
    unwrapped = {"heading_deg": ship.unwrap(context.series["heading_deg"])} if "heading_deg" in names else {}
    return [increments_on_grid(context.t, (context.series | unwrapped)[name], context.grid) for name in names]


def displacements(context: TableContext) -> Complexes | None:
    """The ship's displacements in the steps of the grid, north + i east, by position or course and speed."""
    if measured := channel_increments(context, *POSITION_CHANNELS):
        gap = gap_mask_of_grid(context.t[np.isfinite(context.series["north_m"])], context.grid)
        return np.where(gap, np.nan, measured[0] + 1j * measured[1])
    if context.grid.size < 3 or not set(column_map.GROUND_CHANNELS) <= set(context.series):
        return None
    course, speed = (context.series[name] for name in column_map.GROUND_CHANNELS)
    return integrate_velocity(context, np.asarray(speed * np.exp(1j * np.deg2rad(course))))


def integrate_velocity(context: TableContext, velocity: Complexes) -> Complexes:
    """The displacements of a velocity [n], north + i east, between the instants of the grid."""
    north, east = (
        integrals_on_grid(context.t, part, context.grid) for part in (np.real(velocity), np.imag(velocity))
    )
    return np.asarray(north + 1j * east)


def mean_angle(context: TableContext, angle_deg: Floats) -> Floats:
    """The mean of an unwrapped angle [n, deg] between the instants of the grid."""
    return interval_means_on_grid(context.t, ship.unwrap(angle_deg), context.grid)


def rate_unit(
    context: TableContext, candidate: ColumnCandidate, regression: ScaleFit, rate: RateUnits
) -> UnitGuess | None:
    """A rate's unit by the header, else by the fit; a fit that is far from the unit is reported.

    The true factor lies between that of least squares and the inverse of its converse, 1 / correlation^2 times as
    large, whichever of the two series is noisy (Frisch, Statistical Confluence Analysis, 1934).
    """
    by_fit = rate_unit_by_fit(regression, rate)
    unit_guess = candidate.header_unit or by_fit
    if unit_guess is None:
        return None
    unit = unit_guess[0]
    factor = abs(regression.factor) / unit_scale(rate.units[0], unit)
    if regression.is_clear and not (
        factor < _FACTOR_TOLERANCE and factor / regression.correlation**2 > 1.0 / _FACTOR_TOLERANCE
    ):
        guess = f": {by_fit[0]}?" if by_fit and by_fit[0] != unit else ""
        context.draft.warnings.append(
            f"{candidate.column!r} in {unit} is off from {rate.source} by a factor {factor:.3f}{guess}"
        )
    return unit_guess


SKIP = "skip"
"""The answer that leaves a column out."""


@dataclass(frozen=True, slots=True)
class ColumnReading:
    """What a column was taken for: a channel, or a word for it, in which unit, and why."""

    column: str
    taken_for: str
    unit: str = ""
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Question:
    """A question that the table leaves open: the key of its answer, the text, the options, and what is assumed
    without an answer; without a ``default`` it has to be answered."""

    key: str
    text: str
    options: tuple[str, ...] = ()
    default: str | None = None

    def __str__(self) -> str:
        return f"{self.text} (--answer {self.key}={'|'.join(self.options) or 'VALUE'})"


@dataclass(frozen=True, slots=True)
class ColumnCandidate:
    """A column that may hold a quantity, the fraction of its name that says so, and the units of its header.

    ``positive`` is the side that its header says to count positive.
    """

    column: str
    quantity: column_names.Quantity
    cover: float
    units: tuple[str, ...]
    words: frozenset[str]
    positive: str = ""

    @property
    def header_unit(self) -> tuple[str, str] | None:
        """The unit in the column's header, with that as the reason."""
        return (self.units[0], "head says so") if self.units else None


@dataclass(slots=True)
class MappingDraft:
    """The table and what has been determined of it so far; ``tree`` is the map as nested tables of TOML."""

    raw: table_files.RawTable
    answers: Mapping[str, str]
    tree: dict[str, Any] = field(default_factory=dict)
    readings: list[ColumnReading] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    candidates: list[ColumnCandidate] = field(default_factory=list)
    used_answers: set[str] = field(default_factory=set)

    def ask(self, key: str, text: str, options: Sequence[str] = (), default: str | None = None) -> str | None:
        """The answer to a question; without one the question is noted, and the default holds."""
        answer = self.answers.get(key)
        if answer is not None:
            check_answer(key, answer, options)
            self.used_answers.add(key)
            return answer
        self.questions.append(Question(key, text, (*options,), default))
        return default

    def filled_cells(self, column: str) -> pd.Series[Any]:
        """A column's filled cells."""
        return self.raw.columns[column].dropna()

    def is_numeric(self, column: str) -> bool:
        """Whether all cells of a column are numbers."""
        return pd.api.types.is_numeric_dtype(self.raw.columns[column].dtype)

    def numbers_or_nan(self, column: str) -> Floats:
        """A column's numbers, NaN for other cells."""
        return np.asarray(pd.to_numeric(self.raw.columns[column], errors="coerce").to_numpy(dtype=float))

    def candidates_for(self, *names: str) -> list[ColumnCandidate]:
        """The candidates for quantities, the best covered name first, then the fullest; empty columns come last."""
        candidates = [candidate for candidate in self.candidates if candidate.quantity.name in names]
        return sorted(
            candidates,
            key=lambda candidate: (
                self.is_empty(candidate.column),
                -candidate.cover,
                -self.filled_cells(candidate.column).size,
            ),
        )

    def is_empty(self, column: str) -> bool:
        """Whether a column has no value at all."""
        return self.filled_cells(column).empty

    def note_interpretation(self, column: str, taken_for: str, unit: str = "", *reasons: str) -> None:
        """Note what a column was taken for."""
        self.readings.append(ColumnReading(column, taken_for, unit, tuple(reason for reason in reasons if reason)))


_ANSWER_CHECKS: dict[str, Callable[[str], object]] = {
    "zone": time_columns.checked_zone, "start": pd.Timestamp, "day": time_columns.checked_day,
    "full_scale": float, "year": int, "variation": float,
}  # fmt: skip
"""What validates an answer without options: it raises :class:`ValueError`."""
_ANSWER_KEYS = frozenset({*_ANSWER_CHECKS, "date_order", "o_is", "since", "time_unit", "x_axis", "first_shaft",
                          "course", "heading", "rate_of_turn", "wind", "north", "only",
                          "unit.speed", "unit.wind"})  # fmt: skip
"""What may be answered, besides ``unit.COLUMN`` and ``full_scale.ACTUATOR``."""


def check_answer(key: str, answer: str, options: Sequence[str] = ()) -> None:
    """Raise :class:`ConfigurationError` for an invalid answer."""
    if options and answer not in (*options, SKIP):
        raise errors.ConfigurationError(f"answer {key}={answer} is none of {', '.join(options)}")
    check = _ANSWER_CHECKS.get(key.partition(".")[0])
    if check is None or answer == SKIP:
        return
    try:
        check(answer)
    except ValueError as error:
        raise errors.ConfigurationError(f"answer {key}={answer} cannot be used", why=str(error)) from error


def check_keys(answers: Mapping[str, str], columns: Sequence[str]) -> None:
    """Raise :class:`ConfigurationError` for an answer to a question that does not exist."""
    for key in answers:
        kind, _, name = key.partition(".")
        if key not in _ANSWER_KEYS and kind != "full_scale" and not (kind == "unit" and name in columns):
            raise errors.ConfigurationError(
                f"there is no question {key!r}",
                fix=f"answer one of {', '.join(sorted(_ANSWER_KEYS))}, or unit.COLUMN",
            )


def column_candidates(raw: table_files.RawTable) -> list[ColumnCandidate]:
    """Each column with the first quantity that its description or name means and its unit fits."""
    candidates = []
    components = column_names.components_by_name(raw.names)
    for column in raw.names:
        head, *alternatives = column_names.readings_of_header(column)
        stated_units = column_names.parse_units(raw.units.get(column, ""))
        if (exact := column_names.QUANTITY_BY_CHANNEL.get(column)) is not None:
            candidates.append(
                ColumnCandidate(
                    column, exact, 1.0, stated_units or head.units, frozenset(column_names.split_into_words(column))
                )
            )
            continue
        signs = [column_names.split_sign_statement(text) for text in (raw.meanings.get(column, ""), column)]
        names = [(signs[0][0], stated_units), (head.name, stated_units or head.units)]
        names += [(reading.name, stated_units or reading.units) for reading in alternatives]
        if column.endswith(head.text):  # the supposed unit may be part of the name
            names.append((column, stated_units))
        if {"rpm", "rps"} & {*head.units}:  # "Shaft (rpm)"
            names.append((f"{head.name} speed", head.units))
        if head.text == "M":  # magnetic, where metres do not fit
            names.append((head.name, stated_units))
        if column in components:
            names.insert(0, (components[column], stated_units))
        for name, units in names:
            is_signal = name == column and not column_names.ELECTRICAL.isdisjoint(head.units)
            fitting = [
                (match, usable)
                for match in column_names.match_quantities(name)
                if not (is_signal and match.cover < 1.0)  # a wind_V is one of its parts, a rudder_V volts
                if (usable := tuple(unit for unit in units if accepts_unit(match.quantity, unit))) or not units
            ]
            if fitting:
                match, usable = fitting[0]
                if name == "n":  # to the north beside an e, else revolutions of the shaft
                    beside_east = {"e", "east"} & {str(label).lower() for label in raw.columns.columns}
                    quantity_name = "north_m" if beside_east else "shaft"
                    pairs = (pair for pair in fitting if pair[0].quantity.name == quantity_name)
                    match, usable = next(pairs, fitting[0])
                if match.quantity.name in column_names.QUANTITY_BY_CHANNEL and column_names.ORDER & set(
                    column_names.split_into_words(name)
                ):
                    break  # an ordered motion is not the motion
                header = f"{name} {column} {raw.units.get(column, '')}"
                quantity = column_names.refer_to_north(match.quantity, header)
                words = frozenset(column_names.split_into_words(name))
                positive = signs[1][1] or signs[0][1]
                candidates.append(ColumnCandidate(column, quantity, match.cover, usable, words, positive))
                break
    return candidates


def candidates_with_answers(draft: MappingDraft) -> list[ColumnCandidate]:
    """The candidates, their units as answered; those to skip are left out. Raises :class:`ConfigurationError`."""
    candidates = []
    for candidate in column_candidates(draft.raw):
        answer = draft.answers.get(f"unit.{candidate.column}")
        draft.used_answers.add(f"unit.{candidate.column}")
        if answer == SKIP:
            draft.note_interpretation(candidate.column, "-", "", "left out, as answered")
            continue
        units = column_names.parse_units(answer) or (answer,) if answer else candidate.units
        if answer and not accepts_unit(candidate.quantity, units[0]):
            raise errors.ConfigurationError(f"unit {answer!r} does not fit what {candidate.column!r} is taken for")
        candidates.append(replace(candidate, units=units))
    return candidates


def accepts_unit(quantity: column_names.Quantity, unit: str) -> bool:
    """Whether a column of a quantity may be in a unit."""
    if unit == "ddmm":
        return quantity.name in ("latitude", "longitude")
    if quantity.name in ("time", "date"):
        return unit in ("s", "ms", "us", "ns", "min", "h", "d")
    if quantity.name in ("shaft", "engine_rpm", "rudder", "value") and unit == "percent":
        return True
    try:
        unit_conversion(quantity.unit or "1", unit)
    except errors.ConfigurationError:
        return False
    return True


def map_as_toml(tree: Mapping[str, Any], comments: Mapping[str, str]) -> str:
    """A map's tables as TOML, with ``comments`` by channel at the end of its line."""
    tables = {
        key: value
        for key, value in tree.items()
        if isinstance(value, dict) or (isinstance(value, list | tuple) and value and isinstance(value[0], dict))
    }
    lines = [f"{key} = {toml_value(value)}" for key, value in tree.items() if key not in tables]
    for key, value in tables.items():
        for table in [value] if isinstance(value, dict) else value:
            lines += ["", f"[{key}]" if isinstance(value, dict) else f"[[{key}]]"]
            for name, entry in table.items():
                comment = " ".join(comments.get(name, "").split())
                lines.append(f"{name} = {toml_value(entry)}" + (f"  # {comment}" if comments.get(name) else ""))
    return "\n".join(lines) + "\n"
