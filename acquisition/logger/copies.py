"""Copies of finished parts in a second folder, read back and compared; older parts make room once theirs are sound.

Nothing is deleted whose copy has not just been read back and found to be the same, byte for byte. The work is done
beside the recording, at a lower priority.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from seatrial.acquisition.config.sections import CopiesSection
from seatrial.acquisition.core.errors import ConfigurationError, StorageError, storage_error
from seatrial.acquisition.core.process import started
from seatrial.acquisition.logger.health import CopyState
from seatrial.acquisition.logger.supervision import LOG
from seatrial.acquisition.recording.parts import RecordingParts, parts_in
from seatrial.acquisition.recording.storage import free_bytes, mount_point, new_file, require_mounted, sync_folder

_LOOK_EVERY_S, _TRY_AGAIN_S = 5.0, 60.0
_LONGEST_FINISH_S = 20.0  # what a supervisor that stops us has patience for
_LONGEST_STOP_S = 5.0
_PIECE_BYTES = 1024 * 1024
_PAUSE_S = 0.005  # after each piece: at most 200 MB/s, so that the recording's disk has time for it
_PRIORITY = 10
_GIGA = 1e9

Pause = Callable[[], None]
"""What is done between two pieces; it may raise, to end the work."""


def copy_part(path: Path, folder: Path, pause: Pause = lambda: None) -> Path:
    """Copy a finished part to ``folder``, under the same name once it has been read back and is the same.

    Another file of that name is moved aside. Raises :class:`StorageError` where the folder is not there, the disk
    fails, or the copy is not the same.
    """
    copy, partial = folder / path.name, folder / f".{path.name}.part"
    if not folder.is_dir():
        raise StorageError("does not exist", where=str(folder), fix="mount the disk and make the folder")
    if path.exists() and free_bytes(folder)[0] < path.stat().st_size:
        raise StorageError("cannot be written: the disk is full", where=str(copy), fix="make room on that disk")
    try:
        with path.open("rb") as source, partial.open("wb") as target:
            while piece := source.read(_PIECE_BYTES):
                target.write(piece)
                pause()
            target.flush()
            os.fsync(target.fileno())
        shutil.copystat(path, partial)
        sound = same(path, partial, pause)
        if sound and copy.exists():
            copy.rename(new_file(folder, f"{copy.stem}_other"))
        if sound:
            partial.replace(copy)
            sync_folder(folder)
    except OSError as error:
        raise storage_error(copy, error) from error
    finally:
        partial.unlink(missing_ok=True)
    if not sound:
        raise StorageError("reads back differently from what was written", where=str(copy), fix="check the disk")
    return copy


def same(first: Path, second: Path, pause: Pause = lambda: None) -> bool:
    """Whether two files, not one under two names, hold the same as the disks have them; not if one is not there."""
    try:
        alike = first.stat().st_size == second.stat().st_size and not first.samefile(second)
        return alike and _digest(first, pause) == _digest(second, pause)
    except OSError:
        return False


def _digest(path: Path, pause: Pause) -> bytes:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        os.fsync(stream.fileno())
        os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)  # from the disk, not from memory
        while piece := stream.read(_PIECE_BYTES):
            digest.update(piece)
            pause()
    return digest.digest()


def require_other_folder(settings: CopiesSection, folder: Path) -> None:
    """Raise :class:`ConfigurationError` where the copies would be the recordings themselves."""
    if settings.folder.resolve() == folder.resolve():
        where, fix = f"[copies] {settings.folder}", "name a folder on another disk"
        raise ConfigurationError("is the folder of the recordings", where=where, fix=fix)


class _EndedError(Exception):
    """The recording is over, and so is our time."""


class Copies:
    """The copies of one trial's recordings in ``folder``, kept up while ``parts`` are written.

    Trouble is told once and tried again.
    """

    def __init__(self, settings: CopiesSection, folder: Path, trial: str, parts: RecordingParts) -> None:
        self._target, self._keep_gb = settings.folder, settings.keep_gb
        self._folder, self._trial, self._parts = folder, trial, parts
        self.state = CopyState()
        self._sizes: dict[Path, int] = {}
        self._mount = mount_point(settings.folder)
        self._ending, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="copies", daemon=True)

    def start(self) -> bool:
        """Begin in a thread of its own; False where the system gives none."""
        return started(self._thread)

    def stop(self) -> None:
        """Copy what the recording has ended with, as far as that can be done soon; the rest comes the next time."""
        self._parts.tell = lambda level, text: getattr(LOG, level)(text)  # the recording is closed
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join(_LONGEST_FINISH_S)
            self._ended.set()
            self._thread.join(_LONGEST_STOP_S)  # no longer: a disk that hangs must not keep us

    def where(self, path: Path) -> Path:
        """Where a part is to be found: where it was recorded, or its copy once it made room."""
        return path if os.path.lexists(path) else self._target / path.name

    def _work(self) -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _PRIORITY)
        with suppress(_EndedError):
            while not self._ending.wait(_TRY_AGAIN_S if self.state.trouble else _LOOK_EVERY_S):
                self.look()
            self.look(everything=True)

    def _pause(self) -> None:
        if self._ended.wait(_PAUSE_S):
            raise _EndedError

    def look(self, *, everything: bool = False) -> None:
        """Copy what has not grown since the last look (``everything``: that too), and make room."""
        current = None if self._parts.paused else self._parts.path
        try:
            require_mounted(self._mount)
            sizes = {path: path.stat().st_size for path in self._recorded()}
            finished = [path for path, size in sizes.items()
                        if path != current and (everything or self._sizes.get(path) == size)]  # fmt: skip
            self._sizes = sizes
            missing = [path for path in finished if not self._seems_copied(path)]
            self.state.waiting = len(missing)
            for path in missing:
                copy_part(path, self._target, self._pause)
                self.state.waiting -= 1
            self._make_room(finished, sum(sizes.values()))
        except _EndedError:
            raise
        except Exception as error:  # nothing that happens to a copy ends the copying
            if not self.state.trouble:
                self._parts.tell("error", f"no copies for now: {error}")
            self.state.trouble = str(error)
            return
        if self.state.trouble:
            self.state.trouble = ""
            self._parts.tell("warning", f"copies to {self._target} go on; nothing is missing there")

    def _recorded(self) -> list[Path]:
        """The parts of the trial in the folder, also those that a file system gave another name."""
        present = parts_in(self._folder, self._trial)
        return [*present, *(path for path in self._parts.paths if path not in present and path.exists())]

    def _seems_copied(self, path: Path) -> bool:
        copy = self._target / path.name
        return copy.exists() and copy.stat().st_size == path.stat().st_size and not copy.samefile(path)

    def _make_room(self, finished: list[Path], size: int) -> None:
        """Delete the oldest parts beyond what is to be kept, each once its copy has been read again."""
        for path in finished:
            if self._keep_gb is None or size <= self._keep_gb * _GIGA:
                return
            if not same(path, self._target / path.name, self._pause):
                copy_part(path, self._target, self._pause)
            size -= path.stat().st_size
            path.unlink()
            self._parts.tell("info", f"{path.name} is deleted here; its copy in {self._target} is verified")
