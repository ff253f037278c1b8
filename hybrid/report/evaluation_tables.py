"""An evaluation in the terminal: one table a split, and where each method is good."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from hybrid.evaluation.summary import Evaluation, SplitSummary, counts_of
from hybrid.prediction.scores import FEW_LEGS, Interval

MEANING = {
    "leg": "whole legs never seen",
    "time": "the last 30 % of the time",
    "recording": "recordings never seen",
    "random": "windows at random, of legs trained on: flatters",
}

_FEW = 0.005  # a share that is shown as 0 %
_COLUMNS = ("mean m", "end m", "deg", "ratio", "in 95 %")


def evaluation_tables(evaluation: Evaluation) -> Iterator[Table]:
    """A table of methods a split, the best in bold, then one of its breakdown."""
    for split in evaluation.splits.values():
        yield methods_table(evaluation.horizon_s, split)
        if split.shown:
            yield breakdown_table(split)
    if evaluation.leak:
        yield _leak_table(evaluation)


def methods_table(horizon_s: int, split: SplitSummary) -> Table:
    """One row a method: mean distance, distance at the end, heading error, ratio to the best baseline, coverage.

    The first and the ratio with their 95 % intervals; all others have theirs in the JSON and on the page.
    """
    table = _table(f"{split.kind}: {MEANING[split.kind]}; {counts_of(split.whole)} of {horizon_s} s",
                   caption_of(split), *_COLUMNS)  # fmt: skip
    for name, each in split.whole.methods.items():
        cells = (
            spread(each.mean_distance_m), f"{each.end_distance_m.value:.2f}", f"{each.heading_error_deg.value:.1f}",
            spread(each.ratio), f"{each.coverage_95.value:.1%}",
        )  # fmt: skip
        table.add_row(name, *cells, style="bold" if name == split.whole.best else "")
    return table


def breakdown_table(split: SplitSummary) -> Table:
    """One row a class, the mean distance of every method, the best in bold."""
    methods = [name.replace("_", "\n") for name in split.whole.methods]
    table = _table(f"{split.kind}: mean distance m by class, with windows/legs", None, "", *methods)
    for classes in split.shown.values():
        for name, summary in classes.items():
            figures = {method: f"{each.mean_distance_m.value:.2f}" for method, each in summary.methods.items()}
            figures[summary.best] = f"[bold]{figures[summary.best]}[/bold]"
            table.add_row(name, f"{summary.windows}/{summary.legs}", *figures.values())
    return table


def caption_of(split: SplitSummary) -> str:
    """What to know of a split's figures."""
    fitted = sorted({min(split.fitted), max(split.fitted)})
    draws = "1 draw" if len(split.fitted) == 1 else f"{len(split.fitted)} draws"
    parts = [f"{draws}, {' to '.join(map(str, fitted))} windows to learn from",
             f"best baseline: {split.whole.best_baseline.replace('_', ' ')}"]  # fmt: skip
    if split.leaked:
        parts.append(f"{split.leaked:.0%} of the seconds judged were learned from")
    beyond = [
        f"{name} {each.outside_domain:.0%}"
        for name, each in split.whole.methods.items()
        if each.outside_domain >= _FEW
    ]
    if beyond:
        parts.append(f"windows that start beyond what was trained on: {', '.join(beyond)}")
    if split.whole.legs < FEW_LEGS:
        parts.append("so few legs that the intervals are too narrow")
    return "; ".join(parts)


def spread(interval: Interval) -> str:
    """A figure with its interval.

    >>> spread(Interval(1.0, 0.5, 2.0))
    '1.00 (0.50-2.00)'
    """
    bounds = "" if interval.low != interval.low else f" ({interval.low:.2f}-{interval.high:.2f})"
    return f"{interval.value:.2f}{bounds}"


def _leak_table(evaluation: Evaluation) -> Table:
    table = _table("error on unseen legs over random's", None, "times")
    for name, factor in evaluation.leak.items():
        table.add_row(name, spread(factor))
    return table


def _table(title: str, caption: str | None, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="dim", caption=caption,
                  caption_justify="left")  # fmt: skip
    table.add_column("", overflow="fold")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table
