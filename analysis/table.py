"""A recording as a table: one row a measured time, one column a channel, NaN where a channel has no sample."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.channels import BY_NAME, NAMES
from acquisition.errors import DataShortageError, InputError, SeatrialError, storage_error
from acquisition.frames import Quality
from acquisition.recording.reader import Recording, Series, read_recording
from acquisition.trial import software_version
from analysis.frames import NANO, index_of, times_ns, utc_index
from analysis.parquet import write_parquet

WRITERS = ("parquet", "csv", "mat")


def read_table(path: Path | str) -> pd.DataFrame:
    """The raw samples of all channels joined on their measured time.

    The index is UTC in ns, named ``time`` and sorted; a time that one channel has twice stands in two rows.
    Values flagged bad are NaN. ``attrs`` holds the trial's metadata and the sources by channel. Raises
    :class:`InputError` for what is no recording and :class:`DataShortageError` for one without channels.
    """
    return table_of(read_recording(path))


def table_of(recording: Recording) -> pd.DataFrame:
    """As :func:`read_table`, of a recording that is already read."""
    if not recording.series:
        raise DataShortageError(
            "holds no channel", where=str(recording.path), fix="check the sources of its configuration"
        )
    names = [name for name in BY_NAME if name in recording.series]
    keys = {name: _keys(recording.series[name]) for name in names}
    rows = np.unique(np.concatenate(list(keys.values())))
    columns = {}
    for name in names:
        column = np.full(rows.size, np.nan)
        column[np.searchsorted(rows, keys[name])] = _believed(recording.series[name])
        columns[name] = column
    table = pd.DataFrame(columns, index=index_of(np.ascontiguousarray(rows["time"])))
    table.attrs["trial"] = asdict(recording.trial)
    table.attrs["recording"] = str(recording.path)
    table.attrs["sources"] = {name: list(recording.series[name].sources) for name in names}
    return table


_KEY = np.dtype([("time", np.int64), ("repeat", np.int64)])


def _keys(series: Series) -> NDArray[np.void]:
    """Measured time and how often it came before: what makes a row."""
    order = np.argsort(series.measured_ns, kind="stable")
    times = series.measured_ns[order]
    first = np.searchsorted(times, times, side="left")
    keys = np.empty(times.size, dtype=_KEY)
    keys["time"][order], keys["repeat"][order] = times, np.arange(times.size) - first
    return keys


def _believed(series: Series) -> NDArray[np.float64]:
    return np.where(series.quality >= Quality.BAD, np.nan, series.value)


def require(table: pd.DataFrame, names: tuple[str, ...] = NAMES, where: str = "") -> None:
    """Raise :class:`InputError` naming the channels of ``names`` that a table lacks."""
    missing = [name for name in names if name not in table or not table[name].notna().any()]
    if missing:
        raise InputError(
            f"has no {', '.join(missing)}",
            where=where or str(table.attrs.get("recording", "table")),
            fix="record the channel, or import with a map that gives it a constant",
        )


def select(table: pd.DataFrame, part_percent: tuple[float, float] | str) -> pd.DataFrame:
    """The rows in a part of the table's time, in percent of its span; (0, 100) or ``"0..100"`` is all.

    Parts that meet share no row. Raises :class:`InputError` for a part that is not inside 0 to 100 or is empty.
    """
    low, high = percent_of(part_percent) if isinstance(part_percent, str) else part_percent
    if not 0.0 <= low < high <= 100.0:
        raise InputError(f"part {low:g}..{high:g} is no part of 0..100", fix="write it like 0..70")
    times = times_ns(table)
    if not times.size:
        return table
    start, span = int(times.min()), int(times.max() - times.min())
    first, last = (start + round(span * share / 100.0) for share in (low, high))
    chosen: pd.DataFrame = table[(times >= first) & ((times < last) if high < 100.0 else (times <= last))]
    return chosen


def percent_of(part: str) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in part.split(".."))
    except ValueError as error:
        raise InputError(f"{part!r} is no part of a recording", fix="write it like 0..70") from error
    return low, high


def export_table(table: pd.DataFrame, path: Path, rate_hz: float | None = None) -> None:
    """Write a table as Parquet, CSV or .mat by the suffix of ``path``, units and origin in its metadata.

    Raises :class:`InputError` for another suffix and :class:`StorageError` when it cannot be written.
    """
    kind = path.suffix.removeprefix(".").lower()
    if kind not in WRITERS:
        raise InputError(f"cannot write {path.suffix or 'a file without suffix'}", where=str(path),
                         fix="name it .parquet, .csv or .mat")  # fmt: skip
    metadata = _metadata(table, rate_hz)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        {"parquet": _write_parquet, "csv": _write_csv, "mat": _write_mat}[kind](table, path, metadata)
    except SeatrialError:
        raise
    except OSError as error:
        raise storage_error(path, error) from error


def _metadata(table: pd.DataFrame, rate_hz: float | None) -> dict[str, Any]:
    known = {str(name): BY_NAME[str(name)].unit for name in table.columns if name in BY_NAME}
    trial = {key: value for key, value in table.attrs.get("trial", {}).items() if value not in (None, "")}
    return {"units": known, "trial": trial, "recording": table.attrs.get("recording", ""), "rate_hz": rate_hz}


def _write_parquet(table: pd.DataFrame, path: Path, metadata: dict[str, Any]) -> None:
    """Units on the columns; trial, recording and rate as JSON in the file's metadata."""
    texts = {key: json.dumps(value) for key, value in metadata.items()}
    write_parquet(table.set_axis(utc_index(table), axis=0), path, metadata["units"], texts)


def _write_csv(table: pd.DataFrame, path: Path, metadata: dict[str, Any]) -> None:
    """ISO 8601 times to the nanosecond; the names carry the units, and CSV has no place for more."""
    times = np.datetime_as_string(times_ns(table).astype("datetime64[ns]"), unit="ns")
    table.set_axis(pd.Index([f"{time}Z" for time in times]), axis=0).to_csv(path, index_label="time")


def _write_mat(table: pd.DataFrame, path: Path, metadata: dict[str, Any]) -> None:
    """One vector a channel, ``time`` in seconds since 1970 (to 0.3 microseconds), structs ``units``, ``trial``."""
    from scipy.io import savemat

    vectors = {str(name): table[name].to_numpy() for name in table.columns}
    about = {
        "units": {"time": "s since 1970 UTC", **metadata["units"]},
        "trial": {**metadata["trial"], "software_version": software_version()},
    }
    savemat(path, {"time": times_ns(table) / NANO, **vectors, **about}, oned_as="column")
