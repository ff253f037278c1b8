"""Force of the wind on hull and superstructure: from a table over the angle (paper, eq. 5), or harmonics of it.

The harmonics follow from a ship's outline by the regression of Fujiwara, Ueno and Nimura, J Soc Nav Archit Jpn 183
(1998), 77-90: wind tunnel results of 53 models, tankers, container ships, car carriers, passenger ships and others.
Its scatter is some 10 to 20 % of the largest coefficient of each force.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, pi, sin
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.analysis.compiling import Record, compiled

TABLE_SIZE = 19
TABLE, HARMONICS = 0.0, 1.0
"""How a plant's ``wind_model`` says what CX, CY and CN hold."""
_PER_STEP = (TABLE_SIZE - 1) / pi
_NO_TABLE = (0.0,) * TABLE_SIZE


@compiled
def wind_vector(p: Record, direction_rad: float, speed_mps: float) -> tuple[float, float]:
    """North and east component [m/s] of the air's motion, from the reported direction the wind comes FROM.

    This is the only door at which "from" becomes "to"; the vane's bias and its factor are taken out here.
    """
    true_rad = direction_rad - p.wind_direction_bias_rad
    speed = speed_mps / p.wind_speed_factor
    return -speed * cos(true_rad), -speed * sin(true_rad)


@compiled
def harmonic_force(p: Record, q: float, u_rw: float, v_rw: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the dynamic pressure ``q`` [Pa], of Fujiwara's harmonics.

    The angle of attack is counted from the bow towards port, where the air then comes from. X of its multiples
    0, 1, 3 and 5, Y of 1, 3 and 5, N of 1, 2 and 3. Fujiwara, Ueno and Nimura, J Soc Nav Archit Jpn 183 (1998), 77.
    """
    angle = -atan2(v_rw, u_rw)
    X = p.CX[0] + p.CX[1] * cos(angle) + p.CX[2] * cos(3.0 * angle) + p.CX[3] * cos(5.0 * angle)
    Y = p.CY[0] * sin(angle) + p.CY[1] * sin(3.0 * angle) + p.CY[2] * sin(5.0 * angle)
    N = p.CN[0] * sin(angle) + p.CN[1] * sin(2.0 * angle) + p.CN[2] * sin(3.0 * angle)
    length_m = p.length_between_perpendiculars_m
    return q * p.frontal_area_m2 * X, q * p.lateral_area_m2 * Y, q * p.lateral_area_m2 * length_m * N


@compiled
def wind_force(p: Record, u_rw: float, v_rw: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] at the ship's velocity relative to the air, body axes [m/s].

    Coefficients in a table are linear between its points, every 10 degrees of the angle between the bow and the
    direction the wind comes from; otherwise CX, CY and CN begin with the amplitudes of harmonics of that angle.
    """
    q = 0.5 * p.air_density_kgpm3 * (u_rw * u_rw + v_rw * v_rw) * p.wind_load_factor
    if p.wind_model != TABLE:
        X, Y, N = harmonic_force(p, q, u_rw, v_rw)
        return X, Y, N
    position = abs(atan2(v_rw, u_rw)) * _PER_STEP
    low = min(int(position), TABLE_SIZE - 2) if position >= 0.0 else 0  # NaN compares false
    part = position - low
    CX = p.CX[low] + part * (p.CX[low + 1] - p.CX[low])
    CY = p.CY[low] + part * (p.CY[low + 1] - p.CY[low])
    CN = p.CN[low] + part * (p.CN[low + 1] - p.CN[low])
    side = 0.0
    if v_rw > 0.0:
        side = -1.0
    elif v_rw < 0.0:
        side = 1.0
    lateral = q * p.lateral_area_m2 * side
    return q * p.frontal_area_m2 * CX, lateral * CY, lateral * p.length_overall_m * CN


Table = tuple[Number, ...]
WindNumbers = dict[str, float | Table]
_AREAS = ("frontal_area_m2", "lateral_area_m2", "air_density_kgpm3")


@dataclass(frozen=True, slots=True)
class Wind:
    """Windage areas and the coefficients at 0, 10, ... 180 degrees off the bow."""

    model: Literal["coefficients"]
    frontal_area_m2: Number
    lateral_area_m2: Number
    air_density_kgpm3: Number
    CX: Table
    CY: Table
    CN: Table

    def numbers(self, length_m: float, beam_m: float) -> WindNumbers:
        """What a plant holds of it."""
        return {name: getattr(self, name) for name in (*_AREAS, "CX", "CY", "CN")}


@dataclass(frozen=True, slots=True, kw_only=True)
class FujiwaraWind:
    """A ship's outline above water, from which a regression tells the coefficients.

    ``superstructure_area_m2`` is the lateral area above deck (A_OD); ``lateral_centre_m`` how far ahead of midship
    the centre of the lateral area lies (C) and ``lateral_centre_height_m`` how high above the water (H_C);
    ``bridge_centre_m`` how far ahead the centre of the superstructure lies (C_BR) and ``bridge_height_m`` how high
    its top (H_BR).
    """

    model: Literal["fujiwara"]
    frontal_area_m2: Number
    lateral_area_m2: Number
    air_density_kgpm3: Number
    superstructure_area_m2: Number
    lateral_centre_m: Number
    lateral_centre_height_m: Number
    bridge_centre_m: Number
    bridge_height_m: Number

    def numbers(self, length_m: float, beam_m: float) -> WindNumbers:
        """What a plant holds of it: the amplitudes of CX, CY and CN are those of cos 0, 1, 3, 5; of sin 1, 3, 5; of
        sin 1, 2, 3 of the angle of attack."""
        L, B = length_m, beam_m
        frontal, lateral, superstructure = self.frontal_area_m2, self.lateral_area_m2, self.superstructure_area_m2
        C, H_C, C_BR, H_BR = (
            self.lateral_centre_m, self.lateral_centre_height_m, self.bridge_centre_m, self.bridge_height_m,
        )  # fmt: skip
        side, front = lateral / (L * B), frontal / (B * H_BR)
        centre, bridge, height = C / L, C_BR / L, L * H_C / lateral
        deck, arm = superstructure / lateral, C / H_C
        X = (
            -0.330 + 0.293 / front + 0.0193 * arm + 0.682 * superstructure / L**2,
            -1.353 + 1.700 * side + 2.870 * height - 0.463 * L * H_BR / lateral - 0.570 * deck
            - 6.640 * frontal / (L * B) - 0.0123 * L**2 / frontal + 0.0202 * L / H_C,
            0.830 - 0.413 * lateral / (L * H_BR) - 0.0827 * lateral / frontal - 0.563 * height + 0.804 * deck
            - 5.670 * superstructure / L**2 + 0.0401 * arm - 0.132 * bridge,
            0.0372 - 0.0075 / deck - 0.103 * bridge + 0.0921 * side,
        )  # fmt: skip
        Y = (
            0.684 + 0.717 * bridge - 3.220 * centre + 0.0281 / deck + 0.0661 * arm + 0.298 * front,
            -0.400 + 0.282 * side + 0.307 * height + 0.0519 * bridge + 0.0526 * B / H_BR - 0.0814 * deck
            + 0.0582 * front,
            0.122 - 0.166 * side - 0.0054 * L / H_BR - 0.0481 * bridge - 0.0136 * B**2 / frontal + 0.0864 * centre
            - 0.0297 * C * H_C / lateral,
        )  # fmt: skip
        N = (
            0.299 + 1.710 * centre + 0.183 * height - 1.090 * frontal / lateral - 0.0442 * arm - 0.289 * side
            + 4.240 * frontal / L**2 - 0.0646 * B**2 / frontal + 0.0306 * bridge,
            0.117 + 0.123 * bridge - 0.323 * centre + 0.0041 / deck - 0.166 * frontal / B**2 - 0.0109 * L / H_BR
            + 0.174 * front + 0.214 * side - 1.060 * lateral / L**2,
            0.0230 + 0.0385 * bridge - 0.0339 * front + 0.0023 * lateral / frontal,
        )  # fmt: skip
        harmonics = {
            name: amplitudes + _NO_TABLE[len(amplitudes) :]
            for name, amplitudes in (("CX", X), ("CY", Y), ("CN", N))
        }
        return {**{name: getattr(self, name) for name in _AREAS}, **harmonics, "wind_model": HARMONICS}


@dataclass(frozen=True, slots=True)
class NoWind:
    """A ship whose windage is not modelled."""

    model: Literal["none"]

    def numbers(self, length_m: float, beam_m: float) -> WindNumbers:
        """What a plant holds of it."""
        return {**dict.fromkeys(_AREAS, 0.0), **dict.fromkeys(("CX", "CY", "CN"), _NO_TABLE)}
