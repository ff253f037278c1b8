"""Manoeuvres of small craft are found whatever steers them, however often they swing, with noise on the helm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.ship import Actuator, Actuators
from seatrial.analysis.manoeuvres.criteria import index_rows
from seatrial.analysis.manoeuvres.find import find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import LeftOut, Manoeuvre
from seatrial.analysis.manoeuvres.motion import drives_by_side
from tests.analysis.manoeuvres.small_craft import (
    AZIMUTHS,
    PROPELLERS,
    RUDDER,
    Craft,
    sail_circle,
    sail_zigzag,
)
from tests.analysis.rudder_ships import MODEL, sail

STEERING = {"rudder": RUDDER, "azimuths": AZIMUTHS, "propellers": PROPELLERS}
CRAFT = st.builds(
    Craft,
    length_m=st.floats(1.0, 10.0), speed_mps=st.floats(0.5, 1.5),
    actuators=st.sampled_from([*STEERING.values()]),
    helm_rate_dps=st.sampled_from([10.0, 20.0, 60.0]), noise_deg=st.floats(0.05, 0.8),
    wander_deg=st.floats(0.0, 1.0),
    rate_hz=st.sampled_from([2.0, 5.0, 10.0]),
)  # fmt: skip
properties = settings(max_examples=15, deadline=None, derandomize=True)


def steered(table: pd.DataFrame) -> tuple[list[Manoeuvre], tuple[LeftOut, ...]]:
    runs, left_out = find_manoeuvres_and_left_out(table)
    return [run for run in runs if run.kind not in ("speed_run", "acceleration", "stopping")], left_out


def lead_s(craft: Craft) -> float:
    return max(20.0, 10.0 * craft.pace_s)


@given(
    craft=CRAFT, swings=st.integers(4, 12), angle_deg=st.sampled_from([15.0, 20.0, 30.0]), seed=st.integers(0, 99)
)
@properties
def test_a_zigzag_is_one_with_all_its_swings(craft: Craft, swings: int, angle_deg: float, seed: int) -> None:
    sailed = sail_zigzag(craft, swings, angle_deg, angle_deg, seed, lead_s(craft))
    (run,), _ = steered(sailed.table)
    assert run.kind == "zigzag"
    lost = swings - run.settings["swings"]
    assert abs(lost) <= 1.0  # one at either end may be over before its helm is held
    start_s = (run.start - sailed.table.index[0]).total_seconds()
    nearest_s = min(sailed.orders_s[: 1 + (lost > 0.0)], key=lambda order_s: abs(order_s - start_s))
    assert start_s == pytest.approx(nearest_s, abs=1.0 + 1.0 / craft.rate_hz)
    assert run.settings["switch_deg"] == pytest.approx(angle_deg, abs=4.0)


@pytest.mark.parametrize(("angle_deg", "switch_deg"), [(10.0, 10.0), (20.0, 10.0), (20.0, 20.0)])
@pytest.mark.parametrize("rate_hz", [2.0, 5.0, 10.0])
def test_a_fast_boat_whose_swings_last_for_seconds_sails_zigzags(
    angle_deg: float, switch_deg: float, rate_hz: float
) -> None:
    """A workboat of 12 m at 9 m/s is through a swing of a 20/10 in four seconds."""
    craft = Craft(12.0, 9.0, helm_rate_dps=25.0, rate_hz=rate_hz)
    sailed = sail_zigzag(craft, 6, angle_deg, switch_deg, 0, 60.0)
    (run,), _ = steered(sailed.table)
    assert run.name == f"zigzag {angle_deg:.0f}/{switch_deg:.0f}"
    assert run.side == "starboard"
    assert run.settings["swings"] >= 5.0
    assert (run.start - sailed.table.index[0]).total_seconds() == pytest.approx(sailed.orders_s[0], abs=0.3)


@pytest.mark.parametrize("period_s", [2.0, 3.5, 6.0])
def test_a_helm_that_keeps_the_course_in_waves_sails_no_zigzag(period_s: float) -> None:
    def keep_course(time_s: float, heading_deg: float, _: float) -> tuple[float, float]:
        return 5.0 * round((12.0 * np.sin(2.0 * np.pi * time_s / period_s) - heading_deg) / 5.0), 600.0

    assert steered(sail(MODEL, keep_course, 200.0))[0] == []


@pytest.mark.parametrize("switch_deg", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_helm_that_is_reversed_as_soon_as_it_is_reached_is_the_first_swing(switch_deg: float, seed: int) -> None:
    """With much helm for little heading, as 35/5, a model holds its first helm for some two seconds.

    On a gauge without noise the begin of each held helm is a reversal, too.
    """
    craft = Craft(7.0, 1.2, helm_rate_dps=16.0, noise_deg=0.0, rate_hz=20.0)
    sailed = sail_zigzag(craft, 6, 35.0, switch_deg, seed, lead_s(craft))
    (run,), _ = steered(sailed.table)
    start_s = (run.start - sailed.table.index[0]).total_seconds()
    assert start_s == pytest.approx(sailed.orders_s[0], abs=0.5)
    assert run.settings["swings"] == 6


@pytest.mark.parametrize("actuators", [RUDDER, AZIMUTHS])
@pytest.mark.parametrize("helm_rate_dps", [12.0, 20.0, 60.0])
@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 2.0])
def test_orders_between_sparse_records_are_neither_early_nor_late(
    rate_hz: float, helm_rate_dps: float, actuators: Actuators
) -> None:
    """Of a helm that is put over within a few records: else every overshoot from the order is too large."""
    craft = Craft(7.0, 1.2, actuators, helm_rate_dps, noise_deg=0.1, rate_hz=rate_hz)
    late_s = list[float]()
    for seed in range(3):
        sailed = sail_zigzag(craft, 10, 20.0, 20.0, seed, lead_s(craft) + 0.3 * seed)
        (run,), _ = steered(sailed.table)
        found_s = np.array([(order - sailed.table.index[0]).total_seconds() for order in run.executes])
        late_s += [order_s - sailed.orders_s[np.abs(sailed.orders_s - order_s).argmin()] for order_s in found_s]
    assert len(late_s) > 20
    assert abs(np.mean(late_s)) < 0.15 / rate_hz
    assert np.std(late_s) < 0.3 / rate_hz


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize(("angle_deg", "switch_deg"), [(25.0, 10.0), (20.0, 5.0)])
def test_swings_of_seconds_are_neither_a_speed_run_nor_one_propeller_alone(
    angle_deg: float, switch_deg: float, rate_hz: float
) -> None:
    craft = Craft(2.0, 2.5, PROPELLERS, helm_rate_dps=60.0, rate_hz=rate_hz)
    runs, _ = find_manoeuvres_and_left_out(sail_zigzag(craft, 40, angle_deg, switch_deg, 0, 5.0).table)
    assert {run.kind for run in runs} <= {"zigzag"}


@given(craft=CRAFT, angle_deg=st.sampled_from([-30.0, 15.0, 25.0]), seed=st.integers(0, 99))
@properties
def test_a_circle_is_one_to_the_side_of_its_helm(craft: Craft, angle_deg: float, seed: int) -> None:
    (run,), _ = steered(sail_circle(craft, angle_deg, 560.0, seed, lead_s(craft)).table)
    assert (run.kind, run.side) == ("turning_circle", "starboard" if angle_deg > 0 else "port")
    assert {"advance_m", "tactical_diameter_m", "steady_diameter_m"} <= set(run.indices)
    assert run.shortfalls == ()


@given(craft=CRAFT, turned_deg=st.floats(300.0, 800.0), seed=st.integers(0, 99))
@properties
def test_a_circle_without_an_approach_has_what_needs_none(craft: Craft, turned_deg: float, seed: int) -> None:
    angle_deg = 20.0
    (run,), _ = steered(sail_circle(craft, angle_deg, turned_deg, seed, 0.0).table)
    assert run.kind == "turning_circle"
    plain = {name.removesuffix("_current_removed") for name in run.indices}
    assert plain <= {"steady_diameter_m", "steady_yaw_rate_dps", "steady_speed_mps", "drift_angle_deg"}
    rate_dps = 0.35 / craft.pace_s * angle_deg
    index = run.indices["steady_yaw_rate_dps"]
    assert index.value == pytest.approx(rate_dps, rel=0.05)
    assert "approach" in run.shortfalls[0]
    assert any("advance" in note for note in run.notes)


@pytest.mark.parametrize("steering", STEERING)
def test_a_rudder_that_wanders_by_two_degrees_ends_no_turn(steering: str) -> None:
    craft = Craft(3.6, 1.2, STEERING[steering], wander_deg=2.0, noise_deg=0.5, rate_hz=2.0)
    for seed in range(5):
        (run,), _ = steered(sail_circle(craft, 30.0, 525.0, seed, lead_s(craft)).table)
        assert run.settings["turned_deg"] == pytest.approx(525.0, abs=40.0)


@pytest.mark.parametrize(("turned_deg", "kind"), [(120.0, "course_change"), (200.0, "turning_circle")])
def test_a_turn_too_short_without_an_approach_is_left_out_with_the_reason(turned_deg: float, kind: str) -> None:
    runs, left_out = steered(sail_circle(Craft(), 20.0, turned_deg, 1, 0.0).table)
    assert runs == []
    assert [each.kind for each in left_out] == [kind]
    assert "no approach" in left_out[0].why


def test_two_swings_are_left_out_with_the_reason() -> None:
    runs, left_out = steered(sail_zigzag(Craft(), 2, 20.0, 20.0, 1, 20.0).table)
    assert runs == []
    assert ["zigzag" in each.kind and "less than 3" in each.why for each in left_out] == [True]


def test_a_recording_with_nothing_in_it_says_why() -> None:
    sailed = sail_circle(Craft(), 20.0, 560.0, 1, 60.0)
    still = sailed.table.iloc[:150].assign(surge_mps=0.01, north_m=0.0, east_m=0.0, propeller_rpm=0.0)
    still.attrs = sailed.table.attrs
    runs, left_out = find_manoeuvres_and_left_out(still)
    assert runs == ()
    assert [each.kind for each in left_out] == ["manoeuvre"]


def test_helm_by_propellers_is_named_and_is_no_rudder_of_the_standard() -> None:
    craft = Craft(actuators=PROPELLERS)
    (run,), _ = steered(sail_zigzag(craft, 5, 20.0, 20.0, 1, 20.0).table)
    assert run.name == "zigzag 20/20 by thrust"
    assert run.settings["port_less_starboard_rpm"] > 0.0
    assert run.helm_deg is None
    assert not any(row.criterion for row in index_rows([run]))


@pytest.mark.parametrize(
    ("names", "sides"),
    [
        (("port", "starboard"), 2), (("n1", "n2"), 2), (("port_outer", "port_inner", "starboard"), 3),
        (("fore", "middle", "aft"), 0), (("portable",), 0),
    ],
)  # fmt: skip
def test_propellers_steer_if_they_are_to_both_sides(names: tuple[str, ...], sides: int) -> None:
    assert sum(map(len, drives_by_side(tuple(Actuator(name, "propeller") for name in names)))) == sides


def test_a_pair_set_alike_steers_nothing() -> None:
    craft = replace(Craft(), actuators=PROPELLERS)
    runs, _ = steered(sail_circle(craft, 0.0, 360.0, 1, 20.0).table.iloc[:600])
    assert runs == []


def test_a_table_that_names_no_ship_is_steered_by_what_its_columns_tell() -> None:
    table = sail_zigzag(Craft(actuators=PROPELLERS), 5, 20.0, 20.0, 1, 20.0).table
    table.attrs = {}
    (run,), _ = steered(table)
    assert run.name == "zigzag 20/20 by thrust"
