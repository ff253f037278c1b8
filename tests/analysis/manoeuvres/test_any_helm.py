"""Executes at any rate of the helm, of ships with rudders and with azimuth thrusters, as in the benchmark."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.measures import extreme_rows, helm_rate_dps
from tests.benchmarks.manoeuvre_trials import Score, case_of, judge, sail
from tests.conftest import nightly

TANKER = [0, 5, 10, 15, 20, 25]
"""The trials of the tanker of 180 m, at 0.5, 1, 2.5, 5, 10 and 20 deg/s."""
AZIMUTHS = [3, 8, 13, 28]


@pytest.mark.parametrize(
    ("numbers", "pose_only"),
    [
        (AZIMUTHS[1:3], True),
        *nightly((TANKER[::2] + AZIMUTHS[::2], False), (AZIMUTHS, True), (TANKER + AZIMUTHS, False)),
    ],
)  # fmt: skip
def test_every_execute_is_found_none_invented_and_intervals_hold_the_truth(
    numbers: list[int], pose_only: bool
) -> None:
    score = Score()
    wrong = [line for number in numbers for line in judge(case_of(number), score, pose_only=pose_only)]
    assert wrong == []
    assert score.found == score.true == 2 * len(numbers)
    assert score.coverage > 0.9


@pytest.mark.parametrize("number", [0, 3, *nightly(10)])
def test_position_heading_and_a_helm_are_enough(number: int) -> None:
    case = case_of(number)
    table, _, true, length_m = sail(case)
    angles = [name for name in table if name.endswith("angle_deg")]
    bare = table[["north_m", "east_m", "heading_deg", *angles]].copy()
    bare.attrs = {}
    found = {each.kind: each for each in find_manoeuvres(bare, length_m)}
    whole = {each.kind: each for each in find_manoeuvres(table, length_m)}
    for kind, times in true:
        assert (found[kind].start - table.index[0]).total_seconds() == pytest.approx(times.flat[0], abs=1.0)
        for name, index in found[kind].indices.items():
            own = whole[kind].indices[name]
            assert index.low <= own.high, name
            assert own.low <= index.high, name


def test_the_yards_tanker_has_her_first_execute_and_her_overshoot_from_helm_and_order() -> None:
    """A ship of 180 m at 2.5 deg/s: the overshoot is the one after the second execute, to the first side."""
    case = case_of(10)
    table, exact, ((_, times), _), length_m = sail(case)
    (found,) = (each for each in find_manoeuvres(table, length_m) if each.kind == "zigzag")
    assert found.side == ("starboard" if case.side > 0 else "port")
    heading = case.side * np.rad2deg(np.unwrap(np.deg2rad(exact["heading_deg"])))
    for name, row in (("overshoot_1_from_order_deg", 0), ("overshoot_1_deg", 1)):
        second, third = (round(10.0 * moment) for moment in times[row, 1:3])
        truth = float(heading[second:third].max() - heading[second])
        overshoot = found.indices[name]
        assert overshoot.value == pytest.approx(truth, abs=1.5 * (overshoot.high - overshoot.value))
    assert found.indices["overshoot_1_from_order_deg"].counted_from == "order"
    assert found.indices["overshoot_1_deg"].counted_from == "half_helm"
    assert found.indices["overshoot_1_deg"].limit is None  # one limit, at the one that IMO limits


@pytest.mark.parametrize("rate_dps", [0.5, 2.5, 20.0])
@pytest.mark.parametrize("step_s", [0.2, 1.0])
def test_the_rate_of_a_helm_is_that_of_its_moves(rate_dps: float, step_s: float) -> None:
    """Of moves through several rows; holds between them and noise do not count."""
    time_s = np.arange(0.0, 600.0, step_s)
    wanted = np.interp(time_s % 300.0, [50.0, 50.0 + 20.0 / rate_dps, 150.0, 150.0 + 40.0 / rate_dps, 290.0,
                                        290.0 + 20.0 / rate_dps], [0.0, 20.0, 20.0, -20.0, -20.0, 0.0])  # fmt: skip
    noisy = wanted + np.random.default_rng(1).normal(0.0, 0.1, time_s.size)
    slowest = min(rate_dps, 40.0 / step_s)
    assert helm_rate_dps(noisy, step_s) == pytest.approx(slowest, rel=0.35)


def test_a_helm_that_never_moves_has_no_turning_rows() -> None:
    assert extreme_rows(np.zeros(100), 1.0) == []
