"""Filter and smoother of :mod:`analysis.estimation.kalman` by filterpy: what the compiled recursion is held to."""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from acquisition.core.arrays import Floats
from analysis.estimation.kalman import FilteredStates, Gate, Start, Steps, Track
from analysis.estimation.process_models import Model


class _Patience:
    """How long each channel has been refused."""

    def __init__(self, gate: Gate, channels: int) -> None:
        self._gate = gate
        self._since, self._times = np.zeros(channels), np.zeros(channels, dtype=int)

    def over(self, channel: int, time_s: float) -> bool:
        waited = time_s - self._since[channel] >= self._gate.patience_s
        return bool(waited and self._times[channel] >= self._gate.patience)

    def note(self, channel: int, time_s: float, refused: bool) -> None:
        if refused and self._times[channel] == 0:
            self._since[channel] = time_s
        self._times[channel] = self._times[channel] + 1 if refused else 0


def filter_and_smooth(steps: Steps, start: Start, model: Model, gate: Gate) -> Track:
    """As :func:`smooth_steps` says, by filterpy's KalmanFilter and its RTS smoother."""
    count, channels = steps.value.shape
    dt_s = np.diff(steps.time_s, prepend=steps.time_s[0])
    forward, added = model.transition(dt_s), model.process_noise(dt_s)
    kalman = KalmanFilter(dim_x=start.mean.size, dim_z=1)
    kalman.x, kalman.P = start.mean[:, None].copy(), start.covariance.copy()
    patience = _Patience(gate, channels)
    innovation, deviation = np.full((2, count, channels), np.nan)
    refused = np.zeros((count, channels), dtype=bool)
    states: tuple[list[Floats], ...] = ([], [], [], [])
    for k in range(count):
        if k > 0:
            kalman.predict(F=forward[k], Q=added[k])
        released = _released(kalman, steps, k, patience, gate)
        kalman.P = kalman.P + released
        added[k] += released
        before = kalman.x[:, 0].copy(), kalman.P.copy()
        for c in _present(steps, k):
            error, variance = _innovation(kalman, steps, k, c)
            innovation[k, c], deviation[k, c] = error, np.sqrt(variance)
            refused[k, c] = error**2 > gate.limit * variance
            patience.note(c, float(steps.time_s[k]), bool(refused[k, c]))
            if not refused[k, c]:
                row = steps.row[k, c][None, :]
                kalman.update(error + (row @ kalman.x).item(), R=steps.variance[k, c], H=row)
        for series, each in zip(states, (*before, kalman.x[:, 0].copy(), kalman.P.copy()), strict=True):
            series.append(each)
    prior_mean, prior, means, covariances = (np.stack(each) for each in states)
    mean, covariance, _, _ = kalman.rts_smoother(means, covariances, forward, added)
    costate = np.linalg.solve(prior, (prior_mean - mean)[..., None])[..., 0]
    half = np.linalg.solve(prior, prior - covariance).transpose(0, 2, 1)
    filtered = FilteredStates(means, covariances, innovation, deviation, refused)
    return Track(steps.time_s, mean, costate, np.asarray(np.linalg.solve(prior, half)), filtered, model)


def _present(steps: Steps, k: int) -> list[int]:
    """The channels that have a value at a step."""
    return [int(channel) for channel in np.flatnonzero(np.isfinite(steps.value[k]))]


def _innovation(kalman: Any, steps: Steps, k: int, channel: int) -> tuple[float, float]:
    """A channel's innovation, on its circle, and its variance."""
    row, turn = steps.row[k, channel], steps.turn[channel]
    error = float(steps.value[k, channel] - row @ kalman.x[:, 0])
    if turn > 0:
        error -= turn * np.round(error / turn)
    return error, float(row @ kalman.P @ row + steps.variance[k, channel])


def _released(kalman: Any, steps: Steps, k: int, patience: _Patience, gate: Gate) -> Floats:
    """The variance that channels refused for long add to what they see."""
    released: Floats = np.zeros(kalman.P.shape)
    before = kalman.P
    for c in _present(steps, k):
        if not patience.over(c, float(steps.time_s[k])):
            continue
        kalman.P = before + released
        error, variance = _innovation(kalman, steps, k, c)
        along = np.where(steps.jumps[c], steps.row[k, c], 0.0)
        if error**2 > gate.limit * variance and along.any():
            released += (error / (along @ along)) ** 2 * np.outer(along, along)
    kalman.P = before
    return released
