"""The standard streams, made so that one that is closed or full takes nothing down with it."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Any, TextIO

from acquisition.core.errors import StorageError

_STDOUT = 1
_NAMES = ("stdin", "stdout", "stderr")


def guard_standard_streams() -> None:
    """Replace missing streams by the null device, and outputs by ones that can be closed at the other end.

    Whoever reads only our first line has not made the work a failure, and what cannot be told on stderr must
    not end a recording. A stdout that is full is told, once: what was asked for has not arrived.
    """
    for name in _NAMES:
        stream = getattr(sys, name)
        if stream is None:  # the lowest free descriptor is the missing one: no recording will be opened as it
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115 - to the end
        elif name != "stdin" and stream is getattr(sys, f"__{name}__"):  # and not a test's
            setattr(sys, name, _guarded(stream))


def _guarded(stream: TextIO) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Output(stream.fileno())),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


class _Output(io.FileIO):
    """A descriptor to write to; after its first failure all that is written to it is forgotten."""

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
                raise StorageError(
                    "cannot be written", where="standard output", why=error.strerror or "", fix="send it elsewhere"
                ) from error
            return len(data)
