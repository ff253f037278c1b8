"""What is in a frame: one file a protocol. A decoder turns one frame into samples, guards first.

A decoder keeps only the state its protocol forces on it (packets in parts, the clock of the line, who has which
address) and counts what it refuses. It never raises on what comes off a wire.

What a decoder may say, besides channels that a message carries as they are, in groups that belong together
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

from collections import Counter, deque
from typing import Protocol

from acquisition.config.sections import AnySource, CanFrames, MavlinkLinks
from acquisition.core.actuators import DEFAULT, Actuators
from acquisition.core.frames import Frame, Group

Notices = deque[tuple[str, str]]
"""What people should know, as (level, text): an address that changed, a clock that stepped."""


class Decoder(Protocol):
    """One protocol's step from frame to samples."""

    refused: Counter[str]
    """How many frames or values were refused, by reason."""
    notices: Notices
    """What there is to tell since it was last emptied; the caller empties it."""

    def decode(self, frame: Frame) -> list[Group]:
        """The samples in one frame, a group a message; empty where there is nothing for us in it."""


def make_decoders(config: AnySource, actuators: Actuators = DEFAULT) -> list[Decoder]:
    """The decoders that a source's frames go through, on a ship with these actuators."""
    if isinstance(config, CanFrames):
        from acquisition.decoders.dbc import DbcDecoder
        from acquisition.decoders.nmea2000 import Nmea2000Decoder

        nmea2000 = Nmea2000Decoder(
            config.clock, config.devices, actuators, config.reduction_ratios, shares_bus=config.dbc is not None
        )
        if config.dbc is None:
            return [nmea2000]
        return [nmea2000, DbcDecoder(config.dbc, config.signals, nmea2000.clock, nmea2000.devices)]
    if isinstance(config, MavlinkLinks):
        from acquisition.decoders.mavlink import MavlinkDecoder

        return [MavlinkDecoder(config, actuators)]
    from acquisition.decoders.nmea0183 import Nmea0183Decoder

    wind, ratios = config.theoretical_wind, config.reduction_ratios
    return [Nmea0183Decoder(config.thrusters, config.clock, wind, actuators, ratios)]
