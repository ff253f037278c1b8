"""Channels to bytes, the mirror image of the decoders: what the emulator puts onto buses and lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from acquisition.config.sections import AnySource, CanSource, MavlinkLinks, MqttLinks
from acquisition.core.actuators import DEFAULT, Actuators
from acquisition.core.channel import Channel
from acquisition.core.channels import BY_NAME


@dataclass(frozen=True, slots=True)
class Packet:
    """What is sent at once: one CAN frame, one sentence with its line end, one datagram, or one MQTT message.

    Of an MQTT message the payload is topic, zero byte and message, as in a frame.

    ``carries`` names the channels whose values are in it.
    """

    payload: bytes
    identifier: int = 0
    extended: bool = True
    carries: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Moment:
    """The channel values of one instant: ``values`` in the channels' units, the fix in degrees.

    ``latitude_deg`` and ``longitude_deg`` are given whenever both ``north_m`` and ``east_m`` are.
    """

    time_ns: int
    values: dict[str, float]
    latitude_deg: float | None = None
    longitude_deg: float | None = None

    @property
    def fix_of(self) -> tuple[str, ...]:
        """The channels that travel in the fix."""
        return (
            () if self.latitude_deg is None else self.present("north_m", "east_m", "latitude_deg", "longitude_deg")
        )

    def present(self, *channels: str) -> tuple[str, ...]:
        """Those of ``channels`` that have a value now."""
        return tuple(name for name in channels if name in self.values)


class Encoder(Protocol):
    """One source's way of saying an instant."""

    def encode(self, moment: Moment) -> list[Packet]:
        """The packets that carry the moment's values, the announcement of the time first if it is wanted."""


def make_encoder(
    config: AnySource, actuators: Actuators = DEFAULT, known: Mapping[str, Channel] = BY_NAME
) -> Encoder:
    """The encoder for what a configuration section would receive, on a ship with these actuators and channels."""
    if isinstance(config, CanSource):
        from acquisition.encoders.can_frames import CanEncoder

        return CanEncoder(config, actuators, known)
    if isinstance(config, MavlinkLinks):
        from acquisition.encoders.mavlink import MavlinkEncoder

        return MavlinkEncoder(config, actuators, known)
    if isinstance(config, MqttLinks):
        from acquisition.encoders.mqtt import MqttEncoder

        return MqttEncoder(config, actuators, known)
    from acquisition.encoders.nmea0183 import Nmea0183Encoder

    return Nmea0183Encoder(config.thrusters, actuators, announces=config.clock == "source")
