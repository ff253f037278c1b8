"""Reading by the chunk gives what reading message by message gives, and refuses what that refuses.

All of it twice: by the compiled loop, and without it, as small recordings are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.writer import Writer

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Frame, Quality, Sample, Trial
from seatrial.acquisition.recording import batches, reader
from seatrial.acquisition.recording.messages import CHANNEL_PREFIX, SAMPLE, MessageKind, encode_sample
from seatrial.acquisition.recording.reader import MessageStream, Recording, read_recording
from seatrial.acquisition.recording.scan import HEAD, RecordError, parse_record
from seatrial.acquisition.recording.writer import RecordingWriter, serialise_record

SAMPLES = st.builds(
    Sample,
    st.sampled_from(["north_m", "heading_deg", "port_rpm"]),
    st.floats(-1e6, 1e6) | st.integers(-5, 5).map(float),
    st.sampled_from(["gps", "gyro/HE,HDT", 'a "quoted" name', "ø"]),
    st.integers(0, 2**62),
    st.integers(0, 2**40),
    st.integers(0, 2**62),
    st.none() | st.integers(0, 2**60),
    st.just("gps"),
    st.sampled_from(list(Quality)),
)


@pytest.fixture(autouse=True, scope="module", params=[True, False], ids=["compiled", "little"])
def compiled(request: pytest.FixtureRequest) -> Iterator[bool]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batches, "_is_worth_loading", lambda plain: request.param)
        yield request.param


SAID = st.lists(SAMPLES | st.just("raw") | st.just("event"), min_size=1, max_size=60)


def one_by_one(path: Path) -> dict[str, list[tuple[int, int, float, int, str]]]:
    """The oracle: every message decoded by itself, by topic."""
    found: dict[str, list[tuple[int, int, float, int, str]]] = {}
    for entry in MessageStream(path):
        if entry.topic.startswith(CHANNEL_PREFIX):
            body = entry.decode_body()
            row = (entry.publish_ns, entry.log_ns, float(body["value"]), int(body["quality"]), body["source"])
            found.setdefault(entry.topic.removeprefix(CHANNEL_PREFIX), []).append(row)
    return found


def rows_of(recording: Recording) -> dict[str, list[tuple[int, int, float, int, str]]]:
    return {
        name: list(
            zip(
                series.measured_ns.tolist(),
                series.received_ns.tolist(),
                series.value.tolist(),
                series.quality.tolist(),
                [series.sources[index] for index in series.source_index],
                strict=True,
            )
        )
        for name, series in recording.series.items()
    }


@settings(max_examples=60, deadline=None)
@given(said=SAID, flushes=st.sets(st.integers(0, 60)), together_bytes=st.sampled_from([1, 500, 2**22]))
def test_whole_chunks_are_read_as_single_messages_are(
    tmp_path_factory: pytest.TempPathFactory, said: list[Sample | str], flushes: set[int], together_bytes: int
) -> None:
    """Values to the last bit, in their order, whatever else stands between them, wherever chunks end, and however
    many are unpacked together.
    """
    path = tmp_path_factory.mktemp("batches") / "mixed.mcap"
    with RecordingWriter(path, Trial()) as writer:
        for number, each in enumerate(said):
            if each == "raw":
                writer.write_raw(Frame("bus", "can", b"\x01", 6, 2, 0x123))
            elif isinstance(each, Sample):
                writer.write_sample(each)
            else:
                writer.write_event(f"mark {number}", number)
            if number in flushes:
                writer.flush()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(reader, "_ENOUGH_BYTES", together_bytes)
        recording = read_recording(path)
    assert rows_of(recording) == one_by_one(path)
    assert list(recording.series) == list(one_by_one(path))
    assert sum(recording.raw.values()) == said.count("raw")
    assert recording.events == [(at, f"mark {at}") for at, each in enumerate(said) if each == "event"]
    assert recording.messages == len(said)


def foreign(path: Path, payloads: list[bytes], chunked: bool = True) -> Path:
    """A recording by the plain library: two channels of one topic that take turns."""
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=chunked)
        writer.start()
        schema = writer.register_schema("other", "jsonschema", b"{}")
        channels = [writer.register_channel("/channel/north_m", "json", schema) for _ in range(2)]
        for number, payload in enumerate(payloads):
            writer.add_message(channels[number % 2], number, payload, number + 7)
        writer.finish()
    return path


@pytest.mark.parametrize("chunked", [True, False])
def test_two_channels_of_one_topic_and_odd_numbers_are_one_series(tmp_path: Path, chunked: bool) -> None:
    payloads = [
        b'{"value": 1, "quality": 2, "source": "a"}',
        b'{"value": "2.5", "quality": 1.0, "source": "b"}',
        b'{"source": "a",\n "quality": 3, "value": 1e3}',
        b'{"value": true, "quality": 2, "source": "c"}',
    ]
    series = read_recording(foreign(tmp_path / "twins.mcap", payloads, chunked)).series["north_m"]
    assert series.value.tolist() == [1.0, 2.5, 1000.0, 1.0]
    assert series.quality.tolist() == [2, 1, 3, 2]
    assert series.measured_ns.tolist() == [7, 8, 9, 10]
    assert series.sources == ("a", "b", "c")
    assert series.source_index.tolist() == [0, 1, 0, 2]


@pytest.mark.parametrize("bad", [b"\x09", b"\xff" * 40, b"\x2a\x7fx", b"\x2a\x02\xff\xfe"])
def test_bytes_that_are_no_protobuf_are_refused(tmp_path: Path, bad: bytes) -> None:
    good = encode_sample(Sample("north_m", 1.0, "a", 0, 0, 0))
    with (tmp_path / "bad.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(SAMPLE.title, "protobuf", SAMPLE.descriptors)
        channel = writer.register_channel("/channel/north_m", "protobuf", schema)
        for payload in (good, bad, good):
            writer.add_message(channel, 0, payload, 0)
        writer.finish()
    with pytest.raises(InputError, match="topic /channel/north_m holds a message that is no sample of ours"):
        read_recording(tmp_path / "bad.mcap")


@pytest.mark.parametrize(
    "bad",
    [b'{"value": null, "quality": 2, "source": "a"}', b'{"value": 1, "quality": 300, "source": "a"}', b"",
     b'{"value": 1, "quality": 2}', b'{"value": 1, "quality": 2, "source": ["a"]}', b"7", b"1,2", b"[]",
     b'{"value": 1, "quality": 2, "source": "a"},{"value": 1, "quality": 2, "source": "a"}'],
)  # fmt: skip
def test_one_message_that_is_no_sample_is_refused_among_good_ones(tmp_path: Path, bad: bytes) -> None:
    good = b'{"value": 1, "quality": 2, "source": "a"}'
    with pytest.raises(InputError, match="topic /channel/north_m holds a message that is no sample of ours"):
        read_recording(foreign(tmp_path / "bad.mcap", [good, good, bad, good]))


FIELDS = ["value", "source_time", "monotonic_ns", "quality", "source", "source_clock"]


@settings(max_examples=30, deadline=None)
@given(
    order=st.permutations(FIELDS),
    said=st.lists(st.tuples(st.sampled_from([0.0, 1.5, -3.0]), st.sampled_from("ab"), st.booleans()), min_size=1),
)
def test_samples_of_another_serialiser_or_version_are_read_by_the_schema_of_the_file(
    tmp_path_factory: pytest.TempPathFactory, order: list[str], said: list[tuple[float, str, bool]]
) -> None:
    """One that leaves out what is 0, as protobuf does, among ours; or one whose fields have other numbers."""
    ours = {each.name: each.type for each in SAMPLE.message.DESCRIPTOR.fields}
    formats = {1: "double", 7: "fixed32", 9: "string", 16: "sfixed64"}
    described = {name: {"type": "number", "format": formats[ours[name]]} for name in order}
    theirs = MessageKind(SAMPLE.title, {"type": "object", "properties": described})
    path = tmp_path_factory.mktemp("other") / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            "/channel/north_m", "protobuf", writer.register_schema(SAMPLE.title, "protobuf", theirs.descriptors)
        )
        for number, (value, source, is_ours) in enumerate(said):
            message = theirs.message(value=value, source=source, quality=2).SerializeToString()
            sample = encode_sample(Sample("north_m", value, source, number, 0, number))
            writer.add_message(channel, number, sample if is_ours and order == FIELDS else message, number)
        writer.finish()
    series = read_recording(path).series["north_m"]
    assert series.value.tolist() == [value for value, _, _ in said]
    assert [series.sources[index] for index in series.source_index] == [source for _, source, _ in said]


def test_a_time_beyond_what_can_be_counted_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "late.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            "/channel/north_m", "json", writer.register_schema("o", "jsonschema", b"{}")
        )
        writer.add_message(channel, 2**63, b'{"value": 1, "quality": 2, "source": "a"}', 1)
        writer.finish()
    with pytest.raises(InputError, match="no sample of ours"):
        read_recording(tmp_path / "late.mcap")


def test_a_stream_can_be_read_twice(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "x.mcap", Trial()) as writer:
        for number in range(5):
            writer.write_sample(Sample("surge_mps", float(number), "s", number, number, number))
    stream = MessageStream(tmp_path / "x.mcap")
    assert list(stream) == list(stream)
    assert np.array_equal(read_recording(tmp_path / "x.mcap").series["surge_mps"].value, np.arange(5.0))


def test_the_index_of_a_chunk_is_read_as_the_library_reads_it() -> None:
    """But for the places of the messages' indexes; a byte more or less is none."""
    index = mcap.ChunkIndex(
        chunk_length=1, chunk_start_offset=2, compression="zstd", compressed_size=3, message_end_time=9,
        message_index_length=4, message_index_offsets={1: 5, 2: 7}, message_start_time=8, uncompressed_size=6,
    )  # fmt: skip
    content = serialise_record(index)[HEAD.size :]
    assert parse_record(Opcode.CHUNK_INDEX, content) == replace(index, message_index_offsets={})
    for broken in (content[:-1], content + b"\0", content[:36], content.replace(b"zstd", b"zzzz")):
        with pytest.raises(RecordError):
            parse_record(Opcode.CHUNK_INDEX, broken)
