"""Recordings at 1 Hz by the names of their trials, and their held windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import count
from pathlib import Path

import pandas as pd

from acquisition.recording.reader import read_recording
from analysis.prepare import Preparation, prepared
from analysis.tables.resample import resample, resample_recording
from analysis.tables.table import select
from analysis.windows.held import HeldWindows, held_windows, joined, nothing_held_is_an_error


def tables_of_recordings(
    paths: Sequence[Path],
    progress: Callable[[float], None] = lambda share: None,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> dict[str, pd.DataFrame]:
    """Recordings, or a part of each one's time, at 1 Hz; by the trial's name, which is the file's.

    ``repair`` puts right before what a check of the whole recording is certain of, ``rebuild_positions`` with the
    repairs the positions too (:func:`analysis.prepare.prepared`).
    """
    tables = {}
    for number, (path, trial) in enumerate(zip(paths, trial_names(paths), strict=True)):
        recording = read_recording(path)
        if repair:
            whole = prepared(recording, Preparation(repair=True), rebuild_positions=rebuild_positions)
            tables[trial] = resample(select(whole, part_percent), 1.0)
        else:
            tables[trial] = resample_recording(recording, 1.0, part_percent=part_percent)
        progress((number + 1) / len(paths))
    return tables


def windows_of_tables(tables: Mapping[str, pd.DataFrame], horizon_s: int = 15, stride_s: int = 5) -> HeldWindows:
    """The held windows of 1 Hz tables by trial, joined.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them.
    """
    parts = [held_windows(table, horizon_s, stride_s, trial=trial) for trial, table in tables.items()]
    return nothing_held_is_an_error(joined(parts), ", ".join(tables))


def trial_names(paths: Sequence[Path]) -> list[str]:
    """The files' names without suffix, numbered where files in different folders are called the same."""
    stems = [Path(path).stem for path in paths]
    alone = {stem for stem in stems if stems.count(stem) == 1}
    names, taken = [], set(alone)
    for stem in stems:
        if stem not in alone:
            stem = next(name for name in (f"{stem}-{number}" for number in count(1)) if name not in taken)
            taken.add(stem)
        names.append(stem)
    return names
