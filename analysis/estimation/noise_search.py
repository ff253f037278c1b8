"""The search for noise levels: what a choice of them costs, and the way down to the least cost.

The cost is minus twice the logarithm of the likelihood of a filter's innovations (Schweppe 1965) in which the
square of each counts only up to the gate. What is searched for and from where is in :mod:`.noise_levels`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.estimation.kalman import Gate, Start, Steps, arguments
from analysis.estimation.process_models import Law, Model, WaveMotion, WhiteJerk

LEAST = {"position": 1e-4, "heading": 1e-5, "speed": 1e-4, "yaw_rate": 1e-6}
"""The least noise that is searched for, SI."""
CALM, _WAVY = 3, 6  # numbers without waves, and with them but without their direction
LEAST_JERK, MOST_JERK = 1e-7, 1e2
_LONGEST_WAVE_S, _DAMPINGS = 20.0, (0.02, 0.6)
_STARTS, _MOST_STEPS, _MOST_TRIES, _MOST_VIEWS = 2, 20, 5, 12
_DIFFERENCE, _LONGEST_STEP, _ENOUGH = 1e-4, 1.5, 0.2  # of logarithms, and of the cost

Parts = Sequence[tuple[Steps, Start]]


@dataclass(frozen=True)
class Search:
    """What is searched for: two noise levels, a jerk and waves, for steps that are given with unit noise.

    ``level_of`` [channels] tells which level is whose, ``added`` is variance that comes on top, by part.
    """

    parts: Parts
    quantities: tuple[int, ...]
    level_of: NDArray[np.int64]
    first: Floats
    least: tuple[float, float]
    gate: Gate
    added: Sequence[Floats] = ()
    order: int = 2

    def cost(self, logs: Floats) -> float:
        """Minus twice the log-likelihood; each innovation's square counts up to the gate."""
        return self.total(*self.innovations(logs))

    def total(self, innovation: Floats, variance: Floats) -> float:
        """The cost of innovations and their variances; a refused one's does not fall with its variance."""
        enough = np.maximum(variance, innovation**2 / self.gate.limit)
        return float((np.log(enough) + innovation**2 / enough).sum())

    def innovations(self, logs: Floats) -> tuple[Floats, Floats]:
        """All innovations and their variances at the logarithms of levels, jerk and, if they go on, wave motion."""
        from analysis.estimation.kalman_compiled import innovations_of

        levels = np.exp(logs)
        across, direction_rad = across_of(logs)
        laws: list[Law] = []
        for share in (1.0, across)[: len(self.quantities)]:
            laws.append(WhiteJerk(float(levels[2])))
            if levels.size > CALM:
                laws.append(WaveMotion(share * float(levels[3]), float(levels[4]), float(levels[5]), self.order))
        quantities = np.repeat(self.quantities, len(laws) // len(self.quantities))
        model = Model(tuple(quantities.tolist()), tuple(laws), direction_rad)
        if (len(laws), direction_rad) not in self._views:
            if len(self._views) > _MOST_VIEWS:
                self._views.clear()
            view = self._joined.seen_by(model), self._mean @ model.sums * model.may_jump
            self._views[len(laws), direction_rad] = view
        steps, mean = self._views[len(laws), direction_rad]
        steps = replace(steps, variance=self._joined.variance * levels[self.level_of] ** 2 + self._added)
        start = replace(self.parts[0][1].seen_by(model), mean=mean)
        blocks = model.blocks_over(self._intervals_s)
        innovation, variance = innovations_of(*arguments(steps, start, model, self.gate, blocks), self._begins)
        return innovation[self._there], variance[self._there]

    @cached_property
    def _views(self) -> dict[tuple[int, float], tuple[Steps, Floats]]:
        """The steps and starts as a model of so many laws and a direction sees them, whatever its levels."""
        return {}

    @cached_property
    def _joined(self) -> Steps:
        """The steps of all parts in one."""
        every = [steps for steps, _ in self.parts]
        time_s, value, row, variance = (
            np.concatenate([getattr(each, name) for each in every])
            for name in ("time_s", "value", "row", "variance")
        )
        return Steps(time_s, value, row, variance, every[0].turn, every[0].jumps)

    @cached_property
    def _there(self) -> NDArray[np.bool_]:
        return np.isfinite(self._joined.value)

    @cached_property
    def _begins(self) -> NDArray[np.bool_]:
        """Where a part begins [steps]."""
        return np.concatenate([np.arange(steps.time_s.size) == 0 for steps, _ in self.parts])

    @cached_property
    def _mean(self) -> Floats:
        """Where each step's part begins [steps, 9]."""
        return np.concatenate([np.tile(start.mean, (steps.time_s.size, 1)) for steps, start in self.parts])

    @cached_property
    def _added(self) -> Floats | float:
        return np.concatenate(list(self.added)) if self.added else 0.0

    @cached_property
    def _intervals_s(self) -> Floats:
        """The time before each step of all parts, 0 before the first of each."""
        return np.where(self._begins, 0.0, np.diff(self._joined.time_s, prepend=self._joined.time_s[:1]))

    @property
    def count(self) -> int:
        """How many values there are."""
        return int(self._there.sum())

    @property
    def first_logs(self) -> Floats:
        """The logarithms of the first idea of the two levels."""
        return np.asarray(np.log(np.maximum(self.first, 3.0 * np.array(self.least))))

    @property
    def shortest_wave_s(self) -> float:
        """The shortest wave that the steps can tell from noise: three of them."""
        return 3.0 * float(np.median(np.diff(self.parts[0][0].time_s))) if self.parts[0][0].time_s.size > 1 else 3.0

    @property
    def wave_bounds(self) -> Floats:
        """Where the waves' speed, frequency and damping may be [3, 2], as logarithms."""
        fastest = 2 * np.pi / self.shortest_wave_s
        return np.log([(1e-6, 1e2), (2 * np.pi / _LONGEST_WAVE_S, fastest), _DAMPINGS])

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Where levels and jerk may be, as logarithms."""
        noises = [(float(np.log(least)), float(np.log(1e4))) for least in self.least]
        return [*noises, (float(np.log(LEAST_JERK)), float(np.log(MOST_JERK)))]


def across_of(logs: Floats) -> tuple[float, float]:
    """How large the swing is across its direction, and the direction [rad]; 1 and 0 if that is not among them."""
    return (float(np.exp(logs[_WAVY])), float(logs[_WAVY + 1])) if logs.size > _WAVY else (1.0, 0.0)


def descended(
    search: Search, guesses: Sequence[Floats], bounds: Sequence[tuple[float, float]]
) -> tuple[Floats, float]:
    """The lowest cost that is found downhill from the best of the guesses, and where."""
    low, high = np.array(bounds).T
    ends = [
        downhill(search, np.clip(each, low, high), low, high) for each in sorted(guesses, key=search.cost)[:_STARTS]
    ]
    return min(ends, key=lambda end: end[1])


def downhill(search: Search, logs: Floats, low: Floats, high: Floats) -> tuple[Floats, float]:
    """Fisher scoring, damped as Levenberg and Marquardt do: steps that the innovations' information gives.

    The gradient and the expected curvature of the cost both follow from the derivatives of innovations and
    variances (Gupta and Mehra 1974), which differences give.
    """
    damping, cost = 1e-2, search.cost(logs)
    for _ in range(_MOST_STEPS):
        gradient, curvature = _slope(search, logs)
        free = ~(((logs <= low) & (gradient > 0)) | ((logs >= high) & (gradient < 0)))
        before = cost
        for _ in range(_MOST_TRIES):
            damped = curvature + damping * np.diag(np.diag(curvature)) + 1e-6 * np.eye(logs.size)
            step = np.zeros(logs.size)
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], -gradient[free])
            tried = np.clip(logs + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP), low, high)
            found = search.cost(tried)
            if found < cost:
                logs, cost, damping = tried, found, damping / 5.0
                break
            damping *= 8.0
        if before - cost < _ENOUGH:
            break
    return logs, cost


def _slope(search: Search, logs: Floats) -> tuple[Floats, Floats]:
    """Gradient [levels] and expected curvature [levels, levels] of the cost."""
    innovation, variance = search.innovations(logs)
    changed = [search.innovations(logs + _DIFFERENCE * unit) for unit in np.eye(logs.size)]
    moved = np.stack([(each - innovation) / np.sqrt(variance) for each, _ in changed]) / _DIFFERENCE
    grown = np.stack([np.log(each / variance) for _, each in changed]) / _DIFFERENCE
    ratio = innovation / np.sqrt(variance)
    kept = ratio**2 < search.gate.limit
    moved, grown = moved * kept, grown * kept
    return grown @ (1.0 - ratio**2) + 2.0 * moved @ ratio, grown @ grown.T + 2.0 * moved @ moved.T
