"""Files: input that is a regular file of bounded size, output that is complete or absent; TOML files.

An output is never a mixture of two commands' or of two runs'. It is written under a temporary name in the same
folder and renamed when it is complete and on the disk. That name is new for every writer, which holds a lock on it:
what a killed process has left behind has no lock, and the next writer of the same output removes it.

Of two commands that would write to one place at the same time the second is refused. The lock is the system's
(``flock``) on a hidden file in the output folder, or beside the output file, which states its owner. It ends with
its process, however that ends; a file that is left behind locks nothing. Where a file system has no locks, nothing
is locked. What goes to an object store appears there complete, by the store's own doing.

Every error in a TOML file names the line to change.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import socket
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from difflib import get_close_matches
from errno import EINVAL, EISDIR
from hashlib import blake2b
from importlib import import_module
from io import BufferedReader
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

from seatrial.acquisition.core import errors, process, stores

if TYPE_CHECKING:
    import pydantic

_IRREGULAR = {
    stat.S_ISFIFO: "a named pipe", stat.S_ISSOCK: "a socket", stat.S_ISCHR: "a device", stat.S_ISBLK: "a device",
}  # fmt: skip
_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{16}\.part", re.DOTALL)
LOCK_NAME = ".lock"
"""The name of the file in an output folder by which it is locked."""
_LONGEST_NAME_BYTES = 100
"""Of a name within a hidden one. The shortest limit of a file system in use is eCryptfs', 143 bytes."""


# Systems without these flags and locks by file (Windows) open and lock in another way.
CLOSED_IN_CHILDREN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0)
_FAR_AWAY = 1 << 30
"""Where Windows locks a byte of a lock file, beyond the text that others read in it."""


def read_at(descriptor: int, size: int, offset: int) -> bytes:
    """As ``os.pread``, also where the system has none."""
    if hasattr(os, "pread"):
        return os.pread(descriptor, size, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.read(descriptor, size)


def write_at(descriptor: int, data: bytes | memoryview, offset: int) -> int:
    """As ``os.pwrite``, also where the system has none."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, data, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.write(descriptor, data)


def sync_data(descriptor: int) -> None:
    """As ``os.fdatasync``; on a system without it all of a file is synced."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def open_regular_file(path: Path | str) -> BufferedReader:
    """A regular file to read, without waiting for it.

    Raises :class:`OSError` for anything else: a pipe never answers, a device never ends.
    """
    # before it is opened, too: opening is enough to start some devices
    _refuse_irregular_file(os.stat(path).st_mode, path)  # noqa: PTH116 - also for a path with a NUL
    descriptor = os.open(path, os.O_RDONLY | CLOSED_IN_CHILDREN | _WITHOUT_WAITING)
    try:
        _refuse_irregular_file(os.fstat(descriptor).st_mode, path)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular_file(
    path: Path | str, budget: process.FileBudget, kind: type[errors.SeatrialError] = errors.InputError
) -> bytes:
    """The content of a regular file. Raises as :func:`open_regular_file`, and ``kind`` beyond the budget."""
    with open_regular_file(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        budget.require_within_budget(size, path, size, kind)
        return stream.read(size)


def read_json(path: Path | str) -> Any:
    """The values in a JSON file. Raises as :func:`read_regular_file`, and ValueError for what is no JSON."""
    return parse_json(read_regular_file(path, process.JSON_BYTES).decode("utf-8"))


def parse_json(text: str | bytes) -> Any:
    """The values of a JSON text. Raises :class:`ValueError`, also for one that is nested without reason."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _refuse_irregular_file(mode: int, path: Path | str) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(EISDIR, "it is a folder", str(path))
    for is_kind, kind in _IRREGULAR.items():
        if is_kind(mode):
            raise OSError(EINVAL, f"it is {kind}, not a file", str(path))


@dataclass(slots=True)
class _FileSet:
    """Files that are complete but not in place yet: the temporary file of each, None for one to be removed."""

    temporaries: ExitStack
    files: dict[Path, Path | None] = field(default_factory=dict)


_current_set: ContextVar[_FileSet | None] = ContextVar("current_set", default=None)
_inputs: ContextVar[frozenset[tuple[int, int] | str]] = ContextVar("inputs", default=frozenset())


@contextmanager
def atomic_file(path: Path | str) -> Iterator[Path]:
    """A temporary file that replaces ``path`` once it is complete; its folder is made. For a ``path`` in an object
    store it is a local one, which is put there.

    Within :func:`written_together` it does so at the end of all. Raises :class:`StorageError` for what the system
    refuses, always naming ``path``, not the temporary file; :class:`InputError` where ``path`` is an input of the
    command, see :func:`protect_inputs`.
    """
    path = Path(path)
    file_set = _current_set.get()
    with _raise_storage_errors(path), ExitStack() as stack:
        refuse_protected_input(path)
        if stores.is_remote(path):
            folder = TemporaryDirectory(prefix="seatrial-")
            partial = Path((stack if file_set is None else file_set.temporaries).enter_context(folder)) / path.name
            partial.touch()
            yield partial
            if file_set is None:
                stores.upload(partial, path)
            else:
                file_set.files[path] = partial
            return
        if path.is_dir():
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR))
        process_stream = path.is_symlink() and str(path.readlink()).startswith("/proc/")  # /dev/stdout
        if process_stream or (path.exists() and not path.is_file()):
            why = "an output appears when it is complete"
            raise errors.StorageError("is a device or a pipe", where=str(path), why=why, fix="name a file")
        path.parent.mkdir(parents=True, exist_ok=True)
        stack = stack if file_set is None else file_set.temporaries
        partial = stack.enter_context(_locked_temporary(path, folder=False))
        yield partial
        descriptor = os.open(partial, os.O_RDWR | CLOSED_IN_CHILDREN)
        try:
            os.fsync(descriptor)  # before it gets its name: a power cut would leave an empty file under it
        finally:
            os.close(descriptor)
        if file_set is None:
            partial.replace(path)
        else:
            file_set.files[path] = partial


@contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """A temporary folder in the place of ``path``, which may be renamed to it; removed at the end.

    Raises OSError.
    """
    with _locked_temporary(path, folder=True) as folder:
        yield folder


@contextmanager
def written_together(last: Path) -> Iterator[None]:
    """All files written inside appear at the end, when all of them are complete; ``last`` after all others.

    An existing ``last`` is removed before the first of them changes: where it exists, all belong together. A set
    within another is part of the outer one. Raises :class:`StorageError`.
    """
    if _current_set.get() is not None:
        yield
        return
    with ExitStack() as temporaries:
        file_set = _FileSet(temporaries)
        token = _current_set.set(file_set)
        try:
            yield
        finally:
            _current_set.reset(token)
        if stores.is_remote(last):
            _replace_in_store(file_set.files, last)
            return
        with lock_for_replacement(last):
            with _raise_storage_errors(last):
                last.unlink(missing_ok=True)
            for path, partial in sorted(file_set.files.items(), key=lambda item: item[0] == last):
                with _raise_storage_errors(path):
                    if partial is None:
                        path.unlink(missing_ok=True)
                    else:
                        partial.replace(path)


def _replace_in_store(files: Mapping[Path, Path | None], last: Path) -> None:
    """Put files that belong together into a store, ``last`` after all others; after a failure none is there.

    Raises :class:`StorageError`.
    """
    stores.remove(last)
    try:
        for path, partial in sorted(files.items(), key=lambda item: item[0] == last):
            if partial is None:
                stores.remove(path)
            else:
                stores.upload(partial, path)
    except BaseException:
        for path in files:
            with suppress(errors.SeatrialError):
                stores.remove(path)
        raise


def remove_file(path: Path) -> None:
    """Remove a file if it exists; within :func:`written_together` at the end of all.

    Raises as :func:`atomic_file`.
    """
    refuse_protected_input(path)
    if (file_set := _current_set.get()) is not None:
        file_set.files[path] = None
        return
    if stores.is_remote(path):
        stores.remove(path)
        return
    with _raise_storage_errors(path):
        path.unlink(missing_ok=True)


def write_text(path: Path | str, text: str) -> Path:
    """Write a text file by :func:`atomic_file` and return its path."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return Path(path)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file by :func:`atomic_file`."""
    with atomic_file(path) as partial:
        partial.write_bytes(content)


def make_folder(folder: Path) -> None:
    """Make the folder of what is to come, before the long work rather than after. Raises :class:`StorageError`."""
    if folder.is_file():
        raise errors.StorageError("is a file, not a folder", where=str(folder), fix="name another folder")
    with _raise_storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)


@contextmanager
def protect_inputs(inputs: Iterable[Path]) -> Iterator[None]:
    """:func:`atomic_file` refuses to replace any of the files ``inputs``, by whatever name or link."""
    token = _inputs.set(
        _inputs.get() | {identity for path in inputs if (identity := _device_and_inode(path)) is not None}
    )
    try:
        yield
    finally:
        _inputs.reset(token)


def refuse_protected_input(path: Path) -> None:
    """Raise :class:`InputError` where an output is one of the inputs, see :func:`protect_inputs`."""
    if _device_and_inode(path) in _inputs.get():
        raise errors.InputError(
            "is an input of this command",
            where=str(path),
            why="an input is never changed",
            fix="name another output",
        )


def _device_and_inode(path: Path) -> tuple[int, int] | str | None:
    """Device and inode, by which a file is the same whatever its name; the address of one in a store; None for what
    is no file."""
    if stores.is_remote(path):
        return stores.place_name(path)
    try:
        state = path.stat()
    except (OSError, ValueError):
        return None
    return (state.st_dev, state.st_ino) if stat.S_ISREG(state.st_mode) else None


@contextmanager
def _raise_storage_errors(path: Path) -> Iterator[None]:
    """What the system refuses, as a :class:`StorageError` about ``path``."""
    try:
        yield
    except errors.StorageError as error:
        raise error.at(stores.place_name(path)) from error
    except OSError as error:
        raise errors.storage_error(path, error) from error


@contextmanager
def _locked_temporary(path: Path, *, folder: bool) -> Iterator[Path]:
    """A new file or folder beside ``path``, locked, and removed at the end unless it was renamed.

    What killed processes have left of their writing to ``path`` is removed first.
    """
    beginning = hidden_file_name(path.name, "")
    with suppress(OSError), os.scandir(path.parent) as entries:
        names = [entry.name for entry in entries if entry.name.startswith(beginning)]
        for name in names:
            if len(name) == len(beginning) + len("0123456789abcdef.part"):
                _remove_leftover(path.with_name(name))
    partial, descriptor = _create_locked_temporary(path, folder=folder)
    try:
        yield partial
    finally:
        _remove_file_or_folder(partial)
        os.close(descriptor)


def _create_locked_temporary(path: Path, *, folder: bool) -> tuple[Path, int]:
    """A temporary file or folder and the descriptor that its lock hangs on."""
    while True:
        partial = path.with_name(hidden_file_name(path.name, f"{secrets.token_hex(8)}.part"))
        if folder:
            partial.mkdir()
        if folder and not hasattr(os, "O_DIRECTORY"):  # Windows opens no folder: nothing tells a leftover there
            return partial, os.open(os.devnull, os.O_RDONLY)
        flags = os.O_RDONLY | os.O_DIRECTORY if folder else os.O_RDWR | os.O_CREAT | os.O_EXCL
        descriptor = os.open(partial, flags | CLOSED_IN_CHILDREN, 0o666)
        with suppress(BlockingIOError):
            lock_descriptor(descriptor)
            if is_descriptor_of(descriptor, partial):
                return partial, descriptor
        os.close(descriptor)  # another process took it for a leftover before it was locked


def remove_leftovers_below(folder: Path) -> None:
    """Remove what killed processes have left anywhere below a folder, of whatever output."""
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            _remove_leftover(Path(place, name))


def _remove_leftover(path: Path) -> None:
    """Remove a temporary file or folder unless a living process writes it, or the file system cannot tell."""
    if not _TEMPORARY.fullmatch(path.name):
        return
    with suppress(OSError):
        flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | _WITHOUT_WAITING | CLOSED_IN_CHILDREN
        descriptor = os.open(path, flags)
        try:
            if lock_descriptor(descriptor):
                _remove_file_or_folder(path)
        finally:
            os.close(descriptor)


def _remove_file_or_folder(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def require_suffix(path: Path | str, *suffixes: str) -> str:
    """The lower-case suffix of ``path``, which has to be one of ``suffixes``.

    A name without suffix is accepted if there is only one format. Raises :class:`InputError` for another
    suffix: a file should hold what its name says.
    """
    path = Path(path)
    kind = path.suffix.lower() or (suffixes[0] if len(suffixes) == 1 else "")
    if kind not in suffixes:
        *leading, last = suffixes
        choices = f"{', '.join(leading)} or {last}" if leading else last
        raise errors.InputError(
            f"cannot write {path.suffix or 'a file without suffix'}", where=str(path), fix=f"name it {choices}"
        )
    return kind


def refuse_store(folder: Path | str) -> None:
    """Raise :class:`StorageError` for an output folder in an object store, where only some commands can write."""
    if stores.is_remote(folder):
        raise errors.StorageError(
            "cannot hold what this command writes", where=stores.place_name(folder),
            why="it is in an object store", fix="name a folder on this computer, and upload it",
        )  # fmt: skip


_locks: ContextVar[frozenset[Path]] = ContextVar("locks", default=frozenset())


@contextmanager
def lock_output_folder(folder: Path) -> Iterator[None]:
    """An output folder that no other command writes to; it is made, and removed if it is empty at the end.

    In an object store nothing is locked. Raises :class:`StorageError` where another command has it, naming its
    process, or the system refuses.
    """
    if stores.is_remote(folder):
        yield
        return
    if folder.is_file():
        raise errors.StorageError("is a file, not a folder", where=str(folder), fix="name another folder")
    with _hold_lock_file(folder / LOCK_NAME, folder, wait=False):
        yield


@contextmanager
def lock_output_file(path: Path) -> Iterator[None]:
    """As :func:`lock_output_folder`, for an output file and those that belong to it."""
    if stores.is_remote(path):
        yield
        return
    if path.is_dir():
        raise errors.storage_error(path, IsADirectoryError(EISDIR, os.strerror(EISDIR)))
    with _hold_lock_file(path.with_name(hidden_file_name(path.name, "lock")), path, wait=False):
        yield


@contextmanager
def lock_for_replacement(path: Path) -> Iterator[None]:
    """A file whose replacing no other process does at the same moment; it waits for its turn.

    It is independent of :func:`lock_output_file`, which a command holds for hours. Raises :class:`StorageError`.
    """
    with _hold_lock_file(path.with_name(hidden_file_name(path.name, "moment.lock")), path, wait=True):
        yield


def hidden_file_name(name: str, ending: str) -> str:
    """A hidden name beside ``name``; a long one is shortened, and stays different from all others.

    >>> hidden_file_name("trial.csv", "lock")
    '.trial.csv.lock'
    """
    encoded = os.fsencode(name)
    if len(encoded) > _LONGEST_NAME_BYTES:
        digest = blake2b(encoded, digest_size=8).hexdigest()
        name = encoded[: _LONGEST_NAME_BYTES - len(digest)].decode("utf-8", "ignore") + digest
    return f".{name}.{ending}"


def lock_descriptor(descriptor: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; False where the file system has no locks.

    Raises BlockingIOError where another process has it.
    """
    with suppress(ImportError):
        import fcntl

        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise
        except OSError:
            return False
        return True
    try:
        msvcrt: Any = import_module("msvcrt")  # Windows
    except ImportError:
        return False
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, _FAR_AWAY, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
    except OSError as error:
        raise BlockingIOError(error.errno, "another process has it") from error
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)
    return True


def is_descriptor_of(descriptor: int, path: Path) -> bool:
    """Whether an open file is still the one at ``path``."""
    with suppress(OSError):
        return os.path.samestat(os.fstat(descriptor), path.stat())
    return False


@contextmanager
def _hold_lock_file(path: Path, output: Path, *, wait: bool) -> Iterator[None]:
    """Hold the lock file ``path`` of an output; this command may ask for it again."""
    missing: list[Path] = []
    try:
        missing += [folder for folder in path.parents if not folder.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        path = path.parent.resolve() / path.name
        descriptor = None if path in _locks.get() else _acquire_lock_file(path, output, wait=wait)
    except OSError as error:
        _remove_empty_folders(missing)
        raise error if isinstance(error, errors.StorageError) else errors.storage_error(output, error) from error
    if descriptor is None:
        yield
        return
    token = _locks.set(_locks.get() | {path})
    try:
        yield
    finally:
        _locks.reset(token)
        if is_descriptor_of(descriptor, path):
            with suppress(OSError):
                path.unlink()  # before it is released, or it might be another's
        os.close(descriptor)
        _remove_empty_folders(missing)


def _acquire_lock_file(path: Path, output: Path, *, wait: bool) -> int:
    """The descriptor of a lock file, locked. Raises :class:`StorageError` where another command has it, OSError."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | CLOSED_IN_CHILDREN, 0o666)
        except PermissionError:  # left behind by another user's command; a lock does not need the right to write
            descriptor = os.open(path, os.O_RDONLY | CLOSED_IN_CHILDREN)
        try:
            lock_descriptor(descriptor, wait=wait)
            if is_descriptor_of(descriptor, path):  # not removed in between by the process that had it
                with suppress(OSError):  # of another user; a full disk is reported by the next writing
                    os.truncate(descriptor, 0)
                    os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
                return descriptor
        except BlockingIOError as error:
            owner = os.read(descriptor, 200).decode("utf-8", "replace")
            os.close(descriptor)
            raise errors.StorageError(
                "is being written by another command", where=str(output), why=owner or "its process is not stated",
                fix="wait until it ends, or name another output",
            ) from error  # fmt: skip
        os.close(descriptor)


def _remove_empty_folders(folders: list[Path]) -> None:
    """Remove folders, the innermost first, that nothing was written into."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


Model = TypeVar("Model")
_TYPE_ADAPTERS = dict[Any, Any]()
_TABLE = re.compile(r"^\s*\[(?P<array>\[)?\s*(?P<path>[^\[\]]+?)\s*\]")
_MOST_LEVELS = 16  # nested tables and lists; a configuration has at most six
_UNKNOWN_KEY = ("unexpected_keyword_argument", "extra_forbidden")
"""Reported first: a misspelt key is often the reason why another is missing."""
_NAMING = ("name", "kind", "side")  # what an entry of a list is called by
_ENDLESS_KEY = re.compile(r"(?:\.[^\n=,.]+){100}")
_KEY = re.compile(r"^\s*(?P<path>[\w.\-\"' ]+?)\s*=")


def read_text(path: Path | str) -> str:
    """The text of a configuration file. Raises :class:`ConfigurationError` if it cannot be read."""
    try:
        text = read_regular_file(path, process.CONFIGURATION_BYTES, errors.ConfigurationError).decode("utf-8")
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except errors.ConfigurationError:
        raise
    except FileNotFoundError as error:
        raise errors.ConfigurationError("does not exist", where=str(path), fix="check the path") from error
    except (OSError, ValueError) as error:
        why = "it is no text" if isinstance(error, UnicodeDecodeError) else str(error)
        why = error.strerror or why if isinstance(error, OSError) else why
        raise errors.ConfigurationError(
            "cannot be read", where=str(path), why=why, fix="give a TOML file"
        ) from error


def read_secret(variable: str, path: Path | None) -> str | None:
    """A password or token: of an environment variable, else the first line of a file; None without either.

    Raises :class:`ConfigurationError`, in which it does not stand.
    """
    if variable:
        secret = os.environ.get(variable)
        if secret is None:
            raise errors.ConfigurationError(f"the environment has no {variable}", fix=f"set {variable}")
        return secret
    if path is None:
        return None
    try:
        return next(iter(path.read_text(encoding="utf-8").splitlines()), "")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        raise errors.ConfigurationError(f"{path}: {reason}") from error


def load_toml(path: Path | str, model: type[Model]) -> Model:
    """Read ``path`` and validate it as ``model``, a pydantic dataclass or model.

    Raises :class:`ConfigurationError` whose text names file, line and key of the first complaint.
    """
    text = read_text(path)
    return validate_toml(parse_toml(text, path), text, path, model)


def parse_toml(text: str, path: Path | str) -> dict[str, Any]:
    """The tables of a TOML text that came from ``path``. Raises :class:`ConfigurationError`."""
    import tomllib

    invalid, where, fix = "is not valid TOML", str(path), "correct it there"
    if _ENDLESS_KEY.search(text):  # for which the library takes memory by the square
        raise errors.ConfigurationError(invalid, where=where, why="a key has more than 100 parts", fix=fix)
    try:
        tree = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a plain ValueError
        why = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise errors.ConfigurationError(invalid, where=where, why=why, fix=fix) from error
    level: list[Any] = [tree]
    for _ in range(_MOST_LEVELS):  # beyond which recursions would not end
        members = (value.values() if isinstance(value, dict) else value for value in level)
        level = [value for values in members for value in values if isinstance(value, dict | list)]
        if not level:
            return tree
    raise errors.ConfigurationError(f"has tables or lists in more than {_MOST_LEVELS} levels", where=where, fix=fix)


def type_adapter(kind: type[Model]) -> pydantic.TypeAdapter[Model]:
    """How values of a type are read and written: to build that takes far longer than to use it."""
    import pydantic

    if kind not in _TYPE_ADAPTERS:
        _TYPE_ADAPTERS[kind] = pydantic.TypeAdapter(kind)
    adapter: pydantic.TypeAdapter[Model] = _TYPE_ADAPTERS[kind]
    return adapter


def validate_toml(
    raw: dict[str, Any], text: str, path: Path | str, model: type[Model], context: dict[str, Any] | None = None
) -> Model:
    """Validate parsed TOML as ``model``; ``text`` is for counting lines, ``context`` for validators."""
    import pydantic

    try:
        return type_adapter(model).validate_python(raw, context=context)
    except pydantic.ValidationError as error:
        details = min(error.errors(), key=lambda details: details["type"] not in _UNKNOWN_KEY)
        kind, location = details["type"], details["loc"]
        keys: list[str | int] = []
        node: Any = raw
        for part in location:
            is_present = part < len(node) if isinstance(node, list) and isinstance(part, int) else False
            is_present = is_present or (isinstance(node, dict) and part in node)
            # what a table lacks on the way is the tag of a union, which does not occur in the file
            if is_present or not isinstance(node, dict) or part == location[-1]:
                keys.append(part)
            node = node[part] if is_present else node
        if kind.startswith("union_tag"):
            keys.append("type")
        hint, value = "", details.get("input")
        if kind in _UNKNOWN_KEY:
            problem, hint = "is not a known key here", _suggestion_for_unknown_key(str(keys[-1]), location, model)
        elif kind in ("missing", "missing_argument"):
            problem = "is missing"
        else:
            problem = str(details["msg"]).removeprefix("Value error, ")
            problem = f"{value!r}: {problem}" if isinstance(value, str | int | float) else problem
        further = f"{error.error_count() - 1} more after this one" if error.error_count() > 1 else ""
        raise errors.ConfigurationError(
            f"{toml_key_text(keys, raw) or 'file'}: {problem}",
            where=f"{path}, line {line_of_toml_key(text, keys)}",
            fix="; ".join(filter(None, [hint, further])),
        ) from error


def toml_key_text(keys: Sequence[str | int], raw: Any) -> str:
    """A key as people speak of it: entries of lists counted from 1, with the name or the kind that they state.

    >>> toml_key_text(["run", 1, "helm_deg"], {"run": [{}, {"kind": "zigzag", "side": "port"}]})
    'run 2 (zigzag, port): helm_deg'
    """
    text, node = "", raw
    for key in keys:
        is_present = key in node if isinstance(node, dict) else isinstance(node, list) and len(node) > int(key)
        node = node[key] if is_present else None
        if isinstance(key, int):
            values = [node.get(name) for name in _NAMING] if isinstance(node, dict) else []
            named = ", ".join(value for value in values if isinstance(value, str) and value)
            text += f" {key + 1} ({named}):" if named else f" {key + 1}:"
        else:
            text += f"{'' if not text else ' ' if text.endswith(':') else '.'}{key}"
    return text.removesuffix(":")


def _suggestion_for_unknown_key(key: str, location: Sequence[str | int], model: type[Model]) -> str:
    """What a user may have meant by an unknown key: one that its table has, or the table that it belongs to."""
    schema = type_adapter(model).json_schema()
    definitions = schema.get("$defs", {})
    tables = [schema]
    for part in location[:-1]:  # the tag of a union leads nowhere in the schema
        tables = [table for parent in tables for table in _child_schemas(parent, part, definitions)] or tables
    options = [option for table in tables for option in _alternative_schemas(table, definitions)]
    possible = {name for option in options for name in option.get("properties", {})}
    if matches := get_close_matches(key, possible - {key}, n=1):
        return f"did you mean {matches[0]}?"
    is_elsewhere = any(key in table.get("properties", {}) for table in (schema, *definitions.values()))
    return "it belongs to another table, or to another type of this one" if is_elsewhere else ""


def _alternative_schemas(node: dict[str, Any], definitions: dict[str, Any]) -> list[dict[str, Any]]:
    """The schemas that a node of a JSON schema refers to; several for a union."""
    if "$ref" in node:
        return _alternative_schemas(definitions[node["$ref"].rpartition("/")[2]], definitions)
    members = node.get("anyOf") or node.get("oneOf") or ()
    return [option for member in members for option in _alternative_schemas(member, definitions)] or [node]


def _child_schemas(
    node: dict[str, Any], location_part: str | int, definitions: dict[str, Any]
) -> list[dict[str, Any]]:
    """The nodes below one at a part of pydantic's location: a key, an index, or the tag of a union."""
    tags = node.get("discriminator", {}).get("mapping", {})
    if location_part in tags:
        return [{"$ref": tags[location_part]}]
    options = _alternative_schemas(node, definitions)
    if isinstance(location_part, int):
        return [option["items"] for option in options if isinstance(option.get("items"), dict)]
    entries = [
        option.get("properties", {}).get(location_part, option.get("additionalProperties")) for option in options
    ]
    return [entry for entry in entries if isinstance(entry, dict)]


def toml_value(value: Any) -> str:
    """A text, number, truth value, list or inline table as TOML has it: as JSON, but for the delete character and
    numbers that are not finite.

    >>> print(toml_value({"name": "Ålesund", "speeds": (5.5, 2)}))
    { name = "Ålesund", speeds = [5.5, 2] }
    """
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_value(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(float(value))
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def line_of_toml_key(text: str, keys: Sequence[str | int]) -> int:
    """The line (from 1) of the deepest part of ``keys`` that the text has; 1 if it has none.

    >>> line_of_toml_key("a = 1\\n[[source]]\\nname = 'x'\\n[[source]]\\nname = 'y'", ["source", 1, "name"])
    5
    """
    lines: dict[tuple[str | int, ...], int] = {}
    counts: dict[tuple[str, ...], int] = {}  # of the elements of arrays of tables
    prefix: tuple[str | int, ...] = ()
    for number, line in enumerate(text.splitlines(), start=1):
        match = _TABLE.match(line) or _KEY.match(line)
        if match is None:
            continue
        parts = tuple(part.strip().strip("\"'") for part in match["path"].split("."))
        if match.re is _KEY:
            lines.setdefault((*prefix, *parts), number)
            continue
        if match["array"]:
            counts = {path: count for path, count in counts.items() if path[: len(parts)] != parts} | {
                parts: counts.get(parts, -1) + 1  # nested arrays count from 0 again in each element
            }
        prefix = ()
        for depth, part in enumerate(parts, start=1):
            count = counts.get(parts[:depth])
            prefix += (part,) if count is None else (part, count)
        lines.setdefault(prefix, number)
        if match["array"]:
            lines.setdefault(prefix[:-1], number)
    return next((lines[path] for depth in range(len(keys), 0, -1) if (path := tuple(keys[:depth])) in lines), 1)
