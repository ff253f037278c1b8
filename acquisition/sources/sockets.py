"""What Linux tells of a socket (when something came, how many it had no room for), who sends to it and who may."""

from __future__ import annotations

import ipaddress
import socket
import struct
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress

from seatrial.acquisition.core.frames import NANO, now_ns

_SO_RCVBUFFORCE, _SO_TIMESTAMPNS, _SO_MEMINFO = 33, 35, 55  # Python has no names for them
_DROPPED = 8  # the place of the count among the numbers of SO_MEMINFO
_MEMINFO_BYTES = 36
_OLDEST_NS = 60 * NANO  # a frame that waited longer has been stamped by another clock, or ours has been set
_MOST_SENDERS = 100  # senders' addresses can be forged: there is no end to them

Network = ipaddress.IPv4Network | ipaddress.IPv6Network
_TIME = struct.Struct("@ll")
TIME_BYTES = socket.CMSG_SPACE(_TIME.size)
"""Room for a stamp in ``recvmsg``."""


def enlarge(opened: socket.socket, size_bytes: int) -> None:
    """Ask for so large a receive buffer; without the right to exceed it the system's ``rmem_max`` holds."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size_bytes)
    except OSError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size_bytes)


def stamp_arrivals(opened: socket.socket) -> None:
    """Ask the system to stamp what comes, as far as it can."""
    with suppress(OSError):
        opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


def arrival_ns(more: list[tuple[int, int, bytes]]) -> int | None:
    """The stamp in the ancillary data of ``recvmsg`` [ns since 1970]; None where there is none."""
    for level, kind, data in more:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) >= _TIME.size:
            seconds, nanoseconds = _TIME.unpack_from(data)
            return int(seconds * NANO + nanoseconds)
    return None


def dropped(opened: socket.socket) -> int:
    """How many datagrams or frames the system has had no room for, modulo 2^32; 0 where it does not tell."""
    try:
        meminfo = opened.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO_BYTES)
    except OSError:
        return 0
    return int(struct.unpack_from("@I", meminfo, 4 * _DROPPED)[0]) if len(meminfo) == _MEMINFO_BYTES else 0


def received_at(stamp_ns: int | None) -> tuple[tuple[int, int], bool]:
    """The wall and the monotonic clock [ns] when something came, and whether its stamp tells; if not, now."""
    wall_ns, monotonic_ns = now_ns()
    waited_ns = -1 if stamp_ns is None else wall_ns - stamp_ns
    if stamp_ns is None or not 0 <= waited_ns < _OLDEST_NS:
        return (wall_ns, monotonic_ns), False
    return (stamp_ns, monotonic_ns - waited_ns), True


class Drops:
    """How many the system dropped of one socket since the last look."""

    def __init__(self, opened: socket.socket) -> None:
        self._socket, self._before = opened, dropped(opened)

    def since(self) -> int:
        now = dropped(self._socket)
        count, self._before = (now - self._before) % 2**32, now
        return count


class Senders:
    """The senders that a source has heard. ``allowed`` are their networks; none: everybody may send.

    ``refused`` counts what came from others, by reason; ``news`` names each of these once, and each but the
    first of those that may send, as (level, text), and is emptied by who tells them.
    """

    def __init__(self, allowed: Sequence[Network]) -> None:
        self._allowed = tuple(allowed)
        self._senders: dict[str, bool] = {}
        self.refused: Counter[str] = Counter()
        self.news: deque[tuple[str, str]] = deque()

    def admits(self, sender: str) -> bool:
        """Whether something from this address (IPv4 or IPv6, without a port) may come in."""
        may = self._senders.get(sender)
        if may is None:
            address = ipaddress.ip_address(sender.partition("%")[0])
            may = not self._allowed or any(address in network for network in self._allowed)
            if len(self._senders) < _MOST_SENDERS:
                if not may:
                    self.news.append(("warning", f"{sender} sends and may not"))
                elif any(self._senders.values()):
                    self.news.append(("info", f"{sender} sends, too: its values are kept apart"))
                self._senders[sender] = may
        if not may:
            self.refused["sender that is not allowed"] += 1
        return may
