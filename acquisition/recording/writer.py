"""Writes a recording: one MCAP file that stays readable up to its last flush, whatever becomes of the disk.

:meth:`RecordingWriter.flush` closes the chunk in progress and hands it to the system, ``sync`` makes the disk keep
it. The records are those of the ``mcap`` library, whose readers are the oracle that :class:`McapFile` is tested
against; its writer took more than a third of the recorder's time and kept an object for every chunk until the end.
Here a message, and the index of a chunk's messages, are packed at once, and of a chunk only its index record is
kept, as bytes. The format: https://mcap.dev/spec. :class:`CommittedFile` gathers the pieces of a record and writes
them at once, so that the file always ends with a complete record; a write that fails halfway is cut off again.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from errno import EACCES, EINVAL, ENODEV, ENOSYS, ENOTSUP, EPERM
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core import errors, files, ship
from seatrial.acquisition.core.trial import Quality, Sample, Trial, software_version
from seatrial.acquisition.recording.messages import ENCODING, MessageSink, channel_metadata, message_kind_of_topic
from seatrial.acquisition.recording.scan import MCAP_MAGIC, add_metadata_checksum

if TYPE_CHECKING:
    import pandas as pd

_CHUNK_BYTES = 256 * 1024
_LATEST_NS = 2**63 - 1
_MEDIA_TYPES = {".toml": "application/toml"}
_ROWS_TO_FLUSH = 50_000

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_CODE = int(Opcode.MESSAGE)
_FIXED_BYTES = 2 + 4 + 8 + 8
_INDEX = struct.Struct("<BQHI")
_FOOTER_HEAD = struct.Struct("<BQQQ")
_FOOTER_BYTES = 8 + 8 + 4
_CHUNKS_TO_NEXT_DEFINITIONS = 300

_MEGA = 1_000_000
_LARGEST_RESERVE_BYTES = 200 * _MEGA
_RESERVE_FRACTION = 0.05
_COPY_BYTES = 1024 * 1024
_FOLDER_SYNC_UNSUPPORTED = {EACCES, EINVAL, ENOSYS, ENOTSUP, EPERM}

RESUME_RATIO = 1.1
"""So much more than the reserve must be free again before a recording goes on."""

Answer = TypeVar("Answer")


class RecordingWriter(MessageSink):
    """One MCAP file being written; a context manager that closes it properly.

    Raises :class:`StorageError` when the file cannot be created or written.
    """

    def __init__(
        self,
        path: Path | str,
        trial: Trial,
        attachments: Mapping[str, bytes] | None = None,
        thread: SyncThread | None = None,
    ) -> None:
        self.path = Path(path)
        self.messages = 0
        self._trial_channels = ship.channels_by_name_of(trial)
        self._topics: dict[str, list[int]] = {}  # number of the channel, and of its last message
        self._schemas: dict[str, int] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = CommittedFile(self.path, thread)
        except OSError as error:
            raise errors.storage_error(path, error, "cannot be created") from error
        try:
            sync_folder(self.path.parent)
        except OSError as error:
            self._file.close()
            raise errors.storage_error(path, error, "cannot be created") from error
        self._mcap = McapFile(self._file, software_version(), _CHUNK_BYTES)
        self._mcap.add_metadata("trial", trial.as_metadata())
        for name, data in (attachments or {}).items():
            self._mcap.add_attachment(name, _MEDIA_TYPES.get(Path(name).suffix, "text/plain"), data)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.close()
        except errors.StorageError:
            self.abandon()
            raise

    @property
    def size_bytes(self) -> int:
        """How long the file is by now."""
        return self._file.tell()

    @property
    def has_vanished(self) -> bool:
        """Whether the file was deleted while it is being written. Raises :class:`StorageError`."""
        return not self._file.closed and self._raise_storage_errors_of(lambda: self._file.has_vanished)

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        channel = self._topics.get(topic)
        if channel is None:
            kind, metadata = message_kind_of_topic(topic), channel_metadata(topic, self._trial_channels)
            if kind.title not in self._schemas:
                self._schemas[kind.title] = self._mcap.register_schema(kind.title, ENCODING, kind.descriptors)
            number = self._mcap.register_channel(topic, ENCODING, self._schemas[kind.title], metadata)
            channel = self._topics[topic] = [number, 0]
        channel[1] += 1
        if not (0 <= log_ns <= _LATEST_NS and 0 <= publish_ns <= _LATEST_NS):  # the format has no such times
            log_ns, publish_ns = min(max(log_ns, 0), _LATEST_NS), min(max(publish_ns, 0), _LATEST_NS)
        self._mcap.add_message(channel[0], log_ns, data, publish_ns, channel[1] & 0xFFFFFFFF)
        self.messages += 1

    def write_trial(self, trial: Trial) -> None:
        self.write_metadata("trial", trial.as_metadata())

    def write_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Say something of the recording as a whole."""
        self._mcap.add_metadata(name, dict(metadata))

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the operating system."""
        self._raise_storage_errors_of(self._flush)

    def sync(self) -> None:
        """Flush, and make the disk keep what was flushed."""
        self._raise_storage_errors_of(self._flush)
        self._raise_storage_errors_of(self._file.sync)

    def begin_sync(self) -> bool:
        """As :meth:`sync`, without waiting for the disk; False if it is still busy with the last sync.

        A fault of the last sync is raised now.
        """
        self._raise_storage_errors_of(self._mcap.end_chunk)
        return self._raise_storage_errors_of(self._file.begin_sync)

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._file.closed:
            return
        self._raise_storage_errors_of(self._flush)
        self._raise_storage_errors_of(self._mcap.finish)
        self._raise_storage_errors_of(self._file.sync)
        self._raise_storage_errors_of(self._file.close)

    def abandon(self) -> bool:
        """Give up on a file that can no longer be written: keep what was synced, ended well if there is room.

        Such a file has no index, which readers can do without. Returns whether it could be ended.
        """
        return self._file.abandon(file_end_without_index())

    def end_abandoned_file(self) -> None:
        """End an abandoned file that could not be ended, if it is still there: cut it to what was synced.

        Raises OSError.
        """
        descriptor, length = os.open(self.path, os.O_RDWR | files.CLOSED_IN_CHILDREN), self._file.synced
        try:
            state = os.fstat(descriptor)
            if state.st_ino == self._file.inode and state.st_size >= length:
                os.ftruncate(descriptor, length)
                files.write_at(descriptor, file_end_without_index(), length)
                files.sync_data(descriptor)
        finally:
            os.close(descriptor)

    def rewrite_deleted_file(self, path: Path) -> None:
        """Write the content of a file that was deleted to ``path``, ended without an index, and let go of it.

        Where that fails, the deleted file goes on being written.
        """
        self._raise_storage_errors_of(self._flush)
        self._raise_storage_errors_of(lambda: self._file.rewrite_deleted_content(path, file_end_without_index()))
        self._raise_storage_errors_of(self._file.close)

    def _flush(self) -> None:
        self._mcap.end_chunk()
        self._file.flush()

    def _raise_storage_errors_of(self, call: Callable[[], Answer]) -> Answer:
        try:
            return call()
        except OSError as error:
            raise errors.storage_error(self.path, error) from error


def serialise_record(record: mcap.McapRecord) -> bytes:
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
        self._write(MCAP_MAGIC + serialise_record(mcap.Header("", library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a schema and return its number."""
        number = len(self._schemas) + 1
        self._schemas.append(self._add_definition(mcap.Schema(id=number, name=name, encoding=encoding, data=data)))
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: dict[str, str] | None = None
    ) -> int:
        """Define a channel and return its number."""
        number = len(self._channels) + 1
        channel = mcap.Channel(
            id=number, topic=topic, message_encoding=message_encoding, schema_id=schema_id, metadata=metadata or {}
        )
        self._channels.append(self._add_definition(channel))
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
        checked = mcap.Metadata(name=name, metadata=add_metadata_checksum(name, metadata))
        record, offset = serialise_record(checked), self._stream.tell()
        self._write(record)
        index = mcap.MetadataIndex(offset=offset, length=len(record), name=name)
        self._indexes[Opcode.METADATA_INDEX].append(serialise_record(index))
        self._metadata += 1

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment, outside all chunks."""
        attachment = mcap.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        record, offset = serialise_record(attachment), self._stream.tell()
        self._write(record)
        index = mcap.AttachmentIndex(
            offset=offset, length=len(record), create_time=0, log_time=0, data_size=len(data), name=name,
            media_type=media_type,
        )  # fmt: skip
        self._indexes[Opcode.ATTACHMENT_INDEX].append(serialise_record(index))
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
        offset, record = self._stream.tell(), serialise_record(chunk)
        self._write(record)
        start = self._stream.tell()
        places: dict[int, int] = {}  # where the index of each channel's messages is
        for channel_id, entries in self._index.items():
            places[channel_id] = self._stream.tell()
            head = _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + 8 * len(entries), channel_id, 8 * len(entries))
            self._write(head + struct.pack(f"<{len(entries)}Q", *entries))
            self._counts[channel_id] += len(entries) // 2
        index = mcap.ChunkIndex(
            message_start_time=start_ns,
            message_end_time=end_ns,
            chunk_start_offset=offset,
            chunk_length=len(record),
            message_index_offsets=places,
            message_index_length=self._stream.tell() - start,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        self._indexes[Opcode.CHUNK_INDEX].append(serialise_record(index))
        self._span = min(start_ns, (self._span or (start_ns,))[0]), max(end_ns, (self._span or (0, end_ns))[1])
        self._begin_chunk()
        self._write(b"".join(self._repeat))
        self._repeat.clear()

    def finish(self) -> None:
        """Write the last chunk, the index and the end of the file."""
        self.end_chunk()
        self._stream.write(serialise_record(mcap.DataEnd(self._checksum)))
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
        groups = {Opcode.SCHEMA: self._schemas, Opcode.CHANNEL: self._channels}
        groups |= {Opcode.STATISTICS: [serialise_record(statistics)]}
        for opcode in (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            groups[opcode] = self._indexes[opcode]
        start, summary, offsets = self._stream.tell(), bytearray(), bytearray()
        for opcode, records in groups.items():
            if records:
                group = mcap.SummaryOffset(
                    group_opcode=opcode, group_start=start + len(summary), group_length=sum(map(len, records))
                )
                offsets += serialise_record(group)
                summary += b"".join(records)
        offsets_start = start + len(summary)
        summary += offsets
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offsets_start), zlib.crc32(summary))
        footer = mcap.Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=crc)
        self._stream.write(bytes(summary) + serialise_record(footer) + MCAP_MAGIC)

    def _write(self, data: bytes) -> None:
        """Write what belongs to the data, of which there is a checksum."""
        self._checksum = zlib.crc32(data, self._checksum)
        self._stream.write(data)

    def _begin_chunk(self) -> None:
        due = len(self._indexes[Opcode.CHUNK_INDEX]) % _CHUNKS_TO_NEXT_DEFINITIONS == 0
        self._chunk = bytearray(b"".join(self._schemas + self._channels) if due else b"")
        self._index: defaultdict[int, list[int]] = defaultdict(list)  # time, place, time, place ...

    def _add_definition(self, record: mcap.Schema | mcap.Channel) -> bytes:
        data = serialise_record(record)
        self._chunk += data
        self._repeat.append(data)
        return data


def file_end_without_index() -> bytes:
    """What ends a file that there is no room to index: readers can do without an index."""
    return serialise_record(mcap.DataEnd(0)) + serialise_record(mcap.Footer(0, 0, 0)) + MCAP_MAGIC


def free_and_total_bytes(folder: Path) -> tuple[int, int]:
    """What is free for us on the folder's disk, and how large that disk is [bytes]."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize, disk.f_blocks * disk.f_frsize


def reserve_bytes(settings: RecordingSection, disk_bytes: int) -> float:
    """How much of a disk of that size stays free [bytes]."""
    if settings.reserve_mb is not None:
        return settings.reserve_mb * _MEGA
    return min(_RESERVE_FRACTION * disk_bytes, _LARGEST_RESERVE_BYTES)


def shortage_text(settings: RecordingSection, free: float, size: int, ratio: float = 1.0) -> str:
    """In what a disk is too full, with so much free of its size [bytes]; nothing if it is not."""
    reserve = reserve_bytes(settings, size)
    if free >= reserve * ratio:
        return ""
    return f"{free / _MEGA:.1f} MB free, less than the reserve of {reserve / _MEGA:.1f} MB"


def remaining_bytes(folder: Path, settings: RecordingSection) -> int | None:
    """What may still be written to the folder's disk [bytes]; None if the disk cannot be asked."""
    try:
        free, size = free_and_total_bytes(folder)
    except OSError:
        return None
    return max(int(free - reserve_bytes(settings, size)), 0)


def why_disk_is_full(folder: Path, settings: RecordingSection, ratio: float = 1.0) -> str:
    """Why the disk is too full to go on; nothing if it is not."""
    try:
        free, size = free_and_total_bytes(folder)
    except OSError:
        return ""  # opening or writing will say what is wrong, and better
    reason = shortage_text(settings, free, size, ratio)
    return f"{folder}: {reason}" if reason else ""


def require_disk_space(folder: Path, settings: RecordingSection) -> None:
    """Raise :class:`StorageError` where a recording cannot begin for want of room; the folder need not be there."""
    existing = next(directory for directory in (folder, *folder.absolute().parents) if directory.exists())
    if reason := shortage_text(settings, *free_and_total_bytes(existing)):
        fix = "free space, or lower `reserve_mb` in [recording]"
        raise errors.StorageError("cannot be recorded to", where=str(folder), why=reason, fix=fix)


def mount_point(folder: Path) -> Path | None:
    """Where the disk below ``folder`` is mounted; None on the root disk, which cannot go."""
    place = folder.resolve()
    point = next(path for path in (place, *place.parents) if os.path.ismount(path))
    return None if point == point.parent else point


def require_still_mounted(point: Path | None) -> None:
    """Raise OSError where nothing is mounted at ``point`` any more: its folder now belongs to another disk."""
    if point is not None and not os.path.ismount(point):
        raise OSError(ENODEV, f"the disk at {point} is gone: nothing is mounted there")


class SyncThread:
    """The thread in which disks keep what was written, for all parts of a recording.

    It starts with the first work. Where the system gives no thread, ``refused`` is true, the caller's is used, and
    a new one is tried again each time.
    """

    def __init__(self) -> None:
        self._executor: ThreadPoolExecutor | None = None
        self.refused = False

    def submit(self, call: Callable[[int], None], descriptor: int) -> Future[None]:
        """Call with a descriptor in the thread; the future has the result, or the exception."""
        if self._executor is None:
            executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sync")
            with suppress(RuntimeError):  # the only thread of an executor starts with its first work
                executor.submit(int)
                self._executor = executor
            self.refused = self._executor is None
        if self._executor is not None:
            return self._executor.submit(call, descriptor)
        future: Future[None] = Future()
        try:
            call(descriptor)
            future.set_result(None)
        except OSError as error:
            future.set_exception(error)
        return future

    def stop(self) -> None:
        """End the thread, after what it is doing."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None


class CommittedFile:
    """A file that is only ever appended to, with the part of the file interface that MCAP's writer uses.

    ``committed`` is its length after the last :meth:`flush`, ``synced`` after the last :meth:`sync`; both in
    bytes. ``thread`` syncs in the background. Methods raise OSError.
    """

    def __init__(self, path: Path, thread: SyncThread | None = None) -> None:
        self.path = path
        self.committed = 0
        self.synced = 0
        self._pending = bytearray()
        # A slow disk takes seconds to sync, too long for the recorder's thread.
        self._thread = thread or SyncThread()
        self._syncing: Future[None] | None = None
        self._syncing_bytes = 0
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | files.CLOSED_IN_CHILDREN, 0o644)
        try:
            self.inode = os.fstat(self._descriptor).st_ino
        except OSError:
            self.close()
            raise

    @property
    def closed(self) -> bool:
        """Whether :meth:`close` was called."""
        return self._descriptor < 0

    @property
    def has_vanished(self) -> bool:
        """Whether the file was deleted while it was being written."""
        return os.fstat(self._descriptor).st_nlink == 0

    def write(self, data: bytes) -> int:
        """Take ``data`` in; nothing reaches the system before :meth:`flush`."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Where the next byte will stand."""
        return self.committed + len(self._pending)

    def flush(self) -> None:
        """Hand what was gathered to the system: all of it, or nothing and OSError."""
        try:
            view, written = memoryview(bytes(self._pending)), 0
            while written < len(view):
                written += files.write_at(self._descriptor, view[written:], self.committed + written)
        except OSError:
            self.truncate_to(self.committed)
            raise
        self.committed += len(self._pending)
        self._pending.clear()

    def sync(self) -> None:
        """Flush, and make the disk keep it."""
        self.flush()
        self._await_sync_and_raise()
        files.sync_data(self._descriptor)
        self.synced = self.committed

    def begin_sync(self) -> bool:
        """Flush, and let the disk keep it in the background; False if it is still busy with the last sync.

        Raises what went wrong with the last sync.
        """
        self.flush()
        if self._syncing is not None:
            if not self._syncing.done():
                return False
            self._await_sync_and_raise()
            self.synced = self._syncing_bytes
        self._syncing_bytes = self.committed
        self._syncing = self._thread.submit(files.sync_data, self._descriptor)
        return True

    def _await_sync(self) -> None:
        """Wait for a sync in the background: it uses the descriptor."""
        if self._syncing is not None:
            wait([self._syncing])

    def _await_sync_and_raise(self) -> None:
        """Wait for a sync in the background, and raise what went wrong with it: the system reports it only once."""
        if self._syncing is not None:
            syncing, self._syncing = self._syncing, None
            syncing.result()

    def truncate_to(self, length: int) -> bool:
        """Forget everything after ``length`` bytes, if that can be: a disk that is gone cannot, and need not."""
        try:
            os.ftruncate(self._descriptor, length)
        except OSError:
            return False
        self.committed = length
        return True

    def abandon(self, ending: bytes) -> bool:
        """Keep what the disk is sure to have, close it with ``ending`` if that can be, and let go of the file.

        Returns whether the ending was written.
        """
        self._await_sync()
        self._syncing = None
        self._pending.clear()
        try:
            if not self.truncate_to(
                self.synced
            ):  # an ending would confirm what is written again, or stand in the midst
                return False
            self._pending += ending
            self.sync()
        except OSError:
            return False
        finally:
            with suppress(OSError):
                self.close()
        return True

    def rewrite_deleted_content(self, path: Path, ending: bytes) -> None:
        """Write a deleted file's content to ``path``: as long as the file is open, the system keeps it.

        Leaves nothing at ``path`` if that fails.
        """
        try:
            with path.open("wb") as copy:
                for offset in range(0, self.committed, _COPY_BYTES):
                    copy.write(files.read_at(self._descriptor, min(_COPY_BYTES, self.committed - offset), offset))
                copy.write(ending)
                copy.flush()
                os.fsync(copy.fileno())
        except OSError:
            path.unlink(missing_ok=True)
            raise

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if not self.closed:
            self._await_sync()
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)


def new_mcap_file(folder: Path, stem: str) -> Path:
    """A new empty ``.mcap`` file of our own, the stem with a number where that name is taken; the folder is made.

    Of two programs that want one name, the second gets the next.
    """
    folder.mkdir(parents=True, exist_ok=True)
    number, path = 1, folder / f"{stem}.mcap"
    while True:
        try:
            path.touch(exist_ok=False)
        except FileExistsError:
            number += 1
            path = folder / f"{stem}_{number}.mcap"
        else:
            return path


def sync_folder(folder: Path) -> None:
    """Make the disk keep a new file's name too, not only what is in it; some file systems keep it unasked."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows opens no folder
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY | files.CLOSED_IN_CHILDREN)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        if error.errno not in _FOLDER_SYNC_UNSUPPORTED:
            raise


def write_table(
    table: pd.DataFrame,
    path: Path | str,
    trial: Trial,
    source: str | Mapping[str, str] = "table",
    qualities: Mapping[str, NDArray[np.uint8]] | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    progress: errors.Progress = lambda share: None,
) -> int:
    """Write a table's channels as a recording, in the order of its rows, and return the number of samples.

    ``table`` has a UTC index named ``time`` and columns named as the channels, in their units; NaN cells are
    not written. ``source`` says where the values come from, for all or by column; ``qualities`` gives flags
    by column, :attr:`Quality.NOT_EVALUATED` where it is silent; ``metadata`` is written besides the trial's, by
    name. The file appears under its name only when it is complete. Raises :class:`InputError` for a column that
    is no channel, :class:`StorageError` when the file cannot be written.
    """
    files.require_suffix(path, ".mcap")
    channels = ship.channels_of_trial(trial)
    unknown = [name for name in table.columns if name not in channels]
    if unknown:
        raise errors.InputError(f"columns {', '.join(map(str, unknown))} are no channels", where=str(path))
    with files.atomic_file(path) as partial, RecordingWriter(partial, trial) as writer:
        for name, entries in (metadata or {}).items():
            writer.write_metadata(name, entries)
        _write_table_rows(writer, table, source, qualities or {}, progress)
    return int(table.notna().to_numpy().sum())


def _write_table_rows(
    writer: RecordingWriter,
    table: pd.DataFrame,
    source: str | Mapping[str, str],
    qualities: Mapping[str, NDArray[np.uint8]],
    progress: errors.Progress,
) -> None:
    import pandas as pd  # a recorder needs none: it starts half a second earlier

    index = pd.DatetimeIndex(table.index)
    times_ns = index.as_unit("ns").asi8.tolist()  # pandas 3 counts in microseconds by default
    names = [str(name) for name in table.columns]
    sources = [source if isinstance(source, str) else source.get(name, "table") for name in names]
    flags = [qualities.get(name) for name in names]
    values = table.to_numpy(dtype=float)
    present = np.isfinite(values)
    for row, time_ns in enumerate(times_ns):
        for column in np.flatnonzero(present[row]):
            flag = flags[column]
            quality = Quality.NOT_EVALUATED if flag is None else Quality(int(flag[row]))
            value = float(values[row, column])
            name, origin = names[column], sources[column]
            writer.write_sample(Sample(name, value, origin, time_ns, 0, time_ns, time_ns, "table", quality))
        if row % _ROWS_TO_FLUSH == _ROWS_TO_FLUSH - 1:
            writer.flush()  # or a day of samples would be held in memory
            progress((row + 1) / len(table))
