"""Programmes of trials: templates, files, errors, headings and order."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import pytest

from seatrial.acquisition.core.errors import ConfigurationError, StorageError
from seatrial.analysis.conduct.programme import (
    TEMPLATES,
    TrialProgramme,
    heading_with_room,
    load_programme,
    middle_of_area,
    programme_from_template,
    programme_text,
    propose_order,
    room_ahead_m,
    way_ahead_m,
)
from seatrial.analysis.manoeuvres import criteria

THRUSTERS = ("bow", "stern")
SQUARE = ((0.0, 0.0), (0.0, 0.1), (0.1, 0.1), (0.1, 0.0))
"""Some 11 km by 11 km at the equator."""


def programme(
    template: str = "imo", length_m: float = 200.0, speed_mps: float = 7.7, **more: object
) -> TrialProgramme:
    return programme_from_template(template, length_m, speed_mps, "ship", THRUSTERS, **more)


@pytest.mark.parametrize("template", TEMPLATES)
def test_template_is_read_back_as_it_was_written(template: str, tmp_path: Path) -> None:
    written = programme(template, wind_from_deg=250.0, area=SQUARE, minutes=240.0)
    assert load_programme(written.save(tmp_path / "programme.toml")) == written


@pytest.mark.parametrize("name", ["Prøvetur «dag 1» / 水", "a\"quote' \\\\ back", "../../etc", "[bold]x[/bold]"])
def test_programme_may_have_any_name_that_is_shown(name: str, tmp_path: Path) -> None:
    written = replace(programme(), programme=replace(programme().programme, name=name))
    assert load_programme(written.save(tmp_path / "programme.toml")).programme.name == name
    assert f"{name}: 7 runs" in " ".join(str(written).split())


def test_edited_programme_is_not_replaced(tmp_path: Path) -> None:
    """The same one may be written again; a space more is an edit."""
    path, written = tmp_path / "programme.toml", programme(least_depth_m=48.0)
    text = written.save(path).read_text()
    assert "least_depth_m = 48    # four draughts" in text
    assert written.save(path).read_text() == text
    for edited in (text + " ", text.replace("priority = 1", "priority = 2", 1), ""):
        path.write_text(edited)
        with pytest.raises(StorageError, match=r"programme\.toml: already exists.*edited.*choose another file"):
            written.save(path)
        assert path.read_text() == edited


def test_imo_template_asks_for_every_criterion_to_both_sides() -> None:
    purposes = {(purpose, run.side) for run in programme().run for purpose in run.purpose}
    assert purposes == {(criterion.name, side) for criterion in criteria.CRITERIA for side in criterion.sides}


def test_speed_trials_have_the_double_runs_that_their_analysis_asks_for() -> None:
    runs = [run for run in programme("imo_speed_trials").run if run.kind == "speed_run"]
    assert len({run.speed_mps for run in runs}) == 3
    assert sum(run.repeats // 2 for run in runs) == 4
    assert all(run.repeats % 2 == 0 and run.duration_s == 600.0 for run in runs)


def test_times_of_a_ship_and_of_its_model_at_one_froude_number_are_as_the_roots_of_their_lengths() -> None:
    ship, model = programme(length_m=200.0, speed_mps=8.0), programme(length_m=50.0, speed_mps=4.0)
    for large, small in zip(ship.run, model.run, strict=True):
        assert ship.minutes_of(large) == pytest.approx(2.0 * model.minutes_of(small))


@pytest.mark.parametrize(
    ("line", "instead", "words"),
    [
        ('kind = "zigzag"', 'kind = "slalom"', "slalom"),
        ("switch_deg = 10", "", "a zigzag needs switch_deg"),
        ('side = "starboard"', "", "a zigzag needs a side"),
        ("helm_deg = 10", "helm_deg = -10", "helm_deg"),
        ("length_m = 200", "length = 200", "length_m"),
        ('name = "imo"', 'name = "imo\\u001b[2J"', "characters that are not shown"),
        ('name = "imo"', f'name = "{"x" * 101}"', "at most 100 characters"),
        ('kind = "zigzag"', 'kind = "zigzag"\nthruster = "bow: valid"', "thruster: 'bow: valid'"),
        (
            "priority = 1",
            "priority = 1\nheading_deg = 400",
            "run 1 (zigzag, starboard): heading_deg: 400: it can be 0 to 360",
        ),
        ("priority = 1", "priority = 1\nheld_s = 0", "held_s: 0: it can be 5 to 86400 s"),
        ("speed_mps = 7.7", "speed_mps = 46.3", "a speed in knots times 0.5144"),
        ("length_m = 200", "length_m = 20000", "it can be 0.5 to 600 m"),
        ("length_m = 200", "length_m = 200\nsteady_s = 1e-9", "programme.steady_s"),
        ("length_m = 200", "length_m = 200\nleast_depth_m = -40", "it can be 0.1 to 11000 m"),
        ("length_m = 200", "length_m = 200\nminutes = 1e9", "at most two weeks"),
        ("length_m = 200", "length_m = nan", "nan: it can be"),
        (
            "length_m = 200",
            "length_m = 200\narea = [[1, 2], [1, 2.00001], [1.00001, 2]]",
            "programme.area: it is 2 m across",
        ),
        ("length_m = 200", "length_m = 200\narea = [[60, 2], [61, 2], [-60, 100]]", "km across, more than 500 km"),
        (
            "length_m = 200",
            "length_m = 200\narea = [[110, 2], [110, 3], [111, 3]]",
            "corner 1, 110 and 2, is not on the earth",
        ),
        ("length_m = 200", "length_m = 200\narea = [[60, 2], [61, 3], [60, 3], [61, 2]]", "its sides cross"),
    ],
)
def test_error_names_the_file_and_what_is_wrong(line: str, instead: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "programme.toml"
    path.write_text(programme_text(programme()).replace(line, instead, 1))
    with pytest.raises(ConfigurationError, match=r"programme\.toml") as error:
        load_programme(path)
    assert words in str(error.value)


def test_area_may_be_closed_and_lie_across_the_date_line() -> None:
    square = ((0.0, 179.9), (0.0, -179.9), (0.2, -179.9), (0.2, 179.9), (0.0, 179.9))
    assert [abs(degrees) for degrees in middle_of_area(square[:4])] == pytest.approx([0.1, 180.0])
    across = programme(area=square, wind_from_deg=45.0)
    assert {run.heading_deg for run in across.run} == {45.0}
    assert room_ahead_m(square, (0.1, 180.0), 90.0) == pytest.approx(11_130.0, rel=0.01)


def test_unknown_template_and_ship_without_thrusters_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="use one of imo"):
        programme("acceptance")
    with pytest.raises(ConfigurationError, match="no thruster"):
        programme_from_template("dp_acceptance", 80.0, 6.0)


def test_headings_go_into_the_wind_and_without_one_into_the_current() -> None:
    assert {run.heading_deg for run in programme(wind_from_deg=250.0, current_to_deg=10.0).run} == {250.0}
    assert {run.heading_deg for run in programme(current_to_deg=10.0).run} == {190.0}
    assert {run.heading_deg for run in programme().run} == {None}


def test_heading_is_the_nearest_one_with_room() -> None:
    """In a strip of water 2 km wide and 30 km long to the north, into a wind from the east."""
    strip = ((0.0, 0.0), (0.0, 0.018), (0.27, 0.018), (0.27, 0.0))
    narrow = programme(area=strip)
    for run in narrow.run:
        heading = heading_with_room(narrow, run, (0.135, 0.009), 90.0)
        assert heading is not None
        assert room_ahead_m(strip, (0.135, 0.009), heading) >= way_ahead_m(narrow, run)
        between = (position for position in range(90, round(heading), -10 if heading < 90.0 else 10))
        assert all(
            room_ahead_m(strip, (0.135, 0.009), float(other)) < way_ahead_m(narrow, run) for other in between
        )
    assert room_ahead_m(SQUARE, (0.2, 0.05), 180.0) == 0.0  # outside
    assert heading_with_room(narrow, narrow.run[0], (1.0, 1.0), 0.0) is None


def test_order_keeps_priorities_and_takes_the_least_time_between() -> None:
    ship = programme(wind_from_deg=0.0)
    headings = (0.0, 180.0, 10.0, 190.0, 20.0, 200.0, 0.0)
    runs = [replace(run, heading_deg=heading) for run, heading in zip(ship.run, headings, strict=True)]
    ordered = propose_order(ship, runs)
    assert [run.priority for run in ordered] == sorted(run.priority for run in runs)
    first = [run for run in ordered if run.priority == 1]
    least = min(replace(ship, run=order).total_minutes for order in permutations(first))
    assert replace(ship, run=tuple(first)).total_minutes == pytest.approx(least)


def test_programme_prints_and_plots_itself() -> None:
    ship = programme(wind_from_deg=250.0)
    assert "turning circle 35 deg to port" in str(ship)
    assert list(ship.to_frame()["kind"]) == [run.kind for run in ship.run]
    assert "<pre" in ship._repr_html_()
