"""The command, its JSON and its page; the pictures' marks."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, index_from_value
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.analysis.report.plots import STYLE, draw_manoeuvre
from seatrial.analysis.report.tables import (
    index_cells,
    manoeuvre_line,
    manoeuvre_settings_line,
    manoeuvres_of_recording,
    write_report,
)
from tests.analysis.manoeuvres.conftest import Sail


@pytest.fixture(scope="module")
def recording(sail: Sail, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("manoeuvres") / "zigzag.mcap"
    table = sail("gunnerus_short", "calm", "zigzag_20_20", 300.0).recorded.iloc[:300]
    write_table(table, path, Trial(name="zigzag"), source="simulated")
    return path


def test_json_has_the_keys_of_the_contract_and_nothing_else_on_stdout(recording: Path) -> None:
    run = CliRunner().invoke(app, ["manoeuvres", str(recording), "--json", "--length", "28.9"])
    assert run.exit_code == 0, run.output
    (found,) = json.loads(run.stdout)["recordings"]
    assert found["recording"] == str(recording)
    assert [each["kind"] for each in found["manoeuvres"]] == ["zigzag"]


def test_a_table_a_manoeuvre_for_people(recording: Path) -> None:
    run = CliRunner().invoke(app, ["manoeuvres", str(recording)], env={"COLUMNS": "140"})
    assert run.exit_code == 0, run.output
    assert "zigzag 20/20 to port" in run.stdout
    assert "overshoot 1" in run.stdout


def test_the_screen_shows_the_main_indices_and_all_on_request(recording: Path) -> None:
    short, full = (CliRunner().invoke(app, ["manoeuvres", str(recording), *option], env={"COLUMNS": "140"}).stdout
                   for option in ([], ["--all"]))  # fmt: skip
    for name in ("overshoot 1 ", "overshoot 2 ", "overshoot mean", "period"):
        assert name in short
    assert "time to check yaw" not in short
    for name in ("overshoot 3 ", "time to check yaw 1"):
        assert name in full


def test_settings_keep_their_units(recording: Path) -> None:
    (found,) = manoeuvres_of_recording(recording).manoeuvres
    text = manoeuvre_settings_line(found)
    for name, unit in (("azimuth", "deg"), ("half command", "s"), ("approach", "m/s"), ("port", "rpm")):
        assert re.search(rf"\b{name} -?[\d.]+ {unit}(,|;|$)", text), text


@pytest.mark.parametrize(
    ("heading_deg", "words"), [(359.98, "heading 0 deg"), (0.0, "heading 0 deg"), (359.4, "heading 359 deg")]
)
def test_a_heading_that_rounds_to_a_whole_turn_is_north(heading_deg: float, words: str) -> None:
    at = pd.Timestamp("2026-06-01T08:00Z")
    run = Manoeuvre("speed_run", "speed run", at, at, "", {"approach_heading_deg": heading_deg}, {})
    assert words in manoeuvre_settings_line(run)


def test_a_limit_is_shown_with_its_unit_and_in_lengths() -> None:
    advance = replace(index_from_value("advance_m", 100.0, 1.0, 50.0), limit=225.0)
    assert index_cells(advance)[-1] == "225.0 m (4.5 L)"
    overshoot = replace(index_from_value("overshoot_1_deg", 8.0, 1.0, 50.0), limit=10.0)
    assert index_cells(overshoot)[-1] == "10.0 deg"


def test_a_report_that_fails_leaves_the_older_one(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [manoeuvres_of_recording(recording)]
    plain, page = write_report(found, tmp_path)
    before = plain.read_bytes(), page.read_bytes()

    def full(self: Path, *_: object, **__: object) -> int:
        with self.open("w") as stream:
            stream.write("{")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(StorageError):
        write_report(found, tmp_path, 28.9)
    assert (plain.read_bytes(), page.read_bytes()) == before
    assert {each.name for each in tmp_path.iterdir()} == {plain.name, page.name}


def test_a_folder_with_json_and_a_page(recording: Path, tmp_path: Path) -> None:
    run = CliRunner().invoke(app, ["manoeuvres", str(recording), "-o", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    assert json.loads((tmp_path / "out" / "manoeuvres.json").read_text())["recordings"]
    html = (tmp_path / "out" / "manoeuvres.html").read_text()
    assert html.count("data:image/png") == 1


def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_text("nothing")
    run = CliRunner().invoke(app, ["manoeuvres", str(tmp_path / "no.mcap")])
    assert run.exit_code != 0


def test_pictures_are_to_scale_and_mark_every_overshoot(sail: Sail) -> None:
    for manoeuvre, kind in (("zigzag_20_20", "zigzag"), ("turning_circle_30", "turning_circle")):
        table = sail("gunnerus_short", "calm", manoeuvre, 300.0 if kind == "zigzag" else 800.0).recorded
        found = next(each for each in find_manoeuvres(table) if each.kind == kind)
        with mpl.rc_context(STYLE):
            figure = Figure()
            draw_manoeuvre(figure, motion_of(table, 28.9), found)
        first = figure.axes[0]
        texts = [text.get_text() for text in first.texts]
        if kind == "zigzag":
            overshoots = [name for name in found.indices if name.startswith("overshoot") and name[-5].isdigit()]
            assert len(texts) == len(overshoots)
        else:
            assert first.get_aspect() == 1.0
            assert sum("advance" in text for text in texts) == 1


def test_the_line_of_a_manoeuvre_has_the_values_of_its_figure() -> None:
    """The current removed where it is known, and overshoots from the order first."""
    start = pd.Timestamp("2026-05-01 10:00", tz="UTC")
    circle = {
        "advance_m": Index(600.0, 599.0, 601.0, "m"),
        "advance_m_current_removed": Index(580.0, 579.0, 581.0, "m"),
    }
    zigzag = {
        "overshoot_1_deg": Index(7.0, 6.9, 7.1, "deg"),
        "overshoot_1_from_order_deg": Index(12.0, 11.9, 12.1, "deg"),
    }
    line = manoeuvre_line(Manoeuvre("turning_circle", "turning circle 35 deg", start, start, "port", {}, circle))
    assert line[-1] == f"advance {index_cells(circle['advance_m_current_removed'])[0]} (current removed)"
    line = manoeuvre_line(Manoeuvre("zigzag", "zigzag 20/20", start, start, "port", {}, zigzag))
    assert line[-1].startswith("overshoot 1 from order 12.0")
