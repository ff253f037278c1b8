"""Effects that change most of the hull's coefficients at once: a longer hull, a bottom close below it."""

from __future__ import annotations

from math import pi, tan

from acquisition.core.errors import ConfigurationError
from hybrid.vessel.effect import Effect, Parameter, Values
from hybrid.vessel.plant import HULL, Plant

LATERAL_AREA_M2_PER_M = 4.0


def _order(name: str) -> int:
    """How often the yaw rate stands in a coefficient's name: each is a lever arm."""
    return name.count("r")


def _lengthened(plant: Plant, values: Values) -> Plant:
    added_m = values["length_m"]
    s = (plant.length_between_perpendiculars_m + added_m) / plant.length_between_perpendiculars_m
    plant = plant.scaled(s, "mass_kg", "Xud", "Yvd").scaled(s**2, "Yrd").scaled(s**3, "yaw_inertia_kgm2", "Nrd")
    for name in HULL:
        lever = 2 if name.startswith("N") else 1
        plant = plant.scaled(s**0.8 if name == "Xuu" else s ** (lever + _order(name)), name)
    places = [f"{each.name}_x_m" for each in plant.actuators]  # those ahead move ahead, those astern aft
    return plant.shifted(
        length_between_perpendiculars_m=added_m,
        length_overall_m=added_m,
        lateral_area_m2=LATERAL_AREA_M2_PER_M * added_m,
        **{name: (added_m if plant.number(name) > 0.0 else -added_m) / 2.0 for name in places},
    )


_TURNING = ("Yur", "Yuur", "Yrrr", "Y_absr_r", "Nur", "Nuur", "Nrrr", "N_absr_r")
_DRIFTING = [[name for name in HULL if name.startswith(axis) and name not in _TURNING] for axis in "YN"]


def aspect_growth(ratio: float, slenderness: float, exponent: float) -> float:
    """How the hull's effective aspect ratio k grows with draught over depth ``ratio`` (0 to below 1).

    Hirano et al. (1985): 1 / (k/2 ratio + g) with g = (y cot y)^exponent, y = pi/2 ratio, k = ``slenderness``
    = 2T/L. Their first term would make a bottom far below *reduce* the forces a little; its images in theory
    (Newman, J. Fluid Mech. 39, 1969) only add, by the square of the ratio. Here the term is k/2 (1 - g): the
    same at both ends, 1 in deep water and 2/k at the bottom, within 6 % of theirs between for usual ships,
    and growing throughout.
    """
    y = 0.5 * pi * ratio
    open_share = (y / tan(y)) ** exponent if y > 0.0 else 1.0
    return float(1.0 / (open_share + 0.5 * slenderness * (1.0 - open_share)))


def _shallow(plant: Plant, values: Values) -> Plant:
    """Derivatives of drift force, drift moment and turning grow with exponents 2.3, 1.7 and 0.7.

    Terms with both v and r count as drift. The factors belong to whole derivatives. Here the added-mass
    Coriolis terms stand beside the coefficients, so these are set to make the sums grow as they should; the
    sway and yaw added masses grow like the derivatives of drift. Resistance stays: what shallow water adds to
    it (Lackenby 1963) goes with the Froude number of the depth and is no coefficient of this model.
    """
    if values["depth_m"] <= plant.draught_m:
        raise ConfigurationError(
            f"effect shallow_water: depth_m = {values['depth_m']:g} is no more than the draught",
            fix=f"give more than {plant.draught_m:g} m",
        )
    ratio = plant.draught_m / values["depth_m"]
    slenderness = 2.0 * plant.draught_m / plant.length_between_perpendiculars_m
    force, moment, turning = (aspect_growth(ratio, slenderness, each) for each in (2.3, 1.7, 0.7))
    before = plant
    plant = plant.scaled(force, "Yvd", *_DRIFTING[0]).scaled(moment, "Nrd", *_DRIFTING[1])
    plant = plant.scaled(turning, *_TURNING)
    return plant.shifted(
        Nuv=(moment - force) * before.Yvd - (moment - 1.0) * before.Xud,
        Yur=(turning - 1.0) * before.Xud,
        Nur=(turning - 1.0) * before.Yrd,
    )


HULL_LENGTHENING = Effect(
    "hull_lengthening",
    family="hull",
    kind="physics",
    what="A parallel section put in amidships: mass, added mass and hull coefficients grow with the length",
    source="Strip-wise scaling of sectional coefficients with length, one lever arm for each r",
    parameters=(Parameter("length_m", "m", 0.0, -10.0, 20.0, 3.0, 0.5),),
    change=_lengthened,
    confused_with=(
        "loading",
        "skeg",
        "trim",
        "yaw_damping",
    ),
)
SHALLOW_WATER = Effect(
    "shallow_water",
    family="hull",
    kind="physics",
    what="The bottom near the keel: sway and yaw derivatives and added mass grow as draught over depth does",
    source="Hirano et al., An experimental study on maneuvering hydrodynamic forces in shallow water, "
    "Trans. West-Japan SNA 69 (1985)",
    parameters=(Parameter("depth_m", "m", float("inf"), 3.0, float("inf"), 8.0, 25.0),),
    change=_shallow,
    chart="inverse_square",
    confused_with=("drift_force", "turning_force"),
)
