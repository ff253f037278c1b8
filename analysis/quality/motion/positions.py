"""Stamps that jitter: of positions, which err along the way then, and of headings, which err as the ship turns.

With wrong stamps a position errs along the track, in proportion to the ship's speed; noise of the positions errs
across as much as along. So the variance along less that across, over the square of the speed, is the variance of
the stamps. A heading scatters about the integrated yaw rate: a ship's inertia keeps her yaw rate smooth, and noise
of compass and gyro is the same whether she turns or not, so that the variance that grows with the square of the
yaw rate is that of the stamps.

Each stretch of time counts for itself, about its own straight line and, of headings within what is known of such
sensors, its own scale and delay; the interval comes from a jackknife over stretches.

Positions and headings with jittering time stamps, reconstructed from speeds and yaw rate.

A complementary filter for each: fast motion from the integrated velocity or yaw rate, slow motion from the
recorded positions or headings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, integrate, to_earth
from seatrial.acquisition.core.ship import unwrap, wrap_360
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.fit import (
    CHANCE,
    SLOW_HZ,
    Kinematics,
    PositionErrors,
    fit_kinematics,
    position_errors,
    quantile,
)
from seatrial.analysis.quality.motion.model import GROUPS, group_samples, rotate, turn_model
from seatrial.analysis.series import jackknife_error, ratios_without_each, samples_of
from seatrial.analysis.tables.table import Span, seconds_of, utc_index

SMALLEST_POSITION_JITTER_S = 0.15
_SHORT_S = 30.0
_LONG_S = 120.0
_FEWEST_SAMPLES = 8
_FEWEST_STRETCHES = 5
_BROKEN = 30.0
_LEAST_RATIO = 2.0
_LEAST_WAY = 0.25  # of the squared speed that motion slower than waves makes; a turn within their period leaves 0.4
_LEFT_OVER = 0.06  # of the variance: what is beyond the limit taken


@dataclass(frozen=True, slots=True)
class Jitter:
    """Variance of the stamps [s2] with its standard error and the effective number of stretches.

    ``surplus`` is by how many of its standard errors the variance that jitter makes exceeds the one that it does
    not (of positions along and across the way, of headings with and without turning) in short stretches, whose
    many tell it best, and ``ratio`` the one over the other.
    """

    variance_s2: float = 0.0
    standard_error_s2: float = np.inf
    stretches: float = 0.0
    surplus: float = 0.0
    surplus_stretches: float = 0.0
    ratio: float = 0.0

    @property
    def seconds(self) -> float:
        return float(np.sqrt(max(self.variance_s2, 0.0)))

    def beyond(self, smallest_s: float, chance: float = CHANCE) -> bool:
        """Whether it is at least ``smallest_s`` and significant at ``chance``."""
        surely = self.surplus > quantile(1.0 - chance, self.surplus_stretches)
        return surely and self.seconds >= smallest_s and self.ratio >= _LEAST_RATIO

    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the standard deviation [s]."""
        error = np.hypot(self.standard_error_s2, _LEFT_OVER * self.variance_s2)
        half = quantile(0.975, self.stretches) * error
        low, high = np.sqrt(np.maximum([self.variance_s2 - half, self.variance_s2 + half], 0.0))
        return float(low), float(high)


def stamp_jitter(table: pd.DataFrame, fit: Kinematics) -> Jitter:
    """The jitter of the positions in a table about the motion that was fitted to it.

    The line of a stretch takes some of a jitter that lasts for seconds away with it, by as much as the stretch is
    short: the size is what stretches of 60 and 120 s lead to in the limit of long ones.
    """
    errors = position_errors(table, fit)
    if not _makes_way(errors, fit.motion.position.interval_s):
        return Jitter()
    short, half, long = (_position_sums(errors, seconds) for seconds in (_SHORT_S, 0.5 * _LONG_S, _LONG_S))
    usable, short = _usable(long), short[_usable(short)]
    if min(usable.sum(), len(short)) < _FEWEST_STRETCHES or not long[usable, 1].sum() > 0.0:
        return Jitter()
    size, surest = _excess_over_speed(_extrapolated(long, half, 2)[usable]), _excess_over_speed(short)
    ratio = short[:, 2].sum() / max(float(short[:, 3].sum()), 1e-12)
    return Jitter(*size, surest.surplus, surest.effective_stretches, float(ratio))


def _makes_way(errors: PositionErrors, interval_s: float) -> bool:
    """Whether the ship goes somewhere: where waves toss her to and fro, an antenna high up errs along their way."""
    from scipy.ndimage import uniform_filter1d

    slow = uniform_filter1d(errors.velocity, max(1, round(1.0 / (SLOW_HZ * interval_s))), axis=0)
    return bool((slow**2).sum() > _LEAST_WAY * (errors.velocity**2).sum())


def _position_sums(errors: PositionErrors, seconds: float) -> Floats:
    """By stretch [k, 4]: samples, and sums of squares of speed, of errors along and of errors across the way."""
    stretch = (errors.time_s // seconds).astype(np.int64)
    residual = np.column_stack([_detrended(column, stretch) for column in errors.error.T])
    body = rotate(-np.arctan2(errors.velocity[:, 1], errors.velocity[:, 0]), residual)
    speed2 = (errors.velocity**2).sum(axis=1)
    return _sums_by_stretch(stretch, np.ones(stretch.size), speed2, *(body**2).T)


def _sums_by_stretch(stretch: Ints, *columns: Floats) -> Floats:
    """The sum of each column [n] over each stretch: [k, columns]."""
    return np.column_stack([np.bincount(stretch, column) for column in columns]).astype(float)


def _extrapolated(long: Floats, half: Floats, first: int) -> Floats:
    """Sums over long stretches, those of squared errors (from column ``first`` on) extrapolated by those over half
    as long to infinitely long ones, for errors that last longer than a stretch."""
    paired = np.pad(half, ((0, 2 * len(long) - len(half)), (0, 0))).reshape(len(long), 2, -1).sum(axis=1)
    return np.hstack([long[:, :first], 2.0 * long[:, first:] - paired[:, first:]])


def _usable(sums: Floats) -> Bools:
    """Stretches with samples enough and without breaks."""
    count, _, along, across = sums.T
    usable = count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0])))
    size = (along + across) / np.maximum(count, 1)
    return np.asarray(usable & (size <= _BROKEN * np.median(size[usable])) if usable.any() else usable)


class _Variance(NamedTuple):
    """The variance of the stamps [s2], its standard error, and the effective number of stretches."""

    variance_s2: float
    standard_error_s2: float
    effective_stretches: float

    @property
    def surplus(self) -> float:
        return self.variance_s2 / max(self.standard_error_s2, 1e-12)


def _excess_over_speed(sums: Floats) -> _Variance:
    """The variance along less that across over the square of the speed, its standard error by a jackknife."""
    _, moved_m2, along_m2, across_m2 = sums.T
    excess_m2 = along_m2 - across_m2
    total, base = excess_m2.sum(), moved_m2.sum()
    error = jackknife_error(ratios_without_each(excess_m2, moved_m2))
    return _Variance(float(total / base), float(error), float(base**2 / (moved_m2**2).sum()))


def _detrended(values: Floats, stretch: Ints) -> Floats:
    """Residuals about the straight line of each stretch, scaled for the two degrees of freedom that it takes."""
    place = np.arange(values.size, dtype=float)
    count = np.bincount(stretch)
    divisor = np.maximum(count, 1)
    place -= (np.bincount(stretch, place) / divisor)[stretch]
    values = values - (np.bincount(stretch, values) / divisor)[stretch]
    slope = np.bincount(stretch, place * values) / np.maximum(np.bincount(stretch, place**2), 1e-12)
    return np.asarray((values - slope[stretch] * place) * np.sqrt(divisor / np.maximum(count - 2, 1))[stretch])


def position_jitter_finding(jitter: Jitter, span: Span) -> Finding | None:
    """The finding of positions whose stamps jitter, None where they do not by enough to matter."""
    if not jitter.beyond(SMALLEST_POSITION_JITTER_S):
        return None
    how = (
        f"The positions' errors along the track have {jitter.ratio:.0f} times the variance of those across it:"
        " their stamps"
    )
    remedy = "Take the receiver's own times; the path integrated from the speeds is the better truth meanwhile."
    return _finding("position_time_jitter", "north_m", jitter, how, remedy, span)


def _finding(code: str, channel: str, jitter: Jitter, how: str, remedy: str, span: Span) -> Finding:
    low, high = jitter.interval()
    text = f"{how} jitter by {jitter.seconds:.2f} s (95 % {low:.2f} to {high:.2f})"
    return Finding(code, channel, *span, text, remedy, {"seconds": jitter.seconds, "low": low, "high": high})


_SMALLEST_S = 0.1
"""Jitter below this is nothing to care about: a quarter of a degree in a hard turn."""
_CHANCE = 1e-3
"""Probability that chance exceeds its own spread so far in a sound trial; it must be as large as jitter besides."""
_PRIOR = np.array([np.inf, np.inf, 0.05, 0.3])
"""How far the line, the scale and the delay [s] of one stretch may be from those of the whole recording."""
_FINEST_RAD = np.deg2rad(0.01)
_LARGEST_STAMP_ERROR_S = 3.0
_LEAP_IN_NOISE = 10.0
_STILL = 0.1
_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class HeadingErrors:
    """Of each heading: when [s], by how much it differs from the integrated yaw rate [rad], how far the ship has
    turned by then [rad] and how fast she turns [rad/s], all of shape [n]; the step of the values [rad]."""

    time_s: Floats
    error: Floats
    turned: Floats
    rate: Floats
    step: float


def heading_jitter(table: pd.DataFrame, fit: Kinematics) -> Jitter:
    """The jitter of the headings in a table about the turns that were fitted to it."""
    raw = group_samples(table, GROUPS["heading_deg"])
    turned, rate = integrated_yaw_rate_at(fit, raw.time_s)
    error = np.deg2rad(unwrap(np.rad2deg(raw.levels[:, 0] - turned)))
    steps = np.abs(np.diff(raw.levels[:, 0]))
    moved = steps[steps > 1e-7]
    return jitter_of(HeadingErrors(raw.time_s, error, turned, rate, float(moved.min()) if moved.size else 0.0))


def jitter_of(errors: HeadingErrors) -> Jitter:
    """The jitter of stamps from the part of heading errors that grows with the yaw rate.

    Short stretches tell best of errors that change from sample to sample, the limit of long ones, from stretches of
    60 and 120 s, of errors that last, and how large they are: either may say that there is jitter. Its size is
    worked out once more from how far the ship turns in that time, which in waves is less than in proportion.
    """
    lines = tuple(_fit_lines(errors, seconds) for seconds in (_SHORT_S, 0.5 * _LONG_S, _LONG_S))
    if min(lines[0].usable.sum(), lines[2].usable.sum()) < _FEWEST_STRETCHES:
        return Jitter()
    jitter = _jitter(lines, errors.rate**2, errors.step)
    for _ in range(_ROUNDS):
        if jitter.seconds >= _SMALLEST_S:
            jitter = _jitter(lines, _stamp_error_gain2(errors, jitter.seconds), errors.step)
    return jitter


def is_certain(jitter: Jitter) -> bool:
    """Whether a jitter of headings is significant, above 0.1 s, and at most the 3 s that stamps can be wrong by."""
    return jitter.beyond(_SMALLEST_S, _CHANCE) and jitter.seconds <= _LARGEST_STAMP_ERROR_S


def integrated_yaw_rate_at(fit: Kinematics, heading_time_s: Floats) -> tuple[Floats, Floats]:
    """What a heading with these stamps should read but for a constant [rad], and the yaw rate then [rad/s].

    From the recorded yaw rate with the factor, the bias and the delay between the two that were fitted.
    """
    from scipy.interpolate import CubicSpline

    rate, parameters = fit.motion.yaw_rate, fit.turn_parameters
    grid_s = np.arange(rate.time_s[0], rate.time_s[-1], fit.motion.step_s)
    turned, slopes = turn_model(fit.motion, grid_s)(parameters)
    times = np.clip(heading_time_s - parameters[2], grid_s[0], grid_s[-1])
    both = CubicSpline(grid_s, np.column_stack([turned[:, 0], -slopes[:, 2, 0]]))(times)
    return both[:, 0], both[:, 1]


def discontinuities(error: Floats, rate: Floats) -> Bools:
    """Steps [n - 1] of the heading against the integrated yaw rate that neither a stamp error of 3 s nor noise
    explains, as at a splice."""
    steps = np.abs(np.diff(error))
    turning = np.maximum(np.abs(rate[1:]), np.abs(rate[:-1]))
    noise = 1.4826 * float(np.median(steps)) if steps.size else 0.0
    return np.asarray(steps > _LARGEST_STAMP_ERROR_S * turning + _LEAP_IN_NOISE * noise)


def _stamp_error_gain2(errors: HeadingErrors, seconds: float) -> Floats:
    """By how much stamps with this standard deviation spoil each heading: squared error over squared stamp error,
    by the three points of Gauss and Hermite."""
    aside_s = np.sqrt(3.0) * seconds
    moved = [np.interp(errors.time_s + shift_s, errors.time_s, errors.turned) - errors.turned
             for shift_s in (-aside_s, aside_s)]  # fmt: skip
    return np.asarray((moved[0] ** 2 + moved[1] ** 2) / (2.0 * aside_s**2))


@dataclass(frozen=True, slots=True)
class _Lines:
    """The ``stretch`` of each heading and its ``residual`` about the stretch's line: [n]; which stretches are
    ``usable``, with samples enough and no breaks: [k]."""

    stretch: Ints
    residual: Floats
    usable: Bools


def _fit_lines(errors: HeadingErrors, seconds: float) -> _Lines:
    stretch = (errors.time_s // seconds).astype(np.int64)
    count = np.bincount(stretch)
    broken = np.bincount(stretch[1:], discontinuities(errors.error, errors.rate), count.size) > 0
    usable = ~broken & (count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0]))))
    columns = np.column_stack([np.ones(stretch.size), errors.time_s, errors.turned, errors.rate])
    noise2, residual = _noise2(errors.error), np.zeros(stretch.size)
    for end, number in zip(np.cumsum(count)[usable], count[usable], strict=True):
        within = slice(end - number, end)
        residual[within] = _residual(columns[within], errors.error[within], noise2)
    return _Lines(stretch, residual, np.asarray(usable))


def _noise2(error: Floats) -> float:
    """The variance of one sample [rad2], by how it differs from its two neighbours."""
    bends = error[1:-1] - 0.5 * (error[2:] + error[:-2])
    return float(max((1.4826 * np.median(np.abs(bends))) ** 2 / 1.5, _FINEST_RAD**2))


def _residual(columns: Floats, error: Floats, noise2: float) -> Floats:
    """What is left about the line, scale and delay of a stretch, as large as if they were known."""
    columns = columns - np.concatenate([[0.0], columns[:, 1:].mean(axis=0)])
    solution = np.linalg.solve(columns.T @ columns + np.diag(noise2 / _PRIOR**2), columns.T)
    free = error.size - float(np.sum(columns * solution.T))
    return np.asarray((error - columns @ (solution @ error)) * np.sqrt(error.size / max(free, 1.0)))


def _jitter(lines: tuple[_Lines, ...], spoils2: Floats, step: float) -> Jitter:
    """The jitter from residuals in short, longer and long stretches, and squared error per squared second [n]."""
    short, half, long = (_heading_sums(line, spoils2) for line in lines)
    least = step**2 / 12.0
    size = _growth(_extrapolated(long, half, 3)[lines[2].usable], least)
    short_growth = _growth(short[lines[0].usable], least)
    surest = max(
        size, short_growth, key=lambda growth: growth.surplus / quantile(1.0 - _CHANCE, growth.effective_stretches)
    )
    judged = lines[2].usable[lines[2].stretch]
    ratio = _ratio(spoils2[judged], lines[2].residual[judged] ** 2)
    return Jitter(*size, surest.surplus, surest.effective_stretches, ratio)


def _heading_sums(lines: _Lines, spoils2: Floats) -> Floats:
    """By stretch [k, 5]: the number of headings, and the sums of what jitter would spoil, of its squares, of the
    squared errors and of their products with what it would spoil."""
    residual2 = lines.residual**2
    return _sums_by_stretch(
        lines.stretch, np.ones(residual2.size), spoils2, spoils2**2, residual2, spoils2 * residual2
    )


def _ratio(spoils2: Floats, residual2: Floats) -> float:
    """Variance in turns over that of the tenth of the samples in which the ship turns least."""
    if not spoils2.any():
        return 1.0
    still = float(residual2[spoils2 <= np.quantile(spoils2, _STILL)].mean())
    return float(spoils2 @ residual2 / spoils2.sum()) / max(still, 1e-12)


def _growth(sums: Floats, least: float) -> _Variance:
    """A straight line through squared errors against what jitter would spoil, by least squares."""
    total = sums.sum(axis=0)
    error = jackknife_error(_slopes(total - sums, least))
    usual = total[1] / total[0]
    lever = sums[:, 2] - 2.0 * usual * sums[:, 1] + usual**2 * sums[:, 0]
    effective_stretches = lever.sum() ** 2 / max(float((lever**2).sum()), 1e-300)
    return _Variance(float(_slopes(total[np.newaxis], least)[0]), float(error), float(effective_stretches))


def _slopes(sums: Floats, least: float) -> Floats:
    """The slope of each line [k]; none is less than ``least`` without turning, the variance of rounding: a steady
    heading that always reads the same seems to have none."""
    count, spoils2, spoils4, residual2, product = sums.T
    slope = (product - residual2 * spoils2 / count) / np.maximum(spoils4 - spoils2**2 / count, 1e-300)
    still = (residual2 - slope * spoils2) / count
    through = (product - least * spoils2) / np.maximum(spoils4, 1e-300)
    return np.asarray(np.where(still < least, through, slope))


def heading_jitter_finding(jitter: Jitter, span: Span) -> Finding | None:
    """The finding of headings whose stamps jitter, None where they do not by enough to matter."""
    if not is_certain(jitter):
        return None
    how = (
        f"The heading's errors against the integrated yaw rate have {jitter.ratio:.0f} times the variance in turns"
        " that they have on a straight course: its stamps"
    )
    remedy = (
        "Take the compass's own times; the integrated yaw rate is the better guide to the shape of a turn until"
        " then, and --rebuild-positions takes it."
    )
    return _finding("heading_time_jitter", "heading_deg", jitter, how, remedy, span)


POSITIONS = ("north_m", "east_m")
_NEEDED = (*POSITIONS, "heading_deg", "surge_mps", "sway_mps")
_POSITION_TIES_S = (60.0, 120.0, 300.0, 600.0)
_SLOW = 0.01
"""A tie may move the path by one per cent of the ship's speed, hardly more than speeds are uncertain by."""
_LEAP_IN_STEPS = 6.0


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """The columns that were rebuilt, [rows] each, and over how many seconds they are tied to the recorded ones;
    infinite for a median."""

    columns: dict[str, Floats]
    tie_s: float


def reconstruct_positions(table: pd.DataFrame) -> Reconstruction | None:
    """Positions from the integrated velocity, tied to the recorded ones; None where a channel is lacking.

    What lies between path and positions is passed through a running median over 60 s, which leaps do not move,
    and a running mean. Where the two part for good (a clock that was set, a hole that was interpolated) each
    side is tied by itself. Stamps whose errors add up make positions leave the path by leap after leap: such a
    tie would put that way into the ship's motion again. Where path and positions agree between the leaps, it is
    made longer until it moves the path by less than 1 % of the speed, at last a constant.
    """
    if any(samples_of(table, name).rows.size < 2 for name in _NEEDED):
        return None
    way_m = dead_reckoning(table)
    both = np.flatnonzero(table[list(POSITIONS)].notna().all(axis=1))
    times, way_m = utc_index(table)[both], way_m[both]
    recorded_m = table[list(POSITIONS)].to_numpy(dtype=float)[both]
    off_m = recorded_m - way_m
    side = _sides(off_m)
    tie_s = _POSITION_TIES_S[0]
    tied_m = slow_difference(off_m, side, times, tie_s)
    if _agrees_between_leaps(way_m, off_m):
        for tie_s in (*_POSITION_TIES_S, np.inf):
            tied_m = slow_difference(off_m, side, times, tie_s)
            if _path_correction(tied_m, way_m, side) < _SLOW:
                break
    columns = {}
    for number, name in enumerate(POSITIONS):
        columns[name] = table[name].to_numpy(dtype=float, copy=True)
        columns[name][both] = way_m[:, number] + tied_m[:, number]
    return Reconstruction(columns, tie_s)


def dead_reckoning(table: pd.DataFrame) -> Floats:
    """The path north and east since the start by dead reckoning, from speeds over ground and heading: [rows, 2]."""
    since_s = seconds_of(table)
    surge, sway, heading = (samples_of(table, name) for name in ("surge_mps", "sway_mps", "heading_deg"))
    ahead, aside = (np.interp(since_s, samples.time_s, samples.value) for samples in (surge, sway))
    psi = np.deg2rad(np.interp(since_s, heading.time_s, unwrap(heading.value)))
    return np.column_stack([integrate(speed, since_s) for speed in to_earth(ahead, aside, psi)])


def _sides(off_m: Floats) -> NDArray[np.intp]:
    """The number of the stretch each position belongs to, between steps far beyond what jitter makes here: [n]."""
    step_m = np.hypot(*np.diff(off_m, axis=0).T)
    leap = step_m > _LEAP_IN_STEPS * np.quantile(step_m, 0.995) if step_m.size else np.zeros(0, np.bool_)
    return np.concatenate([[0], np.cumsum(leap)])


def slow_difference(deviation: Floats, side: NDArray[np.intp], times: pd.DatetimeIndex, tie_s: float) -> Floats:
    """Running median and mean over ``tie_s`` of the difference of recorded and integrated [n, m], for each ``side``
    by itself; the median of a side where ``tie_s`` is infinite."""
    parts = []
    for part in np.split(np.arange(side.size), np.flatnonzero(np.diff(side)) + 1):
        piece = pd.DataFrame(deviation[part], index=times[part])
        if np.isfinite(tie_s):
            typical = piece.rolling(pd.Timedelta(seconds=tie_s), center=True).median()
            parts.append(typical.rolling(pd.Timedelta(seconds=tie_s), center=True).mean().to_numpy())
        else:
            parts.append(np.broadcast_to(np.median(deviation[part], axis=0), (part.size, deviation.shape[1])))
    return np.concatenate(parts)


def _agrees_between_leaps(way_m: Floats, off_m: Floats) -> bool:
    """Whether the usual step of the positions is that of the path, along and across it.

    It is not where the heading has an offset or the speeds a scale; then the positions are the better guide.
    """
    way, deviation = (np.diff(path_m[:, 0] + 1j * path_m[:, 1]) for path_m in (way_m, off_m))
    moving = np.abs(way) > 0.2 * np.median(np.abs(way))
    if not moving.any():
        return False
    share = deviation[moving] / way[moving]
    return bool(np.hypot(np.median(share.real), np.median(share.imag)) < _SLOW)


def _path_correction(tied_m: Floats, way_m: Floats, side: NDArray[np.intp]) -> float:
    """How far the tie moves the path, as a share of the way: root mean square of steps within the sides."""
    within = np.diff(side) == 0
    moved, way = (np.sum(np.diff(path_m, axis=0)[within] ** 2) for path_m in (tied_m, way_m))
    return float(np.sqrt(moved / max(way, 1e-12)))


_HEADING_TIES_S = (15.0, 30.0, 60.0)
"""Short against what the yaw rate needs to part from the heading by its bias and a scale that changes, long against
most errors of stamps; how long these last the recording tells."""
_WORTH = 2.0


def reconstruct_heading(table: pd.DataFrame) -> Reconstruction | None:
    """Headings with the shape of the integrated yaw rate, taken with factor, bias and delay as they fit the table.

    What lies between the two is passed through a running median, which short errors of stamps do not move, and a
    running mean; where they part for good (a splice, a hole in the yaw rate) each side is tied by itself. The tie
    is made longer until what it lets through no longer scatters with the yaw rate. None where channels are lacking
    or the yaw rate would bring more noise than it mends: headings leave it in turns hardly more than without.
    """
    try:
        fit = fit_kinematics(table)
    except (DataShortageError, InputError):
        return None
    heading = samples_of(table, "heading_deg")
    turned, rate = integrated_yaw_rate_at(fit, heading.time_s)
    deviation = np.deg2rad(unwrap(heading.value - np.rad2deg(turned)))
    side = np.concatenate([[0], np.cumsum(discontinuities(deviation, rate) | _unknown(fit, heading.time_s))])
    times = utc_index(table)[heading.rows]
    for tie_s in _HEADING_TIES_S:
        slow = slow_difference(deviation[:, np.newaxis], side, times, tie_s)[:, 0]
        slow_errors = HeadingErrors(heading.time_s, slow, turned, rate, 0.0)
        if not is_certain(jitter_of(slow_errors)):
            break
    if not _exceeds_scatter(deviation - slow, rate):
        return None
    column = table["heading_deg"].to_numpy(dtype=float, copy=True)
    column[heading.rows] = wrap_360(np.rad2deg(turned + slow))
    return Reconstruction({"heading_deg": column}, tie_s)


def _unknown(fit: Kinematics, heading_time_s: Floats) -> Bools:
    """Between which headings nothing was recorded of the yaw rate for too long: [n - 1]."""
    unknown = np.zeros(max(heading_time_s.size - 1, 0), np.bool_)
    for begin, end in fit.motion.yaw_rate.gaps():
        unknown |= (heading_time_s[1:] > begin) & (heading_time_s[:-1] < end)
    return unknown


def _exceeds_scatter(mended: Floats, rate: Floats) -> bool:
    """Whether the change in turns exceeds the scatter of compass and yaw rate without turning."""
    turning, mended2 = rate**2, mended**2
    still = mended2[turning <= np.median(turning)].mean()
    return bool((turning * mended2).sum() > _WORTH * still * turning.sum())
