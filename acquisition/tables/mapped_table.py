"""A foreign table through its column map: units, signs, constants, the plane's position, the true wind."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d

from acquisition.config.toml_file import line_of, read_text
from acquisition.core.angles import in_turn, wrap_360
from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError, InputError
from acquisition.core.trial import Trial
from acquisition.core.units import scale_to
from acquisition.tables.column_map import DEGREES_AND_MINUTES, ColumnMap, factor
from acquisition.tables.table_files import RawTable, parse_numbers, parse_times

_MOST_TURNS_DEG = 720.0  # an angle beyond this is a sentinel or a fault, and stays what it is to be flagged


@dataclass(slots=True)
class MappedTable:
    """The channels that a map makes of a table, each with its source, and the columns it has no use for."""

    table: pd.DataFrame
    trial: Trial
    sources: dict[str, str] = field(default_factory=dict)
    passed_over: tuple[str, ...] = ()


@dataclass(slots=True)
class _Asked:
    """The raw columns as a map asks for them; remembers which, and names the map's line for a missing one."""

    raw: RawTable
    map_path: Path | str
    used: set[str] = field(default_factory=set)

    def numbers(self, name: str, keys: tuple[str, ...]) -> Floats:
        return parse_numbers(self.raw, self.known(name, keys))

    def known(self, name: str, keys: tuple[str, ...]) -> str:
        given = list(map(str, self.raw.columns.columns))
        if name not in given:
            near = get_close_matches(name, given, n=1, cutoff=0.4) or given
            raise ConfigurationError(
                f"asks for column {name!r}, which {self.raw.path} has not",
                where=f"{self.map_path}, line {line_of(read_text(self.map_path), keys)}",
                fix=f"did you mean {', '.join(map(repr, near))}?",
            )
        self.used.add(name)
        return name


def apply_column_map(raw: RawTable, columns: ColumnMap, map_path: Path | str) -> MappedTable:
    """A table through its map, in the contract's names, units and signs; angles in their channels' turn.

    Raises :class:`ConfigurationError` naming the map's line for a column that the table has not, and
    :class:`InputError` for cells that are no numbers and rows without a time.
    """
    asked = _Asked(raw, map_path)
    time = columns.time
    name = asked.known(time.column, ("time", "column"))
    index = parse_times(raw, name, time.zone, time.start, seconds=time.format == "seconds")
    result = MappedTable(pd.DataFrame(index=index), columns.trial.as_trial())
    for name, entry in columns.channels.items():
        if entry.column is None:
            result.table[name] = float(entry.constant or 0.0)
            result.sources[name] = "assumed"
        else:
            values = asked.numbers(entry.column, ("channels", name, "column"))
            result.table[name] = _turned_back(name, factor(name, entry) * values + entry.offset)
            result.sources[name] = f"table: {entry.column}"
    _add_position(result, columns, asked)
    _add_true_wind(result, columns, asked)
    result.passed_over = tuple(name for name in map(str, raw.columns.columns) if name not in asked.used)
    return result


def _turned_back(name: str, values: Floats) -> Floats:
    """Angles that a unit, sign or offset took out of their channel's turn come back into it."""
    return np.where(np.abs(values) <= _MOST_TURNS_DEG, in_turn(name, values), values)


def _add_position(result: MappedTable, columns: ColumnMap, asked: _Asked) -> None:
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


def from_degrees_and_minutes(ddmm: Floats) -> Floats:
    """Degrees from ``dddmm.mmmm``.

    >>> float(from_degrees_and_minutes(np.array([-6230.0]))[0])
    -62.5
    """
    degrees = np.trunc(ddmm / 100.0)
    return np.asarray(degrees + (ddmm - 100.0 * degrees) / 60.0)


def _add_true_wind(result: MappedTable, columns: ColumnMap, asked: _Asked) -> None:
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
    psi = np.deg2rad(heading_deg)
    ahead = speed_mps * np.cos(angle_rad) - surge_mps
    starboard = speed_mps * np.sin(angle_rad) - sway_mps
    north = ahead * np.cos(psi) - starboard * np.sin(psi)
    east = ahead * np.sin(psi) + starboard * np.cos(psi)
    return wrap_360(np.rad2deg(np.arctan2(east, north))), np.hypot(north, east)
