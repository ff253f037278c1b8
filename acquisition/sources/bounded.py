"""A log as its readers see it: however it is packed, they get no more of it than its budget."""

from __future__ import annotations

import gzip
import io
import os
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.budget import LOG_BYTES, TEXT_BYTES, Meter

_BLOCK_BYTES = 8192  # as readers ask for: of a packed log that is cut off no more is lost than its last block


class BoundedLog(io.BufferedReader):
    """A log, unpacked if it is ``packed`` by gzip; reading raises :class:`InputError` beyond its budget."""

    def __init__(self, path: Path, *, packed: bool) -> None:
        self._bytes = _Bytes(path, packed)
        super().__init__(self._bytes, _BLOCK_BYTES)

    @property
    def meter(self) -> Meter:
        """What the reading has taken so far."""
        return self._bytes.meter


class _Bytes(io.RawIOBase):
    """The bytes of a log, counted since the last time that it was read from its beginning."""

    def __init__(self, path: Path, packed: bool) -> None:
        self._path, self._size_bytes, self._packed = path, path.stat().st_size, packed
        self._stream: Any = gzip.GzipFile(path) if packed else path.open("rb")
        self.meter = Meter(path, self._size_bytes)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int:
        data = self._stream.read1(len(buffer))  # what is there: the rest of a log that is cut off would raise
        self.meter.add(LOG_BYTES, len(data))
        buffer[: len(data)] = data
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        if whence == os.SEEK_END and self._packed:
            while self.read(_BLOCK_BYTES):
                pass
            return int(self._stream.tell())
        place = int(self._stream.seek(offset, whence))
        self.meter = Meter(self._path, self._size_bytes)
        return place

    def tell(self) -> int:
        return int(self._stream.tell())

    def close(self) -> None:
        self._stream.close()
        super().close()


class Lines(io.TextIOWrapper):
    """The lines of a log as text; one without an end raises ValueError, not the memory that it takes."""

    def __next__(self) -> str:  # type: ignore[override]  # as TextIOWrapper's is in truth
        line = self.readline(TEXT_BYTES.least)
        if not line:
            raise StopIteration
        if len(line) >= TEXT_BYTES.least and not line.endswith("\n"):
            raise ValueError(f"it has a line of more than {TEXT_BYTES.least:,} letters")
        return line
