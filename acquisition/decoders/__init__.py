"""What is in a frame: one file a protocol. A decoder turns one frame into samples, guards first.

A decoder keeps only the state its protocol forces on it (packets in parts, the clock of the line) and counts
what it refuses. It never raises on what comes off a wire.
"""

from __future__ import annotations

from collections import Counter
from typing import Protocol

from acquisition.config import AnySource, CanSource, MavlinkSource
from acquisition.frames import Frame, Group


class Decoder(Protocol):
    """One protocol's step from frame to samples."""

    refused: Counter[str]
    """How many frames or values were refused, by reason."""

    def decode(self, frame: Frame) -> list[Group]:
        """The samples in one frame, a group a message; empty where there is nothing for us in it."""


def make_decoders(config: AnySource) -> list[Decoder]:
    """The decoders that a source's frames go through."""
    if isinstance(config, CanSource):
        from acquisition.decoders.dbc import DbcDecoder
        from acquisition.decoders.nmea2000 import Nmea2000Decoder

        decoders: list[Decoder] = [Nmea2000Decoder(config.clock, shares_bus=config.dbc is not None)]
        if config.dbc is not None:
            decoders.append(DbcDecoder(config.dbc, config.signals, decoders[0].clock))  # type: ignore[attr-defined]
        return decoders
    if isinstance(config, MavlinkSource):
        from acquisition.decoders.mavlink import MavlinkDecoder

        return [MavlinkDecoder(config)]
    from acquisition.decoders.nmea0183 import Nmea0183Decoder

    return [Nmea0183Decoder(config.thrusters, config.clock)]
