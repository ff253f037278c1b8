"""Process models of unmeasured motion, discretised exactly over any time step.

White jerk models a ship's slow motion, a damped oscillator its motion in waves, an Ornstein-Uhlenbeck process
what fluctuates about zero: unpredictable forces, sensor drift. All are linear and driven by white noise.
Observers that separate waves from the ship's slow motion go back to Balchen, Jenssen and Saelid 1976; Fossen
2011, chapter 11. The models (:class:`Law`) have the quantity and its derivatives as states, so that the same
measurement row serves each part of a quantity, slow motion and waves.

Their noise levels are those of maximum likelihood (:func:`most_likely`): the likelihood of a Kalman filter's
innovations (Schweppe 1965) is maximised by Fisher scoring with Levenberg-Marquardt damping: gradient and expected
information follow from the derivatives of innovations and variances (Gupta and Mehra 1974), taken as finite
differences of the filter. The normalised square of each innovation counts up to a limit, and beyond it does not
fall with growing variance, so outliers are not taken for noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, TypeAlias

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats, Ints

QUANTITIES = 3
_SAME_S = 1e-9
_CORNER = 1.1  # of the low-pass, relative to the wave frequency
_DIFFERENCE = 1e-4
_EASIER = 5.0
NEARLY_ONE = 0.95
"""The absolute correlation above which two estimates cannot be separated."""
UNKNOWN = 0.8
"""The ratio of standard error to prior above which the data do not determine a parameter."""


def decay(dt_s: Floats | float, time_constant_s: Floats | float) -> Any:
    """The fraction [-] of an Ornstein-Uhlenbeck process with ``time_constant_s`` that remains after ``dt_s``.

    The added variance is one minus the square of the share, times the stationary variance (Uhlenbeck and
    Ornstein 1930).
    """
    return np.exp(-dt_s / time_constant_s)


def oscillator(dt_s: Floats | float, frequency_radps: Floats | float, damping: float) -> tuple[Any, Any, Any, Any]:
    """A damped oscillator's displacement and speed after ``dt_s``: the transition's elements, row by row.

    ``damping`` is the share of critical damping, below one (Fossen 2011, section 11.3: the waves' motion). Driven
    by white noise in its speed, its stationary variances are s^2 and (frequency s)^2, uncorrelated.
    """
    damped = frequency_radps * np.sqrt(1.0 - damping * damping)
    envelope, cosine, sine = np.exp(-damping * frequency_radps * dt_s), np.cos(damped * dt_s), np.sin(damped * dt_s)
    lead = damping * frequency_radps / damped * sine
    return (
        envelope * (cosine + lead),
        envelope * sine / damped,
        -envelope * frequency_radps * frequency_radps / damped * sine,
        envelope * (cosine - lead),
    )


@dataclass(frozen=True, slots=True)
class WhiteJerk:
    """The third derivative is white noise; ``jerk`` is the root of its spectral density, unit/s3 per root Hz.

    Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3: the Wiener process acceleration model. Its covariance grows
    without bound.
    """

    jerk: float
    may_jump: bool = True
    size: int = 3
    covariance: None = None

    def discretise(self, dt_s: Floats) -> tuple[Floats, Floats]:
        """Transition and added covariance over each of ``dt_s`` [k]: twice [k, size, size]."""
        forward, added = np.zeros((2, dt_s.size, 3, 3))
        forward[:, [0, 1, 2], [0, 1, 2]] = 1.0
        forward[:, 0, 1] = forward[:, 1, 2] = dt_s
        forward[:, 0, 2] = dt_s**2 / 2.0
        powers = {(0, 0): (5, 20), (0, 1): (4, 8), (0, 2): (3, 6), (1, 1): (3, 3), (1, 2): (2, 2), (2, 2): (1, 1)}
        for (i, j), (power, divisor) in powers.items():
            added[:, i, j] = added[:, j, i] = self.jerk**2 * dt_s**power / divisor
        return forward, added


@dataclass(frozen=True, slots=True)
class WaveMotion:
    """Wave motion: :func:`oscillator`, driven by low-pass filtered noise.

    ``speed`` is the standard deviation of the first derivative, ``frequency_radps`` the oscillator's frequency
    and ``damping`` its share of critical damping, which sets the spectrum's width. The low-pass (Butterworth,
    of order 2 or 3) has its corner slightly higher, so that no two roots coincide. The position spectrum falls
    with the power 4 + 2 ``order`` of frequency above the peak: that of the sea surface falls with the fifth,
    and a hull averages short waves over its draught and, for yaw more than for translation, along its length.
    The state has derivatives up to ``order`` + 1. With order 0 there is no low-pass and the state is that of
    :func:`oscillator`, which the diagnosis uses, since it needs no acceleration.
    """

    speed: float
    frequency_radps: float
    damping: float
    order: int = 2
    may_jump: bool = False

    @property
    def size(self) -> int:
        return 2 + self.order

    @property
    def _system(self) -> Floats:
        """The system with the time in units of 1 / frequency."""
        polynomial = np.polymul([1.0, 2 * self.damping, 1.0], _butterworth_polynomial(self.order))
        system = np.eye(self.size, k=1)
        system[-1] = -polynomial[:0:-1]
        return system

    @property
    def _powers(self) -> Floats:
        """What turns derivatives by the system's own time into those by seconds [size]."""
        return np.asarray(self.frequency_radps ** np.arange(self.size))

    @property
    def covariance(self) -> Floats:
        """The stationary covariance of the wave motion [size, size]."""
        return _stationary_covariance(self)

    def discretise(self, dt_s: Floats) -> tuple[Floats, Floats]:
        """As :meth:`WhiteJerk.discretise`."""
        roots, vectors = np.linalg.eig(self._system)
        powers = np.exp(roots * self.frequency_radps * dt_s[:, None])
        forward = np.real(np.einsum("ij,kj,jl->kil", vectors, powers, np.linalg.inv(vectors)))
        forward *= self._powers[:, None] / self._powers
        stationary = self.covariance
        added = stationary - forward @ stationary @ forward.transpose(0, 2, 1)
        return forward, (added + added.transpose(0, 2, 1)) / 2.0


@cache
def _butterworth_polynomial(order: int) -> Floats:
    """The polynomial of a Butterworth filter whose corner is at :data:`_CORNER`."""
    angles = np.pi * (2 * np.arange(order) + order + 1) / (2 * order)
    return np.asarray(np.real(np.poly(_CORNER * np.exp(1j * angles))))


@lru_cache(maxsize=64)
def _stationary_covariance(motion: WaveMotion) -> Floats:
    """The covariance of a wave motion, which a filter asks for at its start and for its transitions."""
    identity, system, drive = np.eye(motion.size), motion._system, np.zeros((motion.size, motion.size))
    drive[-1, -1] = 1.0
    lyapunov = np.kron(system, identity) + np.kron(identity, system)
    powers = np.outer(motion._powers, motion._powers)
    unit = np.linalg.solve(lyapunov, -drive.ravel()).reshape(drive.shape) * powers
    covariance = np.asarray(unit * motion.speed**2 / unit[1, 1])
    covariance.setflags(write=False)
    return covariance


Law: TypeAlias = WhiteJerk | WaveMotion
"""A process model of a quantity and its first derivatives, ``size`` states, two at least; ``may_jump`` says whether
the quantity may jump, as slow motion may and wave motion may not."""


@dataclass(frozen=True, slots=True)
class ProcessModel:
    """Blocks of states, each a process model of one of the three quantities, or a part of it.

    Wave motion of quantities 1 and 2, north and east, is along and across ``direction_rad`` instead.
    """

    quantities: tuple[int, ...]
    laws: tuple[Law, ...]
    direction_rad: float = 0.0

    @property
    def sizes(self) -> Ints:
        """The number of states of each block."""
        return np.array([law.size for law in self.laws], dtype=np.int64)

    @property
    def blocks(self) -> list[slice]:
        """Where each block's states are."""
        ends = np.cumsum(self.sizes).tolist()
        return [slice(end - law.size, end) for end, law in zip(ends, self.laws, strict=True)]

    @property
    def may_jump(self) -> Bools:
        """For each state, whether it may jump."""
        return np.repeat([law.may_jump for law in self.laws], self.sizes)

    @property
    def summing_matrix(self) -> Floats:
        """The matrix [9, states] that sums each quantity and its two derivatives."""
        matrix = np.zeros((3 * QUANTITIES, int(self.sizes.sum())))
        cos, sin = np.cos(self.direction_rad), np.sin(self.direction_rad)
        turned = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
        for quantity, law, block in zip(self.quantities, self.laws, self.blocks, strict=True):
            shares = np.eye(QUANTITIES)[quantity] if law.may_jump else turned[:, quantity]
            for derivative in range(3):
                matrix[derivative::3, block.start + derivative] = shares
        return matrix

    def discretise(self, dt_s: Floats, width: int = 0) -> tuple[Floats, Floats, Ints]:
        """The distinct intervals of ``dt_s`` [k]: transitions and process noises, and the index of each.

        Both are [distinct, states, states], or padded with zeros to ``width`` columns; index [k].
        """
        rounded, index = np.unique(np.rint(dt_s / _SAME_S) * _SAME_S, return_inverse=True)
        states = int(self.sizes.sum())
        forward, added = np.zeros((2, rounded.size, states, max(states, width)))
        discretised = {law: law.discretise(rounded) for law in set(self.laws)}
        for law, block in zip(self.laws, self.blocks, strict=True):
            forward[:, block, block], added[:, block, block] = discretised[law]
        return forward, added, index

    def transition(self, dt_s: Floats) -> Floats:
        """The state's transition over each of ``dt_s`` [k]: [k, states, states]."""
        forward, _, index = self.discretise(dt_s)
        return forward[index]

    def process_noise(self, dt_s: Floats) -> Floats:
        """The covariance that is added over each of ``dt_s`` [k]: [k, states, states]."""
        _, added, index = self.discretise(dt_s)
        return added[index]


Innovations = Callable[[Floats], tuple[Floats, Floats]]
"""Innovations and their variances, both [values], at parameters [p]."""


@dataclass(frozen=True, slots=True)
class ScoringSettings:
    """Settings of the search; parameters are logarithms of levels, or angles.

    ``limit`` clips the normalised square of an innovation; at most ``most_steps`` of at most ``longest_step``
    in each parameter; ``damping`` is the initial value and the factor after a step without gain, at most
    ``tries`` times; the search ends below a gain of ``enough`` in minus twice the log likelihood.
    """

    limit: float = 25.0
    most_steps: int = 20
    longest_step: float = 1.5
    damping: tuple[float, float] = (1e-2, 8.0)
    tries: int = 5
    enough: float = 0.2


@dataclass(frozen=True, slots=True)
class Prior:
    """A normal prior on the parameters with ``mean`` [p] and a common standard ``deviation``; infinite for
    none."""

    mean: Floats
    deviation: float

    def cost(self, at: Floats) -> float:
        """Minus twice its log density, up to a constant."""
        return float((((at - self.mean) / self.deviation) ** 2).sum())


def robust_cost(innovation: Floats, variance: Floats, limit: float) -> float:
    """Minus twice the log likelihood of innovations, up to a constant; squares count up to ``limit`` variances."""
    bounded = np.maximum(variance, innovation**2 / limit)
    return float((np.log(bounded) + innovation**2 / bounded).sum())


def most_likely(
    innovations: Innovations,
    start: Floats,
    low: Floats,
    high: Floats,
    settings: ScoringSettings,
    prior: Prior | None = None,
) -> tuple[Floats, float]:
    """Maximise the likelihood over parameters [p] between ``low`` and ``high``, from ``start``; returns them
    and their cost.

    The cost is :func:`robust_cost` plus the prior's. A step without gain is retried with more damping.
    """
    prior = prior or Prior(start, np.inf)

    def cost(at: Floats, outcome: tuple[Floats, Floats]) -> float:
        return robust_cost(*outcome, settings.limit) + prior.cost(at)

    current, damping, evaluation = start, settings.damping[0], innovations(start)
    value = cost(current, evaluation)
    for _ in range(settings.most_steps):
        gradient, information = score_and_curvature(innovations, current, evaluation, settings.limit)
        gradient = gradient + 2.0 * (current - prior.mean) / prior.deviation**2
        information = information + 2.0 * np.eye(current.size) / prior.deviation**2
        free = ~(((current <= low) & (gradient > 0)) | ((current >= high) & (gradient < 0)))
        before = value
        for _ in range(settings.tries):
            damped = information + damping * np.diag(np.diag(information)) + 1e-6 * np.eye(current.size)
            step = np.zeros(current.size)
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], -gradient[free])
            tried = np.clip(current + np.clip(step, -settings.longest_step, settings.longest_step), low, high)
            tried_evaluation = innovations(tried)
            if cost(tried, tried_evaluation) < value:
                current, evaluation, value, damping = (
                    tried,
                    tried_evaluation,
                    cost(tried, tried_evaluation),
                    damping / _EASIER,
                )
                break
            damping *= settings.damping[1]
        if before - value < settings.enough:
            break
    return current, value


def score_and_curvature(
    innovations: Innovations, at: Floats, evaluation: tuple[Floats, Floats], limit: float
) -> tuple[Floats, Floats]:
    """Gradient [p] and expected curvature [p, p] of :func:`robust_cost` at parameters that gave ``evaluation``.

    Half the curvature is Fisher's information: its inverse is the covariance of the estimate.
    """
    innovation, variance = evaluation
    deviation = np.sqrt(variance)
    ratio = innovation / deviation
    inside = ratio**2 < limit
    moved, grown = np.empty((2, at.size, innovation.size))
    for number, unit in enumerate(np.eye(at.size)):
        shifted, shifted_variance = innovations(at + _DIFFERENCE * unit)
        moved[number] = (shifted - innovation) / deviation / _DIFFERENCE * inside
        grown[number] = np.log(shifted_variance / variance) / _DIFFERENCE * inside
    return grown @ (1.0 - ratio**2) + 2.0 * moved @ ratio, grown @ grown.T + 2.0 * moved @ moved.T


def correlated_pairs(names: Sequence[str], correlation: Floats) -> list[tuple[str, str, float]]:
    """Pairs of ``names`` [P] with strongly correlated estimates, and their correlation, from the matrix [P, P].

    >>> correlated_pairs(["mass", "drag"], np.array([[1.0, -0.97], [-0.97, 1.0]]))
    [('drag', 'mass', -0.97)]
    """
    return [
        (names[row], names[column], float(correlation[row, column]))
        for row in range(len(names)) for column in range(row) if abs(correlation[row, column]) > NEARLY_ONE
    ]  # fmt: skip
