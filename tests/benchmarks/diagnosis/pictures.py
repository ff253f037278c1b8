"""The benchmark's two figures: what was hidden against what was reported, and power against size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from seatrial.hybrid.effects import CATALOGUE
from tests.benchmarks.diagnosis.scoring import (
    Result,
    Test,
    detected,
    exact,
    in_set,
    names,
    says_unknown,
    share,
)

NOT_ONE = ("none", "unknown", "several")


def reported(result: Result) -> str:
    """The column of the confusion matrix: the one effect named, or why there is not one."""
    if says_unknown(result):
        return "unknown"
    named = names(result)
    return named[0] if len(named) == 1 else "several" if named else "none"


def draw_confusion(singles: Sequence[Result], path: Path) -> None:
    """Hidden against reported, in percent of each hidden effect's cases; only effects that occur have a row."""
    counts: dict[str, dict[str, int]] = {}
    for result in singles:
        (hidden,) = result["hidden"]
        row = counts.setdefault(hidden, {})
        row[reported(result)] = row.get(reported(result), 0) + 1
    seen = {column for row in counts.values() for column in row} | set(counts)
    rows = [name for name in CATALOGUE if name in counts]
    columns = [name for name in CATALOGUE if name in seen] + list(NOT_ONE)
    matrix = np.array([[counts[row].get(column, 0) for column in columns] for row in rows], dtype=float)
    matrix = matrix.reshape(len(rows), len(columns)) / np.maximum(matrix.sum(axis=-1, keepdims=True), 1.0)
    figure = Figure(figsize=(2.8 + 0.19 * len(columns), 2.4 + 0.19 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(matrix, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(matrix):
        if value > 0.0:
            colour = "white" if value > 0.5 else "black"
            axes.text(column, row, f"{100.0 * value:.0f}", ha="center", va="center", fontsize=5, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=6)
    axes.set_yticks(range(len(rows)), rows, fontsize=6)
    axes.set_xlabel("reported", fontsize=7)
    axes.set_ylabel("hidden, at twice its limit and more", fontsize=7)
    _save(figure, path)


def draw_power(singles: Sequence[Result], path: Path) -> None:
    """Shares detected, rightly named and in the reported set, against size in units of the limit."""
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    _curve(axes, singles, "something is missing", detected, -0.03)
    _curve(axes, singles, "hidden effect in the reported set", in_set, 0.0)
    _curve(axes, singles, "hidden effect named, nothing else", exact, 0.03)
    axes.axhline(0.9, color="grey", linewidth=0.8, linestyle=":")
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("size of the hidden effect, in units of its predicted limit")
    axes.set_ylabel("share of cases, 95 % interval")
    axes.legend(frameon=False, fontsize=8)
    _save(figure, path)


def _curve(axes: Axes, singles: Sequence[Result], label: str, test: Test, aside: float) -> None:
    sizes = sorted({each["multiple"] for each in singles})
    shares = [share([each for each in singles if each["multiple"] == size], test) for size in sizes]
    ends = np.array([each.interval for each in shares]).reshape(-1, 2).T
    middle = np.array([each.value for each in shares])
    axes.errorbar(np.array(sizes) + aside, middle, [middle - ends[0], ends[1] - middle], marker="o", label=label)


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.hashsalt": "seatrial"}):
        figure.savefig(path, dpi=110, metadata={"Software": None})
