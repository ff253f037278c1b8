"""Which effects the data ask for: forward, backward and swap steps over the catalogue by evidence.

The evidence for a set of effects weighs how well they explain the data against how much they could have explained
(MacKay 1992, Kass and Raftery 1995); each effect pays besides for the catalogue's size. Whatever the search brings
must then stand three tests by itself, given the others: it is no chance among so many effects, also by how it
scatters from leg to leg; it predicts legs that were left out; and it is large enough to matter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import expm1, log, log1p

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, t

from acquisition.errors import ConfigurationError
from hybrid.diagnosis.evidence import Fit, Ints, Products, fitted, log_evidence, reduced
from hybrid.diagnosis.examine import Examination, Loose, Progress, examined
from hybrid.diagnosis.linearise import Model
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.noise import Noise
from hybrid.vessel.compiling import Floats

FALSE_ALARM = 0.005
"""The chance that a trial with nothing hidden shows any effect, by each test."""

UNSEEN = 0.05
"""One-sided level at which an effect has to predict legs that were left out."""

CLOSE = 4.5
"""A rival that lacks less log evidence stays in the answer: so the truth is thrown out once in 700 times."""

_PAIRS_OF = 8
_SETTLED, _SETTLED_SHARE = 0.3, 0.01  # of a standard error, of the size
_MOST = 6
_LOOKS = 10
_TELLING = 0.95  # of the information is in the legs on which an effect is tried
_CLOSER = 3  # effects by themselves that are looked at closer where several seem to be at work
_FEW_LEGS = 3  # with fewer there is no scatter to judge by: the sum alone has to be above zero

Coordinates = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class View:
    """Inner products under V of the data without any effect, column 0, and all effects' columns [1+P, 1+P].

    ``left_out`` [L, 1+P, 1+P] are the same with each leg left out, ``alone`` of each leg by itself.
    """

    inner: Floats
    examination: Examination
    left_out: Floats | None = None
    alone: Floats | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """All effects."""
        return tuple(self.examination.model.catalogue)

    def columns(self, names: Sequence[str]) -> tuple[int, ...]:
        """The columns of some effects, in their order."""
        return tuple(column for name in names for column in self.examination.layout.of(name))

    def prior(self, names: Sequence[str]) -> Floats:
        """The standard deviations of their priors."""
        return np.asarray(self.examination.layout.prior[np.array(self.columns(names), dtype=int) - 1])

    def evidence(self, names: Sequence[str]) -> float:
        """Log odds of these effects against none, less what each pays for the catalogue's size."""
        if not names:
            return 0.0
        return log_evidence(self.inner, self.columns(names), self.prior(names)) - self.price * len(names)

    @property
    def price(self) -> float:
        """What an effect has to be better than chance by: one of so many would be as good."""
        return log(len(self.names))

    def chance(self, gain: float, degrees: int) -> float:
        """The chance that any of so many effects gains as much where there is none (Sidak 1967)."""
        single = min(float(chi2.sf(max(gain, 0.0), degrees)), 1.0 - 1e-12)
        return -expm1(len(self.names) * log1p(-single))

    def fit(self, names: Sequence[str], prior: bool = False) -> Fit:
        """The joint fit."""
        return fitted(self.inner, self.columns(names), self.prior(names) if prior and names else None)

    def places(self, fit: Fit, name: str) -> list[int]:
        """Where an effect's coordinates stand in a fit."""
        return [fit.columns.index(column) for column in self.columns([name])]

    def possible(self, names: Sequence[str]) -> bool:
        """Whether the fitted values of all these effects are within their bounds."""
        return all(self.values(names).get(name) is not None for name in names)

    def values(self, names: Sequence[str]) -> dict[str, dict[str, float] | None]:
        """The fitted parameters of each, None where they are out of bounds."""
        fit, result = self.fit(names, prior=True), dict[str, dict[str, float] | None]()
        for name in names:
            free = fit.values[self.places(fit, name)].tolist()
            try:
                result[name] = self.examination.model.values(name, free)
            except ConfigurationError:
                result[name] = None
        return result


def view_of(examination: Examination, by_leg: bool = False) -> View:
    """The reduced products of an examination, its model's own effects put back into the data."""
    total = examination.products.total

    def inner(products: Floats) -> Floats:
        return whole_data(examination, products, examination.nuisance_scale)[0]

    if not by_leg:
        return View(inner(total), examination)
    legs = examination.products.legs
    left_out, alone = (np.array([inner(each) for each in some]) for some in (total - legs, legs))
    return View(inner(total), examination, left_out, alone)


def whole_data(examination: Examination, products: Floats, scale: Floats) -> tuple[Floats, float]:
    """Reduced products of the data without any effect and of all effects, and the logarithm of V's determinant."""
    kept = np.arange(1 + len(examination.layout.effect))
    inner, determinant = reduced(products, kept, examination.nuisance, scale)
    back = np.eye(len(kept))
    back[:, 0] = put_back(examination)[kept]
    return back.T @ inner @ back, determinant


def view_without(examination: Examination, legs: NDArray[np.bool_]) -> View:
    """As :func:`view_of`, some legs left out."""
    products = examination.products
    return view_of(replace(examination, products=Products(products.legs[~legs], products.rows[~legs])))


def put_back(examination: Examination) -> Floats:
    """The data with what the model's own effects have taken off, as a combination of all columns [C]."""
    back = np.zeros(examination.products.legs.shape[1])
    back[0] = 1.0
    for name, free in examination.model.at.items():
        back[list(examination.layout.of(name))] = free
    return back


def searched(view: View, barred: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """The set of effects with the highest evidence that steps from nothing, or from any good pair, lead to."""
    allowed = [name for name in view.names if name not in barred]
    singles = sorted(allowed, key=lambda name: -view.evidence([name]))
    starts: list[tuple[str, ...]] = [()]
    pairs = [pair for pair in combinations(singles[:_PAIRS_OF], 2) if view.possible(pair)]
    if pairs:
        starts.append(max(pairs, key=view.evidence))
    ends = [_climbed(view, start, allowed) for start in starts]
    return max(ends, key=view.evidence)


def _climbed(view: View, names: tuple[str, ...], allowed: Sequence[str]) -> tuple[str, ...]:
    """Adding, dropping and swapping one effect at a time, the best step first, until no step gains."""
    best = view.evidence(names) if view.possible(names) else -np.inf
    while True:
        steps = _steps(names, allowed)
        judged = sorted(((view.evidence(step), step) for step in steps), reverse=True)
        better = next((each for each in judged if each[0] > best + 1e-9 and view.possible(each[1])), None)
        if better is None or better[0] <= best:
            return names
        best, names = better


def _steps(names: tuple[str, ...], allowed: Sequence[str]) -> list[tuple[str, ...]]:
    outside = [name for name in allowed if name not in names]
    added = [(*names, name) for name in outside] if len(names) < _MOST else []
    dropped = [tuple(other for other in names if other != name) for name in names]
    swapped = [(*rest, name) for rest in dropped for name in outside]
    return added + dropped + swapped


@dataclass(frozen=True, slots=True)
class Tested:
    """How an effect stands, given the others: chance by the model, by the scatter of legs, on unseen legs; size."""

    name: str
    gain: float
    p_value: float
    spread: float
    unseen_gain: float
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
    gains = unseen_gains(view, others, names)[_telling(view, together, name)]
    deviation = gains.std(ddof=1) / np.sqrt(len(gains)) if len(gains) >= _FEW_LEGS else 0.0
    p_unseen = float(t.sf(gains.mean() / max(deviation, 1e-12), max(len(gains) - 1, 1)))
    return Tested(name, gain, p_value, spread, float(gains.sum()), p_unseen, _large_enough(view, together, name))


def _telling(view: View, fit: Fit, name: str) -> Ints:
    """The legs that say most of what is said of an effect: those in which nothing happens cannot bear it out."""
    assert view.alone is not None
    columns = np.array(view.columns([name]))
    values = fit.values[view.places(fit, name)]
    said = np.array([values @ leg[np.ix_(columns, columns)] @ values for leg in view.alone])
    order = np.argsort(-said)
    needed = int(np.searchsorted(np.cumsum(said[order]), _TELLING * said.sum())) + 1
    return np.asarray(order[:needed])


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


def rivals_of(view: View, names: tuple[str, ...], name: str) -> dict[str, float]:
    """Effects that would explain almost as much in the place of ``name``: by how much less, in log evidence."""
    others = tuple(each for each in names if each != name)
    mine = view.evidence(names)
    result = {}
    for rival in view.names:
        if rival not in names and view.possible((*others, rival)):
            less = mine - view.evidence((*others, rival))
            result[rival] = less
    return result


def moved_to(view: View, names: Sequence[str]) -> Coordinates:
    """The free coordinates at which the equations are to be made linear next."""
    fit = view.fit(names, prior=True)
    return {name: tuple(fit.values[view.places(fit, name)].tolist()) for name in names}


@dataclass(frozen=True, slots=True)
class Naming:
    """What was named: the effects, how each stands, the last view of the data, linear about them."""

    names: tuple[str, ...]
    tests: dict[str, Tested]
    view: View


def named(
    log: Log,
    model: Model,
    tolerance: float,
    noise: Noise,
    loose: Loose = frozenset(),
    barred: frozenset[str] = frozenset(),
    progress: Progress = lambda share: None,
) -> Naming:
    """Search, make linear about what is found, and search again until it stays; then test it.

    Who fails a test is barred, and the search goes on without. ``loose`` are families beyond the catalogue that may
    be as large as the data make them (:func:`.examine.examined`).
    """

    def look(at: Coordinates) -> View:
        return view_of(examined(log, replace(model, at=at), tolerance, noise, loose))

    view = look({})
    at = _begun(view, look, barred)
    for number in range(_LOOKS):
        view = look(at) if at else view
        names = searched(view, barred)
        progress(min(0.9, (number + 1) / 4.0))
        if not stays(view, names, at, _SETTLED, _SETTLED_SHARE) and number < _LOOKS - 1:
            at = moved_to(view, names)
            continue
        view = view_of(view.examination, by_leg=True)
        names, tests, barred = _standing(view, names, barred)
        if set(names) == set(at):
            break
        at = moved_to(view, names)
    return Naming(names, tests, view)


def _begun(view: View, look: Callable[[Coordinates], View], barred: frozenset[str]) -> Coordinates:
    """What to be linear about first: what a look about nothing finds, or one strong delay by itself.

    About nothing a long delay is no more like itself than like several others. About itself it explains all.
    """
    names = searched(view, barred)
    late = {name for name, effect in view.examination.model.catalogue.items() if effect.family == "clock"}
    if len(names) < 2 or not late & set(names):
        return moved_to(view, names)
    singles = sorted(late - barred, key=lambda name: -view.evidence([name]))[:_CLOSER]
    starts = [names, *((name,) for name in singles if view.possible([name]))]

    def explained(at: Coordinates) -> float:
        seen = look(at)
        return seen.evidence(searched(seen, barred)) - 0.5 * float(seen.inner[0, 0])

    return max((moved_to(view, start) for start in starts), key=explained)


def _standing(
    view: View, names: tuple[str, ...], barred: frozenset[str]
) -> tuple[tuple[str, ...], dict[str, Tested], frozenset[str]]:
    """The effects that stand all tests, how they stand, and who is barred; who fails makes place for others."""
    while True:
        tests = {name: tested(view, names, name) for name in names}
        failed = [each for each in tests.values() if not each.accepted]
        if not failed:
            return names, tests, barred
        worst = max(failed, key=lambda each: each.p_value)
        barred |= {worst.name, *(each.name for each in failed if each.hopeless)}
        names = searched(view, barred)


def stays(view: View, names: Sequence[str], at: Coordinates, errors: float, share: float = 0.0) -> bool:
    """Whether the equations are linear about what is found already.

    Nothing moves by more than so many standard errors and a share of its size.
    """
    if set(names) != set(at):
        return False
    slack = errors * np.sqrt(np.diag(view.fit(names).covariance))
    now = moved_to(view, names)
    new, old = (np.array([each for name in names for each in some[name]]) for some in (now, at))
    return bool((np.abs(new - old) <= slack + share * np.abs(old)).all())
