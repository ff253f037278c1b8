"""Limits of IMO resolution MSC.137(76), Standards for ship manoeuvrability, section 5.3: data and formulas.

They hold for ships of 100 m and more and for chemical and gas tankers; beside the indices of another ship, or of
one that steers by its drives, they stand for information only.
"""

from __future__ import annotations

import numpy as np

ADVANCE_LENGTHS = 4.5
TACTICAL_DIAMETER_LENGTHS = 5.0
INITIAL_TURNING_LENGTHS = 2.5
TRACK_REACH_LENGTHS = 15.0
FIRST_OVERSHOOT_20_20_DEG = 25.0


def first_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """10 below L/V = 10 s, 20 from 30 s, 5 + L/V / 2 between."""
    return float(np.clip(5.0 + 0.5 * length_per_speed_s, 10.0, 20.0))


def second_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """25 below L/V = 10 s, 40 from 30 s, 17.5 + 0.75 L/V between."""
    return float(np.clip(17.5 + 0.75 * length_per_speed_s, 25.0, 40.0))


def overshoot_limit_deg(
    number: int, angle_deg: float, switch_deg: float, length_m: float | None, speed_mps: float
) -> float | None:
    """The limit of overshoot 1 or 2 of a zigzag, None where there is none.

    A test run within a fifth of its nominal 10/10 or 20/20 counts as such. ``length_m`` is the ship's length
    L, ``speed_mps`` the test speed V; without a length there is no limit for the 10/10 test.
    """

    def near(nominal: float) -> bool:
        return max(abs(angle_deg / nominal - 1.0), abs(switch_deg / nominal - 1.0)) <= 0.2

    if near(20.0) and number == 1:
        return FIRST_OVERSHOOT_20_20_DEG
    if near(10.0) and number in (1, 2) and length_m and speed_mps > 0.0:
        formula = first_overshoot_10_10_deg if number == 1 else second_overshoot_10_10_deg
        return formula(length_m / speed_mps)
    return None
