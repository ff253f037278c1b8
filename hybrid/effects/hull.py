"""Effects of the hull: its coefficients, inertia and symmetry, its surface and length, a bottom close below it."""

from __future__ import annotations

from math import pi, tan
from operator import attrgetter

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.vessel.effect import Effect, Parameter, Values, scaling, shifted
from seatrial.hybrid.vessel.plant import Plant

_REGRESSIONS = "Clarke, Gedling and Hine, Manoeuvring criteria in hull design, Trans. RINA 125 (1983)"
_DERIVATIVES = (
    "Inoue, Hirano and Kijima, Hydrodynamic derivatives on ship manoeuvring, Int. Shipb. Progr. 28 (1981)"
)
SKEG_LIFT_SLOPE = pi / 2.0
"""Of a slender fin of aspect ratio one, its mirror image in the hull counted: pi/2 times the aspect ratio."""
LATERAL_AREA_M2_PER_M = 4.0


def in_plant(plant: Plant, name: str, si: float) -> float:
    """A number of SI [N, N m at its powers of speed and yaw rate] as a coefficient of the plant's hull model."""
    if not plant.hull_model.primed:
        return si
    length_m = plant.length_between_perpendiculars_m
    levers = name.startswith("N") + name.partition("_")[2].count("r")
    return si / (0.5 * plant.water_density_kgpm3 * length_m * plant.draught_m * length_m**levers)


def stern_m(plant: Plant) -> float:
    """Where the actuators at the stern are, on average [m]; the after perpendicular where there is none."""
    aft = [x_m for actuator in plant.layout if (x_m := plant.number(f"{actuator.name}_x_m")) < 0.0]
    return sum(aft) / len(aft) if aft else -0.5 * plant.length_between_perpendiculars_m


def _with_skeg(plant: Plant, values: Values) -> Plant:
    """Side force -rho/2 area slope u (v + x r) at the stern actuators' x: it adds to those of u v and u r."""
    x_m = stern_m(plant)
    lift = -0.5 * plant.water_density_kgpm3 * SKEG_LIFT_SLOPE * values["area_m2"]
    amounts = zip(plant.hull_model.linear, (lift, x_m * lift, x_m * lift, x_m**2 * lift), strict=True)
    return plant.shifted(**{name: in_plant(plant, name, amount) for name, amount in amounts})


def _lengthen(plant: Plant, values: Values) -> Plant:
    added_m = values["length_m"]
    s = (plant.length_between_perpendiculars_m + added_m) / plant.length_between_perpendiculars_m
    power = {"mass_kg": 1.0, "Xud": 1.0, "Yvd": 1.0, "Yrd": 2.0, "yaw_inertia_kgm2": 3.0, "Nrd": 3.0}
    hull = plant.hull_model
    for name in hull.numbers:  # those without dimension grow with their units; each r is a lever arm
        lever = 0 if hull.primed else (2 if name.startswith("N") else 1) + name.count("r")
        power[name] = lever - 0.2 if name in hull.resistance else lever
    plant = plant.replaced(**{name: s**exponent * plant.number(name) for name, exponent in power.items()})
    places = [f"{actuator.name}_x_m" for actuator in plant.layout]  # those ahead move ahead, those astern aft
    return plant.shifted(
        length_between_perpendiculars_m=added_m,
        length_overall_m=added_m,
        lateral_area_m2=LATERAL_AREA_M2_PER_M * added_m,
        **{name: (added_m if plant.number(name) > 0.0 else -added_m) / 2.0 for name in places},
    )


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
            f"effect shallow_water: depth_m = {values['depth_m']:g} is not more than the draught",
            fix=f"give more than {plant.draught_m:g} m",
        )
    ratio = plant.draught_m / values["depth_m"]
    slenderness = 2.0 * plant.draught_m / plant.length_between_perpendiculars_m
    force, moment, turning = (aspect_growth(ratio, slenderness, exponent) for exponent in (2.3, 1.7, 0.7))
    deep = plant
    hull = plant.hull_model
    plant = plant.scaled(force, "Yvd", *hull.sideways_coefficients("Y")).scaled(
        moment, "Nrd", *hull.sideways_coefficients("N")
    )
    plant = plant.scaled(turning, *hull.turning_coefficients)
    _, Y_r, N_v, N_r = hull.linear
    shifts = {Y_r: (turning - 1.0) * deep.Xud}
    if hull.munk:
        shifts |= {
            N_v: (moment - force) * deep.Yvd - (moment - 1.0) * deep.Xud, N_r: (turning - 1.0) * deep.Yrd
        }  # fmt: skip
    return plant.shifted(**{name: in_plant(plant, name, amount) for name, amount in shifts.items()})


EFFECTS = (
    scaling(
        "loading", "inertia", ("mass_kg", "yaw_inertia_kgm2"), (1.15, 0.03),
        what="Another loading: mass and yaw inertia times a factor, added mass unchanged",
        source="Rigid-body inertia at like radius of gyration",
        parameter="mass_factor", bounds=(0.3, 3.0),
        confused_with=("hull_lengthening", "surge_added_mass", "turning_force", "yaw_inertia"),
    ),
    scaling(
        "surge_added_mass", "inertia", ("Xud",), (1.5, 0.15),
        what="The water's inertia in surge: Xud times a factor"
        ", in the mass and in the Coriolis terms Y, N of u r, u v",
        source="Newman, Marine Hydrodynamics (1977), ch. 4",
    ),
    scaling(
        "sway_added_mass", "inertia", ("Yvd",), (1.2, 0.05),
        what="The water's inertia in sway: Yvd times a factor"
        ", in the mass and in the Coriolis terms X, N of v r, u v",
        source=_REGRESSIONS,
        confused_with=("drift_moment", "loading", "skeg", "surge_added_mass"),
    ),
    scaling(
        "yaw_inertia", "inertia", ("yaw_inertia_kgm2", "Nrd"), (1.2, 0.08),
        what="The inertia in yaw: Iz and Nrd times a factor, masses where they were",
        source=_REGRESSIONS,
        bounds=(0.3, 3.0),
        confused_with=("command_delay", "thruster_lag"),
    ),
    scaling(
        "hull_fouling", "hull", attrgetter("hull_model.resistance"), (1.2, 0.05),
        what="Growth on the hull: straight-ahead resistance times a factor",
        source="Schultz, Effects of coating roughness and biofouling on ship resistance, Biofouling 23 (2007)",
        parameter="resistance_factor",
        confused_with=("towed_load",),
    ),
    scaling(
        "cross_flow_drag", "hull", attrgetter("hull_model.cross_flow_drag"), (1.5, 0.15),
        what="Cross-flow drag of the hull: force and moment times a factor",
        source="Faltinsen, Sea Loads on Ships and Offshore Structures (1990), ch. 6",
    ),
    scaling(
        "drift_force", "hull", attrgetter("hull_model.drift_force"), (1.3, 0.1),
        what="Side force of the drifting hull, all that goes with v: times a factor",
        source=_REGRESSIONS,
        confused_with=("shallow_water",),
    ),
    scaling(
        "drift_moment", "hull", attrgetter("hull_model.drift_moment"), (1.2, 0.05),
        what="Yaw moment of the drifting hull beside the Munk moment, all that goes with v: times a factor",
        source=_REGRESSIONS,
        confused_with=("cross_flow_drag", "skeg", "surge_added_mass"),
    ),
    scaling(
        "turning_force", "hull", attrgetter("hull_model.turning_force"), (1.3, 0.1),
        what="Side force of the turning hull, all that goes with r: times a factor",
        source=_REGRESSIONS,
        confused_with=("drift_force", "shallow_water"),
    ),
    scaling(
        "turning_drag", "hull", attrgetter("hull_model.turning_drag"), (1.3, 0.1),
        what="Force along the turning hull beside what the added mass makes of v r, all that goes with r: times "
        "a factor; of most hulls it pushes ahead",
        source="Norrbin, Theory and observations on the use of a mathematical model for ship manoeuvring, SSPA 68",
    ),
    scaling(
        "yaw_damping", "hull", attrgetter("hull_model.yaw_damping"), (1.15, 0.05),
        what="Resistance of the hull to turning, all moments that go with r: times a factor",
        source=_REGRESSIONS,
        confused_with=(
            "drift_moment", "hull_lengthening", "skeg", "surge_added_mass", "sway_added_mass", "trim",
            "turning_force",
        ),
    ),
    Effect(
        "low_speed_damping", family="hull", kind="physics",
        what="Linear damping near rest: m - Xud, m - Yvd, Iz - Nrd times rates times u, v, r, fades as exp(-5 U^2)",
        source="Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 6",
        parameters=(  # water at rest pushes no ship: below none by no more than noise makes of an axis without any
            Parameter("surge_ps", "1/s", 0.0, -0.005, 0.5, 0.015, 0.003),
            Parameter("sway_ps", "1/s", 0.0, -0.005, 0.5, 0.015, 0.003),
            Parameter("yaw_ps", "1/s", 0.0, -0.03, 3.0, 0.1, 0.02),
        ),
        change=shifted("surge_damping_ps", "sway_damping_ps", "yaw_damping_ps"),
    ),
    Effect(
        "trim", family="hull", kind="physics",
        what="Trim by the head: the hull's side force acts further forward by the shift, N + shift Y",
        source=_DERIVATIVES,
        parameters=(Parameter("shift_m", "m", 0.0, -5.0, 5.0, 0.5, 0.1),),
        change=lambda plant, values: plant.shifted(**{
            moment: values["shift_m"] * plant.number(force)
            / in_plant(plant, force, in_plant(plant, moment, 1.0) ** -1)
            for moment, force in plant.hull_model.moments_of()
        }),
        confused_with=(
            "drift_moment", "hull_lengthening", "skeg", "surge_added_mass", "sway_added_mass", "turning_force",
        ),
    ),
    Effect(
        "skeg", family="hull", kind="physics",
        what="More skeg: a low fin at the pods with side force -(pi/4) rho area u (v + x r); negative, less of it",
        source="Jones, Properties of low-aspect-ratio pointed wings, NACA Report 835 (1946); aspect ratio one",
        parameters=(Parameter("area_m2", "m2", 0.0, -10.0, 20.0, 2.0, 0.3),),
        change=_with_skeg,
        confused_with=("drift_force", "hull_lengthening"),
    ),
    Effect(
        "towed_load", family="hull", kind="physics",
        what="Something towed astern: a steady force aft",
        source="Constant body force, the simplest form of a tow",
        parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
        change=lambda plant, values: plant.shifted(constant_X_n=-values["force_n"]),
        scope="day",
    ),
    Effect(
        "hull_lengthening", family="hull", kind="physics",
        what="A parallel section put in amidships: mass, added mass and hull coefficients grow with the length",
        source="Strip-wise scaling of sectional coefficients with length, one lever arm for each r",
        parameters=(Parameter("length_m", "m", 0.0, -10.0, 20.0, 3.0, 0.5),),
        change=_lengthen,
    ),
    Effect(
        "shallow_water", family="hull", kind="physics",
        what="The bottom near the keel: sway and yaw derivatives and added mass grow as draught over depth does",
        source="Hirano et al., An experimental study on maneuvering hydrodynamic forces in shallow water, "
        "Trans. West-Japan SNA 69 (1985)",
        parameters=(Parameter("depth_m", "m", float("inf"), 3.0, float("inf"), 8.0, 25.0),),
        change=_shallow,
        chart="inverse_square",
    ),
)  # fmt: skip
"""Inertia, coefficients, what is fixed to the hull, its length, the bottom."""

ASYMMETRY = (
    Effect(
        "yaw_asymmetry", family="alignment", kind="physics",
        what="A steady yaw moment, as of a bent skeg or a list",
        source="Constant body moment",
        parameters=(Parameter("moment_nm", "N m", 0.0, -1e6, 1e6, 40e3, 10e3),),
        change=shifted("constant_N_nm"),
    ),
    Effect(
        "sway_asymmetry", family="alignment", kind="physics",
        what="A steady force to starboard, as of a list or a bent keel",
        source="Constant body force",
        parameters=(Parameter("force_n", "N", 0.0, -50e3, 50e3, 3e3, 500.0),),
        change=shifted("constant_Y_n"),
    ),
)  # fmt: skip
"""Of a hull that is not symmetric."""
