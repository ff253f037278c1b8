"""``seatrial record``: one recording from start to end, with signals, display and a file name."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

from acquisition.config import TrialConfig
from acquisition.health import Health
from acquisition.live import terminal
from acquisition.pipeline import Recorder
from acquisition.recording.writer import RecordingWriter

_LOOK_S = 0.05
_REDRAW_PER_S = 4.0


def recording_path(folder: Path, name: str, started: datetime) -> Path:
    """Where a recording that starts now goes: the trial's name and the UTC time, never an existing file."""
    stem = "".join(each if each.isalnum() or each in "-_" else "_" for each in name)
    path = folder / f"{stem}_{started:%Y%m%dT%H%M%SZ}.mcap"
    number = 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{started:%Y%m%dT%H%M%SZ}_{number}.mcap"
    return path


def record(
    config: TrialConfig,
    folder: Path,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
) -> tuple[Path, Health]:
    """Record until ``stop`` is set, ``duration_s`` is over, or every source has ended.

    Returns the recording and what was seen. Raises :class:`SourceError` when a source cannot be opened at
    the start (no file is left behind then), :class:`StorageError` when the disk fails.
    """
    stop = stop or threading.Event()
    path = recording_path(folder, config.trial.name, datetime.now(UTC))
    expected = frozenset(name for source in config.sources for name in source.channels)
    with RecordingWriter(path, config.trial, config.text) as writer:
        recorder = Recorder(config, writer)
        try:
            recorder.start()
        except BaseException:
            writer.close()
            path.unlink(missing_ok=True)
            raise
        try:
            if config.missing_channels:
                print(f"no source provides {', '.join(config.missing_channels)}", file=sys.stderr)  # noqa: T201
            with _display(recorder.health, path, expected):
                _wait(recorder, stop, duration_s)
        finally:
            recorder.stop()  # whatever became of the display: the writer is closed by one thread, not under another
    return path, recorder.health


def _wait(recorder: Recorder, stop: threading.Event, duration_s: float | None) -> None:
    until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
    while not recorder.ended and time.monotonic() < until_s:
        if stop.wait(_LOOK_S):
            return


@contextmanager
def _display(health: Health, path: Path, expected: frozenset[str]) -> Iterator[None]:
    """The live table on a terminal; two lines of text anywhere else."""
    if not sys.stderr.isatty():
        print(f"recording to {path}", file=sys.stderr, flush=True)  # noqa: T201
        yield
        return
    from rich.console import Console
    from rich.live import Live

    with Live(
        terminal.Picture(health, path, expected),
        console=Console(stderr=True),
        refresh_per_second=_REDRAW_PER_S,
        screen=True,  # a window that is resized leaves no ruins, and the terminal comes back as it was
    ):
        yield


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that SIGINT, SIGTERM and the loss of the terminal set, so that all end a recording cleanly.

    Under ``nohup``, which ignores the loss of the terminal, the recording goes on.
    """
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    ends = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        ends.append(signal.SIGHUP)
    previous = {number: signal.signal(number, handle) for number in ends}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
