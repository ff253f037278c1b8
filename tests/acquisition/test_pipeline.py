"""The recorder's threads: nothing is lost or ends without a word, and a recording can always be stopped."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import SourceError, StorageError
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.logger.health import SourceHealth
from seatrial.acquisition.logger.maintenance import TICK_S, Maintenance, Timescale
from seatrial.acquisition.logger.pipeline import Inbox, Receiver, Recorder, initial_health
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Recording, read_recording
from tests.acquisition.conftest import PATIENCE_S, SimulatedClock, config_text, wait_for

HEADING = frame_sentence("HEHDT,12.3,T").strip()
Read = Callable[[], list[Frame] | None]


class FakeSource:
    """A source whose reads are a function; counts how often it was opened and closed."""

    lost = 0

    def __init__(self, name: str, read: Read) -> None:
        self.name, self._read = name, read
        self.opened = self.closed = 0
        self.rested = threading.Event()  # there was nothing to read: all before is on its way

    def open(self) -> None:
        self.opened += 1

    def read(self, timeout_s: float) -> list[Frame] | None:
        frames = self._read()
        if frames == []:
            self.rested.set()
        return frames

    def close(self) -> None:
        self.closed += 1


def frame(payload: bytes = HEADING, name: str = "line") -> Frame:
    return Frame(name, "nmea0183", payload, *wall_and_monotonic_ns())


def idle() -> list[Frame]:
    time.sleep(0.02)
    return []


def reads(*results: list[Frame] | Exception | None) -> Read:
    """Each result once, then nothing more."""
    left: Iterator[list[Frame] | Exception | None] = iter(results)

    def read() -> list[Frame] | None:
        result = next(left, [])
        if isinstance(result, Exception):
            raise result
        return idle() if result == [] else result

    return read


@pytest.fixture
def config(tmp_path: Path) -> TrialConfig:
    """One line of sentences, and a queue that holds a hundred of them."""
    text = config_text('type = "udp"\nport = 1\n', ("heading_deg",), clock="receiver")
    (tmp_path / "trial.toml").write_text(text + "[recording]\nqueue_frames = 100\n")
    return load_config(tmp_path / "trial.toml")


Run = Callable[..., Recording]


@pytest.fixture
def run(config: TrialConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Record from a fake source until it has nothing more, or ``during`` ends, and give the recording back."""

    def recorded(source: FakeSource, during: Callable[[Recorder], object] | None = None) -> Recording:
        monkeypatch.setattr("seatrial.acquisition.logger.pipeline.make_source", lambda section: source)
        parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
        recorder = Recorder(config, parts)
        recorder.start()
        try:
            during(recorder) if during else wait_for(source.rested.is_set)
        finally:
            recorder.stop()
            parts.close()
        return read_recording(parts.path)

    return recorded


def texts(recording: Recording) -> str:
    return " | ".join(text for _, text in recording.events)


def test_a_full_queue_drops_and_counts(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recorded and dropped are all that came, and the event log has said it once."""
    from seatrial.acquisition.logger.processing import FrameProcessor

    slow = FrameProcessor.process

    def process(self: FrameProcessor, each: Frame) -> None:
        time.sleep(0.0005)
        slow(self, each)

    monkeypatch.setattr(FrameProcessor, "process", process)
    recorders: list[Recorder] = []
    source = FakeSource("line", reads([frame() for _ in range(1000)]))

    def during(recorder: Recorder) -> None:
        recorders.append(recorder)
        wait_for(source.rested.is_set)

    recording = run(source, during)
    health = recorders[0].health.sources["line"]
    assert health.frames == 1000
    assert health.dropped > 0
    assert recording.raw["/raw/nmea0183/line"] == 1000 - health.dropped
    assert texts(recording).count("the queue is full") == 1


@pytest.mark.parametrize("error", [SourceError("pulled"), ValueError("a driver's own"), RuntimeError("another")])
def test_whatever_a_driver_raises_the_source_is_opened_again(run: Run, error: Exception) -> None:
    source = FakeSource("line", reads([frame()], error, [frame()]))
    recording = run(source)
    assert recording.series["heading_deg"].value.size == 2
    assert source.opened == source.closed == 2
    assert str(error) in texts(recording)
    assert "'line' is back" in texts(recording)


def test_a_source_that_can_be_opened_and_fails_at_once_is_tried_ever_more_seldom() -> None:
    """A gateway that accepts and closes: one event, not ten a second, and no claim that it is back."""
    pauses_s, said = list[float | None](), list[str]()

    class Stopping(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            pauses_s.append(timeout)
            if len(pauses_s) == 12:
                self.set()
            return self.is_set()

    def read() -> list[Frame] | None:
        raise SourceError("the other end closed the connection")

    source = FakeSource("line", read)
    health = SourceHealth("line")
    inbox = Inbox({"line": health}, 100)
    Receiver(source, health, inbox, Stopping(), lambda level, text: said.append(text)).run()
    assert source.opened == 12
    assert pauses_s == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 10.0, 10.0, 10.0, 10.0, 10.0]
    assert [text.count("closed the connection") for text in said] == [1]


def test_a_source_that_takes_long_to_open_keeps_no_other_from_being_heard(
    config: TrialConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    release = threading.Event()

    class Slow(FakeSource):
        def open(self) -> None:
            release.wait(PATIENCE_S)

    both = replace(config, sources=(*config.sources, replace(config.sources[0], name="slow", channels=())))
    made = {"line": FakeSource("line", reads([frame()])), "slow": Slow("slow", idle)}
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline.make_source", lambda section: made[section.name])
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    recorder = Recorder(both, parts)
    recorder.start()
    wait_for(lambda: recorder.health.sources["line"].frames == 1)
    release.set()
    recorder.stop()
    parts.close()
    assert read_recording(parts.path).raw == {"/raw/nmea0183/line": 1}


def test_a_source_that_hangs_is_left_behind(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline._LONGEST_JOIN_S", 0.2)
    hangs, release, woke = threading.Event(), threading.Event(), threading.Event()
    first = iter([[frame()]])

    def read() -> list[Frame] | None:
        if frames := next(first, None):
            return frames
        hangs.set()
        release.wait(PATIENCE_S)
        woke.set()
        return None

    recording = run(FakeSource("line", read), lambda recorder: hangs.wait(PATIENCE_S))
    assert not woke.is_set()
    release.set()
    assert recording.closed
    assert recording.series["heading_deg"].value.size == 1
    assert "does not stop and is left behind" in texts(recording)


@pytest.mark.parametrize("error", [StorageError("disk full"), ZeroDivisionError("a bug"), MemoryError()])
def test_frames_that_cannot_be_recorded_are_counted_and_do_not_end_the_recorder(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """With a source that goes on flooding; what is recorded after the failures is whole."""
    write_raw, failures = RecordingParts.write_raw, iter(range(20))

    def fail_at_first(self: RecordingParts, frame: Frame) -> None:
        if next(failures, None) is not None:
            raise error
        write_raw(self, frame)

    monkeypatch.setattr(RecordingParts, "write_raw", fail_at_first)
    alive = []

    def until_recorded(recorder: Recorder) -> None:
        wait_for(lambda: recorder.health.samples > 0)
        alive.append(not recorder.ended)

    with pytest.raises(StorageError, match="20 messages could not be written"):
        run(FakeSource("line", lambda: [frame() for _ in range(50)]), until_recorded)
    assert alive == [True]


def test_a_value_that_breaks_the_processing_is_kept_raw(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "seatrial.acquisition.logger.processing.Derivation.remember_channel_sample", lambda self, sample: 1 / 0
    )
    recording = run(FakeSource("line", reads([frame(), frame()])))
    assert recording.raw["/raw/nmea0183/line"] == 2
    assert texts(recording).count("could not be interpreted: ZeroDivisionError") == 1


def test_a_frame_that_breaks_a_decoder_is_kept_raw(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder

    sound = Nmea0183Decoder.decode

    def decode(self: Nmea0183Decoder, each: Frame) -> object:
        return 1 / 0 if b"HEHDT,9" in each.payload else sound(self, each)

    monkeypatch.setattr(Nmea0183Decoder, "decode", decode)
    bad = frame_sentence("HEHDT,9.9,T").strip()
    recording = run(FakeSource("line", reads([frame(), frame(bad), frame(bad), frame()])))
    assert recording.raw["/raw/nmea0183/line"] == 4
    assert recording.series["heading_deg"].value.tolist() == [12.3, 12.3]
    assert texts(recording).count("broke the decoder: ZeroDivisionError") == 1


def test_marks_from_many_threads_keep_their_times(run: Run) -> None:
    marked_ns: dict[str, tuple[int, int]] = {}

    def during(recorder: Recorder) -> None:
        def mark(number: int) -> None:
            before_ns, _ = wall_and_monotonic_ns()
            recorder.mark(f"mark {number}")
            marked_ns[f"mark {number}"] = before_ns, wall_and_monotonic_ns()[0]

        threads = [threading.Thread(target=mark, args=(number,)) for number in range(20)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    events = [each for each in run(FakeSource("line", idle), during).events if each[1].startswith("mark")]
    assert {text for _, text in events} == {f"mark {number}" for number in range(20)} == marked_ns.keys()
    drift_ns = 5_000_000  # of the recording's clock from the computer's
    for time_ns, text in events:
        before_ns, after_ns = marked_ns[text]
        assert before_ns - drift_ns <= time_ns <= after_ns + drift_ns


@pytest.mark.parametrize("read", [idle, lambda: [frame() for _ in range(20)]])
def test_the_disk_is_told_again_and_again_even_when_nothing_comes(
    run: Run, monkeypatch: pytest.MonkeyPatch, read: Read
) -> None:
    """And also in a flood."""
    synced: list[int] = []
    real = os.fdatasync

    def fdatasync(descriptor: int) -> None:
        synced.append(descriptor)
        real(descriptor)

    monkeypatch.setattr(os, "fdatasync", fdatasync)
    run(FakeSource("line", read), lambda recorder: wait_for(lambda: len(synced) >= 4))


def test_the_disk_is_told_twice_a_second(
    config: TrialConfig, tmp_path: Path, clock: SimulatedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced_s: list[float] = []

    def sync_soon(self: RecordingParts) -> bool:
        synced_s.append(clock.now_s)
        return True

    monkeypatch.setattr("seatrial.acquisition.logger.maintenance.time", clock)
    monkeypatch.setattr(RecordingParts, "sync_in_background", sync_soon)
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    scale = Timescale(*wall_and_monotonic_ns())
    maintenance = Maintenance(config.recording, parts, initial_health(config), scale, lambda level, text: None)
    for _ in range(200):
        clock.sleep(TICK_S)
        maintenance.run_periodic_tasks()
    parts.close()
    assert len(synced_s) >= 200 * TICK_S / 0.5 - 1
    assert max(later - earlier for earlier, later in pairwise(synced_s)) < 0.5 + 1e-9


class Broken(FakeSource):
    """A source that cannot be opened the first ``failures`` times."""

    def __init__(self, name: str, read: Read, failures: int = 1_000) -> None:
        super().__init__(name, read)
        self.failures = failures

    def open(self) -> None:
        super().open()
        if self.opened <= self.failures:
            raise ValueError("a driver's own error")


def test_where_no_source_can_be_opened_nothing_is_recorded(run: Run) -> None:
    with pytest.raises(SourceError, match="source 'line': failed: ValueError a driver's own error"):
        run(Broken("line", idle))


def test_a_source_that_is_not_there_yet_does_not_stop_the_others(
    config: TrialConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is opened as soon as that can be done, and the recording tells how long it was away."""
    late = replace(config.sources[0], name="late", channels=())
    both = replace(config, sources=(*config.sources, late))
    made = {"line": FakeSource("line", reads([frame()])), "late": Broken("late", reads([frame(name="late")]), 2)}
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline.make_source", lambda section: made[section.name])
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    recorder = Recorder(both, parts)
    recorder.start()
    wait_for(lambda: recorder.health.sources["late"].frames == 1)
    recorder.stop()
    parts.close()
    recording = read_recording(parts.path)
    assert recording.raw == {"/raw/nmea0183/line": 1, "/raw/nmea0183/late": 1}
    assert texts(recording).count("a driver's own error") == 1
    assert re.search(r"source 'late' is back after \d+\.\d s", texts(recording))
