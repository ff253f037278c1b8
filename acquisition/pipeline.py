"""Source -> queue -> decode -> derive -> select -> record: the only place with threads.

One thread a source does nothing but receive and queue, so that a slow disk never delays reception; one thread
does the rest. A queue that is full drops frames by number, never silently. No thread ends without a word: what
a receiver cannot cope with counts as a failed source, what the recorder's thread cannot cope with is raised by
:meth:`Recorder.stop`.
"""

from __future__ import annotations

import queue
import threading
import time

from acquisition.config import TrialConfig
from acquisition.errors import SourceError
from acquisition.frames import Frame, now_ns
from acquisition.health import Health, SourceHealth
from acquisition.processing import Processing
from acquisition.recording.writer import RecordingWriter
from acquisition.sections import RecordingSection
from acquisition.sources import Source, make_source

_POLL_S = 0.1
_LONGEST_BACK_OFF_S = 10.0
_LONGEST_JOIN_S = 5.0  # a driver that hangs must not keep a recording from being closed
_HEALTH_EVERY_S = 1.0
_TICK_S = 0.1  # how late the loop may look at the clock; sync comes so much earlier


class Recorder:
    """A recording in progress. ``start`` opens every source or fails; ``stop`` keeps what was received.

    The writer belongs to the caller and is closed by the caller.
    """

    def __init__(self, config: TrialConfig, writer: RecordingWriter) -> None:
        self._config = config
        self._writer = writer
        self.health = Health({each.name: SourceHealth(each.name) for each in config.sources})
        self._processing = Processing(config, writer, self.health)
        self._queue: queue.Queue[Frame] = queue.Queue(config.recording.queue_frames)
        self._texts: queue.SimpleQueue[tuple[int, str, str]] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._all_received = threading.Event()
        self._failure: Exception | None = None
        self._receivers: list[threading.Thread] = []
        self._worker = threading.Thread(target=self._work, name="recorder", daemon=True)

    def start(self) -> None:
        """Open the sources and begin. Raises :class:`SourceError` if one cannot be opened."""
        sources = [make_source(section) for section in self._config.sources]
        try:
            for source in sources:
                _open(source)
        except BaseException:
            for source in sources:
                self._close(source)
            raise
        self._worker.start()
        for source in sources:
            thread = threading.Thread(target=self._receive, args=(source,), name=source.name, daemon=True)
            self._receivers.append(thread)
            thread.start()

    @property
    def ended(self) -> bool:
        """Whether nothing more can come: every source is at its end, or the recording has failed."""
        return self._failure is not None or not any(thread.is_alive() for thread in self._receivers)

    def stop(self) -> None:
        """Stop receiving, record what was received, and raise what broke the recording, if anything did."""
        self._stopping.set()
        until_s = time.monotonic() + _LONGEST_JOIN_S
        for thread in self._receivers:
            thread.join(max(until_s - time.monotonic(), 0.0))
            if thread.is_alive():
                self.mark(f"{thread.name}: the source does not stop and is left behind", "error")
        self._all_received.set()
        self._worker.join()
        if self._failure is not None:
            raise self._failure

    def mark(self, text: str, level: str = "info") -> None:
        """Put an event into the recording, with the time of this call, from any thread."""
        self._texts.put((now_ns()[0], text, level))

    def _receive(self, source: Source) -> None:
        """One source's thread: receive and queue; on failure say so, back off, open again."""
        health = self.health.sources[source.name]
        back_off_s = _POLL_S
        while not self._stopping.is_set():
            try:
                frames = source.read(_POLL_S)
            except Exception as error:  # drivers raise what they like; the other sources go on
                back_off_s = self._reopen(source, health, _as_source_error(source, error), back_off_s)
                continue
            if frames is None:
                health.state = "ended"
                break
            self._enqueue(source, frames, health)
            back_off_s = _POLL_S
        self._close(source)

    def _enqueue(self, source: Source, frames: list[Frame], health: SourceHealth) -> None:
        if frames:
            health.saw(len(frames), frames[-1].monotonic_ns)
        for frame in frames:
            if not self._put(frame, patiently=source.waits):
                if health.dropped == 0:
                    self.mark(f"{health.name}: the queue is full, frames are being dropped", "error")
                health.dropped += 1

    def _put(self, frame: Frame, *, patiently: bool) -> bool:
        """Queue a frame; where the source can wait, wait for a place as long as the recording runs."""
        while True:
            try:
                self._queue.put(frame, block=patiently, timeout=_POLL_S)
            except queue.Full:
                if not patiently or self._stopping.is_set():
                    return False
            else:
                return True

    def _reopen(self, source: Source, health: SourceHealth, error: SourceError, back_off_s: float) -> float:
        """Wait and try to open a failed source again; the next wait is twice as long."""
        if health.state != "failed":
            self.mark(str(error), "error")
            health.state = "failed"
        self._close(source)
        if self._stopping.wait(back_off_s):
            return back_off_s
        try:
            source.open()
        except Exception:  # as before; the reason was told once
            return min(2 * back_off_s, _LONGEST_BACK_OFF_S)
        health.state = "open"
        self.mark(f"source {source.name!r} is back")
        return _POLL_S

    def _close(self, source: Source) -> None:
        try:
            source.close()
        except Exception as error:  # a cable that was pulled may refuse even this
            self.mark(str(_as_source_error(source, error)), "warning")

    def _work(self) -> None:
        """The recorder's thread: everything behind the queue, until the sources stopped and it is empty."""
        try:
            self._processing.note("recording started", now_ns()[0])
            self._drain()
            self._processing.note("recording stopped", now_ns()[0])
            self._writer.sync()
        except Exception as error:  # raised again by stop(): a recorder that records nothing must not run on
            self._failure = error
            self._stopping.set()

    def _drain(self) -> None:
        housekeeping = _Housekeeping(self._config.recording, self._writer, self.health)
        while True:
            finished = self._all_received.is_set()
            taken = self._process_waiting()
            while not self._texts.empty():
                received_ns, text, level = self._texts.get()
                self._processing.note(text, received_ns, level)
            housekeeping.due(time.monotonic())
            if finished and not taken:
                return

    def _process_waiting(self) -> int:
        """Process what is in the queue for half a tick, waiting as long if there is nothing."""
        taken, until_s = 0, time.monotonic() + _TICK_S / 2
        try:
            frame = self._queue.get(timeout=_TICK_S / 2)
            while True:
                self._processing.process(frame)
                taken += 1
                if time.monotonic() > until_s:
                    return taken
                frame = self._queue.get_nowait()
        except queue.Empty:
            return taken


def _open(source: Source) -> None:
    try:
        source.open()
    except Exception as error:
        raise _as_source_error(source, error) from error


def _as_source_error(source: Source, error: Exception) -> SourceError:
    if isinstance(error, SourceError):
        return error
    return SourceError("failed", where=f"source {source.name!r}", why=f"{type(error).__name__} {error}")


class _Housekeeping:
    """What is done by the clock: flush, sync, and a word on each source's health."""

    def __init__(self, settings: RecordingSection, writer: RecordingWriter, health: Health) -> None:
        self._settings = settings
        self._writer = writer
        self._health = health
        self._flushed_s = self._synced_s = self._reported_s = time.monotonic()

    def due(self, now_s: float) -> None:
        """Do what is due at this time."""
        if now_s - self._reported_s >= _HEALTH_EVERY_S:
            self._report(now_s)
        if now_s - self._synced_s >= self._settings.sync_s - _TICK_S:
            self._writer.sync()
            self._synced_s = self._flushed_s = now_s
        elif now_s - self._flushed_s >= self._settings.flush_s:
            self._writer.flush()
            self._flushed_s = now_s

    def _report(self, now_s: float) -> None:
        received_ns = now_ns()[0]
        for source in self._health.sources.values():
            self._writer.write_health(source.as_message(int(now_s * 1e9)), received_ns)
        self._reported_s = now_s
