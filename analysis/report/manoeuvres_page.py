"""Manoeuvres as a section of a page: all of them in a table, then each with its indices, limits and picture."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from analysis.manoeuvres.indices import Manoeuvre
from analysis.manoeuvres.motion import motion_of
from analysis.manoeuvres.report import HEADER, cells, headline, rows_of, subline, words
from analysis.report.page import Page

_PICTURED = frozenset({"zigzag", "turning_circle", "stopping", "acceleration", "crabbing"})
"""Kinds whose picture says more than their indices do; of a ship that goes straight the series say it all."""

_FIRST_INDICES = 3
_SECONDARY = ("half_command", "time_to_check", "initial_turning")  # left to the manoeuvre's own table


def add_manoeuvres(
    page: Page, table: pd.DataFrame, found: Sequence[Manoeuvre], length_m: float | None, *, pictures: bool = True
) -> None:
    """All manoeuvres of a table in a table, then each with its indices, and a picture where that says something."""
    page.table(["began, UTC", "what", "lasted", "first indices"], [_line(each) for each in found], words=True)
    page.text("A click opens or closes what is below; IMO limits are those of MSC.137(76), for information.")
    motion = motion_of(table)
    for number, each in enumerate(found, start=1):
        pictured = each.kind in _PICTURED
        with page.details(headline(each), opened=pictured):
            if pictured and pictures:
                from analysis.report.manoeuvre_plots import drawer

                page.figure(*drawer(motion, each, length_m), subline(each), f"manoeuvre_{number:02d}_{each.kind}")
            else:
                page.text(subline(each))
            few, every = rows_of(each, every=False), rows_of(each)
            page.table(*_without_empty(list(HEADER), few))
            if len(every) > len(few):
                with page.details(f"All {len(every)} indices"):
                    page.table(*_without_empty(list(HEADER), every))


def _line(manoeuvre: Manoeuvre) -> list[str]:
    """A manoeuvre's row in the table of all."""
    side = f" to {manoeuvre.side}" if manoeuvre.side and manoeuvre.side not in manoeuvre.name else ""
    telling = [each for each in manoeuvre.indices.items() if not any(part in each[0] for part in _SECONDARY)]
    first = telling[:_FIRST_INDICES]
    said = ", ".join(f"{words(name)} {cells(index)[0]}" for name, index in first)
    seconds = (manoeuvre.end - manoeuvre.start).total_seconds()
    return [f"{manoeuvre.start:%H:%M:%S}", f"{manoeuvre.name}{side}", f"{seconds:.0f} s", said]


def _without_empty(header: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """A table without the columns that hold nothing.

    >>> _without_empty(["index", "limit"], [["reach", ""]])
    (['index'], [['reach']])
    """
    kept = [place for place in range(len(header)) if not rows or any(row[place] for row in rows)]
    return [header[place] for place in kept], [[row[place] for place in kept] for row in rows]
