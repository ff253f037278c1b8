"""Maximum-likelihood noise levels from the data themselves.

With the right levels, the prediction errors of a filter have the size that it predicts, and the likelihood of
its innovations (:mod:`.likelihood`) is largest. It is computed on stretches spread over the recording. Heading
and yaw rate come first, by themselves; then position and speeds, given the heading. Waves are included if they
raise the likelihood by more than their three parameters would by chance (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.analysis.estimation.kalman import Gate, Start, Steps, innovations_of, smooth_steps
from seatrial.analysis.estimation.likelihood import ScoringSettings, most_likely, robust_cost
from seatrial.analysis.estimation.motion_model import (
    EAST,
    HEADING,
    NORTH,
    SURGE,
    SWAY,
    YAW_RATE,
    MotionSamples,
    first_state,
    heading_steps,
    horizontal_steps,
    motion_steps,
)
from seatrial.analysis.estimation.process_models import Law, ProcessModel, WaveMotion, WhiteJerk

_QUARTILE_OF_ABSOLUTE_NORMAL = 0.31864  # a quarter of |z| lies below it
STRETCHES, STEPS_OF_STRETCH = 10, 200
LEAST = {"position_m": 1e-4, "heading_rad": 1e-5, "speed_mps": 1e-4, "yaw_rate_radps": 1e-6}
"""The lower bounds of the noise in the search, SI."""
LEAST_JERK, MOST_JERK = 1e-7, 1e2
_CALM, _WAVY = 3, 6  # parameters without waves, and with waves but without direction
_LONGEST_WAVE_S, _DAMPINGS = 20.0, (0.02, 0.6)
_STARTS = 2
_JERKS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
_WAVE_PERIODS_S = (3.0, 5.0, 8.0, 12.0)
_SPEEDS, _YAW_SPEEDS = (0.05, 0.2, 0.8), (0.002, 0.01, 0.04)  # starts of the search for waves, m/s and rad/s
_YAW_ORDER = 3  # a hull averages turning along her length once more than shifting
_AT_BOUND = 0.01
_NO_WAVES, _NOTHING = (0.0, 1.0, 0.3), np.zeros(3)


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Standard deviations of one sample's noise, and the process noise of the motion; SI, angles in radians.

    The jerks are roots of two-sided spectral densities: ``jerk`` in m/s3 and ``yaw_jerk`` in rad/s3, per root
    Hz. ``wave_speed`` [m/s] and ``yaw_wave_speed`` [rad/s] are the standard deviations of the velocities of
    wave motion, 0 without waves, with their frequency [rad/s] and damping. The horizontal wave motion is along
    ``wave_direction_rad`` from north, and ``wave_across`` times as large across it.
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
    wave_across: float = 1.0
    wave_direction_rad: float = 0.0

    @property
    def by_channel(self) -> Floats:
        """Standard deviations in the order of :data:`.motion_model.CHANNELS`."""
        position, speed = [self.position_m] * 2, [self.speed_mps] * 2
        return np.array([self.heading_rad, self.yaw_rate_radps, *position, *speed])

    @property
    def yaw_laws(self) -> tuple[Law, ...]:
        """The process models of the heading: slow motion, and waves if there are any."""
        waves = (self.yaw_wave_speed, self.yaw_wave_frequency_radps, self.yaw_wave_damping)
        return _laws(self.yaw_jerk, *waves, _YAW_ORDER)

    @property
    def heading_model(self) -> ProcessModel:
        return ProcessModel((0,) * len(self.yaw_laws), self.yaw_laws)

    @property
    def motion_model(self) -> ProcessModel:
        """The model of heading, north and east, or along and across the waves."""
        shape = (self.wave_frequency_radps, self.wave_damping)
        along, across = (_laws(self.jerk, self.wave_speed * share, *shape) for share in (1.0, self.wave_across))
        quantities = (0,) * len(self.yaw_laws) + (1,) * len(along) + (2,) * len(across)
        return ProcessModel(quantities, (*self.yaw_laws, *along, *across), self.wave_direction_rad)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """The channels whose noise is at its lower bound, and those whose motion's jerk is at a bound.

        A search that ends at a bound has not found a level: such data were generated, filtered or held.
        """
        names = {name for name, bound in LEAST.items() if getattr(self, name) <= bound * (1.0 + _AT_BOUND)}
        for name in ("jerk", "yaw_jerk"):
            if not LEAST_JERK * (1.0 + _AT_BOUND) < getattr(self, name) < MOST_JERK * (1.0 - _AT_BOUND):
                names.add(name)
        return tuple(sorted(names))


def _laws(jerk: float, speed: float, frequency_radps: float, damping: float, order: int = 2) -> tuple[Law, ...]:
    """The process models of a quantity: slow motion, and waves if their ``speed`` is not zero."""
    slow = WhiteJerk(jerk)
    return (slow, WaveMotion(speed, frequency_radps, damping, order)) if speed > 0.0 else (slow,)


def estimate_levels(data: MotionSamples, gate: Gate) -> NoiseLevels:
    """The maximum-likelihood levels of combined samples; an absent channel keeps its lower bound.

    Waves are looked for in the horizontal motion. If there are any, the heading oscillates at about the same
    frequency; if not, oscillations of the heading are the ship's.
    """
    parts = _stretches(data)
    first = _first_levels(data)
    noise = np.array([first[[NORTH, EAST]].mean(), first[[SURGE, SWAY]].mean()])
    start = Start(np.array([first_state(part).mean for part in parts]), first_state(data).covariance)
    edges = np.cumsum([0, *(part.time_s.size for part in parts)])
    alone = _joined([heading_steps(part, 1.0, 1.0) for part in parts])
    turning = Search(alone, edges, start, (0,), np.array([0, 1]), first[[HEADING, YAW_RATE]],
                      (LEAST["heading_rad"], LEAST["yaw_rate_radps"]), gate, order=_YAW_ORDER)  # fmt: skip
    yaw_calm = _calm(turning)
    yaw = yaw_calm[0]
    conditioned, added = zip(
        *(_condition_on_heading(part, _levels(_NOTHING, yaw), gate) for part in parts), strict=True
    )
    moving = Search(_joined(conditioned), edges, start, (1, 2), np.array([0, 0, 1, 1]), noise,
                     (LEAST["position_m"], LEAST["speed_mps"]), gate, np.concatenate(added))  # fmt: skip
    calm = _calm(moving)
    horizontal = _with_waves(moving, calm, _SPEEDS, [2 * np.pi / period for period in _WAVE_PERIODS_S])
    if horizontal.size > _CALM:
        horizontal = _with_direction(moving, horizontal)
        yaw = _with_waves(turning, yaw_calm, _YAW_SPEEDS, float(np.exp(horizontal[4])) * np.array([1.0, 1.25]))
    return _levels(horizontal, yaw)


def _levels(horizontal: Floats, yaw: Floats) -> NoiseLevels:
    """The levels from logarithms: two noises, a jerk and, if they go on, waves."""
    position_m, speed_mps, jerk, *waves = (float(level) for level in np.exp(horizontal[:6]))
    speed, frequency, damping = waves or _NO_WAVES
    across, direction_rad = across_of(horizontal)
    heading_rad, yaw_rate_radps, yaw_jerk, *yaw_waves = (float(level) for level in np.exp(yaw))
    yaw_speed, yaw_frequency, yaw_damping = yaw_waves or _NO_WAVES
    return NoiseLevels(
        position_m, heading_rad, speed_mps, yaw_rate_radps, jerk, yaw_jerk, speed, frequency, damping,
        yaw_speed, yaw_frequency, yaw_damping, across, direction_rad,
    )  # fmt: skip


def _stretches(data: MotionSamples) -> list[MotionSamples]:
    """All of a short recording, or stretches spread evenly over a long one."""
    steps = data.time_s.size
    if steps <= STRETCHES * STEPS_OF_STRETCH:
        return [data]
    first = np.linspace(0, steps - STEPS_OF_STRETCH, STRETCHES).astype(int)
    return [data.part(start, start + STEPS_OF_STRETCH) for start in first]


def _joined(parts: Sequence[Steps]) -> Steps:
    """The steps of all stretches, one after the other."""
    time_s, value, row, variance = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time_s", "value", "row", "variance")
    )
    return Steps(time_s, value, row, variance, parts[0].turn, parts[0].jumps)


def _first_levels(data: MotionSamples) -> Floats:
    """An initial estimate of each channel's noise [channels], from second differences."""
    levels = []
    for channel in range(data.value.shape[1]):
        series = data.value[:, channel][np.isfinite(data.value[:, channel])]
        levels.append(noise_of(np.unwrap(series) if channel == HEADING else series))
    return np.array(levels)


def noise_of(values: Floats, stride: int = 1) -> float:
    """The standard deviation of the noise on a series at a constant rate, in its own unit.

    Second differences are insensitive to ramps, and their lower quartile to steps and spikes, as long as the
    setting is constant or moves steadily for half of the time. They are taken between values ``stride`` rows
    from each other. NaN are ignored; 0 for a series that is too short.
    """
    second = np.abs(values[2 * stride :] - 2.0 * values[stride:-stride] + values[: -2 * stride])
    second = second[np.isfinite(second)]
    if second.size < 8:
        return 0.0
    noise = np.quantile(second, 0.25) / (_QUARTILE_OF_ABSOLUTE_NORMAL * 6.0**0.5)
    return float(noise)


def _condition_on_heading(part: MotionSamples, yaw: NoiseLevels, gate: Gate) -> tuple[Steps, Floats]:
    """The horizontal steps of a part with unit noise, and the variance that the heading adds."""
    model = yaw.heading_model
    steps = heading_steps(part, yaw.heading_rad, yaw.yaw_rate_radps).for_model(model)
    track = smooth_steps(steps, first_state(part).for_model(model), model, gate, "compiled")
    heading, covariance = track.mean @ model.sums.T, model.sums @ track.covariance @ model.sums.T
    everything = motion_steps(part, heading[:, 0], np.ones(6))
    return horizontal_steps(everything, heading), everything.row[:, NORTH:, 0] ** 2 * covariance[:, :1, 0]


def _calm(search: Search) -> tuple[Floats, float]:
    """The logarithms of two levels and the jerk, and their cost: motion without waves."""
    return descend(search, [np.array([*search.first_logs, np.log(jerk)]) for jerk in _JERKS], search.bounds)


def _with_waves(
    search: Search, calm: tuple[Floats, float], speeds: Sequence[float], frequencies: Sequence[float] | Floats
) -> Floats:
    """As :func:`_calm`, with the waves' speed, frequency and damping appended if they are significant."""
    plain, cost = calm
    bounds, fastest = search.wave_bounds, 2 * np.pi / search.shortest_wave_s
    guesses = [
        np.array([*noise, plain[2] + np.log(calmer), *np.log([speed, min(frequency, fastest), 0.2])])
        for noise in (plain[:2], search.first_logs)
        for calmer, speed, frequency in product((0.03, 0.3), speeds, frequencies)
    ]
    wavy, wavy_cost = descend(search, guesses, [*search.bounds, *((low, high) for low, high in bounds)])
    a_sea = bool((wavy[4:] > bounds[1:, 0] + _AT_BOUND).all())  # a line without width comes from the ship
    return wavy if a_sea and wavy_cost < cost - 3.0 * np.log(max(search.count, 2)) else plain


def _with_direction(search: Search, wavy: Floats) -> Floats:
    """The parameters with the waves' ratio across and direction appended if they are significant."""
    guesses = [np.array([*wavy, np.log(0.6), angle]) for angle in np.pi / 4 * np.arange(4)]
    low, high = np.array([*search.bounds, *search.wave_bounds, (np.log(0.03), np.log(3.0)), (-10.0, 10.0)]).T
    start = min(guesses, key=search.cost)
    optimum, cost = search.climb(start, low, high)
    return optimum if cost < search.cost(wavy) - 2.0 * np.log(max(search.count, 2)) else wavy


@dataclass(frozen=True)
class Search:
    """The search for two noise levels, a jerk and waves, for ``steps`` given with unit noise.

    The stretches begin and end at ``edges`` [stretches + 1] and start at the means of ``start`` [stretches, 9].
    ``level_of`` [channels] assigns levels to channels, ``added`` [steps, channels] is additional variance.
    """

    steps: Steps
    edges: Ints
    start: Start
    quantities: tuple[int, ...]
    level_of: Ints
    first: Floats
    least: tuple[float, float]
    gate: Gate
    added: Floats | float = 0.0
    order: int = 2

    def cost(self, logs: Floats) -> float:
        """Minus twice the log likelihood, with innovations clipped at the gate."""
        return robust_cost(*self.innovations(logs), self.gate.limit)

    def climb(self, logs: Floats, low: Floats, high: Floats) -> tuple[Floats, float]:
        """The local maximum of the likelihood from these logarithms, and its cost."""
        return most_likely(self.innovations, logs, low, high, ScoringSettings(limit=self.gate.limit))

    def innovations(self, logs: Floats) -> tuple[Floats, Floats]:
        """All innovations and their variances at the logarithms of levels, jerk and, if they go on, wave motion."""
        levels = np.exp(logs)
        across, direction_rad = across_of(logs)
        speed, frequency, damping = levels[_CALM:_WAVY].tolist() or _NO_WAVES
        shares = (1.0, across)[: len(self.quantities)]
        families = (_laws(float(levels[2]), share * speed, frequency, damping, self.order) for share in shares)
        laws = [law for family in families for law in family]
        quantities = np.repeat(self.quantities, len(laws) // len(self.quantities))
        model = ProcessModel(tuple(quantities.tolist()), tuple(laws), direction_rad)
        steps, start = self.steps.for_model(model), self.start.for_model(model)
        steps = replace(steps, variance=steps.variance * levels[self.level_of] ** 2 + self.added)
        innovation, variance = innovations_of(steps, start.mean, start.covariance, self.edges, model, self.gate)
        valid = np.isfinite(steps.value)
        return innovation[valid], variance[valid]

    @property
    def count(self) -> int:
        return int(np.isfinite(self.steps.value).sum())

    @property
    def first_logs(self) -> Floats:
        """The logarithms of the first idea of the two levels."""
        return np.asarray(np.log(np.maximum(self.first, 3.0 * np.array(self.least))))

    @property
    def shortest_wave_s(self) -> float:
        """The shortest wave period that the steps can separate from noise: three steps."""
        time_s = self.steps.time_s[: self.edges[1]]
        return 3.0 * float(np.median(np.diff(time_s))) if time_s.size > 1 else 3.0

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
    """The ratio of wave motion across its direction, and the direction [rad]; 1 and 0 if not among the
    parameters."""
    return (float(np.exp(logs[_WAVY])), float(logs[_WAVY + 1])) if logs.size > _WAVY else (1.0, 0.0)


def descend(
    search: Search, guesses: Sequence[Floats], bounds: Sequence[tuple[float, float]]
) -> tuple[Floats, float]:
    """The lowest cost found by descent from the best of the guesses, and its parameters."""
    low, high = np.array(bounds).T
    ends = [
        search.climb(np.clip(guess, low, high), low, high) for guess in sorted(guesses, key=search.cost)[:_STARTS]
    ]
    return min(ends, key=lambda end: end[1])
