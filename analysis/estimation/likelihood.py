"""Noise levels by maximum likelihood: those under which a Kalman filter's innovations are the most likely.

The likelihood of the innovations (Schweppe 1965) is climbed by Fisher scoring, damped as Levenberg and Marquardt
do: gradient and expected information both follow from the derivatives of innovations and variances (Gupta and Mehra
1974), which differences of the filter itself give. The square of each innovation, in units of its variance, counts
up to a limit only, and one beyond it does not fall as its variance grows: outliers do not pass for noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Floats

Innovations = Callable[[Floats], tuple[Floats, Floats]]
"""Innovations and their variances, both [values], at parameters [p]."""

_DIFFERENCE = 1e-4
_EASIER = 5.0


@dataclass(frozen=True, slots=True)
class ScoringSettings:
    """How the likelihood is climbed: parameters are logarithms of levels, or angles.

    ``limit`` is up to where an innovation's square over its variance counts; ``most_steps`` of at most
    ``longest_step`` in each parameter; ``damping`` is the first and what a step that did not help multiplies it by,
    at most ``tries`` times; ``enough`` is the gain in minus twice the log likelihood below which the search ends.
    """

    limit: float = 25.0
    most_steps: int = 20
    longest_step: float = 1.5
    damping: tuple[float, float] = (1e-2, 8.0)
    tries: int = 5
    enough: float = 0.2


@dataclass(frozen=True, slots=True)
class Prior:
    """A normal prior on the parameters, about ``mean`` [p], of one standard ``deviation``; infinite is none."""

    mean: Floats
    deviation: float

    def cost(self, at: Floats) -> float:
        """Minus twice its log density, up to a constant."""
        return float((((at - self.mean) / self.deviation) ** 2).sum())


def robust_cost(innovation: Floats, variance: Floats, limit: float) -> float:
    """Minus twice the log likelihood of innovations, up to a constant; squares count up to ``limit`` variances."""
    enough = np.maximum(variance, innovation**2 / limit)
    return float((np.log(enough) + innovation**2 / enough).sum())


def most_likely(
    innovations: Innovations,
    start: Floats,
    low: Floats,
    high: Floats,
    how: ScoringSettings,
    prior: Prior | None = None,
) -> tuple[Floats, float]:
    """The parameters [p] between ``low`` and ``high`` that are uphill from ``start``, and their cost.

    The cost is :func:`robust_cost` and the prior's. A step that does not help is tried again with more damping.
    """
    prior = prior or Prior(start, np.inf)

    def cost(at: Floats, found: tuple[Floats, Floats]) -> float:
        return robust_cost(*found, how.limit) + prior.cost(at)

    now, damping, found = start, how.damping[0], innovations(start)
    value = cost(now, found)
    for _ in range(how.most_steps):
        gradient, information = scores(innovations, now, found, how.limit)
        gradient = gradient + 2.0 * (now - prior.mean) / prior.deviation**2
        information = information + 2.0 * np.eye(now.size) / prior.deviation**2
        free = ~(((now <= low) & (gradient > 0)) | ((now >= high) & (gradient < 0)))
        before = value
        for _ in range(how.tries):
            damped = information + damping * np.diag(np.diag(information)) + 1e-6 * np.eye(now.size)
            step = np.zeros(now.size)
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], -gradient[free])
            tried = np.clip(now + np.clip(step, -how.longest_step, how.longest_step), low, high)
            then = innovations(tried)
            if cost(tried, then) < value:
                now, found, value, damping = tried, then, cost(tried, then), damping / _EASIER
                break
            damping *= how.damping[1]
        if before - value < how.enough:
            break
    return now, value


def scores(
    innovations: Innovations, at: Floats, found: tuple[Floats, Floats], limit: float
) -> tuple[Floats, Floats]:
    """Gradient [p] and expected curvature [p, p] of :func:`robust_cost` at parameters that gave ``found``.

    Half the curvature is Fisher's information: its inverse is the covariance of the estimate.
    """
    innovation, variance = found
    deviation = np.sqrt(variance)
    ratio = innovation / deviation
    inside = ratio**2 < limit
    moved, grown = np.empty((2, at.size, innovation.size))
    for number, unit in enumerate(np.eye(at.size)):
        other, its_variance = innovations(at + _DIFFERENCE * unit)
        moved[number] = (other - innovation) / deviation / _DIFFERENCE * inside
        grown[number] = np.log(its_variance / variance) / _DIFFERENCE * inside
    return grown @ (1.0 - ratio**2) + 2.0 * moved @ ratio, grown @ grown.T + 2.0 * moved @ moved.T


NEARLY_ONE = 0.95
"""Two estimates correlated by so much, either way, are one in all but name."""


UNKNOWN = 0.8
"""A standard error of so much of the prior's, and more, is none of the data's."""


def correlated_pairs(names: Sequence[str], correlation: Floats) -> list[tuple[str, str, float]]:
    """Pairs of ``names`` [P] whose estimates hang together, and their correlation, from all of them [P, P].

    >>> correlated_pairs(["mass", "drag"], np.array([[1.0, -0.97], [-0.97, 1.0]]))
    [('drag', 'mass', -0.97)]
    """
    return [
        (names[one], names[other], float(correlation[one, other]))
        for one in range(len(names)) for other in range(one) if abs(correlation[one, other]) > NEARLY_ONE
    ]  # fmt: skip
