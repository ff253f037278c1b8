"""Files of named arrays as raw tables: MATLAB's, of Simulink too, and NetCDF."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.child import read_in_child
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import parse_json
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.tables.table_files import FOREIGN_READER, RawTable, require_package, trial_of

_HDF5, _USER_BLOCK_BYTES = b"\x89HDF", 512
_SINCE = re.compile(r"(seconds|minutes|hours|days|milliseconds|microseconds|nanoseconds) since (.+)")
_UNITS = {"seconds": "s", "minutes": "m", "hours": "h", "days": "D", "milliseconds": "ms", "microseconds": "us",
          "nanoseconds": "ns"}  # fmt: skip
_UNIT_NS = {name: pd.Timedelta(f"1{unit}").value for name, unit in _UNITS.items()}
_TIME_NAMES = ("time", "Time", "TIME", "obs_time", "datetime", "t")


def read_mat(path: Path) -> RawTable:
    """Vectors of one length, at the top or in the one struct that holds them, or what Simulink saves with time.

    The structs ``units`` and ``trial`` of our own exports are understood; a vector of another length is an
    error, for which of the two is wrong nobody can tell.
    """
    if _is_hdf5(path):
        require_package("h5py", "hdf5", path)
    loaded: dict[str, Any] = read_in_child(FOREIGN_READER, "mat", path)
    content = {key: value for key, value in loaded.items() if not key.startswith(("__", "#"))}
    trial, units = content.pop("trial", {}), content.pop("units", None)
    vectors = _vectors(content) or _of_simulink(content) or _of_one_struct(content, path)
    lengths = Counter(len(vector) for vector in vectors.values())
    usual = lengths.most_common(1)[0][0]
    unequal = [f"{name} ({len(vector)})" for name, vector in vectors.items() if len(vector) != usual]
    if unequal:
        raise InputError(
            f"holds vectors that are not {usual} long: {', '.join(unequal)}", where=str(path), fix="leave them out"
        )
    stated_units = {str(name): str(unit) for name, unit in units.items()} if isinstance(units, dict) else {}
    return RawTable(
        path, pd.DataFrame(vectors), trial_of(trial) if isinstance(trial, dict) else Trial(), stated_units
    )


def _of_one_struct(content: Mapping[str, Any], path: Path) -> dict[str, NDArray[Any]]:
    structs = [value for value in content.values() if isinstance(value, dict)]
    candidates = [vectors for struct in structs if (vectors := _vectors(_flat(struct)))]
    if len(candidates) != 1:
        what = "holds no vectors" if not candidates else f"holds {len(candidates)} structs of vectors"
        raise InputError(what, where=str(path), fix="save one struct of vectors, or the vectors themselves")
    return candidates[0]


def _flat(struct: Mapping[str, Any], stem: str = "") -> dict[str, Any]:
    """The fields of a struct and of those in it, their names joined by a point."""
    result: dict[str, Any] = {}
    for name, value in struct.items():
        result |= _flat(value, f"{stem}{name}.") if isinstance(value, dict) else {f"{stem}{name}": value}
    return result


def _of_simulink(content: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """What the blocks "To Workspace" and "Scope" save as a structure with time: ``time``, ``signals.values``.

    A signal is called by its label, else by the variable; the times are those of the first of the structures.
    """
    series: dict[str, NDArray[Any]] = {}
    for variable, struct in content.items():
        if not (isinstance(struct, dict) and {"time", "signals"} <= set(struct)):
            continue
        series.setdefault("time", np.atleast_1d(struct["time"]))
        signals = struct["signals"] if isinstance(struct["signals"], list | np.ndarray) else [struct["signals"]]
        for number, signal in enumerate(signals):
            values, label = np.asarray(signal["values"]), str(np.squeeze(signal.get("label", "")) or "")
            name = (
                label if label and label != "[]" else variable if len(signals) == 1 else f"{variable}.{number + 1}"
            )
            columns = values if values.ndim == 2 else values[:, np.newaxis]
            for place in range(columns.shape[1]):
                series[name if columns.shape[1] == 1 else f"{name}.{place + 1}"] = columns[:, place]
    return series


def _vectors(content: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """The numeric and text vectors among a file's variables; a single number is a vector of one."""
    vectors = {}
    for name, value in content.items():
        if name == "units" or isinstance(value, dict | str):
            continue
        array = np.atleast_1d(np.asarray(value))
        if array.ndim == 1 and array.size and array.dtype.kind in "biufUO" and not isinstance(array[0], dict):
            vectors[name] = array
    return vectors


def read_netcdf(path: Path) -> RawTable:
    """The variables along the dimension of the time; fill values become NaN, packed numbers are unpacked."""
    if is_hdf5 := _is_hdf5(path):
        require_package("h5py", "hdf5", path)
    variables, attributes = read_in_child(FOREIGN_READER, "netcdf_4" if is_hdf5 else "netcdf", path)
    said_so = (name for name, (_, _, metadata) in variables.items() if metadata.get("standard_name") == "time")
    time = next((name for name in (*_TIME_NAMES, *said_so) if name in variables), None)
    if time is None:
        raise InputError("has no variable time", where=str(path), fix="rename the one that holds the times")
    rows = variables[time][0]
    along = {name: variable for name, variable in variables.items() if variable[0] == rows}
    if "provenance" in attributes:  # of our own exports: lat and lon follow from the other columns
        along = {name: variable for name, variable in along.items() if name not in ("lat", "lon")}
    frame = pd.DataFrame({name: _unpacked(values, metadata) for name, (_, values, metadata) in along.items()})
    since = _SINCE.match(str(along[time][2].get("units", "")))
    if since:
        frame[time] = _times_since(frame[time], since)
    units = {
        name: str(metadata["units"])
        for name, (_, _, metadata) in along.items()
        if "units" in metadata and name != time
    }
    meanings = {
        name: str(meaning)
        for name, (_, _, metadata) in along.items()
        if (meaning := metadata.get("standard_name") or metadata.get("long_name"))
    }
    return RawTable(path, frame, trial_of(parse_json(str(attributes.get("trial", "{}")))), units, meanings)


def _is_hdf5(path: Path) -> bool:
    """By its first bytes; MATLAB's begin with a header of its own."""
    with path.open("rb") as stream:
        head = stream.read(_USER_BLOCK_BYTES + len(_HDF5))
    return head.startswith(_HDF5) or head.endswith(_HDF5)


def _times_since(counted: pd.Series[Any], since: re.Match[str]) -> pd.Series[Any]:
    start = pd.Timestamp(since[2])
    start = start.tz_localize("UTC") if start.tz is None else start
    whole_units = np.floor(counted)
    # pandas cuts off what is less than a nanosecond, and a count in binary is often short of it
    part_ns = np.rint((counted - whole_units) * _UNIT_NS[since[1]])
    return start + pd.to_timedelta(whole_units, unit=_UNITS[since[1]]) + pd.to_timedelta(part_ns, unit="ns")  # type: ignore[call-overload, no-any-return]


def _unpacked(values: NDArray[Any], metadata: Mapping[str, Any]) -> NDArray[Any]:
    """A variable's values in its unit, NaN where there is none."""
    missing = [np.ravel(metadata[name])[0] for name in ("_FillValue", "missing_value") if name in metadata]
    scale, offset = (
        np.ravel(metadata.get(name, usual))[0] for name, usual in (("scale_factor", 1), ("add_offset", 0))
    )
    result = values if (scale, offset) == (1, 0) else values * float(scale) + float(offset)
    return np.where(np.isin(values, missing), np.nan, result) if missing else result
