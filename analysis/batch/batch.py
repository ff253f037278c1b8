"""A season of recordings at once, on worker processes: one result a recording, whatever happens to the others.

Workers are those of dask.distributed, in a cluster of our own on this machine or behind a scheduler that is
already there; those share the file system with us.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from queue import Empty, Queue
from typing import Any, TypeAlias

from acquisition.core.errors import DataShortageError, InputError, SourceError, StorageError, storage_error
from acquisition.core.progress import Progress
from analysis.batch.index import Failures, failures_of, gone_rows, write_index
from analysis.batch.interrupts import deaf_to_interrupts, ended_by_terminate
from analysis.batch.job import MARKS, MOST_ATTEMPTS, Job, attempt, failed_row
from analysis.batch.one_recording import clear_partials
from analysis.batch.products import Options, cause_of
from analysis.batch.row import Row

Task = Callable[[Job], Row]
Client: TypeAlias = Any  # of distributed, whose functions have no types
Future: TypeAlias = Any

_LOCK = ".lock"
_CONNECT_S, _WORKERS_S, _PATIENCE_S = 8, 30, 60.0
_ADDRESS = re.compile(r"((tcp|tls|ws|wss)://)?([\w.-]+|\[[0-9a-fA-F:]+\]):\d{1,5}")
_RESERVED = {"index.html", "index.parquet", MARKS, _LOCK}


@dataclass(frozen=True, slots=True)
class Summary:
    """What a batch came to. ``done`` counts those with a complete result, ``reused`` those of them not new.

    ``gone_rows`` are of results whose recording is not in the folder any more; they are in the index only.
    """

    rows: list[Row]
    done: int
    reused: int
    index: Path
    gone_rows: tuple[Row, ...] = ()

    @property
    def gone(self) -> tuple[str, ...]:
        """The names of the results whose recording is gone."""
        return tuple(row["name"] for row in self.gone_rows)

    @property
    def failed(self) -> int:
        """The number of recordings without a complete result."""
        return len(self.rows) - self.done

    @property
    def failures(self) -> Failures:
        """The failed recordings by cause, the most frequent first."""
        return failures_of(self.rows)

    def as_json(self) -> dict[str, Any]:
        """The summary as `--json` prints it."""
        grouped = [{"cause": cause, "recordings": names} for cause, names in self.failures]
        return {
            "recordings": len(self.rows), "done": self.done, "reused": self.reused, "failed": self.failed,
            "failures": grouped, "gone": list(self.gone), "index": str(self.index),
        }  # fmt: skip


def run_batch(
    folder: Path | str,
    out: Path | str,
    workers: int | None = None,
    scheduler: str | None = None,
    options: Options | None = None,
    progress: Progress = lambda share: None,
    *,
    again: bool = False,
    timeout_s: float | None = None,
    task: Task | None = None,
) -> Summary:
    """Process every ``*.mcap`` below ``folder`` into ``out`` and write the index over all of them.

    ``workers`` is the number of processes, that of the cores without it; ``scheduler`` an address like
    ``tcp://host:8786`` instead. Results of equal provenance are used as they are unless ``again``. A
    recording that takes longer than ``timeout_s`` [s] fails. ``task`` stands in for the work of one recording.
    Raises :class:`InputError` for a folder or an address that is none, :class:`DataShortageError` for one without
    recordings, :class:`SourceError` for a scheduler that cannot be reached, :class:`StorageError` when
    ``out`` cannot be written or another batch is writing there.
    """
    folder, out = Path(folder), Path(out).resolve()
    if folder.resolve().is_relative_to(out):
        raise InputError("the recordings lie in the output folder", where=str(out), fix="name another with -o")
    check_address(scheduler)
    found = recordings_below(folder, out)
    if not found:
        raise DataShortageError("holds no recording", where=str(folder), fix="name a folder with .mcap files")
    names = result_names([path.relative_to(folder).as_posix() for path in found])
    chosen = options or Options()
    jobs = [
        Job(name, str(path.resolve()), str(out), chosen, again, timeout_s)
        for name, path in zip(names, found, strict=True)
    ]
    with alone_in(out):
        rows = computed(jobs, task or attempt, workers, scheduler, progress)
        for row, path in zip(rows, found, strict=True):
            row["path"] = path.relative_to(folder).as_posix()
        reused = sum(row.pop("reused", False) and row["status"] == "done" for row in rows)
        gone = gone_rows(set(names), out)
        index = write_index([*rows, *gone], out, folder.resolve().name)
    done = sum(row["status"] == "done" for row in rows)
    return Summary(rows, done, reused, index, tuple(gone))


def check_address(scheduler: str | None) -> None:
    """Raises :class:`InputError` for what cannot be the address of a scheduler."""
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise InputError("is no address of a scheduler", where=repr(scheduler), fix="give one like tcp://host:8786")


def computed(
    jobs: Sequence[Job],
    task: Task,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = lambda share: None,
) -> list[Row]:
    """The rows that ``task`` makes of the jobs on worker processes, in the order of the jobs.

    Arguments and errors as those of :func:`run_batch`; the jobs' output folder has to be ours, see
    :func:`alone_in`.
    """
    with _client(workers or os.cpu_count() or 1, scheduler) as client:
        return _gathered(client, jobs, task, progress)


def recordings_below(folder: Path, out: Path) -> list[Path]:
    """What is called ``*.mcap`` below a folder, in the order of its names, the output folder left out."""
    if not folder.is_dir():
        raise InputError("is no folder" if folder.exists() else "does not exist", where=str(folder),
                         fix="name the folder that holds the recordings")  # fmt: skip
    outside = (path for path in folder.rglob("*.mcap") if not path.resolve().is_relative_to(out))
    return sorted(path for path in outside if not path.name.startswith("."))


def result_names(paths: list[str]) -> list[str]:
    """A name for each recording's result: its relative path without suffix, changed where two would meet.

    >>> result_names(["a.mcap", "a/b.mcap", "index.html.mcap"])
    ['a_', 'a/b', 'index.html_']
    """
    taken = _RESERVED | {parent.as_posix() for path in paths for parent in Path(path).parents}
    names = []
    for path in paths:
        name = path.removesuffix(".mcap")
        while name in taken:
            name += "_"
        taken.add(name)
        names.append(name)
    return names


@contextmanager
def alone_in(out: Path) -> Iterator[None]:
    """The output folder to ourselves, cleared of what interrupted runs left there; SIGTERM ends as Ctrl-C does."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        lock = (out / _LOCK).open("a")
    except OSError as error:
        raise storage_error(out, error) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise StorageError("is being written by another batch", where=str(out),
                               fix="wait for it, or name another folder") from error  # fmt: skip
        clear_partials(out)
        shutil.rmtree(out / MARKS, ignore_errors=True)
        (out / MARKS).mkdir()
        try:
            with ended_by_terminate():
                yield
        finally:
            shutil.rmtree(out / MARKS, ignore_errors=True)


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of a scheduler that is there, or of a cluster of worker processes that ends with it."""
    dask, distributed = import_module("dask"), import_module("distributed")
    quiet = {
        "distributed.scheduler.allowed-failures": 10 * MOST_ATTEMPTS,  # our own marks know who is to blame
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": f"{_CONNECT_S}s",
    }
    with dask.config.set(quiet):
        if scheduler is not None:
            with _connected(scheduler) as client:
                yield client
            return
        with deaf_to_interrupts():
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1",
                dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False}, silence_logs="CRITICAL",
            )  # fmt: skip
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    try:
        client = import_module("distributed").Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SourceError("no scheduler can be reached", where=scheduler,
                          fix="start one with `dask scheduler`, or give its address") from error  # fmt: skip
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_S)
        except TimeoutError as error:
            raise SourceError("the scheduler has no workers", where=scheduler,
                              fix=f"start some with `dask worker {scheduler}`") from error  # fmt: skip
        yield client


_MOST_SUBMITTED = 2 * MOST_ATTEMPTS
"""So often a row is asked for; who takes a worker down is told by the marks long before."""


def _gathered(client: Client, jobs: Sequence[Job], task: Task, progress: Progress) -> list[Row]:
    """The rows of all jobs in their order, as they come."""
    ended: Queue[Future] = Queue()
    pending: dict[str, tuple[int, Future]] = {}

    def submit(number: int) -> None:
        future = client.submit(task, jobs[number], pure=False)
        submitted[number] += 1
        pending[future.key] = number, future
        future.add_done_callback(ended.put)

    rows: dict[int, Row] = {}
    submitted: Counter[int] = Counter()
    try:
        for number in range(len(jobs)):
            submit(number)
        while pending:
            future = _next(client, ended)
            number, _ = pending.pop(future.key)
            row = _row_of(future, jobs[number])
            if row is None and submitted[number] < _MOST_SUBMITTED:
                submit(number)
                continue
            rows[number] = row or failed_row(jobs[number], "its workers died over it again and again")
            progress(len(rows) / len(jobs))
    except BaseException:
        with suppress(Exception):
            client.cancel([future for _, future in pending.values()], force=True)
        raise
    return [rows[number] for number in range(len(jobs))]


def _next(client: Client, ended: Queue[Future]) -> Future:
    """The next task that has ended. Raises :class:`SourceError` when nobody is left who could end one."""
    since = time.monotonic()
    while True:
        try:
            return ended.get(timeout=1.0)
        except Empty:
            pass
        if client.status == "running" and client.scheduler_info(n_workers=-1)["workers"]:
            since = time.monotonic()
        elif time.monotonic() - since > _PATIENCE_S or client.status == "closed":
            raise SourceError("scheduler or workers are gone", fix="start them and the batch again: it resumes")


def _row_of(future: Future, job: Job) -> Row | None:
    """A task's row; ``None`` where it is to be asked for once more: its worker died, perhaps over another
    recording, or it died with the row before anybody had fetched it (the result itself is on the disk then)."""
    if future.status == "error":
        error = future.exception()
        return None if type(error).__name__ == "KilledWorker" else failed_row(job, cause_of(error))
    try:
        row: Row | None = future.result() if future.status == "finished" else None
    except Exception:  # lost between the question and the answer
        return None
    return row
