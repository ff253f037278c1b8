"""An evaluation on a page: which method is worth what, where it is good, and what a random split would hide."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acquisition.core.errors import storage_error
from analysis.report.page import Page
from hybrid.evaluation.study import BASELINES
from hybrid.evaluation.summary import Evaluation, SplitSummary, counts_of
from hybrid.prediction.scores import Interval
from hybrid.report import evaluation_plots as plots
from hybrid.report.evaluation_tables import MEANING, caption_of, spread
from hybrid.report.words import plain, unbroken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

JSON_FILE, PAGE_FILE = "evaluation.json", "evaluation.html"
_HEADER = ["method", "mean distance [m]", "end [m]", "north, east [m]", "heading [deg]", "ratio to best",
           "in the 95 % region"]  # fmt: skip


def write_evaluation(evaluation: Evaluation, text: str, about: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the JSON ``text`` and the page into a folder and return their paths. Raises :class:`StorageError`."""
    path = folder / JSON_FILE
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise storage_error(path, error) from error
    return [path, page_of(evaluation, about).write(folder / PAGE_FILE)]


def page_of(evaluation: Evaluation, about: Mapping[str, Any]) -> Page:
    """The page; ``about`` says what was evaluated: files, vessel, stride, seed."""
    names = ", ".join(Path(each).name for each in about["files"])
    page = Page(
        f"What each method is worth over {evaluation.horizon_s} s",
        f"{names}; vessel {about['vessel']}; {evaluation.windows} held windows of {evaluation.legs} legs",
    )
    page.headline(headline_of(evaluation))
    if evaluation.outside:
        page.note(f"{evaluation.outside} windows are left out: the reference leaves its range in them.")
    _add_overview(page, evaluation)
    for split in evaluation.splits.values():
        _add_split(page, split)
    _add_leak(page, evaluation)
    return page


def headline_of(evaluation: Evaluation) -> dict[str, str]:
    """How the best learned method stands to the best baseline, on each honest split."""
    figures = {}
    for kind, split in evaluation.splits.items():
        learned = {name: each for name, each in split.whole.methods.items() if name not in BASELINES}
        if kind != "random" and learned:
            best = min(learned, key=lambda name: learned[name].ratio.value)
            words = f"{plain(best)} over {plain(split.whole.best_baseline)}, {MEANING[kind]}"
            figures[words] = f"{learned[best].ratio.value:.2f} \u00d7"
    return figures


def _add_overview(page: Page, evaluation: Evaluation) -> None:
    page.heading("Against the best baseline")
    rows = sum(len(each.whole.methods) - 1 for each in evaluation.splits.values())
    page.figure(
        lambda figure: _drawn(plots.forest(figure.subplots(), evaluation.splits)),
        (8, 1.0 + 0.28 * rows),
        "Left of 1 a method errs less than the best baseline, the better of constant velocity and reference; bars "
        "are 95 % intervals, from drawing legs anew.",
    )
    page.text(
        "Constant velocity, the reference and all networks start from a state smoothed over seconds on either "
        "side: their errors are a few percent less than aboard, where nothing is known of the seconds to come. "
        "The adaptive calibrator infers its own start from the seconds before."
    )


def _add_split(page: Page, split: SplitSummary) -> None:
    page.heading(f"{split.kind.capitalize()}: {MEANING[split.kind]}; {counts_of(split.whole)}")
    names = list(split.whole.methods)
    rows = [
        [unbroken(plain(name)), unbroken(spread(each.mean_distance_m)), f"{each.end_distance_m.value:.2f}",
         unbroken(f"{each.mae_north_m.value:.2f}, {each.mae_east_m.value:.2f}"),
         f"{each.heading_error_deg.value:.1f}", unbroken(spread(each.ratio)), _percent(each.coverage_95)]
        for name, each in split.whole.methods.items()
    ]  # fmt: skip
    page.table(_HEADER, rows, best=names.index(split.whole.best))
    page.text(f"{caption_of(split)}.")
    page.figure(
        lambda figure: _draw_seconds(figure, split),
        (9, 3.6),
        "How the error grows with the time predicted, 95 % intervals shaded; and whether the 95 % regions hold "
        "what they say, 93 to 97 % shaded.",
    )
    for kind, classes in split.shown.items():
        page.figure(
            lambda figure, classes=classes: _draw_classes(figure, classes),  # type: ignore[misc]
            (8.5, 3.2),
            f"The error by {kind}, with 95 % intervals where there are two legs or more.",
        )


def _add_leak(page: Page, evaluation: Evaluation) -> None:
    if not evaluation.leak:
        return
    page.heading("What a random split hides")
    page.figure(
        lambda figure: _drawn(plots.leak(figure.subplots(), evaluation.splits)),
        (8, 1.2 + 0.5 * len(evaluation.leak)),
        "Windows drawn at random are of legs that were trained on, and may overlap what was seen of them. The "
        "error on legs that were never seen is the one that is met at sea.",
    )
    rows = [[unbroken(plain(name)), unbroken(spread(factor))] for name, factor in evaluation.leak.items()]
    page.table(["method", "error on legs never seen over the error shown, on the same windows"], rows)


def _draw_seconds(figure: Figure, split: SplitSummary) -> None:
    left, right = figure.subplots(1, 2)
    plots.error_by_second(left, split.whole)
    plots.coverage_by_second(right, split.whole)
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def _draw_classes(figure: Figure, classes: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    plots.breakdown(axes, classes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def _drawn(artists: object) -> None:
    """A figure's drawing returns nothing."""


def _percent(interval: Interval) -> str:
    bounds = "" if interval.low != interval.low else f" ({interval.low:.0%}-{interval.high:.0%})"
    return unbroken(f"{interval.value:.1%}{bounds}")
