"""Quantities off the wires to the 13 channels: the trial's plane, the ship's axes, the channel's range.

What is derived says so in its source. Values that a channel cannot hold are left out and counted.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import pymap3d

from acquisition.channels import BY_NAME, CIRCULAR
from acquisition.frames import Group, Sample
from acquisition.trial import Trial

_HEADING_KEEPS_NS = 500_000_000  # a heading older than this does not turn velocities into surge and sway

_WHOLE_TURN_DEG = 360.01  # a turn rounded up to a wire's step: NMEA 2000 can say 360.0008 degrees


class Derivation:
    """The channels of one trial from what its decoders deliver, sample group by sample group.

    A group is what came in one message. Without an origin in ``trial`` the first fix of one of the lines
    ``positions_from`` becomes the origin; ``origin`` then tells which it is.
    """

    def __init__(self, trial: Trial, positions_from: frozenset[str]) -> None:
        self.origin = trial.origin
        self._positions_from = positions_from
        self._heading: dict[str, Sample] = {}

    def channels(self, group: Group) -> tuple[list[Sample], int]:
        """The channel samples in a group, angles wrapped, and how many values no channel can hold."""
        by_quantity = {sample.quantity: sample for sample in group}
        derived = [*group, *self._plane(by_quantity), *self._body_velocity(by_quantity)]
        wrapped = [_wrapped(sample) for sample in derived if sample.quantity in BY_NAME]
        possible = [sample for sample in wrapped if BY_NAME[sample.quantity].holds(sample.value)]
        return possible, len(wrapped) - len(possible)

    def _plane(self, group: dict[str, Sample]) -> list[Sample]:
        """North and east of the origin [m] by the WGS 84 tangent plane."""
        latitude, longitude = group.get("latitude_deg"), group.get("longitude_deg")
        if latitude is None or longitude is None:
            return []
        if not (BY_NAME["latitude_deg"].holds(latitude.value) and BY_NAME["longitude_deg"].holds(longitude.value)):
            return []
        if self.origin is None:
            if _line(latitude) not in self._positions_from:
                return []
            self.origin = (latitude.value, longitude.value)
        north, east, _ = pymap3d.geodetic2ned(latitude.value, longitude.value, 0.0, *self.origin, 0.0)
        return [_derived(latitude, "north_m", float(north)), _derived(latitude, "east_m", float(east))]

    def _body_velocity(self, group: dict[str, Sample]) -> list[Sample]:
        """Surge and sway over ground from north and east velocity and the line's own last heading."""
        if "heading_deg" in group:
            self._heading[_line(group["heading_deg"])] = group["heading_deg"]
        north, east = group.get("velocity_north_mps"), group.get("velocity_east_mps")
        if north is None or east is None:
            return []
        heading = self._heading.get(_line(north))
        if heading is None or north.monotonic_ns - heading.monotonic_ns > _HEADING_KEEPS_NS:
            return []
        psi = radians(heading.value)
        surge = north.value * cos(psi) + east.value * sin(psi)
        sway = -north.value * sin(psi) + east.value * cos(psi)
        return [_derived(north, "surge_mps", surge), _derived(north, "sway_mps", sway)]


def _wrapped(sample: Sample) -> Sample:
    """An angle within its turn; a value beyond a whole turn is no rounding but a fault, and stays as it is."""
    if sample.quantity not in CIRCULAR or not abs(sample.value) <= _WHOLE_TURN_DEG:
        return sample
    return replace(sample, value=BY_NAME[sample.quantity].wrapped(sample.value))


def _derived(sample: Sample, quantity: str, value: float) -> Sample:
    return replace(sample, quantity=quantity, value=value, source=f"{sample.source} derived")


def _line(sample: Sample) -> str:
    return sample.source.split("/", maxsplit=1)[0]
