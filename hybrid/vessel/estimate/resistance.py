"""Resistance, wake and thrust deduction by Holtrop's regression of model tests and trials.

Holtrop and Mennen 1982, An approximate power prediction method, Int. Shipbuilding Progress 29, 166-170; Holtrop
1984, A statistical re-analysis of resistance and propulsion data, ibid. 31, 272-276. Without bulb, immersed transom
and appendages. Fitted to 334 models, prismatic coefficient 0.55 to 0.85, L/B 3.9 to 15, B/T 2.1 to 4.
"""

from __future__ import annotations

from math import cos, exp, log10, sqrt

from hybrid.vessel.estimate.hull import centre_of_gravity
from hybrid.vessel.estimate.particulars import GRAVITY_MPS2, Estimate, Particulars, with_scatter

HOLTROP = "Holtrop 1984"
_SMALL = 0.01
"""What must be positive in a power is at least that, in ships far fuller than those of the sample."""
TAYLOR = "Taylor, in Lewis (ed.) 1988"
TWIN_SCREW = "Holtrop and Mennen 1982, twin screw"


def midship_section(ship: Particulars) -> float:
    """Midship section coefficient by the block coefficient (Kerlen 1970, in Schneekluth and Bertram 1998)."""
    return float(1.006 - 0.0056 * ship.block**-3.56)


def waterplane(ship: Particulars) -> float:
    """Waterplane coefficient by the block coefficient, average sections (Schneekluth and Bertram 1998)."""
    return (1.0 + 2.0 * ship.block) / 3.0


def prismatic(ship: Particulars) -> float:
    """Prismatic coefficient."""
    return ship.block / midship_section(ship)


def wetted_area(ship: Particulars) -> float:
    """Wetted area of the hull [m2]."""
    L, B, T, C_M = ship.length_m, ship.beam_m, ship.draught_m, midship_section(ship)
    shape = 0.453 + 0.4425 * ship.block - 0.2862 * C_M - 0.003467 * B / T + 0.3696 * waterplane(ship)
    return L * (2.0 * T + B) * sqrt(C_M) * shape


def friction(ship: Particulars) -> float:
    """Friction coefficient of the ITTC 1957 line at service speed."""
    return 0.075 / (log10(ship.service_speed_mps * ship.length_m / ship.viscosity_m2ps) - 2.0) ** 2


def _buoyancy_percent(ship: Particulars) -> float:
    """Centre of buoyancy forward of midship in percent of the length."""
    return 100.0 * centre_of_gravity(ship).value


def _run(ship: Particulars) -> float:
    """Length of the run by the length."""
    C_P = prismatic(ship)
    return max(1.0 - C_P + 0.06 * C_P * _buoyancy_percent(ship) / (4.0 * C_P - 1.0), _SMALL)


def form_factor(ship: Particulars) -> float:
    """Viscous resistance by that of a plate, 1 + k."""
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    return 0.93 + 0.487118 * float(
        (B / L) ** 1.06806
        * (T / L) ** 0.46106
        * _run(ship) ** -0.121563
        * (L**3 / ship.volume_m3) ** 0.36486
        * (1.0 - prismatic(ship)) ** -0.604247
    )


def allowance(ship: Particulars) -> float:
    """Correlation allowance between model and ship, C_A; none for a model."""
    if ship.is_model:
        return 0.0
    L, slender = ship.length_m, min(ship.draught_m / ship.length_m, 0.04)
    rough = 0.006 * float((L + 100.0) ** -0.16) - 0.00205
    return rough + 0.003 * sqrt(L / 7.5) * ship.block**4 * (0.04 - slender)


def viscous(ship: Particulars) -> float:
    """Coefficient of viscous resistance with allowance, C_V."""
    return form_factor(ship) * friction(ship) + allowance(ship)


def entrance_deg(ship: Particulars) -> float:
    """Half angle of entrance of the waterline [deg]."""
    L, B, C_P = ship.length_m, ship.beam_m, prismatic(ship)
    return 1.0 + 89.0 * exp(
        -((L / B) ** 0.80856)
        * (1.0 - waterplane(ship)) ** 0.30484
        * max(1.0 - C_P - 0.0225 * _buoyancy_percent(ship), _SMALL) ** 0.6367
        * (_run(ship) * L / B) ** 0.34574
        * (100.0 * ship.volume_m3 / L**3) ** 0.16302
    )


def _c7(B_L: float) -> float:
    if B_L < 0.11:
        return 0.229577 * float(B_L**0.33333)
    return B_L if B_L < 0.25 else 0.5 - 0.0625 / B_L


def _c15(ship: Particulars) -> float:
    slender = ship.length_m**3 / ship.volume_m3
    if slender < 512.0:
        return -1.69385
    return 0.0 if slender > 1726.91 else -1.69385 + (slender ** (1.0 / 3.0) - 8.0) / 2.36


def _c16(C_P: float) -> float:
    return 8.07981 * C_P - 13.8673 * C_P**2 + 6.984388 * C_P**3 if C_P < 0.8 else 1.73014 - 0.7067 * C_P


def _waves(ship: Particulars, factor: float, m: float, F_n: float) -> float:
    """Wave resistance by weight, for one of the two ranges of Froude number."""
    C_P, L_B = prismatic(ship), ship.length_m / ship.beam_m
    period = 1.446 * C_P - (0.03 * L_B if L_B < 12.0 else 0.36)
    m_4 = 0.4 * _c15(ship) * exp(-0.034 * F_n**-3.29)
    return factor * exp(m * F_n**-0.9 + m_4 * cos(period * F_n**-2))


def _slow(ship: Particulars, F_n: float) -> float:
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    c_1 = 2223105.0 * _c7(B / L) ** 3.78613 * (T / B) ** 1.07961 * (90.0 - entrance_deg(ship)) ** -1.37565
    m_1 = 0.0140407 * L / T - 1.75254 * ship.volume_m3 ** (1.0 / 3.0) / L - 4.79323 * B / L - _c16(prismatic(ship))
    return _waves(ship, c_1, m_1, F_n)


def _fast(ship: Particulars, F_n: float) -> float:
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    c_17 = 6919.3 * midship_section(ship) ** -1.3346 * (ship.volume_m3 / L**3) ** 2.00977
    c_17 *= max(L / B - 2.0, 0.0) ** 1.40692
    return _waves(ship, c_17, -7.2035 * (B / L) ** 0.326869 * (T / B) ** 0.605375, F_n)


def wave_resistance(ship: Particulars) -> float:
    """Wave resistance at service speed, by weight: two fits, and a line between from Froude number 0.4 to 0.55."""
    F_n = ship.froude
    if F_n <= 0.4:
        return _slow(ship, F_n)
    if F_n >= 0.55:
        return _fast(ship, F_n)
    slow, fast = _slow(ship, 0.4), _fast(ship, 0.55)
    return slow + (10.0 * F_n - 4.0) / 1.5 * (fast - slow)


def resistance_n(ship: Particulars) -> float:
    """Resistance in still water at service speed [N]."""
    rho = ship.water_density_kgpm3
    plate = 0.5 * rho * ship.service_speed_mps**2 * wetted_area(ship)
    return plate * viscous(ship) + wave_resistance(ship) * rho * GRAVITY_MPS2 * ship.volume_m3


def resistance(ship: Particulars) -> Estimate:
    """Resistance by (1/2) rho L d U^2 at service speed, R_0'."""
    scale = 0.5 * ship.water_density_kgpm3 * ship.length_m * ship.draught_m * ship.service_speed_mps**2
    return Estimate(resistance_n(ship) / scale, 0.2, HOLTROP)


def wake_fraction(ship: Particulars, diameter_m: float) -> Estimate:
    """Effective wake fraction at a propeller of a single- or twin-screw ship, held within 0.02 and 0.55."""
    if ship.screws == 1:
        return with_scatter(min(max(0.5 * ship.block - 0.05, 0.02), 0.55), 0.06, TAYLOR)
    C_b, D_d = ship.block, diameter_m / sqrt(ship.beam_m * ship.draught_m)
    fraction = 0.3095 * C_b + 10.0 * viscous(ship) * C_b - 0.23 * D_d
    return with_scatter(min(max(fraction, 0.02), 0.55), 0.06, TWIN_SCREW)


def thrust_deduction(ship: Particulars, diameter_m: float) -> Estimate:
    """Thrust deduction fraction of a single- or twin-screw ship, held within 0.02 and 0.35."""
    L, B, T, D = ship.length_m, ship.beam_m, ship.draught_m, diameter_m
    if ship.screws == 1:
        hull = max(1.0 - prismatic(ship) + 0.0225 * _buoyancy_percent(ship), _SMALL)
        fraction = 0.25014 * (B / L) ** 0.28956 * (sqrt(B * T) / D) ** 0.2624 / hull**0.01762
    else:
        fraction = 0.325 * ship.block - 0.1885 * D / sqrt(B * T)
    return with_scatter(min(max(fraction, 0.02), 0.35), 0.04, HOLTROP if ship.screws == 1 else TWIN_SCREW)
