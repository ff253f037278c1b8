"""The data set for training and validation: windows of recordings as arrays, with their origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, quantities
from seatrial.analysis.series import USUAL_LENGTH_M, smooth_motion, smoothing_half_width
from seatrial.analysis.tables.table import hash_distinct_files
from seatrial.analysis.windows.held import OneHertzTables, tables_of_recordings, windows_of_tables
from seatrial.hybrid.prediction import baselines, kalman_filter, window_sets
from seatrial.hybrid.vessel.black_box import MotionModel

SHORTEST_S = 8
"""The shortest holding time of thrusters [s] worth learning from."""

LEG_HORIZONS = 4
"""With any commands windows follow each other without end; a leg is this many horizons of them."""


@dataclass(frozen=True, slots=True)
class WindowSource:
    """A recording, or a part of its time in percent, that windows were taken from.

    ``windows`` and ``legs`` count what it provided, ``span`` is from the first window's start to the last
    one's.
    """

    path: Path
    sha256: str
    part: tuple[float, float] = (0.0, 100.0)
    windows: int = 0
    legs: int = 0
    span: tuple[datetime, datetime] | None = None

    def overlaps(self, source: WindowSource) -> bool:
        """Whether both contain the same stretch of the same recording."""
        return self.sha256 == source.sha256 and self.part[0] < source.part[1] and source.part[0] < self.part[1]


@dataclass(frozen=True, slots=True)
class Dataset:
    """The windows of all recordings, their origin, and the numbers dropped by reason; ``tables`` are the
    recordings at 1 Hz by trial."""

    windows: window_sets.PredictionWindows
    sources: tuple[WindowSource, ...]
    candidates: int
    dropped: dict[str, int] = field(default_factory=dict)
    tables: Mapping[str, OneHertzTables] = field(default_factory=dict)


def load_dataset(
    paths: Sequence[Path],
    horizon_s: int,
    stride_s: int,
    time_range: tuple[float, float] = (0.0, 100.0),
    progress: errors.Progress = lambda share: None,
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
    shorter: bool = False,
    any_commands: bool = False,
    length_m: float = USUAL_LENGTH_M,
) -> Dataset:
    """Load the held windows of recordings, or of a ``time_range`` of each one in percent; with ``any_commands`` all
    windows that have data, with the recorded commands.

    ``repair`` first corrects faults that are certain, ``rebuild_positions`` the positions as well. The other
    arguments are those of :func:`dataset_of`. Raises :class:`InputError` if a recording is given twice: its
    legs would be on both sides of every split.
    """
    sources = [
        WindowSource(path, digest, time_range)
        for path, digest in zip(paths, hash_distinct_files(paths), strict=True)
    ]
    tables = tables_of_recordings(paths, progress, time_range, repair=repair, rebuild_positions=rebuild_positions)
    return dataset_of(
        tables, horizon_s, stride_s, sources, shorter=shorter, any_commands=any_commands, length_m=length_m
    )


def dataset_of(
    tables: Mapping[str, OneHertzTables],
    horizon_s: int,
    stride_s: int,
    sources: Sequence[WindowSource] = (),
    *,
    shorter: bool = False,
    any_commands: bool = False,
    length_m: float = USUAL_LENGTH_M,
) -> Dataset:
    """The windows of recordings at 1 Hz by trial, which come from ``sources``.

    Two-sided start states are smoothed as for a ship of ``length_m`` (:func:`.smoothing_half_width`). With
    ``shorter``, windows held for half the horizon only are appended, NaN after that: calibrators learn from
    them but are not tested on them. With any commands they are not needed.

    Raises :class:`DataShortageError` with the counts by reason if there is no window in any of them.
    """

    def arrays_of(rows: pd.DataFrame) -> window_sets.PredictionWindows:
        by_trial = [(rows[rows["trial"] == trial], recorded.table) for trial, recorded in tables.items()]
        motion = pd.concat([start_motion(trial_rows, table, length_m) for trial_rows, table in by_trial])
        return window_sets.windows_from_rows(rows, motion, tables, any_commands=any_commands)

    held = windows_of_tables(tables, horizon_s, stride_s, keep_moving=any_commands)
    windows = arrays_of(held.rows)
    if any_commands:
        start_s, _ = windows.measured_seconds()
        shorter_legs = windows.leg.astype("<U200")
        for leg in np.unique(windows.leg):
            in_leg = windows.leg == leg
            part = (start_s[in_leg] - start_s[in_leg].min()) // (LEG_HORIZONS * windows.horizon_s)
            shorter_legs[in_leg] = [f"{leg}.{number + 1:03d}" for number in part]
        windows = replace(windows, leg=shorter_legs)
    elif shorter and horizon_s // 2 >= SHORTEST_S:
        windows = _append_shorter_windows(
            windows, arrays_of(windows_of_tables(tables, horizon_s // 2, stride_s).rows)
        )
    counted = []
    for source, trial in zip(sources, tables, strict=False):
        provided = windows.subset((windows.trial == trial) & windows.is_complete)
        if len(provided):
            span = provided.start_time.min().floor("us"), provided.start_time.max().floor("us")
            first, last = (time.to_pydatetime() for time in span)
            legs = int(np.unique(provided.leg).size)
            source = replace(source, windows=len(provided), legs=legs, span=(first, last))
        counted.append(source)
    return Dataset(windows, tuple(counted), held.candidates, held.dropped, tables)


def _append_shorter_windows(
    windows: window_sets.PredictionWindows, shorter: window_sets.PredictionWindows
) -> window_sets.PredictionWindows:
    """``windows``, followed by those of ``shorter`` that are not the beginning of one of them, padded with NaN.

    A leg then begins where a window shares no second with those before and is of another leg than the previous one
    of its length, so that a split by leg never separates windows that overlap.
    """
    starts = set(zip(windows.trial, windows.start_ns, strict=True))
    is_new = [start not in starts for start in zip(shorter.trial, shorter.start_ns, strict=True)]
    added = shorter.subset(np.array(is_new, dtype=bool))
    unknown = np.full((len(added), windows.horizon_s - shorter.horizon_s, 3), np.nan)
    padded = replace(added, track=np.concatenate([added.track, unknown], axis=1))
    combined = window_sets.concatenate_windows([windows, padded])
    first, last = combined.measured_seconds()
    legs = np.empty(len(combined), dtype="<U200")
    for trial in np.unique(combined.trial):
        rows = np.flatnonzero(combined.trial == trial)
        rows = rows[np.argsort(first[rows], kind="stable")]
        covered_until = np.maximum.accumulate(last[rows])
        is_separate = first[rows][1:] > covered_until[:-1]
        changes_leg = combined.leg[rows][1:] != combined.leg[rows][:-1]
        changes_leg |= combined.is_complete[rows][1:] != combined.is_complete[rows][:-1]
        number = np.concatenate([[0], np.cumsum(is_separate & changes_leg)])
        legs[rows] = [f"{trial}/{leg_number + 1:03d}" for leg_number in number]
    return replace(combined, leg=legs)


def start_motion(rows: pd.DataFrame, table: pd.DataFrame, length_m: float = USUAL_LENGTH_M) -> pd.DataFrame:
    """The two-sided smoothed motion at the start of each window, as for a ship of ``length_m``; one row for
    each window, in order of their numbers."""
    smooth = smooth_motion(table, smoothing_half_width(length_m))
    return smooth.loc[pd.DatetimeIndex(rows.loc[rows["second"] == 0, "start"])]


def windows_within_model_range(
    windows: window_sets.PredictionWindows, plant: MotionModel
) -> tuple[window_sets.PredictionWindows, quantities.Floats]:
    """The windows in which the reference model stays in its range, and its tracks [N, H+1, 3] on them.

    They start from the model's own Kalman filter at second 0 (:func:`.filtered_starts`); the model has to stay
    in range from the two-sided start too. Raises :class:`DataShortageError` if there are none.
    """
    windows = kalman_filter.filtered_starts(windows, plant)
    tracks = baselines.simulate_reference(windows, plant)
    both_tracks = np.stack(
        [tracks, baselines.simulate_reference(window_sets.replace_by_two_sided_starts(windows), plant)]
    )
    inside = np.asarray(np.isfinite(both_tracks).all(axis=(0, 2, 3)))
    if not inside.any():
        raise errors.DataShortageError(
            "the reference model leaves its valid range in every window",
            why="speeds or thrust are outside those of this vessel",
            fix="check --vessel and the units of the recording",
        )
    return windows.subset(inside), tracks[inside]
