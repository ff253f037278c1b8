"""Coefficients by the likelihood of all segments beside their priors.

What a segment has to itself, its start and the forces that the model lacks, is taken out of the likelihood in
closed form; for what is left the steps are Levenberg's and Marquardt's, after each of which the levels of noise and
of lacking forces are drawn up anew. They are ours, as in the adaptive calibrator, because starts and unknowns move
together in a step: with the starts held, ``scipy.optimize.least_squares`` goes to and fro between the two.

What is left of a segment at some coefficients is r = Z b + e: b are the departures of its start and the forces that
the model lacks, e the sensors' white noise, so that r has the covariance V = Z D Z' + R (of such mixed models Laird
and Ware 1982). Nothing of V's size is ever inverted, but the Q by Q matrix that Woodbury's identity asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.optimize import minimize

from acquisition.core.arrays import Floats
from acquisition.core.errors import ModelRangeError
from acquisition.core.progress import Progress, part_of
from hybrid.identification.response import PARTS, Model

START_VARIANCE = 1.0
"""Of a start's departure, in the squared units of :attr:`Model.start_scale`: the start is free."""

_LEAST, _MOST_NOISE, _MOST_FORCE = 1e-10, 1e6, 10.0
"""Variances between which levels are looked for: what a search may try on its way must still be numbers."""

_ROUNDING = 1e-12
"""Of a diagonal, more than what rounding of sums takes off: a trial far out is then still positive definite."""


@dataclass(frozen=True, slots=True)
class Levels:
    """``noise`` [6], the sensors' variances in SI, and ``forces`` [2, 3]: those of the force that the model lacks
    in a whole segment and in each part of it, ahead, aside and in yaw, in the squared units of the slopes.
    """

    noise: Floats
    forces: Floats

    @property
    def own(self) -> Floats:
        """The variances of all unknowns of a segment [6 + 3 + 3 PARTS]."""
        return np.concatenate([np.full(6, START_VARIANCE), self.forces[0], np.repeat(self.forces[1], PARTS)])


@dataclass(frozen=True, slots=True)
class Moments:
    """Of what each segment and channel knows: Z'Z [S, 6, Q, Q], Z'r [S, 6, Q], r'r [S, 6] and how many [S, 6]."""

    squares: Floats
    products: Floats
    total: Floats
    count: Floats

    def explained(self, levels: Levels) -> tuple[Floats, Floats, Floats]:
        """The unknowns [S, Q] that the data speak for, their covariance [S, Q, Q], and minus twice the log
        likelihood of each segment [S].
        """
        weight, scale = 1.0 / levels.noise, np.sqrt(levels.own)
        information = np.einsum("scqp,c->sqp", self.squares, weight) * np.outer(scale, scale) + np.eye(len(scale))
        information[:, range(len(scale)), range(len(scale))] *= 1.0 + _ROUNDING
        factor = np.linalg.inv(np.linalg.cholesky(information)) * scale
        covariance = factor.transpose(0, 2, 1) @ factor
        spoken = np.einsum("scq,c->sq", self.products, weight)
        own = (covariance @ spoken[..., None])[..., 0]
        determinant = 2.0 * np.log(scale / np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        cost = self.rest(own) @ weight + (own**2 / levels.own).sum(axis=1) + determinant
        return own, covariance, cost + self.count @ np.log(levels.noise)

    def rest(self, own: Floats) -> Floats:
        """The squares that the unknowns [S, Q] leave [S, 6]: unlike r'r less what is explained, never too small."""
        bent = np.einsum("scqp,sp->scq", self.squares, own) - 2.0 * self.products
        return np.asarray(np.maximum(self.total + np.einsum("scq,sq->sc", bent, own), 0.0))


def moments_of(left: Floats, slopes: Floats) -> Moments:
    """Those of what is ``left`` [S, T, 6], NaN where nothing was measured, and its ``slopes`` [S, T, 6, Q]."""
    known = np.isfinite(left)
    Z = np.ascontiguousarray(np.where(known[..., None], slopes, 0.0).transpose(0, 2, 1, 3))
    r = np.where(known, left, 0.0).transpose(0, 2, 1)
    turned = Z.transpose(0, 1, 3, 2)
    return Moments(turned @ Z, (turned @ r[..., None])[..., 0], (r**2).sum(axis=2), known.sum(axis=1))


def estimate_levels(moments: Moments, first: Levels) -> Levels:
    """The levels under which what is left of all segments is the most likely.

    L-BFGS on the logarithms of the variances. Expectation and maximisation have the same slopes and creep where a
    level goes to nought.
    """
    most = [_MOST_NOISE] * first.noise.size + [_MOST_FORCE] * first.forces.size
    bounds = [(log(_LEAST), log(each)) for each in most]
    begin = np.log(np.append(first.noise, first.forces))
    found = minimize(_cost, begin, moments, jac=True, method="L-BFGS-B", bounds=bounds)
    return _levels(found.x)


def _levels(logs: Floats) -> Levels:
    return Levels(np.exp(logs[:6]), np.exp(logs[6:]).reshape(2, 3))


def _cost(logs: Floats, moments: Moments) -> tuple[float, Floats]:
    """Minus twice the log likelihood of levels by their logarithms [12], and its slopes (Fisher's identity)."""
    levels = _levels(logs)
    own, covariance, cost = moments.explained(levels)
    rest = moments.rest(own) + np.einsum("scqp,spq->sc", moments.squares, covariance)
    share = 1.0 - (own**2 + np.einsum("sqq->sq", covariance)) / levels.own
    by_noise = moments.count - rest / levels.noise
    parts = share[:, 9:].reshape(len(share), 3, PARTS).sum(axis=2)
    return float(cost.sum()), np.concatenate([by_noise, share[:, 6:9], parts], axis=1).sum(axis=0)


ROUNDS = 30
_ENOUGH = 0.1
"""Where a step is less better than so much, in minus twice the log likelihood, or promises to be, the search ends:
the best place is then a third of the errors away, or less."""

_TRIES = 8


@dataclass(frozen=True, slots=True)
class Fit:
    """The unknowns ``z`` [model.size] and their covariance, the ``starts`` [S, 6] and the levels they are at.

    ``information`` [S, P, P] is what each segment says of the unknowns, ``scores`` [S, P] where it pulls them.
    """

    z: Floats
    covariance: Floats
    starts: Floats
    levels: Levels
    information: Floats
    scores: Floats


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the search is, what is left there [S, T, 6] and how it changes with each segment's own [S, T, 6, Q].

    ``costs`` [S] are minus twice the log likelihood of each segment, infinite where the model leaves its range.
    """

    z: Floats
    starts: Floats
    levels: Levels
    left: Floats
    slopes: Floats
    moments: Moments
    costs: Floats

    @property
    def cost(self) -> float:
        """Minus twice the log of the posterior."""
        return float(self.costs.sum() + self.z @ self.z)


def first_levels(model: Model) -> Levels:
    """Where the estimate of the levels begins: in shares of the usual motion and of the usual forces."""
    return Levels((0.01 * model.start_scale * [0.1, 0.1, 1.0, 1.0, 1.0, 1.0]) ** 2, np.full((2, 3), 1e-3))


def fit(
    model: Model,
    z: Floats | None = None,
    levels: Levels | None = None,
    rounds: int = ROUNDS,
    progress: Progress = lambda share: None,
) -> Fit:
    """The most likely unknowns of a model on its segments, from ``z`` on or from the priors' middle.

    From the middle the way leads over segments cut into parts: the shorter they are, the less a wrong model carries
    the ship away from what was measured, and the nearer to linear is the fit. Raises :class:`ModelRangeError` where
    the model cannot be simulated on them.
    """
    levels = levels or first_levels(model)
    if z is None:
        short = replace(model, segments=model.segments.split(PARTS))
        z = _search(short, np.zeros(model.size), levels, rounds, part_of(progress, 0, 2), near=model.size).z
    found = _search(model, z, levels, rounds, part_of(progress, 1, 2))
    information, scores, _ = _normal(model, found)
    covariance = covariance_of(information, scores)
    return Fit(found.z, covariance, found.starts, found.levels, information, scores)


def _search(
    model: Model, z: Floats, levels: Levels, rounds: int, progress: Progress, near: float = _ENOUGH
) -> _Place:
    """The best place, or one of which the next step promises to be less than ``near`` better."""
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
    """The covariance [P, P] of the unknowns, from what segments say of them [S, P, P] and where each pulls [S, P].

    That of the likelihood, if the levels were all there is, would be its inverse curvature. What a model lacks is
    not white: its effect is what the estimate varies by when each segment in turn is left out (the jackknife, Efron
    and Stein 1981, of the sandwich by clusters: Liang and Zeger 1986). To it comes the prior's share.
    """
    total = information.sum(axis=0) + np.eye(information.shape[-1])
    departures = np.linalg.solve(total - information, scores[..., None])[..., 0]
    inverse = np.linalg.inv(total)
    return np.asarray(departures.T @ departures + inverse @ inverse)


def _better(model: Model, now: _Place, damping: float) -> tuple[_Place, float, float]:
    """The place after the first step that helps, or the same place, the damping for the next step, and how much
    better the best place would be if all were linear.
    """
    information, scores, columns = _normal(model, now)
    total, pull = information.sum(axis=0) + np.eye(model.size), scores.sum(axis=0) - now.z
    promise = float(pull @ np.linalg.solve(total, pull))
    for _ in range(_TRIES):
        damped = total + damping * np.diag(np.diag(total))
        step = np.linalg.solve(damped, pull)
        expected = columns @ step[model.own_unknowns][..., None]
        then = _moved(model, now, step, expected.reshape(now.left.shape))
        if then.cost < now.cost:
            return then, max(damping / 5.0, 1e-6), promise
        damping *= 8.0
    return now, damping, promise


def _place(model: Model, z: Floats, starts: Floats, levels: Levels) -> _Place:
    seen, slopes = model.own_slopes(z, starts)
    inside = np.asarray(np.isfinite(slopes).all(axis=(1, 2, 3)))
    left, slopes = np.where(inside[:, None, None], model.segments.measured - seen, 0.0), np.nan_to_num(slopes)
    moments = moments_of(left, slopes)
    costs = np.where(inside, moments.explained(levels)[2], np.inf)
    return _Place(z, starts, levels, left, slopes, moments, costs)


def _with_levels(place: _Place) -> _Place:
    """The same place at the most likely levels."""
    levels = estimate_levels(place.moments, place.levels)
    return replace(place, levels=levels, costs=place.moments.explained(levels)[2])


def _settled(model: Model, place: _Place) -> _Place:
    """The place with its levels and with the starts where the data want them."""
    if not np.isfinite(place.cost):
        raise ModelRangeError(
            "the model does not follow the recordings", why="it leaves its range", fix="check --vessel and units"
        )
    for _ in range(2):
        place = _with_levels(place)
        place = _moved(model, place, np.zeros(model.size), np.zeros_like(place.left))
    return _with_levels(place)


def _moved(model: Model, place: _Place, step: Floats, expected: Floats) -> _Place:
    """Where a step in the unknowns leads that should change what is reported as ``expected`` [S, T, 6], the starts
    going with it.

    Far from the truth the slopes of a segment may send its start astray: where they do it stays.
    """
    own, _, _ = moments_of(place.left - expected, place.slopes).explained(place.levels)
    z = place.z + step
    then = _place(model, z, place.starts + own[:, :6] * model.start_scale, place.levels)
    if then.cost < place.cost:
        return then
    stay = _place(model, z, place.starts, place.levels)
    starts = np.where((stay.costs < then.costs)[:, None], stay.starts, then.starts)
    return _place(model, z, starts, place.levels)


def _normal(model: Model, place: _Place) -> tuple[Floats, Floats, Floats]:
    """What each segment says of the unknowns [S, P, P], where it pulls them [S, P], and the slopes [S, 6 T, p] of
    the p of them that it knows of, :attr:`Model.own_unknowns`.
    """
    columns = model.slopes(place.z, place.starts)
    weight = np.isfinite(place.left) / np.sqrt(place.levels.noise)
    C, Z, r = (_weighted(each, weight) for each in (columns, place.slopes, np.nan_to_num(place.left)))
    turned, segments, unknown = C.transpose(0, 2, 1), len(C), model.own_unknowns
    shared = turned @ Z
    taken = shared @ place.moments.explained(place.levels)[1]
    row, size = np.arange(segments)[:, None], model.size
    information, scores = np.zeros((segments, size, size)), np.zeros((segments, size))
    said = turned @ C - taken @ shared.transpose(0, 2, 1)
    information[row[..., None], unknown[:, :, None], unknown[:, None, :]] = said
    scores[row, unknown] = (turned @ r - taken @ (Z.transpose(0, 2, 1) @ r))[..., 0]
    return information, scores, columns.reshape(C.shape)


def _weighted(values: Floats, weight: Floats) -> Floats:
    """Values [S, T, 6] or [S, T, 6, n] times weights [S, T, 6], as a matrix a segment [S, 6 T, n]."""
    segments = len(values)
    return np.asarray(values.reshape(segments, weight[0].size, -1) * weight.reshape(segments, -1, 1))


def information_at(model: Model, z: Floats, starts: Floats, levels: Levels) -> Floats:
    """What segments would say of all unknowns there [P, P]; NaN where the model leaves its range."""
    place = _place(model, z, starts, levels)
    if not np.isfinite(place.cost):
        return np.full((model.size, model.size), np.nan)
    return np.asarray(_normal(model, place)[0].sum(axis=0))
