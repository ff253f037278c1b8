"""Channels to MQTT messages: values under their topics as ``value,time``, all else as sentences behind the time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta

import orjson

from seatrial.acquisition.config.sections import MqttLinks, TopicValue
from seatrial.acquisition.core.actuators import Actuators
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.frames import EPOCH, NANO
from seatrial.acquisition.core.units import DEGREES_AND_MINUTES, as_degrees_and_minutes
from seatrial.acquisition.encoders import Moment, Packet
from seatrial.acquisition.encoders.nmea0183 import Nmea0183Encoder

_FIX = {"latitude_deg": "north_m", "longitude_deg": "east_m"}
"""What a position by itself carries of the plane."""


def told(time_ns: int) -> str:
    """A time as R/V Gunnerus tells it, to the microsecond, or finer where it is.

    >>> told(1699004462769765000), told(1)
    ('2023-11-03T09:41:02.769765Z', '1970-01-01T00:00:00.000000001Z')
    """
    seconds, nanoseconds = divmod(time_ns, NANO)
    fraction = f"{nanoseconds:09d}".removesuffix("000")
    return f"{EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{fraction}Z"


class MqttEncoder:
    """What a source of MQTT would receive; sentences go to the first of its ``topics``, each by its name."""

    def __init__(self, config: MqttLinks, actuators: Actuators, channels: Mapping[str, Channel]) -> None:
        self._values = {name: (entry, entry.step_to(channels[name])) for name, entry in config.values.items()}
        self._sentences = Nmea0183Encoder(config, actuators, channels)
        self._topic = config.topics[0] if config.topics else None

    def encode(self, moment: Moment) -> list[Packet]:
        time, packets, values = told(moment.time_ns), [], dict(moment.values)
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            values |= {"latitude_deg": moment.latitude_deg, "longitude_deg": moment.longitude_deg}
        for channel, (entry, step) in self._values.items():
            if channel in values:
                message = _message(entry, step.invert(values[channel]), time)
                carries = moment.present(channel, *(_FIX[channel],) if channel in _FIX else ())
                packets.append(_packet(entry.topic, message, carries))
        return packets if self._topic is None else packets + self._sentences_of(moment, time, self._topic)

    def _sentences_of(self, moment: Moment, time: str, topic: str) -> list[Packet]:
        """The sentences of what has no topic of its own."""
        remaining = replace(
            moment, values={name: value for name, value in moment.values.items() if name not in self._values}
        )
        if _FIX.keys() <= self._values.keys():
            remaining = replace(remaining, latitude_deg=None, longitude_deg=None)
        packets = []
        for packet in self._sentences.encode(remaining):
            sentence = packet.payload.strip().decode("ascii")
            name = sentence[1:].partition(",")[0]
            sentence_topic = "/".join(name if level in ("+", "#") else level for level in topic.split("/"))
            packets.append(_packet(sentence_topic, f"{time} {sentence}", packet.carries))
        return packets


def _message(entry: TopicValue, value: float, time: str) -> str:
    number = as_degrees_and_minutes(value) if entry.unit == DEGREES_AND_MINUTES else value
    if entry.field is None:
        return f"{number!r},{time}"
    return orjson.dumps({entry.field: number, entry.time_field: time}).decode()


def _packet(topic: str, message: str, carries: tuple[str, ...]) -> Packet:
    return Packet(topic.encode() + b"\0" + message.encode(), carries=carries)
