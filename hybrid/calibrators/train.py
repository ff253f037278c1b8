"""``seatrial train``: a calibrator on a reference model, its accuracy on held-out legs, and its use."""

from __future__ import annotations

import platform
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError, InputError, Progress, part_of
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import ModelResult
from seatrial.acquisition.core.trial import software_version
from seatrial.hybrid.calibrators import can_train, make_calibrator
from seatrial.hybrid.calibrators.calibrator import Calibrator, Examples, PredictedTracks, predict_with_fallback
from seatrial.hybrid.effects.catalogue import vessel_plant
from seatrial.hybrid.prediction.baselines import Fallback
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, within_model_range
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, clear_of, draw_windows, unlike_groups
from seatrial.hybrid.prediction.scores import score
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant, plant_hash

HELD_OUT_SHARE = 0.2
METHOD = "adaptive"
"""The default method."""


def versions() -> dict[str, str]:
    """The versions of the software used for training."""
    libraries = {name: version(name) for name in ("torch", "numpy") if find_spec(name)}
    return {
        "seatrial": software_version().removeprefix("seatrial "),
        "python": platform.python_version(),
    } | libraries


@dataclass(frozen=True, slots=True)
class TrainedCalibrator(ModelResult):
    """A trained calibrator, as saved and used for predictions.

    ``calibrator`` corrects the reference model ``plant``, called ``vessel``; ``data_driven`` was trained on the
    same windows without a model, None if networks could not be trained. ``region_m`` [H, 2] are the semi-axes
    of the 95 % region by second for a relative uncertainty of one, from held-out legs; ``fallback`` predicts
    outside the domain of applicability.
    """

    calibrator: Calibrator
    data_driven: Calibrator | None
    horizon_s: int
    vessel: str
    plant: Plant
    region_m: Floats
    fallback: Fallback
    sources: tuple[WindowSource, ...]
    metrics: dict[str, Any]
    trained_at: datetime = field(default_factory=lambda: datetime.now(UTC).replace(microsecond=0))
    versions: dict[str, str] = field(default_factory=versions)
    view = "seatrial.hybrid.report.tables:training_view"
    drawing = "seatrial.hybrid.report.plots:draw_regions"
    size_inch = (7.0, 4.0)

    def predict_tracks(self, windows: PredictionWindows, reference: Floats) -> PredictedTracks:
        """Tracks and regions, by the fallback outside the domain of applicability.

        ``reference`` [N, H+1, 3] are the reference model's tracks on the windows.
        """
        return predict_with_fallback(self.calibrator, self.plant, self.region_m, self.fallback, windows, reference)

    def refuse_commands(self) -> None:
        """Raise :class:`InputError` if it was trained on held controls and so cannot take any commands."""
        if not self.calibrator.any_commands:
            raise InputError(
                "the calibrator was trained on held controls and cannot predict with other commands",
                fix="leave --any or --commands out, or train again with --any",
            )

    def refuse_horizon(self, horizon_s: int) -> None:
        """Raise :class:`InputError` if it was trained for a shorter horizon."""
        if horizon_s > self.horizon_s:
            raise InputError(
                f"the calibrator predicts at most {self.horizon_s} s, not {horizon_s} s",
                fix=f"use --horizon {self.horizon_s}, or train again",
            )


def plant_for(trained: TrainedCalibrator, vessel: str | None) -> Plant:
    """The reference model that a calibrator was trained on; ``vessel`` may confirm it but not replace it.

    Raises :class:`ConfigurationError` if the named model differs in any number from that of the training.
    """
    if vessel is not None and plant_hash(vessel_plant(load_vessel(vessel))) != plant_hash(trained.plant):
        raise ConfigurationError(
            f"vessel {vessel!r} is not the model that the calibrator was trained on",
            why=f"it was trained on {trained.vessel!r}, and the numbers differ",
            fix="leave --vessel out, give that vessel, or train again",
        )
    return trained.plant


def train(
    dataset: Dataset,
    vessel: str,
    plant: Plant,
    method: str = METHOD,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> TrainedCalibrator:
    """Train a calibrator of ``method`` on a data set and, if networks can be trained, the one without a model.

    A share :data:`HELD_OUT_SHARE` of the legs, or of the recordings with any commands, is held out for early
    stopping and for the size of the regions. Raises :class:`DataShortageError` without windows in the range of
    the model, or with only one leg.
    """
    windows, tracks = within_model_range(dataset.windows, plant)
    held_out = draw_windows(windows, unlike_groups(windows), HELD_OUT_SHARE, seed)
    fitting = clear_of(windows, ~held_out, held_out)
    training = (windows.subset(fitting), tracks[fitting])
    stopping = (windows.subset(held_out), tracks[held_out])
    calibrator = make_calibrator(method, seed, plant).fit(training, stopping, part_of(progress, 0, 2))
    data_driven = None
    if can_train("data_driven"):
        data_driven = make_calibrator("data_driven", seed, plant).fit(training, stopping, part_of(progress, 1, 2))
    return TrainedCalibrator(
        calibrator=calibrator,
        data_driven=data_driven,
        horizon_s=windows.horizon_s,
        vessel=vessel,
        plant=plant,
        region_m=calibrator.conformal_region(stopping),
        fallback=Fallback.fit(windows, tracks, plant),
        sources=tuple(replace(source, path=source.path.resolve()) for source in dataset.sources),
        metrics=_metrics(windows, training, stopping, calibrator.out_of_sample_tracks(stopping)),
    )


def _metrics(
    windows: PredictionWindows, training: Examples, stopping: Examples, predicted: Floats
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
