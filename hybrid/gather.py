"""Recordings to windows as arrays: the one way in which train, validate and predict come to their data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.smoothing.smooth import smooth_motion
from analysis.twins import refuse_twins
from analysis.windows import tables_of_recordings, windows_of_tables
from hybrid.horizon import Horizons, from_rows

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Source:
    """One recording, or a part of its time in percent, that windows were taken from.

    ``windows`` and ``legs`` count what it gave, ``span`` is from its first window's start to its last one's.
    """

    path: Path
    sha256: str
    part: tuple[float, float] = (0.0, 100.0)
    windows: int = 0
    legs: int = 0
    span: tuple[datetime, datetime] | None = None

    def overlaps(self, other: Source) -> bool:
        """Whether both hold the same stretch of the same recording."""
        return self.sha256 == other.sha256 and self.part[0] < other.part[1] and other.part[0] < self.part[1]


@dataclass(frozen=True, slots=True)
class Gathered:
    """The windows of all recordings, where they came from, and what was dropped by reason."""

    horizons: Horizons
    sources: tuple[Source, ...]
    candidates: int
    dropped: dict[str, int] = field(default_factory=dict)


def gather(
    paths: Sequence[Path],
    horizon_s: int,
    stride_s: int,
    part: tuple[float, float] = (0.0, 100.0),
    progress: Progress = lambda share: None,
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> Gathered:
    """The held windows of recordings, or of ``part`` of each one's time in percent.

    ``repair`` puts right before what is certainly wrong, ``rebuild_positions`` with the repairs the positions too.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them, and
    :class:`InputError` when one recording is given twice: its legs would be on both sides of every split.
    """
    hashes = refuse_twins(paths)
    tables = tables_of_recordings(paths, progress, part, repair=repair, rebuild_positions=rebuild_positions)
    windows = windows_of_tables(tables, horizon_s, stride_s)
    motion = [start_motion(windows.rows[windows.rows["trial"] == trial], table) for trial, table in tables.items()]
    horizons = from_rows(windows.rows, pd.concat(motion), tables)
    sources = tuple(
        Source(path, digest, part, *_counted(horizons, trial))
        for path, digest, trial in zip(paths, hashes, tables, strict=True)
    )
    return Gathered(horizons, sources, windows.candidates, windows.dropped)


def _counted(horizons: Horizons, trial: str) -> tuple[int, int, tuple[datetime, datetime] | None]:
    """How many windows and legs a recording gave, and the time they start in."""
    own = horizons.subset(horizons.trial == trial)
    if not len(own):
        return 0, 0, None
    first, last = (each.floor("us").to_pydatetime() for each in (own.start_time.min(), own.start_time.max()))
    return len(own), int(np.unique(own.leg).size), (first, last)


def start_motion(rows: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """The smoothed motion at the start of each window, one row a window in the order of their numbers."""
    starts = rows.loc[rows["second"] == 0, "start"]
    return smooth_motion(table).loc[pd.DatetimeIndex(starts)]
