"""How a ship is handled: which controls drive her ahead, which steer her, and how her pace compares with the
usual one.

Who drives and who steers follows from the kinds of her actuators. A ship without any angle to steer by, with
shafts to either side, is steered by their difference.

The manoeuvres of :mod:`seatrial.hybrid.simulation.manoeuvres` are stated for R/V Gunnerus. Another ship makes them
at the same share of her shafts' limit, and in the same number of ship lengths: times go with L / U, the time in
which she goes her own length at the usual shaft speed, as all of manoeuvring theory has it (Nomoto et al. 1957;
Abkowitz 1964). So a ship and her model at the same Froude number make the same manoeuvre in times that are as the
roots of their lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import ConfigurationError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import KINDS, Channel
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.channels import in_words
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant
from seatrial.hybrid.vessel.simulate import simulate

CRUISE_RPM = 171.0
"""The shaft speed of R/V Gunnerus' manoeuvres where nothing else is said."""

HARD_OVER_DEG = 35.0
FULL_PITCH_PERCENT = 100.0
_LIMIT_RPM, _TUNNEL_LIMIT_RPM, _LENGTH_M, _SPEED_MPS = 203.0, 400.0, 28.9, 5.0437
"""R/V Gunnerus' limits of the shafts, her length, and her speed at :data:`CRUISE_RPM`."""

_APPROACH_STEPS, _MOST_APPROACHES, _START_MPS = 300, 8, 3.0
_STEADY_SHARE = 1e-5  # of the speed: a smaller change in a step is none
_SIGNIFICANT = 4  # digits of the times of other ships: no manoeuvre is stated finer


@dataclass(frozen=True, slots=True)
class Handling:
    """What each control of a ship does when she manoeuvres [controls], in the units of its channel.

    ``ahead``: how fast it turns where the shafts are ordered one rpm, 0 for what does not drive her; shafts with
    other limits turn in proportion to these. ``reversing`` says which of the shafts turn backwards for an order
    astern; ``pitch`` which controls are the pitches that do so for the others. ``helm``: how it answers a degree
    of helm that turns the ship to port: degrees of an angle, or rpm of the shafts of a ship that has no angle.
    """

    ahead: Floats
    reversing: Floats
    pitch: Floats
    helm: Floats

    @property
    def main(self) -> NDArray[np.bool_]:
        """Which controls are the shafts that drive the ship."""
        return np.asarray(self.ahead > 0.0)

    @property
    def steering_angles(self) -> NDArray[np.bool_]:
        """Which controls are the angles that steer the ship."""
        return np.asarray((self.helm != 0.0) & ~self.main)

    def orders(self, rpm: float, helm_deg: float) -> Floats:
        """The orders to all controls, in the units of their channels, for a shaft speed and a helm."""
        astern = -1.0 if rpm < 0.0 else 1.0
        shafts = self.ahead * rpm * np.where(self.reversing, 1.0, astern)
        return np.asarray(shafts + self.pitch * astern * FULL_PITCH_PERCENT + self.helm * helm_deg)


@dataclass(frozen=True, slots=True)
class Pace:
    """A ship against R/V Gunnerus: factors of shaft speed, tunnel thrusters' shaft speed, time and speed."""

    rpm: float = 1.0
    tunnel_rpm: float = 1.0
    time: float = 1.0
    speed: float = 1.0

    @property
    def length_s(self) -> float:
        """The time in which the ship goes her own length at the usual shaft speed [s]."""
        return self.time * _LENGTH_M / _SPEED_MPS


def _controls(vessel: Vessel) -> list[tuple[Any, Channel]]:
    """Every control channel of a ship, with the entry of its actuator.

    Raises :class:`ConfigurationError` for a ship that nothing drives.
    """
    if not any(each.drives for each in vessel.actuators):
        raise ConfigurationError(
            f"{vessel.name} has no propulsion",
            why=f"she has {in_words(vessel.actuators)}",
            fix="add a propeller",
        )
    return [
        (entry, channel)
        for entry, actuator in zip(vessel.actuator, vessel.actuators, strict=True)
        for channel in actuator.channels
    ]


def handling_of(vessel: Vessel) -> Handling:
    """How a ship is handled. Raises :class:`ConfigurationError` if nothing drives her."""
    controls = _controls(vessel)
    limit = shaft_limit_rpm(vessel)
    main = np.array([KINDS[entry.kind].drives and channel.unit == "rpm" for entry, channel in controls])
    ahead = [entry.limit_rpm / limit if drives else 0.0
             for (entry, _), drives in zip(controls, main, strict=True)]  # fmt: skip
    pitch = np.array([channel.unit == "%" for _, channel in controls])
    with_pitch = {entry.name for entry, channel in controls if channel.unit == "%"}
    reversing = np.array([entry.name not in with_pitch for entry, _ in controls])
    helm = np.array([_port_angle(entry) if channel.unit == "deg" else 0.0 for entry, channel in controls])
    if not helm.any():
        helm = main * _difference([entry for entry, _ in controls], np.array(ahead)) * usual_rpm(vessel)
    return Handling(np.array(ahead), reversing, pitch, helm)


def _port_angle(entry: Any) -> float:
    """The sign of the angle of an actuator that turns the ship to port: ahead of midship the other one."""
    return -KINDS[entry.kind].turns * (-1.0 if entry.x_m > 0.0 else 1.0)


def _difference(entries: list[Any], ahead: Floats) -> Floats:
    """The share of the usual speed that a degree of helm to port adds to shafts to starboard and takes to port.

    With the helm hard over it is all of it: the inner shafts stand.
    """
    side = np.array([np.sign(getattr(entry, "y_m", 0.0)) for entry in entries]) * (ahead > 0.0)
    both = side.min(initial=0.0) < 0.0 < side.max(initial=0.0)
    return side * ahead / HARD_OVER_DEG if both else np.zeros(len(side))


def shaft_limit_rpm(vessel: Vessel) -> float:
    """The lowest limit of the shafts that drive a ship."""
    return float(min(each.limit_rpm for each, _ in _controls(vessel) if KINDS[each.kind].drives))


def usual_rpm(vessel: Vessel) -> float:
    """The shaft speed that a ship manoeuvres with: the same share of its limit for every ship."""
    return CRUISE_RPM * (shaft_limit_rpm(vessel) / _LIMIT_RPM)


def steady_speed_mps(plant: Plant, order: Floats) -> float:
    """The speed straight ahead in still water at an ``order`` [controls] in SI.

    Of a ship that nothing is ordered to drive, the one after a first run. A step of a run is a second for a ship of
    28.9 m, and goes with the root of the length. Raises :class:`ModelRangeError` where the speed is out of the
    range of the model.
    """
    root = sqrt(plant.length_between_perpendiculars_m / _LENGTH_M)
    state = np.array([0.0, 0.0, 0.0, min(_START_MPS * root, 0.8 * plant.surge_high_mps), 0.0, 0.0])
    orders, wind = np.tile(order, (_APPROACH_STEPS, 1)), np.zeros((_APPROACH_STEPS, 2))
    for _ in range(_MOST_APPROACHES if order.any() else 1):
        before, state = simulate(plant, state, orders, wind, root)[-2:]
        if abs(state[3] - before[3]) < _STEADY_SHARE * abs(state[3]):
            break
    return float(state[3])


def pace_of(vessel: Vessel) -> Pace:
    """A ship's pace. Raises :class:`ConfigurationError` where her shafts do not drive her ahead, or drive her out
    of the range of her model."""
    rpm = usual_rpm(vessel)
    order = handling_of(vessel).orders(rpm, 0.0) * control_units(vessel.actuators)
    try:
        speed_mps = steady_speed_mps(bare_plant(vessel), order)
    except ModelRangeError as error:
        raise ConfigurationError(
            f"{vessel.name} leaves the range of its model straight ahead at {rpm:.0f} rpm, its usual shaft speed",
            why=error.why, fix="give the shafts a lower limit_rpm, or widen [validity] if the data allow",
        ) from error  # fmt: skip
    if speed_mps <= 0.0:
        raise ConfigurationError(
            f"{vessel.name} does not move ahead at {rpm:.0f} rpm", fix="check the propellers in the vessel file"
        )
    tunnels = [each.limit_rpm for each in vessel.of_kind("tunnel")]
    length_m = vessel.dimensions.length_between_perpendiculars_m
    return Pace(
        shaft_limit_rpm(vessel) / _LIMIT_RPM,
        min(tunnels, default=_TUNNEL_LIMIT_RPM) / _TUNNEL_LIMIT_RPM,
        _rounded(length_m / _LENGTH_M * (_SPEED_MPS / speed_mps)),
        _rounded(speed_mps / _SPEED_MPS),
    )


def _rounded(factor: float) -> float:
    return float(f"{factor:.{_SIGNIFICANT}g}")
