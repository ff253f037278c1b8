"""What a recording says, message by message: samples, raw frames, fixes, events and health as JSON.

Everything that takes messages (one file, a recording in parts, a live view) is a :class:`MessageSink`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import orjson

from acquisition.core.frames import NANO, Frame, FrameFlag, Sample
from acquisition.core.trial import Trial
from acquisition.recording.schemas import (
    CHANNEL_PREFIX,
    EVENT_TOPIC,
    HEALTH_TOPIC,
    POSITION_TOPIC,
    PREDICTED_TRACK_TOPIC,
    PREDICTION_TOPIC,
    raw_topic,
)

_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}


class MessageSink(ABC):
    """Turns what the recorder has to say into messages; heirs say where they go."""

    @abstractmethod
    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Take one message: JSON text, received at ``log_ns`` and measured at ``publish_ns``, UTC since 1970."""

    @abstractmethod
    def write_trial(self, trial: Trial) -> None:
        """Say anew what is known of the trial, once more is known; the last word holds."""

    def write_sample(self, sample: Sample) -> None:
        """Record one value on its channel's topic; ``value`` must be finite."""
        body = {
            "value": sample.value,
            "source": sample.source,
            "quality": int(sample.quality),
            "source_clock": sample.clock,
            "monotonic_ns": sample.monotonic_ns,
        }
        if sample.source_ns is not None:  # left out, for null is no number: some viewers know one type a field
            body["source_time"] = sample.source_ns / NANO
        self.write(CHANNEL_PREFIX + sample.quantity, orjson.dumps(body), sample.received_ns, sample.measured_ns)

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
        self.write(raw_topic(frame.protocol, frame.origin), orjson.dumps(body), frame.received_ns, stamp)

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
        self.write(POSITION_TOPIC, orjson.dumps(body), received_ns, measured_ns)

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
        self.write(EVENT_TOPIC, orjson.dumps(body), received_ns, received_ns)

    def write_health(self, health: dict[str, Any], received_ns: int) -> None:
        """Record the state of one source."""
        self.write(HEALTH_TOPIC, orjson.dumps(health), received_ns, received_ns)

    def write_prediction(self, data: bytes, geojson: bytes, received_ns: int, start_ns: int) -> None:
        """Record what another program foretells from ``start_ns`` on, and what a map draws of it, if anything."""
        self.write(PREDICTION_TOPIC, data, received_ns, start_ns)
        if geojson:
            self.write(PREDICTED_TRACK_TOPIC, geojson, received_ns, start_ns)


def _timestamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // NANO, "nsec": time_ns % NANO}


def frame_of(topic: str, data: bytes, log_ns: int, publish_ns: int) -> Frame:
    """The frame that a raw message holds: the inverse of :meth:`MessageSink.write_raw`.

    Raises ValueError, KeyError or TypeError for what is no raw message of ours.
    """
    _, _, protocol, origin = topic.split("/", maxsplit=3)
    body = orjson.loads(data)
    stamped_ns = publish_ns if publish_ns != log_ns else None
    times = log_ns, int(body["monotonic_ns"])
    if protocol == "can":
        identifier, flags = int(body["id"]), FrameFlag(body["flags"])
        return Frame(origin, "can", bytes.fromhex(body["data"]), *times, identifier, flags, stamped_ns)
    if protocol == "nmea0183":
        return Frame(origin, "nmea0183", body["sentence"].encode("latin-1"), *times, stamped_ns=stamped_ns)
    if protocol == "mavlink":
        return Frame(origin, "mavlink", bytes.fromhex(body["data"]), *times, stamped_ns=stamped_ns)
    raise ValueError(f"protocol {protocol!r} is not known")
