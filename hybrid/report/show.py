"""What the cells of a notebook call: a section of a report, shown where it stands and its figures written to
files."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment

from acquisition.core.errors import SeatrialError
from analysis.report.figures import write_figure
from analysis.report.page import Page as BuiltPage
from analysis.report.rendering import Page, environment, render

FAILED = "This section failed, which is a fault of Seatrial"
_LEVEL = 3  # of headings inside a section: the notebook's own are above


@dataclass(frozen=True, slots=True)
class Section:
    """Markup that a notebook shows as it is."""

    html: str

    def _repr_html_(self) -> str:
        return self.html


def shown_in(folder: Path | str) -> Callable[..., Section]:
    """A function that shows a section: ``show(add, *what)`` calls ``add(page, *what)``.

    Its figures go into ``folder`` as SVG and PDF, the numbers behind them as JSON. A section that these data do not
    allow says why in its place; the others stand.
    """

    def show(add: Callable[..., Any], *what: Any) -> Section:
        page = BuiltPage(level=_LEVEL)
        try:
            add(page, *what)
        except SeatrialError as error:
            page.note(f"This could not be made: {error}")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()  # into the executed notebook
            page.note(f"{FAILED}: {type(error).__name__} {error}. The executed notebook has the trace.")
        for name, figure in page.figures.items():
            write_figure(figure, Path(folder), name)
        return Section("".join(page.parts))

    return show


def sections(template: str, folder: Path | str, **context: Any) -> Callable[..., Page]:
    """A function that shows a template's blocks: ``show("headline")``, with more of the ``context`` if need be.

    Their figures go into ``folder`` as SVG and PDF, the numbers behind them as JSON. A section that these data do
    not allow says why in its place; the others stand.
    """

    def show(block: str, **more: Any) -> Page:
        try:
            section = render(template, block, templates(), **{"level": _LEVEL, **context, **more})
        except SeatrialError as error:
            return _note(f"This could not be made: {error}")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()  # into the executed notebook
            return _note(f"{FAILED}: {type(error).__name__} {error}. The executed notebook has the trace.")
        for name, figure in section.figures.items():
            write_figure(figure, Path(folder), name)
        return section

    return show


def _note(text: str) -> Page:
    return render("failure.html", templates=templates(), text=text)


@cache
def templates() -> Environment:
    """The templates of this package, with what they call."""
    from hybrid.report import trial_plots, trial_sections

    made = environment(Path(__file__).parent / "templates")
    made.globals |= {"trial": trial_sections, "plots": trial_plots}
    return made


def links(pages: Mapping[str, str | None]) -> Page:
    """Links to pages beside this one, by what they are; those that are None are left out, empty ones are no
    links."""
    known = {what: quote(where) for what, where in pages.items() if where is not None}
    return render("links.html", templates=templates(), links=known)
