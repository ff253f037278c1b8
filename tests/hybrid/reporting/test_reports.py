"""The reports as a customer gets them, of simulated trials and of the real ones where they are present: what every
page promises, whatever is in it."""

from __future__ import annotations

import html
import json
import re
import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.ship import BY_NAME
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.table import table_of
from seatrial.hybrid.report.folder import Choices, write_reports
from seatrial.notebooks.wang2021.campaign import CampaignJob, seas_of
from seatrial.notebooks.wang2021.figures import write_figures
from seatrial.notebooks.wang2021.page import write_table3
from seatrial.notebooks.wang2021.table3 import papers_jobs, table3
from tests.browser import running_browser

try:
    from weasyprint import HTML
except OSError:  # without the library Pango: the command says so, and writes no PDF
    HTML = None
pytestmark = pytest.mark.pages
ROOT = Path(__file__).resolve().parents[3]
MAPS, SOURCES = ROOT / "trials" / "columns", ROOT / "notebooks"
REAL = {
    "gunnerus_2019_docking": "docking_2019-11-09_part1.csv",
    "gunnerus_2022_trials": "trials_2022-10-27_part1.csv",
}


def text_of(page: Path) -> str:
    """What a reader reads on a page, and in its pictures' captions."""
    markup = re.sub(r"<(style|script).*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]*>", " ", markup))


def keeps_its_promises(page: Path, names: set[str]) -> str:
    """The text of a page without internal names, options, absolute paths, empty or failed sections, and network."""
    text, markup = text_of(page), page.read_text(encoding="utf-8")
    used = {name for name in names if re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)}
    assert not used, "names that programs use"
    assert "/channel/" not in text
    assert not re.findall(r"(?<!\S)`?--[a-z]", text), "options of the command line"
    assert not re.findall(r"(?<![\w.])/(?:[\w.-]+/)+[\w.-]*", text), "absolute paths"
    assert not re.findall(r"<h[23][^>]*>[^<]*</h[23]>\s*(?:<h2|</section>)", markup), "a section without a word"
    assert not re.findall(r"<table[^>]*>\s*</table>", markup), "a table without a row"
    for word in ("This section failed", "could not be made", "None", "nan ", "undefined"):
        assert word not in text, word
    assert "http" not in re.sub(r"base64,[^\"]+", "", markup)
    return text


def names_in(recording: Path) -> set[str]:
    """What programs call the channels of a recording, and all channels that there may be."""
    return {*BY_NAME, *read_recording(recording).series}


def pages_of(page: Path) -> int:
    """The number of sheets that a page takes."""
    if HTML is None:
        pytest.skip("no Pango to lay the page out with")
    return len(HTML(filename=str(page)).render().pages)


def reported(where: Path, *more: str) -> Path:
    """The page that the command makes, once as PDF."""
    done = CliRunner().invoke(seatrial.app, ["report", str(where), "--json", *more], catch_exceptions=False)
    found = json.loads(done.stdout)
    sheets = found["pages"] if HTML else []
    assert [Path(each).read_bytes()[:5] for each in found["pdf"]] == [b"%PDF-"] * len(sheets)
    return Path(found["report"])


@pytest.fixture(scope="module")
def circles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rudder ship's turning circles to both sides and a zigzag: 20 minutes."""
    path = tmp_path_factory.mktemp("circles") / "circles.mcap"
    seatrial.simulate(path, "kvlcc2_7m", manoeuvre="programme", duration_s=1200.0, rate_hz=2.0, seed=3)
    return path


def test_a_trial_has_the_report_of_a_deliverable(circles: Path) -> None:
    """One page of indices with port beside starboard, a verdict at the top, ten pages of paper at most."""
    page = reported(circles)
    text = keeps_its_promises(page, names_in(circles))
    assert pages_of(page) <= 10
    order = [
        "MSC.137(76)",
        "dimensions",
        "Programme",
        "Signatures",
        "Indices of manoeuvrability",
        "Test 1",
        "Appendix",
    ]
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    assert re.search(
        r"criterion\s+limit\s+port\s+95 % interval\s+result\s+starboard\s+95 % interval\s+result", text
    )
    assert re.search(r"test\s+index\s+port: mean, 95 %\s+starboard: mean, 95 %", text)
    assert "not shown" in text
    assert "the standards are for ships of 100 m and more, not 7 m; its limits are for information only" in text
    found = json.loads((page.parent / "indices.json").read_text())["circles"]
    assert {each["side"] for each in found if each["kind"] == "turning_circle"} == {"port", "starboard"}


def test_a_ship_without_a_model_has_a_report_of_her_own(circles: Path, tmp_path: Path) -> None:
    """Track, heading and helm of a yard's table: indices with the length that was given, and no word on models."""
    table = table_of(read_recording(circles))[["north_m", "east_m", "heading_deg", "surge_mps", "sway_mps",
                                               "yaw_rate_dps", "rudder_angle_deg"]]  # fmt: skip
    scale = 180.0 / 7.0  # by Froude's law to a ship of 180 m
    start = table.index[0]
    index = start + (table.index - start) * np.sqrt(scale)
    larger = table.assign(
        **{name: table[name] * scale for name in ("north_m", "east_m")},
        **{name: table[name] * np.sqrt(scale) for name in ("surge_mps", "sway_mps")},
        yaw_rate_dps=table["yaw_rate_dps"] / np.sqrt(scale),
    ).set_axis(pd.DatetimeIndex(index, name="time"))
    path = tmp_path / "yard.mcap"
    write_table(larger, path, Trial(name="yard 4711", vessel="Example", actuators="rudder:rudder"), source="table")
    page = reported(path, "--length", "180")
    text = keeps_its_promises(page, names_in(path))
    assert pages_of(page) <= 8
    assert "Sea trial report: Example" in text
    assert "0 of 13 criteria of IMO MSC.137(76) are shown and met; 13 are not shown" in text  # nothing of the day
    assert "the loading is not known" in text
    assert "The trial meets" not in text
    assert re.search(r"tactical diameter.*?≤ 900", text, re.DOTALL)
    assert "Simulation model and trial compared" not in text
    without = " ".join(keeps_its_promises(reported(path), names_in(path)).split())
    assert "the ship's length is not known" in without
    assert "The main dimensions of Example are not known" in without


@pytest.mark.parametrize("kept", [["north_m", "east_m"], ["heading_deg"]])
def test_a_recording_of_little_has_a_short_report_without_empty_sections(
    kept: list[str], circles: Path, tmp_path: Path
) -> None:
    path = tmp_path / "little.mcap"
    write_table(table_of(read_recording(circles))[kept], path, Trial(name="little"), source="table")
    page = reported(path, "--no-interactive")
    text = keeps_its_promises(page, names_in(path))
    assert pages_of(page) <= 3
    assert "No standard manoeuvre was found" in text


def test_no_page_is_wider_than_a_window_or_a_phone(circles: Path) -> None:
    page = reported(circles)
    with running_browser() as browser:
        for width in (390, 1400):
            browser.resize(width)
            browser.open(page, "document.readyState === 'complete'")
            assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_a_model_that_is_not_hers_is_said_in_the_headline(circles: Path) -> None:
    page = reported(circles, "--vessel", "esso_osaka_3m")
    text = keeps_its_promises(page, names_in(circles))
    said = text.index("use the model esso_osaka_3m, not the ship that the recording names (kvlcc2_7m)")
    assert said < text.index("dimensions")


def test_a_calibrator_is_judged_as_by_validate(unseen: Path, small_folder: Path, tmp_path: Path) -> None:
    """The numbers of `validate`, in the report of a folder with a calibrator."""
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / unseen.name).symlink_to(unseen)
    (tmp_path / "calibrator").symlink_to(small_folder)
    page = reported(tmp_path)
    text = keeps_its_promises(page, names_in(unseen))
    assert pages_of(page) <= 10
    said = CliRunner().invoke(seatrial.app, ["validate", str(unseen), "--calibrator", str(small_folder), "--json"])
    for name, score in json.loads(said.stdout)["methods"].items():
        words = name.removesuffix("_two_sided").replace("_", " ")
        assert re.search(rf"{words}\s+\S+\s+{score['mean_distance_m']:.3f}", text), name
    figures = tmp_path / "figures"
    names = {each.stem for each in figures.glob("*.svg")}
    assert names == {each.stem for each in figures.glob("*.json")}
    assert {"track", "channels", "errors_by_second", "residual_maps", "region_calibration"} <= names


def test_a_diagnosis_has_one_page(simulated: Callable[..., Path], tmp_path: Path) -> None:
    """The report of a diagnosis is the page that `diagnose` wrote, with what it says."""
    trial = simulated("gentle", 7, 900.0, 5.0)
    run = CliRunner().invoke(seatrial.app, ["diagnose", str(trial), "-o", str(tmp_path), "--json"])
    found = json.loads(run.stdout)
    page = reported(tmp_path)
    assert [each.name for each in tmp_path.glob("*.html")] == ["report.html"]
    text = keeps_its_promises(page, names_in(trial))
    for effect in found["effects"]:
        assert effect["sentence"] in text


@pytest.mark.parametrize(
    "jobs", [(CampaignJob("gentle", 0, sequences=12),), pytest.param(papers_jobs(0, 1), marks=pytest.mark.slow)]
)
def test_the_papers_results(jobs: list[CampaignJob], tmp_path: Path) -> None:
    """Table III, its figures and the published numbers beside: of a small campaign, by night of whole ones."""
    seas = seas_of(jobs)
    table = table3(seas)
    write_figures(seas, tmp_path)
    write_table3(table, tmp_path)
    (page,) = write_reports(tmp_path, Choices())
    text = text_of(page)
    assert "published hybrid" in text.replace("\u00a0", " ").replace("\u2011", "-")
    hybrid = next(
        row for row in table.as_dict()["rows"] if row["method"] == "hybrid" and row["split"] == "sequence"
    )
    assert f"{hybrid['mae_x_m']:.2f}" in text
    assert page.read_text().count("<figure>") >= 6
    run_as_script("paper_reproduction", folder=str(tmp_path))


@pytest.mark.shared
@pytest.mark.parametrize("name", sorted(REAL))
def test_a_real_trial(name: str, shared_data: Path, tmp_path: Path) -> None:
    recording = tmp_path / f"{name}.mcap"
    import_table(shared_data / name / REAL[name], recording, MAPS / f"{name}.toml")
    page = reported(recording)
    text = keeps_its_promises(page, names_in(recording))
    assert pages_of(page) <= 16  # six tests have a sheet each
    assert "Indices of manoeuvrability" in text


def run_as_script(name: str, **parameters: object) -> None:
    """A notebook from its first cell to its last, with other parameters."""
    import jupytext  # whose grammars take seconds to load

    source = jupytext.read(SOURCES / f"{name}.py")
    cells = [each for each in source.cells if each.cell_type == "code"]
    assert [each.metadata.get("tags") for each in cells].count(["parameters"]) == 1
    assert cells[0].metadata["tags"] == ["parameters"]
    assert max(len(each.source.splitlines()) for each in cells) <= 12
    values: dict[str, object] = {}
    exec(cells[0].source, values)
    values |= parameters
    for each in cells[1:]:
        exec(each.source, values)


def test_the_notebook_of_a_diagnosis_runs(simulated: Callable[..., Path], tmp_path: Path) -> None:
    CliRunner().invoke(seatrial.app, ["diagnose", str(simulated("gentle", 7, 900.0, 5.0)), "-o", str(tmp_path)])
    run_as_script("missing_effect", folder=str(tmp_path), figures_folder=str(tmp_path / "figures"))
    assert (tmp_path / "figures" / "parameters.svg").is_file()


def test_the_notebook_of_a_trial_shows_every_section(unseen: Path, tmp_path: Path) -> None:
    run_as_script("trial_validation", recordings=[str(unseen)], figures_folder=str(tmp_path))
    assert {"track.svg", "channels.svg", "errors_by_second.svg"} <= {each.name for each in tmp_path.iterdir()}


def test_a_notebook_that_is_a_map_computes_nothing_when_it_is_loaded() -> None:
    loaded = runpy.run_path(str(SOURCES / "fidelity_map.py"), run_name="fidelity_map")
    assert "found" not in loaded
    assert callable(loaded["papers_map"])
