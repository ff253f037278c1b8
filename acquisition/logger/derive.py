"""Quantities off the wires to the 13 channels: the trial's plane, the ship's axes, true north, wind over ground.

What is derived says so in its source. Values that a channel cannot hold are left out and counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import radians

from seatrial.acquisition.config.sources import Mounting
from seatrial.acquisition.core.quantities import (
    TangentPlane,
    along,
    apparent_wind,
    to_earth,
    to_ship,
    velocity_at_reference,
    wind_over_ground,
)
from seatrial.acquisition.core.ship import BY_NAME, Channel, channels_of_trial
from seatrial.acquisition.core.trial import Group, Quality, Sample, Trial

_HEADING_KEEPS_NS = 1_500_000_000  # carried on by the rate of turn for as long
_MOTION_KEEPS_NS = 1_500_000_000
_WHOLE_TURN_DEG = 360.01  # a turn rounded up to a wire's step: NMEA 2000 can say 360.0008 degrees
_AS_FITTED = Mounting()

_HEADINGS = ("heading_deg", "heading_magnetic_deg")
_BOW_WINDS = ("apparent", "theoretical", "water")
# What decoders say that is no channel is held to the limits of the channel that it is of a kind with.
_KINDS = {
    "velocity_north_mps": "surge_mps",
    "velocity_east_mps": "surge_mps",
    "course_magnetic_deg": "course_over_ground_deg",
    "wind_direction_magnetic_deg": "wind_direction_deg",
    **{f"wind_angle_{kind}_deg": "apparent_wind_angle_deg" for kind in _BOW_WINDS},
    **{f"wind_speed_{kind}_mps": "wind_speed_mps" for kind in _BOW_WINDS},
}
_PAIRS = (
    ("latitude_deg", "longitude_deg"),
    ("north_m", "east_m"),
    ("surge_mps", "sway_mps"),
    ("velocity_north_mps", "velocity_east_mps"),
    ("course_over_ground_deg", "speed_over_ground_mps"),
    ("course_magnetic_deg", "speed_over_ground_mps"),
    ("wind_direction_deg", "wind_speed_mps"),
    ("wind_direction_magnetic_deg", "wind_speed_mps"),
    ("apparent_wind_angle_deg", "apparent_wind_speed_mps"),
    *((f"wind_angle_{kind}_deg", f"wind_speed_{kind}_mps") for kind in _BOW_WINDS),
)
_PARTNERS = {
    quantity: {partner for pair in _PAIRS if quantity in pair for partner in pair if partner != quantity}
    for quantity in {name for pair in _PAIRS for name in pair}
}
_REMEMBERED = frozenset({"heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "speed_through_water_mps"})
_BOW_WIND_NAMES = tuple((kind, f"wind_angle_{kind}_deg", f"wind_speed_{kind}_mps") for kind in _BOW_WINDS)
_COMPASS = frozenset({*_HEADINGS, "magnetic_variation_deg"})
_VELOCITY = frozenset({"velocity_north_mps", "speed_over_ground_mps", "surge_mps", "sway_mps"})
_WIND = frozenset({"wind_direction_magnetic_deg", *(angle for _, angle, _ in _BOW_WIND_NAMES)})
_SPEAKS_OF_MORE = _COMPASS | _VELOCITY | _WIND | {"latitude_deg"}

Quantities = dict[str, Sample]


class Derivation:
    """The channels of one trial from what its decoders deliver, sample group by sample group.

    A group is what came in one message. Without an origin in ``trial`` the first fix of one of the lines
    ``positions_from`` becomes the origin; ``origin`` then tells which it is. ``mountings`` says by line how its
    sensors are mounted; ``variation_deg`` serves until a device tells the magnetic variation.
    """

    def __init__(
        self,
        trial: Trial,
        positions_from: frozenset[str],
        mountings: Mapping[str, Mounting] | None = None,
        variation_deg: float | None = None,
    ) -> None:
        self._plane = None if trial.origin is None else TangentPlane(*trial.origin)
        self._positions_from = positions_from
        self._mountings = {line: mounting for line, mounting in (mountings or {}).items() if mounting != _AS_FITTED}
        self._variation_deg = variation_deg
        self._channels = channels_of_trial(trial)
        self._limits = {**self._channels, **{quantity: BY_NAME[channel] for quantity, channel in _KINDS.items()}}
        self._headings: dict[str, Sample] = {}  # by line, admitted or not
        self._ship: Quantities = {}  # the last of each that became the ship's channel

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the plane's origin [deg], once it is known."""
        return None if self._plane is None else self._plane.origin

    def remember(self, sample: Sample) -> None:
        """Take note of what became the ship's channel: other lines' samples are derived with it."""
        if sample.quantity in _REMEMBERED:
            self._ship[sample.quantity] = sample

    def channels(self, group: Group) -> tuple[list[Sample], int]:
        """The channel samples in a group, angles wrapped, and how many values no channel can hold."""
        sound, impossible = _possible(group, self._limits)
        stated = _SPEAKS_OF_MORE.intersection([sample.quantity for sample in sound])
        if stated:
            sound, more = _possible(self._derived(sound, stated), self._limits)
            impossible += more
        return [sample for sample in sound if sample.quantity in self._channels], impossible

    def _derived(self, group: Group, stated: frozenset[str]) -> list[Sample]:
        """The group's samples, corrected for their mounting, and what follows from what they have ``stated``."""
        mounting = self._mountings.get(_line(group[0]), _AS_FITTED)
        turned = group if mounting is _AS_FITTED else self._turned(group, mounting)
        quantities = {sample.quantity: sample for sample in turned}
        if not stated.isdisjoint(_COMPASS):
            self._note_compass(quantities)
        if not stated.isdisjoint(_VELOCITY):
            quantities.update(self._ship_velocity(quantities, mounting))
        derived = list(quantities.values())
        if "latitude_deg" in stated:
            derived += self._position(quantities, mounting)
        if not stated.isdisjoint(_WIND):
            derived += self._wind(quantities)
        return derived

    def _note_compass(self, group: Quantities) -> None:
        """Remember variation and heading; a magnetic heading becomes a true one, where that can be done."""
        if "magnetic_variation_deg" in group:
            self._variation_deg = group["magnetic_variation_deg"].value
        heading, magnetic = group.get("heading_deg"), group.get("heading_magnetic_deg")
        if heading is None and magnetic is not None and self._variation_deg is not None:
            heading = _derived(magnetic, "heading_deg", (magnetic.value + self._variation_deg) % 360.0)
        if heading is not None:
            group["heading_deg"] = self._headings[_line(heading)] = heading

    def _turned(self, group: Group, mounting: Mounting) -> Iterator[Sample]:
        """Headings and bow-relative wind angles, turned by what their sensors are mounted off."""
        for sample in group:
            turn_deg = 0.0
            if sample.quantity in _HEADINGS:
                turn_deg = mounting.heading_deg
            elif sample.quantity.startswith("wind_angle_"):
                turn_deg = mounting.wind_angle_deg
            turned_deg = (sample.value + turn_deg) % 360.0
            yield sample if turn_deg == 0.0 else _derived(sample, sample.quantity, turned_deg)

    def _heading_deg(self, sample: Sample) -> float | None:
        """The true heading when ``sample`` came: the line's own or else the ship's, carried on by the yaw rate."""
        for heading in (self._headings.get(_line(sample)), self._ship.get("heading_deg")):
            if heading is None:
                continue
            age_ns = sample.monotonic_ns - heading.monotonic_ns
            if age_ns <= _HEADING_KEEPS_NS:
                yaw_rate_dps = self._ship_value("yaw_rate_dps", sample) or 0.0
                return heading.value + yaw_rate_dps * age_ns / 1e9
        return None

    def _ship_value(self, quantity: str, sample: Sample) -> float | None:
        """The ship's last value of a channel, if it is fresh when ``sample`` came."""
        latest = self._ship.get(quantity)
        fresh = latest is not None and sample.monotonic_ns - latest.monotonic_ns <= _MOTION_KEEPS_NS
        return latest.value if latest is not None and fresh else None

    def _ship_velocity(self, group: Quantities, mounting: Mounting) -> Quantities:
        """Surge and sway over ground at the reference point, from what the group says of velocity."""
        body_velocity: Quantities = {name: group[name] for name in ("surge_mps", "sway_mps") if name in group}
        velocity = body_velocity or self._velocity_over_ground(group)
        if not velocity or not (mounting.forward_m or mounting.starboard_m):
            return velocity
        yaw_rate_dps = self._ship_value("yaw_rate_dps", next(iter(velocity.values())))
        shift = velocity_at_reference(0.0, 0.0, yaw_rate_dps or 0.0, mounting.forward_m, mounting.starboard_m)
        moved = {
            name: _derived(velocity[name], name, velocity[name].value + metres_per_second)
            for name, metres_per_second in zip(("surge_mps", "sway_mps"), shift, strict=True)
            if name in velocity
        }
        if yaw_rate_dps is None:  # whether she turns is not known, so neither is how her ends move
            return {name: sample._replace(quality=Quality.SUSPECT) for name, sample in moved.items()}
        return moved

    def _velocity_over_ground(self, group: Quantities) -> Quantities:
        """Surge and sway where they were measured, from velocity over ground and the heading."""
        ground_velocity = self._over_ground(group)
        heading_deg = None if ground_velocity is None else self._heading_deg(ground_velocity[0])
        if ground_velocity is None or heading_deg is None:
            return {}
        sample, north, east = ground_velocity
        surge, sway = map(float, to_ship(north, east, radians(heading_deg)))
        return {name: _derived(sample, name, speed) for name, speed in (("surge_mps", surge), ("sway_mps", sway))}

    def _over_ground(self, group: Quantities) -> tuple[Sample, float, float] | None:
        """Velocity to north and east, as told or from course and speed."""
        north, east = group.get("velocity_north_mps"), group.get("velocity_east_mps")
        if north is not None and east is not None:
            return north, north.value, east.value
        speed = group.get("speed_over_ground_mps")
        if speed is None:
            return None
        if (course := group.get("course_over_ground_deg")) is not None:
            return speed, *along(course.value, speed.value)
        if (course := group.get("course_magnetic_deg")) is not None and self._variation_deg is not None:
            return speed, *along(course.value + self._variation_deg, speed.value)
        return None

    def _position(self, group: Quantities, mounting: Mounting) -> Iterator[Sample]:
        """North and east of the origin [m], of the reference point."""
        latitude, longitude = group.get("latitude_deg"), group.get("longitude_deg")
        if latitude is None or longitude is None:
            return
        if self._plane is None:
            if _line(latitude) not in self._positions_from or not _may_be_origin(latitude, longitude):
                return
            self._plane = TangentPlane(latitude.value, longitude.value)
        north, east = self._plane.north_east_m(latitude.value, longitude.value)
        if mounting.forward_m or mounting.starboard_m:
            heading_deg = self._heading_deg(latitude)
            if heading_deg is None:  # an antenna's place says nothing of the ship's without its heading
                return
            antenna = to_earth(mounting.forward_m, mounting.starboard_m, radians(heading_deg))
            north, east = north - float(antenna[0]), east - float(antenna[1])
        yield _derived(latitude, "north_m", north)
        yield _derived(latitude, "east_m", east)

    def _wind(self, group: Quantities) -> Iterator[Sample]:
        """Wind over ground from true north, from whatever reference the instrument has."""
        magnetic = group.get("wind_direction_magnetic_deg")
        if magnetic is not None and self._variation_deg is not None:
            yield _derived(magnetic, "wind_direction_deg", (magnetic.value + self._variation_deg) % 360.0)
        for kind, angle_name, speed_name in _BOW_WIND_NAMES:
            angle, speed = group.get(angle_name), group.get(speed_name)
            if angle is None or speed is None:
                continue
            if kind == "apparent":
                yield angle._replace(quantity="apparent_wind_angle_deg")
                yield speed._replace(quantity="apparent_wind_speed_mps")
            wind = self._over_ground_wind(kind, angle, speed.value)
            if wind is not None:
                yield _derived(angle, "wind_direction_deg", wind[0])
                yield _derived(angle, "wind_speed_mps", wind[1])

    def _over_ground_wind(self, kind: str, angle: Sample, speed_mps: float) -> tuple[float, float] | None:
        heading_deg = self._heading_deg(angle)
        if heading_deg is None:
            return None
        if kind == "theoretical":
            return wind_over_ground(angle.value, speed_mps, 0.0, 0.0, heading_deg)
        surge, sway = self._ship_value("surge_mps", angle), self._ship_value("sway_mps", angle)
        felt_deg, felt_mps = angle.value, speed_mps
        if kind == "water":
            through_water_mps = self._ship_value("speed_through_water_mps", angle)
            if through_water_mps is None:
                return None
            felt_deg, felt_mps = apparent_wind(angle.value, speed_mps, through_water_mps)
        if surge is None or sway is None:
            return None
        return wind_over_ground(felt_deg, felt_mps, surge, sway, heading_deg)


def _possible(samples: Group, limits: Mapping[str, Channel]) -> tuple[Group, int]:
    """The samples that can be true, angles within their turn, and how many cannot.

    Where one of a pair is impossible the other is not believed either: what comes of both, and the direction of
    a wind of 999 m/s, would be false.
    """
    possible = []
    for sample in samples:
        channel = limits.get(sample.quantity)
        if channel is None or channel.holds(sample.value):
            possible.append(sample)
        elif channel.circular and abs(sample.value) <= _WHOLE_TURN_DEG:
            possible.append(sample._replace(value=channel.wrapped(sample.value)))
    if len(possible) < len(samples):
        possible_quantities = {sample.quantity for sample in possible}
        lost = {sample.quantity for sample in samples} - possible_quantities
        possible = [sample for sample in possible if lost.isdisjoint(_PARTNERS.get(sample.quantity, ()))]
    return possible, len(samples) - len(possible)


def _may_be_origin(latitude: Sample, longitude: Sample) -> bool:
    """A simulator's fix, or one by dead reckoning, is no origin; nor is 0, 0, which receivers tell before a fix."""
    sound = latitude.quality in (Quality.GOOD, Quality.NOT_EVALUATED)
    return sound and (latitude.value, longitude.value) != (0.0, 0.0)


def _derived(sample: Sample, quantity: str, value: float) -> Sample:
    source = sample.source if sample.source.endswith(" derived") else f"{sample.source} derived"
    return Sample(quantity, value, source, *sample[3:])  # as _replace() would, in half the time


def _line(sample: Sample) -> str:
    return sample.source.partition("/")[0]
