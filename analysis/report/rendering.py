"""Pages from templates, and figures for pages, print and programs.

Templates lie in ``templates`` beside this module: ``base.html`` has the look, ``macros.html`` what pages share, as
``ui`` in every template. A page needs no network: its figures are embedded. A block may be rendered alone, as a
section of a notebook. A figure is filled by a function and can be written as SVG and PDF and, read back from what
was really drawn, as JSON: lines, points, bars, areas, images and texts of every axes, with the axes' labels.
"""

from __future__ import annotations

import base64
import json
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PathCollection, QuadMesh
from matplotlib.dates import num2date
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.text import Text
from numpy.typing import ArrayLike, NDArray

from seatrial.acquisition.core.errors import ConfigurationError, printable
from seatrial.acquisition.core.files import atomic_file, write_text
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.report.plots import STYLE

TEMPLATES = Path(__file__).parent / "templates"
Draw = Callable[[Figure], object]
ENDINGS = ("svg", "pdf", "json")
_PRINT: dict[str, object] = {**STYLE, "svg.hashsalt": "seatrial", "pdf.fonttype": 42}
_DPI = 110  # sharp enough at a page's width; time and size grow with it
_PRINT_DPI = 150
_NO_DATE: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}}


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


@cache
def environment(*folders: Path) -> Environment:
    """Where templates are looked for: in ``folders``, then in this package's."""
    from seatrial.analysis.manoeuvres.motion import motion_of
    from seatrial.analysis.report import manoeuvre_plots, pages, plots, tables

    templates = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
        # control characters in texts are escaped; markup is made of texts that were
        finalize=lambda text: printable(text) if isinstance(text, str) and not isinstance(text, Markup) else text,
    )  # fmt: skip
    templates.filters |= {"plain": lambda name: name.replace("_", " "), "manoeuvre_line": tables.manoeuvre_line}
    templates.globals |= {
        "version": software_version(), "level": 2, "subtitle": "", "body": "", "picture": picture,
        "plots": plots, "quality_page": pages,
        "motion_of": motion_of, "manoeuvre_figures": manoeuvre_plots, "manoeuvre_report": tables,
    }  # fmt: skip
    templates.globals["ui"] = templates.get_template("macros.html").module
    return templates


def render(template: str, block: str = "", templates: Environment | None = None, **context: Any) -> Page:
    """A page from a template and what it names, or one ``block`` of it.

    In the template ``figure(draw, size_inch, caption, name, ...)`` embeds what ``draw(figure, ...)`` fills, and
    ``chart`` the same of a function that draws into axes; without a name it is how the caption begins. ``level`` is
    that of headings.
    """
    figures: dict[str, Figure] = {}

    def figure(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str = "", *arguments: Any
    ) -> Markup:
        filled = fill_figure(lambda empty: draw(empty, *arguments), size_inch)
        figures[name or file_name(caption)] = filled
        return picture(png_of(filled), caption)

    def chart(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str, *arguments: Any
    ) -> Markup:
        return figure(lambda empty: draw(empty.subplots(), *arguments), size_inch, caption, name)

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
    """Write a page of HTML as PDF into its folder, A4 and numbered, without its controls; returns the path.

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


def fill_figure(draw: Draw, size_inch: tuple[float, float]) -> Figure:
    """A figure of ``size_inch`` that ``draw`` has filled, in the house's style."""
    with mpl.rc_context(_PRINT):  # type: ignore[arg-type]
        figure = Figure(figsize=size_inch)
        draw(figure)
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
        figure.set_layout_engine("none")  # it is laid out, and would be again for each format
    return figure


def png_of(figure: Figure) -> bytes:
    """The figure as a picture for a page."""
    return _bytes_of(figure, "png", _DPI)


def write_figure(figure: Figure, folder: Path, name: str, endings: Sequence[str] = ENDINGS) -> list[Path]:
    """Write ``NAME.svg``, ``NAME.pdf`` and ``NAME.json`` into ``folder``, or what ``endings`` says (``png``, too).

    The same figure gives the same bytes: there is no time of day in them. Raises :class:`StorageError`.
    """
    paths = [folder / f"{name}.{ending}" for ending in endings]
    for path, ending in zip(paths, endings, strict=True):
        with atomic_file(path) as partial:
            if ending == "json":
                partial.write_bytes(json.dumps(numbers_of(figure)).encode() + b"\n")
            else:
                partial.write_bytes(_bytes_of(figure, ending, _PRINT_DPI))
    return paths


def _bytes_of(figure: Figure, ending: str, dpi: int) -> bytes:
    stream = BytesIO()
    with mpl.rc_context(_PRINT):  # type: ignore[arg-type]
        figure.savefig(stream, format=ending, metadata=_NO_DATE.get(ending), dpi=dpi)
    return stream.getvalue()


def file_name(text: str) -> str:
    """A file's name from the beginning of a caption.

    >>> file_name("How the error grows with the time predicted.")
    'how_the_error_grows_with_the'
    """
    return "_".join(re.findall(r"[a-z0-9]+", text.lower())[:6]) or "figure"


def numbers_of(figure: Figure) -> dict[str, Any]:
    """What is drawn, as plain values for JSON: ``axes``, each with ``title``, ``x`` and ``y`` (labels with units)
    and ``drawn``: objects with a ``kind`` and the numbers of it. Times are ISO 8601, what is no number is null.
    """
    return {"axes": [
        {
            "title": axes.get_title() or axes.get_title(loc="left"),
            "x": axes.get_xlabel().replace("\n", " "), "y": axes.get_ylabel().replace("\n", " "),
            "drawn": list(_drawn(axes)),
        }
        for axes in figure.axes
    ]}  # fmt: skip


def _drawn(axes: Axes) -> Iterator[dict[str, Any]]:
    """The numbers of each artist, with its label if it has one; nothing of frames, grounds and empty texts."""
    for artist in axes.get_children():
        if artist not in (axes.patch, *axes.spines.values()) and artist.get_visible():
            label = str(artist.get_label())
            labelled = {} if re.match(r"_child\d|_nolegend_|$", label) else {"label": label.lstrip("_")}
            yield from ({**values, **labelled} for values in _shape_numbers(artist, axes))


def _shape_numbers(artist: Artist, axes: Axes) -> Iterator[dict[str, Any]]:
    if isinstance(artist, Line2D):
        x, y = artist.get_data()
        yield {"kind": "line", "x": _json_values(x, axes), "y": _json_values(y)}
    elif isinstance(artist, QuadMesh):
        edges = np.asarray(artist.get_coordinates())
        yield {"kind": "mesh", "x_edges": _json_values(edges[0, :, 0]), "y_edges": _json_values(edges[:, 0, 1]),
               "values": _json_rows(artist.get_array())}  # fmt: skip
    elif isinstance(artist, PathCollection):
        x, y = np.ma.filled(artist.get_offsets(), np.nan).T
        yield {"kind": "points", "x": _json_values(x, axes), "y": _json_values(y)}
    elif isinstance(artist, LineCollection):
        yield {"kind": "lines", "lines": [_corners(segment, axes) for segment in artist.get_segments()]}
    elif isinstance(artist, Collection):
        yield {"kind": "areas", "areas": [_corners(path.vertices, axes) for path in artist.get_paths()]}
    elif isinstance(artist, AxesImage):
        yield {"kind": "image", "values": _json_rows(artist.get_array())}
    elif isinstance(artist, Rectangle):
        x, width = artist.get_x(), artist.get_width()
        yield {"kind": "bar", "x": _json_values([x, x + width], axes),
               "y": _json_values([artist.get_y(), artist.get_y() + artist.get_height()])}  # fmt: skip
    elif isinstance(artist, Patch):
        corners = artist.get_patch_transform().transform_path(artist.get_path()).vertices
        yield {"kind": "area", **_corners(corners, axes)}
    elif isinstance(artist, Text):
        x, y = artist.get_position()
        if artist.get_text().strip() not in ("", axes.get_title(), axes.get_title("left")):
            place = {"x": _json_values([x], axes)[0], "y": _json_values([y])[0]}
            yield {"kind": "text", "text": artist.get_text(), **place}


def _corners(points: ArrayLike, axes: Axes) -> dict[str, Any]:
    x, y = np.asarray(points, dtype=float).reshape(-1, 2).T
    return {"x": _json_values(x, axes), "y": _json_values(y)}


def _json_rows(values: Any) -> list[Any]:
    array: Floats = np.ma.filled(np.ma.masked_invalid(np.ma.asarray(values, dtype=float)), np.nan)
    return [_json_values(row) for row in np.atleast_2d(array)]


def _json_values(values: Any, axes: Axes | None = None) -> list[Any]:
    """Values for JSON: seven digits of numbers, null for what is none, ISO 8601 for times along ``axes``."""
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind == "O" and array.size and isinstance(array.flat[0], pd.Timestamp):
        array = pd.DatetimeIndex(array).tz_convert(None).to_numpy()
    if array.dtype.kind == "M":
        return [None if np.isnat(time) else f"{np.datetime_as_string(time, 'ms')}Z" for time in array.ravel()]
    if array.dtype.kind in "US":
        return [str(text) for text in array.ravel()]
    numbers: Floats = np.ma.filled(np.ma.asarray(array, dtype=float), np.nan).ravel()
    if axes is not None and "Date" in type(axes.xaxis.get_converter()).__name__:  # matplotlib's own is private
        return [num2date(number).isoformat() if np.isfinite(number) else None for number in numbers]  # type: ignore[no-untyped-call]
    return [float(f"{number:.7g}") if np.isfinite(number) else None for number in numbers]
