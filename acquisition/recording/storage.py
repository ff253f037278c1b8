"""The disk under a recording: the room on it, and a file that stays whole whatever becomes of the disk.

MCAP's writer hands over a record in many small pieces. They are gathered here and written at once, so that the
file always ends with a complete record; a write that fails halfway is cut off again.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from errno import EACCES, EINVAL, ENODEV, ENOSYS, ENOTSUP, EPERM
from pathlib import Path

from seatrial.acquisition.config.sections import RecordingSection
from seatrial.acquisition.core.errors import StorageError

RESUME_RATIO = 1.1
"""So much more than the reserve must be free again before a recording goes on."""

_MEGA = 1_000_000
_LARGEST_RESERVE_BYTES = 200 * _MEGA
_RESERVE_SHARE = 0.05
_COPY_BYTES = 1024 * 1024
_FOLDER_SYNC_UNSUPPORTED = {EACCES, EINVAL, ENOSYS, ENOTSUP, EPERM}


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
    existing = next(directory for directory in (folder, *folder.absolute().parents) if directory.exists())
    if why := shortage(settings, *free_bytes(existing)):
        fix = "free space, or lower `reserve_mb` in [recording]"
        raise StorageError("cannot be recorded to", where=str(folder), why=why, fix=fix)


def mount_point(folder: Path) -> Path | None:
    """Where the disk below ``folder`` is mounted; None on the root disk, which cannot go."""
    place = folder.resolve()
    point = next(path for path in (place, *place.parents) if os.path.ismount(path))
    return None if point == point.parent else point


def require_mounted(point: Path | None) -> None:
    """Raise OSError where nothing is mounted at ``point`` any more: its folder now belongs to another disk."""
    if point is not None and not os.path.ismount(point):
        raise OSError(ENODEV, f"the disk at {point} is gone: nothing is mounted there")


class SyncThread:
    """The thread in which disks keep what was written, for all parts of a recording.

    Where the system gives no thread, the caller's is used, and a new one is tried again each time.
    """

    def __init__(self) -> None:
        self._executor: ThreadPoolExecutor | None = None

    @property
    def running(self) -> bool:
        """Whether there is a thread."""
        return self._executor is not None

    def start(self) -> None:
        """Start the thread, unless there is one."""
        if self._executor is None:
            executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sync")
            try:
                executor.submit(int)  # the only thread of an executor starts with its first work
            except RuntimeError:
                return
            self._executor = executor

    def submit(self, call: Callable[[int], None], descriptor: int) -> Future[None]:
        """Call with a descriptor in the thread; the future has the result, or the exception."""
        self.start()
        if self._executor is not None:
            return self._executor.submit(call, descriptor)
        future: Future[None] = Future()
        try:
            call(descriptor)
            future.set_result(None)
        except OSError as error:
            future.set_exception(error)
        return future

    def stop(self) -> None:
        """End the thread, after what it is doing."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None


class CommittedFile:
    """A file that is only ever appended to, with the part of the file interface that MCAP's writer uses.

    ``committed`` is its length after the last :meth:`flush`, ``synced`` after the last :meth:`sync`; both in
    bytes. ``thread`` syncs in the background. Methods raise OSError.
    """

    def __init__(self, path: Path, thread: SyncThread | None = None) -> None:
        self.path = path
        self.committed = 0
        self.synced = 0
        self._gathered = bytearray()
        # A slow disk takes seconds to keep what it is given, which the recorder has not got.
        self._thread = thread or SyncThread()
        self._syncing: Future[None] | None = None
        self._syncing_bytes = 0
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        try:
            self.inode = os.fstat(self._descriptor).st_ino
        except OSError:
            self.close()
            raise

    @property
    def closed(self) -> bool:
        """Whether :meth:`close` was called."""
        return self._descriptor < 0

    @property
    def vanished(self) -> bool:
        """Whether somebody has deleted the file while it was being written."""
        return os.fstat(self._descriptor).st_nlink == 0

    def write(self, data: bytes) -> int:
        """Take ``data`` in; nothing reaches the system before :meth:`flush`."""
        self._gathered += data
        return len(data)

    def tell(self) -> int:
        """Where the next byte will stand."""
        return self.committed + len(self._gathered)

    def flush(self) -> None:
        """Hand what was gathered to the system: all of it, or nothing and OSError."""
        try:
            view, written = memoryview(bytes(self._gathered)), 0
            while written < len(view):
                written += os.pwrite(self._descriptor, view[written:], self.committed + written)
        except OSError:
            self.cut_to(self.committed)
            raise
        self.committed += len(self._gathered)
        self._gathered.clear()

    def sync(self) -> None:
        """Flush, and make the disk keep it."""
        self.flush()
        self._end_syncing()
        os.fdatasync(self._descriptor)
        self.synced = self.committed

    def begin_sync(self) -> bool:
        """Flush, and let the disk keep it while others go on; False if it is still busy with the last time.

        Raises what went wrong the last time.
        """
        self.flush()
        if self._syncing is not None:
            if not self._syncing.done():
                return False
            self._end_syncing()
            self.synced = self._syncing_bytes
        self._syncing_bytes = self.committed
        self._syncing = self._thread.submit(os.fdatasync, self._descriptor)
        return True

    def _await_sync(self) -> None:
        """Wait for a sync in the background: it uses the descriptor."""
        if self._syncing is not None:
            wait([self._syncing])

    def _end_syncing(self) -> None:
        """Let a sync in the background come to its end, and raise what went wrong with it: the system tells it once
        only, and asked again would say that all is well."""
        if self._syncing is not None:
            last, self._syncing = self._syncing, None
            last.result()

    def cut_to(self, length: int) -> None:
        """Forget everything after ``length`` bytes; a disk that is gone cannot even do that, and need not."""
        try:
            os.ftruncate(self._descriptor, length)
        except OSError:
            return
        self.committed = length

    def abandon(self, ending: bytes) -> bool:
        """Keep what the disk is sure to have, close it with ``ending`` if that can be, and let go of the file.

        Returns whether the ending was written.
        """
        self._await_sync()
        self._syncing = None
        self._gathered.clear()
        self.cut_to(self.synced)
        self._gathered += ending
        try:
            self.sync()
        except OSError:
            return False
        finally:
            self.close()
        return True

    def rescue(self, path: Path, ending: bytes) -> None:
        """Write a deleted file's content to ``path``: as long as the file is open, the system keeps it.

        Leaves nothing at ``path`` if that fails.
        """
        try:
            with path.open("wb") as copy:
                for offset in range(0, self.committed, _COPY_BYTES):
                    copy.write(os.pread(self._descriptor, min(_COPY_BYTES, self.committed - offset), offset))
                copy.write(ending)
                copy.flush()
                os.fsync(copy.fileno())
        except OSError:
            path.unlink(missing_ok=True)
            raise

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if not self.closed:
            self._await_sync()
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)


def end_file(path: Path, inode: int, length: int, ending: bytes) -> None:
    """Cut the file at ``path`` to ``length`` and end it, if it is still the one with that inode, and as long."""
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        state = os.fstat(descriptor)
        if state.st_ino == inode and state.st_size >= length:
            os.ftruncate(descriptor, length)
            os.pwrite(descriptor, ending, length)
            os.fdatasync(descriptor)
    finally:
        os.close(descriptor)


def new_file(folder: Path, stem: str) -> Path:
    """A new empty ``.mcap`` file of our own, the stem with a number where that name is taken; the folder is made.

    Of two programs that want one name, the second gets the next.
    """
    folder.mkdir(parents=True, exist_ok=True)
    number, path = 1, folder / f"{stem}.mcap"
    while True:
        try:
            path.touch(exist_ok=False)
        except FileExistsError:
            number += 1
            path = folder / f"{stem}_{number}.mcap"
        else:
            return path


def sync_folder(folder: Path) -> None:
    """Make the disk keep a new file's name too, not only what is in it; some file systems keep it unasked."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        if error.errno not in _FOLDER_SYNC_UNSUPPORTED:
            raise
