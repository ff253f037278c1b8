"""The calibrators that are small neural networks: the paper's, one without a model, one of the reference's error.

All are perceptrons with three hidden layers of ten in double precision, on standardised inputs: one row a window
and second, angles as points on the unit circle, and out comes the displacement from the start. The paper's (Wang,
Li et al. 2021) has the reference's displacement among its inputs and learns the ship's own; ``data_driven`` has no
model at all; ``additive``, which the paper argues against, learns what the reference's displacement lacks.

Where the commands may be any, each second's row has two means of every control up to then: the plain one, as what a
force that goes with it adds to the speed, and one that counts each second by the time that is left, as what that
speed adds to the distance. Held controls are both of their means.

They are trained by least squares, Levenberg's and Marquardt's steps, stopped early. A step needs the derivative of
every output with respect to every weight, which the few hundred weights of these networks allow. A few dozen steps
come further than a thousand epochs of Adam, and in a fraction of the time. Each step sees rows drawn anew, so that
its cost does not grow with the data.

The steps are ours for these two reasons, other rows each time and an end where windows kept out stop gaining:
``scipy.optimize.least_squares`` on all rows is after twelve steps 1.6 times (trf) and 2.1 times (lm) as far off on
windows not seen, in 1.5 and 3.4 times the time that ours takes to its end (tests/benchmarks/least_squares.py).
``paper_adam`` is the paper's network trained as it was published, by Adam (Kingma and Ba 2015).
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
import torch
from torch import Tensor, nn

from acquisition.core.actuators import Actuators
from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError, InputError
from acquisition.core.progress import Progress
from hybrid.calibrators.calibrator import Calibrator, DomainOfApplicability, Examples
from hybrid.prediction.baselines import HINDCAST_S, Candidate, constant_velocity, mean_known, simulate_tracks
from hybrid.prediction.kalman_filter import filtered_starts
from hybrid.prediction.prediction_windows import PredictionWindows, hindcast_windows
from hybrid.prediction.scores import mean_distances
from hybrid.vessel.actuators import angle_columns, control_labels
from hybrid.vessel.sensors import HEADING, SURGE

if TYPE_CHECKING:
    from hybrid.vessel.plant import Plant


Rows = tuple[Tensor, Tensor]
"""Inputs [rows, C] and the outputs wanted [rows, K], both scaled."""

MOST_DECAY = 1e-4
DECAY_IN_WINDOWS = 20.0
"""The weights' decay is the mean squared error times this over the number of windows, as for weights that are
normally distributed and errors that are the same all along a window (MacKay 1992); at most :data:`MOST_DECAY`."""
FIRST_DAMPING, LEAST_DAMPING = 1.0, 1e-9
FIRST_ROWS, MORE_ROWS = 100, 1.25
"""The first steps see few rows, each step more of them: far from the goal a few show the way."""
EASIER, HARDER, MOST_TRIALS = 1.0 / 3.0, 4.0, 8


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """When training ends: after so many steps, or so many in a row without gain on the stopping rows.

    ``rows`` is how many are drawn for a step, once the first steps are done.
    """

    steps: int
    rows: int
    patience: int


class Perceptron:
    """The weights of linear layers with ReLU between them as one vector, and the derivatives by it."""

    def __init__(self, network: nn.Sequential) -> None:
        self.shapes = [weight.shape for weight in network.parameters()]
        self.sizes = [shape.numel() for shape in self.shapes]

    def parts(self, weights: Tensor) -> list[Tensor]:
        """Matrix, offset, matrix, offset and so on: views of the vector."""
        pieces = weights.split(self.sizes)  # type: ignore[no-untyped-call]
        return [piece.view(shape) for piece, shape in zip(pieces, self.shapes, strict=True)]

    def layers(self, weights: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Matrix and offset of each layer."""
        parts = self.parts(weights)
        return list(zip(parts[::2], parts[1::2], strict=True))

    def give(self, weights: Tensor, network: nn.Sequential) -> None:
        """Write the weights into the network."""
        with torch.no_grad():
            for parameter, part in zip(network.parameters(), self.parts(weights), strict=True):
                parameter.copy_(part)

    def outputs(self, weights: Tensor, inputs: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The outputs [rows, K], and what enters each layer."""
        *hidden, (matrix, offset) = self.layers(weights)
        entering = [inputs]
        for below, shift in hidden:
            entering.append(torch.relu(torch.addmm(shift, entering[-1], below.T)))
        return torch.addmm(offset, entering[-1], matrix.T), entering

    def jacobian(self, weights: Tensor, entering: list[Tensor]) -> Tensor:
        """The derivative of each output by each weight [rows K, weights], back from the last layer."""
        layers = self.layers(weights)
        rows, outputs = len(entering[0]), len(layers[-1][1])
        by_sum = torch.eye(outputs, dtype=weights.dtype, device=weights.device).expand(rows, outputs, outputs)
        parts: list[Tensor] = []
        for number in reversed(range(len(layers))):
            by_matrix = by_sum[..., None] * entering[number][:, None, None, :]
            parts = [by_matrix.reshape(rows, outputs, -1), by_sum, *parts]
            if number:
                by_sum = (by_sum @ layers[number][0]) * (entering[number] > 0.0)[:, None, :]
        return torch.cat(parts, dim=-1).reshape(rows * outputs, -1)


def fit_network(
    network: nn.Sequential,
    training: Rows,
    stopping: Rows,
    until: StoppingRule,
    windows: int,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> None:
    """Fit the weights of linear layers with ReLU between them; the best on the ``stopping`` rows are kept.

    ``windows`` is how many of the training rows are independent: those of one window err together.
    The damping of Marquardt (1963) falls after a step that lowered the error and grows after one that did not.
    Rows are drawn on the processor, so that the same seed means the same rows on every device.
    """
    perceptron, generator = Perceptron(network), torch.Generator().manual_seed(seed)

    def steps() -> Iterator[Tensor]:
        weights, damping = _weights_of(network), FIRST_DAMPING
        share, rows = DECAY_IN_WINDOWS / windows, float(min(until.rows, FIRST_ROWS))
        while True:
            drawn = _drawn(training, int(rows), generator)
            weights, damping = _stepped(perceptron, weights, damping, share, drawn)
            rows = min(until.rows, MORE_ROWS * rows)
            yield weights

    _keep_best(network, steps(), stopping, until, progress)


def _keep_best(
    network: nn.Sequential, steps: Iterator[Tensor], stopping: Rows, until: StoppingRule, progress: Progress
) -> None:
    """Give the network those weights of all ``steps`` that err least on the ``stopping`` rows; they end where too
    many have brought no gain.
    """
    torch.set_num_threads(1)  # ten neurons a layer are slower on two threads than on one
    perceptron, best, best_error, since = Perceptron(network), _weights_of(network), float("inf"), 0
    for step, weights in enumerate(islice(steps, until.steps), 1):
        error, since = _mean_square(perceptron, weights, stopping), since + 1
        if error < best_error:
            best, best_error, since = weights, error, 0
        perceptron.give(weights, network)
        progress(step / until.steps)
        if since > until.patience:
            break
    perceptron.give(best, network)


def _weights_of(network: nn.Sequential) -> Tensor:
    """All weights of a network, one after the other; not those that it learns on."""
    return nn.utils.parameters_to_vector(network.parameters()).detach()


ADAM_RATE = 1e-3
"""The learning rate that the paper gives."""


def fit_network_by_adam(
    network: nn.Sequential,
    training: Rows,
    stopping: Rows,
    until: StoppingRule,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> None:
    """As :func:`fit_network`, each step one pass over all rows by Adam, ``until.rows`` at a time."""
    generator = torch.Generator().manual_seed(seed)
    adam = torch.optim.Adam(network.parameters(), lr=ADAM_RATE)

    def passes() -> Iterator[Tensor]:
        while True:
            order = torch.randperm(len(training[0]), generator=generator).to(training[0].device)
            for rows in torch.split(order, until.rows):
                adam.zero_grad()
                missed = nn.functional.mse_loss(network(training[0][rows]), training[1][rows])
                missed.backward()  # type: ignore[no-untyped-call]
                adam.step()
            yield _weights_of(network)

    _keep_best(network, passes(), stopping, until, progress)


def _drawn(data: Rows, rows: int, generator: torch.Generator) -> Rows:
    """As many rows, each at most once; all where there are no more."""
    inputs, wanted = data
    if len(inputs) <= rows:
        return data
    chosen = torch.randperm(len(inputs), generator=generator)[:rows].to(inputs.device)
    return inputs[chosen], wanted[chosen]


def _stepped(
    perceptron: Perceptron, weights: Tensor, damping: float, share: float, data: Rows
) -> tuple[Tensor, float]:
    """The weights after the first step that lowers error and decay, and the damping for the next."""
    inputs, wanted = data
    outputs, entering = perceptron.outputs(weights, inputs)
    slopes, missed = perceptron.jacobian(weights, entering), (outputs - wanted).reshape(-1)
    error = missed.square().mean().item()
    decay = min(MOST_DECAY, share * error)
    curvature = slopes.T @ slopes / len(missed)
    gradient = slopes.T @ missed / len(missed) + decay * weights
    before = error + decay * weights.square().sum().item()
    for _ in range(MOST_TRIALS):
        damped = curvature.clone()
        damped.diagonal().add_(damping + decay)
        moved = weights - torch.cholesky_solve(gradient[:, None], torch.linalg.cholesky(damped))[:, 0]
        after = _mean_square(perceptron, moved, data) + decay * moved.square().sum().item()
        if after < before:
            return moved, max(EASIER * damping, LEAST_DAMPING)
        damping *= HARDER
    return weights, damping


def _mean_square(perceptron: Perceptron, weights: Tensor, data: Rows) -> float:
    return nn.functional.mse_loss(perceptron.outputs(weights, data[0])[0], data[1]).item()


HIDDEN = (10, 10, 10)
DOMAIN_MARGIN = 0.1
"""How far past the range of the training an input may lie inside the domain, as a share of that range."""
DEVICE_VARIABLE = "SEATRIAL_DEVICE"
"""The environment variable that names the device for training, e.g. ``cpu`` or ``cuda:1``."""
REFERENCE_INPUTS = ("reference_north_m", "reference_east_m")


def start_labels(actuators: Actuators) -> tuple[str, ...]:
    """The names of the columns of :func:`start_inputs`, for a ship with these actuators."""
    return (
        "heading_sin", "heading_cos", "surge_mps", "sway_mps", "yaw_rate_radps",
        "wind_direction_sin", "wind_direction_cos", "wind_speed_mps", *_control_names(actuators), "second",
    )  # fmt: skip


def _means_until_now(values: Floats) -> Floats:
    """Means of series [N, H, C] from their first second to each second, plain, and by the time left: [N, H, 2C]."""
    second = np.arange(1.0, values.shape[1] + 1)[:, None]
    total = np.cumsum(values, axis=1)
    return np.concatenate([total / second, np.cumsum(total, axis=1) / (0.5 * second * (second + 1.0))], axis=-1)


def command_labels(actuators: Actuators) -> tuple[str, ...]:
    """The names of the columns of :func:`command_inputs`."""
    names = _control_names(actuators)
    return tuple(f"{kind}_{name}" for kind in ("mean", "early") for name in names)


def command_inputs(windows: PredictionWindows) -> Floats:
    """The commands until each second [N, H, columns], columns as :func:`command_labels`."""
    columns = _controls(windows.acting, angle_columns(windows.actuators))
    return _means_until_now(np.stack(columns, axis=-1))


def _controls(values: Floats, angles: list[int]) -> list[Floats]:
    """Controls [..., controls] one by one, an angle as its sine and cosine."""
    return [
        part
        for column, each in enumerate(np.moveaxis(values, -1, 0))
        for part in ((np.sin(each), np.cos(each)) if column in angles else (each,))
    ]


def _control_names(actuators: Actuators) -> list[str]:
    """The names of :func:`_controls`."""
    angles = angle_columns(actuators)
    return [
        part
        for column, name in enumerate(control_labels(actuators))
        for part in ((f"{name}_sin", f"{name}_cos") if column in angles else (name,))
    ]


def start_inputs(windows: PredictionWindows) -> Floats:
    """The window's start and the second that is asked for [N, H, columns], columns as :func:`start_labels`.

    Positions are left out: the displacement from the start does not depend on where the ship is.
    """
    heading, (direction, speed) = windows.start[:, HEADING], windows.wind.T
    controls = _controls(windows.control, angle_columns(windows.actuators))
    start = np.column_stack(
        [
            np.sin(heading), np.cos(heading), windows.start[:, SURGE:],
            np.sin(direction), np.cos(direction), speed, *controls,
        ]
    )  # fmt: skip
    count, seconds = len(windows), windows.horizon_s
    repeated = np.repeat(start[:, None, :], seconds, axis=1)
    second = np.broadcast_to(np.arange(1.0, seconds + 1)[None, :, None], (count, seconds, 1))
    return np.concatenate([repeated, second], axis=-1)


def displacement(track: Floats, start: Floats) -> Floats:
    """North and east from the start at seconds 1 to H [N, H, 2] of a track [N, H+1, 2 or 3]."""
    return track[:, 1:, :2] - start[:, None, :2]


@dataclass(frozen=True, slots=True)
class Standardisation:
    """Standard scaling of columns: zero mean and unit deviation; constant columns become zero."""

    mean: Tensor
    deviation: Tensor

    @classmethod
    def of(cls, columns: Tensor) -> Standardisation:
        """The scaling of columns [rows, C]."""
        deviation = columns.std(dim=0, correction=0)
        constant = deviation <= 1e-9 * (1.0 + columns.mean(dim=0).abs())
        return cls(columns.mean(dim=0), torch.where(constant, torch.inf, deviation))

    def scaled(self, columns: Tensor) -> Tensor:
        """Columns [*, C] in units of their deviation."""
        return (columns - self.mean) / self.deviation

    def unscaled(self, columns: Tensor) -> Tensor:
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
    is not trained on, after ``patience`` steps without gain, and keeps the best weights seen. Its errors on these
    windows, and on hindcasts of the seconds before them, say how much it weighs beside the baselines.
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
    def features(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The network's inputs [N, H, C], columns as ``inputs`` without those of commands."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of what goes in, for the ship at hand."""
        commands = command_labels(self.actuators) if self.any_commands else ()
        return (*super().inputs, *commands)

    def _inputs(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The network's inputs [N, H, C], columns as ``inputs``."""
        features = self.features(windows, reference)
        return np.concatenate([features, command_inputs(windows)], axis=-1) if self.any_commands else features

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Train on windows and their reference tracks; ``stopping`` are windows of other legs."""
        torch.manual_seed(self.seed)
        self.actuators, self.any_commands = training[0].actuators, training[0].commands is not None
        inputs, targets = self._rows(*training)
        self.input_scaling_, self.output_scaling_ = Standardisation.of(inputs), Standardisation.of(targets)
        self.input_range_ = torch.stack([inputs.amin(dim=0), inputs.amax(dim=0)])
        self.network_ = make_network(inputs.shape[-1], targets.shape[-1])
        device = training_device()
        self.network_.to(device)
        rows = self._scaled((inputs, targets), device), self._scaled(self._rows(*stopping), device)
        self._train(*rows, len(training[0]), progress)
        self.network_.cpu()
        self.usual_error_m_ = self._errors(*stopping)
        return self

    def _train(self, training: Rows, stopping: Rows, windows: int, progress: Progress) -> None:
        """Fit the network to scaled rows of so many ``windows``."""
        until = StoppingRule(self.epochs, self.batch, self.patience)
        fit_network(self.network_, training, stopping, until, windows, self.seed, progress)

    def _errors(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The mean errors [2] on windows over the horizon and over the hindcast."""
        found = mean_distances(self.predict(windows, reference), windows.track), self._hindcast_m(windows)
        return np.array([mean_known(each) for each in found])

    def _hindcast_m(self, windows: PredictionWindows) -> Floats:
        """The mean errors [N] over the seconds before second 0, no more than it was trained for; NaN without."""
        if self.plant is None:
            return np.full(len(windows), np.nan)
        trained_s = int(self.input_range_[1, self.inputs.index("second")])
        before = filtered_starts(hindcast_windows(windows, min(HINDCAST_S, trained_s)), self.plant)
        model = simulate_tracks(self.plant, before.start, before.acting, before.wind)
        return mean_distances(self.predict(before, model), before.track)

    def beside_baselines(self, windows: PredictionWindows, tracks: Floats) -> Candidate | None:
        return Candidate(tracks, self._hindcast_m(windows), self.usual_error_m_) if self.plant else None

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The predicted track [N, H+1, 3]; the heading is that of :meth:`heading`, which is not learned."""
        features = torch.from_numpy(self._inputs(windows, reference))
        with torch.no_grad():
            learned = self.output_scaling_.unscaled(self.network_(self.input_scaling_.scaled(features))).numpy()
        moved = self.base(windows, reference) + learned
        position = windows.start[:, None, :2] + np.concatenate([np.zeros((len(moved), 1, 2)), moved], axis=1)
        return np.concatenate([position, self.heading(windows, reference)[..., None]], axis=-1)

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        """The network's inputs at every second, and the range of each in the training."""
        low, high = self.input_range_.numpy()
        return DomainOfApplicability(
            self.inputs, self._inputs(windows, reference), low, high, DOMAIN_MARGIN * (high - low) + 1e-6
        )

    def base(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The displacement [N, H, 2] that what is learned is added to: none here."""
        return np.zeros((len(windows), windows.horizon_s, 2))

    def heading(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The heading [N, H+1] that goes with the positions: the reference's, or the present turn held."""
        track = reference if self.needs_reference else constant_velocity(windows)
        return track[..., 2]

    def state_dict(self) -> dict[str, Tensor]:
        """Everything learned, by name."""
        scalings = {"input": self.input_scaling_, "output": self.output_scaling_}
        tensors = {f"network.{name}": value for name, value in self.network_.state_dict().items()}
        for name, scaling in scalings.items():
            tensors[f"{name}.mean"], tensors[f"{name}.deviation"] = scaling.mean, scaling.deviation
        tensors["input.range"] = self.input_range_
        tensors["usual_error_m"] = torch.from_numpy(self.usual_error_m_)
        return {name: value.contiguous() for name, value in tensors.items()}

    def load_state_dict(self, tensors: dict[str, Tensor]) -> Self:
        """The inverse of :meth:`state_dict`. Raises :class:`InputError` for a network with other inputs."""
        if tensors["input.mean"].numel() != len(self.inputs):
            raise InputError("was trained on other inputs than this version gives", fix="train anew")
        self.input_scaling_ = Standardisation(tensors["input.mean"], tensors["input.deviation"])
        self.output_scaling_ = Standardisation(tensors["output.mean"], tensors["output.deviation"])
        self.input_range_ = tensors["input.range"]
        self.usual_error_m_ = tensors["usual_error_m"].numpy()
        self.network_ = make_network(len(self.input_scaling_.mean), len(self.output_scaling_.mean))
        prefix = "network."
        self.network_.load_state_dict(
            {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
        )
        return self

    def _rows(self, windows: PredictionWindows, reference: Floats) -> tuple[Tensor, Tensor]:
        """Inputs and targets [rows, C], [rows, 2] of the seconds whose position was measured."""
        features = self._inputs(windows, reference)
        targets = displacement(windows.track, windows.start) - self.base(windows, reference)
        measured = np.isfinite(targets).all(axis=-1)
        return torch.from_numpy(features[measured]), torch.from_numpy(targets[measured])

    def _scaled(self, rows: Rows, device: torch.device) -> Rows:
        inputs, targets = rows
        return self.input_scaling_.scaled(inputs).to(device), self.output_scaling_.scaled(targets).to(device)


class PaperCalibrator(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start and the reference's displacement."""

    method = "paper"
    needs_reference: ClassVar[bool] = True

    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        return (*start_labels(actuators), *REFERENCE_INPUTS)

    def features(self, windows: PredictionWindows, reference: Floats) -> Floats:
        moved = displacement(reference, windows.start)
        return np.concatenate([start_inputs(windows), moved], axis=-1)


class PublishedPaperCalibrator(PaperCalibrator):
    """The paper's calibrator trained by Adam, as published; passes, rows and patience are ours."""

    method = "paper_adam"

    def __init__(
        self, seed: int = 0, plant: Plant | None = None, epochs: int = 1000, batch: int = 100, patience: int = 100
    ) -> None:
        super().__init__(seed, plant, epochs, batch, patience)

    def _train(self, training: Rows, stopping: Rows, windows: int, progress: Progress) -> None:
        until = StoppingRule(self.epochs, self.batch, self.patience)
        fit_network_by_adam(self.network_, training, stopping, until, self.seed, progress)


class AdditiveCalibrator(PaperCalibrator):
    """Measured minus reference displacement from the start and the reference's displacement."""

    method = "additive"

    def base(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return displacement(reference, windows.start)


class DataDrivenCalibrator(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start of the window."""

    method = "data_driven"
    needs_reference: ClassVar[bool] = False

    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        return start_labels(actuators)

    def features(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return start_inputs(windows)


def training_device() -> torch.device:
    """The device for training: the one that is named, else a GPU where there is one.

    Raises :class:`ConfigurationError` for one that is named but not there.
    """
    name = os.environ.get(DEVICE_VARIABLE) or ("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ConfigurationError(
            f"cannot compute on {name!r}",
            where=DEVICE_VARIABLE,
            why=str(error).splitlines()[0],
            fix="name a device of torch, such as cpu or cuda, or leave the variable out",
        ) from error
    return torch.device(name)
