"""A column map for a table that nobody has described: what each column is taken for, in which unit, and why.

Names say what a column may be, heads say units (:mod:`seatrial.acquisition.tables.draft`), and what neither says is
looked for in the numbers (:mod:`seatrial.acquisition.tables.channel_columns`). What is not clear is asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.actuators import DEFAULT as DEFAULT_SHIP
from seatrial.acquisition.core.actuators import Actuators
from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.channels import required_names
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.tables.channel_columns import FASTEST_MPS, read_channels
from seatrial.acquisition.tables.column_map import Long, widen
from seatrial.acquisition.tables.draft import (
    ColumnReading,
    Draft,
    Question,
    as_toml,
    candidates_of,
    check_keys,
    with_answers,
)
from seatrial.acquisition.tables.evidence import grid_of
from seatrial.acquisition.tables.table_context import Known, best
from seatrial.acquisition.tables.table_files import RawTable, no_numbers
from seatrial.acquisition.tables.time_columns import TimeColumn, resolve_times
from seatrial.acquisition.tables.time_reading import read_time

_MOST_VARIABLES = 500
_MOST_WORDS = 0.2  # of the cells of a column of numbers
_LONGEST_S, _SHORTEST_STEP_S = 400 * 86_400.0, 1e-3
_DECLARED = {"power": ("shaft_power_kw", "kW"), "torque": ("shaft_torque_knm", "kNm")}
"""Quantities that are no channels of a trial until a map declares them."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A map as TOML, what each column was taken for, what is asked and what looks odd."""

    text: str
    readings: tuple[ColumnReading, ...]
    questions: tuple[Question, ...]
    warnings: tuple[str, ...]
    passed_over: tuple[str, ...]

    @property
    def unanswered(self) -> tuple[Question, ...]:
        """The questions that have to be answered before an import."""
        return tuple(question for question in self.questions if question.default is None)


def propose(
    raw: RawTable, answers: Mapping[str, str] | None = None, ship: Actuators = (), vessel: str = ""
) -> Proposal:
    """A map for a table as it is in its file, by the ``answers`` to what a proposal before has asked.

    ``ship`` are the actuators of the vessel, if she is known, ``vessel`` her name. Raises :class:`InputError` for
    a table without times, or in which nothing is known.
    """
    if raw.is_nameless:
        names = list(map(str, raw.columns.columns))
        fix = f"name its columns, {names[0]!r} to {names[-1]!r}, in a column map (--columns)"
        raise InputError("has no row of names", where=str(raw.path), why="it begins with data", fix=fix)
    draft = Draft(raw, answers or {})
    _find_long(draft)
    check_keys(draft.answers, list(map(str, draft.raw.columns.columns)))
    draft.candidates = with_answers(draft)
    if vessel:
        draft.tree["trial"] = {"vessel": vessel}
    used = set(read_time(draft))
    draft.candidates = [candidate for candidate in draft.candidates if candidate.column not in used]
    seconds = _seconds(draft)
    context = Known(draft, seconds, grid_of(seconds))
    _complete(context, read_channels(context, ship) or DEFAULT_SHIP, ship_is_known=bool(ship))
    _check_times(context)
    _drop_text(context)
    asked = any(question.default is None for question in draft.questions)
    if not asked and not draft.tree.get("channels") and "position" not in draft.tree:
        raise InputError("has no column that is a channel", where=str(raw.path), fix="give a map with --columns")
    for key in [key for key in draft.answers if key not in draft.used]:
        draft.warnings.append(
            f"the answer {key}={draft.answers[key]} is not used: the table leaves no such question"
        )
    used |= {reading.column for reading in draft.readings}
    comments = {reading.taken_for: "; ".join(reading.reasons) for reading in draft.readings}
    passed = tuple(name for name in map(str, draft.raw.columns.columns) if name not in used)
    text = as_toml(_in_order(draft.tree), comments)
    return Proposal(text, tuple(draft.readings), tuple(draft.questions), tuple(draft.warnings), passed)


def _in_order(tree: dict[str, Any]) -> dict[str, Any]:
    """A map's keys as a reader expects them: plain values, the ship, the time, the channels."""
    first = ("absent", "derive", "unreadable_rows", "trial", "actuator", "long", "time", "position", "orientation",
             "velocity")  # fmt: skip
    return {key: tree[key] for key in (*first, "channels", *tree) if key in tree}


def _find_long(draft: Draft) -> None:
    """Spread a table that has a row for each value."""
    candidates = candidates_of(draft.raw)

    def of(*names: str) -> list[str]:
        return [candidate.column for candidate in candidates if candidate.quantity.name in names]

    keys, values = of("time", "date"), of("value")
    for variable in of("variable"):
        column = draft.raw.columns[variable]
        names = column.dropna().unique()
        text = not pd.api.types.is_numeric_dtype(column.dtype)
        if text and keys and values and 1 < len(names) <= min(_MOST_VARIABLES, column.size // 2):
            long = Long(variable, values[0], next(iter(of("unit")), None))
            draft.tree["long"] = {key: value for key, value in vars(long).items() if value is not None}
            draft.raw, duplicates = widen(draft.raw, long, keys, names)
            if duplicates:
                draft.warnings.append(f"{duplicates:,} values come twice of one variable and time; the last counts")
            return


def _seconds(draft: Draft) -> Floats:
    """Seconds since the first row of each row, NaN without a time; rows are put in the order of their writing."""
    time = TimeColumn(**draft.tree["time"])
    timed = resolve_times(draft.raw, replace(time, zone=time.zone or "UTC"))
    draft.raw = timed.raw
    draft.warnings.extend(timed.remarks)
    ns = timed.index.asi8
    has_time = ~np.asarray(timed.index.isna())
    cells = draft.raw.columns[time.column]
    if not has_time.any():
        example = next(iter(cells.dropna()), "")
        what = f"no time of column {time.column!r} can be read, like {str(example)!r}"
        raise InputError(what, where=str(draft.raw.path))
    if not has_time.all():
        draft.tree["unreadable_rows"] = "drop"
        row = int(np.flatnonzero(~has_time)[0])
        draft.warnings.append(
            f"{int((~has_time).sum()):,} rows have no time that can be read, like {str(cells.iloc[row])!r} in row"
            f" {row + 1}; they are dropped"
        )
    return np.where(has_time, (ns - ns[has_time][0]) / 1e9, np.nan)


def _complete(context: Known, ship: Actuators, *, ship_is_known: bool) -> None:
    """Put the channels into the map, those that follow from them, and those that are absent."""
    draft, has = context.draft, set(context.channels) | set(context.series)
    wanted = [name for name in _derivable(has) if name not in has]
    if "heading_deg" not in has and "north_m" in has:
        draft.warnings.append("no column tells the heading: surge, sway and yaw rate are left out")
    if wanted:
        draft.tree["derive"] = wanted
    has |= set(wanted)
    if "apparent_wind" in draft.tree:
        if {"surge_mps", "sway_mps"} <= has:
            has |= {"wind_direction_deg", "wind_speed_mps"}
        else:
            del draft.tree["apparent_wind"]
    draft.tree["channels"] = context.channels
    states_ship = ship_is_known or "actuator" in draft.tree
    draft.tree["absent"] = [name for name in required_names(ship, has, known=states_ship) if name not in has]
    _declare(context)


def _derivable(has: set[str]) -> tuple[str, ...]:
    """The channels that follow from those that a table has."""
    over_ground = {"course_over_ground_deg", "speed_over_ground_mps"} <= has
    if "heading_deg" in has:
        return "yaw_rate_dps", *(("surge_mps", "sway_mps") if over_ground or "north_m" in has else ())
    return ("speed_over_ground_mps", "course_over_ground_deg") if "north_m" in has else ()


def _drop_text(context: Known) -> None:
    """Let rows go in which a column of numbers holds a word, if they are few, and say which."""
    draft = context.draft
    for column in dict.fromkeys(str(entry["column"]) for entry in context.channels.values()):
        cells = draft.raw.columns[column]
        words = no_numbers(cells)
        if 0 < np.count_nonzero(words) <= _MOST_WORDS * cells.notna().sum():
            row = int(np.flatnonzero(words)[0])
            draft.tree["unreadable_rows"] = "drop"
            cell = f"{str(cells.iloc[row])!r} in row {row + 1}"
            draft.warnings.append(
                f"{np.count_nonzero(words):,} rows have no number in {column!r}, like {cell}; they are dropped"
            )


def _declare(context: Known) -> None:
    """Let shaft power and torque be channels that the map declares."""
    draft = context.draft
    for name, (channel, unit) in _DECLARED.items():
        candidate = best(draft, name)
        if candidate is None:
            continue
        if not candidate.units:
            draft.warnings.append(f"{candidate.column!r} is left out: its head names no unit")
            draft.note(candidate.column, "-", "", "left out: no unit")
            continue
        draft.tree.setdefault("channel", []).append({"name": channel, "unit": unit, "range": [-1e5, 1e5]})
        context.channels[channel] = {"column": candidate.column, "unit": candidate.units[0]}
        draft.note(candidate.column, channel, candidate.units[0], "declared in the map")


def _check_times(context: Known) -> None:
    """Say so where span, step or track cannot be a trial's."""
    has_time = np.isfinite(context.t)
    steps, warnings = np.diff(context.t[has_time]), context.draft.warnings
    if steps.size == 0:
        return
    span, usual = float(np.ptp(context.t[has_time])), float(np.median(np.abs(steps)))
    if span > _LONGEST_S:
        days = span / 86_400
        warnings.append(f"the table lasts {days:.0f} days: day and month in the wrong order, or ms for s?")
    elif 0.0 < usual < _SHORTEST_STEP_S:
        warnings.append(f"rows are {usual:.2g} s apart: the times may be in a larger unit")
    forward = steps > 0.0
    if "north_m" not in context.series or not forward.any():
        return
    moved = np.hypot(*(np.diff(context.series[name][has_time]) for name in ("north_m", "east_m")))
    speed = float(np.nanmedian(moved[forward] / steps[forward]))
    if speed > FASTEST_MPS:
        warnings.append(
            f"by its positions the ship makes {speed:.3g} m/s half of the time: times in ms, or positions in"
            " another unit?"
        )
