"""What a recording says, message by message: samples, raw frames, fixes, events and health as protobuf.

Everything that takes messages (one file, a recording in parts, a live view) is a :class:`MessageSink`. Recordings
made before had the same in JSON, and are decoded to the same.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, NamedTuple

import orjson
from google.protobuf.message import DecodeError

from seatrial.acquisition.core.budget import TEXT_BYTES
from seatrial.acquisition.core.frames import NANO, Fix, Frame, FrameFlag, Sample
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.descriptors import message_class, plain
from seatrial.acquisition.recording.schemas import (
    CHANNEL_PREFIX,
    EVENT_TOPIC,
    HEALTH_TOPIC,
    POSITION_TOPIC,
    PREDICTED_TRACK_TOPIC,
    PREDICTION_TOPIC,
    RAW_PREFIX,
    SAMPLE,
    kind_of,
    raw_topic,
)

ENCODING = "protobuf"
"""How messages are encoded, in MCAP's words."""
ENCODING_BEFORE = "json"

NOT_SAID = float("nan")
_NO_FIX = Fix()
_DIAGONAL_KNOWN = 2
_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}
_NUMBERS = struct.Struct("<BdBdBqBI")  # the first four fields of a sample, each behind its tag
_VALUE, _SOURCE_TIME, _MONOTONIC, _QUALITY = 1 << 3 | 1, 2 << 3 | 1, 3 << 3 | 1, 4 << 3 | 5
_CAN, _RECEIVED = struct.Struct("<BIBIBB"), struct.Struct("<Bq")  # the fields of a CAN frame, but its data's bytes
_IDENTIFIER, _FLAGS, _DATA, _RECEIVED_AT = 1 << 3 | 5, 2 << 3 | 5, 3 << 3 | 2, 4 << 3 | 1
_ONE_BYTE_LENGTHS = 128  # longer data have their length in two bytes
VALUE_AT, QUALITY_AT, SOURCE_AT = 1, 28, 32
"""Where in a sample's message these begin."""
SAMPLE_TAGS = (0, _VALUE), (9, _SOURCE_TIME), (18, _MONOTONIC), (27, _QUALITY)
"""Where in a sample's message the tags of its numbers stand, and what they are."""


def encode(topic: str, body: dict[str, Any]) -> bytes:
    """The message of a topic of ours that says this. Raises TypeError, ValueError or KeyError if none does."""
    if not topic.startswith(CHANNEL_PREFIX):
        return bytes(kind_of(topic).message(**body).SerializeToString())
    fields = {"source_time": NOT_SAID, "monotonic_ns": 0, "source_clock": "", **body}
    numbers = (float(fields["value"]), fields["source_time"], fields["monotonic_ns"], int(fields["quality"]))
    return _numbers(*numbers) + _source(fields["source"], fields["source_clock"])


class Topic(NamedTuple):
    """A topic of a file: how its messages are encoded, and the schema that the file gives them; ours if none."""

    name: str
    encoding: str = ENCODING
    schema: bytes = b""

    @property
    def is_channel(self) -> bool:
        """Whether its messages are samples."""
        return self.name.startswith(CHANNEL_PREFIX)

    @property
    def has_fixed_places(self) -> bool:
        """Whether the numbers of its messages, samples, lie where :func:`encode_sample` puts them, or may."""
        return self.encoding == ENCODING and _fields(self.name, self.schema) == _fields(self.name, b"")


def decode(topic: Topic, data: bytes) -> dict[str, Any]:
    """What a message of a topic of ours says, by the schema of its file, or in JSON as it was before.

    Raises KeyError for another topic, ValueError if the message is none of its.
    """
    try:
        if topic.encoding == ENCODING_BEFORE:
            return _decode_json(topic.name, data)
        return plain(_class_in(topic.name, topic.schema).FromString(data))
    except (DecodeError, TypeError) as error:
        raise ValueError(str(error)) from error


def level_name(level: Any) -> str:
    """The name of an event's level by its number; empty for none that is known."""
    return _LEVEL_NAMES.get(level, "") if isinstance(level, int) else ""


@lru_cache(maxsize=256)
def _class_in(name: str, schema: bytes) -> Any:
    """The class of a topic's messages by the schema that a file gives; fields may have had other numbers."""
    kind = kind_of(name)
    if len(schema) > TEXT_BYTES.allowance(0):
        raise ValueError(f"its schema has {len(schema):,} bytes")
    return kind.message if schema in (b"", kind.descriptors) else message_class(kind.title, schema)


@lru_cache(maxsize=256)
def _fields(name: str, schema: bytes) -> set[tuple[str, int, int]]:
    return {(entry.name, entry.number, entry.type) for entry in _class_in(name, schema).DESCRIPTOR.fields}


def _decode_json(topic: str, data: bytes) -> dict[str, Any]:
    body = orjson.loads(data)
    if not isinstance(body, dict):
        raise ValueError("it is no JSON object")  # noqa: TRY004
    if topic.startswith(RAW_PREFIX) and "data" in body:
        body["data"] = bytes.fromhex(body["data"])
    if topic in (POSITION_TOPIC, EVENT_TOPIC) and "timestamp" in body:
        time = body["timestamp"]
        body["timestamp"] = {"seconds": time["sec"], "nanos": time["nsec"]}
    return body


def encode_sample(sample: Sample) -> bytes:
    """A sample's message, as the protobuf runtime would make it if it never left out a number that is 0."""
    source_time = NOT_SAID if sample.source_ns is None else sample.source_ns / NANO
    numbers = _numbers(sample.value, source_time, sample.monotonic_ns, sample.quality)
    return numbers + _source(sample.source, sample.clock)


def _numbers(value: float, source_time: float, monotonic_ns: int, quality: int) -> bytes:
    return _NUMBERS.pack(_VALUE, value, _SOURCE_TIME, source_time, _MONOTONIC, monotonic_ns, _QUALITY, quality)


@lru_cache(maxsize=1024)
def _source(source: str, clock: str) -> bytes:
    """The last two fields of a sample: thousands of samples have the same."""
    return bytes(SAMPLE.message(source=source, source_clock=clock).SerializeToString())


def encode_raw(topic: str, frame: Frame) -> bytes:
    """A raw frame's message. That of CAN is packed at once: a full bus has 1,900 a second."""
    payload = frame.payload
    if frame.protocol == "can" and len(payload) < _ONE_BYTE_LENGTHS:
        head = _CAN.pack(_IDENTIFIER, frame.identifier, _FLAGS, frame.flags, _DATA, len(payload))
        return head + payload + _RECEIVED.pack(_RECEIVED_AT, frame.monotonic_ns) + _sender(frame.sender)
    body: dict[str, Any] = {"monotonic_ns": frame.monotonic_ns, "sender": frame.sender}
    if frame.protocol == "can":
        body |= {"id": frame.identifier, "flags": int(frame.flags), "data": payload}
    elif frame.protocol == "nmea0183":
        body["sentence"] = payload.decode("latin-1")
    elif frame.protocol == "mqtt":
        name, _, data = payload.partition(b"\0")
        body |= {"topic": name.decode("utf-8", "replace"), "data": data, "flags": int(frame.flags)}
    else:
        body["data"] = payload
    return encode(topic, body)


@lru_cache(maxsize=1024)
def _sender(sender: str) -> bytes:
    return bytes(kind_of("/raw/can/").message(sender=sender).SerializeToString())


class MessageSink(ABC):
    """Turns what the recorder has to say into messages; heirs say where they go."""

    @abstractmethod
    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Take one message, encoded, received at ``log_ns`` and measured at ``publish_ns``, UTC since 1970."""

    @abstractmethod
    def write_trial(self, trial: Trial) -> None:
        """Say anew what is known of the trial, once more is known; the last word holds."""

    def write_sample(self, sample: Sample) -> None:
        """Record one value on its channel's topic; ``value`` must be finite."""
        self.write(CHANNEL_PREFIX + sample.quantity, encode_sample(sample), sample.received_ns, sample.measured_ns)

    def write_raw(self, frame: Frame) -> None:
        """Record a frame undecoded, so that a decoding mistake found later costs nothing."""
        stamp = frame.received_ns if frame.stamped_ns is None else frame.stamped_ns
        topic = raw_topic(frame.protocol, frame.origin)
        self.write(topic, encode_raw(topic, frame), frame.received_ns, stamp)

    def write_position(
        self, latitude_deg: float, longitude_deg: float, received_ns: int, measured_ns: int, fix: Fix = _NO_FIX
    ) -> None:
        """Record a position for the map panels of viewers, with the height and the errors that its fix tells."""
        east, north, up = (sigma_m**2 for sigma_m in fix.sigma_m or (0.0, 0.0, 0.0))
        body = {
            "timestamp": _timestamp(measured_ns),
            "frame_id": "WGS84",
            "latitude": latitude_deg,
            "longitude": longitude_deg,
            "altitude": fix.height_m or 0.0,
            "position_covariance": [east, 0.0, 0.0, 0.0, north, 0.0, 0.0, 0.0, up],
            "position_covariance_type": 0 if fix.sigma_m is None else _DIAGONAL_KNOWN,
        }
        self.write(POSITION_TOPIC, encode(POSITION_TOPIC, body), received_ns, measured_ns)

    def write_event(self, message: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Record a message for people: an event mark, a source that failed, a switch of devices."""
        time, number = _timestamp(received_ns), _LEVELS[level]
        body = {"timestamp": time, "level": number, "message": message, "name": name}
        self.write(EVENT_TOPIC, encode(EVENT_TOPIC, body), received_ns, received_ns)

    def write_health(self, health: dict[str, Any], received_ns: int) -> None:
        """Record the state of one source."""
        self.write(HEALTH_TOPIC, encode(HEALTH_TOPIC, health), received_ns, received_ns)

    def write_prediction(self, data: bytes, geojson: bytes, received_ns: int, start_ns: int) -> None:
        """Record what another program foretells from ``start_ns`` on, and what a map draws of it, if anything."""
        self.write(PREDICTION_TOPIC, data, received_ns, start_ns)
        if geojson:
            self.write(PREDICTED_TRACK_TOPIC, geojson, received_ns, start_ns)


def _timestamp(time_ns: int) -> dict[str, int]:
    return {"seconds": time_ns // NANO, "nanos": time_ns % NANO}


def frame_of(topic: Topic, data: bytes, log_ns: int, publish_ns: int) -> Frame:
    """The frame that a raw message holds: the inverse of :meth:`MessageSink.write_raw`.

    Raises ValueError, KeyError or TypeError for what is no raw message of ours.
    """
    _, _, protocol, origin = topic.name.split("/", maxsplit=3)
    body = decode(topic, data)
    stamped_ns = publish_ns if publish_ns != log_ns else None
    times = log_ns, int(body["monotonic_ns"])
    sent = {"stamped_ns": stamped_ns, "sender": body.get("sender", "")}
    if protocol == "can":
        identifier, flags = int(body["id"]), FrameFlag(body["flags"])
        return Frame(origin, "can", body["data"], *times, identifier, flags, **sent)
    if protocol == "nmea0183":
        return Frame(origin, "nmea0183", body["sentence"].encode("latin-1"), *times, **sent)
    if protocol == "mavlink":
        return Frame(origin, "mavlink", body["data"], *times, **sent)
    if protocol == "mqtt":
        payload = body["topic"].encode() + b"\0" + body["data"]
        return Frame(origin, "mqtt", payload, *times, flags=FrameFlag(body["flags"]), **sent)
    raise ValueError(f"protocol {protocol!r} is not known")
