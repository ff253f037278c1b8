"""Training of a small network by least squares: Levenberg and Marquardt's steps, stopped early.

A step needs the derivative of every output with respect to every weight, which the few hundred weights of
these networks allow. A few dozen steps come further than a thousand epochs of Adam, and in a fraction of the
time. Each step sees rows drawn anew, so that its cost does not grow with the data.

The steps are ours for these two reasons, other rows each time and an end where windows kept out stop gaining:
``scipy.optimize.least_squares`` on all rows is after twelve steps 1.6 times (trf) and 2.1 times (lm) as far off on
windows not seen, in 1.5 and 3.4 times the time that ours takes to its end (tests/benchmarks/least_squares.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from acquisition.core.progress import Progress

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
class Stopping:
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
    until: Stopping,
    windows: int,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> None:
    """Fit the weights of linear layers with ReLU between them; the best on the ``stopping`` rows are kept.

    ``windows`` is how many of the training rows are independent: those of one window err together.
    The damping of Marquardt (1963) falls after a step that lowered the error and grows after one that did not.
    Rows are drawn on the processor, so that the same seed means the same rows on every device.
    """
    torch.set_num_threads(1)  # ten neurons a layer are slower on two threads than on one
    perceptron, generator = Perceptron(network), torch.Generator().manual_seed(seed)
    weights, damping = nn.utils.parameters_to_vector(network.parameters()).detach(), FIRST_DAMPING
    share = DECAY_IN_WINDOWS / windows
    best, best_error, since = weights, float("inf"), 0
    rows: float = min(until.rows, FIRST_ROWS)
    for step in range(until.steps):
        weights, damping = _stepped(perceptron, weights, damping, share, _drawn(training, int(rows), generator))
        rows = min(until.rows, MORE_ROWS * rows)
        error = _mean_square(perceptron, weights, stopping)
        since += 1
        if error < best_error:
            best, best_error, since = weights, error, 0
        perceptron.give(weights, network)
        progress((step + 1) / until.steps)
        if since > until.patience:
            break
    perceptron.give(best, network)


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
