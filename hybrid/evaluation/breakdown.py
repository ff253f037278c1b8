"""Windows by what the ship did, by wind and by recording: where a method is good and where it is not.

The limits are those of a ship of any size: lengths in ship lengths, speeds as Froude numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from hybrid.prediction.prediction_windows import WIND, PredictionWindows, in_ship_axes

GRAVITY_MPS2 = 9.81
SLOW_FROUDE = 0.06
"""A ship below this speed over the root of gravity and length is docking, drifting or holding her place."""
SIDEWAYS_DEG = 30.0
"""A course further than this from the heading is sideways or astern."""
TURNING_DEG_PER_LENGTH = 4.0
"""A ship that turns more than this while she sails her length is turning: in a circle of less than 29 lengths."""
ACCELERATING_PER_LENGTH = 0.02
"""A ship whose speed changes by more than this share while she sails her length speeds up or slows down."""

MANOEUVRES = ("straight", "turning", "accelerating", "slow", "other")
BEAUFORT_MPS = (3.4, 8.0, 13.9)
WINDS = ("0-2 Bft", "3-4 Bft", "5-6 Bft", "7 Bft and more")


def classes_of(windows: PredictionWindows, length_m: float) -> dict[str, dict[str, Bools]]:
    """Masks [N] by kind of class and class, without the empty ones, those of a kind holding all windows."""
    named = {
        "manoeuvre": (manoeuvres(windows, length_m), MANOEUVRES),
        "wind": (winds(windows), WINDS),
        "recording": (windows.trial, tuple(np.unique(windows.trial))),
    }
    return {
        kind: {str(name): mask for name in names if (mask := np.asarray(given == name)).any()}
        for kind, (given, names) in named.items()
    }


def manoeuvres(windows: PredictionWindows, length_m: float) -> NDArray[np.str_]:
    """What the measured track of each window says she did [N], one of :data:`MANOEUVRES`.

    The first that applies of: slow; other, sideways or astern; turning; accelerating; straight.
    """
    seconds = windows.horizon_s
    steps = np.diff(windows.track[..., :2], axis=1)
    way_m = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
    lengths = np.maximum(way_m / length_m, 1e-9)
    turned_deg = np.rad2deg(np.abs(windows.track[:, -1, 2] - windows.track[:, 0, 2]))
    slow = way_m / seconds < SLOW_FROUDE * np.sqrt(GRAVITY_MPS2 * length_m)
    rules = {
        "slow": slow,
        "other": _drift_deg(windows, steps) > SIDEWAYS_DEG,
        "turning": turned_deg / lengths > TURNING_DEG_PER_LENGTH,
        "accelerating": _speed_change(steps) / lengths > ACCELERATING_PER_LENGTH,
    }
    return np.asarray(np.select(list(rules.values()), list(rules), "straight"))


def winds(windows: PredictionWindows) -> NDArray[np.str_]:
    """The wind of the minute before each window by its Beaufort number [N], of :data:`WINDS`."""
    speed_mps = np.nanmean(np.column_stack([windows.wind[:, -1], windows.past[..., WIND][..., -1]]), axis=1)
    return np.asarray(np.array(WINDS)[np.searchsorted(BEAUFORT_MPS, speed_mps, side="right")])


def _drift_deg(windows: PredictionWindows, steps: Floats) -> Floats:
    """The mean angle between course and heading over each window [N]."""
    heading = 0.5 * (windows.track[:, 1:, 2] + windows.track[:, :-1, 2])
    ahead, starboard = in_ship_axes(steps[..., 0], steps[..., 1], heading)
    return np.asarray(np.rad2deg(np.abs(np.arctan2(starboard.sum(axis=1), ahead.sum(axis=1)))))


def _speed_change(steps: Floats) -> Floats:
    """How much of her speed a ship gains or loses from the first to the last third of each window [N]."""
    third = max(1, steps.shape[1] // 3)
    speeds = [np.hypot(*part.mean(axis=1).T) for part in (steps[:, :third], steps[:, -third:])]
    return np.asarray(np.abs(speeds[1] - speeds[0]) / np.maximum(0.5 * (speeds[0] + speeds[1]), 1e-9))
