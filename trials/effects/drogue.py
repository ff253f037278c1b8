"""An effect of one's own: a drogue streamed from the stern. Use: ``--effects trials/effects/drogue.py``."""

from math import cos, hypot, sin

from seatrial.hybrid.effects import Effect, Parameter


def pull(time_s, state, control, environment, parameters):
    """Force X [N], Y [N], N [N m]: against the stern's motion through the water, by the square of its speed."""
    _, _, heading, u, v, r = state
    u_water = u - environment.current_north_mps * cos(heading) - environment.current_east_mps * sin(heading)
    v_water = v - environment.current_east_mps * cos(heading) + environment.current_north_mps * sin(heading)
    stern_m = -13.22  # where the line is fast, from the centre of gravity
    v_stern = v_water + stern_m * r
    pull_per_mps = -parameters[0] * hypot(u_water, v_stern)
    return pull_per_mps * u_water, pull_per_mps * v_stern, stern_m * pull_per_mps * v_stern


EFFECTS = [
    Effect(
        "drogue",
        family="hull",
        kind="physics",
        what="A drogue on a line from the stern: drag times the square of the stern's speed, against its motion",
        source="Quadratic drag of a bluff body, Hoerner, Fluid-Dynamic Drag (1965)",
        parameters=(
            Parameter("drag_nps2", "N/(m/s)2", neutral=0.0, low=0.0, high=5000.0, typical=150.0, smallest=20.0),
        ),
        change=lambda plant, values: plant.with_force(pull, values["drag_nps2"]),
        confused_with=("towed_load", "hull_fouling", "yaw_damping"),
    )
]
