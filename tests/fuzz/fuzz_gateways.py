"""Coverage-guided fuzzing of what gateways send and logs hold, from bytes to frames with their times.

``pip install atheris``, then ``python tests/fuzz/fuzz_gateways.py -max_total_time=600 -rss_limit_mb=300``.

The first byte chooses: a live line, lines of a log, or one of the binary files. Nothing may raise but what says
that a file is broken, times must be possible, and memory must stay bounded.
"""

from __future__ import annotations

import struct
import sys
import tempfile
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[2]))
with atheris.instrument_imports(include=["acquisition"]):
    from acquisition.sources.file_forms import FILE_FORMS, read_lines
    from acquisition.sources.line_forms import LineReader
    from acquisition.sources.log_clock import LogClock
    from acquisition.sources.looks import looks_like
    from acquisition.sources.streams import LineAssembler
    from tests.acquisition.bus_logs import FORMS

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
    assert looks_like(stream)


def corpus() -> Path:
    """A folder with the beginnings of every form, where libFuzzer also keeps what reached new code."""
    folder = Path(tempfile.gettempdir()) / "fuzz_gateways"
    folder.mkdir(exist_ok=True)
    for number, form in enumerate(FORMS.values()):
        for choice in (0, len(READERS), *range(1, len(READERS))):
            (folder / f"seed_{number}_{choice}").write_bytes(bytes([choice]) + form.write()[:500])
    return folder


def main() -> None:
    atheris.Setup([*sys.argv, "-max_len=700", str(corpus())], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
