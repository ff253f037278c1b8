"""IMO MSC.137(76), section 5.3: the figures of the resolution."""

from __future__ import annotations

import pandas as pd
import pytest

from analysis.manoeuvres.indices import (
    Manoeuvre,
    add_limits,
    first_overshoot_10_10_deg,
    index_of,
    is_turning_test,
    overshoot_limit_deg,
    second_overshoot_10_10_deg,
)


@pytest.mark.parametrize(("ratio_s", "first", "second"), [(5, 10, 25), (10, 10, 25), (20, 15, 32.5), (30, 20, 40),
                                                          (60, 20, 40)])  # fmt: skip
def test_overshoots_of_the_10_10_test(ratio_s: float, first: float, second: float) -> None:
    assert first_overshoot_10_10_deg(ratio_s) == first
    assert second_overshoot_10_10_deg(ratio_s) == second


def test_a_limit_holds_for_its_own_test_only() -> None:
    assert overshoot_limit_deg(1, 20.3, 19.4, None, 5.0) == 25.0
    assert overshoot_limit_deg(2, 20.3, 19.4, None, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 20.0, 100.0, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 10.0, None, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 10.0, 100.0, 5.0) == 15.0
    assert overshoot_limit_deg(2, 10.0, 10.0, 100.0, 5.0) == 32.5


def manoeuvre(kind: str, helm_deg: float, switch_deg: float = 0.0) -> Manoeuvre:
    names = ("overshoot_1_deg", "overshoot_2_deg", "initial_turning_m", "advance_m", "tactical_diameter_m")
    settings = {"azimuth_deg": helm_deg, "switch_deg": switch_deg, "approach_mps": 5.0}
    indices = {name: index_of(name, 50.0, 1.0, 100.0) for name in names}
    noon = pd.Timestamp("2026-05-04T12:00Z")
    return Manoeuvre(kind, f"{kind} {helm_deg}", noon, noon, "port", settings, indices)


def limits_by_name(*found: Manoeuvre) -> dict[str, dict[str, float]]:
    return {each.name: {name: index.limit for name, index in each.indices.items() if index.limit is not None}
            for each in add_limits(found, 100.0)}  # fmt: skip


def test_a_circle_is_the_turning_test_at_the_largest_helm_only() -> None:
    found = limits_by_name(manoeuvre("turning_circle", -35.3), manoeuvre("turning_circle", 20.0),
                           manoeuvre("turning_circle", -10.0))  # fmt: skip
    assert found["turning_circle -35.3"] == {"advance_m": 450.0, "tactical_diameter_m": 500.0}
    assert found["turning_circle 20.0"] == {}
    assert found["turning_circle -10.0"] == {"initial_turning_m": 250.0}


def test_the_largest_helm_is_that_of_all_manoeuvres_and_a_note_says_it() -> None:
    alone, beside = add_limits([manoeuvre("turning_circle", 28.0)], 100.0), add_limits(
        [manoeuvre("turning_circle", 28.0), manoeuvre("course_change", -45.0)], 100.0)  # fmt: skip
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
    assert found["zigzag 10.0"] == {"overshoot_1_deg": 15.0, "overshoot_2_deg": 32.5, "initial_turning_m": 250.0}
    assert found["zigzag 20.0"] == {"overshoot_1_deg": 25.0}
    assert found["zigzag 5.0"] == {}


def test_without_a_length_no_limit_needs_one() -> None:
    circle, twenty = add_limits([manoeuvre("turning_circle", 35.0), manoeuvre("zigzag", 20.0, 20.0)], None)
    assert all(index.limit is None for index in circle.indices.values())
    assert circle.notes == ()
    assert twenty.indices["overshoot_1_deg"].limit == 25.0
