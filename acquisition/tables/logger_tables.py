"""Tables of loggers whose lines are no plain columns: pairs of a number and a value, solutions of RTKLIB, segments
of LabVIEW, frames of a CAN bus."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.tables.time_text import time_in_head

_EXPEDITION = re.compile(r"!boat\s*,", re.IGNORECASE)
_IN_KNOTS = ("BSP", "SOG", "AWS", "TWS", "VMG", "VMC", "Targ Bsp", "Pol Bsp")
_CAN_HEADS = (
    {"id", "len", "d1"}, {"id", "dlc", "d0"}, {"id", "length", "data"}, {"id", "dlc", "data"}, {"can id", "data"},
    {"arbitration id", "data"}, {"arbitration_id", "data"},
)  # fmt: skip
"""Columns that tables of CAN frames have: of SavvyCAN, python-can and other programs."""
_RTKLIB = re.compile(r"^%\s*(GPST|UTC|JST)[ ,;\t]+(.*\bQ\b.*)$", re.MULTILINE)
_RTKLIB_CELLS = re.compile(r"[,;\t ]+")
_RTKLIB_SEXAGESIMAL = "(d'\")"
_RTKLIB_QUALITY = ("no solution", "fixed", "float", "SBAS", "DGPS", "single", "PPP")
_END_OF_HEAD = "***End_of_Header***"


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


def is_rtklib(text: str) -> bool:
    """Whether a text is a file of solutions of RTKLIB (.pos), by the comment that names its columns."""
    return text.startswith("%") and _RTKLIB.search(text) is not None


def read_rtklib(text: str) -> tuple[pd.DataFrame, str]:
    """The frame of RTKLIB's solutions, and how many there are of each quality.

    The time, of a date and a clock or of a week and seconds, keeps the name of its system. Coordinates in degrees,
    minutes and seconds or from the earth's centre become degrees; those of a baseline east and north of its base.
    Raises :class:`ValueError` naming the first line with other cells than the header.
    """
    head = _RTKLIB.search(text)
    assert head is not None
    system, names = head[1], _RTKLIB_CELLS.split(head[2].strip())
    widths = [3 if _RTKLIB_SEXAGESIMAL in name else 1 for name in names]
    rows = []
    for place, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("%"):
            continue
        cells = _RTKLIB_CELLS.split(line.strip())
        if len(cells) != 2 + sum(widths):
            raise ValueError(f"line {place} has {len(cells)} cells, the header {2 + sum(widths)}")
        rows.append(cells)
    table = np.array(rows, dtype=object).reshape(-1, 2 + sum(widths))
    frame = _rtklib_times(table, system)
    first = 2
    for name, width in zip(names, widths, strict=True):
        values = table[:, first : first + width].astype(float)
        frame[name.replace(_RTKLIB_SEXAGESIMAL, "(deg)")] = _degrees(values) if width > 1 else values[:, 0]
        first += width
    numbers, counts = np.unique(frame["Q"].to_numpy(dtype=int), return_counts=True)
    qualities = ", ".join(f"{count:,} {_quality(number)}" for number, count in zip(numbers, counts, strict=True))
    return _on_earth(frame), f"solutions of RTKLIB: {qualities}"


def _rtklib_times(table: np.ndarray, system: str) -> pd.DataFrame:
    if len(table) and "/" in table[0, 0]:
        return pd.DataFrame({f"time {system}": [f"{date} {clock}" for date, clock in table[:, :2]]})
    if system != "GPST":
        raise ValueError(f"its weeks and seconds are in {system}; write them in GPST, or as dates")
    return pd.DataFrame({"GPS week": table[:, 0].astype(float), "time of week (s)": table[:, 1].astype(float)})


def _quality(number: int) -> str:
    return _RTKLIB_QUALITY[number] if number < len(_RTKLIB_QUALITY) else f"of quality {number}"


def _degrees(values: Floats) -> Floats:
    """Degrees of whole degrees, which alone have the sign, minutes and seconds [n, 3]."""
    return np.asarray(np.copysign(np.abs(values) @ (1.0, 1.0 / 60.0, 1.0 / 3600.0), values[:, 0]))


def _on_earth(frame: pd.DataFrame) -> pd.DataFrame:
    """Coordinates from the earth's centre as latitude, longitude and height; east and north of a base by name."""
    centre = [f"{axis}-ecef(m)" for axis in "xyz"]
    if set(centre) <= set(frame):
        places = pymap3d.ecef2geodetic(*(frame[name].to_numpy() for name in centre))
        geodetic = dict(zip(("latitude(deg)", "longitude(deg)", "height(m)"), places, strict=True))
        return frame.drop(columns=centre).assign(**geodetic)
    return frame.rename(columns={"e-baseline(m)": "east(m)", "n-baseline(m)": "north(m)", "u-baseline(m)": "up(m)"})


def without_heads_of_labview(text: str) -> tuple[list[str], str]:
    """The lines of the two heads of a LabVIEW measurement, and what follows; other texts have none of them.

    The times of several segments, each of which has a head of its own, are counted on from the start of the first.
    Raises :class:`ValueError` for a segment without a start, or with other columns.
    """
    if not text.startswith("LabVIEW Measurement"):
        return [], text
    file_head, *parts = text.split(_END_OF_HEAD)
    if not parts[1:]:
        return file_head.splitlines(), "".join(part.partition("\n")[2] for part in parts)
    heads, bodies = [parts[0].partition("\n")[2]], list[str]()
    for part in parts[1:-1]:
        body, head = _divided(part)
        bodies.append(body)
        heads.append(head)
    bodies.append(parts[-1].partition("\n")[2])
    first = [*file_head.splitlines(), *heads[0].splitlines()]
    return first, bodies[0] + "".join(
        _counted_on(bodies[0], body, first, head, place)
        for place, (body, head) in enumerate(zip(bodies[1:], heads[1:], strict=True), start=2)
    )


def _divided(part: str) -> tuple[str, str]:
    """The rows of a segment, and the head of the next one, which begins with the number of its channels."""
    _, _, body = part.partition("\n")
    begin = re.search(r"^Channels\b", body, re.MULTILINE)
    if begin is None:
        raise ValueError("a segment of this LabVIEW measurement has no line Channels")
    return body[: begin.start()], body[begin.start() :]


def _counted_on(first_body: str, body: str, first: Sequence[str], head: str, place: int) -> str:
    """The rows of a later segment, their first cell counted from the start of the first segment."""
    starts = [pd.Timestamp(time_in_head(lines) or "NaT") for lines in (first, head.splitlines())]
    later_s = (starts[1] - starts[0]).total_seconds()
    if np.isnan(later_s):
        raise ValueError(f"segment {place} of this LabVIEW measurement, or the first, states no start")
    names, _, rows = body.lstrip("\n\r\t ").partition("\n")
    if names.strip() != first_body.lstrip("\n\r\t ").partition("\n")[0].strip():
        raise ValueError(f"segment {place} of this LabVIEW measurement has other columns: {names.strip()!r}")
    return "".join(_later(line, later_s) for line in rows.splitlines(keepends=True))


def _later(line: str, seconds: float) -> str:
    cell = re.match(r"\s*-?\d+(?:([.,])\d*)?(?:[eE][+-]?\d+)?", line)
    if cell is None:
        return line
    counted = f"{float(cell[0].replace(',', '.')) + seconds:.9f}"
    return counted.replace(".", cell[1] or ".") + line[cell.end() :]


def is_table_of_frames(names: Sequence[str]) -> bool:
    """Whether columns are those of frames of a CAN bus."""
    plain_names = {name.strip().lower() for name in names}
    return any(head <= plain_names for head in _CAN_HEADS)
