"""Motions made from rates alone, without a ship: what the channels record of them, with any fault put in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats

START = pd.Timestamp("2026-06-01T08:00:00Z")
FINE_S = 0.02


@dataclass(frozen=True)
class Faults:
    """What the sensors do wrong; ``late_s`` by the first channel of a group."""

    speed: float = 1.0
    sway: float = 1.0
    yaw_rate: float = 1.0
    yaw_rate_bias_dps: float = 0.0
    heading_deg: float = 0.0
    forward_m: float = 0.0
    starboard_m: float = 0.0
    late_s: dict[str, float] = field(default_factory=dict)
    jitter_s: float = 0.0
    jitter_lasts_s: float = 0.0


@dataclass(frozen=True)
class Noise:
    position_m: float = 0.05
    heading_deg: float = 0.1
    speed_mps: float = 0.03
    yaw_rate_dps: float = 0.05


def sailed(
    faults: Faults = Faults(),
    duration_s: float = 1200.0,
    rate_hz: float = 2.0,
    seed: int = 0,
    noise: Noise = Noise(),
    heading_deg: float = 0.0,
    turning: float = 1.0,
    speed_changes: float = 1.0,
) -> pd.DataFrame:
    """A ship that swings and turns, faster and slower, in waves of 6 s, as a table of the six motion channels."""
    generator = np.random.default_rng(seed)
    time_s = np.arange(-5.0, duration_s + 5.0, FINE_S)
    north, east, heading, surge, sway, rate = _motion(
        time_s, generator, np.deg2rad(heading_deg), turning, speed_changes
    )
    rows = np.arange(round(duration_s * rate_hz)) / rate_hz

    def at(values: Floats, group: str, extra_s: Floats | float = 0.0) -> Floats:
        return np.interp(rows - faults.late_s.get(group, 0.0) - extra_s, time_s, values)

    def sensed(values: Floats, sigma: float) -> Floats:
        return values + sigma * generator.standard_normal(rows.size)

    jitter = _jitter(generator, rows.size, faults, rate_hz)
    cosine, sine = np.cos(heading), np.sin(heading)
    antenna = (north + faults.forward_m * cosine - faults.starboard_m * sine,
               east + faults.forward_m * sine + faults.starboard_m * cosine)  # fmt: skip
    columns = {
        "north_m": sensed(at(antenna[0], "north_m", jitter), noise.position_m),
        "east_m": sensed(at(antenna[1], "north_m", jitter), noise.position_m),
        "heading_deg": sensed(np.rad2deg(at(heading, "heading_deg")) + faults.heading_deg, noise.heading_deg)
        % 360.0,
        "surge_mps": sensed(at(surge, "surge_mps") * faults.speed, noise.speed_mps),
        "sway_mps": sensed(at(sway, "surge_mps") * faults.speed * faults.sway, noise.speed_mps),
        "yaw_rate_dps": sensed(
            np.rad2deg(at(rate, "yaw_rate_dps")) * faults.yaw_rate + faults.yaw_rate_bias_dps, noise.yaw_rate_dps
        ),
    }
    index = START + pd.to_timedelta(np.round(rows * 1e9).astype(np.int64), unit="ns")
    return pd.DataFrame(columns, index=pd.DatetimeIndex(index, name="time"))


def _motion(
    time_s: Floats, generator: np.random.Generator, heading: float, turning: float, speed_changes: float
) -> tuple[Floats, ...]:
    """Pose and speeds from smooth rates; the pose is their integral to second order on a fine grid."""
    phase = generator.uniform(0.0, 2.0 * np.pi, 4)
    swing = 2.5 * np.sin(2.0 * np.pi * time_s / 55.0 + phase[0]) + 1.5 * np.sin(
        2.0 * np.pi * time_s / 190.0 + phase[1]
    )
    wave = 0.3 * np.sin(2.0 * np.pi * time_s / 6.0 + phase[2])
    rate = np.deg2rad(turning * swing + wave)
    surge = (
        4.0
        + speed_changes * np.sin(2.0 * np.pi * time_s / 137.0 + phase[3])
        + 0.3 * np.cos(2.0 * np.pi * time_s / 6.0)
    )
    sway = -8.0 * rate + 0.1
    angle = heading + _integral(rate)
    north = _integral(surge * np.cos(angle) - sway * np.sin(angle))
    east = _integral(surge * np.sin(angle) + sway * np.cos(angle))
    return north, east, angle, surge, sway, rate


def _integral(rates: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * FINE_S * (rates[1:] + rates[:-1]))])


def _jitter(generator: np.random.Generator, rows: int, faults: Faults, rate_hz: float) -> Floats:
    lasts = max(1, round(faults.jitter_lasts_s * rate_hz))
    drawn = faults.jitter_s * generator.standard_normal(-(-rows // lasts))
    return np.clip(np.repeat(drawn, lasts)[:rows], -3.0, 3.0)
