"""What was identified: as tables for a terminal, and as a picture of the fit and of each coefficient."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from seatrial.analysis.report.plots import FAINT, INK, PALETTE
from seatrial.hybrid.identification.identify import (
    CoefficientEstimate,
    Identification,
    Judgement,
    ManoeuvreInformation,
)
from seatrial.hybrid.report.plots import legend_above, named_rows
from seatrial.hybrid.report.text import text_table

_BLUE, _ORANGE = PALETTE[:2]
_TRIALS = 5
_MOST = 20  # coefficients in one picture


def identification_view(found: Identification) -> Group:
    """The coefficients, what hangs together, the validation, and what to do next."""
    parts: list[RenderableType] = [*(Text(f"left out: {each}") for each in found.set_aside), _coefficients(found)]
    for one, other, correlation in found.entangled:
        parts.append(Text(f"{one} and {other} cannot be distinguished here (correlation {correlation:+.2f})."))
    if found.validation is not None:
        parts.append(_validation(found.validation))
    if found.candidates:
        parts.append(_next(found.candidates))
    return Group(*parts)


def _coefficients(found: Identification) -> Table:
    known = sum(each.known for each in found.coefficients)
    title = (
        f"{found.vessel.name}: {known} of {len(found.coefficients)} coefficients determined by {found.segments} "
        f"segments of {found.duration_s:.0f} s"
    )
    columns = ("coefficient", "value", "95 % from", "to", "start", "")
    table = text_table(title, columns, (), wrap=True, pad_edge=False)
    for each in found.coefficients:
        cells = [f"{number:.3g}" for number in (each.value, each.low, each.high, each.start)]
        said, style = ("", "") if each.known else ("unknown", "dim")
        table.add_row("\n".join((each.name, *each.twins)), *cells, said, style=style)
    return table


def _validation(judged: Judgement) -> Table:
    title = f"left out: {judged.held_out}; {judged.windows} windows of {judged.horizon_s} s"
    rows = [
        [name, f"{each.mean_distance_m:.3f}", f"{each.end_distance_m:.3f}", f"{each.heading_error_deg:.2f}"]
        for name, each in judged.scores.items()
    ]
    columns = ("method", "mean distance m", "at the end m", "heading deg")
    return text_table(title, columns, rows, wrap=True, pad_edge=False)


def _next(candidates: Sequence[ManoeuvreInformation]) -> Table:
    title = f"What another {candidates[0].minutes:.0f} minutes would tell"
    rows = [
        [each.manoeuvre, f"{each.gain:.1f}", f"{each.left:.0%}", str(len(each.newly_known))]
        for each in candidates[:_TRIALS]
    ]
    columns = ("manoeuvre", "nats", "remaining variance", "newly determined")
    return text_table(title, columns, rows, wrap=True, pad_edge=False)


def draw_identification(figure: Figure, found: Identification) -> None:
    """Left the segments as measured and as simulated, right the coefficients that the data tell best, each with its
    interval and the prior's."""
    left, right = figure.subplots(1, 2)
    measured, simulated = found.tracks
    for number, (one, other) in enumerate(zip(measured, simulated, strict=True)):
        left.plot(one[:, 1], one[:, 0], color=INK, linewidth=2.0, label="measured" if number == 0 else None)
        left.plot(other[:, 1], other[:, 0], color=_ORANGE, linewidth=1.0, label="model" if number == 0 else None)
    left.set_aspect("equal", adjustable="datalim")
    left.set(xlabel="east [m]", ylabel="north [m]")
    legend_above(left, 2)
    shown = sorted(found.coefficients, key=lambda each: (each.high - each.low) / _half_width(each))[:_MOST]
    for place, each in enumerate(shown):
        right.plot([-1.0, 1.0], [place, place], color=FAINT, linewidth=5.0, solid_capstyle="butt")
        ends = (np.array([each.low, each.value, each.high]) - each.start) / _half_width(each)
        right.plot(ends[[0, 2]], [place, place], color=_BLUE if each.known else INK, linewidth=1.5)
        right.plot(ends[1], place, "o", color=_BLUE if each.known else INK, markersize=4)
    named_rows(right, [each.name for each in shown], fontsize=8)
    right.set_title(f"{len(shown)} of {len(found.coefficients)} coefficients, best known first", loc="left")
    right.set_xlabel("departure from the start, in half widths of the prior's 95 % interval [1]")


def _half_width(each: CoefficientEstimate) -> float:
    return max(0.5 * (each.start_high - each.start_low), 1e-12)
