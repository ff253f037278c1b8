"""What a network sees of a window: one row a window and second, angles as points on the circle."""

from __future__ import annotations

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.prediction.prediction_windows import Horizons

START_INPUTS = (
    "heading_sin", "heading_cos", "surge_mps", "sway_mps", "yaw_rate_radps",
    "wind_direction_sin", "wind_direction_cos", "wind_speed_mps",
    "port_rps", "port_angle_sin", "port_angle_cos",
    "starboard_rps", "starboard_angle_sin", "starboard_angle_cos", "tunnel_rpm", "second",
)  # fmt: skip
REFERENCE_INPUTS = ("reference_north_m", "reference_east_m")


def start_inputs(horizons: Horizons) -> Floats:
    """The window's start and the second that is asked for [N, H, 16], columns as :data:`START_INPUTS`.

    Positions are left out: the displacement from the start does not depend on where the ship is.
    """
    heading, wind, control = horizons.start[:, 2], horizons.wind, horizons.control
    start = np.column_stack(
        [
            np.sin(heading), np.cos(heading), horizons.start[:, 3:],
            np.sin(wind[:, 0]), np.cos(wind[:, 0]), wind[:, 1],
            control[:, 0], np.sin(control[:, 1]), np.cos(control[:, 1]),
            control[:, 2], np.sin(control[:, 3]), np.cos(control[:, 3]), control[:, 4],
        ]
    )  # fmt: skip
    count, seconds = len(horizons), horizons.horizon_s
    repeated = np.repeat(start[:, None, :], seconds, axis=1)
    second = np.broadcast_to(np.arange(1.0, seconds + 1)[None, :, None], (count, seconds, 1))
    return np.concatenate([repeated, second], axis=-1)


def displacement(track: Floats, start: Floats) -> Floats:
    """North and east from the start at seconds 1 to H [N, H, 2] of a track [N, H+1, 2 or 3]."""
    return track[:, 1:, :2] - start[:, None, :2]
