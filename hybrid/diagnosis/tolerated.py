"""Errors that every sensor and drive has anyway, as signatures with their standard deviations.

Those of the catalogue's own effects come from its ``tolerance``. Beside them stand what is no effect of any
catalogue: the wind that a vane reports in still air, and thruster settings that are recorded now and then only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.diagnosis.linearise import Model, Signature, next_states
from hybrid.diagnosis.log import Log
from hybrid.effects import Catalogue

WIND_MPS = 0.3
"""What an anemometer is off by in each direction: its noise has a mean, and the ship disturbs the air."""

_SETTING = ("command_delay", "thruster_lag")


def tolerances(log: Log, catalogue: Catalogue, signatures: Sequence[Signature]) -> Floats:
    """The standard deviation of what is tolerated of each signature's free coordinate [P], 0 for none."""
    result = []
    for each in signatures:
        effect = catalogue[each.effect]
        size = effect.parameters[each.coordinate].tolerance
        if each.effect in _SETTING and log.reading == "line":  # it may have changed at any time between two records
            size = max(size, 0.5 * log.setting_step_s)
        result.append(size if effect.chart == "linear" else 0.0)
    return np.array(result)


def wind_errors(log: Log, model: Model, origin: Floats) -> list[Signature]:
    """Signatures of 1 m/s more wind from the north, the east, ahead and starboard."""
    plant, none = model.plant(), np.zeros_like(origin)
    north, east = log.wind[:, 1] * np.cos(log.wind[:, 0]), log.wind[:, 1] * np.sin(log.wind[:, 0])
    cosine, sine = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    one, nil = np.ones(len(log)), np.zeros(len(log))
    ways = ((one, nil), (nil, one), (cosine, sine), (-sine, cosine))
    result = []
    for number, (to_north, to_east) in enumerate(ways):
        ends = []
        for side in (WIND_MPS, -WIND_MPS):
            n, e = north + side * to_north, east + side * to_east
            air = np.column_stack([np.arctan2(e, n), np.hypot(n, e)])
            ends.append(next_states(replace(log, wind=air), plant, origin))
        result.append(Signature("wind_error", number, (ends[0] - ends[1]) / (2.0 * WIND_MPS), none))
    return result
