"""Whether a file holds the messages that were written into it: read back by two readers, and hashed."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk

from acquisition.core.errors import InputError, StorageError
from acquisition.recording.reader import MessageStream
from acquisition.recording.records import HEAD

_KEY = struct.Struct("<QQQQ")


class Digest:
    """A running hash of messages in their order: topics, times and data."""

    def __init__(self) -> None:
        self.messages = 0
        self._hash = blake2b()

    def add(self, topic: str, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take the next message."""
        name = topic.encode()
        self.messages += 1
        self._hash.update(_KEY.pack(log_ns, publish_ns, len(name), len(data)))
        self._hash.update(name)
        self._hash.update(data)

    @property
    def value(self) -> tuple[int, bytes]:
        """How many there were, and the hash."""
        return self.messages, self._hash.digest()


def verify(partial: Path, target: Path, saved: Digest) -> None:
    """Read a file back, as we would and as any other program would.

    Raises :class:`StorageError`, about the name that it is to get, if it does not hold what was saved.
    """
    ours, theirs = Digest(), Digest()
    try:
        written = MessageStream(partial)
        for entry in written:
            ours.add(*entry)
        with partial.open("rb") as stream:
            for topic, message in _by_index(stream):
                theirs.add(topic, message.log_time, message.publish_time, message.data)
    except (InputError, McapError, ValueError, KeyError, struct.error) as error:
        raise _unlike(target, str(error)) from error
    if not written.closed or not ours.value == theirs.value == saved.value:
        raise _unlike(target, f"{ours.messages:,} and {theirs.messages:,} messages of {saved.messages:,}")


def _by_index(stream: BinaryIO) -> Iterator[tuple[str, Message]]:
    """Topics and messages in file order, found by the library through the file's index.

    The library's own ``iter_messages`` in file order would first hold all of them.
    """
    summary = make_reader(stream, validate_crcs=True).get_summary()
    if summary is None:
        raise ValueError("it has no summary")
    for index in summary.chunk_indexes:
        stream.seek(index.chunk_start_offset + HEAD.size)
        for record in breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True):
            if isinstance(record, Message):
                yield summary.channels[record.channel_id].topic, record


def _unlike(target: Path, why: str) -> StorageError:
    return StorageError("does not read back as it was written", where=str(target), why=why, fix="try another disk")
