"""A proposal while it is made, and when it is done: what each column was taken for and why, what is still asked."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.units import to_house
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
from seatrial.acquisition.tables.time_columns import known_day
from seatrial.acquisition.tables.zones import known_zone

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
        to_house(quantity.unit or "1", unit)
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
