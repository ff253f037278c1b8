"""Coverage-guided fuzzing of recovery: damage to a small recording, and files that are nothing but damage.

``-len_control=0 -max_len=400`` makes it try long inputs at once.

The bytes are edits to a valid recording: where, how much is cut out, what is put in. An edit may also repair the
checksum of a chunk made of the bytes, which chance would never find. Nothing but our own errors may be raised; what
is saved must read back by the plain library, and as long as no checksum was forged it must have been recorded.
"""

from __future__ import annotations

import io
import os
import struct
import sys
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["acquisition", "mcap"]):
    from mcap.reader import make_reader

    from seatrial.acquisition.core.errors import SeatrialError
    from seatrial.acquisition.core.trial import Sample, Trial
    from seatrial.acquisition.recording.reader import read_recording
    from seatrial.acquisition.recording.recover import recover
    from seatrial.acquisition.recording.scan import MCAP_MAGIC, scan_records
    from seatrial.acquisition.recording.writer import RecordingWriter

Key = tuple[str, int, int, bytes]
FOLDER = Path(tempfile.mkdtemp(prefix="fuzz_recover_"))
SOURCE, TARGET = FOLDER / "damaged.mcap", FOLDER / "saved.mcap"
START_NS = 1_780_000_000_000_000_000


def small_recording() -> bytes:
    """Three chunks of four samples of two channels."""
    path = FOLDER / "whole.mcap"
    with RecordingWriter(path, Trial("fuzz", origin_latitude_deg=63.4)) as writer:
        for number in range(12):
            time_ns = START_NS + number
            name = ("surge_mps", "sway_mps")[number % 2]
            writer.write_sample(Sample(name, number / 3, "line", time_ns, number, time_ns))
            if number % 4 == 3:
                writer.flush()
    return path.read_bytes()


def messages(path: Path) -> list[Key]:
    """All messages, read by the plain library."""
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, each.log_time, each.publish_time, each.data) for _, channel, each in found]


WHOLE = small_recording()
RECORDED = frozenset(messages(FOLDER / "whole.mcap"))


def chunk_of(content: bytes) -> bytes:
    """An uncompressed chunk that holds these bytes under a right checksum."""
    head = struct.pack("<QQQIIQ", 0, 9, len(content), zlib.crc32(content), 0, len(content))
    return b"\x06" + struct.pack("<Q", len(head) + len(content)) + head + content


def edited(data: bytes) -> tuple[bytes, bool]:
    """A damaged recording, and whether a checksum of it was forged."""
    provider = atheris.FuzzedDataProvider(data)
    damaged = b"" if provider.ConsumeIntInRange(0, 7) == 0 else WHOLE
    forged = not damaged
    for _ in range(provider.ConsumeIntInRange(1, 4)):
        place = provider.ConsumeIntInRange(0, len(damaged))
        removed = provider.ConsumeIntInRange(0, 40)
        inserted = provider.ConsumeBytes(provider.ConsumeIntInRange(0, 60))
        if provider.ConsumeBool():
            inserted, forged = chunk_of(inserted), True
        damaged = damaged[:place] + inserted + damaged[place + removed :]
    return (damaged if provider.ConsumeBool() or damaged.startswith(MCAP_MAGIC) else MCAP_MAGIC + damaged), forged


def check_scan(damaged: bytes) -> None:
    """The pieces of a file are the whole of it."""
    end = 0
    for found in scan_records(io.BytesIO(damaged)):
        assert found.start == end < found.end, found
        end = found.end
    assert end == len(damaged)


def test_one_input(data: bytes) -> None:
    """One file through scan, recovery, the plain library and our reader."""
    damaged, forged = edited(data)
    check_scan(damaged)
    SOURCE.write_bytes(damaged)
    TARGET.unlink(missing_ok=True)
    refused, found = "", None
    try:
        found = recover(SOURCE, TARGET)
    except SeatrialError as error:
        refused = str(error)
    assert "\n" not in refused
    assert "does not read back" not in refused, refused
    assert TARGET.exists() == (found is not None)
    if found is not None:
        saved = messages(TARGET)
        assert len(saved) == found.saved_messages
        assert forged or RECORDED.issuperset(saved), RECORDED.symmetric_difference(saved)
        str(found), found.as_json()
    with suppress(SeatrialError):
        read_recording(SOURCE)


if __name__ == "__main__":
    os.fsync = lambda descriptor: None  # type: ignore[assignment]  # the disk need not keep any of it
    atheris.Setup(sys.argv, test_one_input)
    atheris.Fuzz()
