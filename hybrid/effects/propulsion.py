"""Effects of the drives: thrust that is missing, thrusters that follow late."""

from __future__ import annotations

from dataclasses import replace

from hybrid.effects.effect import Effect, Parameter, Values
from hybrid.vessel.plant import Plant


def _loss(name: str, *sides: str) -> Effect:
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
        source="Propeller wear, fouling and ventilation as one share; cf. Faltinsen, Sea Loads, ch. 9",
        parameters=(Parameter("fraction", "1", 0.0, -0.5, 1.0, 0.1, 0.03),),
        change=change,
    )


THRUST_LOSS_PORT = _loss("thrust_loss_port", "port")
THRUST_LOSS_STARBOARD = _loss("thrust_loss_starboard", "starboard")
THRUST_LOSS_BOTH = _loss("thrust_loss_both", "port", "starboard")
THRUSTER_LAG = Effect(
    "thruster_lag",
    family="propulsion",
    kind="actuator",
    what="Shaft speeds and angles that act follow the reported ones with a first-order lag",
    source="First-order actuator model; feedback has none, orders have about a second",
    parameters=(Parameter("time_constant_s", "s", 0.0, 0.0, 20.0, 1.0, 0.3),),
    change=lambda plant, values: plant.shifted(thruster_lag_s=values["time_constant_s"]),
)
