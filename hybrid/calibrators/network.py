"""The network that the calibrators share: standard scaling and three layers of ten, in double precision."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
import torch
from torch import Tensor, nn

from acquisition.core.arrays import Floats
from acquisition.core.errors import InputError
from acquisition.core.progress import Progress
from hybrid.calibrators.calibrator import Calibrator, Examples, Ground
from hybrid.calibrators.device import chosen_device
from hybrid.calibrators.features import displacement
from hybrid.calibrators.training import Rows, Stopping, fit_network
from hybrid.prediction.baselines import constant_velocity
from hybrid.prediction.prediction_windows import Horizons

if TYPE_CHECKING:
    from hybrid.vessel.plant import Plant

HIDDEN = (10, 10, 10)
BEYOND = 0.1
"""How far past the range of the training, as a share of it, an input may lie before it counts as outside."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """Standard scaling of columns: zero mean and unit deviation; constant columns become zero."""

    mean: Tensor
    deviation: Tensor

    @classmethod
    def of(cls, columns: Tensor) -> Scaling:
        """The scaling of columns [rows, C]."""
        deviation = columns.std(dim=0, correction=0)
        constant = deviation <= 1e-9 * (1.0 + columns.mean(dim=0).abs())
        return cls(columns.mean(dim=0), torch.where(constant, torch.inf, deviation))

    def scaled(self, columns: Tensor) -> Tensor:
        """Columns [*, C] in units of their deviation."""
        return (columns - self.mean) / self.deviation

    def restored(self, columns: Tensor) -> Tensor:
        """The inverse of :meth:`scaled`; constant columns come back as their mean."""
        finite = torch.where(torch.isinf(self.deviation), 0.0, self.deviation)
        return columns * finite + self.mean


def make_network(inputs: int, outputs: int, hidden: tuple[int, ...] = HIDDEN) -> nn.Sequential:
    """A perceptron with ReLU between its layers, in double precision."""
    widths = (inputs, *hidden)
    layers: list[nn.Module] = []
    for below, above in pairwise(widths):
        layers += [nn.Linear(below, above), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(widths[-1], outputs)).double()


class NetworkCalibrator(Calibrator):
    """One network from features of a window and second to the displacement at that second.

    ``fit`` takes at most ``epochs`` steps of least squares on ``batch`` rows each. It stops early on windows it
    is not trained on, after ``patience`` steps without gain, and keeps the best weights seen.
    """

    needs_reference: ClassVar[bool]

    def __init__(
        self,
        seed: int = 0,
        plant: Plant | None = None,
        epochs: int = 200,
        batch: int = 1000,
        patience: int = 30,
    ) -> None:
        super().__init__(seed, plant)
        self.epochs, self.batch, self.patience = epochs, batch, patience

    @abstractmethod
    def features(self, horizons: Horizons, reference: Floats) -> Floats:
        """The network's inputs [N, H, C], columns as ``inputs``."""

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Train on windows and their reference tracks; ``stopping`` are windows of other legs."""
        torch.manual_seed(self.seed)
        inputs, targets = self._rows(*training)
        self.input_scaling_, self.output_scaling_ = Scaling.of(inputs), Scaling.of(targets)
        self.input_range_ = torch.stack([inputs.amin(dim=0), inputs.amax(dim=0)])
        self.network_ = make_network(inputs.shape[-1], targets.shape[-1])
        device = chosen_device()
        fit_network(
            self.network_.to(device),
            self._scaled((inputs, targets), device),
            self._scaled(self._rows(*stopping), device),
            Stopping(self.epochs, self.batch, self.patience),
            len(training[0]),
            self.seed,
            progress,
        )
        self.network_.cpu()
        return self

    def predict(self, horizons: Horizons, reference: Floats) -> Floats:
        """The predicted track [N, H+1, 3]; the heading is that of :meth:`heading`, which is not learned."""
        features = torch.from_numpy(self.features(horizons, reference))
        with torch.no_grad():
            learned = self.output_scaling_.restored(self.network_(self.input_scaling_.scaled(features))).numpy()
        moved = self.base(horizons, reference) + learned
        position = horizons.start[:, None, :2] + np.concatenate([np.zeros((len(moved), 1, 2)), moved], axis=1)
        return np.concatenate([position, self.heading(horizons, reference)[..., None]], axis=-1)

    def ground(self, horizons: Horizons, reference: Floats) -> Ground:
        """The network's inputs at every second, and the range of each in the training."""
        low, high = self.input_range_.numpy()
        return Ground(self.inputs, self.features(horizons, reference), low, high, BEYOND * (high - low) + 1e-6)

    def base(self, horizons: Horizons, reference: Floats) -> Floats:
        """The displacement [N, H, 2] that what is learned is added to: none here."""
        return np.zeros((len(horizons), horizons.horizon_s, 2))

    def heading(self, horizons: Horizons, reference: Floats) -> Floats:
        """The heading [N, H+1] that goes with the positions: the reference's, or the present turn held."""
        track = reference if self.needs_reference else constant_velocity(horizons)
        return track[..., 2]

    def state(self) -> dict[str, Tensor]:
        """Everything learned, by name."""
        scalings = {"input": self.input_scaling_, "output": self.output_scaling_}
        tensors = {f"network.{name}": value for name, value in self.network_.state_dict().items()}
        for name, scaling in scalings.items():
            tensors[f"{name}.mean"], tensors[f"{name}.deviation"] = scaling.mean, scaling.deviation
        tensors["input.range"] = self.input_range_
        return {name: value.contiguous() for name, value in tensors.items()}

    def restore(self, tensors: dict[str, Tensor]) -> Self:
        """The inverse of :meth:`state`. Raises :class:`InputError` for a network with other inputs."""
        if tensors["input.mean"].numel() != len(self.inputs):
            raise InputError("was trained on other inputs than this version gives", fix="train anew")
        self.input_scaling_ = Scaling(tensors["input.mean"], tensors["input.deviation"])
        self.output_scaling_ = Scaling(tensors["output.mean"], tensors["output.deviation"])
        self.input_range_ = tensors["input.range"]
        self.network_ = make_network(len(self.input_scaling_.mean), len(self.output_scaling_.mean))
        prefix = "network."
        self.network_.load_state_dict(
            {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
        )
        return self

    def _rows(self, horizons: Horizons, reference: Floats) -> tuple[Tensor, Tensor]:
        """Inputs and targets [rows, C], [rows, 2] of the seconds whose position was measured."""
        features = self.features(horizons, reference)
        targets = displacement(horizons.track, horizons.start) - self.base(horizons, reference)
        measured = np.isfinite(targets).all(axis=-1)
        return torch.from_numpy(features[measured]), torch.from_numpy(targets[measured])

    def _scaled(self, rows: Rows, device: torch.device) -> Rows:
        inputs, targets = rows
        return self.input_scaling_.scaled(inputs).to(device), self.output_scaling_.scaled(targets).to(device)
