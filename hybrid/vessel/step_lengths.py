"""Step lengths of the compiled simulation and of an FMU, whose process must import nothing that compiles."""

from __future__ import annotations

from math import hypot

LONGEST_STEP_S = 0.25
"""With this step a run of 30 s is within a tenth of a millimetre of the exact solution."""
STEP_LENGTHS, MOST_STEPS = 1.0 / 3.0, 8
"""Ship lengths sailed in one integration step of the filter of start states at most: a craft of 2 m at 2 m/s needs
3 steps a second; for ships and models at usual speeds one step is as good as four, to 0.1 % of the errors."""


def steps_per_second(surge_mps: float, sway_mps: float, length_m: float) -> int:
    """In how many steps the filter of start states integrates a second: of :data:`STEP_LENGTHS` at most."""
    lengths = hypot(surge_mps, sway_mps) / length_m
    return 1 + int(lengths / STEP_LENGTHS) if lengths < MOST_STEPS * STEP_LENGTHS else MOST_STEPS
