"""Which manoeuvre to make next: each is rehearsed by the ship as she is now thought to be.

What its segments would say is added to what is known. The best one is where the covariance shrinks most
(D-optimality, Atkinson and Donev 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.core.actuators import names_of, shafts
from acquisition.core.arrays import Floats
from acquisition.core.errors import ModelRangeError, SeatrialError
from analysis.estimation.likelihood import UNKNOWN
from hybrid.effects.catalogue import vessel_plant
from hybrid.identification.fit import Fit, information_at
from hybrid.identification.response import Model
from hybrid.identification.segments import segments_of
from hybrid.simulation.sea_state import sea_state_named
from hybrid.simulation.trial import Noise, simulate_trial
from hybrid.vessel.parameters import Vessel

REPERTOIRE = ("zigzag_10_10", "zigzag_20_20", "turning_circle_15", "turning_circle_35", "speed_runs", "stopping",
              "reciprocal", "one_thruster", "tunnel_test")  # fmt: skip
SEGMENTS = 20
"""How long each is rehearsed, in segments."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A manoeuvre of ``minutes``: how much it would tell, in nats, the share of the variances it would leave on
    average, and which coefficients would be known then that are not now.
    """

    manoeuvre: str
    minutes: float
    gain: float
    left: float
    newly_known: tuple[str, ...]


def repertoire_of(vessel: Vessel) -> tuple[str, ...]:
    """The manoeuvres that a ship can make."""
    able = {
        "one_thruster": len(shafts(vessel.actuators)) > 1,
        "tunnel_test": bool(names_of(vessel.actuators, "tunnel")),
    }
    return tuple(name for name in REPERTOIRE if able.get(name, True))


def rank_trials(model: Model, found: Fit, names: Sequence[str]) -> list[Candidate]:
    """What each manoeuvre would tell beside what is known, the best first, without those that she cannot make."""
    ranked = []
    for name in names:
        try:
            told = _information(model, found, name)
        except SeatrialError:
            continue
        ranked.append(_candidate(model, found, name, told))
    return sorted(ranked, key=lambda each: -each.gain)


def _information(model: Model, found: Fit, name: str) -> Floats:
    """What a rehearsal says of the coefficients [P, P], its own surroundings unknown."""
    ship = model.vessel_at(found.z)
    lasting = model.segments.duration_s
    silent = Noise().scaled(0.0)
    table, _ = simulate_trial(
        ship, sea_state_named("calm"), name, (SEGMENTS + 0.5) * lasting, 1.0 / model.segments.dt_s, noise=silent
    )
    rehearsed = segments_of({name: table}, vessel_plant(ship), lasting)
    own, z = model.on_segments(rehearsed, found.z)
    kept = len(model.coefficients)
    whole = information_at(own, z, rehearsed.start, found.levels)
    if not np.isfinite(whole).all():
        raise ModelRangeError("the rehearsal leaves the model's range")
    around = whole[kept:, kept:] + np.eye(own.size - kept)
    return np.asarray(whole[:kept, :kept] - whole[:kept, kept:] @ np.linalg.solve(around, whole[kept:, :kept]))


def _candidate(model: Model, found: Fit, name: str, told: Floats) -> Candidate:
    kept = len(model.coefficients)
    before = found.covariance[:kept, :kept]
    after = np.linalg.inv(np.linalg.inv(before) + told)
    was, then = np.sqrt(np.diag(before)), np.sqrt(np.diag(after))
    gain = 0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1])
    newly = [each.name for each, a, b in zip(model.coefficients, was, then, strict=True) if a >= UNKNOWN > b]
    minutes = SEGMENTS * model.segments.duration_s / 60.0
    return Candidate(name, minutes, gain, float(np.mean((then / was) ** 2)), tuple(newly))
