"""One record of an MCAP file: from bytes that may be damaged to the library's record, or a clear refusal.

What counts as intact: a record that is exactly as long as its fields, and of a chunk and an attachment also that
its checksum is right. Nothing that a record claims of itself makes us read or decompress more than a limit.
"""

from __future__ import annotations

import io
import re
import struct
import threading
import zlib
from collections.abc import Callable, Mapping

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode

TOO_SHORT, CUT = 1, 2
"""What may be wrong with a record in a chunk."""

LARGEST_BYTES = 64 * 1024 * 1024
"""A record, or a chunk once decompressed, beyond this is damage, not data."""

HEAD = struct.Struct("<BQ")
"""What every record begins with: its opcode and the length of what follows."""

CHUNK_HEAD_BYTES = 44
"""So many bytes of a chunk's content tell whether it can be a chunk at all."""

MESSAGE = struct.Struct("<HIQQ")
"""What a message's data stand behind: the numbers of its channel and sequence, its two times [ns]."""

MESSAGE_HEAD = np.dtype(
    [
        ("channel", np.uint16), ("sequence", np.uint32), ("log_ns", np.uint64), ("publish_ns", np.uint64),
        ("start", np.int64), ("end", np.int64),
    ],
    align=True,
)  # fmt: skip
"""The same in an array, and where in some bytes the data start and end."""

_CHUNK = struct.Struct("<QQQII")  # start, end, size, checksum, and the length of the compression's name
_CHUNK_INDEX = struct.Struct("<QQQQI")  # start, end, place, length, and the length of the messages' indexes' places
_INDEX = struct.Struct("<HI")
_LENGTH, _NAME_LENGTH, _SIZES, _PLACE_BYTES = struct.Struct("<Q"), struct.Struct("<I"), struct.Struct("<QQ"), 10
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_CHECKSUM_KEY, _CHECKSUM = "checksum", re.compile("crc32 [0-9a-f]{8}")
_FIRST_PRIVATE = 0x80  # from here on opcodes belong to applications
_PARSERS: dict[int, Callable[[ReadDataStream], mcap.McapRecord]] = {
    Opcode.HEADER: mcap.Header.read,
    Opcode.FOOTER: mcap.Footer.read,
    Opcode.SCHEMA: mcap.Schema.read,
    Opcode.CHANNEL: mcap.Channel.read,
    Opcode.ATTACHMENT: mcap.Attachment.read,
    Opcode.ATTACHMENT_INDEX: mcap.AttachmentIndex.read,
    Opcode.STATISTICS: mcap.Statistics.read,
    Opcode.METADATA: mcap.Metadata.read,
    Opcode.METADATA_INDEX: mcap.MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: mcap.SummaryOffset.read,
    Opcode.DATA_END: mcap.DataEnd.read,
}
_FORMAT_ERRORS = (McapError, ValueError, struct.error, zstandard.ZstdError, RuntimeError)  # lz4 raises the last


class RecordError(ValueError):
    """Bytes are not the record that they should be. The text says why, the same text for the same cause.

    ``chunk`` counts on from the first of those that were read together.
    """

    def __init__(self, why: str, chunk: int = 0) -> None:
        super().__init__(why)
        self.chunk = chunk


class _OfThread(threading.local):
    """What takes longer to make than to use, and serves one thread only."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor(max_window_size=LARGEST_BYTES)


_OF_THREAD = _OfThread()


class _Fields(ReadDataStream):
    """A record's content; unlike the library's own stream it never gives less than was asked for."""

    def __init__(self, content: bytes) -> None:
        super().__init__(io.BytesIO())
        self._content = content

    def read(self, length: int) -> bytes:
        end = self._count + length
        if length < 0 or end > len(self._content):
            raise EndOfFile
        field = self._content[self._count : end]
        self._count = end
        return field


def is_private(opcode: int) -> bool:
    """Whether a kind of record belongs to an application and means nothing to us."""
    return opcode >= _FIRST_PRIVATE


def is_known(opcode: int) -> bool:
    """Whether a record may be of this kind."""
    return Opcode.HEADER <= opcode <= Opcode.DATA_END or is_private(opcode)


def parse(opcode: int, content: bytes) -> mcap.McapRecord | None:
    """The record with this content; a chunk comes decompressed; None for what is of no use to a reader.

    These are private records and the index of a chunk's messages. Raises :class:`RecordError`.
    """
    if opcode == Opcode.MESSAGE:
        if len(content) < MESSAGE.size:
            raise RecordError("a message too short")
        channel_id, sequence, log_ns, publish_ns = MESSAGE.unpack_from(content)
        return mcap.Message(channel_id, log_ns, content[MESSAGE.size :], publish_ns, sequence)
    if opcode == Opcode.MESSAGE_INDEX:
        if len(content) < _INDEX.size or _INDEX.unpack_from(content)[1] + _INDEX.size != len(content):
            raise RecordError("a record of a wrong length")
        return None
    if is_private(opcode):
        return None
    if opcode == Opcode.CHUNK:
        return _parse_chunk(content)
    if opcode == Opcode.CHUNK_INDEX:
        return _parse_chunk_index(content)
    record = _parse_fields(opcode, content)
    if isinstance(record, mcap.Attachment):
        check_checksum(zlib.crc32(content[:-4]), int.from_bytes(content[-4:], "little"), "an attachment")
    return record


def with_checksum(name: str, metadata: Mapping[str, str]) -> dict[str, str]:
    """Metadata with a checksum of its name, keys and values among them: the format has none for metadata."""
    metadata = {key: text for key, text in metadata.items() if key != _CHECKSUM_KEY}
    text = "\0".join((name, *(part for item in metadata.items() for part in item)))
    return {**metadata, _CHECKSUM_KEY: f"crc32 {zlib.crc32(text.encode()):08x}"}


def without_checksum(record: mcap.Metadata) -> dict[str, str]:
    """The inverse of :func:`with_checksum`; metadata without one are taken as they are.

    Raises :class:`RecordError` where the checksum is wrong, or its key or value damaged.
    """
    metadata = {key: text for key, text in record.metadata.items() if key != _CHECKSUM_KEY}
    checked = len(metadata) < len(record.metadata) or any(map(_CHECKSUM.fullmatch, metadata.values()))
    if checked and with_checksum(record.name, metadata) != record.metadata:
        raise RecordError("the checksum of metadata is wrong")
    return metadata


def _parse_chunk(content: bytes) -> mcap.Chunk:
    """A chunk, decompressed; by hand, as there are hundreds of thousands in the recording of a day."""
    check_chunk_head(content, len(content))
    start_ns, end_ns, size_bytes, crc, name_length = _CHUNK.unpack_from(content)
    data_start = _CHUNK.size + name_length + 8
    compression = content[_CHUNK.size : data_start - 8]
    plain = _decompressed(compression, memoryview(content)[data_start:], size_bytes)
    check_checksum(zlib.crc32(plain), crc, "a chunk")
    return mcap.Chunk("", plain, end_ns, start_ns, crc, size_bytes)


def _parse_chunk_index(content: bytes) -> mcap.ChunkIndex:
    """By hand, as there are as many as chunks; without where the messages' indexes are, which nobody asks."""
    try:
        start_ns, end_ns, place, length, places = _CHUNK_INDEX.unpack_from(content)
        (indexes,) = _LENGTH.unpack_from(content, _CHUNK_INDEX.size + places)
        (name_length,) = _NAME_LENGTH.unpack_from(content, _CHUNK_INDEX.size + places + _LENGTH.size)
        name = content[-2 * _LENGTH.size - name_length : -2 * _LENGTH.size]
        sizes = _SIZES.unpack_from(content, len(content) - _SIZES.size)
    except struct.error as error:
        raise RecordError("a record whose fields do not fit it") from error
    expected = _CHUNK_INDEX.size + places + _LENGTH.size + _NAME_LENGTH.size + name_length + _SIZES.size
    if len(content) != expected or name not in _COMPRESSIONS or places % _PLACE_BYTES:
        raise RecordError("a record of a wrong length")
    return mcap.ChunkIndex(length, place, name.decode(), sizes[0], end_ns, indexes, {}, start_ns, sizes[1])


def check_chunk_head(fields: bytes, length: int) -> None:
    """Refuse by the first :data:`CHUNK_HEAD_BYTES` of its content what cannot be a chunk of ``length`` bytes."""
    if len(fields) < _CHUNK.size:
        raise RecordError("a chunk too short")
    start_ns, end_ns, size_bytes, _, name_length = _CHUNK.unpack_from(fields)
    name = fields[_CHUNK.size : _CHUNK.size + name_length]
    data_length = int.from_bytes(fields[_CHUNK.size + len(name) :][:8], "little")
    if name not in _COMPRESSIONS or len(name) != name_length:
        raise RecordError("a chunk of an unknown compression")
    if start_ns > end_ns or _CHUNK.size + name_length + 8 + data_length != length:
        raise RecordError("no head of a chunk")
    if size_bytes > LARGEST_BYTES:
        raise RecordError(f"a chunk of more than {LARGEST_BYTES // 2**20} MiB")


def _parse_fields(opcode: int, content: bytes) -> mcap.McapRecord:
    fields = _Fields(content)
    try:
        record = _PARSERS[opcode](fields)
    except _FORMAT_ERRORS as error:
        raise RecordError("a record whose fields do not fit it") from error
    if fields.count != len(content):
        raise RecordError("a record of a wrong length")
    return record


def _decompressed(compression: bytes, data: memoryview, size_bytes: int) -> bytes:
    """A chunk's records, never more than it said that they are: what its data claim is not believed."""
    enough = size_bytes + 1  # one more, to notice that there is more
    try:
        if compression == b"zstd":
            plain = _unzstd(data, size_bytes, enough)
        elif compression == b"lz4":
            plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=enough)
        else:
            plain = bytes(data)
    except _FORMAT_ERRORS as error:
        raise RecordError("a chunk that cannot be decompressed") from error
    if len(plain) != size_bytes:
        raise RecordError("a chunk of another size than it says")
    return plain


def _unzstd(data: memoryview, size: int, enough: int) -> bytes:
    """At once where the data say their size and it is the one that is expected, else as far as ``enough``."""
    decompressor = _OF_THREAD.decompressor
    if zstandard.get_frame_parameters(data).content_size == size:
        return decompressor.decompress(data)
    with decompressor.stream_reader(data) as reader:
        return reader.read(enough)


def check_checksum(checksum: int, expected: int, whose: str) -> None:
    """Raise :class:`RecordError` unless a checksum is the one that a record names, or it names none."""
    if expected not in (0, checksum):  # 0 means that the writer made none
        raise RecordError(f"the checksum of {whose} is wrong")
