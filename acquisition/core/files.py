"""Files: input that is a regular file of bounded size, output that is complete or absent."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from acquisition.core.budget import JSON_BYTES, Budget
from acquisition.core.errors import InputError, SeatrialError, StorageError, storage_error

_IRREGULAR = {
    stat.S_ISFIFO: "a named pipe", stat.S_ISSOCK: "a socket", stat.S_ISCHR: "a device", stat.S_ISBLK: "a device",
}  # fmt: skip


def require_regular(path: Path | str) -> None:
    """Raise :class:`OSError` for a path that is no regular file: a pipe never answers, a device never ends."""
    _refuse_irregular(os.stat(path).st_mode, path)  # noqa: PTH116 - also for a path with a NUL


def open_regular(path: Path | str) -> BinaryIO:
    """A regular file to read, anything else is refused as by :func:`require_regular`, without waiting for it."""
    require_regular(path)  # before it is opened: opening is enough to start some devices
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        _refuse_irregular(os.fstat(descriptor).st_mode, path)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path | str, budget: Budget, kind: type[SeatrialError] = InputError) -> bytes:
    """The content of a regular file. Raises as :func:`open_regular`, and ``kind`` beyond the budget."""
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        budget.require(size, path, size, kind)
        return stream.read(size)


def read_json(path: Path | str) -> Any:
    """The values in a JSON file. Raises :class:`OSError` and InputError as :func:`read_regular`, ValueError."""
    return parse_json(read_regular(path, JSON_BYTES).decode("utf-8"))


def parse_json(text: str | bytes) -> Any:
    """The values of a JSON text. Raises :class:`ValueError`, also for one that is nested without reason."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _refuse_irregular(mode: int, path: Path | str) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    for is_kind, kind in _IRREGULAR.items():
        if is_kind(mode):
            raise OSError(errno.EINVAL, f"it is {kind}, not a file", str(path))


@contextmanager
def atomic_file(path: Path | str) -> Iterator[Path]:
    """A temporary file that replaces ``path`` once it is complete; its folder is made.

    Raises :class:`StorageError` for what the system refuses, always naming ``path``, not the temporary file.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(path)
    except StorageError as error:
        raise error.at(path) from error
    except OSError as error:
        raise storage_error(path, error) from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_text(path: Path | str, text: str) -> Path:
    """Write a text file by :func:`atomic_file` and return its path."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return Path(path)


def expect_suffix(path: Path | str, *suffixes: str) -> str:
    """The lower-case suffix of ``path``, which has to be one of ``suffixes``.

    A name without suffix is accepted if there is only one format. Raises :class:`InputError` for another
    suffix: a file should hold what its name says.
    """
    path = Path(path)
    kind = path.suffix.lower() or (suffixes[0] if len(suffixes) == 1 else "")
    if kind not in suffixes:
        *others, last = suffixes
        named = f"{', '.join(others)} or {last}" if others else last
        raise InputError(
            f"cannot write {path.suffix or 'a file without suffix'}", where=str(path), fix=f"name it {named}"
        )
    return kind
