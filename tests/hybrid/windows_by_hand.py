"""Windows as arrays, made without a recording: random ships in motion, and what they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.calibrators import Calibrator
from seatrial.hybrid.prediction.baselines import constant_velocity
from seatrial.hybrid.prediction.window_sets import PAST_S, PredictionWindows
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.plant import Plant

STARTED_NS = 1_780_300_800 * NANO
"""2026-06-01, 8 o'clock."""


def windows_at(start: ArrayLike, seconds: int, wind: ArrayLike = (0.0, 0.0)) -> PredictionWindows:
    """Windows that start in the states [N, 6], the tracks those of the present motion held."""
    states = np.atleast_2d(np.asarray(start, dtype=float))
    count = len(states)
    empty = PredictionWindows(
        start=states,
        track=np.zeros((count, seconds + 1, 3)),
        wind=np.broadcast_to(np.asarray(wind, dtype=float), (count, 2)).copy(),
        control=np.tile([2.5, 0.0, 2.5, 0.0, 0.0], (count, 1)),
        trial=np.array(["trial"] * count),
        leg=np.array([f"trial/{number:03d}" for number in range(count)]),
        start_ns=STARTED_NS + np.arange(count) * 60 * NANO,
        past=np.full((count, PAST_S + 1, 13), np.nan),
    )
    return replace(empty, track=constant_velocity(empty))


def random_windows(count: int, seconds: int, seed: int = 0) -> PredictionWindows:
    """Ships anywhere, on any heading, at a few metres a second, turning a little, in some wind."""
    random = np.random.default_rng(seed)
    low = [-500.0, -500.0, -np.pi, 2.0, -0.3, -0.02]
    high = [500.0, 500.0, np.pi, 5.0, 0.3, 0.02]
    windows = windows_at(random.uniform(low, high, (count, 6)), seconds)
    return replace(windows, wind=random.uniform([-np.pi, 0.0], [np.pi, 8.0], (count, 2)))


def voyages(plant: Plant, count: int, seconds: int, seed: int = 0, *, legs: int = 6) -> PredictionWindows:
    """Windows, each with the minute before, of ships that are ``plant`` to the letter and measured exactly.

    Every ship starts anywhere, shifts both pods once in the first half of the minute and holds them from there on,
    in a wind of her own. The windows are dealt out to ``legs`` legs.
    """
    random = np.random.default_rng(seed)
    low = [-500.0, -500.0, -np.pi, 2.5, -0.1, -0.005]
    high = [500.0, 500.0, np.pi, 4.5, 0.1, 0.005]
    control = np.zeros((count, PAST_S + seconds + 1, 5))
    shifted = np.arange(control.shape[1]) >= random.integers(5, PAST_S // 2, (count, 1))
    for shaft, angle in ((0, 1), (2, 3)):
        control[..., shaft] = random.uniform(2.0, 3.0, (count, 1)) + 0.2 * shifted
        control[..., angle] = np.deg2rad(random.uniform(-8.0, 8.0, (count, 1)) + 4.0 * shifted)
    wind = np.repeat(random.uniform([-np.pi, 0.0], [np.pi, 8.0], (count, 1, 2)), control.shape[1], axis=1)
    acting = 0.5 * (control[:, 1:] + control[:, :-1])
    runs = simulate_batch(plant, random.uniform(low, high, (count, 6)), acting, wind[:, 1:], 1.0)
    measured = np.concatenate([runs.states, wind, control], axis=2)
    now = measured[:, PAST_S]
    return PredictionWindows(
        start=now[:, :6].copy(),
        track=measured[:, PAST_S:, :3].copy(),
        wind=now[:, 6:8].copy(),
        control=now[:, 8:].copy(),
        trial=np.array(["trial"] * count),
        leg=np.array([f"trial/{number % legs:03d}" for number in range(count)]),
        start_ns=STARTED_NS + np.arange(count) * 120 * NANO,
        past=measured[:, PAST_S::-1].copy(),
    )


def moved(windows: PredictionWindows, north_m: float, east_m: float, turn_rad: float = 0.0) -> PredictionWindows:
    """The same windows in another place and on another heading, the wind turned with them."""
    start, track, wind, past = (each.copy() for each in (windows.start, windows.track, windows.wind, windows.past))
    for states in (start, track, past):
        states[..., :2] = turned(states[..., :2], turn_rad) + np.array([north_m, east_m])
        states[..., 2] += turn_rad
    wind[:, 0] += turn_rad
    past[..., 6] += turn_rad
    return replace(windows, start=start, track=track, wind=wind, past=past)


def turned(points: Floats, turn_rad: float) -> Floats:
    """North and east [..., 2] turned about the origin, clockwise from above."""
    sine, cosine = np.sin(turn_rad), np.cos(turn_rad)
    north, east = points[..., 0], points[..., 1]
    return np.stack([north * cosine - east * sine, north * sine + east * cosine], axis=-1)


def answers(calibrator: Calibrator, windows: PredictionWindows, reference: Floats) -> tuple[Floats, Floats, Bools]:
    """All that a calibrator says of windows: tracks, their uncertainty, and which lie outside its domain."""
    return (*calibrator.predict_with_uncertainty(windows, reference), calibrator.outside_domain(windows, reference))
