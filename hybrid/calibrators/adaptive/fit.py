"""Adapting the vector: robust least squares on predicted tracks, with the prior.

Levenberg-Marquardt steps on the whitened differences between predicted and measured tracks, plus the prior.
Each second is scaled by its own median error, so that late seconds do not dominate; windows with events that no
model could know get less weight (Huber). Overlapping windows count only for the seconds that no other has.

Our own steps are needed since scales and weights are updated after each, and one costs sixty predictions of all
windows. ``scipy.optimize.least_squares`` with the same Jacobians (trf) reaches the same error, 0.081 m on
unseen windows, in 1.14 times the time; its lm 0.087 m, in the same time (tests/benchmarks/least_squares.py,
mean of 3 seeds).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import Bools, Floats, to_ship
from seatrial.hybrid.calibrators.adaptive.adaptation import parameter_names, run_observer
from seatrial.hybrid.prediction.kalman_filter import Observations
from seatrial.hybrid.vessel.plant import Plant

STEPS = 8
_OUTLYING = 1.5
_NUMBERS_A_WINDOW = 6.0  # independent numbers in a track: two in each of three coordinates
_LEAST = np.array([0.01, 0.01, 0.0005])  # lower bound on prediction errors [m, m, rad]
_USUAL_LENGTH_M = 30.0  # for a ship of this length; proportional to length
_DIFFERENCE = 1e-3
_ENOUGH = 2e-3
_GIVE_UP = 1e6
_STEEPEST = 1e6


def adapt(
    plant: Plant,
    windows: Observations,
    track: Floats,
    overlap: float,
    progress: Progress = lambda share: None,
    steps: int = STEPS,
) -> Floats:
    """The vector [parameters] for which predictions fit the measured tracks [N, H+1, 3].

    ``overlap`` is the share of a window that is its own, at most one. Seconds without a measured position are
    NaN and ignored.
    """
    differences_at, complete = _differences(plant, windows, track)
    vector, damping = np.zeros(len(parameter_names(plant.form))), 1e-3
    now = differences_at(vector)
    for step in range(steps):
        progress(step / steps)
        weight = _whitening(now, complete, overlap, plant)
        slope = _slope(differences_at, vector, now, weight)
        better = _step(differences_at, vector, now, slope, weight, damping)
        if better is None:
            break
        before, after, vector, now, damping = better
        if before - after < _ENOUGH * before:
            break
    return vector


def covariance_at(vector: Floats, plant: Plant, windows: Observations, track: Floats, overlap: float) -> Floats:
    """The covariance of the vector [parameters, parameters] at the minimum, by a quadratic approximation of the
    cost; in directions without data it is the prior's, one. Arguments as those of :func:`adapt`."""
    differences_at, complete = _differences(plant, windows, track)
    now = differences_at(vector)
    slope = _slope(differences_at, vector, now, _whitening(now, complete, overlap, plant))
    slope = slope[(np.abs(slope) < _STEEPEST).all(axis=1)]  # those at the edge of the model's range say nothing
    return np.asarray(np.linalg.inv(slope.T @ slope + np.eye(len(vector))))


def _differences(plant: Plant, windows: Observations, track: Floats) -> tuple[Callable[[Floats], Floats], Bools]:
    """A function for the differences [N, H, 3] between predictions with a vector and the tracks, in surge, sway
    and heading, and the known seconds [N, H]."""
    unknown = np.asarray(np.isnan(track[:, 1:]).any(axis=2))

    def off(vector: Floats) -> Floats:
        states, waves = run_observer(vector, plant, windows)
        gap = np.where(unknown[..., None], 0.0, (states[..., :3] + waves - track)[:, 1:])
        return np.stack([*to_ship(gap[..., 0], gap[..., 1], track[:, :1, 2]), gap[..., 2]], axis=-1)

    return off, ~unknown


def _whitening(now: Floats, complete: Bools, overlap: float, plant: Plant) -> Floats:
    """The factor of each difference [N, H, 3]: its second's scale, its window's weight."""
    scale = 1.48 * np.sqrt(_median_where(complete, now**2)) + _LEAST * min(
        1.0, plant.length_overall_m / _USUAL_LENGTH_M
    )
    return np.asarray(_weights(now / scale, overlap) / scale)


def _median_where(complete: Bools, squares: Floats) -> Floats:
    """The median over the windows in which a second is known and the model in its range: [H, 3]."""
    usable = complete[..., None] & np.isfinite(squares)
    ordered = np.sort(np.where(usable, squares, np.inf), axis=0)
    middle = (usable.sum(axis=0) // 2).clip(max=len(squares) - 1)
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.asarray(np.where(np.isfinite(median), median, 1.0))


def _weights(whitened: Floats, overlap: float) -> Floats:
    """The square root of each window's weight [N, 1, 1]; zero for windows outside the model's range."""
    size = np.sqrt(np.mean(whitened**2, axis=(1, 2)))
    finite = np.isfinite(size)
    robust = np.where(finite, np.minimum(1.0, _OUTLYING / np.maximum(np.where(finite, size, 1.0), 1e-9)), 0.0)
    share = overlap * _NUMBERS_A_WINDOW / (whitened.shape[1] * whitened.shape[2])
    return np.asarray(np.sqrt(share * robust))[:, None, None]


def _slope(differences_at: Callable[[Floats], Floats], vector: Floats, now: Floats, weight: Floats) -> Floats:
    """The derivative of the weighted differences with respect to each parameter [N H 3, parameters]."""
    columns = np.empty((now.size, len(vector)))
    for number in range(len(vector)):
        moved = vector.copy()
        moved[number] += _DIFFERENCE
        columns[:, number] = np.nan_to_num((differences_at(moved) - now) / _DIFFERENCE * weight).ravel()
    return columns


def _step(
    differences_at: Callable[[Floats], Floats],
    vector: Floats,
    now: Floats,
    slope: Floats,
    weight: Floats,
    damping: float,
) -> tuple[float, float, Floats, Floats, float] | None:
    """Costs before and after, vector, differences and damping after the first step that lowers the cost; None
    if none does."""
    counted = weight[:, 0, 0] > 0.0

    def cost(vector: Floats, differences: Floats) -> float:
        inside = (differences * weight)[counted]
        return float(np.sum(inside**2) + vector @ vector) if np.isfinite(inside).all() else np.inf

    normal = slope.T @ slope
    pull = slope.T @ np.nan_to_num(now * weight).ravel() + vector
    before = cost(vector, now)
    while damping < _GIVE_UP:
        damped = normal + np.eye(len(vector)) + damping * np.diag(1.0 + np.diag(normal))
        tried = vector - np.linalg.solve(damped, pull)
        then = differences_at(tried)
        after = cost(tried, then)
        if after < before:
            return before, after, tried, then, max(damping / 5.0, 1e-6)
        damping *= 6.0
    return None
