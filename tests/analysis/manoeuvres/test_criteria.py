"""Means over like runs, and when a value passes, fails or is not judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.analysis.manoeuvres.criteria import (
    IndexRow,
    add_limits,
    criterion_results,
    headline_of_criteria,
    index_rows,
    mean_over_runs,
    shortfalls_of_criteria,
)
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, index_from_value

START = pd.Timestamp("2026-05-01 10:00", tz="UTC")
LARGE = Conditions(
    length_m=180.0,
    draught_m=9.0,
    full_load_draught_m=9.0,
    trim_m=0.0,
    water_depth_m=60.0,
    beaufort=3,
    sea_state=2,
    current_mps=0.0,
    speed_at_85_percent_mcr_mps=7.2,
)


def circle(
    side: str, diameter_m: float, within_m: float = 2.0, approach_mps: float = 7.0, **more: object
) -> Manoeuvre:
    """A turning circle with 35 deg of rudder of a ship of 180 m, whose limit is 5 lengths, 900 m."""
    indices = {
        "tactical_diameter_m": index_from_value(
            "tactical_diameter_m", diameter_m, within_m, 180.0, "turning_circle"
        )
    }
    settings = {"rudder_deg": 35.0, "approach_mps": approach_mps}
    return Manoeuvre("turning_circle", "turning circle 35 deg", START, START, side, settings, indices, **more)  # type: ignore[arg-type]


def rows_of(*runs: Manoeuvre, conditions: Conditions = LARGE) -> list[IndexRow]:
    return index_rows(add_limits(runs, conditions))


def shown(*runs: Manoeuvre, conditions: Conditions = LARGE) -> dict[tuple[str, str], tuple[str, tuple[str, ...]]]:
    results = criterion_results(rows_of(*runs, conditions=conditions))
    return {(result.criterion.name, result.side): (result.result, result.missing) for result in results}


def test_port_stands_beside_starboard_and_both_meet_the_criterion() -> None:
    (row,) = rows_of(circle("port", 600.0), circle("starboard", 640.0))
    assert {side: mean.index.value for side, mean in row.sides.items()} == {"port": 600.0, "starboard": 640.0}
    assert (row.result, row.missing) == ("met", ())
    results = criterion_results([row])
    assert headline_of_criteria(results) == (
        "2 of 13 criteria of IMO MSC.137(76) are shown and met; 11 are not shown."
    )
    assert shortfalls_of_criteria(results)[0] != ("no such test", "initial turning to port and starboard")
    assert shown(circle("port", 600.0))["advance", "port"] == ("not_shown", ("no such test",))


def test_one_side_only_leaves_the_other_not_shown() -> None:
    results = shown(circle("port", 600.0))
    assert results["tactical diameter", "port"] == ("met", ())
    assert results["tactical diameter", "starboard"] == ("not_shown", ("no run to starboard",))


def test_one_side_above_the_limit_is_not_met() -> None:
    (row,) = rows_of(circle("port", 600.0), circle("starboard", 950.0))
    assert row.result == "not_met"
    assert "not met: tactical diameter to starboard;" in headline_of_criteria(criterion_results([row]))


def test_an_interval_that_holds_the_limit_cannot_be_said() -> None:
    (row,) = rows_of(circle("port", 899.0, 5.0), circle("starboard", 640.0))
    assert row.result == "cannot_be_said"
    assert "contains the limit: tactical diameter to port" in headline_of_criteria(criterion_results([row]))


@pytest.mark.parametrize(
    ("conditions", "reason"),
    [
        (Conditions(), "length is not known"),
        (replace(LARGE, length_m=33.9), "33.9 m"),
        (replace(LARGE, beaufort=6), "force 6"),
        (replace(LARGE, water_depth_m=27.0), "3.0 draughts"),
    ],
)
def test_a_trial_that_the_standards_are_not_for_shows_nothing(conditions: Conditions, reason: str) -> None:
    results = shown(circle("port", 600.0), conditions=conditions)
    result, missing = results["tactical diameter", "port"]
    assert result == "not_shown"
    assert any(reason in words for words in missing)
    assert not any(result == "met" for result, _ in results.values())


def test_a_value_above_the_limit_is_told_though_something_is_missing() -> None:
    rows = rows_of(circle("port", 950.0), conditions=replace(LARGE, beaufort=6))
    assert "above the limit lie: tactical diameter to port" in headline_of_criteria(criterion_results(rows))


def test_an_unsteady_approach_shows_nothing() -> None:
    (row,) = rows_of(circle("port", 600.0, shortfalls=("the approach was not steady",)))
    assert (row.result, row.missing) == ("not_shown", ("the approach was not steady",))


def test_runs_from_other_speeds_are_tests_of_their_own() -> None:
    rows = rows_of(circle("port", 600.0), circle("starboard", 640.0, approach_mps=4.0))
    assert [row.place for row in rows] == [0, 1]
    results = shown(circle("port", 600.0), circle("starboard", 640.0, approach_mps=4.0))
    assert results["tactical diameter", "port"] == ("met", ())
    assert results["tactical diameter", "starboard"][0] == "not_shown"


@pytest.mark.parametrize(
    ("switch_deg", "result"), [(10.3, "met"), (20.0, "met"), (8.7, "not_shown"), (5.0, None), (7.9, None)]
)
def test_initial_turning_takes_a_helm_held_until_ten_degrees(switch_deg: float, result: str | None) -> None:
    """Of a 10/5 zigzag the heading comes to 10 deg, if at all, by its overshoot after the helm was reversed."""
    way = {"initial_turning_m": index_from_value("initial_turning_m", 300.0, 5.0, 180.0, "zigzag")}
    settings = {"rudder_deg": 10.0, "switch_deg": switch_deg, "approach_mps": 7.0}
    run = Manoeuvre("zigzag", "zigzag", START, START, "port", settings, way)
    (judged,) = add_limits([run], LARGE)
    index = judged.indices["initial_turning_m"]
    assert (index.limit is not None) == (result is not None)
    assert shown(run)["initial turning", "port"][0] == (result or "not_shown")


def test_only_a_trial_that_shows_and_meets_all_meets_the_standards() -> None:
    def run(kind: str, name: str, side: str, helm_deg: float, *values: tuple[str, float]) -> Manoeuvre:
        indices = {index: index_from_value(index, value, 1.0, 180.0, kind) for index, value in values}
        settings = {"rudder_deg": helm_deg, "switch_deg": helm_deg, "approach_mps": 7.0}
        return Manoeuvre(kind, name, START, START, side, settings, indices)

    circles = ("advance_m", 600.0), ("tactical_diameter_m", 700.0)
    ten = ("overshoot_1_from_order_deg", 9.0), ("overshoot_2_from_order_deg", 15.0), ("initial_turning_m", 300.0)
    runs = [
        run(*test)
        for side in ("port", "starboard")
        for test in (
            ("turning_circle", "turning circle 35 deg", side, 35.0, *circles),
            ("zigzag", "zigzag 10/10", side, 10.0, *ten),
            ("zigzag", "zigzag 20/20", side, 20.0, ("overshoot_1_from_order_deg", 15.0)),
        )
    ]  # fmt: skip
    stop = run("stopping", "crash stop", "", 0.0, ("track_reach_m", 2000.0))
    stop = replace(stop, settings={**stop.settings, "thrust_rpm": -80.0})
    whole = criterion_results(rows_of(*runs, stop))
    assert headline_of_criteria(whole) == "The trial meets IMO MSC.137(76): all 13 criteria are shown and met."
    for left_out in range(len(runs)):
        fewer = criterion_results(rows_of(*(each for place, each in enumerate(runs) if place != left_out), stop))
        assert "The trial meets" not in headline_of_criteria(fewer)


def test_a_trial_without_manoeuvres_shows_nothing() -> None:
    assert rows_of() == []
    assert {result.result for result in criterion_results([])} == {"not_shown"}


@given(st.lists(st.floats(1.0, 1000.0), min_size=1, max_size=6), st.floats(0.01, 50.0))
def test_a_mean_has_no_narrower_interval_than_its_runs_or_their_scatter_give(
    values: list[float], within: float
) -> None:
    mean = mean_over_runs([Index(each, each - within, each + within, "m") for each in values])
    assert mean.index.value == pytest.approx(np.mean(values))
    assert mean.half_width >= within / np.sqrt(len(values)) - 1e-9
    if len(values) > 2:
        assert mean.half_width >= np.std(values, ddof=1) / np.sqrt(len(values)) * 1.95 - 1e-9
    assert mean.runs == len(values)


def test_two_runs_stand_with_their_range() -> None:
    """Student's factor of two runs is 12.7: what trial engineers expect of two is both."""
    mean = mean_over_runs([Index(600.0, 598.0, 602.0, "m"), Index(620.0, 617.0, 623.0, "m")])
    assert (mean.index.value, mean.index.low, mean.index.high) == (610.0, 598.0, 623.0)


def test_each_side_has_one_value_and_the_worse_one_is_judged() -> None:
    """The current is removed to port, where the turn was long enough to show it, and not to starboard."""
    removed = index_from_value("tactical_diameter_m", 560.0, 2.0, 180.0)
    port = circle("port", 600.0)
    port = replace(port, indices={**port.indices, "tactical_diameter_m_current_removed": removed})
    (row,) = rows_of(port, circle("starboard", 640.0))
    assert {side: (each.index.value, each.removed) for side, each in row.sides.items()} == {
        "port": (560.0, True), "starboard": (640.0, False),
    }  # fmt: skip
    assert row.judged_side == "starboard"


def test_means_hold_the_truth_in_95_percent_of_trials() -> None:
    """Three runs each, that scatter more than they know: Student's t has to carry it."""
    random = np.random.default_rng(4)
    draws = random.normal(100.0, 5.0, (2000, 3))
    means = [mean_over_runs([Index(x, x - 1.0, x + 1.0, "m") for x in draw]).index for draw in draws]
    assert 0.93 <= np.mean([each.low <= 100.0 <= each.high for each in means]) <= 0.97


def test_an_overshoot_is_judged_from_the_order() -> None:
    """As IMO counts it: 22 deg from half of the command are 26 deg from the order here, above the limit of 25."""
    indices = {
        "overshoot_1_deg": Index(22.0, 21.8, 22.2, "deg"),
        "overshoot_1_from_order_deg": Index(26.0, 25.8, 26.2, "deg"),
    }  # fmt: skip
    settings = {"rudder_deg": 20.0, "switch_deg": 20.0, "approach_mps": 7.0}
    (row,) = rows_of(Manoeuvre("zigzag", "zigzag 20/20", START, START, "port", settings, indices))
    assert row.sides["port"].index.value == 26.0
    assert row.result == "not_met"


def test_single_runs_of_one_name_are_told_apart_by_their_time() -> None:
    indices = {"last_yaw_rate_dps": Index(-1.8, -1.9, -1.7, "deg/s")}
    runs = [
        Manoeuvre("thruster_test", "tunnel thruster", start, start, "port", {}, indices)
        for start in (START, START + pd.Timedelta(minutes=5))
    ]
    assert [row.test for row in rows_of(*runs)] == ["Tunnel thruster, 10:00:00", "Tunnel thruster, 10:05:00"]


def test_an_interval_that_is_not_known_is_never_met() -> None:
    bare = [replace(circle(side, 600.0), indices={"tactical_diameter_m": Index(600.0, np.nan, np.nan, "m")})
            for side in ("port", "port", "port", "starboard")]  # fmt: skip
    for runs in (bare[:1], bare[:2], bare[:3], bare):
        assert shown(*runs)["tactical diameter", "port"][0] == "cannot_be_said"


def test_a_run_of_other_conditions_does_not_hide_behind_one_that_shows_all() -> None:
    known, bad = rows_of(circle("port", 600.0)), replace(LARGE, length_m=None, sea_state=7)
    assert known[0].result == "met"
    both = [*add_limits([circle("port", 600.0)], LARGE), *add_limits([circle("port", 610.0)], bad)]
    (result,) = (each for each in criterion_results(index_rows(both)) if each.mean)
    assert result.result == "not_shown"
    assert any("state 7" in reason for reason in result.missing)


@pytest.mark.parametrize(("setting", "value"), [
    ("approach_yaw_rate_dps", 0.1), ("approach_yaw_rate_dps", -0.1), ("approach_acceleration_mps2", 0.028),
])  # fmt: skip
def test_an_approach_that_turns_or_gathers_way_shows_nothing(setting: str, value: float) -> None:
    run = circle("port", 600.0)
    run = replace(run, settings={**run.settings, setting: value})
    result, missing = shown(run)["tactical diameter", "port"]
    assert result == "not_shown"
    assert "the approach was not steady" in missing[0]


@pytest.mark.parametrize(
    ("helm_deg", "words"), [(38.4, "more than 35 deg"), (25.0, "largest helm at the test speed")]
)
def test_a_turn_with_another_helm_than_35_deg_shows_nothing(helm_deg: float, words: str) -> None:
    run = circle("port", 600.0)
    run = replace(run, settings={**run.settings, "rudder_deg": helm_deg})
    result, missing = shown(run)["tactical diameter", "port"]
    assert (result, any(words in reason for reason in missing)) == ("not_shown", True)


def test_tests_that_the_crew_gave_one_name_are_judged_apart() -> None:
    indices = {"overshoot_1_from_order_deg": Index(9.0, 8.9, 9.1, "deg", counted_from="order")}
    ten, twenty = (
        Manoeuvre("zigzag", "zigzag", START, START, "port", {"rudder_deg": angle, "switch_deg": angle,
                  "approach_mps": 7.0}, indices) for angle in (10.0, 20.0)
    )  # fmt: skip
    assert [len(row.sides) for row in rows_of(ten, twenty)] == [1, 1]
    results = shown(ten, twenty)
    assert results["first overshoot of 10/10", "port"][0] == results["first overshoot of 20/20", "port"][0] == "met"


def test_a_current_widens_the_way_of_a_stop() -> None:
    stop = Manoeuvre(
        "stopping", "stop", START, START + pd.Timedelta(minutes=10), "",
        {"thrust_rpm": -80.0, "approach_mps": 7.2},
        {"track_reach_m": index_from_value("track_reach_m", 2600.0, 10.0, 180.0, "stopping")},
    )  # fmt: skip
    assert shown(stop)["track reach", ""][0] == "met"
    carried = replace(LARGE, current_mps=0.5, speed_at_85_percent_mcr_mps=7.0)
    assert shown(stop, conditions=carried)["track reach", ""][0] == "cannot_be_said"
    assert shown(stop, conditions=replace(LARGE, current_mps=None))["track reach", ""][0] == "not_shown"


def straight_run(seconds_before: float, **settings: float) -> Manoeuvre:
    """A straight run that ends so long before :data:`START`."""
    end = START - pd.Timedelta(seconds=seconds_before)
    indices = {"speed_over_ground_mps": index_from_value("speed_over_ground_mps", 7.0, 0.1)}
    return Manoeuvre(
        "speed_run", "speed run 100 rpm on 0 deg", end - pd.Timedelta(minutes=2), end, "", settings, indices
    )


def change_of_course(rudder_deg: float) -> Manoeuvre:
    indices = {"initial_turning_m": index_from_value("initial_turning_m", 200.0, 5.0, 180.0, "course_change")}
    settings = {"rudder_deg": rudder_deg, "approach_mps": 7.0, "turned_deg": 120.0}
    return Manoeuvre("course_change", f"turn {rudder_deg:.0f} deg", START, START, "port", settings, indices)


def test_approaches_are_no_rows_of_the_indices_but_speed_runs_are() -> None:
    test, turn = circle("port", 600.0), replace(circle("port", 600.0), settings={"turned_deg": 190.0})
    assert [row.name for row in rows_of(straight_run(10.0), test)] == ["tactical_diameter_m"]
    assert len(rows_of(straight_run(60.0), test)) == 2
    assert len(rows_of(straight_run(10.0), turn)) == 2  # to the reciprocal course


def test_a_small_turn_is_a_row_only_where_it_is_a_test_of_the_standard() -> None:
    assert rows_of(change_of_course(15.0)) == []
    assert [row.name for row in rows_of(change_of_course(10.0))] == ["initial_turning_m"]


def test_shortfalls_of_a_run_go_with_it_through_json() -> None:
    run = circle("port", 600.0, shortfalls=("the approach was not steady",))
    assert Manoeuvre.from_json(run.as_json()) == run
    old = {name: value for name, value in run.as_json().items() if name != "shortfalls"}
    assert Manoeuvre.from_json(old) == replace(run, shortfalls=())
