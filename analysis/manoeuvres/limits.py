"""Limits of IMO resolution MSC.137(76), Standards for ship manoeuvrability, section 5.3: data and formulas.

They hold for ships of 100 m and more and for chemical and gas tankers; beside the indices of another ship, or of
one that steers by its drives, they stand for information only. Each is for one test: advance and tactical diameter
for the turning test with 35 deg or the largest helm, the way to 10 deg of turn for a helm of 10 deg, overshoots for
the 10/10 and 20/20 zigzags.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from analysis.manoeuvres.indices import Manoeuvre, with_limits

ADVANCE_LENGTHS = 4.5
TACTICAL_DIAMETER_LENGTHS = 5.0
INITIAL_TURNING_LENGTHS = 2.5
TRACK_REACH_LENGTHS = 15.0
FIRST_OVERSHOOT_20_20_DEG = 25.0
TURNING_HELM_DEG, INITIAL_TURNING_HELM_DEG, ZIGZAG_HELM_DEG = 35.0, 10.0, 20.0
_NEAR_SHARE, _SAME_HELM_SHARE = 0.2, 0.1


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
        return max(abs(angle_deg / nominal - 1.0), abs(switch_deg / nominal - 1.0)) <= _NEAR_SHARE

    if near(20.0) and number == 1:
        return FIRST_OVERSHOOT_20_20_DEG
    if near(10.0) and number in (1, 2) and length_m and speed_mps > 0.0:
        formula = first_overshoot_10_10_deg if number == 1 else second_overshoot_10_10_deg
        return formula(length_m / speed_mps)
    return None


def beside_limits(manoeuvres: Iterable[Manoeuvre], length_m: float | None) -> tuple[Manoeuvre, ...]:
    """The manoeuvres of one recording with the limits beside the indices that they are for, and notes that say why.

    The largest helm is that of all zigzags and turns of the recording.
    """
    every = tuple(manoeuvres)
    largest = max(
        (abs(each.settings["azimuth_deg"]) for each in every if "azimuth_deg" in each.settings), default=0.0
    )
    return tuple(_beside_limits(each, length_m, largest) for each in every)


def is_turning_test(helm_deg: float, largest_deg: float) -> bool:
    """Whether a circle is the turning test: with 35 deg of helm, or with the largest helm of its recording.

    The helms of the other tests, 10 and 20 deg, are nobody's largest: a recording without more does not show it.
    """
    at_35 = abs(abs(helm_deg) / TURNING_HELM_DEG - 1.0) <= _SAME_HELM_SHARE
    at_largest = abs(helm_deg) >= (1.0 - _SAME_HELM_SHARE) * largest_deg
    return (at_35 or at_largest) and abs(helm_deg) > (1.0 + _SAME_HELM_SHARE) * ZIGZAG_HELM_DEG


def _beside_limits(each: Manoeuvre, length_m: float | None, largest_deg: float) -> Manoeuvre:
    if each.kind not in ("zigzag", "turning_circle", "course_change"):
        return each
    helm_deg, limits, notes = abs(each.settings["azimuth_deg"]), dict[str, float | None](), list[str]()
    if each.kind == "zigzag":
        test = (helm_deg, each.settings["switch_deg"], length_m, each.settings["approach_mps"])
        limits |= {f"overshoot_{number}_deg": overshoot_limit_deg(number, *test) for number in (1, 2)}
    if length_m and abs(helm_deg / INITIAL_TURNING_HELM_DEG - 1.0) <= _NEAR_SHARE:
        limits["initial_turning_m"] = INITIAL_TURNING_LENGTHS * length_m
    if length_m and each.kind == "turning_circle":
        if is_turning_test(helm_deg, largest_deg):
            limits["advance_m"] = ADVANCE_LENGTHS * length_m
            limits["tactical_diameter_m"] = TACTICAL_DIAMETER_LENGTHS * length_m
        notes.append(_turning_note(helm_deg, largest_deg))
    return replace(each, indices=with_limits(each.indices, limits), notes=(*each.notes, *notes))


def _turning_note(helm_deg: float, largest_deg: float) -> str:
    shown = "limits are" if is_turning_test(helm_deg, largest_deg) else "no limits: advance and diameter have them"
    return (
        f"{shown} for {TURNING_HELM_DEG:.0f} deg or the largest helm, "
        f"and this was {helm_deg:.0f} deg, the largest of this recording {largest_deg:.0f} deg"
    )
