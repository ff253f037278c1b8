"""Results of several dimensions as xarray datasets: the same numbers, named, with units, and writable as NetCDF."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError


def test_windows_have_the_channels_by_window_and_second(unseen: Path) -> None:
    pytest.importorskip("xarray", reason="to_xarray() needs xarray")
    held = st.windows(unseen, horizon_s=30, all_windows=True)
    dataset = held.to_xarray()
    assert dict(dataset.sizes) == {"window": held.kept, "second": 31}
    for _, row in held.rows.sample(20, random_state=0).iterrows():
        place = dataset.sel(window=row["window"], second=row["second"])
        assert float(place["heading_deg"]) == row["heading_deg"]
        assert str(place["leg"].item()) == row["leg"]
        assert bool(place["held"]) == row["held"]
        assert np.datetime64(place["start"].values, "ns") == row["start"].tz_convert(None).to_datetime64()
    assert dataset["yaw_rate_dps"].attrs["units"] == "deg/s"
    assert json.loads(dataset.attrs["trials"])[held.rows["trial"].iloc[0]]["vessel"] == "gunnerus_long"


def test_no_window_is_a_dataset_without_windows(unseen: Path) -> None:
    pytest.importorskip("xarray", reason="to_xarray() needs xarray")
    table = st.prepare(unseen).iloc[:5]
    assert dict(st.windows(table).to_xarray().sizes) == {"window": 0, "second": 16}


def test_smoothed_motion_has_its_covariance_by_state(unseen: Path) -> None:
    pytest.importorskip("xarray", reason="to_xarray() needs xarray")
    smoothed = st.smooth(unseen)
    dataset = smoothed.to_xarray()
    variance = dataset["covariance"].sel(state="north_m", other_state="north_m")
    np.testing.assert_allclose(np.sqrt(variance), smoothed.standard_deviations()["north_m"])
    np.testing.assert_array_equal(dataset["surge_mps"], smoothed.states["surge_mps"])
    assert dataset["surge_mps"].attrs["units"] == "m/s"
    assert json.loads(dataset.attrs["trial"])["vessel"] == "gunnerus_long"


def test_datasets_go_to_netcdf_and_back(unseen: Path, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray", reason="to_xarray() needs xarray")
    for number, dataset in enumerate((st.windows(unseen).to_xarray(), st.smooth(unseen).to_xarray())):
        dataset.to_netcdf(tmp_path / f"{number}.nc", engine="scipy")
        with xarray.open_dataset(tmp_path / f"{number}.nc", engine="scipy") as again:
            np.testing.assert_array_equal(again["heading_deg"], dataset["heading_deg"])


def test_a_recording_opens_as_its_netcdf_file_does(unseen: Path, tmp_path: Path) -> None:
    """The same variables, values, flags and attributes; and a table as well as a file."""
    xarray = pytest.importorskip("xarray", reason="open_dataset() needs xarray")
    opened = st.open_dataset(unseen)
    (path,) = st.export(unseen, tmp_path / "trial.nc")
    with xarray.open_dataset(path, engine="scipy") as written:
        names = {name for name in (*written.variables,) if name != "trajectory"}
        assert names == {*opened.variables}
        for name in names - {"time"}:
            np.testing.assert_array_equal(opened[name], written[name])
            inside = {key: value for key, value in written[name].attrs.items() if key != "_FillValue"}
            assert set(inside) == set(opened[name].attrs)
        offset = np.abs(opened["time"].values - written["time"].values)
        assert offset.max() <= np.timedelta64(1, "us")
        assert {**written.attrs}["title"] == opened.attrs["title"]
    table = st.prepare(unseen, rate_hz=1.0)
    again = st.open_dataset(table)
    np.testing.assert_array_equal(again["heading_deg"], table["heading_deg"])
    assert again["heading_deg"].attrs["standard_name"] == "platform_orientation"
    assert again.attrs["processing_level"] == "resampled to 1 Hz"


def test_without_xarray_the_error_says_what_to_install(unseen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'seatrial\[xarray\]'"):
        st.windows(unseen).to_xarray()
