"""How much a trial says of each effect, before or without any data: what could be seen, what told apart.

The information matrix of all effects follows from the same products as the evidence itself, data left out; so a
trial that has not been made yet has one, too. With F the inner products of the effects' columns, an effect of size
a changes twice the log likelihood by a' F a, and by less where another effect may stand in for it.
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

from acquisition.core.arrays import Floats, Ints
from hybrid.diagnosis.acceptance import FALSE_ALARM, UNSEEN
from hybrid.diagnosis.evidence import NormalEquations, explained_by, marginalise
from hybrid.effects import Catalogue, Effect

POWER = 0.9
"""An effect of the size of its limit is found in so many trials of its kind."""

TOLD_APART = 9.0
"""Twice the log likelihood by which the wrong one of two effects has to be worse to be left out (chance 0.13 %)."""

_UNHEARD = 1e-2  # of its prior's information: what a trial adds to it is nothing
_NONE = 1e-7  # of the prior's: information below it is rounding


@dataclass(frozen=True, slots=True)
class Information:
    """``matrix`` [P, P]: the information of all effects' free coordinates, nuisances taken off."""

    matrix: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def of(self, name: str, given: Sequence[str] = ()) -> Floats:
        """The information of an effect's coordinates [d, d] when those of ``given`` may be anything at all."""
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
    """Legs [L, P+K, P+K] from which any trial may be put together: products of effects and of what is tolerated.

    The K last are those combinations of all that is tolerated that any leg says anything of, each of unit variance.
    """

    legs: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def information(self, legs: Sequence[int]) -> Information:
        """The information in some legs; one that is named twice is sailed twice."""
        total = self.legs[np.array(legs, dtype=int)].sum(axis=0)
        effects = sum(len(each) for each in self.columns.values())
        rest = np.arange(effects, len(total))
        matrix, _ = marginalise(total, np.arange(effects), rest, np.ones(len(rest)))
        return Information(matrix, self.columns, self.catalogue)


def design_of(equations: NormalEquations) -> Design:
    """A trial's legs, ready to be put together in other numbers, many times over."""
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
    """Orthonormal combinations [n, K] of coordinates of unit variance that ``granted`` [n, n] says anything of.

    By Cholesky's decomposition with pivots, which stops at what is too small (Higham 1990).
    """
    factor, order, rank, _ = lapack.dpstrf(granted, tol=_UNHEARD, lower=1)
    spanned = np.zeros((len(granted), rank))
    spanned[order - 1] = np.tril(factor)[:, :rank]
    return np.asarray(np.linalg.qr(spanned)[0])


def separation(
    information: Information, name: str, rival: str, free: Sequence[float], given: Sequence[str] = ()
) -> float:
    """Twice the log likelihood by which an effect at ``free`` coordinates is better than its best imitation.

    The ``rival`` imitates it at any size; effects in ``given`` are fitted beside either. The expected value, were
    there no noise: a' (F_ii - F_ij F_jj^-1 F_ji) a.
    """
    size = np.asarray(free, dtype=float)
    return max(0.0, float(size @ information.of(name, (rival, *given)) @ size))


def least_separation(information: Information, name: str, rival: str, sizes: float = 1.0) -> float:
    """The least :func:`separation` over all directions, of an effect ``sizes`` times as large as is typical."""
    spread = sizes * np.array(information.catalogue[name].free_scale)
    own, other = information.columns[name], information.columns[rival]
    if len(own) == len(other) == 1:  # most are, and a programme is weighed by thousands of them
        (i,), (j,), matrix = own, other, information.matrix
        shared = matrix[i, j] ** 2 / matrix[j, j] if matrix[j, j] > 0.0 else 0.0
        return max(0.0, float((matrix[i, i] - shared) * spread[0] ** 2))
    least = np.linalg.eigvalsh(information.of(name, (rival,)) * np.outer(spread, spread))[0]
    return max(0.0, float(least))


def limits(equations: NormalEquations) -> dict[str, float]:
    """How large each effect has to be to be found in nine of ten trials like this one, in its parameter's unit.

    The distance of the first parameter from its neutral value; the largest for one that is absent at infinity.
    Of an effect with a direction, in the worst. Infinite (0 for the latter) where no possible size would do.
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
    """The information of all effects' coordinates in each leg by itself [L, P, P]."""
    kept = 1 + np.arange(len(equations.layout.effect))
    nuisance, scale = equations.nuisance, equations.nuisance_scale
    return np.array([marginalise(leg, kept, nuisance, scale)[0] for leg in equations.gram])


def as_parameter(effect: Effect, size: float) -> float:
    """A size in free coordinates as a departure of the first parameter from neutral; infinite if out of bounds."""
    first = effect.parameters[0]
    if effect.chart == "inverse_square":
        value = size**-0.5
        return value if value >= first.low else 0.0
    return size if size <= max(first.high - first.neutral, first.neutral - first.low) else inf


def free_limits(information: Information) -> dict[str, float]:
    """The same in free coordinates, whatever their bounds; infinite where nothing is seen."""
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
    """How large each coordinate is for one of the first."""
    if len({each.unit for each in effect.parameters}) == 1 or effect.chart != "linear":
        return np.ones(len(effect.free_scale))
    return np.asarray(np.array(effect.free_scale) / effect.free_scale[0])


def predicted_limit(information: Information, name: str, legs: Floats) -> float:
    """How large an effect must be, in free coordinates, for its gains on unseen legs to be no chance (Student).

    ``legs`` [L, d, d] is its information in each. A leg gains half its noncentrality, with the noncentrality as
    variance; so in units of its scatter half the root, and legs that say little beside legs that say much are
    scatter, too. Infinite where the latter alone hides any size: an effect that shows in one leg of many is not
    predicted by the others.
    """
    shape = _shape(information.catalogue[name])
    direction = shape * np.linalg.eigh(information.of(name) * np.outer(shape, shape))[1][:, 0]
    each = np.einsum("i,lij,j->l", direction, legs, direction)
    count, total = len(each), float(each.sum())
    if count < 2 or total <= 0.0:
        return inf
    level, margin = float(t.isf(UNSEEN, count - 1)), float(norm.ppf(POWER))
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
    """How much of the squares an effect has to explain to be named: by chance and by evidence, the larger.

    ``relative`` [d] are the eigenvalues of its information in units of its prior's; so many ``effects`` are tried.
    The first is chi-square corrected for all of them (Sidak 1967); the second is where the log evidence with its
    price passes zero.
    """
    single = -expm1(log1p(-FALSE_ALARM) / effects)
    occam = float(np.log1p(relative).sum()) + 2.0 * log(effects)
    return max(float(chi2.isf(single, len(relative))), occam * float(1.0 + 1.0 / relative[0]))


@lru_cache(maxsize=4096)
def noncentrality(threshold: float, degrees: int, power: float = POWER) -> float:
    """Which noncentrality takes a chi-square variate over ``threshold`` with probability ``power``."""

    def short(value: float) -> float:
        return float(ncx2.sf(threshold, degrees, value)) - power

    return float(brentq(short, 1e-9, 4.0 * threshold + 100.0, xtol=1e-6))
