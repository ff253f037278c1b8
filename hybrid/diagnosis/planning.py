"""The information of a trial on each effect, with or without data, and the manoeuvre to sail next.

The information matrix of all effects follows from the same inner products as the evidence, without the data, so
it also exists for a trial that has not been made. With F the inner products of the effects' columns, an effect
of size a changes twice the log likelihood by a' F a, and by less if another effect can imitate it.

The next manoeuvre is the one that best separates effects that the data cannot distinguish. Every candidate is
simulated with the ship as identified, in the wind and noise of the recording, and evaluated together with the
recording, so that the model error is common to both. The best candidate is likely to separate most pairs,
whichever effect is true (Box and Hill 1967); for a pair it counts the evidence of one against the other at any
size (T-optimality: Atkinson and Fedorov 1975). Candidates last some ten minutes, scaled to the ship's shaft
speeds and pace, in the words in which an officer of the watch may be asked for them. A simulated one is a log
without noise or gaps: the information depends on where it takes the ship, not on the noise of the readings, so
its true motion serves as the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import expm1, inf, log, log1p, sqrt
from typing import Any

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2, norm, t

from seatrial.acquisition.core.errors import ModelRangeError, Progress
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.ship import control_names, names_of_kind
from seatrial.acquisition.core.ship import shafts as drives_in
from seatrial.hybrid.diagnosis.acceptance import CLOSE, FALSE_ALARM, HELD_OUT_LEVEL
from seatrial.hybrid.diagnosis.linearise import linearise
from seatrial.hybrid.diagnosis.log import BLOCK_S, LEG_S, STEPS_PER_SECOND, Log
from seatrial.hybrid.diagnosis.regression import NormalEquations, explained_by, marginalise, normal_equations
from seatrial.hybrid.diagnosis.result import NextTrial
from seatrial.hybrid.effects import Catalogue, Effect, apply_effects
from seatrial.hybrid.simulation import manoeuvres, trial
from seatrial.hybrid.vessel import actuators, files, sensors
from seatrial.hybrid.vessel.black_box import equations_of
from seatrial.hybrid.vessel.effect import Values
from seatrial.hybrid.vessel.plant import Plant

POWER = 0.9
"""The power: an effect at its limit is found in this share of such trials."""

DISTINGUISHED = 9.0
"""Twice the log likelihood by which the wrong one of two effects has to be worse to be excluded (p = 0.13 %)."""

_NEGLIGIBLE = 1e-2  # of the prior's information: less is negligible
_NONE = 1e-7  # of the prior's information: less is rounding
_IDLE_SHARE = 0.2  # of the fastest: slower shafts count as stopped
_WORTH_A_MINUTE = 0.1  # log odds per minute: less is not worthwhile
_LONGEST_S = 7200  # of a recording: more changes nothing

MINUTES = 10.0
"""The length of a manoeuvre for R/V Gunnerus [min]; other ships' lengths are scaled."""

_FEWEST_MINUTES = 2
_IN_SECONDS_S = 100.0  # shorter times are given in seconds
_SLOW, _FAST = 0.7, 1.15  # of the usual shaft speed
_TUNNEL = 0.75  # of the tunnel thruster's limit
_ROUND_RPM = 5.0
_MIXED = "helm"  # what steers a ship by more than one sort of angle
_PER_SECOND = 16  # steps of the simulator, so that the autopilot's loop is as fast as a real one
_SEED = 20260903


@dataclass(frozen=True, slots=True)
class Information:
    """``matrix`` [P, P]: the information on all effects' free coordinates, nuisances marginalised."""

    matrix: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def about(self, name: str, fitted: Sequence[str] = ()) -> Floats:
        """The information on an effect's coordinates [d, d] when those of ``fitted`` are free."""
        empty, columns = np.zeros(0, dtype=np.int64), self.columns[name]
        fitted_columns = np.concatenate([empty, *(self.columns[effect] for effect in fitted)])
        return np.asarray(
            self.matrix[np.ix_(columns, columns)] - explained_by(self.matrix, columns, fitted_columns)
        )


def information_of(equations: NormalEquations) -> Information:
    """The information in all legs of a trial."""
    effects = 1 + np.arange(len(equations.layout.effect))
    matrix, _ = marginalise(equations.gram.sum(axis=0), effects, equations.nuisance, equations.nuisance_scale)
    return Information(matrix, _effect_columns(equations), equations.model.catalogue)


def _effect_columns(equations: NormalEquations) -> dict[str, Ints]:
    names = equations.model.catalogue
    return {name: np.array(equations.layout.columns_of(name), dtype=np.int64) - 1 for name in names}


@dataclass(frozen=True, slots=True)
class Design:
    """Legs [L, P+K, P+K] from which any trial can be assembled: inner products of effects and nuisances.

    The K nuisances are those combinations of all of them on which any leg has information, each of unit
    variance.
    """

    legs: Floats
    columns: Mapping[str, Ints]
    catalogue: Catalogue

    def information(self, legs: Sequence[int]) -> Information:
        """The information in some legs; one listed twice is sailed twice."""
        total = self.legs[np.array(legs, dtype=int)].sum(axis=0)
        effects = sum(len(columns) for columns in self.columns.values())
        nuisances = np.arange(effects, len(total))
        matrix, _ = marginalise(total, np.arange(effects), nuisances, np.ones(len(nuisances)))
        return Information(matrix, self.columns, self.catalogue)


def design_of(equations: NormalEquations) -> Design:
    """A trial's legs, prepared for repeated assembly."""
    scale, nuisance = equations.nuisance_scale, equations.nuisance
    granted = equations.gram.sum(axis=0)[np.ix_(nuisance, nuisance)] * np.outer(scale, scale)
    # pivoted Cholesky decomposition, stopped where pivots become negligible (Higham 1990)
    factor, order, rank, _ = lapack.dpstrf(granted, tol=_NEGLIGIBLE, lower=1)
    spanned = np.zeros((len(granted), rank))
    spanned[order - 1] = np.tril(factor)[:, :rank]
    informative = np.linalg.qr(spanned)[0]
    effects = 1 + np.arange(len(equations.layout.effect))
    change = np.zeros((equations.gram.shape[1], len(effects) + informative.shape[1]))
    change[effects, np.arange(len(effects))] = 1.0
    # What is tolerated of an effect has the effect's own column, so that this adds up and does not overwrite.
    change[nuisance, len(effects) :] += informative * scale[:, None]
    legs = np.array([change.T @ leg @ change for leg in equations.gram])
    return Design(legs, _effect_columns(equations), equations.model.catalogue)


def separation(
    information: Information, name: str, rival: str, free: Sequence[float], fitted: Sequence[str] = ()
) -> float:
    """Twice the log likelihood by which an effect at ``free`` coordinates is better than its best imitation.

    The ``rival`` imitates it at any size; effects in ``fitted`` are fitted beside either. The expected value
    without noise: a' (F_ii - F_ij F_jj^-1 F_ji) a.
    """
    size = np.asarray(free, dtype=float)
    return max(0.0, float(size @ information.about(name, (rival, *fitted)) @ size))


def least_separation(information: Information, name: str, rival: str) -> float:
    """The smallest :func:`separation` over all directions, of an effect of typical size."""
    spread = np.array(information.catalogue[name].free_scale)
    columns, rival_columns = information.columns[name], information.columns[rival]
    if len(columns) == len(rival_columns) == 1:  # most are, and a programme is weighed by thousands of them
        (i,), (j,), matrix = columns, rival_columns, information.matrix
        shared = matrix[i, j] ** 2 / matrix[j, j] if matrix[j, j] > 0.0 else 0.0
        return max(0.0, float((matrix[i, i] - shared) * spread[0] ** 2))
    least = np.linalg.eigvalsh(information.about(name, (rival,)) * np.outer(spread, spread))[0]
    return max(0.0, float(least))


def detection_limits(equations: NormalEquations) -> dict[str, float]:
    """The size at which each effect would be found in nine of ten trials like this one, in its parameter's
    unit.

    The distance of the first parameter from its neutral value, or the largest value for one that is absent at
    infinity. For an effect with a direction, the worst direction. Infinite (0 for the latter) if no possible
    size would do.
    """
    information, result = information_of(equations), {}
    detected = free_limits(information)
    effects, scale = 1 + np.arange(len(equations.layout.effect)), equations.nuisance_scale
    legs = np.array([marginalise(leg, effects, equations.nuisance, scale)[0] for leg in equations.gram])
    for name, effect in equations.model.catalogue.items():
        columns = information.columns[name]
        predicted = predicted_limit(information, name, legs[:, columns[:, None], columns])
        result[name] = as_parameter(effect, max(detected[name], predicted))
    return result


def as_parameter(effect: Effect, size: float) -> float:
    """A size in free coordinates as the deviation of the first parameter from neutral; infinite if out of
    bounds."""
    first = effect.parameters[0]
    if effect.chart == "inverse_square":
        value = size**-0.5
        return value if value >= first.low else 0.0
    return size if size <= max(first.high - first.neutral, first.neutral - first.low) else inf


def free_limits(information: Information) -> dict[str, float]:
    """The limits in free coordinates, ignoring bounds; infinite if undetectable."""
    result, count = dict[str, float](), len(information.catalogue)
    if not count:
        return result
    single = -expm1(log1p(-FALSE_ALARM) / count)  # the significance, corrected for all effects (Sidak 1967)
    for name, effect in information.catalogue.items():
        block, prior, shape = information.about(name), np.array(effect.free_scale), _relative_sizes(effect)
        relative = np.asarray(np.linalg.eigvalsh(block * np.outer(prior, prior)), dtype=np.float64)
        if relative[0] < _NONE:
            result[name] = inf
            continue
        # the gain that significance needs, and that at which the log evidence less the penalty is zero
        significant = float(chi2.isf(single, len(relative)))
        occam = float(np.log1p(relative).sum()) + 2.0 * log(count)
        needed = noncentrality(max(significant, occam * float(1.0 + 1.0 / relative[0])), len(prior))
        worst = float(np.linalg.eigvalsh(block * np.outer(shape, shape))[0])
        # The interval of one that is found has to reach what anyone cares about.
        reach = effect.smallest_free[0] - (1.96 - float(norm.ppf(POWER))) / sqrt(worst)
        result[name] = max(sqrt(needed / worst), reach)
    return result


def _relative_sizes(effect: Effect) -> Floats:
    """The size of each coordinate relative to the first."""
    if len({parameter.unit for parameter in effect.parameters}) == 1 or effect.chart != "linear":
        return np.ones(len(effect.free_scale))
    return np.asarray(np.array(effect.free_scale) / effect.free_scale[0])


def predicted_limit(information: Information, name: str, legs: Floats) -> float:
    """The size, in free coordinates, at which an effect's gains on held-out legs become significant (Student).

    ``legs`` [L, d, d] is its information in each. A leg gains half its noncentrality, with the noncentrality as
    variance, so in units of its scatter half the root, and the spread of information between legs adds scatter.
    Infinite if that alone hides any size: an effect that shows in one leg of many is not predicted by the
    others.
    """
    shape = _relative_sizes(information.catalogue[name])
    direction = shape * np.linalg.eigh(information.about(name) * np.outer(shape, shape))[1][:, 0]
    noncentralities = np.einsum("i,lij,j->l", direction, legs, direction)
    count, total = len(noncentralities), float(noncentralities.sum())
    if count < 2 or total <= 0.0:
        return inf
    level, margin = float(t.isf(HELD_OUT_LEVEL, count - 1)), float(norm.ppf(POWER))
    share = np.sqrt(np.maximum(noncentralities, 0.0) / total)
    even, uneven = 0.5 * float(share.mean()) * sqrt(count), 0.25 * float(share.var(ddof=1))
    # (even x - margin)^2 = level^2 (1 + uneven x^2), with x^2 the noncentrality of all legs
    leading = even**2 - level**2 * uneven
    if leading <= 0.0:
        return inf
    constant = margin**2 - level**2
    root = (margin * even + sqrt(max(0.0, (margin * even) ** 2 - leading * constant))) / leading
    return root / sqrt(total)


@lru_cache(maxsize=4096)
def noncentrality(threshold: float, degrees: int, power: float = POWER) -> float:
    """The noncentrality at which a chi-square variate exceeds ``threshold`` with probability ``power``."""
    limit = 4.0 * threshold + 100.0
    return float(brentq(lambda value: float(ncx2.sf(threshold, degrees, value)) - power, 1e-9, limit, xtol=1e-6))


@dataclass(frozen=True, slots=True)
class Pair:
    """An effect at ``values`` that may be true, a ``rival`` of any size, and the effects fitted beside either.

    ``weight`` is the probability that the first is the true one.
    """

    name: str
    rival: str
    values: Values
    fitted: tuple[str, ...] = ()
    weight: float = 1.0


@dataclass(frozen=True, slots=True)
class RankedCandidate:
    """A candidate, the log odds of each pair with it and without it, and its value.

    ``share_separated`` is the share of the pairs that it is likely to separate.
    """

    candidate: CandidateManoeuvre
    with_it: tuple[float, ...]
    without: tuple[float, ...]
    share_separated: float

    @property
    def gains_per_minute(self) -> tuple[float, ...]:
        """The gain of each pair per minute."""
        return tuple((a - b) / self.candidate.minutes for a, b in zip(self.with_it, self.without, strict=True))


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A recording's legs followed by a leg for each candidate that the ship can make."""

    design: Design
    recorded: range
    candidates: tuple[CandidateManoeuvre, ...]


def best_request(ranking: Sequence[RankedCandidate], pairs: Sequence[Pair]) -> NextTrial | None:
    """The first of a ranking as a request, or None if it is not worthwhile.

    The evidence is in log odds, of recording and manoeuvre together, for the closest of the pairs that the
    manoeuvre separates.
    """
    best = next(iter(ranking), None)
    if best is None or max(best.gains_per_minute) < _WORTH_A_MINUTE:
        return None
    worst = min(
        (place for place, gain in enumerate(best.gains_per_minute) if gain >= _WORTH_A_MINUTE),
        key=best.with_it.__getitem__,
    )
    request, pair = f"{best.candidate.what}, {best.candidate.minutes:g} minutes in all", pairs[worst]
    return NextTrial(request, (pair.name, pair.rival), best.with_it[worst], best.candidate.minutes)


def rehearsal_of(
    equations: NormalEquations,
    vessel: files.Vessel,
    values: Mapping[str, Values],
    progress: Progress = lambda share: None,
) -> Rehearsal:
    """Simulate every candidate with the effects ``values``, following the recording."""
    model, log = equations.model, equations.log
    number = max(1, round(log.leg_count * min(1.0, _LONGEST_S / len(log))))  # spread over the log
    log = log.subset(np.isin(log.leg, np.unique(np.linspace(0, log.leg_count - 1, number).round().astype(int))))
    ship = apply_effects(equations_of(model.base, "trials with it are rehearsed"), values, model.catalogue)
    candidates = candidates_of_ship(shafts_of(vessel, usual_rpm(log)))
    heading_deg = float(np.rad2deg(log.nominal[-1, 2]))
    logs = rehearsals(candidates, vessel, ship, wind_in(log), heading_deg, log.steps_per_second)
    joined = append_rehearsals(log, [as_one_leg(leg_log) for leg_log in logs.values()])
    extended = normal_equations(linearise(joined, model, equations.tolerance), equations.noise, progress=progress)
    return Rehearsal(design_of(extended), range(log.leg_count), tuple(logs))


def rank_candidates(rehearsal: Rehearsal, pairs: Sequence[Pair]) -> list[RankedCandidate]:
    """Every candidate with its log odds for ``pairs``, the best first."""
    design, recorded = rehearsal.design, rehearsal.recorded
    now = _log_odds_of_pairs(design.information(recorded), pairs)
    result = []
    for leg, candidate in enumerate(rehearsal.candidates, start=len(recorded)):
        with_candidate = _log_odds_of_pairs(design.information([*recorded, leg]), pairs)
        expected = np.maximum(np.array(with_candidate), 1e-9)
        chances = norm.cdf((expected - CLOSE) / np.sqrt(2.0 * expected))  # the variance is twice the mean
        share_separated = float(np.average(chances, weights=[pair.weight for pair in pairs]))
        result.append(RankedCandidate(candidate, with_candidate, now, share_separated))
    return sorted(result, key=lambda ranked: (-ranked.share_separated, -min(ranked.gains_per_minute)))


def rehearsals(
    candidates: Sequence[CandidateManoeuvre],
    vessel: files.Vessel,
    ship: Plant,
    sea: trial.SeaState,
    heading_deg: float = 0.0,
    steps_per_second: int = STEPS_PER_SECOND,
) -> dict[CandidateManoeuvre, Log]:
    """The simulated log of every candidate that stays in the range of the model."""
    logs = {}
    for candidate in candidates:
        try:
            logs[candidate] = rehearse(
                candidate.legs, vessel, ship, sea, round(60.0 * candidate.minutes), heading_deg, steps_per_second
            )
        except ModelRangeError:  # cannot be evaluated, so it is not proposed
            continue
    return logs


def usual_rpm(log: Log) -> float:
    """The usual shaft speed [rpm] under way: the median of the fastest propulsor."""
    main = {f"{name}_rpm" for name in drives_in(log.actuators)}
    fastest = (
        np.abs(log.controls[:, :, [name in main for name in control_names(log.actuators)]])
        .mean(axis=1)
        .max(axis=1, initial=0.0)
        * actuators.RPM_PER_RPS
    )
    return float(np.median(fastest[fastest >= _IDLE_SHARE * fastest.max()]))


def wind_in(log: Log) -> trial.SeaState:
    """The mean wind of a log, as a sea state without waves."""
    direction, speed = log.wind.T
    north, east = float((speed * np.cos(direction)).mean()), float((speed * np.sin(direction)).mean())
    from_deg = float(np.rad2deg(np.arctan2(east, north)) % 360.0)
    return trial.SeaState(float(np.hypot(north, east)), 0.0, 5.0, 0.0, direction_from_deg=from_deg)


def _log_odds_of_pairs(information: Information, pairs: Sequence[Pair]) -> tuple[float, ...]:
    """The log odds of each pair's first effect, at its value, against its second at any."""
    result = []
    for pair in pairs:
        free = information.catalogue[pair.name].free_coordinates(pair.values)
        result.append(0.5 * separation(information, pair.name, pair.rival, free, pair.fitted))
    return tuple(result)


@dataclass(frozen=True, slots=True, eq=False)
class CandidateManoeuvre:
    """A manoeuvre: name, description, and legs that are repeated until its ``minutes`` are over."""

    name: str
    what: str
    legs: manoeuvres.Manoeuvre
    minutes: float = MINUTES


@dataclass(frozen=True, slots=True)
class Shafts:
    """Shaft speeds [rpm] for manoeuvres: usual, half, slower, faster; the tunnel thruster's.

    ``drives`` and ``tunnels`` are the names of propulsors and tunnel thrusters, ``steering`` those of the
    actuators that steer by an angle, none for a ship steered by differential thrust. ``drive`` and
    ``steers`` are words for one of them. ``time`` is the length of the ship's manoeuvres relative to R/V
    Gunnerus'. ``most`` is the lowest limit of its shafts, ``hard_over`` the rpm that a hard-over helm adds
    to one shaft and subtracts from the other.
    """

    usual: float
    half: float
    slow: float
    fast: float
    tunnel: float
    drives: tuple[str, ...]
    steering: tuple[str, ...]
    tunnels: tuple[str, ...]
    drive: str = "thruster"
    steers: str = "azimuth"
    time: float = 1.0
    most: float = inf
    hard_over: float = 0.0

    @property
    def minutes(self) -> float:
        """The length of a manoeuvre, with repetitions, in whole minutes."""
        return float(max(_FEWEST_MINUTES, round(MINUTES * self.time)))

    def candidate(self, name: str, what: str, legs: Sequence[manoeuvres.Leg]) -> CandidateManoeuvre:
        """A candidate whose legs are given in R/V Gunnerus' time."""
        return CandidateManoeuvre(name, what, manoeuvres.scale_times(tuple(legs), self.time), self.minutes)

    def duration_words(self, seconds: float) -> str:
        """A time given for R/V Gunnerus, scaled to this ship, in words."""
        scaled_s = seconds * self.time
        if scaled_s < _IN_SECONDS_S:
            return "a minute" if round(scaled_s) == 60 else f"{max(5.0, 5.0 * round(scaled_s / 5.0)):g} seconds"
        return f"{round(scaled_s / 30.0) / 2.0:g} minutes"

    def helm_words(self, angle_deg: float, rpm: float) -> str:
        """The helm at an angle and a shaft speed, in words."""
        if not self.steering:
            difference = angle_deg / manoeuvres.HARD_OVER_DEG * self.hard_over
            return (
                f"one shaft at {min(rpm + difference, self.most):.0f} and the other at {rpm - difference:.0f} rpm"
            )
        number = {1: f"the {self.steers}", 2: f"both {self.steers}s"}
        return f"{number.get(len(self.steering), f'all {self.steers}s')} at {angle_deg:g} degrees"


def shafts_of(vessel: files.Vessel, usual_rpm: float) -> Shafts:
    """Round figures around a usual shaft speed, within the limits of the drives."""
    limit = manoeuvres.shaft_limit_rpm(vessel)
    usual_rpm = min(usual_rpm, limit)
    usual, half, slow, fast = (
        min(max(_ROUND_RPM, round(usual_rpm * share / _ROUND_RPM) * _ROUND_RPM), limit)
        for share in (1.0, 0.5, _SLOW, _FAST)
    )
    tunnel_limit = min((tunnel.limit_rpm for tunnel in vessel.of_kind("tunnel")), default=0.0)
    steering = [actuator for actuator in vessel.actuators if actuator.angle]
    drives = {actuator.noun for actuator in vessel.actuators if actuator.drives}
    steers = {actuator.steers_by for actuator in steering}
    return Shafts(
        usual, half, slow, fast, round(_TUNNEL * tunnel_limit / _ROUND_RPM) * _ROUND_RPM,
        drives_in(vessel.actuators), tuple(actuator.name for actuator in steering),
        names_of_kind(vessel.actuators, "tunnel"),
        drives.pop() if len(drives) == 1 else "thruster", steers.pop() if len(steers) == 1 else _MIXED,
        manoeuvres.pace_of(vessel).time, limit, manoeuvres.usual_rpm(vessel),
    )  # fmt: skip


def candidates_of_ship(shafts: Shafts) -> tuple[CandidateManoeuvre, ...]:
    """All candidates that a ship with these thrusters can make."""
    candidates = [*_straight_runs(shafts), *_helm_manoeuvres(shafts), *_speed_changes(shafts)]
    candidates += _drive_manoeuvres(shafts)
    if shafts.tunnels:
        speeds, sides = (0.0, 0.3 * shafts.usual), (shafts.tunnel, 0.0, -shafts.tunnel, 0.0)
        legs = [
            manoeuvres.Leg(rpm=rpm, orders={f"{name}_rpm": side}, at_most_s=60.0)
            for name in shafts.tunnels
            for rpm in speeds
            for side in sides
        ]
        subject = "the tunnel thruster" if len(shafts.tunnels) == 1 else "each tunnel thruster"
        minute = shafts.duration_words(60.0)
        request = (
            f"Run {subject} at {shafts.tunnel:g} rpm to either side, {minute} each and {minute} "
            f"of rest between, stopped and at {speeds[1]:.0f} rpm ahead"
        )
        candidates.append(shafts.candidate("tunnel_thruster", request, legs))
    drift = (manoeuvres.Leg(rpm=0.0, at_most_s=60.0 * MINUTES),)
    return *candidates, shafts.candidate("drifting", "Lie stopped without any thrust and drift", drift)


def _straight_runs(shafts: Shafts) -> list[CandidateManoeuvre]:
    usual, speeds = shafts.usual, (shafts.half, shafts.slow, shafts.usual, shafts.fast)
    steps = ", ".join(f"{rpm:g}" for rpm in speeds)
    return [
        shafts.candidate(
            "reciprocal_headings",
            f"Run straight at {usual:g} rpm, {shafts.duration_words(240.0)} on a heading and as long on the "
            "reciprocal",
            manoeuvres.on_reciprocal_courses(
                lambda course: (manoeuvres.settle(course, usual), manoeuvres.steer(course, 220.0, usual))
            ),
        ),
        shafts.candidate(
            "four_headings",
            f"Run straight at {usual:g} rpm on four headings 90 degrees apart, {shafts.duration_words(120.0)} each",
            manoeuvres.straight_runs_on_four_headings(110.0, usual),
        ),
        shafts.candidate(
            "speed_runs",
            f"Run straight at {steps} rpm, {shafts.duration_words(60.0)} each, on a heading and on the reciprocal",
            manoeuvres.on_reciprocal_courses(
                lambda course: (
                    manoeuvres.settle(course, speeds[0]),
                    *(manoeuvres.steer(course, 65.0, rpm) for rpm in speeds),
                )
            ),
        ),
    ]


def _helm_manoeuvres(shafts: Shafts) -> list[CandidateManoeuvre]:
    candidates = [
        shafts.candidate(
            f"turns_{helm_deg:g}",
            f"Turn through {turn_deg:g} degrees at {shafts.usual:g} rpm with "
            f"{shafts.helm_words(helm_deg, shafts.usual)}, to one side and then to the other",
            manoeuvres.turning_circle(helm_deg, shafts.usual, turn_deg),
        )
        for helm_deg, turn_deg in ((15.0, 360.0), (30.0, 720.0))
    ]

    def zigzags(helm_deg: float, switch_deg: float, rpm: float, suffix: str = "") -> CandidateManoeuvre:
        swings = manoeuvres.zigzag(helm_deg, switch_deg, rpm, swings=10)
        helm = "" if shafts.steering else f" with {shafts.helm_words(helm_deg, rpm)}"
        return shafts.candidate(
            f"zigzags_{helm_deg:g}_{switch_deg:g}{suffix}",
            f"Zigzags {helm_deg:g}/{switch_deg:g} at {rpm:g} rpm{helm}, about a heading and about the reciprocal",
            manoeuvres.on_reciprocal_courses(lambda course: (manoeuvres.settle(course, rpm), *swings)),
        )

    candidates += [zigzags(10.0, 10.0, shafts.usual), zigzags(20.0, 20.0, shafts.usual)]
    return [*candidates, zigzags(20.0, 20.0, shafts.slow, "_slow"), zigzags(30.0, 5.0, shafts.usual)]


def _speed_changes(shafts: Shafts) -> list[CandidateManoeuvre]:
    usual, half, fast = shafts.usual, shafts.half, shafts.fast
    changes, idle = (half, fast) * 4, manoeuvres.Leg(rpm=0.0, at_most_s=180.0)
    candidates = [
        shafts.candidate(
            "speed_changes",
            f"Speed up to {fast:g} rpm and slow down to {half:g} rpm every {shafts.duration_words(30.0)}, "
            f"{shafts.duration_words(300.0)} on a heading and as long on the reciprocal",
            manoeuvres.on_reciprocal_courses(
                lambda course: (
                    manoeuvres.settle(course, fast),
                    *(manoeuvres.steer(course, 30.0, rpm) for rpm in changes),
                )
            ),
        ),
        shafts.candidate(
            "coasting",
            f"Speed up to {usual:g} rpm and coast without thrust for {shafts.duration_words(180.0)}, on a heading "
            "and on the reciprocal",
            manoeuvres.on_reciprocal_courses(
                lambda course: (manoeuvres.settle(course, usual), manoeuvres.steer(course, 60.0, usual), idle)
            ),
        ),
    ]
    if shafts.drive == "propeller":
        astern = manoeuvres.Leg(rpm=-usual, slower_mps=0.0, at_most_s=120.0)
        request = (
            f"Speed up to {usual:g} rpm and stop at {usual:g} rpm astern until she stands, on a heading and on the "
            "reciprocal"
        )
        legs = manoeuvres.on_reciprocal_courses(
            lambda course: (manoeuvres.settle(course, usual), manoeuvres.steer(course, 90.0, usual), astern)
        )
        candidates.append(shafts.candidate("crash_stops", request, legs))
    return candidates


def _drive_manoeuvres(shafts: Shafts) -> list[CandidateManoeuvre]:
    candidates, usual, slow = list[CandidateManoeuvre](), shafts.usual, shafts.slow
    if len(shafts.drives) > 1:
        spaced = (name.replace("_", " ") for name in shafts.drives)
        alone, *remaining = (name if shafts.drive in name else f"{name} {shafts.drive}" for name in spaced)
        continued = "".join(f", then on the {name} alone" for name in remaining)
        seconds, spans = 120.0, f"{shafts.duration_words(120.0)} each"
        if shafts.steering:
            held = f"{shafts.duration_words(60.0)} each held straight, at 15 degrees and at -15 degrees"
            seconds, spans = 300.0, f"{shafts.duration_words(120.0)} on a course, then {held}"
        request = f"Run on the {alone} alone at {usual:g} rpm{continued}: {spans}"
        by_drive = manoeuvres.single_drive_legs(shafts.drives, usual, seconds, by_angle=bool(shafts.steering))
        legs = [leg for drive_legs in by_drive for leg in drive_legs]
        candidates.append(shafts.candidate("one_thruster_at_a_time", request, legs))
    if len(shafts.drives) == 2 and shafts.steering:
        first, second = shafts.drives
        legs = []
        for first_rpm, second_rpm in ((usual, slow), (slow, usual)):
            orders = {f"{first}_rpm": first_rpm, f"{second}_rpm": second_rpm}
            legs.append(manoeuvres.Leg(orders=orders, course_deg=0.0, at_most_s=90.0))
            legs += [manoeuvres.Leg(orders=orders, helm_deg=angle, at_most_s=45.0) for angle in (10.0, -10.0)]
        names = [name.replace("_", " ") for name in (first, second)]
        request = (
            f"Run with {names[0]} at {usual:g} and {names[1]} at {slow:g} rpm, then the other way round: "
            f"{shafts.duration_words(90.0)} on a course, {shafts.duration_words(45.0)} each at 10 degrees and at "
            "-10 degrees"
        )
        candidates.append(shafts.candidate("uneven_thrusters", request, legs))
    if len(shafts.steering) == 2 and shafts.steers != _MIXED:
        first, second = (f"{name}_angle_deg" for name in shafts.steering)
        legs = [
            manoeuvres.Leg(rpm=usual, orders={first: a, second: -a}, at_most_s=75.0)
            for a in (20.0, -20.0, 35.0, -35.0)
        ]
        number = len(shafts.drives)
        drives = {1: f"the {shafts.drive}", 2: f"both {shafts.drive}s"}.get(number, f"all {shafts.drive}s")
        request = (
            f"Hold {drives} at {usual:g} rpm with {shafts.steers}s opposed, 20 and 35 degrees inwards and "
            f"outwards, {shafts.duration_words(75.0)} each, twice"
        )
        candidates.append(shafts.candidate(f"{shafts.steers}s_opposed", request, legs))
    return candidates


def rehearse(
    legs: manoeuvres.Manoeuvre,
    vessel: files.Vessel,
    plant: Plant,
    sea: trial.SeaState,
    seconds: int,
    heading_deg: float = 0.0,
    steps_per_second: int = STEPS_PER_SECOND,
) -> Log:
    """Simulate ``seconds`` of a manoeuvre with ``plant`` and the autopilot and drives of ``vessel``.

    Gusts are those of the ``sea``, always the same; waves and current are not, as they belong to the noise and
    to the plant. Raises :class:`ModelRangeError` if the ship leaves the range of its model.
    """
    within = _PER_SECOND // steps_per_second  # steps of the simulator in one of the log
    streams = [np.random.default_rng(seed) for seed in np.random.SeedSequence(_SEED).spawn(2)]
    dt_s = 1.0 / _PER_SECOND
    voyage = trial.sail_through(
        vessel, plant, sea, legs, (seconds + 1) * _PER_SECOND, dt_s, heading_deg, streams[0], streams[1]
    )
    measured = sensors.measure(voyage.states, plant, dt_s)[:-1:_PER_SECOND][: seconds + 1]
    end = len(voyage.controls) // within * within
    controls = voyage.controls[:end].reshape(-1, within, voyage.controls.shape[1]).mean(axis=1)
    rows = seconds + 1
    block = np.arange(rows, dtype=np.int64) * max(1, round(rows / BLOCK_S)) // rows
    weight = np.zeros((rows, 6, steps_per_second + 1))
    weight[:, :, steps_per_second // 2] = 1.0
    return Log(
        measured, weight, measured.copy(), controls[: rows * steps_per_second].reshape(rows, steps_per_second, -1),
        voyage.wind[::_PER_SECOND][:rows].copy(), np.arange(rows, dtype=np.int64), block,
        block // round(LEG_S / BLOCK_S), np.zeros(rows, dtype=np.int64), vessel.actuators,
    )  # fmt: skip


def as_one_leg(log: Log) -> Log:
    """The same log as a single leg."""
    return replace(log, leg=np.zeros(len(log), dtype=np.int64))


def append_rehearsals(first: Log, following: Sequence[Log]) -> Log:
    """Several logs as one: each continues at the place of the one before and, after a break, at its time.

    Channels not measured in ``first`` are not measured in the others either.
    """
    parts = [first]
    missing = ~np.isfinite(first.measured).any(axis=0)
    for rehearsal in following:
        last = parts[-1]
        shift = np.zeros(6)
        shift[:2] = last.nominal[-1, :2] - rehearsal.nominal[0, :2]
        measured = rehearsal.measured + shift
        measured[:, missing] = np.nan
        parts.append(
            replace(
                rehearsal, measured=measured, nominal=rehearsal.nominal + shift,
                time_s=rehearsal.time_s - rehearsal.time_s[0] + last.time_s[-1] + BLOCK_S,
                block=rehearsal.block + last.block[-1] + 1, leg=rehearsal.leg + last.leg[-1] + 1,
                recording=np.full_like(rehearsal.recording, last.recording[-1]),
            )
        )  # fmt: skip
    arrays = [name for name in Log.__slots__ if isinstance(getattr(first, name), np.ndarray)]
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    # A simulated log has a single input hold, and no log before it.
    return replace(first, held={}, cut_from=None, meters={}, **together)
