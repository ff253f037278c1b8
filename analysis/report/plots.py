"""Figures of tables and windows in one style: functions take axes and data and return the artists they drew.
A trial is two figures of a page: its track, and its channels against time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle

import matplotlib.dates as dates
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Affine2D, ScaledTranslation
from rich.text import Text

from acquisition.core.actuators import Actuators, control_names, part_of_control
from acquisition.core.angles import wraps_of
from acquisition.core.arrays import Floats
from acquisition.core.channel import Channel
from acquisition.core.channels import BY_NAME, known_channels
from acquisition.core.units import DIMENSIONLESS, ending_of
from analysis.kinematics import mean_wind
from analysis.tables.table import declared_channels, table_actuators, utc_index
from analysis.windows.held import HeldWindows, held_spans_ns

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442")
"""The colours of Okabe and Ito, which the colour-blind tell apart, the darkest first."""
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


def label(name: str, known: Mapping[str, Channel] = BY_NAME) -> str:
    """A channel's name for an axis, with its unit; ``known`` are the channels.

    >>> label("port_angle_deg")
    'port angle [deg]'
    """
    unit = known[name].unit
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
    """The ship's track, north up and to scale, held windows in one colour a leg, the time along it.

    ``table`` holds ``north_m`` and ``east_m`` [m]; ``windows`` is the long table of held windows. Of a ship of
    ``length_m`` [m] the outline is drawn at each time, enlarged where it would not be seen, which the legend says.
    ``executes`` are the times at which manoeuvres begin. Where the wind is known, an arrow shows where it blows to.
    """
    artists: list[Artist] = list(axes.plot(table["east_m"], table["north_m"], color=FAINT, label="track"))
    if windows is not None:
        for number, (_, leg) in enumerate(windows.groupby("leg", sort=False)):
            colour = PALETTE[number % len(PALETTE)]
            artists.append(_leg(axes, leg, colour))
            artists[-1].set_label(f"_leg {number + 1}")
    ticks = _ticks(table, tick_every_s)
    if length_m is not None and "heading_deg" in table:
        artists += _ships(axes, table, ticks, length_m)
    artists += _time_ticks(axes, ticks)
    artists += _executes(axes, table, executes)
    artists += wind_arrow(axes, table)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(label("east_m"))
    axes.set_ylabel(label("north_m"))
    return artists


HULL_OUTLINE = np.array([[-0.5, -0.13], [0.25, -0.13], [0.5, 0.0], [0.25, 0.13], [-0.5, 0.13], [-0.5, -0.13]])
"""A ship's outline, ahead and to starboard, in lengths."""
_CALM_MPS = 0.1  # no arrow for a calm, nor for a wind that was not recorded
_LEAST_SHARE = 0.02  # of the track's extent: a ship shorter than that is not seen on the page


def ship(
    axes: Axes, across: float, up: float, heading_rad: float, length_m: float, words: str | None = None
) -> Artist:
    """A ship's outline with her middle at a point of the axes and her bow ``heading_rad`` clockwise from
    upwards."""
    forward, aside = length_m * HULL_OUTLINE[:, 0], length_m * HULL_OUTLINE[:, 1]
    x = across + forward * np.sin(heading_rad) + aside * np.cos(heading_rad)
    y = up + forward * np.cos(heading_rad) - aside * np.sin(heading_rad)
    (outline,) = axes.fill(x, y, facecolor="#DCE9F2", edgecolor=INK, linewidth=0.8, zorder=3, label=words)
    return outline


def _ships(axes: Axes, table: pd.DataFrame, ticks: pd.DataFrame, length_m: float) -> list[Artist]:
    """The outline at every tick; ten, twenty or fifty times as large as the ship where she would not be seen."""
    extent = max(float(np.ptp(table[name].dropna())) if len(table) else 0.0 for name in ("north_m", "east_m"))
    times = next((each for each in (1, 2, 5, 10, 20, 50) if each * length_m >= _LEAST_SHARE * extent), 100)
    words = f"ship of {length_m:g} m" + (f", {times} times her size" if times > 1 else ", to scale")
    placed = ticks.dropna(subset=["heading_deg"])
    return [
        ship(axes, row["east_m"], row["north_m"], np.deg2rad(row["heading_deg"]), times * length_m,
             words if number == 0 else None)
        for number, (_, row) in enumerate(placed.iterrows())
    ]  # fmt: skip


def _executes(axes: Axes, table: pd.DataFrame, executes: Sequence[pd.Timestamp]) -> list[Artist]:
    """A cross where each manoeuvre began."""
    placed = table[["north_m", "east_m"]].dropna()
    if not len(executes) or placed.empty:
        return []
    at = placed.iloc[placed.index.get_indexer(pd.DatetimeIndex(list(executes)), method="nearest")]
    return list(
        axes.plot(at["east_m"], at["north_m"], "X", color=PALETTE[4], markeredgecolor="white", markersize=8,
                  linestyle="none", zorder=5, label="manoeuvre begins")
    )  # fmt: skip


def wind_arrow(axes: Axes, table: pd.DataFrame) -> list[Artist]:
    """Where the mean wind blows to, in the upper left corner, with its speed and where it comes from."""
    if not {"wind_speed_mps", "wind_direction_deg"} <= set(table.columns):
        return []
    air = table[["wind_speed_mps", "wind_direction_deg"]].dropna()
    if air.empty:
        return []
    speed_mps, from_deg = mean_wind(air)
    if speed_mps < _CALM_MPS:
        return []
    to_rad = np.deg2rad(from_deg + 180.0)
    half, middle = 15.0 * np.array([np.sin(to_rad), np.cos(to_rad)]), np.array([26.0, -26.0])
    corner = (
        Affine2D().scale(1.0 / 72.0) + axes.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, axes.transAxes)  # type: ignore[arg-type]
    )
    arrow = axes.annotate("", tuple(middle + half), tuple(middle - half), xycoords=corner, textcoords=corner,
                          arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.4})  # fmt: skip
    words = f"wind {speed_mps:.1f} m/s\nfrom {from_deg:.0f}°"
    text = axes.text(50.0, -16.0, words, fontsize=8, va="top", color=INK, transform=corner)
    return [arrow, text]


def _leg(axes: Axes, rows: pd.DataFrame, colour: str) -> Line2D:
    """All windows of a leg as one line, lifted between them: a line each takes most of a figure's time."""
    begins = np.flatnonzero(np.diff(rows["window"].to_numpy()) != 0) + 1
    east, north = (np.insert(rows[name].to_numpy(dtype=float), begins, np.nan) for name in ("east_m", "north_m"))
    (line,) = axes.plot(east, north, color=colour, linewidth=2.2)
    return line


def _ticks(table: pd.DataFrame, every_s: float) -> pd.DataFrame:
    """The first row with a position after every whole multiple of ``every_s``."""
    placed = table.dropna(subset=["north_m", "east_m"])
    seconds = utc_index(placed).asi8 // 1_000_000_000
    return placed[np.append(True, np.diff(seconds // every_s) > 0)] if len(placed) else placed


def _time_ticks(axes: Axes, ticks: pd.DataFrame) -> list[Artist]:
    """A dot and the time of day at every tick."""
    (dots,) = axes.plot(ticks["east_m"], ticks["north_m"], "o", color=INK, markersize=3, linestyle="none")
    texts = [
        axes.annotate(f"{time:%H:%M}", (row["east_m"], row["north_m"]), xytext=(5, 5), fontsize=7, color=INK,
                      textcoords="offset points", zorder=4)
        for time, row in ticks.iterrows()
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
    known = known_channels(table.attrs)
    if windows is not None:
        artists.append(held_shade(axes, windows))
    for name, colour in zip(names, cycle(PALETTE), strict=False):
        present = table[name].dropna()
        shown = break_at_wrap(present) if known[name].circular else present.to_numpy(dtype=float)
        steps = "steps-post" if known[name].state else "default"
        artists += axes.plot(present.index, shown, color=colour, label=label(name, known), drawstyle=steps)
    units = sorted({known[name].unit for name in names})
    axes.set_ylabel(label(names[0], known) if len(names) == 1 else f"[{', '.join(units)}]")
    axes.set_xlabel("time, UTC")
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M", tz="UTC"))  # type: ignore[no-untyped-call]
    axes.margins(x=0.01)
    if len(names) > 1:
        lines = [artist for artist in artists if isinstance(artist, Line2D)]
        axes.legend(handles=lines, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderpad=0.0)
    return artists


def break_at_wrap(angle_deg: pd.Series) -> Floats:
    """The values of an angle with NaN where the drawn line would cross the whole turn."""
    values = angle_deg.to_numpy(dtype=float, copy=True)
    values[wraps_of(values)] = np.nan
    return values


def held_shade(axes: Axes, windows: pd.DataFrame) -> PolyCollection:
    """A shade over the full height of the axes wherever a window is held."""
    spans = dates.date2num(held_spans_ns(windows).astype("datetime64[ns]"))  # type: ignore[no-untyped-call]
    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in spans]
    shade = PolyCollection(
        corners, facecolors=HELD, alpha=0.25, linewidths=0, label="held", transform=axes.get_xaxis_transform()
    )
    axes.add_collection(shade, autolim=False)
    return shade


Drawing = tuple[Callable[[Figure], None], tuple[float, float], str]
"""What fills a figure, its size [in], and its caption."""
_TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 21600.0)
_TRACK_INCH = (3.0, 8.0)
_MOST_TICKS = 10  # times of day along a track; more would lie on each other


def _track_height_inch(table: pd.DataFrame) -> float:
    """A height that fits a track to scale into a picture of 8 in."""
    extents = {name: float(table[name].max() - table[name].min()) for name in ("north_m", "east_m")}
    share = extents["north_m"] / max(extents["east_m"], 1e-3)
    return min(max(0.8 + 7.0 * share, _TRACK_INCH[0]), _TRACK_INCH[1]) if np.isfinite(share) else _TRACK_INCH[1]


def tick_every_s(table: pd.DataFrame) -> float:
    """A round time between marks along the track that leaves at most ten of them."""
    duration_s = float((table.index[-1] - table.index[0]).total_seconds()) if len(table) else 0.0
    return next((step for step in _TICKS_S if duration_s / step <= _MOST_TICKS), _TICKS_S[-1])


def track_figure(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    length_m: float | None = None,
    executes: Sequence[pd.Timestamp] = (),
) -> Drawing | None:
    """The track of a 1 Hz table, None without positions; arguments as of :func:`analysis.report.plots.track`."""
    if table.reindex(columns=["north_m", "east_m"]).dropna().empty:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        track(axes, table, windows, tick_every_s(table), length_m, executes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)

    legs = 0 if windows is None else windows["leg"].nunique()
    caption = f"The track, north up, one colour a leg of held {held_words(table)} ({legs} legs), time in UTC."
    return draw, (8.0, _track_height_inch(table)), caption


def channels_figure(table: pd.DataFrame, windows: pd.DataFrame | None = None) -> Drawing | None:
    """The channels of a 1 Hz table against time, held windows shaded; None without any channel."""
    motion = (("heading_deg",), ("surge_mps", "sway_mps"), ("yaw_rate_dps",))
    wind = (("wind_speed_mps",), ("wind_direction_deg",))
    controls = control_groups(table_actuators(table)).values()
    groups = known_groups(table, (*motion, *controls, *wind, *declared_groups(table).values()))

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axes, names in zip(grid, groups, strict=True):
            series(axes, table, names, windows)
            axes.label_outer()

    caption = "The channels at 1 Hz; shaded where a window is held."
    return (draw, (9.0, 1.2 + 1.5 * len(groups)), caption) if groups else None


def control_groups(actuators: Actuators) -> dict[str, list[str]]:
    """The control channels of a ship by what they are together: angles first, then shafts, then pitch."""
    thrusters = all(each.kind in ("azimuth", "tunnel") for each in actuators)
    shafts = "thrusters [rpm]" if thrusters else "shafts [rpm]"
    titles = {"azimuth": "azimuths [deg]", "rudder": "rudders [deg]", "nozzle": "nozzles [deg]", "shaft": shafts,
              "tunnel thruster": shafts, "pitch": "pitch [%]"}  # fmt: skip
    groups: dict[str, list[str]] = {title: [] for title in titles.values()}
    for name in control_names(actuators):
        groups[titles[part_of_control(name, actuators)]].append(name)
    return {title: names for title, names in groups.items() if names}


def declared_groups(table: pd.DataFrame) -> dict[str, list[str]]:
    """The channels that a trial declares, those of the same thing and unit together, by what their axis is called.

    The same thing is what the first word of their names, port and starboard say, does not tell apart.
    """
    groups: dict[str, list[str]] = {}
    for channel in declared_channels(table):
        words = label(channel.name, {channel.name: channel})
        groups.setdefault(words.partition(" ")[2] or words, []).append(channel.name)
    return {label(names[0], known_channels(table.attrs)) if len(names) == 1 else title: names
            for title, names in groups.items()}  # fmt: skip


def held_words(table: pd.DataFrame) -> str:
    """What is held in a held window: the thrusters, or whatever controls the ship has."""
    return "thrusters" if all(each.kind in ("azimuth", "tunnel") for each in table_actuators(table)) else "controls"


def known_groups(table: pd.DataFrame, groups: Sequence[Sequence[str]]) -> list[list[str]]:
    """Groups of channels without those that a table has no value of."""
    known = [[name for name in names if name in table and table[name].notna().any()] for names in groups]
    return [names for names in known if names]


def windows_view(found: HeldWindows) -> Text:
    """How many windows are held, in how many legs, and why others were dropped."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in found.dropped.items()) or "none"
    counts = f"{found.kept} of {found.candidates} windows of {found.horizon_s} s held, in {found.legs} legs"
    return Text(f"{counts}; dropped: {reasons}")


def draw_windows(figure: Figure, found: HeldWindows) -> None:
    """Where the windows lie, north up and to scale, one colour a leg."""
    times = found.rows["start"] + pd.to_timedelta(found.rows["second"], unit="s")
    table = found.rows.set_index(pd.DatetimeIndex(times)).sort_index()
    track(figure.subplots(), table[~table.index.duplicated()], found.rows)
