"""Tables of a vessel file with where each number is from, and their text."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite

from hybrid.vessel.estimate.particulars import Estimate

DIGITS = 5


@dataclass(frozen=True, slots=True)
class Assumed:
    """A number that is neither given nor estimated, and why it is what it is."""

    value: float
    why: str = "assumed"


Cell = str | float | Estimate | Assumed


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the file: its head, what its numbers are called in ``[estimated]``, and its rows."""

    head: str
    label: str
    rows: dict[str, Cell]

    def number(self, key: str) -> float:
        """The number of a row."""
        cell = self.rows[key]
        return float(cell.value if isinstance(cell, Estimate | Assumed) else cell)


def text_of(table: Table) -> str:
    """A table as TOML, a comment at each number that was not given."""
    return "\n".join([table.head, *(_row(key, cell) for key, cell in table.rows.items())]) + "\n"


def estimated(tables: Iterable[Table]) -> str:
    """The table of relative errors of all numbers that a regression gave."""
    rows = [
        f'"{table.label}.{key}" = {_number(round(cell.error, 3))}'
        for table in tables
        for key, cell in table.rows.items()
        if isinstance(cell, Estimate) and cell.error > 0.0
    ]
    return "\n".join(["[estimated]", *rows]) + "\n"


def _row(key: str, cell: Cell) -> str:
    if isinstance(cell, Estimate) and cell.error == 0.0:
        return f"{key} = {_number(cell.value)}"
    if isinstance(cell, Estimate):
        return _with_comment(f"{key} = {_number(cell.value)}", f"+-{100.0 * cell.error:.0f} %: {cell.source}")
    if isinstance(cell, Assumed):
        return _with_comment(f"{key} = {_number(cell.value)}", cell.why)
    return f"{key} = {json.dumps(cell) if isinstance(cell, str) else _number(cell)}"


def _with_comment(text: str, comment: str) -> str:
    return f"{text:<34}  # {comment}"


def _number(value: float) -> str:
    assert isfinite(value)
    return repr(float(f"{value:.{DIGITS}g}"))
