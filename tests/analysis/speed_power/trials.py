"""Speed trials made from a known power curve: a ship that runs to and fro in a tide, wind and noise.

Nothing of ``seatrial.analysis.speed_power`` is used here: the speed through the water is that at which the power is
spent, and after each turn she comes to it as a first-order system does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.signal import lfilter

from seatrial.acquisition.core.quantities import Floats

TIDE_S = 12.42 * 3600.0
LENGTH_M, BEAM_M, DRAUGHT_M, VOLUME_M3 = 180.0, 32.0, 11.0, 48_000.0
FRONTAL_M2, EFFICIENCY, AIR_KGPM3 = 620.0, 0.7, 1.225
WIND_CURVE = (0.8, 0.85, 0.7, 0.1, -0.5, -0.75, -0.65)  # C_AA every 30 deg off the bow
RPM = {60.0: 1, 75.0: 2, 82.0: 1, 90.0: 1}  # shaft speeds and how many double runs at each


def true_power_kw(speed_mps: float) -> float:
    """Power in still water and still air."""
    return 180.0 + 10.5 * speed_mps**3.15


@dataclass(frozen=True)
class Day:
    """The sea of a trial: the tide's speed and phase, a steady current, wind and noise."""

    tide_mps: float = 0.5
    phase_rad: float = 0.7
    steady_mps: float = 0.2
    current_to_deg: float = 20.0
    wind_mps: float = 0.0
    wind_from_deg: float = 50.0
    noise: float = 1.0
    seed: int = 1


def wind_force_n(speed_over_ground: float, heading_deg: float, day: Day) -> float:
    """What the air takes beyond still air at that speed."""
    wind = day.wind_mps * np.exp(1j * np.deg2rad(day.wind_from_deg - heading_deg))
    relative = speed_over_ground + wind
    curve = np.interp(abs(np.angle(relative)), np.linspace(0.0, np.pi, len(WIND_CURVE)), WIND_CURVE)
    still = WIND_CURVE[0] * speed_over_ground**2
    return float(0.5 * AIR_KGPM3 * FRONTAL_M2 * (curve * abs(relative) ** 2 - still))


def speed_through_water(power_kw: float, heading_deg: float, along_mps: float, day: Day) -> float:
    """The speed at which the power is spent: still water's, and that of the wind's force."""

    def lacking(speed: float) -> float:
        wind_kw = 1e-3 * wind_force_n(speed + along_mps, heading_deg, day) * speed / EFFICIENCY
        return true_power_kw(speed) + wind_kw - power_kw

    return float(brentq(lacking, 0.5, 20.0))


def sail(
    day: Day, minutes: float = 12.0, heading_deg: float = 30.0, settle_s: float = 240.0, rpm: dict[float, int] = RPM
) -> pd.DataFrame:
    """A trial at 1 Hz: at each shaft speed its double runs, with turns between that cost a quarter of her way."""
    random = np.random.default_rng(day.seed)
    legs = [(speed, heading_deg + 180.0 * k) for speed, number in rpm.items() for k in range(2 * number)]
    headings, powers = list[Floats](), list[Floats]()
    for speed, heading in legs:
        turn = np.linspace(heading - 180.0, heading, 150)
        headings.append(np.concatenate([turn, np.full(round(60.0 * minutes + 6.0 * settle_s), heading)]))
        powers.append(np.full(headings[-1].size, true_power_kw(0.094 * speed)))
    heading, power = np.concatenate(headings), np.concatenate(powers)
    shaft = np.concatenate([np.full(each.size, speed) for each, (speed, _) in zip(headings, legs, strict=True)])
    time = np.arange(heading.size, dtype=float)
    current = day.steady_mps + day.tide_mps * np.cos(2.0 * np.pi * time / TIDE_S + day.phase_rad)
    towards = np.deg2rad(day.current_to_deg)
    through, last = np.empty(time.size), 6.0
    first = 0
    for each in headings:
        rows = slice(first, first + each.size)
        middle = first + each.size - 1 - round(30.0 * minutes)
        along = current[middle] * np.cos(towards - np.deg2rad(each[-1]))
        final = speed_through_water(power[middle], each[-1], along, day)
        start = 0.75 * last
        through[rows] = final + (start - final) * np.exp(-np.arange(each.size) / settle_s)
        first, last = first + each.size, final
    course = np.deg2rad(heading)
    north_mps = through * np.cos(course) + current * np.cos(towards)
    east_mps = through * np.sin(course) + current * np.sin(towards)
    n, e = np.cumsum(north_mps), np.cumsum(east_mps)
    white = day.noise * random.standard_normal((6, time.size))
    slow = day.noise * 0.03 * _slow(time.size, 40.0, random)
    surge = north_mps * np.cos(course) + east_mps * np.sin(course)
    sway = -north_mps * np.sin(course) + east_mps * np.cos(course)
    return pd.DataFrame(
        {
            "north_m": n + np.cumsum(slow * np.cos(course)) + 0.5 * white[0],
            "east_m": e + np.cumsum(slow * np.sin(course)) + 0.5 * white[1],
            "heading_deg": (heading + 0.1 * white[2]) % 360.0,
            "surge_mps": surge + slow + 0.05 * white[3], "sway_mps": sway + 0.05 * white[4],
            "yaw_rate_dps": np.gradient(heading) + 0.02 * white[5],
            "wind_direction_deg": np.full(time.size, day.wind_from_deg),
            "wind_speed_mps": np.full(time.size, day.wind_mps),
            "main_rpm": shaft + 0.05 * day.noise * random.standard_normal(time.size),
            "shaft_power_kw": power * (1.0 + day.noise * (0.01 * random.standard_normal(time.size)
                                                          + 0.004 * _slow(time.size, 60.0, random))),
        },
        index=pd.date_range("2026-05-01 06:00", periods=time.size, freq="1s", tz="UTC", name="time"),
    )  # fmt: skip


def _slow(size: int, scale_s: float, random: np.random.Generator) -> Floats:
    """Noise of one standard deviation that lasts for ``scale_s``, as of waves, gusts and the helmsman."""
    share = np.exp(-1.0 / scale_s)
    return np.asarray(lfilter([np.sqrt(1.0 - share**2)], [1.0, -share], random.standard_normal(size)))
