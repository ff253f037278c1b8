"""The mean wind of a stretch of time."""

from __future__ import annotations

import numpy as np
import pandas as pd


def mean_wind(air: pd.DataFrame) -> tuple[float, float]:
    """The mean speed [m/s] of rows without gaps, and the direction [deg] that the mean wind vector comes from."""
    direction = np.deg2rad(air["wind_direction_deg"].to_numpy(dtype=float))
    speed = air["wind_speed_mps"].to_numpy(dtype=float)
    north, east = float(np.mean(speed * np.cos(direction))), float(np.mean(speed * np.sin(direction)))
    return float(np.mean(speed)), float(np.rad2deg(np.arctan2(east, north)) % 360.0)
