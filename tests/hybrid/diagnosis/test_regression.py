"""Sums over the filter's columns against direct inversion, numerical integration and repeated draws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import dblquad, quad

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.regression import draw_columns, fit_columns, log_evidence, marginalise

ROWS = 60


def whitened_columns(seed: int, count: int) -> Floats:
    """Columns [60, count] that have much in common."""
    random = np.random.default_rng(seed)
    mixing = np.eye(count) + 0.5 * random.standard_normal((count, count))
    return np.asarray(random.standard_normal((ROWS, count)) @ mixing)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 12), st.integers(-3, 3))
def test_reduced_is_the_inner_product_under_the_inverse_of_v(seed: int, nuisances: int, size: int) -> None:
    kept, columns = 4, whitened_columns(seed, 4 + nuisances)
    scale = 10.0**size * np.random.default_rng(seed).uniform(0.5, 2.0, nuisances)
    N = columns[:, kept:] * scale
    V = np.eye(ROWS) + N @ N.T
    inner, log_determinant = marginalise(
        columns.T @ columns, np.arange(kept), np.arange(kept, kept + nuisances), scale
    )
    expected = columns[:, :kept].T @ np.linalg.solve(V, columns[:, :kept])
    np.testing.assert_allclose(inner, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    assert log_determinant == pytest.approx(float(np.linalg.slogdet(V)[1]), abs=1e-5)


def test_a_nuisance_without_bounds_takes_its_own_shape_away() -> None:
    columns = whitened_columns(1, 4)
    inner, _ = marginalise(columns.T @ columns, np.array([0, 1]), np.array([2, 3]), np.array([1e5, 1e5]))
    free = columns[:, 2:]
    left = columns[:, :2] - free @ np.linalg.lstsq(free, columns[:, :2], rcond=None)[0]
    np.testing.assert_allclose(inner, left.T @ left, rtol=1e-6)


def test_fitted_is_generalised_least_squares() -> None:
    columns, scale = whitened_columns(2, 8), np.array([0.5, 1.0, 2.0, 0.3])
    V = np.eye(ROWS) + (columns[:, 4:] * scale**2) @ columns[:, 4:].T
    inner, _ = marginalise(columns.T @ columns, np.arange(4), np.arange(4, 8), scale)
    fit = fit_columns(inner, (3, 1))
    S, z = columns[:, [3, 1]], columns[:, 0]
    covariance = np.linalg.inv(S.T @ np.linalg.solve(V, S))
    values = covariance @ S.T @ np.linalg.solve(V, z)
    np.testing.assert_allclose(fit.values, values, rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-8)
    left = z - S @ values
    explained = z @ np.linalg.solve(V, z) - left @ np.linalg.solve(V, left)
    assert fit.gain == pytest.approx(float(explained), rel=1e-8)


def test_a_prior_is_as_good_as_so_many_measurements_of_zero() -> None:
    columns, prior = whitened_columns(3, 3), np.array([0.2, 3.0])
    fit = fit_columns(columns.T @ columns, (1, 2), prior)
    rows = np.vstack([columns, np.column_stack([np.zeros(2), np.diag(1.0 / prior)])])
    again = fit_columns(rows.T @ rows, (1, 2))
    np.testing.assert_allclose(fit.values, again.values, rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, again.covariance, rtol=1e-9)


@pytest.mark.parametrize("rounding", [0.0, 1e-10, 1e-8, 1e-5])
def test_columns_that_are_alike_share_what_they_explain(rounding: float) -> None:
    """Rounding may leave the information of three alike a little less than none; the gain is that of one."""
    columns = whitened_columns(4, 2)
    both = np.column_stack([columns, columns[:, 1], columns[:, 1]])
    inner = both.T @ both
    inner[1, 2] = inner[2, 1] = inner[1, 2] * (1.0 + rounding)
    fit = fit_columns(inner, (1, 2, 3))
    assert fit.gain == pytest.approx(fit_columns(columns.T @ columns, (1,)).gain, rel=1e-3)


def test_nothing_fitted_explains_nothing() -> None:
    inner = np.eye(3)
    assert fit_columns(inner, ()).gain == 0.0
    assert log_evidence(inner, (), np.zeros(0)) == 0.0


def test_inner_products_that_no_columns_can_have_have_no_evidence() -> None:
    inner = np.array([[1.0, 0.1, 0.1], [0.1, 1.0, 9.0], [0.1, 9.0, 1.0]])
    with pytest.raises(np.linalg.LinAlgError):
        log_evidence(inner, (1, 2), np.ones(2))


def ratio(inner: Floats, column: tuple[int, ...], values: tuple[float, ...], prior: Floats) -> float:
    """Likelihood of these values over that of none, times their prior density."""
    a = np.array(values)
    say = a @ inner[list(column), 0] - 0.5 * a @ inner[np.ix_(column, column)] @ a
    density = np.exp(-0.5 * ((a / prior) ** 2).sum()) / np.prod(np.sqrt(2.0 * np.pi) * prior)
    return float(np.exp(say) * density)


@pytest.mark.parametrize("prior", [0.05, 0.5, 3.0])
def test_evidence_of_one_number_is_the_integral_over_it(prior: float) -> None:
    columns = whitened_columns(4, 2) / 5.0
    inner, sizes = columns.T @ columns, np.array([prior])
    integral, _ = quad(lambda a: ratio(inner, (1,), (a,), sizes), -12 * prior, 12 * prior, limit=200, points=[0.0])
    assert log_evidence(inner, (1,), sizes) == pytest.approx(np.log(integral), abs=1e-6)


def test_evidence_of_two_numbers_is_the_integral_over_both() -> None:
    columns, prior = whitened_columns(5, 3) / 5.0, np.array([0.4, 1.2])
    inner = columns.T @ columns
    integral, _ = dblquad(
        lambda b, a: ratio(inner, (1, 2), (a, b), prior), -8 * prior[0], 8 * prior[0], -8 * prior[1], 8 * prior[1],
        epsabs=1e-9, epsrel=1e-6,
    )  # fmt: skip
    assert log_evidence(inner, (1, 2), prior) == pytest.approx(np.log(integral), abs=1e-4)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(1e-4, 1e4))
def test_evidence_does_not_know_the_unit_of_a_parameter(seed: int, unit: float) -> None:
    columns, prior = whitened_columns(seed, 4), np.array([0.5, 2.0, 0.1])
    before = log_evidence(columns.T @ columns, (1, 2, 3), prior)
    columns[:, 2] *= unit
    after = log_evidence(columns.T @ columns, (1, 2, 3), prior / np.array([1.0, unit, 1.0]))
    assert after == pytest.approx(before, rel=1e-8, abs=1e-8)


def test_draws_scatter_as_the_posterior() -> None:
    columns, prior = whitened_columns(6, 4) / 4.0, np.array([0.7, 0.2, 1.5])
    inner = columns.T @ columns
    fit = fit_columns(inner, (1, 2, 3), prior)
    draws = np.array([draw_columns(inner, (1, 2, 3), prior, seed) for seed in range(4000)])
    deviation = np.sqrt(np.diag(fit.covariance))
    assert np.abs((draws.mean(axis=0) - fit.values) / deviation).max() < 4.0 / np.sqrt(4000)
    scatter = np.cov(draws.T) / np.outer(deviation, deviation)
    np.testing.assert_allclose(scatter, fit.covariance / np.outer(deviation, deviation), atol=0.1)
    assert np.array_equal(draws[3], draw_columns(inner, (1, 2, 3), prior, 3))
