"""A recording in parts, and a disk that fails: every part is whole, nothing is there twice, nothing is lost."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording import parts as parts_module
from seatrial.acquisition.recording import writer
from seatrial.acquisition.recording.parts import RecordingParts, recording_parts_in_folder
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import PATIENCE_S

START_NS = 1_790_000_000_000_000_000
TRIAL = Trial(name="parts", vessel="gunnerus_long", origin_latitude_deg=63.44, origin_longitude_deg=10.4)


class Recorded:
    """A recording in parts that counts what it writes and keeps what it is told."""

    def __init__(self, folder: Path, **settings: float | None) -> None:
        self.told: list[str] = []
        self.written = 0
        self.parts = RecordingParts(
            folder, TRIAL, {"configuration.toml": b"[trial]"}, RecordingSection(**settings),  # type: ignore[arg-type]
            {"times": "test"}, lambda level, text: self.told.append(f"{level}: {text}"),
        )  # fmt: skip

    def write(self, count: int) -> None:
        for _ in range(count):
            time_ns = START_NS + self.written * 1_000_000
            self.parts.write_sample(Sample("north_m", self.written, "x", time_ns, 0, time_ns))
            self.written += 1

    def values(self) -> list[float]:
        """Everything that the parts hold, in their order."""
        return [value for path in self.parts.paths for value in values_in(path)]

    def expected(self) -> list[float]:
        return [float(number) for number in range(self.written)]


def values_in(path: Path) -> list[float]:
    series = read_recording(path).series.get("north_m")
    return [] if series is None else series.value.tolist()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Sets the seconds that a recording in parts believes have passed."""
    now = [100.0]
    monkeypatch.setattr(parts_module.time, "monotonic", lambda: now[0])

    def advance(seconds: float) -> None:
        now[0] += seconds

    advance.now = lambda: now[0]  # type: ignore[attr-defined]
    return advance


def assert_opens_everywhere(path: Path) -> None:
    """By the plain library too, with what it says of itself, and each part by itself."""
    recording = read_recording(path)
    assert recording.closed
    assert recording.trial == TRIAL
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert sum(1 for _ in reader.iter_messages()) == recording.messages
        names = [record.name for record in reader.iter_metadata()]
        assert {"trial", "part", "clock"} <= set(names)
        assert [record.name for record in reader.iter_attachments()] == ["configuration.toml"]


def test_parts_by_time_follow_each_other_without_a_gap(tmp_path: Path, clock: Callable[[float], None]) -> None:
    recorded = Recorded(tmp_path, split_minutes=1.0)
    for _ in range(5):
        recorded.write(200)
        clock(31.0)
        recorded.parts.sync()
        recorded.parts.check_limits(clock.now())  # type: ignore[attr-defined]
    recorded.parts.close()
    assert len(recorded.parts.paths) == 3
    assert recorded.values() == recorded.expected()
    for path in recorded.parts.paths:
        assert_opens_everywhere(path)
    assert sorted(recorded.parts.paths) == recorded.parts.paths


def test_parts_by_size(tmp_path: Path, clock: Callable[[float], None]) -> None:
    recorded = Recorded(tmp_path, split_minutes=None, split_mb=0.01)
    for _ in range(20):
        recorded.write(100)
        recorded.parts.sync()
        clock(1.0)
        recorded.parts.check_limits(clock.now())  # type: ignore[attr-defined]
    recorded.parts.close()
    assert len(recorded.parts.paths) > 3
    assert recorded.values() == recorded.expected()
    assert all(path.stat().st_size < 30_000 for path in recorded.parts.paths)


def test_two_recordings_that_begin_in_one_second_have_two_names(tmp_path: Path) -> None:
    first, second = Recorded(tmp_path), Recorded(tmp_path)
    assert first.parts.path != second.parts.path
    first.parts.close()
    second.parts.close()


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(-400, 400), st.integers(0, 2)), min_size=1, max_size=6))
def test_names_sort_as_the_recordings_came_wherever_the_clock_is_set(
    tmp_path_factory: pytest.TempPathFactory, sessions: list[tuple[int, int]]
) -> None:
    """Each recording begins with the clock moved by so many hours, and within it the clock is set so many times."""
    folder, now, came = tmp_path_factory.mktemp("names"), datetime(2026, 5, 17, tzinfo=UTC), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts_module, "datetime", SimpleNamespace(now=lambda zone: now))
        for hours, steps in sessions:
            now += timedelta(hours=hours)
            recorded = Recorded(folder)
            for _ in range(steps):
                now += timedelta(hours=hours)
                recorded.parts.set_clock({"times": "other"}, "set")
            recorded.parts.close()
            came += recorded.parts.paths
    assert sorted(path.name for path in came) == [path.name for path in came]
    assert list(recording_parts_in_folder(folder, "parts")) == came


def test_no_part_is_written_over_a_file_that_is_there(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    occupied = recorded.parts.path.with_name(f"{recorded.parts.path.stem}_part00002.mcap")
    occupied.write_text("somebody's")
    recorded.write(10)
    recorded.parts.begin_next_part("asked for")
    recorded.write(10)
    recorded.parts.close()
    assert occupied.read_text() == "somebody's"
    assert recorded.values() == recorded.expected()


class FailingDisk:
    """Writes as the real one does, until it has an error; ``room`` is what may still be written [bytes]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.error: int | None = None
        self.room = float("inf")
        self._pwrite, self._fdatasync, self._ftruncate = os.pwrite, os.fdatasync, os.ftruncate
        monkeypatch.setattr(writer.os, "pwrite", self.pwrite)
        monkeypatch.setattr(writer.os, "fdatasync", self.fdatasync)
        monkeypatch.setattr(writer.os, "ftruncate", self.ftruncate)

    def pwrite(self, descriptor: int, data: bytes, offset: int) -> int:
        self.fail()
        count = int(min(len(data), self.room))
        if count == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= count
        return self._pwrite(descriptor, data[:count], offset)

    def fdatasync(self, descriptor: int) -> None:
        self.fail()
        self._fdatasync(descriptor)

    def ftruncate(self, descriptor: int, length: int) -> None:
        self.fail()
        freed = os.fstat(descriptor).st_size - length
        self._ftruncate(descriptor, length)
        self.room += freed

    def fail(self) -> None:
        if self.error is not None:
            raise OSError(self.error, os.strerror(self.error))


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> FailingDisk:
    return FailingDisk(monkeypatch)


@pytest.mark.parametrize("room", [0, 1, 49, 50, 51, 300, 2_000])
def test_a_full_disk_ends_the_part_well_and_costs_nothing(tmp_path: Path, disk: FailingDisk, room: int) -> None:
    """The write that fails is cut off again, whatever part of it had room; its messages go into the next part."""
    recorded = Recorded(tmp_path, reserve_mb=0.0)
    recorded.write(500)
    recorded.parts.sync()
    disk.room = room
    recorded.write(500)
    recorded.parts.sync()
    assert recorded.parts.paused
    assert "No space left" in recorded.parts.trouble
    recorded.write(300)  # waits in memory
    disk.room = float("inf")
    recorded.parts.resume_if_possible()
    assert not recorded.parts.paused
    recorded.write(200)
    recorded.parts.close()
    first, second = recorded.parts.paths
    assert len(values_in(first)) == 500
    assert recorded.values() == recorded.expected()
    assert read_recording(first).closed  # later, where there was no room for the 50 bytes of an ending
    assert_opens_everywhere(second)
    assert "RECORDING PAUSED" in recorded.told[0]
    assert "recording goes on" in recorded.told[1]


@pytest.mark.parametrize("error", [errno.EIO, errno.ENODEV, errno.EROFS, errno.ESTALE])
def test_a_disk_that_is_gone_leaves_a_readable_file(tmp_path: Path, disk: FailingDisk, error: int) -> None:
    """Nothing can be written, cut or ended: the file is what was synced, and the rest is in the next part.

    Once the disk is back, it is ended well.
    """
    recorded = Recorded(tmp_path)
    recorded.write(500)
    recorded.parts.sync()
    recorded.write(100)
    disk.error = error
    recorded.parts.sync()
    recorded.parts.check_limits(float("inf"))
    assert recorded.parts.paused
    assert not read_recording(recorded.parts.paths[0]).closed
    disk.error = None
    recorded.parts.resume_if_possible()
    recorded.write(100)
    recorded.parts.close()
    assert recorded.values() == recorded.expected()
    assert read_recording(recorded.parts.paths[0]).closed


def test_a_sync_that_fails_after_a_flush_writes_nothing_twice(tmp_path: Path, disk: FailingDisk) -> None:
    recorded = Recorded(tmp_path)
    recorded.write(100)
    recorded.parts.sync()
    recorded.write(100)
    recorded.parts.flush()  # handed over, not yet sure
    disk.error = errno.EIO
    recorded.parts.sync()
    disk.error = None
    recorded.parts.resume_if_possible()
    recorded.parts.close()
    assert recorded.values() == recorded.expected()


def test_what_cannot_be_written_to_the_end_is_told(tmp_path: Path, disk: FailingDisk) -> None:
    recorded = Recorded(tmp_path)
    recorded.write(10)
    disk.error = errno.EROFS
    recorded.parts.sync()
    with pytest.raises(StorageError, match=r"10 messages could not be written: .*Read-only"):
        recorded.parts.close()


def test_more_than_memory_may_hold_is_counted(
    tmp_path: Path, disk: FailingDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts_module, "_MOST_UNSURE", 50)
    recorded = Recorded(tmp_path)
    disk.error = errno.EIO
    recorded.parts.sync()
    recorded.write(80)
    disk.error = None
    recorded.parts.resume_if_possible()
    with pytest.raises(StorageError, match="30 messages could not be written"):
        recorded.parts.close()
    assert len(recorded.values()) == 50


def test_a_reserve_is_left_and_the_recording_goes_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = [10_000_000]
    monkeypatch.setattr(writer, "free_and_total_bytes", lambda folder: (free[0], 100_000_000))
    recorded = Recorded(tmp_path, reserve_mb=4.0)
    recorded.write(100)
    recorded.parts.check_limits(1e9)
    assert not recorded.parts.paused
    free[0] = 3_000_000
    recorded.parts.check_limits(2e9)
    assert recorded.parts.paused
    assert_opens_everywhere(recorded.parts.path)
    recorded.write(50)
    free[0] = 4_100_000  # more than the reserve, but not by enough to stop and go all the time
    recorded.parts.check_limits(3e9)
    assert recorded.parts.paused
    free[0] = 5_000_000
    recorded.parts.check_limits(4e9)
    assert not recorded.parts.paused
    recorded.parts.close()
    assert recorded.values() == recorded.expected()


def test_without_room_a_recording_does_not_begin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "free_and_total_bytes", lambda folder: (1_000_000, 100_000_000))
    with pytest.raises(StorageError, match=r"1\.0 MB free, less than the reserve of 5\.0 MB; free space"):
        Recorded(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("whole_folder", [False, True])
def test_a_file_that_is_deleted_is_put_back(tmp_path: Path, whole_folder: bool) -> None:
    folder = tmp_path / "out"
    recorded = Recorded(folder)
    recorded.write(300)
    recorded.parts.sync()
    first = recorded.parts.path
    shutil.rmtree(folder) if whole_folder else first.unlink()
    recorded.write(50)
    recorded.parts.check_limits(float("inf"))
    recorded.write(50)
    recorded.parts.close()
    assert recorded.parts.paths[0] == first
    assert recorded.values() == recorded.expected()
    assert_opens_everywhere(first)
    assert any("was deleted while it was written" in text for text in recorded.told)


@given(
    steps=st.lists(
        st.sampled_from(["write", "flush", "sync", "full", "gone", "room", "split", "look"]),
        min_size=1,
        max_size=40,
    )
)
def test_whatever_happens_in_whatever_order_nothing_is_lost_or_changed(
    steps: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """With the disk working in the end every value is there, once."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        disk = FailingDisk(monkeypatch)
        recorded = Recorded(tmp_path_factory.mktemp("steps"), reserve_mb=0.0)
        actions: dict[str, Callable[[], object]] = {
            "write": lambda: recorded.write(7),
            "flush": recorded.parts.flush,
            "sync": recorded.parts.sync,
            "sync_soon": recorded.parts.sync_in_background,
            "full": lambda: setattr(disk, "room", 20),
            "gone": lambda: setattr(disk, "error", errno.EIO),
            "room": lambda: (setattr(disk, "room", float("inf")), setattr(disk, "error", None)),
            "split": lambda: recorded.parts.begin_next_part("asked for"),
            "look": lambda: recorded.parts.check_limits(float("inf")),
        }
        for step in steps:
            actions[step]()
        actions["room"]()
        recorded.parts.close()
        assert recorded.values() == recorded.expected()


def test_a_deleted_file_that_cannot_be_put_back_yet_is_not_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is no room for a copy: the deleted file goes on being written, and comes back when there is."""
    real = writer.CommittedFile.rewrite_deleted_content
    room = [False]

    def rescue(self: writer.CommittedFile, path: Path, ending: bytes) -> None:
        if not room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(self, path, ending)

    monkeypatch.setattr(writer.CommittedFile, "rewrite_deleted_content", rescue)
    recorded = Recorded(tmp_path)
    recorded.write(100)
    recorded.parts.path.unlink()
    for later in (1e9, 2e9):
        recorded.parts.check_limits(later)
        recorded.write(100)
    room[0] = True
    recorded.parts.check_limits(3e9)
    recorded.write(100)
    recorded.parts.close()
    assert recorded.values() == recorded.expected()
    assert sum("cannot be put back yet" in text for text in recorded.told) == 1


def test_a_deleted_file_that_cannot_be_put_back_at_all_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rescue(self: writer.CommittedFile, path: Path, ending: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writer.CommittedFile, "rewrite_deleted_content", rescue)
    recorded = Recorded(tmp_path)
    recorded.write(100)
    recorded.parts.path.unlink()
    with pytest.raises(StorageError, match="100 messages could not be written"):
        recorded.parts.close()


def test_a_deleted_file_whose_name_is_taken_comes_back_under_another(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.write(100)
    path = recorded.parts.path
    path.unlink()
    path.write_text("somebody's")
    recorded.parts.check_limits(1e9)
    recorded.parts.close()
    assert path.read_text() == "somebody's"
    assert recorded.values() == recorded.expected()


def test_a_disk_that_does_not_even_answer_pauses_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded = Recorded(tmp_path)
    recorded.write(10)
    recorded.parts.sync()
    with monkeypatch.context() as patched:
        patched.setattr(
            writer.os, "fstat", lambda descriptor: (_ for _ in ()).throw(OSError(errno.ESTALE, "stale"))
        )
        recorded.parts.check_limits(1e9)
    assert recorded.parts.paused
    recorded.parts.resume_if_possible()
    recorded.parts.close()
    assert recorded.values() == recorded.expected()


def test_trouble_while_a_part_is_closed_ends_it_well_and_writes_nothing_twice(
    tmp_path: Path, disk: FailingDisk
) -> None:
    recorded = Recorded(tmp_path, reserve_mb=0.0)
    recorded.write(100)
    recorded.parts.sync()
    recorded.write(100)
    disk.room = 60
    recorded.parts.begin_next_part("asked for")
    disk.room = float("inf")
    recorded.parts.resume_if_possible()
    recorded.parts.close()
    assert recorded.values() == recorded.expected()
    assert all(read_recording(path).closed for path in recorded.parts.paths)


def test_a_slow_disk_does_not_hold_up_what_is_handed_to_the_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the disk takes its time, more is flushed, and is there should the recorder be killed."""
    asked, answer = threading.Event(), threading.Event()
    real = os.fdatasync

    def fdatasync(descriptor: int) -> None:
        asked.set()
        assert answer.wait(PATIENCE_S)
        real(descriptor)

    recorded = Recorded(tmp_path)
    monkeypatch.setattr(writer.os, "fdatasync", fdatasync)
    recorded.write(100)
    recorded.parts.sync_in_background()
    assert asked.wait(PATIENCE_S)
    for _ in range(3):
        recorded.write(100)
        recorded.parts.flush()
        recorded.parts.sync_in_background()  # still busy
    assert len(values_in(recorded.parts.path)) == 400
    answer.set()
    recorded.parts.close()
    assert recorded.values() == recorded.expected()


def test_trouble_of_a_sync_in_the_background_is_noticed(tmp_path: Path, disk: FailingDisk) -> None:
    recorded = Recorded(tmp_path, reserve_mb=0.0)
    recorded.write(100)
    recorded.parts.sync_in_background()
    recorded.parts.sync()
    recorded.write(100)
    disk.error = errno.EIO
    recorded.parts.sync_in_background()  # the flush fails at once
    assert recorded.parts.paused
    disk.error = None
    recorded.parts.resume_if_possible()
    recorded.parts.close()
    assert recorded.values() == recorded.expected()


def test_file_that_cannot_be_cut_is_not_ended_over_what_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its unsynced messages go into the next part, too; an ending behind them would have them read twice."""
    file = writer.CommittedFile(tmp_path / "part.mcap")
    file.write(b"kept")
    file.sync()
    file.write(b"written again elsewhere")
    file.flush()

    def refuse(descriptor: int, length: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(writer.os, "ftruncate", refuse)
    assert not file.abandon(b"ending")
    assert file.closed
    assert b"ending" not in (tmp_path / "part.mcap").read_bytes()
