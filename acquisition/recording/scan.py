"""Reads all records of an MCAP file from first to last, in bounded memory, in spite of damage.

:func:`scan_records` walks over an open file, yields what is intact and what is not, and goes on behind the damage.
Intact is a record that is exactly as long as its fields, and whose checksum is right if it is a chunk or an
attachment. Nothing that a record claims of itself makes us read or decompress more than a limit.
"""

from __future__ import annotations

import io
import os
import re
import struct
import threading
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode

from seatrial.acquisition.core import process, trial
from seatrial.acquisition.core.errors import InputError

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
_UINT64, _NAME_LENGTH, _SIZES, _PLACE_BYTES = struct.Struct("<Q"), struct.Struct("<I"), struct.Struct("<QQ"), 10
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

MCAP_MAGIC = b"\x89MCAP0\r\n"
_LENGTH_PATTERN = rb"[\x00-\xff]{3}[\x00-\x04]\x00{4}"  # one that may be
_RECORD_PATTERN = re.compile(rb"[\x01-\x0f]" + _LENGTH_PATTERN)
_CHUNK_PATTERN = re.compile(  # kind, length, two times, size, checksum, name of the compression
    rb"\x06"
    + _LENGTH_PATTERN
    + rb"[\x00-\xff]{16}"
    + _LENGTH_PATTERN
    + rb"[\x00-\xff]{4}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)"
)
_INDEX_HEAD = struct.Struct("<BQHI")  # kind, length, number of the channel, bytes of the entries
_INDEX_FIXED_BYTES = 6
_CHECKSUM_BYTES = 4
_GUARDED = (Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.DATA_END, Opcode.FOOTER)  # by a checksum, or what follows
_BLOCK_BYTES = 1024 * 1024  # read at once: there are hundreds of records in it
_OVERLAP_BYTES = HEAD.size + CHUNK_HEAD_BYTES
_MOST_FALSE_ALARMS = 20_000
_FIRST_SEARCHED_BYTES, _SEARCHED_BYTES = 4 * 1024, 1024 * 1024


class RecordError(ValueError):
    """Bytes are not the record that they should be. The text says why, the same text for the same cause.

    ``chunk`` counts on from the first of those that were read together.
    """

    def __init__(self, reason: str, chunk: int = 0) -> None:
        super().__init__(reason)
        self.chunk = chunk


class _ThreadLocal(threading.local):
    """What takes longer to make than to use, one for each thread."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor(max_window_size=LARGEST_BYTES)


_LOCAL = _ThreadLocal()


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


def is_private_opcode(opcode: int) -> bool:
    """Whether a kind of record belongs to an application and means nothing to us."""
    return opcode >= _FIRST_PRIVATE


def is_known_opcode(opcode: int) -> bool:
    """Whether a record may be of this kind."""
    return Opcode.HEADER <= opcode <= Opcode.DATA_END or is_private_opcode(opcode)


def parse_record(opcode: int, content: bytes) -> mcap.McapRecord | None:
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
    if is_private_opcode(opcode):
        return None
    if opcode == Opcode.CHUNK:
        return _parse_chunk(content)
    if opcode == Opcode.CHUNK_INDEX:
        return _parse_chunk_index(content)
    fields = _Fields(content)
    try:
        record = _PARSERS[opcode](fields)
    except _FORMAT_ERRORS as error:
        raise RecordError("a record whose fields do not fit it") from error
    if fields.count != len(content):
        raise RecordError("a record of a wrong length")
    if isinstance(record, mcap.Attachment):
        require_checksum(zlib.crc32(content[:-4]), int.from_bytes(content[-4:], "little"), "an attachment")
    return record


def add_metadata_checksum(name: str, metadata: Mapping[str, str]) -> dict[str, str]:
    """Metadata with a checksum of its name, keys and values among them: the format has none for metadata."""
    metadata = {key: text for key, text in metadata.items() if key != _CHECKSUM_KEY}
    text = "\0".join((name, *(part for item in metadata.items() for part in item)))
    return {**metadata, _CHECKSUM_KEY: f"crc32 {zlib.crc32(text.encode()):08x}"}


def remove_metadata_checksum(record: mcap.Metadata) -> dict[str, str]:
    """The inverse of :func:`add_metadata_checksum`; metadata without one are taken as they are.

    Raises :class:`RecordError` where the checksum is wrong, or its key or value damaged.
    """
    metadata = {key: text for key, text in record.metadata.items() if key != _CHECKSUM_KEY}
    checked = len(metadata) < len(record.metadata) or any(map(_CHECKSUM.fullmatch, metadata.values()))
    if checked and add_metadata_checksum(record.name, metadata) != record.metadata:
        raise RecordError("the checksum of metadata is wrong")
    return metadata


def _parse_chunk(content: bytes) -> mcap.Chunk:
    """A chunk, decompressed; by hand, as there are hundreds of thousands in the recording of a day.

    Never more than it said that it holds is unpacked: what its data claim is not believed.
    """
    check_chunk_head(content, len(content))
    start_ns, end_ns, size_bytes, crc, name_length = _CHUNK.unpack_from(content)
    data_start = _CHUNK.size + name_length + 8
    compression, data = content[_CHUNK.size : data_start - 8], memoryview(content)[data_start:]
    limit = size_bytes + 1  # one more, to notice that there is more
    plain: bytes
    try:
        if compression == b"lz4":
            plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit)
        elif compression == b"zstd" and zstandard.get_frame_parameters(data).content_size == size_bytes:
            plain = _LOCAL.decompressor.decompress(data)  # at once, as the data state the expected size
        elif compression == b"zstd":
            with _LOCAL.decompressor.stream_reader(data) as reader:
                plain = reader.read(limit)
        else:
            plain = bytes(data)
    except _FORMAT_ERRORS as error:
        raise RecordError("a chunk that cannot be decompressed") from error
    if len(plain) != size_bytes:
        raise RecordError("a chunk of another size than it says")
    require_checksum(zlib.crc32(plain), crc, "a chunk")
    return mcap.Chunk("", plain, end_ns, start_ns, crc, size_bytes)


def _parse_chunk_index(content: bytes) -> mcap.ChunkIndex:
    """By hand, as there are as many as chunks; without where the messages' indexes are, which nobody asks."""
    try:
        start_ns, end_ns, place, length, places = _CHUNK_INDEX.unpack_from(content)
        (indexes,) = _UINT64.unpack_from(content, _CHUNK_INDEX.size + places)
        (name_length,) = _NAME_LENGTH.unpack_from(content, _CHUNK_INDEX.size + places + _UINT64.size)
        name = content[-2 * _UINT64.size - name_length : -2 * _UINT64.size]
        sizes = _SIZES.unpack_from(content, len(content) - _SIZES.size)
    except struct.error as error:
        raise RecordError("a record whose fields do not fit it") from error
    expected = _CHUNK_INDEX.size + places + _UINT64.size + _NAME_LENGTH.size + name_length + _SIZES.size
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


def require_checksum(checksum: int, expected: int, name: str) -> None:
    """Raise :class:`RecordError` unless a checksum is the one that a record names, or it names none."""
    if expected not in (0, checksum):  # 0 means that the writer made none
        raise RecordError(f"the checksum of {name} is wrong")


@dataclass(frozen=True, slots=True)
class Intact:
    """A record and the bytes it takes, or the indexes of messages that follow each other.

    ``record`` is None for magic bytes and for what :func:`parse_record` has no use for; of that, what an
    application put there is ``private``.
    """

    start: int
    end: int
    record: mcap.McapRecord | None
    private: bool = False


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that hold no intact record, and why the first of them do not.

    ``chunks`` counts the chunks that begin in them, ``messages`` says whether messages may have been there, and
    ``cut`` that the file merely ends too early.
    """

    start: int
    end: int
    reason: str
    chunks: int
    messages: bool
    cut: bool


def scan_records(stream: BinaryIO) -> Iterator[Intact | Damage]:
    """All of a file in its order, without a hole: the end of each is the start of the next.

    Raises :class:`InputError` when the disk does not give it, and for more unpacked bytes than the file's budget.
    """
    records = _Records(stream)
    offset = 0
    while offset < records.size_bytes:
        extent: Intact | Damage
        try:
            try:
                extent = records.read_record_at(offset)
            except RecordError as error:
                extent = records.find_damage_at(offset, str(error))
        except OSError as error:
            name, fix = str(getattr(stream, "name", "")), "copy it to a sound disk first"
            raise InputError("cannot be read", where=name, why=error.strerror or str(error), fix=fix) from error
        yield extent
        offset = extent.end


class _Records:
    """Access to the records of a file, and what the way through it has taught so far."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.size_bytes = stream.seek(0, os.SEEK_END)
        self._checksum: int | None = 0  # of this section's bytes so far; unknown behind damage
        self._block, self._block_start = b"", 0  # what was read last, more than was asked for
        self._chunked = False  # a chunk was met, intact or not
        self._is_ours = False  # the recorder, or a recovery, wrote it
        self._amid_damage = False  # no chunk has been found intact since the last damage
        self._false_alarms = 0
        self._search_budget_bytes = 8 * self.size_bytes + LARGEST_BYTES
        self._meter = process.Meter(str(getattr(stream, "name", "")), self.size_bytes)

    def read_record_at(self, offset: int) -> Intact:
        """The record that begins where the one before it ended. Raises :class:`RecordError` if none does."""
        head = self._peek(offset, HEAD.size)
        if head.startswith(MCAP_MAGIC):
            self._checksum = zlib.crc32(MCAP_MAGIC)
            return Intact(offset, offset + len(MCAP_MAGIC), None)
        if offset == 0:  # the magic bytes are gone, so what is here must prove itself
            self._check_candidate(0)
        if (end := self._end_of_indexes(offset)) > offset:
            self._add_to_data_checksum(self._peek(offset, end - offset))
            return Intact(offset, end, None)
        opcode, end = self._check_head(offset, head)
        content = self._read_content(offset, end)
        record = self._parse_in_context(opcode, content, end)
        if opcode not in _GUARDED and not self._seems_record(end) and self._find_next_intact(offset + 1)[0] < end:
            raise RecordError("a record of which bytes are missing")  # what it says is its end is in another
        self._add_to_index_counts(record, head, content)
        return Intact(offset, end, record, is_private_opcode(opcode))

    def find_damage_at(self, start: int, reason: str) -> Damage:
        """What lies from ``start`` to the next record that is intact, or to the end of the file."""
        head = self._peek(start, HEAD.size)
        chunks = int(head[0] == Opcode.CHUNK or self._seems_chunk(start))
        self._checksum = None
        self._chunked |= chunks > 0
        self._amid_damage = True
        claimed_end = end = _record_end_by_head(start, head)
        measured = end is not None and end <= self.size_bytes and self._is_followed_by_record(end)
        if measured and head[0] != Opcode.ATTACHMENT:  # which may hold a recording; else bytes are missing
            measured = self._find_next_intact(start + 1, only_chunks=True)[0] >= (end or 0)
        if end is not None and self._ends_within_magic(end):
            end = self.size_bytes
        elif end is None or not measured:
            end, damaged = self._find_next_intact(start + 1)
            chunks += damaged
        unfinished = len(head) < HEAD.size or claimed_end is not None or not any(head)
        cut = end == self.size_bytes and start > 0 and unfinished
        return Damage(start, end, reason, chunks, chunks > 0 or not measured or head[0] == Opcode.MESSAGE, cut)

    def _end_of_indexes(self, offset: int) -> int:
        """Where the indexes of messages end that begin here, for there is one for each topic in a chunk.

        The last of them is left out where no record seems to follow: it is to be looked at by itself.
        """
        block, start = self._block, offset - self._block_start
        before = place = start
        while place + _INDEX_HEAD.size <= len(block):
            opcode, length, _, entries = _INDEX_HEAD.unpack_from(block, place)
            end = place + HEAD.size + length
            if opcode != Opcode.MESSAGE_INDEX or entries + _INDEX_FIXED_BYTES != length or end > len(block):
                break
            before, place = place, end
        return offset + (place if self._seems_record(offset + place - start) else before) - start

    def _check_head(self, offset: int, head: bytes) -> tuple[int, int]:
        """The opcode and the end of a record, of which nothing was read but its head."""
        if len(head) < HEAD.size:
            raise RecordError("the file ends within a record")
        opcode, length = HEAD.unpack(head)
        if not is_known_opcode(opcode):
            raise RecordError("no known kind of record")
        if length > LARGEST_BYTES:
            raise RecordError(f"a record of more than {LARGEST_BYTES // 2**20} MiB")
        if offset + HEAD.size + length > self.size_bytes:
            raise RecordError("the file ends within a record")
        if opcode == Opcode.CHUNK:
            check_chunk_head(self._peek(offset + HEAD.size, CHUNK_HEAD_BYTES), length)
        return opcode, offset + HEAD.size + length

    def _parse_in_context(self, opcode: int, content: bytes, end: int) -> mcap.McapRecord | None:
        """The record, if its surroundings make it one: not every kind has a checksum or a length of its own.

        After damage in a file of chunks no message outside a chunk counts: it is more likely out of the damaged
        chunk, and nothing vouches for it. In a file of our own writing there is none, nor a private record, nor an
        attachment without a checksum: what looks so is a record of another kind with a flipped bit.
        """
        if self._is_ours and (opcode == Opcode.MESSAGE or is_private_opcode(opcode)):
            raise RecordError("a record that the recorder does not write")
        if opcode == Opcode.MESSAGE and self._chunked and self._amid_damage:
            raise RecordError("a message without a checksum amid damage")
        if (opcode == Opcode.MESSAGE or is_private_opcode(opcode)) and not self._is_followed_by_record(end):
            raise RecordError("a record that nothing follows")
        if opcode == Opcode.FOOTER and self._peek(end, len(MCAP_MAGIC)) != MCAP_MAGIC:
            raise RecordError("no magic bytes at the end")
        record = parse_record(opcode, content)
        if self._is_ours and isinstance(record, mcap.Attachment):
            checksum = int.from_bytes(content[-_CHECKSUM_BYTES:], "little")
            require_checksum(checksum, zlib.crc32(content[:-_CHECKSUM_BYTES]), "an attachment")
        return record

    def _add_to_index_counts(self, record: mcap.McapRecord | None, head: bytes, content: bytes) -> None:
        if isinstance(record, mcap.Header):
            self._is_ours = record.library.startswith(trial.SOFTWARE)
        if isinstance(record, mcap.Chunk):
            self._meter.add(process.EXPANDED_BYTES, len(record.data))
            self._chunked, self._amid_damage = True, False
        if isinstance(record, mcap.DataEnd):
            if self._checksum is not None:
                require_checksum(self._checksum, record.data_section_crc, "the whole data")
            self._checksum = 0  # of the summary, which begins here
            return
        if isinstance(record, mcap.Footer) and self._checksum is not None:
            checksum = zlib.crc32(content[:-_CHECKSUM_BYTES], zlib.crc32(head, self._checksum))
            require_checksum(checksum, record.summary_crc, "the summary")
        self._add_to_data_checksum(head, content)

    def _add_to_data_checksum(self, *pieces: bytes) -> None:
        if self._checksum is not None:
            for piece in pieces:
                self._checksum = zlib.crc32(piece, self._checksum)

    def _peek(self, offset: int, length: int) -> bytes:
        start = offset - self._block_start
        if not 0 <= start <= start + length <= len(self._block):
            self._stream.seek(offset)
            self._block = self._stream.read(min(max(length, _BLOCK_BYTES), max(self.size_bytes - offset, 0)))
            self._block_start, start = offset, 0
        return self._block[start : start + length]

    def _read_content(self, offset: int, end: int) -> bytes:
        content = self._peek(offset + HEAD.size, end - offset - HEAD.size)
        if offset + HEAD.size + len(content) < end:
            raise RecordError("the file ends within a record")  # it was shortened under our hands
        return content

    def _seems_chunk(self, offset: int) -> bool:
        """Whether a chunk begins here, were its opcode and the rest of it intact."""
        start = self._peek(offset, HEAD.size + CHUNK_HEAD_BYTES).ljust(HEAD.size, b"\0")
        try:
            check_chunk_head(start[HEAD.size :], HEAD.unpack_from(start)[1])
        except RecordError:
            return False
        return True

    def _seems_record(self, offset: int) -> bool:
        """Whether the head of a record and what else can be told at a glance is there, and room for the whole."""
        head = self._peek(offset, _INDEX_HEAD.size)
        end = _record_end_by_head(offset, head[: HEAD.size])
        if end is None or end > self.size_bytes or len(head) < _INDEX_HEAD.size:
            return False
        if head[0] == Opcode.MESSAGE_INDEX:
            _, length, _, entries = _INDEX_HEAD.unpack(head)
            return bool(entries + _INDEX_FIXED_BYTES == length)
        return not is_private_opcode(head[0]) and (head[0] != Opcode.CHUNK or self._seems_chunk(offset))

    def _is_followed_by_record(self, offset: int) -> bool:
        """Whether the file ends here or something begins that looks like a record."""
        head = self._peek(offset, HEAD.size)
        return not head or head.startswith(MCAP_MAGIC) or _record_end_by_head(offset, head) is not None

    def _ends_within_magic(self, offset: int) -> bool:
        """Whether all that is left of the file from here on is the beginning of its last bytes."""
        remaining = self.size_bytes - offset
        return 0 < remaining < len(MCAP_MAGIC) and self._peek(offset, remaining) == MCAP_MAGIC[:remaining]

    def _find_next_intact(self, start: int, *, only_chunks: bool = False) -> tuple[int, int]:
        """Where the next intact record begins, or the end of the file; and the damaged chunks on the way."""
        chunks = 0
        for candidate in self._candidates(start, only_chunks):
            if self._search_budget_bytes < 0:
                break
            try:
                self._check_candidate(candidate)
            except RecordError:
                is_chunk = self._peek(candidate, 1)[0] == Opcode.CHUNK
                chunks += is_chunk and self._seems_chunk(candidate)
            else:
                return candidate, chunks
        return self.size_bytes, chunks

    def _check_candidate(self, offset: int) -> None:
        """Raise :class:`RecordError` unless a record begins here, where none needs to.

        Only a checksum is believed, or the record that follows. Garbage can name any number of long records, and
        to read them all would take for ever, so there is a budget.
        """
        opcode, end = self._check_head(offset, self._peek(offset, HEAD.size))
        if opcode not in (Opcode.CHUNK, Opcode.FOOTER) and not self._is_followed_by_record(end):
            raise RecordError("a record that nothing follows")
        self._search_budget_bytes -= end - offset
        self._parse_in_context(opcode, self._read_content(offset, end), end)

    def _candidates(self, start: int, only_chunks: bool) -> Iterator[int]:
        """Every place from ``start`` on where a record may begin.

        There are hardly any in noise, and any number in a table of small integers: after too many false alarms only
        chunks are looked for, of which there is more to recognise.
        """
        span_bytes = _FIRST_SEARCHED_BYTES  # damage is mostly short, and there may be much of it
        while start < self.size_bytes:
            block = self._peek(start, span_bytes + _OVERLAP_BYTES)
            place = -1
            while match := self._candidate_pattern(only_chunks).search(block, place + 1):
                place = match.start()
                if place >= span_bytes:
                    break
                yield start + place
                self._false_alarms += 1
            start += span_bytes
            span_bytes = min(2 * span_bytes, _SEARCHED_BYTES)

    def _candidate_pattern(self, only_chunks: bool) -> re.Pattern[bytes]:
        return _CHUNK_PATTERN if only_chunks or self._false_alarms >= _MOST_FALSE_ALARMS else _RECORD_PATTERN


def _record_end_by_head(offset: int, head: bytes) -> int | None:
    """Where a record ends by its own word; None if this is no head of a record. The file may end within it."""
    opcode, length = HEAD.unpack(head.ljust(HEAD.size, b"\0"))
    return offset + HEAD.size + length if is_known_opcode(opcode) and length <= LARGEST_BYTES else None
