"""The report: one page that needs nothing else, with pictures whose axes say what they show."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from hybrid.report import add_validation, headline_of
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from acquisition.errors import StorageError
from analysis.page import Page
from analysis.recordings import tables_of_recordings, windows_of_tables
from analysis.run_sheet import add_run_sheet
from analysis.trial_figures import add_channels, add_track
from analysis.windows import HeldWindows
from hybrid import plots
from hybrid.artefact import Trained
from hybrid.gather import gather
from hybrid.scores import distances
from hybrid.validate import Validation, validate
from hybrid.vessel.plant import Plant
from tests.conftest import SMALL_HORIZON_S

PICTURE = re.compile(r'<img alt="([^"]*)" src="data:image/png;base64,([^"]+)">')
UNIT = re.compile(r"\[[^\]]+\]|UTC")


@pytest.fixture(scope="module")
def judged(small: Trained, unseen: Path, plant: Plant) -> Validation:
    return validate(gather([unseen], SMALL_HORIZON_S, 5), plant, small)


@pytest.fixture(scope="module")
def voyage(unseen: Path) -> tuple[pd.DataFrame, HeldWindows]:
    tables = tables_of_recordings([unseen])
    return next(iter(tables.values())), windows_of_tables(tables, SMALL_HORIZON_S, 5)


@pytest.fixture(scope="module")
def html(
    judged: Validation, voyage: tuple[pd.DataFrame, HeldWindows], tmp_path_factory: pytest.TempPathFactory
) -> str:
    """A whole page."""
    page = Page("A title", "a subtitle")
    page.headline(headline_of(judged))
    add_validation(page, judged)
    add_track(page, voyage[0], voyage[1].rows)
    add_channels(page, voyage[0], voyage[1].rows)
    add_run_sheet(page, [("crew's notes", "<b>calm</b> & clear"), ("ship", "gunnerus_long")])
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
    assert parser.found
    assert all(each.startswith("data:image/png;base64,") for each in parser.found)
    assert not {"script", "link", "iframe"} & set(parser.tags)
    assert "http" not in re.sub(r"base64,[^\"]+", "", html)
    assert "@import" not in html
    assert "url(" not in html


def test_pictures_are_pictures_with_a_text_for_those_who_do_not_see_them(html: str) -> None:
    pictures = PICTURE.findall(html)
    assert len(pictures) == 4
    for text, data in pictures:
        assert len(text) > 20
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG\r\n")


def test_text_from_files_is_text(html: str) -> None:
    """Crew notes are no markup."""
    assert "&lt;b&gt;calm&lt;/b&gt; &amp; clear" in html
    assert "<b>calm" not in html


def test_the_table_has_every_method_and_the_best_in_bold(html: str, judged: Validation) -> None:
    best = min(judged.scores, key=lambda name: judged.scores[name].mean_distance_m)
    (bold,) = re.findall(r"<tr class=best><td>([^<]+)</td>", html)
    assert bold == plots.title_of(best)
    for name, score in judged.scores.items():
        assert f"<td>{plots.title_of(name)}</td><td>{score.mean_distance_m:.2f}</td>" in html


def test_headlines_are_the_numbers_of_the_table(judged: Validation) -> None:
    figures = headline_of(judged)
    assert figures["hybrid, mean distance"] == f"{judged.scores['hybrid'].mean_distance_m:.2f} m"
    assert f"{judged.reduction:.0%}" in figures.values()


def test_a_page_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="is a file, not a folder"):
        Page("a", "b").write(tmp_path / "file" / "page.html")


def test_drawing_leaves_the_users_settings_alone() -> None:
    before = dict(mpl.rcParams)
    page = Page("a", "b")
    page.figure(lambda figure: figure.subplots().plot([0, 1]), (3, 2), "a line")  # type: ignore[arg-type]
    assert dict(mpl.rcParams) == before


def test_the_error_over_time_shows_every_method_and_the_band(judged: Validation) -> None:
    """One line a method with its values, one for the band; axes with units."""
    axes = Figure().subplots()
    artists = plots.error_by_second(axes, judged)
    assert all(isinstance(each, Artist) for each in artists)
    assert len(artists) == len(judged.scores) + 1
    for artist, score in zip(artists, judged.scores.values(), strict=False):
        assert tuple(artist.get_ydata()) == score.by_second  # type: ignore[attr-defined]
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()][:2] == ["constant velocity", "reference"]


def test_a_fan_has_the_bow_up(judged: Validation) -> None:
    """Every track begins at (0, 0), the ship's first metres go up, and lengths are kept."""
    axes = Figure().subplots()
    window = int(np.argmax(judged.horizons.start[:, 3]))
    measured, *predicted, circle = plots.fan(axes, judged, window)
    assert len(predicted) == len(judged.tracks)
    for artist in predicted:
        x, y = artist.get_data()  # type: ignore[attr-defined]
        assert (x[0], y[0]) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert y[1] > abs(x[1])
    x, y = predicted[1].get_data()  # type: ignore[attr-defined]
    x_measured, y_measured = measured.get_data()  # type: ignore[attr-defined]
    gap = distances(judged.tracks["reference"][[window]], judged.horizons.track[[window]])[0]
    assert np.hypot(x - x_measured, y - y_measured)[1:] == pytest.approx(gap)
    assert judged.band_m is not None
    assert circle.get_radius() == judged.band_m[-1]  # type: ignore[attr-defined]
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())


def test_without_a_calibrator_the_pictures_have_no_band(unseen: Path, plant: Plant) -> None:
    bare = validate(gather([unseen], 15, 5), plant)
    figure = Figure()
    assert len(plots.error_by_second(figure.subplots(), bare)) == 2
    assert set(headline_of(bare)) == {"reference, mean distance"}
    page = Page("a", "b")
    add_validation(page, bare)
    assert len(PICTURE.findall("".join(page.parts))) == 2
