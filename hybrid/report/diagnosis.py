"""A diagnosis in words: named effects, contradictions between sensors, the remainder, regimes, remarks.

``templates/diagnosis.html`` makes the page of these sentences and rows; a terminal shows :func:`summary_text`.
Effects of the ship and its sensors have texts of their own; those of actuators have one for each kind of
effect, with the actuator's name and noun in it: one actuator, a pair, or all of a kind.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import inf, isfinite, pi
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from rich.console import Group
from rich.text import Text

from seatrial.acquisition.core.errors import join_words
from seatrial.acquisition.core.result import to_json
from seatrial.acquisition.core.ship import DEFAULT, KINDS, Actuators
from seatrial.analysis.report import pages, tables
from seatrial.hybrid.diagnosis import acceptance, linearise, regression, result, verdict, witnesses
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.map import FoundRegime, notable_places
from seatrial.hybrid.effects import VERSION, Catalogue, Effect, context, environment, parameter_of
from seatrial.hybrid.prediction.baselines import Interval
from seatrial.hybrid.report.text import (
    UNITS,
    context_sentence,
    force_unit,
    index_table_of_diagnosis,
    plain,
    plain_number,
    quantity_title,
    templates,
)
from seatrial.hybrid.vessel.actuators import effects_by_kind
from seatrial.hybrid.vessel.black_box import BlackBox

_LATE_S = 0.02  # less than a third of 0.07 s, to which ten minutes of the tests' ship determine a delay
_ALMOST = 1.1
_UNIT = {"surge": "N", "sway": "N", "yaw": "N m"}
_QUANTITY_WORDS = {
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
_SMALL = 0.001
_NIL = 0.005  # of the gap: less is 0 % in whole percent
_NOTABLE = 0.1  # of itself: as many percent as a regression leaves in doubt of the best known numbers

DEPENDS = {
    "heading": "the heading",
    "place": "the place",
    "time": "time",
    "azimuth": "large angles of helm",
    "operating point": "the operating point (speed and thruster settings)",
    "speed": "the speed",
    "drift": "the speed sideways",
    "turning": "the yaw rate",
    "thrust": "the thrust ahead",
    "side thrust": "the thrust sideways",
}
"""What something unknown may depend on."""

ONE_OF_THEM = "one effect of their family that is not in the catalogue"
"""What the effects of a group that are named together may really be."""

_MODEL = "model: "
REGIMES_NOTE = (
    "A force in a regime is an observation, not an explanation. regimes.py has each regime as an effect: with "
    "--effects regimes.py the next diagnosis weighs it against all other effects."
)
PAGE_FILE = "report.html"
_VERDICTS = {
    "named": "The model lacks these effects:",
    "nothing_missing": "Nothing is missing beyond the tolerance.",
    "unknown": "Something is missing that no effect of the catalogue explains.",
    "indistinguishable": "Something is missing, but these data cannot distinguish several possible causes.",
}
Parameters = Mapping[str, result.Estimate]


def describe(
    conclusion: verdict.Conclusion, provenance: Mapping[str, Any] | None = None
) -> tuple[result.Diagnosis, result.Extras]:
    """A conclusion as the contract's diagnosis, with its sentences, and what else a report shows."""
    first, accepted, gap = conclusion.first, conclusion.accepted, conclusion.gap
    equations = first.evidence.equations
    catalogue, effects = equations.model.catalogue, _named_effects(conclusion)
    closest = dict[tuple[str, str], result.Rival]()  # the closest form of each, as the catalogue names it
    for rival in conclusion.rivals:
        pair = catalogue[rival.instead_of].base, catalogue[rival.name].base
        closest.setdefault(pair, result.Rival(*pair, rival.evidence))
    basis = {  # what every verdict states
        "catalogue_version": VERSION,
        "effects_in_catalogue": len(linearise.base_names(first.evidence.effect_names, catalogue)),
        "force_range": dict(zip(("surge_n", "sway_n", "yaw_nm"), equations.force_range.tolist(), strict=True)),
        "noise": to_json(equations.noise),
    }
    diagnosis = result.Diagnosis(
        verdict=conclusion.verdict,
        tolerance=equations.tolerance,
        effects=effects,
        rivals=tuple(closest.values()),
        indistinguishable=tuple(dict.fromkeys(linearise.base_names(group, catalogue) for group in conclusion.tied)),
        unknown=_unknown_cause(conclusion),
        where=notable_places(conclusion.maps[0].places),
        gap=gap.gap,
        next_manoeuvre=conclusion.next_manoeuvre,
        ranking=conclusion.ranking,
        suspects=conclusion.suspects,
        tracks=gap.tracks,
        remarks=_remarks(conclusion, effects),
        remainder=remainder_of(conclusion),
        regimes=tuple(map(regime_in_words, conclusion.regimes)),
        provenance={**(provenance or {}), **basis},
    )
    sensors = contradictions(conclusion.sensors) if conclusion.sensors else ()
    return diagnosis, result.Extras(*conclusion.maps, sensors, correlation=correlation_of(accepted))


def _named_effects(conclusion: verdict.Conclusion) -> tuple[result.NamedEffect, ...]:
    """What was accepted, each effect once for each part of the trial in which it has a size of its own."""
    accepted, evidence, effects = conclusion.accepted, conclusion.accepted.evidence, list[result.NamedEffect]()
    log, log_odds = evidence.equations.log, evidence.log_odds(accepted.names)
    # so many at once are more likely one effect that is not in the catalogue: a vessel file has only what is named
    is_imitation = conclusion.verdict == "unknown" and not conclusion.first.lack_of_fit
    for name in accepted.names:
        effect, sizes = evidence.equations.model.catalogue[name], verdict.estimates_of_effect(accepted, name)
        share = float(conclusion.gap.shares.get(name, 0.0))
        remaining = [candidate for candidate in accepted.names if candidate != name]
        overall = result.NamedEffect(
            effect.base, effect.family, effect.kind, share, accepted.tests[name].p_value, "", sizes[-1],
            conclusion.replicated[name], log_odds - evidence.log_odds(remaining), effect.scope,
            in_vessel=effect.base != environment.STEADY_WIND.name and not is_imitation,
        )  # fmt: skip
        if isinstance(effect, linearise.TimeVaryingEffect):
            effects += effects_by_part(overall, effect, sizes, log)
        else:
            effects.append(replace(overall, sentence=sentence(effect, sizes[0], share, log.actuators)))
    return tuple(effects)


def effects_by_part(
    overall: result.NamedEffect, effect: linearise.TimeVaryingEffect, sizes: Sequence[Parameters], log: Log
) -> list[result.NamedEffect]:
    """An effect that is not the same in all of a trial, by its parts."""

    def size_words(parameters: Parameters, when: str) -> str:
        text, ends = words_and_interval(effect, parameters, log.actuators)
        return f"{when}: {text[:1].lower()}{text[1:]} ({ends})"

    part = share_words(overall.share_of_gap)
    profile = effect.profile
    if profile.shape == "drift":
        since, until = map(_utc_text, profile.times_s)
        drift = result.EffectDrift(since, until, sizes[0])
        words = f"{size_words(sizes[0], f'At {clock(drift.since)} UTC')}, changing linearly; "
        words += f"{size_words(sizes[1], f'at {clock(drift.until)} UTC')}; {part}"
        return [replace(overall, drift=drift, sentence=words)]

    if profile.shape == "recordings":
        parts = [result.When(recording=Path(log.names[int(number)]).name) for number in profile.times_s]
    else:
        (at,) = map(_utc_text, profile.times_s)
        low, high = map(_utc_text, profile.interval_s or profile.times_s * 2)
        ends = {
            "until": result.When(until=at, low=low, high=high),
            "since": result.When(since=at, low=low, high=high),
        }
        parts = [ends[profile.shape]] if profile.shape in ends else list(ends.values())
    named_parts = []
    for size, when in zip(sizes, parts, strict=True):
        last = part if len(sizes) == 1 else f"with its other sizes {part}"
        words = f"{size_words(size, when_words(when))}; {last}"
        if when.recording is None:
            in_vessel = when.until is None and overall.in_vessel
        else:  # the ship's own in the latest recording
            latest = Path(log.names[int(log.recording[np.argmax(log.time_s)])]).name
            in_vessel = effect.scope == "ship" and when.recording == latest and overall.in_vessel
        named_parts.append(replace(overall, parameters=size, when=when, in_vessel=in_vessel, sentence=words))
    return named_parts


def _utc_text(time_s: float) -> str:
    return datetime.fromtimestamp(round(time_s), UTC).isoformat().replace("+00:00", "Z")


def _unknown_cause(conclusion: verdict.Conclusion) -> result.UnknownCause | None:
    if conclusion.verdict != "unknown":
        return None
    accepted = conclusion.accepted
    if conclusion.withdrawn:
        names = join_words([plain(name) for name in conclusion.withdrawn])
        words = f"{names}, but predictions on held-out legs are worse with it, so it is only suspected"
        return result.UnknownCause(conclusion.left_open, (regression.OPERATION,), words)
    effects = [accepted.evidence.equations.model.catalogue[name] for name in accepted.names]
    cause = unknown_cause(conclusion.first.lack_of_fit, effects, conclusion.left_open)
    if cause is None:
        ratio = conclusion.gap.least_m / conclusion.gap.gap.floor_m
        words = f"predictions miss by {ratio:.2g} times what noise alone would make, in no form that was tested for"
        return result.UnknownCause(conclusion.left_open, (regression.OPERATION,), words)
    return cause


def unknown_cause(
    lacks: Sequence[acceptance.LackOfFit], effects: Sequence[Effect], share_of_gap: float
) -> result.UnknownCause | None:
    """What remains, in words; or what so many named ``effects`` at once are likely to stand for."""
    if not lacks:
        if len(effects) <= acceptance.CREDIBLE:
            return None
        families = " and ".join(dict.fromkeys(effect.family for effect in effects))
        several = f"{len(effects)} effects at once ({families})"
        words = f"{several}: more likely one similar effect that is not in the catalogue"
        return result.UnknownCause(share_of_gap, (regression.OPERATION,), words)

    # without weaker signs that an effect has another form than it is named for
    first = {lack.what: lack for lack in reversed(lacks) if lack.depends in regression.INTERACTIONS}
    lacks = [lack for lack in lacks if lack.depends not in regression.INTERACTIONS or lack is first[lack.what]]
    parts = []
    for lack in lacks[:3]:
        varies = f"that varies with {DEPENDS[lack.depends]}" if lack.what != "force" else ""
        if not varies:
            share = f"{100.0 * lack.size:.2g} % of their range"
            parts.append(f"forces of speeds and thrusters that are wrong by some {share}")
        elif lack.what in regression.AXES:
            kind = "moment" if lack.what == "yaw" else "force"
            parts.append(f"a {lack.what} {kind} of some {plain_number(lack.size, 2)} {_UNIT[lack.what]} {varies}")
        else:
            is_unlike = lack.depends in regression.INTERACTIONS
            explanation = ": more likely a similar effect that is not in the catalogue" if is_unlike else ""
            parts.append(f"{plain(lack.what.split(',')[0])} {varies}{explanation}")
    where = tuple(dict.fromkeys(lack.depends for lack in lacks))
    return result.UnknownCause(share_of_gap, where, "; ".join(dict.fromkeys(parts)))


def remainder_of(conclusion: verdict.Conclusion) -> result.Remainder | None:
    """What the named effects leave unexplained: its size, and where it is most significant; None if nothing."""
    accepted, remaining = conclusion.accepted, conclusion.maps[1]
    if not (accepted.beside_remainder and accepted.lack_of_fit):
        return None
    shares = np.sqrt((remaining.force**2).mean(axis=0)) / accepted.evidence.equations.force_range
    axis = int(np.argmax(shares))
    kind = "moment" if regression.AXES[axis] == "yaw" else "force"
    words = f"a {regression.AXES[axis]} {kind} of {percent(float(shares[axis]))} of its range (root mean square)"
    surest = next(
        (place for place in notable_places(remaining.places) if place.channel == result.FORCES[axis]), None
    )
    if surest is not None:
        _, cell, _, size, _ = cell_row(surest)
        words += f", most significant at {cell}: {size} {_UNIT[regression.AXES[axis]]}"
    where = tuple(dict.fromkeys(lack.depends for lack in accepted.lack_of_fit))
    return result.Remainder(float(shares[axis]), conclusion.left_open, where, words)


def correlation_of(accepted: acceptance.Acceptance) -> result.Correlation:
    """The correlation of the estimates of the named effects, in their free coordinates."""
    owners, matrix = accepted.correlation()
    catalogue, titles = accepted.evidence.equations.model.catalogue, list[str]()
    for name in dict.fromkeys(owners):
        count, title = owners.count(name), plain(catalogue[name].base)
        titles += [f"{title}, {number}" for number in range(1, count + 1)] if count > 1 else [title]
    return result.Correlation(tuple(titles), matrix)


def contradictions(sensors: acceptance.Acceptance) -> tuple[result.SensorContradiction, ...]:
    """Each contradiction in words, the most significant first."""
    evidence, model = sensors.evidence, sensors.evidence.equations.model
    fit, results = evidence.fit(sensors.names), []
    for test in sensors.tests.values():
        effect, places = model.catalogue[test.name], evidence.rows_in_fit(fit, test.name)
        free = tuple(float(fit.values[place]) for place in places)
        errors = tuple(float(np.sqrt(fit.covariance[place, place])) for place in places)
        deficits = acceptance.rivals_of(evidence, sensors.names, test.name)
        rivals = sorted((deficit, rival) for rival, deficit in deficits.items() if deficit < acceptance.CLOSE)
        alike = linearise.base_names((rival for _, rival in rivals), model.catalogue)
        words = "; then ".join(
            ", ".join(
                f"{parameter_title(size.name, size.unit)} {number(values[size.name])} ± {number(1.96 * error)} "
                f"{'' if size.unit == '1' else size.unit}".rstrip()
                for size, error in zip(effect.parameters, piece_errors, strict=True)
            )
            for values, piece_errors in zip(
                model.values_by_piece(test.name, free), effect.coordinates_by_piece(errors), strict=True
            )
        )
        text = f"The sensors contradict each other; a possible cause is {plain(effect.base)}: {words}"
        if alike:
            alike_names = join_words([plain(name) for name in alike], "or")
            text += f"; without a ship model {alike_names} cannot be ruled out"
        results.append(result.SensorContradiction(effect.base, free, errors, test.p_value, alike, text + "."))
    return tuple(sorted(results, key=lambda contradiction: contradiction.p_value))


def integration_remarks(moves_s: float, turns_s: float) -> list[str]:
    """The remark on a simulator whose own integration is late by so much, as :func:`.integration_delays_s`."""
    if max(abs(moves_s), abs(turns_s)) < _LATE_S:
        return []
    return [
        f"the simulator moves {moves_s:.3f} s and turns {turns_s:.3f} s later than its own speeds and yaw rate "
        "say, by Euler's method half a step: delays of such a size are its own; give it shorter steps (step_s)"
    ]


def remark_on_calm(catalogue: Catalogue) -> str:
    """The remark on a trial in which the wind is nil: it was not recorded, or a calm was."""
    if environment.STEADY_WIND.name in catalogue:
        return "no wind was recorded: only a steady wind was considered"
    return "the wind is nil throughout: its effects were tested in a calm, and a steady wind was not considered"


def _remarks(conclusion: verdict.Conclusion, effects: Sequence[result.NamedEffect]) -> tuple[str, ...]:
    equations = conclusion.first.evidence.equations
    log, vessel, gap = equations.log, equations.model.vessel, conclusion.gap
    remarks = []
    if not log.wind[:, 1].any():
        remarks.append(remark_on_calm(equations.model.catalogue))
    if log.input_hold != "line":
        setting = (
            f"thruster settings are taken as held {log.input_hold}: this fits the motion better than interpolation"
        )
        alternative = "; or they are held until the next record, and act later by one interval"
        remarks.append(setting + alternative * (log.input_hold == "since the last record"))
    elif log.setting_step_s > 0.5:
        remarks.append(
            f"thruster settings were recorded every {log.setting_step_s:g} s: shorter lags cannot be found"
        )
    if log.refused:
        remarks.append(f"{log.refused} outliers were rejected")
    if isinstance(equations.model.base, BlackBox):
        remarks += integration_remarks(*linearise.integration_delays_s(log, equations.model.base))
    remarks += _measured_loads(conclusion)
    for group in {linearise.base_names(group, equations.model.catalogue): None for group in conclusion.composites}:
        family = next(effect.family for effect in effects if effect.name in group)
        remarks.append(
            f"{join_words([plain(name) for name in group])} are of one family ({family}) and may together be one "
            "effect that is not in the catalogue"
        )
    regime_alone_m = min((regime.after_m for regime in conclusion.regimes[:1]), default=np.inf)
    if len(effects) > 1 and regime_alone_m < _ALMOST * gap.gap.after_m:
        remarks.append(
            "a force in one regime alone improves predictions almost as much as all named effects: together these "
            "may only imitate one effect that is not in the catalogue"
        )
    for effect in effects:
        if vessel is not None and effect.name in vessel.effects and effect.in_vessel:
            remarks.append(f"{effect.name} is already in the vessel file: the value here replaces the one there")
    return tuple(remarks)


def _measured_loads(conclusion: verdict.Conclusion) -> list[str]:
    """What meters on the shafts say of the model as it is and with what is named, a remark a meter."""
    equations, at = conclusion.first.evidence.equations, conclusion.accepted.coordinates
    before = witnesses.shaft_excess(equations.log, replace(equations.model, at={}))
    after = witnesses.shaft_excess(equations.log, replace(conclusion.accepted.evidence.equations.model, at=at))

    def words(share: float) -> str:
        return f"{100.0 * abs(share):.0f} % {'more' if share > 0.0 else 'less'}"

    return [
        f"measured {quantity}{f' of {plain(shaft)}' if shaft else ''}: the model's is {words(share)}, with what is"
        f" named {words(after[quantity, shaft])}"
        for (quantity, shaft), share in before.items()
    ]


def regime_in_words(found_regime: FoundRegime) -> result.RegimeEffect:
    """A regime as the contract has it, with force, regime, and its effect on predictions in one sentence."""
    regime, value, share = found_regime.regime, found_regime.value, found_regime.share
    size_n, unit = force_unit(abs(value))
    unit, kind = (f"{unit} m", "moment") if regime.axis == "yaw" else (unit, "force")
    spans = []
    for name, (low, high) in regime.within.items():
        if not isfinite(low):
            extent = f"below {number(high)}"
        else:
            extent = f"{number(low)} to {number(high)}" if isfinite(high) else f"above {number(low)}"
        quantity, quantity_unit = _quantity_and_unit(name)
        spans.append(f"{quantity} is {extent} {quantity_unit}")
    where = f" while {join_words(spans)}" if spans else ""
    growth = ""
    if regime.grows_with is not None:
        quantity, quantity_unit = _quantity_and_unit(regime.grows_with)
        figure = f"the figure is for {number(regime.at)} {quantity_unit}"
        growth = f", proportional to the square of {quantity} ({figure})"
    text = (
        f"The model lacks {number(abs(value) / size_n)} {unit} {_WAYS[regime.axis][value < 0.0]}{where}{growth}: "
        f"{percent(share)} of the missing {regime.axis} {kind}; "
        f"with it the error on held-out legs is {found_regime.after_m:.2f} m."
    )
    within = {
        name: (low if isfinite(low) else None, high if isfinite(high) else None)
        for name, (low, high) in regime.within.items()
    }
    (name, unit), reach = parameter_of(regime), 1.96 * abs(found_regime.error)
    parameters = {name: result.Estimate(value, value - reach, value + reach, unit)}
    return result.RegimeEffect(
        found_regime.name, text, regime.axis, within, regime.grows_with, regime.at, parameters, share,
        found_regime.replicated, found_regime.after_m,
    )  # fmt: skip


def _quantity_and_unit(name: str) -> tuple[str, str]:
    """A quantity of a regime in words, and its unit."""
    words = _QUANTITY_WORDS.get(name) or f"the shaft speed of the {plain(name.removesuffix('_rpm'))} thruster"
    return words, UNITS[name.rsplit("_", 1)[-1]]


def alternatives(group: Sequence[str], named: Sequence[str], last: str = "or") -> str:
    """Effects that the data cannot distinguish; or, where all are named, that may be one unknown effect.

    >>> alternatives(["trim", "skeg"], ["trim"])
    'trim or skeg'
    >>> alternatives(["trim", "skeg"], ["skeg", "trim"], "from")
    'trim and skeg from one effect of their family that is not in the catalogue'
    """
    words = [plain(name) for name in group]
    return f"{join_words(words)} {last} {ONE_OF_THEM}" if set(group) <= set(named) else join_words(words, last)


def number(value: float) -> str:
    """A number with three figures, without an exponent unless it is very small.

    >>> number(-0.01234), number(12345.6), number(inf)
    ('−0.0123', '12,346', 'no end')
    """
    if value == inf:
        return "no end"
    text = plain_number(value)
    return text.replace("-", "\u2212") if "e" not in text else text


def percent(share: float) -> str:
    """A share in whole percent, or one figure below ten.

    >>> percent(0.834), percent(0.01)
    ('83 %', '1 %')
    """
    return f"{100.0 * share:.0f} %" if abs(share) >= 0.0995 else f"{100.0 * share:.2g} %"


def chance(p_value: float) -> str:
    """A p-value in words.

    >>> chance(0.012), chance(1e-9)
    ('p = 0.012', 'p < 0.001')
    """
    return f"p < {_SMALL:g}" if p_value < _SMALL else f"p = {p_value:.2g}"


def parameter_title(name: str, unit: str) -> str:
    """A parameter's name without its unit.

    >>> parameter_title("time_constant_s", "s"), parameter_title("resistance_factor", "1")
    ('time constant', 'resistance factor')
    """
    return plain(name if unit == "1" or "_" not in name else name.rsplit("_", 1)[0])


def model_line(diagnosis: result.Diagnosis) -> str:
    """Which model was diagnosed, and whether it is not that of the ship which the recordings name."""
    return model_remark(diagnosis) or f"{_MODEL}{diagnosis.provenance.get('vessel', 'as given')}"


def model_remark(diagnosis: result.Diagnosis) -> str:
    """Remark on the provenance of the model, empty if the recordings name the same vessel."""
    return next((remark for remark in diagnosis.remarks if remark.startswith(_MODEL)), "")


def correction_sentence(correction: result.IdentifiedCorrection) -> str:
    """What a refit of the model before the diagnosis did, and what the model's structure can close, for people."""
    ahead, across, yaw = (percent(share) for share in correction.forces.values())
    moved = sum(
        abs(coefficient.value - correction.start[name]) > _NOTABLE * abs(correction.start[name])
        for name, coefficient in correction.coefficients.items()
    )
    closes = (
        f"on {correction.held_out_windows} held-out windows the error falls from "
        f"{number(correction.before_m)} to {number(correction.after_m)} m"
    )
    if not correction.applied:
        return (
            "The model was re-identified but left unchanged: on held-out legs the error is "
            f"{number(correction.after_m)} m with the new coefficients and {number(correction.before_m)} m without."
        )
    return (
        f"The diagnosis starts from a refit of the model: {moved} of {len(correction.coefficients)} coefficients "
        f"changed by more than {percent(_NOTABLE)}, which changes the forces by {ahead} of their range in surge, "
        f"{across} in sway and {yaw} in yaw; {closes}, the best that this model's structure allows."
    )


def structure_rows(correction: result.IdentifiedCorrection) -> list[list[str]]:
    """What the model's structure can close, beside the constant velocity, on legs that took no part."""
    distances_m = {
        "constant velocity": correction.constant_velocity_m,
        "model before the refit": correction.before_m,
        "model with coefficients of the other legs (the best of this structure)": correction.after_m,
    }
    return [[name, f"{number(distance_m)} m"] for name, distance_m in distances_m.items()]


def coefficient_rows(correction: result.IdentifiedCorrection) -> list[list[str]]:
    """Each coefficient of a refit, those that moved most first."""

    def change(name: str) -> float:
        return correction.coefficients[name].value / correction.start[name] - 1.0

    names = sorted(correction.coefficients, key=lambda name: -abs(change(name)))
    determined = {name: "yes" if name in correction.known else "only with others" for name in names}
    return [
        [name.removeprefix("effects.").replace(".", " "), number(correction.start[name]),
         number(correction.coefficients[name].value), _interval_text(correction.coefficients[name]),
         f"{100.0 * change(name):+.0f} %".replace("-", "\u2212"), determined[name]]
        for name in names
    ]  # fmt: skip


def verdict_sentence(diagnosis: result.Diagnosis) -> str:
    """The verdict in one plain sentence: what has rivals that explain as much is not named in it without them."""
    groups = diagnosis.indistinguishable if diagnosis.verdict == "indistinguishable" else ()
    certain = [effect for effect in diagnosis.effects if not any(effect.name in group for group in groups)]
    lacks, shown = (
        plain_names(effect for effect in certain if (effect.kind == "sensor") is is_sensor)
        for is_sensor in (False, True)
    )
    parts = [f"the model lacks {join_words(lacks)}"] if lacks else []
    parts += [f"the sensors show {join_words(shown)}"] if shown else []
    named = ", and ".join(parts)
    named = named[:1].upper() + named[1:]
    unimproved = f", but predictions over {diagnosis.gap.horizon_s} s come no closer with it" * gap_stays(diagnosis)
    if diagnosis.verdict == "nothing_missing":
        return "Nothing is missing that this trial could reveal"
    if diagnosis.verdict == "unknown":
        begins = f"{named}{unimproved}, and s" if named else "S"
        return f"{begins}omething is missing that no effect of the catalogue explains"
    if groups:
        names = [effect.name for effect in diagnosis.effects]
        begins = (
            f"{named}; this trial cannot determine which else is"
            if named
            else "This trial cannot determine which is"
        )
        named = f"{begins} missing: {'; '.join(alternatives(group, names) for group in groups)}"
    remainder = diagnosis.remainder
    if remainder is None:
        return named + unimproved
    return f"{named}{unimproved}; forces of {percent(remainder.share_of_range)} of the range remain unexplained"


def headline(diagnosis: result.Diagnosis) -> dict[str, str]:
    """The numbers that matter."""
    gap, error = diagnosis.gap, f"error over {diagnosis.gap.horizon_s} s"
    if diagnosis.effects:
        figures = {
            f"{error} before": f"{gap.before_m:.2f} m",
            "after": f"{gap.after_m:.2f} m",
            "floor, from noise as estimated": f"{gap.floor_m:.2f} m",
            "of the gap above the floor closed": percent(gap.closed) if gap.closed > 0.0 else "nothing",
        }
    else:
        figures = {error: f"{gap.before_m:.2f} m", "constant velocity": f"{gap.constant_velocity_m:.2f} m"}
        if gap.floor_m < gap.before_m:
            figures["floor, from noise as estimated"] = f"{gap.floor_m:.2f} m"
    figures["of the force range: tolerated model error"] = f"{percent(diagnosis.tolerance)}"
    return figures


def floor_remark(diagnosis: result.Diagnosis) -> str:
    """Why all of a gap seems closed though forces remain; empty where it does not."""
    gap = diagnosis.gap
    if not diagnosis.effects or (diagnosis.remainder or diagnosis.unknown) is None or gap.floor_m < gap.after_m:
        return ""
    return (
        "The floor is the error after: the noise as estimated would leave no less. But what is taken for noise "
        "includes the forces that remain, so that the share of the gap that is closed is the largest it can be."
    )


def suspect_rows(suspects: Sequence[result.Suspect]) -> list[list[str]]:
    """Each suspect with the parts of the trial in which it was found."""
    return [[plain(suspect.name), "; ".join(suspect.found_in)] for suspect in suspects]


def next_steps(diagnosis: result.Diagnosis, contradictions: Sequence[result.SensorContradiction] = ()) -> list[str]:
    """What the reader can do next, the most useful first; ``contradictions`` are those between the sensors."""
    sensors = plain_names(effect for effect in diagnosis.effects if effect.kind == "sensor")
    steps = []
    if contradictions and not sensors:
        steps.append(
            "Correct the sensors first: without any ship model they contradict each other, as by "
            f"{join_words(list(dict.fromkeys(plain(lack.effect) for lack in contradictions)))} (see the end of "
            "this page). Then repeat the diagnosis, since forces may otherwise stand for them."
        )
    if sensors:
        steps.append(
            f"Check the sensors first ({join_words(sensors)}): correct their mounting, settings or timing if "
            "needed, and repeat the diagnosis, since the other effects may change."
        )
    steps += [
        f"Declare {possible.declaration} ({context.option_of(possible.declaration)}) if that is certain: "
        f"it rules out {join_words([plain(name) for name in possible.effects])}."
        for possible in diagnosis.context.would_exclude
    ]
    steps += _use_of_vessel(diagnosis)
    if diagnosis.next_manoeuvre is not None:
        steps.append("Sail the manoeuvre given below: it distinguishes what this trial cannot.")
    if diagnosis.unknown is not None:
        steps.append(
            "Sail some minutes in the cells of the map below where the model is most wrong, one quantity varied at "
            "a time, and diagnose the recordings together: no effect of the catalogue explains this one."
        )
    if diagnosis.regimes:
        steps.append(
            "Look for a cause in the regimes below, where the model is worst, and sail some minutes in each: "
            "there a trial is most informative."
        )
    if diagnosis.identified is not None and diagnosis.identified.applied:
        steps.append(
            "Use the coefficients identified from this trial only within its speeds, drift angles and thruster "
            "settings: those that it determines only with others are no measurement of the ship. A diagnosis "
            "without the identification names effects of the model as it was."
        )
    if (diagnosis.remainder or diagnosis.unknown) is not None and diagnosis.identified is None:
        steps.append(
            "If many coefficients may be wrong, for example because they are another ship's, identify them first."
        )
    if diagnosis.verdict == "nothing_missing":
        steps.append("Use the model as it is; the rest may be learned on top of it.")
    return steps


def _use_of_vessel(diagnosis: result.Diagnosis) -> list[str]:
    """What to do with the vessel file, if it has an effect other than those of sensors."""
    written = [effect for effect in diagnosis.effects if effect.in_vessel]
    if all(effect.kind == "sensor" for effect in written):
        return []
    if gap_stays(diagnosis):
        return [
            "Go on predicting with the model as it is: with the named effects, which the vessel file beside this "
            "page, vessel.toml, has, predictions come no closer."
        ]
    use = "Use the vessel file beside this page, vessel.toml: the model with the named effects."
    if any(row.is_worse for row in index_table_of_diagnosis(diagnosis).rows):
        use += (
            " Do not predict manoeuvres with it: those marked as worse below come closer with the model as it is."
        )
    if any(effect.kind == "sensor" for effect in written):
        use += (
            " Predictions do not correct the named errors of sensors in a recording: correct the recording, or "
            "state the sensors' places in it, and diagnose again."
        )
    passing = dict.fromkeys(f"[effects.{effect.name}]" for effect in written if effect.scope != "ship")
    if passing:
        use += f" It is of this trial; for another, delete what is not the ship's own: {join_words([*passing])}."
    return [use]


def clock(time: str) -> str:
    """A time of UTC for people, to the minute.

    >>> clock("2026-09-01T12:40:29Z")
    '12:40 on 1 Sep'
    """
    utc = datetime.fromisoformat(time)
    return f"{utc:%H:%M} on {utc.day} {utc:%b}"


def when_words(when: result.When) -> str:
    """The part of a trial in which an effect has a size, at the beginning of a sentence.

    >>> when_words(result.When(recording="tuesday.mcap"))
    'In tuesday.mcap'
    """
    if when.recording is not None:
        return f"In {when.recording}"
    change = when.until or when.since or ""
    span = f"{clock(change)} UTC"
    if when.low is not None and when.high is not None:
        span += f" ({clock(when.low)[:5]} to {clock(when.high)[:5]})"
    return f"Until {span}" if when.until is not None else f"From {span} on"


def title_of(effect: result.NamedEffect) -> str:
    """An effect's name, with the part of the trial that its size is of."""
    if effect.drift is not None:
        return f"{plain(effect.name)}, at the end"
    if effect.when is None:
        return plain(effect.name)
    when = when_words(effect.when)
    return f"{plain(effect.name)}, {when[:1].lower()}{when[1:]}"


def vessel_file_remark(diagnosis: result.Diagnosis) -> str:
    """Which effects that vary the vessel file lacks, or has as at the end of the trial; empty if none varies."""
    in_file = {effect.name for effect in diagnosis.effects if effect.in_vessel}
    partly = [effect for effect in diagnosis.effects if effect.when is not None or effect.drift is not None]
    omitted, final = (
        plain_names(effect for effect in partly if (effect.name in in_file) is is_written)
        for is_written in (False, True)
    )
    if not partly:
        return ""
    parts = [f"no {join_words(omitted, 'or')}"] if omitted else []
    parts += [f"the {join_words(final)} at the end of the trial"] if final else []
    return f"The vessel file has the ship's own effects at the end of the trial: {', and '.join(parts)}."


def parameter_rows(diagnosis: result.Diagnosis) -> list[list[str]]:
    """Each parameter of the named effects with its interval."""
    return [
        [title_of(effect), parameter_title(name, estimate.unit), number(estimate.value), _interval_text(estimate),
         "" if estimate.unit == "1" else estimate.unit]
        for effect in diagnosis.effects
        for name, estimate in effect.parameters.items()
    ]  # fmt: skip


def correlation_rows(correlation: result.Correlation) -> list[list[str]]:
    """How the estimates are correlated."""
    return [
        [name, *(f"{coefficient:+.2f}".replace("-", "\u2212") for coefficient in row)]
        for name, row in zip(correlation.names, correlation.matrix.tolist(), strict=True)
    ]


def replication_words(replicated: result.Replication) -> str:
    """In how many parts of the trial something is found."""
    return f"found separately in {replicated.found} of {replicated.parts} parts of the trial"


def dependence_words(where: Sequence[str]) -> str:
    """What something unknown depends on."""
    return join_words([DEPENDS.get(quantity, plain(quantity)) for quantity in where])


def distances_by_title(comparison: result.CalibratorComparison) -> dict[str, Interval]:
    """The mean distances of a comparison of calibrators, by title."""
    return {_model_title(name): interval for name, interval in comparison.mean_distance_m.items()}


def _model_title(name: str) -> str:
    return plain(name.replace("_calibrated", ", calibrated"))


def comparison_rows(comparison: result.CalibratorComparison) -> tuple[list[list[str]], int]:
    """A row a model, and which is the best."""
    rows = []
    for name, interval in comparison.mean_distance_m.items():
        base = name.removesuffix("_calibrated")
        gain = ratio_words(comparison.ratio(name, base)) if name != base else ""
        span = _interval_text(interval) if isfinite(interval.low) else ""
        rows.append([_model_title(name), number(interval.value), span, gain])
    return rows, min(range(len(rows)), key=lambda row: list(comparison.mean_distance_m.values())[row].value)


def comparison_sentence(comparison: result.CalibratorComparison) -> str:
    """What a calibrator gains, and whether the named effects help it, in one sentence; or why this is not known."""
    distances_m = comparison.mean_distance_m
    if not distances_m:
        return f"No calibrator was trained: {comparison.why_not}."
    errors = {name: f"{number(interval.value)} m" for name, interval in distances_m.items()}
    reference = f"On held-out legs the error of the reference is {errors['reference']}"
    if "named" not in distances_m:
        change = ratio_words(comparison.ratio("reference_calibrated", "reference"))
        return f"{reference}, with a calibrator {errors['reference_calibrated']}: {change}."
    ratio = comparison.ratio("named_calibrated", "reference_calibrated")
    helps = "the named effects help the calibrator"
    if ratio.low > 1.0:
        helps = "the named effects do not help the calibrator"
    elif not ratio.high < 1.0:
        helps = "these legs do not show that the named effects help the calibrator"
    return (
        f"{reference}, with the named effects {errors['named']}, with a calibrator "
        f"{errors['reference_calibrated']}, with both {errors['named_calibrated']}: {helps}, {ratio_words(ratio)}."
    )


def ratio_words(ratio: Interval | result.Ratio) -> str:
    """A ratio of errors in words, with its 95 % interval.

    >>> ratio_words(Interval(0.8, 0.7, 0.9)), ratio_words(Interval(0.98, 0.95, 1.02))
    ('20 % less error (10 to 30 %)', '2 % less error (5 % less to 2 % more)')
    """
    value, low, high = (bound - 1.0 for bound in (ratio.value, ratio.low, ratio.high))
    words = f"{percent(abs(value))} {'more' if value > 0.0 else 'less'} error"
    if not (isfinite(low) and isfinite(high)):
        return words
    if low * high > 0.0:
        near, far = sorted((abs(low), abs(high)))
        return f"{words} ({percent(near).removesuffix(' %')} to {percent(far)})"
    return f"{words} ({percent(-low)} less to {percent(high)} more)"


def cell_row(place: result.GapCell) -> list[str]:
    """A cell of the map."""
    from seatrial.hybrid.report.plots import axis_title, cell_name, quantity_of

    cell = f"{axis_title(quantity_of(place))}: {cell_name(place)}"
    z = f"{place.z:.1f}".replace("-", "\u2212")
    return [quantity_title(place.channel), cell, str(place.windows), number(place.error), z]


def ranking_rows(ranking: Sequence[result.RankedEffect]) -> list[list[str]]:
    """The catalogue ranked, each effect alone in the model."""
    rows = []
    for ranked in ranking:
        if 0.0 < ranked.limit < inf:
            limit = f"{number(ranked.limit)} {'' if ranked.unit == '1' else ranked.unit}".strip()
        else:  # as the effects of the wind where there is none
            limit = "" if ranked.limit != ranked.limit else "not by this trial"
        evidence, p_value = number(ranked.evidence), chance(ranked.p_value)
        rows.append([plain(ranked.name), ranked.family, evidence, p_value, limit])
    return rows


def basis_rows(diagnosis: result.Diagnosis) -> list[list[str]]:
    """The basis of the verdict, tolerance and provenance, without settings that are off."""
    extent = diagnosis.provenance.get("force_range")
    rows = [["tolerance", f"{percent(diagnosis.tolerance)} of the range of the forces in the trial"]]
    if extent:
        size_n, unit = force_unit(diagnosis.tolerance * max(extent.values()))
        ahead, across, yaw = (
            number(diagnosis.tolerance * extent[name] / size_n) for name in ("surge_n", "sway_n", "yaw_nm")
        )
        rows.append(["which is", f"{ahead} {unit} ahead, {across} {unit} across, {yaw} {unit} m in yaw"])
    for key, value in diagnosis.provenance.items():
        if key in ("force_range", "noise") or value in (False, "0..100"):
            continue
        words = _value_words(value)
        if key in ("repaired", "left_out"):  # file by file: only the names of channels are put into words
            parts = (entry.partition(": ") for entry in value.split("; "))
            words = "; ".join(f"{file}{colon}{tables.readable_names(action)}" for file, colon, action in parts)
        rows.append([plain(str(key)), words])
    return rows


def noise_rows(diagnosis: result.Diagnosis) -> list[list[str]]:
    """Levels of noise: standard deviations in the units of the channels."""
    noise, turn = diagnosis.provenance["noise"], 180.0 / pi
    size_n, unit = force_unit(max(*noise["gust"][:2], *noise["slow"][:2]))
    forces = (("ahead", 1.0 / size_n, unit), ("across", 1.0 / size_n, unit), ("in yaw", 1.0 / size_n, f"{unit} m"))
    swing = (("north", 1.0, "m"), ("east", 1.0, "m"), ("in yaw", turn, "deg"))
    sensors = (
        ("positions", 1.0, "m"), ("heading", turn, "deg"), ("surge", 1.0, "m/s"), ("sway", 1.0, "m/s"),
        ("yaw rate", turn, "deg/s"),
    )  # fmt: skip
    white = [noise[name] for name in ("position_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")]

    def with_time_constant(levels: str, name: str) -> str:
        return f"{levels}; time constant {number(noise[name])} s"

    rows = [
        ["sensors, anew each second", _levels_text(white, sensors)],
        ["gusts, anew each second", _levels_text(noise["gust"], forces)],
        ["slow forces", with_time_constant(_levels_text(noise["slow"], forces), "slow_s")],
    ]
    if any(noise["waves"]):
        period_s, towards_deg = 2.0 * pi / noise["wave_frequency_radps"], noise["wave_towards_rad"] * turn % 360.0
        levels = _levels_text(noise["waves"], swing)
        rows.append(["wave motion", f"{levels}; period {number(period_s)} s, towards {towards_deg:.0f} deg"])
    if noise.get("wave_drift_n"):
        beam = f"{number(noise['wave_drift_n'] / size_n)} {unit} in beam sea"
        rows.append(["slow drift of the waves", with_time_constant(beam, "wave_drift_s")])
    if any(noise["drift"]):
        rows.append(
            ["slow errors of sensors", with_time_constant(_levels_text(noise["drift"], sensors), "drift_s")]
        )
    return rows


def _levels_text(values: Sequence[float], units: Sequence[tuple[str, float, str]]) -> str:
    """Levels with their names and units; zeros are left out."""
    levels = zip(values, units, strict=True)
    return ", ".join(f"{name} {number(value * factor)} {unit}" for value, (name, factor, unit) in levels if value)


def _value_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{plain(str(key))} {_value_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_value_words(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value) if isinstance(value, float) else str(value)


def plain_names(effects: Iterable[result.NamedEffect]) -> list[str]:
    """The effects' names in plain words, without repetition."""
    return list(dict.fromkeys(plain(effect.name) for effect in effects))


def effect_names(effects: Sequence[result.NamedEffect]) -> str:
    """The effects' names at the beginning of a sentence."""
    return join_words(plain_names(effects)).capitalize()


def file_rows(effects: Sequence[result.NamedEffect]) -> list[list[str]]:
    """The lines that a vessel file has for them."""
    return [[f"[effects.{effect.name}]", f"{name} = {number(estimate.value)}", estimate.unit]
            for effect in effects for name, estimate in effect.parameters.items()]  # fmt: skip


def _interval_text(interval: result.Estimate | Interval) -> str:
    return f"{number(interval.low)} to {number(interval.high)}"


def write_report(diagnosis: result.Diagnosis, extras: result.Extras, folder: Path) -> Path:
    """Write the page into ``folder`` and return its path. Raises :class:`StorageError`."""
    return page_of(diagnosis, extras).write(folder / PAGE_FILE)


def page_of(diagnosis: result.Diagnosis, extras: result.Extras) -> pages.Page:
    """The page, not yet written."""
    provenance = diagnosis.provenance
    vessel = f"vessel {provenance['vessel']}" if "vessel" in provenance else ""
    parts = ["Diagnosis", str(provenance.get("recordings", "")), vessel]
    return pages.render(
        "diagnosis.html", templates=templates(), title=verdict_sentence(diagnosis),
        subtitle="; ".join(part for part in parts if part), diagnosis=diagnosis, extras=extras,
    )  # fmt: skip


def summary(diagnosis: result.Diagnosis, comparison: result.CalibratorComparison | None = None) -> Group:
    """The diagnosis in some lines, and what a calibrator adds where one was trained."""
    lines = [Text(context_sentence(diagnosis.context))] if context_sentence(diagnosis.context) else []
    if diagnosis.identified is not None:
        lines.append(Text(correction_sentence(diagnosis.identified)))
    lines.append(Text(_VERDICTS[diagnosis.verdict], style="bold"))
    lines += [Text(f"- {effect.sentence}") for effect in diagnosis.effects]
    if gap_stays(diagnosis):
        lines.append(Text(f"Predictions over {diagnosis.gap.horizon_s} s come no closer with what is named."))
    if diagnosis.suspects:
        lines.append(
            Text(f"Found, but not named: {join_words([plain(each.name) for each in diagnosis.suspects])}.")
        )
    names = [effect.name for effect in diagnosis.effects]
    for group in diagnosis.indistinguishable:
        lines.append(Text(f"These data cannot distinguish {alternatives(group, names, 'from')}."))
    remainder = diagnosis.unknown or diagnosis.remainder
    if remainder is not None:
        lines.append(Text(f"What remains looks like {remainder.looks_like}."))
    lines += [Text(f"- {regime.sentence}") for regime in diagnosis.regimes]
    if diagnosis.regimes:
        lines.append(Text(REGIMES_NOTE))
    gap = diagnosis.gap
    if gap.held_out_windows:
        where = f"Mean distance over {gap.horizon_s} s on {gap.held_out_windows} held-out windows"
        lines.append(Text(f"{where}: {gap.distances_text(bool(diagnosis.effects))}."))
    if floor_remark(diagnosis):
        lines.append(Text(floor_remark(diagnosis)))
    if indices_headline := index_table_of_diagnosis(diagnosis).headline:
        lines.append(Text(tables.readable_names(indices_headline)))
    if comparison is not None:
        lines.append(Text(comparison_sentence(comparison)))
    if diagnosis.next_manoeuvre is not None:
        lines.append(Text(f"Next: {diagnosis.next_manoeuvre.what}"))
    of_model = model_remark(diagnosis)
    lines += [Text(f"note: {remark}", style="dim") for remark in diagnosis.remarks if remark != of_model]
    return Group(*lines)


def sentence(effect: Effect, parameters: Parameters, share_of_gap: float, actuators: Actuators = DEFAULT) -> str:
    """A named effect in one plain sentence, with its size, certainty and share of the gap.

    ``actuators`` are the ship's, by default R/V Gunnerus'.
    """
    words, ends = words_and_interval(effect, parameters, actuators)
    return f"{words} ({ends}); {share_words(share_of_gap)}"


def share_words(share_of_gap: float) -> str:
    """What an effect explains of the gap, at the end of its sentence; of none, what it is named by instead.

    >>> share_words(0.6)
    'it explains 60 % of the gap on legs not used to find it.'
    """
    words = f"it explains {100.0 * share_of_gap:.0f} % of the gap on legs not used to find it"
    return f"{words}{': its evidence second by second names it, not the predictions' * (share_of_gap < _NIL)}."


def gap_stays(diagnosis: result.Diagnosis) -> bool:
    """Whether effects are named by their evidence, and predictions over the horizon come no closer with them."""
    return bool(diagnosis.effects) and diagnosis.gap.closed < _NIL


def words_and_interval(effect: Effect, parameters: Parameters, actuators: Actuators) -> tuple[str, str]:
    """An effect with its size, and the ends of its 95 % intervals.

    The size is in percent of change where the text has percent.
    """
    if effect.base in _SEVERAL:
        return _several_parameters_words(_SEVERAL[effect.base], parameters)
    text = _ONE.get(effect.base) or _actuator_text(effect.base, actuators)
    if _GAIN in effect.what:
        text = effect.what.replace(_GAIN, "acts as {} times")
    if not text:
        sizes = ", ".join(
            f"{plain(name.rsplit('_', 1)[0])} {number(estimate.value)} {estimate.unit}".removesuffix(" 1")
            for name, estimate in parameters.items()
        )
        ends = "; ".join(interval_text(estimate.low, estimate.high) for estimate in parameters.values())
        return f"The model lacks {plain(effect.base)}: {sizes}", ends

    estimate, neutral = next(iter(parameters.values())), effect.parameters[0].neutral
    is_less = "[" in text and bool(estimate.value < neutral)
    text = re.sub(r"\[(.*?)\|(.*?)\]", rf"\{1 + is_less}", text)

    def size(value: float) -> float:
        change = 100.0 * (value - neutral) if "%" in text and isfinite(neutral) else value
        return -change if is_less else change

    low, high = sorted((size(estimate.low), size(estimate.high)))
    return text.format(number(size(estimate.value))), interval_text(low, high)


def _several_parameters_words(text: str, parameters: Parameters) -> tuple[str, str]:
    """A place by its side of the reference point, and its interval on that side; fractions in percent."""
    if "%" in text:
        parameters = {name: _scaled_estimate(estimate, 100.0) for name, estimate in parameters.items()}
    for way, opposite, name in zip(("ahead", "to starboard"), ("astern", "to port"), parameters, strict=False):
        if f"{{}} m {way}" in text and parameters[name].value < 0.0:
            text = text.replace(f"m {way}", f"m {opposite}")
            parameters = {**parameters, name: _scaled_estimate(parameters[name], -1.0)}
    values = [number(size.value) if size.unit != "deg" else f"{size.value:.0f}" for size in parameters.values()]
    ends = "; ".join(interval_text(size.low, size.high, size.unit) for size in parameters.values())
    return text.format(*values), ends


def _scaled_estimate(estimate: result.Estimate, factor: float) -> result.Estimate:
    low, high = sorted((factor * estimate.low, factor * estimate.high))
    return replace(estimate, value=factor * estimate.value, low=low, high=high)


def interval_text(low: float, high: float, unit: str = "") -> str:
    """The ends of an interval; angles in whole degrees.

    >>> interval_text(0.341, 0.36), interval_text(-1.2, 0.5), interval_text(202.7, 206.9, "deg")
    ('0.341-0.36', '−1.2 to 0.5', '203-207')
    """
    ends = [f"{end:.0f}".replace("-", "\u2212") if unit == "deg" else number(end) for end in (low, high)]
    return "-".join(ends) if low >= 0.0 else " to ".join(ends)


_SEVERAL = {
    "ocean_current": "The ship drifts with a current of {} m/s towards {} deg",
    "steady_wind": "A wind that was not recorded blows at {} m/s towards {} deg",
    "wave_drift": "Waves push the ship with {} N in beam sea towards {} deg",
    "low_speed_damping": "At low speed the water damps otherwise than in the model, by {} % a second in surge, "
    "{} % in sway, {} % in yaw, negative being less",
    "position_antenna_offset": "The recorded position is that of a point {} m ahead and {} m to starboard of the "
    "reference point",
    "speed_sensor_offset": "The recorded speeds are those of a point {} m ahead and {} m to starboard of the "
    "reference point",
}
"""Effects of two parameters and more, in their order."""


_ONE = {
    "loading": "The ship is {} % [heavier|lighter] than her model",
    "surge_added_mass": "The added mass in surge is {} % [more|less] than the model's",
    "sway_added_mass": "The added mass in sway is {} % [more|less] than the model's",
    "yaw_inertia": "The inertia in yaw is {} % [more|less] than the model's",
    "hull_fouling": "The hull's resistance straight ahead is {} % [more|less] than the model's",
    "cross_flow_drag": "The hull's cross-flow drag is {} % [more|less] than the model's",
    "drift_force": "The side force of the drifting hull is {} % [more|less] than the model's",
    "drift_moment": "The yaw moment of the drifting hull is {} % [more|less] than the model's",
    "turning_force": "The side force of the turning hull is {} % [more|less] than the model's",
    "turning_drag": "The force along the turning hull, of most hulls ahead, is {} % [more|less] than the model's",
    "yaw_damping": "The hull's yaw damping is {} % [more|less] than the model's",
    "trim": "The hull's side force acts {} m further [forward|aft] than the model's, as with trim by the "
    "[head|stern]",
    "skeg": "The hull has {} m2 [more|less] skeg than the model",
    "towed_load": "Something [holds the ship back|pushes the ship ahead] with a steady {} N",
    "hull_lengthening": "The ship is {} m [longer|shorter] than her model",
    "shallow_water": "The water is about {} m deep, which affects the hull forces",
    "wake_fraction": "[The wake slows the water at the thrusters by {} %|"
    "The water at the thrusters is {} % faster than the ship]",
    "pod_side_force": "The side force of the pods in oblique flow is {} % [more|less] than the model's",
    "azimuth_scale": "The true angles of both azimuths are {} % [larger|smaller] than reported",
    "yaw_asymmetry": "A steady moment of {} N m turns the ship to [starboard|port]",
    "sway_asymmetry": "A steady force of {} N pushes the ship to [starboard|port]",
    "wind_load": "The wind loads are {} % [more|less] than the tables say",
    "wind_drag": "The wind force along the ship is {} % [more|less] than the model's",
    "wind_side_load": "The wind force across the ship is {} % [more|less] than the model's",
    "wind_yaw_load": "The yaw moment of the wind is {} % [more|less] than the model's",
    "surge_push": "A steady push of {} m/s2 [ahead|astern] acts beside the model",
    "sway_push": "A steady push of {} m/s2 to [starboard|port] acts beside the model",
    "yaw_push": "A steady push of {} deg/s2 to [starboard|port] acts beside the model in yaw",
    "added_resistance": "The ship resists going ahead [more|less] than the model, by {} per metre and mass",
    "added_sway_drag": "The ship resists drifting [more|less] than the model, by {} per metre and mass",
    "added_yaw_drag": "The ship resists turning [more|less] than the model, by {} per metre and inertia",
    "position_delay": "Positions are stamped {} s too [late|early]",
    "heading_delay": "Headings are stamped {} s too [late|early]",
    "speed_delay": "Surge, sway and yaw rate are stamped {} s too [late|early]",
    "command_delay": "The drives' feedback is stamped {} s too [late|early]",
    "thruster_lag": "The thrusters follow the recorded settings with a lag of {} s",
    "heading_bias": "The compass reads {} deg too [much|little]",
    "speed_sensor_rotation": "The speed sensor is turned {} deg [clockwise|counter-clockwise]",
    "speed_scale": "Reported speeds are {} times the true ones",
    "sway_bias": "The speed sensor reports {} m/s too much to [starboard|port]",
    "yaw_rate_bias": "The rate gyro reads {} deg/s too [much|little]",
    "yaw_rate_scale": "Reported yaw rates are {} times the true ones",
    "wind_direction_bias": "The wind vane reads {} deg too [much|little]",
    "wind_speed_scale": "Reported wind speeds are {} times the true ones",
}
"""Effects of one parameter; in brackets what is said of more, and of less, which is then without a sign."""

_LOSS = "$Subject [<lacks|lack> {} % of <its|their> $force|<has|have> {} % more $force than the model's]"

_GAIN = "acts as factor x"  # what it acts on is in the effect's own words
_ACTUATORS = {
    "thrust_loss": _LOSS,
    "azimuth_offset": "The true angle<|s> of $azimuth <is|are> the reported angle<|s> plus {} deg",
    "nozzle_offset": "The true angle<|s> of $nozzle <is|are> the reported angle<|s> plus {} deg",
    "rudder_loss": _LOSS,
    "rudder_offset": "$Subject <is|are> truly {} deg to [starboard|port] of the reported angle<|s>",
    "wake": "The water at $subject is {} % [slower than the model's: the hull's wake is larger|faster than the "
    "model's]",
    "thrust_deduction": "$Subject <loses|lose> {} % [more|less] of <its|their> thrust to the hull than the model's",
    "rudder_interaction": "$Subject <draws|draw> {} % [more|less] of <its|their> side force from the hull than "
    "the model's",
    "flow_straightening": "$Subject <meets|meet> {} % [more|less] of the drift at the stern than the model's",
    "astern_thrust": "$Subject <gives|give> {} % [more|less] thrust astern than the model's",
    "speed_loss": "$Subject <loses|lose> half the side force at {} m/s ahead",
    "backlash": "$Subject <has|have> {} deg of backlash between the reported and the true angle<|s>",
    "lag": "$Subject <follows|follow> the recorded settings with a lag of {} s",
}
"""Effects of actuators by their stem, which is followed by an actuator's name, ``both`` or ``all``.

``<one|several>`` is what is said of one actuator and of several. An angle of thrust is to starboard of what is
reported where it is positive, which astern turns the ship to port.
"""


def _actuator_text(effect: str, actuators: Actuators) -> str:
    """The text for an effect of one actuator, of a pair, or of all of a kind; empty for another effect.

    A name that says its kind does not say it twice.
    """
    effect = "thrust_loss_tunnel" if effect == "tunnel_thrust_loss" else effect
    stem = next((candidate for candidate in _ACTUATORS if effect.startswith(f"{candidate}_")), None)
    if stem is None:
        return ""
    target = effect.removeprefix(f"{stem}_")
    first, _, group = target.partition("_")
    actuator = next((actuator for actuator in actuators if actuator.name == target), None)
    several = actuator is None
    if actuator is not None:
        label, noun, kind = f"The {target.replace('_', ' ')}", actuator.noun, actuator.kind
    else:
        by_kind = effects_by_kind(actuators) if first in ("both", "all") else {}
        kinds = [kind for kind, effects in by_kind.items() if any(effect == common.name for common in effects)]
        if not kinds:
            return ""
        kind = kinds[0]
        label, noun = first.capitalize(), group.replace("_", " ") or f"{KINDS[kind].noun}s"

    titles = {word: label if word in label else f"{label} {word}" for word in (noun, "azimuth", "nozzle")}
    inside = {word: title[0].lower() + title[1:] for word, title in titles.items()}
    words = {
        "Subject": titles[noun], "subject": inside[noun],
        "azimuth": inside["azimuth"] + "s" * several, "nozzle": inside["nozzle"] + "s" * several,
        "force": {"tunnel": "side force", "rudder": "force"}.get(kind, "thrust"),
    }  # fmt: skip
    return Template(re.sub(r"<(.*?)\|(.*?)>", rf"\{1 + several}", _ACTUATORS[stem])).substitute(words)
