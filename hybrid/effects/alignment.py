"""Effects of things that do not point where they should, and of a hull that is not symmetric."""

from __future__ import annotations

from math import radians

from hybrid.effects.effect import Effect, Parameter, Values
from hybrid.vessel.plant import Plant


def _offset(name: str, sides: tuple[str, ...], confused_with: tuple[str, ...]) -> Effect:
    def change(plant: Plant, values: Values) -> Plant:
        offset = radians(values["angle_deg"])
        return plant.shifted(**{f"{side}_angle_offset_rad": offset for side in sides})

    return Effect(
        name,
        family="alignment",
        kind="actuator",
        what=f"The {' and '.join(sides)} azimuth points elsewhere: true angle = reported + offset",
        source="Zero of the azimuth feedback",
        parameters=(Parameter("angle_deg", "deg", 0.0, -30.0, 30.0, 2.5, 0.5, tolerance=0.1),),
        change=change,
        confused_with=confused_with,
    )


AZIMUTH_OFFSET_PORT = _offset(
    "azimuth_offset_port",
    ("port",),
    ("azimuth_offset_both", "azimuth_offset_starboard", "sway_asymmetry", "yaw_asymmetry"),
)
AZIMUTH_OFFSET_STARBOARD = _offset(
    "azimuth_offset_starboard",
    ("starboard",),
    ("azimuth_offset_both", "azimuth_offset_port", "sway_asymmetry", "yaw_asymmetry"),
)
AZIMUTH_OFFSET_BOTH = _offset(
    "azimuth_offset_both",
    ("port", "starboard"),
    ("azimuth_offset_port", "azimuth_offset_starboard", "sway_asymmetry", "yaw_asymmetry"),
)
AZIMUTH_SCALE = Effect(
    "azimuth_scale",
    family="alignment",
    kind="actuator",
    what="Both azimuths turn more than they report: true angle = factor x reported, from ahead either way",
    source="Gain of the azimuth feedback",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 1.5, 1.05, 0.02, tolerance=0.002),),
    change=lambda plant, values: plant.scaled(values["factor"], "azimuth_scale"),
    confused_with=("hull_lengthening", "skeg", "trim", "yaw_damping"),
)
YAW_ASYMMETRY = Effect(
    "yaw_asymmetry",
    family="alignment",
    kind="physics",
    what="A steady yaw moment, as of a bent skeg or a list",
    source="Constant body moment",
    parameters=(Parameter("moment_nm", "N m", 0.0, -1e6, 1e6, 40e3, 10e3),),
    change=lambda plant, values: plant.shifted(constant_N_nm=values["moment_nm"]),
    confused_with=(
        "azimuth_offset_both",
        "azimuth_offset_port",
        "azimuth_offset_starboard",
        "thrust_loss_port",
        "thrust_loss_starboard",
    ),
)
SWAY_ASYMMETRY = Effect(
    "sway_asymmetry",
    family="alignment",
    kind="physics",
    what="A steady force to starboard, as of a list or a bent keel",
    source="Constant body force",
    parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
    change=lambda plant, values: plant.shifted(constant_Y_n=values["force_n"]),
    confused_with=("azimuth_offset_both", "azimuth_offset_port", "azimuth_offset_starboard", "heading_bias"),
)
