"""The levels of a segment's own unknowns and of the sensors' noise, the most likely ones.

What is left of a segment at some coefficients is r = Z b + e: b are the departures of its start and the forces that
the model lacks, e the sensors' white noise, so that r has the covariance V = Z D Z' + R (of such mixed models Laird
and Ware 1982). Nothing of V's size is ever inverted, but the Q by Q matrix that Woodbury's identity asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np
from scipy.optimize import minimize

from acquisition.core.arrays import Floats
from hybrid.identification.response import PARTS

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
