"""Saves what is intact of a damaged recording, of any maker, into a new and properly closed one.

The file is read twice: once for the definitions of topics, which may stand behind the messages that need them,
once for the messages. The copy gets its name only when it has been read back and holds all of them. In the same
way a recording whose messages are JSON becomes one whose messages are protobuf; everything else is copied as it is:
other programs' messages, metadata, attachments, times and numbers of messages.
"""

from __future__ import annotations

import os
import struct
from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from seatrial.acquisition.core import errors, files, process, ship, trial
from seatrial.acquisition.recording import batches, messages, reader, scan

_KEY = struct.Struct("<QQQQ")
_CHUNK_BYTES = 1024 * 1024
_MESSAGE_HEAD_BYTES = scan.HEAD.size + 22

Definition = TypeVar("Definition", mcap.Channel, mcap.Schema)


@dataclass(slots=True)
class Definitions:
    """Channels and schemas by their number. Those out of a chunk have its checksum and go before the others.

    ``chunk_starts`` is where chunks begin by the word of the index, used for nothing but to count the lost ones.
    """

    header: mcap.Header = field(default_factory=lambda: mcap.Header("", ""))
    vouched: dict[tuple[type, int], mcap.Channel | mcap.Schema] = field(default_factory=dict)
    unvouched: dict[tuple[type, int], mcap.Channel | mcap.Schema] = field(default_factory=dict)
    chunk_starts: array[int] = field(default_factory=lambda: array("Q"))

    def find(self, kind: type[Definition], number: int) -> Definition | None:
        """The channel or schema of this number."""
        definition = self.vouched.get((kind, number)) or self.unvouched.get((kind, number))
        return definition if isinstance(definition, kind) else None


def collect_definitions(stream: BinaryIO, path: Path, progress: errors.Progress) -> Definitions:
    """All definitions of a file, the first that was given to each number.

    Raises :class:`InputError` for more of them than there can be.
    """
    definitions, meter = Definitions(), process.Meter(path, os.fstat(stream.fileno()).st_size)
    for extent in _scan_with_progress(stream, progress):
        if not isinstance(extent, scan.Intact):
            continue
        if isinstance(extent.record, mcap.Header):
            definitions.header = extent.record
        if isinstance(extent.record, mcap.Metadata | mcap.Attachment):
            reader.count_description(extent.record, meter)
        if isinstance(extent.record, mcap.ChunkIndex):
            definitions.chunk_starts.append(extent.record.chunk_start_offset)
        by_number = definitions.vouched if isinstance(extent.record, mcap.Chunk) else definitions.unvouched
        items = batches.batch_chunks(extent.record) if isinstance(extent.record, mcap.Chunk) else [extent.record]
        with suppress(scan.RecordError):  # counted when the messages are copied
            for item in items:
                if isinstance(item, batches.Batch | mcap.Message):
                    meter.add(process.MESSAGES, len(item) if isinstance(item, batches.Batch) else 1)
                if not isinstance(item, mcap.Channel | mcap.Schema):
                    continue
                definition = by_number.get((type(item), item.id))
                reader.count_definition(item, meter, is_new=definition != item)
                by_number.setdefault((type(item), item.id), item)
    definitions.chunk_starts = array("Q", sorted(definitions.chunk_starts))
    return definitions


def _scan_with_progress(stream: BinaryIO, progress: errors.Progress) -> Iterator[scan.Intact | scan.Damage]:
    """As :func:`scan_records.scan`; ``progress`` takes the share done."""
    size_bytes = stream.seek(0, os.SEEK_END)
    shown = 0
    for extent in scan.scan_records(stream):
        yield extent
        if extent.end - shown > size_bytes // 100:
            shown = extent.end
            progress(shown / size_bytes)


class Digest:
    """A running hash of messages in their order: topics, times and data."""

    def __init__(self) -> None:
        self.messages = 0
        self._hash = blake2b()

    def add_message(self, topic: str, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take the next message."""
        name = topic.encode()
        self.messages += 1
        self._hash.update(_KEY.pack(log_ns, publish_ns, len(name), len(data)))
        self._hash.update(name)
        self._hash.update(data)

    @property
    def count_and_hash(self) -> tuple[int, bytes]:
        """How many there were, and the hash."""
        return self.messages, self._hash.digest()


def verify_copy(partial: Path, target: Path, saved: Digest) -> None:
    """Read a file back, as we would and as any other program would.

    Raises :class:`StorageError`, about the name that it is to get, if it does not hold what was saved.
    """
    stream_digest, index_digest = Digest(), Digest()
    try:
        written = reader.MessageStream(partial)
        for entry in written:
            stream_digest.add_message(entry.topic, entry.log_ns, entry.publish_ns, entry.data)
        with partial.open("rb") as stream:
            for topic, message in _read_by_index(stream):
                index_digest.add_message(topic, message.log_time, message.publish_time, message.data)
    except (errors.InputError, McapError, ValueError, KeyError, struct.error) as error:
        raise _mismatch_error(target, str(error)) from error
    if (
        not written.closed
        or not stream_digest.count_and_hash == index_digest.count_and_hash == saved.count_and_hash
    ):
        raise _mismatch_error(
            target, f"{stream_digest.messages:,} and {index_digest.messages:,} messages of {saved.messages:,}"
        )


def _read_by_index(stream: BinaryIO) -> Iterator[tuple[str, mcap.Message]]:
    """Topics and messages in file order, found by the library through the file's index.

    The library's own ``iter_messages`` in file order would first hold all of them.
    """
    summary = make_reader(stream, validate_crcs=True).get_summary()
    if summary is None:
        raise ValueError("it has no summary")
    for index in summary.chunk_indexes:
        stream.seek(index.chunk_start_offset + scan.HEAD.size)
        for record in breakup_chunk(mcap.Chunk.read(ReadDataStream(stream)), validate_crc=True):
            if isinstance(record, mcap.Message):
                yield summary.channels[record.channel_id].topic, record


def _mismatch_error(target: Path, reason: str) -> errors.StorageError:
    return errors.StorageError(
        "does not read back as it was written", where=str(target), why=reason, fix="try another disk"
    )


@dataclass(slots=True)
class RecoverySummary:
    """What was saved and what was not.

    ``lost_bytes`` and ``damaged_chunks`` count in the source; ``refused`` counts the lost stretches and messages by
    reason; ``gaps`` are the times [ns] before and after damage that may have held messages; ``closed`` says
    whether the source was.
    """

    counts: Counter[str] = field(default_factory=Counter)
    metadata: int = 0
    attachments: int = 0
    lost_bytes: int = 0
    damaged_chunks: int = 0
    recovered_until_ns: int | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)
    closed: bool = False

    @property
    def saved_messages(self) -> int:
        """How many messages were saved."""
        return self.counts.total()

    @property
    def reasons_text(self) -> str:
        """The most frequent reasons of a loss."""
        return ", ".join(f"{reason} ({count:,})" for reason, count in self.refused.most_common(3))

    def count_lost(self, reason: str, size_bytes: int, chunks: int = 0) -> None:
        """Count what cannot be saved."""
        self.refused[reason] += 1
        self.lost_bytes += size_bytes
        self.damaged_chunks += chunks

    def as_json(self) -> dict[str, Any]:
        """The contract's JSON object, and more."""
        until_ns = self.recovered_until_ns
        return {
            "recovered": self.saved_messages,
            "lost_bytes": self.lost_bytes,
            "damaged_chunks": self.damaged_chunks,
            "recovered_until": None if until_ns is None else trial.iso_utc(until_ns),
            "gaps": [{"start": trial.iso_utc(start), "length_s": (end - start) / 1e9} for start, end in self.gaps],
            "topics": dict(sorted(self.counts.items())),
            "reasons": dict(self.refused),
            "closed": self.closed,
        }

    def __str__(self) -> str:
        until = "" if self.recovered_until_ns is None else f" up to {trial.iso_utc(self.recovered_until_ns)}"
        saved = f"saved {self.saved_messages:,} messages{until}"
        ended = "" if self.closed else "; the recording had not been closed"
        if not self.refused:
            return f"{saved}{ended}; nothing was lost"
        chunks = f" with {self.damaged_chunks} chunks" if self.damaged_chunks != 1 else " with 1 chunk"
        gaps = "".join(
            f"; a gap of {(end - start) / 1e9:.3f} s from {trial.iso_utc(start)}" for start, end in self.gaps[:5]
        )
        further = f"; {len(self.gaps) - 5} more gaps" if len(self.gaps) > 5 else ""
        return f"{saved}{ended}. Lost {self.lost_bytes:,} bytes{chunks}: {self.reasons_text}{gaps}{further}"


class Saving:
    """Copies records into a new file and counts what was found, saved and lost."""

    def __init__(self, writer: Writer, definitions: Definitions) -> None:
        self.summary = RecoverySummary()
        self.digest = Digest()
        self.writer = writer
        self.definitions = definitions
        self._channels: dict[tuple[Any, ...], int] = {}
        self._schemas: dict[tuple[Any, ...], int] = {}
        self._topics: dict[int, tuple[int, str]] = {}  # by the number that the source gives
        self._last_ns: int | None = None
        self._after_damage = False
        for record in list(definitions.vouched.values()):  # a topic without a message is to be kept too
            if isinstance(record, mcap.Channel):
                self.define_topic(record)

    def define_topic(self, channel: mcap.Channel) -> None:
        """Define a topic in the copy."""
        self._copy_channel(channel.id)

    def copy_or_count_lost(self, extent: scan.Intact | scan.Damage) -> None:
        """Copy a record, or count what was lost."""
        size_bytes = extent.end - extent.start
        if isinstance(extent, scan.Damage):
            starts = self.definitions.chunk_starts
            indexed = bisect_left(starts, extent.end) - bisect_left(starts, extent.start)
            self.summary.count_lost(extent.reason, size_bytes, max(extent.chunks, indexed))
            self._after_damage |= extent.messages
        elif extent.private:
            self.summary.count_lost("a private record of another program", size_bytes)
        elif isinstance(extent.record, mcap.Chunk):
            self._copy_chunk(extent.record, size_bytes)
        elif isinstance(extent.record, mcap.Message):
            self.copy_message(extent.record)
        elif isinstance(extent.record, mcap.Metadata):
            name, texts = extent.record.name, extent.record.metadata
            try:
                plain = scan.remove_metadata_checksum(extent.record)
                if name == "trial":
                    trial.Trial.from_metadata(plain)
            except ValueError:  # it would keep the copy from being read; under another name it is not lost
                name = f"{name} (damaged)"
                texts = scan.add_metadata_checksum(name, texts)
                self.summary.count_lost(f"metadata, kept as {name!r}", 0)
            self.writer.add_metadata(name, texts)
            self.summary.metadata += 1
        elif isinstance(extent.record, mcap.Attachment):
            attachment = extent.record
            self.writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )
            self.summary.attachments += 1
        elif isinstance(extent.record, mcap.Footer):
            self.summary.closed = True

    def _copy_chunk(self, chunk: mcap.Chunk, size_bytes: int) -> None:
        try:
            for record in batches.batch_chunks(chunk):
                if isinstance(record, batches.Batch):
                    for message in record.iterate_messages():
                        self.copy_message(message)
                elif isinstance(record, mcap.Channel | mcap.Schema):
                    key = (type(record), record.id)
                    if self.definitions.vouched.get(key) != record:  # two files made into one use numbers twice
                        self.definitions.vouched[key] = record
                        self._topics.clear()
        except scan.RecordError as error:
            self.summary.count_lost(str(error), size_bytes, chunks=1)
            self._after_damage = True

    def copy_message(self, message: mcap.Message) -> None:
        """Copy a message as it is."""
        channel = self._topics.get(message.channel_id) or self._copy_channel(message.channel_id)
        if channel is None:
            self.summary.count_lost("a message of no known topic", _MESSAGE_HEAD_BYTES + len(message.data))
            return
        self.write_message(message, *channel)

    def write_message(self, message: mcap.Message, number: int, topic: str) -> None:
        """Write a message on a channel of the copy."""
        log_ns = message.log_time
        self.writer.add_message(number, log_ns, message.data, message.publish_time, message.sequence)
        self.digest.add_message(topic, log_ns, message.publish_time, message.data)
        self.summary.counts[topic] += 1
        if self._last_ns is None or log_ns > self._last_ns:
            if self._after_damage and self._last_ns is not None:
                self.summary.gaps.append((self._last_ns, log_ns))
            self._last_ns = self.summary.recovered_until_ns = log_ns
        self._after_damage = False

    def _copy_channel(self, number: int) -> tuple[int, str] | None:
        """The copy's number of a channel, and its topic."""
        channel = self.definitions.find(mcap.Channel, number)
        if channel is None:
            return None
        schema, schema_number = self.definitions.find(mcap.Schema, channel.schema_id), 0  # MCAP's word for none
        if schema is not None:
            content = schema.name, schema.encoding, schema.data
            if (schema.id, *content) not in self._schemas:
                self._schemas[schema.id, *content] = self.writer.register_schema(*content)
            schema_number = self._schemas[schema.id, *content]
        key = (number, channel.topic, channel.message_encoding, schema_number, *chain(*channel.metadata.items()))
        if key not in self._channels:
            self._channels[key] = self.writer.register_channel(
                channel.topic, channel.message_encoding, schema_number, channel.metadata
            )
        self._topics[number] = self._channels[key], channel.topic
        return self._topics[number]

    def check_copy(self, source: Path) -> None:
        """Raise :class:`InputError` where the copy is of no use."""
        summary = self.summary
        if not (summary.saved_messages or summary.metadata or summary.attachments):
            what, fix = "contains nothing that can be saved", "give another copy of it"
            raise errors.InputError(what, where=str(source), why=summary.reasons_text, fix=fix)


Copy = TypeVar("Copy", bound=Saving)


def recover(source: Path, target: Path, progress: errors.Progress = lambda share: None) -> RecoverySummary:
    """Copy every intact message, metadata record and attachment of ``source`` into the new file ``target``.

    ``progress`` takes the share done. Raises :class:`InputError` when nothing can be saved, :class:`StorageError`
    when ``target`` exists or cannot be written, or does not read back as what was saved. ``source`` is only read.
    """
    return copy_intact_records(source, target, Saving, progress).summary


def copy_intact_records(
    source: Path, target: Path, make_copy: Callable[[Writer, Definitions], Copy], progress: errors.Progress
) -> Copy:
    """Pass all that is in a file to what ``make_copy`` makes, which may refuse the result before it has a name.

    Raises :class:`InputError`, and :class:`StorageError` when ``target`` exists or cannot be written, or does not
    read back as what was saved.
    """
    files.require_suffix(target, ".mcap")
    with reader.open_recording(source, accept_any=True) as stream:
        if os.path.lexists(target):
            is_source = target.exists() and target.samefile(source)
            what = "is the recording that is to be saved" if is_source else "already exists"
            raise errors.StorageError(what, where=str(target), fix="name a new file")
        definitions = collect_definitions(stream, source, lambda share: progress(0.3 * share))
        with files.atomic_file(target) as partial:
            with partial.open("wb") as file:
                zstd = CompressionType.ZSTD
                writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=zstd, enable_data_crcs=True)
                writer.start(profile=definitions.header.profile, library=trial.software_version())
                saved = make_copy(writer, definitions)
                for extent in _scan_with_progress(stream, lambda share: progress(0.3 + 0.5 * share)):
                    saved.copy_or_count_lost(extent)
                writer.finish()  # type: ignore[no-untyped-call]
                file.flush()
                os.fsync(file.fileno())
            saved.check_copy(source)
            verify_copy(partial, target, saved.digest)
    progress(1.0)
    return saved


class Migration(Saving):
    """Copies records, our messages in JSON as protobuf: ``converted`` counts them by topic.

    ``unconverted`` are those that fit no schema of today; they stay JSON, and are read as such.
    """

    def __init__(self, writer: Writer, definitions: Definitions, channels: Mapping[str, ship.Channel]) -> None:
        self.converted: Counter[str] = Counter()
        self.unconverted: Counter[str] = Counter()
        self._trial_channels = channels
        self._numbers: dict[str, int] = {}
        self._kinds: dict[str, int] = {}
        super().__init__(writer, definitions)

    def define_topic(self, channel: mcap.Channel) -> None:
        if not self._define_converted_topic(channel):
            super().define_topic(channel)

    def copy_message(self, message: mcap.Message) -> None:
        channel = self.definitions.find(mcap.Channel, message.channel_id)
        number = None if channel is None else self._define_converted_topic(channel)
        if channel is None or number is None:
            super().copy_message(message)
            return
        try:
            body = messages.decode(messages.Topic(channel.topic, messages.ENCODING_BEFORE), message.data)
            data = messages.encode(channel.topic, body)
        except (KeyError, TypeError, ValueError, OverflowError):
            self.unconverted[channel.topic] += 1
            super().copy_message(message)
        else:
            self.converted[channel.topic] += 1
            self.write_message(replace(message, data=data), number, channel.topic)

    def _define_converted_topic(self, channel: mcap.Channel) -> int | None:
        """The copy's number of one of our topics in JSON; None for any other channel."""
        topic = channel.topic
        if channel.message_encoding != messages.ENCODING_BEFORE:
            return None
        if topic not in self._numbers:
            try:
                kind, metadata = (
                    messages.message_kind_of_topic(topic),
                    messages.channel_metadata(topic, self._trial_channels),
                )
            except (KeyError, IndexError):
                return None
            if kind.title not in self._kinds:
                schema = kind.title, messages.ENCODING, kind.descriptors
                self._kinds[kind.title] = self.writer.register_schema(*schema)
            number = self.writer.register_channel(topic, messages.ENCODING, self._kinds[kind.title], metadata)
            self._numbers[topic] = number
        return self._numbers[topic]

    def check_copy(self, source: Path) -> None:
        if self.summary.damaged_chunks or self.summary.lost_bytes:
            fix = f"first {reader.REMEDY}"
            raise errors.InputError("is damaged", where=str(source), why=self.summary.reasons_text, fix=fix)
        if not self.converted:
            why = f"{self.summary.saved_messages:,} messages, none of ours in JSON"
            raise errors.InputError("has nothing to migrate", where=str(source), why=why, fix="use it as it is")


def migrate(source: Path, target: Path, progress: errors.Progress = lambda share: None) -> Migration:
    """Write the recording ``source`` again as ``target``, with messages as they are recorded today.

    ``progress`` takes the share done. Raises :class:`InputError` for a damaged recording and for one that has no
    messages in JSON, :class:`StorageError` when ``target`` exists, cannot be written, or does not read back as it
    was written. ``source`` is only read.
    """
    channels = ship.channels_by_name_of(reader.read_trial(source))
    return copy_intact_records(
        source, target, lambda writer, definitions: Migration(writer, definitions, channels), progress
    )
