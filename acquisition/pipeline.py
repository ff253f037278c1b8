"""Source -> queue -> decode -> derive -> select -> record: the only place with threads.

One thread a source does nothing but receive and queue, so that a slow disk never delays reception; one thread
does the rest. A queue that is full drops frames by number, never silently.
"""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace

from acquisition.config import TrialConfig
from acquisition.decoders import Decoder, make_decoders
from acquisition.derive import Derivation
from acquisition.errors import SourceError, StorageError
from acquisition.frames import Frame, Sample, now_ns
from acquisition.health import Health, SourceHealth
from acquisition.recording.writer import RecordingWriter
from acquisition.select import Selector
from acquisition.sources import Source, make_source

_POLL_S = 0.1
_LONGEST_BACK_OFF_S = 10.0
_HEALTH_EVERY_S = 1.0
_BATCH_FRAMES = 500
_TICK_S = 0.1  # how late the loop may look at the clock; sync comes so much earlier


class Processing:
    """What happens to a frame between its reception and the recording; one thread only."""

    def __init__(self, config: TrialConfig, writer: RecordingWriter, health: Health) -> None:
        self._trial = config.trial
        self._writer = writer
        self._health = health
        self._decoders: dict[str, list[Decoder]] = {each.name: make_decoders(each) for each in config.sources}
        self._derivation = Derivation(config.trial)
        self._selector = Selector(config.sources)

    def process(self, frame: Frame) -> None:
        """Record the frame raw and every channel sample that is in it."""
        self._writer.write_raw(frame)
        decoders = self._decoders[frame.origin]
        for decoder in decoders:
            for group in decoder.decode(frame):
                self._record(self._derivation.channels(group))
        self._health.sources[frame.origin].refused = sum(each.refused.total() for each in decoders)

    def _record(self, samples: list[Sample]) -> None:
        for sample in samples:
            accepted, change = self._selector.admit(sample)
            if change:
                self.note(change, "warning")
            if accepted:
                self._writer.write_sample(sample)
                self._health.saw(sample)
        self._record_position(samples)
        if self._derivation.origin != self._trial.origin:
            self._keep_origin()

    def _record_position(self, samples: list[Sample]) -> None:
        fix = {each.quantity: each for each in samples if each.quantity in ("latitude_deg", "longitude_deg")}
        if len(fix) == 2:
            latitude, longitude = fix["latitude_deg"], fix["longitude_deg"]
            self._writer.write_position(latitude.value, longitude.value, latitude.received_ns, latitude.measured_ns)

    def _keep_origin(self) -> None:
        """The first fix became the origin: the recording must say so."""
        if self._derivation.origin is None:
            return
        latitude_deg, longitude_deg = self._derivation.origin
        self._trial = replace(self._trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
        self._writer.write_trial(self._trial)
        self.note(f"the first fix is the origin: {latitude_deg:.7f}, {longitude_deg:.7f}")

    def note(self, text: str, level: str = "info") -> None:
        """Put a line into the recording's event log and the display."""
        self._writer.write_event(text, now_ns()[0], level)
        self._health.events.append(text)


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
        self._texts: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._failure: StorageError | None = None
        self._receivers: list[threading.Thread] = []
        self._worker = threading.Thread(target=self._work, name="recorder", daemon=True)

    def start(self) -> None:
        """Open the sources and begin. Raises :class:`SourceError` if one cannot be opened."""
        opened: list[Source] = []
        try:
            for section in self._config.sources:
                source = make_source(section)
                source.open()
                opened.append(source)
        except SourceError:
            for source in opened:
                source.close()
            raise
        self._worker.start()
        for source in opened:
            thread = threading.Thread(target=self._receive, args=(source,), name=source.name, daemon=True)
            self._receivers.append(thread)
            thread.start()

    @property
    def ended(self) -> bool:
        """Whether nothing more can come: every source is at its end, or the disk has failed."""
        return self._failure is not None or not any(thread.is_alive() for thread in self._receivers)

    def stop(self) -> None:
        """Stop receiving, record what was received, and raise the disk's error if there was one."""
        self._stopping.set()
        for thread in self._receivers:
            thread.join()
        self._worker.join()
        if self._failure is not None:
            raise self._failure

    def mark(self, text: str, level: str = "info") -> None:
        """Put an event into the recording, from any thread."""
        self._texts.put((text, level))

    def _receive(self, source: Source) -> None:
        """One source's thread: receive and queue; on failure say so, back off, open again."""
        health = self.health.sources[source.name]
        back_off_s = _POLL_S
        try:
            while not self._stopping.is_set():
                try:
                    frames = source.read(_POLL_S)
                    if frames is None:
                        health.state = "ended"
                        return
                    self._enqueue(frames, health)
                    back_off_s = _POLL_S
                except SourceError as error:
                    back_off_s = self._reopen(source, health, error, back_off_s)
        finally:
            source.close()

    def _enqueue(self, frames: list[Frame], health: SourceHealth) -> None:
        if frames:
            health.saw(len(frames), frames[-1].monotonic_ns)
        for frame in frames:
            try:
                self._queue.put_nowait(frame)
            except queue.Full:
                if health.dropped == 0:
                    self.mark(f"{health.name}: the queue is full, frames are being dropped", "error")
                health.dropped += 1

    def _reopen(self, source: Source, health: SourceHealth, error: SourceError, back_off_s: float) -> float:
        """Wait and try to open a failed source again; the next wait is twice as long."""
        if health.state != "failed":
            self.mark(str(error), "error")
            health.state = "failed"
        source.close()
        self._stopping.wait(back_off_s)
        try:
            source.open()
        except SourceError:
            return min(2 * back_off_s, _LONGEST_BACK_OFF_S)
        health.state = "open"
        self.mark(f"source {source.name!r} is back")
        return _POLL_S

    def _work(self) -> None:
        """The recorder's thread: everything behind the queue, until the sources stopped and it is empty."""
        try:
            self._processing.note("recording started")
            self._drain()
            self._processing.note("recording stopped")
            self._writer.sync()
        except StorageError as error:
            self._failure = error
            self._stopping.set()

    def _drain(self) -> None:
        housekeeping = _Housekeeping(self._config, self._writer, self.health)
        while True:
            finished = self._stopping.is_set() and not any(thread.is_alive() for thread in self._receivers)
            taken = self._process_waiting()
            while not self._texts.empty():
                self._processing.note(*self._texts.get())
            housekeeping.due(time.monotonic())
            if finished and not taken:
                return

    def _process_waiting(self) -> int:
        """Process what is in the queue, at most a batch; wait a little if it is empty."""
        taken = 0
        try:
            frame = self._queue.get(timeout=self._config.recording.flush_s / 2)
            while True:
                self._processing.process(frame)
                taken += 1
                if taken >= _BATCH_FRAMES:
                    return taken
                frame = self._queue.get_nowait()
        except queue.Empty:
            return taken


class _Housekeeping:
    """What is done by the clock: flush, sync, and a word on each source's health."""

    def __init__(self, config: TrialConfig, writer: RecordingWriter, health: Health) -> None:
        self._settings = config.recording
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
