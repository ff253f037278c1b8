"""What simulated sensors add: white noise on every channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquisition.core.actuators import Actuators
from acquisition.core.arrays import Floats
from hybrid.vessel.actuators import angle_columns, control_units


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of the sensors' white noise, in the units of the channels."""

    position_m: float = 0.05
    heading_deg: float = 0.1
    speed_mps: float = 0.03
    yaw_rate_dps: float = 0.05
    wind_direction_deg: float = 3.0
    wind_speed_mps: float = 0.2
    shaft_rpm: float = 0.3
    azimuth_deg: float = 0.2

    def scaled(self, factor: float) -> Noise:
        """This noise times ``factor``; zero gives perfect sensors."""
        return Noise(*(factor * getattr(self, name) for name in self.__slots__))


def noisy(
    generator: np.random.Generator,
    noise: Noise,
    states: Floats,
    controls: Floats,
    wind: Floats,
    actuators: Actuators,
) -> tuple[Floats, Floats, Floats]:
    """States [rows, 6], controls [rows, controls] and wind [rows, 2] with noise; a calm stays above zero."""
    rows = len(states)
    turn = np.pi / 180.0
    motion = (
        [noise.position_m] * 2 + [noise.heading_deg * turn] + [noise.speed_mps] * 2 + [noise.yaw_rate_dps * turn]
    )
    units, angles = control_units(actuators), angle_columns(actuators)
    command = noise.shaft_rpm * units
    command[angles] = noise.azimuth_deg * units[angles]
    air = [noise.wind_direction_deg * turn, noise.wind_speed_mps]
    drawn = [
        values + generator.standard_normal((rows, len(sigmas))) * sigmas
        for values, sigmas in ((states, motion), (controls, command), (wind, air))
    ]
    drawn[2][:, 1] = np.abs(drawn[2][:, 1])
    return drawn[0], drawn[1], drawn[2]
