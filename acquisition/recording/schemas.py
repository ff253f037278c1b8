"""The JSON schemas of a recording's topics; every topic has one, or viewers skip it."""

from __future__ import annotations

import json
from typing import Any

from acquisition.core.channel import Channel
from acquisition.core.channels import BY_NAME
from acquisition.recording.prediction_schema import PREDICTION

RAW_PREFIX = "/raw/"
CHANNEL_PREFIX = "/channel/"
POSITION_TOPIC = "/position"
EVENT_TOPIC = "/event"
HEALTH_TOPIC = "/health"
PREDICTION_TOPIC = "/prediction"
PREDICTED_TRACK_TOPIC = "/prediction/track"

_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
}


def _object(title: str, description: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"title": title, "description": description, "type": "object", "properties": properties}


def _channel_schema(channel: Channel) -> dict[str, Any]:
    interval = "one turn, half open" if channel.circular else "inclusive"
    limits = f"{channel.low:g} to {channel.high:g}, {interval}"
    return _object(
        f"seatrial.{channel.name}",
        f"{channel.meaning} [{channel.unit}]",
        {
            "value": {
                "type": "number",
                "description": f"{channel.meaning} [{channel.unit}], {limits}",
            },
            "source": {
                "type": "string",
                "description": "Which line, device and message it came from, or how it was derived",
            },
            "quality": {
                "type": "integer",
                "description": "1 good, 2 not evaluated, 3 suspect, 4 bad, 9 missing",
            },
            "source_time": {
                "type": "number",
                "description": "When the source says it was measured, UTC since 1970 [s]; left out if it does not",
            },
            "source_clock": {"type": "string", "description": "The clock of publish_time"},
            "monotonic_ns": {
                "type": "integer",
                "description": "When it was received, on the recorder's monotonic clock [ns]",
            },
        },
    )


_RAW: dict[str, dict[str, Any]] = {
    "can": _object(
        "seatrial.RawCan",
        "One CAN frame as received",
        {
            "id": {"type": "integer", "description": "Arbitration identifier"},
            "flags": {"type": "integer", "description": "1 standard identifier, 2 remote, 4 error"},
            "data": {"type": "string", "description": "The data bytes, hexadecimal"},
            "monotonic_ns": {"type": "integer", "description": "Received, monotonic clock [ns]"},
        },
    ),
    "nmea0183": _object(
        "seatrial.RawNmea0183",
        "One line as received, without its line end",
        {
            "sentence": {"type": "string", "description": "The bytes of the line as Latin-1"},
            "monotonic_ns": {"type": "integer", "description": "Received, monotonic clock [ns]"},
        },
    ),
    "mavlink": _object(
        "seatrial.RawMavlink",
        "Bytes of a MAVLink stream as received",
        {
            "data": {"type": "string", "description": "The bytes, hexadecimal"},
            "monotonic_ns": {"type": "integer", "description": "Received, monotonic clock [ns]"},
        },
    ),
}

# Foxglove's well-known schemas, reduced to JSON Schema from their published field lists.
_LOCATION_FIX = _object(
    "foxglove.LocationFix",
    "A navigation satellite fix",
    {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "latitude": {"type": "number", "description": "[deg]"},
        "longitude": {"type": "number", "description": "[deg]"},
        "altitude": {"type": "number", "description": "[m]"},
        "position_covariance": {"type": "array", "items": {"type": "number"}, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {"type": "integer", "description": "0 unknown"},
    },
)
_LOG = _object(
    "foxglove.Log",
    "A message for people",
    {
        "timestamp": _TIME,
        "level": {"type": "integer", "description": "1 debug, 2 info, 3 warning, 4 error, 5 fatal"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
)
_HEALTH = _object(
    "seatrial.Health",
    "The state of one source",
    {
        "source": {"type": "string"},
        "state": {"type": "string", "description": "opening, open, silent, failed or ended"},
        "frames": {"type": "integer", "description": "Received since the start"},
        "rejected": {"type": "integer", "description": "Frames and values that came and were not believed"},
        "reasons": {
            "type": "object",
            "properties": {},
            "additionalProperties": {"type": "integer"},
            "description": "How many of them, by reason",
        },
        "dropped": {"type": "integer", "description": "Frames lost because the queue was full"},
        "age_s": {"type": "number", "description": "Since the last frame [s]; left out if there was none"},
    },
)
_GEOJSON = _object(
    "foxglove.GeoJSON",
    "GeoJSON data for annotating maps",
    {"geojson": {"type": "string", "description": "GeoJSON data encoded as a UTF-8 string"}},
)
_WELL_KNOWN = {
    POSITION_TOPIC: _LOCATION_FIX,
    EVENT_TOPIC: _LOG,
    HEALTH_TOPIC: _HEALTH,
    PREDICTION_TOPIC: PREDICTION,
    PREDICTED_TRACK_TOPIC: _GEOJSON,
}


def schema_of(topic: str) -> tuple[str, bytes]:
    """The schema's name and its JSON text for a topic of ours. Raises KeyError for any other topic."""
    if topic.startswith(CHANNEL_PREFIX):
        schema = _channel_schema(BY_NAME[topic.removeprefix(CHANNEL_PREFIX)])
    elif topic.startswith(RAW_PREFIX):
        schema = _RAW[topic.split("/")[2]]
    else:
        schema = _WELL_KNOWN[topic]
    return str(schema["title"]), json.dumps(schema).encode()


def raw_topic(protocol: str, origin: str) -> str:
    """The topic of one line's undecoded input."""
    return f"{RAW_PREFIX}{protocol}/{origin}"
