"""Effects of the environment: water and air that move, waves that push.

Effects of sensors and clocks: the ship moves as ever and is reported otherwise or late; drives that act late.
"""

from __future__ import annotations

from functools import partial
from math import cos, hypot, radians, sin

from numba import njit

from seatrial.hybrid.vessel.effect import DIRECTION, Effect, Parameter, Values, multiplied, scaling, shifted
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.wind import wind_force


def _add_drift_force(plant: Plant, values: Values) -> Plant:
    force, to_rad = values["force_n"], radians(values["direction_deg"])
    north = plant.drift_force_n * plant.drift_north + force * cos(to_rad)
    east = plant.drift_force_n * plant.drift_east + force * sin(to_rad)
    total = hypot(north, east)
    if total == 0.0:
        return plant.replaced(drift_force_n=0.0)
    return plant.replaced(drift_force_n=total, drift_north=north / total, drift_east=east / total)


@njit(error_model="numpy")
def _wind_minus_still_air(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
    """What a steady wind does beyond still air, which the model has where none was recorded."""
    cosine, sine, u, v = cos(state[2]), sin(state[2]), state[3], state[4]
    north, east = parameters
    u_air, v_air = north * cosine + east * sine, east * cosine - north * sine
    X, Y, N = wind_force(environment.plant, u - u_air, v - v_air)
    still_X, still_Y, still_N = wind_force(environment.plant, u, v)
    return X - still_X, Y - still_Y, N - still_N


def _wind_coefficient_effect(name: str, coefficient: str, what: str, confused_with: tuple[str, ...] = ()) -> Effect:
    return scaling(
        name,
        "environment",
        (coefficient,),
        (1.5, 0.2),
        what=f"{what}: {coefficient} times a factor at every angle",
        source="Isherwood, Wind resistance of merchant ships, Trans. RINA 115 (1973): scatter of each coefficient",
        confused_with=confused_with,
        excluded_by=("no wind",),
    )


EFFECTS = (
    Effect(
        "ocean_current", family="environment", kind="physics",
        what="Steady uniform current: hull and pods feel the velocity relative to the moving water",
        source="Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 10",
        parameters=(Parameter("speed_mps", "m/s", 0.0, 0.0, 3.0, 0.2, 0.03), DIRECTION),
        change=lambda plant, values: plant.shifted(
            current_north_mps=values["speed_mps"] * cos(radians(values["direction_deg"])),
            current_east_mps=values["speed_mps"] * sin(radians(values["direction_deg"])),
        ),
        chart="polar",
        confused_with=("speed_scale",),
        scope="day",
        excluded_by=("still water",),
    ),
    Effect(
        "wave_drift", family="environment", kind="physics",
        what="Mean second-order wave force: 0.35 F cos b ahead, F sin b abeam, 0.06 Loa F sin 2b in yaw",
        source="Form of the mean drift force over the wave angle, after Faltinsen, Sea Loads (1990), ch. 5",
        parameters=(Parameter("force_n", "N", 0.0, 0.0, 60e3, 2e3, 500.0), DIRECTION),
        change=_add_drift_force,
        chart="polar",
        confused_with=("ocean_current", "wind_direction_bias", "wind_side_load", "wind_speed_scale"),
        scope="day",
        excluded_by=("still water", "no waves"),
    ),
    scaling(
        "wind_load", "environment", ("wind_load_factor",), (1.5, 0.2),
        what="All wind coefficients times a factor: more or less windage than the tables say",
        source="Blendermann, Parameter identification of wind loads on ships, J. Wind Eng. Ind. Aerodyn. 51 (1994)",
        confused_with=(
            "wave_drift", "wind_direction_bias", "wind_drag", "wind_side_load", "wind_speed_scale", "wind_yaw_load",
        ),
        excluded_by=("no wind",),
    ),
    _wind_coefficient_effect("wind_drag", "CX", "Wind force along the ship"),
    _wind_coefficient_effect("wind_side_load", "CY", "Wind force across the ship"),
    _wind_coefficient_effect("wind_yaw_load", "CN", "Yaw moment of the wind", ("wind_direction_bias",)),
)  # fmt: skip
"""Current, waves and wind."""

STEADY_WIND = Effect(
    "steady_wind", family="environment", kind="physics",
    what="A steady wind, in a trial of which none was recorded: hull and house feel the air that moves",
    source="Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 10",
    parameters=(Parameter("speed_mps", "m/s", 0.0, 0.0, 40.0, 5.0, 0.5), DIRECTION),
    change=lambda plant, values: plant.with_force(
        _wind_minus_still_air,
        values["speed_mps"] * cos(radians(values["direction_deg"])),
        values["speed_mps"] * sin(radians(values["direction_deg"])),
    ) if values["speed_mps"] > 0.0 else plant,
    chart="polar",
    confused_with=("ocean_current", "wave_drift"),
    scope="day",
    excluded_by=("no wind",),
)  # fmt: skip
"""Of no ship and no plan: only a diagnosis without a record of the wind looks for it."""


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

SENSOR_EFFECTS = (
    _delay(
        "position_delay", change=shifted("position_delay_s"),
        what="Positions are stamped too late: the recorded one is where the ship was so many seconds before",
        source="Latency of the positioning system",
        confused_with=("position_antenna_offset",),
        excluded_by=("position surveyed", "clock surveyed"),
    ),
    _delay(
        "heading_delay", change=shifted("heading_delay_s"),
        what="Headings are stamped too late: the recorded one is that of so many seconds before",
        source="Latency of the heading sensor and its filter",
        excluded_by=("heading surveyed", "clock surveyed"),
    ),
    _delay(
        "speed_delay", change=shifted("speed_delay_s"),
        what="Surge, sway and yaw rate are stamped too late: recorded are those of so many seconds before",
        source="Latency of the motion sensor and its filter",
        excluded_by=("speed surveyed", "clock surveyed"),
    ),
    _delay(
        "command_delay", change=shifted("command_delay_s"), kind="actuator",
        what="The drives' feedback is stamped too late: what acts is recorded so many seconds after; "
        "negative, before",
        source="Latency of the drives' bus",
        confused_with=("heading_delay", "thruster_lag"),
        excluded_by=("clock surveyed",),
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
        excluded_by=("heading surveyed",),
    ),
    _sensor(
        "position_antenna_offset", parameters=_POINT, change=shifted("antenna_forward_m", "antenna_starboard_m"),
        what="The recorded position is that of a point off the reference point",
        source="Lever arm of the positioning antenna",
        excluded_by=("position surveyed",),
    ),
    _sensor(
        "speed_sensor_offset", parameters=_POINT,
        change=shifted("speed_sensor_forward_m", "speed_sensor_starboard_m"),
        what="Reported surge and sway are those of a point off the reference point: u - starboard r, v + forward r",
        source="Velocity of another point of a rigid body",
        excluded_by=("speed surveyed",),
    ),
    _sensor(
        "speed_sensor_rotation", parameters=(_ANGLE,), change=shifted("speed_sensor_angle_rad"),
        what="The speed sensor is turned clockwise: surge and sway are reported along its axes",
        source="Alignment of the speed log or motion sensor",
        confused_with=("sway_bias",),
        excluded_by=("speed surveyed",),
    ),
    _sensor(
        "speed_scale", parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.003, tolerance=0.002),),
        change=multiplied("speed_scale"),
        what="Reported surge and sway = factor x true",
        source="A wrong knot, or the calibration of a speed log",
        excluded_by=("speed surveyed",),
    ),
    _sensor(
        "sway_bias", parameters=(Parameter("speed_mps", "m/s", 0.0, -2.0, 2.0, 0.1, 0.02, tolerance=0.01),),
        change=shifted("sway_bias_mps"),
        what="Reported sway = true + bias",
        source="Zero of the speed log or motion sensor",
        excluded_by=("speed surveyed",),
    ),
    _sensor(
        "yaw_rate_bias", parameters=(Parameter("rate_dps", "deg/s", 0.0, -2.0, 2.0, 0.05, 0.01, tolerance=0.002),),
        change=shifted("yaw_rate_bias_radps"),
        what="The rate gyro: reported yaw rate = true + bias",
        source=_GYROS,
        excluded_by=("yaw rate surveyed",),
    ),
    _sensor(
        "yaw_rate_scale", parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.005, tolerance=0.002),),
        change=multiplied("yaw_rate_scale"),
        what="The rate gyro: reported yaw rate = factor x true",
        source=_GYROS,
        excluded_by=("yaw rate surveyed",),
    ),
    _sensor(
        "wind_direction_bias",
        parameters=(Parameter("angle_deg", "deg", 0.0, -180.0, 180.0, 20.0, 5.0, tolerance=3.0),),
        change=shifted("wind_direction_bias_rad"),
        what="The wind vane: reported direction = true + bias",
        source="Alignment of the wind sensor",
        excluded_by=("no wind", "wind surveyed"),
    ),
    _sensor(
        "wind_speed_scale", parameters=(Parameter("factor", "1", 1.0, 0.3, 3.0, 1.2, 0.1, tolerance=0.03),),
        change=multiplied("wind_speed_factor"),
        what="The wind sensor: reported speed = factor x true",
        source="Calibration of the anemometer, and the flow over the deckhouse it stands in",
        confused_with=("wind_drag", "wind_side_load", "wind_yaw_load"),
        excluded_by=("no wind", "wind surveyed"),
    ),
)  # fmt: skip
"""Clocks first, then each instrument."""
