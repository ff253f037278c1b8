"""Angles in degrees: wrapping, differences, means and interpolation on the circle.

Every function takes floats or arrays, returns the same shape, and passes NaN through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from seatrial.acquisition.core.arrays import Bools, Floats, Ints
from seatrial.acquisition.core.channel import Channel

_LEAST_STAY = 5
_SEAM_DEG = 170.0  # codes for no value, -1 to -99, are far from the seam of -180..180


def wrap_360(angle_deg: ArrayLike) -> Floats:
    """``angle_deg`` in 0 <= x < 360."""
    turned = np.mod(np.asarray(angle_deg, dtype=float), 360.0)
    return np.where(turned == 360.0, 0.0, turned)  # -1e-20 % 360.0 is 360.0 in floating point


def wrap_180(angle_deg: ArrayLike) -> Floats:
    """``angle_deg`` in -180 < x <= 180."""
    return 180.0 - np.mod(180.0 - np.asarray(angle_deg, dtype=float), 360.0)


def in_turn(channel: Channel | None, values: ArrayLike) -> Floats:
    """Values of a channel wrapped to its range; unchanged if it is no angle or no channel."""
    if channel is None or not channel.circular:
        return np.asarray(values, dtype=float)
    return wrap_180(values) if channel.low < 0 else wrap_360(values)


def is_possible(channel: Channel, values: Floats) -> Bools:
    """As :meth:`seatrial.acquisition.core.channel.Channel.holds`, for many values."""
    beyond_low = values > channel.low if channel.circular and channel.low < 0.0 else values >= channel.low
    below_high = values < channel.high if channel.circular and channel.low >= 0.0 else values <= channel.high
    return np.asarray(beyond_low & below_high)


def are_angles(values: Floats) -> Bools:
    """A mask [n] of the angles [deg] of a series, in whatever turn, that are measurements, not codes for no value.

    Those are whose part of the series, between steps of half a turn and more, has more than two values.
    """
    there = np.flatnonzero(np.isfinite(values))
    steps = np.abs(np.diff(values[there])) >= 180.0
    result = np.zeros(values.size, np.bool_)
    for part in np.split(there, np.flatnonzero(steps) + 1):
        result[part] = np.unique(values[part]).size > 2
    return result


def counted_on(values: Floats, outside: Bools) -> bool:
    """Whether values ``outside`` a turn, in a series of angles [deg], come from an unwrapped angle.

    An unwrapped series stays outside for a while; outliers and codes for no value are isolated.
    """
    entries = int(np.sum(np.diff(outside.astype(np.int8), prepend=0) == 1))
    return bool(are_angles(values)[outside].all()) and int(outside.sum()) >= _LEAST_STAY * max(entries, 1)


def is_other_convention(channel: Channel, values: Floats) -> bool:
    """Whether an angle's impossible values are those of the other convention, 0..360 for -180..180 or back, or are
    counted on beyond the turn.

    They are if all of them lie in that convention's turn and no possible one contradicts it, so that the two
    halves make one turn; three different values at least, or a code for no value would pass, but for headings a
    little beyond -180, where no code is. The closed end of the channel's own turn, like a heading of 360, is always
    the same angle.
    """
    values = values[np.isfinite(values)]
    impossible = ~is_possible(channel, values)
    outside = values[impossible]
    if not channel.circular or not outside.size:
        return False
    closed = -180.0 if channel.low < 0.0 else 360.0
    ours, theirs = ((-180.0, 0.0), (180.0, 360.0)) if channel.low < 0.0 else ((180.0, 360.0), (-180.0, 0.0))
    contradicting = (values > ours[0]) & (values < ours[1])
    in_other_turn = (outside >= theirs[0]) & (outside < theirs[1])
    if (outside == closed).all():
        return True
    whole_turn = bool((in_other_turn | (outside == closed)).all()) and not contradicting.any()
    beyond_south = channel.low >= 0.0 and bool((outside < -_SEAM_DEG).all())
    return (whole_turn and (np.unique(outside).size >= 3 or beyond_south)) or counted_on(values, impossible)


def difference(to_deg: ArrayLike, from_deg: ArrayLike) -> Floats:
    """The shortest rotation from one angle to another, -180 < x <= 180 [deg]."""
    return wrap_180(np.asarray(to_deg, dtype=float) - np.asarray(from_deg, dtype=float))


def unwrap(angle_deg: ArrayLike) -> Floats:
    """A series of angles without jumps of 360 deg; NaN stay NaN and do not break the series."""
    angles = np.array(angle_deg, dtype=float)
    valid = np.isfinite(angles)
    angles[valid] = np.unwrap(angles[valid], period=360.0)
    return angles


def wraps_of(angle_deg: Floats) -> Ints:
    """The rows at which a plotted line would jump across the full circle.

    >>> wraps_of(np.array([350.0, 359.0, 1.0, np.nan, 359.0]))
    array([2])
    """
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(np.abs(np.diff(angle_deg)) > 180.0) + 1


def circular_mean(angle_deg: ArrayLike, axis: int | None = None) -> Floats:
    """The direction of the mean unit vector, -180 < x <= 180 [deg], ignoring NaN."""
    radians = np.deg2rad(np.asarray(angle_deg, dtype=float))
    return wrap_180(np.rad2deg(np.arctan2(np.nanmean(np.sin(radians), axis), np.nanmean(np.cos(radians), axis))))
