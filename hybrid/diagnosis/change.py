"""Changes: an effect that stops, begins, turns or grows during a trial, and when.

If the residuals beside the named effects depend on time, or anything remains in several recordings, each effect
of the catalogue is tried with a size that changes once, at any time, or drifts linearly from beginning to end,
or differs between recordings although it belongs to the ship. The most likely one joins the catalogue, and the
trial is diagnosed again with it: it has to pass the same tests as every effect. A trial without any dependence
on time is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.linalg import cho_factor, solve_triangular

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis import evidence as regressions
from seatrial.hybrid.diagnosis import linearise
from seatrial.hybrid.diagnosis.acceptance import CLOSE, Acceptance, search_effects
from seatrial.hybrid.diagnosis.coarse_model import is_coarse
from seatrial.hybrid.diagnosis.linearise import Shape, TimeProfile, TimeVaryingEffect
from seatrial.hybrid.diagnosis.log import Log

_STEP_S = 10  # between candidate times of a change
_MOST_PARTS = 120  # of a trial; more would only take memory
_LIKELIEST = 4  # effects for which a full search is made
_MUCH = 0.5  # share of all other evidence that a change must add where the model seems coarse without it
_INTERVAL = 1.92  # drop in log likelihood at the ends of a 95 % interval


def may_change(accepted: Acceptance) -> bool:
    """Whether the remainder depends on time or may differ between recordings, or an effect already varies,
    which makes further changes likely.

    The remainder of a coarse model in one recording varies with every speed: there only a dependence on time
    counts.
    """
    equations = accepted.evidence.equations
    if linearise.time_varying_among(accepted.names, equations.model.catalogue) and not is_coarse(accepted):
        return True
    any_may = np.ptp(equations.log.recording) > 0
    return any(any_may or lack.depends == "time" for lack in accepted.lack_of_fit)


def likeliest_change(accepted: Acceptance) -> TimeVaryingEffect | None:
    """The effect most likely to have changed, with its profile; None if no change explains enough.

    Of about equally likely profiles the simplest is taken.
    """
    parts = _parts_of(accepted.evidence.equations)
    equations = parts.evidence.equations
    catalogue, layout = equations.model.catalogue, equations.layout
    steady = [name for name, effect in catalogue.items() if not isinstance(effect, TimeVaryingEffect)]
    tried = [_best_profiles(parts, name, accepted.names) for name in steady]
    likely = sorted(tried, key=lambda changes: -max(changes))[:_LIKELIEST]
    existing = parts.evidence.names  # an effect that already varies in this way is not tried again
    odds = dict[TimeVaryingEffect, float]()
    for change in (change for changes in likely for change in changes.values() if change.name not in existing):
        shares, size = _shares(change.profile, equations.log, parts.part), len(change.free_scale)
        extended = replace(  # the changed effect beside all others
            equations,
            layout=replace(
                layout,
                effect=(*layout.effect, *(change.name,) * size),
                prior=np.append(layout.prior, change.free_scale),
                tolerated=np.append(layout.tolerated, np.zeros(size)),
            ),
            model=replace(equations.model, catalogue={**catalogue, change.name: change}),
        )
        evidence = regressions.Evidence(parts.inner(parts.evidence.columns([change.base]), shares), extended)
        names = search_effects(evidence)
        times = len(parts.profiles) if change.profile.interval_s else 1  # that were tried
        odds[change] = evidence.log_odds(names) - log(times) if change.name in names else -np.inf
    if not odds:
        return None
    best = max(odds, key=odds.__getitem__)
    unchanged = parts.evidence  # the change has to explain more than any set without one
    required = unchanged.log_odds(search_effects(unchanged)) + CLOSE
    if is_coarse(accepted):  # and much more than any set constant over recordings: separate sizes may imitate it
        changing = frozenset(effect.name for effect in linearise.time_varying_among(existing, catalogue))
        required = max(required, (1.0 + _MUCH) * unchanged.log_odds(search_effects(unchanged, changing)))
    if odds[best] < required:
        return None
    alike = [change for change in odds if change.base == best.base and odds[change] > odds[best] - CLOSE]
    return min(alike, key=lambda change: (change.profile.pieces, -odds[change]))


@dataclass(frozen=True, slots=True)
class _Parts:
    """A trial in L short parts.

    ``evidence`` is that of the whole; ``part_inner`` [L, K, K] are the inner products of the data and all effects
    within each part, ``half`` [L, n, K] the corrections for the nuisances and ``half_total`` [n, K] their sum;
    ``part`` [T] is the part of each second; ``profiles`` has every candidate profile with its shares.
    """

    evidence: regressions.Evidence
    part_inner: Floats
    half: Floats
    half_total: Floats
    part: Ints
    profiles: tuple[tuple[TimeProfile, Floats], ...]

    def inner(self, columns: Sequence[int], shares: Floats) -> Floats:
        """Inner products of the data and all effects, followed by those of ``columns`` in each piece of a profile.

        ``shares`` [L, pieces] is the weight of each piece in each part.
        """
        chosen = list(columns)
        chosen_inner, half = np.ascontiguousarray(self.part_inner[:, :, chosen]), self.half[:, :, chosen]
        explained = np.einsum("lp,lnc->npc", shares, half).reshape(len(self.half_total), -1)
        cross = (
            np.einsum("lp,lkc->kpc", shares, chosen_inner).reshape(chosen_inner.shape[1], -1)
            - self.half_total.T @ explained
        )
        inner = np.einsum("lp,lq,lcd->pcqd", shares, shares, chosen_inner[:, chosen]).reshape(
            explained.shape[1], -1
        )
        return np.block([[self.evidence.inner, cross], [cross.T, inner - explained.T @ explained]])


def _parts_of(equations: regressions.NormalEquations) -> _Parts:
    log, blocks = equations.log, int(equations.log.block.max()) + 1
    part = np.asarray(log.block * min(blocks, _MOST_PARTS) // blocks)
    fine = regressions.normal_equations(
        replace(equations, log=replace(log, leg=part)), equations.noise, number=regressions.FEW
    )
    count, nuisance, scale = 1 + len(fine.layout.effect), fine.nuisance, fine.nuisance_scale
    back = np.eye(fine.gram.shape[1])[:, :count]
    back[:, 0] = regressions.restored_data(fine)
    granted = fine.gram.sum(axis=0)[np.ix_(nuisance, nuisance)] * np.outer(scale, scale)
    granted[np.diag_indices_from(granted)] += 1.0
    lower = cho_factor(granted, lower=True, check_finite=False)[0]
    right = fine.gram @ back
    part_inner = back.T @ right
    cross = np.moveaxis(right[:, nuisance] * scale[:, None], 0, 1).reshape(len(nuisance), -1)
    half = solve_triangular(lower, cross, lower=True, check_finite=False).reshape(len(nuisance), -1, count)
    half_total = half.sum(axis=1)
    evidence = regressions.Evidence(part_inner.sum(axis=0) - half_total.T @ half_total, replace(fine, log=log))

    recordings = tuple(np.unique(log.recording).tolist())
    profiles = [TimeProfile("recordings", recordings)] if len(recordings) > 1 else []
    profiles.append(TimeProfile("drift", (float(log.time_s.min()), float(log.time_s.max()))))
    inside = (log.block > log.block[0]) & (log.block < log.block[-1])
    times_s = log.time_s[inside][::_STEP_S].tolist()
    profiles += [TimeProfile("step", (float(time_s),)) for time_s in times_s]
    half = np.ascontiguousarray(np.moveaxis(half, 0, 1))
    shares = tuple((profile, _shares(profile, log, part)) for profile in profiles)
    return _Parts(evidence, part_inner, half, half_total, part, shares)


def _shares(profile: TimeProfile, log: Log, part: Ints) -> Floats:
    """The weight of each piece of a profile in each part of a trial [L, pieces]."""
    count = np.bincount(part)
    return np.column_stack([np.bincount(part, weights=share) / count for share in profile.shares(log).T])


def _best_profiles(parts: _Parts, name: str, names: Sequence[str]) -> dict[float, TimeVaryingEffect]:
    """An effect with its most likely profile of each shape, by log evidence beside the other named effects."""
    evidence, catalogue = parts.evidence, parts.evidence.equations.model.catalogue
    effect, effect_columns = catalogue[name], evidence.columns([name])
    fixed_names = [candidate for candidate in names if catalogue[candidate].base != name]
    fixed, prior, first = evidence.columns(fixed_names), evidence.prior(fixed_names), len(evidence.inner)
    by_shape: dict[Shape, list[tuple[float, TimeProfile]]] = {}
    for profile, shares in parts.profiles:
        inner, width = parts.inner(effect_columns, shares), len(effect.free_scale)
        pieces_of: dict[Shape, slice] = {profile.shape: slice(None)}
        if profile.shape == "step":  # or with one of its two sizes zero: something that stops or begins
            pieces_of |= {"until": slice(1), "since": slice(1, None)}
        for shape, pieces in pieces_of.items():
            columns = np.arange(first, len(inner)).reshape(-1, width)[pieces].ravel()
            sizes = np.append(prior, effect.free_scale * (len(columns) // width))
            odds = regressions.log_evidence(inner, (*fixed, *columns), sizes)
            by_shape.setdefault(shape, []).append((odds, replace(profile, shape=shape)))
    changes = dict[float, TimeVaryingEffect]()
    for candidates in by_shape.values():
        best, profile = max(candidates, key=lambda candidate: candidate[0])
        if profile.shape in ("until", "since", "step"):
            times = [rival.times_s[0] for odds, rival in candidates if odds > best - _INTERVAL]
            profile = replace(profile, interval_s=(min(times) - _STEP_S, max(times) + _STEP_S))
        changes[best] = linearise.time_varying(effect, profile)
    return changes
