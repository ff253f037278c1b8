"""``seatrial reproduce table3``: the paper's Table III on sequences never seen, beside its random split.

Every figure is a mean over seeds, each seed a campaign, a split and a network of its own. Intervals hold 95 %:
a bootstrap over sequences within each seed, the same draws for every method, so that reductions are paired.

Three rows are no method: ``floor`` is the true ship from the same measurements, the weather ahead unknown;
``perfect_start`` goes on from the ship's true state instead, which nobody knows, and the weather ahead remains;
``waves_only`` knows where the ship will be but for the first-order motion in waves, and nothing gets below it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from pydantic import computed_field

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Result, from_json, to_json
from seatrial.hybrid.prediction.baselines import DRAWS, Interval, LegBootstrap, interval_from_draws
from seatrial.notebooks.wang2021.campaign import SEA_STATES, SPLITS, CampaignJob, SeaResults, SequenceErrors

SEEDS = 5
ORDER = (
    "constant_velocity", "reference", "data_driven", "paper", "additive", "hybrid", "floor", "perfect_start",
    "waves_only",
)  # fmt: skip
QUANTITIES = ("reduction_x", "reduction_y", "reduction")


@dataclass(frozen=True, slots=True)
class PublishedRow:
    """One row of the table; x is north and y east.

    The paper states the reductions of the distance. Those along x and y follow from its errors, which are
    rounded to a centimetre.
    """

    sea_state: str
    method: str
    mae_x_m: float
    mae_y_m: float
    mean_distance_m: float
    reduction: float = 0.0
    reduction_x: float = 0.0
    reduction_y: float = 0.0


PUBLISHED = (
    PublishedRow("calm", "reference", 0.31, 0.61, 0.72),
    PublishedRow("calm", "hybrid", 0.05, 0.06, 0.08, 0.883, 1 - 0.05 / 0.31, 1 - 0.06 / 0.61),
    PublishedRow("gentle", "reference", 1.19, 1.61, 2.19),
    PublishedRow("gentle", "hybrid", 0.18, 0.06, 0.20, 0.910, 1 - 0.18 / 1.19, 1 - 0.06 / 1.61),
    PublishedRow("moderate", "reference", 3.02, 1.56, 3.60),
    PublishedRow("moderate", "hybrid", 0.36, 0.10, 0.39, 0.892, 1 - 0.36 / 3.02, 1 - 0.10 / 1.56),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One method in one sea state under one split; x is north and y east.

    ``removable_gap_closed`` is (reference - method) / (reference - floor) of the mean distance; ``coverage_95`` the
    share of positions inside the 95 % regions, NaN without any. ``sequences`` counts the ones judged, of all seeds
    together.
    """

    sea_state: str
    method: str
    split: str
    mae_x_m: Interval
    mae_y_m: Interval
    mean_distance_m: Interval
    reduction: Interval
    reduction_x: Interval
    reduction_y: Interval
    removable_gap_closed: Interval
    coverage_95: Interval
    sequences: int
    seeds: int


@dataclass(frozen=True, slots=True)
class Reduction:
    """One published reduction, ours on sequences never seen, and what bounds it: ``floor``, ``perfect_start``,
    ``waves_only``."""

    sea_state: str
    quantity: str
    published: float
    hybrid: Interval
    floor: float
    perfect_start: float
    waves_only: float

    @computed_field  # type: ignore[prop-decorator]
    @property
    def above(self) -> bool:
        """Whether ours is above the published one."""
        return self.hybrid.value > self.published


@dataclass(frozen=True, slots=True, repr=False)
class Table3(Result):
    """All rows, and the published reductions compared."""

    rows: tuple[Row, ...]
    cells: tuple[Reduction, ...]
    view = "seatrial.notebooks.wang2021.page:table3_view"
    drawing = "seatrial.notebooks.wang2021.page:draw_table3"

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object."""
        plain = to_json(self)
        return {
            "rows": [_flat(row) for row in plain["rows"]],
            "published": to_json(PUBLISHED),
            "cells": plain["cells"],
        }


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """The contract's row: ``low`` and ``high`` are of the mean distance, others carry a name before."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        flat[name] = value["value"] if isinstance(value, dict) else value
        if isinstance(value, dict):
            flat |= {f"{_bound(name)}low": value["low"], f"{_bound(name)}high": value["high"]}
    return flat


def _bound(name: str) -> str:
    """What the name of an interval's bound begins with."""
    return "" if name == "mean_distance_m" else f"{name}_"


def read_table3(plain: Mapping[str, Any]) -> Table3:
    """The inverse of :meth:`Table3.as_dict`. Raises :class:`KeyError` or :class:`InputError` for anything else."""
    return from_json(Table3, {"rows": [_nested(row) for row in plain["rows"]], "cells": plain["cells"]})


def _nested(row: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of :func:`_flat`."""
    nested = {field.name: row[field.name] for field in fields(Row)}
    for name in (field.name for field in fields(Row) if field.type == "Interval"):
        ends = {end: row[f"{_bound(name)}{end}"] for end in ("low", "high")}
        nested[name] = {"value": row[name], **ends}
    return nested


def table3(seas: Sequence[SeaResults]) -> Table3:
    """The table of campaigns, any number of seeds in any number of sea states."""
    states = dict.fromkeys(sea.job.sea_state for sea in seas)
    rows = tuple(
        row
        for state in states
        for split in SPLITS
        for row in rows_of(state, split, [sea.errors[split] for sea in seas if sea.job.sea_state == state])
    )
    return Table3(rows, tuple(cells_of(rows)))


def papers_jobs(seed: int = 0, seeds: int = SEEDS) -> list[CampaignJob]:
    """The paper's three sea states, each with so many seeds from ``seed`` on."""
    return [CampaignJob(sea_state, seed + number) for sea_state in SEA_STATES for number in range(seeds)]


def rows_of(sea_state: str, split: str, by_seed: Sequence[Mapping[str, SequenceErrors]]) -> list[Row]:
    """The rows of one sea state and split, from the errors of each seed by method."""
    drawn = {method: bootstrap_means([figures_of(errors[method]) for errors in by_seed]) for method in ORDER}
    sequences = sum(len(errors["reference"].gap_m) for errors in by_seed)
    return [
        Row(sea_state, method, split, **_figures(method, drawn), sequences=sequences, seeds=len(by_seed))
        for method in ORDER
    ]


def figures_of(errors: SequenceErrors) -> Floats:
    """|north|, |east|, distance [m], and 1 inside the 95 % region or 0 outside [n, H, 4]; NaN where not judged."""
    distance = np.hypot(errors.gap_m[..., 0], errors.gap_m[..., 1])
    return np.concatenate([np.abs(errors.gap_m), distance[..., None], errors.inside[..., None]], axis=-1)


def bootstrap_means(figures: Sequence[Floats], draws: int = DRAWS) -> Floats:
    """Means of the ``figures`` of each seed [n, H, K], over the seconds at which the first is known [1 + draws, K].

    Row 0 is the mean over seeds as measured; each row after it of a draw of whole sequences, with replacement
    and within each seed: :class:`~seatrial.hybrid.prediction.baselines.LegBootstrap`, stratified.
    """
    by_seed = []
    for seed, seed_figures in enumerate(figures):
        sequence, second = np.nonzero(np.isfinite(seed_figures[..., 0]))
        judged = seed_figures[sequence, second]
        means = LegBootstrap.of(sequence, seed, draws).means_by_draw(judged)
        by_seed.append(np.vstack([judged.mean(axis=0), means]))
    return np.asarray(np.mean(by_seed, axis=0))


def _figures(method: str, drawn: Mapping[str, Floats]) -> dict[str, Interval]:
    """The intervals of a method's row."""
    means, reference, floor = drawn[method], drawn["reference"], drawn["floor"]
    reduction = 1.0 - means[:, :3] / reference[:, :3]
    values = {
        "mae_x_m": means[:, 0],
        "mae_y_m": means[:, 1],
        "mean_distance_m": means[:, 2],
        "reduction": reduction[:, 2],
        "reduction_x": reduction[:, 0],
        "reduction_y": reduction[:, 1],
        "removable_gap_closed": (reference - means)[:, 2] / (reference - floor)[:, 2],
        "coverage_95": means[:, 3],
    }
    return {name: interval_from_draws(float(series[0]), series[1:]) for name, series in values.items()}


def cells_of(rows: Iterable[Row]) -> list[Reduction]:
    """The published reductions of the sea states in ``rows``, beside ours on sequences never seen."""
    unseen = {(row.sea_state, row.method): row for row in rows if row.split == "sequence"}
    published = {row.sea_state: row for row in PUBLISHED if row.method == "hybrid"}
    cells = []
    for sea_state in dict.fromkeys(sea_state for sea_state, _ in unseen if sea_state in published):
        for quantity in QUANTITIES:
            ours, *bounds = (
                getattr(unseen[sea_state, method], quantity)
                for method in ("hybrid", "floor", "perfect_start", "waves_only")
            )
            stated = getattr(published[sea_state], quantity)
            cells.append(Reduction(sea_state, quantity, stated, ours, *(bound.value for bound in bounds)))
    return cells
