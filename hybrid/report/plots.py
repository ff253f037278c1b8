"""Figures of predictions, in the house's style: functions draw values into axes.

With them what all of these share: a colour a method, the frame of a start, axes of errors.

What was identified: as tables for a terminal, and as a picture of the fit and of each coefficient.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from rich.console import Group, RenderableType
from rich.text import Text

from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.acquisition.core.result import terminal_table
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, label
from seatrial.hybrid.identification.identify import (
    Identification,
)
from seatrial.hybrid.prediction.baselines import Interval, outlines
from seatrial.hybrid.report.errors import QUANTITIES, ErrorComponents, errors_of
from seatrial.hybrid.report.text import plain

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators import TrainedCalibrator
    from seatrial.hybrid.calibrators.predict import Prediction
    from seatrial.hybrid.evaluation.validate import Validation


_ELLIPSES = 6  # of a track's regions; more would lie on each other
_LEAST = 1e-3  # a logarithmic axis begins here at the lowest: a millimetre, a thousandth
_TICKS = ((8.0, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)), (300.0, (1.0, 2.0, 5.0)), (np.inf, (1.0,)))

LESS_MORE = LinearSegmentedColormap.from_list("less_more", [PALETTE[0], "#FFFFFF", PALETTE[4]])
"""The colours of what the model lacks: from too little, blue, to too much, orange."""

COLOUR = {
    "straight_line": FAINT,
    "constant_velocity": PALETTE[3],
    "reference": PALETTE[4],
    "data_driven": PALETTE[2],
    "hybrid": PALETTE[0],
    "adaptive": PALETTE[0],  # the hybrid is one, unless another is trained
    "paper": PALETTE[5],
    "additive": PALETTE[1],
    "floor": INK,
}
"""One colour a method, in every figure."""

HALF_OF_95 = float(np.sqrt(np.log(0.5) / np.log(0.05)))
"""The size that holds half of the positions over the one that holds 95 %, where errors are normal (Rayleigh)."""

_LETTERS_ABREAST = 90  # of names below an axis of nine inches


def start_frame(track: Floats, start: Floats) -> Floats:
    """Starboard and ahead [..., H+1, 2] of tracks [..., H+1, 2 or 3] seen from their starts [..., 6], in metres."""
    north = track[..., 0] - start[..., 0, None]
    east = track[..., 1] - start[..., 1, None]
    ahead, starboard = to_ship(north, east, start[..., 2, None])
    return np.stack([starboard, ahead], axis=-1)


def interval_bar(axes: Axes, interval: Interval, row: float, colour: str, label: str = "") -> None:
    """A point with its interval, lying down."""
    axes.errorbar(
        interval.value, row, xerr=reach(interval)[:, None], fmt="o", color=colour, capsize=2.5, label=label
    )


def named_rows(axes: Axes, names: Sequence[str], **look: Any) -> None:
    """A row for each name from the top down."""
    axes.set_yticks(range(len(names)), names, **look)
    axes.set_ylim(len(names) - 0.4, -0.6)


def legend_above(axes: Axes, columns: int, **look: Any) -> None:
    """A legend in one line above the axes, to the right."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderpad=0.0, **look)


def reach(interval: Interval) -> Floats:
    """How far an interval reaches below and above its figure [2]: not at all where one leg cannot say."""
    ends = np.array([interval.value - interval.low, interval.high - interval.value])
    return np.asarray(np.maximum(np.nan_to_num(ends), 0.0))


def logarithmic(axes: Axes, name: Literal["x", "y"], intervals: Sequence[Interval]) -> None:
    """Half and double stand equally far from one; the ticks are numbers that people read."""
    ends = np.array([(interval.low, interval.value, interval.high) for interval in intervals])
    ends = ends[np.isfinite(ends) & (ends > _LEAST)]
    low, high = (0.85 * ends.min(), 1.18 * ends.max()) if ends.size else (_LEAST, 1.0)
    tens = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    bases = next(bases for reach, bases in _TICKS if high / low < reach)
    marks = [base * 10.0**power for power in tens for base in bases]
    inside = [mark for mark in marks if low <= mark <= high]
    axes.set(**{f"{name}scale": "log"})
    axis = axes.xaxis if name == "x" else axes.yaxis
    axis.set_ticks(inside, labels=[f"{mark:g}" for mark in inside])
    axis.set_ticks([], minor=True)
    axes.set(**{f"{name}lim": (low, high)})


def plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis as people write them: 0.5, 1, 2, 5."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def north_up(axes: Axes) -> None:
    """Axes of a track, to scale."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=label("east_m"), ylabel=label("north_m"))


def prediction_end(
    axes: Axes, measured: Floats | None, tracks: Mapping[str, Floats], region_m: Floats | None
) -> None:
    """The last metres of predicted tracks [H+1, 3] by method, and where the ship really was; north up.

    About the end of the first stand the ellipses of its region of semi-axes ``region_m`` [H, 2].
    """
    best, *_ = tracks
    shown = {} if measured is None else {"measured": (measured, INK)}
    shown |= {plain(name): (track, COLOUR.get(name, COLOUR["reference"])) for name, track in tracks.items()}
    points = [track[-1:, :2] for track, _ in shown.values()]
    if region_m is not None:
        border = outlines(tracks[best], region_m)[-1]
        points.append(border)
        middle, colour = tracks[best][-1, :2], shown[plain(best)][1]
        for share, alpha, words in ((1.0, 0.2, "95 % region"), (HALF_OF_95, 0.35, "50 % region")):
            north, east = (middle + share * (border - middle)).T
            axes.fill(east, north, color=colour, alpha=alpha, label=words)
    for name, (track, colour) in shown.items():
        axes.plot(track[:, 1], track[:, 0], color=colour, label=name)
        axes.plot(track[-1, 1], track[-1, 0], "o", color=colour, markersize=5)
    north_up(axes)
    axes.set_aspect("equal", adjustable="box")
    shown_points = np.concatenate(points)
    middle = 0.5 * (shown_points.max(axis=0) + shown_points.min(axis=0))
    reach_m = max(0.75 * float(np.ptp(shown_points, axis=0).max()), _LEAST)
    axes.set(xlim=(middle[1] - reach_m, middle[1] + reach_m), ylim=(middle[0] - reach_m, middle[0] + reach_m))
    axes.locator_params(nbins=4)


def fan_of_errors(axes: Axes, values: Floats, component: str, method: str) -> None:
    """How far predictions from many starts [N, H] spread, second by second: median, middle half and middle 90 %."""
    seconds = np.arange(1, values.shape[1] + 1)
    low, lower, middle, upper, high = np.nanquantile(values, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
    colour = COLOUR[method]
    axes.fill_between(seconds, low, high, color=colour, alpha=0.18, linewidth=0, label="middle 90 % of the windows")
    axes.fill_between(seconds, lower, upper, color=colour, alpha=0.35, linewidth=0, label="middle half")
    axes.plot(seconds, middle, color=colour, label="median")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(ylabel=f"error {QUANTITIES[component]}".replace(" [", "\n["), xlim=(0, seconds[-1]))


def errors_by_second(axes: Axes, errors: Mapping[str, ErrorComponents], quantity: str) -> None:
    """The size of the error that half, and dashed nine in ten, of the windows stay below, by second and method."""
    for method, components in errors.items():
        for share, style in ((0.5, "-"), (0.9, "--")):
            line = components.by_second(quantity, share)
            # the dashed ones are in the numbers, not in the legend
            words = plain(method) if share == 0.5 else f"_{plain(method)}, 90 %"
            axes.plot(np.arange(1, len(line) + 1), line, style, color=COLOUR[method], label=words)
    axes.set(xlabel="prediction time [s]", ylabel=QUANTITIES[quantity], xlim=(0, None))
    axes.set_yscale("log")  # errors grow from centimetres to metres, and methods are tens of times apart
    plain_numbers(axes.yaxis)


def box(axes: Axes, values: Floats, place: float, width: float, colour: str, alpha: float = 0.75) -> None:
    """A box that holds the middle half of ``values``, standing at ``place``; its whiskers reach to 5 and 95 %."""
    line = {"color": colour}
    axes.boxplot(
        [values], positions=[place], widths=width, whis=(5.0, 95.0), showfliers=False, patch_artist=True,
        boxprops={"facecolor": colour, "alpha": alpha, "edgecolor": colour}, whiskerprops=line, capprops=line,
        medianprops={"color": INK, "linewidth": 1.5},
    )  # fmt: skip


def error_spread(axes: Axes, by_trial: Mapping[str, Mapping[str, Floats]]) -> None:
    """The mean distance of each window [m], a group a trial and a box a method; whiskers hold 5 to 95 %."""
    methods = list(next(iter(by_trial.values())))
    for group, errors in enumerate(by_trial.values()):
        for number, method in enumerate(methods):
            place = group + (number - 0.5 * (len(methods) - 1)) * 0.8 / len(methods)
            box(axes, np.maximum(errors[method], 1e-3), place, 0.7 / len(methods), COLOUR[method])
    axes.set_yscale("log")
    names = [f"{name}\n{len(next(iter(errors.values())))} windows" for name, errors in by_trial.items()]
    crowded = sum(map(len, by_trial)) > _LETTERS_ABREAST
    axes.set_xticks(range(len(by_trial)), names)
    if crowded:
        axes.tick_params(axis="x", labelrotation=25, labelsize=7)
    plain_numbers(axes.yaxis)
    axes.set_ylabel("mean distance of a window [m]")
    handles = [Line2D([], [], color=COLOUR[method], linewidth=6, alpha=0.75, label=plain(method))
               for method in methods]  # fmt: skip
    legend_above(axes, len(handles), handles=handles)


def draw_validation(figure: Figure, validation: Validation) -> None:
    """Distance and heading error of every method by second: median, and dashed 90 %."""
    errors = {name: errors_of(track, validation.windows) for name, track in validation.tracks.items()}
    for axes, quantity in zip(figure.subplots(1, 2), ("distance", "heading"), strict=True):
        errors_by_second(axes, errors, quantity)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)


def draw_prediction(figure: Figure, prediction: Prediction) -> None:
    """The predicted track with some of its 95 % regions, and its end large; the measured one where it is known."""
    track_axes, end_axes = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    track, measured = prediction.track, prediction.measured
    region_m = None if prediction.region_m is None else prediction.region_m[1:]
    colour = COLOUR.get(prediction.method, COLOUR["reference"])
    if measured is not None:
        track_axes.plot(measured[:, 1], measured[:, 0], color=INK)
    if region_m is not None:
        stride = max(1, len(region_m) // _ELLIPSES)
        for border in outlines(track, region_m)[::-1][::stride]:
            track_axes.fill(border[:, 1], border[:, 0], facecolor=colour, alpha=0.2)
    track_axes.plot(track[:, 1], track[:, 0], color=colour)
    track_axes.plot(track[0, 1], track[0, 0], "o", color=INK, markersize=4)
    north_up(track_axes)
    track_axes.set_title(f"{len(track) - 1} s from {prediction.at:%H:%M:%S} UTC", loc="left")
    prediction_end(end_axes, measured, {prediction.method: track}, region_m)
    end_axes.set_title("the end, large", loc="left")
    figure.legend(*end_axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def draw_regions(figure: Figure, trained: TrainedCalibrator) -> None:
    """How far a calibrator's 95 % region reaches by second, for a relative uncertainty of one."""
    axes, seconds = figure.subplots(), np.arange(1, len(trained.region_m) + 1)
    for reach_m, line, words in zip(trained.region_m.T, ("-", "--"), ("along", "across"), strict=True):
        axes.plot(seconds, reach_m, line, color=COLOUR["hybrid"], label=f"{words} the course")
    axes.set(xlabel="prediction time [s]", ylabel="radius of the 95 % region [m]", xlim=(0, None), ylim=(0.0, None))
    axes.legend(loc="best")


_BLUE, _ORANGE = PALETTE[:2]
_TRIALS = 5
_MOST = 20  # coefficients in one picture


def identification_view(identification: Identification) -> Group:
    """The coefficients, what hangs together, the validation, and what to do next."""
    coefficients, judged = identification.coefficients, identification.validation
    title = (
        f"{identification.vessel.name}: {sum(coefficient.known for coefficient in coefficients)} of "
        f"{len(coefficients)} coefficients determined by {identification.segments} segments of "
        f"{identification.duration_s:.0f} s"
    )
    look: dict[str, Any] = {"wrap": True, "pad_edge": False}
    table = terminal_table(title, ("coefficient", "value", "95 % from", "to", "start", ""), (), **look)
    for coefficient in coefficients:
        cells = [
            f"{number:.3g}" for number in (coefficient.value, coefficient.low, coefficient.high, coefficient.start)
        ]
        remark, style = ("", "") if coefficient.known else ("unknown", "dim")
        table.add_row("\n".join((coefficient.name, *coefficient.tied)), *cells, remark, style=style)
    parts: list[RenderableType] = [*(Text(f"left out: {part}") for part in identification.set_aside), table]
    for first, second, correlation in identification.entangled:
        parts.append(Text(f"{first} and {second} cannot be distinguished here (correlation {correlation:+.2f})."))
    if judged is not None:
        title = f"left out: {judged.held_out}; {judged.windows} windows of {judged.horizon_s} s"
        rows = [
            [name, f"{errors.mean_distance_m:.3f}", f"{errors.end_distance_m:.3f}",
             f"{errors.heading_error_deg:.2f}"]
            for name, errors in judged.scores.items()
        ]  # fmt: skip
        heads = ("method", "mean distance m", "at the end m", "heading deg")
        parts.append(terminal_table(title, heads, rows, **look))
    if identification.candidates:
        title = f"What another {identification.candidates[0].minutes:.0f} minutes would tell"
        rows = [
            [candidate.manoeuvre, f"{candidate.gain:.1f}", f"{candidate.left:.0%}", str(len(candidate.newly_known))]
            for candidate in identification.candidates[:_TRIALS]
        ]
        heads = ("manoeuvre", "nats", "remaining variance", "newly determined")
        parts.append(terminal_table(title, heads, rows, **look))
    return Group(*parts)


def draw_identification(figure: Figure, identification: Identification) -> None:
    """Left the segments as measured and as simulated, right the coefficients that the data tell best, each with its
    interval and the prior's."""
    tracks_axes, interval_axes = figure.subplots(1, 2)
    for number, tracks in enumerate(zip(*identification.tracks, strict=True)):
        looks = ((INK, 2.0, "measured"), (_ORANGE, 1.0, "model"))
        for track, (colour, width, title) in zip(tracks, looks, strict=True):
            shown_title = title if number == 0 else None
            tracks_axes.plot(track[:, 1], track[:, 0], color=colour, linewidth=width, label=shown_title)
    tracks_axes.set_aspect("equal", adjustable="datalim")
    tracks_axes.set(xlabel="east [m]", ylabel="north [m]")
    legend_above(tracks_axes, 2)

    half_widths = {  # of the priors
        coefficient.name: max(0.5 * (coefficient.start_high - coefficient.start_low), 1e-12)
        for coefficient in identification.coefficients
    }
    shown = sorted(
        identification.coefficients,
        key=lambda coefficient: (coefficient.high - coefficient.low) / half_widths[coefficient.name],
    )[:_MOST]
    for place, coefficient in enumerate(shown):
        interval_axes.plot([-1.0, 1.0], [place, place], color=FAINT, linewidth=5.0, solid_capstyle="butt")
        ends = np.array([coefficient.low, coefficient.value, coefficient.high]) - coefficient.start
        ends = ends / half_widths[coefficient.name]
        colour = _BLUE if coefficient.known else INK
        interval_axes.plot(ends[[0, 2]], [place, place], color=colour, linewidth=1.5)
        interval_axes.plot(ends[1], place, "o", color=colour, markersize=4)
    named_rows(interval_axes, [coefficient.name for coefficient in shown], fontsize=8)
    interval_axes.set_title(
        f"{len(shown)} of {len(identification.coefficients)} coefficients, best known first", loc="left"
    )
    interval_axes.set_xlabel("departure from the start, in half widths of the prior's 95 % interval [1]")
