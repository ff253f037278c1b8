"""The time of a recording: it never steps, follows small corrections, and says when the clock was set."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.logger import maintenance as housekeeping
from seatrial.acquisition.logger.maintenance import Timescale
from seatrial.acquisition.logger.pipeline import Recorder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Recording, read_recording
from tests.acquisition.conftest import config_text, wait_for

SECOND = 1_000_000_000
NOW = 1_790_000_000 * SECOND


def frame(wall_ns: int, monotonic_ns: int) -> Frame:
    return Frame("line", "nmea0183", b"", wall_ns, monotonic_ns)


@given(
    steps_s=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20),
    pauses_s=st.lists(st.floats(0.001, 10.0), min_size=20, max_size=20),
)
def test_order_and_durations_stay_right_whatever_is_done_to_the_clock(
    steps_s: list[float], pauses_s: list[float]
) -> None:
    """Durations within the 500 ppm of following, and never backwards, as long as the scale is not changed."""
    scale = Timescale(NOW, 0)
    wall_ns, monotonic_ns = NOW, 0
    times = []
    for step_s, pause_s in zip(steps_s, pauses_s, strict=False):
        monotonic_ns += int(pause_s * SECOND)
        wall_ns = wall_ns + int(pause_s * SECOND) + int(step_s * SECOND)
        scale.follow_wall_clock(wall_ns, monotonic_ns)
        times.append((monotonic_ns, scale.utc_ns(monotonic_ns)))
    for (before, utc_before), (after, utc_after) in pairwise(times):
        assert utc_after - utc_before == pytest.approx(after - before, rel=6e-4, abs=2)


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 0.5, -0.5])
def test_a_step_is_told_once_and_with_its_size(step_s: float) -> None:
    scale = Timescale(NOW, 0)
    assert scale.follow_wall_clock(NOW + SECOND, SECOND) == 0
    stepped_ns = int(step_s * SECOND)
    assert scale.follow_wall_clock(NOW + 2 * SECOND + stepped_ns, 2 * SECOND) == stepped_ns
    assert scale.follow_wall_clock(NOW + 3 * SECOND + stepped_ns, 3 * SECOND) == 0
    assert scale.is_beyond_following == (abs(step_s) > 1.0)


def test_a_small_error_is_followed_to_its_end() -> None:
    scale = Timescale(NOW, 0)
    for second in range(1, 1001):
        scale.follow_wall_clock(NOW + second * SECOND + 300_000_000, second * SECOND)
    assert scale.utc_ns(1000 * SECOND) == NOW + 1000 * SECOND + 300_000_000


def test_a_frame_is_stamped_anew_only_when_its_time_is_another() -> None:
    scale = Timescale(NOW, 0)
    good = frame(NOW + SECOND, SECOND)
    assert scale.restamp_frame(good) is good
    assert scale.restamp_frame(frame(NOW - 3600 * SECOND, SECOND)).received_ns == NOW + SECOND
    scale.follow_wall_clock(NOW - 3600 * SECOND, 2 * SECOND)
    scale.adopt_wall_clock()
    assert scale.restamp_frame(good).received_ns == NOW - 3601 * SECOND


class SettableClock:
    """The computer's clocks, of which the wall clock can be set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.offset_ns = 0
        monkeypatch.setattr(housekeeping, "wall_and_monotonic_ns", self.now_ns)

    def now_ns(self) -> tuple[int, int]:
        return time.time_ns() + self.offset_ns, time.monotonic_ns()


class Talker:
    """A source that says a heading every hundredth of a second, stamped by the clock as it is."""

    lost = 0

    name = "line"

    def __init__(self, clock: SettableClock) -> None:
        self.clock, self.said = clock, 0

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def read(self, timeout_s: float) -> list[Frame]:
        time.sleep(0.01)
        self.said += 1
        return [
            Frame("line", "nmea0183", frame_sentence(f"HEHDT,{self.said % 360},T").strip(), *self.clock.now_ns())
        ]


@pytest.fixture
def config(tmp_path: Path) -> TrialConfig:
    text = config_text('type = "udp"\nport = 1\n', ("heading_deg",), clock="receiver")
    (tmp_path / "trial.toml").write_text(text)
    return load_config(tmp_path / "trial.toml")


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_the_clock_is_set_by_an_hour_while_it_records(
    config: TrialConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    """Nothing is lost; within each part order and durations are right, and the parts differ by the hour."""
    clock = SettableClock(monkeypatch)
    talker = Talker(clock)
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline.make_source", lambda section: talker)
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    recorder = Recorder(config, parts)
    recorder.start()
    wait_for(lambda: talker.said > 30)
    clock.offset_ns = int(step_s * SECOND)
    said = talker.said
    wait_for(lambda: talker.said > said + 30)
    recorder.stop()
    parts.close()
    first, second = (read_recording(path) for path in parts.paths)
    assert first.series["heading_deg"].value.size + second.series["heading_deg"].value.size == talker.said
    for recording in (first, second):
        assert_in_order(recording)
        assert any(f"the computer's clock was set by {step_s:+.3f} s" in text for _, text in recording.events)
    between_ns = second.series["heading_deg"].received_ns[0] - first.series["heading_deg"].received_ns[-1]
    assert between_ns == pytest.approx(step_s * SECOND, abs=0.2 * SECOND)


def assert_in_order(recording: Recording) -> None:
    received_ns = recording.series["heading_deg"].received_ns
    gaps_ns = [int(later - earlier) for earlier, later in pairwise(received_ns)]
    assert all(-1_100_000 <= gap < 0.3 * SECOND for gap in gaps_ns)


def test_both_clocks_are_read_together_even_if_the_process_is_suspended_between(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The wall clock runs 1,000 s ahead; the first reading of it comes 40 ms late."""
    now_ns, suspensions_ns = [0], iter([40_000_000])

    def monotonic_ns() -> int:
        now_ns[0] += 100
        return now_ns[0]

    def time_ns() -> int:
        now_ns[0] += next(suspensions_ns, 100)
        return now_ns[0] + 1_000_000_000_000

    monkeypatch.setattr(time, "monotonic_ns", monotonic_ns)
    monkeypatch.setattr(time, "time_ns", time_ns)
    wall_ns, monotonic = wall_and_monotonic_ns()
    assert abs(wall_ns - monotonic - 1_000_000_000_000) < 1000
