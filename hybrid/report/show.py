"""What the cells of a notebook call: a section of a report, shown where it stands and its figures written to
files."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from acquisition.core.errors import SeatrialError
from analysis.report.figures import write_figure
from analysis.report.page import Page

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
        page = Page(level=_LEVEL)
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


def links(pages: Mapping[str, str | None]) -> Section:
    """Links to pages beside this one, by what they are; those that are None are left out, empty ones are no
    links."""
    items = [
        f'<li><a href="{quote(where)}">{escape(what)}</a></li>' if where else f"<li>{escape(what)}</li>"
        for what, where in pages.items()
        if where is not None
    ]
    return Section(f"<ul>{''.join(items)}</ul>" if items else "")
