"""A ship's motion as a state-space model: the states, and how the six motion channels measure them.

States: heading, north and east, each with its first and second derivative; SI, angles in radians. Samples of a
channel within one internal step are averaged; the mean measures the mean of the state's quadratic over the
samples' own times, so nothing is shifted in time. Surge and sway measure the earth-fixed velocity rotated by
the heading. This is linearised about a well known heading and velocity (the heading smoothed by itself and the
measured speeds), so that one filter holds all nine states with their correlations: an extended Kalman smoother,
linearised once. The neglected term is of second order, 0.5 U dpsi^2: 1 mm/s for 1 degree at 6 m/s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, to_ship
from seatrial.acquisition.core.ship import BY_NAME, difference
from seatrial.analysis.estimation.kalman import Start, Steps
from seatrial.analysis.tables.resample import own_gap_s
from seatrial.analysis.tables.table import NANO, times_ns

CHANNELS = ("heading_deg", "yaw_rate_dps", "north_m", "east_m", "surge_mps", "sway_mps")
"""The motion channels in the order of processing."""
HEADING, YAW_RATE, NORTH, EAST, SURGE, SWAY = range(6)
PSI, R, R_DOT, N, VN, AN, E, VE, AE = range(9)

FASTEST_HZ = 5.0
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


def internal_step_s(time_ns: Ints, values: Floats) -> float:
    """The internal step: the median interval of the fastest channel, or that of :data:`FASTEST_HZ` if longer."""
    intervals = [
        float(np.median(np.diff(np.unique(time_ns[valid])))) / NANO
        for valid in np.isfinite(values).T
        if np.unique(time_ns[valid]).size > 1
    ]
    return max(min(intervals, default=1.0), 1.0 / FASTEST_HZ)


def combine_samples(table: pd.DataFrame) -> MotionSamples:
    """The samples of a table in any order, combined into internal steps of at most :data:`FASTEST_HZ`."""
    time_ns, values = times_ns(table), motion_values(table)
    valid = np.isfinite(values)
    observed = valid.any(axis=1)
    epoch_ns = int(time_ns[observed].min())
    since_s = (time_ns - epoch_ns) / NANO
    number = np.rint(since_s / internal_step_s(time_ns, values)).astype(np.int64)
    step_of = np.full(len(table), -1, dtype=np.int64)
    kept, step_of[observed] = np.unique(number[observed], return_inverse=True)
    time_s = _mean(step_of[observed], since_s[observed], kept.size)
    value, count, offset, offset2 = np.full((4, kept.size, len(CHANNELS)), np.nan)
    for channel in range(len(CHANNELS)):
        rows = np.flatnonzero(valid[:, channel])
        step, sample, apart_s = step_of[rows], values[rows, channel], since_s[rows] - time_s[step_of[rows]]
        first = np.zeros(kept.size)
        first[step[::-1]] = sample[::-1]
        deviation = sample - first[step]
        if channel == HEADING:
            deviation = np.deg2rad(difference(np.rad2deg(sample), np.rad2deg(first[step])))
        count[:, channel] = np.bincount(step, minlength=kept.size)
        value[:, channel] = first + _mean(step, deviation, kept.size)
        offset[:, channel] = _mean(step, apart_s, kept.size)
        offset2[:, channel] = _mean(step, apart_s**2, kept.size)
    return MotionSamples(epoch_ns, time_s, value, count, offset, offset2, step_of)


def _mean(step: Ints, values: Floats, steps: int) -> Floats:
    """The mean of the values of each step, NaN where there is none."""
    count = np.bincount(step, minlength=steps)
    total = np.bincount(step, values, minlength=steps)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def heading_steps(data: MotionSamples, heading_rad: float, yaw_rate_radps: float) -> Steps:
    """Heading and yaw rate alone, on three states; the standard deviations are of one sample."""
    value = data.value[:, :2]
    row, jumps = np.zeros((data.time_s.size, 2, 9)), np.zeros((2, 9), dtype=bool)
    row[:, 0, PSI : R_DOT + 1], row[:, 1, PSI : R_DOT + 1] = _quadratic(data, HEADING), _slope(data, YAW_RATE)
    noise = np.array([heading_rad, yaw_rate_radps])
    jumps[0, PSI] = jumps[1, R] = True
    return Steps(data.time_s, value, row, _variance(noise, data.count[:, :2]), np.array([2 * np.pi, 0.0]), jumps)


def motion_steps(data: MotionSamples, heading_rad: Floats, noise: Floats) -> Steps:
    """All channels on nine states, linearised about ``heading_rad`` [steps], which sets the headings' turns.

    ``noise`` [channels] is the standard deviation of one sample of each.
    """
    value, turning = data.value.copy(), heading_steps(data, *noise[:2])
    row, jumps = np.zeros((data.time_s.size, len(CHANNELS), 9)), np.zeros((len(CHANNELS), 9), dtype=bool)
    row[:, :2], jumps[:2] = turning.row, turning.jumps
    row[:, NORTH, N : AN + 1] = _quadratic(data, NORTH)
    row[:, EAST, E : AE + 1] = _quadratic(data, EAST)
    turns = np.rint((value[:, HEADING] - heading_rad) / (2 * np.pi))
    value[:, HEADING] -= 2 * np.pi * turns
    cos, sin = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    surge, sway = _nominal(value[:, SURGE]), _nominal(value[:, SWAY])
    for channel, north, east, lever in ((SURGE, cos, sin, sway), (SWAY, -sin, cos, -surge)):
        slope = _slope(data, channel)
        row[:, channel, N : AN + 1], row[:, channel, E : AE + 1] = north * slope, east * slope
        row[:, channel, PSI], row[:, channel, R] = lever, lever * np.nan_to_num(data.offset_s[:, channel])
        value[:, channel] += lever * heading_rad
    for channel, states in {NORTH: [N], EAST: [E], SURGE: [VN, VE], SWAY: [VN, VE]}.items():
        jumps[channel, states] = True
    return Steps(data.time_s, value, row, _variance(noise, data.count), np.zeros(len(CHANNELS)), jumps)


def horizontal_steps(steps: Steps, heading: Floats) -> Steps:
    """Position and speeds with the heading and its derivatives given [steps, 3 or more]."""
    horizontal = slice(NORTH, SWAY + 1)
    row = steps.row[:, horizontal].copy()
    value = steps.value[:, horizontal] - np.einsum("kcj,kj->kc", row[:, :, :3], heading[:, :3])
    row[:, :, :3] = 0.0
    return Steps(
        steps.time_s, value, row, steps.variance[:, horizontal], steps.turn[horizontal], steps.jumps[horizontal]
    )


def first_state(data: MotionSamples) -> Start:
    """The initial state: the first heading and position, with wide variances."""
    mean = np.zeros(9)
    for channel, state in ((HEADING, PSI), (NORTH, N), (EAST, E)):
        measured = np.flatnonzero(np.isfinite(data.value[:, channel]))
        mean[state] = data.value[measured[0], channel] if measured.size else 0.0
    return Start(mean, np.diag(_FIRST_VARIANCE))


def _quadratic(data: MotionSamples, channel: int) -> Floats:
    offset, offset2 = np.nan_to_num(data.offset_s[:, channel]), np.nan_to_num(data.offset_s2[:, channel])
    return np.stack([np.ones_like(offset), offset, offset2 / 2.0], axis=1)


def _slope(data: MotionSamples, channel: int) -> Floats:
    offset = np.nan_to_num(data.offset_s[:, channel])
    return np.stack([np.zeros_like(offset), np.ones_like(offset), offset], axis=1)


def _variance(noise: Floats, count: Floats) -> Floats:
    return np.asarray(noise**2 / np.maximum(count, 1.0))


def _nominal(speed_mps: Floats) -> Floats:
    """The speed of the linearisation: a running median of five, robust against outliers, without NaN."""
    median = pd.Series(speed_mps).rolling(5, center=True, min_periods=1).median()
    return np.asarray(median.interpolate(limit_direction="both").fillna(0.0), dtype=float)


BODY = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps",
        "surge_mps2", "sway_mps2", "yaw_dps2")  # fmt: skip
"""The states of the result: pose, body-fixed velocity, and its rate of change."""


def body_states(mean: Floats) -> Floats:
    """Pose, body-fixed velocity and its time derivative [k, 9], SI, from the filter's states.

    The derivatives are those of the numbers surge, sway and yaw rate: u' = a along the bow + r v, and so on
    (Fossen 2011, section 2.2).
    """
    (surge, sway), (ahead, abeam), r = _in_body_axes(mean)
    return np.stack(
        [mean[:, N], mean[:, E], mean[:, PSI], surge, sway, r, ahead + r * sway, abeam - r * surge,
         mean[:, R_DOT]], axis=1)  # fmt: skip


def body_covariance(mean: Floats, covariance: Floats) -> Floats:
    """The covariance [k, 9, 9] of :func:`body_states` from that of the filter's states."""
    cos, sin = np.cos(mean[:, PSI]), np.sin(mean[:, PSI])
    (surge, sway), (ahead, abeam), r = _in_body_axes(mean)
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


def _in_body_axes(mean: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats], Floats]:
    """Velocity and acceleration forward and to starboard, and the yaw rate: each [k]."""
    velocity = to_ship(mean[:, VN], mean[:, VE], mean[:, PSI])
    return velocity, to_ship(mean[:, AN], mean[:, AE], mean[:, PSI]), mean[:, R]


def apart_from(values: Floats, state: Floats, offset_s: Floats) -> Floats:
    """Samples minus the filter's states [rows, 9] at ``offset_s`` later [rows, channels], SI; the heading's in
    -pi to pi."""
    moved = state.copy()
    moved[:, [0, 3, 6]] += offset_s[:, None] * (state[:, [1, 4, 7]] + 0.5 * offset_s[:, None] * state[:, [2, 5, 8]])
    moved[:, [1, 4, 7]] += offset_s[:, None] * state[:, [2, 5, 8]]
    residual = values - body_states(moved)[:, [BODY.index(name) for name in CHANNELS]]
    residual[:, HEADING] = np.remainder(residual[:, HEADING] + np.pi, 2 * np.pi) - np.pi
    return residual


def in_gaps(table: pd.DataFrame, epoch_ns: int, grid_s: Floats, longest_gap_s: float | None) -> Bools:
    """Mask of the grid points [rows] in a gap of the heading's channels or of the others, or outside them.

    A gap is longer than ``longest_gap_s``; by default than 2.5 intervals, but at least 3 s and at most 10 s.
    """
    valid = np.isfinite(motion_values(table))
    times_s = (times_ns(table) - epoch_ns) / NANO
    hidden = np.zeros(grid_s.size, dtype=bool)
    for channels in ([HEADING, YAW_RATE], [NORTH, EAST, SURGE, SWAY]):
        hidden |= _outside_samples(np.unique(times_s[valid[:, channels].any(axis=1)]), grid_s, longest_gap_s)
    return hidden


def _outside_samples(samples_s: Floats, grid_s: Floats, longest_gap_s: float | None) -> Bools:
    interval_s = float(np.median(np.diff(samples_s))) if samples_s.size > 1 else 0.0
    limit_s = own_gap_s(interval_s * NANO) if longest_gap_s is None else longest_gap_s
    before = np.searchsorted(samples_s, grid_s + 1e-6, side="right") - 1
    after = np.minimum(before + 1, samples_s.size - 1)
    on_sample = np.abs(grid_s - samples_s[np.maximum(before, 0)]) <= 1e-6
    span = np.where((after > before) & (before >= 0), samples_s[after] - samples_s[np.maximum(before, 0)], np.inf)
    return np.asarray(~on_sample & (span > limit_s))
