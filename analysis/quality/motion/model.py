"""The motion channels of a table as smooth functions of time, and whether they agree with one motion at all.

Positions, heading, speeds and yaw rate are four groups, each with stamps of its own. Groups that are faster than
:data:`STEP_S` are averaged over that long, time and value alike, which shifts nothing. From them follow the path
that heading and speeds describe, and the turns that the yaw rate gives, as models of what may be wrong.

Before anything fine is fitted, positions and the path by heading and speeds are compared as complex moves (north +
i east) over windows of ten seconds: their ratio is a scale and an angle, free from minus to plus infinity, and so
is the ratio of turns. Signs and units that nothing fine could correct (a mirrored chart, sway to port, a heading in
radians) are tried in turn: the one that removes most of the residual is named. Lever arms, delays and heel in turns
are allowed for, so that they do not pass for one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core import conventions, errors, ship
from seatrial.acquisition.core.quantities import KNOT_MPS, Bools, Complexes, Floats, Ints, integrate, to_earth
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.series import edges_of_runs, robust_spread, runs_of_equal
from seatrial.analysis.tables.table import NANO, require, span_of, times_ns

GROUPS: dict[str, tuple[str, ...]] = {
    "north_m": ("north_m", "east_m"),
    "heading_deg": ("heading_deg",),
    "surge_mps": ("surge_mps", "sway_mps"),
    "yaw_rate_dps": ("yaw_rate_dps",),
}
"""Channels that are stamped together, by the channel that findings name them with."""

MOTION = tuple(name for names in GROUPS.values() for name in names)
STEP_S = 0.25
_SPIKE = 8.0
_LONGEST_GAP_S = 3.0
_WILD_RAD = np.deg2rad(2.0)
_NEIGHBOURHOOD_S = 20.0
_MOST_WILD = 0.2
_RATE_WIDTH_S = 1.0
_MEAN_WIDTH_S = 5.0
_WINDOW_S = 10.0
_LONG_S = 60.0
_FEWEST = 8  # samples of a channel
_FEWEST_WINDOWS = 12
_FEWEST_LONG = 6
_ROUNDS = 15
_NO_RESIDUAL = 1e-5
_KEPT = 0.8  # of the windows: the rest may hold jumps
_AGREES = 0.5  # of the moves may be unexplained where a ratio is used
_FAR = 0.25  # from which a ratio or an angle [rad] is beyond what the fine fit starts from
_REMOVED = 0.5  # of what is left that a sign or unit must take away to be named
_LIKELIER = 10.0  # logarithm of the ratio of likelihoods
_LEAST_LEFT = 0.01
_CONTRADICTED = 0.2
_LEAST_MOVE_M = 10.0  # in a minute: positions of a ship that lies still wander by less
_BEYOND_NOISE = 6.0
_NEAR_ONE = 0.05
_NEAR_DEG = 30.0  # between two conventions there are 90
_UNEXPLAINED = "no sign and no unit that was tried explains it"
_SPEED_UNITS = {"knots": KNOT_MPS, "km/h": 1.0 / 3.6}
_FULL_TURN_RAD_IN_DEG = np.deg2rad(2.0 * np.pi) * 1.001


@dataclass(frozen=True, slots=True)
class Group:
    """One group: ``time_s`` [n] increasing, ``levels`` [n, channels] in SI units, ``interval_s`` between them."""

    time_s: Floats
    levels: Floats
    interval_s: float

    def excluding(self, invalid: Bools) -> Group:
        return Group(self.time_s[~invalid], self.levels[~invalid], self.interval_s)

    def gaps(self) -> Floats:
        """Where too long nothing was recorded: [gaps, 2] beginning and end [s]."""
        long = np.diff(self.time_s) > max(_LONGEST_GAP_S, 2.5 * self.interval_s)
        return np.column_stack([self.time_s[:-1][long], self.time_s[1:][long]])


@dataclass(frozen=True, slots=True)
class CleanMotion:
    """Four groups cleaned of spikes; ``heading`` is unwrapped. ``step_s`` is the grid the fit works on,
    ``recorded_s`` [4] how far apart the samples were before they were averaged to it."""

    position: Group
    heading: Group
    speed: Group
    yaw_rate: Group
    step_s: float
    recorded_s: tuple[float, ...] = ()

    def every_other_sample(self, first: int) -> CleanMotion:
        """The motion by every other sample of heading, speeds and yaw rate, from the ``first`` on (0 or 1)."""
        heading, speed, yaw_rate = (
            Group(group.time_s[first::2], group.levels[first::2], 2.0 * group.interval_s)
            for group in self.groups[1:]
        )
        return CleanMotion(self.position, heading, speed, yaw_rate, self.step_s)

    @property
    def groups(self) -> tuple[Group, ...]:
        return self.position, self.heading, self.speed, self.yaw_rate


def motion_of(table: pd.DataFrame) -> CleanMotion:
    """The motion in a table of raw samples, time from its first row.

    Raises :class:`InputError` where a channel is missing and :class:`DataShortageError` for less than 8 samples.
    """
    require(table, MOTION)
    groups = [group_samples(table, channels) for channels in GROUPS.values()]
    recorded_s = tuple(group.interval_s for group in groups)
    step_s = max(STEP_S, min(recorded_s))
    position, heading, *rates = groups
    speed, yaw_rate = (_average_over_steps(group.excluding(outlier_mask(group.levels)), step_s) for group in rates)

    # Unwrap the heading along the integrated yaw rate, and replace it by that where it contradicts it wildly.
    turned_rad = integrate(yaw_rate.levels[:, 0], yaw_rate.time_s)
    turned = np.interp(heading.time_s, yaw_rate.time_s, turned_rad)
    slow, deviation = heading_deviation(heading.levels[:, 0], turned, heading.interval_s)
    wild = wild_heading_mask(deviation, turned)
    if wild.mean() < _MOST_WILD:
        deviation[wild] = np.interp(heading.time_s[wild], heading.time_s[~wild], deviation[~wild])
    heading = Group(heading.time_s, (turned + slow + deviation)[:, np.newaxis], heading.interval_s)
    heading = _average_over_steps(heading, step_s)

    # Spikes of the positions are those about the path that heading and speeds describe.
    grid = np.arange(position.time_s[0], position.time_s[-1] + 2.0 * step_s, step_s)
    angle = np.interp(grid, heading.time_s, heading.levels[:, 0])
    ahead, abeam = (np.interp(grid, speed.time_s, column) for column in speed.levels.T)
    travelled = (integrate(velocity, step_s) for velocity in to_earth(ahead, abeam, angle))
    path = np.column_stack([np.interp(position.time_s, grid, column) for column in travelled])
    position = _average_over_steps(position.excluding(outlier_mask(position.levels - path)), step_s)
    return CleanMotion(position, heading, speed, yaw_rate, step_s, recorded_s)


def group_samples(table: pd.DataFrame, channels: tuple[str, ...]) -> Group:
    """The samples of channels that are stamped together, without copies, in radians where they are angles."""
    times = (times_ns(table) - times_ns(table).min()) / NANO
    columns = [table[name].to_numpy(dtype=float) for name in channels]
    if len(columns) > 1 and not (np.isfinite(columns[0]) & np.isfinite(columns[1])).any():
        valid = np.isfinite(columns[1])
        columns[1] = np.interp(times, times[valid], columns[1][valid])
    values = np.column_stack(columns)
    valid = np.isfinite(values).all(axis=1)
    order = np.flatnonzero(valid)[np.argsort(times[valid], kind="stable")]
    if order.size < _FEWEST:
        raise errors.DataShortageError(f"holds only {order.size} samples of {channels[0]}", fix="record for longer")
    scale = np.pi / 180.0 if channels[0].endswith(("_deg", "_dps")) else 1.0
    steps = np.diff(times[order])
    interval_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    samples = Group(times[order], values[order] * scale, interval_s)
    # Copies of a slower source that was written again and again are repeats that come regularly. Rounded values
    # repeat too, but now and then; their copies are samples like all others.
    new, lengths = runs_of_equal((np.diff(samples.levels, axis=0) != 0.0).any(axis=1))
    usual = float(np.median(lengths))
    if usual < 2.0 or new.size < _FEWEST or np.mean(np.abs(lengths - usual) <= 0.1 * usual + 0.5) < 0.8:
        return samples
    return Group(samples.time_s[new], samples.levels[new], usual * interval_s)


def outlier_mask(values: Floats) -> Bools:
    """Rows of [n, channels] that lie outside their two neighbours on either side by far more than noise.

    What rises or falls steadily never sticks out, however steep.
    """
    padded, centre = np.pad(values, ((2, 2), (0, 0)), mode="reflect"), values
    sides = np.stack([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]])
    outside = np.maximum(np.maximum(sides.min(axis=0) - centre, centre - sides.max(axis=0)), 0.0)
    spread = np.abs(centre - np.median(sides, axis=0))
    usual = spread <= np.quantile(spread, 0.99, axis=0)
    scale = np.maximum(
        1.4826 * np.median(spread, axis=0), np.sqrt(np.mean(np.where(usual, spread, 0.0) ** 2, axis=0))
    )
    return np.asarray((outside > _SPIKE * scale + 1e-9).any(axis=1))


def interpolating_spline(samples: Group) -> Callable[..., Floats]:
    """A cubic spline through a group; across what is missing it is straight."""
    from scipy.interpolate import CubicSpline

    steps = np.diff(samples.time_s)
    extra = np.maximum(np.ceil(steps / (1.5 * samples.interval_s)).astype(int) - 1, 0)
    extra = np.where(steps > 1.5 * samples.interval_s, np.minimum(extra, 1000), 0)
    gap = np.repeat(np.arange(steps.size), extra)
    rank = np.arange(gap.size) - np.repeat(np.cumsum(extra) - extra, extra) + 1
    added = samples.time_s[gap] + steps[gap] * rank / (extra[gap] + 1)
    times = np.sort(np.concatenate([samples.time_s, added]))
    values = np.column_stack([np.interp(times, samples.time_s, column) for column in samples.levels.T])
    curve: Callable[..., Floats] = CubicSpline(times, values)
    return curve


def rotate_to_earth(angle_rad: Floats, body: Floats) -> Floats:
    """Vectors [n, 2] from forward and starboard to north and east."""
    return np.column_stack(to_earth(body[:, 0], body[:, 1], angle_rad))


def _average_over_steps(samples: Group, step_s: float) -> Group:
    """Means of time and value over each step; what is slower stays as it is, but for repeated times."""
    bins = np.floor(samples.time_s / step_s + 1e-6).astype(np.int64)
    _, place, count = np.unique(bins, return_inverse=True, return_counts=True)
    time_s = np.bincount(place, samples.time_s) / count
    values = np.column_stack([np.bincount(place, column) / count for column in samples.levels.T])
    return Group(time_s, values, max(samples.interval_s, step_s))


def heading_deviation(heading_rad: Floats, turned_rad: Floats, interval_s: float) -> tuple[Floats, Floats]:
    """The slow way between headings and the integrated yaw rate, and how far each heading is off both: [n] rad.

    The difference of heading and integrated yaw rate wanders slowly, by bias and scale of the gyro: the slow way is
    its running median on the circle, unwrapped. Long series are thinned before.
    """
    from scipy.ndimage import median_filter

    difference_rad = heading_rad - turned_rad
    thin = max(1, int(STEP_S / interval_s))
    size = 2 * int(np.clip(0.5 * _NEIGHBOURHOOD_S / (interval_s * thin), 4, 100)) + 1
    vector = np.exp(1j * difference_rad[::thin])
    middle = median_filter(vector.real, size) + 1j * median_filter(vector.imag, size)
    places = np.arange(0, difference_rad.size, thin)
    slow = np.interp(np.arange(difference_rad.size), places, np.unwrap(np.angle(middle)))
    return slow, np.angle(np.exp(1j * (difference_rad - slow)))


def wild_heading_mask(deviation_rad: Floats, turned_rad: Floats) -> Bools:
    """Which headings are far off all that the yaw rate gives for the time from the sample before to the one after,
    as those that were interpolated through north.

    A turn that begins between two samples is off the integrated yaw rate at its own time.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    above = deviation_rad + turned_rad - maximum_filter1d(turned_rad, 3)
    below = minimum_filter1d(turned_rad, 3) - turned_rad - deviation_rad
    return np.asarray(np.maximum(above, below) > max(_SPIKE * robust_spread(deviation_rad), _WILD_RAD))


def block_starts(motion: CleanMotion, grid_s: Floats, length: int) -> Ints:
    """First grid points of the blocks of ``length`` points over which every group was recorded."""
    covered = np.ones(grid_s.size, dtype=bool)
    for group in motion.groups:
        covered &= (grid_s >= group.time_s[0]) & (grid_s <= group.time_s[-1])
        for begin, end in group.gaps():
            covered[np.searchsorted(grid_s, begin, "right") : np.searchsorted(grid_s, end)] = False
    starts = [
        np.arange(first, stop - length + 1, length) for first, stop in zip(*edges_of_runs(covered), strict=True)
    ]
    return np.concatenate([np.empty(0, dtype=np.int64), *starts])


Model = Callable[[Floats], tuple[Floats, Floats]]
"""Levels [points, m] on the grid (2 of position or 1 of heading) for p parameters, and their slopes [points, p, m].

The third parameter, the delay of the measured level, moves no model: its slope is what reading it later costs.
"""


def path_model(motion: CleanMotion, grid_s: Floats) -> Model:
    """The path by heading and speeds as a model of the positions; the speeds' stamps are the time.

    The last two parameters are heel in turns, by which an antenna high up goes to the side: in m per m/s2 of
    centripetal acceleration, and in m per m/s3 of its rate, of the other sign where heel lags. The slopes by the
    delays leave heel out, which is a small part of the motion.
    """
    heading_at, body = interpolating_spline(motion.heading), interpolating_spline(motion.speed)(grid_s)
    first, last = motion.heading.time_s[[0, -1]]
    width = max(_RATE_WIDTH_S, motion.step_s)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, offset, _, heading_late_s, forward, starboard, heel, heel_lag = values
        times = np.clip(grid_s + heading_late_s, first + width, last - width)
        before, centre, after = (heading_at(times + shift) for shift in (-width, 0.0, width))
        true = centre[:, 0] - offset
        turning = (after - before) / (2.0 * width)
        yaw_acceleration = (after - 2.0 * centre + before) / width**2
        ahead = np.column_stack([np.cos(true), np.sin(true)])
        abeam = _rotate_by_quarter_turn(ahead)
        moving = body[:, :1] * ahead + body[:, 1:] * abeam
        heeled, heeling = (rate * body[:, :1] * abeam for rate in (turning, yaw_acceleration))
        arm = forward * ahead + starboard * abeam + heel * heeled + heel_lag * heeling
        swung = turning * _rotate_by_quarter_turn(arm)
        bending = turning * factor * _rotate_by_quarter_turn(moving)
        travelled, bent = np.hsplit(integrate_on_grid(grid_s, np.hstack([moving, bending])), 2)
        by_offset = -factor * _rotate_by_quarter_turn(travelled) - _rotate_by_quarter_turn(arm)
        slopes = (travelled, by_offset, -factor * moving - swung, bent + swung, ahead, abeam, heeled, heeling)
        return factor * travelled + arm, np.stack(slopes, axis=1)

    return model


def turn_model(motion: CleanMotion, grid_s: Floats) -> Model:
    """The heading by the integrated yaw rate, whose stamps are the time; factor, bias and delay of the heading.

    The slope by the factor is the smoothed heading: unlike the integrated yaw rate it shares no noise with what
    is left, which would make the factor too small (an instrumental variable).
    """
    from scipy.ndimage import uniform_filter1d

    rate = interpolating_spline(motion.yaw_rate)(grid_s)
    turned, elapsed = integrate_on_grid(grid_s, rate), (grid_s - grid_s[0])[:, np.newaxis]
    size = 2 * int(0.5 * _MEAN_WIDTH_S / motion.step_s) + 1
    smooth = uniform_filter1d(interpolating_spline(motion.heading)(grid_s), size, axis=0)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, bias, _ = values
        slopes = (smooth / factor, elapsed, -factor * rate - bias)
        return factor * turned + bias * elapsed, np.stack(slopes, axis=1)

    return model


def interpolate_from_grid(time_s: Floats, grid_s: Floats, columns: Floats) -> Floats:
    """Columns [points, m] on the even grid, linearly at other times."""
    place = np.clip((time_s - grid_s[0]) / (grid_s[1] - grid_s[0]), 0.0, grid_s.size - 1.000001)
    before = place.astype(np.int64)
    fraction = (place - before)[:, np.newaxis]
    return np.asarray(columns[before] * (1.0 - fraction) + columns[before + 1] * fraction)


def integrate_on_grid(grid_s: Floats, rates: Floats) -> Floats:
    """Rates [points, ...] integrated from the first point, by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(grid_s, rates).antiderivative()(grid_s))


def _rotate_by_quarter_turn(vectors: Floats) -> Floats:
    """Vectors [n, 2] north and east turned by +90 deg: the change by a turn of one radian."""
    return np.column_stack([-vectors[:, 1], vectors[:, 0]])


@dataclass(frozen=True, slots=True)
class Coarse:
    """Start of the fine fit: ``speed_factor`` and ``yaw_rate_factor`` to multiply by, ``heading_offset_rad``
    to subtract; the contradiction in words, its channel, and the share ``unexplained`` of the moves [-].

    ``is_explained`` says that a sign or a unit removes the contradiction.
    """

    speed_factor: float = 1.0
    heading_offset_rad: float = 0.0
    yaw_rate_factor: float = 1.0
    contradiction: str = ""
    channel: str = ""
    unexplained: float = 0.0
    is_explained: bool = False

    @property
    def is_neutral(self) -> bool:
        return (self.speed_factor, self.heading_offset_rad, self.yaw_rate_factor) == (1.0, 0.0, 1.0)


def fit_coarsely(table: pd.DataFrame) -> Coarse:
    """Compare the motion channels of a table of raw samples.

    Raises :class:`InputError` where a motion channel is missing and :class:`DataShortageError` for less than 8
    samples of one. Too few windows give a neutral answer.
    """
    require(table, MOTION)
    position, heading, *rates = (group_samples(table, channels) for channels in GROUPS.values())
    speed, yaw_rate = (group.excluding(outlier_mask(group.levels)) for group in rates)
    step_s = max(STEP_S, min(group.interval_s for group in (position, heading, speed, yaw_rate)))
    motion = CleanMotion(position, heading, speed, yaw_rate, step_s)
    moves = _Moves.of(motion, _WINDOW_S)
    if moves.starts.size < _FEWEST_WINDOWS:
        return Coarse()
    # The factor from yaw rate to rate of heading, where it is far from 1 and well determined.
    headed, turned = (
        _changes_over_windows(levels, moves.starts, moves.length)
        for levels in (moves.heading, integrate(moves.yaw_rate, moves.step_s))
    )
    values, residual_rad = _robust_complex_regression(headed, np.column_stack([turned, np.ones(turned.size)]))
    factor, deviation = float(values[0].real), np.abs(headed - np.median(headed))
    is_clear = _trimmed_rms(residual_rad) < _AGREES * _trimmed_rms(deviation) and factor != 0.0
    yaw_rate_factor = factor if is_clear and abs(factor - 1.0) > _FAR else 1.0
    error = _find_sign_or_unit_error(moves)
    if error is not None:
        return Coarse(1.0, 0.0, yaw_rate_factor, *error, is_explained=True)
    minutes = _Moves.of(motion, _LONG_S)
    if minutes.starts.size >= _FEWEST_LONG:
        path = _trimmed_rms(minutes.moved)
        residual = minutes.regress_on(minutes.moved, minutes.heading, minutes.body).residual_m
        rough = np.abs(np.diff(motion.position.levels, n=2, axis=0))
        noise = float(np.median(rough)) / (0.6745 * np.sqrt(6.0))
        is_moving = path > _LEAST_MOVE_M and residual > _BEYOND_NOISE * noise
        if is_moving and residual / path > _CONTRADICTED:
            return Coarse(1.0, 0.0, yaw_rate_factor, _UNEXPLAINED, "north_m", residual / path)

    # The ratio of the positions' moves to those by heading and speeds. Half a turn of it is the heading's, unless
    # the ship would go astern on the whole: then both speeds have the wrong sign.
    regression = moves.regress_on(moves.moved, moves.heading, moves.body)
    ratio, scale = regression.ratio, float(abs(regression.ratio))
    explains = regression.residual_m < _AGREES * _trimmed_rms(moves.moved) and scale > 0.0
    if not explains or (abs(np.log(scale)) < _FAR and abs(np.angle(ratio)) < _FAR):
        return Coarse(1.0, 0.0, yaw_rate_factor)
    if abs(np.angle(-ratio)) < _FAR and moves.body.real.mean() < 0.0:
        return Coarse(-scale, float(-np.angle(-ratio)), yaw_rate_factor)
    angle = float(-np.angle(ratio))
    return Coarse(scale, angle + 2.0 * np.pi if angle < _FAR - np.pi else angle, yaw_rate_factor)


def contradiction_finding(table: pd.DataFrame, coarse: Coarse) -> Finding:
    """The contradiction that a coarse fit found; ``estimate`` has the share of the moves left unexplained."""
    text = f"Positions, heading and speeds tell of no one motion: {coarse.unexplained:.0%} of the way is left over;"
    return Finding(
        "motion_contradiction", coarse.channel, *span_of(table), f"{text} {coarse.contradiction}",
        "Mend signs and units where the channels are recorded; nothing else can be told of them until then.",
        {"left": coarse.unexplained},
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Regression:
    """A regression of moves: their ratio to the model's, the residual [m], and that with arm, delay and heel."""

    ratio: complex
    plain_residual_m: float
    residual_m: float

    def removes_residual_of(self, rival: _Regression) -> bool:
        return self.residual_m < _REMOVED * rival.residual_m

    def is_clearer(self, rival: _Regression, windows: int) -> bool:
        """Whether it is far likelier than another by what is left."""
        return bool(_KEPT * windows * np.log(rival.residual_m / max(self.residual_m, 1e-9)) > _LIKELIER)


@dataclass(frozen=True, slots=True)
class _Moves:
    """Positions as complex moves over windows [n], and grid values of what should explain them."""

    step_s: float
    starts: Ints
    length: int
    moved: Complexes
    heading: Floats
    body: Complexes
    yaw_rate: Floats

    @classmethod
    def of(cls, motion: CleanMotion, window_s: float) -> _Moves:
        begin = max(group.time_s[0] for group in motion.groups)
        end = min(group.time_s[-1] for group in motion.groups)
        grid_s = np.arange(begin, max(end, begin) + 1e-6, motion.step_s)
        length = max(2, round(window_s / motion.step_s))
        starts = block_starts(motion, grid_s, length + 1) if grid_s.size > length else np.empty(0, np.int64)
        north, east, ahead, abeam, rate = (
            np.interp(grid_s, group.time_s, column)
            for group in (motion.position, motion.speed, motion.yaw_rate)
            for column in group.levels.T
        )
        heading = np.interp(grid_s, motion.heading.time_s, np.unwrap(motion.heading.levels[:, 0]))
        moved = _changes_over_windows(north + 1j * east, starts, length)
        step_s = float(grid_s[1] - grid_s[0]) if grid_s.size > 1 else motion.step_s
        return cls(step_s, starts, length, moved, heading, ahead + 1j * abeam, rate)

    def regress_on(self, moved: Complexes, heading: Floats, body: Complexes) -> _Regression:
        """Moves by those that heading and speeds make."""
        ahead = np.exp(1j * heading)
        turning = np.gradient(heading, self.step_s)
        path = integrate(body * ahead, self.step_s)
        travelled, arm, delay, heeled = (
            _changes_over_windows(term, self.starts, self.length)
            for term in (path, ahead, body * ahead, 1j * turning * body.real * ahead)
        )
        values, plain_residual = _robust_complex_regression(moved, travelled[:, np.newaxis])
        residual = _robust_complex_regression(moved, np.column_stack([travelled, arm, delay, heeled]))[1]
        return _Regression(complex(values[0]), _trimmed_rms(plain_residual), _trimmed_rms(residual))


def _find_sign_or_unit_error(moves: _Moves) -> tuple[str, str, float] | None:
    """The sign or unit error that removes the contradiction: in words, its channel, the share left without it."""
    path, plain = _trimmed_rms(moves.moved), moves.regress_on(moves.moved, moves.heading, moves.body)
    if not max(plain.residual_m, plain.plain_residual_m) > _LEAST_LEFT * path:
        return None
    tried = {
        "chart": moves.regress_on(moves.moved.conj(), moves.heading, moves.body),
        "body": moves.regress_on(moves.moved, moves.heading, moves.body.conj()),
        "heading": moves.regress_on(moves.moved, -moves.heading, moves.body),
    }
    for axes, velocity in (("north_east", moves.body), ("east_north", 1j * moves.body.conj())):
        fit = moves.regress_on(moves.moved, np.zeros_like(moves.heading), velocity)
        if abs(fit.ratio - 1.0) < _NEAR_ONE:
            tried[axes] = fit
    if np.ptp(np.angle(np.exp(1j * moves.heading))) < _FULL_TURN_RAD_IN_DEG:
        tried["radians"] = moves.regress_on(moves.moved, np.rad2deg(moves.heading), moves.body)
    ahead, abeam = moves.body.real, moves.body.imag
    for unit, factor in _SPEED_UNITS.items():
        in_turn = {"surge": factor * ahead + 1j * abeam, "sway": ahead + 1j * factor * abeam}
        for name, body in in_turn.items():
            fit = moves.regress_on(moves.moved, moves.heading, body)
            if abs(abs(fit.ratio) - 1.0) < _NEAR_ONE:  # else the other is too small, or both are in other units
                tried[f"{name} alone is in {unit}"] = fit
    kind = min(tried, key=lambda candidate: tried[candidate].residual_m)
    best, windows = tried[kind], moves.starts.size
    is_removed = best.removes_residual_of(plain)
    if kind == "body" or kind.startswith("surge alone"):
        # Sway with the wrong sign, or in another unit than surge, looks much like a lever arm: then the residual is
        # much smaller without one, and stays likelier with lever arm, delay and heel in the model.
        is_smaller = best.plain_residual_m < _REMOVED * plain.plain_residual_m
        is_removed = is_removed or (is_smaller and best.is_clearer(plain, windows))
    if not is_removed:
        return None
    rivals = [
        _error_in_words(name, fit)[0]
        for name, fit in tried.items()
        if name != kind and fit.removes_residual_of(plain) and not best.is_clearer(fit, windows)
    ]
    words, channel = _error_in_words(kind, best)
    return " or as well if ".join([f"they agree if {words}", *rivals]), channel, plain.plain_residual_m / path


def _error_in_words(kind: str, fit: _Regression) -> tuple[str, str]:
    """A sign or unit error in words, and its channel."""
    angle_deg = float(np.rad2deg(np.angle(fit.ratio)))
    if kind == "radians":
        return "the heading is in radians, not degrees", "heading_deg"
    if kind == "heading":
        deviations_deg = {
            convention.words: abs(float(ship.angle_difference(angle_deg, convention.offset_deg)))
            for convention in conventions.HEADINGS[1:]
        }
        words = min(deviations_deg, key=deviations_deg.__getitem__)
        words = words if deviations_deg[words] < _NEAR_DEG else "anticlockwise"
        return f"the heading counts {words}", "heading_deg"
    if kind in conventions.AXES:
        return f"surge and sway are speeds {conventions.AXES[kind]}", "surge_mps"
    if "alone" in kind:
        return f"{kind}, not m/s", f"{kind.partition(' ')[0]}_mps"
    contradictions = {
        ("chart", 0): ("east counts to the west", "east_m"),
        ("chart", 2): ("north counts to the south", "north_m"),
        ("chart", 3): ("north and east are exchanged", "north_m"),
        ("body", 0): ("sway counts to port", "sway_mps"),
        ("body", 1): ("surge and sway are exchanged", "surge_mps"),
        ("body", 2): ("surge counts astern", "surge_mps"),
    }
    fallback = {"chart": ("the chart is mirrored", "north_m"),
             "body": ("one of surge and sway has the wrong sign", "surge_mps")}  # fmt: skip
    return contradictions.get((kind, round(angle_deg / 90.0) % 4), fallback[kind])


def _changes_over_windows(values: NDArray[Any], starts: Ints, length: int) -> NDArray[Any]:
    """The change of values on the grid over each window."""
    return np.asarray(values[starts + length] - values[starts])


def _robust_complex_regression(
    moved: Complexes | Floats, slopes: Complexes | Floats
) -> tuple[Complexes, Complexes]:
    """Complex least squares with Cauchy's weights: the values [p] and what is left [n].

    Less than a hundred-thousandth of the moves is no residual: in tables without noise most would weigh nothing.
    """
    size = np.sqrt(np.mean(np.abs(slopes) ** 2, axis=0)) + 1e-12
    scaled = (slopes / size).astype(np.complex128)
    weights, floor = np.ones(moved.size), _NO_RESIDUAL * float(np.sqrt(np.mean(np.abs(moved) ** 2))) + 1e-9
    for _ in range(_ROUNDS):
        matrix = (scaled.conj() * weights[:, np.newaxis]).T @ scaled / weights.sum() + 1e-6 * np.eye(size.size)
        values = np.linalg.solve(matrix, (scaled.conj() * weights[:, np.newaxis]).T @ moved / weights.sum())
        residual = moved - scaled @ values
        scale = 2.0 * float(np.median(np.abs(residual))) + floor
        weights = 1.0 / (1.0 + (np.abs(residual) / scale) ** 2)
    return np.asarray(values / size), np.asarray(residual)


def _trimmed_rms(values: Complexes | Floats) -> float:
    """The root mean square of all but the largest fifth."""
    squares = np.sort(np.abs(values) ** 2)
    return float(np.sqrt(squares[: max(1, int(_KEPT * squares.size))].mean()))
