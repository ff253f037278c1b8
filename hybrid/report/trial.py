"""The case behind a trial's report, and what the report says of it in words and rows.

A :class:`TrialCase` has the recordings, the model and perhaps a calibrator; analysis, predictions, residuals and
parameters are computed when they are first needed, so that a notebook that shows less does less.
``templates/trial.html`` puts words and rows onto the page.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.config import declarations, run_sheet
from seatrial.acquisition.core import errors
from seatrial.acquisition.core.ship import MOTION
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_trial
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.manoeuvres import criteria, find
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.products import Options, Products, analyse_recording
from seatrial.analysis.quality.wind import recorded_conditions
from seatrial.analysis.report import pages, tables
from seatrial.analysis.report.plots import PICTURED
from seatrial.analysis.series import is_assumed
from seatrial.analysis.speed_power import analysis, report
from seatrial.analysis.speed_power.runs import power_columns
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import hash_distinct_files, percent_of, select
from seatrial.analysis.windows.held import named_recordings, second_by_second
from seatrial.hybrid.calibrators import DomainOfApplicability, TrainedCalibrator, adaptive, own, predict
from seatrial.hybrid.evaluation import manoeuvre_indices, validate
from seatrial.hybrid.identification.identify import indices_of_file
from seatrial.hybrid.prediction.baselines import TWO_SIDED
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, dataset_of
from seatrial.hybrid.report import plots, prediction_errors, trial_form
from seatrial.hybrid.report.text import plain, quantity_title, score_rows
from seatrial.hybrid.simulation.index_table import IndexTable
from seatrial.hybrid.vessel.files import Vessel, correction_conditions, load_vessel, locate_vessel

if TYPE_CHECKING:
    from seatrial.analysis.quality.findings import Finding


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
_TESTED_SHARE = 0.25  # the rest is approach, between tests
MOST_LEFT_OUT = 12
_MOST_VALUES = 3  # of several recordings in one row
CHANNEL_HEADER = ["channel", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range",
                  "interval [s]", "longest [s]", "grade"]  # fmt: skip
_UNITS = {"surge_mps2": "m/s\u00b2", "sway_mps2": "m/s\u00b2", "yaw_dps2": "deg/s\u00b2"}

SHOWN = ("reference", "hybrid")
"""The methods that are drawn beside what was measured; tables have all."""


def ship_name(case: TrialCase) -> str:
    """The ships that the recordings name, as people call them."""
    titles = [title for name in case.products if (title := case.title_of(name))]
    return errors.join_words(list(dict.fromkeys(titles))) if titles else "an unnamed ship"


def unknown_ship_remark(case: TrialCase) -> str:
    """What a ship without a name or dimensions costs the report, and what to do; empty where both are known."""
    if all(case.ship(name) is not None for name in case.products):
        return ""
    costs = "Without its length no index is given in ship lengths, and no limit in lengths is judged."
    ships = [vessel for vessel in case.by_vessel if vessel]
    if not ships:
        to_do = "Please have it imported again with the ship's name."
        return f"The recording does not say which ship this is. {costs} {to_do}"
    return (
        f"The main dimensions of {errors.join_words(ships)} are not known, as there is no vessel file of that "
        f"name. {costs} Please have the length between perpendiculars given for this report."
    )


def report_subtitle(case: TrialCase) -> str:
    """When and where, in a line below the title."""
    first = next(iter(case.products.values()))
    trial, start = first.recording.trial, first.one_hz.index[0]
    several = f"{len(case.products)} recordings" if len(case.products) > 1 else ""
    date = f"{start:%d %B %Y}".lstrip("0") if tables.has_date(start) else ""
    return ", ".join(filter(None, (trial.name, trial.place, date, several)))


def vessel_title(case: TrialCase, vessel: str) -> str:
    """What people call a ship that recordings name."""
    return case.title_of(next(iter(case.by_vessel[vessel]))) or "an unnamed ship"


def verdict_sentence(case: TrialCase) -> str:
    """What the trial shows of the standards in a sentence, or that they are not for such a ship or such tests, and
    one more sentence of the speed at power where that was tried."""
    rows = [row for vessel_rows in case.index_rows.values() for row in vessel_rows]
    if not rows:
        verdict = "No standard manoeuvre was found in this trial, so there are no indices of manoeuvrability."
    elif not case.criteria:
        tests = len({row.place for row in rows})
        verdict = f"No test of IMO {criteria.RESOLUTION} was made; {tests} other test{'s' * (tests != 1)} measured."
    else:
        headlines = {vessel: criteria.headline_of_criteria(results) for vessel, results in case.criteria.items()}
        verdict = " ".join(
            headline if len(headlines) == 1 else f"{vessel_title(case, vessel)}: {headline}"
            for vessel, headline in headlines.items()
        )
    if case.speed_power is None:
        return verdict
    return " ".join([*([verdict] if case.runs else []), report.result_sentence(case.speed_power)])


def index_cells(row: criteria.IndexRow) -> dict[str, Any]:
    """The cells of an index: its name with the unit, and by side its mean and interval.

    A test without sides has its mean under ``""``.
    """
    unit = next(iter(row.sides.values())).index.unit
    name = f"{tables.plain_name(row.name)} [{unit}]" if unit else tables.plain_name(row.name)
    sides = {}
    for side, mean in row.sides.items():
        value, interval, lengths, _ = tables.index_cells(mean.index)
        value = value.removesuffix(f" {mean.index.unit}") + "\u2020" * mean.removed
        value += f" ({lengths} L)" if lengths else ""
        value += f", {mean.runs} runs" if mean.runs > 1 else ""
        sides[side] = value, interval if "-" in interval else interval.replace(" to ", "\u2013")
    return {"name": name, "judged": row.judged_side, "sides": sides}


def mean_indices_of_rows(rows: Sequence[criteria.IndexRow]) -> list[criteria.MeanIndex]:
    """The means of all rows and sides."""
    return [mean for row in rows for mean in row.sides.values()]


def recordings_to_draw(case: TrialCase) -> dict[str, Products]:
    """The recordings whose track and channels are drawn: a single one, and those that are not mostly tests."""
    recordings = {}
    for name, products in case.products.items():
        runs = [run for run in products.manoeuvres if run.kind in PICTURED]  # these have pictures of their own
        tested_s = sum((run.end - run.start).total_seconds() for run in runs)
        if len(case.products) == 1 or tested_s / max(len(products.one_hz), 1) < _TESTED_SHARE:
            recordings[name] = products
    return recordings


def runs_with_own_sheet(case: TrialCase) -> list[trial_form.NumberedRun]:
    """The runs of a trial that have a sheet of their own: the first of each name and side, of those that count if
    there are any, those with criteria before others."""
    rows = [row for vessel_rows in case.index_rows.values() for row in vessel_rows]
    judged = {row.test.partition(" at ")[0].lower() for row in rows if row.result}
    first = {
        (run.manoeuvre.name, run.manoeuvre.side): run
        for run in sorted(case.runs, key=lambda run: (not run.manoeuvre.not_counted, -run.number))
        if run.manoeuvre.kind in PICTURED
    }
    ordered = sorted(first.values(), key=lambda run: (run.manoeuvre.name.lower() not in judged, run.number))
    return sorted(ordered[:MOST_PICTURES], key=lambda run: run.number)


def notes_common_to_runs(runs: Sequence[Manoeuvre]) -> list[str]:
    """What is to be known of all of several manoeuvres, which their captions then leave out."""
    if len(runs) < 2:
        return []
    return [note for note in dict.fromkeys(runs[0].notes) if all(note in run.notes for run in runs)]


def picture_caption(run: Manoeuvre, common: Sequence[str] = ()) -> str:
    """The approach of a manoeuvre, the drift that was removed and what is to be known that is not ``common``."""
    remarks = []
    if "approach_mps" in run.settings:
        heading_deg = round(run.settings["approach_heading_deg"]) % 360
        remarks.append(f"Approach at {run.settings['approach_mps']:.2f} m/s on {heading_deg:03d}°")
    if run.current is not None:
        drift = run.current.as_json()
        remarks.append(f"drift {drift['speed_mps']:.2f} m/s towards {round(drift['direction_deg']) % 360}°")
    remarks += filter(None, [tables.not_counted_text(run)])
    words = "; ".join([*remarks, *(note for note in run.notes if note not in common)])
    return f"{words}." if words else ""


def particulars_by_ship(case: TrialCase) -> Iterator[tuple[str, tables.Rows, tables.Rows, list[str]]]:
    """Of each ship its name, its particulars and loading, when, where and in what weather its trial was made, as
    far as these are known, and what is not stated of them."""
    for vessel, recorded in case.by_vessel.items():
        runs = [run for products in recorded.values() for run in products.manoeuvres]
        ships = {name: case.ship(name) for name in recorded}
        ship = _merge_run_sheet_rows(
            tables.ship_rows(products.recording.trial, products.one_hz, runs, ships[name])
            for name, products in recorded.items()
        )
        conditions = _merge_run_sheet_rows(
            tables.condition_rows(products.recording, products.one_hz, runs, ships[name])
            for name, products in recorded.items()
        )
        unstated = [label for label, value in (*ship, *conditions) if value == tables.UNKNOWN]
        ship, conditions = ([row for row in rows if row[1] != tables.UNKNOWN] for rows in (ship, conditions))
        yield vessel, ship, conditions, unstated


def indices_of_sheets(case: TrialCase) -> manoeuvre_indices.IndexComparisons:
    """The indices of the model for the tests that have a sheet; the page would be long with all."""
    starts = {run.manoeuvre.start for run in runs_with_own_sheet(case)}
    return replace(case.indices, rows=tuple(row for row in case.indices.rows if row.start in starts))


def conducted_rows(case: TrialCase) -> list[list[str]]:
    """The programme of the trial as it was sailed, a row a run; none where none was conducted."""
    return tables.conducted_rows(run for products in case.products.values() for run in products.programme)


def uncounted_lines(case: TrialCase) -> list[str]:
    """The tests that do not count as valid runs of a conducted programme, by the reason."""
    tests = defaultdict[str, list[str]](list)
    for run in case.runs:
        if run.manoeuvre.not_counted:
            tests[run.manoeuvre.not_counted].append(f"{run.number}")
    return [
        f"test{'s' * (len(numbers) > 1)} {errors.join_words(numbers)} ({why})" for why, numbers in tests.items()
    ]


def left_out_lines(case: TrialCase) -> list[str]:
    """Why nothing could be looked for, and what only began like a test; of many the first, and how many more."""
    several = len(case.products) > 1
    lines = [
        (f"{name}: " if several else "") + tables.readable_names(line)
        for name, products in case.products.items()
        for line in (*products.shortfalls, *map(tables.left_out_line, products.left_out))
    ]
    remainder = len(lines) - MOST_LEFT_OUT
    return [*lines[:MOST_LEFT_OUT], *([f"{remainder} more in the output of manoeuvres"] if remainder > 0 else [])]


def standard_conditions(case: TrialCase, vessel: str) -> list[list[str]]:
    """The conditions that the standards ask of a trial, each with whether it was fulfilled in all recordings with a
    test, or the first reason why not; none of a ship that the standards are not for."""
    shortfalls: dict[str, list[str]] = {}
    for name, products in case.by_vessel[vessel].items():
        judged = [index for run in products.manoeuvres for index in run.indices.values() if index.result]
        if all(any(reason.startswith(criteria.NOT_FOR_SHIP) for reason in index.missing) for index in judged):
            continue
        drifts = [run.current.as_json()["speed_mps"] for run in products.manoeuvres if run.current is not None]
        derived = run_sheet.Conditions(current_mps=max(drifts, default=None), length_m=case.length_of(name))
        conditions = recorded_conditions(products.recording.trial, products.table).completed_from(derived)
        conditions = criteria.replace_by_worse_conditions(
            conditions, [run for run in products.manoeuvres if not run.not_counted]
        )
        for asked, shortfall in criteria.condition_shortfalls(conditions).items():
            shortfalls.setdefault(asked, []).append(shortfall)
    return [[asked, next(filter(None, reasons), "fulfilled")] for asked, reasons in shortfalls.items()]


def _merge_run_sheet_rows(sheets: Iterable[list[tuple[str, str]]]) -> list[tuple[str, str]]:
    """The rows of several run sheets in one; what is not known of one is left to the others."""
    values: dict[str, list[str]] = {}
    for label, value in (row for sheet in sheets for row in sheet):
        values.setdefault(label, []).append(value)
    rows = []
    for label, repeated in values.items():
        distinct = list(dict.fromkeys(repeated))
        stated = [value for value in distinct if value != tables.UNKNOWN and not value.startswith("unknown")]
        shown = stated or distinct[:1]
        if len(shown) <= _MOST_VALUES:  # what differs from test to test is in the programme
            rows.append((label, "; ".join(shown)))
    return rows


def arrange_in_two_columns(rows: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Rows of two cells as rows of four, the second half beside the first; a last one of its own where it is odd.

    >>> arrange_in_two_columns([("a", "1"), ("b", "2"), ("c", "3")])
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


def report_headline(case: TrialCase) -> dict[str, str]:
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


def model_sentence(case: TrialCase) -> str:
    """What the simulation model is worth on this trial, compared with constant speed and rate of turn."""
    judged, scores, model = case.validation, case.validation.scores, case.predictor.choice
    model_m, constant_m = (scores[name].mean_distance_m for name in (case.best, "constant_velocity"))
    whose = "the ship's simulation model"
    if model.doubt:
        whose = f"the model {model.name}{', which is not of this ship,' if any(case.by_vessel) else ''}"
    with_it = " with what the calibrator learned" if case.best == "hybrid" else ""
    gain = (
        f"is {1.0 - model_m / constant_m:.0%} better"
        if model_m < constant_m
        else f"has {model_m / constant_m:.3g} times that error"
    )
    overlap = "" if case.trained is None else f" {_OVERLAP[case.training_overlap]}"
    return (
        f"In {len(judged.windows):,} predictions with steady controls, {whose}{with_it} has a mean error of "
        f"{metres_text(model_m)} over {judged.windows.horizon_s} s. With constant speed and rate of turn the error "
        f"would be {metres_text(constant_m)}: the model {gain}.{overlap}"
    )


def quality_sentence(case: TrialCase) -> str:
    """What of the data is in doubt, in a sentence; empty where nothing is."""
    doubtful = [products for products in case.products.values() if _doubtful_channels(products)]
    if not doubtful:
        return ""
    codes = dict.fromkeys(plain(finding.code) for products in doubtful for finding in products.quality.findings)
    doubted = f"{len(doubtful)} of {len(case.products)} recordings have"
    if len(case.products) == 1:
        doubted = f"{len(_doubtful_channels(doubtful[0]))} of {len(doubtful[0].quality.channels)} channels have"
    return (
        f"{doubted} quality findings ({errors.join_words(list(codes))}); see the appendix for findings and repairs."
    )


def _doubtful_channels(products: Products) -> list[str]:
    channels = products.quality.channels
    return [name for name in channels if channels[name].grade != "good"]


def finding_rows(products: Products) -> list[list[str]]:
    """What was found in the data, a row a kind: what, where, in words, and what was put right of it."""
    repaired: dict[str, list[str]] = {}
    for repair in products.repairs:
        repaired.setdefault(repair.code, []).append(
            f"{tables.readable_names(repair.text)} ({repair.changed:,} values)"
        )
    findings: dict[str, list[Finding]] = {}
    for finding in products.quality.findings:
        findings.setdefault(finding.code, []).append(finding)
    return [
        [plain(code), ", ".join(dict.fromkeys(tables.readable_names(finding.channel) for finding in alike)),
         tables.readable_names(alike[0].text), "; ".join(repaired.get(code, [])[:2]) or "\u2013"]
        for code, alike in list(findings.items())[:MOST_FINDINGS]
    ]  # fmt: skip


def group_by_quality(case: TrialCase) -> list[tuple[list[str], Products]]:
    """The recordings by what is to be said of their data: those in order together, the others one by one."""
    groups: list[tuple[list[str], Products]] = []
    sound: list[str] | None = None
    for name, products in case.products.items():
        recording, quality = products.recording, products.quality
        is_sound = recording.closed and not (
            quality.findings or quality.missing or recording.health or pages.event_rows(recording)
        )
        if is_sound and sound is not None:
            sound.append(name)
            continue
        groups.append(([name], products))
        sound = groups[-1][0] if is_sound else sound
    return groups


def recording_rows(case: TrialCase) -> list[list[str]]:
    """The files that the report is made from."""
    rows = (dict(tables.file_rows(products.recording)) for products in case.products.values())
    return [[row["recording"], row["SHA-256"], row["closed properly"]] for row in rows]


def channel_rows(products: Products, *, all_channels: bool = True) -> list[list[str]]:
    """A row a channel, every one or those in doubt: how many samples, how even their times, what was found."""
    rows = []
    doubtful = _doubtful_channels(products)
    for name, quality in products.quality.channels.items():
        if is_assumed(products.table, name) or not (all_channels or name in doubtful):
            continue
        series = products.recording.series.get(name)
        steps = np.diff(np.sort(series.measured_ns)) / 1e9 if series is not None else np.array([])
        spread = [f"{np.median(steps):.3f}", f"{steps.max():.2f}"] if steps.size else ["", ""]
        rows.append([tables.readable_names(name), *pages.channel_count_cells(quality)[:6], *spread, quality.grade])
    return rows


def source_rows(products: Products) -> list[list[str]]:
    """Frames by source, and what was refused or dropped on the way, as the recorder counted."""
    return [
        [name, str(health.get("state", "")), f"{health.get('frames', 0):,}", f"{health.get('rejected', 0):,}",
         ", ".join(f"{count:,} {reason}" for reason, count in (health.get("reasons") or {}).items()),
         f"{health.get('dropped', 0):,}"]
        for name, health in products.recording.health.items()
        if "sent" not in health  # what a sink has dropped is in the recording
    ]  # fmt: skip


def baseline_rows(case: TrialCase) -> tuple[list[list[str]], int]:
    """Every method on windows that none has seen, and the best one's row."""
    judged = case.validation
    rows, best = score_rows(judged)
    against = [
        f"{score.mean_distance_m / scores[reference].mean_distance_m - 1.0:+.1%}".replace("-", "\u2212")
        for scores, reference in ((judged.scores, "reference"), (judged.two_sided, f"reference{TWO_SIDED}"))
        for score in scores.values()
    ]
    return [[plain(name), *row, relative] for (name, *row), relative in zip(rows, against, strict=True)], best


def calibration_table(calibration: prediction_errors.Calibration) -> tuple[list[str], list[list[str]]]:
    """Coverage and width of the 95 % regions by second of the prediction: header and rows."""
    seconds = [second for second in _SECONDS if second <= len(calibration.picp)]
    widths = (calibration.pinaw[second - 1] for second in seconds)
    return ["", *(f"{second} s" for second in seconds)], [
        ["inside, PICP [%]", *(f"{100 * calibration.picp[second - 1]:.1f}" for second in seconds)],
        ["width relative to the mean distance sailed, PINAW [1]",
         *(f"{width:.3f}" if np.isfinite(width) else "\u2013" for width in widths)],
    ]  # fmt: skip


def quantities_outside_training(training: DomainOfApplicability, outside: NDArray[np.bool_]) -> str:
    """In what windows [N, quantities] are ``outside`` of what a calibrator was trained on; empty for nothing."""
    names = [quantity_title(name) for name, column in zip(training.names, outside.T, strict=True) if column.any()]
    return f", in {errors.join_words(names)}" if names else ""


def parameter_rows(parameters: Sequence[adaptive.AdaptedParameter]) -> list[list[str]]:
    """Value, standard error, interval and a remark of each."""
    return [
        [parameter.name, f"{parameter.value:.4g}", f"\u00b1 {parameter.error:.2g}",
         f"{parameter.low:.4g} to {parameter.high:.4g}", parameter.unit,
         "at its bound" if parameter.at_bound else "" if parameter.identified else "not determined"]
        for parameter in parameters
    ]  # fmt: skip


def residual_sentences(residuals: prediction_errors.Residuals) -> list[str]:
    """What the maps of a trial say, a sentence an acceleration in which something stands out."""
    sentences = []
    for residual in prediction_errors.largest_residuals(residuals):
        words, unit = residual.acceleration.partition("_")[0], _UNITS[residual.acceleration]
        quantity, _, span_unit = plots.axis_title(residual.quantity).rstrip("]").partition(" [")
        mean, low, high = (
            np.format_float_positional(value, 2, fractional=False, trim="-", sign=True)
            for value in (residual.mean, residual.mean - residual.half_width, residual.mean + residual.half_width)
        )
        sentences.append(
            f"By {quantity}, the missing {words} acceleration from {residual.low:g} to {residual.high:g} "
            f"{span_unit} is {mean} {unit} (95 % interval {low} to {high}; {residual.seconds} s).".replace(
                "-", "\u2212"
            )
        )
    return sentences or ["The missing acceleration is not significant in any class of any quantity."]


@dataclass(frozen=True)
class TrialCase:
    """Recordings and the model, and perhaps calibrator, that they are held against."""

    paths: tuple[Path, ...]
    vessel: str | None
    trained: TrainedCalibrator | None = None
    horizon_s: int = predict.HORIZON_S
    time_range: tuple[float, float] = (0.0, 100.0)
    stride_s: int = 5
    repair: bool = True
    allow_seen: bool = False
    length_m: float | None = None
    statement: str = ""

    @cached_property
    def named_parts(self) -> dict[str, tuple[Path, ...]]:
        """The recordings, each with its parts, by the names of their trials."""
        return named_recordings(self.paths)

    @cached_property
    def _analysed(self) -> tuple[dict[str, Products], dict[str, str]]:
        """What the analysis makes of each recording, and why it can make nothing of some.

        Channels of motion and wind that one lacks are there, and empty; manoeuvres are those of one trial of each
        ship.
        """
        analysed, left_out = dict[str, Products](), dict[str, str]()
        for name, parts in self.named_parts.items():
            try:
                stated = run_sheet.statement_from_text(self.statement)
                ship = self._ship_of(stated.apply_to_trial(read_trial(parts[0])), parts[0])
                options = Options(repair=self.repair, smooth=False, horizon_s=self.horizon_s,
                                  stride_s=self.stride_s, length_m=_length_m(ship),
                                  rebuild_positions=None if self.repair else False,
                                  statement=self.statement)  # fmt: skip
                products = analyse_recording(parts, options, name)
            except errors.SeatrialError as error:
                left_out[name] = str(error.at(""))
                continue
            lacking = [channel for channel in MOTION if channel not in products.one_hz]
            filled = products.one_hz.assign(**dict.fromkeys(lacking, np.nan))
            analysed[name] = replace(products, one_hz=filled)
        if not analysed:
            raise errors.DataShortageError(
                "no recording can be read", why="; ".join(f"{name}: {why}" for name, why in left_out.items())
            )
        for names in _group_by_vessel(analysed).values():
            recorded = []
            for name, products in names.items():
                ship = self._ship_of(products.recording.trial, self.named_parts[name][0])
                conditions = run_sheet.Conditions(length_m=_length_m(ship))
                recorded.append(
                    find.RecordedRuns(products.table, products.manoeuvres, conditions, products.programme)
                )
            for name, runs in zip(names, find.share_currents_of_trial(recorded), strict=True):
                analysed[name] = replace(analysed[name], manoeuvres=runs)
        return analysed, left_out

    def _ship_of(self, trial: Trial, recording: Path) -> tables.ShipDimensions | None:
        """The ship of a trial: given or stated dimensions take precedence over those of a file, which are with a
        hull lengthening."""
        stated, vessel = recorded_conditions(trial, pd.DataFrame()), self._vessel_of(trial.vessel, recording)
        length_m = self.length_m or stated.length_m
        if vessel is None:
            if not length_m:
                return None
            return tables.ShipDimensions(trial.vessel, length_m, length_m, stated.beam_m, stated.draught_m)
        size, added_m = vessel.dimensions, vessel.effects.get("hull_lengthening", {}).get("length_m", 0.0)
        over_all_m, between_m = size.length_overall_m + added_m, size.length_between_perpendiculars_m + added_m
        if length_m and length_m != between_m:
            over_all_m = between_m = length_m
        title = vessel.description.partition(",")[0]  # what comes after a comma is about the model
        beam_m = stated.beam_m or size.beam_m
        return tables.ShipDimensions(vessel.name, over_all_m, between_m, beam_m, size.draught_m, title)

    def _vessel_of(self, name: str, recording: Path) -> Vessel | None:
        """The vessel file of the ship that a recording names, or of the model asked for where it names none."""
        try:
            asked = locate_vessel(self.vessel) if self.vessel and not name else None
            file = asked or declarations.vessel_file_of_ship(name, recording.parent)
            return None if file is None else load_vessel(file)
        except errors.ConfigurationError:
            return None

    @property
    def products(self) -> dict[str, Products]:
        """What the analysis makes of each recording that can be read, by the name of its trial."""
        return self._analysed[0]

    @property
    def left_out(self) -> dict[str, str]:
        """Why recordings are not in the report, by the name of their trial."""
        return self._analysed[1]

    @cached_property
    def by_vessel(self) -> dict[str, dict[str, Products]]:
        """The recordings by the ships that they name."""
        return _group_by_vessel(self.products)

    def ship(self, name: str) -> tables.ShipDimensions | None:
        """The main dimensions of the ship that a recording names, None where it names none that is known.

        A length that was given stands above those of a file.
        """
        return self._ship_of(self.products[name].recording.trial, self.named_parts[name][0])

    def title_of(self, name: str) -> str:
        """What people call the ship of a recording; empty where it names none."""
        ship = self.ship(name)
        return (ship.title if ship else "") or self.products[name].recording.trial.vessel

    def length_of(self, name: str) -> float | None:
        """The length between perpendiculars of the ship of a recording [m], None where it is not known."""
        return _length_m(self.ship(name))

    @cached_property
    def runs(self) -> list[trial_form.NumberedRun]:
        """The manoeuvres of all recordings, numbered in the order of time."""
        runs = [(run, name, products.table) for name, products in self.products.items()
                for run in products.manoeuvres]  # fmt: skip
        runs.sort(key=lambda entry: entry[0].start)
        return [
            trial_form.NumberedRun(number, name, run, table)
            for number, (run, name, table) in enumerate(runs, start=1)
        ]

    @cached_property
    def index_rows(self) -> dict[str, list[criteria.IndexRow]]:
        """The indices of each ship, by the name that its recordings have for it: no means over several ships."""
        by_vessel: dict[str, list[Manoeuvre]] = {}
        for run in self.runs:
            vessel = self.products[run.recording].recording.trial.vessel
            by_vessel.setdefault(vessel, []).append(run.manoeuvre)
        return {vessel: criteria.index_rows(manoeuvres) for vessel, manoeuvres in by_vessel.items()}

    @cached_property
    def criteria(self) -> dict[str, list[criteria.CriterionResult]]:
        """What the trial shows of each criterion of the standards, by ship, of those with a test of one."""
        return {vessel: criteria.criterion_results(rows) for vessel, rows in self.index_rows.items()
                if any(row.criterion for row in rows)}  # fmt: skip

    @cached_property
    def speed_power(self) -> analysis.SpeedPower | None:
        """Speed at power in still water; None without power at a shaft or without reciprocal runs."""
        powered = {name: products for name, products in self.products.items() if power_columns(products.table)}
        if not powered:
            return None
        recorded = [(products.recording.trial, products.table) for products in powered.values()]
        ship = self._vessel_of(recorded[0][0].vessel, self.named_parts[next(iter(powered))][0])
        events = [event for products in powered.values() for event in products.recording.events]
        try:
            stated = run_sheet.Conditions(length_m=self.length_m)
            return analysis.speed_power(
                [table for _, table in recorded], correction_conditions(recorded, ship, stated), events
            )
        except (errors.DataShortageError, errors.InputError):
            return None

    @cached_property
    def predictor(self) -> predict.Predictor:
        """The reference model, and what is to be said of it: the calibrator's where there is one.

        Raises as :func:`.reference_model`.
        """
        trials = {self.named_parts[name][0]: products.recording.trial for name, products in self.products.items()}
        return predict.choose_predictor(trials, self.trained, self.vessel)

    @cached_property
    def dataset(self) -> Dataset:
        """The held windows of all recordings. Raises :class:`DataShortageError` where there is none."""
        held = {
            name: products
            for name, products in self.products.items()
            if products.windows is not None and products.windows.kept
        }
        used = held or self.products
        paths = [path for name in used for path in self.named_parts[name]]
        return dataset_of(
            {name: second_by_second(partial(resample, select(products.table, self.time_range)))
             for name, products in used.items()},
            self.horizon_s, self.stride_s,
            [WindowSource(path, digest, self.time_range)
             for path, digest in zip(paths, hash_distinct_files(paths), strict=True)],
            length_m=self.predictor.plant.length_overall_m,
        )  # fmt: skip

    @property
    def training_overlap(self) -> Literal["some", "another part", "nothing"]:
        """What the calibrator was trained on of what it is judged on: ``some`` of it, ``another part`` of its
        recordings, or ``nothing``."""
        training = () if self.trained is None else self.trained.sources
        pairs = [(source, seen) for source in self.dataset.sources for seen in training]
        if any(source.overlaps(seen) for source, seen in pairs):
            return "some"
        return "another part" if any(source.sha256 == seen.sha256 for source, seen in pairs) else "nothing"

    @cached_property
    def validation(self) -> validate.Validation:
        """Every method on the held windows. Raises :class:`InputError` where a calibrator has seen them."""
        if self.trained is not None and not self.allow_seen:
            validate.refuse_training_data(self.dataset.sources, self.trained)
        return validate.validate_predictions(self.dataset, self.predictor.plant, self.trained)

    @cached_property
    def indices(self) -> manoeuvre_indices.IndexComparisons:
        """The measured indices beside those of the model, of all recordings."""
        runs = [(products.table, products.manoeuvres) for products in self.products.values()]
        return manoeuvre_indices.index_comparison(runs, self.predictor)

    @cached_property
    def standard_indices(self) -> IndexTable:
        """The standard manoeuvres by the model, with intervals by the errors that its vessel file states."""
        ship = self.predictor.ship
        return indices_of_file(ship) if ship is not None and ship.estimated else IndexTable()

    @cached_property
    def errors_after_lengths(self) -> validate.LengthErrors | None:
        """The errors after so many L/V; None where no recording is long enough."""
        plant = self.predictor.plant
        return validate.errors_after_lengths(self.dataset.tables, self.validation.windows, plant, self.trained)

    @cached_property
    def obstacle(self) -> str:
        """Why nothing is predicted on these recordings; empty where it is.

        For a ship without its own model none is tested unless one was asked for.
        """
        try:
            if self.trained is None and self.vessel is None:
                try:
                    is_of_ship = not self.predictor.choice.doubt
                except errors.InputError:
                    is_of_ship = False
                if not is_of_ship:
                    return "there is no model of the ship that the recordings name"
            _ = self.validation
        except (errors.ConfigurationError, errors.DataShortageError, errors.InputError) as error:
            return str(error.at(""))
        return ""

    @property
    def best(self) -> str:
        """The method that is drawn where one is: the hybrid where there is a calibrator."""
        return "hybrid" if "hybrid" in self.validation.tracks else "reference"

    @property
    def most_judged(self) -> str:
        """The trial with most windows."""
        names, counts = np.unique(self.validation.windows.trial, return_counts=True)
        return str(names[np.argmax(counts)])

    @cached_property
    def errors(self) -> dict[str, prediction_errors.ErrorComponents]:
        """The errors of every method."""
        return {
            name: prediction_errors.error_components(track, self.validation.windows)
            for name, track in self.validation.tracks.items()
        }

    @cached_property
    def calibration(self) -> prediction_errors.Calibration | None:
        """Whether the hybrid's regions hold what they say."""
        judged = self.validation
        if judged.region_m is None:
            return None
        return prediction_errors.region_calibration(judged.tracks["hybrid"], judged.region_m, judged.windows)

    def figure_name(self, name: str, trial: str) -> str:
        """What a recording's figure is called: by its trial where there are several."""
        return name if len(self.paths) == 1 else f"{name}_{trial}"

    def predicted(self, name: str) -> dict[str, pd.DataFrame]:
        """What :data:`SHOWN` methods predict in windows of a trial that follow each other."""
        windows, tracks = self.validation.windows, self.validation.tracks
        chosen = prediction_errors.consecutive_windows(windows)
        chosen = chosen[windows.trial[chosen] == name]
        if not len(chosen):
            return {}
        return {
            method: prediction_errors.predicted_motion(windows, tracks[method], chosen)
            for method in SHOWN
            if method in tracks
        }

    @cached_property
    def residuals(self) -> prediction_errors.Residuals | None:
        """The accelerations that the model lacks, over all recordings that can be smoothed, with the quantities
        that all of them have; None without one."""
        residuals = [
            prediction_errors.acceleration_residuals(
                products.one_hz, smooth(products.table, 1.0), self.predictor.plant
            )
            for products in self.products.values() if products.windows is not None
        ]  # fmt: skip
        if not residuals:
            return None
        names = [
            name for name in residuals[0].quantities if all(name in recording.quantities for recording in residuals)
        ]
        return prediction_errors.Residuals(
            np.concatenate([recording.missing for recording in residuals]),
            {name: np.concatenate([recording.quantities[name] for recording in residuals]) for name in names},
        )

    @cached_property
    def domain(self) -> DomainOfApplicability | None:
        """What the trial has of what the calibrator was trained on."""
        if self.trained is None:
            return None
        judged = self.validation
        return self.trained.calibrator.domain(judged.windows, judged.tracks["reference"])

    @cached_property
    def parameters(self) -> adaptive.Parameters | None:
        """What an adaptive calibrator has learned; networks have no parameters that mean anything."""
        calibrator = None if self.trained is None else self.trained.calibrator
        return (
            adaptive.parameters_of_calibrator(calibrator)
            if isinstance(calibrator, adaptive.AdaptiveCalibrator)
            else None
        )


def _length_m(ship: tables.ShipDimensions | None) -> float | None:
    return None if ship is None else ship.between_perpendiculars_m


def _group_by_vessel(recordings: Mapping[str, Products]) -> dict[str, dict[str, Products]]:
    """Recordings by the ships that they name."""
    by_vessel: dict[str, dict[str, Products]] = {}
    for name, products in recordings.items():
        by_vessel.setdefault(products.recording.trial.vessel, {})[name] = products
    return by_vessel


def load_case(
    recordings: Sequence[Path | str],
    calibrator: Path | str | None = None,
    vessel: str | None = None,
    horizon_s: int | None = None,
    *,
    time_range: tuple[float, float] | str = "0..100",
    repair: bool = True,
    allow_seen: bool = False,
    length_m: float | None = None,
    method: str | None = None,
    statement: str = "",
) -> TrialCase:
    """The case behind the report of a trial: recordings, the model, and perhaps a calibrator.

    Parameters
    ----------
    recordings
        The recordings, or the parts of one.
    calibrator
        The folder of a calibrator.
    vessel
        The reference model: a vessel's name or file; by default that of the calibrator, or of the ship that the
        recordings name.
    horizon_s
        The horizon of the predictions [s]; by default that of the calibrator, or 15.
    time_range
        The part of each recording's time in which predictions are judged [%], ``(70, 100)`` or ``"70..100"``.
    repair
        Repair faults that are beyond doubt.
    allow_seen
        Also recordings that the calibrator was trained on.
    length_m
        The ship's length between perpendiculars [m], if no vessel file has it.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own.
    statement
        What a person states of the trials (:meth:`seatrial.acquisition.config.run_sheet.Statement.as_text`).

    Returns
    -------
    Case
        What the report is made of, each computed when it is first needed; :func:`seatrial.sections` shows it.

    Raises
    ------
    InputError
        For a recording given twice and for a calibrator that cannot be read.
    ConfigurationError
        For a vessel that is not the calibrator's.

    Examples
    --------
    >>> import seatrial as st
    >>> case = st.load_case(["trial.mcap"], calibrator="calibrator")
    >>> case.horizon_s
    15
    """
    paths = tuple(map(Path, recordings))
    hash_distinct_files(paths)
    trained = own.load(Path(calibrator), method) if calibrator else None
    seconds = horizon_s or predict.HORIZON_S
    if trained is not None or vessel is not None:
        seconds = predict.choose_predictor({}, trained, vessel, horizon_s).horizon_s
    return TrialCase(paths, vessel, trained, seconds, percent_of(time_range), repair=repair, allow_seen=allow_seen,
                length_m=length_m, statement=statement)  # fmt: skip
