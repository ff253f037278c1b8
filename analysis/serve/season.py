"""A season: the recordings below a folder as rows, at once, and what is made of each as it is wanted.

The results are those of a batch, in a folder that a batch may have written or may take over. What is known of each
recording is kept there too, by the names, sizes and times of its files, so that thousands are listed without
opening one. One process beside the page does the work, so that neither a long recording nor one that kills its
worker holds up anybody.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import lru_cache
from itertools import count
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from queue import PriorityQueue

from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.files import make_folder
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.batch.batch import names_of, recordings_below, result_of
from seatrial.analysis.batch.one_recording import WAITING, Row, first_look
from seatrial.analysis.batch.workers import BatchJob, failed_row
from seatrial.analysis.products import Options, cause_of

ASKED, LOOK, REST = range(3)
"""What is worked on first: what somebody waits for, a first look at each recording, the analysis of the others."""
SETTLED_S = 20.0
"""A file that has changed since is still being written, and is not analysed unless somebody asks."""
DIAGNOSIS = "diagnosis.json"
_KEPT = ".season.sqlite"
_NICENESS = 10
_CREATE = "CREATE TABLE IF NOT EXISTS season (name TEXT PRIMARY KEY, stamp TEXT, row TEXT)"
_REPLACE = "INSERT OR REPLACE INTO season VALUES (?, ?, ?)"
_LONGEST_S = 3600.0  # an analysis: the recording of a day takes some minutes
_DIED = "its worker died over it, or took an hour; too little memory, or a fault in native code"
_MOST_DIAGNOSIS_BYTES = 64_000_000  # one of a season of forty recordings has a few MB


def results_folder(folder: Path) -> Path:
    """Where the results of a season are kept unless a folder is named: the user's cache, apart for each season."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "seatrial" / hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:16]


class Season:
    """The recordings below ``folder`` and their results in ``out``; a context manager.

    ``eager`` analyses all of them, one after the other; without it those that are asked for. Raises
    :class:`InputError` for what is no folder, :class:`StorageError` where ``out`` cannot be written.
    """

    def __init__(
        self, folder: Path, out: Path, options: Options | None = None, *, eager: bool = True,
        settled_s: float = SETTLED_S,
    ) -> None:  # fmt: skip
        self.folder, self.out, self._options = folder, out.resolve(), options or Options()
        if folder.resolve().is_relative_to(self.out):
            raise InputError("the recordings are in the folder of the results", where=str(out), fix="name another")
        self._eager, self._settled_s = eager, settled_s
        self._files: dict[str, tuple[Path, ...]] = {}
        self._diagnoses: list[tuple[int, str, frozenset[str], Path]] = []
        self._requests: PriorityQueue[tuple[int, int, str]] = PriorityQueue()
        self._requested: set[tuple[int, str]] = set()
        self._number, self._lock, self._worker = count(), threading.RLock(), _Worker()
        self._ended = False

    def __enter__(self) -> Season:
        recordings_below(self.folder, self.out)  # which says what is no folder
        make_folder(self.out)
        try:
            with ExitStack() as closing:
                self._store = sqlite3.connect(self.out / _KEPT, check_same_thread=False)
                closing.callback(self._store.close)
                self._store.execute(_CREATE)
                kept = self._store.execute("SELECT name, stamp, row FROM season")
                self._kept = {name: (stamp, json.loads(row)) for name, stamp, row in kept}
                closing.pop_all()
        except sqlite3.Error as error:
            raise StorageError("cannot be used", where=str(self.out / _KEPT), why=str(error),
                               fix="remove it, or name another folder with -o") from error  # fmt: skip
        self.rows()
        threading.Thread(target=self._work, name="season", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._ended = True
            self._store.close()
        self._requests.put((-1, 0, ""))
        self._worker.stop()

    def rows(self) -> list[Row]:
        """A row each recording as in the index of a batch; of one not analysed what a first look tells, if that."""
        with self._lock:
            recordings = recordings_below(self.folder, self.out)
            self._files = dict(zip(names_of(self.folder, recordings), recordings, strict=True))
            states = {path: _state_of(path) for path in self.folder.rglob(DIAGNOSIS)}
            self._diagnoses = [
                (state[1], *_read_diagnosis(path, state), path.parent) for path, state in states.items()
            ]
            return [self._row(name) for name in self._files]

    def row(self, name: str) -> Row | None:
        """The row of a recording by its name, as :meth:`rows`; None where there is none of that name."""
        with self._lock:
            if name not in self._files:
                self.rows()
            return self._row(name) if name in self._files else None

    def files(self, name: str) -> tuple[Path, ...]:
        """The files of a recording that :meth:`row` knows."""
        return self._files[name]

    def ask(self, name: str, *, anew: bool = False) -> None:
        """Have a recording analysed next; ``anew`` where its result is not there any more."""
        with self._lock:
            if anew:
                self._kept.pop(name, None)
            self._request(ASKED, name)

    def diagnosis_of(self, row: Row) -> tuple[str, Path | None]:
        """Verdict and folder of the newest diagnosis that a recording took part in."""
        digests = set(row.get("provenance", {}).get("sha256", "").split(", ")) - {""}
        diagnoses = [(changed, verdict, folder) for changed, verdict, of, folder in self._diagnoses if of & digests]
        return max(diagnoses, default=(0, "", None))[1:]

    def _row(self, name: str) -> Row:
        stamp, row = self._kept.get(name, ("", None))
        if row is None or stamp != self._stamp(name):
            self._request(LOOK, name)
            row = {"status": WAITING, "cause": ""}
        elif row["status"] == WAITING and self._eager and self._is_settled(name):
            self._request(REST, name)
        path = self._files[name][0].relative_to(self.folder).as_posix()
        return {**row, "name": name, "path": path, "verdict": self.diagnosis_of(row)[0]}

    def _stamp(self, name: str) -> str:
        """What a row hangs on: the files' names, sizes and times, the options and the version."""
        states = [(path.name, *_state_of(path)) for path in self._files[name]]
        return repr((states, self._options, software_version()))

    def _is_settled(self, name: str) -> bool:
        newest_ns = max(_state_of(path)[1] for path in self._files[name])
        return time.time() - newest_ns / 1e9 > self._settled_s

    def _request(self, urgency: int, name: str) -> None:
        if (urgency, name) not in self._requested:
            self._requested.add((urgency, name))
            self._requests.put((urgency, next(self._number), name))

    def _work(self) -> None:
        """One request after the other, until the season ends."""
        while True:
            urgency, _, name = self._requests.get()
            if urgency < 0:
                return
            with self._lock:
                self._requested.discard((urgency, name))
                if name not in self._files:
                    continue
                stamp, files = self._stamp(name), self._files[name]
                kept_stamp, row = self._kept.get(name, ("", {}))
            if kept_stamp == stamp and (urgency == LOOK or row["status"] != WAITING):
                continue
            first, *later = map(str, files)
            job = BatchJob(name, first, str(self.out), self._options, later=tuple(later))
            row = self._worker.row_of(_first_look if urgency == LOOK else result_of, job)
            with self._lock:
                if self._ended:
                    return
                self._kept[name] = stamp, failed_row(job, _DIED) if row is None else row
                if row is not None:  # one that killed its worker is tried again after the next start
                    self._store.execute(_REPLACE, (name, stamp, json.dumps(row)))
                    self._store.commit()


@lru_cache(maxsize=10_000)
def _read_diagnosis(path: Path, state: tuple[int, int]) -> tuple[str, frozenset[str]]:
    """Verdict and hashes of the recordings of a diagnosis in a ``state``; nothing of what is none."""
    if state[0] > _MOST_DIAGNOSIS_BYTES or not path.is_file():
        return "", frozenset()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        return str(document["verdict"]), frozenset(str(document["provenance"]["recordings_sha256"]).split(", "))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "", frozenset()


def _state_of(path: Path) -> tuple[int, int]:
    """Size [bytes] and time of change [ns]; of one that has gone none."""
    with suppress(OSError):
        state = path.stat()
        return state.st_size, state.st_mtime_ns
    return 0, 0


def _first_look(job: BatchJob) -> Row:
    return {"name": job.name, **first_look([Path(job.path), *map(Path, job.later)])}


class _Worker:
    """A process that makes rows of jobs, one at a time; another takes its place when it dies."""

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None

    def row_of(self, work: Callable[[BatchJob], Row], job: BatchJob) -> Row | None:
        """The row that ``work`` makes of a job, or of its failure; None where it kills the process or hangs."""
        if self._process is None:
            context = get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_attend, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
        try:
            self._pipe.send((work, job))
            if not self._pipe.poll(_LONGEST_S):
                raise TimeoutError
            row: Row = self._pipe.recv()
        except (EOFError, OSError):
            self._process.kill()
            self._process = None
            return None
        return row

    def stop(self) -> None:
        if self._process is not None and self._process.is_alive():
            self._process.kill()


def _attend(pipe: Connection) -> None:
    """What the worker does: jobs in, rows out, until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is for the page
    os.nice(_NICENESS)
    with suppress(EOFError):
        while True:
            work, job = pipe.recv()
            try:
                row = work(job)
            except Exception as error:  # whatever it is, it is this recording's and no other's
                row = failed_row(job, cause_of(error))
            pipe.send(row)
