"""The predictor of recordings: a reference model, or a calibrator on one."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from acquisition.core.errors import ConfigurationError
from acquisition.core.result import ChosenModel
from hybrid.calibrators.artefact import load
from hybrid.calibrators.train import TrainedCalibrator, plant_for
from hybrid.effects.catalogue import vessel_plant
from hybrid.vessel.files import Trials, chosen, reference_model
from hybrid.vessel.plant import Plant

HORIZON_S = 15
"""The default horizon [s]."""


@dataclass(frozen=True, slots=True)
class Predictor:
    """The reference model of a vessel, or a calibrator on it, with the horizon [s].

    ``calibrator`` is the folder that it came from; ``said`` are remarks on the choice.
    """

    vessel: str
    plant: Plant
    horizon_s: int
    trained: TrainedCalibrator | None = None
    calibrator: str = ""
    said: ChosenModel = field(default_factory=lambda: ChosenModel(""))


def predictor_of(
    trials: Trials,
    calibrator: TrainedCalibrator | str | Path | None = None,
    vessel: str | Path | None = None,
    horizon_s: int | None = None,
    usual_s: int = HORIZON_S,
) -> Predictor:
    """The calibrator, or without one the reference model that :func:`.reference_model` chooses for recordings.

    The default horizon is the calibrator's, or ``usual_s``. Raises :class:`InputError` for an unreadable
    calibrator, :class:`ConfigurationError` for a vessel other than the calibrator's.
    """
    if calibrator is None:
        model = reference_model(trials, vessel)
        return Predictor(model.file, vessel_plant(model.vessel), horizon_s or usual_s, said=model.said)
    loaded = isinstance(calibrator, TrainedCalibrator)
    trained = calibrator if isinstance(calibrator, TrainedCalibrator) else load(Path(calibrator))
    seconds = horizon_s or trained.horizon_s
    trained.refuse_horizon(seconds)
    plant = plant_for(trained, None if vessel is None else str(vessel))
    said = _said_of(trained, trials)
    return Predictor(trained.vessel, plant, seconds, trained, "" if loaded else str(calibrator), said)


def _said_of(trained: TrainedCalibrator, trials: Trials) -> ChosenModel:
    """Remarks on a calibrator's model, whose file may no longer exist: the calibrator holds all its numbers."""
    try:
        return reference_model(trials, trained.vessel).said
    except ConfigurationError:
        name = Path(trained.vessel).stem
        return chosen(name, {name}, trials)
