"""A command interrupted at each change that it makes to the disk: killed, ended, refused by the system, paused.

An audit hook counts the changes of a forked process: files opened for writing, renamed and removed, folders made.
That needs no word in the product, and the same command has the same changes every time.
"""

from __future__ import annotations

import errno
import os
import resource
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

Act = Callable[[], object]
"""What is interrupted; it runs in the folder that it changes."""
_CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


@dataclass(frozen=True, slots=True)
class End:
    """How one process ended: exit code (negative: killed by that signal), errors, number of changes to the disk."""

    code: int
    err: str
    changes: int = 0


Interruption = Callable[[], None]
Interrupted = tuple[End, Path, Path]
"""How a command ended, the folder that it left, and that folder after the same command once more."""
UNDISTURBED = "undisturbed"


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def pause() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def refuse_full() -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def refuse_read_only() -> None:
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


class CommandLine:
    """``seatrial`` with arguments, in this process."""

    def __init__(self, *arguments: str) -> None:
        self.arguments = arguments

    def __call__(self) -> None:
        import seatrial

        sys.argv = ["seatrial", *self.arguments]
        seatrial.main()


def in_fresh_process(work: Callable[..., Any], *arguments: Any) -> Any:
    """The result of ``work`` in a process that has no thread yet, and starts none that does not survive a fork."""
    os.environ["NUMBA_THREADING_LAYER"] = "workqueue"
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(work, arguments)


def interrupted_everywhere(
    earlier: Act | None, act: Act, start: Path, interruption: Interruption, results: Path, most: int = 1000
) -> list[Interrupted]:
    """Run ``act`` in a copy of ``start`` for each of its changes, or so many of them, and interrupt it there.

    ``earlier`` runs in ``start`` before all. What ``act`` does undisturbed is left in ``results``. It runs in a
    process of its own (:func:`in_fresh_process`).
    """
    count = _prepare(earlier, act, start, results)
    numbers = sorted({1 + place * count // most for place in range(min(most, count))} | {count})
    if most >= count:
        numbers = list(range(1, count + 1))
    return [
        _once(act, start, results / f"{number}", number=number, interruption=interruption) for number in numbers
    ]


def cut_off(earlier: Act | None, act: Act, start: Path, results: Path, *, killed: bool) -> list[Interrupted]:
    """As :func:`interrupted_everywhere`, where no file can grow beyond some bytes.

    It is killed there, or refused as on a full disk. The sizes: nothing, a header, all but the end of the largest.
    """
    _prepare(earlier, act, start, results)
    before, after = visible(start), visible(results / UNDISTURBED)
    largest = max(len(content) for path, content in after.items() if content != before.get(path))
    sizes = sorted({1, 50, largest - 1})
    return [_once(act, start, results / f"{size}", limit_bytes=size, dies=killed) for size in sizes]


def _prepare(earlier: Act | None, act: Act, start: Path, results: Path) -> int:
    """Run what came earlier, and the command itself without interruption; how often it changes the disk."""
    if earlier is not None:
        act_in(earlier, start)
    _warm(act, start)
    shutil.copytree(start, results / UNDISTURBED)
    end = forked(act, results / UNDISTURBED)
    assert end.code == 0, end
    return end.changes


def _once(act: Act, start: Path, folder: Path, **how: Any) -> Interrupted:
    shutil.copytree(start, folder)
    end = forked(act, folder, **how)
    resumed = folder.with_name(f"{folder.name}_resumed")
    shutil.copytree(folder, resumed)
    forked(act, resumed)
    return end, folder, resumed


def paused_everywhere(
    first: Act, second: Act, start: Path, results: Path, *, killed: bool = False
) -> list[tuple[End, End, Path]]:
    """Pause ``first`` at each of its changes, run all of ``second`` meanwhile, let the first go on or kill it.

    How both ended, and the folder that they left.
    """
    _warm(first, start)
    count = _count(first, start)
    ends = []
    for number in range(1, count + 1):
        folder = results / f"{number}"
        shutil.copytree(start, folder)
        pid, err = _fork(first, folder, number, pause)
        os.waitpid(pid, os.WUNTRACED)
        if killed:
            os.kill(pid, signal.SIGKILL)
            end, during = _ended(pid, err), forked(second, folder)
        else:
            during = forked(second, folder)
            os.kill(pid, signal.SIGCONT)
            end = _ended(pid, err)
        ends.append((end, during, folder))
    return ends


def forked(
    act: Act,
    folder: Path,
    number: int = 0,
    interruption: Interruption = kill,
    limit_bytes: int = 0,
    dies: bool = False,
) -> End:
    """Run ``act`` in ``folder`` in a forked process, interrupted at change ``number``."""
    pid, err = _fork(act, folder, number, interruption, limit_bytes, dies)
    return _ended(pid, err)


def _warm(act: Act, start: Path) -> None:
    """Run ``act`` in this process, so that none of its forks imports or compiles anything."""
    with tempfile.TemporaryDirectory() as place:
        shutil.copytree(start, Path(place) / "warm")
        act_in(act, Path(place) / "warm")


def act_in(act: Act, folder: Path) -> None:
    """Run ``act`` in a folder, in this process."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        act()
    except SystemExit:
        pass
    finally:
        os.chdir(before)


def _count(act: Act, start: Path) -> int:
    with tempfile.TemporaryDirectory() as place:
        scratch = Path(place) / "count"
        shutil.copytree(start, scratch)
        return forked(act, scratch).changes


def _fork(
    act: Act, folder: Path, number: int, interruption: Interruption, limit_bytes: int = 0, dies: bool = False
) -> tuple[int, int]:
    """The number of the forked process, and a pipe with its errors, of which it has few."""
    err, other_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            _run(act, folder, number, interruption, other_end, limit_bytes, dies)
        finally:
            os._exit(99)
    os.close(other_end)
    return pid, err


def _run(
    act: Act, folder: Path, number: int, interruption: Interruption, err: int, limit_bytes: int, dies: bool
) -> None:
    """The forked process: its exit code is the command's, its count of changes the last line of its errors."""
    with Path(os.devnull).open("w") as null:
        os.dup2(null.fileno(), 1)
    os.dup2(err, 2)
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
    os.chdir(folder)
    changes = 0

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal changes
        if _changes_disk(event, arguments, str(folder)):
            changes += 1
            if changes == number:
                interruption()

    sys.addaudithook(watch)
    if limit_bytes:
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL if dies else signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, resource.RLIM_INFINITY))
    code = 0
    try:
        act()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(bool(error.code))
    except KeyboardInterrupt:
        code = 130
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    sys.stderr.flush()
    os.write(2, f"\nchanges {changes}".encode())
    os._exit(code)


def _changes_disk(event: str, arguments: tuple[Any, ...], folder: str) -> bool:
    if event == "open":
        path, _, flags = arguments
        return isinstance(path, str | bytes | os.PathLike) and bool(flags & _WRITING) and _is_in(path, folder)
    return event in _CHANGES and _is_in(arguments[0], folder)


def _is_in(path: Any, folder: str) -> bool:
    text = os.fsdecode(path) if isinstance(path, str | bytes | os.PathLike) else ""
    return not text.startswith("/") or text.startswith(folder)


def _ended(pid: int, err: int) -> End:
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with os.fdopen(err, "rb") as stream:
        text, _, count = stream.read().decode(errors="backslashreplace").rpartition("\nchanges ")
    return End(code, text if count.isdigit() else text + count, int(count) if count.isdigit() else 0)


def visible(folder: Path) -> dict[str, bytes]:
    """What is in the files below a folder, without hidden ones."""
    return {name: content for name, content in _files(folder) if not name.startswith(".") and "/." not in name}


def hidden(folder: Path) -> list[str]:
    """The hidden files and folders below a folder."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob(".*"))


def _files(folder: Path) -> Iterator[tuple[str, bytes]]:
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            yield path.relative_to(folder).as_posix(), path.read_bytes()
