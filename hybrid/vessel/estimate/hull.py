"""The numbers of a bare hull from its main particulars: masses, derivatives, resistance, wake and thrust deduction.

Added masses and manoeuvring derivatives are primed as in the standard model of the MMG: forces by (1/2) rho L d
U^2, moments by (1/2) rho L^2 d U^2, masses by (1/2) rho L^2 d, inertia by (1/2) rho L^4 d, about midship. The usual
errors are those against the captive tests of KVLCC2 (Yasukawa and Yoshimura 2015) and the published model of Esso
Osaka (Miyauchi et al. 2022), rounded up.

Resistance, wake and thrust deduction are by Holtrop's regression of model tests and trials: Holtrop and Mennen
1982, An approximate power prediction method, Int. Shipbuilding Progress 29, 166-170; Holtrop 1984, A statistical
re-analysis of resistance and propulsion data, ibid. 31, 272-276. Without bulb, immersed transom and appendages.
Fitted to 334 models, prismatic coefficient 0.55 to 0.85, L/B 3.9 to 15, B/T 2.1 to 4.

A catamaran is two such hulls beside each other. The interference of their waves, measured in towing tanks by Insel
and Molland (1992, An investigation into the resistance components of high speed displacement catamarans,
Transactions RINA 134, 1-20), is neglected.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import cos, exp, isfinite, log10, pi, sqrt

import numpy as np

from seatrial.acquisition.core import errors, quantities
from seatrial.hybrid.vessel.files import LONGEST_MODEL_M

CLARKE = "Clarke, Gedling and Hine 1983"
ZHOU = "Zhou et al. 1983, after Motora's charts"
KIJIMA = "Kijima et al. 1990"
YOSHIMURA = "Yoshimura and Masumoto 2012"
RADIUS_OF_INERTIA = 0.25
"""Of yaw about the centre of gravity, by length: the usual assumption, 0.23 to 0.27."""
SURGE_SHARE = 0.05
"""Added mass in surge by the mass; published models have 0.03 to 0.17."""


def estimate_inertia(ship: MainParticulars) -> Estimates:
    """Masses and moments of inertia: ``m m_x m_y J_z I_zG x_G``.

    Surge added mass as a share of the mass; sway and yaw by Zhou's fits to Motora's charts.
    """
    C_b, L_B = ship.block, ship.length_m / ship.beam_m
    yaw_radius = 0.01 * (33.0 - 76.85 * C_b * (1.0 - 0.784 * C_b) + 3.43 * L_B * (1.0 - 0.63 * C_b))  # by length
    return {
        "m": SourcedValue(ship.relative_mass, 0.02, "displacement of the main particulars"),
        "m_x": SourcedValue(SURGE_SHARE * ship.relative_mass, 0.8, f"5 % of the mass, {CLARKE}"),
        "m_y": SourcedValue(ship.relative_mass * _sway_share(ship), 0.15, ZHOU),
        "J_z": SourcedValue(
            ship.relative_mass * (yaw_radius**2 + SURGE_SHARE * ship.relative_hull_offset**2), 0.3, ZHOU
        ),
        "I_zG": SourcedValue(
            ship.relative_mass * (RADIUS_OF_INERTIA**2 + ship.relative_hull_offset**2),
            0.12,
            "radius of inertia 0.25 L, usual",
        ),
        "x_G": centre_of_gravity(ship),
    }


def _sway_share(ship: MainParticulars) -> float:
    C_b, L_B, d_B = ship.block, ship.length_m / ship.beam_m, ship.draught_m / ship.beam_m
    return (
        0.882
        - 0.54 * C_b * (1.0 - 1.6 * d_B)
        - 0.156 * L_B * (1.0 - 0.673 * C_b)
        + 0.826 * d_B * L_B * (1.0 - 0.678 * d_B)
        - 0.638 * C_b * d_B * L_B * (1.0 - 0.669 * d_B)
    )


def centre_of_gravity(ship: MainParticulars) -> SourcedValue:
    """Centre of gravity forward of midship by length, from the usual centre of buoyancy at a Froude number."""
    if ship.centre_of_gravity_m is not None:
        return SourcedValue(ship.centre_of_gravity_m / ship.length_m)
    forward = min(max(0.088 - 0.389 * ship.froude, -0.03), 0.035)
    return value_with_scatter(forward, 0.015, "usual centre of buoyancy, Schneekluth and Bertram 1998")


def linear_derivatives(ship: MainParticulars) -> Estimates:
    """The linear derivatives ``Y_v Y_r N_v N_r``: a low-aspect-ratio wing and what a full stern adds."""
    k, fullness = 2.0 * ship.draught_m / ship.length_m, ship.fullness
    return {
        "Y_v": value_with_scatter(-(0.5 * pi * k + 1.4 * fullness), 0.07, KIJIMA),
        "Y_r": value_with_scatter(SURGE_SHARE * ship.relative_mass + 0.5 * fullness, 0.02, KIJIMA),
        "N_v": value_with_scatter(-k, 0.015, KIJIMA),
        "N_r": value_with_scatter(-0.54 * k + k * k, 0.008, KIJIMA),
    }


def surge_derivatives(ship: MainParticulars) -> Estimates:
    """The surge force of drift and turning, ``X_vv X_vr X_rr X_vvvv``.

    The source states ``X_vr`` together with the sway added mass, which the equations of motion here hold apart.
    """
    fullness, m_y = ship.fullness, ship.relative_mass * _sway_share(ship)
    return {
        "X_vv": value_with_scatter(1.15 * fullness - 0.18, 0.03, YOSHIMURA),
        "X_vr": value_with_scatter(1.91 * fullness - 0.08 - m_y, 0.06, YOSHIMURA),
        "X_rr": value_with_scatter(-0.085 * fullness + 0.008, 0.015, YOSHIMURA),
        "X_vvvv": value_with_scatter(-6.68 * fullness + 1.1, 0.5, YOSHIMURA),
    }


_RATIOS = ("C_D", "C_rY", "C_rN")
"""Numbers of a hull that are not forces: the cross-flow drag of a second hull is that of the first's shadow."""


def coefficients_of_all_hulls(ship: MainParticulars, one_hull: Estimates) -> Estimates:
    """The numbers of a ship from those of ``one_hull`` of it: twice the forces of a catamaran's.

    In a turn the hull on the outer side meets the faster flow: R_0 (u +- r s/2)^2 at half of the spacing s to
    either side is a moment -R_0 s^2 u r, so in primes of both hulls -2 R_0' (s / 2L)^2, added to the yaw damping
    N_r. The leeward hull lies in the other's shadow, and no published figure states by how much: cross-flow drag is
    that of one hull.
    """
    if ship.hull_count == 1:
        return one_hull
    numbers = {
        name: value if name in _RATIOS else value.scaled_by(ship.hull_count) for name, value in one_hull.items()
    }
    resistance = abs(numbers["R_0"].value if "R_0" in numbers else numbers["X_0F"].value)
    numbers["N_r"] = replace(
        numbers["N_r"], value=numbers["N_r"].value - 2.0 * resistance * ship.relative_hull_offset**2
    )
    return numbers


HALF_BEAM_BY_DRAUGHT = (0.49, 0.56, 0.65, 0.83, 0.99, 1.31, 1.64, 1.86, 2.31, 2.60, 3.01, 3.45, 4.00)
CROSS_FLOW_DRAG = (1.24, 1.08, 1.00, 0.88, 0.83, 0.76, 0.69, 0.66, 0.63, 0.60, 0.59, 0.585, 0.56)


def cross_flow_drag(ship: MainParticulars) -> float:
    """Drag coefficient of a ship's section in flow from the side, by beam and draught.

    Hoerner's curve as Leite et al. (1998, Applied Ocean Research 20) give it for ships.
    """
    return float(np.interp(0.5 * ship.beam_m / ship.draught_m, HALF_BEAM_BY_DRAUGHT, CROSS_FLOW_DRAG))


def mmg_coefficients(ship: MainParticulars, R_0: SourcedValue) -> Estimates:
    """All numbers of a hull of the standard MMG model; ``R_0`` from :func:`resistance_coefficient`."""
    C_b, L_B, fullness = ship.block, ship.length_m / ship.beam_m, ship.fullness
    return {
        "R_0": R_0,
        **surge_derivatives(ship),
        **linear_derivatives(ship),
        "Y_vvv": value_with_scatter(-0.185 * L_B - 0.48, 0.3, YOSHIMURA),
        "Y_vvr": value_with_scatter(-0.75, 0.8, YOSHIMURA),
        "Y_vrr": value_with_scatter(-0.26 * (1.0 - C_b) * L_B - 0.11, 0.15, YOSHIMURA),
        "Y_rrr": value_with_scatter(-0.051, 0.05, YOSHIMURA),
        "N_vvv": value_with_scatter(0.69 * C_b - 0.66, 0.06, YOSHIMURA),
        "N_vvr": value_with_scatter(1.55 * fullness - 0.76, 0.2, YOSHIMURA),
        "N_vrr": value_with_scatter(-0.075 * (1.0 - C_b) * L_B + 0.098, 0.06, YOSHIMURA),
        "N_rrr": value_with_scatter(0.25 * fullness - 0.056, 0.012, YOSHIMURA),
    }


def cross_flow_coefficients(ship: MainParticulars, R_0: SourcedValue) -> Estimates:
    """All numbers of a hull with cross-flow drag, for low speed and large drift (Yoshimura 1988).

    Going astern the hull resists half as much again; yaw meets the cross flow of plain strip theory, C_r = 1.
    """
    strips = "strip theory, Yoshimura 1988"
    first = linear_derivatives(ship)
    return {
        "X_0F": R_0.scaled_by(-1.0),
        "X_0A": SourcedValue(-1.5 * R_0.value, 0.3, "1.5 times the resistance ahead, as of Esso Osaka"),
        "X_vr": surge_derivatives(ship)["X_vr"],
        "Y_v": first["Y_v"],
        "Y_r": first["Y_r"],
        "C_D": SourcedValue(cross_flow_drag(ship), 0.25, "Hoerner's curve, Leite et al. 1998"),
        "C_rY": SourcedValue(1.0, 0.8, strips),
        "N_v": first["N_v"],
        "N_r": first["N_r"],
        "C_rN": SourcedValue(1.0, 0.4, strips),
    }


HOLTROP = "Holtrop 1984"
_SMALL = 0.01
"""What must be positive in a power is at least that, in ships far fuller than those of the sample."""
TAYLOR = "Taylor, in Lewis (ed.) 1988"
TWIN_SCREW = "Holtrop and Mennen 1982, twin screw"


def midship_section_coefficient(ship: MainParticulars) -> float:
    """Midship section coefficient by the block coefficient (Kerlen 1970, in Schneekluth and Bertram 1998)."""
    return float(1.006 - 0.0056 * ship.block**-3.56)


def waterplane_coefficient(ship: MainParticulars) -> float:
    """Waterplane coefficient by the block coefficient, average sections (Schneekluth and Bertram 1998)."""
    return (1.0 + 2.0 * ship.block) / 3.0


def prismatic_coefficient(ship: MainParticulars) -> float:
    """Prismatic coefficient."""
    return ship.block / midship_section_coefficient(ship)


def wetted_area(ship: MainParticulars) -> float:
    """Wetted area of the hull [m2]."""
    L, B, T, C_M = ship.length_m, ship.beam_m, ship.draught_m, midship_section_coefficient(ship)
    shape = 0.453 + 0.4425 * ship.block - 0.2862 * C_M - 0.003467 * B / T + 0.3696 * waterplane_coefficient(ship)
    return L * (2.0 * T + B) * sqrt(C_M) * shape


def friction_coefficient(ship: MainParticulars) -> float:
    """Friction coefficient of the ITTC 1957 line at service speed, at 15 degrees (ITTC 7.5-02-01-03)."""
    viscosity_m2ps = 1.139e-6 if ship.water_density_kgpm3 < _FRESH_BELOW_KGPM3 else 1.188e-6
    return 0.075 / (log10(ship.service_speed_mps * ship.length_m / viscosity_m2ps) - 2.0) ** 2


def _buoyancy_percent(ship: MainParticulars) -> float:
    """Centre of buoyancy forward of midship in percent of the length."""
    return 100.0 * centre_of_gravity(ship).value


def _length_of_run_ratio(ship: MainParticulars) -> float:
    """Length of the run by the length."""
    C_P = prismatic_coefficient(ship)
    return max(1.0 - C_P + 0.06 * C_P * _buoyancy_percent(ship) / (4.0 * C_P - 1.0), _SMALL)


def form_factor(ship: MainParticulars) -> float:
    """Viscous resistance by that of a plate, 1 + k."""
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    return 0.93 + 0.487118 * float(
        (B / L) ** 1.06806
        * (T / L) ** 0.46106
        * _length_of_run_ratio(ship) ** -0.121563
        * (L**3 / ship.volume_m3) ** 0.36486
        * (1.0 - prismatic_coefficient(ship)) ** -0.604247
    )


def correlation_allowance(ship: MainParticulars) -> float:
    """Correlation allowance between model and ship, C_A; none for a model, tested smooth."""
    if ship.length_m < LONGEST_MODEL_M:
        return 0.0
    L, slender = ship.length_m, min(ship.draught_m / ship.length_m, 0.04)
    rough = 0.006 * float((L + 100.0) ** -0.16) - 0.00205
    return rough + 0.003 * sqrt(L / 7.5) * ship.block**4 * (0.04 - slender)


def viscous_resistance_coefficient(ship: MainParticulars) -> float:
    """Coefficient of viscous resistance with allowance, C_V."""
    return form_factor(ship) * friction_coefficient(ship) + correlation_allowance(ship)


def half_angle_of_entrance_deg(ship: MainParticulars) -> float:
    """Half angle of entrance of the waterline [deg]."""
    L, B, C_P = ship.length_m, ship.beam_m, prismatic_coefficient(ship)
    return 1.0 + 89.0 * exp(
        -((L / B) ** 0.80856)
        * (1.0 - waterplane_coefficient(ship)) ** 0.30484
        * max(1.0 - C_P - 0.0225 * _buoyancy_percent(ship), _SMALL) ** 0.6367
        * (_length_of_run_ratio(ship) * L / B) ** 0.34574
        * (100.0 * ship.volume_m3 / L**3) ** 0.16302
    )


def _wave_resistance_of_range(ship: MainParticulars, factor: float, m: float, F_n: float) -> float:
    """Wave resistance by weight, for one of the two ranges of Froude number."""
    C_P, L_B = prismatic_coefficient(ship), ship.length_m / ship.beam_m
    period = 1.446 * C_P - (0.03 * L_B if L_B < 12.0 else 0.36)
    slender = ship.length_m**3 / ship.volume_m3
    c_15 = 0.0 if slender > 1726.91 else -1.69385
    if 512.0 <= slender <= 1726.91:
        c_15 += (slender ** (1.0 / 3.0) - 8.0) / 2.36
    m_4 = 0.4 * c_15 * exp(-0.034 * F_n**-3.29)
    return factor * exp(m * F_n**-0.9 + m_4 * cos(period * F_n**-2))


def _slow_wave_resistance(ship: MainParticulars, F_n: float) -> float:
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    B_L, C_P = B / L, prismatic_coefficient(ship)
    c_7 = 0.229577 * B_L**0.33333 if B_L < 0.11 else B_L if B_L < 0.25 else 0.5 - 0.0625 / B_L
    c_16 = 8.07981 * C_P - 13.8673 * C_P**2 + 6.984388 * C_P**3 if C_P < 0.8 else 1.73014 - 0.7067 * C_P
    c_1 = 2223105.0 * c_7**3.78613 * (T / B) ** 1.07961 * (90.0 - half_angle_of_entrance_deg(ship)) ** -1.37565
    m_1 = 0.0140407 * L / T - 1.75254 * ship.volume_m3 ** (1.0 / 3.0) / L - 4.79323 * B / L - c_16
    return _wave_resistance_of_range(ship, c_1, m_1, F_n)


def _fast_wave_resistance(ship: MainParticulars, F_n: float) -> float:
    L, B, T = ship.length_m, ship.beam_m, ship.draught_m
    c_17 = 6919.3 * midship_section_coefficient(ship) ** -1.3346 * (ship.volume_m3 / L**3) ** 2.00977
    c_17 *= max(L / B - 2.0, 0.0) ** 1.40692
    return _wave_resistance_of_range(ship, c_17, -7.2035 * (B / L) ** 0.326869 * (T / B) ** 0.605375, F_n)


def wave_resistance(ship: MainParticulars) -> float:
    """Wave resistance at service speed, by weight: two fits, and a line between from Froude number 0.4 to 0.55."""
    F_n = ship.froude
    if F_n <= 0.4:
        return _slow_wave_resistance(ship, F_n)
    if F_n >= 0.55:
        return _fast_wave_resistance(ship, F_n)
    slow, fast = _slow_wave_resistance(ship, 0.4), _fast_wave_resistance(ship, 0.55)
    return slow + (10.0 * F_n - 4.0) / 1.5 * (fast - slow)


def resistance_n(ship: MainParticulars) -> float:
    """Resistance in still water at service speed [N], of all hulls."""
    rho = ship.water_density_kgpm3
    plate = 0.5 * rho * ship.service_speed_mps**2 * wetted_area(ship)
    return ship.hull_count * (
        plate * viscous_resistance_coefficient(ship)
        + wave_resistance(ship) * rho * quantities.GRAVITY_MPS2 * ship.volume_m3
    )


def resistance_coefficient(ship: MainParticulars) -> SourcedValue:
    """Resistance by (1/2) rho L d U^2 at service speed, R_0'."""
    scale = 0.5 * ship.water_density_kgpm3 * ship.length_m * ship.draught_m * ship.service_speed_mps**2
    return SourcedValue(resistance_n(ship) / scale, 0.2, HOLTROP)


def wake_fraction(ship: MainParticulars, diameter_m: float) -> SourcedValue:
    """Effective wake fraction at a propeller of a single- or twin-screw ship, held within 0.02 and 0.55."""
    if ship.screws == 1:
        return value_with_scatter(min(max(0.5 * ship.block - 0.05, 0.02), 0.55), 0.06, TAYLOR)
    C_b, D_d = ship.block, diameter_m / sqrt(ship.beam_m * ship.draught_m)
    fraction = 0.3095 * C_b + 10.0 * viscous_resistance_coefficient(ship) * C_b - 0.23 * D_d
    return value_with_scatter(min(max(fraction, 0.02), 0.55), 0.06, TWIN_SCREW)


def thrust_deduction(ship: MainParticulars, diameter_m: float) -> SourcedValue:
    """Thrust deduction fraction of a single- or twin-screw ship, held within 0.02 and 0.35."""
    L, B, T, D = ship.length_m, ship.beam_m, ship.draught_m, diameter_m
    if ship.screws == 1:
        hull = max(1.0 - prismatic_coefficient(ship) + 0.0225 * _buoyancy_percent(ship), _SMALL)
        fraction = 0.25014 * (B / L) ** 0.28956 * (sqrt(B * T) / D) ** 0.2624 / hull**0.01762
    else:
        fraction = 0.325 * ship.block - 0.1885 * D / sqrt(B * T)
    return value_with_scatter(min(max(fraction, 0.02), 0.35), 0.04, HOLTROP if ship.screws == 1 else TWIN_SCREW)


SEA_WATER_KGPM3 = 1025.0
_FRESH_BELOW_KGPM3 = 1010.0
_NEAR_ZERO = 0.01


@dataclass(frozen=True, slots=True)
class SourcedValue:
    """A number, its usual relative error (one standard deviation) and where it is from.

    Without an error it is assumed for the reason that ``source`` tells, or given where it tells none.
    """

    value: float
    error: float = 0.0
    source: str = ""

    def scaled_by(self, factor: float) -> SourcedValue:
        """The same estimate in another unit."""
        return replace(self, value=factor * self.value)


Estimates = dict[str, SourcedValue]


def value_with_scatter(value: float, scatter: float, source: str) -> SourcedValue:
    """An estimate from the usual error in its own unit; a relative one of a number near zero is large."""
    return SourcedValue(value, scatter / max(abs(value), _NEAR_ZERO * scatter), source)


@dataclass(frozen=True, slots=True, kw_only=True)
class MainParticulars:
    """The main particulars of a ship: length between perpendiculars, beam, mean draught [m], block coefficient.

    ``service_speed_mps`` is the speed through still water that the resistance is estimated for,
    ``centre_of_gravity_m`` lies forward of midship; without it, it is estimated too. With ``spacing_m`` between the
    centre planes of a catamaran's two hulls, beam, draught and block coefficient are those of one hull. Raises
    :class:`InputError` for what no ship has.
    """

    length_m: float
    beam_m: float
    draught_m: float
    block: float
    service_speed_mps: float
    centre_of_gravity_m: float | None = None
    water_density_kgpm3: float = SEA_WATER_KGPM3
    screws: int = 1
    spacing_m: float = 0.0

    def __post_init__(self) -> None:
        for name, unit, low, value, high in self._possible_ranges():
            if not low < value < high:
                raise errors.InputError(
                    f"{name} is {value:g}{unit}",
                    why=f"a displacement ship has between {low:g} and {high:g}{unit}",
                    fix="check the main particulars and their units; of a catamaran give the beam of one hull as "
                    "--demihull-beam, and the block coefficient of that hull",
                )

    def _possible_ranges(self) -> Iterator[tuple[str, str, float, float, float]]:
        """What makes a number impossible rather than unusual: name, unit, low, value, high."""
        yield "the length", " m", 0.5, self.length_m, 600.0
        yield "the block coefficient", "", 0.3, self.block, 0.95
        yield "length by beam", "", 1.0, self.length_m / self.beam_m, 15.0
        yield "beam by draught", "", 1.2, self.beam_m / self.draught_m, 12.0
        yield "the Froude number at service speed", "", 0.01, self.froude, 0.8
        yield "the centre of gravity by length", "", -0.15, (self.centre_of_gravity_m or 0.0) / self.length_m, 0.15

    @property
    def hull_count(self) -> int:
        """The number of hulls."""
        return 2 if self.spacing_m > 0.0 else 1

    @property
    def overall_beam_m(self) -> float:
        """Beam over all hulls [m]."""
        return self.beam_m + self.spacing_m

    @property
    def relative_hull_offset(self) -> float:
        """The distance of each hull from the centre plane, by length."""
        return 0.5 * self.spacing_m / self.length_m

    @property
    def volume_m3(self) -> float:
        """Displaced volume of one hull [m3]."""
        return self.block * self.length_m * self.beam_m * self.draught_m

    @property
    def fullness(self) -> float:
        """Block coefficient times beam by length, which most of the regressions go with."""
        return self.block * self.beam_m / self.length_m

    @property
    def relative_mass(self) -> float:
        """Mass of all hulls by (1/2) rho L^2 d."""
        return 2.0 * self.fullness * self.hull_count

    @property
    def froude(self) -> float:
        """Froude number at service speed."""
        return self.service_speed_mps / sqrt(quantities.GRAVITY_MPS2 * self.length_m)


_SAMPLES = {
    "hull and rudder": (
        ("block coefficient", 0.50, 0.86),
        ("length by beam", 2.6, 8.0),
        ("beam by draught", 2.0, 5.0),
        ("Froude number", 0.0, 0.35),
    ),
    "resistance": (("length by beam", 3.9, 15.0), ("beam by draught", 2.1, 4.0)),
}
"""The ships that each group of regressions comes from: merchant ships and fishing vessels; Holtrop's own limits."""


def describe_extrapolation(ship: MainParticulars) -> list[str]:
    """What of a ship lies outside the ships that the regressions come from, a sentence each: errors are larger."""
    values = {
        "block coefficient": ship.block,
        "length by beam": ship.length_m / ship.beam_m,
        "beam by draught": ship.beam_m / ship.draught_m,
        "Froude number": ship.froude,
    }
    return [
        f"{name} {values[name]:.3g} is outside {low:g} to {high:g}, the sample of the regressions of {what}"
        for what, limits in _SAMPLES.items()
        for name, low, high in limits
        if not low <= values[name] <= high
    ]


DIGITS = 5
Cell = str | float | SourcedValue


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the file: its head, what its numbers are called in ``[estimated]``, and its rows."""

    head: str
    label: str
    rows: dict[str, Cell]


def table_as_toml(table: Table) -> str:
    """A table as TOML, a comment at each number that was not given."""
    lines = [table.head]
    for key, cell in table.rows.items():
        number = cell if isinstance(cell, SourcedValue) else SourcedValue(0.0 if isinstance(cell, str) else cell)
        text = f"{key} = {json.dumps(cell) if isinstance(cell, str) else number_text(number.value)}"
        error = f"+-{100.0 * number.error:.0f} %: " if number.error > 0.0 else ""
        lines.append(f"{text:<34}  # {error}{number.source}" if number.source else text)
    return "\n".join(lines) + "\n"


def number_text(value: float) -> str:
    """A number to :data:`DIGITS` significant digits."""
    assert isfinite(value)
    return repr(float(f"{value:.{DIGITS}g}"))
