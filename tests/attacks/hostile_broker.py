"""A broker that does what it is told: speaks MQTT 3.1.1 as far as a subscriber needs it, or refuses to."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

ACCEPTED, WRONG_PASSWORD, NOT_AUTHORISED = 0, 4, 5


def packet(kind: int, body: bytes, length: int | None = None) -> bytes:
    """A packet of MQTT; ``length`` is what it says of itself where that is not true."""
    remaining, digits = len(body) if length is None else length, bytearray()
    while True:
        remaining, digit = divmod(remaining, 128)
        digits.append(digit | (0x80 if remaining else 0))
        if not remaining:
            return bytes([kind]) + bytes(digits) + body


def message(topic: bytes, payload: bytes, *, retained: bool = False) -> bytes:
    return packet(0x30 | retained, len(topic).to_bytes(2, "big") + topic + payload)


class HostileBroker:
    """Serves one subscriber after the other; ``behave`` is called with each that has subscribed."""

    def __init__(
        self, port: int, behave: Callable[[socket.socket], object], tls: ssl.SSLContext | None = None
    ) -> None:
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.settimeout(0.1)
        self._behave, self._tls = behave, tls
        self.answer = ACCEPTED
        self.passwords: list[bytes] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> HostileBroker:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._stopping.set()
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            with suppress(OSError):  # nobody came, or who came is gone
                accepted, _ = self._server.accept()
                with self._secured(accepted) as client:
                    client.settimeout(5.0)
                    self._speak(client)

    def _secured(self, accepted: socket.socket) -> socket.socket:
        return accepted if self._tls is None else self._tls.wrap_socket(accepted, server_side=True)

    def _speak(self, client: socket.socket) -> None:
        self.passwords.append(client.recv(4096))
        client.sendall(packet(0x20, bytes([0, self.answer])))
        if self.answer != ACCEPTED:
            return
        subscription = client.recv(4096)
        client.sendall(packet(0x90, subscription[2:4] + b"\0"))
        self._behave(client)
        client.settimeout(0.1)
        while not self._stopping.is_set():
            with suppress(TimeoutError):
                if not client.recv(4096):
                    return
                client.sendall(packet(0xD0, b""))  # the answer to a ping
