"""The sections of a trial's report: what they say is what was computed, with a calibrator and without, offline."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from acquisition.errors import StorageError
from analysis.page import Page
from hybrid.reporting import ground_sections as ground
from hybrid.reporting import prediction_sections as prediction
from hybrid.reporting import trial_sections as trial
from hybrid.reporting.case import Case, load_case
from hybrid.reporting.show import links, shown_in
from hybrid.words import plain

PICTURE = re.compile(r'<img alt="([^"]*)" src="data:image/png;base64,([^"]+)">')
UNIT = re.compile(r"\[[^\]]+\]|UTC")
pytestmark = pytest.mark.pages
SECTIONS: tuple[Callable[[Page, Case], None], ...] = (
    prediction.add_headline, trial.add_sheet, trial.add_data_quality, trial.add_tracks, trial.add_time_series,
    trial.add_indices, prediction.add_baselines, prediction.add_by_second, prediction.add_fans,
    prediction.add_distributions, ground.add_residual_maps, ground.add_coverage, ground.add_parameters,
)  # fmt: skip


def page_of(case: Case) -> Page:
    page = Page("A title", "a subtitle")
    for add in SECTIONS:
        add(page, case)
    return page


@pytest.fixture(scope="module")
def page(case: Case) -> Page:
    return page_of(case)


@pytest.fixture(scope="module")
def html(page: Page, tmp_path_factory: pytest.TempPathFactory) -> str:
    return page.write(tmp_path_factory.mktemp("report") / "deep" / "page.html").read_text(encoding="utf-8")


class _Loads(HTMLParser):
    """What a browser would fetch: every src, href, and style or script that points elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.found += [value or "" for name, value in attrs if name in ("src", "href", "data", "srcset")]


def test_the_page_loads_nothing(html: str) -> None:
    """No network, no files beside it, no scripts: every picture is in the page."""
    parser = _Loads()
    parser.feed(html)
    assert len(parser.found) >= 10
    assert all(each.startswith("data:image/png;base64,") for each in parser.found)
    assert not {"script", "link", "iframe"} & set(parser.tags)
    assert "http" not in re.sub(r"base64,[^\"]+", "", html)
    assert "@import" not in html
    assert "url(" not in html


def test_pictures_are_pictures_with_a_text_for_those_who_do_not_see_them(html: str) -> None:
    for text, data in PICTURE.findall(html):
        assert len(text) > 20
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG\r\n")


def test_every_axis_of_every_figure_has_a_unit(page: Page) -> None:
    """Numbers without units are worth nothing; categories and legends have none."""
    named = {"track", "time_series", "errors_by_second", "prediction_fans", "error_fans", "error_distributions",
             "region_calibration", "residual_maps", "training_range"}  # fmt: skip
    assert named <= set(page.figures)
    for name in named:
        for axes in page.figures[name].axes:
            if not axes.axison:
                continue
            for text in (axes.get_xlabel(), axes.get_ylabel()):
                assert not text or UNIT.search(text), f"{name}: {text!r}"
        labelled = [axes for axes in page.figures[name].axes if UNIT.search(axes.get_ylabel() + axes.get_xlabel())]
        assert labelled, name


def test_the_table_has_every_method_and_the_best_in_bold(html: str, case: Case) -> None:
    scores = case.validation.scores
    best = min(scores, key=lambda name: scores[name].mean_distance_m)
    assert f"<tr class=best><td>{plain(best)}</td>" in html
    for name, score in scores.items():
        assert f"<td>{plain(name)}</td><td>{score.mean_distance_m:.3f}</td>" in html


def test_the_headline_is_that_of_the_validation(html: str, case: Case) -> None:
    assert f"<b>{case.validation.scores['hybrid'].mean_distance_m:.2f} m</b>hybrid" in html
    assert f"<b>{case.validation.reduction:.0%}</b>" in html


def test_without_a_calibrator_the_report_says_so_and_stands(bare: Case) -> None:
    page = page_of(bare)
    text = "".join(page.parts)
    assert "No calibrator was given" in text
    assert "region_calibration" not in page.figures
    assert set(bare.validation.tracks) == {"constant_velocity", "reference"}
    assert "prediction_fans" in page.figures


def test_a_trial_without_a_held_window_has_a_report_that_says_why(
    simulated: Callable[..., Path], tmp_path: Path
) -> None:
    """Too short for a window: run sheet, quality and track stand, predictions say why there are none."""
    short = simulated("calm", 3, 12.0)
    show = shown_in(tmp_path / "figures")
    case = load_case([short])
    said = "".join(show(add, case).html for add in SECTIONS)
    assert "Nothing was predicted" in said
    assert "This could not be made" in said
    assert "SHA-256" in said
    assert (tmp_path / "figures" / "track.svg").is_file()


def test_a_calibrator_that_saw_the_trial_is_not_judged_on_it(earlier: list[Path], small_folder: Path) -> None:
    case = load_case(earlier[:1], small_folder)
    assert "took part in the training" in case.why_not
    assert load_case(earlier[:1], small_folder, allow_seen=True).why_not == ""


def test_several_recordings_are_told_apart(unseen: Path, earlier: list[Path], small_folder: Path) -> None:
    """Each has its own track and series, under its name; errors by trial have all."""
    case = load_case([unseen, earlier[0]], small_folder, allow_seen=True)
    page = Page()
    trial.add_tracks(page, case)
    prediction.add_distributions(page, case)
    assert {f"track_{name}" for name in case.products} <= set(page.figures)
    labels = [text.get_text() for text in page.figures["error_distributions"].axes[-1].get_xticklabels()]
    assert [text.split("\n")[0] for text in labels] == list(case.products)


def test_a_section_writes_its_figures_and_their_numbers(case: Case, tmp_path: Path) -> None:
    shown_in(tmp_path)(prediction.add_by_second, case)
    assert {path.name for path in tmp_path.iterdir()} == {f"errors_by_second.{e}" for e in ("svg", "pdf", "json")}


def test_links_are_markup_and_what_they_say_is_text() -> None:
    section = links({"<b>": "a b/c.html", "left out": None})
    assert section._repr_html_() == '<ul><li><a href="a%20b/c.html">&lt;b&gt;</a></li></ul>'


def test_a_page_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="is a file, not a folder"):
        Page("a", "b").write(tmp_path / "file" / "page.html")


def test_names_from_files_are_text(case: Case) -> None:
    page = Page()
    page.table(["", ""], [["crew's notes", "<b>calm</b> & clear"]])
    assert "&lt;b&gt;calm&lt;/b&gt; &amp; clear" in page.parts[-1]


def test_predicted_lines_are_lifted_between_windows(case: Case) -> None:
    motion = case.predicted(next(iter(case.products)))["hybrid"]
    starts = np.flatnonzero(np.diff(motion["window"].to_numpy()) != 0) + 1
    steps = np.diff(motion.index.asi8) / 1e9
    assert (steps[np.setdiff1d(np.arange(len(steps)), starts - 1)] == 1.0).all()
    assert (steps[starts - 1] >= 0.0).all()  # windows follow each other without an overlap
