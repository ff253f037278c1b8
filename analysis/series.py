"""The samples of one channel: their runs, noise, steps and resolution, smoothing, and stuck sensors.

Checks of one channel work on its samples in the order of receipt
(:class:`seatrial.acquisition.core.quantities.Series`), checks across channels on its samples in the rows of the
joined table (:class:`Samples`).

A long repeat alone does not prove that a sensor is stuck: a thruster at rest, a held order, an assumed constant and
a still ship on a coarse sensor repeat for minutes. Three things prove it: the channel's own noise, present right
before and after, is gone; a speed stays by far the longest of the record and leaves by a jump; or related channels
show motion that this one would have had to follow.

Every digital sensor has a grid. It does harm where its step exceeds both the noise (which otherwise carries the
mean between two steps) and what buses commonly carry. Values need not lie on exact multiples: a grid that has been
projected or drifts by less than a hundredth of its step shows in the differences of consecutive values.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import AnyArray, Bools, Floats, Ints, Series, to_earth
from seatrial.analysis.tables.table import NANO, TimedValues, seconds_of, times_ns

ASSUMED = "assumed"
"""The source of a channel that a column map gave a value to."""
HALF_WIDTH_S, USUAL_LENGTH_M = 10.0, 25.0
LEAST_SAMPLES = 5
_SHORTEST_REPEAT, _NEIGHBOURS = 8, 100
_JUMP = 3.0
_CHANCE = 1e-4
_REVERSALS = 0.3
_LEAST_TRAVEL = {"m": 1.0, "deg": 1.0}
EVERYDAY_RESOLUTIONS = {"m": 0.02, "deg": 0.1, "m/s": 0.01, "deg/s": 0.02, "rpm": 1.0, "%": 1.0}
"""The coarsest resolution by unit that is normal in NMEA 2000, NMEA 0183 and MAVLink."""
_COARSER = {("command", "deg"): 1.0, ("environment", "deg"): 1.0, ("environment", "m/s"): 0.1}
_DEGREES_OF_POSITION = 2e-7
_FEWEST, _CONCENTRATED, _LARGEST_MULTIPLE = 30, 0.8, 8.5
_MOST_VALUES, _EXACT, _NOISES = 200_000, 0.95, 0.7
_FEWEST_RENEWED, _LEAST_REPEATED, _CLEAR_STEPS = 20, 1.5, 5.0
_ON_STEP, _OUT_OF_STEP, _MOST_RENEWED = 0.02, 0.34, 0.9
"""Shares of the step, of the period (two of 2, two to four of 3), and of the new values."""


@dataclass(frozen=True, slots=True, order=True)
class Stretch:
    """A part of a channel's time in which something is wrong, and its size (seconds, or what the check defines)."""

    start_ns: int
    end_ns: int
    size: float = 0.0

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / NANO


def series_from_values(measured_ns: Ints, value: Floats) -> Series:
    """Samples in the order of receipt of which nothing but times [ns] and values is known."""
    none = np.zeros(value.size, dtype=np.int32)
    return Series(measured_ns, measured_ns, value, none.astype(np.uint8), (), none)


def rows_of_samples(table_ns: Ints, measured_ns: Ints) -> Ints:
    """The row of each sample in a sorted table that holds a repeated time in as many rows."""
    order = np.argsort(measured_ns, kind="stable")
    times = measured_ns[order]
    rows = np.empty(times.size, dtype=np.int64)
    rows[order] = np.searchsorted(table_ns, times) + np.arange(times.size) - np.searchsorted(times, times)
    return np.minimum(rows, table_ns.size - 1)


def check_group(channel: ship.Channel) -> tuple[str, str]:
    """Group and unit that a channel is judged by, recorded as an auxiliary one or not: a rudder and an order are
    commands, the wind on board is wind."""
    if ship.is_held_setting(channel):
        return "command", channel.unit
    return ("environment" if channel.name.startswith("apparent_wind_") else channel.group), channel.unit


def is_assumed(table: pd.DataFrame, name: str) -> bool:
    """Whether a channel's values were assumed at an import and not measured."""
    return bool(table.attrs.get("sources", {}).get(name) == [ASSUMED])


def sort_by_time(samples: Series, channel: ship.Channel) -> tuple[Ints, Ints, Floats]:
    """Which samples have a value, in the order of measured time: their places, times [ns], values.

    Angles come unwrapped, so that differences are turns.
    """
    order = np.argsort(samples.measured_ns, kind="stable")
    order = order[np.isfinite(samples.value[order])]
    values = samples.value[order]
    return order, samples.measured_ns[order], ship.unwrap(values) if channel.circular else values


def median_interval_ns(times_ns: Ints) -> float:
    """The channel's own interval [ns]: the median of its steps in time, without those of no length."""
    steps = np.diff(np.sort(times_ns))
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 0.0


def white_noise_standard_deviation(values: Floats) -> float:
    """Standard deviation of what differs from sample to sample, whatever the slow motion is.

    From third differences (weights 1, -3, 3, -1; their squares sum to 20) by the median of their size, so that
    outliers and short manoeuvres do not count.
    """
    if values.size < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 3))) / 0.6745 / np.sqrt(20.0))


def flagged_stretches(times: Ints, flagged: Bools) -> list[Stretch]:
    """Runs of flagged samples, measured at ``times`` [ns], as stretches, sized by their number of samples."""
    starts, ends = edges_of_runs(flagged)
    pairs = ((sorted((int(times[a]), int(times[b - 1]))), b - a) for a, b in zip(starts, ends, strict=True))
    return [Stretch(first, last, float(count)) for (first, last), count in pairs]


@dataclass(frozen=True, slots=True)
class Samples:
    """The values that one channel has: their ``rows`` in the table, times [s] and values, all of shape [n]."""

    rows: Ints
    time_s: Floats
    value: Floats


def finite_samples(table: pd.DataFrame, name: str) -> Samples:
    """The finite values of a channel at distinct times; of a repeated time the first. Empty if it is lacking."""
    if name not in table:
        return Samples(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    value = table[name].to_numpy(dtype=float)
    time_ns = times_ns(table)
    rows = np.flatnonzero(np.isfinite(value))
    rows = rows[np.concatenate([[True], np.diff(time_ns[rows]) > 0])] if rows.size else rows
    return Samples(rows, seconds_of(table)[rows], value[rows])


def edges_of_runs(mask: Bools) -> tuple[Ints, Ints]:
    """First and one past the last index of every stretch of ``True``.

    >>> [ends.tolist() for ends in edges_of_runs(np.array([True, False, True, True]))]
    [[0, 2], [1, 4]]
    """
    edges = np.diff(np.concatenate([[0], np.asarray(mask, np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def mask_of_runs(first: Ints, stop: Ints, count: int) -> Bools:
    """Whether each of ``count`` samples lies in one of the stretches: the inverse of :func:`edges_of_runs`."""
    edges = np.zeros(count + 1, np.int64)
    np.add.at(edges, first, 1)
    np.add.at(edges, stop, -1)
    return np.cumsum(edges[:-1]) > 0


def robust_spread(values: Floats) -> float:
    """A standard deviation that outliers do not affect: 1.4826 median |x|."""
    return float(1.4826 * np.median(np.abs(values))) if values.size else 0.0


def runs_of_equal(changes: Bools) -> tuple[Ints, Ints]:
    """First samples and lengths of the runs of one value; ``changes`` [n - 1] says where the next sample differs.

    >>> [part.tolist() for part in runs_of_equal(np.array([False, True, False]))]
    [[0, 2], [2, 2]]
    """
    starts = np.concatenate([[0], np.flatnonzero(changes) + 1])
    return starts, np.diff(np.append(starts, changes.size + 1))


def find_repeats(samples: Samples, is_command: bool = False) -> tuple[Ints, float]:
    """The rows of samples that repeat the value of a slower source, and the time between its own values [s].

    A quantity that changes by many of its steps from one new value to the next has moved between them, and the
    equal samples there were not measured. The new values come in step: those of a coarse channel come as it moves.
    A command may be held, and a feedback has noise then: its new values come in step nearly all the time.
    """
    value, nothing = samples.value, (np.zeros(0, np.int64), 0.0)
    places = np.flatnonzero(np.diff(value)) + 1
    if places.size < _FEWEST_RENEWED or value.size < _LEAST_REPEATED * places.size:
        return nothing
    sizes = np.abs(np.diff(value))[places - 1]
    step = float(np.quantile(sizes, 0.02, method="lower"))
    is_coarse = np.mean(np.abs(sizes / step - np.rint(sizes / step)) < _ON_STEP) > _CONCENTRATED
    is_clear = sizes > _CLEAR_STEPS * step * is_coarse
    intervals = np.diff(places)[is_clear[1:] & is_clear[:-1]]
    period = int(np.median(intervals)) if intervals.size >= _FEWEST_RENEWED else 0
    if period < 2 or np.mean(np.abs(intervals - period) <= _OUT_OF_STEP * period) < _MOST_RENEWED:
        return nothing
    lasts = np.diff(places)
    if is_command and lasts[np.abs(lasts - period) <= _OUT_OF_STEP * period].sum() < _MOST_RENEWED * value.size:
        return nothing
    since = np.arange(value.size)
    since -= np.maximum.accumulate(np.where(np.isin(since, places), since, 0))
    return samples.rows[since % period != 0], period * float(np.median(np.diff(samples.time_s)))


def without_repeats(table: pd.DataFrame, names: Iterable[str]) -> pd.DataFrame:
    """A table with gaps in some channels where they repeat the values of slower sources (:func:`find_repeats`)."""
    columns = {}
    for name in filter(table.__contains__, names):
        rows, _ = find_repeats(finite_samples(table, name), is_command=name not in ship.POSE_AND_VELOCITY)
        if rows.size:
            columns[name] = table[name].to_numpy(dtype=float, copy=True)
            columns[name][rows] = np.nan
    return table.assign(**columns) if columns else table


def jackknife_error(estimates: Floats) -> Floats:
    """Standard errors [...] from estimates [n, ...] of which each leaves out one of n parts.

    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982.
    """
    count = len(estimates)
    return np.asarray(np.sqrt((count - 1) / count * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0)))


def leave_one_out_ratios(numerators: AnyArray, denominators: AnyArray) -> AnyArray:
    """The ratio of the sums of n parts, each part left out in turn: [n], as a jackknife wants it."""
    remaining = np.maximum(denominators.sum() - denominators, 1e-12)
    return np.asarray((numerators.sum() - numerators) / remaining)


def smoothing_half_width(length_m: float) -> float:
    """The half-width of the fits for a ship of this length [s]: :data:`HALF_WIDTH_S`, scaled with the root of
    the length below :data:`USUAL_LENGTH_M`, since a model moves that much faster (Froude)."""
    return HALF_WIDTH_S * min(1.0, float(np.sqrt(length_m / USUAL_LENGTH_M)))


def smooth_motion(table: pd.DataFrame, half_width_s: float = HALF_WIDTH_S) -> pd.DataFrame:
    """Smooth the motion channels of a table with evenly spaced rows; NaN stays NaN.

    Each is replaced by a local second-degree polynomial fitted to the samples within the half-width on either side,
    weighted with a raised cosine (Savitzky and Golay 1964, with weights; Cleveland 1979): slow motion and its
    curvature are reproduced exactly, waves of 4 to 8 s, which are no basis for a prediction over half a minute, are
    attenuated by a factor of ten and more.

    Near gaps and ends the fit is one-sided; with fewer than five samples nearby, values are unchanged.
    """
    times_ns = pd.DatetimeIndex(table.index).as_unit("ns").asi8
    step_s = float(np.median(np.diff(times_ns))) / 1e9 if len(table) > 1 else 1.0
    columns = {}
    for name in ship.POSE_AND_VELOCITY:
        values = table[name].to_numpy(dtype=float)
        smooth = local_quadratic(ship.unwrap(values) if ship.is_circular(name) else values, half_width_s / step_s)
        columns[name] = ship.wrap_360(smooth) if ship.is_circular(name) else smooth
    return pd.DataFrame(columns, index=table.index)


def local_quadratic(values: Floats, half_width: float) -> Floats:
    """A weighted second-degree fit around each sample [rows], evaluated there; ``half_width`` in samples.

    The normal equations of all fits are nine convolutions; each is then a 3 by 3 system.
    """
    reach = int(np.ceil(half_width))
    offset = np.arange(-reach, reach + 1) / max(half_width, 1.0)
    weight = 0.5 + 0.5 * np.cos(np.pi * np.clip(offset, -1.0, 1.0))
    present = np.isfinite(values)
    if not present.any() or reach < 1:
        return values.copy()
    centre = float(values[present].mean())
    filled = np.where(present, values - centre, 0.0)
    moments = [_weighted_sum(present.astype(float), weight * offset**k) for k in range(5)]
    products = [_weighted_sum(filled, weight * offset**k) for k in range(3)]
    samples_in_reach = _weighted_sum(present.astype(float), (weight > 0).astype(float))
    normal = np.stack([np.stack([moments[i + j] for j in range(3)], axis=-1) for i in range(3)], axis=-2)
    right = np.stack(products, axis=-1)[..., None]
    fitted = values.copy()
    enough = present & (samples_in_reach >= LEAST_SAMPLES)
    fitted[enough] = np.linalg.solve(normal[enough], right[enough])[:, 0, 0] + centre
    return fitted


def _weighted_sum(values: Floats, kernel: Floats) -> Floats:
    """The sum of ``values`` around each sample, weighted with a kernel of odd length."""
    reach = kernel.size // 2
    return np.asarray(np.convolve(values, kernel[::-1])[reach : reach + values.size])


def find_stuck(samples: Series, channel: ship.Channel, rate: TimedValues | None = None) -> Bools:
    """Where the value is stuck, from the second of the repeated values on.

    ``rate`` is how fast this one changes by related channels [its unit per s], at times of its own: yaw
    rate for the heading, speed over ground for a position.
    """
    places, times, values = sort_by_time(samples, channel)
    bad, steps = np.zeros(samples.value.size, dtype=bool), np.diff(values)
    if values.size < 2 * _SHORTEST_REPEAT:
        return bad
    all_starts, all_lengths = runs_of_equal(steps != 0.0)
    starts, lengths = (part[all_lengths >= _SHORTEST_REPEAT] for part in (all_starts, all_lengths))
    # On a grid wider than its noise a channel stands on it for a long time now and then.
    coarse = lengths.size > 1 and (step := rounding_step(values)) > noise_without_rounding(values, step)
    repeats = np.count_nonzero(steps == 0.0) - int(np.sum(lengths - 1))  # but for the long runs
    group = check_group(channel)[0]
    always_moves = group != "command" and bool(repeats < 0.01 * values.size)
    # A stopped thruster, a ship alongside, calm air and an engine that does nothing are silent by themselves.
    rests_at_zero = channel.unit in ("rpm", "m/s", "deg/s") or channel.group in ("environment", "declared")
    frozen = None
    if group == "velocity" and values.size >= _FEWEST:
        # Speeds that a sensor has smoothed have no noise that could be gone: they change little by little, and stay
        # for some samples now and then, or long on a steady course; but then they leave little by little, too. One
        # is frozen that stays five times as long as ever else and leaves by a step far beyond those of the record.
        place = int(np.argmax(all_lengths))
        end, longest_other = all_starts[place] + all_lengths[place], np.delete(all_lengths, place).max(initial=0)
        if end < values.size and all_lengths[place] >= max(_FEWEST, 5 * longest_other):
            sizes = np.abs(steps)
            frozen = all_starts[place] if sizes[end - 1] > _JUMP * np.quantile(sizes[sizes > 0.0], 0.95) else None
    for start, length in zip(starts, lengths, strict=True):
        inside = slice(start, start + length)
        usual = not coarse or length >= 5 * np.sort(lengths)[-2]
        at_rest = rests_at_zero and values[start] == 0.0
        before = values[max(start - _NEIGHBOURS, 0) : start]
        after = values[start + length : start + length + _NEIGHBOURS]
        sides = [side for side in (before, after) if side.size >= _SHORTEST_REPEAT]
        moves = always_moves and len(sides) == 2  # a simulated ship may start without moving
        noisy = bool(sides) and all(_is_noisy(side, length, values.size, moves) for side in sides)
        silent = usual and not at_rest and (start == frozen or noisy)
        if silent or _should_have_moved(times[inside], values, channel, rate):
            bad[places[start + 1 : start + length]] = True
    return bad


def _is_noisy(side: Floats, length: int, total: int, always_moves: bool) -> bool:
    """Whether the samples on one side of a run are noisy, and too lively for the run to be chance.

    Noisy: a third of the changes turn back at once, two thirds being white noise; a motion that never repeats
    a value need not be noisy, as it cannot be constant either, but an order can. Chance: the share of repeats
    to the power of the run's length, times the samples of the record; and the run is five times as long as the
    longest in its neighbourhood.
    """
    steps = np.diff(side)
    moved = steps[steps != 0.0]
    if moved.size < _SHORTEST_REPEAT // 2 or (
        not always_moves and np.mean(moved[1:] * moved[:-1] < 0.0) < _REVERSALS
    ):
        return False
    repeats = (np.sum(steps == 0.0) + 1.0) / (steps.size + 2.0)
    if repeats > 0.5:  # stairs, as a held order goes up and down, are no noise
        return False
    return bool(total * repeats**length < _CHANCE and length >= 5 * runs_of_equal(steps != 0.0)[1].max())


def _should_have_moved(times: Ints, values: Floats, channel: ship.Channel, rate: TimedValues | None) -> bool:
    """Whether the rate adds up to more than five of the channel's usual steps, and 1 m or 1 deg, in the run."""
    if rate is None or channel.unit not in _LEAST_TRAVEL:
        return False
    rate_ns, rates = rate
    first, last = np.searchsorted(rate_ns, times[[0, -1]])
    if last - first < 2:
        return False
    travel = abs(float(np.trapezoid(rates[first:last], rate_ns[first:last] / NANO)))
    steps = np.abs(np.diff(values))
    usual = float(np.quantile(steps[steps > 0.0], 0.1)) if np.any(steps > 0.0) else np.inf
    return travel > max(5.0 * usual, _LEAST_TRAVEL[channel.unit])


def expected_rates(table: pd.DataFrame) -> dict[str, TimedValues]:
    """How fast the pose should change by the speeds, the yaw rate and the heading: north, east, heading.

    Channels need not share rows: the last heading stands where the speeds have none. What lacks a channel is
    left out.
    """
    rates: dict[str, TimedValues] = {}
    if "yaw_rate_dps" in table:
        yaw_rate = table[["yaw_rate_dps"]].dropna()
        rates["heading_deg"] = times_ns(yaw_rate), yaw_rate["yaw_rate_dps"].to_numpy(dtype=float)
    if {"surge_mps", "sway_mps", "heading_deg"} <= set(table.columns):
        moving = table[["surge_mps", "sway_mps", "heading_deg"]].ffill().dropna()
        surge, sway, heading = (moving[name].to_numpy() for name in moving)
        path = to_earth(surge, sway, np.deg2rad(heading))
        rates |= {name: (times_ns(moving), rate) for name, rate in zip(("north_m", "east_m"), path, strict=True)}
    return {name: rate for name, rate in rates.items() if rate[0].size}


def everyday_resolution(channel: ship.Channel) -> float:
    """The coarsest step [the channel's unit] that instruments of this kind commonly report; it is unknown for a
    channel that a user declares."""
    if channel.group == "declared":
        return np.inf
    if channel.name in ("latitude_deg", "longitude_deg"):
        return _DEGREES_OF_POSITION
    return _COARSER.get(check_group(channel), EVERYDAY_RESOLUTIONS[channel.unit])


def rounding_step(values: Floats) -> float:
    """The step of the grid that values move on, 0 where there is none.

    It is looked for in the changes from value to value, where a grid that drifts still shows, in the distances
    between values sorted by size, and in those between the changes, where it shows even at a constant speed.
    """
    values = values[np.isfinite(values)]
    if values.size > _MOST_VALUES:
        values = np.concatenate([part[: _MOST_VALUES // 8] for part in np.array_split(values, 8)])
    steps = np.diff(values)
    noise = float(np.sqrt(np.mean(np.diff(steps, 2) ** 2) / 20.0)) if steps.size > 2 else 0.0
    distances = np.diff(np.sort(values))
    for search, changes in ((_find_step, np.abs(steps)), (_find_step, distances), (_exact_step, np.abs(steps))):
        step = search(changes, noise)
        if step:  # changes stop or turn at once, or differ in size: a ramp without noise does neither
            multiples = np.rint(steps / step)
            changed = np.flatnonzero(multiples[:-1])
            sizes, counts = np.unique(np.abs(multiples[changed]), return_counts=True)
            several = sizes.size > 0 and counts.max() < 0.9 * changed.size
            if several or np.mean(multiples[changed + 1] * np.sign(multiples[changed]) <= 0.0) > 0.2:
                return step
    return 0.0


def _find_step(changes: Floats, noise: float) -> float:
    """The step on whose multiples the changes lie. Those below a hundredth of the typical one count as none.

    Candidates are the smaller changes and their fractions, made exact by the changes near their multiples; the
    largest wins on whose multiples the changes concentrate, by the mean of cos(2 pi change / step), which is 1 on a
    grid and near 0 without, and are far closer than the noise would let them: a ship at constant speed is not.
    """
    changes = changes[changes > 0.0]
    if changes.size < _FEWEST:
        return 0.0
    typical = np.median(changes[changes >= np.quantile(changes, 0.5)])
    changes = changes[changes > 0.01 * typical]
    if changes.size < _FEWEST:
        return 0.0
    smaller = np.quantile(changes, [0.0, 0.01, 0.05, 0.1, 0.25, 0.5], method="lower")
    candidates = np.unique(np.concatenate([smaller / divisor for divisor in (1, 2, 3, 4)]))[::-1]
    for step in map(float, candidates):
        for reach in (2.5, _LARGEST_MULTIPLE):
            small = changes[changes < reach * step]
            multiples = np.rint(small / step)
            close = (np.abs(small / step - multiples) < 0.2) & (multiples > 0)
            if not close.any():
                break
            step = float(np.median(small[close] / multiples[close]))
        else:
            small = changes[changes < _LARGEST_MULTIPLE * step]
            enough = small.size >= max(_FEWEST, 0.02 * changes.size)
            if enough and _lie_on_multiples(small, step, _CONCENTRATED, noise):
                return step
    return 0.0


def _lie_on_multiples(changes: Floats, step: float, least: float, noise: float) -> bool:
    """Whether changes concentrate on a step's multiples by at least so much, far closer than the noise."""
    concentration = float(np.mean(np.cos(2.0 * np.pi * changes / step)))
    deviation = float(np.quantile(np.abs(changes - step * np.rint(changes / step)), 0.8))
    return concentration > least and deviation < 0.1 * noise


def _exact_step(changes: Floats, noise: float) -> float:
    """The step of an exact grid from the least distance between two changes, if all are multiples of it."""
    distances = np.diff(np.sort(changes))
    distances = distances[distances > 1e-6 * changes.max(initial=0.0)]
    if np.count_nonzero(changes) < _FEWEST or not distances.size:  # an order or two are no grid
        return 0.0
    step = float(np.median(distances[distances < 1.5 * distances.min()]))
    return step if _lie_on_multiples(changes, step, _EXACT, noise) else 0.0


def noise_without_rounding(values: Floats, step: float) -> float:
    """Standard deviation of the noise that is there besides the rounding to a grid of this step."""
    return float(np.sqrt(max(white_noise_standard_deviation(values) ** 2 - step**2 / 12.0, 0.0)))


def quantisation_step(samples: Series, channel: ship.Channel) -> float:
    """The step [the channel's unit] of a grid that lost information, 0 where there is none.

    A grid is found where its step exceeds the everyday resolution, and is no smaller than the noise (0.7 of its
    standard deviation, which waves raise at slow rates) or makes every fifth value repeat the last.
    """
    _, _, values = sort_by_time(samples, channel)
    steps = np.diff(values)
    step = rounding_step(values)
    if step <= 1.05 * everyday_resolution(channel):
        return 0.0
    repeats = float(np.mean(np.abs(steps) < 0.1 * step))
    return step if step > _NOISES * noise_without_rounding(values, step) or repeats > 0.2 else 0.0
