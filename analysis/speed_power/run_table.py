"""Tables of run averages, one row a run, as yards keep them: read into runs and conditions.

Columns are found by what they are called, whatever their order; units stand in the names, as ``Speed over ground
[kn]`` or ``speed_over_ground_kn``, or in the row below them. A table must have the start and the duration (or the
end) of each run, heading, speed over ground, and power or torque with the shaft speed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats, Linear, to_house
from seatrial.acquisition.core.ship import wrap_360
from seatrial.acquisition.tables.column_names import headed
from seatrial.acquisition.tables.table_files import RawTable, read_raw
from seatrial.acquisition.tables.time_columns import as_clock, as_date
from seatrial.analysis.speed_power.runs import PowerRun

TABLE_SUFFIXES = (".csv", ".tsv", ".xlsx", ".xls", ".xlsm", ".ods")
_MOST_RUNS = 200
_NO_DATE = "2000-01-01"  # of runs whose table has times of day alone: only the time between them counts
_SIDES = ("port", "starboard", "centre", "center")


@dataclass(frozen=True, slots=True)
class _Quantity:
    """A quantity of a run: what its column may be called, the unit it is read in, and what can be."""

    names: tuple[str, ...]
    unit: str = ""
    low: float = 0.0
    high: float = 0.0


_QUANTITIES = {
    "start": _Quantity(("start", "start time", "time", "begin", "start of run", "date time", "datetime")),
    "date": _Quantity(("date",)),
    "end": _Quantity(("end", "end time", "end of run", "stop")),
    "duration": _Quantity(("duration", "run duration", "run time"), "s", 1.0, 86_400.0),
    "heading": _Quantity(("heading", "ship heading", "hdg", "true heading", "mean heading"), "deg", -360.0, 720.0),
    "speed": _Quantity(("speed over ground", "ground speed", "sog", "gps speed"), "m/s", 0.1, 40.0),
    "power": _Quantity(("shaft power", "power", "measured power", "total shaft power"), "kW", 0.1, 2e5),
    "torque": _Quantity(("shaft torque", "torque"), "Nm", 1.0, 1e8),
    "shaft_speed": _Quantity(
        ("shaft speed", "rpm", "shaft rpm", "propeller speed", "revolutions", "propeller rpm"), "rpm", 0.1, 1e4
    ),
    "relative_wind_speed": _Quantity(
        ("relative wind speed", "rel wind speed", "apparent wind speed"), "m/s", 0.0, 100.0
    ),
    "relative_wind_direction": _Quantity(
        ("relative wind direction", "relative wind angle", "rel wind direction", "rel wind angle",
         "apparent wind direction", "apparent wind angle"), "deg", -360.0, 720.0,
    ),
    "wind_speed": _Quantity(("true wind speed",), "m/s", 0.0, 100.0),
    "wind_direction": _Quantity(("true wind direction", "true wind from"), "deg", -360.0, 720.0),
    "wave_height": _Quantity(("wave height", "significant wave height", "hs"), "m", 0.0, 30.0),
    "wave_direction": _Quantity(("wave direction", "true wave direction", "wave from"), "deg", -360.0, 720.0),
    "wave_period": _Quantity(("wave period", "mean wave period", "t01"), "s", 0.5, 40.0),
    "water_depth": _Quantity(("water depth", "depth"), "m", 0.5, 12_000.0),
    "water_temperature": _Quantity(
        ("water temperature", "sea temperature", "seawater temperature"), "degC", -2.0, 40.0
    ),
    "draught_fore": _Quantity(("draught fore", "draft fore", "draught forward", "draft forward"), "m", 0.1, 40.0),
    "draught_aft": _Quantity(("draught aft", "draft aft"), "m", 0.1, 40.0),
    "draught": _Quantity(("draught", "draft", "mean draught", "mean draft"), "m", 0.1, 40.0),
}  # fmt: skip
_TRUE_WIND, _RELATIVE_WIND = ("wind_speed", "wind_direction"), ("relative_wind_speed", "relative_wind_direction")
_PLAIN_UNITS = {"deg": "deg", "rpm": "rpm", "degC": "degC"}
"""The units that a column without one can only be in."""
_SUMMED = ("power", "torque", "shaft_speed")
_CALLED = {name: quantity for quantity, each in _QUANTITIES.items() for name in each.names}


@dataclass(frozen=True, slots=True)
class RunTable:
    """The runs in a table, what it tells of the conditions, and the columns that were not used."""

    runs: tuple[PowerRun, ...]
    conditions: Conditions
    passed_over: tuple[str, ...]


def is_run_table(path: Path | str) -> bool:
    """Whether a file is a table, by its name, and no recording."""
    return Path(path).suffix.lower() in TABLE_SUFFIXES


def read_run_table(path: Path | str) -> RunTable:
    """The runs in a file: CSV, TSV or a workbook of Excel or LibreOffice, of which the fullest sheet is read.

    Raises :class:`InputError` for what is no table of run averages, with the columns that it lacks.
    """
    raw = read_raw(path)
    try:
        return runs_in_table(raw.columns, _units_of(raw))
    except InputError as error:
        raise error.at(str(path)) from error


def _units_of(raw: RawTable) -> dict[str, str]:
    return {str(name): unit for name, unit in raw.units.items() if unit}


def runs_in_table(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> RunTable:
    """The runs in a table with a row for each; ``units`` are those of columns that do not name theirs.

    Parameters
    ----------
    table
        Columns as in :func:`read_run_table`; a relative wind direction is off the bow, clockwise, true ones are
        where wind and waves come from.
    units
        Units by column.

    Raises
    ------
    InputError
        For a column that is missing, has no unit or holds text, and for more than 200 rows.
    """
    table = table.dropna(how="all")
    if not 0 < len(table) <= _MOST_RUNS:
        raise InputError(
            f"has {len(table)} rows, which are no runs", why=f"a table of run averages has 1 to {_MOST_RUNS}",
            fix="give one row a run; `seatrial import` makes a recording of a table of samples",
        )  # fmt: skip
    columns, passed_over = _columns_of(table, units or {})
    start, seconds = _times_of(table, columns)
    read = {name: _mean_or_sum(name, table, found) for name, found in columns.items() if _QUANTITIES[name].unit}
    return RunTable(tuple(_runs(start, seconds, read)), _conditions_of(read), passed_over)


def _runs(start: pd.DatetimeIndex, seconds: Floats, read: Mapping[str, Floats]) -> Iterator[PowerRun]:
    """The runs of rows: averages have no standard error of their own, and what came before is not known."""
    nothing = np.full(len(start), np.nan)
    heading, speed, power = _required(read, "heading"), _required(read, "speed"), _power_of(read)
    setting = read.get("shaft_speed", np.cbrt(power))
    sea = [read.get(name, nothing) for name in ("wave_height", "wave_direction", "wave_period", "water_depth")]
    end = start + pd.to_timedelta(seconds, unit="s")
    columns = (wrap_360(heading), speed, power, setting, *_wind_of(read), *sea)
    for begun, ended, *values in zip(start, end, *columns, strict=True):
        course, mps, kw, rpm, wind_from, wind, *waves = map(float, values)
        yield PowerRun(
            begun.to_pydatetime(), ended.to_pydatetime(), course, mps, 0.0, kw, 0.0, rpm, wind_from, wind,
            float("nan"), 0, *waves,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    unit: str
    is_of_side: bool


def _columns_of(table: pd.DataFrame, units: Mapping[str, str]) -> tuple[dict[str, list[_Column]], tuple[str, ...]]:
    """By quantity its columns, several only for the sides of the ship; and those that are none.

    Power of the whole ship counts alone.
    """
    read, passed_over = dict[str, list[_Column]](), list[str]()
    for name in map(str, table.columns):
        head = headed(name)
        words = re.sub(r"[^a-z0-9]+", " ", re.sub(r"\((?:utc|true|mean)\)", "", head.name.lower())).split()
        sides = [word for word in words if word in _SIDES]
        quantity = _CALLED.get(" ".join(word for word in words if word not in _SIDES))
        if quantity is None or (sides and quantity not in _SUMMED):
            passed_over.append(name)
            continue
        house = _QUANTITIES[quantity].unit
        unit = head.units[0] if head.units else units.get(name, _PLAIN_UNITS.get(house, ""))
        if house and not unit:
            raise InputError(
                f"column {name!r} has no unit", fix=f"name it with one, as '{name} [{_usual_unit(house)}]'"
            )
        read.setdefault(quantity, []).append(_Column(name, unit, bool(sides)))
    for quantity, columns in read.items():
        whole = [column for column in columns if not column.is_of_side]
        if len(whole) > 1:
            names = " and ".join(repr(column.name) for column in whole)
            raise InputError(f"columns {names} are the same quantity", fix="keep one of them")
        passed_over += [column.name for column in columns if whole and column.is_of_side]
        read[quantity] = whole or columns
    return read, tuple(passed_over)


def _usual_unit(house: str) -> str:
    return {"m/s": "kn", "s": "min"}.get(house, house)


def _mean_or_sum(quantity: str, table: pd.DataFrame, columns: list[_Column]) -> Floats:
    """A quantity in its unit: the sum of the power and the mean of the rest over the sides of the ship."""
    values = np.array([_numbers(table, column, quantity) for column in columns])
    return np.asarray(values.sum(axis=0) if quantity in ("power", "torque") else values.mean(axis=0))


def _numbers(table: pd.DataFrame, column: _Column, quantity: str) -> Floats:
    """A column in the unit of its quantity; NaN for empty cells."""
    kind = _QUANTITIES[quantity]
    cells = table[column.name].replace("", np.nan)
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
    if bad := [cell for cell, value in zip(cells, values, strict=True) if pd.notna(cell) and np.isnan(value)]:
        raise InputError(
            f"column {column.name!r} holds {str(bad[0])!r}", fix="write a number, with a decimal point"
        )
    minutes = kind.unit == "s" and column.unit == "min"
    scale = Linear(60.0) if minutes else to_house(kind.unit, column.unit)
    converted = scale.scale * values + scale.offset
    beyond = np.flatnonzero((converted < kind.low) | (converted > kind.high))
    if beyond.size:
        raise InputError(
            f"column {column.name!r} holds {values[beyond[0]]:g} in run {beyond[0] + 1}",
            why=f"in {kind.unit} it can be {kind.low:g} to {kind.high:g}", fix="check the number and the unit",
        )  # fmt: skip
    return np.asarray(converted)


def _required(read: Mapping[str, Floats], name: str) -> Floats:
    if name not in read:
        kind = _QUANTITIES[name]
        raise InputError(
            f"has no column for the {name.replace('_', ' ')}",
            fix=f"name it {kind.names[0]!r}, with its unit, as [{_usual_unit(kind.unit)}]",
        )
    values = read[name]
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
        raise InputError(f"has no {name.replace('_', ' ')} in run {row}", fix="fill the cell, or leave the row out")
    return values


def _power_of(read: Mapping[str, Floats]) -> Floats:
    if "power" in read or "torque" not in read:
        return _required(read, "power")
    return 1e-3 * _required(read, "torque") * _required(read, "shaft_speed") * np.pi / 30.0


def _wind_of(read: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    """Where the true wind comes from [deg] and its speed [m/s]: as given, else from the relative wind."""
    heading, speed = (_required(read, name) for name in ("heading", "speed"))
    for one, other in (_TRUE_WIND, _RELATIVE_WIND):
        if (one in read) != (other in read):
            raise InputError(
                f"has no column for the {(other if one in read else one).replace('_', ' ')}",
                why="the wind is known by speed and direction",
            )
    if _TRUE_WIND[0] in read:
        return read[_TRUE_WIND[1]], read[_TRUE_WIND[0]]
    if _RELATIVE_WIND[0] not in read:
        return np.full_like(heading, np.nan), np.full_like(heading, np.nan)
    ahead = np.exp(1j * np.deg2rad(heading))
    relative = read[_RELATIVE_WIND[0]] * np.exp(1j * np.deg2rad(read[_RELATIVE_WIND[1]]))
    true = (relative - speed) * ahead
    return np.asarray(np.rad2deg(np.angle(true)) % 360.0), np.asarray(np.abs(true))


def _times_of(table: pd.DataFrame, columns: Mapping[str, list[_Column]]) -> tuple[pd.DatetimeIndex, Floats]:
    """When each run began, and how long it was [s]."""
    if "start" not in columns:
        raise InputError("has no column for the start of the runs", fix="name it 'start', as 2026-05-01 08:12")
    start = _stamps(table, columns, "start")
    if "duration" in columns:
        seconds = _mean_or_sum("duration", table, columns["duration"])
    elif "end" in columns:
        end = _stamps(table, columns, "end")
        seconds = np.asarray((end - start).total_seconds(), dtype=float) % 86_400.0
    else:
        raise InputError(
            "has no column for the duration of the runs", fix="name it 'duration [min]', or give 'end'"
        )
    if not (np.isfinite(seconds).all() and (seconds > 0.0).all()):
        raise InputError("has a run without a duration", fix="fill the cell, or leave the row out")
    return start, seconds


def _stamps(table: pd.DataFrame, columns: Mapping[str, list[_Column]], quantity: str) -> pd.DatetimeIndex:
    """Times as text or cells of a sheet; without a date the runs are taken to begin on one day, in their order."""
    name = columns[quantity][0].name
    text = as_clock(table[name]).astype(str).str.strip()
    is_clock = bool(text.str.fullmatch(r"\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?").all())
    if is_clock:
        days = as_date(table[columns["date"][0].name]) if "date" in columns else _NO_DATE
        text = days + " " + text.str.zfill(5)
    text = text.str.replace(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})", r"\3-\2-\1", regex=True)
    try:
        stamps = pd.DatetimeIndex(pd.to_datetime(text, utc=True, format="ISO8601"))
    except ValueError as error:
        raise InputError(
            f"column {name!r} holds no time: {text.iloc[0]!r}", fix="write times as 2026-05-01 08:12, in UTC"
        ) from error
    if stamps.isna().any():
        raise InputError(f"column {name!r} has an empty cell", fix="fill it, or leave the row out")
    if is_clock and "date" not in columns:
        past_midnight = np.concatenate([[0], np.cumsum(np.diff(stamps.asi8) < 0)])
        stamps = stamps + pd.to_timedelta(past_midnight, unit="D")
    return stamps


def _conditions_of(read: Mapping[str, Floats]) -> Conditions:
    """What the table tells of the loading and the water: means over the runs."""
    known = {name: float(np.nanmean(values)) for name, values in read.items() if np.isfinite(values).any()}
    fore, aft = known.get("draught_fore"), known.get("draught_aft")
    water = known.get("water_temperature")
    if fore is None or aft is None:
        return Conditions(draught_m=known.get("draught"), water_temperature_degc=water)
    return Conditions(draught_m=0.5 * (fore + aft), trim_m=aft - fore, water_temperature_degc=water)
