"""Values that come and are no channel until a configuration maps them: signals of a DBC file, MQTT topics."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from math import isfinite
from typing import Any, NamedTuple

import orjson
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal

from seatrial.acquisition.config.sections import TopicValue
from seatrial.acquisition.core.frames import Frame, FrameFlag
from seatrial.acquisition.core.units import canonical, is_unit
from seatrial.acquisition.decoders.dbc import missing_by_name, missing_by_rule
from seatrial.acquisition.decoders.mqtt import read_message, split_time, topic_and_message
from seatrial.acquisition.decoders.parameter_groups import NOT_AVAILABLE
from seatrial.acquisition.decoders.told_time import SENTENCE_BEHIND
from seatrial.acquisition.discovery.dbc_files import DbcMessages

_LATEST = 64  # frames of a message: each signal of a multiplexed one comes in some of them only
_MOST_TOPICS, _MOST_FIELDS, _MOST_LEVELS = 1_000, 100, 8  # what comes off a wire has no end
_LONGEST_TEXT, _LONGEST_MESSAGE = 40, 65_536
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True)
class LatestReading:
    """The latest value of a signal or topic.

    ``entry`` is what a configuration maps it to a channel by, ``channel`` the one that it is mapped to, if any;
    ``value`` is None where it is not available, and ``note`` says more of it, such as the name of a state.
    """

    source: str
    entry: dict[str, str]
    value: float | str | None
    note: str = ""
    channel: str = ""

    @property
    def text(self) -> str:
        """The value for people, with its unit and what there is to note."""
        value = f"{self.value:.6g}" if isinstance(self.value, float) else self.value or ""
        shown = f"{value} {self.entry['unit']}".strip() if value else ""
        return f"{shown} ({self.note})" if shown and self.note else shown or self.note

    def as_json(self) -> dict[str, Any]:
        more = {key: text for key, text in (("note", self.note), ("channel", self.channel)) if text}
        return {"source": self.source, **self.entry, "value": self.value, **more}


def signal_readings(
    source: str, frames: Iterable[Frame], messages: DbcMessages, channels: Mapping[tuple[str, str], str]
) -> list[LatestReading]:
    """The latest value of each signal on a source; ``channels`` are those mapped, by message and signal."""
    latest: dict[str, tuple[DbcMessage, deque[Frame]]] = {}
    for frame in frames:
        if (message := messages.of(frame)) is not None:
            latest.setdefault(message.name, (message, deque(maxlen=_LATEST)))[1].append(frame)
    readings = []
    for message, recent in latest.values():
        values: dict[str, tuple[float | None, str]] = {}
        for frame in recent:
            values |= _decoded(message, frame)
        for signal in message.signals:
            if signal.name in values:
                entry = {"message": message.name, "signal": signal.name, "unit": canonical(str(signal.unit or ""))}
                channel = channels.get((message.name, signal.name), "")
                readings.append(LatestReading(source, entry, *values[signal.name], channel))
    return readings


def _decoded(message: DbcMessage, frame: Frame) -> dict[str, tuple[float | None, str]]:
    """The values of the signals in a frame, each with the name of its state or the reason why it has none."""
    try:
        raw: dict[str, float] = message.decode(frame.payload[: message.length], decode_choices=False, scaling=False)
    except Exception:  # an unknown multiplexer value, and whatever else the library finds
        return {}
    return {
        signal.name: _value(raw[signal.name], signal, not frame.flags & FrameFlag.STANDARD_ID)
        for signal in message.signals
        if signal.name in raw
    }


def _value(raw: float, signal: DbcSignal, is_extended: bool) -> tuple[float | None, str]:
    missing = missing_by_name(raw, signal)
    if missing is None and (is_extended or signal.is_float):
        missing = missing_by_rule(raw, signal)
    value = float("nan") if missing else float(signal.raw_to_scaled(raw, False))
    if not isfinite(value):
        return None, missing or NOT_AVAILABLE
    return value, str((signal.choices or {}).get(int(raw), ""))


class _Field(NamedTuple):
    """A value in a message; ``path`` is its field in a JSON object."""

    path: str
    value: float | str
    unit: str = ""


def topic_readings(source: str, frames: Iterable[Frame]) -> list[LatestReading]:
    """The latest value of each topic, or of each field of a JSON object; sentences are none."""
    latest: dict[str, tuple[str, str]] = {}
    for frame in frames:
        topic, text = topic_and_message(frame.payload)
        is_retained = bool(frame.flags & FrameFlag.RETAINED)
        if _is_sentence(text) or (topic not in latest and len(latest) >= _MOST_TOPICS):
            continue
        latest[topic] = text, "retained by the broker, of unknown age" if is_retained else ""
    readings = []
    for topic, (text, note) in sorted(latest.items()):
        for field in _fields_in(text):
            entry = {"topic": topic, **({"field": field.path} if field.path else {}), "unit": field.unit}
            readings.append(LatestReading(source, entry, field.value, note))
    return readings


def _is_sentence(text: str) -> bool:
    return any(SENTENCE_BEHIND.fullmatch(line.strip()) for line in text[:_LONGEST_MESSAGE].splitlines())


def _fields_in(text: str) -> list[_Field]:
    """The values in a message; its text, shortened, where it is neither a number nor a JSON object."""
    if len(text) > _LONGEST_MESSAGE:
        return [_Field("", f"{len(text):,} bytes")]
    _, body = split_time(text)
    if body.startswith("{"):
        with suppress(orjson.JSONDecodeError):
            return list(islice(_leaves(orjson.loads(body)), _MOST_FIELDS))
        return [_Field("", _shortened(body))]
    message = read_message(text, TopicValue(topic="any", unit=""))
    unit = message.unit if is_unit(message.unit) else ""
    number = _number(message.text)
    return [_Field("", _shortened(body)) if number is None else _Field("", number, unit)]


def _number(value: Any) -> float | None:
    """A finite number, or the text of one, as a float; None for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    number = float(value) if not isinstance(value, str) or _NUMBER.fullmatch(value) else float("nan")
    return number if isfinite(number) else None


def _shortened(text: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in text.strip())
    return shown if len(shown) <= _LONGEST_TEXT else f"{shown[:_LONGEST_TEXT]}..."


def _leaves(content: Mapping[str, Any], path: str = "", level: int = 0) -> Iterator[_Field]:
    """The values in nested objects, by their paths."""
    for key, value in content.items():
        inner = f"{path}.{key}" if path else key
        if isinstance(value, dict) and level < _MOST_LEVELS:
            yield from _leaves(value, inner, level + 1)
        else:
            number = _number(value)
            yield _Field(inner, _shortened(str(value)) if number is None else number)
