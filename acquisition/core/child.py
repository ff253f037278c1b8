"""A script in a process of its own, under limits: what a library does with a hostile file ends there."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from seatrial.acquisition.core.budget import CPU_SECONDS, MEMORY_BYTES, TABLE_CELLS, how_to_raise
from seatrial.acquisition.core.errors import InputError

_REFUSED = 3  # the exit code of a script that refuses a file, and says why on stderr
_MOST_LETTERS = 300


def read_in_child(script: Path, reader: str, path: Path) -> Any:
    """What a script's ``reader`` makes of a file: the script is given its name, the path and its limits.

    The limits are bytes of memory, seconds of processor, and cells. Raises :class:`InputError` for a file that the
    script refuses, or that takes more than its budget.
    """
    size_bytes = path.stat().st_size
    limits = [str(budget.allowance(size_bytes)) for budget in (MEMORY_BYTES, CPU_SECONDS, TABLE_CELLS)]
    command = [sys.executable, "-P", str(script), reader, os.fspath(path.absolute()), *limits]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1"}
    result, received = None, False
    with (
        TemporaryFile() as stderr,
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=stderr, env=environment
        ) as process,
    ):
        try:
            assert process.stdout is not None
            result, received = pickle.load(process.stdout), True
        except (EOFError, pickle.UnpicklingError):
            pass
        except BaseException:
            process.kill()
            raise
        code = process.wait()
        stderr.seek(0)
        error_lines = stderr.read().decode(errors="replace").strip().splitlines()
    if code == _REFUSED:
        raise InputError(
            f"is not a readable {path.suffix} table",
            where=str(path),
            why=error_lines[-1][:_MOST_LETTERS] if error_lines else "",
        )
    if code or not received:
        memory, seconds = int(limits[0]), int(limits[1])
        why = f"the budget of a file of {size_bytes:,} bytes is {memory:,} bytes of memory and {seconds} s"
        raise InputError("takes too much memory or time", where=str(path), why=why, fix=how_to_raise())
    return result
