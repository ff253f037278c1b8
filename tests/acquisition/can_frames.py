"""What the tests of CAN frames share: frames made by hand, and what came out of them."""

from __future__ import annotations

import struct

from seatrial.acquisition.core.trial import Frame, FrameFlag, Group
from seatrial.acquisition.protocols.nmea2000 import Field

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
_ANGLE_RAD, _SPEED_MPS, _FINE_SPEED_MPS, _TIME_S = 1e-4, 0.01, 0.001, 1e-4

FIELDS: dict[int, dict[str, Field]] = {
    126992: {"date": Field(16, 16, 1), "time": Field(32, 32, _TIME_S)},
    127245: {
        "instance": Field(0, 8, 1),
        "angleOrder": Field(16, 16, _ANGLE_RAD, signed=True),
        "position": Field(32, 16, _ANGLE_RAD, signed=True),
    },
    127488: {"instance": Field(0, 8), "speed": Field(8, 16, 0.25)},
    127493: {"instance": Field(0, 8), "transmissionGear": Field(8, 2)},
    127250: {
        "heading": Field(8, 16, _ANGLE_RAD),
        "deviation": Field(24, 16, _ANGLE_RAD, signed=True),
        "variation": Field(40, 16, _ANGLE_RAD, signed=True),
        "reference": Field(56, 2),
    },
    127251: {"rate": Field(8, 32, 3.125e-8, signed=True)},
    127257: {
        "pitch": Field(24, 16, _ANGLE_RAD, signed=True),
        "roll": Field(40, 16, _ANGLE_RAD, signed=True),
    },
    127258: {"variation": Field(32, 16, _ANGLE_RAD, signed=True)},
    128259: {"speedWaterReferenced": Field(8, 16, _SPEED_MPS)},
    129025: {"latitude": Field(0, 32, 1e-7, signed=True), "longitude": Field(32, 32, 1e-7, signed=True)},
    129026: {"cogReference": Field(8, 2), "cog": Field(16, 16, _ANGLE_RAD), "sog": Field(32, 16, _SPEED_MPS)},
    129029: {
        "date": Field(8, 16, 1),
        "time": Field(24, 32, _TIME_S),
        "latitude": Field(56, 64, 1e-16, signed=True),
        "longitude": Field(120, 64, 1e-16, signed=True),
        "altitude": Field(184, 64, 1e-6, signed=True),
        "method": Field(252, 4),
    },
    129033: {"date": Field(0, 16, 1), "time": Field(16, 32, _TIME_S)},
    130306: {
        "windSpeed": Field(8, 16, _SPEED_MPS),
        "windAngle": Field(24, 16, _ANGLE_RAD),
        "reference": Field(40, 3),
    },
    130577: {
        "dataMode": Field(0, 4),
        "cogReference": Field(4, 2),
        "cog": Field(16, 16, _ANGLE_RAD),
        "sog": Field(32, 16, _SPEED_MPS),
    },
    130578: {
        "longitudinalSpeedWaterReferenced": Field(0, 16, _FINE_SPEED_MPS, signed=True),
        "longitudinalSpeedGroundReferenced": Field(32, 16, _FINE_SPEED_MPS, signed=True),
        "transverseSpeedGroundReferenced": Field(48, 16, _FINE_SPEED_MPS, signed=True),
    },
}
"""The fields that are read on every ship, by the names of their groups' definitions."""


def can_frame(identifier: int, data: str | bytes, at_s: float = 0.0, flags: FrameFlag = FrameFlag.NONE) -> Frame:
    """A frame that was received at ``at_s``; data as bytes or in hexadecimal digits."""
    time_ns = round(at_s * SECOND)
    payload = bytes.fromhex(data) if isinstance(data, str) else data
    return Frame("bus", "can", payload, time_ns, time_ns, identifier, flags)


def identifier_of(group: int, address: int = 35, priority: int = 2) -> int:
    """The 29-bit identifier of a group that is sent to everybody."""
    return priority << 26 | group << 8 | (0xFF00 if (group >> 8) & 0xFF < 240 else 0) | address


def fast_parts(payload: bytes, number: int = 0) -> list[bytes]:
    """A message as the parts of a fast packet."""
    parts = [bytes([number << 5, len(payload)]) + payload[:6]]
    rest = range(6, len(payload), 7)
    parts += [bytes([number << 5 | place]) + payload[at : at + 7] for place, at in enumerate(rest, start=1)]
    return [part.ljust(8, b"\xff") for part in parts]


def values(groups: list[Group]) -> dict[str, float]:
    """Value by quantity."""
    return {sample.quantity: sample.value for group in groups for sample in group}


def gnss(method: int = 1, latitude_deg: float = 63.4) -> bytes:
    """129029, 43 bytes: a position in seven parts."""
    position = int(latitude_deg * 1e16), int(10.4e16)
    return struct.pack("<BHIqqqBBBhhiB", 1, 20_000, 360_000_000, *position, 0, method << 4, 0xFC, 9, 9, 9, 0, 0)
