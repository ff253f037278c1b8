"""Pages from templates: results in, HTML out that needs no network, its figures embedded and kept for export.

Templates lie in ``templates`` beside this module; ``base.html`` has the look, ``macros.html`` tables, large numbers
and what else pages share, as ``ui`` in every template. A block may be rendered alone, as a section of a notebook.
"""

from __future__ import annotations

import base64
import logging
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from seatrial.acquisition.core.errors import ConfigurationError, printable
from seatrial.acquisition.core.files import atomic_file, write_text
from seatrial.acquisition.core.trial import software_version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True, slots=True)
class Page:
    """A page, or a section of one: its markup, and its figures by name."""

    html: str
    figures: dict[str, Figure] = field(default_factory=dict)
    title: str = ""

    def _repr_html_(self) -> str:
        return self.html

    def write(self, path: Path) -> Path:
        """Write the page, complete or not at all. Raises :class:`StorageError`."""
        return write_text(path, self.html)


def _escaped(value: Any) -> Any:
    """What a template writes, control characters in texts escaped; markup is made of texts that were."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


@cache
def environment(*folders: Path) -> Environment:
    """Where templates are looked for: in ``folders``, then in this package's."""
    from seatrial.analysis.manoeuvres.motion import motion_of
    from seatrial.analysis.report import manoeuvre_plots, pages, plots, tables

    made = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, finalize=_escaped,
    )  # fmt: skip
    made.filters |= {"plain": lambda name: name.replace("_", " "), "manoeuvre_line": tables.manoeuvre_line}
    made.globals |= {
        "version": software_version(), "level": 2, "subtitle": "", "body": "", "picture": picture,
        "plots": plots, "quality_page": pages,
        "motion_of": motion_of, "manoeuvre_figures": manoeuvre_plots, "manoeuvre_report": tables,
    }  # fmt: skip
    made.globals["ui"] = made.get_template("macros.html").module
    return made


def render(template: str, block: str = "", templates: Environment | None = None, **context: Any) -> Page:
    """A page from a template and what it names, or one ``block`` of it.

    In the template ``figure(draw, size_inch, caption, name, ...)`` embeds what ``draw(figure, ...)`` fills, and
    ``chart`` the same of a function that draws into axes; without a name it is how the caption begins. ``level`` is
    that of headings.
    """
    from seatrial.analysis.report.figures import file_name, fill_figure, png_of

    figures: dict[str, Figure] = {}

    def figure(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str = "", *what: Any
    ) -> Markup:
        made = fill_figure(lambda empty: draw(empty, *what), size_inch)
        figures[name or file_name(caption)] = made
        return picture(png_of(made), caption)

    def chart(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str, *what: Any
    ) -> Markup:
        return figure(lambda empty: draw(empty.subplots(), *what), size_inch, caption, name)

    source = (templates or environment()).get_template(template)
    values = {**context, "figure": figure, "chart": chart}
    if not block:
        return Page(source.render(values), figures, context.get("title", ""))
    return Page("".join(source.blocks[block](source.new_context(values))), figures)


def picture(png: bytes, caption: str) -> Markup:
    """A picture that is there already, embedded."""
    data = base64.b64encode(png).decode("ascii")
    return Markup(
        '<figure><img alt="{0}" src="data:image/png;base64,{1}"><figcaption>{0}</figcaption></figure>'
    ).format(caption, data)


def write_pdf(page: Path) -> Path:
    """Write a page of HTML beside itself as PDF, A4 and numbered, without what only a screen has; returns its path.

    Raises :class:`ConfigurationError` where WeasyPrint finds no Pango, which sets its lines; :class:`StorageError`.
    """
    try:
        with redirect_stdout(sys.stderr):  # it prints what it misses, amid what a command prints as JSON
            from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise ConfigurationError(
            "no PDF was written", where=str(page), why="WeasyPrint does not find the library Pango",
            fix="install it (Debian, Ubuntu: apt install libpangoft2-1.0-0; macOS: brew install pango; Windows: as "
            "WeasyPrint's documentation says), or print the page from a browser",
        ) from error  # fmt: skip
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # or fontTools writes the time of day into each font
    path = page.with_suffix(".pdf")
    with atomic_file(path) as partial:
        text = page.read_text(encoding="utf-8")  # by the name alone it does not find one that is no UTF-8
        HTML(string=text, base_url=page.absolute().as_uri()).write_pdf(partial)
    return path
