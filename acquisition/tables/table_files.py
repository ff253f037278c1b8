"""Table files as they are: CSV, Parquet, .mat and NetCDF to a frame of raw columns, cells to numbers and times.

Rows keep their order and their number. What cannot be read is one :class:`InputError` that says where.
"""

from __future__ import annotations

import bz2
import csv
import gzip
import json
import lzma
import re
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from acquisition.core.errors import InputError
from acquisition.core.frames import NANO
from acquisition.core.trial import Trial

_OPENERS: dict[str, Callable[[Path], Any]] = {
    "": lambda path: path.open("rb"),
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
}
"""How a CSV file is opened, by what comes after ``.csv``."""
_MICRO = 1_000_000
_DELIMITERS = (",", ";", "\t")
_PROBE_BYTES = 8192
_ZONED = r"\d[T ]\d\d.*(?:[Zz]|[+-]\d\d(?::?\d\d)?)\s*$"


@dataclass(frozen=True, slots=True)
class RawTable:
    """The columns of a file under their own names, and the trial if the file tells of one."""

    path: Path
    columns: pd.DataFrame
    trial: Trial = field(default_factory=Trial)

    @property
    def name(self) -> str:
        """The file's name without what says its kind."""
        return self.path.name.removesuffix("".join(_kind_of(self.path)))


@dataclass(slots=True)
class TableFile:
    """A table file in the contract's columns and units.

    ``table`` has a UTC index in the file's order; ``sources`` says for each column where it comes from, and
    ``assumed`` for a constant of the map; ``passed_over`` are the file's columns that were not used, and
    ``dropped`` counts the rows that a map let go, by what is wrong with them.
    """

    table: pd.DataFrame
    trial: Trial
    sources: dict[str, str] = field(default_factory=dict)
    passed_over: tuple[str, ...] = ()
    dropped: dict[str, int] = field(default_factory=dict)

    @property
    def assumed(self) -> dict[str, float]:
        """The channels that a map gave a constant, with its value in the channel's unit."""
        return {
            name: float(self.table[name].iloc[0]) for name, source in self.sources.items() if source == "assumed"
        }


def read_raw(path: Path | str) -> RawTable:
    """The table as it is in the file. Raises :class:`InputError` for anything that is no table with rows."""
    path = Path(path)
    suffix, packed = _kind_of(path)
    readers = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat, ".nc": _read_netcdf}
    if not path.is_file():
        raise InputError("is no file", where=str(path), fix="check the path")
    if suffix.lower() not in readers or packed.lower() not in _OPENERS or (packed and suffix.lower() != ".csv"):
        raise InputError(
            "is of no kind that can be imported", where=str(path),
            fix=f"give .csv, also with {', '.join(filter(None, _OPENERS))}, or .parquet, .mat or .nc",
        )  # fmt: skip
    if path.stat().st_size == 0:
        raise InputError("is an empty file", where=str(path), fix="give a table that holds data")
    reader = readers[suffix.lower()]
    try:
        raw = reader(path)
    except InputError:
        raise
    except Exception as error:  # a damaged file makes scipy and pyarrow fail in every possible way
        why = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(f"is no readable {suffix} table", where=str(path), why=why) from error
    if raw.columns.empty:
        raise InputError("holds no rows", where=str(path), fix="give a table that holds data")
    return raw


def _kind_of(path: Path) -> tuple[str, str]:
    """What a file's name says of its kind: ``.csv`` and how it is packed, for instance ``.gz``, or nothing."""
    packed = path.suffix if path.suffix.lower() in _OPENERS else ""
    return Path(path.name.removesuffix(packed)).suffix, packed


def _read_csv(path: Path) -> RawTable:
    """Comma, semicolon or tab between the cells; with semicolons a comma in a number is the decimal point."""
    unpacked = _OPENERS[_kind_of(path)[1].lower()]
    with unpacked(path) as stream:
        probe = stream.read(_PROBE_BYTES)
    if b"\0" in probe:
        raise InputError("is no text", where=str(path), why="it holds zero bytes", fix="save it as CSV in UTF-8")
    first, *rest = probe.decode("utf-8-sig", errors="ignore").splitlines()
    delimiter = max(_DELIMITERS, key=first.count)
    _refuse_twins([name.strip() for name in next(csv.reader([first], delimiter=delimiter))], path)
    decimal = "," if delimiter == ";" and any("," in line for line in rest) else "."
    with warnings.catch_warnings(), unpacked(path) as stream:
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut
        frame = pd.read_csv(
            stream, sep=delimiter, decimal=decimal, skipinitialspace=True, encoding="utf-8-sig", low_memory=False,
            index_col=False,
        )  # fmt: skip
    frame.columns = pd.Index([str(name).strip() for name in frame.columns])
    nameless = [name for name in frame.columns if name.startswith("Unnamed:") and frame[name].isna().all()]
    frame = frame.drop(columns=nameless)  # what a delimiter at the end of every line leaves
    return RawTable(path, frame, _trial_beside(path))


def _trial_beside(path: Path) -> Trial:
    """The trial that our own exports write beside a CSV file; an empty one where there is no such file."""
    beside = path.with_name(f"{path.name}.json")
    try:
        return _trial(json.loads(beside.read_text(encoding="utf-8"))["trial"])
    except (OSError, ValueError, KeyError, TypeError):
        return Trial()


def _refuse_twins(names: list[str], path: Path) -> None:
    twins = [name for name, count in Counter(names).items() if count > 1]
    if twins:
        raise InputError(
            f"has more than one column {', '.join(map(repr, twins))}", where=str(path), fix="rename one of them"
        )


def _read_parquet(path: Path) -> RawTable:
    """A time index becomes the column ``time``; the trial is in the metadata of our own exports."""
    import pyarrow.parquet as pq

    arrow = pq.read_table(path)
    frame = arrow.to_pandas()
    if isinstance(frame.index, pd.DatetimeIndex) and "time" not in frame:
        frame = frame.rename_axis("time").reset_index()
    frame.columns = pd.Index([str(name).strip() for name in frame.columns])
    _refuse_twins(list(frame.columns), path)
    written = (arrow.schema.metadata or {}).get(b"seatrial.trial")
    return RawTable(path, frame, _trial(json.loads(written)) if written else Trial())


def _read_mat(path: Path) -> RawTable:
    """Vectors of one length, at the top or in the one struct that holds them.

    The structs ``units`` and ``trial`` of our own exports are understood; a vector of another length is an
    error, for which of the two is wrong nobody can tell.
    """
    from scipy.io import loadmat

    try:
        loaded: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise InputError(
            "is a MATLAB 7.3 file", where=str(path), fix="save it with -v7, or export it as CSV or Parquet"
        ) from error
    content = {key: value for key, value in loaded.items() if not key.startswith("__")}
    trial = content.pop("trial", {})
    content.pop("units", None)
    vectors = _vectors(content)
    if not vectors:
        structs = [
            vectors for value in content.values() if isinstance(value, dict) and (vectors := _vectors(value))
        ]
        if len(structs) != 1:
            what = "holds no vectors" if not structs else f"holds {len(structs)} structs of vectors"
            raise InputError(what, where=str(path), fix="save one struct of vectors, or the vectors themselves")
        vectors = structs[0]
    lengths = Counter(len(vector) for vector in vectors.values())
    usual = lengths.most_common(1)[0][0]
    odd = [f"{name} ({len(vector)})" for name, vector in vectors.items() if len(vector) != usual]
    if odd:
        raise InputError(
            f"holds vectors that are not {usual} long: {', '.join(odd)}", where=str(path), fix="leave them out"
        )
    return RawTable(path, pd.DataFrame(vectors), _trial(trial) if isinstance(trial, dict) else Trial())


_HDF5 = b"\x89HDF"
_SINCE = re.compile(r"(seconds|minutes|hours|days) since (.+)")
_SECONDS = {"seconds": 1.0, "minutes": 60.0, "hours": 3600.0, "days": 86_400.0}


def _read_netcdf(path: Path) -> RawTable:
    """The variables along the dimension of ``time``, in the classic format; fill values become NaN."""
    from scipy.io import netcdf_file

    with path.open("rb") as stream:
        if stream.read(4) == _HDF5:
            raise InputError("is NetCDF-4", where=str(path), fix="bring it to the classic format: nccopy -k nc6")
    with netcdf_file(path, mmap=False) as file:
        if "time" not in file.variables:
            raise InputError("has no variable time", where=str(path), fix="rename the one that holds the times")
        rows = file.variables["time"].dimensions
        columns = {name: _unfilled(each) for name, each in file.variables.items() if each.dimensions == rows}
        since = _SINCE.match(getattr(file.variables["time"], "units", b"").decode())
        trial, ours = json.loads(getattr(file, "trial", b"{}")), hasattr(file, "provenance")
    if ours:  # lat and lon follow from the other columns
        columns = {name: values for name, values in columns.items() if name not in ("lat", "lon")}
    frame = pd.DataFrame(columns)
    if since:
        start = pd.Timestamp(since[2])
        seconds = frame["time"] * _SECONDS[since[1]]
        frame["time"] = (start.tz_localize("UTC") if start.tz is None else start) + pd.to_timedelta(seconds, "s")
    return RawTable(path, frame, _trial(trial))


def _unfilled(variable: Any) -> NDArray[Any]:
    """A NetCDF variable's values in this machine's order of bytes, NaN where there is none."""
    values = variable.data.astype(variable.data.dtype.newbyteorder("="))
    fill = getattr(variable, "_FillValue", None)
    return values if fill is None else np.where(values == fill, np.nan, values)


def _vectors(content: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """The numeric and text vectors among a file's variables; a single number is a vector of one."""
    found = {}
    for name, value in content.items():
        if name == "units" or isinstance(value, dict | str):
            continue
        array = np.atleast_1d(np.asarray(value))
        if array.ndim == 1 and array.size and array.dtype.kind in "biufUO":
            found[name] = array
    return found


def _trial(values: Mapping[str, Any]) -> Trial:
    texts = {str(key): str(value) for key, value in values.items() if value is not None and np.size(value)}
    if "name" in texts:
        texts["trial"] = texts.pop("name")
    return Trial.from_metadata(texts)


def no_numbers(column: pd.Series[Any]) -> Bools:
    """Where a column holds something that is no number; an empty cell is none of these."""
    values = pd.to_numeric(column, errors="coerce")
    return np.asarray(values.isna().to_numpy() & column.notna().to_numpy())


def readable_rows(
    raw: RawTable, times: pd.DatetimeIndex, numbers: Sequence[str]
) -> tuple[RawTable, dict[str, int]]:
    """The rows that have a time and no text where a number belongs, and how many others there are, by the reason.

    ``times`` are as :func:`read_times` gives them. Raises :class:`InputError` where no row is left.
    """
    timeless = np.asarray(times.isna())
    text = np.any([no_numbers(raw.columns[name]) for name in numbers], axis=0) & ~timeless
    dropped = {"without a time": int(timeless.sum()), "with text for a number": int(text.sum())}
    kept = raw.columns[~(timeless | text)].reset_index(drop=True)
    if kept.empty:
        why = ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count)
        raise InputError("holds no row that can be read", where=str(raw.path), why=why, fix="check the columns")
    return replace(raw, columns=kept), {reason: count for reason, count in dropped.items() if count}


def parse_numbers(raw: RawTable, name: str) -> Floats:
    """A column as numbers, empty cells as NaN. Raises :class:`InputError` naming the first cell that is none."""
    column = raw.columns[name]
    values = pd.to_numeric(column, errors="coerce")
    wrong = np.flatnonzero(no_numbers(column))
    if wrong.size:
        raise InputError(
            f"row {wrong[0] + 1} of column {name!r} is no number but {column.iloc[wrong[0]]!r}",
            where=str(raw.path),
            why=f"{wrong.size} cells of the column are no numbers",
            fix="write missing values as empty cells",
        )
    return values.to_numpy(dtype=float)


def parse_times(
    raw: RawTable, name: str, zone: str | None = None, start: str | None = None, seconds: bool = False
) -> pd.DatetimeIndex:
    """A column as UTC times in ns, as :func:`read_times`; every row needs one, or it is an :class:`InputError`."""
    column = raw.columns[name]
    if seconds:
        parse_numbers(raw, name)
    index = read_times(raw, name, zone, start, seconds)
    empty = np.flatnonzero(index.isna())
    if empty.size:
        given = column.iloc[empty[0]]
        what = "has no time" if pd.isna(given) else f"holds {given!r}, which is no ISO 8601 time"
        raise InputError(
            f"row {empty[0] + 1} of column {name!r} {what}", where=str(raw.path), why=f"{empty.size} such rows",
            fix="give every row a time like 2026-05-17T12:00:00Z",
        )  # fmt: skip
    return index


def read_times(
    raw: RawTable, name: str, zone: str | None = None, start: str | None = None, seconds: bool = False
) -> pd.DatetimeIndex:
    """A column as UTC times in ns: ISO 8601 text, or seconds since 1970 or ``start``; NaT for what is neither.

    Text without a zone is in ``zone``, or an :class:`InputError` where that is None: local time is ambiguous
    twice a year. Numbers are seconds; ``seconds`` says that nothing else will do.
    """
    column = raw.columns[name]
    if seconds or pd.api.types.is_numeric_dtype(column):
        index = _from_seconds(pd.to_numeric(column, errors="coerce").to_numpy(dtype=float), start)
    elif isinstance(column.dtype, pd.DatetimeTZDtype):
        index = pd.DatetimeIndex(column)
    else:
        index = _from_text(raw, column, zone)
    return index.tz_convert("UTC").as_unit("ns").rename("time")


def _from_text(raw: RawTable, column: pd.Series[Any], zone: str | None) -> pd.DatetimeIndex:
    """ISO 8601 text, or times without a zone from Parquet; NaT for what cannot be read."""
    text = column.astype("str")
    zoned = text.str.contains(_ZONED, regex=True, na=False)
    times = pd.to_datetime(text.where(zoned), format="ISO8601", utc=True, errors="coerce")
    naive = pd.to_datetime(text.mask(zoned), format="ISO8601", errors="coerce")
    if zone is not None:
        local = naive.dt.tz_localize(zone, ambiguous="NaT", nonexistent="NaT")
        return pd.DatetimeIndex(times.fillna(local.dt.tz_convert("UTC")))
    if naive.notna().any():
        row = int(np.flatnonzero(naive.notna())[0])
        raise InputError(
            f"row {row + 1} of column {column.name!r} has no zone: {text.iloc[row]}",
            where=str(raw.path),
            fix='write times like 2026-05-17T12:00:00Z, or give zone = "UTC" in a column map',
        )
    return pd.DatetimeIndex(times)


def _from_seconds(seconds: Floats, start: str | None) -> pd.DatetimeIndex:
    """Seconds as UTC. A float of today's seconds since 1970 is good to 0.2 microseconds: it is rounded to one."""
    begin = pd.Timestamp(start) if start else pd.Timestamp(0, tz="UTC")
    valid = np.isfinite(seconds) & (np.abs(seconds) < 9e9)
    whole = np.floor(np.where(valid, seconds, 0.0))
    unit = _MICRO if start is None else NANO
    part = np.rint((np.where(valid, seconds, 0.0) - whole) * unit).astype(np.int64) * (NANO // unit)
    time_ns = whole.astype(np.int64) * NANO + part + begin.as_unit("ns").value
    return pd.DatetimeIndex(np.where(valid, time_ns.astype("datetime64[ns]"), np.datetime64("NaT")), tz="UTC")
