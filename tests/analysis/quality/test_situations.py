"""A ship that is held or towed is recognised by physics, whatever the noise; a free one never is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from seatrial.acquisition.core.quantities import Floats, to_earth
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.situations import TOWED_S, Situation, find_situations
from seatrial.analysis.windows.held import held_windows
from tests.analysis.conftest import START_S, table_at

NOISE = {"north_m": 0.05, "east_m": 0.05, "heading_deg": 0.1, "surge_mps": 0.03, "sway_mps": 0.03,
         "yaw_rate_dps": 0.05, "port_rpm": 0.3, "starboard_rpm": 0.3, "tunnel_rpm": 0.3, "port_angle_deg": 0.2,
         "starboard_angle_deg": 0.2, "wind_direction_deg": 3.0, "wind_speed_mps": 0.2}  # fmt: skip
SAIL_S, HELD_S = 300, 600


def recorded(
    surge: ArrayLike, sway: ArrayLike = 0.0, heading_deg: ArrayLike = 40.0, rpm: ArrayLike = 0.0,
    *, angle_deg: ArrayLike = 0.0, noise: float = 1.0, seed: int = 0,
) -> pd.DataFrame:  # fmt: skip
    """A recording at 1 Hz of a motion over ground, with sensors of ``noise`` times the usual ones."""
    surge, sway, heading, rpm, angle = map(
        np.asarray, np.broadcast_arrays(surge, sway, heading_deg, rpm, angle_deg)
    )
    random = np.random.default_rng(seed)
    north, east = (np.cumsum(speed) for speed in to_earth(surge, sway, np.deg2rad(heading)))
    true: Mapping[str, Floats] = {
        "north_m": north, "east_m": east, "heading_deg": heading, "surge_mps": surge, "sway_mps": sway,
        "yaw_rate_dps": np.gradient(heading), "wind_direction_deg": np.full(surge.size, 90.0),
        "wind_speed_mps": np.full(surge.size, 5.0), "port_rpm": rpm, "port_angle_deg": angle,
        "starboard_rpm": rpm, "starboard_angle_deg": angle, "tunnel_rpm": np.zeros(surge.size),
    }  # fmt: skip
    columns = {
        name: values + noise * NOISE[name] * random.standard_normal(surge.size) for name, values in true.items()
    }
    columns["heading_deg"] %= 360.0
    return table_at(np.arange(surge.size), columns)


def voyage_with_stay(rpm: ArrayLike, noise: float = 1.0, seed: int = 0, stay_s: int = HELD_S) -> pd.DataFrame:
    """Sailing, lying still while the thrusters do as ``rpm`` says, and sailing again."""
    surge = np.concatenate([np.full(SAIL_S, 2.0), np.zeros(stay_s), np.full(SAIL_S, 2.0)])
    setting = np.concatenate([np.full(SAIL_S, 90.0), np.broadcast_to(rpm, stay_s), np.full(SAIL_S, 90.0)])
    heading = 40.0 + np.where(surge > 0.0, 20.0 * np.sin(np.arange(surge.size) / 30.0), 0.0)
    return recorded(surge, 0.0, heading, setting, noise=noise, seed=seed)


def seconds_of(situation: Situation) -> tuple[float, float]:
    return situation.start_ns / 1e9 - START_S, situation.end_ns / 1e9 - START_S


CREW = np.repeat([0.0, 60.0, -40.0, 0.0, 80.0], HELD_S // 5)
"""A crew that tries the thrusters at the quay, every two minutes at another setting."""
WARPING = 150.0 * np.sin(2.0 * np.pi * np.arange(HELD_S) / 200.0)
"""Thrusters worked hard ahead and astern without a pause, as to come off a bank."""


@pytest.mark.parametrize("rpm", [0.0, 60.0, CREW, WARPING], ids=["idle", "constant", "crew", "warping"])
def test_ship_that_lies_still_whatever_its_thrusters_do_is_held(rpm: ArrayLike) -> None:
    (held,) = find_situations(voyage_with_stay(rpm))
    assert held.kind == "ship_held"
    assert seconds_of(held) == pytest.approx((SAIL_S, SAIL_S + HELD_S), abs=10.0)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.1, 5.0), st.integers(0, 1000), st.sampled_from([0.0, 60.0]))
def test_edges_of_a_stay_are_found_within_seconds_whatever_the_noise(noise: float, seed: int, rpm: float) -> None:
    (held,) = find_situations(voyage_with_stay(rpm, noise, seed))
    assert seconds_of(held) == pytest.approx((SAIL_S, SAIL_S + HELD_S), abs=20.0)


def test_ship_on_slack_lines_is_held() -> None:
    at_s = np.arange(1800)
    surge = 0.03 * np.sin(2.0 * np.pi * at_s / 70.0)  # 0.7 m to and fro
    heading = 40.0 + 1.5 * np.sin(2.0 * np.pi * at_s / 110.0)
    (held,) = find_situations(recorded(surge, 0.0, heading))
    assert held.seconds > 1700.0


def test_receiver_that_wanders_at_the_quay_does_not_hide_a_stay() -> None:
    table, random = voyage_with_stay(0.0, stay_s=1800), np.random.default_rng(1)
    for name in ("north_m", "east_m"):  # 0.7 m with a memory of two minutes, as without corrections
        steps = 0.7 * np.sqrt(2.0 / 120.0) * random.standard_normal(len(table))
        table[name] += pd.Series(steps).ewm(alpha=1.0 / 120.0, adjust=False).mean().to_numpy() * 120.0
    assert sum(situation.seconds for situation in find_situations(table)) > 1500.0


@pytest.mark.parametrize("length_m", [10.0, 30.0, 100.0, 300.0])
@pytest.mark.parametrize("wind_mps", [4.0, 10.0])
@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_ship_on_dynamic_positioning_is_free(length_m: float, wind_mps: float, noise: float) -> None:
    """A point mass in a gusty wind, its thrust from position and speed, with the power of ships of its length."""
    random = np.random.default_rng(3)
    tonnes = 8.0e-3 * length_m**3
    full_mps2 = np.interp(length_m, [10.0, 30.0, 100.0, 300.0], [0.5, 0.2, 0.06, 0.012])
    frequency = 2.0 * np.pi / min(60.0 * np.sqrt(length_m / 30.0), 200.0)
    place, speed, integral, thrust, estimate, gust = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    rows = []
    for _ in range(1800):
        gust += -gust / 30.0 + np.sqrt(2.0 / 30.0) * 0.12 * random.standard_normal()
        estimate += -estimate / 20.0 + np.sqrt(2.0 / 20.0) * 0.1 * random.standard_normal()
        wind = 0.6e-3 * 0.06 * length_m**2 * (wind_mps * (1.0 + gust)) ** 2 / tonnes
        integral -= 0.1 * frequency**3 * (place + estimate)
        order = integral - frequency**2 * (place + estimate) - 1.8 * frequency * speed
        thrust += (order - thrust) / 5.0
        speed += wind + thrust
        place += speed
        rows.append((speed, thrust))
    speeds, thrusts = np.array(rows).T
    share = np.clip(thrusts / full_mps2, -1.0, 1.0)
    rpm = 240.0 * np.sign(share) * np.sqrt(np.abs(share))
    assert find_situations(recorded(0.0, speeds, 40.0, rpm, angle_deg=90.0, noise=noise)) == ()


@settings(max_examples=20, deadline=None)
@given(st.floats(0.03, 1.5), st.floats(0.0, 360.0), st.floats(0.1, 10.0))
def test_ship_adrift_with_idle_thrusters_is_free(speed: float, angle_deg: float, noise: float) -> None:
    surge, sway = speed * np.cos(np.deg2rad(angle_deg)), speed * np.sin(np.deg2rad(angle_deg))
    heading = 40.0 + 0.01 * np.arange(1500)
    assert find_situations(recorded(np.full(1500, surge), sway, heading, noise=noise)) == ()


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 9.0), st.floats(20.0, 8000.0))
def test_coasting_ship_is_free(speed: float, head_reach_constant_m: float) -> None:
    at_s = np.arange(1200)
    coasting = speed / (1.0 + speed * at_s / head_reach_constant_m)
    coasting = coasting[coasting > 0.03]  # slower, it is at rest
    surge = np.concatenate([np.full(SAIL_S, speed), coasting])
    rpm = np.concatenate([np.full(SAIL_S, 100.0), np.zeros(coasting.size)])
    assert find_situations(recorded(surge, 0.0, 40.0, rpm)) == ()


def test_slow_manoeuvres_of_a_tanker_are_free() -> None:
    at_s = np.arange(3000)
    heading = 40.0 + 10.0 * np.sin(2.0 * np.pi * at_s / 900.0)
    assert find_situations(recorded(1.0, 0.0, heading, 30.0)) == ()
    # 0.25 MN on 300,000 t: dead slow ahead from rest
    assert find_situations(recorded(0.0008 * np.arange(1200), 0.0, 40.0, 30.0)) == ()


def test_moment_at_rest_between_manoeuvres_is_not_lost() -> None:
    assert find_situations(voyage_with_stay(0.0, stay_s=100)) == ()


def test_frozen_positions_under_way_are_no_mooring() -> None:
    table = recorded(np.full(1200, 3.0), 0.0, 40.0, 100.0)
    assert find_situations(table.assign(north_m=5.0, east_m=7.0)) == ()


def test_receiver_that_stopped_is_no_mooring() -> None:
    table = recorded(np.full(1200, 3.0), 0.0, 40.0, 100.0)
    assert find_situations(table.assign(north_m=5.0, east_m=7.0, surge_mps=0.0, sway_mps=0.0)) == ()


TOW = np.concatenate([np.full(SAIL_S, 3.0), np.linspace(0.0, 2.0, 300), np.full(1500, 2.0)])
IDLE_IN_TOW = np.where(np.arange(TOW.size) < SAIL_S, 100.0, 0.0)


def test_ship_that_makes_way_with_idle_thrusters_and_does_not_slow_down_is_towed() -> None:
    (towed,) = find_situations(recorded(TOW, 0.0, 40.0, IDLE_IN_TOW))
    assert towed.kind == "ship_towed"
    first, last = seconds_of(towed)
    assert SAIL_S <= first <= SAIL_S + 200.0
    assert last == pytest.approx(TOW.size, abs=30.0)
    assert last - first >= TOWED_S


def test_nothing_is_claimed_where_shafts_were_not_recorded_or_never_turned() -> None:
    table = recorded(TOW, 0.0, 40.0, IDLE_IN_TOW)
    table.attrs["trial"] = {"vessel": "gunnerus_long"}  # who has that shaft, too
    assert find_situations(table.drop(columns=["port_rpm"])) == ()
    assert find_situations(recorded(TOW, 0.0, 40.0, 0.0)) == ()
    still = recorded(np.zeros(900), 0.0, 40.0, 0.0)
    assert find_situations(still.drop(columns=["port_rpm", "starboard_rpm", "tunnel_rpm"])) == ()


def test_table_at_any_rate_gives_the_same_stay() -> None:
    table = voyage_with_stay(60.0)
    thinned = table.iloc[::2].copy()
    thinned.loc[thinned.index[::2], "port_rpm"] = np.nan
    for first, other in zip(
        map(seconds_of, find_situations(table)), map(seconds_of, find_situations(thinned)), strict=True
    ):
        assert first == pytest.approx(other, abs=10.0)


@pytest.mark.parametrize("keep_moving", [False, True])
def test_windows_of_a_held_ship_are_dropped_and_counted(keep_moving: bool) -> None:
    table = voyage_with_stay(60.0)
    windows = held_windows(table, 15, 5, keep_moving=keep_moving)
    (held,) = find_situations(table)
    span = pd.to_datetime([held.start_ns, held.end_ns], utc=True)
    starts = pd.DatetimeIndex(windows.rows["start"].unique())
    assert not ((starts >= span[0]) & (starts <= span[1])).any()
    assert windows.kept + sum(windows.dropped.values()) == windows.candidates
    assert windows.dropped["ship_held"] == pytest.approx(HELD_S / 5, abs=6)


def test_check_reports_a_stay_with_its_time_and_blames_no_channel() -> None:
    quality = check_table(voyage_with_stay(60.0))
    (finding,) = (finding for finding in quality.findings if finding.code == "ship_held")
    assert "moored, anchored or aground" in finding.text
    assert "leave this time out" in finding.remedy
    assert finding.channel == "ship"
    assert finding.estimate["seconds"] == pytest.approx(HELD_S, abs=20.0)
    assert quality.channels["north_m"].grade == "good"
