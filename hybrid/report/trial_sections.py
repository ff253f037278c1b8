"""What a trial's report says of a case in words and rows; ``templates/trial.html`` puts it onto the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError
from seatrial.analysis.conditions import recorded_conditions
from seatrial.analysis.manoeuvres.criteria import (
    NOT_FOR_SHIP,
    RESOLUTION,
    IndexRow,
    Mean,
    condition_shortfalls,
    headline_of_criteria,
)
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.products import Products
from seatrial.analysis.report.manoeuvre_plots import PICTURED
from seatrial.analysis.report.pages import counts_of, events_of
from seatrial.analysis.report.tables import (
    UNKNOWN,
    condition_rows,
    file_rows,
    has_date,
    in_words,
    index_cells,
    left_out_line,
    plain_name,
    ship_rows,
)
from seatrial.analysis.series import is_assumed
from seatrial.analysis.speed_power.report import sentence
from seatrial.hybrid.prediction.scores import TWO_SIDED
from seatrial.hybrid.report.case import Case
from seatrial.hybrid.report.diagnosis_map_plots import axis_title
from seatrial.hybrid.report.errors import Calibration, Residuals, largest_residuals
from seatrial.hybrid.report.tables import score_rows
from seatrial.hybrid.report.trial_form import NumberedRun
from seatrial.hybrid.report.words import join_words, plain, quantity_title

if TYPE_CHECKING:
    from seatrial.analysis.quality.findings import Finding
    from seatrial.hybrid.calibrators.adaptive.parameters import AdaptedParameter, Parameters
    from seatrial.hybrid.calibrators.calibrator import DomainOfApplicability
    from seatrial.hybrid.evaluation.manoeuvre_indices import IndexComparisons
    from seatrial.hybrid.evaluation.validate import Validation

INTERACTIVE = "interactive"
MOST_PICTURES = 6
"""Manoeuvres that have a picture in the report: three on a sheet; the page to zoom into has all."""
MOST_ROWS = 40
"""Rows of the page of indices: more do not stand on one sheet."""
MOST_FINDINGS = 14
_OVERLAP = {
    "nothing": "No method was trained on these recordings.",
    "another part": "The calibrator was trained on another part of the same recordings.",
    "some": "The calibrator was trained on some of these data.",
}
_SECONDS = (1, 5, 10, 15, 20, 30, 45, 60)


def ship_name(case: Case) -> str:
    """The ships that the recordings name, as people call them."""
    titles = [title for name in case.products if (title := _title_of(case, name))]
    return join_words(list(dict.fromkeys(titles))) if titles else "an unnamed ship"


def unknown_ship(case: Case) -> str:
    """What a ship without a name or dimensions costs the report, and what to do; empty where both are known."""
    if all(case.ship(name) is not None for name in case.products):
        return ""
    costs = "Without its length no index is given in ship lengths, and no limit in lengths is judged."
    named = {each.recording.trial.vessel: None for each in case.products.values() if each.recording.trial.vessel}
    if not named:
        to_do = "Please have it imported again with the ship's name."
        return f"The recording does not say which ship this is. {costs} {to_do}"
    ships = join_words(list(named))
    return (
        f"The main dimensions of {ships} are not known, as there is no vessel file of that name. {costs} "
        "Please have the length between perpendiculars given for this report."
    )


def _title_of(case: Case, name: str) -> str:
    ship = case.ship(name)
    return (ship.title if ship else "") or case.products[name].recording.trial.vessel


def subtitle(case: Case) -> str:
    """When and where, in a line below the title."""
    first = next(iter(case.products.values()))
    trial, start = first.recording.trial, first.one_hz.index[0]
    several = f"{len(case.products)} recordings" if len(case.products) > 1 else ""
    date = f"{start:%d %B %Y}".lstrip("0") if has_date(start) else ""
    return ", ".join(filter(None, (trial.name, trial.place, date, several)))


def criteria_headline(case: Case) -> str:
    """What the trial shows of the standards in a sentence, or that they are not for such a ship or such tests."""
    rows = [row for vessel_rows in case.index_rows.values() for row in vessel_rows]
    if not rows:
        return "No standard manoeuvre was found in this trial, so there are no indices of manoeuvrability."
    if not case.criteria:
        tests = len({row.place for row in rows})
        return f"No test of IMO {RESOLUTION} was made; {tests} other test{'s' * (tests != 1)} measured."
    sentences = {vessel: headline_of_criteria(results) for vessel, results in case.criteria.items()}
    if len(sentences) == 1:
        return next(iter(sentences.values()))
    return " ".join(f"{vessel_title(case, vessel)}: {sentence}" for vessel, sentence in sentences.items())


def vessel_title(case: Case, vessel: str) -> str:
    """What people call a ship that recordings name."""
    names = (name for name, products in case.products.items() if products.recording.trial.vessel == vessel)
    return _title_of(case, next(names)) or "an unnamed ship"


def verdict_of(case: Case) -> str:
    """The result in one sentence, and one more of the speed at power where that was tried."""
    found = case.speed_power
    if found is None:
        return criteria_headline(case)
    return " ".join([*([criteria_headline(case)] if case.runs else []), sentence(found)])


def index_line(row: IndexRow) -> dict[str, Any]:
    """The cells of an index: its name with the unit, and by side its mean and interval.

    A test without sides has its mean under ``""``.
    """
    unit = next(iter(row.sides.values())).index.unit
    name = f"{plain_name(row.name)} [{unit}]" if unit else plain_name(row.name)
    return {
        "name": name,
        "judged": row.judged_side,
        "sides": {side: _mean_cells(each) for side, each in row.sides.items()},
    }


def _mean_cells(each: Mean) -> tuple[str, str]:
    value, interval, lengths, _ = index_cells(each.index)
    value = value.removesuffix(f" {each.index.unit}") + "\u2020" * each.removed
    value += f" ({lengths} L)" if lengths else ""
    dashed = interval if "-" in interval else interval.replace(" to ", "\u2013")
    return value + (f", {each.runs} runs" if each.runs > 1 else ""), dashed


def has_removed(rows: Sequence[IndexRow]) -> bool:
    """Whether the current is removed from any of the values."""
    return any(each.removed for row in rows for each in row.sides.values())


def has_two_runs(rows: Sequence[IndexRow]) -> bool:
    """Whether a value is the mean of two runs."""
    return any(each.runs == 2 for row in rows for each in row.sides.values())


_TESTED_SHARE = 0.25  # the rest is approach, between tests


def recordings_to_draw(case: Case) -> dict[str, Products]:
    """The recordings whose track and channels are drawn: a single one, and those that are not mostly tests."""
    return {name: made for name, made in case.products.items()
            if len(case.products) == 1 or _tested_share(made) < _TESTED_SHARE}  # fmt: skip


def _tested_share(products: Products) -> float:
    """The fraction of a recording's time in which a manoeuvre is made that has a picture of its own."""
    drawn = (run for run in products.manoeuvres if run.kind in PICTURED)
    tested_s = sum((run.end - run.start).total_seconds() for run in drawn)
    return tested_s / max(len(products.one_hz), 1)


def pictured(runs: Sequence[NumberedRun], rows: Sequence[IndexRow], most: int = MOST_PICTURES) -> list[NumberedRun]:
    """The runs that have a page: the first of each name and side, those with criteria before others."""
    judged = {row.test.partition(" at ")[0].lower() for row in rows if row.result}
    first = {
        (run.manoeuvre.name, run.manoeuvre.side): run for run in reversed(runs) if run.manoeuvre.kind in PICTURED
    }
    ordered = sorted(first.values(), key=lambda run: (run.manoeuvre.name.lower() not in judged, run.number))
    return sorted(ordered[:most], key=lambda run: run.number)


def sheets_of(case: Case) -> list[NumberedRun]:
    """The runs of a trial that have a sheet of their own."""
    return pictured(case.runs, [row for rows in case.index_rows.values() for row in rows])


def common_notes(shown: Sequence[Manoeuvre]) -> list[str]:
    """What is to be known of all of several manoeuvres, which their captions then leave out."""
    if len(shown) < 2:
        return []
    return [note for note in dict.fromkeys(shown[0].notes) if all(note in each.notes for each in shown)]


def picture_caption(each: Manoeuvre, common: Sequence[str] = ()) -> str:
    """The approach of a manoeuvre, the drift that was removed and what is to be known that is not ``common``."""
    said = []
    if "approach_mps" in each.settings:
        heading_deg = round(each.settings["approach_heading_deg"]) % 360
        said.append(f"Approach at {each.settings['approach_mps']:.2f} m/s on {heading_deg:03d}°")
    if each.current is not None:
        drift = each.current.as_json()
        said.append(f"drift {drift['speed_mps']:.2f} m/s towards {drift['direction_deg']:.0f}°")
    words = "; ".join([*said, *(note for note in each.notes if note not in common)])
    return f"{words}." if words else ""


def ship_facts(case: Case, vessel: str) -> list[tuple[str, str]]:
    """The particulars of a ship and her loading, as far as they are known."""
    return _without_unknown(_ship_rows(case, vessel))


def condition_facts(case: Case, vessel: str) -> list[tuple[str, str]]:
    """When, where and in what weather a ship's trial was made, as far as that is known."""
    return _without_unknown(_condition_rows(case, vessel))


def unstated(case: Case, vessel: str) -> list[str]:
    """What nobody stated of a ship and the conditions of her trial."""
    rows = [*_ship_rows(case, vessel), *_condition_rows(case, vessel)]
    return [label for label, value in rows if value == UNKNOWN]


def _without_unknown(rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    return [row for row in rows if row[1] != UNKNOWN]


def _ship_rows(case: Case, vessel: str) -> list[tuple[str, str]]:
    runs = _runs_of_vessel(case, vessel)
    return _pooled(
        ship_rows(made.recording.trial, made.one_hz, runs, case.ship(name))
        for name, made in _of_vessel(case, vessel).items()
    )


def _condition_rows(case: Case, vessel: str) -> list[tuple[str, str]]:
    runs = _runs_of_vessel(case, vessel)
    return _pooled(
        condition_rows(made.recording, made.one_hz, runs, case.ship(name))
        for name, made in _of_vessel(case, vessel).items()
    )


def indices_of_sheets(case: Case) -> IndexComparisons:
    """The indices of the model for the tests that have a sheet; the page would be long with all."""
    starts = {run.manoeuvre.start for run in sheets_of(case)}
    return replace(case.indices, rows=tuple(row for row in case.indices.rows if row.start in starts))


MOST_LEFT_OUT = 12


def left_out_lines(case: Case) -> list[str]:
    """Why nothing could be looked for, and what only began like a test; of many the first, and how many more."""
    several = len(case.products) > 1
    lines = [
        (f"{name}: " if several else "") + in_words(line)
        for name, made in case.products.items()
        for line in (*made.shortfalls, *map(left_out_line, made.left_out))
    ]
    more = len(lines) - MOST_LEFT_OUT
    return [*lines[:MOST_LEFT_OUT], *([f"{more} more in the output of manoeuvres"] if more > 0 else [])]


def standard_conditions(case: Case, vessel: str) -> list[list[str]]:
    """The conditions that the standards ask of a trial, each with whether it was fulfilled in all recordings with a
    test, or the first reason why not; none of a ship that the standards are not for."""
    shortfalls: dict[str, list[str]] = {}
    for name, made in _of_vessel(case, vessel).items():
        if not any(_is_judged(run) for run in made.manoeuvres):
            continue
        drifts = [run.current.as_json()["speed_mps"] for run in made.manoeuvres if run.current is not None]
        seen = Conditions(current_mps=max(drifts, default=None), length_m=case.length_of(name))
        conditions = recorded_conditions(made.recording.trial, made.table).with_known(seen)
        for asked, shortfall in condition_shortfalls(conditions).items():
            shortfalls.setdefault(asked, []).append(shortfall)
    return [[asked, next(filter(None, reasons), "fulfilled")] for asked, reasons in shortfalls.items()]


def _is_judged(run: Manoeuvre) -> bool:
    judged = [index for index in run.indices.values() if index.result]
    return any(not any(reason.startswith(NOT_FOR_SHIP) for reason in index.missing) for index in judged)


def length_of_vessel(case: Case, vessel: str) -> float | None:
    """The length between perpendiculars of a ship that recordings name [m], None where it is not known."""
    return next((case.length_of(name) for name in _of_vessel(case, vessel)), None)


def _runs_of_vessel(case: Case, vessel: str) -> list[Manoeuvre]:
    return [run for made in _of_vessel(case, vessel).values() for run in made.manoeuvres]


def vessels_of(case: Case) -> list[str]:
    """The ships that the recordings name."""
    return list(dict.fromkeys(made.recording.trial.vessel for made in case.products.values()))


def _of_vessel(case: Case, vessel: str) -> dict[str, Products]:
    return {name: made for name, made in case.products.items() if made.recording.trial.vessel == vessel}


_MOST_VALUES = 3  # of several recordings in one row


def _pooled(sheets: Iterable[list[tuple[str, str]]]) -> list[tuple[str, str]]:
    """The rows of several run sheets in one; what is not known of one is left to the others."""
    values: dict[str, list[str]] = {}
    for label, value in (row for sheet in sheets for row in sheet):
        values.setdefault(label, []).append(value)
    rows = []
    for label, repeated in values.items():
        distinct = list(dict.fromkeys(repeated))
        stated = [value for value in distinct if value != UNKNOWN and not value.startswith("unknown")]
        shown = stated or distinct[:1]
        if len(shown) <= _MOST_VALUES:  # what differs from test to test is in the programme
            rows.append((label, "; ".join(shown)))
    return rows


def paired(rows: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Rows of two cells as rows of four, the second half beside the first; a last one of its own where it is odd.

    >>> paired([("a", "1"), ("b", "2"), ("c", "3")])
    [['a', '1', 'c', '3'], ['b', '2', '', '']]
    """
    half = (len(rows) + 1) // 2
    return [[*rows[row], *(rows[row + half] if row + half < len(rows) else ("", ""))] for row in range(half)]


def metres_text(distance_m: float) -> str:
    """A distance to three digits, centimetres from 1 m on.

    >>> metres_text(12.346), metres_text(0.08519)
    ('12.35 m', '0.0852 m')
    """
    return f"{distance_m:.2f} m" if distance_m >= 1.0 else f"{distance_m:.3g} m"


def headline(case: Case) -> dict[str, str]:
    """The mean distance of each method, and what the calibrator gains."""
    judged = case.validation
    figures = {
        f"{plain(name)}, mean distance over {judged.windows.horizon_s} s": metres_text(score.mean_distance_m)
        for name, score in judged.scores.items()
        if name in ("constant_velocity", "reference", "hybrid")
    }
    if judged.reduction is not None and judged.coverage_95 is not None:
        figures["less error than the reference"] = f"{judged.reduction:.0%}"
        figures["of positions inside the 95 % regions"] = f"{judged.coverage_95:.0%}"
    return figures


def model_sentence(case: Case) -> str:
    """What the simulation model is worth on this trial, beside a ship that goes on as she does."""
    judged, scores = case.validation, case.validation.scores
    mine, kept = (scores[name].mean_distance_m for name in (case.best, "constant_velocity"))
    named = any(each.recording.trial.vessel for each in case.products.values())
    doubted = f"the model {case.model.name}{', which is not of this ship,' if named else ''}"
    whose = doubted if case.model.doubt else "the ship's simulation model"
    with_it = " with what the calibrator learned" if case.best == "hybrid" else ""
    gain = f"is {1.0 - mine / kept:.0%} better" if mine < kept else f"has {mine / kept:.3g} times that error"
    overlap = "" if case.trained is None else f" {_OVERLAP[case.training_overlap]}"
    horizon_s = judged.windows.horizon_s
    return (
        f"In {len(judged.windows):,} predictions with steady controls, {whose}{with_it} has a mean error of "
        f"{metres_text(mine)} over {horizon_s} s. With constant speed and rate of turn the error would be "
        f"{metres_text(kept)}: the model {gain}.{overlap}"
    )


def fans_caption(case: Case) -> str:
    """What the picture of predictions shows."""
    judged = case.validation
    of = f" of {case.most_judged}" if len(case.products) > 1 else ""
    ends = "at their ends, with the 95 % region and, for normal errors, the 50 % region"
    three = "whole" if judged.region_m is None else ends
    return (
        f"Predictions of {judged.windows.horizon_s} s over the measured track{of}; beside it the errors of all "
        f"predictions, positive ahead and to starboard; below three of them {three}."
    )


def model_words(case: Case) -> str:
    """Which model the reference is, of which ship the recordings are, and what the hybrid is."""
    whose = f"not of {ship_name(case)}" if case.model.doubt else "of this ship"
    words = f"The reference model is {case.model.name}, {whose}."
    if case.trained is None:
        return words
    trained, count = case.trained, len(case.trained.sources)
    return (
        f"{words} The hybrid is the calibrator {plain(trained.calibrator.method)}, trained on {count} "
        f"recording{'s' * (count != 1)} ({trained.metrics.get('windows', 0):,} windows of {trained.horizon_s} s, "
        f"{trained.trained_at:%Y-%m-%d})."
    )


def doubt_of(case: Case) -> str:
    """What of the data is in doubt, in a sentence; empty where nothing is."""
    doubtful = [products for products in case.products.values() if _doubtful_channels(products)]
    if not doubtful:
        return ""
    codes = dict.fromkeys(plain(finding.code) for products in doubtful for finding in products.quality.findings)
    who = f"{len(doubtful)} of {len(case.products)} recordings have"
    if len(case.products) == 1:
        who = f"{len(_doubtful_channels(doubtful[0]))} of {len(doubtful[0].quality.channels)} channels have"
    return f"{who} quality findings ({join_words(list(codes))}); see the appendix for findings and repairs."


def _doubtful_channels(products: Products) -> list[str]:
    channels = products.quality.channels
    return [name for name in channels if channels[name].grade != "good"]


def finding_rows(products: Products) -> list[list[str]]:
    """What was found in the data, a row a kind: what, where, in words, and what was put right of it."""
    repaired: dict[str, list[str]] = {}
    for repair in products.repairs:
        repaired.setdefault(repair.code, []).append(f"{in_words(repair.text)} ({repair.changed:,} values)")
    found: dict[str, list[Finding]] = {}
    for each in products.quality.findings:
        found.setdefault(each.code, []).append(each)
    return [
        [plain(code), ", ".join(dict.fromkeys(in_words(each.channel) for each in alike)), in_words(alike[0].text),
         "; ".join(repaired.get(code, [])[:2]) or "\u2013"]
        for code, alike in list(found.items())[:MOST_FINDINGS]
    ]  # fmt: skip


def alike_in_quality(case: Case) -> list[tuple[list[str], Products]]:
    """The recordings by what is to be said of their data: those in order together, the others one by one."""
    groups: list[tuple[list[str], Products]] = []
    sound: list[str] | None = None
    for name, products in case.products.items():
        is_sound = products.recording.closed and not (
            finding_rows(products) or products.quality.missing or products.recording.health or event_rows(products)
        )
        if is_sound and sound is not None:
            sound.append(name)
            continue
        groups.append(([name], products))
        sound = groups[-1][0] if is_sound else sound
    return groups


def recording_rows(case: Case) -> list[list[str]]:
    """The files that the report is made from."""
    rows = (dict(file_rows(products.recording)) for products in case.products.values())
    return [[row["recording"], row["SHA-256"], row["closed properly"]] for row in rows]


CHANNEL_HEADER = ["channel", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range",
                  "interval [s]", "longest [s]", "grade"]  # fmt: skip


def channel_rows(products: Products, *, every: bool = True) -> list[list[str]]:
    """A row a channel, every one or those in doubt: how many samples, how even their times, what was found."""
    rows = []
    doubtful = _doubtful_channels(products)
    for name, each in products.quality.channels.items():
        if is_assumed(products.table, name) or not (every or name in doubtful):
            continue
        series = products.recording.series.get(name)
        steps = np.diff(np.sort(series.measured_ns)) / 1e9 if series is not None else np.array([])
        spread = [f"{np.median(steps):.3f}", f"{steps.max():.2f}"] if steps.size else ["", ""]
        rows.append([in_words(name), *counts_of(each)[:6], *spread, each.grade])
    return rows


def source_rows(products: Products) -> list[list[str]]:
    """Frames by source, and what was refused or dropped on the way, as the recorder counted."""
    return [
        [name, str(each.get("state", "")), f"{each.get('frames', 0):,}", f"{each.get('rejected', 0):,}",
         ", ".join(f"{count:,} {reason}" for reason, count in (each.get("reasons") or {}).items()),
         f"{each.get('dropped', 0):,}"]
        for name, each in products.recording.health.items()
    ]  # fmt: skip


def event_rows(products: Products) -> list[list[str]]:
    """The events of a recording, in words."""
    return [[time, in_words(text)] for time, text in events_of(products.recording)]


def baseline_rows(case: Case) -> tuple[list[list[str]], int]:
    """Every method on windows that none has seen, and the best one's row."""
    judged = case.validation
    rows, best = score_rows(judged)
    against = [
        f"{each.mean_distance_m / scores[reference].mean_distance_m - 1.0:+.1%}".replace("-", "\u2212")
        for scores, reference in ((judged.scores, "reference"), (judged.two_sided, f"reference{TWO_SIDED}"))
        for each in scores.values()
    ]
    return [[plain(name), *row, less] for (name, *row), less in zip(rows, against, strict=True)], best


def baseline_words(case: Case) -> str:
    """On what the table of methods rests."""
    judged = case.validation
    legs = len(np.unique(judged.windows.leg))
    words = (
        f"Mean errors over {len(judged.windows)} held windows of {judged.windows.horizon_s} s in {legs} "
        f"leg{'s' * (legs != 1)}, one every {case.stride_s} s. A causal start state is estimated from earlier "
        "measurements only, a two-sided one also from later ones, for comparison. Constant velocity keeps "
        f"surge, sway and yaw rate constant. {_dropped(case)}"
    )
    if case.trained is None:
        return words
    return (
        f"{words} Data driven is a neural network without a model. Networks do "
        "not predict the heading: it is the reference's, or for data driven that of the present yaw rate."
    )


def _dropped(case: Case) -> str:
    """How many windows were tried, and why the others are not judged."""
    dataset = case.dataset
    reasons = ", ".join(f"{count:,} {plain(reason)}" for reason, count in dataset.dropped.items() if count)
    return f"Of {dataset.candidates:,} windows these were left out: {reasons}." if reasons else ""


def calibration_table(calibration: Calibration) -> tuple[list[str], list[list[str]]]:
    """Coverage and width of the 95 % regions by second of the prediction: header and rows."""
    seconds = [each for each in _SECONDS if each <= len(calibration.picp)]
    widths = (calibration.pinaw[each - 1] for each in seconds)
    return ["", *(f"{each} s" for each in seconds)], [
        ["inside, PICP [%]", *(f"{100 * calibration.picp[each - 1]:.1f}" for each in seconds)],
        ["width relative to the mean distance sailed, PINAW [1]",
         *(f"{width:.3f}" if np.isfinite(width) else "\u2013" for width in widths)],
    ]  # fmt: skip


def fallback_words(judged: Validation, training: DomainOfApplicability) -> str:
    """How many windows start beyond the training, in what, and which baseline speaks there."""
    names = [name for name, column in zip(training.names, training.outside.T, strict=True) if column.any()]
    spoke = ", ".join(f"{plain(name)} in {count}" for name, count in (judged.fallback or {}).items())
    where = f", in {join_words([quantity_title(name) for name in names])}" if names else ""
    beyond = 0 if judged.outside_domain is None else int(judged.outside_domain.sum())
    return (
        f"{beyond} of {len(judged.windows)} windows start too far outside the calibrator's training "
        f"range{where}; there a baseline predicts: {spoke}."
    )


def outside_words(judged: Validation, training: DomainOfApplicability) -> str:
    """How many windows lie outside the range of the training itself, and in what."""
    past = [name for name, column in zip(training.names, training.outside_range.T, strict=True) if column.any()]
    count = int(training.outside_range.any(axis=1).sum())
    return (
        f"{count} of {len(judged.windows)} windows are outside the training range"
        + (f", in {join_words([quantity_title(name) for name in past])}" if past else "")
        + "; up to the dashed limits a model may extrapolate."
    )


def parameter_warnings(learned: Parameters) -> list[str]:
    """Which parameters lie at a bound, and which cannot be told apart."""
    warnings = []
    at_bound = [each.name for each in learned.every if each.at_bound]
    if at_bound:
        warnings.append(f"At a bound: {', '.join(at_bound)}.")
    pairs = learned.entangled()
    if pairs:
        words = ", ".join(f"{one} with {other} ({value:+.2f})" for one, other, value in pairs[:6])
        warnings.append(f"Cannot be distinguished: {words}{', and more' if len(pairs) > 6 else ''}.")
    return warnings


def parameter_rows(parameters: Sequence[AdaptedParameter]) -> list[list[str]]:
    """Value, standard error, interval and a remark of each."""
    return [
        [each.name, f"{each.value:.4g}", f"\u00b1 {each.error:.2g}", f"{each.low:.4g} to {each.high:.4g}",
         each.unit, "at its bound" if each.at_bound else "" if each.identified else "not determined"]
        for each in parameters
    ]  # fmt: skip


def write_interactive_pages(case: Case, folder: Path | str) -> dict[str, str]:
    """A page to zoom into for each recording, in ``folder``: what they are called and where, for links."""
    from seatrial.analysis.report.interactive import interactive_page

    pages = {}
    for trial, products in case.products.items():
        windows = products.window_rows
        page = Path(folder) / (f"{INTERACTIVE}.html" if len(case.paths) == 1 else f"{INTERACTIVE}_{trial}.html")
        predicted = {} if windows is None or case.why_not else case.predicted(trial)
        try:
            interactive_page(
                products.one_hz, windows, predicted, products.manoeuvres, trial, products.recording.path.name
            ).write(page)
        except (ConfigurationError, DataShortageError):
            continue  # without plotly, or without a row: the report stands without it
        what = "interactive track and channels" + (f", {trial}" if len(case.paths) > 1 else "")
        pages[what] = page.name
    return pages


_UNITS = {"surge_mps2": "m/s\u00b2", "sway_mps2": "m/s\u00b2", "yaw_dps2": "deg/s\u00b2"}


def residual_sentences(residuals: Residuals) -> list[str]:
    """What the maps of a trial say, a sentence an acceleration in which something stands out."""
    sentences = []
    for each in largest_residuals(residuals):
        words, unit = each.acceleration.partition("_")[0], _UNITS[each.acceleration]
        quantity, _, of = axis_title(each.quantity).rstrip("]").partition(" [")
        mean, low, high = (
            np.format_float_positional(value, 2, fractional=False, trim="-", sign=True)
            for value in (each.mean, each.mean - each.half_width, each.mean + each.half_width)
        )
        sentences.append(
            f"By {quantity}, the missing {words} acceleration from {each.low:g} to {each.high:g} {of} is "
            f"{mean} {unit} (95 % interval {low} to {high}; {each.seconds} s).".replace("-", "\u2212")
        )
    return sentences or ["The missing acceleration is not significant in any class of any quantity."]
