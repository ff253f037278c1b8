"""Defines what a recording's messages hold: samples, raw frames, fixes, events, health, predictions, as protobuf.

Everything that takes messages (one file, a recording in parts, a live view) is a :class:`MessageSink`. Earlier
recordings had the same messages in JSON, and are decoded to the same.

Every topic has a schema, or viewers skip it. Schemas are descriptions in the words of JSON Schema, from which
protobuf classes and the descriptors that a recording carries are made. Beyond JSON Schema they may give the
``format`` of a number that is neither protobuf's ``double`` nor ``int64``, the ``number`` of a field where fields
are not numbered in their order, and the ``names`` of an enumeration's values. What an object does not require is an
``optional`` field. The recorder also checks predictions, which come as JSON, against their description.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeAlias

import orjson
from google.protobuf import descriptor_pb2, timestamp_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, Message
from google.protobuf.message_factory import GetMessageClass

from seatrial.acquisition.core import process, ship
from seatrial.acquisition.core.trial import NANO, Fix, Frame, FrameFlag, Sample, Trial

RAW_PREFIX = "/raw/"
CHANNEL_PREFIX = "/channel/"
POSITION_TOPIC = "/position"
EVENT_TOPIC = "/event"
HEALTH_TOPIC = "/health"
PREDICTION_TOPIC = "/prediction"
PREDICTED_TRACK_TOPIC = "/prediction/track"

MOST_SECONDS = 601
_MOST_LETTERS = 200

ENCODING = "protobuf"
"""How messages are encoded, in MCAP's words."""
ENCODING_BEFORE = "json"

_PLAIN = (str, bytes, int, float)
_NOT_STATED = float("nan")
_NO_FIX = Fix()
_DIAGONAL_KNOWN = 2
_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}
_NUMBERS = struct.Struct("<BdBdBqBI")  # the first four fields of a sample, each behind its tag
_VALUE, _SOURCE_TIME, _MONOTONIC, _QUALITY = 1 << 3 | 1, 2 << 3 | 1, 3 << 3 | 1, 4 << 3 | 5
_CAN, _RECEIVED_FIELD = struct.Struct("<BIBIBB"), struct.Struct("<Bq")  # the fields of a CAN frame, but its data
_IDENTIFIER, _FLAGS, _DATA, _RECEIVED_AT = 1 << 3 | 5, 2 << 3 | 5, 3 << 3 | 2, 4 << 3 | 1
_LONG_DATA_BYTES = 128  # from here on data have their length in two bytes
VALUE_AT, QUALITY_AT, SOURCE_AT = 1, 28, 32
"""Where in a sample's message these begin."""
SAMPLE_TAGS = (0, _VALUE), (9, _SOURCE_TIME), (18, _MONOTONIC), (27, _QUALITY)
"""Where in a sample's message the tags of its numbers stand, and what they are."""

Schema: TypeAlias = dict[str, Any]

_FORMATS = {"number": "double", "integer": "int64", "string": "string", "boolean": "bool"}
_TIMESTAMP = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
_FIELD = descriptor_pb2.FieldDescriptorProto
_MESSAGES_OF_FILE, _FIELDS, _MESSAGES = 4, 2, 3  # where in descriptors these stand: what comments refer to


def encode(topic: str, body: dict[str, Any]) -> bytes:
    """The message of a topic of ours with these fields. Raises TypeError, ValueError or KeyError if none fits."""
    if not topic.startswith(CHANNEL_PREFIX):
        return bytes(message_kind_of_topic(topic).message(**body).SerializeToString())
    fields = {"source_time": _NOT_STATED, "monotonic_ns": 0, "source_clock": "", **body}
    numbers = (float(fields["value"]), fields["source_time"], fields["monotonic_ns"], int(fields["quality"]))
    return _encode_number_fields(*numbers) + _encode_source(fields["source"], fields["source_clock"])


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
    def has_fixed_field_offsets(self) -> bool:
        """Whether the numbers of its messages, samples, lie where :func:`encode_sample` puts them, or may."""
        return self.encoding == ENCODING and _field_layout(self.name, self.schema) == _field_layout(self.name, b"")


def decode(topic: Topic, data: bytes) -> dict[str, Any]:
    """What a message of a topic of ours says, by the schema of its file, or in JSON as it was before.

    Raises KeyError for another topic, ValueError if the message is none of its.
    """
    try:
        if topic.encoding == ENCODING_BEFORE:
            return _decode_json(topic.name, data)
        return message_fields(_message_class_of_schema(topic.name, topic.schema).FromString(data))
    except (DecodeError, TypeError) as error:
        raise ValueError(str(error)) from error


def level_name(level: Any) -> str:
    """The name of an event's level by its number; empty for none that is known."""
    return _LEVEL_NAMES.get(level, "") if isinstance(level, int) else ""


@lru_cache(maxsize=256)
def _message_class_of_schema(name: str, schema: bytes) -> Any:
    """The class of a topic's messages by the schema that a file gives; fields may have had other numbers."""
    kind = message_kind_of_topic(name)
    if len(schema) > process.TEXT_BYTES.allowed_amount(0):
        raise ValueError(f"its schema has {len(schema):,} bytes")
    return kind.message if schema in (b"", kind.descriptors) else message_class(kind.title, schema)


@lru_cache(maxsize=256)
def _field_layout(name: str, schema: bytes) -> set[tuple[str, int, int]]:
    return {
        (entry.name, entry.number, entry.type) for entry in _message_class_of_schema(name, schema).DESCRIPTOR.fields
    }


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
    source_time = _NOT_STATED if sample.source_ns is None else sample.source_ns / NANO
    numbers = _encode_number_fields(sample.value, source_time, sample.monotonic_ns, sample.quality)
    return numbers + _encode_source(sample.source, sample.clock)


def _encode_number_fields(value: float, source_time: float, monotonic_ns: int, quality: int) -> bytes:
    return _NUMBERS.pack(_VALUE, value, _SOURCE_TIME, source_time, _MONOTONIC, monotonic_ns, _QUALITY, quality)


@lru_cache(maxsize=1024)
def _encode_source(source: str, clock: str) -> bytes:
    """The last two fields of a sample: thousands of samples have the same."""
    return bytes(SAMPLE.message(source=source, source_clock=clock).SerializeToString())


def encode_raw(topic: str, frame: Frame) -> bytes:
    """A raw frame's message. That of CAN is packed at once: a full bus has 1,900 a second."""
    payload = frame.payload
    if frame.protocol == "can" and len(payload) < _LONG_DATA_BYTES:
        head = _CAN.pack(_IDENTIFIER, frame.identifier, _FLAGS, frame.flags, _DATA, len(payload))
        received = _RECEIVED_FIELD.pack(_RECEIVED_AT, frame.monotonic_ns)
        return head + payload + received + _encode_sender(frame.sender)
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
def _encode_sender(sender: str) -> bytes:
    return bytes(message_kind_of_topic("/raw/can/").message(sender=sender).SerializeToString())


class MessageSink(ABC):
    """Turns what the recorder reports into messages; subclasses say where they go."""

    @abstractmethod
    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Take one message, encoded, received at ``log_ns`` and measured at ``publish_ns``, UTC since 1970."""

    @abstractmethod
    def write_trial(self, trial: Trial) -> None:
        """Write what is known of the trial again, once more is known; the last one holds."""

    def write_sample(self, sample: Sample) -> None:
        """Record one value on its channel's topic; ``value`` must be finite."""
        self.write(CHANNEL_PREFIX + sample.quantity, encode_sample(sample), sample.received_ns, sample.measured_ns)

    def write_raw(self, frame: Frame) -> None:
        """Record a frame undecoded, so that a decoding mistake found later costs nothing."""
        stamp = frame.received_ns if frame.stamped_ns is None else frame.stamped_ns
        topic = f"{RAW_PREFIX}{frame.protocol}/{frame.origin}"
        self.write(topic, encode_raw(topic, frame), frame.received_ns, stamp)

    def write_position(
        self, latitude_deg: float, longitude_deg: float, received_ns: int, measured_ns: int, fix: Fix = _NO_FIX
    ) -> None:
        """Record a position for the map panels of viewers, with the height and the errors that its fix states."""
        east, north, up = (sigma_m**2 for sigma_m in fix.sigma_m or (0.0, 0.0, 0.0))
        body = {
            "timestamp": _timestamp_dict(measured_ns),
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
        time, number = _timestamp_dict(received_ns), _LEVELS[level]
        body = {"timestamp": time, "level": number, "message": message, "name": name}
        self.write(EVENT_TOPIC, encode(EVENT_TOPIC, body), received_ns, received_ns)

    def write_health(self, health: dict[str, Any], received_ns: int) -> None:
        """Record the state of one source."""
        self.write(HEALTH_TOPIC, encode(HEALTH_TOPIC, health), received_ns, received_ns)

    def write_prediction(self, data: bytes, geojson: bytes, received_ns: int, start_ns: int) -> None:
        """Record what another program predicts from ``start_ns`` on, and what a map draws of it, if anything."""
        self.write(PREDICTION_TOPIC, data, received_ns, start_ns)
        if geojson:
            self.write(PREDICTED_TRACK_TOPIC, geojson, received_ns, start_ns)


def _timestamp_dict(time_ns: int) -> dict[str, int]:
    return {"seconds": time_ns // NANO, "nanos": time_ns % NANO}


def decode_frame(topic: Topic, data: bytes, log_ns: int, publish_ns: int) -> Frame:
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


class MessageKind:
    """A kind of message: its full name, its class, and the ``FileDescriptorSet`` by which any reader knows it."""

    def __init__(self, title: str, schema: Schema) -> None:
        self.title = title
        package, _, name = title.rpartition(".")
        file = descriptor_pb2.FileDescriptorProto(
            name=f"{package}/{name}.proto", package=package, syntax="proto3", dependency=[_TIMESTAMP.name]
        )
        message = file.message_type.add(name=name)
        _fill_descriptor(message, schema, f".{title}", file.source_code_info, [_MESSAGES_OF_FILE, 0])
        self.descriptors = descriptor_pb2.FileDescriptorSet(file=[_TIMESTAMP, file]).SerializeToString()
        self.message = message_class(title, self.descriptors)


def message_class(title: str, descriptors: bytes) -> Any:
    """The class of a message that a ``FileDescriptorSet`` describes.

    It lives in a pool of its own: what another file or program calls so is not meant. Raises ValueError for bytes
    that describe no such message.
    """
    pool = DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(descriptors).file:
            pool.AddSerializedFile(file.SerializeToString())
        return GetMessageClass(pool.FindMessageTypeByName(title))
    except (DecodeError, TypeError, KeyError) as error:
        raise ValueError(f"its schema describes no {title}") from error


def message_fields(message: Message) -> dict[str, Any]:
    """The fields of a message; optional ones and messages within only where they are set."""
    return {
        name: _plain_value(getattr(message, name))
        for name, has_presence in _names_and_presence(message.DESCRIPTOR)
        if not has_presence or message.HasField(name)
    }


@lru_cache(maxsize=256)
def _names_and_presence(descriptor: Any) -> list[tuple[str, bool]]:
    return [(entry.name, entry.has_presence) for entry in descriptor.fields]


def _plain_value(value: Any) -> Any:
    if isinstance(value, _PLAIN):  # first, as most are
        return value
    if isinstance(value, Message):
        return message_fields(value)
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain_value(item) for item in value]


def _fill_descriptor(proto: Any, schema: Schema, full_name: str, comments: Any, path: list[int]) -> None:
    """Put the fields of an object into its descriptor, with their descriptions as comments."""
    comments.location.add(path=path, span=(0, 0, 0), leading_comments=schema.get("description", ""))
    required: Any = schema.get("required", schema["properties"])
    for index, (name, definition) in enumerate(schema["properties"].items()):
        field = proto.field.add(name=name, number=definition.get("number", index + 1), label=_FIELD.LABEL_OPTIONAL)
        if definition["type"] == "array" or "additionalProperties" in definition:
            field.label = _FIELD.LABEL_REPEATED
        _set_field_type(proto, field, definition.get("items", definition), full_name, comments, path)
        if name not in required and field.label != _FIELD.LABEL_REPEATED and field.type != _FIELD.TYPE_MESSAGE:
            field.MergeFrom(_FIELD(proto3_optional=True, oneof_index=len(proto.oneof_decl)))
            proto.oneof_decl.add(name=f"_{name}")
        comments.location.add(
            path=[*path, _FIELDS, index], span=(0, 0, 0), leading_comments=definition.get("description", "")
        )


def _set_field_type(proto: Any, field: Any, schema: Schema, full_name: str, comments: Any, path: list[int]) -> None:
    """Say of which type a field is, and describe that type, if it is one of its own, within the message."""
    type_name = "".join(word.title() for word in field.name.split("_"))
    if "names" in schema:
        field.type, field.type_name = _FIELD.TYPE_ENUM, f"{full_name}.{schema['title']}"
        enumeration = proto.enum_type.add(name=schema["title"])
        for number, name in enumerate(schema["names"]):
            enumeration.value.add(name=name, number=number)
    elif schema["type"] != "object":
        kind = schema.get("format", _FORMATS[schema["type"]])
        field.type = _FIELD.Type.Value(f"TYPE_{kind.upper()}")
    elif schema.get("title") == "time":
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, ".google.protobuf.Timestamp"
    elif "additionalProperties" in schema:
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, f"{full_name}.{type_name}Entry"
        entry = {
            "type": "object",
            "properties": {"key": {"type": "string"}, "value": schema["additionalProperties"]},
        }
        within = proto.nested_type.add(
            name=f"{type_name}Entry", options=descriptor_pb2.MessageOptions(map_entry=True)
        )
        _fill_descriptor(within, entry, field.type_name, comments, [*path, _MESSAGES, len(proto.nested_type) - 1])
    else:
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, f"{full_name}.{type_name}"
        within = proto.nested_type.add(name=type_name)
        _fill_descriptor(within, schema, field.type_name, comments, [*path, _MESSAGES, len(proto.nested_type) - 1])


def _value_schema(kind: str, description: str, **further: Any) -> Schema:
    return {"type": kind, "description": description, **further}


_number, _string = partial(_value_schema, "number"), partial(_value_schema, "string")
_text = partial(_value_schema, "string", maxLength=_MOST_LETTERS)
_list_of_numbers = partial(_value_schema, "array", items={"type": "number"}, maxItems=MOST_SECONDS)
_channels = partial(_value_schema, "array", items={"type": "string", "maxLength": _MOST_LETTERS}, maxItems=64)


def _object_schema(about: str, unknown: tuple[str, ...] = (), /, **properties: Schema) -> Schema:
    """An object; those of its properties that are named ``unknown`` may be left out."""
    required = [name for name in properties if name not in unknown]
    return {"type": "object", "description": about, "properties": properties, "required": required}


_RECEIVED = _value_schema(
    "integer", "When it was received, on the recorder's monotonic clock [ns]", format="sfixed64"
)
SAMPLE = MessageKind(
    "seatrial.Sample",
    _object_schema(
        "One value of a channel, whose unit and range its metadata say. The numbers are of fixed size, always "
        "there, and first: they lie at the same places in every message",
        value=_number("In the channel's unit"),
        source_time=_number(
            "When the source says it was measured, UTC since 1970 [s]; not a number if it does not"
        ),
        monotonic_ns=_RECEIVED,
        quality=_value_schema("integer", "1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing", format="fixed32"),
        source=_string("Which line, device and message it came from, or how it was derived"),
        source_clock=_string("The clock of publish_time"),
    ),
)


def _raw_message_kind(title: str, about: str, **fields: Schema) -> MessageKind:
    """Input as received, when it was, and from whom."""
    sender = _string("Who sent it over a network, by address; else empty")
    return MessageKind(title, _object_schema(about, **fields, monotonic_ns=_RECEIVED, sender=sender))


_RAW = {
    "can": _raw_message_kind(
        "seatrial.RawCan",
        "One CAN frame as received",
        id=_value_schema("integer", "Arbitration identifier", format="fixed32"),
        flags=_value_schema(
            "integer",
            "1 standard identifier, 2 remote, 4 error, 8 put together by a gateway, 16 stamped late",
            format="fixed32",
        ),
        data=_value_schema("string", "The data bytes", format="bytes"),
    ),
    "nmea0183": _raw_message_kind(
        "seatrial.RawNmea0183",
        "One line as received, without its line end",
        sentence=_string("The bytes of the line as Latin-1"),
    ),
    "mqtt": _raw_message_kind(
        "seatrial.RawMqtt",
        "One MQTT message as received",
        topic=_string("Its topic"),
        flags=_value_schema(
            "integer", "16 stamped late, 32 retained by the broker, of unknown age", format="fixed32"
        ),
        data=_value_schema("string", "The bytes of its payload", format="bytes"),
    ),
    "mavlink": _raw_message_kind(
        "seatrial.RawMavlink",
        "Bytes of a MAVLink stream as received",
        data=_value_schema("string", "The bytes", format="bytes"),
    ),
}

# Foxglove's well-known schemas: the fields that are used, under their published numbers.
_TIME = {"type": "object", "title": "time"}
_LOCATION_FIX = MessageKind(
    "foxglove.LocationFix",
    _object_schema(
        "A navigation satellite fix",
        timestamp={**_TIME, "number": 6},
        frame_id={"type": "string", "number": 7},
        latitude=_number("[deg]", number=1),
        longitude=_number("[deg]", number=2),
        altitude=_number(
            "Above the ellipsoid, or the mean sea level if no other is told [m]; 0 if it is not known", number=3
        ),
        position_covariance=_value_schema(
            "array", "Of east, north, up [m2], row by row", items={"type": "number"}, number=4
        ),
        position_covariance_type={
            "type": "integer",
            "title": "PositionCovarianceType",
            "names": ("UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"),
            "number": 5,
        },
    ),
)
_LOG = MessageKind(
    "foxglove.Log",
    _object_schema(
        "A message for people",
        timestamp=_TIME,
        level={
            "type": "integer",
            "title": "Level",
            "names": ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
        },
        message={"type": "string"},
        name={"type": "string"},
        file={"type": "string"},
        line=_value_schema("integer", "", format="fixed32"),
    ),
)
_GEOJSON = MessageKind(
    "foxglove.GeoJSON",
    _object_schema("GeoJSON data for annotating maps", geojson=_string("GeoJSON data encoded as a UTF-8 string")),
)

_HEALTH = MessageKind(
    "seatrial.Health",
    _object_schema(
        "The state of one source or sink, or of the computer's clock",
        ("age_s", "error_s", "pps_offset_s", "sent", "error"),
        source=_string("Its name; that of the clock is `host clock`, that of a sink begins with `sink `"),
        state=_string(
            "opening, open, silent, failed or ended, of a sink also hanging; of the clock: kept by NTP or PTP, "
            "free-running, unknown"
        ),
        frames=_value_schema("integer", "Received since the start"),
        rejected=_value_schema("integer", "Frames and values that came and were not believed"),
        reasons=_value_schema(
            "object", "How many of them, by reason", properties={}, additionalProperties={"type": "integer"}
        ),
        dropped=_value_schema("integer", "Frames lost for want of room, here or in the system, or over the budget"),
        age_s=_number("Since the last frame [s]; left out if there was none"),
        over_budget=_value_schema("integer", "Of those that were dropped, how many were over the source's budget"),
        keeper=_string("Of the clock: the programs that keep it"),
        error_s=_number("Of the clock: a bound of its error, as far as its keeper tells [s]"),
        pps_offset_s=_number("Of the clock: how late the last pulse a second was by it [s]"),
        sent=_value_schema("integer", "Of a sink: the values that were passed on since the start"),
        error=_string("Of a sink: the last error, whether it works again or not"),
    ),
)

ARRAYS = {
    "seconds": True, "north_m": True, "east_m": True, "heading_deg": True, "band_m": False, "band_along_m": False,
    "band_across_m": False, "latitude_deg": False, "longitude_deg": False,
}  # fmt: skip
"""The arrays of a predicted track; those that need not be known may be empty."""

_TRACK = _object_schema(
    "The predicted track, one element a second; arrays of what is not known are empty",
    seconds=_list_of_numbers("Since the start of the prediction [s]"),
    north_m=_list_of_numbers("Position north of the trial's origin [m]"),
    east_m=_list_of_numbers("Position east of the trial's origin [m]"),
    heading_deg=_list_of_numbers("Heading from true north, clockwise [deg]"),
    band_m=_list_of_numbers("Radius of the circle about the region [m]; empty without a calibrator"),
    band_along_m=_list_of_numbers(
        "How far the region that holds the position in 95 of 100 cases reaches ahead [m]"
    ),
    band_across_m=_list_of_numbers("How far it reaches to either side of the course [m]"),
    latitude_deg=_list_of_numbers("Latitude, WGS 84 [deg]; empty where the trial's origin is not known"),
    longitude_deg=_list_of_numbers("Longitude, WGS 84 [deg]; empty where the trial's origin is not known"),
)
_ERROR = _object_schema(
    "How far off the prediction was whose horizon has just passed; left out if there is none that can be judged",
    ("inside_band",),
    start=_number("The instant that it started from, UTC since 1970 [s]"),
    method=_text("Who spoke then"),
    thrusters_moved=_value_schema(
        "boolean", "Whether a thruster moved in its horizon otherwise than planned: no part of the means"
    ),
    mean_distance_m=_number("Distance between predicted and measured position, mean over its seconds [m]"),
    end_distance_m=_number("The same at the end of the horizon [m]"),
    along_m=_number("Predicted too far ahead along the measured heading, at the end [m]"),
    across_m=_number("Predicted too far to starboard of the measured heading, at the end [m]"),
    heading_deg=_number("Difference of the headings, mean of its size over its seconds [deg]"),
    inside_band=_number("Share of its seconds in which the position lay inside the band"),
)
_RUNNING = _object_schema(
    "Means over the predictions of the last minutes whose thrusters were held or as planned; left out if none",
    ("mean_distance_m", "end_distance_m", "along_m", "across_m", "heading_deg", "inside_band"),
    over_s=_number("So far back [s]"),
    predictions=_number("How many were judged"),
    left_out=_number("How many more were not, as a thruster moved otherwise in their horizon"),
    mean_distance_m=_number("Mean of mean_distance_m [m]"),
    end_distance_m=_number("Mean of end_distance_m [m]"),
    along_m=_number("Mean of along_m, with its sign [m]"),
    across_m=_number("Mean of across_m, with its sign [m]"),
    heading_deg=_number("Mean of heading_deg [deg]"),
    inside_band=_number("Mean of inside_band; 0.95 is what the band promises"),
)
PREDICTION: Schema = {
    "title": "seatrial.Prediction",
    **_object_schema(
        "The track of the next seconds with thrusters held or as planned, made while the trial is recorded",
        ("error", "planned_channels", "band_factor"),
        start=_number("The instant that the prediction starts from, UTC since 1970 [s]"),
        made_at=_number("When it was made, UTC since 1970 [s]"),
        latency_s=_number("From the reception of the newest sample that went into it until it was made [s]"),
        horizon_s=_number("How far it goes [s]"),
        method=_text("Who speaks: hybrid (the calibrator), reference or constant_velocity"),
        vessel=_text("The simulation model"),
        calibrator=_text("The calibrator's folder; empty without one"),
        outside_training_range=_value_schema(
            "boolean", "Whether the start lies beyond what the calibrator was trained on"
        ),
        held_channels=_channels("Channels whose newest sample is older than the start and was held to it"),
        planned_channels=_channels("Channels of actuators that followed planned orders; the others were held"),
        band_factor=_number("What the calibrator's band was multiplied by to hold 95 of 100; left out without one"),
        track=_TRACK,
        error=_ERROR,
        running=_RUNNING,
    ),
}

_KINDS = {
    POSITION_TOPIC: _LOCATION_FIX,
    EVENT_TOPIC: _LOG,
    HEALTH_TOPIC: _HEALTH,
    PREDICTION_TOPIC: MessageKind(PREDICTION["title"], PREDICTION),
    PREDICTED_TRACK_TOPIC: _GEOJSON,
}


def message_kind_of_topic(topic: str) -> MessageKind:
    """What the messages of a topic of ours are. Raises KeyError for any other topic."""
    if topic.startswith(CHANNEL_PREFIX):
        return SAMPLE
    return _RAW[topic.split("/")[2]] if topic.startswith(RAW_PREFIX) else _KINDS[topic]


def channel_metadata(topic: str, channels: Mapping[str, ship.Channel] = ship.BY_NAME) -> dict[str, str]:
    """What a topic's record says of it: of a channel its unit, its meaning and the range of possible values.

    ``channels`` are the channels by name. Raises KeyError for another.
    """
    if not topic.startswith(CHANNEL_PREFIX):
        return {}
    channel = channels[topic.removeprefix(CHANNEL_PREFIX)]
    interval = "one turn, half open" if channel.circular else "inclusive"
    return {
        "unit": channel.unit,
        "meaning": channel.meaning,
        "range": f"{channel.low:g} to {channel.high:g}, {interval}",
    }
