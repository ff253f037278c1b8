"""What the topics of a file are, from wherever in it that is said: chunks, outside of chunks, or the summary."""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Chunk, ChunkIndex, Header, McapRecord, Schema

from acquisition.core.errors import InputError
from acquisition.core.progress import Progress
from acquisition.recording.records import LARGEST_BYTES, RecordError, contents
from acquisition.recording.scan import Damage, Intact, scan


@dataclass(slots=True)
class Definitions:
    """Channels and schemas by their number. Those out of a chunk have its checksum and go before the others.

    ``chunk_starts`` is where chunks begin by the word of the index, used for nothing but to count the lost ones.
    """

    header: Header = field(default_factory=lambda: Header("", ""))
    vouched: dict[tuple[type, int], Channel | Schema] = field(default_factory=dict)
    others: dict[tuple[type, int], Channel | Schema] = field(default_factory=dict)
    chunk_starts: array[int] = field(default_factory=lambda: array("Q"))

    def channel(self, number: int) -> Channel | None:
        """The channel of this number."""
        found = self._get(Channel, number)
        return found if isinstance(found, Channel) else None

    def schema(self, number: int) -> Schema | None:
        """The schema of this number."""
        found = self._get(Schema, number)
        return found if isinstance(found, Schema) else None

    def _get(self, kind: type, number: int) -> Channel | Schema | None:
        return self.vouched.get((kind, number)) or self.others.get((kind, number))


def collect_definitions(stream: BinaryIO, path: Path, progress: Progress) -> Definitions:
    """All definitions of a file, the first that was given to each number.

    Raises :class:`InputError` for more of them than there can be.
    """
    definitions, size_bytes = Definitions(), 0
    for found in scan_definitions(stream, progress):
        if not isinstance(found, Intact):
            continue
        if isinstance(found.record, Header):
            definitions.header = found.record
        if isinstance(found.record, ChunkIndex):
            definitions.chunk_starts.append(found.record.chunk_start_offset)
        known = definitions.vouched if isinstance(found.record, Chunk) else definitions.others
        for record in _definitions_in(found.record):
            first = known.setdefault((type(record), record.id), record)
            if first is record or first != record:
                size_bytes += _size_bytes(record)
        if size_bytes > LARGEST_BYTES:
            raise InputError("is damaged", where=str(path), why="it defines more topics than there can be")
    definitions.chunk_starts = array("Q", sorted(definitions.chunk_starts))
    return definitions


def _size_bytes(record: Channel | Schema) -> int:
    return len(record.data) if isinstance(record, Schema) else len(record.topic) + len(str(record.metadata))


def _definitions_in(record: McapRecord | None) -> Iterator[Channel | Schema]:
    within = contents(record, messages=False) if isinstance(record, Chunk) else iter([record])
    with suppress(RecordError):  # counted when the messages are copied
        for each in within:
            if isinstance(each, Channel | Schema):
                yield each


def scan_definitions(stream: BinaryIO, progress: Progress) -> Iterator[Intact | Damage]:
    """As :func:`scan`; ``progress`` takes the share done."""
    size_bytes = stream.seek(0, os.SEEK_END)
    shown = 0
    for found in scan(stream):
        yield found
        if found.end - shown > size_bytes // 100:
            shown = found.end
            progress(shown / size_bytes)
