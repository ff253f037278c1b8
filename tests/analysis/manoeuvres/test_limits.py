"""IMO MSC.137(76), section 5.3: the figures of the resolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import water_depth_m
from seatrial.analysis.manoeuvres.criteria import (
    CRITERIA,
    add_limits,
    first_overshoot_10_10_deg,
    is_turning_test,
    missing_conditions_of_run,
    second_overshoot_10_10_deg,
)
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre, index_from_value

HUNDRED = Conditions(length_m=100.0)
FULLY_KNOWN = Conditions(
    length_m=100.0,
    draught_m=8.0,
    full_load_draught_m=8.0,
    trim_m=0.0,
    water_depth_m=60.0,
    beaufort=3,
    sea_state=2,
    current_mps=0.0,
    speed_at_85_percent_mcr_mps=5.2,
)


@pytest.mark.parametrize(("ratio_s", "first", "second"), [(5, 10, 25), (10, 10, 25), (20, 15, 32.5), (30, 20, 40),
                                                          (60, 20, 40)])  # fmt: skip
def test_overshoots_of_the_10_10_test(ratio_s: float, first: float, second: float) -> None:
    assert first_overshoot_10_10_deg(ratio_s) == first
    assert second_overshoot_10_10_deg(ratio_s) == second


def manoeuvre(kind: str, helm_deg: float, switch_deg: float = 0.0) -> Manoeuvre:
    overshoots = [f"overshoot_{number}{name}_deg" for number in (1, 2) for name in ("", "_from_order")]
    names = (*overshoots, "initial_turning_m", "advance_m", "tactical_diameter_m")
    settings = {"azimuth_deg": helm_deg, "switch_deg": switch_deg, "approach_mps": 5.0}
    indices = {name: index_from_value(name, 50.0, 1.0, 100.0, kind) for name in names}
    noon = pd.Timestamp("2026-05-04T12:00Z")
    return Manoeuvre(kind, f"{kind} {helm_deg}", noon, noon, "port", settings, indices)


def limits_by_name(*found: Manoeuvre) -> dict[str, dict[str, float]]:
    return {each.name: {name: index.limit for name, index in each.indices.items() if index.limit is not None}
            for each in add_limits(found, Conditions(length_m=100.0))}  # fmt: skip


def test_a_circle_is_the_turning_test_at_the_largest_helm_only() -> None:
    found = limits_by_name(manoeuvre("turning_circle", -35.3), manoeuvre("turning_circle", 20.0),
                           manoeuvre("turning_circle", -10.0))  # fmt: skip
    assert found["turning_circle -35.3"] == {"advance_m": 450.0, "tactical_diameter_m": 500.0}
    assert found["turning_circle 20.0"] == {}
    assert found["turning_circle -10.0"] == {"initial_turning_m": 250.0}


def test_the_largest_helm_is_that_of_all_manoeuvres_and_a_note_says_it() -> None:
    alone, beside = add_limits([manoeuvre("turning_circle", 28.0)], HUNDRED), add_limits(
        [manoeuvre("turning_circle", 28.0), manoeuvre("course_change", -45.0)], HUNDRED)  # fmt: skip
    assert alone[0].indices["advance_m"].limit == 450.0
    assert beside[0].indices["advance_m"].limit is None
    assert "the largest of this recording 45 deg" in beside[0].notes[-1]


@pytest.mark.parametrize("helm_deg", [-10.0, 20.0])
def test_the_helm_of_another_test_is_nobodys_largest(helm_deg: float) -> None:
    assert not is_turning_test(helm_deg, abs(helm_deg))
    assert is_turning_test(30.0, 31.2)
    assert is_turning_test(35.0, 70.0)
    assert not is_turning_test(50.0, 70.0)


def test_a_zigzag_has_the_limits_of_its_own_test() -> None:
    found = limits_by_name(manoeuvre("zigzag", 10.0, 10.0), manoeuvre("zigzag", 20.0, 20.0),
                           manoeuvre("zigzag", 5.0, 10.0))  # fmt: skip
    assert found["zigzag 10.0"] == {
        "overshoot_1_from_order_deg": 15.0, "overshoot_2_from_order_deg": 32.5, "initial_turning_m": 250.0,
    }  # fmt: skip
    assert found["zigzag 20.0"] == {"overshoot_1_from_order_deg": 25.0}
    assert found["zigzag 5.0"] == {}


def test_no_value_from_half_of_the_helm_stands_beside_a_limit() -> None:
    for angle_deg in (10.0, 20.0):
        (run,) = add_limits([manoeuvre("zigzag", angle_deg, angle_deg)], FULLY_KNOWN)
        limited = [index for index in run.indices.values() if index.limit is not None]
        assert limited
        assert all(index.counted_from == "order" for index in limited)
        assert all(index.result in ("", "not_shown") or index.limit for index in run.indices.values())


@pytest.mark.parametrize(("changed", "reason"), [
    ({"length_m": None}, "the ship's length is not known"), ({"length_m": 99.0}, "for ships of 100 m"),
    ({"draught_m": None}, "draught_m"), ({"full_load_draught_m": None}, "full_load_draught_m"),
    ({"full_load_draught_m": 9.0}, "not fully loaded"), ({"trim_m": None}, "the trim is not known"),
    ({"trim_m": -0.6}, "even keel"), ({"water_depth_m": None}, "depth"), ({"water_depth_m": 31.0}, "3.9 draughts"),
    ({"beaufort": None}, "the wind is not known"), ({"beaufort": 6}, "force 6"),
    ({"current_mps": None}, "the current is not known"), ({"current_mps": 0.6}, "at 85%"),
    ({"sea_state": None}, "the sea is not known"), ({"trim_m": float("nan")}, "the trim is not known"),
    ({"draught_m": float("nan")}, "loading"), ({"water_depth_m": float("nan")}, "draughts"),
    ({"sea_state": 5}, "state 5"),
    ({"speed_at_85_percent_mcr_mps": None}, "maximum output is not known"),
    ({"speed_at_85_percent_mcr_mps": 5.6}, "at 89%"),
])  # fmt: skip
def test_a_criterion_is_shown_only_where_nothing_is_missing(changed: dict[str, float | None], reason: str) -> None:
    run = manoeuvre("turning_circle", 35.0)
    assert missing_conditions_of_run(run, FULLY_KNOWN) == ()
    assert any(reason in missing for missing in missing_conditions_of_run(run, replace(FULLY_KNOWN, **changed)))


def circling() -> pd.DataFrame:
    """Straight on for five minutes, and a circle of ten."""
    turned = np.maximum(np.arange(900.0) - 300.0, 0.0)
    heading, helm = np.deg2rad(turned), np.where(turned > 0.0, 35.0, 0.0)
    return pd.DataFrame(
        {"north_m": np.cumsum(5.0 * np.cos(heading)), "east_m": np.cumsum(5.0 * np.sin(heading)),
         "heading_deg": turned % 360.0, "rudder_angle_deg": helm},
        pd.date_range("2026-06-01T08:00:00Z", periods=900, freq="1s", name="time"))  # fmt: skip


@pytest.mark.parametrize(
    ("stated", "before_mps", "during_mps", "force"),
    [(3, 2.0, 12.0, 6), (6, 2.0, 5.0, 6), (3, 2.0, 5.0, 0), (None, 2.0, 12.0, 6)],
)
def test_the_wind_that_was_measured_in_a_run_counts_where_it_is_more_than_the_stated_one(
    stated: int | None, before_mps: float, during_mps: float, force: int
) -> None:
    """However calm the rest of the recording was."""
    calm = circling().iloc[:300].drop(columns="rudder_angle_deg")
    earlier = [calm.set_axis(calm.index - pd.Timedelta(minutes=5 * count)) for count in range(1, 13)]
    table = pd.concat([*earlier, circling()]).sort_index()
    wind_mps = np.where(table.index < pd.Timestamp("2026-06-01T08:05:00Z"), before_mps, during_mps)
    table = table.assign(wind_speed_mps=wind_mps, wind_direction_deg=20.0)
    runs = find_manoeuvres(table, 100.0, conditions=replace(FULLY_KNOWN, beaufort=stated))
    (run,) = (run for run in runs if run.kind == "turning_circle")
    missing = [words for words in run.indices["advance_m"].missing if "wind" in words]
    assert len(missing) == bool(force)
    assert all(f"force {force}" in words for words in missing)
    assert run.settings["wind_mps"] == pytest.approx(during_mps, abs=0.1)


@pytest.mark.parametrize(
    ("stated_m", "below_m", "draught_m", "reason"),
    [
        (None, 44.0, 12.0, ""), (None, 40.0, 12.0, "the water was 3.7 draughts deep, less than 4"),
        (100.0, 40.0, 12.0, "the water was 3.7 draughts deep, less than 4"),
        (40.0, 44.0, 12.0, "the water was 3.3 draughts deep, less than 4"),
        (None, 40.0, None, "the depth of the water in draughts is not known: draught_m"),
        (None, None, 12.0, "the depth of the water in draughts is not known: water_depth_m"),
    ],
)  # fmt: skip
def test_the_depth_that_was_measured_in_a_run_counts_where_it_is_less_than_the_stated_one(
    stated_m: float | None, below_m: float | None, draught_m: float | None, reason: str
) -> None:
    """Four metres above a transducer; shallow water before the run, and a single wrong echo in it, do not count."""
    table = circling()
    if below_m is not None:
        below = np.where(np.arange(900) < 200, 12.0, np.where(np.arange(900) == 500, 2.0, below_m))
        table = table.assign(depth_below_transducer_m=below, depth_offset_m=4.0)
    conditions = replace(FULLY_KNOWN, water_depth_m=stated_m, draught_m=draught_m, full_load_draught_m=draught_m)
    (run,) = find_manoeuvres(table, 100.0, conditions=conditions)
    missing = [words for words in run.indices["advance_m"].missing if "deep" in words or "depth" in words]
    assert missing == [reason] * bool(reason)
    assert run.settings.get("water_depth_m") == (None if below_m is None else below_m + 4.0)


def test_depth_counts_from_the_waterline_where_the_transducer_is_known() -> None:
    assert water_depth_m({"depth_below_transducer_m": 30.0, "depth_offset_m": 4.0}) == 34.0
    assert water_depth_m({"depth_below_transducer_m": 30.0, "depth_offset_m": -2.0}) == 30.0  # to the keel
    assert water_depth_m({"depth_below_transducer_m": 30.0}) == 30.0
    assert np.isnan(water_depth_m({"depth_below_transducer_m": 0.0, "depth_offset_m": 4.0}))  # the bottom is lost
    assert np.isnan(water_depth_m({}))


def test_a_test_with_other_angles_does_not_show_the_criterion() -> None:
    (run,) = add_limits([manoeuvre("zigzag", 11.5, 10.0)], FULLY_KNOWN)
    index = run.indices["overshoot_1_from_order_deg"]
    assert (index.result, index.missing) == ("not_shown", ("the helm was 11.5 deg, not 10 deg",))
    (run,) = add_limits([manoeuvre("zigzag", 10.5, 9.5)], FULLY_KNOWN)
    assert run.indices["overshoot_1_from_order_deg"].missing == ()


def test_a_tanker_of_chemicals_may_be_of_any_length() -> None:
    run = manoeuvre("turning_circle", 35.0)
    assert missing_conditions_of_run(run, replace(FULLY_KNOWN, length_m=80.0, chemical_or_gas_tanker=True)) == ()


def test_every_criterion_is_of_one_clause_and_counts_from_the_order() -> None:
    assert [criterion.clause for criterion in CRITERIA] == sorted(criterion.clause for criterion in CRITERIA)
    assert sum(len(criterion.sides) for criterion in CRITERIA) == 13
    assert not any(criterion.index == "overshoot_1_deg" for criterion in CRITERIA)


def test_without_a_length_no_limit_needs_one() -> None:
    circle, twenty = add_limits([manoeuvre("turning_circle", 35.0), manoeuvre("zigzag", 20.0, 20.0)], Conditions())
    assert all(index.limit is None for index in circle.indices.values())
    assert circle.notes == ()
    assert twenty.indices["overshoot_1_from_order_deg"].limit == 25.0
