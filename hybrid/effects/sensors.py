"""Effects of sensors and clocks: the ship moves as ever and is reported otherwise or late; drives that act late."""

from __future__ import annotations

from functools import partial

from seatrial.hybrid.vessel.effect import Effect, Parameter, multiplied, shifted

_TOLERANCE_S = 0.03  # a fraction of a sample, of buses and of time stamps
_DELAY = Parameter("seconds", "s", 0.0, -5.0, 5.0, 0.5, 0.1, _TOLERANCE_S)
_ANGLE = Parameter("angle_deg", "deg", 0.0, -20.0, 20.0, 1.0, 0.2, tolerance=0.1)
_POINT = (
    Parameter("forward_m", "m", 0.0, -40.0, 40.0, 2.0, 0.5, tolerance=0.1),
    Parameter("starboard_m", "m", 0.0, -20.0, 20.0, 1.0, 0.5, tolerance=0.1),
)
"""Where a sensor is, from the reference point."""

_GYROS = "Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, ch. 4"

_delay = partial(Effect, family="clock", kind="sensor", parameters=(_DELAY,), scope="recording")
_sensor = partial(Effect, family="sensor", kind="sensor", scope="recording")

EFFECTS = (
    _delay(
        "position_delay", change=shifted("position_delay_s"),
        what="Positions are stamped too late: the recorded one is where the ship was so many seconds before",
        source="Latency of the positioning system",
        confused_with=("position_antenna_offset",),
    ),
    _delay(
        "heading_delay", change=shifted("heading_delay_s"),
        what="Headings are stamped too late: the recorded one is that of so many seconds before",
        source="Latency of the heading sensor and its filter",
    ),
    _delay(
        "speed_delay", change=shifted("speed_delay_s"),
        what="Surge, sway and yaw rate are stamped too late: recorded are those of so many seconds before",
        source="Latency of the motion sensor and its filter",
    ),
    _delay(
        "command_delay", change=shifted("command_delay_s"), kind="actuator",
        what="The drives' feedback is stamped too late: what acts is recorded so many seconds after; "
        "negative, before",
        source="Latency of the drives' bus",
        confused_with=("heading_delay", "thruster_lag"),
    ),
    Effect(
        "thruster_lag", family="clock", kind="actuator", change=shifted("thruster_lag_s"),
        what="Shaft speeds and angles that act follow the reported ones with a first-order lag",
        source="First-order actuator model; feedback has none, orders have about a second",
        parameters=(Parameter("time_constant_s", "s", 0.0, 0.0, 20.0, 1.0, 0.3, _TOLERANCE_S),),
        confused_with=("heading_delay",),
    ),
    _sensor(
        "heading_bias", parameters=(_ANGLE,), change=shifted("heading_bias_rad"),
        what="The compass: reported heading = true + bias",
        source="Alignment of the heading sensor",
        confused_with=("ocean_current", "speed_sensor_rotation", "sway_asymmetry", "sway_bias"),
    ),
    _sensor(
        "position_antenna_offset", parameters=_POINT, change=shifted("antenna_forward_m", "antenna_starboard_m"),
        what="The recorded position is that of a point off the reference point",
        source="Lever arm of the positioning antenna",
    ),
    _sensor(
        "speed_sensor_offset", parameters=_POINT,
        change=shifted("speed_sensor_forward_m", "speed_sensor_starboard_m"),
        what="Reported surge and sway are those of a point off the reference point: u - starboard r, v + forward r",
        source="Velocity of another point of a rigid body",
    ),
    _sensor(
        "speed_sensor_rotation", parameters=(_ANGLE,), change=shifted("speed_sensor_angle_rad"),
        what="The speed sensor is turned clockwise: surge and sway are reported along its axes",
        source="Alignment of the speed log or motion sensor",
        confused_with=("sway_bias",),
    ),
    _sensor(
        "speed_scale", parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.003, tolerance=0.002),),
        change=multiplied("speed_scale"),
        what="Reported surge and sway = factor x true",
        source="A wrong knot, or the calibration of a speed log",
    ),
    _sensor(
        "sway_bias", parameters=(Parameter("speed_mps", "m/s", 0.0, -2.0, 2.0, 0.1, 0.02, tolerance=0.01),),
        change=shifted("sway_bias_mps"),
        what="Reported sway = true + bias",
        source="Zero of the speed log or motion sensor",
    ),
    _sensor(
        "yaw_rate_bias", parameters=(Parameter("rate_dps", "deg/s", 0.0, -2.0, 2.0, 0.05, 0.01, tolerance=0.002),),
        change=shifted("yaw_rate_bias_radps"),
        what="The rate gyro: reported yaw rate = true + bias",
        source=_GYROS,
    ),
    _sensor(
        "yaw_rate_scale", parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.005, tolerance=0.002),),
        change=multiplied("yaw_rate_scale"),
        what="The rate gyro: reported yaw rate = factor x true",
        source=_GYROS,
    ),
    _sensor(
        "wind_direction_bias",
        parameters=(Parameter("angle_deg", "deg", 0.0, -180.0, 180.0, 20.0, 5.0, tolerance=3.0),),
        change=shifted("wind_direction_bias_rad"),
        what="The wind vane: reported direction = true + bias",
        source="Alignment of the wind sensor",
    ),
    _sensor(
        "wind_speed_scale", parameters=(Parameter("factor", "1", 1.0, 0.3, 3.0, 1.2, 0.1, tolerance=0.03),),
        change=multiplied("wind_speed_factor"),
        what="The wind sensor: reported speed = factor x true",
        source="Calibration of the anemometer, and the flow over the deckhouse it stands in",
        confused_with=("wind_drag", "wind_side_load", "wind_yaw_load"),
    ),
)  # fmt: skip
"""Clocks first, then each instrument."""
