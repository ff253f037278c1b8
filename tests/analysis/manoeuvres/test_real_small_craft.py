"""Recordings of small craft: a zigzag of many swings, helm by two propellers, four azimuths that keep a place."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.analysis.manoeuvres.find import find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import LeftOut, Manoeuvre
from seatrial.analysis.tables.table import read_table

pytestmark = pytest.mark.shared

OTTER = """
unreadable_rows = "drop"
absent = ["surge_mps", "sway_mps", "wind_direction_deg", "wind_speed_mps"]
[trial]
vessel = "otter_2m"
[time]
column = "current_time"
format = "seconds"
[position]
latitude = "lat"
longitude = "lon"
[channels]
heading_deg = { column = "current_orientation_3", unit = "deg" }
yaw_rate_dps = { column = "current_rotational_velocities_3", unit = "deg/s" }
port_rpm = { column = "n1", unit = "rpm" }
starboard_rpm = { column = "n2", unit = "rpm" }
"""


def manoeuvres_of(
    source: Path, folder: Path, columns: str = ""
) -> tuple[tuple[Manoeuvre, ...], tuple[LeftOut, ...]]:
    if not source.is_file():
        pytest.skip(f"no recording {source}")
    (folder / "map.toml").write_text(columns)
    how = ["--columns", str(folder / "map.toml")] if columns else ["--yes"]
    output = folder / "trial.mcap"
    result = CliRunner().invoke(app, ["import", str(source), "-o", str(output), *how])
    assert result.exit_code == 0, result.output
    return find_manoeuvres_and_left_out(read_table(output))


def test_a_zigzag_that_begins_before_its_recording_is_one_with_all_its_swings(
    shared_data: Path, tmp_path: Path
) -> None:
    (run,), _ = manoeuvres_of(shared_data / "usv_rudder" / "zigzag.csv.gz", tmp_path)
    assert run.kind == "zigzag"
    assert run.settings["swings"] >= 11
    assert run.shortfalls == ("the approach was not steady",)
    assert "initial_turning_m" not in run.indices


@pytest.mark.parametrize("name", ["2024-04-23_12-22-102", "2024-04-23_12-44-083"])
def test_a_path_followed_by_two_propellers_holds_no_test_and_says_why(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    runs, left_out = manoeuvres_of(shared_data / "otter" / f"{name}.csv.gz", tmp_path, OTTER)
    assert not {run.kind for run in runs} & {"zigzag", "turning_circle"}
    assert {each.kind for each in left_out} & {"turning_circle", "zigzag"}
    assert all("no helm was recorded" not in each.why for each in left_out)


def test_dynamic_positioning_holds_no_manoeuvre_and_says_why(shared_data: Path, tmp_path: Path) -> None:
    runs, left_out = manoeuvres_of(shared_data / "milliampere" / "ma_qp1.csv.gz", tmp_path)
    assert runs == ()
    assert "thrust of 4 drives" in left_out[0].why
