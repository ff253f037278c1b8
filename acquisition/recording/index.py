"""What is in a closed recording by its index: a few ranges of a file, however large it is.

Of gigabytes in an object store some megabytes are read: the end of the file with the counts and definitions, the
run sheet, the first and the last chunks, which tell when each channel begins and ends, and the chunks with events.
What only all samples tell, such as the longest gap, stays unknown. The checksum of the whole is not checked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import Any, Protocol

from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from seatrial.acquisition.core import process
from seatrial.acquisition.core.errors import InputError, escape_control_characters
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.trial import NANO, Trial, iso_utc
from seatrial.acquisition.recording import batches, messages, reader, scan

SMALL_BYTES = 4 * 1024 * 1024
"""A file up to this size is read as a whole, which costs as little and tells all."""
_TAIL_BYTES = 64 * 1024  # with the footer and the offsets, of most files with all but the chunks' index
_FOOTER_BYTES = scan.HEAD.size + 20 + len(scan.MCAP_MAGIC)
_INDEX_BYTES = 1536 * 1024  # of a larger index of chunks only the beginning and the end are read
_INDEX_EDGE_BYTES = 64 * 1024
_EDGE_BYTES = 512 * 1024  # of chunks at each end: of the recorder some seconds
_EVENT_BYTES = 1024 * 1024  # of chunks with events in between
_DEFINITION_BYTES = 1024 * 1024  # of the schemas, the channels, or the index of metadata


class Ranges(Protocol):
    """A file that is read by ranges."""

    name: str
    size_bytes: int
    fetched_bytes: int

    def seek(self, offset: int, whence: int = 0, /) -> int: ...

    def read(self, size: int | None = -1, /) -> bytes: ...


@dataclass(frozen=True, slots=True)
class IndexedRecording:
    """A recording by its index. ``recording`` has the samples of its first and last chunks only.

    ``counts`` are the samples of each channel, ``first_ns`` and ``last_ns`` the times of the first and last of them
    [ns UTC] where they are in those chunks. ``unread_events`` are in chunks that were not read.
    """

    recording: reader.Recording
    counts: Mapping[str, int]
    first_ns: Mapping[str, int]
    last_ns: Mapping[str, int]
    unread_events: int
    read_bytes: int
    size_bytes: int

    def as_dict(self) -> dict[str, Any]:
        """As :func:`describe_recording`, None for what the index does not tell; and how much was read."""
        channels = {name: self._describe_channel(name) for name in sorted(self.counts) if self.counts[name]}
        index = {"read_bytes": self.read_bytes, "size_bytes": self.size_bytes, "unread_events": self.unread_events}
        return {**reader.describe_recording(self.recording), "channels": channels, "index": index}

    def _describe_channel(self, name: str) -> dict[str, Any]:
        count, first, last = self.counts[name], self.first_ns.get(name), self.last_ns.get(name)
        series = self.recording.series.get(name)
        is_known = first is not None and last is not None
        span_s = (last - first) / NANO if first is not None and last is not None else 0.0
        return {
            "count": count,
            "rate_hz": (count - 1) / span_s if span_s > 0.0 else 0.0 if is_known else None,
            "first": None if first is None else iso_utc(first),
            "last": None if last is None else iso_utc(last),
            "sources": sorted(series.sources) if series is not None else [],
            "longest_gap_s": None,
        }


def read_by_index(stream: Ranges) -> IndexedRecording | None:
    """A recording by its index; None for one without, for a small file, and for another program's.

    Raises :class:`InputError` where the index is damaged, and what the stream raises.
    """
    if stream.size_bytes <= SMALL_BYTES:
        return None
    try:
        return _IndexReader(stream).read()
    except (scan.RecordError, McapError, KeyError, TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("is damaged in its index", where=stream.name, why=str(error), fix=reader.REMEDY) from error


class _IndexReader:
    """The way through the index of one file, and what was read of it."""

    def __init__(self, stream: Ranges) -> None:
        self._stream = stream
        self._tail_start = stream.size_bytes - _TAIL_BYTES
        self._tail = b""
        self._tail = self._fetch(self._tail_start, _TAIL_BYTES)
        self._meter = process.Meter(stream.name, stream.size_bytes)
        self._topics: dict[int, messages.Topic] = {}
        self._groups: dict[int, tuple[int, int]] = {}  # of the summary: where the records of a kind are, and bytes

    def read(self) -> IndexedRecording | None:
        if not self._tail.endswith(scan.MCAP_MAGIC):
            return None
        (footer,) = _records(self._tail[-_FOOTER_BYTES : -len(scan.MCAP_MAGIC)])
        if not isinstance(footer, mcap.Footer) or not footer.summary_start or not footer.summary_offset_start:
            return None
        offsets_bytes = self._stream.size_bytes - _FOOTER_BYTES - footer.summary_offset_start
        for group in _records(self._fetch_definitions(footer.summary_offset_start, offsets_bytes)):
            self._groups[group.group_opcode] = group.group_start, group.group_length
        if not {Opcode.STATISTICS, Opcode.CHANNEL, Opcode.CHUNK_INDEX} <= self._groups.keys():
            return None
        schemas = {record.id: record.data for record in self._group(Opcode.SCHEMA)}
        self._topics = {
            record.id: messages.Topic(record.topic, record.message_encoding, schemas.get(record.schema_id, b""))
            for record in self._group(Opcode.CHANNEL)
        }
        if not any(
            topic.is_channel or topic.name.startswith(messages.RAW_PREFIX) for topic in self._topics.values()
        ):
            return None
        return self._indexed_recording()

    def _indexed_recording(self) -> IndexedRecording:
        (statistics,) = self._group(Opcode.STATISTICS)
        counts = Counter[str]()
        for number, count in statistics.channel_message_counts.items():
            counts[self._topics[number].name] += count
        metadata = self._metadata()
        trial = metadata.pop("trial", None)
        pieces = [self._recording_of_chunks(chunks) for chunks in self._chosen_chunks()]
        recording = replace(
            pieces[0],
            trial=Trial() if trial is None else Trial.from_metadata(trial),
            metadata=metadata,
            series={
                name: Series.concatenate([piece.series[name] for piece in pieces if name in piece.series])
                for name in dict.fromkeys(name for piece in pieces for name in piece.series)
            },
            events=[event for piece in pieces for event in piece.events],
            event_labels=[label for piece in pieces for label in piece.event_labels],
            health=pieces[0].health | pieces[1].health | pieces[2].health,
            raw=_counts_below(messages.RAW_PREFIX, counts, kept=True),
            predictions=counts[messages.PREDICTION_TOPIC],
            messages=statistics.message_count,
            start_ns=statistics.message_start_time,
            end_ns=statistics.message_end_time,
        )
        ending = pieces[2] if pieces[2].messages else pieces[0]  # so few chunks that all are at the beginning
        return IndexedRecording(
            recording,
            _counts_below(messages.CHANNEL_PREFIX, counts),
            {name: int(series.measured_ns.min()) for name, series in pieces[0].series.items()},
            {name: int(series.measured_ns.max()) for name, series in ending.series.items()},
            counts[messages.EVENT_TOPIC] - len(recording.events),
            self._stream.fetched_bytes,
            self._stream.size_bytes,
        )

    def _chosen_chunks(self) -> tuple[list[mcap.ChunkIndex], list[mcap.ChunkIndex], list[mcap.ChunkIndex]]:
        """The chunks at the beginning, those with events in between, and those at the end, each once."""
        chunks = self._chunk_indexes()
        beginning = _chunks_within(chunks, _EDGE_BYTES)
        starts = {chunk.chunk_start_offset for chunk in beginning}
        ending = [chunk for chunk in reversed(_chunks_within(chunks[::-1], _EDGE_BYTES))
                  if chunk.chunk_start_offset not in starts]  # fmt: skip
        starts |= {chunk.chunk_start_offset for chunk in ending}
        numbers = {number for number, topic in self._topics.items() if topic.name == messages.EVENT_TOPIC}
        between = [
            chunk
            for chunk in chunks
            if chunk.chunk_start_offset not in starts and numbers & chunk.message_index_offsets.keys()
        ]
        return beginning, _chunks_within(between, _EVENT_BYTES), ending

    def _fetch(self, start: int, length: int) -> bytes:
        """A range of the file; what lies in its last bytes is there already."""
        place = start - self._tail_start
        if 0 <= place <= place + length <= len(self._tail):
            return self._tail[place : place + length]
        self._stream.seek(start)
        data = self._stream.read(length)
        if len(data) < length:
            raise scan.RecordError("it ends within a record")
        return data

    def _fetch_definitions(self, start: int, length: int) -> bytes:
        if not 0 <= length <= _DEFINITION_BYTES:
            raise scan.RecordError(f"{length:,} bytes of one kind of record in its summary")
        return self._fetch(start, length)

    def _group(self, opcode: Opcode) -> list[Any]:
        """The records of a kind in the summary."""
        return list(_records(self._fetch_definitions(*self._groups[opcode]))) if opcode in self._groups else []

    def _chunk_indexes(self) -> list[mcap.ChunkIndex]:
        """The index of the chunks in file order; of a large one only its beginning and its end."""
        start, length = self._groups[Opcode.CHUNK_INDEX]
        if length <= _INDEX_BYTES:
            return _parse_chunk_indexes(self._fetch(start, length))
        beginning = self._fetch(start, _INDEX_EDGE_BYTES)
        ending = self._fetch(start + length - _INDEX_EDGE_BYTES, _INDEX_EDGE_BYTES)
        return [*_parse_chunk_indexes(beginning), *_parse_chunk_indexes(ending[_first_record_at(ending) :])]

    def _metadata(self) -> dict[str, dict[str, str]]:
        """The last metadata of each name."""
        places = {index.name: (index.offset, index.length) for index in self._group(Opcode.METADATA_INDEX)}
        metadata = {}
        for start, length in places.values():
            for record in _records(self._fetch_definitions(start, length)):
                reader.count_description(record, self._meter)
                metadata[record.name] = escape_control_characters(scan.remove_metadata_checksum(record))
        return metadata

    def _recording_of_chunks(self, indexes: Sequence[mcap.ChunkIndex]) -> reader.Recording:
        """What is in some chunks, in file order; neighbours are fetched together."""
        builder = reader.RecordingBuilder()
        for start, end in _joined_extents(indexes):
            for chunk in _records(self._fetch(start, end - start), (Opcode.CHUNK,)):
                self._meter.add(process.EXPANDED_BYTES, len(chunk.data))
                for batch in batches.batch_chunks(chunk):
                    if isinstance(batch, batches.Batch):
                        builder.add(batch, self._topics, self._meter)
        return builder.build(Path(self._stream.name), Trial(), {}, closed=True)


def _records(data: bytes, kinds: Collection[int] = ()) -> Iterator[Any]:
    """The records, of some kinds only, in bytes that hold whole ones. Raises :class:`RecordError`."""
    place = 0
    while place < len(data):
        opcode, length = scan.HEAD.unpack_from(data[place : place + scan.HEAD.size].ljust(scan.HEAD.size, b"\0"))
        end = place + scan.HEAD.size + length
        if not scan.is_known_opcode(opcode) or end > len(data):
            raise scan.RecordError("no record where the index says")
        if not kinds or opcode in kinds:
            yield scan.parse_record(opcode, data[place + scan.HEAD.size : end])
        place = end


def _parse_chunk_indexes(data: bytes) -> list[mcap.ChunkIndex]:
    """The whole chunk indexes at the beginning of some bytes, with where the indexes of their messages are."""
    indexes, place = [], 0
    while place + scan.HEAD.size <= len(data):
        opcode, length = scan.HEAD.unpack_from(data, place)
        end = place + scan.HEAD.size + length
        if opcode != Opcode.CHUNK_INDEX:
            raise scan.RecordError("no index of a chunk where the summary says")
        if end > len(data):
            break
        indexes.append(mcap.ChunkIndex.read(ReadDataStream(BytesIO(data[place + scan.HEAD.size : end]))))
        place = end
    return indexes


def _first_record_at(data: bytes) -> int:
    """Where the first of the chunk indexes begins that fill the rest of some bytes; their end if none does."""
    for start in range(len(data)):
        place = start
        while place + scan.HEAD.size <= len(data) and data[place] == Opcode.CHUNK_INDEX:
            place += scan.HEAD.size + scan.HEAD.unpack_from(data, place)[1]
        if place == len(data):
            return start
    return len(data)


def _chunks_within(indexes: Sequence[mcap.ChunkIndex], most_bytes: int) -> list[mcap.ChunkIndex]:
    """The first of some chunks, as many as have together no more bytes, with their indexes; one at least."""
    sizes = accumulate(index.chunk_length + index.message_index_length for index in indexes)
    return [index for number, (index, size) in enumerate(zip(indexes, sizes, strict=True))
            if size <= most_bytes or not number]  # fmt: skip


def _joined_extents(indexes: Sequence[mcap.ChunkIndex]) -> list[tuple[int, int]]:
    """Where chunks begin and end in the file, those together that only their messages' indexes separate."""
    extents: list[tuple[int, int]] = []
    reach = -1
    for index in indexes:
        start, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
        if start == reach:
            extents[-1] = extents[-1][0], end
        else:
            extents.append((start, end))
        reach = end + index.message_index_length
    return extents


def _counts_below(prefix: str, counts: Mapping[str, int], *, kept: bool = False) -> dict[str, int]:
    """The counts of the topics that begin with a prefix, by their names, without it unless it is ``kept``."""
    return {escape_control_characters(name if kept else name.removeprefix(prefix)): count
            for name, count in counts.items() if count and name.startswith(prefix)}  # fmt: skip
