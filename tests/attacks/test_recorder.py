"""Attacks on the recorder: clocks, names, disks, threads, descriptors, limits. Nothing but the user ends it."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording import parts as parts_module
from seatrial.acquisition.recording import writer
from seatrial.acquisition.recording.messages import HEALTH_TOPIC
from seatrial.acquisition.recording.parts import RecordingParts, recording_parts_in_folder
from seatrial.acquisition.recording.reader import MessageStream, read_recording
from tests.attacks.commands import PATIENCE_S, start
from tests.attacks.recorder import (
    AttackedRecorder,
    attacked,
    call,
    control_group,
    mounted,
    no_descriptors,
    numbers_in,
    require,
)
from tests.conftest import nightly

START_NS = 1_790_000_000_000_000_000
SPLIT_S = "split_minutes = 0.02"  # a part each 1.2 s, so that faults meet the change of parts, too
QUICK_S, LONG_S = 1.5, 10.0
QUICK_HZ, LONG_HZ = 200.0, 1000.0


class Recorded:
    """A recording in parts of numbered values, and the remarks on it."""

    def __init__(self, folder: Path, name: str = "trial no", **options: float | None) -> None:
        self.remarks: list[str] = []
        self.written = 0
        self.parts = RecordingParts(
            folder, Trial(name=name), {}, RecordingSection(reserve_mb=0.0, **options),  # type: ignore[arg-type]
            {}, lambda level, text: self.remarks.append(text),
        )  # fmt: skip

    def write(self, count: int) -> None:
        for number in range(self.written, self.written + count):
            time_ns = START_NS + number * 1_000_000
            self.parts.write_sample(Sample("north_m", number, "x", time_ns, 0, time_ns))
        self.written += count

    def assert_complete(self) -> None:
        values: list[float] = []
        for path in self.parts.paths:
            series = read_recording(path).series.get("north_m")
            values += [] if series is None else series.value.tolist()
        assert values == list(range(self.written)), self.remarks


# Names and clocks


def recorded_at(moment: datetime, folder: Path, name: str, steps: tuple[timedelta, ...] = ()) -> list[Path]:
    """One recording with the computer's clock at ``moment``, set by ``steps`` while it runs."""
    clock = SimpleNamespace(now=lambda zone: moment)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts_module, "datetime", clock)
        recorded = Recorded(folder, name)
        recorded.write(3)
        for step in steps:
            moment += step
            recorded.parts.set_clock({"times": "other"}, "the clock was set")
            recorded.write(3)
        recorded.parts.close()
        recorded.assert_complete()
    return recorded.parts.paths


BOOT = datetime(1970, 1, 1, tzinfo=UTC)
NOW = datetime(2026, 11, 28, 9, tzinfo=UTC)


@pytest.mark.parametrize(
    "latest", [datetime(2099, 7, 1, tzinfo=UTC), *nightly(None, NOW)], ids=["2099", "empty", "2026"]
)
@pytest.mark.parametrize("boot_s", [(0,), (7, 9, 5), tuple(range(60, 0, -1))], ids=["same", "varied", "earlier"])
def test_a_hundred_starts_with_a_clock_at_1970_are_a_hundred_recordings_in_order(
    tmp_path: Path, latest: datetime | None, boot_s: tuple[int, ...]
) -> None:
    """A computer without a battery clock; then one start with the right clock."""
    paths = [] if latest is None else recorded_at(latest, tmp_path, "gunnerus")
    for number in range(100):
        paths += recorded_at(BOOT + timedelta(seconds=boot_s[number % len(boot_s)]), tmp_path, "gunnerus")
    paths += recorded_at(NOW + timedelta(hours=1), tmp_path, "gunnerus")
    assert len(set(paths)) == 101 + (latest is not None)
    assert sorted(path.name for path in paths) == [path.name for path in paths]
    assert max(len(path.name) for path in paths) < 80
    assert list(recording_parts_in_folder(tmp_path, "gunnerus")) == paths


def test_a_clock_set_right_in_a_recording_begun_in_1970_is_a_part_after_many_starts(tmp_path: Path) -> None:
    paths: list[Path] = []
    for _ in range(20):
        paths += recorded_at(BOOT, tmp_path, "gunnerus", (NOW - BOOT, timedelta(hours=-1)))
    assert sorted(path.name for path in paths) == [path.name for path in paths]
    assert max(len(path.name) for path in paths) < 80


@pytest.mark.parametrize(
    "name", ["x" * 300, "Ø" * 120, "🚢" * 90, "a/b", "..", "", " ", "con", "x\n\x1b[2J", "\udcff", "-rf"]
)
def test_no_name_of_a_trial_refuses_a_recording(tmp_path: Path, name: str) -> None:
    for year in (2026, 1970, 1970):
        (path,) = recorded_at(datetime(year, 5, 17, tzinfo=UTC), tmp_path, name)
        assert path.parent == tmp_path
        assert len(path.name.encode()) < 255
        assert path.name.isprintable()
    assert len(list(tmp_path.iterdir())) == 3


def test_long_names_that_begin_alike_stay_two_trials(tmp_path: Path) -> None:
    first, second = ("x" * 60 + letter for letter in "ab")
    recorded_at(NOW, tmp_path, first)
    recorded_at(NOW, tmp_path, second)
    assert len(recording_parts_in_folder(tmp_path, first)) == len(recording_parts_in_folder(tmp_path, second)) == 1


@pytest.mark.parametrize("error", [errno.ENAMETOOLONG, errno.EINVAL, errno.EILSEQ])
def test_a_file_system_that_refuses_a_name_gets_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: int
) -> None:
    touch = Path.touch

    def picky(path: Path, *arguments: object, **options: object) -> None:
        if "gunnerus" in path.name:
            raise OSError(error, os.strerror(error))
        touch(path, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "touch", picky)
    (path,) = recorded_at(NOW, tmp_path, "gunnerus")
    assert read_recording(path).trial.name == "gunnerus"


def test_recorders_that_start_at_once_in_one_folder_have_files_of_their_own(tmp_path: Path) -> None:
    recorders: list[Recorded] = []
    barrier = threading.Barrier(8)

    def begin() -> None:
        barrier.wait(PATIENCE_S)
        recorders.append(Recorded(tmp_path))

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for recorder in recorders:
        recorder.write(10)
        recorder.parts.close()
        recorder.assert_complete()
    assert len({recorder.parts.path for recorder in recorders}) == 8


def test_a_dangling_link_of_the_name_is_left_alone(tmp_path: Path) -> None:
    (first,) = recorded_at(NOW, tmp_path / "a", "gunnerus")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / first.name).symlink_to(tmp_path / "nowhere")
    (path,) = recorded_at(NOW, tmp_path / "b", "gunnerus")
    assert path.name != first.name
    assert not (tmp_path / "nowhere").exists()


# The disk: each function of the system fails, in each way


class FailingSystem:
    """``os`` as the recording sees it: the functions in ``failing`` raise."""

    NAMES = ("open", "fstat", "pwrite", "fdatasync", "fsync", "ftruncate", "statvfs")
    PATHS = ("touch", "mkdir", "unlink", "resolve")

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.failing: dict[str, BaseException] = {}
        for name in self.NAMES:
            patch.setattr(writer.os, name, self._wrapped(name, getattr(os, name)))
        patch.setattr(writer.os.path, "ismount", self._wrapped("ismount", os.path.ismount))
        for name in self.PATHS:
            patch.setattr(Path, name, self._wrapped(name, getattr(Path, name)))

    def _wrapped(self, name: str, function: Callable[..., object]) -> Callable[..., object]:
        def called(*arguments: object, **options: object) -> object:
            if name in self.failing:
                raise self.failing[name]
            return function(*arguments, **options)

        return called


@contextmanager
def failing_system() -> Iterator[FailingSystem]:
    with pytest.MonkeyPatch.context() as patch:
        yield FailingSystem(patch)


FAULTS = [
    OSError(number, os.strerror(number)) for number in (errno.EIO, errno.EACCES, errno.ENOTCONN, errno.EMFILE)
]
FAULTS_AND_MORE = [*FAULTS, MemoryError(), RuntimeError("can't start new thread")]


@pytest.mark.parametrize("name", [*FailingSystem.NAMES, *FailingSystem.PATHS, "ismount"])
@pytest.mark.parametrize("when", ["written", "split"])
def test_whatever_the_system_refuses_is_a_pause_at_most(tmp_path: Path, name: str, when: str) -> None:
    """While it is written, and at the change of parts; and once it works again, everything is there once."""
    with failing_system() as system:
        recorded = Recorded(tmp_path / "out")
        for number, fault in enumerate(FAULTS if name == "statvfs" else FAULTS_AND_MORE):
            begun_s = time.monotonic() + 1000.0 * (number + 1)
            recorded.write(20)
            recorded.parts.sync()
            system.failing = {name: fault}
            recorded.write(20)
            recorded.parts.flush()
            if when == "split":
                recorded.parts.begin_next_part("asked for")
            recorded.parts.sync()
            for second in range(3):
                recorded.parts.check_limits(begun_s + second)
                recorded.write(20)
            system.failing = {}
            recorded.parts.check_limits(begun_s + 10.0)
            recorded.write(20)
            assert not recorded.parts.paused, recorded.remarks
        recorded.parts.close()
    recorded.assert_complete()
    assert all(read_recording(path).closed for path in recorded.parts.paths)


@settings(max_examples=150)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["write", "flush", "sync", "sync_soon", "split", "tick", "work"]),
            st.frozensets(st.sampled_from([*FailingSystem.NAMES, *FailingSystem.PATHS]), max_size=4),
        ),
        max_size=25,
    )
)
def test_whatever_fails_in_whatever_order_every_value_is_recorded_once(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, frozenset[str]]]
) -> None:
    with failing_system() as system:
        recorded = Recorded(tmp_path_factory.mktemp("order"))
        actions: dict[str, Callable[[], object]] = {
            "write": lambda: recorded.write(5),
            "flush": recorded.parts.flush,
            "sync": recorded.parts.sync,
            "sync_soon": recorded.parts.sync_in_background,
            "split": lambda: recorded.parts.begin_next_part("asked for"),
            "tick": lambda: recorded.parts.check_limits(time.monotonic() + 1e6),
            "work": lambda: None,
        }
        for action, failing in steps:
            system.failing = {} if action == "work" else dict.fromkeys(failing, FAULTS[0])
            actions[action]()
        system.failing = {}
        recorded.parts.close()
    recorded.assert_complete()


@pytest.mark.parametrize("name", ["fsync", "fdatasync", "fstat"])
def test_a_folder_or_file_that_cannot_be_synced_leaves_no_descriptor_and_no_file_behind(
    tmp_path: Path, name: str
) -> None:
    recorded = Recorded(tmp_path)
    with failing_system() as system:
        before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        system.failing = {name: FAULTS[0]}
        recorded.parts.begin_next_part("asked for")
        recorded.parts.sync()
        for second in range(100):
            recorded.parts.check_limits(1e6 + second)
        assert len(os.listdir("/proc/self/fd")) <= before  # noqa: PTH208
        assert len(list(tmp_path.iterdir())) <= 2
    recorded.parts.close()


@pytest.mark.parametrize("error", [errno.EINVAL, errno.EACCES, errno.ENOTSUP])
def test_a_folder_that_no_program_can_sync_is_recorded_to_all_the_same(tmp_path: Path, error: int) -> None:
    with failing_system() as system:
        system.failing = {"fsync": OSError(error, os.strerror(error))}
        recorded = Recorded(tmp_path)
        recorded.write(20)
        recorded.parts.close()
    recorded.assert_complete()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: errno.errorcode[fault.errno])
@pytest.mark.parametrize("name", ["statvfs", "touch", "open", "mkdir", "fsync", "resolve"])
def test_a_disk_that_fails_at_the_start_is_one_error(tmp_path: Path, name: str, fault: OSError) -> None:
    with failing_system() as system:
        system.failing = {name: fault}
        with suppress(StorageError):  # one that names the folder; some functions it can do without
            recorded = Recorded(tmp_path / "out")
            recorded.parts.close()
            recorded.assert_complete()


def test_a_thread_is_missed_only_where_the_system_refused_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It starts with the first sync; before, as while a log file is read, none is missing."""
    recorded = Recorded(tmp_path)
    recorded.parts.check_limits(time.monotonic() + 100.0)
    assert not recorded.remarks

    def refuse(*arguments: object) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse)
        recorded.write(1)
        recorded.parts.sync_in_background()
        recorded.parts.check_limits(time.monotonic() + 200.0)
    recorded.write(1)
    recorded.parts.sync_in_background()
    recorded.parts.check_limits(time.monotonic() + 300.0)
    recorded.parts.close()
    assert ["gives no thread" in remark for remark in recorded.remarks] == [True, False], recorded.remarks


def test_a_listener_that_fails_costs_nothing_but_itself(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    received: list[str] = []

    def fail(topic: str, data: bytes, log_ns: int) -> None:
        raise ConnectionError("gone")

    recorded.parts.listeners += [fail, lambda topic, data, log_ns: received.append(topic)]
    recorded.write(10)
    recorded.parts.close()
    recorded.assert_complete()
    assert len(received) == 10
    assert len(recorded.remarks) == 1


# The process at work


SECONDS = pytest.mark.parametrize(
    ("seconds", "rate_hz"),
    [
        pytest.param(QUICK_S, QUICK_HZ, id="quick"),
        pytest.param(LONG_S, LONG_HZ, id="long", marks=pytest.mark.attack),
    ],
)
LONG = pytest.mark.attack


@SECONDS
@pytest.mark.parametrize(
    ("error", "calls"),
    [
        pytest.param(errno.EIO, ("stat", "lstat"), id="EIO on stat", marks=LONG),
        pytest.param(errno.EACCES, ("stat", "lstat", "open", "mkdir", "unlink"), id="EACCES", marks=LONG),
        pytest.param(errno.EIO, ("pwrite", "fdatasync", "ftruncate", "open"), id="EIO on writing", marks=LONG),
        pytest.param(errno.EROFS, ("open", "pwrite", "mkdir", "unlink"), id="read-only", marks=LONG),
        pytest.param(errno.EAGAIN, ("thread",), id="no threads"),
        pytest.param(errno.ENOTCONN, ("stat", "lstat", "statvfs", "open", "mkdir", "fstat", "pwrite", "fdatasync",
                                      "ftruncate", "fsync", "unlink", "scandir"), id="everything"),
    ],
)  # fmt: skip
def test_functions_of_the_system_that_fail_for_a_while_cost_nothing(
    tmp_path: Path, error: int, calls: tuple[str, ...], seconds: float, rate_hz: float
) -> None:
    folder = tmp_path / "out"
    with attacked(tmp_path, folder, rate_hz, SPLIT_S) as recorder:
        recorder.record(1.0)
        recorder.fail(error, *calls, folder=folder if "thread" not in calls and "fstat" not in calls else None)
        recorder.record(seconds)
        recorder.work()
        recorder.record(2.0)
        recorder.assert_complete()


@SECONDS
def test_without_descriptors_for_a_while_nothing_is_lost(tmp_path: Path, seconds: float, rate_hz: float) -> None:
    with attacked(tmp_path, tmp_path / "out", rate_hz, SPLIT_S) as recorder:
        recorder.record(1.0)
        with no_descriptors(recorder.process.pid):
            recorder.record(seconds)
        recorder.record(1.0)
        recorder.assert_complete()


@SECONDS
def test_a_limit_on_tasks_costs_nothing(tmp_path: Path, seconds: float, rate_hz: float) -> None:
    """As systemd's TasksMax: the system itself gives no thread."""
    with (
        control_group("pids") as group,
        attacked(tmp_path, tmp_path / "out", rate_hz, SPLIT_S) as recorder,
    ):
        (group / "cgroup.procs").write_text(str(recorder.process.pid))
        (group / "pids.max").write_text((group / "pids.current").read_text())
        recorder.record(seconds)
        (group / "pids.max").write_text("max")
        recorder.record(1.0)
        recorder.assert_complete()


def test_a_recorder_that_gets_no_thread_at_its_start_says_so(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="has ended") as ended:
        AttackedRecorder(tmp_path, tmp_path / "out", prefix=["env", "ATTACK_SWITCH=" + str(no_threads(tmp_path))])
    assert "the system gives no thread" in str(ended.value)
    assert "Traceback" not in str(ended.value)
    assert list((tmp_path / "out").iterdir()) == []


def no_threads(folder: Path) -> Path:
    switch = folder / "always"
    switch.write_text('{"error": 11, "calls": ["thread"], "folder": ""}')
    return switch


class Disk:
    """A disk at ``point`` that can go in one way, and come back."""

    def __init__(self, place: Path) -> None:
        self.point, self.store = place / "disk", place / "store"
        self.store.mkdir()
        self.point.mkdir()

    def mount(self) -> None: ...

    def go(self) -> None: ...

    def unmount(self) -> None:
        subprocess.run(["umount", "-l", self.point], capture_output=True, check=False)


class FuseDisk(Disk):
    """A file system in a process that is killed: what is open fails, and so does each look at a path."""

    def mount(self) -> None:
        require("bindfs", "umount")
        self.program = subprocess.Popen(["bindfs", "-f", self.store, self.point], stderr=subprocess.DEVNULL)
        until_s = time.monotonic() + 10.0
        while not self.point.is_mount():
            if time.monotonic() > until_s:
                pytest.skip("this machine has no FUSE")
            time.sleep(0.02)

    def go(self) -> None:
        self.program.kill()
        self.program.wait()

    def unmount(self) -> None:
        super().unmount()
        if self.program.poll() is None:
            self.go()


class KilledAndUnmounted(FuseDisk):
    """As the system does it after a disk was pulled: below is the root disk's folder."""

    def go(self) -> None:
        super().go()
        subprocess.run(["umount", "-l", self.point], capture_output=True, check=False)


class LazilyUnmounted(Disk):
    """``umount -l``: what is open can still be written to, the path belongs to the root disk."""

    def mount(self) -> None:
        if not self.store.is_mount():
            call("mount", "-t", "tmpfs", "tmpfs", self.store)
        call("mount", "--bind", self.store, self.point)

    def go(self) -> None:
        subprocess.run(["umount", "-l", self.point], capture_output=True, check=True)

    def unmount(self) -> None:
        super().unmount()
        subprocess.run(["umount", "-l", self.store], capture_output=True, check=False)


@SECONDS
@pytest.mark.parametrize(
    ("kind", "below"),
    [
        pytest.param(FuseDisk, False, id="FUSE killed", marks=LONG),
        pytest.param(FuseDisk, True, id="FUSE killed, in a folder", marks=LONG),
        pytest.param(KilledAndUnmounted, False, id="pulled", marks=LONG),
        pytest.param(KilledAndUnmounted, True, id="pulled, in a folder"),
        pytest.param(LazilyUnmounted, False, id="umount -l"),
        pytest.param(LazilyUnmounted, True, id="umount -l, in a folder", marks=LONG),
    ],
)
def test_a_disk_that_is_gone_for_a_while_costs_nothing(
    tmp_path: Path, kind: type[Disk], below: bool, seconds: float, rate_hz: float
) -> None:
    """Nothing is lost, and nothing is written to the root disk instead."""
    require("mount", "umount")
    disk = kind(tmp_path)
    folder = disk.point / "trials" if below else disk.point
    with ExitStack() as stack:
        disk.mount()
        stack.callback(disk.unmount)
        recorder = stack.enter_context(attacked(tmp_path, folder, rate_hz, SPLIT_S))
        recorder.record(1.0)
        disk.go()
        recorder.record(seconds)
        subprocess.run(["umount", "-l", disk.point], capture_output=True, check=False)
        assert list(disk.point.iterdir()) == [], "it was written to the root disk"
        disk.mount()
        recorder.record(2.0)
        recorder.assert_complete()
        assert "RECORDING PAUSED" in recorder.log


@pytest.mark.attack
def test_a_disk_that_hangs_for_a_while_costs_nothing(tmp_path: Path) -> None:
    """As a network's: each call waits until it answers again."""
    require("umount")
    disk = FuseDisk(tmp_path)
    with ExitStack() as stack:
        disk.mount()
        stack.callback(disk.unmount)
        recorder = stack.enter_context(attacked(tmp_path, disk.point / "out", LONG_HZ, SPLIT_S))
        recorder.record(1.0)
        disk.program.send_signal(signal.SIGSTOP)
        recorder.record(8.0)
        disk.program.send_signal(signal.SIGCONT)
        recorder.record(2.0)
        recorder.assert_complete()


@pytest.mark.attack
def test_what_fits_neither_disk_nor_memory_is_counted(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with attacked(tmp_path, folder, LONG_HZ, "queue_frames = 500") as recorder:
        recorder.record(1.0)
        recorder.fail(errno.EIO, "pwrite", "fdatasync", "open")
        recorder.record(4.0)
        recorder.work()
        recorder.record(2.0)
        paths = recorder.end()
    numbers = numbers_in(paths)
    health = [entry.decode_body() for path in paths for entry in MessageStream(path) if entry.topic == HEALTH_TOPIC]
    dropped = max(message["dropped"] for message in health if message["source"] == "line")
    assert numbers == sorted(set(numbers))
    assert dropped > 0
    assert len(numbers) + dropped == recorder.line.sent


@SECONDS
def test_a_disk_that_fills_and_empties_costs_nothing(tmp_path: Path, seconds: float, rate_hz: float) -> None:
    disk = tmp_path / "disk"
    with (
        mounted(disk, "-t", "tmpfs", "-o", "size=2m", "tmpfs"),
        attacked(tmp_path, disk / "out", rate_hz, SPLIT_S) as recorder,
    ):
        recorder.record(1.0)
        subprocess.run(["dd", "if=/dev/zero", f"of={disk}/fill", "bs=4k"], capture_output=True, check=False)
        recorder.record(seconds)
        (disk / "fill").unlink()
        recorder.record(2.0)
        recorder.assert_complete()


def test_permissions_taken_away_for_a_while_cost_nothing(tmp_path: Path) -> None:
    """For a user without privileges, by the system itself."""
    require("setpriv")
    folder = tmp_path / "out"
    prefix = ["setpriv", "--inh-caps=-all", "--bounding-set=-all"]
    with attacked(tmp_path, folder, QUICK_HZ, SPLIT_S, prefix) as recorder:
        recorder.record(1.0)
        folder.chmod(0)
        recorder.record(3.0)
        folder.chmod(0o755)
        recorder.record(1.5)
        recorder.assert_complete()


@pytest.mark.attack
@pytest.mark.parametrize("victim", ["the part", "all parts", "the folder", "the part, renamed"])
def test_files_taken_away_under_a_recorder_cost_nothing_of_what_comes(tmp_path: Path, victim: str) -> None:
    folder, aside = tmp_path / "out", tmp_path / "aside.mcap"
    with attacked(tmp_path, folder) as recorder:
        recorder.record(1.5)
        (path,) = folder.glob("*.mcap")
        if victim == "the folder":
            shutil.rmtree(folder)
        elif victim == "the part, renamed":
            path.rename(aside)
        else:
            path.unlink()
        recorder.record(3.0)
        if victim == "the part, renamed":
            recorder.end()
            assert read_recording(aside).closed
        else:
            recorder.assert_complete()


@pytest.mark.attack
@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_a_recorder_that_is_stopped_and_goes_on_loses_nothing_of_a_line_that_waits(
    tmp_path: Path, seconds: float
) -> None:
    with attacked(tmp_path, tmp_path / "out") as recorder:
        recorder.record(1.0)
        recorder.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        recorder.process.send_signal(signal.SIGCONT)
        recorder.record(1.0)
        recorder.assert_complete()


@pytest.mark.attack
def test_a_limit_of_memory_that_is_enough_for_the_budget_ends_nothing(tmp_path: Path) -> None:
    """600 MB in a control group, with the disk away: what waits must fit into that."""
    with (
        control_group("memory") as group,
        attacked(tmp_path, tmp_path / "out", LONG_HZ, SPLIT_S) as recorder,
    ):
        (group / "memory.limit_in_bytes").write_text(str(600_000_000))
        (group / "cgroup.procs").write_text(str(recorder.process.pid))
        recorder.fail(errno.EIO, "open", "pwrite", "fdatasync", folder=tmp_path / "out")
        recorder.record(20.0)
        recorder.work()
        recorder.record(3.0)
        recorder.assert_complete()


# The folder of the copies


@pytest.mark.parametrize(
    "state",
    [
        pytest.param("gone", id="gone"),
        pytest.param("full", id="full", marks=pytest.mark.attack),
        pytest.param("failing", id="failing", marks=pytest.mark.attack),
        pytest.param("unmounted", id="unmounted", marks=pytest.mark.attack),
        pytest.param("a file", id="a file", marks=pytest.mark.attack),
    ],
)
def test_a_folder_for_copies_that_fails_costs_the_recording_nothing(tmp_path: Path, state: str) -> None:
    copies, folder = tmp_path / "copies", tmp_path / "out"
    copies.mkdir()
    with ExitStack() as stack:
        if state in ("full", "unmounted"):
            stack.enter_context(mounted(copies, "-t", "tmpfs", "-o", "size=100k", "tmpfs"))
        if state == "full":
            (copies / "fill").write_bytes(bytes(90_000))
        section = f'[copies]\nfolder = "{copies}"\n'
        recorder = stack.enter_context(attacked(tmp_path, folder, 500.0, SPLIT_S, sections=section))
        if state == "unmounted":
            subprocess.run(["umount", "-l", copies], check=True)
        elif state in ("gone", "a file"):
            copies.rmdir()
        if state == "a file":
            copies.write_bytes(b"")
        if state == "failing":
            recorder.fail(errno.EIO, "open", "fsync", "stat", "statvfs", folder=copies)
        recorder.wait_for(lambda: "no copies for now" in recorder.log)
        recorder.assert_complete()
        if state == "unmounted":
            assert list(copies.iterdir()) == [], "copied to the root disk"


# The start and the end


@pytest.mark.parametrize(
    "after_s",
    [1.0, *(pytest.param(0.1 * tenths, marks=pytest.mark.attack) for tenths in range(16))],
)
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.attack)], ids=["SIGTERM", "SIGINT"]
)
def test_a_signal_at_any_stage_of_the_start_leaves_nothing_half_done(
    tmp_path: Path, number: signal.Signals, after_s: float
) -> None:
    """Before Python itself can answer, the system ends the process; then nothing has been made."""
    configuration, log = tmp_path / "trial.toml", tmp_path / "log"
    configuration.write_text(
        '[trial]\nname = "start"\n[[source]]\nname = "line"\nchannels = ["heading_deg"]\ntype = "tcp"\nport = 9\n'
    )
    with log.open("wb") as errors:
        process = start(
            [sys.executable, "-m", "seatrial", "record", configuration, "-o", tmp_path / "out"], err=errors.fileno()
        )
        time.sleep(after_s)
        process.send_signal(number)
        code = process.wait(PATIENCE_S)
    text = log.read_text()
    assert code in (0, 1, 130, -number), text
    if code != -number and code != 130:  # else it was still Python's own start
        assert "Traceback" not in text
    assert all(read_recording(path).closed for path in (tmp_path / "out").glob("*"))
