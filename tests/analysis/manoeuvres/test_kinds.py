"""Runs, stops, pull-outs, spirals and thruster tests of simulated ships, as in the benchmark of all kinds."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.manoeuvre_kinds import judge
from tests.benchmarks.manoeuvre_trials import Score, case_of

NUMBERS = (1, 3, 8, 17)
"""A model with a rudder, azimuth thrusters with a slow and a fast helm, a model at 1 Hz."""


def test_every_manoeuvre_is_found_none_invented_and_intervals_hold_the_truth() -> None:
    score = Score()
    wrong = [line for number in NUMBERS for line in judge(case_of(number), score)]
    assert wrong == []
    assert score.found == score.true > 8 * len(NUMBERS)
    assert score.coverage > 0.88
    kinds = {name.partition(":")[0] for name in score.inside}
    assert kinds == {"speed_run", "acceleration", "stopping", "pull_out", "spiral", "thruster_test", "crabbing"}
    assert np.mean(score.inside["speed_run: speed_through_water_mps"]) > 0.7
