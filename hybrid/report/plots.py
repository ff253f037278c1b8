"""Figures of predictions, of a diagnosis and its map, and of what was identified: functions draw values into axes.

With them what all of these share: a colour a method, the frame of a start, axes of errors. What was identified is
also shown as tables for a terminal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import cycle, product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from rich.console import Group, RenderableType
from rich.text import Text

from seatrial.acquisition.core.quantities import Floats, rotate_earth_to_ship
from seatrial.acquisition.core.result import terminal_table
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, axis_label
from seatrial.analysis.report.tables import readable_names
from seatrial.hybrid.diagnosis import acceptance, result
from seatrial.hybrid.effects import FAMILIES
from seatrial.hybrid.identification.identify import Identification
from seatrial.hybrid.prediction.baselines import Interval, distances, region_outlines
from seatrial.hybrid.report.diagnosis import parameter_title, title_of
from seatrial.hybrid.report.prediction_errors import QUANTITIES, ErrorComponents, error_components
from seatrial.hybrid.report.text import (
    context_sentence,
    force_unit,
    plain,
    plain_number,
    predicted_index_view,
    quantity_title,
)

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


def rotate_to_start_frame(track: Floats, start: Floats) -> Floats:
    """Starboard and ahead [..., H+1, 2] of tracks [..., H+1, 2 or 3] seen from their starts [..., 6], in metres."""
    north = track[..., 0] - start[..., 0, None]
    east = track[..., 1] - start[..., 1, None]
    ahead, starboard = rotate_earth_to_ship(north, east, start[..., 2, None])
    return np.stack([starboard, ahead], axis=-1)


def draw_interval_bar(axes: Axes, interval: Interval, row: float, colour: str, label: str = "") -> None:
    """A point with its interval, lying down."""
    axes.errorbar(
        interval.value, row, xerr=interval_reach(interval)[:, None], fmt="o", color=colour, capsize=2.5, label=label
    )


def label_rows(axes: Axes, names: Sequence[str], **look: Any) -> None:
    """A row for each name from the top down."""
    axes.set_yticks(range(len(names)), names, **look)
    axes.set_ylim(len(names) - 0.4, -0.6)


def add_legend_above(axes: Axes, columns: int, **look: Any) -> None:
    """A legend in one line above the axes, to the right."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderpad=0.0, **look)


def interval_reach(interval: Interval) -> Floats:
    """How far an interval reaches below and above its figure [2]: not at all where one leg cannot say."""
    ends = np.array([interval.value - interval.low, interval.high - interval.value])
    return np.asarray(np.maximum(np.nan_to_num(ends), 0.0))


def set_logarithmic_axis(axes: Axes, name: Literal["x", "y"], intervals: Sequence[Interval]) -> None:
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


def label_ticks_in_plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis as people write them: 0.5, 1, 2, 5."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def set_north_up_axes(axes: Axes) -> None:
    """Axes of a track, to scale."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=axis_label("east_m"), ylabel=axis_label("north_m"))


def draw_prediction_end(
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
        border = region_outlines(tracks[best], region_m)[-1]
        points.append(border)
        middle, colour = tracks[best][-1, :2], shown[plain(best)][1]
        for share, alpha, words in ((1.0, 0.2, "95 % region"), (HALF_OF_95, 0.35, "50 % region")):
            north, east = (middle + share * (border - middle)).T
            axes.fill(east, north, color=colour, alpha=alpha, label=words)
    for name, (track, colour) in shown.items():
        axes.plot(track[:, 1], track[:, 0], color=colour, label=name)
        axes.plot(track[-1, 1], track[-1, 0], "o", color=colour, markersize=5)
    set_north_up_axes(axes)
    axes.set_aspect("equal", adjustable="box")
    shown_points = np.concatenate(points)
    middle = 0.5 * (shown_points.max(axis=0) + shown_points.min(axis=0))
    reach_m = max(0.75 * float(np.ptp(shown_points, axis=0).max()), _LEAST)
    axes.set(xlim=(middle[1] - reach_m, middle[1] + reach_m), ylim=(middle[0] - reach_m, middle[0] + reach_m))
    axes.locator_params(nbins=4)


def draw_error_fan(axes: Axes, values: Floats, component: str, method: str) -> None:
    """How far predictions from many starts [N, H] spread, second by second: median, middle half and middle 90 %."""
    seconds = np.arange(1, values.shape[1] + 1)
    low, lower, middle, upper, high = np.nanquantile(values, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
    colour = COLOUR[method]
    axes.fill_between(seconds, low, high, color=colour, alpha=0.18, linewidth=0, label="middle 90 % of the windows")
    axes.fill_between(seconds, lower, upper, color=colour, alpha=0.35, linewidth=0, label="middle half")
    axes.plot(seconds, middle, color=colour, label="median")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(ylabel=f"error {QUANTITIES[component]}".replace(" [", "\n["), xlim=(0, seconds[-1]))


def draw_error_quantiles_by_second(axes: Axes, errors: Mapping[str, ErrorComponents], quantity: str) -> None:
    """The size of the error that half, and dashed nine in ten, of the windows stay below, by second and method."""
    for method, components in errors.items():
        for share, style in ((0.5, "-"), (0.9, "--")):
            line = components.by_second(quantity, share)
            # the dashed ones are in the numbers, not in the legend
            words = plain(method) if share == 0.5 else f"_{plain(method)}, 90 %"
            axes.plot(np.arange(1, len(line) + 1), line, style, color=COLOUR[method], label=words)
    axes.set(xlabel="prediction time [s]", ylabel=QUANTITIES[quantity], xlim=(0, None))
    axes.set_yscale("log")  # errors grow from centimetres to metres, and methods are tens of times apart
    label_ticks_in_plain_numbers(axes.yaxis)


def draw_box(axes: Axes, values: Floats, place: float, width: float, colour: str, alpha: float = 0.75) -> None:
    """A box that holds the middle half of ``values``, standing at ``place``; its whiskers reach to 5 and 95 %."""
    line = {"color": colour}
    axes.boxplot(
        [values], positions=[place], widths=width, whis=(5.0, 95.0), showfliers=False, patch_artist=True,
        boxprops={"facecolor": colour, "alpha": alpha, "edgecolor": colour}, whiskerprops=line, capprops=line,
        medianprops={"color": INK, "linewidth": 1.5},
    )  # fmt: skip


def draw_error_spread(axes: Axes, by_trial: Mapping[str, Mapping[str, Floats]]) -> None:
    """The mean distance of each window [m], a group a trial and a box a method; whiskers hold 5 to 95 %."""
    methods = list(next(iter(by_trial.values())))
    for group, errors in enumerate(by_trial.values()):
        for number, method in enumerate(methods):
            place = group + (number - 0.5 * (len(methods) - 1)) * 0.8 / len(methods)
            draw_box(axes, np.maximum(errors[method], 1e-3), place, 0.7 / len(methods), COLOUR[method])
    axes.set_yscale("log")
    names = [f"{name}\n{len(next(iter(errors.values())))} windows" for name, errors in by_trial.items()]
    crowded = sum(map(len, by_trial)) > _LETTERS_ABREAST
    axes.set_xticks(range(len(by_trial)), names)
    if crowded:
        axes.tick_params(axis="x", labelrotation=25, labelsize=7)
    label_ticks_in_plain_numbers(axes.yaxis)
    axes.set_ylabel("mean distance of a window [m]")
    handles = [Line2D([], [], color=COLOUR[method], linewidth=6, alpha=0.75, label=plain(method))
               for method in methods]  # fmt: skip
    add_legend_above(axes, len(handles), handles=handles)


def draw_validation(figure: Figure, validation: Validation) -> None:
    """Distance and heading error of every method by second: median, and dashed 90 %."""
    errors = {name: error_components(track, validation.windows) for name, track in validation.tracks.items()}
    for axes, quantity in zip(figure.subplots(1, 2), ("distance", "heading"), strict=True):
        draw_error_quantiles_by_second(axes, errors, quantity)
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
        for border in region_outlines(track, region_m)[::-1][::stride]:
            track_axes.fill(border[:, 1], border[:, 0], facecolor=colour, alpha=0.2)
    track_axes.plot(track[:, 1], track[:, 0], color=colour)
    track_axes.plot(track[0, 1], track[0, 0], "o", color=INK, markersize=4)
    set_north_up_axes(track_axes)
    track_axes.set_title(f"{len(track) - 1} s from {prediction.at:%H:%M:%S} UTC", loc="left")
    draw_prediction_end(end_axes, measured, {prediction.method: track}, region_m)
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
            plain_number(number)
            for number in (coefficient.value, coefficient.low, coefficient.high, coefficient.start)
        ]
        remark, style = ("", "") if coefficient.known else ("unknown", "dim")
        table.add_row("\n".join((coefficient.name, *coefficient.tied)), *cells, remark, style=style)
    headline = identification.indices.headline
    parts: list[RenderableType] = [Text(readable_names(headline), style="bold")] if headline else []
    declared = context_sentence(identification.context)
    parts += [Text(declared)] if declared else []
    parts += [*(Text(f"left out: {part}") for part in identification.set_aside), table]
    for first, second, correlation in identification.inseparable_pairs:
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
    if tried := identification.segments_tried:
        errors_m = ", ".join(f"{trial.segment_s:.0f} s {trial.distance_m:.3g} m" for trial in tried)
        parts.append(Text(f"Length of the segments by the mean error of long held-out tracks: {errors_m}."))
    for gear in identification.gear:
        sizes = {"rate [deg/s]": gear.rate_dps, "lag [s]": gear.lag_s, "dead band [deg]": gear.dead_band_deg}
        words = (
            f"{name} {plain_number(size.value)} ({plain_number(size.low)} to {plain_number(size.high)})"
            for name, size in sizes.items()
        )
        residual = f"residual {gear.error_deg:.2g} deg"
        parts.append(Text(f"{gear.channel} follows its order: {', '.join(words)}; {residual}."))
    parts += predicted_index_view(identification.indices)
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
    add_legend_above(tracks_axes, 2)

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
    label_rows(interval_axes, [coefficient.name for coefficient in shown], fontsize=8)
    interval_axes.set_title(
        f"{len(shown)} of {len(identification.coefficients)} coefficients, best known first", loc="left"
    )
    interval_axes.set_xlabel("departure from the start, in half widths of the prior's 95 % interval [1]")


FAMILY_COLOUR = dict(zip(FAMILIES, PALETTE, strict=True))
"""One colour a family of effects, in every figure."""

BEFORE, AFTER, HELD = PALETTE[4], PALETTE[0], PALETTE[3]
_LINEAR = 10.0  # log evidence up to which the axis is linear: differences matter there, sizes beyond
_SHOWN = 15
_CONTROL_AXES = {"rpm": "shafts\n[rpm]", "deg": "angles\n[deg]", "percent": "pitch\n[%]"}

RESIDUAL_QUANTITIES = {
    "speed_mps": "speed [m/s]",
    "yaw_rate_dps": "yaw rate [deg/s]",
    "drift_angle_deg": "drift angle [deg]",
    "heading_deg": "heading [deg]",
    "relative_wind_deg": "relative wind direction [deg]",
    "rpm": "mean shaft speed [rpm]",
    "pitch_percent": "mean pitch [%]",
    "azimuth_deg": "mean azimuth angle [deg]",
    "rudder_deg": "mean rudder angle [deg]",
    "nozzle_deg": "mean nozzle angle [deg]",
    "time_s": "time [min]",
    "place": "position north, east [m]",
}
"""What the cells are of, for people."""

_MINUTE_S = 60.0
_FULL = 12.0  # standard errors at full colour
_SURE = 3.3  # standard errors beyond which a force is printed dark
_ROW_INCH, _EDGE_INCH = 0.19, 0.7
Rows = list[tuple[str, list[result.GapCell]]]


def make_overview_figure(diagnosis: result.Diagnosis) -> Figure:
    """The parameters that were named, where there are any, and below them the gap, before and after."""
    rows = sum(len(effect.parameters) for effect in diagnosis.effects)
    heights = [0.35 + 0.75 * rows, 1.0 + 0.34 * (3 + len(diagnosis.effects))][0 if rows else 1 :]
    figure = Figure(figsize=(8.0, sum(heights)), layout="constrained")
    places = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    if rows:
        draw_effect_parameters(places[0], diagnosis.effects)
    draw_gap(places[-1].subplots(), diagnosis)
    return figure


def draw_evidence_ranking(axes: Axes, ranking: Sequence[result.RankedEffect], named: Sequence[str]) -> None:
    """The likeliest effects by the log evidence of each alone, a colour a family; what was named has an edge."""
    shown = list(ranking)[:_SHOWN]
    colours = [FAMILY_COLOUR.get(ranked.family, FAINT) for ranked in shown]
    edges = [INK if ranked.name in named else "none" for ranked in shown]
    axes.barh(
        range(len(shown)), [ranked.evidence for ranked in shown], color=colours, edgecolor=edges, linewidth=1.6
    )
    axes.axvline(0.0, color=INK, linewidth=1.0)
    label_rows(axes, [plain(ranked.name) for ranked in shown])
    axes.set_xscale("symlog", linthresh=_LINEAR, linscale=0.6)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\u2212")))
    axes.set_xlabel("log odds for the model with this effect alone [nat]; above 0 it is better")
    families = [family for family in FAMILIES if any(ranked.family == family for ranked in shown)]
    handles = [Patch(color=FAMILY_COLOUR[family], label=family) for family in families]
    add_legend_above(axes, len(handles), handles=handles)
    axes.grid(visible=False, axis="y")


def draw_effect_parameters(figure: FigureBase, effects: Sequence[result.NamedEffect]) -> None:
    """Every parameter of the named effects with its 95 % interval, each on an axis of its own from zero or one."""
    entries = [(effect, name, estimate) for effect in effects for name, estimate in effect.parameters.items()]
    rows = figure.subplots(len(entries), 1, squeeze=False)[:, 0]
    for axes, (effect, name, estimate) in zip(rows, entries, strict=True):
        value, low, high = estimate.value, estimate.low, estimate.high
        colour, ends = FAMILY_COLOUR.get(effect.family, INK), np.maximum([[value - low], [high - value]], 0.0)
        axes.errorbar(value, 0.0, xerr=ends, fmt="o", color=colour, capsize=4, markersize=6)
        if estimate.unit != "deg" or low <= 0.0 <= high or abs(value) < 30.0:  # a direction has no neutral value
            axes.axvline(1.0 if name.endswith("factor") else 0.0, color=INK, linewidth=1.0)
        axes.margins(x=0.15)
        axes.set_ylim(-1.0, 1.0)
        axes.locator_params(axis="x", nbins=7)
        axes.grid(visible=False, axis="y")
        title = parameter_title(name, estimate.unit) + ("" if estimate.unit == "1" else f" [{estimate.unit}]")
        axes.set_yticks([0.0], [f"{title_of(effect)}\n{title}"])


def draw_rivals(axes: Axes, rivals: Sequence[result.Rival]) -> None:
    """The log evidence that each rival lacks; left of the line it and the named effect are indistinguishable."""
    shown = sorted(rivals, key=lambda rival: (rival.instead_of, rival.evidence))[:_SHOWN]
    colours = [PALETTE[1] if rival.evidence < acceptance.CLOSE else PALETTE[0] for rival in shown]
    axes.barh(range(len(shown)), [max(rival.evidence, 0.02) for rival in shown], color=colours, height=0.6)
    axes.axvline(acceptance.CLOSE, color=INK, linewidth=1.0)
    labels = [f"{plain(rival.name)}\nfor {plain(rival.instead_of)}" for rival in shown]
    label_rows(axes, labels, fontsize=8)
    axes.set_xlim(0.0, max(1.05 * max(rival.evidence for rival in shown), 1.4 * acceptance.CLOSE))
    axes.set_xlabel("log evidence below that of the named effect [nat]")
    words = {"cannot be distinguished": PALETTE[1], "less likely": PALETTE[0]}
    add_legend_above(axes, 2, handles=[Patch(color=colour, label=label) for label, colour in words.items()])
    axes.grid(visible=False, axis="y")


def draw_gap(axes: Axes, diagnosis: result.Diagnosis) -> None:
    """The mean distance before, its reduction by each effect, after, with regimes, the floor, constant velocity.

    Where nothing is named, that of the model stands in the place of before and after.
    """
    gap, named = diagnosis.gap, bool(diagnosis.effects)
    rows, level = [("before" if named else "model", 0.0, gap.before_m, INK)], gap.before_m
    for effect in {part.name: part for part in diagnosis.effects}.values():
        fall = effect.share_of_gap * (gap.before_m - gap.floor_m)
        level -= fall
        rows.append((plain(effect.name), level, fall, FAMILY_COLOUR.get(effect.family, FAINT)))
    rows += [
        *([("after", 0.0, gap.after_m, INK)] if named else []),
        *((plain(regime.name), 0.0, regime.after_m, FAINT) for regime in diagnosis.regimes),
        *([("floor", 0.0, gap.floor_m, FAINT)] if gap.floor_m < gap.before_m else []),
        ("constant velocity", 0.0, gap.constant_velocity_m, FAINT),
    ]
    names, starts, widths, colours = zip(*rows, strict=True)
    axes.barh(range(len(names)), widths, left=starts, color=colours, height=0.65)
    for row, (start, width) in enumerate(zip(starts, widths, strict=True)):
        sign = "" if start == 0.0 or width == 0.0 else "\u2212"
        axes.text(start + max(width, 0.0), row, f"  {sign}{abs(width):.2f} m", va="center", fontsize=8, color=INK)
    label_rows(axes, names)
    axes.set_xlim(0.0, 1.18 * max(*widths, 1e-6))
    axes.set_xlabel(f"mean distance over {gap.horizon_s} s, held-out windows [m]")
    axes.grid(visible=False, axis="y")


def draw_calibrator_comparison(axes: Axes, distances_m: Mapping[str, Interval]) -> None:
    """The mean distance of each model by its title, with its 95 % interval."""
    for row, interval in enumerate(distances_m.values()):
        draw_interval_bar(axes, interval, row, PALETTE[0])
    label_rows(axes, list(distances_m))
    set_logarithmic_axis(axes, "x", list(distances_m.values()))
    axes.set_xlabel("mean distance [m]")


def draw_mean_error_by_second(axes: Axes, tracks: result.Tracks, named: bool = True, is_known: bool = True) -> None:
    """The mean distance from what was measured against the second of the prediction, all of it known.

    What is closed lies between before and after. Where the named effects are all that is missing (``is_known``),
    the model with their sizes fitted to all legs is drawn, too.
    """
    fitted = [("fitted to all legs", tracks.floor, INK)] if is_known and named else []
    shown = [*_predictions_to_draw(tracks, named), *fitted]
    for name, track, colour in shown:
        mean = distances(track, tracks.measured).mean(axis=0)
        style = ":" if track is tracks.floor else "-"  # dotted: it lies on after where all is closed
        axes.plot(np.arange(1, len(mean) + 1), mean, style, color=colour, label=name)
    axes.set_yscale("log")
    label_ticks_in_plain_numbers(axes.yaxis)
    axes.set(xlim=(0, tracks.measured.shape[1] - 1), xlabel="prediction time [s]", ylabel="mean distance [m]")
    add_legend_above(axes, len(shown))


def draw_window_tracks(figure: Figure, tracks: result.Tracks, named: bool = True) -> None:
    """Some held-out windows in which all is known, bow up and to scale, and what the actuators did in them."""
    chosen, units = representative_windows(tracks, named), control_channels_by_unit(tracks)
    rows = figure.subplots(1 + len(units), len(chosen), squeeze=False, height_ratios=[3.0, *[1.0] * len(units)])
    for axes, (title, number) in zip(rows[0], chosen.items(), strict=True):
        off_m = []
        for name, track, colour in [("measured", tracks.measured, INK), *_predictions_to_draw(tracks, named)]:
            path = rotate_to_start_frame(track[number], tracks.before[number, 0])
            style = "-" if name == "measured" else "--"
            axes.plot(path[:, 0], path[:, 1], style, color=colour, label=name)
            if name not in ("measured", "constant velocity"):
                off_m.append(f"{distances(track, tracks.measured)[number].mean():.2g} m")
        axes.set_aspect("equal", adjustable="datalim")
        axes.locator_params(nbins=4)
        axes.set_xlabel("starboard [m]")
        axes.set_title(f"{title}\nleg {int(tracks.leg[number]) + 1}: {' to '.join(off_m)}", fontsize=8.5)
    rows[0, 0].set_ylabel("ahead [m]")
    figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    for (unit, names), row in zip(units.items(), rows[1:], strict=True):
        for axes, number in zip(row, chosen.values(), strict=True):
            for name, style in zip(names, cycle(("-", "--", ":"))):
                label = plain(name.rpartition("_")[0])
                axes.plot(tracks.controls[name][number], style, color=INK, label=label, linewidth=1.2)
            axes.locator_params(nbins=4)
            axes.sharey(row[0])
        row[0].set_ylabel(_CONTROL_AXES.get(unit, f"[{unit}]"))
        row[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    for axes in rows[-1] if units else ():
        axes.set_xlabel("time [s]")


def control_channels_by_unit(tracks: result.Tracks) -> dict[str, list[str]]:
    """The channels of the actuators by their unit, with which their names end."""
    units: dict[str, list[str]] = {}
    for name in tracks.controls:
        units.setdefault(name.rpartition("_")[2], []).append(name)
    return units


def representative_windows(tracks: result.Tracks, named: bool = True) -> dict[str, int]:
    """The window in which the model was the worst, an ordinary one, the one that gained most, the worst now.

    One that is several of these stands once, under all its titles; where nothing was named there are the first two.
    """
    before_m, after_m = (distances(track, tracks.measured).mean(axis=1) for track in (tracks.before, tracks.after))
    worst, median = int(np.argmax(before_m)), int(np.argsort(before_m, kind="stable")[len(before_m) // 2])
    chosen = {"worst": worst, "median": median}
    if named:
        gained, still_worst = int(np.argmax(before_m - after_m)), int(np.argmax(after_m))
        chosen = {
            "worst before": worst,
            "median before": median,
            "improved most": gained,
            "worst after": still_worst,
        }
    titles = {number: [title for title, window in chosen.items() if window == number] for number in chosen.values()}
    return {", ".join(names): number for number, names in titles.items()}


def complete_windows(tracks: result.Tracks) -> result.Tracks:
    """The windows in which all tracks are complete."""
    arrays = {
        attribute.name: getattr(tracks, attribute.name)
        for attribute in fields(result.Tracks)
        if attribute.name != "controls"
    }
    complete = np.all(
        [np.isfinite(array).all(axis=tuple(range(1, array.ndim))) for array in arrays.values()], axis=0
    )
    controls = {name: values[complete] for name, values in tracks.controls.items()}
    return result.Tracks(**{name: array[complete] for name, array in arrays.items()}, controls=controls)


def _predictions_to_draw(tracks: result.Tracks, named: bool) -> list[tuple[str, Floats, str]]:
    held = ("constant velocity", tracks.constant_velocity, HELD)
    if not named:
        return [("model", tracks.before, BEFORE), held]
    return [("before", tracks.before, BEFORE), ("after", tracks.after, AFTER), held]


def axis_title(name: str) -> str:
    """What a cell is of, for people; the shafts of a ship's actuators by their names."""
    if name in RESIDUAL_QUANTITIES:
        return RESIDUAL_QUANTITIES[name]
    if name.endswith("_rpm") and "_less_" not in name:
        return f"{name.removesuffix('_rpm').replace('_', ' ')} thruster [rpm]"
    return quantity_title(name)


def force_titles(unit: str) -> tuple[str, str, str]:
    """The axes' forces, with their unit.

    >>> force_titles("kN")
    ('surge [kN]', 'sway [kN]', 'yaw [kN m]')
    """
    return f"surge [{unit}]", f"sway [{unit}]", f"yaw [{unit} m]"


def _force_unit_of_cells(places: Sequence[result.GapCell]) -> tuple[float, str]:
    return force_unit(max((abs(place.error) for place in places if place.channel in result.FORCES), default=0.0))


def map_height_inch(places: Sequence[result.GapCell]) -> float:
    """A height at which the rows of :func:`draw_force_map` stand clear of each other."""
    return _EDGE_INCH + _ROW_INCH * max(map(len, _cell_columns(places)))


def draw_force_map(figure: Figure, places: Sequence[result.GapCell]) -> None:
    """The steady force that the model lacks in each cell, by axis: colour says how sure, the number how much."""
    columns, (size_n, unit) = _cell_columns(places), _force_unit_of_cells(places)
    for axes, rows in zip(figure.subplots(1, 2, squeeze=False)[0], columns, strict=True):
        if not rows:
            axes.set_axis_off()
            continue
        z = np.array([[cell.z for cell in forces] or [np.nan] * 3 for _, forces in rows])
        axes.imshow(z, cmap=LESS_MORE, vmin=-_FULL, vmax=_FULL, aspect="auto")
        for row, (name, forces) in enumerate(rows):
            for column, cell in enumerate(forces):
                dark = abs(cell.z) > _SURE
                bright = abs(cell.z) > 0.75 * _FULL and dark
                colour = "white" if bright else INK if dark else "#9A9A9A"
                text = _force_text(cell.error / size_n)
                axes.text(column, row, text, ha="center", va="center", fontsize=7.5, color=colour)
            if not forces:
                axes.text(-0.62, row, name, ha="right", va="center", fontsize=8, weight="bold", color=INK)
        axes.set_yticks(range(len(rows)), [name if forces else "" for name, forces in rows], fontsize=7.5)
        axes.set_xticks(range(3), force_titles(unit))
        axes.tick_params(length=0, labeltop=True, labelbottom=False)
        axes.spines[:].set_visible(False)
        axes.grid(visible=False)
        axes.set_ylim(max(map(len, columns)) - 0.5, -0.5)  # rows of one height on both sides


def map_sentences(places: Sequence[result.GapCell]) -> list[str]:
    """A sentence on each force with a significant cell: the most significant one."""
    sentences = []
    size_n, unit = _force_unit_of_cells(places)
    for channel, title in zip(result.FORCES, force_titles(unit), strict=True):
        notable = [place for place in places if place.channel == channel and abs(place.z) > _SURE]
        if not notable:
            continue
        surest = max(notable, key=lambda place: abs(place.z))
        words, unit = title.rstrip("]").split(" [")
        force = f"missing {words} {'moment' if words == 'yaw' else 'force'}"
        quantity, _, cell_unit = axis_title(quantity_of(surest)).rstrip("]").partition(" [")
        half = 1.96 * abs(surest.error / surest.z)
        ends = (surest.error - half, surest.error, surest.error + half)
        low, value, high = (_force_text(end / size_n) for end in ends)
        sentences.append(f"By {quantity}, the {force} at {cell_name(surest)} {cell_unit} is {value} {unit} "
                         f"(95 % interval {low} to {high}).")  # fmt: skip
    return sentences


def draw_residual_force(axes: Axes, force_map: result.Map, channel: str, quantity: str) -> None:
    """The slow force that the model lacks against a quantity: seconds in grey, cells with 95 % intervals."""
    axis = result.FORCES.index(channel)
    scale = _MINUTE_S if quantity == "time_s" else 1.0
    size_n, unit = _force_unit_of_cells(force_map.places)
    seconds, force = force_map.quantities[quantity] / scale, force_map.force[:, axis] / size_n
    axes.plot(seconds, force, ".", color=FAINT, markersize=2, label="reconstructed, each second")
    cells = [place for place in force_map.places if place.channel == channel and quantity in place.cell]
    cells = sorted(cells, key=lambda cell: cell.cell[quantity])
    middle = np.array([np.mean(cell.cell[quantity]) for cell in cells]) / scale
    if quantity in ("heading_deg", "relative_wind_deg"):
        middle = middle % 360.0
    error = np.array([cell.error for cell in cells]) / size_n
    reach = 1.96 * np.abs(error / np.array([cell.z or 1.0 for cell in cells]))
    axes.errorbar(middle, error, yerr=reach, fmt="o", color=PALETTE[0], capsize=3, label="mean of a cell")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=axis_title(quantity), ylabel="missing force: " + force_titles(unit)[axis])
    add_legend_above(axes, 2)


def clearest_force_and_quantity(force_map: result.Map) -> tuple[str, str] | None:
    """The force and the quantity whose cells differ most, relative to their errors; None without cells."""
    scores = dict[tuple[str, str], float]()
    for pair in product(result.FORCES, force_map.quantities):
        cells = [place for place in force_map.places if (place.channel, *place.cell) == pair]
        z, error = np.array([cell.z for cell in cells]), np.array([cell.error for cell in cells])
        if len(cells) > 1:
            weight = (z / np.where(error == 0.0, 1.0, error)) ** 2
            deviation = error - np.average(error, weights=weight + 1e-30)
            scores[pair] = float((weight * deviation**2).sum() / (len(z) - 1))
    return max(scores, key=lambda pair: (scores[pair], pair), default=None)


def cell_name(place: result.GapCell) -> str:
    """A cell's span for people, without its unit: degrees and times to whole numbers."""
    if "north_m" in place.cell:
        north, east = (np.mean(place.cell[name]) for name in ("north_m", "east_m"))
        return f"{_number_text(float(north), 0)}, {_number_text(float(east), 0)}"
    ((quantity, (low, high)),) = place.cell.items()
    if quantity in ("heading_deg", "relative_wind_deg"):
        return f"{0.5 * (low + high):.0f} ± {0.5 * (high - low):.0f}"
    scale = _MINUTE_S if quantity == "time_s" else 1.0
    digits = 1 if max(abs(low), abs(high)) / scale >= 5.0 else 2
    return f"{_number_text(low / scale, digits)} to {_number_text(high / scale, digits)}"


def quantity_of(place: result.GapCell) -> str:
    """What a cell is of, as in :data:`QUANTITIES`."""
    return "place" if "north_m" in place.cell else next(iter(place.cell))


def _number_text(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", "\u2212") if text != "-0" else "0"


def _cell_columns(places: Sequence[result.GapCell]) -> tuple[Rows, Rows]:
    """A row a cell, by quantity in the order of the titles: its name, its three forces; in two columns of about one
    height, parted between two quantities.

    Differences of shaft speeds come after their mean, tunnel thrusters after the angles.
    """
    rows: Rows = []
    extra = [name for name in dict.fromkeys(map(quantity_of, places)) if name not in RESIDUAL_QUANTITIES]
    following = {"rpm": [name for name in extra if "_less_" in name]}
    following["nozzle_deg"] = [name for name in extra if name not in following["rpm"]]
    for quantity in (name for title in RESIDUAL_QUANTITIES for name in (title, *following.get(title, ()))):
        cells = [place for place in places if place.channel in result.FORCES and quantity_of(place) == quantity]
        spans = sorted({tuple(cell.cell.values()) for cell in cells})
        if spans:
            rows.append((axis_title(quantity), []))
        for span in spans:
            row = {cell.channel: cell for cell in cells if tuple(cell.cell.values()) == span}
            rows.append((cell_name(next(iter(row.values()))), [row[channel] for channel in result.FORCES]))
    begins = [number for number, (_, forces) in enumerate(rows) if not forces] or [0]
    cut = min([*begins[1:], len(rows)], key=lambda begin: abs(begin - len(rows) / 2))
    return rows[:cut], rows[cut:]


def _force_text(value: float) -> str:
    size = abs(value)
    return _number_text(value, 0 if size >= 20.0 else 1 if size >= 0.95 else 2)
