"""The motion channels of a table as smooth functions of time, and blocks of time in which all of them are there.

Positions, heading, speeds and yaw rate are four groups, each with stamps of its own. Groups that are faster than
:data:`STEP_S` are averaged over that long, time and value alike, which shifts nothing.
From them follow the path that heading and speeds describe, and the turns that the yaw rate gives, as models of
what may be wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, integrate, to_earth
from seatrial.analysis.quality.samples import runs, runs_of_equal
from seatrial.analysis.tables.table import NANO, require, times_ns

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


@dataclass(frozen=True, slots=True)
class Group:
    """One group: ``time_s`` [n] increasing, ``levels`` [n, channels] in SI units, ``interval_s`` between them."""

    time_s: Floats
    levels: Floats
    interval_s: float

    def without(self, invalid: Bools) -> Group:
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

    def half(self, first: int) -> CleanMotion:
        """The motion by every other sample of heading, speeds and yaw rate, from the ``first`` on (0 or 1)."""
        heading, speed, yaw_rate = (
            Group(group.time_s[first::2], group.levels[first::2], 2.0 * group.interval_s)
            for group in self.groups[1:]
        )
        return CleanMotion(self.position, heading, speed, yaw_rate, self.step_s)

    @property
    def slowest_s(self) -> float:
        return max(group.interval_s for group in self.groups)

    @property
    def groups(self) -> tuple[Group, ...]:
        return self.position, self.heading, self.speed, self.yaw_rate


def motion_of(table: pd.DataFrame) -> CleanMotion:
    """The motion in a table of raw samples, time from its first row.

    Raises :class:`InputError` where a channel is missing and :class:`DataShortageError` for less than 8 samples.
    """
    require(table, MOTION)
    raw = {name: group_samples(table, channels) for name, channels in GROUPS.items()}
    step_s = max(STEP_S, min(group.interval_s for group in raw.values()))
    speed, yaw_rate = (
        _average(group.without(outliers(group.levels)), step_s) for group in (raw["surge_mps"], raw["yaw_rate_dps"])
    )
    heading = _average(_sound_heading(raw["heading_deg"], yaw_rate), step_s)
    path = path_at(raw["north_m"].time_s, heading, speed, step_s)
    spikes = outliers(raw["north_m"].levels - path)
    position = _average(raw["north_m"].without(spikes), step_s)
    return CleanMotion(
        position, heading, speed, yaw_rate, step_s, tuple(group.interval_s for group in raw.values())
    )


def group_samples(table: pd.DataFrame, channels: tuple[str, ...]) -> Group:
    """The samples of channels that are stamped together, in radians where they are angles."""
    times = (times_ns(table) - times_ns(table).min()) / NANO
    columns = [table[name].to_numpy(dtype=float) for name in channels]
    if len(columns) > 1 and not (np.isfinite(columns[0]) & np.isfinite(columns[1])).any():
        valid = np.isfinite(columns[1])
        columns[1] = np.interp(times, times[valid], columns[1][valid])
    values = np.column_stack(columns)
    valid = np.isfinite(values).all(axis=1)
    order = np.flatnonzero(valid)[np.argsort(times[valid], kind="stable")]
    if order.size < 8:
        raise DataShortageError(f"holds only {order.size} samples of {channels[0]}", fix="record for longer")
    scale = np.pi / 180.0 if channels[0].endswith(("_deg", "_dps")) else 1.0
    steps = np.diff(times[order])
    interval_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    return _without_repeats(Group(times[order], values[order] * scale, interval_s))


def _without_repeats(samples: Group) -> Group:
    """Without the copies of a slower source that was written again and again: repeats that come regularly.

    Rounded values repeat too, but now and then; their copies are samples like all others.
    """
    new, lengths = runs_of_equal((np.diff(samples.levels, axis=0) != 0.0).any(axis=1))
    usual = float(np.median(lengths))
    if usual < 2.0 or np.mean(np.abs(lengths - usual) <= 0.1 * usual + 0.5) < 0.8:
        return samples
    return Group(samples.time_s[new], samples.levels[new], usual * samples.interval_s)


def outliers(values: Floats) -> Bools:
    """Rows of [n, channels] that lie outside their two neighbours on either side by far more than noise.

    What rises or falls steadily never sticks out, however steep.
    """
    before, after = np.pad(values, ((2, 2), (0, 0)), mode="reflect"), values
    sides = np.stack([before[:-4], before[1:-3], before[3:-1], before[4:]])
    outside = np.maximum(np.maximum(sides.min(axis=0) - after, after - sides.max(axis=0)), 0.0)
    spread = np.abs(after - np.median(sides, axis=0))
    common = spread <= np.quantile(spread, 0.99, axis=0)
    scale = np.maximum(
        1.4826 * np.median(spread, axis=0), np.sqrt(np.mean(np.where(common, spread, 0.0) ** 2, axis=0))
    )
    return np.asarray((outside > _SPIKE * scale + 1e-9).any(axis=1))


def spline(samples: Group) -> Callable[..., Floats]:
    """A cubic spline through a group; across what is missing it is straight."""
    from scipy.interpolate import CubicSpline

    steps = np.diff(samples.time_s)
    extra = np.maximum(np.ceil(steps / (1.5 * samples.interval_s)).astype(int) - 1, 0)
    extra = np.where(steps > 1.5 * samples.interval_s, np.minimum(extra, 1000), 0)
    which = np.repeat(np.arange(steps.size), extra)
    rank = np.arange(which.size) - np.repeat(np.cumsum(extra) - extra, extra) + 1
    added = samples.time_s[which] + steps[which] * rank / (extra[which] + 1)
    times = np.sort(np.concatenate([samples.time_s, added]))
    values = np.column_stack([np.interp(times, samples.time_s, column) for column in samples.levels.T])
    curve: Callable[..., Floats] = CubicSpline(times, values)
    return curve


def path_at(time_s: Floats, heading: Group, speed: Group, step_s: float) -> Floats:
    """The path [n, 2] north and east that heading and speeds describe, at any times."""
    grid = np.arange(time_s[0], time_s[-1] + 2.0 * step_s, step_s)
    angle = np.interp(grid, heading.time_s, heading.levels[:, 0])
    ahead, aside = (np.interp(grid, speed.time_s, column) for column in speed.levels.T)
    travelled = (integrate(velocity, step_s) for velocity in to_earth(ahead, aside, angle))
    return np.column_stack([np.interp(time_s, grid, column) for column in travelled])


def rotate(angle_rad: Floats, body: Floats) -> Floats:
    """Vectors [n, 2] from forward and starboard to north and east."""
    return np.column_stack(to_earth(body[:, 0], body[:, 1], angle_rad))


def _average(samples: Group, step_s: float) -> Group:
    """Means of time and value over each step; what is slower stays as it is, but for repeated times."""
    bins = np.floor(samples.time_s / step_s + 1e-6).astype(np.int64)
    _, place, count = np.unique(bins, return_inverse=True, return_counts=True)
    time_s = np.bincount(place, samples.time_s) / count
    values = np.column_stack([np.bincount(place, column) / count for column in samples.levels.T])
    return Group(time_s, values, max(samples.interval_s, step_s))


def _sound_heading(heading: Group, yaw_rate: Group) -> Group:
    """Unwrap the heading along the integrated yaw rate, and replace it by that where it contradicts it wildly."""
    turned_at = integrate(yaw_rate.levels[:, 0], yaw_rate.time_s)
    turned = np.interp(heading.time_s, yaw_rate.time_s, turned_at)
    slow, deviation = off_the_turn(heading.levels[:, 0], turned, heading.interval_s)
    wild = wild_headings(deviation, turned)
    if wild.mean() < _MOST_WILD:
        deviation[wild] = np.interp(heading.time_s[wild], heading.time_s[~wild], deviation[~wild])
    return Group(heading.time_s, (turned + slow + deviation)[:, np.newaxis], heading.interval_s)


def off_the_turn(heading_rad: Floats, turned_rad: Floats, interval_s: float) -> tuple[Floats, Floats]:
    """The slow way between headings and the integrated yaw rate, and how far each heading is off both: [n] rad.

    The difference of heading and integrated yaw rate wanders slowly, by bias and scale of the gyro.
    """
    deviation = heading_rad - turned_rad
    slow = _slow_angle(deviation, interval_s)
    return slow, np.angle(np.exp(1j * (deviation - slow)))


def wild_headings(off_rad: Floats, turned_rad: Floats) -> Bools:
    """Which headings are far off all that the yaw rate says of the time from the sample before to the one after, as
    those that were interpolated through north.

    A turn that begins between two samples is off the integrated yaw rate at its own time.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    above = off_rad + turned_rad - maximum_filter1d(turned_rad, 3)
    below = minimum_filter1d(turned_rad, 3) - turned_rad - off_rad
    usual = 1.4826 * float(np.median(np.abs(off_rad)))
    return np.asarray(np.maximum(above, below) > max(_SPIKE * usual, _WILD_RAD))


def _slow_angle(angle_rad: Floats, interval_s: float) -> Floats:
    """The running median of an angle on the circle, unwrapped. Long series are thinned before."""
    from scipy.ndimage import median_filter

    thin = max(1, int(STEP_S / interval_s))
    size = 2 * int(np.clip(0.5 * _NEIGHBOURHOOD_S / (interval_s * thin), 4, 100)) + 1
    vector = np.exp(1j * angle_rad[::thin])
    middle = median_filter(vector.real, size) + 1j * median_filter(vector.imag, size)
    places = np.arange(0, angle_rad.size, thin)
    return np.asarray(np.interp(np.arange(angle_rad.size), places, np.unwrap(np.angle(middle))))


def block_starts(motion: CleanMotion, grid_s: Floats, length: int) -> Ints:
    """First grid points of the blocks of ``length`` points over which every group was recorded."""
    covered = np.ones(grid_s.size, dtype=bool)
    for group in motion.groups:
        covered &= (grid_s >= group.time_s[0]) & (grid_s <= group.time_s[-1])
        for begin, end in group.gaps():
            covered[np.searchsorted(grid_s, begin, "right") : np.searchsorted(grid_s, end)] = False
    starts = [np.arange(first, stop - length + 1, length) for first, stop in zip(*runs(covered), strict=True)]
    return np.concatenate([np.empty(0, dtype=np.int64), *starts])


Model = Callable[[Floats], tuple[Floats, Floats]]
"""Levels [points, m] on the grid (2 of position or 1 of heading) for p parameters, and their slopes [points, p, m].

The third parameter, the delay of the measured level, moves no model: its slope is what reading it later costs.
"""

_RATE_WIDTH_S = 1.0
_MEAN_WIDTH_S = 5.0


def path_model(motion: CleanMotion, grid_s: Floats) -> Model:
    """The path by heading and speeds as a model of the positions; the speeds' stamps are the time.

    The last two parameters are heel in turns, by which an antenna high up goes to the side: in m per m/s2 of
    centripetal acceleration, and in m per m/s3 of its rate, of the other sign where heel lags. The slopes by the
    delays leave heel out, which is a small part of the motion.
    """
    heading_at, body = spline(motion.heading), spline(motion.speed)(grid_s)
    first, last = motion.heading.time_s[[0, -1]]
    width = max(_RATE_WIDTH_S, motion.step_s)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, offset, _, heading_late_s, forward, starboard, heel, heel_lag = values
        times = np.clip(grid_s + heading_late_s, first + width, last - width)
        before, centre, after = (heading_at(times + shift) for shift in (-width, 0.0, width))
        true = centre[:, 0] - offset
        turning = (after - before) / (2.0 * width)
        yaw_acceleration = (after - 2.0 * centre + before) / width**2
        moving = rotate(true, body)
        travelled = integral(grid_s, moving)
        ahead, aside = np.column_stack([np.cos(true), np.sin(true)]), np.column_stack([-np.sin(true), np.cos(true)])
        heeled, heeling = (rate * body[:, :1] * aside for rate in (turning, yaw_acceleration))
        arm = forward * ahead + starboard * aside + heel * heeled + heel_lag * heeling
        swung = turning * _quarter_turn(arm)
        bent = integral(grid_s, turning * factor * _quarter_turn(moving))
        by_offset = -factor * _quarter_turn(travelled) - _quarter_turn(arm)
        slopes = (travelled, by_offset, -factor * moving - swung, bent + swung, ahead, aside, heeled, heeling)
        return factor * travelled + arm, np.stack(slopes, axis=1)

    return model


def turn_model(motion: CleanMotion, grid_s: Floats) -> Model:
    """The heading by the integrated yaw rate, whose stamps are the time; factor, bias and delay of the heading.

    The slope by the factor is the smoothed heading: unlike the integrated yaw rate it shares no noise with what
    is left, which would make the factor too small (an instrumental variable).
    """
    from scipy.ndimage import uniform_filter1d

    rate = spline(motion.yaw_rate)(grid_s)
    turned, elapsed = integral(grid_s, rate), (grid_s - grid_s[0])[:, np.newaxis]
    size = 2 * int(0.5 * _MEAN_WIDTH_S / motion.step_s) + 1
    smooth = uniform_filter1d(spline(motion.heading)(grid_s), size, axis=0)

    def model(values: Floats) -> tuple[Floats, Floats]:
        factor, bias, _ = values
        slopes = (smooth / factor, elapsed, -factor * rate - bias)
        return factor * turned + bias * elapsed, np.stack(slopes, axis=1)

    return model


def interpolate(time_s: Floats, grid_s: Floats, columns: Floats) -> Floats:
    """Columns [points, m] on the even grid, linearly at other times."""
    place = np.clip((time_s - grid_s[0]) / (grid_s[1] - grid_s[0]), 0.0, grid_s.size - 1.000001)
    before = place.astype(np.int64)
    share = (place - before)[:, np.newaxis]
    return np.asarray(columns[before] * (1.0 - share) + columns[before + 1] * share)


def integral(grid_s: Floats, rates: Floats) -> Floats:
    """Rates [points, ...] integrated from the first point, by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(grid_s, rates).antiderivative()(grid_s))


def _quarter_turn(vectors: Floats) -> Floats:
    """Vectors [n, 2] north and east turned by +90 deg: the change by a turn of one radian."""
    return np.column_stack([-vectors[:, 1], vectors[:, 0]])
