"""Pull-outs, direct spirals and Williamson turns of simulated ships, against what their noise-free motion did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.hybrid.simulation.manoeuvres import Leg, helm_leg, pace_of, steer, usual_rpm
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import Vessel
from tests.benchmarks.manoeuvre_trials import vessel_of

SHIPS = [("kvlcc2_180m", 2.5), ("gunnerus_short", 20.0), ("esso_osaka_3m", 20.0)]
Found = tuple[list[Manoeuvre], np.ndarray, float]


def held(vessel: Vessel, helm_deg: float, share: float) -> Leg:
    """A helm for so many seconds of R/V Gunnerus' time."""
    seconds = share * pace_of(vessel).time
    return Leg(rpm=usual_rpm(vessel), helm_deg=helm_deg, at_least_s=seconds, at_most_s=seconds)


def sailed(vessel: Vessel, legs: tuple[Leg, ...], share: float, kind: str) -> Found:
    """The manoeuvres found of a kind, the true rate of turn at 2 Hz [deg/s], and the ship's time."""
    pace = pace_of(vessel)
    start = steer(0.0, 120.0 * pace.time, usual_rpm(vessel))
    table, truth = simulate_trial(vessel, "calm", (start, *legs), share * pace.time, 2.0, 1)
    found = find_manoeuvres(table, vessel.dimensions.length_between_perpendiculars_m)
    return [each for each in found if each.kind == kind], np.rad2deg(truth["states"][:, 5]), pace.time


@pytest.mark.parametrize(("ship", "rate_dps"), SHIPS)
def test_a_pull_out_has_the_rate_that_is_left(ship: str, rate_dps: float) -> None:
    vessel = vessel_of(ship, rate_dps)
    legs = tuple(
        held(vessel, angle, share) for angle, share in ((-20.0, 60.0), (0.0, 90.0), (20.0, 60.0), (0.0, 90.0))
    )
    found, rate, time = sailed(vessel, legs, 420.0, "pull_out")
    assert [each.side for each in found] == ["starboard", "port"]
    for each, end_s, side in zip(found, (270.0, 420.0), (1.0, -1.0), strict=True):
        row = round(2.0 * (end_s - 5.0) * time)
        left = each.indices["residual_yaw_rate_dps"]
        assert left.value == pytest.approx(side * rate[row], abs=0.02 * np.abs(rate).max())


@pytest.mark.parametrize(("ship", "rate_dps"), SHIPS)
def test_a_direct_spiral_has_the_settled_rates_of_its_steps(ship: str, rate_dps: float) -> None:
    vessel = vessel_of(ship, rate_dps)
    helms = [15.0, 10.0, 5.0, 0.0, -5.0, -10.0, -15.0]
    legs = (*(held(vessel, -angle, 70.0) for angle in [*helms, *helms[-2::-1]]), held(vessel, 0.0, 200.0))
    found, rate, time = sailed(vessel, legs, 1040.0, "spiral")
    (spiral,) = found
    assert spiral.name == "direct spiral 15 deg"
    for step in range(1, 14):
        row = round(2.0 * (120.0 + 70.0 * step - 10.0) * time)
        assert spiral.indices[f"yaw_rate_step_{step}_dps"].value == pytest.approx(
            rate[row], abs=0.05 * np.abs(rate).max()
        )
    stable = ship == "gunnerus_short"
    assert (spiral.indices["loop_height_dps"].value < 0.05) == stable


def test_a_spiral_with_steps_that_did_not_settle_is_one_without_them() -> None:
    """A ship that does not keep her course lingers near no rate of turn, when the helm goes over to the other side:
    that one step of the loop goes on turning is no reason to lose the whole test."""
    helms = [15.0, 10.0, 5.0, 0.0, -3.0, -5.0, -10.0, -15.0]
    wanted, rate, rows = np.repeat([0.0, *helms, 0.0], 420), 0.02, []
    for order in wanted:
        rate += (0.03 * order + 0.3 * rate - 3.0 * rate**3) / 50.0
        rows.append(rate)
    rates = np.array(rows)
    heading, noise = np.cumsum(rates), np.random.default_rng(1).standard_normal((5, rates.size))
    table = pd.DataFrame(
        {
            "north_m": np.cumsum(5.0 * np.cos(np.deg2rad(heading))) + 0.3 * noise[0],
            "east_m": np.cumsum(5.0 * np.sin(np.deg2rad(heading))) + 0.3 * noise[1],
            "heading_deg": (heading + 0.05 * noise[2]) % 360.0, "yaw_rate_dps": rates + 0.005 * noise[3],
            "rudder_angle_deg": wanted + 0.1 * noise[4],
        },
        index=pd.date_range("2026-05-01", periods=rates.size, freq="1s", tz="UTC", name="time"),
    )  # fmt: skip
    (spiral,) = (each for each in find_manoeuvres(table, 180.0) if each.kind == "spiral")
    settling = [abs(rates[420 * step + 419] - rates[420 * step + 300]) for step in range(1, 9)]
    assert spiral.notes
    for step, moving in enumerate(settling, start=1):
        name = f"yaw_rate_step_{step}_dps"
        assert (name in spiral.indices) == (f"step {step} at" not in spiral.notes[0]) == (moving < 0.05)
        if name in spiral.indices:
            assert spiral.indices[name].value == pytest.approx(rates[420 * step + 315], abs=0.02)


@pytest.mark.parametrize(("ship", "rate_dps"), SHIPS)
def test_a_williamson_turn_ends_on_the_reciprocal_course(ship: str, rate_dps: float) -> None:
    vessel = vessel_of(ship, rate_dps)
    rpm = usual_rpm(vessel)
    legs = (
        replace(helm_leg(-30.0, rpm), deviation_deg=60.0),
        replace(helm_leg(30.0, rpm), deviation_deg=-150.0),
        steer(180.0, 400.0 * pace_of(vessel).time, rpm),
    )
    (found,), _, _ = sailed(vessel, legs, 420.0, "williamson_turn")
    assert (found.name, found.side) == ("Williamson turn 30 deg", "starboard")
    assert found.indices["heading_at_second_execute_deg"].value == pytest.approx(65.0, abs=6.0)
    assert found.indices["time_to_reciprocal_s"].value > 0.0


def steered_at_rates(rates_dps: list[float], straightness: float, hold_s: float, seed: int) -> pd.DataFrame:
    """A ship of Nomoto's second kind, T r' + straightness r + r^3 = K delta, steered at rates of turn by hand.

    ``straightness`` below zero is a ship that does not keep her course. Angles in degrees, 1 Hz, with noise.
    """
    random, step_s, gain = np.random.default_rng(seed), 0.1, 0.1
    wanted = np.repeat(rates_dps, round(hold_s / step_s))
    rate, helm_deg, order, rows = 0.0, 0.0, 0.0, []
    for row, target in enumerate(wanted):
        if row % 40 == 0:  # a hand at the wheel
            order = (straightness * target + target**3) / gain + 30.0 * (target - rate) + random.normal(0.0, 0.6)
        helm_deg += max(-5.0 * step_s, min(5.0 * step_s, order - helm_deg))
        rate += step_s * (gain * helm_deg - straightness * rate - rate**3) / 12.0
        rows.append((rate, helm_deg))
    rates, helms = np.array(rows[::10]).T
    heading = np.cumsum(rates)
    noise = random.standard_normal((6, rates.size))
    course = np.deg2rad(heading)
    return pd.DataFrame(
        {
            "north_m": np.cumsum(5.0 * np.cos(course)) + 0.1 * noise[0],
            "east_m": np.cumsum(5.0 * np.sin(course)) + 0.1 * noise[1],
            "heading_deg": (heading + 0.1 * noise[2]) % 360.0, "surge_mps": 5.0 + 0.03 * noise[3],
            "sway_mps": 0.03 * noise[4], "yaw_rate_dps": rates + 0.03 * noise[5], "rudder_angle_deg": helms,
        },
        index=pd.date_range("2026-05-01", periods=rates.size, freq="1s", tz="UTC", name="time"),
    )  # fmt: skip


@pytest.mark.parametrize("straightness", [0.6, -0.5])
def test_a_reverse_spiral_has_the_helm_of_each_rate(straightness: float) -> None:
    """Stable and unstable: the curve that the ship is made of is found again, the part that goes back too."""
    rates = [1.0, 0.75, 0.5, 0.25, 0.0, -0.25, -0.5, -0.75, -1.0]
    inside = list[bool]()
    for seed in range(3):
        found = find_manoeuvres(steered_at_rates([0.0, *rates, 0.0], straightness, 120.0, seed))
        (spiral,) = (each for each in found if each.kind == "reverse_spiral")
        assert not [each for each in found if each.kind in ("spiral", "zigzag", "turning_circle")]
        for step, rate in enumerate(reversed(rates), start=1):
            index = spiral.indices[f"helm_step_{step}_deg"]
            inside.append(index.low <= (straightness * rate + rate**3) / 0.1 <= index.high)
        slope = spiral.indices["helm_per_yaw_rate_s"]
        assert slope.value == pytest.approx((straightness + 0.25**2) / 0.1, abs=1.0)
        assert ("unstable_helm_width_deg" in spiral.indices) == (straightness < 0.0)
    assert np.mean(inside) > 0.85


def test_a_turn_that_slowly_changes_sides_is_no_spiral() -> None:
    drifting = steered_at_rates(list(np.linspace(1.0, -1.0, 400)), 0.6, 2.0, 1)
    assert not [each for each in find_manoeuvres(drifting) if "spiral" in each.kind]
