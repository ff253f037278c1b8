"""A ship's motion as a state-space model: the states, and how the six motion channels measure them.

States: heading, north and east, each with its first and second derivative; SI, angles in radians. Samples of a
channel within one internal step are averaged; the mean measures the mean of the state's quadratic over the
samples' own times, so nothing is shifted in time. Surge and sway measure the earth-fixed velocity rotated by
the heading. This is linearised about a well known heading and velocity (the heading smoothed by itself and the
measured speeds), so that one filter holds all nine states with their correlations: an extended Kalman smoother,
linearised once. The neglected term is of second order, 0.5 U dpsi^2: 1 mm/s for 1 degree at 6 m/s.

The noise levels are those of maximum likelihood (:func:`.process_models.most_likely`), computed on stretches spread
over the recording. Heading and yaw rate come first, by themselves; then position and speeds, given the heading.
Waves are included if they raise the likelihood by more than their three parameters would by chance (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, rotate_earth_to_ship
from seatrial.acquisition.core.ship import BY_NAME, angle_difference
from seatrial.analysis.estimation import process_models
from seatrial.analysis.estimation.kalman import Gate, Start, Steps, filter_steps, smooth_steps
from seatrial.analysis.estimation.process_models import Law, ProcessModel, ScoringSettings, WaveMotion, WhiteJerk
from seatrial.analysis.tables.resample import bridged_gap_s
from seatrial.analysis.tables.table import NANO, times_ns

CHANNELS = ("heading_deg", "yaw_rate_dps", "north_m", "east_m", "surge_mps", "sway_mps")
"""The motion channels in the order of processing."""
HEADING, YAW_RATE, NORTH, EAST, SURGE, SWAY = range(6)
PSI, R, R_DOT, N, VN, AN, E, VE, AE = range(9)

BODY = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps",
        "surge_mps2", "sway_mps2", "yaw_dps2")  # fmt: skip
"""The states of the result: pose, body-fixed velocity, and its rate of change."""

FASTEST_HZ = 5.0
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
_YAW_ORDER = 3  # a hull averages turning along its length once more than shifting
_AT_BOUND = 0.01
_MOST_SWING = 2.0  # of the variance of surge and sway: a part of some ten wave periods may have half of the usual
_NO_WAVES, _NOTHING = (0.0, 1.0, 0.3), np.zeros(3)
_FIRST_VARIANCE = np.array([1.0, 0.01, 1e-4, 1e4, 100.0, 1.0, 1e4, 100.0, 1.0])


@dataclass(frozen=True, slots=True)
class MotionSamples:
    """The samples of all motion channels combined step by step, in SI.

    ``time_s`` [steps] since ``epoch_ns``; ``value``, ``count`` and the samples' mean time and mean squared time
    from the step's, ``offset_s`` and ``offset_s2`` [steps, channels]; ``step_of`` [rows of the table].
    """

    epoch_ns: int
    time_s: Floats
    value: Floats
    count: Floats
    offset_s: Floats
    offset_s2: Floats
    step_of: Ints

    def part(self, first: int, last: int) -> MotionSamples:
        """The steps ``first`` to ``last``, the last one excluded."""
        rows = slice(first, last)
        return MotionSamples(
            self.epoch_ns, self.time_s[rows], self.value[rows], self.count[rows],
            self.offset_s[rows], self.offset_s2[rows], self.step_of,
        )  # fmt: skip


def motion_values(table: pd.DataFrame) -> Floats:
    """The six motion channels [rows, channels] in SI; a channel that the table lacks is NaN."""
    columns = [
        table[name].to_numpy(dtype=float) if name in table else np.full(len(table), np.nan) for name in CHANNELS
    ]
    factors = [np.pi / 180.0 if BY_NAME[name].unit.startswith("deg") else 1.0 for name in CHANNELS]
    values: Floats = np.stack(columns, axis=1) * np.array(factors)
    return values


def combine_into_steps(table: pd.DataFrame) -> MotionSamples:
    """The samples of a table in any order, combined into internal steps of at most :data:`FASTEST_HZ`: the median
    interval of the fastest channel, or that of :data:`FASTEST_HZ` if longer."""
    time_ns, values = times_ns(table), motion_values(table)
    valid = np.isfinite(values)
    observed = valid.any(axis=1)
    epoch_ns = int(time_ns[observed].min())
    since_s = (time_ns - epoch_ns) / NANO
    distinct_ns = (np.unique(time_ns[samples]) for samples in valid.T)
    intervals_s = [float(np.median(np.diff(times))) / NANO for times in distinct_ns if times.size > 1]
    step_s = max(min(intervals_s, default=1.0), 1.0 / FASTEST_HZ)
    number = np.rint(since_s / step_s).astype(np.int64)
    step_of = np.full(len(table), -1, dtype=np.int64)
    numbers, step_of[observed] = np.unique(number[observed], return_inverse=True)
    time_s = _mean_by_step(step_of[observed], since_s[observed], numbers.size)
    value, count, offset, offset2 = np.full((4, numbers.size, len(CHANNELS)), np.nan)
    for channel in range(len(CHANNELS)):
        rows = np.flatnonzero(valid[:, channel])
        step, sample, offset_s = step_of[rows], values[rows, channel], since_s[rows] - time_s[step_of[rows]]
        first = np.zeros(numbers.size)
        first[step[::-1]] = sample[::-1]
        deviation = sample - first[step]
        if channel == HEADING:
            deviation = np.deg2rad(angle_difference(np.rad2deg(sample), np.rad2deg(first[step])))
        count[:, channel] = np.bincount(step, minlength=numbers.size)
        value[:, channel] = first + _mean_by_step(step, deviation, numbers.size)
        offset[:, channel] = _mean_by_step(step, offset_s, numbers.size)
        offset2[:, channel] = _mean_by_step(step, offset_s**2, numbers.size)
    return MotionSamples(epoch_ns, time_s, value, count, offset, offset2, step_of)


def _mean_by_step(step: Ints, values: Floats, steps: int) -> Floats:
    """The mean of the values of each step, NaN where there is none."""
    count = np.bincount(step, minlength=steps)
    total = np.bincount(step, values, minlength=steps)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def heading_steps(data: MotionSamples, heading_rad: float, yaw_rate_radps: float) -> Steps:
    """Heading and yaw rate alone, on three states; the standard deviations are of one sample."""
    row, jumps = np.zeros((data.time_s.size, 2, 9)), np.zeros((2, 9), dtype=bool)
    row[:, 0, PSI : R_DOT + 1], row[:, 1, PSI : R_DOT + 1] = (
        _quadratic_design_matrix(data, HEADING),
        _slope_design_matrix(data, YAW_RATE),
    )
    jumps[0, PSI] = jumps[1, R] = True
    variance = np.array([heading_rad, yaw_rate_radps]) ** 2 / np.maximum(data.count[:, :2], 1.0)
    return Steps(data.time_s, data.value[:, :2], row, variance, np.array([2 * np.pi, 0.0]), jumps)


def motion_steps(data: MotionSamples, heading_rad: Floats, noise: Floats) -> Steps:
    """All channels on nine states, linearised about ``heading_rad`` [steps], which sets the headings' turns.

    The speed of the linearisation is a running median of five, robust against outliers. ``noise`` [channels] is the
    standard deviation of one sample of each.
    """
    value, turning = data.value.copy(), heading_steps(data, *noise[:2])
    row, jumps = np.zeros((data.time_s.size, len(CHANNELS), 9)), np.zeros((len(CHANNELS), 9), dtype=bool)
    row[:, :2], jumps[:2] = turning.row, turning.jumps
    row[:, NORTH, N : AN + 1] = _quadratic_design_matrix(data, NORTH)
    row[:, EAST, E : AE + 1] = _quadratic_design_matrix(data, EAST)
    turns = np.rint((value[:, HEADING] - heading_rad) / (2 * np.pi))
    value[:, HEADING] -= 2 * np.pi * turns
    cos, sin = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    speeds = pd.DataFrame(value[:, [SURGE, SWAY]]).rolling(5, center=True, min_periods=1).median()
    surge, sway = speeds.interpolate(limit_direction="both").fillna(0.0).to_numpy(dtype=float).T
    for channel, north, east, gain in ((SURGE, cos, sin, sway), (SWAY, -sin, cos, -surge)):
        slope = _slope_design_matrix(data, channel)
        row[:, channel, N : AN + 1], row[:, channel, E : AE + 1] = north * slope, east * slope
        row[:, channel, PSI], row[:, channel, R] = gain, gain * np.nan_to_num(data.offset_s[:, channel])
        value[:, channel] += gain * heading_rad
    for channel, states in {NORTH: [N], EAST: [E], SURGE: [VN, VE], SWAY: [VN, VE]}.items():
        jumps[channel, states] = True
    return Steps(data.time_s, value, row, noise**2 / np.maximum(data.count, 1.0), np.zeros(len(CHANNELS)), jumps)


def initial_state(data: MotionSamples) -> Start:
    """The initial state: the first heading and position, with wide variances."""
    mean = np.zeros(9)
    for channel, state in ((HEADING, PSI), (NORTH, N), (EAST, E)):
        measured = np.flatnonzero(np.isfinite(data.value[:, channel]))
        mean[state] = data.value[measured[0], channel] if measured.size else 0.0
    return Start(mean, np.diag(_FIRST_VARIANCE))


def _quadratic_design_matrix(data: MotionSamples, channel: int) -> Floats:
    offset, offset2 = np.nan_to_num(data.offset_s[:, channel]), np.nan_to_num(data.offset_s2[:, channel])
    return np.stack([np.ones_like(offset), offset, offset2 / 2.0], axis=1)


def _slope_design_matrix(data: MotionSamples, channel: int) -> Floats:
    offset = np.nan_to_num(data.offset_s[:, channel])
    return np.stack([np.zeros_like(offset), np.ones_like(offset), offset], axis=1)


def body_states_of_filter_states(mean: Floats) -> Floats:
    """Pose, body-fixed velocity and its time derivative [k, 9], SI, from the filter's states.

    The derivatives are those of the numbers surge, sway and yaw rate: u' = a along the bow + r v, and so on
    (Fossen 2011, section 2.2).
    """
    (surge, sway), (ahead, abeam), r = _body_motion(mean)
    return np.stack(
        [mean[:, N], mean[:, E], mean[:, PSI], surge, sway, r, ahead + r * sway, abeam - r * surge,
         mean[:, R_DOT]], axis=1)  # fmt: skip


def body_covariance(mean: Floats, covariance: Floats) -> Floats:
    """The covariance [k, 9, 9] of :func:`body_states_of_filter_states` from that of the filter's states."""
    cos, sin = np.cos(mean[:, PSI]), np.sin(mean[:, PSI])
    (surge, sway), (ahead, abeam), r = _body_motion(mean)
    jacobian = np.zeros((mean.shape[0], 9, 9))
    jacobian[:, [0, 1, 2, 5, 8], [N, E, PSI, R, R_DOT]] = 1.0
    jacobian[:, 3, VN], jacobian[:, 3, VE], jacobian[:, 3, PSI] = cos, sin, sway
    jacobian[:, 4, VN], jacobian[:, 4, VE], jacobian[:, 4, PSI] = -sin, cos, -surge
    jacobian[:, 6, AN], jacobian[:, 6, AE], jacobian[:, 6, PSI] = cos, sin, abeam
    jacobian[:, 7, AN], jacobian[:, 7, AE], jacobian[:, 7, PSI] = -sin, cos, -ahead
    jacobian[:, 6] += r[:, None] * jacobian[:, 4]
    jacobian[:, 7] -= r[:, None] * jacobian[:, 3]
    jacobian[:, 6, R] += sway
    jacobian[:, 7, R] -= surge
    return np.asarray(jacobian @ covariance @ jacobian.transpose(0, 2, 1))


def _body_motion(mean: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats], Floats]:
    """Velocity and acceleration forward and to starboard, and the yaw rate: each [k]."""
    velocity = rotate_earth_to_ship(mean[:, VN], mean[:, VE], mean[:, PSI])
    return velocity, rotate_earth_to_ship(mean[:, AN], mean[:, AE], mean[:, PSI]), mean[:, R]


def gap_mask(table: pd.DataFrame, epoch_ns: int, grid_s: Floats, longest_gap_s: float | None) -> Bools:
    """Mask of the grid points [rows] in a gap of the heading's channels or of the others, or outside them.

    A gap is longer than ``longest_gap_s``; by default than 2.5 intervals, but at least 3 s and at most 10 s.
    """
    valid = np.isfinite(motion_values(table))
    times_s = (times_ns(table) - epoch_ns) / NANO
    hidden = np.zeros(grid_s.size, dtype=bool)
    for channels in ([HEADING, YAW_RATE], [NORTH, EAST, SURGE, SWAY]):
        samples_s = np.unique(times_s[valid[:, channels].any(axis=1)])
        interval_s = float(np.median(np.diff(samples_s))) if samples_s.size > 1 else 0.0
        limit_s = bridged_gap_s(interval_s * NANO) if longest_gap_s is None else longest_gap_s
        before = np.searchsorted(samples_s, grid_s + 1e-6, side="right") - 1
        after = np.minimum(before + 1, samples_s.size - 1)
        before_s = samples_s[np.maximum(before, 0)]
        span = np.where((after > before) & (before >= 0), samples_s[after] - before_s, np.inf)
        hidden |= (np.abs(grid_s - before_s) > 1e-6) & (span > limit_s)
    return hidden


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
        return _process_models(self.yaw_jerk, *waves, _YAW_ORDER)

    @property
    def heading_model(self) -> ProcessModel:
        return ProcessModel((0,) * len(self.yaw_laws), self.yaw_laws)

    @property
    def motion_model(self) -> ProcessModel:
        """The model of heading, north and east, or along and across the waves."""
        shape = (self.wave_frequency_radps, self.wave_damping)
        along, across = (
            _process_models(self.jerk, self.wave_speed * share, *shape) for share in (1.0, self.wave_across)
        )
        quantities = (0,) * len(self.yaw_laws) + (1,) * len(along) + (2,) * len(across)
        return ProcessModel(quantities, (*self.yaw_laws, *along, *across), self.wave_direction_rad)

    @property
    def channels_at_bounds(self) -> tuple[str, ...]:
        """The channels whose noise is at its lower bound, and those whose motion's jerk is at a bound.

        A search that ends at a bound has not found a level: such data were generated, filtered or held.
        """
        names = {name for name, bound in LEAST.items() if getattr(self, name) <= bound * (1.0 + _AT_BOUND)}
        for name in ("jerk", "yaw_jerk"):
            if not LEAST_JERK * (1.0 + _AT_BOUND) < getattr(self, name) < MOST_JERK * (1.0 - _AT_BOUND):
                names.add(name)
        return tuple(sorted(names))


def _process_models(
    jerk: float, wave_speed: float, wave_frequency_radps: float, wave_damping: float, order: int = 2
) -> tuple[Law, ...]:
    """The process models of a quantity: slow motion, and waves if ``wave_speed`` is not zero."""
    waves = (WaveMotion(wave_speed, wave_frequency_radps, wave_damping, order),) if wave_speed > 0.0 else ()
    return (WhiteJerk(jerk), *waves)


def estimate_noise_levels(data: MotionSamples, gate: Gate) -> NoiseLevels:
    """The maximum-likelihood levels of combined samples; an absent channel keeps its lower bound.

    A short recording is taken as it is, of a long one stretches spread evenly over it. Waves are looked for in the
    horizontal motion. If there are any, the heading oscillates at about the same frequency; if not, oscillations of
    the heading are the ship's.
    """
    steps, parts = data.time_s.size, [data]
    if steps > STRETCHES * STEPS_OF_STRETCH:
        starts = np.linspace(0, steps - STEPS_OF_STRETCH, STRETCHES).astype(int)
        parts = [data.part(start, start + STEPS_OF_STRETCH) for start in starts]
    series = [values[np.isfinite(values)] for values in data.value.T]
    series[HEADING] = np.unwrap(series[HEADING])
    first = np.array([noise_standard_deviation(values) for values in series])
    noise = np.array([first[[NORTH, EAST]].mean(), first[[SURGE, SWAY]].mean()])
    start = Start(np.array([initial_state(part).mean for part in parts]), initial_state(data).covariance)
    edges = np.cumsum([0, *(part.time_s.size for part in parts)])
    heading_only = _concatenate_steps([heading_steps(part, 1.0, 1.0) for part in parts])
    yaw_search = Search(heading_only, edges, start, (0,), np.array([0, 1]), first[[HEADING, YAW_RATE]],
                      (LEAST["heading_rad"], LEAST["yaw_rate_radps"]), gate, order=_YAW_ORDER)  # fmt: skip
    yaw_calm = _fit_without_waves(yaw_search)
    yaw = yaw_calm[0]
    yaw_levels, conditioned, added = _noise_levels_from_logs(_NOTHING, yaw), [], []
    model = yaw_levels.heading_model
    for part in parts:  # the horizontal steps with unit noise, and the variance that the heading adds
        on_heading = heading_steps(part, yaw_levels.heading_rad, yaw_levels.yaw_rate_radps).for_model(model)
        track = smooth_steps(on_heading, initial_state(part).for_model(model), model, gate, "compiled")
        heading, covariance = (
            track.mean @ model.summing_matrix.T,
            model.summing_matrix @ track.covariance @ model.summing_matrix.T,
        )
        linearised = motion_steps(part, heading[:, 0], np.ones(6))
        row = linearised.row[:, NORTH:].copy()
        added.append(row[:, :, 0] ** 2 * covariance[:, :1, 0])
        value = linearised.value[:, NORTH:] - np.einsum("kcj,kj->kc", row[:, :, :3], heading[:, :3])
        row[:, :, :3] = 0.0  # the heading and its derivatives are given
        variance, turn, jumps = linearised.variance[:, NORTH:], linearised.turn[NORTH:], linearised.jumps[NORTH:]
        conditioned.append(Steps(part.time_s, value, row, variance, turn, jumps))
    moving = Search(_concatenate_steps(conditioned), edges, start, (1, 2), np.array([0, 0, 1, 1]), noise,
                     (LEAST["position_m"], LEAST["speed_mps"]), gate, np.concatenate(added))  # fmt: skip
    calm = _fit_without_waves(moving)
    horizontal = _fit_with_waves(moving, calm, _SPEEDS, [2 * np.pi / period for period in _WAVE_PERIODS_S])
    if horizontal.size > _CALM:
        directions = [np.array([*horizontal, np.log(0.6), angle]) for angle in np.pi / 4 * np.arange(4)]
        bounds = [*moving.bounds, (np.log(0.03), np.log(3.0)), (-10.0, 10.0)]
        directed, cost = moving.climb(min(directions, key=moving.cost), bounds)
        if cost < moving.cost(horizontal) - 2.0 * np.log(max(moving.count, 2)):  # the direction is significant
            horizontal = directed
    if horizontal.size > _CALM:  # waves never swing more than the ship does: variances [m2/s2]
        swing = float(np.exp(2.0 * horizontal[_CALM]) * (1.0 + wave_axes(horizontal)[0] ** 2))
        horizontal = calm[0] if swing > _MOST_SWING * _least_swing_along_ship(data) else horizontal
    if horizontal.size > _CALM:
        yaw = _fit_with_waves(
            yaw_search, yaw_calm, _YAW_SPEEDS, float(np.exp(horizontal[4])) * np.array([1.0, 1.25])
        )
    return _noise_levels_from_logs(horizontal, yaw)


def _least_swing_along_ship(data: MotionSamples) -> float:
    """The lower quartile over parts of the variance of surge and sway, together [m2/s2]; infinite without both.

    It holds what waves do, and no turning: over ground the velocity of a boat that weaves swings as in waves. Waves
    are there all the time; zigzags between straight legs are not.
    """
    speeds = data.value[:, [SURGE, SWAY]]
    parts = np.array_split(speeds, STRETCHES)
    swings = [np.nanvar(part, axis=0).sum() for part in parts if np.isfinite(part).any(axis=0).all()]
    return float(np.quantile(swings, 0.25)) if swings else np.inf


def _noise_levels_from_logs(horizontal: Floats, yaw: Floats) -> NoiseLevels:
    """The levels from logarithms: two noises, a jerk and, if they go on, waves."""
    position_m, speed_mps, jerk, *waves = (float(level) for level in np.exp(horizontal[:6]))
    speed, frequency, damping = waves or _NO_WAVES
    across, direction_rad = wave_axes(horizontal)
    heading_rad, yaw_rate_radps, yaw_jerk, *yaw_waves = (float(level) for level in np.exp(yaw))
    yaw_speed, yaw_frequency, yaw_damping = yaw_waves or _NO_WAVES
    return NoiseLevels(
        position_m, heading_rad, speed_mps, yaw_rate_radps, jerk, yaw_jerk, speed, frequency, damping,
        yaw_speed, yaw_frequency, yaw_damping, across, direction_rad,
    )  # fmt: skip


def _concatenate_steps(parts: Sequence[Steps]) -> Steps:
    """The steps of all stretches, one after the other."""
    time_s, value, row, variance = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time_s", "value", "row", "variance")
    )
    return Steps(time_s, value, row, variance, parts[0].turn, parts[0].jumps)


def noise_standard_deviation(values: Floats, stride: int = 1) -> float:
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


def _fit_without_waves(search: Search) -> tuple[Floats, float]:
    """The logarithms of two levels and the jerk, and their cost: motion without waves."""
    return search.lowest_cost(
        [np.array([*search.first_logs, np.log(jerk)]) for jerk in _JERKS], search.bounds[:_CALM]
    )


def _fit_with_waves(
    search: Search, calm: tuple[Floats, float], speeds: Sequence[float], frequencies: Sequence[float] | Floats
) -> Floats:
    """As :func:`_fit_without_waves`, with the waves' speed, frequency and damping appended if significant."""
    plain, cost = calm
    fastest = 2 * np.pi / search.shortest_wave_s
    guesses = [
        np.array([*noise, plain[2] + np.log(calmer), *np.log([speed, min(frequency, fastest), 0.2])])
        for noise in (plain[:2], search.first_logs)
        for calmer, speed, frequency in product((0.03, 0.3), speeds, frequencies)
    ]
    wavy, wavy_cost = search.lowest_cost(guesses, search.bounds)
    has_width = wavy[5] > np.log(_DAMPINGS[0]) + _AT_BOUND  # a line without width comes from the ship
    significant = has_width and wavy_cost < cost - 3.0 * np.log(max(search.count, 2))
    # Half the power of an oscillator's velocity is at its frequency times sqrt(1 + damping^2) +- damping. What goes
    # beyond the longest waves is the ship's: of a zigzag on a track without noise the sway was taken for waves.
    frequency, damping = np.exp(wavy[_CALM + 1 : _WAVY])
    longest_s = 2.0 * np.pi / (frequency * (np.hypot(1.0, damping) - damping))
    return wavy if significant and longest_s < _LONGEST_WAVE_S else plain


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
        return process_models.robust_cost(*self.innovations(logs), self.gate.limit)

    def climb(self, logs: Floats, bounds: Sequence[tuple[float, float]]) -> tuple[Floats, float]:
        """The local maximum of the likelihood from these logarithms, and its cost."""
        low, high = np.array(bounds).T
        return process_models.most_likely(self.innovations, logs, low, high, ScoringSettings(limit=self.gate.limit))

    def lowest_cost(self, guesses: Sequence[Floats], bounds: Sequence[tuple[float, float]]) -> tuple[Floats, float]:
        """The parameters of the lowest cost found by descent from the best of the guesses, and the cost."""
        best = sorted(guesses, key=self.cost)[:_STARTS]
        optima = [self.climb(np.clip(guess, *np.array(bounds).T), bounds) for guess in best]
        return min(optima, key=lambda optimum: optimum[1])

    def innovations(self, logs: Floats) -> tuple[Floats, Floats]:
        """All innovations and their variances at the logarithms of levels, jerk and, if they go on, wave motion."""
        levels = np.exp(logs)
        across, direction_rad = wave_axes(logs)
        speed, frequency, damping = levels[_CALM:_WAVY].tolist() or _NO_WAVES
        shares = (1.0, across)[: len(self.quantities)]
        families = (
            _process_models(float(levels[2]), share * speed, frequency, damping, self.order) for share in shares
        )
        laws = [law for family in families for law in family]
        quantities = np.repeat(self.quantities, len(laws) // len(self.quantities))
        model = ProcessModel(tuple(quantities.tolist()), tuple(laws), direction_rad)
        steps, start = self.steps.for_model(model), self.start.for_model(model)
        steps = replace(steps, variance=steps.variance * levels[self.level_of] ** 2 + self.added)
        _, _, (innovation, variance, *_) = filter_steps(
            steps, start.mean, start.covariance, self.edges, model, self.gate, keep=False
        )
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
    def bounds(self) -> list[tuple[float, float]]:
        """Where levels, jerk and the waves' speed, frequency and damping may be, as logarithms."""
        noises = [(least, 1e4) for least in self.least]
        waves = [(1e-6, 1e2), (2 * np.pi / _LONGEST_WAVE_S, 2 * np.pi / self.shortest_wave_s), _DAMPINGS]
        logarithms = np.log([*noises, (LEAST_JERK, MOST_JERK), *waves])
        return [(float(low), float(high)) for low, high in logarithms]


def wave_axes(logs: Floats) -> tuple[float, float]:
    """The ratio of wave motion across its direction, and the direction [rad]; 1 and 0 if not among the
    parameters."""
    return (float(np.exp(logs[_WAVY])), float(logs[_WAVY + 1])) if logs.size > _WAVY else (1.0, 0.0)
