"""What the cells of a notebook call: a section of a report, shown where it stands and its figures written to
files."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment

from acquisition.core.errors import SeatrialError
from analysis.report.figures import write_figure
from analysis.report.rendering import Page, environment, render

FAILED = "This section failed, which is a fault of Seatrial"
_LEVEL = 3  # of headings inside a section: the notebook's own are above


def sections(template: str, folder: Path | str, /, **context: Any) -> Callable[..., Page]:
    """A function that shows a template's blocks: ``show("gap", "map")``, with more ``context`` if need be.

    Their figures go into ``folder`` as SVG and PDF, the numbers behind them as JSON. A section that these data do
    not allow says why in its place; the others stand.
    """

    def show(*blocks: str, **more: Any) -> Page:
        values = {"level": _LEVEL, **context, **more}
        try:
            shown = [render(template, block, templates(), **values) for block in blocks]
        except SeatrialError as error:
            return _note(f"This could not be made: {error}")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()  # into the executed notebook
            return _note(f"{FAILED}: {type(error).__name__} {error}. The executed notebook has the trace.")
        figures = {name: figure for section in shown for name, figure in section.figures.items()}
        for name, figure in figures.items():
            write_figure(figure, Path(folder), name)
        return Page("".join(section.html for section in shown), figures)

    return show


def _note(text: str) -> Page:
    return render("failure.html", templates=templates(), text=text)


@cache
def templates() -> Environment:
    """The templates of this package, with what they call."""
    from hybrid.diagnosis.serialisation import read_shown
    from hybrid.report import (
        diagnosis_map_plots,
        diagnosis_plots,
        diagnosis_words,
        evaluation_page,
        evaluation_plots,
        trial_plots,
        trial_sections,
    )
    from hybrid.report.diagnosis_phrases import chance, percent
    from hybrid.reproduction import page as table3

    made = environment(Path(__file__).parent / "templates")
    made.filters |= {"percent": percent, "chance": chance, "cell_row": diagnosis_words.cell_row}
    made.globals |= {
        "trial": trial_sections, "trial_plots": trial_plots, "diagnosis_words": diagnosis_words,
        "diagnosis_plots": diagnosis_plots, "map_plots": diagnosis_map_plots, "evaluation": evaluation_page,
        "evaluation_plots": evaluation_plots, "read_shown": read_shown, "table3": table3,
    }  # fmt: skip
    return made


def links(pages: Mapping[str, str | None]) -> Page:
    """Links to pages beside this one, by what they are; those that are None are left out, empty ones are no
    links."""
    known = {what: quote(where) for what, where in pages.items() if where is not None}
    return render("links.html", templates=templates(), links=known)
