"""The motion channels fitted to each other: what was put in comes out, and what nobody can tell stays open."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.quality.motion.fit import NAMES, Kinematics, fit_kinematics, remove_jumps
from seatrial.analysis.quality.motion.model import Group, group_samples, motion_of, outlier_mask
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed

NEUTRAL = np.array([1.0 if name.endswith("factor") else 0.0 for name in NAMES])


@pytest.fixture(scope="module")
def sound() -> Kinematics:
    return fit_kinematics(sailed())


def held(fit: Kinematics, name: str, truth: float, widened: float = 2.0) -> bool:
    """Whether an interval, as many times wider, holds the truth: 95 % of them hold it as they are."""
    low, high = fit.interval(name)
    return bool(abs(truth - 0.5 * (low + high)) <= widened * 0.5 * (high - low))


def test_a_sound_trial_agrees_with_itself(sound: Kinematics) -> None:
    assert all(held(sound, name, truth) for name, truth in zip(NAMES, NEUTRAL, strict=True))
    assert sound.standard_error("speed_factor") < 1e-3
    assert sound.standard_error("heading_offset_rad") < np.deg2rad(0.05)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    fits = [fit_kinematics(sailed(seed=seed, duration_s=600.0)) for seed in range(12)]
    inside = np.array(
        [[held(fit, name, truth, 1.0) for name, truth in zip(NAMES, NEUTRAL, strict=True)] for fit in fits]
    )
    assert inside.mean() > 0.9
    assert np.all(inside.mean(axis=0) >= 0.66)


@settings(max_examples=6, deadline=None)
@given(
    speed=st.floats(0.9, 1.1), heading=st.floats(-20.0, 20.0), late=st.floats(-2.0, 2.0),
    start=st.sampled_from([0.0, 90.0, 179.9, 359.9]), scale=st.floats(0.9, 1.1), bias=st.floats(-0.3, 0.3),
)  # fmt: skip
def test_faults_put_in_together_come_out_together(
    speed: float, heading: float, late: float, start: float, scale: float, bias: float
) -> None:
    faults = Faults(
        speed=speed, heading_deg=heading, late_s={"north_m": late}, yaw_rate=scale, yaw_rate_bias_dps=bias
    )  # fmt: skip
    fit = fit_kinematics(sailed(faults, duration_s=800.0, heading_deg=start))
    assert fit.value("speed_factor") == pytest.approx(1.0 / speed, abs=3e-3)
    assert np.rad2deg(fit.value("heading_offset_rad")) == pytest.approx(heading, abs=0.15)
    assert fit.value("position_delay_s") == pytest.approx(late, abs=0.1)
    assert fit.value("yaw_rate_factor") == pytest.approx(1.0 / scale, abs=0.01)
    assert np.rad2deg(fit.value("yaw_rate_bias_radps")) == pytest.approx(-bias / scale, abs=0.01)


@pytest.mark.parametrize(("group", "moved"), [
    ("north_m", (1.0, 0.0, 0.0)), ("heading_deg", (0.0, 1.0, 1.0)),
    ("surge_mps", (-1.0, -1.0, 0.0)), ("yaw_rate_dps", (0.0, 0.0, -1.0)),
])  # fmt: skip
def test_each_delay_shows_in_the_differences_it_should(group: str, moved: tuple[float, ...]) -> None:
    fit = fit_kinematics(sailed(Faults(late_s={group: 0.7})))
    for name, share in zip(("position_delay_s", "heading_delay_s", "heading_after_yaw_rate_s"), moved, strict=True):
        assert held(fit, name, 0.7 * share), name


def test_a_lever_arm_comes_out() -> None:
    fit = fit_kinematics(sailed(Faults(forward_m=3.0, starboard_m=-1.5)))
    assert held(fit, "forward_m", 3.0)
    assert held(fit, "starboard_m", -1.5)
    assert fit.standard_error("forward_m") < 0.5


def test_heel_in_turns_moves_an_antenna_and_is_no_delay() -> None:
    """An antenna 6 m further out for every m/s2 of centripetal acceleration: 15 m up, heeled 4 deg at 0.17 m/s2."""
    table = sailed()
    outward_m = -6.0 * table["surge_mps"] * np.deg2rad(table["yaw_rate_dps"])
    psi = np.deg2rad(table["heading_deg"])
    heeled = table.assign(
        north_m=table["north_m"] - outward_m * np.sin(psi), east_m=table["east_m"] + outward_m * np.cos(psi)
    )
    fit = fit_kinematics(heeled)
    assert held(fit, "heel_s2", -6.0)
    assert fit.standard_error("heel_s2") < 1.0
    assert all(held(fit, name, truth) for name, truth in zip(NAMES, NEUTRAL, strict=True) if name != "heel_s2")


def test_a_steady_ship_leaves_open_what_she_cannot_tell() -> None:
    """On a straight course at one speed nothing tells a late position from a lever arm or from nothing at all."""
    fit = fit_kinematics(sailed(turning=0.0, speed_changes=0.0, duration_s=600.0))
    assert fit.standard_error("speed_factor") < 2e-3
    assert all(held(fit, name, truth) for name, truth in zip(NAMES, NEUTRAL, strict=True))
    assert fit.standard_error("forward_m") > 3.0 * fit_kinematics(sailed(duration_s=600.0)).standard_error(
        "forward_m"
    )


def test_noise_is_taken_from_the_data() -> None:
    rough = Noise(position_m=0.5, heading_deg=0.5, speed_mps=0.1, yaw_rate_dps=0.2)
    fine, coarse = fit_kinematics(sailed()), fit_kinematics(sailed(noise=rough))
    assert all(held(coarse, name, truth) for name, truth in zip(NAMES, NEUTRAL, strict=True))
    assert np.all(coarse.selected.standard_errors > fine.selected.standard_errors)


def test_rates_times_and_gaps_of_their_own(sound: Kinematics) -> None:
    """Positions at 1 Hz, heading at 5 Hz between them, a gap of a minute: the same answer."""
    fast = sailed(rate_hz=10.0)
    fast.loc[fast.index[np.arange(len(fast)) % 10 != 3], ["north_m", "east_m"]] = np.nan
    fast.loc[fast.index[np.arange(len(fast)) % 2 != 0], "heading_deg"] = np.nan
    fit = fit_kinematics(fast.drop(fast.index[4000:4600]))
    assert all(held(fit, name, truth) for name, truth in zip(NAMES, NEUTRAL, strict=True))
    assert fit.blocks < sound.blocks


def test_spikes_and_a_heading_led_through_north_do_not_matter() -> None:
    table = sailed(heading_deg=0.0)
    generator = np.random.default_rng(1)
    for name, size in (("north_m", 50.0), ("surge_mps", 5.0), ("yaw_rate_dps", 30.0)):
        table.loc[table.index[generator.choice(len(table), 12, replace=False)], name] += size
    heading = table["heading_deg"].to_numpy().copy()
    through = np.flatnonzero(np.abs(np.diff(heading)) > 180.0)
    heading[through], heading[through + 1] = 120.0, 240.0
    fit = fit_kinematics(table.assign(heading_deg=heading))
    assert through.size > 10
    assert fit.value("speed_factor") == pytest.approx(1.0, abs=2e-3)
    assert fit.value("yaw_rate_factor") == pytest.approx(1.0, abs=5e-3)
    assert np.rad2deg(fit.value("heading_offset_rad")) == pytest.approx(0.0, abs=0.1)


def test_clocks_that_are_set_do_not_matter() -> None:
    """Positions that jump along the way and never come back: the steps between the jumps still tell the speed."""
    table = sailed(Faults(speed=0.98), noise=Noise(position_m=0.01))
    generator = np.random.default_rng(2)
    jumps = np.zeros(len(table))
    jumps[generator.choice(len(table), 60, replace=False)] = 5.5
    heading = np.deg2rad(table["heading_deg"])
    moved = table.assign(
        north_m=table["north_m"] + np.cumsum(jumps * np.cos(heading)),
        east_m=table["east_m"] + np.cumsum(jumps * np.sin(heading)),
    )
    assert fit_kinematics(moved).value("speed_factor") == pytest.approx(1.0 / 0.98, abs=2e-3)


def test_turning_the_chart_turns_nothing() -> None:
    """The answer does not depend on where north is."""
    table = sailed(Faults(speed=1.03, forward_m=2.0))
    turn = np.deg2rad(137.0)
    turned = table.assign(
        north_m=table["north_m"] * np.cos(turn) - table["east_m"] * np.sin(turn),
        east_m=table["north_m"] * np.sin(turn) + table["east_m"] * np.cos(turn),
        heading_deg=(table["heading_deg"] + 137.0) % 360.0,
    )
    first, second = fit_kinematics(table), fit_kinematics(turned)
    assert np.all(
        np.abs(first.selected.parameters - second.selected.parameters) < 2.0 * first.selected.standard_errors
    )


def test_the_covariance_is_one(sound: Kinematics) -> None:
    covariance = sound.selected.covariance
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-15)
    scale = np.sqrt(np.diag(covariance))  # seconds, metres, shares: by their own sizes
    assert (np.linalg.eigvalsh(covariance / np.outer(scale, scale)) > 0.0).all()


def test_too_little_is_refused() -> None:
    with pytest.raises(DataShortageError, match="record for longer"):
        fit_kinematics(sailed(duration_s=90.0))
    with pytest.raises(InputError, match="surge_mps"):
        fit_kinematics(sailed(duration_s=300.0).drop(columns="surge_mps"))


def test_values_written_again_and_again_are_one_sample() -> None:
    table = sailed(rate_hz=10.0, duration_s=100.0)
    held_values = table.assign(north_m=table["north_m"].to_numpy()[np.arange(len(table)) // 10 * 10],
                               east_m=table["east_m"].to_numpy()[np.arange(len(table)) // 10 * 10])  # fmt: skip
    samples = group_samples(held_values, ("north_m", "east_m"))
    assert samples.time_s.size == 100
    assert samples.interval_s == pytest.approx(1.0)


def test_what_rises_steadily_is_no_spike() -> None:
    ramp = np.concatenate([np.zeros(50), np.linspace(0.0, 500.0, 20), np.full(50, 500.0)])[:, np.newaxis]
    assert not outlier_mask(ramp + 0.01 * np.random.default_rng(0).standard_normal(ramp.shape)).any()


def test_means_over_a_step_shift_nothing() -> None:
    """At 20 Hz samples are averaged: a steady turn is read at the same times as before."""
    table = sailed(rate_hz=20.0, duration_s=60.0, noise=Noise(0.0, 0.0, 0.0, 0.0))
    motion = motion_of(table)
    seconds = (table.index - table.index[0]).total_seconds().to_numpy()
    expected = np.interp(motion.speed.time_s, seconds, table["surge_mps"].to_numpy())
    assert np.abs(motion.speed.levels[:, 0] - expected).max() < 5e-3


def test_rows_in_any_order_say_the_same() -> None:
    table = sailed(duration_s=400.0)
    shuffled = table.iloc[np.random.default_rng(0).permutation(len(table))]
    assert isinstance(shuffled, pd.DataFrame)
    assert fit_kinematics(shuffled).selected.parameters == pytest.approx(
        fit_kinematics(table).selected.parameters, abs=1e-9
    )


def test_a_heading_that_stands_still_while_the_ship_turns_is_no_crash() -> None:
    """Half of the steps in turns are none, so that their most frequent factor is zero, which has no slope."""
    grid_s = np.arange(2000.0)
    generator = np.random.default_rng(0)
    rate = np.where(grid_s < 1240.0, 0.0, 0.03) + 1e-4 * generator.standard_normal(grid_s.size)
    turned = np.cumsum(rate)
    heading = turned + 1e-4 * generator.standard_normal(grid_s.size)
    heading[1300:1680] = heading[1300]

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, bias, _ = values
        slopes = np.stack([turned / factor, grid_s, -factor * rate], axis=1)[..., np.newaxis]
        return (factor * turned + bias * grid_s)[:, np.newaxis], slopes

    level = Group(grid_s, heading[:, np.newaxis], 1.0)
    assert np.isfinite(remove_jumps(level, model, grid_s, np.array([1.0, 0.0, 0.0])).levels).all()
