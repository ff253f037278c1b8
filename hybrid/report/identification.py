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


def identification_view(identification: Identification) -> Group:
    """The coefficients, what hangs together, the validation, and what to do next."""
    parts: list[RenderableType] = [
        *(Text(f"left out: {part}") for part in identification.set_aside),
        _coefficients(identification),
    ]
    for first, second, correlation in identification.entangled:
        parts.append(Text(f"{first} and {second} cannot be distinguished here (correlation {correlation:+.2f})."))
    if identification.validation is not None:
        parts.append(_validation(identification.validation))
    if identification.candidates:
        parts.append(_next(identification.candidates))
    return Group(*parts)


def _coefficients(identification: Identification) -> Table:
    determined = sum(coefficient.known for coefficient in identification.coefficients)
    title = (
        f"{identification.vessel.name}: {determined} of {len(identification.coefficients)} coefficients determined "
        f"by {identification.segments} segments of {identification.duration_s:.0f} s"
    )
    columns = ("coefficient", "value", "95 % from", "to", "start", "")
    table = text_table(title, columns, (), wrap=True, pad_edge=False)
    for coefficient in identification.coefficients:
        cells = [
            f"{number:.3g}" for number in (coefficient.value, coefficient.low, coefficient.high, coefficient.start)
        ]
        remark, style = ("", "") if coefficient.known else ("unknown", "dim")
        table.add_row("\n".join((coefficient.name, *coefficient.tied)), *cells, remark, style=style)
    return table


def _validation(judged: Judgement) -> Table:
    title = f"left out: {judged.held_out}; {judged.windows} windows of {judged.horizon_s} s"
    rows = [
        [name, f"{errors.mean_distance_m:.3f}", f"{errors.end_distance_m:.3f}", f"{errors.heading_error_deg:.2f}"]
        for name, errors in judged.scores.items()
    ]
    columns = ("method", "mean distance m", "at the end m", "heading deg")
    return text_table(title, columns, rows, wrap=True, pad_edge=False)


def _next(candidates: Sequence[ManoeuvreInformation]) -> Table:
    title = f"What another {candidates[0].minutes:.0f} minutes would tell"
    rows = [
        [candidate.manoeuvre, f"{candidate.gain:.1f}", f"{candidate.left:.0%}", str(len(candidate.newly_known))]
        for candidate in candidates[:_TRIALS]
    ]
    columns = ("manoeuvre", "nats", "remaining variance", "newly determined")
    return text_table(title, columns, rows, wrap=True, pad_edge=False)


def draw_identification(figure: Figure, identification: Identification) -> None:
    """Left the segments as measured and as simulated, right the coefficients that the data tell best, each with its
    interval and the prior's."""
    tracks_axes, interval_axes = figure.subplots(1, 2)
    measured, simulated = identification.tracks
    for number, (measured_track, simulated_track) in enumerate(zip(measured, simulated, strict=True)):
        tracks_axes.plot(
            measured_track[:, 1],
            measured_track[:, 0],
            color=INK,
            linewidth=2.0,
            label="measured" if number == 0 else None,
        )
        tracks_axes.plot(
            simulated_track[:, 1],
            simulated_track[:, 0],
            color=_ORANGE,
            linewidth=1.0,
            label="model" if number == 0 else None,
        )
    tracks_axes.set_aspect("equal", adjustable="datalim")
    tracks_axes.set(xlabel="east [m]", ylabel="north [m]")
    legend_above(tracks_axes, 2)
    shown = sorted(
        identification.coefficients,
        key=lambda coefficient: (coefficient.high - coefficient.low) / _half_width(coefficient),
    )[:_MOST]
    for place, coefficient in enumerate(shown):
        interval_axes.plot([-1.0, 1.0], [place, place], color=FAINT, linewidth=5.0, solid_capstyle="butt")
        ends = (np.array([coefficient.low, coefficient.value, coefficient.high]) - coefficient.start) / _half_width(
            coefficient
        )
        interval_axes.plot(ends[[0, 2]], [place, place], color=_BLUE if coefficient.known else INK, linewidth=1.5)
        interval_axes.plot(ends[1], place, "o", color=_BLUE if coefficient.known else INK, markersize=4)
    named_rows(interval_axes, [coefficient.name for coefficient in shown], fontsize=8)
    interval_axes.set_title(
        f"{len(shown)} of {len(identification.coefficients)} coefficients, best known first", loc="left"
    )
    interval_axes.set_xlabel("departure from the start, in half widths of the prior's 95 % interval [1]")


def _half_width(coefficient: CoefficientEstimate) -> float:
    return max(0.5 * (coefficient.start_high - coefficient.start_low), 1e-12)
