"""A ship under way with everything held, as her sensors would report it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table

ORIGIN = (63.44, 10.4)
START = pd.Timestamp("2026-06-01T08:00:00Z")
SPEED_MPS, HEADING_DEG = 4.0, 30.0


def steady_table(duration_s: float, rate_hz: float = 10.0) -> pd.DataFrame:
    """Straight ahead at 4 m/s on a heading of 30 degrees, thrusters and wind held."""
    seconds = np.arange(int(duration_s * rate_hz)) / rate_hz
    values = dict.fromkeys(NAMES, 0.0) | {
        "heading_deg": HEADING_DEG, "surge_mps": SPEED_MPS, "wind_direction_deg": 200.0, "wind_speed_mps": 5.0,
        "port_rpm": 140.0, "starboard_rpm": 140.0,
    }  # fmt: skip
    table = pd.DataFrame({name: np.full(seconds.size, value) for name, value in values.items()})
    table["north_m"] = SPEED_MPS * seconds * np.cos(np.deg2rad(HEADING_DEG))
    table["east_m"] = SPEED_MPS * seconds * np.sin(np.deg2rad(HEADING_DEG))
    table.index = pd.DatetimeIndex(START + pd.to_timedelta(seconds * 1e3, unit="ms"), name="time").as_unit("ns")
    return table


def write_steady(path: Path, duration_s: float) -> pd.DataFrame:
    """Write :func:`steady_table` as a recording and return it."""
    table = steady_table(duration_s)
    write_table(table, path, Trial("steady", origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1]))
    return table
