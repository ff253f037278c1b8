"""A recording read while it is written: the same samples as of the finished file, whatever is there at a moment."""

from __future__ import annotations

import random
from collections import defaultdict
from pathlib import Path

import pytest

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.requests import (
    Follower,
    RecorderState,
    RequestServer,
    choose_recorder,
    no_recorder_text,
)
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Tail, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter

START_NS = 1_790_000_000_000_000_000
NAMES = ("north_m", "heading_deg", "port_rpm")
Rows = dict[str, list[tuple[int, int, float, int]]]


def sample(number: int) -> Sample:
    """Ten samples a second of three channels in turn; every channel's first comes later than the one before."""
    name = NAMES[min(number // 40, number % 3)]
    time_ns = START_NS + number * 100_000_000
    return Sample(name, float(number % 360), "x", time_ns, number, time_ns - 1_000 * (number % 7))


def add(rows: Rows, samples: dict[str, Series]) -> None:
    for name, each in samples.items():
        columns = each.measured_ns, each.received_ns, each.value, each.quality
        rows[name] += zip(*(column.tolist() for column in columns), strict=True)


def rows_in(paths: list[Path]) -> Rows:
    rows: Rows = defaultdict(list)
    for path in paths:
        add(rows, read_recording(path).series)
    return rows


def finished(path: Path, count: int, seed: int = 0) -> Path:
    """A closed recording of ``count`` samples in chunks of many lengths."""
    chance = random.Random(seed)
    with RecordingWriter(path, Trial(name="tail"), {"configuration.toml": b"[trial]"}) as writer:
        for number in range(count):
            writer.write_sample(sample(number))
            writer.write_event(f"event {number}", START_NS + number)
            if chance.random() < 0.05:
                writer.flush()
    return path


@pytest.mark.parametrize("seed", range(8))
def test_a_file_that_grows_by_any_bytes_gives_the_samples_of_the_finished_file(tmp_path: Path, seed: int) -> None:
    whole = finished(tmp_path / "whole.mcap", 1500, seed)
    content, growing = whole.read_bytes(), tmp_path / "growing.mcap"
    growing.touch()
    chance, rows = random.Random(seed), defaultdict(list)
    with Tail(growing) as tail, growing.open("ab") as file:
        written = 0
        while written < len(content):
            assert not tail.ended
            count = chance.choice((1, 7, 300, 5000))
            file.write(content[written : written + count])
            file.flush()
            written += count
            add(rows, tail.read_new_samples())
        assert tail.ended
        assert (tail.damaged, tail.cut) == (0, False)
        assert tail.trial.name == "tail"
    assert rows == rows_in([whole])


def test_who_comes_late_reads_the_last_minute_and_misses_nothing_after(tmp_path: Path) -> None:
    """The topics were defined in chunks that are passed over."""
    path, rows = tmp_path / "long.mcap", defaultdict(list)
    writer = RecordingWriter(path, Trial(name="long"))
    for number in range(6000):
        writer.write_sample(sample(number))
        if number % 2 == 1:
            writer.flush()
    with Tail(path, recent_s=60.0) as tail:
        add(rows, tail.read_new_samples())
        first_ns = min(row[1] for each in rows.values() for row in each)
        assert sample(5999).received_ns - first_ns == pytest.approx(60e9, abs=0.3e9)
        for number in range(6000, 6100):
            writer.write_sample(sample(number))
        writer.close()
        add(rows, tail.read_new_samples())
        assert tail.ended
    expected = rows_in([path])
    assert rows == {name: [row for row in each if row[1] >= first_ns] for name, each in expected.items()}


def test_a_chunk_that_is_damaged_is_passed_over_and_counted(tmp_path: Path) -> None:
    """Once it is certain that it is not merely unfinished: the file has grown past it."""
    path, rows = tmp_path / "damaged.mcap", defaultdict(list)
    writer = RecordingWriter(path, Trial())
    starts = []
    for number in range(300):
        if number % 100 == 0:
            writer.flush()
            starts.append(path.stat().st_size)
        writer.write_sample(sample(number))
    writer.flush()
    content = bytearray(path.read_bytes())
    content[starts[2] + 70] ^= 0xFF
    path.write_bytes(content[: starts[2]])
    with Tail(path) as tail:
        add(rows, tail.read_new_samples())
        path.write_bytes(content)
        add(rows, tail.read_new_samples())
        assert tail.damaged == 1
    assert sum(len(each) for each in rows.values()) == 200


def test_a_file_that_became_shorter_is_read_no_further(tmp_path: Path) -> None:
    path = finished(tmp_path / "cut.mcap", 300)
    with Tail(path) as tail:
        assert tail.read_new_samples()
        with path.open("r+b") as file:
            file.truncate(1000)
        assert not tail.read_new_samples()
        assert tail.cut


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.mcap: cannot be opened"):
        Tail(tmp_path / "nowhere.mcap")


class Recorded:
    """A recorder's parts and its ear, without its sources."""

    def __init__(self, folder: Path, runtime: Path, name: str = "tail", offset_ns: int = 0) -> None:
        clock = {"utc_minus_monotonic_ns": str(offset_ns)}
        self.parts = RecordingParts(folder, Trial(name=name), {}, RecordingSection(), clock)
        self.name, self.paused = name, False
        self.hearing = RequestServer(lambda text, at_ns: None, self.who, Predictions(Health({})), runtime)

    def who(self) -> RecorderState:
        return RecorderState(self.name, "/trial.toml", str(self.parts.path), self.paused, 1, 0, 0)

    def write(self, numbers: range) -> None:
        for number in numbers:
            self.parts.write_sample(sample(number))
        self.parts.flush()


def follower(runtime: Path, told: list[str], name: str = "tail") -> Follower:
    return Follower(name, Path("/trial.toml"), 1e6, lambda level, text: told.append(text), runtime)


def gathered(rows: Rows, following: Follower, monkeypatch: pytest.MonkeyPatch, looks: int = 3) -> list[bool]:
    """Take in what comes, with a second between looks; whether each was of another recording."""
    anew = []
    for _ in range(looks):
        news = following.news()
        for each in news.samples:
            add(rows, each)
        anew.append(news.restarted)
        following._asked_s -= 1.5
        following._heard_s -= 1.5
    return anew


def test_parts_are_followed_without_a_hole_and_without_a_repetition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    rows: Rows = defaultdict(list)
    recorded = Recorded(tmp_path / "out", tmp_path / "run")
    following = follower(tmp_path / "run", told)
    with recorded.hearing:
        began = 0
        for part in range(3):
            for _ in range(2):
                recorded.write(range(began, began + 50))
                began += 50
                anew = gathered(rows, following, monkeypatch)
                assert any(anew) == (began == 50)
            if part < 2:
                recorded.write(range(began, began + 10))  # not seen before the part is closed
                began += 10
                recorded.parts.begin_next_part("the part is full")
        recorded.parts.close()
        gathered(rows, following, monkeypatch)
    following.close()
    assert len(recorded.parts.paths) == 3
    assert rows == rows_in(recorded.parts.paths)
    assert sum(text.startswith("following") for text in told) == 3


def test_another_recording_and_another_clock_begin_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    rows: Rows = defaultdict(list)
    following = follower(tmp_path / "run", told)
    assert gathered(rows, following, monkeypatch) == [False] * 3
    assert told == ["no recorder of the trial 'tail' runs here; waiting for one"]
    for run in range(2):
        recorded = Recorded(tmp_path / f"out{run}", tmp_path / "run")
        with recorded.hearing:
            recorded.write(range(50))
            assert any(gathered(rows, following, monkeypatch))
            if run == 1:
                recorded.parts.set_clock({"utc_minus_monotonic_ns": "5000000000"}, "the computer's clock was set")
                recorded.write(range(50, 100))
                assert any(gathered(rows, following, monkeypatch))
            recorded.parts.close()
        assert not any(gathered(rows, following, monkeypatch))
        assert told[-1].startswith("no recorder")
    following.close()
    assert sum(map(len, rows.values())) == 150


def test_of_several_recorders_the_one_of_the_trial_is_followed() -> None:
    def running(trial: str, configuration: str) -> RecorderState:
        return RecorderState(trial, configuration, "x", False, 1, 0, 0)

    found = [
        (Path("1-a.sock"), running("bay", "/a.toml")),
        (Path("2-ff.sock"), running("bay", "/b.toml")),
        (Path("3-1ff.sock"), running("bay", "/b.toml")),
        (Path("4-fff.sock"), running("fjord", "/a.toml")),
    ]
    assert choose_recorder(found, "bay", Path("/a.toml")) == found[0]
    assert choose_recorder(found, "bay", Path("/c.toml")) == found[2]
    assert choose_recorder(found, "ocean", Path("/a.toml")) is None
    assert "the recorder of 'bay' (/a.toml), 'bay' (/b.toml)" in no_recorder_text(found[:2], "ocean")
