"""Effects of the drives' forces: thrust that is missing, water that meets the propellers otherwise."""

from __future__ import annotations

from dataclasses import replace

from hybrid.effects.effect import Effect, Parameter, Values, scaling
from hybrid.vessel.plant import Plant


def _loss(name: str, sides: tuple[str, ...], confused_with: tuple[str, ...]) -> Effect:
    """A loss of the given sides' pods; a loss on top of another takes its share of what is left."""

    def change(plant: Plant, values: Values) -> Plant:
        left = 1.0 - values["fraction"]
        slots = [f"{side}_thrust_loss" for side in sides]
        return replace(plant, **{slot: 1.0 - (1.0 - getattr(plant, slot)) * left for slot in slots})

    return Effect(
        name,
        family="propulsion",
        kind="actuator",
        what=f"Lost thrust: both force components of the {' and '.join(sides)} pod times (1 - fraction)",
        source="Wear, roughness and ventilation as one share; cf. Carlton, Marine Propellers and Propulsion",
        parameters=(Parameter("fraction", "1", 0.0, -0.5, 1.0, 0.1, 0.03),),
        change=change,
        confused_with=confused_with,
    )


def _slower_inflow(plant: Plant, values: Values) -> Plant:
    """Axial inflow u_a times (1 - fraction): its powers go into the coefficients of thrust and side force."""
    slower = 1.0 - values["fraction"]
    return plant.scaled(slower, "thrust_nu", "side_uv").scaled(slower**2, "thrust_uu")


THRUST_LOSS_PORT = _loss(
    "thrust_loss_port",
    ("port",),
    ("hull_lengthening", "pod_side_force", "thrust_loss_both", "thrust_loss_starboard", "yaw_asymmetry"),
)
THRUST_LOSS_STARBOARD = _loss(
    "thrust_loss_starboard",
    ("starboard",),
    ("hull_lengthening", "pod_side_force", "thrust_loss_both", "thrust_loss_port", "yaw_asymmetry"),
)
THRUST_LOSS_BOTH = _loss(
    "thrust_loss_both",
    ("port", "starboard"),
    (
        "hull_fouling",
        "hull_lengthening",
        "pod_side_force",
        "thrust_loss_port",
        "thrust_loss_starboard",
        "towed_load",
        "wake_fraction",
    ),
)
WAKE_FRACTION = Effect(
    "wake_fraction",
    family="propulsion",
    kind="physics",
    what="The hull's wake at the pods: axial inflow u_a times (1 - fraction), hence more thrust under way",
    source="Carlton, Marine Propellers and Propulsion, ch. 5",
    parameters=(Parameter("fraction", "1", 0.0, -0.5, 0.8, 0.1, 0.03),),
    change=_slower_inflow,
    confused_with=("hull_fouling", "thrust_loss_both", "towed_load"),
)
POD_SIDE_FORCE = scaling(
    "pod_side_force",
    "propulsion",
    ("side_nv", "side_uv", "side_vv"),
    (1.2, 0.05),
    what="Side force of the pods in oblique flow: the three coefficients across the pod times a factor",
    source="Ribner, Propellers in yaw, NACA Report 820 (1945): a propeller resists like a fin",
    confused_with=("thrust_loss_both", "thrust_loss_port", "thrust_loss_starboard"),
)
TUNNEL_THRUST_LOSS = Effect(
    "tunnel_thrust_loss",
    family="propulsion",
    kind="actuator",
    what="Lost side force of the tunnel thruster: times (1 - fraction)",
    source="Brix, Manoeuvring Technical Manual (1993): speed, grids and fouling as one share",
    parameters=(Parameter("fraction", "1", 0.0, -0.5, 1.0, 0.1, 0.03),),
    change=lambda plant, values: plant.scaled(
        1.0 - values["fraction"], "tunnel_cubic_n", "tunnel_quadratic_n", "tunnel_linear_n"
    ),
)
