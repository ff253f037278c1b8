"""Effects on what must be accelerated."""

from __future__ import annotations

from hybrid.effects.effect import Effect, Parameter

LOADING = Effect(
    "loading",
    family="inertia",
    kind="physics",
    what="Another loading: mass and yaw inertia times a factor, added mass unchanged",
    source="Rigid-body inertia at like radius of gyration",
    parameters=(Parameter("mass_factor", "1", 1.0, 0.3, 3.0, 1.15, 0.03),),
    change=lambda plant, values: plant.scaled(values["mass_factor"], "mass_kg", "yaw_inertia_kgm2"),
)
