"""The residual calibrator: what the paper argues against, kept to measure its argument.

The same network on the same inputs as the paper's, but what is learned is the error of the reference, which
is then added to the reference's track. Where there is nothing to learn it stays the reference.
"""

from __future__ import annotations

from typing import ClassVar

from acquisition.core.arrays import Floats
from hybrid.calibrators.features import displacement
from hybrid.calibrators.paper import PaperCalibrator
from hybrid.prediction.prediction_windows import Horizons


class AdditiveCalibrator(PaperCalibrator):
    """Measured minus reference displacement from the start and the reference's displacement."""

    method: ClassVar[str] = "additive"

    def base(self, horizons: Horizons, reference: Floats) -> Floats:
        return displacement(reference, horizons.start)
