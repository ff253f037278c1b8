"""Predictions without anything learned: the present motion held, and the reference model.

Every method maps the start of N windows to a track [N, H+1, 3]: north, east [m], heading [rad].
"""

from __future__ import annotations

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.prediction.prediction_windows import PredictionWindows
from hybrid.vessel.plant import Plant
from hybrid.vessel.simulate import simulate_batch


def constant_velocity(windows: PredictionWindows) -> Floats:
    """The present surge, sway and yaw rate of the windows' starts held."""
    return present_motion_held(windows.start, windows.horizon_s)


def present_motion_held(states: Floats, horizon_s: int) -> Floats:
    """Surge, sway and yaw rate of states [N, 6] held: a straight line or a circle, in closed form, [N, H+1, 3].

    With yaw rate r the displacement in the start frame after t seconds is the integral of the turning body
    velocity: (u sin rt - v (1 - cos rt)) / r ahead and (v sin rt + u (1 - cos rt)) / r to starboard.
    """
    seconds = np.arange(horizon_s + 1, dtype=float)
    north, east, heading, surge, sway, rate = (column[:, None] for column in states.T)
    turn = rate * seconds
    # sinc and its companion stay exact for a yaw rate of zero
    along = seconds * np.sinc(turn / np.pi)
    across = seconds * np.sinc(turn / (2 * np.pi)) * np.sin(turn / 2)
    ahead, starboard = surge * along - sway * across, sway * along + surge * across
    return np.stack(
        [
            north + ahead * np.cos(heading) - starboard * np.sin(heading),
            east + ahead * np.sin(heading) + starboard * np.cos(heading),
            heading + turn,
        ],
        axis=-1,
    )


def reference(windows: PredictionWindows, plant: Plant) -> Floats:
    """The simulation model from the measured start, thrusters and wind held as they are at second 0.

    Windows in which the model leaves its range are NaN from there on.
    """
    held = np.repeat(windows.control[:, None, :], windows.horizon_s, axis=1)
    return simulate_tracks(plant, windows.start, held, windows.wind)


def simulate_tracks(plant: Plant, states: Floats, control: Floats, wind: Floats) -> Floats:
    """The simulation model from states [N, 6] under controls [N, H, 5] and a wind [N, 2] that holds [N, H+1, 3]."""
    blowing = np.repeat(wind[:, None, :], control.shape[1], axis=1)
    return simulate_batch(plant, states, control, blowing, dt_s=1.0).states[:, :, :3]
