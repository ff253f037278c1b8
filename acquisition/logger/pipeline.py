"""Runs a recording: source -> inbox -> decode -> derive -> select -> record; the only place with threads.

One thread a source (:class:`Receiver`) only receives, so that a slow disk never delays reception; when its source
fails it reports it, backs off and opens it again. One thread does the remaining work. An inbox that is full drops
frames by number, never silently. What a receiver cannot cope with counts as a failed source; what the recorder's
thread cannot cope with is reported, and it goes on.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from operator import attrgetter

from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core import errors, process, trial
from seatrial.acquisition.logger import health as monitoring
from seatrial.acquisition.logger.maintenance import Maintenance, Timescale
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.recording.parts import RecordingParts, Tell
from seatrial.acquisition.sources import Senders, Source, make_source

_LOOK_S = 0.01
_POLL_S = 0.02  # how long a frame may wait for the recorder: little beside the time to the next flush
_LONGEST_TICK_S = 20.0  # a memory card may take its time
_LONGEST_JOIN_S = 5.0  # a driver that hangs must not keep a recording from being closed
_START_AGAIN_S = 1.0
_REPORT_PERIOD_S = 60.0  # of failures that repeat themselves
_MOST_FAILURES_AT_END = 50  # in a row: about a second


NO_THREAD = "the system gives no thread"
_MORE_THREADS = "end other programs, or raise the limit (systemd: TasksMax=)"

_MOST_AT_ONCE = 100  # of one source, so that the recorder's clock work is never kept waiting for long
_MOST_BYTES_AT_ONCE = 200_000  # the same: to search a megabyte of junk for packets of MAVLink takes seconds
_WAITING_BYTES, _LEAST_WAITING_BYTES = 256_000_000, 8_000_000  # of all sources together, of one at least
POLL_S = 0.1
_LONGEST_BACK_OFF_S = 10.0
_LOSS_PERIOD_S = 10.0
_LONGEST_DELAY_S = 0.02  # what is stamped with a longer delay is marked
_CATCHING_UP_S, _CATCHING_UP_FRACTION = 0.1, 0.1  # of the time it stood still, for what waited on all sources
_SHORTEST_STILL_S = 0.2
_SAVED_S = 10.0
_RECORD_BYTES = 60  # what a frame's record takes beside its bytes, about
_FLOOD_PAUSE_S = 0.01
_OVER_BUDGET = "over its budget of {:,.0f} kB/s by {{:,}} frames"
_SETTLED_S = 5.0  # a source that stays open so long is well, even if it sends nothing


def initial_health(config: TrialConfig) -> monitoring.Health:
    """The state of a recording that has not begun, with the sources, sinks and channels of a configuration."""
    sources = {section.name: monitoring.SourceHealth(section.name) for section in config.sources}
    health = monitoring.Health(sources, config.watched_channels, config.known_channels)
    health.sinks = {
        sink.name: monitoring.SinkHealth(sink.name, deque(maxlen=sink.queue_values)) for sink in config.sinks
    }
    if config.live is not None:
        health.sinks[monitoring.LIVE_VIEW] = monitoring.SinkHealth(monitoring.LIVE_VIEW)
    for name in config.expected_channels:
        health.channels.setdefault(name, monitoring.ChannelHealth())
    for source in reversed(config.sources):
        for name, rate_hz in source.rates_hz.items():
            health.channels.setdefault(name, monitoring.ChannelHealth()).expected_hz = rate_hz
    return health


class Recorder:
    """A recording in progress. ``start`` opens the sources; ``stop`` keeps what was received.

    The recording belongs to the caller and is closed by the caller.
    """

    def __init__(self, config: TrialConfig, parts: RecordingParts, scale: Timescale | None = None) -> None:
        self._config = config
        self._parts = parts
        self.health = initial_health(config)
        self._scale = scale or Timescale(*trial.wall_and_monotonic_ns())
        self._processing = FrameProcessor(config, parts, self.health)
        self._inbox = Inbox(self.health.sources, config.recording.queue_frames)
        self._texts: queue.SimpleQueue[tuple[int, str, str, str]] = queue.SimpleQueue()
        self.predictions = monitoring.Predictions(self.health)
        self._stopping = threading.Event()
        self._all_received = threading.Event()
        self._failure: Exception | None = None
        self._threads: list[threading.Thread] = []
        self._unstarted: list[threading.Thread] = []
        self._tried_s = time.monotonic()
        self._reported_s: dict[str, float] = {}
        self._worker = threading.Thread(target=self._run_thread, name="recorder", daemon=True)
        parts.tell = self.submit_event

    def start(self) -> None:
        """Open the sources and begin; those that cannot be opened yet are tried again and again.

        Raises :class:`SourceError` if not a single one can be opened.
        """
        shared = self._inbox, self._stopping, self.submit_event
        receivers = [
            Receiver(make_source(section), self.health.sources[section.name], *shared, section.budget_kb_s * 1e3)
            for section in self._config.sources
        ]
        running = []
        for receiver in receivers:
            thread = threading.Thread(target=receiver.run, name=receiver.source.name, daemon=True)
            self._threads.append(thread)
            if process.start_thread_if_possible(thread):
                running.append(receiver)
            else:
                self._unstarted.append(thread)
                self.submit_event("error", f"{thread.name}: {NO_THREAD}; it is tried again every second")
        error: errors.SourceError | None = errors.SourceError(NO_THREAD, where="the sources", fix=_MORE_THREADS)
        if running:
            while not any(receiver.opened for receiver in running):
                if all(receiver.tried.is_set() for receiver in running):
                    break
                time.sleep(_LOOK_S)
            error = None if any(receiver.opened for receiver in running) else running[0].open_error
        if error is None and not process.start_thread_if_possible(self._worker):
            error = errors.SourceError(NO_THREAD, where="the recorder", fix=_MORE_THREADS)
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
        """Whether the recorder's thread has come round recently: what a watchdog asks."""
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
                self.submit_event("error", f"{thread.name}: the source does not stop and is left behind")
        self._all_received.set()
        self._worker.join()
        if self._failure is not None:
            raise self._failure

    def submit_event(self, level: str, text: str, name: str = "seatrial") -> None:
        """Put an event into the recording, with the time of this call, from any thread."""
        self._texts.put((time.monotonic_ns(), level, text, name))

    def mark(self, text: str, monotonic_ns: int | None = None) -> None:
        """Put a person's mark into the recording, from any thread."""
        self._texts.put((monotonic_ns or time.monotonic_ns(), "info", text, "mark"))
        self.health.marks += 1

    def _run_thread(self) -> None:
        """The recorder's thread: everything behind the inbox, until the sources stopped and it is empty."""
        try:
            self.submit_event("info", "recording started")
            self._record_until_end()
            self.submit_event("info", "recording stopped")
            self._write_submitted_events()
            self._parts.sync()
        except Exception as error:  # raised again by stop()
            self._failure = error
            self._stopping.set()

    def _record_until_end(self) -> None:
        maintenance = Maintenance(self._config.recording, self._parts, self.health, self._scale, self._write_event)
        failures = 0
        while True:
            finished = self._all_received.is_set()
            try:
                if self._record_waiting_frames(maintenance, finished):
                    return
                failures = 0
            except Exception as error:  # nothing but the user ends a recording
                failures += 1
                if finished and failures > _MOST_FAILURES_AT_END:
                    raise
                self._log_failure("the recorder", error)
                time.sleep(_POLL_S)

    def _record_waiting_frames(self, maintenance: Maintenance, finished: bool) -> bool:
        """Record what waits, and do what is due by the clock; whether that was the last."""
        if finished and self._parts.paused:
            self._parts.resume_if_possible()  # the last chance to keep what waits
        # In a pause frames wait in the inbox, as long as there is room.
        frames = [] if self._parts.paused else self._inbox.take()
        for frame in frames:
            try:
                self._processing.process(self._scale.restamp_frame(frame))
            except Exception as error:  # the next frames go on; how many are lost is reported at the end
                self._parts.lost += 1
                self._log_failure(f"a frame of {frame.origin}", error)
        if not len(self._inbox):  # then all that came before now has been processed
            self._processing.report_handovers(time.monotonic_ns())
        self._write_submitted_events()
        self._write_submitted_predictions()
        maintenance.run_periodic_tasks()
        self._start_stopped_receivers()
        self.health.worked_ns = time.monotonic_ns()
        if finished and not frames:
            self._parts.lost += len(self._inbox)
            self._processing.report_handovers()
            maintenance.report_sources()
            return True
        if self._parts.paused or not len(self._inbox):
            time.sleep(_POLL_S)
        return False

    def _start_stopped_receivers(self) -> None:
        """Try again to start the threads of sources for which the system had none."""
        if not self._unstarted or time.monotonic() - self._tried_s < _START_AGAIN_S:
            return
        self._tried_s = time.monotonic()
        for thread in tuple(self._unstarted):
            if not self._stopping.is_set() and process.start_thread_if_possible(thread):
                self._unstarted.remove(thread)
                self.submit_event("warning", f"{thread.name}: the system has a thread for this source again")

    def _log_failure(self, subject: str, error: Exception) -> None:
        """Report an unexpected error, each kind once a minute."""
        text = f"{subject} met an unexpected error: {type(error).__name__} {error}"
        if time.monotonic() - self._reported_s.get(subject, float("-inf")) >= _REPORT_PERIOD_S:
            self._reported_s[subject] = time.monotonic()
            self.submit_event("error", text)

    def _write_event(self, level: str, text: str) -> None:
        """Put an event into the part that is being written, at once; for the recorder's thread only."""
        self._processing.note(text, self._scale.utc_ns(time.monotonic_ns()), level)

    def _write_submitted_events(self) -> None:
        while not self._texts.empty():
            monotonic_ns, level, text, name = self._texts.get()
            self._processing.note(text, self._scale.utc_ns(monotonic_ns), level, name)

    def _write_submitted_predictions(self) -> None:
        """Record other programs' predictions, unless nothing is written: memory is for what was measured."""
        for monotonic_ns, start_ns, data, geojson in self.predictions.take():
            if self._parts.paused:
                self.health.predictions_dropped += 1
            else:
                self._parts.write_prediction(data, geojson, self._scale.utc_ns(monotonic_ns), start_ns)
                self.health.predictions += 1


class Inbox:
    """Frames that wait to be recorded: one writer thread a source, one reader thread for all.

    A source's quota is a number of frames, and of bytes in them. No thread is woken: the reader comes by often
    enough, and to wake a thread would cost more than the frame.
    """

    def __init__(self, sources: Iterable[str], quota: int) -> None:
        self._waiting = {name: _Waiting() for name in sources}
        self._quota = quota
        self._quota_bytes = max(_WAITING_BYTES // max(len(self._waiting), 1), _LEAST_WAITING_BYTES)

    def put(self, source: str, frames: list[trial.Frame]) -> int:
        """Take in what the source's quota has room for, and return how many frames that is."""
        waiting = self._waiting[source]
        room = max(self._quota - len(waiting.frames), 0)
        admitted = frames if len(frames) <= room else frames[:room]
        size = sum([len(frame.payload) for frame in admitted])
        while waiting.bytes_in + size - waiting.bytes_out > self._quota_bytes and admitted:
            admitted = admitted[: len(admitted) // 2]
            size = sum([len(frame.payload) for frame in admitted])
        waiting.bytes_in += size
        waiting.frames.extend(admitted)
        return len(admitted)

    def take(self) -> list[trial.Frame]:
        """What waits, in the order of reception; of each source a limited number."""
        frames: list[trial.Frame] = []
        for waiting in self._waiting.values():
            size = 0
            for _ in range(min(len(waiting.frames), _MOST_AT_ONCE)):
                frame = waiting.frames.popleft()
                frames.append(frame)
                size += len(frame.payload)
                if size >= _MOST_BYTES_AT_ONCE:
                    break
            waiting.bytes_out += size
        frames.sort(key=attrgetter("monotonic_ns"))
        return frames

    def __len__(self) -> int:
        """How many frames wait."""
        return sum(len(waiting.frames) for waiting in self._waiting.values())


@dataclass(slots=True)
class _Waiting:
    """What waits of one source. Each of the two counts is written by one thread only."""

    frames: deque[trial.Frame] = field(default_factory=deque)
    bytes_in: int = 0
    bytes_out: int = 0


class RateBudget:
    """How much of a source is kept: ``bytes_per_s``, and what it has saved of these in up to ten seconds."""

    def __init__(self, bytes_per_s: float, now_s: float) -> None:
        self.bytes_per_s = bytes_per_s
        self._budget_bytes, self._looked_s = bytes_per_s * _SAVED_S, now_s

    def count_admitted_frames(self, frames: list[trial.Frame], now_s: float) -> int:
        """How many of the frames, from the first on, it has room for."""
        earned = self.bytes_per_s * (now_s - self._looked_s)
        self._budget_bytes = min(self._budget_bytes + earned, self.bytes_per_s * _SAVED_S)
        self._looked_s = now_s
        for count, frame in enumerate(frames):
            size = len(frame.payload) + _RECORD_BYTES
            if size > self._budget_bytes:
                return count
            self._budget_bytes -= size
        return len(frames)


class Receiver:
    """What one thread does for one source until ``stopping`` is set; ``tell`` takes events. It raises nothing."""

    def __init__(
        self,
        source: Source,
        health: monitoring.SourceHealth,
        inbox: Inbox,
        stopping: threading.Event,
        tell: Tell,
        bytes_per_s: float = float("inf"),
    ) -> None:
        self._budget = RateBudget(bytes_per_s, time.monotonic())
        self.source, self._health, self._inbox, self._stopping, self._tell = source, health, inbox, stopping, tell
        health.state = "opening"
        self._senders: Senders | None = getattr(source, "senders", None)
        if self._senders is not None:
            health.refusals.append(self._senders.refused)
        if (refused := getattr(source, "refused", None)) is not None:
            health.refusals.append(refused)
        self._back_off_s = POLL_S
        self._dropped_before = self._lost_before = 0
        self._unreported: Counter[str] = Counter()
        self._warned_s: dict[str, float] = {}
        self._opened_s = 0.0
        self._ended_s = float("inf")  # of the last read
        self._still_s, self._late, self._catches_up_s = 0.0, 0, 0.0
        self.tried = threading.Event()
        self.opened = False
        self.open_error: errors.SourceError | None = None

    def run(self) -> None:
        """Receive until ``stopping`` is set, or until the source says that nothing more will come."""
        self._open()
        self.tried.set()
        while not self._stopping.is_set():
            if self._health.state == "failed":
                if not self._stopping.wait(self._back_off_s):
                    self._back_off_s = min(2 * self._back_off_s, _LONGEST_BACK_OFF_S)
                    self._open()
                continue
            began_s = time.monotonic()
            try:
                frames = self.source.read(POLL_S)
            except Exception as error:  # the other sources go on
                self._note_failure(as_source_error(self.source, error))
                self.close()
                continue
            if frames is None:
                self._health.state = "ended"
                break
            while self._senders is not None and self._senders.news:
                level, text = self._senders.news.popleft()
                self._tell(level, f"{self._health.name}: {text}")
            frames = self._mark_delayed_frames(frames, began_s, time.monotonic())
            if frames:
                self._pass_to_inbox(frames)
            # it works again once it sends or stays open: some can be opened and fail at once
            if self._health.failed_ns is not None and (frames or time.monotonic() - self._opened_s > _SETTLED_S):
                gap_s = (time.monotonic_ns() - self._health.failed_ns) / 1e9
                self._tell("warning", f"source {self.source.name!r} is back after {gap_s:.1f} s")
                self._health.failed_ns = None
                self._back_off_s = POLL_S
            if self.source.lost > self._lost_before:
                self._count_lost_frames(self.source.loss, self.source.lost - self._lost_before)
                self._lost_before = self.source.lost
        for template in tuple(self._unreported):
            self._report_losses(template)
        self.close()

    def _mark_delayed_frames(self, frames: list[trial.Frame], began_s: float, ended_s: float) -> list[trial.Frame]:
        """The frames, marked if they waited while the recorder stood still, or while it catches up after that.

        A read that took longer than it may, or began long after the one before, shows that it stood still.
        """
        still_s = max(began_s - self._ended_s, ended_s - began_s - POLL_S)
        self._ended_s = ended_s
        if still_s > _LONGEST_DELAY_S:
            self._still_s = max(still_s, self._still_s)
            self._catches_up_s = ended_s + _CATCHING_UP_S + _CATCHING_UP_FRACTION * still_s
        if not self._still_s:
            return frames
        if not getattr(self.source, "exact", False):
            self._late += len(frames)
            frames = [frame._replace(flags=frame.flags | trial.FrameFlag.LATE) for frame in frames]
        if getattr(self.source, "behind", False) or ended_s < self._catches_up_s:
            return frames
        if self._still_s > _SHORTEST_STILL_S:
            text = f"{self._health.name}: the recorder stood still for {self._still_s:.2f} s"
            consequence = "frames are stamped up to so much late, and their values marked as suspect"
            self._tell("warning", f"{text}; {self._late:,} {consequence}" if self._late else text)
        self._still_s, self._late = 0.0, 0
        return frames

    def _open(self) -> None:
        try:
            self.source.open()
        except Exception as error:  # drivers raise what they like
            self.open_error = as_source_error(self.source, error)
            self._note_failure(self.open_error)
            return
        self._health.state, self._opened_s = "open", time.monotonic()
        self._ended_s = self._opened_s
        self.opened = True
        if remark := getattr(self.source, "remark", ""):
            self._tell("warning", f"{self._health.name}: {remark}")

    def close(self) -> None:
        try:
            self.source.close()
        except Exception as error:  # a cable that was pulled may refuse even this
            self._tell("warning", str(as_source_error(self.source, error)))

    def _pass_to_inbox(self, frames: list[trial.Frame]) -> None:
        """Put into the inbox what the budget has room for, and report what is dropped."""
        self._health.add_frames(len(frames), frames[-1].monotonic_ns)
        admitted = self._budget.count_admitted_frames(frames, time.monotonic())
        if excess := len(frames) - admitted:
            self._health.over_budget += excess
            self._count_lost_frames(_OVER_BUDGET.format(self._budget.bytes_per_s / 1e3), excess)
            self._stopping.wait(_FLOOD_PAUSE_S)  # a source that floods is read slowly: the system drops the excess
            self._ended_s = time.monotonic()
        dropped = admitted - self._inbox.put(self._health.name, frames[:admitted])
        if dropped and self._health.dropped == self._dropped_before:
            self._tell("error", f"{self._health.name}: the queue is full, frames are being dropped")
        self._health.dropped += dropped
        if not dropped and self._health.dropped > self._dropped_before:
            count = self._health.dropped - self._dropped_before
            self._tell("error", f"{self._health.name}: {count:,} frames were dropped; none any more")
            self._dropped_before = self._health.dropped

    def _count_lost_frames(self, template: str, count: int) -> None:
        """Count what never came to the queue: as bad as a drop of our own; ``template`` takes their sum."""
        self._health.dropped += count
        self._dropped_before += count
        self._unreported[template] += count
        if time.monotonic() - self._warned_s.get(template, float("-inf")) > _LOSS_PERIOD_S:
            self._report_losses(template)
            self._warned_s[template] = time.monotonic()

    def _report_losses(self, template: str) -> None:
        self._tell("error", f"{self._health.name}: {template.format(self._unreported.pop(template))}")

    def _note_failure(self, error: errors.SourceError) -> None:
        if self._health.failed_ns is None:
            self._health.failed_ns = time.monotonic_ns()
            self._tell("error", str(error))
        self._health.state = "failed"


def as_source_error(source: Source, error: Exception) -> errors.SourceError:
    """What a driver raised, as an error of ours."""
    if isinstance(error, errors.SourceError):
        return error
    reason = str(error) if isinstance(error, errors.SeatrialError) else f"{type(error).__name__} {error}"
    return errors.SourceError("failed", where=f"source {source.name!r}", why=reason)
