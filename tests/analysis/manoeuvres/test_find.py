"""What was sailed is found, with its kind, side and settings; what was not is not."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import NAMES
from seatrial.analysis.manoeuvres.find import find_manoeuvres, find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.measures import find_plateaus, merge_corrections
from seatrial.analysis.tables.table import NANO, times_ns
from seatrial.hybrid.simulation.manoeuvres import Leg
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.conftest import steady_table, table_at
from tests.analysis.manoeuvres.conftest import Sail


def kinds(found: tuple[Manoeuvre, ...]) -> list[str]:
    return [each.kind for each in found]


@pytest.mark.parametrize(
    ("vessel", "sea", "azimuth", "switch"),
    [
        ("gunnerus_short", "calm", 10, 10),
        ("gunnerus_long", "moderate", 20, 20),
        ("gunnerus_long", "gentle", 10, 20),
    ],
)
def test_a_zigzag_is_one_zigzag_with_its_angles(
    sail: Sail, vessel: str, sea: str, azimuth: int, switch: int
) -> None:
    (found,) = find_manoeuvres(sail(vessel, sea, f"zigzag_{azimuth}_{switch}", 300.0).recorded)
    assert (found.kind, found.side, found.name) == ("zigzag", "port", f"zigzag {azimuth}/{switch}")
    assert found.settings["azimuth_deg"] == pytest.approx(azimuth, abs=0.5)
    assert found.settings["switch_deg"] == pytest.approx(switch, abs=1.5)


@pytest.mark.parametrize(
    ("vessel", "sea", "azimuth"), [("gunnerus_short", "calm", 30), ("gunnerus_long", "gentle", 20)]
)
def test_turning_circles_to_both_sides(sail: Sail, vessel: str, sea: str, azimuth: int) -> None:
    found = find_manoeuvres(sail(vessel, sea, f"turning_circle_{azimuth}", 800.0).recorded)
    circles = [each for each in found if each.kind == "turning_circle"]
    assert [each.side for each in circles][:2] == ["port", "starboard"]
    assert [each.settings["azimuth_deg"] for each in circles][:2] == pytest.approx([azimuth, -azimuth], abs=0.5)
    assert set(kinds(found)) <= {"turning_circle", "speed_run"}


def test_a_manoeuvre_starts_at_the_order(sail: Sail) -> None:
    """The trial steers for 30 s before the first turn."""
    trial = sail("gunnerus_long", "gentle", "turning_circle_20", 800.0)
    circle = next(each for each in find_manoeuvres(trial.recorded) if each.kind == "turning_circle")
    helm = trial.truth["port_angle_deg"].to_numpy()
    half_s = 0.1 * (300 + np.flatnonzero(np.abs(helm[300:]) > 10.0)[0])
    order_s = (circle.start - trial.recorded.index[0]).total_seconds()
    assert order_s == pytest.approx(30.0, abs=0.4)
    assert order_s + circle.settings["half_command_s"] == pytest.approx(half_s, abs=0.2)


def test_speed_runs_are_paired_and_give_speed_through_the_water_and_current(sail: Sail) -> None:
    trial = sail("gunnerus_short", "gentle", "reciprocal", 420.0)
    runs = [each for each in find_manoeuvres(trial.recorded) if each.kind == "speed_run"]
    pair = [each for each in runs if each.settings.get("reciprocal_pair") == 1.0]
    assert len(pair) == 2
    ahead = trial.current_mps[0] * np.cos(np.deg2rad(pair[0].settings["heading_deg"]))
    along = pair[0].indices["current_along_mps"]
    assert along.value == pytest.approx(ahead, abs=0.08)  # the wind does the rest
    water = [each.indices["speed_through_water_mps"].value for each in pair]
    assert water[0] == water[1]


def test_a_stop_at_whose_end_the_ship_still_makes_way_has_no_indices(sail: Sail) -> None:
    found, left_out = find_manoeuvres_and_left_out(sail("gunnerus_long", "calm", "stopping", 320.0).recorded)
    assert "stopping" not in kinds(found)
    stop = next(each for each in left_out if each.kind == "stopping")
    assert re.match(r"the ship still made [01]\.\d\d m/s", stop.why)


def test_a_slow_turn_is_no_speed_run() -> None:
    """A degree in nine seconds, for four minutes."""
    seconds = np.arange(240.0)
    turning = table_at(seconds, {name: np.zeros(240) for name in NAMES}).assign(
        heading_deg=seconds / 9.0, yaw_rate_dps=1.0 / 9.0, surge_mps=4.0, port_rpm=120.0, starboard_rpm=120.0
    )
    north, east = (np.cumsum(4.0 * wave(np.deg2rad(seconds / 9.0))) for wave in (np.cos, np.sin))
    found, left_out = find_manoeuvres_and_left_out(turning.assign(north_m=north, east_m=east))
    assert found == ()
    assert [(each.kind, each.why) for each in left_out] == [("speed_run", "the ship turned by 27 deg")]


def test_single_thrusters_and_the_tunnel_thruster(sail: Sail) -> None:
    found = find_manoeuvres(sail("gunnerus_short", "gentle", "one_thruster", 260.0).recorded)
    names = [each.name for each in found if each.kind == "thruster_test"]
    assert names[:2] == ["port thruster alone", "starboard thruster alone"]
    found = find_manoeuvres(sail("gunnerus_short", "calm", "tunnel_test", 200.0).recorded)
    tests = [each for each in found if each.kind == "thruster_test"]
    assert [(each.name, each.side) for each in tests] == [
        ("tunnel thruster to starboard", "starboard"), ("tunnel thruster to port", "port")]  # fmt: skip


def test_a_stop_by_thrust_astern_has_a_limit_for_its_track() -> None:
    ahead = Leg(rpm=171.0, at_least_s=60.0, at_most_s=60.0, course_deg=0.0)
    astern = Leg(rpm=-120.0, slower_mps=0.0, at_most_s=200.0)
    rest = Leg(rpm=0.0, at_least_s=60.0, at_most_s=60.0)
    table, _ = simulate_trial("gunnerus_short", "calm", (ahead, astern, rest), 150.0, 2.0, 1)
    (stop,) = (each for each in find_manoeuvres(table, 28.9) if each.kind == "stopping")
    assert stop.name == "stopping with thrust astern"
    assert (stop.start - table.index[0]).total_seconds() == pytest.approx(60.0, abs=0.6)
    assert stop.indices["final_speed_mps"].value == pytest.approx(0.0, abs=0.25)
    assert stop.indices["track_reach_m"].limit == pytest.approx(15.0 * 28.9)


def test_a_current_is_what_was_put_in() -> None:
    hidden = {"ocean_current": {"speed_mps": 0.4, "direction_deg": 60.0}}
    table, _ = simulate_trial("gunnerus_short", "calm", "turning_circle_30", 300.0, 2.0, 1, hidden)
    circle = next(each for each in find_manoeuvres(table) if each.kind == "turning_circle")
    assert circle.current is not None
    north, east = 0.4 * np.cos(np.deg2rad(60.0)), 0.4 * np.sin(np.deg2rad(60.0))
    assert circle.current.north_mps == pytest.approx(north, abs=0.01)
    assert circle.current.east_mps == pytest.approx(east, abs=0.01)
    assert circle.current.as_json()["direction_deg"] == pytest.approx(60.0, abs=1.5)


def test_a_programme_holds_each_kind_and_invents_no_zigzag(sail: Sail) -> None:
    found = find_manoeuvres(sail("gunnerus_short", "moderate", "programme", 3000.0).recorded)
    zigzags = [each.name for each in found if each.kind == "zigzag"]
    assert zigzags == ["zigzag 20/20"] * 4 + ["zigzag 10/10"]
    assert kinds(found).count("turning_circle") == 2
    assert "speed_run" in kinds(found)


def test_a_straight_voyage_holds_no_manoeuvre_but_a_speed_run() -> None:
    table = steady_table(600, noise_rpm=0.3, noise_deg=0.2)
    table = table.assign(port_angle_deg=0.0, starboard_angle_deg=0.0, heading_deg=40.0, surge_mps=5.0, sway_mps=0.0)
    seconds = np.arange(600.0)
    course = np.deg2rad(40.0)
    table = table.assign(north_m=5.0 * np.cos(course) * seconds, east_m=5.0 * np.sin(course) * seconds,
                         yaw_rate_dps=0.0, tunnel_rpm=0.0)  # fmt: skip
    (run,) = find_manoeuvres(table, length_m=30.0)
    assert run.kind == "speed_run"
    assert run.indices["speed_over_ground_mps"].value == pytest.approx(5.0)
    assert run.indices["distance_m"].lengths == pytest.approx(5.0 * 599 / 30.0)


def test_a_ship_at_rest_does_nothing() -> None:
    table = table_at(np.arange(300.0), {name: np.zeros(300) for name in NAMES})
    assert find_manoeuvres(table) == ()


def test_a_table_without_a_heading_is_refused() -> None:
    with pytest.raises(InputError, match="heading_deg"):
        find_manoeuvres(steady_table(60).drop(columns="heading_deg"))


def test_a_cut_in_a_recording_ends_a_zigzag(sail: Sail) -> None:
    """Where a piece is missing, position and heading jump while the speeds do not."""
    table = sail("gunnerus_short", "calm", "zigzag_20_20", 300.0).recorded
    times = times_ns(table)
    keep = np.r_[0:280, 345:600]
    cut = table.iloc[keep].set_axis(table.index[: keep.size], axis=0)
    assert times.size == 600
    found = find_manoeuvres(cut)
    at = table.index[280]
    assert len(found) == 2
    assert not any(each.start < at < each.end for each in found)


def test_marks_name_a_manoeuvre_and_let_a_short_one_count(sail: Sail) -> None:
    table = sail("gunnerus_short", "calm", "zigzag_20_20", 300.0).recorded.iloc[:56]
    assert "zigzag" not in kinds(find_manoeuvres(table))
    start = int(times_ns(table)[0])
    events = [(start, "zigzag run 3 start"), (start + 28 * NANO, "zigzag run 3 end")]
    (found,) = find_manoeuvres(table, events=events)
    assert (found.kind, found.name) == ("zigzag", "zigzag run 3")


def test_kinds_do_not_depend_on_the_order_of_rows_or_on_holes(sail: Sail) -> None:
    table = sail("gunnerus_short", "calm", "zigzag_10_10", 300.0).recorded
    holes = table.copy()
    holes.iloc[100:103, :6] = np.nan
    shuffled = holes.iloc[np.random.default_rng(0).permutation(len(holes))]
    (found,) = find_manoeuvres(pd.DataFrame(shuffled))
    assert found.kind == "zigzag"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_hand_that_goes_too_far_and_comes_back_gives_one_order(side: float) -> None:
    """Five seconds at a helm larger by a sixth part no order; twice the helm, or the other side, is another."""
    helm = side * np.repeat([0.0, 11.7, 10.0, -11.7, -10.0, -20.0], [20, 10, 60, 10, 60, 60])
    held = [each for each in find_plateaus(helm, 0.5, 1.0) if each.level]
    joined = merge_corrections(held, 0.5)
    assert len(held) == 5
    assert [each.level * side for each in joined] == [10.0, -10.0, -20.0]
    assert [each.first for each in joined] == [held[0].first, held[2].first, held[4].first]
    assert joined[0].end == held[1].end
