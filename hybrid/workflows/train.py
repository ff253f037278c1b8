"""``seatrial train``: a calibrator on a reference model, and what it is worth on legs it did not see."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress, part_of
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.artefact import Trained
from hybrid.prediction.baselines import reference
from hybrid.prediction.dataset import Gathered
from hybrid.prediction.prediction_windows import Horizons, drawn_legs
from hybrid.prediction.regions import reserve_of
from hybrid.prediction.scores import score
from hybrid.vessel.plant import Plant

HELD_OUT_SHARE = 0.2
METHOD = "adaptive"
"""The kind of calibrator that is trained unless another is asked for."""


def inside_range(horizons: Horizons, plant: Plant) -> tuple[Horizons, Floats]:
    """The windows in which the reference model stays in its range, and its tracks.

    Raises :class:`DataShortageError` when there are none.
    """
    tracks = reference(horizons, plant)
    inside = np.asarray(np.isfinite(tracks).all(axis=(1, 2)))
    if not inside.any():
        raise DataShortageError(
            "the reference model leaves its range in every window",
            why="speeds or thrusts are not those of this vessel",
            fix="check --vessel and the units of the recording",
        )
    return horizons.subset(inside), tracks[inside]


def train(
    gathered: Gathered,
    vessel: str,
    plant: Plant,
    method: str = METHOD,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> Trained:
    """Fit the calibrator and its twin without a model; legs kept out stop networks and size their regions."""
    horizons, tracks = inside_range(gathered.horizons, plant)
    held_out = drawn_legs(horizons, HELD_OUT_SHARE, seed)
    fitting = ~held_out
    training = (horizons.subset(fitting), tracks[fitting])
    stopping = (horizons.subset(held_out), tracks[held_out])
    calibrator = make_calibrator(method, seed, plant).fit(training, stopping, part_of(progress, 0, 2))
    data_driven = make_calibrator("data_driven", seed, plant).fit(training, stopping, part_of(progress, 1, 2))
    return Trained(
        calibrator=calibrator,
        data_driven=data_driven,
        horizon_s=horizons.horizon_s,
        vessel=vessel,
        plant=plant,
        band_m=calibrator.region(stopping),
        reserve=reserve_of(horizons, tracks, plant),
        sources=tuple(replace(each, path=each.path.resolve()) for each in gathered.sources),
        metrics=_metrics(horizons, training, stopping, calibrator.unseen(stopping)),
    )


def _metrics(
    horizons: Horizons,
    training: tuple[Horizons, Floats],
    stopping: tuple[Horizons, Floats],
    predicted: Floats,
) -> dict[str, Any]:
    judged = stopping[0].whole
    measured = stopping[0].track[judged]
    return {
        "windows": int(horizons.whole.sum()),
        "shorter_windows": int((~horizons.whole).sum()),
        "legs": int(np.unique(horizons.leg).size),
        "training_windows": int(training[0].whole.sum()),
        "held_out_windows": int(judged.sum()),
        "held_out_reference_m": score(stopping[1][judged], measured).mean_distance_m,
        "held_out_hybrid_m": score(predicted[judged], measured).mean_distance_m,
    }
