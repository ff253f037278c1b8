"""Feedback that froze, and shafts in per cent, are found; stopped, coarse and ordered ones are sound."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.controls import check_thruster_feedback
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.conftest import table_at
from tests.analysis.quality import faults


@pytest.fixture(scope="module")
def trial() -> pd.DataFrame:
    return simulate_trial("gunnerus_short", "gentle", "voyage", 900.0, 5.0, 6)[0]


@pytest.mark.parametrize("name", ["port_rpm", "starboard_angle_deg", "starboard_rpm"])
@pytest.mark.parametrize("seconds", [30.0, 200.0])
def test_frozen_feedback(trial: pd.DataFrame, name: str, seconds: float) -> None:
    spoilt = faults.stuck(name, seconds)(trial, np.random.default_rng(2))
    checked = check_thruster_feedback(spoilt.table)
    (finding,) = checked.findings
    assert (finding.code, finding.channel) == ("feedback_frozen", name)
    assert finding.estimate["seconds"] == pytest.approx(seconds, abs=0.5)
    bad = np.asarray(checked.flags[name] == Quality.BAD)
    assert bad.sum() == pytest.approx(seconds * 5.0, abs=2)
    assert (spoilt.table[name].to_numpy()[bad] == spoilt.table.loc[finding.start, name]).all()
    assert (checked.flags.drop(columns=name) == Quality.GOOD).all().all()


def test_what_may_stand_still(trial: pd.DataFrame) -> None:
    """A stopped shaft, a parked azimuth whose shaft is stopped, a coarse reading, an order."""
    still = slice(trial.index[1000], trial.index[2000])
    stopped = trial.copy()
    stopped.loc[still, "port_rpm"] = 0.0
    stopped.loc[still, "port_angle_deg"] = 12.5
    assert check_thruster_feedback(stopped).findings == ()
    coarse = trial.assign(port_rpm=np.round(trial["port_rpm"] / 5.0) * 5.0)
    assert check_thruster_feedback(coarse).findings == ()
    order = trial.assign(port_rpm=np.round(trial["port_rpm"], -1), starboard_rpm=150.0)
    assert check_thruster_feedback(order).findings == ()


@pytest.mark.parametrize("manoeuvre", ["one_thruster", "stopping", "tunnel_test"])
def test_sound_feedback(manoeuvre: str) -> None:
    table, _ = simulate_trial("gunnerus_long", "moderate", manoeuvre, 600.0, 2.0, 1)
    assert check_thruster_feedback(table).findings == ()


@pytest.mark.parametrize("full_scale_rpm", [183.0, 203.0, 250.0])
def test_one_shaft_in_per_cent(trial: pd.DataFrame, full_scale_rpm: float) -> None:
    spoilt = faults.percent_scaled(full_scale_rpm)(trial, np.random.default_rng(0))
    checked = check_thruster_feedback(spoilt.table)
    (finding,) = checked.findings
    assert (finding.code, finding.channel) == ("percent_scaled", "port_rpm")
    assert finding.estimate["factor"] == pytest.approx(full_scale_rpm / 100.0, rel=0.02)
    assert finding.estimate["low"] < finding.estimate["factor"] < finding.estimate["high"]
    assert not finding.certain
    assert (checked.flags["port_rpm"] == Quality.SUSPECT).all()


def test_both_shafts_that_stop_at_100() -> None:
    at_s = np.arange(0.0, 600.0, 0.5)
    lever = np.clip(
        130.0 * np.sin(at_s / 40.0) + np.random.default_rng(0).normal(0.0, 0.3, at_s.size), -100.0, 100.0
    )
    table = table_at(at_s, {"port_rpm": lever, "starboard_rpm": lever})
    assert {finding.code for finding in check_thruster_feedback(table).findings} == {"percent_scaled"}
    assert check_thruster_feedback(table * 0.97).findings == ()


def test_slow_shafts_and_single_ones_are_sound(trial: pd.DataFrame) -> None:
    slow = trial.assign(port_rpm=trial["port_rpm"] * 0.4, starboard_rpm=trial["starboard_rpm"] * 0.4)
    assert check_thruster_feedback(slow).findings == ()
    alone, _ = simulate_trial("gunnerus_long", "calm", "one_thruster", 400.0, 2.0, 1)
    scaled = alone.assign(port_rpm=alone["port_rpm"] * 0.5)  # the two never turn together
    assert check_thruster_feedback(scaled).findings == ()


def test_nothing_to_judge() -> None:
    assert check_thruster_feedback(table_at([0.0, 1.0], {"surge_mps": [1.0, 1.0]})).flags.empty
    assert check_thruster_feedback(table_at([], {"port_rpm": []})).findings == ()


def test_an_order_of_100_rpm_is_no_per_cent() -> None:
    """The slow shaft of a big ship is ordered to run at 100 rpm, and later again."""
    at_s = np.arange(0.0, 600.0, 0.5)
    order = np.repeat([100.0, 60.0, 100.0, 80.0], at_s.size // 4)
    table = table_at(at_s, {"propeller_rpm": order, "rudder_angle_deg": 0.0 * at_s})
    assert check_thruster_feedback(table).findings == ()


@pytest.mark.parametrize("sound", [True, False])
def test_two_propellers_of_which_one_is_in_per_cent(sound: bool) -> None:
    at_s = np.arange(0.0, 600.0, 0.5)
    rpm = 80.0 + 15.0 * np.sin(at_s / 40.0) + np.random.default_rng(0).normal(0.0, 0.3, at_s.size)
    other = rpm + 0.5 if sound else 1.8 * rpm
    rudders = {f"{side}_rudder_angle_deg": 0.0 * at_s for side in ("port", "starboard")}
    table = table_at(at_s, {"left_rpm": rpm, "right_rpm": other, **rudders})
    codes = {(each.code, each.channel) for each in check_thruster_feedback(table).findings}
    assert codes == (set() if sound else {("percent_scaled", "left_rpm")})


def test_a_rudder_that_freezes_amidships_and_a_pitch_whose_shaft_stands_still() -> None:
    random, at_s = np.random.default_rng(4), np.arange(0.0, 600.0, 0.5)
    rudder = 5.0 * np.sin(at_s / 20.0) + random.normal(0.0, 0.1, at_s.size)
    pitch = 60.0 + random.normal(0.0, 0.2, at_s.size)
    rpm = 120.0 + random.normal(0.0, 0.3, at_s.size)
    still = (at_s > 300.0) & (at_s < 400.0)
    columns = {"main_rpm": rpm, "main_pitch_percent": np.where(still, 59.7, pitch), "rudder_angle_deg": rudder}
    table = table_at(at_s, columns)
    assert [each.channel for each in check_thruster_feedback(table).findings] == ["main_pitch_percent"]
    assert check_thruster_feedback(table.assign(main_rpm=np.where(still, 0.0, rpm))).findings == ()
    frozen = table.assign(main_rpm=rpm, main_pitch_percent=pitch, rudder_angle_deg=np.where(still, 0.1, rudder))
    assert [each.channel for each in check_thruster_feedback(frozen).findings] == ["rudder_angle_deg"]
