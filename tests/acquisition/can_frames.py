"""What the tests of CAN frames share: frames made by hand, and what came out of them."""

from __future__ import annotations

import struct

from seatrial.acquisition.core.trial import Frame, FrameFlag, Group

SECOND = 1_000_000_000
MILLISECOND = 1_000_000


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
