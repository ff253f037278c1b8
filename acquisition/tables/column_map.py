"""A column map, the TOML file that says what a foreign table's columns are, and the table through it.

Units, signs, constants, the plane's position and the true wind become the contract's channels. A map may list the
ship's actuators, and it says what becomes of rows that cannot be read.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Iterable
from dataclasses import field, replace
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal
from zoneinfo import available_timezones

import numpy as np
import pandas as pd
import pymap3d
from pydantic import AfterValidator, ConfigDict, ValidationInfo
from pydantic.dataclasses import dataclass

from acquisition.config.declarations import ChannelSection, Conversion, PackSection
from acquisition.config.sections import ActuatorSection, RunSheet, check_channel, parse_for_ship
from acquisition.config.toml_file import line_of, read_text
from acquisition.core.actuators import Actuator, Actuators
from acquisition.core.angles import are_angles, in_turn, wrap_360
from acquisition.core.arrays import Floats
from acquisition.core.channel import Channel
from acquisition.core.channels import find_channel, with_declared
from acquisition.core.declared import Declared, as_text
from acquisition.core.errors import ConfigurationError, InputError
from acquisition.core.units import DEGREES_AND_MINUTES, from_degrees_and_minutes, scale_to
from acquisition.tables.table_files import (
    RawTable,
    TableFile,
    parse_numbers,
    parse_times,
    read_times,
    readable_rows,
)


def _of_any_ship(name: str, info: ValidationInfo) -> str:
    declared = (info.context or {}).get("declared", ())
    return name if find_channel(name, with_declared(declared)) else check_channel(name, declared=declared)


AnyChannel = Annotated[str, AfterValidator(_of_any_ship)]
_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class Column(Conversion):
    """One channel's column, or a constant where the table has none; a ``scale`` of -1 turns a sign round."""

    column: str | None = None
    constant: float | None = None


def _known_zone(zone: str) -> str:
    if zone not in available_timezones():
        raise ValueError("is no time zone; write UTC, or a name like Europe/Oslo")
    return zone


def _instant(text: str) -> str:
    try:
        zoned = datetime.fromisoformat(text).tzinfo is not None
    except ValueError as error:
        raise ValueError("is no ISO 8601 time") from error
    if not zoned:
        raise ValueError("has no zone; add Z or an offset like +02:00")
    return text


_IN_NAMES = {
    **dict.fromkeys(("%d", "%m", "%H", "%M", "%S", "%y"), r"\d{1,2}"),
    "%Y": r"\d{4}", "%j": r"\d{3}", "%b": "[A-Za-z]{3}", "%B": "[A-Za-z]+",
}  # fmt: skip
"""What the directives of :meth:`datetime.strptime` that a file's name may hold look like."""


def _in_name(text: str) -> str:
    unknown = set(re.findall("%.?", text)) - set(_IN_NAMES)
    if unknown or "%" not in text:
        raise ValueError(f"is no time such as %Y-%m-%d_%H%M%S; known are {' '.join(_IN_NAMES)}")
    return text


@dataclass(frozen=True, config=_STRICT)
class TimeColumn:
    """The time column: ISO 8601 (``zone`` where the text has none), or seconds.

    Seconds count from ``start``, or from the local time in ``zone`` that the file's name holds in the form
    ``in_name`` (of :meth:`datetime.strptime`), which is that of the first row, or of the last where
    ``name_tells`` the "end". With none of them they are taken for seconds since 1970.
    """

    column: str
    format: Literal["iso", "seconds"] = "iso"
    zone: Annotated[str, AfterValidator(_known_zone)] | None = None
    start: Annotated[str, AfterValidator(_instant)] | None = None
    in_name: Annotated[str, AfterValidator(_in_name)] | None = None
    name_tells: Literal["start", "end"] = "start"


def _known_angle_unit(unit: str) -> str:
    if unit not in ("deg", DEGREES_AND_MINUTES):
        raise ValueError(f"is neither deg nor {DEGREES_AND_MINUTES}")
    return unit


@dataclass(frozen=True, config=_STRICT)
class Position:
    """Latitude and longitude columns that ``north_m`` and ``east_m`` are made from."""

    latitude: str
    longitude: str
    unit: Annotated[str, AfterValidator(_known_angle_unit)] = "deg"


@dataclass(frozen=True, config=_STRICT)
class ApparentWind:
    """Wind measured aboard: where it comes from relative to the bow, and its speed past the ship.

    True wind is made of it with the ship's own heading, surge and sway.
    """

    angle: str
    speed: str
    angle_unit: str = "deg"
    speed_unit: str = "m/s"


@dataclass(frozen=True, config=_STRICT)
class Long:
    """The columns of a long table, which has a row for each value: whose it is, the value, perhaps its unit."""

    variable: str = "variable"
    value: str = "value"
    unit: str | None = None


@dataclass(frozen=True, config=_STRICT)
class ColumnMap:
    """A whole map. ``absent`` names channels that the table has not and that stay away.

    With ``long`` the variables of a long table are its columns.
    ``actuator`` lists the ship's, as in a vessel file. Rows without a time or with text for a number are an error,
    or dropped and counted where ``unreadable_rows`` says "drop".
    """

    time: TimeColumn
    long: Long | None = None
    actuator: tuple[ActuatorSection, ...] = ()
    channel: tuple[ChannelSection, ...] = ()
    pack: tuple[PackSection, ...] = ()
    unreadable_rows: Literal["refuse", "drop"] = "refuse"
    channels: dict[AnyChannel, Column] = field(default_factory=dict)
    position: Position | None = None
    apparent_wind: ApparentWind | None = None
    trial: RunSheet = field(default_factory=RunSheet)
    absent: tuple[AnyChannel, ...] = ()

    @property
    def actuators(self) -> Actuators:
        """The ship's actuators, none where the map does not list them."""
        return tuple(Actuator(each.name, each.kind) for each in self.actuator)

    @property
    def columns_of_numbers(self) -> tuple[str, ...]:
        """The table's columns that have to hold numbers."""
        named = [entry.column for entry in self.channels.values()]
        if self.position:
            named += [self.position.latitude, self.position.longitude]
        if self.apparent_wind:
            named += [self.apparent_wind.angle, self.apparent_wind.speed]
        return tuple(dict.fromkeys(name for name in named if name is not None))


def load_column_map(path: Path | str) -> tuple[ColumnMap, Declared]:
    """Read and check a map; with the channels it declares. Raises :class:`ConfigurationError` naming the line."""
    text = read_text(path)
    loaded, ship = parse_for_ship(text, path, ColumnMap)
    declared = tuple(each.channel for each in ship.declared if each.channel.group == "declared")
    known = with_declared(declared)
    for name, column in loaded.channels.items():
        complaint = _complaint(known[name], column)
        if complaint:
            line = line_of(text, ["channels", name, "unit"])
            raise ConfigurationError(f"{name}: {complaint}", where=f"{path}, line {line}")
    if loaded.time.in_name and (loaded.time.start or not loaded.time.zone or loaded.time.format == "iso"):
        raise ConfigurationError(
            "in_name is for seconds, with a zone and without a start",
            where=f"{path}, line {line_of(text, ['time', 'in_name'])}",
        )
    return loaded, tuple(each for each in declared if each.name in loaded.channels)


def _complaint(channel: Channel, column: Column) -> str:
    """What is wrong with one channel's entry; empty when nothing is."""
    if (column.column is None) == (column.constant is None):
        return "needs either a column or a constant"
    try:
        column.step_to(channel)
    except ConfigurationError as error:
        return str(error)
    return ""


_MOST_TURNS_DEG = 720.0  # an angle beyond this that does not go on from others is a sentinel or a fault, and stays


@dataclasses.dataclass(slots=True)
class _Asked:
    """The raw columns as a map asks for them; remembers which, and names the map's line for a missing one."""

    raw: RawTable
    map_path: Path | str
    used: set[str] = field(default_factory=set)

    def drop_unreadable(self, time: TimeColumn, start: str | None, columns: ColumnMap) -> dict[str, int]:
        """Let rows go that cannot be read; how many, by the reason."""
        given = [name for name in columns.columns_of_numbers if name in self.raw.columns]
        times = read_times(self.raw, time.column, time.zone, start, time.format == "seconds")
        self.raw, dropped = readable_rows(self.raw, times, given)
        return dropped

    def numbers(self, name: str, keys: tuple[str, ...]) -> Floats:
        return parse_numbers(self.raw, self.known(name, keys))

    def known(self, name: str, keys: tuple[str, ...], names: Iterable[str] | None = None) -> str:
        given = list(map(str, self.raw.columns.columns if names is None else names))
        if name not in given:
            near = get_close_matches(name, given, n=1, cutoff=0.4) or given
            raise ConfigurationError(
                f"asks for column {name!r}, which {self.raw.path} has not",
                where=f"{self.map_path}, line {line_of(read_text(self.map_path), keys)}",
                fix=f"did you mean {', '.join(map(repr, near))}?",
            )
        self.used.add(name)
        return name


def apply_column_map(raw: RawTable, columns: ColumnMap, map_path: Path | str, declared: Declared = ()) -> TableFile:
    """A table through its map, in the contract's names, units and signs; angles in their channels' turn.

    ``declared`` are the channels that the map declares.

    Raises :class:`ConfigurationError` naming the map's line for a column that the table has not, and
    :class:`InputError` for cells that are no numbers and rows without a time.
    """
    asked, time, units = _Asked(raw, map_path), columns.time, dict[str, str]()
    name = asked.known(time.column, ("time", "column"))
    start = time.start if time.in_name is None else _start_in_name(raw, time)
    twice = 0
    if columns.long is not None:
        asked.raw, units, twice = _widened(asked, columns.long, columns)
    dropped = asked.drop_unreadable(time, start, columns) if columns.unreadable_rows == "drop" else {}
    dropped |= {"twice of one variable and time": twice} if twice else {}
    index = parse_times(asked.raw, name, time.zone, start, seconds=time.format == "seconds")
    trial, known = replace(columns.trial.as_trial(), channels=as_text(declared)), with_declared(declared)
    result = TableFile(pd.DataFrame(index=index), trial, dropped=dropped)
    for name, entry in columns.channels.items():
        if entry.column is None:
            result.table[name] = float(entry.constant or 0.0)
            result.sources[name] = "assumed"
        else:
            values = asked.numbers(entry.column, ("channels", name, "column"))
            step = entry.step_to(known[name], units.get(entry.column))
            result.table[name] = _turned_back(known[name], step.scale * values + step.offset)
            result.sources[name] = f"table: {entry.column}"
    _add_position(result, columns, asked)
    _add_true_wind(result, columns, asked)
    given = raw.columns.columns if columns.long is None else raw.columns[columns.long.variable].unique()
    result.passed_over = tuple(name for name in map(str, given) if name not in asked.used)
    return result


def _widened(asked: _Asked, long: Long, columns: ColumnMap) -> tuple[RawTable, dict[str, str], int]:
    """A long table with a column for each variable that the map asks for, and a row for each time, in their order.

    Also the units that are told, by variable, and how many values another of the same variable and time replaces.
    """
    variable, value = (asked.known(name, ("long",)) for name in (long.variable, long.value))
    rows = asked.raw.columns
    for channel, entry in columns.channels.items():
        if entry.column is not None:
            asked.known(entry.column, ("channels", channel, "column"), rows[variable].unique())
    rows = rows[rows[variable].isin(columns.columns_of_numbers)]
    time, units = columns.time.column, {}
    if long.unit is not None:
        told = rows.dropna(subset=[asked.known(long.unit, ("long", "unit"))]).drop_duplicates(variable)
        units = dict(zip(told[variable], told[long.unit].astype("str"), strict=True))
    twice = rows.duplicated([time, variable], keep="last")
    wide = rows.pivot_table(index=time, columns=variable, values=value, aggfunc="last", sort=False)
    return replace(asked.raw, columns=wide.reset_index()), units, int(twice.sum())


def long_map(raw: RawTable, known: Collection[str]) -> ColumnMap | None:
    """The map of a long table that needs none: columns have the usual names, variables those of channels."""
    given = list(map(str, raw.columns.columns))
    found = [next((name for name in names if name in given), None) for names in _LONG]
    time, variable, value, unit = found
    if time is None or variable is None or value is None or set(given) - set(found):
        return None
    named = [name for name in map(str, raw.columns[variable].unique()) if name in known]
    seconds = pd.api.types.is_numeric_dtype(raw.columns[time])
    return ColumnMap(
        time=TimeColumn(time, "seconds" if seconds else "iso"),
        long=Long(variable, value, unit),
        channels={name: Column(column=name) for name in named},
    )


_LONG = ("timestamp", "time"), ("variable", "var"), ("value",), ("unit",)
"""The usual names of a long table's columns."""


def _start_in_name(raw: RawTable, time: TimeColumn) -> str:
    """The instant that the seconds count from, by the time that the file's name holds."""
    form = time.in_name or ""
    parts = (_IN_NAMES.get(part) or re.escape(part) for part in re.split("(%.)", form))
    found = re.search("".join(parts), raw.path.name)
    try:
        local = pd.Timestamp(datetime.strptime(found[0] if found else "", form)).tz_localize(time.zone)
    except ValueError as error:
        raise InputError(
            f"holds no time like {form} in its name", where=str(raw.path), why=str(error),
            fix="rename the file, or give `start` in the map's [time]",
        ) from error  # fmt: skip
    seconds = pd.to_numeric(raw.columns[time.column], errors="coerce")
    counted = float(seconds.max() if time.name_tells == "end" else seconds.min())
    return str(local.tz_convert("UTC") - pd.Timedelta(0 if np.isnan(counted) else round(1e6 * counted), "us"))


def _turned_back(channel: Channel, values: Floats) -> Floats:
    """Angles that a unit, sign or offset took out of their channel's turn, or that run on, come back into it."""
    return np.where((np.abs(values) <= _MOST_TURNS_DEG) | are_angles(values), in_turn(channel, values), values)


def _add_position(result: TableFile, columns: ColumnMap, asked: _Asked) -> None:
    """North and east of the map's origin, or of the first fix, on the WGS 84 tangent plane."""
    entry = columns.position
    if entry is None:
        return
    latitude = _degrees(asked, entry.latitude, "latitude", entry.unit)
    longitude = _degrees(asked, entry.longitude, "longitude", entry.unit)
    valid = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    if not valid.any():
        raise InputError(
            f"columns {entry.latitude!r} and {entry.longitude!r} hold no fix",
            where=str(asked.raw.path),
            fix="check the unit of [position] in the map",
        )
    first = int(np.flatnonzero(valid)[0])
    origin = result.trial.origin or (float(latitude[first]), float(longitude[first]))
    result.trial = replace(result.trial, origin_latitude_deg=origin[0], origin_longitude_deg=origin[1])
    north, east = np.full((2, valid.size), np.nan)
    north[valid], east[valid], _ = pymap3d.geodetic2ned(latitude[valid], longitude[valid], 0.0, *origin, 0.0)
    made = {"north_m": north, "east_m": east, "latitude_deg": latitude, "longitude_deg": longitude}
    for name, values in made.items():
        result.table[name] = values
        result.sources[name] = f"table: {entry.latitude}, {entry.longitude}"


def _degrees(asked: _Asked, name: str, key: str, unit: str) -> Floats:
    values = asked.numbers(name, ("position", key))
    if unit != DEGREES_AND_MINUTES:
        return values
    wrong = np.flatnonzero(np.abs(values) % 100.0 >= 60.0)
    if wrong.size:
        raise InputError(
            f"row {wrong[0] + 1} of column {name!r}, {values[wrong[0]]}, has more than 60 minutes",
            where=str(asked.raw.path),
            fix='say unit = "deg" under [position] if these are decimal degrees',
        )
    return from_degrees_and_minutes(values)


def _add_true_wind(result: TableFile, columns: ColumnMap, asked: _Asked) -> None:
    """The wind over ground from the wind past the ship: take away the ship's own motion, turn by the heading."""
    entry = columns.apparent_wind
    if entry is None:
        return
    needed = [name for name in ("heading_deg", "surge_mps", "sway_mps") if name not in result.table]
    if needed:
        line = line_of(read_text(asked.map_path), ["apparent_wind"])
        raise ConfigurationError(
            f"apparent_wind needs {', '.join(needed)}", where=f"{asked.map_path}, line {line}", fix="map them too"
        )
    angle = np.deg2rad(asked.numbers(entry.angle, ("apparent_wind", "angle")) * scale_to("deg", entry.angle_unit))
    speed = asked.numbers(entry.speed, ("apparent_wind", "speed")) * scale_to("m/s", entry.speed_unit)
    motion = [result.table[name].to_numpy(dtype=float) for name in ("heading_deg", "surge_mps", "sway_mps")]
    result.table["wind_direction_deg"], result.table["wind_speed_mps"] = true_wind(angle, speed, *motion)
    for name in ("wind_direction_deg", "wind_speed_mps"):
        result.sources[name] = f"table: {entry.angle}, {entry.speed} derived from apparent wind"


def true_wind(
    angle_rad: Floats, speed_mps: Floats, heading_deg: Floats, surge_mps: Floats, sway_mps: Floats
) -> tuple[Floats, Floats]:
    """Direction [deg] that the true wind comes from and its speed [m/s], all arrays of one shape.

    ``angle_rad`` is where the apparent wind comes from, from the bow and positive to starboard.
    """
    true = speed_mps * np.exp(1j * angle_rad) - (surge_mps + 1j * sway_mps)  # ahead + i to starboard
    return wrap_360(np.rad2deg(np.angle(true)) + heading_deg), np.abs(true)
