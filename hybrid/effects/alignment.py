"""Effects of things that do not point where they should."""

from __future__ import annotations

from math import radians

from hybrid.effects.effect import Effect, Parameter, Values
from hybrid.vessel.plant import Plant


def _offset(name: str, *sides: str) -> Effect:
    def change(plant: Plant, values: Values) -> Plant:
        offset = radians(values["angle_deg"])
        return plant.shifted(**{f"{side}_angle_offset_rad": offset for side in sides})

    return Effect(
        name,
        family="alignment",
        kind="actuator",
        what=f"The {' and '.join(sides)} azimuth points elsewhere: true angle = reported + offset",
        source="Zero of the azimuth feedback",
        parameters=(Parameter("angle_deg", "deg", 0.0, -30.0, 30.0, 2.5, 0.5),),
        change=change,
    )


AZIMUTH_OFFSET_PORT = _offset("azimuth_offset_port", "port")
AZIMUTH_OFFSET_STARBOARD = _offset("azimuth_offset_starboard", "starboard")
AZIMUTH_OFFSET_BOTH = _offset("azimuth_offset_both", "port", "starboard")
YAW_ASYMMETRY = Effect(
    "yaw_asymmetry",
    family="alignment",
    kind="physics",
    what="A steady yaw moment, as of a bent skeg or a list",
    source="Constant body moment",
    parameters=(Parameter("moment_nm", "N m", 0.0, -1e6, 1e6, 40e3, 10e3),),
    change=lambda plant, values: plant.shifted(constant_N_nm=values["moment_nm"]),
)
