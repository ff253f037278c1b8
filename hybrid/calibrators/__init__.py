"""Calibrators behind one interface: fit to windows, predict tracks with uncertainty, save; and their training.

The methods by name are imported on first use. :func:`predict_with_fallback` makes the predictions, with the
fallback outside the domain of applicability, and :func:`train_calibrator` is ``seatrial train``: a calibrator on a
reference model with its accuracy on held-out legs.
"""

from __future__ import annotations

import platform
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from seatrial.acquisition.core import named_code, ship, trial
from seatrial.acquisition.core.errors import ConfigurationError, InputError, Progress, join_words, subtask_progress
from seatrial.acquisition.core.quantities import Bools, Floats, Strings
from seatrial.acquisition.core.result import ChosenModel, ModelResult
from seatrial.hybrid.effects import catalogue_of, simulators, vessel_plant
from seatrial.hybrid.prediction import baselines, window_sets
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, windows_within_model_range
from seatrial.hybrid.vessel import files
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel, model_digest

# Imported when first used.
_METHODS = {
    "paper": "seatrial.hybrid.calibrators.networks:PaperCalibrator",
    "data_driven": "seatrial.hybrid.calibrators.networks:DataDrivenCalibrator",
    "additive": "seatrial.hybrid.calibrators.networks:AdditiveCalibrator",
    "paper_adam": "seatrial.hybrid.calibrators.networks:PublishedPaperCalibrator",
    "adaptive": "seatrial.hybrid.calibrators.adaptive:AdaptiveCalibrator",
}
INSTALL = "pip install 'seatrial[networks]'"
METHODS: tuple[str, ...] = tuple(_METHODS)
COMPARED = tuple(method for method in METHODS if method != "paper_adam")
"""The methods compared by default: ``paper_adam`` is ``paper`` again, trained for longer."""
METHOD = "adaptive"
"""The default method."""
HELD_OUT_SHARE = 0.2


VesselChoice = files.Vessel | BlackBox | str | Path
"""What may stand for a reference model: a vessel or simulator, or its name or file."""


@dataclass(frozen=True, slots=True)
class ChosenReference:
    """The reference model of recordings, where it comes from, and how it was chosen.

    It is a vessel file's plant or a simulator of another make. Both answer the same calls
    (:func:`.simulate_batch`, :func:`.filtered_starts`): what is predicted with one is predicted with the other.

    ``file`` is the name of one of Seatrial's own or a path, and means the same from any folder. ``ship`` is the
    vessel file of the model, None of a simulator.
    """

    model: MotionModel
    file: str
    choice: ChosenModel
    ship: files.Vessel | None = None

    @property
    def file_or_simulator(self) -> files.Vessel | BlackBox:
        """The vessel file, or the simulator."""
        if self.ship is not None:
            return self.ship
        assert isinstance(self.model, BlackBox)
        return self.model


def load_model(vessel: VesselChoice | None) -> MotionModel:
    """The model of a vessel with the effects of its file, or a simulator. Raises :class:`ConfigurationError`."""
    simulator = simulators.simulator_of(vessel)
    return vessel_plant(files.load_vessel(_no_simulator(vessel))) if simulator is None else simulator


def choose_reference(trials: files.Trials, vessel: VesselChoice | None = None) -> ChosenReference:
    """The model of recordings: ``vessel``, else that of the ship that they name (:func:`.reference_model`).

    Raises :class:`InputError` where no ship is named or its file is not there, :class:`ConfigurationError` for a
    model that cannot be used.
    """
    simulator = simulators.simulator_of(vessel)
    if simulator is None:
        chosen = files.reference_model(trials, _no_simulator(vessel))
        return ChosenReference(vessel_plant(chosen.vessel), chosen.file, chosen.choice, chosen.vessel)
    name = f"{simulator.name} ({Path(simulator.file).name})"
    ships = {simulator.name, Path(simulator.file.rpartition(":")[0] or simulator.file).stem}
    return ChosenReference(simulator, simulator.file, files.chosen_model(name, ships, trials))


def choose_predicting_reference(trials: files.Trials, vessel: VesselChoice | None = None) -> ChosenReference:
    """As :func:`choose_reference`, with a remark on errors of sensors in the vessel file: predictions start from
    what was recorded and are compared with it, as if there were none."""
    chosen = choose_reference(trials, vessel)
    if chosen.ship is None:
        return chosen
    catalogue = catalogue_of(chosen.ship)
    sensors = [name for name in chosen.ship.effects if name in catalogue and catalogue[name].kind == "sensor"]
    if not sensors:
        return chosen
    names = join_words([name.replace("_", " ") for name in sensors])
    doubt = f"{chosen.choice.doubt}; {names} in its file are not corrected in recordings"
    return replace(chosen, choice=replace(chosen.choice, doubt=doubt))


def _no_simulator(vessel: VesselChoice | None) -> files.Vessel | str | Path | None:
    assert not isinstance(vessel, BlackBox)
    return vessel


def can_train(method: str) -> bool:
    """Whether calibrators of a method can be trained here; networks need PyTorch."""
    return "networks:" not in _METHODS.get(method, "") or find_spec("torch") is not None


def sets_states(method: str, model: MotionModel) -> bool:
    """Whether calibrators of a method set the state of a reference model that cannot start from one."""
    return method == "adaptive" and isinstance(model, BlackBox) and model.run_in_s is not None


def refuse_untrainable(method: str, model: MotionModel | None = None) -> None:
    """Raise :class:`ConfigurationError` unless ``method`` is a calibrator (:func:`make_calibrator`) that can be
    trained here, on the ``model`` if one is given."""
    if method not in _METHODS:
        make_calibrator(method)
    if isinstance(model, BlackBox) and sets_states(method, model):
        raise ConfigurationError(
            f"{method} sets the state of the reference model each second, and this simulator cannot start from one",
            where=model.file, why="its map has start = \"run_in\"",
            fix="use --method additive or paper, which need its predictions only, or map its start values",
        )  # fmt: skip
    if not can_train(method):
        raise ConfigurationError(
            f"{method} is a network, and PyTorch, which trains it, is not installed",
            fix=f"{INSTALL}, or use another method",
        )


def make_calibrator(method: str, seed: int = 0, plant: MotionModel | None = None) -> Calibrator:
    """An untrained calibrator by its method: the name of one of ours, of an entry point of
    ``seatrial.calibrators``, or ``FILE.py:CLASS``.

    A class that is no :class:`Calibrator` is wrapped in an :class:`.OwnCalibrator`. Raises
    :class:`ConfigurationError`.
    """
    factory = named_code.load(method, "calibrators", _METHODS)
    if method in _METHODS:
        calibrator: Calibrator = factory(seed, plant)
        return calibrator
    from seatrial.hybrid.calibrators.own import user_calibrator

    return user_calibrator(factory, method, seed, plant)


Examples = tuple[window_sets.PredictionWindows, Floats]
"""Windows and the reference model's tracks on them [N, H+1, 3]."""


def require_tensor_shapes(tensors: Mapping[str, Floats], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise :class:`ValueError` for a tensor from a file that is missing, of another shape, or no floats."""
    for name, shape in shapes.items():
        tensor = tensors.get(name)
        if tensor is None or tensor.shape != shape or tensor.dtype != np.float64:
            actual = "missing" if tensor is None else f"{tensor.dtype} {tensor.shape}"
            raise ValueError(f"{name} is {actual}, and this version has float64 {shape}")


@dataclass(frozen=True, slots=True)
class DomainOfApplicability:
    """The values of N windows compared with the range in training, by quantity.

    ``names`` [C] of the quantities, ``values`` [N, K, C] of the windows (K seconds, or one), range in training
    ``low`` to ``high`` [C], and ``margin`` [C] by which a value inside the domain may exceed that range.
    """

    names: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    margin: Floats

    @property
    def outside_range(self) -> Bools:
        """Which windows leave the training range by at least a thousandth of it, by quantity [N, C]."""
        return self._exceeds(1e-3 * (self.high - self.low) + 1e-9)

    @property
    def outside(self) -> Bools:
        """Which windows leave the domain, by quantity [N, C]."""
        return self._exceeds(self.margin)

    def _exceeds(self, margin: Floats) -> Bools:
        outside = (self.values < self.low - margin) | (self.values > self.high + margin)
        return np.asarray(outside.any(axis=1))


class Calibrator(ABC):
    """A learned map from the start of a window and the reference's track to the ship's track.

    Fitted values end in an underscore, as in scikit-learn. ``plant`` is the reference model, for calibrators
    that adapt it; ``actuators`` are the ship's, those of ``plant`` or of the training windows; ``any_commands``
    means that it takes windows with any commands, like those it was fitted to.
    """

    method: str
    extrapolates: ClassVar[bool] = False
    """Whether it is used outside its domain of applicability too, as one may be whose regions grow there."""
    outputs: ClassVar[tuple[str, ...]] = ("north_m", "east_m")

    def __init__(self, seed: int = 0, plant: MotionModel | None = None) -> None:
        self.seed, self.plant = seed, plant
        self.actuators: ship.Actuators = plant.layout if plant else ship.DEFAULT
        self.any_commands = False

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The settings that it is made with, by name, as scikit-learn has them; ``deep`` makes no difference."""
        return {name: getattr(self, name) for name in signature(type(self)).parameters}

    def set_params(self, **settings: Any) -> Self:
        """Change settings. Raises :class:`ConfigurationError` for a name that is none."""
        if unknown := sorted(settings.keys() - self.get_params().keys()):
            raise ConfigurationError(
                f"{self.method} has no setting {', '.join(unknown)}",
                fix=f"choose of {', '.join(self.get_params())}",
            )
        for name, value in settings.items():
            setattr(self, name, value)
        return self

    @property
    def input_names(self) -> tuple[str, ...]:
        """The names of the inputs, for the ship at hand."""
        return self.input_names_for(self.actuators)

    @abstractmethod
    def input_names_for(self, actuators: ship.Actuators) -> tuple[str, ...]:
        """The names of the inputs, for a ship with these actuators."""

    @abstractmethod
    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to windows; ``stopping`` are windows of other legs, for early stopping or selection."""

    @abstractmethod
    def predict(self, windows: window_sets.PredictionWindows, reference: Floats) -> Floats:
        """The predicted tracks [N, H+1, 3]: north, east [m], heading [rad]."""

    @abstractmethod
    def domain(self, windows: window_sets.PredictionWindows, reference: Floats) -> DomainOfApplicability:
        """The windows' values of the quantities of the domain of applicability, with the training range."""

    def outside_domain(self, windows: window_sets.PredictionWindows, reference: Floats) -> Bools:
        """Which windows [N] lie outside the domain of applicability."""
        return np.asarray(self.domain(windows, reference).outside.any(axis=1))

    def predict_with_uncertainty(
        self, windows: window_sets.PredictionWindows, reference: Floats
    ) -> tuple[Floats, Floats]:
        """:meth:`predict`, with the relative uncertainty of each prediction [N, H], one on average; here
        constant."""
        return self.predict(windows, reference), np.ones((len(windows), windows.horizon_s))

    def fallback_candidate(
        self, windows: window_sets.PredictionWindows, tracks: Floats
    ) -> baselines.CandidatePrediction | None:
        """Its predicted ``tracks`` [N, H+1, 3] as a candidate for the average of :class:`.Fallback`.

        If None, they are used alone inside the domain of applicability.
        """
        return None

    def adapted_model(self) -> MotionModel | None:
        """The reference model with what was learned of it; None of a calibrator that corrects tracks."""
        return None

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        """The tracks [N, H+1, 3] of the ``stopping`` windows of :meth:`fit` by a model not fitted to them."""
        return self.predict(*stopping)

    def conformal_region(self, stopping: Examples) -> Floats:
        """The semi-axes [H, 2] of the 95 % region by second, in metres, for an uncertainty of one."""
        return baselines.conformal_region(self.out_of_sample_tracks(stopping), stopping[0])

    @abstractmethod
    def state_dict(self) -> dict[str, Floats]:
        """All fitted values, by name."""

    @abstractmethod
    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        """Restore the fitted values of :meth:`state_dict`, and return itself."""


@dataclass(frozen=True, slots=True)
class PredictedTracks:
    """Predictions of N windows with their 95 % regions.

    ``tracks`` [N, H+1, 3], semi-axes ``region_m`` [N, H, 2]; ``outside_domain`` [N] marks the windows outside
    the calibrator's domain of applicability; ``source`` [N] is ``hybrid``, or one of :data:`FALLBACK_BASELINES`.
    """

    tracks: Floats
    region_m: Floats
    outside_domain: Bools
    source: Strings


def predict_with_fallback(
    calibrator: Calibrator,
    plant: MotionModel,
    region_m: Floats,
    fallback: baselines.Fallback,
    windows: window_sets.PredictionWindows,
    reference: Floats,
) -> PredictedTracks:
    """The calibrator's tracks and regions, replaced by the fallback's where it gives no finite number, or
    outside its domain unless it extrapolates.

    A calibrator with hindcasts (:meth:`~Calibrator.fallback_candidate`) is averaged with the baselines inside its
    domain as well; its region is then the mean of both.

    ``region_m`` is the calibrator's :meth:`~Calibrator.conformal_region`, for at least as many seconds as the
    windows have; ``reference`` [N, H+1, 3] are the model's tracks.
    """
    tracks, uncertainty = calibrator.predict_with_uncertainty(windows, reference)
    regions_m = uncertainty[..., None] * region_m[: windows.horizon_s]
    no_number = np.asarray(~np.isfinite(tracks).all(axis=(1, 2)))
    outside = calibrator.outside_domain(windows, reference) | no_number
    rejected = no_number if calibrator.extrapolates else outside
    tracks[rejected] = np.nan
    source = np.full(len(windows), "hybrid", dtype="<U20")
    candidate = calibrator.fallback_candidate(windows, tracks)
    replaced = rejected if candidate is None else np.ones_like(rejected)
    if replaced.any():
        replacement = fallback.predict(windows.subset(replaced), reference[replaced], plant, candidate)
        weight = replacement.weight[len(baselines.FALLBACK_BASELINES) :].sum(axis=0)[:, None, None]
        fallback_m = replacement.expected_error_m[:, None, None] * fallback.region[: windows.horizon_s]
        tracks[replaced], source[rejected] = replacement.tracks, replacement.source[rejected[replaced]]
        own_m = np.where(weight > 0.0, regions_m[replaced], 0.0)  # infinite where the calibrator gives no number
        regions_m[replaced] = weight * own_m + (1.0 - weight) * fallback_m
    return PredictedTracks(tracks, regions_m, outside, source)


def software_versions() -> dict[str, str]:
    """The versions of the software used for training."""
    libraries = {name: version(name) for name in ("torch", "numpy") if find_spec(name)}
    return {
        "seatrial": trial.software_version().removeprefix("seatrial "),
        "python": platform.python_version(),
    } | libraries


@dataclass(frozen=True, slots=True, repr=False)
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
    plant: MotionModel
    region_m: Floats
    fallback: baselines.Fallback
    sources: tuple[WindowSource, ...]
    metrics: dict[str, Any]
    trained_at: datetime = field(default_factory=lambda: datetime.now(UTC).replace(microsecond=0))
    versions: dict[str, str] = field(default_factory=software_versions)
    view = "seatrial.hybrid.report.text:training_view"
    drawing = "seatrial.hybrid.report.plots:draw_regions"
    size_inch = (7.0, 4.0)

    def predict_tracks(self, windows: window_sets.PredictionWindows, reference: Floats) -> PredictedTracks:
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


def plant_of_calibrator(trained: TrainedCalibrator, vessel: VesselChoice | None) -> MotionModel:
    """The reference model that a calibrator was trained on; ``vessel`` may confirm it but not replace it.

    Raises :class:`ConfigurationError` if the named model differs in any number from that of the training.
    """
    if vessel is not None and model_digest(load_model(vessel)) != model_digest(trained.plant):
        raise ConfigurationError(
            f"vessel {str(vessel)!r} is not the model that the calibrator was trained on",
            why=f"it was trained on {trained.vessel!r}, and the numbers differ",
            fix="leave --vessel out, give that vessel, or train again",
        )
    return trained.plant


def train_calibrator(
    dataset: Dataset,
    vessel: str,
    plant: MotionModel,
    method: str = METHOD,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> TrainedCalibrator:
    """Train a calibrator of ``method`` on a data set and, if networks can be trained, the one without a model.

    A share :data:`HELD_OUT_SHARE` of the legs, or of the recordings with any commands, is held out for early
    stopping and for the size of the regions. Raises :class:`DataShortageError` without windows in the range of
    the model, or with only one leg.
    """
    windows, tracks = windows_within_model_range(dataset.windows, plant)
    held_out = window_sets.draw_windows(windows, window_sets.held_out_group_names(windows), HELD_OUT_SHARE, seed)
    fitting = window_sets.drop_overlapping_windows(windows, ~held_out, held_out)
    training = (windows.subset(fitting), tracks[fitting])
    stopping = (windows.subset(held_out), tracks[held_out])
    calibrator = make_calibrator(method, seed, plant).fit(training, stopping, subtask_progress(progress, 0, 2))
    data_driven = None
    if can_train("data_driven"):
        data_driven = make_calibrator("data_driven", seed, plant).fit(
            training, stopping, subtask_progress(progress, 1, 2)
        )
    judged = stopping[0].is_complete
    measured, predicted = stopping[0].track[judged], calibrator.out_of_sample_tracks(stopping)
    metrics = {
        "windows": int(windows.is_complete.sum()),
        "shorter_windows": int((~windows.is_complete).sum()),
        "legs": int(np.unique(windows.leg).size),
        "training_windows": int(training[0].is_complete.sum()),
        "held_out_windows": int(judged.sum()),
        "held_out_reference_m": baselines.score(stopping[1][judged], measured).mean_distance_m,
        "held_out_hybrid_m": baselines.score(predicted[judged], measured).mean_distance_m,
    }
    return TrainedCalibrator(
        calibrator=calibrator,
        data_driven=data_driven,
        horizon_s=windows.horizon_s,
        vessel=vessel,
        plant=plant,
        region_m=calibrator.conformal_region(stopping),
        fallback=baselines.Fallback.fit(windows, tracks, plant),
        sources=tuple(replace(source, path=source.path.resolve()) for source in dataset.sources),
        metrics=metrics,
    )
