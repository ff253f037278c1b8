"""Training: derivatives, what is learned, when it stops, seeds and devices."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.calibrators.network_training import (
    DEVICE_VARIABLE,
    Perceptron,
    StoppingRule,
    fit_network,
    make_network,
    train_network,
    training_device,
)
from seatrial.hybrid.calibrators.networks import PaperCalibrator, perceptron_outputs
from tests.hybrid.windows_by_hand import random_windows

UNTIL = StoppingRule(steps=120, rows=400, patience=20)


def rows(count: int, seed: int, noise: float = 0.0) -> tuple[Tensor, Tensor]:
    """Points of a smooth function of three numbers into two."""
    generator = torch.Generator().manual_seed(seed)
    inputs = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    a, b, c = inputs.T
    wanted = torch.stack([torch.tanh(a) * b, c + 0.5 * torch.sin(2.0 * a)], dim=-1)
    return inputs, wanted + noise * torch.randn(count, 2, generator=generator, dtype=torch.float64)


def network(seed: int = 0) -> nn.Sequential:
    torch.manual_seed(seed)
    return make_network(3, 2)


def error(net: nn.Sequential, data: tuple[Tensor, Tensor]) -> float:
    with torch.no_grad():
        return nn.functional.mse_loss(net(data[0]), data[1]).item()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), hidden=st.lists(st.integers(1, 7), min_size=1, max_size=3))
def test_the_derivatives_are_those_of_the_network(seed: int, hidden: list[int]) -> None:
    """Outputs and Jacobian of any architecture agree with torch's own differentiation."""
    torch.manual_seed(seed)
    net = make_network(3, 2, tuple(hidden))
    perceptron = Perceptron(net)
    weights = nn.utils.parameters_to_vector(net.parameters()).detach()
    inputs = torch.randn(5, 3, dtype=torch.float64)
    outputs, entering = perceptron.outputs(weights, inputs)
    assert torch.allclose(outputs, net(inputs))
    oracle = torch.autograd.functional.jacobian(lambda w: perceptron.outputs(w, inputs)[0].reshape(-1), weights)
    assert torch.allclose(perceptron.jacobian(weights, entering), oracle)


def test_a_known_function_is_learned() -> None:
    """Less than two hundredths of the variance is left on points that were not seen, with every seed."""
    for seed in range(3):
        net = network(seed)
        fit_network(net, rows(1500, 1), rows(300, 2), UNTIL, 1500, seed)
        unseen = rows(500, 3)
        assert error(net, unseen) < 0.02 * unseen[1].var().item()


def test_a_straight_line_is_learned_to_the_last_digits() -> None:
    """Where nothing is left unexplained, the decay of the weights leaves nothing either."""
    inputs, _ = rows(400, 1)
    wanted = inputs @ torch.tensor([[0.5, -0.2], [0.3, 0.1], [-0.4, 0.7]], dtype=torch.float64) + 0.25
    net = network()
    fit_network(net, (inputs[:300], wanted[:300]), (inputs[300:], wanted[300:]), StoppingRule(200, 400, 20), 300)
    assert error(net, (inputs, wanted)) < 1e-5


def test_early_stopping_returns_the_best_weights() -> None:
    """On noise it stops long before the end, and hands back the weights that did best on the way."""
    training, stopping = rows(60, 1, noise=5.0), rows(60, 2, noise=5.0)
    net, errors = network(), list[float]()
    fit_network(
        net,
        training,
        stopping,
        StoppingRule(300, 40, 12),
        60,
        progress=lambda share: errors.append(error(net, stopping)),
    )
    assert len(errors) == int(np.argmin(errors)) + 1 + 12 + 1 < 300
    assert error(net, stopping) == min(errors)


def test_a_seed_draws_the_same_rows() -> None:
    """The same seed and the same first weights end in the same weights to the bit; another seed elsewhere."""

    def fitted(seed: int) -> Tensor:
        net = network()
        fit_network(net, rows(300, 1), rows(50, 2), StoppingRule(6, 64, 10), 300, seed)
        return nn.utils.parameters_to_vector(net.parameters()).detach()

    first = fitted(3)
    torch.rand(3)
    assert torch.equal(fitted(3), first)
    assert not torch.equal(fitted(4), first)


@pytest.mark.parametrize("windows", [100, None])
def test_what_is_kept_needs_no_torch(windows: int | None) -> None:
    """The layers are arrays that give what the network gave: they err on the stopping rows as its best weights."""
    training, stopping = rows(100, 1), rows(20, 2)
    until, errors = StoppingRule(6, 64, 10), list[float]()
    given = [tuple(each.numpy() for each in data) for data in (training, stopping)]
    layers = train_network(given[0], given[1], until, windows, seed=5)
    net = network(5)
    fit_network(net, training, stopping, until, windows, 5, lambda share: errors.append(error(net, stopping)))
    missed = perceptron_outputs(layers, given[1][0]) - given[1][1]
    assert np.square(missed).mean() == pytest.approx(min(errors))


def test_a_device_can_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The variable decides; a device that is not there is one clear error."""
    monkeypatch.setenv(DEVICE_VARIABLE, "cpu")
    assert training_device() == torch.device("cpu")
    for wrong in ("cuda:99", "abacus"):
        monkeypatch.setenv(DEVICE_VARIABLE, wrong)
        with pytest.raises(ConfigurationError, match=f"cannot compute on '{wrong}'"):
            training_device()
    monkeypatch.delenv(DEVICE_VARIABLE)
    assert training_device().type == ("cuda" if torch.cuda.is_available() else "cpu")


def _trained_on(device: str, monkeypatch: pytest.MonkeyPatch) -> PaperCalibrator:
    monkeypatch.setenv(DEVICE_VARIABLE, device)
    training, stopping = (random_windows(count, 8, seed) for seed, count in enumerate((150, 40)))
    return PaperCalibrator(epochs=30).fit((training, training.track), (stopping, stopping.track))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU that torch can use")
def test_a_gpu_gives_the_same_tracks(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same rows in double precision: tracks within a centimetre of those trained on the processor."""
    unseen = random_windows(40, 8, 2)
    tracks = [_trained_on(device, monkeypatch).predict(unseen, unseen.track) for device in ("cpu", "cuda")]
    assert np.abs(tracks[0] - tracks[1])[..., :2].max() < 0.01
