"""Serves other programs: marks, state and predictions over a local socket, and the front of web pages and viewers.

The socket lies in a folder that only its owner can open; nothing listens on a network. One thread serves all
clients at once, so that one that stalls in the middle of a word blocks no other. A client sends one JSON object:
``{"text", "monotonic_ns"}`` is a mark, ``{"ask": "recording"}`` asks which file is being written and of which
trial, ``{"prediction", "geojson"}`` goes into the recording. The answer is ``ok``, a JSON object, or ``refused:``
and why; malformed requests get none. :class:`Follower` follows what a recorder writes from outside: through all
parts, and from one recording to the next.

:class:`WebFront` admits few web clients at once, briefly, and only those entitled. A page from anywhere can make a
browser aboard send requests here, and a name elsewhere can be made to point here. Both are recognised: by the name
that is requested (``Host``), and by where the request comes from (``Origin``). A client that sends nothing, little,
or too much costs no other client the page, and never the recorder.
"""

from __future__ import annotations

import json
import os
import re
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import orjson

from seatrial.acquisition.core import errors, quantities
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.health import LOG, Predictions
from seatrial.acquisition.recording import parts, reader

MOST_BYTES = 65_536
"""A client that sends more than this is cut off."""
PATIENCE_S = 3.0
"""How long a client may take to send its request, and to take in the answer."""
_SHORT_PATIENCE_S = 1.0  # of a client that asks again and again
_MOST_CLIENTS = 16  # at once; of more, the one that has waited longest is disconnected
_LOOK_S = 0.2

_MOST_LETTERS = 500
_LARGEST_OFFSET_NS = 60_000_000_000  # a time further from now cannot be right: now is taken
Mark = Callable[[str, int], None]
"""What takes a mark: its text, and when it was set on the monotonic clock [ns]."""
_QUESTION = orjson.dumps({"ask": "recording"})
_REFUSED = b"refused: "

_QUIET_S = 1.0  # after so long without anything new the recorder is asked what it writes
_ASK_PERIOD_S, _ASK_SOON_S = 1.0, 0.1  # the latter where a part has just come to its end

MOST_CLIENTS = 16
"""So many may be asking at once, and as many be served; browsers open six to one address."""
LOOPBACK = "127.0.0.1"
_MOST_HEAD_BYTES = 16_384  # what Apache and nginx take at least; a browser with many cookies sends half of it
_MOST_REASONS = 20
_LONGEST_ORIGIN = 100  # in a log line
_RETRY_S = 0.2
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::\d{1,5})?", re.IGNORECASE)
_LINE = re.compile(r"([!#$%&'*+.^_`|~0-9A-Za-z-]+):[ \t]*([^\x00-\x08\x0a-\x1f\x7f]*?)[ \t]*")
_SINGLE = ("host", "origin")


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


StateReader = Callable[[], RecorderState]


@dataclass(slots=True)
class _Client:
    """A client that is still sending: what it has sent so far, and until when it must be complete."""

    socket: socket.socket
    until_s: float
    received: bytearray = field(default_factory=bytearray)


class RequestServer:
    """Answers other programs' requests to a recorder while it is entered; a context manager.

    Raises :class:`StorageError` when the socket's folder cannot be made or belongs to another user.
    """

    def __init__(
        self, mark: Mark, read_state: StateReader, predictions: Predictions, folder: Path | None = None
    ) -> None:
        self._mark, self._read_state, self._predictions = mark, read_state, predictions
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
            unready = self.path.with_suffix(".new")  # one that does not listen yet would be taken for stale
            self._socket.bind(str(unready))
            unready.chmod(0o600)  # before it listens, and whatever the folder allows
            self._socket.listen()
            unready.rename(self.path)
        except OSError as error:
            raise errors.StorageError(
                "cannot receive marks", where=str(folder), why=str(error), fix="set SEATRIAL_RUNTIME to a folder"
            ) from error
        self._socket.setblocking(False)
        self._thread = threading.Thread(target=self._serve_requests, name="marks", daemon=True)
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
        """The answer to a client's request. Raises any error that malformed input can cause."""
        message = json.loads(received)  # which reads what some programs write and orjson does not
        if "ask" in message:
            return orjson.dumps(asdict(self._read_state()))
        if "prediction" in message:
            refused = self._predictions.offer(message)
            return _REFUSED + refused.encode() if refused else b"ok"
        text, at_ns, now_ns = message["text"], message["monotonic_ns"], time.monotonic_ns()
        if not isinstance(text, str) or type(at_ns) is not int:
            raise TypeError("no mark")
        self._mark(_shorten_mark_text(text), at_ns if abs(at_ns - now_ns) <= _LARGEST_OFFSET_NS else now_ns)
        return b"ok"

    def _serve_requests(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            while not self._stopping.is_set():
                for key, _ in selector.select(_LOOK_S):
                    if key.data is None:
                        self._accept(selector)
                    elif key.data in self._clients:  # it may have been disconnected a moment ago
                        self._receive(key.data, selector)
                now_s = time.monotonic()
                expired = [client for client in self._clients if now_s >= client.until_s]
                for client in expired or self._clients[:-_MOST_CLIENTS]:
                    self._disconnect(client, selector)
            for client in tuple(self._clients):
                self._disconnect(client, selector)

    def _accept(self, selector: selectors.BaseSelector) -> None:
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

    def _receive(self, client: _Client, selector: selectors.BaseSelector) -> None:
        """Take in what a client sends, and answer once it is complete."""
        try:
            data = client.socket.recv(MOST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            self._disconnect(client, selector)
            return
        client.received += data
        if not data:
            # malformed requests get no answer; what is nested too deeply is a RecursionError
            with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
                client.socket.send(self.answer(bytes(client.received)))  # short: it fits into the socket
        if not data or len(client.received) > MOST_BYTES:
            self._disconnect(client, selector)

    def _disconnect(self, client: _Client, selector: selectors.BaseSelector) -> None:
        self._clients.remove(client)
        selector.unregister(client.socket)
        client.socket.close()


def server_sockets(folder: Path | None = None) -> list[Path]:
    """The sockets that lie in a folder; some may be stale, of a recorder that was killed."""
    return sorted((folder or runtime_folder()).glob("*.sock"))


def ask_server(path: Path, message: bytes, patience_s: float = PATIENCE_S) -> bytes | None:
    """What the server at ``path`` answers; None if none does. A socket without a listener is removed.

    Nothing is sent to another user's server: where anyone can write, it may pose as a recorder.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(patience_s)
        try:
            client.connect(str(path))
            if hasattr(socket, "SO_PEERCRED"):  # else the system does not state whose server it is
                credentials = struct.Struct("3i")  # process, user, group
                packed = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, credentials.size)
                if credentials.unpack(packed)[1] not in (os.getuid(), 0):
                    return None
            client.sendall(message)
            client.shutdown(socket.SHUT_WR)
            return client.recv(MOST_BYTES) or None
        except ConnectionRefusedError:  # stale, of a recorder that was killed
            with suppress(OSError):
                if path.is_socket():
                    path.unlink()
        except OSError:
            pass
    return None


def _shorten_mark_text(text: str) -> str:
    """As much of a text as a mark holds; halves of letters, which no file takes, become question marks."""
    return text[:_MOST_LETTERS].encode(errors="replace").decode()


def send_mark(text: str, folder: Path | None = None) -> int:
    """Set a mark in every recording that runs here, and return how many took it.

    Raises :class:`SourceError` when none does.
    """
    mark = {"text": _shorten_mark_text(text), "monotonic_ns": time.monotonic_ns()}
    message = json.dumps(mark, ensure_ascii=False).encode()
    marked = sum(ask_server(path, message) == b"ok" for path in server_sockets(folder))
    if not marked:
        fix = "start `seatrial record`, or set SEATRIAL_RUNTIME to the folder that it uses"
        raise errors.SourceError("no recorder is running", where=str(folder or runtime_folder()), fix=fix)
    return marked


def running_recorders(folder: Path | None = None) -> list[tuple[Path, RecorderState]]:
    """The recorders that run here, each with its socket; those that do not answer in time are left out."""
    recorders = []
    for path in server_sockets(folder):
        with suppress(ValueError, TypeError):  # of another version, or none
            answer = ask_server(path, _QUESTION, _SHORT_PATIENCE_S)
            recorders.append((path, RecorderState(**orjson.loads(answer or b""))))
    return recorders


def send_prediction(path: Path, body: Mapping[str, Any], geojson: str = "") -> str:
    """Give a prediction to the recorder at a socket. Returns why it did not take it, or nothing."""
    message = orjson.dumps({"prediction": dict(body), "geojson": geojson}, option=orjson.OPT_SERIALIZE_NUMPY)
    answer = ask_server(path, message, _SHORT_PATIENCE_S)
    if answer is None:
        return "the recorder does not answer"
    return "" if answer == b"ok" else answer.removeprefix(_REFUSED).decode(errors="replace")


@dataclass(frozen=True, slots=True)
class NewSamples:
    """The samples that are new, by channel, in pieces as they were written.

    ``restarted`` says that nothing before them belongs to them: another recording, or another clock, which was set
    ``set_by_ns`` ahead of the one before, where that is known.
    """

    samples: list[dict[str, quantities.Series]] = field(default_factory=list)
    restarted: bool = False
    set_by_ns: int = 0


def choose_recorder(
    recorders: list[tuple[Path, RecorderState]], trial: str, configuration: Path
) -> tuple[Path, RecorderState] | None:
    """The recorder of a trial: of several the one with the same configuration file, then the one begun last."""
    fitting = [recorder for recorder in recorders if recorder[1].trial == trial]
    same_configuration = [recorder for recorder in fitting if Path(recorder[1].configuration) == configuration]
    return max(
        same_configuration or fitting,
        key=lambda recorder: recorder[0].stem.rpartition("-")[2].zfill(16),
        default=None,
    )


def no_recorder_text(recorders: list[tuple[Path, RecorderState]], trial: str) -> str:
    """Why there is no recorder to follow, in words."""
    running = ", ".join(f"{state.trial!r} ({state.configuration})" for _, state in recorders)
    remark = f"; what runs is the recorder of {running}" if running else ""
    return f"no recorder of the trial {trial!r} runs here{remark}; waiting for one"


class Follower:
    """Follows the recorder of one trial; to be closed. Nothing it does can hold up the recorder.

    ``recent_s`` is how much is read of what was recorded before. ``recorder`` is the one it follows, with
    its socket; ``trial`` and ``clock`` are those of the part that is read.
    """

    def __init__(
        self, trial: str, configuration: Path, recent_s: float, tell: parts.Tell, folder: Path | None = None
    ) -> None:
        self.recorder: tuple[Path, RecorderState] | None = None
        self.trial = Trial()
        self._name, self._configuration, self._recent_s = trial, configuration.absolute(), recent_s
        self._tell, self._folder = tell, folder
        self._tail: reader.Tail | None = None
        self._received_ns: dict[str, int] = {}  # of each channel the newest
        self._repeats = False  # as the part before was given up or deleted, and some of it written once more
        self._last_text = ""
        self._asked_s = self._heard_s = -_QUIET_S

    @property
    def utc_ns(self) -> int:
        """This moment by the clock of the recording [ns]: the host's clock as the part's beginning found it."""
        offset_ns = None if self._tail is None else reader.PartClock.from_metadata(self._tail.metadata).offset_ns
        return time.time_ns() if offset_ns is None else time.monotonic_ns() + offset_ns

    @property
    def part_path(self) -> Path | None:
        """The part that is read."""
        return None if self._tail is None else self._tail.path

    def news(self) -> NewSamples:
        """What has come since the last time."""
        pieces, now_s = self._read_to_end(), time.monotonic()
        if pieces:
            self._heard_s = now_s
            return NewSamples(pieces)
        is_over = self._tail is not None and (self._tail.ended or self._tail.cut)
        is_quiet = now_s - self._heard_s >= _QUIET_S
        if not (is_over or is_quiet) or now_s - self._asked_s < (_ASK_PERIOD_S if is_quiet else _ASK_SOON_S):
            return NewSamples()
        self._asked_s = now_s
        recorders = running_recorders(self._folder)
        self.recorder = choose_recorder(recorders, self._name, self._configuration)
        if self.recorder is None:
            self._report("info", no_recorder_text(recorders, self._name))
            return NewSamples(self._read_to_end())
        running = self.recorder[1]
        path = Path(running.recording)
        if self.part_path != path:
            return self._change_to_part(path)
        if running.paused:
            self._report("warning", f"the recorder writes nothing at the moment to {path.name}")
        return NewSamples(self._read_to_end())

    def close(self) -> None:
        if self._tail is not None:
            self._tail.close()

    def _read_to_end(self) -> list[dict[str, quantities.Series]]:
        if self._tail is None:
            return []
        try:
            samples = self._tail.read_new_samples()
        except errors.InputError as error:
            self._report("warning", str(error))
            return []
        self.trial = self._tail.trial
        if self._repeats:
            samples = {name: series.subset(series.received_ns > self._received_ns.get(name, 0))
                       for name, series in samples.items()}  # fmt: skip
        samples = {name: series for name, series in samples.items() if series.value.size}
        for name, series in samples.items():
            self._received_ns[name] = max(self._received_ns.get(name, 0), int(series.received_ns.max()))
        return [samples] if samples else []

    def _change_to_part(self, path: Path) -> NewSamples:
        """Read the remainder of this part and go on with the next on the way to that at ``path``, or with another
        recording or clock; with these not before all of this part has been given."""
        before, samples = self._tail, self._read_to_end()
        way, follows = self._way_to(path)
        if samples and not follows:
            return NewSamples(samples)
        self._repeats = before is not None and (before.cut or not before.path.exists())
        if not self._repeats:
            self._received_ns.clear()
        for part in way:
            try:
                tail = reader.Tail(part, self._recent_s)
            except errors.InputError as error:  # deleted, or not there yet
                self._report("warning", str(error))
                return NewSamples(samples)
            self.close()
            self._tail = tail
            samples += self._read_to_end()
            self._report("info", f"following {part.name}{'' if follows else ', from its last minutes on'}")
        self._heard_s = time.monotonic()
        clock, clock_before = (
            reader.PartClock.from_metadata(tail.metadata if tail else {}) for tail in (self._tail, before)
        )
        set_by_ns = clock.ahead_of_ns(clock_before) or 0
        is_step = not follows and abs(set_by_ns) >= reader.NEW_PART_NS
        return NewSamples(samples, restarted=not follows, set_by_ns=set_by_ns * is_step)

    def _way_to(self, path: Path) -> tuple[list[Path], bool]:
        """What to read next on the way to the part at ``path``, and whether it follows the part that is read: the
        part after that, as several may have been begun since; of another recording all of the last ``recent_s``."""
        parts = [path, *reader.parts_before(path)]
        if self._tail is not None and self._tail.path in parts:
            return [parts[parts.index(self._tail.path) - 1]], True
        with suppress(OSError):
            oldest_s = path.stat().st_mtime - self._recent_s
            parts = [part for part in parts if part.stat().st_mtime >= oldest_s]
        return parts[::-1], False

    def _report(self, level: str, text: str) -> None:
        """Report what is new, once."""
        if text != self._last_text:
            self._last_text = text
            self._tell(level, text)


@dataclass(frozen=True, slots=True)
class Request:
    """The head of an HTTP request; ``raw`` is what was received, the head and what came with it."""

    method: str
    path: str
    headers: dict[str, str]
    raw: bytes


class RefusalError(Exception):
    """A request that is answered with a status and one line."""

    def __init__(self, status: HTTPStatus, text: str = "") -> None:
        self.status, self.text = status, text or status.phrase
        super().__init__(self.text)


def http_response(
    status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8", **headers: str
) -> bytes:
    """An answer after which the connection is closed."""
    lines = {"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **headers}
    head = "".join(f"{name}: {value}\r\n" for name, value in lines.items())
    return f"HTTP/1.1 {status.value} {status.phrase}\r\n{head}\r\n".encode() + body


def check_request_origin(request: Request, address: str, origins: Sequence[str] = ()) -> None:
    """Raise :class:`RefusalError` for a request to another name than this computer's, or of an unknown page.

    ``address`` is the one that is listened on; ``origins`` are those of pages that are admitted besides ours.
    """
    host = request.headers.get("host", "")
    if not _is_our_host(host, address):
        raise RefusalError(HTTPStatus.FORBIDDEN, f"this computer is not called {host[:_LONGEST_ORIGIN]!r} here")
    origin = request.headers.get("origin")
    if origin not in (None, f"http://{host}", f"https://{host}", *origins):
        raise RefusalError(HTTPStatus.FORBIDDEN, f"pages of {str(origin)[:_LONGEST_ORIGIN]!r} are not allowed")


def _is_our_host(host: str, address: str) -> bool:
    """Whether a ``Host`` is a name of this computer that cannot be made to point here from elsewhere.

    Such are addresses in figures, as no name server answers for them; on the loopback interface only its own.
    """
    match = _HOST.fullmatch(host)
    name = match[1].lower().removesuffix(".") if match else ""
    if name in (LOOPBACK, "localhost"):
        return True
    if not name or address in (LOOPBACK, "localhost"):
        return False
    with suppress(ValueError):
        return bool(ip_address(name.strip("[]")))
    return name == address.lower() or name in names_of_this_computer()


@lru_cache(maxsize=1)  # a network without a name server keeps one waiting for seconds
def names_of_this_computer() -> frozenset[str]:
    """The names that this computer has by itself, in lower case: with and without its domain, by multicast DNS."""
    host, full = socket.gethostname().lower(), socket.getfqdn().lower()
    short = host.partition(".")[0]
    return frozenset({host, full, short, f"{short}.local"})


def read_request(client: socket.socket) -> Request:
    """The head that a client sends, within a time and a size.

    Raises :class:`RefusalError` for none, or an ambiguous one, and OSError.
    """
    until_s, received = time.monotonic() + PATIENCE_S, b""
    while b"\r\n\r\n" not in received:
        if len(received) > _MOST_HEAD_BYTES:
            raise RefusalError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        client.settimeout(max(until_s - time.monotonic(), 1e-3))
        data = client.recv(_MOST_HEAD_BYTES)
        if not data:
            raise ConnectionError("gone before it had asked")
        received += data
    request_line, *lines = received.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")
    words = request_line.split(" ")
    if len(words) != 3 or not re.fullmatch(r"HTTP/1\.[01]", words[2]) or not words[0].isalpha():
        raise RefusalError(HTTPStatus.BAD_REQUEST)
    headers: dict[str, str] = {}
    for line in lines:
        match = _LINE.fullmatch(line)
        if match is None or (match[1].lower() in _SINGLE and match[1].lower() in headers):
            raise RefusalError(HTTPStatus.BAD_REQUEST)
        headers[match[1].lower()] = match[2]
    return Request(words[0], words[1], headers, received)


class WebFront:
    """Listens on ``address`` and ``port`` and hands entitled requests to ``serve``; a context manager.

    ``serve`` gets the client's socket, which is closed afterwards, and its request, in a thread of its own. Raises
    OSError on entering where the port is not available.
    """

    def __init__(
        self, name: str, address: str, port: int, serve: Callable[[socket.socket, Request], None],
        origins: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self._name, self._address, self._port = name, address, port
        self._serve_requests, self._origins = serve, tuple(origins)
        self._asking: dict[socket.socket, None] = {}  # in the order in which they came
        self._served: set[socket.socket] = set()
        self._lock, self._stopping = threading.Lock(), threading.Event()
        self._reasons: set[str] = set()

    def __enter__(self) -> WebFront:
        family = socket.AF_INET6 if ":" in self._address else socket.AF_INET
        self._socket = socket.create_server((self._address, self._port), family=family)
        self._socket.settimeout(_RETRY_S)
        self._thread = threading.Thread(target=self._accept_connections, name=self._name, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self._socket.close()
        with self._lock:
            for client in (*self._asking, *self._served):
                _end_connection(client)

    def _accept_connections(self) -> None:
        while not self._stopping.is_set():
            try:
                client, _ = self._socket.accept()
                with self._lock:
                    self._asking[client] = None
                    if len(self._asking) > MOST_CLIENTS:  # the first whose request is incomplete is disconnected
                        _end_connection(next(iter(self._asking)))
                try:
                    threading.Thread(
                        target=self._attend_connection, args=(client,), name=self._name, daemon=True
                    ).start()
                except RuntimeError:
                    self._forget_connection(client)
                    raise
            except TimeoutError:
                continue
            except (OSError, RuntimeError):  # no file or thread is available at the moment
                self._stopping.wait(_RETRY_S)

    def _attend_connection(self, client: socket.socket) -> None:
        try:
            request = read_request(client)
            check_request_origin(request, self._address, self._origins)
            self._count_as_served(client)
            client.settimeout(PATIENCE_S)
            self._serve_requests(client, request)
        except RefusalError as refusal:
            self._send_refusal(client, refusal)
        except OSError:
            pass  # gone, or too slow
        except Exception as error:  # of this answer only: no page may end a recording
            self._send_refusal(
                client, RefusalError(HTTPStatus.INTERNAL_SERVER_ERROR, f"{type(error).__name__}: {error}")
            )
        finally:
            self._forget_connection(client)

    def _count_as_served(self, client: socket.socket) -> None:
        with self._lock:
            if len(self._served) >= MOST_CLIENTS:
                raise RefusalError(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_CLIENTS} others are being served")
            del self._asking[client]
            self._served.add(client)

    def _forget_connection(self, client: socket.socket) -> None:
        with self._lock:
            self._asking.pop(client, None)
            self._served.discard(client)
            client.close()

    def _send_refusal(self, client: socket.socket, refusal: RefusalError) -> None:
        """Answer with the reason, and log each reason once."""
        text = errors.escape_control_characters(refusal.text)
        with self._lock:
            is_new = text not in self._reasons and len(self._reasons) < _MOST_REASONS
            if is_new:
                self._reasons.add(text)
        if is_new:
            LOG.warning("%s: a request was refused: %s", self._name, text)
        with suppress(OSError):
            client.sendall(http_response(refusal.status, f"{text}\n".encode(errors="replace")))


def _end_connection(connection: socket.socket) -> None:
    """End a connection that another thread may be waiting on, which then closes it."""
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
