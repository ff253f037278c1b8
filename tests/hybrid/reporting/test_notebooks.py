"""The three notebooks, run: on simulated trials, and on the real ones where they are present."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

import seatrial
from acquisition.tables.import_table import import_table
from hybrid.report.folder import Choices, report
from tests.browser import Browser, running_browser

pytestmark = [pytest.mark.pages, pytest.mark.timeout(900)]
MAPS = Path(__file__).resolve().parents[3] / "trials" / "columns"
REAL = {
    "gunnerus_2019_docking": "docking_2019-11-09_part1.csv",
    "gunnerus_2022_trials": "trials_2022-10-27_part1.csv",
}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with running_browser() as opened:
        yield opened


def looked_at(browser: Browser, page: Path, least_pictures: int) -> str:
    """The page's text, once a browser has opened it and asked for nothing but the file itself."""
    browser.requests.clear()
    browser.errors.clear()
    browser.open(page, "document.readyState === 'complete'")
    elsewhere = [each for each in browser.requests if not each.startswith(("file:", "data:"))]
    assert not elsewhere
    assert not browser.errors
    widths = browser.evaluate("[...document.images].map(image => image.naturalWidth)")
    assert len(widths) >= least_pictures
    assert min(widths) > 100
    lost = "[...document.querySelectorAll('nav a')].filter(a => !document.getElementById(a.hash.slice(1)))"
    assert browser.evaluate(f"{lost}.length") == 0
    assert browser.evaluate("document.querySelectorAll('nav a').length") >= 3
    wide = browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth + 1")
    assert wide, "the page is wider than the window"
    return str(browser.evaluate("document.body.innerText"))


def figures_of(folder: Path) -> set[str]:
    """The names of the figures there, each with its three files and numbers that JSON knows."""
    names = {path.stem for path in folder.glob("*.svg")}
    assert (
        names
        == {path.stem for path in folder.glob("*.pdf")}
        == {path.stem for path in folder.glob("*.json")} - {"table3"}
    )
    for name in names:
        assert json.loads((folder / f"{name}.json").read_text())["axes"], name
    return names


def test_a_trial(unseen: Path, small_folder: Path, tmp_path: Path, browser: Browser) -> None:
    """All sections, from one command; the numbers are those of `validate`."""
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / unseen.name).symlink_to(unseen)
    (tmp_path / "calibrator").symlink_to(small_folder)
    done = CliRunner().invoke(seatrial.app, ["report", str(tmp_path), "--json"], catch_exceptions=False)
    page = Path(json.loads(done.stdout)["report"])
    text = looked_at(browser, page, 12)
    said = CliRunner().invoke(seatrial.app, ["validate", str(unseen), "--calibrator", str(small_folder), "--json"])
    for name, score in json.loads(said.stdout)["methods"].items():
        assert re.search(rf"{name.replace('_', ' ')}\s+{score['mean_distance_m']:.3f}", text), name
    for words in ("Run sheet", "SHA-256", "Data quality", "Manoeuvres", "PICP", "IMO", "Parameters", "zoom into"):
        assert words in text
    assert "could not be made" not in text
    figures = figures_of(tmp_path / "figures")
    assert {"track", "time_series", "errors_by_second", "prediction_fans"} <= figures
    assert {"error_distributions", "region_calibration", "residual_maps", "training_range"} <= figures
    assert (tmp_path / "report.ipynb").is_file()
    assert (tmp_path / "interactive.html").stat().st_size > 1_000_000


def test_a_diagnosis(simulated: Callable[..., Path], tmp_path: Path, browser: Browser) -> None:
    """The story says the verdict, the effects' sentences and the gap as `diagnose` says them."""
    trial = simulated("gentle", 7, 900.0, 5.0)
    run = CliRunner().invoke(seatrial.app, ["diagnose", str(trial), "-o", str(tmp_path), "--json"])
    found = json.loads(run.stdout)
    (page,) = report(tmp_path, Choices())
    text = looked_at(browser, page, 6)
    for words in ("Found", "Named", "Added", "Shown", f"{found['gap']['before_m']:.2f} m"):
        assert words in text
    for effect in found["effects"]:
        assert effect["sentence"] in text
        assert f"[effects.{effect['name']}]" in text
    assert {"parameters"} <= figures_of(tmp_path / "figures")


def test_the_papers_results(tmp_path: Path, browser: Browser) -> None:
    """Table III of one small campaign, its figures, the published numbers beside."""
    run = CliRunner().invoke(seatrial.app, ["reproduce", "table3", "-o", str(tmp_path), "--seeds", "1", "--json"])
    rows = json.loads(run.stdout)["rows"]
    (page,) = report(tmp_path, Choices())
    text = looked_at(browser, page, 6)
    assert "published hybrid" in text.replace("\u00a0", " ")
    hybrid = next(row for row in rows if row["method"] == "hybrid" and row["split"] == "sequence")
    assert f"{hybrid['mae_x_m']:.2f}" in text
    assert figures_of(tmp_path) >= {"figure_04_tracks", "figure_10_distribution"}


@pytest.mark.shared
@pytest.mark.parametrize("name", sorted(REAL))
def test_a_real_trial(name: str, shared_data: Path, tmp_path: Path, browser: Browser) -> None:
    """It may be that nothing is held, or that the model leaves its range: the page says so and stands."""
    recording = tmp_path / f"{name}.mcap"
    import_table(shared_data / name / REAL[name], recording, MAPS / f"{name}.toml")
    (page,) = report(recording, Choices(repair=True))
    text = looked_at(browser, page, 6)
    assert "What was found in the data" in text
    assert {"track", "time_series"} <= figures_of(page.parent / "figures")
