"""``seatrial validate``: every method on windows that no method has seen, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from acquisition.core.errors import InputError
from hybrid.calibrators.artefact import Trained, refuse_horizon, speak
from hybrid.prediction.baselines import constant_velocity
from hybrid.prediction.dataset import Gathered, Source
from hybrid.prediction.prediction_windows import Horizons
from hybrid.prediction.regions import Predicted
from hybrid.prediction.scores import Score, distances, score
from hybrid.vessel.plant import Plant
from hybrid.workflows.train import inside_range


@dataclass(frozen=True, slots=True)
class Validation:
    """Scores and tracks by method, on the same windows for all.

    ``outside`` counts the windows left out because the reference model left its range in them;
    ``untrained`` [N] marks those whose start lies beyond what the calibrator was trained on: there the hybrid
    is reference and constant velocity, the better of them the louder, as ``spoken_by`` [N] says. ``radius_m``
    [N, H] are its 95 % regions, ``band_m`` [H] their median.
    """

    horizons: Horizons
    tracks: dict[str, Floats]
    scores: dict[str, Score]
    outside: int
    coverage_95: float | None
    band_m: Floats | None
    untrained: NDArray[np.bool_] | None = None
    radius_m: Floats | None = None
    spoken_by: NDArray[np.str_] | None = None

    @property
    def reduction(self) -> float | None:
        """1 - hybrid / reference of the mean distance; None without a calibrator."""
        if "hybrid" not in self.scores:
            return None
        return 1.0 - self.scores["hybrid"].mean_distance_m / self.scores["reference"].mean_distance_m

    @property
    def fallback(self) -> dict[str, int] | None:
        """In how many windows a baseline spoke for the calibrator, by its name; None without a calibrator."""
        if self.spoken_by is None:
            return None
        names, times = np.unique(self.spoken_by[self.spoken_by != "hybrid"], return_counts=True)
        return dict(zip(map(str, names), map(int, times), strict=True))

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object, and what Seatrial says beside."""
        return {
            "horizon_s": self.horizons.horizon_s,
            "windows": len(self.horizons),
            "outside_model_range": self.outside,
            "outside_training_range": None if self.untrained is None else int(self.untrained.sum()),
            "methods": {name: each.as_dict() for name, each in self.scores.items()},
            "reduction": self.reduction,
            "coverage_95": self.coverage_95,
            "band_m": None if self.band_m is None else [float(each) for each in self.band_m],
            "fallback": self.fallback,
        }


def refuse_seen(sources: tuple[Source, ...], trained: Trained) -> None:
    """Raise :class:`InputError` when a recording took part in the training."""
    seen = [each for each in sources if any(each.overlaps(other) for other in trained.sources)]
    if seen:
        raise InputError(
            "took part in the training of this calibrator",
            where=", ".join(str(each.path) for each in seen),
            fix="validate on other recordings or another --part, or say --allow-seen",
        )


def validate(gathered: Gathered, plant: Plant, trained: Trained | None = None) -> Validation:
    """Score every baseline, and the calibrator if there is one, on the windows of ``gathered``.

    Raises :class:`InputError` when the calibrator was trained for another horizon.
    """
    if trained is not None:
        refuse_horizon(gathered.horizons.horizon_s, trained)
    horizons, reference_tracks = inside_range(gathered.horizons, plant)
    tracks = {"constant_velocity": constant_velocity(horizons), "reference": reference_tracks}
    spoken = None
    if trained is not None:
        tracks["data_driven"] = trained.data_driven.predict(horizons, reference_tracks)
        spoken = speak(trained, horizons, reference_tracks)
        tracks["hybrid"] = spoken.tracks
    return Validation(
        horizons=horizons,
        tracks=tracks,
        scores={name: score(track, horizons.track) for name, track in tracks.items()},
        outside=len(gathered.horizons) - len(horizons),
        coverage_95=None if spoken is None else _coverage(spoken, horizons),
        band_m=None if spoken is None else np.median(spoken.radius_m, axis=0),
        untrained=None if spoken is None else spoken.untrained,
        radius_m=None if spoken is None else spoken.radius_m,
        spoken_by=None if spoken is None else spoken.method,
    )


def _coverage(spoken: Predicted, horizons: Horizons) -> float:
    """The share of measured positions inside their regions, over windows and seconds."""
    return float((distances(spoken.tracks, horizons.track) <= spoken.radius_m).mean())
