"""The interface of all calibrators (fit to windows, predict tracks with uncertainty, save), and their
predictions with the fallback outside the domain of applicability."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import DEFAULT, Actuators
from seatrial.hybrid.prediction.baselines import BASELINES, CandidatePrediction, Fallback
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows
from seatrial.hybrid.prediction.regions import conformal_region

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.plant import Plant

Examples = tuple[PredictionWindows, Floats]
"""Windows and the reference model's tracks on them [N, H+1, 3]."""


def require_shapes(tensors: Mapping[str, Floats], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise :class:`ValueError` for a tensor from a file that is missing, of another shape, or no floats."""
    for name, shape in shapes.items():
        tensor = tensors.get(name)
        if tensor is None or tensor.shape != shape or tensor.dtype != np.float64:
            what = "missing" if tensor is None else f"{tensor.dtype} {tensor.shape}"
            raise ValueError(f"{name} is {what}, and this version has float64 {shape}")


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
        return self._beyond(1e-3 * (self.high - self.low) + 1e-9)

    @property
    def outside(self) -> Bools:
        """Which windows leave the domain, by quantity [N, C]."""
        return self._beyond(self.margin)

    def _beyond(self, margin: Floats) -> Bools:
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
    """Whether it is believed outside its domain of applicability too, as one may whose regions grow there."""
    outputs: ClassVar[tuple[str, ...]] = ("north_m", "east_m")

    def __init__(self, seed: int = 0, plant: Plant | None = None) -> None:
        self.seed, self.plant = seed, plant
        self.actuators: Actuators = plant.layout if plant else DEFAULT
        self.any_commands = False

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs, for the ship at hand."""
        return self.labels(self.actuators)

    @abstractmethod
    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        """The names of the inputs, for a ship with these actuators."""

    @abstractmethod
    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to windows; ``stopping`` are windows of other legs, for early stopping or selection."""

    @abstractmethod
    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The predicted tracks [N, H+1, 3]: north, east [m], heading [rad]."""

    @abstractmethod
    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        """The windows' values of the quantities of the domain of applicability, with the training range."""

    def outside_domain(self, windows: PredictionWindows, reference: Floats) -> Bools:
        """Which windows [N] lie outside the domain of applicability."""
        return np.asarray(self.domain(windows, reference).outside.any(axis=1))

    def predict_with_uncertainty(self, windows: PredictionWindows, reference: Floats) -> tuple[Floats, Floats]:
        """:meth:`predict`, with the relative uncertainty of each prediction [N, H], one on average; here
        constant."""
        return self.predict(windows, reference), np.ones((len(windows), windows.horizon_s))

    def beside_baselines(self, windows: PredictionWindows, tracks: Floats) -> CandidatePrediction | None:
        """Its predicted ``tracks`` [N, H+1, 3] as a candidate for the average of :class:`Fallback`.

        If None, they are used alone inside the domain of applicability.
        """
        return None

    def adapted_model(self) -> Plant | None:
        """The reference model with what was learned of it; None of a calibrator that corrects tracks."""
        return None

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        """The tracks [N, H+1, 3] of the ``stopping`` windows of :meth:`fit` by a model not fitted to them."""
        return self.predict(*stopping)

    def conformal_region(self, stopping: Examples) -> Floats:
        """The semi-axes [H, 2] of the 95 % region by second, in metres, for an uncertainty of one."""
        return conformal_region(self.out_of_sample_tracks(stopping), stopping[0])

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
    the calibrator's domain of applicability; ``source`` [N] is ``hybrid``, or one of :data:`BASELINES`.
    """

    tracks: Floats
    region_m: Floats
    outside_domain: Bools
    source: NDArray[np.str_]


def predict_with_fallback(
    calibrator: Calibrator,
    plant: Plant,
    region_m: Floats,
    fallback: Fallback,
    windows: PredictionWindows,
    reference: Floats,
) -> PredictedTracks:
    """The calibrator's tracks and regions, replaced by the fallback's where it gives no finite number, or
    outside its domain unless it extrapolates.

    A calibrator with hindcasts (:meth:`~Calibrator.beside_baselines`) is averaged with the baselines inside its
    domain as well; its region is then the mean of both.

    ``region_m`` is the calibrator's :meth:`~Calibrator.conformal_region`, for at least as many seconds as the
    windows have; ``reference`` [N, H+1, 3] are the model's tracks.
    """
    tracks, uncertainty = calibrator.predict_with_uncertainty(windows, reference)
    regions_m = uncertainty[..., None] * region_m[: windows.horizon_s]
    no_number = np.asarray(~np.isfinite(tracks).all(axis=(1, 2)))
    outside = calibrator.outside_domain(windows, reference) | no_number
    silent = no_number if calibrator.extrapolates else outside
    tracks[silent] = np.nan
    source = np.full(len(windows), "hybrid", dtype="<U20")
    candidate = calibrator.beside_baselines(windows, tracks)
    asked = silent if candidate is None else np.ones_like(silent)
    if asked.any():
        replacement = fallback.predict(windows.subset(asked), reference[asked], plant, candidate)
        weight = replacement.weight[len(BASELINES) :].sum(axis=0)[:, None, None]
        others_m = replacement.expected_error_m[:, None, None] * fallback.region[: windows.horizon_s]
        tracks[asked], source[silent] = replacement.tracks, replacement.source[silent[asked]]
        regions_m[asked] = np.where(weight > 0.0, weight * regions_m[asked], 0.0) + (1.0 - weight) * others_m
    return PredictedTracks(tracks, regions_m, outside, source)
