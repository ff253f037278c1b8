"""What is in a frame: one file a protocol. A decoder turns one frame into samples, an encoder channels into bytes.

A decoder keeps only the state its protocol forces on it (packets in parts, the clock of the line, which device has
which address) and counts what it refuses. It never raises on what comes from a wire. Encoders are what the emulator
puts onto buses and lines.

What a decoder may report, besides channels that a message carries as they are, in groups that belong together
(``derive.py`` makes channels of them):

==================================================  =========================================================
``latitude_deg``, ``longitude_deg``                 a fix; north and east follow
``heading_magnetic_deg``, ``magnetic_variation_deg``  compass heading with the deviation applied; east positive
``velocity_north_mps``, ``velocity_east_mps``       over ground
``course_over_ground_deg`` or ``course_magnetic_deg``, with ``speed_over_ground_mps``
``wind_angle_apparent_deg``, ``wind_speed_apparent_mps``   from the bow, as felt on board
``wind_angle_theoretical_deg``, ``wind_speed_theoretical_mps``   from the bow, over ground
``wind_angle_water_deg``, ``wind_speed_water_mps``  from the bow, relative to the water
``wind_direction_magnetic_deg``, ``wind_speed_mps``  from magnetic north, over ground
==================================================  =========================================================
"""

from __future__ import annotations

import typing
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from seatrial.acquisition.config import declarations
from seatrial.acquisition.config.sources import AnySource, CanFrames, CanSource, LineSource, MavlinkLinks, MqttLinks
from seatrial.acquisition.core import (
    can_library,  # noqa: F401 - before all modules that import python-can
    named_code,
    trial,
)
from seatrial.acquisition.core.ship import BY_NAME, DEFAULT, Actuators, Channel, channels_with_declared

BAD_DATA = "bad data"
"""Why a decoder refuses what is no packet of its protocol."""
_MOST_UNKNOWN = 500
_MOST_SENDERS = 100
Notices = deque[tuple[str, str]]
"""What users should know, as (level, text): an address that changed, a clock that stepped."""


NO_SATELLITES = frozenset({0, 6, 7, 8})
"""Fixes by the numbers of GGA that are none by satellites: none at all, dead reckoning, typed in, a simulator's."""


class FurtherSenders:
    """The addresses that send to one port besides the first, which needs none in its labels."""

    def __init__(self) -> None:
        self._labels: dict[str, str] = {}

    def label(self, sender: str) -> str:
        """What an address has in its labels; empty for the first, and where none is known."""
        if not sender:
            return ""
        if (label := self._labels.get(sender)) is None:
            if len(self._labels) >= _MOST_SENDERS:  # addresses can be forged
                return "further"
            label = self._labels[sender] = trial.safe_source_label(sender) if self._labels else ""
        return label


class Decoder(ABC):
    """One protocol's step from frame to samples.

    ``refused`` counts frames and values by reason, ``unknown`` valid messages that carry no channel by name;
    ``notices`` are those since the caller emptied them last; ``fixes`` the last report of each sensor's satellite
    receiver on its fix.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.unknown: Counter[str] = Counter()
        self.notices: Notices = deque()
        self.fixes: dict[str, trial.Fix] = {}

    def count_unknown_message(self, name: str) -> None:
        """Count a message that carries no channel; noise must not name unbounded numbers of messages."""
        if name in self.unknown or len(self.unknown) < _MOST_UNKNOWN:
            self.unknown[name] += 1

    @abstractmethod
    def decode(self, frame: trial.Frame) -> list[trial.Group]:
        """The samples in one frame, a group a message; empty where there is nothing for us in it."""


Carrier = typing.TypeVar("Carrier")
Reader = typing.TypeVar("Reader", bound=tuple[Any, ...])


class DeclaredReaders(dict[Carrier, list[Reader]]):
    """The readers of the declared channels of one line, bus or link, by the kind of message that carries them.

    Each begins with its channel.
    """

    def values_not_declared(self, kind: Carrier, values: list[tuple[str, float]]) -> list[tuple[str, float]]:
        """The values without channels that these messages carry by declaration, which replaces their standard
        meaning."""
        if kind not in self:
            return values
        declared = {channel.name for channel, *_ in self[kind]}
        return [pair for pair in values if pair[0] not in declared]


def make_decoders(
    config: AnySource, actuators: Actuators = DEFAULT, declared: declarations.Declarations = ()
) -> list[Decoder]:
    """The decoders that the frames of a source's main protocol go through, on a ship with these actuators."""
    return next(iter(decoders_by_protocol(config, actuators, declared).values()))


def decoders_by_protocol(
    config: AnySource, actuators: Actuators = DEFAULT, declared: declarations.Declarations = ()
) -> dict[trial.Protocol, list[Decoder]]:
    """The decoders of a source's frames, its main protocol first: on a line a gateway may send CAN frames, too.

    Of the channels that are ``declared`` they read those that are listed for the source.
    """
    if isinstance(config, MavlinkLinks):
        from seatrial.acquisition.protocols.mavlink import MavlinkDecoder

        return {"mavlink": [MavlinkDecoder(config, actuators, declared)]}
    if isinstance(config, CanSource):
        return {"can": _can_decoders(config, actuators, declared)}
    from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder

    decoder = Nmea0183Decoder(
        config.thrusters,
        config.clock,
        config.theoretical_wind,
        actuators,
        config.reduction_ratios,
        config.rated_rpm,
        declared=declarations.origins_of_kind(
            declared, config.channels, declarations.SentenceField | declarations.Transducer
        ),
        unchecked=config.checksum == "optional",
    )
    if isinstance(config, MqttLinks):
        from seatrial.acquisition.protocols.mqtt import MqttDecoder

        channels = channels_with_declared(tuple(declaration.channel for declaration in declared))
        return {"mqtt": [MqttDecoder(config, decoder, channels)]}
    sentences: list[Decoder] = [decoder]
    if config.type == "can_file":
        return {"can": _can_decoders(config, actuators, declared), "nmea0183": sentences}
    return {"nmea0183": sentences, "can": _can_decoders(config, actuators, declared)}


def _can_decoders(config: CanFrames, actuators: Actuators, declared: declarations.Declarations) -> list[Decoder]:
    from seatrial.acquisition.protocols.can_frames import DbcDecoder
    from seatrial.acquisition.protocols.nmea2000 import Nmea2000Decoder

    nmea2000 = Nmea2000Decoder(
        config.clock,
        config.devices,
        actuators,
        config.reduction_ratios,
        shares_bus=config.dbc is not None,
        declared=declarations.origins_of_kind(declared, config.channels, declarations.GroupField),
    )
    if config.dbc is None:
        return [nmea2000]
    channels = channels_with_declared(tuple(declaration.channel for declaration in declared))
    return [nmea2000, DbcDecoder(config.dbc, config.signals, nmea2000, channels)]


_ENCODERS: tuple[tuple[Any, str], ...] = (
    (CanSource, "seatrial.acquisition.protocols.can_frames:CanEncoder"),
    (MavlinkLinks, "seatrial.acquisition.protocols.mavlink:MavlinkEncoder"),
    (MqttLinks, "seatrial.acquisition.protocols.mqtt:MqttEncoder"),
    (LineSource, "seatrial.acquisition.protocols.nmea0183:Nmea0183Encoder"),
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
    def channels_in_fix(self) -> tuple[str, ...]:
        """The channels that travel in the fix."""
        fix = "north_m", "east_m", "latitude_deg", "longitude_deg"
        return () if self.latitude_deg is None else self.present(*fix)

    def present(self, *channels: str) -> tuple[str, ...]:
        """Those of ``channels`` that have a value now."""
        return tuple(name for name in channels if name in self.values)


class Encoder(typing.Protocol):
    """One source's way of sending an instant."""

    def encode(self, moment: Moment) -> list[Packet]:
        """The packets that carry the moment's values, the announcement of the time first if it is wanted."""


def make_encoder(
    config: AnySource, actuators: Actuators = DEFAULT, channels: Mapping[str, Channel] = BY_NAME
) -> Encoder:
    """The encoder for what a configuration section would receive, on a ship with these actuators and channels."""
    place = next(place for kinds, place in _ENCODERS if isinstance(config, kinds))
    encoder: Encoder = named_code.import_object(place)(config, actuators, channels)
    return encoder
