"""Figures beyond the screen: one way to fill one, to embed it, to export it, and to say the numbers behind it.

A figure is drawn by a function that fills it. What it shows can be had as SVG and PDF for print and, read back from
what was really drawn, as JSON: lines, points, bars, areas, images and texts of every axes, with the axes' labels.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
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

from seatrial.acquisition.core.files import atomic_file
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.report.plots import STYLE

Draw = Callable[[Figure], object]
ENDINGS = ("svg", "pdf", "json")
_PRINT: dict[str, object] = {**STYLE, "svg.hashsalt": "seatrial", "pdf.fonttype": 42}
_DPI = 110  # sharp enough at a page's width; time and size grow with it
_PRINT_DPI = 150
_NO_DATE: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}}


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
    return _saved(figure, "png", dpi=_DPI)


def write_figure(figure: Figure, folder: Path, name: str, endings: Sequence[str] = ENDINGS) -> list[Path]:
    """Write ``NAME.svg``, ``NAME.pdf`` and ``NAME.json`` into ``folder``, or what ``endings`` says (``png``, too).

    The same figure gives the same bytes: there is no time of day in them. Raises :class:`StorageError`.
    """
    paths = [folder / f"{name}.{ending}" for ending in endings]
    for path, ending in zip(paths, endings, strict=True):
        with atomic_file(path) as partial:
            partial.write_bytes(_content(figure, ending))
    return paths


def _content(figure: Figure, ending: str) -> bytes:
    if ending == "json":
        return json.dumps(numbers_of(figure)).encode() + b"\n"
    return _saved(figure, ending, dpi=_PRINT_DPI)


def file_name(text: str) -> str:
    """A file's name from the beginning of a caption.

    >>> file_name("How the error grows with the time predicted.")
    'how_the_error_grows_with_the'
    """
    return "_".join(re.findall(r"[a-z0-9]+", text.lower())[:6]) or "figure"


def _saved(figure: Figure, ending: str, **options: Any) -> bytes:
    stream = BytesIO()
    with mpl.rc_context(_PRINT):  # type: ignore[arg-type]
        figure.savefig(stream, format=ending, metadata=_NO_DATE.get(ending), **options)
    return stream.getvalue()


def numbers_of(figure: Figure) -> dict[str, Any]:
    """What is drawn, as plain values for JSON: ``axes``, each with ``title``, ``x`` and ``y`` (labels with units)
    and ``drawn``: objects with a ``kind`` and the numbers of it. Times are ISO 8601, what is no number is null.
    """
    return {"axes": [_axes_numbers(each) for each in figure.axes]}


def _axes_numbers(axes: Axes) -> dict[str, Any]:
    drawn = [values for artist in axes.get_children() for values in _artist_numbers(artist, axes)]
    title = axes.get_title() or axes.get_title(loc="left")
    x, y = (text.replace("\n", " ") for text in (axes.get_xlabel(), axes.get_ylabel()))
    return {"title": title, "x": x, "y": y, "drawn": drawn}


def _artist_numbers(artist: Artist, axes: Axes) -> Iterator[dict[str, Any]]:
    """The numbers of one artist, with its label where it has one; nothing of frames, grounds and empty texts."""
    if artist in (axes.patch, *axes.spines.values()) or not artist.get_visible():
        return
    label = str(artist.get_label())
    named = {} if re.match(r"_child\d|_nolegend_|$", label) else {"label": label.lstrip("_")}
    for values in _values(artist, axes):
        yield {**values, **named}


def _values(artist: Artist, axes: Axes) -> Iterator[dict[str, Any]]:
    if isinstance(artist, Line2D):
        x, y = artist.get_data()
        yield {"kind": "line", "x": _plain(x, axes), "y": _plain(y)}
    elif isinstance(artist, QuadMesh):
        edges = np.asarray(artist.get_coordinates())
        yield {"kind": "mesh", "x_edges": _plain(edges[0, :, 0]), "y_edges": _plain(edges[:, 0, 1]),
               "values": _rows(artist.get_array())}  # fmt: skip
    elif isinstance(artist, PathCollection):
        x, y = np.ma.filled(artist.get_offsets(), np.nan).T
        yield {"kind": "points", "x": _plain(x, axes), "y": _plain(y)}
    elif isinstance(artist, LineCollection):
        yield {"kind": "lines", "lines": [_corners(each, axes) for each in artist.get_segments()]}
    elif isinstance(artist, Collection):
        yield {"kind": "areas", "areas": [_corners(each.vertices, axes) for each in artist.get_paths()]}
    elif isinstance(artist, AxesImage):
        yield {"kind": "image", "values": _rows(artist.get_array())}
    elif isinstance(artist, Rectangle):
        x, width = artist.get_x(), artist.get_width()
        yield {"kind": "bar", "x": _plain([x, x + width], axes),
               "y": _plain([artist.get_y(), artist.get_y() + artist.get_height()])}  # fmt: skip
    elif isinstance(artist, Patch):
        corners = artist.get_patch_transform().transform_path(artist.get_path()).vertices
        yield {"kind": "area", **_corners(corners, axes)}
    elif isinstance(artist, Text) and artist.get_text().strip() not in (
        "",
        axes.get_title(),
        axes.get_title("left"),
    ):
        x, y = artist.get_position()
        yield {"kind": "text", "text": artist.get_text(), "x": _plain([x], axes)[0], "y": _plain([y])[0]}


def _corners(points: ArrayLike, axes: Axes) -> dict[str, Any]:
    x, y = np.asarray(points, dtype=float).reshape(-1, 2).T
    return {"x": _plain(x, axes), "y": _plain(y)}


def _rows(values: Any) -> list[Any]:
    array: Floats = np.ma.filled(np.ma.masked_invalid(np.ma.asarray(values, dtype=float)), np.nan)
    return [_plain(row) for row in np.atleast_2d(array)]


def _plain(values: Any, axes: Axes | None = None) -> list[Any]:
    """Values for JSON: seven digits of numbers, null for what is none, ISO 8601 for times along ``axes``."""
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind == "O" and array.size and isinstance(array.flat[0], pd.Timestamp):
        array = pd.DatetimeIndex(array).tz_convert(None).to_numpy()
    if array.dtype.kind == "M":
        return [None if np.isnat(each) else f"{np.datetime_as_string(each, 'ms')}Z" for each in array.ravel()]
    if array.dtype.kind in "US":
        return [str(each) for each in array.ravel()]
    numbers: Floats = np.ma.filled(np.ma.asarray(array, dtype=float), np.nan).ravel()
    if axes is not None and "Date" in type(axes.xaxis.get_converter()).__name__:  # matplotlib's own is private
        return [num2date(each).isoformat() if np.isfinite(each) else None for each in numbers]  # type: ignore[no-untyped-call]
    return [float(f"{each:.7g}") if np.isfinite(each) else None for each in numbers]
