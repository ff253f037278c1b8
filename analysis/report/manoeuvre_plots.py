"""Pictures of manoeuvres: a zigzag against time, a circle to scale, other kinds against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.analysis.manoeuvres import measures
from seatrial.analysis.manoeuvres.indices import Manoeuvre, from_order
from seatrial.analysis.manoeuvres.kinds import remove_current
from seatrial.analysis.manoeuvres.motion import Motion
from seatrial.analysis.report.plots import FAINT, PALETTE, label_points, outlines
from seatrial.analysis.report.tables import index_cells, plain_name

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


def seconds_of(motion: Motion, manoeuvre: Manoeuvre) -> tuple[float, float]:
    """Execute and end of a manoeuvre on the motion's clock [s]."""
    return motion.seconds_of(manoeuvre.start), motion.seconds_of(manoeuvre.end)


def _course_deg(motion: Motion, manoeuvre: Manoeuvre) -> float:
    """The heading of the approach, before the command began to change."""
    begun = seconds_of(motion, manoeuvre)[0] - manoeuvre.settings.get("half_command_s", 0.0)
    return measures.approach_of(motion, begun)["approach_unwrapped_deg"]


def draw(figure: Figure, motion: Motion, manoeuvre: Manoeuvre, *, titled: bool = True) -> None:
    """The picture of a manoeuvre, as its kind has it."""
    start, end = seconds_of(motion, manoeuvre)
    part = motion.around(start, end, _MARGIN_S)
    smooth = measures.smooth_motion(part, measures.half_width_s(part, 0.1 * (end - start)))
    drawing = {"zigzag": draw_zigzag, "turning_circle": draw_circle, "course_change": draw_circle}
    figure.set_layout_engine("none")  # margins that are known: to find them would take as long as to draw
    drawing.get(manoeuvre.kind, draw_run)(figure, smooth, manoeuvre)
    if titled:
        figure.suptitle(title_of(manoeuvre), x=0.01, ha="left", fontsize=10, fontweight="bold")


def draw_untitled(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """The picture of a manoeuvre below a heading that names it."""
    draw(figure, motion, manoeuvre, titled=False)


def title_of(manoeuvre: Manoeuvre) -> str:
    """Name, side and time in one line."""
    return f"{manoeuvre.sided_name} · {manoeuvre.start:%Y-%m-%d %H:%M:%S} UTC"


def draw_zigzag(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """Heading and helm with the overshoots, over yaw rate, speed and shafts, against the time from the execute, and
    the track."""
    has_shafts = bool(_running_shafts(motion))
    above, *below = _panels_over_track(figure, (2.4, 1, 1, *(1,) * has_shafts))
    start, end = seconds_of(motion, manoeuvre)
    time_s = motion.time_s - start
    base = _course_deg(motion, manoeuvre)
    heading = motion.heading_deg - base
    above.plot(time_s, heading, color=BLUE, linewidth=1.8, label="heading off the approach")
    _helm(above, motion, time_s)
    _mark_overshoots(above, motion, manoeuvre, heading)
    above.set_ylabel("to starboard\n[deg]")
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderpad=0.0)
    _rate_and_speed(below[:2], motion, time_s)
    if has_shafts:
        _shafts(below[2], motion, time_s)
    above.set_xlim(time_s[0], min(time_s[-1], end - start + _MARGIN_S))
    _time_axis([above, *below])
    _track_ahead(figure, motion, manoeuvre)
    figure.align_ylabels()


def _helm(axes: Axes, motion: Motion, time_s: Floats) -> None:
    """What the ship is steered by, and dashed what was ordered."""
    axes.plot(time_s, motion.helm_deg, color=ORANGE, label=motion.steering)
    if motion.helm_order_deg is not None:
        axes.plot(time_s, motion.helm_order_deg, "--", color=ORANGE, label=f"{motion.steering}, ordered")


def _mark_overshoots(axes: Axes, motion: Motion, manoeuvre: Manoeuvre, heading: Floats) -> None:
    """From the heading at each execute, or at its order, to its extreme: a bar with the overshoot."""
    start, end = seconds_of(motion, manoeuvre)
    executes = np.array([motion.seconds_of(time) for time in manoeuvre.executes])
    few = len(executes) <= 10
    axes.axvline(0.0, color=FAINT, linewidth=0.8)
    for number, (execute, following) in enumerate(zip(executes, [*executes[1:], end], strict=True), start=1):
        side = manoeuvre.sign if number % 2 else -manoeuvre.sign
        ordered = manoeuvre.indices.get(from_order(number))
        index = ordered or manoeuvre.indices.get(f"overshoot_{number}_deg")
        axes.axvline(execute - start, color=FAINT, linewidth=0.8, linestyle=":")
        if index is None:
            continue
        time_s, top = measures.peak(motion.time_s, side * heading, execute, following)
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


def _rate_and_speed(panels: Sequence[Axes], motion: Motion, time_s: Floats) -> None:
    """Yaw rate, and below it speed over ground."""
    panels[0].plot(time_s, motion.yaw_rate_dps, color=GREEN)
    panels[0].set_ylabel("yaw rate\n[deg/s]")
    panels[1].plot(time_s, motion.speed_mps, color=PURPLE)
    panels[1].set_ylim(bottom=0.0)
    panels[1].set_ylabel("speed\n[m/s]")


def _running_shafts(motion: Motion) -> dict[str, Floats]:
    return {name: rpm for name, rpm in {**motion.drives, **motion.tunnels}.items() if np.abs(rpm).max() > 0.0}


def _shafts(axes: Axes, motion: Motion, time_s: Floats) -> None:
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


def _time_axis(panels: Sequence[Axes]) -> None:
    """The time below the last of a column of panels."""
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time since the order [s]")


def _panels_over_track(figure: Figure, heights: Sequence[float]) -> list[Axes]:
    """A column of panels over one time axis, with room for the track below them."""
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights, **{**_MARGINS, "bottom": 0.36, "top": 0.93})
    first = figure.add_subplot(grid[0])
    return [first, *(figure.add_subplot(grid[row], sharex=first) for row in range(1, len(heights)))]


def _track_ahead(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """The track to scale from left to right below other panels, with the ship on it; starboard is below."""
    axes = figure.add_subplot(figure.add_gridspec(1, 1, **{**_MARGINS, "bottom": 0.09, "top": 0.25})[0])
    start, end = seconds_of(motion, manoeuvre)
    course_deg, shown = _course_deg(motion, manoeuvre), motion.between(motion.time_s[0], end)
    across, ahead = _across_ahead(shown, start, course_deg)
    axes.plot(ahead, across, color=BLUE, linewidth=1.4)
    if motion.length_m:
        rows = slice(int(np.searchsorted(shown.time_s, start)), None)
        headings = np.pi / 2.0 - np.deg2rad(shown.heading_deg[rows] - course_deg)
        outlines(axes, ahead[rows], across[rows], headings, motion.length_m)
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
    start, end = seconds_of(motion, manoeuvre)
    ahead_deg = _course_deg(motion, manoeuvre)
    shown = motion.between(motion.time_s[0], end)
    current = manoeuvre.current
    main = shown
    if current:
        main = remove_current(shown, current.north_mps, current.east_mps, start)
        track_axes.plot(*_across_ahead(shown, start, ahead_deg), color=FAINT, label="as measured")
    across, ahead = _across_ahead(main, start, ahead_deg)
    track_axes.plot(across, ahead, color=BLUE, linewidth=1.8,
              label="current removed" if current else "track")  # fmt: skip
    # the ship to scale from the execute on; a twentieth of the picture where its length is not known
    length_m = main.length_m or max(float(np.ptp(across)), float(np.ptp(ahead))) / 20.0
    rows = slice(int(np.searchsorted(main.time_s, start)), None)
    outlines(track_axes, across[rows], ahead[rows], np.deg2rad(main.heading_deg[rows] - ahead_deg), length_m)
    _dimensions(track_axes, main, manoeuvre, start, end, ahead_deg, "_current_removed" if current else "")
    track_axes.plot(0.0, 0.0, "o", color=RED, markersize=5, label="order")
    track_axes.margins(0.12)  # room for the labels of the track
    track_axes.set_aspect("equal", adjustable="datalim")
    track_axes.set_xlabel("to starboard of the approach [m]")
    track_axes.set_ylabel("ahead of the order [m]")
    track_axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderpad=0.0)
    time_s = motion.time_s - start
    side_axes[0].plot(time_s, motion.heading_deg - ahead_deg, color=BLUE)
    side_axes[0].set_ylabel("heading\n[deg]")
    _helm(side_axes[1], motion, time_s)
    side_axes[1].set_ylabel(f"{motion.steering}\n[deg]")
    _rate_and_speed(side_axes[2:4], motion, time_s)
    if panels > 4:
        _shafts(side_axes[4], motion, time_s)
    for axes in side_axes:
        axes.axvline(0.0, color=FAINT, linewidth=0.8)
        axes.set_xlim(time_s[0], time_s[-1])
    _time_axis(side_axes)
    figure.align_ylabels(side_axes)


def _across_ahead(motion: Motion, start: float, ahead_deg: float) -> tuple[Floats, Floats]:
    north, east = motion.north_m - motion.at("north_m", start), motion.east_m - motion.at("east_m", start)
    ahead, across = to_ship(north, east, np.deg2rad(ahead_deg))
    return across, ahead


def _dimensions(
    axes: Axes, motion: Motion, manoeuvre: Manoeuvre, start: float, end: float, ahead_deg: float, suffix: str
) -> None:
    """Arrows for advance, transfer and tactical diameter with their values."""
    turned = np.abs(motion.heading_deg - ahead_deg)
    quarter_s, half_s = (measures.crossing_s(motion.time_s, turned, angle, start, end) for angle in (90.0, 180.0))
    arrows: dict[str, tuple[Point, Point]] = {}
    if np.isfinite(quarter_s) and f"advance_m{suffix}" in manoeuvre.indices:
        ahead, across = measures.along_and_across(motion, start, quarter_s, ahead_deg)
        offset, above = -manoeuvre.sign * 0.12 * max(abs(ahead), abs(across)), ahead - 0.12 * ahead
        arrows = {"advance": ((offset, 0.0), (offset, ahead)), "transfer": ((0.0, above), (across, above))}
        axes.plot([offset, across], [ahead, ahead], color=FAINT, linewidth=0.8, linestyle="--")
    if np.isfinite(half_s) and f"tactical_diameter_m{suffix}" in manoeuvre.indices:
        ahead, across = measures.along_and_across(motion, start, half_s, ahead_deg)
        arrows["tactical_diameter"] = (0.0, ahead), (across, ahead)
    look = {"arrowstyle": "<->", "color": RED, "linewidth": 1.0}
    for begin, finish in arrows.values():
        axes.annotate("", finish, begin, arrowprops=look)
    values = [index_cells(manoeuvre.indices[f"{name}_m{suffix}"])[0] for name in arrows]
    texts = [f"{plain_name(name)}\n{value}" for name, value in zip(arrows, values, strict=True)]
    lines = [np.linspace(*ends, 60) for ends in arrows.values()]
    path = np.stack(_across_ahead(motion, start, ahead_deg), axis=1)
    middles = [tuple(line.mean(axis=0)) for line in lines]
    label_points(axes, middles, texts, np.concatenate([path, *lines]), color=RED, fontsize=8, zorder=4)


def draw_run(figure: Figure, motion: Motion, manoeuvre: Manoeuvre) -> None:
    """Speed, shafts, helm and heading against time, of what goes straight or is a test of a drive."""
    above, middle, helm, below = _panels_over_track(figure, (1, 1, 1, 1))
    start, end = seconds_of(motion, manoeuvre)
    time_s = motion.time_s - start
    above.plot(time_s, motion.surge_mps, color=BLUE, label="surge")
    above.plot(time_s, motion.sway_mps, color=ORANGE, label="sway")
    above.set_ylabel("speed\n[m/s]")
    _shafts(middle, motion, time_s)
    _helm(helm, motion, time_s)
    helm.set_ylabel(f"{motion.steering or 'helm'}\n[deg]")
    below.plot(time_s, motion.heading_deg - motion.at("heading_deg", start), color=PURPLE)
    below.set_ylabel("turned\n[deg]")
    for axes in (above, middle, helm, below):
        axes.axvspan(0.0, end - start, color="#56B4E9", alpha=0.12, linewidth=0)
    several = len(motion.drives) + len(motion.tunnels) > 1
    for axes in (above, middle) if several else (above,):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, borderpad=0.0)
    _time_axis([above, middle, helm, below])
    _track_ahead(figure, motion, manoeuvre)
    figure.align_ylabels()


def draw_together(figure: Figure, runs: Sequence[tuple[str, Motion, Manoeuvre]]) -> None:
    """Runs, each with its name, over each other: tracks in the frame of each approach, heading and speed."""
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1))
    track_axes, above, below = (figure.add_subplot(grid[place]) for place in ((slice(None), 0), (0, 1), (1, 1)))
    for number, (name, motion, manoeuvre) in enumerate(runs):
        start, end = seconds_of(motion, manoeuvre)
        course_deg, part = _course_deg(motion, manoeuvre), motion.between(start - _MARGIN_S, end)
        part = measures.smooth_motion(part, measures.half_width_s(part, 0.1 * (end - start)))
        dashes = _DASHES[number // len(PALETTE) % len(_DASHES)]
        style: dict[str, Any] = {"color": PALETTE[number % len(PALETTE)], "linestyle": dashes}
        track_axes.plot(*_across_ahead(part, start, course_deg), label=name, **style)
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


def size_inch_of(manoeuvre: Manoeuvre) -> tuple[float, float]:
    """The size of a manoeuvre's picture on a page."""
    return SIZES_INCH.get(manoeuvre.kind, _OTHER_INCH)
