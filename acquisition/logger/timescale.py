"""The time of a recording: UTC that never steps, whatever is done to the computer's clock.

The wall clock is taken once and carried on by the monotonic clock, so that order and durations stay right. Small
differences (a clock that is kept by NTP) are followed slowly; a step is told, and the next part of the recording
takes the new time.
"""

from __future__ import annotations

import ctypes

from acquisition.core.frames import Frame, now_ns

STEP_NS = 100_000_000  # what NTP corrects without a step is less; so is what a busy computer can feign
NEW_PART_NS = 1_000_000_000
_FOLLOW_SHARE = 500e-6  # the fastest that a kernel's clock is slewed
_TOLERANCE_NS = 1_000_000
_UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)


class Timescale:
    """UTC from the monotonic clock: ``utc = monotonic + offset_ns``."""

    def __init__(self, wall_ns: int, monotonic_ns: int) -> None:
        self.offset_ns = wall_ns - monotonic_ns
        self._wall_offset_ns = self.offset_ns
        self._followed_ns = monotonic_ns

    @classmethod
    def of_now(cls) -> Timescale:
        """The time scale that begins with the wall clock as it is."""
        return cls(*now_ns())

    def utc_ns(self, monotonic_ns: int) -> int:
        """The recording's UTC at a moment of the monotonic clock [ns]."""
        return monotonic_ns + self.offset_ns

    def stamped(self, frame: Frame) -> Frame:
        """The frame with its time of reception on this time scale; the same frame if it is there already."""
        received_ns = frame.monotonic_ns + self.offset_ns
        if -_TOLERANCE_NS < frame.received_ns - received_ns < _TOLERANCE_NS:
            return frame
        return frame._replace(received_ns=received_ns)

    def follow(self, wall_ns: int, monotonic_ns: int) -> int:
        """Look at the wall clock, and follow it slowly. Returns its step since the last look [ns], 0 for none."""
        wall_offset_ns = wall_ns - monotonic_ns
        step_ns = wall_offset_ns - self._wall_offset_ns
        self._wall_offset_ns = wall_offset_ns
        most_ns = int((monotonic_ns - self._followed_ns) * _FOLLOW_SHARE)
        self._followed_ns = monotonic_ns
        behind_ns = wall_offset_ns - self.offset_ns
        if abs(behind_ns) < NEW_PART_NS:
            self.offset_ns += max(-most_ns, min(most_ns, behind_ns))
        return step_ns if abs(step_ns) >= STEP_NS else 0

    @property
    def is_far_off(self) -> bool:
        """Whether the wall clock has gone so far that following it slowly is no use."""
        return abs(self._wall_offset_ns - self.offset_ns) >= NEW_PART_NS

    def adopt(self) -> None:
        """Take the wall clock's time from now on."""
        self.offset_ns = self._wall_offset_ns


def host_clock_state() -> str:
    """Whether the system says that something keeps its clock right: "kept by NTP or PTP", "free-running"."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))  # zeros: read only
    except (OSError, AttributeError):
        return "unknown"
    return "free-running" if state in (_UNSYNCHRONISED, -1) else "kept by NTP or PTP"
