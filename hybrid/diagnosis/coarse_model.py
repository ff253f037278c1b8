"""Coarse models: when a model is one, and how effects are named beside forces that remain unexplained.

A model whose forces of speeds and thrusters err by far more than the tolerance, as with a sister ship's
coefficients, lacks many things at once. Evidence alone would admit effects without end there, for its noise is
that of the sensors. One rule decides: a model is coarse if, beside what the search by evidence accepts, its own
forces err by more than three tolerances, or more effects are accepted than an ordinary model lacks. Then few
causes are named by what predicts held-out legs (:mod:`.few_causes`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import nan

import numpy as np

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis import acceptance, few_causes, gap
from seatrial.hybrid.diagnosis.regression import FEW, INTERACTIONS, OPERATION, Evidence
from seatrial.hybrid.diagnosis.result import Replication

COARSE = 3.0
"""The error of a coarse model's forces, in tolerances."""

WORTH = 0.01
"""The share of the mean distance on held-out legs by which predictions have to be better."""

# factor on the error of a coarse model: the third linearisation of six effects removes less misfit
_FOR_CERTAIN = 3.0
_ONE_SIDED_95 = 1.645  # standard errors: one-sided 95 % in a part of the trial
_DETECTABLE = 2.0 * _ONE_SIDED_95  # standard errors: significant in 95 of 100 parts
_FEWEST_PARTS = 2  # informative parts required

MOST_PARTS = 0.75
"""The share of the parts of a trial in which an effect has to be found independently."""


def is_coarse(accepted: acceptance.Acceptance) -> bool:
    """Whether many things are missing at once, or the model's own forces err by far more than the tolerance."""
    surest = _surest_lack_of_fit(accepted)
    if surest is None or surest.depends not in (OPERATION, *INTERACTIONS):
        return False  # a dependence on position, time or heading may have any cause
    return is_far_off(accepted) or len(accepted.names) > acceptance.CREDIBLE


def is_far_off(accepted: acceptance.Acceptance) -> bool:
    """Whether the model's own forces err by far more than the tolerance."""
    surest = _surest_lack_of_fit(accepted)
    far_off = COARSE * accepted.evidence.equations.tolerance
    return surest is not None and surest.depends == OPERATION and surest.size > far_off


def _surest_lack_of_fit(accepted: acceptance.Acceptance) -> acceptance.LackOfFit | None:
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
    if surest.is_significant and surest.depends == OPERATION and surest.size > far_off:
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
        lack for lack in acceptance.lack_of_fit(selection.evidence, selection.names) if lack.is_significant
    )
    untested = acceptance.Acceptance((), {}, selection.evidence, lack_of_fit=significant)
    return untested if is_coarse(untested) else None


def acceptance_of(first: acceptance.Acceptance, causes: few_causes.FewCauses) -> acceptance.Acceptance:
    """The few causes that are named, what could replace them, and what remains beside them."""
    fit, p_values = causes.fit, causes.p_values
    accepted = acceptance.Acceptance(
        fit.names,
        {name: acceptance.AcceptanceTests(name, nan, p, 1.0, p, large_enough=True) for name, p in p_values.items()},
        acceptance.linear_about(first.evidence, fit.at, number=FEW),
        rival_deficits={(name, rival): 0.0 for name, rivals in causes.rivals.items() for rival in rivals},
        causes=fit,
    )
    return replace(accepted, lack_of_fit=acceptance.lack_of_fit_that_matters(accepted))


def unseen_distance_m(windows: gap.UnseenWindows, rests: Mapping[int, Evidence], names: Sequence[str]) -> Floats:
    """The mean distance by leg of simulated predictions with ``names`` [legs with windows].

    Their sizes are those fitted to the other legs, whose evidence is in ``rests``.
    """
    sizes = {fold: acceptance.fitted_coordinates(evidence, names) for fold, evidence in rests.items()}
    return windows.by_leg_m(windows.tracks_by_other_folds(sizes))


def improves_prediction(without_m: Floats, with_m: Floats) -> bool:
    """Whether the second of two distances by leg is smaller, by enough and consistently over legs."""
    gain_m = float((without_m - with_m).mean())
    chance = few_causes.chance_of_closer(without_m, with_m)
    return bool(gain_m > WORTH * without_m.mean() and chance < acceptance.HELD_OUT_LEVEL)


def replications(evidence: Evidence, names: Sequence[str], parts: Collection[Evidence]) -> dict[str, Replication]:
    """How often ``names``, fitted to each of ``parts`` alone, agree in sign with the fit to all.

    Only informative parts count, and there have to be two: a run ahead says nothing about astern thrust.
    """
    fitted, result = acceptance.fitted_coordinates(evidence, names), dict[str, Replication]()
    fits = [(part, part.fit(names, with_prior=True)) for part in parts]
    for name in names:
        size = max(float(np.linalg.norm(fitted[name])), 1e-300)
        direction, sizes = np.array(fitted[name]) / size, list[tuple[float, float]]()
        for part, fit in fits:  # along the direction that it has in the whole
            places = part.rows_in_fit(fit, name)
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
