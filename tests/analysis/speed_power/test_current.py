"""The current of double runs: against a fit of everything at once, written another way, and against known tides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.speed_power.analysis import TIDE_S, iterate_current, mean_of_means

SPEEDS = np.repeat([6.0, 7.0, 7.6, 8.3], 2)
COURSE = np.tile([1.0, -1.0], 4)
TIMES_S = 2400.0 * np.arange(8.0)


def true_power_kw(speed: Floats) -> Floats:
    return np.asarray(250.0 + 8.0 * speed**3.3)


def tide_mps(time_s: Floats) -> Floats:
    return np.asarray(0.6 * np.sin(2.0 * np.pi * (time_s + 5000.0) / (12.4206 * 3600.0)) + 0.15 - 1e-6 * time_s)


def fit_all_at_once(over_ground: Floats, power: Floats) -> Floats:
    """Another form of the same: power by speed as exp of a polynomial's logarithm, current by amplitude and phase,
    every unknown in one least squares of the powers. Returns the speeds through the water."""

    def current(x: Floats) -> Floats:
        return np.asarray(
            x[3] * np.sin(2.0 * np.pi * TIMES_S / TIDE_S + x[4]) + x[5] + x[6] * (TIMES_S / TIDE_S - 0.2)
        )

    def misfit(x: Floats) -> Floats:
        speed = over_ground - COURSE * current(x)
        return np.asarray((x[0] * 1e3 + np.exp(x[1] + x[2] * np.log(speed / 7.0)) - power) / power)

    start = np.array([0.0, np.log(power[2]), 3.0, 0.3, 0.5, 0.0, 0.0])
    found = least_squares(misfit, start, xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=20_000).x
    return np.asarray(over_ground - COURSE * current(found))


def through_water(over_ground: Floats, power: Floats) -> Floats:
    start = np.repeat(over_ground.reshape(-1, 2).mean(axis=1), 2)
    return iterate_current(TIMES_S, COURSE, over_ground, power, start, 4).speed_mps


def test_iterative_method_finds_a_tide() -> None:
    over_ground = SPEEDS + COURSE * tide_mps(TIMES_S)
    found = through_water(over_ground, true_power_kw(SPEEDS))
    assert found == pytest.approx(SPEEDS, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_iterative_method_agrees_with_a_fit_of_all_at_once(seed: int) -> None:
    random = np.random.default_rng(seed)
    over_ground = SPEEDS + COURSE * tide_mps(TIMES_S) + 0.01 * random.standard_normal(8)
    power = true_power_kw(SPEEDS) * (1.0 + 0.002 * random.standard_normal(8))
    assert through_water(over_ground, power) == pytest.approx(fit_all_at_once(over_ground, power), abs=0.02)


def test_power_that_falls_with_the_speed_is_refused() -> None:
    with pytest.raises(DataShortageError, match="does not grow with their speed"):
        through_water(SPEEDS, true_power_kw(SPEEDS)[::-1])


def test_power_that_differs_between_the_courses_is_no_current() -> None:
    """Against the wind a governor asks for more: the speeds follow the curve, not the mean of the pair."""
    speeds = SPEEDS + 0.1 * COURSE
    found = through_water(speeds + COURSE * tide_mps(TIMES_S), true_power_kw(speeds))
    assert found == pytest.approx(speeds, abs=2e-3)


@pytest.mark.parametrize(("runs", "degree"), [(2, 0), (3, 1), (4, 2)])
def test_mean_of_means_removes_a_current_of_so_high_a_degree(runs: int, degree: int) -> None:
    time = np.arange(runs, dtype=float)
    course = np.where(time % 2.0, -1.0, 1.0)
    for power in range(degree + 1):
        assert mean_of_means(8.0 + course * 0.3 * time**power) == pytest.approx(8.0)
    assert abs(mean_of_means(8.0 + course * 0.3 * time ** (degree + 1)) - 8.0) > 0.01


def test_runs_that_do_not_alternate_have_their_plain_mean() -> None:
    assert mean_of_means(np.array([8.5, 7.5, 7.5, 8.5]), alternating=False) == pytest.approx(8.0)
