"""Values that come and are no channel until a configuration maps them: signals of a DBC file, MQTT topics.

Which DBC file describes a bus, and which of its signals are the controls of a ship.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import orjson
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal

from seatrial.acquisition.config.sources import TopicValue
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import canonical, is_unit, scale_to
from seatrial.acquisition.core.ship import BY_NAME, RUDDER, VESSELS, Actuators, Channel, rudders
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.protocols.can_frames import frame_key, load_dbc, missing_by_name, missing_by_rule
from seatrial.acquisition.protocols.clock import SENTENCE_BEHIND
from seatrial.acquisition.protocols.mqtt import read_message, split_time, topic_and_message
from seatrial.acquisition.protocols.nmea2000 import parameter_group
from seatrial.acquisition.protocols.parameter_groups import NOT_AVAILABLE

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


_NO_FEEDBACK = re.compile(r"(?i)order|command|cmd|demand|setpoint|request|reference|limit|max|min")
_ALSO_CALLED = {"starboard": ("stbd", "stb"), "tunnel": ("bow",), "propeller": ("prop",)}
_ENOUGH_MESSAGES = 2

SignalNames = dict[str, dict[str, str]]
"""By channel the message, signal and unit, as ``[source.signals]`` has them."""


class DbcMessages:
    """The messages of a DBC file by their frames: by identifier, else a 29-bit one by its parameter group."""

    def __init__(self, database: cantools.db.Database) -> None:
        self.count = len(database.messages)
        self._by_identifier = {
            (message.is_extended_frame, message.frame_id): message for message in database.messages
        }
        self._by_group = {frame_key(message): message for message in database.messages if message.is_extended_frame}

    def of(self, frame: Frame) -> DbcMessage | None:
        """The message that a frame is, if it has all of its bytes."""
        if frame.protocol != "can" or frame.flags & (FrameFlag.REMOTE | FrameFlag.ERROR):
            return None
        is_extended = not frame.flags & FrameFlag.STANDARD_ID
        message = self._by_identifier.get((is_extended, frame.identifier))
        if message is None and is_extended:
            message = self._by_group.get((True, parameter_group(frame.identifier)[0]))
        return message if message is not None and len(frame.payload) >= message.length else None

    def count_in(self, frames: Iterable[Frame]) -> int:
        """How many of the messages are among some frames."""
        return len({message.name for frame in frames if (message := self.of(frame)) is not None})


class DbcChoice(NamedTuple):
    """The DBC file that describes a bus, if one does, and what a user has to know of the choice."""

    path: Path | None
    remark: str = ""


def choose_dbc(named: Path | None, folders: Iterable[Path | None], frames: Sequence[Frame]) -> DbcChoice:
    """The DBC file of the bus that frames came on: the one ``named``, one in a folder, or one of Seatrial's.

    Raises :class:`ConfigurationError` for a named file that is none.
    """
    if named is not None:
        messages = DbcMessages(load_dbc(named))
        count = messages.count_in(frames)
        return DbcChoice(named if count else None, _coverage(named, count, messages))
    remarks: list[str] = []
    for folder in dict.fromkeys(directory.absolute() for directory in folders if directory is not None):
        if (path := _fitting(folder, frames, remarks)) is not None:
            return DbcChoice(path, "; ".join(remarks))
    path = None if remarks else own_dbc(frames)
    remarks += [] if path is None else [f"{path.name} of Seatrial fits"]
    return DbcChoice(path, "; ".join(remarks))


def _fitting(folder: Path, frames: Sequence[Frame], remarks: list[str]) -> Path | None:
    """The DBC file in a folder that fits frames: two of its messages come, or all of fewer; of several the one most
    of whose messages come. ``remarks`` take what is to be said of it, or of those that are not taken."""
    counts: dict[Path, int] = {}
    for path in sorted(folder.glob("*.dbc")):
        try:
            messages = DbcMessages(load_dbc(path))
        except ConfigurationError as error:
            remarks.append(f"{path.name} {error.what}: {error.why}")
            continue
        count = messages.count_in(frames)
        if count >= min(_ENOUGH_MESSAGES, messages.count) > 0:
            counts[path] = count
        if count:
            remarks.append(_coverage(path, count, messages))
    best = [path for path, count in counts.items() if count == max(counts.values())]
    if len(best) > 1:
        remarks.append("they fit alike: name one with --dbc")
    elif remarks and not best:
        remarks.append("if one is of this bus, name it with --dbc")
    return best[0] if len(best) == 1 else None


def _coverage(path: Path, count: int, messages: DbcMessages) -> str:
    return f"{path.name}: {count or 'none'} of its {messages.count} messages come{'s' * (count < 2)}"


def own_dbc(frames: Iterable[Frame]) -> Path | None:
    """The DBC file beside the vessel files that is the bus's own, if there is one.

    At least two of its messages come with their very identifiers, and none of its groups with others: proprietary
    groups mean something else on the next ship.
    """
    received = {
        frame.identifier for frame in frames if frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE
    }
    for path in sorted(VESSELS.glob("*.dbc")):
        messages = load_dbc(path).messages
        identifiers = {message.frame_id for message in messages}
        groups = {frame_key(message)[1] for message in messages}
        foreign = {identifier for identifier in received - identifiers if parameter_group(identifier)[0] in groups}
        if len(identifiers & received) >= _ENOUGH_MESSAGES and not foreign:
            return path
    return None


def match_signals(path: Path, actuators: Actuators) -> SignalNames:
    """The signals that carry the control channels, as far as names and units tell. Raises ConfigurationError."""
    database = load_dbc(path)
    wanted = [(channel, actuator.name) for actuator in actuators for channel in actuator.channels]
    wanted += [] if rudders(actuators) else [(BY_NAME[RUDDER], "rudder")]
    matches = ((channel.name, _signal_of(channel, actuator, database)) for channel, actuator in wanted)
    return {name: entry for name, entry in matches if entry is not None}


def _signal_of(channel: Channel, actuator: str, database: cantools.db.Database) -> dict[str, str] | None:
    """The one signal whose name tells of the actuator and whose unit is the channel's; None where several do."""
    candidates = [
        {"message": message.name, "signal": signal.name, "unit": canonical(str(signal.unit))}
        for message in database.messages
        for signal in message.signals
        if _measures(signal, channel.unit) and _tells_of(actuator, f"{message.name} {signal.name}")
    ]
    return candidates[0] if len(candidates) == 1 else None


def _measures(signal: DbcSignal, unit: str) -> bool:
    try:
        scale_to(unit, str(signal.unit))
    except ConfigurationError:
        return False
    return True


def _tells_of(actuator: str, text: str) -> bool:
    if _NO_FEEDBACK.search(text):
        return False
    plain = re.sub(r"[^a-z]", "", text.lower())
    words = ((word, *_ALSO_CALLED.get(word, ())) for word in actuator.split("_"))
    return all(any(name in plain for name in names) for names in words)
