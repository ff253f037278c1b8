"""Feedback that froze, and shafts in per cent, are found; stopped, coarse and ordered ones are sound."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from acquisition.core.frames import Quality
from analysis.quality.commands import check_thruster_feedback
from hybrid.simulation.trial import simulate_trial
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
