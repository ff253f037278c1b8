"""The live view's way to one viewer: whole frames, the newest of the messages, every lost one counted."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as some

from seatrial.acquisition.logger import viewers
from seatrial.acquisition.logger.health import SinkHealth
from seatrial.acquisition.logger.viewers import ViewerCounts, ViewerQueue, frame_length, relay_viewer

HEAD = b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n\r\n"
TEXT = b"\x81\x02{}"


def message(content: bytes) -> bytes:
    """A frame of a message's data, as a server sends it."""
    payload = b"\x01" + content
    size = len(payload)
    if size < 126:
        return bytes([0x82, size]) + payload
    return bytes([0x82, 126]) + size.to_bytes(2, "big") + payload


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    """A connection's two ends."""
    pair = socket.socketpair()
    yield pair
    for end in pair:
        end.close()


@given(some.lists(some.binary(max_size=300), max_size=20), some.integers(1, 400))
def test_viewer_that_reads_gets_every_byte(contents: list[bytes], piece: int) -> None:
    """However the server's bytes are cut."""
    health = SinkHealth("live view")
    queue, sent = ViewerQueue(ViewerCounts(health)), HEAD + TEXT + b"".join(map(message, contents))
    near, far = socket.socketpair()
    with near, far:
        near.setblocking(False)
        for start in range(0, len(sent), piece):
            queue.add(sent[start : start + piece])
            queue.send(near)
        near.close()
        received = b""
        while data := far.recv(65_536):
            received += data
    assert received == sent
    assert (health.offered, health.sent, health.dropped) == (len(contents), len(contents), 0)


def test_length_of_a_frame_is_that_of_the_protocol() -> None:
    assert [frame_length(data) for data in (b"", b"\x82", TEXT, b"\x82\x7e\x01", message(b"x" * 300))] == [
        0, 0, 4, 0, 305
    ]  # fmt: skip
    assert frame_length(b"\x82\x7f" + (70_000).to_bytes(8, "big")) == 70_010


def test_slow_viewer_gets_the_newest_messages_and_all_that_is_no_message(
    ends: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewers, "_MOST_WAITING", 3)
    near, far = ends
    health = SinkHealth("live view")
    queue = ViewerQueue(ViewerCounts(health))
    queue.add(HEAD + TEXT + b"".join(message(b"%d" % number) for number in range(10)) + TEXT)
    assert queue.has_dropped
    queue.send(near)
    assert far.recv(65_536) == HEAD + TEXT + b"".join(message(b"%d" % number) for number in (7, 8, 9)) + TEXT
    assert (health.offered, health.sent, health.dropped) == (10, 3, 7)


def test_viewer_that_never_reads_is_counted_and_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    """The server is read to the end meanwhile; whatever was not sent is dropped."""
    monkeypatch.setattr(viewers, "_STALLED_S", 0.3)
    monkeypatch.setattr(viewers, "_LOOK_S", 0.05)
    health, told = SinkHealth("live view"), list[str]()
    (server, ours), (near, far) = socket.socketpair(), socket.socketpair()
    with server, ours, near, far:
        relay = threading.Thread(
            target=relay_viewer, args=(near, ours, ViewerCounts(health), lambda level, text: told.append(text))
        )
        relay.start()
        server.settimeout(20.0)
        server.sendall(HEAD + 3000 * message(b"x" * 1000))
        relay.join(20.0)
        assert not relay.is_alive()
    assert health.offered == 3000
    assert 0 < health.sent < 3000
    assert health.dropped == health.offered - health.sent
    assert any("too slow" in text for text in told)
    assert "took nothing" in health.error
