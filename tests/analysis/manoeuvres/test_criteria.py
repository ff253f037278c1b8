"""Means over like runs, and when a value passes, fails or is not judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.manoeuvres.criteria import Conditions, index_rows, mean_of, untested, verdict
from analysis.manoeuvres.indices import Index, Manoeuvre, add_limits, index_of

START = pd.Timestamp("2026-05-01 10:00", tz="UTC")
LARGE = Conditions(length_m=180.0, draught_m=9.0, water_depth_m=60.0, beaufort=3)


def circle(
    side: str, diameter_m: float, within_m: float = 2.0, approach_mps: float = 7.0, **more: object
) -> Manoeuvre:
    """A turning circle with 35 deg of rudder of a ship of 180 m, whose limit is 5 lengths, 900 m."""
    indices = {"tactical_diameter_m": index_of("tactical_diameter_m", diameter_m, within_m, 180.0)}
    settings = {"rudder_deg": 35.0, "approach_mps": approach_mps}
    return Manoeuvre("turning_circle", "turning circle 35 deg", START, START, side, settings, indices, **more)  # type: ignore[arg-type]


def rows_of(*runs: Manoeuvre, conditions: Conditions = LARGE) -> list:
    return index_rows(add_limits(runs, conditions.length_m), conditions)


def test_port_stands_beside_starboard_and_both_pass() -> None:
    (row,) = rows_of(circle("port", 600.0), circle("starboard", 640.0))
    assert {side: each.index.value for side, each in row.sides.items()} == {"port": 600.0, "starboard": 640.0}
    assert (row.result, row.why) == ("pass", "")
    assert verdict([row]) == "The trial meets IMO MSC.137(76) in the one value judged."
    assert "tactical diameter" not in untested([row])
    assert "advance" in untested([row])


def test_one_side_above_the_limit_fails_both() -> None:
    (row,) = rows_of(circle("port", 600.0), circle("starboard", 950.0))
    assert row.result == "fail"
    assert "does not meet" in verdict([row])
    assert "tactical diameter" in verdict([row])


def test_an_interval_that_holds_the_limit_is_not_judged() -> None:
    (row,) = rows_of(circle("port", 899.0, 5.0), circle("starboard", 640.0))
    assert (row.result, row.why) == ("not judged", "the interval of the value holds the limit")


@pytest.mark.parametrize(
    ("conditions", "why"),
    [
        (Conditions(), "length is not known"),
        (Conditions(33.9), "33.9 m between perpendiculars"),
        (Conditions(180.0, beaufort=6), "force 6"),
        (Conditions(180.0, 10.0, 30.0), "3.0 draughts"),
    ],
)
def test_a_trial_that_the_standards_are_not_for_is_not_judged(conditions: Conditions, why: str) -> None:
    (row,) = rows_of(circle("port", 600.0), conditions=conditions)
    assert row.result == "not judged"
    assert why in row.why
    assert why in verdict([row])


def test_an_unsteady_approach_is_not_judged() -> None:
    (row,) = rows_of(circle("port", 600.0, notes=("the approach was not steady",)))
    assert (row.result, row.why) == ("not judged", "the approach was not steady")


def test_runs_from_other_speeds_are_tests_of_their_own() -> None:
    assert [row.place for row in rows_of(circle("port", 600.0), circle("starboard", 640.0, approach_mps=4.0))] == [
        0,
        1,
    ]


def test_a_trial_without_manoeuvres_says_so() -> None:
    assert rows_of() == []
    assert "No standard manoeuvre" in verdict([])


@given(st.lists(st.floats(1.0, 1000.0), min_size=1, max_size=6), st.floats(0.01, 50.0))
def test_a_mean_has_no_narrower_interval_than_its_runs_or_their_scatter_give(
    values: list[float], within: float
) -> None:
    mean = mean_of([Index(each, each - within, each + within, "m") for each in values])
    assert mean.index.value == pytest.approx(np.mean(values))
    assert mean.half >= within / np.sqrt(len(values)) - 1e-9
    if len(values) > 2:
        assert mean.half >= np.std(values, ddof=1) / np.sqrt(len(values)) * 1.95 - 1e-9
    assert mean.runs == len(values)


def test_two_runs_stand_with_their_range() -> None:
    """Student's factor of two runs is 12.7: what trial engineers expect of two is both."""
    mean = mean_of([Index(600.0, 598.0, 602.0, "m"), Index(620.0, 617.0, 623.0, "m")])
    assert (mean.index.value, mean.index.low, mean.index.high) == (610.0, 598.0, 623.0)


def test_each_side_has_one_value_and_the_worse_one_is_judged() -> None:
    """The current is removed to port, where the turn was long enough to show it, and not to starboard."""
    removed = index_of("tactical_diameter_m", 560.0, 2.0, 180.0)
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
    means = [mean_of([Index(x, x - 1.0, x + 1.0, "m") for x in draw]).index for draw in draws]
    assert 0.93 <= np.mean([each.low <= 100.0 <= each.high for each in means]) <= 0.97


def test_an_overshoot_is_judged_from_the_order_where_the_helm_is_slow() -> None:
    """As IMO counts it: 22 deg from half of the command may be 26 deg from the order, above the limit of 25."""
    indices = {
        "overshoot_1_deg": Index(22.0, 21.8, 22.2, "deg"),
        "overshoot_1_from_order_deg": Index(26.0, 25.8, 26.2, "deg"),
    }  # fmt: skip
    settings = {"rudder_deg": 20.0, "switch_deg": 20.0, "approach_mps": 7.0}
    (row,) = rows_of(Manoeuvre("zigzag", "zigzag 20/20", START, START, "port", settings, indices))
    assert row.sides["port"].index.value == 26.0
    assert (row.result, verdict([row])) == (
        "fail", "The trial does not meet IMO MSC.137(76) in first overshoot (Zigzag 20/20 at 7.00 m/s).",
    )  # fmt: skip
    assert "first overshoot" not in untested([row])
    assert untested([row]).count("second overshoot") == 1


def test_single_runs_of_one_name_are_told_apart_by_their_time() -> None:
    indices = {"last_yaw_rate_dps": Index(-1.8, -1.9, -1.7, "deg/s")}
    runs = [
        Manoeuvre("thruster_test", "tunnel thruster", start, start, "port", {}, indices)
        for start in (START, START + pd.Timedelta(minutes=5))
    ]
    assert [row.test for row in rows_of(*runs)] == ["Tunnel thruster, 10:00:00", "Tunnel thruster, 10:05:00"]
