"""A model that is off in many things at once, re-identified before it is diagnosed: one correction, judged first.

What the structure of a model can close is what remains when its coefficients are as good as the trial can make
them. They are identified from all legs but those of a fold, and predictions are judged on that fold's, so that the
figure is of legs that took no part. Where these do not come closer, the model stays as it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress, part_of
from analysis.tables.table import NANO, times_ns
from hybrid.diagnosis.acceptance import UNSEEN, chance_of_gains
from hybrid.diagnosis.gap import HORIZON_S, UnseenWindows, fold_of, predicted_tracks, unseen_windows
from hybrid.diagnosis.linearise import linear_model, model_of, next_states, true_states
from hybrid.diagnosis.log import Log, log_of
from hybrid.diagnosis.nuisance_basis import force_range
from hybrid.diagnosis.result import Estimate, IdentifiedCorrection
from hybrid.effects.catalogue import vessel_plant
from hybrid.identification.identify import Identification, identify_tables
from hybrid.prediction.baselines import present_motion_held
from hybrid.prediction.scores import distances
from hybrid.vessel.parameters import Vessel

SEGMENT_S = 2.0 * HORIZON_S
"""A stretch that the fit simulates from a start of its own: what is to be foretold, and where that has led to."""

_FORCES = ("surge", "sway", "yaw")


@dataclass(frozen=True, slots=True)
class Refit:
    """A vessel with coefficients from all of a trial, or as it was where that is no better, and how that went."""

    vessel: Vessel
    correction: IdentifiedCorrection


def refit_model(tables: Sequence[pd.DataFrame], vessel: Vessel, progress: Progress = lambda share: None) -> Refit:
    """Re-identify ``vessel`` from raw tables, and judge that on legs left out.

    Raises as :func:`.identify_tables`.
    """
    log = log_of(tables)
    windows = unseen_windows(log, model_of(vessel, {}))
    folds = np.unique(windows.fold).tolist()
    named = {str(number): table for number, table in enumerate(tables)}
    after = windows.before.copy()
    for number, fold in enumerate(folds):
        others = _without_fold(named, log, fold)
        part = part_of(progress, number, len(folds) + 1)
        refitted = identify_tables(others, vessel, segment_s=SEGMENT_S, progress=part)[0].vessel
        mine = windows.fold == fold
        after[mine] = _predicted(windows, refitted, mine)
    whole = part_of(progress, len(folds), len(folds) + 1)
    found = identify_tables(named, vessel, segment_s=SEGMENT_S, progress=whole)[0]
    correction = _correction(windows, after, found, forces_moved(log, vessel, found.vessel))
    return Refit(found.vessel if correction.applied else vessel, correction)


def _without_fold(tables: Mapping[str, pd.DataFrame], log: Log, fold: int) -> dict[str, pd.DataFrame]:
    """The tables without the seconds of a fold's legs: segments that these would cross have no data."""
    left_out = log.time_s[fold_of(log) == fold]
    rest = {name: table[~np.isin(_seconds(table), left_out)] for name, table in tables.items()}
    return {name: table for name, table in rest.items() if len(table)}


def _seconds(table: pd.DataFrame) -> Floats:
    return np.asarray(np.rint(times_ns(table) / NANO))


def _predicted(windows: UnseenWindows, vessel: Vessel, mine: np.ndarray) -> Floats:
    plant = vessel_plant(vessel)
    return predicted_tracks(windows.log, plant, true_states(windows.log, plant), windows.starts[mine])


def forces_moved(log: Log, before: Vessel, after: Vessel) -> dict[str, float]:
    """How far the forces of two vessels are apart along a trial, root mean square as shares of the force range.

    They are the forces ahead, across and in yaw that would make the one move in a second as the other does: a
    mass or an inertia that differs counts as the force that it takes.
    """
    old, new = vessel_plant(before), vessel_plant(after)
    linear = linear_model(log, old)
    moved = next_states(log, new, linear.origin) - next_states(log, old, linear.origin)
    force = np.linalg.solve(linear.B[:, 3:], moved[:, 3:, None])[..., 0]
    shares = np.sqrt((force**2).mean(axis=0)) / force_range(log, old, linear.origin)
    return dict(zip(_FORCES, shares.tolist(), strict=True))


def _correction(
    windows: UnseenWindows, after: Floats, found: Identification, forces: Mapping[str, float]
) -> IdentifiedCorrection:
    gains = windows.by_leg_m(windows.before) - windows.by_leg_m(after)
    held = present_motion_held(windows.log.nominal[windows.starts], HORIZON_S)
    off_m = np.array([distances(each, windows.measured) for each in (held, windows.before, after)])
    known = np.isfinite(off_m).all(axis=0)
    held_m, before_m, after_m = off_m[:, known].mean(axis=1).tolist()
    return IdentifiedCorrection(
        applied=bool(gains.mean() > 0.0 and chance_of_gains(gains) < UNSEEN),
        constant_velocity_m=held_m,
        before_m=before_m,
        after_m=after_m,
        held_out_windows=int(known.any(axis=1).sum()),
        forces=forces,
        coefficients={
            name: Estimate(each.value, each.low, each.high, "")
            for each in found.coefficients
            for name in (each.name, *each.twins)
        },
        start={name: each.start for each in found.coefficients for name in (each.name, *each.twins)},
        known=tuple(each.name for each in found.coefficients if each.known),
    )
