"""How thruster settings are to be read between their records.

A drive moves from record to record, and a straight line between them is near the truth. A recorder, or a simulator,
that takes a setting and holds it until the next makes steps, half a record later or earlier in the mean than the
line: at one record a second enough to pass for what a ship lacks. The motion itself says which it is, and loudly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from hybrid.diagnosis.estimate_noise import spread_out
from hybrid.diagnosis.evidence import evidence_of, normal_equations
from hybrid.diagnosis.linearise import Model
from hybrid.diagnosis.log import INPUT_HOLDS, SELDOM_S, InputHold, Log, mean_settings
from hybrid.diagnosis.noise import Noise
from hybrid.diagnosis.select_effects import log_density, named, search_effects

_ENOUGH_S = 600.0  # of the log: it shows in every turn
_PLAIN = 20.0  # log likelihood by which steps have to be better than lines


def read_as_fits(log: Log, tables: Sequence[pd.DataFrame], model: Model, tolerance: float, noise: Noise) -> Log:
    """The log of ``tables`` with its settings read in the way that the motion asks for: as lines, or held."""
    best, likeliest, some = log, -np.inf, spread_out(log, _ENOUGH_S)
    for input_hold in INPUT_HOLDS:
        other = log if input_hold == log.input_hold else read_as(log, tables, input_hold)
        density = _explained(other.subset(some), model, tolerance, noise)
        density -= _PLAIN if input_hold != log.input_hold else 0.0
        if density > likeliest:
            best, likeliest = other, density
    return best


def _explained(log: Log, model: Model, tolerance: float, noise: Noise) -> float:
    """How likely the data are with what is missing in the model so read.

    Where settings come seldom, a lag or a delay is as large as the difference: about nothing it is not like itself.
    """
    if log.setting_step_s > SELDOM_S:
        naming = named(log, model, tolerance, noise)
        return log_density(naming.evidence, naming.names)
    evidence = evidence_of(normal_equations(log, model, tolerance, noise))
    return log_density(evidence, search_effects(evidence))


def read_as(log: Log, tables: Sequence[pd.DataFrame], input_hold: InputHold) -> Log:
    """The log of ``tables`` with its settings read in another way; where that is not known, as before."""
    controls = log.controls.copy()
    for number, table in enumerate(tables):
        rows = np.flatnonzero(log.recording == number)
        if not rows.size:
            continue
        first, last = log.time_s[rows].min(), log.time_s[rows].max()
        settings = mean_settings(table, np.arange(first, last + 1), input_hold)[log.time_s[rows] - first]
        controls[rows] = np.where(np.isfinite(settings), settings, controls[rows])
    return replace(log, controls=controls, input_hold=input_hold)
