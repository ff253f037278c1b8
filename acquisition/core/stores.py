"""Files in object stores (``s3://bucket/trial.mcap``): read by ranges or copied, results put in place complete.

Without it recordings in a bucket have to be copied by hand. pathlib makes one slash of two, so that ``s3:/bucket``
is the same place; a local folder that is really called ``s3:`` stays one. The library (fsspec, and the package of
the store) is imported when the first such path is met.

What may pass is tried again: :data:`ATTEMPTS` times, with growing pauses, for each range of
:data:`BLOCK_BYTES`. What the store refuses, or does not have, is an error at once.
"""

from __future__ import annotations

import atexit
import io
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, TypeVar
from urllib.parse import unquote, urlsplit

from seatrial.acquisition.core import errors

ATTEMPTS = 5
"""How often a request is made before it is given up."""
BLOCK_BYTES = 16 * 1024 * 1024
"""How much of a file is copied by one request."""
_FIRST_PAUSE_S = 0.25
_PACKAGES = {
    "s3": ("s3fs", "seatrial[s3]"), "gs": ("gcsfs", "gcsfs"),
    "az": ("adlfs", "adlfs"), "abfs": ("adlfs", "adlfs"), "abfss": ("adlfs", "adlfs"),
    "http": ("aiohttp", "seatrial[s3]"), "https": ("aiohttp", "seatrial[s3]"),
}  # fmt: skip
"""The package that each kind of store needs, and what installs it."""
_URL = re.compile(rf"({'|'.join(_PACKAGES)}):/{{1,2}}(?=[^/])(.*)", re.DOTALL)
_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/")  # of one letter is a drive
_WEB = ("http", "https")
_NO_CREDENTIALS = (
    "NoCredentialsError",
    "PartialCredentialsError",
    "DefaultCredentialsError",
    "CredentialRetrievalError",
)
_AZURE_FIX = "set AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY, or AZURE_STORAGE_CONNECTION_STRING"
_CREDENTIALS_FIX = {
    "s3": "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE; or what your store uses",
    "gs": "set GOOGLE_APPLICATION_CREDENTIALS to the file of a key",
    **dict.fromkeys(("az", "abfs", "abfss"), _AZURE_FIX),
}  # fmt: skip
_STATE_KEYS = ("ETag", "etag", "md5Hash", "content_md5", "generation", "LastModified", "last_modified", "mtime")
Result = TypeVar("Result")
PathLike = str | os.PathLike[str]


def unknown_place_fix(path: PathLike) -> str:
    """What to do where a path that does not exist is an address of a kind that is not read here.

    >>> unknown_place_fix("trial.mcap")
    'check the path'
    """
    if not _ADDRESS.match(os.fspath(path)):
        return "check the path"
    return f"copy it to this computer; of addresses {', '.join(f'{scheme}://' for scheme in _PACKAGES)} are read"


def is_remote(path: PathLike) -> bool:
    """Whether a path is one in an object store or on the web, rather than of this computer.

    >>> is_remote("s3://bucket/trial.mcap"), is_remote(Path("s3://bucket/trial.mcap")), is_remote("s3/trial.mcap")
    (True, True, False)
    """
    match = _URL.match(os.fspath(path))
    return match is not None and not os.path.isdir(f"{match[1]}:")  # noqa: PTH112 - a Path would cost imports


def place_name(path: PathLike) -> str:
    """A path as a user writes it, with both slashes of an address.

    >>> place_name(Path("s3://bucket/trial.mcap")), place_name(Path("data/trial.mcap"))
    ('s3://bucket/trial.mcap', 'data/trial.mcap')
    """
    text = os.fspath(path)
    match = _URL.match(text) if is_remote(path) else None
    return f"{match[1]}://{match[2]}" if match else text


class RemoteFile(io.RawIOBase):
    """A file in a store, read by ranges: each ``read`` is one request for just these bytes.

    ``size_bytes`` is its size, ``fetched_bytes`` counts what has come, ``identity`` differs where the file does, as
    far as the store tells. Raises :class:`InputError` where there is no
    such file or it cannot be read.
    """

    def __init__(self, path: PathLike) -> None:
        super().__init__()
        self.name = place_name(path)
        self._system, self._key = _file_system(self.name)
        self.fetched_bytes, self._offset = 0, 0
        state = self._state()
        if state.get("type") == "directory":
            raise errors.InputError("is a folder, not a file", where=self.name, fix="name a file in it")
        if state.get("size") is None:
            raise errors.InputError("does not state its size", where=self.name, fix="download it by other means")
        self.size_bytes, self.identity = int(state["size"]), (self.name, *_identity_of_state(state))

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._offset, os.SEEK_END: self.size_bytes}[whence]
        self._offset = max(base + offset, 0)
        return self._offset

    def tell(self) -> int:
        return self._offset

    def read(self, size: int | None = -1) -> bytes:
        """As many bytes as are asked for, fewer only at the end of the file."""
        remaining = max(self.size_bytes - self._offset, 0)
        size = remaining if size is None or size < 0 else min(size, remaining)
        if size == 0:
            return b""
        start, end = self._offset, self._offset + size

        def fetch() -> bytes:
            data: bytes = self._system.cat_file(self._key, start=start, end=end)
            if len(data) > size:
                raise errors.InputError("is not given in ranges by its server", where=self.name, fix="download it")
            if len(data) < size:
                raise ConnectionError(f"{len(data):,} of {size:,} bytes came")
            return data

        data = _attempt(fetch, self.name, errors.InputError)
        self.fetched_bytes += size
        self._offset = end
        return data

    def require_unchanged(self) -> None:
        """Raise :class:`InputError` if the file has been replaced since it was opened."""
        if (self.name, *_identity_of_state(self._state())) != self.identity:
            raise errors.InputError(
                "changed while it was read", where=self.name, fix="try again when it is complete"
            )

    def _state(self) -> dict[str, Any]:
        return _attempt(lambda: dict(self._system.info(self._key)), self.name, errors.InputError)


def _identity_of_state(state: dict[str, Any]) -> tuple[str, ...]:
    return (str(state.get("size")), *(str(state[key]) for key in _STATE_KEYS if key in state))


@contextmanager
def local_copies(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """The paths, those in stores as copies in a temporary folder, which is removed at the end.

    Raises :class:`InputError` for what cannot be fetched, :class:`StorageError` where there is no room for it.
    """
    if not any(map(is_remote, paths)):
        yield list(paths)
        return
    with TemporaryDirectory(prefix="seatrial-") as folder:
        yield fetch_files(paths, Path(folder))


def lasting_copies(paths: Sequence[Path]) -> list[Path]:
    """As :func:`local_copies`, with copies that stay until the process ends, and a bar of progress.

    What was fetched before and has not changed since is not fetched again.
    """
    if not any(map(is_remote, paths)):
        return list(paths)
    with errors.progress_bar("fetching") as progress:
        return fetch_files(paths, _lasting_folder(), progress, _lasting)


_lasting: dict[tuple[str, ...], Path] = {}
"""The copies that stay until the process ends, by the identity of their files."""


@cache
def _lasting_folder() -> Path:
    folder = Path(mkdtemp(prefix="seatrial-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def fetch_files(
    paths: Sequence[Path],
    folder: Path,
    progress: errors.Progress = lambda share: None,
    fetched: dict[tuple[str, ...], Path] | None = None,
) -> list[Path]:
    """The paths, with copies below a folder of those in stores; of one place in one folder, under their names.

    ``fetched`` are copies that are there already, by the identity of their files. Raises as :func:`local_copies`.
    """
    fetched = {} if fetched is None else fetched
    sources = {path: RemoteFile(path) for path in paths if is_remote(path)}
    missing = {path: source for path, source in sources.items() if source.identity not in fetched}
    total, done = sum(source.size_bytes for source in missing.values()), 0
    if total > (free := shutil.disk_usage(folder).free):
        raise errors.StorageError(
            "has no room for a copy of what is to be fetched", where=str(folder),
            why=f"{total:,} bytes, {free:,} are free", fix="make room, or name another folder by TMPDIR",
        )  # fmt: skip
    for source in missing.values():
        parent, _, name = source.name.rpartition("/")
        if source.name.startswith(_WEB):  # on the web a query may stand behind it
            name = unquote(urlsplit(source.name).path).rpartition("/")[2] or name
        copy = folder / sha256(parent.encode()).hexdigest()[:16] / name
        copy.parent.mkdir(exist_ok=True)
        with copy.open("wb") as stream:
            while block := source.read(BLOCK_BYTES):
                stream.write(block)
                done += len(block)
                progress(done / total)
        source.require_unchanged()
        fetched[source.identity] = copy
    return [fetched[sources[path].identity] if path in sources else path for path in paths]


def files_below(folder: PathLike, suffix: str = "") -> list[Path]:
    """The files below a place in a store that end in ``suffix``, in the order of their names; as below."""
    return list(sizes_below(folder, suffix))


def sizes_below(folder: PathLike, suffix: str = "") -> dict[Path, int]:
    """The sizes [bytes] of the files below a place in a store that end in ``suffix``, in the order of their names.

    Raises :class:`InputError` for a place that is not there, and for the web, which has no folders.
    """
    name = place_name(folder).rstrip("/")
    if name.startswith(_WEB):
        raise errors.InputError(
            "cannot be listed", where=name, why="the web has no folders", fix="name files, or a bucket by s3://"
        )
    system, key = _file_system(name)
    listed: dict[str, Any] = _attempt(lambda: dict(system.find(key, detail=True)), name, errors.InputError)
    scheme = name.partition("://")[0]
    return {
        Path(f"{scheme}://{file}"): int(about.get("size") or 0)
        for file, about in sorted(listed.items())
        if file.endswith(suffix)
    }


def exists(path: PathLike) -> bool:
    """Whether there is a file at a place in a store. Raises :class:`InputError` where that cannot be said."""
    name = place_name(path)
    system, key = _file_system(name)

    def ask() -> bool:
        try:
            return bool(system.info(key)["type"] == "file")
        except FileNotFoundError:
            return False

    return _attempt(ask, name, errors.InputError)


def upload(source: Path, path: PathLike) -> None:
    """Put a file into a store: there it appears complete or not at all.

    Raises :class:`StorageError`.
    """
    name = place_name(path)
    if name.startswith(_WEB):
        raise errors.StorageError("cannot be written", where=name, why="the web is read only", fix="name a bucket")
    system, key = _file_system(name)
    _attempt(lambda: system.put_file(str(source), key), name, errors.StorageError)


def remove(path: PathLike) -> None:
    """Remove a file from a store if it is there. Raises :class:`StorageError`."""
    name = place_name(path)
    system, key = _file_system(name)

    def delete() -> None:
        with suppress(FileNotFoundError):
            system.rm_file(key)

    _attempt(delete, name, errors.StorageError)


def _file_system(url: str) -> tuple[Any, str]:
    """The file system of an address, and the name of the file in it. Raises :class:`ConfigurationError`."""
    scheme = url.partition(":")[0]
    module, package = _PACKAGES[scheme]
    try:
        import_module(module)
        system = import_module("fsspec").filesystem(scheme, use_listings_cache=False)
    except ImportError as error:
        raise errors.ConfigurationError(
            f"needs the package {module}", where=url, fix=f"pip install '{package}'"
        ) from error
    except Exception as error:  # of whatever kind each package has: no credentials, no account named
        raise _store_error(error, url, errors.InputError) from error
    return system, url if scheme in _WEB else url.partition("://")[2]


def _attempt(action: Callable[[], Result], url: str, kind: type[errors.SeatrialError]) -> Result:
    """What a request gives, made again after what may pass. Raises ``kind``."""
    for number in range(1, ATTEMPTS + 1):
        try:
            return action()
        except errors.SeatrialError:
            raise
        except Exception as answer:  # the libraries of the stores have no base of their own
            error, cause = answer, answer.__cause__
            is_of_web = type(cause).__module__.partition(".")[0] in ("aiohttp", "asyncio")
            if is_of_web and isinstance(answer, FileNotFoundError) and isinstance(cause, Exception):
                error = cause  # any failure to ask the web for a file is raised as that it does not exist
            if number == ATTEMPTS or _is_final(error):
                raise _store_error(error, url, kind) from error
            time.sleep(_FIRST_PAUSE_S * 2 ** (number - 1))
    raise AssertionError


def _is_final(error: Exception) -> bool:
    """Whether a request would fail again: for what is not there, is not allowed, or has no credentials."""
    status = getattr(error, "status", 0)  # of the web
    is_refused = isinstance(status, int) and 400 <= status < 500 and status not in (408, 429)
    return (
        isinstance(error, FileNotFoundError | PermissionError | NotImplementedError)
        or is_refused
        or (type(error).__name__ in _NO_CREDENTIALS)
    )


def _store_error(error: Exception, url: str, kind: type[errors.SeatrialError]) -> errors.SeatrialError:
    """The one line for what a store answers."""
    why, status = " ".join(str(error).split())[:200] or type(error).__name__, getattr(error, "status", 0)
    if type(error).__name__ in _NO_CREDENTIALS:
        fix = _CREDENTIALS_FIX.get(url.partition(":")[0], "")
        return kind("needs credentials for its store", where=url, why="none were found", fix=fix)
    if type(error).__name__ == "TooManyRedirects":
        why = "its server sends from one address to another without end"
    if isinstance(error, FileNotFoundError) and "bucket" in why.lower():
        return kind("is in no such bucket", where=url, fix="check the name of the bucket")
    if isinstance(error, FileNotFoundError) or status == 404:
        return kind("does not exist", where=url, fix="check the bucket and the name")
    if isinstance(error, PermissionError) or status in (401, 403):
        return kind("is refused by its store", where=url, why=why, fix="check the credentials and their rights")
    verb = "written" if kind is errors.StorageError else "read"
    return kind(f"cannot be {verb}", where=url, why=why, fix="check the network, and try again")
