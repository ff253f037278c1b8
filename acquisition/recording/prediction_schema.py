"""The schema of ``/prediction``: where the ship will be in the next seconds, and how far off that was before.

It is a JSON Schema for viewers, and what the recorder holds a prediction against before it takes it. What is not
known is left out: Lichtblick reads no schema in which something has two types, be the second one null.
"""

from __future__ import annotations

from typing import Any

MOST_SECONDS = 601
_MOST_LETTERS = 200

Schema = dict[str, Any]


def _number(description: str) -> Schema:
    return {"type": "number", "description": description}


def _text(description: str) -> Schema:
    return {"type": "string", "maxLength": _MOST_LETTERS, "description": description}


def _numbers(description: str) -> Schema:
    return {
        "type": "array",
        "items": {"type": "number"},
        "maxItems": MOST_SECONDS,
        "description": description,
    }


def _object(description: str, properties: dict[str, Schema], unknown: tuple[str, ...] = ()) -> Schema:
    """An object; those of its properties that are named ``unknown`` may be left out."""
    required = [name for name in properties if name not in unknown]
    return {"type": "object", "description": description, "properties": properties, "required": required}


ARRAYS = {
    "seconds": True, "north_m": True, "east_m": True, "heading_deg": True, "band_m": False, "latitude_deg": False,
    "longitude_deg": False,
}  # fmt: skip
"""The arrays of a track; those that need not be known may be empty."""

_TRACK = _object(
    "The predicted track, one element a second; arrays of what is not known are empty",
    {
        "seconds": _numbers("Since the start of the prediction [s]"),
        "north_m": _numbers("Position north of the trial's origin [m]"),
        "east_m": _numbers("Position east of the trial's origin [m]"),
        "heading_deg": _numbers("Heading from true north, clockwise [deg]"),
        "band_m": _numbers("Radius that holds the position in 95 of 100 cases [m]; empty without a calibrator"),
        "latitude_deg": _numbers("Latitude, WGS 84 [deg]; empty where the trial's origin is not known"),
        "longitude_deg": _numbers("Longitude, WGS 84 [deg]; empty where the trial's origin is not known"),
    },
)
_ERROR = _object(
    "How far off the prediction was whose horizon has just passed; left out if there is none that can be judged",
    {
        "start": _number("The instant that it started from, UTC since 1970 [s]"),
        "method": _text("Who spoke then"),
        "thrusters_moved": {
            "type": "boolean",
            "description": "Whether a thruster moved in its horizon, which it could not know: no part of the means",
        },
        "mean_distance_m": _number("Distance between predicted and measured position, mean over its seconds [m]"),
        "end_distance_m": _number("The same at the end of the horizon [m]"),
        "along_m": _number("Predicted too far ahead along the measured heading, at the end [m]"),
        "across_m": _number("Predicted too far to starboard of the measured heading, at the end [m]"),
        "heading_deg": _number("Difference of the headings, mean of its size over its seconds [deg]"),
        "inside_band": _number("Share of its seconds in which the position lay inside the band"),
    },
    unknown=("inside_band",),
)
_RUNNING = _object(
    "Means over the predictions of the last minutes in whose horizon no thruster moved; left out if there is none",
    {
        "over_s": _number("So far back [s]"),
        "predictions": _number("How many were judged"),
        "left_out": _number("How many more were not, as a thruster moved in their horizon"),
        "mean_distance_m": _number("Mean of mean_distance_m [m]"),
        "end_distance_m": _number("Mean of end_distance_m [m]"),
        "along_m": _number("Mean of along_m, with its sign [m]"),
        "across_m": _number("Mean of across_m, with its sign [m]"),
        "heading_deg": _number("Mean of heading_deg [deg]"),
        "inside_band": _number("Mean of inside_band; 0.95 is what the band promises"),
    },
    unknown=("mean_distance_m", "end_distance_m", "along_m", "across_m", "heading_deg", "inside_band"),
)

PREDICTION: Schema = {
    "title": "seatrial.Prediction",
    **_object(
        "The track of the next seconds with thrusters and wind held, made while the trial is recorded",
        {
            "start": _number("The instant that the prediction starts from, UTC since 1970 [s]"),
            "made_at": _number("When it was made, UTC since 1970 [s]"),
            "latency_s": _number("From the reception of the newest sample that went into it until it was made [s]"),
            "horizon_s": _number("How far it goes [s]"),
            "method": _text("Who speaks: hybrid (the calibrator), reference or constant_velocity"),
            "vessel": _text("The simulation model"),
            "calibrator": _text("The calibrator's folder; empty without one"),
            "outside_training_range": {
                "type": "boolean",
                "description": "Whether the start lies beyond what the calibrator was trained on",
            },
            "held_channels": {
                "type": "array",
                "items": {"type": "string", "maxLength": _MOST_LETTERS},
                "maxItems": 13,
                "description": "Channels whose newest sample is older than the start and was held to it",
            },
            "track": _TRACK,
            "error": _ERROR,
            "running": _RUNNING,
        },
        unknown=("error",),
    ),
}
