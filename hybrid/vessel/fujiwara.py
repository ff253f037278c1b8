"""The wind's force on a ship from her outline: the regression of Fujiwara, Ueno and Nimura.

J Soc Nav Archit Jpn 183 (1998), 77-90: wind tunnel results of 53 models, tankers, container ships, car carriers,
passenger ships and others. Its scatter is some 10 to 20 % of the largest coefficient of each force.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Outline:
    """What the regression asks of a ship [m, m2].

    ``superstructure_area_m2`` is the lateral area above deck (A_OD); ``lateral_centre_m`` how far ahead of midship
    the centre of the lateral area lies (C) and ``lateral_centre_height_m`` how high above the water (H_C);
    ``bridge_centre_m`` how far ahead the centre of the superstructure lies (C_BR) and ``bridge_height_m`` how high
    its top (H_BR).
    """

    length_m: float
    beam_m: float
    frontal_area_m2: float
    lateral_area_m2: float
    superstructure_area_m2: float
    lateral_centre_m: float
    lateral_centre_height_m: float
    bridge_centre_m: float
    bridge_height_m: float


Harmonics = tuple[float, ...]


def fujiwara(ship: Outline) -> tuple[Harmonics, Harmonics, Harmonics]:
    """The amplitudes of CX, CY and CN: of cos 0, 1, 3, 5; of sin 1, 3, 5; of sin 1, 2, 3 of the angle of attack."""
    L, B = ship.length_m, ship.beam_m
    frontal, lateral, above = ship.frontal_area_m2, ship.lateral_area_m2, ship.superstructure_area_m2
    C, H_C, C_BR, H_BR = (
        ship.lateral_centre_m, ship.lateral_centre_height_m, ship.bridge_centre_m, ship.bridge_height_m,
    )  # fmt: skip
    side, front = lateral / (L * B), frontal / (B * H_BR)
    centre, bridge, height = C / L, C_BR / L, L * H_C / lateral
    deck, arm = above / lateral, C / H_C
    X = (
        -0.330 + 0.293 / front + 0.0193 * arm + 0.682 * above / L**2,
        -1.353 + 1.700 * side + 2.870 * height - 0.463 * L * H_BR / lateral - 0.570 * deck
        - 6.640 * frontal / (L * B) - 0.0123 * L**2 / frontal + 0.0202 * L / H_C,
        0.830 - 0.413 * lateral / (L * H_BR) - 0.0827 * lateral / frontal - 0.563 * height + 0.804 * deck
        - 5.670 * above / L**2 + 0.0401 * arm - 0.132 * bridge,
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
    return X, Y, N
