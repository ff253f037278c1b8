"""How bad may the reference be before it stops helping, and with how much data?

The reference is degraded step by step and given to a calibrator with ever more windows to learn from. On windows
never seen, the degraded reference alone, the hybrid on it, the data alone and the present motion held are compared.
How bad a reference is, is always said as its own mean distance on those windows, so that the user of another model
finds his place on the map.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.errors import DataShortageError
from hybrid.baselines import constant_velocity, reference
from hybrid.calibrators import make_calibrator
from hybrid.effects import vessel_plant
from hybrid.horizon import Horizons, joined_horizons
from hybrid.reproduction.campaign import MODEL, TRUTH, paper_campaign
from hybrid.reproduction.degradation import OVERALL, Degradation, degradations, single_degradations
from hybrid.reproduction.processes import in_order
from hybrid.scores import distances
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant

Floats = NDArray[np.float64]
Progress = Callable[[float], None]

AMOUNTS = (10, 20, 50, 100, 200, 400, 600)
LARGEST_CAMPAIGN = 150  # sequences simulated in one go
STOPPING_SHARE = 0.2
SAME = 0.05
"""Two methods whose errors differ by a smaller share than this count as equally good: another seed moves a small
network by as much."""


@dataclass(frozen=True, slots=True)
class Sequences:
    """Windows to learn from and windows to be judged by, of one ship in one sea."""

    pool: Horizons
    unseen: Horizons


@dataclass(frozen=True, slots=True)
class FidelityMap:
    """Mean distances [m] on unseen windows: D references, W amounts of data.

    ``reference_m`` [D] is each degraded reference alone, ``hybrid_m`` [D, W] the calibrator ``method`` on it,
    ``data_driven_m`` [W] the data alone; ``axis`` and ``label`` [D] say what was degraded.
    """

    method: str
    axis: tuple[str, ...]
    label: tuple[str, ...]
    windows: tuple[int, ...]
    reference_m: Floats
    hybrid_m: Floats
    data_driven_m: Floats
    constant_velocity_m: float
    unseen_windows: int
    seeds: tuple[int, ...]

    @property
    def rivals(self) -> tuple[str, ...]:
        """The methods compared, in the order of :meth:`errors_m`."""
        return "reference", "constant_velocity", "data_driven", self.method

    def errors_m(self) -> Floats:
        """Mean distance of every rival at every point of the map [4, D, W]."""
        shape = self.hybrid_m.shape
        alone = np.broadcast_to(self.reference_m[:, None], shape)
        data = np.broadcast_to(self.data_driven_m[None, :], shape)
        return np.stack([alone, np.full(shape, self.constant_velocity_m), data, self.hybrid_m])

    def overall(self) -> FidelityMap:
        """The main axis alone, the best reference first."""
        rows = [number for number, axis in enumerate(self.axis) if axis == OVERALL]
        rows.sort(key=lambda row: float(self.reference_m[row]))
        return FidelityMap(
            self.method,
            tuple(self.axis[row] for row in rows),
            tuple(self.label[row] for row in rows),
            self.windows,
            self.reference_m[rows],
            self.hybrid_m[rows],
            self.data_driven_m,
            self.constant_velocity_m,
            self.unseen_windows,
            self.seeds,
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON, with the thresholds and the reading."""
        plain = {name: value.tolist() if isinstance(value, np.ndarray) else value
                 for name, value in asdict(self).items()}  # fmt: skip
        limits = [None if np.isinf(each) else float(each) for each in useful_up_to_m(self)]
        return {**plain, "useful_up_to_m": limits, "reading": list(reading(self))}


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
    return Sequences(joined_horizons([each.horizons for each in learned]), judged.horizons), judged.truth


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

    def inside(horizons: Horizons) -> NDArray[np.bool_]:
        finite = [np.isfinite(reference(horizons, plant)).all(axis=(1, 2)) for plant in plants]
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


def _mean_m(predicted: Floats, horizons: Horizons) -> float:
    return float(distances(predicted, horizons.track).mean())


def useful_up_to_m(found: FidelityMap) -> Floats:
    """The reference's own error up to which the hybrid is better than the data alone, per amount of data [W].

    Better is by more than :data:`SAME`. Zero where not even the best reference helps, infinite where the worst
    still does; between two references it is interpolated on the logarithm of their errors.
    """
    main = found.overall()
    gain = np.asarray(1.0 - main.hybrid_m / main.data_driven_m - SAME)
    return np.array([_falls_below_zero(log_error(main.reference_m), column) for column in gain.T])


def log_error(error_m: Floats) -> Floats:
    """The logarithm of errors in metres, those below a millimetre counted as one."""
    return np.log(np.maximum(error_m, 1e-3))


def _falls_below_zero(log_errors: Floats, gain: Floats) -> float:
    useless = np.flatnonzero(gain <= 0.0)
    if not useless.size:
        return float("inf")
    after = int(useless[0])
    if after == 0:
        return 0.0
    share = gain[after - 1] / (gain[after - 1] - gain[after])
    return float(np.exp(log_errors[after - 1] + share * (log_errors[after] - log_errors[after - 1])))


def enough_alone_m(found: FidelityMap) -> Floats:
    """The error of the worst reference that no other method beats by more than :data:`SAME`, per amount [W]."""
    main = found.overall()
    others = main.errors_m()[1:].min(axis=0)
    enough = main.reference_m[:, None] * (1.0 - SAME) <= others
    return np.asarray(np.where(enough, main.reference_m[:, None], 0.0).max(axis=0))


def reading(found: FidelityMap) -> tuple[str, str, str]:
    """Three sentences that say how to read the map, made from its numbers."""
    main, still, few, many = found.overall(), found.constant_velocity_m, found.windows[0], found.windows[-1]
    first = (
        f"A hybrid ({found.method}) is better than the data alone {_useful(main)}; the number in brackets is that "
        f"error over the {still:.2f} m of constant velocity."
    )
    best, alone = best_up_to_m(found), enough_alone_m(found)
    second = (
        f"{_best_of_all(main, best)}, while the reference needs no calibrator as long as it is no more than "
        f"{alone[0]:.2f} m off with {few} windows and {alone[-1]:.2f} m with {many}."
    )
    row, column = np.unravel_index(int(np.argmin(_edge(main))), main.hybrid_m.shape)
    third = (
        f"It wins by most on a reference that is {main.reference_m[row]:.2f} m off after {found.windows[column]} "
        f"windows, where it leaves {main.hybrid_m[row, column]:.2f} m against {main.data_driven_m[column]:.2f} m "
        f"of the data alone, and on the worst tried ({main.reference_m[-1]:.2f} m off) after {many} it leaves "
        f"{main.hybrid_m[-1, -1]:.2f} m against {main.data_driven_m[-1]:.2f} m."
    )
    return first, second, third


def _useful(main: FidelityMap) -> str:
    """Up to which error of the reference the hybrid beats the data, for each amount of data."""
    limits, still, worst = useful_up_to_m(main), main.constant_velocity_m, main.reference_m[-1]
    bounded = [
        f"below {limit:.2f} m ({limit / still:.1f}) with {amount}"
        for limit, amount in zip(limits, main.windows, strict=True)
        if np.isfinite(limit)
    ]
    always = [str(amount) for limit, amount in zip(limits, main.windows, strict=True) if np.isinf(limit)]
    parts = [f"as long as the reference's own mean error stays {', '.join(bounded)} windows"] if bounded else []
    if always:
        parts.append(
            f"on every reference tried, up to {worst:.2f} m ({worst / still:.1f}), with {', '.join(always)}"
        )
    return " and ".join(parts)


def _best_of_all(main: FidelityMap, best: Floats) -> str:
    """From how many windows on, and on how bad a reference, the hybrid beats everything else."""
    winning = np.flatnonzero(best > 0.0)
    if not winning.size:
        return "It is the best of all, constant velocity included, nowhere"
    first = int(winning[0])
    return (
        f"It is the best of all, constant velocity included, from {main.windows[first]} windows on: there with "
        f"references up to {best[first]:.2f} m off, after {main.windows[-1]} up to {best[-1]:.2f} m"
    )


def best_up_to_m(found: FidelityMap) -> Floats:
    """The error of the worst reference on which the hybrid beats all others by more than :data:`SAME` [W]."""
    main = found.overall()
    wins = _edge(main) < 1.0 - SAME
    return np.asarray(np.where(wins, main.reference_m[:, None], 0.0).max(axis=0))


def _edge(main: FidelityMap) -> Floats:
    """The hybrid's error over that of the best of all other methods, a millimetre at least [D, W]."""
    return np.asarray(main.hybrid_m / np.maximum(main.errors_m()[:-1].min(axis=0), 1e-3))
