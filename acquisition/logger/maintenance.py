"""What a recording does by the clock: flush, sync, a word on each source's health, a look at clock and disk.

Its time is UTC that never steps, whatever is done to the computer's clock: the wall clock is taken once and carried
on by the monotonic clock, so that order and durations stay right. Small differences (a clock that is kept by NTP)
are followed slowly; a step is told, and the next part of the recording takes the new time.
"""

from __future__ import annotations

import time

from seatrial.acquisition.config.sections import RecordingSection
from seatrial.acquisition.core.frames import Frame, now_ns
from seatrial.acquisition.logger.health import SILENT_NS, Health
from seatrial.acquisition.logger.host_clock import boot_metadata, kernel_state
from seatrial.acquisition.recording.grouping import NEW_PART_NS
from seatrial.acquisition.recording.parts import RecordingParts, Tell

STEP_NS = 100_000_000  # what NTP corrects without a step is less; so is what a busy computer can feign
_FOLLOW_SHARE = 500e-6  # the fastest that a kernel's clock is slewed
_TOLERANCE_NS = 1_000_000
TICK_S = 0.05
"""How late the recorder may look at the clock; flush and sync come so much earlier."""
_HEALTH_EVERY_S = 1.0
_GROWTH_SHARE = 0.1  # of the newest second in the mean rate of growth


class Timescale:
    """UTC from the monotonic clock, ``utc = monotonic + offset_ns``, beginning with the wall clock as given."""

    def __init__(self, wall_ns: int, monotonic_ns: int) -> None:
        self.offset_ns = wall_ns - monotonic_ns
        self._wall_offset_ns = self.offset_ns
        self._followed_ns = monotonic_ns

    def utc_ns(self, monotonic_ns: int) -> int:
        """The recording's UTC at a moment of the monotonic clock [ns]."""
        return monotonic_ns + self.offset_ns

    def stamp(self, frame: Frame) -> Frame:
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


def clock_metadata(scale: Timescale) -> dict[str, str]:
    """Which clock a part's times come from, and what relates them to those of a part by another one."""
    return {
        "times": "host clock when the part began, carried on by the monotonic clock",
        "host_clock": kernel_state(),
        "utc_minus_monotonic_ns": str(scale.offset_ns),
        **boot_metadata(),
    }


class Maintenance:
    """What one recording does by the clock; :meth:`tick` wants to be called every :data:`TICK_S` or so."""

    def __init__(
        self, settings: RecordingSection, parts: RecordingParts, health: Health, scale: Timescale, note: Tell
    ) -> None:
        self._settings, self._parts, self._health, self._scale, self._note = settings, parts, health, scale, note
        self._flushed_s = self._synced_s = self._reported_s = time.monotonic()
        self._silent: dict[str, int] = {}
        self._written_bytes = 0

    def tick(self) -> None:
        now_s = time.monotonic()
        self._look_at_the_clock()
        self._parts.tick(now_s)
        if now_s - self._reported_s >= _HEALTH_EVERY_S:
            self._report(now_s)
        if now_s - self._flushed_s >= self._settings.flush_s - TICK_S:
            self._parts.flush()
            self._flushed_s = now_s
        # A disk that is still busy with the last time is asked again as soon as it is not.
        if now_s - self._synced_s >= self._settings.sync_s - TICK_S and self._parts.sync_soon():
            self._synced_s = now_s

    def _look_at_the_clock(self) -> None:
        step_ns = self._scale.follow(*now_ns())
        if not step_ns:
            return
        text = f"the computer's clock was set by {step_ns / 1e9:+.3f} s"
        if not self._scale.is_far_off:
            self._note("warning", f"{text}; the times in this recording follow it slowly")
            return
        self._note(
            "warning", f"{text}; times in {self._parts.path.name} keep the old time, the next part has the new"
        )
        self._scale.adopt()
        self._parts.set_clock(clock_metadata(self._scale), "the computer's clock was set")
        self._note("warning", f"{text}; times in {self._parts.path.name} are by the new time")

    def _report(self, now_s: float) -> None:
        self._listen(time.monotonic_ns())
        self._watch_the_disk(now_s - self._reported_s)
        self._reported_s = now_s
        self.report_sources()

    def report_sources(self) -> None:
        """Record the state of each source and of the computer's clock."""
        if self._parts.paused:
            return
        now = time.monotonic_ns()
        for source in self._health.sources.values():
            self._parts.write_health(source.as_message(now), self._scale.utc_ns(now))
        if self._health.clock.state != "unknown":
            self._parts.write_health(self._health.clock.as_message(), self._scale.utc_ns(now))

    def _listen(self, now: int) -> None:
        """Say when sources fall silent and when they are heard again, of several at once in one event.

        One that has failed is no news until it is back.
        """
        silent_now, mute, gaps_s = list[str](), list[str](), dict[str, float]()
        for source in self._health.sources.values():
            silent = source.is_silent(now) and now - self._health.started_ns > SILENT_NS
            if silent and source.name not in self._silent and source.failed_ns is None:
                self._silent[source.name] = source.last_ns or self._health.started_ns
                (silent_now if source.frames else mute).append(source.name)
            elif not silent and source.state == "open" and source.name in self._silent:
                gaps_s[source.name] = ((source.last_ns or now) - self._silent.pop(source.name)) / 1e9
        self._note_sources(mute, "has said nothing yet", "have said nothing yet")
        self._note_sources(silent_now, "has fallen silent", "have fallen silent")
        gap = f"{max(gaps_s.values(), default=0.0):.1f} s"
        self._note_sources(list(gaps_s), f"is heard again after {gap}", f"are heard again after up to {gap}")

    def _note_sources(self, names: list[str], verb: str, verb_of_several: str) -> None:
        if len(names) == 1:
            self._note("warning", f"source {names[0]!r} {verb}")
        elif names:
            self._note("warning", f"{len(names)} sources {verb_of_several}: {', '.join(names)}")

    def _watch_the_disk(self, since_s: float) -> None:
        health, parts = self._health, self._parts
        rate = (parts.written_bytes - self._written_bytes) / max(since_s, 1e-3)
        self._written_bytes = parts.written_bytes
        health.bytes_per_s += _GROWTH_SHARE * (rate - health.bytes_per_s) if health.bytes_per_s else rate
        health.free_bytes, health.trouble, health.part = parts.room_bytes, parts.trouble, parts.path.name
