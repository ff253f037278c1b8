"""A coarse model: what may be named of it beside forces that stay unexplained.

A model whose forces of speeds and thrusters are off by far more than it is granted, as with a sister ship's
coefficients, lacks many things at once. Some of them are effects of the catalogue, and what is left over says
nothing against these. So a larger set is searched, and an effect of it is named where it holds its sign over
disjoint parts of the trial and brings predicted tracks closer to the measured ones on legs that had no part in
its size. That last test is in metres: where predictions err by far more than the noise, the evidence alone would
take in effects without end. It also decides between two searches, from nothing and from all effects at once.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress
from hybrid.diagnosis.acceptance import (
    UNSEEN,
    Acceptance,
    AcceptanceTests,
    acceptance_tests,
    chance_of_gains,
    lack_of_fit,
    lack_of_fit_that_matters,
)
from hybrid.diagnosis.evidence import Evidence, Fit, evidence_of, normal_equations
from hybrid.diagnosis.gap import UnseenWindows, evidence_within, evidence_without
from hybrid.diagnosis.linearise import linearise
from hybrid.diagnosis.nuisance_basis import FEW, INTERACTIONS, OPERATION
from hybrid.diagnosis.result import Replication
from hybrid.diagnosis.select_effects import (
    LOOKS,
    Coordinates,
    Selection,
    fitted_coordinates,
    linear_about,
    search_effects,
    search_on,
    select_effects,
)

CREDIBLE = 3
"""Effects at once; more are as a rule what imitates one that is missing in the catalogue, unless they replicate."""

COARSE = 3.0
"""So many times the tolerance are the forces of a coarse model off by."""

MOST = 14
"""Effects at once: of a hull's coefficients data tell some ten groups apart (Abkowitz 1980, SNAME Trans. 88)."""

WORTH = 0.01
"""Of the distance on legs left out: what brings less is not worth a name."""

_LOOKS, _ROUNDS = 4, 3  # at the equations made linear anew, in the search and in choosing
_TRIED = 12  # effects beside those that are named, the likeliest
_AS_LIKELY_AS_NOT = 0.5
_FOR_CERTAIN = 3.0  # times what makes a model coarse: sets of six effects end less of a misfit at their third look
_SURE = 1.645  # standard errors: one-sided 95 % in a part of the trial
_TOLD = 2.0 * _SURE  # standard errors: what is so large stands out in 95 of 100 parts
_FEWEST_PARTS = 2  # that have to tell

MOST_PARTS = 0.75
"""Of the parts of a trial: in so many an effect has to be found by itself."""


def is_coarse(accepted: Acceptance) -> bool:
    """Whether many things are missing at once, or the model's own forces are off by far more than granted."""
    surest = max(accepted.lack_of_fit, key=lambda each: each.gain, default=None)
    if surest is None or surest.depends not in (OPERATION, *INTERACTIONS):
        return False  # what goes with place, time or heading may be anything
    far_off = surest.depends == OPERATION and surest.size > COARSE * accepted.evidence.equations.tolerance
    return far_off or len(accepted.names) > CREDIBLE


def selected(evidence: Evidence, progress: Progress = lambda share: None) -> Selection:
    """The fourth stage, broken off after two looks where these leave a misfit that no further look would end."""
    glance = search_on(Selection((), evidence, looks=LOOKS - 2))
    surest = max(lack_of_fit(glance.evidence, glance.names), key=lambda each: each.gain)
    far_off = _FOR_CERTAIN * COARSE * evidence.equations.tolerance
    if surest.found and surest.depends == OPERATION and surest.size > far_off:
        return glance
    return select_effects(evidence, progress)


def untested_if_coarse(selection: Selection) -> Acceptance | None:
    """Nothing accepted, for a model that is off by so much that tests against its noise would say nothing.

    None where it is not so far off.
    """
    found = tuple(each for each in lack_of_fit(selection.evidence, selection.names) if each.found)
    nothing = Acceptance((), {}, selection.evidence, lack_of_fit=found)
    return nothing if is_coarse(nothing) else None


def name_of_coarse_model(
    first: Acceptance, windows: UnseenWindows, progress: Progress = lambda share: None
) -> Acceptance | None:
    """What is named beside a remainder, and that remainder; None where nothing is, or predictions are no better."""
    bare = _linear_about_nothing(first.evidence)
    accepted, choice = _accepted(search_on(Selection((), bare, looks=LOOKS - _LOOKS, most=MOST), progress), windows)
    if not choice.better(accepted.names):
        return None
    other, its_choice = _accepted(_from_all_at_once(bare), windows)
    if its_choice.off_m(other.names).mean() < choice.off_m(accepted.names).mean():
        accepted, choice = other, its_choice
    tied = dict.fromkeys(choice.tied(accepted.names), 0.0)
    return replace(accepted, rival_deficits=tied, lack_of_fit=lack_of_fit_that_matters(accepted))


def _from_all_at_once(evidence: Evidence) -> Selection:
    """The best set where the equations are linear about all effects together, each held by its prior.

    Of a model that is far off what a search finds about nothing, and about that, and so on, does not settle: each
    look brings another set. About all of them the residuals are small from the beginning.
    """
    for _ in range(_LOOKS):
        every = tuple[str, ...]()
        for name in sorted(evidence.names, key=lambda name: -evidence.log_odds([name])):
            every = (*every, name) if evidence.possible((*every, name)) else every
        evidence = linear_about(evidence, fitted_coordinates(evidence, every))
    return Selection(search_effects(evidence, most=MOST), evidence, most=MOST)


def _accepted(start: Selection, windows: UnseenWindows) -> tuple[Acceptance, _Choice]:
    """The effects of a set that bring something on legs left out, with more that do, and without chance."""
    names, evidence = start.names, start.evidence
    for _ in range(_ROUNDS):
        evidence = linear_about(evidence, fitted_coordinates(evidence, names))
        parts = tuple(evidence_within(windows, evidence).values())
        choice = _Choice(windows, evidence, evidence_without(windows, evidence), parts)
        kept = choice.with_more(choice.without_idle(names))
        if kept == names:
            break
        names = kept
    evidence = evidence_of(evidence.equations, by_leg=True)
    names, tests = _without_chance(evidence, names)
    return Acceptance(names, tests, evidence, beside_remainder=True), choice


def _without_chance(
    evidence: Evidence, names: tuple[str, ...]
) -> tuple[tuple[str, ...], dict[str, AcceptanceTests]]:
    """Without what is there by chance as likely as not, by the scatter from leg to leg, the likeliest first.

    That scatter is what the model is off by, not noise: nothing is certain by it that predictions have borne out.
    """
    while True:
        tests = {name: acceptance_tests(evidence, names, name) for name in names}
        worst = max(names, key=lambda name: tests[name].p_value, default=None)
        if worst is None or tests[worst].p_value < _AS_LIKELY_AS_NOT:
            return names, tests
        names = tuple(name for name in names if name != worst)


def _linear_about_nothing(evidence: Evidence) -> Evidence:
    equations = evidence.equations
    bare = linearise(equations.log, replace(equations.model, at={}), equations.tolerance)
    return evidence_of(normal_equations(bare, equations.noise, number=FEW))


def sizes_without(rests: Mapping[int, Evidence], names: Sequence[str]) -> dict[int, Coordinates]:
    """The sizes of ``names`` that all legs but those of each fold give."""
    return {fold: fitted_coordinates(rest, names) for fold, rest in rests.items()}


@dataclass(frozen=True, slots=True)
class _Choice:
    """Sets of effects judged by tracks on legs left out.

    ``rests`` is the evidence of all but each fold's legs, ``parts`` that of each fold's alone.
    """

    windows: UnseenWindows
    evidence: Evidence
    rests: Mapping[int, Evidence]
    parts: tuple[Evidence, ...]

    def off_m(self, names: Sequence[str]) -> Floats:
        """The mean distance by leg of what is predicted with ``names`` [legs with windows]."""
        windows = self.windows
        return windows.by_leg_m(windows.by_other_folds(sizes_without(self.rests, names)))

    def better(self, names: Sequence[str]) -> bool:
        """Whether predictions are better with ``names`` than with none."""
        return bool(names) and worth_it(self.windows.by_leg_m(self.windows.before), self.off_m(names))

    def replicating(self, names: Sequence[str]) -> set[str]:
        """Those that are found by themselves in most parts."""
        found = replications(self.evidence, names, self.parts)
        return {name for name, each in found.items() if each.found >= MOST_PARTS * each.parts}

    def without_idle(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Without effects that bring nothing on legs left out or do not replicate, the least missed first."""
        while names:
            stay, whole_m = self.replicating(names), self.off_m(names)
            lacking_m = {name: self.off_m([each for each in names if each != name]) for name in names}
            idle = [name for name in names if name not in stay or not worth_it(lacking_m[name], whole_m)]
            if not idle:
                break
            least = min(idle, key=lambda name: lacking_m[name].mean())
            names = tuple(each for each in names if each != least)
        return names

    def tied(self, names: tuple[str, ...]) -> list[tuple[str, str]]:
        """Named effects with what is known to look like each and predicts as well in its place."""
        whole_m, catalogue, found = self.off_m(names), self.evidence.equations.model.catalogue, []
        for name in names:
            others = tuple(each for each in names if each != name)
            lacking_m = self.off_m(others)
            for rival in (each for each in catalogue[name].confused_with if each not in names):
                swapped = (*others, rival)
                if rival not in self.evidence.names or not self.evidence.possible(swapped):
                    continue
                off_m = self.off_m(swapped)
                if worth_it(lacking_m, off_m) and not worth_it(off_m, whole_m):
                    found.append((name, rival))
        return found

    def with_more(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """With effects beside that are likely, replicate and bring most, one after the other."""
        before_m = self.off_m(names)
        while len(names) < MOST:
            sets = [(*names, name) for name in self.evidence.names if name not in names]
            likely = sorted(filter(self.evidence.possible, sets), key=lambda some: -self.evidence.log_odds(some))
            off_m = {some: self.off_m(some) for some in likely[:_TRIED]}
            worth = [
                some
                for some in sorted(off_m, key=lambda some: off_m[some].mean())
                if worth_it(before_m, off_m[some])
            ]
            best = next((some for some in worth if some[-1] in self.replicating(some)), None)
            if best is None:
                break
            names, before_m = best, off_m[best]
        return names


def worth_it(without_m: Floats, with_m: Floats) -> bool:
    """Whether the second of two distances by leg is the smaller, by enough and on legs throughout."""
    gains = without_m - with_m
    return bool(gains.mean() > WORTH * without_m.mean() and chance_of_gains(gains) < UNSEEN)


def replications(evidence: Evidence, names: Sequence[str], parts: Collection[Evidence]) -> dict[str, Replication]:
    """How ``names``, fitted to each of ``parts`` alone, agree in sign with the fit to all.

    Only parts count that can tell, of which there have to be two: a run ahead says nothing of a thrust astern.
    """
    whole = fitted_coordinates(evidence, names)
    fits = [(part, part.fit(names, prior=True)) for part in parts]

    def judged(name: str) -> Replication:
        size = max(float(np.linalg.norm(whole[name])), 1e-300)
        seen = [_standing(part, fit, name, np.array(whole[name]) / size) for part, fit in fits]
        told = [own for own, error in seen if size > _TOLD * error or abs(own) > _SURE * error]
        if len(told) < _FEWEST_PARTS:
            told = [own for own, _ in seen]
        return Replication(len(told), sum(own > _SURE * error for own, error in seen))

    return {name: judged(name) for name in names}


def _standing(part: Evidence, fit: Fit, name: str, along: Floats) -> tuple[float, float]:
    """The size of an effect in a part of a trial, in the direction that it has in the whole, and its error."""
    places = part.places(fit, name)
    return float(along @ fit.values[places]), float(np.sqrt(along @ fit.covariance[np.ix_(places, places)] @ along))
