"""What Linux tells of a socket: when a datagram or a CAN frame came, and how many it had no room for."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress

from acquisition.core.frames import NANO, now_ns

_SO_RCVBUFFORCE, _SO_TIMESTAMPNS, _SO_MEMINFO = 33, 35, 55  # Python has no names for them
_DROPPED = 8  # the place of the count among the numbers of SO_MEMINFO
_MEMINFO_BYTES = 36
_OLDEST_NS = 60 * NANO  # a frame that waited longer has been stamped by another clock, or ours has been set
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
            seconds, rest = _TIME.unpack_from(data)
            return int(seconds * NANO + rest)
    return None


def dropped(opened: socket.socket) -> int:
    """How many datagrams or frames the system has had no room for, modulo 2^32; 0 where it does not tell."""
    try:
        told = opened.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO_BYTES)
    except OSError:
        return 0
    return int(struct.unpack_from("@I", told, 4 * _DROPPED)[0]) if len(told) == _MEMINFO_BYTES else 0


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
