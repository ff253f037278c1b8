"""The filter against the joint Gaussian of a whole block, and as what it is: linear, and white."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.disturbance_model import FORCE_UNITS, Columns, DisturbanceNoise, columns_of, whiten
from seatrial.hybrid.diagnosis.linearise import Signature
from tests.conftest import nightly
from tests.hybrid.diagnosis.linear_by_hand import CALM_SEA, DISTURBANCES, SWELL, a_ship, dense, drawn, one_column

EDGES = np.array([0, 9, 21])


def any_columns(seed: int, count: int = 3, features: int = 2, missing: float = 0.0) -> Columns:
    """Columns of any kind; samples are missing from the data, column 0."""
    random, seconds = np.random.default_rng(seed), int(EDGES[-1])
    seen = random.standard_normal((seconds, 6, count))
    seen[random.random((seconds, 6)) < missing, 0] = np.nan
    drive = 0.1 * random.standard_normal((seconds, 6, count))
    return Columns(drive, seen, random.standard_normal((seconds, features)))


def explained(noise: DisturbanceNoise, columns: Columns, seed: int) -> tuple[Floats, float]:
    """Products of columns under the inverse covariance of what was seen, and the log of its determinant."""
    linear, forces = a_ship(int(EDGES[-1]), seed), np.zeros((int(EDGES[-1]), 6, 0))
    for axis in range(3):  # a force feature acts on the ship as the data would show it: minus in what is taken off
        forces = np.concatenate(
            [forces, -(linear.B[:, :, axis] * FORCE_UNITS[axis])[:, :, None] * columns.features[:, None]], 2
        )
    drive = np.concatenate([columns.drive, forces], axis=2)
    seen = np.concatenate([columns.readings, np.zeros_like(forces)], axis=2)
    gram, log_determinant = np.zeros((drive.shape[2],) * 2), 0.0
    for first, last in itertools.pairwise(EDGES):
        rows = slice(int(first), int(last))
        block = dense(linear, noise, rows)
        off = seen[rows].reshape(-1, drive.shape[2]) - block.C @ block.driven(drive[rows])
        there = np.isfinite(off[:, 0])
        covariance = block.seen_covariance[np.ix_(there, there)]
        gram += off[there].T @ np.linalg.solve(covariance, off[there])
        log_determinant += float(np.linalg.slogdet(covariance)[1])
    return gram, log_determinant


@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("sea", DISTURBANCES)
def test_products_and_likelihood_are_those_of_the_joint_gaussian(sea: str, missing: float) -> None:
    columns = any_columns(5, missing=missing)
    z, spread = whiten(a_ship(21, 5), columns, DISTURBANCES[sea], EDGES)
    gram, log_determinant = explained(DISTURBANCES[sea], columns, 5)
    flat = z.reshape(-1, columns.count)
    np.testing.assert_allclose(flat.T @ flat, gram, rtol=1e-6, atol=1e-6 * np.abs(gram).max())
    assert np.log(spread).sum() == pytest.approx(log_determinant, rel=1e-8)


def test_a_sample_that_is_missing_leaves_a_zero_and_no_spread() -> None:
    columns = any_columns(1, missing=0.4)
    z, spread = whiten(a_ship(21, 1), columns, CALM_SEA, EDGES)
    missing = np.isnan(columns.readings[:, :, 0])
    assert not z[missing].any()
    assert (spread[missing] == 1.0).all()


def test_columns_superpose() -> None:
    columns, linear = any_columns(2), a_ship(21, 2)
    mixed = np.array([0.7, -2.0, 30.0])
    together = one_column(columns.readings @ mixed, columns.drive @ mixed)
    z, _ = whiten(linear, columns, SWELL, EDGES)
    np.testing.assert_allclose(whiten(linear, together, SWELL, EDGES)[0][:, :, 0], z[:, :, :3] @ mixed, atol=1e-8)


def test_an_effect_of_its_own_size_in_the_data_is_its_column() -> None:
    """Data that are what an effect of size a does to drives and sensors whiten to a times the effect's column."""
    linear, random, size = a_ship(21, 3), np.random.default_rng(3), 1.7
    effect = Signature("any", 0, 0.01 * random.standard_normal((21, 6)), random.standard_normal((21, 6)))
    linear.defect[:], linear.observed[:] = -size * effect.D, size * effect.E
    z, _ = whiten(linear, columns_of(linear, [effect]), SWELL, EDGES)
    np.testing.assert_allclose(z[:, :, 0], size * z[:, :, 1], atol=1e-9)


def test_a_force_feature_is_the_effect_of_such_a_force() -> None:
    linear, shape = a_ship(21, 4), np.random.default_rng(4).standard_normal((21, 1))
    forces = [Signature(axis, 0, linear.B[:, :, i] * FORCE_UNITS[i] * shape, np.zeros((21, 6)))
              for i, axis in enumerate(("surge", "sway", "yaw"))]  # fmt: skip
    z, _ = whiten(linear, columns_of(linear, forces, shape), CALM_SEA, EDGES)
    np.testing.assert_allclose(z[:, :, 4:], z[:, :, 1:4], atol=1e-10)


def test_blocks_know_nothing_of_each_other() -> None:
    columns, linear = any_columns(6), a_ship(21, 6)
    z, _ = whiten(linear, columns, CALM_SEA, EDGES)
    columns.readings[:9] += 5.0
    columns.drive[8] += 7.0  # the last second of a block drives nothing
    moved, _ = whiten(linear, columns, CALM_SEA, EDGES)
    assert np.array_equal(moved[9:], z[9:])
    assert not np.allclose(moved[:9], z[:9])


def long_drawn(noise: DisturbanceNoise, seed: int, blocks: int = 24) -> tuple[Floats, NDArray[np.int64]]:
    """Whitened data of so many blocks of a minute, drawn from exactly the system."""
    edges = 60 * np.arange(blocks + 1)
    linear = a_ship(60 * blocks, seed)
    return whiten(linear, drawn(linear, noise, edges, seed), noise, edges)[0][:, :, 0], edges


@pytest.mark.parametrize(
    "sea", ["all", "swell", *nightly(*(sea for sea in DISTURBANCES if sea not in ("all", "swell")))]
)
def test_data_from_the_system_itself_come_out_white(sea: str) -> None:
    z, edges = long_drawn(DISTURBANCES[sea], 7)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], z.size)
    assert low < (z**2).sum() < high
    for channel in range(6):
        assert 0.85 < z[:, channel].var() < 1.15  # five standard errors
    inside = np.ones(len(z) - 1, dtype=bool)
    inside[edges[1:-1] - 1] = False
    together = z[:-1][inside].T @ z[1:][inside] / np.sqrt(inside.sum())
    assert np.abs(together).max() < 4.5  # each is standard normal; 36 of them
    same = z.T @ z / np.sqrt(len(z))
    assert np.abs(same[np.triu_indices(6, 1)]).max() < 4.5


def test_another_sea_than_the_filter_believes_in_is_noticed() -> None:
    """The whiteness test itself can fail: waves that the filter does not know of."""
    edges = 60 * np.arange(11)
    linear = a_ship(600, 8)
    z, _ = whiten(linear, drawn(linear, SWELL, edges, 8), CALM_SEA, edges)
    assert (z[:, :, 0] ** 2).sum() > chi2.ppf(1.0 - 1e-9, z.size)
