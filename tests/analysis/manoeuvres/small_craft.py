"""Craft of 1 to 10 m made by hand, steered by a rudder, two azimuth thrusters or two propellers.

They answer the helm as K. Nomoto et al. (1957) describe it, ``T r' + r = K delta``, with times that go with
length by speed, and are no model of any real one. The rudder's angle wanders as a gauge with play does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator, Actuators, actuators_as_text

STEP_S = 0.05
RUDDER: Actuators = (Actuator("propeller", "propeller"), Actuator("rudder", "rudder"))
AZIMUTHS: Actuators = (Actuator("fore", "azimuth"), Actuator("aft", "azimuth"))
PROPELLERS: Actuators = (Actuator("port", "propeller"), Actuator("starboard", "propeller"))
_RPM, _START = 800.0, pd.Timestamp("2026-06-01T08:00:00Z")


@dataclass(frozen=True)
class Craft:
    """A craft of a length [m] at a speed [m/s], its helm's rate [deg/s], how its helm is noisy and wanders [deg, as
    standard deviations], and samples a second."""

    length_m: float = 3.0
    speed_mps: float = 1.5
    actuators: Actuators = RUDDER
    helm_rate_dps: float = 20.0
    noise_deg: float = 0.1
    wander_deg: float = 0.0
    rate_hz: float = 5.0

    @property
    def pace_s(self) -> float:
        return self.length_m / self.speed_mps


@dataclass(frozen=True)
class Sailed:
    """A recording, and what was ordered: times [s] and helms [deg, positive to starboard]."""

    table: pd.DataFrame
    orders_s: tuple[float, ...]
    end_s: float


def sail_zigzag(craft: Craft, swings: int, angle_deg: float, switch_deg: float, seed: int, lead_s: float) -> Sailed:
    """A zigzag of some swings after a straight lead, and straight on."""
    side, orders_s = 1.0, list[float]()
    base = 0.0

    def helm(now: float, heading: float) -> float:
        nonlocal side, base
        if now < lead_s:
            return 0.0
        if not orders_s:
            base = heading
            orders_s.append(now)
        elif side * (heading - base) >= switch_deg and len(orders_s) < swings:
            side = -side
            orders_s.append(now)
        elif len(orders_s) == swings and side * (heading - base) >= switch_deg:
            return 0.0
        return side * angle_deg

    def done(now: float, heading: float) -> bool:
        return len(orders_s) == swings and now > orders_s[-1] + 15.0 * craft.pace_s

    return _sailed(craft, helm, done, orders_s, seed)


def sail_circle(craft: Craft, angle_deg: float, turn_deg: float, seed: int, lead_s: float) -> Sailed:
    """A helm held until the craft has turned by an angle, after a straight lead if there is any."""
    orders_s = list[float]()

    def helm(now: float, heading: float) -> float:
        if now < lead_s:
            return 0.0
        if not orders_s:
            orders_s.append(now)
        return angle_deg

    return _sailed(
        craft, helm, lambda now, heading: abs(heading) >= turn_deg, orders_s, seed, settled=lead_s <= 0.0
    )


def _sailed(craft: Craft, helm, done, orders_s: list[float], seed: int, settled: bool = False) -> Sailed:  # type: ignore[no-untyped-def]
    gain, time_s, rows = 0.35 / craft.pace_s, 1.5 * craft.pace_s, list[tuple[float, ...]]()
    north, east, heading, rate, delta, now = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if settled:
        delta = helm(0.0, 0.0)
        rate = gain * delta
    while not done(now, heading) and now < 3000.0:
        wanted = helm(now, heading)
        sway = -0.3 * craft.length_m * radians(rate)
        rows.append((now, north, east, heading, craft.speed_mps, sway, rate, delta))
        angle = radians(heading)
        north += STEP_S * (craft.speed_mps * cos(angle) - sway * sin(angle))
        east += STEP_S * (craft.speed_mps * sin(angle) + sway * cos(angle))
        heading += STEP_S * rate
        rate += STEP_S * (gain * delta - rate) / time_s
        most = craft.helm_rate_dps * STEP_S
        delta += max(-most, min(most, wanted - delta))
        now += STEP_S
    return Sailed(_table(craft, np.array(rows), seed), tuple(orders_s), now)


def _table(craft: Craft, rows: Floats, seed: int) -> pd.DataFrame:
    random = np.random.default_rng(seed)
    every = max(1, round(1.0 / (craft.rate_hz * STEP_S)))
    time_s, north, east, heading, speed, sway, rate, delta = rows[::every].T
    size = time_s.size

    def noisy(values: Floats, sigma: float) -> Floats:
        return values + sigma * random.standard_normal(size)

    shown = noisy(delta + craft.wander_deg * _wander(size, every * STEP_S, random), craft.noise_deg)
    columns = {
        "north_m": noisy(north, 0.02 * craft.length_m), "east_m": noisy(east, 0.02 * craft.length_m),
        "heading_deg": noisy(heading, 0.3) % 360.0, "surge_mps": noisy(speed, 0.02 * craft.speed_mps),
        "sway_mps": noisy(sway, 0.02 * craft.speed_mps), "yaw_rate_dps": noisy(rate, 0.3),
    } | _settings(craft, shown, random)  # fmt: skip
    index = _START + pd.to_timedelta(np.round(time_s * 1e9).astype(np.int64), unit="ns")
    table = pd.DataFrame(columns, index=pd.DatetimeIndex(index, name="time"))
    table.attrs["trial"] = {"actuators": actuators_as_text(craft.actuators), "vessel": "", "trial": "by hand"}
    return table


def _wander(size: int, step_s: float, random: np.random.Generator) -> Floats:
    """Noise of one with a correlation over a second and a half."""
    share = np.exp(-step_s / 1.5)
    return np.asarray(lfilter([np.sqrt(1.0 - share**2)], [1.0, -share], random.standard_normal(size)))


def _settings(craft: Craft, helm: Floats, random: np.random.Generator) -> dict[str, Floats]:
    """The channels of the actuators that steer as a helm does [deg, positive to starboard]."""
    rpm = _RPM * (1.0 + 0.003 * random.standard_normal((2, helm.size)))
    if craft.actuators is PROPELLERS:
        thrust = np.tan(np.deg2rad(np.clip(helm, -60.0, 60.0)))
        shares = np.array([1.0 + thrust, 1.0 - thrust])
        port, starboard = rpm * np.sign(shares) * np.sqrt(np.abs(shares))
        return {"port_rpm": port, "starboard_rpm": starboard}
    if craft.actuators is AZIMUTHS:
        return {"fore_angle_deg": helm, "aft_angle_deg": -helm, "fore_rpm": rpm[0], "aft_rpm": rpm[1]}
    return {"rudder_angle_deg": helm, "propeller_rpm": rpm[0]}
