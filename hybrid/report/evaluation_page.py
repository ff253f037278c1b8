"""An evaluation on a page: which method is worth what, where it is good, and what a random split would hide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from seatrial.acquisition.core.files import write_text, written_together
from seatrial.analysis.report.plots import FAINT, INK, PALETTE
from seatrial.analysis.report.rendering import Page, render
from seatrial.hybrid.evaluation.study import BASELINES, Evaluation, MethodSummary, SplitSummary
from seatrial.hybrid.report.plots import COLOUR, interval_bar, logarithmic, named_rows, reach
from seatrial.hybrid.report.text import MEANING, counts_of, estimate_text, no_wrap, plain, templates

_LABELS, _SHORTEST = 84, 10  # characters that fit below an axis side by side, and of one label at the least
JSON_FILE, PAGE_FILE = "evaluation.json", "evaluation.html"
HEADER = ["method", "start", "mean distance [m]", "end [m]", "north, east [m]", "heading [deg]", "ratio to best",
          "in the 95 % region"]  # fmt: skip


def colours_of(methods: Sequence[str]) -> dict[str, str]:
    """One colour a method, the same in every figure; methods that are not known take what is left."""
    colours = {method: COLOUR[method] for method in (*BASELINES, *methods) if method in COLOUR}
    unused = [colour for colour in (*PALETTE, INK) if colour not in colours.values()]
    uncoloured = [method for method in methods if method not in colours]
    return colours | {method: unused[number % len(unused)] for number, method in enumerate(uncoloured)}


def leak(axes: Axes, splits: Mapping[str, SplitSummary]) -> None:
    """What the random split shows of each method beside what is found on legs never seen."""
    honest, leaky = splits["leg"].causal.methods, splits["random"].causal.methods
    for row, method in enumerate(honest):
        shown, unseen = leaky[method].mean_distance_m, honest[method].mean_distance_m
        axes.plot([shown.value, unseen.value], [row, row], color=FAINT, linewidth=2.0, zorder=1)
        interval_bar(axes, shown, row - 0.12, PALETTE[1], "random windows" if row == 0 else "")
        interval_bar(axes, unseen, row + 0.12, PALETTE[0], "unseen legs" if row == 0 else "")
    named_rows(axes, [plain(method) for method in honest])
    logarithmic(axes, "x", [errors.mean_distance_m for part in (honest, leaky) for errors in part.values()])
    axes.set_xlabel("mean distance [m]")
    axes.legend(loc="best")


def breakdown(axes: Axes, classes: Mapping[str, MethodSummary]) -> None:
    """The mean distance of every method in each class, with its interval."""
    methods = list(next(iter(classes.values())).methods)
    colours = colours_of(methods)
    for number, method in enumerate(methods):
        places = np.arange(len(classes)) + (number - (len(methods) - 1) / 2) * 0.6 / len(methods)
        intervals = [summary.methods[method].mean_distance_m for summary in classes.values()]
        values, ends = [interval.value for interval in intervals], np.column_stack([*map(reach, intervals)])
        axes.errorbar(places, values, ends, fmt="o", color=colours[method], capsize=2.5, label=plain(method))
    wide = max(_LABELS // len(classes), _SHORTEST)
    labels = [f"{fill(name, wide)}\n{fill(counts_of(summary), wide)}" for name, summary in classes.items()]
    axes.set_xticks(range(len(classes)), labels)
    axes.set_xlim(-0.5, len(classes) - 0.5)
    logarithmic(
        axes, "y", [errors.mean_distance_m for summary in classes.values() for errors in summary.methods.values()]
    )
    axes.set_ylabel("mean distance [m]")
    axes.grid(visible=False, axis="x")


def seconds(figure: Figure, summary: MethodSummary) -> None:
    """By second of the prediction the mean distance of every method with its 95 % interval shaded, and the share
    of positions inside its 95 % region, 93 to 97 % shaded.

    Errors grow from centimetres to metres, and methods are tens of times apart: their axis is logarithmic.
    """
    error_axes, coverage_axes = figure.subplots(1, 2)
    colours = colours_of(list(summary.methods))
    coverage_axes.axhspan(93.0, 97.0, color=FAINT, alpha=0.4, linewidth=0)
    for method, errors in summary.methods.items():
        look: dict[str, Any] = {"color": colours[method], "label": plain(method)}
        times = np.arange(1, len(errors.by_second) + 1)
        value, low, high = np.array(
            [(interval.value, interval.low, interval.high) for interval in errors.by_second]
        ).T
        error_axes.plot(times, value, **look)
        error_axes.fill_between(times, low, high, color=colours[method], alpha=0.12, linewidth=0)
        shares = [100.0 * interval.value for interval in errors.coverage_by_second]
        coverage_axes.plot(np.arange(1, len(shares) + 1), shares, **look)
    intervals = [interval for errors in summary.methods.values() for interval in errors.by_second]
    logarithmic(error_axes, "y", intervals)
    error_axes.set(xlim=(0, times[-1]), xlabel="prediction time [s]", ylabel="mean distance [m]")
    coverage_axes.set(xlim=(0, len(errors.by_second)), ylim=(min(coverage_axes.get_ylim()[0], 90.0), 100.5))
    coverage_axes.set(xlabel="prediction time [s]", ylabel="positions in the 95 % region [%]")
    figure.legend(*error_axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def classes(figure: Figure, summaries: Mapping[str, MethodSummary]) -> None:
    """The error in each class, with the methods above."""
    axes = figure.subplots()
    breakdown(axes, summaries)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def write_evaluation(evaluation: Evaluation, text: str, provenance: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the JSON ``text`` and the page into a folder and return their paths. Raises :class:`StorageError`."""
    with written_together(folder / JSON_FILE):
        return [
            write_text(folder / JSON_FILE, text + "\n"),
            page_of(evaluation, provenance).write(folder / PAGE_FILE),
        ]


def page_of(evaluation: Evaluation, provenance: Mapping[str, Any]) -> Page:
    """The page; ``provenance`` says what was evaluated: files, vessel, stride, seed."""
    names = ", ".join(Path(file).name for file in provenance["files"])
    windows = "windows with recorded commands" if provenance.get("any_commands") else "held windows"
    counts = f"{evaluation.windows} {windows} of {evaluation.legs} legs"
    return render(
        "evaluation.html", templates=templates(), study=evaluation,
        title=f"Prediction methods compared over {evaluation.horizon_s} s",
        subtitle=f"{names}; vessel {provenance['vessel']}; {counts}",
    )  # fmt: skip


def headline_of(evaluation: Evaluation) -> dict[str, str]:
    """How the best learned method stands to the best baseline, on each honest split."""
    figures = {}
    for kind, split in evaluation.splits.items():
        learned = {name: errors for name, errors in split.causal.methods.items() if name not in BASELINES}
        if kind != "random" and learned:
            best = min(learned, key=lambda name: learned[name].ratio.value)
            words = f"{plain(best)} over {plain(split.causal.best_baseline)}, {MEANING[kind]}"
            figures[words] = f"{learned[best].ratio.value:.2f} \u00d7"
    return figures


def method_rows(split: SplitSummary) -> tuple[list[list[str]], int]:
    """A row a method, and which is the best."""
    rows = []
    for start, summary in split.by_start.items():
        for name, errors in summary.methods.items():
            inside = errors.coverage_95
            bounds = "" if inside.low != inside.low else f" ({inside.low:.0%}-{inside.high:.0%})"
            rows.append([
                no_wrap(plain(name)), start, no_wrap(estimate_text(errors.mean_distance_m)),
                f"{errors.end_distance_m.value:.2f}",
                no_wrap(f"{errors.mae_north_m.value:.2f}, {errors.mae_east_m.value:.2f}"),
                f"{errors.heading_error_deg.value:.1f}", no_wrap(estimate_text(errors.ratio)),
                no_wrap(f"{inside.value:.1%}{bounds}"),
            ])  # fmt: skip
    return rows, list(split.causal.methods).index(split.causal.best)


def leak_rows(evaluation: Evaluation) -> list[list[str]]:
    """How much larger the error on legs never seen is than what a random split shows."""
    return [[no_wrap(plain(name)), no_wrap(estimate_text(factor))] for name, factor in evaluation.leak.items()]


def draw_evaluation(figure: Figure, evaluation: Evaluation) -> None:
    """The ratio of every method's mean distance to the best baseline's, with its interval, a group a split."""
    axes, splits = figure.subplots(), evaluation.splits
    rows = [
        (kind, method, errors.ratio)
        for kind, split in splits.items()
        for method, errors in split.causal.methods.items()
        if method != split.causal.best_baseline
    ]
    colours = colours_of(list(next(iter(splits.values())).causal.methods))
    axes.axvline(1.0, color=INK, linewidth=1.0)
    for row, (_, method, ratio) in enumerate(rows):
        interval_bar(axes, ratio, row, colours[method])
    named_rows(axes, [f"{plain(method)}, {kind}" for kind, method, _ in rows])
    kinds = [kind for kind, _, _ in rows]
    for row in range(1, len(rows)):
        if kinds[row] != kinds[row - 1]:
            axes.axhline(row - 0.5, color=FAINT, linewidth=0.8)
    logarithmic(axes, "x", [ratio for _, _, ratio in rows])
    axes.set_xlabel("mean distance divided by that of the best baseline [1]")
