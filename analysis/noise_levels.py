"""Noise levels from the data themselves: those under which what was measured is the most likely.

A filter with the right levels predicts each value with an error that is as large as it says. The likelihood of
the innovations (Schweppe 1965) is largest there; it is computed on stretches spread over the recording, and each
innovation's square counts only up to the gate, so that outliers do not pass for noise. Heading and yaw rate come
first, by themselves; then position, speeds and the horizontal jerk, with the heading given.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from analysis.holding import noise_of
from analysis.kalman import Floats, Gate, Start, Steps, filter_steps, smooth_filtered
from analysis.motion_model import (
    EAST,
    HEADING,
    NORTH,
    SURGE,
    SWAY,
    YAW_RATE,
    Binned,
    first_heading,
    first_state,
    heading_steps,
    horizontal_steps,
    motion_steps,
)

STRETCHES, STEPS_OF_STRETCH = 16, 300
_LEAST = np.array([1e-4, 1e-5, 1e-4, 1e-6])  # position m, heading rad, speed m/s, yaw rate rad/s
_LEAST_JERK, _FIRST_JERKS = 1e-7, (1e-4, 1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Standard deviations of one sample's noise, and the jerk that drives the motion, all in SI.

    The jerks are roots of two-sided spectral densities: ``jerk`` in m/s3 and ``yaw_jerk`` in rad/s3, per root Hz.
    """

    position_m: float
    heading_rad: float
    speed_mps: float
    yaw_rate_radps: float
    jerk: float
    yaw_jerk: float

    @property
    def by_channel(self) -> Floats:
        """Standard deviations in the order of :data:`analysis.motion_model.CHANNELS`."""
        position, speed = [self.position_m] * 2, [self.speed_mps] * 2
        return np.array([self.heading_rad, self.yaw_rate_radps, *position, *speed])

    @property
    def density(self) -> Floats:
        """The jerks' spectral densities of heading, north and east."""
        return np.array([self.yaw_jerk, self.jerk, self.jerk]) ** 2

    def as_json(self) -> dict[str, float]:
        """The levels by name."""
        return asdict(self)


def estimate_levels(data: Binned, gate: Gate | None = None) -> NoiseLevels:
    """The levels of maximum likelihood of combined samples; a channel that is absent keeps the least level."""
    rules = gate or Gate()
    parts = _stretches(data)
    starts = _first_levels(data)
    heading_rad, yaw_rate_radps, yaw_jerk = _heading_levels(parts, starts, rules)
    horizontal = [_given_heading(part, heading_rad, yaw_rate_radps, yaw_jerk, rules) for part in parts]
    position_m, speed_mps, jerk = _horizontal_levels(horizontal, starts, rules)
    return NoiseLevels(position_m, heading_rad, speed_mps, yaw_rate_radps, jerk, yaw_jerk)


def _stretches(data: Binned) -> list[Binned]:
    """All of a short recording, else stretches spread evenly over it."""
    steps = data.time_s.size
    if steps <= STRETCHES * STEPS_OF_STRETCH:
        return [data]
    first = np.linspace(0, steps - STEPS_OF_STRETCH, STRETCHES).astype(int)
    return [data.part(start, start + STEPS_OF_STRETCH) for start in first]


def _first_levels(data: Binned) -> Floats:
    """A first idea of each channel's noise, from second differences."""
    series = data.value.copy()
    series[:, HEADING] = _unwrapped(series[:, HEADING])
    return np.array([noise_of(series[:, channel][np.isfinite(series[:, channel])]) for channel in range(6)])


def _unwrapped(angle_rad: Floats) -> Floats:
    there = np.isfinite(angle_rad)
    angle_rad[there] = np.unwrap(angle_rad[there])
    return angle_rad


def _heading_levels(parts: list[Binned], starts: Floats, gate: Gate) -> tuple[float, float, float]:
    steps = [heading_steps(part, 1.0, 1.0) for part in parts]
    begins = [first_state(part, first_heading(part)) for part in parts]
    cases = [
        (each, Start(begin.mean[:3], begin.covariance[:3, :3])) for each, begin in zip(steps, begins, strict=True)
    ]
    least = np.array([_LEAST[1], _LEAST[3]])
    return _most_likely(cases, np.array([0, 1]), starts[[HEADING, YAW_RATE]], least, 1, gate)


def _given_heading(
    part: Binned, heading_rad: float, yaw_rate_radps: float, yaw_jerk: float, gate: Gate
) -> tuple[Steps, Start, Floats]:
    """The horizontal steps of a part, with unit noise, its start and the variance the heading adds."""
    begin = first_state(part, first_heading(part))
    steps = heading_steps(part, heading_rad, yaw_rate_radps)
    density = np.array([yaw_jerk**2])
    filtered = filter_steps(steps, Start(begin.mean[:3], begin.covariance[:3, :3]), density, gate)
    track = smooth_filtered(part.time_s, filtered, density)
    everything = motion_steps(part, track.mean[:, 0], np.ones(6))
    turned = horizontal_steps(everything, track.mean, track.covariance[:, 0, 0])
    plain = horizontal_steps(everything, track.mean, np.zeros(part.time_s.size))
    return plain, Start(begin.mean[3:], begin.covariance[3:, 3:]), turned.variance - plain.variance


def _horizontal_levels(
    parts: list[tuple[Steps, Start, Floats]], starts: Floats, gate: Gate
) -> tuple[float, float, float]:
    first = np.array([starts[[NORTH, EAST]].mean(), starts[[SURGE, SWAY]].mean()])
    cases = [(steps, start) for steps, start, _ in parts]
    added = [extra for _, _, extra in parts]
    return _most_likely(cases, np.array([0, 0, 1, 1]), first, np.array([_LEAST[0], _LEAST[2]]), 2, gate, added)


def _most_likely(
    cases: list[tuple[Steps, Start]],
    level_of: np.ndarray[tuple[int], np.dtype[np.int64]],
    first: Floats,
    least: Floats,
    blocks: int,
    gate: Gate,
    added: list[Floats] | None = None,
) -> tuple[float, float, float]:
    """Two noise levels and one jerk for steps given with unit noise; ``level_of`` [channels] tells whose is whose.

    The search begins at the best of several jerks, five decades apart, and goes on in logarithms (Nelder and
    Mead 1965): levels are positive, and three of them are few.
    """
    from scipy.optimize import minimize

    from analysis.kalman_compiled import cost_of

    floors = np.log(np.append(least, _LEAST_JERK))

    def cost(logs: Floats) -> float:
        levels = np.exp(np.maximum(logs, floors))
        density = np.full(blocks, levels[2] ** 2)
        total = 0.0
        for number, (steps, start) in enumerate(cases):
            noise = steps.variance * levels[level_of] ** 2 + (added[number] if added else 0.0)
            total += cost_of(
                steps.time_s, steps.value, steps.row, noise, steps.turn, steps.jumps,
                start.mean, start.covariance, density, gate.limit, gate.patience_s, gate.patience,
            )  # fmt: skip
        return total + float(np.sum(np.maximum(floors - logs, 0.0)))

    begin = np.log(np.maximum(first, 3.0 * least))
    guesses = [np.append(begin, np.log(jerk)) for jerk in _FIRST_JERKS]
    best = min(guesses, key=cost)
    simplex = np.vstack([best, best + np.eye(3)])
    options = {"initial_simplex": simplex, "xatol": 0.01, "fatol": 0.05, "maxfev": 200}
    found = minimize(cost, best, method="Nelder-Mead", options=options).x
    position, speed, jerk = (float(level) for level in np.exp(np.maximum(found, floors)))
    return position, speed, jerk
