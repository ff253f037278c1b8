"""Predictions that another program makes of the ship while she is recorded: checked, few, and bounded.

The recorder knows nothing of how they are made. It takes what fits the topic's schema, a few a second, and refuses
the rest with a word: whatever the other program does, the recording of the ship comes first.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.logger.health import Health
from seatrial.acquisition.recording.messages import encode
from seatrial.acquisition.recording.schemas import ARRAYS, PREDICTED_TRACK_TOPIC, PREDICTION, PREDICTION_TOPIC

MOST_PER_S = 2.0
_MOST_AT_ONCE = 4  # after a pause; then no more than MOST_PER_S
_MOST_GEOJSON_LETTERS = 32_768
_LARGEST = 1e12
_KINDS: dict[str, tuple[type, ...]] = {
    "number": (int, float), "integer": (int,), "string": (str,), "boolean": (bool,), "object": (dict,),
    "array": (list,),
}  # fmt: skip


class RecordedPrediction(NamedTuple):
    """A prediction that was taken in: when on the monotonic clock [ns], the instant that it starts from [ns UTC],
    and the messages that it becomes; that for a map may be empty.
    """

    monotonic_ns: int
    start_ns: int
    data: bytes
    geojson: bytes


def schema_violation(value: Any, schema: Mapping[str, Any], name: str = "it") -> str:
    """In what a JSON value does not fit a schema of ours; nothing if it does.

    Understands what our schemas say: types, properties, required ones, items and the longest array or text. What
    a schema does not name is refused.
    """
    kind = schema["type"]
    if not isinstance(value, _KINDS[kind]) or (isinstance(value, bool) and kind != "boolean"):
        return f"{name} is no {kind}"
    if isinstance(value, int | float) and not abs(value) <= _LARGEST:  # nor is it not a number
        return f"{name} is no number that can be meant"
    if isinstance(value, dict):
        return _misfit_of_object(value, schema, name)
    if isinstance(value, list):
        if len(value) > schema["maxItems"]:
            return f"{name} has more than {schema['maxItems']} items"
        texts = (schema_violation(item, schema["items"], f"an item of {name}") for item in value)
        return next(filter(None, texts), "")
    if isinstance(value, str) and len(value) > schema["maxLength"]:
        return f"{name} has more than {schema['maxLength']} letters"
    return ""


def _misfit_of_object(value: dict[str, Any], schema: Mapping[str, Any], name: str) -> str:
    properties = schema["properties"]
    if missing := [key for key in schema["required"] if key not in value]:
        return f"{missing[0]} is missing"
    for key, entry in value.items():
        if key not in properties:
            return f"{name} has an unknown {key[:40]!r}"
        if text := schema_violation(entry, properties[key], key):
            return text
    return ""


def parse_prediction(message: Mapping[str, Any]) -> RecordedPrediction:
    """What a client said, as what is recorded. Raises :class:`InputError` for what does not fit the schema."""
    body, geojson = message["prediction"], message.get("geojson", "")
    text = schema_violation(body, PREDICTION, "a prediction") or _misfit_of_track(body["track"])
    if not isinstance(geojson, str) or len(geojson) > _MOST_GEOJSON_LETTERS:
        text = text or f"geojson is no text of at most {_MOST_GEOJSON_LETTERS} letters"
    if text:
        raise InputError("is no prediction that can be recorded", why=text)
    drawn = encode(PREDICTED_TRACK_TOPIC, {"geojson": geojson}) if geojson else b""
    start_ns = round(body["start"] * 1e9)
    return RecordedPrediction(time.monotonic_ns(), start_ns, encode(PREDICTION_TOPIC, body), drawn)


def _misfit_of_track(track: Mapping[str, list[float]]) -> str:
    """Arrays that go with each other are equally long; what is not known is empty."""
    length = len(track["seconds"])
    wrong = [name for name in ARRAYS if len(track[name]) != length and (track[name] or ARRAYS[name])]
    return f"{wrong[0]} of the track is not as long as its seconds" if wrong else ""


class Predictions:
    """Predictions on their way into a recording: one thread puts them in, the recorder's takes them out."""

    def __init__(self, health: Health) -> None:
        self._health = health
        self._waiting: deque[RecordedPrediction] = deque()
        self._allowed, self._looked_s = float(_MOST_AT_ONCE), time.monotonic()

    def offer(self, message: Mapping[str, Any]) -> str:
        """Take one in. Returns why not, or nothing; what is refused is counted."""
        try:
            foretold = parse_prediction(message)
        except (InputError, ValueError) as error:  # the latter for halves of letters
            self._health.predictions_refused += 1
            return str(error)
        if not self._has_room():
            self._health.predictions_refused += 1
            return f"more than {MOST_PER_S:g} predictions a second"
        self._waiting.append(foretold)
        return ""

    def take(self) -> list[RecordedPrediction]:
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def _has_room(self) -> bool:
        now_s = time.monotonic()
        self._allowed = min(self._allowed + (now_s - self._looked_s) * MOST_PER_S, float(_MOST_AT_ONCE))
        self._looked_s = now_s
        if self._allowed < 1.0 or len(self._waiting) >= _MOST_AT_ONCE:
            return False
        self._allowed -= 1.0
        return True
