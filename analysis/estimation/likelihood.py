"""Maximum-likelihood noise levels from the innovations of a Kalman filter.

The likelihood of the innovations (Schweppe 1965) is maximised by Fisher scoring with Levenberg-Marquardt
damping: gradient and expected information follow from the derivatives of innovations and variances (Gupta and
Mehra 1974), taken as finite differences of the filter. The normalised square of each innovation counts up to a
limit, and beyond it does not fall with growing variance, so outliers are not taken for noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.core.quantities import Floats

Innovations = Callable[[Floats], tuple[Floats, Floats]]
"""Innovations and their variances, both [values], at parameters [p]."""

_DIFFERENCE = 1e-4
_EASIER = 5.0


@dataclass(frozen=True, slots=True)
class ScoringSettings:
    """Settings of the search; parameters are logarithms of levels, or angles.

    ``limit`` clips the normalised square of an innovation; at most ``most_steps`` of at most ``longest_step``
    in each parameter; ``damping`` is the initial value and the factor after a step without gain, at most
    ``tries`` times; the search ends below a gain of ``enough`` in minus twice the log likelihood.
    """

    limit: float = 25.0
    most_steps: int = 20
    longest_step: float = 1.5
    damping: tuple[float, float] = (1e-2, 8.0)
    tries: int = 5
    enough: float = 0.2


@dataclass(frozen=True, slots=True)
class Prior:
    """A normal prior on the parameters with ``mean`` [p] and a common standard ``deviation``; infinite for
    none."""

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
    """Maximise the likelihood over parameters [p] between ``low`` and ``high``, from ``start``; returns them
    and their cost.

    The cost is :func:`robust_cost` plus the prior's. A step without gain is retried with more damping.
    """
    prior = prior or Prior(start, np.inf)

    def cost(at: Floats, outcome: tuple[Floats, Floats]) -> float:
        return robust_cost(*outcome, how.limit) + prior.cost(at)

    current, damping, evaluation = start, how.damping[0], innovations(start)
    value = cost(current, evaluation)
    for _ in range(how.most_steps):
        gradient, information = scores(innovations, current, evaluation, how.limit)
        gradient = gradient + 2.0 * (current - prior.mean) / prior.deviation**2
        information = information + 2.0 * np.eye(current.size) / prior.deviation**2
        free = ~(((current <= low) & (gradient > 0)) | ((current >= high) & (gradient < 0)))
        before = value
        for _ in range(how.tries):
            damped = information + damping * np.diag(np.diag(information)) + 1e-6 * np.eye(current.size)
            step = np.zeros(current.size)
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], -gradient[free])
            tried = np.clip(current + np.clip(step, -how.longest_step, how.longest_step), low, high)
            tried_evaluation = innovations(tried)
            if cost(tried, tried_evaluation) < value:
                current, evaluation, value, damping = (
                    tried,
                    tried_evaluation,
                    cost(tried, tried_evaluation),
                    damping / _EASIER,
                )
                break
            damping *= how.damping[1]
        if before - value < how.enough:
            break
    return current, value


def scores(
    innovations: Innovations, at: Floats, evaluation: tuple[Floats, Floats], limit: float
) -> tuple[Floats, Floats]:
    """Gradient [p] and expected curvature [p, p] of :func:`robust_cost` at parameters that gave ``evaluation``.

    Half the curvature is Fisher's information: its inverse is the covariance of the estimate.
    """
    innovation, variance = evaluation
    deviation = np.sqrt(variance)
    ratio = innovation / deviation
    inside = ratio**2 < limit
    moved, grown = np.empty((2, at.size, innovation.size))
    for number, unit in enumerate(np.eye(at.size)):
        stepped, its_variance = innovations(at + _DIFFERENCE * unit)
        moved[number] = (stepped - innovation) / deviation / _DIFFERENCE * inside
        grown[number] = np.log(its_variance / variance) / _DIFFERENCE * inside
    return grown @ (1.0 - ratio**2) + 2.0 * moved @ ratio, grown @ grown.T + 2.0 * moved @ moved.T


NEARLY_ONE = 0.95
"""The absolute correlation above which two estimates cannot be separated."""


UNKNOWN = 0.8
"""The ratio of standard error to prior above which the data do not determine a parameter."""


def correlated_pairs(names: Sequence[str], correlation: Floats) -> list[tuple[str, str, float]]:
    """Pairs of ``names`` [P] with strongly correlated estimates, and their correlation, from the matrix [P, P].

    >>> correlated_pairs(["mass", "drag"], np.array([[1.0, -0.97], [-0.97, 1.0]]))
    [('drag', 'mass', -0.97)]
    """
    return [
        (names[row], names[column], float(correlation[row, column]))
        for row in range(len(names)) for column in range(row) if abs(correlation[row, column]) > NEARLY_ONE
    ]  # fmt: skip
