"""The calibrator of Wang, Li et al. 2021: start and reference position in, position out.

What is learned is the map from the approximate track to the real one, not its error.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.calibrators.features import REFERENCE_INPUTS, START_INPUTS, displacement, start_inputs
from hybrid.calibrators.network import NetworkCalibrator
from hybrid.prediction.prediction_windows import Horizons


class PaperCalibrator(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start and the reference's displacement."""

    method: ClassVar[str] = "paper"
    inputs: ClassVar[tuple[str, ...]] = (*START_INPUTS, *REFERENCE_INPUTS)
    needs_reference: ClassVar[bool] = True

    def features(self, horizons: Horizons, reference: Floats) -> Floats:
        moved = displacement(reference, horizons.start)
        return np.concatenate([start_inputs(horizons), moved], axis=-1)
