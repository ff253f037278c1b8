"""Effects of the sensors: the ship moves as ever and is reported otherwise."""

from __future__ import annotations

from math import radians

from hybrid.effects.effect import Effect, Parameter

HEADING_BIAS = Effect(
    "heading_bias",
    family="sensor",
    kind="sensor",
    what="The compass: reported heading = true + bias",
    source="Alignment of the heading sensor",
    parameters=(Parameter("angle_deg", "deg", 0.0, -20.0, 20.0, 1.0, 0.2),),
    change=lambda plant, values: plant.shifted(heading_bias_rad=radians(values["angle_deg"])),
)
POSITION_ANTENNA_OFFSET = Effect(
    "position_antenna_offset",
    family="sensor",
    kind="sensor",
    what="The recorded position is that of a point off the reference point",
    source="Lever arm of the positioning antenna",
    parameters=(
        Parameter("forward_m", "m", 0.0, -40.0, 40.0, 2.0, 0.5),
        Parameter("starboard_m", "m", 0.0, -20.0, 20.0, 1.0, 0.5),
    ),
    change=lambda plant, values: plant.shifted(
        antenna_forward_m=values["forward_m"], antenna_starboard_m=values["starboard_m"]
    ),
)
POSITION_DELAY = Effect(
    "position_delay",
    family="clock",
    kind="sensor",
    what="Positions are stamped too late: the recorded one is where the ship was so many seconds before",
    source="Latency of the positioning system",
    parameters=(Parameter("seconds", "s", 0.0, -5.0, 5.0, 0.5, 0.1),),
    change=lambda plant, values: plant.shifted(position_delay_s=values["seconds"]),
)
SPEED_SCALE = Effect(
    "speed_scale",
    family="sensor",
    kind="sensor",
    what="Reported surge and sway = factor x true",
    source="A wrong knot, or the calibration of a speed log",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, 1.02, 0.003),),
    change=lambda plant, values: plant.scaled(values["factor"], "speed_scale"),
)
WIND_DIRECTION_BIAS = Effect(
    "wind_direction_bias",
    family="sensor",
    kind="sensor",
    what="The wind vane: reported direction = true + bias",
    source="Alignment of the wind sensor",
    parameters=(Parameter("angle_deg", "deg", 0.0, -180.0, 180.0, 20.0, 5.0),),
    change=lambda plant, values: plant.shifted(wind_direction_bias_rad=radians(values["angle_deg"])),
)
