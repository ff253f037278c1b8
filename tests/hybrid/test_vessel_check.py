"""``vessel check``: the standard manoeuvres of a vessel file, against what is computed without it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import seatrial
import seatrial as st
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.hybrid.simulation.manoeuvres import steer, turning_circle, zigzag
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.simulation.vessel_check import (
    TEST_SHARE,
    StandardTest,
    VesselCheck,
    check_vessel,
    conditions_of,
    trial_ship_at_rpm,
)
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import bare_plant
from tests.hybrid.froude import froude_scaled

GUNNERUS = load_vessel("gunnerus_short")
LENGTH_M = 28.9


@pytest.fixture(scope="module")
def check() -> VesselCheck:
    return check_vessel(GUNNERUS)


def named(check: VesselCheck, name: str) -> StandardTest:
    return next(each for each in check.tests if each.name == name)


def test_steady_speed_balances_thrust_and_resistance(check: VesselCheck) -> None:
    """The numbers of her file by hand: both pods ahead, the hull and still air against them."""
    pod, hull, wind = GUNNERUS.actuator[0], GUNNERUS.hull, GUNNERUS.wind
    D, rho = pod.propeller_diameter_m, GUNNERUS.water_density_kgpm3

    def force_n(u: float, n: float) -> float:
        thrust = rho * D**2 * (pod.thrust_nn * D**2 * n**2 + pod.thrust_nu * D * n * u + pod.thrust_uu * u**2)
        air = 0.5 * wind.air_density_kgpm3 * wind.frontal_area_m2 * wind.CX[0] * u**2
        return float(2.0 * thrust + hull.Xuu * u**2 + air)

    assert check.rpm == pytest.approx(203.0 * TEST_SHARE)
    for rpm, speed_mps in [*check.speeds, (check.rpm, check.speed_mps)]:
        assert speed_mps == pytest.approx(brentq(force_n, 0.0, 20.0, args=(rpm / 60.0,)), rel=1e-3)


def test_circle_and_zigzag_are_those_found_in_a_recording(check: VesselCheck) -> None:
    """The same tests simulated as a trial without noise, and found in its table."""
    quiet = SimulationNoise().scaled(0.0)
    straight = steer(0.0, 60.0, check.rpm)
    circle, _ = simulate_trial(
        GUNNERUS, "calm", (straight, *turning_circle(-35.0, check.rpm)[1:2]), 210.0, 5.0, noise=quiet
    )
    swings, _ = simulate_trial(
        GUNNERUS, "calm", (straight, *zigzag(-20.0, -20.0, check.rpm)), 160.0, 5.0, noise=quiet
    )
    found = {each.kind: each for table in (circle, swings) for each in find_manoeuvres(table, LENGTH_M)}
    for name in ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m"):
        own = named(check, "turning circle 35 deg to starboard").indices[name]
        assert own.value == pytest.approx(found["turning_circle"].indices[name].value, rel=0.02), name
    for name in ("overshoot_1_from_order_deg", "overshoot_2_from_order_deg"):
        own = named(check, "zigzag 20/20 to starboard").indices[name]
        assert own.value == pytest.approx(found["zigzag"].indices[name].value, abs=0.4), name


def test_she_turns_to_the_side_of_the_helm_alike_to_both(check: VesselCheck) -> None:
    """The ship is symmetric, the helm to starboard positive."""
    starboard, port = (named(check, f"turning circle 35 deg to {side}") for side in ("starboard", "port"))
    assert starboard.helm_deg == -port.helm_deg == 35.0
    assert starboard.motion.heading_deg[-1] > 700.0
    assert port.motion.heading_deg[-1] < -700.0
    assert starboard.indices["advance_m"].value == pytest.approx(port.indices["advance_m"].value)
    assert starboard.indices["advance_m"].limit == pytest.approx(4.5 * LENGTH_M)
    assert check.course_stable
    assert {result.result for result in check.criteria} == {"not_shown"}
    assert "for ships of 100 m and more, not 28.9 m" in str(check)


@pytest.mark.parametrize("moment_nm", [-1e5, 1e5])
def test_ship_that_something_turns_is_course_stable_and_still_water_is_still(moment_nm: float) -> None:
    """It comes to one rate of turn, to the side of the moment, from either side; the day's current has no part."""
    current = {"speed_mps": 0.8, "direction_deg": 70.0}
    turned = replace(GUNNERUS, effects={"yaw_asymmetry": {"moment_nm": moment_nm}})
    check = check_vessel(turned)
    assert check.course_stable
    assert np.sign(check.amidships_dps) == np.sign(moment_nm)
    side = "starboard" if moment_nm > 0.0 else "port"
    assert f"deg/s to {side} from either side" in str(check)
    of_day = check_vessel(replace(turned, effects={**turned.effects, "ocean_current": current}))
    assert "without the ocean current" in str(of_day)
    for own, in_current in zip(check.tests, of_day.tests, strict=True):
        assert own.indices == in_current.indices


def test_a_model_has_the_same_figures_in_lengths(check: VesselCheck) -> None:
    model = check_vessel(froude_scaled(GUNNERUS, 0.08))
    for own, of_model in zip(check.tests, model.tests, strict=True):
        for name, index in own.indices.items():
            same = of_model.indices[name]
            if index.unit in ("m", "deg", ""):
                values = (index.lengths, same.lengths) if index.unit == "m" else (index.value, same.value)
                assert values[1] == pytest.approx(values[0], rel=0.02, abs=0.1), (own.name, name)


def test_what_leaves_the_range_of_the_model_is_made_with_less_helm() -> None:
    """Or left out with the reason."""
    narrow = replace(GUNNERUS, validity=replace(GUNNERUS.validity, yaw_rate_radps=0.08))
    check = check_vessel(narrow)
    port = next(test for test in check.of_kind("turning_circle") if test.name.endswith("to port"))
    assert 0.0 < port.helm_deg * -1.0 < 35.0
    hardly = check_vessel(replace(GUNNERUS, validity=replace(GUNNERUS.validity, yaw_rate_radps=0.005)))
    assert "turning circle to port" in hardly.left_out
    assert "stopping with thrust astern" in {each.name for each in hardly.tests}
    assert "range of the model" in str(hardly)


def test_the_command_prints_draws_and_answers_in_json(tmp_path: Path) -> None:
    app = seatrial.app
    for ending in ("png", "html"):
        result = CliRunner().invoke(
            app, ["vessel", "check", "gunnerus_long", "-o", str(tmp_path / f"check.{ending}")]
        )
        assert result.exit_code == 0, result.output
        assert "tactical diameter" in result.output
        assert (tmp_path / f"check.{ending}").stat().st_size > 20_000
    answer = json.loads(CliRunner().invoke(app, ["vessel", "check", "gunnerus_long", "--json"]).stdout)
    assert answer["length_m"] == pytest.approx(LENGTH_M + 5.0)
    circle = answer["tests"][0]["indices"]["tactical_diameter_m"]
    assert circle["limit"] == pytest.approx(5.0 * answer["length_m"])
    assert circle["low"] == circle["high"] == circle["value"]
    assert (circle["counted_from"], circle["result"]) == ("order", "not_shown")
    assert len(answer["criteria"]) == 13


@pytest.mark.parametrize("moment_nm", [1.0, -2.0])
def test_a_moment_that_turns_the_ship_is_held_by_the_autopilot(tmp_path: Path, moment_nm: float) -> None:
    """Some 0.5 and 1 % of what the rudder gives: the approach stays steady, and the zigzags are hardly changed."""
    biased = tmp_path / "biased.toml"
    biased.write_text(f'base = "kvlcc2_7m"\n[effects.yaw_asymmetry]\nmoment_nm = {moment_nm}\n')
    even, held = check_vessel(load_vessel("kvlcc2_7m")), check_vessel(load_vessel(biased))
    assert not held.left_out
    for test in held.of_kind("zigzag"):
        same = named(even, test.name)
        motion, start = test.motion, float(test.executes_s[0])
        turned = np.abs(
            motion.heading_deg[np.searchsorted(motion.time_s, test.executes_s)] - motion.at("heading_deg", start)
        )
        assert turned[1:] == pytest.approx(abs(test.helm_deg), abs=0.5)  # each order at its switching angle
        assert np.all(np.diff(test.executes_s) > 0.0)
        for number in (1, 2):
            name = f"overshoot_{number}_from_order_deg"
            assert test.indices[name].value == pytest.approx(same.indices[name].value, abs=2.5), test.name


def test_a_script_may_ask_for_another_shaft_speed() -> None:
    slow = st.vessel_check("gunnerus_short", rpm=100.0)
    assert slow.speed_mps == pytest.approx(2.95, abs=0.01)
    assert "L/V 9.8 s" in str(slow)


def test_current_and_depth_count_whatever_effect_brings_them() -> None:
    """An effect of one's own that moves the water makes a current, as the catalogue's own does."""
    moved = replace(GUNNERUS, effects={"ocean_current": {"speed_mps": 0.4, "direction_deg": 30.0}})
    ship = trial_ship_at_rpm(moved, 100.0)
    assert conditions_of(ship, 5.0).current_mps == pytest.approx(0.4)
    renamed = replace(ship, plant=bare_plant(GUNNERUS).replaced(current_north_mps=0.3, current_east_mps=-0.4))
    assert conditions_of(renamed, 5.0).current_mps == pytest.approx(0.5)
    shallow = replace(ship, vessel=replace(GUNNERUS, effects={"a_bank": {"depth_m": 9.0}}))
    assert conditions_of(shallow, 5.0).water_depth_m == 9.0
