"""How a named effect stands, the others given: no chance, borne out by every leg and by unseen ones, large enough.

It is no chance among so many effects, also by how it scatters from leg to leg; it predicts legs that were left out;
and it is large enough to matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from acquisition.core.arrays import Floats, Ints
from hybrid.diagnosis.evidence import Fit, fitted
from hybrid.diagnosis.examine import Examination
from hybrid.diagnosis.view import View, put_back

FALSE_ALARM = 0.005
"""The chance that a trial with nothing hidden shows any effect, by each test."""

UNSEEN = 0.05
"""One-sided level at which an effect has to predict legs that were left out."""

_TELLING = 0.95  # of the information is in the legs on which an effect is tried
_FEW_LEGS = 3  # with fewer there is no scatter to judge by: the sum alone has to be above zero


@dataclass(frozen=True, slots=True)
class Tested:
    """How an effect stands, given the others: chance by the model, by the scatter of legs, on unseen legs; size."""

    name: str
    gain: float
    p_value: float
    spread: float
    p_unseen: float
    large_enough: bool

    @property
    def hopeless(self) -> bool:
        """Whether it would not stand the tests without the others either."""
        return max(self.p_value, self.p_unseen) > 0.5

    @property
    def accepted(self) -> bool:
        """Whether it stands all tests."""
        return self.p_value < FALSE_ALARM and self.p_unseen < UNSEEN and self.large_enough


def tested(view: View, names: tuple[str, ...], name: str) -> Tested:
    """Test one of the effects ``names``, the others given."""
    others = tuple(each for each in names if each != name)
    together, without = view.fit(names), view.fit(others)
    gain, columns = together.gain - without.gain, view.columns([name])
    spread = _spread_of_legs(view, names, name)
    p_value = view.chance(gain / spread, len(columns))
    said = _said(view, together, name)
    gains, telling = unseen_gains(view, others, names), _telling(said)
    p_unseen = _no_chance(gains[telling] / np.sqrt(np.maximum(said[telling], 1e-300)))
    return Tested(name, gain, p_value, spread, p_unseen, _large_enough(view, together, name))


def _said(view: View, fit: Fit, name: str) -> Floats:
    """What each leg says of an effect of the size that is fitted [L]: the noncentrality of its gain there."""
    assert view.alone is not None
    columns = np.array(view.columns([name]))
    values = fit.values[view.places(fit, name)]
    return np.array([values @ leg[np.ix_(columns, columns)] @ values for leg in view.alone])


def _telling(said: Floats) -> Ints:
    """The legs that say most of what is said of an effect: those in which nothing happens cannot bear it out."""
    order = np.argsort(-said)
    needed = int(np.searchsorted(np.cumsum(said[order]), _TELLING * said.sum())) + 1
    return np.asarray(order[:needed])


def _no_chance(gains: Floats) -> float:
    """The chance of such gains of legs where there is no effect (Student 1908).

    They are in units of their scatter, which grows with the root of what a leg says: else a leg that says more than
    the others would be the scatter of them all.
    """
    deviation = gains.std(ddof=1) / np.sqrt(len(gains)) if len(gains) >= _FEW_LEGS else 0.0
    return float(t.sf(gains.mean() / max(float(deviation), 1e-12), max(len(gains) - 1, 1)))


def _large_enough(view: View, fit: Fit, name: str) -> bool:
    """Whether the effect may be as large as the smallest anyone cares about."""
    effect = view.examination.model.catalogue[name]
    places = view.places(fit, name)
    reach = np.abs(fit.values[places]) + 1.96 * np.sqrt(np.diag(fit.covariance)[places])
    return bool((reach >= np.array(effect.smallest_free)).any())


def _spread_of_legs(view: View, names: tuple[str, ...], name: str) -> float:
    """How much more the effect's score scatters from leg to leg than the model of the noise says, at least 1."""
    others = np.array(view.columns([each for each in names if each != name]), dtype=int)
    every = np.array(view.columns(names), dtype=int)
    return max(1.0, *map(float, spreads(view.examination, np.array(view.columns([name])), others, every)))


def spreads(examination: Examination, columns: Ints, others: Ints, every: Ints) -> Floats:
    """By leg, how much each column's score scatters against what the model of the noise says.

    The score is the product of the residual of a fit of ``every`` column with the column's own part, what
    ``others`` and the nuisances could explain taken off (White 1980, clustered by leg).
    """
    products = examination.products
    count, total = len(products.legs), products.total
    if count < 4:
        return np.ones(len(columns))
    nuisance, scale = examination.nuisance, examination.nuisance_scale
    own = np.zeros((len(total), len(columns)))
    own[columns, np.arange(len(columns))] = 1.0
    own = _freed(total, own, others, nuisance, scale)
    residual = _freed(total, put_back(examination)[:, None], every, nuisance, scale)[:, 0]
    scores = np.stack([own.T @ (leg @ residual) for leg in products.legs])
    information = np.stack([np.einsum("ij,ij->j", own, leg @ own) for leg in products.legs])
    whole = np.maximum(information.sum(axis=0), 1e-300)  # of some these data say nothing
    centred = scores - information * scores.sum(axis=0) / whole
    return np.asarray((centred**2).sum(axis=0) / whole * count / (count - 1))


def _freed(total: Floats, what: Floats, fixed: Ints, nuisance: Ints, scale: Floats) -> Floats:
    """``what`` [C, d] less what fixed columns (freely) and nuisances (at their scale) explain of it."""
    columns = np.concatenate([fixed, nuisance])
    penalty = np.concatenate([np.zeros(len(fixed)), scale**-2.0])
    normal = total[np.ix_(columns, columns)] + np.diag(penalty)
    if not columns.size:
        return what
    weight = np.linalg.solve(normal + 1e-12 * np.diag(np.diag(normal)), total[columns] @ what)
    result = what.copy()
    np.subtract.at(result, columns, weight)
    return result


def unseen_gains(view: View, without: tuple[str, ...], names: tuple[str, ...]) -> Floats:
    """By how much the log density of each leg is higher with ``names``, fitted to all others, than ``without`` [L].

    What is tolerated has to be what it is in each leg anew: else the tolerance, having seen the other legs, would
    know the effect as well as the effect itself.
    """

    assert view.left_out is not None
    assert view.alone is not None
    left_out, alone = view.left_out, view.alone

    def density(leg: int, some: tuple[str, ...]) -> float:
        columns, own = np.array(view.columns(some), dtype=int), alone[leg]
        values = fitted(left_out[leg], view.columns(some), view.prior(some)).values if some else np.zeros(0)
        return float(values @ own[columns, 0] - 0.5 * values @ own[np.ix_(columns, columns)] @ values)

    return np.array([density(leg, names) - density(leg, without) for leg in range(len(alone))])
