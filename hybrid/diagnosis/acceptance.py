"""Selection and acceptance: the search for effects, then tests of each, of what remains, of composite effects.

The selection is stepwise, by evidence: forward, backward and swap steps over the catalogue. The evidence for a set
of effects weighs how well they explain the data against how much they could have explained (MacKay 1992, Kass and
Raftery 1995); each effect also pays a penalty for the size of the catalogue. Every selected effect must then pass
the tests, given the others.

A named effect must not be explicable by chance, given the size of the catalogue and the scatter of its score
from leg to leg; it must predict held-out legs; and it must not be too small to matter.

Lack of fit: each family of :func:`~seatrial.hybrid.diagnosis.regression.nuisance_basis` is tested against what the
named effects, the tolerance and the noise leave, by a chi-square test of all its columns jointly; and the
tolerance itself, whether the error of the forces of speeds and thruster settings exceeds it. The size of a
significant family is the root mean square of the force, or of the effect's parameter, that it stands for.

Composite effects: an effect outside the catalogue is taken for the most similar one, often for two of its
family at once, such as losses of thrust at the port and at the starboard pod for a loss at both. If the
catalogue contains an effect that the two combine to, it was tried and was worse. If it does not, no data can
tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, t

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis import disturbance_model, regression
from seatrial.hybrid.diagnosis.linearise import Signature, linearise
from seatrial.hybrid.effects import Effect

if TYPE_CHECKING:
    from seatrial.hybrid.diagnosis.few_causes import CauseFit

CLOSE = 4.5
"""A rival that lacks less log evidence than this stays in the answer: the truth is excluded once in 700 times."""

SEEN = 3.0
"""A factor: rivals that lack up to this many times as much are reported, or examined at their own
linearisation."""

_PAIRS_OF = 8
_EXACT = 1e-9  # relative rounding error allowed in 64 bits
_SETTLED, _SETTLED_SHARE = 0.3, 0.01  # of a standard error, and of the size
MAX_EFFECTS = 6
"""The largest number of effects in a search."""

MAX_LINEARISATIONS = 10
"""The largest number of linearisations."""

_MODEL_ERRORS = (0.1, 0.175, 0.25, 0.35, 0.5)  # shares of the tolerance
_LIKE_EFFECTS = 2.0
"""A factor: wrong coefficients of a model resemble effects more than the random forces do by which the tolerance is
described. Of 11 sizes, found with coefficients wrong by about the tolerance, 9 were in their intervals by the
likeliest share of it, 11 by twice that, and of 24 with exact ones 23 by either."""

_CLOSER = 3  # single delays examined more closely where several effects seem present
_SWAPS, _DOUBT = 2, 0.25  # rivals examined more closely, if they lack less than this share of the evidence

Coordinates = Mapping[str, tuple[float, ...]]
"""Free coordinates of effects by name."""


def search_effects(evidence: regression.Evidence, excluded: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """The at most :data:`MAX_EFFECTS` effects with most evidence, by steps from no effect or the best pair."""
    allowed = [name for name in evidence.effect_names if name not in excluded]
    singles = sorted(allowed, key=lambda name: -evidence.log_odds([name]))
    starts: list[tuple[str, ...]] = [()]
    pairs = [pair for pair in combinations(singles[:_PAIRS_OF], 2) if evidence.are_possible(pair)]
    if pairs:
        starts.append(max(pairs, key=evidence.log_odds))
    ends = []
    for names in starts:  # add, drop or swap one effect at a time, the best step first, until no step gains
        best = evidence.log_odds(names) if evidence.are_possible(names) else -np.inf
        better: tuple[float, tuple[str, ...]] | None = best, names
        while better is not None:
            best, names = better
            outside = [name for name in allowed if name not in names]
            added = [(*names, name) for name in outside] if len(names) < MAX_EFFECTS else []
            dropped = [tuple(member for member in names if member != name) for name in names]
            steps = [*added, *dropped, *((*remaining, name) for remaining in dropped for name in outside)]
            ranked = sorted(((evidence.log_odds(step), step) for step in steps), reverse=True)
            gains = (step for step in ranked if step[0] > best + 1e-9 and evidence.are_possible(step[1]))
            better = next(gains, None)
        ends.append(names)
    return max(ends, key=evidence.log_odds)


def possible_rivals(evidence: regression.Evidence, names: tuple[str, ...], name: str) -> list[str]:
    """Effects that could replace ``name``, other than itself over the same or another part of the trial."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    catalogue = evidence.equations.model.catalogue
    candidates = [
        rival
        for rival in evidence.effect_names
        if rival not in names and catalogue[rival].base != catalogue[name].base
    ]
    return [rival for rival in candidates if evidence.are_possible((*remaining, rival))]


def rivals_of(evidence: regression.Evidence, names: tuple[str, ...], name: str) -> dict[str, float]:
    """Effects that would explain almost as much in the place of ``name``, with the log evidence that they lack."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    mine = evidence.log_odds(names)
    return {
        rival: mine - evidence.log_odds((*remaining, rival)) for rival in possible_rivals(evidence, names, name)
    }


def log_density(evidence: regression.Evidence, names: Sequence[str]) -> float:
    """Log density of the data with these effects and priors, up to a constant of all linearisations."""
    equations = evidence.equations
    determinant = regression.restored_gram(equations, equations.gram.sum(axis=0), equations.nuisance_scale)[1]
    return evidence.log_odds(names) - 0.5 * (float(evidence.inner[0, 0]) + determinant)


def fitted_coordinates(evidence: regression.Evidence, names: Sequence[str]) -> Coordinates:
    """The free coordinates for the next linearisation; with some at their bounds, the others are refitted."""
    model, held = evidence.equations.model, dict[str, tuple[float, ...]]()
    while True:
        free, conditional = [name for name in names if name not in held], evidence
        if held:
            back = np.eye(len(evidence.inner))
            for name, coordinates in held.items():
                back[list(evidence.columns_of([name])), 0] = -np.array(coordinates)
            conditional = replace(evidence, inner=back.T @ evidence.inner @ back)
        fit = conditional.fit(free, with_prior=True)
        values = {name: tuple(fit.values[evidence.rows_in_fit(fit, name)].tolist()) for name in free}
        within = model.nearest_within_bounds(values)
        beyond = [name for name in free if not np.allclose(within[name], values[name], rtol=_EXACT, atol=0.0)]
        if not beyond:
            return {name: held.get(name) or within[name] for name in names}
        held |= {name: within[name] for name in beyond}


def has_converged(
    evidence: regression.Evidence, names: Sequence[str], at: Coordinates, errors: float, share: float = 0.0
) -> bool:
    """Whether the linearisation is already about the solution.

    No coordinate moves by more than a fraction of its standard error plus a share of its size.
    """
    if set(names) != set(at):
        return False
    slack = errors * np.sqrt(np.diag(evidence.fit(names).covariance))
    now = fitted_coordinates(evidence, names)
    new, old = (np.array([value for name in names for value in coordinates[name]]) for coordinates in (now, at))
    return bool((np.abs(new - old) <= slack + share * np.abs(old)).all())


@dataclass(frozen=True, slots=True)
class Selection:
    """The result of the fourth stage: the effects that explain the data best, before testing.

    ``names`` are the effects and ``evidence`` is linearised about ``at``, their free coordinates; ``excluded``
    ones may no longer be selected. ``tried`` has the log density of the data with each starting set, linearised
    about itself; ``linearisations`` counts them.
    """

    names: tuple[str, ...]
    evidence: regression.Evidence
    at: Coordinates = field(default_factory=dict)
    excluded: frozenset[str] = frozenset()
    tried: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    linearisations: int = 0


def select_effects(evidence: regression.Evidence, progress: Progress = lambda share: None) -> Selection:
    """The fourth stage: stepwise selection by evidence, linearised about the result until it stays.

    The first linearisation is about the result of a search linearised about no effect, or about one that is almost
    as good there: the sensitivity to a large effect at zero is not its sensitivity at its size.
    """
    names = search_effects(evidence)
    starts = _starting_sets(evidence, names)
    if len(starts) == 1:
        return continue_search(Selection((), evidence, fitted_coordinates(evidence, names)), progress)
    densities, places = dict[tuple[str, ...], float](), []
    for start in starts:
        at, relinearised = linear_about_itself(evidence, start)
        if relinearised.are_possible(start):
            densities[start] = log_density(relinearised, start)
        places.append((log_density(relinearised, search_effects(relinearised)), at))
    at = max(places, key=lambda place: place[0])[1]
    return continue_search(Selection((), evidence, at, tried=densities), progress)


def _starting_sets(evidence: regression.Evidence, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """``names``, and sets that may turn out better when they are linearised about themselves.

    Single delays; the same effects with one replaced by a close rival; and with a lag or a play moved to other
    drives, since these are one-sided, and large ones act differently from small ones, so that one drive is easily
    mistaken for another.
    """
    delays, swaps, moves = list[tuple[str, ...]](), list[tuple[float, tuple[str, ...]]](), list[tuple[str, ...]]()
    clocks = {name for name, effect in evidence.equations.model.catalogue.items() if effect.family == "clock"}
    if len(names) >= 2 and clocks & set(names):  # about zero, a long delay resembles others as much as itself
        strongest = sorted(clocks, key=lambda name: -evidence.log_odds([name]))[:_CLOSER]
        delays = [(name,) for name in strongest if evidence.are_possible([name])]
    for name in names:
        remaining = tuple(member for member in names if member != name)
        gain = evidence.log_odds(names) - evidence.log_odds(remaining)
        for rival, deficit in rivals_of(evidence, names, name).items():
            if CLOSE < deficit < _DOUBT * gain:
                swaps.append((deficit, (*remaining, rival)))
        moves += [(*remaining, substitute) for substitute in _on_other_drives(evidence, name, remaining)]
    closest = [swapped for _, swapped in sorted(swaps)[:_SWAPS]]
    return list(dict.fromkeys([names, *delays, *closest, *filter(evidence.are_possible, moves)]))


def continue_search(selection: Selection, progress: Progress = lambda share: None) -> Selection:
    """Search among the effects not excluded, starting from the linearisation of ``selection``, until converged."""
    evidence, at = selection.evidence, selection.at
    for number in range(selection.linearisations + 1, MAX_LINEARISATIONS + 1):
        evidence = linear_about(evidence, at) if at else evidence
        names = search_effects(evidence, selection.excluded)
        progress(min(0.9, number / 4.0))
        if number == MAX_LINEARISATIONS or has_converged(evidence, names, at, _SETTLED, _SETTLED_SHARE):
            break
        at = fitted_coordinates(evidence, names)
    return replace(selection, names=names, evidence=evidence, at=at, linearisations=number)


def linear_about(
    evidence: regression.Evidence,
    at: Coordinates,
    known_effects: Sequence[Signature] | None = None,
    number: int | None = None,
) -> regression.Evidence:
    """The evidence of the same data, linearised about effects ``at`` these free coordinates.

    ``known_effects`` are signatures that are already computed; the tolerance has ``number`` features, by default as
    before.
    """
    before = evidence.equations
    linearisation = linearise(before.log, replace(before.model, at=at), before.tolerance, known_effects)
    equations = regression.normal_equations(linearisation, before.noise, number=number or before.layout.features)
    return regression.evidence_of(replace(equations, layout=replace(equations.layout, prior=before.layout.prior)))


def relinearise_at_fit(
    evidence: regression.Evidence, names: Sequence[str], number: int | None = None
) -> regression.Evidence:
    """The evidence linearised about the fit of ``names``."""
    return linear_about(evidence, fitted_coordinates(evidence, names), number=number)


def linear_about_itself(
    evidence: regression.Evidence, names: tuple[str, ...]
) -> tuple[Coordinates, regression.Evidence]:
    """A set of effects at the values that explain most, as far as two steps reach, and the evidence about them."""
    at = fitted_coordinates(evidence, names)
    relinearised = linear_about(evidence, at)
    if not relinearised.are_possible(names) or has_converged(relinearised, names, at, _SETTLED, _SETTLED_SHARE):
        return at, relinearised
    at = fitted_coordinates(relinearised, names)
    return at, linear_about(evidence, at)


@dataclass(frozen=True, slots=True)
class Swap:
    """``names``, in which ``rival`` replaces ``name``, and the evidence linearised about them."""

    name: str
    rival: str
    names: tuple[str, ...]
    evidence: regression.Evidence


def linearised_swaps(evidence: regression.Evidence, names: tuple[str, ...]) -> list[Swap]:
    """Candidates to replace one of ``names``, each linearised about its own best fit.

    These are the same lag or play on other drives, and the closest of the rivals that seem to lack little:
    linearised about another effect, a rival looks different.
    """
    at, swaps = fitted_coordinates(evidence, names), list[Swap]()
    for name in names:
        remaining = tuple(candidate for candidate in names if candidate != name)
        deficits = rivals_of(evidence, names, name)
        close = sorted(
            (candidate for candidate in deficits if CLOSE < deficits[candidate] < SEEN * CLOSE),
            key=deficits.__getitem__,
        )
        for rival in dict.fromkeys([*_on_other_drives(evidence, name, remaining), *close[:_SWAPS]]):
            swapped = (*remaining, rival)
            alike = len(evidence.columns_of([rival])) == len(at[name]) and rival not in close
            start = {**at, rival: at[name]} if alike else fitted_coordinates(evidence, swapped)
            relinearised = linear_about(evidence, {member: start[member] for member in swapped})
            relinearised = relinearise_at_fit(relinearised, swapped)
            if relinearised.are_possible(swapped):
                swaps.append(Swap(name, rival, swapped, relinearised))
    return swaps


def _on_other_drives(evidence: regression.Evidence, name: str, remaining: Sequence[str]) -> list[str]:
    """A lag or a play on other drives than ``name``'s."""
    catalogue = evidence.equations.model.catalogue
    effect = catalogue[name]
    if effect.kind != "actuator" or effect.parameters[0].neutral != effect.parameters[0].low:
        return []
    relatives = [
        relative
        for relative in effect.confused_with
        if relative in evidence.effect_names and relative not in remaining
    ]
    return [relative for relative in relatives if catalogue[relative].parameters == effect.parameters]


FALSE_ALARM = 0.005
"""The probability, for each test, that a trial with nothing hidden shows any effect."""

HELD_OUT_LEVEL = 0.05
"""The one-sided level at which an effect has to predict held-out legs."""

_UNEVEN = 0.15  # of its own size: no current is perfectly uniform
_OWN_FORM = 0.03  # of its own size: beyond this the effect has another form than its name says
_NEGLIGIBLE = 0.01  # of what the named effects explain: no effect's form is exact
_INFORMATIVE_SHARE = 0.95  # of the information is in the legs that test an effect
_FEW_LEGS = 3  # with fewer there is no scatter to test by: the sum has to be positive

CHANCE = 0.0001
"""The probability that a trial with nothing beyond its named effects and the tolerance shows any family."""

INTERACTION_CHANCE = 0.01
"""The probability that correctly named effects seem to have another form."""

_RANK = 1e-5
_CLOSE_TO_LIKELIEST = 0.03  # of the tolerance's size, whose own error is about a tenth
_NOTHING = 1e-6  # of a column's squares

CREDIBLE = 3
"""The most effects of an ordinary model; more are usually imitations of one outside the catalogue, unless they
replicate."""

_SPANNED = 0.9  # of an effect's squares: two that explain so much of it combine to it


@dataclass(frozen=True, slots=True)
class AcceptanceTests:
    """Tests of one effect, given the others.

    ``gain`` in z' V^-1 z; ``p_value`` of that gain over ``spread``, the overdispersion of the score from leg to
    leg (at least 1), corrected for the size of the catalogue; ``p_held_out`` one-sided, on held-out legs;
    ``large_enough`` whether its 95 % interval reaches a size that matters.
    """

    name: str
    gain: float
    p_value: float
    spread: float
    p_held_out: float
    large_enough: bool

    @property
    def is_accepted(self) -> bool:
        """Whether it passes all tests."""
        return self.p_value < FALSE_ALARM and self.p_held_out < HELD_OUT_LEVEL and self.large_enough


def acceptance_tests(evidence: regression.Evidence, names: tuple[str, ...], name: str) -> AcceptanceTests:
    """Test one of the effects ``names``, given the others."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    complete, reduced = evidence.fit(names), evidence.fit(remaining)
    gain = complete.gain - reduced.gain
    spread = score_spread(evidence, names, name)
    p_value = evidence.chance_of_gain(gain / spread, len(evidence.columns_of([name])))
    noncentrality = _noncentrality_by_leg(evidence, complete, name)
    gains = unseen_gains(evidence, remaining, names)
    order = np.argsort(-noncentrality)  # legs without information cannot confirm an effect
    needed = np.searchsorted(np.cumsum(noncentrality[order]), _INFORMATIVE_SHARE * noncentrality.sum())
    informative = order[: int(needed) + 1]
    p_held_out = chance_of_gains(gains[informative] / np.sqrt(np.maximum(noncentrality[informative], 1e-300)))
    places = evidence.rows_in_fit(complete, name)
    reach = np.abs(complete.values[places]) + 1.96 * np.sqrt(np.diag(complete.covariance)[places])
    large_enough = bool((reach >= np.array(evidence.equations.model.catalogue[name].smallest_free)).any())
    return AcceptanceTests(name, gain, p_value, spread, p_held_out, large_enough)


def _noncentrality_by_leg(evidence: regression.Evidence, fit: regression.JointFit, name: str) -> Floats:
    """The noncentrality [L] of the gain in each leg for an effect of the fitted size."""
    columns = np.array(evidence.columns_of([name]))
    values = fit.values[evidence.rows_in_fit(fit, name)]
    return np.array([values @ leg[np.ix_(columns, columns)] @ values for leg in evidence.inner_by_leg])


def chance_of_gains(gains: Floats) -> float:
    """The p-value of the legs' gains under no effect (Student 1908).

    Gains are in units of their scatter, which grows with the square root of a leg's information; otherwise the
    most informative leg would dominate the scatter.
    """
    deviation = gains.std(ddof=1) / np.sqrt(len(gains)) if len(gains) >= _FEW_LEGS else 0.0
    return float(t.sf(gains.mean() / max(float(deviation), 1e-12), max(len(gains) - 1, 1)))


def score_spread(evidence: regression.Evidence, names: tuple[str, ...], name: str) -> float:
    """The :func:`overdispersion` of the score of one of the effects ``names``, at least 1."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    tested, remaining_columns, all_columns = (
        np.array(evidence.columns_of(group), dtype=int) for group in ([name], remaining, names)
    )
    return max(1.0, float(overdispersion(evidence.equations, tested, remaining_columns, all_columns).max()))


def overdispersion(equations: regression.NormalEquations, columns: Ints, remaining: Ints, fitted: Ints) -> Floats:
    """The scatter of each column's score from leg to leg, over that expected from the noise model.

    The score is the product of the residual of a fit of the ``fitted`` columns with the column itself, after
    removing what the ``remaining`` ones and the nuisances could explain (White 1980, clustered by leg).
    """
    gram = equations.gram
    count, total = len(gram), gram.sum(axis=0)
    if count < 4:
        return np.ones(len(columns))
    nuisance, scale = equations.nuisance, equations.nuisance_scale
    direction = np.zeros((len(total), len(columns)))
    direction[columns, np.arange(len(columns))] = 1.0
    direction = _residual_columns(total, direction, remaining, nuisance, scale)
    residual = _residual_columns(total, regression.restored_data(equations)[:, None], fitted, nuisance, scale)[:, 0]
    scores = np.stack([direction.T @ (leg @ residual) for leg in gram])
    information = np.stack([np.einsum("ij,ij->j", direction, leg @ direction) for leg in gram])
    total_information = np.maximum(information.sum(axis=0), 1e-300)  # some columns carry no information
    centred = scores - information * scores.sum(axis=0) / total_information
    return np.asarray((centred**2).sum(axis=0) / total_information * count / (count - 1))


def _residual_columns(total: Floats, vectors: Floats, fixed: Ints, nuisance: Ints, scale: Floats) -> Floats:
    """``vectors`` [C, d] less what fixed columns (freely) and nuisances (at their scale) explain of it."""
    columns = np.concatenate([fixed, nuisance])
    penalty = np.concatenate([np.zeros(len(fixed)), scale**-2.0])
    normal = total[np.ix_(columns, columns)] + np.diag(penalty)
    if not columns.size:
        return vectors
    information = np.diag(normal)  # none of an effect that the others have made ineffective
    ridge = np.diag(np.where(information > 0.0, 1e-12 * information, 1.0))
    weight = np.linalg.solve(normal + ridge, total[columns] @ vectors)
    result = vectors.copy()
    np.subtract.at(result, columns, weight)  # an effect may be fixed and a nuisance: its column comes twice
    return result


def unseen_gains(evidence: regression.Evidence, without: tuple[str, ...], names: tuple[str, ...]) -> Floats:
    """The gain in each leg's log density [L] from ``names``, fitted to all other legs, over ``without``.

    Nuisances are free again in each leg: otherwise, having been fitted to the other legs, they would know the
    effect as well as the effect itself.
    """

    def density(leg: int, subset: tuple[str, ...]) -> float:
        columns, inner = np.array(evidence.columns_of(subset), dtype=int), evidence.inner_by_leg[leg]
        values = regression.fit_columns(
            evidence.left_out[leg], evidence.columns_of(subset), evidence.prior_deviations(subset)
        ).values
        return float(values @ inner[columns, 0] - 0.5 * values @ inner[np.ix_(columns, columns)] @ values)

    return np.array([density(leg, names) - density(leg, without) for leg in range(len(evidence.inner_by_leg))])


@dataclass(frozen=True, slots=True)
class NuisanceFamily:
    """A family: what its forces depend on, the axis or the varying effect, its columns."""

    depends: str
    what: str
    columns: Ints


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """The test of one family: ``p_value`` corrected for all of its kind, ``size`` in the unit of ``what``.

    ``gain`` is the sum of squares that it explains; ``size`` is that of what it adds to the tolerance.
    """

    depends: str
    what: str
    p_value: float
    gain: float
    size: float
    matters: bool

    @property
    def is_significant(self) -> bool:
        """Whether it is unlikely by chance and large enough to matter."""
        return (
            self.p_value < (INTERACTION_CHANCE if self.depends in regression.INTERACTIONS else CHANCE)
            and self.matters
        )


def nuisance_families(equations: regression.NormalEquations) -> list[NuisanceFamily]:
    """All families of the nuisance basis."""
    layout = equations.layout
    result = [
        NuisanceFamily(depends, name, layout.nuisance_columns(axis, depends))
        for axis, name in enumerate(regression.AXES)
        for depends in dict.fromkeys(layout.depends)
    ]
    for label in dict.fromkeys(layout.varying):
        indices = np.flatnonzero([varying_label == label for varying_label in layout.varying])
        target, depends = label.split("*")
        result.append(NuisanceFamily(depends, target, indices + layout.first_varying))
    return result


def lack_of_fit(evidence: regression.Evidence, fitted_effects: Sequence[str]) -> list[LackOfFit]:
    """Test every family of the nuisance basis, and the tolerance, beside effects that are fitted freely.

    The most significant comes first.
    """
    equations, families = evidence.equations, nuisance_families(evidence.equations)
    effect_columns = np.array(evidence.columns_of(fitted_effects), dtype=int)
    family_columns = np.concatenate([family.columns for family in families])
    # Inner products of data, effects, families, in this order; the model's own effects are back in the data.
    gram, restored = equations.gram.sum(axis=0), regression.restored_data(equations)
    of_data = gram @ restored
    gram[:, 0] = gram[0] = of_data
    gram[0, 0] = restored @ of_data
    kept = np.concatenate([[0], effect_columns, family_columns])
    inner = regression.marginalise(gram, kept, equations.nuisance, equations.nuisance_scale)[0]
    first_family = 1 + len(effect_columns)
    if len(effect_columns):  # what is left of all when the effects explain what they can
        effects = slice(1, first_family)
        residual = inner - inner[:, effects] @ np.linalg.solve(inner[effects, effects], inner[effects])
        negligible = np.diag(residual) < _NOTHING * np.diag(inner)
        residual[negligible] = residual[:, negligible] = 0.0
        inner = residual
    row_of = {int(column): first_family + number for number, column in enumerate(family_columns)}
    interactions = sum(family.depends in regression.INTERACTIONS for family in families)
    tests = len(families) - interactions + 1
    result = [_test_tolerance(equations, evidence, fitted_effects, tests)]
    for family in families:
        chances = interactions if family.depends in regression.INTERACTIONS else tests
        rows = [row_of[int(column)] for column in family.columns]
        judged = _tested_family(equations, inner, rows, family, chances, 1.0)
        if judged.is_significant:  # overdispersed from leg to leg: counts for less
            spread = float(np.median(overdispersion(equations, family.columns, effect_columns, effect_columns)))
            judged = _tested_family(equations, inner, rows, family, chances, max(spread, 1.0))
        result.append(judged)
    return sorted(result, key=lambda lack: lack.p_value)


def _tested_family(
    equations: regression.NormalEquations,
    inner: Floats,
    rows: list[int],
    family: NuisanceFamily,
    tests: int,
    spread: float,
) -> LackOfFit:
    information, right = inner[np.ix_(rows, rows)], inner[rows, 0]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    significant = values > _RANK * max(float(values[-1]), _RANK)
    along = vectors[:, significant].T @ (right / scale)
    gain = float((along**2 / values[significant]).sum()) / spread
    p_value = min(1.0, tests * float(chi2.sf(gain, int(significant.sum())))) if significant.any() else 1.0
    back = vectors[:, significant] / scale[:, None]
    estimate, chance = back @ (along / values[significant]), float((back**2 / values[significant]).sum())
    size = float(np.sqrt(max(float((estimate**2).sum()) - chance, 0.0)))  # less the expected size from noise alone
    matters = True
    if family.what in regression.AXES:
        size *= float(disturbance_model.FORCE_UNITS[regression.AXES.index(family.what)])
    elif family.depends not in regression.INTERACTIONS:  # another form, however small, means that the name is wrong
        matters = size > max(equations.model.catalogue[family.what].smallest_free)
    return LackOfFit(family.depends, family.what, p_value, gain, size, matters)


def _test_tolerance(
    equations: regression.NormalEquations, evidence: regression.Evidence, names: Sequence[str], tests: int
) -> LackOfFit:
    """Whether the error of the forces of speeds and thrusters exceeds the tolerance, and its most likely size."""
    nuisance, scale = equations.nuisance, equations.nuisance_scale
    wider = np.isin(nuisance, np.concatenate([equations.layout.feature_columns(axis) for axis in range(3)]))
    gram, columns = equations.gram.sum(axis=0), np.array(evidence.columns_of(names), dtype=int)

    def cost(log_factor: float) -> float:
        """Minus the log density of the data, the effects ``names`` fitted freely; up to a constant."""
        tolerated = scale * np.where(wider, np.exp(log_factor), 1.0)
        inner, determinant = regression.restored_gram(equations, gram, tolerated)
        misfit = inner[0, 0]
        if columns.size:
            information = inner[np.ix_(columns, columns)]
            misfit -= inner[0, columns] @ np.linalg.solve(information, inner[columns, 0])
            determinant += float(np.linalg.slogdet(information)[1])
        return 0.5 * float(misfit + determinant)

    limit = np.log(1.0 / equations.tolerance)  # the whole range
    optimum = minimize_scalar(cost, bounds=(0.0, limit), method="bounded", options={"xatol": _CLOSE_TO_LIKELIEST})
    gain = 2.0 * max(cost(0.0) - float(optimum.fun), 0.0)
    factor = float(np.exp(optimum.x)) if gain > 0.0 else 1.0
    return LackOfFit(
        regression.OPERATION, "force", min(1.0, tests * float(chi2.sf(gain, 1))) if gain > 0.0 else 1.0, gain,
        factor * equations.tolerance, factor > 1.0,
    )  # fmt: skip


def composite_effects(evidence: regression.Evidence, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Groups of named effects each of which may be one effect outside the catalogue: related ones, or many of a
    family."""
    catalogue = evidence.equations.model.catalogue
    groups = [set(family) for family in families_with_many_effects(evidence, names)]
    for first, second in combinations(names, 2):
        a, b = catalogue[first], catalogue[second]
        alike = a.family == b.family and a.kind == b.kind and not (_often_together(a) or _often_together(b))
        confused = a.family == "clock" or b.base in a.confused_with or a.base in b.confused_with
        if not (alike and confused):  # one cause may hardly appear as both
            continue
        spanned = (  # an effect of the catalogue that the two combine to, each contributing, was tried
            _explained_share(evidence, name, (first, second))
            > _SPANNED
            > max(_explained_share(evidence, name, (single,)) for single in (first, second))
            for name, effect in catalogue.items()
            if effect.family == a.family and name not in (first, second)
        )
        if any(spanned):
            continue
        joined = [group for group in groups if group & {first, second}]
        groups = [group for group in groups if group not in joined] + [{first, second}.union(*joined)]
    return [tuple(name for name in names if name in group) for group in groups]


def families_with_many_effects(evidence: regression.Evidence, names: Sequence[str]) -> list[tuple[str, ...]]:
    """The named effects of each family of which there are more than an ordinary model lacks."""
    catalogue = evidence.equations.model.catalogue
    alone = [name for name in names if not _often_together(catalogue[name])]
    family_names = dict.fromkeys(catalogue[name].family for name in alone)
    families = (tuple(name for name in alone if catalogue[name].family == family) for family in family_names)
    return [members for members in families if len(members) > CREDIBLE]


def _often_together(effect: Effect) -> bool:
    """Whether it commonly occurs together with others of its family.

    Sea and current come together, and each instrument has its own errors; a factor on the wind load is an error
    of the model.
    """
    return effect.family == "sensor" or (effect.family == "environment" and effect.parameters[0].unit != "1")


def _explained_share(evidence: regression.Evidence, name: str, names: Sequence[str]) -> float:
    """The share of an effect's whitened signature that others explain, in the direction they explain least."""
    columns, explaining = np.array(evidence.columns_of([name])), np.array(evidence.columns_of(names))
    size = np.sqrt(np.maximum(np.diag(evidence.inner)[columns], 1e-300))
    return float(
        np.linalg.eigvalsh(regression.explained_by(evidence.inner, columns, explaining) / np.outer(size, size))[0]
    )


@dataclass(frozen=True)
class Acceptance:
    """The result of the fifth stage: the effects that pass all tests, and what they leave unexplained.

    ``names`` are the effects, ``tests`` their test results; ``evidence`` is linearised about them and holds every
    leg. ``rival_deficits`` is, by name and rival, the log evidence that the rival lacks when linearised about it;
    ``lack_of_fit`` the families of the nuisance basis that are significant and matter, the most significant first.
    ``causes`` are effects that stay named in spite of such a remainder, with sizes fitted to tracks
    (:mod:`.few_causes`). ``doubtful`` are those that :func:`drop_doubtful` left out.
    """

    names: tuple[str, ...]
    tests: Mapping[str, AcceptanceTests]
    evidence: regression.Evidence
    rival_deficits: Mapping[tuple[str, str], float] = field(default_factory=dict)
    lack_of_fit: tuple[LackOfFit, ...] = ()
    causes: CauseFit | None = None
    doubtful: tuple[str, ...] = ()

    @property
    def beside_remainder(self) -> bool:
        """Whether the effects stay named in spite of what remains."""
        return self.causes is not None

    @property
    def coordinates(self) -> Coordinates:
        """The free coordinates of the effects."""
        return self.causes.at if self.causes else fitted_coordinates(self.sized, self.names)

    @cached_property
    def sized(self) -> regression.Evidence:
        """The evidence that sizes are fitted to (:func:`with_likely_model_error`)."""
        return with_likely_model_error(self.evidence, self.names)

    def coordinates_with_covariance(self, name: str) -> tuple[Floats, Floats]:
        """The free coordinates of an effect [K], and their covariance [K, K]."""
        if self.causes:
            places = self.causes.rows_of(name)
            return np.array(self.causes.at[name]), self.causes.covariance[np.ix_(places, places)]
        fit = self.sized.fit(self.names, with_prior=True)
        places = self.sized.rows_in_fit(fit, name)
        spread = score_spread(self.sized, self.names, name)
        return fit.values[places], fit.covariance[np.ix_(places, places)] * spread

    def correlation(self) -> tuple[list[str], Floats]:
        """The name of each free coordinate, and the correlation of all [K, K]."""
        if self.causes:
            owners = [name for name in self.names for _ in self.causes.at[name]]
            order, covariance = list(range(len(owners))), self.causes.covariance
        else:
            fit = self.sized.fit(self.names)
            order = [place for name in self.names for place in self.evidence.rows_in_fit(fit, name)]
            owners = [name for name in self.names for _ in self.evidence.rows_in_fit(fit, name)]
            covariance = fit.covariance
        deviation = np.sqrt(np.diag(covariance))
        return owners, np.asarray((covariance / np.outer(deviation, deviation))[np.ix_(order, order)])


def accept(selection: Selection) -> Acceptance:
    """The fifth stage: test every selected effect and compare its rivals, then test what they leave unexplained.

    Each named effect may then also vary with the operating point, as a related effect outside the catalogue
    would.
    """
    accepted = accept_names(selection)
    swaps = linearised_swaps(accepted.evidence, accepted.names)
    best = max(swaps, key=lambda swap: log_density(swap.evidence, swap.names), default=None)
    # The most likely rival replaces the name if it passes all tests. No search is made from it: starting from a
    # wrong set, a search adds more imitations.
    if best is not None and log_density(best.evidence, best.names) > log_density(accepted.evidence, accepted.names):
        tests = {name: acceptance_tests(best.evidence, best.names, name) for name in best.names}
        if all(test.is_accepted for test in tests.values()):
            accepted = Acceptance(best.names, tests, best.evidence)
            swaps = linearised_swaps(best.evidence, best.names)
    evidence, names, deficits = accepted.evidence, accepted.names, dict(accepted.rival_deficits)
    for swap in swaps:  # at its own fitted size, reduced where legs disagree
        deficit = log_density(evidence, names) - log_density(swap.evidence, swap.names)
        gains = log_density_by_leg(evidence, names) - log_density_by_leg(swap.evidence, swap.names)
        noncentrality = _noncentrality_by_leg(evidence, evidence.fit(names), swap.name)
        deficits[swap.name, swap.rival] = penalise_by_leg_scatter(deficit, gains, noncentrality)
    accepted = replace(accepted, rival_deficits=deficits)
    if accepted.names:
        equations = accepted.evidence.equations
        repeated = regression.normal_equations(equations, equations.noise, interactions=accepted.names)
        accepted = replace(accepted, evidence=regression.evidence_of(repeated))
    return replace(accepted, lack_of_fit=lack_of_fit_that_matters(accepted))


def with_likely_model_error(evidence: regression.Evidence, names: Sequence[str]) -> regression.Evidence:
    """The evidence with as much error of the model beside effects as the data speak for, at most the tolerance.

    What counts as missing is held against the whole tolerance, which is the user's choice. A size is as uncertain
    as the forces that remain in these data make it; their likeliest amount is found by the evidence (MacKay 1992).
    """
    errors = {share: regression.with_model_error(evidence, share) for share in _MODEL_ERRORS}
    likeliest = max(errors, key=lambda share: log_density(errors[share], names))
    return regression.with_model_error(evidence, _LIKE_EFFECTS * likeliest)


def log_density_by_leg(evidence: regression.Evidence, names: tuple[str, ...]) -> Floats:
    """Log density of each leg's data [L] with these effects as fitted to all legs, up to a constant."""
    columns, values = np.array(evidence.columns_of(names), dtype=int), evidence.fit(names, with_prior=True).values
    weights = np.zeros(len(evidence.inner))
    weights[0], weights[columns] = 1.0, -values
    return np.array([-0.5 * float(weights @ leg @ weights) for leg in evidence.inner_by_leg])


def penalise_by_leg_scatter(log_odds: float, gains: Floats, noncentrality: Floats) -> float:
    """``log_odds`` of one set of effects against another, reduced where legs scatter beyond the noise.

    ``gains`` [L] are the legs' log odds, ``noncentrality`` [L] the information in each. For two sets that differ by
    d standard errors the log odds are d^2 / 2 in the mean, with standard deviation d: their variance is twice
    their mean. Where the variance is a larger s^2, the log odds of such a sum against its opposite are 2 log_odds^2
    / s^2 (cf. Vuong 1989, Econometrica 57, 307).
    """
    if len(gains) <= _FEW_LEGS or log_odds <= 0.0:
        return log_odds
    centred = gains - noncentrality / max(float(noncentrality.sum()), 1e-300) * gains.sum()
    variance = float((centred**2).sum()) * len(gains) / (len(gains) - 1)
    return log_odds / max(1.0, variance / (2.0 * log_odds))


def accept_names(selection: Selection) -> Acceptance:
    """Test every selected effect; one that fails is excluded, and the search goes on without it.

    The deficits of rivals are those of the sets that were tried.
    """
    while True:
        evidence, names, excluded = selection.evidence, selection.names, selection.excluded
        tests = {name: acceptance_tests(evidence, names, name) for name in names}
        while failed := [test for test in tests.values() if not test.is_accepted]:  # each makes room for others
            worst = max(failed, key=lambda test: test.p_value)
            hopeless = (test.name for test in failed if max(test.p_value, test.p_held_out) > 0.5)
            excluded |= {worst.name, *hopeless}
            names = search_effects(evidence, excluded)
            tests = {name: acceptance_tests(evidence, names, name) for name in names}
        if set(names) == set(selection.at) or selection.linearisations >= MAX_LINEARISATIONS:
            break
        at = fitted_coordinates(evidence, names)
        selection = continue_search(replace(selection, at=at, excluded=excluded))
    deficits = dict[tuple[str, str], float]()
    for candidate, density in selection.tried.items():
        dropped, added = set(names) - set(candidate), set(candidate) - set(names)
        if len(dropped) == len(added) == 1:
            deficits[dropped.pop(), added.pop()] = log_density(evidence, names) - density
    return Acceptance(names, tests, evidence, deficits)


def lack_of_fit_that_matters(accepted: Acceptance) -> tuple[LackOfFit, ...]:
    """The lack of fit beside the named effects that is more than a trace of their own form."""
    evidence = accepted.evidence
    fit, catalogue = evidence.fit(accepted.names), evidence.equations.model.catalogue

    def matters(lack: LackOfFit) -> bool:
        if named := [name for name in accepted.names if catalogue[name].base == lack.what.split(",")[0]]:
            # relative variation of a named effect
            coordinates = np.take(fit.values, evidence.rows_in_fit(fit, named[0]))
            least = _OWN_FORM if lack.depends in regression.INTERACTIONS else _UNEVEN
            return lack.size > least * float(np.linalg.norm(coordinates))
        return lack.gain > _NEGLIGIBLE * fit.gain

    return tuple(lack for lack in lack_of_fit(evidence, accepted.names) if lack.is_significant and matters(lack))


def drop_doubtful(accepted: Acceptance) -> Acceptance:
    """The acceptance without effects of another form than their name's, if these are negligible beside the others.

    A remainder in the form of one effect makes that name doubtful, and not others that explain a hundred times as
    much: folded waves of a 2 m craft gave a yaw rate bias that varied, and a current that explained 1,600 times as
    much was not named for it. The others have to pass their tests, and to leave no remainder that matters.
    """
    evidence, catalogue = accepted.evidence, accepted.evidence.equations.model.catalogue
    doubted = {lack.what.split(",")[0] for lack in accepted.lack_of_fit}
    doubtful = tuple(name for name in accepted.names if catalogue[name].base in doubted)
    names = tuple(name for name in accepted.names if name not in doubtful)
    gain = evidence.fit(accepted.names).gain
    if not doubtful or not names or gain - evidence.fit(names).gain > _NEGLIGIBLE * gain:
        return accepted
    tests = {name: acceptance_tests(evidence, names, name) for name in names}
    deficits = {pair: deficit for pair, deficit in accepted.rival_deficits.items() if pair[0] in names}
    remaining = replace(accepted, names=names, tests=tests, rival_deficits=deficits, doubtful=doubtful)
    is_enough = all(test.is_accepted for test in tests.values()) and not lack_of_fit_that_matters(remaining)
    return replace(remaining, lack_of_fit=()) if is_enough else accepted
