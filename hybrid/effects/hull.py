"""Effects on the hull's own forces: its length, its surface, its damping, the bottom below it."""

from __future__ import annotations

from dataclasses import replace
from math import pi, tan

from hybrid.effects.effect import Effect, Parameter, Values
from hybrid.vessel.plant import HULL, Plant

LATERAL_AREA_M2_PER_M = 4.0
_RESISTANCE = "Xuu"


def _order(name: str) -> int:
    """How often the yaw rate stands in a coefficient's name: each is a lever arm."""
    return name.count("r")


def _lengthened(plant: Plant, values: Values) -> Plant:
    added_m = values["length_m"]
    s = (plant.length_between_perpendiculars_m + added_m) / plant.length_between_perpendiculars_m
    plant = plant.scaled(s, "mass_kg", "Xud", "Yvd").scaled(s**2, "Yrd").scaled(s**3, "yaw_inertia_kgm2", "Nrd")
    for name in HULL:
        lever = 2 if name.startswith("N") else 1
        plant = plant.scaled(s**0.8 if name == _RESISTANCE else s ** (lever + _order(name)), name)
    return plant.shifted(
        length_between_perpendiculars_m=added_m,
        length_overall_m=added_m,
        lateral_area_m2=LATERAL_AREA_M2_PER_M * added_m,
        port_x_m=-added_m / 2.0,
        starboard_x_m=-added_m / 2.0,
        tunnel_x_m=added_m / 2.0,
    )


_TURNING = ("Yur", "Yuur", "Yrrr", "Y_absr_r", "Nur", "Nuur", "Nrrr", "N_absr_r")
_DRIFTING = [[name for name in HULL if name.startswith(axis) and name not in _TURNING] for axis in "YN"]


def _aspect_growth(ratio: float, slenderness: float, exponent: float) -> float:
    """How the hull's effective aspect ratio grows with draught over depth (Hirano et al. 1985).

    1 / (k T/2h + (y cot y)^exponent) with y = pi T/2h and k = 2T/L; one in infinitely deep water.
    """
    y = 0.5 * pi * ratio
    narrowing = y / tan(y) if y > 0.0 else 1.0
    return float(1.0 / (0.5 * ratio * slenderness + narrowing**exponent))


def _shallow(plant: Plant, values: Values) -> Plant:
    """Derivatives of drift force, drift moment and turning grow with exponents 2.3, 1.7 and 0.7.

    Terms with both v and r count as drift. The factors belong to whole derivatives. Here the added-mass
    Coriolis terms stand beside the coefficients, so these are set to make the sums grow as they should; the
    sway and yaw added masses grow like the derivatives of drift.
    """
    ratio = plant.draught_m / values["depth_m"]
    slenderness = 2.0 * plant.draught_m / plant.length_between_perpendiculars_m
    force, moment, turning = (_aspect_growth(ratio, slenderness, each) for each in (2.3, 1.7, 0.7))
    before = plant
    plant = plant.scaled(force, "Yvd", *_DRIFTING[0]).scaled(moment, "Nrd", *_DRIFTING[1])
    plant = plant.scaled(turning, *_TURNING)
    return plant.shifted(
        Nuv=(moment - force) * before.Yvd - (moment - 1.0) * before.Xud,
        Yur=(turning - 1.0) * before.Xud,
        Nur=(turning - 1.0) * before.Yrd,
    )


def _factor(neutral_name: str, typical: float, smallest: float) -> tuple[Parameter, ...]:
    return (Parameter(neutral_name, "1", 1.0, 0.0, 5.0, typical, smallest),)


HULL_LENGTHENING = Effect(
    "hull_lengthening",
    family="hull",
    kind="physics",
    what="A parallel section put in amidships: mass, added mass and hull coefficients grow with the length",
    source="Strip-wise scaling of sectional coefficients with length, one lever arm for each r",
    parameters=(Parameter("length_m", "m", 0.0, -10.0, 20.0, 3.0, 0.5),),
    change=_lengthened,
)
HULL_FOULING = Effect(
    "hull_fouling",
    family="hull",
    kind="physics",
    what="Growth on the hull: straight-ahead resistance Xuu times a factor",
    source="Schultz, Effects of coating roughness and biofouling on ship resistance, Biofouling 23 (2007)",
    parameters=_factor("resistance_factor", 1.2, 0.05),
    change=lambda plant, values: plant.scaled(values["resistance_factor"], _RESISTANCE),
)
CROSS_FLOW_DRAG = Effect(
    "cross_flow_drag",
    family="hull",
    kind="physics",
    what="Cross-flow drag of the hull: Y|v|v and N|v|v times a factor",
    source="Faltinsen, Sea Loads on Ships and Offshore Structures, ch. 6",
    parameters=_factor("factor", 1.5, 0.15),
    change=lambda plant, values: plant.scaled(values["factor"], "Y_absv_v", "N_absv_v"),
)
YAW_DAMPING = Effect(
    "yaw_damping",
    family="hull",
    kind="physics",
    what="Resistance of the hull to turning: Nur, Nuur, Nrrr and N|r|r times a factor",
    source="Uncertainty of rotary derivatives: Skejic and Faltinsen, J. Mar. Sci. Technol. 13 (2008)",
    parameters=_factor("factor", 1.15, 0.05),
    change=lambda plant, values: plant.scaled(values["factor"], "Nur", "Nuur", "Nrrr", "N_absr_r"),
)
SHALLOW_WATER = Effect(
    "shallow_water",
    family="hull",
    kind="physics",
    what="The bottom near the keel: sway and yaw derivatives and added mass grow as draught over depth does",
    source="Hirano et al., Manoeuvring hydrodynamic forces in shallow water, West-Japan SNA 69 (1985)",
    parameters=(Parameter("depth_m", "m", float("inf"), 3.0, float("inf"), 8.0, 25.0),),
    change=_shallow,
    chart="inverse",
)


def _towed(plant: Plant, values: Values) -> Plant:
    return replace(plant, constant_X_n=plant.constant_X_n - values["force_n"])


TOWED_LOAD = Effect(
    "towed_load",
    family="hull",
    kind="physics",
    what="Something towed astern: a steady force aft",
    source="Constant body force, the simplest form of a tow",
    parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
    change=_towed,
)
