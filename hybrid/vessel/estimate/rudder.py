"""A rudder's size and normal force, and how hull, propeller and rudder act on each other.

The usual errors are those against the published models of KVLCC2 and Esso Osaka, rounded up.
"""

from __future__ import annotations

from math import sqrt

from hybrid.vessel.estimate.particulars import Estimate, Estimates, Particulars, with_scatter

KIJIMA = "Kijima et al. 1990"
YOSHIMURA = "Yoshimura and Masumoto 2012"
MATSUMOTO = "Matsumoto and Suemitsu 1980"
USUAL_ASPECT_RATIO = 1.6
_WAKES = (0.2, 0.5)
"""The wake fractions of single-screw ships that eps was fitted to."""


def normal_force_slope(aspect_ratio: float) -> float:
    """Slope of the normal force of a rudder alone, f_alpha (Fujii and Tsuda 1961)."""
    return 6.13 * aspect_ratio / (2.25 + aspect_ratio)


def usual_area(ship: Particulars) -> Estimate:
    """Area of all rudders together [m2] that a classification society asks for (Det Norske Veritas, Rules)."""
    area = 0.01 * ship.length_m * ship.draught_m * (1.0 + 25.0 * (ship.beam_m / ship.length_m) ** 2)
    return Estimate(area, 0.2, "least area of Det Norske Veritas' rules")


def usual_rate_dps(ship: Particulars) -> float:
    """Rate of turn of a rudder [deg/s]: 65 degrees in 28 s (SOLAS II-1/29) at 100 m, by Froude's law below."""
    return 65.0 / 28.0 * max(1.0, sqrt(100.0 / ship.length_m))


def interaction(ship: Particulars, wake: float) -> Estimates:
    """``t_R a_H x_H flow_straightening l_R eps kappa`` of a rudder; ``x_H``, ``l_R`` by length.

    ``wake`` is the wake fraction of the propeller before it. Behind the screws of a twin-screw ship, and without a
    propeller, the wake at the rudder is that at the propeller: eps = 1.
    """
    fullness, behind_stern = ship.fullness, ship.screws == 1
    w = min(max(wake, _WAKES[0]), _WAKES[1])
    eps = (
        with_scatter(2.26 - 1.82 * (1.0 - w), 0.15, YOSHIMURA)
        if behind_stern
        else Estimate(1.0, 0.15, "the wake at the propeller")
    )
    return {
        "t_R": with_scatter(0.45 - 0.28 * ship.block, 0.08, MATSUMOTO),
        "a_H": with_scatter(max(0.627 * ship.block - 0.153, 0.05), 0.08, KIJIMA),
        "x_H": with_scatter(-0.45, 0.05, "usual, Yasukawa and Yoshimura 2015"),
        "flow_straightening": with_scatter(2.06 * fullness + 0.14, 0.12, YOSHIMURA),
        "l_R": with_scatter(-0.9, 0.2, YOSHIMURA),
        "eps": eps,
        "kappa": with_scatter(0.55 - 0.8 * fullness, 0.2, KIJIMA),
    }
