"""Jobs done by worker processes, one JSON line each in a file: what stands there is not done again."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tests.benchmarks.diagnosis.work import Job, done, key_of

Plain = dict[str, Any]

_ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def stored(path: Path) -> dict[str, Plain]:
    """Results by key; what crashed is left out, so that it is tried again, and so is a line cut off in writing."""
    results: dict[str, Plain] = {}
    if not path.exists():
        return results
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            result = json.loads(line)
        except json.JSONDecodeError:
            continue
        results[result["key"]] = result
    return {key: each for key, each in results.items() if "crashed" not in each}


def carried_out(
    jobs: Sequence[Job],
    path: Path,
    workers: int,
    tell: Callable[[Plain], None] = lambda result: None,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Plain]:
    """Do the jobs whose results are not in the file yet; returns all of the file's, those that crashed too."""
    results = stored(path)
    waiting = [job for job in jobs if key_of(job) not in results]
    # Workers start afresh and read these: with threads of their own they would be in each other's way.
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool, path.open("a", encoding="utf-8") as file:
        if file.tell() and not path.read_bytes().endswith(b"\n"):
            file.write("\n")  # the last line was cut off in writing
        futures = [pool.submit(done, job) for job in waiting]
        for number, future in enumerate(as_completed(futures)):
            result = future.result()
            results[result["key"]] = result
            file.write(json.dumps(result, default=float) + "\n")
            file.flush()
            tell(result)
            progress((number + 1) / len(waiting))
    return results
