"""What predicts on recordings: a reference model, or a calibrator on one."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from acquisition.core.errors import ConfigurationError
from acquisition.core.result import ChosenModel
from hybrid.calibrators.artefact import load
from hybrid.calibrators.train import TrainedCalibrator, plant_for
from hybrid.effects.catalogue import vessel_plant
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant
from hybrid.vessel.reference import Trials, chosen, reference_model, ships_of

HORIZON_S = 15
"""How far is predicted where nobody says [s]."""


@dataclass(frozen=True, slots=True)
class Predictor:
    """The reference model of a vessel, or a calibrator on it, and the horizon [s].

    ``calibrator`` is the folder that it came from; ``said`` what is to be said of the choice.
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

    Without a horizon that of the calibrator, or ``usual_s``. Raises :class:`InputError` for a calibrator that
    cannot be read, :class:`ConfigurationError` for a vessel that is not the calibrator's.
    """
    if calibrator is None:
        model = reference_model(trials, vessel)
        return Predictor(model.file, vessel_plant(model.vessel), horizon_s or usual_s, said=model.said)
    loaded = isinstance(calibrator, TrainedCalibrator)
    trained = calibrator if isinstance(calibrator, TrainedCalibrator) else load(Path(calibrator))
    if horizon_s is not None:
        trained.refuse_horizon(horizon_s)
    plant, name = plant_for(trained, None if vessel is None else str(vessel)), Path(trained.vessel).stem
    said = chosen(name, _ships_of(trained) | {name}, trials)
    return Predictor(trained.vessel, plant, trained.horizon_s, trained, "" if loaded else str(calibrator), said)


def _ships_of(trained: TrainedCalibrator) -> set[str]:
    """The ships that a calibrator's model is of, whose file may have gone: it holds all numbers itself."""
    try:
        return ships_of(load_vessel(trained.vessel))
    except ConfigurationError:
        return set()
