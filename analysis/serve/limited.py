"""Strangers' files are read in a process of their own, under limits of memory, time and what it writes.

A file may hold more than memory does, never come to an end, or end the program that reads it in native code. None
of that may be the end of the server: what happened is one line.
"""

from __future__ import annotations

import json
import os
import resource
import signal
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from threading import BoundedSemaphore

from seatrial.acquisition.core.errors import InputError, SeatrialError, unexpected

LONGEST_S = 600.0
"""An export of a day takes a minute, the import of 500 MB of text some minutes."""
LEAST_MEMORY_BYTES = 3 * 1024**3  # of addresses; the libraries alone take 1.5 GB of them
MOST_WRITTEN_BYTES = 8 * 1024**3
MOST_AT_ONCE = 2
_turns = BoundedSemaphore(MOST_AT_ONCE)
_Work = Callable[..., Sequence[str]]


def call_limited(function: _Work, *arguments: object, longest_s: float | None = None) -> list[str]:
    """The lines that a function says, called in a process of its own; it is to be importable, its arguments plain.

    Raises :class:`SeatrialError`: what the function raised, or that it took too long or its process ended.
    """
    longest_s = LONGEST_S if longest_s is None else longest_s
    if not _turns.acquire(timeout=longest_s):
        raise InputError("others are being read", fix="try again in a minute")
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_attend, args=(sender, function, arguments), daemon=True)
    try:
        process.start()
        sender.close()  # or the end of the process would pass unnoticed
        if not receiver.poll(longest_s):
            raise InputError(f"took longer than {longest_s:g} s to read", fix="read it on the command line")
        answer = json.loads(receiver.recv_bytes())  # no pickle: whoever sends it has read a stranger's file
    except (EOFError, OSError) as error:
        process.join()
        raise InputError(
            "ended the program that read it", why=_exit_reason(process.exitcode),
            fix="it needs more memory than there is, or is damaged; if it is sound, read it on the command line",
        ) from error  # fmt: skip
    finally:
        process.kill()
        process.join()
        receiver.close()
        _turns.release()
    if "error" in answer:
        raise SeatrialError(str(answer["error"]))
    return [str(line) for line in answer["lines"]]


def _exit_reason(code: int | None) -> str:
    with suppress(ValueError):
        return f"signal {signal.Signals(-(code or 0)).name}"
    return f"exit code {code}"


def _attend(pipe: Connection, function: _Work, arguments: tuple[object, ...]) -> None:
    """What the process does: one call, and the answer to it as JSON."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is for the server
    _limit()
    try:
        answer: dict[str, object] = {"lines": list(function(*arguments))}
    except Exception as error:  # whatever it is, it is this file's and no other's
        answer = {"error": str(unexpected(error))}
    pipe.send_bytes(json.dumps(answer).encode())


def _limit() -> None:
    """Bound what this process may take, and have it end first where memory is short, without a word on stderr."""
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
