"""A trial in two figures of a page: the track, and the channels against time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Drawing: TypeAlias = "tuple[Callable[[Figure], None], tuple[float, float], str]"
"""What fills a figure, its size [in], and its caption."""
_TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 21600.0)
_TRACK_INCH = (3.0, 8.0)
_MOST_TICKS = 10  # times of day along a track; more would lie on each other
_GROUPS = (
    ("heading_deg",), ("surge_mps", "sway_mps"), ("yaw_rate_dps",),
    ("port_angle_deg", "starboard_angle_deg"), ("port_rpm", "starboard_rpm", "tunnel_rpm"),
    ("wind_speed_mps",), ("wind_direction_deg",),
)  # fmt: skip


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
    from analysis.report import plots

    if table.reindex(columns=["north_m", "east_m"]).dropna().empty:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        plots.track(axes, table, windows, tick_every_s(table), length_m, executes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)

    legs = 0 if windows is None else windows["leg"].nunique()
    caption = f"The track, north up, one colour a leg of held thrusters ({legs} legs), time in UTC."
    return draw, (8.0, _track_height_inch(table)), caption


def channels_figure(table: pd.DataFrame, windows: pd.DataFrame | None = None) -> Drawing | None:
    """The channels of a 1 Hz table against time, held windows shaded; None without any channel."""
    from analysis.report import plots

    groups = known_groups(table, _GROUPS)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axes, names in zip(grid, groups, strict=True):
            plots.series(axes, table, names, windows)
            axes.label_outer()

    caption = "The channels at 1 Hz; shaded where a window is held."
    return (draw, (9.0, 1.2 + 1.5 * len(groups)), caption) if groups else None


def known_groups(table: pd.DataFrame, groups: Sequence[Sequence[str]]) -> list[list[str]]:
    """Groups of channels without those that a table has no value of."""
    known = [[name for name in names if name in table and table[name].notna().any()] for names in groups]
    return [names for names in known if names]
