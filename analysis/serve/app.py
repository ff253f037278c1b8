"""The pages of a season: who may ask for them, what lies at which address, and what is said when nothing does.

Nothing is served but to this computer under its own name, and no page may fetch from elsewhere or run a script
that is not ours. A name in an address is looked up among the recordings and never becomes a path by itself.
"""

from __future__ import annotations

import json
import logging
import secrets
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import BoundedSemaphore, Lock
from typing import Any
from urllib.parse import quote, urlsplit

import pandas as pd
from flask import Flask, Response, abort, g, request
from werkzeug.exceptions import HTTPException
from werkzeug.serving import ThreadedWSGIServer, WSGIRequestHandler

from seatrial.acquisition.core.errors import InputError, SeatrialError, SourceError, printable_name, unexpected
from seatrial.acquisition.logger.health import LOG
from seatrial.acquisition.recording.grouping import read_parts
from seatrial.analysis.batch.batch import failures_of
from seatrial.analysis.batch.one_recording import WAITING, Row
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from seatrial.analysis.manoeuvres.report import rows_of
from seatrial.analysis.prepare import Preparation, prepare
from seatrial.analysis.report.pages import index_page
from seatrial.analysis.report.rendering import environment, render
from seatrial.analysis.serve.limited import call_limited
from seatrial.analysis.serve.season import Season
from seatrial.analysis.serve.uploads import receive
from seatrial.analysis.tables.export import KINDS, export_table, write_sheets
from seatrial.analysis.tables.files import read_parquet

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")
MOST_CLIENTS = 64
"""Requests that are answered at once; browsers have six under way."""
MOST_RUNS = 40
"""Runs that are drawn over each other; more cannot be told apart."""
LINKS = "<!--links-->"
"""Where a recording's page has room for the way back, its exports and its diagnosis."""
_MEGA = 1_000_000
_POLICY = (
    "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; script-src 'nonce-{}'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "same-origin", "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip
_drawing = Lock()  # matplotlib keeps its style for the whole process


def make_app(season: Season, upload_mb: float | None = None) -> Flask:
    """The pages of a season; with ``upload_mb`` [MB] files up to that size may be sent, else it is read only."""
    app, token = Flask("seatrial", static_folder=None, template_folder=None), secrets.token_urlsafe()
    app.config.update(
        TRUSTED_HOSTS=list(NAMES), MAX_CONTENT_LENGTH=int(_MEGA * (upload_mb or 0.1)), MAX_FORM_PARTS=4
    )
    app.before_request(_new_nonce)
    app.after_request(_secured)
    app.register_error_handler(SeatrialError, lambda error: (_message("This cannot be done", [str(error)]), 422))
    app.register_error_handler(HTTPException, _explained)
    app.register_error_handler(Exception, _unexpected_error)
    pages = _Pages(season, upload_mb, token)
    environment()  # what pages are drawn with, before anybody waits
    for path, page in pages.addresses().items():
        app.add_url_rule(path, path, page)
    if upload_mb is not None:
        app.add_url_rule("/upload", "upload", pages.upload, methods=["POST"])
    return app


def serve(app: Flask, port: int, ready: Callable[[str], object]) -> None:
    """Answer requests of this computer until interrupted; ``ready`` hears the address.

    Raises :class:`SourceError` where the port cannot be had.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # the terminal is for what goes wrong
    try:
        listening = socket.create_server((ADDRESS, port))
    except OSError as error:
        raise SourceError(
            f"cannot listen on {ADDRESS}:{port}", why=error.strerror or str(error),
            fix="stop the program that uses the port, or give another --port",
        ) from error  # fmt: skip
    port = listening.getsockname()[1]
    with listening, _Server(ADDRESS, port, app, _Handler, fd=listening.fileno()) as server:
        ready(f"http://{ADDRESS}:{port}/")
        server.serve_forever()


class _Handler(WSGIRequestHandler):
    """Waits for a client that says nothing, or takes nothing, no longer than this [s]."""

    timeout = 10.0


class _Server(ThreadedWSGIServer):
    """Answers each request in a thread of its own, up to a number of them; of more it hangs up."""

    daemon_threads = True

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._turns = BoundedSemaphore(MOST_CLIENTS)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._turns.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._turns.release()


class _Pages:
    """What lies at each address."""

    def __init__(self, season: Season, upload_mb: float | None, token: str) -> None:
        self._season, self._upload_mb, self._token = season, upload_mb, token
        self._receiving = Lock()

    def addresses(self) -> dict[str, Callable[..., Any]]:
        return {
            "/": self.index,
            "/favicon.ico": lambda: Response(status=204),
            "/runs.html": self.runs,
            "/runs.xlsx": self.runs_as_workbook,
            "/<path:name>/page.html": self.trial,
            "/<path:name>/report.html": self.report,
            "/<path:name>/diagnosis.html": self.diagnosis,
            "/<path:name>/export.<kind>": self.export,
        }

    def index(self) -> str:
        rows = self._season.rows()
        waiting = sum(row["status"] == WAITING for row in rows)
        live = {"nonce": g.nonce, "token": self._token, "upload_mb": self._upload_mb, "waiting": waiting}
        rows = [{**row, "report": (self._season.out / row["name"] / "report.html").is_file()} for row in rows]
        return index_page(rows, failures_of(rows), self._season.folder.resolve().name, live).html

    def trial(self, name: str) -> str:
        row = self._row_of(name)
        if row["status"] == WAITING:
            return self._wait(name)
        if "provenance" not in row:
            return _message(name, [row["cause"]])
        try:
            page = (self._season.out / name / "page.html").read_text(encoding="utf-8")
        except FileNotFoundError:
            return self._wait(name, anew=True)
        links = render("links_of_trial.html", row=row, kinds=[kind[1:] for kind in KINDS]).html
        return page.replace(LINKS, links, 1)

    def report(self, name: str) -> str:
        self._row_of(name)
        return _read_page(self._season.out / name / "report.html")

    def diagnosis(self, name: str) -> str:
        _, folder = self._season.diagnosis_of(self._row_of(name))
        return _read_page(folder / "report.html" if folder else None)

    def export(self, name: str, kind: str) -> Response:
        if f".{kind}" not in KINDS:
            abort(404)
        self._row_of(name)
        files = [str(path) for path in self._season.files(name)]
        return _attached(f"{Path(name).name}.{kind}", lambda path: call_limited(export_recording, files, str(path)))

    def runs(self) -> str:
        runs = runs_in(self._season.out, self._requested_names(), kind := request.args.get("kind", ""))
        if not runs:
            return _message("No runs", ["None of these recordings holds such a manoeuvre."])
        drawn = [
            (run.label, motion, run.manoeuvre) for run, motion in with_motions(self._season.out, runs[:MOST_RUNS])
        ]
        header, rows = compared(runs)
        with _drawing:
            return render(
                "runs.html", title=f"Runs: {kind.replace('_', ' ') or 'all manoeuvres'}", runs=drawn,
                header=header, rows=rows, workbook=f"runs.xlsx?{request.query_string.decode()}",
                left_out=len(runs) - len(drawn),
            ).html  # fmt: skip

    def runs_as_workbook(self) -> Response:
        runs = runs_in(self._season.out, self._requested_names(), request.args.get("kind", ""))
        return _attached("runs.xlsx", lambda path: write_sheets({"indices": index_table(runs)}, path))

    def upload(self) -> str:
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            abort(403)
        if not self._receiving.acquire(blocking=False):  # before a byte of it is stored
            abort(503, "Another file is being received; send it again afterwards.")
        try:
            return self._receive()
        finally:
            self._receiving.release()

    def _receive(self) -> str:
        if not secrets.compare_digest(request.form.get("token", "").encode(), self._token.encode()):
            abort(403)
        if (upload := request.files.get("file")) is None:
            abort(400)
        path, lines = receive(upload.stream, upload.filename or "", self._season.folder)
        return _message(f"{path.name} is in the season", lines)

    def _requested_names(self) -> list[str]:
        """The recordings that a request names, of those that have a result; all that have one if it names none."""
        done = {row["name"] for row in self._season.rows() if "provenance" in row}
        return [name for name in request.args.getlist("name") or sorted(done) if name in done]

    def _row_of(self, name: str) -> Row:
        row = self._season.row(name)
        return row if row is not None else abort(404)

    def _wait(self, name: str, *, anew: bool = False) -> str:
        self._season.ask(name, anew=anew)
        return _message(name, ["It is being analysed; this page shows it as soon as it is done."], again_s=2)


def _read_page(path: Path | None) -> str:
    if path is None or not path.is_file():
        abort(404)
    return path.read_text(encoding="utf-8")


def export_recording(files: Sequence[str], path: str) -> list[str]:
    """Write a recording, a file or its parts, as the table of its kind, once a second and repaired."""
    table = prepare(read_parts([Path(file) for file in files]), Preparation(rate_hz=1.0, repair=True))
    export_table(table, Path(path), {"rate_hz": 1.0})
    return []


def _attached(name: str, write: Callable[[Path], object]) -> Response:
    """A file to be kept, as ``write`` makes it."""
    with TemporaryDirectory(prefix="seatrial-") as folder:
        path = Path(folder) / f"made{Path(name).suffix}"
        write(path)
        content = path.read_bytes()
    named = f"attachment; filename*=UTF-8''{quote(name)}"
    return Response(content, headers={"Content-Disposition": named}, mimetype="application/octet-stream")


def _message(title: str, lines: list[str], again_s: int | None = None) -> str:
    return render("message.html", title=title, lines=lines, again_s=again_s).html


def _explained(error: HTTPException) -> tuple[str, int]:
    return _message(error.name, [error.description or ""]), error.code or 500


def _unexpected_error(error: Exception) -> tuple[str, int]:
    """What nobody foresaw, as a page with one line, which the terminal has too."""
    fault = unexpected(error)
    LOG.error("%s: %s", printable_name(request.path), fault)
    return _message("This page failed", [str(fault), "The other pages are not affected."]), 500


def _new_nonce() -> None:
    g.nonce = secrets.token_urlsafe()


def _secured(response: Response) -> Response:
    response.headers.extend({**_HEADERS, "Content-Security-Policy": _POLICY.format(g.get("nonce", "none"))})
    return response


_RUN_COLUMNS = [
    "recording", "started [UTC]", "kind", "manoeuvre", "index", "value", "low", "high", "unit", "lengths", "limit",
    "counted_from", "result", "missing",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Run:
    """One manoeuvre in a recording's result."""

    recording: str
    manoeuvre: Manoeuvre

    @property
    def label(self) -> str:
        return f"{self.recording}, {self.manoeuvre.start:%H:%M:%S} {self.manoeuvre.sided_name}"


def runs_in(results: Path, names: Iterable[str], kind: str = "") -> list[Run]:
    """The manoeuvres of a kind, or of all, in the results of recordings. Raises :class:`InputError`."""
    runs = []
    for name in names:
        path = results / name / "manoeuvres.json"
        try:
            records = json.loads(path.read_text(encoding="utf-8"))["manoeuvres"]
            manoeuvres = [Manoeuvre.from_json(record) for record in records if kind in ("", record["kind"])]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError("are not the manoeuvres of a batch", where=str(path), why=str(error)) from error
        runs += [Run(name, manoeuvre) for manoeuvre in manoeuvres]
    return runs


def with_motions(results: Path, runs: Iterable[Run]) -> list[tuple[Run, Motion]]:
    """The runs, each with the motion of its recording once a second, as its result has it."""
    motions: dict[str, Motion] = {}
    for run in runs:
        if run.recording not in motions:
            table, metadata = read_parquet(results / run.recording / "table.parquet")
            table.attrs["trial"] = json.loads(metadata["trial"])
            motions[run.recording] = motion_of(table)
    return [(run, motions[run.recording]) for run in runs]


def compared(runs: Sequence[Run]) -> tuple[list[str], list[list[str]]]:
    """A table for people: a row a run, a column each of the main indices that any has."""
    names = list(dict.fromkeys(row[0] for run in runs for row in rows_of(run.manoeuvre, every=False)))
    cells = [(run.label, {row[0]: row[1] for row in rows_of(run.manoeuvre)}) for run in runs]
    return ["run", *names], [[label, *(values.get(name, "") for name in names)] for label, values in cells]


def index_table(runs: Iterable[Run]) -> pd.DataFrame:
    """A row each index of each run, for a workbook: value, 95 % interval, unit, IMO's limit."""
    rows = [
        {"recording": run.recording, "started [UTC]": run.manoeuvre.start.tz_localize(None),
         "kind": run.manoeuvre.kind, "manoeuvre": run.manoeuvre.sided_name, "index": name, **index.as_json(),
         "missing": "; ".join(index.missing)}
        for run in runs for name, index in run.manoeuvre.indices.items()
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=_RUN_COLUMNS)
