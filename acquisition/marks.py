"""Event marks from another terminal: ``seatrial mark TEXT`` reaches the recorder through a socket.

It is no network socket: it lies in a folder that only its owner can open; nothing listens on a network.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from acquisition.errors import SourceError, StorageError

_MOST_BYTES = 65_536
_MOST_LETTERS = 500
_MOST_APART_NS = 60_000_000_000
_ANSWER_S = 3.0

Mark = Callable[[str, int], None]
"""What takes a mark: its text, and when it was set on the monotonic clock [ns]."""


def runtime_folder() -> Path:
    """Where recorders leave their sockets: SEATRIAL_RUNTIME, else the user's runtime folder, else one in /tmp."""
    if given := os.environ.get("SEATRIAL_RUNTIME"):
        return Path(given)
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "seatrial"
    return Path(f"/tmp/seatrial-{os.getuid()}")


class MarkServer:
    """Hears marks while a recording runs; a context manager.

    Raises :class:`StorageError` when the socket's folder cannot be had or belongs to somebody else.
    """

    def __init__(self, mark: Mark, folder: Path | None = None) -> None:
        self._mark = mark
        self.path = (folder or runtime_folder()) / f"{os.getpid()}-{time.monotonic_ns():x}.sock"
        self._stopping = threading.Event()

    def __enter__(self) -> MarkServer:
        folder = self.path.parent
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if folder.stat().st_uid != os.getuid():
                raise PermissionError(f"{folder} belongs to another user")
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._socket.bind(str(self.path))
        except OSError as error:
            raise StorageError(
                "marks cannot be heard", where=str(folder), why=str(error), fix="set SEATRIAL_RUNTIME to a folder"
            ) from error
        self._socket.listen()
        self._socket.settimeout(0.2)
        self._thread = threading.Thread(target=self._serve, name="marks", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self._socket.close()
        with suppress(OSError):
            self.path.unlink()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            # whoever sends rubbish gets no answer; what is nested too deeply is a RecursionError
            with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
                client, _ = self._socket.accept()
                with client:
                    self._mark(*_understood(_read_all(client)))
                    client.settimeout(_ANSWER_S)
                    client.sendall(b"ok")


def _read_all(client: socket.socket) -> bytes:
    """What a client says until it has said all; whoever takes too long is a TimeoutError."""
    until_s, said = time.monotonic() + _ANSWER_S, b""
    while len(said) <= _MOST_BYTES:
        left_s = until_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError("too slow")
        client.settimeout(left_s)
        more = client.recv(_MOST_BYTES)
        if not more:
            return said
        said += more
    raise ValueError("too long")


def _understood(said: bytes) -> tuple[str, int]:
    """A mark's text and moment; one that cannot be true is replaced by now. Raises for what is no mark."""
    message = json.loads(said)
    text, at_ns, now_ns = message["text"], message["monotonic_ns"], time.monotonic_ns()
    if not isinstance(text, str) or type(at_ns) is not int:
        raise TypeError("no mark")
    return _writable(text), at_ns if abs(at_ns - now_ns) <= _MOST_APART_NS else now_ns


def _writable(text: str) -> str:
    """As much of a text as a mark holds; halves of letters, which no file takes, become question marks."""
    return text[:_MOST_LETTERS].encode(errors="replace").decode()


def send_mark(text: str, folder: Path | None = None) -> int:
    """Set a mark in every recording that runs here, and return how many heard it.

    Raises :class:`SourceError` when none does.
    """
    mark = {"text": _writable(text), "monotonic_ns": time.monotonic_ns()}
    message = json.dumps(mark, ensure_ascii=False).encode()
    folder = folder or runtime_folder()
    heard = sum(_send(path, message) for path in sorted(folder.glob("*.sock")))
    if not heard:
        raise SourceError(
            "no recorder is running that could take the mark",
            where=str(folder),
            fix="start `seatrial record`, or set SEATRIAL_RUNTIME to the folder that it uses",
        )
    return heard


def _send(path: Path, message: bytes) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(_ANSWER_S)
        try:
            client.connect(str(path))
            client.sendall(message)
            client.shutdown(socket.SHUT_WR)
            return client.recv(16) == b"ok"
        except ConnectionRefusedError:  # left behind by a recorder that was killed
            with suppress(OSError):
                path.unlink()
        except OSError:
            pass
    return False
