"""NMEA 0183 sentences from a text file, as fast as they are taken."""

from __future__ import annotations

from typing import BinaryIO

from acquisition.errors import SourceError
from acquisition.frames import Frame
from acquisition.sections import FileSource
from acquisition.sources.lines import LineAssembler

_BLOCK_BYTES = 8192


class LogFile:
    """One file, read once; it ends, which the pipeline understands."""

    waits = True

    def __init__(self, config: FileSource) -> None:
        self.name = config.name
        self._config = config
        self._file: BinaryIO | None = None
        self._lines = LineAssembler(config.name)

    def open(self) -> None:
        try:
            self._file = self._config.path.open("rb")
        except OSError as error:
            raise SourceError(
                f"file {self._config.path} cannot be opened",
                where=f"source {self.name!r}",
                why=str(error.strerror),
                fix="correct `path`",
            ) from error

    def read(self, timeout_s: float) -> list[Frame] | None:
        if self._file is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            block = self._file.read(_BLOCK_BYTES)
        except OSError as error:
            raise SourceError("file failed", where=f"source {self.name!r}", why=str(error.strerror)) from error
        return self._lines.push(block) if block else (self._lines.end() or None)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
