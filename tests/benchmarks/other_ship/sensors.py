"""What the instruments make of a voyage: biases, delays, lever arms, noise, outliers and gaps."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from acquisition.angles import wrap_180, wrap_360
from acquisition.channels import NAMES
from tests.benchmarks.other_ship.effects import Sheet

Floats = NDArray[np.float64]
SIGMAS = {
    "north_m": 0.05, "east_m": 0.05, "heading_deg": 0.1, "surge_mps": 0.03, "sway_mps": 0.03, "yaw_rate_dps": 0.05,
    "wind_direction_deg": 3.0, "wind_speed_mps": 0.2, "port_rpm": 0.3, "port_angle_deg": 0.2,
    "starboard_rpm": 0.3, "starboard_angle_deg": 0.2, "tunnel_rpm": 0.3,
}  # fmt: skip
INSTRUMENTS = (
    ("north_m", "east_m"), ("heading_deg",), ("surge_mps", "sway_mps"), ("yaw_rate_dps",),
    ("wind_direction_deg", "wind_speed_mps"), ("port_rpm", "port_angle_deg"),
    ("starboard_rpm", "starboard_angle_deg"), ("tunnel_rpm",),
)  # fmt: skip
"""Channels of one instrument fall out together."""
MEMORY_S, GAP_S = 10.0, 5.0
OUTLIER_SIGMAS = (15.0, 60.0)


def reported(
    sheet: Sheet, ground: Floats, motion: Floats, controls: Floats, air: Floats, dt_s: float
) -> pd.DataFrame:
    """The 13 channels without noise, a row a step.

    ``ground`` [rows, 6] is north, east [m], heading [rad], surge, sway over ground [m/s], yaw rate [rad/s];
    ``motion`` [rows, 3] what waves add to the pose; ``controls`` [rows, 5] the feedback in rev/s, rad and rpm;
    ``air`` [rows, 2] its motion north and east [m/s].
    """
    pose = ground[:, :3] + motion
    rate = np.column_stack([_earth_speed(ground), ground[:, 5]]) + np.gradient(motion, dt_s, axis=0)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    ahead, aside = sheet.antenna_m
    antenna = pose[:, :2] + np.column_stack([ahead * c - aside * s, ahead * s + aside * c])
    moment = np.arange(len(pose)) * dt_s
    seen = {
        "north_m": np.interp(moment - sheet.position_delay_s, moment, antenna[:, 0]),
        "east_m": np.interp(moment - sheet.position_delay_s, moment, antenna[:, 1]),
        "heading_deg": np.degrees(pose[:, 2] + sheet.heading_bias_rad),
        "surge_mps": sheet.speed_factor * (rate[:, 0] * c + rate[:, 1] * s),
        "sway_mps": sheet.speed_factor * (rate[:, 1] * c - rate[:, 0] * s),
        "yaw_rate_dps": np.degrees(rate[:, 2]),
        "wind_direction_deg": np.degrees(np.arctan2(-air[:, 1], -air[:, 0]) + sheet.vane_bias_rad),
        "wind_speed_mps": np.hypot(air[:, 0], air[:, 1]),
        "port_rpm": controls[:, 0] * 60.0,
        "port_angle_deg": np.degrees(controls[:, 1]),
        "starboard_rpm": controls[:, 2] * 60.0,
        "starboard_angle_deg": np.degrees(controls[:, 3]),
        "tunnel_rpm": controls[:, 4],
    }
    return pd.DataFrame(seen)[list(NAMES)]


def _earth_speed(ground: Floats) -> Floats:
    c, s = np.cos(ground[:, 2]), np.sin(ground[:, 2])
    return np.column_stack([ground[:, 3] * c - ground[:, 4] * s, ground[:, 3] * s + ground[:, 4] * c])


def recorded(
    random: np.random.Generator,
    table: pd.DataFrame,
    rate_hz: float,
    noise: float,
    correlated: bool,
    outliers: float,
    gaps: float,
) -> pd.DataFrame:
    """``table`` with noise of the trials' size times ``noise``, outliers and gaps; angles wrapped.

    ``outliers`` is the share of samples of every channel that are wild, by 15 to 60 ordinary standard
    deviations; ``gaps`` the share of time that every instrument is silent (NaN), in gaps of some 5 s.
    """
    sigmas = np.array([SIGMAS[name] for name in NAMES])
    values = table.to_numpy() + noise * sigmas * _shocks(random, table.shape, rate_hz, correlated)
    wild = random.uniform(size=table.shape) < outliers
    size = random.uniform(*OUTLIER_SIGMAS, table.shape) * random.choice([-1.0, 1.0], table.shape)
    values = np.where(wild, values + size * sigmas, values)
    result = pd.DataFrame(values, columns=table.columns, index=table.index)
    for name in ("heading_deg", "wind_direction_deg"):
        result[name] = wrap_360(result[name].to_numpy())
    for name in ("port_angle_deg", "starboard_angle_deg"):
        result[name] = wrap_180(result[name].to_numpy())
    result["wind_speed_mps"] = result["wind_speed_mps"].abs()
    for channels in INSTRUMENTS:
        result.loc[_silent(random, len(result), rate_hz, gaps), list(channels)] = np.nan
    return result


def _shocks(random: np.random.Generator, shape: tuple[int, int], rate_hz: float, correlated: bool) -> Floats:
    """Unit noise; half of a correlated one's variance remembers some 10 s."""
    white = random.standard_normal(shape)
    if not correlated:
        return white
    kept = np.exp(-1.0 / (MEMORY_S * rate_hz))
    shocks = random.standard_normal(shape)
    shocks[1:] *= np.sqrt(1.0 - kept**2)
    slow = lfilter([1.0], [1.0, -kept], shocks, axis=0)
    return np.asarray(np.sqrt(0.5) * (white + slow))


def _silent(random: np.random.Generator, rows: int, rate_hz: float, share: float) -> NDArray[np.bool_]:
    """Rows in gaps: silences and sounds alternate, both exponential, so that ``share`` is silent on average."""
    silent = np.zeros(rows, dtype=bool)
    if share <= 0.0:
        return silent
    row = 0.0
    while row < rows:
        row += random.exponential(GAP_S * rate_hz * (1.0 - share) / share)
        length = random.exponential(GAP_S * rate_hz)
        silent[round(row) : round(row + length)] = True
        row += length
    return silent
