"""Reads table files into raw columns: text, spreadsheets, Parquet, GPX, MATLAB, Simulink and NetCDF.

Rows keep their order and their number. What cannot be read is one :class:`InputError` that says where.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import files, process, quantities
from seatrial.acquisition.core.errors import RECORD_A_LOG, InputError
from seatrial.acquisition.core.times import DAY_NS, names_tai, zone_offset_s
from seatrial.acquisition.core.trial import NANO, Trial
from seatrial.acquisition.tables.foreign_reader import CALENDARS, DAMAGED, GROUPS

OPENERS: dict[str, Callable[[Path], Any]] = {
    "": lambda path: path.open("rb"),
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
}
"""How a text file or a log is opened, by the suffix after that of its kind."""
FOREIGN_READER = Path(__file__).with_name("foreign_reader.py")
_TEXT = (".csv", ".tsv", ".tab", ".txt", ".asc", ".dat", ".lvm", ".pos")

_VECTOR_LOG = re.compile(r"\ufeff?\s*(?:date\s[^\n]*\n\s*)?base\s+(?:hex|dec)\b", re.IGNORECASE)
_NAIVE_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?")
UTC_COLUMN, ABOUT_COLUMNS = "time [UTC]", ["what", "name", "value"]
"""The column of times of our own workbooks, and the columns of their sheet ``about``."""


@dataclass(frozen=True, slots=True)
class RawTable:
    """The columns of a file under their names there, and the trial if the file describes one.

    ``units`` are those that the file states besides the names, by column, ``meanings`` its descriptions of columns,
    ``preamble`` the lines before the names, ``remarks`` on how it was read. A table without a row of names
    ``is_nameless``. The times of a log are read already: by the ``time_answers``, which are None for a table, and
    ``questions`` are those that they leave open.
    """

    path: Path
    columns: pd.DataFrame
    trial: Trial = field(default_factory=Trial)
    units: dict[str, str] = field(default_factory=dict)
    meanings: dict[str, str] = field(default_factory=dict)
    preamble: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    is_nameless: bool = False
    questions: tuple[Any, ...] = ()
    time_answers: Mapping[str, str] | None = None

    @property
    def name(self) -> str:
        """The file's name without its suffixes."""
        return self.path.name.removesuffix("".join(kind_and_compression_suffix(self.path)))

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return list(map(str, self.columns.columns))


@dataclass(slots=True)
class TableFile:
    """A table file in the contract's columns and units.

    ``table`` has a UTC index in the file's order; ``sources`` states the origin of each column, "assumed" for a
    constant of the map; ``passed_over`` are the file's unused columns, ``dropped`` counts the rows that a map
    dropped, by the reason; ``remarks`` are on its times.
    """

    table: pd.DataFrame
    trial: Trial
    sources: dict[str, str] = field(default_factory=dict)
    passed_over: tuple[str, ...] = ()
    dropped: dict[str, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def add(self, channels: Mapping[str, quantities.Floats | float], source: str) -> None:
        """Add columns of the same origin."""
        for name, values in channels.items():
            self.table[name] = values
            self.sources[name] = source

    @property
    def assumed(self) -> dict[str, float]:
        """The channels that are a constant of the map, with its value in the channel's unit."""
        return {
            name: float(self.table[name].iloc[0]) for name, source in self.sources.items() if source == "assumed"
        }


def read_raw_table(path: Path | str) -> RawTable:
    """The table as it is in the file. Raises :class:`InputError` for anything that is no table with rows."""
    path = Path(path)
    suffix, compression = kind_and_compression_suffix(path)
    is_text = suffix.lower() in _TEXT
    if not path.is_file():
        raise InputError("is no file", where=str(path), fix="check the path")
    if suffix.lower() not in _READERS or compression.lower() not in OPENERS or (compression and not is_text):
        raise InputError(
            "cannot be imported: unknown file type", where=str(path),
            fix=f"give .csv or .tsv, compressed with {', '.join(filter(None, OPENERS))}, .xlsx, .parquet,"
            " .mat, .nc, .gpx, or a log: .mcap, .bag, .db3, .ulg, .bin, .log of ArduPilot, .mf4, .tdms, .h5, .npz,"
            f" .jsonl, .sqlite; {RECORD_A_LOG}",
        )  # fmt: skip
    if path.stat().st_size == 0:
        raise InputError("is empty", where=str(path), fix="give a table with data")
    try:
        raw = _READERS[suffix.lower()](path)
    except InputError:
        raise
    except Exception as error:  # a damaged file makes scipy and pyarrow fail in every possible way
        why = str(error) if type(error) is ValueError and is_text else DAMAGED
        raise InputError(f"is not a readable {suffix} table", where=str(path), why=why) from error
    process.TABLE_COLUMNS.require_within_budget(len(raw.columns.columns), path, path.stat().st_size)
    if raw.columns.empty:
        raise InputError("has no rows", where=str(path), fix="give a table with data")
    return raw


def kind_and_compression_suffix(path: Path) -> tuple[str, str]:
    """The suffix of a file's kind, such as ``.csv``, and that of its compression, such as ``.gz``, or nothing."""
    compression = path.suffix if path.suffix.lower() in OPENERS else ""
    return Path(path.name.removesuffix(compression)).suffix, compression


def _read_text(path: Path) -> RawTable:
    """Cells between commas, semicolons, tabs, bars or blanks, with a decimal point or comma.

    Raises :class:`InputError` for more than the budget, or too long a line.
    """
    from seatrial.acquisition.tables import text_tables

    meter = process.Meter(path, path.stat().st_size)
    blocks, line_bytes = list[bytes](), 0
    with OPENERS[kind_and_compression_suffix(path)[1].lower()](path) as stream:
        while block := stream.read(process.TEXT_BYTES.least):
            meter.add(process.TABLE_TEXT_BYTES, len(block))
            line_end = block.find(b"\n")
            meter.check(process.TEXT_BYTES, line_bytes + (len(block) if line_end < 0 else line_end))
            line_bytes = line_bytes + len(block) if line_end < 0 else len(block) - 1 - block.rfind(b"\n")
            blocks.append(block)
    text = text_tables.decode_text(b"".join(blocks))
    if "\0" in text:
        raise InputError("is no text", where=str(path), why="it contains zero bytes", fix="save it as CSV in UTF-8")

    def check_names(names: list[str]) -> None:
        refuse_duplicate_names(names, path)
        meter.check(process.TABLE_COLUMNS, len(names))
        meter.check(process.TABLE_CELLS, len(names) * text.count("\n"))

    if _VECTOR_LOG.match(text):
        raise _frames_error(path)
    readers = (text_tables.parse_expedition_log, text_tables.parse_rtklib_solution, text_tables.parse_influx_csv)
    special = next((raw for read in readers if (raw := read(path, text)) is not None), None)
    if special is not None:
        return special
    raw = text_tables.parse_text(path, text, check_names)
    lower_names = {name.strip().lower() for name in raw.names}
    if any(head <= lower_names for head in text_tables.CAN_HEADS):
        raise _frames_error(path)
    try:  # the trial that our exports write into a file beside the table
        return replace(raw, trial=parse_trial(files.read_json(path.with_name(f"{path.name}.json"))["trial"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return raw


def _frames_error(path: Path) -> InputError:
    fix = 'read it as a log: `seatrial record` with [[source]] type = "file" and its path'
    return InputError("holds frames of a CAN bus, not columns of values", where=str(path), fix=fix)


def _read_sheet(path: Path) -> RawTable:
    """The sheet with most filled rows; in our exports time and trial are restored as they were written."""
    from seatrial.acquisition.tables import text_tables

    require_package("python_calamine", "excel", path)
    sheets = process.read_in_child(FOREIGN_READER, "sheets", path)
    about = sheets.get("about", [])
    is_export = "data" in sheets and about[:1] == [ABOUT_COLUMNS]
    sizes = {name: sum(any(cell != "" for cell in row) for row in sheet) for name, sheet in sheets.items()}
    fullest = max(sizes, key=sizes.__getitem__, default="")
    raw = text_tables.parse_sheet_rows(path, sheets.get("data" if is_export else fullest, []))
    frame = raw.columns
    if is_export and UTC_COLUMN in frame and "time" not in frame:  # a user may have changed it since
        times = [f"{cell}Z" if _NAIVE_TIME.fullmatch(str(cell)) else cell for cell in frame[UTC_COLUMN]]
        frame = frame.assign(**{UTC_COLUMN: times}).rename(columns={UTC_COLUMN: "time"})
    refuse_duplicate_names(list(frame.columns), path)
    entries = {name: value for what, name, value in about if what == "trial"} if is_export else {}
    return replace(raw, columns=frame, trial=parse_trial(entries))


def _read_gpx(path: Path) -> RawTable:
    """The points of all tracks, with their time and further elements such as speed and course."""
    from xml.etree import ElementTree as ET

    def value_of(element: Any) -> float | str:
        try:
            return float(element.text)
        except ValueError:
            return str(element.text).strip()

    meter, rows, names = process.Meter(path, path.stat().st_size), list[dict[str, Any]](), set[str]()
    parents, track_of_row, tracks = list[Any](), list[int](), 0
    for event, element in ET.iterparse(path, ("start", "end")):
        if event == "start":
            parents.append(element)
            meter.check(process.XML_DEPTH, len(parents))
            tracks += _local_tag(element) in ("trk", "rte")
            continue
        parents.pop()
        if _local_tag(element) in ("trkpt", "rtept"):
            items = (item for item in element.iter() if item is not element and (item.text or "").strip())
            position = {"lat": float(element.get("lat", "nan")), "lon": float(element.get("lon", "nan"))}
            track_of_row.append(tracks)
            rows.append(position | {_local_tag(item): value_of(item) for item in items})
            meter.add(process.TABLE_CELLS, len(rows[-1]))
            names.update(rows[-1])
            meter.check(process.TABLE_COLUMNS, len(names))
        if parents and not any(_local_tag(parent) in ("trkpt", "rtept") for parent in parents):
            parents[-1].remove(element)  # frees its memory
    frame = pd.DataFrame(rows)
    _refuse_simultaneous_tracks(path, frame, track_of_row)
    units = {"lat": "deg", "lon": "deg", "ele": "m", "speed": "m/s", "course": "deg"}
    return RawTable(path, frame, units=units, meanings={"course": "course over ground"})


def _refuse_simultaneous_tracks(path: Path, points: pd.DataFrame, track_of_row: list[int]) -> None:
    """Raise :class:`InputError` for tracks of the same time: of two ships, or of one by two receivers."""
    if "time" not in points or len({*track_of_row}) < 2:
        return
    times = pd.to_datetime(points["time"], format="ISO8601", errors="coerce", utc=True)
    spans = times.groupby(track_of_row).agg(["min", "max"]).dropna().sort_values("min")
    if (spans["min"].iloc[1:].to_numpy() < spans["max"].iloc[:-1].to_numpy()).any():
        raise InputError(
            f"has {len(spans)} tracks, of which some are of the same time", where=str(path),
            why="they are of several ships or receivers", fix="leave one track of a time in the file",
        )  # fmt: skip


def _local_tag(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]


def require_package(module: str, extra: str, path: Path) -> None:
    """Raise :class:`InputError` if a module is missing that only some kinds of files need."""
    if find_spec(module) is None:
        what, where = f"needs the package {module.replace('_', '-')} to be read", str(path)
        raise InputError(what, where=where, fix=f"pip install 'seatrial[{extra}]', or save it as CSV")


def refuse_duplicate_names(names: list[str], path: Path) -> None:
    """Raise :class:`InputError` for columns of the same name."""
    if duplicates := [name for name, count in Counter(names).items() if count > 1]:
        what = f"has more than one column {', '.join(map(repr, duplicates))}"
        raise InputError(what, where=str(path), fix="rename one of them")


def _read_parquet(path: Path) -> RawTable:
    """A time index becomes the column ``time``; the trial is in the metadata of our exports."""
    arrow = process.read_in_child(FOREIGN_READER, "parquet", path)
    frame = arrow.to_pandas()
    if isinstance(frame.index, pd.DatetimeIndex) and "time" not in frame:
        frame = frame.rename_axis("time").reset_index()
    frame.columns = pd.Index([str(name).strip() for name in frame.columns])
    refuse_duplicate_names(list(frame.columns), path)
    metadata = (arrow.schema.metadata or {}).get(b"seatrial.trial")
    durations = [str(name) for name, column in frame.items() if column.dtype.kind == "m"]
    frame = frame.assign(**{name: frame[name] / pd.Timedelta(1, "ns") for name in durations})
    trial = parse_trial(files.parse_json(metadata)) if metadata else Trial()
    return RawTable(path, frame, trial, units=dict.fromkeys(durations, "ns"))


def parse_trial(values: Mapping[str, Any]) -> Trial:
    """The trial by a file's entries, as text; without those that are not known."""
    texts = {str(key): str(value) for key, value in values.items() if value is not None and np.size(value)}
    if "name" in texts:
        texts["trial"] = texts.pop("name")
    return Trial.from_metadata(texts)


def non_numeric_cells(column: pd.Series[Any]) -> quantities.Bools:
    """Which cells of a column are neither empty nor a number."""
    values = pd.to_numeric(column, errors="coerce")
    return np.asarray(values.isna().to_numpy() & column.notna().to_numpy())


def parse_numbers(raw: RawTable, name: str) -> quantities.Floats:
    """A column as numbers, empty cells as NaN. Raises :class:`InputError` naming the first cell that is none."""
    column = raw.columns[name]
    values = pd.to_numeric(column, errors="coerce")
    invalid = np.flatnonzero(non_numeric_cells(column))
    if invalid.size:
        what = f"row {invalid[0] + 1} of column {name!r} is not a number: {column.iloc[invalid[0]]!r}"
        why = f"{invalid.size} cells of the column are not numbers"
        raise InputError(what, where=str(raw.path), why=why, fix="write missing values as empty cells")
    return values.to_numpy(dtype=float)


_HDF5, _USER_BLOCK_BYTES = b"\x89HDF", 512
_GPS_EPOCH = pd.Timestamp("1980-01-06")
_SINCE = re.compile(r"(\w+) since (.+)", re.IGNORECASE)
_MOMENT = re.compile(
    r"(?P<moment>(?:\d{4}(?:-\d{1,2}(?:-\d{1,2})?)?|\d{4}/\d{1,2}/\d{1,2}|\d{8}|\d{1,2}[- ][A-Za-z]{3}[- ]\d{4})"
    r"(?:(?:T|\s+)(?:\d{6}|\d{1,2}(?::\d{1,2}(?::\d{1,2}(?:\.\d*)?)?)?))?)\s*(?:0?0:00|(?P<zone>[^\s\d]\S*))?",
    re.ASCII,
)
"""A moment whose year is plain, and its zone: 05-06-2026 and 1-1-1 may be of several dates."""
COUNTS_NS = {
    **dict.fromkeys(("nanoseconds", "nanosecond", "nanosec", "ns"), 1),
    **dict.fromkeys(("microseconds", "microsecond", "microsec", "us"), 1000),
    **dict.fromkeys(("milliseconds", "millisecond", "millisec", "msec", "ms"), 1_000_000),
    **dict.fromkeys(("seconds", "second", "secs", "sec", "s"), NANO),
    **dict.fromkeys(("minutes", "minute", "mins", "min"), 60 * NANO),
    **dict.fromkeys(("hours", "hour", "hrs", "hr", "h"), 3600 * NANO),
    **dict.fromkeys(("days", "day", "d"), DAY_NS),
}
"""Units in which times are counted since a moment, as UDUNITS spells them [ns]."""
_UNEVEN = ("months", "month", "years", "year", "common_years", "common_year", "weeks", "week", "fortnights")
"""Units of times that are of no one length, or rare."""
_GREGORIAN = pd.Timestamp("1582-10-15")  # before, the usual calendar of CF-1.11 is the Julian one
_TIME_ATTRIBUTES = {"units": "", "calendar": CALENDARS[0]}
_TIME_NAMES = ("time", "Time", "TIME", "obs_time", "datetime", "t")


def read_mat(path: Path) -> RawTable:
    """Vectors of one length, at the top or in the single struct with vectors, or Simulink's structures with time.

    The structs ``units`` and ``trial`` of our exports are read. Vectors of different lengths are an error, as it is
    unknown which is wrong.
    """
    if _is_hdf5(path):
        require_package("h5py", "hdf5", path)
    loaded: dict[str, Any] = process.read_in_child(FOREIGN_READER, "mat", path)
    content = {key: value for key, value in loaded.items() if not key.startswith(("__", "#"))}
    trial, units = content.pop("trial", {}), content.pop("units", None)
    if trial and isinstance(trial, dict) and not _vectors_in_mat_file(content):  # another's struct of this name
        content["trial"], trial = trial, {}
    vectors = _vectors_in_mat_file(content) or _simulink_signals(content)
    if not vectors:
        structs = (
            _vectors_in_mat_file(_flatten_struct(value)) for value in content.values() if isinstance(value, dict)
        )
        candidates = list(filter(None, structs))
        if len(candidates) != 1:
            what = "holds no vectors" if not candidates else f"holds {len(candidates)} structs of vectors"
            raise InputError(what, where=str(path), fix="save one struct of vectors, or the vectors themselves")
        vectors = candidates[0]
    length = Counter(len(vector) for vector in vectors.values()).most_common(1)[0][0]
    if unequal := [f"{name} ({len(vector)})" for name, vector in vectors.items() if len(vector) != length]:
        what = f"holds vectors that are not {length} long: {', '.join(unequal)}"
        raise InputError(what, where=str(path), fix="leave them out")
    stated_units = {str(name): str(unit) for name, unit in units.items()} if isinstance(units, dict) else {}
    stated_trial = parse_trial(trial) if isinstance(trial, dict) else Trial()
    return RawTable(path, pd.DataFrame(vectors), stated_trial, stated_units)


def _flatten_struct(struct: Mapping[str, Any], stem: str = "") -> dict[str, Any]:
    """The fields of a struct and of the structs in it, their names joined by a point."""
    result: dict[str, Any] = {}
    for name, value in struct.items():
        result |= _flatten_struct(value, f"{stem}{name}.") if isinstance(value, dict) else {f"{stem}{name}": value}
    return result


def _simulink_signals(content: Mapping[str, Any]) -> dict[str, quantities.AnyArray]:
    """The signals that the blocks "To Workspace" and "Scope" save as structures with ``time``, ``signals.values``.

    A signal is named by its label, else by the variable; the times are those of the first structure.
    """
    series: dict[str, quantities.AnyArray] = {}
    for variable, struct in content.items():
        if not (isinstance(struct, dict) and {"time", "signals"} <= set(struct)):
            continue
        series.setdefault("time", np.atleast_1d(struct["time"]))
        signals = struct["signals"] if isinstance(struct["signals"], list | np.ndarray) else [struct["signals"]]
        for number, signal in enumerate(signals):
            values, label = np.asarray(signal["values"]), str(np.squeeze(signal.get("label", "")) or "")
            name = (
                label if label and label != "[]" else variable if len(signals) == 1 else f"{variable}.{number + 1}"
            )
            columns = values if values.ndim == 2 else values[:, np.newaxis]
            for index in range(columns.shape[1]):
                series[name if columns.shape[1] == 1 else f"{name}.{index + 1}"] = columns[:, index]
    return series


def _vectors_in_mat_file(content: Mapping[str, Any]) -> dict[str, quantities.AnyArray]:
    """The numeric and text vectors among a file's variables; a single number is a vector of one."""
    vectors = {}
    for name, value in content.items():
        if name == "units" or isinstance(value, dict | str):
            continue
        array = np.atleast_1d(np.asarray(value))
        if array.ndim == 1 and array.size and array.dtype.kind in "biufUO" and not isinstance(array[0], dict):
            vectors[name] = array
    return vectors


def read_netcdf(path: Path) -> RawTable:
    """The variables along the dimension of time; fill values become NaN, packed numbers are unpacked."""
    if is_hdf5 := _is_hdf5(path):
        require_package("h5py", "hdf5", path)
    variables, attributes = process.read_in_child(FOREIGN_READER, "netcdf_4" if is_hdf5 else "netcdf", path)
    # A dimension of one entry, such as that of a single trajectory, is none.
    for name, (dimensions, values, metadata) in variables.items():
        long = tuple(entry for entry, size in zip(dimensions, values.shape, strict=True) if size != 1)
        variables[name] = (long, values.squeeze(), metadata) if long else (dimensions, values.ravel(), metadata)
    standard = (name for name, (_, _, metadata) in variables.items() if metadata.get("standard_name") == "time")
    time = next((name for name in (*_TIME_NAMES, *standard) if name in variables), None)
    groups = attributes.get(GROUPS, ())
    if time is None:
        fix = "name the file .h5, and its groups are read" if groups else "rename the one that holds the times"
        raise InputError("has no variable time", where=str(path), fix=fix)
    rows = variables[time][0]
    if len(rows) != 1:
        why = f"it is along {', '.join(rows)}"
        raise InputError(
            f"its {time} has {len(rows)} dimensions", where=str(path), why=why, fix="give one track a file"
        )
    series = {name: variable for name, variable in variables.items() if variable[0] == rows}
    remarks = []
    if "provenance" in attributes:  # our exports: lat and lon follow from the other columns
        series = {name: variable for name, variable in series.items() if name not in ("lat", "lon")}
    elif others := [*(name for name in variables if name not in series and variables[name][1].size > 1), *groups]:
        remarks = [f"not taken, as not along the dimension of {time}: {', '.join(others)}"[:300]]
    frame = pd.DataFrame({name: values for name, (_, values, _) in series.items()})
    unit, calendar = (str(series[time][2].get(key, default)) for key, default in _TIME_ATTRIBUTES.items())
    since = times_since(frame[time].to_numpy(), unit, path, calendar)
    is_tai = any(map(names_tai, (time, *map(str, series[time][2].values()))))
    if since is not None:
        frame[time] = since.tz_localize(None) if is_tai else since
        remarks += filter(None, [gps_remark(time, unit)])
    units = {
        name: str(metadata["units"])
        for name, (_, _, metadata) in series.items()
        if "units" in metadata and (name != time or since is None)
    }
    units |= {time: f"{units.get(time, '')} TAI".strip()} if is_tai else {}
    meanings = {
        name: str(meaning)
        for name, (_, _, metadata) in series.items()
        if (meaning := metadata.get("standard_name") or metadata.get("long_name"))
    }
    trial = parse_trial(files.parse_json(str(attributes.get("trial", "{}"))))
    return RawTable(path, frame, trial, units, meanings, remarks=(*remarks,))


def times_since(
    counts: quantities.AnyArray, unit: str, path: Path, calendar: str = CALENDARS[0]
) -> pd.DatetimeIndex | None:
    """Times that are counted in a unit such as ``days since 1990-01-01`` (CF-1.11, 4.4); None for any other.

    Without a zone the moment is of UTC; those of TAI are returned on that clock. Raises :class:`InputError` for a
    moment that is no date, or too early, and for another calendar than ours.
    """
    since = _SINCE.fullmatch(unit.strip())
    if since is not None and since[1].lower() in _UNEVEN:
        fix = "count them in seconds or days"
        raise InputError(f"its times are in {unit!r}, which is not read", where=str(path), fix=fix)
    if since is None or since[1].lower() not in COUNTS_NS or counts.dtype.kind not in "iuf":
        return None
    if (start := _plain_moment(since[2])) is None:
        fix = "write it as 2026-05-17 12:00:00 +00:00"
        raise InputError(f"its times count from {since[2]!r}, no plain date", where=str(path), fix=fix)
    if calendar.lower() not in (*CALENDARS, "tai"):
        why = f"they are of the calendar {calendar!r}"
        raise InputError("its times are no dates", where=str(path), why=why, fix="write them in the usual calendar")
    if start < _GREGORIAN and calendar.lower() != "proleptic_gregorian":
        why = f"they count from {since[2]}, and calendars differ before 1582"
        raise InputError("its times are no dates", where=str(path), why=why, fix="count them from a later day")
    step_ns = COUNTS_NS[since[1].lower()]
    is_time = np.isfinite(counts)
    integers = np.floor(np.where(is_time, counts, 0))
    part_ns = np.rint((np.where(is_time, counts, 0) - integers) * step_ns).astype(np.int64)
    # in days and the rest of the day: steps since a year far back are more ns than 64 bits hold
    days, steps = np.divmod(integers.astype(np.int64), DAY_NS // step_ns)
    first_day = start.normalize()
    ns = (first_day.to_datetime64().astype("datetime64[D]").astype(np.int64) + days) * DAY_NS + (
        (start - first_day).value + steps * step_ns + part_ns
    )
    return pd.DatetimeIndex(np.where(is_time, ns.view("datetime64[ns]"), np.datetime64("NaT")), tz="UTC")


def gps_remark(name: str, unit: str) -> str:
    """What is said of times that count from where GPS time does; empty for others.

    >>> gps_remark("time", "days since 1980-01-01")
    ''
    """
    since = _SINCE.fullmatch(unit.strip())
    if since is None or _plain_moment(since[2]) != _GPS_EPOCH:
        return ""
    return (
        f"{name!r} counts from 1980-01-06, as GPS does, and is taken for UTC; without leap seconds it is ahead by"
        " them, 18 s since 2017: --answer zone=GPS"
    )


def _plain_moment(text: str) -> pd.Timestamp | None:
    """The moment in UTC that a text states; None for one that may be several, or is none."""
    match = _MOMENT.fullmatch(text.strip())
    zone = (match["zone"] or "UTC") if match else ""
    offset_s = 0 if names_tai(zone) else zone_offset_s(zone)
    if match is None or offset_s is None:
        return None
    with suppress(ValueError):
        return pd.Timestamp(match["moment"]) - pd.Timedelta(offset_s, "s")
    return None


def _is_hdf5(path: Path) -> bool:
    """By its first bytes; MATLAB's files begin with another header."""
    with path.open("rb") as stream:
        head = stream.read(_USER_BLOCK_BYTES + len(_HDF5))
    return head.startswith(_HDF5) or head.endswith(_HDF5)


_READERS: dict[str, Callable[[Path], RawTable]] = {
    **dict.fromkeys(_TEXT, _read_text),
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), _read_sheet),
    ".parquet": _read_parquet,
    ".mat": read_mat,
    ".nc": read_netcdf,
    ".gpx": _read_gpx,
}
"""How a file is read, by its suffix."""
