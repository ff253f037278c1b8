"""Kalman filter and fixed-interval smoother for measurements at any times, over sums of :mod:`.process_models`.

The state consists of blocks, each a quantity with its derivatives; a quantity may be the sum of two blocks,
slow motion and waves. At each step every channel may have one value, with its own measurement row. A value
whose innovation lies beyond the gate is rejected. If a channel has been rejected for long, the true quantity
may have jumped: its variance is then increased by the size of the jump, and the channel is accepted.

Two engines give the same numbers: filterpy's (Labbe), at the end of this file, which reads like a textbook, and
the compiled recursion of :mod:`.kalman_kernel`, about a hundred times faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.analysis.estimation.process_models import ProcessModel

Engine = Literal["auto", "filterpy", "compiled"]

LONGEST_FOR_FILTERPY = 600
"""The largest number of steps for which the engine "auto" is filterpy: well below a second."""


@dataclass(frozen=True, slots=True)
class Gate:
    """The innovation gate: a value is rejected beyond ``limit`` = squared innovation over its variance
    (chi-square, 1 degree of freedom; 25 is five standard deviations), unless its channel has been rejected for
    ``patience_s`` and ``patience`` times."""

    limit: float = 25.0
    patience_s: float = 5.0
    patience: int = 4


@dataclass(frozen=True, slots=True)
class Steps:
    """Measurements step by step: increasing times, values and their measurement model.

    ``time_s`` [steps]; ``value`` [steps, channels], NaN without measurement; ``row`` [steps, channels, states];
    ``variance`` [steps, channels]; ``turn`` [channels], the period of a circular channel, else 0; ``jumps``
    [channels, states], the states released after a jump of a channel.
    """

    time_s: Floats
    value: Floats
    row: Floats
    variance: Floats
    turn: Floats
    jumps: Bools

    def for_model(self, model: ProcessModel) -> Steps:
        """The steps for the model's states, several of which may add up to one quantity; only slow ones may
        jump."""
        row, jumps = self.row @ model.summing_matrix, (self.jumps @ (model.summing_matrix != 0)) & model.may_jump
        return Steps(self.time_s, self.value, row, self.variance, self.turn, jumps)


@dataclass(frozen=True, slots=True)
class Start:
    """The initial state: ``mean`` [states], or [stretches, states], and ``covariance`` [states, states]."""

    mean: Floats
    covariance: Floats

    def for_model(self, model: ProcessModel) -> Start:
        """The initial state for the model's states: wave motion at its stationary covariance, slow motion as
        given."""
        covariance = np.zeros((model.may_jump.size,) * 2)
        mean = (self.mean @ model.summing_matrix) * model.may_jump
        for quantity, law, block in zip(model.quantities, model.laws, model.blocks, strict=True):
            place = slice(3 * quantity, 3 * quantity + 3)
            swing = law.covariance
            covariance[block, block] = self.covariance[place, place] if swing is None else swing
        return Start(mean, covariance)


@dataclass(frozen=True, slots=True)
class FilteredStates:
    """Filtered states, mean [steps, states] and covariance, with the innovations.

    ``innovation`` and its standard ``deviation`` [steps, channels] are NaN without measurement.
    """

    mean: Floats
    covariance: Floats
    innovation: Floats
    deviation: Floats
    refused: Bools


@dataclass(frozen=True, slots=True)
class Track:
    """Smoothed states, ``mean`` [steps, states], and what interpolation needs.

    ``costate`` [steps, states] and ``information`` [steps, states, states] are the corrections of each step's
    predicted state from this and all later steps (Bryson and Frazier 1963).
    """

    time_s: Floats
    mean: Floats
    costate: Floats
    information: Floats
    filtered: FilteredStates
    model: ProcessModel

    @property
    def covariance(self) -> Floats:
        """The covariance of the smoothed state at each step [steps, states, states]."""
        return self.interpolate_states(self.time_s)[1]

    def interpolate_states(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Mean [times, states] and covariance at any times from the first step on, exact for the model.

        The filtered state before each time is predicted, and corrected with all later steps. Beyond the last
        step it is the prediction.
        """
        before = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, None)
        after = np.minimum(before + 1, self.time_s.size - 1)
        mean, covariance = predict_states(
            self.filtered.mean[before], self.filtered.covariance[before], time_s - self.time_s[before], self.model
        )
        inside = after > before
        forward = self.model.transition(np.where(inside, self.time_s[after] - time_s, 0.0)) * inside[:, None, None]
        onward = forward @ covariance
        mean = mean - np.einsum("kji,kj->ki", onward, self.costate[after])
        return mean, covariance - onward.transpose(0, 2, 1) @ self.information[after] @ onward


def predict_states(mean: Floats, covariance: Floats, dt_s: Floats, model: ProcessModel) -> tuple[Floats, Floats]:
    """States [k, states] and covariances after each of ``dt_s`` [k] without measurements."""
    forward, added, index = model.discretise(dt_s)
    forward = forward[index]
    return np.einsum("kij,kj->ki", forward, mean), forward @ covariance @ forward.transpose(0, 2, 1) + added[index]


def smooth_steps(steps: Steps, start: Start, model: ProcessModel, gate: Gate, engine: Engine = "auto") -> Track:
    """Filter forwards, smooth backwards. ``start`` is at the first step's time; all in the model's states."""
    if engine == "filterpy" or (engine == "auto" and steps.time_s.size <= LONGEST_FOR_FILTERPY):
        return filter_and_smooth(steps, start, model, gate)
    from seatrial.analysis.estimation.kalman_kernel import run_smoother

    edges = np.array([0, steps.time_s.size])
    F, interval, (innovation, variance, *filter_states) = filter_steps(
        steps, start.mean[None], start.covariance, edges, model, gate, keep=True
    )
    smoothed: tuple[Floats, Floats, Floats] = run_smoother(
        F, interval, steps.row, gate.limit, innovation, variance, *filter_states
    )
    refused = innovation**2 > gate.limit * variance
    _, mean, covariance = filter_states
    filtered = FilteredStates(mean, covariance, innovation, np.sqrt(variance), refused)
    return Track(steps.time_s, *smoothed, filtered, model)


def filter_steps(
    steps: Steps, starts: Floats, covariance: Floats, edges: Ints, model: ProcessModel, gate: Gate, *, keep: bool
) -> tuple[Floats, Ints, Any]:
    """Transitions, which of them leads to each step, and what the compiled filter gives: innovations and their
    variances, each [steps, channels], NaN without measurement, and with ``keep`` its gains, means and covariances.

    Stretches of steps begin and end at ``edges`` [stretches + 1], each with its mean in ``starts`` [stretches,
    states] and with ``covariance``.
    """
    from seatrial.analysis.estimation.kalman_kernel import WIDTH, run_filter

    dt_s = np.diff(steps.time_s, prepend=steps.time_s[:1])
    dt_s[edges[:-1]] = 0.0
    F, Q, interval = model.discretise(dt_s, WIDTH)
    filtered = run_filter(  # of every other array layout it would be compiled once more, for 4 s
        steps.time_s, np.ascontiguousarray(steps.value), steps.row, steps.variance, steps.turn, steps.jumps,
        F, Q, interval, edges, starts, covariance, gate.limit, gate.patience_s, gate.patience, keep,
    )  # fmt: skip
    return F, interval, filtered


def filter_and_smooth(steps: Steps, start: Start, model: ProcessModel, gate: Gate) -> Track:
    """As :func:`smooth_steps`, with filterpy's KalmanFilter and its RTS smoother."""
    from filterpy.kalman import KalmanFilter

    count, channels = steps.value.shape
    dt_s = np.diff(steps.time_s, prepend=steps.time_s[0])
    forward, added = model.transition(dt_s), model.process_noise(dt_s)
    kalman = KalmanFilter(dim_x=start.mean.size, dim_z=1)
    kalman.x, kalman.P = start.mean[:, None].copy(), start.covariance.copy()
    since_s, refusals = np.zeros(channels), np.zeros(channels, dtype=int)  # for how long a channel was rejected
    innovation, deviation = np.full((2, count, channels), np.nan)
    refused = np.zeros((count, channels), dtype=bool)
    states: tuple[list[Floats], ...] = ([], [], [], [])
    for k in range(count):
        if k > 0:
            kalman.predict(F=forward[k], Q=added[k])
        measured = np.flatnonzero(np.isfinite(steps.value[k]))
        waited = (steps.time_s[k] - since_s >= gate.patience_s) & (refusals >= gate.patience)
        released = _release_variances(kalman, steps, k, measured[waited[measured]], gate)
        kalman.P = kalman.P + released
        added[k] += released
        before = kalman.x[:, 0].copy(), kalman.P.copy()
        for c in measured.tolist():
            error, variance = _innovation(kalman.x, kalman.P, steps, k, c)
            innovation[k, c], deviation[k, c] = error, np.sqrt(variance)
            refused[k, c] = error**2 > gate.limit * variance
            if refused[k, c]:
                since_s[c] = since_s[c] if refusals[c] else steps.time_s[k]
                refusals[c] += 1
            else:
                refusals[c] = 0
                row = steps.row[k, c][None, :]
                kalman.update(error + (row @ kalman.x).item(), R=steps.variance[k, c], H=row)
        for series, value in zip(states, (*before, kalman.x[:, 0].copy(), kalman.P.copy()), strict=True):
            series.append(value)
    prior_mean, prior, means, covariances = (np.stack(series) for series in states)
    mean, covariance, _, _ = kalman.rts_smoother(means, covariances, forward, added)
    costate = np.linalg.solve(prior, (prior_mean - mean)[..., None])[..., 0]
    half = np.linalg.solve(prior, prior - covariance).transpose(0, 2, 1)
    filtered = FilteredStates(means, covariances, innovation, deviation, refused)
    return Track(steps.time_s, mean, costate, np.asarray(np.linalg.solve(prior, half)), filtered, model)


def _innovation(x: Floats, P: Floats, steps: Steps, k: int, channel: int) -> tuple[float, float]:
    """A channel's innovation, wrapped if circular, and its variance."""
    row, turn = steps.row[k, channel], steps.turn[channel]
    error = float(steps.value[k, channel] - row @ x[:, 0])
    if turn > 0:
        error -= turn * np.round(error / turn)
    return error, float(row @ P @ row + steps.variance[k, channel])


def _release_variances(kalman: Any, steps: Steps, k: int, channels: Ints, gate: Gate) -> Floats:
    """The variance added for channels rejected for long."""
    released: Floats = np.zeros(kalman.P.shape)
    for c in channels.tolist():
        error, variance = _innovation(kalman.x, kalman.P + released, steps, k, c)
        along = np.where(steps.jumps[c], steps.row[k, c], 0.0)
        if error**2 > gate.limit * variance and along.any():
            released += (error / (along @ along)) ** 2 * np.outer(along, along)
    return released
