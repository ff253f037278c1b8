"""Recordings to windows as arrays: the one way in which train, validate and predict come to their data."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from acquisition.errors import InputError
from analysis.smooth import smooth_motion
from analysis.windows import tables_of_recordings, windows_of_tables
from hybrid.horizon import Horizons, from_rows

Progress = Callable[[float], None]
_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Source:
    """One recording, or a part of its time in percent, that windows were taken from."""

    path: Path
    sha256: str
    part: tuple[float, float] = (0.0, 100.0)

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


def file_hash(path: Path) -> str:
    """The SHA-256 of a file, by which a recording is known again under any name."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def gather(
    paths: Sequence[Path],
    horizon_s: int,
    stride_s: int,
    part: tuple[float, float] = (0.0, 100.0),
    progress: Progress = lambda share: None,
) -> Gathered:
    """The held windows of recordings, or of ``part`` of each one's time in percent.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them, and
    :class:`InputError` when one recording is given twice: its legs would be on both sides of every split.
    """
    tables = tables_of_recordings(paths, progress, part)
    windows = windows_of_tables(tables, horizon_s, stride_s)
    motion = [start_motion(windows.rows[windows.rows["trial"] == trial], table) for trial, table in tables.items()]
    horizons = from_rows(windows.rows, pd.concat(motion))
    sources = tuple(Source(path, file_hash(path), part) for path in paths)
    _refuse_twins(sources)
    return Gathered(horizons, sources, windows.candidates, windows.dropped)


def _refuse_twins(sources: Sequence[Source]) -> None:
    first: dict[str, Path] = {}
    for each in sources:
        if first.setdefault(each.sha256, each.path) is not each.path:
            raise InputError(
                "is given twice",
                where=str(each.path),
                why=f"it is the same recording as {first[each.sha256]}",
                fix="give it once",
            )


def start_motion(rows: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """The smoothed motion at the start of each window, one row a window in the order of their numbers."""
    starts = rows.loc[rows["second"] == 0, "start"]
    return smooth_motion(table).loc[pd.DatetimeIndex(starts)]
