"""Noise levels from the data themselves: those under which what was measured is the most likely.

A filter with the right levels predicts each value with an error that is as large as it says. The likelihood of
the innovations (Schweppe 1965) is largest there; it is computed on stretches spread over the recording, and each
innovation's square counts only up to the gate, so that outliers do not pass for noise. Heading and yaw rate come
first, by themselves; then position and speeds, with the heading given. Waves are part of the model where they
make the data more likely by more than their three numbers would by chance (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np

from acquisition.core.arrays import Floats
from analysis.estimation.kalman import Gate, Start, Steps, filter_steps, smooth_filtered
from analysis.estimation.motion_model import (
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
from analysis.estimation.noise_search import (
    CALM,
    LEAST,
    LEAST_JERK,
    MOST_JERK,
    Search,
    across_of,
    descended,
    downhill,
)
from analysis.estimation.process_models import Law, Model, WaveMotion, WhiteJerk
from analysis.windows.steady_controls import noise_of

STRETCHES, STEPS_OF_STRETCH = 10, 200
_JERKS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
_WAVE_PERIODS_S = (3.0, 5.0, 8.0, 12.0)
_SPEEDS, _YAW_SPEEDS = (0.05, 0.2, 0.8), (0.002, 0.01, 0.04)  # where the search for waves begins, m/s and rad/s
_YAW_ORDER = 3  # a hull averages turning along her length once more than shifting
_AT_BOUND = 0.01
_NO_WAVES, _NOTHING = (0.0, 1.0, 0.3), np.zeros(3)


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Standard deviations of one sample's noise, and what drives the motion; SI, angles in radians.

    The jerks are roots of two-sided spectral densities: ``jerk`` in m/s3 and ``yaw_jerk`` in rad/s3, per root Hz.
    ``wave_speed`` [m/s] and ``yaw_wave_speed`` [rad/s] are the standard deviations of the speeds of the swing
    in waves, 0 where there is none; frequency [rad/s] and damping say how it swings. The horizontal swing is along
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
        """How the heading moves: slowly, and in waves where there are any."""
        waves = WaveMotion(self.yaw_wave_speed, self.yaw_wave_frequency_radps, self.yaw_wave_damping, _YAW_ORDER)
        return (WhiteJerk(self.yaw_jerk), *([waves] if self.yaw_wave_speed > 0 else []))

    @property
    def laws(self) -> tuple[tuple[Law, ...], tuple[Law, ...]]:
        """How north and east move, or swing along and across the waves."""
        frequency, damping = self.wave_frequency_radps, self.wave_damping
        slow = WhiteJerk(self.jerk)
        if self.wave_speed <= 0:
            return (slow,), (slow,)
        along = WaveMotion(self.wave_speed, frequency, damping)
        return (slow, along), (slow, WaveMotion(self.wave_speed * self.wave_across, frequency, damping))

    @property
    def heading_model(self) -> Model:
        """The model of the heading alone."""
        return Model((0,) * len(self.yaw_laws), self.yaw_laws)

    @property
    def motion_model(self) -> Model:
        """The model of heading, north and east."""
        along, across = self.laws
        quantities = (0,) * len(self.yaw_laws) + (1,) * len(along) + (2,) * len(across)
        return Model(quantities, (*self.yaw_laws, *along, *across), self.wave_direction_rad)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """The channels whose noise is the least that is searched for, and those whose motion's jerk is at an end.

        A search that ends at its bound has not found a level: such data were made, filtered or held.
        """
        least = {"position_m": LEAST["position"], "heading_rad": LEAST["heading"], "speed_mps": LEAST["speed"],
                 "yaw_rate_radps": LEAST["yaw_rate"]}  # fmt: skip
        found = {name for name, bound in least.items() if getattr(self, name) <= bound * (1.0 + _AT_BOUND)}
        for name in ("jerk", "yaw_jerk"):
            if not LEAST_JERK * (1.0 + _AT_BOUND) < getattr(self, name) < MOST_JERK * (1.0 - _AT_BOUND):
                found.add(name)
        return tuple(sorted(found))

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
    turning = Search(alone, (0,), np.array([0, 1]), first[[HEADING, YAW_RATE]],
                      (LEAST["heading"], LEAST["yaw_rate"]), rules, order=_YAW_ORDER)  # fmt: skip
    yaw_calm = _calm(turning)
    yaw = yaw_calm[0]
    given = [_given_heading(part, _levels(_NOTHING, yaw), rules) for part in parts]
    moving = Search([(steps, start) for steps, start, _ in given], (1, 2), np.array([0, 0, 1, 1]), noise,
                     (LEAST["position"], LEAST["speed"]), rules, [added for *_, added in given])  # fmt: skip
    calm = _calm(moving)
    horizontal = _with_waves(moving, calm, _SPEEDS, [2 * np.pi / period for period in _WAVE_PERIODS_S])
    if horizontal.size > CALM:
        horizontal = _with_direction(moving, horizontal)
        yaw = _with_waves(
            turning, _calm(turning), _YAW_SPEEDS, float(np.exp(horizontal[4])) * np.array([1.0, 1.25])
        )
    return _levels(horizontal, yaw)


def _levels(horizontal: Floats, yaw: Floats) -> NoiseLevels:
    """The levels from logarithms: two noises, a jerk and, if they go on, waves."""
    position_m, speed_mps, jerk, *waves = (float(each) for each in np.exp(horizontal[:6]))
    speed, frequency, damping = waves or _NO_WAVES
    across, direction_rad = across_of(horizontal)
    heading_rad, yaw_rate_radps, yaw_jerk, *yaw_waves = (float(each) for each in np.exp(yaw))
    yaw_speed, yaw_frequency, yaw_damping = yaw_waves or _NO_WAVES
    return NoiseLevels(
        position_m, heading_rad, speed_mps, yaw_rate_radps, jerk, yaw_jerk, speed, frequency, damping,
        yaw_speed, yaw_frequency, yaw_damping, across, direction_rad,
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


def _calm(search: Search) -> tuple[Floats, float]:
    """The logarithms of two levels and the jerk, and their cost: motion without waves."""
    return descended(search, [np.array([*search.first_logs, np.log(jerk)]) for jerk in _JERKS], search.bounds)


def _with_waves(
    search: Search, calm: tuple[Floats, float], speeds: Sequence[float], frequencies: Sequence[float] | Floats
) -> Floats:
    """As :func:`_calm`, with the waves' speed, frequency and damping behind, where they are worth their numbers."""
    plain, cost = calm
    bounds, fastest = search.wave_bounds, 2 * np.pi / search.shortest_wave_s
    guesses = [
        np.array([*noise, plain[2] + np.log(calmer), *np.log([speed, min(frequency, fastest), 0.2])])
        for noise in (plain[:2], search.first_logs)
        for calmer, speed, frequency in product((0.03, 0.3), speeds, frequencies)
    ]
    wavy, wavy_cost = descended(search, guesses, [*search.bounds, *((low, high) for low, high in bounds)])
    a_sea = bool((wavy[4:] > bounds[1:, 0] + _AT_BOUND).all())  # a line without width is the ship's own doing
    return wavy if a_sea and wavy_cost < cost - 3.0 * np.log(max(search.count, 2)) else plain


def _with_direction(search: Search, wavy: Floats) -> Floats:
    """With the waves' share across and their direction behind, where the two are worth their numbers."""
    guesses = [np.array([*wavy, np.log(0.6), angle]) for angle in np.pi / 4 * np.arange(4)]
    low, high = np.array([*search.bounds, *search.wave_bounds, (np.log(0.03), np.log(3.0)), (-10.0, 10.0)]).T
    start = min(guesses, key=search.cost)
    found, cost = downhill(search, start, low, high)
    return found if cost < search.cost(wavy) - 2.0 * np.log(max(search.count, 2)) else wavy
