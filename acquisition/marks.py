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

_MOST_BYTES = 4096
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
            with suppress(OSError, ValueError, KeyError, TypeError):  # whoever sends rubbish gets no answer
                client, _ = self._socket.accept()
                with client:
                    client.settimeout(_ANSWER_S)
                    said = json.loads(client.recv(_MOST_BYTES))
                    self._mark(str(said["text"])[:500], int(said["monotonic_ns"]))
                    client.sendall(b"ok")


def send_mark(text: str, folder: Path | None = None) -> int:
    """Set a mark in every recording that runs here, and return how many heard it.

    Raises :class:`SourceError` when none does.
    """
    message = json.dumps({"text": text[:500], "monotonic_ns": time.monotonic_ns()}).encode()
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
            return client.recv(16) == b"ok"
        except ConnectionRefusedError:  # left behind by a recorder that was killed
            with suppress(OSError):
                path.unlink()
        except OSError:
            pass
    return False
