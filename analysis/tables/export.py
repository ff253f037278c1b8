"""A table as Parquet, CSV, Excel, .mat, NetCDF, or its track as KML or GPX, with units and where it comes from.

Parquet carries both in its metadata, .mat in structs, NetCDF in attributes and Excel on a second sheet. CSV has no
place for them and has to open anywhere without options, so that they stand in a second file beside it, the name
with ``.json`` after it. KML and GPX say the trial's name only.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.files import atomic_file, expect_suffix, write_bytes, write_text, written_together
from seatrial.acquisition.core.named_code import imported
from seatrial.acquisition.core.ship import BY_NAME, ChannelsByName, channel_unit, known_channels
from seatrial.acquisition.core.trial import Quality, software_version
from seatrial.acquisition.tables.table_files import ABOUT_COLUMNS, UTC_COLUMN
from seatrial.analysis.tables.files import write_parquet
from seatrial.analysis.tables.table import NANO, delays_in_ns, provenance_of, times_ns, utc_index

Writer = Callable[[pd.DataFrame, Path, Mapping[str, Any]], list[Path]]
"""Writes a table and what is to be said about it; the files that it wrote."""
FLAG_SUFFIX, SIGMA_SUFFIX = "_flag", "_sigma"
FLAG_MEANING = "QARTOD: 1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing"
_RATE_UNITS = {"surge_mps2": "m/s2", "sway_mps2": "m/s2", "yaw_dps2": "deg/s2"}
_LONGEST_MATLAB_NAME = 63
_MAT_TITLE, _MAT_TITLE_BYTES = b"MATLAB 5.0 MAT-file, written by Seatrial", 116
_RISING = (Quality.NOT_EVALUATED, Quality.GOOD, Quality.SUSPECT, Quality.BAD)


def export_table(
    table: pd.DataFrame,
    path: Path,
    options: Mapping[str, Any] | None = None,
    attributes: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write a table as the suffix of ``path`` says, and return the files that were written.

    It is .parquet, .csv, .xlsx, .mat, .nc, or for the track alone .kml or .gpx. Units, trial and
    :func:`seatrial.analysis.tables.table.provenance_of` go with it, and global ``attributes`` with NetCDF.
    A file appears under its name only when it is complete. Raises :class:`InputError` for another suffix and
    :class:`StorageError` when it cannot be written.
    """
    path = Path(path)
    kind = expect_suffix(path, *_WRITERS)
    about = _about(table, options or {})
    if attributes:
        about["attributes"] = dict(attributes)
    writer = _WRITERS[kind]
    write: Writer = imported(writer) if isinstance(writer, str) else writer
    return write(table, path, about)


def unit_of(column: str, channels: ChannelsByName = BY_NAME) -> str:
    """The unit of an exported column; a standard deviation has its channel's, and an unknown column none."""
    if column.endswith(FLAG_SUFFIX):
        return FLAG_MEANING
    name = column.removesuffix(SIGMA_SUFFIX)
    return channel_unit(name, channels) or _RATE_UNITS.get(name, "")


def add_flags(table: pd.DataFrame, flags: pd.DataFrame, delays: Mapping[str, float] | None = None) -> pd.DataFrame:
    """The table with a column ``<name>_flag`` (uint8) beside all others for each of its channels that was judged.

    ``flags`` belong to the raw samples, of which the delays [s by channel] were not taken off yet. A row of a
    resampled table gets the gravest flag among the samples that are nearer to it than to any other row; where
    the table has no value it says missing.
    """
    delay_ns = delays_in_ns(delays or {}, known_channels(table.attrs))
    result = table.copy(deep=False)
    same = not delays and flags.index.equals(table.index)
    for name in [str(name) for name in table.columns if name in flags.columns]:
        column = flags[name].to_numpy(dtype=np.uint8)
        if not same:
            rows = _nearest_rows(times_ns(table), times_ns(flags) - delay_ns.get(name, 0))
            column = _most_severe(rows, column, len(table))
            column[table[name].isna().to_numpy()] = Quality.MISSING
        result[name + FLAG_SUFFIX] = column
    return result


def _nearest_rows(row_ns: NDArray[np.int64], time_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    """For each time the row that is nearest to it, the first of several; rows are in the order of time."""
    middle = row_ns[:-1] + np.diff(row_ns) // 2
    return np.searchsorted(middle, time_ns, side="left")


def _most_severe(rows: NDArray[np.intp], flags: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
    """The gravest flag that falls on each of ``count`` rows, missing where none does."""
    result = np.full(count, Quality.MISSING, dtype=np.uint8)
    for flag in _RISING:
        result[rows[flags == flag]] = flag
    return result


def _about(table: pd.DataFrame, options: Mapping[str, Any]) -> dict[str, Any]:
    channels = known_channels(table.attrs)
    units = {str(name): unit for name in table.columns if (unit := unit_of(str(name), channels))}
    provenance = provenance_of(table, options)
    return {
        "units": units,
        "trial": provenance.pop("trial"),
        "recording": provenance["recording"],
        "rate_hz": table.attrs.get("rate_hz"),
        "provenance": provenance,
    }


def _write_parquet(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """Units on the columns; trial, recording, rate and provenance as JSON in the file's metadata."""
    texts = {key: json.dumps(value) for key, value in about.items()}
    write_parquet(table.set_axis(utc_index(table), axis=0), path, about["units"], texts)
    return [path]


def _write_csv(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """ISO 8601 times to the nanosecond; what a CSV has no place for goes into a JSON file beside it."""
    times = np.datetime_as_string(times_ns(table).astype("datetime64[ns]"), unit="ns")
    index = pd.Index([f"{time}Z" for time in times])
    sidecar = path.with_name(f"{path.name}.json")
    with written_together(path):
        write_text(sidecar, json.dumps({"file": path.name, **about}, indent=2) + "\n")
        with atomic_file(path) as partial:
            table.set_axis(index, axis=0).to_csv(partial, index_label="time")
    return [path, sidecar]


def _write_mat(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """One vector a column, ``time`` in seconds since 1970 (to 0.3 microseconds).

    The structs ``units``, ``trial`` and ``provenance`` say the rest; the history and the options are JSON text
    there, for ``jsondecode``.
    """
    from scipy.io import savemat

    vectors = {matlab_name(str(name)): table[name].to_numpy() for name in table.columns}
    provenance = {
        key: value if isinstance(value, str) else json.dumps(value) for key, value in about["provenance"].items()
    }
    rate = {} if about["rate_hz"] is None else {"rate_hz": about["rate_hz"]}
    structs = {
        "units": {"time": "s since 1970 UTC", **about["units"]},
        "trial": {**about["trial"], "software_version": software_version()},
        "provenance": {**provenance, **rate},
    }
    named = {key: {matlab_name(name): value for name, value in struct.items()} for key, struct in structs.items()}
    content = {"time": times_ns(table) / NANO, **vectors, **named}
    with atomic_file(path) as partial, partial.open("wb") as stream:
        savemat(stream, content, oned_as="column", long_field_names=True)
        stream.seek(0)
        stream.write(_MAT_TITLE.ljust(_MAT_TITLE_BYTES))  # scipy writes the time of day there
    return [path]


MOST_ROWS = 1_048_575
"""Rows that a sheet of Excel holds below its header."""
_EXCEL_OPTIONS = {"strings_to_formulas": False, "strings_to_urls": False, "nan_inf_to_errors": True}
"""What a recording says is text and nothing else, whatever it begins with."""
_FIRST_DAY = datetime(1980, 1, 1)
"""A workbook's own date: the time of day has no place in a product."""


def _write_excel(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """A workbook with the sheets ``data``, times in UTC, and ``about``: units, trial and provenance.

    Raises :class:`InputError` for more rows than a sheet holds, and as :func:`write_sheets`.
    """
    if len(table) > MOST_ROWS:
        what = f"has {len(table):,} rows, but an Excel sheet holds at most {MOST_ROWS:,}"
        raise InputError(what, where=about["recording"], fix="use --rate, or write .csv or .parquet")
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
        raise ConfigurationError(
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
    write_bytes(path, workbook.getvalue())
    return [path]


def matlab_name(name: str) -> str:
    """A name that MATLAB takes: letters, digits and underscores, a letter first, at most 63 characters."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:_LONGEST_MATLAB_NAME]


_WRITERS: dict[str, Writer | str] = {
    ".parquet": _write_parquet, ".csv": _write_csv, ".mat": _write_mat, ".xlsx": _write_excel,
    ".nc": "seatrial.analysis.tables.netcdf:write_netcdf",
    ".kml": "seatrial.analysis.tables.tracks:write_kml", ".gpx": "seatrial.analysis.tables.tracks:write_gpx",
}  # fmt: skip
"""By suffix; NetCDF and tracks, which need more, by where they are."""
KINDS = tuple(_WRITERS)
"""The suffixes of what a table can be written as."""
