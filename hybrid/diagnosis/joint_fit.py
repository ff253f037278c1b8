"""Many effects at once at their likeliest sizes, for a model that is far off.

What a search finds about nothing, and about that, and so on, does not settle for such a model: each look brings
another set. About all effects together, each held by its prior and within its bounds, the residuals are small from
the beginning. The sizes are those of the highest posterior density, by steps of Gauss and Newton that are halved
until they raise it (Nocedal and Wright, Numerical Optimization, 2006, chapter 10).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hybrid.diagnosis.evidence import Evidence, marginalise
from hybrid.diagnosis.select_effects import Coordinates, fitted_coordinates, linear_about

_LOOKS = 8
_SHORTEST = 1.0 / 32.0
_ENOUGH = 1.0  # of the log posterior density: what gains less is at the top


def compatible_effects(evidence: Evidence) -> tuple[str, ...]:
    """The effects that can be at work together, the likelier of two that cannot."""
    found = tuple[str, ...]()
    for name in sorted(evidence.names, key=lambda name: -evidence.log_odds([name])):
        found = (*found, name) if evidence.compatible((*found, name)) else found
    return found


def about_likeliest(evidence: Evidence, names: Sequence[str]) -> Evidence:
    """The evidence with the equations linear about the likeliest sizes of ``names`` together."""
    surprise = _surprise(evidence)
    for _ in range(_LOOKS):
        step = _step(evidence, fitted_coordinates(evidence, names), surprise)
        if step is None:
            break
        gain, evidence = surprise - step[0], linear_about(evidence, step[1])
        surprise = step[0]
        if gain < _ENOUGH:
            break
    return evidence


def _step(evidence: Evidence, target: Coordinates, surprise: float) -> tuple[float, Coordinates] | None:
    """The longest step towards ``target`` that is less of a surprise, and of how much; None where none is."""
    equations, share = evidence.equations, 1.0
    while share >= _SHORTEST:
        at = equations.model.bounded(_between(equations.model.at, target, share))
        less = _surprise(linear_about(evidence, at, equations.effects))
        if less < surprise:
            return less, at
        share *= 0.5
    return None


def _between(start: Coordinates, end: Coordinates, share: float) -> dict[str, tuple[float, ...]]:
    """So much of the way from one set of coordinates to another; what is not there is zero."""

    def of(some: Coordinates, name: str) -> np.ndarray:
        return np.array(some.get(name, 0.0))

    names = dict.fromkeys([*end, *start])
    return {name: tuple(np.atleast_1d((1.0 - share) * of(start, name) + share * of(end, name))) for name in names}


def _surprise(evidence: Evidence) -> float:
    """Minus the log posterior density of the sizes that the equations are linear about, up to a constant."""
    equations = evidence.equations
    gram, data = equations.gram.sum(axis=0), np.array([0])
    left = marginalise(gram, data, equations.nuisance, equations.nuisance_scale)[0][0, 0]
    prior = [(np.array(free) / evidence.prior([name])) ** 2 for name, free in equations.model.at.items()]
    return 0.5 * float(left + sum(each.sum() for each in prior))
