"""A batch of recordings: each processed on a worker process into a folder of results, and one index over all.

A result is written under another name and renamed when it is complete, so that an interruption leaves no incomplete
one. Its bytes depend only on the recording, the options and the versions: there is no time of day and no working
folder in it.

Workers are those of dask.distributed, in a local cluster or behind a scheduler that is already running and shares
the file system. Each job gives a row, whatever happens to the others. A job that kills its worker, or hangs, is
identified by the marks that every attempt leaves in the output folder: no scheduler can tell which of a dead
worker's tasks was to blame.

The index has one row a recording, as Parquet for programs and as a page. Results whose recording is no
longer there have rows too, with the status ``gone``: nothing is removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import sys
import threading
import time
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from importlib.metadata import version
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, files, process, ship, stores
from seatrial.acquisition.core.quantities import Ints
from seatrial.acquisition.core.result import to_json
from seatrial.acquisition.core.trial import software_version
from seatrial.acquisition.recording import reader
from seatrial.analysis.manoeuvres.criteria import criterion_results, index_rows
from seatrial.analysis.manoeuvres.indices import Manoeuvre, overshoot_from_order_name
from seatrial.analysis.products import Options, Products, analyse_recording, error_cause_text
from seatrial.analysis.quality.wind import recorded_conditions
from seatrial.analysis.report import pages, tables
from seatrial.analysis.speed_power.analysis import speed_power
from seatrial.analysis.speed_power.runs import power_columns
from seatrial.analysis.tables.export import FLAG_MEANING, read_parquet, unit_of, write_parquet
from seatrial.analysis.tables.table import history_of, provenance_of, required_channels, sha256_of, table_of
from seatrial.analysis.windows.held import write_windows

Row = dict[str, Any]
"""One recording in the index: plain values by name, see :func:`summary_row`."""
SUMMARY = "summary.json"
WAITING = "waiting"
"""The status of a recording that is not analysed yet."""
GRADES = ("good", "suspect", "bad")
KEY_INDICES = frozenset({
    "overshoot_1_deg", "overshoot_2_deg", "overshoot_mean_deg",
    overshoot_from_order_name(1), overshoot_from_order_name(2), "advance_m",
    "transfer_m", "tactical_diameter_m", "steady_diameter_m", "speed_over_ground_mps", "speed_through_water_mps",
    "track_reach_m", "head_reach_m",
})  # fmt: skip
NOT_CLOSED = "was not closed and is read as far as it goes; see what is missing with `seatrial recover`"
"""The remark on a recording that was cut off: done, and explained."""
_COURSE_STEP_S = 5  # distances are summed over means of so long, or the noise of a position adds to them
_THUMBNAIL_POINTS = 60
MOST_ATTEMPTS = 3
"""How often a recording may kill its worker before it is given up."""
MARKS = ".attempts"
"""The folder of the marks, in the output folder."""
Client: TypeAlias = Any  # of distributed, whose functions have no types
Future: TypeAlias = Any
_CONNECT_S, _WORKERS_S, _PATIENCE_S = 8, 30, 60.0
_ADDRESS = re.compile(r"((tcp|tls|ws|wss)://)?([\w.-]+|\[[0-9a-fA-F:]+\]):\d{1,5}")
_MOST_SUBMITTED = 2 * MOST_ATTEMPTS
"""How often a row is asked for; the marks identify what kills a worker long before."""
Failures = list[tuple[str, list[str]]]
"""Causes and the names of the recordings that failed of each, the most frequent first."""
REPORT = "report.html"
"""A notebook report in the folder of a result, to which the page links where there is one."""
GONE = "gone"
"""The status of a result whose recording is not in the folder any more."""
TEXTS = ("name", "path", "status", "cause", "vessel", "trial", "place", "grade")
MEASURES = {"duration_s": "s", "distance_m": "m"}
COUNTS = ("samples", "channels", "findings", "repairs", "windows_kept", "windows_candidates", "legs")
NESTED_COUNTS = ("findings_by_code", "windows_dropped", "manoeuvres", "left_out", "criteria")
_LONGEST_NAME_BYTES, _DIGEST_LETTERS = 245, 12  # file systems take 255; ten are for underscores
_NUMBER = re.compile(r"\d[\d,.]*\d|\d")
CRITERIA = "criteria.json"
"""What the recordings of each ship together show of the standards' criteria."""
_RESERVED = {"index.html", "index.parquet", CRITERIA, MARKS, files.LOCK_NAME}


def process_recording(
    path: Path | str, folder: Path | str, options: Options | None = None, name: str = "", later: Sequence[Path] = ()
) -> Row:
    """Read a recording and write all its results into ``folder``, which is replaced as a whole.

    ``later`` are the parts after the one at ``path``, of a recording in parts.

    ``name`` is what windows and legs are called by, the file's name without it; recordings whose windows are to
    be joined need different ones. Written are ``quality.json`` and ``flags.parquet``, ``table.parquet`` (1 Hz),
    ``windows.parquet``, ``manoeuvres.json``, ``page.html`` and ``summary.json``, which is the row that is
    returned: what the recording is, counts, ``status`` and ``cause``. An incomplete recording has the results that
    its channels allow; its status is ``failed`` and its cause states what is missing. Raises :class:`InputError`
    for what is no recording, :class:`DataShortageError` for one without samples, :class:`StorageError` when a
    result cannot be written.
    """
    paths, folder, options = (Path(path), *later), Path(folder), options or Options()
    provenance = result_inputs(paths, options, name)
    products = analyse_recording(paths, options, name)
    row = summary_row(products, provenance)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with files.temporary_folder(folder) as place:
            partial = place / folder.name
            partial.mkdir()
            _write_result(products, row, provenance, partial)
            if folder.exists() and not (folder / SUMMARY).is_file():
                raise errors.StorageError(
                    "exists and is not a result of an earlier batch",
                    where=str(folder),
                    fix="name another output folder",
                )
            with suppress(FileNotFoundError):
                folder.rename(partial.with_name("older"))
            try:
                partial.rename(folder)
            except OSError:
                if not (folder / SUMMARY).is_file():  # one that was written in the meantime is as good
                    raise
    except OSError as error:
        raise error if isinstance(error, errors.SeatrialError) else errors.storage_error(folder, error) from error
    return row


def result_inputs(paths: Sequence[Path], options: Options, name: str = "") -> dict[str, Any]:
    """What a result depends on, before it is made: the recording's ``name``, size [bytes] and SHA-256, the options,
    the versions.

    Two results of equal origin are equal. Raises :class:`InputError` for what cannot be read.
    """
    size = sum(map(reader.recording_size, paths))
    digest = sha256_of(*paths)
    if digest is None:
        raise errors.InputError("cannot be read", where=str(paths[0]), fix="check its permissions")
    packages = {name: version(name) for name in ("numpy", "pandas", "scipy", "pyarrow")}
    software = {"seatrial": software_version(), "python": sys.version.split()[0], **packages}
    return {
        "recording": name or errors.printable_path(paths[0].stem),
        "bytes": size,
        "sha256": digest,
        "options": asdict(options),
        "software": software,
    }


def reusable_row(
    path: Path, folder: Path, options: Options, name: str = "", later: Sequence[Path] = ()
) -> Row | None:
    """The row of an earlier result that is as good as a new one, ``None`` where there is none."""
    try:
        row: Row = dict(files.read_json(folder / SUMMARY))
    except (OSError, ValueError, TypeError):
        return None
    origin = json.loads(json.dumps(result_inputs((path, *later), options, name)))
    return row if row.get("provenance") == origin else None


def _write_result(products: Products, row: Row, provenance: Mapping[str, Any], folder: Path) -> None:
    """All files of a result, each with its origin and history in it."""
    origin = {
        "provenance": to_json(provenance),
        "history": to_json(history_of(products.one_hz)),
    }
    metadata = {key: json.dumps(value) for key, value in origin.items()}
    trial = {"trial": json.dumps(to_json(products.recording.trial.as_metadata())), "rate_hz": "1.0"}
    channels = ship.channels_by_name_of(products.one_hz.attrs)
    units = {str(name): unit for name in products.one_hz.columns if (unit := unit_of(str(name), channels))}
    write_parquet(products.one_hz, folder / "table.parquet", units, {**metadata, **trial})
    write_parquet(products.quality.flags, folder / "flags.parquet", {}, {**metadata, "meaning": FLAG_MEANING})
    repairs = [asdict(repair) for repair in products.repairs]
    write_json_file(folder / "quality.json", {**products.quality.as_dict(), "repairs": repairs, **origin})
    left_out = [manoeuvre.as_json() for manoeuvre in products.left_out]
    criteria = tables.criteria_by_vessel({products.recording.trial.vessel: products.manoeuvres})
    manoeuvres = [manoeuvre.as_json() for manoeuvre in products.manoeuvres]
    results = {"manoeuvres": manoeuvres, "left_out": left_out, "criteria": criteria,
               "programme": [run.as_json() for run in products.programme]}  # fmt: skip
    write_json_file(folder / "manoeuvres.json", {**results, **origin})
    if products.windows is not None:
        source = provenance_of(products.one_hz, provenance["options"], products.recording.path)
        provenances = {provenance["recording"]: to_json({**source, "recording_sha256": provenance["sha256"]})}
        write_windows(replace(products.windows, provenance=provenances), folder / "windows.parquet")
    pages.recording_page(products, row).write(folder / "page.html")
    write_json_file(folder / SUMMARY, row)


def write_json_file(path: Path, content: Mapping[str, Any]) -> None:
    """Write values as indented JSON."""
    files.write_text(path, json.dumps(to_json(content), indent=1, ensure_ascii=False) + "\n")


def summary_row(products: Products, provenance: Mapping[str, Any]) -> Row:
    """The row of a recording: plain values only, NaN as ``None``.

    ``indices`` are those that a batch is compared by: the median of each over a recording's manoeuvres of a kind.
    """
    recording, one_hz, windows = products.recording, products.one_hz, products.windows
    missing, tests = missing_channels(products.table), index_rows(products.manoeuvres)
    has_criteria = any(test.criterion for test in tests)
    remarks = [remark for remark in ("" if recording.closed else NOT_CLOSED, recording.clock) if remark]
    values: dict[str, list[float]] = {}
    for run in products.manoeuvres:
        for name in KEY_INDICES & set(run.indices) if not run.not_counted else ():
            values.setdefault(f"{run.kind}_{name}", []).append(run.indices[name].value)
    indices = {name: float(np.median(values[name])) for name in sorted(values)}
    grades = (channel.grade for channel in products.quality.channels.values())
    row: Row = {
        "status": "failed" if products.shortfalls else "done",
        "cause": "; ".join(products.shortfalls) or "; ".join(remarks),
        **_recording_row(recording),
        "start": one_hz.index[0].isoformat(),
        "duration_s": float(len(one_hz) - 1),
        "distance_m": distance_sailed_m(one_hz),
        "channels": len(required_channels(products.table)) - len(missing),
        "missing": missing,
        "grade": max(grades, key=GRADES.index, default=""),
        "findings": len(products.quality.findings),
        "findings_by_code": dict(Counter(finding.code for finding in products.quality.findings)),
        "repairs": len(products.repairs),
        "manoeuvres": dict(Counter(manoeuvre.kind for manoeuvre in products.manoeuvres)),
        "left_out": dict(Counter(manoeuvre.kind for manoeuvre in products.left_out)),
        "indices": indices | speed_at_power(products),
        "criteria": dict(Counter(result.result for result in criterion_results(tests))) if has_criteria else {},
        "windows_kept": windows.kept if windows else None,
        "windows_candidates": windows.candidates if windows else None,
        "windows_dropped": windows.dropped if windows else {},
        "legs": windows.leg_count if windows else None,
        "track": track_polyline_points(one_hz),
        "provenance": dict(provenance),
    }
    return dict(to_json(row))


def row_before_analysis(job: BatchJob) -> Row:
    """The row of a recording before it is analysed: its ship, time, size and track.

    Raises as :func:`process_recording` does, but for writing.
    """
    recording = reader.read_parts_of_recording([Path(job.path), *map(Path, job.later)])
    table = table_of(recording)
    row = {
        "status": WAITING, "cause": "", **_recording_row(recording), "start": table.index[0].isoformat(),
        "duration_s": (table.index[-1] - table.index[0]).total_seconds(), "track": track_polyline_points(table),
    }  # fmt: skip
    return {"name": job.name, **to_json(row)}


def _recording_row(recording: reader.Recording) -> Row:
    """The part of a row that describes the recording itself."""
    return {
        "vessel": recording.trial.vessel,
        "trial": recording.trial.name,
        "place": recording.trial.place,
        "samples": sum(int(series.value.size) for series in recording.series.values()),
        "closed": recording.closed,
        "parts": len(recording.paths),
    }


def missing_channels(table: pd.DataFrame) -> list[str]:
    """Those channels of the ship's trials that have no value at all; no check can judge them."""
    return [name for name in required_channels(table) if name not in table or not table[name].notna().any()]


def speed_at_power(products: Products) -> dict[str, float]:
    """The speed in still water at the highest power of a speed trial; empty for a recording that is none."""
    if not power_columns(products.table):
        return {}
    recording = products.recording
    try:
        result = speed_power(
            [products.table], recorded_conditions(recording.trial, products.table), recording.events
        )
    except (errors.DataShortageError, errors.InputError):
        return {}
    return {"speed_power_kw": result.fastest.power_kw, "speed_power_mps": result.fastest.speed_mps}


def distance_sailed_m(one_hz: pd.DataFrame) -> float | None:
    """The distance sailed over ground [m]: between means of its position over 5 s, straight across holes.

    ``None`` where there are not two of them.
    """
    position = one_hz.reindex(columns=["north_m", "east_m"]).to_numpy(dtype=float)
    steps = position[: len(position) // _COURSE_STEP_S * _COURSE_STEP_S].reshape(-1, _COURSE_STEP_S, 2)
    means = steps.mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    if len(means) < 2:
        return None
    return float(np.hypot(*np.diff(means, axis=0).T).sum())


def track_polyline_points(one_hz: pd.DataFrame) -> str:
    """The track as points of a polyline in a square of 100 by 100, north up and to scale; empty without one."""
    track = one_hz.reindex(columns=["east_m", "north_m"]).dropna().to_numpy(dtype=float) * [1.0, -1.0]
    if len(track) < 2:
        return ""
    chosen = track[np.unique(np.linspace(0, len(track) - 1, _THUMBNAIL_POINTS).astype(int))]
    middle, size = (chosen.max(axis=0) + chosen.min(axis=0)) / 2.0, max(np.ptp(chosen, axis=0).max(), 1.0)
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in 50.0 + 92.0 * (chosen - middle) / size)


@dataclass(frozen=True, slots=True)
class BatchJob:
    """One recording to be processed, in plain values for a worker. ``later`` are the parts after the one at
    ``path``; ``store`` is the address of an object store where the results go, with ``out`` for marks only."""

    name: str
    path: str
    out: str
    options: Options
    again: bool = False
    timeout_s: float | None = None
    later: tuple[str, ...] = ()
    store: str = ""

    @property
    def folder(self) -> Path:
        """The folder of its result."""
        return Path(self.out) / self.name

    @property
    def attempts_file(self) -> Path:
        """A file with one byte for each attempt at it that has not come to an end."""
        return Path(self.out) / MARKS / hashlib.sha256(self.name.encode()).hexdigest()


Task = Callable[[BatchJob], Row]


def check_address(scheduler: str | None) -> None:
    """Raises :class:`InputError` for what cannot be the address of a scheduler."""
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise errors.InputError(
            "is not the address of a scheduler", where=repr(scheduler), fix="give one like tcp://host:8786"
        )


def run_jobs(
    jobs: Sequence[BatchJob],
    task: Task,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: errors.Progress = lambda share: None,
) -> list[Row]:
    """The rows that ``task`` makes of the jobs on worker processes, in the order of the jobs.

    Arguments and errors as those of :func:`run_batch`; the jobs' output folder has to be locked, see
    :func:`lock_batch_folder`. A job is submitted again whose worker died, perhaps over another recording, or before
    the row was fetched (the result itself is on the disk then).
    """
    ended: Queue[Future] = Queue()
    pending: dict[str, tuple[int, Future]] = {}
    rows: dict[int, Row] = {}
    submitted: Counter[int] = Counter()
    with _dask_client(workers or os.cpu_count() or 1, scheduler) as client:

        def submit(number: int) -> None:
            future = client.submit(task, jobs[number], pure=False)
            submitted[number] += 1
            pending[future.key] = number, future
            future.add_done_callback(ended.put)

        try:
            for number in range(len(jobs)):
                submit(number)
            while pending:
                future = _next_finished_task(client, ended)
                number, _ = pending.pop(future.key)
                row: Row | None = None
                if future.status == "finished":
                    with suppress(Exception):  # lost between the question and the answer
                        row = future.result()
                elif future.status == "error" and type(error := future.exception()).__name__ != "KilledWorker":
                    row = failed_row(jobs[number], error_cause_text(error))
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


def map_calls(
    calls: Sequence[tuple[Any, ...]],
    workers: int | None = None,
    progress: errors.Progress = lambda share: None,
    finished: Callable[[int, Any], None] = lambda number, result: None,
) -> list[Any]:
    """The results of calls, each a function and its arguments, on worker processes; in the order of the calls.

    ``finished`` is called with the number of each call and its result as soon as that is there. The first error
    ends all and is raised. With one worker the calls are made in this process.
    """
    workers, results = workers or os.cpu_count() or 1, dict[int, Any]()

    def store_result(number: int, result: Any) -> None:
        results[number] = result
        finished(number, result)
        progress(len(results) / len(calls))

    if workers < 2:
        for number, (function, *arguments) in enumerate(calls):
            store_result(number, function(*arguments))
        return [results[number] for number in range(len(calls))]
    with _dask_client(workers, None) as client:
        futures = {client.submit(_on_one_core, *call, pure=False): number for number, call in enumerate(calls)}
        try:
            for future in import_module("distributed").as_completed(futures, loop=client.loop):
                store_result(futures[future], future.result())
            return [results[number] for number in range(len(calls))]
        except BaseException:
            client.cancel(list(futures), force=True)
            raise


def _on_one_core(function: Callable[..., Any], *arguments: Any) -> Any:
    """A call whose compiled loops keep to one core: threads of several processes would wait for each other."""
    import_module("numba").set_num_threads(1)
    return function(*arguments)


@contextmanager
def lock_batch_folder(output_folder: Path) -> Iterator[None]:
    """The output folder, locked and cleared of what killed runs left there; SIGTERM ends as Ctrl-C does."""
    with files.lock_output_folder(output_folder):
        files.remove_leftovers_below(output_folder)
        shutil.rmtree(output_folder / MARKS, ignore_errors=True)
        files.make_folder(output_folder / MARKS)
        try:
            with process.interrupt_on_terminate():
                yield
        finally:
            shutil.rmtree(output_folder / MARKS, ignore_errors=True)


def run_job_or_fail(job: BatchJob, work: Callable[[BatchJob], Row]) -> Row:
    """The row that ``work`` makes of a job with the job's name on it, or that of its failure; with marks.

    A job is given up that killed its worker several times, or hung until it was ended.
    """
    with suppress(FileNotFoundError):
        state = job.attempts_file.stat()
        if job.timeout_s is not None and time.time() - state.st_mtime >= job.timeout_s:
            return failed_row(job, f"took longer than {job.timeout_s:g} s")
        if state.st_size >= MOST_ATTEMPTS:
            died = f"its worker died {MOST_ATTEMPTS} times over it"
            return failed_row(job, f"{died}; too little memory, or a fault in native code")
    try:
        with job.attempts_file.open("ab") as mark:
            mark.write(b".")
        with _time_limit(job.timeout_s):
            return {**work(job), "name": job.name}  # an earlier result may have another name
    except Exception as error:  # any error is the failure of this job only
        return failed_row(job, error_cause_text(error))
    finally:
        job.attempts_file.unlink(missing_ok=True)


@contextmanager
def _time_limit(timeout_s: float | None) -> Iterator[None]:
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
    """The row of a recording without results; earlier results are removed, as they are no longer true."""
    with suppress(OSError):  # a folder that is closed to us
        if (job.folder / SUMMARY).is_file():
            shutil.rmtree(job.folder, ignore_errors=True)
    return {"name": job.name, "status": "failed", "cause": cause}


@contextmanager
def _dask_client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of a running scheduler, or of a cluster of worker processes that ends with it."""
    dask, distributed = import_module("dask"), import_module("distributed")
    settings = {
        "distributed.scheduler.allowed-failures": 10 * MOST_ATTEMPTS,  # the marks identify the failing job
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": f"{_CONNECT_S}s",
        "distributed.deploy.lost-worker-timeout": f"{_PATIENCE_S:.0f}s",  # a busy machine starts one in 20 s
    }
    with dask.config.set(settings):
        if scheduler is None:
            with block_interrupts():
                cluster = distributed.LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1",
                    dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False}, silence_logs="CRITICAL",
                )  # fmt: skip
            with cluster, distributed.Client(cluster, set_as_default=False) as client:
                yield client
            return
        try:
            client = distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise errors.SourceError(
                "no scheduler can be reached",
                where=scheduler,
                fix="start one with `dask scheduler`, or give its address",
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=_WORKERS_S)
            except TimeoutError as error:
                raise errors.SourceError(
                    "the scheduler has no workers",
                    where=scheduler,
                    fix=f"start some with `dask worker {scheduler}`",
                ) from error
            yield client


def _next_finished_task(client: Client, ended: Queue[Future]) -> Future:
    """The next task that has ended. Raises :class:`SourceError` when no worker is left that could end one."""
    since = time.monotonic()
    while True:
        try:
            return ended.get(timeout=1.0)
        except Empty:
            pass
        if client.status == "running" and client.scheduler_info(n_workers=-1)["workers"]:
            since = time.monotonic()
        elif time.monotonic() - since > _PATIENCE_S or client.status == "closed":
            raise errors.SourceError(
                "scheduler or workers are gone", fix="restart them and the batch, which resumes"
            )


@contextmanager
def block_interrupts() -> Iterator[None]:
    """Threads and processes that begin here, and those that they begin, never receive SIGINT.

    A terminal interrupts the whole group of processes, and each worker would print a traceback. The tracker of
    multiprocessing begins before: the thread that starts it has SIGINT unblocked afterwards.
    """
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass(frozen=True, slots=True)
class BatchRemainder:
    """What a sample of a batch left: recordings, their ``bytes``, and the time [s] that they take at the sample's
    pace; None where all of the sample was done before."""

    recordings: int
    bytes: int
    estimate_s: float | None

    @classmethod
    def from_sample(
        cls, rows: Sequence[Row], selected: Ints, sizes: Sequence[int], elapsed_s: float
    ) -> BatchRemainder:
        """What the sample in ``rows`` left, and its time by the bytes that were processed anew in ``elapsed_s``."""
        processed = sum(sizes[number] for row, number in zip(rows, selected, strict=True) if not row.get("reused"))
        size = sum(sizes) - sum(sizes[number] for number in selected)
        return cls(len(sizes) - len(rows), size, elapsed_s * size / processed if processed else None)

    def __str__(self) -> str:
        text = f"{self.recordings:,} recordings, {self.bytes / 1e6:,.1f} MB, remain"
        if self.estimate_s is None:
            return f"{text}; the sample was done before, and tells no time (--again computes it anew)"
        hours = self.estimate_s / 3600.0
        return f"{text}: at this pace {f'{hours:.1f} h' if hours > 2.0 else f'{60.0 * hours:.1f} min'}"


@dataclass(frozen=True, slots=True)
class BatchSummary:
    """The outcome of a batch. ``done`` counts the complete results, ``reused`` those of them not new.

    ``gone_rows`` are of results whose recording is not in the folder any more; they are in the index only.
    ``files`` are those of each recording, by the name of its row; ``remainder`` is what a sample left.
    """

    rows: list[Row]
    done: int
    reused: int
    index: Path
    gone_rows: tuple[Row, ...] = ()
    files: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)
    remainder: BatchRemainder | None = None

    @property
    def gone(self) -> tuple[str, ...]:
        return tuple(row["name"] for row in self.gone_rows)

    @property
    def failed(self) -> int:
        """The number of recordings without a complete result."""
        return len(self.rows) - self.done

    @property
    def failures(self) -> Failures:
        """The failed recordings by cause, the most frequent first."""
        return failures_by_cause(self.rows)

    def as_json(self) -> dict[str, Any]:
        """The summary as `--json` prints it."""
        grouped = [{"cause": cause, "recordings": names} for cause, names in self.failures]
        return {
            "recordings": len(self.rows), "done": self.done, "reused": self.reused, "failed": self.failed,
            "failures": grouped, "gone": list(self.gone), "index": str(self.index),
            **({} if self.remainder is None else {"remainder": asdict(self.remainder)}),
        }  # fmt: skip


def run_batch(
    folder: Path | str,
    out: Path | str,
    workers: int | None = None,
    scheduler: str | None = None,
    options: Options | None = None,
    progress: errors.Progress = lambda share: None,
    *,
    again: bool = False,
    timeout_s: float | None = None,
    task: Task | None = None,
    sample: int | None = None,
) -> BatchSummary:
    """Process every ``*.mcap`` below ``folder`` into ``out``, parts of one recording as one, and write the index.

    ``workers`` is the number of processes, that of the cores without it; ``scheduler`` an address like
    ``tcp://host:8786`` instead. Results of equal provenance are used as they are unless ``again``. A
    recording that takes longer than ``timeout_s`` [s] fails. ``task`` replaces the work on one recording. With a
    ``sample`` so many recordings are processed, spread over all, and what remains is told with its time.
    Raises :class:`InputError` for a folder or an address that is none, :class:`DataShortageError` for one without
    recordings, :class:`SourceError` for a scheduler that cannot be reached, :class:`StorageError` when
    ``out`` cannot be written or another batch is writing there.
    """
    folder, out = Path(folder), Path(out)
    if stores.is_remote(out):
        with TemporaryDirectory(prefix="seatrial-") as place:
            summary = _run_batch(
                folder, Path(place).resolve(), workers, scheduler, options, progress,
                again=again, timeout_s=timeout_s, task=task or process_into_store, sample=sample,
                store=stores.place_name(out),
            )  # fmt: skip
            for name in ("index.parquet", CRITERIA, "index.html"):
                stores.upload(Path(place, name), out / name)
            return replace(summary, index=out / "index.html")
    return _run_batch(
        folder, out.resolve(), workers, scheduler, options, progress, again=again, timeout_s=timeout_s, task=task,
        sample=sample,
    )  # fmt: skip


def _run_batch(
    folder: Path,
    out: Path,
    workers: int | None,
    scheduler: str | None,
    options: Options | None,
    progress: errors.Progress,
    *,
    again: bool,
    timeout_s: float | None,
    task: Task | None,
    sample: int | None = None,
    store: str = "",
) -> BatchSummary:
    """As :func:`run_batch`; with a ``store``, the address where the results go, ``out`` is a temporary folder."""
    place = Path(store) if store else out
    if (folder if stores.is_remote(folder) else folder.resolve()).is_relative_to(place):
        raise errors.InputError(
            "the recordings are in the output folder", where=store or str(out), fix="name another with -o"
        )
    check_address(scheduler)
    recordings = recordings_below(folder, out)
    if not recordings:
        raise errors.DataShortageError(
            "contains no recording", where=stores.place_name(folder), fix="name a folder with .mcap files"
        )
    names, chosen = result_names(folder, recordings), options or Options()
    file_names = [
        [stores.place_name(path if stores.is_remote(path) else path.absolute()) for path in paths]
        for paths in recordings
    ]
    jobs = [
        BatchJob(name, paths[0], str(out), chosen, again, timeout_s, tuple(paths[1:]), store)
        for name, paths in zip(names, file_names, strict=True)
    ]
    sizes = _recording_sizes(folder, recordings)
    process.announce(f"{len(jobs):,} recordings, {sum(sizes) / 1e6:,.1f} MB")
    selected = np.unique(np.linspace(0, len(jobs) - 1, min(sample or len(jobs), len(jobs))).round().astype(int))
    with lock_batch_folder(out):
        start_s = time.monotonic()
        rows = run_jobs([jobs[number] for number in selected], task or process_job, workers, scheduler, progress)
        remainder = (
            BatchRemainder.from_sample(rows, selected, sizes, time.monotonic() - start_s) if sample else None
        )
        for row, paths in zip(rows, (recordings[number] for number in selected), strict=True):
            row["path"] = errors.printable_path(paths[0].relative_to(folder))
        if store:
            _fetch_for_index(rows, out, store)
        reused = sum(row.pop("reused", False) and row["status"] == "done" for row in rows)
        gone = rows_without_recording(set(names), out)
        index = write_index(
            [*rows, *gone],
            out,
            errors.printable_path((folder if stores.is_remote(folder) else folder.resolve()).name),
        )
        runs: dict[str, list[Manoeuvre]] = {}  # of each ship, from all its recordings
        for row in rows:
            if row["status"] == "done" and row.get("manoeuvres"):
                document = json.loads((out / row["name"] / "manoeuvres.json").read_text(encoding="utf-8"))
                runs.setdefault(row["vessel"], []).extend(map(Manoeuvre.from_json, document["manoeuvres"]))
        write_json_file(out / CRITERIA, {"criteria": tables.criteria_by_vessel(runs)})
    done = sum(row["status"] == "done" for row in rows)
    return BatchSummary(
        rows, done, reused, index, tuple(gone), dict(zip(names, recordings, strict=True)), remainder
    )


def _recording_sizes(folder: Path, recordings: Sequence[Sequence[Path]]) -> list[int]:
    """The size of each recording with its parts [bytes]; 0 of what is no file."""
    sizes = stores.sizes_below(folder, ".mcap") if stores.is_remote(folder) else dict[Path, int]()
    for path in (path for paths in recordings for path in paths if path not in sizes):
        with suppress(OSError):
            sizes[path] = path.stat().st_size
    return [sum(sizes.get(path, 0) for path in paths) for paths in recordings]


def process_job(job: BatchJob) -> Row:
    """The task of a worker for one recording: it returns a row whatever happens, unless the worker dies."""
    return run_job_or_fail(job, reuse_or_process)


def reuse_or_process(job: BatchJob) -> Row:
    """The row of a recording: that of an earlier result if it is as good as a new one, else of one made now."""
    with stores.local_copies([Path(job.path), *map(Path, job.later)]) as (path, *later):
        row = None if job.again else reusable_row(path, job.folder, job.options, job.name, later)
        if row is not None and is_index_row(row):
            return {**row, "reused": True}
        return process_recording(path, job.folder, job.options, job.name, later)


def process_into_store(job: BatchJob) -> Row:
    """As :func:`process_job`, for a job whose result goes into an object store."""
    job.attempts_file.parent.mkdir(parents=True, exist_ok=True)  # on another computer it is not there yet
    return run_job_or_fail(job, _reuse_or_deliver)


def _reuse_or_deliver(job: BatchJob) -> Row:
    """The row of a recording, and its result in the store; the summary, by which it is complete, comes last."""
    place = Path(job.store, job.name)
    with TemporaryDirectory(prefix="seatrial-") as scratch:
        local = replace(job, out=scratch)
        if not job.again and stores.exists(place / SUMMARY):
            local.folder.mkdir(parents=True)
            with stores.local_copies([place / SUMMARY]) as (summary,):
                shutil.copy(summary, local.folder)
        row = reuse_or_process(local)
        if not row.get("reused"):
            stores.remove(place / SUMMARY)
            results = sorted(local.folder.iterdir(), key=lambda path: (path.name == SUMMARY, path.name))
            names = {path.name for path in results}
            for older in stores.files_below(place):
                if older.parent == place and older.name not in names:
                    stores.remove(older)
            for path in results:
                stores.upload(path, place / path.name)
    return row


def _fetch_for_index(rows: Sequence[Row], output_folder: Path, store: str) -> None:
    """Fetch of the results in a store what the index is made of besides the rows; without those of failures."""
    place, names = Path(store), {row["name"] for row in rows}
    tested = {row["name"] for row in rows if row["status"] == "done" and row.get("manoeuvres")}
    failed = {row["name"] for row in rows if "provenance" not in row}
    for path in stores.files_below(store):
        name = path.parent.relative_to(place).as_posix()
        copy = output_folder / path.relative_to(place)
        if path.name == SUMMARY and name in failed:  # of an earlier result, which is no longer true
            stores.remove(path)
        elif (path.name == SUMMARY and name not in names) or (path.name == "manoeuvres.json" and name in tested):
            copy.parent.mkdir(parents=True, exist_ok=True)
            with stores.local_copies([path]) as (fetched,):
                shutil.copy(fetched, copy)
        elif path.name == REPORT:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.touch()


def recordings_below(folder: Path, output_folder: Path) -> list[tuple[Path, ...]]:
    """The recordings ``*.mcap`` below a folder, in the order of their names, without the output folder.

    The files of a recording in parts are together. A folder that cannot be read is listed itself.
    """
    if stores.is_remote(folder):
        return reader.parts_by_recording(
            [path for path in stores.files_below(folder, ".mcap") if not path.name.startswith(".")]
        )
    if not folder.is_dir():
        raise errors.InputError(
            "is no folder" if folder.exists() else "does not exist",
            where=str(folder),
            fix="give the folder of the recordings",
        )
    paths: list[Path] = []
    unreadable: list[OSError] = []
    for root, folders, file_names in os.walk(folder, onerror=unreadable.append):
        folders[:] = [name for name in folders if os.path.realpath(Path(root, name)) != str(output_folder)]
        names = (name for name in (*folders, *file_names) if name.endswith(".mcap") and not name.startswith("."))
        paths += (Path(root, name) for name in names)
    return reader.parts_by_recording(sorted({*paths, *(Path(error.filename) for error in unreadable)}))


def result_names(folder: Path, recordings: Sequence[Sequence[Path]]) -> list[str]:
    r"""A name for each recording's result below a folder: the relative path of its first file without suffix,
    changed where two would meet.

    It is fit for any file system, page and program: bytes that are no text and control characters are escaped, what
    is too long for a folder is shortened, nothing is hidden, and two names differ in more than case and encoding.

    >>> paths = ["a.mcap", "a/b.mcap", "index.html.mcap", ".c/B.mcap", "_c/b.mcap"]
    >>> result_names(Path(), [[Path(path)] for path in paths])
    ['a_', 'a/b', 'index.html_', '_c/B', '_c/b_']
    """
    texts = []
    for first, *_ in recordings:
        parts = []
        for text in first.relative_to(folder).as_posix().removesuffix(".mcap").split("/"):
            name = errors.printable_path(text)
            name = f"_{name[1:]}" if name.startswith(".") else name
            if len(name.encode()) > _LONGEST_NAME_BYTES:
                digest = hashlib.sha256(os.fsencode(text)).hexdigest()[:_DIGEST_LETTERS]
                kept = name.encode()[: _LONGEST_NAME_BYTES - _DIGEST_LETTERS - 1]
                name = f"{kept.decode(errors='ignore')}~{digest}"
            parts.append(name)
        texts.append("/".join(parts))
    parents = {parent.as_posix() for text in texts for parent in Path(text).parents}
    taken, names = set(map(_case_folded_name, _RESERVED | parents)), []
    for name in texts:
        while _case_folded_name(name) in taken:
            name += "_"
        taken.add(_case_folded_name(name))
        names.append(name)
    return names


def _case_folded_name(name: str) -> str:
    """A name folded so that two which a file system may take for one are equal."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def failures_by_cause(rows: Sequence[Mapping[str, Any]]) -> Failures:
    """Failed recordings by cause; causes that differ in their numbers only are one, with N for each number.

    >>> failures_by_cause([{"name": str(n), "status": "failed", "cause": f"damaged near byte {n}"} for n in (1, 2)])
    [('damaged near byte N', ['1', '2'])]
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] == "failed":
            groups.setdefault(_NUMBER.sub("N", row["cause"]), []).append(row)
    failures = []
    for pattern, failed in groups.items():
        causes = {row["cause"] for row in failed}
        failures.append((causes.pop() if len(causes) == 1 else pattern, sorted(row["name"] for row in failed)))
    return sorted(failures, key=lambda failure: (-len(failure[1]), failure[0]))


def is_index_row(values: Mapping[str, Any]) -> bool:
    """Whether values from a file are a row of the index, and not from another program or a person."""
    try:
        table_of_recordings([values])
    except Exception:  # whatever pandas makes of them
        return False
    return True


def table_of_recordings(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The rows as a table with the same kinds of columns whatever failed: counts are whole or missing.

    Counts by code, by reason and by kind are in columns of their own, like ``findings_by_code.spikes``: 0 where a
    recording was judged without it.
    """
    columns: dict[str, Any] = {
        name: _series_of_dtype([row.get(name) or "" for row in rows], "str") for name in TEXTS
    }
    columns["closed"] = _series_of_dtype([row.get("closed") for row in rows], "boolean")
    missing = [None if row.get("missing") is None else " ".join(row["missing"]) for row in rows]
    columns["missing"] = _series_of_dtype(missing, "str")
    starts = _series_of_dtype([row.get("start") for row in rows], "object")
    columns["start"] = pd.to_datetime(starts, utc=True, format="ISO8601").dt.as_unit("ns")
    for name, dtype in (dict.fromkeys(MEASURES, "Float64") | dict.fromkeys(COUNTS, "Int64")).items():
        columns[name] = _series_of_dtype([row.get(name) for row in rows], dtype)
    for name in (*NESTED_COUNTS, "indices"):
        dtype, absent = ("Float64", None) if name == "indices" else ("Int64", 0)
        for key in sorted({key for row in rows for key in row.get(name) or {}}):
            counts = [None if row.get(name) is None else row[name].get(key, absent) for row in rows]
            columns[f"{name}.{key}"] = _series_of_dtype(counts, dtype)
    for name in ("bytes", "sha256", "options", "software"):
        values = [row.get("provenance", {}).get(name) for row in rows]
        texts = [json.dumps(value) if isinstance(value, dict) else value for value in values]
        columns[name] = _series_of_dtype(texts, "Int64" if name == "bytes" else "str")
    return pd.DataFrame(columns)


def _series_of_dtype(values: Sequence[Any], dtype: str) -> Any:
    return pd.Series(list(values), dtype=dtype)


def rows_without_recording(names: Collection[str], output_folder: Path) -> list[dict[str, Any]]:
    """The rows of complete results below ``output_folder`` that belong to none of ``names``, by name."""
    rows = []
    for path in sorted(output_folder.rglob(SUMMARY)):
        name = path.parent.relative_to(output_folder).as_posix()
        try:
            row = files.read_json(path)
            is_result = name not in names and row["provenance"]["recording"] == name and is_index_row(row)
        except (OSError, ValueError, LookupError, TypeError):
            continue  # another program's file of that name
        if is_result:
            rows.append({**row, "name": name, "status": GONE, "cause": "its recording is not there any more"})
    return rows


def write_index(rows: Sequence[Mapping[str, Any]], output_folder: Path, title: str) -> Path:
    """Write ``index.parquet`` and ``index.html`` into ``output_folder`` and return the path of the page.

    Raises :class:`seatrial.acquisition.core.errors.StorageError` when they cannot be written.
    """
    rows = [{**row, "report": (output_folder / row["name"] / REPORT).is_file()} for row in rows]
    with files.written_together(output_folder / "index.parquet"):
        write_parquet(
            table_of_recordings(rows),
            output_folder / "index.parquet",
            MEASURES,
            {"batch": json.dumps({"of": title})},
        )
        return pages.index_page(rows, failures_by_cause(rows), title).write(output_folder / "index.html")


def read_index(path: Path | str) -> pd.DataFrame:
    """The index as a table. Raises :class:`InputError` for any other file."""
    return read_parquet(path)[0]
