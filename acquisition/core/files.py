"""Output files: complete or absent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from acquisition.core.errors import InputError, StorageError, storage_error


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
