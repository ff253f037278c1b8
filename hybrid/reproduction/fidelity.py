"""How bad may the reference be before it stops helping, and with how much data? The computations of the map.

The reference is degraded step by step and given to a calibrator with ever more windows to learn from. On windows
never seen, the degraded reference alone, the hybrid on it, the data alone and the present motion held are compared.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress
from hybrid.calibrators import make_calibrator
from hybrid.effects import vessel_plant
from hybrid.prediction.baselines import constant_velocity, reference
from hybrid.prediction.prediction_windows import PredictionWindows, concatenate_windows
from hybrid.prediction.scores import distances
from hybrid.reproduction.campaign import MODEL, TRUTH, paper_campaign
from hybrid.reproduction.degradation import Degradation, degradations, single_degradations
from hybrid.reproduction.fidelity_map import FidelityMap
from hybrid.reproduction.processes import in_order
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant

AMOUNTS = (10, 20, 50, 100, 200, 400, 600)
LARGEST_CAMPAIGN = 150  # sequences simulated in one go
STOPPING_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class Sequences:
    """Windows to learn from and windows to be judged by, of one ship in one sea."""

    pool: PredictionWindows
    unseen: PredictionWindows


def papers_map(
    sea_state: str = "gentle",
    method: str = "paper",
    seed: int = 0,
    seeds: int = 2,
    workers: int | None = None,
    progress: Progress = lambda share: None,
) -> FidelityMap:
    """The map of the paper's ship and reference in one sea state, every axis of degradation."""
    at_work = workers or os.cpu_count() or 1
    sequences, truth = campaign_sequences(
        sea_state, seed, workers=at_work, progress=lambda done: progress(0.1 * done)
    )
    model = vessel_plant(load_vessel(MODEL))
    steps = (*degradations(truth, model), *single_degradations(truth, model))
    drawn = range(seed, seed + seeds)
    return fidelity_map(
        sequences, steps, method, seeds=drawn, workers=at_work, progress=lambda done: progress(0.1 + 0.9 * done)
    )


def campaign_sequences(
    sea_state: str = "gentle",
    seed: int = 0,
    pool: int = max(AMOUNTS),
    unseen: int = 120,
    workers: int = 2,
    progress: Progress = lambda share: None,
) -> tuple[Sequences, Plant]:
    """Sequences of the paper's campaign and the truth's plant; the unseen ones are from a sea of their own."""
    sizes = [unseen, *([LARGEST_CAMPAIGN] * (pool // LARGEST_CAMPAIGN))]
    if pool % LARGEST_CAMPAIGN:
        sizes.append(pool % LARGEST_CAMPAIGN)
    asked = [(paper_campaign, sea_state, 1000 * seed + number, TRUTH, size) for number, size in enumerate(sizes)]
    judged, *learned = in_order(asked, workers, progress)
    return Sequences(concatenate_windows([each.windows for each in learned]), judged.windows), judged.truth


def fidelity_map(
    sequences: Sequences,
    steps: Sequence[Degradation],
    method: str = "paper",
    amounts: Sequence[int] = AMOUNTS,
    seeds: Sequence[int] = (0, 1, 2),
    workers: int = 2,
    progress: Progress = lambda share: None,
) -> FidelityMap:
    """Train ``method`` on every degraded reference with every amount of data, means over ``seeds``.

    Every seed draws its own windows to learn from. Windows in which a reference leaves the range of its model are
    left out for all. Raises :class:`DataShortageError` when that leaves fewer than the largest of ``amounts``.
    """
    usable = within_range(sequences, [each.plant for each in steps])
    if len(usable.pool) < max(amounts) or not len(usable.unseen):
        raise DataShortageError(
            f"{len(usable.pool)} windows to learn from and {len(usable.unseen)} to be judged by are too few",
            fix=f"simulate more, or learn from fewer than {max(amounts)}",
        )
    asked = [
        (learned_errors_m, usable, method, seed, step, tuple(amounts))
        for step, seed in product((None, *steps), seeds)
    ]
    means = np.array(list(in_order(asked, workers, progress)))
    by_step = means.reshape(len(steps) + 1, len(seeds), len(amounts)).mean(axis=1)
    unseen = usable.unseen
    return FidelityMap(
        method=method,
        axis=tuple(each.axis for each in steps),
        label=tuple(each.label for each in steps),
        windows=tuple(amounts),
        reference_m=np.array([_mean_m(reference(unseen, each.plant), unseen) for each in steps]),
        hybrid_m=by_step[1:],
        data_driven_m=by_step[0],
        constant_velocity_m=_mean_m(constant_velocity(unseen), unseen),
        unseen_windows=len(unseen),
        seeds=tuple(seeds),
    )


def within_range(sequences: Sequences, plants: Sequence[Plant]) -> Sequences:
    """The windows in which every one of ``plants`` stays in the range of its model."""

    def inside(windows: PredictionWindows) -> NDArray[np.bool_]:
        finite = [np.isfinite(reference(windows, plant)).all(axis=(1, 2)) for plant in plants]
        return np.asarray(np.all(finite, axis=0))

    pool, unseen = sequences.pool, sequences.unseen
    return Sequences(pool.subset(inside(pool)), unseen.subset(inside(unseen)))


def learned_errors_m(
    sequences: Sequences, method: str, seed: int, step: Degradation | None, amounts: Sequence[int]
) -> Floats:
    """Mean distance on the unseen windows after learning from each of ``amounts`` windows [W].

    Without a degraded reference it is the data alone that is learned from.
    """
    order = np.random.default_rng(seed).permutation(len(sequences.pool))
    plant = None if step is None else step.plant
    name = "data_driven" if step is None else method
    tracks = [
        constant_velocity(each) if plant is None else reference(each, plant)
        for each in (sequences.pool, sequences.unseen)
    ]
    errors = []
    for amount in amounts:
        stopping, training = np.split(order[:amount], [max(2, round(STOPPING_SHARE * amount))])
        calibrator = make_calibrator(name, seed, plant).fit(
            (sequences.pool.subset(training), tracks[0][training]),
            (sequences.pool.subset(stopping), tracks[0][stopping]),
        )
        errors.append(_mean_m(calibrator.predict(sequences.unseen, tracks[1]), sequences.unseen))
    return np.array(errors)


def _mean_m(predicted: Floats, windows: PredictionWindows) -> float:
    return float(distances(predicted, windows.track).mean())
