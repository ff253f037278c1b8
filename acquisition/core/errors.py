"""What can go wrong, split by what the caller can do about it.

::

    SeatrialError
    ├── ConfigurationError   the trial's or the vessel's file says something impossible: edit the named line
    ├── InputError           a file or a table given as input is not what it should be: give another
    ├── SourceError          a bus, port or socket cannot be opened or has failed: connect it and try again
    ├── StorageError         the recording cannot be written: make room, mount the disk, change permissions
    ├── DataShortageError    the input is sound but holds too little for the task: record more, ask for less
    └── ModelRangeError      the simulation model was driven out of the range its coefficients hold in

Every message says what, where, why and what to do, in that order, on one line.
"""

from __future__ import annotations

from errno import EACCES, ENOSPC, EPERM, EROFS
from pathlib import Path
from typing import Self

from acquisition.core.text import printable

_CURES = {
    ENOSPC: "make room on the disk",
    EACCES: "choose another folder, or ask for the right to write there",
    EPERM: "choose another folder, or ask for the right to write there",
    EROFS: "choose another folder: this one is read-only",
}


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
        super().__init__(printable(" ".join(text.split())))

    def at(self, where: Path | str) -> Self:
        """The same error, of another place."""
        return type(self)(self.what, where=str(where), why=self.why, fix=self.fix)


class ConfigurationError(SeatrialError, ValueError):
    """A configuration or vessel file cannot be used as it stands.

    Examples: an unknown unit, a source without a port, two sources of one name.
    """


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
    """The input is sound but too little. Examples: no held window, one leg only to split."""


class ModelRangeError(SeatrialError, ArithmeticError):
    """The simulation left the range of speeds its coefficients hold in."""


def storage_error(path: Path | str, error: OSError, what: str = "cannot be written") -> StorageError:
    """The error for a product that the system refuses, which says what on its path is in the way.

    The system's own words, "File exists" for a folder that cannot be made below a file, mislead.
    """
    path = Path(path)
    why, fix = error.strerror or str(error), _CURES.get(error.errno or 0, "choose another place")
    blocking = next((each for each in path.parents if each.is_file()), None)
    if blocking is not None:
        why, fix = f"{blocking} is a file, not a folder", "choose another folder"
    elif path.is_dir():
        why, fix = "it is a folder", "name a file in it"
    return StorageError(what, where=str(path), why=why, fix=fix)
