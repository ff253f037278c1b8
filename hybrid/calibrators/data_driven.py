"""The same network without a model: what the data alone can predict."""

from __future__ import annotations

from typing import ClassVar

from acquisition.core.arrays import Floats
from hybrid.calibrators.features import START_INPUTS, start_inputs
from hybrid.calibrators.network import NetworkCalibrator
from hybrid.prediction.prediction_windows import Horizons


class DataDriven(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start of the window."""

    method: ClassVar[str] = "data_driven"
    inputs: ClassVar[tuple[str, ...]] = START_INPUTS
    needs_reference: ClassVar[bool] = False

    def features(self, horizons: Horizons, reference: Floats) -> Floats:
        return start_inputs(horizons)
