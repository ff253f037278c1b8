"""The status page: what the terminal shows, as a page that renews itself and as JSON, for this computer only.

It is read-only: GET of two paths, bound to 127.0.0.1, for nobody who calls this computer by another name (a page
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

from acquisition.config.sections import StatusSection
from acquisition.core.errors import SourceError
from acquisition.core.frames import iso
from acquisition.logger.display import Picture
from acquisition.logger.health import Health

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
        """Where a browser finds it."""
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
