"""An evaluation on a page: which method is worth what, where it is good, and what a random split would hide."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from acquisition.core.errors import storage_error
from analysis.report.rendering import Page, render
from hybrid.evaluation.study import BASELINES
from hybrid.evaluation.summary import Evaluation, SplitSummary, counts_of
from hybrid.prediction.scores import Interval
from hybrid.report.evaluation_tables import MEANING, caption_of, spread
from hybrid.report.show import templates
from hybrid.report.words import plain, unbroken

__all__ = ["MEANING", "caption_of", "counts_of"]  # for the template

JSON_FILE, PAGE_FILE = "evaluation.json", "evaluation.html"
HEADER = ["method", "mean distance [m]", "end [m]", "north, east [m]", "heading [deg]", "ratio to best",
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
    return render(
        "evaluation.html", templates=templates(), found=evaluation,
        title=f"What each method is worth over {evaluation.horizon_s} s",
        subtitle=f"{names}; vessel {about['vessel']}; {evaluation.windows} held windows of {evaluation.legs} legs",
    )  # fmt: skip


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


def ratio_count(evaluation: Evaluation) -> int:
    """How many ratios to the best baseline there are."""
    return sum(len(each.whole.methods) - 1 for each in evaluation.splits.values())


def method_rows(split: SplitSummary) -> tuple[list[list[str]], int]:
    """A row a method, and which is the best."""
    rows = [
        [unbroken(plain(name)), unbroken(spread(each.mean_distance_m)), f"{each.end_distance_m.value:.2f}",
         unbroken(f"{each.mae_north_m.value:.2f}, {each.mae_east_m.value:.2f}"),
         f"{each.heading_error_deg.value:.1f}", unbroken(spread(each.ratio)), _percent(each.coverage_95)]
        for name, each in split.whole.methods.items()
    ]  # fmt: skip
    return rows, list(split.whole.methods).index(split.whole.best)


def leak_rows(evaluation: Evaluation) -> list[list[str]]:
    """How much larger the error on legs never seen is than what a random split shows."""
    return [[unbroken(plain(name)), unbroken(spread(factor))] for name, factor in evaluation.leak.items()]


def _percent(interval: Interval) -> str:
    bounds = "" if interval.low != interval.low else f" ({interval.low:.0%}-{interval.high:.0%})"
    return unbroken(f"{interval.value:.1%}{bounds}")
