"""Coefficients by the likelihood of all segments beside their priors.

What a segment has to itself, its start and the forces that the model lacks, is taken out of the likelihood in
closed form; for what is left the steps are Levenberg's and Marquardt's, after each of which the levels of noise and
of lacking forces are drawn up anew. They are ours, as in the adaptive calibrator, because starts and unknowns move
together in a step: with the starts held, ``scipy.optimize.least_squares`` goes to and fro between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.errors import ModelRangeError
from acquisition.core.progress import Progress
from hybrid.identification.levels import Levels, estimate_levels, own_unknowns, whiteners
from hybrid.identification.response import Model

ROUNDS = 20
_ENOUGH = 0.3
"""A step that is less better than so much, in minus twice the log likelihood, is the last."""

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
    """Where the search is: what is left there, and what that costs, minus twice the log of the posterior."""

    z: Floats
    starts: Floats
    levels: Levels
    left: Floats
    slopes: Floats
    white: Floats
    cost: float


def first_levels(model: Model) -> Levels:
    """Where the estimate of the levels begins: in shares of the usual motion and of the usual forces."""
    return Levels((0.01 * model.start_scale * [0.1, 0.1, 1.0, 1.0, 1.0, 1.0]) ** 2, np.full((2, 3), 1e-3))


def fit(
    model: Model,
    z: Floats | None = None,
    starts: Floats | None = None,
    levels: Levels | None = None,
    rounds: int = ROUNDS,
    progress: Progress = lambda share: None,
) -> Fit:
    """The most likely unknowns of a model on its segments, from ``z`` on or from the priors' middle.

    Raises :class:`ModelRangeError` where the model cannot be simulated on them.
    """
    z = np.zeros(model.size) if z is None else z
    begin = model.segments.start if starts is None else starts
    now = _settled(model, _place(model, z, begin, levels or first_levels(model)))
    damping = 1e-3
    for number in range(rounds):
        progress(number / rounds)
        before = now.cost
        now, damping = _better(model, now, damping)
        if before - now.cost < _ENOUGH:
            break
        now = _with_levels(now)
    information, scores, _ = _normal(model, now)
    return Fit(now.z, covariance_of(information, scores), now.starts, now.levels, information, scores)


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


def _better(model: Model, now: _Place, damping: float) -> tuple[_Place, float]:
    """The place after the first step that helps, or the same place, and the damping for the next step."""
    information, scores, columns = _normal(model, now)
    total, pull = information.sum(axis=0), scores.sum(axis=0) - now.z
    for _ in range(_TRIES):
        damped = total + np.eye(model.size) + damping * np.diag(1.0 + np.diag(total))
        then = _moved(model, now, np.linalg.solve(damped, pull), columns)
        if then.cost < now.cost:
            return then, max(damping / 5.0, 1e-6)
        damping *= 8.0
    return now, damping


def _place(model: Model, z: Floats, starts: Floats, levels: Levels) -> _Place:
    seen, slopes = model.own_slopes(z, starts)
    left = model.segments.measured - seen
    if not np.isfinite(slopes).all():
        return _Place(z, starts, levels, left, slopes, slopes, np.inf)
    return _valued(z, starts, levels, left, slopes)


def _valued(z: Floats, starts: Floats, levels: Levels, left: Floats, slopes: Floats) -> _Place:
    """The place with what it costs."""
    white, determinant = whiteners(left, slopes, levels)
    whitened = white @ np.nan_to_num(left).reshape(len(left), -1, 1)
    cost = float((whitened**2).sum()) + determinant + float(z @ z)
    return _Place(z, starts, levels, left, slopes, white, cost)


def _with_levels(place: _Place) -> _Place:
    """The same place at the most likely levels."""
    levels = estimate_levels(place.left, place.slopes, place.levels)
    return _valued(place.z, place.starts, levels, place.left, place.slopes)


def _settled(model: Model, place: _Place, times: int = 2) -> _Place:
    """The place with its levels and with the starts where the data want them."""
    if not np.isfinite(place.cost):
        raise ModelRangeError(
            "the model does not follow the recordings", why="it leaves its range", fix="check --vessel and units"
        )
    for _ in range(times):
        place = _with_levels(place)
        place = _moved(model, place, np.zeros(model.size), np.zeros((1, 1, model.size)))
    return _with_levels(place)


def _moved(model: Model, place: _Place, step: Floats, columns: Floats) -> _Place:
    """Where a step in the unknowns leads, the starts going with it."""
    expected = place.left - (columns @ step).reshape(-1, *place.left.shape[1:]) if step.any() else place.left
    own, _ = own_unknowns(expected, place.slopes, place.levels)
    return _place(model, place.z + step, place.starts + own[:, :6] * model.start_scale, place.levels)


def _normal(model: Model, place: _Place) -> tuple[Floats, Floats, Floats]:
    """What each segment says of the unknowns [S, P, P], where it pulls them [S, P], and the slopes [S, 6 T, P]."""
    common, around = model.slopes(place.z, place.starts)
    segments, kept, each = len(common), common.shape[-1], around.shape[-1]
    columns = np.zeros((segments, place.white.shape[1], model.size))
    columns[..., :kept] = common.reshape(segments, -1, kept)
    for number in range(len(model.segments.names)):
        mine = np.flatnonzero(model.segments.recording == number)
        first = kept + number * each
        columns[mine, :, first : first + each] = around[mine].reshape(len(mine), -1, each)
    white = place.white @ columns
    left = place.white @ np.nan_to_num(place.left).reshape(segments, -1, 1)
    turned = white.transpose(0, 2, 1)
    return turned @ white, (turned @ left)[..., 0], columns


def information_at(model: Model, z: Floats, starts: Floats, levels: Levels) -> Floats:
    """What segments would say of all unknowns there [P, P]; NaN where the model leaves its range."""
    place = _place(model, z, starts, levels)
    if not np.isfinite(place.cost):
        return np.full((model.size, model.size), np.nan)
    return np.asarray(_normal(model, place)[0].sum(axis=0))
