"""Tables of loggers whose lines are no plain columns: pairs of a number and a value, frames of a CAN bus."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import pandas as pd

_EXPEDITION = re.compile(r"!boat\s*,", re.IGNORECASE)
_IN_KNOTS = ("BSP", "SOG", "AWS", "TWS", "VMG", "VMC", "Targ Bsp", "Pol Bsp")
_CAN_HEADS = (
    {"id", "len", "d1"}, {"id", "dlc", "d0"}, {"id", "length", "data"}, {"id", "dlc", "data"}, {"can id", "data"},
    {"arbitration id", "data"}, {"arbitration_id", "data"},
)  # fmt: skip
"""Columns that tables of CAN frames have: of SavvyCAN, python-can and other programs."""


def is_expedition(text: str) -> bool:
    """Whether a text is a log of Expedition: after a boat's number and a time, pairs of a number and a value."""
    return bool(_EXPEDITION.match(text))


def read_expedition(text: str) -> tuple[pd.DataFrame, dict[str, str]]:
    """The frame of Expedition's own boat, 0, and the units of its speeds, by the two heads that name the numbers.

    Raises :class:`ValueError` naming the first line that is not of pairs.
    """
    lines = [line.strip().rstrip(",") for line in text.splitlines()]
    heads = [line.lstrip("!").split(",") for line in lines if line.startswith("!") and not line.startswith("!v")]
    if len(heads) < 2:
        raise ValueError("this log of Expedition has no line !boat,0,1 ... with the numbers of its names")
    named = [name.strip() for name in heads[0]]
    by_number = dict(zip(heads[1][1:], named[1:], strict=False))
    rows = []
    for place, line in enumerate(lines, start=1):
        if not line or line.startswith("!"):
            continue
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) % 2:
            raise ValueError(f"line {place} of this log of Expedition is not of pairs of a number and a value")
        if cells[0] == "0":
            pairs = zip(cells[2::2], cells[3::2], strict=True)
            values = {by_number.get(number, f"number {number}"): value for number, value in pairs}
            rows.append({by_number.get("0", "Utc"): cells[1]} | values)
    frame = pd.DataFrame(rows).apply(_numbers)
    return frame, {name: "kn" for name in _IN_KNOTS if name in frame}


def _numbers(column: pd.Series[Any]) -> pd.Series[Any]:
    values = pd.to_numeric(column, errors="coerce")
    return values if values.notna().sum() == column.notna().sum() else column


def is_table_of_frames(names: Sequence[str]) -> bool:
    """Whether columns are those of frames of a CAN bus."""
    given = {name.strip().lower() for name in names}
    return any(head <= given for head in _CAN_HEADS)
