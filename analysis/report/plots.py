"""Figures of trials in the house style: the track, the channels against time, and labels that keep clear of lines.

Functions take axes and data and return the artists that they drew; :func:`track_figure` and :func:`channels_figure`
return what a page needs to embed a figure. Of the manoeuvres a circle is drawn to scale, other kinds against time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from textwrap import shorten
from types import MappingProxyType
from typing import Any

import matplotlib.dates as dates
import numpy as np
import pandas as pd
from matplotlib import text
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.transforms import Affine2D, ScaledTranslation
from rich.text import Text

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import (
    DIMENSIONLESS,
    Floats,
    mean_wind_speed_and_direction,
    name_ending_of_unit,
    rotate_earth_to_ship,
)
from seatrial.acquisition.recording.reader import Event
from seatrial.analysis.manoeuvres import kinds, measures
from seatrial.analysis.manoeuvres.indices import Manoeuvre, overshoot_from_order_name
from seatrial.analysis.manoeuvres.motion import Motion
from seatrial.analysis.report.tables import index_cells, plain_name
from seatrial.analysis.tables.table import NANO, declared_channels, table_actuators, utc_index
from seatrial.analysis.windows.held import HeldWindows, held_spans_ns

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442")
"""The colours of Okabe and Ito, which the colour-blind can distinguish, the darkest first."""
INK, FAINT, HELD = "#333333", "#B8B8B8", "#56B4E9"

STYLE: dict[str, object] = {
    "axes.axisbelow": True,
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
HULL_OUTLINE = np.array([[-0.5, -0.13], [0.25, -0.13], [0.5, 0.0], [0.25, 0.13], [-0.5, 0.13], [-0.5, -0.13]])
"""A ship's outline, ahead and to starboard, in lengths."""
_CALM_MPS = 0.1  # no arrow for a calm, nor for a wind that was not recorded
_MARK_POINTS = 30  # of the track, which a mark is worth to a label that may hide it
_LEAST_SHARE = 0.02  # of the track's extent: a ship shorter than that is not seen on the page
_CLEARANCE, _STEP, _MOST_OUTLINES = 1.3, 2.5, 12  # lengths between outlines, and along the way; how many
Predicted = Mapping[str, tuple[pd.DataFrame, str]]
"""By method, the motion that it predicts, with the number of the ``window`` in each row, and its colour."""
Drawing = tuple[Callable[[Figure], None], tuple[float, float], str]
"""What fills a figure, its size [in], and its caption."""
_TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 21600.0)
_LEAST_INCH, _MOST_INCH = (5.5, 3.2), (9.0, 5.0)  # width and height of a track's picture
_AXES_INCH = (0.8, 1.2)  # of that for the axes and the legend
_MOST_TICKS = 10  # times of day along a track; more would overlap
_PANEL_INCH, _EDGES_INCH = 0.85, 1.0
_MOST_TURN_DEG = 330.0  # angles within it can be drawn as one line
_WIND = ("wind_speed_mps", "wind_direction_deg")
MOST_MARKS = 12
"""Marks that have their text on an axis of time; more could not be read."""
_FAR_PT = (4.0, 12.0, 22.0, 34.0, 48.0)  # from a point to the nearest edge of its label
_SIDES = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=float)
_PAD_PT = 1.5


def axis_label(name: str, channels: Mapping[str, ship.Channel] = ship.BY_NAME) -> str:
    """A channel's name for an axis, with its unit; ``channels`` are the channels.

    >>> axis_label("port_angle_deg")
    'port angle [deg]'
    """
    unit = channels[name].unit
    words = name.removesuffix(name_ending_of_unit(unit)).replace("_", " ")
    return words if unit == DIMENSIONLESS else f"{words} [{unit}]"


def draw_track(
    axes: Axes,
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    tick_every_s: float = 300.0,
    length_m: float | None = None,
    executes: Sequence[pd.Timestamp] = (),
) -> list[Artist]:
    """The ship's track, north up and to scale, broad where a window is held, the time along it.

    ``table`` holds ``north_m`` and ``east_m`` [m]; ``windows`` is the long table of held windows. Of a ship of
    ``length_m`` [m] some outlines are drawn, enlarged where they would not be seen, which the legend says.
    ``executes`` are the times at which manoeuvres begin, numbered in their order. Where the wind is known, an arrow
    shows where it blows to.
    """
    artists: list[Artist] = []
    if windows is not None and len(windows):  # one broad line, lifted between windows: a line each takes far longer
        begins = np.flatnonzero(np.diff(windows["window"].to_numpy()) != 0) + 1
        held = (np.insert(windows[name].to_numpy(dtype=float), begins, np.nan) for name in ("east_m", "north_m"))
        artists += axes.plot(*held, color=HELD, alpha=0.55, linewidth=5.0, solid_capstyle="butt", zorder=1.6,
                             label=f"{held_controls_in_words(table)} held")  # fmt: skip
    if length_m is not None and "heading_deg" in table:
        headed = table.dropna(subset=["north_m", "east_m", "heading_deg"])
        east, north, heading = (headed[name].to_numpy(dtype=float) for name in ("east_m", "north_m", "heading_deg"))
        if heading.size:
            extent = max(float(np.ptp(north)), float(np.ptp(east)))
            factors = (factor for factor in (1, 2, 5, 10, 20, 50) if factor * length_m >= _LEAST_SHARE * extent)
            times = next(factors, 100)
            words = f"ship of {length_m:g} m" + (f", {times} times its size" if times > 1 else ", to scale")
            artists += draw_ship_outlines(axes, east, north, np.deg2rad(heading), times * length_m, words)
    artists += axes.plot(table["east_m"], table["north_m"], color=INK, linewidth=1.1, label="track")
    placed = table.dropna(subset=["north_m", "east_m"])
    ticks, begun = placed, placed.iloc[:0]
    if len(placed):  # the first row after every whole multiple of the step
        ticks = placed[np.append(True, np.diff(utc_index(placed).asi8 // NANO // tick_every_s) > 0)]
    if len(placed) and len(executes):
        begun = placed.iloc[placed.index.get_indexer(pd.DatetimeIndex(list(executes)), method="nearest")]
    artists += axes.plot(ticks["east_m"], ticks["north_m"], "o", color=INK, markersize=3, linestyle="none")
    artists += axes.plot(begun["east_m"], begun["north_m"], "o", color=PALETTE[4], markeredgecolor="white",
                         markersize=6, linestyle="none", zorder=5,
                         label="manoeuvre begins" if len(begun) else "_")  # fmt: skip
    path = table[["east_m", "north_m"]].to_numpy(dtype=float)
    labelled = pd.concat([begun, ticks])[["east_m", "north_m"]].to_numpy(dtype=float)
    texts = [*map(str, range(1, len(begun) + 1)), *(f"{time:%H:%M}" for time in ticks.index)]
    hidden = np.concatenate([path, np.repeat(labelled, _MARK_POINTS, axis=0)])
    labels = label_points(axes, list(map(tuple, labelled)), texts, hidden, fontsize=7.5, color=INK, zorder=6)
    for annotation in labels[: len(begun)]:
        annotation.set(color=PALETTE[4], fontweight="bold")
    artists += [*labels, *draw_wind_arrow(axes, table)]
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(axis_label("east_m"))
    axes.set_ylabel(axis_label("north_m"))
    return artists


def draw_ship_outlines(
    axes: Axes, across: Floats, upwards: Floats, heading_rad: Floats, length_m: float, words: str | None = None
) -> list[Artist]:
    """A ship's outlines along a path [rows], pale and behind it: a dozen at most, none upon another.

    ``heading_rad`` [rows] counts clockwise from upwards; ``length_m`` is in the units of the axes.
    """
    forward, sideways = length_m * HULL_OUTLINE[:, 0], length_m * HULL_OUTLINE[:, 1]
    artists = list[Artist]()
    for row in outline_rows(across, upwards, length_m):
        x = across[row] + forward * np.sin(heading_rad[row]) + sideways * np.cos(heading_rad[row])
        y = upwards[row] + forward * np.cos(heading_rad[row]) - sideways * np.sin(heading_rad[row])
        label = None if artists else words
        artists += axes.fill(x, y, facecolor="#E3EBF1", edgecolor="#8FA3B3", linewidth=0.7, zorder=1.5, label=label)
    return artists


def outline_rows(across: Floats, upwards: Floats, length_m: float) -> list[int]:
    """Rows of a path [rows] at which outlines of ``length_m`` do not overlap, the first among them."""
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(across), np.diff(upwards))))
    step = max(_STEP * length_m, way[-1] / (_MOST_OUTLINES - 1), 1e-9)
    chosen: list[int] = []
    for row in np.searchsorted(way, np.arange(0.0, way[-1] + step / 4.0, step / 4.0)[: 8 * _MOST_OUTLINES]):
        at = min(int(row), way.size - 1)
        near = [
            np.hypot(across[at] - across[chosen_row], upwards[at] - upwards[chosen_row]) < _CLEARANCE * length_m
            for chosen_row in chosen
        ]
        if not any(near) and (not chosen or way[at] - way[chosen[-1]] >= 0.99 * step):
            chosen.append(at)
    return chosen


def draw_wind_arrow(axes: Axes, table: pd.DataFrame) -> list[Artist]:
    """An arrow above the upper left corner to where the mean wind blows, with its speed and direction."""
    air = table.reindex(columns=list(_WIND)).dropna()
    if air.empty:
        return []
    speed_mps, from_deg = mean_wind_speed_and_direction(air)
    if speed_mps < _CALM_MPS:
        return []
    to_rad = np.deg2rad(from_deg + 180.0)
    half, middle = 11.0 * np.array([np.sin(to_rad), np.cos(to_rad)]), np.array([14.0, 16.0])
    corner = (
        Affine2D().scale(1.0 / 72.0) + axes.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, axes.transAxes)  # type: ignore[arg-type]
    )
    arrow = axes.annotate("", tuple(middle + half), tuple(middle - half), xycoords=corner, textcoords=corner,
                          arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.4})  # fmt: skip
    words = f"mean wind {speed_mps:.1f} m/s from {from_deg:.0f}°"
    text = axes.text(32.0, 16.0, words, fontsize=8, va="center", color=INK, transform=corner)
    return [arrow, text]


def draw_series(
    axes: Axes,
    table: pd.DataFrame,
    names: Sequence[str],
    windows: pd.DataFrame | None = None,
    title: str = "",
    predicted: Predicted = MappingProxyType({}),
) -> list[Artist]:
    """Channels of one unit against UTC, held windows shaded behind them, orders dashed.

    The first line is broad, so that it shows behind a line that covers it. Angles that go all around are drawn
    without the line that would join one end of the turn with the other. Where something is ``predicted``, what was
    measured is dark. ``title`` is that of the axis, with its unit.
    """
    channels = ship.channels_by_name_of(table.attrs)
    artists: list[Artist] = [] if windows is None else [shade_held_windows(axes, windows)]
    angles = [table[name].dropna().to_numpy(dtype=float) for name in names if channels[name].circular]
    centre_deg = None  # of angles that cross the end of the turn and do not go all around
    if any(ship.full_circle_jumps(values).any() for values in angles):
        turned = ship.unwrap(np.concatenate(angles))
        if np.ptp(turned) < _MOST_TURN_DEG:
            centre_deg = float(ship.wrap_180(0.5 * (turned.max() + turned.min())))
    colours = [INK] if any(names[0] in motion for motion, _ in predicted.values()) else PALETTE
    for number, (name, colour) in enumerate(zip(names, cycle(colours), strict=False)):
        width = 2.4 if number == 0 and len(names) > 1 else 1.1
        steps = "steps-post" if channels[name].state else "default"
        order = ship.order_channel_name(name) if ship.channel_from_name(name) else ""
        for column, style in ((name, "-"), (order, "--")):
            if column in table and table[column].notna().any():
                times, values = _line_points(table[column], channels[name], centre_deg)
                artists += axes.plot(times, values, style, color=colour, linewidth=width if style == "-" else 1.1,
                                     drawstyle=steps, label=axis_label(column, channels))  # fmt: skip
    for method, (motion, colour) in predicted.items():
        for name in motion.columns.intersection(list(names)):
            times, values = _line_points(motion[name], channels[name], centre_deg)
            values[np.append(True, np.diff(motion["window"]) != 0)] = np.nan
            artists += axes.plot(times, values, color=colour, linewidth=1.2, label=method)
    units = sorted({channels[name].unit for name in names})
    words = axis_label(names[0], channels) if len(names) == 1 else title or f"[{', '.join(units)}]"
    axes.set_ylabel(words.replace(" [", "\n["))
    short = len(table) > 0 and table.index[-1] - table.index[0] < pd.Timedelta(minutes=10)
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M:%S" if short else "%H:%M", tz="UTC"))  # type: ignore[no-untyped-call]
    axes.set_xlabel("time, UTC")
    axes.margins(x=0.01)
    lines = [artist for artist in artists if isinstance(artist, Line2D) and artist.get_label() not in predicted]
    if len(lines) > 1:
        axes.legend(handles=lines, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderpad=0.0)
    return artists


def _line_points(column: pd.Series, channel: ship.Channel, centre_deg: float | None) -> tuple[pd.Index, Floats]:
    """Times and values of a channel; an angle about a centre where there is one, broken where it crosses the whole
    turn."""
    present = column.dropna()
    values = present.to_numpy(dtype=float, copy=True)
    if channel.circular:
        values = values if centre_deg is None else np.asarray(centre_deg + ship.wrap_180(values - centre_deg))
        values[ship.full_circle_jumps(values)] = np.nan
    return present.index, values


def shade_held_windows(axes: Axes, windows: pd.DataFrame) -> PolyCollection:
    """A shade over the full height of the axes wherever a window is held."""
    spans = dates.date2num(held_spans_ns(windows).astype("datetime64[ns]"))  # type: ignore[no-untyped-call]
    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in spans]
    shade = PolyCollection(
        corners, facecolors=HELD, alpha=0.25, linewidths=0, label="held", transform=axes.get_xaxis_transform()
    )
    axes.add_collection(shade, autolim=False)
    return shade


def track_figure(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    length_m: float | None = None,
    executes: Sequence[pd.Timestamp] = (),
) -> Drawing | None:
    """The track of a 1 Hz table, None without positions; arguments as of :func:`draw_track`."""
    if table.reindex(columns=["north_m", "east_m"]).dropna().empty:
        return None

    duration_s = float((table.index[-1] - table.index[0]).total_seconds())
    tick_every_s = next((step for step in _TICKS_S if duration_s / step <= _MOST_TICKS), _TICKS_S[-1])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_track(axes, table, windows, tick_every_s, length_m, executes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4 if width >= 7.0 else 2)

    extent = np.array([max(float(table[name].max() - table[name].min()), 1e-3) for name in ("east_m", "north_m")])
    scale = np.min(np.subtract(_MOST_INCH, _AXES_INCH) / extent)
    width, height = np.maximum(scale * extent + _AXES_INCH, _LEAST_INCH).tolist()
    held = "" if windows is None else f"; broad where the {held_controls_in_words(table)} were held"
    begins = "; numbers: where manoeuvres begin, in their order" if len(executes) else ""
    return draw, (width, height), f"The track, north up and to scale, times in UTC{held}{begins}."


def draw_marks(axes: Axes, marks: Sequence[Event]) -> None:
    """The crew's marks as lines across an axis of dates, with their texts above where there is room."""
    low, high = axes.get_xlim()
    for mark in marks:
        at = dates.date2num(np.datetime64(mark.time_ns, "ns"))  # type: ignore[no-untyped-call]
        if low <= at <= high:
            axes.axvline(at, color=INK, linewidth=0.8, linestyle=":", zorder=0.5)
            if len(marks) <= MOST_MARKS:
                text = f" {shorten(mark.text, 30, placeholder='...')}"
                axes.annotate(
                    text, (at, 1.0), xycoords=("data", "axes fraction"), fontsize=6, rotation=90,
                    ha="right", va="top", annotation_clip=True,
                )  # fmt: skip


def channels_figure(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Predicted = MappingProxyType({}),
    marks: Sequence[Event] = (),
) -> Drawing | None:
    """The channels of a 1 Hz table against time, held windows shaded, what is ``predicted`` of the motion, and the
    crew's ``marks``; None without any channel. What never changes is left to the caption.
    """
    channels, panels, still = ship.channels_by_name_of(table.attrs), dict[str, list[str]](), list[str]()
    motion, wind = ({name: [name] for name in group} for group in (ship.POSE_AND_VELOCITY[2:], _WIND))
    groups = motion | control_groups(table_actuators(table)) | wind | declared_groups(table)
    for title, group in groups.items():
        present = [name for name in group if name in table and table[name].notna().any()]
        if any(name in motion or np.ptp(table[name].dropna()) > 0.0 for name in present):
            panels[title] = present
        else:
            still += [f"{axis_label(name, channels)} {table[name].dropna().iloc[0]:g}" for name in present]
    if not panels:
        return None

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (title, names) in zip(grid, panels.items(), strict=True):
            draw_series(axes, table, names, windows, title, predicted)
            axes.label_outer()
            draw_marks(axes, marks if axes is grid[0] else [replace(mark, text="") for mark in marks])
        if windows is not None or predicted:
            handles, names = grid[0].get_legend_handles_labels()
            names = ["measured" if "[" in name else name for name in names]
            figure.legend(handles, names, loc="outside upper left", ncols=5)
        figure.align_ylabels()

    shade = "" if windows is None else f" Shaded: {held_controls_in_words(table)} held."
    constant = f" Constant all the time: {', '.join(still)}." if still else ""
    return draw, (9.0, _EDGES_INCH + _PANEL_INCH * len(panels)), f"The channels at 1 Hz.{shade}{constant}"


def control_groups(actuators: ship.Actuators) -> dict[str, list[str]]:
    """The control channels of a ship by what they are together: angles first, then shafts, then pitch."""
    thrusters = all(actuator.noun == "thruster" for actuator in actuators)
    shafts = "thrusters [rpm]" if thrusters else "shafts [rpm]"
    titles = {"azimuth": "azimuths [deg]", "rudder": "rudders [deg]", "nozzle": "nozzles [deg]", "shaft": shafts,
              "tunnel thruster": shafts, "pitch": "pitch [%]"}  # fmt: skip
    groups: dict[str, list[str]] = {title: [] for title in titles.values()}
    for name in ship.control_names(actuators):
        groups[titles[ship.control_kind_of_channel(name, actuators)]].append(name)
    return {title: names for title, names in groups.items() if names}


def declared_groups(table: pd.DataFrame) -> dict[str, list[str]]:
    """The channels that a trial declares by the title of their axis: those that differ only in the first word of
    their names, such as port and starboard, together."""
    groups: dict[str, list[str]] = {}
    for channel in declared_channels(table):
        words = axis_label(channel.name, {channel.name: channel})
        groups.setdefault(words.partition(" ")[2] or words, []).append(channel.name)
    return {axis_label(names[0], ship.channels_by_name_of(table.attrs)) if len(names) == 1 else title: names
            for title, names in groups.items()}  # fmt: skip


def held_controls_in_words(table: pd.DataFrame) -> str:
    """What is held in a held window: the thrusters, or whatever controls the ship has."""
    return "thrusters" if all(actuator.noun == "thruster" for actuator in table_actuators(table)) else "controls"


def windows_view(windows: HeldWindows) -> Text:
    """How many windows are held, in how many legs, and why others were dropped."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items()) or "none"
    counts = (
        f"{windows.kept} of {windows.candidates} windows of {windows.horizon_s} s held, in {windows.leg_count} legs"
    )
    return Text(f"{counts}; dropped: {reasons}")


def draw_windows(figure: Figure, windows: HeldWindows) -> None:
    """Where the windows lie, north up and to scale."""
    times = windows.rows["start"] + pd.to_timedelta(windows.rows["second"], unit="s")
    table = windows.rows.set_index(pd.DatetimeIndex(times)).sort_index()
    draw_track(figure.subplots(), table[~table.index.duplicated()], windows.rows)


def label_points(
    axes: Axes, points: Sequence[tuple[float, float]], texts: Sequence[str], clear_of: Floats, **look: object
) -> list[Annotation]:
    """Annotate ``points`` [N] of the axes' data with ``texts`` [N] where there is room, with a faint line to the
    point where it is farther away.

    ``clear_of`` [M, 2] are points that a label should not hide, NaN between lines. Places are chosen when the
    picture is drawn, since only then the axes have their scale; ``look`` is that of the texts.
    """
    line = {"arrowstyle": "-", "color": "#8A8A8A", "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 1.0}
    labels = [
        axes.annotate(text, point, xytext=(0.0, 0.0), textcoords="offset points", ha="center", va="center",
                      arrowprops=line, **look)  # type: ignore[arg-type]
        for point, text in zip(points, texts, strict=True)
    ]  # fmt: skip
    for annotation in labels:
        annotation.set_in_layout(False)
    axes.add_artist(_KeepClear(axes, labels, clear_of))
    return labels


class _KeepClear(Artist):
    """An invisible artist, drawn before the labels of its axes, that moves them to where they are clear."""

    def __init__(self, frame: Axes, labels: Sequence[Annotation], clear_of: Floats) -> None:
        super().__init__()
        self.frame, self.labels, self.clear_of = frame, labels, clear_of
        self.set_zorder(-1.0)
        self.set_in_layout(False)

    def draw(self, renderer: RendererBase) -> None:
        """Move the labels, one after the other."""
        scale = float(renderer.points_to_pixels(1.0))  # type: ignore[arg-type]
        to_pixels = self.frame.transData.transform
        hidden = to_pixels(self.clear_of[np.isfinite(self.clear_of).all(axis=1)])
        taken: list[Floats] = []
        for label in self.labels:
            point = np.asarray(to_pixels(label.xy))
            extent = text.Text.get_window_extent(label, renderer)
            half = np.array([extent.width, extent.height]) / 2.0 + _PAD_PT * scale
            box, offset, ring = self._place(point, half, scale, taken, hidden)
            taken.append(box)
            label.set_position(tuple(offset / scale))
            if label.arrow_patch is not None:
                label.arrow_patch.set_visible(ring > 0)

    def _place(
        self, point: Floats, half_size: Floats, scale: float, occupied: Sequence[Floats], hidden: Floats
    ) -> tuple[Floats, Floats, int]:
        """The nearest place that is clear, or the best: its box [low, high; x, y; px], offset [px] and ring about
        the point. A place costs the labels that it is over [px2], then the edge [px], then the points of lines."""
        best, least = (np.zeros((2, 2)), np.zeros(2), 0), (np.inf,) * 3
        (x0, y0), (x1, y1) = np.asarray(self.frame.bbox)
        for ring, far in enumerate(_FAR_PT):
            for offset in _SIDES * (half_size + far * scale):
                low, high = box = np.stack([point + offset - half_size, point + offset + half_size])
                sides = (np.maximum(np.minimum(high, b) - np.maximum(low, a), 0.0) for a, b in occupied)
                over = sum(float(np.prod(side)) for side in sides)
                outside = max(0.0, x0 - low[0], y0 - low[1], high[0] - x1, high[1] - y1)
                cost = over, outside, float(((hidden > low) & (hidden < high)).all(axis=1).sum())
                if cost < least:
                    best, least = (box, offset, ring), cost
                if not any(cost):
                    return best
        return best


BLUE, ORANGE, GREEN, PURPLE, RED = PALETTE[:5]
_MARGIN_S = 15.0
_DASHES = ("-", "--", ":", "-.")
_MOST_IN_LEGEND = 14
_MARGINS = {"left": 0.095, "right": 0.985, "bottom": 0.135, "top": 0.86, "hspace": 0.25, "wspace": 0.2}
Point = tuple[float, float]
PICTURED = frozenset({"zigzag", "turning_circle", "stopping", "acceleration", "crabbing"})
"""Kinds whose picture says more than their indices do; of a ship that goes straight the series say it all."""
SIZES_INCH: dict[str, tuple[float, float]] = {"turning_circle": (9.0, 4.4), "course_change": (9.0, 4.4)}
_OTHER_INCH = (9.0, 5.1)


def execute_and_end_s(motion: Motion, manoeuvre: Manoeuvre) -> tuple[float, float]:
    """Execute and end of a manoeuvre on the motion's clock [s]."""
    return motion.seconds_of(manoeuvre.start), motion.seconds_of(manoeuvre.end)


def _course_deg(motion: Motion, manoeuvre: Manoeuvre) -> float:
    """The heading of the approach, before the command began to change."""
    begun = execute_and_end_s(motion, manoeuvre)[0] - manoeuvre.settings.get("half_command_s", 0.0)
    return measures.approach_state(motion, begun)["approach_unwrapped_deg"]


def draw_manoeuvre(figure: Figure, motion: Motion, manoeuvre: Manoeuvre, *, titled: bool = True) -> None:
    """The picture of a manoeuvre, as its kind has it."""
    start, end = execute_and_end_s(motion, manoeuvre)
    part = motion.around(start, end, _MARGIN_S)
    smooth = measures.smooth_motion(part, measures.smoothing_half_width_s(part, 0.1 * (end - start)))
    drawing = {"zigzag": draw_zigzag, "turning_circle": draw_circle, "course_change": draw_circle}
    figure.set_layout_engine("none")  # margins that are known: to find them would take as long as to draw
    drawing.get(manoeuvre.kind, draw_straight_run)(figure, smooth, manoeuvre)
    if titled:
        figure.suptitle(manoeuvre_title(manoeuvre), x=0.01, ha="left", fontsize=10, fontweight="bold")


def draw_untitled(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """The picture of a manoeuvre below a heading that names it."""
    draw_manoeuvre(figure, motion, manoeuvre, titled=False)


def manoeuvre_title(manoeuvre: Manoeuvre) -> str:
    """Name, side and time in one line."""
    return f"{manoeuvre.sided_name} · {manoeuvre.start:%Y-%m-%d %H:%M:%S} UTC"


def draw_zigzag(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """Heading and helm with the overshoots, over yaw rate, speed and shafts, against the time from the execute, and
    the track."""
    has_shafts = bool(_running_shafts(motion))
    above, *below = _add_panels_over_track(figure, (2.4, 1, 1, *(1,) * has_shafts))
    start, end = execute_and_end_s(motion, manoeuvre)
    time_s = motion.time_s - start
    base = _course_deg(motion, manoeuvre)
    heading = motion.heading_deg - base
    above.plot(time_s, heading, color=BLUE, linewidth=1.8, label="heading off the approach")
    _draw_helm(above, motion, time_s)
    _mark_overshoots(above, motion, manoeuvre, heading)
    above.set_ylabel("to starboard\n[deg]")
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderpad=0.0)
    _draw_yaw_rate_and_speed(below[:2], motion, time_s)
    if has_shafts:
        _draw_shafts(below[2], motion, time_s)
    above.set_xlim(time_s[0], min(time_s[-1], end - start + _MARGIN_S))
    _label_time_axis([above, *below])
    _draw_track_ahead(figure, motion, manoeuvre)
    figure.align_ylabels()


def _draw_helm(axes: Axes, motion: Motion, time_s: Floats) -> None:
    """What the ship is steered by, and dashed what was ordered."""
    axes.plot(time_s, motion.helm_deg, color=ORANGE, label=motion.steering)
    if motion.helm_order_deg is not None:
        axes.plot(time_s, motion.helm_order_deg, "--", color=ORANGE, label=f"{motion.steering}, ordered")


def _mark_overshoots(axes: Axes, motion: Motion, manoeuvre: Manoeuvre, heading: Floats) -> None:
    """From the heading at each execute, or at its order, to its extreme: a bar with the overshoot."""
    start, end = execute_and_end_s(motion, manoeuvre)
    executes = np.array([motion.seconds_of(time) for time in manoeuvre.executes])
    few = len(executes) <= 10
    axes.axvline(0.0, color=FAINT, linewidth=0.8)
    for number, (execute, following) in enumerate(zip(executes, [*executes[1:], end], strict=True), start=1):
        side = manoeuvre.sign if number % 2 else -manoeuvre.sign
        ordered = manoeuvre.indices.get(overshoot_from_order_name(number))
        index = ordered or manoeuvre.indices.get(f"overshoot_{number}_deg")
        axes.axvline(execute - start, color=FAINT, linewidth=0.8, linestyle=":")
        if index is None:
            continue
        time_s, top = measures.peak_time_and_height(motion.time_s, side * heading, execute, following)
        at_execute = float(np.interp(execute, motion.time_s, heading))
        if ordered is not None:
            at_execute = side * (top - ordered.value)
            before = motion.time_s[(motion.time_s < execute) & (side * heading <= side * at_execute)]
            execute = float(before[-1]) if before.size else execute
        where = time_s - start
        axes.vlines(where, at_execute, side * top, color=RED, linewidth=2.4)
        axes.hlines(at_execute, execute - start, where, color=RED, linewidth=0.8)
        text = index_cells(index)[0].replace(" deg", "°")
        axes.annotate(
            text, (where, side * top), xytext=(0, 5 * side), textcoords="offset points", fontsize=8 if few else 7,
            ha="center", va="bottom" if side > 0 else "top", color=RED,
        )  # fmt: skip
    axes.margins(y=0.22)


def _draw_yaw_rate_and_speed(panels: Sequence[Axes], motion: Motion, time_s: Floats) -> None:
    """Yaw rate, and below it speed over ground."""
    panels[0].plot(time_s, motion.yaw_rate_dps, color=GREEN)
    panels[0].set_ylabel("yaw rate\n[deg/s]")
    panels[1].plot(time_s, motion.speed_mps, color=PURPLE)
    panels[1].set_ylim(bottom=0.0)
    panels[1].set_ylabel("speed\n[m/s]")


def _running_shafts(motion: Motion) -> dict[str, Floats]:
    return {name: rpm for name, rpm in {**motion.drives, **motion.tunnels}.items() if np.abs(rpm).max() > 0.0}


def _draw_shafts(axes: Axes, motion: Motion, time_s: Floats) -> None:
    """The shafts that run, each by its name where there are several."""
    running = _running_shafts(motion)
    for number, (name, rpm) in enumerate(running.items()):
        broad = 2.4 if number == 0 and len(running) > 1 else 1.1  # a rim where another lies on it
        axes.plot(time_s, rpm, color=PALETTE[number % len(PALETTE)], linewidth=broad, label=plain_name(name))
    if any(rpm.min() < 0.0 < rpm.max() for rpm in running.values()):
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
    elif running:
        ends = [float(rpm.max()) for rpm in running.values()]
        if len(running) == 1:
            ends = [max(float(next(iter(running.values())).min()), *ends, key=abs)]
        axes.set_ylim(*sorted((0.0, 1.15 * max(ends))))
    axes.set_ylabel("shaft\n[rpm]")


def _label_time_axis(panels: Sequence[Axes]) -> None:
    """The time below the last of a column of panels."""
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time since the order [s]")


def _add_panels_over_track(figure: Figure, heights: Sequence[float]) -> list[Axes]:
    """A column of panels over one time axis, with room for the track below them."""
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights, **{**_MARGINS, "bottom": 0.36, "top": 0.93})
    first = figure.add_subplot(grid[0])
    return [first, *(figure.add_subplot(grid[row], sharex=first) for row in range(1, len(heights)))]


def _draw_track_ahead(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """The track to scale from left to right below other panels, with the ship on it; starboard is below."""
    axes = figure.add_subplot(figure.add_gridspec(1, 1, **{**_MARGINS, "bottom": 0.09, "top": 0.25})[0])
    start, end = execute_and_end_s(motion, manoeuvre)
    course_deg, shown = _course_deg(motion, manoeuvre), motion.between(motion.time_s[0], end)
    across, ahead = _coordinates_across_and_ahead(shown, start, course_deg)
    axes.plot(ahead, across, color=BLUE, linewidth=1.4)
    if motion.length_m:
        rows = slice(int(np.searchsorted(shown.time_s, start)), None)
        headings = np.pi / 2.0 - np.deg2rad(shown.heading_deg[rows] - course_deg)
        draw_ship_outlines(axes, ahead[rows], across[rows], headings, motion.length_m)
    axes.plot(0.0, 0.0, "o", color=RED, markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xlabel("ahead of the order [m]")
    axes.set_ylabel("to starboard\n[m]")


def draw_circle(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """The track in the frame of the approach with advance, transfer and diameter, and motion against time."""
    panels = 4 + bool(_running_shafts(motion))
    grid = figure.add_gridspec(panels, 2, width_ratios=(1.7, 1), **_MARGINS)
    track_axes, side_axes = (
        figure.add_subplot(grid[:, 0]),
        [figure.add_subplot(grid[row, 1]) for row in range(panels)],
    )
    start, end = execute_and_end_s(motion, manoeuvre)
    ahead_deg = _course_deg(motion, manoeuvre)
    shown = motion.between(motion.time_s[0], end)
    current = manoeuvre.current
    main = shown
    if current:
        main = kinds.remove_current(shown, current.north_mps, current.east_mps, start)
        track_axes.plot(*_coordinates_across_and_ahead(shown, start, ahead_deg), color=FAINT, label="as measured")
    across, ahead = _coordinates_across_and_ahead(main, start, ahead_deg)
    track_axes.plot(across, ahead, color=BLUE, linewidth=1.8,
              label="current removed" if current else "track")  # fmt: skip
    # the ship to scale from the execute on; a twentieth of the picture where its length is not known
    length_m = main.length_m or max(float(np.ptp(across)), float(np.ptp(ahead))) / 20.0
    rows = slice(int(np.searchsorted(main.time_s, start)), None)
    draw_ship_outlines(
        track_axes, across[rows], ahead[rows], np.deg2rad(main.heading_deg[rows] - ahead_deg), length_m
    )
    _draw_circle_dimensions(
        track_axes, main, manoeuvre, start, end, ahead_deg, "_current_removed" if current else ""
    )
    track_axes.plot(0.0, 0.0, "o", color=RED, markersize=5, label="order")
    track_axes.margins(0.12)  # room for the labels of the track
    track_axes.set_aspect("equal", adjustable="datalim")
    track_axes.set_xlabel("to starboard of the approach [m]")
    track_axes.set_ylabel("ahead of the order [m]")
    track_axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderpad=0.0)
    time_s = motion.time_s - start
    side_axes[0].plot(time_s, motion.heading_deg - ahead_deg, color=BLUE)
    side_axes[0].set_ylabel("heading\n[deg]")
    _draw_helm(side_axes[1], motion, time_s)
    side_axes[1].set_ylabel(f"{motion.steering}\n[deg]")
    _draw_yaw_rate_and_speed(side_axes[2:4], motion, time_s)
    if panels > 4:
        _draw_shafts(side_axes[4], motion, time_s)
    for axes in side_axes:
        axes.axvline(0.0, color=FAINT, linewidth=0.8)
        axes.set_xlim(time_s[0], time_s[-1])
    _label_time_axis(side_axes)
    figure.align_ylabels(side_axes)


def _coordinates_across_and_ahead(motion: Motion, start: float, ahead_deg: float) -> tuple[Floats, Floats]:
    north, east = motion.north_m - motion.at("north_m", start), motion.east_m - motion.at("east_m", start)
    ahead, across = rotate_earth_to_ship(north, east, np.deg2rad(ahead_deg))
    return across, ahead


def _draw_circle_dimensions(
    axes: Axes, motion: Motion, manoeuvre: Manoeuvre, start: float, end: float, ahead_deg: float, suffix: str
) -> None:
    """Arrows for advance, transfer and tactical diameter with their values."""
    turned = np.abs(motion.heading_deg - ahead_deg)
    quarter_s, half_s = (
        measures.first_crossing_s(motion.time_s, turned, angle, start, end) for angle in (90.0, 180.0)
    )
    arrows: dict[str, tuple[Point, Point]] = {}
    if np.isfinite(quarter_s) and f"advance_m{suffix}" in manoeuvre.indices:
        ahead, across = measures.distance_ahead_and_to_starboard(motion, start, quarter_s, ahead_deg)
        offset, above = -manoeuvre.sign * 0.12 * max(abs(ahead), abs(across)), ahead - 0.12 * ahead
        arrows = {"advance": ((offset, 0.0), (offset, ahead)), "transfer": ((0.0, above), (across, above))}
        axes.plot([offset, across], [ahead, ahead], color=FAINT, linewidth=0.8, linestyle="--")
    if np.isfinite(half_s) and f"tactical_diameter_m{suffix}" in manoeuvre.indices:
        ahead, across = measures.distance_ahead_and_to_starboard(motion, start, half_s, ahead_deg)
        arrows["tactical_diameter"] = (0.0, ahead), (across, ahead)
    look = {"arrowstyle": "<->", "color": RED, "linewidth": 1.0}
    for begin, finish in arrows.values():
        axes.annotate("", finish, begin, arrowprops=look)
    values = [index_cells(manoeuvre.indices[f"{name}_m{suffix}"])[0] for name in arrows]
    texts = [f"{plain_name(name)}\n{value}" for name, value in zip(arrows, values, strict=True)]
    lines = [np.linspace(*ends, 60) for ends in arrows.values()]
    path = np.stack(_coordinates_across_and_ahead(motion, start, ahead_deg), axis=1)
    middles = [tuple(line.mean(axis=0)) for line in lines]
    label_points(axes, middles, texts, np.concatenate([path, *lines]), color=RED, fontsize=8, zorder=4)


def draw_straight_run(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """Speed, shafts, helm and heading against time, of what goes straight or is a test of a drive."""
    above, middle, helm, below = _add_panels_over_track(figure, (1, 1, 1, 1))
    start, end = execute_and_end_s(motion, manoeuvre)
    time_s = motion.time_s - start
    above.plot(time_s, motion.surge_mps, color=BLUE, label="surge")
    above.plot(time_s, motion.sway_mps, color=ORANGE, label="sway")
    above.set_ylabel("speed\n[m/s]")
    _draw_shafts(middle, motion, time_s)
    _draw_helm(helm, motion, time_s)
    helm.set_ylabel(f"{motion.steering or 'helm'}\n[deg]")
    below.plot(time_s, motion.heading_deg - motion.at("heading_deg", start), color=PURPLE)
    below.set_ylabel("turned\n[deg]")
    for axes in (above, middle, helm, below):
        axes.axvspan(0.0, end - start, color="#56B4E9", alpha=0.12, linewidth=0)
    several = len(motion.drives) + len(motion.tunnels) > 1
    for axes in (above, middle) if several else (above,):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, borderpad=0.0)
    _label_time_axis([above, middle, helm, below])
    _draw_track_ahead(figure, motion, manoeuvre)
    figure.align_ylabels()


def draw_runs_together(figure: Figure, runs: Sequence[tuple[str, Motion, Manoeuvre]]) -> None:
    """Runs, each with its name, over each other: tracks in the frame of each approach, heading and speed."""
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1))
    track_axes, above, below = (figure.add_subplot(grid[place]) for place in ((slice(None), 0), (0, 1), (1, 1)))
    for number, (name, motion, manoeuvre) in enumerate(runs):
        start, end = execute_and_end_s(motion, manoeuvre)
        course_deg, part = _course_deg(motion, manoeuvre), motion.between(start - _MARGIN_S, end)
        part = measures.smooth_motion(part, measures.smoothing_half_width_s(part, 0.1 * (end - start)))
        dashes = _DASHES[number // len(PALETTE) % len(_DASHES)]
        style: dict[str, Any] = {"color": PALETTE[number % len(PALETTE)], "linestyle": dashes}
        track_axes.plot(*_coordinates_across_and_ahead(part, start, course_deg), label=name, **style)
        above.plot(part.time_s - start, part.heading_deg - course_deg, **style)
        below.plot(part.time_s - start, part.speed_mps, **style)
    track_axes.set_aspect("equal", adjustable="datalim")
    track_axes.set_xlabel("to starboard of the approach [m]")
    track_axes.set_ylabel("ahead of the order [m]")
    above.set_ylabel("heading off the approach [deg]")
    below.set_ylabel("speed over ground [m/s]")
    below.set_xlabel("time since the order [s]")
    if len(runs) <= _MOST_IN_LEGEND:
        figure.legend(*track_axes.get_legend_handles_labels(), loc="outside lower left", ncols=2, fontsize=8)


def figure_size_of_manoeuvre(manoeuvre: Manoeuvre) -> tuple[float, float]:
    """The size of a manoeuvre's picture on a page."""
    return SIZES_INCH.get(manoeuvre.kind, _OTHER_INCH)
