"""``seatrial record``: one recording from start to end, with signals, display, marks and a supervisor."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path

from acquisition.config.configuration import TrialConfig
from acquisition.config.sections import FILE_SOURCES, LiveSection
from acquisition.core.errors import ConfigurationError, SeatrialError, SourceError
from acquisition.logger.display import Picture, mark_on_keys, status
from acquisition.logger.health import Health
from acquisition.logger.live_view import LiveView
from acquisition.logger.log_files import record_log_files
from acquisition.logger.maintenance import Timescale, clock_metadata
from acquisition.logger.pipeline import Recorder, health_of
from acquisition.logger.requests import RecorderState, RequestServer
from acquisition.logger.supervision import LOG, LogFormat, log_to, notify
from acquisition.recording.parts import RecordingParts

_LOOK_S = 0.05
_REDRAW_PER_S = 4.0
_WATCHDOG_EVERY_S = 1.0


def record(
    config: TrialConfig,
    folder: Path,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
    log_format: LogFormat = "text",
    live: bool = False,
) -> tuple[list[Path], Health]:
    """Record until ``stop`` is set, ``duration_s`` is over, or every source has ended.

    Returns the recording's parts and what was seen. Raises :class:`SourceError` when no source at all can be
    opened, :class:`ConfigurationError` for what only a decoder can find wrong (no file is left behind then),
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
    scale = Timescale.of_now()
    clock = clock_metadata(scale)
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    with ExitStack() as stack:
        stack.callback(parts.close)
        try:
            recorder = Recorder(config, parts, scale)
            recorder.start()
        except (ConfigurationError, SourceError):
            stack.pop_all()
            parts.discard()
            raise
        stack.callback(recorder.stop)  # whatever becomes of the display, the recorder ends before its files
        if config.missing_channels:
            LOG.warning("no source provides %s", ", ".join(config.missing_channels))
        server = RequestServer(
            recorder.mark, lambda: _running(config, recorder.health, parts), recorder.predictions
        )
        _with(stack, server, recorder)
        if live or config.live is not None:
            view = LiveView(config.live or LiveSection(), config.trial.name)
            if _with(stack, view, recorder):
                parts.listeners.append(view.hear)
                LOG.info("live view at %s", view.address)
        stack.enter_context(_display(config, recorder))
        LOG.info("recording to %s", parts.path)
        notify("READY=1")
        _wait(recorder, stop, duration_s)
        notify("STOPPING=1")
    return parts.paths, recorder.health


def _running(config: TrialConfig, health: Health, parts: RecordingParts) -> RecorderState:
    """What other programs may know of this recording."""
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
    health = health_of(config)
    clock = {"times": "of the log files"}
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    with ExitStack() as stack:
        stack.callback(parts.close)
        try:
            LOG.info("recording to %s", parts.path)
            record_log_files(config, parts, health, duration_s, stop)
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
        if time.monotonic() - notified_s > _WATCHDOG_EVERY_S and recorder.alive:
            notify(f"WATCHDOG=1\nSTATUS={status(recorder.health)}")
            notified_s = time.monotonic()
        if stop.wait(_LOOK_S):
            return


def _with(stack: ExitStack, extra: AbstractContextManager[object], recorder: Recorder) -> bool:
    """Enter what a recording can do without; where it cannot be had, say so and record all the same."""
    try:
        stack.enter_context(extra)
    except SeatrialError as error:
        recorder.tell("warning", str(error))
        return False
    return True


@contextmanager
def _display(config: TrialConfig, recorder: Recorder) -> Iterator[None]:
    """The live table, on a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.live import Live

    picture = Picture(recorder.health, config.expected_channels, config.marks)
    with (
        mark_on_keys(recorder.mark, config.marks),
        Live(
            picture,
            console=Console(stderr=True),
            refresh_per_second=_REDRAW_PER_S,
            screen=True,  # a window that is resized leaves no ruins, and the terminal comes back as it was
        ),
    ):
        yield
