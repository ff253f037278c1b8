"""What the messages of a recording's topics hold; every topic has a schema, or viewers skip it.

The descriptions are in the words of JSON Schema, and become protobuf in
:mod:`seatrial.acquisition.recording.descriptors`. That of ``/prediction`` is also what the recorder holds a
prediction, which comes as JSON, against before it takes it.
"""

from __future__ import annotations

from collections.abc import Mapping

from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.recording.descriptors import MessageKind, Schema

RAW_PREFIX = "/raw/"
CHANNEL_PREFIX = "/channel/"
POSITION_TOPIC = "/position"
EVENT_TOPIC = "/event"
HEALTH_TOPIC = "/health"
PREDICTION_TOPIC = "/prediction"
PREDICTED_TRACK_TOPIC = "/prediction/track"

MOST_SECONDS = 601
_MOST_LETTERS = 200


def _value(kind: str, description: str, kind_of_protobuf: str = "") -> Schema:
    form = {"format": kind_of_protobuf} if kind_of_protobuf else {}
    return {"type": kind, "description": description, **form}


def _number(description: str) -> Schema:
    return _value("number", description)


def _string(description: str) -> Schema:
    return _value("string", description)


def _text(description: str) -> Schema:
    return {"type": "string", "maxLength": _MOST_LETTERS, "description": description}


def _array(items: Schema, most: int, description: str) -> Schema:
    return {"type": "array", "items": items, "maxItems": most, "description": description}


def _numbers(description: str) -> Schema:
    return _array({"type": "number"}, MOST_SECONDS, description)


def _channels(description: str) -> Schema:
    return _array({"type": "string", "maxLength": _MOST_LETTERS}, 64, description)


def _object(about: str, unknown: tuple[str, ...] = (), /, **properties: Schema) -> Schema:
    """An object; those of its properties that are named ``unknown`` may be left out."""
    required = [name for name in properties if name not in unknown]
    return {"type": "object", "description": about, "properties": properties, "required": required}


_RECEIVED = _value("integer", "When it was received, on the recorder's monotonic clock [ns]", "sfixed64")
SAMPLE = MessageKind(
    "seatrial.Sample",
    _object(
        "One value of a channel, whose unit and range its metadata say. The numbers are of fixed size, always "
        "there, and first: they lie at the same places in every message",
        value=_number("In the channel's unit"),
        source_time=_number(
            "When the source says it was measured, UTC since 1970 [s]; not a number if it does not"
        ),
        monotonic_ns=_RECEIVED,
        quality=_value("integer", "1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing", "fixed32"),
        source=_string("Which line, device and message it came from, or how it was derived"),
        source_clock=_string("The clock of publish_time"),
    ),
)


def _raw(title: str, about: str, **fields: Schema) -> MessageKind:
    """Input as received, when it was, and from whom."""
    sender = _string("Who sent it over a network, by address; else empty")
    return MessageKind(title, _object(about, **fields, monotonic_ns=_RECEIVED, sender=sender))


_RAW = {
    "can": _raw(
        "seatrial.RawCan",
        "One CAN frame as received",
        id=_value("integer", "Arbitration identifier", "fixed32"),
        flags=_value(
            "integer",
            "1 standard identifier, 2 remote, 4 error, 8 put together by a gateway, 16 stamped late",
            "fixed32",
        ),
        data=_value("string", "The data bytes", "bytes"),
    ),
    "nmea0183": _raw(
        "seatrial.RawNmea0183",
        "One line as received, without its line end",
        sentence=_string("The bytes of the line as Latin-1"),
    ),
    "mqtt": _raw(
        "seatrial.RawMqtt",
        "One MQTT message as received",
        topic=_string("Its topic"),
        flags=_value("integer", "16 stamped late, 32 retained by the broker, of unknown age", "fixed32"),
        data=_value("string", "The bytes of its payload", "bytes"),
    ),
    "mavlink": _raw(
        "seatrial.RawMavlink",
        "Bytes of a MAVLink stream as received",
        data=_value("string", "The bytes", "bytes"),
    ),
}

# Foxglove's well-known schemas: the fields that are used, under their published numbers.
_TIME = {"type": "object", "title": "time"}
_LOCATION_FIX = MessageKind(
    "foxglove.LocationFix",
    _object(
        "A navigation satellite fix",
        timestamp={**_TIME, "number": 6},
        frame_id={"type": "string", "number": 7},
        latitude={**_number("[deg]"), "number": 1},
        longitude={**_number("[deg]"), "number": 2},
        altitude={
            **_number("Above the ellipsoid, or the mean sea level if no other is told [m]; 0 if it is not known"),
            "number": 3,
        },
        position_covariance={
            "type": "array",
            "items": {"type": "number"},
            "description": "Of east, north, up [m2], row by row",
            "number": 4,
        },
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
    _object(
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
        line=_value("integer", "", "fixed32"),
    ),
)
_GEOJSON = MessageKind(
    "foxglove.GeoJSON",
    _object("GeoJSON data for annotating maps", geojson=_string("GeoJSON data encoded as a UTF-8 string")),
)

_HEALTH = MessageKind(
    "seatrial.Health",
    _object(
        "The state of one source, or of the computer's clock",
        ("age_s", "error_s", "pps_offset_s"),
        source=_string("Its name; that of the clock is `host clock`"),
        state=_string(
            "opening, open, silent, failed or ended; of the clock: kept by NTP or PTP, free-running, unknown"
        ),
        frames=_value("integer", "Received since the start"),
        rejected=_value("integer", "Frames and values that came and were not believed"),
        reasons={
            "type": "object",
            "properties": {},
            "additionalProperties": {"type": "integer"},
            "description": "How many of them, by reason",
        },
        dropped=_value("integer", "Frames lost for want of room, here or in the system, or over the budget"),
        age_s=_number("Since the last frame [s]; left out if there was none"),
        over_budget=_value("integer", "Of those that were dropped, how many were over the source's budget"),
        keeper=_string("Of the clock: the programs that keep it"),
        error_s=_number("Of the clock: a bound of its error, as far as its keeper tells [s]"),
        pps_offset_s=_number("Of the clock: how late the last pulse a second was by it [s]"),
    ),
)

ARRAYS = {
    "seconds": True, "north_m": True, "east_m": True, "heading_deg": True, "band_m": False, "band_along_m": False,
    "band_across_m": False, "latitude_deg": False, "longitude_deg": False,
}  # fmt: skip
"""The arrays of a predicted track; those that need not be known may be empty."""

_TRACK = _object(
    "The predicted track, one element a second; arrays of what is not known are empty",
    seconds=_numbers("Since the start of the prediction [s]"),
    north_m=_numbers("Position north of the trial's origin [m]"),
    east_m=_numbers("Position east of the trial's origin [m]"),
    heading_deg=_numbers("Heading from true north, clockwise [deg]"),
    band_m=_numbers("Radius of the circle about the region [m]; empty without a calibrator"),
    band_along_m=_numbers("How far the region that holds the position in 95 of 100 cases reaches ahead [m]"),
    band_across_m=_numbers("How far it reaches to either side of the course [m]"),
    latitude_deg=_numbers("Latitude, WGS 84 [deg]; empty where the trial's origin is not known"),
    longitude_deg=_numbers("Longitude, WGS 84 [deg]; empty where the trial's origin is not known"),
)
_ERROR = _object(
    "How far off the prediction was whose horizon has just passed; left out if there is none that can be judged",
    ("inside_band",),
    start=_number("The instant that it started from, UTC since 1970 [s]"),
    method=_text("Who spoke then"),
    thrusters_moved=_value(
        "boolean", "Whether a thruster moved in its horizon otherwise than planned: no part of the means"
    ),
    mean_distance_m=_number("Distance between predicted and measured position, mean over its seconds [m]"),
    end_distance_m=_number("The same at the end of the horizon [m]"),
    along_m=_number("Predicted too far ahead along the measured heading, at the end [m]"),
    across_m=_number("Predicted too far to starboard of the measured heading, at the end [m]"),
    heading_deg=_number("Difference of the headings, mean of its size over its seconds [deg]"),
    inside_band=_number("Share of its seconds in which the position lay inside the band"),
)
_RUNNING = _object(
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
    **_object(
        "The track of the next seconds with thrusters held or as planned, made while the trial is recorded",
        ("error", "planned_channels", "band_factor"),
        start=_number("The instant that the prediction starts from, UTC since 1970 [s]"),
        made_at=_number("When it was made, UTC since 1970 [s]"),
        latency_s=_number("From the reception of the newest sample that went into it until it was made [s]"),
        horizon_s=_number("How far it goes [s]"),
        method=_text("Who speaks: hybrid (the calibrator), reference or constant_velocity"),
        vessel=_text("The simulation model"),
        calibrator=_text("The calibrator's folder; empty without one"),
        outside_training_range=_value(
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

_WELL_KNOWN = {
    POSITION_TOPIC: _LOCATION_FIX,
    EVENT_TOPIC: _LOG,
    HEALTH_TOPIC: _HEALTH,
    PREDICTION_TOPIC: MessageKind(PREDICTION["title"], PREDICTION),
    PREDICTED_TRACK_TOPIC: _GEOJSON,
}


def kind_of(topic: str) -> MessageKind:
    """What the messages of a topic of ours are. Raises KeyError for any other topic."""
    if topic.startswith(CHANNEL_PREFIX):
        return SAMPLE
    return _RAW[topic.split("/")[2]] if topic.startswith(RAW_PREFIX) else _WELL_KNOWN[topic]


def channel_metadata(topic: str, channels: Mapping[str, Channel] = BY_NAME) -> dict[str, str]:
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


def raw_topic(protocol: str, origin: str) -> str:
    """The topic of one line's undecoded input."""
    return f"{RAW_PREFIX}{protocol}/{origin}"
