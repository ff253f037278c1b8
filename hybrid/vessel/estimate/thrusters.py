"""Thrusters that push aside or anywhere: a tunnel thruster from its power, a pod from the propeller on it."""

from __future__ import annotations

from hybrid.vessel.estimate.particulars import Estimate, Estimates
from hybrid.vessel.estimate.propeller import open_water

POD_SIDE = "as of R/V Gunnerus' pods, from their maker's forces"
LOSS = 0.9
"""What is left at a hull of a thruster's force in open water."""


def tunnel_force(diameter_m: float, power_kw: float) -> Estimate:
    """Side force [N] of a tunnel thruster at full power, from diameter and power.

    The rule of bollard pull without a nozzle, 0.9 (D P)^(2/3) in kN, m and kW (Waertsilae, Encyclopedia of Marine
    Technology).
    """
    return Estimate(
        1e3 * LOSS * (diameter_m * power_kw) ** (2.0 / 3.0), 0.2, "0.9 (D P)^(2/3), rule of bollard pull"
    )


def pod(
    pitch_ratio: float, area_ratio: float, blades: int, known: float, wake: Estimate, deduction: Estimate
) -> Estimates:
    """Thrust and side force coefficients of a pod with an open propeller.

    Along the pod K_T of the B-series, in the inflow (1 - w) u and with what the hull takes, (1 - t); across it the
    coefficients fitted to the forces that the maker of R/V Gunnerus' pods states.
    """
    k = open_water(pitch_ratio, area_ratio, blades, known)
    inflow, left = 1.0 - wake.value, 1.0 - deduction.value
    factors = {
        "thrust_nn": ("k_0", left),
        "thrust_nu": ("k_1", left * inflow),
        "thrust_uu": ("k_2", left * inflow**2),
    }
    along = {
        name: Estimate(k[of].value * factor, (k[of].error ** 2 + 0.07**2) ** 0.5, k[of].source)
        for name, (of, factor) in factors.items()
    }
    side = {"side_nv": -0.9901, "side_uv": -0.7595, "side_vv": 0.3170}
    return {**along, **{name: Estimate(value, 0.5, POD_SIDE) for name, value in side.items()}}
