"""Stamps that jitter: those of positions and of headings, and positions and headings rebuilt without them.

With wrong stamps a position errs along the track, in proportion to the ship's speed; noise of the positions errs
across as much as along. So the variance along less that across, over the square of the speed, is the variance of
the stamps. A heading scatters about the integrated yaw rate: a ship's inertia keeps its yaw rate smooth, and noise
of compass and gyro is the same whether it turns or not, so that the variance that grows with the square of the
yaw rate is that of the stamps. Each stretch of time counts for itself, about its own straight line and, of headings
within what is known of such sensors, its own scale and delay; the interval comes from a jackknife over stretches.

They are rebuilt by a complementary filter each: fast motion from the integrated velocity or yaw rate, slow motion
from the recorded positions or headings.
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
from seatrial.analysis.quality.motion import fit as fits
from seatrial.analysis.quality.motion import model
from seatrial.analysis.series import finite_samples, jackknife_error, leave_one_out_ratios, robust_spread
from seatrial.analysis.tables.table import Span, seconds_of, utc_index

SMALLEST_POSITION_JITTER_S = 0.15
_SHORT_S = 30.0
_LONG_S = 120.0
_FEWEST_SAMPLES = 8
_FEWEST_STRETCHES = 5
_BROKEN = 30.0
_LEAST_RATIO = 2.0
_LEAST_WAY = 0.25  # of the squared speed that motion slower than waves makes; a turn within their period leaves 0.4
_BEYOND_LIMIT = 0.06  # of the variance: what is beyond the limit taken
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
POSITIONS = ("north_m", "east_m")
_NEEDED = (*POSITIONS, "heading_deg", "surge_mps", "sway_mps")
_POSITION_TIES_S = (60.0, 120.0, 300.0, 600.0)
_SLOW = 0.01
"""A tie may move the path by one per cent of the ship's speed, hardly more than speeds are uncertain by."""
_LEAP_IN_STEPS = 6.0
_HEADING_TIES_S = (15.0, 30.0, 60.0)
"""Short against what the yaw rate needs to part from the heading by its bias and a scale that changes, long against
most errors of stamps; how long these last the recording shows."""
_WORTH = 2.0


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

    def exceeds(self, smallest_s: float, chance: float = fits.CHANCE) -> bool:
        """Whether it is at least ``smallest_s`` and significant at ``chance``."""
        is_significant = self.surplus > fits.student_t_quantile(1.0 - chance, self.surplus_stretches)
        return is_significant and self.seconds >= smallest_s and self.ratio >= _LEAST_RATIO

    def finding(self, code: str, channel: str, evidence: str, remedy: str, span: Span) -> Finding:
        """The finding of this jitter, with the 95 % interval of the standard deviation [s]."""
        error = np.hypot(self.standard_error_s2, _BEYOND_LIMIT * self.variance_s2)
        half = fits.student_t_quantile(0.975, self.stretches) * error
        low, high = np.sqrt(np.maximum([self.variance_s2 - half, self.variance_s2 + half], 0.0)).tolist()
        text = f"{evidence} jitter by {self.seconds:.2f} s (95 % {low:.2f} to {high:.2f})"
        estimate = {"seconds": self.seconds, "low": low, "high": high}
        return Finding(code, channel, *span, text, remedy, estimate)


def position_stamp_jitter(table: pd.DataFrame, fit: fits.Kinematics) -> Jitter:
    """The jitter of the positions in a table about the motion that was fitted to it.

    By stretch are summed: samples, and squares of the speed, of errors along and of errors across the track.

    The line of a stretch takes some of a jitter that lasts for seconds away with it, by as much as the stretch is
    short: the size is what stretches of 60 and 120 s lead to in the limit of long ones.
    """
    from scipy.ndimage import uniform_filter1d

    errors = fits.position_errors(table, fit)
    width = max(1, round(1.0 / (fits.SLOW_HZ * fit.motion.position.interval_s)))
    slow = uniform_filter1d(errors.velocity, width, axis=0)
    if not (slow**2).sum() > _LEAST_WAY * (errors.velocity**2).sum():
        return Jitter()  # where waves toss the ship to and fro, an antenna high up errs along its way
    sums, speed2 = [], (errors.velocity**2).sum(axis=1)
    for seconds in (_SHORT_S, 0.5 * _LONG_S, _LONG_S):
        stretch = (errors.time_s // seconds).astype(np.int64)
        residual = np.column_stack([_detrend_by_stretch(column, stretch) for column in errors.error.T])
        along_across = model.rotate_to_earth(-np.arctan2(errors.velocity[:, 1], errors.velocity[:, 0]), residual)
        sums.append(_sums_by_stretch(stretch, np.ones(stretch.size), speed2, *(along_across**2).T))
    short, half, long = sums
    usable, short = _usable_stretch_mask(long), short[_usable_stretch_mask(short)]
    if min(usable.sum(), len(short)) < _FEWEST_STRETCHES or not long[usable, 1].sum() > 0.0:
        return Jitter()
    size, most_significant = (
        _variance_along_track(_extrapolate_squared_errors(long, half, 2)[usable]),
        _variance_along_track(short),
    )
    ratio = short[:, 2].sum() / max(float(short[:, 3].sum()), 1e-12)
    return Jitter(*size, most_significant.surplus, most_significant.effective_stretches, float(ratio))


def _sums_by_stretch(stretch: Ints, *columns: Floats) -> Floats:
    """The sum of each column [n] over each stretch: [k, columns]."""
    return np.column_stack([np.bincount(stretch, column) for column in columns]).astype(float)


def _extrapolate_squared_errors(long: Floats, half: Floats, first: int) -> Floats:
    """Sums over long stretches, those of squared errors (from column ``first`` on) extrapolated by those over half
    as long to infinitely long ones, for errors that last longer than a stretch."""
    paired = np.pad(half, ((0, 2 * len(long) - len(half)), (0, 0))).reshape(len(long), 2, -1).sum(axis=1)
    return np.hstack([long[:, :first], 2.0 * long[:, first:] - paired[:, first:]])


def _usable_stretch_mask(sums: Floats) -> Bools:
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


def _variance_along_track(sums: Floats) -> _Variance:
    """The variance along less that across over the square of the speed, its standard error by a jackknife."""
    _, moved_m2, along_m2, across_m2 = sums.T
    excess_m2 = along_m2 - across_m2
    total, base = excess_m2.sum(), moved_m2.sum()
    error = jackknife_error(leave_one_out_ratios(excess_m2, moved_m2))
    return _Variance(float(total / base), float(error), float(base**2 / (moved_m2**2).sum()))


def _detrend_by_stretch(values: Floats, stretch: Ints) -> Floats:
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
    if not jitter.exceeds(SMALLEST_POSITION_JITTER_S):
        return None
    evidence = (
        f"The positions' errors along the track have {jitter.ratio:.0f} times the variance of those across it:"
        " their stamps"
    )
    remedy = "Take the receiver's own times; the path integrated from the speeds is the better truth meanwhile."
    return jitter.finding("position_time_jitter", "north_m", evidence, remedy, span)


class HeadingErrors(NamedTuple):
    """Of each heading: when [s], by how much it differs from the integrated yaw rate [rad], how far the ship has
    turned by then [rad] and how fast it turns [rad/s], all of shape [n]; the step of the values [rad]."""

    time_s: Floats
    error: Floats
    turned: Floats
    rate: Floats
    step: float


def jitter_from_heading_errors(errors: HeadingErrors) -> Jitter:
    """The jitter of stamps from the part of heading errors that grows with the yaw rate.

    Short stretches show best the errors that change from sample to sample, the limit of long ones, from stretches
    of 60 and 120 s, of errors that last, and how large they are: either may say that there is jitter. Its size is
    worked out once more from how far the ship turns in that time, which in waves is less than in proportion.

    The residuals of each stretch are those about its line, scale and delay, scaled for the degrees of freedom that
    these take.
    """
    columns = np.column_stack([np.ones(errors.time_s.size), errors.time_s, errors.turned, errors.rate])
    leaps = discontinuity_mask(errors.error, errors.rate)
    # The variance of one sample [rad2], by how it differs from its two neighbours.
    bends = errors.error[1:-1] - 0.5 * (errors.error[2:] + errors.error[:-2])
    noise2 = float(max(robust_spread(bends) ** 2 / 1.5, _FINEST_RAD**2))
    stretch_fits = []
    for seconds in (_SHORT_S, 0.5 * _LONG_S, _LONG_S):
        stretch = (errors.time_s // seconds).astype(np.int64)
        count, residual = np.bincount(stretch), np.zeros(stretch.size)
        broken = np.bincount(stretch[1:], leaps, count.size) > 0
        usable = ~broken & (count >= max(_FEWEST_SAMPLES, 0.5 * float(np.median(count[count > 0]))))
        for end, number in zip(np.cumsum(count)[usable], count[usable], strict=True):
            within = slice(end - number, end)
            centred, error = columns[within], errors.error[within]
            centred = centred - np.concatenate([[0.0], centred[:, 1:].mean(axis=0)])
            solution = np.linalg.solve(centred.T @ centred + np.diag(noise2 / _PRIOR**2), centred.T)
            free = number - float(np.sum(centred * solution.T))
            residual[within] = (error - centred @ (solution @ error)) * np.sqrt(number / max(free, 1.0))
        stretch_fits.append(_StretchFits(stretch, residual, np.asarray(usable)))
    if min(stretch_fits[0].usable.sum(), stretch_fits[2].usable.sum()) < _FEWEST_STRETCHES:
        return Jitter()
    jitter = _jitter_from_stretch_fits(stretch_fits, errors.rate**2, errors.step)
    for _ in range(_ROUNDS):
        if jitter.seconds >= _SMALLEST_S:
            # Squared heading error over squared stamp error, by the three points of Gauss and Hermite.
            shift_s = np.sqrt(3.0) * jitter.seconds
            moved = [np.interp(errors.time_s + shift, errors.time_s, errors.turned) - errors.turned
                     for shift in (-shift_s, shift_s)]  # fmt: skip
            gain2 = (moved[0] ** 2 + moved[1] ** 2) / (2.0 * shift_s**2)
            jitter = _jitter_from_stretch_fits(stretch_fits, gain2, errors.step)
    return jitter


def is_jitter_certain(jitter: Jitter) -> bool:
    """Whether a jitter of headings is significant, above 0.1 s, and at most the 3 s that stamps can be wrong by."""
    return jitter.exceeds(_SMALLEST_S, _CHANCE) and jitter.seconds <= _LARGEST_STAMP_ERROR_S


def integrated_yaw_rate_at(fit: fits.Kinematics, heading_time_s: Floats) -> tuple[Floats, Floats]:
    """What a heading with these stamps should read but for a constant [rad], and the yaw rate then [rad/s].

    From the recorded yaw rate with the factor, the bias and the delay between the two that were fitted.
    """
    from scipy.interpolate import CubicSpline

    rate, parameters = fit.motion.yaw_rate, fit.selected.parameters[fits.OF_TURN]
    grid_s = np.arange(rate.time_s[0], rate.time_s[-1], fit.motion.step_s)
    turned, slopes = model.turn_model(fit.motion, grid_s)(parameters)
    times = np.clip(heading_time_s - parameters[2], grid_s[0], grid_s[-1])
    both = CubicSpline(grid_s, np.column_stack([turned[:, 0], -slopes[:, 2, 0]]))(times)
    return both[:, 0], both[:, 1]


def discontinuity_mask(error: Floats, rate: Floats) -> Bools:
    """Steps [n - 1] of the heading against the integrated yaw rate that neither a stamp error of 3 s nor noise
    explains, as at a splice."""
    steps = np.abs(np.diff(error))
    turning = np.maximum(np.abs(rate[1:]), np.abs(rate[:-1]))
    return np.asarray(steps > _LARGEST_STAMP_ERROR_S * turning + _LEAP_IN_NOISE * robust_spread(steps))


class _StretchFits(NamedTuple):
    """The ``stretch`` of each heading and its ``residual`` about the stretch's line: [n]; which stretches are
    ``usable``, with samples enough and no breaks: [k]."""

    stretch: Ints
    residual: Floats
    usable: Bools


def _jitter_from_stretch_fits(stretch_fits: list[_StretchFits], gain2: Floats, step: float) -> Jitter:
    """The jitter from residuals in short, longer and long stretches, and squared error per squared second [n].

    By stretch are summed: the number of headings, and the gain of jitter, its squares, the squared errors and their
    products with the gain.
    """
    residuals2 = [stretch_fit.residual**2 for stretch_fit in stretch_fits]
    short, half, long = (
        _sums_by_stretch(stretch_fit.stretch, np.ones(gain2.size), gain2, gain2**2, residual2, gain2 * residual2)
        for stretch_fit, residual2 in zip(stretch_fits, residuals2, strict=True)
    )
    least = step**2 / 12.0
    size = _variance_growth(_extrapolate_squared_errors(long, half, 3)[stretch_fits[2].usable], least)
    short_growth = _variance_growth(short[stretch_fits[0].usable], least)
    most_significant = max(
        size,
        short_growth,
        key=lambda growth: growth.surplus / fits.student_t_quantile(1.0 - _CHANCE, growth.effective_stretches),
    )
    usable = stretch_fits[2].usable[stretch_fits[2].stretch]
    ratio, gain2, residual2 = 1.0, gain2[usable], residuals2[2][usable]
    if gain2.any():  # variance in turns over that of the tenth of the samples in which the ship turns least
        still = float(residual2[gain2 <= np.quantile(gain2, _STILL)].mean())
        ratio = float(gain2 @ residual2 / gain2.sum()) / max(still, 1e-12)
    return Jitter(*size, most_significant.surplus, most_significant.effective_stretches, ratio)


def _variance_growth(sums: Floats, least: float) -> _Variance:
    """A straight line through squared errors against the gain of jitter, by least squares."""
    total = sums.sum(axis=0)
    error = jackknife_error(_slopes_by_stretch(total - sums, least))
    usual = total[1] / total[0]
    lever = sums[:, 2] - 2.0 * usual * sums[:, 1] + usual**2 * sums[:, 0]
    effective_stretches = lever.sum() ** 2 / max(float((lever**2).sum()), 1e-300)
    return _Variance(
        float(_slopes_by_stretch(total[np.newaxis], least)[0]), float(error), float(effective_stretches)
    )


def _slopes_by_stretch(sums: Floats, smallest_slope: float) -> Floats:
    """The slope of each line [k]; none is less than ``smallest_slope`` without turning, the variance of rounding: a
    steady heading that always reads the same seems to have none."""
    count, gain2, gain4, residual2, product = sums.T
    # what a rate that stays the same spreads is rounding
    spread = np.maximum(gain4 - gain2**2 / count, 1e-9 * gain4 + 1e-300)
    slope = (product - residual2 * gain2 / count) / spread
    still = (residual2 - slope * gain2) / count
    through = (product - smallest_slope * gain2) / np.maximum(gain4, 1e-300)
    return np.asarray(np.where(still < smallest_slope, through, slope))


def heading_jitter_finding(table: pd.DataFrame, fit: fits.Kinematics, span: Span) -> Finding | None:
    """The finding of headings whose stamps jitter about the turns that were fitted to a table, None where they do
    not by enough to matter."""
    raw = model.group_samples(table, model.GROUPS["heading_deg"])
    turned, rate = integrated_yaw_rate_at(fit, raw.time_s)
    error = np.deg2rad(unwrap(np.rad2deg(raw.levels[:, 0] - turned)))
    steps = np.abs(np.diff(raw.levels[:, 0]))
    moved = steps[steps > 1e-7]
    step = float(moved.min()) if moved.size else 0.0
    jitter = jitter_from_heading_errors(HeadingErrors(raw.time_s, error, turned, rate, step))
    if not is_jitter_certain(jitter):
        return None
    evidence = (
        f"The heading's errors against the integrated yaw rate have {jitter.ratio:.0f} times the variance in turns"
        " that they have on a straight course: its stamps"
    )
    remedy = (
        "Take the compass's own times; the integrated yaw rate is the better guide to the shape of a turn until"
        " then, and --rebuild-positions takes it."
    )
    return jitter.finding("heading_time_jitter", "heading_deg", evidence, remedy, span)


class Reconstruction(NamedTuple):
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
    if any(finite_samples(table, name).rows.size < 2 for name in _NEEDED):
        return None
    since_s = seconds_of(table)
    surge, sway, heading = (finite_samples(table, name) for name in ("surge_mps", "sway_mps", "heading_deg"))
    surge_mps, sway_mps = (np.interp(since_s, samples.time_s, samples.value) for samples in (surge, sway))
    psi = np.deg2rad(np.interp(since_s, heading.time_s, unwrap(heading.value)))
    way_m = np.column_stack([integrate(speed, since_s) for speed in to_earth(surge_mps, sway_mps, psi)])
    both = np.flatnonzero(table[list(POSITIONS)].notna().all(axis=1))
    times, way_m = utc_index(table)[both], way_m[both]
    recorded_m = table[list(POSITIONS)].to_numpy(dtype=float)[both]
    deviation_m = recorded_m - way_m
    step_m = np.hypot(*np.diff(deviation_m, axis=0).T)  # between sides are steps far beyond what jitter makes here
    leap = step_m > _LEAP_IN_STEPS * np.quantile(step_m, 0.995) if step_m.size else np.zeros(0, np.bool_)
    side = np.concatenate([[0], np.cumsum(leap)])
    tie_s = _POSITION_TIES_S[0]
    tied_m = slow_difference(deviation_m, side, times, tie_s)
    # They do not where the heading has an offset or the speeds a scale; then the positions are the better guide.
    moves, drifts = (np.diff(path_m[:, 0] + 1j * path_m[:, 1]) for path_m in (way_m, deviation_m))
    moving = np.abs(moves) > 0.2 * np.median(np.abs(moves))
    ratio = drifts[moving] / moves[moving]
    if moving.any() and np.hypot(np.median(ratio.real), np.median(ratio.imag)) < _SLOW:
        for tie_s in (*_POSITION_TIES_S, np.inf):
            tied_m = slow_difference(deviation_m, side, times, tie_s)
            within = np.diff(side) == 0
            moved, way = (np.sum(np.diff(path_m, axis=0)[within] ** 2) for path_m in (tied_m, way_m))
            if np.sqrt(moved / max(way, 1e-12)) < _SLOW:
                break
    columns = {}
    for number, name in enumerate(POSITIONS):
        columns[name] = table[name].to_numpy(dtype=float, copy=True)
        columns[name][both] = way_m[:, number] + tied_m[:, number]
    return Reconstruction(columns, tie_s)


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


def reconstruct_heading(table: pd.DataFrame) -> Reconstruction | None:
    """Headings with the shape of the integrated yaw rate, taken with factor, bias and delay as they fit the table.

    What lies between the two is passed through a running median, which short errors of stamps do not move, and a
    running mean; where they part for good (a splice, a hole in the yaw rate) each side is tied by itself. The tie
    is made longer until what it lets through no longer scatters with the yaw rate. None where channels are lacking
    or the yaw rate would add more noise than it removes: headings leave it in turns hardly more than without.
    """
    try:
        fit = fits.fit_kinematics(table)
    except (DataShortageError, InputError):
        return None
    heading = finite_samples(table, "heading_deg")
    turned, rate = integrated_yaw_rate_at(fit, heading.time_s)
    deviation = np.deg2rad(unwrap(heading.value - np.rad2deg(turned)))
    breaks = discontinuity_mask(deviation, rate)
    for begin, end in fit.motion.yaw_rate.gaps():
        breaks |= (heading.time_s[1:] > begin) & (heading.time_s[:-1] < end)
    side = np.concatenate([[0], np.cumsum(breaks)])
    times = utc_index(table)[heading.rows]
    for tie_s in _HEADING_TIES_S:
        slow = slow_difference(deviation[:, np.newaxis], side, times, tie_s)[:, 0]
        if not is_jitter_certain(
            jitter_from_heading_errors(HeadingErrors(heading.time_s, slow, turned, rate, 0.0))
        ):
            break
    # The change in turns must exceed the scatter of compass and yaw rate without turning.
    turning, change2 = rate**2, (deviation - slow) ** 2
    still = change2[turning <= np.median(turning)].mean()
    if not (turning * change2).sum() > _WORTH * still * turning.sum():
        return None
    column = table["heading_deg"].to_numpy(dtype=float, copy=True)
    column[heading.rows] = wrap_360(np.rad2deg(turned + slow))
    return Reconstruction({"heading_deg": column}, tie_s)
