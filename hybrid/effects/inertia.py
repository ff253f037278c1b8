"""Effects on what must be accelerated: the ship's own mass and the water that goes with her.

An added mass stands in the mass matrix and in the Coriolis terms of the hull's forces, where -Xud and -Yvd
make the Munk moment; a factor on it acts in both, as it does in nature.
"""

from __future__ import annotations

from hybrid.vessel.effect import scaling

_REGRESSIONS = "Clarke, Gedling and Hine, Manoeuvring criteria in hull design, Trans. RINA 125 (1983)"

LOADING = scaling(
    "loading",
    "inertia",
    ("mass_kg", "yaw_inertia_kgm2"),
    (1.15, 0.03),
    what="Another loading: mass and yaw inertia times a factor, added mass unchanged",
    source="Rigid-body inertia at like radius of gyration",
    parameter="mass_factor",
    bounds=(0.3, 3.0),
    confused_with=("hull_lengthening", "surge_added_mass", "sway_added_mass", "turning_force", "yaw_inertia"),
)
SURGE_ADDED_MASS = scaling(
    "surge_added_mass",
    "inertia",
    ("Xud",),
    (1.5, 0.15),
    what="The water's inertia in surge: Xud times a factor, in the mass and in the Coriolis terms Y, N of u r, u v",
    source="Newman, Marine Hydrodynamics (1977), ch. 4",
    confused_with=("drift_moment", "loading", "sway_added_mass", "trim", "yaw_damping"),
)
SWAY_ADDED_MASS = scaling(
    "sway_added_mass",
    "inertia",
    ("Yvd",),
    (1.2, 0.05),
    what="The water's inertia in sway: Yvd times a factor, in the mass and in the Coriolis terms X, N of v r, u v",
    source=_REGRESSIONS,
    confused_with=("drift_moment", "loading", "skeg", "surge_added_mass", "trim", "yaw_damping"),
)
YAW_INERTIA = scaling(
    "yaw_inertia",
    "inertia",
    ("yaw_inertia_kgm2", "Nrd"),
    (1.2, 0.08),
    what="The inertia in yaw: Iz and Nrd times a factor, masses where they were",
    source=_REGRESSIONS,
    bounds=(0.3, 3.0),
    confused_with=("command_delay", "loading", "thruster_lag"),
)
