"""Windows as arrays, made without a recording: random ships in motion, and what they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from hybrid.baselines import constant_velocity
from hybrid.horizon import PAST_S, Horizons

Floats = NDArray[np.float64]


def windows_at(start: ArrayLike, seconds: int, wind: ArrayLike = (0.0, 0.0)) -> Horizons:
    """Windows that start in the states [N, 6], the tracks those of the present motion held."""
    states = np.atleast_2d(np.asarray(start, dtype=float))
    count = len(states)
    empty = Horizons(
        start=states,
        track=np.zeros((count, seconds + 1, 3)),
        wind=np.broadcast_to(np.asarray(wind, dtype=float), (count, 2)).copy(),
        control=np.tile([2.5, 0.0, 2.5, 0.0, 0.0], (count, 1)),
        trial=np.array(["trial"] * count),
        leg=np.array([f"trial/{number:03d}" for number in range(count)]),
        start_time=pd.date_range("2026-06-01T08:00:00Z", periods=count, freq="60s"),
        past=np.full((count, PAST_S + 1, 13), np.nan),
    )
    return replace(empty, track=constant_velocity(empty))


def random_windows(count: int, seconds: int, seed: int = 0) -> Horizons:
    """Ships anywhere, on any heading, at a few metres a second, turning a little, in some wind."""
    random = np.random.default_rng(seed)
    low = [-500.0, -500.0, -np.pi, 2.0, -0.3, -0.02]
    high = [500.0, 500.0, np.pi, 5.0, 0.3, 0.02]
    windows = windows_at(random.uniform(low, high, (count, 6)), seconds)
    return replace(windows, wind=random.uniform([-np.pi, 0.0], [np.pi, 8.0], (count, 2)))


def moved(windows: Horizons, north_m: float, east_m: float, turn_rad: float = 0.0) -> Horizons:
    """The same windows in another place and on another heading, the wind turned with them."""
    start, track, wind = windows.start.copy(), windows.track.copy(), windows.wind.copy()
    for states in (start, track):
        states[..., :2] = turned(states[..., :2], turn_rad) + np.array([north_m, east_m])
        states[..., 2] += turn_rad
    wind[:, 0] += turn_rad
    return replace(windows, start=start, track=track, wind=wind)


def turned(points: Floats, turn_rad: float) -> Floats:
    """North and east [..., 2] turned about the origin, clockwise from above."""
    sine, cosine = np.sin(turn_rad), np.cos(turn_rad)
    north, east = points[..., 0], points[..., 1]
    return np.stack([north * cosine - east * sine, north * sine + east * cosine], axis=-1)
