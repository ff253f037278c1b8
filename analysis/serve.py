"""A season served as pages: the recordings below a folder, each analysed on request, and uploads of more.

Pages are served only to this computer under its own name, and no page may fetch from elsewhere or run a script that
is not ours. A name in an address is looked up among the recordings and never becomes a path by itself.

The results of a season are those of a batch, in a folder that a batch may have written or may take over. The row of
each recording is stored there too, by the names, sizes and times of its files, so that thousands are listed without
opening one. One separate process analyses, so that neither a long recording nor one that kills its worker blocks
the pages.

Uploaded files are read in a process of their own, under limits of memory, time and what it writes: a file may hold
more than memory does, never end, or crash the program that reads it in native code. The answer is then one line.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import secrets
import shutil
import signal
import socket
import sqlite3
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from queue import PriorityQueue
from tempfile import TemporaryDirectory
from typing import IO, Any
from urllib.parse import quote, urlsplit

import pandas as pd
from flask import Flask, Response, abort, g, request
from werkzeug.exceptions import HTTPException
from werkzeug.serving import ThreadedWSGIServer, WSGIRequestHandler
from werkzeug.utils import secure_filename

from seatrial.acquisition.core import errors
from seatrial.acquisition.core.files import atomic_file, lock_for_replacement, make_folder
from seatrial.acquisition.core.trial import software_version
from seatrial.acquisition.logger.health import LOG
from seatrial.acquisition.recording.reader import read_parts_of_recording, read_recording
from seatrial.acquisition.tables import import_table, table_files
from seatrial.analysis import batch, products
from seatrial.analysis.manoeuvres import indices, motion
from seatrial.analysis.quality.repairs import Preparation, prepare_table
from seatrial.analysis.report.pages import index_page, render, template_environment
from seatrial.analysis.report.tables import index_rows_of_manoeuvre
from seatrial.analysis.tables.export import KINDS, export_table, read_parquet, write_sheets
from seatrial.analysis.tables.table import channels_of

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")
MOST_CLIENTS = 64
"""Requests that are answered at once; browsers have six under way."""
MOST_RUNS = 40
"""Runs that are drawn in one figure; more cannot be distinguished."""
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
_drawing = threading.Lock()  # matplotlib keeps its style for the whole process
_RUN_COLUMNS = [
    "recording", "started [UTC]", "kind", "manoeuvre", "index", "value", "low", "high", "unit", "lengths", "limit",
    "counted_from", "result", "missing",
]  # fmt: skip
REQUESTED, FIRST_LOOK, BACKGROUND = range(3)
"""The order of work: what a user waits for, a first look at each recording, the analysis of the others."""
SETTLED_S = 20.0
"""A file that has changed since is still being written, and is analysed only on request."""
DIAGNOSIS = "diagnosis.json"
_STORE = ".season.sqlite"
_NICENESS = 10
_CREATE = "CREATE TABLE IF NOT EXISTS season (name TEXT PRIMARY KEY, stamp TEXT, row TEXT)"
_REPLACE = "INSERT OR REPLACE INTO season VALUES (?, ?, ?)"
_LONGEST_S = 3600.0  # an analysis: the recording of a day takes some minutes
_DIED = "its worker died over it, or took an hour; too little memory, or a fault in native code"
_MOST_DIAGNOSIS_BYTES = 64_000_000  # one of a season of forty recordings has a few MB
LONGEST_S = 600.0
"""An export of a day takes a minute, the import of 500 MB of text some minutes."""
LEAST_MEMORY_BYTES = 3 * 1024**3  # of addresses; the libraries alone take 1.5 GB of them
MOST_WRITTEN_BYTES = 8 * 1024**3
MOST_AT_ONCE = 2
_turns = threading.BoundedSemaphore(MOST_AT_ONCE)
_Work = Callable[..., Sequence[str]]
_LONGEST_NAME_BYTES = 200  # of 255, for what is added while it is written


def make_app(season: Season, upload_mb: float | None = None) -> Flask:
    """The pages of a season; with ``upload_mb`` [MB] files up to that size may be sent, else it is read only."""
    app, token = Flask("seatrial", static_folder=None, template_folder=None), secrets.token_urlsafe()
    app.config.update(
        TRUSTED_HOSTS=list(NAMES), MAX_CONTENT_LENGTH=int(_MEGA * (upload_mb or 0.1)), MAX_FORM_PARTS=4
    )

    def add_headers(response: Response) -> Response:
        policy = _POLICY.format(g.get("nonce", "none"))
        response.headers.extend({**_HEADERS, "Content-Security-Policy": policy})
        return response

    def failure_page(error: Exception) -> tuple[str, int]:
        fault = errors.unexpected_error(error)
        LOG.error("%s: %s", errors.printable_path(request.path), fault)
        return _message_page("This page failed", [str(fault), "The other pages are not affected."]), 500

    app.before_request(lambda: setattr(g, "nonce", secrets.token_urlsafe()))
    app.after_request(add_headers)
    app.register_error_handler(
        errors.SeatrialError, lambda error: (_message_page("This cannot be done", [str(error)]), 422)
    )
    app.register_error_handler(
        HTTPException, lambda error: (_message_page(error.name, [error.description or ""]), error.code or 500)
    )
    app.register_error_handler(Exception, failure_page)
    pages = _Pages(season, upload_mb, token)
    template_environment()  # what pages are drawn with, before the first request
    addresses: dict[str, Callable[..., Any]] = {
        "/": pages.index,
        "/favicon.ico": lambda: Response(status=204),
        "/runs.html": pages.runs,
        "/runs.xlsx": pages.runs_as_workbook,
        "/<path:name>/page.html": pages.trial,
        "/<path:name>/report.html": pages.report,
        "/<path:name>/diagnosis.html": pages.diagnosis,
        "/<path:name>/export.<kind>": pages.export,
    }
    for path, page in addresses.items():
        app.add_url_rule(path, path, page)
    if upload_mb is not None:
        app.add_url_rule("/upload", "upload", pages.upload, methods=["POST"])
    return app


def serve(app: Flask, port: int, ready: Callable[[str], object]) -> None:
    """Answer requests of this computer until interrupted; ``ready`` is called with the address.

    Raises :class:`SourceError` where the port cannot be had.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # the terminal is for what goes wrong
    try:
        listening = socket.create_server((ADDRESS, port))
    except OSError as error:
        raise errors.SourceError(
            f"cannot listen on {ADDRESS}:{port}", why=error.strerror or str(error),
            fix="stop the program that uses the port, or give another --port",
        ) from error  # fmt: skip
    port = listening.getsockname()[1]
    with listening, _Server(ADDRESS, port, app, _Handler, fd=listening.fileno()) as server:
        ready(f"http://{ADDRESS}:{port}/")
        server.serve_forever()


class _Handler(WSGIRequestHandler):
    """Waits no longer than this for a client that sends or takes nothing [s]."""

    timeout = 10.0


class _Server(ThreadedWSGIServer):
    """Answers each request in a thread of its own, up to a number of them; further connections are closed."""

    daemon_threads = True

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._turns = threading.BoundedSemaphore(MOST_CLIENTS)

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
    """The page at each address."""

    def __init__(self, season: Season, upload_mb: float | None, token: str) -> None:
        self._season, self._upload_mb, self._token = season, upload_mb, token
        self._receiving = threading.Lock()

    def index(self) -> str:
        rows = self._season.rows()
        waiting = sum(row["status"] == batch.WAITING for row in rows)
        served = {"nonce": g.nonce, "token": self._token, "upload_mb": self._upload_mb, "waiting": waiting}
        rows = [{**row, "report": (self._season.out / row["name"] / "report.html").is_file()} for row in rows]
        return index_page(rows, batch.failures_by_cause(rows), self._season.folder.resolve().name, served).html

    def trial(self, name: str) -> str:
        row = self._row_of(name)
        if row["status"] == batch.WAITING:
            return self._waiting_page(name)
        if "provenance" not in row:
            return _message_page(name, [row["cause"]])
        try:
            page = (self._season.out / name / "page.html").read_text(encoding="utf-8")
        except FileNotFoundError:
            return self._waiting_page(name, again=True)
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
        return _download_response(f"{Path(name).name}.{kind}",
                           lambda path: call_in_limited_process(export_recording, files, str(path)))  # fmt: skip

    def runs(self) -> str:
        out, kind = self._season.out, request.args.get("kind", "")
        runs = runs_in_results(out, self._requested_names(), kind)
        if not runs:
            return _message_page("No runs", ["None of these recordings holds such a manoeuvre."])
        motions: dict[str, motion.Motion] = {}  # of the recordings once a second, as their results have them
        for run in runs[:MOST_RUNS]:
            if run.recording not in motions:
                table, metadata = read_parquet(out / run.recording / "table.parquet")
                table.attrs["trial"] = json.loads(metadata["trial"])
                motions[run.recording] = motion.motion_of(table)
        drawn = [(run.label, motions[run.recording], run.manoeuvre) for run in runs[:MOST_RUNS]]
        main = (row[0] for run in runs for row in index_rows_of_manoeuvre(run.manoeuvre, all_indices=False))
        names, rows = list(dict.fromkeys(main)), []
        for run in runs:
            values = {row[0]: row[1] for row in index_rows_of_manoeuvre(run.manoeuvre)}
            rows.append([run.label, *(values.get(name, "") for name in names)])
        with _drawing:
            return render(
                "runs.html", title=f"Runs: {kind.replace('_', ' ') or 'all manoeuvres'}", runs=drawn,
                header=["run", *names], rows=rows, workbook=f"runs.xlsx?{request.query_string.decode()}",
                left_out=len(runs) - len(drawn),
            ).html  # fmt: skip

    def runs_as_workbook(self) -> Response:
        runs = runs_in_results(self._season.out, self._requested_names(), request.args.get("kind", ""))
        return _download_response("runs.xlsx", lambda path: write_sheets({"indices": index_table(runs)}, path))

    def upload(self) -> str:
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            abort(403)
        if not self._receiving.acquire(blocking=False):  # before a byte of it is stored
            abort(503, "Another file is being received; send it again afterwards.")
        try:
            if not secrets.compare_digest(request.form.get("token", "").encode(), self._token.encode()):
                abort(403)
            if (upload := request.files.get("file")) is None:
                abort(400)
            path, lines = receive_upload(upload.stream, upload.filename or "", self._season.folder)
            return _message_page(f"{path.name} is in the season", lines)
        finally:
            self._receiving.release()

    def _requested_names(self) -> list[str]:
        """The recordings that a request names, of those that have a result; all that have one if it names none."""
        done = {row["name"] for row in self._season.rows() if "provenance" in row}
        return [name for name in request.args.getlist("name") or sorted(done) if name in done]

    def _row_of(self, name: str) -> batch.Row:
        row = self._season.row(name)
        return row if row is not None else abort(404)

    def _waiting_page(self, name: str, *, again: bool = False) -> str:
        self._season.ask(name, again=again)
        return _message_page(name, ["It is being analysed; this page shows it as soon as it is done."], again_s=2)


def _read_page(path: Path | None) -> str:
    if path is None or not path.is_file():
        abort(404)
    return path.read_text(encoding="utf-8")


def export_recording(files: Sequence[str], path: str) -> list[str]:
    """Write a recording, a file or its parts, as the table of its kind, once a second and repaired."""
    table = prepare_table(
        read_parts_of_recording([Path(file) for file in files]), Preparation(rate_hz=1.0, repair=True)
    )
    export_table(table, Path(path), {"rate_hz": 1.0})
    return []


def _download_response(name: str, write: Callable[[Path], object]) -> Response:
    """A download of the file that ``write`` writes."""
    with TemporaryDirectory(prefix="seatrial-") as folder:
        path = Path(folder) / f"made{Path(name).suffix}"
        write(path)
        content = path.read_bytes()
    disposition = f"attachment; filename*=UTF-8''{quote(name)}"
    return Response(content, headers={"Content-Disposition": disposition}, mimetype="application/octet-stream")


def _message_page(title: str, lines: list[str], again_s: int | None = None) -> str:
    return render("message.html", title=title, lines=lines, again_s=again_s).html


@dataclass(frozen=True, slots=True)
class Run:
    """One manoeuvre in a recording's result."""

    recording: str
    manoeuvre: indices.Manoeuvre

    @property
    def label(self) -> str:
        return f"{self.recording}, {self.manoeuvre.start:%H:%M:%S} {self.manoeuvre.sided_name}"


def runs_in_results(results: Path, names: Iterable[str], kind: str = "") -> list[Run]:
    """The manoeuvres of a kind, or of all, in the results of recordings. Raises :class:`InputError`."""
    runs = []
    for name in names:
        path = results / name / "manoeuvres.json"
        try:
            records = json.loads(path.read_text(encoding="utf-8"))["manoeuvres"]
            manoeuvres = [indices.Manoeuvre.from_json(record) for record in records if kind in ("", record["kind"])]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise errors.InputError("are not the manoeuvres of a batch", where=str(path), why=str(error)) from error
        runs += [Run(name, manoeuvre) for manoeuvre in manoeuvres]
    return runs


def index_table(runs: Iterable[Run]) -> pd.DataFrame:
    """A row each index of each run, for a workbook: value, 95 % interval, unit, IMO's limit."""
    rows = [
        {"recording": run.recording, "started [UTC]": run.manoeuvre.start.tz_localize(None),
         "kind": run.manoeuvre.kind, "manoeuvre": run.manoeuvre.sided_name, "index": name, **index.as_json(),
         "missing": "; ".join(index.missing)}
        for run in runs for name, index in run.manoeuvre.indices.items()
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=_RUN_COLUMNS)


def results_folder(folder: Path) -> Path:
    """The default folder of a season's results: one for each season in the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "seatrial" / hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:16]


class Season:
    """The recordings below ``folder`` and their results in ``out``; a context manager.

    ``eager`` analyses all of them, one after the other; without it those that are asked for. Raises
    :class:`InputError` for what is no folder, :class:`StorageError` where ``out`` cannot be written.
    """

    def __init__(
        self, folder: Path, out: Path, options: products.Options | None = None, *, eager: bool = True,
        settled_s: float = SETTLED_S,
    ) -> None:  # fmt: skip
        self.folder, self.out, self._options = folder, out.resolve(), options or products.Options()
        if folder.resolve().is_relative_to(self.out):
            raise errors.InputError(
                "the recordings are in the folder of the results", where=str(out), fix="name another"
            )
        self._eager, self._settled_s = eager, settled_s
        self._files: dict[str, tuple[Path, ...]] = {}
        self._diagnoses: list[tuple[int, str, frozenset[str], Path]] = []
        self._requests: PriorityQueue[tuple[int, int, str]] = PriorityQueue()
        self._requested: set[tuple[int, str]] = set()
        self._number, self._lock, self._worker = count(), threading.RLock(), _Worker()
        self._ended = False

    def __enter__(self) -> Season:
        batch.recordings_below(self.folder, self.out)  # which says what is no folder
        make_folder(self.out)
        try:
            with ExitStack() as closing:
                self._store = sqlite3.connect(self.out / _STORE, check_same_thread=False)
                closing.callback(self._store.close)
                self._store.execute(_CREATE)
                rows = self._store.execute("SELECT name, stamp, row FROM season")
                self._stored = {name: (stamp, json.loads(row)) for name, stamp, row in rows}
                closing.pop_all()
        except sqlite3.Error as error:
            raise errors.StorageError("cannot be used", where=str(self.out / _STORE), why=str(error),
                               fix="remove it, or name another folder with -o") from error  # fmt: skip
        self.rows()
        threading.Thread(target=self._serve_requests, name="season", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._ended = True
            self._store.close()
        self._requests.put((-1, 0, ""))
        self._worker.stop()

    def rows(self) -> list[batch.Row]:
        """A row for each recording as in the index of a batch; of one not analysed that of a first look, if any."""
        with self._lock:
            recordings = batch.recordings_below(self.folder, self.out)
            self._files = dict(zip(batch.result_names(self.folder, recordings), recordings, strict=True))
            states = {path: _size_and_mtime(path) for path in self.folder.rglob(DIAGNOSIS)}
            self._diagnoses = [
                (state[1], *_read_diagnosis(path, state), path.parent) for path, state in states.items()
            ]
            return [self._row(name) for name in self._files]

    def row(self, name: str) -> batch.Row | None:
        """The row of a recording by its name, as :meth:`rows`; None where there is none of that name."""
        with self._lock:
            if name not in self._files:
                self.rows()
            return self._row(name) if name in self._files else None

    def files(self, name: str) -> tuple[Path, ...]:
        """The files of a recording that :meth:`row` knows."""
        return self._files[name]

    def ask(self, name: str, *, again: bool = False) -> None:
        """Have a recording analysed next; ``again`` where its result is not there any more."""
        with self._lock:
            if again:
                self._stored.pop(name, None)
            self._request(REQUESTED, name)

    def diagnosis_of(self, row: batch.Row) -> tuple[str, Path | None]:
        """Verdict and folder of the newest diagnosis that a recording took part in."""
        digests = set(row.get("provenance", {}).get("sha256", "").split(", ")) - {""}
        diagnoses = [(changed, verdict, folder) for changed, verdict, recordings, folder in self._diagnoses
                     if recordings & digests]  # fmt: skip
        return max(diagnoses, default=(0, "", None))[1:]

    def _row(self, name: str) -> batch.Row:
        stamp, row = self._stored.get(name, ("", None))
        if row is None or stamp != self._fingerprint(name):
            self._request(FIRST_LOOK, name)
            row = {"status": batch.WAITING, "cause": ""}
        elif row["status"] == batch.WAITING and self._eager:
            newest_ns = max(_size_and_mtime(path)[1] for path in self._files[name])
            if time.time() - newest_ns / 1e9 > self._settled_s:
                self._request(BACKGROUND, name)
        path = self._files[name][0].relative_to(self.folder).as_posix()
        return {**row, "name": name, "path": path, "verdict": self.diagnosis_of(row)[0]}

    def _fingerprint(self, name: str) -> str:
        """What a row depends on: the files' names, sizes and times, the options and the version."""
        states = [(path.name, *_size_and_mtime(path)) for path in self._files[name]]
        return repr((states, self._options, software_version()))

    def _request(self, urgency: int, name: str) -> None:
        if (urgency, name) not in self._requested:
            self._requested.add((urgency, name))
            self._requests.put((urgency, next(self._number), name))

    def _serve_requests(self) -> None:
        """One request after the other, until the season ends."""
        while True:
            urgency, _, name = self._requests.get()
            if urgency < 0:
                return
            with self._lock:
                self._requested.discard((urgency, name))
                if name not in self._files:
                    continue
                stamp, files = self._fingerprint(name), self._files[name]
                stored_stamp, row = self._stored.get(name, ("", {}))
            if stored_stamp == stamp and (urgency == FIRST_LOOK or row["status"] != batch.WAITING):
                continue
            first, *later = map(str, files)
            job = batch.BatchJob(name, first, str(self.out), self._options, later=tuple(later))
            row = self._worker.row_of(
                batch.row_before_analysis if urgency == FIRST_LOOK else batch.reuse_or_process, job
            )
            with self._lock:
                if self._ended:
                    return
                self._stored[name] = stamp, batch.failed_row(job, _DIED) if row is None else row
                if row is not None:  # one that killed its worker is tried again after the next start
                    self._store.execute(_REPLACE, (name, stamp, json.dumps(row)))
                    self._store.commit()


@lru_cache(maxsize=10_000)
def _read_diagnosis(path: Path, state: tuple[int, int]) -> tuple[str, frozenset[str]]:
    """Verdict and hashes of the recordings of a diagnosis in a ``state``; empty for another file."""
    if state[0] > _MOST_DIAGNOSIS_BYTES or not path.is_file():
        return "", frozenset()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        return str(document["verdict"]), frozenset(str(document["provenance"]["recordings_sha256"]).split(", "))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "", frozenset()


def _size_and_mtime(path: Path) -> tuple[int, int]:
    """Size [bytes] and time of change [ns]; zeros for a file that has gone."""
    with suppress(OSError):
        state = path.stat()
        return state.st_size, state.st_mtime_ns
    return 0, 0


class _Worker:
    """A process that makes rows of jobs, one at a time; another takes its place when it dies."""

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None

    def row_of(self, work: Callable[[batch.BatchJob], batch.Row], job: batch.BatchJob) -> batch.Row | None:
        """The row that ``work`` makes of a job, or of its failure; None where it kills the process or hangs."""
        if self._process is None:
            context = get_context("spawn")
            self._pipe, worker_end = context.Pipe()
            self._process = context.Process(target=_attend_requests, args=(worker_end,), daemon=True)
            self._process.start()
            worker_end.close()
        try:
            self._pipe.send((work, job))
            if not self._pipe.poll(_LONGEST_S):
                raise TimeoutError
            row: batch.Row = self._pipe.recv()
        except (EOFError, OSError):
            self._process.kill()
            self._process = None
            return None
        return row

    def stop(self) -> None:
        if self._process is not None and self._process.is_alive():
            self._process.kill()


def _attend_requests(pipe: Connection) -> None:
    """The worker's loop: jobs in, rows out, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is for the page
    os.nice(_NICENESS)
    with suppress(EOFError):
        while True:
            work, job = pipe.recv()
            try:
                row = work(job)
            except Exception as error:  # whatever it is, it is this recording's and no other's
                row = batch.failed_row(job, products.error_cause_text(error))
            pipe.send(row)


def call_in_limited_process(function: _Work, *arguments: object, longest_s: float | None = None) -> list[str]:
    """The lines that a function returns, called in a process of its own: importable, with plain arguments.

    Raises :class:`SeatrialError`: what the function raised, or that it took too long or its process ended.
    """
    longest_s = LONGEST_S if longest_s is None else longest_s
    if not _turns.acquire(timeout=longest_s):
        raise errors.InputError("others are being read", fix="try again in a minute")
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_run_and_send, args=(sender, function, arguments), daemon=True)
    try:
        process.start()
        sender.close()  # or the end of the process would pass unnoticed
        if not receiver.poll(longest_s):
            raise errors.InputError(f"took longer than {longest_s:g} s to read", fix="read it on the command line")
        answer = json.loads(receiver.recv_bytes())  # no pickle: its sender has read an untrusted file
    except (EOFError, OSError) as error:
        process.join()
        reason = f"exit code {process.exitcode}"
        with suppress(ValueError):
            reason = f"signal {signal.Signals(-(process.exitcode or 0)).name}"
        raise errors.InputError(
            "ended the program that read it", why=reason,
            fix="it needs more memory than there is, or is damaged; if it is sound, read it on the command line",
        ) from error  # fmt: skip
    finally:
        process.kill()
        process.join()
        receiver.close()
        _turns.release()
    if "error" in answer:
        raise errors.SeatrialError(str(answer["error"]))
    return [str(line) for line in answer["lines"]]


def _run_and_send(pipe: Connection, function: _Work, arguments: tuple[object, ...]) -> None:
    """The process of a limited call: one call, and the answer to it as JSON.

    What it may take is bounded, it is killed first where memory is short, and its stderr is silent.
    """
    import resource

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is for the server
    memory_bytes = max(LEAST_MEMORY_BYTES, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2)
    for limit, value in (
        (resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_FSIZE, MOST_WRITTEN_BYTES), (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        _, hard = resource.getrlimit(limit)
        resource.setrlimit(limit, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        answer: dict[str, object] = {"lines": list(function(*arguments))}
    except Exception as error:  # whatever it is, it is this file's and no other's
        answer = {"error": str(errors.unexpected_error(error))}
    pipe.send_bytes(json.dumps(answer).encode())


def receive_upload(stream: IO[bytes], filename: str, folder: Path) -> tuple[Path, list[str]]:
    """Put a recording, or a table as a recording, into a folder; its path, and lines on its content.

    Raises :class:`InputError` for what cannot be read, also where it ends the process that reads it, for a table
    that leaves a question open, and where a recording of that name is there; :class:`StorageError` for what the
    folder does not take.
    """
    name = secure_filename(filename).lstrip("-")  # or a shell would take it for an option
    if not name or len(name.encode()) > _LONGEST_NAME_BYTES:
        raise errors.InputError(
            "has an invalid file name", where=repr(filename[:_LONGEST_NAME_BYTES]), fix="rename it"
        )
    with TemporaryDirectory(prefix="seatrial-") as place:
        source = Path(place) / name
        with source.open("wb") as copy:
            shutil.copyfileobj(stream, copy)
        try:
            lines = call_in_limited_process(make_recording, str(source))
        except errors.SeatrialError as error:  # the temporary folder means nothing to the sender
            raise errors.InputError(str(error).replace(f"{place}/", ""), where=name) from error
        recording = _recording_path(source)
        target = folder / f"{recording.stem}.mcap"
        with lock_for_replacement(target):
            if os.path.lexists(target):
                raise errors.InputError(
                    "already exists", where=target.name, fix="rename the file and upload it again"
                )
            with atomic_file(target) as partial:
                shutil.copyfile(recording, partial)
    return target, lines


def make_recording(source: str) -> list[str]:
    """Make a recording of a file, in its folder, unless it is one; returns lines on its content."""
    path = Path(source)
    recording = _recording_path(path)
    if recording == path:
        return [f"{len(channels_of(read_recording(path)))} channels"]
    raw = table_files.read_raw_table(path)
    if import_table.is_standard_table(raw):
        return [str(import_table.import_table(path, recording))]
    proposal = import_table.propose_column_map(raw)
    if proposal.unanswered:
        raise errors.InputError(
            f"leaves an open question: {proposal.unanswered[0]}",
            fix="import it with `seatrial import`, which accepts the answer",
        )
    summary = import_table.import_proposed(raw, proposal, recording, recording.with_suffix(".columns.toml"))
    return [str(summary), *proposal.warnings]


def _recording_path(source: Path) -> Path:
    return source if source.suffix.lower() == ".mcap" else source.with_suffix(".mcap")
