"""Kalman filter and Rauch-Tung-Striebel smoother over quantities that move by laws of :mod:`.process_models`.

The state is blocks, each a quantity with its derivatives; a quantity may be the sum of two
blocks, slow motion and waves. Steps come at any times; at each, every channel may have one value, which sees
the state through a row of its own. Channels are taken one after another, which for noise that is independent
between them is the same as taking them together, and lets each be judged by itself: one whose innovation lies
beyond the gate is refused. When a channel has been refused for long, the truth may have jumped: the quantity
that it sees is then set free by the size of the jump, and the channel is believed.

Two engines give the same numbers: filterpy, and a compiled recursion that is some hundred times faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from acquisition.core.arrays import Bools, Floats
from analysis.estimation.process_models import Model

Engine = Literal["auto", "filterpy", "compiled"]

LONGEST_FOR_FILTERPY = 600
"""Steps up to which the engine "auto" is filterpy: well below a second."""


@dataclass(frozen=True, slots=True)
class Gate:
    """When a value is refused: beyond ``limit`` = innovation squared over its variance (chi-square, 1 degree of
    freedom; 25 is five standard deviations), unless refused for ``patience_s`` and ``patience`` times."""

    limit: float = 25.0
    patience_s: float = 5.0
    patience: int = 4


@dataclass(frozen=True, slots=True)
class Steps:
    """What is measured, step by step: rising times, values and how they see the state.

    ``time_s`` [steps]; ``value`` [steps, channels], NaN where there is none; ``row`` [steps, channels, states];
    ``variance`` [steps, channels]; ``turn`` [channels], the period of a channel on the circle, else 0;
    ``jumps`` [channels, states], which states are set free when a channel has jumped.
    """

    time_s: Floats
    value: Floats
    row: Floats
    variance: Floats
    turn: Floats
    jumps: Bools

    def seen_by(self, model: Model) -> Steps:
        """The same steps on the model's states, of which several may add up to one; slow ones alone may jump."""
        row, jumps = self.row @ model.sums, (self.jumps @ (model.sums != 0)) & model.may_jump
        return Steps(self.time_s, self.value, row, self.variance, self.turn, jumps)

    def part(self, first: int, last: int) -> Steps:
        """The steps ``first`` to ``last``, the last one excluded."""
        some = slice(first, last)
        return Steps(
            self.time_s[some], self.value[some], self.row[some], self.variance[some], self.turn, self.jumps
        )


@dataclass(frozen=True, slots=True)
class Start:
    """What is known before the first step: ``mean`` [states] and ``covariance`` [states, states]."""

    mean: Floats
    covariance: Floats

    def seen_by(self, model: Model) -> Start:
        """The same on the model's states: a swing starts anywhere in it, what is slow as given here."""
        covariance = np.zeros((model.may_jump.size,) * 2)
        mean = (self.mean @ model.sums) * model.may_jump
        for quantity, law, own in zip(model.quantities, model.laws, model.blocks, strict=True):
            given = slice(3 * quantity, 3 * quantity + 3)
            swing = law.covariance
            covariance[own, own] = self.covariance[given, given] if swing is None else swing
        return Start(mean, covariance)


@dataclass(frozen=True, slots=True)
class Filtered:
    """The state at each step, before (``prior``) and after its values, and how they were received.

    ``innovation`` and ``spread`` (its standard deviation) [steps, channels] are NaN where there was no value.
    """

    prior_mean: Floats
    prior_covariance: Floats
    mean: Floats
    covariance: Floats
    innovation: Floats
    spread: Floats
    refused: Bools

    @property
    def nis(self) -> Floats:
        """Normalised innovation squared [steps, channels]; its mean is 1 for a filter that is right."""
        return np.asarray((self.innovation / self.spread) ** 2)


@dataclass(frozen=True, slots=True)
class Track:
    """A smoothed track of the state [steps, states], with its covariance and all that interpolation needs."""

    time_s: Floats
    mean: Floats
    covariance: Floats
    filtered: Filtered
    model: Model

    def at(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Mean [times, states] and covariance at any times from the first step on, exact for the model.

        From the filtered state before each time the motion is predicted, and one smoother step from the
        smoothed state after it corrects the prediction. Beyond the last step it is the prediction.
        """
        before = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, None)
        after = np.minimum(before + 1, self.time_s.size - 1)
        mean, covariance = predicted(
            self.filtered.mean[before], self.filtered.covariance[before], time_s - self.time_s[before], self.model
        )
        inside = after > before
        forward = self.model.transition(np.where(inside, self.time_s[after] - time_s, 0.0))
        prior = self.filtered.prior_covariance[after]
        gain = _gain(covariance, forward, prior) * inside[:, None, None]
        step = self.mean[after] - self.filtered.prior_mean[after]
        mean = mean + np.einsum("kij,kj->ki", gain, step)
        return mean, covariance + gain @ (self.covariance[after] - prior) @ gain.transpose(0, 2, 1)


def predicted(mean: Floats, covariance: Floats, dt_s: Floats, model: Model) -> tuple[Floats, Floats]:
    """States [k, states] and covariances after each of ``dt_s`` [k] without measurements."""
    forward = model.transition(dt_s)
    spread = forward @ covariance @ forward.transpose(0, 2, 1) + model.process_noise(dt_s)
    return np.einsum("kij,kj->ki", forward, mean), spread


def smooth_steps(steps: Steps, start: Start, model: Model, gate: Gate, engine: Engine = "auto") -> Track:
    """Filter forwards, smooth backwards. ``start`` holds at the first step's time; all on the model's states."""
    if engine == "filterpy" or (engine == "auto" and steps.time_s.size <= LONGEST_FOR_FILTERPY):
        from analysis.estimation.kalman_filterpy import filter_and_smooth

        return filter_and_smooth(steps, start, model, gate)
    return smooth_filtered(steps.time_s, filter_steps(steps, start, model, gate), model)


def filter_steps(steps: Steps, start: Start, model: Model, gate: Gate) -> Filtered:
    """The forward pass of the compiled engine."""
    from analysis.estimation.kalman_compiled import forward_pass

    return Filtered(*forward_pass(*arguments(steps, start, model, gate)))


def arguments(
    steps: Steps, start: Start, model: Model, gate: Gate, blocks: tuple[Floats, Floats] | None = None
) -> tuple[object, ...]:
    """What the compiled recursion takes; ``blocks`` are those of the model over the intervals, if known."""
    forward, added = blocks or model.blocks_over(np.diff(steps.time_s, prepend=steps.time_s[:1]))
    return (
        steps.time_s, steps.value, steps.row, steps.variance, steps.turn, steps.jumps, start.mean,
        start.covariance, model.sizes, forward, added, gate.limit, gate.patience_s, gate.patience,
    )  # fmt: skip


def smooth_filtered(time_s: Floats, filtered: Filtered, model: Model) -> Track:
    """The backward pass (Rauch, Tung and Striebel 1965) of the compiled engine."""
    from analysis.estimation.kalman_compiled import backward_pass

    gain = _gain(filtered.covariance[:-1], model.transition(np.diff(time_s)), filtered.prior_covariance[1:])
    mean, covariance = backward_pass(
        filtered.mean, filtered.covariance, filtered.prior_mean, filtered.prior_covariance, gain
    )
    return Track(time_s, mean, covariance, filtered, model)


def _gain(covariance: Floats, forward: Floats, prior: Floats) -> Floats:
    """P F' inv(prior), for each step."""
    return np.asarray(np.linalg.solve(prior, forward @ covariance).transpose(0, 2, 1))
