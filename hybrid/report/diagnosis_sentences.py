"""A diagnosis in words: named effects, contradictions between sensors, the remainder, regimes, remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.acquisition.core.result import to_json
from seatrial.hybrid.diagnosis.acceptance import CREDIBLE, Acceptance, AcceptanceTests, LackOfFit
from seatrial.hybrid.diagnosis.evidence import Evidence
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.map import notable_places
from seatrial.hybrid.diagnosis.nuisance_basis import AXES, INTERACTIONS, OPERATION
from seatrial.hybrid.diagnosis.regimes import FoundRegime
from seatrial.hybrid.diagnosis.result import (
    FORCES,
    Correlation,
    Diagnosis,
    EffectDrift,
    Estimate,
    Extras,
    NamedEffect,
    RegimeEffect,
    Remainder,
    Rival,
    SensorContradiction,
    UnknownCause,
    When,
)
from seatrial.hybrid.diagnosis.select_effects import CLOSE, rivals_of
from seatrial.hybrid.diagnosis.time_varying import TimeProfile, TimeVaryingEffect, base_names
from seatrial.hybrid.diagnosis.verdict import Conclusion, estimates
from seatrial.hybrid.effects import Catalogue, Effect
from seatrial.hybrid.effects.catalogue import VERSION
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.effects.regime import Regime, parameter_of
from seatrial.hybrid.report.diagnosis_words import (
    DEPENDS,
    cell_row,
    clock,
    number,
    parameter_title,
    percent,
    when_words,
)
from seatrial.hybrid.report.effect_sentences import Parameters, sentence, words_and_interval
from seatrial.hybrid.report.words import UNITS, force_unit, join_words, plain

_ALMOST = 1.1


def describe(conclusion: Conclusion, provenance: Mapping[str, Any] | None = None) -> tuple[Diagnosis, Extras]:
    """A conclusion as the contract's diagnosis, in words where it has words, and what a report shows beside it."""
    first, accepted, gap = conclusion.first, conclusion.accepted, conclusion.gap
    equations = first.evidence.equations
    effects = tuple(each for name in accepted.names for each in _named_effects(conclusion, name))
    catalogue = equations.model.catalogue
    diagnosis = Diagnosis(
        verdict=conclusion.verdict,
        tolerance=equations.tolerance,
        effects=effects,
        rivals=_rivals(conclusion.rivals, catalogue),
        indistinguishable=tuple(dict.fromkeys(base_names(group, catalogue) for group in conclusion.tied)),
        unknown=_unknown(conclusion),
        where=notable_places(conclusion.maps[0].places),
        gap=gap.gap,
        next_manoeuvre=conclusion.next_manoeuvre,
        suspects=conclusion.suspects,
        tracks=gap.tracks,
        remarks=_remarks(conclusion, effects),
        remainder=remainder_of(conclusion),
        regimes=tuple(map(regime_in_words, conclusion.regimes)),
        provenance={**(provenance or {}), **_provenance(first)},
    )
    sensors = contradictions(conclusion.sensors) if conclusion.sensors else ()
    return diagnosis, Extras(*conclusion.maps, sensors, correlation=correlation_of(accepted))


def _rivals(rivals: Sequence[Rival], catalogue: Catalogue) -> tuple[Rival, ...]:
    """Rivals as the catalogue names them, the closest form of each."""
    found = dict[tuple[str, str], Rival]()
    for each in rivals:
        pair = catalogue[each.instead_of].base, catalogue[each.name].base
        found.setdefault(pair, Rival(*pair, each.evidence))
    return tuple(found.values())


def _named_effects(conclusion: Conclusion, name: str) -> list[NamedEffect]:
    """A named effect, once for each part of the trial in which it has a size of its own."""
    accepted, gap = conclusion.accepted, conclusion.gap
    equations = accepted.evidence.equations
    effect, test = equations.model.catalogue[name], accepted.tests[name]
    sizes, share = estimates(accepted, name), float(gap.shares.get(name, 0.0))
    others = [each for each in accepted.names if each != name]
    log_odds = accepted.evidence.log_odds(accepted.names) - accepted.evidence.log_odds(others)
    whole = NamedEffect(
        effect.base, effect.family, effect.kind, share, test.p_value, "", sizes[-1], conclusion.replicated[name],
        log_odds, effect.scope, in_vessel=effect.base != STEADY_WIND.name,
    )  # fmt: skip
    if isinstance(effect, TimeVaryingEffect):
        return in_parts(whole, effect, sizes, equations.log)
    return [replace(whole, sentence=sentence(effect, sizes[0], share, equations.log.actuators))]


def in_parts(
    whole: NamedEffect, effect: TimeVaryingEffect, sizes: Sequence[Parameters], log: Log
) -> list[NamedEffect]:
    """An effect that is not the same in all of a trial, by its parts."""

    def said(parameters: Parameters, when: str) -> str:
        what, ends = words_and_interval(effect, parameters, log.actuators)
        return f"{when}: {what[:1].lower()}{what[1:]} ({ends})"

    part = f"it explains {100.0 * whole.share_of_gap:.0f} % of the gap on legs not used to find it."
    if effect.profile.shape == "drift":
        since, until = map(_utc, effect.profile.times_s)
        drift = EffectDrift(since, until, sizes[0])
        words = f"{said(sizes[0], f'At {clock(drift.since)} UTC')}, changing linearly; "
        words += f"{said(sizes[1], f'at {clock(drift.until)} UTC')}; {part}"
        return [replace(whole, drift=drift, sentence=words)]
    found = []
    for size, when in zip(sizes, _parts_of(effect.profile, log), strict=True):
        last = part if len(sizes) == 1 else f"with its other sizes {part}"
        words = f"{said(size, when_words(when))}; {last}"
        kept = _kept(effect, when, log)
        found.append(replace(whole, parameters=size, when=when, in_vessel=kept, sentence=words))
    return found


def _parts_of(profile: TimeProfile, log: Log) -> list[When]:
    if profile.shape == "recordings":
        return [When(recording=Path(log.names[int(number)]).name) for number in profile.times_s]
    (at,) = map(_utc, profile.times_s)
    low, high = map(_utc, profile.interval_s or profile.times_s * 2)
    ends = {"until": When(until=at, low=low, high=high), "since": When(since=at, low=low, high=high)}
    return [ends[profile.shape]] if profile.shape in ends else list(ends.values())


def _kept(effect: TimeVaryingEffect, when: When, log: Log) -> bool:
    """Whether it is there at the end of the trial, and the ship's own where it differs between recordings."""
    if when.recording is None:
        return when.until is None
    latest = Path(log.names[int(log.recording[np.argmax(log.time_s)])]).name
    return effect.scope == "ship" and when.recording == latest


def _utc(time_s: float) -> str:
    return datetime.fromtimestamp(round(time_s), UTC).isoformat().replace("+00:00", "Z")


def _unknown(conclusion: Conclusion) -> UnknownCause | None:
    if conclusion.verdict != "unknown":
        return None
    accepted = conclusion.accepted
    if conclusion.withdrawn:
        names = join_words([plain(each) for each in conclusion.withdrawn])
        words = f"{names}, but predictions on held-out legs are worse with it, so it is only suspected"
        return UnknownCause(conclusion.left_open, (OPERATION,), words)
    effects = [accepted.evidence.equations.model.catalogue[name] for name in accepted.names]
    return unknown_cause(conclusion.first.lack_of_fit, effects, conclusion.left_open)


def unknown_cause(
    found: Sequence[LackOfFit], effects: Sequence[Effect], share_of_gap: float
) -> UnknownCause | None:
    """What remains, in words; or what so many named ``effects`` at once are likely to stand for."""
    if found:
        found = _told(found)
        where = tuple(dict.fromkeys(each.depends for each in found))
        return UnknownCause(share_of_gap, where, "; ".join(dict.fromkeys(looks_like(each) for each in found[:3])))
    if len(effects) <= CREDIBLE:
        return None
    families = " and ".join(dict.fromkeys(each.family for each in effects))
    several = f"{len(effects)} effects at once ({families})"
    words = f"{several}: more likely one similar effect that is not in the catalogue"
    return UnknownCause(share_of_gap, (OPERATION,), words)


def remainder_of(conclusion: Conclusion) -> Remainder | None:
    """What the named effects leave unexplained: its size, and where it is most significant; None if nothing."""
    accepted, left = conclusion.accepted, conclusion.maps[1]
    if not (accepted.beside_remainder and accepted.lack_of_fit):
        return None
    shares = np.sqrt((left.force**2).mean(axis=0)) / accepted.evidence.equations.force_range
    axis = int(np.argmax(shares))
    kind = "moment" if AXES[axis] == "yaw" else "force"
    words = f"a {AXES[axis]} {kind} of {percent(float(shares[axis]))} of its range (root mean square)"
    surest = next((each for each in notable_places(left.places) if each.channel == FORCES[axis]), None)
    if surest is not None:
        _, cell, _, size, _ = cell_row(surest)
        words += f", most significant at {cell}: {size} {_UNIT[AXES[axis]]}"
    where = tuple(dict.fromkeys(each.depends for each in accepted.lack_of_fit))
    return Remainder(float(shares[axis]), conclusion.left_open, where, words)


def _told(found: Sequence[LackOfFit]) -> list[LackOfFit]:
    """Without weaker signs that an effect has another form than it is named for."""
    first = {each.what: each for each in reversed(found) if each.depends in INTERACTIONS}
    return [each for each in found if each.depends not in INTERACTIONS or each is first[each.what]]


_UNIT = {"surge": "N", "sway": "N", "yaw": "N m"}


def looks_like(remainder: LackOfFit) -> str:
    """One family in words: its axis or effect, on what it depends, and its size."""
    if remainder.what == "force":
        return (
            f"forces of speeds and thrusters that are wrong by some {100.0 * remainder.size:.2g} % of their range"
        )
    if remainder.what in AXES:
        kind = "moment" if remainder.what == "yaw" else "force"
        size = f"{remainder.size:.2g} {_UNIT[remainder.what]}"
        return f"a {remainder.what} {kind} of some {size} that varies with {DEPENDS[remainder.depends]}"
    varies = f"{plain(remainder.what.split(',')[0])} that varies with {DEPENDS[remainder.depends]}"
    other = ": more likely a similar effect that is not in the catalogue"
    return varies + other if remainder.depends in INTERACTIONS else varies


def correlation_of(accepted: Acceptance) -> Correlation:
    """How the estimates of what was named are correlated, in its free coordinates."""
    fit = accepted.evidence.fit(accepted.names)
    deviation = np.sqrt(np.diag(fit.covariance))
    titles, order = list[str](), list[int]()
    for name in accepted.names:
        places, base = accepted.evidence.places(fit, name), accepted.evidence.equations.model.catalogue[name].base
        titles += [
            f"{plain(base)}, {number}" if len(places) > 1 else plain(base) for number, _ in enumerate(places, 1)
        ]
        order += places
    matrix = fit.covariance / np.outer(deviation, deviation)
    return Correlation(tuple(titles), np.asarray(matrix[np.ix_(order, order)]))


def contradictions(sensors: Acceptance) -> tuple[SensorContradiction, ...]:
    """Each contradiction in words, the most significant first."""
    results = [_contradiction(sensors.evidence, sensors.names, test) for test in sensors.tests.values()]
    return tuple(sorted(results, key=lambda each: each.p_value))


def _contradiction(evidence: Evidence, names: tuple[str, ...], test: AcceptanceTests) -> SensorContradiction:
    model = evidence.equations.model
    effect = model.catalogue[test.name]
    fit = evidence.fit(names)
    places = evidence.places(fit, test.name)
    free = tuple(float(fit.values[place]) for place in places)
    errors = tuple(float(np.sqrt(fit.covariance[place, place])) for place in places)
    rivals = sorted((less, rival) for rival, less in rivals_of(evidence, names, test.name).items() if less < CLOSE)
    alike = base_names((rival for _, rival in rivals), model.catalogue)
    words = "; then ".join(
        ", ".join(
            f"{parameter_title(each.name, each.unit)} {number(values[each.name])} ± {number(1.96 * error)} "
            f"{'' if each.unit == '1' else each.unit}".rstrip()
            for each, error in zip(effect.parameters, some, strict=True)
        )
        for values, some in zip(model.piecewise(test.name, free), effect.pieces(errors), strict=True)
    )
    sentence = f"The sensors contradict each other; a possible cause is {plain(effect.base)}: {words}"
    if alike:
        others = join_words([plain(each) for each in alike], "or")
        sentence += f"; without a ship model {others} cannot be ruled out"
    return SensorContradiction(effect.base, free, errors, test.p_value, alike, sentence + ".")


def _no_wind(catalogue: Catalogue) -> str:
    """The remark on a trial in which the wind is nil: it was not recorded, or a calm was."""
    if STEADY_WIND.name in catalogue:
        return "no wind was recorded: only a steady wind was considered"
    return "the wind is nil throughout: its effects were tested in a calm, and a steady wind was not considered"


def _remarks(conclusion: Conclusion, effects: Sequence[NamedEffect]) -> tuple[str, ...]:
    equations = conclusion.first.evidence.equations
    log, vessel, gap = equations.log, equations.model.vessel, conclusion.gap
    remarks = []
    if not log.wind[:, 1].any():
        remarks.append(_no_wind(equations.model.catalogue))
    remarks += _about_settings(log)
    if log.refused:
        remarks.append(f"{log.refused} outliers were rejected")
    for group in {base_names(group, equations.model.catalogue): None for group in conclusion.composites}:
        family = next(each.family for each in effects if each.name in group)
        remarks.append(
            f"{join_words([plain(name) for name in group])} are of one family ({family}) and may together be one "
            "effect that is not in the catalogue"
        )
    remarks += [_made_by(name, pair) for name, *pair in conclusion.accepted.substitute_pairs]
    if effects and gap.gap.closed < 0.0:
        remarks.append(
            "predictions are no better with the named effects: other errors of the model are larger and mask them"
        )
    alone = min((each.after_m for each in conclusion.regimes[:1]), default=np.inf)
    if len(effects) > 1 and alone < _ALMOST * gap.gap.after_m:
        remarks.append(
            "a force in one regime alone improves predictions almost as much as all named effects: together these "
            "may only imitate one effect that is not in the catalogue"
        )
    for each in effects:
        if vessel is not None and each.name in vessel.effects and each.in_vessel:
            remarks.append(f"{each.name} is already in the vessel file: the value here replaces the one there")
    return tuple(remarks)


def _made_by(name: str, pair: Sequence[str]) -> str:
    """That two effects may stand for one that is named.

    >>> _made_by("skeg", ("drift_moment", "yaw_damping"))
    'drift moment and yaw damping together would do what skeg does, and predict as well in its place'
    """
    both = join_words([plain(each) for each in pair])
    return f"{both} together would do what {plain(name)} does, and predict as well in its place"


def _about_settings(log: Log) -> list[str]:
    """How thruster settings were read between their records, where that is not as usual."""
    if log.input_hold == "line":
        seldom = f"thruster settings were recorded every {log.setting_step_s:g} s: shorter lags cannot be found"
        return [seldom] if log.setting_step_s > 0.5 else []
    held = f"thruster settings are taken as held {log.input_hold}: this fits the motion better than interpolation"
    late = "; or they are held until the next record, and act later by one interval"
    return [held + late if log.input_hold == "since the last record" else held]


def _provenance(first: Acceptance) -> dict[str, Any]:
    """What every verdict states: the catalogue, the force range of which the tolerance is a share, the noise."""
    extent = first.evidence.equations.force_range.tolist()
    return {
        "catalogue_version": VERSION,
        "effects_in_catalogue": len(base_names(first.evidence.names, first.evidence.equations.model.catalogue)),
        "force_range": dict(zip(("surge_n", "sway_n", "yaw_nm"), extent, strict=True)),
        "noise": to_json(first.evidence.equations.noise),
    }


_WHAT = {
    "speed_mps": "the speed",
    "surge_mps": "surge",
    "sway_mps": "sway",
    "yaw_rate_dps": "the yaw rate",
    "drift_angle_deg": "the drift angle",
    "wind_mps": "the wind",
    "relative_wind_deg": "the direction of the wind off the bow",
    "rpm": "the mean shaft speed",
    "azimuth_deg": "the mean azimuth",
    "rudder_deg": "the mean rudder angle",
    "nozzle_deg": "the mean nozzle angle",
}
_WAYS = {"surge": ("ahead", "astern"), "sway": ("to starboard", "to port"), "yaw": ("to starboard", "to port")}


def regime_in_words(found: FoundRegime) -> RegimeEffect:
    """A regime that was found as the contract has it."""
    regime = found.regime
    name, unit = parameter_of(regime)
    reach = 1.96 * abs(found.error)
    return RegimeEffect(
        found.name,
        regime_sentence(found),
        regime.axis,
        {each: (_end(low), _end(high)) for each, (low, high) in regime.within.items()},
        regime.grows_with,
        regime.at,
        {name: Estimate(found.value, found.value - reach, found.value + reach, unit)},
        found.share,
        found.replicated,
        found.after_m,
    )


def _end(value: float) -> float | None:
    return value if isfinite(value) else None


def regime_sentence(found: FoundRegime) -> str:
    """Force, regime, and what it brings, in one sentence."""
    regime, (size_n, unit) = found.regime, force_unit(abs(found.value))
    unit, what = (f"{unit} m", "moment") if regime.axis == "yaw" else (unit, "force")
    way = _WAYS[regime.axis][found.value < 0.0]
    spans = [f"{_quantity(name)} is {_between(name, *span)}" for name, span in regime.within.items()]
    where = f" while {join_words(spans)}" if spans else ""
    return (
        f"The model lacks {number(abs(found.value) / size_n)} {unit} {way}{where}{_growth(regime)}: "
        f"{percent(found.share)} of the missing {regime.axis} {what}; "
        f"with it the error on held-out legs is {found.after_m:.2f} m."
    )


def _growth(regime: Regime) -> str:
    if regime.grows_with is None:
        return ""
    of, unit = _quantity(regime.grows_with), _unit(regime.grows_with)
    return f", proportional to the square of {of} (the figure is for {number(regime.at)} {unit})"


def _between(name: str, low: float, high: float) -> str:
    unit = _unit(name)
    if not isfinite(low):
        return f"below {number(high)} {unit}"
    return f"above {number(low)} {unit}" if not isfinite(high) else f"{number(low)} to {number(high)} {unit}"


def _quantity(name: str) -> str:
    return _WHAT.get(name) or f"the shaft speed of the {plain(name.removesuffix('_rpm'))} thruster"


def _unit(name: str) -> str:
    return UNITS[name.rsplit("_", 1)[-1]]
