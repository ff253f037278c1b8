"""Whether position, heading, speeds and yaw rate are consistent with one motion, and by what they differ if not.

Whatever the ship does, and in waves and current too (speeds are over ground):

    d(position)/dt = R(heading - b) [f u - y r, f v + x r + dy/dt],    d(heading)/dt = c r + d,

with the factor f of the recorded speeds, the heading's offset b, the lever arm (x, y) from the point of the speeds
to that of the positions, scale c and bias d of the yaw rate. As a ship heels in turns by its centripetal
acceleration, a little later, an antenna high up goes to the side: y = y0 + h u r + l u dr/dt. And each group may
be stamped too late. Both equations are integrated over blocks of time and solved by Gauss-Newton steps, from slow
motion to faster so that a delay is not mistaken by whole waves. What a trial cannot determine (a ship that never
turns, a steady speed) has a wide interval. Gross errors are corrected before
(:mod:`seatrial.analysis.quality.motion.model`).

In waves the ship rolls and pitches as well, which moves an antenna high up but not the point of the speeds, and
filters of sensors act: the equations hold for motion that is slower than waves, and for faster motion only where it
says the same. So they are solved by the slow motion alone first, and by all; where all contradicts the slow motion,
the estimate of the slow motion is selected (a specification test: J. A. Hausman, Econometrica 46, 1978).

Whether the values are the same throughout a recording is tested by its quarters, each fitted by itself. Where
they differ by more than their errors, their spread is an error of its own (random effects: R. DerSimonian and N.
Laird, Meta-analysis in clinical trials, 1986), and the interval is Student's for as many quarters.

The least squares are robust, on blocks of time, frequency by frequency. Differences of a measured level (position,
heading) and an integrated rate are white noise of the level plus the random walk of the integrated noise. The
cosine transform of a block makes both uncorrelated, so each frequency is weighted by its own noise, estimated from
the residuals themselves; the mean of a block is left out, hence no level and no drift from block to block matters.
Blocks that do not belong (jumps) lose weight. The covariance is the larger of what the noise says and what leaving
out one block after another says (jackknife: B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans,
1982).

Jumps of positions and headings are removed before the fit, and those of positions are reported. A level jumps as
stamps jitter and clocks are set: from one sample to the next it steps by far more than the model. A jump of
positions also lasts: the error about the fitted path steps by far more than the medians of neighbouring stretches
differ by elsewhere, and at once, or nearly so. Where stamps are missing or crowd, the clock may have been set,
which is reported elsewhere; samples that repeat are stuck.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import block_diag
from scipy.special import chdtri, stdtrit

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, to_earth
from seatrial.analysis.quality.motion import model as motion_model
from seatrial.analysis.series import jackknife_error, runs_of_equal

PATH_PARAMETERS = (
    "speed_factor", "heading_offset_rad", "position_delay_s", "heading_delay_s", "forward_m", "starboard_m",
    "heel_s2", "heel_lag_s3",
)  # fmt: skip
TURN_PARAMETERS = ("yaw_rate_factor", "yaw_rate_bias_radps", "heading_after_yaw_rate_s")
NAMES = PATH_PARAMETERS + TURN_PARAMETERS
_OF_PATH, OF_TURN = slice(len(PATH_PARAMETERS)), slice(len(PATH_PARAMETERS), None)
CHANCE = 1e-4
"""Probability that a figure of a sound trial is called wrong."""
_DELAY_PRIOR_S = 20.0
_PATH_PRIOR = np.array([1.0, 1.0, _DELAY_PRIOR_S, _DELAY_PRIOR_S, 100.0, 100.0, 100.0, 100.0])
_TURN_PRIOR = np.array([1.0, 0.1, _DELAY_PRIOR_S])
_NEUTRAL_PATH, _NEUTRAL_TURN = (np.eye(prior.size)[0] for prior in (_PATH_PRIOR, _TURN_PRIOR))
_OF_HEEL = [PATH_PARAMETERS.index(name) for name in ("heel_s2", "heel_lag_s3")]
_OF_RANGE = ("speed_factor", "heading_offset_rad", "yaw_rate_factor", "yaw_rate_bias_radps")
_RANGED = [NAMES.index(name) for name in _OF_RANGE]
_FIXED = 1e-6
_CLEAR = 4.0
_LONGEST_STEP, _LONGEST_FAST_STEP = 0.2, 0.05
"""Longest steps by the slow motion and by faster, as a share of the prior: of a delay 4 s and 1 s. A small boat
swings in 10 s, and by steps of 4 s its delays settle a whole swing off."""
_FARTHEST = 0.6
_BLOCK_S = (40.0, 100.0)
_BLOCKS = 20
_FEWEST_BLOCKS = 5
_SHORTEST_BLOCK_S = 20.0
_FEWEST_COSINES = 3
SLOW_HZ = 1.0 / 30.0
"""Sea waves are faster: 1 to 30 s are their periods (W. H. Munk, Origin and generation of waves, 1950)."""
_SLOW_STAGES = (None, None, None)
_STAGES_HZ = (0.15, 0.5)
_MOST_STEPS = 8
_ARRIVED = 0.1
"""A step is the last that is shorter than this share of the standard errors."""
_SAMPLING = (0.005, 0.015)
"""Standard deviation of delays by sampling and interpolation: seconds, and a share of the slowest interval. In
`tests/benchmarks/delay_trials.py` the intervals of delays known within 0.02 s hold with these in 97 %."""
PARTS = 4
"""Parts of a recording that are fitted by themselves."""
_FEWEST_PARTS = 3
_CHANCE_OF_PARTS = 1e-3
_SAMPLES = 8
_ALIKE = np.array([2e-4, 2e-4, 0.01, 0.01, 0.05, 0.05, 0.05, 0.05, 5e-4, 1e-5, 0.01])
"""Differences that sampling and interpolation may make, as standard deviations."""
_FIT_ROUNDS = 4
_TOLERATED = 4.0
_LEAST_VARIANCE = 1e-10  # of 0.01 mm or 0.0006 deg: in tables without noise the equations would have no solution
_LEAST_RELIABILITY = 0.5
"""A direction in which less than half of the slopes is motion is left out of a band."""
_CHI2_MEDIAN = 0.455
_JUMP = 6.0
_LEAST_JUMP = 0.05
_MOST_JUMPS = 0.6
_NORMAL_QUARTER = 0.3186  # a quarter of normal deviations is smaller: a scale that half of the steps cannot distort
_MOST_STILL = 0.2  # less than the quarter of the steps that the scale is taken from
_JUMP_ROUNDS = 12
_LEAST_FACTOR = 0.05
_STIFFNESS = np.array([1.0, 1.0, 0.01, 0.01, 1e-4, 1e-4, 1e-4, 1e-4])
_JUMP_STRETCH_S = 5.0
_FEWEST_IN_STRETCH = 4
_MOST = 20
_THIN_S = 0.5
_SIGMAS = 10.0
_USUAL = 3.0  # times what 95 % of the stretches differ by
_SMALLEST_M, _SMALLEST_S = 1.0, 1.0  # or what the ship makes in a second at its fastest, if that is less
_AT_ONCE = 0.7  # of a jump happens within the time below: filters and interpolation make a short ramp of it
_AT_ONCE_S = 2.5
_RETURNED = 0.3
_LONGEST_AWAY = 0.1  # of the recording
_STUCK_S = 3.0


@dataclass(frozen=True)
class Kinematics:
    """Corrections that make the motion channels agree.

    The parameters [11] are in the order of :data:`NAMES`: the factors that the recorded speeds and yaw rate must be
    multiplied by, heading reported minus true, delays of positions and heading after the speeds and of the heading
    after the yaw rate (> 0: stamped too late), the lever arm of the positions, what heel in turns adds to it, and
    what must be added to the scaled yaw rate. ``slow`` are they by the motion below ``slow_hz``, ``broadband`` by
    all up to ``fastest_hz``; ``from_slow`` [11] are those that are taken from the slow motion.
    ``quarters_half_width`` [11] is the least half width of an interval by how the quarters of the recording differ,
    zero where they agree or were not asked (:func:`widen_by_quarters`); ``quarters`` are those that could be
    fitted. ``converged`` is False where the fit ran against its bounds; ``coarse`` is where it began.
    """

    slow: MotionSolution
    broadband: MotionSolution
    from_slow: Bools
    slow_hz: float
    fastest_hz: float
    blocks: int
    motion: motion_model.CleanMotion
    converged: bool = True
    coarse: motion_model.Coarse = field(default_factory=motion_model.Coarse)
    quarters_half_width: Floats = field(default_factory=lambda: np.zeros(len(NAMES)))
    quarters: tuple[MotionSolution, ...] = ()

    @cached_property
    def selected(self) -> MotionSolution:
        """By the slow motion where that is selected, else by all."""
        slow, broadband = self.slow, self.broadband
        return MotionSolution(
            np.where(self.from_slow, slow.parameters, broadband.parameters),
            np.where(self.from_slow[:, np.newaxis], slow.covariance, broadband.covariance),
            np.where(self.from_slow, slow.informative, broadband.informative),
        )

    def value(self, name: str) -> float:
        return float(self.selected.parameters[NAMES.index(name)])

    def standard_error(self, name: str) -> float:
        return float(self.selected.standard_errors[NAMES.index(name)])

    def band_hz(self, name: str, neutral: float = 0.0) -> tuple[float, float]:
        """The band by which a figure differs from its neutral value: from 0 where the slow motion does so too."""
        place = NAMES.index(name)
        if self.from_slow[place]:
            return 0.0, self.slow_hz
        deviation = abs(float(self.slow.parameters[place]) - neutral)
        is_significant = deviation > student_t_quantile(0.975, self.slow.informative[place]) * np.sqrt(
            self.slow.covariance[place, place]
        )
        return 0.0 if is_significant else self.slow_hz, self.fastest_hz

    def interval(self, name: str) -> tuple[float, float]:
        """The 95 % interval, by Student's t for its effective number of blocks, or for parts that differ."""
        half = student_t_quantile(0.975, self.selected.informative[NAMES.index(name)]) * self.standard_error(name)
        half = max(half, float(self.quarters_half_width[NAMES.index(name)]))
        return self.value(name) - half, self.value(name) + half


def student_t_quantile(probability: float, informative: float) -> float:
    """Quantile of Student's t; three degrees of freedom are added, as the noise of all blocks is known too."""

    return float(stdtrit(max(informative, 1.0) + 3.0, probability))


def fit_kinematics(table: pd.DataFrame, coarse: motion_model.Coarse | None = None) -> Kinematics:
    """Fit the motion channels of a table of raw samples to each other.

    Raises :class:`InputError` where a motion channel is missing and :class:`DataShortageError` where fewer than
    5 blocks of 40 s hold all of them.
    """
    coarse = motion_model.fit_coarsely(table) if coarse is None else coarse
    if coarse.is_neutral:
        return replace(fit_motion(motion_model.motion_of(table)), coarse=coarse)
    speeds = {name: table[name] * coarse.speed_factor for name in ("surge_mps", "sway_mps")}
    heading = (table["heading_deg"] - np.rad2deg(coarse.heading_offset_rad)) % 360.0
    yaw_rate = table["yaw_rate_dps"] * coarse.yaw_rate_factor
    fit = fit_motion(motion_model.motion_of(table.assign(**speeds, heading_deg=heading, yaw_rate_dps=yaw_rate)))

    # From the corrected table back to the table itself: factors multiply, angles add.
    scale, shift = np.ones(len(NAMES)), np.zeros(len(NAMES))
    scale[NAMES.index("speed_factor")] = coarse.speed_factor
    scale[NAMES.index("yaw_rate_factor")] = coarse.yaw_rate_factor
    shift[NAMES.index("heading_offset_rad")] = coarse.heading_offset_rad
    slow, broadband = (
        replace(
            solution,
            parameters=solution.parameters * scale + shift,
            covariance=solution.covariance * np.outer(scale, scale),
        )
        for solution in (fit.slow, fit.broadband)
    )
    recorded = rescale(
        fit.motion, 1.0 / coarse.speed_factor, -coarse.heading_offset_rad, 1.0 / coarse.yaw_rate_factor
    )
    return replace(fit, slow=slow, broadband=broadband, motion=recorded, coarse=coarse)


def rescale(
    motion: motion_model.CleanMotion, speed_factor: float, heading_offset_rad: float, yaw_rate_factor: float
) -> motion_model.CleanMotion:
    """Speeds and yaw rate multiplied by their factors, and the offset subtracted from the heading."""
    return replace(
        motion,
        heading=replace(motion.heading, levels=motion.heading.levels - heading_offset_rad),
        speed=replace(motion.speed, levels=motion.speed.levels * speed_factor),
        yaw_rate=replace(motion.yaw_rate, levels=motion.yaw_rate.levels * yaw_rate_factor),
    )


def fit_motion(motion: motion_model.CleanMotion, heel: Floats | None = None) -> Kinematics:
    """As :func:`fit_kinematics`, of a motion that is already cleaned; ``heel`` [2] fixes the parameters of that."""
    start = max(group.time_s[0] for group in motion.groups)
    end = min(group.time_s[-1] for group in motion.groups)
    grid_s = np.arange(start, max(end, start) + 1e-6, motion.step_s)
    block_s = min(float(np.clip((end - start) / _BLOCKS, *_BLOCK_S)), (end - start) / _FEWEST_BLOCKS)
    length = int(max(block_s, _SHORTEST_BLOCK_S) / motion.step_s + 1e-6)
    starts = motion_model.block_starts(motion, grid_s, max(length, 1))
    if length < 2 or len(starts) < _FEWEST_BLOCKS:  # a block of one sample shows no motion
        raise DataShortageError(
            f"holds {len(starts)} stretches of {max(length, 2) * motion.step_s:.0f} s with all motion channels",
            why=f"it takes {_FEWEST_BLOCKS}", fix="record for longer",
        )  # fmt: skip
    slowest_s = max(group.interval_s for group in motion.groups)
    frame = _Frame(grid_s, starts, length, motion.step_s, 0.2 / slowest_s)
    parts = (motion, motion.every_other_sample(0), motion.every_other_sample(1))
    paths, turns = (
        tuple(model(part, grid_s) for part in parts) for model in (motion_model.path_model, motion_model.turn_model)
    )
    path_prior, neutral = _PATH_PRIOR.copy(), _NEUTRAL_PATH.copy()
    if heel is not None:
        path_prior[_OF_HEEL], neutral[_OF_HEEL] = _FIXED, heel
    path = _Fit(motion.position, paths, path_prior, neutral, frame).solve()
    turn = _Fit(motion.heading, turns, _TURN_PRIOR, _NEUTRAL_TURN, frame).solve()
    slow_is_better = (
        _is_slow_estimate_better(*path, _ALIKE[_OF_PATH]),
        _is_slow_estimate_better(*turn, _ALIKE[OF_TURN]),
    )
    from_slow = np.repeat(slow_is_better, [len(PATH_PARAMETERS), len(TURN_PARAMETERS)])
    # What sampling and interpolation may do to the parameters, as standard deviations.
    fixed_s, fraction = _SAMPLING
    sampling = np.where([name.endswith("_s") for name in NAMES], fixed_s + fraction * slowest_s, 0.0)
    slow, broadband = (
        MotionSolution(
            np.concatenate([of_path.parameters, of_turn.parameters]),
            block_diag(of_path.covariance, of_turn.covariance),
            np.concatenate([of_path.informative, of_turn.informative]),
        ).widened(sampling)
        for of_path, of_turn in zip(path, turn, strict=True)
    )
    fit = Kinematics(
        slow, broadband, from_slow, frame.slow_hz, min(_STAGES_HZ[-1], frame.highest_hz), len(starts), motion
    )  # fmt: skip
    # The linearised fit is valid where factors, angle and bias are within a range, or may be.
    deviation = np.abs(fit.selected.parameters - np.concatenate([_NEUTRAL_PATH, _NEUTRAL_TURN]))[_RANGED]
    limits = np.maximum(_FARTHEST, _CLEAR * fit.selected.standard_errors[_RANGED])
    return replace(fit, converged=bool((deviation < limits).all()))


def _is_slow_estimate_better(slow: MotionSolution, broadband: MotionSolution, tolerance: Floats) -> bool:
    """Whether the estimate of the slow motion is to be selected: it is the more precise, or that of all motion
    differs beyond errors and what sampling may do.

    All would be the more precise if both were right, so that their difference has at most the slow one's variance.
    """
    if np.linalg.slogdet(slow.covariance)[1] < np.linalg.slogdet(broadband.covariance)[1]:
        return True
    errors = np.hypot(np.sqrt(np.diag(slow.covariance)), tolerance)
    limits = np.array([student_t_quantile(1.0 - 0.5 * _CHANCE_OF_PARTS, count) for count in slow.informative])
    return bool((np.abs(broadband.parameters - slow.parameters) > limits * errors).any())


@dataclass(frozen=True, slots=True)
class _Frame:
    """The grid, its blocks and the highest frequency that the slowest channel resolves."""

    grid_s: Floats
    starts: Ints
    length: int
    step_s: float
    highest_hz: float

    def cosine_count(self, limit_hz: float) -> int:
        """How many cosines lie below a frequency."""
        count = int(2.0 * self.length * self.step_s * min(limit_hz, self.highest_hz))
        return int(np.clip(count, _FEWEST_COSINES, self.length - 1))

    @property
    def slow_hz(self) -> float:
        """Where what is slower than waves ends; in short blocks where their fewest cosines do."""
        return self.cosine_count(SLOW_HZ) / (2.0 * self.length * self.step_s)


@lru_cache(maxsize=64)
def _low_pass_filter(edge: float) -> Floats:
    """Sections of a filter that every step of a fit needs again; its edge in shares of the samples' rate."""
    from scipy.signal import butter

    return np.asarray(butter(4, edge, fs=1.0, output="sos"))


@dataclass(frozen=True)
class _Fit:
    """Levels and the models they are fitted by: of all samples, of every other one, and of the rest."""

    level: motion_model.Group
    models: tuple[motion_model.Model, ...]
    prior: Floats
    start: Floats
    frame: _Frame

    @cached_property
    def measured_level(self) -> Callable[..., Floats]:
        """The level at any time."""
        return motion_model.interpolating_spline(self.level)

    def solve(self) -> tuple[MotionSolution, MotionSolution]:
        """By the slow motion and by all; of the levels as they are or, where they jump and that gives a smaller
        covariance, without their jumps.

        To take a jump out costs the noise of two samples, from there on: too much where it was only noise.
        """
        solutions = self._slow_and_broadband()
        level_without_jumps = remove_jumps(self.level, self.models[0], self.frame.grid_s, solutions[1].parameters)
        if level_without_jumps is self.level:
            return solutions
        without_jumps = replace(self, level=level_without_jumps)._slow_and_broadband()
        return min(
            solutions, without_jumps, key=lambda candidate: float(np.linalg.slogdet(candidate[1].covariance)[1])
        )

    def _slow_and_broadband(self) -> tuple[MotionSolution, MotionSolution]:
        """Gauss-Newton steps by the slow motion, and on from there by faster and faster until they end."""
        slow = self._gauss_newton(MotionSolution(self.start, np.diag(self.prior**2), self.start), _SLOW_STAGES)
        return slow, self._gauss_newton(slow, _STAGES_HZ, _MOST_STEPS)

    def _gauss_newton(
        self, solution: MotionSolution, stages: tuple[float | None, ...], steps: int = 0
    ) -> MotionSolution:
        """Steps from ``solution`` by the motion below each of ``stages`` [Hz], None for the slow motion alone, and
        at most so many ``steps`` more by the last.

        What does not differ significantly from its neutral value starts each stage there, or a delay might settle a
        whole wave period off; what the last step still moved is not known better.
        """
        for limit_hz in stages:
            unclear = np.abs(solution.parameters - self.start) < _CLEAR * solution.standard_errors
            before, solution = (
                solution,
                self._gauss_newton_step(np.where(unclear, self.start, solution.parameters), limit_hz),
            )
        for _ in range(steps):
            before, solution = solution, self._gauss_newton_step(solution.parameters, limit_hz)
            if (np.abs(solution.parameters - before.parameters) < _ARRIVED * solution.standard_errors).all():
                break
        return solution.widened(2.0 * (solution.parameters - before.parameters))

    def _gauss_newton_step(self, values: Floats, limit_hz: float | None) -> MotionSolution:
        """One Gauss-Newton step from ``values`` by the motion below ``limit_hz``, None for the slow motion.

        What is faster than the slow motion would leak into the cosines of its blocks and is filtered out before;
        nothing is shifted.
        """
        from scipy.fft import dct
        from scipy.signal import sosfiltfilt

        level, frame = self.level, self.frame
        count = frame.cosine_count(limit_hz or SLOW_HZ)
        (expected, slopes), first, second = (model(values) for model in self.models)
        times = np.clip(frame.grid_s + values[2], level.time_s[0], level.time_s[-1])
        expected_noise, slopes_noise = (0.5 * (even - odd) for even, odd in zip(first, second, strict=True))
        coefficients = []  # orthonormal cosines 1 to ``count`` of each block: [blocks, ..., count]
        for part in (self.measured_level(times) - expected, slopes, -expected_noise, slopes_noise):
            if limit_hz is None:
                sections = _low_pass_filter(min(1.25 * frame.slow_hz * frame.step_s, 0.45))
                padded = min(len(part) - 1, int(3.0 / (frame.slow_hz * frame.step_s)))
                part = sosfiltfilt(sections, part, axis=0, padlen=padded)
            blocks = part[frame.starts[:, np.newaxis] + np.arange(frame.length)]
            coefficients.append(np.moveaxis(dct(blocks, axis=1, norm="ortho")[:, 1 : count + 1], 1, -1))
        residuals, basis, *noise = coefficients
        update = solve_robust_least_squares(residuals, basis, (noise[0], noise[1]), self.prior)
        longest = _LONGEST_STEP if limit_hz is None else _LONGEST_FAST_STEP
        bounds = longest * self.prior[:4]  # lever arms are linear
        excess = float(np.max(np.abs(update.parameters[:4]) / bounds))
        return replace(update, parameters=values + update.parameters / max(excess, 1.0))


def widen_by_quarters(fit: Kinematics) -> Kinematics:
    """Widen the intervals of a fit by how the quarters of the recording differ.

    It takes as long as the fit itself. Recordings of whose quarters fewer than three can be
    fitted stay as they are.
    """
    coarse, parts = fit.coarse, []
    heel = fit.selected.parameters[_OF_HEEL]  # a quarter is too short to determine it
    motion = rescale(fit.motion, coarse.speed_factor, coarse.heading_offset_rad, coarse.yaw_rate_factor)
    for begin, end in pairwise(np.linspace(motion.position.time_s[0], motion.position.time_s[-1], PARTS + 1)):
        position, heading, speed, yaw_rate = (
            group.excluding((group.time_s < begin) | (group.time_s > end)) for group in motion.groups
        )
        quarter = motion_model.CleanMotion(position, heading, speed, yaw_rate, motion.step_s)
        if min(group.time_s.size for group in quarter.groups) >= _SAMPLES:
            with suppress(DataShortageError):
                part = fit_motion(quarter, heel)
                parts.append(replace(part, from_slow=fit.from_slow))
    parts = [part for part in parts if part.converged]
    fit = replace(fit, quarters=tuple(part.selected for part in parts))
    if len(parts) < _FEWEST_PARTS:
        return fit
    # Half of the 95 % interval of the mean of the quarters, zero where they agree within their variances, which are
    # widened for few blocks as Student's t is at 95 %.
    widening = np.array(
        [[student_t_quantile(0.975, count) / 1.96 for count in part.selected.informative] for part in parts]
    )
    variance = (np.array([part.selected.standard_errors for part in parts]) * widening) ** 2 + _ALIKE**2
    values = np.array([part.selected.parameters for part in parts])
    weights, freedom = 1.0 / variance, len(values) - 1
    total = weights.sum(axis=0)
    scatter = (weights * (values - (weights * values).sum(axis=0) / total) ** 2).sum(axis=0)
    added = np.maximum(scatter - freedom, 0.0) / np.maximum(total - (weights**2).sum(axis=0) / total, 1e-300)
    error = np.sqrt(1.0 / (1.0 / (variance + added)).sum(axis=0))
    limit, times = float(chdtri(freedom, _CHANCE_OF_PARTS)), float(stdtrit(freedom, 0.975))
    half: Floats = np.where(scatter > limit, times * error, 0.0)
    half[NAMES.index("speed_factor")] *= abs(coarse.speed_factor)
    half[NAMES.index("yaw_rate_factor")] *= abs(coarse.yaw_rate_factor)
    return replace(fit, quarters_half_width=half)


@dataclass(frozen=True, slots=True)
class MotionSolution:
    """``parameters`` [p], their ``covariance`` [p, p], and the effective number of blocks for each [p]."""

    parameters: Floats
    covariance: Floats
    informative: Floats

    @property
    def standard_errors(self) -> Floats:
        return np.sqrt(np.diag(self.covariance))

    def widened(self, deviations: Floats) -> MotionSolution:
        """With independent errors of these standard deviations [p] added."""
        return replace(self, covariance=self.covariance + np.diag(deviations**2))


def solve_robust_least_squares(
    residuals: Floats, slopes: Floats, noise: tuple[Floats, Floats], prior: Floats
) -> MotionSolution:
    """Estimate parameters from residuals [blocks, c, k] and their derivatives ``slopes`` [blocks, p, c, k].

    ``noise`` are draws of the noise of both, as half of the difference between what every other sample gives and
    what the others give: it has none of the motion, which both have smoothed alike by their wider steps. ``prior``
    [p] are standard deviations far beyond anything sensible: they bound what the data do not determine. The
    covariance comes from the noise and a jackknife over blocks.
    """
    bands, precision = _frequency_band_starts(residuals.shape[-1]), np.diag(prior**-2.0)
    sizes = np.diff(np.append(bands, residuals.shape[-1]))
    weights = np.broadcast_to(1.0 / _noise_variance_by_frequency(residuals, bands), residuals.shape)
    for _ in range(_FIT_ROUNDS):
        true, matrices, sides = _normal_equations_of_true_motion(residuals, slopes, noise, weights, precision)
        values = np.linalg.solve(matrices.sum(axis=0) + precision, sides.sum(axis=0))
        residual = residuals - np.tensordot(true, values, (1, 0))
        variance = _noise_variance_by_frequency(residual, bands)
        ratio = residual**2 / variance
        excess = np.add.reduceat(ratio.sum(axis=1), bands, axis=-1) / (sizes * ratio.shape[1])
        trust = np.minimum(1.0, _TOLERATED / np.maximum(excess, 1e-300))  # 1 where as noisy as the other blocks
        weights = np.broadcast_to(np.repeat(trust, sizes, axis=-1)[:, np.newaxis, :] / variance, residuals.shape)
    _, matrices, sides = _normal_equations_of_true_motion(residuals, slopes, noise, weights, precision)
    total = matrices.sum(axis=0) + precision
    covariance = np.linalg.inv(total)
    shares = np.einsum("pi,bij,pj->bp", covariance, matrices, covariance, optimize=True)
    informative = shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300)
    remaining = sides.sum(axis=0) - sides
    leave_one_out = np.linalg.solve(total - matrices, remaining[..., np.newaxis])[..., 0]
    spread = jackknife_error(leave_one_out) ** 2
    inflation = np.sqrt(np.maximum(1.0, spread / np.diag(covariance)))
    values = covariance @ sides.sum(axis=0)
    return MotionSolution(values, covariance * np.outer(inflation, inflation), informative)


def _normal_equations_of_true_motion(
    residuals: Floats, slopes: Floats, noise: tuple[Floats, Floats], weights: Floats, precision: Floats
) -> tuple[Floats, Floats, Floats]:
    """The slopes that are expected of the true motion [blocks, p, c, k], and the normal equations of each block:
    [blocks, p, p] and [blocks, p].

    Noise in slopes makes parameters too small. In a regression on what the noisy slopes let expect of the true
    ones, band by band, it does not (regression calibration: R. J. Carroll et al., Measurement Error in Nonlinear
    Models, 2006, chapter 4). What the noise of residuals and slopes has in common is subtracted.
    """
    bands = _frequency_band_starts(slopes.shape[-1])
    # The matrices of the bands that turn slopes into what is expected of the true ones; directions that are mostly
    # noise are left out: what remains of them is chance.
    lower = np.linalg.cholesky(_information_by_band(slopes, weights, bands) + precision)
    root = np.linalg.inv(lower)
    noise_share = root @ _information_by_band(noise[1], weights, bands) @ root.swapaxes(1, 2)
    reliability, directions = np.linalg.eigh(np.eye(len(precision)) - noise_share)
    reliability = np.where(reliability > _LEAST_RELIABILITY, reliability, 0.0)
    expecting = lower @ (directions * reliability[:, np.newaxis]) @ directions.swapaxes(1, 2) @ root
    by_frequency = np.repeat(expecting, np.diff(np.append(bands, slopes.shape[-1])), axis=0)
    blocks, parameters, components, count = slopes.shape
    true, noisy = (
        (by_frequency @ _by_frequency(part)).reshape(count, parameters, blocks, components).transpose(2, 1, 3, 0)
        for part in (slopes, noise[1])
    )
    matrices, sides = _normal_equations_by_block(residuals, true, weights)
    return true, matrices, sides - _normal_equations_by_block(noise[0], noisy, weights)[1]


def _by_frequency(slopes: Floats) -> Floats:
    """Slopes [blocks, p, c, k] as matrices of each frequency [k, p, blocks c]."""
    return slopes.transpose(3, 1, 0, 2).reshape(slopes.shape[3], slopes.shape[1], -1)


def _information_by_band(slopes: Floats, weights: Floats, bands: Ints) -> Floats:
    """Weighted products of slopes [blocks, p, c, k], summed over each band: [bands, p, p]."""
    weighted = _by_frequency(slopes * np.sqrt(weights)[:, np.newaxis])
    return np.asarray(np.add.reduceat(weighted @ weighted.swapaxes(1, 2), bands, axis=0))


def _normal_equations_by_block(residuals: Floats, slopes: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The normal equations of each block: [blocks, p, p] and [blocks, p]."""
    count, parameters = slopes.shape[:2]
    flat = slopes.reshape(count, parameters, -1)
    weighted = flat * weights.reshape(count, 1, -1)
    return weighted @ flat.transpose(0, 2, 1), (weighted @ residuals.reshape(count, -1, 1))[..., 0]


def _frequency_band_starts(count: int) -> Ints:
    """First coefficients of bands that widen with frequency by about a third."""
    edges = np.unique(np.floor(1.33 ** np.arange(0, 60)).astype(np.int64) - 1)
    return edges[edges < count]


def _noise_variance_by_frequency(residual: Floats, bands: Ints) -> Floats:
    """Variance of each component at each frequency [c, k], robust, and at least that of all higher ones."""
    power = np.median(residual**2, axis=0) / _CHI2_MEDIAN
    sizes = np.diff(np.append(bands, power.shape[-1]))
    level = np.add.reduceat(power, bands, axis=-1) / sizes
    falling = np.maximum.accumulate(level[:, ::-1], axis=-1)[:, ::-1]
    return np.repeat(np.maximum(falling, _LEAST_VARIANCE), sizes, axis=-1)


def remove_jumps(
    level: motion_model.Group, model: motion_model.Model, grid_s: Floats, values: Floats
) -> motion_model.Group:
    """Remove jumps of positions or headings, as they come from jittering stamps and clocks that are set.

    A step from one sample to the next is a jump where it differs from the model's by far more than the usual
    step does, and by a good part of the distance; the model's step takes its place. Where there are such steps at
    ``values`` [p], a robust regression on steps stands many of them where one on levels does not: redescending
    weights (Cauchy's, squared) with a tolerance that narrows. It starts from ``values`` and from the most frequent
    ratio of measured to model's steps, and the tighter fit counts. Returns ``level`` itself where nothing, or
    nearly everything, jumps, and where it often stands still: it is rounded so coarsely then that its steps are
    those of the rounding.
    """
    still = (np.abs(np.diff(level.levels, axis=0)) < 1e-9).all(axis=1)
    if still.mean() > _MOST_STILL:
        return level
    steps = _predicted_steps(level, model, grid_s, values)
    if not _jump_mask(steps).any():
        return level
    fits = []
    for fit in (values, _move_to_mode(steps, values)):
        for number in range(_JUMP_ROUNDS):
            steps = _predicted_steps(level, model, grid_s, fit)
            scale = _robust_step_scale(steps)
            tolerance = scale * max(2.0, 6.0 * 0.7**number)
            weights = 1.0 / (1.0 + (steps.error / tolerance) ** 2) ** 2 / scale**2
            flat = (steps.slopes * weights[:, np.newaxis]).transpose(1, 0, 2).reshape(fit.size, -1)
            matrix = flat @ steps.slopes.transpose(0, 2, 1).reshape(-1, fit.size) + np.diag(_STIFFNESS[: fit.size])
            fit = fit + np.clip(np.linalg.solve(matrix, flat @ steps.error.ravel()), -4.0, 4.0)
        fits.append(_predicted_steps(level, model, grid_s, fit))
    steps = min(fits, key=lambda candidate: float(_robust_step_scale(candidate)[0]))
    jumps = _jump_mask(steps)
    if not jumps.any() or jumps.mean() > _MOST_JUMPS:
        return level
    at_jumps = jumps | np.append(jumps[1:], False) | np.append(False, jumps[:-1])
    error, angle = steps.error, steps.angle
    in_sample_frame = (
        motion_model.rotate_to_earth(angle, error) if error.shape[1] == 2 else error * np.cos(angle)[:, np.newaxis]
    )
    removed = np.where(at_jumps[:, np.newaxis], in_sample_frame, 0.0)
    shift = np.vstack([np.zeros(removed.shape[1]), np.cumsum(removed, axis=0)])
    return motion_model.Group(level.time_s, level.levels - shift, level.interval_s)


@dataclass(frozen=True, slots=True)
class _Steps:
    """From each sample to the next: ``error`` [n, m], of positions along and across the model's step, the
    model's ``slopes`` [n, p, m], how far it goes and, for positions, in which direction [n]."""

    error: Floats
    slopes: Floats
    distance: Floats
    angle: Floats


def _move_to_mode(steps: _Steps, values: Floats) -> Floats:
    """``values`` with factor and angle moved to where the quarter of the faster steps that agree best lies.

    They are returned as they are if that quarter stands still, as a stuck sensor does: a factor of nearly zero has
    no slope.
    """
    faster = steps.distance >= max(float(np.median(steps.distance)), 1e-6)
    ratios = np.sort(steps.error[faster] / steps.distance[faster, np.newaxis], axis=0)
    quarter = max(1, len(ratios) // 4)
    tightest = np.argmin(ratios[quarter:] - ratios[:-quarter], axis=0)
    middle = ratios[tightest + quarter // 2, np.arange(ratios.shape[1])]
    moved = np.zeros_like(values)
    moved[0], moved[1] = values[0] * (1.0 + middle[0]), values[1]
    if abs(moved[0]) < _LEAST_FACTOR:
        return values
    if middle.size == 2:
        moved[1] -= middle[1]
    return moved


def _robust_step_scale(steps: _Steps) -> Floats:
    return np.asarray(np.quantile(np.abs(steps.error), 0.25, axis=0) / _NORMAL_QUARTER + 1e-9)


def _jump_mask(steps: _Steps) -> Bools:
    limit = np.maximum(_JUMP * _robust_step_scale(steps), _LEAST_JUMP * steps.distance[:, np.newaxis])
    return np.asarray((np.abs(steps.error) > limit).any(axis=1))


def _predicted_steps(
    level: motion_model.Group, model: motion_model.Model, grid_s: Floats, values: Floats
) -> _Steps:
    expected, slopes = model(values)
    both = np.concatenate([expected[:, np.newaxis], slopes], axis=1)
    at = motion_model.interpolate_from_grid(level.time_s - values[2], grid_s, both.reshape(grid_s.size, -1))
    moves = np.diff(at.reshape(-1, *both.shape[1:]), axis=0)
    measured = np.diff(level.levels, axis=0)
    if measured.shape[1] == 1:
        forward = np.where(moves[:, 0, 0] < 0.0, -1.0, 1.0)
        error, moves = (measured - moves[:, 0]) * forward[:, np.newaxis], moves * forward[:, np.newaxis, np.newaxis]
        return _Steps(error, moves[:, 1:], np.abs(moves[:, 0, 0]), np.where(forward < 0.0, np.pi, 0.0))
    angle = np.arctan2(moves[:, 0, 1], moves[:, 0, 0])
    body = np.stack(to_earth(moves[..., 0], moves[..., 1], -angle[:, np.newaxis]), axis=-1)
    return _Steps(
        motion_model.rotate_to_earth(-angle, measured) - body[:, 0], body[:, 1:], np.hypot(*moves[:, 0].T), angle
    )


class PositionErrors(NamedTuple):
    """Of each raw position: when [s], by how much north and east [n, 2], the velocity of the ship [n, 2] and the
    position itself [n, 2]."""

    time_s: Floats
    error: Floats
    velocity: Floats
    raw: Floats


def position_errors(table: pd.DataFrame, fit: Kinematics) -> PositionErrors:
    """Errors of the raw positions about the fitted path, without outliers."""
    motion, parameters = fit.motion, fit.selected.parameters
    grid_s = np.arange(motion.speed.time_s[0], motion.speed.time_s[-1], motion.step_s)
    path, slopes = motion_model.path_model(motion, grid_s)(parameters[_OF_PATH])
    raw = motion_model.group_samples(table, motion_model.GROUPS["north_m"])
    times = raw.time_s - parameters[2]
    within = (times >= grid_s[0]) & (times <= grid_s[-1])
    at = motion_model.interpolate_from_grid(times[within], grid_s, np.hstack([path, -slopes[:, 2]]))
    error = raw.levels[within] - at[:, :2]
    valid = ~motion_model.outlier_mask(error)
    return PositionErrors(times[within][valid], error[valid], at[valid, 2:], raw.levels[within][valid])


@dataclass(frozen=True, slots=True)
class PositionJump:
    """When [s from the table's first row] positions jump, by how much north and east [m], and when they return,
    NaN if they do not."""

    time_s: float
    north_m: float
    east_m: float
    until_s: float


def position_jumps(table: pd.DataFrame, fit: Kinematics) -> tuple[PositionJump, ...]:
    """The jumps of the positions in a table about the motion that was fitted to it; one that the next takes back
    ends there."""
    errors = position_errors(table, fit)
    recorded_s = fit.motion.position.interval_s
    stuck = np.zeros(len(errors.raw), dtype=bool)  # a coordinate has not changed for 3 s: what follows is no jump
    for column in errors.raw.T:
        _, lengths = runs_of_equal(np.diff(column) != 0.0)
        stuck |= np.repeat(lengths * recorded_s > _STUCK_S, lengths)
    time_s, error = errors.time_s[~stuck], errors.error[~stuck]
    thin = max(1, round(_THIN_S / recorded_s)) if time_s.size else 1
    time_s, error = time_s[::thin], error[::thin]
    if time_s.size < 4 * _MOST:
        return ()
    interval_s = float(np.median(np.diff(time_s)))
    width = int(np.clip(_JUMP_STRETCH_S / max(interval_s, 1e-3), _FEWEST_IN_STRETCH, _MOST))
    smallest_m = min(_SMALLEST_M, _SMALLEST_S * float(np.quantile(np.hypot(*errors.velocity.T), 0.98)))
    delay_s, jumps = fit.selected.parameters[2], list[PositionJump]()
    for place, step in _find_lasting_steps(time_s, error, width, smallest_m, fit):
        at_s = float(time_s[place] + delay_s)
        if jumps and np.isnan(jumps[-1].until_s):
            last = np.array([jumps[-1].north_m, jumps[-1].east_m])
            returns = np.hypot(*(last + step)) < _RETURNED * np.hypot(*last)
            if returns and at_s - jumps[-1].time_s < _LONGEST_AWAY * np.ptp(time_s):
                jumps[-1] = replace(jumps[-1], until_s=at_s)
                continue
        jumps.append(PositionJump(at_s, float(step[0]), float(step[1]), np.nan))
    return tuple(jumps)


def _find_lasting_steps(
    time_s: Floats, error: Floats, width: int, smallest_m: float, fit: Kinematics
) -> list[tuple[int, Floats]]:
    """The first sample after each jump, and the jump's size north and east; the motion about it was recorded
    throughout and its stamps do not crowd."""
    interval_s = float(np.median(np.diff(time_s)))
    medians = np.median(sliding_window_view(error, width, axis=0), axis=-1)
    change = medians[width:] - medians[:-width]  # row r is about the step to sample r + width
    size = np.hypot(*change.T)
    limit = max(_SIGMAS * float(np.median(size)), _USUAL * float(np.quantile(size, 0.95)), smallest_m)
    places = np.arange(width, width + len(change))
    half = max(1, round(0.5 * _AT_ONCE_S / interval_s))
    after, before = np.minimum(places + half - 1, len(error) - 1), np.maximum(places - half, 0)
    toward = change / np.maximum(size, 1e-12)[:, np.newaxis]
    along = np.einsum("ij,ij->i", error[after] - error[before], toward)
    at_once = np.einsum("ij,ij->i", error[places] - error[places - 1], toward)
    rows = np.flatnonzero((size > limit) & (along > _AT_ONCE * size))
    steps = []
    for group in np.split(rows, np.flatnonzero(np.diff(rows) > width) + 1) if rows.size else ():
        row = int(group[np.argmax(at_once[group])])
        place = row + width
        first, last = max(place - width, 0), min(place + width, time_s.size - 1)
        recorded = time_s[last] - time_s[first] >= 0.8 * (last - first) * interval_s
        for samples in (fit.motion.speed, fit.motion.heading):
            first, last = np.searchsorted(samples.time_s, time_s[place - 1 : place + 1], side="left")
            inside = samples.time_s[max(first - 1, 0) : last + 1]
            recorded &= inside.size >= 2 and np.diff(inside).max() < 1.8 * samples.interval_s
        if recorded:
            steps.append((place, change[row]))
    return steps
