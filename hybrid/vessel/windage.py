"""What a vessel file tells the analysis of speed and power: dimensions and the wind's resistance."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.trial import Trial
from seatrial.analysis.conditions import recorded_conditions
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.wind import HARMONICS, TABLE_SIZE

_MULTIPLES = (0.0, 1.0, 3.0, 5.0)  # of the angle, in the harmonics of CX


def conditions_of(vessel: Vessel) -> Conditions:
    """The part of the conditions of a speed trial that is the ship's; C_AA is its CX with the other sign.

    How it was loaded and what water it was in is not taken from its file: they are the day's.
    """
    size = vessel.dimensions
    wind = vessel.wind.numbers(size.length_between_perpendiculars_m, size.beam_m)
    ahead = np.asarray(wind["CX"])
    if wind.get("wind_model") == HARMONICS:
        angles = np.linspace(0.0, np.pi, TABLE_SIZE)[:, np.newaxis]
        ahead = np.cos(angles * _MULTIPLES) @ ahead[: len(_MULTIPLES)]
    frontal = float(np.max(wind["frontal_area_m2"]))
    return Conditions(
        length_m=size.length_between_perpendiculars_m, beam_m=size.beam_m,
        frontal_area_m2=frontal or None, wind_resistance=tuple(map(float, -ahead)) if frontal else (),
    )  # fmt: skip


def known_conditions(
    recorded: Iterable[tuple[Trial, pd.DataFrame]], ship: Vessel | None, stated: Conditions | None = None
) -> Conditions:
    """What is known for the corrections: what is ``stated``, then what recordings say, then the vessel file."""
    conditions = stated or Conditions()
    for trial, table in recorded:
        conditions = conditions.with_known(recorded_conditions(trial, table))
    return conditions if ship is None else conditions.with_known(conditions_of(ship))
