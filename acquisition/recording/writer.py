"""Writing a recording: samples, raw frames, events and health into one MCAP file.

The file is readable up to the last :meth:`RecordingWriter.flush` whatever happens afterwards: a flush closes
the chunk in progress and hands it to the system, ``sync`` makes the disk keep it.
"""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any

import orjson
from mcap.writer import CompressionType, Writer

from acquisition.errors import storage_error
from acquisition.frames import Frame, Sample
from acquisition.recording.schemas import (
    CHANNEL_PREFIX,
    EVENT_TOPIC,
    HEALTH_TOPIC,
    POSITION_TOPIC,
    raw_topic,
    schema_of,
)
from acquisition.trial import Trial, software_version

_CHUNK_BYTES = 64 * 1024
_NANO = 1_000_000_000
_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}


class RecordingWriter:
    """One MCAP file being written; a context manager that closes it properly.

    Raises :class:`StorageError` when the file cannot be created or written. The MCAP library is fed only
    non-negative integer times and bytes: anything else would poison a chunk without a word.
    """

    def __init__(self, path: Path | str, trial: Trial, configuration: str = "") -> None:
        self.path = Path(path)
        self.messages = 0
        self._topics: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("wb")
            _sync_folder(self.path.parent)
        except OSError as error:
            raise storage_error(path, error, "cannot be created") from error
        self._mcap = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._mcap.start(profile="", library=software_version())
        self._mcap.add_metadata("trial", trial.as_metadata())
        if configuration:
            self._mcap.add_attachment(0, 0, "configuration.toml", "application/toml", configuration.encode())

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write_sample(self, sample: Sample) -> None:
        """Record one value on its channel's topic; ``value`` must be finite."""
        body = {
            "value": sample.value,
            "source": sample.source,
            "quality": int(sample.quality),
            "source_time": None if sample.source_ns is None else sample.source_ns / _NANO,
            "source_clock": sample.clock,
            "monotonic_ns": sample.monotonic_ns,
        }
        self._write(CHANNEL_PREFIX + sample.quantity, body, sample.received_ns, sample.measured_ns)

    def write_raw(self, frame: Frame) -> None:
        """Record a frame undecoded, so that a decoding mistake found later costs nothing."""
        body: dict[str, Any]
        if frame.protocol == "can":
            body = {"id": frame.identifier, "flags": int(frame.flags), "data": frame.payload.hex()}
        elif frame.protocol == "nmea0183":
            body = {"sentence": frame.payload.decode("latin-1")}
        else:
            body = {"data": frame.payload.hex()}
        body["monotonic_ns"] = frame.monotonic_ns
        stamp = frame.received_ns if frame.stamped_ns is None else frame.stamped_ns
        self._write(raw_topic(frame.protocol, frame.origin), body, frame.received_ns, stamp)

    def write_position(self, latitude_deg: float, longitude_deg: float, received_ns: int, measured_ns: int) -> None:
        """Record a fix for the map panels of viewers."""
        body = {
            "timestamp": _timestamp(measured_ns),
            "frame_id": "WGS84",
            "latitude": latitude_deg,
            "longitude": longitude_deg,
            "altitude": 0.0,
            "position_covariance": [0.0] * 9,
            "position_covariance_type": 0,
        }
        self._write(POSITION_TOPIC, body, received_ns, measured_ns)

    def write_event(self, message: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Record a message for people: an event mark, a source that failed, a switch of devices."""
        body = {
            "timestamp": _timestamp(received_ns),
            "level": _LEVELS[level],
            "message": message,
            "name": name,
            "file": "",
            "line": 0,
        }
        self._write(EVENT_TOPIC, body, received_ns, received_ns)

    def write_health(self, health: dict[str, Any], received_ns: int) -> None:
        """Record the state of one source."""
        self._write(HEALTH_TOPIC, health, received_ns, received_ns)

    def write_trial(self, trial: Trial) -> None:
        """Say anew what is known of the trial, once more is known; the last record holds."""
        self._guarded(self._mcap.add_metadata, "trial", trial.as_metadata())

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the operating system."""
        self._guarded(self._mcap.flush)

    def sync(self) -> None:
        """Flush, and make the disk keep what was flushed."""
        self.flush()
        self._guarded(os.fsync, self._file.fileno())

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._guarded(self._mcap.finish)
            self._guarded(self._file.flush)
            self._guarded(os.fsync, self._file.fileno())
        finally:
            self._guarded(self._file.close)

    def _write(self, topic: str, body: dict[str, Any], log_ns: int, publish_ns: int) -> None:
        channel_id = self._topics.get(topic) or self._register(topic)
        sequence = self._sequences[topic] = (self._sequences[topic] + 1) % 2**32
        data = orjson.dumps(body)
        self._guarded(self._mcap.add_message, channel_id, max(log_ns, 0), data, max(publish_ns, 0), sequence)
        self.messages += 1

    def _register(self, topic: str) -> int:
        name, schema = schema_of(topic)
        schema_id = self._mcap.register_schema(name, "jsonschema", schema)
        self._sequences[topic] = 0
        self._topics[topic] = self._mcap.register_channel(topic, "json", schema_id)
        return self._topics[topic]

    def _guarded(self, call: Any, *arguments: Any) -> None:
        try:
            call(*arguments)
        except OSError as error:
            raise storage_error(self.path, error) from error


def _sync_folder(folder: Path) -> None:
    """Make the disk keep the new file's name too, not only what is in it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _timestamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _NANO, "nsec": time_ns % _NANO}
