"""What a trial's report says of a case in words and rows; ``templates/trial.html`` puts it onto the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition.core.errors import ConfigurationError, DataShortageError
from analysis.products import Products
from analysis.report.pages import events_of, run_sheet
from hybrid.prediction.scores import FEW_LEGS, TWO_SIDED
from hybrid.report.case import Case
from hybrid.report.diagnosis_map_plots import axis_title
from hybrid.report.errors import ENOUGH_S, QUANTITIES, Calibration, Residuals, error_rows, largest_residuals
from hybrid.report.tables import score_rows
from hybrid.report.words import join_words, plain, quantity_title

if TYPE_CHECKING:
    import pandas as pd

    from hybrid.calibrators.adaptive.parameters import Parameter, Parameters
    from hybrid.calibrators.calibrator import DomainOfApplicability
    from hybrid.evaluation.validate import Validation

__all__ = ["ENOUGH_S", "FEW_LEGS", "QUANTITIES", "error_rows", "events_of", "run_sheet"]  # for the template

INTERACTIVE = "interactive"
_A_DAY_S = 86_400.0  # received so long after: the source's clock is of another day
_OVERLAP = {
    "nothing": "None has seen these recordings.",
    "another part": "The calibrator was trained on another part of the same recordings.",
    "some": "The calibrator has seen some of this.",
}
_SECONDS = (1, 5, 10, 15, 20, 30, 45, 60)


def window_rows(products: Products) -> pd.DataFrame | None:
    """The long table of a recording's held windows."""
    return None if products.windows is None else products.windows.rows


def headline(case: Case) -> dict[str, str]:
    """The mean distance of each method, and what the calibrator gains."""
    judged = case.validation
    figures = {
        f"{plain(name)}, mean distance over {judged.windows.horizon_s} s": f"{score.mean_distance_m:.2f} m"
        for name, score in judged.scores.items()
        if name in ("constant_velocity", "reference", "hybrid")
    }
    if judged.reduction is not None and judged.coverage_95 is not None:
        figures["less error than the reference"] = f"{judged.reduction:.0%}"
        figures["of positions inside the 95 % regions"] = f"{judged.coverage_95:.0%}"
    return figures


def model_words(case: Case) -> str:
    """Which model the reference is, of which ship the recordings are, and what the hybrid is."""
    ships = join_words(
        list(dict.fromkeys(each.recording.trial.vessel or "no ship" for each in case.products.values()))
    )
    words = f"The reference is the model {case.model.name}; the recordings name {ships}."
    if case.trained is None:
        return words
    trained = case.trained
    recordings = join_words([each.path.name for each in trained.sources])
    return (
        f"{words} The hybrid is the calibrator {trained.calibrator.method}, trained on {recordings} "
        f"({trained.metrics.get('windows', 0):,} windows of {trained.horizon_s} s, {trained.trained_at:%Y-%m-%d})."
    )


def doubts_of(products: Products) -> str | None:
    """What of the data is in doubt, in a line; None where nothing is."""
    channels = products.quality.channels
    doubtful = [name for name in channels if channels[name].grade != "good"]
    if not doubtful:
        return None
    codes = dict.fromkeys(each.code.replace("_", " ") for each in products.quality.findings)
    return (
        f"{len(doubtful)} of {len(channels)} channels are not good ({join_words(list(codes))}): part of every "
        "error below may be the data's. The section on data quality says more."
    )


def time_rows(products: Products) -> list[list[str]]:
    """How even the stamps of each channel are, and how long samples took to arrive."""
    rows = []
    for name, series in products.recording.series.items():
        if name not in products.quality.channels or series.measured_ns.size < 2:
            continue
        steps = np.diff(np.sort(series.measured_ns)) / 1e9
        late = (series.received_ns - series.measured_ns) / 1e9
        other = abs(float(np.median(late))) > _A_DAY_S
        rows.append(
            [name, f"{np.median(steps):.3f}", f"{np.quantile(steps, 0.95):.3f}", f"{steps.max():.2f}",
             "another clock" if other else f"{np.median(late):.3f}",
             "" if other else f"{np.quantile(np.abs(late - np.median(late)), 0.95):.3f}",
             ", ".join(series.sources)]
        )  # fmt: skip
    return rows


def source_rows(products: Products) -> list[list[str]]:
    """Frames by source, and what was refused or dropped on the way, as the recorder counted."""
    return [
        [name, str(each.get("state", "")), f"{each.get('frames', 0):,}", f"{each.get('rejected', 0):,}",
         ", ".join(f"{count:,} {reason}" for reason, count in (each.get("reasons") or {}).items()),
         f"{each.get('dropped', 0):,}"]
        for name, each in products.recording.health.items()
    ]  # fmt: skip


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
    return (
        f"Means over {len(judged.windows)} held windows of {judged.windows.horizon_s} s in {legs} legs, one "
        f"every {case.stride_s} s; seconds 1 to {judged.windows.horizon_s}. Constant velocity is dead reckoning, "
        "data driven the network without a model. Networks learn no heading: it is the reference's, for data "
        f"driven the present turn held. {_OVERLAP[case.training_overlap]} {_dropped(case)}"
    )


def _dropped(case: Case) -> str:
    """How many windows were tried, and why the others are not judged."""
    dataset = case.dataset
    reasons = ", ".join(f"{count:,} {plain(reason)}" for reason, count in dataset.dropped.items() if count)
    return f"Of {dataset.candidates:,} windows tried others were left out: {reasons}." if reasons else ""


def seconds_up_to(horizon_s: int) -> list[int]:
    """The seconds of a prediction that tables show."""
    return [each for each in _SECONDS if each <= horizon_s]


def second_titles(seconds: Sequence[int]) -> list[str]:
    """Heads of columns."""
    return [f"{each} s" for each in seconds]


def calibration_rows(calibration: Calibration, seconds: Sequence[int]) -> list[list[str]]:
    """Coverage and width of the 95 % regions."""
    return [
        ["inside, PICP [%]", *(f"{100 * calibration.picp[each - 1]:.1f}" for each in seconds)],
        ["width over mean way covered, PINAW [1]", *(_share(calibration.pinaw[each - 1]) for each in seconds)],
    ]


def _share(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "\u2013"


def fallback_words(judged: Validation, training: DomainOfApplicability) -> str:
    """How many windows start beyond the training, in what, and which baseline speaks there."""
    names = [name for name, column in zip(training.names, training.outside.T, strict=True) if column.any()]
    spoke = ", ".join(f"{plain(name)} in {count}" for name, count in (judged.fallback or {}).items())
    where = f", in {join_words([quantity_title(name) for name in names])}" if names else ""
    beyond = 0 if judged.outside_domain is None else int(judged.outside_domain.sum())
    return (
        f"{beyond} of {len(judged.windows)} windows start too far beyond what the calibrator was trained "
        f"on{where}; there a baseline speaks: {spoke}."
    )


def outside_words(judged: Validation, training: DomainOfApplicability) -> str:
    """How many windows lie outside the range of the training itself, and in what."""
    past = [name for name, column in zip(training.names, training.outside_range.T, strict=True) if column.any()]
    count = int(training.outside_range.any(axis=1).sum())
    return (
        f"{count} of {len(judged.windows)} windows lie outside the range of the training itself"
        + (f", in {join_words([quantity_title(name) for name in past])}" if past else "")
        + "; up to the dashes that is allowed, for a model goes on where a table ends."
    )


def parameter_warnings(learned: Parameters) -> list[str]:
    """Which parameters lie at a bound, and which cannot be told apart."""
    warnings = []
    at_bound = [each.name for each in learned.every if each.at_bound]
    if at_bound:
        warnings.append(f"At the bound of what is allowed: {', '.join(at_bound)}.")
    pairs = learned.entangled()
    if pairs:
        words = ", ".join(f"{one} with {other} ({value:+.2f})" for one, other, value in pairs[:6])
        warnings.append(f"Cannot be told apart: {words}{', and more' if len(pairs) > 6 else ''}.")
    return warnings


def parameter_rows(parameters: Sequence[Parameter]) -> list[list[str]]:
    """Value, standard error, interval and a remark of each."""
    return [
        [each.name, f"{each.value:.4g}", f"\u00b1 {each.error:.2g}", f"{each.low:.4g} to {each.high:.4g}",
         each.unit, "at its bound" if each.at_bound else "" if each.identified else "not known by the data"]
        for each in parameters
    ]  # fmt: skip


def write_interactive_pages(case: Case, folder: Path | str) -> dict[str, str]:
    """A page to zoom into for each recording, in ``folder``; what they are called and where, for links, or why
    not."""
    from analysis.report.interactive import interactive_page

    pages = {}
    for trial, products in case.products.items():
        windows = window_rows(products)
        page = Path(folder) / (f"{INTERACTIVE}.html" if len(case.paths) == 1 else f"{INTERACTIVE}_{trial}.html")
        predicted = {} if windows is None or case.why_not else case.predicted(trial)
        try:
            interactive_page(
                products.one_hz, windows, predicted, products.manoeuvres, trial, products.recording.path.name
            ).write(page)
        except (ConfigurationError, DataShortageError) as error:
            pages[f"no page to zoom into: {error}"] = ""
            continue
        what = "track and channels to zoom into" + (f", {trial}" if len(case.paths) > 1 else "")
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
            f"By {quantity}, the {words} acceleration that is missing from {each.low:g} to {each.high:g} {of} is "
            f"{mean} {unit} (95 % interval {low} to {high}; {each.seconds} s).".replace("-", "\u2212")
        )
    return sentences or ["In no class of any quantity does the missing acceleration stand out of its uncertainty."]
