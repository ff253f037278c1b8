"""MAVLink packets from a telemetry log (.tlog): 8 bytes of time before each packet, as ground stations write it.

Damage costs no more than itself: what is no entry becomes a frame of its own, for the decoder to count, and the
log goes on at the next time that can be true and has a packet after it.

A ground station or companion computer whose clock was not set writes times from 1970 or 2000 on. Their distances
are right; the date is taken from where the log itself states it, or from the file, and that is said.
"""

from __future__ import annotations

import re
from typing import BinaryIO

from seatrial.acquisition.core.frames import NANO, Frame, iso
from seatrial.acquisition.decoders.clock import is_possible
from seatrial.acquisition.decoders.mavlink_packets import LONGEST_BYTES, extent, header_of, is_signed, is_sound
from seatrial.acquisition.sources import LogReader

_TIME_BYTES = 8
_MICRO_NS = 1000
_BLOCK_BYTES = 4096  # some 100 entries, at most 256
_LONGEST_DAMAGE_BYTES = 65_536  # in one frame; within it no packet is cut in two
_LOOK_AHEAD_BYTES = 2 * (_TIME_BYTES + LONGEST_BYTES) + 1  # an entry, and one that may begin inside it
# A clock may be set during a log, but then all that follows is on the new time; one time far from both its
# neighbours is damaged.
_JUMP_NS = 60 * NANO
_MOST_STEPS = 10_000
# Microseconds of a time before 2100, then a packet's first byte.
_MAY_BE_ENTRY = re.compile(rb"(?=\x00[\x00-\x0e].{6}[\xfd\xfe])", re.DOTALL)
_LATEST_NS = 4_102_444_800 * NANO  # 2100
_SYSTEM_TIME = 2  # the message whose first eight bytes are the microseconds since 1970


def time_at(data: bytes, at: int) -> int | None:
    """The time of the entry that begins at ``at`` [ns, as it stands there]; None where none can begin there."""
    header = data[at : at + _TIME_BYTES + 1]
    if len(header) <= _TIME_BYTES or header[-1] not in (0xFD, 0xFE):
        return None
    time_ns = int.from_bytes(header[:_TIME_BYTES], "big") * _MICRO_NS
    return time_ns if time_ns < _LATEST_NS else None


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
    return end if followed and not any(is_sound(data, match.end() + _TIME_BYTES) for match in inside) else None


def next_entry(data: bytes, at: int, settled: int) -> int | None:
    """Where the next entry begins, from ``at`` on; one beyond ``settled`` may yet turn out to be none."""
    for match in _MAY_BE_ENTRY.finditer(data, at):
        if match.start() >= settled or entry_end(data, match.start()) is not None:
            return match.start()
    return None


class TelemetryLog(LogReader):
    """One log; every frame has the log's time and no other. ``remark`` is what should be known of its times."""

    def _begin(self, file: BinaryIO) -> None:
        beginning = file.read(_LONGEST_DAMAGE_BYTES)
        first = next_entry(beginning, 0, len(beginning))
        time_ns = None if first is None else time_at(beginning, first)
        changed_ns = self._config.path.stat().st_mtime_ns
        self._behind_ns, self._steps, self._date = 0, list[tuple[int, int]](), ""
        began_ns = changed_ns if time_ns is None else time_ns
        self._restart(file, began_ns)
        if not is_possible(began_ns):
            self._behind_ns, self._date = self._clock_error(file, changed_ns)
            self._restart(file, began_ns)

    def _restart(self, file: BinaryIO, began_ns: int) -> None:
        file.seek(0)
        self._time_ns, self._monotonic_ns, self._data = began_ns, 0, b""
        self._steps.clear()

    def _clock_error(self, file: BinaryIO, changed_ns: int) -> tuple[int, str]:
        """How far a clock that was not set is behind UTC [ns], and who says so: the first to state it."""
        last_ns = self._time_ns
        while (frames := self._next(file)) is not None:
            for frame in frames:
                if is_possible(frame.received_ns):
                    return frame.received_ns - last_ns, "where that clock was set later"
                last_ns = frame.received_ns
                if (utc_ns := _stated_utc_ns(frame.payload)) is not None:
                    return utc_ns - last_ns, "SYSTEM_TIME in it"
        return changed_ns - last_ns, "the file's last change"

    @property
    def remark(self) -> str:
        remarks = []
        if self._date:
            remarks.append(
                f"the clock of the log was not set: it is {self._behind_ns / NANO:,.0f} s behind; distances in"
                f" time are its own, the date is by {self._date}"
            )
        if self._steps:
            at_ns, step_ns = self._steps[0]
            more = f", and {len(self._steps) - 1} times more" if len(self._steps) > 1 else ""
            remarks.append(f"its clock was set by {step_ns / NANO:+,.0f} s at {iso(at_ns)}{more}")
        return "; ".join(remarks)

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
                self._go_on(self._believed(data, at, end))
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

    def _go_on(self, time_ns: int) -> None:
        before_ns, after_ns = self._utc_ns(self._time_ns), self._utc_ns(time_ns)
        if abs(after_ns - before_ns) > _JUMP_NS and len(self._steps) < _MOST_STEPS:
            self._steps.append((after_ns, after_ns - before_ns))
        self._time_ns = time_ns

    def _utc_ns(self, time_ns: int) -> int:
        """A time of the log as UTC: by a clock that was not set it is behind."""
        return time_ns if is_possible(time_ns) else time_ns + self._behind_ns

    def _frame(self, payload: bytes) -> Frame:
        time_ns = self._utc_ns(self._time_ns)
        self._monotonic_ns = max(self._monotonic_ns, time_ns)
        return Frame(self.name, "mavlink", payload, time_ns, self._monotonic_ns, stamped_ns=time_ns)


def _stated_utc_ns(packet: bytes) -> int | None:
    """The UTC that an intact SYSTEM_TIME states [ns since 1970]; None of all others."""
    if not packet or extent(packet, 0) != len(packet) or not is_sound(packet):
        return None
    if header_of(packet).message_id != _SYSTEM_TIME:
        return None
    header_bytes, length = (6 if packet[0] == 0xFE else 10), packet[1]  # trailing zeros are left out
    utc_ns = int.from_bytes(packet[header_bytes : header_bytes + min(length, 8)], "little") * _MICRO_NS
    return utc_ns if is_possible(utc_ns) else None
