"""MQTT messages: sentences after a time, and values that have a topic each.

A sentence is decoded as every line, with its time as that of a TAG block. A value is a number,
``value,time,...``, either of them after a time and a blank, or a field of a JSON object. What a broker had
retained is of unknown age and not decoded; a message that has a time and comes twice counts once. The encoder
sends values under their topics as ``value,time``, all else as sentences after the time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta
from math import isfinite
from typing import Any, NamedTuple

import orjson

from seatrial.acquisition.config.sources import PAIRS, MqttLinks, TopicValue
from seatrial.acquisition.core import errors, quantities, ship, trial
from seatrial.acquisition.protocols import Decoder, Moment, Packet
from seatrial.acquisition.protocols.clock import SENTENCE_WITH_PREFIX, SourceClock, parse_utc_ns
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, Nmea0183Encoder, has_sentence

_REMEMBERED = 10_000  # messages: a broker redelivers those in flight, 20 at once by default, 65,535 at most
_MOST_TOPICS = 10_000
_LONGEST_TEXT = 65_536  # of sentences in one message, as in a datagram: ten megabytes would take seconds
_PAIR_NS = 50_000_000  # a ship at 6 m/s makes 0.3 m in it, the error of a good fix
_NUMBER = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d{1,3})?", re.ASCII)
_NO_VALUE = frozenset({"", "none", "null", "nan", "n/a", "na", "-"})
_TIMED = re.compile(
    r"(?P<time>\d{4}-\d\d-\d\d[T ][\d:.]{8,18}(?:Z|[+-]\d\d:?\d\d)?|\d{10}(?:\.\d++)?)\s++(?P<message>.*)", re.ASCII
)
_IN_LABELS = str.maketrans(": ", "__")
_APPARENT_WIND = {
    "apparent_wind_angle_deg": "wind_angle_apparent_deg", "apparent_wind_speed_mps": "wind_speed_apparent_mps",
}  # fmt: skip
"""The names of the wind on board where its angle and speed come together: true wind follows from it."""
_POSITION = {"latitude_deg": "north_m", "longitude_deg": "east_m"}
"""What each coordinate of a position carries of the plane."""
_PARTNERS = {name: partner for pair in PAIRS for name, partner in (pair, pair[::-1])}


class ValueReading(NamedTuple):
    """What is in a message: its value as text, its time [ns UTC] and its unit, if it has them."""

    text: str
    time_ns: int | None = None
    unit: str = ""


def split_topic_and_message(payload: bytes) -> tuple[str, str]:
    """The topic in a frame, and its message as Latin-1."""
    topic, _, message = payload.partition(b"\0")
    return topic.decode("utf-8", "replace"), message.decode("latin-1")


def split_device_and_signal(topic: str) -> tuple[str, str]:
    """The publisher of a topic, which is all but its last level, and the signal, as in labels of sources.

    >>> split_device_and_signal("ship/MRU/Heading")
    ('ship/MRU', 'Heading')
    """
    device, _, signal = topic.translate(_IN_LABELS).rpartition("/")
    return device, signal


def split_leading_time(text: str) -> tuple[int | None, str]:
    """The time before a message [ns UTC], if there is one, and the message.

    >>> split_leading_time("2023-11-03T09:41:02Z 12.5")
    (1699004462000000000, '12.5')
    """
    match = _TIMED.fullmatch(text.strip())
    return (parse_utc_ns(match["time"]), match["message"]) if match else (None, text.strip())


def read_topic_value(text: str, entry: TopicValue) -> ValueReading:
    """What a message has of an entry. Raises :class:`ValueError` with what is wrong with it.

    >>> read_topic_value("12.5,2023-11-03T09:41:02Z,deg", TopicValue(topic="x", unit="deg"))
    ValueReading(text='12.5', time_ns=1699004462000000000, unit='deg')
    """
    time_ns, text = split_leading_time(text)
    if text.startswith("{"):
        try:
            document = orjson.loads(text)
        except orjson.JSONDecodeError as error:
            raise ValueError("no JSON object") from error
        value, time = (
            _value_at_json_path(document, entry.field or "value"),
            _value_at_json_path(document, entry.time_field),
        )
        if isinstance(value, bool | dict | list):
            raise ValueError("no number")
        if time is not None:
            time_ns = parse_utc_ns(repr(time) if isinstance(time, float) else str(time))
        return ValueReading("" if value is None else str(value), time_ns)
    if entry.field is not None:
        raise ValueError("no JSON object")
    number, stated_time, unit, *_ = (*(part.strip() for part in text.split(",", 3)), "", "")
    if stated_time and time_ns is None:
        time_ns = parse_utc_ns(stated_time)
    return ValueReading(number, time_ns, unit)


def _value_at_json_path(node: Any, path: str) -> Any:
    """The value at a path of keys in nested objects; None where there is nothing."""
    if isinstance(node, dict) and path in node:
        return node[path]
    head, _, remaining_path = path.partition(".")
    is_nested = remaining_path and isinstance(node, dict) and head in node
    return _value_at_json_path(node[head], remaining_path) if is_nested else None


class MqttDecoder(Decoder):
    """The messages of one broker, or one log; ``sentences`` decodes those that are lines of NMEA 0183.

    Values from which others follow only in pairs (``PAIRS``) wait for each other, if both have a topic: one is
    passed on alone when the next of its kind comes before its partner.
    """

    def __init__(
        self, config: MqttLinks, sentences: Nmea0183Decoder, channels: Mapping[str, ship.Channel] = ship.BY_NAME
    ) -> None:
        """Raises :class:`ConfigurationError` for a unit that does not measure its channel."""
        self.refused, self.unknown = sentences.refused, sentences.unknown
        self.notices, self.fixes = sentences.notices, sentences.fixes
        self._stamps, self._clocks = config.clock, dict[str, SourceClock]()
        self._sentences = sentences
        self._values: dict[str, list[tuple[str, TopicValue]]] = {}
        for channel, entry in config.values.items():
            self._values.setdefault(entry.topic, []).append((channel, entry))
        self._channels = channels
        self._steps = {
            channel: entry.conversion_to_channel(channels[channel]) for channel, entry in config.values.items()
        }
        self._partners = {name: _PARTNERS[name] for name in config.values if _PARTNERS.get(name) in config.values}
        self._waiting: dict[str, trial.Sample] = {}
        self._seen: dict[int, None] = {}  # by hash
        self._sentence_topics: set[int] = set()  # by hash: one may have 64 kB
        self._unit_checked: set[str] = set()

    def decode(self, frame: trial.Frame) -> list[trial.Group]:
        if frame.flags & trial.FrameFlag.RETAINED:
            self.refused["retained by the broker, of unknown age"] += 1
            return []
        if hash(frame.payload) in self._seen:
            self.refused["came twice"] += 1
            return []
        topic, text = split_topic_and_message(frame.payload)
        if topic in self._values:
            return self._decode_values(frame, topic, text)
        if len(text) > _LONGEST_TEXT:
            if hash(topic) in self._sentence_topics:
                self.refused["longer than 64 kB"] += 1
            return []
        groups = []
        for line in map(str.strip, text.splitlines()):
            match = SENTENCE_WITH_PREFIX.fullmatch(line)
            sentences = (line if match is None else match["inner"]).encode("latin-1")
            if match is None and not has_sentence(sentences):  # which counts where the topic is one of sentences
                if line and hash(topic) in self._sentence_topics:
                    self.refused["no sentence"] += 1
                continue
            if len(self._sentence_topics) < _MOST_TOPICS:
                self._sentence_topics.add(hash(topic))
            time_ns = None if match is None else parse_utc_ns(match["before"])
            if time_ns is not None:
                self._remember_message(frame.payload)
            groups += self._sentences.decode_line(frame, sentences, time_ns)
        return groups

    def _decode_values(self, frame: trial.Frame, topic: str, text: str) -> list[trial.Group]:
        """The channels of a topic in a message, a group for pairs that come together."""
        samples = []
        device, signal = split_device_and_signal(topic)
        label = f"{frame.origin}/{device}:{signal}"
        if device not in self._clocks:  # one for each publisher
            self._clocks[device] = SourceClock(self._stamps, f"mqtt {device}", self.notices)
        clock = self._clocks[device]
        for channel, entry in self._values[topic]:
            try:
                reading = read_topic_value(text, entry)
                value = self._convert_to_channel_unit(channel, entry, reading)
            except ValueError as error:
                self.refused[str(error)] += 1
                continue
            if reading.time_ns is not None:
                self._remember_message(frame.payload)
                clock.announce(reading.time_ns, frame)  # to report how far it is from ours, and when it is set
                clock.forget_announcement()  # a message without a time is not stamped by the time of another
            for group in clock.group_values(frame, label, [(channel, value)], reading.time_ns):
                samples += group
        return self._group_pairs(samples)

    def _convert_to_channel_unit(self, channel: str, entry: TopicValue, reading: ValueReading) -> float:
        """The value in the channel's unit. Raises :class:`ValueError` for what is no number.

        It is reported once of a channel where a message names another unit than the configuration.
        """
        if reading.text.lower() in _NO_VALUE:
            raise ValueError("not available")
        if not _NUMBER.fullmatch(reading.text):
            raise ValueError("no number")
        if reading.unit and channel not in self._unit_checked:
            self._unit_checked.add(channel)
            try:
                agrees = (
                    replace(entry, unit=reading.unit).conversion_to_channel(self._channels[channel])
                    == self._steps[channel]
                )
            except errors.ConfigurationError:
                agrees = False
            if quantities.is_unit(reading.unit) and not agrees:  # an unknown one is ignored
                text = f"{entry.topic} tells {reading.unit}, the configuration says {entry.unit} of {channel}"
                self.notices.append(("warning", text))
        number = float(reading.text)
        if entry.unit == quantities.DEGREES_AND_MINUTES:
            number = float(quantities.from_degrees_and_minutes(number))
        value = self._steps[channel].apply(number)
        if not isfinite(value):
            raise ValueError("no number")
        return value

    def _remember_message(self, message: bytes) -> None:
        self._seen[hash(message)] = None
        if len(self._seen) > _REMEMBERED:
            del self._seen[next(iter(self._seen))]

    def _group_pairs(self, samples: trial.Group) -> list[trial.Group]:
        """The samples, pairs in one group; the first of a pair that comes separately waits for the second."""
        by_name = {sample.quantity: sample for sample in samples}
        groups = []
        for name, sample in by_name.items():
            partner = self._partners.get(name)
            if partner is None:
                groups.append([sample])
            elif partner in by_name:
                groups += [_pair_wind_samples(sample, by_name[partner])] if name < partner else []
            else:
                waiting = self._waiting.get(partner)
                if waiting is not None and abs(waiting.measured_ns - sample.measured_ns) <= _PAIR_NS:
                    del self._waiting[partner]
                    groups.append(_pair_wind_samples(sample, waiting))
                    continue
                previous = self._waiting.get(name)
                self._waiting[name] = sample
                groups += [] if previous is None else [[previous]]
        return groups


def _pair_wind_samples(first: trial.Sample, second: trial.Sample) -> trial.Group:
    return [
        sample._replace(quantity=_APPARENT_WIND.get(sample.quantity, sample.quantity)) for sample in (first, second)
    ]


def format_time(time_ns: int) -> str:
    """A time in the format of R/V Gunnerus, to the microsecond, or finer where it is.

    >>> format_time(1699004462769765000), format_time(1)
    ('2023-11-03T09:41:02.769765Z', '1970-01-01T00:00:00.000000001Z')
    """
    seconds, nanoseconds = divmod(time_ns, trial.NANO)
    fraction = f"{nanoseconds:09d}".removesuffix("000")
    return f"{trial.EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{fraction}Z"


class MqttEncoder:
    """What a source of MQTT would receive; sentences go to the first of its ``topics``, each by its name."""

    def __init__(self, config: MqttLinks, actuators: ship.Actuators, channels: Mapping[str, ship.Channel]) -> None:
        self._values = {
            name: (entry, entry.conversion_to_channel(channels[name])) for name, entry in config.values.items()
        }
        self._sentences = Nmea0183Encoder(config, actuators, channels)
        self._topic = config.topics[0] if config.topics else None

    def encode(self, moment: Moment) -> list[Packet]:
        time, packets, values = format_time(moment.time_ns), [], dict(moment.values)
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            values |= {"latitude_deg": moment.latitude_deg, "longitude_deg": moment.longitude_deg}
        for channel, (entry, step) in self._values.items():
            if channel in values:
                number = step.invert(values[channel])
                if entry.unit == quantities.DEGREES_AND_MINUTES:
                    number = quantities.to_degrees_and_minutes(number)
                message = f"{number!r},{time}"
                if entry.field is not None:
                    message = orjson.dumps({entry.field: number, entry.time_field: time}).decode()
                carries = moment.present(channel, *(_POSITION[channel],) if channel in _POSITION else ())
                packets.append(_make_packet(entry.topic, message, carries))
        if self._topic is None:
            return packets
        remaining = {name: value for name, value in moment.values.items() if name not in self._values}
        unmapped = replace(moment, values=remaining)
        if _POSITION.keys() <= self._values.keys():
            unmapped = replace(unmapped, latitude_deg=None, longitude_deg=None)
        for packet in self._sentences.encode(unmapped):  # what has no separate topic
            sentence = packet.payload.strip().decode("ascii")
            name = sentence[1:].partition(",")[0]
            topic = "/".join(name if level in ("+", "#") else level for level in self._topic.split("/"))
            packets.append(_make_packet(topic, f"{time} {sentence}", packet.carries))
        return packets


def _make_packet(topic: str, message: str, carries: tuple[str, ...]) -> Packet:
    return Packet(topic.encode() + b"\0" + message.encode(), carries=carries)
