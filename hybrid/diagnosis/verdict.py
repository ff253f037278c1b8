"""The diagnosis in six stages, linearise, noise, evidence, selection, acceptance, verdict, and the last of these.

The verdict has the effects that stay named, their sizes and rivals, the gap on held-out legs and the next
trial, and the contradictions between sensors, which need no ship model: speeds over ground rotated by the
heading must integrate to the track, and yaw rates to the heading, whatever moves the ship. For these the filter
is run with process noise so large that the dynamics carry no information, and only sensor effects are searched;
errors that all sensors share, such as a common delay, cannot show.

The noise is estimated for linear interpolation of the thruster settings between records, then again if the
drives moved in steps. A drive moves gradually from record to record, and a line is close to the truth; a
recorder or simulator that holds each setting until the next record makes steps, which lead or lag the line by
half a record: at one record a second, enough to be mistaken for a missing effect.

A change is an effect that stops, begins, turns or grows during a trial. If the residuals beside the named effects
depend on time, or anything remains in several recordings, each effect of the catalogue is tried with a size that
changes once, at any time, or drifts linearly from beginning to end, or differs between recordings although it
belongs to the ship. The most likely one joins the catalogue, and the trial is diagnosed again with it: it has to
pass the same tests as every effect. A trial without any dependence on time is left alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import atan2, degrees, exp, hypot, log

import numpy as np
import pandas as pd
from scipy.linalg import cho_factor, solve_triangular
from threadpoolctl import threadpool_limits

from seatrial.acquisition.core.errors import ConfigurationError, Progress, subtask_progress
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis import acceptance, coarse_model, few_causes, linearise, planning, regression
from seatrial.hybrid.diagnosis import gap as gaps
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise, NoiseEstimate, columns_of
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import Shape, TimeProfile, TimeVaryingEffect
from seatrial.hybrid.diagnosis.log import INPUT_HOLDS, SELDOM_S, InputHold, Log, log_of
from seatrial.hybrid.diagnosis.map import FoundRegime, largest_regimes, map_of
from seatrial.hybrid.diagnosis.result import (
    Estimate,
    Map,
    NextTrial,
    RankedEffect,
    Replication,
    Rival,
    Suspect,
    Verdict,
)
from seatrial.hybrid.effects import Catalogue, Effect, catalogue_of
from seatrial.hybrid.vessel.black_box import BlackBox
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.sensors import HEADING

_STEP_S = 10  # between candidate times of a change
_MOST_PARTS = 120  # of a trial; more would only take memory
_LIKELIEST = 4  # effects for which a full search is made
_MUCH = 0.5  # share of all other evidence that a change must add where the model seems coarse without it
_WORTH_A_TRY = 0.05  # a jump makes legs differ, and so its own p-value larger
_INTERVAL = 1.92  # drop in log likelihood at the ends of a 95 % interval


def may_change(accepted: acceptance.Acceptance) -> bool:
    """Whether the remainder may depend on time or differ between recordings, or an effect already varies, which
    makes further changes likely. Each change that this lets be tried has to pass all tests.

    The remainder of a coarse model in one recording varies with every speed: there only a dependence on time
    counts.
    """
    equations = accepted.evidence.equations
    if linearise.time_varying_among(accepted.names, equations.model.catalogue) and not coarse_model.is_coarse(
        accepted
    ):
        return True
    any_may = np.ptp(equations.log.recording) > 0
    if any(any_may or lack.depends == "time" for lack in accepted.lack_of_fit):
        return True
    weaker = acceptance.lack_of_fit(accepted.evidence, accepted.names)
    return not coarse_model.is_coarse(accepted) and any(
        lack.depends == "time" and lack.matters and lack.p_value < _WORTH_A_TRY for lack in weaker
    )


def likeliest_change(accepted: acceptance.Acceptance) -> TimeVaryingEffect | None:
    """The effect most likely to have changed, with its profile; None if no change explains enough.

    Of about equally likely profiles the simplest is taken.
    """
    parts = _parts_of(accepted.evidence.equations)
    equations = parts.evidence.equations
    catalogue, layout = equations.model.catalogue, equations.layout
    steady = [name for name, effect in catalogue.items() if not isinstance(effect, TimeVaryingEffect)]
    tried = [_best_profiles(parts, name, accepted.names) for name in steady]
    likely = sorted(tried, key=lambda changes: -max(changes))[:_LIKELIEST]
    existing = parts.evidence.effect_names  # an effect that already varies in this way is not tried again
    odds = dict[TimeVaryingEffect, float]()
    for change in (change for changes in likely for change in changes.values() if change.name not in existing):
        shares, size = _profile_weights(change.profile, equations.log, parts.part), len(change.free_scale)
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
        evidence = regression.Evidence(
            parts.inner_with_pieces(parts.evidence.columns_of([change.base]), shares), extended
        )
        names = acceptance.search_effects(evidence)
        times = len(parts.profiles) if change.profile.interval_s else 1  # that were tried
        odds[change] = evidence.log_odds(names) - log(times) if change.name in names else -np.inf
    if not odds:
        return None
    best = max(odds, key=odds.__getitem__)
    unchanged = parts.evidence  # the change has to explain more than any set without one
    required = unchanged.log_odds(acceptance.search_effects(unchanged)) + acceptance.CLOSE
    if coarse_model.is_coarse(
        accepted
    ):  # and much more than any set constant over recordings: separate sizes may imitate it
        changing = frozenset(effect.name for effect in linearise.time_varying_among(existing, catalogue))
        required = max(required, (1.0 + _MUCH) * unchanged.log_odds(acceptance.search_effects(unchanged, changing)))
    if odds[best] < required:
        return None
    alike = [change for change in odds if change.base == best.base and odds[change] > odds[best] - acceptance.CLOSE]
    return _to_the_second(accepted, min(alike, key=lambda change: (change.profile.piece_count, -odds[change])))


def _to_the_second(accepted: acceptance.Acceptance, change: TimeVaryingEffect) -> TimeVaryingEffect:
    """A change at the most likely of all seconds about the time that a search in steps found.

    A sensor that jumps is seen within a second: at a time some seconds off, the leg around it would deny it.
    """
    if change.profile.interval_s is None:
        return change
    equations = accepted.evidence.equations
    log, (time_s,) = equations.log, change.profile.times_s
    row = int(np.searchsorted(log.time_s, time_s))
    times_s = log.time_s[max(row - _STEP_S, 1) : row + _STEP_S + 1]
    around = log.subset(np.isin(log.leg, log.leg[[max(row - _STEP_S, 0), min(row + _STEP_S, len(log) - 1)]]))
    at = {
        name: free
        for name, free in accepted.coordinates.items()
        if equations.model.catalogue[name].base != change.base
    }
    bases = linearise.base_names((*at, *equations.model.file_effects), equations.model.catalogue)
    catalogue = {name: equations.model.catalogue[name] for name in dict.fromkeys((*at, *bases, change.base))}
    densities = dict[float, float]()
    for candidate_s in times_s.astype(float).tolist():
        moved = replace(change, profile=replace(change.profile, times_s=(candidate_s,)))
        model = replace(equations.model, at=at, catalogue={**catalogue, change.name: moved})
        part = linearise.linearise(around, model, equations.tolerance)
        evidence = regression.evidence_of(regression.normal_equations(part, equations.noise, number=regression.FEW))
        densities[candidate_s] = evidence.log_odds([change.name])
    return replace(change, profile=replace(change.profile, times_s=(max(densities, key=densities.__getitem__),)))


@dataclass(frozen=True, slots=True)
class _InnerByPart:
    """A trial in L short parts.

    ``evidence`` is that of the whole; ``part_inner`` [L, K, K] are the inner products of the data and all effects
    within each part, ``half`` [L, n, K] the corrections for the nuisances and ``half_total`` [n, K] their sum;
    ``part`` [T] is the part of each second; ``profiles`` has every candidate profile with its shares.
    """

    evidence: regression.Evidence
    part_inner: Floats
    half: Floats
    half_total: Floats
    part: Ints
    profiles: tuple[tuple[TimeProfile, Floats], ...]

    def inner_with_pieces(self, columns: Sequence[int], shares: Floats) -> Floats:
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


def _parts_of(equations: regression.NormalEquations) -> _InnerByPart:
    log, blocks = equations.log, int(equations.log.block.max()) + 1
    part = np.asarray(log.block * min(blocks, _MOST_PARTS) // blocks)
    fine = regression.normal_equations(
        replace(equations, log=replace(log, leg=part)), equations.noise, number=regression.FEW
    )
    count, nuisance, scale = 1 + len(fine.layout.effect), fine.nuisance, fine.nuisance_scale
    back = np.eye(fine.gram.shape[1])[:, :count]
    back[:, 0] = regression.restored_data(fine)
    granted = fine.gram.sum(axis=0)[np.ix_(nuisance, nuisance)] * np.outer(scale, scale)
    granted[np.diag_indices_from(granted)] += 1.0
    lower = cho_factor(granted, lower=True, check_finite=False)[0]
    right = fine.gram @ back
    part_inner = back.T @ right
    cross = np.moveaxis(right[:, nuisance] * scale[:, None], 0, 1).reshape(len(nuisance), -1)
    half = solve_triangular(lower, cross, lower=True, check_finite=False).reshape(len(nuisance), -1, count)
    half_total = half.sum(axis=1)
    evidence = regression.Evidence(part_inner.sum(axis=0) - half_total.T @ half_total, replace(fine, log=log))

    recordings = tuple(np.unique(log.recording).tolist())
    profiles = [TimeProfile("recordings", recordings)] if len(recordings) > 1 else []
    profiles.append(TimeProfile("drift", (float(log.time_s.min()), float(log.time_s.max()))))
    inside = (log.block > log.block[0]) & (log.block < log.block[-1])
    times_s = log.time_s[inside][::_STEP_S].tolist()
    profiles += [TimeProfile("step", (float(time_s),)) for time_s in times_s]
    half = np.ascontiguousarray(np.moveaxis(half, 0, 1))
    shares = tuple((profile, _profile_weights(profile, log, part)) for profile in profiles)
    return _InnerByPart(evidence, part_inner, half, half_total, part, shares)


def _profile_weights(profile: TimeProfile, log: Log, part: Ints) -> Floats:
    """The weight of each piece of a profile in each part of a trial [L, pieces]."""
    count = np.bincount(part)
    return np.column_stack([np.bincount(part, weights=share) / count for share in profile.weights_of_pieces(log).T])


def _best_profiles(parts: _InnerByPart, name: str, names: Sequence[str]) -> dict[float, TimeVaryingEffect]:
    """An effect with its most likely profile of each shape, by log evidence beside the other named effects."""
    evidence, catalogue = parts.evidence, parts.evidence.equations.model.catalogue
    effect, effect_columns = catalogue[name], evidence.columns_of([name])
    fixed_names = [candidate for candidate in names if catalogue[candidate].base != name]
    fixed, prior, first = (
        evidence.columns_of(fixed_names),
        evidence.prior_deviations(fixed_names),
        len(evidence.inner),
    )
    by_shape: dict[Shape, list[tuple[float, TimeProfile]]] = {}
    for profile, shares in parts.profiles:
        inner, width = parts.inner_with_pieces(effect_columns, shares), len(effect.free_scale)
        pieces_of: dict[Shape, slice] = {profile.shape: slice(None)}
        if profile.shape == "step":  # or with one of its two sizes zero: something that stops or begins
            pieces_of |= {"until": slice(1), "since": slice(1, None)}
        for shape, pieces in pieces_of.items():
            columns = np.arange(first, len(inner)).reshape(-1, width)[pieces].ravel()
            sizes = np.append(prior, effect.free_scale * (len(columns) // width))
            odds = regression.log_evidence(inner, (*fixed, *columns), sizes)
            by_shape.setdefault(shape, []).append((odds, replace(profile, shape=shape)))
    changes = dict[float, TimeVaryingEffect]()
    for candidates in by_shape.values():
        best, profile = max(candidates, key=lambda candidate: candidate[0])
        if profile.shape in ("until", "since", "step"):
            times = [rival.times_s[0] for odds, rival in candidates if odds > best - _INTERVAL]
            profile = replace(profile, interval_s=(min(times) - _STEP_S, max(times) + _STEP_S))
        changes[best] = linearise.time_varying(effect, profile)
    return changes


_RIVALS = 10  # closest rivals of an effect that a manoeuvre is chosen to separate

WEAK = 9.0
"""A name whose rivals all lack more than ``CLOSE`` is certain; below this limit another trial is worthwhile."""

_WIDTH = 1.96
_UNKNOWN = np.array([3.0, 3.0, 0.3])  # m/s, m/s, rad/s: uninformative change of speed in a second
_SHARED = (10.0, 10.0, 10.0, 10.0)  # s, m, m, deg: undetectable error shared by all sensors
_LATE_S = 0.25  # of delay on either side, for its derivative
_DELAYS = {"position_delay": (0, 1), "heading_delay": (2,), "speed_delay": (3, 4, 5)}
_MAX_LINEARISATIONS = 6
_SETTLED = 0.5  # of a standard error

CHANGES = 3
"""The largest number of effects that may vary over a trial."""

TOLERANCE = 0.01
"""The default model error allowed, as a share of the force range."""

_ENOUGH_S = 600.0  # seconds of the log: every turn shows the input hold
_PLAIN = 20.0  # margin in log likelihood by which steps must beat linear interpolation


@dataclass(frozen=True, slots=True)
class Conclusion:
    """The result of the sixth stage: the diagnosis as numbers; :mod:`seatrial.hybrid.report` puts it into words.

    ``first`` is what was accepted, ``accepted`` what stays named beside a remainder; ``sensors`` are the sensor
    faults that explain contradictions between the sensors, None if they agree. ``gap`` is measured on held-out
    legs [m]; ``rivals`` could replace a named effect, with the log odds that they lack; ``composites`` are groups
    that may be one effect outside the catalogue, ``tied`` all groups that these data cannot distinguish;
    ``replicated`` says in how many parts of the trial each named effect is found independently; ``regimes`` are
    where the model as it is lacks most; ``withdrawn`` are effects that explain the record but make predictions
    worse. ``suspects`` were found, but are not named; ``ranking`` ranks every effect by itself; ``maps`` show the
    model before and after.
    """

    verdict: Verdict
    first: acceptance.Acceptance
    accepted: acceptance.Acceptance
    sensors: acceptance.Acceptance | None
    gap: gaps.HeldOutGap
    rivals: tuple[Rival, ...]
    composites: tuple[tuple[str, ...], ...]
    tied: tuple[tuple[str, ...], ...]
    replicated: Mapping[str, Replication]
    regimes: tuple[FoundRegime, ...]
    withdrawn: tuple[str, ...]
    next_manoeuvre: NextTrial | None
    suspects: tuple[Suspect, ...]
    ranking: tuple[RankedEffect, ...]
    maps: tuple[Map, Map]

    @property
    def left_open(self) -> float:
        """The share of the gap that stays open [1]."""
        return min(1.0, max(0.0, 1.0 - self.gap.gap.closed))


def reach_verdict(
    first: acceptance.Acceptance, smoothed: Log, progress: Progress = lambda share: None
) -> Conclusion:
    """The sixth stage: the effects that stay named, how far they close the gap, and what could replace them.

    Windows of a coarse model start from the states of the ``smoothed`` log, for which no model was used: a wrong
    one would bend them (R/V Gunnerus 2019: 0.28 instead of 0.25 m after 15 s with the same two causes).
    """
    equations, lacks = first.evidence.equations, first.lack_of_fit
    sensors = find_contradictions(equations.log, equations.model, equations.noise)
    coarse = coarse_model.is_coarse(first)
    windows = gaps.unseen_windows(smoothed if coarse else equations.log, equations.model)
    accepted, regimes, causes = first, tuple[FoundRegime, ...](), None
    if lacks:  # it may resemble any force, so forces are doubtful; sensor faults show without a ship model
        if coarse:
            compatible = first.evidence.are_compatible
            causes = few_causes.find_few_causes(windows, compatible, subtask_progress(progress, 0, 2))
        named = coarse_model.acceptance_of(first, causes) if causes and causes.fit.names else None
        accepted = named or drop_non_predictive(sensors, windows) or replace(first, names=(), tests={})
        if not isinstance(equations.model.base, BlackBox):  # of which no force by regime is simulated
            regimes = largest_regimes(first.evidence, windows)
    progress(0.5)
    held_out = replace(windows, fold=accepted.causes.fold) if accepted.causes else windows
    gap, withdrawn = _held_out_gap(accepted, held_out, lacks), tuple[str, ...]()
    if accepted.names and makes_worse(held_out, gap.without):
        accepted, withdrawn = replace(accepted, names=(), tests={}, causes=None), accepted.names
        gap = _held_out_gap(accepted, windows, lacks)
    gap = gaps.with_noise_floor(gap, equations)
    rivals = close_rivals(accepted)
    if causes and accepted.causes:
        replicated = {name: Replication(len(causes.halves), len(causes.found_in[name])) for name in accepted.names}
    else:
        parts = gaps.evidence_within(windows, accepted.evidence) if accepted.names else []
        replicated = coarse_model.replications(accepted.evidence, accepted.names, parts)
    partly = any(replication.found < replication.parts for replication in replicated.values())
    # something is missing that the named effects may only imitate
    imitated = not accepted.beside_remainder if lacks else len(accepted.names) > acceptance.CREDIBLE and partly
    unknown = bool(withdrawn) or imitated or (not coarse and gap.beyond_noise)
    composites = [] if unknown else _composite_groups(accepted, first)
    # these data cannot distinguish each named effect from its close rivals
    close = [rival for rival in rivals if rival.evidence < acceptance.CLOSE]
    alternatives = {name: [rival.name for rival in close if rival.instead_of == name] for name in accepted.names}
    groups = [(name, *names) for name, names in alternatives.items() if names]
    groups += composites
    final = equations  # with all named effects in the model
    if accepted is not first:
        final = acceptance.linear_about(first.evidence, accepted.coordinates).equations
    progress(0.6)
    return Conclusion(
        verdict=verdict_of(accepted.names, groups, unknown),
        first=first,
        accepted=accepted,
        sensors=sensors,
        gap=gap,
        rivals=tuple(rivals),
        composites=tuple(composites),
        tied=() if unknown else tuple(groups),
        replicated=replicated,
        regimes=regimes,
        withdrawn=withdrawn,
        next_manoeuvre=None if lacks else _next_manoeuvre(accepted, rivals, subtask_progress(progress, 1, 2)),
        suspects=suspects_of(accepted, (*withdrawn, *accepted.doubtful), causes),
        ranking=rank_effects(first.evidence),
        maps=(map_of(equations), map_of(final, with_effects=True)),
    )


def drop_non_predictive(
    sensors: acceptance.Acceptance | None, windows: gaps.UnseenWindows
) -> acceptance.Acceptance | None:
    """The sensor faults each of which improves predictions of held-out legs; None if there are none.

    A contradiction between sensors does not tell which of them is wrong, nor that the error persists.
    """
    if sensors is None:
        return None
    names, off_m = (
        sensors.names,
        partial(coarse_model.unseen_distance_m, windows, gaps.evidence_without(windows, sensors.evidence)),
    )
    while names:
        whole_m = off_m(names)
        lacking = {name: off_m([candidate for candidate in names if candidate != name]) for name in names}
        unconfirmed = [name for name in names if not coarse_model.improves_prediction(lacking[name], whole_m)]
        if not unconfirmed:
            return replace(sensors, names=names, tests={name: sensors.tests[name] for name in names})
        least = min(unconfirmed, key=lambda name: float(lacking[name].mean()))
        names = tuple(name for name in names if name != least)
    return None


def makes_worse(windows: gaps.UnseenWindows, without: Mapping[int, acceptance.Coordinates]) -> bool:
    """Whether the effects named ``without`` them predict held-out legs worse, by enough and consistently."""
    return coarse_model.improves_prediction(
        windows.by_leg_m(windows.tracks_by_other_folds(without)), windows.by_leg_m(windows.before)
    )


def _composite_groups(accepted: acceptance.Acceptance, first: acceptance.Acceptance) -> list[tuple[str, ...]]:
    """Groups that may be one effect outside the catalogue.

    Beside a remainder, only more than three effects of one family count as such a group; and none do where the
    model is far off, for then many coefficients are wrong.
    """
    if not first.lack_of_fit:
        return acceptance.composite_effects(accepted.evidence, accepted.names)
    return (
        []
        if coarse_model.is_far_off(first)
        else acceptance.families_with_many_effects(accepted.evidence, accepted.names)
    )


def estimates_of_effect(accepted: acceptance.Acceptance, name: str) -> list[dict[str, Estimate]]:
    """The parameters of a named effect with their 95 % intervals, for each part of the trial with its own size."""
    model, (values, covariance) = accepted.evidence.equations.model, accepted.coordinates_with_covariance(name)
    effect, sizes = model.catalogue[name], []
    for piece in effect.coordinates_by_piece(range(len(values))):
        places = [int(place) for place in piece]
        file_free = model.file_effects.get(effect.base, (0.0,) * len(places))
        bounded = Effect.nearest_within_bounds(effect, values[places] + np.array(file_free))
        sizes.append(estimates_from_coordinates(effect, np.array(bounded), covariance[np.ix_(places, places)]))
    return sizes


def estimates_from_coordinates(effect: Effect, free: Floats, covariance: Floats) -> dict[str, Estimate]:
    """Parameters and 95 % intervals from free coordinates and their covariance."""
    if effect.chart == "polar":  # magnitude and direction, with errors along and across the vector
        along, across = free
        size = max(hypot(along, across), 1e-12)
        ahead = np.array([along, across]) / size
        normal = np.array([-ahead[1], ahead[0]])
        length = float(np.sqrt(ahead @ covariance @ ahead)) * _WIDTH
        turn = min(degrees(float(np.sqrt(normal @ covariance @ normal)) / size) * _WIDTH, 180.0)
        towards = degrees(atan2(across, along)) % 360.0
        first, second = effect.parameters
        return {
            first.name: Estimate(size, max(size - length, 0.0), size + length, first.unit),
            second.name: Estimate(towards, towards - turn, towards + turn, second.unit),
        }
    deviation, result = np.sqrt(np.diag(covariance)), {}
    values, *ends = (effect.values_at(list(free + side * _WIDTH * deviation)) for side in (0.0, -1.0, 1.0))
    for parameter in effect.parameters:
        low, high = sorted(min(max(end[parameter.name], parameter.low), parameter.high) for end in ends)
        result[parameter.name] = Estimate(values[parameter.name], low, high, parameter.unit)
    return result


def close_rivals(accepted: acceptance.Acceptance) -> list[Rival]:
    """Effects that explain almost as much in the place of a named one, the closest first."""
    rivals = []
    for name in accepted.names:
        # beside a remainder only rivals that predict as well: the search left out effects that explain something
        deficits = (
            {} if accepted.beside_remainder else acceptance.rivals_of(accepted.evidence, accepted.names, name)
        )
        for (named, rival), deficit in accepted.rival_deficits.items():
            if named == name:  # a rival out of bounds at one linearisation may be possible at its own
                deficits[rival] = min(deficit, deficits.get(rival, deficit))
        rivals += [Rival(name, rival, float(deficit)) for rival, deficit in deficits.items()]
    return sorted(
        (rival for rival in rivals if rival.evidence < acceptance.SEEN * acceptance.CLOSE),
        key=lambda rival: rival.evidence,
    )


def verdict_of(names: Sequence[str], tied: Sequence[tuple[str, ...]], unknown: bool) -> Verdict:
    """The verdict in one word."""
    if unknown:
        return "unknown"
    if not names:
        return "nothing_missing"
    return "indistinguishable" if tied else "named"


def _held_out_gap(
    accepted: acceptance.Acceptance, windows: gaps.UnseenWindows, lacks: Sequence[acceptance.LackOfFit]
) -> gaps.HeldOutGap:
    """The gap on held-out legs.

    The other legs choose among the effects named in the end, or all effects where nothing is missing or
    everything is explained. Beside a remainder they only fit the sizes: the choice is that of the whole trial.
    """
    evidence, names = accepted.evidence, accepted.names
    if accepted.causes:
        return gaps.gap_on_unseen_legs(windows, names, accepted.coordinates, accepted.causes.without)
    excluded = frozenset(evidence.effect_names) - set(names)
    without = gaps.named_without(windows, evidence, excluded if lacks or not names else frozenset())
    return gaps.gap_on_unseen_legs(windows, names, accepted.coordinates, without)


def _next_manoeuvre(
    accepted: acceptance.Acceptance, rivals: Sequence[Rival], progress: Progress
) -> NextTrial | None:
    """The manoeuvre that separates the named effects from rivals that are close or not far off."""
    evidence, pairs = accepted.evidence, list[planning.Pair]()
    model = evidence.equations.model
    steady = set(linearise.base_names(evidence.effect_names, model.catalogue))
    for name in accepted.names:  # and its closest rivals in pairs, weighted by their probability
        remaining = tuple(candidate for candidate in accepted.names if candidate != name)
        mine = [rival for rival in rivals if rival.instead_of == name and rival.name in steady]
        close = {rival.name: rival.evidence for rival in mine if rival.evidence < WEAK}
        group = {name: 0.0, **dict(list(close.items())[:_RIVALS])}
        by_name = {candidate: evidence.fitted_values((*remaining, candidate))[candidate] for candidate in group}
        pairs += [
            planning.Pair(member, rival, values, remaining, exp(-group[member]))
            for member, values in by_name.items()
            for rival in group
            if rival != member and values is not None
        ]
    if not pairs or model.vessel is None or linearise.time_varying_among(accepted.names, model.catalogue):
        return None
    values = {name: size for name, size in evidence.fitted_values(accepted.names).items() if size is not None}
    rehearsal = planning.rehearsal_of(evidence.equations, model.vessel, values, progress)
    return planning.best_request(planning.rank_candidates(rehearsal, pairs), pairs)


def suspects_of(
    accepted: acceptance.Acceptance, withdrawn: Sequence[str], causes: few_causes.FewCauses | None
) -> tuple[Suspect, ...]:
    """What was found in the whole trial, as what is ``withdrawn``, or in some of its halves, but is not named; the
    most often found first."""
    found_in = dict.fromkeys(withdrawn, (few_causes.WHOLE,))
    if causes:
        whole = dict.fromkeys(causes.chosen.names, (few_causes.WHOLE,))
        found_in |= {name: (*whole.get(name, ()), *halves) for name, halves in causes.found_in.items()}
    catalogue, places = accepted.evidence.equations.model.catalogue, dict[str, tuple[str, ...]]()
    for name, parts in found_in.items():
        if name not in accepted.names:
            base = catalogue[name].base
            places[base] = max(places.get(base, ()), parts, key=len)
    return tuple(Suspect(name, places[name]) for name in sorted(places, key=lambda name: -len(places[name])))


def rank_effects(evidence: regression.Evidence) -> tuple[RankedEffect, ...]:
    """Every effect of the catalogue, ranked by how much it improves the model by itself."""
    smallest, catalogue = planning.detection_limits(evidence.equations), evidence.equations.model.catalogue
    result = []
    for name in linearise.base_names(evidence.effect_names, catalogue):
        effect = catalogue[name]
        fit = evidence.fit([name], with_prior=True)  # on some effects the data carry no information
        chance, unit = evidence.chance_of_gain(fit.gain, len(fit.columns)), effect.parameters[0].unit
        result.append(RankedEffect(name, effect.family, evidence.log_odds([name]), chance, smallest[name], unit))
    return tuple(sorted(result, key=lambda suspect: -suspect.evidence))


def find_contradictions(
    log: Log, model: linearise.ModelWithEffects, noise: DisturbanceNoise
) -> acceptance.Acceptance | None:
    """The sensor effects that explain the contradictions in ``log``, selected like others; None without any.

    ``model`` provides the catalogue, and its plant the motion within a second; its effects are left out.
    """
    sensors = motion_sensors(log, model)
    if not sensors:
        return None
    file_free = {name: free for name, free in model.file_effects.items() if name in sensors}
    evidence, names = _select_sensor_effects(
        log, linearise.ModelWithEffects(model.base, sensors, file_effects=file_free), noise
    )
    order = list(evidence.effect_names)
    for name in names:  # of two indistinguishable effects the first in the catalogue, the more common one
        deficits = acceptance.rivals_of(evidence, names, name)
        for rival in order[: order.index(name)]:
            swapped = tuple(rival if effect == name else effect for effect in names)
            if (
                deficits.get(rival, np.inf) < acceptance.CLOSE
                and acceptance.acceptance_tests(evidence, swapped, rival).is_accepted
            ):
                names = swapped
                break
    tests = {name: acceptance.acceptance_tests(evidence, names, name) for name in names}
    return acceptance.Acceptance(names, tests, evidence) if names else None


def motion_sensors(log: Log, model: linearise.ModelWithEffects) -> Catalogue:
    """The sensor effects on the reported motion, not those of the wind sensor."""
    sensors = [name for name, effect in model.catalogue.items() if effect.kind == "sensor"]
    plain = replace(model, at={})
    affecting = {
        signature.effect
        for signature in linearise.signatures(log, plain, log.nominal, sensors)
        if np.abs(signature.E).max() > 0.0
    }
    return {name: model.catalogue[name] for name in sensors if name in affecting}


def without_dynamics(noise: DisturbanceNoise, linear: linearise.LinearModel) -> DisturbanceNoise:
    """``noise`` with process noise so large that the speed of one second says nothing about the next."""
    answer = np.array([np.median(np.abs(linear.B[:, 3 + axis, axis])) for axis in range(3)])
    surge, sway, yaw = (float(level) for level in _UNKNOWN / np.maximum(answer, 1e-12))
    return replace(noise, gust=(surge, sway, yaw))


def _select_sensor_effects(
    log: Log, model: linearise.ModelWithEffects, noise: DisturbanceNoise
) -> tuple[regression.Evidence, tuple[str, ...]]:
    """The effects that pass their tests, at the linearisation that explains the data best.

    Linearising about the result usually helps; but a long delay, made by interpolation between seconds, is no
    better than the first-order effect of a short one.
    """
    excluded: frozenset[str] = frozenset()
    at: acceptance.Coordinates = {}
    best: tuple[float, regression.Evidence, tuple[str, ...]] | None = None
    for _ in range(_MAX_LINEARISATIONS):
        evidence = regression.evidence_of(_normal_equations(log, replace(model, at=at), noise))
        names = acceptance.search_effects(evidence, excluded)
        failed = [
            test
            for test in (acceptance.acceptance_tests(evidence, names, name) for name in names)
            if not test.is_accepted
        ]
        if failed:
            excluded |= {max(failed, key=lambda test: test.p_value).name}
        else:
            score = evidence.log_odds(names) - 0.5 * float(evidence.inner[0, 0])
            if best is None or score > best[0]:
                best = score, evidence, names
            if acceptance.has_converged(evidence, names, at, _SETTLED):
                break
        at = acceptance.fitted_coordinates(evidence, acceptance.search_effects(evidence, excluded))
    return best[1:] if best else (evidence, ())


def _normal_equations(
    log: Log, model: linearise.ModelWithEffects, noise: DisturbanceNoise
) -> regression.NormalEquations:
    """The regression on the sensor effects only; the tolerance of each sensor is a nuisance.

    The trajectory of the linearisation is kept: sensor errors do not change where the ship went, only what is
    reported of it. Errors shared by all sensors (one delay, another reference point or axis) are nuisances too:
    they show only where speeds change nonlinearly within a second.
    """
    plain = replace(model, at={}).plant()
    linear = linearise.linear_model(log, plain)
    reported = linearise.by_stage(log, model, linearise.sensor_readings, linear.origin) + _shift_from_full_second(
        log, linear.origin
    )
    linear = replace(linear, observed=log.measured - reported)
    effects, shared = _kinematic_signatures(log, model, linear.origin)
    tolerated = regression.tolerances(log, model.catalogue, effects)
    scales = np.array([model.catalogue[signature.effect].free_scale[signature.coordinate] for signature in effects])
    layout = regression.ColumnLayout(
        tuple(signature.effect for signature in effects), scales, tolerated, wind=len(shared)
    )
    loose = without_dynamics(noise, linear)
    gram = regression.gram_matrices(log, linear, columns_of(linear, [*effects, *shared]), loose)
    indices = np.flatnonzero(tolerated > 0.0)
    nuisance = np.concatenate([1 + indices, layout.first_wind + np.arange(len(shared))])
    return regression.NormalEquations(
        log, model, 0.0, linear, tuple(effects), layout, np.zeros(3), loose, gram,
        nuisance, np.concatenate([tolerated[indices], _SHARED]),
    )  # fmt: skip


def _kinematic_signatures(
    log: Log, model: linearise.ModelWithEffects, origin: Floats
) -> tuple[list[linearise.Signature], list[linearise.Signature]]:
    """The signatures of sensor effects and of errors shared by all sensors, by kinematics where these suffice."""
    psi, u, v, r = (origin + _shift_from_full_second(log, origin)).T[HEADING:]
    nil, cosine, sine, degree = np.zeros_like(r), np.cos(psi), np.sin(psi), np.deg2rad(1.0)
    delayed = (_shift_from_full_second(log, origin, _LATE_S) - _shift_from_full_second(log, origin, -_LATE_S)) / (
        2.0 * _LATE_S
    )
    # the change of the readings [T, 6] with a second of delay, a metre of lever arm and a degree of rotation
    kinematic = {
        (name, 0): np.where(np.isin(np.arange(6), indices), delayed, 0.0) for name, indices in _DELAYS.items()
    }
    for name, coordinate, columns in (
        ("position_antenna_offset", 0, (cosine, sine, nil, nil, nil, nil)),
        ("position_antenna_offset", 1, (-sine, cosine, nil, nil, nil, nil)),
        ("speed_sensor_offset", 0, (nil, nil, nil, nil, r, nil)),
        ("speed_sensor_offset", 1, (nil, nil, nil, -r, nil, nil)),
        ("speed_sensor_rotation", 0, (nil, nil, nil, degree * v, -degree * u, nil)),
    ):
        kinematic[name, coordinate] = np.column_stack(columns)
    shared = {
        "all_late": np.sum([kinematic[name, 0] for name in _DELAYS], axis=0),
        "all_ahead": kinematic["position_antenna_offset", 0] + kinematic["speed_sensor_offset", 0],
        "all_to_starboard": kinematic["position_antenna_offset", 1] + kinematic["speed_sensor_offset", 1],
        "all_turned": kinematic["speed_sensor_rotation", 0] + degree * (np.arange(6) == HEADING),
    }

    zeros, effects = np.zeros_like(origin), list[linearise.Signature]()
    steady = [
        name for name, effect in model.catalogue.items() if not isinstance(effect, linearise.TimeVaryingEffect)
    ]
    for signature in linearise.signatures(log, model, origin, steady):
        readings = kinematic.get((signature.effect, signature.coordinate))
        effects.append(signature if readings is None else replace(signature, D=zeros, E=readings))
    effects += linearise.time_varying_signatures(
        log, linearise.time_varying_among(model.catalogue, model.catalogue), effects
    )
    return effects, [linearise.Signature(name, 0, zeros, shift) for name, shift in shared.items()]


def _shift_from_full_second(log: Log, origin: Floats, late_s: float = 0.0) -> Floats:
    """The mean state ``late_s`` before the sampling times less that at the full second [T, 6], by kinematics.

    Speeds change linearly within a second; a ship model that lacks a force would bend them.
    """
    inside = np.diff(log.block) == 0
    gained = np.diff(origin[:, 3:], axis=0) * inside[:, None]
    ahead, behind = np.vstack([gained, np.zeros((1, 3))]), np.vstack([np.zeros((1, 3)), gained])
    first, last = np.append(True, ~inside), np.append(~inside, True)
    ahead[last], behind[first] = behind[last], ahead[first]
    around = np.empty((len(log), log.steps_per_second + 1, 6))
    for step in range(log.steps_per_second + 1):
        tau = step / log.steps_per_second - 0.5 - late_s
        change = behind if tau < 0.0 else ahead
        u, v, r = (origin[:, 3:] + 0.5 * tau * change).T  # the mean over that interval
        psi = origin[:, 2] + 0.5 * tau * (origin[:, 5] + 0.25 * tau * change[:, 2])
        around[:, step, 0] = tau * (u * np.cos(psi) - v * np.sin(psi))
        around[:, step, 1] = tau * (u * np.sin(psi) + v * np.cos(psi))
        around[:, step, 2] = tau * r
        around[:, step, 3:] = tau * change
    return np.asarray(np.einsum("tcq,tqc->tc", log.weight, around))


def diagnose(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel | BlackBox,
    tolerance: float = TOLERANCE,
    catalogue: Catalogue | None = None,
    progress: Progress = lambda share: None,
) -> Conclusion:
    """Diagnose tables of samples of the ship's channels against the model of ``vessel``.

    ``tolerance`` is the model error allowed, as a share of the force range. Raises :class:`ConfigurationError`
    for an impossible tolerance, :class:`DataShortageError` and :class:`InputError` for tables that lack what is
    needed.
    """
    if not 0.0 < tolerance < 1.0:
        raise ConfigurationError(
            f"a tolerance of {100.0 * tolerance:g} % is impossible", fix="give more than 0 and less than 100"
        )

    def part(first: float, last: float) -> Progress:
        return lambda share: progress(first + (last - first) * share)

    with threadpool_limits(1, user_api="blas"):  # nested in the filter's own threads they would only wait
        effects = catalogue_of(vessel) if catalogue is None else catalogue
        fixed_step_s = vessel.fixed_step_s if isinstance(vessel, BlackBox) else None
        log = log_of(tables, vessel.dimensions.length_overall_m, fixed_step_s, vessel.actuators)
        model = linearise.model_of(vessel, linearise.with_recordings(effects, log))
        accepted = accept_effects(linearise.linearise(log, model, tolerance), part(0.1, 0.6))
        for _ in range(CHANGES):  # effects that vary over the trial, as long as they are accepted
            change = likeliest_change(accepted) if may_change(accepted) else None
            if change is None:
                break
            equations = accepted.evidence.equations
            changing = {**equations.model.catalogue, change.name: change}
            model = replace(equations.model, at={}, catalogue=changing)
            repeated = accept_effects(linearise.linearise(equations.log, model, equations.tolerance))
            if change.name not in repeated.names:
                break
            accepted = repeated
        hold = accepted.evidence.equations.log.input_hold
        return reach_verdict(acceptance.drop_doubtful(accepted), log.with_input_hold(hold), part(0.6, 1.0))


def accept_effects(
    linearisation: linearise.Linearisation, progress: Progress = lambda share: None
) -> acceptance.Acceptance:
    """Stages two to five: the effects that pass all tests, and what they leave unexplained."""
    estimate = estimate_noise(linearisation, subtask_progress(progress, 0, 3))
    estimate = choose_input_hold(estimate, subtask_progress(progress, 1, 3))
    selection = coarse_model.select_unless_coarse(
        regression.weigh_evidence(estimate), subtask_progress(progress, 2, 3)
    )
    return coarse_model.coarse_acceptance(selection) or acceptance.accept(selection)


def choose_input_hold(estimate: NoiseEstimate, progress: Progress = lambda share: None) -> NoiseEstimate:
    """The estimate with the input hold that fits the motion best; for steps the noise is estimated again."""
    linearisation, best, highest = estimate.linearisation, INPUT_HOLDS[0], -np.inf
    for hold in INPUT_HOLDS:  # of equals the first: linear
        density = _log_evidence(estimate, hold, highest)
        if density > highest:
            best, highest = hold, density
    if best == linearisation.log.input_hold:
        return estimate
    return estimate_noise(
        linearise.linearise(linearisation.log.with_input_hold(best), linearisation.model, linearisation.tolerance),
        progress,
    )


def _log_evidence(estimate: NoiseEstimate, hold: InputHold, least: float) -> float:
    """Log evidence of an input hold on part of the data, less the margin by which steps have to be better.

    With sparse settings the difference is as large as a lag or a delay, so such effects are selected first at
    their size, unless after two linearisations the density is below ``least``, so that steps would have to gain
    the whole margin: in 18 searches on simulated trials further linearisations gained 1 at most. For a coarse
    model none converges: the evidence changes by hundreds from one linearisation to the next, and that linearised
    about no effect is compared.
    """
    linearisation = estimate.linearisation
    margin = 0.0 if hold == linearisation.log.input_hold else _PLAIN
    log = linearisation.log.with_input_hold(hold) if margin else linearisation.log
    part = linearise.linearise(
        log.subset(log.mask_of_spread_blocks(_ENOUGH_S)), linearisation.model, linearisation.tolerance
    )
    evidence = regression.evidence_of(regression.normal_equations(part, estimate.noise, number=regression.FEW))
    if log.setting_step_s > SELDOM_S:
        preliminary = coarse_model.preliminary_selection(evidence)
        density = acceptance.log_density(preliminary.evidence, preliminary.names) - margin
        if density + margin < least and not coarse_model.coarse_acceptance(preliminary):
            return density
        if not coarse_model.coarse_acceptance(
            selection := coarse_model.select_unless_coarse(evidence, preliminary=preliminary)
        ):
            accepted = acceptance.accept_names(selection)
            return acceptance.log_density(accepted.evidence, accepted.names) - margin
    return acceptance.log_density(evidence, acceptance.search_effects(evidence)) - margin
