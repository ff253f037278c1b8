"""Figures of predictions, in the house's style: functions take axes and data and return what they drew."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from analysis.plots import INK, PALETTE
from hybrid.validate import Validation

COLOUR = {
    "constant_velocity": PALETTE[3],
    "reference": PALETTE[4],
    "data_driven": PALETTE[2],
    "hybrid": PALETTE[0],
}
"""One colour a method, in every figure."""


def title_of(method: str) -> str:
    """A method's name for people.

    >>> title_of("constant_velocity")
    'constant velocity'
    """
    return method.replace("_", " ")


def error_by_second(axes: Axes, validation: Validation) -> list[Artist]:
    """The mean distance of every method against the second of the prediction, the band's radius dashed."""
    seconds = np.arange(1, validation.horizons.horizon_s + 1)
    artists: list[Artist] = []
    for method, score in validation.scores.items():
        artists += axes.plot(seconds, score.by_second, color=COLOUR[method], label=title_of(method))
    if validation.band_m is not None:
        artists += axes.plot(
            seconds, validation.band_m, "--", color=COLOUR["hybrid"], label="95 % region of the hybrid, median"
        )
    axes.set_xlabel("prediction time [s]")
    axes.set_ylabel("mean distance to the measured position [m]")
    axes.set_xlim(0, seconds[-1])
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    return artists


def fan(axes: Axes, validation: Validation, window: int) -> list[Artist]:
    """One window: the measured track, every method's prediction, and the band at its end, in metres from the
    start with the start's heading upwards.
    """
    start = validation.horizons.start[window]
    artists: list[Artist] = []
    measured = _from_start(validation.horizons.track[window], start)
    artists += axes.plot(measured[:, 0], measured[:, 1], "o", color=INK, markersize=2.5, label="measured")
    for method, tracks in validation.tracks.items():
        track = _from_start(tracks[window], start)
        artists += axes.plot(track[:, 0], track[:, 1], color=COLOUR[method], label=title_of(method))
    if validation.radius_m is not None:
        end = _from_start(validation.tracks["hybrid"][window], start)[-1]
        circle = Circle(
            (end[0], end[1]), validation.radius_m[window, -1], fill=False, color=COLOUR["hybrid"], linestyle="--"
        )
        artists.append(axes.add_patch(circle))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("to starboard [m]")
    axes.set_ylabel("ahead [m]")
    return artists


def _from_start(track: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Starboard and ahead of the start [H+1, 2] in metres."""
    north, east = track[:, 0] - start[0], track[:, 1] - start[1]
    sine, cosine = np.sin(start[2]), np.cos(start[2])
    return np.column_stack([-north * sine + east * cosine, north * cosine + east * sine])
