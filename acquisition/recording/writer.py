"""Writing a recording: one MCAP file.

The file is readable up to the last :meth:`RecordingWriter.flush` whatever happens afterwards: a flush closes
the chunk in progress and hands it to the system, ``sync`` makes the disk keep it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from seatrial.acquisition.core.channels import channels_known_to
from seatrial.acquisition.core.errors import StorageError, storage_error
from seatrial.acquisition.core.trial import Trial, software_version
from seatrial.acquisition.recording.mcap_file import McapFile, end_without_index
from seatrial.acquisition.recording.messages import ENCODING, MessageSink
from seatrial.acquisition.recording.schemas import channel_metadata, kind_of
from seatrial.acquisition.recording.storage import CommittedFile, SyncThread, end_file, sync_folder

_CHUNK_BYTES = 256 * 1024
_LATEST_NS = 2**63 - 1
_MEDIA_TYPES = {".toml": "application/toml"}

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
        self._trial_channels = channels_known_to(trial)
        self._topics: dict[str, list[int]] = {}  # number of the channel, and of its last message
        self._schemas: dict[str, int] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = CommittedFile(self.path, thread)
        except OSError as error:
            raise storage_error(path, error, "cannot be created") from error
        try:
            sync_folder(self.path.parent)
        except OSError as error:
            self._file.close()
            raise storage_error(path, error, "cannot be created") from error
        self._mcap = McapFile(self._file, software_version(), _CHUNK_BYTES)
        self._mcap.add_metadata("trial", trial.as_metadata())
        for name, data in (attachments or {}).items():
            self._mcap.add_attachment(name, _MEDIA_TYPES.get(Path(name).suffix, "text/plain"), data)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.close()
        except StorageError:
            self.abandon()
            raise

    @property
    def size_bytes(self) -> int:
        """How long the file is by now."""
        return self._file.tell()

    @property
    def vanished(self) -> bool:
        """Whether somebody has deleted the file that is being written. Raises :class:`StorageError`."""
        return not self._file.closed and self._guarded(lambda: self._file.vanished)

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        channel = self._topics.get(topic) or self._register(topic)
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
        self._guarded(self._flush)

    def sync(self) -> None:
        """Flush, and make the disk keep what was flushed."""
        self._guarded(self._flush)
        self._guarded(self._file.sync)

    def begin_sync(self) -> bool:
        """As :meth:`sync`, without waiting for the disk; False if it is still busy with the last time.

        Trouble of the last time is raised now.
        """
        self._guarded(self._mcap.end_chunk)
        return self._guarded(self._file.begin_sync)

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._file.closed:
            return
        self._guarded(self._flush)
        self._guarded(self._mcap.finish)
        self._guarded(self._file.sync)
        self._guarded(self._file.close)

    def abandon(self) -> bool:
        """Give up on a file that can no longer be written: keep what was synced, ended well if there is room.

        Such a file has no index, which readers can do without. Returns whether it could be ended.
        """
        return self._file.abandon(end_without_index())

    def end_later(self) -> None:
        """End an abandoned file that could not be ended: cut it to what was synced. Raises OSError."""
        end_file(self.path, self._file.inode, self._file.synced, end_without_index())

    def put_back(self, path: Path) -> None:
        """Write the content of a file that was deleted to ``path``, ended without an index, and let go of it.

        Where that fails, the deleted file goes on being written.
        """
        self._guarded(self._flush)
        self._guarded(lambda: self._file.rescue(path, end_without_index()))
        self._guarded(self._file.close)

    def _flush(self) -> None:
        self._mcap.end_chunk()
        self._file.flush()

    def _register(self, topic: str) -> list[int]:
        kind, metadata = kind_of(topic), channel_metadata(topic, self._trial_channels)
        if kind.title not in self._schemas:
            self._schemas[kind.title] = self._mcap.register_schema(kind.title, ENCODING, kind.descriptors)
        number = self._mcap.register_channel(topic, ENCODING, self._schemas[kind.title], metadata)
        self._topics[topic] = [number, 0]
        return self._topics[topic]

    def _guarded(self, call: Callable[[], Answer]) -> Answer:
        try:
            return call()
        except OSError as error:
            raise storage_error(self.path, error) from error
