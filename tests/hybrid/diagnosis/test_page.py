"""The page says what the diagnosis says, for every verdict, and shows it in figures that agree with its numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

from seatrial.analysis.manoeuvres.indices import Index
from seatrial.hybrid.diagnosis.calibrator_comparison import doubted_by_calibrator
from seatrial.hybrid.diagnosis.result import (
    CalibratorComparison,
    Diagnosis,
    Extras,
    Gap,
    RankedEffect,
    Ratio,
    Remainder,
    SensorContradiction,
    Suspect,
    When,
)
from seatrial.hybrid.effects.context import DeclaredContext, PossibleDeclaration
from seatrial.hybrid.report import plots
from seatrial.hybrid.report.diagnosis import (
    floor_remark,
    headline,
    model_line,
    next_steps,
    noise_rows,
    page_of,
    ranking_rows,
    share_words,
    summary,
    verdict_sentence,
    write_report,
)
from seatrial.hybrid.simulation.index_table import PredictedIndex
from tests.hybrid.diagnosis.made_up import BIAS, CURRENT, SUSPECTS, a_ladder, a_map, named, of_verdict, tracks

SENSORS = SensorContradiction(
    "heading_bias", (-1.5,), (0.1,), 1e-6, ("speed_sensor_rotation",), "Heading and track disagree."
)


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of a diagnosis with all there is to show."""
    extras = Extras(a_map(), a_map(), (SENSORS,), a_ladder())
    return write_report(named(), extras, tmp_path_factory.mktemp("page")).read_text(encoding="utf-8")


def test_the_page_needs_nothing_else(html: str) -> None:
    """No network, no script; pictures inside; names of files are text."""
    assert not re.search(r"https?://|<script|<link", html)
    assert html.count("data:image/png;base64,") == 10
    assert "trial &lt;7&gt;.mcap" in html


def test_the_page_says_what_was_named(html: str) -> None:
    """The verdict first and largest, then each effect's sentence, and what was granted."""
    assert "<h1>The model lacks ocean current, and the sensors show heading bias</h1>" in html
    for each in (CURRENT, BIAS):
        assert escape(each.sentence) in html
    for words in ("0.34 to 0.36", "60 % of the gap", "1.40 m", "0.19 m", "0.06 m", "90 %", "0.7 kN ahead",
                  "Heading and track disagree.", "71 outliers", "sway force [N]", "5,800",
                  "With a calibrator on top", "30 % less error",
                  "remain in the errors of every method"):  # fmt: skip
        assert words in html


def test_where_nothing_is_named_there_is_no_before_and_after(tmp_path: Path) -> None:
    """The model's error stands once, beside that of constant velocity, in words and in figures."""
    unchanged = replace(tracks(), after=tracks().before)
    nothing = replace(of_verdict("nothing_missing"), gap=Gap(1.4, 1.4, 1.4, 0.9, 110, 15), tracks=unchanged)
    assert list(headline(nothing)) == [
        "error over 15 s",
        "constant velocity",
        "of the force range: tolerated model error",
    ]
    assert "mean distance over 15 s: 1.400 m (110 held-out windows)" in str(nothing)
    page = write_report(nothing, Extras(a_map(), a_map()), tmp_path).read_text(encoding="utf-8")
    assert "The error on held-out legs" in page
    for words in ("before and after", "with the named effects in the model", "floor"):
        assert words not in page
    assert plots.representative_windows(unchanged, named=False) == {"worst": 5, "median": 3}
    axes = Figure().subplots()
    plots.draw_gap(axes, nothing)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["model", "constant velocity"]


def test_levels_of_noise_have_units_and_what_there_is_none_of_is_left_out() -> None:
    rows = dict(noise_rows(named()))
    assert rows["sensors, anew each second"].startswith("positions 0.031 m, heading 0.0573 deg, surge 0.02 m/s")
    assert rows["slow forces"] == "ahead 0.3 kN, across 0.3 kN, in yaw 3 kN m; time constant 20 s"
    assert rows["wave motion"].endswith("in yaw 0.573 deg; period 5.24 s, towards 303 deg")
    assert rows["slow drift of the waves"] == "2 kN in beam sea; time constant 20 s"
    assert len(rows) == 5


def test_tables_are_within_the_page(html: str) -> None:
    """No table has more columns than a laptop shows."""
    for row in re.findall(r"<tr.*?</tr>", html):
        assert row.count("<td>") <= 7


@pytest.mark.parametrize(
    ("verdict", "sentence", "words"),
    [
        (
            "nothing_missing",
            "Nothing is missing that this trial could reveal",
            ["the size that each effect could have"],
        ),
        (
            "unknown",
            "The model lacks ocean current, and something is missing that no effect of the catalogue explains",
            [
                "a yaw moment of some 4000 N m",
                "the heading and the place",
                "40 % of the gap",
                "the error from noise, gusts and waves alone",
            ],
        ),
        (
            "indistinguishable",
            "This trial cannot determine which is missing: ocean current or wave drift",
            ["reciprocal headings", "12 minutes", "cannot distinguish ocean current from wave drift"],
        ),
    ],
)
def test_every_verdict(verdict: str, sentence: str, words: list[str]) -> None:
    """Each has its sentence and what belongs to it."""
    diagnosis = of_verdict(verdict)
    page = page_of(diagnosis, Extras(consistency=()))
    text = re.sub(r"<img[^>]*>", "", page.html)
    assert page.title == sentence == verdict_sentence(diagnosis)
    for each in [*words, "They do, within their tolerances."]:
        assert each in text


def test_effects_that_bring_predictions_no_closer_are_named_with_that_said_everywhere() -> None:
    """No sentence of page, terminal or next steps says or implies that the model with them predicts better."""
    effect = replace(named().effects[0], share_of_gap=0.0)
    effect = replace(effect, sentence=f"Something is off (1 to 2 N); {share_words(0.0)}")
    stays = replace(named(), effects=(effect,), gap=Gap(0.19, 0.19, 0.12, 0.9, 110, 15), tracks=None)
    assert "come no closer" in verdict_sentence(stays)
    page = re.sub(r"<img[^>]*>", "", page_of(stays, Extras()).html)
    assert "improves predictions" not in page
    assert "Use the vessel file" not in page
    assert share_words(0.0) in page
    assert "evidence" in share_words(0.0)
    assert any("come no closer" in str(line) for line in summary(stays).renderables)
    assert "come no closer" not in verdict_sentence(named()) + page_of(named(), Extras()).html


@given(st.floats(0.01, 5.0), st.floats(0.01, 5.0), st.floats(0.01, 5.0))
def test_a_gap_closes_only_if_predictions_come_closer(before: float, after: float, noise: float) -> None:
    """Whatever noise leaves as the floor, also where that is above the error that the model had."""
    gap = Gap(before, after, min(noise, after), 0.9, 110, 15)
    assert (gap.closed > 0.0) == (after < before) or after == before


def test_a_cause_with_a_rival_is_never_the_verdict_without_it() -> None:
    """Beside a remainder, too; what is certain stays named."""
    tied = of_verdict("indistinguishable")
    remainder = Remainder(0.63, 0.0, ("operating_point",), "a sway force")
    sentence = verdict_sentence(replace(tied, remainder=remainder))
    assert sentence.startswith(
        "This trial cannot determine which is missing: ocean current or wave drift; forces of 63 %"
    )
    sentence = verdict_sentence(replace(tied, effects=(CURRENT, BIAS)))
    assert sentence.startswith(
        "The sensors show heading bias; this trial cannot determine which else is missing: ocean"
    )


def test_a_remainder_is_never_told_to_be_none_of_the_gap() -> None:
    """Where the noise that is estimated beside it leaves no room below the error that is left."""
    remainder = Remainder(0.63, 0.0, ("operation",), "a sway force of 63 % of its range")
    hidden = replace(of_verdict("indistinguishable"), remainder=remainder, gap=Gap(0.12, 0.09, 0.09, 0.22, 36, 15))
    page = page_of(hidden, Extras()).html
    assert "accounts for 0 % of the gap" not in page
    assert "the largest it can be" in page
    assert floor_remark(replace(hidden, gap=replace(hidden.gap, floor_m=0.03))) == floor_remark(named()) == ""


def test_a_model_whose_manoeuvres_become_worse_is_not_advised_for_them() -> None:
    worse = index_row(4.95, before=4.06, after=3.09)
    assert worse["worse"]
    (step,) = [step for step in next_steps(replace(named(), indices=(worse,))) if "vessel.toml" in step]
    assert "Do not predict manoeuvres" in step
    better = index_row(4.95, before=3.09, after=4.06)
    assert not any("Do not predict" in step for step in next_steps(replace(named(), indices=(better,))))


def index_row(measured_deg: float, before: float, after: float) -> dict[str, object]:
    """A row of the predicted indices: an overshoot as measured and as replayed by both models."""
    measured = Index(measured_deg, measured_deg - 0.5, measured_deg + 0.5, "deg")
    row = PredictedIndex(
        "zigzag 20/20", "port", "overshoot_1_from_order_deg", measured, None, None, None, before, after
    )
    return row.as_json()


def test_two_that_may_be_one() -> None:
    """Both are named, and the page says what cannot be known; no manoeuvre would tell."""
    two = of_verdict("indistinguishable")
    losses = tuple(replace(two.effects[0], name=f"thrust_loss_{side}") for side in ("port", "starboard"))
    group = tuple(each.name for each in losses)
    text = page_of(replace(
        two, effects=losses, rivals=(), indistinguishable=(group,), next_manoeuvre=None
    ), Extras()).html  # fmt: skip
    assert "cannot distinguish thrust loss port and thrust loss starboard from one effect of their family" in text
    assert "manoeuvre that would best distinguish" not in text


def test_unknown_alone() -> None:
    """Without any name the sentence begins with what is missing."""
    alone = replace(of_verdict("unknown"), effects=())
    assert verdict_sentence(alone).startswith("Something is missing")


def test_no_ladder_where_nobody_asked_and_one_line_where_it_cannot_be() -> None:
    """The section has no figure then."""
    assert "calibrator" not in page_of(of_verdict("nothing_missing"), Extras()).html
    lacking = Extras(comparison=CalibratorComparison(15, "adaptive", why_not="3 legs have held windows"))
    page, without = (page_of(of_verdict("nothing_missing"), each) for each in (lacking, Extras()))
    _, text = page.html.split("With a calibrator on top")
    assert "No calibrator was trained: 3 legs have held windows." in text.split("<h2>")[0]
    assert list(page.figures) == list(without.figures)


@pytest.mark.parametrize(("verdict", "ratio", "said"), [
    ("nothing_missing", (1 / 3, 0.3, 0.4), "unknown"),
    ("nothing_missing", (0.95, 0.92, 0.98), "nothing_missing"),
    ("nothing_missing", (0.8, 0.6, 1.1), "nothing_missing"),
    ("indistinguishable", (1 / 3, 0.3, 0.4), "indistinguishable"),
])  # fmt: skip
def test_nothing_is_missing_only_where_a_calibrator_finds_nothing_either(
    verdict: str, ratio: tuple[float, float, float], said: str
) -> None:
    ladder = replace(a_ladder(), ratios=(Ratio("reference_calibrated", "reference", *ratio),))
    doubted = doubted_by_calibrator(of_verdict(verdict), ladder)
    assert doubted.verdict == said
    assert (doubted.unknown is not None) == (said == "unknown")


def test_the_ladder_is_drawn_as_it_stands() -> None:
    """A point a rung at its mean distance, the first on top."""
    axes = Figure().subplots()
    rungs = a_ladder().mean_distance_m
    plots.draw_calibrator_comparison(axes, rungs)
    drawn = [each.lines[0].get_xydata()[0] for each in axes.containers]
    assert np.array(drawn) == pytest.approx(
        np.array([(each.value, row) for row, each in enumerate(rungs.values())])
    )


def test_errors_before_after_and_fitted_to_all_legs_stand_side_by_side() -> None:
    """One curve each: here what is fitted to all legs errs half as much as what is fitted to the others."""
    axes = Figure().subplots()
    plots.draw_mean_error_by_second(axes, tracks())
    lines = {str(each.get_label()): each for each in axes.lines}
    names = ("before", "after", "fitted to all legs")
    before, after, fitted = (np.asarray(lines[name].get_ydata()) for name in names)
    assert after == pytest.approx(0.1 * before)
    assert fitted == pytest.approx(0.5 * after)


def bars(figure: Figure) -> BarContainer:
    """The bars of a figure's first axes."""
    (found,) = [each for each in figure.axes[0].containers if isinstance(each, BarContainer)]
    return found


def test_the_gap_falls_from_before_to_after() -> None:
    """Each effect takes its share of what could be closed, one where the other ends."""
    figure = Figure()
    plots.draw_gap(figure.subplots(), named())
    before, current, bias, after, floor, still = list(bars(figure).patches)
    assert still.get_width() == pytest.approx(0.9)
    assert before.get_width() == pytest.approx(1.4)
    assert current.get_width() == pytest.approx(0.6 * (1.4 - 0.06))
    assert current.get_x() + current.get_width() == pytest.approx(1.4)
    assert bias.get_x() + bias.get_width() == pytest.approx(current.get_x())
    assert [each.get_width() for each in (after, floor)] == pytest.approx([0.19, 0.06])


def test_an_effect_of_two_parts_takes_its_share_off_once() -> None:
    """Both parts carry the share of the whole."""
    parts = tuple(replace(CURRENT, when=When(recording=name)) for name in ("monday.mcap", "thursday.mcap"))
    bars = []
    for effects in ((CURRENT, BIAS), (*parts, BIAS)):
        axes = Figure().subplots()
        plots.draw_gap(axes, replace(named(), effects=effects))
        bars.append([patch.get_width() for patch in axes.patches])
    assert bars[0] == bars[1]


def test_the_ranking_marks_what_was_named() -> None:
    """A bar a suspect, as long as its evidence, a colour a family."""
    figure = Figure()
    plots.draw_evidence_ranking(figure.subplots(), SUSPECTS, ["ocean_current"])
    drawn = list(bars(figure).patches)
    assert [each.get_width() for each in drawn] == [each.evidence for each in SUSPECTS]
    named_edge, other_edge = (np.asarray(each.get_edgecolor())[-1] for each in drawn[:2])
    assert (named_edge, other_edge) == (1.0, 0.0)
    assert drawn[0].get_facecolor() == drawn[1].get_facecolor() != drawn[2].get_facecolor()


def test_rivals_that_cannot_be_told_apart_stand_out() -> None:
    """Nearer than the line in one colour, the others in another."""
    figure = Figure()
    plots.draw_rivals(figure.subplots(), of_verdict("indistinguishable").rivals)
    near, far = list(bars(figure).patches)
    assert near.get_facecolor() != far.get_facecolor()


def test_the_page_says_what_to_do_next() -> None:
    """Sensors by name, the vessel file, the manoeuvre; a model in which nothing is missing is used."""
    steps = next_steps(named())
    assert "heading bias" in steps[0]
    assert any("vessel.toml" in each for each in steps)
    assert any("manoeuvre" in each for each in next_steps(of_verdict("indistinguishable")))
    assert [each.partition(";")[0] for each in next_steps(of_verdict("nothing_missing"))] == [
        "Use the model as it is"
    ]


def test_an_effect_that_a_trial_cannot_find_has_no_size_there() -> None:
    sizes = {"10.0": "10 N", "inf": "not by this trial", "nan": ""}
    suspects = [RankedEffect("wave_drift", "environment", 1.0, 0.5, float(limit), "N") for limit in sizes]
    assert [row[-1] for row in ranking_rows(suspects)] == list(sizes.values())


def test_what_is_of_one_day_does_not_go_with_the_ship() -> None:
    effect = replace(named().effects[0], name="ocean_current", kind="environment", scope="day")
    (step,) = [each for each in next_steps(replace(named(), effects=(effect,))) if "vessel.toml" in each]
    assert step.endswith("delete what is not the ship's own: [effects.ocean_current].")
    lasting = replace(effect, name="hull_fouling", kind="physics", scope="ship")
    assert not any("delete" in each for each in next_steps(replace(named(), effects=(lasting,))))


def test_contradicting_sensors_come_first_and_the_unknown_has_a_next_step() -> None:
    late = SensorContradiction("position_delay", (-1.1,), (0.1,), 1e-9, (), "They disagree.")
    unknown = of_verdict("unknown")
    assert "position delay" in next_steps(unknown, [late])[0]
    assert any("map" in each for each in next_steps(unknown))
    assert next_steps(named(), [late]) == next_steps(named())  # their errors are named already


def test_the_forces_of_a_model_ship_are_in_newtons() -> None:
    """In kN every one of them would read 0."""
    places = [replace(each, error=each.error * 1e-4) for each in a_map().places]
    assert all("kN" in each for each in plots.map_sentences(a_map().places))
    (sentence,) = {each for each in plots.map_sentences(places) if "sway" in each}
    assert " N (95 % interval" in sentence
    assert " 0 N" not in sentence


def test_error_by_second_is_the_mean_distance() -> None:
    """After is a tenth of before in the made-up tracks."""
    axes = Figure().subplots()
    plots.draw_mean_error_by_second(axes, tracks())
    before, after = (np.asarray(each.get_ydata()) for each in axes.lines[:2])
    assert len(before) == 15
    assert after == pytest.approx(0.1 * before)
    assert before[-1] == pytest.approx(0.02 * 15 * np.mean(np.arange(1, 7)))


def test_chosen_windows_are_what_they_are_called() -> None:
    """In the made-up tracks the last window is the worst, before and after, and is drawn once."""
    chosen = plots.representative_windows(tracks())
    assert chosen == {"worst before, improved most, worst after": 5, "median before": 3}


def test_windows_stand_over_what_the_actuators_did() -> None:
    """A row of axes for each unit below the tracks, on one scale; the last window's rudder to 3.4 deg."""
    figure, made = Figure(), tracks()
    plots.draw_window_tracks(figure, made)
    below = figure.axes[2:]
    assert [axes.get_ylabel() for axes in below] == ["shafts\n[rpm]", "", "angles\n[deg]", ""]
    worst = list(plots.representative_windows(made).values()).index(5)
    (line,) = below[2 + worst].get_lines()
    assert np.asarray(line.get_ydata()) == pytest.approx(-np.degrees(0.06))
    assert line.get_label() == "rudder angle"


def test_windows_with_gaps_are_left_out_of_the_figures() -> None:
    """A window with a second that nobody measured or could predict."""
    made = tracks()
    made.measured[1, 4, 0] = np.nan
    made.before[3, 15, 1] = np.nan
    assert plots.complete_windows(made).leg.tolist() == [0, 1, 2, 2]


def test_the_map_finds_what_the_force_goes_with() -> None:
    """Of the made-up map, sway with heading; every cell is printed."""
    made = a_map()
    assert plots.clearest_force_and_quantity(made) == ("sway_force_n", "heading_deg")
    figure = Figure(figsize=(9.5, plots.map_height_inch(made.places)))
    plots.draw_force_map(figure, made.places)
    printed = [each.get_text() for axes in figure.axes for each in axes.texts]
    assert printed.count("5") == 1
    assert printed.count("\u22125") == 1
    assert len(printed) == 2 + 3 * 11


def test_json_has_the_contracts_keys() -> None:
    """What the page shows beside the contract stays out of the JSON."""
    plain = named().as_dict()
    assert {
        "verdict",
        "effects",
        "rivals",
        "indistinguishable",
        "unknown",
        "where",
        "gap",
        "next_manoeuvre",
    } <= set(plain)
    assert isinstance(named(), Diagnosis)
    assert "tracks" not in plain


def test_the_page_says_first_that_the_model_is_another_ship() -> None:
    """As a note above all else, and once; nothing where it is hers."""
    said = "model: gunnerus_short, not the ship that the recording names (gunnerus_long)"
    assert model_line(named()) == "model: gunnerus_short"
    other = replace(named(), remarks=(said, *named().remarks))
    assert model_line(other) == said
    text = page_of(other, Extras()).html
    assert text.lower().count(said) == 1
    assert text.index(said) < text.index("Effects named")


def test_a_diagnosis_prints_as_a_short_table() -> None:
    assert str(named()).splitlines() == [
        "named, 1 % of the force range tolerated",
        "ocean_current  speed_mps      0.35  0.34 to 0.36  m/s",
        "ocean_current  direction_deg  205   203 to 207    deg",
        "heading_bias   angle_deg      -1.5  -1.7 to -1.3  deg",
        "mean distance over 15 s: 1.400 m before, 0.190 m after, 0.060 m at best (110 held-out windows)",
    ]
    assert str(of_verdict("nothing_missing")).startswith("nothing missing, 1 % of the force range tolerated\nmean")
    assert "unknown: a yaw moment of some 4000 N m" in str(of_verdict("unknown"))


@pytest.mark.parametrize(("verdict", "parts"), [("named", 3 + 1), ("nothing_missing", 1)])
def test_the_overview_shows_parameters_and_gap(verdict: str, parts: int) -> None:
    diagnosis = named() if verdict == "named" else of_verdict(verdict)
    assert len(plots.make_overview_figure(diagnosis).axes) == parts


def test_what_was_declared_comes_first_and_suspects_are_told_from_names() -> None:
    """And what might be declared is proposed, with the option."""
    context = DeclaredContext(
        ("still water",), {"loading": {"mass_factor": 1.1}}, ("ocean_current", "wave_drift", "loading"),
        (PossibleDeclaration("heading surveyed", ("heading_bias",)),),
    )  # fmt: skip
    suspects = (Suspect("yaw_damping", ("the whole", "the first and third quarter")),)
    diagnosis = replace(named(), context=context, suspects=suspects)
    text = page_of(diagnosis, Extras()).html
    declared = "Declared beforehand: still water and known loading: mass factor 1.1. Left out for that reason: "
    assert text.index(declared) < text.index("Effects named") < text.index("Found, but not named")
    assert "<td>yaw damping</td><td>the whole; the first and third quarter</td>" in text
    assert any("--surveyed heading" in step and "heading bias" in step for step in next_steps(diagnosis))
    lines = [str(line) for line in summary(diagnosis).renderables]
    assert lines[0].startswith(declared)
    assert "Found, but not named: yaw damping." in lines
    plain_page = page_of(named(), Extras()).html
    assert "Declared beforehand" not in plain_page
    assert "Found, but not named" not in plain_page
