"""Noise levels from the data themselves: those under which what was measured is the most likely.

A filter with the right levels predicts each value with an error that is as large as it says. The likelihood of
the innovations (Schweppe 1965) is largest there; it is computed on stretches spread over the recording, and each
innovation's square counts only up to the gate, so that outliers do not pass for noise. Heading and yaw rate come
first, by themselves; then position and speeds, with the heading given. Waves are part of the model where they
make the data more likely by more than their three numbers would by chance (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from analysis.holding import noise_of
from analysis.kalman import Floats, Gate, Start, Steps, arguments, filter_steps, smooth_filtered
from analysis.motion_laws import Law, Model, WaveMotion, WhiteJerk
from analysis.motion_model import (
    EAST,
    HEADING,
    NORTH,
    SURGE,
    SWAY,
    YAW_RATE,
    Binned,
    first_state,
    heading_steps,
    horizontal_steps,
    motion_steps,
)

STRETCHES, STEPS_OF_STRETCH = 10, 200
_LEAST = {"position": 1e-4, "heading": 1e-5, "speed": 1e-4, "yaw_rate": 1e-6}
_JERKS, _LEAST_JERK, _MOST_JERK = (1e-4, 1e-3, 1e-2, 1e-1, 1.0), 1e-7, 1e2
_WAVE_PERIODS_S, _LONGEST_WAVE_S = (3.0, 5.0, 8.0, 12.0), 20.0
_SPEEDS, _YAW_SPEEDS = (0.05, 0.2, 0.8), (0.002, 0.01, 0.04)  # where the search for waves begins, m/s and rad/s
_DAMPINGS = (0.02, 0.6)
_CALM, _NO_WAVES, _NOTHING = 3, (0.0, 1.0, 0.3), np.zeros(3)

Parts = Sequence[tuple[Steps, Start]]


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Standard deviations of one sample's noise, and what drives the motion; SI, angles in radians.

    The jerks are roots of two-sided spectral densities: ``jerk`` in m/s3 and ``yaw_jerk`` in rad/s3, per root Hz.
    ``wave_speed`` [m/s] and ``yaw_wave_speed`` [rad/s] are the standard deviations of the speeds of the swing
    in waves, 0 where there is none; frequency [rad/s] and damping say how it swings.
    """

    position_m: float
    heading_rad: float
    speed_mps: float
    yaw_rate_radps: float
    jerk: float
    yaw_jerk: float
    wave_speed: float = 0.0
    wave_frequency_radps: float = 1.0
    wave_damping: float = 0.3
    yaw_wave_speed: float = 0.0
    yaw_wave_frequency_radps: float = 1.0
    yaw_wave_damping: float = 0.3

    @property
    def by_channel(self) -> Floats:
        """Standard deviations in the order of :data:`analysis.motion_model.CHANNELS`."""
        position, speed = [self.position_m] * 2, [self.speed_mps] * 2
        return np.array([self.heading_rad, self.yaw_rate_radps, *position, *speed])

    @property
    def yaw_laws(self) -> tuple[Law, ...]:
        """How the heading moves: slowly, and in waves where there are any."""
        waves = WaveMotion(self.yaw_wave_speed, self.yaw_wave_frequency_radps, self.yaw_wave_damping)
        return (WhiteJerk(self.yaw_jerk), *([waves] if self.yaw_wave_speed > 0 else []))

    @property
    def laws(self) -> tuple[Law, ...]:
        """How north and east move, each by itself."""
        waves = WaveMotion(self.wave_speed, self.wave_frequency_radps, self.wave_damping)
        return (WhiteJerk(self.jerk), *([waves] if self.wave_speed > 0 else []))

    @property
    def heading_model(self) -> Model:
        """The model of the heading alone."""
        return Model((0,) * len(self.yaw_laws), self.yaw_laws)

    @property
    def motion_model(self) -> Model:
        """The model of heading, north and east."""
        quantities = (0,) * len(self.yaw_laws) + (1,) * len(self.laws) + (2,) * len(self.laws)
        return Model(quantities, (*self.yaw_laws, *self.laws, *self.laws))

    def as_json(self) -> dict[str, float]:
        """The levels by name."""
        return asdict(self)


def estimate_levels(data: Binned, gate: Gate | None = None) -> NoiseLevels:
    """The levels of maximum likelihood of combined samples; a channel that is absent keeps a least level.

    Waves are looked for in the horizontal motion. Where there are any, the heading swings in them at much the
    same frequency; where there are none, what swings in the heading is the ship.
    """
    rules = gate or Gate()
    parts = _stretches(data)
    first = _first_levels(data)
    noise = np.array([first[[NORTH, EAST]].mean(), first[[SURGE, SWAY]].mean()])
    alone = [(heading_steps(part, 1.0, 1.0), first_state(part)) for part in parts]
    turning = _Search(alone, (0,), np.array([0, 1]), first[[HEADING, YAW_RATE]],
                      (_LEAST["heading"], _LEAST["yaw_rate"]), rules)  # fmt: skip
    yaw_calm = _calm(turning)
    yaw = yaw_calm[0]
    given = [_given_heading(part, _levels(_NOTHING, yaw), rules) for part in parts]
    moving = _Search([(steps, start) for steps, start, _ in given], (1, 2), np.array([0, 0, 1, 1]), noise,
                     (_LEAST["position"], _LEAST["speed"]), rules, [added for *_, added in given])  # fmt: skip
    calm = _calm(moving)
    horizontal = _with_waves(moving, calm, _SPEEDS, [2 * np.pi / period for period in _WAVE_PERIODS_S])
    if horizontal.size > _CALM:
        yaw = _with_waves(
            turning, _calm(turning), _YAW_SPEEDS, float(np.exp(horizontal[4])) * np.array([1.0, 1.25])
        )
    return _levels(horizontal, yaw)


def _levels(horizontal: Floats, yaw: Floats) -> NoiseLevels:
    """The levels from logarithms: two noises, a jerk and, if they go on, waves."""
    position_m, speed_mps, jerk, *waves = (float(each) for each in np.exp(horizontal))
    heading_rad, yaw_rate_radps, yaw_jerk, *yaw_waves = (float(each) for each in np.exp(yaw))
    return NoiseLevels(
        position_m, heading_rad, speed_mps, yaw_rate_radps, jerk, yaw_jerk, *(waves or _NO_WAVES),
        *(yaw_waves or _NO_WAVES),
    )  # fmt: skip


def _stretches(data: Binned) -> list[Binned]:
    """All of a short recording, else stretches spread evenly over it."""
    steps = data.time_s.size
    if steps <= STRETCHES * STEPS_OF_STRETCH:
        return [data]
    first = np.linspace(0, steps - STEPS_OF_STRETCH, STRETCHES).astype(int)
    return [data.part(start, start + STEPS_OF_STRETCH) for start in first]


def _first_levels(data: Binned) -> Floats:
    """A first idea of each channel's noise [channels], from second differences."""
    levels = []
    for channel in range(data.value.shape[1]):
        series = data.value[:, channel][np.isfinite(data.value[:, channel])]
        levels.append(noise_of(np.unwrap(series) if channel == HEADING else series))
    return np.array(levels)


def _given_heading(part: Binned, yaw: NoiseLevels, gate: Gate) -> tuple[Steps, Start, Floats]:
    """The horizontal steps of a part with unit noise, their start, and the variance that the heading adds."""
    model = yaw.heading_model
    steps = heading_steps(part, yaw.heading_rad, yaw.yaw_rate_radps).seen_by(model)
    filtered = filter_steps(steps, first_state(part).seen_by(model), model, gate)
    track = smooth_filtered(part.time_s, filtered, model)
    heading, covariance = track.mean @ model.sums.T, model.sums @ track.covariance @ model.sums.T
    everything = motion_steps(part, heading[:, 0], np.ones(6))
    plain = horizontal_steps(everything, heading)
    return plain, first_state(part), everything.row[:, NORTH:, 0] ** 2 * covariance[:, :1, 0]


@dataclass(frozen=True, slots=True)
class _Search:
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

    def cost(self, logs: Floats) -> float:
        """Minus twice the log-likelihood at the logarithms of levels, jerk and, if they go on, wave motion."""
        from analysis.kalman_compiled import cost_of

        levels = np.exp(logs)
        laws: list[Law] = [WhiteJerk(float(levels[2]))]
        if levels.size > 3:
            laws.append(WaveMotion(float(levels[3]), float(levels[4]), float(levels[5])))
        model = Model(tuple(each for each in self.quantities for _ in laws), tuple(laws) * len(self.quantities))
        forward, added = model.blocks_over(self.intervals_s)
        ends = np.cumsum([0, *(steps.time_s.size for steps, _ in self.parts)])
        total = 0.0
        for number, (steps, start) in enumerate(self.parts):
            own = slice(int(ends[number]), int(ends[number + 1]))
            variance = steps.variance * levels[self.level_of] ** 2 + (self.added[number] if self.added else 0.0)
            seen, begin = replace(steps, variance=variance).seen_by(model), start.seen_by(model)
            total += float(cost_of(*arguments(seen, begin, model, self.gate, (forward[own], added[own]))))
        return total

    @property
    def intervals_s(self) -> Floats:
        """The time before each step of all parts, 0 before the first of each."""
        return np.concatenate([np.diff(steps.time_s, prepend=steps.time_s[:1]) for steps, _ in self.parts])

    @property
    def count(self) -> int:
        """How many values there are."""
        return sum(int(np.isfinite(steps.value).sum()) for steps, _ in self.parts)

    @property
    def shortest_wave_s(self) -> float:
        """The shortest wave that the steps can tell from noise: three of them."""
        return 3.0 * float(np.median(np.diff(self.parts[0][0].time_s))) if self.parts[0][0].time_s.size > 1 else 3.0

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Where levels and jerk may be, as logarithms."""
        noises = [(float(np.log(least)), float(np.log(1e4))) for least in self.least]
        return [*noises, (float(np.log(_LEAST_JERK)), float(np.log(_MOST_JERK)))]


def _calm(search: _Search) -> tuple[Floats, float]:
    """The logarithms of two levels and the jerk, and their cost: motion without waves."""
    noise = np.maximum(search.first, 3.0 * np.array(search.least))
    return _descended(search.cost, [np.log([*noise, jerk]) for jerk in _JERKS], search.bounds)


def _with_waves(
    search: _Search, calm: tuple[Floats, float], speeds: Sequence[float], frequencies: Sequence[float] | Floats
) -> Floats:
    """As :func:`_calm`, with the waves' speed, frequency and damping behind, where they are worth their numbers."""
    plain, cost = calm
    fastest = 2 * np.pi / search.shortest_wave_s
    bounds = np.log([(1e-6, 1e2), (2 * np.pi / _LONGEST_WAVE_S, fastest), _DAMPINGS])
    guesses = [
        np.array([*plain[:2], plain[2] + np.log(calmer), *np.log([speed, min(frequency, fastest), 0.2])])
        for calmer, speed, frequency in product((0.03, 0.3), speeds, frequencies)
    ]
    wavy, wavy_cost = _descended(search.cost, guesses, [*search.bounds, *((low, high) for low, high in bounds)])
    return wavy if wavy_cost < cost - 3.0 * np.log(max(search.count, 2)) else plain


def _descended(
    cost: Callable[[Floats], float], guesses: Sequence[Floats], bounds: Sequence[tuple[float, float]]
) -> tuple[Floats, float]:
    """The best of the guesses, and from there down (L-BFGS-B; Byrd, Lu, Nocedal and Zhu 1995)."""
    from scipy.optimize import minimize

    best = min(guesses, key=cost)
    options = {"eps": 3e-3, "ftol": 2e-6, "maxiter": 25, "maxfun": 150}
    found = minimize(cost, best, method="L-BFGS-B", bounds=bounds, options=options)
    return np.asarray(found.x), float(found.fun)
