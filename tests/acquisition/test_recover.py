"""Recovery: all messages that a checksum vouches for come back, and nothing else, whatever happened to the file."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer
from typer.testing import CliRunner

from seatrial.acquisition.core.errors import InputError, SeatrialError, StorageError
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording.reader import MessageStream, read_recording
from seatrial.acquisition.recording.recover import RecoverySummary, recover
from seatrial.acquisition.recording.scan import MCAP_MAGIC, Intact, scan_records
from seatrial.acquisition.recording.writer import RecordingWriter
from tests.conftest import nightly

START_NS = 1_780_000_000_000_000_000
PAGE_BYTES = 4096


class Saved(NamedTuple):
    """One message as any reader sees it."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Original(NamedTuple):
    """A recording, its messages by chunk, and where each chunk lies."""

    data: bytes
    messages: list[list[Saved]]
    spans: list[tuple[int, int]]

    def __repr__(self) -> str:
        return f"{len(self.data)} bytes, chunks at {self.spans}"

    def without(self, hit: Callable[[int, int], bool]) -> list[Saved]:
        """All messages but those of the chunks that were hit."""
        pairs = zip(self.messages, self.spans, strict=True)
        return [message for chunk, span in pairs if not hit(*span) for message in chunk]

    @property
    def all(self) -> list[Saved]:
        return self.without(lambda start, end: False)


@pytest.fixture(autouse=True)
def no_sync(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of files are written here; that none of them is kept by the disk is all right."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def record_small(
    path: Path, chunks: int, messages: int, topics: tuple[str, ...] = ("surge_mps", "sway_mps")
) -> None:
    """A recording of so many chunks of so many messages."""
    with RecordingWriter(path, Trial("small", origin_latitude_deg=63.4)) as writer:
        for number in range(chunks * messages):
            time_ns = START_NS + number * 10_000_000
            sample = Sample(topics[number % len(topics)], number / 7, "a line", time_ns, number, time_ns - 5)
            writer.write_sample(sample)
            if number % messages == messages - 1:
                writer.flush()


def original(path: Path) -> Original:
    """What the plain library makes of an intact file; the oracle of all that follows."""
    data = path.read_bytes()
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    messages, spans = [], []
    for index in summary.chunk_indexes:
        assert isinstance(index, ChunkIndex)
        start, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
        records = breakup_chunk(chunk_at(data, start))
        messages.append(
            [
                Saved(
                    summary.channels[each.channel_id].topic,
                    each.log_time,
                    each.publish_time,
                    each.sequence,
                    each.data,
                )
                for each in records
                if isinstance(each, Message)
            ]
        )
        spans.append((start, end))
    return Original(data, messages, spans)


def chunk_at(data: bytes, start: int) -> Chunk:
    """The chunk that begins at this byte."""
    return Chunk.read(ReadDataStream(io.BytesIO(data[start + 9 :])))


def saved_messages(path: Path) -> list[Saved]:
    """All messages of a file in file order, read by the plain library alone."""
    with path.open("rb") as stream:
        return [
            Saved(channel.topic, message.log_time, message.publish_time, message.sequence, message.data)
            for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        ]


def recovered(folder: Path, data: bytes) -> tuple[RecoverySummary, list[Saved]]:
    """Recover a file of these bytes."""
    source, target = folder / "damaged.mcap", folder / "saved.mcap"
    source.write_bytes(data)
    target.unlink(missing_ok=True)
    found = recover(source, target)
    assert source.read_bytes() == data
    assert found.saved_messages == sum(found.counts.values())
    return found, saved_messages(target)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Original:
    path = tmp_path_factory.mktemp("small") / "small.mcap"
    record_small(path, chunks=3, messages=3, topics=("surge_mps",))
    return original(path)


@pytest.fixture(scope="module")
def larger(tmp_path_factory: pytest.TempPathFactory) -> Original:
    path = tmp_path_factory.mktemp("larger") / "larger.mcap"
    record_small(path, chunks=24, messages=25)
    return original(path)


def test_a_whole_recording_is_copied_and_nothing_is_lost(tmp_path: Path, larger: Original) -> None:
    found, messages = recovered(tmp_path, larger.data)
    assert messages == larger.all
    assert (found.lost_bytes, found.damaged_chunks, found.gaps, found.closed) == (0, 0, [], True)
    assert found.recovered_until_ns == max(message.log_ns for message in larger.all)
    assert "nothing was lost" in str(found)
    before, after = read_recording(tmp_path / "damaged.mcap"), read_recording(tmp_path / "saved.mcap")
    assert after.closed
    assert after.trial == before.trial


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_every_prefix_gives_exactly_its_complete_chunks(tmp_path: Path, small: Original, step: int) -> None:
    """All that end beside the end of a chunk, and every fifth of the others, or each."""
    first_content = len(MCAP_MAGIC) + 9 + int.from_bytes(small.data[9:17], "little")
    metadata_end = first_content + 9 + int.from_bytes(small.data[first_content + 1 : first_content + 9], "little")
    summary_start = small.spans[-1][1] + 50
    edges = {metadata_end, *(place for span in small.spans for place in span)}
    beside = {edge + off for edge in edges for off in (-1, 0, 1)}
    summary = range(summary_start, len(small.data), 7 * step)  # slow, and much the same
    for length in sorted({*range(1, summary_start, step), *beside, *summary}):
        expected = small.without(lambda start, end, length=length: end > length)  # type: ignore[misc]
        if length < metadata_end:
            with pytest.raises(InputError, match="nothing that can be saved"):
                recovered(tmp_path, small.data[:length])
            continue
        found, messages = recovered(tmp_path, small.data[:length])
        assert messages == expected
        assert not found.closed
        assert not found.gaps


def flipped(data: bytes, *places: tuple[int, int]) -> bytes:
    damaged = bytearray(data)
    for place, bit in places:
        damaged[place] ^= 1 << bit
    return bytes(damaged)


@pytest.mark.parametrize("seed", [0, *nightly(1, 2, 3)])
def test_a_flipped_bit_costs_at_most_its_chunk(tmp_path: Path, larger: Original, seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(50):
        place, bit = chance.randrange(len(larger.data)), chance.randrange(8)
        found, messages = recovered(tmp_path, flipped(larger.data, (place, bit)))
        expected = larger.without(lambda start, end, place=place: start <= place < end)  # type: ignore[misc]
        if len(messages) < len(larger.all):
            assert messages == expected, (place, bit)
            assert found.damaged_chunks == 1
            assert found.lost_bytes > 0
        else:
            assert messages == larger.all, (place, bit)


@pytest.mark.parametrize("bits", [(0, 3, 7), pytest.param((1, 2, 4, 5, 6), marks=pytest.mark.slow)])
def test_every_bit_of_a_chunks_head_may_flip(tmp_path: Path, small: Original, bits: tuple[int, ...]) -> None:
    """Kind, length, times, size, checksum, compression: none of them makes another chunk disappear."""
    start = small.spans[1][0]
    expected = small.without(lambda first, _: first == start)
    for place in range(start, start + 53):
        for bit in bits:
            _, messages = recovered(tmp_path, flipped(small.data, (place, bit)))
            assert messages in (expected, small.all), (place, bit)


@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
def test_bytes_cut_out_behind_a_chunk_cost_no_chunk(tmp_path: Path, larger: Original, seed: int) -> None:
    """The index of a chunk's messages then claims bytes of the next chunk, which is all there."""
    chance = random.Random(seed)
    for _ in range(60):
        which = chance.randrange(len(larger.spans) - 1)
        begin, end = larger.spans[which][1], larger.spans[which + 1][0]
        place = chance.randrange(begin, end)
        count = chance.randint(1, end - place)
        _, messages = recovered(tmp_path, larger.data[:place] + larger.data[place + count :])
        assert messages == larger.all, (place, count)


@settings(max_examples=40, deadline=None)
@given(places=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=2, max_size=2))
def test_two_flipped_bits_cost_at_most_two_chunks(
    tmp_path_factory: pytest.TempPathFactory, larger: Original, places: list[tuple[float, int]]
) -> None:
    hits = [(int(share * len(larger.data)), bit) for share, bit in places]
    _, messages = recovered(tmp_path_factory.mktemp("two"), flipped(larger.data, *hits))
    known = iter(larger.all)
    assert all(message in known for message in messages)  # the originals, in their order
    untouched = larger.without(lambda start, end: any(start <= place < end for place, _ in hits))
    assert set(untouched) <= set(messages)


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1), length=st.integers(1, 3 * PAGE_BYTES), closed=st.booleans())
@example(share=0.5, length=PAGE_BYTES, closed=True)
@example(share=1.0, length=PAGE_BYTES, closed=True)
@example(share=0.0, length=PAGE_BYTES, closed=True)
def test_zeroed_pages_cost_the_chunks_in_them(
    tmp_path_factory: pytest.TempPathFactory, larger: Original, share: float, length: int, closed: bool
) -> None:
    """Except that a file that was not closed must keep its beginning, or nothing says what its topics are."""
    whole = larger.data if closed else larger.data[: larger.spans[-1][1]]
    earliest = 0 if closed else larger.spans[1][0]
    first = earliest + int(share * (len(whole) - earliest - length))
    damaged = whole[:first] + bytes(length) + whole[first + length :]
    found, messages = recovered(tmp_path_factory.mktemp("zero"), damaged)
    hit = [chunk for chunk in larger.spans if chunk[0] < first + length and chunk[1] > first]
    known = iter(larger.all)
    assert all(message in known for message in messages)  # a chunk may survive if zero was written on zero
    assert set(larger.without(lambda start, end: (start, end) in hit)) <= set(messages)
    if closed and first + length < larger.spans[-1][1]:
        assert 25 * found.damaged_chunks >= len(larger.all) - len(messages)  # the index knows how many there were


def test_a_gap_is_told_with_its_beginning_and_length(tmp_path: Path, larger: Original) -> None:
    start, _ = larger.spans[20]
    found, _ = recovered(tmp_path, flipped(larger.data, (start + 80, 3)))
    before, after = larger.messages[19][-1].log_ns, larger.messages[21][0].log_ns
    assert found.gaps == [(before, after)]
    assert "a gap of 0.260 s from 2026-05-28T" in str(found)


@pytest.mark.parametrize("length", [2**60, 2**63 + 5, 2**26 + 1, 0, 1])
def test_a_chunk_of_a_wrong_length_hides_no_other(tmp_path: Path, larger: Original, length: int) -> None:
    start = larger.spans[3][0]
    damaged = larger.data[: start + 1] + struct.pack("<Q", length) + larger.data[start + 9 :]
    found, messages = recovered(tmp_path, damaged)
    assert messages == larger.without(lambda first, _: first == start)
    assert found.damaged_chunks == 1


def test_the_beginning_may_be_gone(tmp_path: Path, larger: Original) -> None:
    """Without the magic bytes, the header and the first chunk, which defines all topics, the rest is still read."""
    for lost in (8, 30, larger.spans[1][0]):
        _, messages = recovered(tmp_path, larger.data[lost:])
        assert messages == larger.without(lambda start, _, lost=lost: start < lost)  # type: ignore[misc]


def test_without_any_definition_the_error_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing that can be saved: a message of no known topic \(1\)"):
        recovered(tmp_path, hand_made(HEADER, packed(MESSAGE)))


def test_two_files_made_into_one_are_both_saved(tmp_path: Path, small: Original, larger: Original) -> None:
    _, messages = recovered(tmp_path, small.data + larger.data)
    assert messages == small.all + larger.all


class Foreign(NamedTuple):
    """How another program writes MCAP."""

    compression: CompressionType
    chunked: bool = True
    index: IndexType = IndexType.ALL
    checksums: bool = True
    data_checksum: bool = False


FOREIGN = {
    "lz4": Foreign(CompressionType.LZ4),
    "plain chunks": Foreign(CompressionType.NONE),
    "no chunks": Foreign(CompressionType.NONE, chunked=False),
    "no chunks, checksum of all": Foreign(CompressionType.NONE, chunked=False, data_checksum=True),
    "no indexes": Foreign(CompressionType.ZSTD, index=IndexType.NONE),
    "no checksums": Foreign(CompressionType.ZSTD, checksums=False),
}


def write_foreign(path: Path, how: Foreign) -> None:
    with path.open("wb") as stream:
        writer: Any = Writer(
            stream, chunk_size=400, compression=how.compression, use_chunking=how.chunked, index_types=how.index,
            enable_crcs=how.checksums, enable_data_crcs=how.data_checksum,
        )  # fmt: skip
        writer.start(profile="ros2", library="another")
        writer.add_attachment(1, 2, "hull.stl", "model/stl", bytes(range(256)))
        unused = writer.register_channel("/unused", "cdr", 0, {"kept": "too"})
        image = writer.register_schema("pkg.Image", "protobuf", b"\x0a\x00descriptor")
        left = writer.register_channel("/camera", "protobuf", image, {"side": "left"})
        right = writer.register_channel("/camera", "protobuf", image, {"side": "right"})
        for number in range(60):
            channel = (left, right)[number % 2]
            writer.add_message(channel, 100 + number, bytes([number]) * number, 2**63 + number, number + 7)
        writer.add_metadata("boat", {"name": "Ægir", "": ""})
        writer.finish()
        assert unused == 1


@pytest.mark.parametrize("how", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_files_keep_all_they_had(tmp_path: Path, how: Foreign) -> None:
    write_foreign(tmp_path / "foreign.mcap", how)
    before = saved_messages(tmp_path / "foreign.mcap")
    found, messages = recovered(tmp_path, (tmp_path / "foreign.mcap").read_bytes())
    assert messages == before
    assert len(messages) == 60
    assert found.lost_bytes == 0
    with (tmp_path / "saved.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        assert [(each.name, each.metadata) for each in reader.iter_metadata()] == [
            ("boat", {"name": "Ægir", "": ""})
        ]
        assert [(each.name, each.data, each.create_time, each.log_time) for each in reader.iter_attachments()] == [
            ("hull.stl", bytes(range(256)), 1, 2)
        ]
        summary = reader.get_summary()
        assert summary is not None
        sides = {channel.metadata.get("side") for channel in summary.channels.values()}
        assert sides >= {"left", "right"}
        assert {(each.name, each.encoding, each.data) for each in summary.schemas.values()} == {
            ("pkg.Image", "protobuf", b"\x0a\x00descriptor")
        }


def test_a_damaged_attachment_is_left_out(tmp_path: Path) -> None:
    write_foreign(tmp_path / "foreign.mcap", FOREIGN["lz4"])
    data = (tmp_path / "foreign.mcap").read_bytes()
    place = data.index(bytes(range(256))) + 100
    found, messages = recovered(tmp_path, flipped(data, (place, 0)))
    assert len(messages) == 60
    assert (found.attachments, found.lost_bytes > 256) == (0, True)


def hand_made(*records: Any) -> bytes:
    """A file of exactly these records."""
    built: Any = RecordBuilder()
    for record in records:
        record.write(built)
    return MCAP_MAGIC + bytes(built.end())


def packed(*records: Any, **fields: Any) -> Chunk:
    """A chunk of these records; ``fields`` are the lies that it tells."""
    plain = hand_made(*records)[len(MCAP_MAGIC) :]
    honest: dict[str, Any] = {
        "compression": "zstd", "data": zstandard.compress(plain), "message_start_time": 0, "message_end_time": 9,
        "uncompressed_crc": zlib.crc32(plain), "uncompressed_size": len(plain),
    }  # fmt: skip
    return Chunk(**{**honest, **fields})


MESSAGE = Message(7, 5, b"{}", 4, 3)
CHANNEL = Channel(7, "/late", "json", {}, 2)
SCHEMA = Schema(2, b"{}", "jsonschema", "late")
HEADER = Header("", "")


@pytest.mark.parametrize(
    "records",
    [
        [HEADER, SCHEMA, CHANNEL, packed(MESSAGE)],
        [HEADER, packed(MESSAGE), SCHEMA, CHANNEL],
        [HEADER, packed(MESSAGE), packed(SCHEMA, CHANNEL, MESSAGE)],
        [packed(MESSAGE), CHANNEL, SCHEMA],
        [HEADER, Channel(7, "/lute", "json", {}, 2), packed(SCHEMA, CHANNEL, MESSAGE)],
    ],
)
def test_definitions_are_found_wherever_they_stand(tmp_path: Path, records: list[Any]) -> None:
    """One out of a chunk, which has a checksum, goes before one that has none."""
    _, messages = recovered(tmp_path, hand_made(*records))
    assert set(messages) == {Saved("/late", 5, 4, 3, b"{}")}
    assert len(messages) == sum("Message" in repr(each) or isinstance(each, Chunk) for each in records)


def test_a_message_of_no_known_topic_is_counted(tmp_path: Path) -> None:
    stray = Message(8, 5, b"{}", 4, 3)
    found, messages = recovered(tmp_path, hand_made(HEADER, packed(SCHEMA, CHANNEL, MESSAGE, stray)))
    assert len(messages) == 1
    assert found.refused == {"a message of no known topic": 1}
    assert found.lost_bytes == 31 + len(stray.data)


def test_no_message_is_taken_out_of_a_damaged_chunk(tmp_path: Path) -> None:
    """In an uncompressed chunk messages look like messages, but nothing vouches for them any more."""
    plain = hand_made(SCHEMA, CHANNEL, *[MESSAGE] * 20)[len(MCAP_MAGIC) :]
    good = packed(SCHEMA, CHANNEL, MESSAGE)
    bad = packed(compression="", data=plain, uncompressed_size=len(plain), uncompressed_crc=zlib.crc32(plain))
    data = bytearray(hand_made(HEADER, bad, good))
    data[len(MCAP_MAGIC) + 17 + 4] ^= 0x40  # the chunk's length, so that the search begins within it
    _, messages = recovered(tmp_path, bytes(data))
    assert len(messages) == 1


def test_a_run_sheet_that_is_damaged_is_kept_under_another_name(tmp_path: Path) -> None:
    sheet = Metadata("trial", {"trial": "x", "origin_latitude_deg": "6s.4"})
    found, _ = recovered(tmp_path, hand_made(HEADER, sheet, packed(SCHEMA, CHANNEL, MESSAGE)))
    assert sum(found.refused.values()) >= 1
    assert read_recording(tmp_path / "saved.mcap").trial == Trial()
    with (tmp_path / "saved.mcap").open("rb") as stream:
        (metadata,) = (each.metadata for each in make_reader(stream).iter_metadata())
        assert sheet.metadata.items() <= metadata.items()


BOMB = zstandard.compress(bytes(48 * 2**20))


@pytest.mark.parametrize("claimed", [10, 48 * 2**20, 2**26, 2**40])
def test_a_bomb_is_refused(tmp_path: Path, claimed: int) -> None:
    """What a chunk becomes when decompressed is held against what it said, and both against a limit."""
    bomb = packed(MESSAGE, data=BOMB, uncompressed_size=claimed)
    found, messages = recovered(tmp_path, hand_made(HEADER, bomb, packed(SCHEMA, CHANNEL, MESSAGE)))
    assert len(messages) == 1
    assert found.damaged_chunks == 1


MEASURED = """
import re, sys
from pathlib import Path
from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.recording.recover import recover
try:
    recover(Path(sys.argv[1]), Path(sys.argv[2]))
except SeatrialError as error:
    print(error)
# not ru_maxrss, which a process inherits from the one that started it
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""


@cache
def ten_gigabytes() -> bytes:
    """A zstd frame (RFC 8878) of 10 GB of zeros that does not say how long it is: blocks of one byte, repeated."""
    size, repeated, last = 2**17 << 3, 1 << 1, 1
    block, end = ((size | repeated | flag).to_bytes(3, "little") + b"\0" for flag in (0, last))
    frame = bytes.fromhex("28b52ffd 00 38") + 81_919 * block + end
    assert zstandard.ZstdDecompressor().stream_reader(frame).read(2**20) == bytes(2**20)
    return frame


@pytest.mark.parametrize("claimed", [10 * 2**30, *nightly(2**26)])
def test_ten_gigabytes_in_a_tiny_chunk_take_little_memory(tmp_path: Path, claimed: int) -> None:
    bomb = ten_gigabytes()
    assert len(bomb) < 2**20
    chunks = (packed(MESSAGE, data=bomb, uncompressed_size=claimed), packed(SCHEMA, CHANNEL, MESSAGE))
    (tmp_path / "bomb.mcap").write_bytes(hand_made(HEADER, *chunks))
    command = [sys.executable, "-c", MEASURED, str(tmp_path / "bomb.mcap"), str(tmp_path / "saved.mcap")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert int(done.stdout) < 300 * 1024
    assert len(saved_messages(tmp_path / "saved.mcap")) == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"time,north_m\n1,2\n" * 500, "contains nothing that can be saved"),
        (bytes(100_000), "contains nothing that can be saved"),
        (MCAP_MAGIC, "contains nothing that can be saved"),
    ],
)
def test_where_there_is_nothing_nothing_is_left_behind(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "damaged.mcap").write_bytes(content)
    with pytest.raises(InputError, match=message):
        recover(tmp_path / "damaged.mcap", tmp_path / "saved.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.mcap"]


def garbage() -> Iterator[tuple[str, bytes]]:
    yield "noise", random.Random(1).randbytes(4_000_000)
    yield "heads of long records", b"\x09\xff\xff\xff\x00\x00\x00\x00\x00" * 100_000
    yield "heads of long plain chunks", struct.pack("<BQQQQIIQ", 6, 400_040, 0, 0, 400_000, 1, 0, 400_000) * 10_000


@pytest.mark.timeout(30)
@pytest.mark.parametrize("content", [content for _, content in garbage()], ids=[name for name, _ in garbage()])
def test_the_search_through_garbage_ends_soon(tmp_path: Path, larger: Original, content: bytes) -> None:
    """It is not quadratic: each place is looked at once, and long records are read only so often."""
    _, messages = recovered(tmp_path, larger.data + content)
    assert messages == larger.all


def test_what_exists_is_not_overwritten(tmp_path: Path, small: Original) -> None:
    source = tmp_path / "damaged.mcap"
    source.write_bytes(small.data)
    (tmp_path / "link.mcap").symlink_to(source)
    (tmp_path / "dangling.mcap").symlink_to(tmp_path / "nowhere")
    (tmp_path / "other.mcap").write_text("mine")
    for name, message in (
        ("damaged.mcap", "is the recording that is to be saved"),
        ("link.mcap", "is the recording that is to be saved"),
        ("dangling.mcap", "already exists; name a new file"),
        ("other.mcap", "already exists; name a new file"),
    ):
        with pytest.raises(StorageError, match=message):
            recover(source, tmp_path / name)
    assert source.read_bytes() == small.data
    assert (tmp_path / "other.mcap").read_text() == "mine"


@pytest.mark.parametrize("failing", ["finish", "add_message"])
def test_a_copy_that_does_not_read_back_is_no_copy(
    tmp_path: Path, small: Original, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    monkeypatch.setattr(Writer, failing, lambda *arguments, **named: None)
    with pytest.raises(StorageError, match=r"saved\.mcap: does not read back"):
        recovered(tmp_path, small.data)
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.mcap"]


def test_a_full_disk_leaves_nothing_behind(
    tmp_path: Path, small: Original, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: Any, **named: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Writer, "add_message", full)
    with pytest.raises(StorageError, match="make room on the disk"):
        recovered(tmp_path, small.data)
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.mcap"]


def test_a_disk_that_fails_to_read_is_one_clear_error(tmp_path: Path, small: Original) -> None:
    class Failing(io.BytesIO):
        name = "trial.mcap"

        def read(self, size: int | None = -1) -> bytes:
            if self.tell() > len(small.data) // 2:
                raise OSError(5, "Input/output error")
            return super().read(size)

    with pytest.raises(InputError, match=r"trial\.mcap: cannot be read: Input/output error; copy it"):
        list(scan_records(Failing(small.data)))


def refused_or_sound(folder: Path, data: bytes) -> None:
    """Only errors of ours, and only files that the plain library reads; the reader raises nothing else either."""
    try:
        found, messages = recovered(folder, data)
    except SeatrialError:
        pass
    else:
        assert found.saved_messages == len(messages)
    try:
        list(MessageStream(folder / "damaged.mcap"))
        read_recording(folder / "damaged.mcap")
    except SeatrialError:
        return


@settings(max_examples=150, deadline=None)
@given(data=st.binary(max_size=300), magic=st.booleans())
def test_any_bytes_at_all(tmp_path_factory: pytest.TempPathFactory, data: bytes, magic: bool) -> None:
    refused_or_sound(tmp_path_factory.mktemp("any"), MCAP_MAGIC * magic + data)


Edit = tuple[float, int, bytes]


@settings(max_examples=100, deadline=None)
@given(
    edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 60), st.binary(max_size=20)), min_size=1, max_size=5)
)
def test_any_edit_of_a_recording(
    tmp_path_factory: pytest.TempPathFactory, small: Original, edits: list[Edit]
) -> None:
    """Pieces cut out, put in and written over: a message that is saved is one that was recorded."""
    damaged = small.data
    for share, removed, inserted in edits:
        place = int(share * len(damaged))
        damaged = damaged[:place] + inserted + damaged[place + removed :]
    folder = tmp_path_factory.mktemp("edit")
    refused_or_sound(folder, damaged)
    if (folder / "saved.mcap").exists():
        assert set(saved_messages(folder / "saved.mcap")) <= set(small.all)


@given(data=st.binary(max_size=200), magic=st.booleans())
def test_a_scan_leaves_no_hole(data: bytes, magic: bool) -> None:
    data = MCAP_MAGIC * magic + data
    end = 0
    for found in scan_records(io.BytesIO(data)):
        assert found.start == end < found.end
        end = found.end
    assert end == len(data)


def test_a_scan_of_an_intact_file_finds_all_records(larger: Original) -> None:
    found = list(scan_records(io.BytesIO(larger.data)))
    assert all(isinstance(each, Intact) for each in found)
    chunks = [
        (each.start, each.end) for each in found if isinstance(each, Intact) and isinstance(each.record, Chunk)
    ]
    assert chunks == larger.spans
    assert sum(isinstance(each, Intact) and isinstance(each.record, Footer) for each in found) == 1


def test_a_reader_notices_a_chunk_that_became_a_private_record(tmp_path: Path, larger: Original) -> None:
    """The top bit of its kind makes a chunk a record that every reader must pass over."""
    start = larger.spans[7][0]
    (tmp_path / "private.mcap").write_bytes(flipped(larger.data, (start, 7)))
    with pytest.raises(InputError, match=rf"is damaged near byte {start}: .*seatrial recover"):
        read_recording(tmp_path / "private.mcap")


def test_a_reader_notices_two_topics_of_one_number(tmp_path: Path) -> None:
    definitions = Channel(7, "/lute", "json", {}, 2), packed(SCHEMA, CHANNEL, MESSAGE)
    (tmp_path / "two.mcap").write_bytes(hand_made(HEADER, *definitions))
    with pytest.raises(InputError, match=r"two topics of one number; .*seatrial recover"):
        list(MessageStream(tmp_path / "two.mcap"))


def test_the_command_says_what_was_saved_and_lost(tmp_path: Path, larger: Original) -> None:
    from seatrial import app

    source, start = tmp_path / "damaged.mcap", larger.spans[20][0]
    source.write_bytes(flipped(larger.data, (start + 90, 1)))
    result = CliRunner().invoke(app, ["recover", str(source), "-o", str(tmp_path / "a.mcap"), "--json"])
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert found["recovered"] == 575
    assert found["damaged_chunks"] == 1
    assert found["lost_bytes"] == larger.spans[20][1] - start
    assert found["recovered_until"] == "2026-05-28T20:26:45.990000+00:00"
    result = CliRunner().invoke(app, ["recover", str(source), "-o", str(tmp_path / "b.mcap")])
    assert result.exit_code == 0
    assert result.stdout.strip() == str(tmp_path / "b.mcap")
    assert "saved 575 messages" in result.stderr
    assert "with 1 chunk" in result.stderr
    assert "a gap of 0.260 s" in result.stderr


def test_info_names_the_remedy(tmp_path: Path, larger: Original) -> None:
    from seatrial import app

    (tmp_path / "cut.mcap").write_bytes(larger.data[: larger.spans[-1][1]])
    shown = CliRunner().invoke(app, ["info", str(tmp_path / "cut.mcap")])
    assert "NOT CLOSED" in shown.stdout
    assert "seatrial recover" in shown.stdout
    (tmp_path / "bad.mcap").write_bytes(flipped(larger.data, (larger.spans[9][0] + 90, 1)))
    with pytest.raises(InputError, match=r"is damaged near byte \d+.*seatrial recover"):
        read_recording(tmp_path / "bad.mcap")


def test_a_file_whose_beginning_is_gone_gives_back_what_follows_the_next_definitions(tmp_path: Path) -> None:
    """Killed after a minute or two, and the first page of the file erased: topics are defined anew now and then."""
    path = tmp_path / "long.mcap"
    writer = RecordingWriter(path, Trial(name="long"))
    for number in range(650):
        writer.write_sample(Sample("north_m", float(number), "x", 1_790_000_000_000_000_000 + number, 0, number))
        writer.flush()
    data = bytearray(path.read_bytes())
    data[:4096] = bytes(4096)
    path.write_bytes(data)
    recover(path, tmp_path / "saved.mcap")
    values = read_recording(tmp_path / "saved.mcap").series["north_m"].value
    assert values[-1] == 649.0
    assert len(values) >= 630  # the definitions in a later chunk name those before it too
