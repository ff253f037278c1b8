"""Kinematics of arrays and of single values: rotation between earth and ship, integrated rates, the mean wind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from seatrial.acquisition.core.arrays import Floats


def to_earth(forward: Floats | float, starboard: Floats | float, heading_rad: ArrayLike) -> tuple[Floats, Floats]:
    """Components forward and to starboard as components to north and east, all of one shape."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    return forward * cosine - starboard * sine, forward * sine + starboard * cosine


def to_ship(north: Floats | float, east: Floats | float, heading_rad: ArrayLike) -> tuple[Floats, Floats]:
    """Components to north and east as components forward and to starboard: the inverse of :func:`to_earth`."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    return north * cosine + east * sine, east * cosine - north * sine


def integrate(rate: NDArray[Any], time_s: Floats | float) -> NDArray[Any]:
    """A rate [n, per s] integrated by the trapezoidal rule from its first sample, where the result is 0: [n].

    ``time_s`` are its times [n], or the step of an even grid [s].
    """
    steps_s = np.diff(time_s) if np.ndim(time_s) else time_s
    return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps_s))


def mean_wind(air: pd.DataFrame) -> tuple[float, float]:
    """The mean speed [m/s] of rows without gaps, and the direction [deg] that the mean wind vector comes from."""
    direction = np.deg2rad(air["wind_direction_deg"].to_numpy(dtype=float))
    speed = air["wind_speed_mps"].to_numpy(dtype=float)
    north, east = float(np.mean(speed * np.cos(direction))), float(np.mean(speed * np.sin(direction)))
    return float(np.mean(speed)), float(np.rad2deg(np.arctan2(east, north)) % 360.0)
