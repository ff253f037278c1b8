"""A recorder that is killed at any moment loses at most what the last flush has not taken, and no message between.

How much is judged by the recorder's own clock, which here is simulated: a busy machine holds up nothing on it. Real
seconds are for ``tests/benchmarks/kill_losses.py``.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path

import pytest

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger import maintenance, pipeline
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import RAW_PREFIX
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import MessageStream, read_recording
from tests.acquisition.conftest import SimulatedClock, config_text, free_port, recorded_count, wait_for
from tests.acquisition.test_record_command import start_recorder
from tests.conftest import nightly

RATES_HZ = [1300.0, *nightly(130.0)]
RAW_TOPIC = f"{RAW_PREFIX}nmea0183/line"
FROM_HERE = get_context("forkserver")
FROM_HERE.set_forkserver_preload([__name__])  # what a recorder imports takes longer than its life here


def said(number: int) -> bytes:
    return frame_sentence(f"HEHDT,{number % 36_000 / 100:.2f},T")


def recorded(paths: Iterable[Path]) -> int:
    """How many headings the files hold, of which none may be missing between the first and the last."""
    found = [
        entry.decode_frame().payload
        for path in paths if path.stat().st_size  # else a part that was just about to begin
        for entry in MessageStream(path) if entry.topic == RAW_TOPIC
    ]  # fmt: skip
    assert found == [said(number).strip() for number in range(len(found))]
    return len(found)


class KillingClock(SimulatedClock):
    """Brings a heading at each of its times while the recorder sleeps, and kills its own process when told.

    A sleep takes up to what the recorder allows for: ``TICK_S`` from one look at the clock to the next.
    """

    def __init__(self, rate_hz: float, kill_s: float) -> None:
        self._began_s = self.now_s = time.monotonic()
        self._rate_hz, self._kill_s, self._said = rate_hz, self._began_s + kill_s, 0
        self._random = random.Random(round(1e6 * kill_s))
        self.recorder: pipeline.Recorder

    def sleep(self, duration_s: float) -> None:
        until_s = self.now_s + self._random.uniform(duration_s, maintenance.TICK_S)
        self.now_s = min(until_s, self._kill_s)
        while self._said / self._rate_hz < self.now_s - self._began_s:
            at_ns = round(1e9 * (self._began_s + self._said / self._rate_hz))
            frame = Frame("line", "nmea0183", said(self._said).strip(), time.time_ns(), at_ns)
            self._said += self.recorder._inbox.put("line", [frame])
        if until_s >= self._kill_s:
            os.kill(os.getpid(), signal.SIGKILL)


def record_and_die(config_path: Path, folder: Path, rate_hz: float, kill_s: float) -> None:
    """The recorder's loop on a clock of its own, to its violent end."""
    config, clock = load_config(config_path), KillingClock(rate_hz, kill_s)
    for module in (pipeline, maintenance):
        module.time = clock  # type: ignore[attr-defined]
    clock.recorder = pipeline.Recorder(config, RecordingParts(folder, config.trial, {}, config.recording))
    clock.recorder._record_until_end()


def config_file(folder: Path, section: str, more: str = "") -> Path:
    path = folder / "trial.toml"
    path.write_text(config_text(section, ("heading_deg",), clock="receiver") + more)
    return path


@pytest.mark.parametrize("kill_s", [0.749, 1.312, 2.587])
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_kill_costs_no_more_than_the_time_to_the_next_flush(
    tmp_path: Path, rate_hz: float, kill_s: float
) -> None:
    config, folder = config_file(tmp_path, f'type = "udp"\nport = {free_port()}\n'), tmp_path / "out"
    process = FROM_HERE.Process(target=record_and_die, args=(config, folder, rate_hz, kill_s))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    lost_s = kill_s - recorded(folder.iterdir()) / rate_hz
    assert 0.0 <= lost_s <= load_config(config).recording.flush_s


class Talker(threading.Thread):
    """Says headings at a rate to whoever connects, over TCP: what is sent waits for a machine that is busy."""

    def __init__(self, rate_hz: float) -> None:
        super().__init__(daemon=True)
        self._line, self._period_s = socket.create_server(("127.0.0.1", 0)), 1.0 / rate_hz
        self.section = f'type = "tcp"\nport = {self._line.getsockname()[1]}\n'

    def run(self) -> None:
        link, _ = self._line.accept()
        with self._line, link, suppress(OSError):  # the recorder has been killed
            number = 0
            while True:
                link.sendall(said(number))
                number += 1
                time.sleep(self._period_s)


def parts_after_kill(tmp_path: Path, rate_hz: float, moment: Callable[[Path], None], more: str = "") -> list[Path]:
    """Record as a process of its own, and kill it when ``moment`` returns."""
    talker, folder = Talker(rate_hz), tmp_path / "out"
    process = start_recorder(config_file(tmp_path, talker.section, more), folder)
    talker.start()
    try:
        moment(folder)
    finally:
        process.kill()
        process.communicate()
    talker.join()
    return sorted(folder.glob("*.mcap"))


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_what_was_flushed_is_readable_after_a_kill(tmp_path: Path, rate_hz: float) -> None:
    def moment(folder: Path) -> None:
        wait_for(lambda: recorded_count(folder) > 0)
        time.sleep(random.Random(rate_hz).uniform(0.0, 0.3))

    (path,) = parts_after_kill(tmp_path, rate_hz, moment)
    recording = read_recording(path)
    assert not recording.closed
    assert len(recording.series["heading_deg"].value) >= recorded([path]) - 1


@pytest.mark.parametrize(("part", "later_s"), [(3, 0.003), *nightly((2, 0.0))])
def test_a_kill_between_two_parts(tmp_path: Path, part: int, later_s: float) -> None:
    """As a part appears, or a moment later: those before it are closed well and nothing is missing between them."""

    def part_appears(folder: Path) -> None:
        wait_for(lambda: len(list(folder.iterdir())) >= part, every_s=0.0002)
        time.sleep(later_s)

    paths = parts_after_kill(tmp_path, 1300.0, part_appears, "[recording]\nsplit_mb = 0.001\n")
    assert len(paths) >= part  # on a busy machine more of them before the kill
    assert all(read_recording(path).closed for path in paths[:-1])
    assert recorded(paths) > 0
