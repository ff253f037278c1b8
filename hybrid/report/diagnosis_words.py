"""What a diagnosis's page and terminal say: words, numbers, rows. ``templates/diagnosis.html`` makes the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from math import inf, isfinite, pi
from pathlib import Path
from typing import Any

from rich.console import Group
from rich.text import Text

from seatrial.analysis.report.rendering import Page, render
from seatrial.analysis.report.tables import in_words
from seatrial.hybrid.diagnosis.result import (
    Correlation,
    Diagnosis,
    Estimate,
    Extras,
    GapCell,
    IdentifiedCorrection,
    Ladder,
    NamedEffect,
    Ratio,
    Replication,
    SensorContradiction,
    Suspect,
    When,
)
from seatrial.hybrid.prediction.scores import Interval
from seatrial.hybrid.report.sections import templates
from seatrial.hybrid.report.words import force_unit, join_words, plain, quantity_title

_SMALL = 0.001
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


def alternatives(group: Sequence[str], named: Sequence[str], last: str = "or") -> str:
    """Effects of which the data do not tell which it is; or, where all are named, that may be one unknown.

    >>> alternatives(["trim", "skeg"], ["trim"])
    'trim or skeg'
    >>> alternatives(["trim", "skeg"], ["skeg", "trim"], "from")
    'trim and skeg from one effect of their family that is not in the catalogue'
    """
    words = [plain(name) for name in group]
    return f"{join_words(words)} {last} {ONE_OF_THEM}" if set(group) <= set(named) else join_words(words, last)


def number(value: float) -> str:
    """Three figures, without exponents where people read none.

    >>> number(-0.01234), number(12345.6), number(inf)
    ('−0.0123', '12,346', 'no end')
    """
    if value == inf:
        return "no end"
    size = abs(value)
    text = f"{value:,.0f}" if size >= 100.0 else f"{value:.3g}"
    return text.replace("-", "\u2212") if "e" not in text else text


def percent(share: float) -> str:
    """A share in whole percent, or one figure below ten.

    >>> percent(0.834), percent(0.01)
    ('83 %', '1 %')
    """
    return f"{100.0 * share:.0f} %" if abs(share) >= 0.0995 else f"{100.0 * share:.2g} %"


def chance(p_value: float) -> str:
    """The chance of something where there is nothing.

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


_MODEL = "model: "


def model_line(diagnosis: Diagnosis) -> str:
    """Which model was diagnosed, and whether it is not that of the ship which the recordings name."""
    return doubt_of_model(diagnosis) or f"{_MODEL}{diagnosis.provenance.get('vessel', 'as given')}"


def doubt_of_model(diagnosis: Diagnosis) -> str:
    """What is to be said first of the model; empty where it is that of the recordings."""
    return next((each for each in diagnosis.remarks if each.startswith(_MODEL)), "")


def other_remarks(diagnosis: Diagnosis) -> list[str]:
    """What else was said on the way."""
    return [each for each in diagnosis.remarks if each != doubt_of_model(diagnosis)]


def correction_sentence(correction: IdentifiedCorrection) -> str:
    """What a refit of the model before the diagnosis did, and what the model's structure can close, for people."""
    ahead, across, yaw = (percent(each) for each in correction.forces.values())
    moved = sum(
        abs(each.value - correction.start[name]) > _NOTABLE * abs(correction.start[name])
        for name, each in correction.coefficients.items()
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


def structure_rows(correction: IdentifiedCorrection) -> list[list[str]]:
    """What the model's structure can close, beside the constant velocity, on legs that took no part."""
    rungs = {
        "constant velocity": correction.constant_velocity_m,
        "model before the refit": correction.before_m,
        "model with coefficients of the other legs (the best of this structure)": correction.after_m,
    }
    return [[name, f"{number(each)} m"] for name, each in rungs.items()]


def coefficient_rows(correction: IdentifiedCorrection) -> list[list[str]]:
    """Each coefficient of a refit, those that moved most first."""

    def change(name: str) -> float:
        return correction.coefficients[name].value / correction.start[name] - 1.0

    names = sorted(correction.coefficients, key=lambda name: -abs(change(name)))
    told = {name: "yes" if name in correction.known else "only with others" for name in names}
    return [
        [name.removeprefix("effects.").replace(".", " "), number(correction.start[name]),
         number(correction.coefficients[name].value), _span(correction.coefficients[name]),
         f"{100.0 * change(name):+.0f} %".replace("-", "\u2212"), told[name]]
        for name in names
    ]  # fmt: skip


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    named = _lacking(diagnosis.effects)
    if diagnosis.verdict == "nothing_missing":
        return "Nothing is missing that this trial could reveal"
    if diagnosis.verdict == "unknown":
        return f"{named + ', and s' if named else 'S'}omething is missing that no effect of the catalogue explains"
    if diagnosis.verdict == "indistinguishable" and diagnosis.remainder is None:
        names = [each.name for each in diagnosis.effects]
        groups = [alternatives(group, names) for group in diagnosis.indistinguishable]
        return f"This trial cannot determine which is missing: {'; '.join(groups)}"
    left = diagnosis.remainder
    rest = f"; forces of {percent(left.share_of_range)} of the range remain unexplained" if left is not None else ""
    return named + rest


def _lacking(effects: Sequence[NamedEffect]) -> str:
    """What the model lacks and what the sensors show, as a sentence; nothing without effects."""
    lacks, shown = (plain_names(each for each in effects if (each.kind == "sensor") is it) for it in (False, True))
    parts = [f"the model lacks {join_words(lacks)}"] if lacks else []
    parts += [f"the sensors show {join_words(shown)}"] if shown else []
    sentence = ", and ".join(parts)
    return sentence[:1].upper() + sentence[1:]


def headline(diagnosis: Diagnosis) -> dict[str, str]:
    """The numbers that matter."""
    gap, error = diagnosis.gap, f"error over {diagnosis.gap.horizon_s} s"
    if diagnosis.effects:
        figures = {
            f"{error} before": f"{gap.before_m:.2f} m",
            "after": f"{gap.after_m:.2f} m",
            "floor, from noise alone": f"{gap.floor_m:.2f} m",
            "of the gap above the floor closed": percent(gap.closed) if gap.closed > 0.0 else "nothing",
        }
    else:
        figures = {error: f"{gap.before_m:.2f} m", "constant velocity": f"{gap.constant_velocity_m:.2f} m"}
        if gap.floor_m < gap.before_m:
            figures["floor, from noise alone"] = f"{gap.floor_m:.2f} m"
    figures["of the force range: tolerated model error"] = f"{percent(diagnosis.tolerance)}"
    return figures


def verdict_meaning(diagnosis: Diagnosis) -> str:
    """What the verdict means, and how errors are judged."""
    gap = diagnosis.gap
    part = (
        "used neither to name nor to fit effects"
        if diagnosis.remainder is None
        else "not used to fit the sizes of effects (which effects to name was decided on all)"
    )
    judged = (
        f"Errors are mean distances between predicted and measured tracks over {gap.held_out_windows} windows of "
        f"{gap.horizon_s} s that were {part}."
    )
    says = {
        "named": "Each named effect is significant, given the number of effects tried, and improves predictions of "
        "held-out legs.",
        "nothing_missing": "This is within the tolerances of the model and the sensors; the ranking below gives "
        "the size that each effect could have without being found.",
        "unknown": "A systematic remainder exceeds the noise; what it depends on is given below. No effect of the "
        "catalogue fits it.",
        "indistinguishable": "The effects listed together explain the trial equally well.",
    }
    if diagnosis.remainder is not None:
        says |= dict.fromkeys(
            ("named", "indistinguishable"),
            "The model is coarse: it lacks more than is named here. The named effects are found in most parts of "
            "the trial separately and improve predictions of held-out legs; the remainder is described below.",
        )
    after = " The manoeuvre that would best distinguish them is given below." if diagnosis.next_manoeuvre else ""
    return f"{says[diagnosis.verdict]}{after} {judged}"


def next_steps(diagnosis: Diagnosis, contradictions: Sequence[SensorContradiction] = ()) -> list[str]:
    """What the reader can do next, the most useful first; ``contradictions`` are those between the sensors."""
    sensors = plain_names(each for each in diagnosis.effects if each.kind == "sensor")
    steps = []
    if contradictions and not sensors:
        steps.append(
            "Correct the sensors first: without any ship model they contradict each other, as by "
            f"{join_words(list(dict.fromkeys(plain(each.effect) for each in contradictions)))} (see the end of "
            "this page). Then repeat the diagnosis, since forces may otherwise stand for them."
        )
    if sensors:
        steps.append(
            f"Check the sensors first ({join_words(sensors)}): correct their mounting, settings or timing if "
            "needed, and repeat the diagnosis, since the other effects may change."
        )
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
            "settings: those that it determines only with others are no measurement of the ship. With "
            "--no-identify, diagnose names effects of the model as it was."
        )
    if (diagnosis.remainder or diagnosis.unknown) is not None and diagnosis.identified is None:
        steps.append(
            "If many coefficients may be wrong, for example because they are another ship's, identify them first "
            "(--identify)."
        )
    if diagnosis.verdict == "nothing_missing":
        steps.append("Use the model as it is; the rest may be learned on top of it.")
    return steps


def _use_of_vessel(diagnosis: Diagnosis) -> list[str]:
    """What to do with the vessel file, where it has an effect of more than the sensors."""
    written = [each for each in diagnosis.effects if each.in_vessel]
    if all(each.kind == "sensor" for each in written):
        return []
    use = "Use the vessel file beside this page, vessel.toml: the model with the named effects."
    passing = dict.fromkeys(f"[effects.{each.name}]" for each in written if each.scope != "ship")
    if passing:
        use += f" It predicts this trial; for another, delete what is not the ship's own: {join_words([*passing])}."
    return [use]


def clock(time: str) -> str:
    """A time of UTC for people, to the minute.

    >>> clock("2026-09-01T12:40:29Z")
    '12:40 on 1 Sep'
    """
    at = datetime.fromisoformat(time)
    return f"{at:%H:%M} on {at.day} {at:%b}"


def when_words(when: When) -> str:
    """The part of a trial in which an effect has a size, at the beginning of a sentence.

    >>> when_words(When(recording="tuesday.mcap"))
    'In tuesday.mcap'
    """
    if when.recording is not None:
        return f"In {when.recording}"
    at = when.until or when.since or ""
    span = f"{clock(at)} UTC"
    if when.low is not None and when.high is not None:
        span += f" ({clock(when.low)[:5]} to {clock(when.high)[:5]})"
    return f"Until {span}" if when.until is not None else f"From {span} on"


def title_of(effect: NamedEffect) -> str:
    """An effect's name, with the part of the trial that its size is of."""
    if effect.drift is not None:
        return f"{plain(effect.name)}, at the end"
    if effect.when is None:
        return plain(effect.name)
    when = when_words(effect.when)
    return f"{plain(effect.name)}, {when[:1].lower()}{when[1:]}"


def left_with_recordings(diagnosis: Diagnosis) -> str:
    """What of it the vessel file does not have, or has as it is at the end; empty where nothing changes."""
    kept = {each.name for each in diagnosis.effects if each.in_vessel}
    partly = [each for each in diagnosis.effects if each.when is not None or each.drift is not None]
    gone, last = (plain_names(each for each in partly if (each.name in kept) is there) for there in (False, True))
    if not partly:
        return ""
    said = [f"no {join_words(gone, 'or')}"] if gone else []
    said += [f"the {join_words(last)} at the end of the trial"] if last else []
    return f"The vessel file has the ship's own effects at the end of the trial: {', and '.join(said)}."


def parameter_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """Each parameter of the named effects with its interval."""
    return [
        [title_of(each), parameter_title(name, estimate.unit), number(estimate.value), _span(estimate),
         "" if estimate.unit == "1" else estimate.unit]
        for each in diagnosis.effects
        for name, estimate in each.parameters.items()
    ]  # fmt: skip


def correlation_rows(correlation: Correlation) -> list[list[str]]:
    """How the estimates are correlated."""
    return [
        [name, *(f"{each:+.2f}".replace("-", "\u2212") for each in row)]
        for name, row in zip(correlation.names, correlation.matrix.tolist(), strict=True)
    ]


REGIMES_NOTE = (
    "A force in a regime is an observation, not an explanation. regimes.py has each regime as an effect: with "
    "--effects regimes.py the next diagnosis weighs it against all other effects."
)


def found_in(replicated: Replication) -> str:
    """In how many parts of the trial something is found."""
    return f"found separately in {replicated.found} of {replicated.parts} parts of the trial"


def certainty(effect: NamedEffect) -> str:
    """Family, share of the gap and how sure an effect is."""
    family = effect.family if effect.family == effect.kind else f"{effect.family}, {effect.kind}"
    return (
        f"{family}; {percent(effect.share_of_gap)} of the gap; by chance {chance(effect.p_value)}; "
        f"log evidence {number(effect.evidence)}; {found_in(effect.replicated)}"
    )


def dependence(where: Sequence[str]) -> str:
    """What something unknown depends on."""
    return join_words([DEPENDS.get(each, plain(each)) for each in where])


def titled_rungs(ladder: Ladder) -> dict[str, Interval]:
    """The mean distances of a comparison of calibrators, by title."""
    return {_rung_title(name): each for name, each in ladder.mean_distance_m.items()}


def _rung_title(name: str) -> str:
    return plain(name.replace("_calibrated", ", calibrated"))


def ladder_rows(ladder: Ladder) -> tuple[list[list[str]], int]:
    """A row a rung, and which is the best."""
    rows = [[_rung_title(name), number(each.value), _span(each) if isfinite(each.low) else "", _gain(ladder, name)]
            for name, each in ladder.mean_distance_m.items()]  # fmt: skip
    return rows, min(range(len(rows)), key=lambda row: list(ladder.mean_distance_m.values())[row].value)


def ladder_sentence(ladder: Ladder) -> str:
    """What a calibrator adds, and whether the named effects help it, in one sentence; or why this is not known."""
    rungs = ladder.mean_distance_m
    if not rungs:
        return f"No calibrator was trained: {ladder.why_not}."
    errors = {name: f"{number(each.value)} m" for name, each in rungs.items()}
    reference = f"On held-out legs the error of the reference is {errors['reference']}"
    if "named" not in rungs:
        change = change_of(ladder.ratio("reference_calibrated", "reference"))
        return f"{reference}, with a calibrator {errors['reference_calibrated']}: {change}."
    ratio = ladder.ratio("named_calibrated", "reference_calibrated")
    helps = "the named effects help the calibrator"
    if ratio.low > 1.0:
        helps = "the named effects do not help the calibrator"
    elif not ratio.high < 1.0:
        helps = "these legs do not show that the named effects help the calibrator"
    return (
        f"{reference}, with the named effects {errors['named']}, with a calibrator "
        f"{errors['reference_calibrated']}, with both {errors['named_calibrated']}: {helps}, {change_of(ratio)}."
    )


def change_of(ratio: Interval | Ratio) -> str:
    """A ratio of errors in words, with its 95 % interval.

    >>> change_of(Interval(0.8, 0.7, 0.9)), change_of(Interval(0.98, 0.95, 1.02))
    ('20 % less error (10 to 30 %)', '2 % less error (5 % less to 2 % more)')
    """
    value, low, high = (each - 1.0 for each in (ratio.value, ratio.low, ratio.high))
    words = f"{percent(abs(value))} {'more' if value > 0.0 else 'less'} error"
    if not (isfinite(low) and isfinite(high)):
        return words
    if low * high > 0.0:
        near, far = sorted((abs(low), abs(high)))
        return f"{words} ({percent(near).removesuffix(' %')} to {percent(far)})"
    return f"{words} ({percent(-low)} less to {percent(high)} more)"


def _gain(ladder: Ladder, name: str) -> str:
    base = name.removesuffix("_calibrated")
    return change_of(ladder.ratio(name, base)) if name != base else ""


def cell_row(place: GapCell) -> list[str]:
    """A cell of the map."""
    from seatrial.hybrid.report.diagnosis_map_plots import axis_title, cell_name, quantity_of

    cell = f"{axis_title(quantity_of(place))}: {cell_name(place)}"
    z = f"{place.z:.1f}".replace("-", "\u2212")
    return [quantity_title(place.channel), cell, str(place.windows), number(place.error), z]


def suspect_rows(suspects: Sequence[Suspect]) -> list[list[str]]:
    """The catalogue ranked, each effect alone in the model."""
    return [
        [plain(each.name), each.family, number(each.evidence), chance(each.p_value), _smallest_found(each)]
        for each in suspects
    ]


def _smallest_found(suspect: Suspect) -> str:
    """How large an effect must be to be found; where there is no wind, for one, its effects are not at any size."""
    if not 0.0 < suspect.limit < inf:
        return "" if suspect.limit != suspect.limit else "not by this trial"
    return f"{number(suspect.limit)} {'' if suspect.unit == '1' else suspect.unit}".strip()


def granted_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """What the verdict rests on: tolerance and provenance; what was not asked for is left out."""
    extent = diagnosis.provenance.get("force_range")
    rows = [["tolerance", f"{percent(diagnosis.tolerance)} of the range of the forces in the trial"]]
    if extent:
        size_n, unit = force_unit(diagnosis.tolerance * max(extent.values()))
        own = [number(diagnosis.tolerance * extent[name] / size_n) for name in ("surge_n", "sway_n", "yaw_nm")]
        rows.append(["which is", f"{own[0]} {unit} ahead, {own[1]} {unit} across, {own[2]} {unit} m in yaw"])
    for key, value in diagnosis.provenance.items():
        if key not in ("force_range", "noise") and value not in (False, "0..100"):
            rows.append([plain(str(key)), _done(value) if key in ("repaired", "left_out") else _words(value)])
    return rows


def _done(text: str) -> str:
    """What was done to each file, with the names of files as they are and those of channels in words."""
    parts = (each.partition(": ") for each in text.split("; "))
    return "; ".join(f"{file}{colon}{in_words(said)}" for file, colon, said in parts)


def noise_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """Levels of noise, as the data have them: standard deviations in the units of the channels."""
    noise, turn = diagnosis.provenance["noise"], 180.0 / pi
    size_n, unit = force_unit(max(*noise["gust"][:2], *noise["slow"][:2]))
    forces = (("ahead", 1.0 / size_n, unit), ("across", 1.0 / size_n, unit), ("in yaw", 1.0 / size_n, f"{unit} m"))
    swing = (("north", 1.0, "m"), ("east", 1.0, "m"), ("in yaw", turn, "deg"))
    sensors = (
        ("positions", 1.0, "m"), ("heading", turn, "deg"), ("surge", 1.0, "m/s"), ("sway", 1.0, "m/s"),
        ("yaw rate", turn, "deg/s"),
    )  # fmt: skip
    white = [noise[name] for name in ("position_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")]

    def lasting(levels: str, name: str) -> str:
        return f"{levels}; time constant {number(noise[name])} s"

    rows = [
        ["sensors, anew each second", _levels(white, sensors)],
        ["gusts, anew each second", _levels(noise["gust"], forces)],
        ["slow forces", lasting(_levels(noise["slow"], forces), "slow_s")],
    ]
    if any(noise["waves"]):
        period_s, towards_deg = 2.0 * pi / noise["wave_frequency_radps"], noise["wave_towards_rad"] * turn % 360.0
        levels = _levels(noise["waves"], swing)
        rows.append(["wave motion", f"{levels}; period {number(period_s)} s, towards {towards_deg:.0f} deg"])
    if noise.get("wave_drift_n"):
        beam = f"{number(noise['wave_drift_n'] / size_n)} {unit} in beam sea"
        rows.append(["slow drift of the waves", lasting(beam, "wave_drift_s")])
    if any(noise["drift"]):
        rows.append(["slow errors of sensors", lasting(_levels(noise["drift"], sensors), "drift_s")])
    return rows


def _levels(values: Sequence[float], units: Sequence[tuple[str, float, str]]) -> str:
    """Levels in their units, each with what it is of; those that are none are left out."""
    told = zip(values, units, strict=True)
    return ", ".join(f"{name} {number(value * factor)} {unit}" for value, (name, factor, unit) in told if value)


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{plain(str(key))} {_words(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_words(each) for each in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value) if isinstance(value, float) else str(value)


def plain_names(effects: Iterable[NamedEffect]) -> list[str]:
    """The effects' names for people, each once."""
    return list(dict.fromkeys(plain(each.name) for each in effects))


def effect_names(effects: Sequence[NamedEffect]) -> str:
    """The effects' names at the beginning of a sentence."""
    return join_words(plain_names(effects)).capitalize()


def file_rows(effects: Sequence[NamedEffect]) -> list[list[str]]:
    """The lines that a vessel file has for them."""
    return [[f"[effects.{each.name}]", f"{name} = {number(estimate.value)}", estimate.unit]
            for each in effects for name, estimate in each.parameters.items()]  # fmt: skip


def _span(interval: Estimate | Interval) -> str:
    return f"{number(interval.low)} to {number(interval.high)}"


PAGE_FILE = "report.html"


def write_report(diagnosis: Diagnosis, extras: Extras, folder: Path) -> Path:
    """Write the page into ``folder`` and return its path. Raises :class:`StorageError`."""
    return page_of(diagnosis, extras).write(folder / PAGE_FILE)


def page_of(diagnosis: Diagnosis, extras: Extras) -> Page:
    """The page, not yet written."""
    known = diagnosis.provenance
    vessel = f"vessel {known['vessel']}" if "vessel" in known else ""
    parts = ["Diagnosis", str(known.get("recordings", "")), vessel]
    return render(
        "diagnosis.html", templates=templates(), title=verdict_sentence(diagnosis),
        subtitle="; ".join(each for each in parts if each), diagnosis=diagnosis, extras=extras,
    )  # fmt: skip


_VERDICTS = {
    "named": "The model lacks these effects:",
    "nothing_missing": "Nothing is missing beyond the tolerance.",
    "unknown": "Something is missing that no effect of the catalogue explains.",
    "indistinguishable": "Something is missing, but these data cannot distinguish several possible causes.",
}


def summary(diagnosis: Diagnosis, ladder: Ladder | None = None) -> Group:
    """The diagnosis in some lines, and what a calibrator adds where one was trained."""
    lines = [] if diagnosis.identified is None else [Text(correction_sentence(diagnosis.identified))]
    lines.append(Text(_VERDICTS[diagnosis.verdict], style="bold"))
    lines += [Text(f"- {each.sentence}") for each in diagnosis.effects]
    names = [each.name for each in diagnosis.effects]
    for group in diagnosis.indistinguishable:
        lines.append(Text(f"These data cannot distinguish {alternatives(group, names, 'from')}."))
    left = diagnosis.unknown or diagnosis.remainder
    if left is not None:
        lines.append(Text(f"What remains looks like {left.looks_like}."))
    lines += [Text(f"- {each.sentence}") for each in diagnosis.regimes]
    if diagnosis.regimes:
        lines.append(Text(REGIMES_NOTE))
    gap = diagnosis.gap
    if gap.held_out_windows:
        where = f"Mean distance over {gap.horizon_s} s on {gap.held_out_windows} held-out windows"
        lines.append(Text(f"{where}: {gap.distances(bool(diagnosis.effects))}."))
    if ladder is not None:
        lines.append(Text(ladder_sentence(ladder)))
    if diagnosis.next_manoeuvre is not None:
        lines.append(Text(f"Next: {diagnosis.next_manoeuvre.what}"))
    lines += [Text(f"note: {each}", style="dim") for each in other_remarks(diagnosis)]
    return Group(*lines)
