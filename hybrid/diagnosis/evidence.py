"""What the whitened data say of effects: all of it linear algebra on the products of the filter's columns.

Data z, signatures S and nuisances N (the tolerance granted to the model and to each sensor), all whitened, give

    z = S a + N b + e,  e ~ N(0, I),  b ~ N(0, I),  so that  z - S a ~ N(0, V),  V = I + N N'

Everything that follows needs inner products under the inverse of V only (Woodbury), and these follow from the
products of all columns, added up leg by leg. What leaves some legs out subtracts theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from acquisition.core.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class Products:
    """Products of all whitened columns, leg by leg [L, C, C]; ``rows`` [L] counts the samples behind them."""

    legs: Floats
    rows: Ints

    @property
    def total(self) -> Floats:
        """Of all legs [C, C]."""
        return np.asarray(self.legs.sum(axis=0))


def reduced(products: Floats, kept: Ints, nuisance: Ints, scale: Floats) -> tuple[Floats, float]:
    """Inner products under the inverse of V of the columns ``kept`` [K, K], and the logarithm of V's determinant.

    ``scale`` [n] is the standard deviation of each column in ``nuisance``.
    """
    if not nuisance.size:
        return products[np.ix_(kept, kept)], 0.0
    inner = products[np.ix_(nuisance, nuisance)] * np.outer(scale, scale)
    inner[np.diag_indices_from(inner)] += 1.0
    factor = cho_factor(inner, lower=True, check_finite=False)
    cross = products[np.ix_(nuisance, kept)] * scale[:, None]
    half = solve_triangular(factor[0], cross, lower=True, check_finite=False)
    determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return products[np.ix_(kept, kept)] - half.T @ half, determinant


@dataclass(frozen=True, slots=True)
class Fit:
    """A joint fit of some columns: values and covariance, and how much of z' V^-1 z they explain."""

    columns: tuple[int, ...]
    values: Floats
    covariance: Floats
    gain: float


def fitted(inner: Floats, columns: Sequence[int], prior: Floats | None = None) -> Fit:
    """The fit of ``columns`` to column 0 under reduced products; ``prior`` are standard deviations about zero."""
    index = np.array(columns, dtype=int)
    information = inner[np.ix_(index, index)].copy()
    if prior is not None:
        information[np.diag_indices_from(information)] += prior**-2.0
    right = inner[index, 0]
    if not index.size:
        return Fit((), np.zeros(0), np.zeros((0, 0)), 0.0)
    factor = cho_factor(information + 1e-12 * np.diag(np.diag(information)), check_finite=False)
    values = cho_solve(factor, right)
    return Fit(tuple(columns), values, cho_solve(factor, np.eye(len(index))), float(right @ values))


def drawn(inner: Floats, columns: Sequence[int], prior: Floats, seed: int) -> Floats:
    """One draw of ``columns`` from what the data and the prior leave possible.

    What is left of the data when a draw is taken off has the noise's own size; with the likeliest values taken off
    it would be too small by what they fit of the noise.
    """
    index = np.array(columns, dtype=int)
    information = inner[np.ix_(index, index)].copy()
    information[np.diag_indices_from(information)] += prior**-2.0
    lower = np.linalg.cholesky(information)
    half = solve_triangular(lower, inner[index, 0], lower=True, check_finite=False)
    chance = np.random.default_rng(seed).standard_normal(len(index))
    return np.asarray(solve_triangular(lower, half + chance, lower=True, trans="T", check_finite=False))


def log_evidence(inner: Floats, columns: Sequence[int], prior: Floats) -> float:
    """Log odds of ``columns`` present, with normal priors, against none: half the gain less Occam's term."""
    index = np.array(columns, dtype=int)
    if not index.size:
        return 0.0
    scaled = inner[np.ix_(index, index)] * np.outer(prior, prior)
    scaled[np.diag_indices_from(scaled)] += 1.0
    right = inner[index, 0] * prior
    factor = np.linalg.cholesky(scaled)
    half = solve_triangular(factor, right, lower=True, check_finite=False)
    return float(0.5 * half @ half - np.log(np.diag(factor)).sum())
