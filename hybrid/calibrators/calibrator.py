"""The interface of all calibrators: fit to windows, predict tracks with their uncertainty, be saved; and their
predictions with the fallback outside their domain of applicability.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from acquisition.core.actuators import DEFAULT, Actuators
from acquisition.core.arrays import Bools, Floats
from acquisition.core.progress import Progress
from hybrid.prediction.baselines import BASELINES, Candidate, Fallback
from hybrid.prediction.prediction_windows import PredictionWindows
from hybrid.prediction.regions import conformal_region

if TYPE_CHECKING:
    from hybrid.vessel.plant import Plant

Examples = tuple[PredictionWindows, Floats]
"""Windows and the reference model's tracks on them [N, H+1, 3]."""


@dataclass(frozen=True, slots=True)
class DomainOfApplicability:
    """The values of N windows beside the range of the training, quantity by quantity.

    ``names`` [C] of the quantities, ``values`` [N, K, C] of the windows (K seconds, or one), range of the training
    ``low`` to ``high`` [C], and ``margin`` [C] by which a value may leave that range inside the domain.
    """

    names: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    margin: Floats

    @property
    def outside_range(self) -> Bools:
        """Which windows leave the range of the training by a thousandth of it or more, by quantity [N, C]."""
        return self._beyond(1e-3 * (self.high - self.low) + 1e-9)

    @property
    def outside(self) -> Bools:
        """Which windows leave the domain, by quantity [N, C]."""
        return self._beyond(self.margin)

    def _beyond(self, margin: Floats) -> Bools:
        outside = (self.values < self.low - margin) | (self.values > self.high + margin)
        return np.asarray(outside.any(axis=1))


class Calibrator(ABC):
    """A learned map from what is known of a window at its start, and the reference's track, to the ship's track.

    Fitted values end in an underscore, as in scikit-learn. ``plant`` is the reference model, for calibrators
    that adapt it; ``actuators`` are the ship's, those of ``plant`` or of the windows it was fitted to;
    ``any_commands`` says that it takes windows with any commands, as those it was fitted to.
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
        """The names of what goes in, for the ship at hand."""
        return self.labels(self.actuators)

    @abstractmethod
    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        """The names of what goes in, for a ship with these actuators."""

    @abstractmethod
    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to windows; ``stopping`` are windows of other legs, for early stopping or selection."""

    @abstractmethod
    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The predicted tracks [N, H+1, 3]: north, east [m], heading [rad]."""

    @abstractmethod
    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        """The windows' values of what the domain of applicability is made of, beside the range of the training."""

    def outside_domain(self, windows: PredictionWindows, reference: Floats) -> Bools:
        """Which windows [N] lie outside the domain of applicability."""
        return np.asarray(self.domain(windows, reference).outside.any(axis=1))

    def predict_with_uncertainty(self, windows: PredictionWindows, reference: Floats) -> tuple[Floats, Floats]:
        """:meth:`predict`, and the relative uncertainty of each prediction [N, H], one on average; here of all."""
        return self.predict(windows, reference), np.ones((len(windows), windows.horizon_s))

    def beside_baselines(self, windows: PredictionWindows, tracks: Floats) -> Candidate | None:
        """Its predicted ``tracks`` [N, H+1, 3] as one of those that :class:`Fallback` averages.

        Without it, None, they stand alone inside the domain of applicability.
        """
        return None

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        """The tracks [N, H+1, 3] of the ``stopping`` windows of :meth:`fit` by a model not fitted to them."""
        return self.predict(*stopping)

    def conformal_region(self, stopping: Examples) -> Floats:
        """The semi-axes [H, 2] of the 95 % region by second, in metres, for an uncertainty of one."""
        return conformal_region(self.out_of_sample_tracks(stopping), stopping[0])

    @abstractmethod
    def state_dict(self) -> dict[str, Floats]:
        """Everything that was fitted, by name."""

    @abstractmethod
    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        """Take over what :meth:`state_dict` of a fitted calibrator returned, and return itself."""


@dataclass(frozen=True, slots=True)
class PredictedTracks:
    """Predictions of N windows with their 95 % regions.

    ``tracks`` [N, H+1, 3], semi-axes ``region_m`` [N, H, 2]; ``outside_domain`` [N] marks the windows outside the
    calibrator's domain of applicability, and ``source`` [N] names who predicted: ``hybrid``, or one of
    :data:`BASELINES`.
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
    """The calibrator's tracks and regions, and the fallback's where it gives no number, or outside its domain if it
    does not extrapolate.

    A calibrator that hindcasts (:meth:`~Calibrator.beside_baselines`) is averaged with the baselines inside its
    domain too. The region is the mean of both then: who is averaged lies no further off than on average.

    ``region_m`` is the calibrator's :meth:`~Calibrator.conformal_region`, for as many seconds as the windows have
    or more; ``reference`` [N, H+1, 3] are the model's tracks.
    """
    tracks, uncertainty = calibrator.predict_with_uncertainty(windows, reference)
    regions_m = uncertainty[..., None] * region_m[: windows.horizon_s]
    no_number = np.asarray(~np.isfinite(tracks).all(axis=(1, 2)))
    outside = calibrator.outside_domain(windows, reference) | no_number
    silent = no_number if calibrator.extrapolates else outside
    tracks[silent] = np.nan
    source = np.full(len(windows), "hybrid", dtype="<U20")
    beside = calibrator.beside_baselines(windows, tracks)
    asked = silent if beside is None else np.ones_like(silent)
    if asked.any():
        found = fallback.predict(windows.subset(asked), reference[asked], plant, beside)
        own = found.weight[len(BASELINES) :].sum(axis=0)[:, None, None]
        others_m = found.expected_error_m[:, None, None] * fallback.region[: windows.horizon_s]
        tracks[asked], source[silent] = found.tracks, found.source[silent[asked]]
        regions_m[asked] = np.where(own > 0.0, own * regions_m[asked], 0.0) + (1.0 - own) * others_m
    return PredictedTracks(tracks, regions_m, outside, source)
