"""Figures of trials in the house style: the track, the channels against time, and labels that keep clear of lines.

Functions take axes and data and return the artists that they drew; :func:`track_figure` and :func:`channels_figure`
return what a page needs to embed a figure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from textwrap import shorten
from types import MappingProxyType

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
from seatrial.acquisition.core.quantities import DIMENSIONLESS, Floats, ending_of, mean_wind
from seatrial.acquisition.recording.grouping import Event
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


def label(name: str, channels: Mapping[str, ship.Channel] = ship.BY_NAME) -> str:
    """A channel's name for an axis, with its unit; ``channels`` are the channels.

    >>> label("port_angle_deg")
    'port angle [deg]'
    """
    unit = channels[name].unit
    words = name.removesuffix(ending_of(unit)).replace("_", " ")
    return words if unit == DIMENSIONLESS else f"{words} [{unit}]"


def track(
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
                             label=f"{held_words(table)} held")  # fmt: skip
    if length_m is not None and "heading_deg" in table:
        headed = table.dropna(subset=["north_m", "east_m", "heading_deg"])
        east, north, heading = (headed[name].to_numpy(dtype=float) for name in ("east_m", "north_m", "heading_deg"))
        if heading.size:
            extent = max(float(np.ptp(north)), float(np.ptp(east)))
            factors = (factor for factor in (1, 2, 5, 10, 20, 50) if factor * length_m >= _LEAST_SHARE * extent)
            times = next(factors, 100)
            words = f"ship of {length_m:g} m" + (f", {times} times her size" if times > 1 else ", to scale")
            artists += outlines(axes, east, north, np.deg2rad(heading), times * length_m, words)
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
    artists += [*labels, *wind_arrow(axes, table)]
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(label("east_m"))
    axes.set_ylabel(label("north_m"))
    return artists


def outlines(
    axes: Axes, across: Floats, up: Floats, heading_rad: Floats, length_m: float, words: str | None = None
) -> list[Artist]:
    """A ship's outlines along a path [rows], pale and behind it: a dozen at most, none upon another.

    ``heading_rad`` [rows] counts clockwise from upwards; ``length_m`` is in the units of the axes.
    """
    forward, sideways = length_m * HULL_OUTLINE[:, 0], length_m * HULL_OUTLINE[:, 1]
    artists = list[Artist]()
    for row in outline_rows(across, up, length_m):
        x = across[row] + forward * np.sin(heading_rad[row]) + sideways * np.cos(heading_rad[row])
        y = up[row] + forward * np.cos(heading_rad[row]) - sideways * np.sin(heading_rad[row])
        label = None if artists else words
        artists += axes.fill(x, y, facecolor="#E3EBF1", edgecolor="#8FA3B3", linewidth=0.7, zorder=1.5, label=label)
    return artists


def outline_rows(across: Floats, up: Floats, length_m: float) -> list[int]:
    """Rows of a path [rows] at which outlines of ``length_m`` do not overlap, the first among them."""
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(across), np.diff(up))))
    step = max(_STEP * length_m, way[-1] / (_MOST_OUTLINES - 1), 1e-9)
    chosen: list[int] = []
    for row in np.searchsorted(way, np.arange(0.0, way[-1] + step / 4.0, step / 4.0)[: 8 * _MOST_OUTLINES]):
        at = min(int(row), way.size - 1)
        near = [
            np.hypot(across[at] - across[chosen_row], up[at] - up[chosen_row]) < _CLEARANCE * length_m
            for chosen_row in chosen
        ]
        if not any(near) and (not chosen or way[at] - way[chosen[-1]] >= 0.99 * step):
            chosen.append(at)
    return chosen


def wind_arrow(axes: Axes, table: pd.DataFrame) -> list[Artist]:
    """An arrow above the upper left corner to where the mean wind blows, with its speed and direction."""
    air = table.reindex(columns=list(_WIND)).dropna()
    if air.empty:
        return []
    speed_mps, from_deg = mean_wind(air)
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


def series(
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
    channels = ship.known_channels(table.attrs)
    artists: list[Artist] = [] if windows is None else [held_shade(axes, windows)]
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
        order = ship.name_of_order(name) if ship.channel_by_rule(name) else ""
        for column, style in ((name, "-"), (order, "--")):
            if column in table and table[column].notna().any():
                times, values = _line(table[column], channels[name], centre_deg)
                artists += axes.plot(times, values, style, color=colour, linewidth=width if style == "-" else 1.1,
                                     drawstyle=steps, label=label(column, channels))  # fmt: skip
    for method, (motion, colour) in predicted.items():
        for name in motion.columns.intersection(list(names)):
            times, values = _line(motion[name], channels[name], centre_deg)
            values[np.append(True, np.diff(motion["window"]) != 0)] = np.nan
            artists += axes.plot(times, values, color=colour, linewidth=1.2, label=method)
    units = sorted({channels[name].unit for name in names})
    words = label(names[0], channels) if len(names) == 1 else title or f"[{', '.join(units)}]"
    axes.set_ylabel(words.replace(" [", "\n["))
    short = len(table) > 0 and table.index[-1] - table.index[0] < pd.Timedelta(minutes=10)
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M:%S" if short else "%H:%M", tz="UTC"))  # type: ignore[no-untyped-call]
    axes.set_xlabel("time, UTC")
    axes.margins(x=0.01)
    lines = [artist for artist in artists if isinstance(artist, Line2D) and artist.get_label() not in predicted]
    if len(lines) > 1:
        axes.legend(handles=lines, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderpad=0.0)
    return artists


def _line(column: pd.Series, channel: ship.Channel, centre_deg: float | None) -> tuple[pd.Index, Floats]:
    """Times and values of a channel; an angle about a centre where there is one, broken where it crosses the whole
    turn."""
    present = column.dropna()
    values = present.to_numpy(dtype=float, copy=True)
    if channel.circular:
        values = values if centre_deg is None else np.asarray(centre_deg + ship.wrap_180(values - centre_deg))
        values[ship.full_circle_jumps(values)] = np.nan
    return present.index, values


def held_shade(axes: Axes, windows: pd.DataFrame) -> PolyCollection:
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
    """The track of a 1 Hz table, None without positions; arguments as of :func:`track`."""
    if table.reindex(columns=["north_m", "east_m"]).dropna().empty:
        return None

    duration_s = float((table.index[-1] - table.index[0]).total_seconds())
    tick_every_s = next((step for step in _TICKS_S if duration_s / step <= _MOST_TICKS), _TICKS_S[-1])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        track(axes, table, windows, tick_every_s, length_m, executes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4 if width >= 7.0 else 2)

    extent = np.array([max(float(table[name].max() - table[name].min()), 1e-3) for name in ("east_m", "north_m")])
    scale = np.min(np.subtract(_MOST_INCH, _AXES_INCH) / extent)
    width, height = np.maximum(scale * extent + _AXES_INCH, _LEAST_INCH).tolist()
    held = "" if windows is None else f"; broad where the {held_words(table)} were held"
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
    channels, panels, still = ship.known_channels(table.attrs), dict[str, list[str]](), list[str]()
    motion, wind = ({name: [name] for name in group} for group in (ship.POSE_AND_VELOCITY[2:], _WIND))
    groups = motion | control_groups(table_actuators(table)) | wind | declared_groups(table)
    for title, group in groups.items():
        present = [name for name in group if name in table and table[name].notna().any()]
        if any(name in motion or np.ptp(table[name].dropna()) > 0.0 for name in present):
            panels[title] = present
        else:
            still += [f"{label(name, channels)} {table[name].dropna().iloc[0]:g}" for name in present]
    if not panels:
        return None

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (title, names) in zip(grid, panels.items(), strict=True):
            series(axes, table, names, windows, title, predicted)
            axes.label_outer()
            draw_marks(axes, marks if axes is grid[0] else [replace(mark, text="") for mark in marks])
        if windows is not None or predicted:
            handles, names = grid[0].get_legend_handles_labels()
            names = ["measured" if "[" in name else name for name in names]
            figure.legend(handles, names, loc="outside upper left", ncols=5)
        figure.align_ylabels()

    shade = "" if windows is None else f" Shaded: {held_words(table)} held."
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
        groups[titles[ship.control_of_channel(name, actuators)]].append(name)
    return {title: names for title, names in groups.items() if names}


def declared_groups(table: pd.DataFrame) -> dict[str, list[str]]:
    """The channels that a trial declares by the title of their axis: those that differ only in the first word of
    their names, such as port and starboard, together."""
    groups: dict[str, list[str]] = {}
    for channel in declared_channels(table):
        words = label(channel.name, {channel.name: channel})
        groups.setdefault(words.partition(" ")[2] or words, []).append(channel.name)
    return {label(names[0], ship.known_channels(table.attrs)) if len(names) == 1 else title: names
            for title, names in groups.items()}  # fmt: skip


def held_words(table: pd.DataFrame) -> str:
    """What is held in a held window: the thrusters, or whatever controls the ship has."""
    return "thrusters" if all(actuator.noun == "thruster" for actuator in table_actuators(table)) else "controls"


def windows_view(windows: HeldWindows) -> Text:
    """How many windows are held, in how many legs, and why others were dropped."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items()) or "none"
    counts = f"{windows.kept} of {windows.candidates} windows of {windows.horizon_s} s held, in {windows.legs} legs"
    return Text(f"{counts}; dropped: {reasons}")


def draw_windows(figure: Figure, windows: HeldWindows) -> None:
    """Where the windows lie, north up and to scale."""
    times = windows.rows["start"] + pd.to_timedelta(windows.rows["second"], unit="s")
    table = windows.rows.set_index(pd.DatetimeIndex(times)).sort_index()
    track(figure.subplots(), table[~table.index.duplicated()], windows.rows)


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
        self, point: Floats, half: Floats, scale: float, taken: Sequence[Floats], hidden: Floats
    ) -> tuple[Floats, Floats, int]:
        """The nearest place that is clear, or the best: its box [low, high; x, y; px], offset [px] and ring about
        the point. A place costs the labels that it is over [px2], then the edge [px], then the points of lines."""
        best, least = (np.zeros((2, 2)), np.zeros(2), 0), (np.inf,) * 3
        (x0, y0), (x1, y1) = np.asarray(self.frame.bbox)
        for ring, far in enumerate(_FAR_PT):
            for offset in _SIDES * (half + far * scale):
                low, high = box = np.stack([point + offset - half, point + offset + half])
                sides = (np.maximum(np.minimum(high, b) - np.maximum(low, a), 0.0) for a, b in taken)
                over = sum(float(np.prod(side)) for side in sides)
                outside = max(0.0, x0 - low[0], y0 - low[1], high[0] - x1, high[1] - y1)
                cost = over, outside, float(((hidden > low) & (hidden < high)).all(axis=1).sum())
                if cost < least:
                    best, least = (box, offset, ring), cost
                if not any(cost):
                    return best
        return best
