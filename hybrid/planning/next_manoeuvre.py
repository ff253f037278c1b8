"""The next manoeuvre: the one that best separates effects that the data cannot distinguish.

Every candidate is simulated with the ship as identified, in the wind and noise of the recording, and evaluated
together with the recording, so that the model error is common to both. The best candidate is likely to separate
most pairs, whichever effect is true (Box and Hill 1967); for a pair it counts the evidence of one against the
other at any size (T-optimality: Atkinson and Fedorov 1975).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from seatrial.acquisition.core.errors import ModelRangeError, Progress
from seatrial.acquisition.core.ship import control_names, shafts
from seatrial.hybrid.diagnosis.evidence import NormalEquations, normal_equations
from seatrial.hybrid.diagnosis.linearise import linearise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.result import NextTrial
from seatrial.hybrid.diagnosis.select_effects import CLOSE
from seatrial.hybrid.effects import apply_effects
from seatrial.hybrid.planning.information import Design, Information, design_of, separation
from seatrial.hybrid.planning.repertoire import (
    CandidateManoeuvre,
    append_rehearsals,
    as_one_leg,
    rehearse,
    repertoire,
    shafts_of,
)
from seatrial.hybrid.simulation.sea_state import SeaState
from seatrial.hybrid.vessel.actuators.kind import RPM_PER_RPS
from seatrial.hybrid.vessel.effect import Values
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant

_IDLE_SHARE = 0.2  # of the fastest: slower shafts count as stopped
_WORTH_A_MINUTE = 0.1  # log odds per minute: less is not worthwhile
_LONGEST_S = 7200  # of a recording: more changes nothing


@dataclass(frozen=True, slots=True)
class Pair:
    """An effect at ``values`` that may be true, a ``rival`` of any size, and the effects fitted beside either.

    ``weight`` is the probability that the first is the true one.
    """

    name: str
    rival: str
    values: Values
    given: tuple[str, ...] = ()
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
    def gains(self) -> tuple[float, ...]:
        """The gain of each pair per minute."""
        return tuple((a - b) / self.candidate.minutes for a, b in zip(self.with_it, self.without, strict=True))


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A recording's legs followed by a leg for each candidate that the ship can make."""

    design: Design
    recorded: range
    candidates: tuple[CandidateManoeuvre, ...]


def next_manoeuvre(
    equations: NormalEquations,
    vessel: Vessel,
    values: Mapping[str, Values],
    pairs: Sequence[Pair],
    progress: Progress = lambda share: None,
) -> NextTrial | None:
    """The manoeuvre that separates most of ``pairs``, or None if no candidate is of use.

    ``values`` has the parameters of all named effects, with which the ship is simulated.
    """
    return best_request(rank_candidates(rehearsal_of(equations, vessel, values, progress), pairs), pairs)


def best_request(ranking: Sequence[RankedCandidate], pairs: Sequence[Pair]) -> NextTrial | None:
    """The first of a ranking as a request, or None if it is not worthwhile.

    The evidence is in log odds, of recording and manoeuvre together, for the closest of the pairs that the
    manoeuvre separates.
    """
    best = next(iter(ranking), None)
    if best is None or max(best.gains) < _WORTH_A_MINUTE:
        return None
    worst = min(
        (place for place, gain in enumerate(best.gains) if gain >= _WORTH_A_MINUTE), key=best.with_it.__getitem__
    )
    what, pair = f"{best.candidate.what}, {best.candidate.minutes:g} minutes in all", pairs[worst]
    return NextTrial(what, (pair.name, pair.rival), best.with_it[worst], best.candidate.minutes)


def rehearsal_of(
    equations: NormalEquations,
    vessel: Vessel,
    values: Mapping[str, Values],
    progress: Progress = lambda share: None,
) -> Rehearsal:
    """Simulate every candidate with the effects ``values``, following the recording."""
    model, log = equations.model, _shortened(equations.log)
    ship = apply_effects(model.base, values, model.catalogue)
    candidates = repertoire(shafts_of(vessel, usual_rpm(log)))
    made = rehearsals(candidates, vessel, ship, wind_in(log), float(np.rad2deg(log.nominal[-1, 2])))
    joined = append_rehearsals(log, [as_one_leg(each) for each in made.values()])
    whole = normal_equations(linearise(joined, model, equations.tolerance), equations.noise, progress=progress)
    return Rehearsal(design_of(whole), range(log.legs), tuple(made))


def rank_candidates(rehearsal: Rehearsal, pairs: Sequence[Pair]) -> list[RankedCandidate]:
    """Every candidate with its log odds for ``pairs``, the best first."""
    design, recorded = rehearsal.design, rehearsal.recorded
    now = _evidence(design.information(recorded), pairs)
    result = []
    for leg, candidate in enumerate(rehearsal.candidates, start=len(recorded)):
        both = _evidence(design.information([*recorded, leg]), pairs)
        result.append(RankedCandidate(candidate, both, now, _share_separated(both, pairs)))
    return sorted(result, key=lambda each: (-each.share_separated, -min(each.gains)))


def _share_separated(evidence: Sequence[float], pairs: Sequence[Pair]) -> float:
    """The share of the pairs likely to be separated: log odds have a variance of twice their mean."""
    expected = np.maximum(np.array(evidence), 1e-9)
    chances = norm.cdf((expected - CLOSE) / np.sqrt(2.0 * expected))
    return float(np.average(chances, weights=[each.weight for each in pairs]))


def rehearsals(
    candidates: Sequence[CandidateManoeuvre], vessel: Vessel, ship: Plant, sea: SeaState, heading_deg: float = 0.0
) -> dict[CandidateManoeuvre, Log]:
    """The simulated log of every candidate that stays in the range of the model."""
    made = {}
    for candidate in candidates:
        try:
            made[candidate] = rehearse(
                candidate.legs, vessel, ship, sea, round(60.0 * candidate.minutes), heading_deg
            )
        except ModelRangeError:  # cannot be evaluated, so it is not proposed
            continue
    return made


def usual_rpm(log: Log) -> float:
    """The usual shaft speed [rpm] under way: the median of the fastest propulsor."""
    main = {f"{name}_rpm" for name in shafts(log.actuators)}
    fastest = (
        np.abs(log.controls[:, :, [name in main for name in control_names(log.actuators)]])
        .mean(axis=1)
        .max(axis=1, initial=0.0)
        * RPM_PER_RPS
    )
    return float(np.median(fastest[fastest >= _IDLE_SHARE * fastest.max()]))


def wind_in(log: Log) -> SeaState:
    """The mean wind of a log, as a sea state without waves."""
    direction, speed = log.wind.T
    north, east = float((speed * np.cos(direction)).mean()), float((speed * np.sin(direction)).mean())
    from_deg = float(np.rad2deg(np.arctan2(east, north)) % 360.0)
    return SeaState(float(np.hypot(north, east)), 0.0, 5.0, 0.0, direction_from_deg=from_deg)


def _shortened(log: Log) -> Log:
    """Legs spread over a log, up to the length that is worth evaluating."""
    kept = max(1, round(log.legs * min(1.0, _LONGEST_S / len(log))))
    chosen = np.unique(np.linspace(0, log.legs - 1, kept).round().astype(int))
    return log.subset(np.isin(log.leg, chosen))


def _evidence(information: Information, pairs: Sequence[Pair]) -> tuple[float, ...]:
    """The log odds of each pair's first effect, at its value, against its second at any."""
    result = []
    for each in pairs:
        free = information.catalogue[each.name].free(each.values)
        result.append(0.5 * separation(information, each.name, each.rival, free, each.given))
    return tuple(result)
