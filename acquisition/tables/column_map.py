"""Applies a column map, the TOML file that states what a foreign table's columns are, to the table.

Units, signs, constants, positions, apparent wind and quaternions become the contract's channels. Other channels are
derived by the recorder's equations (:mod:`seatrial.acquisition.logger.processing`), or by slopes of position and
heading. A hemisphere that is misread mirrors the track: unknown words are refused, and an O, east in some languages
and west in others, is decided by its neighbours or asked.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import field, replace
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
import pymap3d
from pydantic import AfterValidator, ConfigDict, ValidationInfo
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config import declarations, run_sheet, sources
from seatrial.acquisition.core import files, quantities
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.tables import column_names, time_columns
from seatrial.acquisition.tables.log_frames import wind_towards
from seatrial.acquisition.tables.table_files import RawTable, TableFile, non_numeric_cells, parse_numbers


def _checked_channel(name: str, info: ValidationInfo) -> str:
    declared = (info.context or {}).get("declared", ())
    return (
        name
        if ships.find_channel(name, ships.channels_with_declared(declared))
        else sources.check_channel(name, declared=declared)
    )


AnyChannel = Annotated[str, AfterValidator(_checked_channel)]
_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class Column(declarations.Conversion):
    """One channel's column, or a constant where the table has none; a ``scale`` of -1 inverts the sign.

    Numbers that are ``missing`` in the table stand for no value.
    """

    column: str | None = None
    constant: float | None = None
    missing: tuple[float, ...] = ()


AS_TEXT = "text"


def _checked_angle_unit(unit: str) -> str:
    if unit in (quantities.DEGREES_AND_MINUTES, AS_TEXT):
        return unit
    try:
        quantities.unit_scale("deg", unit)
    except ConfigurationError as error:
        raise ValueError(f"is neither deg nor {quantities.DEGREES_AND_MINUTES}, {AS_TEXT}, rad, degE7") from error
    return unit


@dataclass(frozen=True, config=_STRICT)
class Position:
    """Latitude and longitude columns that ``north_m`` and ``east_m`` are made from.

    In degrees, in ``ddmm`` (degrees and minutes in one number), or as ``text`` such as 62°28.146'N; the letters N
    or S and E or W may be in separate columns; ``o_is`` states what an O means if no other letter decides.
    Parts are the columns of minutes and of seconds beside whole degrees.
    Numbers that are ``missing`` stand for no fix, as do the cells ``no_fix`` of the column ``fix``, where course
    and speed over ground are left out as well.
    """

    latitude: str
    longitude: str
    unit: Annotated[str, AfterValidator(_checked_angle_unit)] = "deg"
    north_south: str | None = None
    east_west: str | None = None
    missing: tuple[float, ...] = ()
    o_is: Literal["east", "west"] | None = None
    latitude_parts: tuple[str, ...] = ()
    longitude_parts: tuple[str, ...] = ()
    fix: str | None = None
    no_fix: tuple[str, ...] = ("0", "V")

    def lost_fix_mask(self, cells: pd.Series[Any]) -> Bools:
        """Which cells [n] of the column ``fix`` say that there is none."""
        return np.asarray(cells_as_names(cells).isin(self.no_fix))


@dataclass(frozen=True, config=_STRICT)
class Orientation:
    """The columns of a quaternion; ``frame`` "enu" is that of ROS (REP 103: x ahead, y to port, east-north-up)."""

    x: str
    y: str
    z: str
    w: str
    frame: Literal["enu", "ned"] = "enu"


@dataclass(frozen=True, config=_STRICT)
class WindFromBow:
    """Wind by the direction it comes from, relative to the bow and ``positive`` to a side, and its speed.

    Wind that is apparent, past the ship, becomes true with the ship's heading, surge and sway; true wind needs the
    heading only.
    """

    angle: str
    speed: str
    angle_unit: str = "deg"
    speed_unit: str = "m/s"
    positive: Literal["starboard", "port"] = "starboard"


@dataclass(frozen=True, config=_STRICT)
class Velocity:
    """The columns of a velocity to north and to east, that of the ship, from which surge and sway follow with the
    heading, or of the air; ``north`` may be ``positive`` to the south."""

    north: str
    east: str
    unit: str = "m/s"
    positive: Literal["north", "south"] = "north"


def _checked_derivation(name: str) -> str:
    if name not in DERIVED:
        raise ValueError(f"cannot be derived; {', '.join(DERIVED)} can")
    return name


@dataclass(frozen=True, config=_STRICT)
class LongLayout:
    """The columns of a long table, which has a row for each value: the variable, its value, perhaps its unit."""

    variable: str = "variable"
    value: str = "value"
    unit: str | None = None


@dataclass(frozen=True, config=_STRICT)
class OnlyRows:
    """The rows that are taken: those with a value in a column, such as a ship's number in a table of several."""

    column: str
    value: str

    def select(self, raw: RawTable) -> RawTable:
        """A table with these rows only."""
        is_taken = cells_as_names(raw.columns[self.column]) == self.value
        return replace(raw, columns=raw.columns[is_taken].reset_index(drop=True))


def cells_as_names(cells: pd.Series[Any]) -> pd.Series[Any]:
    """Cells as text, whole numbers without decimals; missing ones are empty."""
    return cells.map(
        lambda cell: f"{cell:.0f}" if isinstance(cell, float) and cell.is_integer() else str(cell).strip()
    ).where(cells.notna(), "")


@dataclass(frozen=True, config=_STRICT)
class ColumnMap:
    """A column map. ``absent`` names channels that the table lacks, ``derive`` those computed from others.

    With ``long`` the variables of a long table are its columns. ``actuator`` lists the ship's, as in a vessel file.
    Rows without a time or with text for a number are an error, or dropped and counted if ``unreadable_rows`` is
    "drop". With ``stalled_rows`` "drop" the motion of :func:`stalled_row_mask` is left out, and counted.
    """

    time: time_columns.TimeColumn
    only: OnlyRows | None = None
    long: LongLayout | None = None
    actuator: tuple[sources.ActuatorSection, ...] = ()
    channel: tuple[declarations.ChannelSection, ...] = ()
    pack: tuple[declarations.PackSection, ...] = ()
    unreadable_rows: Literal["refuse", "drop"] = "refuse"
    stalled_rows: Literal["keep", "drop"] = "keep"
    channels: dict[AnyChannel, Column] = field(default_factory=dict)
    position: Position | None = None
    apparent_wind: WindFromBow | None = None
    true_wind: WindFromBow | None = None
    wind_velocity: Velocity | None = None
    orientation: Orientation | None = None
    velocity: Velocity | None = None
    trial: run_sheet.RunSheet = field(default_factory=run_sheet.RunSheet)
    conditions: run_sheet.Conditions = field(default_factory=run_sheet.Conditions)
    context: run_sheet.Context = field(default_factory=run_sheet.Context)
    instruments: run_sheet.InstrumentsSection = field(default_factory=run_sheet.InstrumentsSection)
    particulars: run_sheet.Particulars = field(default_factory=run_sheet.Particulars)
    absent: tuple[AnyChannel, ...] = ()
    derive: tuple[Annotated[str, AfterValidator(_checked_derivation)], ...] = ()

    @property
    def actuators(self) -> ships.Actuators:
        """The ship's actuators, none if the map does not list them."""
        return tuple(ships.Actuator(actuator.name, actuator.kind) for actuator in self.actuator)

    @property
    def numeric_columns(self) -> tuple[str, ...]:
        """The table's columns that must hold numbers."""
        names = [entry.column for entry in self.channels.values()]
        if self.position and self.position.unit != AS_TEXT:
            names += [self.position.latitude, self.position.longitude]
            names += [*self.position.latitude_parts, *self.position.longitude_parts]
        for wind in filter(None, (self.apparent_wind, self.true_wind)):
            names += [wind.angle, wind.speed]
        if self.orientation:
            names += [getattr(self.orientation, part) for part in "xyzw"]
        for velocity in filter(None, (self.velocity, self.wind_velocity)):
            names += [velocity.north, velocity.east]
        return tuple(dict.fromkeys(name for name in names if name is not None))


def parse_column_map(text: str, path: Path | str) -> tuple[ColumnMap, ships.Declared]:
    """The map in a text that is, or will be, at ``path``, and the channels it declares.

    Raises :class:`ConfigurationError` naming the line.
    """
    columns, ship = sources.parse_with_declarations(text, path, ColumnMap)
    declared = tuple(
        declaration.channel for declaration in ship.declared if declaration.channel.group == "declared"
    )
    channels = ships.channels_with_declared(declared)
    for name, column in columns.channels.items():
        fault = ""
        if (column.column is None) == (column.constant is None):
            fault = "needs either a column or a constant"
        else:
            try:
                column.conversion_to_channel(channels[name])
            except ConfigurationError as error:
                fault = str(error)
        if fault:
            line = files.line_of_toml_key(text, ["channels", name, "unit"])
            raise ConfigurationError(f"{name}: {fault}", where=f"{path}, line {line}")
    if columns.time.in_name and (columns.time.start or not columns.time.zone or columns.time.format == "iso"):
        what = "in_name is for seconds, with a zone and without a start"
        raise ConfigurationError(what, where=f"{path}, line {files.line_of_toml_key(text, ['time', 'in_name'])}")
    return columns, tuple(channel for channel in declared if channel.name in columns.channels)


def key_location_in_map(path: Path | str, keys: Sequence[str]) -> str:
    """The place of a key in a map, for an error message; the path of a map that is not written yet."""
    return (
        f"{path}, line {files.line_of_toml_key(files.read_text(path), keys)}" if Path(path).is_file() else str(path)
    )


_LARGEST_ANGLE_DEG = 720.0  # a larger one that does not continue others is a sentinel or a fault, and stays


@dataclasses.dataclass(slots=True)
class _RequestedColumns:
    """The raw columns that a map requests; notes which are used, and names the map's line for a missing one."""

    raw: RawTable
    map_path: Path | str
    used: set[str] = field(default_factory=set)

    def drop_unreadable(
        self, times: pd.DatetimeIndex, columns: ColumnMap
    ) -> tuple[pd.DatetimeIndex, dict[str, int]]:
        """Drop rows without a time [n], or with text in a column of numbers.

        Also returns the times of the remaining rows, and the number of dropped rows by reason. Raises
        :class:`InputError` if no row remains.
        """
        names = [name for name in columns.numeric_columns if name in self.raw.columns]
        timeless = np.asarray(times.isna())
        text = np.any([non_numeric_cells(self.raw.columns[name]) for name in names], axis=0) & ~timeless
        counts = {"without a time": int(timeless.sum()), "with text for a number": int(text.sum())}
        valid, dropped = ~(timeless | text), {reason: count for reason, count in counts.items() if count}
        if not valid.any():
            why = ", ".join(f"{count} {reason}" for reason, count in dropped.items())
            raise InputError("has no readable row", where=str(self.raw.path), why=why, fix="check the columns")
        self.raw = replace(self.raw, columns=self.raw.columns[valid].reset_index(drop=True))
        return times[valid], dropped

    def numbers(self, name: str, keys: tuple[str, ...], missing: tuple[float, ...] = ()) -> Floats:
        values = parse_numbers(self.raw, self.require_column(name, keys))
        return np.where(np.isin(values, missing), np.nan, values) if missing else values

    def require_column(self, name: str, keys: tuple[str, ...], names: Iterable[str] | None = None) -> str:
        present = list(map(str, self.raw.columns.columns if names is None else names))
        if name not in present:
            similar = get_close_matches(name, present, n=1, cutoff=0.4) or present
            what = f"asks for column {name!r}, which {self.raw.path} has not"
            where = key_location_in_map(self.map_path, keys)
            raise ConfigurationError(what, where=where, fix=f"did you mean {', '.join(map(repr, similar))}?")
        self.used.add(name)
        return name


def apply_column_map(
    raw: RawTable, columns: ColumnMap, map_path: Path | str, declared: ships.Declared = ()
) -> TableFile:
    """A table by its map, in the contract's names, units and signs; angles within their channels' turn.

    ``declared`` are the channels that the map declares. Raises :class:`ConfigurationError` naming the map's line
    for a missing column, and :class:`InputError` for cells that are no numbers and rows without a time.
    """
    requested, duplicates = _RequestedColumns(raw, map_path), 0
    if columns.only is not None:
        requested.require_column(columns.only.column, ("only", "column"))
        requested.raw = columns.only.select(raw)
    parts = (("parts", column) for column in columns.time.column_by_part.values())
    for key, column in (("column", columns.time.column), ("date", columns.time.date), *parts):
        if column is not None:
            requested.require_column(column, ("time", key))
    if columns.long is not None:
        duplicates = _widen_requested(requested, columns.long, columns)
    units = requested.raw.units
    drops = columns.unreadable_rows == "drop"
    timed = time_columns.resolve_times(requested.raw, columns.time, strict=not drops)
    requested.raw = timed.raw
    index, dropped = requested.drop_unreadable(timed.index, columns) if drops else (timed.index, {})
    dropped |= {"twice of one variable and time": duplicates} if duplicates else {}
    trial = columns.trial.as_trial(columns.conditions, columns.context, columns.instruments, columns.particulars)
    trial, channels = (
        replace(trial, channels=ships.declared_channels_as_json(declared)),
        ships.channels_with_declared(declared),
    )
    result = TableFile(pd.DataFrame(index=index), trial, dropped=dropped, remarks=timed.remarks)
    for name, entry in columns.channels.items():
        if entry.column is None:
            result.add({name: float(entry.constant or 0.0)}, "assumed")
            continue
        values = requested.numbers(entry.column, ("channels", name, "column"), entry.missing)
        step = entry.conversion_to_channel(channels[name], units.get(entry.column) if columns.long else None)
        values = step.scale * values + step.offset  # may take angles out of their channel's turn
        is_angle = (np.abs(values) <= _LARGEST_ANGLE_DEG) | ships.angle_mask(values)
        values = np.where(is_angle, ships.wrap_to_range(channels[name], values), values)
        result.add({name: values}, f"table: {entry.column}")
    if columns.position:
        _add_plane_position(result, columns.position, requested)
    if quaternion := columns.orientation:
        x, y, z, w = (requested.numbers(getattr(quaternion, part), ("orientation", part)) for part in "xyzw")
        heading_deg = heading_of_quaternion(x, y, z, w, quaternion.frame)
        result.add({"heading_deg": heading_deg}, f"table: {quaternion.z} ... derived from the quaternion")
    if columns.velocity:
        _add_velocity(result, columns.velocity, requested)
    if columns.stalled_rows == "drop":
        seconds = seconds_since_first(pd.DatetimeIndex(result.table.index))
        motion = result.table.loc[:, [name for name in result.table if name in MOTION_CHANNELS]]
        stalled = stalled_row_mask(seconds, motion)
        result.table.loc[stalled, motion.columns] = np.nan
        result.dropped |= {"without the motion of stalled": int(stalled.sum())} if stalled.any() else {}
    result.sources.update(add_derived_channels(result.table, columns.derive))
    if columns.apparent_wind:
        _add_true_wind(result, "apparent_wind", columns.apparent_wind, requested)
    if columns.true_wind:
        _add_true_wind(result, "true_wind", columns.true_wind, requested)
    if air := columns.wind_velocity:
        scale = quantities.unit_scale("m/s", air.unit)
        north, east = (
            scale * requested.numbers(getattr(air, key), ("wind_velocity", key)) for key in ("north", "east")
        )
        wind = wind_towards(north, east)
        channels_of_wind = {"wind_direction_deg": wind["direction"], "wind_speed_mps": wind["speed"]}
        result.add(channels_of_wind, f"table: {air.north}, {air.east} where the wind blows to")
    names = raw.columns.columns if columns.long is None else raw.columns[columns.long.variable].unique()
    result.passed_over = tuple(name for name in map(str, names) if name not in requested.used)
    return result


def _widen_requested(requested: _RequestedColumns, long: LongLayout, columns: ColumnMap) -> int:
    """Widen a long table by the variables that the map requests; returns as :func:`widen_long_table`."""
    variables = requested.raw.columns[requested.require_column(long.variable, ("long",))].unique()
    for name in (long.value, *((long.unit,) if long.unit is not None else ())):
        requested.require_column(name, ("long",))
    for channel, entry in columns.channels.items():
        if entry.column is not None:
            requested.require_column(entry.column, ("channels", channel, "column"), variables)
    keys = [name for name in (columns.time.column, columns.time.date) if name is not None]
    names = [*columns.numeric_columns]  # and those of text that become channels
    if place := columns.position:
        names += filter(None, (place.latitude, place.longitude, place.north_south, place.east_west))
    requested.raw, duplicates = widen_long_table(requested.raw, long, keys, names)
    return duplicates


def widen_long_table(
    raw: RawTable, long: LongLayout, keys: Sequence[str], names: Collection[str]
) -> tuple[RawTable, int]:
    """A long table with a column for each of the variables ``names`` and a row for each time, in their order.

    ``keys`` are the columns of the time; the variables' units are those of the table. Also returns the number of
    values replaced by a later one of the same variable and time.
    """
    rows = raw.columns[raw.columns[long.variable].isin(names)]
    units: dict[str, str] = {}
    if long.unit is not None:
        stated = rows.dropna(subset=[long.unit]).drop_duplicates(long.variable)
        units = dict(zip(stated[long.variable], stated[long.unit].astype("str"), strict=True))
    duplicated = rows.duplicated([*keys, long.variable], keep="last")
    wide = rows.pivot_table(index=[*keys], columns=long.variable, values=long.value, aggfunc="last", sort=False)
    return replace(raw, columns=wide.reset_index().rename_axis(columns=None), units=units), int(duplicated.sum())


def map_of_long_table(raw: RawTable, channels: Collection[str]) -> ColumnMap | None:
    """The map of a long table whose columns have the usual names and whose variables those of channels."""
    present = raw.names
    usual_names = ("timestamp", "time"), ("variable", "var"), ("value",), ("unit",)
    columns = [next((name for name in names if name in present), None) for names in usual_names]
    time, variable, value, unit = columns
    if time is None or variable is None or value is None or set(present) - set(columns):
        return None
    variables = [name for name in map(str, raw.columns[variable].unique()) if name in channels]
    is_numeric = pd.api.types.is_numeric_dtype(raw.columns[time])
    return ColumnMap(
        time=time_columns.TimeColumn(time, "seconds" if is_numeric else "iso"),
        long=LongLayout(variable, value, unit),
        channels={name: Column(column=name) for name in variables},
    )


def _add_plane_position(result: TableFile, entry: Position, requested: _RequestedColumns) -> None:
    """Add the positions of the map's columns, without rows that its column of fixes calls lost."""
    latitude, longitude = _latitude_and_longitude(requested, entry)
    lost: Bools | bool = False
    if entry.fix is not None:
        lost = entry.lost_fix_mask(requested.raw.columns[requested.require_column(entry.fix, ("position", "fix"))])
        over_ground = [name for name in GROUND_CHANNELS if name in result.table]
        result.table.loc[lost, over_ground] = np.nan
        result.dropped |= {"without a fix, whose positions are": int(lost.sum())} if lost.any() else {}
    add_projected_position(result, latitude, longitude, (entry.latitude, entry.longitude), requested.raw.path, lost)


def add_projected_position(
    result: TableFile,
    latitude: Floats,
    longitude: Floats,
    columns: tuple[str, str],
    path: Path,
    lost: Bools | bool = False,
) -> None:
    """Add north and east of the trial's origin, or of the first fix, on the WGS 84 tangent plane, from latitude and
    longitude [n, deg] of two columns; rows that are ``lost`` or hold a code for no position have none.

    Raises :class:`InputError` where there is no position at all.
    """
    no_fix = no_fix_mask(latitude, longitude)
    if no_fix.any():
        result.remarks = (*result.remarks, remark_on_missing_fixes(latitude[no_fix]))
    latitude, longitude = (np.where(no_fix | lost, np.nan, angle) for angle in (latitude, longitude))
    valid = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    if not valid.any():
        what = f"columns {columns[0]!r} and {columns[1]!r} contain no position"
        raise InputError(what, where=str(path), fix="check their unit, degrees; [position] in a map states another")
    first_fix = int(np.flatnonzero(valid)[0])
    origin = result.trial.origin or (float(latitude[first_fix]), float(longitude[first_fix]))
    result.trial = replace(result.trial, origin_latitude_deg=origin[0], origin_longitude_deg=origin[1])
    north, east = np.full((2, valid.size), np.nan)
    north[valid], east[valid], _ = pymap3d.geodetic2ned(latitude[valid], longitude[valid], 0.0, *origin, 0.0)
    channels = {"north_m": north, "east_m": east, "latitude_deg": latitude, "longitude_deg": longitude}
    result.add(channels, f"table: {columns[0]}, {columns[1]}")


def add_parts_of_degrees(degrees: Floats, parts: Sequence[Floats]) -> Floats:
    """Whole degrees [n] and their minutes and seconds, which have their sign, as degrees."""
    sizes = (part / 60.0**power for power, part in enumerate(parts, start=1))
    return np.asarray(degrees + np.where(np.signbit(degrees), -1.0, 1.0) * sum(sizes, np.zeros(degrees.size)))


def no_fix_mask(latitude: Floats, longitude: Floats) -> Bools:
    """Which rows [n] have a code for no position: the same whole number of degrees or minutes twice, such as 0."""
    return np.asarray((latitude == longitude) & (np.abs(np.rint(60.0 * latitude) - 60.0 * latitude) < 1e-9))


def remark_on_missing_fixes(codes: Floats) -> str:
    """A remark on the rows [n] whose latitude and longitude are a code for none."""
    place = f"latitude {codes[0]:g}, longitude {codes[0]:g}"
    return f"{codes.size:,} rows at {place}, as without a fix, have no position"


def _latitude_and_longitude(requested: _RequestedColumns, entry: Position) -> list[Floats]:
    """Latitude and longitude [deg]; positive to the north and to the east."""
    names = [requested.require_column(getattr(entry, key), ("position", key)) for key in ("latitude", "longitude")]
    columns = [requested.raw.columns[name] for name in names]
    if entry.unit == AS_TEXT:
        values, signs = parse_positions_in_degrees(columns[0], columns[1], entry.o_is)
    else:
        values, signs = [], []
        for name in names:
            numbers = requested.numbers(name, ("position", "latitude"), entry.missing)
            is_ddmm = entry.unit == quantities.DEGREES_AND_MINUTES
            if is_ddmm and (invalid := np.flatnonzero(np.abs(numbers) % 100.0 >= 60.0)).size:
                what = f"row {invalid[0] + 1} of column {name!r}, {numbers[invalid[0]]}, has more than 60 minutes"
                fix = 'say unit = "deg" under [position] if these are decimal degrees'
                raise InputError(what, where=str(requested.raw.path), fix=fix)
            key = "longitude_parts" if values else "latitude_parts"
            parts = [requested.numbers(part, ("position", key)) for part in getattr(entry, key)]
            values.append(
                quantities.from_degrees_and_minutes(numbers)
                if is_ddmm
                else add_parts_of_degrees(numbers * quantities.unit_scale("deg", entry.unit), parts)
            )
            signs.append(np.full(numbers.size, np.nan))
    axes: tuple[tuple[Axis, str | None], ...] = ("north_south", entry.north_south), ("east_west", entry.east_west)
    for index, (axis, letter_column) in enumerate(axes):
        if letter_column is not None:
            letters = requested.raw.columns[requested.require_column(letter_column, ("position", axis))]
            stated = hemisphere_signs(letters, axis, entry.o_is)
            values[index] = np.where(np.isnan(stated) & np.isnan(signs[index]), np.nan, values[index])
            signs[index] = np.where(np.isnan(signs[index]), stated, signs[index])
        signed = ~np.isnan(signs[index])
        values[index][signed] = apply_hemisphere_sign(values[index], signs[index], columns[index])[signed]
    return values


def _add_velocity(result: TableFile, entry: Velocity, requested: _RequestedColumns) -> None:
    """Add surge and sway of the velocity to north and to east."""
    if "heading_deg" not in result.table:
        where = key_location_in_map(requested.map_path, ["velocity"])
        raise ConfigurationError("velocity needs heading_deg", where=where, fix="map it too")
    scale = quantities.unit_scale("m/s", entry.unit)
    north, east = (scale * requested.numbers(getattr(entry, key), ("velocity", key)) for key in ("north", "east"))
    north = -north if entry.positive == "south" else north
    result.add(to_ship_axes(result.table, north, east), f"table: {entry.north}, {entry.east} turned by heading_deg")


def _add_true_wind(result: TableFile, key: str, entry: WindFromBow, requested: _RequestedColumns) -> None:
    """Add the true wind from that relative to the bow: of apparent wind subtract the ship's motion, turn by the
    heading."""
    is_apparent = key == "apparent_wind"
    inputs = ("heading_deg", *(("surge_mps", "sway_mps") if is_apparent else ()))
    if missing := [name for name in inputs if name not in result.table]:
        where = key_location_in_map(requested.map_path, [key])
        raise ConfigurationError(f"{key} needs {', '.join(missing)}", where=where, fix="map them too")
    angle_scale = quantities.unit_scale("deg", entry.angle_unit) * (-1.0 if entry.positive == "port" else 1.0)
    angle = np.deg2rad(requested.numbers(entry.angle, (key, "angle")) * angle_scale)
    speed = requested.numbers(entry.speed, (key, "speed")) * quantities.unit_scale("m/s", entry.speed_unit)
    seconds = seconds_since_first(pd.DatetimeIndex(result.table.index))
    series = (result.table[name].to_numpy(dtype=float) for name in inputs)  # the heading first
    motion = [
        fill_short_gaps(seconds, values if number else ships.unwrap(values)) for number, values in enumerate(series)
    ]
    heading_deg, surge_mps, sway_mps = motion if is_apparent else (*motion, np.zeros(1), np.zeros(1))
    direction_deg, speed_mps = true_wind(angle, speed, heading_deg, surge_mps, sway_mps)
    source = f"table: {entry.angle}, {entry.speed} derived from {key.replace('_', ' ')}"
    result.add({"wind_direction_deg": direction_deg, "wind_speed_mps": speed_mps}, source)


def true_wind(
    angle_rad: Floats, speed_mps: Floats, heading_deg: Floats, surge_mps: Floats, sway_mps: Floats
) -> tuple[Floats, Floats]:
    """Direction [deg] that the true wind comes from and its speed [m/s], all arrays of one shape.

    ``angle_rad`` is where the apparent wind comes from, from the bow and positive to starboard.
    """
    true = speed_mps * np.exp(1j * angle_rad) - (surge_mps + 1j * sway_mps)  # ahead + i to starboard
    return ships.wrap_360(np.rad2deg(np.angle(true)) + heading_deg), np.abs(true)


GROUND_CHANNELS = ("course_over_ground_deg", "speed_over_ground_mps")
_SLOPE_REACH_S = 1.5  # as long as the recorder holds a heading or a speed valid
_MIN_NEIGHBOURS = 1
_north_and_east = np.vectorize(quantities.components_of_velocity, otypes=[float, float])


def add_derived_channels(table: pd.DataFrame, names: Sequence[str]) -> dict[str, str]:
    """Add the channels ``names`` to a table of channels with a UTC index; returns their sources by name.

    Channels without their inputs are not added. Rows have a value where they have the quantity it follows from; the
    heading is interpolated to these along straight lines on the circle. Surge and sway follow from course and speed
    if the table has them, else from the positions.
    """
    if not names:
        return {}
    seconds = seconds_since_first(pd.DatetimeIndex(table.index))
    requested = [name for name in DERIVED if name in names and name not in table]
    compass = ("heading_magnetic_deg", "magnetic_variation_deg")
    sources: dict[str, str] = {}
    if "heading_deg" in requested and set(compass) <= set(table.columns):
        table["heading_deg"] = ships.wrap_360(table[compass[0]] + table[compass[1]])
        sources["heading_deg"] = f"{DERIVED_FROM}{', '.join(compass)}"
    over_ground = set(requested) - {"heading_deg", "yaw_rate_dps"}
    along_ship = {"surge_mps", "sway_mps"} & set(requested)
    has_heading, has_position = "heading_deg" in table, {"north_m", "east_m"} <= set(table.columns)
    derived: dict[str, tuple[Floats, str]] = {}
    if has_heading and "yaw_rate_dps" in requested:
        heading = ships.unwrap(table["heading_deg"].to_numpy(dtype=float))
        derived["yaw_rate_dps"] = local_least_squares_slopes(seconds, heading), "heading_deg"
    if has_position and over_ground:
        north, east = (
            local_least_squares_slopes(seconds, table[name].to_numpy(dtype=float)) for name in ("north_m", "east_m")
        )
        source = "north_m, east_m"
        speed = np.hypot(north, east)
        course = np.where(speed > 0.0, ships.wrap_360(np.rad2deg(np.arctan2(east, north))), np.nan)
        derived |= {"speed_over_ground_mps": (speed, source), "course_over_ground_deg": (course, source)}
    has_course = {*GROUND_CHANNELS} <= set(table.columns)
    if has_course and along_ship:
        north, east = _north_and_east(*(table[name].to_numpy(dtype=float) for name in GROUND_CHANNELS))
        source = ", ".join(GROUND_CHANNELS)
    if has_heading and along_ship and (has_position or has_course):
        velocity = to_ship_axes(table, north, east)
        derived |= {name: (values, f"{source} and heading_deg") for name, values in velocity.items()}
    result = {name: derived[name] for name in requested if name in derived}
    for name, (values, _) in result.items():
        table[name] = values
    return sources | {name: f"{DERIVED_FROM}{source}" for name, (_, source) in result.items()}


MOTION_CHANNELS = frozenset({
    "north_m", "east_m", "latitude_deg", "longitude_deg", "heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps",
    "speed_over_ground_mps", "course_over_ground_deg", "roll_deg", "pitch_deg", "heave_m",
})  # fmt: skip
"""What a navigation system measures, which is missing altogether while a connection to it stalls."""
_LEAST_STALL_S, _LEAST_STALL_ROWS, _LEAST_COLUMNS = 1.0, 5, 3
_MOST_REPEATS = 0.5  # of a column's other rows: more, and it is one that stands still by itself
_CATCHING_UP = 1.6  # times the speed before the stall: what waited comes faster than the ship sailed it
_SPEED_S = 10.0  # before the stall
_LEAST_STALLED_M = 1.0  # sailed meanwhile at that speed: a ship at rest may well repeat herself


def stalled_row_mask(seconds: Floats, motion: pd.DataFrame) -> Bools:
    """Rows [n] in which the connection to a ship under way stalled: all of the motion repeats the row before, for
    1 s or more; and those after them in which what had waited comes faster than she sailed, by the positions."""
    stalled = np.zeros(len(motion), np.bool_)
    values = motion.to_numpy(dtype=float)
    if not {"north_m", "east_m"} <= set(motion) or len(motion) < 2 * _LEAST_STALL_ROWS:
        return stalled
    equal = (np.diff(values, axis=0) == 0.0) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    lively = equal.mean(axis=0) < _MOST_REPEATS
    if np.count_nonzero(lively) < _LEAST_COLUMNS:
        return stalled
    repeats = np.concatenate([[False], equal[:, lively].all(axis=1)])
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], repeats.astype(np.int8), [0]])))
    north, east = (motion[name].to_numpy(dtype=float) for name in ("north_m", "east_m"))
    travelled = np.concatenate([[0.0], np.nancumsum(np.hypot(np.diff(north), np.diff(east)))])
    for start, end in bounds.reshape(-1, 2):
        lasted = seconds[end - 1] - seconds[start - 1]
        before = np.searchsorted(seconds, seconds[start - 1] - _SPEED_S)
        ran = seconds[start - 1] - seconds[before]
        speed = (travelled[start - 1] - travelled[before]) / ran if ran > 0.0 else 0.0
        if lasted < _LEAST_STALL_S or end - start < _LEAST_STALL_ROWS or speed * lasted < _LEAST_STALLED_M:
            continue
        stalled[start:end] = True
        for row in range(end, int(np.searchsorted(seconds, seconds[end - 1] + lasted))):
            ahead = min(int(np.searchsorted(seconds, seconds[row] + _LEAST_STALL_S / 2.0)), seconds.size - 1)
            if travelled[ahead] - travelled[row - 1] < _CATCHING_UP * speed * (seconds[ahead] - seconds[row - 1]):
                break
            stalled[row] = True
    return stalled


def seconds_since_first(index: pd.DatetimeIndex) -> Floats:
    """Seconds of an index since its first time [n]."""
    ns = index.as_unit("ns").asi8
    return np.asarray((ns - ns[0]) / 1e9 if ns.size else ns, dtype=float)


def to_ship_axes(table: pd.DataFrame, north: Floats, east: Floats) -> dict[str, Floats]:
    """Surge and sway [m/s] of velocities [n] to north and east in the rows of a table with a heading.

    The heading is interpolated to the rows without one, as by :func:`fill_short_gaps`.
    """
    seconds = seconds_since_first(pd.DatetimeIndex(table.index))
    heading = fill_short_gaps(seconds, ships.unwrap(table["heading_deg"].to_numpy(dtype=float)))
    surge, sway = quantities.rotate_earth_to_ship(north, east, np.deg2rad(heading))
    return {"surge_mps": surge, "sway_mps": sway}


def fill_short_gaps(seconds: Floats, values: Floats) -> Floats:
    """A series [n] with its missing values interpolated across gaps of up to 3 s; angles are unwrapped."""
    if len(runs := _forward_runs(seconds)) > 1:
        return np.concatenate([fill_short_gaps(seconds[run], values[run]) for run in runs])
    valid = np.flatnonzero(np.isfinite(values) & np.isfinite(seconds))
    if not valid.size:
        return values
    times = seconds[valid]
    interpolated = np.interp(seconds, times, values[valid], left=np.nan, right=np.nan)
    next_index = np.clip(np.searchsorted(times, seconds), 1, max(valid.size - 1, 1))
    gap = times[np.minimum(next_index, valid.size - 1)] - times[next_index - 1]
    interpolated = np.where(gap <= 2.0 * _SLOPE_REACH_S, interpolated, np.nan)
    return np.where(np.isfinite(values), values, interpolated)


DERIVED = (
    "heading_deg",
    "yaw_rate_dps",
    "surge_mps",
    "sway_mps",
    "speed_over_ground_mps",
    "course_over_ground_deg",
)
"""The channels that can be derived."""
DERIVED_FROM = "table derived from "
"""How the source of a channel begins that was computed from others."""


def _forward_runs(seconds: Floats) -> list[slice]:
    """The runs of rows [n] between which the time goes back."""
    bounds = [0, *np.flatnonzero(np.diff(seconds) < 0.0) + 1, seconds.size]
    return [slice(start, end) for start, end in pairwise(bounds)]


def local_least_squares_slopes(seconds: Floats, values: Floats) -> Floats:
    """The slope of the least-squares line through each value and its neighbours within 1.5 s [per s].

    The nearest on either side count however far they are, but none across a time that goes back. NaN without a
    value or neighbours.
    """
    if len(runs := _forward_runs(seconds)) > 1:
        return np.concatenate([local_least_squares_slopes(seconds[run], values[run]) for run in runs])
    result = np.full(values.size, np.nan)
    valid = np.flatnonzero(np.isfinite(values) & np.isfinite(seconds))
    t, y = seconds[valid], values[valid]
    if valid.size < 2:
        return result
    rows = np.arange(valid.size)
    low = np.minimum(np.searchsorted(t, t - _SLOPE_REACH_S), np.maximum(rows - _MIN_NEIGHBOURS, 0))
    high = np.maximum(
        np.searchsorted(t, t + _SLOPE_REACH_S, "right"), np.minimum(rows + _MIN_NEIGHBOURS + 1, valid.size)
    )
    count = (high - low).astype(float)
    t0, y0 = t - t[0], y - y.mean()
    sums = [np.concatenate([[0.0], np.cumsum(terms)]) for terms in (t0, y0, t0 * t0, t0 * y0)]
    st, sy, stt, sty = (total[high] - total[low] for total in sums)
    spread = stt - st * st / count
    with np.errstate(divide="ignore", invalid="ignore"):
        result[valid] = np.where(spread > 0.0, (sty - st * sy / count) / spread, np.nan)
    return result


def heading_of_quaternion(x: Floats, y: Floats, z: Floats, w: Floats, frame: str = "enu") -> Floats:
    """The heading [deg] of quaternions [n]; "enu" measures yaw from east to north, "ned" from north to east.

    Yaw of Fossen (2021, eq. 2.74); ROS' frames are those of REP 103.
    """
    yaw = np.rad2deg(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return ships.wrap_360(90.0 - yaw if frame == "enu" else yaw)


Axis = Literal["north_south", "east_west"]
HemisphereOfO = Literal["east", "west"]
_HEMISPHERE_WORDS: dict[Axis, tuple[str, str]] = {
    "north_south": (
        "n north northern northward nord norden nordlich nordlig norra norr norte noord noorderbreedte nb nordre"
        " nordbreite septentrional pohjoinen polnoc sever severni kuzey север с северная 北 北纬 北緯 +1 1",
        "s south southern southward sud suden sudlich sudlig sodra soder syd sydlig sur sul zuid zuiderbreedte zb"
        " z sudbreite meridional etela poludnie jih juzni guney юг ю южная 南 南纬 南緯 -1",
    ),
    "east_west": (
        "e east eastern eastward ost osten ostlich ostlig ostra oster oost oosterlengte ol est este leste l"
        " oriental ostlange ita wschod vychod vychodni dogu восток в восточная 东 東 东经 東経 +1 1",
        "w west western westward westen westlich vest vestlig vast vastra vaster westerlengte wl v ouest oeste"
        " ovest occidental westlange lansi zachod zapad zapadni bati запад з западная 西 西经 西経 -1",
    ),
}
"""The words of the two hemispheres of an axis, the positive one first, in small letters without accents."""
_SIGN_BY_WORD: dict[Axis, dict[str, float]] = {
    axis: {word: sign for words, sign in zip(sides, (1.0, -1.0), strict=True) for word in words.split()}
    for axis, sides in _HEMISPHERE_WORDS.items()
}
_O_IS_WEST = frozenset({"e", "l", "east", "est", "este", "leste"})
_O_IS_EAST = frozenset({"w", "v", "z", "west", "vest", "zuid"})
_SCANDINAVIAN_EAST = ("ø", "ö")  # Øst, Öst: without its accent it would be an O
_NUMBER = r"\d+(?:[.,]\d+)?"
_ANGLE_CELL = re.compile(
    rf"(?P<before>[^\W\d_]*)\.?\s*(?P<sign>[+-]?)\s*(?P<degrees>{_NUMBER})"
    r"\s*(?P<unit>°|º|˚|度|grad|degrees?|deg\.?|d(?=[\s\d]|$))?[\s:,-]*"
    rf"(?:(?P<minutes>{_NUMBER})\s*(?:'|′|’|´|分|minutes?|min\.?|m(?=[\s\d]|$))?[\s:]*"
    rf"(?:(?P<seconds>{_NUMBER})\s*(?:\"|″|”|''|’’|秒|seconds?|sec\.?|s(?=\s*[^\W\d_])|(?<=\d)s(?=$))?)?)?"
    r"\s*(?P<behind>[^\W\d_]*)\.?",
    re.IGNORECASE,
)
_RUSSIAN_ABBREVIATION = re.compile(r"([сю])\.?\s?ш(?:\.|\b)|([вз])\.?\s?д(?:\.|\b)", re.IGNORECASE)
"""North, south, east and west of latitude and longitude in Russian, by two letters, of which the first counts."""
_DIGITS_OF_DDMM = 4  # before the point: degrees alone have three at most


def hemisphere_signs(column: pd.Series[Any], axis: Axis, o_is: HemisphereOfO | None = None) -> Floats:
    """1 for north and east, -1 for south and west by the words of a column [n]; NaN for an empty cell.

    Raises :class:`InputError` for an unknown word, and for an ambiguous O.
    """
    words = [_hemisphere_word(cell) if pd.notna(cell) else "" for cell in column.tolist()]
    o_is = o_is or infer_hemisphere_of_letter_o(words, str(column.name))
    signs: dict[str, float] = {}
    for word in dict.fromkeys(words):
        letters = word.removesuffix(".0")  # of a column of 1 and -1
        if letters == "o" and axis == "east_west":
            if o_is is None:
                raise InputError(
                    f"column {column.name!r} has the letter O, which is east in some languages and west in others",
                    fix="write E and W, or --answer o_is=east|west",
                )
            signs[word] = 1.0 if o_is == "east" else -1.0
            continue
        if letters and letters not in _SIGN_BY_WORD[axis]:
            row = words.index(word)
            cell = str(column.iloc[row])
            what = f"row {row + 1} of column {column.name!r} names a hemisphere that is not known: {cell!r}"
            raise InputError(what, fix="write N and S" if axis == "north_south" else "write E and W")
        signs[word] = _SIGN_BY_WORD[axis].get(letters, np.nan)
    return np.array([signs[word] for word in words], dtype=float)


def _hemisphere_word(cell: Any) -> str:
    text = _RUSSIAN_ABBREVIATION.sub(r"\1\2", str(cell)).strip(" .").lower()
    return "ost" if text in _SCANDINAVIAN_EAST else column_names.lower_case_without_accents(text)


def holds_hemispheres(column: pd.Series[Any], axis: Axis) -> bool:
    """Whether a column of text holds nothing but hemispheres of an axis, and at least one."""
    hemispheres = {word for word in (*_SIGN_BY_WORD[axis], "o") if word.isalpha()}
    words = filter(None, map(_hemisphere_word, column.dropna().unique()))  # of most columns the first is none
    return next(words, "") in hemispheres and all(word in hemispheres for word in words)


def infer_hemisphere_of_letter_o(words: Iterable[str], name: str) -> HemisphereOfO | None:
    """West next to an E or an L (oeste, ouest, ovest), east next to a W, V or Z (Ost, oost); None without these.

    >>> [infer_hemisphere_of_letter_o(*cells) for cells in ((["o"], "E/O"), (["o", "w"], "lon"), (["o"], "lon"))]
    ['west', 'east', None]
    """
    for hints in (
        set(words),
        set(re.findall(r"(?<![a-z])[elwvz](?![a-z])", column_names.lower_case_without_accents(name))),
    ):
        is_west, is_east = bool(hints & _O_IS_WEST), bool(hints & _O_IS_EAST)
        if is_west != is_east:
            return "west" if is_west else "east"
    return None


def has_ambiguous_letter_o(column: pd.Series[Any]) -> bool:
    """Whether a column of hemispheres, or of longitudes with them, has an O that no other letter decides."""
    words = list[str]()
    for cell in column.dropna().astype("str").unique():
        match = _ANGLE_CELL.fullmatch(cell.strip())
        parts = [cell] if match is None else [match[part] for part in ("before", "behind") if match[part]]
        words += map(_hemisphere_word, parts)
    return "o" in words and infer_hemisphere_of_letter_o(words, str(column.name)) is None


def parse_positions_in_degrees(
    latitude: pd.Series[Any], longitude: pd.Series[Any], o_is: HemisphereOfO | None = None
) -> tuple[list[Floats], list[Floats]]:
    """Degrees of text such as 62°28.146'N, 6228.146N, 62 28 08.8 N, N62.469 or -62.469, without their hemisphere's
    sign, and the signs [n] of the hemispheres, NaN if the text names none. NaN for text that is no angle.

    Raises :class:`InputError` as :func:`hemisphere_signs`, and for a negative angle of a positive hemisphere.
    """
    cells = [
        [
            _ANGLE_CELL.fullmatch(_RUSSIAN_ABBREVIATION.sub(r"\1\2", str(cell).strip())) if pd.notna(cell) else None
            for cell in column.tolist()
        ]
        for column in (latitude, longitude)
    ]

    def is_single_number(match: re.Match[str]) -> bool:
        return match["minutes"] is None and match["unit"] is None

    singles = [match["degrees"] for matches in cells for match in matches if match and is_single_number(match)]
    is_ddmm = any(len(re.split("[.,]", text)[0]) >= _DIGITS_OF_DDMM for text in singles)

    def degrees_of(match: re.Match[str] | None) -> float:
        if match is None:
            return np.nan
        degrees, minutes, seconds = (
            float((match[part] or "0").replace(",", ".")) for part in ("degrees", "minutes", "seconds")
        )
        if is_ddmm and is_single_number(match):
            degrees = float(quantities.from_degrees_and_minutes(degrees)) if degrees % 100.0 < 60.0 else np.nan
        size = degrees + minutes / 60.0 + seconds / 3600.0
        return -size if match["sign"] == "-" else size

    sizes, signs = [], []
    for column, matches, axis in zip((latitude, longitude), cells, _HEMISPHERE_WORDS, strict=True):
        words = [(match["behind"] or match["before"]) if match else None for match in matches]
        signs.append(hemisphere_signs(pd.Series(words, name=column.name, dtype=object), axis, o_is))
        sizes.append(np.array([degrees_of(match) for match in matches], dtype=float))
    return sizes, signs


def apply_hemisphere_sign(values: Floats, signs: Floats, column: pd.Series[Any]) -> Floats:
    """Angles [n] with the sign of their hemisphere [n]; :class:`InputError` for a contradicting sign."""
    invalid = np.flatnonzero((values < 0.0) & (signs > 0.0))
    if invalid.size:
        where = f"row {invalid[0] + 1} of column {column.name!r}"
        what = f"{where}, {column.iloc[invalid[0]]!r}, is negative, but of the north or the east"
        raise InputError(what, fix="correct the sign, or leave the column of hemispheres out")
    return np.asarray(np.abs(values) * signs)
