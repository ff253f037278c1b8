"""A recording that is still being written, read as it grows.

The recorder hands whole chunks to the system five times a second; what stands at the end of the file may be half a
record, which is whole the next time. Nothing is asked of the recorder: it need not know that anybody reads.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap import records as mcap
from mcap.opcode import Opcode

from seatrial.acquisition.core.arrays import Series
from seatrial.acquisition.core.budget import EXPANDED_BYTES, MESSAGES, Meter
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.batches import Batch, SeriesBuilder, add_samples, batches
from seatrial.acquisition.recording.messages import Topic
from seatrial.acquisition.recording.records import (
    HEAD,
    LARGEST_BYTES,
    RecordError,
    is_known,
    parse,
    without_checksum,
)
from seatrial.acquisition.recording.scan import MCAP_MAGIC
from seatrial.acquisition.recording.schemas import CHANNEL_PREFIX

_SPAN = struct.Struct("<QQ")  # what a chunk begins with: the times of its first and last message
_OF_NO_USE = (Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT)


@dataclass(frozen=True, slots=True)
class _Place:
    """A whole record: where it begins, its kind, where it ends, and of a chunk when its last message came [ns]."""

    start: int
    opcode: int
    end: int
    until_ns: int = 0


class Tail:
    """The samples of a growing file; a context manager. Raises :class:`InputError` if the file cannot be opened.

    With ``recent_s`` what is older than that is passed over, as far as it was not read in time: whoever comes late
    or was held up need not read for hours. ``ended`` says that the recorder has closed the file, ``cut`` that the
    file has become shorter than what was read: the recorder gave it up, and says part of it again in the next.
    ``damaged`` counts chunks that could not be read.
    """

    def __init__(self, path: Path, recent_s: float | None = None) -> None:
        self.path = path
        self.trial = Trial()
        self.metadata: dict[str, dict[str, str]] = {}
        self.ended = self.cut = False
        self.damaged = 0
        self._recent_ns = None if recent_s is None else round(recent_s * 1e9)
        self._topics: dict[int, Topic] = {}
        self._schemas: dict[int, bytes] = {}
        self._offset = len(MCAP_MAGIC)
        self._meter = Meter(path, 0)
        self._doubted = -1  # where a record was met that could not be read, the last time
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
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

    def read(self) -> dict[str, Series]:
        """The samples that have come since the last time, by channel, each in the order of reception.

        Raises :class:`InputError` where the file holds what is no record, or more than its budget.
        """
        size = os.fstat(self._descriptor).st_size
        self.cut = self.cut or size < self._offset != len(MCAP_MAGIC)  # until there the file has only begun
        if self.cut:
            return {}
        self._meter.grow(size)
        samples: dict[str, SeriesBuilder] = {}
        places = self._places(size)
        for place in self._wanted(places):
            if not self._take(place, samples, is_last=place is places[-1]):
                break
            self._offset = place.end
        else:
            self._offset = places[-1].end if places else self._offset
        return {topic.removeprefix(CHANNEL_PREFIX): builder.series() for topic, builder in samples.items()}

    def _places(self, size: int) -> list[_Place]:
        """All whole records from where the last reading ended."""
        places, start = [], self._offset
        while start + HEAD.size <= size:
            head = os.pread(self._descriptor, HEAD.size + _SPAN.size, start)
            if head.startswith(MCAP_MAGIC):
                break
            opcode, length = HEAD.unpack_from(head)
            if not is_known(opcode) or length > LARGEST_BYTES:
                raise InputError(
                    f"is damaged near byte {start}", where=str(self.path), why="no record begins there"
                )
            end = start + HEAD.size + length
            if end > size or len(head) < HEAD.size + (_SPAN.size if opcode == Opcode.CHUNK else 0):
                break
            until_ns = _SPAN.unpack_from(head, HEAD.size)[1] if opcode == Opcode.CHUNK else 0
            places.append(_Place(start, opcode, end, until_ns))
            start = end
        return places

    def _wanted(self, places: list[_Place]) -> Iterable[_Place]:
        """The records that say something: topics, metadata, the end, and chunks that are recent enough."""
        newest_ns = max((place.until_ns for place in places), default=0)
        oldest_ns = 0 if self._recent_ns is None else newest_ns - self._recent_ns
        for place in places:
            if place.opcode not in _OF_NO_USE and not (place.opcode == Opcode.CHUNK and place.until_ns < oldest_ns):
                yield place

    def _take(self, place: _Place, samples: dict[str, SeriesBuilder], *, is_last: bool) -> bool:
        """Take in a record; False if it cannot be read and may be whole the next time."""
        content = os.pread(self._descriptor, place.end - place.start - HEAD.size, place.start + HEAD.size)
        try:
            record = parse(place.opcode, content)
            self._meter.add(EXPANDED_BYTES, len(record.data) if isinstance(record, mcap.Chunk) else 0)
            for item in batches(record) if isinstance(record, mcap.Chunk) else [record]:
                self._note(item, samples)
        except InputError:  # more than its budget
            raise
        except (RecordError, KeyError, TypeError, ValueError, OverflowError):
            if is_last and self._doubted != place.start:
                self._doubted = place.start
                return False
            self.damaged += 1
        return True

    def _note(self, record: Batch | mcap.McapRecord | None, samples: dict[str, SeriesBuilder]) -> None:
        if isinstance(record, Batch):
            self._meter.add(MESSAGES, len(record))
            add_samples(samples, record, self._topics)
        elif isinstance(record, mcap.Schema):
            self._schemas[record.id] = record.data
        elif isinstance(record, mcap.Channel):
            self._topics[record.id] = Topic(
                record.topic, record.message_encoding, self._schemas.get(record.schema_id, b"")
            )
        elif isinstance(record, mcap.Metadata) and record.name == "trial":
            self.trial = Trial.from_metadata(without_checksum(record))
        elif isinstance(record, mcap.Metadata):
            self.metadata[record.name] = without_checksum(record)
        elif isinstance(record, mcap.Footer):
            self.ended = True
