"""``seatrial validate``: every method on windows that no method has seen, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.errors import InputError
from hybrid.artefact import Trained, refuse_horizon
from hybrid.baselines import constant_velocity
from hybrid.gather import Gathered, Source
from hybrid.horizon import Horizons
from hybrid.scores import Score, distances, score
from hybrid.train import inside_range
from hybrid.vessel.plant import Plant

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Validation:
    """Scores and tracks by method, on the same windows for all.

    ``outside`` counts the windows left out because the reference model left its range in them;
    ``untrained`` [N] marks those whose start lies beyond what the calibrator was trained on.
    """

    horizons: Horizons
    tracks: dict[str, Floats]
    scores: dict[str, Score]
    outside: int
    coverage_95: float | None
    band_m: Floats | None
    untrained: NDArray[np.bool_] | None = None

    @property
    def reduction(self) -> float | None:
        """1 - hybrid / reference of the mean distance; None without a calibrator."""
        if "hybrid" not in self.scores:
            return None
        return 1.0 - self.scores["hybrid"].mean_distance_m / self.scores["reference"].mean_distance_m

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object."""
        return {
            "horizon_s": self.horizons.horizon_s,
            "windows": len(self.horizons),
            "outside_model_range": self.outside,
            "outside_training_range": None if self.untrained is None else int(self.untrained.sum()),
            "methods": {name: each.as_dict() for name, each in self.scores.items()},
            "reduction": self.reduction,
            "coverage_95": self.coverage_95,
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
    if trained is not None:
        tracks["data_driven"] = trained.data_driven.predict(horizons, reference_tracks)
        tracks["hybrid"] = trained.calibrator.predict(horizons, reference_tracks)
    return Validation(
        horizons=horizons,
        tracks=tracks,
        scores={name: score(track, horizons.track) for name, track in tracks.items()},
        outside=len(gathered.horizons) - len(horizons),
        coverage_95=None if trained is None else _coverage(tracks["hybrid"], horizons, trained.band_m),
        band_m=None if trained is None else trained.band_m,
        untrained=None if trained is None else trained.calibrator.outside(horizons, reference_tracks),
    )


def _coverage(predicted: Floats, horizons: Horizons, band_m: Floats) -> float:
    """The share of measured positions inside the band, over windows and seconds."""
    return float((distances(predicted, horizons.track) <= band_m).mean())
