"""What browsers and viewers of the recorder meet first: few clients at once, briefly, and only those entitled.

A page from anywhere can make a browser aboard ask here, and a name elsewhere can be made to point here. Both give
themselves away: by the name under which they ask (``Host``), and by where they come from (``Origin``). A client
that says nothing, little, or too much costs nobody else the page, and never the recorder.
"""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import ip_address

from seatrial.acquisition.core.text import printable
from seatrial.acquisition.logger.supervision import LOG

MOST_CLIENTS = 16
"""So many may be asking at once, and as many be served; browsers open six to one address."""
PATIENCE_S = 3.0
"""How long a client may take to ask, and to take in what it asked for."""
LOOPBACK = "127.0.0.1"
_MOST_HEAD_BYTES = 16_384  # what Apache and nginx take at least; a browser with many cookies sends half of it
_MOST_REASONS = 20
_LONGEST_ORIGIN = 100  # in a log line
_RETRY_S = 0.2
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::\d{1,5})?", re.IGNORECASE)
_LINE = re.compile(r"([!#$%&'*+.^_`|~0-9A-Za-z-]+):[ \t]*([^\x00-\x08\x0a-\x1f\x7f]*?)[ \t]*")
_SINGLE = ("host", "origin")


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


def response(status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8", **headers: str) -> bytes:
    """An answer after which the connection is closed."""
    lines = {"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **headers}
    head = "".join(f"{name}: {value}\r\n" for name, value in lines.items())
    return f"HTTP/1.1 {status.value} {status.phrase}\r\n{head}\r\n".encode() + body


def check_sender(request: Request, address: str, origins: Sequence[str] = ()) -> None:
    """Raise :class:`RefusalError` for a request to another name than this computer's, or of a stranger's page.

    ``address`` is the one that is listened on; ``origins`` are those of pages that are welcome besides ours.
    """
    host = request.headers.get("host", "")
    if not _is_our_host(host, address):
        raise RefusalError(HTTPStatus.FORBIDDEN, f"this computer is not called {host[:_LONGEST_ORIGIN]!r} here")
    origin = request.headers.get("origin")
    if origin not in (None, f"http://{host}", f"https://{host}", *origins):
        raise RefusalError(HTTPStatus.FORBIDDEN, f"pages of {str(origin)[:_LONGEST_ORIGIN]!r} are not allowed")


def _is_our_host(host: str, address: str) -> bool:
    """Whether a ``Host`` is a name of this computer that nobody else can make point here.

    Such are addresses in figures, as no name server answers for them; on the loopback interface only its own.
    """
    match = _HOST.fullmatch(host)
    name = match[1].lower() if match else ""
    if name in (LOOPBACK, "localhost"):
        return True
    if not name or address in (LOOPBACK, "localhost"):
        return False
    ours = socket.gethostname().lower()
    if name in (address.lower(), ours, f"{ours}.local"):
        return True
    with suppress(ValueError):
        return bool(ip_address(name.strip("[]")))
    return False


def read_request(client: socket.socket, patience_s: float = PATIENCE_S) -> Request:
    """The head that a client sends, within a time and a size. Raises :class:`RefusalError`, OSError."""
    until_s, received = time.monotonic() + patience_s, b""
    while b"\r\n\r\n" not in received:
        if len(received) > _MOST_HEAD_BYTES:
            raise RefusalError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        client.settimeout(max(until_s - time.monotonic(), 1e-3))
        data = client.recv(_MOST_HEAD_BYTES)
        if not data:
            raise ConnectionError("gone before it had asked")
        received += data
    return parse_request(received)


def parse_request(received: bytes) -> Request:
    """The request that begins some bytes. Raises :class:`RefusalError` for what is none, or is ambiguous."""
    first, *lines = received.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")
    words = first.split(" ")
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
    OSError on entering where the port cannot be had.
    """

    def __init__(
        self, name: str, address: str, port: int, serve: Callable[[socket.socket, Request], None],
        origins: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self._name, self._address, self._port = name, address, port
        self._serve, self._origins = serve, tuple(origins)
        self._asking: dict[socket.socket, None] = {}  # in the order in which they came
        self._served: set[socket.socket] = set()
        self._lock, self._stopping = threading.Lock(), threading.Event()
        self._reasons: set[str] = set()

    def __enter__(self) -> WebFront:
        family = socket.AF_INET6 if ":" in self._address else socket.AF_INET
        self._socket = socket.create_server((self._address, self._port), family=family)
        self._socket.settimeout(_RETRY_S)
        self._thread = threading.Thread(target=self._listen, name=self._name, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self._socket.close()
        with self._lock:
            for client in (*self._asking, *self._served):
                _end_connection(client)

    def _listen(self) -> None:
        while not self._stopping.is_set():
            try:
                self._admit(self._socket.accept()[0])
            except TimeoutError:
                continue
            except (OSError, RuntimeError):  # no file or thread to be had at the moment
                self._stopping.wait(_RETRY_S)

    def _admit(self, client: socket.socket) -> None:
        """Admit a client; of too many whose request is incomplete, the first is disconnected."""
        with self._lock:
            self._asking[client] = None
            if len(self._asking) > MOST_CLIENTS:
                _end_connection(next(iter(self._asking)))
        try:
            threading.Thread(target=self._attend, args=(client,), name=self._name, daemon=True).start()
        except RuntimeError:
            self._forget(client)
            raise

    def _attend(self, client: socket.socket) -> None:
        try:
            request = read_request(client)
            check_sender(request, self._address, self._origins)
            self._count_as_served(client)
            client.settimeout(PATIENCE_S)
            self._serve(client, request)
        except RefusalError as refusal:
            self._refuse(client, refusal)
        except OSError:
            pass  # gone, or too slow
        except Exception as error:  # whatever it is, it is this answer's, and no page may end a recording
            self._refuse(client, RefusalError(HTTPStatus.INTERNAL_SERVER_ERROR, f"{type(error).__name__}: {error}"))
        finally:
            self._forget(client)

    def _count_as_served(self, client: socket.socket) -> None:
        with self._lock:
            if len(self._served) >= MOST_CLIENTS:
                raise RefusalError(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_CLIENTS} others are being served")
            del self._asking[client]
            self._served.add(client)

    def _forget(self, client: socket.socket) -> None:
        with self._lock:
            self._asking.pop(client, None)
            self._served.discard(client)
            client.close()

    def _refuse(self, client: socket.socket, refusal: RefusalError) -> None:
        """Answer with the reason, and log each reason once, so that who wonders finds out."""
        text = printable(refusal.text)
        with self._lock:
            is_new = text not in self._reasons and len(self._reasons) < _MOST_REASONS
            if is_new:
                self._reasons.add(text)
        if is_new:
            LOG.warning("%s: a request was refused: %s", self._name, text)
        with suppress(OSError):
            client.sendall(response(refusal.status, f"{text}\n".encode(errors="replace")))


def _end_connection(connection: socket.socket) -> None:
    """End a connection that another thread may be waiting on, which then closes it."""
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
