"""MAVLink packets in bytes: where each begins and ends, whether its checksum holds, what lies between them.

``pymavlink``'s own parser takes the length byte of a damaged packet at its word, and loses the sound packets
within that length. Here a packet is only passed over whole where nothing sound begins inside it.
"""

from __future__ import annotations

import os
import re
from binascii import crc_hqx
from bisect import bisect_left
from dataclasses import dataclass

from seatrial.acquisition.decoders import BAD_DATA

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

_MAGIC = re.compile(b"[\xfd\xfe]")
_VERSION_1 = 0xFE
_SIGNED = 1  # the only incompatibility flag that we know; a packet with another one cannot be understood
_SIGNATURE_BYTES = 13
_CHECKSUM_BYTES = 2
_HEADER_BYTES = {0xFD: 10, 0xFE: 6}
_CRC_EXTRA = {number: message.crc_extra for number, message in dialect.mavlink_map.items()}
LONGEST_BYTES = 10 + 255 + _CHECKSUM_BYTES + _SIGNATURE_BYTES

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


@dataclass(frozen=True, slots=True)
class Header:
    """Who sent a packet, and the number of the message in it."""

    system_id: int
    component_id: int
    message_id: int


@dataclass(frozen=True, slots=True)
class Fault:
    """Bytes that are no packet to be used, and why."""

    reason: str


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, by the standard library's CRC of the opposite bit order.

    >>> hex(checksum(b"123456789"))
    '0x6f91'
    """
    backwards = crc_hqx(data.translate(_REVERSED), 0xFFFF)
    return _REVERSED[backwards & 0xFF] << 8 | _REVERSED[backwards >> 8]


def header_of(packet: bytes) -> Header:
    """The header of a whole packet of either version."""
    if packet[0] == _VERSION_1:
        return Header(packet[3], packet[4], packet[5])
    return Header(packet[5], packet[6], int.from_bytes(packet[7:10], "little"))


def message_name(number: int) -> str:
    """The name of a message, or its number where the dialect has none."""
    message = dialect.mavlink_map.get(number)
    return str(message.msgname) if message else str(number)


def is_known(packet: bytes) -> bool:
    """Whether a whole packet's message is one of the dialect: of others no checksum can be proved."""
    return header_of(packet).message_id in _CRC_EXTRA


def extent(data: bytes, at: int) -> int:
    """How many bytes the packet that begins at ``at`` has; 0 where none can begin.

    Where its first three bytes have not all come, the answer is more than there are.
    """
    header_bytes = _HEADER_BYTES.get(data[at])
    if header_bytes is None:
        return 0
    if at + 3 > len(data):
        return 3
    signature_bytes = 0
    if data[at] != _VERSION_1:
        if data[at + 2] & ~_SIGNED:
            return 0
        signature_bytes = _SIGNATURE_BYTES if data[at + 2] & _SIGNED else 0
    return header_bytes + data[at + 1] + _CHECKSUM_BYTES + signature_bytes


def is_sound(data: bytes, at: int = 0) -> bool:
    """Whether a whole packet of a known message begins at ``at``, with a right checksum.

    The checksum includes a number that belongs to the message, so that of an unknown message cannot be checked.
    """
    length = extent(data, at)
    if length == 0 or at + length > len(data):
        return False
    extra = _CRC_EXTRA.get(header_of(data[at : at + 10]).message_id)
    end = at + _HEADER_BYTES[data[at]] + data[at + 1]
    if extra is None:
        return False
    return checksum(data[at + 1 : end] + bytes((extra,))) == int.from_bytes(data[end : end + 2], "little")


def is_signed(data: bytes, at: int = 0) -> bool:
    """Whether the packet at ``at`` ends in a signature, which no checksum covers. We do not verify it."""
    return data[at] != _VERSION_1 and bool(data[at + 2] & _SIGNED)


class PacketCutter:
    """Cuts a stream, in whatever pieces it comes, into packets and faults. At most two packets are kept waiting.

    With ``whole`` every piece ends where a packet ends, as in a log; otherwise a packet may go on in the next.
    """

    def __init__(self, *, whole: bool) -> None:
        self._complete = whole
        self._pending = b""

    def push(self, received: bytes) -> list[bytes | Fault]:
        """The packets and faults that are complete now, in their order."""
        before: list[bytes | Fault] = []
        if self._pending and received and is_sound(received):
            # What waits is the rest of a damaged packet; it must not hold back, and make late, what came now.
            before, _ = _cut(self._pending, complete=True)
            self._pending = b""
        data = self._pending + received
        pieces, used = _cut(data, complete=self._complete)
        self._pending = data[used:]
        return before + pieces


def _cut(data: bytes, *, complete: bool) -> tuple[list[bytes | Fault], int]:
    """Packets and faults from the beginning of ``data``, and how many of its bytes they are made of.

    Unless it is ``complete``, what bytes to come may yet decide is left.
    """
    starts = (match.start() for match in _MAGIC.finditer(data))
    sound = [*(start for start in starts if is_sound(data, start)), len(data)]
    pieces: list[bytes | Fault] = []
    at, rubbish = 0, False
    while at < len(data):
        end = at + extent(data, at)
        following = sound[bisect_left(sound, at)]
        if following == at:
            piece: bytes | Fault | None = data[at:end]
            end = _end_of_sound(data, at, end, sound)
        elif at < end and not complete and _undecided(data, at, end):
            break
        else:
            piece = _passed_over(data, at, end, following)
        if piece is None:
            rubbish, at = True, _next_magic(data, at + 1)
            continue
        pieces += [Fault(BAD_DATA), piece] if rubbish else [piece]
        rubbish, at = False, end
    return pieces + [Fault(BAD_DATA)] * rubbish, at


def _end_of_sound(data: bytes, at: int, end: int, sound: list[int]) -> int:
    """Where a sound packet ends: where the next one begins, if its signature was cut off."""
    following = sound[bisect_left(sound, at + 1)]
    return following if is_signed(data, at) and end - _SIGNATURE_BYTES <= following < end else end


def _undecided(data: bytes, at: int, end: int) -> bool:
    """Whether bytes to come may tell that a packet without a right checksum has another length than it says.

    What follows may begin no packet, or a packet that began inside may turn out to be sound.
    """
    if end >= len(data):
        return True
    late = _MAGIC.finditer(data, max(at + 1, len(data) - LONGEST_BYTES), end)
    return any(match.start() + extent(data, match.start()) > len(data) for match in late)


def _passed_over(data: bytes, at: int, end: int, following: int) -> Fault | None:
    """Why a packet without a right checksum is passed over whole; None where its length is not to be believed.

    It is believed where the next sound packet, at ``following``, does not begin before its end, and the byte after
    it may begin a packet.
    """
    if end == at or end > following or (end < len(data) and data[end] not in _HEADER_BYTES):
        return None
    unknown = header_of(data[at:end]).message_id not in _CRC_EXTRA
    return Fault("unknown message" if unknown else BAD_DATA)


def _next_magic(data: bytes, at: int) -> int:
    match = _MAGIC.search(data, at)
    return match.start() if match else len(data)
