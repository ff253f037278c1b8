"""NetCDF as other programs write it: fill values, packing, dimensions and moments, with a known truth."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import netcdf_file

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.tables.import_table import propose_column_map
from seatrial.acquisition.tables.table_files import read_netcdf, times_since
from seatrial.acquisition.tables.time_columns import TimeColumn, resolve_times

h5py = pytest.importorskip("h5py", reason="h5py, which reads NetCDF-4, is not installed")
START = "2026-05-17 12:00:00"
NUMBERS = np.arange(60.0)
TRUTH = {"heading": 40.0 + NUMBERS / 2.0, "latitude": 63.4 + 1e-5 * NUMBERS}
MISSING = (5, 6)
pytestmark = pytest.mark.usefixtures("read_in_process")
FLOAT_FILL = 9.969209968386869e36  # NC_FILL_FLOAT and NC_FILL_DOUBLE of netcdf.h


def write(
    path: Path, is_netcdf_4: bool, variables: Mapping[str, tuple[tuple[str, ...], Any, dict[str, Any]]]
) -> None:
    """Variables with their dimensions and attributes, by the libraries of the two forms."""
    sizes = {
        name: size
        for names, values, _ in variables.values()
        for name, size in zip(names, values.shape, strict=True)
    }
    if not is_netcdf_4:
        with netcdf_file(path, "w") as file:
            for name, size in sizes.items():
                file.createDimension(name, size)
            for name, (names, values, about) in variables.items():
                variable = file.createVariable(name, values.dtype, names)
                variable[:] = values
                for key, value in about.items():
                    setattr(variable, key, value)
        return
    with h5py.File(path, "w") as file:
        for name, size in sizes.items():
            if name not in variables:
                file.create_dataset(name, data=np.arange(float(size)))
        for name, (_, values, about) in variables.items():
            file.create_dataset(name, data=values).attrs.update(about)
        for name in sizes:
            file[name].make_scale(name)
        for name, (names, _, _) in variables.items():
            for place, dimension in enumerate(names):
                if name != dimension:
                    file[name].dims[place].attach_scale(file[dimension])


def trip(heading: Any = TRUTH["heading"], **about: Any) -> dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]:
    """A trip whose heading is stored in another way."""
    return {
        "time": (("time",), NUMBERS, {"units": f"seconds since {START}"}),
        "heading": (("time",), np.asarray(heading), {"units": "degree", **about}),
        "latitude": (("time",), TRUTH["latitude"], {"units": "degrees_north"}),
    }


def with_gap(values: Any, fill: float, dtype: str) -> Any:
    return np.where(np.isin(NUMBERS, MISSING), fill, values).astype(dtype)


BOTH = pytest.mark.parametrize("is_netcdf_4", [False, True], ids=["classic", "netCDF-4"])
TWICE = 2.0 * TRUTH["heading"]
STORED: dict[str, tuple[Any, dict[str, Any]]] = {
    "a fill value in another precision": (with_gap(TRUTH["heading"], -999.9, "f4"), {"_FillValue": -999.9}),
    "the library's fill value": (with_gap(TRUTH["heading"], FLOAT_FILL, "f4"), {}),
    "the library's fill value of whole numbers": (with_gap(TWICE, -32767, "i2"), {"scale_factor": 0.5}),
    "a missing value as text": (with_gap(TRUTH["heading"], -1e4, "f8"), {"missing_value": "-10000"}),
    "two missing values": (
        np.where(MISSING[0] == NUMBERS, -7777.0, with_gap(TRUTH["heading"], -8888.0, "f8")),
        {"missing_value": np.array([-7777.0, -8888.0])},
    ),
    "a factor as text": (with_gap(TWICE, -1, "i2"), {"_FillValue": np.int16(-1), "scale_factor": "0.5"}),
    "bytes without a sign": (
        with_gap(TWICE, 255, "u1").view("i1"),
        {"_FillValue": np.int8(-1), "scale_factor": 0.5, "_Unsigned": "true"},
    ),
}


@BOTH
@pytest.mark.parametrize("name", STORED)
def test_missing_and_packed_values_are_those_that_were_written(
    name: str, is_netcdf_4: bool, tmp_path: Path
) -> None:
    values, about = STORED[name]
    write(tmp_path / "trip.nc", is_netcdf_4, trip(values, **about))
    columns = read_netcdf(tmp_path / "trip.nc").columns
    expected = np.where(np.isin(NUMBERS, MISSING), np.nan, TRUTH["heading"])
    np.testing.assert_allclose(columns["heading"], expected, rtol=1e-6)
    np.testing.assert_array_equal(columns["latitude"], TRUTH["latitude"])


@pytest.mark.parametrize(("fill", "dtype"), [(-9999, "u1"), (0.5, "i2"), (float("nan"), "i4"), (1e300, "f4")])
def test_fill_value_that_the_type_cannot_hold_hides_no_value(fill: float, dtype: str, tmp_path: Path) -> None:
    """-9999 would be 241 in a byte."""
    values = np.arange(60).astype(dtype) + np.array(190, dtype)
    write(tmp_path / "trip.nc", True, trip(values, _FillValue=fill))
    np.testing.assert_array_equal(read_netcdf(tmp_path / "trip.nc").columns["heading"], values)


@BOTH
def test_variables_along_other_dimensions_are_named(is_netcdf_4: bool, tmp_path: Path) -> None:
    """Wind with times of its own, and currents at several depths."""
    variables = trip() | {
        "wind_time": (("wind_time",), np.arange(20.0), {"units": f"seconds since {START}"}),
        "wind_speed": (("wind_time",), np.arange(20.0), {"units": "m s-1"}),
        "current": (("time", "depth"), np.ones((60, 4)), {"units": "m s-1"}),
    }
    write(tmp_path / "trip.nc", is_netcdf_4, variables)
    raw = read_netcdf(tmp_path / "trip.nc")
    assert not {"wind_speed", "current"} & set(raw.names)
    assert all(name in str(raw.remarks) for name in ("wind_speed", "current"))


@BOTH
def test_single_trajectory_is_a_track_and_two_are_one_line(is_netcdf_4: bool, tmp_path: Path) -> None:
    """As CF-1.11, H.4 stores them, in an array of trajectories and observations."""
    for count in (1, 2):
        variables = {
            name: (("trajectory", "obs"), np.repeat(values[np.newaxis], count, axis=0), about)
            for name, (_, values, about) in trip().items()
        }
        write(tmp_path / f"{count}.nc", is_netcdf_4, variables)
    raw = read_netcdf(tmp_path / "1.nc")
    np.testing.assert_array_equal(raw.columns["heading"], TRUTH["heading"])
    assert raw.remarks == ()
    with pytest.raises(InputError, match=r"its time has 2 dimensions.*one track a file"):
        read_netcdf(tmp_path / "2.nc")


def test_groups_are_named(tmp_path: Path) -> None:
    write(tmp_path / "trip.nc", True, trip())
    with h5py.File(tmp_path / "trip.nc", "a") as file:
        file.create_group("engine")["time"] = NUMBERS
    assert "engine" in str(read_netcdf(tmp_path / "trip.nc").remarks)
    with h5py.File(tmp_path / "trip.nc", "w") as file:
        file.create_group("engine")["time"] = NUMBERS
    with pytest.raises(InputError, match=r"name the file \.h5, and its groups are read"):
        read_netcdf(tmp_path / "trip.nc")


@pytest.mark.parametrize(
    "moment",
    [START, "2026-5-17 12:0:0", "2026-05-17T12:00:00Z", "2026/05/17 12:00", "20260517T120000Z",
     "17-MAY-2026 12:00:00", "2026-05-17 14:00:00 +2:00", "2026-05-17 12:00:00 0:00", "2026-05-17 07:00:00.0 EST",
     "2026-05-17 12:00 UTC"],
)  # fmt: skip
def test_moments_whose_date_is_plain_are_read(moment: str) -> None:
    """As UDUNITS, and programs beside it, write them."""
    times = times_since(np.array([0.0, 1.0]), f"seconds since {moment}", Path("trip.nc"))
    assert times is not None
    assert times[0] == pd.Timestamp(START, tz="UTC")


@pytest.mark.parametrize(
    "moment",
    ["05-06-2026 12:00:00", "1-1-1 00:00:0.0", "now", "2026-05-17 14:00 2:00", "2026-05-17 12:00 XYZ", "epoch"],
)
def test_moments_of_several_dates_are_one_line(moment: str) -> None:
    """UDUNITS' year 1 is no 2001, an unsigned zone no time of day."""
    with pytest.raises(InputError, match="no plain date"):
        times_since(np.array([0.0]), f"seconds since {moment}", Path("trip.nc"))


@BOTH
@pytest.mark.parametrize(
    "about",
    [
        {"calendar": "tai"},
        {"long_name": "TAI time"},
        {"time_scale": "TAI"},
        {"units": f"seconds since {START} TAI"},
    ],
    ids=str,
)
def test_times_of_tai_become_utc(about: dict[str, str], is_netcdf_4: bool, tmp_path: Path) -> None:
    """By their calendar (CF-1.12), unit or another attribute; they were refused, or taken for UTC."""
    variables = trip()
    variables["time"][2].update(about)
    write(tmp_path / "trip.nc", is_netcdf_4, variables)
    raw = read_netcdf(tmp_path / "trip.nc")
    column = TimeColumn(**tomllib.loads(propose_column_map(raw).text)["time"])
    assert resolve_times(raw, column).index[0] == pd.Timestamp(START, tz="UTC") - pd.Timedelta(37, "s")


def test_times_that_count_from_where_gps_time_does_are_reported(tmp_path: Path) -> None:
    variables = trip()
    for unit, is_reported in ((f"seconds since {START}", False), ("days since 1980-01-06 00:00:00 UTC", True)):
        variables["time"][2]["units"] = unit
        write(tmp_path / "trip.nc", True, variables)
        assert ("--answer zone=GPS" in " ".join(read_netcdf(tmp_path / "trip.nc").remarks)) == is_reported


@pytest.mark.parametrize("unit", ["months since 2026-05-17", "years since 2026-01-01"])
def test_times_in_units_of_no_one_length_are_one_line(unit: str, tmp_path: Path) -> None:
    variables = trip()
    variables["time"][2]["units"] = unit
    write(tmp_path / "trip.nc", True, variables)
    with pytest.raises(InputError, match="is not read; count them in seconds or days"):
        read_netcdf(tmp_path / "trip.nc")


def test_unit_of_times_without_a_start_is_kept(tmp_path: Path) -> None:
    """Hours would be taken for seconds without it."""
    variables = trip()
    variables["time"] = (("time",), NUMBERS / 3600.0, {"units": "hours"})
    write(tmp_path / "trip.nc", True, variables)
    assert read_netcdf(tmp_path / "trip.nc").units["time"] == "hours"
