"""Coarse models: naming effects while other forces remain unexplained.

A model whose forces of speeds and thrusters err by far more than the tolerance, as with a sister ship's
coefficients, lacks many things at once. Some of them are effects of the catalogue, and what remains beside
these is no evidence against them. So a larger set is searched, and an effect is named if it keeps its sign over
disjoint parts of the trial and brings predicted tracks closer to the measured ones on legs that were not used
for its size. That last test is in metres: where predictions err by far more than the noise, evidence alone
would admit effects without end.

The search starts from all effects at once and removes those that held-out legs do not miss. A search that
starts from no effect does not converge for such a model: each linearisation brings another set. About all
effects together, each held by its prior and within its bounds, the residuals are small from the start. Their
sizes are the posterior mode, by damped Gauss-Newton steps (Nocedal and Wright, Numerical Optimization, 2006,
chapter 10).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis import acceptance, gap
from seatrial.hybrid.diagnosis.regression import FEW, INTERACTIONS, OPERATION, Evidence, marginalise
from seatrial.hybrid.diagnosis.result import Replication

COARSE = 3.0
"""The error of a coarse model's forces, in tolerances."""

MAX_EFFECTS = 14
"""The most effects of a coarse model: data distinguish some ten groups of a hull's coefficients (Abkowitz 1980,
SNAME Trans. 88)."""

WORTH = 0.01
"""The share of the mean distance on held-out legs by which an effect has to reduce it to be worth naming."""

_ROUNDS = 3  # of linearising and choosing
_ABOUT_ITSELF = 2  # linearisations about a single effect
_AS_LIKELY_AS_NOT = 0.5
# factor on the error of a coarse model: the third linearisation of six effects removes less misfit
_FOR_CERTAIN = 3.0
_CERTAIN = 1e-12
_ONE_SIDED_95 = 1.645  # standard errors: one-sided 95 % in a part of the trial
_DETECTABLE = 2.0 * _ONE_SIDED_95  # standard errors: significant in 95 of 100 parts
_FEWEST_PARTS = 2  # informative parts required

MOST_PARTS = 0.75
"""The share of the parts of a trial in which an effect has to be found independently."""

_MAX_STEPS = 8
_SHORTEST = 1.0 / 32.0
_ENOUGH = 1.0  # gain in log posterior density below which the search has converged


def is_coarse(accepted: acceptance.Acceptance) -> bool:
    """Whether many things are missing at once, or the model's own forces err by far more than the tolerance."""
    surest = _surest(accepted)
    if surest is None or surest.depends not in (OPERATION, *INTERACTIONS):
        return False  # a dependence on position, time or heading may have any cause
    return is_far_off(accepted) or len(accepted.names) > acceptance.CREDIBLE


def is_far_off(accepted: acceptance.Acceptance) -> bool:
    """Whether the model's own forces err by far more than the tolerance."""
    surest = _surest(accepted)
    far_off = COARSE * accepted.evidence.equations.tolerance
    return surest is not None and surest.depends == OPERATION and surest.size > far_off


def _surest(accepted: acceptance.Acceptance) -> acceptance.LackOfFit | None:
    return max(accepted.lack_of_fit, key=lambda lack: lack.gain, default=None)


def select_unless_coarse(
    evidence: Evidence, progress: Progress = lambda share: None, preliminary: acceptance.Selection | None = None
) -> acceptance.Selection:
    """The fourth stage, stopped after two linearisations if these leave a misfit that none would remove.

    ``preliminary`` is the selection after these two, if it is known.
    """
    preliminary = preliminary or preliminary_selection(evidence)
    surest = max(acceptance.lack_of_fit(preliminary.evidence, preliminary.names), key=lambda lack: lack.gain)
    far_off = _FOR_CERTAIN * COARSE * evidence.equations.tolerance
    if surest.significant and surest.depends == OPERATION and surest.size > far_off:
        return preliminary
    return acceptance.select_effects(evidence, progress)


def preliminary_selection(evidence: Evidence) -> acceptance.Selection:
    """The fourth stage's search, stopped after two linearisations."""
    return acceptance.continue_search(
        acceptance.Selection((), evidence, linearisations=acceptance.MAX_LINEARISATIONS - 2)
    )


def coarse_acceptance(selection: acceptance.Selection) -> acceptance.Acceptance | None:
    """An empty acceptance for a model so poor that tests against its noise would be meaningless, else None."""
    significant = tuple(
        lack for lack in acceptance.lack_of_fit(selection.evidence, selection.names) if lack.significant
    )
    untested = acceptance.Acceptance((), {}, selection.evidence, lack_of_fit=significant)
    return untested if is_coarse(untested) else None


def name_effects_of_coarse_model(
    first: acceptance.Acceptance, windows: gap.UnseenWindows, progress: Progress = lambda share: None
) -> acceptance.Acceptance | None:
    """The effects named beside a remainder, and that remainder; None if none improve predictions."""
    candidates = list[tuple[Mapping[int, Evidence], Evidence, tuple[str, ...], gap.LinearTracks]]()
    off_m = list[Floats]()
    bare = acceptance.linear_about(first.evidence, {}, number=FEW)
    for number, candidate in enumerate(_candidate_sets(bare, windows), 1):
        rests: Mapping[int, Evidence] = gap.evidence_without(windows, candidate[0])
        candidates.append((rests, *candidate))
        off_m.append(unseen_distance_m(windows, rests, candidate[1]))
        progress(number / (2.0 * _ROUNDS + 2.0))
    before_m = windows.by_leg_m(windows.before)
    best = min(range(len(candidates)), key=lambda number: float(off_m[number].mean()))
    if single_effect_suffices(before_m, off_m[0], off_m[best], len(first.evidence.names)):
        best = 0
    rests, evidence, names, tracks = candidates[best]
    if not names or not improves_prediction(before_m, off_m[best]):
        return None

    of_set = partial(unseen_distance_m, windows, rests)
    rivals = {name: [(rival,) for rival in acceptance.possible_rivals(evidence, names, name)] for name in names}
    resembling = {name: evidence.equations.model.catalogue[name].confused_with for name in names}
    confused = {name: [group for group in rivals[name] if group[0] in resembling[name]] for name in names}
    close = substitutes_of(of_set, names, confused)
    tied = [(name, rival) for name, rival in [*close, *substitutes_of(tracks.by_leg_m, names, rivals)]]
    pairs = dict[str, list[tuple[str, ...]]]()
    for name in names:
        spanning = acceptance.pairs_spanning(evidence, names, name)
        pairs[name] = [pair for pair in spanning if not any((name, member) in close for member in pair)]
    accepted = acceptance.Acceptance(
        names,
        {name: acceptance.acceptance_tests(evidence, names, name) for name in names},
        evidence,
        rival_deficits=dict.fromkeys(tied, 0.0),
        substitute_pairs=tuple((name, a, b) for name, a, b in substitutes_of(of_set, names, pairs)),
        beside_remainder=True,
    )
    return replace(accepted, lack_of_fit=acceptance.lack_of_fit_that_matters(accepted))


def _candidate_sets(
    evidence: Evidence, windows: gap.UnseenWindows
) -> Iterator[tuple[Evidence, tuple[str, ...], gap.LinearTracks]]:
    """Candidate sets: the best single effect; the best set about the posterior mode of all effects; then,
    repeatedly until it stays the same, the best set about the last one.

    Each comes with the tracks that it was chosen by. Not all sets converge, and later ones are not always
    better. Priors are for all effects at once, of which only a few are present: one present with probability p,
    with a size of standard deviation s, has standard deviation s times the square root of p.
    """
    equations, share = evidence.equations, min(1.0, MAX_EFFECTS / len(evidence.names))
    layout = replace(equations.layout, prior=np.sqrt(share) * equations.layout.prior)
    evidence = replace(evidence, equations=replace(equations, layout=layout))
    yield _best_single_effect(evidence, windows)
    names = compatible_effects(evidence)
    for _ in range(_ROUNDS):
        evidence = relinearise_at_mode(evidence, names)
        tracks = gap.linear_tracks(windows, evidence)
        before, names = names, _best_replicating_set(evidence, tracks, windows, names)
        yield evidence, names, tracks
        evidence = acceptance.relinearise_at_fit(evidence, names)
        yield evidence, names, tracks
        if set(names) == set(before):
            return


def single_effect_suffices(before_m: Floats, alone_m: Floats, best_m: Floats, tried: int) -> bool:
    """Whether one cause suffices, judged by the distances of each leg.

    It predicts held-out legs better than no effect, allowing for the number tried (5 %, Sidak 1967), and not
    significantly worse than the best set (cf. the one-standard-error rule, Breiman et al. 1984).
    """
    chance = -np.expm1(tried * np.log1p(-min(chance_of_closer(before_m, alone_m), 1.0 - _CERTAIN)))
    return bool(chance < acceptance.HELD_OUT_LEVEL and not improves_prediction(alone_m, best_m))


def _best_single_effect(
    evidence: Evidence, windows: gap.UnseenWindows
) -> tuple[Evidence, tuple[str, ...], gap.LinearTracks]:
    """The single effect that predicts held-out legs best, linearised about itself; none if it does not replicate.

    It is the best by the slopes at zero, or the best of some sizes by simulation: where residuals are large, the
    slope at zero says little about an effect that is far from it (Nocedal and Wright 2006, chapter 10.3), such as
    a wind vane that is off by a right angle.
    """
    tracks, far = gap.linear_tracks(windows, evidence), gap.closest_single_effect(windows, evidence)
    near = min(evidence.names, key=lambda name: float(tracks.by_leg_m((name,)).mean()))
    starts: dict[str, acceptance.Coordinates] = {near: {}, **dict.fromkeys(far, far)}
    views = dict[tuple[str, ...], Evidence]()
    for name, at in starts.items():
        view = acceptance.linear_about(evidence, at) if at else evidence
        for _ in range(_ABOUT_ITSELF):
            view = acceptance.relinearise_at_fit(view, (name,))
        views[(name,)] = view

    def off_m(names: tuple[str, ...]) -> float:
        return float(unseen_distance_m(windows, gap.evidence_without(windows, views[names]), names).mean())

    names = min(views, key=off_m)
    agreement = replications(views[names], names, gap.evidence_within(windows, views[names]))
    replicating = tuple(name for name in names if agreement[name].found >= MOST_PARTS * agreement[name].parts)
    return views[names], replicating, gap.linear_tracks(windows, views[names])


def _best_replicating_set(
    evidence: Evidence, tracks: gap.LinearTracks, windows: gap.UnseenWindows, names: tuple[str, ...]
) -> tuple[str, ...]:
    """The replicating, significant effects that predict held-out legs best, starting from ``names``.

    Effects that are not found independently in most parts of the trial, or not significant, are removed one at a
    time, the least missed first, since others may pass without them. Significance is by the scatter from leg to
    leg, which reflects model errors, not noise; it does not overrule effects that predictions have confirmed.
    """
    parts, excluded = gap.evidence_within(windows, evidence), frozenset[str]()
    while True:
        names = tracks.best_set(names, WORTH, MAX_EFFECTS, excluded)
        agreement = replications(evidence, names, parts)
        unconfirmed = [name for name in names if agreement[name].found < MOST_PARTS * agreement[name].parts]
        chance = {
            name: acceptance.acceptance_tests(evidence, names, name).p_value
            for name in names
            if name not in unconfirmed
        }
        unconfirmed += [name for name, p_value in chance.items() if p_value >= _AS_LIKELY_AS_NOT]
        if not unconfirmed:
            return names
        sets = {name: tuple(member for member in names if member != name) for name in unconfirmed}
        least = min(sets, key=lambda name: tracks.by_leg_m(sets[name]).mean())
        excluded, names = excluded | {least}, sets[least]


def unseen_distance_m(windows: gap.UnseenWindows, rests: Mapping[int, Evidence], names: Sequence[str]) -> Floats:
    """The mean distance by leg of simulated predictions with ``names`` [legs with windows].

    Their sizes are those fitted to the other legs, whose evidence is in ``rests``.
    """
    sizes = {fold: acceptance.fitted_coordinates(evidence, names) for fold, evidence in rests.items()}
    return windows.by_leg_m(windows.by_other_folds(sizes))


def substitutes_of(
    off_m: Callable[[tuple[str, ...]], Floats],
    names: tuple[str, ...],
    substitutes: Mapping[str, Collection[tuple[str, ...]]],
) -> list[tuple[str, ...]]:
    """Named effects, each with one of its ``substitutes`` that predict as well in its place.

    A substitute is one other effect or several together; ``off_m`` gives a set's distances.
    """
    named_m, substituted = off_m(names), []
    for name in (candidate for candidate in names if substitutes[candidate]):
        remaining = tuple(candidate for candidate in names if candidate != name)
        lacking_m, swapped_m = off_m(remaining), {group: off_m((*remaining, *group)) for group in substitutes[name]}
        for group, rival_m in swapped_m.items():  # worth naming instead, and not significantly worse
            worthwhile = np.log(lacking_m.mean() / rival_m.mean()) > WORTH
            if worthwhile and not improves_prediction(rival_m, named_m):
                substituted.append((name, *group))
    return substituted


def improves_prediction(without_m: Floats, with_m: Floats) -> bool:
    """Whether the second of two distances by leg is smaller, by enough and consistently over legs."""
    gain_m = float((without_m - with_m).mean())
    return bool(
        gain_m > WORTH * without_m.mean() and chance_of_closer(without_m, with_m) < acceptance.HELD_OUT_LEVEL
    )


def chance_of_closer(without_m: Floats, with_m: Floats) -> float:
    """The chance of such distances by leg if the second are not really smaller.

    The test is of their ratios: what a leg gains or loses by chance grows with its distance, and differences would
    be dominated by the leg with the largest error (Box and Cox 1964, J. R. Statist. Soc. B 26, 211: the
    logarithm stabilises the variance of errors in proportion to the value).
    """
    return acceptance.chance_of_gains(np.log(without_m / with_m))


def replications(evidence: Evidence, names: Sequence[str], parts: Collection[Evidence]) -> dict[str, Replication]:
    """How often ``names``, fitted to each of ``parts`` alone, agree in sign with the fit to all.

    Only informative parts count, and there have to be two: a run ahead says nothing about astern thrust.
    """
    fitted, result = acceptance.fitted_coordinates(evidence, names), dict[str, Replication]()
    fits = [(part, part.fit(names, prior=True)) for part in parts]
    for name in names:
        size = max(float(np.linalg.norm(fitted[name])), 1e-300)
        direction, sizes = np.array(fitted[name]) / size, list[tuple[float, float]]()
        for part, fit in fits:  # along the direction that it has in the whole
            places = part.places(fit, name)
            variance = direction @ fit.covariance[np.ix_(places, places)] @ direction
            sizes.append((float(direction @ fit.values[places]), float(np.sqrt(variance))))
        informative = [
            projected
            for projected, error in sizes
            if size > _DETECTABLE * error or abs(projected) > _ONE_SIDED_95 * error
        ]
        count = len(informative) if len(informative) >= _FEWEST_PARTS else len(sizes)
        result[name] = Replication(count, sum(projected > _ONE_SIDED_95 * error for projected, error in sizes))
    return result


def compatible_effects(evidence: Evidence) -> tuple[str, ...]:
    """The effects that can be present together, the more likely of two that cannot."""
    compatible = tuple[str, ...]()
    for name in sorted(evidence.names, key=lambda name: -evidence.log_odds([name])):
        compatible = (*compatible, name) if evidence.compatible((*compatible, name)) else compatible
    return compatible


def relinearise_at_mode(evidence: Evidence, names: Sequence[str]) -> Evidence:
    """The evidence linearised about the posterior mode of ``names`` together, by damped Gauss-Newton steps."""
    cost, gain = _cost(evidence), np.inf
    for _ in range(_MAX_STEPS):
        equations, target, share = evidence.equations, acceptance.fitted_coordinates(evidence, names), 1.0
        start = equations.model.at
        while share >= _SHORTEST:  # the longest step towards the target that lowers the cost
            between = dict[str, tuple[float, ...]]()
            for name in dict.fromkeys([*target, *start]):  # missing coordinates are zero
                begin, end = (np.array(coordinates.get(name, 0.0)) for coordinates in (start, target))
                between[name] = tuple(np.atleast_1d((1.0 - share) * begin + share * end))
            at = equations.model.bounded(between)
            new_cost = _cost(acceptance.linear_about(evidence, at, equations.effects))
            if new_cost < cost:
                gain, cost, evidence = cost - new_cost, new_cost, acceptance.linear_about(evidence, at)
                break
            share *= 0.5
        if share < _SHORTEST or gain < _ENOUGH:
            break
    return evidence


def _cost(evidence: Evidence) -> float:
    """The negative log posterior density at the linearisation, up to a constant."""
    equations = evidence.equations
    gram, data = equations.gram.sum(axis=0), np.array([0])
    misfit = marginalise(gram, data, equations.nuisance, equations.nuisance_scale)[0][0, 0]
    prior = [(np.array(free) / evidence.prior([name])) ** 2 for name, free in equations.model.at.items()]
    return 0.5 * float(misfit + sum(term.sum() for term in prior))
