"""``seatrial reproduce figures``: figures 4 to 7, 9 and 10 of the paper, from scratch and in our own style.

Every figure is a function that fills a matplotlib figure; :data:`FIGURES` names them with their sizes and captions.
The panels before them draw data into axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.report.pages import ENDINGS, fill_figure, write_figure
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, channels_figure
from seatrial.hybrid.prediction.baselines import region_outlines
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.report.plots import COLOUR, draw_box, label_ticks_in_plain_numbers, rotate_to_start_frame
from seatrial.hybrid.report.text import plain
from seatrial.notebooks.wang2021.campaign import AZIMUTHS_DEG, BEFORE_S, SeaResults, example_sequence

AZIMUTH_COLOUR = {10.0: PALETTE[0], 20.0: PALETTE[2], 30.0: PALETTE[4]}
SPLIT_LOOK = {"sequence": (-0.19, 0.85, "sequences never seen"), "random": (0.19, 0.25, "the random split")}
SPREAD = ("reference", "data_driven", "paper", "additive", "hybrid")
FAN, TRACKS = 12, 20
WRITTEN = ("png", *ENDINGS)

Seas = Sequence[SeaResults]
"""The sea states shown, in their order, one campaign each."""


def campaign_tracks(axes: Axes, windows: PredictionWindows, azimuth_deg: Floats) -> None:
    """Where the sequences lie, one colour an azimuth, with the minute before each in grey; north up."""
    for past in windows.past:
        axes.plot(past[:, 1] / 1e3, past[:, 0] / 1e3, color=FAINT, linewidth=0.8)
    for angle, colour in AZIMUTH_COLOUR.items():
        for place, number in enumerate(np.flatnonzero(np.abs(azimuth_deg) == angle)):
            track, label = windows.track[number] / 1e3, None if place else f"{angle:g}°"
            axes.plot(track[:, 1], track[:, 0], color=colour, linewidth=2.0, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east [km]", ylabel="north [km]")


def fans(axes: Axes, windows: PredictionWindows, predicted: Floats, method: str) -> None:
    """Measured and predicted tracks [N, H+1, 3] of several sequences from one start, bow up and to scale."""
    measured, tracks = (rotate_to_start_frame(frames, windows.start) for frames in (windows.track, predicted))
    for number, (ours, theirs) in enumerate(zip(measured, tracks, strict=True)):
        first = number == 0
        axes.plot(ours[:, 0], ours[:, 1], color=INK, label="measured" if first else None)
        label = plain(method) if first else None
        axes.plot(theirs[:, 0], theirs[:, 1], "--", color=COLOUR[method], label=label)
    _bow_up(axes, "box")


def error_over_time(axes: Axes, gaps_m: Mapping[str, Floats]) -> None:
    """Mean size of one coordinate's error [N, H] by method against time; the shade holds the middle 80 %."""
    for method, gap_m in gaps_m.items():
        seconds, size = np.arange(1, gap_m.shape[1] + 1), np.abs(gap_m)
        low, high = np.quantile(size, [0.1, 0.9], axis=0)
        axes.fill_between(seconds, low, high, color=COLOUR[method], alpha=0.22, linewidth=0)
        axes.plot(seconds, size.mean(axis=0), color=COLOUR[method], label=plain(method))
    axes.set_xlim(0, seconds[-1])
    axes.set_ylim(bottom=0)


def track_with_end(
    axes: Axes, measured: Floats, predicted: Mapping[str, Floats], border: Floats, around_m: float
) -> None:
    """One sequence [H+1, 2] in the start frame, and its end enlarged: a square of ``around_m`` each way.

    ``border`` [K, 2] is that of the region about the end that the last method predicts.
    """
    right = measured[-1, 0] >= 0.0
    ends = axes.inset_axes((0.03, 0.2, 0.42, 0.42) if right else (0.55, 0.2, 0.42, 0.42))
    for panel, wide in ((axes, 1.3), (ends, 1.6)):
        panel.plot(*measured.T, color=INK, linewidth=wide, label="measured")
        for method, track in predicted.items():
            panel.plot(*track.T, "--", color=COLOUR[method], linewidth=wide, label=plain(method))
    ends.plot(*measured[-1], "o", color=INK, markersize=4)
    ends.fill(*border.T, color=COLOUR[list(predicted)[-1]], alpha=0.25, linewidth=0)
    for method, track in predicted.items():
        ends.plot(*track[-1], "o", color=COLOUR[method], markersize=4)
    low, high = measured[-1, :2] - around_m, measured[-1, :2] + around_m
    ends.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])
    ends.grid(visible=False)
    ends.spines[["top", "right"]].set_visible(True)
    ends.set_title(f"end, {2 * around_m:g} m wide", fontsize=7, pad=2)
    aside_m = 1.1 * max(float(np.abs(track[:, 0]).max()) for track in (measured, *predicted.values()))
    # the start in the middle, so that one half is free for the end
    axes.update_datalim([(-aside_m, 0.0), (aside_m, 0.0)])
    axes.autoscale_view()
    _bow_up(axes, "datalim")


def _bow_up(axes: Axes, adjustable: Literal["box", "datalim"]) -> None:
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set(xlabel="to starboard [m]", ylabel="ahead [m]")


def error_spread(axes: Axes, errors_m: Mapping[tuple[str, str], Floats], methods: Sequence[str]) -> None:
    """Mean distance per sequence by method as boxes, the two splits side by side, on a logarithmic axis.

    ``errors_m`` has the errors [n] by method and split. Whiskers reach to the 5th and 95th of 100.
    """
    for place, method in enumerate(methods):
        for split, (shift, alpha, _) in SPLIT_LOOK.items():
            values = errors_m[method, split]
            draw_box(axes, values[np.isfinite(values)], place + shift, 0.32, COLOUR[method], alpha)
    axes.set_yscale("log")
    label_ticks_in_plain_numbers(axes.yaxis)
    axes.set_xticks(range(len(methods)), [plain(method).replace(" ", "\n") for method in methods], fontsize=7.5)
    axes.grid(visible=False, axis="x")


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """How a figure is drawn, how large it is, what is written below it, and what to look for in it."""

    draw: Callable[[Figure, Seas], None]
    size_inch: tuple[float, float]
    caption: str
    look_for: str

    def filled(self, seas: Seas) -> Figure:
        """The figure of these sea states."""
        return fill_figure(lambda empty: self.draw(empty, seas), self.size_inch)


def write_figures(seas: Seas, folder: Path) -> list[Path]:
    """Every figure in ``folder`` as PNG, SVG and PDF, its numbers as JSON, and where each is.

    Raises :class:`StorageError`.
    """
    return [
        path
        for name, figure in FIGURES.items()
        for path in write_figure(figure.filled(seas), folder, name, WRITTEN)
    ]


def draw_tracks(figure: Figure, seas: Seas) -> None:
    """Figure 4."""
    panels = figure.subplots(1, len(seas), squeeze=False)[0]
    for axes, sea in zip(panels, seas, strict=True):
        first = np.arange(min(TRACKS, len(sea.campaign)))
        campaign_tracks(axes, sea.campaign.windows.subset(first), sea.campaign.azimuth_deg[first])
        text = f"{sea.job.sea_state}: {len(first)} of {len(sea.campaign)} sequences"
        axes.set_title(text, loc="left")
    past = Line2D([], [], color=FAINT, label=f"{BEFORE_S} s before")
    handles = [*panels[0].get_legend_handles_labels()[0], past]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, title="azimuth of the zigzag")


def draw_channels(figure: Figure, seas: Seas) -> None:
    """Figure 5."""
    drawing = channels_figure(example_sequence(seas[-1].job))
    if drawing is not None:
        drawing[0](figure)
    figure.suptitle(f"One sequence in the {seas[-1].job.sea_state} sea, as it is recorded", x=0.01, ha="left")


def draw_fans(figure: Figure, seas: Seas) -> None:
    """Figure 6."""
    panels = figure.subplots(1, len(seas), squeeze=False, sharex=True, sharey=True)[0]
    for axes, sea in zip(panels, seas, strict=True):
        azimuth_deg = sea.campaign.azimuth_deg
        orders = np.unique(azimuth_deg)  # the first few windows of each, some FAN in all
        number = max(1, FAN // len(orders))
        chosen = np.concatenate([np.flatnonzero(azimuth_deg == order)[:number] for order in orders])
        fans(axes, sea.campaign.windows.subset(chosen), sea.reference[chosen], "reference")
        error_m = float(np.hypot(*(sea.errors["sequence"]["reference"].gap_m.transpose(2, 0, 1))).mean())
        axes.set_title(f"{sea.job.sea_state}: {error_m:.2f} m on average", loc="left")
        axes.label_outer()
    figure.legend(handles=panels[0].get_legend_handles_labels()[0], loc="outside lower center", ncols=2)


def draw_errors(figure: Figure, seas: Seas) -> None:
    """Figure 7."""
    grid = figure.subplots(2, len(seas), sharex=True, squeeze=False)
    for column, sea in enumerate(seas):
        for row, coordinate in enumerate(("north", "east")):
            gaps = {method: sea.errors["sequence"][method].gap_m[..., row] for method in ("reference", "hybrid")}
            error_over_time(grid[row, column], gaps)
            if column == 0:
                grid[row, column].set_ylabel(f"error {coordinate} [m]")
        grid[0, column].set_title(sea.job.sea_state, loc="left")
        grid[1, column].set_xlabel("prediction time [s]")
    figure.legend(handles=grid[0, 0].get_legend_handles_labels()[0], loc="outside lower center", ncols=2)


def draw_predictions(figure: Figure, seas: Seas) -> None:
    """Figure 9."""
    grid = figure.subplots(len(seas), len(AZIMUTHS_DEG), squeeze=False)
    for row, sea in zip(grid, seas, strict=True):
        azimuth_deg = np.abs(sea.campaign.azimuth_deg[sea.unseen])
        for axes, angle in zip(row, AZIMUTHS_DEG, strict=True):
            numbers = np.flatnonzero(azimuth_deg == angle)
            if not numbers.size:
                axes.set_axis_off()
                continue
            _one_prediction(axes, sea, int(numbers[0]))
            axes.set_title(f"{sea.job.sea_state}, {angle:g}°", loc="left")
    handles = grid[0, 0].get_legend_handles_labels()[0]
    band = Patch(facecolor=COLOUR["hybrid"], alpha=0.25, label="95 % region at the end")
    figure.legend(handles=[*handles, band], loc="outside lower center", ncols=4)


def _one_prediction(axes: Axes, sea: SeaResults, number: int) -> None:
    """One unseen sequence, and the hybrid's own region about its end."""
    judged = sea.judged
    start = judged.start[number]
    tracks = {
        method: rotate_to_start_frame(sea.predicted(method)[number], start) for method in ("reference", "hybrid")
    }
    errors = sea.errors["sequence"]
    region_m = errors["hybrid"].region_m[number]
    border = rotate_to_start_frame(region_outlines(sea.predicted("hybrid")[number], region_m)[-1], start)
    off_m = {method: float(np.linalg.norm(errors[method].gap_m[number, -1])) for method in tracks}
    around_m = float(np.ceil(1.1 * max(off_m["reference"], off_m["hybrid"] + region_m[-1].max())))
    measured = rotate_to_start_frame(judged.track[number], start)
    track_with_end(axes, measured, tracks, border, around_m)


def draw_spread(figure: Figure, seas: Seas) -> None:
    """Figure 10."""
    panels = figure.subplots(1, len(seas), squeeze=False, sharey=True)[0]
    for axes, sea in zip(panels, seas, strict=True):
        errors = {
            (method, split): np.nanmean(np.linalg.norm(sea.errors[split][method].gap_m, axis=2), axis=1)
            for method in SPREAD for split in SPLIT_LOOK
        }  # fmt: skip
        error_spread(axes, errors, SPREAD)
        axes.set_title(sea.job.sea_state, loc="left")
    panels[0].set_ylabel("mean distance of a sequence [m]")
    splits = [Patch(facecolor=INK, alpha=alpha, label=label) for _, alpha, label in SPLIT_LOOK.values()]
    figure.legend(handles=splits, loc="outside lower center", ncols=2)


FIGURES: dict[str, FigureSpec] = {
    "figure_04_tracks": FigureSpec(
        draw_tracks,
        (10.5, 7.0),
        "The campaign in the three sea states: zigzags to scale, one colour an azimuth, north up.",
        "Whether the tracks cover both sides and all azimuths alike, and how far waves and current bend them: what "
        "no sequence shows, nothing can learn.",
    ),
    "figure_05_channels": FigureSpec(
        draw_channels,
        (9.0, 9.5),
        "One sequence of 600 samples: heading, velocities, wind and thrusters.",
        "That the thrusters are held while the ship still turns: the motion is its answer to one order. The "
        "oscillation on top is the waves', which no method here foresees.",
    ),
    "figure_06_reference": FigureSpec(
        draw_fans,
        (10.5, 4.6),
        "Measured against the reference model's tracks, as many sequences of each azimuth, all from one start with "
        "the bow up; above, its mean error on sequences never seen.",
        "Whether the error is systematic, all tracks of an azimuth off to the same side: such an error can be "
        "learned, scatter about zero cannot.",
    ),
    "figure_07_errors": FigureSpec(
        draw_errors,
        (10.5, 5.6),
        "Error north and east of reference and hybrid on sequences never seen: mean, and the middle 80 % shaded.",
        "How fast the errors grow: one of the starting speed grows with time, a wrong force makes it grow with the "
        "square of time; and whether the hybrid's shade stays about zero.",
    ),
    "figure_09_predictions": FigureSpec(
        draw_predictions,
        (10.5, 11.0),
        "Sequences never seen, one of each azimuth and sea state, bow up; the insets enlarge the last metres.",
        "In the insets, whether the measured end lies in the hybrid's 95 % region: it should in 19 of 20.",
    ),
    "figure_10_distribution": FigureSpec(
        draw_spread,
        (10.5, 4.6),
        "Mean distance of each sequence by method: never seen beside the paper's random split. Boxes hold the "
        "middle half, whiskers reach to 5 and 95 %.",
        "The distance between the two boxes of one method: what the random split hides, as it tests on seconds "
        "whose neighbours were learned from.",
    ),
}
"""The figures by the names of their files."""
