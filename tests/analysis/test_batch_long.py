"""The long proof: a batch of 200 recordings, ten of them broken, on workers that die and on another's cluster."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.analysis.small_batch import BROKEN, hashes, sailed, write_batch, write_broken
from tests.analysis.test_batch import start_command, wait_for_results

SOUND = 190


@pytest.fixture(scope="module")
def batch_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    tables = [sailed(90, 1.0, seed, yaw_rate_dps=seed / 4.0) for seed in range(10)]
    paths = write_batch(folder, tables, SOUND)
    write_broken(folder / "broken", paths[0])
    return folder


@contextmanager
def ended(*processes: subprocess.Popen[str]) -> Iterator[None]:
    """Ends processes of ours, whatever happens."""
    try:
        yield
    finally:
        for process in reversed(processes):
            process.terminate()
            process.communicate(timeout=30)


def _dask(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", f"distributed.cli.dask_{arguments[0]}", *arguments[1:], "--no-dashboard"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)


def _address(scheduler: subprocess.Popen[str]) -> str:
    """The address that a scheduler prints."""
    assert scheduler.stderr is not None
    for line in scheduler.stderr:
        if found := re.search(r"Scheduler at:\s+(tcp://\S+)", line):
            return found[1]
    raise AssertionError("the scheduler said no address")


@pytest.mark.slow
def test_a_batch_survives_its_workers_and_is_the_same_on_a_real_cluster(batch_folder: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "own", tmp_path / "cluster"
    running = start_command(batch_folder, first, "--workers", "2", "--json")
    for count in (20, 60):  # twice in mid-run
        wait_for_results(first, count, 300.0)
        _one_worker_of(running.pid).send_signal(signal.SIGKILL)
    printed, said = running.communicate(timeout=600)
    summary = json.loads(printed)
    assert summary["recordings"] == SOUND + len(BROKEN), said.decode()
    assert SOUND <= summary["done"] <= SOUND + 1  # what was cut off between two chunks is read as far as it goes
    assert summary["done"] + summary["failed"] == summary["recordings"]
    assert len(list(first.rglob("summary.json"))) == len({*first.rglob("summary.json")}) >= SOUND

    scheduler = _dask("scheduler", "--host", "127.0.0.1", "--port", "0")
    with ended(scheduler):
        address = _address(scheduler)
        workers = [_dask("worker", address, "--nthreads", "1") for _ in range(2)]
        with ended(*workers):
            remote = start_command(batch_folder, second, "--scheduler", address, "--json")
            printed, said = remote.communicate(timeout=600)
    assert json.loads(printed)["done"] == summary["done"], said.decode()
    assert hashes(first) == hashes(second)


def _one_worker_of(pid: int) -> Any:
    """A worker process of the command: a child that was spawned to work."""
    psutil, until = import_module("psutil"), time.monotonic() + 30.0
    while time.monotonic() < until:
        children = psutil.Process(pid).children(recursive=True)
        spawned = [each for each in children if "spawn_main" in " ".join(each.cmdline())]
        if spawned:
            return spawned[0]
        time.sleep(0.1)
    raise AssertionError("no worker")
