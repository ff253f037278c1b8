"""Products on disk: named by what they are, and complete or not there at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from acquisition.core.errors import InputError, StorageError, storage_error


def expect_suffix(path: Path | str, *suffixes: str) -> str:
    """The suffix of ``path`` in small letters, which has to be one of ``suffixes``.

    A name without suffix is taken where there is only one kind to write. Raises :class:`InputError` for another
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


def make_folder(folder: Path) -> None:
    """Make the folder of what is to come, before the long work rather than after. Raises :class:`StorageError`."""
    if folder.is_file():
        raise StorageError("is a file, not a folder", where=str(folder), fix="name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(folder, error) from error


@contextmanager
def in_place_of(path: Path | str) -> Iterator[Path]:
    """A file to write, which takes the place of ``path`` once it is complete; its folder is made.

    Raises :class:`StorageError` for what the system refuses.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(path)
    except OSError as error:
        raise storage_error(path, error) from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
