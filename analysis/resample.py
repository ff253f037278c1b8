"""One row every so many seconds: irregular samples of many channels onto a common grid.

A channel that is faster than the grid is low-pass filtered, or what is above half the output rate would come
back as a slow motion that never happened. The filter is a straight line fitted about each grid point to the
samples within one output step on either side, weighted by a raised cosine (Hann) in time. It has no phase
shift, leaves constants and ramps as they are whatever the spacing of the samples, halves the amplitude at
half the output rate, and leaves less than 3 % above the output rate. A channel that is as fast as the grid or
slower is interpolated linearly. Angles go through both on the circle.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.angles import difference, wrap_180, wrap_360
from acquisition.channels import BY_NAME, CIRCULAR
from acquisition.errors import DataShortageError, InputError
from analysis.frames import NANO, index_of, times_ns

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

_FASTER = 0.6  # of the output step: below this median interval there is something to filter
_GAP_S, _LONGEST_GAP_S, _GAP_INTERVALS = 3.0, 10.0, 2.5


def resample(table: pd.DataFrame, rate_hz: float = 1.0, longest_gap_s: float | None = None) -> pd.DataFrame:
    """The table on whole multiples of 1 / ``rate_hz`` in UTC [Hz], each channel by itself.

    Rows may be unsorted, repeat a time, and hold NaN where a channel has no sample. Between samples that lie
    further apart than ``longest_gap_s`` [s] the result is NaN; without it the limit is 3 s, for a channel
    that is slower 2.5 of its median intervals, and never more than 10 s. Beyond a channel's first and last
    sample it is NaN too. Raises :class:`DataShortageError` for a table without samples.
    """
    rate = _checked_rate(rate_hz)
    time_ns = times_ns(table)
    present = {str(name): table[name].to_numpy(dtype=float) for name in table.columns}
    sampled = np.zeros(time_ns.size, dtype=bool)
    for values in present.values():
        sampled |= np.isfinite(values)
    if not sampled.any():
        raise DataShortageError("the table holds no sample to resample", fix="give a table with values")
    grid_ns = _grid(int(time_ns[sampled].min()), int(time_ns[sampled].max()), rate)
    columns = {
        name: _resampled(name, time_ns, values, grid_ns, rate, longest_gap_s) for name, values in present.items()
    }
    result = pd.DataFrame(columns, index=index_of(grid_ns))
    result.attrs = {**table.attrs, "rate_hz": float(rate_hz)}
    return result


def _checked_rate(rate_hz: float) -> Fraction:
    if not 0.0 < rate_hz <= 1000.0:
        raise InputError(f"a rate of {rate_hz} Hz is not possible", fix="give more than 0 and at most 1000")
    return Fraction(rate_hz).limit_denominator(1000)


def _grid(first_ns: int, last_ns: int, rate: Fraction) -> Times:
    """All whole multiples of 1 / rate between two times, ends included [ns]; exact for thirds of seconds too."""
    step = Fraction(NANO) / rate
    steps = np.arange(-(-first_ns // step), last_ns // step + 1, dtype=np.int64) * rate.denominator
    whole, rest = np.divmod(steps, rate.numerator)
    return np.asarray(whole * NANO + rest * NANO // rate.numerator, dtype=np.int64)


def _resampled(
    name: str, time_ns: Times, values: Floats, grid_ns: Times, rate: Fraction, longest_gap_s: float | None
) -> Floats:
    """One channel on the grid; NaN where it has nothing to say."""
    valid = np.isfinite(values)
    circular = name in CIRCULAR
    times, samples = _sorted_without_repeats(time_ns[valid], values[valid], circular)
    result = np.full(grid_ns.size, np.nan)
    if times.size == 0 or grid_ns.size == 0:
        return result
    interval_ns = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    limit_ns = (longest_gap_s if longest_gap_s is not None else _own_gap_s(interval_ns)) * NANO
    covered, before, share = _bracket(times, grid_ns, limit_ns)
    result[covered] = _interpolated(samples, before[covered], share[covered], circular)
    if 0 < interval_ns < _FASTER * NANO / rate:
        smooth = _local_line(times, samples, grid_ns, float(NANO / rate), circular)
        replaced = covered & np.isfinite(smooth)
        result[replaced] = smooth[replaced]
    return _in_turn(name, result)


def _own_gap_s(interval_ns: float) -> float:
    return min(max(_GAP_S, _GAP_INTERVALS * interval_ns / NANO), _LONGEST_GAP_S)


def _sorted_without_repeats(time_ns: Times, values: Floats, circular: bool) -> tuple[Times, Floats]:
    """Samples in the order of time; those that share a time become their mean."""
    order = np.argsort(time_ns, kind="stable")
    times, samples = time_ns[order], values[order]
    unique, first, inverse = np.unique(times, return_index=True, return_inverse=True)
    if unique.size == times.size:
        return times, samples
    base = samples[first]
    apart = samples - base[inverse]
    if circular:
        apart = difference(samples, base[inverse])
    mean = np.bincount(inverse, apart) / np.bincount(inverse)
    return unique, np.asarray(base + mean, dtype=float)


def _bracket(times: Times, grid_ns: Times, limit_ns: float) -> tuple[NDArray[np.bool_], NDArray[np.int64], Floats]:
    """For each grid point: is it between two samples close enough, which is the one before, how far past it.

    A grid point on a sample is covered whatever is missing beside it.
    """
    before = np.searchsorted(times, grid_ns, side="right") - 1
    inside = before >= 0
    before = np.maximum(before, 0)
    after = np.minimum(before + 1, times.size - 1)
    passed = (grid_ns - times[before]).astype(float)
    span = (times[after] - times[before]).astype(float)
    share = np.divide(passed, span, out=np.zeros_like(passed), where=span > 0)
    on_sample = passed == 0
    return inside & (on_sample | ((after > before) & (span <= limit_ns))), before, share


def _interpolated(samples: Floats, before: NDArray[np.int64], share: Floats, circular: bool) -> Floats:
    start, end = samples[before], samples[np.minimum(before + 1, samples.size - 1)]
    step = difference(end, start) if circular else end - start
    return np.where(share == 0, start, start + share * step)


def _local_line(times: Times, samples: Floats, grid_ns: Times, step_ns: float, circular: bool) -> Floats:
    """The filter of the module's text: a weighted line about each grid point, NaN where too little is near.

    A sample lies within one step of just two grid points, so that every sum over the neighbours of all grid
    points is one weighted count. Fewer than two samples on either side of a point are too little.
    """
    count = grid_ns.size
    left = np.searchsorted(grid_ns, times, side="right") - 1  # -1: before the first grid point
    point = np.concatenate([left, left + 1])
    used = (point >= 0) & (point < count)
    point = point[used]
    value = np.concatenate([samples, samples])[used]
    apart = (np.concatenate([times, times])[used] - grid_ns[point]) / step_ns
    weight = np.where(np.abs(apart) < 1.0, 0.5 + 0.5 * np.cos(np.pi * apart), 0.0)

    def total(of: Floats) -> Floats:
        return np.asarray(np.bincount(point, weight * of, minlength=count), dtype=float)

    centre = np.zeros(count)
    if circular:
        angle = np.deg2rad(value)
        centre = np.rad2deg(np.arctan2(total(np.sin(angle)), total(np.cos(angle))))
        value = difference(value, centre[point])
    else:
        near = np.minimum(np.searchsorted(times, grid_ns), times.size - 1)
        centre = samples[near]  # sums of differences keep the digits that sums of large values lose
        value = value - centre[point]
    s0, s1, s2 = total(np.ones_like(apart)), total(apart), total(apart**2)
    y0, y1 = total(value), total(apart * value)
    determinant = s0 * s2 - s1**2
    inner = weight > 0
    enough = np.bincount(point, inner & (apart <= 0), count) >= 2
    enough &= np.bincount(point, inner & (apart >= 0), count) >= 2
    usable = enough & (determinant > 1e-9 * s0**2)
    line = np.divide(s2 * y0 - s1 * y1, determinant, out=np.full(count, np.nan), where=usable)
    return np.asarray(centre + line)


def _in_turn(name: str, values: Floats) -> Floats:
    """Angles in the turn that their channel's range gives."""
    if name not in CIRCULAR:
        return values
    return wrap_180(values) if BY_NAME[name].low < 0 else wrap_360(values)
