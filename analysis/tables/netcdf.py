"""A table as NetCDF by CF-1.11 and ACDD-1.3: one trajectory, QARTOD flags as ancillary variables.

The file is of the classic format (64-bit offset), which every NetCDF library reads and scipy writes. Each column is
a variable under its own name. ``lat`` and ``lon`` say where each row was, interpolated between positions that lie
close together and missing where nobody knows; without an origin or latitudes, north and east stand for them.
Quantities for which CF has no standard name (settings of actuators above all) are auxiliary coordinates of the
others: what these were measured at.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import netcdf_file

from seatrial.acquisition.core.files import atomic_file
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import find_channel, known_channels
from seatrial.acquisition.core.trial import Quality, Trial, software_version
from seatrial.analysis.tables.export import FLAG_SUFFIX, SIGMA_SUFFIX
from seatrial.analysis.tables.table import NANO, times_ns
from seatrial.analysis.tables.tracks import places_of

STANDARD_NAMES = {
    "north_m": "projection_y_coordinate",
    "east_m": "projection_x_coordinate",
    "heading_deg": "platform_orientation",
    "surge_mps": "platform_surge_rate_fore",
    "sway_mps": "platform_sway_rate_starboard",
    "yaw_rate_dps": "platform_yaw_rate_fore_starboard",
    "wind_direction_deg": "wind_from_direction",
    "wind_speed_mps": "wind_speed",
    "latitude_deg": "latitude",
    "longitude_deg": "longitude",
    "speed_through_water_mps": "platform_speed_wrt_sea_water",
    "speed_over_ground_mps": "platform_speed_wrt_ground",
    "course_over_ground_deg": "platform_course",
    "roll_deg": "platform_roll_starboard_down",
    "pitch_deg": "platform_pitch_fore_up",
    "heave_m": "platform_heave_down",
}
"""Channels by their names in version 93 of the CF standard name table."""

WISHED = ("creator_name", "creator_email", "institution", "project", "license")
"""What data centres ask for and only people know; a recording's trial or the user says it."""

_UNITS = {"deg": "degree", "deg/s": "degree s-1", "deg/s2": "degree s-2", "m/s": "m s-1", "m/s2": "m s-2",
          "%": "percent", "degC": "degree_Celsius", "l/h": "L h-1", "Nm": "N m", "kNm": "kN m"}  # fmt: skip
"""Units as UDUNITS writes them; it takes others, such as rpm, as they are."""

_MEANINGS = {Quality.GOOD: "pass", Quality.NOT_EVALUATED: "not_evaluated", Quality.SUSPECT: "suspect",
             Quality.BAD: "fail", Quality.MISSING: "missing"}  # fmt: skip
_KEYWORDS = "sea trial, ship motion, ship manoeuvring, platform orientation, wind, actuator settings"
_ROW = "obs"

Attributes = dict[str, Any]


def write_netcdf(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """Write a table; ``about`` has its units, trial, provenance, and the global ``attributes`` that a user gives.

    A single trajectory as in H.4.2 of the CF conventions, its rows along ``obs``. Trial and provenance are global
    attributes too, as JSON.
    """
    places = places_of(table)
    attributes = {**_global_attributes(table, places, about), **about.get("attributes", {})}
    with atomic_file(path) as partial, netcdf_file(partial, "w", version=2) as file:
        file.createDimension(_ROW, len(table))
        _set_attributes(file, attributes)
        _write_identifier(file, attributes["id"])
        _write(file, "time", *_time(table))
        for name, values in places.items():
            _write(file, name, values, _PLACE_ATTRIBUTES[name])
        for name in map(str, table.columns):
            _write(file, name, table[name].to_numpy(), _attributes(name, table, places, about["units"]))
    return [path]


def remarks(table: pd.DataFrame, attributes: Mapping[str, str]) -> list[str]:
    """What a data centre will miss, and what to do: :data:`WISHED` that nobody has said, and places."""
    trial = table.attrs.get("trial", {})
    unsaid = [name for name in WISHED if not (trial.get(name) or attributes.get(name))]
    messages = []
    if unsaid:
        messages.append(
            f"not known: {', '.join(unsaid)}; give them in [trial] before recording or by --attribute NAME=VALUE"
        )
    if not places_of(table):
        instead = "north and east stand for them" if _local(table) else "nor has it positions in the plane"
        messages.append(f"no latitude and longitude: the recording has none and no origin; {instead}")
    return messages


def _local(table: pd.DataFrame) -> list[str]:
    """The coordinates in the tangent plane that a table has."""
    return [name for name in ("north_m", "east_m") if name in table.columns]


_PLACE_ATTRIBUTES: dict[str, Attributes] = {
    name: {
        "standard_name": standard_name,
        "long_name": f"{standard_name.capitalize()}, WGS 84",
        "units": f"degrees_{direction}",
        "axis": axis, "coverage_content_type": "coordinate",
        "comment": "interpolated between positions that lie close together",
    }
    for name, standard_name, direction, axis in (
        ("lat", "latitude", "north", "Y"), ("lon", "longitude", "east", "X")
    )
}  # fmt: skip


def _time(table: pd.DataFrame) -> tuple[Floats, Attributes]:
    """Seconds since the whole second of the first row, which keep nanoseconds for a month."""
    time_ns = times_ns(table)
    start = int(time_ns[0]) // NANO
    return (time_ns - start * NANO) / NANO, {
        "standard_name": "time", "long_name": "Time of measurement", "axis": "T", "calendar": "standard",
        "units": f"seconds since {_iso(start)}", "units_metadata": "leap_seconds: none",
        "coverage_content_type": "coordinate",
    }  # fmt: skip


def _iso(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601, with as many decimals as there are."""
    text = datetime.fromtimestamp(seconds, UTC).isoformat(timespec="auto")
    return text.replace("+00:00", "Z")


def _attributes(
    name: str, table: pd.DataFrame, places: Mapping[str, Floats], units: Mapping[str, str]
) -> Attributes:
    """What a column's variable says of itself."""
    if name.endswith(FLAG_SUFFIX):
        return _flag_attributes(name.removesuffix(FLAG_SUFFIX), _coordinates(table, places))
    of = name.removesuffix(SIGMA_SUFFIX)
    channel, standard = find_channel(of, known_channels(table.attrs)), STANDARD_NAMES.get(of)
    meaning = channel.meaning if channel else of.replace("_", " ").capitalize()
    ancillary = [column for column in (name + FLAG_SUFFIX, name + SIGMA_SUFFIX) if column in table.columns]
    attributes = {
        "long_name": meaning if of == name else f"Standard deviation: {meaning}",
        "standard_name": standard if of == name or not standard else f"{standard} standard_error",
        "units": _units_of(standard, units.get(name, "")),
        "coverage_content_type": "physicalMeasurement" if of == name else "qualityInformation",
        "source": "; ".join(table.attrs.get("sources", {}).get(name, [])),
        "ancillary_variables": " ".join(ancillary),
        "coordinates": _coordinates(table, places) if standard else "",
        "axis": {"north_m": "Y", "east_m": "X"}.get(name) if not places else None,
    }
    return {key: value for key, value in attributes.items() if value}


def _units_of(standard: str | None, unit: str) -> str:
    named = {"latitude": "degrees_north", "longitude": "degrees_east"}
    return named.get(standard or "") or _UNITS.get(unit, unit) or "1"


def _flag_attributes(of: str, coordinates: str) -> Attributes:
    return {
        "long_name": f"QARTOD flag of {of}",
        "standard_name": "aggregate_quality_flag",
        "flag_values": np.array([*_MEANINGS], dtype=np.int8),
        "flag_meanings": " ".join(_MEANINGS.values()),
        "coverage_content_type": "qualityInformation",
        "coordinates": coordinates,
    }


def _coordinates(table: pd.DataFrame, places: Mapping[str, Floats]) -> str:
    """The names of when, where, and what CF has no standard name for."""
    where = [*places] or _local(table)
    names = [name for name in map(str, table.columns) if not name.endswith(FLAG_SUFFIX)]
    nameless = [name for name in names if name.removesuffix(SIGMA_SUFFIX) not in STANDARD_NAMES]
    return " ".join(["time", *where, *nameless])


def _global_attributes(table: pd.DataFrame, places: Mapping[str, Floats], about: Mapping[str, Any]) -> Attributes:
    trial = Trial.from_metadata({key: str(value) for key, value in about["trial"].items()})
    name = about["trial"].get("name") or Path(about["recording"] or "trial").stem
    ship, place = trial.vessel or "a ship", f", {trial.place}" if trial.place else ""
    steps = [f"{step['version']}: {step['step']} {json.dumps(step['options'])}"
             for step in about["provenance"]["history"]]  # fmt: skip
    rate = about["rate_hz"]
    attributes = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "featureType": "trajectory",
        "cdm_data_type": "Trajectory",
        "id": "_".join(str(name).split()),
        "title": f"Sea trial {name} of {ship}{place}",
        "summary": trial.summary or _summary(table, ship, place),
        "keywords": trial.keywords or _KEYWORDS,
        "platform": trial.vessel,
        "source": f"sensors of the ship, from {about['recording'] or 'a table'}",
        "history": "\n".join([*steps, f"{software_version()}: export"]),
        "processing_level": "samples as measured" if rate is None else f"resampled to {rate:g} Hz",
        "standard_name_vocabulary": "CF Standard Name Table v93",
        "date_created": _iso(int(times_ns(table)[-1]) // NANO),  # of the data; a product has no time of day in it
        "comment": _comment(trial),
        **{key: getattr(trial, key) for key in WISHED},
        **_coverage(table, places),
        "trial": json.dumps(about["trial"]),
        "provenance": json.dumps(about["provenance"]),
    }
    return {key: value for key, value in attributes.items() if value != ""}


def _summary(table: pd.DataFrame, ship: str, place: str) -> str:
    names = [str(name) for name in table.columns if not str(name).endswith((FLAG_SUFFIX, SIGMA_SUFFIX))]
    return (
        f"Measurements aboard {ship}{place}, in a sea trial of {_iso(int(times_ns(table)[0]) / NANO)}, each with a"
        f" flag of its quality: {', '.join(names)}."
    )


def _comment(trial: Trial) -> str:
    """The crew's words, and how she lay in the water."""
    notes = (("", trial.crew_notes), ("loading: ", trial.loading), ("sea state: ", trial.sea_state))
    metres = (
        ("draught", trial.draught_m),
        ("trim by the stern", trial.trim_m),
        ("water depth", trial.water_depth_m),
    )
    words = [f"{what}{text}" for what, text in notes if text]
    return "; ".join(words + [f"{what} {value:g} m" for what, value in metres if value is not None])


def _coverage(table: pd.DataFrame, places: Mapping[str, Floats]) -> Attributes:
    """When, how often, and where, of the rows that have a place."""
    time_ns = times_ns(table)
    step_s = float(np.median(np.diff(time_ns))) / NANO if len(table) > 1 else 0.0
    attributes: Attributes = {
        "time_coverage_start": _iso(int(time_ns[0]) / NANO),
        "time_coverage_end": _iso(int(time_ns[-1]) / NANO),
        "time_coverage_duration": f"PT{(int(time_ns[-1]) - int(time_ns[0])) / NANO:g}S",
        "time_coverage_resolution": f"PT{step_s:g}S",
    }
    ends = {
        name: (np.nanmin(degrees), np.nanmax(degrees))
        for name, degrees in places.items()
        if np.isfinite(degrees).any()
    }
    if not ends:
        return attributes
    (south, north), (west, east) = ends["lat"], ends["lon"]
    corners = ((south, west), (south, east), (north, east), (north, west), (south, west))
    bounds = ", ".join(f"{lat:.7f} {lon:.7f}" for lat, lon in corners)
    return {
        **attributes,
        "geospatial_lat_min": south, "geospatial_lat_max": north, "geospatial_lat_units": "degrees_north",
        "geospatial_lon_min": west, "geospatial_lon_max": east, "geospatial_lon_units": "degrees_east",
        "geospatial_bounds": f"POLYGON (({bounds}))", "geospatial_bounds_crs": "EPSG:4326",
    }  # fmt: skip


def _write_identifier(file: netcdf_file, name: str) -> None:
    letters = np.frombuffer(name.encode(), dtype="S1")
    file.createDimension("name_strlen", letters.size)
    variable = file.createVariable("trajectory", "c", ("name_strlen",))
    variable[:] = letters
    _set_attributes(variable, {"cf_role": "trajectory_id", "long_name": "Name of the trial"})


def _write(file: netcdf_file, name: str, values: NDArray[Any], attributes: Attributes) -> None:
    flags = values.dtype == np.uint8
    variable = file.createVariable(name, "b" if flags else "d", (_ROW,))
    variable[:] = values.astype(np.int8) if flags else values
    _set_attributes(
        variable, attributes if flags or attributes.get("axis") == "T" else {"_FillValue": np.nan, **attributes}
    )


def _set_attributes(of: Any, attributes: Attributes) -> None:
    """Attributes of a file or of a variable: text in UTF-8, numbers in double precision."""
    for key, value in attributes.items():
        plain = value.encode() if isinstance(value, str) else np.asarray(value)
        setattr(of, key, plain)
