"""What every calibrator can do: learn from windows, predict tracks, say how sure it is, be saved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from acquisition.core.arrays import Bools, Floats
from acquisition.core.progress import Progress
from hybrid.prediction.prediction_windows import Horizons
from hybrid.prediction.regions import band_radius

if TYPE_CHECKING:
    from torch import Tensor

    from hybrid.vessel.plant import Plant

Examples = tuple[Horizons, Floats]
"""Windows and the reference's tracks on them [N, H+1, 3]."""


@dataclass(frozen=True, slots=True)
class Ground:
    """What decides whether a method has ground: quantities by their ``names`` [C], what N windows have of each
    ``values`` [N, K, C] (K seconds, or one), the range of the training ``low`` to ``high`` [C] and how far past it
    still counts as inside, ``margin`` [C].
    """

    names: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    margin: Floats

    @property
    def past(self) -> Bools:
        """Which windows leave the range of the training itself in which quantity [N, C], by a thousandth of it."""
        little = 1e-3 * (self.high - self.low) + 1e-9
        outside: Bools = np.any((self.values < self.low - little) | (self.values > self.high + little), axis=1)
        return outside

    @property
    def beyond(self) -> Bools:
        """Which windows lie beyond the training in which quantity [N, C]."""
        outside = (self.values < self.low - self.margin) | (self.values > self.high + self.margin)
        beyond: Bools = np.any(outside, axis=1)
        return beyond


class Calibrator(ABC):
    """A learned map from what is known of a window at its start, and the reference's track, to the ship's track.

    Learned values end in an underscore, as in scikit-learn. ``plant`` is the reference model, for calibrators
    that look inside it.
    """

    method: ClassVar[str]
    inputs: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]] = ("north_m", "east_m")

    def __init__(self, seed: int = 0, plant: Plant | None = None) -> None:
        self.seed, self.plant = seed, plant

    @abstractmethod
    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Learn from windows; ``stopping`` are windows of other legs, to stop or choose by."""

    @abstractmethod
    def predict(self, horizons: Horizons, reference: Floats) -> Floats:
        """The predicted tracks [N, H+1, 3]: north, east [m], heading [rad]."""

    @abstractmethod
    def ground(self, horizons: Horizons, reference: Floats) -> Ground:
        """What windows have of what it was trained on, beside the range of the training."""

    def outside(self, horizons: Horizons, reference: Floats) -> Bools:
        """Which windows [N] lie beyond what it was trained on, where it has no ground."""
        return np.asarray(self.ground(horizons, reference).beyond.any(axis=1))

    def spread(self, horizons: Horizons, reference: Floats) -> Floats:
        """How uncertain each prediction is [N, H], one for a usual one; the same for all here."""
        return np.ones((len(horizons), horizons.horizon_s))

    def predict_with_spread(self, horizons: Horizons, reference: Floats) -> tuple[Floats, Floats]:
        """Both in one, where one costs as much as both."""
        return self.predict(horizons, reference), self.spread(horizons, reference)

    def unseen(self, stopping: Examples) -> Floats:
        """The tracks of the windows that ``fit`` was given to stop by, from what was not trained on them."""
        return self.predict(*stopping)

    def region(self, stopping: Examples) -> Floats:
        """The radius of the 95 % region by second [H], for a spread of one; here from windows of other legs."""
        return band_radius(self.unseen(stopping), stopping[0].track, self.spread(*stopping))

    @abstractmethod
    def state(self) -> dict[str, Tensor]:
        """Everything learned, by name."""

    @abstractmethod
    def restore(self, tensors: dict[str, Tensor]) -> Self:
        """The inverse of :meth:`state`."""
