"""What was identified: as tables for a terminal, and as a picture of the fit and of each coefficient."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.report.plots import FAINT, INK, PALETTE
from hybrid.identification.identify import Estimate, Identification

_BLUE, _ORANGE = PALETTE[:2]
_TRIALS = 5


def identification_view(found: Identification) -> Group:
    """The coefficients, what hangs together, the validation, and what to do next."""
    parts: list[RenderableType] = [*(Text(f"left out: {each}") for each in found.set_aside), _coefficients(found)]
    for one, other, correlation in found.entangled:
        parts.append(Text(f"{one} and {other} cannot be told apart here (correlation {correlation:+.2f})."))
    if found.validation is not None:
        parts.append(_validation(found))
    if found.candidates:
        parts.append(_next(found))
    return Group(*parts)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if number == 0 else "right", overflow="fold")
    return table


def _coefficients(found: Identification) -> Table:
    known = sum(each.known for each in found.coefficients)
    title = (
        f"{found.vessel.name}: {known} of {len(found.coefficients)} coefficients known by {found.segments} "
        f"segments of {found.duration_s:.0f} s"
    )
    table = _table(title, "coefficient", "value", "95 % from", "to", "start", "")
    for each in found.coefficients:
        cells = [f"{number:.4g}" for number in (each.value, each.low, each.high, each.start)]
        said, style = ("", "") if each.known else ("not told", "dim")
        table.add_row(", ".join((each.name, *each.twins)), *cells, said, style=style)
    return table


def _validation(found: Identification) -> Table:
    judged = found.validation
    assert judged is not None
    title = f"left out: {judged.held_out}; {judged.windows} windows of {judged.horizon_s} s"
    table = _table(title, "method", "mean distance m", "at the end m", "heading deg")
    for name, each in judged.scores.items():
        figures = (f"{each.mean_distance_m:.3f}", f"{each.end_distance_m:.3f}", f"{each.heading_error_deg:.2f}")
        table.add_row(name, *figures)
    return table


def _next(found: Identification) -> Table:
    minutes = found.candidates[0].minutes
    table = _table(
        f"What {minutes:.0f} minutes more would tell", "manoeuvre", "nats", "variances left", "would become known"
    )
    for each in found.candidates[:_TRIALS]:
        newly = str(len(each.newly_known))
        table.add_row(each.manoeuvre, f"{each.gain:.1f}", f"{each.left:.0%}", newly)
    return table


def draw_identification(figure: Figure, found: Identification) -> None:
    """Left the segments as measured and as simulated, right each coefficient with its interval and the prior's."""
    left, right = figure.subplots(1, 2)
    measured, simulated = found.tracks
    for number, (one, other) in enumerate(zip(measured, simulated, strict=True)):
        left.plot(one[:, 1], one[:, 0], color=INK, linewidth=1.0, label="measured" if number == 0 else None)
        left.plot(other[:, 1], other[:, 0], color=_ORANGE, linewidth=1.0, label="model" if number == 0 else None)
    left.set_aspect("equal", adjustable="datalim")
    left.set_xlabel("east [m]")
    left.set_ylabel("north [m]")
    left.legend(loc="best")
    places = np.arange(len(found.coefficients))[::-1]
    for place, each in zip(places, found.coefficients, strict=True):
        width = _half_width(each)
        right.plot([-1.0, 1.0], [place, place], color=FAINT, linewidth=5.0, solid_capstyle="butt")
        shown = (np.array([each.low, each.value, each.high]) - each.start) / width
        right.plot(shown[[0, 2]], [place, place], color=_BLUE if each.known else INK, linewidth=1.5)
        right.plot(shown[1], place, "o", color=_BLUE if each.known else INK, markersize=3)
    right.set_yticks(places, [each.name for each in found.coefficients], fontsize=6)
    right.set_xlabel("departure from the start, in half widths of the prior's 95 % interval")


def _half_width(each: Estimate) -> float:
    return max(0.5 * (each.start_high - each.start_low), 1e-12)
