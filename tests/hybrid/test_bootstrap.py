"""Intervals that know how many legs there are, not how many windows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from seatrial.acquisition.core.result import to_json
from seatrial.hybrid.prediction.baselines import Interval, LegBootstrap


def _width(interval: Interval) -> float:
    return interval.high - interval.low


def test_copies_of_windows_teach_nothing() -> None:
    """Ten copies of every window leave the interval of a mean as wide as it was; ten times the legs narrow it."""
    values, legs = np.random.default_rng(1).normal(5.0, 1.0, 40), np.array([f"{n:03d}" for n in range(40)])
    once = LegBootstrap.of(legs, 0).mean(values)
    copied = LegBootstrap.of(np.repeat(legs, 10), 0).mean(np.repeat(values, 10))
    as_legs = LegBootstrap.of(np.arange(400).astype(str), 0).mean(np.repeat(values, 10))
    assert _width(copied) == pytest.approx(_width(once))
    assert _width(as_legs) < 0.5 * _width(once)


def test_the_interval_of_a_mean_is_that_of_the_central_limit() -> None:
    """With one window a leg it is mean +- 1.96 s / root n."""
    values = np.random.default_rng(2).exponential(1.0, 400)
    interval = LegBootstrap.of(np.arange(400).astype(str), 3).mean(values)
    half = norm.ppf(0.975) * values.std() / 20.0
    assert interval.value == values.mean()
    assert [interval.low, interval.high] == pytest.approx(
        [values.mean() - half, values.mean() + half], abs=0.15 * half
    )


def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    """Legs with a level of their own: of 100 data sets of 30 legs, 95 % of the intervals hold the true mean."""
    random, legs = np.random.default_rng(4), np.repeat(np.arange(30), 8).astype(str)
    held = 0
    for seed in range(100):
        values = np.repeat(random.normal(0.0, 1.0, 30), 8) + random.normal(0.0, 0.3, 240)
        interval = LegBootstrap.of(legs, seed).mean(values)
        held += interval.low <= 0.0 <= interval.high
    assert 0.88 < held / 100 <= 0.99


@settings(deadline=None, max_examples=25)
@given(factor=st.floats(0.01, 50.0), seed=st.integers(0, 50))
def test_a_ratio_is_paired(factor: float, seed: int) -> None:
    """A method that is always worse by one factor has exactly that ratio, however errors vary from leg to leg."""
    random = np.random.default_rng(seed)
    values, legs = random.exponential(1.0, 60), random.integers(0, 12, 60).astype(str)
    interval = LegBootstrap.of(legs, seed).ratio(factor * values, values)
    assert [interval.value, interval.low, interval.high] == pytest.approx([factor] * 3)


def test_one_leg_gives_no_interval_and_nothing_over_nothing_is_one() -> None:
    alone = LegBootstrap.of(np.array(["only"] * 5), 0).mean(np.arange(5.0))
    assert to_json(alone) == {"value": 2.0, "low": None, "high": None}
    legs = LegBootstrap.of(np.array(["a", "b"]), 0)
    assert legs.ratio(np.zeros(2), np.zeros(2)) == Interval(1.0, 1.0, 1.0)
