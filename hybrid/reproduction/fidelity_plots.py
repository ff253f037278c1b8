"""The map of where reference, hybrid and pure data win, as a picture: cells of the winner's colour."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from acquisition.core.arrays import Floats
from analysis.report.figures import filled, write_figure
from analysis.report.plots import INK
from analysis.tables.files import atomic_file
from hybrid.report.style import COLOUR, plain_numbers
from hybrid.reproduction.degradation import OVERALL
from hybrid.reproduction.fidelity_map import LEAST_M, FidelityMap, useful_up_to_m
from hybrid.reproduction.fidelity_reading import with_reading

PALEST, FULL_MARGIN = 0.25, 0.5
"""How much colour a cell has whose winner leads by nothing, and the lead from which it has all of it."""
NAME = "fidelity_map"


def fidelity_cells(axes: Axes, found: FidelityMap) -> list[Artist]:
    """A cell for each reference and amount of data: coloured by who wins, stronger the further ahead; its error.

    Rows are the references of the main axis, the best at the bottom, labelled by their own error [m] and that over
    constant velocity's. Above the lines the hybrid is not better than the data alone.
    """
    main = found.overall()
    errors_m = main.errors_m()
    ranked = np.sort(errors_m, axis=0)
    winner, lead = errors_m.argmin(axis=0), 1.0 - ranked[0] / ranked[1]
    artists: list[Artist] = []
    for row, column in np.ndindex(winner.shape):
        strength = PALEST + (1.0 - PALEST) * min(1.0, float(lead[row, column]) / FULL_MARGIN)
        colour = _paler(_colour(main, int(winner[row, column])), strength)
        artists.append(axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, color=colour, linewidth=0)))
        axes.text(
            column,
            row,
            f"{ranked[0, row, column]:.2f}",
            ha="center",
            va="center",
            fontsize=8,
            color=_legible(colour),
        )
    columns = np.arange(len(main.windows))
    limits = axes.hlines(_limit_rows(main), columns - 0.5, columns + 0.5, color=INK, linewidth=3.0, clip_on=False)
    artists.append(limits)
    _label_cells(axes, main)
    return artists


def _label_cells(axes: Axes, main: FidelityMap) -> None:
    references = [f"{each:.2f} m ({each / main.constant_velocity_m:.1f})" for each in main.reference_m]
    axes.set_xticks(range(len(main.windows)), [str(each) for each in main.windows])
    axes.set_yticks(range(len(references)), references)
    axes.set_xlim(-0.5, len(main.windows) - 0.5)
    axes.set_ylim(-0.5, len(references) - 0.5)
    axes.grid(visible=False)
    axes.set_xlabel("windows to learn from")
    axes.set_ylabel("the reference's own error [m] (times constant velocity's)")


def legend_handles(found: FidelityMap) -> list[Patch | Line2D]:
    """What the colours and the line say; the numbers in the cells are the winner's error."""
    names = ["reference alone", "constant velocity", "data alone", f"hybrid ({found.method})"]
    patches = [Patch(facecolor=_colour(found, number), label=name) for number, name in enumerate(names)]
    if np.isinf(useful_up_to_m(found)).all():
        return list(patches)
    return [*patches, Line2D([], [], color=INK, linewidth=2.0, label="above it no better than data alone")]


def _colour(found: FidelityMap, number: int) -> str:
    """The colour of a rival; the calibrator has the hybrid's, whichever it is."""
    return COLOUR["hybrid"] if number == len(found.rivals) - 1 else COLOUR[found.rivals[number]]


def _legible(colour: tuple[float, float, float]) -> str:
    """Ink or white, whichever stands out more from ``colour`` by the contrast ratio of WCAG 2.1."""
    behind = _luminance(colour) + 0.05
    return max((INK, "white"), key=lambda text: abs(np.log((_luminance(to_rgb(text)) + 0.05) / behind)))


def _luminance(colour: tuple[float, float, float]) -> float:
    """The relative luminance of an sRGB colour, its gamma taken as 2.2."""
    return float(np.dot(np.power(colour, 2.2), (0.2126, 0.7152, 0.0722)))


def _paler(colour: str, strength: float) -> tuple[float, float, float]:
    red, green, blue = (1.0 - strength * (1.0 - part) for part in to_rgb(colour))
    return red, green, blue


def _limit_rows(main: FidelityMap) -> Floats:
    """The thresholds as heights on the axis of rows [W]; none where the hybrid is better on all of them."""
    limits = useful_up_to_m(main)
    limit, error = (np.log(np.maximum(each, LEAST_M)) for each in (limits, main.reference_m))
    rows = np.interp(limit, error, np.arange(len(main.reference_m)))
    return np.where(np.isinf(limits), np.nan, np.where(limits == 0.0, -0.5, rows))


def draw_map(figure: Figure, found: FidelityMap) -> None:
    """The map with its legend."""
    axes = figure.subplots()
    fidelity_cells(axes, found)
    axes.set_title("Who predicts best, and the mean error that the best leaves [m]", loc="left")
    figure.legend(handles=legend_handles(found), loc="outside lower center", ncols=3)


def draw_axes(figure: Figure, found: FidelityMap) -> None:
    """The hybrid's error against the reference's own, whatever was degraded, for few and many windows."""
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    ends = [found.reference_m.min(), found.reference_m.max()]
    axes.plot(ends, ends, ":", color=INK, linewidth=1.0)
    for column, shade in _shades(found).items():
        axes.axhline(found.data_driven_m[column], color=_paler(COLOUR["data_driven"], shade), linewidth=1.0)
        for kind, marker in _markers(found).items():
            rows = [number for number, axis in enumerate(found.axis) if axis == kind]
            colour = _paler(COLOUR["hybrid"], shade)
            axes.plot(found.reference_m[rows], found.hybrid_m[rows, column], marker, color=colour, markersize=5)
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis)
    axes.set_title("What the hybrid leaves, whatever is wrong with its reference", loc="left")
    axes.set_xlabel("the reference's own error [m]")
    axes.set_ylabel("the hybrid's error [m]")
    figure.legend(handles=_axes_handles(found), loc="outside lower center", ncols=3)


def _axes_handles(found: FidelityMap) -> list[Line2D]:
    called = {OVERALL: "all, step by step"}
    return [
        *(
            Line2D([], [], color=INK, marker=marker, linestyle="none", label=called.get(kind, kind))
            for kind, marker in _markers(found).items()
        ),
        *(
            Line2D(
                [], [], color=_paler(COLOUR["hybrid"], shade), linewidth=4, label=f"{found.windows[column]} windows"
            )
            for column, shade in _shades(found).items()
        ),
        Line2D([], [], color=COLOUR["data_driven"], linewidth=1.0, label="data alone, as many windows"),
        Line2D([], [], color=INK, linewidth=1.0, linestyle=":", label="the reference alone"),
    ]


def _markers(found: FidelityMap) -> dict[str, str]:
    return dict(zip(dict.fromkeys(found.axis), "osD^", strict=False))


def _shades(found: FidelityMap) -> dict[int, float]:
    """The columns shown, few windows, some and many, and how much of its colour each has."""
    columns = sorted({0, len(found.windows) // 2, len(found.windows) - 1})
    return dict(zip(columns, (0.35, 0.65, 1.0), strict=False))


def write_map(found: FidelityMap, folder: Path) -> list[Path]:
    """The map as PNG, SVG and PDF, its numbers and its reading as JSON. Raises :class:`StorageError`."""
    path = folder / f"{NAME}.json"
    with atomic_file(path) as unfinished:
        unfinished.write_text(json.dumps(with_reading(found), indent=2) + "\n", encoding="utf-8")
    paths = [path]
    for name, draw, size_inch in ((NAME, draw_map, (8.5, 5.6)), (f"{NAME}_axes", draw_axes, (8.5, 5.2))):
        figure = filled(partial(draw, found=found), size_inch)
        paths += write_figure(figure, folder, name, ("png", "svg", "pdf"))
    return paths
