"""Tables to recordings: CSV, Parquet and .mat, with the contract's columns or through a column map.

Nothing is dropped or put in order: rows stay as they are, values that a channel cannot hold are kept and
flagged bad, and what was found is counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
from numpy.typing import NDArray

from acquisition.angles import wrap_360
from acquisition.channels import BY_NAME, CIRCULAR, NAMES
from acquisition.column_map import DEGREES_AND_MINUTES, ApparentWind, ColumnMap, TimeColumn, factor, load_column_map
from acquisition.errors import InputError
from acquisition.frames import Quality
from acquisition.recording.tables import write_table
from acquisition.trial import Trial
from acquisition.units import scale_to

Floats = NDArray[np.float64]

_LABELS = frozenset({"window", "second", "trial", "leg", "start"})  # our own exports' columns that are no channels


@dataclass(slots=True)
class TableFile:
    """A table file in the contract's columns and units, and what is to be said of it.

    ``sources`` says for each column where it comes from; ``qualities`` flags its values.
    """

    table: pd.DataFrame
    trial: Trial = field(default_factory=Trial)
    sources: dict[str, str] = field(default_factory=dict)
    qualities: dict[str, NDArray[np.uint8]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import did."""

    rows: int
    samples: int
    channels: tuple[str, ...]
    out_of_range: dict[str, int]
    times_backwards: int
    times_twice: int
    assumed: tuple[str, ...]
    passed_over: tuple[str, ...]

    def __str__(self) -> str:
        parts = [f"{self.rows:,} rows, {self.samples:,} samples of {len(self.channels)} channels"]
        parts += [
            f"{count} values of {name} out of range, flagged bad" for name, count in self.out_of_range.items()
        ]
        if self.times_backwards:
            parts.append(f"{self.times_backwards} times go backwards")
        if self.times_twice:
            parts.append(f"{self.times_twice} times come twice")
        if self.assumed:
            parts.append(f"assumed: {', '.join(self.assumed)}")
        if self.passed_over:
            parts.append(f"passed over: {', '.join(self.passed_over)}")
        return "; ".join(parts)


def import_table(
    path: Path,
    output: Path,
    map_path: Path | None = None,
    allow_missing: bool = False,
    ignore_unknown: bool = False,
) -> Imported:
    """Write a table file as a recording and say what was found in it.

    Raises :class:`InputError` for what cannot be read or lacks a channel, :class:`ConfigurationError` for a
    wrong map, :class:`StorageError` when the recording cannot be written.
    """
    raw = read_raw(path)
    passed_over: tuple[str, ...] = ()
    if map_path is not None:
        file = _mapped(raw, load_column_map(map_path), path, map_path)
    else:
        file, passed_over = _standard(raw, path, ignore_unknown)
    if not allow_missing and map_path is None:
        _require_all(file.table, path)
    flag_out_of_range(file)
    samples = write_table(file.table, output, file.trial, {**file.sources}, file.qualities)
    times = pd.DatetimeIndex(file.table.index).as_unit("ns").asi8
    return Imported(
        rows=len(file.table),
        samples=samples,
        channels=tuple(map(str, file.table.columns)),
        out_of_range={
            name: count for name, flags in file.qualities.items() if (count := int((flags == Quality.BAD).sum()))
        },
        times_backwards=int((np.diff(times) < 0).sum()),
        times_twice=int((np.diff(times) == 0).sum()),
        assumed=tuple(name for name, source in file.sources.items() if source == "assumed"),
        passed_over=passed_over,
    )


def read_raw(path: Path) -> pd.DataFrame:
    """The table as it is in the file. Raises :class:`InputError` for anything that is no table with rows."""
    readers = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat}
    if not path.exists():
        raise InputError("does not exist", where=str(path), fix="check the path")
    if path.suffix.lower() not in readers:
        raise InputError("is of no kind that can be imported", where=str(path), fix="give .csv, .parquet or .mat")
    if path.stat().st_size == 0:
        raise InputError("is an empty file", where=str(path), fix="give a table that holds data")
    try:
        raw = readers[path.suffix.lower()](path)
    except (ValueError, OSError, NotImplementedError, TypeError) as error:
        raise InputError(f"is no readable {path.suffix} table", where=str(path), why=str(error)) from error
    raw.columns = [str(name).strip() for name in raw.columns]
    if raw.empty:
        raise InputError("holds no rows", where=str(path), fix="give a table that holds data")
    return raw


def _read_csv(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, skipinitialspace=True)


def _read_parquet(path: Path) -> pd.DataFrame:
    raw = pd.read_parquet(path)
    return raw.reset_index() if raw.index.name == "time" else raw


def _read_mat(path: Path) -> pd.DataFrame:
    """Vectors of one length, at the top or in one struct; anything else in the file is passed over."""
    from scipy.io import loadmat

    content = {key: value for key, value in loadmat(path, simplify_cells=True).items() if not key.startswith("__")}
    structs = [value for value in content.values() if isinstance(value, dict) and "time" in value]
    if "time" not in content and structs:
        content = structs[0]
    vectors = {key: np.ravel(value) for key, value in content.items() if np.ndim(value) >= 1 and np.size(value)}
    if not vectors:
        raise ValueError("it holds no vectors")
    longest = max(len(value) for value in vectors.values())
    return pd.DataFrame({key: value for key, value in vectors.items() if len(value) == longest})


def _standard(raw: pd.DataFrame, path: Path, ignore_unknown: bool) -> tuple[TableFile, tuple[str, ...]]:
    """A table whose columns are named as the channels."""
    if "time" not in raw:
        raise InputError("has no column `time`", where=str(path), fix="name it so, or give a map with --columns")
    unknown = tuple(name for name in raw.columns if name not in BY_NAME and name != "time" and name not in _LABELS)
    if unknown and not ignore_unknown:
        near = {name: get_close_matches(name, BY_NAME, n=1, cutoff=0.6) for name in unknown}
        hints = [f"{name} (did you mean {match[0]}?)" if match else name for name, match in near.items()]
        raise InputError(
            f"has unknown columns {', '.join(hints)}",
            where=str(path),
            fix="rename them, map them with --columns MAP.toml, or say --ignore-unknown",
        )
    index = _times(raw["time"], TimeColumn(column="time"), path)
    names = [name for name in BY_NAME if name in raw]
    table = pd.DataFrame({name: _numbers(raw, name, path) for name in names}, index=index)
    return TableFile(table, Trial(name=path.stem), dict.fromkeys(names, "table")), unknown


def _require_all(table: pd.DataFrame, path: Path) -> None:
    missing = [name for name in NAMES if name not in table]
    if missing:
        raise InputError(
            f"has no {', '.join(missing)}",
            where=str(path),
            fix="add the column, give it a constant in a map, or say --allow-missing",
        )


def _mapped(raw: pd.DataFrame, columns: ColumnMap, path: Path, map_path: Path) -> TableFile:
    """A foreign table through its map."""
    table = pd.DataFrame(index=_times(_column(raw, columns.time.column, path, map_path), columns.time, path))
    file = TableFile(table)
    for name, entry in columns.channels.items():
        if entry.column is None:
            table[name] = float(entry.constant or 0.0)
            file.sources[name] = "assumed"
            continue
        _column(raw, entry.column, path, map_path)
        values = factor(name, entry) * _numbers(raw, entry.column, path) + entry.offset
        table[name] = _wrapped(name, values)
        file.sources[name] = f"table: {entry.column}"
    origin = columns.trial.origin
    known = (origin.latitude_deg, origin.longitude_deg) if origin else None
    if columns.position is not None:
        known = _add_position(file, raw, columns, known, path, map_path)
    if columns.apparent_wind is not None:
        _add_true_wind(file, raw, columns.apparent_wind, path)
    missing = [name for name in NAMES if name not in table and name not in columns.absent]
    if missing:
        raise InputError(
            f"gives no {', '.join(missing)}", where=str(map_path), fix="map them, or list them under `absent`"
        )
    file.table = table[[name for name in BY_NAME if name in table]]
    entry_ = columns.trial
    file.trial = Trial(
        name=entry_.name or path.stem,
        vessel=entry_.vessel,
        place=entry_.place,
        origin_latitude_deg=known[0] if known else None,
        origin_longitude_deg=known[1] if known else None,
        water_depth_m=entry_.water_depth_m,
        draught_m=entry_.draught_m,
        crew_notes=entry_.crew_notes,
    )
    return file


def _column(raw: pd.DataFrame, name: str, path: Path, map_path: Path) -> pd.Series:
    if name not in raw:
        near = get_close_matches(name, list(raw.columns), n=1) or list(raw.columns)
        raise InputError(f"has no column {name!r}", where=str(path), why=f"{map_path} asks for it",
                         fix=f"it has {', '.join(near)}")  # fmt: skip
    return raw[name]


def _add_position(
    file: TableFile,
    raw: pd.DataFrame,
    columns: ColumnMap,
    origin: tuple[float, float] | None,
    path: Path,
    map_path: Path,
) -> tuple[float, float]:
    """North and east of the origin, or of the first fix, on the WGS 84 tangent plane."""
    entry = columns.position
    if entry is None:
        raise InputError("has no position", where=str(map_path))
    pair = []
    for name in (entry.latitude, entry.longitude):
        _column(raw, name, path, map_path)
        degrees = _numbers(raw, name, path)
        pair.append(from_degrees_and_minutes(degrees) if entry.unit == DEGREES_AND_MINUTES else degrees)
    latitude, longitude = pair
    if origin is None:
        valid = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
        if not valid.size:
            raise InputError("has no valid fix", where=str(path))
        origin = float(latitude[valid[0]]), float(longitude[valid[0]])
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, 0.0, *origin, 0.0)
    for name, values in zip(
        ("north_m", "east_m", "latitude_deg", "longitude_deg"), (north, east, *pair), strict=True
    ):
        file.table[name] = values
        file.sources[name] = f"table: {entry.latitude}, {entry.longitude}"
    return origin


def from_degrees_and_minutes(ddmm: Floats) -> Floats:
    """Degrees from ``dddmm.mmmm``.

    >>> float(from_degrees_and_minutes(np.array([-6230.0]))[0])
    -62.5
    """
    degrees = np.trunc(ddmm / 100.0)
    return np.asarray(degrees + (ddmm - 100.0 * degrees) / 60.0)


def _add_true_wind(file: TableFile, raw: pd.DataFrame, entry: ApparentWind, path: Path) -> None:
    """The wind over ground from the wind past the ship: take away the ship's own motion, turn by the heading."""
    angle = np.deg2rad(_numbers(raw, entry.angle, path) * scale_to("deg", entry.angle_unit))
    speed = _numbers(raw, entry.speed, path) * scale_to("m/s", entry.speed_unit)
    heading = np.deg2rad(file.table["heading_deg"].to_numpy())
    ahead = speed * np.cos(angle) - file.table["surge_mps"].to_numpy()
    starboard = speed * np.sin(angle) - file.table["sway_mps"].to_numpy()
    north = ahead * np.cos(heading) - starboard * np.sin(heading)
    east = ahead * np.sin(heading) + starboard * np.cos(heading)
    file.table["wind_direction_deg"] = wrap_360(np.rad2deg(np.arctan2(east, north)))
    file.table["wind_speed_mps"] = np.hypot(north, east)
    for name in ("wind_direction_deg", "wind_speed_mps"):
        file.sources[name] = f"table: {entry.angle}, {entry.speed} derived from apparent wind"


def flag_out_of_range(file: TableFile) -> None:
    """Flag what a channel cannot hold as bad, and constants as not evaluated."""
    for name in map(str, file.table.columns):
        values = file.table[name].to_numpy(float)
        flags = np.full(values.size, Quality.NOT_EVALUATED, dtype=np.uint8)
        outside = np.array([np.isfinite(value) and not BY_NAME[name].holds(value) for value in values])
        flags[outside] = Quality.BAD
        file.qualities[name] = flags


def _wrapped(name: str, values: Floats) -> Floats:
    """Angles that a scale or offset took out of their turn come back into it."""
    if name not in CIRCULAR:
        return values
    channel = BY_NAME[name]
    return np.array([channel.wrapped(value) if np.isfinite(value) else value for value in values])


def _numbers(raw: pd.DataFrame, name: str, path: Path) -> Floats:
    """A column as numbers; a cell that is none is an error that names it."""
    numbers = pd.to_numeric(raw[name], errors="coerce")
    wrong = np.flatnonzero(numbers.isna().to_numpy() & raw[name].notna().to_numpy())
    if wrong.size:
        raise InputError(
            f"column {name!r}, row {wrong[0] + 1} is no number: {raw[name].iloc[wrong[0]]!r}",
            where=str(path),
            why=f"{wrong.size} such cells",
            fix="write missing values as empty cells",
        )
    return numbers.to_numpy(dtype=float)


def _times(column: pd.Series, entry: TimeColumn, path: Path) -> pd.DatetimeIndex:
    """The time column as a UTC index in ns. Raises :class:`InputError` for local times and for no times."""
    if pd.api.types.is_numeric_dtype(column) or entry.format == "seconds":
        return _from_seconds(column, entry, path)
    try:
        times = pd.DatetimeIndex(pd.to_datetime(column, format="ISO8601", utc=entry.zone == "UTC"))
    except ValueError as error:
        raise InputError("time is no ISO 8601 time", where=str(path), why=str(error).splitlines()[0]) from error
    if times.tz is None and entry.zone is None:
        raise InputError(
            "times have no zone",
            where=str(path),
            fix='write them like 2026-05-17T12:00:00Z, or give zone = "UTC" in a map',
        )
    if times.tz is None:
        times = times.tz_localize(entry.zone)
    if times.isna().any():
        raise InputError(f"row {int(np.flatnonzero(times.isna())[0]) + 1} has no time", where=str(path))
    return times.tz_convert("UTC").as_unit("ns").rename("time")


def _from_seconds(column: pd.Series, entry: TimeColumn, path: Path) -> pd.DatetimeIndex:
    seconds = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
    if not np.isfinite(seconds).all():
        row = int(np.flatnonzero(~np.isfinite(seconds))[0]) + 1
        raise InputError(f"row {row} has no time", where=str(path))
    start = pd.Timestamp(entry.start) if entry.start else pd.Timestamp(0, tz="UTC")
    if start.tzinfo is None:
        raise InputError("start of the time column has no zone", where=str(path), fix="add Z to it")
    whole = np.floor(seconds)
    nanoseconds = whole.astype(np.int64) * 1_000_000_000 + np.round((seconds - whole) * 1e9).astype(np.int64)
    return pd.DatetimeIndex(
        pd.to_datetime(nanoseconds + start.as_unit("ns").value, unit="ns", utc=True), name="time"
    ).as_unit("ns")
