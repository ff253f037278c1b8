"""What is being recorded, for those who look from elsewhere: the live view and the status page.

The live view serves Foxglove and Lichtblick over a WebSocket. It hears every message after the recorder has written
it and hands it to the server's own threads, which drop the oldest for a viewer that is too slow. Raw input is not
served: nobody looks at it, and it is most of the load. The package's server answers whoever asks, so it listens
where only :class:`WebFront` finds it, which passes on those that are meant.

The status page is what the terminal shows, as a page that renews itself and as JSON, for this computer only. It is
read-only: GET of two paths, bound to 127.0.0.1, for nobody who calls this computer by another name (a page
elsewhere could have its name point here).
"""

from __future__ import annotations

import html
import io
import secrets
import selectors
import socket
import sys
import time
from contextlib import ExitStack
from http import HTTPStatus
from ipaddress import IPv4Address
from typing import Any

import orjson

from seatrial.acquisition.config.sections import LiveSection, StatusSection
from seatrial.acquisition.core.channels import channels_known_to
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.frames import iso
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.display import Picture
from seatrial.acquisition.logger.health import Health
from seatrial.acquisition.logger.web_front import LOOPBACK, PATIENCE_S, RefusalError, Request, WebFront, response
from seatrial.acquisition.recording.messages import ENCODING
from seatrial.acquisition.recording.schemas import RAW_PREFIX, channel_metadata, kind_of

_BACKLOG = 256  # messages a viewer may lag behind: some seconds
_STALLED_S = 30.0  # a viewer that takes nothing for so long has gone: its window, or its computer, is asleep
_RELAYED_BYTES = 65_536
_COLUMNS, _ROWS = 120, 60
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="2"><title>{title}</title>
<style>body {{ color: #000; background: #fff }} pre {{ font-family: monospace; font-size: 14px }}</style></head>
<body><pre>{body}</pre></body></html>
"""
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'",
    "X-Content-Type-Options": "nosniff",
}


class LiveView:
    """A server for viewers while a recording runs; a context manager, and a listener to the recording.

    Raises :class:`ConfigurationError` without the package ``foxglove-sdk``, :class:`SourceError` without the port.
    """

    def __init__(self, settings: LiveSection, trial: Trial) -> None:
        self._settings, self._name = settings, trial.name
        self._trial_channels = channels_known_to(trial)
        self._channels: dict[str, Any] = {}
        self._sdk: Any = None

    def __enter__(self) -> LiveView:
        try:
            import foxglove
        except ImportError as error:
            fix = "pip install 'seatrial[live]'"
            raise ConfigurationError("the live view needs the package foxglove-sdk", fix=fix) from error
        self._sdk, self._context = foxglove, foxglove.Context()
        address, port = self._settings.address, self._settings.port
        self._hidden = _hidden_address()
        try:
            with ExitStack() as stack:
                self._server = foxglove.start_server(
                    name=self._name, host=self._hidden, port=0, context=self._context, message_backlog_size=_BACKLOG
                )
                stack.callback(self._server.stop)
                stack.enter_context(WebFront("live view", address, port, self._relay, self._settings.origins))
                self._closing = stack.pop_all()
        except Exception as error:  # the package promises no kind of error
            what = f"the live view cannot be served on {address}:{port}"
            why = getattr(error, "strerror", "") or str(error)
            fix = "stop the program that uses the port, or give another in [live]"
            raise SourceError(what, why=why, fix=fix) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    @property
    def address(self) -> str:
        address = self._settings.address
        return f"ws://{f'[{address}]' if ':' in address else address}:{self._settings.port}"

    def _relay(self, viewer: socket.socket, request: Request) -> None:
        """Pass a viewer's request on to the package's server, and then what both say."""
        with socket.create_connection((self._hidden, self._server.port), timeout=PATIENCE_S) as server:
            server.sendall(request.raw)
            relay(viewer, server)

    def publish(self, topic: str, data: bytes, log_ns: int) -> None:
        """Pass a message on to whoever looks."""
        if topic.startswith(RAW_PREFIX):
            return
        channel = self._channels.get(topic) or self._open(topic)
        channel.log(data, log_time=max(log_ns, 0))

    def _open(self, topic: str) -> Any:
        kind = kind_of(topic)
        schema = self._sdk.Schema(name=kind.title, encoding=ENCODING, data=kind.descriptors)
        metadata = channel_metadata(topic, self._trial_channels)
        self._channels[topic] = self._sdk.Channel(
            topic, schema=schema, message_encoding=ENCODING, metadata=metadata, context=self._context
        )
        return self._channels[topic]


def _hidden_address() -> str:
    """An address of this computer alone that no page can guess: one of 16 million, with a port of 28,000.

    Only Linux has all of 127.0.0.0/8; elsewhere the port alone is unknown.
    """
    if sys.platform != "linux":
        return LOOPBACK
    return str(IPv4Address((127 << 24) + 2 + secrets.randbelow((1 << 24) - 4)))


def relay(viewer: socket.socket, server: socket.socket) -> None:
    """Pass on what either of two connections says until either ends, or takes nothing for too long."""
    with selectors.DefaultSelector() as selector:
        for source, target in ((viewer, server), (server, viewer)):
            source.settimeout(_STALLED_S)
            selector.register(source, selectors.EVENT_READ, target)
        while True:
            for key, _ in selector.select():
                data = key.fileobj.recv(_RELAYED_BYTES)  # type: ignore[union-attr]
                if not data:
                    return
                key.data.sendall(data)


def page(picture: Picture, title: str) -> str:
    """What the terminal shows, as a page."""
    from seatrial.acquisition.core.terminal import Terminal

    console = Terminal(record=True, file=io.StringIO(), width=_COLUMNS, height=_ROWS, force_terminal=True)
    console.print(picture)
    body = console.export_html(inline_styles=True, code_format="{code}")
    return _PAGE.format(title=html.escape(title), body=body)


def as_json(health: Health) -> bytes:
    """The same as an object: state, figures by name, sources, the alarms that are raised, the last events."""
    now_ns = time.monotonic_ns()
    events = [{"time": iso(at_ns), "level": level, "text": text} for at_ns, level, text in tuple(health.events)]
    state = {
        "recording": health.part,
        "trouble": health.trouble,
        "clock": str(health.clock),
        "copies": health.copies.trouble,
        "alarms": dict(health.alarms),
        "figures": health.figures(now_ns),
        "sources": [source.as_message(now_ns) for source in health.sources.values()],
        "events": events,
    }
    return orjson.dumps(state)


class StatusPage:
    """A server of the page while a recording runs; a context manager.

    Raises :class:`SourceError` when the port cannot be had.
    """

    def __init__(self, settings: StatusSection, picture: Picture, title: str) -> None:
        self._settings, self._picture, self._title = settings, picture, title
        self._front = WebFront("status page", LOOPBACK, settings.port, self._serve)

    @property
    def address(self) -> str:
        return f"http://{LOOPBACK}:{self._settings.port}/"

    def __enter__(self) -> StatusPage:
        try:
            self._front.__enter__()
        except OSError as error:
            what = f"the status page cannot be served on {LOOPBACK}:{self._settings.port}"
            fix = "stop the program that uses the port, or give another in [status]"
            raise SourceError(what, why=str(error.strerror), fix=fix) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._front.__exit__()

    def _serve(self, client: socket.socket, request: Request) -> None:
        if request.method != "GET":
            raise RefusalError(HTTPStatus.NOT_IMPLEMENTED)
        kind, body = self._answer(request.path)
        client.sendall(response(HTTPStatus.OK, body, kind, **_HEADERS))

    def _answer(self, path: str) -> tuple[str, bytes]:
        """The kind and the bytes of what lies at a path. Raises :class:`RefusalError` where nothing does."""
        if path == "/":
            return "text/html; charset=utf-8", page(self._picture, self._title).encode()
        if path == "/status.json":
            return "application/json", as_json(self._picture.health)
        raise RefusalError(HTTPStatus.NOT_FOUND)
