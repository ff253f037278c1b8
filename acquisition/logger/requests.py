"""What a recorder answers to other programs of this computer: marks, who it is, predictions of the ship.

They reach it through a socket that lies in a folder that only its owner can open; nothing listens on a network. One
thread hears all clients at once, so that one that stalls in the middle of a word holds up nobody else.

A client says one JSON object: ``{"text", "monotonic_ns"}`` is a mark, ``{"ask": "recording"}`` asks which file is
being written and of which trial, ``{"prediction", "geojson"}`` goes into the recording. The answer is ``ok``, a
JSON object, or ``refused:`` and why; rubbish gets none.
"""

from __future__ import annotations

import json
import os
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import orjson

from seatrial.acquisition.core.errors import SourceError, StorageError
from seatrial.acquisition.logger.predictions import Predictions

MOST_BYTES = 65_536
"""A client that says more than this is not heard to its end."""
PATIENCE_S = 3.0
"""How long a client may take to say what it wants, and how long it waits for an answer."""
_SHORT_PATIENCE_S = 1.0  # of who asks again and again
_MOST_CLIENTS = 16  # at once; one more, and whoever has kept us waiting longest must go
_LOOK_S = 0.2

_MOST_LETTERS = 500
_MOST_APART_NS = 60_000_000_000  # a moment further off cannot be true: now is taken
Mark = Callable[[str, int], None]
"""What takes a mark: its text, and when it was set on the monotonic clock [ns]."""
_QUESTION = orjson.dumps({"ask": "recording"})
_REFUSED = b"refused: "


def runtime_folder() -> Path:
    """Where recorders leave their sockets: SEATRIAL_RUNTIME, else the user's runtime folder, else one in /tmp."""
    if folder := os.environ.get("SEATRIAL_RUNTIME"):
        return Path(folder)
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "seatrial"
    return Path(f"/tmp/seatrial-{os.getuid()}")


@dataclass(frozen=True, slots=True)
class RecorderState:
    """A recorder at work: the trial's name, its configuration's path, the part that it writes, and its process.

    ``paused`` says that nothing is written at the moment; ``predictions`` and ``predictions_refused`` count.
    """

    trial: str
    configuration: str
    recording: str
    paused: bool
    process: int
    predictions: int
    predictions_refused: int


Who = Callable[[], RecorderState]


@dataclass(slots=True)
class _Client:
    """Somebody who is still speaking: what was said so far, and until when it must be over."""

    socket: socket.socket
    until_s: float
    received: bytearray = field(default_factory=bytearray)


class RequestServer:
    """Hears what others say to a recorder while it is entered; a context manager.

    Raises :class:`StorageError` when the socket's folder cannot be had or belongs to somebody else.
    """

    def __init__(self, mark: Mark, who: Who, predictions: Predictions, folder: Path | None = None) -> None:
        self._mark, self._who, self._predictions = mark, who, predictions
        self.path = (folder or runtime_folder()) / f"{os.getpid()}-{time.monotonic_ns():x}.sock"
        self._stopping = threading.Event()
        self._clients: list[_Client] = []  # in the order in which they came

    def __enter__(self) -> RequestServer:
        folder = self.path.parent
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if {folder.lstat().st_uid, folder.stat().st_uid} != {os.getuid()}:  # a link has an owner, too
                raise PermissionError(f"{folder} belongs to another user")
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            unheard = self.path.with_suffix(".new")  # one that does not listen yet is taken for one left behind
            self._socket.bind(str(unheard))
            unheard.chmod(0o600)  # before it listens, and whatever the folder allows
            self._socket.listen()
            unheard.rename(self.path)
        except OSError as error:
            raise StorageError(
                "cannot receive marks", where=str(folder), why=str(error), fix="set SEATRIAL_RUNTIME to a folder"
            ) from error
        self._socket.setblocking(False)
        self._thread = threading.Thread(target=self._serve, name="marks", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # which wakes the thread
        self._thread.join()
        self._socket.close()
        with suppress(OSError):
            self.path.unlink()

    def answer(self, received: bytes) -> bytes:
        """The answer to what a client said. Raises any error that rubbish can cause."""
        message = json.loads(received)  # which reads what some programs write and orjson does not
        if "ask" in message:
            return orjson.dumps(asdict(self._who()))
        if "prediction" in message:
            refused = self._predictions.offer(message)
            return _REFUSED + refused.encode() if refused else b"ok"
        text, at_ns, now_ns = message["text"], message["monotonic_ns"], time.monotonic_ns()
        if not isinstance(text, str) or type(at_ns) is not int:
            raise TypeError("no mark")
        self._mark(_writable(text), at_ns if abs(at_ns - now_ns) <= _MOST_APART_NS else now_ns)
        return b"ok"

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            while not self._stopping.is_set():
                for key, _ in selector.select(_LOOK_S):
                    if key.data is None:
                        self._welcome(selector)
                    elif key.data in self._clients:  # it may have had to go a moment ago
                        self._hear(key.data, selector)
                self._let_go(selector)
            for client in tuple(self._clients):
                self._part_with(client, selector)

    def _welcome(self, selector: selectors.BaseSelector) -> None:
        try:
            connection, _ = self._socket.accept()
        except OSError:
            self._stopping.wait(_LOOK_S)  # without a descriptor it would be tried without end
            return
        with suppress(OSError):
            connection.setblocking(False)
            client = _Client(connection, time.monotonic() + PATIENCE_S)
            self._clients.append(client)
            selector.register(connection, selectors.EVENT_READ, client)

    def _hear(self, client: _Client, selector: selectors.BaseSelector) -> None:
        """Take in what a client says, and answer once it has said all."""
        try:
            more = client.socket.recv(MOST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            self._part_with(client, selector)
            return
        client.received += more
        if not more:
            # whoever sends rubbish gets no answer; what is nested too deeply is a RecursionError
            with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
                client.socket.send(self.answer(bytes(client.received)))  # short: it fits into the socket
        if not more or len(client.received) > MOST_BYTES:
            self._part_with(client, selector)

    def _let_go(self, selector: selectors.BaseSelector) -> None:
        """Part with those that took too long, and with the first of too many."""
        now_s = time.monotonic()
        late = [client for client in self._clients if now_s >= client.until_s]
        for client in late or self._clients[:-_MOST_CLIENTS]:
            self._part_with(client, selector)

    def _part_with(self, client: _Client, selector: selectors.BaseSelector) -> None:
        self._clients.remove(client)
        selector.unregister(client.socket)
        client.socket.close()


def servers(folder: Path | None = None) -> list[Path]:
    """The sockets that lie in a folder; some may have been left behind by a recorder that was killed."""
    return sorted((folder or runtime_folder()).glob("*.sock"))


def ask(path: Path, message: bytes, patience_s: float = PATIENCE_S) -> bytes | None:
    """What the server at ``path`` answers; None if nobody does. A socket that nobody listens to is removed.

    Another user's server is told nothing: where anyone can write, it may stand in for a recorder.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(patience_s)
        try:
            client.connect(str(path))
            if _user_of_server(client) not in (os.getuid(), 0):
                return None
            client.sendall(message)
            client.shutdown(socket.SHUT_WR)
            return client.recv(MOST_BYTES) or None
        except ConnectionRefusedError:  # left behind by a recorder that was killed
            with suppress(OSError):
                if path.is_socket():
                    path.unlink()
        except OSError:
            pass
    return None


def _user_of_server(client: socket.socket) -> int:
    """The user whose program listens at the other end; ourselves where the system does not tell."""
    if not hasattr(socket, "SO_PEERCRED"):
        return os.getuid()
    credentials = struct.Struct("3i")  # process, user, group
    user: int = credentials.unpack(client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, credentials.size))[1]
    return user


def _writable(text: str) -> str:
    """As much of a text as a mark holds; halves of letters, which no file takes, become question marks."""
    return text[:_MOST_LETTERS].encode(errors="replace").decode()


def send_mark(text: str, folder: Path | None = None) -> int:
    """Set a mark in every recording that runs here, and return how many heard it.

    Raises :class:`SourceError` when none does.
    """
    mark = {"text": _writable(text), "monotonic_ns": time.monotonic_ns()}
    message = json.dumps(mark, ensure_ascii=False).encode()
    marked = sum(ask(path, message) == b"ok" for path in servers(folder))
    if not marked:
        fix = "start `seatrial record`, or set SEATRIAL_RUNTIME to the folder that it uses"
        raise SourceError("no recorder is running", where=str(folder or runtime_folder()), fix=fix)
    return marked


def running_recorders(folder: Path | None = None) -> list[tuple[Path, RecorderState]]:
    """The recorders that run here, each with its socket; those that do not answer in time are left out."""
    recorders = []
    for path in servers(folder):
        with suppress(ValueError, TypeError):  # of another version, or none
            answer = ask(path, _QUESTION, _SHORT_PATIENCE_S)
            recorders.append((path, RecorderState(**orjson.loads(answer or b""))))
    return recorders


def send_prediction(path: Path, body: Mapping[str, Any], geojson: str = "") -> str:
    """Give a prediction to the recorder at a socket. Returns why it did not take it, or nothing."""
    message = orjson.dumps({"prediction": dict(body), "geojson": geojson}, option=orjson.OPT_SERIALIZE_NUMPY)
    answer = ask(path, message, _SHORT_PATIENCE_S)
    if answer is None:
        return "the recorder does not answer"
    return "" if answer == b"ok" else answer.removeprefix(_REFUSED).decode(errors="replace")
