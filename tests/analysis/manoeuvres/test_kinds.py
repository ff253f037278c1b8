"""Runs, stops, pull-outs, spirals and thruster tests of simulated ships, as in the benchmark of all kinds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from seatrial.analysis.manoeuvres.find import find_manoeuvres
from tests.analysis.conftest import table_at
from tests.benchmarks.manoeuvre_kinds import judge
from tests.benchmarks.manoeuvre_trials import Score, case_of
from tests.conftest import nightly

NUMBERS = (1, 3, 8, 17)
"""A model with a rudder, azimuth thrusters with a slow and a fast helm, a model at 1 Hz."""


@pytest.mark.parametrize("numbers", [NUMBERS[2:], *nightly([*NUMBERS])])
def test_every_manoeuvre_is_found_none_invented_and_intervals_hold_the_truth(numbers: Sequence[int]) -> None:
    score = Score()
    wrong = [line for number in numbers for line in judge(case_of(number), score)]
    assert wrong == []
    assert score.found == score.true > 8 * len(numbers)
    assert score.coverage > 0.88
    kinds = {name.partition(":")[0] for name in score.inside}
    assert kinds == {"speed_run", "acceleration", "stopping", "pull_out", "spiral", "thruster_test", "crabbing"}
    assert np.mean(score.inside["speed_run: speed_through_water_mps"]) > 0.7


@pytest.mark.parametrize("reversal_s", [5.0, 60.0, 90.0])
def test_a_stop_counts_from_when_a_large_shaft_began_to_slow_down(reversal_s: float) -> None:
    """The track reach of IMO is from the order: one that takes 90 s to reverse takes nothing from it.
    That the shaft is stopped in the end, by which a ship with hardly any sternway gains, is no acceleration."""
    time_s, order_s, random = np.arange(0.0, 1500.0), 300.0, np.random.default_rng(3)
    rpm = np.interp(time_s, [order_s, order_s + reversal_s, 1200.0, 1220.0], [105.0, -70.0, -70.0, 0.0])
    surge = 7.0 * np.interp(time_s, [order_s, 1000.0], [1.0, 0.0]) ** 2
    surge[time_s > 1220.0] = 0.02
    north = np.cumsum(surge)
    noise = random.standard_normal((6, time_s.size))
    table = table_at(time_s, {
        "north_m": north + 0.3 * noise[0], "east_m": 0.3 * noise[1], "heading_deg": 0.0 * time_s,
        "surge_mps": surge + 0.02 * noise[2], "sway_mps": 0.02 * noise[3], "yaw_rate_dps": 0.01 * noise[4],
        "propeller_rpm": rpm + 0.2 * noise[5], "rudder_angle_deg": 0.0 * time_s,
    })  # fmt: skip
    found = find_manoeuvres(table, 180.0)
    assert [each.kind for each in found if each.kind != "speed_run"] == ["stopping"]
    (stop,) = (each for each in found if each.kind == "stopping")
    whole = north[1000] - north[int(order_s)]
    assert stop.indices["track_reach_m"].value == pytest.approx(whole, abs=0.01 * whole + 10.0)
