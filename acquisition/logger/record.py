"""Makes one recording from start to end (``seatrial record``): live, with display and marks, or from log files.

Log files are read without threads, as fast as the disk allows, in the order of their own times.
"""

from __future__ import annotations

import heapq
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from operator import attrgetter
from pathlib import Path

from rich.live import Live

from seatrial.acquisition.config.sources import FILE_SOURCES, LiveSection
from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core.errors import ConfigurationError, SeatrialError, SourceError, Terminal
from seatrial.acquisition.core.trial import NANO, Frame, iso, now_ns
from seatrial.acquisition.logger.display import LiveView, Picture, StatusPage, mark_on_keys, status
from seatrial.acquisition.logger.health import (
    LOG,
    Alarms,
    Health,
    LogFormat,
    SourceHealth,
    check_alarms,
    log_to,
    notify,
)
from seatrial.acquisition.logger.maintenance import Copies, Timescale, clock_metadata, require_separate_folder
from seatrial.acquisition.logger.pipeline import NO_THREAD, Recorder, health_of
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.logger.requests import RecorderState, RequestServer
from seatrial.acquisition.protocols import BAD_DATA
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.sources import Source, make_source

_LOOK_S = 0.05
_REDRAW_PER_S = 4.0
_WATCHDOG_PERIOD_S = 1.0
_FRAMES_PER_TICK = 2_000  # frames; as seldom as the files' times allow, as often as memory wants
_PROGRESS_PERIOD_S = 5.0
_POLL_S = 0.2
_MOST_NAMED = 20  # messages that carry no channel: a bus has some dozens of kinds
_WITHOUT_TIMES = (
    "the log has no times of its own; its samples are stamped with the time of reading, unless it tells the time "
    'and clock = "source"'
)


def record(
    config: TrialConfig,
    folder: Path,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
    log_format: LogFormat = "text",
    live: bool = False,
) -> tuple[list[Path], Health]:
    """Record until ``stop`` is set, ``duration_s`` is over, or every source has ended.

    Returns the recording's parts and its health. Raises :class:`SourceError` when no source at all can be
    opened, :class:`ConfigurationError` for what only a decoder can find wrong (no file remains then),
    :class:`StorageError` when the disk fails and messages are lost.
    """
    stop = stop or threading.Event()
    from_files = all(isinstance(source, FILE_SOURCES) for source in config.sources)
    with nullcontext() if sys.stderr.isatty() and not from_files else log_to(sys.stderr, log_format):
        if from_files:
            return _record_files(config, folder, duration_s, stop)
        return _record_live(config, folder, duration_s, stop, live)


def _record_live(
    config: TrialConfig, folder: Path, duration_s: float | None, stop: threading.Event, live: bool
) -> tuple[list[Path], Health]:
    if config.copies is not None:
        require_separate_folder(config.copies, folder)
    check_alarms(config.alarms, health_of(config))
    scale = Timescale(*now_ns())
    clock = clock_metadata(scale)
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    copies = None if config.copies is None else Copies(config.copies, folder, config.trial.name, parts)
    with ExitStack() as stack:
        if copies is not None:
            stack.callback(copies.stop)  # last of all: the last part is copied too
        stack.callback(parts.close)
        try:
            recorder = Recorder(config, parts, scale)
            recorder.start()
        except (ConfigurationError, SourceError):
            stack.pop_all()
            parts.discard()
            raise
        stack.callback(recorder.stop)  # whatever becomes of the display, the recorder ends before its files
        if copies is not None:
            recorder.health.copies = copies.state
            if not copies.start():
                recorder.tell("error", f"no copies: {NO_THREAD}; the next recording makes them")
        if config.missing_channels:
            LOG.warning("no source provides %s", ", ".join(config.missing_channels))
        state = partial(_recorder_state, config, recorder.health, parts)
        _try_enter(stack, RequestServer(recorder.mark, state, recorder.predictions), recorder)
        if live or config.live is not None:
            view = LiveView(config.live or LiveSection(), config.trial)
            if _try_enter(stack, view, recorder):
                parts.listeners.append(view.publish)
                LOG.info("live view at %s", view.address)
        picture = Picture(recorder.health, config.expected_channels, config.marks)
        if config.status is not None:
            shown = StatusPage(config.status, replace(picture, marks=None), config.trial.name)
            if _try_enter(stack, shown, recorder):
                LOG.info("status page at %s", shown.address)
        _try_enter(stack, Alarms(config.alarms, recorder.health, partial(recorder.tell, name="alarm")), recorder)
        _try_enter(stack, _display(picture, recorder), recorder)
        LOG.info("recording to %s", parts.path)
        notify("READY=1")
        _wait(recorder, stop, duration_s)
        notify("STOPPING=1")
    if config.copies is None:
        return parts.paths, recorder.health
    target = config.copies.folder  # where what was deleted here has a copy
    return [path if os.path.lexists(path) else target / path.name for path in parts.paths], recorder.health


def _recorder_state(config: TrialConfig, health: Health, parts: RecordingParts) -> RecorderState:
    return RecorderState(
        trial=config.trial.name,
        configuration=str(config.path.absolute()),
        recording=str(parts.path.absolute()),
        paused=parts.paused,
        process=os.getpid(),
        predictions=health.predictions,
        predictions_refused=health.predictions_refused + health.predictions_dropped,
    )


def _record_files(
    config: TrialConfig, folder: Path, duration_s: float | None, stop: threading.Event
) -> tuple[list[Path], Health]:
    """Record everything in the configuration's log files, merged by time, until their end.

    ``duration_s`` counts in the files' own time. Raises :class:`SourceError` for a file that cannot be read.
    """
    health = health_of(config)
    clock = {"times": "of the log files"}
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    with ExitStack() as stack:
        stack.callback(parts.close)
        try:
            LOG.info("recording to %s", parts.path)
            with ExitStack() as open_sources:
                sources = [make_source(section) for section in config.sources]
                for source in sources:
                    source.open()
                    open_sources.callback(source.close)
                reading = _Reading(FrameProcessor(config, parts, health), parts, health, stop)
                frames = heapq.merge(*map(reading.frames, sources), key=attrgetter("received_ns"))
                reading.take(frames, float("inf") if duration_s is None else duration_s * 1e9)
                for source in sources:
                    _report_faults(source, health.sources[source.name], reading)
                reading.report_sources()
                reading.tell("info", "recording stopped")
        except (ConfigurationError, SourceError):
            if not any(source.frames for source in health.sources.values()):
                stack.pop_all()
                parts.discard()
            raise
    return parts.paths, health


def _wait(recorder: Recorder, stop: threading.Event, duration_s: float | None) -> None:
    until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
    notified_s = 0.0
    while not recorder.ended and time.monotonic() < until_s:
        if time.monotonic() - notified_s > _WATCHDOG_PERIOD_S and recorder.alive:
            notify(f"WATCHDOG=1\nSTATUS={status(recorder.health)}")
            notified_s = time.monotonic()
        if stop.wait(_LOOK_S):
            return


def _try_enter(stack: ExitStack, extra: AbstractContextManager[object], recorder: Recorder) -> bool:
    """Enter what a recording can do without; where it is unavailable, report it and record all the same."""
    try:
        stack.enter_context(extra)
    except (SeatrialError, OSError, RuntimeError) as error:  # the last: no thread
        recorder.tell("warning", str(error))
        return False
    return True


@contextmanager
def _display(picture: Picture, recorder: Recorder) -> Iterator[None]:
    if not sys.stderr.isatty():
        yield
        return
    # screen: a window that is resized leaves no debris, and the terminal is restored
    live = Live(picture, console=Terminal(stderr=True), refresh_per_second=_REDRAW_PER_S, screen=True)
    with mark_on_keys(recorder.mark, picture.marks or {}), live:
        yield


def _report_faults(source: Source, health: SourceHealth, reading: _Reading) -> None:
    if remark := getattr(source, "remark", ""):
        reading.tell("warning", f"{source.name}: {remark}")
    if unreadable := getattr(source, "unreadable", 0):
        lines = "line" if unreadable == 1 else "lines"
        reading.tell("warning", f"{source.name}: {unreadable:,} {lines} of the log could not be read")
    if bad := health.reasons.get(BAD_DATA):
        places = "place" if bad == 1 else "places"
        reading.tell("warning", f"{source.name}: no packet that can be read at {bad:,} {places} of the log")
    refusals = sorted(health.reasons.items(), key=lambda item: -item[1])
    refused = [f"{reason} ({count:,})" for reason, count in refusals if reason != BAD_DATA]
    if refused:
        reading.tell("info", f"{source.name}: not used, but recorded raw: {', '.join(refused)}")
    if unknown := sorted(health.unknown.items(), key=lambda item: -item[1]):
        named = ", ".join(f"{name} ({count:,})" for name, count in unknown[:_MOST_NAMED])
        further = f" and {len(unknown) - _MOST_NAMED} more" if len(unknown) > _MOST_NAMED else ""
        reading.tell("info", f"{source.name}: carries no channel, but recorded raw: {named}{further}")
    if damage := getattr(source, "damage", ""):
        reading.tell("error", f"{source.name}: {damage}")


class _Reading:
    """Frames of logs on their way into a recording; ``now_ns`` is how far the logs have come."""

    def __init__(
        self, processing: FrameProcessor, parts: RecordingParts, health: Health, stop: threading.Event
    ) -> None:
        self._processing, self._parts, self._health, self._stop = processing, parts, health, stop
        self._reported_ns = 0  # when by the logs' time the state of the sources was last reported
        self.now_ns = time.time_ns()  # until a log states another
        self._reported_s = time.monotonic()
        self._untimed: list[str] = []  # sources whose logs have no times, not reported yet
        parts.tell = self.tell

    def tell(self, level: str, text: str) -> None:
        """Put an event into the recording, at the time that the logs have come to."""
        self._processing.note(text, self.now_ns, level)

    def take(self, frames: Iterator[Frame], duration_ns: float) -> None:
        """Process the frames until their end, the duration's, or until ``stop`` is set."""
        until_ns = float("inf")
        for number, frame in enumerate(frames):
            self.now_ns = frame.received_ns
            if number == 0:
                until_ns = self.now_ns + duration_ns
                self._health.started_ns = self.now_ns
                self.tell("info", "recording started, from log files")
                for name in self._untimed:
                    self.tell("warning", f"{name}: {_WITHOUT_TIMES}")
            if self.now_ns > until_ns or self._stop.is_set():
                break
            self._health.ended_ns = max(self.now_ns, self._health.started_ns)
            self._processing.process(frame)
            if abs(self.now_ns - self._reported_ns) >= NANO:
                self.report_sources()
            if number % _FRAMES_PER_TICK == _FRAMES_PER_TICK - 1:
                self._parts.sync()
                self._parts.tick(time.monotonic())
                while self._parts.paused and not self._stop.wait(_POLL_S):  # a file can wait for the disk
                    self._parts.tick(time.monotonic())
                if time.monotonic() - self._reported_s >= _PROGRESS_PERIOD_S:
                    LOG.info("%s frames, up to %s", f"{number + 1:,}", iso(self.now_ns))
                    self._reported_s = time.monotonic()
        self._processing.report_handovers()

    def report_sources(self) -> None:
        """Record the state of each source, at the time that the logs have come to."""
        self._reported_ns = self.now_ns
        for source in self._health.sources.values():
            self._parts.write_health(source.as_message(max(self.now_ns, source.last_ns or 0)), self.now_ns)

    def frames(self, source: Source) -> Iterator[Frame]:
        """A log's frames, as fast as they are taken; at the first it shows whether the log has times."""
        health = self._health.sources[source.name]
        while (block := source.read(0.0)) is not None:
            if block:
                # Times since its beginning bear no stamp, but keep the frames' distances.
                timed = any(member.stamped_ns is not None for member in block) or getattr(source, "timed", False)
                if not health.frames and not timed:
                    self._untimed.append(source.name)
                    self._processing.mute_clocks(source.name)
                for frame in block:
                    health.count_in(1, frame.monotonic_ns)
                    yield frame
        health.state = "ended"
