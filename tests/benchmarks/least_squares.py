"""The two fits that step by themselves, against ``scipy.optimize.least_squares`` with the same Jacobian.

The adaptive calibrator's vector: whitening is drawn up anew after every step, and a Jacobian costs as much as sixty
predictions of all windows. The network: every step sees rows of its own, and training stops where windows that were
kept out stop gaining. Reported is the processor time and the mean distance on windows that neither has seen.

Run it as ``python tests/benchmarks/least_squares.py [SEEDS]``; it prints and asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import nn

sys.path.insert(0, str(Path(__file__).parents[2]))

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.calibrators import adaptive
from seatrial.hybrid.calibrators.adaptive import (
    Observations,
    observations_of_windows,
    parameter_names,
    run_observer,
)
from seatrial.hybrid.calibrators.network_training import Perceptron, Rows, StoppingRule, fit_network, make_network
from seatrial.hybrid.calibrators.networks import PaperCalibrator
from seatrial.hybrid.effects import apply_effects, vessel_plant
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.benchmarks.training_speed import FITTED, distance_m, scaled_rows, windows
from tests.hybrid.windows_by_hand import voyages

WINDOWS, SECONDS = 60, 15
METHODS, STEPS = ("trf", "lm"), 12


def adapted_by_scipy(
    plant: Plant, seen: Observations, track: Floats, method: str, most: int = adaptive.STEPS
) -> Floats:
    """As :func:`adaptive.adapt`, with scipy's steps in a whitened space and no more Jacobians than ours."""
    off, known = adaptive._make_difference_function(plant, seen, track)
    vector, jacobians = np.zeros(len(parameter_names(plant.form))), dict[bytes, Floats]()

    def raw(at: Floats) -> Floats:
        if at.tobytes() not in jacobians:
            jacobians[at.tobytes()] = adaptive._weighted_jacobian(
                plant, off, at, off(at), np.ones_like(known[..., None], dtype=float)
            )
        return jacobians[at.tobytes()]

    while len(jacobians) < most:
        weight = adaptive._whitening_factors(off(vector), known, 1.0)
        spread = np.broadcast_to(weight, (*known.shape, 3)).ravel()

        def differences(at: Floats, weight: Floats = weight) -> Floats:
            return np.concatenate([np.nan_to_num(off(at) * weight, nan=1e6, posinf=1e6, neginf=-1e6).ravel(), at])

        def jacobian(at: Floats, spread: Floats = spread) -> Floats:
            return np.vstack([raw(at) * spread[:, None], np.eye(at.size)])

        before = vector
        vector = least_squares(differences, vector, jacobian, method=method, max_nfev=4, ftol=2e-3).x
        if np.allclose(before, vector, atol=1e-6):
            break
    return vector


def fitted_by_scipy(network: nn.Sequential, fitted: Rows, kept_out: Rows, method: str, steps: int) -> None:
    """All rows at once, by scipy's steps; the weights that are best on the rows kept out are kept."""
    torch.set_num_threads(1)
    perceptron, best = Perceptron(network), [np.inf, nn.utils.parameters_to_vector(network.parameters()).detach()]

    def differences(at: Floats) -> Floats:
        return (perceptron.outputs(torch.from_numpy(at), fitted[0])[0] - fitted[1]).reshape(-1).numpy()

    def jacobian(at: Floats) -> Floats:
        weights = torch.from_numpy(at)
        missed = (perceptron.outputs(weights, kept_out[0])[0] - kept_out[1]).square().mean().item()
        if missed < best[0]:
            best[:] = missed, weights.clone()
        return perceptron.jacobian(weights, perceptron.outputs(weights, fitted[0])[1]).numpy()

    least_squares(differences, best[1].numpy().copy(), jacobian, method=method, max_nfev=steps)
    nn.utils.vector_to_parameters(best[1], network.parameters())


def adaptive(seed: int) -> dict[str, tuple[float, float]]:
    """Processor time [s] and distance [m] of the adaptive calibrator's fit, each way."""
    plant = vessel_plant(load_vessel())
    ship = apply_effects(plant, {"hull_lengthening": {"length_m": 5.0}, "hull_fouling": {"resistance_factor": 1.4}})
    taught, unseen = (noisy(voyages(ship, WINDOWS, SECONDS, each), each) for each in (2 * seed, 2 * seed + 1))
    observations, later = observations_of_windows(taught), observations_of_windows(unseen)
    adaptive.fit_parameter_vector(plant, observations, taught.track, 1.0, steps=1)  # compiles

    def measured(way: Callable[[], Floats]) -> tuple[float, float]:
        began = time.process_time()
        vector = way()
        taken_s = time.process_time() - began
        states, waves = run_observer(vector, plant, later)
        return taken_s, float(distances(states[..., :3] + waves, unseen.track).mean())

    found = {"ours": measured(lambda: adaptive.fit_parameter_vector(plant, observations, taught.track, 1.0))}
    for method in METHODS:
        way = partial(adapted_by_scipy, plant, observations, taught.track, method)
        found[f"scipy {method}"] = measured(way)
    return found


def noisy(windows: PredictionWindows, seed: int) -> PredictionWindows:
    """Measured as real sensors do."""
    random = np.random.default_rng(seed)
    past = windows.past.copy()
    past[..., :6] += random.standard_normal(past[..., :6].shape) * (0.05, 0.05, 0.0017, 0.03, 0.03, 0.0008)
    track = windows.track + random.standard_normal(windows.track.shape) * (0.05, 0.05, 0.0017)
    return replace(windows, past=past, track=track)


def network(seed: int) -> dict[str, tuple[float, float]]:
    """Processor time [s] and distance [m] of the network's training, each way."""
    fitted, kept_out, deviation_m = scaled_rows(1, windows())
    usual = PaperCalibrator(0)

    def measured(way: Callable[[nn.Sequential], None]) -> tuple[float, float]:
        torch.manual_seed(seed)
        net = make_network(fitted[0].shape[-1], 2)
        began = time.process_time()
        way(net)
        taken_s = time.process_time() - began
        with torch.no_grad():
            return taken_s, distance_m(net(kept_out[0]).numpy(), kept_out, deviation_m)

    until = StoppingRule(usual.epochs, usual.batch, usual.patience)
    found = {"ours": measured(lambda net: fit_network(net, fitted, kept_out, until, FITTED, seed))}
    for method in METHODS:
        found[f"scipy {method}"] = measured(lambda net, m=method: fitted_by_scipy(net, fitted, kept_out, m, STEPS))
    return found


def main() -> None:
    """Measure and print."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    for title, measure in (
        (f"adaptive, {WINDOWS} windows of {SECONDS} s", adaptive),
        (f"network, scipy stopped after {STEPS} steps", network),
    ):
        found = [measure(seed) for seed in range(seeds)]
        print(f"{title}, mean of {seeds} seeds, processor time")
        for name in found[0]:
            taken_s, missed_m = np.mean([each[name] for each in found], axis=0)
            print(f"    {name:10s} {taken_s:6.2f} s to {missed_m:6.3f} m", flush=True)


if __name__ == "__main__":
    main()
