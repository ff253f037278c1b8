"""Stepwise selection of effects by evidence: forward, backward and swap steps over the catalogue.

The evidence for a set of effects weighs how well they explain the data against how much they could have
explained (MacKay 1992, Kass and Raftery 1995); each effect also pays a penalty for the size of the catalogue.
Every selected effect must then pass the tests of :mod:`.acceptance`, given the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from seatrial.acquisition.core.errors import Progress
from seatrial.hybrid.diagnosis.evidence import Evidence, evidence_of, normal_equations, restored_gram
from seatrial.hybrid.diagnosis.linearise import Signature, linearise

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

_CLOSER = 3  # single delays examined more closely where several effects seem present
_SWAPS, _DOUBT = 2, 0.25  # rivals examined more closely, if they lack less than this share of the evidence

Coordinates = Mapping[str, tuple[float, ...]]
"""Free coordinates of effects by name."""


def search_effects(evidence: Evidence, excluded: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """The at most :data:`MAX_EFFECTS` effects with most evidence, by steps from no effect or the best pair."""
    allowed = [name for name in evidence.names if name not in excluded]
    singles = sorted(allowed, key=lambda name: -evidence.log_odds([name]))
    starts: list[tuple[str, ...]] = [()]
    pairs = [pair for pair in combinations(singles[:_PAIRS_OF], 2) if evidence.possible(pair)]
    if pairs:
        starts.append(max(pairs, key=evidence.log_odds))
    ends = []
    for names in starts:  # add, drop or swap one effect at a time, the best step first, until no step gains
        best = evidence.log_odds(names) if evidence.possible(names) else -np.inf
        better: tuple[float, tuple[str, ...]] | None = best, names
        while better is not None:
            best, names = better
            outside = [name for name in allowed if name not in names]
            added = [(*names, name) for name in outside] if len(names) < MAX_EFFECTS else []
            dropped = [tuple(member for member in names if member != name) for name in names]
            steps = [*added, *dropped, *((*remaining, name) for remaining in dropped for name in outside)]
            ranked = sorted(((evidence.log_odds(step), step) for step in steps), reverse=True)
            gains = (step for step in ranked if step[0] > best + 1e-9 and evidence.possible(step[1]))
            better = next(gains, None)
        ends.append(names)
    return max(ends, key=evidence.log_odds)


def possible_rivals(evidence: Evidence, names: tuple[str, ...], name: str) -> list[str]:
    """Effects that could replace ``name``, other than itself over the same or another part of the trial."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    catalogue = evidence.equations.model.catalogue
    candidates = [
        rival for rival in evidence.names if rival not in names and catalogue[rival].base != catalogue[name].base
    ]
    return [rival for rival in candidates if evidence.possible((*remaining, rival))]


def rivals_of(evidence: Evidence, names: tuple[str, ...], name: str) -> dict[str, float]:
    """Effects that would explain almost as much in the place of ``name``, with the log evidence that they lack."""
    remaining = tuple(candidate for candidate in names if candidate != name)
    mine = evidence.log_odds(names)
    return {
        rival: mine - evidence.log_odds((*remaining, rival)) for rival in possible_rivals(evidence, names, name)
    }


def log_density(evidence: Evidence, names: Sequence[str]) -> float:
    """Log density of the data with these effects and priors, up to a constant of all linearisations."""
    equations = evidence.equations
    determinant = restored_gram(equations, equations.gram.sum(axis=0), equations.nuisance_scale)[1]
    return evidence.log_odds(names) - 0.5 * (float(evidence.inner[0, 0]) + determinant)


def fitted_coordinates(evidence: Evidence, names: Sequence[str]) -> Coordinates:
    """The free coordinates for the next linearisation; with some at their bounds, the others are refitted."""
    model, held = evidence.equations.model, dict[str, tuple[float, ...]]()
    while True:
        free, conditional = [name for name in names if name not in held], evidence
        if held:
            back = np.eye(len(evidence.inner))
            for name, coordinates in held.items():
                back[list(evidence.columns([name])), 0] = -np.array(coordinates)
            conditional = replace(evidence, inner=back.T @ evidence.inner @ back)
        fit = conditional.fit(free, prior=True)
        values = {name: tuple(fit.values[evidence.places(fit, name)].tolist()) for name in free}
        within = model.bounded(values)
        beyond = [name for name in free if not np.allclose(within[name], values[name], rtol=_EXACT, atol=0.0)]
        if not beyond:
            return {name: held.get(name) or within[name] for name in names}
        held |= {name: within[name] for name in beyond}


def has_converged(
    evidence: Evidence, names: Sequence[str], at: Coordinates, errors: float, share: float = 0.0
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
    evidence: Evidence
    at: Coordinates = field(default_factory=dict)
    excluded: frozenset[str] = frozenset()
    tried: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    linearisations: int = 0


def select_effects(evidence: Evidence, progress: Progress = lambda share: None) -> Selection:
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
        at, relinearised = _linear_about_itself(evidence, start)
        if relinearised.possible(start):
            densities[start] = log_density(relinearised, start)
        places.append((log_density(relinearised, search_effects(relinearised)), at))
    at = max(places, key=lambda place: place[0])[1]
    return continue_search(Selection((), evidence, at, tried=densities), progress)


def _starting_sets(evidence: Evidence, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """``names``, and sets that may turn out better when they are linearised about themselves.

    Single delays; the same effects with one replaced by a close rival; and with a lag or a play moved to other
    drives, since these are one-sided, and large ones act differently from small ones, so that one drive is easily
    mistaken for another.
    """
    delays, swaps, moves = list[tuple[str, ...]](), list[tuple[float, tuple[str, ...]]](), list[tuple[str, ...]]()
    clocks = {name for name, effect in evidence.equations.model.catalogue.items() if effect.family == "clock"}
    if len(names) >= 2 and clocks & set(names):  # about zero, a long delay resembles others as much as itself
        strongest = sorted(clocks, key=lambda name: -evidence.log_odds([name]))[:_CLOSER]
        delays = [(name,) for name in strongest if evidence.possible([name])]
    for name in names:
        remaining = tuple(member for member in names if member != name)
        gain = evidence.log_odds(names) - evidence.log_odds(remaining)
        for rival, deficit in rivals_of(evidence, names, name).items():
            if CLOSE < deficit < _DOUBT * gain:
                swaps.append((deficit, (*remaining, rival)))
        moves += [(*remaining, substitute) for substitute in _on_other_drives(evidence, name, remaining)]
    closest = [swapped for _, swapped in sorted(swaps)[:_SWAPS]]
    return list(dict.fromkeys([names, *delays, *closest, *filter(evidence.possible, moves)]))


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
    evidence: Evidence, at: Coordinates, known_effects: Sequence[Signature] | None = None, number: int | None = None
) -> Evidence:
    """The evidence of the same data, linearised about effects ``at`` these free coordinates.

    ``known_effects`` are signatures that are already computed; the tolerance has ``number`` features, by default as
    before.
    """
    before = evidence.equations
    linearisation = linearise(before.log, replace(before.model, at=at), before.tolerance, known_effects)
    equations = normal_equations(linearisation, before.noise, number=number or before.layout.features)
    return evidence_of(replace(equations, layout=replace(equations.layout, prior=before.layout.prior)))


def relinearise_at_fit(evidence: Evidence, names: Sequence[str], number: int | None = None) -> Evidence:
    """The evidence linearised about the fit of ``names``."""
    return linear_about(evidence, fitted_coordinates(evidence, names), number=number)


def _linear_about_itself(evidence: Evidence, names: tuple[str, ...]) -> tuple[Coordinates, Evidence]:
    """A set of effects at the values that explain most, as far as two steps reach, and the evidence about them."""
    at = fitted_coordinates(evidence, names)
    relinearised = linear_about(evidence, at)
    if not relinearised.possible(names) or has_converged(relinearised, names, at, _SETTLED, _SETTLED_SHARE):
        return at, relinearised
    at = fitted_coordinates(relinearised, names)
    return at, linear_about(evidence, at)


@dataclass(frozen=True, slots=True)
class Swap:
    """``names``, in which ``rival`` replaces ``name``, and the evidence linearised about them."""

    name: str
    rival: str
    names: tuple[str, ...]
    evidence: Evidence


def linearised_swaps(evidence: Evidence, names: tuple[str, ...]) -> list[Swap]:
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
            alike = len(evidence.columns([rival])) == len(at[name]) and rival not in close
            start = {**at, rival: at[name]} if alike else fitted_coordinates(evidence, swapped)
            relinearised = linear_about(evidence, {member: start[member] for member in swapped})
            relinearised = relinearise_at_fit(relinearised, swapped)
            if relinearised.possible(swapped):
                swaps.append(Swap(name, rival, swapped, relinearised))
    return swaps


def _on_other_drives(evidence: Evidence, name: str, remaining: Sequence[str]) -> list[str]:
    """A lag or a play on other drives than ``name``'s."""
    catalogue = evidence.equations.model.catalogue
    effect = catalogue[name]
    if effect.kind != "actuator" or effect.parameters[0].neutral != effect.parameters[0].low:
        return []
    relatives = [
        relative for relative in effect.confused_with if relative in evidence.names and relative not in remaining
    ]
    return [relative for relative in relatives if catalogue[relative].parameters == effect.parameters]
