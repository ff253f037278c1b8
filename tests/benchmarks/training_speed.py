"""How fast a network is trained: ours against scikit-learn's MLPRegressor, to the same error.

The same architecture, rows and scaling; the windows are half minutes of a zigzagging ship and what the model of
another ship says of them, some of them kept out. Reported is the processor time until the error on those is as
low as scikit-learn's when it has finished, and that of the whole training with its early stopping.

Run it as ``python tests/benchmarks/training_speed.py [SEEDS]``; it prints and asserts nothing.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from seatrial.acquisition.core.quantities import Floats

sys.path.insert(0, str(Path(__file__).parents[2]))

from seatrial.hybrid.calibrators.network_training import Rows, StoppingRule, fit_network, make_network
from seatrial.hybrid.calibrators.networks import HIDDEN, PaperCalibrator, Standardisation
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.sensors import controls_of, states_of, wind_of

SECONDS, FITTED, KEPT_OUT = 30, 56, 24
FASTEST_HZ = 20


def windows() -> tuple[Floats, Floats]:
    """Inputs [N, 600, 18] and displacements [N, 600, 2] of half minutes at 20 Hz."""
    made = [_windows_of(seed) for seed in range(2)]
    inputs, wanted = (np.concatenate(each) for each in zip(*made, strict=True))
    chosen = np.random.default_rng(0).permutation(len(inputs))[: FITTED + KEPT_OUT]
    return inputs[chosen], wanted[chosen]


def _windows_of(seed: int) -> tuple[Floats, Floats]:
    table, _ = simulate_trial(
        "gunnerus_long", "gentle", "paper", 2400.0, FASTEST_HZ, seed, heading_deg=120.0 * seed
    )
    length = SECONDS * FASTEST_HZ
    rows = np.arange(0, len(table) - length, length)[:, None] + np.arange(length + 1)
    states, control, wind = states_of(table)[rows], controls_of(table)[rows[:, 0]], wind_of(table)[rows[:, 0]]
    held = [np.repeat(each[:, None], length, axis=1) for each in (control, wind)]
    tracks = simulate_batch(vessel_plant(load_vessel()), states[:, 0], *held, 1.0 / FASTEST_HZ).states
    inside = np.isfinite(tracks).all(axis=(1, 2))
    start, origin = states[:, 0], states[:, :1, :2]
    known = np.column_stack([
        np.sin(start[:, 2]), np.cos(start[:, 2]), start[:, 3:],
        np.sin(wind[:, 0]), np.cos(wind[:, 0]), wind[:, 1],
        control[:, 0], np.sin(control[:, 1]), np.cos(control[:, 1]),
        control[:, 2], np.sin(control[:, 3]), np.cos(control[:, 3]), control[:, 4],
    ])  # fmt: skip
    second = np.broadcast_to(np.arange(1, length + 1)[None, :, None] / FASTEST_HZ, (len(start), length, 1))
    inputs = [np.repeat(known[:, None], length, axis=1), second, tracks[:, 1:, :2] - origin]
    return np.concatenate(inputs, axis=-1)[inside], (states[:, 1:, :2] - origin)[inside]


def scaled_rows(rate_hz: int, every: tuple[Floats, Floats]) -> tuple[Rows, Rows, Floats]:
    """Scaled rows to fit and rows kept out, by window, and the deviation of the outputs [m]."""
    step = FASTEST_HZ // rate_hz
    thinned = [each[:, step - 1 :: step] for each in every]
    scalings = [Standardisation.of(each[:FITTED].reshape(-1, each.shape[-1])) for each in thinned]
    scaled = [torch.from_numpy(scaling.standardise(each)) for scaling, each in zip(scalings, thinned, strict=True)]
    fitted, kept_out = ((scaled[0][part].flatten(0, 1), scaled[1][part].flatten(0, 1))
                        for part in (slice(FITTED), slice(FITTED, None)))  # fmt: skip
    return fitted, kept_out, scalings[1].deviation


def distance_m(predicted: Floats, rows: Rows, deviation_m: Floats) -> float:
    """The mean distance [m]."""
    return float(np.hypot(*((predicted - rows[1].numpy()) * deviation_m).T).mean())


def scikit_learn(fitted: Rows, kept_out: Rows, deviation_m: Floats, seed: int) -> tuple[float, float]:
    """Processor time [s] and the distance [m] on what was kept out."""
    network = MLPRegressor(hidden_layer_sizes=HIDDEN, random_state=seed, max_iter=1000)
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(fitted[0].numpy(), fitted[1].numpy())
    taken_s = time.process_time() - began
    return taken_s, distance_m(network.predict(kept_out[0].numpy()), kept_out, deviation_m)


def ours(fitted: Rows, kept_out: Rows, deviation_m: Floats, seed: int, goal_m: float) -> tuple[float, float, float]:
    """Processor time to the goal and to the end [s], and the distance in the end [m], on what was kept out."""
    torch.manual_seed(seed)
    network = make_network(fitted[0].shape[-1], 2)
    usual, reached_s = PaperCalibrator(seed), list[float]()

    def missed_m() -> float:
        with torch.no_grad():
            return distance_m(network(kept_out[0]).numpy(), kept_out, deviation_m)

    def look(share: float) -> None:
        if not reached_s and missed_m() <= goal_m:
            reached_s.append(time.process_time() - began)

    until = StoppingRule(usual.epochs, usual.batch, usual.patience)
    began = time.process_time()
    fit_network(network, fitted, kept_out, until, FITTED, seed, look)
    return (reached_s or [float("nan")])[0], time.process_time() - began, missed_m()


def main() -> None:
    """Measure and print."""
    seeds, every = int(sys.argv[1]) if len(sys.argv) > 1 else 3, windows()
    for rate_hz in (1, FASTEST_HZ):
        fitted, kept_out, deviation_m = scaled_rows(rate_hz, every)
        theirs = np.array([scikit_learn(fitted, kept_out, deviation_m, seed) for seed in range(seeds)])
        found = np.array([ours(fitted, kept_out, deviation_m, n, theirs[n, 1]) for n in range(seeds)])
        taken_s, missed_m = theirs.mean(axis=0)
        reached_s, whole_s, ours_m = found.mean(axis=0)
        print(f"{len(fitted[0])} rows of {FITTED} windows at {rate_hz} Hz, mean of {seeds} seeds, processor time")
        print(f"    scikit-learn     {taken_s:6.2f} s to {missed_m:5.2f} m on windows kept out")
        print(f"    ours to the same {reached_s:6.2f} s, {np.mean(theirs[:, 0] / found[:, 0]):.1f} times faster")
        print(f"    ours to its end  {whole_s:6.2f} s to {ours_m:5.2f} m")


if __name__ == "__main__":
    main()
