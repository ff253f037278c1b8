"""Channels of a table that follow from others of it: the recorder's equations, row by row of a whole table.

Surge and sway from course and speed over ground and the heading, as :mod:`seatrial.acquisition.logger.derive` has
them; where there is no course, and for the yaw rate, the rates of position and heading: slopes of straight lines
over a second and a half before and after each row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from seatrial.acquisition.core.angles import unwrap, wrap_360
from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.kinematics import along
from seatrial.analysis.kinematics import to_ship

_REACH_S = 1.5  # as long as the recorder believes a heading or a speed
_LEAST_NEIGHBOURS = 1
_along = np.vectorize(along, otypes=[float, float])


def derive(table: pd.DataFrame, names: Sequence[str]) -> dict[str, str]:
    """Add the channels ``names`` to a table of channels with a UTC index; what each was derived from, by name.

    Channels whose inputs are not there stay away. A value stands in the rows that have the quantity it follows
    from; the heading is carried to these along straight lines on the circle.
    """
    if not names:
        return {}
    seconds = seconds_of(pd.DatetimeIndex(table.index))
    sources: dict[str, str] = {}
    for make, channels in _DERIVATIONS.items():
        wanted = [name for name in channels if name in names and name not in table]
        if wanted and (derived := make(table, seconds)):
            table[wanted] = np.column_stack([derived[0][name] for name in wanted])
            sources |= dict.fromkeys(wanted, f"table derived from {derived[1]}")
    return sources


def seconds_of(index: pd.DatetimeIndex) -> Floats:
    """Seconds of an index since its first time [n]."""
    ns = index.as_unit("ns").asi8
    return np.asarray((ns - ns[0]) / 1e9 if ns.size else ns, dtype=float)


Made = tuple[dict[str, Floats], str] | None


def _yaw_rate(table: pd.DataFrame, seconds: Floats) -> Made:
    if "heading_deg" not in table:
        return None
    heading = unwrap(table["heading_deg"].to_numpy(dtype=float))
    return {"yaw_rate_dps": rate(seconds, heading)}, "heading_deg"


def _velocity(table: pd.DataFrame, seconds: Floats) -> Made:
    """Surge and sway; of the positions where the table has no course and speed."""
    if "heading_deg" not in table:
        return None
    velocity = velocity_over_ground(table, seconds)
    if velocity is None:
        return None
    north, east, source = velocity
    return to_ship_axes(table, north, east), f"{source} and heading_deg"


def to_ship_axes(table: pd.DataFrame, north: Floats, east: Floats) -> dict[str, Floats]:
    """Surge and sway [m/s] of velocities [n] to north and east in the rows of a table with a heading."""
    seconds = seconds_of(pd.DatetimeIndex(table.index))
    heading = at_all_rows(seconds, unwrap(table["heading_deg"].to_numpy(dtype=float)))
    surge, sway = to_ship(north, east, np.deg2rad(heading))
    return {"surge_mps": surge, "sway_mps": sway}


def _course(table: pd.DataFrame, seconds: Floats) -> Made:
    if not {"north_m", "east_m"} <= set(table.columns):
        return None
    north, east = (rate(seconds, table[name].to_numpy(dtype=float)) for name in ("north_m", "east_m"))
    speed = np.hypot(north, east)
    course = np.where(speed > 0.0, wrap_360(np.rad2deg(np.arctan2(east, north))), np.nan)
    return {"speed_over_ground_mps": speed, "course_over_ground_deg": course}, "north_m, east_m"


_DERIVATIONS: dict[Callable[[pd.DataFrame, Floats], Made], tuple[str, ...]] = {
    _yaw_rate: ("yaw_rate_dps",),
    _velocity: ("surge_mps", "sway_mps"),
    _course: ("speed_over_ground_mps", "course_over_ground_deg"),
}
DERIVED: tuple[str, ...] = tuple(name for names in _DERIVATIONS.values() for name in names)
"""The channels that can be derived."""


def velocity_over_ground(table: pd.DataFrame, seconds: Floats) -> tuple[Floats, Floats, str] | None:
    """Velocity to north and east [m/s] of each row and where it is from; None where the table tells of none."""
    if {"course_over_ground_deg", "speed_over_ground_mps"} <= set(table.columns):
        names = ("course_over_ground_deg", "speed_over_ground_mps")
        north, east = _along(*(table[name].to_numpy(dtype=float) for name in names))
        return north, east, ", ".join(names)
    if {"north_m", "east_m"} <= set(table.columns):
        north, east = (rate(seconds, table[name].to_numpy(dtype=float)) for name in ("north_m", "east_m"))
        return north, east, "north_m, east_m"
    return None


def rate(seconds: Floats, values: Floats) -> Floats:
    """The slope of the line of least squares through each value and its neighbours within 1.5 s [per s]; NaN where
    there is none, of values and of neighbours. The nearest on either side count however far they are.
    """
    result = np.full(values.size, np.nan)
    valid = np.flatnonzero(np.isfinite(values) & np.isfinite(seconds))
    t, y = seconds[valid], values[valid]
    if valid.size < 2 or np.any(np.diff(t) < 0.0):
        return result
    places = np.arange(valid.size)
    low = np.minimum(np.searchsorted(t, t - _REACH_S), np.maximum(places - _LEAST_NEIGHBOURS, 0))
    high = np.maximum(
        np.searchsorted(t, t + _REACH_S, "right"), np.minimum(places + _LEAST_NEIGHBOURS + 1, valid.size)
    )
    count = (high - low).astype(float)
    t0, y0 = t - t[0], y - y.mean()
    sums = [np.concatenate([[0.0], np.cumsum(terms)]) for terms in (t0, y0, t0 * t0, t0 * y0)]
    st, sy, stt, sty = (total[high] - total[low] for total in sums)
    spread = stt - st * st / count
    with np.errstate(divide="ignore", invalid="ignore"):
        result[valid] = np.where(spread > 0.0, (sty - st * sy / count) / spread, np.nan)
    return result


def at_all_rows(seconds: Floats, values: Floats) -> Floats:
    """Values carried to the rows without one, along straight lines between two no more than 3 s apart; else NaN."""
    valid = np.flatnonzero(np.isfinite(values) & np.isfinite(seconds))
    if valid.size == 0:
        return values
    result = np.interp(seconds, seconds[valid], values[valid], left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(seconds[valid], seconds), 1, max(valid.size - 1, 1))
    gap = seconds[valid][np.minimum(after, valid.size - 1)] - seconds[valid][after - 1]
    return np.where(np.isfinite(values), values, np.where(gap <= 2.0 * _REACH_S, result, np.nan))


def heading_of_quaternion(x: Floats, y: Floats, z: Floats, w: Floats, frame: str = "enu") -> Floats:
    """The heading [deg] of orientations [n]; "enu" counts yaw from east to north, "ned" from north to east.

    Yaw of Fossen (2021, eq. 2.74); ROS' frames are those of REP 103.
    """
    yaw = np.rad2deg(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return wrap_360(90.0 - yaw if frame == "enu" else yaw)
