"""``seatrial reproduce table3``: the paper's Table III on sequences never seen, beside its random split.

Every figure is a mean over seeds, each seed a campaign, a split and a network of its own. Intervals hold 95 %:
a bootstrap over sequences within each seed, the same draws for every method, so that reductions are paired.

Two rows are no method: ``floor`` is the true ship from the same measurements, the weather ahead unknown;
``waves_only`` knows where the ship will be but for the first-order motion in waves, and nothing gets below it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybrid.reproduction.campaign import SEA_STATES
from hybrid.reproduction.comparison import SPLITS, Errors, Job, compare
from hybrid.reproduction.processes import in_order
from hybrid.reproduction.published import PUBLISHED, published_hybrid

Floats = NDArray[np.float64]
Progress = Callable[[float], None]

SEEDS, DRAWS = 5, 2000
ORDER = ("constant_velocity", "reference", "data_driven", "paper", "additive", "hybrid", "floor", "waves_only")
QUANTITIES = ("reduction_x", "reduction_y", "reduction")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over seeds with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Row:
    """One method in one sea state under one split; x is north and y east.

    ``removable_gap_closed`` is (reference - method) / (reference - floor) of the mean distance. ``sequences``
    counts the ones judged, of all seeds together.
    """

    sea_state: str
    method: str
    split: str
    mae_x_m: Estimate
    mae_y_m: Estimate
    mean_distance_m: Estimate
    reduction: Estimate
    reduction_x: Estimate
    reduction_y: Estimate
    removable_gap_closed: Estimate
    sequences: int
    seeds: int

    def as_dict(self) -> dict[str, Any]:
        """The contract's object: ``low`` and ``high`` are of the mean distance, others carry a name before."""
        flat: dict[str, Any] = {}
        for name in self.__slots__:
            each = getattr(self, name)
            if not isinstance(each, Estimate):
                flat[name] = each
                continue
            prefix = "" if name == "mean_distance_m" else f"{name}_"
            flat |= {name: each.value, f"{prefix}low": each.low, f"{prefix}high": each.high}
        return flat


@dataclass(frozen=True, slots=True)
class Cell:
    """One published reduction, ours on sequences never seen, and what bounds it: ``floor`` and ``waves_only``."""

    sea_state: str
    quantity: str
    published: float
    hybrid: Estimate
    floor: float
    waves_only: float

    @property
    def above(self) -> bool:
        """Whether ours is above the published one."""
        return self.hybrid.value > self.published

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "above": self.above}


@dataclass(frozen=True, slots=True)
class Table3:
    """All rows, and the published reductions compared."""

    rows: tuple[Row, ...]
    cells: tuple[Cell, ...]

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object."""
        return {
            "rows": [each.as_dict() for each in self.rows],
            "published": [each.as_dict() for each in PUBLISHED],
            "cells": [each.as_dict() for each in self.cells],
        }


def table3(jobs: Sequence[Job], workers: int | None = None, progress: Progress = lambda share: None) -> Table3:
    """Compare all methods on each job's campaign; the result does not depend on the number of ``workers``."""
    asked = [(compare, job) for job in jobs]
    errors = [each for done in in_order(asked, workers or os.cpu_count() or 1, progress) for each in done]
    rows = tuple(
        row
        for sea_state in dict.fromkeys(job.sea_state for job in jobs)
        for split in SPLITS
        for row in rows_of([each for each in errors if (each.job.sea_state, each.split) == (sea_state, split)])
    )
    return Table3(rows, tuple(cells_of(rows)))


def papers_jobs(seed: int = 0, seeds: int = SEEDS) -> list[Job]:
    """The paper's three sea states, each with so many seeds from ``seed`` on."""
    return [Job(sea_state, seed + number) for sea_state in SEA_STATES for number in range(seeds)]


def rows_of(errors: Sequence[Errors]) -> list[Row]:
    """The rows of one sea state and split, from the errors of every method and seed."""
    drawn = {method: bootstrap_means([each.gap_m for each in errors if each.method == method]) for method in ORDER}
    return [_row(errors, method, drawn) for method in ORDER]


def bootstrap_means(gaps_m: Sequence[Floats], draws: int = DRAWS) -> Floats:
    """Mean |north|, |east| and distance of errors by seed [n, H, 2], NaN left out: [1 + draws, 3].

    Row 0 is the mean over seeds as measured; each row after it of a draw of whole sequences, with replacement
    and within each seed (Davison and Hinkley 1997, stratified and by clusters). Equal shapes give equal draws.
    """
    by_seed = [_means(gap_m, draws, np.random.default_rng(seed)) for seed, gap_m in enumerate(gaps_m)]
    return np.asarray(np.mean(by_seed, axis=0))


def _means(gap_m: Floats, draws: int, generator: np.random.Generator) -> Floats:
    """Row 0 the means of one seed's errors, then those of each draw [1 + draws, 3]."""
    count = len(gap_m)
    times = np.vstack([np.ones(count), generator.multinomial(count, np.full(count, 1.0 / count), draws)])
    size = np.stack([*np.abs(np.moveaxis(gap_m, -1, 0)), np.hypot(gap_m[..., 0], gap_m[..., 1])], axis=-1)
    sums, judged = np.nansum(size, axis=1), np.isfinite(gap_m[..., 0]).sum(axis=1)
    return np.asarray((times @ sums) / (times @ judged)[:, None])


def _row(errors: Sequence[Errors], method: str, drawn: dict[str, Floats]) -> Row:
    mine = [each for each in errors if each.method == method]
    means, reference, floor = drawn[method], drawn["reference"], drawn["floor"]
    less = 1.0 - means / reference
    return Row(
        sea_state=mine[0].job.sea_state,
        method=method,
        split=mine[0].split,
        mae_x_m=_estimate(means[:, 0]),
        mae_y_m=_estimate(means[:, 1]),
        mean_distance_m=_estimate(means[:, 2]),
        reduction=_estimate(less[:, 2]),
        reduction_x=_estimate(less[:, 0]),
        reduction_y=_estimate(less[:, 1]),
        removable_gap_closed=_estimate((reference - means)[:, 2] / (reference - floor)[:, 2]),
        sequences=sum(len(each.gap_m) for each in mine),
        seeds=len(mine),
    )


def _estimate(values: Floats) -> Estimate:
    """The first value, with the middle 95 % of those drawn after it."""
    low, high = np.quantile(values[1:], [0.025, 0.975])
    return Estimate(float(values[0]), float(low), float(high))


def cells_of(rows: Iterable[Row]) -> list[Cell]:
    """The published reductions of the sea states in ``rows``, beside ours on sequences never seen."""
    unseen = {(row.sea_state, row.method): row for row in rows if row.split == "sequence"}
    cells = []
    for sea_state in dict.fromkeys(sea_state for sea_state, _ in unseen):
        published = published_hybrid(sea_state)
        for quantity in QUANTITIES if published else ():
            ours, *bounds = (
                getattr(unseen[sea_state, each], quantity) for each in ("hybrid", "floor", "waves_only")
            )
            cells.append(
                Cell(sea_state, quantity, getattr(published, quantity), ours, *(each.value for each in bounds))
            )
    return cells
