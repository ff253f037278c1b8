"""One row every so many seconds: irregular samples of many channels onto a common grid.

A channel that is faster than the grid is low-pass filtered, or what is above half the output rate would come
back as a slow motion that never happened. The filter is a polynomial fitted about each grid point to the samples
near it, weighted by a power of a raised cosine in time (Savitzky and Golay 1964, with weights; Cleveland 1979).
It has no phase shift, leaves constants and ramps as they are whatever the spacing of the samples, and leaves
less than 3 % of anything above half the output rate. Motion and wind get a parabola over three output steps on
either side: at a tenth of the output rate 1 % is lost, at a fifth 11 %. A setting is a staircase, and a parabola
would overshoot at its steps: it gets a straight line over two output steps, which stays between the values that
were set. No result leaves the range of its channel unless samples do: a wind speed is never negative. A channel
that is as fast as the grid or slower is interpolated linearly. Angles go through all of it on the circle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables import table as tables

_FASTER = 0.95  # of the output step: below this median interval there is something to filter
_GAP_S, _LONGEST_GAP_S, _GAP_INTERVALS = 3.0, 10.0, 2.5
_LEAST_SPREAD = 1e-6  # of a fit's normal equations, scaled: below it its samples lie too close together


@dataclass(frozen=True, slots=True)
class Filter:
    """A local polynomial of some degree over ``reach`` output steps to either side.

    The weight is a raised cosine to the power of ``taper``. Of samples further than ``ahead`` steps ahead, where
    that is given, nothing is known.
    """

    degree: int
    reach: int
    taper: float
    ahead: int | None = None


MOTION_FILTER = Filter(degree=2, reach=3, taper=1.5)
SETTING_FILTER = Filter(degree=1, reach=2, taper=1.0)
"""Channels that crews and controllers set: they move in steps."""


def resample(
    table: pd.DataFrame,
    rate_hz: float = 1.0,
    longest_gap_s: float | None = None,
    delays: Mapping[str, float] | None = None,
    lookahead_steps: int | None = None,
) -> pd.DataFrame:
    """The table on whole multiples of 1 / ``rate_hz`` in UTC, each channel by itself.

    Parameters
    ----------
    table
        Raw samples with a UTC index. Rows may be unsorted, repeat a time, and hold NaN where a channel has no
        sample.
    rate_hz
        Rows per second [Hz].
    longest_gap_s
        Between samples that lie further apart the result is NaN [s]; by default 3 s, for a channel that is slower
        2.5 of its median intervals, and never more than 10 s.
    delays
        By channel, subtracted from the times first [s]; positive means stamped that much too late.
    lookahead_steps
        Each row is as it was known so many rows later: no sample further ahead is filtered in, as on board, where
        there is none yet.

    Returns
    -------
    pandas.DataFrame
        The same channels, NaN beyond the first and last sample of each; the history in ``attrs`` gains a step for
        the rate and one for the delays. Angles are interpolated on the circle.

    Raises
    ------
    DataShortageError
        For a table without samples.
    InputError
        For an impossible rate or delay.

    Examples
    --------
    >>> import pandas as pd, seatrial as st
    >>> index = pd.date_range("2026-05-17", periods=2, freq="2s", tz="UTC", name="time", unit="ns")
    >>> table = pd.DataFrame({"heading_deg": [359.0, 1.0]}, index=index)
    >>> st.resample(table, rate_hz=1.0)["heading_deg"].round(6).tolist()
    [359.0, 0.0, 1.0]
    """
    time_ns = tables.times_ns(table)
    names = [str(name) for name in table.columns]

    def samples(name: str) -> tables.TimedValues:
        return time_ns, table[name].to_numpy(dtype=float)

    return _on_grid(names, samples, table.attrs, rate_hz, longest_gap_s, delays, lookahead_steps)


def resample_recording(
    recording: Recording,
    rate_hz: float = 1.0,
    longest_gap_s: float | None = None,
    delays: Mapping[str, float] | None = None,
    time_range: tuple[float, float] = (0.0, 100.0),
    lookahead_steps: int | None = None,
) -> pd.DataFrame:
    """As :func:`resample` of a part of the recording's joined table, to the last bit, without joining it.

    A day of 13 channels that never share a time would be a table of more than two gigabytes. Raises as
    :func:`resample`, and as ``table_of`` and ``select`` of :mod:`seatrial.analysis.tables.table`.
    """
    names = tables.channels_of(recording)
    first_ns, last_ns = tables.bounds_ns((recording.series[name].measured_ns for name in names), time_range)

    def samples(name: str) -> tables.TimedValues:
        series = recording.series[name]
        inside = (series.measured_ns >= first_ns) & (series.measured_ns <= last_ns)
        if inside.all():
            return series.measured_ns, tables.valid_values(series)
        return series.measured_ns[inside], tables.valid_values(series)[inside]

    return _on_grid(
        names, samples, tables.attributes_of(recording), rate_hz, longest_gap_s, delays, lookahead_steps
    )


def _on_grid(
    names: list[str],
    samples_of: Callable[[str], tables.TimedValues],
    attributes: Mapping[Any, Any],
    rate_hz: float,
    longest_gap_s: float | None,
    delays: Mapping[str, float] | None,
    lookahead_steps: int | None,
) -> pd.DataFrame:
    """Every channel on the grid that spans all of them; one channel's samples are held at a time."""
    exact_rate_hz = rate_fraction(rate_hz)
    channels = ship.channels_by_name_of(attributes)
    delay_ns = tables.delays_in_ns(delays or {}, channels)

    def valid(name: str) -> tables.TimedValues:
        time_ns, values = samples_of(name)
        is_finite = np.isfinite(values)
        return time_ns[is_finite] - delay_ns.get(name, 0), values[is_finite]

    ends = [(int(times.min()), int(times.max())) for times, _ in map(valid, names) if times.size]
    if not ends:
        raise errors.DataShortageError("the table has no samples", fix="give a table with values")
    first_ns, last_ns = min(first for first, _ in ends), max(last for _, last in ends)
    tables.require_plausible_span(
        first_ns, last_ns, (valid(name)[0] for name in names), str(attributes.get("recording", ""))
    )
    grid_ns = grid(first_ns, last_ns, exact_rate_hz)
    columns = {
        name: _resample_channel(
            ship.find_channel(name, channels), *valid(name), grid_ns, exact_rate_hz, longest_gap_s, lookahead_steps
        )
        for name in names
    }
    result = pd.DataFrame(columns, index=tables.index_of(grid_ns))
    result.attrs = {**attributes, "rate_hz": float(rate_hz)}
    if delays:
        result = tables.add_step(
            result, "remove_delays", delays_s={name: float(delay_s) for name, delay_s in delays.items()}
        )
    return tables.add_step(result, "resample", rate_hz=float(rate_hz), longest_gap_s=longest_gap_s)


def rate_fraction(rate_hz: float) -> Fraction:
    """A rate [Hz] as a ratio. Raises :class:`InputError` for one that is not possible."""
    if not 0.0 < rate_hz <= 1000.0:
        raise errors.InputError(f"a rate of {rate_hz} Hz is not possible", fix="give more than 0 and at most 1000")
    return Fraction(rate_hz).limit_denominator(1000)


def grid(first_ns: int, last_ns: int, rate_hz: Fraction) -> Ints:
    """All whole multiples of 1 / ``rate_hz`` between two times, ends included [ns]; thirds of seconds are exact."""
    step = Fraction(tables.NANO) / rate_hz
    steps = np.arange(-(-first_ns // step), last_ns // step + 1, dtype=np.int64) * rate_hz.denominator
    seconds, remainder = np.divmod(steps, rate_hz.numerator)
    return np.asarray(seconds * tables.NANO + remainder * tables.NANO // rate_hz.numerator, dtype=np.int64)


def _resample_channel(
    channel: ship.Channel | None,
    time_ns: Ints,
    values: Floats,
    grid_ns: Ints,
    rate_hz: Fraction,
    longest_gap_s: float | None,
    lookahead_steps: int | None,
) -> Floats:
    """One channel's valid samples on the grid; NaN where there are none nearby.

    A state holds the last one reported, as long as the channel's gaps allow.
    """
    circular = channel is not None and channel.circular
    if channel is not None and channel.state:
        result, order = np.full(grid_ns.size, np.nan), np.argsort(time_ns, kind="stable")
        if time_ns.size:
            times = time_ns[order]
            newest = np.searchsorted(times, grid_ns, side="right") - 1
            age_ns = grid_ns - times[np.maximum(newest, 0)]
            is_held = (newest >= 0) & (age_ns <= _longest_gap_ns(times, longest_gap_s))
            result[is_held] = values[order][newest[is_held]]
        return result
    times, samples = _sorted_without_repeats(time_ns, values, circular)
    result = _interpolate_linearly(times, samples, grid_ns, longest_gap_s, circular)
    covered = np.isfinite(result)
    if covered.any() and 0 < _usual_interval_ns(times) < _FASTER * tables.NANO / rate_hz:
        rule = SETTING_FILTER if channel is not None and ship.is_held_setting(channel) else MOTION_FILTER
        if lookahead_steps is not None:
            rule = replace(rule, ahead=lookahead_steps)
        smooth = _local_fit(times, samples, grid_ns, float(tables.NANO / rate_hz), rule, circular)
        replaced = covered & np.isfinite(smooth)
        result[replaced] = smooth[replaced]
        if channel is not None and not circular:  # a parabola overshoots at a step: no wind blows at -0.15 m/s
            result = np.clip(result, min(channel.low, samples.min()), max(channel.high, samples.max()))
    return ship.wrap_to_range(channel, result)


def interpolate(time_ns: Ints, values: Floats, at_ns: Ints) -> Floats:
    """Samples of what is no angle, linearly between two of them, at other times; all times [ns], in any order.

    NaN before the first, after the last and in gaps longer than :func:`resample` bridges; NaN is no sample.
    """
    is_finite = np.isfinite(values)
    return _interpolate_linearly(
        *_sorted_without_repeats(time_ns[is_finite], values[is_finite], False), at_ns, None, False
    )


def _interpolate_linearly(
    times: Ints, samples: Floats, at_ns: Ints, longest_gap_s: float | None, circular: bool
) -> Floats:
    """Samples in the order of time, interpolated; NaN across gaps.

    A time on a sample is covered whatever is missing next to it.
    """
    result = np.full(at_ns.size, np.nan)
    if times.size == 0 or at_ns.size == 0:
        return result
    before = np.searchsorted(times, at_ns, side="right") - 1
    after_first = before >= 0
    before = np.maximum(before, 0)
    after = np.minimum(before + 1, times.size - 1)
    passed = (at_ns - times[before]).astype(float)
    span = (times[after] - times[before]).astype(float)
    fraction = np.divide(passed, span, out=np.zeros_like(passed), where=span > 0)
    bridged = (after > before) & (span <= _longest_gap_ns(times, longest_gap_s))
    covered = after_first & ((passed == 0) | bridged)
    before, fraction = before[covered], fraction[covered]
    start, end = samples[before], samples[after[covered]]
    step = ship.angle_difference(end, start) if circular else end - start
    result[covered] = np.where(fraction == 0, start, start + fraction * step)
    return result


def _usual_interval_ns(times: Ints) -> float:
    return float(np.median(np.diff(times))) if times.size > 1 else 0.0


def _longest_gap_ns(times: Ints, longest_gap_s: float | None) -> float:
    return (bridged_gap_s(_usual_interval_ns(times)) if longest_gap_s is None else longest_gap_s) * tables.NANO


def bridged_gap_s(interval_ns: float) -> float:
    """The longest gap [s] that is bridged in a channel whose samples usually lie so far apart."""
    return min(max(_GAP_S, _GAP_INTERVALS * interval_ns / tables.NANO), _LONGEST_GAP_S)


def _sorted_without_repeats(time_ns: Ints, values: Floats, circular: bool) -> tuple[Ints, Floats]:
    """Samples in the order of time; those that share a time become their mean."""
    order = np.argsort(time_ns, kind="stable")
    times, samples = time_ns[order], values[order]
    unique, first, inverse = np.unique(times, return_index=True, return_inverse=True)
    if unique.size == times.size:
        return times, samples
    base = samples[first]
    deviation = ship.angle_difference(samples, base[inverse]) if circular else samples - base[inverse]
    mean = np.bincount(inverse, deviation) / np.bincount(inverse)
    return unique, np.asarray(base + mean, dtype=float)


def _local_fit(times: Ints, samples: Floats, grid_ns: Ints, step_ns: float, rule: Filter, circular: bool) -> Floats:
    """The filter of the module's docstring: a weighted fit about each grid point; NaN where there are too few
    samples nearby, or where they lie too close together.

    A sample lies within reach of a fixed number of grid points, so that every sum over the neighbours of all grid
    points is that many weighted counts. As many samples as the polynomial has coefficients must lie on either
    side of a point.
    """
    count, size = grid_ns.size, rule.degree + 1
    # A value near those about each grid point keeps the digits that sums of large values lose. On the circle it is
    # their mean direction, from which no way is the long way round.
    if not circular:
        centre = samples[np.minimum(np.searchsorted(times, grid_ns), times.size - 1)]
    else:
        sine, cosine = np.sin(np.deg2rad(samples)), np.cos(np.deg2rad(samples))
        north, east = np.zeros((2, count))
        for point, sample, _, weight in _neighbour_pairs(times, grid_ns, step_ns, rule):
            north += np.bincount(point, weight * cosine[sample], count)
            east += np.bincount(point, weight * sine[sample], count)
        centre = np.rad2deg(np.arctan2(east, north))
    moments, products = np.zeros((2 * rule.degree + 1, count)), np.zeros((size, count))
    on_side = np.zeros((2, count))
    for point, sample, distance, weight in _neighbour_pairs(times, grid_ns, step_ns, rule):
        value = (
            ship.angle_difference(samples[sample], centre[point]) if circular else samples[sample] - centre[point]
        )
        on_side[0] += np.bincount(point, distance <= 0, count)
        on_side[1] += np.bincount(point, distance >= 0, count)
        for power in range(2 * rule.degree + 1):
            moments[power] += np.bincount(point, weight, count)
            if power < size:
                products[power] += np.bincount(point, weight * value, count)
            weight = weight * distance
    usable = (on_side >= size).all(axis=0)
    normal = np.stack([moments[row : row + size] for row in range(size)])[:, :, usable] / moments[0, usable]
    right_side = products[:, usable] / moments[0, usable]
    equations, fitted = np.moveaxis(normal, 2, 0), np.full(count, np.nan)
    solvable = np.linalg.det(equations) > _LEAST_SPREAD
    points, right_sides = np.flatnonzero(usable)[solvable], right_side.T[solvable][..., None]
    fitted[points] = centre[points] + np.linalg.solve(equations[solvable], right_sides)[:, 0, 0]
    return fitted


def _neighbour_pairs(
    times: Ints, grid_ns: Ints, step_ns: float, rule: Filter
) -> Iterator[tuple[Ints, Ints, Floats, Floats]]:
    """All pairs of a grid point and a sample within reach of it: points, samples, distance and weight.

    The distance is in reaches, -1 to 1. Each turn pairs every sample with the grid point that many further on.
    """
    before = np.searchsorted(grid_ns, times, side="right") - 1  # -1: before the first grid point
    ahead = rule.reach if rule.ahead is None else min(rule.ahead, rule.reach)
    for shift in range(max(-ahead, 1 - rule.reach), rule.reach + 1):
        first, last = np.searchsorted(before, (-shift, grid_ns.size - shift))  # points 0 to the last
        point, sample = before[first:last] + shift, np.arange(first, last)
        if shift == -ahead:  # of these only what lies right at the end of what is known
            within_reach = times[sample] - grid_ns[point] <= ahead * step_ns
            point, sample = point[within_reach], sample[within_reach]
        distance = (times[sample] - grid_ns[point]) / (rule.reach * step_ns)
        np.clip(distance, -1.0, 1.0, out=distance)
        yield point, sample, distance, (0.5 + 0.5 * np.cos(np.pi * distance)) ** rule.taper
