"""The sections of a trial's report: what they say is what was computed, with a calibrator and without, offline."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from matplotlib.figure import Figure

import seatrial as st
from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.report.pages import Page, render
from seatrial.analysis.tables.table import table_of
from seatrial.hybrid.report.folder import BLOCKS
from seatrial.hybrid.report.text import FAILED, plain, sections, templates
from seatrial.hybrid.report.trial import TrialCase, load_case, model_sentence, verdict_sentence
from seatrial.hybrid.report.trial_plots import draw_error_distributions
from tests.analysis.speed_power.trials import Day, sail

PICTURE = re.compile(r'<img alt="([^"]*)" src="data:image/png;base64,([^"]+)">')
UNIT = re.compile(r"\[[^\]]+\]|UTC")
pytestmark = pytest.mark.pages
CONTEXT = {"remark": "", "folder": None, "links": {}}


def page_of(case: TrialCase) -> Page:
    """All sections of a trial's report as one page."""
    shown = [render("trial.html", each, templates(), level=3, case=case, **CONTEXT) for each in BLOCKS]
    body = Markup("").join(Markup(each.html) for each in shown)
    whole = render("base.html", title="A title", subtitle="a subtitle", body=body)
    return Page(whole.html, {name: figure for each in shown for name, figure in each.figures.items()})


def said_of(case: TrialCase, folder: Path) -> str:
    """What all sections show in a notebook."""
    show = sections("trial.html", folder, case=case, **CONTEXT)
    return "".join(show(each).html for each in BLOCKS)


@pytest.fixture(scope="module")
def page(case: TrialCase) -> Page:
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
    assert len(parser.found) >= 8
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
    named = {"track", "channels", "errors_by_second", "prediction_fans", "error_distributions",
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


def test_the_table_has_every_method_and_the_best_in_bold(html: str, case: TrialCase) -> None:
    scores = case.validation.scores
    best = min(scores, key=lambda name: scores[name].mean_distance_m)
    assert f"<tr class=best><td>{plain(best)}</td>" in html
    for name, score in scores.items():
        assert f"<td>{plain(name)}</td><td>causal</td><td>{score.mean_distance_m:.3f}</td>" in html


def test_the_headline_is_that_of_the_validation(html: str, case: TrialCase) -> None:
    assert f"<b>{case.validation.scores['hybrid'].mean_distance_m:.2f} m</b>hybrid" in html
    assert f"<b>{case.validation.reduction:.0%}</b>" in html


def test_without_a_calibrator_the_report_says_so_and_stands(bare: TrialCase) -> None:
    page = page_of(bare)
    assert "region_calibration" not in page.figures
    assert set(bare.validation.tracks) == {"straight_line", "constant_velocity", "reference"}
    assert "prediction_fans" in page.figures


def test_a_trial_without_a_held_window_has_a_report_that_says_why(
    simulated: Callable[..., Path], tmp_path: Path
) -> None:
    """Too short for a window: run sheet, quality and track stand, predictions say why there are none."""
    short = simulated("calm", 3, 12.0)
    case = load_case([short])
    said = said_of(case, tmp_path / "figures")
    assert "No predictions by a simulation model" in said
    assert "could not be made" not in said
    assert "SHA-256" in said
    assert (tmp_path / "figures" / "track.svg").is_file()


def test_a_calibrator_that_saw_the_trial_is_not_judged_on_it(earlier: list[Path], small_folder: Path) -> None:
    case = load_case(earlier[:1], small_folder)
    assert "took part in the training" in case.obstacle
    assert load_case(earlier[:1], small_folder, allow_seen=True).obstacle == ""


def test_several_recordings_are_told_apart(
    unseen: Path, earlier: list[Path], small_folder: Path, simulated: Callable[..., Path], tmp_path: Path
) -> None:
    """Each has its figures under its name, of its tests or of its track and series; errors by trial have all.

    One that is too short for a window and one that cannot be read keep none of the others from being shown, and are
    named.
    """
    damaged, short = tmp_path / "damaged.mcap", simulated("calm", 3, 12.0)
    damaged.write_bytes(unseen.read_bytes()[:200])
    case = load_case([damaged, unseen, short, earlier[0]], small_folder, allow_seen=True)
    said = said_of(case, tmp_path / "figures")
    assert FAILED not in said
    assert "could not be made" not in said
    assert list(case.products) == [unseen.stem, short.stem, earlier[0].stem]
    assert "Left out: damaged" in said
    figures = {path.stem for path in (tmp_path / "figures").glob("*.svg")}
    drawn = {name: {figure for figure in figures if figure.endswith(name)} for name in case.products}
    assert all(drawn.values())
    assert {f"track_{short.stem}", f"channels_{short.stem}"} <= drawn[short.stem]
    figure = Figure()
    draw_error_distributions(figure, case)
    groups = {label.get_text().partition("\n")[0] for label in figure.axes[-1].get_xticklabels()}
    assert groups == {unseen.stem, earlier[0].stem}


@pytest.mark.parametrize("lacking", [["sway_mps"], ["north_m", "east_m"], ["wind_speed_mps"], ["heading_deg"]])
def test_a_recording_that_lacks_channels_has_a_report_that_says_so(
    lacking: list[str], unseen: Path, tmp_path: Path
) -> None:
    table = table_of(read_recording(unseen)).drop(columns=lacking)
    path = tmp_path / "lacking.mcap"
    write_table(table, path, Trial(name="lacking"), source="test")
    case = load_case([path])
    said = said_of(case, tmp_path / "figures")
    assert FAILED not in said, re.findall(f"{FAILED}[^<]*", said)
    assert "No predictions by a simulation model" in said
    assert "no vessel file for the ship that the recording names" in said
    assert "The recording does not say which ship this is." in said


def test_values_that_are_flagged_bad_do_not_count_unless_one_says_so(unseen: Path, tmp_path: Path) -> None:
    """Spikes of 300 m: put right before predictions are judged; with a warning where nothing is put right, and the
    windows across them are left out and counted."""
    table = table_of(read_recording(unseen))
    rows = table.index[[300, 500, 700]]
    path = tmp_path / "spiky.mcap"
    write_table(table.assign(north_m=table["north_m"].where(~table.index.isin(rows), table["north_m"] + 300.0)),
                path, Trial(name="spiky", vessel="gunnerus_long"), source="test")  # fmt: skip
    clean, mended, kept = (
        load_case([each], repair=repair) for each, repair in ((unseen, True), (path, True), (path, False))
    )
    errors = [each.validation.scores["reference"].mean_distance_m for each in (clean, mended, kept)]
    assert errors[1] == pytest.approx(errors[0], rel=0.1)
    assert [each.validation.jumps for each in (clean, mended)] == [0, 0]
    assert kept.validation.jumps > 0
    assert errors[2] == pytest.approx(errors[0], rel=0.2)
    assert "Nothing was repaired, as requested" in sections("trial.html", case=kept)("data").html
    assert "stray values became gaps" in sections("trial.html", case=mended)("data").html


def test_limits_are_by_the_length_between_perpendiculars_of_the_ship_that_sailed(
    simulated: Callable[..., Path],
) -> None:
    """The lengthened ship: 33.9 m, not her 36.25 m over all, nor the 28.9 m of the model."""
    path = simulated("gentle", 100, 1200.0)
    case = load_case([path])
    ship = case.ship(path.stem)
    assert ship is not None
    assert (ship.over_all_m, ship.between_perpendiculars_m) == pytest.approx((36.25, 33.9))
    limits = [
        index.limit / index.limit_lengths
        for each in case.products[path.stem].manoeuvres for index in each.indices.values()
        if index.limit is not None and index.limit_lengths is not None
    ]  # fmt: skip
    assert limits == pytest.approx([33.9] * len(limits))


def test_what_was_seen_is_said(earlier: list[Path], unseen: Path, small_folder: Path) -> None:
    said = [
        "".join(sections("trial.html", case=case)("model").html.split("<figure>")[:1])
        for case in (load_case([unseen], small_folder), load_case(earlier[:1], small_folder, allow_seen=True))
    ]
    assert "No method was trained on these" in said[0]
    assert "was trained on some of these data" in said[1]


def test_a_section_writes_its_figures_and_their_numbers(case: TrialCase, tmp_path: Path) -> None:
    sections("trial.html", tmp_path, case=case)("model")
    names = ("errors_by_second", "prediction_fans")
    assert {path.name for path in tmp_path.iterdir()} == {f"{n}.{e}" for n in names for e in ("svg", "json")}


def test_a_page_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="is a file, not a folder"):
        Page("a").write(tmp_path / "file" / "page.html")


def test_what_a_recording_says_of_itself_is_text(unseen: Path, tmp_path: Path) -> None:
    """Names, notes and the file's own name are no markup, wherever they come."""
    evil = "<script>alert(1)</script>\"'&"
    path = tmp_path / "t<b>x'&.mcap"
    write_table(table_of(read_recording(unseen)), path, Trial(name=evil, vessel=evil, crew_notes=evil), source=evil)
    said = said_of(load_case([path]), tmp_path / "figures")
    assert "<script" not in said
    assert "&lt;script&gt;" in said
    assert "t<b>x" not in said


def test_a_speed_trial_has_a_section_of_speed_and_power_and_others_have_none(
    bare: TrialCase, tmp_path: Path
) -> None:
    table, path = sail(Day(), rpm={60.0: 1, 90.0: 1}), tmp_path / "speed.mcap"
    channels = [st.declare("shaft_power_kw", "kW", 0, 50_000), st.declare("main_rpm", "rpm", 0, 200)]
    st.write(table, path, declared=channels)
    case = load_case([path], length_m=180.0)
    said = sections("trial.html", tmp_path / "figures", case=case)("speed_power").html
    assert "Speed and power" in said
    assert "In still water the ship makes" in said
    assert "unknown length" not in said
    assert (tmp_path / "figures" / "speed_power.svg").is_file()
    assert "In still water the ship makes" in verdict_sentence(case)
    assert sections("trial.html", case=bare)("speed_power").html.strip() == ""


def test_a_vessel_asked_for_is_the_ship_of_a_recording_that_names_none(unseen: Path, tmp_path: Path) -> None:
    path, table = tmp_path / "unnamed.mcap", table_of(read_recording(unseen))
    write_table(table, path, Trial(name="trial"), source="test")
    case = load_case([path], vessel="gunnerus_short")
    ship = case.ship(next(iter(case.products)))
    assert ship is not None
    assert ship.name == "gunnerus_short"
    assert "which is not of this ship" not in model_sentence(case)
    write_table(table, path, Trial(name="trial", vessel="Another"), source="test")
    other = load_case([path], vessel="gunnerus_short")
    assert other.ship(next(iter(other.products))) is None  # the model asked for is of another ship
    assert "which is not of this ship" in model_sentence(other)


def test_predicted_lines_are_lifted_between_windows(case: TrialCase) -> None:
    motion = case.predicted(next(iter(case.products)))["hybrid"]
    starts = np.flatnonzero(np.diff(motion["window"].to_numpy()) != 0) + 1
    steps = np.diff(motion.index.asi8) / 1e9
    assert (steps[np.setdiff1d(np.arange(len(steps)), starts - 1)] == 1.0).all()
    assert (steps[starts - 1] >= 0.0).all()  # windows follow each other without an overlap
