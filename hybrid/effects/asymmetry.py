"""Effects of a hull that is not symmetric."""

from __future__ import annotations

from hybrid.vessel.effect import Effect, Parameter

YAW_ASYMMETRY = Effect(
    "yaw_asymmetry",
    family="alignment",
    kind="physics",
    what="A steady yaw moment, as of a bent skeg or a list",
    source="Constant body moment",
    parameters=(Parameter("moment_nm", "N m", 0.0, -1e6, 1e6, 40e3, 10e3),),
    change=lambda plant, values: plant.shifted(constant_N_nm=values["moment_nm"]),
)
SWAY_ASYMMETRY = Effect(
    "sway_asymmetry",
    family="alignment",
    kind="physics",
    what="A steady force to starboard, as of a list or a bent keel",
    source="Constant body force",
    parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
    change=lambda plant, values: plant.shifted(constant_Y_n=values["force_n"]),
    confused_with=("heading_bias",),
)
