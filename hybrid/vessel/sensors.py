"""What the sensors report of a motion: heading, position and speeds as recorded, from true states.

Delays look back along the simulated track, and before its first state along the circle that the first speeds
describe. Neutral numbers in the plant leave every value as it is, bit for bit. The effects of the catalogue
that concern the *inputs* of a simulation (azimuth offsets, wind vane) act in the simulator, not here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hybrid.vessel.compiling import Floats
from hybrid.vessel.plant import Plant

NORTH, EAST, HEADING, SURGE, SWAY, YAW_RATE = range(6)


def measured(states: ArrayLike, plant: Plant, dt_s: float) -> Floats:
    """States [..., K+1, 6] as the sensors of ``plant`` report them, samples ``dt_s`` apart.

    Reported = factor x true, or true + bias; the recorded position is the antenna's, where the ship was
    ``position_delay_s`` before.
    """
    true = np.asarray(states, dtype=np.float64)
    reported = true.copy()
    located = _before(true, plant.position_delay_s, dt_s) if plant.position_delay_s else true
    reported[..., :2] = located[..., :2]
    forward, starboard = plant.antenna_forward_m, plant.antenna_starboard_m
    if forward or starboard:
        cosine, sine = np.cos(located[..., HEADING]), np.sin(located[..., HEADING])
        reported[..., NORTH] += forward * cosine - starboard * sine
        reported[..., EAST] += forward * sine + starboard * cosine
    if plant.heading_delay_s:
        reported[..., HEADING] = _before(true, plant.heading_delay_s, dt_s)[..., HEADING]
    reported[..., HEADING] += plant.heading_bias_rad
    reported[..., SURGE : SWAY + 1] *= plant.speed_scale
    reported[..., YAW_RATE] += plant.yaw_rate_bias_radps
    return reported


def _before(states: Floats, delay_s: float, dt_s: float) -> Floats:
    """The pose [..., K+1, 3] ``delay_s`` before each sample (after it, if negative)."""
    last = states.shape[-2] - 1
    times = np.arange(last + 1) - delay_s / dt_s
    lower = np.clip(np.floor(times), 0, max(last - 1, 0)).astype(int)
    upper = np.minimum(lower + 1, last)
    part = (times - lower)[:, np.newaxis]
    slope = _pose_rate(states) * dt_s
    inside = _hermite(
        states[..., lower, :3], states[..., upper, :3], slope[..., lower, :], slope[..., upper, :], part
    )
    early, late = times < 0.0, times > last
    inside[..., early, :] = _arc(states[..., :1, :], times[early] * dt_s)
    inside[..., late, :] = _arc(states[..., -1:, :], (times[late] - last) * dt_s)
    return inside


def _pose_rate(states: Floats) -> Floats:
    """North, east [m/s] and turning speed [rad/s] of states [..., 6]."""
    cosine, sine = np.cos(states[..., HEADING]), np.sin(states[..., HEADING])
    u, v = states[..., SURGE], states[..., SWAY]
    return np.stack([u * cosine - v * sine, u * sine + v * cosine, states[..., YAW_RATE]], axis=-1)


def _hermite(left: Floats, right: Floats, left_slope: Floats, right_slope: Floats, part: Floats) -> Floats:
    """Cubic interpolation that meets values and slopes at both ends, ``part`` of the way."""
    t, rest = part, 1.0 - part
    return np.asarray(
        rest**2 * ((1.0 + 2.0 * t) * left + t * left_slope) + t**2 * ((3.0 - 2.0 * t) * right - rest * right_slope)
    )


def _arc(states: Floats, ahead_s: Floats) -> Floats:
    """The pose ``ahead_s`` [n] later at the constant speeds of ``states`` [..., 1, 6]: [..., n, 3]."""
    turned = states[..., YAW_RATE] * ahead_s
    middle = states[..., HEADING] + 0.5 * turned
    chord = ahead_s * np.sinc(turned / (2.0 * np.pi))
    u, v = states[..., SURGE], states[..., SWAY]
    north = states[..., NORTH] + chord * (u * np.cos(middle) - v * np.sin(middle))
    east = states[..., EAST] + chord * (u * np.sin(middle) + v * np.cos(middle))
    return np.stack([north, east, states[..., HEADING] + turned], axis=-1)
