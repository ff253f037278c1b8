"""Effects of sensors and clocks: the ship moves as ever and is reported otherwise or late; drives that act late."""

from __future__ import annotations

from math import radians

from hybrid.vessel.effect import Effect, Kind, Parameter, Values
from hybrid.vessel.plant import Plant

_TOLERANCE_S = 0.03  # a fraction of a sample, of buses and of time stamps


def _delay(
    name: str, slot: str, what: str, source: str, confused_with: tuple[str, ...] = (), kind: Kind = "sensor"
) -> Effect:
    return Effect(
        name,
        family="clock",
        kind=kind,
        what=what,
        source=source,
        parameters=(Parameter("seconds", "s", 0.0, -5.0, 5.0, 0.5, 0.1, _TOLERANCE_S),),
        change=lambda plant, values: plant.shifted(**{slot: values["seconds"]}),
        confused_with=confused_with,
        scope="recording",
    )


_GYROS = "Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, ch. 4"
_RIGID = "Velocity of another point of a rigid body"


def _sensor(
    name: str, parameter: Parameter, slot: str, *, what: str, source: str, confused_with: tuple[str, ...] = ()
) -> Effect:
    """A factor on the plant's slot, where one is neutral, or an amount added to it, in radians for degrees."""
    factor, degrees = parameter.neutral == 1.0, parameter.unit.startswith("deg")

    def change(plant: Plant, values: Values) -> Plant:
        value = values[parameter.name]
        if factor:
            return plant.scaled(value, slot)
        return plant.shifted(**{slot: radians(value) if degrees else value})

    return Effect(
        name, "sensor", "sensor", what, source, (parameter,), change, confused_with=confused_with, scope="recording"
    )


def _point(name: str, slots: str, what: str, source: str, confused_with: tuple[str, ...] = ()) -> Effect:
    """A sensor away from the reference point."""
    return Effect(
        name,
        family="sensor",
        kind="sensor",
        what=what,
        source=source,
        parameters=(
            Parameter("forward_m", "m", 0.0, -40.0, 40.0, 2.0, 0.5, tolerance=0.1),
            Parameter("starboard_m", "m", 0.0, -20.0, 20.0, 1.0, 0.5, tolerance=0.1),
        ),
        change=lambda plant, values: plant.shifted(**{
            f"{slots}_forward_m": values["forward_m"], f"{slots}_starboard_m": values["starboard_m"]
        }),
        confused_with=confused_with,
        scope="recording",
    )  # fmt: skip


EFFECTS = (
    _delay(
        "position_delay", "position_delay_s",
        "Positions are stamped too late: the recorded one is where the ship was so many seconds before",
        "Latency of the positioning system", ("position_antenna_offset",),
    ),
    _delay(
        "heading_delay", "heading_delay_s",
        "Headings are stamped too late: the recorded one is that of so many seconds before",
        "Latency of the heading sensor and its filter",
    ),
    _delay(
        "speed_delay", "speed_delay_s",
        "Surge, sway and yaw rate are stamped too late: recorded are those of so many seconds before",
        "Latency of the motion sensor and its filter",
    ),
    _delay(
        "command_delay", "command_delay_s",
        "The drives' feedback is stamped too late: what acts is recorded so many seconds after; negative, before",
        "Latency of the drives' bus", ("heading_delay", "thruster_lag"), "actuator",
    ),
    Effect(
        "thruster_lag", family="clock", kind="actuator",
        what="Shaft speeds and angles that act follow the reported ones with a first-order lag",
        source="First-order actuator model; feedback has none, orders have about a second",
        parameters=(Parameter("time_constant_s", "s", 0.0, 0.0, 20.0, 1.0, 0.3, _TOLERANCE_S),),
        change=lambda plant, values: plant.shifted(thruster_lag_s=values["time_constant_s"]),
        confused_with=("heading_delay",),
    ),
    _sensor(
        "heading_bias", Parameter("angle_deg", "deg", 0.0, -20.0, 20.0, 1.0, 0.2, tolerance=0.1),
        "heading_bias_rad",
        what="The compass: reported heading = true + bias",
        source="Alignment of the heading sensor",
        confused_with=("ocean_current", "speed_sensor_rotation", "sway_asymmetry", "sway_bias"),
    ),
    _point(
        "position_antenna_offset", "antenna",
        "The recorded position is that of a point off the reference point",
        "Lever arm of the positioning antenna",
    ),
    _point(
        "speed_sensor_offset", "speed_sensor",
        "Reported surge and sway are those of a point off the reference point: u - starboard r, v + forward r",
        _RIGID,
    ),
    _sensor(
        "speed_sensor_rotation", Parameter("angle_deg", "deg", 0.0, -20.0, 20.0, 1.0, 0.2, tolerance=0.1),
        "speed_sensor_angle_rad",
        what="The speed sensor is turned clockwise: surge and sway are reported along its axes",
        source="Alignment of the speed log or motion sensor",
        confused_with=("sway_bias",),
    ),
    _sensor(
        "speed_scale", Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.003, tolerance=0.002), "speed_scale",
        what="Reported surge and sway = factor x true",
        source="A wrong knot, or the calibration of a speed log",
    ),
    _sensor(
        "sway_bias", Parameter("speed_mps", "m/s", 0.0, -2.0, 2.0, 0.1, 0.02, tolerance=0.01), "sway_bias_mps",
        what="Reported sway = true + bias",
        source="Zero of the speed log or motion sensor",
    ),
    _sensor(
        "yaw_rate_bias", Parameter("rate_dps", "deg/s", 0.0, -2.0, 2.0, 0.05, 0.01, tolerance=0.002),
        "yaw_rate_bias_radps",
        what="The rate gyro: reported yaw rate = true + bias",
        source=_GYROS,
    ),
    _sensor(
        "yaw_rate_scale", Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.005, tolerance=0.002), "yaw_rate_scale",
        what="The rate gyro: reported yaw rate = factor x true",
        source=_GYROS,
    ),
    _sensor(
        "wind_direction_bias", Parameter("angle_deg", "deg", 0.0, -180.0, 180.0, 20.0, 5.0, tolerance=3.0),
        "wind_direction_bias_rad",
        what="The wind vane: reported direction = true + bias",
        source="Alignment of the wind sensor",
    ),
    _sensor(
        "wind_speed_scale", Parameter("factor", "1", 1.0, 0.3, 3.0, 1.2, 0.1, tolerance=0.03), "wind_speed_factor",
        what="The wind sensor: reported speed = factor x true",
        source="Calibration of the anemometer, and the flow over the deckhouse it stands in",
        confused_with=("wind_drag", "wind_side_load", "wind_yaw_load"),
    ),
)  # fmt: skip
"""Clocks first, then each instrument."""
