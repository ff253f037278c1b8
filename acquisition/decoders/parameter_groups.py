"""What the parameter groups of NMEA 2000 that we listen to mean to us: one reader function a group."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable
from math import pi
from typing import NamedTuple

from acquisition.core.frames import Quality
from acquisition.core.units import DEG_PER_RAD
from acquisition.decoders.clock import utc_ns
from acquisition.decoders.parameter_fields import GNSS_POSITION, SYSTEM_TIME, TIME_AND_DATE, Message, Value

_DAY_S = 86_400
_WHOLE_TURN_RAD = 2 * pi + 1e-4  # a whole turn rounded up to the wire's step
_NO_FIX, _NO_FIX_ERROR = 0, 14
_SATELLITE_METHODS = range(1, 6)  # above them dead reckoning, manual input, simulator and what is not defined yet
_MEASURED_MODES = range(2)  # of 130577: autonomous and differential; above them estimated, simulated, manual

Values = list[tuple[str, Value]]


class Reading(NamedTuple):
    """What a message says to us.

    ``meaning`` tells apart what one group may mean, ``instance`` which of several equal things it is about.
    """

    values: Iterable[tuple[str, Value]]
    meaning: str = ""
    quality: Quality = Quality.NOT_EVALUATED
    instance: int | None = None


def _given(values: Values) -> Values:
    """Without the values that are missing, where a device need not give them."""
    return [(name, value) for name, value in values if not isinstance(value, str)]


def _together(values: Values) -> Values:
    """Values of which one alone is of no use: all of them, or why there are none."""
    missing: Values = [(name, value) for name, value in values if isinstance(value, str)]
    return missing or values


def _clock(_message: Message) -> Reading:
    return Reading([])


def group_time(message: Message) -> int | None:
    """A message's date and time as ns since 1970; None if it does not say."""
    days, seconds = message["date"], message["time"]
    if isinstance(days, str) or isinstance(seconds, str) or seconds >= _DAY_S + 1:  # a leap second is possible
        return None
    return utc_ns(dt.date(1970, 1, 1) + dt.timedelta(days=days), seconds)


def _rudder(message: Message) -> Reading:
    """Several rudders are told apart by their instance; one that does not say which it is comes last."""
    instance = message["instance"]
    number = 255 if isinstance(instance, str) else int(instance)
    values: Values = [("rudder_angle_deg", message.degrees("position"))]
    return Reading(values, f"rudder {number}" if number else "", instance=number)


def _heading(message: Message) -> Reading:
    reference, heading = message["reference"], message["heading"]
    variation = _given([("magnetic_variation_deg", message.degrees("variation"))])
    if reference == 0:
        return Reading([("heading_deg", message.degrees("heading")), *variation])
    if reference != 1:
        return Reading([("heading_deg", "heading without a reference")])
    return Reading([("heading_magnetic_deg", _deviated_deg(heading, message["deviation"])), *variation])


def _deviated_deg(heading: Value, deviation: Value) -> Value:
    """A compass heading with its deviation, within a turn unless the heading itself is beyond one [deg]."""
    if isinstance(heading, str):
        return heading
    if isinstance(deviation, str) or heading > _WHOLE_TURN_RAD:
        return heading * DEG_PER_RAD
    if abs(deviation) > pi:
        return "impossible deviation"
    return (heading + deviation) * DEG_PER_RAD % 360.0


def _rate_of_turn(message: Message) -> Reading:
    return Reading([("yaw_rate_dps", message.degrees("rate"))])


def _attitude(message: Message) -> Reading:
    """Roll and pitch; the yaw does not say which north it refers to."""
    return Reading([("roll_deg", message.degrees("roll")), ("pitch_deg", message.degrees("pitch"))])


def _variation(message: Message) -> Reading:
    return Reading([("magnetic_variation_deg", message.degrees("variation"))])


def _speed(message: Message) -> Reading:
    return Reading([("speed_through_water_mps", message["speedWaterReferenced"])])


def _position(message: Message) -> Reading:
    return Reading(_together([("latitude_deg", message["latitude"]), ("longitude_deg", message["longitude"])]))


def _gnss_position(message: Message) -> Reading:
    """A position without a fix repeats an old one or invents one."""
    method = message["method"]
    if method in (_NO_FIX, _NO_FIX_ERROR):
        return Reading([("latitude_deg", "no fix")], quality=Quality.MISSING)
    quality = Quality.NOT_EVALUATED if method in _SATELLITE_METHODS else Quality.SUSPECT
    return Reading(_position(message).values, quality=quality)


def _course_and_speed(message: Message) -> Reading:
    course = {0: "course_over_ground_deg", 1: "course_magnetic_deg"}.get(int(message["cogReference"]))
    value = message.degrees("cog")
    if course is None:
        course, value = "course_over_ground_deg", value if isinstance(value, str) else "course without a reference"
    return Reading([(course, value), ("speed_over_ground_mps", message["sog"])])


def _direction_data(message: Message) -> Reading:
    """Course and speed only: heading, set and drift are worked out by the device from what others said."""
    quality = Quality.NOT_EVALUATED if message["dataMode"] in _MEASURED_MODES else Quality.SUSPECT
    return Reading(_course_and_speed(message).values, quality=quality)


def _speed_components(message: Message) -> Reading:
    return Reading(
        [
            ("surge_mps", message["longitudinalSpeedGroundReferenced"]),
            ("sway_mps", message["transverseSpeedGroundReferenced"]),
            *_given([("speed_through_water_mps", message["longitudinalSpeedWaterReferenced"])]),
        ]
    )


_WINDS = {
    0: ("wind_direction_deg", "wind_speed_mps", ""),
    1: ("wind_direction_magnetic_deg", "wind_speed_mps", "magnetic"),
    2: ("wind_angle_apparent_deg", "wind_speed_apparent_mps", "apparent"),
    3: ("wind_angle_theoretical_deg", "wind_speed_theoretical_mps", "theoretical"),
    4: ("wind_angle_water_deg", "wind_speed_water_mps", "water"),
}


def _wind(message: Message) -> Reading:
    known = _WINDS.get(int(message["reference"]))
    if known is None:
        return Reading([("wind_speed_mps", "wind without a reference")])
    angle, speed, meaning = known
    return Reading([(angle, message.degrees("windAngle")), (speed, message["windSpeed"])], meaning)


READERS: dict[int, Callable[[Message], Reading]] = {
    SYSTEM_TIME: _clock,
    127245: _rudder,
    127250: _heading,
    127251: _rate_of_turn,
    127257: _attitude,
    127258: _variation,
    128259: _speed,
    129025: _position,
    129026: _course_and_speed,
    GNSS_POSITION: _gnss_position,
    TIME_AND_DATE: _clock,
    130306: _wind,
    130577: _direction_data,
    130578: _speed_components,
}
"""The groups we listen to."""
