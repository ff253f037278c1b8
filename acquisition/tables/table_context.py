"""What is known of a table while its columns are taken for channels, and how a column is taken, turned or asked
about. Without it each reader of columns would have to be told by the ones before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from acquisition.core.angles import unwrap, wrap_360
from acquisition.core.arrays import Complexes, Floats
from acquisition.core.channels import BY_NAME
from acquisition.core.units import scale_to
from acquisition.tables import evidence
from acquisition.tables.draft import SKIP, Candidate, Draft
from acquisition.tables.evidence import Fit, Rate, Told, increments, integrals, means, over_gaps

POSITION = ("north_m", "east_m")
GROUND = ("course_over_ground_deg", "speed_over_ground_mps")
UNKNOWN = Fit(np.nan, 0.0, 0)


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


def best(draft: Draft, name: str) -> Candidate | None:
    """The likeliest column for a quantity; the others are said to be left."""
    found = draft.of(name)
    for each in found[1:]:
        draft.note(each.column, "-", "", f"not used: {found[0].column!r} is taken for it")
    return found[0] if found else None


def take(known: Known, name: str, candidate: Candidate, unit: str, *why: str, **more: Any) -> None:
    """Let a column be a channel."""
    channel, column, draft = BY_NAME[name], candidate.column, known.draft
    entry: dict[str, Any] = {"column": column, "unit": unit}
    factor = more["full_scale"] / 100.0 if more else scale_to(channel.unit, unit)
    values = draft.numbers(column)
    if missing := evidence.codes_of(values, factor, channel):
        entry["missing"] = missing
        why = (*why, f"{', '.join(f'{each:g}' for each in missing)} stands for no value")
        values = evidence.without_codes(values, missing)
    known.channels[name] = entry | more
    known.series[name] = values * factor
    draft.note(column, name, unit, *why)
    if np.isnan(values).all():
        draft.warnings.append(f"column {column!r}, taken for {name}, holds no value at all")


def take_best(known: Known, name: str, unit_of: Callable[[Known, Candidate, str], Told | None]) -> None:
    """Let the likeliest column for a channel be it, in the unit that is found."""
    candidate = best(known.draft, name)
    if candidate is not None and (told := unit_of(known, candidate, name)):
        take(known, name, candidate, *told)


def turn_round(known: Known, name: str, why: str) -> None:
    """Change the sign of a channel that was taken."""
    column = count_otherwise(known, name, -1.0, 0.0, f"sign turned: {why}")
    known.draft.warnings.append(f"the sign of {column!r} is turned round: {why}")


def count_otherwise(known: Known, name: str, scale: float, offset: float, why: str) -> str:
    """Let a channel that was taken be ``scale`` times what it was, plus ``offset``; the column's name."""
    entry, readings = known.channels[name], known.draft.readings
    entry["scale"] = scale * entry.get("scale", 1.0)
    if shifted := scale * entry.get("offset", 0.0) + offset:
        entry["offset"] = shifted
    values = scale * known.series[name] + offset
    known.series[name] = wrap_360(values) if name == "heading_deg" else values
    place = next(i for i, each in enumerate(readings) if each.taken_for == name)
    readings[place] = replace(readings[place], reasons=(*readings[place].reasons, why))
    return readings[place].column


def asked(draft: Draft, key: str, text: str, options: tuple[str, ...]) -> Told | None:
    """The unit that a person says, the first one until then; None for a column that is to be left out."""
    answer = draft.ask(key, text, options)
    return None if answer == SKIP else (answer or options[0], "as answered")


def changes_of(known: Known, *names: str) -> list[Floats]:
    """How much channels change from one moment of the grid to the next; empty where that cannot be told."""
    if known.grid.size < 3 or not set(names) <= set(known.series):
        return []
    turning = {"heading_deg": unwrap(known.series["heading_deg"])} if "heading_deg" in names else {}
    return [increments(known.t, (known.series | turning)[name], known.grid) for name in names]


def moves_of(known: Known) -> Complexes | None:
    """The ship's moves between the moments of the grid, north + i east, by position or by course and speed."""
    if measured := changes_of(known, *POSITION):
        gap = over_gaps(known.t[np.isfinite(known.series["north_m"])], known.grid)
        return np.where(gap, np.nan, measured[0] + 1j * measured[1])
    if known.grid.size < 3 or not set(GROUND) <= set(known.series):
        return None
    course, speed = (known.series[name] for name in GROUND)
    return travelled(known, np.asarray(speed * np.exp(1j * np.deg2rad(course))))


def travelled(known: Known, velocity: Complexes) -> Complexes:
    """What a velocity [n] adds up to from one moment of the grid to the next."""
    north, east = (integrals(known.t, part, known.grid) for part in (np.real(velocity), np.imag(velocity)))
    return np.asarray(north + 1j * east)


def mean_angle(known: Known, angle_deg: Floats) -> Floats:
    """The mean of an angle [n, deg], not wrapped, between the moments of the grid."""
    return means(known.t, unwrap(angle_deg), known.grid)


def rate_unit(known: Known, candidate: Candidate, found: Fit, kind: Rate) -> Told | None:
    """A rate's unit as the head says, else as the fit does; an oddness between the two is said."""
    if not candidate.headed:
        return evidence.rate_by_fit(found, kind)
    if odd := evidence.odd_factor(candidate.column, candidate.units[0], found, kind):
        known.draft.warnings.append(odd)
    return candidate.headed
