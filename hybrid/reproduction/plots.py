"""Pictures of the reproduction in the house's style: functions take axes and data and return what they drew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from acquisition.core.arrays import Floats
from analysis.report.plots import FAINT, INK, PALETTE
from hybrid.prediction.prediction_windows import PredictionWindows
from hybrid.report.style import COLOUR, plain_numbers, start_frame
from hybrid.report.words import plain

AZIMUTH_COLOUR = {10.0: PALETTE[0], 20.0: PALETTE[2], 30.0: PALETTE[4]}


def campaign_tracks(axes: Axes, windows: PredictionWindows, azimuth_deg: Floats) -> list[Artist]:
    """Where the sequences lie, one colour an azimuth, with the minute before each in grey; north up."""
    artists: list[Artist] = []
    for past in windows.past:
        artists += axes.plot(past[:, 1] / 1e3, past[:, 0] / 1e3, color=FAINT, linewidth=0.8)
    for angle, colour in AZIMUTH_COLOUR.items():
        for place, number in enumerate(np.flatnonzero(np.abs(azimuth_deg) == angle)):
            track, label = windows.track[number] / 1e3, None if place else f"{angle:g}°"
            artists += axes.plot(track[:, 1], track[:, 0], color=colour, linewidth=2.0, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [km]")
    axes.set_ylabel("north [km]")
    return artists


def channel(axes: Axes, seconds: Floats, values: Mapping[str, Floats], label: str) -> list[Artist]:
    """Channels of one unit against the seconds of a sequence; ``values`` by the name in the legend."""
    artists: list[Artist] = []
    for (name, series), colour in zip(values.items(), PALETTE, strict=False):
        artists += axes.plot(seconds, series, color=colour, linewidth=1.0, label=name)
    axes.set_ylabel(label)
    axes.set_xlim(seconds[0], seconds[-1])
    axes.margins(y=0.15)
    if len(values) > 1:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=len(values), borderpad=0.0, fontsize=8)
    return artists


def fans(axes: Axes, windows: PredictionWindows, predicted: Floats, method: str) -> list[Artist]:
    """Measured and predicted tracks [N, H+1, 3] of several sequences from one start, bow up and to scale."""
    artists: list[Artist] = []
    measured, tracks = (start_frame(each, windows.start) for each in (windows.track, predicted))
    for number, (ours, theirs) in enumerate(zip(measured, tracks, strict=True)):
        first = number == 0
        artists += axes.plot(ours[:, 0], ours[:, 1], color=INK, label="measured" if first else None)
        label = plain(method) if first else None
        artists += axes.plot(theirs[:, 0], theirs[:, 1], "--", color=COLOUR[method], label=label)
    _bow_up(axes, "box")
    return artists


def error_over_time(axes: Axes, gaps_m: Mapping[str, Floats]) -> list[Artist]:
    """Mean size of one coordinate's error [N, H] by method against time; the shade holds the middle 80 %."""
    artists: list[Artist] = []
    for method, gap_m in gaps_m.items():
        seconds, size = np.arange(1, gap_m.shape[1] + 1), np.abs(gap_m)
        low, high = np.quantile(size, [0.1, 0.9], axis=0)
        artists.append(axes.fill_between(seconds, low, high, color=COLOUR[method], alpha=0.22, linewidth=0))
        artists += axes.plot(seconds, size.mean(axis=0), color=COLOUR[method], label=plain(method))
    axes.set_xlim(0, seconds[-1])
    axes.set_ylim(bottom=0)
    return artists


def track_with_end(
    axes: Axes, measured: Floats, predicted: Mapping[str, Floats], band_m: float, around_m: float
) -> list[Artist]:
    """One sequence [H+1, 2] in the start frame, and its end enlarged: a square of ``around_m`` each way.

    The band is a circle of ``band_m`` about the last method's prediction.
    """
    right = measured[-1, 0] >= 0.0
    ends = axes.inset_axes((0.03, 0.2, 0.42, 0.42) if right else (0.55, 0.2, 0.42, 0.42))
    artists: list[Artist] = []
    for panel, wide in ((axes, 1.3), (ends, 1.6)):
        artists += panel.plot(*measured.T, color=INK, linewidth=wide, label="measured")
        for method, track in predicted.items():
            artists += panel.plot(*track.T, "--", color=COLOUR[method], linewidth=wide, label=plain(method))
    ends.plot(*measured[-1], "o", color=INK, markersize=4)
    method, track = list(predicted.items())[-1]
    circle = Circle((track[-1, 0], track[-1, 1]), band_m, color=COLOUR[method], alpha=0.25, linewidth=0)
    artists.append(ends.add_patch(circle))
    for other, each in predicted.items():
        ends.plot(*each[-1], "o", color=COLOUR[other], markersize=4)
    _frame_end(ends, measured[-1], around_m)
    aside_m = 1.1 * max(float(np.abs(each[:, 0]).max()) for each in (measured, *predicted.values()))
    # the start in the middle, so that one half is free for the end
    axes.update_datalim([(-aside_m, 0.0), (aside_m, 0.0)])
    axes.autoscale_view()
    _bow_up(axes, "datalim")
    return artists


def _frame_end(ends: Axes, middle: Floats, around_m: float) -> None:
    ends.set_xlim(middle[0] - around_m, middle[0] + around_m)
    ends.set_ylim(middle[1] - around_m, middle[1] + around_m)
    ends.set_xticks([])
    ends.set_yticks([])
    ends.grid(visible=False)
    for side in ("top", "right"):
        ends.spines[side].set_visible(True)
    ends.set_title(f"end, {2 * around_m:g} m wide", fontsize=7, pad=2)


def _bow_up(axes: Axes, adjustable: Literal["box", "datalim"]) -> None:
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set_xlabel("to starboard [m]")
    axes.set_ylabel("ahead [m]")


SPLIT_LOOK = {"sequence": (-0.19, 0.85, "sequences never seen"), "random": (0.19, 0.25, "the random split")}


def error_spread(axes: Axes, errors_m: Mapping[tuple[str, str], Floats], methods: Sequence[str]) -> list[Artist]:
    """Mean distance per sequence by method as boxes, the two splits side by side, on a logarithmic axis.

    ``errors_m`` has the errors [n] by method and split. Whiskers reach to the 5th and 95th of 100.
    """
    artists: list[Artist] = []
    for place, method in enumerate(methods):
        for split, (beside, alpha, _) in SPLIT_LOOK.items():
            values = errors_m[method, split]
            drawn = axes.boxplot(
                values[np.isfinite(values)], positions=[place + beside], widths=0.32, whis=(5, 95),
                showfliers=False, patch_artist=True, medianprops={"color": INK, "linewidth": 1.5},
                boxprops={"facecolor": COLOUR[method], "alpha": alpha, "edgecolor": COLOUR[method]},
                whiskerprops={"color": COLOUR[method]}, capprops={"color": COLOUR[method]},
            )  # fmt: skip
            artists += drawn["boxes"]
    axes.set_yscale("log")
    plain_numbers(axes.yaxis)
    axes.set_xticks(range(len(methods)), [plain(each).replace(" ", "\n") for each in methods], fontsize=7.5)
    axes.grid(visible=False, axis="x")
    return artists
