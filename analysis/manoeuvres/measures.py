"""Measurements on a manoeuvre: held commands and executes, crossings, peaks, distances, and their intervals.

Intervals come from a bootstrap with the spectrum of the noise. The measured motion is the sum of a smooth one
and a residual, noise and waves. Many times a residual of the same spectrum with random phases (Theiler et al.
1992, Physica D 58) is added to the smooth motion, which is smoothed again and the index measured again. The
spread of the results is the index's uncertainty; their mean minus the original value is the bias of the
smoothing, and is subtracted.

The smoother absorbs the slow part of the noise, which the residual lacks; there the spectrum is continued at
the level just above.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from seatrial.acquisition.core.quantities import Floats, rotate_earth_to_ship
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, wrap_360
from seatrial.analysis.manoeuvres import motion as motions
from seatrial.analysis.manoeuvres.indices import Manoeuvre, index_from_value, unit_in_name
from seatrial.analysis.series import LEAST_SAMPLES, local_quadratic

APPROACH_S = 10.0
SHAFTS_CHANGED = "the shafts did not turn as in the approach"
"""The note on a run whose shafts were ordered otherwise after the execute, or lost their speed under the load."""
_KEPT_RPM_SHARE = 0.15  # of a shaft's speed: under the load of turns of 10 and 20 deg R/V Gunnerus' lost up to 0.04
_ASTERN_SHARE = 0.5  # of the speed: less is drift, or the noise of a ship at rest

_LONGEST_CHANGE_S, _BEFORE_S = 15.0, 4.0
_AHEAD = 1.15  # of the distance back to the start of a change; noise bends the line by less
_SLOWER = 1.5  # factor by which a single change may be slower than usual
_LEAST_MOVE_SHARE, _LEAST_MOVE_DEG = 0.3, 2.5  # of the largest helm: less is course-keeping
_LONGEST_ORDER_LAG_S = 20.0  # from an order to the first movement of the steering gear
_EXTRAPOLATED = 2.0  # the start of a change is known so much worse than its middle, by the line through both
_SOFT_START_S = 0.15  # how much later than an order a steering gear's beginning is seen: none is there at once
_SHARED = 0.4  # the share of that which all executes of a run have alike; by manoeuvre_trials, from 3000
_SURELY = 3.0  # times what the beginning of a change is known within, by which it is not before an order
_BLOCKS, _TWO_SIDED_95_OF_BLOCKS = 6, 2.57  # Student's t of five degrees of freedom
REPLICATES = 48
_FOLLOWED = 1.1  # what a fit follows of the noise is missing from what it leaves; by yard_trials.py, ships 1000 on
WIDEST_S = 8.0
_FEWEST_ROWS = 3
_TWO_SIDED_95, _OF_UNIFORM_95 = 1.96, 0.95  # of a standard deviation, and of half of an even distribution
_HALF_BEAM_LENGTHS = 1.0 / 13.0  # of the usual ship, six and a half times as long as it is wide
_SEED = 137
Measure = Callable[[motions.Motion, Floats], dict[str, float]]
"""A function for the indices of a smooth motion and the times of its commands [s]."""
_STEP_S = 1.0
_STEP_SIGMAS = 6.0
_BRIDGE_S = 4.0
_BLINK_SHARE, _BLINKS = 0.5, 3  # how long a correction lasts: of the order, and of the longest bridge
_ALIKE_SHARE, _ALIKE_DEG = 0.15, 1.0
_ALIKE_LONG_SHARE = 0.05  # of helms that are both held for longer than a correction
HELD_SHARE = 0.35  # of a helm, by which it may wander while it is held: not half of the way to amidships
_FEWEST_OF_FIT, _FEWEST_BEFORE = 5, 2
_FEW_ROWS, _EVEN_PART = 5.0, (0.05, 0.6)  # rows of a change, and the shares of it that every drive passes evenly
_CREEP = 4.0  # times as long as the last half of a change, and a row: no drive begins so slowly
CONTRADICTION = "the recorded orders do not precede the helm"


def helm_rate_dps(helm: Floats, step_s: float) -> float:
    """The usual rate of a helm [deg/s], from its values [deg, rows]: that of the steepest third between
    extremes.

    The median over all movements of at least a third of the largest helm; infinite without any. Movements that take
    few rows are as long as the mean number of rows on the way says: between two rows any rate is possible.
    """
    calm, turns = helm_turning_points(helm, step_s)
    rates, ways_deg, (least, most) = list[float](), list[float](), _EVEN_PART
    on_way = 0  # rows of all movements
    for first, last in pairwise(turns):
        travel = np.maximum.accumulate(np.abs(calm[first : last + 1] - calm[first]))
        order = np.arange(travel.size)
        rows = np.interp(np.linspace(0.1, 0.9, 9) * travel[-1], travel + 1e-9 * order, order)
        rates.append(float(0.3 * travel[-1] / (step_s * max(0.3, (rows[3:] - rows[:-3]).min()))))
        ways_deg.append(float(travel[-1]))
        on_way += int(np.count_nonzero((travel > least * travel[-1]) & (travel < most * travel[-1])))
    if not rates:
        return float("inf")
    # without a row on the way the rate is high, and yet not infinite
    takes_rows = max(on_way, 0.5) / len(rates) / (most - least)
    if takes_rows >= _FEW_ROWS:
        return float(np.median(rates))
    return max(float(np.median(rates)), float(np.mean(ways_deg)) / (takes_rows * step_s))


def helm_turning_points(helm: Floats, step_s: float) -> tuple[Floats, list[int]]:
    """The helm without noise, and the rows between which it moves by more than course-keeping does."""
    calm = motions.running_median(helm, max(3, round(1.5 / step_s)))
    largest = float(np.percentile(np.abs(calm), 99))
    return calm, extreme_rows(
        calm, max(_LEAST_MOVE_DEG, _LEAST_MOVE_SHARE * largest, 6.0 * motions.row_to_row_noise(helm))
    )


def extreme_rows(values: Floats, least: float) -> list[int]:
    """The rows of the extremes between which ``values`` alternately rise and fall by at least ``least``.

    >>> extreme_rows(np.array([0.0, 1.0, 5.0, 4.5, 5.2, 0.0]), 3.0)
    [0, 4, 5]
    """
    extremes, low, high, rising = list[int](), 0, 0, 0
    for row, value in enumerate(values):
        low, high = row if value < values[low] else low, row if value > values[high] else high
        if rising >= 0 and values[high] - value >= least:
            extremes, rising, low = [*extremes, high], -1, row
        elif rising <= 0 and value - values[low] >= least:
            extremes, rising, high = [*extremes, low], 1, row
    return [*extremes, high if rising > 0 else low] if rising else []


def longest_helm_change_s(motion: motions.Motion, change_deg: float) -> float:
    """The longest time for a change of the helm [s], at its usual rate."""
    return _SLOWER * abs(change_deg) / motion.helm_rate_dps


class Execute(NamedTuple):
    """When a helm was ordered and when it was half over [s], each with half of what it is known within [s].

    ``contradicts`` says that orders are recorded, but none that the helm could have followed.
    """

    order_s: float
    half_s: float
    order_within_s: float
    half_within_s: float
    contradicts: bool = False


def helm_execute(motion: motions.Motion, plateau: Plateau, last: Plateau | None = None) -> Execute:
    """The execute of the helm of a plateau, that came from the ``last`` one if there is one.

    The order is the one recorded; else the helm moves from the order on. Where orders were recorded as events it
    lies before half of the change.
    """
    if last is None:
        longest_s = max(_LONGEST_CHANGE_S, longest_helm_change_s(motion, plateau.level) + 5.0)
        before_deg = level_before_plateau(motion, motion.helm_deg, plateau, longest_s + 1.0)
        earliest = motion.row_before(plateau.first, longest_s)
    else:
        before_deg, earliest = last.level, (last.first + last.end) // 2
    begun_s, half_s = execute_times_s(motion.time_s, motion.helm_deg, plateau, before_deg, earliest)
    takes_s = abs(plateau.level - before_deg) / motion.helm_rate_dps
    if plateau.first - earliest >= _FEWEST_BEFORE and 0.0 < takes_s < _FEW_ROWS * motion.step_s:
        begun_s = _start_of_brief_change_s(motion, plateau.level, before_deg, half_s, takes_s)
    begun_s = min(begun_s, half_s)
    within_s = _execute_uncertainty_s(motion, plateau.level - before_deg)
    first = int(np.searchsorted(motion.time_s, begun_s))
    approach_deg = motion.helm_deg[motion.row_before(first, APPROACH_S) : first]
    wander_s = 0.0  # what the helm takes for the movements by which a hand kept the course before
    if last is None and approach_deg.size:
        wander_s = np.sqrt(3.0) * (float(np.std(approach_deg)) / motion.helm_rate_dps)
    half_within_s = float(np.hypot(_execute_uncertainty_s(motion, plateau.level), 0.5 * wander_s))
    if motion.orders_are_events:
        return Execute(0.5 * (begun_s + half_s), half_s, max(half_s - begun_s, within_s), half_within_s)
    noise_s = np.sqrt(3.0) * motions.row_to_row_noise(motion.helm_deg) / motion.helm_rate_dps
    parts_s = [_EXTRAPOLATED * within_s, 0.7 * noise_s, 0.1 * motion.step_s, wander_s, _SOFT_START_S]
    order_within_s = float(np.linalg.norm(parts_s))  # calibrated by yard_trials, from 1000, and manoeuvre_trials
    if motion.helm_order_deg is None:
        return Execute(begun_s, half_s, order_within_s, half_within_s)

    near = motion.between(max(float(motion.time_s[earliest]), begun_s - _LONGEST_ORDER_LAG_S), half_s)
    orders_deg = np.asarray(near.helm_order_deg)
    if orders_deg.size > 1 and abs(change_deg := orders_deg[-1] - orders_deg[0]) >= _LEAST_MOVE_DEG:
        row = _last_crossing((orders_deg - orders_deg[0]) / change_deg, 0.5)
        ordered_s = float(np.interp(row, np.arange(near.time_s.size), near.time_s))
        if ordered_s <= begun_s + max(motion.step_s, _SURELY * order_within_s):
            return Execute(ordered_s, half_s, 0.5 * motion.step_s, half_within_s)
    contradicts = plateau.first - earliest >= _FEWEST_BEFORE  # else the recording begins with the helm over
    return Execute(begun_s, half_s, order_within_s, half_within_s, contradicts)


def _start_of_brief_change_s(
    motion: motions.Motion, level_deg: float, before_deg: float, half_s: float, takes_s: float
) -> float:
    """When a helm began to move that takes ``takes_s`` at its usual rate, from the rows in which it was on its way.

    A line through so few rows begins at the last one before the change, in the mean half of a row early. Without a
    row on the way the change is as likely anywhere between the rows about it.
    """
    share = (motion.helm_deg - before_deg) / (level_deg - before_deg)
    least, most = _EVEN_PART
    half = int(np.searchsorted(motion.time_s, half_s))
    last = min(int(_last_crossing(share[: half + 1], least)), share.size - 2)
    there = min(last + 1 + int(_first_crossing(share[last + 1 :], most)), share.size - 1)
    on_way = slice(last + 1, there)
    if there > last + 1:
        start_s = float(np.mean(motion.time_s[on_way] - share[on_way] * takes_s))
    else:
        start_s = 0.5 * float(motion.time_s[last] + motion.time_s[there] - most * takes_s)
    return float(np.clip(start_s, *motion.time_s[[last, last + 1]]))


def _execute_uncertainty_s(motion: motions.Motion, change_deg: float) -> float:
    """How well the moment is known at which a helm was half over [s]: half a row for a change within one row, less
    for one over several; plus the effect of the helm's noise on a fit through the middle of the change and on the
    levels before and after, medians of some seconds."""
    rows = max(1.0, abs(change_deg) / (motion.helm_rate_dps * motion.step_s))
    level = 0.5 * np.sqrt(2.0) * 1.25 / np.sqrt(max(_BEFORE_S / motion.step_s, 1.0))
    noise_s = (
        motions.row_to_row_noise(motion.helm_deg)
        / motion.helm_rate_dps
        * np.hypot(level, 1.0 / np.sqrt(max(0.5 * rows, 1.0)))
    )
    return float(0.5 * motion.step_s / rows + np.sqrt(3.0) * noise_s)


def level_before_plateau(
    motion: motions.Motion, command: Floats, plateau: Plateau, longest_s: float = _LONGEST_CHANGE_S + 1.0
) -> float:
    """The level of a command shortly before it moved to a plateau: the median of 4 s before the change.

    The change itself, of at most ``longest_s``, is where the command is closer to the plateau than to its level
    before.
    """
    rows = round(_BEFORE_S / motion.step_s)
    first = motion.row_before(plateau.first, longest_s)
    ahead = command[first : plateau.first + 1]
    start = float(np.median(ahead[: max(rows, 1)]))
    share = (ahead - start) / (plateau.level - start) if plateau.level != start else np.zeros(ahead.size)
    half, third = (_last_crossing(share, level) for level in (0.5, 0.3))
    end = max(1, int(half - _AHEAD * 2.5 * (half - third)))  # before a line through both leaves the old level
    return float(np.median(ahead[max(0, end - max(rows, 1)) : end]))


def approach_state(motion: motions.Motion, execute: float) -> dict[str, float]:
    """The mean state in the last seconds before an execute.

    Speed, heading (also as it runs on without jumps), the turn of heading
    and the change of speed in a second (how steady the approach was); of a ship that goes astern also the speed
    ahead, which is negative.
    """
    execute = float(np.clip(execute, motion.time_s[0], motion.time_s[-1]))
    before = motion.between(execute - APPROACH_S, execute)
    if before.time_s.size < 2:
        before = motion.between(execute - 1.5 * motion.step_s, execute + 1.5 * motion.step_s)
    heading, surge_mps = float(before.heading_deg.mean()), float(before.surge_mps.mean())
    speed_mps = float(before.speed_mps.mean())
    span = before.time_s - before.time_s.mean()
    scale = float(np.sum(span**2)) or 1.0
    return {
        "approach_mps": speed_mps,
        **({"approach_surge_mps": surge_mps} if surge_mps < -_ASTERN_SHARE * speed_mps else {}),
        "approach_heading_deg": float(wrap_360(heading)),
        "approach_unwrapped_deg": heading,
        "approach_yaw_rate_dps": float(span @ before.heading_deg / scale),
        "approach_acceleration_mps2": float(span @ before.speed_mps / scale),
        **means_by_column(before.drives),
    }


def means_by_column(columns: Mapping[str, Floats]) -> dict[str, float]:
    """The mean of each column, by its name."""
    return {name: float(column.mean()) for name, column in columns.items()}


def mean_and_half_interval(values: Floats) -> tuple[float, float]:
    """A mean and half of its 95 % interval from the means of blocks, whose noise is nearly independent."""
    means = [float(block.mean()) for block in np.array_split(values, _BLOCKS)]
    return float(values.mean()), _TWO_SIDED_95_OF_BLOCKS * float(np.std(means, ddof=1)) / np.sqrt(_BLOCKS)


def helm_settings(motion: motions.Motion, level_deg: float, start: float, end: float) -> dict[str, float]:
    """The helm as a setting; of one by two propellers also how much faster the port one turns between two times."""
    settings = {motion.helm_setting: level_deg}
    if motion.steering == motions.BY_DIFFERENCE and len(motion.drives) == 2:
        inside = motion.between(start, end)
        port, starboard = inside.drives.values()
        settings["port_less_starboard_rpm"] = float(np.copysign(np.abs(port - starboard).mean(), level_deg))
    return settings


def approach_settings(motion: motions.Motion, execute: float) -> dict[str, float]:
    """The state before an execute as settings of a manoeuvre."""
    state = approach_state(motion, execute)
    return {name: value for name, value in state.items() if name != "approach_unwrapped_deg"}


def first_crossing_s(time_s: Floats, values: Floats, level: float, start: float, end: float) -> float:
    """The time at which ``values`` first rise through ``level`` between two times, NaN if they do not."""
    first, last = np.searchsorted(time_s, [start, end])
    above = np.flatnonzero(values[first:last] >= level)
    if not above.size:
        return float("nan")
    row = int(first + above[0])
    if row == 0 or values[row - 1] >= level:
        return float(time_s[row])
    share = (level - values[row - 1]) / (values[row] - values[row - 1])
    return float(time_s[row - 1] + share * (time_s[row] - time_s[row - 1]))


def peak_time_and_height(time_s: Floats, values: Floats, start: float, end: float) -> tuple[float, float]:
    """Time and height of the highest point between two times, by the parabola through it and its neighbours."""
    first, last = np.searchsorted(time_s, [start, end])
    if last - first < 1:
        return float(start), float(np.interp(start, time_s, values))
    row = int(first + np.argmax(values[first:last]))
    if row == 0 or row + 1 >= values.size:
        return float(time_s[row]), float(values[row])
    before, top, after = values[row - 1 : row + 2]
    bend = before - 2.0 * top + after
    if bend >= 0.0:
        return float(time_s[row]), float(top)
    shift = float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))
    return float(time_s[row] + shift * (time_s[1] - time_s[0])), float(top - 0.25 * (before - after) * shift)


def distance_m(motion: motions.Motion, start: float, end: float) -> float:
    """The distance along the track between two times [m], NaN if one of them is."""
    if not np.isfinite(start + end):
        return float("nan")
    steps = np.hypot(np.diff(motion.north_m), np.diff(motion.east_m))
    way = np.append(0.0, np.cumsum(steps))
    return float(np.interp(end, motion.time_s, way) - np.interp(start, motion.time_s, way))


def mean_between(motion: motions.Motion, name: str, start: float, end: float) -> float:
    """The mean of a column between two times, with the parts of a row at both ends."""
    inside = motion.time_s[(motion.time_s > start) & (motion.time_s < end)]
    times = np.concatenate([[start], inside, [end]])
    values = np.interp(times, motion.time_s, getattr(motion, name))
    return float(np.trapezoid(values, times) / (end - start))


def distance_ahead_and_to_starboard(
    motion: motions.Motion, start: float, time_s: float, heading_deg: float
) -> tuple[float, float]:
    """Distance ahead and to starboard, relative to a heading, from the position at ``start`` [m]."""
    north = motion.at("north_m", time_s) - motion.at("north_m", start)
    east = motion.at("east_m", time_s) - motion.at("east_m", start)
    ahead, starboard = rotate_earth_to_ship(north, east, np.deg2rad(heading_deg))
    return float(ahead), float(starboard)


def smoothing_half_width_s(motion: motions.Motion, time_scale_s: float) -> float:
    """A quarter of the manoeuvre's time scale, at most 8 s, which removes waves."""
    return float(np.clip(time_scale_s / 4.0, _FEWEST_ROWS * motion.step_s, max(WIDEST_S, 3 * motion.step_s)))


def smooth_motion(motion: motions.Motion, half_width: float) -> motions.Motion:
    """Pose and speeds replaced by local second-degree fits over ``half_width`` [s] to either side.

    Away from the ends a fit is a convolution, which is faster than :func:`local_quadratic`: a manoeuvre is smoothed
    some fifty times.
    """
    rows = half_width / motion.step_s
    reach, columns = int(np.ceil(rows)), dict[str, Any]()
    for name in POSE_AND_VELOCITY:
        values = getattr(motion, name)
        if reach < _FEWEST_ROWS or values.size < 4 * reach:
            columns[name] = local_quadratic(values, rows)
            continue
        start, kernel = _local_fit_weights(rows)
        smooth = columns[name] = np.empty_like(values)
        smooth[reach:-reach] = np.convolve(values, kernel, mode="valid")
        smooth[:reach] = start @ values[: 2 * reach]
        smooth[-reach:] = (start @ values[: -2 * reach - 1 : -1])[::-1]
        few = max(LEAST_SAMPLES - reach, 0)  # rows at the ends that have less samples nearby
        smooth[:few], smooth[values.size - few :] = values[:few], values[values.size - few :]
    return replace(motion, **columns)


@lru_cache(maxsize=64)
def _local_fit_weights(half_width: float) -> tuple[Floats, Floats]:
    """The fit at each of the first rows as a sum over the first values [reach, 2 reach], and at any row further
    in as a sum over those around it [2 reach + 1]."""
    reach = int(np.ceil(half_width))
    offset = (np.arange(2 * reach + 1) - np.arange(reach + 1)[:, np.newaxis]) / half_width
    weight = np.where(np.abs(offset) < 1.0, 0.5 + 0.5 * np.cos(np.pi * offset), 0.0)
    powers = offset[..., np.newaxis] ** np.arange(3)
    normal = np.einsum("rk,rki,rkj->rij", weight, powers, powers)
    first = np.linalg.inv(normal)[:, 0, :]
    sums = weight * np.einsum("ri,rki->rk", first, powers)
    return sums[:-1, :-1], sums[-1]


def bootstrap_index_intervals(
    motion: motions.Motion,
    executes_s: Floats,
    half_width: float,
    measure: Measure,
    unsure_s: Floats | float,
) -> dict[str, tuple[float, float]]:
    """Value and half of the 95 % interval of every index that ``measure`` gives for a motion.

    The times of the commands are known only to a part of a row: each is varied by up to ``unsure_s``, and all alike
    by a share of it, as with a drive that begins otherwise than it is taken to.
    """
    random = np.random.default_rng(_SEED)
    smooth = smooth_motion(motion, half_width)
    values = measure(smooth, executes_s)
    rows = half_width / motion.step_s
    spectra = {name: _FOLLOWED * _noise_amplitude_spectrum(getattr(motion, name) - getattr(smooth, name), rows)
               for name in POSE_AND_VELOCITY}  # fmt: skip
    # spread evenly, and noise of either sign: so few draws at random are off centre, which would pass for a bias,
    # and another one of the same ship mirrored
    even = np.linspace(-1.0, 1.0, REPLICATES + 1)[1::2]
    spread = np.multiply.outer(even, np.ones(executes_s.shape))
    separate, shared = random.permuted(spread, axis=0), spread[random.permutation(len(even))]
    repeats = []
    for shift_s in unsure_s * (separate + _SHARED * shared):
        noise = dict[str, Floats]()
        for name, amplitude in spectra.items():
            real, imaginary = random.standard_normal((2, amplitude.size)) / np.sqrt(2.0)
            noise[name] = np.fft.irfft(amplitude * (real + 1j * imaginary), smooth.time_s.size)
        for sign in (1.0, -1.0):
            noisy: dict[str, Any] = {name: getattr(smooth, name) + sign * added for name, added in noise.items()}
            replicate = smooth_motion(replace(smooth, **noisy), half_width)
            repeats.append(measure(replicate, executes_s + shift_s))

    path_within = _TWO_SIDED_95 * np.sqrt(2.0) * motion.path_sd_m  # both ends of a distance are uncertain
    place_within = dict.fromkeys(values, 0.0)
    if not smooth.is_midship and (length_m := smooth.length_m) is not None:  # an antenna anywhere on the ship
        for place_m in ((0.5 * length_m, 0.0), (0.0, _HALF_BEAM_LENGTHS * length_m)):
            at_place = measure(motions.move_motion_to_midship(smooth, place_m), executes_s)
            for name, value in values.items():
                change = _OF_UNIFORM_95 * (at_place.get(name, value) - value)
                place_within[name] = float(np.hypot(place_within[name], change))
    estimates = {}
    for name, value in values.items():
        estimate, within = value, float("nan")
        samples = np.array([repeat.get(name, np.nan) for repeat in repeats])
        samples = samples[np.isfinite(samples)]
        if np.isfinite(value) and samples.size >= REPLICATES // 2:
            # the bias is estimated from one noisy motion, and often mere noise: it counts as one standard deviation
            bias = float(np.median(samples)) - value
            estimate, within = value - bias, _TWO_SIDED_95 * float(np.hypot(samples.std(ddof=1), bias))
        if unit_in_name(name) == "m":
            within = float(np.linalg.norm([within, path_within, place_within[name]]))
        estimates[name] = estimate, within
    return estimates


def make_manoeuvre(
    motion: motions.Motion, kind: str, name: str, span_s: Floats, side: str, settings: Mapping[str, float],
    estimates: Mapping[str, tuple[float, float]], **details: Any,
) -> Manoeuvre:  # fmt: skip
    """A manoeuvre between two times of ``motion`` [s], with indices from ``estimates``: values and halves of
    intervals; those not reached are left out."""
    start, end = (motion.utc(float(time_s)) for time_s in span_s)
    reached = {index: pair for index, pair in estimates.items() if np.isfinite(pair[0])}
    indices = {index: index_from_value(index, *pair, motion.length_m, kind) for index, pair in reached.items()}
    return Manoeuvre(kind, name, start, end, side, settings, indices, **details)


def _noise_amplitude_spectrum(remainder: Floats, half_rows: float) -> Floats:
    """The amplitude spectrum of the noise, from that of the residual with its slow part filled in.

    The local fit follows slow noise and leaves a known share of each frequency; where that is less than half,
    the level of the octave above is used, also for the mean, which determines indices averaged over most of a
    manoeuvre.
    """
    amplitude = np.abs(np.fft.rfft(remainder - remainder.mean()))
    frequency = np.fft.rfftfreq(remainder.size)
    kernel = _local_fit_weights(half_rows)[1]
    offset = np.arange(kernel.size) - kernel.size // 2
    residual_share = 1.0 - np.cos(2.0 * np.pi * np.outer(frequency, offset)) @ kernel
    edge = frequency[np.argmax(residual_share > 0.5)]
    resolved = frequency >= edge
    amplitude[resolved] /= np.maximum(residual_share[resolved], 0.5)
    amplitude[~resolved] = np.sqrt(np.mean(amplitude[resolved & (frequency <= 2.0 * edge)] ** 2))
    amplitude[0] *= np.sqrt(2.0)  # the mean has no imaginary part
    return amplitude


@dataclass(frozen=True, slots=True)
class Plateau:
    """A held command: rows ``first`` to ``end``, its ``level`` and the ``spread`` of the middle 80 % of its
    values."""

    first: int
    end: int
    level: float
    spread: float


def command_noise_tolerance(values: Floats, least: float) -> float:
    """The variation of a held command within two seconds: six standard deviations of its noise."""
    return max(least, _STEP_SIGMAS * motions.row_to_row_noise(values))


def find_plateaus(
    values: Floats, step_s: float, tolerance: float, least_s: float = 2.0, rate: float = np.inf
) -> list[Plateau]:
    """The stretches in which ``values`` [rows] change by at most ``tolerance`` within two seconds, in order of
    time.

    They last for ``least_s`` at least, and where that is less than two seconds it is within that time. For a
    command whose usual ``rate`` changes it by no more than the tolerance in two seconds, within the time for twice
    of it. A slower ramp is a plateau with a spread. Plateaus of one level separated only briefly are joined.
    """
    reach = max(1, round(max(min(_STEP_S, 0.5 * least_s), tolerance / rate) / step_s))
    calm = motions.running_median(values, max(3, round(1.5 / step_s)))
    change = np.zeros(values.size)
    if values.size > 2 * reach:
        change[reach:-reach] = calm[2 * reach :] - calm[: -2 * reach]
    pieces = [
        _extended_plateau(calm, first, end, reach, tolerance)
        for first, end in motions.runs_of_true(np.abs(change) <= tolerance, round(least_s / step_s))
    ]

    def join(last: Plateau, following: Plateau) -> Plateau | None:
        pause, step = following.first - last.end, abs(following.level - last.level)
        near = pause <= round(_BRIDGE_S / step_s) and step <= tolerance
        return _extended_plateau(calm, last.first, following.end, 0, tolerance) if near else None

    return merge_neighbours(pieces, join)


def _extended_plateau(values: Floats, first: int, end: int, reach: int, tolerance: float) -> Plateau:
    """A plateau extended by up to ``reach`` rows as long as the values keep its level, since a change within
    two seconds is detected before it begins."""
    low, middle, high = np.percentile(values[first:end], [10, 50, 90])
    departed = np.abs(values[end : end + reach] - middle) > 0.5 * tolerance + 0.5 * (high - low)
    return Plateau(
        first, end + (int(departed.argmax()) if departed.any() else departed.size), float(middle), float(high - low)
    )


def is_same_order(
    one_deg: float, other_deg: float, wander_deg: float = 0.0, alike_share: float = _ALIKE_SHARE
) -> bool:
    """Whether two helm angles are the same order, within the accuracy of setting them and what they wander by."""
    return abs(one_deg - other_deg) <= alike_share * max(abs(one_deg), abs(other_deg)) + _ALIKE_DEG + wander_deg


def merge_corrections(pieces: list[Plateau], step_s: float) -> list[Plateau]:
    """Plateaus of helm with those of the same order joined: a short one before or after a long one at nearly
    the same angle, where the helm was corrected."""
    bridge = round(_BRIDGE_S / step_s)

    def join(last: Plateau, following: Plateau) -> Plateau | None:
        short, long = sorted((last.end - last.first, following.end - following.first))
        near = following.first - last.end <= bridge and short <= min(_BLINK_SHARE * long, _BLINKS * bridge)
        if not (near and last.level * following.level > 0 and is_same_order(last.level, following.level)):
            return None
        longer = max(last, following, key=lambda plateau: plateau.end - plateau.first)
        return replace(longer, first=last.first, end=following.end)

    return merge_neighbours(pieces, join)


def join_interrupted_plateaus(helm: Floats, held: Sequence[Plateau], step_s: float) -> list[Plateau]:
    """Plateaus of one order with those between which the helm was not steady, but near it all the time, joined: a
    rudder that wanders by some degrees, or creeps, is held. Two that are long and differ are two orders.
    """
    calm = motions.running_median(helm, max(3, round(1.5 / step_s)))

    def join(last: Plateau, following: Plateau) -> Plateau | None:
        longer = max(last, following, key=lambda plateau: plateau.end - plateau.first)
        between = np.abs(calm[last.end : following.first] - longer.level)
        shorter_s = min(last.end - last.first, following.end - following.first) * step_s
        alike_share = _ALIKE_SHARE if shorter_s <= _BLINKS * _BRIDGE_S else _ALIKE_LONG_SHARE
        wander_deg = min(last.spread, following.spread)
        near = last.level * following.level > 0 and is_same_order(
            last.level, following.level, wander_deg, alike_share
        )
        if not near or np.any(between > HELD_SHARE * abs(longer.level)):
            return None
        return replace(longer, first=last.first, end=following.end)

    return merge_neighbours(list(held), join)


def merge_neighbours(pieces: list[Plateau], join: Callable[[Plateau, Plateau], Plateau | None]) -> list[Plateau]:
    """Plateaus with neighbours merged where ``join`` makes one of the two."""
    result: list[Plateau] = []
    for plateau in pieces:
        merged = join(result[-1], plateau) if result else None
        result[-1:] = [merged] if merged else [*result[-1:], plateau]
    return result


def execute_times_s(
    time_s: Floats, values: Floats, plateau: Plateau, before: float, earliest: int = 0
) -> tuple[float, float]:
    """The times at which a command began to move from the level ``before`` to that of ``plateau``, and was
    half-way there [s].

    The line through the times of a tenth and a half of the change, extrapolated back to its start: noise about
    the old level does not shift it, and a drive with lag or limited rate has the same line.
    """
    held_at_once = plateau.first - earliest < _FEWEST_BEFORE  # where a recording begins or goes on after a break
    if held_at_once or abs(plateau.level - before) <= plateau.spread:
        return float(time_s[plateau.first]), float(time_s[plateau.first])
    share = (values[earliest : plateau.end] - before) / (plateau.level - before)
    inside = plateau.first - earliest + max(1, (plateau.end - plateau.first) // 4)
    half = _last_crossing(share[: inside + 1], 0.5)
    tenth = _last_crossing(share[: int(half) + 2], 0.1)
    rise_rows = _first_crossing(share[int(half) :], 0.9)
    if half - tenth > _CREEP * (rise_rows + 0.25) and before != (near := float(values[earliest + int(half)])):
        # a hand that held the course crept this way before: the order began where the last of it began
        return execute_times_s(time_s, values, plateau, near, earliest)
    first = int(np.ceil(_last_crossing(share[: int(half) + 2], 0.25)))
    last = int(half) + int(_first_crossing(share[int(half) :], 0.75))
    middle = half
    if np.unique(share[first:last].round(3)).size >= _FEWEST_OF_FIT:
        # by a parabola: a slow and noisy command crosses its half more than once, and a drive with lag has a bend
        fit = np.polyfit(share[first:last] - 0.5, np.arange(first, last) - half, 2)
        middle = float(np.clip(half + fit[-1], first, last))
    rows = earliest + np.array([max(0.0, tenth - 0.25 * (half - tenth)), middle])
    start_s, half_s = np.interp(rows, np.arange(time_s.size), time_s)
    return float(start_s), float(half_s)


def _first_crossing(share: Floats, level: float) -> float:
    """How many rows it takes ``share`` to rise to ``level``."""
    above = np.flatnonzero(share >= level)
    return float(above[0]) if above.size else float(share.size)


def _last_crossing(share: Floats, level: float) -> float:
    """The row, with fraction, at which ``share`` last rose through ``level``; 0 where it never was below."""
    below = np.flatnonzero(share < level)
    if not below.size:
        return 0.0
    row = int(below[-1])
    if row + 1 >= share.size:
        return float(row)
    return row + float((level - share[row]) / (share[row + 1] - share[row]))


def shafts_were_changed(motion: motions.Motion, execute: float, end: float) -> bool:
    """Whether a shaft turned otherwise after an execute than before, to the end; no question where shafts steer."""
    if motion.steering == motions.BY_DIFFERENCE:
        return False
    for rpm in motion.drives.values():
        spans = (execute - APPROACH_S, execute), (execute, end)
        before, after = (
            float(np.median(rpm[(motion.time_s >= first) & (motion.time_s <= last)])) for first, last in spans
        )
        least = max(_KEPT_RPM_SHARE * max(abs(before), abs(after)), 10.0 * motion.drive_noise_rpm)
        if abs(after - before) > least:
            return True
    return False


def execution_notes(
    motion: motions.Motion, executes: Sequence[Execute], end: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the indices of a run until ``end`` [s] count from where it was not recorded, the moment of the order and
    midship, and whether the shafts kept turning; and what keeps it from showing a criterion: recorded orders that
    contradict the helm."""
    notes, contradicts = list[str](), any(execute.contradicts for execute in executes)
    if shafts_were_changed(motion, executes[0].order_s, end):
        notes.append(SHAFTS_CHANGED)
    if motion.orders_are_events:
        notes.append("orders were recorded as events: each was given before half of the recorded change, which the "
                     "intervals allow for")  # fmt: skip
    elif contradicts:
        notes.append(f"{CONTRADICTION}: each is taken from the helm's movement")
    elif motion.helm_order_deg is None:
        notes.append("orders were not recorded: each is taken from the beginning of the helm's movement")
    if not motion.is_midship:
        covered = (
            "the intervals cover any" if motion.length_m else "without the ship's length the intervals leave it out"
        )
        notes.append(f"the antenna's position on the ship is not known: {covered}")
    return tuple(notes), (CONTRADICTION,) if contradicts else ()
