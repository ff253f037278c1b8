"""Speed runs with power, from recordings or from tables of run averages, as double runs and power settings.

A table of run averages has one row a run, as yards keep them. Its columns are identified by their names, in any
order; units are part of the names, as ``Speed over ground [kn]`` or ``speed_over_ground_kn``, or in the row below
them. It must have the start and the duration (or the end) of each run, heading, speed over ground, and power or
torque with the shaft speed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats, Linear, unit_conversion
from seatrial.acquisition.core.result import Number
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, RUDDER, circular_mean, drive_named, wrap_360
from seatrial.acquisition.tables import column_names, table_files, time_columns
from seatrial.analysis.manoeuvres import conducted, find, indices, measures, straight_runs
from seatrial.analysis.manoeuvres.motion import Motion, motion_of, shaft_speed_rpm
from seatrial.analysis.tables.table import NANO, table_actuators, times_ns

_POWER = re.compile(r"(?:(?P<shaft>\w+)_)?shaft_(?P<what>power|torque)_(?P<unit>w|kw|mw|nm|knm)")
_TO_KILO = {"w": 1e-3, "kw": 1.0, "mw": 1e3, "nm": 1e-3, "knm": 1.0}
_BLOCKS = 6
ERROR_FREEDOM = _BLOCKS - 2
"""The degrees of freedom of a run's standard errors."""
RUN_MINUTES = 10.0
"""The least that ISO 15016:2015 asks of a run."""
_FEWEST_SAMPLES = 3  # of the power, in each block
TABLE_SUFFIXES = (".csv", ".tsv", ".xlsx", ".xls", ".xlsm", ".ods")
_MOST_RUNS = 200
_NO_DATE = "2000-01-01"  # of runs whose table has times of day alone: only the time between them counts
_SIDES = ("port", "starboard", "centre", "center")
_TRUE_WIND, _RELATIVE_WIND = ("wind_speed", "wind_direction"), ("relative_wind_speed", "relative_wind_direction")
_PLAIN_UNITS = {"deg": "deg", "rpm": "rpm", "degC": "degC"}
"""The units that a column without one can only be in."""
_SUMMED = ("power", "torque", "shaft_speed")


@dataclass(frozen=True, slots=True)
class PowerRun:
    """One run: where it went, how fast over ground and with what power, both means with their standard errors.

    ``speed_mps`` is the way made good along the heading, by the time. ``setting`` is the shaft speed [rpm], of a
    controllable propeller at full pitch, or the cube root of the power [kW] where no shaft speed was recorded;
    ``double_run`` counts the pairs from 1. The wind is the true one at the anemometer, NaN where it was not
    recorded; so are waves and depth, which a table of run averages may have. ``approach_minutes`` is how long the
    ship went steadily before, NaN where not known.
    """

    start: datetime
    end: datetime
    heading_deg: float
    speed_mps: float
    speed_se_mps: float
    power_kw: float
    power_se_kw: float
    setting: float
    wind_from_deg: Number
    wind_mps: Number
    approach_minutes: Number = 0.0
    double_run: int = 0
    wave_height_m: Number = float("nan")
    wave_from_deg: Number = float("nan")
    wave_period_s: Number = float("nan")
    water_depth_m: Number = float("nan")

    @property
    def minutes(self) -> float:
        return float((self.end - self.start).total_seconds() / 60.0)


def power_columns(table: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """By shaft the column of its power, or of its torque with that of its shaft speed, "" for none.

    A column without a shaft's name is the whole ship's and counts alone. Power goes before torque.
    """
    measured = {name for name in map(str, table.columns) if table[name].notna().any()}
    actuators, shafts = table_actuators(table), dict[str, tuple[str, str]]()
    for name in sorted(measured, key=lambda column: "torque" in column):
        if not (match := _POWER.fullmatch(name)):
            continue
        shaft = match["shaft"] or ""
        # A ship's only shaft is meant by any name.
        drive = drive_named(shaft, actuators) or drive_named("", actuators)
        speeds = [f"{shaft}_rpm", f"{shaft}_shaft_rpm", "shaft_rpm", *([drive.channels[0].name] if drive else ())]
        speed = next((column for column in speeds if column in measured), "")
        if match["what"] == "power" or speed:
            shafts.setdefault(shaft, (name, "" if match["what"] == "power" else speed))
    return {"": shafts[""]} if "" in shafts else shafts


def mean_power_kw(table: pd.DataFrame) -> float | None:
    """The mean power at all shafts over a table's rows [kW]; None where it was not recorded."""
    columns = power_columns(table)
    return float(power_kw(columns, lambda name: np.float64(table[name].mean()))) if columns else None


def power_kw(columns: Mapping[str, tuple[str, str]], values_of: Callable[[str], Any]) -> Any:
    """The power at all shafts [kW], of the values of columns of power, or of torque and the shaft's speed [rpm]."""
    powers = []
    for name, speed in columns.values():
        # of either sign: some installations count a shaft that turns to the left as negative
        turning = np.abs(values_of(speed)) * np.pi / 30.0 if speed else 1.0
        powers.append(values_of(name) * _TO_KILO[name.rpartition("_")[2]] * turning)
    return np.sum(powers, axis=0)


def power_runs(
    table: pd.DataFrame, events: Iterable[tuple[int, str]] = ()
) -> tuple[list[PowerRun], list[indices.LeftOut]]:
    """The speed runs in a table of samples that have power, and the stretches that are none, with the reason.

    ``events`` are (time [ns since 1970], text) as in a recording: runs that the crew marked are the only ones then,
    and of a conducted programme those that were valid.
    Raises :class:`InputError` where neither the power nor the torque and the speed of a shaft were recorded.
    """
    columns = power_columns(table)
    if not columns:
        raise InputError(
            "has no shaft power", where=str(table.attrs.get("recording", "table")),
            why="the analysis relates speed to power",
            fix="record or import shaft_power_kw, or shaft_torque_knm with the"
            " shaft's rpm; `engine_room` in trials/packs has both",
        )  # fmt: skip
    poses = table[[name for name in POSE_AND_VELOCITY if name in table]]
    poses.attrs = {name: value for name, value in table.attrs.items() if name != "actuators"}
    motion = motion_of(poses.assign(**{RUDDER: 0.0}))  # any helm: runs are straight by the heading

    def on_grid(name: str) -> Floats:
        samples = table[name].dropna().sort_index()
        seconds = (times_ns(samples.to_frame()) - motion.origin_ns) / NANO
        return np.asarray(np.interp(motion.time_s, seconds, samples.to_numpy(dtype=float)))

    power = power_kw(columns, on_grid)
    recorded = table.columns[table.notna().any()]
    drives = [drive for drive in table_actuators(table) if drive.drives and drive.channels[0].name in recorded]
    names = [channel.name for drive in drives for channel in drive.channels if channel.name in recorded]
    controls = pd.DataFrame({name: on_grid(name) for name in names})
    shafts = [np.abs(shaft_speed_rpm(controls, drive)) for drive in drives]
    setting = np.mean(shafts, axis=0) if shafts else np.cbrt(power)
    motion = replace(motion, drives={"setting": setting}, thrust=np.sign(setting) * setting**2)
    smooth = measures.smooth_motion(motion, max(measures.WIDEST_S, 3 * motion.step_s))
    runs, left_out = list[PowerRun](), list[indices.LeftOut]()
    for begun, first, end, excluded in _rows_of_runs(motion, smooth, list(events)):
        start, stop = (motion.utc(motion.time_s[row]) for row in (first, end - 1))
        part = table.loc[start:stop]
        why = excluded or straight_runs.why_no_speed_run(motion, smooth, first, end)
        if not why and part[[name for name, _ in columns.values()]].count().min() < _FEWEST_SAMPLES * _BLOCKS:
            why = "its power was hardly measured"
        if why:
            left_out.append(indices.LeftOut("speed_run", start, stop, why))
        else:
            runs.append(_measure_run(motion, part, power, begun, first, end))
    return runs, left_out


def _rows_of_runs(
    motion: Motion, smooth: Motion, events: Sequence[tuple[int, str]]
) -> list[tuple[int, int, int, str]]:
    """Of each run the row at which its steady stretch begins, its first row, its end, and why it does not count.

    A run is what the crew marked ("run 1 start", "run 1 end"), and a speed run of a conducted programme from its
    order to its end. Without marks every other stretch is one, by its last ten minutes: what lies before is the
    approach, on which the ship regains the speed that a turn has cost.
    """
    free = np.ones(motion.time_s.size, dtype=bool)
    stretches = straight_runs.straight_stretches(motion, smooth, free, bridge_s=straight_runs.LEAST_RUN_S)
    programme = conducted.conducted_runs(events)
    crew = [event for event in events if not conducted.is_mark_of_run(event[1])]
    marks = [mark for mark in find.pair_event_marks(crew) if re.search(r"\brun\b", mark.text, re.I)]
    least, longest = straight_runs.LEAST_RUN_S / motion.step_s, round(60.0 * RUN_MINUTES / motion.step_s) + 1

    def rows_of(start_ns: int, end_ns: int) -> tuple[int, int]:
        start, end = np.searchsorted(motion.time_s, (np.array([start_ns, end_ns]) - motion.origin_ns) / NANO)
        return int(start), int(end)

    def stretches_in(start: int, stop: int) -> list[tuple[int, int, int]]:
        cut = [(first, max(first, start), min(end, stop)) for first, end in stretches]
        return [span for span in cut if span[2] - span[1] >= least]

    runs, led = list[tuple[int, int, int, str]](), list[tuple[int, int]]()
    for run in programme:
        first, end = rows_of(run.ordered.value, run.span[1].value) if run.ordered and run.span else (0, 0)
        if run.is_speed_run and end > first:  # else it is in another recording
            steady = [] if run.why_not_counted else [(*span, "") for span in stretches_in(first, end)]
            why = run.why_not_counted or f"run {run.number} has no steady straight stretch of half a minute"
            runs, led = [*runs, *(steady or [(first, first, end, why)])], [*led, (first, end)]
    unled = [(first, max(first, end - longest), end) for first, end in stretches]
    if marks:
        unled = [span for mark in marks for span in stretches_in(*rows_of(mark.start_ns, mark.end_ns))]
    for begun, first, end in unled:
        if not any(first < stop and start < end for start, stop in led):
            start = motion.utc(motion.time_s[first])
            runs.append((begun, first, end, conducted.uncounted_reason(start, programme)))
    return sorted(runs)


def _speed_along(motion: Motion, edges: Floats) -> Floats:
    """The speed made good along the mean heading between rows [m/s]."""
    heading = np.deg2rad(float(circular_mean(motion.heading_deg[edges[0] : edges[-1] + 1])))
    north, east, time_s = (np.diff(column[edges]) for column in (motion.north_m, motion.east_m, motion.time_s))
    return np.asarray((north * np.cos(heading) + east * np.sin(heading)) / time_s)


def _measure_run(motion: Motion, part: pd.DataFrame, power: Floats, begun: int, first: int, end: int) -> PowerRun:
    """The run of rows ``first`` to ``end``, of a stretch that began at ``begun``, with its samples ``part``."""
    edges = np.linspace(first, end - 1, _BLOCKS + 1).astype(int)
    speeds = _speed_along(motion, edges)
    powers = np.array([power[a:b].mean() for a, b in pairwise(edges)])
    wind, air = complex("nan+nanj"), part.reindex(columns=["wind_direction_deg", "wind_speed_mps"])
    if (samples := air.ffill().dropna().to_numpy(dtype=float)).size:
        wind = np.mean(samples[:, 1] * np.exp(1j * np.deg2rad(samples[:, 0])))  # as a vector, where it comes from
    return PowerRun(
        motion.utc(motion.time_s[first]), motion.utc(motion.time_s[end - 1]),
        float(wrap_360(circular_mean(motion.heading_deg[first:end]))),
        float(_speed_along(motion, edges[[0, -1]])[0]), _standard_error(speeds),
        float(powers.mean()), _standard_error(powers), float(motion.main_rpm[first:end].mean()),
        float(np.rad2deg(np.angle(wind)) % 360.0), float(abs(wind)),
        float(motion.time_s[first] - motion.time_s[begun]) / 60.0,
    )  # fmt: skip


def _standard_error(blocks: Floats) -> float:
    """The standard error of a mean from the means of blocks, an even drift taken out: a current makes one."""
    rows = np.arange(blocks.size)
    residual = blocks - np.polyval(np.polyfit(rows, blocks, 1), rows)
    return float(np.sqrt(residual @ residual / ERROR_FREEDOM / blocks.size))


def double_runs(runs: Iterable[PowerRun]) -> tuple[list[PowerRun], list[indices.LeftOut]]:
    """The runs that make :func:`reciprocal_pairs`, numbered by pairs; of the others the current is not known."""
    ordered = sorted(runs, key=lambda run: run.start)
    pairs = straight_runs.reciprocal_pairs(
        [straight_runs.Course(run.start, run.end, run.heading_deg, run.setting) for run in ordered]
    )
    number = {place: count for count, pair in enumerate(pairs, start=1) for place in pair}
    reason = "no run on the reciprocal course at this power within two hours"
    left_out = [indices.LeftOut("speed_run", run.start, run.end, reason)
                for place, run in enumerate(ordered) if place not in number]  # fmt: skip
    return [replace(ordered[place], double_run=number[place]) for place in sorted(number)], left_out


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
_CALLED = {name: quantity for quantity, definition in _QUANTITIES.items() for name in definition.names}


@dataclass(frozen=True, slots=True)
class RunTable:
    """The runs in a table, the conditions in it, and the columns that were not used."""

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
    raw = table_files.read_raw_table(path)
    try:
        return runs_in_table(raw.columns, {str(name): unit for name, unit in raw.units.items() if unit})
    except InputError as error:
        raise error.at(str(path)) from error


def runs_in_table(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> RunTable:
    """The runs in a table with a row for each; ``units`` are those of columns that do not name theirs.

    Averages have no standard error of their own, and what came before a run is not known.

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
    read = {
        name: _combine_columns_of_sides(name, table, matches)
        for name, matches in columns.items()
        if _QUANTITIES[name].unit
    }
    heading, speed = _required_column(read, "heading"), _required_column(read, "speed")
    if "power" in read or "torque" not in read:
        power = _required_column(read, "power")
    else:
        power = 1e-3 * _required_column(read, "torque") * _required_column(read, "shaft_speed") * np.pi / 30.0
    nothing, setting = np.full(len(start), np.nan), read.get("shaft_speed", np.cbrt(power))
    sea = [read.get(name, nothing) for name in ("wave_height", "wave_direction", "wave_period", "water_depth")]
    end = start + pd.to_timedelta(seconds, unit="s")
    averages = (wrap_360(heading), speed, power, setting, *_wind_of(read), *sea)
    runs = []
    for begun, ended, *values in zip(start, end, *averages, strict=True):
        course, mps, kw, rpm, wind_from, wind, *waves = map(float, values)
        runs.append(PowerRun(
            begun.to_pydatetime(), ended.to_pydatetime(), course, mps, 0.0, kw, 0.0, rpm, wind_from, wind,
            float("nan"), 0, *waves,
        ))  # fmt: skip
    means = {name: float(np.nanmean(values)) for name, values in read.items() if np.isfinite(values).any()}
    draught, trim = means.get("draught"), None
    if (fore := means.get("draught_fore")) is not None and (aft := means.get("draught_aft")) is not None:
        draught, trim = 0.5 * (fore + aft), aft - fore
    temperature = means.get("water_temperature")
    conditions = Conditions(draught_m=draught, trim_m=trim, water_temperature_degc=temperature)
    return RunTable(tuple(runs), conditions, passed_over)


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
        head = column_names.split_header(name)
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
        ship_columns = [column for column in columns if not column.is_of_side]
        if len(ship_columns) > 1:
            names = " and ".join(repr(column.name) for column in ship_columns)
            raise InputError(f"columns {names} are the same quantity", fix="keep one of them")
        passed_over += [column.name for column in columns if ship_columns and column.is_of_side]
        read[quantity] = ship_columns or columns
    return read, tuple(passed_over)


def _usual_unit(house: str) -> str:
    return {"m/s": "kn", "s": "min"}.get(house, house)


def _combine_columns_of_sides(quantity: str, table: pd.DataFrame, columns: list[_Column]) -> Floats:
    """A quantity in its unit, NaN for empty cells: the sum of the power and the mean of the rest over the sides of
    the ship."""
    kind, sides = _QUANTITIES[quantity], []
    for column in columns:
        cells = table[column.name].replace("", np.nan)
        values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
        if bad := [cell for cell, value in zip(cells, values, strict=True) if pd.notna(cell) and np.isnan(value)]:
            raise InputError(
                f"column {column.name!r} holds {str(bad[0])!r}", fix="write a number, with a decimal point"
            )
        minutes = kind.unit == "s" and column.unit == "min"
        scale = Linear(60.0) if minutes else unit_conversion(kind.unit, column.unit)
        converted = scale.scale * values + scale.offset
        beyond = np.flatnonzero((converted < kind.low) | (converted > kind.high))
        if beyond.size:
            raise InputError(
                f"column {column.name!r} holds {values[beyond[0]]:g} in run {beyond[0] + 1}",
                why=f"in {kind.unit} it can be {kind.low:g} to {kind.high:g}", fix="check the number and the unit",
            )  # fmt: skip
        sides.append(converted)
    total = np.sum if quantity in ("power", "torque") else np.mean
    return np.asarray(total(np.array(sides), axis=0))


def _required_column(columns: Mapping[str, Floats], name: str) -> Floats:
    if name not in columns:
        kind = _QUANTITIES[name]
        raise InputError(
            f"has no column for the {name.replace('_', ' ')}",
            fix=f"name it {kind.names[0]!r}, with its unit, as [{_usual_unit(kind.unit)}]",
        )
    values = columns[name]
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
        raise InputError(f"has no {name.replace('_', ' ')} in run {row}", fix="fill the cell, or leave the row out")
    return values


def _wind_of(columns: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    """Where the true wind comes from [deg] and its speed [m/s]: as given, else from the relative wind."""
    heading, speed = (_required_column(columns, name) for name in ("heading", "speed"))
    for first, second in (_TRUE_WIND, _RELATIVE_WIND):
        if (first in columns) != (second in columns):
            raise InputError(
                f"has no column for the {(second if first in columns else first).replace('_', ' ')}",
                why="the wind is known by speed and direction",
            )
    if _TRUE_WIND[0] in columns:
        return columns[_TRUE_WIND[1]], columns[_TRUE_WIND[0]]
    if _RELATIVE_WIND[0] not in columns:
        return np.full_like(heading, np.nan), np.full_like(heading, np.nan)
    ahead = np.exp(1j * np.deg2rad(heading))
    relative = columns[_RELATIVE_WIND[0]] * np.exp(1j * np.deg2rad(columns[_RELATIVE_WIND[1]]))
    true_wind = (relative - speed) * ahead
    return np.asarray(np.rad2deg(np.angle(true_wind)) % 360.0), np.asarray(np.abs(true_wind))


def _times_of(table: pd.DataFrame, columns: Mapping[str, list[_Column]]) -> tuple[pd.DatetimeIndex, Floats]:
    """When each run began, and how long it was [s]."""
    if "start" not in columns:
        raise InputError("has no column for the start of the runs", fix="name it 'start', as 2026-05-01 08:12")
    start = _stamps(table, columns, "start")
    if "duration" in columns:
        seconds = _combine_columns_of_sides("duration", table, columns["duration"])
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
    text = time_columns.clock_times_as_text(table[name]).astype(str).str.strip()
    is_clock = bool(text.str.fullmatch(r"\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?").all())
    if is_clock:
        days = time_columns.dates_with_separators(table[columns["date"][0].name]) if "date" in columns else _NO_DATE
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
