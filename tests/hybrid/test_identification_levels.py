"""The likelihood of what is left of segments: its value, and the levels that make it largest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.identification.fit import PARTS, Variances, estimate_levels, moments_of

OWN = 9 + 3 * PARTS
TRUE = Variances(
    np.array([0.3, 0.2, 0.02, 0.1, 0.1, 0.03]) ** 2, np.array([[0.4, 0.2, 0.3], [0.1, 0.5, 0.05]]) ** 2
)


def drawn(segments: int, times: int, seed: int = 0) -> tuple[Floats, Floats]:
    """What is left of segments of the mixed model at the true levels [S, T, 6], and its slopes [S, T, 6, OWN]."""
    generator = np.random.default_rng(seed)
    slopes = generator.standard_normal((segments, times, 6, OWN))
    own = generator.standard_normal((segments, OWN)) * np.sqrt(TRUE.prior_variances)
    noise = generator.standard_normal((segments, times, 6)) * np.sqrt(TRUE.noise)
    return np.einsum("stcq,sq->stc", slopes, own) + noise, slopes


def test_the_cost_is_that_of_the_whole_covariance() -> None:
    left, slopes = drawn(3, 4)
    left[1, 2, 3] = left[2, 0] = np.nan
    cost = moments_of(left, slopes).estimate_unknowns(TRUE)[2]
    for each, Z, found in zip(left, slopes, cost, strict=True):
        known = np.isfinite(each).ravel()
        Z_known = Z.reshape(-1, OWN)[known]
        V = Z_known @ np.diag(TRUE.prior_variances) @ Z_known.T + np.diag(np.tile(TRUE.noise, 4)[known])
        likelihood = multivariate_normal(np.zeros(len(V)), V).logpdf(each.ravel()[known])
        assert found == pytest.approx(-2.0 * likelihood - len(V) * np.log(2.0 * np.pi), rel=1e-9)


def test_levels_are_those_that_the_data_were_drawn_with() -> None:
    left, slopes = drawn(300, 20)
    found = estimate_levels(moments_of(left, slopes), Variances(np.full(6, 1e-2), np.full((2, 3), 1e-3)))
    assert np.sqrt(found.noise) == pytest.approx(np.sqrt(TRUE.noise), rel=0.05)
    assert np.sqrt(found.forces) == pytest.approx(np.sqrt(TRUE.forces), rel=0.2)


def test_no_levels_nearby_are_more_likely() -> None:
    moments = moments_of(*drawn(40, 8, seed=1))
    found = estimate_levels(moments, TRUE)
    best = moments.estimate_unknowns(found)[2].sum()
    for factor in (0.9, 1.1):
        for number in range(6):
            noise = found.noise * np.where(np.arange(6) == number, factor, 1.0)
            assert moments.estimate_unknowns(Variances(noise, found.forces))[2].sum() > best
            forces = found.forces * np.where(np.arange(6) == number, factor, 1.0).reshape(2, 3)
            assert moments.estimate_unknowns(Variances(found.noise, forces))[2].sum() >= best - 1e-3
