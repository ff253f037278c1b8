"""Reads a recording, closed, cut off or still being written: messages in file order, channels as arrays.

Reading streams through the file and never trusts an index: a recording that was cut off is read as far as it goes
and says so (``closed`` is False). Of a growing file (:class:`Tail`), to which the recorder hands complete chunks
five times a second, the end may be half a record, which is complete the next time; the recorder need not know of
it.

Files are grouped into recordings, the times of their parts moved onto one clock, and their events listed. A
recorder whose computer's clock is set continues in a new part, by the new time. Its parts state how far UTC is from
the monotonic clock, which nobody sets. Where they were recorded in one boot, and also state how long the computer
has slept, during which the monotonic clock stands still, the times on both sides of the step are those of one
recording, moved onto one clock. Where they do not state it, each side of a step is a recording of its own.
"""

from __future__ import annotations

import os
import re
import stat
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode

from seatrial.acquisition.core import process, quantities, stores
from seatrial.acquisition.core.errors import RECORD_A_LOG, InputError, escape_control_characters
from seatrial.acquisition.core.files import CLOSED_IN_CHILDREN, read_at
from seatrial.acquisition.core.trial import Frame, Trial, iso_utc
from seatrial.acquisition.recording import messages, scan
from seatrial.acquisition.recording.batches import Batch, SeriesBuilder, add_samples, batch_chunks

_ENOUGH_BYTES = 4 * 1024 * 1024  # of chunks unpacked together: many small ones cost no more than a large one
REMEDY = "save what is intact with `seatrial recover`"
_BLOCK_BYTES = 1024 * 1024
_SPAN = struct.Struct("<QQ")  # what a chunk begins with: the times of its first and last message
_SKIPPED = (Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT)


@dataclass(frozen=True, slots=True)
class Recording:
    """What one file holds; no terminal obeys anything in its texts.

    ``raw`` counts the undecoded messages by topic, ``events`` are (time, text). ``metadata`` is what the file says
    besides the trial: which part of a recording it is, whose clock it has. ``health`` is the last word on each
    source: its state, its frames, how many were refused, why, and dropped. ``predictions`` counts what another
    program foretold beside the recorder. ``later_parts`` are the files after the first of one in parts.
    ``clock`` says what is to be known of the times of one in parts: that the clock was set meanwhile.
    ``event_labels`` are the name and the level of each event, as the recorder gave them.
    """

    path: Path
    trial: Trial
    series: dict[str, quantities.Series]
    raw: dict[str, int]
    events: list[tuple[int, str]]
    messages: int
    closed: bool
    start_ns: int
    end_ns: int
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    health: dict[str, dict[str, Any]] = field(default_factory=dict)
    predictions: int = 0
    later_parts: tuple[Path, ...] = ()
    clock: str = ""
    event_labels: list[tuple[str, str]] = field(default_factory=list)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that it was read from."""
        return (self.path, *self.later_parts)

    @property
    def is_foreign(self) -> bool:
        """Whether it has messages but none of ours: another program's log in the same container."""
        return self.messages > 0 and not (self.series or self.raw or self.events or self.health or self.predictions)


class MessageEntry(NamedTuple):
    """One message: its topic, its two times [ns], its undecoded data, and what the file says of its topic."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes
    described: messages.Topic

    def decode_body(self) -> dict[str, Any]:
        """What a message on a topic of ours says. Raises ValueError if it is none, KeyError for another topic."""
        return messages.decode(self.described, self.data)

    def decode_frame(self) -> Frame:
        """The frame in a message of raw input. Raises ValueError, KeyError or TypeError if it is none of ours."""
        return messages.decode_frame(self.described, self.data, self.log_ns, self.publish_ns)


@dataclass(slots=True)
class MessageStream:
    """All messages of a file in file order; iterate once, then ask ``closed``, ``trial``, ``metadata`` and so on.

    Raises :class:`InputError` for what is no recording or is damaged in the middle.
    """

    path: Path
    closed: bool = False
    trial: Trial = field(default_factory=Trial)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    topics: dict[int, messages.Topic] = field(default_factory=dict)
    meter: process.Meter = field(init=False)

    def __post_init__(self) -> None:
        self.meter = process.Meter(self.path, 0)

    def __iter__(self) -> Iterator[MessageEntry]:
        for batch in self.batches():
            for (number, _, log_ns, publish_ns, *_), data in zip(
                batch.heads.tolist(), batch.message_payloads(), strict=True
            ):
                topic = self.topics[number]
                yield MessageEntry(topic.name, log_ns, publish_ns, data, topic)

    def batches(self) -> Iterator[Batch]:
        """The same messages, those that follow each other in a chunk together."""
        self.topics.clear()
        schemas: dict[int, bytes] = {}
        stated_count: int | None = None
        count = 0
        for record in self._records():
            if isinstance(record, Batch):
                self.meter.add(process.MESSAGES, len(record))
                if not self.topics.keys() >= record.counts_by_channel().keys():
                    raise self._damage_error("a message of no topic")
                count += len(record)
                yield record
            elif isinstance(record, mcap.Schema):
                count_definition(record, self.meter, is_new=record.id not in schemas)
                if schemas.setdefault(record.id, record.data) != record.data:
                    raise self._damage_error("two schemas of one number")
            elif isinstance(record, mcap.Channel):
                count_definition(record, self.meter, is_new=record.id not in self.topics)
                topic = messages.Topic(record.topic, record.message_encoding, schemas.get(record.schema_id, b""))
                if self.topics.setdefault(record.id, topic) != topic:
                    raise self._damage_error("two topics of one number")
            elif isinstance(record, mcap.Statistics):
                stated_count = record.message_count
            else:
                self._count_record(record)
        if self.closed and stated_count not in (None, count):  # a chunk can vanish without another trace
            raise self._damage_error(f"{count:,} messages of {stated_count:,}")

    def run_sheets(self) -> Iterator[Trial]:
        """What the file says of its trial, one word after the other."""
        for record in self._records():
            if isinstance(record, mcap.Metadata) and record.name == "trial":
                self._count_record(record)
                yield self.trial

    def _count_record(self, record: mcap.McapRecord) -> None:
        if isinstance(record, mcap.Metadata):
            count_description(record, self.meter)
            try:
                metadata = escape_control_characters(scan.remove_metadata_checksum(record))
                if record.name == "trial":
                    self.trial = Trial.from_metadata(metadata)
                else:
                    self.metadata[record.name] = metadata
            except ValueError as error:  # metadata of earlier recordings have no checksum
                raise self._damage_error(
                    f"its metadata {escape_control_characters(record.name)!r}: {error}"
                ) from error
        elif isinstance(record, mcap.Attachment):
            count_description(record, self.meter)
            self.attachments[record.name] = record.data
        elif isinstance(record, mcap.Footer):
            self.closed = True

    def _records(self) -> Iterator[Batch | mcap.McapRecord]:
        """Records, messages in batches, until the end or the cut; damage before the end is an InputError."""
        chunks: list[tuple[int, mcap.Chunk]] = []
        size_bytes = 0
        with open_recording(self.path) as stream:
            self.meter = process.Meter(self.path, os.fstat(stream.fileno()).st_size)
            for extent in scan.scan_records(stream):
                if isinstance(extent, scan.Intact) and isinstance(extent.record, mcap.Chunk):
                    chunks.append((extent.start, extent.record))
                    size_bytes += len(extent.record.data)
                    if size_bytes < _ENOUGH_BYTES:
                        continue
                if isinstance(extent, scan.Intact) and extent.record is None:
                    continue
                yield from self._unpack_chunks(chunks)
                chunks.clear()
                size_bytes = 0
                if isinstance(extent, scan.Damage):
                    self.closed = False
                    if not extent.cut:
                        raise self._damage_error(extent.reason, f" near byte {extent.start}")
                elif isinstance(extent.record, mcap.Message):
                    yield Batch.of_message(extent.record)
                elif extent.record is not None and not isinstance(extent.record, mcap.Chunk):
                    yield extent.record
            yield from self._unpack_chunks(chunks)

    def _unpack_chunks(self, chunks: list[tuple[int, mcap.Chunk]]) -> Iterator[Batch | mcap.McapRecord]:
        """What is in chunks one after the other, with the places in the file at which they begin."""
        try:
            yield from batch_chunks(*(chunk for _, chunk in chunks))
        except scan.RecordError as error:
            raise self._damage_error(str(error), f" near byte {chunks[error.chunk][0]}") from error

    def _damage_error(self, reason: str, place: str = "") -> InputError:
        return InputError(f"is damaged{place}", where=str(self.path), why=reason, fix=REMEDY)


def count_definition(record: mcap.Channel | mcap.Schema, meter: process.Meter, *, is_new: bool) -> None:
    """Count what a file defines; what was defined before takes no more memory. Raises :class:`InputError`."""
    if isinstance(record, mcap.Channel):
        name, size = record.topic, len(str(record.metadata))
    else:
        name, size = record.name, len(record.data)
    meter.add(process.DEFINITIONS, 1)
    meter.check(process.NAME_BYTES, len(name))
    meter.add(process.DESCRIPTION_BYTES, len(name) + size if is_new else 0)


def count_description(record: mcap.Metadata | mcap.Attachment, meter: process.Meter) -> None:
    """Count what a file says besides its messages. Raises :class:`InputError` beyond a budget."""
    names, texts = [record.name], list[str]()
    if isinstance(record, mcap.Metadata):
        names, texts = [record.name, *record.metadata], list(record.metadata.values())
    meter.check(process.NAME_BYTES, max(map(len, names)))
    meter.check(process.TEXT_BYTES, max(map(len, texts), default=0))
    size = len(record.data) if isinstance(record, mcap.Attachment) else sum(map(len, names + texts))
    meter.add(process.DESCRIPTION_BYTES, size)


def open_recording(path: Path, *, accept_any: bool = False) -> BinaryIO:
    """A file to read, at its beginning. Raises :class:`InputError` if it cannot be a recording.

    ``accept_any`` admits files that do not begin as a recording: their beginning may be what is damaged.
    """
    if recording_size(path) == 0:
        raise InputError("is empty", where=str(path), fix="give a recording with data")
    try:
        stream = path.open("rb")
    except OSError as error:
        raise InputError("cannot be opened", where=str(path), why=str(error.strerror)) from error
    if not accept_any and stream.read(len(scan.MCAP_MAGIC)) != scan.MCAP_MAGIC:
        stream.close()
        fix = f"give a .mcap file, or convert a table or log with `seatrial import`; {RECORD_A_LOG}"
        raise InputError("is not an MCAP recording", where=str(path), fix=fix)
    return stream


def recording_size(path: Path) -> int:
    """The size of a file [bytes]. Raises :class:`InputError` for what is none: a pipe may never come to an end."""
    name = str(path)
    if stores.is_remote(path):
        raise InputError(
            "is in an object store", where=stores.place_name(path), why="here only files of this computer are read",
            fix="download it first",
        )  # fmt: skip
    try:
        state = path.stat()
        if stat.S_ISDIR(state.st_mode):
            os.scandir(path).close()  # one that is closed to us says so
    except FileNotFoundError as error:
        reason = "it is a link to nothing" if path.is_symlink() else ""
        raise InputError("does not exist", where=name, why=reason, fix=stores.unknown_place_fix(path)) from error
    except OSError as error:
        raise InputError("cannot be opened", where=name, why=error.strerror or str(error)) from error
    if stat.S_ISDIR(state.st_mode):
        raise InputError(
            "is a folder, not a recording", where=name, fix="name a .mcap file in it, or import a bag first"
        )
    if not stat.S_ISREG(state.st_mode):
        raise InputError("is not a file", where=name, fix="give a recording, not a pipe, socket or device")
    return state.st_size


def _foreign_message_error(path: Path, topic: str, error: Exception, kind: str) -> InputError:
    return InputError(
        f"topic {topic} holds a message that is no {kind} of ours",
        where=str(path),
        why=f"{type(error).__name__} {error}",
        fix="give a recording made by seatrial",
    )


def _bodies_with_key_values(
    batch: Batch, topic: messages.Topic, meter: process.Meter, key: str, kind: str
) -> list[tuple[str, dict[str, Any]]]:
    """The bodies of a batch's messages, all of one topic, each behind its value of a key."""
    sizes = batch.data_sizes
    meter.check(process.TEXT_BYTES, int(sizes.max()))
    meter.add(process.DESCRIPTION_BYTES, int(sizes.sum()))
    try:
        return [
            (str(body[key]), body) for body in (messages.decode(topic, data) for data in batch.message_payloads())
        ]
    except (KeyError, ValueError) as error:
        raise _foreign_message_error(Path(meter.path), topic.name, error, kind) from error


def _add_samples(
    samples: dict[str, SeriesBuilder], batch: Batch, topics: Mapping[int, messages.Topic], meter: process.Meter
) -> None:
    """As :func:`add_samples`; if it fails, topic by topic, to report which holds what is no sample."""
    if batch.data_sizes.max() > process.NAME_BYTES.least:
        channels = batch.select_channels(
            number for number in batch.counts_by_channel() if topics[number].is_channel
        )
        meter.check(process.NAME_BYTES, int(channels.data_sizes.max(initial=0)))
    for number, error in _refused_channels(samples, batch, topics):
        raise _foreign_message_error(Path(meter.path), topics[number].name, error, "sample") from error


def _refused_channels(
    samples: dict[str, SeriesBuilder], batch: Batch, topics: Mapping[int, messages.Topic]
) -> Iterator[tuple[int, Exception]]:
    """Add the samples of a batch, where that fails of each channel by itself: those of which it fails, and why."""
    refused = KeyError, TypeError, ValueError, OverflowError
    with suppress(*refused):
        return add_samples(samples, batch, topics)
    for number in batch.counts_by_channel():
        try:
            add_samples(samples, batch.select_channels([number]), topics)
        except refused as error:
            yield number, error
    return None


@dataclass(slots=True)
class RecordingBuilder:
    """What the messages of a recording hold, batch by batch; raw messages as counts."""

    samples: dict[str, SeriesBuilder] = field(default_factory=dict)
    raw: Counter[str] = field(default_factory=Counter)
    events: list[tuple[int, str]] = field(default_factory=list)
    labels: list[tuple[str, str]] = field(default_factory=list)
    health: dict[str, dict[str, Any]] = field(default_factory=dict)
    start_ns: int = 2**63 - 1
    end_ns: int = 0
    count: int = 0
    predictions: int = 0

    def add(self, batch: Batch, topics: Mapping[int, messages.Topic], meter: process.Meter) -> None:
        """Take in messages. Raises :class:`InputError` for one that is none of ours, and beyond a budget."""
        self.count += len(batch)
        log_ns = batch.heads["log_ns"]
        self.start_ns, self.end_ns = min(self.start_ns, int(log_ns.min())), max(self.end_ns, int(log_ns.max()))
        _add_samples(self.samples, batch, topics, meter)
        for number, size in batch.counts_by_channel().items():
            topic = topics[number]
            if topic.name.startswith(messages.RAW_PREFIX):
                self.raw[topic.name] += size
            elif topic.name == messages.EVENT_TOPIC:
                part = batch.select_channels([number])
                entries = _bodies_with_key_values(part, topic, meter, "message", "event")
                self.events += zip(part.heads["log_ns"].tolist(), [text for text, _ in entries], strict=True)
                self.labels += [
                    (str(body.get("name", "")), messages.level_name(body.get("level"))) for _, body in entries
                ]
            elif topic.name == messages.HEALTH_TOPIC:
                part = batch.select_channels([number])
                self.health |= _bodies_with_key_values(part, topic, meter, "source", "state of a source")
            elif topic.name == messages.PREDICTION_TOPIC:
                self.predictions += size

    def build(self, path: Path, trial: Trial, metadata: dict[str, dict[str, str]], *, closed: bool) -> Recording:
        """The recording of these messages; nothing can be added any more."""
        return Recording(
            path=path,
            trial=trial,
            series={
                escape_control_characters(topic.removeprefix(messages.CHANNEL_PREFIX)): builder.build()
                for topic, builder in self.samples.items()
            },
            raw=escape_control_characters(dict(self.raw)),
            events=escape_control_characters(self.events),
            messages=self.count,
            closed=closed,
            start_ns=self.start_ns if self.count else 0,
            end_ns=self.end_ns,
            metadata=metadata,
            health=escape_control_characters(self.health),
            predictions=self.predictions,
            event_labels=escape_control_characters(self.labels),
        )


def read_recording(path: Path | str) -> Recording:
    """Everything that a recording holds, the raw messages as counts.

    Raises :class:`InputError` when the file is missing, empty, not MCAP, or damaged in the middle.
    """
    stream, builder = MessageStream(Path(path)), RecordingBuilder()
    for batch in stream.batches():
        builder.add(batch, stream.topics, stream.meter)
    return builder.build(stream.path, stream.trial, stream.metadata, closed=stream.closed)


def read_trial(path: Path | str) -> Trial:
    """The run sheet that a recording begins with, before any fix could become the origin; empty without one.

    Errors as :func:`read_recording`, of what precedes it.
    """
    return next(MessageStream(Path(path)).run_sheets(), Trial())


def describe_recording(recording: Recording) -> dict[str, Any]:
    """Channels with counts, rates, span, sources and longest gap; raw counts; whether it was closed."""
    return {
        "closed": recording.closed,
        "messages": recording.messages,
        "start": iso_utc(recording.start_ns),
        "end": iso_utc(recording.end_ns),
        "duration_s": (recording.end_ns - recording.start_ns) / 1e9,
        "channels": {name: _describe_series(series) for name, series in sorted(recording.series.items())},
        "raw": recording.raw,
        "trial": recording.trial.as_metadata(),
        **({"clock": recording.clock} if recording.clock else {}),
    }


def _describe_series(series: quantities.Series) -> dict[str, Any]:
    times = np.sort(series.measured_ns)
    span_s = float(times[-1] - times[0]) / 1e9
    return {
        "count": int(times.size),
        "rate_hz": (times.size - 1) / span_s if span_s > 0 else 0.0,
        "first": iso_utc(int(times[0])),
        "last": iso_utc(int(times[-1])),
        "sources": sorted(series.sources),
        "longest_gap_s": float(np.diff(times).max()) / 1e9 if times.size > 1 else 0.0,
    }


@dataclass(frozen=True, slots=True)
class _Place:
    """A whole record: where it begins, its kind, where it ends, and of a chunk when its first and its last message
    came [ns]."""

    start: int
    opcode: int
    end: int
    from_ns: int = 0
    until_ns: int = 0


class Tail:
    """The samples of a growing file; a context manager. Raises :class:`InputError` if the file cannot be opened.

    With ``recent_s`` what is older than that is skipped, as far as it was not read in time: a reader that starts
    late or was held up need not read for hours. ``ended`` says that the recorder has closed the file, ``cut`` that
    the file has become shorter than what was read: the recorder gave it up, and repeats part of it in the next.
    ``damaged`` counts chunks that could not be read.
    """

    def __init__(self, path: Path, recent_s: float | None = None) -> None:
        self.path = path
        self.trial = Trial()
        self.metadata: dict[str, dict[str, str]] = {}
        self.ended = self.cut = False
        self.damaged = 0
        self._recent_ns = None if recent_s is None else round(recent_s * 1e9)
        self._topics: dict[int, messages.Topic] = {}
        self._schemas: dict[int, bytes] = {}
        self._offset = len(scan.MCAP_MAGIC)
        self._chunks: list[_Place] = []
        self._meter = process.Meter(path, 0)
        self._unreadable_at = -1  # where a record was met that could not be read, the last time
        try:
            self._descriptor = os.open(path, os.O_RDONLY | CLOSED_IN_CHILDREN)
        except OSError as error:
            raise InputError("cannot be opened", where=str(path), why=error.strerror or str(error)) from error

    def __enter__(self) -> Tail:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def read_new_samples(self) -> dict[str, quantities.Series]:
        """The samples that have come since the last time, by channel, each in the order of reception.

        Raises :class:`InputError` where the file holds what is no record, or more than its budget.
        """
        size = os.fstat(self._descriptor).st_size
        self.cut = self.cut or size < self._offset != len(scan.MCAP_MAGIC)  # until there the file has only begun
        if self.cut:
            return {}
        self._meter.record_file_growth(size)
        samples: dict[str, SeriesBuilder] = {}
        places, end = self._complete_records(size)
        newest_ns = max((place.until_ns for place in places), default=0)
        oldest_ns = 0 if self._recent_ns is None else newest_ns - self._recent_ns
        wanted = [place for place in places if place.opcode != Opcode.CHUNK or place.until_ns >= oldest_ns]
        last = wanted.pop() if wanted and wanted[-1].end == end else None
        self._take_in_records(wanted, samples)
        is_whole = last is None or self._take_in_record(last, samples, is_last=True)
        self._offset = end if is_whole or last is None else last.start
        return _build_series(samples)

    def read_samples_of_span(self, start_ns: int, end_ns: int) -> dict[str, quantities.Series]:
        """The samples of the chunks with messages that were received in a time, whatever has been read before.

        The way through the file is made once: after that the span alone is read. Errors as
        :meth:`read_new_samples`.
        """
        samples: dict[str, SeriesBuilder] = {}
        if not self._chunks:
            size = os.fstat(self._descriptor).st_size
            self._meter.record_file_growth(size)
            places, _ = self._complete_records(size)
            self._chunks = [place for place in places if place.opcode == Opcode.CHUNK]
            self._take_in_records([place for place in places if place.opcode != Opcode.CHUNK], samples)
        inside = [chunk for chunk in self._chunks if chunk.until_ns >= start_ns and chunk.from_ns <= end_ns]
        self._take_in_records(inside, samples)
        return _build_series(samples)

    def _complete_records(self, size: int) -> tuple[list[_Place], int]:
        """All whole records from where the last reading ended but indexes and attachments, and where they end.

        A day has two million records, nearly all of them indexes: the file is read in blocks, as a call to the
        system for each record takes eight times as long.
        """
        places, start, block, block_start = list[_Place](), self._offset, b"", self._offset
        while start + scan.HEAD.size <= size:
            if start - block_start + scan.HEAD.size + _SPAN.size > len(block):
                block, block_start = read_at(self._descriptor, _BLOCK_BYTES, start), start
            if block.startswith(scan.MCAP_MAGIC, start - block_start):
                break
            opcode, length = scan.HEAD.unpack_from(block, start - block_start)
            if not scan.is_known_opcode(opcode) or length > scan.LARGEST_BYTES:
                raise InputError(
                    f"is damaged near byte {start}", where=str(self.path), why="no record begins there"
                )
            end, is_chunk = start + scan.HEAD.size + length, opcode == Opcode.CHUNK
            if end > size or (is_chunk and length < _SPAN.size):
                break
            if opcode not in _SKIPPED:
                span_ns = _SPAN.unpack_from(block, start - block_start + scan.HEAD.size) if is_chunk else (0, 0)
                places.append(_Place(start, opcode, end, *span_ns))
            start = end
        return places, start

    def _take_in_record(self, place: _Place, samples: dict[str, SeriesBuilder], *, is_last: bool) -> bool:
        """Take in a record; False if it cannot be read and may be whole the next time."""
        content = self._content(place)
        try:
            record = scan.parse_record(place.opcode, content)
            self._meter.add(process.EXPANDED_BYTES, len(record.data) if isinstance(record, mcap.Chunk) else 0)
            for item in batch_chunks(record) if isinstance(record, mcap.Chunk) else [record]:
                self._note(item, samples)
        except InputError:  # more than its budget
            raise
        except (scan.RecordError, KeyError, TypeError, ValueError, OverflowError):
            if is_last and self._unreadable_at != place.start:
                self._unreadable_at = place.start
                return False
            self.damaged += 1
        return True

    def _take_in_records(self, places: Sequence[_Place], samples: dict[str, SeriesBuilder]) -> None:
        """Take in records, chunks that follow each other together: there are five a second."""
        chunks, size_bytes = list[_Place](), 0
        for place in places:
            if place.opcode == Opcode.CHUNK:
                chunks.append(place)
                size_bytes += place.end - place.start
                if size_bytes < _BLOCK_BYTES:
                    continue
            self._take_in_chunks(chunks, samples)
            chunks, size_bytes = [], 0
            if place.opcode != Opcode.CHUNK:
                self._take_in_record(place, samples, is_last=False)
        self._take_in_chunks(chunks, samples)

    def _take_in_chunks(self, places: Sequence[_Place], samples: dict[str, SeriesBuilder]) -> None:
        """Take in chunks at once; those that cannot be read are counted."""
        chunks = list[mcap.Chunk]()
        for place in places:
            try:
                chunks.append(cast(mcap.Chunk, scan.parse_record(place.opcode, self._content(place))))
            except scan.RecordError:
                self.damaged += 1
        self._meter.add(process.EXPANDED_BYTES, sum(len(chunk.data) for chunk in chunks))
        while chunks:
            unreadable = len(chunks)
            try:
                for item in batch_chunks(*chunks):
                    self._note(item, samples)
            except scan.RecordError as error:
                self.damaged, unreadable = self.damaged + 1, error.chunk
            chunks = chunks[unreadable + 1 :]

    def _content(self, place: _Place) -> bytes:
        begin = place.start + scan.HEAD.size
        return read_at(self._descriptor, place.end - begin, begin)

    def _note(self, record: Batch | mcap.McapRecord | None, samples: dict[str, SeriesBuilder]) -> None:
        if isinstance(record, Batch):
            self._meter.add(process.MESSAGES, len(record))
            self.damaged += sum(1 for _ in _refused_channels(samples, record, self._topics))
        elif isinstance(record, mcap.Schema):
            self._schemas[record.id] = record.data
        elif isinstance(record, mcap.Channel):
            self._topics[record.id] = messages.Topic(
                record.topic, record.message_encoding, self._schemas.get(record.schema_id, b"")
            )
        elif isinstance(record, mcap.Metadata) and record.name == "trial":
            self.trial = Trial.from_metadata(scan.remove_metadata_checksum(record))
        elif isinstance(record, mcap.Metadata):
            self.metadata[record.name] = scan.remove_metadata_checksum(record)
        elif isinstance(record, mcap.Footer):
            self.ended = True


def _build_series(samples: Mapping[str, SeriesBuilder]) -> dict[str, quantities.Series]:
    return {topic.removeprefix(messages.CHANNEL_PREFIX): builder.build() for topic, builder in samples.items()}


NEW_PART_NS = 1_000_000_000
"""A clock that is set by so much is another clock; what is less is followed slowly."""
_TIME = r"\d{8}T\d{6}Z"
_RECORDER_NAME = re.compile(rf".*_{_TIME}.*\.mcap")
_LATER_PART = re.compile(rf"(.*_{_TIME})_part\d+(?:_\d+)?")
_HEAD_BYTES = 64 * 1024  # hold them, unless the DBC files are large
_MOST_RECORDS = 100  # before the first message: header, run sheet, configuration with its DBC files, part, clock
_MOST_NS = 2**61  # 73 years: two such numbers and a time still fit into 64 bits
Metadata = Mapping[str, Mapping[str, str]]
Files = Path | str | Sequence[Path | str]
"""A recording: its file, or those of its parts."""
KINDS = ("mark", "alarm", "source", "recorder")
_ALARM = re.compile(r"ALARM |alarm over: |alarm ")
_WORD = re.compile(r"[^\s':,;]+")


@dataclass(frozen=True, slots=True)
class PartClock:
    """The clock of a part: UTC less the monotonic clock [ns], the boot, how long the computer had slept [ns].

    ``is_synchronised`` says that NTP or PTP kept it when the part began; None and "" stand for what is not stated.
    """

    offset_ns: int | None = None
    boot: str = ""
    slept_ns: int | None = None
    is_synchronised: bool = False

    @classmethod
    def from_metadata(cls, metadata: Metadata) -> PartClock:
        """The clock that a part states."""
        texts = metadata.get("clock", {})
        numbers: dict[str, int] = {}
        for key in ("utc_minus_monotonic_ns", "slept_ns"):
            with suppress(ValueError):
                number = int(texts.get(key, ""))
                if abs(number) < _MOST_NS:
                    numbers[key] = number
        is_synchronised = texts.get("host_clock", "").startswith("kept")
        boot = texts.get("boot", "")
        return cls(numbers.get("utc_minus_monotonic_ns"), boot, numbers.get("slept_ns"), is_synchronised)

    def differs_by_step_from(self, before: PartClock) -> bool:
        """Whether it differs from an earlier part's clock by a step, as far as both state it."""
        if self.offset_ns is None or before.offset_ns is None:
            return False
        return abs(self.offset_ns - before.offset_ns) >= NEW_PART_NS

    def ahead_of_ns(self, before: PartClock) -> int | None:
        """By how much it is ahead of an earlier one, the time slept left out [ns]; None where that is not sure."""
        numbers = self.offset_ns, before.offset_ns, self.slept_ns, before.slept_ns
        if None in numbers or not self.boot or self.boot != before.boot:
            return None
        offset_ns, earlier_offset_ns, slept_ns, earlier_slept_ns = (number or 0 for number in numbers)
        return offset_ns - slept_ns - earlier_offset_ns + earlier_slept_ns


def parts_by_recording(paths: Iterable[Path]) -> list[tuple[Path, ...]]:
    """Recordings as their files, in the order of ``paths``: the parts of one recording together, in their order.

    A part belongs to the one that it states it follows, else to the one that its name states; not where the clock
    was set between them by an unknown time.
    """
    paths = list(paths)
    by_place = {(path.parent, path.name): path for path in paths}
    recordings: dict[Path, list[Path]] = {}
    beginnings: dict[Path, Path] = {}  # the part that a part's recording begins with
    by_stem: dict[Path, Path] = {}
    for path in _order_by_predecessor(paths, by_place):
        match = _LATER_PART.fullmatch(path.stem)
        stem = path.parent / (match[1] if match else path.stem)
        previous = by_place.get((path.parent, _preceding_part(path)), by_stem.get(stem) if match else None)
        beginning = path
        candidate = beginnings.get(previous) if previous is not None else None
        if previous and candidate and recordings[candidate][-1] == previous:  # no other part follows it already
            before, clock = (
                PartClock.from_metadata(head_metadata(previous)),
                PartClock.from_metadata(head_metadata(path)),
            )
            if not clock.differs_by_step_from(before) or clock.ahead_of_ns(before) is not None:  # alignable
                beginning = candidate
        recordings.setdefault(beginning, []).append(path)
        beginnings[path], by_stem[stem] = beginning, path
    order = {path: number for number, path in enumerate(paths)}
    return [tuple(recordings[beginning]) for beginning in sorted(recordings, key=order.__getitem__)]


def _order_by_predecessor(paths: Sequence[Path], by_place: Mapping[tuple[Path, str], Path]) -> Iterator[Path]:
    """The paths in their order, but each after the one that it follows; in a circle each once."""
    visited: set[Path] = set()
    for path in paths:
        chain = []
        while path is not None and path not in visited:
            visited.add(path)
            chain.append(path)
            path = by_place.get((path.parent, _preceding_part(path)))  # type: ignore[assignment]
        yield from reversed(chain)


def _preceding_part(path: Path) -> str:
    return head_metadata(path).get("part", {}).get("follows", "")


def parts_before(path: Path) -> Iterator[Path]:
    """The parts of a recording before the one at a path, the last of them first, as far as they are there, and
    their clock was not set."""
    passed = {path}
    while name := _preceding_part(path):
        clock, path = PartClock.from_metadata(head_metadata(path)), path.with_name(name)
        earlier = head_metadata(path)
        if path in passed or not earlier or clock.differs_by_step_from(PartClock.from_metadata(earlier)):
            return
        passed.add(path)
        yield path


def head_metadata(path: Path) -> Metadata:
    """What a file states of its part and clock; empty for a name that no recorder gives, and for no recording."""
    if not _RECORDER_NAME.fullmatch(path.name):
        return {}
    if stores.is_remote(path):
        with suppress(InputError):  # what refuses its beginning refuses the rest, too, and is reported then
            remote = stores.RemoteFile(path)
            beginning = BytesIO(remote.read(_HEAD_BYTES))
            return _metadata_before_messages(beginning) or _metadata_before_messages(cast(BinaryIO, remote)) or {}
        return {}
    try:
        state = path.stat()
        return _read_head_metadata(path, (state.st_ino, state.st_mtime_ns))
    except OSError:
        return {}


@lru_cache(maxsize=100_000)
def _read_head_metadata(path: Path, _: tuple[int, int]) -> Metadata:
    """The metadata before the first message of a file in a state, of which only the beginning is read."""
    with suppress(InputError), open_recording(path) as stream:
        return _metadata_before_messages(stream, accept_cut=True) or {}
    return {}


def _metadata_before_messages(stream: BinaryIO, *, accept_cut: bool = False) -> Metadata | None:
    """The metadata before the first message; None where the stream ends before, unless that is accepted."""
    metadata: dict[str, dict[str, str]] = {}
    for number, entry in enumerate(scan.scan_records(stream)):
        if isinstance(entry, scan.Damage):
            return metadata if accept_cut or not entry.cut else None
        if isinstance(entry.record, mcap.Chunk | mcap.Message):
            break
        if isinstance(entry.record, mcap.Metadata):
            metadata[entry.record.name] = escape_control_characters(entry.record.metadata)
        if number > _MOST_RECORDS or {"part", "clock"} <= metadata.keys():
            break
    return metadata


def read_recordings(paths: Iterable[Path]) -> Iterator[Recording]:
    """The recordings in some files, in turn, each with its parts. Raises as :func:`read_parts_of_recording`."""
    return map(read_parts_of_recording, parts_by_recording(paths))


def read_as_one_recording(files: Files) -> Recording:
    """The recording in a file, or in parts in any order.

    Raises :class:`InputError` for files that are not of one recording, and as :func:`read_parts_of_recording`.
    """
    paths = [Path(files)] if isinstance(files, Path | str) else sorted(map(Path, files))
    recordings = parts_by_recording(paths)
    if len(recordings) != 1:
        for path in paths:
            recording_size(path)  # one that is not there is the reason
        raise InputError(
            "are not the parts of one recording", where=", ".join(path.name for path in paths),
            why="they do not follow each other, or the clock was set between them by an unknown time",
            fix="give one recording at a time",
        )  # fmt: skip
    return read_parts_of_recording(recordings[0])


def read_parts_of_recording(paths: Sequence[Path]) -> Recording:
    """One recording in parts, the files in their order: samples one after the other, run sheet of the last.

    Where the clock was set between parts, their times are moved onto one clock: of those that were kept by NTP or
    PTP the last, else the last. Raises as :func:`read_recording`.
    """
    parts, remark = _align_clocks([read_recording(path) for path in paths])
    samples: dict[str, list[quantities.Series]] = {}
    for part in parts:
        for name, series in part.series.items():
            samples.setdefault(name, []).append(series)
    beginning = parts[0]
    spans = [part for part in parts if part.messages] or parts
    return replace(
        parts[-1], path=beginning.path, later_parts=tuple(paths[1:]), metadata=beginning.metadata,
        series={name: quantities.Series.concatenate(pieces) for name, pieces in samples.items()},
        raw=dict(sum((Counter(part.raw) for part in parts), Counter())),
        events=[event for part in parts for event in part.events],
        event_labels=[label for part in parts for label in part.event_labels],
        messages=sum(part.messages for part in parts), predictions=sum(part.predictions for part in parts),
        closed=all(part.closed for part in parts),
        start_ns=min(part.start_ns for part in spans), end_ns=max(part.end_ns for part in spans),
        clock=remark,
    )  # fmt: skip


def _align_clocks(parts: Sequence[Recording]) -> tuple[list[Recording], str]:
    """The parts with their times by one clock, and a remark on a missing beginning and on moved times."""
    clocks = [PartClock.from_metadata(part.metadata) for part in parts]
    synchronised = [clock for clock in clocks if clock.is_synchronised]
    ahead_ns = [(synchronised or clocks)[-1].ahead_of_ns(clock) or 0 for clock in clocks]
    moves_ns = [ahead if abs(ahead) >= NEW_PART_NS else 0 for ahead in ahead_ns]
    aligned = [_shift_clock(part, by_ns) if by_ns else part for part, by_ns in zip(parts, moves_ns, strict=True)]
    remarks, part = [], parts[0].metadata.get("part", {})
    moves = Counter(by_ns for by_ns in moves_ns if by_ns)
    if part.get("follows"):
        number, reason = part.get("number"), part.get("reason")
        remarks.append(f"it begins with part {number}, which follows {part['follows']}: {reason}")
    if moves:
        texts = [f"of {count} of its {len(parts)} parts by {by_ns / 1e9:+,.3f} s" for by_ns, count in moves.items()]
        remarks.append(
            f"the computer's clock was set meanwhile: times are moved, {', '.join(texts)}, by its monotonic clock"
        )
    return aligned, "; ".join(remarks)


def _shift_clock(part: Recording, by_ns: int) -> Recording:
    """A part whose times by the computer's clock are moved; those by another clock, as of a satellite, stay."""

    def move(series: quantities.Series) -> quantities.Series:
        measured_ns, received_ns = series.measured_ns, series.received_ns + by_ns
        # a measurement nearer to the reception by the new clock is not of the old one
        is_old = np.abs(measured_ns - series.received_ns) <= np.abs(measured_ns - received_ns)
        moved_ns = np.asarray(np.where(is_old, measured_ns + by_ns, measured_ns))
        return replace(series, received_ns=received_ns, measured_ns=moved_ns)

    return replace(
        part,
        series={name: move(series) for name, series in part.series.items()},
        events=[(time_ns + by_ns, text) for time_ns, text in part.events],
        start_ns=part.start_ns + by_ns,
        end_ns=part.end_ns + by_ns,
    )


@dataclass(frozen=True, slots=True)
class Event:
    """One event: its time [ns since 1970, UTC] by the computer's clock, its kind, one of :data:`KINDS`, its text.

    ``level`` is "info", "warning" or "error", empty where the file does not say; ``source`` is what it is about.
    """

    time_ns: int
    kind: str
    level: str
    source: str
    text: str

    def as_json(self) -> dict[str, Any]:
        """The event as an object, its time as ISO 8601."""
        return {"time": iso_utc(self.time_ns), "kind": self.kind, "level": self.level, "source": self.source,
                "text": self.text}  # fmt: skip


def events_of_recording(recording: Recording) -> list[Event]:
    """The events of a recording in the order of time; what names one of its sources is about that source.

    Files of long ago name no marks and alarms.
    """
    lines = {*recording.health, *(source.partition("/")[0] for series in recording.series.values()
                                  for source in series.sources)}  # fmt: skip
    labels = recording.event_labels or [("", "")] * len(recording.events)
    events = []
    for (time_ns, text), (name, level) in zip(recording.events, labels, strict=True):
        kind, source = "mark" if name == "mark" else "alarm", ""
        if name not in ("mark", "alarm") and not _ALARM.match(text):
            words = (word.partition("/")[0] for word in _WORD.findall(text))
            source = next((word for word in words if word in lines), "")
            kind = "source" if source else "recorder"
        events.append(Event(time_ns, kind, level, source, text))
    return sorted(events, key=lambda event: event.time_ns)


def event_counts_text(events: list[Event]) -> str:
    """How many events there are of each kind, in words; empty for none."""
    counts = Counter(event.kind for event in events)
    words = {"mark": "mark", "alarm": "alarm", "source": "event of a source", "recorder": "event of the recorder"}
    plurals = {"source": "events of sources", "recorder": "events of the recorder"}
    return ", ".join(
        f"{counts[kind]:,} {words[kind] if counts[kind] == 1 else plurals.get(kind, words[kind] + 's')}"
        for kind in KINDS if counts[kind]
    )  # fmt: skip
