"""The process: signals that end a recording, standard streams whose failure must not, and limits for foreign files.

A small file can unpack to more than a machine holds. What an honest file unpacks to is in proportion to its bytes:
each budget is an allowance for a file of any size and a multiple of its bytes, several times what the densest
honest files were measured to need. ``SEATRIAL_BUDGET`` multiplies all of them. A library that may fall for a
hostile file reads it in a child process. Nothing heavy is imported here, so that signals and streams come first.
"""

from __future__ import annotations

import _thread
import importlib
import io
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from types import FrameType
from typing import Any

from seatrial.acquisition.core import errors

BUDGET_VARIABLE = "SEATRIAL_BUDGET"
_STDOUT = 1
_KEYS_POLL_S = 0.2
_REFUSED = 3  # the exit code of a script that refuses a file, and says why on stderr
_MOST_LETTERS = 300
_DROPPED_AGAIN_S = 0.01  # after a termination that Python dropped
_MEGA = 1_000_000
_active: list[threading.Event] = []


def guard_standard_streams() -> None:
    """Replace missing standard streams by the null device, and outputs by ones that tolerate a closed reader.

    A reader that only takes our first line (``head``) does not make the work a failure, and a message that
    cannot be printed must not end a recording. A failure to write to stdout, such as a full disk, is reported
    once, since requested output is lost.
    """
    for name in ("stdin", "stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # takes the lowest free descriptor, the missing one, so that no recording gets it
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115 - to the end
        elif name != "stdin" and stream is getattr(sys, f"__{name}__"):  # and not a test's
            if isinstance(stream, io.TextIOWrapper):
                stream.flush()
                stream = io.TextIOWrapper(
                    io.BufferedWriter(_Output(stream.fileno())),
                    encoding=stream.encoding,
                    errors="backslashreplace",  # a symbol that the terminal's encoding lacks is no reason to fail
                    line_buffering=stream.line_buffering,
                    write_through=stream.write_through,
                )
            setattr(sys, name, stream)


_ANNOUNCING: ContextVar[bool] = ContextVar("announcing", default=False)


def announce(line: object, *, err: bool = True) -> None:
    """Print a remark of a function, if it runs as a command: on stderr, or with ``err=False`` on stdout."""
    if _ANNOUNCING.get():
        print_line(line, err=err)


def is_announcing() -> bool:
    """Whether a function runs as a command."""
    return _ANNOUNCING.get()


@contextmanager
def show_announcements() -> Iterator[None]:
    """Show what is announced within."""
    token = _ANNOUNCING.set(True)
    try:
        yield
    finally:
        _ANNOUNCING.reset(token)


def print_line(line: object, *, err: bool = False) -> None:
    """Print a line of a command, in which control characters and the bytes of odd file names are escaped."""
    print(errors.escape_control_characters(str(line)), file=sys.stderr if err else sys.stdout, flush=True)


class _Output(io.FileIO):
    """An output descriptor that discards everything after its first failure."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._failed = False

    def write(self, data: Any, /) -> int:
        if self._failed:
            return len(data)
        try:
            return super().write(data) or 0
        except OSError as error:
            self._failed = True
            if self.fileno() == _STDOUT and not isinstance(error, BrokenPipeError):
                raise errors.StorageError(
                    "cannot be written", where="standard output", why=error.strerror or "", fix="send it elsewhere"
                ) from error
            return len(data)


def start_thread_if_possible(thread: threading.Thread) -> bool:
    """Start a thread; False where the system gives none now, which may be tried again."""
    try:
        thread.start()
    except RuntimeError:
        return False
    return True


@contextmanager
def keys_taken(take: Callable[[str], None]) -> Iterator[None]:
    """Pass keys from standard input, if that is a terminal, one by one to ``take``, in a thread of its own."""
    if not sys.stdin.isatty():
        yield
        return
    import termios  # systems without it have no such terminal
    import tty

    descriptor = sys.stdin.fileno()
    settings = termios.tcgetattr(descriptor)
    stopping = threading.Event()
    listener = threading.Thread(target=_take_keys, args=(descriptor, take, stopping), name="keys", daemon=True)
    tty.setcbreak(descriptor)  # Ctrl-C still ends the work
    is_listening = start_thread_if_possible(listener)
    try:
        yield
    finally:
        stopping.set()
        if is_listening:
            listener.join()
        termios.tcsetattr(descriptor, termios.TCSADRAIN, settings)


def _take_keys(descriptor: int, take: Callable[[str], None], stopping: threading.Event) -> None:
    while not stopping.is_set():
        readable, _, _ = select.select([descriptor], [], [], _KEYS_POLL_S)
        if not readable:
            continue
        try:
            typed = os.read(descriptor, 16).decode("utf-8", "ignore")
        except OSError:  # the terminal is gone; its signal ends the work
            return
        for key in typed:
            take(key)


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event set by SIGINT, SIGTERM and hangup, so that all of them end a recording cleanly.

    Under ``nohup``, which ignores hangups, the recording goes on. Nested uses share one event, so a signal that
    arrives while the program is loading is not lost.
    """
    if _active:
        yield _active[0]
        return
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    numbers = [signal.SIGINT, signal.SIGTERM]
    hangup = getattr(signal, "SIGHUP", None)  # Windows has none
    if hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN:
        numbers.append(hangup)
    previous = {number: signal.signal(number, handle) for number in numbers}
    _active.append(stop)
    try:
        yield stop
    finally:
        _active.clear()
        for number, handler in previous.items():
            signal.signal(number, handler)


class Termination(KeyboardInterrupt):
    """The process was asked to end by SIGTERM, as systemd and a cluster's queue do."""


@contextmanager
def interrupt_on_terminate() -> Iterator[None]:
    """SIGTERM ends the work inside as Ctrl-C does, instead of killing the process at once.

    In a finaliser or a callback of the garbage collector Python prints an exception and drops it; the signal is
    sent again then, until it ends the work.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: the process is already ending
        raise Termination

    def handle_dropped(dropped: sys.UnraisableHookArgs) -> None:
        if dropped.exc_type is not Termination:
            previous_hook(dropped)
            return
        signal.signal(signal.SIGTERM, stop)
        threading.Timer(_DROPPED_AGAIN_S, terminate).start()  # what is raised here is dropped, too

    def terminate() -> None:
        if hasattr(signal, "pthread_kill") and (main := threading.main_thread().ident) is not None:
            signal.pthread_kill(main, signal.SIGTERM)  # wakes it where it waits
        else:  # Windows
            _thread.interrupt_main(signal.SIGTERM)

    previous_hook, sys.unraisablehook = sys.unraisablehook, handle_dropped
    previous = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)
        sys.unraisablehook = previous_hook


@dataclass(frozen=True, slots=True, eq=False)
class FileBudget:
    """How much of ``what`` (a plural) a file may hold: ``least``, and ``per_byte`` for each byte on disk."""

    what: str
    least: int
    per_byte: float = 0.0

    def allowed_amount(self, file_bytes: int) -> int:
        """What a file of this size may hold. Raises :class:`ConfigurationError` for a malformed factor."""
        return int(budget_factor_from_environment() * (self.least + self.per_byte * file_bytes))

    def require_within_budget(
        self, amount: int, path: Path | str, file_bytes: int, kind: type[errors.SeatrialError] = errors.InputError
    ) -> None:
        """Raise an error of this ``kind`` for a file that holds more than its allowance."""
        allowance = self.allowed_amount(file_bytes)
        if amount > allowance:
            raise kind(
                f"has at least {amount:,} {self.what}", where=str(path),
                why=f"the budget of a file of {file_bytes:,} bytes is {allowance:,}", fix=budget_remedy_text(),
            )  # fmt: skip


EXPANDED_BYTES = FileBudget("unpacked bytes", 256 * _MEGA, 200.0)
"""Of compressed chunks. A recording of constant values by this recorder unpacks to 2.6 times its size, one by the
mcap library without indexes of messages to 35 times; zstd at its worst to 30,000 times."""

MESSAGES = FileBudget("messages", 100_000, 1.0)
"""The recorder takes 30 bytes a message, the mcap library, without indexes of messages, 2.3 of constant values."""

DEFINITIONS = FileBudget("definitions of topics", 150_000, 0.1)
"""There are 65,535 topics and as many schemas at most; the recorder repeats some 30 every 300 chunks."""

DESCRIPTION_BYTES = FileBudget("bytes of definitions, metadata, attachments, events and states", 64 * _MEGA, 2.0)
"""They are kept in memory. The recorder writes 20 kB, and the configuration with its DBC files."""

RECORDING_CELLS = FileBudget("cells", 50_000_000, 20.0)
"""Rows by columns, 8 bytes each. The densest recording (2.3 bytes a message) of 13 channels, none of which has its
times in common with another, has 6 a byte."""

TABLE_CELLS = FileBudget("cells", 5_000_000, 40.0)
"""Of foreign tables. Constant values beside a time: 0.4 a byte in .xlsx, 2 in Parquet, 7 in CSV by gzip, 11 in
.mat, 17 in HDF5, 21 in CSV by bzip2."""

TABLE_COLUMNS = FileBudget("columns", 2_000)
"""The widest table that we have met has 300; to recognise 20,000 by their names takes a minute."""

LOG_FIELDS = FileBudget("fields of topics", 10_000)
"""Of a log of several topics; PX4's has some 1,500. Each is recognised by its name, as columns are."""

TABLE_TEXT_BYTES = FileBudget("unpacked bytes of text", 32 * _MEGA, 200.0)
"""Constant values beside a time: gzip 37, bzip2 112, xz 360 times their size."""

LOG_BYTES = FileBudget("unpacked bytes of a log", 8 * _MEGA, 60.0)
"""CAN frames and sentences of constant values by gzip 20 to 28 times their size, containers of BLF less."""

MEMORY_BYTES = FileBudget("bytes of memory", 500 * _MEGA, 300.0)
"""Of a library that reads a table: 100 MB by itself, and twice the arrays, which are 88 times a .mat file of
constant values, 132 times one of HDF5."""

CPU_SECONDS = FileBudget("seconds of processor", 30, 2e-5)
"""Of the same: a spreadsheet takes 0.3 s a megabyte."""

XML_DEPTH = FileBudget("elements within each other", 100)
"""A point of a GPX track is the fourth, what extensions say of it the sixth."""

CONFIGURATION_BYTES = FileBudget("bytes", 4 * _MEGA)
"""Of a TOML file, or a table of commands: a hundred times the longest of ours."""

JSON_BYTES = FileBudget("bytes", 256 * _MEGA)
"""Of a JSON file: ours have kilobytes, the largest, what a diagnosis shows, some megabytes."""

CALIBRATOR_BYTES = FileBudget("bytes", 1024 * _MEGA)
"""Of a file of a calibrator: ours have up to 4 MB; a user's may keep its training data."""

DBC_BITS = FileBudget("bits in one signal or bytes in one message", 15_000)
"""The longest message of J1939 has 1,785 bytes, 14,280 bits; cantools takes time by the square."""

DBC_BYTES, DBC_TEXT_BYTES = FileBudget("bytes", 8 * _MEGA), FileBudget("letters in one text", 100_000)
"""Of a DBC file (those of whole trucks are 5 MB), and of a comment in it, of which cantools takes 240 bytes a
letter."""

NAME_BYTES = FileBudget("bytes in a name or a sample", 10_000)
"""A sample has some 70, of JSON 300; no topic is named in more than a line."""

TEXT_BYTES = FileBudget("bytes in one text, cell or line", _MEGA)
"""The longest text in use is a trial's list of declared channels, some 100 kB."""


def budget_remedy_text() -> str:
    """How a user gets such a file read."""
    factor = 10 * budget_factor_from_environment()
    return f"if you trust the file, raise all budgets tenfold with {BUDGET_VARIABLE}={factor:g}"


def budget_factor_from_environment() -> float:
    """What the user multiplies all budgets by, 1 unless ``SEATRIAL_BUDGET`` says otherwise.

    Raises :class:`ConfigurationError` unless it is a positive number.
    """
    text = os.environ.get(BUDGET_VARIABLE, "").strip() or "1"
    try:
        factor = float(text)
    except ValueError:
        factor = -1.0
    if not (isfinite(factor) and factor > 0.0):
        raise errors.ConfigurationError(
            f"{BUDGET_VARIABLE}={text!r} is no factor", fix=f"set a number such as {BUDGET_VARIABLE}=10"
        )
    return factor


@dataclass(slots=True)
class Meter:
    """What the reading of one file has taken so far, compared with its budgets."""

    path: Path | str
    file_bytes: int
    _totals: dict[FileBudget, int] = field(default_factory=dict)
    _allowances: dict[FileBudget, int] = field(default_factory=dict)  # worked out once: a day has 400,000 chunks

    def record_file_growth(self, file_bytes: int) -> None:
        """Take note that the file is longer than it was."""
        self.file_bytes = file_bytes
        self._allowances.clear()

    def check(self, budget: FileBudget, amount: int) -> None:
        """Raise :class:`InputError` for an amount by itself beyond the budget."""
        if budget not in self._allowances:
            self._allowances[budget] = budget.allowed_amount(self.file_bytes)
        if amount > self._allowances[budget]:
            budget.require_within_budget(amount, self.path, self.file_bytes)

    def add(self, budget: FileBudget, amount: int) -> None:
        """Count ``amount`` more. Raises :class:`InputError` beyond the budget."""
        self._totals[budget] = total = self._totals.get(budget, 0) + amount
        self.check(budget, total)


def bytes_of_files(path: Path) -> int:
    """The bytes of a file, or of all files in a folder."""
    return (
        sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        if path.is_dir()
        else path.stat().st_size
    )


def read_in_child(script: Path, reader: str, path: Path, kind: str = "table") -> Any:
    """What a script's ``reader`` makes of a file or folder: the script is given its name, the path and its limits.

    The limits are bytes of memory, seconds of processor, and cells. Raises :class:`InputError` for a file that the
    script refuses, or that takes more than its budget.
    """
    size_bytes = bytes_of_files(path)
    limits = [str(budget.allowed_amount(size_bytes)) for budget in (MEMORY_BYTES, CPU_SECONDS, TABLE_CELLS)]
    command = [sys.executable, "-P", str(script), reader, os.fspath(path.absolute()), *limits]
    result, received = None, False
    with (
        TemporaryDirectory(prefix="seatrial-") as scratch,  # gone, too, when the script is killed
        TemporaryFile() as stderr,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=stderr,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1", "TMPDIR": scratch},
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
        raise errors.InputError(
            " ".join(filter(None, ("is not a readable", path.suffix, kind))),
            where=str(path),
            why=error_lines[-1][:_MOST_LETTERS] if error_lines else "",
        )
    if code or not received:
        memory, seconds = int(limits[0]), int(limits[1])
        why = f"the budget of a file of {size_bytes:,} bytes is {memory:,} bytes of memory and {seconds} s"
        raise errors.InputError("takes too much memory or time", where=str(path), why=why, fix=budget_remedy_text())
    return result


def import_can_without_asammdf() -> None:
    """Import python-can as if asammdf were not installed, for a process that does nothing but record.

    python-can imports asammdf wherever that is installed, to read and write measurements; it brings sympy,
    canmatrix and openpyxl: more than half of the time in which a recorder starts.
    """
    if "asammdf" in sys.modules:
        return
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    try:
        importlib.import_module("can")
    finally:
        del sys.modules["asammdf"]


def import_mf4_with_asammdf() -> Any:
    """The module ``can.io.mf4`` with asammdf; its classes raise NotImplementedError where that is not installed."""
    module = importlib.import_module("can.io.mf4")
    return module if module.asammdf else importlib.reload(module)
