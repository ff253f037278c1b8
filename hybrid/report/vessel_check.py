"""The standard manoeuvres of a vessel file as a table, a picture and a page, IMO's limits beside them."""

from __future__ import annotations

from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Group
from rich.table import Table
from rich.text import Text

from seatrial.acquisition.core.quantities import GRAVITY_MPS2
from seatrial.analysis.manoeuvres.criteria import headline_of_criteria, shortfalls_of
from seatrial.analysis.manoeuvres.indices import Index, from_order
from seatrial.analysis.manoeuvres.measures import peak
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, outlines
from seatrial.analysis.report.rendering import Page, render, write_figure
from seatrial.analysis.report.tables import plain_name
from seatrial.hybrid.report.text import join_words, plain, templates
from seatrial.hybrid.simulation.vessel_check import StandardTest, VesselCheck

BLUE, ORANGE, GREEN, _, RED = PALETTE[:5]
HEADER = ("", "value", "lengths", "IMO limit", "")
PICTURES = ("png", "svg", "pdf", "json")
_PULL_OUT_LENGTHS = 60.0


def vessel_check_view(check: VesselCheck) -> Group:
    """The ship in a line, each test with a row an index, and what could not be made."""
    table = Table(box=None, header_style="dim", pad_edge=False)
    for title, justify in zip(HEADER, ("left", "right", "right", "right", "left"), strict=True):
        table.add_column(title, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for test in check.tests:
        table.add_row(test.name, style="bold")
        for row in index_rows(test):
            table.add_row(f"  {row[0]}", *row[1:])
    notes = "\n".join(f"{note[0].upper()}{note[1:]}." for note in notes_of(check))
    return Group(Text(f"{check.vessel}: {headline(check)}", style="bold"), table, Text(notes))


def headline(check: VesselCheck) -> str:
    """The ship and the speed of the tests in a line."""
    froude = check.speed_mps / np.sqrt(GRAVITY_MPS2 * check.length_m)
    return (
        f"{check.length_m:g} m, {check.speed_mps:.2f} m/s at {check.rpm:.4g} rpm (Froude number {froude:.2f}, "
        f"L/V {check.length_m / check.speed_mps:.1f} s)"
    )


def index_rows(test: StandardTest) -> list[list[str]]:
    """One row an index: its name, value, in lengths, limit, and the result."""
    return [
        [plain_name(name), value_text(index), lengths_text(index), _limit_text(index), plain(index.result)]
        for name, index in test.indices.items()
    ]


def value_text(index: Index) -> str:
    """A value with three digits and more, and its unit."""
    value = 0.0 if abs(index.value) < 1e-6 else index.value
    digits = f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
    return f"{digits} {index.unit}".rstrip()


def lengths_text(index: Index) -> str:
    """A distance in ship lengths; empty for what is none."""
    return "" if index.lengths is None else f"{index.lengths:.2f}".replace("-0.00", "0.00")


def _limit_text(index: Index) -> str:
    if index.limit is None:
        return ""
    return f"{index.limit_lengths:.1f} L" if index.limit_lengths else f"{index.limit:.1f} {index.unit}"


def write_vessel_check(check: VesselCheck, path: Path) -> Path:
    """Write a picture (png, svg, pdf, or json with its numbers), or a page for any other ending.

    Raises :class:`StorageError`.
    """
    ending = path.suffix.removeprefix(".").lower()
    if ending in PICTURES:
        return write_figure(check.plot(), path.parent, path.stem, (ending,))[0]
    return page_of(check).write(path)


def page_of(check: VesselCheck) -> Page:
    """The page: picture and table."""
    return render(
        "vessel_check.html", templates=templates(), title=check.vessel, check=check, subtitle=headline(check)
    )


def notes_of(check: VesselCheck) -> list[str]:
    """What is to be said under the table: whether the ship keeps straight by itself, the criteria, what is not
    made."""
    stability = {
        None: "course stability is not known: no pull-out was possible",
        True: "course stable: with the helm amidships the ship stops turning, to either side",
        False: "not course stable: with the helm amidships the ship keeps turning",
    }
    by_reason: dict[str, list[str]] = {}
    for name, why in check.left_out.items():
        by_reason.setdefault(why, []).append(name)
    tested = {test.kind for test in check.tests} & {"turning_circle", "zigzag", "stopping"}
    assumed = "with the draught of the vessel file as that of full load, on even keel"
    headline_words = headline_of_criteria(check.criteria, "The model").rstrip(".")
    standards = [f"{headline_words} ({assumed})"] if tested else []
    shortfalls = [f"{reason}: {names}" for reason, names in shortfalls_of(check.criteria)]
    not_made = [f"{join_words(names)} not made: {why}" for why, names in by_reason.items()]
    return [stability[check.course_stable], *standards, *shortfalls, *not_made]


def draw_vessel_check(figure: Figure, check: VesselCheck) -> None:
    """Speeds, turning circles, zigzags, pull-outs and the crash stop, each with its figures and limits."""
    panels = figure.subplot_mosaic(
        [["circles", "10", "20"], ["circles", "10", "20"], ["speeds", "pull", "stop"], ["speeds", "pull", "stop"]]
    )
    _draw_circles(panels["circles"], check)
    for axes, angle in ((panels["10"], 10.0), (panels["20"], 20.0)):
        _draw_zigzag(axes, [test for test in check.of_kind("zigzag") if abs(test.helm_deg) == angle])
        axes.set_title(f"zigzag {angle:.0f}/{angle:.0f}", loc="left")

    axes = panels["speeds"]
    axes.set_title("steady speed", loc="left")
    rpm, speed = check.speeds.T
    axes.plot(rpm, speed, "o-", color=BLUE, markersize=3.5)
    if isfinite(check.speed_mps):
        axes.plot(check.rpm, check.speed_mps, "D", color=RED, markersize=6, label="speed of the tests")
        axes.legend(loc="upper left", fontsize=8)
    axes.set(xlabel="shaft speed [rpm]", ylabel="speed [m/s]", xlim=(0.0, None), ylim=(0.0, None))

    _draw_pull_outs(panels["pull"], check)

    axes = panels["stop"]
    axes.set_title("crash stop", loc="left")
    for test in check.of_kind("stopping"):
        shown = test.motion.between(float(test.executes_s[0]), float(test.executes_s[1]))
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(shown.north_m), np.diff(shown.east_m)))) / check.length_m
        axes.plot(way, shown.surge_mps, color=BLUE)
        names = ("track_reach_m", "head_reach_m", "lateral_deviation_m", "stopping_time_s")
        _write_indices(axes, test, names)
    axes.set(xlabel="way along the track [L]", ylabel="surge [m/s]")
    figure.suptitle(f"{check.vessel}: {headline(check)}", x=0.01, ha="left", fontsize=11)


def _draw_pull_outs(axes: Axes, check: VesselCheck) -> None:
    """Yaw rate from the order amidships on."""
    axes.set_title("pull-out: helm amidships out of a turn", loc="left")
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    for test, colour in zip(check.of_kind("pull_out"), (BLUE, ORANGE), strict=False):
        released = float(test.executes_s[1])
        length_s = check.length_m / check.speed_mps
        shown = test.motion.between(released - 3.0 * length_s, released + _PULL_OUT_LENGTHS * length_s)
        axes.plot(shown.time_s - released, shown.yaw_rate_dps, color=colour, label=f"from {_side(test)}")
    tests = check.of_kind("pull_out")
    if tests:
        texts = [f"{value_text(test.indices['residual_yaw_rate_dps'])} left from {_side(test)}" for test in tests]
        axes.text(0.98, 0.02, "\n".join(texts), transform=axes.transAxes, fontsize=8, ha="right", va="bottom")
        axes.legend(loc="upper right", fontsize=8)
    words = {None: "", True: "course stable", False: "not course stable"}[check.course_stable]
    axes.set(xlabel=f"time since the order [s]{', ' * bool(words)}{words}", ylabel="yaw rate [deg/s]")


def _write_indices(axes: Axes, test: StandardTest, names: tuple[str, ...]) -> None:
    """The indices with their limits as a block of text at the lower left of the axes."""
    lines = []
    for name in names:
        if name in test.indices:
            index = test.indices[name]
            value = f"{lengths_text(index)} L" if index.lengths is not None else value_text(index)
            limit = f"  (IMO {_limit_text(index)}, {plain(index.result)})" if index.limit is not None else ""
            lines.append(f"{plain_name(name)} {value}{limit}")
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    words = "\n".join(lines)
    axes.text(0.02, 0.02, words, transform=axes.transAxes, va="bottom", fontsize=8, color=INK, bbox=box, zorder=5)


def _draw_circles(axes: Axes, check: VesselCheck) -> None:
    """Both circles in lengths, the approach upwards, IMO's largest advance and diameter as lines."""
    axes.set_title("turning circles", loc="left")
    length_m = check.length_m
    for test, colour in zip(check.of_kind("turning_circle"), (BLUE, ORANGE), strict=False):
        motion, start_s = test.motion, float(test.executes_s[0])
        shown = motion.between(test.executes_s[0] - 2.0 * length_m / check.speed_mps, test.executes_s[-1])
        starboard = (shown.east_m - motion.at("east_m", start_s)) / length_m
        ahead = (shown.north_m - motion.at("north_m", start_s)) / length_m
        axes.plot(starboard, ahead, color=colour, label=f"{abs(test.helm_deg):.0f} deg to {_side(test)}")
        turning = slice(int(np.searchsorted(shown.time_s, test.executes_s[0])), None)
        outlines(axes, starboard[turning], ahead[turning], np.deg2rad(shown.heading_deg[turning]), 1.0)

        side = 1.0 if test.helm_deg > 0.0 else -1.0
        words = "_" if side < 0.0 else "IMO's largest advance and diameter"
        limits = [
            index.limit_lengths if (index := test.indices.get(name)) else None
            for name in ("advance_m", "tactical_diameter_m")
        ]
        look: dict[str, Any] = {"linestyle": "--", "color": RED, "linewidth": 0.9}
        if limits[0] is not None:
            axes.plot([0.0, side * 3.0], [limits[0]] * 2, label=words, **look)
        if limits[1] is not None:
            axes.plot([side * limits[1]] * 2, [-1.0, 2.0], **look)
    tests = check.of_kind("turning_circle")
    if tests:
        names = ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m")
        _write_indices(axes, tests[0], names)
        axes.legend(loc="upper right", fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="to starboard of the approach [L]", ylabel="ahead of the order [L]")


def _side(test: StandardTest) -> str:
    return "starboard" if test.helm_deg > 0.0 else "port"


def _draw_zigzag(axes: Axes, tests: list[StandardTest]) -> None:
    """Heading off the approach and helm against time, overshoots marked, of the first of both sides."""
    for test in tests[:1]:
        start, motion = float(test.executes_s[0]), test.motion
        shown = motion.between(start - 0.1 * (motion.time_s[-1] - start), motion.time_s[-1])
        course_deg = motion.at("heading_deg", start)
        axes.plot(
            shown.time_s - start, shown.heading_deg - course_deg, color=BLUE, label="heading off the approach"
        )
        axes.plot(shown.time_s - start, -shown.helm_deg, color=ORANGE, label="helm, to starboard", linewidth=1.0)
        side = test.run.sign
        for execute, following in pairwise(test.executes_s[1:]):
            deviation = side * (motion.heading_deg - course_deg)
            time_s, top = peak(motion.time_s, deviation, float(execute), float(following))
            axes.vlines(time_s - start, side * abs(test.helm_deg), side * top, color=RED, linewidth=2.4)
            side = -side
        _write_indices(axes, test, (from_order(1), from_order(2), "initial_turning_m"))
        axes.margins(y=0.3)
        axes.legend(loc="upper right", ncols=2, fontsize=8)
    axes.set(xlabel="time since the order [s]", ylabel="[deg], starboard positive")
