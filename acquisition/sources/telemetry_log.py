"""MAVLink packets from a telemetry log (.tlog): 8 bytes of time before each packet, as ground stations write it.

Damage costs no more than itself: what is no entry becomes a frame of its own, for the decoder to count, and the
log goes on at the next time that can be true and has a packet after it.
"""

from __future__ import annotations

import re
from typing import BinaryIO

from acquisition.core.frames import Frame
from acquisition.decoders.clock import is_possible
from acquisition.decoders.mavlink_packets import LONGEST_BYTES, extent, is_signed, is_sound
from acquisition.sources import LogReader

_TIME_BYTES = 8
_MICRO_NS = 1000
_BLOCK_BYTES = 4096  # some 100 entries, at most 256
_LONGEST_DAMAGE_BYTES = 65_536  # in one frame; within it no packet is cut in two
_LOOK_AHEAD_BYTES = 2 * (_TIME_BYTES + LONGEST_BYTES) + 1  # an entry, and one that may begin inside it
# A clock may be set during a log, but then all that follows is on the new time; one time far from both its
# neighbours is damaged.
_JUMP_NS = 60 * 10**9
# Microseconds of a possible time (2010 to 2100), then a packet's first byte.
_MAY_BE_ENTRY = re.compile(rb"(?=\x00[\x04-\x0e].{6}[\xfd\xfe])", re.DOTALL)


def time_at(data: bytes, at: int) -> int | None:
    """The time of the entry that begins at ``at`` [ns UTC]; None where none can begin there."""
    header = data[at : at + _TIME_BYTES + 1]
    if len(header) <= _TIME_BYTES or header[-1] not in (0xFD, 0xFE):
        return None
    time_ns = int.from_bytes(header[:_TIME_BYTES], "big") * _MICRO_NS
    return time_ns if is_possible(time_ns) else None


def entry_end(data: bytes, at: int) -> int | None:
    """Where the entry that begins at ``at`` ends; None where it is none, or is cut off.

    A packet whose length no checksum confirms (of an unknown message, a signed one) is believed where another
    entry follows, or the end of ``data``, which may be within a time, and no sound entry begins inside.
    """
    if time_at(data, at) is None:
        return None
    packet = at + _TIME_BYTES
    length = extent(data, packet)
    end = packet + length
    if length == 0 or end > len(data):
        return None
    if is_sound(data, packet) and not is_signed(data, packet):
        return end
    followed = end + _TIME_BYTES >= len(data) or time_at(data, end) is not None
    inside = _MAY_BE_ENTRY.finditer(data, at + 1, end + _TIME_BYTES)
    return end if followed and not any(is_sound(data, each.end() + _TIME_BYTES) for each in inside) else None


def next_entry(data: bytes, at: int, settled: int) -> int | None:
    """Where the next entry begins, from ``at`` on; one beyond ``settled`` may yet turn out to be none."""
    for each in _MAY_BE_ENTRY.finditer(data, at):
        if each.start() >= settled or entry_end(data, each.start()) is not None:
            return each.start()
    return None


class TelemetryLog(LogReader):
    """One log; every frame has the log's time and no other."""

    def _begin(self, file: BinaryIO) -> None:
        beginning = file.read(_LONGEST_DAMAGE_BYTES)
        file.seek(0)
        first = next_entry(beginning, 0, len(beginning))
        time_ns = None if first is None else time_at(beginning, first)
        self._time_ns = time_ns or self._config.path.stat().st_mtime_ns
        self._monotonic_ns, self._data = 0, b""

    def _next(self, file: BinaryIO) -> list[Frame] | None:
        block = file.read(_BLOCK_BYTES)
        self._data += block
        frames = self._frames(ended=not block)
        return frames if frames or block else None

    def _frames(self, *, ended: bool) -> list[Frame]:
        """The frames in the bytes at hand; what may yet turn out to be an entry is left for the next time."""
        data, frames, at = self._data, [], 0
        settled = len(data) - (0 if ended else _LOOK_AHEAD_BYTES)
        while at < settled:
            end, payload_from = entry_end(data, at), at + _TIME_BYTES
            if end is None:
                end, payload_from = next_entry(data, at + 1, settled), at
                if end is None and not ended and len(data) - at < _LONGEST_DAMAGE_BYTES:
                    break
                end = settled if end is None else end
            else:
                self._time_ns = self._believed(data, at, end)
            frames.append(self._frame(data[payload_from:end]))
            at = end
        self._data = data[at:]
        return frames

    def _believed(self, data: bytes, at: int, end: int) -> int:
        """The time of the entry, unless the one before and the one after agree that it is wrong [ns UTC]."""
        time_ns, next_ns = time_at(data, at) or self._time_ns, time_at(data, end) if end < len(data) else None
        jumps = abs(time_ns - self._time_ns) > _JUMP_NS
        if jumps and next_ns is not None and abs(next_ns - self._time_ns) < abs(next_ns - time_ns):
            return self._time_ns
        return time_ns

    def _frame(self, payload: bytes) -> Frame:
        self._monotonic_ns = max(self._monotonic_ns, self._time_ns)
        return Frame(self.name, "mavlink", payload, self._time_ns, self._monotonic_ns, stamped_ns=self._time_ns)
