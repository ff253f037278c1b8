"""The smoother against the Gaussian's conditional mean and variance, written out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import chi2

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.disturbance_model import FORCE_UNITS, DisturbanceNoise, smooth_state
from tests.hybrid.diagnosis.linear_by_hand import CALM_SEA, DISTURBANCES, a_ship, dense, one_column

EDGES = np.array([0, 9, 21])
UNIT = np.array([1.0] * 6 + FORCE_UNITS.tolist())


def conditional(noise: DisturbanceNoise, seen: Floats, drive: Floats, seed: int) -> tuple[Floats, Floats]:
    """Means and variances [T, 9] given all samples of each block.

    States are L w with w of unit variance and known by I + L'C'R^-1 C L, with L a root of their
    covariance: so written no digits cancel.
    """
    linear, means, variances = a_ship(len(seen), seed), [], []
    for first, last in itertools.pairwise(EDGES):
        rows = slice(int(first), int(last))
        block = dense(linear, noise, rows)
        there, along = np.isfinite(seen[rows]).ravel(), block.driven(drive[rows])
        sight = (block.C @ block.root)[there] / np.sqrt(block.R[there])[:, None]
        off = ((np.where(there, seen[rows].ravel(), 0.0) - block.C @ along)[there]) / np.sqrt(block.R[there])
        spread = block.root @ np.linalg.inv(np.eye(len(block.root)) + sight.T @ sight)
        means.append((along + spread @ sight.T @ off).reshape(last - first, -1)[:, :9] * UNIT)
        variances.append((spread * block.root).sum(axis=1).reshape(last - first, -1)[:, :9] * UNIT**2)
    return np.concatenate(means), np.concatenate(variances)


@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("noise", DISTURBANCES.values(), ids=DISTURBANCES)
def test_motion_and_force_are_the_conditional_mean_and_variance(noise: DisturbanceNoise, missing: float) -> None:
    random = np.random.default_rng(11)
    seen, drive = 0.3 * random.standard_normal((21, 6)), 0.02 * random.standard_normal((21, 6))
    seen[random.random((21, 6)) < missing] = np.nan
    mean, variance = smooth_state(a_ship(21, 11), one_column(seen, drive), noise, EDGES)
    expected_mean, expected_variance = conditional(noise, seen, drive, 11)
    np.testing.assert_allclose(variance, expected_variance, rtol=2e-3)  # a start that is free costs digits
    deviation = np.sqrt(expected_variance)
    np.testing.assert_allclose(mean / deviation, expected_mean / deviation, rtol=1e-4, atol=1e-3)


def test_a_second_without_any_sample_is_uncertain_and_still_told() -> None:
    random = np.random.default_rng(12)
    seen = 0.1 * random.standard_normal((21, 6))
    _, whole = smooth_state(a_ship(21, 12), one_column(seen), CALM_SEA, EDGES)
    seen[14] = np.nan
    mean, holed = smooth_state(a_ship(21, 12), one_column(seen), CALM_SEA, EDGES)
    assert (holed[14, :6] > whole[14, :6]).all()
    assert np.isfinite(mean).all()


def test_a_force_that_acts_is_found_at_its_size() -> None:
    """A slow force of the size that the noise says, and a ship that is measured exactly: it shows."""
    noise = DisturbanceNoise(
        position_m=1e-3, heading_rad=1e-5, surge_mps=1e-4, sway_mps=1e-4, yaw_rate_radps=1e-6,
        gust=(1.0, 1.0, 10.0), slow=(2000.0, 2000.0, 20000.0), slow_s=100.0,
    )  # fmt: skip
    linear, force = a_ship(40, 13), np.array([1500.0, -1000.0, 12000.0])
    x, seen = np.zeros(6), np.empty((40, 6))
    for k in range(40):
        seen[k] = linear.H[k] @ x
        x = linear.A[k] @ x + linear.B[k] @ force
    mean, variance = smooth_state(linear, one_column(seen), noise, np.array([0, 40]))
    off = (mean[5:35, 6:] - force) / np.sqrt(variance[5:35, 6:])
    np.testing.assert_allclose(mean[5:35, 6:], np.tile(force, (30, 1)), rtol=0.1)
    assert (off**2).mean(axis=0).max() < chi2.ppf(0.9999, 1)
