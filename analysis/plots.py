"""Figures of tables and windows in one style: functions take axes and data and return the artists they drew.

This is the only module of the package that knows matplotlib.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.dates as dates
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from acquisition.angles import difference
from acquisition.channels import BY_NAME
from analysis.time_index import utc_index

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442")
"""The colours of Okabe and Ito, which the colour-blind tell apart, the darkest first."""
INK, FAINT, HELD = "#333333", "#B8B8B8", "#56B4E9"

STYLE: dict[str, object] = {
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "figure.dpi": 120,
    "font.size": 9.0,
    "grid.color": "#E6E6E6",
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "xtick.color": INK,
    "ytick.color": INK,
}
"""The house's style, for ``matplotlib.rc_context(STYLE)``."""


def label(name: str) -> str:
    """A channel's name for an axis, with its unit.

    >>> label("port_angle_deg")
    'port angle [deg]'
    """
    channel = BY_NAME[name]
    return f"{name.rsplit('_', 1)[0].replace('_', ' ')} [{channel.unit}]"


def track(
    axes: Axes, table: pd.DataFrame, windows: pd.DataFrame | None = None, tick_every_s: float = 300.0
) -> list[Artist]:
    """The ship's track, north up and to scale, held windows in one colour a leg, the time along it.

    ``table`` holds ``north_m`` and ``east_m`` [m]; ``windows`` is the long table of held windows.
    """
    artists: list[Artist] = list(axes.plot(table["east_m"], table["north_m"], color=FAINT, label="track"))
    if windows is not None:
        for number, (_, leg) in enumerate(windows.groupby("leg", sort=False)):
            colour = PALETTE[number % len(PALETTE)]
            artists.append(_leg(axes, leg, colour))
    artists += _time_ticks(axes, table, tick_every_s)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(label("east_m"))
    axes.set_ylabel(label("north_m"))
    return artists


def _leg(axes: Axes, rows: pd.DataFrame, colour: str) -> Line2D:
    """All windows of a leg as one line, lifted between them: a line each takes most of a figure's time."""
    begins = np.flatnonzero(np.diff(rows["window"].to_numpy()) != 0) + 1
    east, north = (np.insert(rows[name].to_numpy(dtype=float), begins, np.nan) for name in ("east_m", "north_m"))
    (line,) = axes.plot(east, north, color=colour, linewidth=2.2)
    return line


def _time_ticks(axes: Axes, table: pd.DataFrame, every_s: float) -> list[Artist]:
    """A dot and the time of day at every whole multiple of ``every_s`` that has a position."""
    placed = table[["north_m", "east_m"]].dropna()
    seconds = utc_index(placed).asi8 // 1_000_000_000
    marked = placed[np.append(True, np.diff(seconds // every_s) > 0)] if len(placed) else placed
    (dots,) = axes.plot(marked["east_m"], marked["north_m"], "o", color=INK, markersize=3, linestyle="none")
    texts = [
        axes.annotate(f"{time:%H:%M}", (row["east_m"], row["north_m"]), xytext=(3, 3), fontsize=7, color=INK,
                      textcoords="offset points")
        for time, row in marked.iterrows()
    ]  # fmt: skip
    return [dots, *texts]


def series(
    axes: Axes,
    table: pd.DataFrame,
    names: Sequence[str],
    windows: pd.DataFrame | None = None,
) -> list[Artist]:
    """Channels of one unit against UTC, the held windows as a shade behind them.

    Angles are drawn without the line that would join one end of the turn with the other.
    """
    artists: list[Artist] = []
    if windows is not None:
        artists.append(held_shade(axes, windows))
    for name, colour in zip(names, PALETTE, strict=False):
        present = table[name].dropna()
        shown = _without_wraps(present) if BY_NAME[name].circular else present
        artists += axes.plot(shown.index, shown.to_numpy(), color=colour, label=label(name))
    units = sorted({BY_NAME[name].unit for name in names})
    axes.set_ylabel(label(names[0]) if len(names) == 1 else f"[{', '.join(units)}]")
    axes.set_xlabel("time, UTC")
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M", tz="UTC"))  # type: ignore[no-untyped-call]
    if len(names) > 1:
        lines = [artist for artist in artists if isinstance(artist, Line2D)]
        axes.legend(handles=lines, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderpad=0.0)
    return artists


def _without_wraps(angle_deg: pd.Series) -> pd.Series:
    """The series with NaN where the drawn line would cross the whole turn."""
    shown = angle_deg.copy()
    values = angle_deg.to_numpy(dtype=float)
    turned = np.abs(np.diff(values) - difference(values[1:], values[:-1])) > 1.0
    shown.iloc[1:] = np.where(turned, np.nan, values[1:])
    return shown


def held_shade(axes: Axes, windows: pd.DataFrame) -> PolyCollection:
    """A shade over the full height of the axes wherever a window is held."""
    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in _held_stretches(windows)]
    shade = PolyCollection(
        corners, facecolors=HELD, alpha=0.25, linewidths=0, label="held", transform=axes.get_xaxis_transform()
    )
    axes.add_collection(shade, autolim=False)
    return shade


def _held_stretches(windows: pd.DataFrame) -> list[tuple[float, float]]:
    """Begin and end of every stretch of windows that overlap or touch, as matplotlib's dates."""
    begin = np.sort(dates.date2num(windows.groupby("window")["start"].first().to_numpy()))  # type: ignore[no-untyped-call]
    end = begin + (float(windows["second"].max()) if len(windows) else 0.0) / 86400.0
    first = np.append(True, begin[1:] > end[:-1] + 1e-9) if begin.size else np.empty(0, dtype=bool)
    last = np.append(first[1:], True) if begin.size else first
    return list(zip(begin[first].tolist(), end[last].tolist(), strict=True))


def consistency(axes: Axes, channels: Mapping[str, Mapping[str, float]]) -> list[Artist]:
    """Mean NIS by channel with the bounds it should lie in; one is what a filter that is right has.

    ``channels`` is :meth:`analysis.smoothing.consistency.Consistency.as_json` of a smoothed recording.
    """
    names = list(channels)
    places = np.arange(len(names), dtype=float)
    low, high, nis = (np.array([channels[name][key] for name in names]) for key in ("low", "high", "nis"))
    expected = axes.axhline(1.0, color=INK, linewidth=0.8)
    bounds = axes.vlines(places, low, high, color=FAINT, linewidth=9.0, label="95 % bounds")
    (points,) = axes.plot(places, nis, "o", color=PALETTE[0], label="mean NIS")
    axes.set_xticks(places, [label(name).rsplit(" [", 1)[0] for name in names], rotation=20.0)
    axes.set_ylabel("normalised innovation squared")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return [expected, bounds, points]
