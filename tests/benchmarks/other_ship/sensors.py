"""What the instruments make of a voyage: biases, delays, lever arms, noise, outliers and gaps."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import NAMES, wrap_180, wrap_360
from tests.benchmarks.other_ship.sheet import Sheet

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
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    ahead, aside = sheet.antenna_m
    antenna = pose[:, :2] + np.column_stack([ahead * c - aside * s, ahead * s + aside * c])
    rate = np.column_stack([_earth_speed(ground), ground[:, 5]]) + np.gradient(motion, dt_s, axis=0)
    speeds = np.column_stack([rate[:, 0] * c + rate[:, 1] * s, rate[:, 1] * c - rate[:, 0] * s, rate[:, 2]])
    surge, sway, yaw_rate = _seen_speeds(sheet, _late(speeds, sheet.speed_delay_s, dt_s))
    north, east = _late(antenna, sheet.position_delay_s, dt_s).T
    command = _late(controls, sheet.command_delay_s, dt_s)
    seen = {
        "north_m": north,
        "east_m": east,
        "heading_deg": np.degrees(_late(pose, sheet.heading_delay_s, dt_s)[:, 2] + sheet.heading_bias_rad),
        "surge_mps": surge,
        "sway_mps": sway,
        "yaw_rate_dps": np.degrees(yaw_rate),
        "wind_direction_deg": np.degrees(np.arctan2(-air[:, 1], -air[:, 0]) + sheet.vane_bias_rad),
        "wind_speed_mps": sheet.wind_speed_factor * np.hypot(air[:, 0], air[:, 1]),
        "port_rpm": command[:, 0] * 60.0,
        "port_angle_deg": np.degrees(command[:, 1]),
        "starboard_rpm": command[:, 2] * 60.0,
        "starboard_angle_deg": np.degrees(command[:, 3]),
        "tunnel_rpm": command[:, 4],
    }
    return pd.DataFrame(seen)[list(NAMES)]


def _seen_speeds(sheet: Sheet, speeds: Floats) -> tuple[Floats, Floats, Floats]:
    """Surge, sway and yaw rate as a sensor at its own point, on its own axes, reports them."""
    forward, starboard = sheet.speed_point_m
    u, v, r = speeds[:, 0] - starboard * speeds[:, 2], speeds[:, 1] + forward * speeds[:, 2], speeds[:, 2]
    c, s = np.cos(sheet.speed_turned_rad), np.sin(sheet.speed_turned_rad)
    return (
        sheet.speed_factor * (u * c + v * s),
        sheet.speed_factor * (v * c - u * s) + sheet.sway_bias_mps,
        sheet.yaw_rate_factor * r + sheet.yaw_rate_bias_radps,
    )


def _late(values: Floats, delay_s: float, dt_s: float) -> Floats:
    """Columns as they were ``delay_s`` before each row."""
    if delay_s == 0.0:
        return values
    moment = np.arange(len(values)) * dt_s
    return np.column_stack([np.interp(moment - delay_s, moment, column) for column in values.T])


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
    """Rows in gaps: they come by chance, 2 to 8 s long, so that ``share`` is silent on average."""
    silent = np.zeros(rows, dtype=bool)
    if share <= 0.0:
        return silent
    row = 0.0
    while row < rows:
        row += random.exponential(GAP_S * rate_hz * (1.0 - share) / share)
        length = random.uniform(0.4, 1.6) * GAP_S * rate_hz
        silent[round(row) : round(row + length)] = True
        row += length
    return silent
