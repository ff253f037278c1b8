"""Recordings to windows as arrays: the one way in which train, validate and predict come to their data."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from analysis.resample import resample
from analysis.table import read_table, select
from analysis.windows import held_windows

from acquisition.errors import DataShortageError
from hybrid.horizon import Horizons, from_rows, joined

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

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them.
    """
    parts: list[Horizons] = []
    sources: list[Source] = []
    candidates, dropped = 0, dict[str, int]()
    for number, path in enumerate(paths):
        table = select(read_table(path), part)
        found = held_windows(resample(table, 1.0), horizon_s, stride_s, trial=path.stem)
        candidates += found.candidates
        for reason, count in found.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
        if found.kept:
            parts.append(from_rows(found.rows))
        sources.append(Source(path, file_hash(path), part))
        progress((number + 1) / len(paths))
    if not parts:
        reasons = ", ".join(f"{count} {reason}" for reason, count in dropped.items()) or "too short"
        raise DataShortageError(
            f"no window of {horizon_s} s in which the thrusters were held",
            where=", ".join(str(path) for path in paths),
            why=reasons,
            fix="lower --horizon, or give recordings with held stretches",
        )
    return Gathered(joined(parts), tuple(sources), candidates, dropped)
