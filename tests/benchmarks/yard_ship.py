"""A ship of its own for the benchmarks of sea trials: the standard MMG model with the published figures of KVLCC2.

Nothing here comes from the simulator of Seatrial, so that what is wrong there does not hide what is wrong in the
analysis. Hull, propeller and rudder are those of Yasukawa and Yoshimura (J Mar Sci Technol 20, 2015, 37-52), scaled
to a length and varied by chance; wind presses on the area above water, the current carries the ship along. The
helmsman holds the course of the approach until the order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import atan2, cos, exp, hypot, inf, isfinite, pi, sin, sqrt

import numpy as np

from seatrial.acquisition.core.quantities import Floats

STEP_S = 0.1
_RHO, _RHO_AIR, _G = 1025.0, 1.225, 9.81
_KVLCC2_M = 320.0
_HULL = {
    "R0": 0.022, "Xvv": -0.040, "Xvr": 0.002, "Xrr": 0.011, "Xvvvv": 0.771,
    "Yv": -0.315, "Yr": 0.083, "Yvvv": -1.607, "Yvvr": 0.379, "Yvrr": -0.391, "Yrrr": 0.008,
    "Nv": -0.137, "Nr": -0.049, "Nvvv": -0.030, "Nvvr": -0.294, "Nvrr": 0.055, "Nrrr": -0.013,
}  # fmt: skip
_PORT_BIAS_SHARE = 0.0005  # of the moment of the hull at a drift of one: no ship is quite even


@dataclass(slots=True)
class Order:
    """What is ordered when: a helm [deg] and a shaft speed as a share of the usual one."""

    helm_deg: float
    shaft: float = 1.0


Pilot = Callable[[float, float, float, float], Order]
"""The orders at a time [s], from the heading and its rate [deg, deg/s] and the speed ahead [m/s]."""


@dataclass(slots=True)
class Sailed:
    """What a ship did, every tenth of a second [rows]: midship over ground, helm and shaft, and the orders."""

    time_s: Floats
    north_m: Floats
    east_m: Floats
    heading_deg: Floats
    surge_mps: Floats
    sway_mps: Floats
    yaw_rate_dps: Floats
    helm_deg: Floats
    rpm: Floats
    helm_order_deg: Floats
    ahead_mps: Floats
    rpm_order: Floats


@dataclass(frozen=True, slots=True)
class YardShip:
    """A ship of ``length_m`` [m] with hull figures of her own, her helm's rate [deg/s], how long her engine does
    nothing after an order [s], and the day's current and wind [m/s, to and from deg]."""

    length_m: float
    froude: float = 0.14
    rudder: float = 1.0
    helm_rate_dps: float = 2.34
    helm_lag_s: float = 0.3
    shaft_lag_s: float = 8.0
    current_mps: float = 0.0
    current_to_deg: float = 0.0
    wind_mps: float = 0.0
    wind_from_deg: float = 0.0
    hull: dict[str, float] = field(default_factory=lambda: dict(_HULL))
    engine_dead_s: float = 0.0

    @property
    def speed_mps(self) -> float:
        """The speed of the approach in still water and air."""
        return self.froude * sqrt(_G * self.length_m)

    @property
    def rpm(self) -> float:
        """The shaft speed that gives it."""
        low, high = 0.1, 20.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._ahead(middle) < 0.0 else (low, middle)
        return 60.0 * low

    def _ahead(self, n_rps: float) -> float:
        """Thrust less resistance at the speed of the approach [N]."""
        scale = self.length_m / _KVLCC2_M
        resistance = 0.5 * _RHO * self.length_m * 20.8 * scale * self.speed_mps**2 * self.hull["R0"]
        return (1.0 - 0.22) * self._thrust(n_rps, 0.65 * self.speed_mps) - resistance

    def _thrust(self, n_rps: float, inflow_mps: float) -> float:
        diameter = 9.86 * self.length_m / _KVLCC2_M
        if abs(n_rps) < 1e-6:
            return 0.0
        if n_rps < 0.0:
            return -0.25 * _RHO * n_rps**2 * diameter**4
        J = max(min(inflow_mps / (n_rps * diameter), 1.2), 0.0)
        return _RHO * n_rps**2 * diameter**4 * (0.2931 - 0.2753 * J - 0.1385 * J**2)

    def sail(self, pilot: Pilot, until: Callable[[float, float, float], bool], longest_s: float = 6000.0) -> Sailed:
        """Sail by a pilot's orders ``until`` (time, heading, speed ahead), from the course 0 at the usual speed."""
        L, scale = self.length_m, self.length_m / _KVLCC2_M
        d, x_G, h = 20.8 * scale, 11.2 * scale, self.hull
        m = _RHO * 0.810 * L * 58.0 * scale * d
        half = 0.5 * _RHO * L**2 * d
        mx, my, Jz = 0.022 * half, 0.223 * half, 0.011 * half * L**2
        Iz, area, span = m * (0.25 * L) ** 2, 112.5 * scale**2 * self.rudder, 15.8 * scale
        f_alpha = 6.13 * (span**2 / area) / (span**2 / area + 2.25)
        diameter, usual_rps, still = 9.86 * scale, self.rpm / 60.0, self.speed_mps
        side_area = 0.06 * L**2  # above water, loaded
        to, wind = self.current_to_deg * pi / 180.0, self.wind_from_deg * pi / 180.0
        flow = self.current_mps * cos(to), self.current_mps * sin(to)
        air = -self.wind_mps * cos(wind), -self.wind_mps * sin(wind)
        u, v, r, psi, north, east, delta, n = still, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, usual_rps
        rows, slew, last = [], 0.0, (0.0, 0.0)
        dead_rows = round(self.engine_dead_s / STEP_S)
        det = (m + my) * (Iz + x_G**2 * m + Jz) - (x_G * m) ** 2
        for number in range(round(longest_s / STEP_S)):
            now = number * STEP_S
            order = pilot(now, psi * 180.0 / pi, r * 180.0 / pi, u)
            c, s = cos(psi), sin(psi)
            over = (u * c - v * s + flow[0], u * s + v * c + flow[1])
            north, east = (at + 0.5 * (one + other) * STEP_S for at, one, other in
                           zip((north, east), last, over, strict=True))  # fmt: skip
            last = over
            rows.append((now, north, east, psi, over[0] * c + over[1] * s, -over[0] * s + over[1] * c, r, delta,
                         60.0 * n, order.helm_deg, u, 60.0 * order.shaft * usual_rps))  # fmt: skip
            if until(now, psi * 180.0 / pi, u):
                break
            U = max(hypot(u, v), 1e-3)
            vn, rn = v / U, r * L / U
            q = 0.5 * _RHO * L * d * U**2
            X_H = q * (-h["R0"] * (u * abs(u)) / U**2 + h["Xvv"] * vn**2 + h["Xvr"] * vn * rn + h["Xrr"] * rn**2
                       + h["Xvvvv"] * vn**4)  # fmt: skip
            Y_H = q * (h["Yv"] * vn + h["Yr"] * rn + h["Yvvv"] * vn**3 + h["Yvvr"] * vn**2 * rn
                       + h["Yvrr"] * vn * rn**2 + h["Yrrr"] * rn**3)  # fmt: skip
            N_H = q * L * (h["Nv"] * vn + h["Nr"] * rn + h["Nvvv"] * vn**3 + h["Nvvr"] * vn**2 * rn
                           + h["Nvrr"] * vn * rn**2 + h["Nrrr"] * rn**3 + _PORT_BIAS_SHARE)  # fmt: skip
            beta = atan2(-v, u) if u > 0.05 else 0.0
            beta_P = beta + 0.48 * rn
            C2 = 1.6 if beta_P > 0 else 1.1
            wake = 1.0 - min((1.0 - 0.35) * (1.0 + (1.0 - exp(-2.0 * abs(beta_P))) * (C2 - 1.0)), 1.0)
            u_P = (1.0 - wake) * max(u, 0.0)
            thrust = self._thrust(n, u_P)
            J = u_P / (n * diameter) if n > 1e-6 else inf
            K_T = 0.2931 - 0.2753 * J - 0.1385 * J**2 if isfinite(J) else 0.0
            slip = 0.5 * (sqrt(1.0 + 8.0 * max(K_T, 0.0) / (pi * J**2)) - 1.0) + 1.0 if 1e-3 < J < 1.0 else 1.0
            eta = diameter / span
            u_R = 1.09 * u_P * sqrt(eta * (1.0 + 0.5 * (slip - 1.0)) ** 2 + 1.0 - min(eta, 1.0))
            beta_R = beta + 0.710 * rn
            v_R = U * (0.640 if beta_R > 0 else 0.395) * beta_R
            F_N = 0.5 * _RHO * area * (u_R**2 + v_R**2) * f_alpha * sin(delta - atan2(v_R, max(u_R, 1e-3)))
            va = (air[0] - over[0], air[1] - over[1])
            side, along = -va[0] * s + va[1] * c, va[0] * c + va[1] * s
            gust = 0.5 * _RHO_AIR * side_area
            X = X_H + 0.78 * thrust - 0.613 * F_N * sin(delta) + 0.15 * gust * along * abs(along)
            Y = Y_H - 1.312 * F_N * cos(delta) + 0.9 * gust * side * abs(side)
            N = N_H - (-0.5 + 0.312 * -0.464) * L * F_N * cos(delta) + 0.03 * gust * L * side * abs(side)
            ud = (X + (m + my) * v * r + x_G * m * r**2) / (m + mx)
            f, g = Y - (m + mx) * u * r, N - x_G * m * u * r
            vd = ((Iz + x_G**2 * m + Jz) * f - x_G * m * g) / det
            rd = ((m + my) * g - x_G * m * f) / det
            psi += (r + 0.5 * rd * STEP_S) * STEP_S
            u, v, r = u + ud * STEP_S, v + vd * STEP_S, r + rd * STEP_S
            wanted = (order.helm_deg * pi / 180.0 - delta) / max(self.helm_lag_s, STEP_S)
            limit = self.helm_rate_dps * pi / 180.0
            slew = max(-limit, min(limit, wanted))
            delta += slew * STEP_S
            obeyed_rps = rows[max(number - dead_rows, 0)][-1] / 60.0
            n += (obeyed_rps - n) * STEP_S / self.shaft_lag_s
        columns = np.array(rows).T
        columns[[3, 6, 7]] = np.rad2deg(columns[[3, 6, 7]])
        return Sailed(*columns)


def held_course(course_deg: float, heading_deg: float, rate_dps: float, length_per_speed_s: float) -> float:
    """The helm [deg] of a steady hand on a course: proportional and derivative, in whole degrees."""
    wanted = -1.0 * (heading_deg - course_deg) - 0.7 * length_per_speed_s * rate_dps
    return max(-10.0, min(10.0, float(round(wanted))))


def drawn_hull(random: np.random.Generator, share: float = 0.12) -> dict[str, float]:
    """Hull figures by chance, each within some share of the published ones."""
    return {name: value * float(random.uniform(1.0 - share, 1.0 + share)) for name, value in _HULL.items()}
