"""Locks of outputs: two commands that would write to one place at the same time, of which the second is refused.

A lock is the system's (``flock``) on a hidden file in the output folder, or beside the output file, which states
whose it is. It ends with its process, however that ends; a file that is left behind locks nothing. Where a file
system has no locks, nothing is locked.
"""

from __future__ import annotations

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from errno import EISDIR
from hashlib import blake2b
from pathlib import Path

from seatrial.acquisition.core.errors import StorageError, storage_error

LOCK = ".lock"
"""The name of the file in an output folder by which it is locked."""
_LONGEST_NAME_BYTES = 100
"""Of a name within a hidden one. The shortest limit of a file system in use is eCryptfs', 143 bytes."""
_locks: ContextVar[frozenset[Path]] = ContextVar("locks", default=frozenset())


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """An output folder that no other command writes to; it is made, and removed if it is empty at the end.

    Raises :class:`StorageError` where another command has it, naming its process, or the system refuses.
    """
    if folder.is_file():
        raise StorageError("is a file, not a folder", where=str(folder), fix="name another folder")
    with _locked(folder / LOCK, folder, wait=False):
        yield


@contextmanager
def locked_file(path: Path) -> Iterator[None]:
    """As :func:`locked_folder`, for an output file and those that belong to it."""
    if path.is_dir():
        raise storage_error(path, IsADirectoryError(EISDIR, os.strerror(EISDIR)))
    with _locked(path.with_name(hidden_name(path.name, "lock")), path, wait=False):
        yield


@contextmanager
def locked_briefly(path: Path) -> Iterator[None]:
    """A file whose last step nothing else takes at the same moment; it waits for its turn.

    It is independent of :func:`locked_file`, which a command holds for hours. Raises :class:`StorageError`.
    """
    with _locked(path.with_name(hidden_name(path.name, "moment.lock")), path, wait=True):
        yield


def hidden_name(name: str, ending: str) -> str:
    """A hidden name beside ``name``; a long one is shortened, and stays different from all others.

    >>> hidden_name("trial.csv", "lock")
    '.trial.csv.lock'
    """
    encoded = os.fsencode(name)
    if len(encoded) > _LONGEST_NAME_BYTES:
        digest = blake2b(encoded, digest_size=8).hexdigest()
        name = encoded[: _LONGEST_NAME_BYTES - len(digest)].decode("utf-8", "ignore") + digest
    return f".{name}.{ending}"


def lock(descriptor: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; False where the file system has no locks.

    Raises BlockingIOError where another process has it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def is_at(descriptor: int, path: Path) -> bool:
    """Whether an open file is still the one at ``path``."""
    with suppress(OSError):
        return os.path.samestat(os.fstat(descriptor), path.stat())
    return False


@contextmanager
def _locked(path: Path, output: Path, *, wait: bool) -> Iterator[None]:
    """Hold the lock file ``path`` of an output; this command may ask for it again."""
    missing: list[Path] = []
    try:
        missing += [folder for folder in path.parents if not folder.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        path = path.parent.resolve() / path.name
        descriptor = None if path in _locks.get() else _take(path, output, wait=wait)
    except OSError as error:
        _remove_empty(missing)
        raise error if isinstance(error, StorageError) else storage_error(output, error) from error
    if descriptor is None:
        yield
        return
    token = _locks.set(_locks.get() | {path})
    try:
        yield
    finally:
        _locks.reset(token)
        if is_at(descriptor, path):
            with suppress(OSError):
                path.unlink()  # before it is let go, or it might be another's
        os.close(descriptor)
        _remove_empty(missing)


def _take(path: Path, output: Path, *, wait: bool) -> int:
    """The descriptor of a lock file that is ours. Raises :class:`StorageError` where it is another's, OSError."""
    while True:
        descriptor = _open(path)
        try:
            lock(descriptor, wait=wait)
            if is_at(descriptor, path):  # not removed in between by the process that had it
                with suppress(OSError):  # of another user; on a full disk, what is written next says so
                    os.truncate(descriptor, 0)
                    os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
                return descriptor
        except BlockingIOError as error:
            owner = os.pread(descriptor, 200, 0).decode("utf-8", "replace")
            os.close(descriptor)
            raise StorageError(
                "is being written by another command", where=str(output), why=owner or "its process is not stated",
                fix="wait until it ends, or name another output",
            ) from error  # fmt: skip
        os.close(descriptor)


def _open(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except PermissionError:  # left behind by another user's command; a lock does not need the right to write
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, the innermost first, that nothing was written into."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()
