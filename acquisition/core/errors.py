"""Errors, classified by what the caller can do about them.

::

    SeatrialError
    ├── ConfigurationError   a configuration or vessel file is wrong: edit the line named
    │   └── UsageError       options do not go together: give others
    ├── InputError           a file or a table given as input is unsuitable: give another
    ├── SourceError          a bus, port or socket cannot be opened or has failed: connect it and try again
    ├── StorageError         the recording cannot be written: make room, mount the disk, change permissions
    ├── DataShortageError    the input is sound but holds too little for the task: record more, ask for less
    └── ModelRangeError      the simulation left the range in which the model's coefficients are valid

Every message says what, where, why and what to do, in that order, on one line.

Foreign text (names of files, marks of the crew, cells of tables) is escaped before it reaches a terminal: a control
character would move the cursor, clear the screen or hide a warning; brackets would be taken for rich's markup.
Progress of long work is a bar on stderr if that is a terminal, else a line every half a minute.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from errno import EACCES, EAFNOSUPPORT, EEXIST, ENOSPC, ENOTTY, EPERM, EROFS, errorcode
from pathlib import Path
from socket import gaierror
from traceback import walk_tb
from typing import Any, Self, TypeVar

from rich.console import Console, ConsoleOptions, RenderableType
from rich.protocol import rich_cast
from rich.segment import Segment
from rich.text import Text

RECORD_A_LOG = "sentences and frames of a bus are recorded: `seatrial discover LOG -o trial.toml` begins it"
"""What to do with a log that is neither a table nor of topics."""
DEBUG_VARIABLE = "SEATRIAL_DEBUG"
"""The environment variable that has the command line print the traceback of an error."""

_LONGEST_REASON = 300  # characters: a validator's message may quote the whole input
_PACKAGE = "seatrial"
_LOOP = "Symlink loop"  # how pathlib's message on links that lead to themselves begins
_CURES = {
    ENOSPC: "make room on the disk",
    EACCES: "choose another folder, or ask for the right to write there",
    EPERM: "choose another folder, or ask for the right to write there",
    EROFS: "choose another folder: this one is read-only",
}
_PLAIN_REASONS = {ENOTTY: "it is no serial line", EAFNOSUPPORT: "this computer's system does not support it"}
"""For errors that the system words for programmers."""
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What a terminal may obey instead of showing: control characters of both sets, but tab and line feed; marks that
change the direction of writing; and surrogates, which stand for bytes of a file name that are no UTF-8."""
_FIRST_BYTE, _LAST_BYTE, _BYTES = "\udc80", "\udcff", 0xDC00  # the surrogates of such bytes
_PIPED_COLUMNS = 200

PROGRESS_INTERVAL_S = 30.0
"""The time before the first line of progress without a terminal, and between two: short work prints none."""


class SeatrialError(Exception):
    """The base of every error that Seatrial raises on purpose; its text is one line for a person."""

    def __init__(self, what: str, *, where: str = "", why: str = "", fix: str = "") -> None:
        self.what, self.where, self.why, self.fix = what, where, why, fix
        text = what
        if where:
            text = f"{where}: {text}"
        if why:
            text = f"{text}: {why}"
        if fix:
            text = f"{text}; {fix}"
        super().__init__(escape_control_characters(" ".join(text.split())))

    def at(self, where: Path | str) -> Self:
        """The same error, located elsewhere."""
        return type(self)(self.what, where=str(where), why=self.why, fix=self.fix)


class ConfigurationError(SeatrialError, ValueError):
    """A configuration or vessel file cannot be used as it is.

    Examples: an unknown unit, a source without a port, two sources with the same name.
    """


class UsageError(ConfigurationError):
    """Options that exclude each other, or one that is missing; ``where`` names the option."""


class InputError(SeatrialError, ValueError):
    """An input file is missing, empty, of another kind, or lacks what is needed.

    Examples: a text file called ``.mcap``, a table without ``heading_deg``.
    """


class SourceError(SeatrialError, OSError):
    """A source of frames cannot be opened or stopped working.

    Examples: no such CAN interface, a serial line that was unplugged, a port in use.
    """


class StorageError(SeatrialError, OSError):
    """A product cannot be written. Examples: disk full, read-only folder."""


class DataShortageError(SeatrialError, ValueError):
    """The input is sound but insufficient. Examples: no held window, only one leg to split."""


class ModelRangeError(SeatrialError, ArithmeticError):
    """The simulation left the range of speeds in which its coefficients are valid."""


def system_reason(error: BaseException) -> str:
    """Why the system refused, by the number in an error or in one of its causes; empty if none has one."""
    cause: BaseException | None = error
    while cause is not None:
        numbers = (getattr(cause, "errno", None), *cause.args[:1])
        if isinstance(cause, gaierror):
            return "no computer of this name is known"
        if type(cause).__module__ == "ssl":  # whose numbers are OpenSSL's; importing it takes a while
            reason = str(getattr(cause, "reason", None) or cause).lower().replace("_", " ")
            return f"the peer and this computer agree on no TLS: {reason}"
        for number in numbers:
            if isinstance(number, int) and number in errorcode:
                return _PLAIN_REASONS.get(number) or os.strerror(number)
        cause = cause.__cause__ or cause.__context__
    return ""


def storage_error(path: Path | str, error: OSError, problem: str = "cannot be written") -> StorageError:
    """The error for an output that the system refuses to write, naming what is in the way on its path.

    The system's message is misleading: "File exists" for a folder that cannot be made below a file.
    """
    path = Path(path)
    why, fix = error.strerror or str(error), _CURES.get(error.errno or 0, "choose another place")
    places = (path, *path.parents) if error.errno == EEXIST else path.parents  # a folder that is to be made
    blocking = next((place for place in places if place.is_file()), None)
    if blocking is not None:
        why, fix = f"{blocking} is a file, not a folder", "choose another folder"
    elif path.is_dir() and error.errno not in _CURES:
        why, fix = "it is a folder", "name a file in it"
    return StorageError(problem, where=str(path), why=why, fix=fix)


def unexpected_error(error: BaseException) -> SeatrialError:
    """The one line for an exception that was not foreseen: its type and message, and where in Seatrial it arose.

    For the guards at the outermost edges: the command line, a page of the server, a worker of a batch.
    """
    if isinstance(error, SeatrialError):
        return error
    if isinstance(error, OSError):
        where = str(error.filename or "")
        return SeatrialError("the system refused", where=where, why=error.strerror or str(error))
    if isinstance(error, RuntimeError) and str(error).startswith(_LOOP):
        return SeatrialError("the system refused", why=str(error), fix="remove the link")
    if isinstance(error, MemoryError):
        what, why, fix = "there is not enough memory", str(error), "give less at once, or use a larger computer"
    else:
        what, why = "failed unexpectedly", f"{type(error).__name__}: {error}".removesuffix(": ")
        fix = f"check the input; for a report set {DEBUG_VARIABLE}=1, which shows the traceback"
    lines = [
        f"{name}, line {line}"
        for frame, line in walk_tb(error.__traceback__)
        if (name := str(frame.f_globals.get("__name__"))).partition(".")[0] == _PACKAGE
    ]
    return SeatrialError(what, where=lines[-1] if lines else "", why=why[:_LONGEST_REASON], fix=fix)


Printable = TypeVar("Printable")


def escape_control_characters(value: Printable) -> Printable:
    r"""Text, or text in lists, tuples and dictionaries, with control characters escaped.

    >>> print(escape_control_characters("calm\x1b[2J"))
    calm\x1b[2J
    """
    if isinstance(value, str):
        return _CONTROL.sub(  # type: ignore[return-value]
            lambda match: (
                f"\\x{ord(match[0]) - _BYTES:02x}"
                if _FIRST_BYTE <= match[0] <= _LAST_BYTE
                else repr(match[0])[1:-1]
            ),
            value,
        )
    if isinstance(value, dict):
        return {escape_control_characters(key): escape_control_characters(entry) for key, entry in value.items()}  # type: ignore[return-value]
    if isinstance(value, list | tuple):
        return type(value)(map(escape_control_characters, value))
    return value


def printable_path(path: str | os.PathLike[str]) -> str:
    r"""The name of a file as one line of printable text, whatever bytes it is made of.

    >>> print(printable_path(os.fsdecode(b"bay\xff\n.mcap")))
    bay\xff\n.mcap
    """
    return escape_control_characters(os.fspath(path)).replace("\t", r"\t").replace("\n", r"\n")


Progress = Callable[[float], None]
"""A callback for the fraction of work done, 0 to 1."""


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Words as a sentence lists them.

    >>> join_words(["trim", "skeg", "loading"])
    'trim, skeg and loading'
    """
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + f" {last} " + words[-1] if words else "nothing"


def subtask_progress(progress: Progress, done: int, total: int) -> Progress:
    """The progress callback of one of ``total`` pieces of work, ``done`` of which are finished.

    >>> subtask_progress(print, 1, 4)(0.5)
    0.375
    """
    return lambda fraction: progress((done + fraction) / total)


def progress_lines(label: str, clock: Callable[[], float] = time.monotonic) -> Progress:
    """Progress as plain lines on stderr, for logs and pipes; ``clock`` tells the time [s].

    A line comes at least :data:`PROGRESS_INTERVAL_S` after the last and with another percentage, so that work of a
    day prints a hundred.
    """
    printed_s, printed_percent = clock(), 0

    def print_progress(fraction: float) -> None:
        nonlocal printed_s, printed_percent
        time_s, percent = clock(), int(100.0 * fraction)
        if percent > printed_percent and time_s >= printed_s + PROGRESS_INTERVAL_S:
            Terminal(stderr=True).print(f"{label}: {percent} %", highlight=False)
            printed_s, printed_percent = time_s, percent

    return print_progress


@contextmanager
def progress_bar(label: str) -> Iterator[Progress]:
    """A progress bar, as a function that takes the fraction done, 0 to 1; lines where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield progress_lines(label)
        return
    from rich.progress import Progress as Bars

    with Bars(console=Terminal(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)


class Terminal(Console):
    """A console that shows text as it is: no markup, no emoji, control characters escaped.

    In a pipe or a file, which have no width, no table is cut to that of a terminal.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)
        if "width" not in options and "COLUMNS" not in os.environ and not self.is_terminal:
            self.width = _PIPED_COLUMNS

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich's; it also measures the cells of tables by this."""
        return super().render_str(escape_control_characters(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich's, which calls it for whatever is in a table or a group, too."""
        shown = rich_cast(renderable)
        if (
            isinstance(shown, Text) and (plain := escape_control_characters(shown.plain)) != shown.plain
        ):  # loses its inner styles
            shown = Text(plain, shown.style, justify=shown.justify, overflow=shown.overflow, no_wrap=shown.no_wrap)
        return super().render(shown, options)
