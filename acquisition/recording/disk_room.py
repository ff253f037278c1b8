"""Room on the disk of a recording: what is free, the reserve that stays free, and why a disk is too full."""

from __future__ import annotations

import os
from pathlib import Path

from acquisition.config.sections import RecordingSection
from acquisition.core.errors import StorageError

RESUME_RATIO = 1.1
"""So much more than the reserve must be free again before a recording goes on."""

_MEGA = 1_000_000
_LARGEST_RESERVE_BYTES = 200 * _MEGA
_RESERVE_SHARE = 0.05


def free_bytes(folder: Path) -> tuple[int, int]:
    """What is free for us on the folder's disk, and how large that disk is [bytes]."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize, disk.f_blocks * disk.f_frsize


def reserve_bytes(settings: RecordingSection, disk_bytes: int) -> float:
    """How much of a disk of that size stays free [bytes]."""
    if settings.reserve_mb is not None:
        return settings.reserve_mb * _MEGA
    return min(_RESERVE_SHARE * disk_bytes, _LARGEST_RESERVE_BYTES)


def shortage(settings: RecordingSection, free: float, size: int, ratio: float = 1.0) -> str:
    """In what a disk is too full, with so much free of its size [bytes]; nothing if it is not."""
    reserve = reserve_bytes(settings, size)
    if free >= reserve * ratio:
        return ""
    return f"{free / _MEGA:.1f} MB free, less than the reserve of {reserve / _MEGA:.1f} MB"


def room_bytes(folder: Path, settings: RecordingSection) -> int | None:
    """What may still be written to the folder's disk [bytes]; None if the disk cannot be asked."""
    try:
        free, size = free_bytes(folder)
    except OSError:
        return None
    return max(int(free - reserve_bytes(settings, size)), 0)


def why_full(folder: Path, settings: RecordingSection, ratio: float = 1.0) -> str:
    """Why the disk is too full to go on; nothing if it is not."""
    try:
        free, size = free_bytes(folder)
    except OSError:
        return ""  # opening or writing will say what is wrong, and better
    why = shortage(settings, free, size, ratio)
    return f"{folder}: {why}" if why else ""


def require_room(folder: Path, settings: RecordingSection) -> None:
    """Raise :class:`StorageError` where a recording cannot begin for want of room; the folder need not be there."""
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if why := shortage(settings, *free_bytes(existing)):
        raise StorageError(
            "cannot be recorded to",
            where=str(folder),
            why=why,
            fix="make room, or lower `reserve_mb` in [recording]",
        )
