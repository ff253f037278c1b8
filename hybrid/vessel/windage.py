"""What a vessel file tells the analysis of speed and power: dimensions and the wind's resistance."""

from __future__ import annotations

import numpy as np

from analysis.speed_power.conditions import Conditions
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.wind import HARMONICS, TABLE_SIZE

_MULTIPLES = (0.0, 1.0, 3.0, 5.0)  # of the angle, in the harmonics of CX


def conditions_of(vessel: Vessel) -> Conditions:
    """The part of the conditions of a speed trial that is the ship's; C_AA is her CX with the other sign.

    How she was loaded and what water she was in is not taken from her file: they are the day's.
    """
    wind, size = vessel.wind.numbers(vessel.dimensions), vessel.dimensions
    ahead = np.asarray(wind["CX"])
    if wind.get("wind_model") == HARMONICS:
        angles = np.linspace(0.0, np.pi, TABLE_SIZE)[:, np.newaxis]
        ahead = np.cos(angles * _MULTIPLES) @ ahead[: len(_MULTIPLES)]
    frontal = float(np.max(wind["frontal_area_m2"]))
    return Conditions(
        length_m=size.length_between_perpendiculars_m, beam_m=size.beam_m,
        frontal_area_m2=frontal or None, wind_resistance=tuple(map(float, -ahead)) if frontal else (),
    )  # fmt: skip
