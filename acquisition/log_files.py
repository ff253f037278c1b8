"""Log files to a recording: no threads, no hurry, in the order of their own times."""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Iterator
from operator import attrgetter

from acquisition.config import TrialConfig
from acquisition.frames import Frame
from acquisition.health import Health
from acquisition.processing import Processing
from acquisition.recording.parts import RecordingParts
from acquisition.sources import Source, make_source

_CHORES_EVERY = 2_000  # frames; as seldom as the files' times allow, as often as memory wants


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
    processing = Processing(config, parts, health)
    sources = [make_source(each) for each in config.sources]
    parts.tell = lambda level, text: processing.note(text, now_ns, level)
    now_ns = time.time_ns()  # until a log tells another
    try:
        for source in sources:
            source.open()
        until_ns: float = float("inf")
        merged = heapq.merge(*(_frames(source, health) for source in sources), key=attrgetter("received_ns"))
        for number, frame in enumerate(merged):
            now_ns = frame.received_ns
            if number == 0:
                processing.note("recording started, from log files", now_ns)
                until_ns = now_ns + (float("inf") if duration_s is None else duration_s * 1e9)
            if now_ns > until_ns or (stop is not None and stop.is_set()):
                break
            processing.process(frame)
            if number % _CHORES_EVERY == _CHORES_EVERY - 1:
                parts.sync()
                parts.look_after(time.monotonic())
        for source in sources:
            if unreadable := getattr(source, "unreadable", 0):
                processing.note(
                    f"{source.name}: {unreadable:,} lines of the log could not be read", now_ns, "warning"
                )
        processing.note("recording stopped", now_ns)
    finally:
        for source in sources:
            source.close()


def _frames(source: Source, health: Health) -> Iterator[Frame]:
    seen = health.sources[source.name]
    while (block := source.read(0.0)) is not None:
        if block:
            seen.saw(len(block), block[-1].monotonic_ns)
            yield from block
    seen.state = "ended"
