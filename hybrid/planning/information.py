"""The information of a trial on each effect, with or without data: what could be detected, what distinguished.

The information matrix of all effects follows from the same inner products as the evidence, without the data, so
it also exists for a trial that has not been made. With F the inner products of the effects' columns, an effect
of size a changes twice the log likelihood by a' F a, and by less if another effect can imitate it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import expm1, inf, log, log1p, sqrt

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2, norm, t

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis.acceptance import FALSE_ALARM, HELD_OUT_LEVEL
from seatrial.hybrid.diagnosis.evidence import NormalEquations, explained_by, marginalise
from seatrial.hybrid.effects import Catalogue, Effect

POWER = 0.9
"""The power: an effect at its limit is found in this share of such trials."""

TOLD_APART = 9.0
"""Twice the log likelihood by which the wrong one of two effects has to be worse to be excluded (p = 0.13 %)."""

_UNHEARD = 1e-2  # of the prior's information: less is negligible
_NONE = 1e-7  # of the prior's information: less is rounding


@dataclass(frozen=True, slots=True)
class Information:
    """``matrix`` [P, P]: the information on all effects' free coordinates, nuisances marginalised."""

    matrix: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def of(self, name: str, given: Sequence[str] = ()) -> Floats:
        """The information on an effect's coordinates [d, d] when those of ``given`` are free."""
        none, own = np.zeros(0, dtype=np.int64), self.columns[name]
        others = np.concatenate([none, *(self.columns[each] for each in given)])
        return np.asarray(self.matrix[np.ix_(own, own)] - explained_by(self.matrix, own, others))


def information_of(equations: NormalEquations) -> Information:
    """The information in all legs of a trial."""
    kept = 1 + np.arange(len(equations.layout.effect))
    matrix, _ = marginalise(equations.gram.sum(axis=0), kept, equations.nuisance, equations.nuisance_scale)
    return Information(matrix, _columns(equations), equations.model.catalogue)


def _columns(equations: NormalEquations) -> dict[str, Ints]:
    names = equations.model.catalogue
    return {name: np.array(equations.layout.of(name), dtype=np.int64) - 1 for name in names}


@dataclass(frozen=True, slots=True)
class Design:
    """Legs [L, P+K, P+K] from which any trial can be assembled: inner products of effects and nuisances.

    The K nuisances are those combinations of all of them on which any leg has information, each of unit
    variance.
    """

    legs: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def information(self, legs: Sequence[int]) -> Information:
        """The information in some legs; one listed twice is sailed twice."""
        total = self.legs[np.array(legs, dtype=int)].sum(axis=0)
        effects = sum(len(each) for each in self.columns.values())
        rest = np.arange(effects, len(total))
        matrix, _ = marginalise(total, np.arange(effects), rest, np.ones(len(rest)))
        return Information(matrix, self.columns, self.catalogue)


def design_of(equations: NormalEquations) -> Design:
    """A trial's legs, prepared for repeated assembly."""
    scale, nuisance = equations.nuisance_scale, equations.nuisance
    heard = _heard(equations.gram.sum(axis=0)[np.ix_(nuisance, nuisance)] * np.outer(scale, scale))
    effects = 1 + np.arange(len(equations.layout.effect))
    change = np.zeros((equations.gram.shape[1], len(effects) + heard.shape[1]))
    change[effects, np.arange(len(effects))] = 1.0
    # What is tolerated of an effect has the effect's own column, so that this adds up and does not overwrite.
    change[nuisance, len(effects) :] += heard * scale[:, None]
    legs = np.array([change.T @ leg @ change for leg in equations.gram])
    return Design(legs, _columns(equations), equations.model.catalogue)


def _heard(granted: Floats) -> Floats:
    """Orthonormal combinations [n, K] of coordinates of unit variance on which ``granted`` [n, n] has
    information.

    By pivoted Cholesky decomposition, stopped where pivots become negligible (Higham 1990).
    """
    factor, order, rank, _ = lapack.dpstrf(granted, tol=_UNHEARD, lower=1)
    spanned = np.zeros((len(granted), rank))
    spanned[order - 1] = np.tril(factor)[:, :rank]
    return np.asarray(np.linalg.qr(spanned)[0])


def separation(
    information: Information, name: str, rival: str, free: Sequence[float], given: Sequence[str] = ()
) -> float:
    """Twice the log likelihood by which an effect at ``free`` coordinates is better than its best imitation.

    The ``rival`` imitates it at any size; effects in ``given`` are fitted beside either. The expected value
    without noise: a' (F_ii - F_ij F_jj^-1 F_ji) a.
    """
    size = np.asarray(free, dtype=float)
    return max(0.0, float(size @ information.of(name, (rival, *given)) @ size))


def least_separation(information: Information, name: str, rival: str) -> float:
    """The smallest :func:`separation` over all directions, of an effect of typical size."""
    spread = np.array(information.catalogue[name].free_scale)
    own, other = information.columns[name], information.columns[rival]
    if len(own) == len(other) == 1:  # most are, and a programme is weighed by thousands of them
        (i,), (j,), matrix = own, other, information.matrix
        shared = matrix[i, j] ** 2 / matrix[j, j] if matrix[j, j] > 0.0 else 0.0
        return max(0.0, float((matrix[i, i] - shared) * spread[0] ** 2))
    least = np.linalg.eigvalsh(information.of(name, (rival,)) * np.outer(spread, spread))[0]
    return max(0.0, float(least))


def limits(equations: NormalEquations) -> dict[str, float]:
    """The size at which each effect would be found in nine of ten trials like this one, in its parameter's
    unit.

    The distance of the first parameter from its neutral value, or the largest value for one that is absent at
    infinity. For an effect with a direction, the worst direction. Infinite (0 for the latter) if no possible
    size would do.
    """
    information, legs = information_of(equations), legs_of(equations)
    seen = free_limits(information)
    result = {}
    for name, effect in equations.model.catalogue.items():
        own = information.columns[name]
        again = predicted_limit(information, name, legs[:, own[:, None], own])
        result[name] = as_parameter(effect, max(seen[name], again))
    return result


def legs_of(equations: NormalEquations) -> Floats:
    """The information on all effects' coordinates in each leg by itself [L, P, P]."""
    kept = 1 + np.arange(len(equations.layout.effect))
    nuisance, scale = equations.nuisance, equations.nuisance_scale
    return np.array([marginalise(leg, kept, nuisance, scale)[0] for leg in equations.gram])


def as_parameter(effect: Effect, size: float) -> float:
    """A size in free coordinates as the deviation of the first parameter from neutral; infinite if out of
    bounds."""
    first = effect.parameters[0]
    if effect.chart == "inverse_square":
        value = size**-0.5
        return value if value >= first.low else 0.0
    return size if size <= max(first.high - first.neutral, first.neutral - first.low) else inf


def free_limits(information: Information) -> dict[str, float]:
    """The limits in free coordinates, ignoring bounds; infinite if undetectable."""
    return {name: _limit(information, name) for name in information.catalogue}


def _limit(information: Information, name: str) -> float:
    effect, block = information.catalogue[name], information.of(name)
    prior = np.array(effect.free_scale)
    relative = np.asarray(np.linalg.eigvalsh(block * np.outer(prior, prior)), dtype=np.float64)
    if relative[0] < _NONE:
        return inf
    needed = noncentrality(needed_gain(relative, len(information.catalogue)), len(prior))
    shape = _shape(effect)
    worst = float(np.linalg.eigvalsh(block * np.outer(shape, shape))[0])
    # The interval of one that is found has to reach what anyone cares about.
    reach = effect.smallest_free[0] - (1.96 - float(norm.ppf(POWER))) / sqrt(worst)
    return max(sqrt(needed / worst), reach)


def _shape(effect: Effect) -> Floats:
    """The size of each coordinate relative to the first."""
    if len({each.unit for each in effect.parameters}) == 1 or effect.chart != "linear":
        return np.ones(len(effect.free_scale))
    return np.asarray(np.array(effect.free_scale) / effect.free_scale[0])


def predicted_limit(information: Information, name: str, legs: Floats) -> float:
    """The size, in free coordinates, at which an effect's gains on held-out legs become significant (Student).

    ``legs`` [L, d, d] is its information in each. A leg gains half its noncentrality, with the noncentrality as
    variance, so in units of its scatter half the root, and the spread of information between legs adds scatter.
    Infinite if that alone hides any size: an effect that shows in one leg of many is not predicted by the
    others.
    """
    shape = _shape(information.catalogue[name])
    direction = shape * np.linalg.eigh(information.of(name) * np.outer(shape, shape))[1][:, 0]
    each = np.einsum("i,lij,j->l", direction, legs, direction)
    count, total = len(each), float(each.sum())
    if count < 2 or total <= 0.0:
        return inf
    level, margin = float(t.isf(HELD_OUT_LEVEL, count - 1)), float(norm.ppf(POWER))
    share = np.sqrt(np.maximum(each, 0.0) / total)
    even, uneven = 0.5 * float(share.mean()) * sqrt(count), 0.25 * float(share.var(ddof=1))
    # (even x - margin)^2 = level^2 (1 + uneven x^2), with x^2 the noncentrality of all legs
    leading = even**2 - level**2 * uneven
    if leading <= 0.0:
        return inf
    constant = margin**2 - level**2
    root = (margin * even + sqrt(max(0.0, (margin * even) ** 2 - leading * constant))) / leading
    return root / sqrt(total)


def needed_gain(relative: Floats, effects: int) -> float:
    """The gain that an effect needs to be named: the larger of those required by significance and by evidence.

    ``relative`` [d] are the eigenvalues of its information in units of its prior's; ``effects`` are tried. The
    first is chi-square corrected for all of them (Sidak 1967); the second is where the log evidence less the
    penalty is zero.
    """
    single = -expm1(log1p(-FALSE_ALARM) / effects)
    occam = float(np.log1p(relative).sum()) + 2.0 * log(effects)
    return max(float(chi2.isf(single, len(relative))), occam * float(1.0 + 1.0 / relative[0]))


@lru_cache(maxsize=4096)
def noncentrality(threshold: float, degrees: int, power: float = POWER) -> float:
    """The noncentrality at which a chi-square variate exceeds ``threshold`` with probability ``power``."""
    most = 4.0 * threshold + 100.0
    return float(brentq(lambda value: float(ncx2.sf(threshold, degrees, value)) - power, 1e-9, most, xtol=1e-6))
