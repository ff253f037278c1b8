"""NetCDF for data centres: CF's structure, ACDD's attributes, flags beside the values, and what a checker says."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d
import pytest
from scipy.io import netcdf_file

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import CHANNELS, NAMES
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.check import check_recording
from seatrial.analysis.quality.repairs import Preparation, prepare_table
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.table import read_table
from tests.analysis.conftest import steady_table, table_at
from tests.conftest import Command

ORIGIN = (63.4, 10.4)
TRIAL = Trial(
    name="docking 2", vessel="gunnerus_long", place="Trondheimsfjord", origin_latitude_deg=ORIGIN[0],
    origin_longitude_deg=ORIGIN[1], crew_notes="calm, nøkkel", license="CC-BY-4.0", creator_name="A. Person",
)  # fmt: skip
COLUMNS = Path(__file__).parents[2] / "trials" / "columns"


def read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Global attributes, and variables with their attributes; text as text."""

    def said(of: Any) -> dict[str, Any]:
        return {key: each.decode() if isinstance(each, bytes) else each for key, each in of._attributes.items()}

    with netcdf_file(path, mmap=False) as file:
        return said(file), {
            name: {"values": each.data.copy(), "dimensions": each.dimensions, **said(each)}
            for name, each in file.variables.items()
        }


def moving_table(seconds: int = 120) -> pd.DataFrame:
    """A ship on her way north-east, one sample missing."""
    table = steady_table(seconds)
    table["north_m"], table["east_m"] = np.arange(seconds) * 3.0, np.arange(seconds) * 4.0
    table.iloc[7, table.columns.get_loc("tunnel_rpm")] = np.nan
    return table


@pytest.fixture
def exported(tmp_path: Path, command: Command) -> Path:
    write_table(moving_table(), tmp_path / "trial.mcap", TRIAL)
    done = command("export", tmp_path / "trial.mcap", "-o", tmp_path / "trial.nc", "--attribute", "project=Twin")
    assert done.code == 0, done.err
    assert "creator_email, institution;" in done.err
    return tmp_path / "trial.nc"


def test_a_trajectory_as_the_conventions_have_it(exported: Path) -> None:
    said, variables = read(exported)
    assert (said["Conventions"], said["featureType"]) == ("CF-1.11, ACDD-1.3", "trajectory")
    identifier = variables["trajectory"]
    assert identifier["cf_role"] == "trajectory_id"
    assert identifier["values"].tobytes().decode() == said["id"] == "docking_2"
    for axis, (name, standard) in {
        "T": ("time", "time"),
        "Y": ("lat", "latitude"),
        "X": ("lon", "longitude"),
    }.items():
        assert (variables[name]["axis"], variables[name]["standard_name"]) == (axis, standard)
        assert variables[name]["dimensions"] == ("obs",)
    assert [name for name, each in variables.items() if each.get("axis")] == ["time", "lat", "lon"]
    for channel in CHANNELS:
        variable = variables[channel.name]
        assert variable["long_name"] == channel.meaning
        known = set(variable.get("coordinates", "").split())
        assert {"time", "lat", "lon", "port_rpm"} <= known if "standard_name" in variable else not known


def test_places_are_those_of_the_tangent_plane(exported: Path) -> None:
    said, variables = read(exported)
    north, east, _ = pymap3d.geodetic2ned(variables["lat"]["values"], variables["lon"]["values"], 0.0, *ORIGIN, 0.0)
    np.testing.assert_allclose(north, np.arange(120) * 3.0, atol=1e-6)
    np.testing.assert_allclose(east, np.arange(120) * 4.0, atol=1e-6)
    assert said["geospatial_lat_max"] == variables["lat"]["values"].max()
    assert said["geospatial_lon_min"] == variables["lon"]["values"].min()
    assert said["geospatial_bounds"].startswith("POLYGON ((63.4000000 10.4000000, ")


def test_flags_stand_beside_what_they_judge(exported: Path) -> None:
    _, variables = read(exported)
    flags = variables["surge_mps_flag"]
    assert "surge_mps_flag" in variables["surge_mps"]["ancillary_variables"].split()
    assert flags["values"].dtype == flags["flag_values"].dtype == np.dtype("int8")
    meanings = dict(zip(flags["flag_values"].tolist(), flags["flag_meanings"].split(), strict=True))
    assert meanings == {1: "pass", 2: "not_evaluated", 3: "suspect", 4: "fail", 9: "missing"}
    judged = check_recording(read_recording(exported.with_suffix(".mcap"))).flags
    for name in judged.columns:
        assert variables[f"{name}_flag"]["values"].tolist() == judged[name].tolist()
    assert variables["tunnel_rpm_flag"]["values"][7] == 9


def test_what_a_trial_says_of_itself_is_there_and_a_user_adds_to_it(exported: Path) -> None:
    said, variables = read(exported)
    assert "docking 2" in said["title"]
    assert "gunnerus_long, Trondheimsfjord" in said["title"]
    assert said["id"] == "docking_2"
    assert said["comment"] == "calm, nøkkel"
    assert (said["license"], said["creator_name"], said["project"]) == ("CC-BY-4.0", "A. Person", "Twin")
    assert "institution" not in said
    start, end = (pd.Timestamp(said[f"time_coverage_{which}"]) for which in ("start", "end"))
    assert (end - start).total_seconds() == variables["time"]["values"][-1] - variables["time"]["values"][0]
    assert pd.Timestamp(variables["time"]["units"].removeprefix("seconds since ")) == start
    assert (said["time_coverage_duration"], said["time_coverage_resolution"]) == ("PT119S", "PT1S")


def test_a_row_without_a_position_is_between_its_neighbours_and_nowhere_in_a_gap(tmp_path: Path) -> None:
    """Three positions one second apart with other samples between, then none for a minute."""
    seconds = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 30.0, 62.0])
    north = np.array([0.0, np.nan, 10.0, np.nan, 20.0, np.nan, 30.0])
    table = table_at(seconds, {"north_m": north, "east_m": north * 0.0, "surge_mps": seconds})
    table.attrs["trial"] = {"origin_latitude_deg": 0.0, "origin_longitude_deg": 180.0}
    export_table(table, tmp_path / "gap.nc")
    lat = read(tmp_path / "gap.nc")[1]["lat"]["values"]
    assert lat[1] == pytest.approx((lat[0] + lat[2]) / 2)
    assert np.isnan(lat[5])
    assert np.isfinite(np.delete(lat, 5)).all()


def test_longitudes_go_on_across_the_date_line(tmp_path: Path) -> None:
    longitude = np.array([179.998, np.nan, -179.998])
    table = table_at([0.0, 0.5, 1.0], {"latitude_deg": [1.0, np.nan, 1.0], "longitude_deg": longitude})
    export_table(table, tmp_path / "line.nc")
    lon = read(tmp_path / "line.nc")[1]["lon"]["values"]
    assert abs(lon[1]) == pytest.approx(180.0)
    np.testing.assert_allclose(lon[[0, 2]], longitude[[0, 2]])


def test_without_an_origin_north_and_east_are_the_coordinates(tmp_path: Path, command: Command) -> None:
    nowhere = replace(TRIAL, origin_latitude_deg=None, origin_longitude_deg=None)
    write_table(moving_table(), tmp_path / "trial.mcap", nowhere)
    done = command("export", tmp_path / "trial.mcap", "-o", tmp_path / "trial.nc", "--rate", "2")
    assert done.code == 0
    assert "no latitude and longitude" in done.err
    said, variables = read(tmp_path / "trial.nc")
    assert "lat" not in variables
    assert (variables["north_m"]["axis"], variables["east_m"]["axis"]) == ("Y", "X")
    assert "north_m east_m" in variables["heading_deg"]["coordinates"]
    assert said["time_coverage_resolution"] == "PT0.5S"


def test_an_attribute_is_a_name_and_a_value_of_a_netcdf(tmp_path: Path, command: Command) -> None:
    write_table(moving_table(), tmp_path / "trial.mcap", TRIAL)
    for output, given in (("trial.nc", "license"), ("trial.nc", "two words=x"), ("trial.csv", "license=CC0")):
        done = command("export", tmp_path / "trial.mcap", "-o", tmp_path / output, "--attribute", given)
        assert done.code == 2
        assert not (tmp_path / output).exists()


def test_netcdf_of_others_imports_of_either_format(tmp_path: Path) -> None:
    """Days since some date, a fill value; what is no file of the newer format is one line."""
    with netcdf_file(tmp_path / "other.nc", "w") as file:
        file.createDimension("time", 3)
        for name, values, unit in (
            ("time", [0.0, 0.5, 1.0], b"days since 2026-01-01"),
            ("wind_speed_mps", [1, 2, -9], b""),
        ):
            variable = file.createVariable(name, "f8", ("time",))
            variable[:], variable.units = values, unit
        file.variables["wind_speed_mps"]._FillValue = np.array(-9.0)
    import_table(tmp_path / "other.nc", tmp_path / "other.mcap", allow_missing=True)
    table = read_table(tmp_path / "other.mcap")
    assert table["wind_speed_mps"].tolist() == [1.0, 2.0]
    assert table.index[1] == pd.Timestamp("2026-01-01T12:00:00Z")
    (tmp_path / "new.nc").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(InputError, match=r"not a readable \.nc"):
        import_table(tmp_path / "new.nc", tmp_path / "new.mcap")


@pytest.fixture
def checker() -> str:
    beside = Path(sys.executable).with_name("compliance-checker")
    found = str(beside) if beside.exists() else shutil.which("compliance-checker")
    return found or pytest.skip("no compliance-checker; `make oracle` installs it")


def findings(checker: str, path: Path) -> str:
    """What is left of high priority, by both conventions; empty if nothing."""
    asked = [checker, "--criteria", "lenient", "-t", "cf:1.11", "-t", "acdd:1.3", str(path)]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return "".join(line for line in done.stdout.splitlines() if line.strip() in ("Errors", "Highly Recommended"))


@pytest.mark.parametrize("how", [Preparation(flags=True), Preparation(2.0, smooth=True, flags=True)])
def test_the_checker_of_data_centres_finds_nothing_grave(checker: str, tmp_path: Path, how: Preparation) -> None:
    write_table(moving_table().drop(columns=NAMES[-1]), tmp_path / "trial.mcap", TRIAL)
    export_table(prepare_table(read_recording(tmp_path / "trial.mcap"), how), tmp_path / "trial.nc")
    assert not findings(checker, tmp_path / "trial.nc")


@pytest.mark.shared
@pytest.mark.parametrize("trial", ["gunnerus_2019_docking", "gunnerus_2022_trials"])
def test_nor_in_the_measured_trials(checker: str, shared_data: Path, tmp_path: Path, trial: str) -> None:
    (table,) = (shared_data / trial).glob("*.csv")
    import_table(table, tmp_path / "trial.mcap", COLUMNS / f"{trial}.toml")
    measured = prepare_table(read_recording(tmp_path / "trial.mcap"), Preparation(flags=True))
    export_table(measured, tmp_path / "trial.nc")
    assert not findings(checker, tmp_path / "trial.nc")
    import_table(tmp_path / "trial.nc", tmp_path / "again.mcap")
    again, once = read_table(tmp_path / "again.mcap"), read_table(tmp_path / "trial.mcap")
    pd.testing.assert_frame_equal(again, once, check_exact=True)
    assert again.attrs["trial"] == once.attrs["trial"]
