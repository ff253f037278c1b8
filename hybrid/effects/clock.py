"""Effects of time: what is stamped late, and drives that act late."""

from __future__ import annotations

from hybrid.vessel.effect import Effect, Kind, Parameter

_TOLERANCE_S = 0.03  # a fraction of a sample, of buses and of time stamps


def _delay(
    name: str, slot: str, what: str, source: str, confused_with: tuple[str, ...], kind: Kind = "sensor"
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
    )


POSITION_DELAY = _delay(
    "position_delay",
    "position_delay_s",
    "Positions are stamped too late: the recorded one is where the ship was so many seconds before",
    "Latency of the positioning system",
    ("position_antenna_offset",),
)
HEADING_DELAY = _delay(
    "heading_delay",
    "heading_delay_s",
    "Headings are stamped too late: the recorded one is that of so many seconds before",
    "Latency of the heading sensor and its filter",
    ("command_delay", "thruster_lag"),
)
SPEED_DELAY = _delay(
    "speed_delay",
    "speed_delay_s",
    "Surge, sway and yaw rate are stamped too late: recorded are those of so many seconds before",
    "Latency of the motion sensor and its filter",
    (),
)
COMMAND_DELAY = _delay(
    "command_delay",
    "command_delay_s",
    "The drives' feedback is stamped too late: what acts is recorded so many seconds after; negative, before",
    "Latency of the drives' bus",
    ("heading_delay", "thruster_lag", "yaw_inertia"),
    "actuator",
)
THRUSTER_LAG = Effect(
    "thruster_lag",
    family="clock",
    kind="actuator",
    what="Shaft speeds and angles that act follow the reported ones with a first-order lag",
    source="First-order actuator model; feedback has none, orders have about a second",
    parameters=(Parameter("time_constant_s", "s", 0.0, 0.0, 20.0, 1.0, 0.3, _TOLERANCE_S),),
    change=lambda plant, values: plant.shifted(thruster_lag_s=values["time_constant_s"]),
    confused_with=("command_delay", "heading_delay", "yaw_inertia"),
)
