"""Passes the live view on to one viewer: without it, what a slow one loses would be neither bounded nor counted.

The package's server is read as fast as it sends, so that nothing waits in it. Its messages wait here, the newest of
them, for a viewer that takes them more slowly; older ones are dropped and counted as those of any sink are. What
else the server says, of channels and of itself, is passed on whole.
"""

from __future__ import annotations

import selectors
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field

from seatrial.acquisition.logger.health import SinkHealth
from seatrial.acquisition.recording.parts import Tell

_STALLED_S = 30.0  # a viewer that takes nothing for so long has gone: its window, or its computer, is asleep
_MOST_WAITING = 256  # messages a viewer may lag behind: some seconds
_RELAYED_BYTES = 65_536
_LOOK_S = 1.0
_HEAD_END = b"\r\n\r\n"
_BINARY_FRAME, _MESSAGE = 0x82, 0x01  # RFC 6455, 5.2: final and binary; Foxglove's protocol: a message's data


@dataclass(slots=True)
class ViewerCounts:
    """What all viewers got, in the health of the live view; of several threads."""

    health: SinkHealth
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, *, offered: int = 0, sent: int = 0, waiting: int = 0) -> None:
        """Count messages; what is offered and neither sent nor waiting is dropped."""
        with self._lock:
            self.health.offered += offered
            self.health.sent += sent
            self.health.in_hand += waiting


class ViewerQueue:
    """What waits for one viewer: all that the server said, but of its messages the newest :data:`_MOST_WAITING`."""

    def __init__(self, counts: ViewerCounts) -> None:
        self._counts = counts
        self._received, self._is_open = bytearray(), False
        self._frames: deque[tuple[bytes, bool]] = deque()  # and whether it is a message
        self._waiting = 0  # messages among them
        self._unsent = b""  # of the frame that is being sent, a message or not
        self._sends_message = False
        self.has_dropped = False

    def __bool__(self) -> bool:
        """Whether something waits."""
        return bool(self._unsent or self._frames)

    def add(self, data: bytes) -> None:
        """Take what the server sent."""
        self._received += data
        while frame := self._next_frame():
            is_binary = self._is_open and frame[0] == _BINARY_FRAME
            is_message = is_binary and frame[_head_length(frame) :].startswith(bytes([_MESSAGE]))
            self._is_open = True
            self._frames.append((frame, is_message))
            if is_message:
                self._waiting += 1
                self._counts.add(offered=1, waiting=1)
            if self._waiting > _MOST_WAITING:
                self._drop_oldest()

    def _next_frame(self) -> bytes:
        """The next whole frame, first the head of the answer; empty if it has not come yet."""
        size = frame_length(self._received) if self._is_open else self._received.find(_HEAD_END) + len(_HEAD_END)
        if (not self._is_open and size < len(_HEAD_END)) or not 0 < size <= len(self._received):
            return b""
        frame = bytes(self._received[:size])
        del self._received[:size]
        return frame

    def _drop_oldest(self) -> None:
        del self._frames[next(place for place, (_, is_message) in enumerate(self._frames) if is_message)]
        self._waiting -= 1
        self._counts.add(waiting=-1)
        self.has_dropped = True

    def send(self, viewer: socket.socket) -> bool:
        """Send what a viewer takes at once; whether it took anything."""
        took = False
        while self:
            if not self._unsent:
                self._unsent, self._sends_message = self._frames.popleft()
            try:
                count = viewer.send(self._unsent)
            except BlockingIOError:
                break
            self._unsent, took = self._unsent[count:], True
            if not self._unsent and self._sends_message:
                self._waiting -= 1
                self._counts.add(sent=1, waiting=-1)
        return took

    def close(self) -> None:
        """Count what still waits as dropped."""
        self._counts.add(waiting=-self._waiting)
        self._waiting = 0


def frame_length(data: bytes | bytearray) -> int:
    """How long the frame of a server is that begins with ``data`` (RFC 6455, 5.2); 0 if that cannot be told yet."""
    if len(data) < 2 or len(data) < (head := _head_length(data)):
        return 0
    return head + (int.from_bytes(data[2:head], "big") if head > 2 else data[1] & 0x7F)


def _head_length(data: bytes | bytearray) -> int:
    return 2 + {126: 2, 127: 8}.get(data[1] & 0x7F, 0)


def relay_viewer(viewer: socket.socket, server: socket.socket, counts: ViewerCounts, tell: Tell) -> None:
    """Pass on what both send, until either ends or the viewer takes nothing for :data:`_STALLED_S`."""
    queue, took_s, told = ViewerQueue(counts), time.monotonic(), False
    viewer.setblocking(False)
    server.settimeout(_STALLED_S)
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(server, selectors.EVENT_READ)
            selector.register(viewer, selectors.EVENT_READ)
            while True:
                wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if queue else 0)
                selector.modify(viewer, wanted)
                for key, events in selector.select(_LOOK_S):
                    if events & selectors.EVENT_READ and not _pass_on(key.fileobj is server, viewer, server, queue):
                        return
                    if events & selectors.EVENT_WRITE and queue.send(viewer):
                        took_s = time.monotonic()
                took_s = took_s if queue else time.monotonic()
                if queue.has_dropped and not told:
                    told = True
                    tell("warning", "a viewer of the live view is too slow: the oldest messages are dropped")
                if time.monotonic() - took_s > _STALLED_S:
                    counts.health.error = f"a viewer took nothing for {_STALLED_S:g} s and was disconnected"
                    tell("warning", f"live view: {counts.health.error}")
                    return
    finally:
        queue.close()


def _pass_on(from_server: bool, viewer: socket.socket, server: socket.socket, queue: ViewerQueue) -> bool:
    """Take what one of both sent; whether it is still there."""
    data = (server if from_server else viewer).recv(_RELAYED_BYTES)
    if from_server:
        queue.add(data)
        if not data:
            queue.send(viewer)
    elif data:
        server.sendall(data)
    return bool(data)
