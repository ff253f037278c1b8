"""Log files to a recording: no threads, no hurry, in the order of their own times."""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from operator import attrgetter

from acquisition.config.configuration import TrialConfig
from acquisition.core.frames import Frame, iso
from acquisition.logger.health import Health
from acquisition.logger.processing import FrameProcessor
from acquisition.logger.supervision import LOG
from acquisition.recording.parts import RecordingParts
from acquisition.sources import Source, make_source

_CHORES_EVERY = 2_000  # frames; as seldom as the files' times allow, as often as memory wants
_TELL_EVERY_S = 5.0
_POLL_S = 0.2
_RECEIVED = attrgetter("received_ns")
_WITHOUT_TIMES = (
    "the log has no times of its own; its samples are stamped with the time of reading, unless it tells the time "
    'and clock = "source"'
)


def record_log_files(
    config: TrialConfig,
    parts: RecordingParts,
    health: Health,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Everything in the configuration's log files, merged by time, until their end.

    ``duration_s`` counts in the files' own time. Raises :class:`SourceError` for a file that cannot be read.
    """
    with ExitStack() as stack:
        sources = [make_source(each) for each in config.sources]
        for source in sources:
            source.open()
            stack.callback(source.close)
        reading = _Reading(FrameProcessor(config, parts, health), parts, stop or threading.Event())
        frames = heapq.merge(*(reading.frames(source, health) for source in sources), key=_RECEIVED)
        reading.take(frames, float("inf") if duration_s is None else duration_s * 1e9)
        for source in sources:
            _tell_troubles(source, reading)
        reading.tell("info", "recording stopped")


def _tell_troubles(source: Source, reading: _Reading) -> None:
    if unreadable := getattr(source, "unreadable", 0):
        lines = "line" if unreadable == 1 else "lines"
        reading.tell("warning", f"{source.name}: {unreadable:,} {lines} of the log could not be read")
    if damage := getattr(source, "damage", ""):
        reading.tell("error", f"{source.name}: {damage}")


class _Reading:
    """Frames of logs on their way into a recording; ``now_ns`` is how far the logs have come."""

    def __init__(self, processing: FrameProcessor, parts: RecordingParts, stop: threading.Event) -> None:
        self._processing, self._parts, self._stop = processing, parts, stop
        self.now_ns = time.time_ns()  # until a log tells another
        self._told_s = time.monotonic()
        self._untimed: list[str] = []  # sources whose logs have no times, as yet untold
        parts.tell = self.tell

    def tell(self, level: str, text: str) -> None:
        """Put an event into the recording, at the time that the logs have come to."""
        self._processing.note(text, self.now_ns, level)

    def take(self, frames: Iterator[Frame], duration_ns: float) -> None:
        """Process the frames until their end, the duration's, or until told to stop."""
        until_ns = float("inf")
        for number, frame in enumerate(frames):
            self.now_ns = frame.received_ns
            if number == 0:
                until_ns = self.now_ns + duration_ns
                self._tell_beginning()
            if self.now_ns > until_ns or self._stop.is_set():
                break
            self._processing.process(frame)
            if number % _CHORES_EVERY == _CHORES_EVERY - 1:
                self._do_chores(number + 1)

    def frames(self, source: Source, health: Health) -> Iterator[Frame]:
        """A log's frames, as fast as they are taken; at the first it shows whether the log has times."""
        seen = health.sources[source.name]
        while (block := source.read(0.0)) is not None:
            if block:
                if not seen.frames and not _has_times(source, block):
                    self._untimed.append(source.name)
                    self._processing.mute_clocks(source.name)
                seen.saw(len(block), block[-1].monotonic_ns)
                yield from block
        seen.state = "ended"

    def _tell_beginning(self) -> None:
        self.tell("info", "recording started, from log files")
        for name in self._untimed:
            self.tell("warning", f"{name}: {_WITHOUT_TIMES}")

    def _do_chores(self, frames: int) -> None:
        self._parts.sync()
        self._parts.look_after(time.monotonic())
        while self._parts.paused and not self._stop.wait(_POLL_S):  # a file can wait for the disk
            self._parts.look_after(time.monotonic())
        if time.monotonic() - self._told_s >= _TELL_EVERY_S:
            LOG.info("%s frames, up to %s", f"{frames:,}", iso(self.now_ns))
            self._told_s = time.monotonic()


def _has_times(source: Source, block: list[Frame]) -> bool:
    """Whether a log tells times; those since its beginning bear no stamp, but keep the frames' distances."""
    return any(frame.stamped_ns is not None for frame in block) or getattr(source, "timed", False)
