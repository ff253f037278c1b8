"""Ships with propellers and rudders, made by hand: they answer the helm as K. Nomoto et al. (1957) describe it,
``T r' + r = K delta``, and are no model of any real one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator, Actuators, actuators_as_text

SINGLE: Actuators = (Actuator("propeller", "propeller"), Actuator("rudder", "rudder"))
TWIN: Actuators = (
    Actuator("port", "propeller"), Actuator("starboard", "propeller"),
    Actuator("port_rudder", "rudder"), Actuator("starboard_rudder", "rudder"),
)  # fmt: skip
START = pd.Timestamp("2026-06-01T08:00:00Z")


@dataclass(frozen=True)
class Ship:
    """Gain and time constant of the helm, speed at an rpm, sway a turn, rate limit; those of a ship of 100 m."""

    actuators: Actuators = SINGLE
    gain_per_s: float = 0.05
    time_s: float = 10.0
    mps_per_rpm: float = 0.05
    speed_time_s: float = 30.0
    sway_m: float = 20.0
    rudder_dps: float = 3.0
    noise: float = 1.0


MODEL = Ship(
    gain_per_s=0.25, time_s=2.0, mps_per_rpm=0.4 / 600.0, speed_time_s=8.0, sway_m=0.6, rudder_dps=20.0, noise=0.05
)
"""A model of 3 m at 600 rpm."""

Orders = Callable[[float, float, float], tuple[float, float]]
"""Helm [deg, positive to starboard] and shaft [rpm] from time [s], heading as it runs on [deg] and helm [deg]."""


def sail(ship: Ship, orders: Orders, duration_s: float, rate_hz: float = 5.0, seed: int = 0) -> pd.DataFrame:
    """A table of the channels of a ship that carries out ``orders``; the wind is calm."""
    step_s, most = 1.0 / rate_hz, ship.rudder_dps / rate_hz
    rows = np.empty((round(duration_s * rate_hz), 6))
    helm, speed, rate, heading, north, east = 0.0, ship.mps_per_rpm * orders(0.0, 0.0, 0.0)[1], 0.0, 0.0, 0.0, 0.0
    for row, _ in enumerate(rows):
        wanted, rpm = orders(row * step_s, heading, helm)
        rows[row] = north, east, heading, speed, rate, helm
        sway = -ship.sway_m * radians(rate)
        angle = radians(heading + 0.5 * rate * step_s)
        north += step_s * (speed * cos(angle) - sway * sin(angle))
        east += step_s * (speed * sin(angle) + sway * cos(angle))
        heading += step_s * rate
        rate += step_s * (ship.gain_per_s * helm - rate) / ship.time_s
        speed += step_s * (ship.mps_per_rpm * rpm - speed) / ship.speed_time_s
        helm += max(-most, min(most, wanted - helm))
    shaft = np.array([orders(row * step_s, 0.0, 0.0)[1] for row in range(len(rows))])
    return _table(ship, rows, shaft, step_s, np.random.default_rng(seed))


def _table(ship: Ship, rows: Floats, rpm: Floats, step_s: float, random: np.random.Generator) -> pd.DataFrame:
    north, east, heading, speed, rate, helm = rows.T

    def sensed(values: Floats, sigma: float) -> Floats:
        return values + ship.noise * sigma * random.standard_normal(values.size)

    columns = {
        "north_m": sensed(north, 0.1), "east_m": sensed(east, 0.1), "heading_deg": sensed(heading, 0.1) % 360.0,
        "surge_mps": sensed(speed, 0.02), "sway_mps": sensed(-ship.sway_m * np.deg2rad(rate), 0.02),
        "yaw_rate_dps": sensed(rate, 0.02), "wind_direction_deg": 0.0 * north, "wind_speed_mps": 0.0 * north,
    }  # fmt: skip
    for each in ship.actuators:
        values = rpm if each.drives else helm
        columns[each.channels[0].name] = sensed(values, 0.002 * float(np.abs(values).max()))
    index = START + pd.to_timedelta(np.round(np.arange(len(rows)) * step_s * 1e9).astype(np.int64), unit="ns")
    table = pd.DataFrame(columns, index=pd.DatetimeIndex(index, name="time"))
    table.attrs["trial"] = {"actuators": actuators_as_text(ship.actuators), "vessel": "", "trial": "by hand"}
    return table


def zigzag(angle_deg: float, switch_deg: float, rpm: float, start_s: float = 60.0, first: float = 1.0) -> Orders:
    """The helm put over at ``start_s``, and to the other side when the heading is ``switch_deg`` off that way."""
    side = [first]

    def orders(time_s: float, heading_deg: float, _: float) -> tuple[float, float]:
        if time_s < start_s:
            side[0] = first
            return 0.0, rpm
        if side[0] * heading_deg >= switch_deg:
            side[0] = -side[0]
        return side[0] * angle_deg, rpm

    return orders


def turn(angle_deg: float, rpm: float, start_s: float = 60.0) -> Orders:
    """A helm put over at ``start_s`` and held."""
    return lambda time_s, _, __: (angle_deg if time_s >= start_s else 0.0, rpm)
