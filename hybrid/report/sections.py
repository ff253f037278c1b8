"""Sections of reports: the blocks of a template, each of a result, shown on a page or in a notebook."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment

from seatrial.acquisition.core.errors import SeatrialError
from seatrial.analysis.report.rendering import Page, environment, render, write_figure
from seatrial.analysis.report.tables import in_words, reason_of

FAILED = "This section failed, which is a fault of Seatrial"
_LEVEL = 3  # of headings inside a section: that of the section is above


def sections(template: str, folder: Path | str | None = None, /, **context: Any) -> Callable[..., Page]:
    """A function that shows a template's blocks: ``show("gap", "map")``, with more ``context`` if need be.

    Their figures go into ``folder`` as SVG, the numbers behind them as JSON. A section that these data do
    not allow says why in its place; the others stand.
    """

    def show(*blocks: str, **block_context: Any) -> Page:
        values = {"level": _LEVEL, **context, **block_context}
        try:
            shown = [render(template, block, templates(), **values) for block in blocks]
        except SeatrialError as error:
            return _note(f"This could not be made: {reason_of(str(error.at('')))}.")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()
            return _note(f"{FAILED}: {type(error).__name__} {error}.")
        figures = {name: figure for section in shown for name, figure in section.figures.items()}
        for name, figure in figures.items() if folder is not None else ():
            write_figure(figure, Path(folder or ""), name, ("svg", "json"))
        return Page("".join(section.html for section in shown), figures)

    return show


def _note(text: str) -> Page:
    return render("failure.html", templates=templates(), text=text)


@cache
def templates() -> Environment:
    """The templates of this package, with what they call."""
    from seatrial.analysis.manoeuvres.criteria import shortfalls_of
    from seatrial.analysis.speed_power import report as speed_power
    from seatrial.hybrid.diagnosis.result import read_diagnosis
    from seatrial.hybrid.prediction.baselines import FEW_LEGS
    from seatrial.hybrid.report import (
        diagnosis,
        diagnosis_plots,
        evaluation_page,
        plan_page,
        text,
        trial,
        trial_form,
        trial_plots,
        vessel_check,
    )
    from seatrial.hybrid.report.diagnosis import chance, percent
    from seatrial.hybrid.report.errors import ENOUGH_S

    library = environment(Path(__file__).parent / "templates")
    library.filters |= {"percent": percent, "chance": chance, "cell_row": diagnosis.cell_row,
                     "in_words": in_words, "reason_of": reason_of,
                     "rows_in_words": lambda rows: [[in_words(cell) for cell in row] for row in rows],
                     "sentence": lambda text: f"{text[:1].upper()}{text[1:]}."}  # fmt: skip
    library.globals |= {
        "trial": trial, "form": trial_form, "index_tables": trial_form,
        "trial_plots": trial_plots, "diagnosis_words": diagnosis,
        "diagnosis_plots": diagnosis_plots, "map_plots": diagnosis_plots, "evaluation": evaluation_page,
        "read_diagnosis": read_diagnosis, "speed_power": speed_power, "tables": text, "plans": plan_page,
        "checks": vessel_check, "shortfalls_of": shortfalls_of, "FEW_LEGS": FEW_LEGS,
        "ENOUGH_S": ENOUGH_S,
    }  # fmt: skip
    return library
