"""Coverage-guided fuzzing of what gateways send and logs hold, from bytes to frames with their times.

The first byte chooses: a live line, lines of a log, or one of the binary files. Nothing may raise but what says
that a file is broken, times must be possible, and memory must stay bounded.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.sources import describe_file_start
    from seatrial.acquisition.sources.lines import LineAssembler
    from seatrial.acquisition.sources.log_file import LogClock
    from seatrial.acquisition.sources.log_formats import FILE_FORMS, LineReader, read_lines
    from tests.acquisition.bus_logs import FORMS
    from tests.fuzz.running import fuzz

READERS = (read_lines, *(form.read for form in FILE_FORMS.values()))
NOW_NS = 1_786_096_800_000_000_000
LATEST_NS = 2**62


def one_input(data: bytes) -> None:
    """The first byte chooses the reader; the rest is the file, or what comes on the line."""
    choice, stream = data[0] if data else 0, data[1:]
    if choice % (len(READERS) + 1) == len(READERS):
        assembler = LineAssembler("line")
        frames = assembler.push(stream[:50]) + assembler.push(stream[50:]) + assembler.end()
        assert all(0 <= frame.identifier < 2**29 for frame in frames)
        return
    reader, entries = LineReader(), []
    with suppress(ValueError, EOFError, struct.error):
        entries += READERS[choice % (len(READERS) + 1)](BytesIO(stream), reader)
    clock = LogClock(entries, NOW_NS)
    for entry in entries:
        time_ns = clock.time_ns(entry)
        assert 0 <= entry.identifier < 2**29
        assert time_ns is None or 0 <= time_ns < LATEST_NS
    assert describe_file_start(stream)


def seeds() -> Iterator[bytes]:
    """The beginnings of every form, for every reader."""
    for form in FORMS.values():
        for choice in range(len(READERS) + 1):
            yield bytes([choice]) + form.write()[:500]


if __name__ == "__main__":
    fuzz(one_input, seeds(), 700)
