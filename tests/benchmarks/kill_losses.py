"""What a kill costs in real seconds: ``seatrial record`` killed at random moments, twenty times at two rates.

Numbered headings go to it over UDP. Prints how long before each kill the first one that is missing was sent, beside
what the machine's load explains of it: how late the sender was, and how long messages that are there took. Run
``python -m tests.benchmarks.kill_losses 20``.
"""

from __future__ import annotations

import os
import random
import socket
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

from seatrial.acquisition.recording.reader import MessageStream
from tests.acquisition.conftest import config_text, free_port
from tests.acquisition.test_kill import RATES_HZ, RAW_TOPIC, said
from tests.acquisition.test_record_command import start_recorder


class Sender(threading.Thread):
    """Sends headings over UDP at a rate and remembers when [monotonic ns], and its delay ``late_s``."""

    def __init__(self, port: int, rate_hz: float) -> None:
        super().__init__(daemon=True)
        self._address, self._period_s, self._ending = ("127.0.0.1", port), 1.0 / rate_hz, threading.Event()
        self.sent_ns: list[int] = []
        self.late_s = 0.0

    def run(self) -> None:
        began_s = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            while not self._ending.is_set():
                wait_s = began_s + len(self.sent_ns) * self._period_s - time.monotonic()
                time.sleep(max(wait_s, 0.0))
                self.late_s = max(self.late_s, -wait_s)
                data = said(len(self.sent_ns))
                self.sent_ns.append(time.monotonic_ns())
                with suppress(ConnectionRefusedError):  # the recorder has just been killed
                    line.sendto(data, self._address)

    def end(self) -> None:
        self._ending.set()
        self.join()


def losses_s(folder: Path, rate_hz: float, wait_s: float) -> tuple[float, float]:
    """Record and kill after ``wait_s``: what was lost, and what the machine's load made later [s]."""
    config, port = folder / "trial.toml", free_port()
    config.write_text(config_text(f'type = "udp"\nport = {port}\n', ("heading_deg",), clock="receiver"))
    process = start_recorder(config, folder / "out")
    sender = Sender(port, rate_hz)
    sender.start()
    time.sleep(wait_s)
    killed_ns = time.monotonic_ns()
    process.kill()
    process.communicate()
    sender.end()
    numbers = {said(number).strip(): number for number in range(len(sender.sent_ns))}
    frames = [entry.decode_frame() for path in (folder / "out").iterdir() for entry in MessageStream(path)
              if entry.topic == RAW_TOPIC]  # fmt: skip
    received_ns = {numbers[frame.payload]: frame.monotonic_ns for frame in frames}
    missing = (each for number, each in enumerate(sender.sent_ns) if number not in received_ns)
    took_s = max((each - sender.sent_ns[number]) / 1e9 for number, each in received_ns.items())
    return max(killed_ns - next(missing, killed_ns), 0) / 1e9, max(took_s, sender.late_s)


def main(kills: int) -> None:
    for rate_hz in RATES_HZ:
        lost_s = []
        for seed in range(kills):
            wait_s = random.Random(seed).uniform(0.4, 1.2)
            with tempfile.TemporaryDirectory() as folder:
                os.environ["SEATRIAL_RUNTIME"] = folder
                lost, load = losses_s(Path(folder), rate_hz, wait_s)
            lost_s.append(lost)
            print(f"{rate_hz:.0f}/s, killed after {wait_s:.2f} s: lost {lost:.3f} s, load {load:.3f} s")
        print(f"{rate_hz:.0f}/s: at worst {max(lost_s):.3f} s lost")


if __name__ == "__main__":
    main(int(sys.argv[1]))
