"""What is being recorded, for those who look from elsewhere: the live view and the status page.

The live view serves Foxglove and Lichtblick over a WebSocket. It hears every message after the recorder has written
it and hands it to the server's own threads, which drop the oldest for a viewer that is too slow. Raw input is not
served: nobody looks at it, and it is most of the load.

The status page is what the terminal shows, as a page that renews itself and as JSON, for this computer only. It is
read-only: GET of two paths, bound to 127.0.0.1, for nobody who calls this computer by another name (a page
elsewhere could have its name point here).
"""

from __future__ import annotations

import html
import io
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer
from typing import Any

import orjson

from acquisition.config.sections import LiveSection, StatusSection
from acquisition.core.channels import channels_known_to
from acquisition.core.errors import ConfigurationError, SourceError
from acquisition.core.frames import iso
from acquisition.core.trial import Trial
from acquisition.logger.display import Picture
from acquisition.logger.health import Health
from acquisition.recording.messages import ENCODING
from acquisition.recording.schemas import RAW_PREFIX, channel_metadata, kind_of

_BACKLOG = 256  # messages a viewer may lag behind: some seconds
ADDRESS = "127.0.0.1"
_OUR_NAMES = (ADDRESS, "localhost")
_COLUMNS, _ROWS = 120, 60
_REQUEST_TIMEOUT_S = 2.0  # one is answered after the other: none may take long
_POLL_S = 0.2
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
        self._known = channels_known_to(trial)
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
        try:
            self._server = foxglove.start_server(
                name=self._name, host=address, port=port, context=self._context, message_backlog_size=_BACKLOG
            )
        except Exception as error:  # the package promises no kind of error
            what = f"the live view cannot be served on {address}:{port}"
            fix = "stop the program that uses the port, or give another in [live]"
            raise SourceError(what, why=str(error), fix=fix) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()

    @property
    def address(self) -> str:
        return f"ws://{self._settings.address}:{self._server.port}"

    def publish(self, topic: str, data: bytes, log_ns: int) -> None:
        """Pass a message on to whoever looks."""
        if topic.startswith(RAW_PREFIX):
            return
        channel = self._channels.get(topic) or self._open(topic)
        channel.log(data, log_time=max(log_ns, 0))

    def _open(self, topic: str) -> Any:
        kind = kind_of(topic)
        schema = self._sdk.Schema(name=kind.title, encoding=ENCODING, data=kind.descriptors)
        metadata = channel_metadata(topic, self._known)
        self._channels[topic] = self._sdk.Channel(
            topic, schema=schema, message_encoding=ENCODING, metadata=metadata, context=self._context
        )
        return self._channels[topic]


def page(picture: Picture, title: str) -> str:
    """What the terminal shows, as a page."""
    from rich.console import Console

    console = Console(record=True, file=io.StringIO(), width=_COLUMNS, height=_ROWS, force_terminal=True)
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


class _Server(TCPServer):
    allow_reuse_address = True


class StatusPage:
    """A server of the page while a recording runs; a context manager.

    Raises :class:`SourceError` when the port cannot be had.
    """

    def __init__(self, settings: StatusSection, picture: Picture, title: str) -> None:
        self._settings, self._picture, self._title = settings, picture, title

    @property
    def address(self) -> str:
        return f"http://{ADDRESS}:{self._settings.port}/"

    def __enter__(self) -> StatusPage:
        try:
            self._server = _Server((ADDRESS, self._settings.port), _handler(self._answer))
        except OSError as error:
            what = f"the status page cannot be served on {ADDRESS}:{self._settings.port}"
            fix = "stop the program that uses the port, or give another in [status]"
            raise SourceError(what, why=str(error.strerror), fix=fix) from error
        threading.Thread(
            target=self._server.serve_forever, args=(_POLL_S,), name="status page", daemon=True
        ).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, path: str) -> tuple[str, bytes] | None:
        """The kind and the bytes of what lies at a path; None for a path of which there is nothing."""
        if path == "/":
            return "text/html; charset=utf-8", page(self._picture, self._title).encode()
        return ("application/json", as_json(self._picture.health)) if path == "/status.json" else None


def _handler(answer: Callable[[str], tuple[str, bytes] | None]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = _REQUEST_TIMEOUT_S

        def do_GET(self) -> None:
            if self.headers.get("Host", "").rpartition(":")[0] not in _OUR_NAMES:
                self.send_error(HTTPStatus.FORBIDDEN)
                return
            found = answer(self.path)
            if found is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            kind, body = found
            self.send_response(HTTPStatus.OK)
            for name, value in {**_HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *arguments: Any) -> None:
            """Nothing: the log is the recording's."""

    return Handler
