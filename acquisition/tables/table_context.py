"""What is known of a table while its columns are taken for channels, and how a column is taken, turned or asked
about. Without it each reader of columns would have to be told by the ones before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seatrial.acquisition.core.angles import unwrap, wrap_360
from seatrial.acquisition.core.arrays import Complexes, Floats
from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.core.units import scale_to
from seatrial.acquisition.tables import evidence
from seatrial.acquisition.tables.draft import SKIP, ColumnCandidate, Draft
from seatrial.acquisition.tables.evidence import Rate, ScaleFit, Told, increments, integrals, means, over_gaps

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
    if missing := evidence.codes_of(values, factor, channel):
        entry["missing"] = missing
        why = (*why, f"{', '.join(f'{code:g}' for code in missing)} stands for no value")
        values = evidence.without_codes(values, missing)
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
        return evidence.rate_by_fit(regression, kind)
    if remark := evidence.odd_factor(candidate.column, candidate.units[0], regression, kind):
        context.draft.warnings.append(remark)
    return candidate.headed
