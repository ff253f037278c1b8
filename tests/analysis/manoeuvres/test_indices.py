"""Indices against the noise-free truth, on an oracle, under rotation, translation and mirror, and in JSON."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import wrap_180, wrap_360
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.kinds import _COUNTED_FOR, REMOVED, circle_indices, zigzag_indices
from seatrial.analysis.manoeuvres.measures import bootstrap_index_intervals, peak_time_and_height
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from tests.analysis.conftest import table_at
from tests.analysis.manoeuvres.conftest import Sail


def circle(radius_m: float, rate_dps: float, drift_mps: tuple[float, float], turn_deg: float = 900.0) -> Motion:
    """A ship that goes straight north and then turns to starboard on a circle at once, on water that drifts."""
    time_s = np.arange(0.0, 60.0 + turn_deg / rate_dps, 0.5)
    heading = np.clip((time_s - 30.0) * rate_dps, 0.0, turn_deg)
    angle, speed = np.deg2rad(heading), np.deg2rad(rate_dps) * radius_m
    straight = speed * np.minimum(time_s - 30.0, 0.0)
    north = straight + radius_m * np.sin(angle) + drift_mps[0] * time_s
    east = radius_m * (1.0 - np.cos(angle)) + drift_mps[1] * time_s
    helm = np.where((time_s > 30.0) & (heading < turn_deg), -15.0, 0.0)
    table = table_at(time_s, {
        "north_m": north, "east_m": east, "heading_deg": wrap_360(heading),
        "surge_mps": speed + drift_mps[0] * np.cos(angle) + drift_mps[1] * np.sin(angle),
        "sway_mps": drift_mps[1] * np.cos(angle) - drift_mps[0] * np.sin(angle),
        "yaw_rate_dps": np.gradient(heading, time_s), "wind_direction_deg": 0.0 * time_s,
        "wind_speed_mps": 0.0 * time_s, "port_rpm": 150.0 + 0.0 * time_s, "port_angle_deg": helm,
        "starboard_rpm": 150.0 + 0.0 * time_s, "starboard_angle_deg": helm, "tunnel_rpm": 0.0 * time_s,
    })  # fmt: skip
    return motion_of(table)


def test_a_perfect_circle_has_the_indices_of_geometry() -> None:
    values = circle_indices(circle(80.0, 3.0, (0.0, 0.0)), np.array([30.0, 329.0]))
    for name in ("advance_m", "transfer_m"):
        assert values[name] == pytest.approx(80.0, abs=0.7)
    for name in ("tactical_diameter_m", "steady_diameter_m"):
        assert values[name] == pytest.approx(160.0, abs=0.7)
    assert values["steady_yaw_rate_dps"] == pytest.approx(3.0, abs=0.01)
    assert values["time_to_90_deg_s"] == pytest.approx(30.0, abs=0.3)
    assert values["drift_angle_deg"] == pytest.approx(0.0, abs=0.2)


def test_every_distance_less_the_current_says_for_how_long_the_drift_went_into_it() -> None:
    """Else its interval lacks the error of the drift; the first ten degrees are over before it counts, and a steady
    diameter is speed over rate."""
    values = circle_indices(circle(80.0, 3.0, (0.2, 0.1)), np.array([30.0, 329.0]))
    distances = {name for name in values if name.endswith("_m") and name + REMOVED in values}
    assert distances == set(_COUNTED_FOR) | {"initial_turning_m", "steady_diameter_m"}
    assert set(_COUNTED_FOR.values()) <= set(values)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_a_current_is_found_and_taken_off(north_mps: float, east_mps: float) -> None:
    values = circle_indices(circle(80.0, 3.0, (north_mps, east_mps)), np.array([30.0, 329.0]))
    assert values["tactical_diameter_m_current_removed"] == pytest.approx(160.0, abs=1.0)
    assert values["advance_m_current_removed"] == pytest.approx(80.0, abs=1.0)
    assert values["tactical_diameter_m"] == pytest.approx(160.0 + 60.0 * east_mps, abs=1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("lasting_s", [60.0, 150.0])
def test_the_interval_of_a_circle_less_the_current_holds_what_she_did_in_still_water(
    side: float, lasting_s: float
) -> None:
    """A large ship still loses way in her first turn: what lies between points one turn apart is not all drift."""
    fine_s, drift = np.arange(0.0, 1500.0, 0.1), np.array([0.35, -0.3])
    since = np.clip(fine_s - 300.5, 0.0, 1150.0)  # the helm goes over between two rows
    turned = np.cumsum(0.1 * side * 0.48 * (1.0 - np.exp(-since / 15.0)))
    way = np.cumsum(0.1 * (1.8 + 3.2 * np.exp(-since / lasting_s)) * np.exp(1j * np.deg2rad(turned)))
    truth = way - way[3005]
    time_s, heading, still, since = (values[::10] for values in (fine_s, turned, way, since))
    noise = np.random.default_rng(2).standard_normal((3, time_s.size))
    table = table_at(time_s, {
        "north_m": still.real + drift[0] * time_s + 0.3 * noise[0],
        "east_m": still.imag + drift[1] * time_s + 0.3 * noise[1],
        "heading_deg": wrap_360(heading + 0.05 * noise[2]),
        "rudder_angle_deg": np.where((since > 0.0) & (since < 1150.0), 35.0 * side, 0.0),
    })  # fmt: skip
    table.attrs["trial"] = {"antenna_forward_m": 0.0, "antenna_starboard_m": 0.0}
    (found,) = (each for each in find_manoeuvres(table, 180.0) if each.kind == "turning_circle")
    quarter, half = (int(np.argmax(np.abs(turned) >= angle)) for angle in (90.0, 180.0))
    for name, way in (("advance_m", truth[quarter].real), ("transfer_m", side * truth[quarter].imag),
                      ("tactical_diameter_m", side * truth[half].imag)):  # fmt: skip
        index = found.indices[f"{name}_current_removed"]
        assert index.low <= way <= index.high
        assert index.high - index.low < 0.1 * way


def turned(motion: Motion, angle_deg: float, north_m: float, east_m: float) -> Motion:
    """The same motion in a plane turned and moved."""
    angle = np.deg2rad(angle_deg)
    return replace(
        motion,
        north_m=motion.north_m * np.cos(angle) - motion.east_m * np.sin(angle) + north_m,
        east_m=motion.north_m * np.sin(angle) + motion.east_m * np.cos(angle) + east_m,
        heading_deg=motion.heading_deg + angle_deg,
    )


@example(32.3, 0.0, 0.0)
@settings(max_examples=25, deadline=None)
@given(st.floats(-720.0, 720.0), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_indices_of_a_circle_do_not_know_where_north_is(angle_deg: float, north_m: float, east_m: float) -> None:
    motion, span = circle(80.0, 3.0, (0.2, -0.1)), np.array([30.0, 329.0])
    plain, moved = circle_indices(motion, span), circle_indices(turned(motion, angle_deg, north_m, east_m), span)
    assert moved.keys() == plain.keys()
    for name, value in plain.items():
        assert moved[name] == pytest.approx(value, abs=1e-5), name


def rotated(table: pd.DataFrame, angle_deg: float) -> pd.DataFrame:
    angle, north, east = np.deg2rad(angle_deg), table["north_m"], table["east_m"]
    return table.assign(
        north_m=north * np.cos(angle) - east * np.sin(angle),
        east_m=north * np.sin(angle) + east * np.cos(angle),
        heading_deg=wrap_360(table["heading_deg"] + angle_deg),
    )


def mirrored(table: pd.DataFrame) -> pd.DataFrame:
    """Port for starboard."""
    return table.assign(
        east_m=-table["east_m"], heading_deg=wrap_360(-table["heading_deg"]), sway_mps=-table["sway_mps"],
        yaw_rate_dps=-table["yaw_rate_dps"], tunnel_rpm=-table["tunnel_rpm"],
        port_rpm=table["starboard_rpm"], starboard_rpm=table["port_rpm"],
        port_angle_deg=wrap_180(-table["starboard_angle_deg"]),
        starboard_angle_deg=wrap_180(-table["port_angle_deg"]),
    )  # fmt: skip


def reversed_drives(table: pd.DataFrame) -> pd.DataFrame:
    """The same thrust by drives that look aft and pull: the angle about 180 deg, the shaft astern."""
    return table.assign(**{
        f"{side}_{what}": -table[f"{side}_rpm"] if what == "rpm" else wrap_180(table[f"{side}_angle_deg"] + 180.0)
        for side in ("port", "starboard") for what in ("rpm", "angle_deg")})  # fmt: skip


@pytest.mark.parametrize("manoeuvre", ["zigzag_20_20", "turning_circle_30"])
def test_the_same_ship_elsewhere_mirrored_or_with_drives_that_look_aft(sail: Sail, manoeuvre: str) -> None:
    """Headings pass through north on the way, azimuths through 180 deg."""
    table = sail("gunnerus_short", "calm", manoeuvre, 260.0).recorded
    (plain,) = (each for each in find_manoeuvres(table) if each.kind != "speed_run")
    for other in (rotated(table, 359.0), rotated(table, 181.0), mirrored(table), reversed_drives(table)):
        (found,) = (each for each in find_manoeuvres(other) if each.kind != "speed_run")
        assert found.kind == plain.kind
        assert abs((found.start - plain.start).total_seconds()) < 0.2
        for name, index in plain.indices.items():
            within = 0.5 * (index.high - index.low)
            assert found.indices[name].value == pytest.approx(index.value, abs=max(0.35 * within, 0.02)), name
    (swapped,) = (each for each in find_manoeuvres(mirrored(table)) if each.kind != "speed_run")
    assert {plain.side, swapped.side} == {"port", "starboard"}
    for name in (name for name in plain.indices if name.startswith("overshoot")):
        own, other = plain.indices[name], swapped.indices[name]
        assert (other.low, other.high) == pytest.approx((own.low, own.high), abs=1e-6), name


def agreement(trial: Manoeuvre, truth: Manoeuvre) -> list[bool]:
    """Whether each index of the truth lies in the interval of the trial."""
    pairs = [(trial.indices[name], index) for name, index in truth.indices.items() if name in trial.indices]
    return [own.low <= index.value <= own.high for own, index in pairs if np.isfinite(own.low)]


TRIALS = [
    ("gunnerus_short", "calm", "zigzag_20_20", 300.0), ("gunnerus_long", "moderate", "zigzag_20_20", 300.0),
    ("gunnerus_long", "gentle", "turning_circle_20", 800.0), ("gunnerus_short", "calm", "turning_circle_30", 800.0),
]  # fmt: skip


def coverage(sail: Sail, trials: list[tuple[str, str, str, float]], seed: int = 1, every: int = 5) -> list[bool]:
    inside: list[bool] = []
    for vessel, sea, manoeuvre, duration_s in trials:
        sailed = sail(vessel, sea, manoeuvre, duration_s, seed, every)
        found, true = find_manoeuvres(sailed.recorded), find_manoeuvres(sailed.truth)
        for each in true:
            near = [own for own in found
                    if own.kind == each.kind and abs((own.start - each.start).total_seconds()) < 3.0]  # fmt: skip
            if each.kind != "speed_run":
                assert near, (manoeuvre, each.kind, each.start)
            if near:
                inside += agreement(near[0], each)
    return inside


def test_intervals_hold_the_truth(sail: Sail) -> None:
    inside = coverage(sail, TRIALS)
    assert len(inside) > 100
    assert np.mean(inside) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_intervals_hold_the_truth_in_whole_programmes(sail: Sail, seed: int) -> None:
    trials = [("gunnerus_short", "gentle", "programme", 3000.0),
              ("gunnerus_long", "moderate", "zigzag_10_10", 400.0),
              ("gunnerus_long", "calm", "voyage", 900.0)]  # fmt: skip
    inside = coverage(sail, trials, seed, every=10)
    assert np.mean(inside) > 0.88


def swinging(amplitude_deg: float, sigma_deg: float, seed: int) -> tuple[Motion, Floats]:
    """A heading that swings like a sine of 60 s, whose overshoots over half the amplitude are known."""
    time_s = np.arange(0.0, 240.0, 0.5)
    phase = 2.0 * np.pi * (time_s - 30.0) / 60.0
    swing = np.where(time_s > 30.0, amplitude_deg * np.sin(phase), 0.0)
    noise = np.random.default_rng(seed).normal(0.0, sigma_deg, time_s.size)
    none, ones = np.zeros(time_s.size), np.ones(time_s.size, dtype=bool)
    motion = Motion(0, time_s, 5.0 * time_s, none, swing + noise, none + 5.0, none, np.gradient(swing, time_s),
                    none, none, {"shaft_rpm": none}, {}, ones, ~ones)  # fmt: skip
    return motion, np.array([30.0, 35.0, 65.0, 95.0, 125.0, 155.0, 185.0])


def test_an_overshoot_is_not_biased_by_noise() -> None:
    """The largest of noisy samples would be too large by two standard deviations and more."""
    apart, naive = [], []
    for seed in range(12):
        motion, executes = swinging(20.0, 0.5, seed)
        found = bootstrap_index_intervals(motion, np.array([executes, executes]), 6.0, zigzag_indices, 0.25)
        apart.append(found["overshoot_mean_deg"][0] - 10.0)
        naive.append(peak_time_and_height(motion.time_s, motion.heading_deg, 35.0, 60.0)[1] - 20.0)
    assert abs(np.mean(apart)) < 0.12
    assert np.mean(naive) > 0.5


def test_every_value_of_the_json_is_plain_and_lengths_and_limits_need_a_length(sail: Sail) -> None:
    table = sail("gunnerus_short", "calm", "turning_circle_30", 800.0).recorded
    with_length, without = ([run.as_json() for run in find_manoeuvres(table, length)] for length in (28.9, None))
    json.dumps(with_length, allow_nan=False)
    assert set(with_length[0]) >= {"kind", "name", "start", "end", "side", "settings", "indices", "current"}
    circles = [next(each for each in found if each["kind"] == "turning_circle") for found in (with_length, without)]
    advance, bare = (each["indices"]["advance_m"] for each in circles)
    assert advance["lengths"] == pytest.approx(advance["value"] / 28.9)
    assert advance["limit"] == pytest.approx(4.5 * 28.9)
    assert bare["lengths"] is None
    assert bare["limit"] is None
    assert set(advance) == {
        "value", "low", "high", "unit", "lengths", "limit", "counted_from", "result", "missing",
    }  # fmt: skip
    assert (advance["counted_from"], advance["result"]) == ("order", "not_shown")
    assert advance["missing"] == ["the standards are for ships of 100 m and more, not 28.9 m"]
