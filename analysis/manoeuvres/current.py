"""The drift of a turning circle: where a whole turn later the ship is not where she was.

In steady turning she comes back to the same point of the water after each turn, so that the way between two
points of the track one turn apart, over the time between them, is the velocity of the water, with what the wind
adds to it (ITTC 7.5-04-02-01, correction for drift). All pairs of the steady part count.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acquisition.core.arrays import Floats
from analysis.manoeuvres.indices import Current
from analysis.manoeuvres.motion import Motion

LEAST_TURN_DEG = 510.0
_SETTLED_DEG = 120.0
_FEWEST_PAIRS = 10


def drift_pairs(motion: Motion, start: float, end: float) -> tuple[Floats, Floats]:
    """Drift north and east [m/s] from every pair of rows one turn apart, once the turn has settled."""
    inside = motion.between(start, end)
    turned = np.maximum.accumulate(np.abs(inside.heading_deg - inside.heading_deg[0]))
    rising = turned + 1e-9 * np.arange(turned.size)
    later = np.flatnonzero(turned >= _SETTLED_DEG + 360.0)
    then_s = np.interp(turned[later] - 360.0, rising, inside.time_s)
    span = inside.time_s[later] - then_s
    north = inside.north_m[later] - np.interp(then_s, inside.time_s, inside.north_m)
    east = inside.east_m[later] - np.interp(then_s, inside.time_s, inside.east_m)
    return north / span, east / span


def current_of(motion: Motion, start: float, end: float) -> Current | None:
    """The drift with its interval, None where the ship turned less than 510 deg."""
    turned = abs(motion.at("heading_deg", end) - motion.at("heading_deg", start))
    if turned < LEAST_TURN_DEG:
        return None
    north, east = drift_pairs(motion, start, end)
    if north.size < _FEWEST_PAIRS:
        return None
    return Current(float(north.mean()), float(east.mean()), _within(north), _within(east))


def _within(values: Floats) -> float:
    """Half of the 95 % interval: pairs of one circle share their points, so that their spread is not divided."""
    return float(1.96 * np.std(values))


def without_current(motion: Motion, north_mps: float, east_mps: float, start: float) -> Motion:
    """The motion through the water: path and speeds less a steady current, the path unchanged at ``start``."""
    passed = motion.time_s - start
    heading = np.deg2rad(motion.heading_deg)
    return replace(
        motion,
        north_m=motion.north_m - north_mps * passed,
        east_m=motion.east_m - east_mps * passed,
        surge_mps=motion.surge_mps - north_mps * np.cos(heading) - east_mps * np.sin(heading),
        sway_mps=motion.sway_mps + north_mps * np.sin(heading) - east_mps * np.cos(heading),
    )
