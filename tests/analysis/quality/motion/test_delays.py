"""Delays of slow, noisy records: no bias by how the noise of slopes is told, and what is taken off unasked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import angle_difference
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.findings import check_motion, independent_groups
from seatrial.analysis.quality.motion.fit import fit_kinematics
from seatrial.analysis.quality.motion.model import motion_of
from tests.analysis.quality.motion.kinematic_trials import Faults, sailed
from tests.benchmarks.delay_trials import DELAYS, SPEEDS, Recorded, recorded
from tests.conftest import nightly


def delays_found(table: pd.DataFrame) -> list[Finding]:
    return [each for each in check_motion(table).findings if each.code == "channel_delay"]


def large_ship(position_m: float, speeds: str = SPEEDS[0], late_s: float = 0.1) -> Recorded:
    """A ship of 200 m in zigzags of three hours, at 1 Hz, whose heading is a little late."""
    return Recorded(
        200.0,
        1.0,
        "zigzag_20_20",
        10800.0,
        speeds,
        position_m,
        0.02,
        0.005,
        0.02,
        np.array([0.0, late_s, 0.0, 0.0]),
    )


def small_boat(manoeuvre: str, rate_hz: float, speeds: str, late_s: Floats) -> Recorded:
    """A boat of 4 m for forty minutes, with little noise."""
    return Recorded(4.0, rate_hz, manoeuvre, 2400.0, speeds, 0.05, 0.05, 0.01, 0.02, late_s)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *nightly(1, 2, 3)])
def test_positions_of_a_large_ship_that_scatter_make_no_delay(seed: int) -> None:
    how = large_ship(0.5)
    table = recorded(how, seed, np.random.default_rng(seed))
    fit = fit_kinematics(table)
    for name, true in zip(DELAYS, how.delays_s, strict=True):
        low, high = fit.interval(name)
        assert low <= true <= high
        assert abs(fit.value(name) - true) < 0.3
    assert not delays_found(table)


@pytest.mark.slow
def test_noise_of_positions_alone_does_not_move_the_estimate() -> None:
    """Slopes without noise of their own are no less reliable for being sampled slowly: attenuation is none."""
    quiet, noisy = (recorded(large_ship(size), 0, np.random.default_rng(0)) for size in (0.001, 0.5))
    first, second = fit_kinematics(quiet), fit_kinematics(noisy)
    for name in DELAYS:
        assert abs(first.value(name) - second.value(name)) < 0.2


def test_turns_that_begin_between_two_samples_make_no_delay() -> None:
    """A boat of 4 m turns by 15 deg in 2 s: her headings are right, though the yaw rate tells of it too late."""
    how = small_boat("turning_circle_20", 0.5, SPEEDS[1], np.zeros(4))
    table = recorded(how, 1, np.random.default_rng(1))
    heading = motion_of(table).heading.levels[:, 0]
    assert np.abs(angle_difference(np.rad2deg(heading), table["heading_deg"].to_numpy())).max() < 0.01
    fit = fit_kinematics(table)
    assert abs(fit.value("position_delay_s")) < 0.1
    assert abs(fit.value("heading_delay_s")) < 0.15


@pytest.mark.parametrize("late", [0, *nightly(2)])
def test_late_channels_of_a_boat_that_swings_fast_do_not_settle_a_swing_off(late: int) -> None:
    how = small_boat("zigzag_20_20", 5.0, SPEEDS[0], np.where(np.arange(4) == late, 2.5, 0.0))
    fit = fit_kinematics(recorded(how, 2, np.random.default_rng(2)))
    for name, true in zip(DELAYS, how.delays_s, strict=True):
        low, high = fit.interval(name)
        assert low <= true <= high
        assert abs(fit.value(name) - true) < 1.0


def test_noise_of_the_heading_does_not_look_like_heel() -> None:
    """The path and the centripetal acceleration have the noise of the same headings."""
    how = replace(large_ship(0.15), manoeuvre="zigzag_10_10", heading_deg=0.47)
    table = recorded(how, 3, np.random.default_rng(3))
    low, high = fit_kinematics(table).interval("heel_s2")
    assert low <= 0.0 <= high
    assert not delays_found(table)


def test_a_delay_is_taken_off_only_beyond_two_samples() -> None:
    small, large = (delays_found(sailed(Faults(late_s={"north_m": seconds}))) for seconds in (0.8, 1.4))
    assert [each.certain for each in (*small, *large)] == [False, True]
    assert "two of its samples" in small[0].as_json()["text"]


def test_a_delay_of_half_the_recording_is_not_taken_off() -> None:
    late, sound = sailed(Faults(late_s={"heading_deg": 2.0})), sailed()
    half = len(sound) // 2
    table = pd.concat([late.iloc[:half], sound.iloc[half:]])
    assert not any(each.certain for each in delays_found(table))


@pytest.mark.parametrize(
    ("sources", "independent"),
    [
        ({}, {"north_m", "heading_deg", "surge_mps", "yaw_rate_dps"}),
        ({"yaw_rate_dps": ["table derived from heading_deg"]}, {"north_m", "surge_mps"}),
        ({"surge_mps": ["gps/GP:VTG derived"]}, {"yaw_rate_dps"}),
        ({"surge_mps": ["table derived from north_m, east_m and heading_deg"]}, {"yaw_rate_dps"}),
        ({"north_m": ["gps/GP:GGA derived"], "surge_mps": ["gps/GP:VBW"]}, {"yaw_rate_dps"}),
        ({"north_m": ["gps/GP:GGA derived"], "surge_mps": ["log/VD:VBW"]},
         {"north_m", "heading_deg", "surge_mps", "yaw_rate_dps"}),
        ({"north_m": ["bus/3:129025 derived"], "surge_mps": ["bus/9:130578"]},
         {"north_m", "heading_deg", "surge_mps", "yaw_rate_dps"}),
    ],
)  # fmt: skip
def test_what_is_derived_confirms_no_delay(sources: dict[str, list[str]], independent: set[str]) -> None:
    table = sailed()
    table.attrs["sources"] = sources
    assert independent_groups(table) == independent


def test_a_delay_against_derived_speeds_is_left() -> None:
    table = sailed(Faults(late_s={"north_m": 2.0}))
    table.attrs["sources"] = {"surge_mps": ["gps/GP:VTG derived"]}
    (finding,) = delays_found(table)
    assert not finding.certain
    assert "derived" in finding.remedy


def test_an_antenna_that_looks_late_at_a_steady_speed_is_not_moved() -> None:
    table = sailed(Faults(forward_m=-9.0, starboard_m=-2.0), rate_hz=1.0, turning=0.3, speed_changes=0.0)
    assert not any(each.certain for each in delays_found(table))
