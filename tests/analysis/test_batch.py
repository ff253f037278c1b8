"""A batch: every recording gets its row, whatever happens to the others, to a worker or to the batch itself."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.errors import DataShortageError, InputError, SourceError, StorageError
from seatrial.analysis import batch
from seatrial.analysis.batch import (
    MARKS,
    MOST_ATTEMPTS,
    NOT_CLOSED,
    BatchJob,
    BatchSummary,
    Row,
    process_job,
    process_recording,
    read_index,
    recordings_below,
    result_names,
    run_batch,
)
from seatrial.analysis.products import Options
from tests.acquisition.conftest import PATIENCE_S
from tests.analysis.small_batch import BROKEN, QUICK, hashes, local_cluster, sailed, write_batch, write_broken
from tests.conftest import nightly

SOUND = 6
FAST = ("--no-smooth", "--no-pictures")


@pytest.fixture(scope="module")
def batch_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six sound recordings and the ten broken ones."""
    folder = tmp_path_factory.mktemp("batch")
    paths = write_batch(folder, [sailed(60, 1.0, seed, yaw_rate_dps=seed - 1.0) for seed in range(3)], SOUND)
    write_broken(folder / "broken", paths[0])
    return folder


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster of two worker processes."""
    with local_cluster(workers=2) as address:
        yield address


@pytest.fixture(scope="module")
def first_run(
    batch_folder: Path, scheduler: str, tmp_path_factory: pytest.TempPathFactory
) -> tuple[BatchSummary, Path]:
    out = tmp_path_factory.mktemp("out")
    return run_batch(batch_folder, out, scheduler=scheduler, options=QUICK), out


@pytest.fixture
def one(batch_folder: Path, tmp_path: Path) -> Path:
    """A folder with one sound recording, to go wrong with."""
    folder = tmp_path / "in"
    folder.mkdir()
    shutil.copy(batch_folder / "day_01" / "trial_001.mcap", folder)
    return folder


def by_name(summary: BatchSummary) -> dict[str, Row]:
    return {row["name"]: row for row in summary.rows}


def test_the_sound_are_done_and_the_broken_are_explained(first_run: tuple[BatchSummary, Path]) -> None:
    summary, out = first_run
    rows = by_name(summary)
    assert len(rows) == SOUND + len(BROKEN)
    assert {f"day_01/trial_{number + 1:03d}" for number in range(SOUND)} <= {
        name for name, row in rows.items() if row["status"] == "done" and not row["cause"]
    }
    for name in BROKEN:
        row = rows[f"broken/{name}"]
        assert row["status"] == "failed" or (name == "cut" and row["cause"] == NOT_CLOSED)
        assert row["cause"]
        assert "\n" not in row["cause"]
    words = {
        "empty": "is empty", "text": "not an MCAP", "no_channels": "holds no channel",
        "one_channel": "has no north_m",
        "no_position": "has no north_m, east_m", "heading_of_nan": "has no heading_deg", "folder": "is a folder",
        "wrong_magic": "not an MCAP", "damaged_chunk": "damaged",
    }  # fmt: skip
    assert {name: word for name, word in words.items() if word not in rows[f"broken/{name}"]["cause"]} == {}
    assert sorted(name for _, names in summary.failures for name in names) == sorted(
        name for name, row in rows.items() if row["status"] == "failed"
    )
    assert not list(out.rglob(".*"))


def test_the_index_has_a_row_for_each_with_its_path(
    first_run: tuple[BatchSummary, Path], batch_folder: Path
) -> None:
    summary, out = first_run
    index = read_index(out / "index.parquet")
    assert list(index["name"]) == [row["name"] for row in summary.rows]
    assert all((batch_folder / path).exists() for path in index["path"])
    done = index[index["status"] == "done"]
    assert (done["windows_kept"] >= 0).all()
    assert done["sha256"].str.len().eq(64).all()


def test_a_second_run_computes_nothing_and_changes_nothing(
    batch_folder: Path, scheduler: str, first_run: tuple[BatchSummary, Path]
) -> None:
    first, out = first_run
    before, times = hashes(out), {path: path.stat().st_mtime_ns for path in out.rglob("table.parquet")}
    shares: list[float] = []
    second = run_batch(batch_folder, out, scheduler=scheduler, options=QUICK, progress=shares.append)
    assert (second.done, second.reused) == (first.done, first.done)
    assert hashes(out) == before
    touched = {path for path, at in times.items() if path.stat().st_mtime_ns != at}
    assert touched == set()
    assert shares == sorted(shares)
    assert (len(shares), shares[-1]) == (len(second.rows), 1.0)


def test_what_was_made_by_a_worker_has_the_bytes_of_what_is_made_here(
    batch_folder: Path, first_run: tuple[BatchSummary, Path], tmp_path: Path
) -> None:
    name = "day_01/trial_002"
    process_recording(batch_folder / f"{name}.mcap", tmp_path / "result", QUICK, name)
    assert hashes(tmp_path / "result") == hashes(first_run[1] / name)


def test_other_options_and_again_compute_anew(one: Path, scheduler: str, tmp_path: Path) -> None:
    def reused(stride_s: int, again: bool = False) -> int:
        options = replace(QUICK, stride_s=stride_s)
        return run_batch(one, tmp_path / "out", scheduler=scheduler, options=options, again=again).reused

    assert [reused(5), reused(7), reused(7), reused(7, again=True)] == [0, 0, 1, 0]


def test_a_recording_that_has_become_bad_loses_its_result(one: Path, scheduler: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run_batch(one, out, scheduler=scheduler, options=QUICK).done == 1
    (one / "trial_001.mcap").write_bytes(b"")
    assert run_batch(one, out, scheduler=scheduler, options=QUICK).failed == 1
    assert not (out / "trial_001").exists()


def test_a_result_whose_recording_is_gone_stays_and_the_index_says_so(
    one: Path, scheduler: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copy(one / "trial_001.mcap", one / "again.mcap")
    run_batch(one, out, scheduler=scheduler, options=QUICK)
    (one / "again.mcap").unlink()
    summary = run_batch(one, out, scheduler=scheduler, options=QUICK)
    assert ([row["name"] for row in summary.rows], summary.gone) == (["trial_001"], ("again",))
    index = read_index(out / "index.parquet").set_index("name")
    assert dict(index["status"]) == {"trial_001": "done", "again": "gone"}
    assert (out / "again" / "page.html").is_file()


def _troubled(job: BatchJob) -> Row:
    """An attempt in which 1 kills its worker once, 2 always, 3 surprises, 4 hangs; the others are light work."""
    from seatrial.analysis import batch

    once, last = Path(job.out).parent / "died_once", job.name[-1]

    def work(path: Path, folder: Path, options: Options, name: str, later: tuple[Path, ...]) -> Row:
        if last == "2" or (last == "1" and not once.exists()):
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if last == "3":
            raise RuntimeError(f"never {name}\nseen")
        if last == "4":
            time.sleep(600.0)
        folder.mkdir(exist_ok=True)  # a result that was lost with its worker is computed again
        return {"status": "done", "cause": ""}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "process_recording", work)
        return process_job(replace(job, timeout_s=1.0 if last == "4" else None))


@pytest.mark.parametrize("numbers", ["135", *nightly("123456")])
def test_whatever_a_recording_does_to_its_worker_is_one_row_and_the_others_are_done(
    batch_folder: Path, scheduler: str, tmp_path: Path, numbers: str
) -> None:
    (tmp_path / "in").mkdir()
    for number in numbers:
        shutil.copy(batch_folder / "day_01" / f"trial_00{number}.mcap", tmp_path / "in")
    summary = run_batch(tmp_path / "in", tmp_path / "out", scheduler=scheduler, task=_troubled)
    causes = {row["name"][-1]: row["cause"] for row in summary.rows}
    failures = {
        "2": f"its worker died {MOST_ATTEMPTS} times", "3": "RuntimeError: never trial_003 seen",
        "4": "took longer than 1 s",
    }  # fmt: skip
    assert causes.keys() == set(numbers)
    assert {number for number, cause in causes.items() if cause} == failures.keys() & causes.keys()
    assert all(failures[number] in cause for number, cause in causes.items() if cause)
    assert summary.failed == len(summary.failures) == len(failures.keys() & causes.keys())


def test_a_recording_that_killed_its_worker_too_often_or_hung_is_not_tried_again(tmp_path: Path) -> None:
    (tmp_path / MARKS).mkdir()
    for timeout_s, cause in ((None, f"its worker died {MOST_ATTEMPTS} times"), (0.0, "took longer than 0 s")):
        job = BatchJob("trial", str(tmp_path / "trial.mcap"), str(tmp_path), QUICK, timeout_s=timeout_s)
        job.attempts_file.write_bytes(b"." * MOST_ATTEMPTS)
        row = process_job(job)
        assert (row["name"], row["status"]) == ("trial", "failed")
        assert cause in row["cause"]


def test_a_process_whose_time_is_up_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever its threads do; one that is done before goes on."""
    ended = threading.Event()
    monkeypatch.setattr(os, "_exit", lambda code: ended.set())
    with batch._time_limit(600.0):
        pass
    with batch._time_limit(0.0):
        assert ended.wait(PATIENCE_S)


def test_no_scheduler_is_one_error_soon(one: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert batch._CONNECT_S <= 10  # what is waited for an answer
    monkeypatch.setattr(batch, "_CONNECT_S", 1)
    with pytest.raises(SourceError, match="no scheduler can be reached") as caught:
        run_batch(one, tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("address", ["nonsense", "", "foo://x:1", "tcp://host", "tcp://host:port"])
def test_an_address_that_is_none_is_one_error_at_once(one: Path, tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="not the address of a scheduler"):
        run_batch(one, tmp_path / "out", scheduler=address)
    assert not (tmp_path / "out").exists()


def test_an_output_that_cannot_be_written_is_one_error(one: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(StorageError):
            run_batch(one, out)


def test_two_batches_do_not_write_into_one_folder(one: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with (out / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(StorageError, match="another command"):
            run_batch(one, out)


def test_folders_that_cannot_be_are_refused(one: Path, tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    with pytest.raises(DataShortageError, match="no recording"):
        run_batch(tmp_path / "bare", tmp_path / "out")
    with pytest.raises(InputError, match="does not exist"):
        run_batch(tmp_path / "nowhere", tmp_path / "out")
    with pytest.raises(InputError, match="is no folder"):
        run_batch(one / "trial_001.mcap", tmp_path / "out")
    with pytest.raises(InputError, match="are in the output folder"):
        run_batch(one, tmp_path)


def test_what_lies_in_the_output_folder_is_no_recording_of_the_batch(one: Path) -> None:
    (one / "out" / "x").mkdir(parents=True)
    (one / "out" / "x" / "left.mcap").touch()
    (one / ".trial_009.mcap").touch()
    assert [paths[0].stem for paths in recordings_below(one, (one / "out").resolve())] == ["trial_001"]


_PART = st.text("ab._", min_size=1, max_size=4).filter(lambda part: set(part) != {"."})
_PATH = st.lists(_PART, min_size=1, max_size=3).map(lambda parts: "/".join(parts) + ".mcap")


@given(st.lists(_PATH, unique=True, max_size=12))
def test_no_result_stands_where_another_stands_or_inside_it(paths: list[str]) -> None:
    reserved = ("index.html.mcap", f"{MARKS}.mcap")
    names = result_names(Path(), [[Path(path)] for path in (*paths, *reserved)])
    assert len(set(names)) == len(names)
    parents = {parent.as_posix() for name in names for parent in Path(name).parents}
    assert not (set(names) & (parents | {"index.html", "index.parquet", MARKS, ".lock"}))


def test_the_command_prints_the_summary_and_fails_if_any_failed(one: Path, scheduler: str, tmp_path: Path) -> None:
    (one / "empty.mcap").touch()
    arguments = ["batch", str(one), "-o", str(tmp_path / "out"), "--scheduler", scheduler, *FAST, "--json"]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 1
    assert json.loads(outcome.stdout) == {
        "recordings": 2, "done": 1, "reused": 0, "failed": 1,
        "failures": [{"cause": "is empty; give a recording with data", "recordings": ["empty"]}],
        "gone": [],
        "index": str(tmp_path / "out" / "index.html"),
    }  # fmt: skip
    planned, failed, *_ = outcome.stderr.splitlines()
    assert planned.startswith("2 recordings, ")
    assert failed.startswith("1 failed: is empty")


def start_command(folder: Path, out: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """The command in a process group of its own, as a terminal has it."""
    command = [sys.executable, "-m", "seatrial", "batch", str(folder), "-o", str(out), *FAST, *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, preexec_fn=_hear_interrupts
    )


def _hear_interrupts() -> None:
    """A suite that a shell runs in the background is deaf to SIGINT, and so is what it starts."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def wait_for_results(out: Path, count: int, limit_s: float = PATIENCE_S) -> None:
    """Until so many results are complete."""
    until = time.monotonic() + limit_s
    while len(list(out.rglob("summary.json"))) < count:
        assert time.monotonic() < until, "no result in time"
        time.sleep(0.05)


def _stopped(out: Path, running: subprocess.Popen[bytes], number: int, whole_group: bool) -> list[str]:
    """Stop a command after its first result; the lines that it said after that of what it planned."""
    wait_for_results(out, len(list(out.rglob("summary.json"))) + 1)
    (os.killpg if whole_group else os.kill)(running.pid, number)
    _, said = running.communicate(timeout=PATIENCE_S)
    return said.decode().splitlines()[1:]


TERMINATED = ["seatrial: terminated; what is done stays, the same command goes on from there"]


def test_sigterm_to_all_of_it_ends_it_as_cleanly_as_an_interrupt(batch_folder: Path, tmp_path: Path) -> None:
    """The workers are told as well, as systemd does."""
    running = start_command(batch_folder, tmp_path / "out", "--workers", "1")
    assert _stopped(tmp_path / "out", running, signal.SIGTERM, whole_group=True) == TERMINATED
    assert running.returncode == 143
    assert not list((tmp_path / "out").rglob(".*.part"))


@pytest.mark.attack
def test_stopped_twice_and_resumed_is_as_never_stopped(
    batch_folder: Path, scheduler: str, first_run: tuple[BatchSummary, Path], tmp_path: Path
) -> None:
    """By SIGTERM to the command alone, then by an interrupt from the terminal."""
    out = tmp_path / "out"
    running = start_command(batch_folder, out, "--workers", "1")
    assert _stopped(out, running, signal.SIGTERM, whole_group=False) == TERMINATED
    assert running.returncode == 143
    assert not list(out.rglob(".*.part"))
    running = start_command(batch_folder, out, "--workers", "1")
    said = _stopped(out, running, signal.SIGINT, whole_group=True)  # the workers hear it too, as from a terminal
    assert said == ["seatrial: interrupted; what is done stays, the same command goes on from there"]
    assert running.returncode == 130
    assert not (out / "index.html").exists()
    arguments = ["batch", str(batch_folder), "-o", str(out), "--scheduler", scheduler, *FAST, "--json"]
    resumed = json.loads(CliRunner().invoke(app, arguments).stdout)
    assert 0 < resumed["reused"] < resumed["done"]
    assert hashes(out) == hashes(first_run[1])
