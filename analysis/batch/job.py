"""What a worker does for one recording of a batch: a row comes back whatever happens, short of its death.

A recording that takes its worker down with it, or hangs, is known by the marks that every attempt leaves in the
output folder: no scheduler can tell which of a dead worker's tasks was to blame.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from analysis.batch.one_recording import SUMMARY, process, reusable
from analysis.batch.products import Options, cause_of
from analysis.batch.row import Row

MOST_ATTEMPTS = 3
"""So often a recording may take its worker down before it is left alone."""

MARKS = ".attempts"
"""The folder of the marks, in the output folder."""


@dataclass(frozen=True, slots=True)
class Job:
    """One recording to be processed; everything a worker must know, in plain values."""

    name: str
    path: str
    out: str
    options: Options
    again: bool = False
    timeout_s: float | None = None

    @property
    def folder(self) -> Path:
        """Where its result stands."""
        return Path(self.out) / self.name

    @property
    def mark(self) -> Path:
        """A file with one byte for each attempt at it that has not come to an end."""
        return Path(self.out) / MARKS / self.name.replace("/", "\\")


def attempt(job: Job) -> Row:
    """What a worker does for one recording: a row comes back whatever happens, short of the worker's death."""
    return tried(job, _result)


def tried(job: Job, work: Callable[[Job], Row]) -> Row:
    """The row that ``work`` makes of a job with the job's name on it, or that of its failure; with marks."""
    ended = _attempts_ended(job)
    if ended:
        return failed_row(job, ended)
    try:
        with job.mark.open("ab") as mark:
            mark.write(b".")
        with _watched(job.timeout_s):
            return {"name": job.name, **work(job)}
    except Exception as error:  # whatever it is, it is this job's and no other's
        return failed_row(job, cause_of(error))
    finally:
        job.mark.unlink(missing_ok=True)


def _result(job: Job) -> Row:
    path = Path(job.path)
    row = None if job.again else reusable(path, job.folder, job.options, job.name)
    return process(path, job.folder, job.options, job.name) if row is None else {**row, "reused": True}


def _attempts_ended(job: Job) -> str:
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


def failed_row(job: Job, cause: str) -> Row:
    """The row of a recording of which nothing could be made; what was made of it earlier is no longer true."""
    if (job.folder / SUMMARY).is_file():
        shutil.rmtree(job.folder, ignore_errors=True)
    return {"name": job.name, "status": "failed", "cause": cause}
