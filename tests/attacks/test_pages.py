"""Pages and viewers: the ship's data are shown to nobody else, and no client stops a page or the recorder."""

from __future__ import annotations

import inspect
import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from seatrial.acquisition.config.sources import LiveSection, StatusSection
from seatrial.acquisition.core.errors import SourceError, StorageError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.record import LiveView, Picture, StatusPage
from seatrial.acquisition.logger.requests import (
    LOOPBACK,
    RecorderState,
    RefusalError,
    Request,
    RequestServer,
    WebFront,
    check_request_origin,
    names_of_this_computer,
    send_mark,
)
from seatrial.analysis.commands import serve
from tests.acquisition.conftest import PATIENCE_S, free_port
from tests.attacks.other_user import as_nobody, open_folder

STRANGERS = 20
"""More clients than a server of the recorder keeps at once."""
FOXGLOVE = "https://app.foxglove.dev"


@pytest.fixture(scope="module")
def status_port() -> Iterator[int]:
    port = free_port(socket.SOCK_STREAM)
    with StatusPage(StatusSection(port), Picture(Health({}), frozenset(), None), "trial"):
        yield port


@pytest.fixture(scope="module")
def live_port() -> Iterator[int]:
    pytest.importorskip("foxglove")
    port = free_port(socket.SOCK_STREAM)
    with LiveView(LiveSection(port, origins=(FOXGLOVE,)), Trial(name="trial")):
        yield port


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)


def answer(port: int, request: bytes) -> bytes:
    """All that a server says to a request, up to the head's end at least; empty if it says nothing."""
    received = b""
    with connect(port) as client, suppress(ConnectionError):
        client.sendall(request)
        while b"\r\n\r\n" not in received and (data := client.recv(65_536)):
            received += data
    return received


def status_code(port: int, request: bytes) -> int:
    """The status that a server answers with; 0 for none."""
    head = answer(port, request).partition(b"\r\n")[0].split()
    return int(head[1]) if len(head) > 1 else 0


def upgrade(*lines: str) -> bytes:
    """A viewer's request for a WebSocket with these lines in its head."""
    fixed = (
        "GET / HTTP/1.1", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol: foxglove.sdk.v1",
    )  # fmt: skip
    return "\r\n".join((*fixed, *lines, "", "")).encode()


def get(*lines: str, path: str = "/status.json") -> bytes:
    return "\r\n".join((f"GET {path} HTTP/1.1", *lines, "", "")).encode()


STRANGE_HEADS = {
    "a page elsewhere": ("Host: 127.0.0.1:{port}", "Origin: https://evil.example"),
    "a page elsewhere on this port": ("Host: 127.0.0.1:{port}", "Origin: http://evil.example:{port}"),
    "a name that points here": ("Host: evil.example:{port}", "Origin: http://evil.example:{port}"),
    "a name that begins like ours": ("Host: localhost.evil.example:{port}",),
    "a name that ends like ours": ("Host: evil-localhost:{port}",),
    "a sandboxed page": ("Host: 127.0.0.1:{port}", "Origin: null"),
    "another program of this computer": ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:1"),
    "an origin with a user": ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:{port}@evil.example"),
    "two hosts": ("Host: 127.0.0.1:{port}", "Host: evil.example"),
    "two origins": ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:{port}", "Origin: http://evil.example"),
    "no host": (),
    "an empty host": ("Host:",),
    "a host with a user": ("Host: localhost@evil.example",),
    "a folded head": ("Host: evil.example", " 127.0.0.1:{port}"),
}


@pytest.mark.parametrize("lines", STRANGE_HEADS.values(), ids=STRANGE_HEADS.keys())
def test_live_view_is_refused_to(lines: tuple[str, ...], live_port: int) -> None:
    received = answer(live_port, upgrade(*(line.format(port=live_port) for line in lines)))
    assert b" 101 " not in received
    assert b"trial" not in received


@pytest.mark.parametrize("lines", STRANGE_HEADS.values(), ids=STRANGE_HEADS.keys())
def test_status_page_is_refused_to(lines: tuple[str, ...], status_port: int) -> None:
    received = answer(status_port, get(*(line.format(port=status_port) for line in lines)))
    assert b" 200 " not in received
    assert b"sources" not in received


@pytest.mark.parametrize("lines", [
    ("Host: 127.0.0.1:{port}",),
    ("Host: localhost:{port}",),
    ("Host: LOCALHOST",),
    ("Host: localhost:9000",),  # through an SSH tunnel
    ("Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:{port}"),
    ("host: 127.0.0.1:{port}", "ORIGIN: http://127.0.0.1:{port}"),
], ids=lambda lines: " ".join(lines))  # fmt: skip
def test_who_is_meant_is_answered(lines: tuple[str, ...], status_port: int, live_port: int) -> None:
    assert status_code(status_port, get(*(line.format(port=status_port) for line in lines))) == 200
    assert status_code(live_port, upgrade(*(line.format(port=live_port) for line in lines))) == 101


def test_viewer_in_a_browser_is_served_where_its_origin_is_named(live_port: int) -> None:
    head = f"Host: 127.0.0.1:{live_port}"
    assert status_code(live_port, upgrade(head, f"Origin: {FOXGLOVE}")) == 101
    assert status_code(live_port, upgrade(head, f"Origin: {FOXGLOVE}.evil.example")) == 403


def test_server_behind_the_live_view_is_at_no_address_that_a_page_can_guess(live_port: int) -> None:
    """The package's own server checks nothing: a page that knew its port could ask it."""
    listening = [line.split()[1].split(":") for line in Path("/proc/self/net/tcp").read_text().splitlines()[1:]]
    ours = {address for address, port in listening if address.endswith("7F")}
    inner = {address for address in ours if address != "0100007F"}
    assert inner, "the live view's own server listens on 127.0.0.1"


def silent(client: socket.socket) -> None:
    """Says nothing."""


def slow(client: socket.socket) -> None:
    """Sends its head a byte at a time, which makes every single wait short."""

    def drip() -> None:
        with suppress(OSError):
            for byte in b"GET / HTTP/1.1\r\nX: " + b"a" * 10_000:
                client.send(bytes([byte]))
                time.sleep(0.1)

    threading.Thread(target=drip, daemon=True).start()


def resetting(client: socket.socket) -> None:
    """Asks and is gone, with a reset instead of an end."""
    client.sendall(get("Host: localhost"))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def endless(client: socket.socket) -> None:
    """Sends a head without end."""
    with suppress(OSError):
        client.setblocking(False)
        for _ in range(100):
            client.send(b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * 60_000 + b"\r\n")


def deaf(client: socket.socket) -> None:
    """Asks again and again and reads nothing."""
    with suppress(OSError):
        client.setblocking(False)
        for _ in range(1000):
            client.send(get("Host: localhost"))


@pytest.mark.parametrize("behave", [silent, slow, resetting, endless, deaf], ids=lambda behave: behave.__name__)
def test_many_clients_keep_nobody_from_the_page(
    behave: Callable[[socket.socket], None], status_port: int, live_port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    for port, request, status in (
        (status_port, get("Host: localhost"), 200),
        (live_port, upgrade("Host: localhost"), 101),
    ):
        with ExitStack() as clients:
            for _ in range(STRANGERS):
                behave(clients.enter_context(closing(connect(port))))
            assert status_code(port, request) == status
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err


@pytest.mark.parametrize("request_line", [
    b"GET /../status.json HTTP/1.1", b"GET //status.json HTTP/1.1", b"GET /%2e%2e/etc/passwd HTTP/1.1",
    b"GET /status.json\x00 HTTP/1.1", b"GET http://evil.example/status.json HTTP/1.1", b"HEAD / HTTP/1.1",
    b"POST /status.json HTTP/1.1", b"CONNECT evil.example:80 HTTP/1.1", b"TRACE / HTTP/1.1",
    b"OPTIONS * HTTP/1.1", b"PRI * HTTP/2.0", b"GET /status.json", b"GET /status.json HTTP/9.9", b"\xff\xfe\xfd",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"",
], ids=repr)  # fmt: skip
def test_status_page_answers_a_strange_request_with_an_error_or_nothing(
    request_line: bytes, status_port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    received = answer(status_port, request_line + b"\r\nHost: localhost\r\n\r\n")
    assert received == b"" or int(received.split()[1]) in (400, 403, 404, 405, 501, 505)
    assert b"sources" not in received
    assert status_code(status_port, get("Host: localhost")) == 200
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("host", ["192.168.1.20:8765", "[fe80::1]:8765", socket.gethostname(), "localhost"])
def test_live_view_on_the_network_answers_under_its_addresses_and_names(host: str) -> None:
    check_request_origin(Request("GET", "/", {"host": host}, b""), "0.0.0.0")


@pytest.mark.parametrize("hostname", ["bridge", "bridge.ship.lan", "Bridge.ship.lan"])
@pytest.mark.parametrize(
    "host", ["bridge", "BRIDGE:8767", "bridge.ship.lan", "bridge.ship.lan.:8767", "bridge.local"]
)
def test_pages_answer_under_the_name_of_this_computer_with_and_without_its_domain(
    host: str, hostname: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page on the loopback interface does not, nor does any under a stranger's name with ours in it."""
    monkeypatch.setattr(socket, "gethostname", lambda: hostname)
    monkeypatch.setattr(socket, "getfqdn", lambda: "bridge.ship.lan")
    names_of_this_computer.cache_clear()
    check_request_origin(Request("GET", "/", {"host": host}, b""), "0.0.0.0")
    for name, address in (
        (host, LOOPBACK),
        (f"{host.partition(':')[0]}evil.example", "0.0.0.0"),
        ("ship.lan", "::"),
    ):
        with pytest.raises(RefusalError):
            check_request_origin(Request("GET", "/", {"host": name}, b""), address)
    names_of_this_computer.cache_clear()


@pytest.mark.parametrize(
    "host", ["evil.example", "192.168.1.20.evil.example", "[evil]", "1.2.3.4@evil.example", ""]
)
def test_live_view_on_the_network_answers_under_no_name_of_a_stranger(host: str) -> None:
    with pytest.raises(RefusalError):
        check_request_origin(Request("GET", "/", {"host": host}, b""), "0.0.0.0")


def test_error_in_an_answer_is_one_line_and_the_next_is_answered(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(client: socket.socket, request: Request) -> None:
        raise RuntimeError("dictionary changed size during iteration")

    with WebFront("test", "127.0.0.1", port := free_port(socket.SOCK_STREAM), fail):
        for _ in range(2):
            assert b"500 Internal" in answer(port, get("Host: localhost"))
    assert "Traceback" not in capfd.readouterr().err


def test_ports_of_the_pages_differ_by_default() -> None:
    """All three may run on one computer."""
    assert len({inspect.signature(serve).parameters["port"].default, LiveSection().port, StatusSection().port}) == 3


def marks_server(folder: Path, marks: list[str]) -> RequestServer:
    who = RecorderState("", "", "", False, 0, 0, 0)
    return RequestServer(lambda text, at_ns: marks.append(text), lambda: who, Predictions(Health({})), folder)


def test_marks_are_not_given_to_another_users_server() -> None:
    with open_folder() as place:
        received, sending = os.pipe()

        def pose() -> None:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
                server.bind(str(place / "1-1.sock"))
                server.listen()
                (place / "1-1.sock").chmod(0o777)
                if os.fork():
                    os._exit(0)
                server.settimeout(PATIENCE_S)
                os.write(sending, server.accept()[0].recv(1000) or b"nothing")

        as_nobody(pose)
        with pytest.raises(SourceError, match="no recorder is running"):
            send_mark("secret", place)
        assert os.read(received, 1000) == b"nothing"


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_folder_that_another_user_made_first_is_refused(kind: str) -> None:
    with open_folder() as place:
        folder = place / "seatrial-0"
        as_nobody(folder.mkdir if kind == "folder" else lambda: folder.symlink_to("/root"))
        with pytest.raises(StorageError, match="belongs to another user"):
            marks_server(folder, []).__enter__()


def refused(place: Path) -> None:
    """A mark that nobody takes."""
    with pytest.raises(SourceError):
        send_mark("planted", place)


def test_marks_are_taken_from_no_other_user_wherever_the_socket_lies() -> None:
    with open_folder() as place:
        marks: list[str] = []
        before = os.umask(0)
        try:
            with marks_server(place, marks):
                as_nobody(lambda: refused(place))
                assert send_mark("ours", place) == 1
        finally:
            os.umask(before)
        assert marks == ["ours"]


@pytest.mark.parametrize("make", [
    lambda path: path.write_text("notes"), lambda path: path.mkdir(), lambda path: os.mkfifo(path),
    lambda path: path.symlink_to("nowhere"), lambda path: path.symlink_to(path),
], ids=["file", "folder", "fifo", "dangling link", "loop"])  # fmt: skip
def test_what_is_no_socket_stays_where_it_is(make: Callable[[Path], object], tmp_path: Path) -> None:
    make(tmp_path / "notes.sock")
    with pytest.raises(SourceError, match="no recorder is running"):
        send_mark("start", tmp_path)
    assert os.path.lexists(tmp_path / "notes.sock")
