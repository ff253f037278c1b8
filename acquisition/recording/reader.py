"""Reading a recording, closed or not: messages in file order, channels as arrays.

Reading streams through the file and never trusts an index: a recording that was cut off is read as far as it
goes and says so (``closed`` is False).
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import orjson
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata, Statistics
from numpy.typing import NDArray

from acquisition.errors import InputError
from acquisition.recording.records import RecordError, contents
from acquisition.recording.scan import MCAP_MAGIC, Damage, scan
from acquisition.recording.schemas import CHANNEL_PREFIX, EVENT_TOPIC, RAW_PREFIX
from acquisition.trial import Trial

REMEDY = "save what is intact with `seatrial recover`"


@dataclass(frozen=True, slots=True)
class Series:
    """The samples of one channel in the order of reception, times in ns UTC.

    ``sources`` lists the distinct sources; ``source_index`` says for each sample which of them it was.
    """

    measured_ns: NDArray[np.int64]
    received_ns: NDArray[np.int64]
    value: NDArray[np.float64]
    quality: NDArray[np.uint8]
    sources: tuple[str, ...]
    source_index: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Recording:
    """What one file holds. ``raw`` counts the undecoded messages by topic, ``events`` are (time, text).

    ``metadata`` is what the file says besides the trial: which part of a recording it is, whose clock it has.
    """

    path: Path
    trial: Trial
    series: dict[str, Series]
    raw: dict[str, int]
    events: list[tuple[int, str]]
    messages: int
    closed: bool
    start_ns: int
    end_ns: int
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


class Entry(NamedTuple):
    """One message: its topic, its two times [ns] and its undecoded data."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


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

    def __iter__(self) -> Iterator[Entry]:
        topics: dict[int, str] = {}
        promised: int | None = None
        messages = 0
        for record in self._records():
            if isinstance(record, Message):
                if record.channel_id not in topics:
                    raise self._damaged("a message of no topic")
                messages += 1
                yield Entry(topics[record.channel_id], record.log_time, record.publish_time, record.data)
            elif isinstance(record, Channel):
                if topics.setdefault(record.id, record.topic) != record.topic:
                    raise self._damaged("two topics of one number")
            elif isinstance(record, Statistics):
                promised = record.message_count
            else:
                self._note(record)
        if self.closed and promised not in (None, messages):  # a chunk can vanish without another trace
            raise self._damaged(f"{messages:,} messages of {promised:,}")

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Metadata) and record.name != "trial":
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Metadata):
            try:
                self.trial = Trial.from_metadata(record.metadata)
            except ValueError as error:  # metadata have no checksum of their own
                raise self._damaged(f"its run sheet: {error}") from error
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data
        elif isinstance(record, Footer):
            self.closed = True

    def _records(self) -> Iterator[McapRecord]:
        """Records, those in chunks too, until the end or the cut; damage before the end is an InputError."""
        with open_recording(self.path) as stream:
            for found in scan(stream):
                if isinstance(found, Damage):
                    self.closed = False
                    if not found.cut:
                        raise self._damaged(found.why, f" near byte {found.start}")
                elif isinstance(found.record, Chunk):
                    try:
                        yield from contents(found.record)
                    except RecordError as error:
                        raise self._damaged(str(error), f" near byte {found.start}") from error
                elif found.record is not None:
                    yield found.record

    def _damaged(self, why: str, where: str = "") -> InputError:
        return InputError(f"is damaged{where}", where=str(self.path), why=why, fix=REMEDY)


def open_recording(path: Path, *, whatever_it_is: bool = False) -> BinaryIO:
    """A file to read, at its beginning. Raises :class:`InputError` if it cannot be a recording.

    ``whatever_it_is`` accepts files whose beginning says that they are none: it may be what is damaged.
    """
    if not path.exists():
        raise InputError("does not exist", where=str(path), fix="check the path")
    if path.is_dir():
        raise InputError("is a folder, not a recording", where=str(path), fix="name a .mcap file in it")
    if path.stat().st_size == 0:
        raise InputError("is an empty file", where=str(path), fix="give a recording that holds data")
    try:
        stream = path.open("rb")
    except OSError as error:
        raise InputError("cannot be opened", where=str(path), why=str(error.strerror)) from error
    if not whatever_it_is and stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        stream.close()
        raise InputError(
            "is not an MCAP recording",
            where=str(path),
            fix="give a .mcap file, or turn a table into one with `seatrial import`",
        )
    return stream


class _SeriesBuilder:
    """Collects one channel's samples in 29 bytes each: a day of 13 channels has more than ten million."""

    def __init__(self) -> None:
        self.measured, self.received = array("q"), array("q")
        self.value, self.quality = array("d"), array("B")
        self.source = array("i")
        self.sources: dict[str, int] = {}

    def add(self, entry: Entry) -> None:
        body = orjson.loads(entry.data)
        value, quality = float(body["value"]), int(body["quality"])
        self.source.append(self.sources.setdefault(body["source"], len(self.sources)))
        self.measured.append(entry.publish_ns)
        self.received.append(entry.log_ns)
        self.value.append(value)
        self.quality.append(quality)

    def series(self) -> Series:
        return Series(
            np.frombuffer(self.measured, np.int64),
            np.frombuffer(self.received, np.int64),
            np.frombuffer(self.value, np.float64),
            np.frombuffer(self.quality, np.uint8),
            tuple(self.sources),
            np.frombuffer(self.source, np.int32),
        )


def _foreign(path: Path, topic: str, error: Exception, what: str) -> InputError:
    return InputError(
        f"topic {topic} holds a message that is no {what} of ours",
        where=str(path),
        why=f"{type(error).__name__} {error}",
        fix="give a recording made by seatrial",
    )


def _add_sample(builders: dict[str, _SeriesBuilder], entry: Entry, path: Path) -> None:
    name = entry.topic.removeprefix(CHANNEL_PREFIX)
    builder = builders.get(name) or builders.setdefault(name, _SeriesBuilder())
    try:
        builder.add(entry)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise _foreign(path, entry.topic, error, "sample") from error


def _event_text(entry: Entry, path: Path) -> str:
    try:
        return str(orjson.loads(entry.data)["message"])
    except (KeyError, TypeError, ValueError) as error:
        raise _foreign(path, entry.topic, error, "event") from error


def read_recording(path: Path | str) -> Recording:
    """Everything that a recording holds, the raw messages as counts.

    Raises :class:`InputError` when the file is missing, empty, not MCAP, or damaged in the middle.
    """
    stream = MessageStream(Path(path))
    builders: dict[str, _SeriesBuilder] = {}
    raw: Counter[str] = Counter()
    events: list[tuple[int, str]] = []
    start_ns, end_ns, messages = 2**63 - 1, 0, 0
    for entry in stream:
        messages += 1
        start_ns, end_ns = min(start_ns, entry.log_ns), max(end_ns, entry.log_ns)
        if entry.topic.startswith(CHANNEL_PREFIX):
            _add_sample(builders, entry, stream.path)
        elif entry.topic.startswith(RAW_PREFIX):
            raw[entry.topic] += 1
        elif entry.topic == EVENT_TOPIC:
            events.append((entry.log_ns, _event_text(entry, stream.path)))
    return Recording(
        path=stream.path,
        trial=stream.trial,
        series={name: builder.series() for name, builder in builders.items()},
        raw=dict(raw),
        events=events,
        messages=messages,
        closed=stream.closed,
        start_ns=start_ns if messages else 0,
        end_ns=end_ns,
        metadata=stream.metadata,
    )
