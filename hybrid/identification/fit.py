"""Maximum a posteriori coefficients from all segments.

What belongs to a single segment, its start and the forces that the model lacks, is marginalised in closed form;
the rest is fitted by Levenberg-Marquardt steps, after each of which the levels of noise and missing forces are
estimated anew. Our own steps are needed, as in the adaptive calibrator, because starts and unknowns must move
together: with the starts fixed, ``scipy.optimize.least_squares`` oscillates between the two.

The residual of a segment is r = Z b + e: b are the deviation of its start and the forces that the model lacks,
e the sensors' white noise, so r has covariance V = Z D Z' + R (mixed models, Laird and Ware 1982). Only the Q
by Q matrix of Woodbury's identity is inverted, never one of V's size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.optimize import minimize

from seatrial.acquisition.core.errors import ModelRangeError, Progress, part_of
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.identification.response import PARTS, ResponseModel

START_VARIANCE = 1.0
"""The prior variance of a start's deviation, in units of ``start_scale`` squared: the start is free."""

_LEAST, _MOST_NOISE, _MOST_FORCE = 1e-10, 1e6, 10.0
"""Bounds of the variances in the search."""

_ROUNDING = 1e-12
"""A share of the diagonal that exceeds rounding errors and keeps matrices positive definite."""


@dataclass(frozen=True, slots=True)
class Variances:
    """Variances: ``noise`` [6] of the sensors in SI, and ``forces`` [2, 3] of the missing force over a whole
    segment and in each part of it, in surge, sway and yaw, in the squared units of the slopes."""

    noise: Floats
    forces: Floats

    @property
    def variances(self) -> Floats:
        """The variances of all unknowns of a segment [6 + 3 + 3 PARTS]."""
        return np.concatenate([np.full(6, START_VARIANCE), self.forces[0], np.repeat(self.forces[1], PARTS)])


@dataclass(frozen=True, slots=True)
class Moments:
    """Moments of each segment and channel: Z'Z [S, 6, Q, Q], Z'r [S, 6, Q], r'r [S, 6] and their number [S, 6]."""

    squares: Floats
    products: Floats
    total: Floats
    count: Floats

    def explained(self, levels: Variances) -> tuple[Floats, Floats, Floats]:
        """The estimated unknowns [S, Q], their covariance [S, Q, Q], and minus twice the log likelihood of each
        segment [S]."""
        weight, scale = 1.0 / levels.noise, np.sqrt(levels.variances)
        information = np.einsum("scqp,c->sqp", self.squares, weight) * np.outer(scale, scale) + np.eye(len(scale))
        information[:, range(len(scale)), range(len(scale))] *= 1.0 + _ROUNDING
        factor = np.linalg.inv(np.linalg.cholesky(information)) * scale
        covariance = factor.transpose(0, 2, 1) @ factor
        spoken = np.einsum("scq,c->sq", self.products, weight)
        unknowns = (covariance @ spoken[..., None])[..., 0]
        determinant = 2.0 * np.log(scale / np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        cost = self.residual_squares(unknowns) @ weight + (unknowns**2 / levels.variances).sum(axis=1) + determinant
        return unknowns, covariance, cost + self.count @ np.log(levels.noise)

    def residual_squares(self, unknowns: Floats) -> Floats:
        """The sums of squares [S, 6] left by the unknowns [S, Q]; unlike r'r less what is explained, never
        negative by rounding."""
        bent = np.einsum("scqp,sp->scq", self.squares, unknowns) - 2.0 * self.products
        return np.asarray(np.maximum(self.total + np.einsum("scq,sq->sc", bent, unknowns), 0.0))


def moments_of(residual: Floats, slopes: Floats) -> Moments:
    """Moments of the ``residual`` [S, T, 6], NaN without measurement, and ``slopes`` [S, T, 6, Q]."""
    finite = np.isfinite(residual)
    Z = np.ascontiguousarray(np.where(finite[..., None], slopes, 0.0).transpose(0, 2, 1, 3))
    r = np.where(finite, residual, 0.0).transpose(0, 2, 1)
    turned = Z.transpose(0, 1, 3, 2)
    return Moments(turned @ Z, (turned @ r[..., None])[..., 0], (r**2).sum(axis=2), finite.sum(axis=1))


def estimate_levels(moments: Moments, first: Variances) -> Variances:
    """The maximum-likelihood levels of all segments' residuals.

    By L-BFGS on the logarithms of the variances; expectation maximisation has the same gradient but is slow
    where a level tends to zero.
    """
    most = [_MOST_NOISE] * first.noise.size + [_MOST_FORCE] * first.forces.size
    bounds = [(log(_LEAST), log(limit)) for limit in most]
    begin = np.log(np.append(first.noise, first.forces))
    optimum = minimize(_cost, begin, moments, jac=True, method="L-BFGS-B", bounds=bounds)
    return _levels(optimum.x)


def _levels(logs: Floats) -> Variances:
    return Variances(np.exp(logs[:6]), np.exp(logs[6:]).reshape(2, 3))


def _cost(logs: Floats, moments: Moments) -> tuple[float, Floats]:
    """Minus twice the log likelihood of log levels [12], and its gradient (Fisher's identity)."""
    levels = _levels(logs)
    unknowns, covariance, cost = moments.explained(levels)
    squares = moments.residual_squares(unknowns) + np.einsum("scqp,spq->sc", moments.squares, covariance)
    share = 1.0 - (unknowns**2 + np.einsum("sqq->sq", covariance)) / levels.variances
    by_noise = moments.count - squares / levels.noise
    parts = share[:, 9:].reshape(len(share), 3, PARTS).sum(axis=2)
    return float(cost.sum()), np.concatenate([by_noise, share[:, 6:9], parts], axis=1).sum(axis=0)


ROUNDS = 30
_ENOUGH = 0.1
"""The search ends when a step improves minus twice the log likelihood by less than this, or is expected to: the
optimum is then at most a third of the standard errors away."""

_TRIES = 8


@dataclass(frozen=True, slots=True)
class CoefficientFit:
    """The unknowns ``z`` [model.size] and their covariance, with the ``starts`` [S, 6] and levels."""

    z: Floats
    covariance: Floats
    starts: Floats
    levels: Variances


@dataclass(frozen=True, slots=True)
class _Place:
    """A point of the search, the residuals there [S, T, 6] and their derivatives with respect to each segment's
    own unknowns [S, T, 6, Q].

    ``costs`` [S] are minus twice the log likelihood of each segment, infinite where the model leaves its range.
    """

    z: Floats
    starts: Floats
    levels: Variances
    residual: Floats
    slopes: Floats
    moments: Moments
    costs: Floats

    @property
    def cost(self) -> float:
        """Minus twice the log of the posterior."""
        return float(self.costs.sum() + self.z @ self.z)


def first_levels(model: ResponseModel) -> Variances:
    """The start of the estimate of the levels, as shares of the usual motion and forces."""
    return Variances((0.01 * model.start_scale * [0.1, 0.1, 1.0, 1.0, 1.0, 1.0]) ** 2, np.full((2, 3), 1e-3))


def fit(
    model: ResponseModel,
    z: Floats | None = None,
    levels: Variances | None = None,
    rounds: int = ROUNDS,
    progress: Progress = lambda share: None,
) -> CoefficientFit:
    """The most likely unknowns of a model on its segments, starting from ``z`` or from the prior mean.

    From the prior mean the search first uses segments cut into parts: the shorter they are, the less a wrong
    model drifts from the measurements, and the closer to linear is the fit. Raises :class:`ModelRangeError` if
    the model cannot be simulated on them.
    """
    levels = levels or first_levels(model)
    if z is None:
        short = replace(model, segments=model.segments.split(PARTS))
        z = _search(short, np.zeros(model.size), levels, rounds, part_of(progress, 0, 2), near=model.size).z
    place = _search(model, z, levels, rounds, part_of(progress, 1, 2))
    information, scores, _ = _normal(model, place)
    return CoefficientFit(place.z, covariance_of(information, scores), place.starts, place.levels)


def _search(
    model: ResponseModel, z: Floats, levels: Variances, rounds: int, progress: Progress, near: float = _ENOUGH
) -> _Place:
    """The optimum, or a point whose next step is expected to gain less than ``near``."""
    now, damping, promise = _settled(model, _place(model, z, model.segments.start, levels)), 1e-3, np.inf
    for number in range(rounds):
        progress(number / rounds)
        before = now.cost
        now, damping, promise = _better(model, now, damping)
        if min(promise, before - now.cost) < near:
            break
        now = _with_levels(now)
    return now


def covariance_of(information: Floats, scores: Floats) -> Floats:
    """The covariance [P, P] of the unknowns, from the segments' information [S, P, P] and scores [S, P].

    If the model were exact, it would be the inverse curvature of the likelihood. What a model lacks is not
    white, so its effect is estimated by leaving out each segment in turn (jackknife, Efron and Stein 1981;
    cluster sandwich, Liang and Zeger 1986). The prior's share is added.
    """
    total = information.sum(axis=0) + np.eye(information.shape[-1])
    departures = np.linalg.solve(total - information, scores[..., None])[..., 0]
    inverse = np.linalg.inv(total)
    return np.asarray(departures.T @ departures + inverse @ inverse)


def _better(model: ResponseModel, now: _Place, damping: float) -> tuple[_Place, float, float]:
    """The point after the first step that improves, or the same point; the next damping; and the improvement
    expected if the problem were linear."""
    information, scores, columns = _normal(model, now)
    total, pull = information.sum(axis=0) + np.eye(model.size), scores.sum(axis=0) - now.z
    promise = float(pull @ np.linalg.solve(total, pull))
    for _ in range(_TRIES):
        damped = total + damping * np.diag(np.diag(total))
        step = np.linalg.solve(damped, pull)
        expected = columns @ step[model.own_unknowns][..., None]
        then = _moved(model, now, step, expected.reshape(now.residual.shape))
        if then.cost < now.cost:
            return then, max(damping / 5.0, 1e-6), promise
        damping *= 8.0
    return now, damping, promise


def _place(model: ResponseModel, z: Floats, starts: Floats, levels: Variances) -> _Place:
    seen, slopes = model.own_slopes(z, starts)
    inside = np.asarray(np.isfinite(slopes).all(axis=(1, 2, 3)))
    residual, slopes = np.where(inside[:, None, None], model.segments.measured - seen, 0.0), np.nan_to_num(slopes)
    moments = moments_of(residual, slopes)
    costs = np.where(inside, moments.explained(levels)[2], np.inf)
    return _Place(z, starts, levels, residual, slopes, moments, costs)


def _with_levels(place: _Place) -> _Place:
    """The same point with maximum-likelihood levels."""
    levels = estimate_levels(place.moments, place.levels)
    return replace(place, levels=levels, costs=place.moments.explained(levels)[2])


def _settled(model: ResponseModel, place: _Place) -> _Place:
    """The point with its levels and fitted starts."""
    if not np.isfinite(place.cost):
        raise ModelRangeError(
            "the model does not follow the recordings",
            why="it leaves its valid range",
            fix="check --vessel and units",
        )
    for _ in range(2):
        place = _with_levels(place)
        place = _moved(model, place, np.zeros(model.size), np.zeros_like(place.residual))
    return _with_levels(place)


def _moved(model: ResponseModel, place: _Place, step: Floats, expected: Floats) -> _Place:
    """The point after a step in the unknowns that is expected to change the reported motion by ``expected`` [S,
    T, 6], with the starts adjusted.

    Far from the optimum the derivatives of a segment may throw its start far off: then it is kept.
    """
    unknowns, _, _ = moments_of(place.residual - expected, place.slopes).explained(place.levels)
    z = place.z + step
    then = _place(model, z, place.starts + unknowns[:, :6] * model.start_scale, place.levels)
    if then.cost < place.cost:
        return then
    stay = _place(model, z, place.starts, place.levels)
    starts = np.where((stay.costs < then.costs)[:, None], stay.starts, then.starts)
    return _place(model, z, starts, place.levels)


def _normal(model: ResponseModel, place: _Place) -> tuple[Floats, Floats, Floats]:
    """Each segment's information on the unknowns [S, P, P], its score [S, P], and the derivatives [S, 6 T, p]
    with respect to the p of them that it depends on, :attr:`ResponseModel.own_unknowns`."""
    columns = model.slopes(place.z, place.starts)
    weight = np.isfinite(place.residual) / np.sqrt(place.levels.noise)
    C, Z, r = (_weighted(array, weight) for array in (columns, place.slopes, np.nan_to_num(place.residual)))
    turned, segments, unknown = C.transpose(0, 2, 1), len(C), model.own_unknowns
    shared = turned @ Z
    taken = shared @ place.moments.explained(place.levels)[1]
    row, size = np.arange(segments)[:, None], model.size
    information, scores = np.zeros((segments, size, size)), np.zeros((segments, size))
    information_left = turned @ C - taken @ shared.transpose(0, 2, 1)
    information[row[..., None], unknown[:, :, None], unknown[:, None, :]] = information_left
    scores[row, unknown] = (turned @ r - taken @ (Z.transpose(0, 2, 1) @ r))[..., 0]
    return information, scores, columns.reshape(C.shape)


def _weighted(values: Floats, weight: Floats) -> Floats:
    """Values [S, T, 6] or [S, T, 6, n] times weights [S, T, 6], as one matrix for each segment [S, 6 T, n]."""
    segments = len(values)
    return np.asarray(values.reshape(segments, weight[0].size, -1) * weight.reshape(segments, -1, 1))


def information_at(model: ResponseModel, z: Floats, starts: Floats, levels: Variances) -> Floats:
    """The expected information of segments on all unknowns [P, P]; NaN if the model leaves its range."""
    place = _place(model, z, starts, levels)
    if not np.isfinite(place.cost):
        return np.full((model.size, model.size), np.nan)
    return np.asarray(_normal(model, place)[0].sum(axis=0))
