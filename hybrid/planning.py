"""Planning a trial: which effects it could show, from what size, which it could not distinguish, and a better
programme.

The programme and the repertoire are simulated with the reference ship and evaluated together; any other
programme is a sum of the same legs. No recording is needed.

A better programme is assembled by adding the best manoeuvre repeatedly, then by exchanges. The criterion sums
over all effects of typical size (would it be detected?) and all pairs (would they be separated?). Each term
falls as its evidence grows and levels off when there is enough, so the worst weigh the most (after Fedorov
1972).
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, log1p
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.acquisition.config.declarations import vessel_names
from seatrial.acquisition.core import ship as ship_names
from seatrial.acquisition.core.errors import ConfigurationError, Progress, subtask_progress
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Result
from seatrial.analysis.conduct.programme import TrialProgramme, programme_from_template
from seatrial.analysis.manoeuvres import criteria
from seatrial.hybrid.diagnosis import disturbance_model, planning
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.regression import normal_equations
from seatrial.hybrid.effects import Catalogue, catalogue_of, vessel_plant
from seatrial.hybrid.simulation import manoeuvres, trial, vessel_check
from seatrial.hybrid.vessel import files

_SEEN = planning.noncentrality(16.0, 1)
_LEAST = 1e-3  # evidence below this is none
_EXCHANGES = 2
DEFAULT = "programme"
_NOISE_S = 600.0
_PART = re.compile(r"([a-z_0-9]+?)(?:=([0-9.]+))?")


@dataclass(frozen=True, slots=True)
class Aims:
    """The aims of a programme: effects to be detected, and pairs to be separated, of typical sizes."""

    effects: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]


def compose_programme(
    design: planning.Design, legs: Sequence[int], slots: int, aims: Aims, progress: Progress = lambda share: None
) -> list[int]:
    """Choose ``slots`` of the ``legs``, possibly with repetition, in their own order."""
    chosen: list[int] = []
    for number in range(slots):
        chosen.append(min(legs, key=lambda leg: aims_shortfall(design, [*chosen, leg], aims)))
        progress((number + 1) / (slots + _EXCHANGES))
    for number in range(_EXCHANGES):
        before = list(chosen)
        for place in range(slots):
            remaining = [*chosen[:place], *chosen[place + 1 :]]
            best = min(legs, key=lambda leg: aims_shortfall(design, [*remaining, leg], aims))
            if aims_shortfall(design, [*remaining, best], aims) < aims_shortfall(design, chosen, aims) - 1e-9:
                chosen[place] = best
        progress((slots + number + 1) / (slots + _EXCHANGES))
        if chosen == before:
            break
    return sorted(chosen)


def aims_shortfall(design: planning.Design, legs: Sequence[int], aims: Aims) -> float:
    """The shortfall of these legs from all aims; 0 would be perfect."""
    information = design.information(legs)
    detection = sum(
        log1p(_SEEN / max(evidence_of_typical_effect(information, name), _LEAST)) for name in aims.effects
    )
    separation = sum(
        log1p(planning.DISTINGUISHED / max(evidence_separating_pair(information, *pair), _LEAST))
        for pair in aims.pairs
    )
    return detection / max(len(aims.effects), 1) + separation / max(len(aims.pairs), 1)


def evidence_of_typical_effect(information: planning.Information, name: str) -> float:
    """Twice the log likelihood of an effect of typical size, in the worst direction."""
    scale = np.array(information.catalogue[name].free_scale)
    block = information.about(name)
    if len(scale) == 1:
        return float(block[0, 0] * scale[0] ** 2)
    return float(np.linalg.eigvalsh(block * np.outer(scale, scale))[0])


def evidence_separating_pair(information: planning.Information, name: str, rival: str) -> float:
    """Twice the log likelihood that separates two effects of typical sizes, whichever is present.

    Infinite if neither would be detected: then they cannot be confused.
    """
    ways = ((name, rival), (rival, name))
    detectable = [
        pair for pair in ways if evidence_of_typical_effect(information, pair[0]) >= planning.DISTINGUISHED
    ]
    return min((planning.least_separation(information, *pair) for pair in detectable), default=inf)


@dataclass(frozen=True, slots=True)
class Programme:
    """A sequence of manoeuvres and what they would show.

    ``limits``: how far from neutral each effect's first parameter has to be to be found in nine of ten such
    trials, or up to which value for one that is absent at infinity. ``evidence`` [E, E]: twice the log
    likelihood that separates two effects of typical sizes, infinite for an effect and itself.
    """

    parts: tuple[planning.CandidateManoeuvre, ...]
    limits: Mapping[str, float]
    evidence: Floats

    @property
    def minutes(self) -> float:
        """The total length [min]."""
        return sum(part.minutes for part in self.parts)

    def indistinguishable_pairs(self) -> list[tuple[str, str]]:
        """Pairs of effects that it could not separate."""
        names = list(self.limits)
        rows, columns = np.nonzero(np.tril(self.evidence < planning.DISTINGUISHED, -1))
        return [(names[j], names[i]) for i, j in zip(rows, columns, strict=True)]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: a limit that no possible size would reach is ``None``."""
        limits = {name: value if isfinite(value) and value > 0.0 else None for name, value in self.limits.items()}
        pairs = [list(pair) for pair in self.indistinguishable_pairs()]
        parts = [{"name": part.name, "what": part.what, "minutes": part.minutes} for part in self.parts]
        return {"minutes": self.minutes, "parts": parts, "limits": limits, "indistinguishable": pairs}


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Result):
    """A given programme, and a better one."""

    vessel: str
    sea: trial.SeaState
    tolerance: float
    catalogue: Catalogue
    asked: Programme
    better: Programme
    view = "seatrial.hybrid.report.text:plan_view"
    drawing = "seatrial.hybrid.report.pages:draw_plan"
    size_inch = (9.0, 2.6)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        asked, better = self.asked.as_dict(), self.better.as_dict()
        effects = []
        for effect in self.catalogue.values():
            first = effect.parameters[0]
            effects.append({
                "name": effect.name, "family": effect.family, "parameter": first.name, "unit": first.unit,
                "neutral": first.neutral if isfinite(first.neutral) else None, "typical": first.typical,
                "limit": asked["limits"][effect.name], "better_limit": better["limits"][effect.name],
            })  # fmt: skip
        return {
            "vessel": self.vessel, "sea_state": self.sea.name, "tolerance": self.tolerance, "effects": effects,
            "asked": asked, "better": better,
        }  # fmt: skip


def parse_programme(
    texts: Sequence[str], vessel: files.Vessel, minutes: float
) -> tuple[planning.CandidateManoeuvre, ...]:
    """The parts named by ``MANOEUVRE`` or ``MANOEUVRE=MINUTES``; the remaining ``minutes`` are divided evenly.

    Names are those of `seatrial simulate` and of the repertoire. Raises :class:`ConfigurationError`.
    """
    candidates = {candidate.name: candidate for candidate in candidate_manoeuvres(vessel)}
    parts = []
    for text in texts or (DEFAULT,):
        match = _PART.fullmatch(text)
        if match is None:
            raise ConfigurationError(f"{text!r} is not a manoeuvre", fix="write MANOEUVRE or MANOEUVRE=MINUTES")
        name, stated_minutes = match[1], float(match[2] or 0.0)
        if match[2] and stated_minutes < 1.0:
            raise ConfigurationError(f"{text!r} is too short", fix="give at least one minute")
        if name in candidates:
            parts.append(replace(candidates[name], minutes=stated_minutes))
            continue
        try:
            legs = manoeuvres.scale_to_ship(manoeuvres.manoeuvre_named(name, vessel.actuators), vessel)
        except ConfigurationError as error:
            raise ConfigurationError(
                f"no manoeuvre {name!r}", fix=f"use one of {', '.join(candidates)}, or one of `seatrial simulate`"
            ) from error
        parts.append(planning.CandidateManoeuvre(name, name.replace("_", " "), legs, stated_minutes))
    open_ = sum(part.minutes == 0.0 for part in parts)
    remaining = minutes - sum(part.minutes for part in parts)
    if open_ and remaining < open_:
        raise ConfigurationError(
            f"{minutes:g} minutes are too few for {len(parts)} manoeuvres", fix="give more with --duration"
        )
    return tuple(replace(part, minutes=remaining / open_) if part.minutes == 0.0 else part for part in parts)


def write_programme(
    path: Path,
    template: str,
    vessel: files.Vessel | str | Path | None = None,
    wind_from_deg: float | None = None,
    current_to_deg: float | None = None,
) -> TrialProgramme:
    """Write the programme of a template, at a vessel's length and test speed, in water of four draughts and more,
    with headings and order by the wind and the current that are expected. Raises :class:`ConfigurationError`,
    :class:`StorageError`."""
    ship = vessel_check.ship_for_trials(files.load_vessel(vessel))
    actuators = ship.vessel.actuators
    mains = ship_names.shafts(actuators)
    expected = {"wind_from_deg": wind_from_deg, "current_to_deg": current_to_deg}
    name = str(vessel or files.DEFAULT)  # of one of trials/vessels; another is named by the way to its file
    if isinstance(vessel, files.Vessel):
        name = vessel.name
    elif name not in vessel_names():
        name = os.path.relpath(name, path.parent)
    programme = programme_from_template(
        template, ship.length_m, vessel_check.test_speed_mps(ship.vessel, ship.rpm), name,
        [*ship_names.names_of_kind(actuators, "tunnel"), *(mains if len(mains) > 1 else ())],
        vessel_check.largest_helm_deg(ship),
        least_depth_m=round(criteria.DEEP_DRAUGHTS * ship.vessel.dimensions.draught_m, 1),
        **{key: value % 360.0 for key, value in expected.items() if value is not None},
    )  # fmt: skip
    programme.save(path)
    return programme


def candidate_manoeuvres(vessel: files.Vessel) -> tuple[planning.CandidateManoeuvre, ...]:
    """The repertoire at a vessel's usual shaft speed."""
    return planning.candidates_of_ship(planning.shafts_of(vessel, manoeuvres.usual_rpm(vessel)))


def expected_noise_in_sea(
    vessel: files.Vessel,
    sea: trial.SeaState,
    tolerance: float,
    catalogue: Catalogue,
    progress: Progress = lambda share: None,
) -> disturbance_model.DisturbanceNoise:
    """The noise that a diagnosis would estimate in such a sea, from ten simulated minutes with sensors."""
    effects = {**catalogue_of(vessel), **catalogue}  # the vessel may have one excluded from the search
    table, _ = trial.simulate_trial(vessel, sea, "zigzag", _NOISE_S, 1.0, catalogue=effects)
    model = ModelWithEffects(vessel_plant(vessel, effects), catalogue)
    return estimate_noise(
        linearise(log_of([table], vessel.dimensions.length_overall_m), model, tolerance), progress
    ).noise


def make_plan(
    programme: Sequence[planning.CandidateManoeuvre],
    vessel: files.Vessel,
    sea: trial.SeaState,
    noise: disturbance_model.DisturbanceNoise,
    tolerance: float,
    catalogue: Catalogue,
    progress: Progress = lambda share: None,
) -> Plan:
    """Evaluate a programme, and find a better one of about the same length.

    ``tolerance`` is the model error allowed, as a share of the force range. Raises :class:`ModelRangeError` if
    the programme takes the ship out of the range of its model.
    """
    ship = vessel_plant(vessel, {**catalogue_of(vessel), **catalogue})
    asked = [planning.rehearse(part.legs, vessel, ship, sea, round(60.0 * part.minutes)) for part in programme]
    logs = planning.rehearsals(candidate_manoeuvres(vessel), vessel, ship, sea)
    programme_log, *candidate_logs = (planning.as_one_leg(log) for log in (*asked, *logs.values()))
    evidence = linearise(
        planning.append_rehearsals(programme_log, candidate_logs), ModelWithEffects(ship, catalogue), tolerance
    )
    design = planning.design_of(normal_equations(evidence, noise, progress=subtask_progress(progress, 0, 2)))
    first = len(asked)
    shown = _evaluate_programme(programme, design.information(range(first)))
    # To be separated: effects known to resemble each other, and those that the programme does not separate.
    pairs = {
        (min(name, rival), max(name, rival))
        for name, effect in catalogue.items()
        for rival in effect.confused_with
        if rival in catalogue
    } | {(min(pair), max(pair)) for pair in shown.indistinguishable_pairs()}
    aims = Aims(tuple(catalogue), tuple(sorted(pairs)))
    slots = max(1, round(shown.minutes / next(iter(logs)).minutes))
    legs = compose_programme(design, range(first, first + len(logs)), slots, aims, subtask_progress(progress, 1, 2))
    parts = [list(logs)[leg - first] for leg in legs]
    return Plan(vessel.name, sea, tolerance, catalogue, shown, _evaluate_programme(parts, design.information(legs)))


def _evaluate_programme(
    parts: Sequence[planning.CandidateManoeuvre], information: planning.Information
) -> Programme:
    limits = {
        name: planning.as_parameter(information.catalogue[name], size)
        for name, size in planning.free_limits(information).items()
    }
    names = list(limits)
    evidence = np.full((len(names), len(names)), np.inf)
    for i, name in enumerate(names):
        for j in range(i):
            evidence[i, j] = evidence[j, i] = evidence_separating_pair(information, name, names[j])
    return Programme(tuple(parts), limits, evidence)
