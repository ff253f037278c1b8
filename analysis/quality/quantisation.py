"""Values on a grid that is coarser than the channel's noise: what lies between the steps is lost.

Every digital sensor has a grid. It harms where its step exceeds both the noise (which else carries the mean
between two steps) and what buses commonly carry: ``EVERYDAY`` holds the coarsest resolution by quantity that
is normal in NMEA 2000, NMEA 0183 and MAVLink. Values need not lie on exact multiples: a grid that has been
projected or drifts by less than a hundredth of its step shows in the differences of consecutive values.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.arrays import Floats
from acquisition.core.channels import Channel
from analysis.quality.samples import in_time, white_noise

EVERYDAY = {"m": 0.02, "deg": 0.1, "m/s": 0.01, "deg/s": 0.02, "rpm": 1.0}
_COARSER = {("command", "deg"): 1.0, ("environment", "deg"): 1.0, ("environment", "m/s"): 0.1}
_DEGREES_OF_POSITION = 2e-7
_FEWEST, _CONCENTRATED, _LARGEST_MULTIPLE = 30, 0.8, 8.5
_MOST, _EXACT, _NOISES = 200_000, 0.95, 0.7


def everyday_resolution(channel: Channel) -> float:
    """The coarsest step [the channel's unit] that instruments of this kind commonly report."""
    if channel.name in ("latitude_deg", "longitude_deg"):
        return _DEGREES_OF_POSITION
    return _COARSER.get((channel.group, channel.unit), EVERYDAY[channel.unit])


def grid_step(values: Floats) -> float:
    """The step of the grid that values move on, 0 where there is none.

    It is looked for in the changes from value to value, where a grid that drifts still shows, in the distances
    between values sorted by size, and in those between the changes, where it shows even at a constant speed.
    """
    values = values[np.isfinite(values)]
    if values.size > _MOST:
        values = np.concatenate([part[: _MOST // 8] for part in np.array_split(values, 8)])
    steps = np.diff(values)
    noise = float(np.sqrt(np.mean(np.diff(steps, 2) ** 2) / 20.0)) if steps.size > 2 else 0.0
    distances = np.diff(np.sort(values))
    searches = ((_step_of, np.abs(steps)), (_step_of, distances), (_exact_step, np.abs(steps)))
    found = (search(changes, noise) for search, changes in searches)
    return next((step for step in found if step and _on_plateaus(steps, step)), 0.0)


def _step_of(changes: Floats, noise: float) -> float:
    """The step on whose multiples the changes lie. Those below a hundredth of the typical one count as none.

    Candidates are the smaller changes and their fractions; the largest wins on whose multiples the changes
    concentrate, by the mean of cos(2 pi change / step), which is 1 on a grid and near 0 without.
    """
    changes = changes[changes > 0.0]
    if changes.size < _FEWEST:
        return 0.0
    typical = np.median(changes[changes >= np.quantile(changes, 0.5)])
    changes = changes[changes > 0.01 * typical]
    if changes.size < _FEWEST:
        return 0.0
    smaller = np.quantile(changes, [0.0, 0.01, 0.05, 0.1, 0.25, 0.5], method="lower")
    candidates = np.unique(np.concatenate([smaller / share for share in (1, 2, 3, 4)]))[::-1]
    found = (_confirmed(changes, float(each), noise) for each in candidates)
    return next((each for each in found if each), 0.0)


def _confirmed(changes: Floats, candidate: float, noise: float) -> float:
    """The candidate made exact by the changes near its multiples, or 0 if they do not lie on them.

    They do if they are far closer than the noise would let them, which a ship at constant speed is not.
    """
    for reach in (2.5, _LARGEST_MULTIPLE):
        near = changes[changes < reach * candidate]
        multiples = np.rint(near / candidate)
        close = (np.abs(near / candidate - multiples) < 0.2) & (multiples > 0)
        if not close.any():
            return 0.0
        candidate = float(np.median(near[close] / multiples[close]))
    near = changes[changes < _LARGEST_MULTIPLE * candidate]
    if near.size < max(_FEWEST, 0.02 * changes.size):
        return 0.0
    concentration = float(np.mean(np.cos(2.0 * np.pi * near / candidate)))
    apart = float(np.quantile(np.abs(near - candidate * np.rint(near / candidate)), 0.8))
    return candidate if concentration > _CONCENTRATED and apart < 0.1 * noise else 0.0


def _exact_step(changes: Floats, noise: float) -> float:
    """The step of an exact grid from the least distance between two changes, if all are multiples of it."""
    distances = np.diff(np.sort(changes))
    distances = distances[distances > 1e-6 * changes.max(initial=0.0)]
    if changes.size < _FEWEST or not distances.size:
        return 0.0
    step = float(np.median(distances[distances < 1.5 * distances.min()]))
    apart = float(np.quantile(np.abs(changes - step * np.rint(changes / step)), 0.8))
    exact = float(np.mean(np.cos(2.0 * np.pi * changes / step))) > _EXACT and apart < 0.1 * noise
    return step if exact else 0.0


def _on_plateaus(steps: Floats, step: float) -> bool:
    """Whether changes stop or turn at once, or differ in size: a ramp without noise does neither."""
    multiples = np.rint(steps[np.isfinite(steps)] / step)
    changed = np.flatnonzero(multiples[:-1])
    sizes, counts = np.unique(np.abs(multiples[changed]), return_counts=True)
    several = sizes.size > 0 and counts.max() < 0.9 * changed.size
    stops = np.mean(multiples[changed + 1] * np.sign(multiples[changed]) <= 0.0)
    return bool(several or stops > 0.2)


def noise_beside(values: Floats, step: float) -> float:
    """Standard deviation of the noise that is there besides the rounding to a grid of this step."""
    return float(np.sqrt(max(white_noise(values) ** 2 - step**2 / 12.0, 0.0)))


def quantised(samples: pd.Series[Any], channel: Channel) -> float:
    """The step [the channel's unit] of a grid that lost information, 0 where there is none.

    A grid is found where its step exceeds the everyday resolution, and is no smaller than the noise (0.7 of its
    standard deviation, which waves raise at slow rates) or makes every fifth value repeat the last.
    """
    _, _, values = in_time(samples, channel)
    steps = np.diff(values)
    step = grid_step(values)
    if step <= 1.05 * everyday_resolution(channel):
        return 0.0
    repeats = float(np.mean(np.abs(steps) < 0.1 * step))
    return step if step > _NOISES * noise_beside(values, step) or repeats > 0.2 else 0.0
