"""A recording read while it is written: the same samples as of the finished file, whatever is there at a moment."""

from __future__ import annotations

import os
import random
from collections import defaultdict
from math import inf
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


def fail(why: str) -> None:
    raise OSError(why)


def gathered(rows: Rows, following: Follower, looks: int = 3) -> list[bool]:
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


def test_parts_are_followed_without_a_hole_and_without_a_repetition(tmp_path: Path) -> None:
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
                anew = gathered(rows, following)
                assert any(anew) == (began == 50)
            if part < 2:
                recorded.write(range(began, began + 10))  # not seen before the part is closed
                began += 10
                recorded.parts.begin_next_part("the part is full")
        recorded.parts.close()
        gathered(rows, following)
    following.close()
    assert len(recorded.parts.paths) == 3
    assert rows == rows_in(recorded.parts.paths)
    assert sum(text.startswith("following") for text in told) == 3


def test_another_recording_and_another_clock_begin_anew(tmp_path: Path) -> None:
    told: list[str] = []
    rows: Rows = defaultdict(list)
    following = follower(tmp_path / "run", told)
    assert gathered(rows, following) == [False] * 3
    assert told == ["no recorder of the trial 'tail' runs here; waiting for one"]
    for run in range(2):
        recorded = Recorded(tmp_path / f"out{run}", tmp_path / "run")
        with recorded.hearing:
            recorded.write(range(50))
            assert any(gathered(rows, following))
            if run == 1:
                recorded.parts.set_clock({"utc_minus_monotonic_ns": "5000000000"}, "the computer's clock was set")
                recorded.write(range(50, 100))
                assert any(gathered(rows, following))
            recorded.parts.close()
        assert not any(gathered(rows, following))
        assert told[-1].startswith("no recorder")
    following.close()
    assert sum(map(len, rows.values())) == 150


@pytest.mark.parametrize("seed", range(6))
def test_every_sample_is_read_once_whatever_was_begun_between_two_looks(tmp_path: Path, seed: int) -> None:
    """Parts, several at once, recordings and steps of the clock, each with samples before that nobody had seen: the
    remainder of a recording comes before the news that another has begun."""
    chance, written, paths = random.Random(seed), 0, list[Path]()
    rows: Rows = defaultdict(list)
    restarts, expected = list[int](), list[int]()
    following = follower(tmp_path / "run", [])

    def look() -> None:
        news = following.news()
        if news.restarted:
            restarts.append(sum(map(len, rows.values())))
        for samples in news.samples:
            add(rows, samples)
        following._asked_s -= 1.5
        following._heard_s -= 1.5

    for run in range(3):
        recorded = Recorded(tmp_path / f"out{run}", tmp_path / "run")
        expected.append(written)
        with recorded.hearing:
            for _ in range(10):
                recorded.write(range(written, written + 5))
                written += 5
                if chance.random() < 0.4:
                    recorded.parts.begin_next_part("the part is full")
                for _ in range(chance.choice((0, 0, 1, 4))):
                    look()
            for _ in range(2 * len(recorded.parts.paths)):  # a part a look
                look()
            recorded.parts.set_clock({"utc_minus_monotonic_ns": str((run + 1) * 10**10)}, "the clock was set")
            expected.append(written)
            recorded.write(range(written, written + 5))
            written += 5
            look()
            look()
            recorded.write(range(written, written + 5))
            written += 5
            recorded.parts.close()
        paths += recorded.parts.paths
    recorded = Recorded(tmp_path / "last", tmp_path / "run")
    with recorded.hearing:
        for _ in range(4):
            look()
    following.close()
    recorded.parts.close()
    assert rows == rows_in(paths)
    assert restarts[: len(expected)] == expected


@pytest.mark.parametrize("deleted", [False, True])
def test_what_a_recorder_writes_again_is_read_once(tmp_path: Path, deleted: bool) -> None:
    """A disk that failed: the file ends before what was read of it, and the next part has that once more; or the
    file was deleted, and is put back."""
    rows: Rows = defaultdict(list)
    following = follower(tmp_path / "run", [])
    recorded = Recorded(tmp_path / "out", tmp_path / "run")
    with recorded.hearing:
        recorded.write(range(50))
        recorded.parts.sync()
        (kept,) = recorded.parts.paths
        size = kept.stat().st_size
        recorded.write(range(50, 80))
        gathered(rows, following)
        if deleted:
            kept.unlink()
            recorded.parts.check_limits(inf)
        else:
            recorded.parts._try_disk_action(lambda: fail("the disk is gone"))
            os.truncate(kept, size)
            recorded.parts.resume_if_possible()
        recorded.write(range(80, 100))
        gathered(rows, following, 6)
        recorded.parts.close()
    following.close()
    assert len(recorded.parts.paths) == 2
    received = sorted(row[1] for values in rows.values() for row in values)
    assert received == [sample(number).received_ns for number in range(100)]


def test_follower_that_comes_late_reads_the_parts_before(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path / "out", tmp_path / "run")
    for part in range(3):
        recorded.write(range(part * 50, part * 50 + 50))
        if part < 2:
            recorded.parts.begin_next_part("the part is full")
    rows: Rows = defaultdict(list)
    following = follower(tmp_path / "run", [])
    with recorded.hearing:
        assert gathered(rows, following) == [True, False, False]
        recorded.parts.close()
    following.close()
    assert rows == rows_in(recorded.parts.paths)


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
