"""Reading a recording, closed or not: messages in file order, channels as arrays.

Reading streams through the file and never trusts an index: a recording that was cut off is read as far as it
goes and says so (``closed`` is False).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from numpy.typing import NDArray

from acquisition.errors import InputError
from acquisition.recording.schemas import CHANNEL_PREFIX, EVENT_TOPIC, RAW_PREFIX
from acquisition.trial import Trial

_FORMAT_ERRORS = (
    McapError, CRCValidationError, ValueError, OverflowError, struct.error, zstandard.ZstdError,
)  # fmt: skip
MCAP_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_RECORD_BYTES = 512 * 1024 * 1024  # a length beyond this is damage, not data


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
    source_index: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Recording:
    """What one file holds. ``raw`` counts the undecoded messages by topic, ``events`` are (time, text)."""

    path: Path
    trial: Trial
    series: dict[str, Series]
    raw: dict[str, int]
    events: list[tuple[int, str]]
    messages: int
    closed: bool
    start_ns: int
    end_ns: int


@dataclass(frozen=True, slots=True)
class Entry:
    """One message: its topic, its two times [ns] and its undecoded JSON."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(slots=True)
class MessageStream:
    """All messages of a file in file order; iterate once, then ask ``closed``, ``trial``, ``configuration``.

    Raises :class:`InputError` for what is no recording or is damaged in the middle.
    """

    path: Path
    closed: bool = False
    trial: Trial = field(default_factory=Trial)
    configuration: str = ""

    def __iter__(self) -> Iterator[Entry]:
        topics: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Message):
                if record.channel_id not in topics:
                    raise InputError("is damaged: a message of no topic", where=str(self.path))
                yield Entry(topics[record.channel_id], record.log_time, record.publish_time, record.data)
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Metadata) and record.name == "trial":
                self.trial = self._trial_of(record.metadata)
            elif isinstance(record, Attachment) and record.name == "configuration.toml":
                self.configuration = record.data.decode("utf-8", "replace")
            elif isinstance(record, Footer):
                self.closed = True

    def _trial_of(self, metadata: dict[str, str]) -> Trial:
        try:
            return Trial.from_metadata(metadata)
        except ValueError as error:  # metadata have no checksum of their own
            raise InputError("is damaged: its run sheet", where=str(self.path), why=str(error)) from error

    def _records(self) -> Iterator[Any]:
        """Records until the end or the cut; what breaks the format before the end is an InputError."""
        with _opened(self.path) as stream:
            reader = StreamReader(stream, validate_crcs=True, record_size_limit=_LARGEST_RECORD_BYTES)
            try:
                yield from reader.records
            except _FORMAT_ERRORS as error:
                self.closed = False
                position = stream.tell()
                if stream.read(1):  # more follows, so the file was not merely cut off
                    raise InputError(
                        f"is damaged near byte {position}",
                        where=str(self.path),
                        why=str(error),
                        fix="give an intact copy of it",
                    ) from error


def _opened(path: Path) -> Any:
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
    if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        stream.close()
        raise InputError(
            "is not an MCAP recording",
            where=str(path),
            fix="give a .mcap file, or turn a table into one with `seatrial import`",
        )
    stream.seek(0)
    return stream


class _SeriesBuilder:
    """Collects one channel's samples; lists grow faster than arrays."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, float, int, int]] = []
        self.sources: dict[str, int] = {}

    def add(self, entry: Entry) -> None:
        body = orjson.loads(entry.data)
        source = self.sources.setdefault(body["source"], len(self.sources))
        self.rows.append((entry.publish_ns, entry.log_ns, float(body["value"]), int(body["quality"]), source))

    def series(self) -> Series:
        measured, received, value, quality, source = zip(*self.rows, strict=True)
        return Series(
            np.array(measured, np.int64),
            np.array(received, np.int64),
            np.array(value, np.float64),
            np.array(quality, np.uint8),
            tuple(self.sources),
            np.array(source, np.int64),
        )


def _add_sample(builders: dict[str, _SeriesBuilder], entry: Entry, path: Path) -> None:
    name = entry.topic.removeprefix(CHANNEL_PREFIX)
    try:
        builders.setdefault(name, _SeriesBuilder()).add(entry)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"topic {entry.topic} holds a message that is no sample of ours",
            where=str(path),
            why=f"{type(error).__name__} {error}",
            fix="give a recording made by seatrial",
        ) from error


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
            events.append((entry.log_ns, orjson.loads(entry.data)["message"]))
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
    )
