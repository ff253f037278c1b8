"""A recorder that is killed at any moment loses at most 0.2 s, and everything before that is readable."""

from __future__ import annotations

import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from acquisition.encoders.nmea0183 import sentence
from acquisition.recording.reader import MessageStream, read_recording
from acquisition.recording.schemas import RAW_PREFIX
from tests.acquisition.conftest import PATIENCE_S, config_text, free_port
from tests.acquisition.test_record_command import start_recorder

CONTRACT_S = 0.2
RATES_HZ = (130.0, 1300.0)
RAW_TOPIC = f"{RAW_PREFIX}nmea0183/line"


class Sender(threading.Thread):
    """Sends headings over UDP at a rate, each of them once, and remembers when [monotonic ns]."""

    def __init__(self, port: int, rate_hz: float) -> None:
        super().__init__(daemon=True)
        self._address, self._period_s = ("127.0.0.1", port), 1.0 / rate_hz
        self._ending = threading.Event()
        self.sent_ns: list[int] = []
        self.latest_s = 0.0  # behind its own plan: how much this machine holds up a program that only sleeps

    def run(self) -> None:
        started_s = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            while not self._ending.is_set():
                wait_s = started_s + len(self.sent_ns) * self._period_s - time.monotonic()
                if wait_s > 0:
                    time.sleep(wait_s)
                self.latest_s = max(self.latest_s, -wait_s)
                data = said(len(self.sent_ns))
                self.sent_ns.append(time.monotonic_ns())
                with suppress(ConnectionRefusedError):  # the recorder has just been killed
                    line.sendto(data, self._address)

    def end(self) -> None:
        self._ending.set()
        self.join()


def said(number: int) -> bytes:
    return sentence(f"HEHDT,{number / 100:.2f},T")


@dataclass
class Aftermath:
    """What was sent, when the recorder was killed, and what its files hold: message by time of reception [ns]."""

    sender: Sender
    killed_ns: int
    paths: list[Path]
    received_ns: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        numbers = {said(number).strip(): number for number in range(len(self.sender.sent_ns))}
        for path in self.paths:
            if not path.stat().st_size:  # a part that was just about to begin
                continue
            for entry in MessageStream(path):
                if entry.topic == RAW_TOPIC:
                    frame = entry.frame()
                    number = numbers[frame.payload]
                    assert number not in self.received_ns, "a message is there twice"
                    self.received_ns[number] = frame.monotonic_ns

    @property
    def before_kill(self) -> int:
        return sum(sent_ns < self.killed_ns for sent_ns in self.sender.sent_ns)

    @property
    def lost_s(self) -> float:
        """How long before the kill the first message that is missing was sent, wherever it was then [s]."""
        missing = (number for number in range(self.before_kill) if number not in self.received_ns)
        first = next(missing, None)
        return 0.0 if first is None else (self.killed_ns - self.sender.sent_ns[first]) / 1e9

    @property
    def machine_s(self) -> float:
        """What this machine's load added, by what it did to messages that are there, and to the sender [s].

        A recorder that flushes too seldom makes neither of the two longer.
        """
        paths_s = (each - self.sender.sent_ns[number] for number, each in self.received_ns.items())
        return max(max(paths_s) / 1e9, self.sender.latest_s)

    def __str__(self) -> str:
        share = len(self.received_ns) / self.before_kill
        return f"recovered {100 * share:.2f} %, lost {self.lost_s:.3f} s, machine {self.machine_s:.3f} s"


Kill = Callable[..., Aftermath]


@pytest.fixture
def kill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Kill:
    """Record UDP at a rate as a process of its own, and kill it when ``moment`` returns."""
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))

    def killed(name: str, rate_hz: float, moment: Callable[[Path], None], more: str = "") -> Aftermath:
        folder, port = tmp_path / name, free_port()
        config = tmp_path / f"{name}.toml"
        section = f'type = "udp"\nport = {port}\n'
        config.write_text(config_text(section, ("heading_deg",), clock="receiver") + more)
        process = start_recorder(config, folder)
        sender = Sender(port, rate_hz)
        sender.start()
        try:
            moment(folder)
            killed_ns = time.monotonic_ns()
            os.kill(process.pid, signal.SIGKILL)
        finally:
            process.kill()
            process.communicate()
            sender.end()
        return Aftermath(sender, killed_ns, sorted(folder.glob("*.mcap")))

    return killed


def assert_contract(aftermath: Aftermath) -> None:
    """Everything that was sent more than 0.2 s before, and what the machine needed to bring it, is there."""
    assert aftermath.lost_s <= CONTRACT_S + aftermath.machine_s, str(aftermath)


def kill_at_random(kill: Kill, rate_hz: float, seed: int) -> Aftermath:
    wait_s = random.Random(seed).uniform(0.4, 1.2)
    aftermath = kill(f"kill{seed}", rate_hz, lambda folder: time.sleep(wait_s))
    print(f"{rate_hz:.0f}/s, killed after {wait_s:.2f} s: {aftermath}")  # noqa: T201 - what the proof measures
    (path,) = aftermath.paths
    recording = read_recording(path)
    assert not recording.closed
    assert len(recording.series["heading_deg"].value) >= len(aftermath.received_ns) - 1
    assert_contract(aftermath)
    return aftermath


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_kill_costs_at_most_a_fifth_of_a_second(kill: Kill, rate_hz: float, seed: int) -> None:
    kill_at_random(kill, rate_hz, seed)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_twenty_kills_at_random_moments(kill: Kill, rate_hz: float) -> None:
    all_of_them = [kill_at_random(kill, rate_hz, seed) for seed in range(20)]
    found = sum(len(each.received_ns) for each in all_of_them) / sum(each.before_kill for each in all_of_them)
    worst_s = max(each.lost_s for each in all_of_them)
    print(f"{rate_hz:.0f}/s: recovered {100 * found:.2f} %, at worst {worst_s:.3f} s lost")  # noqa: T201


def kill_in_a_split(kill: Kill, part: int, later_s: float) -> Aftermath:
    """As a part appears, or a moment later: those before it are closed well and nothing is missing between them."""

    def part_appears(folder: Path) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while len(list(folder.iterdir())) < part and time.monotonic() < until_s:
            time.sleep(0.0002)
        time.sleep(later_s)

    aftermath = kill(f"split{1e6 * later_s:.0f}", 1300.0, part_appears, "[recording]\nsplit_mb = 0.001\n")
    *whole, last = aftermath.paths
    print(f"killed {1e3 * later_s:.1f} ms after part {part} appeared: {aftermath}")  # noqa: T201
    assert len(whole) >= part - 1  # on a busy machine more of them before the kill
    assert all(read_recording(path).closed for path in whole)
    assert not last.stat().st_size or not read_recording(last).closed
    assert_contract(aftermath)
    return aftermath


@pytest.mark.parametrize(("part", "later_s"), [(2, 0.0), (3, 0.003)])
def test_a_kill_between_two_parts(kill: Kill, part: int, later_s: float) -> None:
    kill_in_a_split(kill, part, later_s)


@pytest.mark.slow
def test_twenty_kills_between_two_parts(kill: Kill) -> None:
    for number in range(20):
        kill_in_a_split(kill, 2, number * 0.0003)
