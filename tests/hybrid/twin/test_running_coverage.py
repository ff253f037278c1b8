"""The factor on the regions: what it promises, on errors of predictions that overlap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.calibrators.predict import Prediction
from seatrial.hybrid.twin import LARGEST_FACTOR, STEP, RegionFactor, TrackError, region_factor_step

HORIZON_S = 30
NANO = 1_000_000_000


def error(second: float, inside: float | None, *, moved: bool = False) -> TrackError:
    return TrackError(round(second * NANO), "hybrid", moved, 1.0, 2.0, 0.0, 0.0, 0.0, inside)


def overlapping_distances(seconds: int, seed: int) -> Floats:
    """Distances [seconds, HORIZON_S] of predictions from each second whose speed is off by a Gaussian process that
    forgets itself in half a horizon: two that start a second apart err nearly alike.
    """
    kept = np.exp(-2.0 / HORIZON_S)
    pushes = np.random.default_rng(seed).standard_normal((seconds + HORIZON_S, 2)) @ [1.0, 1.0j]
    speed = np.zeros(seconds + HORIZON_S, dtype=complex)
    for second in range(1, len(speed)):
        speed[second] = kept * speed[second - 1] + np.sqrt(1.0 - kept**2) * pushes[second]
    path = np.concatenate([[0.0], np.cumsum(speed)])
    ends = np.arange(1, HORIZON_S + 1) + np.arange(seconds)[:, None]
    return np.abs(path[ends] - path[:seconds, None])


def watched(distance_m: Floats, radius_m: Floats) -> tuple[Floats, Floats]:
    """The share of seconds [N] inside corrected regions, and the factors [N], when each prediction is judged at the
    end of its horizon.
    """
    region, inside, factors = RegionFactor(), np.empty(len(distance_m)), np.empty(len(distance_m))
    for second, measured_m in enumerate(distance_m):
        if second >= HORIZON_S:
            region = region.updated_by_error(error(second - HORIZON_S, inside[second - HORIZON_S]), HORIZON_S)
        factors[second] = region.factor
        inside[second] = (measured_m <= region.factor * radius_m).mean()
    return inside, factors


@pytest.mark.parametrize(("wrong_by", "low", "high"), [(0.5, 0.935, 0.95), (1.0, 0.94, 0.96), (2.0, 0.95, 0.98)])
def test_wrong_regions_come_to_hold_95_of_100_and_right_ones_stay(wrong_by: float, low: float, high: float) -> None:
    """Four hours, each prediction judged a horizon later: the share inside in the first hour, and afterwards."""
    distance_m = overlapping_distances(4 * 3600, 3)
    right_m = np.quantile(distance_m, 0.95, axis=0)
    inside, factors = watched(distance_m, wrong_by * right_m)
    assert low < inside[:3600].mean() < high
    assert inside[3600:].mean() == pytest.approx(0.95, abs=0.01)
    settled = factors[3600:] * wrong_by
    assert np.median(settled) == pytest.approx(1.0, abs=0.1)
    assert (settled**2).mean() < 1.2


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_the_mean_share_outside_is_what_the_step_lets_it_be(share: float) -> None:
    """The promise of Gibbs and Candes, whatever the errors: here the ship is outside by a coin of changing bias.

    For n independent predictions |mean outside - 0.05| < log(largest factor) / (step n) inside the bounds.
    """
    generator, region, outside = np.random.default_rng(1), RegionFactor(1.0, 100.0), []
    for number in range(1, 400):
        likely = np.clip(0.5 * share + 0.5 * share * np.sin(number / 30.0), 0.0, 1.0) * region.factor**-2
        outside.append(float(generator.random() < likely))
        region = region.updated_by_error(error(number * HORIZON_S, 1.0 - outside[-1]), HORIZON_S)
        if region.is_at_bound:
            break
    learned = np.array(outside[1:])  # the first only says from when on seconds are counted
    excess = abs(learned.sum() - 0.05 * len(learned))
    assert excess == pytest.approx(abs(np.log(region.factor)) / STEP) or region.is_at_bound
    assert excess <= np.log(LARGEST_FACTOR) / STEP + 1.0


def test_the_first_predictions_count_for_more() -> None:
    """As t^-0.6 of those that are independent; once the steps are small, by a constant one."""
    assert region_factor_step(0.2) == region_factor_step(1.0) == 1.0
    assert region_factor_step(4.0) == pytest.approx(4.0**-0.6)
    assert region_factor_step(8.0) == region_factor_step(1e6) == STEP
    first = RegionFactor(start_ns=0).updated_by_error(error(HORIZON_S, 0.0), HORIZON_S)
    assert (np.log(first.factor), first.learned) == pytest.approx((0.95, 1.0))


def test_a_second_apart_counts_as_the_part_of_a_horizon_that_it_is() -> None:
    """Thirty predictions from second to second are one; after a gap one counts once, not more."""
    often, once = RegionFactor(1.0, 100.0, 0), RegionFactor(1.0, 100.0, 0)
    for second in range(1, HORIZON_S + 1):
        often = often.updated_by_error(error(second, 0.5), HORIZON_S)
    once = once.updated_by_error(error(HORIZON_S, 0.5), HORIZON_S)
    assert often.factor == pytest.approx(once.factor) == pytest.approx(np.exp(STEP * 0.45))
    assert RegionFactor(1.0, 100.0, 0).updated_by_error(error(3600.0, 0.5), HORIZON_S).factor == pytest.approx(
        once.factor
    )
    assert once.updated_by_error(error(10.0, 0.0), HORIZON_S).factor == once.factor, (
        "times that go back teach nothing"
    )


def test_it_stays_within_its_bounds_and_comes_back_within_an_hour() -> None:
    """A sensor fails for an hour; then distances are a Gaussian's, outside with 0.05 to the factor's square."""
    region = RegionFactor(1.0, 100.0, 0)
    for number in range(1, 121):
        region = region.updated_by_error(error(number * HORIZON_S, 0.0), HORIZON_S)
    assert region.factor == pytest.approx(LARGEST_FACTOR)
    assert region.is_at_bound
    assert "train again" in str(region)
    for number in range(121, 241):
        region = region.updated_by_error(error(number * HORIZON_S, 1.0 - 0.05**region.factor**2), HORIZON_S)
    assert region.factor < 1.1


def test_what_was_not_judged_or_has_no_region_teaches_nothing() -> None:
    region = RegionFactor(1.3, 100.0, 0)
    assert region.updated_by_error(error(40, None), HORIZON_S) is region
    assert region.updated_by_error(error(40, 0.0, moved=True), HORIZON_S) is region
    track = np.zeros((HORIZON_S + 1, 3))
    bare = Prediction(pd.Timestamp(0, tz="UTC"), "reference", track, None, None)
    assert region.widen_prediction(bare) is bare
    wide = region.widen_prediction(replace(bare, region_m=np.tile(np.arange(31.0)[:, None], 2)))
    assert wide.band_m == pytest.approx(1.3 * np.arange(31.0))
