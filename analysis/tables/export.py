"""A table as Parquet, CSV, Excel, .mat, NetCDF, or its track as KML or GPX, with units and where it comes from.

Parquet carries both in its metadata, .mat in structs, NetCDF in attributes and Excel on a second sheet. CSV has no
place for them and has to open anywhere without options, so that they are in a second file of the same name followed
by ``.json``. KML and GPX contain the trial's name only. The event log of a recording is exported as a table too.

NetCDF is by CF-1.11 and ACDD-1.3: one trajectory, QARTOD flags as ancillary variables, in the classic format
(64-bit offset), which every NetCDF library reads and scipy writes. Each column is a variable under its own name.
``lat`` and ``lon`` are the position of each row, interpolated between positions that lie close together and missing
elsewhere; without an origin or latitudes, north and east replace them. Quantities for which CF has no standard name
(settings of actuators above all) are auxiliary coordinates of the others: what these were measured at.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
from pymap3d import ned2geodetic
from scipy.io import netcdf_file, savemat

from seatrial.acquisition.core import errors, files
from seatrial.acquisition.core.quantities import AnyArray, Floats
from seatrial.acquisition.core.ship import BY_NAME, ChannelsByName, channel_unit, channels_by_name_of, find_channel
from seatrial.acquisition.core.trial import Quality, Trial, software_version
from seatrial.acquisition.recording.reader import Recording, events_of_recording
from seatrial.acquisition.tables.table_files import ABOUT_COLUMNS, UTC_COLUMN
from seatrial.analysis.tables.log_writers import write_bag, write_mdf
from seatrial.analysis.tables.resample import bridged_gap_s, interpolate
from seatrial.analysis.tables.table import NANO, delays_in_ns, index_of, provenance_of, times_ns, utc_index

if TYPE_CHECKING:
    from xarray import Dataset

Writer = Callable[[pd.DataFrame, Path, Mapping[str, Any]], list[Path]]
"""Writes a table and its metadata; returns the files that it wrote."""
FLAG_SUFFIX, SIGMA_SUFFIX = "_flag", "_sigma"
FLAG_MEANING = "QARTOD: 1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing"
_RATE_UNITS = {"surge_mps2": "m/s2", "sway_mps2": "m/s2", "yaw_dps2": "deg/s2"}
_LONGEST_MATLAB_NAME = 63
_MAT_TITLE, _MAT_TITLE_BYTES = b"MATLAB 5.0 MAT-file, written by Seatrial", 116
_BY_SEVERITY = (Quality.NOT_EVALUATED, Quality.GOOD, Quality.SUSPECT, Quality.BAD)
METADATA_PREFIX = "seatrial."
COLUMNS = ("kind", "level", "source", "text")
EVENT_KINDS = (".csv", ".parquet", ".xlsx")
"""The suffixes of what a table of texts can be written as."""
MOST_ROWS = 1_048_575
"""Rows that a sheet of Excel holds below its header."""
_EXCEL_OPTIONS = {"strings_to_formulas": False, "strings_to_urls": False, "nan_inf_to_errors": True}
"""The content of a recording is text and nothing else, whatever it begins with."""
_FIRST_DAY = datetime(1980, 1, 1)
"""A workbook's own date: the time of day has no place in a product."""
_KML, _GX, _GPX = (
    "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2", "http://www.topografix.com/GPX/1/1",
)  # fmt: skip
_DECIMALS = 8  # of a degree: a millimetre
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
"""What data centres ask for and no sensor knows; a recording's trial or the user states it."""

_UNITS = {"deg": "degree", "deg/s": "degree s-1", "deg/s2": "degree s-2", "m/s": "m s-1", "m/s2": "m s-2",
          "%": "percent", "degC": "degree_Celsius", "l/h": "L h-1", "Nm": "N m", "kNm": "kN m"}  # fmt: skip
"""Units as UDUNITS writes them; it takes others, such as rpm, as they are."""

_UNITS_OF_PLACES = {"latitude": "degrees_north", "longitude": "degrees_east"}

_MEANINGS = {Quality.GOOD: "pass", Quality.NOT_EVALUATED: "not_evaluated", Quality.SUSPECT: "suspect",
             Quality.BAD: "fail", Quality.MISSING: "missing"}  # fmt: skip
_KEYWORDS = "sea trial, ship motion, ship manoeuvring, platform orientation, wind, actuator settings"
_ROW = "obs"
Attributes = dict[str, Any]


def export_table(
    table: pd.DataFrame,
    path: Path,
    options: Mapping[str, Any] | None = None,
    attributes: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write a table as the suffix of ``path`` says, and return the files that were written.

    It is .parquet, .csv, .xlsx, .mat, .nc, .db3, .mf4, or for the track alone .kml or .gpx. Units, trial and
    :func:`seatrial.analysis.tables.table.provenance_of` go with it, and global ``attributes`` with NetCDF.
    A file appears under its name only when it is complete. Raises :class:`InputError` for another suffix and
    :class:`StorageError` when it cannot be written.
    """
    path = Path(path)
    write = _WRITERS[files.require_suffix(path, *_WRITERS)]
    return write(table, path, _metadata_of_table(table, options, attributes))


def _metadata_of_table(
    table: pd.DataFrame, options: Mapping[str, Any] | None = None, attributes: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """What goes with a table: units by column, trial, recording, rate, provenance, and ``attributes`` given."""
    channels, provenance = channels_by_name_of(table.attrs), provenance_of(table, options or {})
    return {
        "units": {str(name): unit for name in table.columns if (unit := unit_of(str(name), channels))},
        "trial": provenance.pop("trial"),
        "recording": provenance["recording"],
        "rate_hz": table.attrs.get("rate_hz"),
        "provenance": provenance,
        **({"attributes": dict(attributes)} if attributes else {}),
    }


def unit_of(column: str, channels: ChannelsByName = BY_NAME) -> str:
    """The unit of an exported column; a standard deviation has its channel's, and an unknown column none."""
    if column.endswith(FLAG_SUFFIX):
        return FLAG_MEANING
    name = column.removesuffix(SIGMA_SUFFIX)
    return channel_unit(name, channels) or _RATE_UNITS.get(name, "")


def _xarray() -> Any:
    try:
        import xarray
    except ImportError as error:
        raise errors.ConfigurationError(
            "a dataset needs the package xarray", fix="pip install 'seatrial[xarray]'"
        ) from error
    return xarray


def cf_dataset(table: pd.DataFrame) -> Dataset:
    """A table as an xarray dataset with the variables and attributes of its NetCDF file, along ``time``.

    Raises :class:`ConfigurationError` without xarray.
    """
    xarray = _xarray()
    attributes, variables = _cf_contents(table, _metadata_of_table(table))
    times = variables.pop("time")[1]
    kept = {key: value for key, value in times.items() if key not in ("units", "calendar")}  # xarray has its own
    data = {name: ("time", values, about) for name, (values, about) in variables.items()}
    places = {name: data.pop(name) for name in _PLACE_ATTRIBUTES if name in data}
    for _, _, about in data.values():
        about.pop("coordinates", None)  # the dataset knows them
    moments = times_ns(table).astype("datetime64[ns]")
    return xarray.Dataset(data, {"time": ("time", moments, kept), **places}, attributes)


def as_dataset(
    variables: Mapping[str, tuple[Sequence[str], Any]],
    coordinates: Mapping[str, Any],
    attributes: Mapping[str, Any],
) -> Dataset:
    """Arrays by name, each with its dimensions, as an xarray dataset; channels have their ``units`` in ``attrs``.

    Raises :class:`ConfigurationError` without xarray.
    """
    dataset = _xarray().Dataset(dict(variables), dict(coordinates), dict(attributes))
    for name in variables:
        if unit := unit_of(name):
            dataset[name].attrs["units"] = unit
    return dataset


def add_flags(table: pd.DataFrame, flags: pd.DataFrame, delays: Mapping[str, float] | None = None) -> pd.DataFrame:
    """The table with an additional column ``<name>_flag`` (uint8) for each of its channels that was checked.

    ``flags`` belong to the raw samples, from whose times the delays [s by channel] are still to be subtracted. A
    row of a resampled table gets the most severe flag among the samples that are nearer to it than to any other
    row; where the table has no value the flag is missing.
    """
    delay_ns = delays_in_ns(delays or {}, channels_by_name_of(table.attrs))
    result = table.copy(deep=False)
    same = not delays and flags.index.equals(table.index)
    for name in [str(name) for name in table.columns if name in flags.columns]:
        column = flags[name].to_numpy(dtype=np.uint8)
        if not same:
            row_ns = times_ns(table)
            middle_ns = row_ns[:-1] + np.diff(row_ns) // 2
            nearest = np.searchsorted(middle_ns, times_ns(flags) - delay_ns.get(name, 0), side="left")
            sample_flags, column = column, np.full(len(table), Quality.MISSING, dtype=np.uint8)
            for flag in _BY_SEVERITY:
                column[nearest[sample_flags == flag]] = flag
            column[table[name].isna().to_numpy()] = Quality.MISSING
        result[name + FLAG_SUFFIX] = column
    return result


def _write_parquet(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """Units on the columns; trial, recording, rate and provenance as JSON in the file's metadata."""
    texts = {key: json.dumps(value) for key, value in about.items()}
    write_parquet(table.set_axis(utc_index(table), axis=0), path, about["units"], texts)
    return [path]


def _write_csv(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """ISO 8601 times to the nanosecond; what a CSV has no place for goes into a JSON file in the same folder."""
    times = np.datetime_as_string(times_ns(table).astype("datetime64[ns]"), unit="ns")
    index = pd.Index([f"{time}Z" for time in times])
    sidecar = path.with_name(f"{path.name}.json")
    with files.written_together(path):
        files.write_text(sidecar, json.dumps({"file": path.name, **about}, indent=2) + "\n")
        with files.atomic_file(path) as partial:
            table.set_axis(index, axis=0).to_csv(partial, index_label="time")
    return [path, sidecar]


def _write_mat(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """One vector a column, ``time`` in seconds since 1970 (to 0.3 microseconds).

    The structs ``units``, ``trial`` and ``provenance`` hold the rest; the history and the options are JSON text
    there, for ``jsondecode``.
    """

    vectors = {matlab_name(str(name)): table[name].to_numpy() for name in table.columns}
    provenance = {
        key: value if isinstance(value, str) else json.dumps(value) for key, value in about["provenance"].items()
    }
    rate_hz = {} if about["rate_hz"] is None else {"rate_hz": about["rate_hz"]}
    structs = {
        "units": {"time": "s since 1970 UTC", **about["units"]},
        "trial": {**about["trial"], "software_version": software_version()},
        "provenance": {**provenance, **rate_hz},
    }
    renamed = {key: {matlab_name(name): value for name, value in struct.items()} for key, struct in structs.items()}
    content = {"time": times_ns(table) / NANO, **vectors, **renamed}
    with files.atomic_file(path) as partial, partial.open("wb") as stream:
        savemat(stream, content, oned_as="column", long_field_names=True)
        stream.seek(0)
        stream.write(_MAT_TITLE.ljust(_MAT_TITLE_BYTES))  # scipy writes the time of day there
    return [path]


def _write_excel(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """A workbook with the sheets ``data``, times in UTC, and ``about``: units, trial and provenance.

    Raises :class:`InputError` for more rows than a sheet holds, and as :func:`write_sheets`.
    """
    if len(table) > MOST_ROWS:
        what = f"has {len(table):,} rows, but an Excel sheet holds at most {MOST_ROWS:,}"
        raise errors.InputError(what, where=about["recording"], fix="use --rate, or write .csv or .parquet")
    times = utc_index(table).as_unit("us").tz_localize(None)
    entries = [
        (what, str(name), str(value))
        for what in ("units", "trial", "provenance") for name, value in about[what].items()
    ]  # fmt: skip
    return write_sheets(
        {"data": table.set_axis(times.rename(UTC_COLUMN), axis=0).reset_index(),
         "about": pd.DataFrame(entries, columns=ABOUT_COLUMNS)}, path
    )  # fmt: skip


def write_sheets(sheets: Mapping[str, pd.DataFrame], path: Path) -> list[Path]:
    """A workbook of tables by name, without their index. Raises :class:`ConfigurationError` without XlsxWriter."""
    try:
        import xlsxwriter  # noqa: F401 - pandas asks for it by name
    except ImportError as error:
        raise errors.ConfigurationError(
            "a workbook needs the package xlsxwriter", fix="pip install 'seatrial[excel]'"
        ) from error
    workbook = BytesIO()  # on a full disk the archive would complain once more when it is deleted
    with pd.ExcelWriter(
        workbook,
        engine="xlsxwriter",
        datetime_format="yyyy-mm-dd hh:mm:ss.000",
        engine_kwargs={"options": _EXCEL_OPTIONS},
    ) as writer:
        writer.book.set_properties({"created": _FIRST_DAY})
        for name, table in sheets.items():
            table.to_excel(writer, sheet_name=name, index=False, freeze_panes=(1, 1))
            writer.sheets[name].set_column(0, 0, 24)
    files.write_bytes(path, workbook.getvalue())
    return [path]


def matlab_name(name: str) -> str:
    """A name that MATLAB takes: letters, digits and underscores, a letter first, at most 63 characters."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:_LONGEST_MATLAB_NAME]


def write_parquet(
    table: pd.DataFrame, path: Path | str, units: Mapping[str, str], metadata: Mapping[str, str]
) -> None:
    """Write ``table`` with a unit on each column named in ``units`` and ``metadata`` under our prefix.

    The index is written if it has a name. The file appears under its name only when it is complete. Raises
    :class:`InputError` for another suffix than .parquet, :class:`StorageError` when it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    files.require_suffix(path, ".parquet")
    plain = table.copy(deep=False)
    plain.attrs = {}  # the metadata has it; pandas would write it a second time, and only as JSON
    arrow = pa.Table.from_pandas(plain, preserve_index=table.index.name is not None)
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in arrow.schema
    ]
    file_metadata = {METADATA_PREFIX + key: text for key, text in metadata.items()}
    file_metadata[METADATA_PREFIX + "software_version"] = software_version()
    attributes = {"units": dict(units), "trial": table.attrs.get("trial", {})}
    file_metadata["PANDAS_ATTRS"] = json.dumps(attributes)  # what pandas puts into ``attrs`` when it reads the file
    schema = pa.schema(fields, metadata={**(arrow.schema.metadata or {}), **file_metadata})
    with files.atomic_file(path) as partial, partial.open("wb") as stream:  # Arrow opens no name that is not UTF-8
        pq.write_table(arrow.cast(schema), stream)


def read_parquet(path: Path | str) -> tuple[pd.DataFrame, dict[str, str]]:
    """A Parquet file and the metadata under our prefix. Raises :class:`InputError` if it is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not Path(path).is_file():
        raise errors.InputError("does not exist", where=str(path), fix="check the path")
    try:
        with Path(path).open("rb") as stream:
            arrow = pq.read_table(stream)
        frame = arrow.to_pandas()
    except (pa.ArrowException, OSError) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise errors.InputError("is not a readable Parquet file", where=str(path), why=why) from error
    texts = {key.decode(): text.decode() for key, text in (arrow.schema.metadata or {}).items()}
    file_metadata = {
        key.removeprefix(METADATA_PREFIX): text for key, text in texts.items() if key.startswith(METADATA_PREFIX)
    }
    return frame, file_metadata


def event_table(recording: Recording) -> pd.DataFrame:
    """The events of a recording in the order of time: :data:`COLUMNS` with a UTC index named ``time``."""
    events = events_of_recording(recording)
    rows = [[getattr(event, column) for column in COLUMNS] for event in events]
    index = index_of(np.array([event.time_ns for event in events], dtype=np.int64))
    return pd.DataFrame(rows, index=index, columns=list(COLUMNS), dtype=str)


def export_events(events: pd.DataFrame, path: Path) -> list[Path]:
    """Write a table of events as the suffix of ``path`` says, .csv, .parquet or .xlsx; the files that were written.

    Raises :class:`InputError` for another suffix and :class:`StorageError` when it cannot be written.
    """
    kind = files.require_suffix(path, *EVENT_KINDS)
    if kind == ".parquet":
        write_parquet(events, path, {}, {})
    elif kind == ".xlsx":
        times = pd.DatetimeIndex(events.index).as_unit("us").tz_localize(None).rename("time_utc")
        return write_sheets({"events": events.set_axis(times, axis=0).reset_index()}, path)
    else:
        texts = pd.DatetimeIndex(events.index).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        with files.atomic_file(path) as partial:
            events.set_axis(texts, axis=0).to_csv(partial, index_label="time")
    return [path]


def places_of(table: pd.DataFrame) -> dict[str, Floats]:
    """Latitude and longitude [deg] of each row as ``lat`` and ``lon``: from north and east, or as they are.

    They are interpolated between positions that lie close together, NaN elsewhere. Nothing without positions, or
    without an origin.
    """
    time_ns, trial = times_ns(table), table.attrs.get("trial", {})
    origin = trial.get("origin_latitude_deg"), trial.get("origin_longitude_deg")

    def at_rows(values: Any) -> Floats:
        return interpolate(time_ns, np.asarray(values, dtype=float), time_ns)

    if None not in origin and {"north_m", "east_m"} <= set(table.columns):
        lat, lon, _ = ned2geodetic(at_rows(table["north_m"]), at_rows(table["east_m"]), 0.0, *origin, 0.0)
    elif {"latitude_deg", "longitude_deg"} <= set(table.columns):
        lat, turned = at_rows(table["latitude_deg"]), table["longitude_deg"].to_numpy(dtype=float, copy=True)
        valid = np.isfinite(turned)
        turned[valid] = np.unwrap(turned[valid], period=360.0)
        lon = (at_rows(turned) + 180.0) % 360.0 - 180.0
    else:
        return {}
    return {"lat": np.asarray(lat), "lon": np.asarray(lon)}


def write_gpx(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """GPX 1.1: one track, a segment for each stretch without a hole. Raises :class:`DataShortageError`."""
    root = ET.Element("gpx", xmlns=_GPX, version="1.1", creator=software_version())
    track = _child(root, "trk")
    _child(track, "name", _title(about))
    for segment in _segments(table):
        element = _child(track, "trkseg")
        for time, lat, lon in segment:
            _child(_child(element, "trkpt", lat=lat, lon=lon), "time", time)
    return _write_xml(root, path)


def write_kml(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """KML 2.2: each stretch without a hole as a line, and as a track that an Earth viewer plays.

    Raises :class:`DataShortageError` where no position is known.
    """
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = _child(root, "Document")
    _child(document, "name", _title(about))
    for segment in _segments(table):
        placemark = _child(document, "Placemark")
        _child(placemark, "name", f"{segment[0][0]} to {segment[-1][0]}")
        line = _child(placemark, "LineString")
        _child(line, "tessellate", "1")
        _child(line, "coordinates", " ".join(f"{lon},{lat}" for _, lat, lon in segment))
        playback = _child(document, "Placemark")
        _child(playback, "name", about["trial"].get("vessel") or "ship")
        track = _child(playback, "gx:Track")
        for time, _, _ in segment:
            _child(track, "when", time)
        for _, lat, lon in segment:
            _child(track, "gx:coord", f"{lon} {lat} 0")
    return _write_xml(root, path)


def _title(about: Mapping[str, Any]) -> str:
    return about["trial"].get("name") or about["recording"] or "trial"


def _segments(table: pd.DataFrame) -> list[list[tuple[str, str, str]]]:
    """Time (ISO 8601), latitude and longitude [deg] as text of the rows of each stretch whose place is known."""
    places = places_of(table)
    located = np.flatnonzero(np.isfinite(places["lat"] + places["lon"])) if places else np.empty(0, int)
    if located.size == 0:
        raise errors.DataShortageError(
            "contains no latitude and longitude", why="it has no positions, or its north and east have no origin",
            fix="give [trial] an origin before recording, or export a table",
        )  # fmt: skip
    times = np.datetime_as_string(times_ns(table).astype("datetime64[ns]"), unit="ms")
    lat, lon = ([f"{value:.{_DECIMALS}f}" for value in places[name]] for name in ("lat", "lon"))
    step_ns = np.diff(times_ns(table)[located])
    holes = (np.diff(located) > 1) | (step_ns > bridged_gap_s(np.median(step_ns) if step_ns.size else 0.0) * NANO)
    stretches = np.split(located, np.flatnonzero(holes) + 1)
    return [[(f"{times[row]}Z", lat[row], lon[row]) for row in rows] for rows in stretches]


def _child(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text or None
    return element


def _write_xml(root: ET.Element, path: Path) -> list[Path]:
    ET.indent(root, " ")
    with files.atomic_file(path) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    return [path]


def write_netcdf(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """Write a table; ``about`` has its units, trial, provenance, and the global ``attributes`` that a user gives.

    A single trajectory as in H.4.2 of the CF conventions, its rows along ``obs``. Trial and provenance are global
    attributes too, as JSON.
    """
    attributes, variables = _cf_contents(table, about)
    with files.atomic_file(path) as partial, netcdf_file(partial, "w", version=2) as file:
        file.createDimension(_ROW, len(table))
        _set_attributes(file, attributes)
        letters = np.frombuffer(attributes["id"].encode(), dtype="S1")
        file.createDimension("name_strlen", letters.size)
        identifier = file.createVariable("trajectory", "c", ("name_strlen",))
        identifier[:] = letters
        _set_attributes(identifier, {"cf_role": "trajectory_id", "long_name": "Name of the trial"})
        for name, (values, variable_attributes) in variables.items():
            is_flag = values.dtype == np.uint8
            variable = file.createVariable(name, "b" if is_flag else "d", (_ROW,))
            variable[:] = values.astype(np.int8) if is_flag else values
            has_gaps = not is_flag and variable_attributes.get("axis") != "T"
            _set_attributes(variable, ({"_FillValue": np.nan} if has_gaps else {}) | variable_attributes)
    return [path]


def _cf_contents(
    table: pd.DataFrame, about: Mapping[str, Any]
) -> tuple[Attributes, dict[str, tuple[AnyArray, Attributes]]]:
    """The global attributes by the CF conventions, and each variable's values [rows] and attributes: the time,
    latitude and longitude, the columns."""
    places, time_ns = places_of(table), times_ns(table)
    start = int(time_ns[0]) // NANO  # since the whole second of the first row: that keeps nanoseconds for a month
    time_attributes = {
        "standard_name": "time", "long_name": "Time of measurement", "axis": "T", "calendar": "standard",
        "units": f"seconds since {_iso_time(start)}", "units_metadata": "leap_seconds: none",
        "coverage_content_type": "coordinate",
    }  # fmt: skip
    variables: dict[str, tuple[AnyArray, Attributes]] = {"time": ((time_ns - start * NANO) / NANO, time_attributes)}
    variables |= {name: (values, dict(_PLACE_ATTRIBUTES[name])) for name, values in places.items()}
    for name in map(str, table.columns):
        variables[name] = table[name].to_numpy(), _variable_attributes(name, table, places, about["units"])
    return {**_global_attributes(table, places, about), **about.get("attributes", {})}, variables


def remarks_on_metadata(table: pd.DataFrame, attributes: Mapping[str, str]) -> list[str]:
    """What a data centre will miss, and what to do: the entries of :data:`WISHED` not given, and positions."""
    trial = table.attrs.get("trial", {})
    missing = [name for name in WISHED if not (trial.get(name) or attributes.get(name))]
    messages = []
    if missing:
        messages.append(
            f"not known: {', '.join(missing)}; give them in [trial] before recording or by --attribute NAME=VALUE"
        )
    if not places_of(table):
        in_plane = _plane_coordinates(table)
        instead = "north and east stand for them" if in_plane else "nor has it positions in the plane"
        messages.append(f"no latitude and longitude: the recording has none and no origin; {instead}")
    return messages


def _plane_coordinates(table: pd.DataFrame) -> list[str]:
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


def _iso_time(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601, with as many decimals as there are."""
    text = datetime.fromtimestamp(seconds, UTC).isoformat(timespec="auto")
    return text.replace("+00:00", "Z")


def _variable_attributes(
    name: str, table: pd.DataFrame, places: Mapping[str, Floats], units: Mapping[str, str]
) -> Attributes:
    """The attributes of a column's variable. Coordinates are when, where, and what CF has no standard name for."""
    position = [*places] or _plane_coordinates(table)
    columns = [column for column in map(str, table.columns) if not column.endswith(FLAG_SUFFIX)]
    nameless = [column for column in columns if column.removesuffix(SIGMA_SUFFIX) not in STANDARD_NAMES]
    coordinates = " ".join(["time", *position, *nameless])
    if name.endswith(FLAG_SUFFIX):
        return {
            "long_name": f"QARTOD flag of {name.removesuffix(FLAG_SUFFIX)}",
            "standard_name": "aggregate_quality_flag",
            "flag_values": np.array([*_MEANINGS], dtype=np.int8),
            "flag_meanings": " ".join(_MEANINGS.values()),
            "coverage_content_type": "qualityInformation",
            "coordinates": coordinates,
        }
    quantity, unit = name.removesuffix(SIGMA_SUFFIX), units.get(name, "")
    channel, standard = find_channel(quantity, channels_by_name_of(table.attrs)), STANDARD_NAMES.get(quantity)
    meaning = channel.meaning if channel else quantity.replace("_", " ").capitalize()
    ancillary = [column for column in (name + FLAG_SUFFIX, name + SIGMA_SUFFIX) if column in table.columns]
    attributes = {
        "long_name": meaning if quantity == name else f"Standard deviation: {meaning}",
        "standard_name": standard if quantity == name or not standard else f"{standard} standard_error",
        "units": _UNITS_OF_PLACES.get(standard or "") or _UNITS.get(unit, unit) or "1",
        "coverage_content_type": "physicalMeasurement" if quantity == name else "qualityInformation",
        "source": "; ".join(table.attrs.get("sources", {}).get(name, [])),
        "ancillary_variables": " ".join(ancillary),
        "coordinates": coordinates if standard else "",
        "axis": {"north_m": "Y", "east_m": "X"}.get(name) if not places else None,
    }
    return {key: value for key, value in attributes.items() if value}


def _global_attributes(table: pd.DataFrame, places: Mapping[str, Floats], about: Mapping[str, Any]) -> Attributes:
    trial = Trial.from_metadata({key: str(value) for key, value in about["trial"].items()})
    name = about["trial"].get("name") or Path(about["recording"] or "trial").stem
    ship, place = trial.vessel or "a ship", f", {trial.place}" if trial.place else ""
    steps = [f"{step['version']}: {step['step']} {json.dumps(step['options'])}"
             for step in about["provenance"]["history"]]  # fmt: skip
    rate_hz = about["rate_hz"]
    columns = [column for column in map(str, table.columns) if not column.endswith((FLAG_SUFFIX, SIGMA_SUFFIX))]
    summary = (
        f"Measurements aboard {ship}{place}, in a sea trial of {_iso_time(int(times_ns(table)[0]) / NANO)}, each "
        f"with a flag of its quality: {', '.join(columns)}."
    )
    # The crew's notes, and how the ship lay in the water.
    notes = (("", trial.crew_notes), ("loading: ", trial.loading), ("sea state: ", trial.sea_state))
    metres = (
        ("draught", trial.draught_m), ("trim by the stern", trial.trim_m), ("water depth", trial.water_depth_m),
    )  # fmt: skip
    comments = [f"{what}{text}" for what, text in notes if text]
    comments += [f"{what} {value:g} m" for what, value in metres if value is not None]
    attributes = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "featureType": "trajectory",
        "cdm_data_type": "Trajectory",
        "id": "_".join(str(name).split()),
        "title": f"Sea trial {name} of {ship}{place}",
        "summary": trial.summary or summary,
        "keywords": trial.keywords or _KEYWORDS,
        "platform": trial.vessel,
        "source": f"sensors of the ship, from {about['recording'] or 'a table'}",
        "history": "\n".join([*steps, f"{software_version()}: export"]),
        "processing_level": "samples as measured" if rate_hz is None else f"resampled to {rate_hz:g} Hz",
        "standard_name_vocabulary": "CF Standard Name Table v93",
        "date_created": _iso_time(int(times_ns(table)[-1]) // NANO),  # of the data; no product has a time of day
        "comment": "; ".join(comments),
        **{key: getattr(trial, key) for key in WISHED},
        **_coverage_attributes(table, places),
        "trial": json.dumps(about["trial"]),
        "provenance": json.dumps(about["provenance"]),
    }
    return {key: value for key, value in attributes.items() if value != ""}


def _coverage_attributes(table: pd.DataFrame, places: Mapping[str, Floats]) -> Attributes:
    """When, how often, and where, of the rows that have a place."""
    time_ns = times_ns(table)
    step_s = float(np.median(np.diff(time_ns))) / NANO if len(table) > 1 else 0.0
    attributes: Attributes = {
        "time_coverage_start": _iso_time(int(time_ns[0]) / NANO),
        "time_coverage_end": _iso_time(int(time_ns[-1]) / NANO),
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


def _set_attributes(variable: Any, attributes: Attributes) -> None:
    """Attributes of a file or of a variable: text in UTF-8, numbers in double precision."""
    for key, value in attributes.items():
        encoded = value.encode() if isinstance(value, str) else np.asarray(value)
        setattr(variable, key, encoded)


_WRITERS: dict[str, Writer] = {
    ".parquet": _write_parquet, ".csv": _write_csv, ".mat": _write_mat, ".xlsx": _write_excel,
    ".nc": write_netcdf, ".db3": write_bag, ".mf4": write_mdf, ".kml": write_kml, ".gpx": write_gpx,
}  # fmt: skip
KINDS = tuple(_WRITERS)
"""The suffixes of the files that a table can be written as."""
