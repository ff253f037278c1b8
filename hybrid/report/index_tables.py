"""Measured beside simulated indices, and errors over times in L/V, as lines of cells for a page and a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from seatrial.analysis.report.tables import index_cells, plain_name
from seatrial.hybrid.report.tables import text_table

if TYPE_CHECKING:
    from seatrial.hybrid.evaluation.length_times import LengthErrors
    from seatrial.hybrid.evaluation.manoeuvre_indices import (
        IndexComparison,
        IndexComparisons,
        NotSimulated,
        SimulatedIndex,
    )

INDEX_HEADER = ("index", "measured", "95 % interval", "predicted", "difference", "replayed", "difference")
OUTSIDE, REMOVED = "*", "\u2020"
LEGEND = (
    "predicted: the same test by the model in still air; replayed: the recorded controls and wind from "
    f"the state at the order; {OUTSIDE} outside the measured 95 % interval"
)


def index_tables(comparisons: IndexComparisons) -> list[tuple[str, list[list[str]]]]:
    """A table a test and model: its title, and a line an index in the columns of :data:`INDEX_HEADER`."""
    grouped = groupby(comparisons.rows, key=lambda row: (row.start, row.test, row.side, row.method))
    several = len({row.method for row in comparisons.rows}) > 1
    return [
        (test_title(test, side, method if several else "", f"{start:%H:%M:%S}"), [index_line(row) for row in rows])
        for (start, test, side, method), rows in grouped
    ]


def test_title(test: str, side: str, method: str, time: str) -> str:
    """The time, the test, its side, and the model.

    >>> test_title("zigzag 10/10", "port", "hybrid", "10:00:00")
    '10:00:00 zigzag 10/10 to port, hybrid'
    """
    sided = f"{test} to {side}" if side and side not in test else test
    return f"{time} {sided}{', ' * bool(method)}{method}"


def index_line(row: IndexComparison) -> list[str]:
    """The cells of an index in the columns of :data:`INDEX_HEADER`: differences in its unit and in percent."""
    value, interval, *_ = index_cells(row.measured)
    decimals = len(value.split()[0].partition(".")[2])
    name = plain_name(row.name) + REMOVED * row.current_removed
    simulated = (cell for form in (row.predicted, row.replayed) for cell in _simulated_cells(form, decimals))
    return [name, value, interval, *simulated]


def _simulated_cells(simulated: SimulatedIndex | None, decimals: int) -> tuple[str, str]:
    if simulated is None:
        return "", ""
    percent = "" if simulated.percent is None else f" ({simulated.percent:+.1f} %)"
    outside = OUTSIDE if simulated.within is False else ""
    difference = f"{simulated.difference:+.{decimals}f}{percent}{outside}"
    return f"{simulated.value:.{decimals}f}", difference.replace("-", "\u2212")


def notes_of_indices(comparisons: IndexComparisons) -> list[str]:
    """What the tables mean, what the model does not know, and which tests it did not make, a sentence each."""
    removed = [f"{REMOVED} the current removed."] if any(row.current_removed for row in comparisons.rows) else []
    legend = [f"{LEGEND[0].upper()}{LEGEND[1:]}."] if comparisons.rows else []
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in comparisons.remarks]
    return [*legend, *removed, *remarks, *left_out_lines(comparisons.left_out)]


def left_out_lines(left_out: Sequence[NotSimulated]) -> list[str]:
    """Which tests were not simulated, those of one reason in a sentence."""
    tests: dict[tuple[str, str, str], list[str]] = {}
    for each in left_out:
        named = test_title(each.test, each.side, "", "").strip()
        tests.setdefault((each.method, each.form, each.why), []).append(named)
    return [
        f"Not {form} by the {method} model: {', '.join(dict.fromkeys(names))}: {why}."
        for (method, form, why), names in tests.items()
    ]


def indices_view(comparisons: IndexComparisons) -> Group:
    """The tables for a terminal, and their notes."""
    tables = [
        text_table(title, INDEX_HEADER, lines, title_style="bold") for title, lines in index_tables(comparisons)
    ]
    return Group(*tables, *(Text(note, style="dim") for note in notes_of_indices(comparisons)))


def length_header(errors: LengthErrors) -> list[str]:
    """The columns of :func:`length_lines`."""
    times = zip(errors.lengths, errors.seconds, strict=True)
    return ["method", *(f"{lengths} L/V = {seconds} s" for lengths, seconds in times)]


def length_lines(errors: LengthErrors) -> list[list[str]]:
    """A line a method: the distance, in ship lengths, and the heading error at each time."""
    return [
        [name.replace("_", " "), *(f"{each.distance_m:.3g} m, {each.distance_lengths:.2f} L, "
                                   f"{each.heading_error_deg:.1f} deg" for each in found)]
        for name, found in errors.methods.items()
    ]  # fmt: skip


def length_title(errors: LengthErrors, horizon_s: int) -> str:
    """What L/V is, and how many of it the horizon is."""
    time_s = errors.length_time_s
    return (
        f"error after L/V = {errors.length_m:.3g} m / {errors.speed_mps:.3g} m/s = {time_s:.3g} s, in "
        f"{errors.windows} windows under their commands ({horizon_s} s = {horizon_s / time_s:.2g} L/V)"
    )


def length_table(errors: LengthErrors, horizon_s: int) -> Table:
    """The errors by L/V for a terminal."""
    return text_table(length_title(errors, horizon_s), length_header(errors), length_lines(errors), wrap=True)
