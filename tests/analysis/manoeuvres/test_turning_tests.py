"""Pull-outs, direct spirals and Williamson turns of simulated ships, against what their noise-free motion did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.manoeuvres import Manoeuvre, find_manoeuvres
from hybrid.simulation.handling import pace_of, usual_rpm
from hybrid.simulation.manoeuvres import Leg, helm, steer
from hybrid.simulation.trial import simulate_trial
from hybrid.vessel.parameters import Vessel
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


@pytest.mark.parametrize(("ship", "rate_dps"), SHIPS)
def test_a_williamson_turn_ends_on_the_reciprocal_course(ship: str, rate_dps: float) -> None:
    vessel = vessel_of(ship, rate_dps)
    rpm = usual_rpm(vessel)
    legs = (
        replace(helm(-30.0, rpm), deviation_deg=60.0),
        replace(helm(30.0, rpm), deviation_deg=-150.0),
        steer(180.0, 400.0 * pace_of(vessel).time, rpm),
    )
    (found,), _, _ = sailed(vessel, legs, 420.0, "williamson_turn")
    assert (found.name, found.side) == ("Williamson turn 30 deg", "starboard")
    assert found.indices["heading_at_second_execute_deg"].value == pytest.approx(65.0, abs=6.0)
    assert found.indices["time_to_reciprocal_s"].value > 0.0
