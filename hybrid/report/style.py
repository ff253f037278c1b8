"""What all figures of predictions share: a colour a method, the frame of a start, axes of errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from acquisition.core.arrays import Floats
from analysis.report.plots import INK, PALETTE
from hybrid.prediction.prediction_windows import in_ship_axes
from hybrid.prediction.scores import Interval

_LEAST = 1e-3  # a logarithmic axis begins here at the lowest: a millimetre, a thousandth
_TICKS = ((8.0, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)), (300.0, (1.0, 2.0, 5.0)), (np.inf, (1.0,)))

COLOUR = {
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


def start_frame(track: Floats, start: Floats) -> Floats:
    """Starboard and ahead [..., H+1, 2] of tracks [..., H+1, 2 or 3] seen from their starts [..., 6], in metres."""
    north = track[..., 0] - start[..., 0, None]
    east = track[..., 1] - start[..., 1, None]
    ahead, starboard = in_ship_axes(north, east, start[..., 2, None])
    return np.stack([starboard, ahead], axis=-1)


def interval_bar(axes: Axes, interval: Interval, row: float, colour: str, label: str = "") -> Artist:
    """A point with its interval, lying down."""
    drawn = axes.errorbar(
        interval.value, row, xerr=reach(interval)[:, None], fmt="o", color=colour, capsize=2.5, label=label
    )
    return drawn.lines[0]


def reach(interval: Interval) -> Floats:
    """How far an interval reaches below and above its figure [2]: not at all where one leg cannot say."""
    ends = np.array([interval.value - interval.low, interval.high - interval.value])
    return np.asarray(np.maximum(np.nan_to_num(ends), 0.0))


def logarithmic(axes: Axes, name: Literal["x", "y"], intervals: Sequence[Interval]) -> None:
    """Half and double stand equally far from one; the ticks are numbers that people read."""
    ends = np.array([(each.low, each.value, each.high) for each in intervals])
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
