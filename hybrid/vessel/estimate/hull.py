"""Added masses and manoeuvring derivatives of a bare hull, primed as in the standard model of the MMG.

Forces by (1/2) rho L d U^2, moments by (1/2) rho L^2 d U^2, masses by (1/2) rho L^2 d, inertia by (1/2) rho L^4 d,
about midship. The usual errors are those against the captive tests of KVLCC2 (Yasukawa and Yoshimura 2015) and the
published model of Esso Osaka (Miyauchi et al. 2022), rounded up.
"""

from __future__ import annotations

from bisect import bisect
from math import pi

from hybrid.vessel.estimate.particulars import Estimate, Estimates, Particulars, with_scatter

CLARKE = "Clarke, Gedling and Hine 1983"
ZHOU = "Zhou et al. 1983, after Motora's charts"
KIJIMA = "Kijima et al. 1990"
YOSHIMURA = "Yoshimura and Masumoto 2012"
RADIUS_OF_INERTIA = 0.25
"""Of yaw about the centre of gravity, by length: the usual assumption, 0.23 to 0.27."""
SURGE_SHARE = 0.05
"""Added mass in surge by the mass; published models have 0.03 to 0.17."""


def inertia(ship: Particulars) -> Estimates:
    """Masses and moments of inertia: ``m m_x m_y J_z I_zG x_G``.

    Surge added mass as a share of the mass; sway and yaw by Zhou's fits to Motora's charts.
    """
    return {
        "m": Estimate(ship.mass, 0.02, "displacement of the main particulars"),
        "m_x": Estimate(SURGE_SHARE * ship.mass, 0.8, f"5 % of the mass, {CLARKE}"),
        "m_y": Estimate(ship.mass * _sway_share(ship), 0.15, ZHOU),
        "J_z": Estimate(ship.mass * _yaw_added_radius(ship) ** 2, 0.3, ZHOU),
        "I_zG": Estimate(ship.mass * RADIUS_OF_INERTIA**2, 0.12, "radius of inertia 0.25 L, usual"),
        "x_G": centre_of_gravity(ship),
    }


def _sway_share(ship: Particulars) -> float:
    C_b, L_B, d_B = ship.block, ship.length_m / ship.beam_m, ship.draught_m / ship.beam_m
    return (
        0.882
        - 0.54 * C_b * (1.0 - 1.6 * d_B)
        - 0.156 * L_B * (1.0 - 0.673 * C_b)
        + 0.826 * d_B * L_B * (1.0 - 0.678 * d_B)
        - 0.638 * C_b * d_B * L_B * (1.0 - 0.669 * d_B)
    )


def _yaw_added_radius(ship: Particulars) -> float:
    """By length."""
    C_b, L_B = ship.block, ship.length_m / ship.beam_m
    return 0.01 * (33.0 - 76.85 * C_b * (1.0 - 0.784 * C_b) + 3.43 * L_B * (1.0 - 0.63 * C_b))


def centre_of_gravity(ship: Particulars) -> Estimate:
    """Centre of gravity forward of midship by length, from the usual centre of buoyancy at a Froude number."""
    if ship.centre_of_gravity_m is not None:
        return Estimate(ship.centre_of_gravity_m / ship.length_m, 0.0, "given")
    forward = min(max(0.088 - 0.389 * ship.froude, -0.03), 0.035)
    return with_scatter(forward, 0.015, "usual centre of buoyancy, Schneekluth and Bertram 1998")


def linear(ship: Particulars) -> Estimates:
    """The linear derivatives ``Y_v Y_r N_v N_r``: a low-aspect-ratio wing and what a full stern adds."""
    k, fullness = 2.0 * ship.draught_m / ship.length_m, ship.fullness
    return {
        "Y_v": with_scatter(-(0.5 * pi * k + 1.4 * fullness), 0.07, KIJIMA),
        "Y_r": with_scatter(SURGE_SHARE * ship.mass + 0.5 * fullness, 0.02, KIJIMA),
        "N_v": with_scatter(-k, 0.015, KIJIMA),
        "N_r": with_scatter(-0.54 * k + k * k, 0.008, KIJIMA),
    }


def surge(ship: Particulars) -> Estimates:
    """The surge force of drift and turning, ``X_vv X_vr X_rr X_vvvv``.

    The source states ``X_vr`` together with the sway added mass, which the equations of motion here hold apart.
    """
    fullness, m_y = ship.fullness, ship.mass * _sway_share(ship)
    return {
        "X_vv": with_scatter(1.15 * fullness - 0.18, 0.03, YOSHIMURA),
        "X_vr": with_scatter(1.91 * fullness - 0.08 - m_y, 0.06, YOSHIMURA),
        "X_rr": with_scatter(-0.085 * fullness + 0.008, 0.015, YOSHIMURA),
        "X_vvvv": with_scatter(-6.68 * fullness + 1.1, 0.5, YOSHIMURA),
    }


def cubic(ship: Particulars) -> Estimates:
    """The cubic derivatives of sway and yaw."""
    C_b, L_B, fullness = ship.block, ship.length_m / ship.beam_m, ship.fullness
    return {
        "Y_vvv": with_scatter(-0.185 * L_B - 0.48, 0.3, YOSHIMURA),
        "Y_vvr": with_scatter(-0.75, 0.8, YOSHIMURA),
        "Y_vrr": with_scatter(-0.26 * (1.0 - C_b) * L_B - 0.11, 0.15, YOSHIMURA),
        "Y_rrr": with_scatter(-0.051, 0.05, YOSHIMURA),
        "N_vvv": with_scatter(0.69 * C_b - 0.66, 0.06, YOSHIMURA),
        "N_vvr": with_scatter(1.55 * fullness - 0.76, 0.2, YOSHIMURA),
        "N_vrr": with_scatter(-0.075 * (1.0 - C_b) * L_B + 0.098, 0.06, YOSHIMURA),
        "N_rrr": with_scatter(0.25 * fullness - 0.056, 0.012, YOSHIMURA),
    }


HALF_BEAM_BY_DRAUGHT = (0.49, 0.56, 0.65, 0.83, 0.99, 1.31, 1.64, 1.86, 2.31, 2.60, 3.01, 3.45, 4.00)
CROSS_FLOW_DRAG = (1.24, 1.08, 1.00, 0.88, 0.83, 0.76, 0.69, 0.66, 0.63, 0.60, 0.59, 0.585, 0.56)


def cross_flow_drag(ship: Particulars) -> float:
    """Drag coefficient of a ship's section in flow from the side, by beam and draught.

    Hoerner's curve as Leite et al. (1998, Applied Ocean Research 20) give it for ships.
    """
    x = min(max(0.5 * ship.beam_m / ship.draught_m, HALF_BEAM_BY_DRAUGHT[0]), HALF_BEAM_BY_DRAUGHT[-1])
    i = min(max(bisect(HALF_BEAM_BY_DRAUGHT, x), 1), len(HALF_BEAM_BY_DRAUGHT) - 1)
    x_0, x_1, C_0, C_1 = *HALF_BEAM_BY_DRAUGHT[i - 1 : i + 1], *CROSS_FLOW_DRAG[i - 1 : i + 1]
    return C_0 + (C_1 - C_0) * (x - x_0) / (x_1 - x_0)


def mmg(ship: Particulars, R_0: Estimate) -> Estimates:
    """All numbers of a hull of the standard MMG model; ``R_0`` from :mod:`.resistance`."""
    return {"R_0": R_0, **surge(ship), **linear(ship), **cubic(ship)}


def cross_flow(ship: Particulars, R_0: Estimate) -> Estimates:
    """All numbers of a hull with cross-flow drag, for low speed and large drift (Yoshimura 1988).

    Going astern the hull resists half as much again; yaw meets the cross flow of plain strip theory, C_r = 1.
    """
    strips = "strip theory, Yoshimura 1988"
    first = linear(ship)
    return {
        "X_0F": Estimate(-R_0.value, R_0.error, R_0.source),
        "X_0A": Estimate(-1.5 * R_0.value, 0.3, "1.5 times the resistance ahead, as of Esso Osaka"),
        "X_vr": surge(ship)["X_vr"],
        "Y_v": first["Y_v"],
        "Y_r": first["Y_r"],
        "C_D": Estimate(cross_flow_drag(ship), 0.25, "Hoerner's curve, Leite et al. 1998"),
        "C_rY": Estimate(1.0, 0.8, strips),
        "N_v": first["N_v"],
        "N_r": first["N_r"],
        "C_rN": Estimate(1.0, 0.4, strips),
    }
