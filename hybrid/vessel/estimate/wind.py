"""A ship's outline above water where nobody measured it, for Fujiwara's regression of the wind's force.

The ratios are the geometric means of two published outlines, Esso Osaka's and R/V Gunnerus'; below, where only Esso
Osaka's is published, hers. Ships differ by half as much again: measured areas are worth having.
"""

from __future__ import annotations

from hybrid.vessel.estimate.particulars import Estimate, Estimates, Particulars

OUTLINES = "mean of Esso Osaka and R/V Gunnerus"
ESSO_OSAKA = "as of Esso Osaka"
AREA_ERROR = 0.4


def outline(ship: Particulars, frontal_m2: float | None = None, lateral_m2: float | None = None) -> Estimates:
    """Areas, centres and heights above water; with the areas that are known."""
    L, B = ship.length_m, ship.beam_m
    frontal = Estimate(0.70 * B * B, AREA_ERROR, f"0.70 B^2, {OUTLINES}")
    lateral = Estimate(0.45 * L * B, AREA_ERROR, f"0.45 L B, {OUTLINES}")
    if frontal_m2 is not None:
        frontal = Estimate(frontal_m2, 0.0, "given")
    if lateral_m2 is not None:
        lateral = Estimate(lateral_m2, 0.0, "given")
    A_T, A_L = frontal.value, lateral.value
    return {
        "frontal_area_m2": frontal,
        "lateral_area_m2": lateral,
        "superstructure_area_m2": Estimate(0.27 * A_L, 0.5, f"0.27 of the lateral area, {ESSO_OSAKA}"),
        "lateral_centre_m": Estimate(-0.0043 * L, 5.0, ESSO_OSAKA),
        "lateral_centre_height_m": Estimate(0.60 * A_L / L, 0.2, f"0.60 A_L / L, {ESSO_OSAKA}"),
        "bridge_centre_m": Estimate(-0.021 * L, 5.0, ESSO_OSAKA),
        "bridge_height_m": Estimate(1.06 * A_T / B, 0.3, f"1.06 A_T / B, {ESSO_OSAKA}"),
    }
