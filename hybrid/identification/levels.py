"""The levels of a segment's own unknowns and of the sensors' noise, by expectation and maximisation.

What is left of a segment at some coefficients is r = Z b + e: b are the departures of its start and the forces that
the model lacks, e the sensors' white noise. Their variances are those under which what is left of all segments is
the most likely (Dempster, Laird and Rubin 1977; of such mixed models Laird and Ware 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.identification.response import PARTS

START_VARIANCE = 1.0
"""Of a start's departure, in the squared units of :attr:`Model.start_scale`: the start is free."""

_ROUNDS = 40
_LEAST = 1e-10


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


def own_unknowns(left: Floats, slopes: Floats, levels: Levels) -> tuple[Floats, Floats]:
    """The unknowns [S, Q] of each segment that what is ``left`` [S, T, 6] speaks for, and their covariance."""
    squares, products = _moments(left, slopes)
    return _solve(squares, products, levels)


def estimate_levels(left: Floats, slopes: Floats, first: Levels, rounds: int = _ROUNDS) -> Levels:
    """The most likely levels of what is ``left`` [S, T, 6], NaN where nothing was measured."""
    levels = first
    squares, products = _moments(left, slopes)
    known = np.isfinite(left)
    filled = np.where(known, left, 0.0)
    count = known.sum(axis=(0, 1)).clip(min=1)
    total = (filled**2).sum(axis=1)
    for _ in range(rounds):
        own, spread = _solve(squares, products, levels)
        second = own[:, :, None] * own[:, None, :] + spread
        rest = total - 2.0 * np.einsum("scq,sq->sc", products, own) + np.einsum("scqp,spq->sc", squares, second)
        each = np.einsum("sqq->q", second) / len(left)
        forces = np.stack([each[6:9], each[9:].reshape(3, PARTS).mean(axis=1)])
        noise = np.maximum(rest.sum(axis=0) / count, _LEAST)
        levels = Levels(noise, np.maximum(forces, _LEAST))
    return levels


def _moments(left: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Z'Z [S, 6, Q, Q] and Z'r [S, 6, Q] of each segment and channel, of what is known."""
    known = np.isfinite(left)[..., None]
    Z, r = np.where(known, slopes, 0.0), np.nan_to_num(left)
    Z = np.ascontiguousarray(Z.transpose(0, 2, 1, 3))
    return Z.transpose(0, 1, 3, 2) @ Z, (Z.transpose(0, 1, 3, 2) @ r.transpose(0, 2, 1)[..., None])[..., 0]


def _solve(squares: Floats, products: Floats, levels: Levels) -> tuple[Floats, Floats]:
    weight = 1.0 / levels.noise
    information = np.einsum("scqp,c->sqp", squares, weight) + np.diag(1.0 / levels.own)
    covariance = np.linalg.inv(information)
    return np.einsum("sqp,scp,c->sq", covariance, products, weight), covariance


def whiteners(left: Floats, slopes: Floats, levels: Levels) -> tuple[Floats, float]:
    """What turns what is left of each segment into white noise, [S, 6 T, 6 T], and the log determinant of all
    covariances; what is not known is nought.
    """
    segments, times, channels = left.shape
    known = np.isfinite(left).reshape(segments, -1)
    deviation = np.sqrt(np.tile(levels.noise, times))
    scale = np.where(known, 1.0 / deviation, 0.0)
    G = slopes.reshape(segments, times * channels, -1) * np.sqrt(levels.own) * scale[..., None]
    factor = np.linalg.cholesky(G @ G.transpose(0, 2, 1) + np.eye(times * channels))
    diagonal = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum() + (known * np.log(deviation)).sum()
    return np.linalg.inv(factor) * scale[:, None, :], 2.0 * float(diagonal)
