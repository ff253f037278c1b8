"""Tables of text cells as loggers and spreadsheets write them: where the header stands, what is between the cells.

The encoding, the delimiter, the decimal sign, lines before the header and a row of units below it are found by what
the lines look like; nothing here knows what a column means.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time
from itertools import islice
from typing import Any

import pandas as pd

from acquisition.tables.column_names import LETTERS, is_unit_cell

NOT_AVAILABLE = (
    "-", "--", "---", "----", "-----", "*", "**", "***", "****", "?", "??", "???", "n.a.", "N.A.", "n.v.", "k.A.",
    "N/V", "na", "nil", "NIL", "none", "NONE", "invalid", "INVALID", "Invalid", "missing", "no data", "No Data",
    "NODATA", "#NV", "#DIV/0!", "#WERT!", "#VALUE!", "#REF!", "#BEZUG!", "[]", "\\N", "INF/NAN",
)  # fmt: skip
"""What loggers and spreadsheets write for no value, beside what pandas knows."""

_DELIMITERS = (";", "\t", "|", ",")
_PROBE_LINES = 60
_COMMENT = "#%"
_CODE_PAGES, _PROBE_LETTERS = ("cp1252", "cp932", "gb18030"), 4000
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_POINT_NUMBER = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?")
_GROUPED = {",": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d+)?"), ".": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d+)?")}
_TIME_LIKE = re.compile(r"\d{1,4}[-./:]\d{1,2}[-./:]\d{1,4}.*|\d{1,2}:\d{2}.*")


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the names stand among the rows, and in which row their units, if in one; ``units`` by name."""

    names: tuple[str, ...]
    header: int
    first: int
    units: dict[str, str] = field(default_factory=dict)


def decode(content: bytes) -> str:
    """The text of a file: by its byte order mark, else UTF-8, else the code page by which it holds most letters of
    known names: that of western Windows, Japan or China."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        texts = [content.decode(page, errors="replace") for page in _CODE_PAGES]
        return max(texts, key=lambda text: sum(letter in LETTERS for letter in text[:_PROBE_LETTERS]))


def find_layout(rows: Sequence[Sequence[Any]]) -> Layout:
    """Names and units of a table by its first rows; its header is the last row of names before the first of data.

    The first row where none holds data.
    """
    width = Counter(len(_trimmed(row)) for row in rows[-max(1, len(rows) // 2) :]).most_common(1)[0][0]
    first = next((number for number, row in enumerate(rows) if _is_data(row, width)), len(rows))
    named = [number for number in range(first) if _could_name(rows[number], width)] or [0]
    header, units = named[-1], dict[int, str]()
    if len(named) > 1 and _is_unit_row(rows[named[-1]]):
        header = named[-2]
        units = {place: str(cell).strip() for place, cell in enumerate(rows[named[-1]]) if _filled(cell)}
    names = [_name(cell) for cell in rows[header]]
    if names and names[0][:1] in _COMMENT:
        names[0] = names[0].lstrip(f"{_COMMENT} ")
    by_name = {names[place]: text for place, text in units.items() if place < len(names) and text != "-"}
    return Layout(tuple(names), header, min(max(first, header + 1), len(rows)), by_name)


def read_text(text: str, refuse_twins: Callable[[list[str]], None]) -> tuple[pd.DataFrame, dict[str, str]]:
    """The frame of a text of lines, and the units that a row of it tells by column.

    ``refuse_twins`` raises for names that come twice. Raises whatever pandas does for rows longer than the header.
    """
    lines = list(islice((line.rstrip("\r\n") for line in _lines(text) if line.strip()), _PROBE_LINES))
    delimiter = _delimiter(lines)
    rows = [_split(line, delimiter) for line in lines]
    layout = find_layout(rows)
    refuse_twins([name for name in layout.names if name])
    body = [cell.strip() for row in rows[layout.first :] for cell in row]
    decimal = "," if _decimal_is_comma(body, delimiter) else "."
    content = text[_start_of(text, layout.first) :].encode()
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut
        frame = pd.read_csv(
            io.BytesIO(content), sep=r"\s+" if delimiter == " " else delimiter, decimal=decimal, header=None,
            names=_unique(layout.names), skipinitialspace=True, low_memory=False, index_col=False,
            na_values=list(NOT_AVAILABLE),
        )  # fmt: skip
    frame = _without_nameless(frame)  # what a delimiter at the end of every line leaves
    return frame.apply(lambda column: _ungrouped(column, decimal)), layout.units


def frame_of_rows(rows: Sequence[Sequence[Any]]) -> tuple[pd.DataFrame, dict[str, str]]:
    """The frame of a spreadsheet's rows, whose cells have types, and the units that a row of it tells by column."""
    rows = [row for row in rows if any(_filled(cell) for cell in row)]
    if not rows:
        return pd.DataFrame(), {}
    layout = find_layout(rows[:_PROBE_LINES])
    frame = pd.DataFrame(list(rows[layout.first :]), columns=_unique(layout.names, len(rows[layout.header])))
    frame = _without_nameless(frame.map(_plain).dropna(how="all"))
    return frame.infer_objects().reset_index(drop=True), layout.units


def _without_nameless(frame: pd.DataFrame) -> pd.DataFrame:
    """Without the columns that have neither a name nor a value."""
    empty = [name for name in map(str, frame) if name.startswith("Unnamed:") and frame[name].isna().all()]
    return frame.drop(columns=empty)


def _start_of(text: str, rows: int) -> int:
    """Where in the text its row of this number begins, empty lines not counted."""
    place = 0
    for line in _lines(text):
        if line.strip():
            if rows == 0:
                return place
            rows -= 1
        place += len(line)
    return place


def _lines(text: str) -> Iterator[str]:
    """The lines with their ends, one at a time: a text stream would take four bytes a letter of the whole text."""
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def _plain(cell: Any) -> Any:
    """A spreadsheet's cell: times and dates as text, text for no value as none."""
    if isinstance(cell, str):
        text = cell.strip()
        return None if not text or text in NOT_AVAILABLE else text
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return cell


def _unique(names: Sequence[str], width: int = 0) -> list[str]:
    """A name for each column, as pandas has them where there is none."""
    filled = [*names, *[""] * (width - len(names))]
    return [name or f"Unnamed: {place}" for place, name in enumerate(filled)]


def _name(cell: Any) -> str:
    return " ".join(str(cell).split()) if _filled(cell) else ""


def _filled(cell: Any) -> bool:
    return cell is not None and bool(str(cell).strip())


def _trimmed(row: Sequence[Any]) -> list[Any]:
    """A row without the empty cells at its end."""
    cells = list(row)
    while cells and not _filled(cells[-1]):
        cells.pop()
    return cells


def _is_value(cell: Any) -> bool:
    return _is_number(cell) or bool(_TIME_LIKE.fullmatch(cell.strip()))


def _is_data(row: Sequence[Any], width: int) -> bool:
    filled = [cell for cell in row if _filled(cell)]
    return (
        len(row) >= min(width, 2) and 3 * sum(map(_is_value, filled)) >= len(filled) > 0 and width <= len(row) + 1
    )


def _could_name(row: Sequence[Any], width: int) -> bool:
    filled = [cell for cell in row if _filled(cell)]
    return 2 * len(filled) >= width and not any(map(_is_number, filled))


def _is_number(cell: Any) -> bool:
    return not isinstance(cell, str) or bool(_NUMBER.fullmatch(cell.strip()))


def _is_unit_row(row: Sequence[Any]) -> bool:
    filled = [str(cell) for cell in row if _filled(cell)]
    return 3 * sum(map(is_unit_cell, filled)) >= 2 * len(filled)


def _split(line: str, delimiter: str) -> list[str]:
    return (
        line.split() if delimiter == " " else next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    )


def _delimiter(lines: Sequence[str]) -> str:
    """What divides most lines into equally many cells; of several, what the first of them has."""
    best, found = 0.0, ","
    for delimiter in _DELIMITERS:
        counts = Counter(len(_split(line, delimiter)) for line in lines)
        width, count = max(counts.items(), key=lambda each: (each[0] > 1, each[1]))
        share = count / len(lines) if width > 1 else 0.0
        if share > best + 0.05:
            best, found = share, delimiter
    if best == 0.0 and len({len(line.split()) for line in lines[-10:]}) == 1 and len(lines[-1].split()) > 1:
        return " "
    return found


def _decimal_is_comma(cells: Sequence[str], delimiter: str) -> bool:
    if delimiter == ",":
        return False
    commas = sum(bool(_COMMA_NUMBER.fullmatch(cell) or _GROUPED[","].fullmatch(cell)) for cell in cells)
    return commas > sum(bool(_POINT_NUMBER.fullmatch(cell)) for cell in cells)


def _ungrouped(column: pd.Series[Any], decimal: str) -> pd.Series[Any]:
    """Numbers written with a sign between the thousands, as numbers."""
    if not pd.api.types.is_string_dtype(column.dtype) and column.dtype != object:
        return column
    text = column.dropna().astype(str).str.strip()
    grouped = text.str.fullmatch(_GROUPED[decimal])
    other = "." if decimal == "," else ","
    if (
        text.empty
        or not grouped.any()
        or not text.str.fullmatch(rf"[+-]?[\d{re.escape(other)}]*({re.escape(decimal)}\d*)?").all()
    ):
        return column
    plain = text.str.replace(other, "", regex=False).str.replace(decimal, ".", regex=False)
    return pd.to_numeric(plain).reindex(column.index)
