"""The twin as a process beside a recorder: what is in the recording, and that it can do the recorder no harm."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.emulator import emulate
from seatrial.acquisition.logger.health import describe_schema_violation
from seatrial.acquisition.recording.messages import PREDICTION
from seatrial.acquisition.recording.reader import MessageStream, describe_recording, read_recording
from seatrial.analysis.tables.resample import resample_recording
from tests.acquisition.conftest import PATIENCE_S, config_text, free_port, wait_for
from tests.conftest import Command
from tests.hybrid.twin.steady_ship import write_steady

ROOT = Path(__file__).parents[3]
HORIZON_S = 3


class Aboard:
    """A recorder, twins and the ship's instruments, each a process or a thread of its own."""

    def __init__(self, folder: Path, more: str = "") -> None:
        self.folder, self.config, self.plan = folder, folder / "trial.toml", folder / "plan.csv"
        section = f'type = "udp"\nport = {free_port()}\n'
        self.config.write_text(config_text(section, clock="receiver") + more)
        self.processes: list[subprocess.Popen[str]] = []

    def start(self, name: str, *words: str) -> subprocess.Popen[str]:
        """Start a command on the configuration; its stderr goes to a file of that name."""
        command, *options = words
        with (self.folder / name).open("w") as errors:
            process = subprocess.Popen(
                [sys.executable, str(ROOT / "seatrial.py"), command, str(self.config), *options],
                stdout=subprocess.PIPE, stderr=errors, text=True, cwd=ROOT,
                env={**os.environ, "SEATRIAL_RUNTIME": str(self.folder / "run"), "PYTHONPATH": str(ROOT)},
            )  # fmt: skip
        self.processes.append(process)
        return process

    def record(self, name: str = "recorder") -> subprocess.Popen[str]:
        process = self.start(name, "record", "-o", str(self.folder / "out"))
        self.wait_for_log(name, "recording to")
        return process

    def watch(self, name: str = "twin") -> subprocess.Popen[str]:
        return self.start(name, "watch", "--horizon", str(HORIZON_S), "--commands", str(self.plan), "--json")

    def log(self, name: str) -> str:
        return (self.folder / name).read_text()

    def wait_for_log(self, name: str, text: str) -> None:
        wait_for(lambda: text in self.log(name))

    def sail(self, duration_s: float) -> tuple[threading.Thread, Counter[str]]:
        """Play a steady voyage in a thread; what was sent by channel is known when it has ended."""
        write_steady(self.folder / "voyage.mcap", duration_s)
        sent: Counter[str] = Counter()
        played = threading.Thread(
            target=lambda: sent.update(emulate(self.folder / "voyage.mcap", load_config(self.config)).counts)
        )
        played.start()
        return played, sent

    def end(self, process: subprocess.Popen[str]) -> str:
        """End a process as a person would; what it said on stdout."""
        process.send_signal(signal.SIGTERM)
        stdout, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
        return stdout


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    ship = Aboard(tmp_path)
    yield ship
    for process in ship.processes:
        process.kill()
        process.communicate()


def first_part(log: str) -> str:
    """The name of the file that a recorder says it begins with."""
    return Path(log.partition("recording to ")[2].split()[0]).name


def predictions_in(path: Path) -> list[tuple[int, dict[str, Any]]]:
    return [(each.log_ns, each.decode_body()) for each in MessageStream(path) if each.topic == "/prediction"]


def recorded(paths: list[Path]) -> dict[str, int]:
    counts: Counter[str] = Counter()
    for path in paths:
        counts.update({name: each.value.size for name, each in read_recording(path).series.items()})
    return counts


def test_predictions_and_their_errors_are_recorded_and_no_sample_is_lost(aboard: Aboard, tmp_path: Path) -> None:
    """One twin that is there before the recorder and is stopped for a while, another that is killed; a plan of
    what is done anyhow comes in between.
    """
    twin = aboard.watch()
    aboard.wait_for_log("twin", "no recorder of the trial 'round trip' runs here; waiting for one")
    killed = aboard.watch("killed")
    recorder = aboard.record()
    aboard.wait_for_log("twin", "following")  # and ready to predict
    aboard.wait_for_log("killed", "following")
    playing, sent = aboard.sail(10.0)
    aboard.wait_for_log("twin", "predicting")
    aboard.wait_for_log("killed", "predicting")
    killed.kill()
    aboard.plan.write_text("time,port_rpm\n2026-06-01T08:00:00Z,140\n2100-01-01T00:00:00Z,0\n")
    aboard.wait_for_log("twin", "plan of port_rpm: 2 orders")
    twin.send_signal(signal.SIGSTOP)
    time.sleep(2.0)
    (path,) = (tmp_path / "out").glob("*.mcap")
    others = len(predictions_in(path))
    twin.send_signal(signal.SIGCONT)
    playing.join()
    while (own := predictions_in(path)[others:])[5:] == [] or not any("error" in body for _, body in own):
        playing, more = aboard.sail(10.0)  # on a busy machine ten seconds are too few
        playing.join()
        sent.update(more)
    wait_for(lambda: recorded([path]) == sent)
    summary = json.loads(aboard.end(twin))
    assert aboard.end(recorder).split() == [str(path)]

    found = recorded([path])
    assert {name: found[name] for name in sent} == sent
    assert describe_recording(read_recording(path))["closed"]
    said = predictions_in(path)
    assert all(describe_schema_violation(body, PREDICTION) == "" for _, body in said)
    assert len(said) > summary["recorded"] >= 5  # the other one's are among them
    assert summary["judged"] >= 1
    assert summary["left_out"] == 0
    assert {tuple(body.get("planned_channels", ())) for _, body in said} == {(), ("port_rpm",)}
    assert "no plan at" in aboard.log("twin")
    assert "predictions" in aboard.log("twin").splitlines()[-1]
    assert_errors_are_those_of_the_recording(path, [body for _, body in said])


def assert_errors_are_those_of_the_recording(path: Path, bodies: list[dict[str, Any]]) -> None:
    """Worked out again from the finished recording and what was forecast."""
    table = resample_recording(read_recording(path))
    tracks = {body["start"]: body["track"] for body in bodies}
    judged = [body["error"] for body in bodies if "error" in body]
    assert judged
    for error in judged:
        start = int((table.index.as_unit("ns").asi8 < error["start"] * 1e9).sum())
        measured = table.iloc[start : start + HORIZON_S + 1]
        track = tracks[error["start"]]
        away_m = np.hypot(track["north_m"] - measured["north_m"], track["east_m"] - measured["east_m"])[1:]
        assert error["mean_distance_m"] == pytest.approx(away_m.mean(), abs=2e-3)
        assert error["end_distance_m"] == pytest.approx(away_m.iloc[-1], abs=2e-3)


@pytest.mark.slow
def test_it_goes_on_with_the_next_part_and_with_the_next_recording(aboard: Aboard) -> None:
    """Parts of some 70 kB; then the recorder ends and another begins."""
    aboard.config.write_text(aboard.config.read_text() + "[recording]\nsplit_mb = 0.07\n")
    twin = aboard.watch()
    paths: list[Path] = []
    for run in ("first", "second"):
        recorder = aboard.record(run)
        aboard.wait_for_log("twin", f"following {first_part(aboard.log(run))}")
        playing, sent = aboard.sail(14.0)
        playing.join()
        time.sleep(0.5)
        parts = [Path(line) for line in aboard.end(recorder).split()]
        assert len(parts) >= 3
        found = recorded(parts)
        assert {name: found[name] for name in sent} == sent
        starts = [body["start"] for part in parts for _, body in predictions_in(part)]
        assert len(starts) >= 9
        assert set(np.diff(starts)) <= {1.0, 2.0}, "a part was waited for"
        paths += parts
    summary = json.loads(aboard.end(twin))
    assert summary["recorded"] == sum(len(predictions_in(path)) for path in paths)
    assert summary["judged"] >= 8


def test_a_duration_ends_it_and_what_is_wrong_is_one_line(aboard: Aboard, command: Command) -> None:
    process = aboard.start("short", "watch", "--duration", "0.5", "--json")
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert json.loads(stdout)["made"] == 0
    assert "0 predictions" in aboard.log("short")
    wrong = command("watch", aboard.config, "--vessel", "nowhere")
    assert wrong.code == 1
    assert len(wrong.err.splitlines()) == 1
