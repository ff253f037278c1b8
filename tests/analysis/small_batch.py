"""A batch of small recordings to run a batch over, sound ones and broken ones."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
from mcap.reader import make_reader

from seatrial.acquisition.core.ship import NAMES, wrap_360
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.products import Options
from tests.analysis.conftest import table_at

QUICK = Options(smooth=False, pictures=False)
"""For tests of what is around the analysis: without the steps that take most of the time."""


def sailed(seconds: int = 120, rate_hz: float = 2.0, seed: int = 0, yaw_rate_dps: float = 1.0) -> pd.DataFrame:
    """All 13 channels of a ship that turns at 3 m/s with held thrusters, consistent up to white noise."""
    random = np.random.default_rng(seed)
    time_s = np.arange(int(seconds * rate_hz)) / rate_hz
    heading = np.radians(350.0 + yaw_rate_dps * time_s)
    step = 3.0 / rate_hz

    def noise(size: float) -> np.ndarray:
        return size * random.standard_normal(time_s.size)

    values = {
        "north_m": step * np.cumsum(np.cos(heading)) + noise(0.02),
        "east_m": step * np.cumsum(np.sin(heading)) + noise(0.02),
        "heading_deg": wrap_360(np.degrees(heading) + noise(0.05)),
        "surge_mps": 3.0 + noise(0.01),
        "sway_mps": noise(0.01),
        "yaw_rate_dps": yaw_rate_dps + noise(0.02),
        "wind_direction_deg": wrap_360(358.0 + noise(3.0)),
        "wind_speed_mps": 5.0 + noise(0.2),
        "port_rpm": 120.0 + noise(0.1),
        "port_angle_deg": -5.0 + noise(0.02),
        "starboard_rpm": 120.0 + noise(0.1),
        "starboard_angle_deg": -5.0 + noise(0.02),
        "tunnel_rpm": noise(0.1),
    }
    return table_at(time_s, {name: values[name] for name in NAMES})


def write_batch(folder: Path, tables: list[pd.DataFrame], count: int) -> list[Path]:
    """``count`` recordings below ``folder``, in a folder a day of eight, each with its own trial."""
    paths = []
    for number in range(count):
        path = folder / f"day_{number // 8 + 1:02d}" / f"trial_{number + 1:03d}.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        trial = Trial(name=f"trial {number + 1}", vessel="gunnerus_short", place="Trondheimsfjord")
        write_table(tables[number % len(tables)], path, trial, source="simulated")
        paths.append(path)
    return paths


def _text(path: Path, sound: Path) -> None:
    path.write_text("time,heading_deg\n2022-10-27T08:00:00Z,351.2\n")


def _cut(path: Path, sound: Path) -> None:
    content = sound.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def _only(names: tuple[str, ...]) -> Callable[[Path, Path], None]:
    def write(path: Path, sound: Path) -> None:
        write_table(sailed()[list(names)], path, Trial(name=path.stem))

    return write


def _heading_of_nan(path: Path, sound: Path) -> None:
    write_table(sailed().assign(heading_deg=np.nan), path, Trial(name=path.stem))


def _wrong_magic(path: Path, sound: Path) -> None:
    path.write_bytes(b"\x89MCAP1" + sound.read_bytes()[6:])


def _damaged_chunk(path: Path, sound: Path) -> None:
    content = bytearray(sound.read_bytes())
    with sound.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[0]
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    content[middle : middle + 200] = bytes(each ^ 0x5A for each in content[middle : middle + 200])
    path.write_bytes(content)


BROKEN: dict[str, Callable[[Path, Path], object]] = {
    "empty": lambda path, sound: path.write_bytes(b""),
    "text": _text,
    "cut": _cut,
    "no_channels": _only(()),
    "no_position": _only(tuple(name for name in NAMES if name not in ("north_m", "east_m"))),
    "heading_of_nan": _heading_of_nan,
    "one_channel": _only(("wind_speed_mps",)),
    "wrong_magic": _wrong_magic,
    "folder": lambda path, sound: path.mkdir(),
    "damaged_chunk": _damaged_chunk,
}
"""Ten ways in which a recording can be broken, each made from a sound one."""


def write_broken(folder: Path, sound: Path) -> None:
    """One file below ``folder`` for each of :data:`BROKEN`, called by it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in BROKEN.items():
        make(folder / f"{name}.mcap", sound)


def hashes(out: Path) -> dict[str, str]:
    """The SHA-256 of every file below a folder, by its relative path."""
    return {
        path.relative_to(out).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(out.rglob("*"))
        if path.is_file()
    }


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


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """The address of a dask scheduler with workers, processes of their own, as on several machines."""
    scheduler = _dask("scheduler", "--host", "127.0.0.1", "--port", "0")
    with ended(scheduler):
        address = _address(scheduler)
        with ended(*(_dask("worker", address, "--nthreads", "1") for _ in range(workers))):
            with import_module("distributed").Client(address) as client:
                client.wait_for_workers(workers, timeout=300.0)
            yield address


@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """The address of a cluster of worker processes that several batches share."""
    with import_module("distributed").LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs="CRITICAL",
    ) as shared:
        yield shared.scheduler_address
