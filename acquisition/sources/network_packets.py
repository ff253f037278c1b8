"""Packets of a captured network: the payload of datagrams of UDP, and the bytes of streams of TCP in their order.

A capture holds what passed: segments twice, in another order, or not at all. Without the order lines of a stream
would be put together from pieces that do not follow upon each other.
"""

from __future__ import annotations

from ipaddress import IPv6Address
from typing import NamedTuple

_TCP, _UDP = 6, 17
_FRAGMENT, _EXTENSIONS = 44, (0, 43, 60)  # of the heads behind that of IPv6 (RFC 8200)
_SYN, _ENDS = 0x02, 0x05  # FIN and RST
_SEQUENCES = 2**32
_MOST_WAITING_BYTES = 262_144  # beyond a gap: more than what TCP has under way in a ship's network


class IpPacket(NamedTuple):
    """What a packet of IP carries; ``stream`` is empty for a datagram. ``is_cut`` if its end was not captured.

    ``sequence`` counts the bytes of a stream, that of ``payload``'s first; ``is_start`` and ``is_end`` are those of
    the stream. ``is_fragment`` if it is not the first part of a datagram, of which nothing is read.
    """

    sender: str
    payload: bytes
    is_cut: bool = False
    is_fragment: bool = False
    stream: bytes = b""
    sequence: int = 0
    is_start: bool = False
    is_end: bool = False


def parse_packet(packet: bytes) -> IpPacket | None:
    """A packet of IPv4 or IPv6 with UDP or TCP; None for others, and for those cut before their payload."""
    version = packet[0] >> 4 if packet else 0
    if version == 4 and len(packet) >= 20:
        start, protocol = 4 * (packet[0] & 15), packet[9]
        end = int.from_bytes(packet[2:4], "big") or len(packet)  # 0 where the network card cuts it in pieces
        is_fragment = bool(int.from_bytes(packet[6:8], "big") & 0x1FFF)
        ends, host = packet[12:20], ".".join(map(str, packet[12:16]))
    elif version == 6 and len(packet) >= 40:
        start, protocol, is_fragment = _skip_extensions(packet)
        end = 40 + int.from_bytes(packet[4:6], "big") if packet[4:6] != b"\0\0" else len(packet)
        ends, host = packet[8:40], f"[{IPv6Address(packet[8:24])}]"
    else:
        return None
    head = packet[start : start + (8 if protocol == _UDP else 20)]
    sender = f"{host}:{int.from_bytes(head[:2], 'big')}"
    if protocol == _UDP and is_fragment:
        return IpPacket(sender, b"", is_fragment=True)
    if protocol == _UDP and len(head) == 8:
        length = int.from_bytes(head[4:6], "big")
        payload = packet[start + 8 : start + length]
        return IpPacket(sender, payload, len(payload) < length - 8)
    if protocol == _TCP and len(head) == 20 and not is_fragment:
        payload = packet[start + 4 * (head[12] >> 4) : end]
        is_start, sequence = bool(head[13] & _SYN), int.from_bytes(head[4:8], "big")
        return IpPacket(
            sender, payload, len(packet) < end, False, ends + head[:4], (sequence + is_start) % _SEQUENCES,
            is_start, bool(head[13] & _ENDS),
        )  # fmt: skip
    return None


def _skip_extensions(packet: bytes) -> tuple[int, int, bool]:
    """Where the payload of a packet of IPv6 begins, its protocol, and whether it is a fragment, not the first."""
    start, protocol, is_fragment = 40, packet[6], False
    while protocol in (*_EXTENSIONS, _FRAGMENT) and start + 8 <= len(packet):
        if protocol == _FRAGMENT:
            is_fragment |= bool(int.from_bytes(packet[start + 2 : start + 4], "big") >> 3)
        length = 8 if protocol == _FRAGMENT else 8 + 8 * packet[start + 1]
        start, protocol = start + length, packet[start]
    return start, protocol, is_fragment


class StreamOrder:
    """The bytes of one direction of a connection, in their order and each once."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._waiting: dict[int, bytes] = {}

    def push(self, packet: IpPacket) -> tuple[bytes, bool]:
        """The bytes that follow upon those before, and whether some before them are missing from the capture.

        What came too early waits, up to a limit, for what is missing.
        """
        if self._next is None or packet.is_start:
            self._next = packet.sequence
        if not packet.payload:
            return b"", False
        self._waiting[packet.sequence] = max(self._waiting.get(packet.sequence, b""), packet.payload, key=len)
        data = self._following()
        if data or sum(map(len, self._waiting.values())) <= _MOST_WAITING_BYTES:
            return data, False
        return self.skip_gap(), True

    def skip_gap(self) -> bytes:
        """The bytes behind what is missing, as far as they follow upon each other; none if nothing waits."""
        if self._waiting:
            self._next = min(self._waiting, key=self._distance)
        return self._following()

    def _distance(self, sequence: int) -> int:
        """How far a byte is ahead of the next [-2^31, 2^31)."""
        return (sequence - (self._next or 0) + _SEQUENCES // 2) % _SEQUENCES - _SEQUENCES // 2

    def _following(self) -> bytes:
        data = b""
        for sequence in sorted(self._waiting, key=self._distance):
            known = -self._distance(sequence)
            if known < 0:
                break
            payload = self._waiting.pop(sequence)[known:]
            data += payload
            self._next = ((self._next or 0) + len(payload)) % _SEQUENCES
        return data
