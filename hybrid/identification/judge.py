"""What an identified model is worth on recordings that took no part in it, beside the start and the baseline.

With three recordings or more each in turn, or each of some groups of them, is left out and predicted by the model
that the others give; with fewer the last third of each is, by the model of what comes before.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress, part_of
from analysis.tables.resample import resample
from analysis.tables.table import select
from analysis.windows.recordings import second_by_second
from hybrid.effects.catalogue import vessel_plant
from hybrid.identification.fit import Fit, fit
from hybrid.identification.identify import Judgement
from hybrid.identification.response import Model
from hybrid.identification.segments import segments_of
from hybrid.prediction.baselines import constant_velocity, reference
from hybrid.prediction.dataset import dataset_of
from hybrid.prediction.kalman_filter import filtered_starts
from hybrid.prediction.scores import score
from hybrid.vessel.plant import Plant

BY_RECORDING, MOST_FOLDS = 3, 4
LAST_THIRD = (200.0 / 3.0, 100.0)
_ROUNDS = 6
_STRIDE_S = 5
Tables = Mapping[str, pd.DataFrame]
Fold = tuple[Tables, Tables]
"""The tables to fit on, and those to judge on."""


def folds_of(tables: Tables) -> tuple[list[Fold], str]:
    """What is fitted and what is judged in each fold, and what is left out in words."""
    names = list(tables)
    if len(names) < BY_RECORDING:
        first, last = (
            {name: select(table, part) for name, table in tables.items()}
            for part in ((0.0, LAST_THIRD[0]), LAST_THIRD)
        )
        return [(first, last)], "the last third of each recording"
    folds = min(len(names), MOST_FOLDS)
    made: list[Fold] = []
    for fold in range(folds):
        out = set(names[fold::folds])
        kept, others = ({name: tables[name] for name in names if (name in out) == left} for left in (False, True))
        made.append((kept, others))
    return made, "each recording in turn" if folds == len(names) else f"recordings in {folds} groups"


def judge(
    tables: Tables, model: Model, found: Fit, horizon_s: int, progress: Progress = lambda share: None
) -> Judgement | None:
    """How far predictions over ``horizon_s`` are off, under the commands as recorded; None without a window.

    ``tables`` are those that were fitted, of raw samples by recording.
    """
    folds, held_out = folds_of(tables)
    tracks: dict[str, list[np.ndarray]] = {}
    for number, (kept, others) in enumerate(folds):
        with threadpool_limits(1, user_api="blas"):
            for name, track in _fold(kept, others, model, found, horizon_s).items():
                tracks.setdefault(name, []).append(track)
        part_of(progress, number, len(folds))(1.0)
    if not tracks:
        return None
    together = {name: np.concatenate(each) for name, each in tracks.items()}
    measured = together.pop("measured")
    scores = {name: score(track, measured) for name, track in together.items()}
    return Judgement(horizon_s, len(measured), scores, held_out)


def _fold(kept: Tables, others: Tables, model: Model, found: Fit, horizon_s: int) -> dict[str, np.ndarray]:
    """Tracks by method and as measured, in the windows in which both models stay in their range."""
    length_m = model.vessel.dimensions.length_overall_m
    try:
        even = {name: second_by_second(partial(resample, table)) for name, table in others.items()}
        windows = dataset_of(even, horizon_s, _STRIDE_S, any_commands=True, length_m=length_m).windows
    except DataShortageError:
        return {}
    own, identified = vessel_plant(model.vessel), _fitted_plant(kept, model, found)
    tracks = {
        "constant_velocity": constant_velocity(filtered_starts(windows, own)),
        "reference": reference(filtered_starts(windows, own), own),
        "identified": reference(filtered_starts(windows, identified), identified),
        "measured": windows.track,
    }
    inside = np.isfinite(np.stack(list(tracks.values()))).all(axis=(0, 2, 3))
    return {name: track[inside] for name, track in tracks.items()} if inside.any() else {}


def _fitted_plant(tables: Mapping[str, pd.DataFrame], model: Model, found: Fit) -> Plant:
    """The plant by these tables alone; the search begins where that of all ended."""
    segments = segments_of(tables, vessel_plant(model.vessel), model.segments.duration_s)
    own, z = model.on_segments(segments, found.z)
    return vessel_plant(own.vessel_at(fit(own, z, levels=found.levels, rounds=_ROUNDS).z))
