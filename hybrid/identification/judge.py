"""What an identified model is worth on recordings that took no part in it, beside the start and the baseline.

With three recordings or more each in turn, or each of some groups of them, is left out and predicted by the model
that the others give; with fewer the last third of each is, by the model of what comes before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress, part_of
from analysis.tables.table import select
from hybrid.effects.catalogue import vessel_plant
from hybrid.identification.fit import Fit, fit
from hybrid.identification.identify import Judgement
from hybrid.identification.response import Model
from hybrid.identification.segments import segments_of
from hybrid.prediction.baselines import constant_velocity, reference
from hybrid.prediction.dataset import Dataset, load_dataset
from hybrid.prediction.scores import score
from hybrid.vessel.plant import Plant

BY_RECORDING, MOST_FOLDS = 3, 4
LAST_THIRD = (200.0 / 3.0, 100.0)
WHOLE = (0.0, 100.0)
_ROUNDS = 6
Fold = tuple[Mapping[str, pd.DataFrame], list[Path], tuple[float, float]]
"""The tables to fit on; the recordings to judge on, and the part of each in percent."""


def folds_of(paths: Sequence[Path], tables: Mapping[str, pd.DataFrame]) -> tuple[list[Fold], str]:
    """What is fitted and what is judged in each fold, and what is left out in words."""
    names = list(tables)
    if len(names) < BY_RECORDING:
        first = {name: select(table, (0.0, LAST_THIRD[0])) for name, table in tables.items()}
        return [(first, list(paths), LAST_THIRD)], "the last third of each recording"
    folds = min(len(names), MOST_FOLDS)
    made: list[Fold] = []
    for fold in range(folds):
        out = set(range(fold, len(names), folds))
        kept = {name: tables[name] for number, name in enumerate(names) if number not in out}
        made.append((kept, [paths[number] for number in sorted(out)], WHOLE))
    return made, "each recording in turn" if folds == len(names) else f"recordings in {folds} groups"


def judge(
    paths: Sequence[Path],
    tables: Mapping[str, pd.DataFrame],
    model: Model,
    found: Fit,
    horizon_s: int,
    progress: Progress = lambda share: None,
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> Judgement | None:
    """How far predictions over ``horizon_s`` are off, under the commands as recorded; None without a window.

    The repairs are those of :func:`.load_dataset` that the tables had.
    """
    folds, held_out = folds_of(paths, tables)
    length_m = model.vessel.dimensions.length_overall_m
    load = partial(load_dataset, horizon_s=horizon_s, stride_s=5, any_commands=True, length_m=length_m,
                   repair=repair, rebuild_positions=rebuild_positions)  # fmt: skip
    tracks: dict[str, list[np.ndarray]] = {}
    for number, (kept, others, part) in enumerate(folds):
        with threadpool_limits(1, user_api="blas"):
            for name, track in _fold(kept, partial(load, others, part=part), model, found).items():
                tracks.setdefault(name, []).append(track)
        part_of(progress, number, len(folds))(1.0)
    if not tracks:
        return None
    together = {name: np.concatenate(each) for name, each in tracks.items()}
    measured = together.pop("measured")
    scores = {name: score(track, measured) for name, track in together.items()}
    return Judgement(horizon_s, len(measured), scores, held_out)


def _fold(
    kept: Mapping[str, pd.DataFrame], load: Callable[[], Dataset], model: Model, found: Fit
) -> dict[str, np.ndarray]:
    """Tracks by method and as measured, in the windows in which both models stay in their range."""
    start = vessel_plant(model.vessel)
    try:
        windows = load().windows
    except DataShortageError:
        return {}
    plant = _fitted_plant(kept, model, found)
    tracks = {
        "constant_velocity": constant_velocity(windows),
        "reference": reference(windows, start),
        "identified": reference(windows, plant),
        "measured": windows.track,
    }
    inside = np.isfinite(np.stack(list(tracks.values()))).all(axis=(0, 2, 3))
    return {name: track[inside] for name, track in tracks.items()} if inside.any() else {}


def _fitted_plant(tables: Mapping[str, pd.DataFrame], model: Model, found: Fit) -> Plant:
    """The plant by these tables alone; the search begins where that of all ended."""
    segments = segments_of(tables, vessel_plant(model.vessel), model.segments.duration_s)
    own, z = model.on_segments(segments, found.z)
    return vessel_plant(own.vessel_at(fit(own, z, levels=found.levels, rounds=_ROUNDS).z))
