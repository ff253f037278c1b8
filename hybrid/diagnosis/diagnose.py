"""The whole of a diagnosis: find where model and trial disagree, name what is missing, show the gap shrink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.errors import ConfigurationError
from acquisition.core.progress import Progress
from hybrid.diagnosis.acceptance import LackOfFit, composite_effects, lack_of_fit
from hybrid.diagnosis.estimate_noise import settled
from hybrid.diagnosis.evidence import Evidence, NormalEquations, evidence_of, normal_equations
from hybrid.diagnosis.gap import HeldOut, gap_on_unseen_legs, with_noise_floor
from hybrid.diagnosis.input_hold import read_as_fits
from hybrid.diagnosis.linearise import model_of
from hybrid.diagnosis.log import Log, log_of
from hybrid.diagnosis.map import Map, map_of, notable
from hybrid.diagnosis.noise import Noise
from hybrid.diagnosis.nuisance_basis import INTERACTIONS
from hybrid.diagnosis.result import Diagnosis, Manoeuvre, NamedEffect, Rival, Suspect
from hybrid.diagnosis.select_effects import Naming, fitted_coordinates, named
from hybrid.diagnosis.sensor_consistency import contradictory_sensors, stated
from hybrid.diagnosis.sentences import sentence
from hybrid.diagnosis.verdict import WEAK, close_rivals, correlation_of, estimates, groups, unexplained, verdict_of
from hybrid.effects import CATALOGUE, Catalogue
from hybrid.effects.catalogue import VERSION
from hybrid.planning.information import limits
from hybrid.planning.next_manoeuvre import Pair, next_manoeuvre
from hybrid.report.diagnosis_page import Extras
from hybrid.report.words import listed, plain
from hybrid.vessel.parameters import Vessel

TOLERANCE = 0.01
"""The share of the force range that a reference model is granted to be off by, unless told otherwise."""

_RIVALS = 10  # of one effect, the closest, that a manoeuvre is chosen to separate
_UNEVEN = 0.15  # of its own size: no current is quite even
_OWN_FORM = 0.03  # of its own size: by more than that, what is named has another form than it is named for
_NEGLIGIBLE = 0.01  # of what the named effects explain: an effect's own form is not exact either


@dataclass(frozen=True, slots=True)
class Examined:
    """A diagnosis, what it was made from, and what its page shows beside it."""

    diagnosis: Diagnosis
    naming: Naming
    gap: HeldOut
    extras: Extras


def diagnose(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel,
    tolerance: float = TOLERANCE,
    catalogue: Catalogue = CATALOGUE,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda share: None,
) -> Examined:
    """Diagnose raw tables of the 13 channels against the model of ``vessel``.

    ``tolerance`` is the share of the force range that the model is granted. Raises :class:`ConfigurationError` for
    an impossible tolerance, :class:`DataShortageError` and :class:`InputError` for tables without what it takes.
    """
    if not 0.0 < tolerance < 1.0:
        raise ConfigurationError(
            f"a tolerance of {100.0 * tolerance:g} % is impossible", fix="give more than 0 and less than 100"
        )
    with threadpool_limits(1, user_api="blas"):  # the filter has its own threads, and more only wait for each other
        return _diagnosed(tables, vessel, tolerance, catalogue, provenance, progress)


def _diagnosed(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel,
    tolerance: float,
    catalogue: Catalogue,
    provenance: Mapping[str, Any] | None,
    progress: Progress,
) -> Examined:
    model = model_of(vessel, catalogue)
    log = log_of(tables)
    progress(0.1)
    log, noise = settled(log, model, tolerance, _part(progress, 0.1, 0.3))
    read = read_as_fits(log, tables, model, tolerance, noise)
    if read is not log:
        log, noise = settled(read, model, tolerance, _part(progress, 0.3, 0.35))
    sensors = contradictory_sensors(log, model, noise)
    progress(0.4)
    first = _in_form(named(log, model, tolerance, noise, progress=_part(progress, 0.4, 0.6)))
    found = _standing_out(first)
    naming = _beside_the_unknown(first, sensors) if found else first
    progress(0.7)
    gap = _gap(naming, log, found)
    if found:
        gap = with_noise_floor(gap, first.evidence.equations)
    rivals = close_rivals(naming)
    unknown = unexplained(found, [catalogue[name] for name in naming.names], _left_open(gap))
    one = composite_effects(naming.evidence, naming.names) if unknown is None else []
    tied = [*groups(naming.names, rivals), *one] if unknown is None else []
    progress(0.8)
    maps = map_of(first.evidence.equations), map_of(_last_look(naming, first), repaired=True)
    effects = tuple(_named_effect(naming, name, gap) for name in naming.names)
    progress(0.85)
    diagnosis = Diagnosis(
        verdict=verdict_of(naming.names, tied, unknown),
        tolerance=tolerance,
        effects=effects,
        rivals=tuple(rivals),
        indistinguishable=tuple(tied),
        unknown=unknown,
        where=notable(maps[0].places),
        gap=gap.gap,
        next_manoeuvre=None if found else _next_manoeuvre(naming, vessel, rivals, _part(progress, 0.85, 1.0)),
        suspects=suspects(first.evidence),
        tracks=gap.tracks,
        remarks=_remarks(log, vessel, effects, one, gap),
        provenance={**(provenance or {}), **_tolerated_size(first, noise)},
    )
    return Examined(diagnosis, naming, gap, _extras(naming, maps, sensors))


def _extras(naming: Naming, maps: tuple[Map, Map], sensors: Naming | None) -> Extras:
    return Extras(*maps, stated(sensors) if sensors else (), correlation=correlation_of(naming))


def _part(progress: Progress, first: float, last: float) -> Progress:
    return lambda share: progress(first + (last - first) * share)


def _in_form(naming: Naming) -> Naming:
    """The same with a view in which each named effect may have another form: as a relative of it has."""
    if not naming.names:
        return naming
    last = naming.evidence.equations
    again = normal_equations(
        last.log, last.model, last.tolerance, last.noise, interactions=naming.names, known_effects=last.effects
    )
    return replace(naming, evidence=evidence_of(again, by_leg=True))


def _beside_the_unknown(naming: Naming, sensors: Naming | None) -> Naming:
    """What stays named beside what no effect explains.

    What is unknown may look like any force, and a force that is named beside it may be its imitation. Only what the
    ``sensors`` show against each other needs no model of the ship.
    """
    return sensors or replace(naming, names=(), tests={})


def _last_look(naming: Naming, first: Naming) -> NormalEquations:
    """The log through the whole model with what is named in it."""
    last = first.evidence.equations
    if naming is first:
        return last
    model = replace(last.model, at=fitted_coordinates(naming.evidence, naming.names))
    return normal_equations(last.log, model, last.tolerance, last.noise)


def _gap(naming: Naming, log: Log, found: Sequence[LackOfFit]) -> HeldOut:
    """The gap on legs left out.

    Other legs name what they ask for; but only of what is named in the end, where that is nothing or not all.
    """
    others = frozenset(naming.evidence.names) - set(naming.names)
    barred = others if found or not naming.names else frozenset[str]()
    return gap_on_unseen_legs(
        log, naming.evidence, naming.names, fitted_coordinates(naming.evidence, naming.names), barred
    )


def _left_open(gap: HeldOut) -> float:
    """The share of the gap that stays open."""
    return min(1.0, max(0.0, 1.0 - gap.gap.closed))


def _next_manoeuvre(
    naming: Naming, vessel: Vessel, rivals: Sequence[Rival], progress: Progress
) -> Manoeuvre | None:
    """What to do next where a rival is close; where it is not, but not far either, too."""
    pairs = [pair for name in naming.names for pair in _pairs(naming, name, rivals)]
    if not pairs:
        return None
    values = {name: each for name, each in naming.evidence.values(naming.names).items() if each is not None}
    return next_manoeuvre(naming.evidence.equations, vessel, values, pairs, progress)


def _pairs(naming: Naming, name: str, rivals: Sequence[Rival]) -> list[Pair]:
    """A named effect and its closest rivals, each against each: whichever is true, by how likely it is."""
    others = tuple(each for each in naming.names if each != name)
    close = {each.name: each.evidence for each in rivals if each.instead_of == name and each.evidence < WEAK}
    group = {name: 0.0, **dict(list(close.items())[:_RIVALS])}
    found = {each: naming.evidence.values((*others, each))[each] for each in group}
    return [
        Pair(one, rival, values, others, exp(-group[one]))
        for one, values in found.items()
        for rival in group
        if rival != one and values is not None
    ]


def _standing_out(naming: Naming) -> list[LackOfFit]:
    """What remains beside the named effects and is no mere trace of their own form."""
    evidence, fit = naming.evidence, naming.evidence.fit(naming.names)

    def matters(each: LackOfFit) -> bool:
        if each.what in naming.names:  # a named effect that is uneven: by how much of itself
            whole = np.take(fit.values, evidence.places(fit, each.what))
            least = _OWN_FORM if each.depends in INTERACTIONS else _UNEVEN
            return each.size > least * float(np.linalg.norm(whole))
        return each.gain > _NEGLIGIBLE * fit.gain

    return [each for each in lack_of_fit(evidence, naming.names) if each.found and matters(each)]


def _named_effect(naming: Naming, name: str, gap: HeldOut) -> NamedEffect:
    effect, test = naming.evidence.equations.model.catalogue[name], naming.tests[name]
    parameters = estimates(naming, name)
    share = float(gap.shares.get(name, 0.0))
    evidence = naming.evidence.log_odds(naming.names) - naming.evidence.log_odds(
        [n for n in naming.names if n != name]
    )
    return NamedEffect(
        name, effect.family, effect.kind, parameters, share, test.p_value, evidence,
        sentence(effect, parameters, share),
    )  # fmt: skip


def suspects(evidence: Evidence) -> tuple[Suspect, ...]:
    """Every effect of the catalogue by how much better the model is with it alone."""
    smallest, result = limits(evidence.equations), []
    for name in evidence.names:
        effect = evidence.equations.model.catalogue[name]
        fit = evidence.fit([name], prior=True)  # of some these data say nothing at all
        chance, unit = evidence.chance(fit.gain, len(fit.columns)), effect.parameters[0].unit
        result.append(Suspect(name, effect.family, evidence.log_odds([name]), chance, smallest[name], unit))
    return tuple(sorted(result, key=lambda each: -each.evidence))


def _remarks(
    log: Log, vessel: Vessel, effects: Sequence[NamedEffect], one: Sequence[tuple[str, ...]], gap: HeldOut
) -> tuple[str, ...]:
    remarks = []
    if not log.wind[:, 1].any():
        remarks.append("no wind was recorded: what the wind does cannot be told from other causes")
    remarks += _about_settings(log)
    if log.refused:
        remarks.append(f"{log.refused} samples lay off by themselves and were refused")
    for group in one:
        family = next(each.family for each in effects if each.name in group)
        remarks.append(
            f"{listed([plain(name) for name in group])} are of one family, {family}: together they may be one "
            "effect that is not in the catalogue"
        )
    if effects and gap.gap.closed < 0.0:
        remarks.append(
            "predictions are no better with what was named: what the model lacks besides is larger, and hides it"
        )
    for each in effects:
        if each.name in vessel.effects:
            remarks.append(
                f"{each.name} stands in the vessel's file already: its value here takes that one's place"
            )
    return tuple(remarks)


def _about_settings(log: Log) -> list[str]:
    """How thruster settings were read between their records, where that is not as usual."""
    if log.input_hold == "line":
        seldom = f"thruster settings were recorded every {log.setting_step_s:g} s: lags below that are not seen"
        return [seldom] if log.setting_step_s > 0.5 else []
    held = f"thruster settings are read as held {log.input_hold}: with lines between them the motion is less likely"
    late = "; or they are held until the next, and act that much later"
    return [held + late if log.input_hold == "since the last record" else held]


def _tolerated_size(naming: Naming, noise: Noise) -> dict[str, Any]:
    """What every verdict states: the catalogue, the force range of which the tolerance is a share, the noise."""
    extent = naming.evidence.equations.range
    return {
        "catalogue_version": VERSION,
        "effects_in_catalogue": len(naming.evidence.names),
        "force_range": {"surge_n": extent.surge_n, "sway_n": extent.sway_n, "yaw_nm": extent.yaw_nm},
        "noise": noise.as_dict(),
    }


__all__ = ["TOLERANCE", "Examined", "diagnose", "suspects"]
