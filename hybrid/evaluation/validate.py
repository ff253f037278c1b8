"""``seatrial validate``: every method on unseen windows, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import ModelResult, to_json
from seatrial.hybrid.calibrators.calibrator import PredictedTracks
from seatrial.hybrid.calibrators.train import TrainedCalibrator
from seatrial.hybrid.evaluation.length_times import LengthErrors
from seatrial.hybrid.evaluation.manoeuvre_indices import IndexComparisons
from seatrial.hybrid.evaluation.truth import Truths, judged_by_truths, truth_distances
from seatrial.hybrid.prediction.baselines import reference, untrained_tracks
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, within_model_range
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, starting_two_sided
from seatrial.hybrid.prediction.regions import bands, relative_distances
from seatrial.hybrid.prediction.scores import TWO_SIDED, Score, score, scores_json
from seatrial.hybrid.vessel.plant import Plant


@dataclass(frozen=True, slots=True)
class Validation(ModelResult):
    """Scores and tracks by method, on the same windows for all, from starts as they were known at second 0.

    ``two_sided`` has the scores from the starts as they are known afterwards, by the seconds to either side.

    ``outside`` counts the windows left out because the reference model left its range in them, ``jumps`` those in
    which the positions jump. With a calibrator, ``outside_domain`` [N] marks the windows outside its domain of
    applicability, where the fallback predicts unless it extrapolates; ``source`` [N] names who predicted;
    ``region_m`` [N, H, 2] are the semi-axes of its 95 % regions.
    ``truths`` judges the methods by each sensor, where the windows have their tracks. ``by_length`` are the errors
    after so many L/V, ``indices`` the measured indices of the manoeuvres beside the model's; None where not asked.
    """

    windows: PredictionWindows
    tracks: dict[str, Floats]
    scores: dict[str, Score]
    two_sided: dict[str, Score]
    outside: int
    coverage_95: float | None
    outside_domain: NDArray[np.bool_] | None = None
    region_m: Floats | None = None
    source: NDArray[np.str_] | None = None
    truths: Truths | None = None
    jumps: int = 0
    by_length: LengthErrors | None = None
    indices: IndexComparisons | None = None
    view = "seatrial.hybrid.report.tables:validation_view"
    drawing = "seatrial.hybrid.report.plots:draw_validation"

    @property
    def measurements(self) -> str:
        """A remark if positions and speeds disagree."""
        return self.truths.remark if self.truths else ""

    @property
    def reduction(self) -> float | None:
        """1 - hybrid / reference of the mean distance; None without a calibrator."""
        if "hybrid" not in self.scores:
            return None
        return 1.0 - self.scores["hybrid"].mean_distance_m / self.scores["reference"].mean_distance_m

    @property
    def fallback(self) -> dict[str, int] | None:
        """The number of windows predicted by the fallback, by its main baseline; None without a calibrator."""
        if self.source is None:
            return None
        names, times = np.unique(self.source[self.source != "hybrid"], return_counts=True)
        return dict(zip(map(str, names), map(int, times), strict=True))

    def as_dict(self) -> dict[str, Any]:
        """The JSON object of ``seatrial validate --json``."""
        middle_m = None if self.region_m is None else np.median(self.region_m, axis=0)
        return {
            **self.remarks,
            "horizon_s": self.windows.horizon_s,
            "windows": len(self.windows),
            "outside_model_range": self.outside,
            "position_jump": self.jumps,
            "outside_training_range": None if self.outside_domain is None else int(self.outside_domain.sum()),
            "methods": scores_json(self.scores | self.two_sided),
            "reduction": self.reduction,
            "coverage_95": self.coverage_95,
            **{name: None if each is None else each.tolist() for name, each in bands(middle_m).items()},
            "fallback": self.fallback,
            "truths": to_json(self.truths),
            "by_length": None if self.by_length is None else self.by_length.as_json(self.windows.horizon_s),
            **(self.indices or IndexComparisons()).as_json(),
        }


def refuse_training_data(sources: tuple[WindowSource, ...], trained: TrainedCalibrator) -> None:
    """Raise :class:`InputError` if a recording was used for training."""
    known = [each for each in sources if any(each.overlaps(other) for other in trained.sources)]
    if known:
        raise InputError(
            "took part in the training of this calibrator",
            where=", ".join(str(each.path) for each in known),
            fix="validate on other recordings or another --part, or use --allow-seen",
        )


def validate(dataset: Dataset, plant: Plant, trained: TrainedCalibrator | None = None) -> Validation:
    """Score every baseline, and the calibrator if there is one, on the windows of ``dataset``.

    Raises :class:`InputError` if the calibrator was trained for a shorter horizon, or on held controls while
    the windows have any commands.
    """
    if trained is not None:
        trained.refuse_horizon(dataset.windows.horizon_s)
        if dataset.windows.commands is not None:
            trained.refuse_commands()
    windows, reference_tracks = within_model_range(dataset.windows, plant)
    tracks, hybrid = _tracks(windows, reference_tracks, trained)
    afterwards = starting_two_sided(windows)
    return Validation(
        windows=windows,
        tracks=tracks,
        scores=_scores(tracks, windows),
        two_sided=_scores(_tracks(afterwards, reference(afterwards, plant), trained)[0], windows, TWO_SIDED),
        outside=len(dataset.windows) - len(windows),
        coverage_95=None if hybrid is None else _coverage(hybrid, windows),
        outside_domain=None if hybrid is None else hybrid.outside_domain,
        region_m=None if hybrid is None else hybrid.region_m,
        source=None if hybrid is None else hybrid.source,
        jumps=dataset.dropped.get("position_jump", 0),
        truths=judged_by_truths(windows, {name: truth_distances(each, windows) for name, each in tracks.items()}),
    )


def _scores(tracks: Mapping[str, Floats], windows: PredictionWindows, ending: str = "") -> dict[str, Score]:
    return {f"{name}{ending}": score(track, windows.track) for name, track in tracks.items()}


def _tracks(
    windows: PredictionWindows, reference_tracks: Floats, trained: TrainedCalibrator | None
) -> tuple[dict[str, Floats], PredictedTracks | None]:
    """The tracks by method, and the calibrator's with their regions if there is one."""
    tracks = untrained_tracks(windows, reference_tracks)
    if trained is None:
        return tracks, None
    hybrid = trained.predict_tracks(windows, reference_tracks)
    if trained.data_driven is not None:
        tracks["data_driven"] = trained.data_driven.predict(windows, reference_tracks)
    return {**tracks, "hybrid": hybrid.tracks}, hybrid


def _coverage(predicted: PredictedTracks, windows: PredictionWindows) -> float:
    """The share of measured positions inside their regions, over windows and seconds."""
    return float((relative_distances(predicted.tracks, windows.track, predicted.region_m) <= 1.0).mean())
