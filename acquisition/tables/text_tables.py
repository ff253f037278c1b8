"""Parses tables of text cells as loggers and spreadsheets write them.

The encoding, the delimiter, the decimal sign, lines before the header, a header of two rows and a row of units are
detected by the form of the lines and, of several rows of names, by the known names. Also read are lines that are no
plain columns: Expedition's pairs of number and value, RTKLIB's solutions, LabVIEW's segments, InfluxDB's tables.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, datetime, time
from functools import reduce
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core.errors import RECORD_A_LOG
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.tables import column_names, table_files, time_columns

MISSING_TEXTS = (
    "-", "--", "---", "----", "-----", "*", "**", "***", "****", "?", "??", "???", "n.a.", "N.A.", "n.v.", "k.A.",
    "N/V", "na", "nil", "NIL", "none", "NONE", "invalid", "INVALID", "Invalid", "missing", "no data", "No Data",
    "NODATA", "#NV", "#DIV/0!", "#WERT!", "#VALUE!", "#REF!", "#BEZUG!", "[]", "\\N", "INF/NAN",
)  # fmt: skip
"""What loggers and spreadsheets write for no value, besides what pandas recognises."""

_DELIMITERS = (";", "\t", "|", ",")
_PROBE_LINES = 60
_COMMENT, _BOM = "#%", "\ufeff"
_CODE_PAGES, _PROBE_LETTERS = ("cp1252", "cp932", "gb18030"), 4000
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_POINT_NUMBER = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?")
_GROUPED = {",": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d+)?"), ".": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d+)?")}
_WITH_UNIT = re.compile(r"([+-]?\d+(?:[.,]\d+)?)\s*([^\d\s.,+-][^\d.,]{0,8})")
_HEMISPHERES = frozenset("NSEWOnsewo")  # N is newton, too
_MINUS = re.compile("\u2212(?=[\\d.,])")  # of spreadsheets and browsers in Scandinavia
_SIDED = re.compile(r"([A-Za-z]*)\s*(\d+(?:[.,]\d+)?)\s*°?\s*([A-Za-z]*)")
_TO_PORT, _TO_STARBOARD = column_names.PORT | {"l"}, column_names.STARBOARD | {"r"}
_SENTENCE = re.compile(r"[$!][A-Z]{5},[^*]*\*[0-9A-Fa-f]{2}$")
_TO_WEST, _TO_EAST = frozenset({"w", "west"}), frozenset({"e", "east"})
_VALUE_LIKE = re.compile(  # a date, a time, a number with a unit, a hemisphere or a side
    r"\d{1,4}[-./:]\d{1,2}[-./:]\d{1,4}.*|\d{1,2}:\d{2}.*"
    r"|(?!0[.,]0*1\D)(?:[NSEWOPLR]|Bb|Stbd?)? ?[+-]?\d+(?:[.,]\d+|\s*°).{0,20}",  # 0.1° is a unit
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Layout:
    """The names, the rows of the header and of the first data, and the ``units`` of a row of units by name.

    ``header`` is None if no row has names: columns are then named by their positions.
    """

    names: tuple[str, ...]
    header: int | None
    first_data: int
    units: dict[str, str] = field(default_factory=dict)


def decode_text(content: bytes) -> str:
    """The text of a file: by its byte order mark, else UTF-8, else the code page of western Windows, Japan or China
    by which it holds most letters of known names."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16").replace(_BOM, "")
    for start, page in ((1, "utf-16-le"), (0, "utf-16-be")):
        if 2 * content[start:_PROBE_LETTERS:2].count(0) > min(len(content), _PROBE_LETTERS) // 2:
            return content.decode(page, errors="replace").replace(_BOM, "")
    try:
        return content.decode("utf-8").replace(_BOM, "")  # also inside, as in joined files
    except UnicodeDecodeError:
        texts = [content.decode(page, errors="replace") for page in _CODE_PAGES]
        return max(
            texts,
            key=lambda text: sum(letter in column_names.EAST_ASIAN_LETTERS for letter in text[:_PROBE_LETTERS]),
        )


def find_table_layout(rows: Sequence[Sequence[Any]]) -> Layout:
    """Names and units of a table by its first rows.

    The header is the row of names before the data with most known names, the last of several with as many. Names of
    the row above or below belong to it where they complete a known name: "Wind" above "Speed".
    """
    widths = [max((index for index, cell in enumerate(row, 1) if _is_filled(cell)), default=0) for row in rows]
    width = Counter(widths[-max(1, len(rows) // 2) :]).most_common(1)[0][0]
    first_data = len(rows)
    for number, row in enumerate(rows):
        cells = [cell for cell in row if _is_filled(cell)]
        values = sum(_is_number(cell) or bool(_VALUE_LIKE.fullmatch(cell.strip())) for cell in cells)
        if len(row) >= min(width, 2) and 3 * values >= len(cells) > 0 and width <= len(row) + 1:
            first_data = number
            break
    filled = [[cell for cell in row if _is_filled(cell)] for row in rows[:first_data]]
    candidates = [
        number for number, cells in enumerate(filled) if 2 * len(cells) >= width and not any(map(_is_number, cells))
    ]
    if not candidates and first_data < len(rows) and width > 1:
        return Layout(tuple(f"column {index + 1}" for index in range(width)), None, first_data)
    candidates = candidates or [0]
    unit_rows = [
        number
        for number in candidates[1:]
        if 3 * sum(column_names.is_unit_cell(str(cell)) for cell in filled[number]) >= 2 * len(filled[number])
    ]
    name_rows = [number for number in candidates if number not in unit_rows]
    header = max(
        name_rows, key=lambda number: (sum(map(_is_known_column_name, map(_cell_text, rows[number]))), number)
    )
    names = _complete_header_names(rows, header, name_rows)
    if names and names[0][:1] in _COMMENT:
        names[0] = names[0].lstrip(f"{_COMMENT} ")
    unit_row = next((rows[number] for number in unit_rows if number > header), [])
    texts = {index: str(cell).strip() for index, cell in enumerate(unit_row) if _is_filled(cell)}
    units = {names[index]: text for index, text in texts.items() if index < len(names) and text != "-"}
    return Layout(tuple(names), header, min(max(first_data, header + 1), len(rows)), units)


def _is_known_column_name(name: str) -> bool:
    return bool(name) and bool(column_names.match_quantities(column_names.split_header(name).name))


def _complete_header_names(rows: Sequence[Sequence[Any]], header: int, name_rows: Sequence[int]) -> list[str]:
    """The names of a header, with those of the row above or below where that completes a known name."""
    names = [_cell_text(cell) for cell in rows[header]]
    repeated = {name for name, count in Counter(names).items() if count > 1 and name}
    groups: Sequence[Any] = rows[header - 1] if header and (repeated or header - 1 in name_rows) else []
    if any(map(_is_number, filter(_is_filled, groups))):
        groups = []
    lower_row = rows[header + 1] if header + 1 in name_rows else []
    group = ""
    for index, name in enumerate(names):
        group = _cell_text(groups[index]) if index < len(groups) and _is_filled(groups[index]) else group
        suffix = _cell_text(lower_row[index]) if index < len(lower_row) else ""
        for full in (f"{group} {name}" if group else "", f"{name} {suffix}" if suffix else ""):
            if full and name and (_is_known_column_name(full) or name in repeated):
                names[index] = full
                break
    return names


def parse_text(path: Path, text: str, check_names: Callable[[list[str]], None]) -> table_files.RawTable:
    """The table in the lines of a file.

    ``check_names`` raises for duplicate names. Raises :class:`ValueError` naming the first row that is longer than
    the header.
    """
    head, text = split_labview_headers(_MINUS.sub("-", text))
    lines = list(islice((line.rstrip("\r\n") for line in _iterate_lines(text) if line.strip()), _PROBE_LINES))
    if sum(bool(_SENTENCE.search(line)) for line in lines) > len(lines) / 2:
        raise ValueError(f"its lines are sentences of NMEA 0183; {RECORD_A_LOG}")
    delimiter = _detect_delimiter(lines)
    rows = [_split_cells(line, delimiter) for line in lines]
    layout = find_table_layout(rows)
    check_names([name for name in layout.names if name])
    cells = [cell.strip() for row in rows[layout.first_data :] for cell in row]
    commas = sum(bool(_COMMA_NUMBER.fullmatch(cell) or _GROUPED[","].fullmatch(cell)) for cell in cells)
    points = sum(bool(_POINT_NUMBER.fullmatch(cell)) for cell in cells)
    decimal = "," if commas > points and delimiter != "," else "."
    start = _offset_of_row(text, layout.first_data)
    content, repeated, header, name = text[start:], 0, layout.header, layout.names[0]
    if header is not None and lines[header] in content:  # repeated, as in joined files, with the row of units
        data_lines = [(line, line.rstrip("\r\n")) for line in _iterate_lines(content)]
        heads = set(lines[header : layout.first_data])
        content = "".join(line for line, stripped in data_lines if stripped not in heads)
        repeated = sum(stripped == lines[header] for _, stripped in data_lines)

    first_line, width = text.count("\n", 0, start) + 1, len(layout.names)
    content, last = _drop_line_that_breaks_off(content, delimiter, width)
    if name and f"\n{name}" in content:
        for number, line in enumerate(_iterate_lines(content), start=first_line):
            if line.startswith(name) and _cell_text(_split_cells(line.rstrip("\r\n"), delimiter)[0]) == name:
                raise ValueError(f"in line {number} another table begins, {line.strip()!r}; save the two apart")
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut
        try:
            frame = pd.read_csv(
                io.BytesIO(content.encode()), sep=r"\s+" if delimiter == " " else delimiter, decimal=decimal,
                header=None, names=_column_labels(layout.names), skipinitialspace=True, low_memory=False,
                index_col=False, na_values=list(MISSING_TEXTS),
            )  # fmt: skip
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            for number, line in enumerate(_iterate_lines(text[start:]), start=first_line):
                if line.strip() and (count := len(_split_cells(line.rstrip("\r\n"), delimiter))) > width:
                    raise ValueError(f"line {number} has {count} cells, the header {width}") from error
            what = "its lines cannot be divided into cells; is a quotation mark missing?"
            raise ValueError(what) from error
    frame = frame.apply(lambda column: _parse_grouped_numbers(column, decimal))
    raw = _raw_table(path, frame, layout, (*head, *lines[: header or 0]), repeated, decimal)
    return (
        replace(raw, remarks=(*raw.remarks, f"the last line breaks off, {last!r}: it is left out")) if last else raw
    )


def _drop_line_that_breaks_off(content: str, delimiter: str, width: int) -> tuple[str, str]:
    """The lines without a last one that has no end and too few cells, as of a logger that was cut off; and that."""
    start = content.rfind("\n") + 1
    last = content[start:]
    breaks_off = start > 0 and last.strip() and delimiter != " " and len(_split_cells(last, delimiter)) < width
    return (content[:start], last.strip()) if breaks_off else (content, "")


def parse_sheet_rows(path: Path, rows: Sequence[Sequence[Any]]) -> table_files.RawTable:
    """The table in a spreadsheet's rows, whose cells have types."""

    def value_of(cell: Any) -> Any:
        if isinstance(cell, str):
            text = cell.strip()
            return None if not text or text in MISSING_TEXTS else text
        return cell.isoformat() if isinstance(cell, datetime | date | time) else cell

    rows = [row for row in rows if any(_is_filled(cell) for cell in row)]
    if not rows:
        return table_files.RawTable(path, pd.DataFrame())
    layout = find_table_layout(rows[:_PROBE_LINES])
    header = [] if layout.header is None else [_cell_text(cell) for cell in rows[layout.header]]
    body = [row for row in rows[layout.first_data :] if not header or [_cell_text(cell) for cell in row] != header]
    repeated = len(rows) - layout.first_data - len(body)
    frame = pd.DataFrame(body, columns=_column_labels(layout.names, max(map(len, body), default=len(header))))
    frame = frame.map(value_of).dropna(how="all").infer_objects().reset_index(drop=True)
    preamble = tuple(" ".join(str(cell) for cell in row if _is_filled(cell)) for row in rows[: layout.header or 0])
    return _raw_table(path, frame, layout, preamble, repeated, ".")


def _raw_table(
    path: Path, frame: pd.DataFrame, layout: Layout, preamble: tuple[str, ...], repeated: int, decimal: str
) -> table_files.RawTable:
    """The table of cells, without columns that have neither a name nor a value.

    Where all cells of a column end in the same unit, or name a side, they become numbers.
    """
    empty = [name for name in map(str, frame) if name.startswith("Unnamed:") and frame[name].isna().all()]
    frame, units, sided = frame.drop(columns=empty), dict(layout.units), list[str]()
    for name in map(str, frame):
        text = frame[name].dropna()
        is_variation = column_names.quantity_of_header(name) == "magnetic_variation_deg"
        if (numbers := _parse_sides(text, decimal, is_variation=is_variation)) is not None:
            negative = "to the west" if is_variation else "to port"
            sided.append(f"{name!r} names sides, like {text.iloc[0]}: {negative} is negative")
            frame = frame.assign(**{name: numbers.reindex(frame.index)})
            continue
        example = _WITH_UNIT.fullmatch(str(text.iloc[0]).strip()) if len(text) else None
        if example is None or example[2] in _HEMISPHERES or not column_names.parse_units(example[2]):
            continue
        parts = text.astype(str).str.strip().str.extract(f"^{_WITH_UNIT.pattern}$")
        if (parts[1] == example[2]).all():
            numbers = pd.to_numeric(parts[0].str.replace(decimal, ".", regex=False))
            frame, units[name] = frame.assign(**{name: numbers.reindex(frame.index)}), example[2]
    remarks = [f"the header is repeated {repeated} times among the rows"] if repeated else []
    remarks += sided
    return table_files.RawTable(path, frame, Trial(), units, {}, preamble, tuple(remarks), layout.header is None)


def _parse_sides(text: pd.Series[Any], decimal: str, *, is_variation: bool) -> pd.Series[Any] | None:
    """Cells such as ``12 S``, ``P5`` and ``3.5° Bb`` as numbers, to port negative; None for any others.

    One at least names port, and one does not: a letter S alone may be the south, an l a litre. Those of a variation
    name east or west.
    """
    if text.empty or pd.api.types.is_numeric_dtype(text.dtype) or not _SIDED.fullmatch(str(text.iloc[0]).strip()):
        return None
    parts = text.astype(str).str.strip().str.extract(f"^{_SIDED.pattern}$")
    words = (parts[0] + parts[2]).str.lower()
    numbers = pd.to_numeric(parts[1].str.replace(decimal, ".", regex=False), errors="coerce")
    negative, positive = (_TO_WEST, _TO_EAST) if is_variation else (_TO_PORT, _TO_STARBOARD)
    to_port, elsewhere = words.isin(negative), words.isin(positive) | ((words == "") & (numbers == 0.0))
    if not ((is_variation or (to_port.any() and elsewhere.any())) and (to_port | elsewhere).all()):
        return None
    return numbers.where(~to_port, -numbers)


def _offset_of_row(text: str, rows: int) -> int:
    """The offset in the text at which a row begins, counted without empty lines."""
    offset = 0
    for line in _iterate_lines(text):
        if line.strip():
            if rows == 0:
                return offset
            rows -= 1
        offset += len(line)
    return offset


def _iterate_lines(text: str) -> Iterator[str]:
    """The lines with their ends, one at a time: a text stream would take four bytes for each letter of the text."""
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def _column_labels(names: Sequence[str], width: int = 0) -> list[str]:
    """The names of the columns, as pandas names those without one."""
    return [name or f"Unnamed: {index}" for index, name in enumerate([*names, *[""] * (width - len(names))])]


def _cell_text(cell: Any) -> str:
    return " ".join(str(cell).split()) if _is_filled(cell) else ""


def _is_filled(cell: Any) -> bool:
    return cell is not None and bool(str(cell).strip())


def _is_number(cell: Any) -> bool:
    return not isinstance(cell, str) or bool(_NUMBER.fullmatch(cell.strip()))


def _split_cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))


def _detect_delimiter(lines: Sequence[str]) -> str:
    """What divides most lines into the same number of cells; the first of several equal ones."""
    largest, likeliest = 0.0, ","
    for delimiter in _DELIMITERS:
        counts = Counter(len(_split_cells(line, delimiter)) for line in lines)
        width, count = max(counts.items(), key=lambda entry: (entry[0] > 1, entry[1]))
        fraction = count / len(lines) if width > 1 else 0.0
        if fraction > largest + 0.05:
            largest, likeliest = fraction, delimiter
    if largest == 0.0 and len({len(line.split()) for line in lines[-10:]}) == 1 and len(lines[-1].split()) > 1:
        return " "
    return likeliest


def _parse_grouped_numbers(column: pd.Series[Any], decimal: str) -> pd.Series[Any]:
    """Numbers written with a separator of thousands, as numbers."""
    if not pd.api.types.is_string_dtype(column.dtype) and column.dtype != object:
        return column
    text = column.dropna().astype(str).str.strip()
    grouped = text.str.fullmatch(_GROUPED[decimal])
    separator = "." if decimal == "," else ","
    if (
        text.empty
        or not grouped.any()
        or not text.str.fullmatch(rf"[+-]?[\d{re.escape(separator)}]*({re.escape(decimal)}\d*)?").all()
    ):
        return column
    numbers = text.str.replace(separator, "", regex=False).str.replace(decimal, ".", regex=False)
    return pd.to_numeric(numbers).reindex(column.index)


_EXPEDITION = re.compile(r"!boat\s*,", re.IGNORECASE)
_IN_KNOTS = ("BSP", "SOG", "AWS", "TWS", "VMG", "VMC", "Targ Bsp", "Pol Bsp")
CAN_HEADS = (
    {"id", "len", "d1"}, {"id", "dlc", "d0"}, {"id", "length", "data"}, {"id", "dlc", "data"}, {"can id", "data"},
    {"arbitration id", "data"}, {"arbitration_id", "data"},
)  # fmt: skip
"""Columns of tables of CAN frames by SavvyCAN, python-can and other programs."""
_RTKLIB = re.compile(r"^%\s*(GPST|UTC|JST)[ ,;\t]+(.*\bQ\b.*)$", re.MULTILINE)
_RTKLIB_CELLS = re.compile(r"[,;\t ]+")
_RTKLIB_SEXAGESIMAL = "(d'\")"
_RTKLIB_QUALITY = ("no solution", "fixed", "float", "SBAS", "DGPS", "single", "PPP")
_END_OF_HEAD = "***End_of_Header***"
_FIRST_NUMBER = re.compile(r"\s*-?\d+(?:([.,])\d*)?(?:[eE][+-]?\d+)?")


def parse_expedition_log(path: Path, text: str) -> table_files.RawTable | None:
    """The table of Expedition's boat 0, by the two header lines that name the numbers; None for any other text.

    Lines are of a boat's number, a time, and pairs of number and value. Raises :class:`ValueError` naming the first
    line that is not of pairs.
    """
    if not _EXPEDITION.match(text):
        return None
    lines = [line.strip().rstrip(",") for line in text.splitlines()]
    heads = [line.lstrip("!").split(",") for line in lines if line.startswith("!") and not line.startswith("!v")]
    if len(heads) < 2:
        raise ValueError("this log of Expedition has no line !boat,0,1 ... with the numbers of its names")
    name_by_number = dict(zip(heads[1][1:], [name.strip() for name in heads[0][1:]], strict=False))
    rows = []
    for line_number, line in enumerate(lines, start=1):
        if not line or line.startswith("!"):
            continue
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) % 2:
            raise ValueError(
                f"line {line_number} of this log of Expedition is not of pairs of a number and a value"
            )
        if cells[0] == "0":
            pairs = zip(cells[2::2], cells[3::2], strict=True)
            values = {name_by_number.get(number, f"number {number}"): value for number, value in pairs}
            rows.append({name_by_number.get("0", "Utc"): cells[1]} | values)
    frame = pd.DataFrame(rows)
    for name, column in frame.items():
        numbers = pd.to_numeric(column, errors="coerce")
        if numbers.notna().sum() == column.notna().sum():
            frame[name] = numbers
    return table_files.RawTable(path, frame, units={name: "kn" for name in _IN_KNOTS if name in frame})


def parse_rtklib_solution(path: Path, text: str) -> table_files.RawTable | None:
    """The table of RTKLIB's solutions (.pos), with a remark on their numbers by quality; None for any other text.

    The time, of a date and a clock or of a week and seconds, keeps the name of its system. Coordinates in degrees,
    minutes and seconds or from the earth's centre become degrees, those of a baseline east and north of its base.
    Raises :class:`ValueError` naming the first line with more or fewer cells than the header.
    """
    head = _RTKLIB.search(text) if text.startswith("%") else None
    if head is None:
        return None
    system, names = head[1], _RTKLIB_CELLS.split(head[2].strip())
    widths = [3 if _RTKLIB_SEXAGESIMAL in name else 1 for name in names]
    rows = []
    for line_number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("%"):
            continue
        cells = _RTKLIB_CELLS.split(line.strip())
        if len(cells) != 2 + sum(widths):
            raise ValueError(f"line {line_number} has {len(cells)} cells, the header {2 + sum(widths)}")
        rows.append(cells)
    table = np.array(rows, dtype=object).reshape(-1, 2 + sum(widths))
    if len(table) and "/" in table[0, 0]:
        frame = pd.DataFrame({f"time {system}": [f"{date} {clock}" for date, clock in table[:, :2]]})
    elif system == "GPST":
        weeks, seconds = table[:, :2].astype(float).T
        frame = pd.DataFrame({"GPS week": weeks, "time of week (s)": seconds})
    else:
        raise ValueError(f"its weeks and seconds are in {system}; write them in GPST, or as dates")
    place = 2
    for name, width in zip(names, widths, strict=True):
        values = table[:, place : place + width].astype(float)
        if width > 1:  # degrees, which alone have the sign, minutes and seconds
            degrees = np.copysign(np.abs(values) @ (1.0, 1.0 / 60.0, 1.0 / 3600.0), values[:, 0])
            frame[name.replace(_RTKLIB_SEXAGESIMAL, "(deg)")] = degrees
        else:
            frame[name] = values[:, 0]
        place += width
    remarks = []
    for quality, count in zip(*np.unique(frame["Q"].to_numpy(dtype=int), return_counts=True), strict=True):
        is_known = quality < len(_RTKLIB_QUALITY)
        remarks.append(f"{count:,} {_RTKLIB_QUALITY[quality] if is_known else f'of quality {quality}'}")
    axes = [f"{axis}-ecef(m)" for axis in "xyz"]
    if set(axes) <= set(frame):
        coordinates = pymap3d.ecef2geodetic(*(frame[axis].to_numpy() for axis in axes))
        geodetic = dict(zip(("latitude(deg)", "longitude(deg)", "height(m)"), coordinates, strict=True))
        frame = frame.drop(columns=axes).assign(**geodetic)
    else:
        baseline = {"e-baseline(m)": "east(m)", "n-baseline(m)": "north(m)", "u-baseline(m)": "up(m)"}
        frame = frame.rename(columns=baseline)
    return table_files.RawTable(path, frame, remarks=(f"solutions of RTKLIB: {', '.join(remarks)}",))


def split_labview_headers(text: str) -> tuple[list[str], str]:
    """The lines of the file's and the first segment's header of a LabVIEW measurement, and the rows; other texts as
    they are.

    Segments have headers and times, in the first cell, from their own start; the times are counted from the start
    of the first. Raises :class:`ValueError` for a segment without a start, or with other columns.
    """
    if not text.startswith("LabVIEW Measurement"):
        return [], text
    file_head, *parts = text.split(_END_OF_HEAD)
    if not parts[1:]:
        return file_head.splitlines(), "".join(part.partition("\n")[2] for part in parts)
    heads, bodies = [parts[0].partition("\n")[2]], list[str]()
    for part in parts[1:-1]:
        rows = part.partition("\n")[2]
        next_head = re.search(r"^Channels\b", rows, re.MULTILINE)  # begins with the number of channels
        if next_head is None:
            raise ValueError("a segment of this LabVIEW measurement has no line Channels")
        bodies.append(rows[: next_head.start()])
        heads.append(rows[next_head.start() :])
    bodies.append(parts[-1].partition("\n")[2])

    first_head = [*file_head.splitlines(), *heads[0].splitlines()]
    first_start, lines = pd.Timestamp(time_columns.start_time_in_preamble(first_head) or "NaT"), [bodies[0]]
    first_names = bodies[0].lstrip("\n\r\t ").partition("\n")[0].strip()
    for number, (head, body) in enumerate(zip(heads[1:], bodies[1:], strict=True), start=2):
        start = pd.Timestamp(time_columns.start_time_in_preamble(head.splitlines()) or "NaT")
        delay_s = (start - first_start).total_seconds()
        if np.isnan(delay_s):
            raise ValueError(f"segment {number} of this LabVIEW measurement, or the first, states no start")
        names, _, rows = body.lstrip("\n\r\t ").partition("\n")
        if names.strip() != first_names:
            raise ValueError(f"segment {number} of this LabVIEW measurement has other columns: {names.strip()!r}")
        for line in rows.splitlines(keepends=True):
            if cell := _FIRST_NUMBER.match(line):
                seconds = f"{float(cell[0].replace(',', '.')) + delay_s:.9f}"
                line = seconds.replace(".", cell[1] or ".") + line[cell.end() :]
            lines.append(line)
    return first_head, "".join(lines)


_INFLUX_HEAD = re.compile(r"#(?:group|datatype|default),")
_INFLUX_OWN = frozenset(["result", "table", "_start", "_stop", "_time", "_value", "_field"])


def parse_influx_csv(path: Path, text: str) -> table_files.RawTable | None:
    """The values in InfluxDB's annotated CSV, a row each; None for any other text.

    A variable is called by its field and by what else tells it from the others: measurement and tags. Fields that a
    query has pivoted to columns are left as they are.
    """
    if not _INFLUX_HEAD.match(text):
        return None
    blocks = [
        [line for line in block.splitlines() if line and not line.startswith("#")]
        for block in re.split(r"(?:\r?\n[ \t]*){2,}", text.strip())
    ]
    tables = [pd.read_csv(io.StringIO("\n".join(lines)), low_memory=False) for lines in blocks if len(lines) > 1]
    frame = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    frame = frame.loc[:, [name for name in map(str, frame) if not name.startswith("Unnamed:")]]
    if not {"_time", "_value", "_field"} <= set(frame):
        return table_files.RawTable(path, frame.rename(columns={"_time": "time"}))
    tags = [name for name in frame if name not in _INFLUX_OWN and (frame[name] != frame[name].iloc[0]).any()]
    words = [frame[name].fillna("").astype(str) for name in [*tags, "_field"]]
    variable = reduce(lambda names, word: names + " " + word, words).str.strip()
    return table_files.RawTable(
        path, pd.DataFrame({"timestamp": frame["_time"], "variable": variable, "value": frame["_value"]})
    )
