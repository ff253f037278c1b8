"""Training of networks, the only part that needs PyTorch: least squares, or Adam, with early stopping.

Least squares uses Levenberg-Marquardt steps. A step needs the derivative of every output with respect to every
weight, feasible for the few hundred weights of these networks. A few dozen steps get further than a thousand
epochs of Adam, in a fraction of the time. Each step draws new rows, so its cost does not grow with the data.

Our own steps are needed for two reasons, the changing rows and stopping on held-out windows:
``scipy.optimize.least_squares`` on all rows has after twelve steps 1.6 times (trf) and 2.1 times (lm) our error
on unseen windows, in 1.5 and 3.4 times our total time (tests/benchmarks/least_squares.py).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise

import torch
from torch import Tensor, nn

from seatrial.acquisition.core import errors, quantities
from seatrial.hybrid.calibrators.networks import HIDDEN, Layers

Rows = tuple[Tensor, Tensor]
"""Inputs [rows, C] and target outputs [rows, K], both scaled."""

DEVICE_VARIABLE = "SEATRIAL_DEVICE"
"""The environment variable for the training device, e.g. ``cpu`` or ``cuda:1``."""

MOST_DECAY = 1e-4
DECAY_IN_WINDOWS = 20.0
"""The weight decay is the mean squared error times this over the number of windows, which corresponds to
normally distributed weights and errors constant within a window (MacKay 1992); at most :data:`MOST_DECAY`."""
FIRST_DAMPING, LEAST_DAMPING = 1.0, 1e-9
FIRST_ROWS, MORE_ROWS = 100, 1.25
"""The number of rows grows over the first steps: far from the optimum a few are enough."""
EASIER, HARDER, MOST_TRIALS = 1.0 / 3.0, 4.0, 8


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """When training ends: after a number of steps, or of steps in a row without gain on the held-out rows.

    ``rows`` is the number drawn for a step after the first steps.
    """

    steps: int
    rows: int
    patience: int


class Perceptron:
    """The weights of linear layers with ReLU between them as one vector, and derivatives with respect to it."""

    def __init__(self, network: nn.Sequential) -> None:
        self.shapes = [weight.shape for weight in network.parameters()]
        self.sizes = [shape.numel() for shape in self.shapes]

    def layers(self, weights: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Matrix and offset of each layer: views of the vector."""
        pieces = weights.split(self.sizes)  # type: ignore[no-untyped-call]
        parts = [piece.view(shape) for piece, shape in zip(pieces, self.shapes, strict=True)]
        return list(zip(parts[::2], parts[1::2], strict=True))

    def outputs(self, weights: Tensor, inputs: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The outputs [rows, K], and the inputs of each layer."""
        *hidden, (matrix, offset) = self.layers(weights)
        entering = [inputs]
        for matrix_below, shift in hidden:
            entering.append(torch.relu(torch.addmm(shift, entering[-1], matrix_below.T)))
        return torch.addmm(offset, entering[-1], matrix.T), entering

    def jacobian(self, weights: Tensor, entering: list[Tensor]) -> Tensor:
        """The derivative of each output with respect to each weight [rows K, weights], by backpropagation."""
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
    stopping_rule: StoppingRule,
    windows: int | None,
    seed: int = 0,
    progress: errors.Progress = lambda share: None,
) -> None:
    """Fit the weights of linear layers with ReLU between them; the best on the ``stopping`` rows are kept.

    By least squares with so many independent ``windows`` in the training rows, as errors within a window are
    correlated; or by Adam (None), each step one pass over all rows, ``stopping_rule.rows`` at a time. Rows are
    drawn on the CPU, so that a seed gives the same rows on every device.
    """
    torch.set_num_threads(1)  # layers of ten neurons are faster on one thread
    generator = torch.Generator().manual_seed(seed)
    if windows is None:
        steps = _adam_passes(network, training, stopping_rule.rows, generator)
    else:
        steps = _least_squares_steps(network, training, stopping_rule.rows, windows, generator)
    perceptron, best, best_error, stagnant_steps = Perceptron(network), _weight_vector(network), float("inf"), 0
    for step, weights in enumerate(islice(steps, stopping_rule.steps), 1):
        error, stagnant_steps = _mean_square_error(perceptron, weights, stopping), stagnant_steps + 1
        if error < best_error:
            best, best_error, stagnant_steps = weights, error, 0
        nn.utils.vector_to_parameters(weights.clone(), network.parameters())
        progress(step / stopping_rule.steps)
        if stagnant_steps > stopping_rule.patience:
            break
    nn.utils.vector_to_parameters(best, network.parameters())


def _least_squares_steps(
    network: nn.Sequential, training: Rows, most_rows: int, windows: int, generator: torch.Generator
) -> Iterator[Tensor]:
    """The weights after each step; the damping (Marquardt 1963) is reduced after a step that lowered the error and
    increased after one that did not."""
    perceptron, weights, damping = Perceptron(network), _weight_vector(network), FIRST_DAMPING
    share, rows = DECAY_IN_WINDOWS / windows, float(min(most_rows, FIRST_ROWS))
    while True:
        drawn, count = training, int(rows)
        if count < len(training[0]):
            chosen = torch.randperm(len(training[0]), generator=generator)[:count].to(training[0].device)
            drawn = training[0][chosen], training[1][chosen]
        # The first step that lowers error plus decay.
        outputs, entering = perceptron.outputs(weights, drawn[0])
        slopes, residual = perceptron.jacobian(weights, entering), (outputs - drawn[1]).reshape(-1)
        error = residual.square().mean().item()
        decay = min(MOST_DECAY, share * error)
        curvature = slopes.T @ slopes / len(residual)
        gradient = slopes.T @ residual / len(residual) + decay * weights
        initial_cost = error + decay * weights.square().sum().item()
        for _ in range(MOST_TRIALS):
            damped = curvature.clone()
            damped.diagonal().add_(damping + decay)
            moved = weights - torch.cholesky_solve(gradient[:, None], torch.linalg.cholesky(damped))[:, 0]
            moved_cost = _mean_square_error(perceptron, moved, drawn) + decay * moved.square().sum().item()
            if moved_cost < initial_cost:
                weights, damping = moved, max(EASIER * damping, LEAST_DAMPING)
                break
            damping *= HARDER
        rows = min(most_rows, MORE_ROWS * rows)
        yield weights


ADAM_RATE = 1e-3
"""The paper's learning rate."""


def _adam_passes(
    network: nn.Sequential, training: Rows, batch: int, generator: torch.Generator
) -> Iterator[Tensor]:
    """The weights after each pass over all rows by Adam, ``batch`` at a time."""
    adam = torch.optim.Adam(network.parameters(), lr=ADAM_RATE)
    while True:
        order = torch.randperm(len(training[0]), generator=generator).to(training[0].device)
        for rows in torch.split(order, batch):
            adam.zero_grad()
            loss = nn.functional.mse_loss(network(training[0][rows]), training[1][rows])
            loss.backward()  # type: ignore[no-untyped-call]
            adam.step()
        yield _weight_vector(network)


def _weight_vector(network: nn.Sequential) -> Tensor:
    """All weights of a network in one vector, detached."""
    return nn.utils.parameters_to_vector(network.parameters()).detach()


def _mean_square_error(perceptron: Perceptron, weights: Tensor, data: Rows) -> float:
    return nn.functional.mse_loss(perceptron.outputs(weights, data[0])[0], data[1]).item()


def make_network(inputs: int, outputs: int, hidden: tuple[int, ...] = HIDDEN) -> nn.Sequential:
    """A perceptron with ReLU between its layers, in double precision."""
    widths = (inputs, *hidden)
    layers: list[nn.Module] = []
    for width, next_width in pairwise(widths):
        layers += [nn.Linear(width, next_width), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(widths[-1], outputs)).double()


def train_network(
    training: tuple[quantities.Floats, quantities.Floats],
    stopping: tuple[quantities.Floats, quantities.Floats],
    stopping_rule: StoppingRule,
    windows: int | None,
    seed: int = 0,
    progress: errors.Progress = lambda share: None,
) -> Layers:
    """The layers of a network fitted to scaled rows, inputs [rows, C] and outputs [rows, K], on the
    :func:`training_device` by :func:`fit_network`."""
    torch.manual_seed(seed)
    network, device = make_network(training[0].shape[1], training[1].shape[1]), training_device()
    network.to(device)
    rows = [(torch.from_numpy(a).to(device), torch.from_numpy(b).to(device)) for a, b in (training, stopping)]
    fit_network(network, rows[0], rows[1], stopping_rule, windows, seed, progress)
    parameters = [parameter.detach().cpu().numpy().copy() for parameter in network.parameters()]
    return tuple(zip(parameters[::2], parameters[1::2], strict=True))


def training_device() -> torch.device:
    """The training device: the one named in the environment, else a GPU if there is one.

    Raises :class:`ConfigurationError` if the named one does not exist.
    """
    name = os.environ.get(DEVICE_VARIABLE) or ("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise errors.ConfigurationError(
            f"cannot compute on {name!r}",
            where=DEVICE_VARIABLE,
            why=str(error).splitlines()[0],
            fix="name a device of torch, such as cpu or cuda, or leave the variable out",
        ) from error
    return torch.device(name)
