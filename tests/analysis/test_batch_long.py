"""The long proof: a batch of 200 recordings, ten of them broken, on workers that die and on another's cluster."""

from __future__ import annotations

import json
import signal
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.analysis.small_batch import BROKEN, cluster, hashes, sailed, write_batch, write_broken
from tests.analysis.test_batch import start_command, wait_for_results

SOUND = 190


@pytest.fixture(scope="module")
def batch_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    tables = [sailed(90, 1.0, seed, yaw_rate_dps=seed / 4.0) for seed in range(10)]
    paths = write_batch(folder, tables, SOUND)
    write_broken(folder / "broken", paths[0])
    return folder


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

    with cluster(workers=2) as address:
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
