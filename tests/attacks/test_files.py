"""Small files that expand, and damage that must not pass unnoticed: recordings, tables, logs, descriptions."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.core.errors import InputError, SeatrialError
from acquisition.core.frames import Frame, Sample
from acquisition.core.trial import Trial
from acquisition.recording.reader import Recording, read_recording
from acquisition.recording.recover import recover
from acquisition.recording.writer import RecordingWriter

START_NS = 1_780_000_000_000_000_000
SECTOR_BYTES, BLOCK_BYTES = 512, 4096


# ---------------------------------------------------------------------------------------------- damage


def write_sampled(path: Path, chunks: int, samples: int) -> Path:
    """A recording with each kind of record that the recorder writes: metadata, attachment, chunks, definitions."""
    with RecordingWriter(
        path, Trial("flips", vessel="gunnerus", draught_m=2.7), {"trial.toml": b"a = 1"}
    ) as writer:
        writer.write_metadata("part", {"number": "1", "follows": "", "reason": "recording started"})
        writer.write_metadata("clock", {"utc_minus_monotonic_ns": "1234567890"})
        for number in range(chunks * samples):
            time_ns = START_NS + number * 50_000_000
            channel = ("surge_mps", "sway_mps" if number < samples else "wind_speed_mps")[number % 2]
            writer.write_sample(Sample(channel, number / 7, "a line", time_ns, number, time_ns - 5, time_ns))
            frame = Frame("line", "nmea0183", b"$GPHDT,%d,T*00" % number, time_ns, number)
            writer.write_raw(frame)
            if number % samples == samples - 1:
                writer.write_event(f"mark {number}", time_ns)
                writer.flush()
        writer.write_trial(Trial("flips", vessel="gunnerus", draught_m=2.8))
    return path


def unclosed(data: bytes) -> bytes:
    """The recording as a killed recorder leaves it: cut before the end of its data."""
    end_of_data = b"\x0f" + (4).to_bytes(8, "little")
    return data[: data.rindex(end_of_data)]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small recording, closed."""
    return write_sampled(tmp_path_factory.mktemp("small") / "small.mcap", chunks=3, samples=4).read_bytes()


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording of some twenty blocks of the disk, closed."""
    return write_sampled(tmp_path_factory.mktemp("blocks") / "blocks.mcap", chunks=40, samples=20).read_bytes()


def content(recording: Recording) -> dict[str, Any]:
    """What a recording says, as values that can be compared."""
    said = {field.name: getattr(recording, field.name) for field in fields(recording) if field.name != "path"}
    said["series"] = {name: rows(recording, name) for name in recording.series}
    return said


def rows(recording: Recording, channel: str) -> list[tuple[Any, ...]]:
    """The samples of a channel, each as one tuple."""
    series = recording.series[channel]
    columns = (series.measured_ns, series.received_ns, series.value, series.quality, series.source_index)
    return [(*row, series.sources) for row in zip(*(column.tolist() for column in columns), strict=True)]


def is_beginning(damaged: Recording, original: Recording) -> bool:
    """Whether a file that says that it is cut holds nothing but the first part of the original."""
    said, expected = content(damaged), content(original)
    kept = all(rows(original, channel)[: len(samples)] == samples for channel, samples in said["series"].items())
    return (
        kept
        and expected["events"][: len(said["events"])] == said["events"]
        and said["metadata"].items() <= expected["metadata"].items()
        and damaged.messages <= original.messages
        and damaged.trial in (original.trial, Trial("flips", vessel="gunnerus", draught_m=2.7), Trial())
    )


def unnoticed_by_readers(path: Path, original: Recording) -> str:
    """What a reader takes for true that the original does not say, without a word; empty if nothing."""
    try:
        damaged = read_recording(path)
    except InputError:
        return ""
    if not damaged.closed and is_beginning(damaged, original):
        return ""
    said, expected = content(damaged), content(original)
    return ", ".join(key for key in said if said[key] != expected[key])


def unnoticed_by_recovery(path: Path, original: Recording) -> str:
    """The same of what ``recover`` saves."""
    saved = path.with_suffix(".saved.mcap")
    saved.unlink(missing_ok=True)
    try:
        summary = recover(path, saved)
    except InputError:
        return ""
    if summary.refused or (not summary.closed and is_beginning(read_recording(saved), original)):
        return ""
    said, expected = content(read_recording(saved)), content(original)
    return ", ".join(key for key in said if said[key] != expected[key] and key != "closed")


def flip(data: bytes, place: int, bit: int) -> bytes:
    """The data with one bit changed."""
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


def unnoticed_flips(
    data: bytes, folder: Path, places: Iterator[int] | range, judge: Callable[[Path, Recording], str]
) -> list[str]:
    """At which of these places a flipped bit goes unnoticed, and what it changes."""
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    original, generator, unnoticed = read_recording(path), random.Random(1), []
    for place in places:
        bit = generator.randrange(8)
        path.write_bytes(flip(data, place, bit))
        if changed := judge(path, original):
            unnoticed.append(f"byte {place}, bit {bit}: {changed}")
    return unnoticed


def unnoticed(damaged: Iterable[bytes], data: bytes, folder: Path) -> list[str]:
    """Which of several damaged copies are read without a word, and what is changed in them."""
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    original, changes = read_recording(path), []
    for number, copy in enumerate(damaged):
        path.write_bytes(copy)
        if changed := unnoticed_by_readers(path, original):
            changes.append(f"number {number}: {changed}")
    return changes


@pytest.fixture(autouse=True)
def no_sync(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of files are written here; that none of them is kept by the disk is all right."""
    monkeypatch.setattr("os.fsync", lambda descriptor: None)
    monkeypatch.setattr("os.fdatasync", lambda descriptor: None)


CLOSED = pytest.mark.parametrize("form", [bytes, unclosed], ids=["closed", "unclosed"])


@CLOSED
def test_flipped_bit_is_noticed_by_readers_in_a_sample_of_places(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(0, len(data), 17), unnoticed_by_readers) == []


@CLOSED
def test_flipped_bit_is_noticed_by_recover_in_a_sample_of_places(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(0, len(data), 101), unnoticed_by_recovery) == []


@pytest.mark.attack
@CLOSED
@pytest.mark.parametrize("judge", [unnoticed_by_readers, unnoticed_by_recovery], ids=["readers", "recover"])
def test_flipped_bit_is_noticed_at_every_byte(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes], judge: Callable[[Path, Recording], str]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(len(data)), judge) == []


@CLOSED
def test_zeroed_sector_is_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data = form(blocks)
    starts = range(0, len(data), SECTOR_BYTES)
    zeroed = (data[:start] + bytes(SECTOR_BYTES) + data[start + SECTOR_BYTES :] for start in starts)
    assert unnoticed(zeroed, data, tmp_path) == []


@CLOSED
def test_swapped_blocks_are_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data = form(blocks)
    pieces = [data[start : start + BLOCK_BYTES] for start in range(0, len(data), BLOCK_BYTES)]
    pairs = [(first, second) for second in range(len(pieces)) for first in range(second)]

    def swapped(first: int, second: int) -> bytes:
        order = [*pieces]
        order[first], order[second] = pieces[second], pieces[first]
        return b"".join(order)

    assert unnoticed((swapped(*pair) for pair in pairs), data, tmp_path) == []


@CLOSED
def test_changed_bytes_are_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data, generator = form(blocks), random.Random(2)

    def changed() -> bytes:
        place, length = generator.randrange(len(data)), generator.randrange(1, 64)
        return data[:place] + generator.randbytes(length) + data[place + length :]

    assert unnoticed((changed() for _ in range(300)), data, tmp_path) == []


@CLOSED
def test_truncation_at_every_byte_is_reported(small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data, path = form(small), tmp_path / "damaged.mcap"
    path.write_bytes(small)
    original = read_recording(path)
    for length in range(1, len(data), 7):
        path.write_bytes(data[:length])
        try:
            damaged = read_recording(path)
        except InputError:
            continue
        assert not damaged.closed and is_beginning(damaged, original), f"at byte {length}"
