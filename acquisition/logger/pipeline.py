"""Source -> inbox -> decode -> derive -> select -> record: the only place with threads.

One thread a source does nothing but receive (``receiver.py``), so that a slow disk never delays reception; one
thread does the rest. An inbox that is full drops frames by number, never silently. What a receiver cannot cope
with counts as a failed source; what the recorder's thread cannot cope with is reported, and it goes on.
"""

from __future__ import annotations

import queue
import threading
import time

from seatrial.acquisition.config.configuration import TrialConfig
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.frames import now_ns
from seatrial.acquisition.core.process import started
from seatrial.acquisition.logger.health import ChannelHealth, Health, SourceHealth
from seatrial.acquisition.logger.maintenance import Maintenance, Timescale
from seatrial.acquisition.logger.predictions import Predictions
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.logger.receiver import Inbox, Receiver
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.sources import make_source

_LOOK_S = 0.01
_POLL_S = 0.02  # how long a frame may wait for the recorder: little beside the time to the next flush
_LONGEST_TICK_S = 20.0  # a memory card may take its time
_LONGEST_JOIN_S = 5.0  # a driver that hangs must not keep a recording from being closed
_START_AGAIN_S = 1.0
_REPORT_EVERY_S = 60.0  # of failures that repeat themselves
_MOST_FAILURES_AT_END = 50  # in a row: about a second


NO_THREAD = "the system gives no thread"
_MORE_THREADS = "end other programs, or raise the limit (systemd: TasksMax=)"


def health_of(config: TrialConfig) -> Health:
    """Nothing seen yet, of the sources and channels of a configuration."""
    sources = {section.name: SourceHealth(section.name) for section in config.sources}
    health = Health(sources, config.watched_channels, config.known_channels)
    for name in config.expected_channels:
        health.channels.setdefault(name, ChannelHealth())
    for source in reversed(config.sources):
        for name, rate_hz in source.rates_hz.items():
            health.channels.setdefault(name, ChannelHealth()).expected_hz = rate_hz
    return health


def _none_opened(receivers: list[Receiver]) -> SourceError | None:
    """Wait until one source is open, or all have tried: the first one's error then."""
    while not all(receiver.tried.is_set() for receiver in receivers):
        if any(receiver.opened for receiver in receivers):
            return None
        time.sleep(_LOOK_S)
    return None if any(receiver.opened for receiver in receivers) else receivers[0].open_error


class Recorder:
    """A recording in progress. ``start`` opens the sources; ``stop`` keeps what was received.

    The recording belongs to the caller and is closed by the caller.
    """

    def __init__(self, config: TrialConfig, parts: RecordingParts, scale: Timescale | None = None) -> None:
        self._config = config
        self._parts = parts
        self.health = health_of(config)
        self._scale = scale or Timescale(*now_ns())
        self._processing = FrameProcessor(config, parts, self.health)
        self._inbox = Inbox(self.health.sources, config.recording.queue_frames)
        self._texts: queue.SimpleQueue[tuple[int, str, str, str]] = queue.SimpleQueue()
        self.predictions = Predictions(self.health)
        self._stopping = threading.Event()
        self._all_received = threading.Event()
        self._failure: Exception | None = None
        self._threads: list[threading.Thread] = []
        self._unstarted: list[threading.Thread] = []
        self._tried_s = time.monotonic()
        self._reported_s: dict[str, float] = {}
        self._worker = threading.Thread(target=self._work, name="recorder", daemon=True)
        parts.tell = self.tell

    def start(self) -> None:
        """Open the sources and begin; those that cannot be opened yet are tried again and again.

        Raises :class:`SourceError` if not a single one can be opened.
        """
        shared = self._inbox, self._stopping, self.tell
        receivers = [
            Receiver(make_source(section), self.health.sources[section.name], *shared, section.budget_kb_s * 1e3)
            for section in self._config.sources
        ]
        self._threads = [
            threading.Thread(target=receiver.run, name=receiver.source.name, daemon=True) for receiver in receivers
        ]
        self._unstarted = [thread for thread in self._threads if not started(thread)]
        for thread in self._unstarted:
            self.tell("error", f"{thread.name}: {NO_THREAD}; it is tried again every second")
        running = [
            receiver
            for receiver, thread in zip(receivers, self._threads, strict=True)
            if thread not in self._unstarted
        ]
        error = _none_opened(running) if running else SourceError(NO_THREAD, where="the sources", fix=_MORE_THREADS)
        if error is None and not started(self._worker):
            error = SourceError(NO_THREAD, where="the recorder", fix=_MORE_THREADS)
        if error is not None:
            self._stopping.set()
            raise error

    @property
    def ended(self) -> bool:
        """Whether nothing more can come: every source is at its end, or the recording has failed."""
        running = self._unstarted or any(thread.is_alive() for thread in self._threads)
        return self._failure is not None or not running

    @property
    def alive(self) -> bool:
        """Whether the recorder's thread has come round of late: what a watchdog wants to know."""
        return time.monotonic_ns() - self.health.worked_ns < _LONGEST_TICK_S * 1e9

    def stop(self) -> None:
        """Stop receiving, record what was received, and raise what broke the recording, if anything did."""
        self._stopping.set()
        until_s = time.monotonic() + _LONGEST_JOIN_S
        for thread in self._threads:
            if thread in self._unstarted:
                continue
            thread.join(max(until_s - time.monotonic(), 0.0))
            if thread.is_alive():
                self.tell("error", f"{thread.name}: the source does not stop and is left behind")
        self._all_received.set()
        self._worker.join()
        if self._failure is not None:
            raise self._failure

    def tell(self, level: str, text: str, name: str = "seatrial") -> None:
        """Put an event into the recording, with the time of this call, from any thread."""
        self._texts.put((time.monotonic_ns(), level, text, name))

    def mark(self, text: str, monotonic_ns: int | None = None) -> None:
        """Put a person's mark into the recording, from any thread."""
        self._texts.put((monotonic_ns or time.monotonic_ns(), "info", text, "mark"))
        self.health.marks += 1

    def _work(self) -> None:
        """The recorder's thread: everything behind the inbox, until the sources stopped and it is empty."""
        try:
            self.tell("info", "recording started")
            self._drain()
            self.tell("info", "recording stopped")
            self._note_texts()
            self._parts.sync()
        except Exception as error:  # raised again by stop()
            self._failure = error
            self._stopping.set()

    def _drain(self) -> None:
        maintenance = Maintenance(self._config.recording, self._parts, self.health, self._scale, self._note)
        failures = 0
        while True:
            finished = self._all_received.is_set()
            try:
                if self._turn(maintenance, finished):
                    return
                failures = 0
            except Exception as error:  # nothing but the user ends a recording
                failures += 1
                if finished and failures > _MOST_FAILURES_AT_END:
                    raise
                self._report("the recorder", error)
                time.sleep(_POLL_S)

    def _turn(self, maintenance: Maintenance, finished: bool) -> bool:
        """Record what waits, and do what is due by the clock; whether that was the last."""
        if finished and self._parts.paused:
            self._parts.resume()  # the last chance to keep what waits
        # In a pause frames wait in the inbox, as long as there is room.
        frames = [] if self._parts.paused else self._inbox.take()
        for frame in frames:
            try:
                self._processing.process(self._scale.stamp(frame))
            except Exception as error:  # the others go on; how many are lost is said at the end
                self._parts.lost += 1
                self._report(f"a frame of {frame.origin}", error)
        if not len(self._inbox):  # then all that came before now has been processed
            self._processing.report_handovers(time.monotonic_ns())
        self._note_texts()
        self._note_predictions()
        maintenance.tick()
        self._start_missing()
        self.health.worked_ns = time.monotonic_ns()
        if finished and not frames:
            self._parts.lost += len(self._inbox)
            self._processing.report_handovers()
            maintenance.report_sources()
            return True
        if self._parts.paused or not len(self._inbox):
            time.sleep(_POLL_S)
        return False

    def _start_missing(self) -> None:
        """Try again to start the threads of sources for which the system had none."""
        if not self._unstarted or time.monotonic() - self._tried_s < _START_AGAIN_S:
            return
        self._tried_s = time.monotonic()
        for thread in tuple(self._unstarted):
            if not self._stopping.is_set() and started(thread):
                self._unstarted.remove(thread)
                self.tell("warning", f"{thread.name}: the system has a thread for this source again")

    def _report(self, where: str, error: Exception) -> None:
        """Report what nobody foresaw, each kind once a minute."""
        text = f"{where} met an unexpected error: {type(error).__name__} {error}"
        if time.monotonic() - self._reported_s.get(where, float("-inf")) >= _REPORT_EVERY_S:
            self._reported_s[where] = time.monotonic()
            self.tell("error", text)

    def _note(self, level: str, text: str) -> None:
        """Put an event into the part that is being written, at once; for the recorder's thread only."""
        self._processing.note(text, self._scale.utc_ns(time.monotonic_ns()), level)

    def _note_texts(self) -> None:
        while not self._texts.empty():
            monotonic_ns, level, text, name = self._texts.get()
            self._processing.note(text, self._scale.utc_ns(monotonic_ns), level, name)

    def _note_predictions(self) -> None:
        """What others foretell, unless nothing is written at the moment: memory is for what was measured."""
        for monotonic_ns, start_ns, data, geojson in self.predictions.take():
            if self._parts.paused:
                self.health.predictions_dropped += 1
            else:
                self._parts.write_prediction(data, geojson, self._scale.utc_ns(monotonic_ns), start_ns)
                self.health.predictions += 1
