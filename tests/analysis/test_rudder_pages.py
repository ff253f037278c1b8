"""Tables, plots, pages and the batch of ships with propellers and rudders."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from seatrial.acquisition.core.ship import Actuator, actuators_as_text, control_names, order_channel_name
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import read_table_file
from seatrial.analysis.batch import process_recording
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.analysis.report.interactive import interactive_page, page_data
from seatrial.analysis.report.pages import fill_figure, numbers_in_figure
from seatrial.analysis.report.plots import axis_label, channels_figure, control_groups, draw_manoeuvre, track_figure
from seatrial.analysis.report.tables import run_sheet_rows
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import table_actuators, table_of
from tests.analysis.rudder_ships import MODEL, TWIN, Ship, sail, zigzag
from tests.conftest import nightly

SHIPS = {"single": (Ship(), 120.0, 420.0), "twin": (replace(Ship(), actuators=TWIN), 120.0, 420.0),
         "model": (MODEL, 600.0, 130.0)}  # fmt: skip


some_ships = pytest.mark.parametrize("trial", ["single", "model", *nightly("twin")], indirect=True)


@pytest.fixture(scope="module", params=SHIPS)
def trial(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a zigzag 20/20."""
    ship, rpm, duration_s = SHIPS[request.param]
    path = tmp_path_factory.mktemp("rudder") / f"{request.param}.mcap"
    trial = Trial(name=request.param, actuators=actuators_as_text(ship.actuators))
    write_table(sail(ship, zigzag(20.0, 20.0, rpm), duration_s), path, trial, source="by hand")
    return path


@pytest.fixture(scope="module")
def table(trial: Path) -> pd.DataFrame:
    return table_of(read_recording(trial))


@some_ships
def test_a_table_keeps_its_ship_through_every_kind_of_file(table: pd.DataFrame, tmp_path: Path) -> None:
    ship = table_actuators(table)
    assert [each.kind for each in ship if each.drives] == ["propeller"] * (len(ship) // 2)
    for ending in ("csv", "parquet", "mat"):
        written, *_ = export_table(resample(table, 1.0), tmp_path / f"table.{ending}")
        again = read_table_file(written)
        assert again.trial.actuators == actuators_as_text(ship)
        assert set(control_names(ship)) <= set(again.table.columns)


def test_the_channels_figure_has_a_panel_a_quantity(table: pd.DataFrame) -> None:
    one_hz = resample(table, 1.0)
    drawing = channels_figure(one_hz)
    assert drawing is not None
    numbers = numbers_in_figure(fill_figure(*drawing[:2]))
    controls = control_names(table_actuators(table))
    if len(controls) > 2:
        labels = re.findall(r'"label": "([^"]*)"', json.dumps(numbers))
        assert {axis_label(name) for name in controls} <= set(labels)
    groups = control_groups(table_actuators(table))
    assert list(groups) == ["rudders [deg]", "shafts [rpm]"]
    track = track_figure(one_hz)
    assert track is not None
    assert "controls" not in track[2]


@some_ships
def test_the_picture_of_a_zigzag_shows_the_rudder_and_what_was_ordered(table: pd.DataFrame) -> None:
    (found,) = (each for each in find_manoeuvres(table) if each.kind == "zigzag")
    angles = [name for name in control_names(table_actuators(table)) if name.endswith("_angle_deg")]
    ordered = table.assign(**{order_channel_name(name): table[name].shift(-5) for name in angles})
    for recorded, labels in ((table, {"rudder"}), (ordered, {"rudder", "rudder, ordered"})):
        motion = motion_of(recorded)
        shown = json.dumps(
            numbers_in_figure(
                fill_figure(lambda figure, motion=motion: draw_manoeuvre(figure, motion, found), (9.0, 5.0))
            )
        )
        assert set(re.findall(r'"label": "(rudder[^"]*)"', shown)) == labels
        assert "azimuth" not in shown


def test_the_interactive_page_groups_the_controls(table: pd.DataFrame) -> None:
    one_hz = resample(table, 1.0)
    assert set(control_names(table_actuators(table))) <= set(page_data(one_hz)["channels"])
    html = interactive_page(one_hz).html
    found = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    titles = [each["title"] for each in json.loads(found[1])["style"]["panels"]]
    assert titles[-4:-2] == ["shafts [rpm]", "rudders [deg]"]
    assert "controls held" in html


@pytest.mark.slow
def test_a_batch_has_her_row_and_page(trial: Path, tmp_path: Path) -> None:
    row = process_recording(trial, tmp_path / "out")
    assert (row["status"], row["missing"], row["manoeuvres"]["zigzag"]) == ("done", [], 1)
    page = (tmp_path / "out" / "page.html").read_text(encoding="utf-8")
    assert "zigzag 20/20" in page
    assert "azimuth" not in page
    assert "rudder (rudder)" not in page  # nothing is said twice
    assert "rudder" in page


def test_pitch_and_nozzles_have_groups_of_their_own() -> None:
    ship = (Actuator("main", "controllable_propeller"), Actuator("jet", "waterjet"), Actuator("bow", "tunnel"))
    assert control_groups(ship) == {
        "nozzles [deg]": ["jet_angle_deg"],
        "shafts [rpm]": ["main_rpm", "jet_rpm", "bow_rpm"],
        "pitch [%]": ["main_pitch_percent"],
    }


def test_the_run_sheet_says_what_drives_and_steers_her(trial: Path, table: pd.DataFrame) -> None:
    said = dict(run_sheet_rows(read_recording(trial), resample(table, 1.0)))["actuators"]
    assert said in ("propeller, rudder", "port (propeller), starboard (propeller), port rudder, starboard rudder")
