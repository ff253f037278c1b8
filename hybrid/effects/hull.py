"""Effects on the hull's own forces: the size of its coefficients, its surface, what is fixed to it."""

from __future__ import annotations

from math import pi

from hybrid.vessel.effect import Effect, Parameter, Values, scaling
from hybrid.vessel.plant import HULL, Plant

_REGRESSIONS = "Clarke, Gedling and Hine, Manoeuvring criteria in hull design, Trans. RINA 125 (1983)"
_DERIVATIVES = (
    "Inoue, Hirano and Kijima, Hydrodynamic derivatives on ship manoeuvring, Int. Shipb. Progr. 28 (1981)"
)
SKEG_LIFT_SLOPE = pi / 2.0
"""Of a slender fin of aspect ratio one, its mirror image in the hull counted: pi/2 times the aspect ratio."""

HULL_FOULING = scaling(
    "hull_fouling",
    "hull",
    ("Xuu",),
    (1.2, 0.05),
    what="Growth on the hull: straight-ahead resistance Xuu times a factor",
    source="Schultz, Effects of coating roughness and biofouling on ship resistance, Biofouling 23 (2007)",
    parameter="resistance_factor",
    confused_with=("towed_load",),
)
CROSS_FLOW_DRAG = scaling(
    "cross_flow_drag",
    "hull",
    ("Y_absv_v", "N_absv_v"),
    (1.5, 0.15),
    what="Cross-flow drag of the hull: Y|v|v and N|v|v times a factor",
    source="Faltinsen, Sea Loads on Ships and Offshore Structures (1990), ch. 6",
    confused_with=("drift_moment",),
)
YAW_DAMPING = scaling(
    "yaw_damping",
    "hull",
    ("Nur", "Nuur", "Nrrr", "N_absr_r"),
    (1.15, 0.05),
    what="Resistance of the hull to turning: Nur, Nuur, Nrrr and N|r|r times a factor",
    source=_REGRESSIONS,
    confused_with=(
        "drift_moment",
        "hull_lengthening",
        "skeg",
        "surge_added_mass",
        "sway_added_mass",
        "trim",
        "turning_force",
    ),
)
DRIFT_FORCE = scaling(
    "drift_force",
    "hull",
    ("Yuv", "Yuuv", "Yvvv"),
    (1.3, 0.1),
    what="Side force of the drifting hull: Yuv, Yuuv and Yvvv times a factor",
    source=_REGRESSIONS,
    confused_with=("shallow_water", "skeg", "turning_force"),
)
DRIFT_MOMENT = scaling(
    "drift_moment",
    "hull",
    ("Nuv", "Nuuv", "Nvvv"),
    (1.2, 0.05),
    what="Yaw moment of the drifting hull beside the Munk moment: Nuv, Nuuv and Nvvv times a factor",
    source=_REGRESSIONS,
    confused_with=("cross_flow_drag", "skeg", "surge_added_mass", "sway_added_mass", "trim", "yaw_damping"),
)
TURNING_FORCE = scaling(
    "turning_force",
    "hull",
    ("Yur", "Yuur", "Yrrr", "Y_absr_r"),
    (1.3, 0.1),
    what="Side force of the turning hull: Yur, Yuur, Yrrr and Y|r|r times a factor",
    source=_REGRESSIONS,
    confused_with=("drift_force", "loading", "shallow_water", "trim", "yaw_damping"),
)
TURNING_DRAG = scaling(
    "turning_drag",
    "hull",
    ("Xrr", "Xurr", "Xrv", "Xrvu"),
    (1.3, 0.1),
    what="Resistance of the turning hull: Xrr, Xurr, Xrv and Xrvu times a factor",
    source="Norrbin, Theory and observations on the use of a mathematical model for ship manoeuvring, SSPA 68",
)


def _trimmed(plant: Plant, values: Values) -> Plant:
    """Each coefficient of the side force gives the moment's of like name its lever arm."""
    return plant.shifted(**{
        name: values["shift_m"] * getattr(plant, f"Y{name[1:]}") for name in HULL if name.startswith("N")
    })  # fmt: skip


TRIM = Effect(
    "trim",
    family="hull",
    kind="physics",
    what="Trim by the head: the hull's side force acts further forward by the shift, N + shift Y",
    source=_DERIVATIVES,
    parameters=(Parameter("shift_m", "m", 0.0, -5.0, 5.0, 0.5, 0.1),),
    change=_trimmed,
    confused_with=(
        "drift_moment",
        "hull_lengthening",
        "skeg",
        "surge_added_mass",
        "sway_added_mass",
        "turning_force",
        "yaw_damping",
    ),
)


def stern_m(plant: Plant) -> float:
    """Where the actuators at the stern are, on average [m]; the after perpendicular where there is none."""
    aft = [x_m for each in plant.actuators if (x_m := plant.number(f"{each.name}_x_m")) < 0.0]
    return sum(aft) / len(aft) if aft else -0.5 * plant.length_between_perpendiculars_m


def _with_skeg(plant: Plant, values: Values) -> Plant:
    """Side force -rho/2 area slope u (v + x r) at the stern actuators' x: it adds to those of u v and u r."""
    x_m = stern_m(plant)
    lift = -0.5 * plant.water_density_kgpm3 * SKEG_LIFT_SLOPE * values["area_m2"]
    return plant.shifted(Yuv=lift, Yur=x_m * lift, Nuv=x_m * lift, Nur=x_m**2 * lift)


SKEG = Effect(
    "skeg",
    family="hull",
    kind="physics",
    what="More skeg: a low fin at the pods with side force -(pi/4) rho area u (v + x r); negative, less of it",
    source="Jones, Properties of low-aspect-ratio pointed wings, NACA Report 835 (1946); aspect ratio one",
    parameters=(Parameter("area_m2", "m2", 0.0, -10.0, 20.0, 2.0, 0.3),),
    change=_with_skeg,
    confused_with=(
        "drift_force",
        "drift_moment",
        "hull_lengthening",
        "sway_added_mass",
        "trim",
        "yaw_damping",
    ),
)
TOWED_LOAD = Effect(
    "towed_load",
    family="hull",
    kind="physics",
    what="Something towed astern: a steady force aft",
    source="Constant body force, the simplest form of a tow",
    parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
    change=lambda plant, values: plant.shifted(constant_X_n=-values["force_n"]),
    confused_with=("hull_fouling",),
)
