"""A twin beside a saturated recorder: how late its predictions come, what it costs, and that it costs no sample.

The load of ``recorder_load.py``, with all 13 channels in it, goes to ``seatrial record``. Four stretches follow
each other in one recording: without a twin, with one, with one that is stopped in the middle and goes on, with one
that is killed. Prints the share of one core that recorder and twin take, the latency of the predictions from the
reception of the newest sample that went into one until the recorder wrote it, and what was lost. Run with the
number of seconds in all and a calibrator's folder: ``python -m tests.benchmarks.watch_load 80 CALIBRATOR``.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import MessageStream
from tests.benchmarks import recorder_load as load

STRETCHES = {
    "without a twin": "none", "with a twin": "", "one that stopped": "stopped", "one that is killed": "killed",
}  # fmt: skip
SENTENCES = (
    "HEHDT,123.45,T", "TIROT,-12.5,A", "GPVTG,84.4,T,,M,5.1,N,,K,A",
    "RCTRD,1,0.0,R,,V,0.0", "RCTRD,2,120.0,R,,V,10.0", "RCTRD,4,120.0,R,,V,350.0",
)  # fmt: skip
STARTING_S = 8.0  # a twin loads its libraries meanwhile


def line_sender(port: int) -> Callable[[int], None]:
    """Heading, motion and all three thrusters in turn."""
    outgoing = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    texts = [frame_sentence(text) for text in SENTENCES]
    return lambda number: outgoing.sendto(texts[number % len(texts)], ("127.0.0.1", port)) and None


class Bench:
    """The recorder under load, and the twins beside it."""

    def __init__(self, folder: Path, calibrator: str) -> None:
        self.folder, self.config = folder, folder / "load.toml"
        self.ports = {"can": load.free_port(), "line": load.free_port(), "mavlink": load.free_port()}
        self.config.write_text(load.CONFIGURATION.format(multicast=load.MULTICAST, **self.ports))
        self.environment = {**os.environ, "SEATRIAL_RUNTIME": str(folder / "run"), "PYTHONPATH": str(load.ROOT)}
        self.options = ["--calibrator", calibrator] if calibrator else []
        self.recorder = self.start("record", "-o", str(folder / "out"))
        self.recorder_cpu_s = 0.0
        self.sent: dict[str, int] = {}
        self.summaries: list[dict[str, float]] = []

    def start(self, command: str, *options: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, load.ROOT / "seatrial.py", command, str(self.config), *options],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=self.environment,
        )  # fmt: skip

    def senders(self, until_s: float) -> list[threading.Thread]:
        jobs: list[tuple[str, float, Callable[[int], None]]] = [
            ("/raw/can/bus", load.FRAMES_HZ, load.can_sender(self.ports["can"])),
            ("/raw/nmea0183/line", load.SENTENCES_HZ, line_sender(self.ports["line"])),
            ("/raw/mavlink/autopilot", load.MAVLINK_HZ, load.mavlink_sender(self.ports["mavlink"])),
        ]

        def run(topic: str, rate_hz: float, send: Callable[[int], None]) -> None:
            self.sent[topic] = load.paced(rate_hz, until_s, send)

        return [threading.Thread(target=run, args=job) for job in jobs]

    def stretch(self, what: str, seconds: float, how: str = "") -> None:
        """Measure for so many seconds, with a twin that is treated so, or without."""
        twin = None if how == "none" else self.start("watch", "--json", *self.options)
        if twin is not None:
            time.sleep(STARTING_S)
        started_s, before_s = time.monotonic(), load.cpu_s(self.recorder.pid)
        twin_before_s = load.cpu_s(twin.pid) if twin else 0.0
        if twin and how == "stopped":
            time.sleep(seconds / 4)
            twin.send_signal(signal.SIGSTOP)
            time.sleep(seconds / 4)
            twin.send_signal(signal.SIGCONT)
            time.sleep(seconds / 2)
        else:
            time.sleep(seconds)
        took_s = time.monotonic() - started_s
        text = f"{what:18}  recorder {100 * (load.cpu_s(self.recorder.pid) - before_s) / took_s:5.1f} % of one core"
        if twin:
            text += f"  twin {100 * (load.cpu_s(twin.pid) - twin_before_s) / took_s:5.1f} %, {load.state(twin.pid)}"
            twin.send_signal(signal.SIGKILL if how == "killed" else signal.SIGTERM)
            said, _ = twin.communicate()
            self.summaries += [json.loads(said)] if said else []
        print(text, flush=True)


def latencies_s(path: Path) -> list[float]:
    """From the reception of the newest sample until the recorder took the prediction, of each in a file."""
    found = []
    for each in MessageStream(path):
        if each.topic == "/prediction":
            body = each.decode_body()
            found.append(each.log_ns / 1e9 - body["made_at"] + body["latency_s"])
    return found


def main(duration_s: float, calibrator: str) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(Path(scratch), calibrator)
        time.sleep(3.0)
        each_s = max((duration_s - 3 * STARTING_S) / 4, 5.0)
        started_s = time.monotonic()
        threads = bench.senders(started_s + 4 * each_s + 3 * STARTING_S + 2.0)
        for thread in threads:
            thread.start()
        for what, how in STRETCHES.items():
            bench.stretch(what, each_s, how)
        for thread in threads:
            thread.join()
        ran_s = time.monotonic() - started_s
        time.sleep(1.0)
        bench.recorder_cpu_s = load.cpu_s(bench.recorder.pid)
        bench.recorder.send_signal(signal.SIGTERM)
        stdout, _ = bench.recorder.communicate()
        paths = [Path(line) for line in stdout.split()]
        load.report(bench.sent, paths, bench.recorder_cpu_s / ran_s, ran_s)
        late_s = np.array([each for path in paths for each in latencies_s(path)])
        print(
            f"{late_s.size} predictions; {[each['made'] for each in bench.summaries]} by the twins that ended well"
        )
        if late_s.size:
            median, most, late, longest = np.quantile(late_s, (0.5, 0.95, 0.99, 1.0))
            print(f"latency: median {median:.3f} s, 95 % {most:.3f} s, 99 % {late:.3f} s, max {longest:.3f} s")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 80.0, sys.argv[2] if len(sys.argv) > 2 else "")
