"""Logs of a simulated ship in legs, with the noise of ordinary sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.log_by_hand import a_log

QUIET = DisturbanceNoise(gust=(100.0, 100.0, 1000.0), slow=(100.0, 100.0, 1000.0))
LEG_S = 80


def noisy_log(plant: Plant, seed: int, legs: int = 6) -> Log:
    """What the sensors of ``plant`` report of a run, with the sensors' noise of :data:`QUIET`; a block a leg."""
    log = a_log(plant, legs * LEG_S, tuple(range(LEG_S, legs * LEG_S, LEG_S)))
    error = np.random.default_rng(seed).standard_normal(log.measured.shape) * QUIET.as_array()[:6]
    return replace(log, measured=log.measured + error)
