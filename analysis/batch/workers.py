"""Jobs on worker processes: a row for each job, whatever happens to the others.

Workers are those of dask.distributed, in a cluster of our own on this machine or behind a scheduler that is already
running; those share the file system with us. A job that kills its worker, or hangs, is known by the marks that
every attempt leaves in the output folder: no scheduler can tell which of a dead worker's tasks was to blame.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, Queue
from typing import Any, TypeAlias

from seatrial.acquisition.core.errors import InputError, Progress, SourceError
from seatrial.acquisition.core.files import locked_folder, make_folder, remove_leftovers_below
from seatrial.acquisition.core.process import interrupt_on_terminate
from seatrial.analysis.batch.one_recording import SUMMARY, Row
from seatrial.analysis.products import Options, cause_of

MOST_ATTEMPTS = 3
"""So often a recording may take its worker down before it is left alone."""
MARKS = ".attempts"
"""The folder of the marks, in the output folder."""
Client: TypeAlias = Any  # of distributed, whose functions have no types
Future: TypeAlias = Any
_CONNECT_S, _WORKERS_S, _PATIENCE_S = 8, 30, 60.0
_ADDRESS = re.compile(r"((tcp|tls|ws|wss)://)?([\w.-]+|\[[0-9a-fA-F:]+\]):\d{1,5}")
_MOST_SUBMITTED = 2 * MOST_ATTEMPTS
"""So often a row is asked for; who takes a worker down is told by the marks long before."""


@dataclass(frozen=True, slots=True)
class BatchJob:
    """One recording to be processed; everything a worker must know, in plain values. ``later`` are the parts after
    the one at ``path``.
    """

    name: str
    path: str
    out: str
    options: Options
    again: bool = False
    timeout_s: float | None = None
    later: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """Where its result stands."""
        return Path(self.out) / self.name

    @property
    def mark(self) -> Path:
        """A file with one byte for each attempt at it that has not come to an end."""
        return Path(self.out) / MARKS / hashlib.sha256(self.name.encode()).hexdigest()


Task = Callable[[BatchJob], Row]


def check_address(scheduler: str | None) -> None:
    """Raises :class:`InputError` for what cannot be the address of a scheduler."""
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise InputError(
            "is not the address of a scheduler", where=repr(scheduler), fix="give one like tcp://host:8786"
        )


def run_jobs(
    jobs: Sequence[BatchJob],
    task: Task,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = lambda share: None,
) -> list[Row]:
    """The rows that ``task`` makes of the jobs on worker processes, in the order of the jobs.

    Arguments and errors as those of :func:`run_batch`; the jobs' output folder has to be ours, see
    :func:`batch_folder`.
    """
    with _client(workers or os.cpu_count() or 1, scheduler) as client:
        return _gathered(client, jobs, task, progress)


def map_calls(
    calls: Sequence[tuple[Any, ...]],
    workers: int | None = None,
    progress: Progress = lambda share: None,
    finished: Callable[[int, Any], None] = lambda number, result: None,
) -> list[Any]:
    """The results of calls, each a function and its arguments, on worker processes; in the order of the calls.

    ``finished`` is told the number of each call and its result as soon as that is there. The first error ends all
    and is raised. With one of ``workers`` the calls are made in this process.
    """
    workers, results = workers or os.cpu_count() or 1, dict[int, Any]()

    def keep(number: int, result: Any) -> None:
        results[number] = result
        finished(number, result)
        progress(len(results) / len(calls))

    if workers < 2:
        for number, (function, *arguments) in enumerate(calls):
            keep(number, function(*arguments))
        return [results[number] for number in range(len(calls))]
    with _client(workers, None) as client:
        futures = {client.submit(_on_one_core, *call, pure=False): number for number, call in enumerate(calls)}
        try:
            for future in import_module("distributed").as_completed(futures, loop=client.loop):
                keep(futures[future], future.result())
            return [results[number] for number in range(len(calls))]
        except BaseException:
            client.cancel(list(futures), force=True)
            raise


def _on_one_core(function: Callable[..., Any], *arguments: Any) -> Any:
    """A call whose compiled loops keep to one core: threads of several processes would wait for each other."""
    import_module("numba").set_num_threads(1)
    return function(*arguments)


@contextmanager
def batch_folder(out: Path) -> Iterator[None]:
    """The output folder, locked and cleared of what killed runs left there; SIGTERM ends as Ctrl-C does."""
    with locked_folder(out):
        remove_leftovers_below(out)
        shutil.rmtree(out / MARKS, ignore_errors=True)
        make_folder(out / MARKS)
        try:
            with interrupt_on_terminate():
                yield
        finally:
            shutil.rmtree(out / MARKS, ignore_errors=True)


def attempt(job: BatchJob, work: Callable[[BatchJob], Row]) -> Row:
    """The row that ``work`` makes of a job with the job's name on it, or that of its failure; with marks."""
    ended = _attempts_ended(job)
    if ended:
        return failed_row(job, ended)
    try:
        with job.mark.open("ab") as mark:
            mark.write(b".")
        with _watched(job.timeout_s):
            return {**work(job), "name": job.name}  # an earlier result may say another name
    except Exception as error:  # whatever it is, it is this job's and no other's
        return failed_row(job, cause_of(error))
    finally:
        job.mark.unlink(missing_ok=True)


def _attempts_ended(job: BatchJob) -> str:
    """Why a recording is not attempted once more; empty if it is."""
    try:
        state = job.mark.stat()
    except FileNotFoundError:
        return ""
    if job.timeout_s is not None and time.time() - state.st_mtime >= job.timeout_s:
        return f"took longer than {job.timeout_s:g} s"
    if state.st_size >= MOST_ATTEMPTS:
        return f"its worker died {MOST_ATTEMPTS} times over it; too little memory, or a fault in native code"
    return ""


@contextmanager
def _watched(timeout_s: float | None) -> Iterator[None]:
    """Ends this process after a time: a thread that hangs can be stopped in no other way."""
    if timeout_s is None:
        yield
        return
    watch = threading.Timer(timeout_s, os._exit, args=(1,))
    watch.daemon = True
    watch.start()
    try:
        yield
    finally:
        watch.cancel()


def failed_row(job: BatchJob, cause: str) -> Row:
    """The row of a recording of which nothing could be made; what was made of it earlier is no longer true."""
    with suppress(OSError):  # a folder that is closed to us
        if (job.folder / SUMMARY).is_file():
            shutil.rmtree(job.folder, ignore_errors=True)
    return {"name": job.name, "status": "failed", "cause": cause}


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of a scheduler that is there, or of a cluster of worker processes that ends with it."""
    dask, distributed = import_module("dask"), import_module("distributed")
    quiet = {
        "distributed.scheduler.allowed-failures": 10 * MOST_ATTEMPTS,  # our own marks know who is to blame
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": f"{_CONNECT_S}s",
        "distributed.deploy.lost-worker-timeout": f"{_PATIENCE_S:.0f}s",  # a busy machine starts one in 20 s
    }
    with dask.config.set(quiet):
        if scheduler is not None:
            with _connected(scheduler) as client:
                yield client
            return
        with block_interrupts():
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


def _gathered(client: Client, jobs: Sequence[BatchJob], task: Task, progress: Progress) -> list[Row]:
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
            raise SourceError("scheduler or workers are gone", fix="restart them and the batch, which resumes")


def _row_of(future: Future, job: BatchJob) -> Row | None:
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


@contextmanager
def block_interrupts() -> Iterator[None]:
    """Threads and processes that begin here, and those that they begin, never hear Ctrl-C; it waits for us.

    A terminal interrupts the whole group of processes, and each worker would print where it was. The tracker of
    multiprocessing begins before: the thread that starts it hears Ctrl-C again afterwards.
    """
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
