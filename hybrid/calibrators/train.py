"""``seatrial train``: a calibrator on a reference model, and what it is worth on legs it did not see."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress, part_of
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.artefact import TrainedCalibrator
from hybrid.prediction.baselines import Fallback
from hybrid.prediction.dataset import Dataset, within_model_range
from hybrid.prediction.prediction_windows import PredictionWindows, draw_legs
from hybrid.prediction.scores import score
from hybrid.vessel.plant import Plant

HELD_OUT_SHARE = 0.2
METHOD = "adaptive"
"""The kind of calibrator that is trained unless another is asked for."""


def train(
    dataset: Dataset,
    vessel: str,
    plant: Plant,
    method: str = METHOD,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> TrainedCalibrator:
    """Train a calibrator of ``method`` and the network without a model on a data set.

    A share :data:`HELD_OUT_SHARE` of the legs is kept out for early stopping and for the radii of the regions.
    Raises :class:`DataShortageError` without windows in the range of the model, or with one leg only.
    """
    windows, tracks = within_model_range(dataset.windows, plant)
    held_out = draw_legs(windows, HELD_OUT_SHARE, seed)
    fitting = ~held_out
    training = (windows.subset(fitting), tracks[fitting])
    stopping = (windows.subset(held_out), tracks[held_out])
    calibrator = make_calibrator(method, seed, plant).fit(training, stopping, part_of(progress, 0, 2))
    data_driven = make_calibrator("data_driven", seed, plant).fit(training, stopping, part_of(progress, 1, 2))
    return TrainedCalibrator(
        calibrator=calibrator,
        data_driven=data_driven,
        horizon_s=windows.horizon_s,
        vessel=vessel,
        plant=plant,
        band_m=calibrator.conformal_radius(stopping),
        fallback=Fallback.fit(windows, tracks, plant),
        sources=tuple(replace(each, path=each.path.resolve()) for each in dataset.sources),
        metrics=_metrics(windows, training, stopping, calibrator.out_of_sample_tracks(stopping)),
    )


def _metrics(
    windows: PredictionWindows,
    training: tuple[PredictionWindows, Floats],
    stopping: tuple[PredictionWindows, Floats],
    predicted: Floats,
) -> dict[str, Any]:
    judged = stopping[0].whole
    measured = stopping[0].track[judged]
    return {
        "windows": int(windows.whole.sum()),
        "shorter_windows": int((~windows.whole).sum()),
        "legs": int(np.unique(windows.leg).size),
        "training_windows": int(training[0].whole.sum()),
        "held_out_windows": int(judged.sum()),
        "held_out_reference_m": score(stopping[1][judged], measured).mean_distance_m,
        "held_out_hybrid_m": score(predicted[judged], measured).mean_distance_m,
    }
