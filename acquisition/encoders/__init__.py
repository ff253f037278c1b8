"""Channels to bytes, the mirror image of the decoders: what the emulator puts onto buses and lines."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from seatrial.acquisition.config.sections import AnySource, CanSource, LineSource, MavlinkLinks, MqttLinks
from seatrial.acquisition.core.actuators import DEFAULT, Actuators
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.core.named_code import imported

_PLACES: tuple[tuple[Any, str], ...] = (
    (CanSource, "seatrial.acquisition.encoders.can_frames:CanEncoder"),
    (MavlinkLinks, "seatrial.acquisition.encoders.mavlink:MavlinkEncoder"),
    (MqttLinks, "seatrial.acquisition.encoders.mqtt:MqttEncoder"),
    (LineSource, "seatrial.acquisition.encoders.nmea0183:Nmea0183Encoder"),
)
"""Imported when first used, like the decoders."""


@dataclass(frozen=True, slots=True)
class Packet:
    """What is sent at once: one CAN frame, one sentence with its line end, one datagram, or one MQTT message.

    ``payload`` is as in a frame; ``carries`` names the channels whose values are in it.
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
        fix = "north_m", "east_m", "latitude_deg", "longitude_deg"
        return () if self.latitude_deg is None else self.present(*fix)

    def present(self, *channels: str) -> tuple[str, ...]:
        """Those of ``channels`` that have a value now."""
        return tuple(name for name in channels if name in self.values)


class Encoder(typing.Protocol):
    """One source's way of saying an instant."""

    def encode(self, moment: Moment) -> list[Packet]:
        """The packets that carry the moment's values, the announcement of the time first if it is wanted."""


def make_encoder(
    config: AnySource, actuators: Actuators = DEFAULT, channels: Mapping[str, Channel] = BY_NAME
) -> Encoder:
    """The encoder for what a configuration section would receive, on a ship with these actuators and channels."""
    place = next(place for kinds, place in _PLACES if isinstance(config, kinds))
    encoder: Encoder = imported(place)(config, actuators, channels)
    return encoder
