"""Thrust of a propeller by the Wageningen B-series, the shaft speed that drives the ship at service speed, and
thrusters with side force: a pod from the propeller on it, a tunnel thruster from its power.

Oosterveld and van Oossanen 1975, Further computer-analyzed data of the Wageningen B-screw series, Int. Shipbuilding
Progress 22, 251-262: 2 to 7 blades, area ratio 0.3 to 1.05, pitch ratio 0.5 to 1.4.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.estimate.hull import Estimates, SourcedValue

B_SERIES = "Wageningen B-series, Oosterveld and van Oossanen 1975"
_TERMS = np.array([
    (0.00880496, 0, 0, 0, 0), (-0.204554, 1, 0, 0, 0), (0.166351, 0, 1, 0, 0), (0.158114, 0, 2, 0, 0),
    (-0.147581, 2, 0, 1, 0), (-0.481497, 1, 1, 1, 0), (0.415437, 0, 2, 1, 0), (0.0144043, 0, 0, 0, 1),
    (-0.0530054, 2, 0, 0, 1), (0.0143481, 0, 1, 0, 1), (0.0606826, 1, 1, 0, 1), (-0.0125894, 0, 0, 1, 1),
    (0.0109689, 1, 0, 1, 1), (-0.133698, 0, 3, 0, 0), (0.00638407, 0, 6, 0, 0), (-0.00132718, 2, 6, 0, 0),
    (0.168496, 3, 0, 1, 0), (-0.0507214, 0, 0, 2, 0), (0.0854559, 2, 0, 2, 0), (-0.0504475, 3, 0, 2, 0),
    (0.010465, 1, 6, 2, 0), (-0.00648272, 2, 6, 2, 0), (-0.00841728, 0, 3, 0, 1), (0.0168424, 1, 3, 0, 1),
    (-0.00102296, 3, 3, 0, 1), (-0.0317791, 0, 3, 1, 1), (0.018604, 1, 0, 2, 1), (-0.00410798, 0, 2, 2, 1),
    (-0.000606848, 0, 0, 0, 2), (-0.0049819, 1, 0, 0, 2), (0.0025983, 2, 0, 0, 2), (-0.000560528, 3, 0, 0, 2),
    (-0.00163652, 1, 2, 0, 2), (-0.000328787, 1, 6, 0, 2), (0.000116502, 2, 6, 0, 2), (0.000690904, 0, 0, 1, 2),
    (0.00421749, 0, 3, 1, 2), (0.0000565229, 3, 6, 1, 2), (-0.00146564, 0, 3, 2, 2),
])  # fmt: skip
"""K_T as a sum of c J^s (P/D)^t (A_E/A_0)^u Z^v, a row a term: c, s, t, u, v; for a Reynolds number of 2e6."""

_RANGES = (("pitch ratio", 0.5, 1.4), ("area ratio", 0.3, 1.05), ("number of blades", 2, 7))


def thrust_coefficient(J: Floats, pitch_ratio: float, area_ratio: float, blades: int) -> Floats:
    """K_T of a B-series propeller at the advance ratios ``J``.

    Raises :class:`InputError` for a propeller outside the series.
    """
    for (name, low, high), value in zip(_RANGES, (pitch_ratio, area_ratio, blades), strict=True):
        if not low <= value <= high:
            raise InputError(
                f"a propeller's {name} is {value:g}",
                why=f"the Wageningen B-series has {low:g} to {high:g}",
                fix="give one within, or write K_T as k_0, k_1, k_2 into the vessel file yourself",
            )
    c, s, t, u, v = _TERMS.T
    J = np.asarray(J, dtype=float)
    thrust: Floats = (c * J[..., None] ** s * pitch_ratio**t * area_ratio**u * float(blades) ** v).sum(axis=-1)
    return thrust


def quadratic(pitch_ratio: float, area_ratio: float, blades: int) -> tuple[float, float, float]:
    """``k_0, k_1, k_2`` of K_T = k_0 + k_1 J + k_2 J^2, fitted where the propeller thrusts ahead."""
    J = np.linspace(0.0, 1.6, 161)
    thrust = thrust_coefficient(J, pitch_ratio, area_ratio, blades)
    ahead = np.cumprod(thrust >= 0.0).astype(bool)
    k_2, k_1, k_0 = np.polyfit(J[ahead], thrust[ahead], 2)
    return float(k_0), float(k_1), float(k_2)


def open_water(pitch_ratio: float, area_ratio: float, blades: int, error_factor: float) -> Estimates:
    """``k_0 k_1 k_2`` with their usual errors: a stock propeller is within 5 % of the series at zero speed.

    ``error_factor`` multiplies the errors: 1 for a propeller whose particulars are known, more for a typical one.
    """
    k_0, k_1, k_2 = quadratic(pitch_ratio, area_ratio, blades)
    numbers = {"k_0": (k_0, 0.05), "k_1": (k_1, 0.10), "k_2": (k_2, 0.25)}
    return {name: SourcedValue(value, error * error_factor, B_SERIES) for name, (value, error) in numbers.items()}


def service_rps(
    thrust_n: float, speed_mps: float, diameter_m: float, k: tuple[float, float, float], density_kgpm3: float
) -> float:
    """Revolutions a second at which a propeller gives a thrust [N] in an inflow [m/s].

    The root of rho D^4 (k_0 n^2 + k_1 n V/D + k_2 V^2/D^2) = T.
    """
    k_0, k_1, k_2 = k
    V = speed_mps / diameter_m
    half = 0.5 * k_1 * V / k_0
    return -half + sqrt(half * half - (k_2 * V * V - thrust_n / (density_kgpm3 * diameter_m**4)) / k_0)


def fitting_pitch_ratio(target: float, J: float, area_ratio: float, blades: int) -> float:
    """The pitch ratio of a B-series propeller that has a K_T at ``J``; the end of the series if none has."""
    pitch = np.linspace(0.5, 1.4, 181)
    thrust = [float(thrust_coefficient(np.array(J), ratio, area_ratio, blades)) for ratio in pitch]
    return float(pitch[int(np.argmin(np.abs(np.array(thrust) - target)))])


def astern(k_0: float) -> Estimates:
    """``astern_0 .. astern_3``, thrust with the shaft astern, in proportion to that ahead at zero speed.

    The shares are those of Esso Osaka (Miyauchi et al. 2022); other propellers scatter by a third.
    """
    source = "share of k_0 as of Esso Osaka, Miyauchi et al. 2022"
    shares = {"astern_0": -0.711, "astern_1": -0.766, "astern_2": -0.534}
    thrust = {name: SourcedValue(share * k_0, 0.3, source) for name, share in shares.items()}
    return {**thrust, "astern_3": SourcedValue(0.330, 0.3, "as of Esso Osaka, Miyauchi et al. 2022")}


POD_SIDE = "as of R/V Gunnerus' pods, from their maker's forces"
LOSS = 0.9
"""What is left at a hull of a thruster's force in open water."""


def tunnel_force(diameter_m: float, power_kw: float) -> SourcedValue:
    """Side force [N] of a tunnel thruster at full power, from diameter and power.

    The rule of bollard pull without a nozzle, 0.9 (D P)^(2/3) in kN, m and kW (Waertsilae, Encyclopedia of Marine
    Technology).
    """
    return SourcedValue(
        1e3 * LOSS * (diameter_m * power_kw) ** (2.0 / 3.0), 0.2, "0.9 (D P)^(2/3), rule of bollard pull"
    )


def pod(
    pitch_ratio: float,
    area_ratio: float,
    blades: int,
    error_factor: float,
    wake: SourcedValue,
    deduction: SourcedValue,
) -> Estimates:
    """Thrust and side force coefficients of a pod with an open propeller.

    Along the pod K_T of the B-series, in the inflow (1 - w) u and with what the hull takes, (1 - t); across it the
    coefficients fitted to the forces that the maker of R/V Gunnerus' pods states.
    """
    k = open_water(pitch_ratio, area_ratio, blades, error_factor)
    inflow, delivered = 1.0 - wake.value, 1.0 - deduction.value
    factors = {
        "thrust_nn": ("k_0", delivered),
        "thrust_nu": ("k_1", delivered * inflow),
        "thrust_uu": ("k_2", delivered * inflow**2),
    }
    along = {
        name: SourcedValue(k[key].value * factor, (k[key].error ** 2 + 0.07**2) ** 0.5, k[key].source)
        for name, (key, factor) in factors.items()
    }
    side = {"side_nv": -0.9901, "side_uv": -0.7595, "side_vv": 0.3170}
    return {**along, **{name: SourcedValue(value, 0.5, POD_SIDE) for name, value in side.items()}}
