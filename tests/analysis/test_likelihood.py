"""Fisher scoring on problems whose maximum is known: white noise of one level, and of one level and an offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.estimation.process_models import (
    Prior,
    ScoringSettings,
    correlated_pairs,
    most_likely,
    robust_cost,
    score_and_curvature,
)

FREE = np.full(2, 30.0)
EXACT = ScoringSettings(most_steps=50, enough=1e-10)


def offset_and_level(data: Floats) -> object:
    """Innovations of data about an offset with a level: parameters are the offset and the level's logarithm."""
    return lambda at: (data - at[0], np.full(data.size, np.exp(2.0 * at[1])))


@given(offset=st.floats(-5.0, 5.0), level=st.floats(0.05, 20.0), seed=st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_mean_and_deviation_are_the_most_likely_ones(offset: float, level: float, seed: int) -> None:
    data = offset + level * np.random.default_rng(seed).standard_normal(300)
    start = np.array([offset + level, np.log(level) + 1.0])
    found, cost = most_likely(offset_and_level(data), start, -FREE, FREE, EXACT)  # type: ignore[arg-type]
    assert found[0] == pytest.approx(data.mean(), abs=1e-3 * level)
    assert np.exp(found[1]) == pytest.approx(data.std(), rel=1e-3)
    assert cost == pytest.approx(300 * (np.log(data.var()) + 1.0), abs=1e-3)


def test_the_information_is_fishers() -> None:
    """Of n values: n over the variance for the mean, 2 n for the level's logarithm, nothing between them."""
    data = 2.0 * np.random.default_rng(1).standard_normal(4000)
    at, innovations = np.array([0.0, np.log(2.0)]), offset_and_level(data)
    gradient, curvature = score_and_curvature(innovations, at, innovations(at), 25.0)  # type: ignore[arg-type, operator]
    assert 0.5 * curvature == pytest.approx(np.diag([4000 / 4.0, 2 * 4000]), rel=1e-3, abs=1e-3)
    assert gradient[0] == pytest.approx(-2.0 * data.sum() / 4.0, rel=1e-3)


def test_outliers_do_not_pass_for_noise() -> None:
    data = np.random.default_rng(2).standard_normal(500)
    spoilt = data.copy()
    spoilt[:5] = 1e3
    ends = [most_likely(offset_and_level(each), np.zeros(2), -FREE, FREE, EXACT)[0] for each in (data, spoilt)]  # type: ignore[arg-type]
    assert ends[1][1] == pytest.approx(ends[0][1], abs=0.02)
    assert robust_cost(np.array([1e3]), np.array([1.0]), 25.0) == robust_cost(
        np.array([1e3]), np.array([4.0]), 25.0
    )


def test_bounds_hold_and_a_prior_pulls() -> None:
    data = 2.0 * np.random.default_rng(3).standard_normal(200) + 5.0
    low, high = np.array([-1.0, -1.0]), np.array([1.0, 3.0])
    found, _ = most_likely(offset_and_level(data), np.zeros(2), low, high, EXACT)  # type: ignore[arg-type]
    assert found[0] == 1.0
    assert np.exp(2.0 * found[1]) == pytest.approx(((data - 1.0) ** 2).mean(), rel=1e-3)
    prior = Prior(np.array([0.0, np.log(2.0)]), 0.01)
    pulled, _ = most_likely(offset_and_level(data), np.zeros(2), -FREE, FREE, EXACT, prior)  # type: ignore[arg-type]
    assert abs(pulled[0]) < 0.1


def test_pairs_that_hang_together_are_told() -> None:
    correlation = np.array([[1.0, 0.2, -0.97], [0.2, 1.0, 0.5], [-0.97, 0.5, 1.0]])
    assert correlated_pairs(["mass", "lag", "drag"], correlation) == [("drag", "mass", -0.97)]
