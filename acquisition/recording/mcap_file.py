"""Writing the MCAP format: chunks of messages, and the index at the end.

The records are those of the ``mcap`` library. Its writer serialises a message field by field, which took more than
a third of the recorder's time, and keeps an object for every chunk until the end. Here a message, and the index
of a chunk's messages, are packed at once, and of a chunk only its index record is kept, as bytes. The library's
readers are the oracle that this is tested against. The format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from typing import Any

import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from seatrial.acquisition.recording.records import with_checksum
from seatrial.acquisition.recording.scan import MCAP_MAGIC
from seatrial.acquisition.recording.storage import CommittedFile

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_CODE = int(Opcode.MESSAGE)
_FIXED_BYTES = 2 + 4 + 8 + 8
_INDEX = struct.Struct("<BQHI")
_FOOTER_HEAD = struct.Struct("<BQQQ")
_FOOTER_BYTES = 8 + 8 + 4
_CHUNKS_TO_NEXT_DEFINITIONS = 300


def serialise(record: mcap.McapRecord) -> bytes:
    """One record as it stands in a file."""
    builder: Any = RecordBuilder()
    writable: Any = record
    writable.write(builder)
    return bytes(builder.end())


class McapFile:
    """An MCAP file being written to ``stream``, whose errors pass through.

    Times are ns since 1970 and must be 0 or more. A definition (schema, channel) stands in the chunk that first
    uses it, where a checksum guards it, once more behind that chunk, and again in a chunk every minute or so: no
    damage to one place makes the others unreadable. The end of the data has a checksum of all of it, and metadata
    has one of its own, as a file that is not closed has no end.
    """

    def __init__(self, stream: CommittedFile, library: str, chunk_bytes: int) -> None:
        self._stream, self._chunk_bytes = stream, chunk_bytes
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._repeat: list[bytes] = []
        self._indexes: dict[Opcode, list[bytes]] = defaultdict(list)
        self._counts: dict[int, int] = {}
        self._attachments = self._metadata = 0
        self._span: tuple[int, int] | None = None
        self._checksum = 0  # of all bytes so far
        self._begin_chunk()
        self._write(MCAP_MAGIC + serialise(mcap.Header("", library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a schema and return its number."""
        number = len(self._schemas) + 1
        self._schemas.append(self._define(mcap.Schema(id=number, name=name, encoding=encoding, data=data)))
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: dict[str, str] | None = None
    ) -> int:
        """Define a channel and return its number."""
        number = len(self._channels) + 1
        channel = mcap.Channel(
            id=number, topic=topic, message_encoding=message_encoding, schema_id=schema_id, metadata=metadata or {}
        )
        self._channels.append(self._define(channel))
        self._counts[number] = 0
        return number

    def add_message(self, channel_id: int, log_ns: int, data: bytes, publish_ns: int, sequence: int) -> None:
        """Add a message to the chunk in progress, which ends when it is large enough."""
        chunk = self._chunk
        head = _MESSAGE.pack(_MESSAGE_CODE, _FIXED_BYTES + len(data), channel_id, sequence, log_ns, publish_ns)
        self._index[channel_id] += log_ns, len(chunk)
        chunk += head
        chunk += data
        if len(chunk) > self._chunk_bytes:
            self.end_chunk()

    def add_metadata(self, name: str, metadata: dict[str, str]) -> None:
        """Add a metadata record, outside all chunks."""
        checked = mcap.Metadata(name=name, metadata=with_checksum(name, metadata))
        record, offset = serialise(checked), self._stream.tell()
        self._write(record)
        index = mcap.MetadataIndex(offset=offset, length=len(record), name=name)
        self._indexes[Opcode.METADATA_INDEX].append(serialise(index))
        self._metadata += 1

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment, outside all chunks."""
        attachment = mcap.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        record, offset = serialise(attachment), self._stream.tell()
        self._write(record)
        index = mcap.AttachmentIndex(
            offset=offset, length=len(record), create_time=0, log_time=0, data_size=len(data), name=name,
            media_type=media_type,
        )  # fmt: skip
        self._indexes[Opcode.ATTACHMENT_INDEX].append(serialise(index))
        self._attachments += 1

    def end_chunk(self) -> None:
        """Write the chunk in progress, if it holds a message."""
        if not self._index:
            return
        start_ns = min(min(places[::2]) for places in self._index.values())
        end_ns = max(max(places[::2]) for places in self._index.values())
        chunk = mcap.Chunk(
            compression="zstd",
            data=self._compressor.compress(bytes(self._chunk)),
            message_start_time=start_ns,
            message_end_time=end_ns,
            uncompressed_crc=zlib.crc32(self._chunk),
            uncompressed_size=len(self._chunk),
        )
        offset, record = self._stream.tell(), serialise(chunk)
        self._write(record)
        self._index_chunk(chunk, offset, len(record))
        self._span = min(start_ns, (self._span or (start_ns,))[0]), max(end_ns, (self._span or (0, end_ns))[1])
        self._begin_chunk()
        self._write(b"".join(self._repeat))
        self._repeat.clear()

    def finish(self) -> None:
        """Write the last chunk, the index and the end of the file."""
        self.end_chunk()
        self._stream.write(serialise(mcap.DataEnd(self._checksum)))
        start = self._stream.tell()
        summary = bytearray()
        offsets = bytearray()
        for opcode, records in self._summary():
            if records:
                group = mcap.SummaryOffset(
                    group_opcode=opcode, group_start=start + len(summary), group_length=sum(map(len, records))
                )
                offsets += serialise(group)
                summary += b"".join(records)
        offsets_start = start + len(summary)
        summary += offsets
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offsets_start), zlib.crc32(summary))
        footer = mcap.Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=crc)
        self._stream.write(bytes(summary) + serialise(footer) + MCAP_MAGIC)

    def _write(self, data: bytes) -> None:
        """Write what belongs to the data, of which there is a checksum."""
        self._checksum = zlib.crc32(data, self._checksum)
        self._stream.write(data)

    def _begin_chunk(self) -> None:
        due = len(self._indexes[Opcode.CHUNK_INDEX]) % _CHUNKS_TO_NEXT_DEFINITIONS == 0
        self._chunk = bytearray(b"".join(self._schemas + self._channels) if due else b"")
        self._index: defaultdict[int, list[int]] = defaultdict(list)  # time, place, time, place ...

    def _define(self, record: mcap.Schema | mcap.Channel) -> bytes:
        data = serialise(record)
        self._chunk += data
        self._repeat.append(data)
        return data

    def _index_chunk(self, chunk: mcap.Chunk, offset: int, length: int) -> None:
        """Write where in the chunk each channel's messages are, and keep where the chunk is."""
        start = self._stream.tell()
        places: dict[int, int] = {}
        for channel_id, entries in self._index.items():
            places[channel_id] = self._stream.tell()
            head = _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + 8 * len(entries), channel_id, 8 * len(entries))
            self._write(head + struct.pack(f"<{len(entries)}Q", *entries))
            self._counts[channel_id] += len(entries) // 2
        index = mcap.ChunkIndex(
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            chunk_start_offset=offset,
            chunk_length=length,
            message_index_offsets=places,
            message_index_length=self._stream.tell() - start,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        self._indexes[Opcode.CHUNK_INDEX].append(serialise(index))

    def _summary(self) -> list[tuple[Opcode, list[bytes]]]:
        start_ns, end_ns = self._span or (0, 0)
        statistics = mcap.Statistics(
            attachment_count=self._attachments,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indexes[Opcode.CHUNK_INDEX]),
            message_count=sum(self._counts.values()),
            message_start_time=start_ns,
            message_end_time=end_ns,
            metadata_count=self._metadata,
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [serialise(statistics)]),
            *((opcode, self._indexes[opcode]) for opcode in (
                Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX
            )),
        ]  # fmt: skip


def end_without_index() -> bytes:
    """What ends a file that there is no room to index: readers can do without an index."""
    return serialise(mcap.DataEnd(0)) + serialise(mcap.Footer(0, 0, 0)) + MCAP_MAGIC
